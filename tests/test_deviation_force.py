"""An unmodelled force: its linear responses by an integrator of their own, the force that is found, coverage, and a real wheel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from estim.deviation.components import diagonalise
from estim.deviation.force import force_kernel, force_shapes, position_response, shared_force_shapes, speed_response, track
from estim.deviation.found import find_force
from estim.deviation.grid import FORCE_SCALE, START_SD, prior_grid
from estim.deviation.kernels import without_mean
from estim.deviation.linearised import linearise

G_R, PHI = 9.81 / 0.235, np.radians(-5.5)


@dataclass(frozen=True)
class Wheel:
    """Angle turned u (rad) and its rate w for dw/dt = [acceleration (W' + f) - D' w^2/2]/D."""

    gamma: float = 0.12
    theta0: float = np.radians(5.5)
    c_rr: float = 0.03
    j: float = 0.7

    def inertia(self, u):
        return 1.0 + self.j + 2.0 * self.gamma * np.cos(self.theta0 + u + PHI)

    def energy(self, u):
        return self.gamma * (np.cos(self.theta0) - np.cos(self.theta0 + u)) - u * (np.sin(PHI) + self.c_rr * np.cos(PHI))

    def rate(self, u, start=0.0):
        return np.sqrt(2.0 * G_R * np.maximum(self.energy(u) + start, 0.0) / self.inertia(u))

    def motion(self, t, force, start=0.0):
        """u at times t since release, by an ODE solver."""

        def change(_, state):
            u, w = state
            push = self.gamma * np.sin(self.theta0 + u) - (np.sin(PHI) + self.c_rr * np.cos(PHI)) + force(u)
            steeper = -2.0 * self.gamma * np.sin(self.theta0 + u + PHI)
            return [w, (G_R * push - 0.5 * steeper * w**2) / self.inertia(u)]

        w0 = np.sqrt(2.0 * G_R * start / self.inertia(0.0))
        return solve_ivp(change, (0.0, t[-1]), [0.0, w0], t_eval=t, rtol=1e-11, atol=1e-12, method="DOP853").y[0]


def profile(u):
    return np.sin(1.3 * u + 0.4) + 0.3 * np.cos(2.9 * u)


def released(wheel: Wheel, first: float = 0.0):
    """A track of 15 rad with the response of positions at frames of 1/10 s."""
    t = np.arange(0.3, 3.6, 0.1)
    u = wheel.motion(t, lambda u: 0.0 * u)
    along = track(u[-1], first=first)
    return t, u, along, position_response(along, u, wheel.rate(along.fine), wheel.inertia(along.fine), acceleration=G_R)


def test_positions_answer_to_a_force_as_an_integrator_says():
    wheel = Wheel()
    t, _, along, response = released(wheel)
    size = 1e-5
    truth = (wheel.motion(t, lambda u: size * profile(u)) - wheel.motion(t, lambda u: -size * profile(u))) / (2.0 * size)
    linear = response.force @ profile(along.nodes)
    np.testing.assert_allclose(linear, truth, atol=5e-3 * np.abs(truth).max())


def test_positions_answer_to_a_push_but_for_a_shift_of_time():
    wheel = Wheel()
    _, u, _, response = released(wheel)
    size, shift = 1e-4, wheel.rate(u)[:, None]
    # by the time that a place is reached, from 0.02 rad on
    place, late = np.linspace(0.02, u[-1], 400_001), []
    for start in (size, -size):
        slowness = 1.0 / wheel.rate(place, start)
        late.append(np.interp(u, place, np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))] * (place[1] - place[0])))
    truth = -(late[0] - late[1]) / (2.0 * size) * wheel.rate(u)
    left = truth - response.start
    rest = left - shift @ np.linalg.lstsq(shift, left, rcond=None)[0]
    alone = response.start - shift @ np.linalg.lstsq(shift, response.start, rcond=None)[0]
    assert np.abs(rest).max() < 4e-3 * np.abs(alone).max()
    assert np.abs(alone).max() > 3.0  # and not a shift of time itself


def test_where_the_observations_begin_does_not_matter_but_for_a_shift_of_time():
    wheel = Wheel()
    _, u, along, whole = released(wheel)
    _, _, _, late = released(wheel, first=u[0])
    shift = wheel.rate(u)[:, None]
    left = (whole.force - late.force) @ profile(along.nodes)
    rest = left - shift @ np.linalg.lstsq(shift, left, rcond=None)[0]
    assert np.abs(rest).max() < 1e-3 * np.abs(whole.force @ profile(along.nodes)).max()


def test_speeds_answer_to_a_force_and_to_a_push():
    wheel, size = Wheel(), 1e-6
    u = np.linspace(0.5, 15.0, 25)
    response = speed_response(along := track(15.0), u, wheel.rate(u), wheel.inertia(u), acceleration=G_R)
    work = (np.cos(0.4) - np.cos(1.3 * u + 0.4)) / 1.3 + 0.3 * np.sin(2.9 * u) / 2.9
    truth = (wheel.rate(u, size * work) - wheel.rate(u, -size * work)) / (2.0 * size)
    np.testing.assert_allclose(response.force @ profile(along.nodes), truth, atol=5e-3 * np.abs(truth).max())
    np.testing.assert_allclose(response.start, (wheel.rate(u, size) - wheel.rate(u, -size)) / (2.0 * size), rtol=1e-6)
    # a floor holds the response of a point at rest down
    still = speed_response(along, u[:1], np.zeros(1), np.ones(1), acceleration=G_R, floor=0.1)
    assert still.start[0] == pytest.approx(G_R / 0.1)


def test_speeds_by_differences_answer_as_the_positions_that_they_are_made_of():
    wheel, size = Wheel(), 1e-5
    t, u, along, response = released(wheel)
    n = t.size
    stencil = (np.eye(n, k=1) - np.eye(n, k=-1))[1:-1] / 0.2
    slope = np.array([(wheel.rate(a + 1e-6) - wheel.rate(a - 1e-6)) / 2e-6 for a in u[1:-1]])
    rows = stencil.copy()
    rows[np.arange(n - 2), np.arange(1, n - 1)] -= slope
    found = response.through(rows)

    def residual(eps):
        shifted = wheel.motion(t, lambda u: eps * profile(u))
        return stencil @ shifted - wheel.rate(shifted[1:-1])

    truth = (residual(size) - residual(-size)) / (2.0 * size)
    np.testing.assert_allclose(found.force @ profile(along.nodes), truth, atol=6e-3 * np.abs(truth).max())


def test_speeds_by_differences_answer_as_speeds_do_where_little_changes_between_frames():
    wheel = Wheel(gamma=0.0)
    _, u, along, response = released(wheel)
    rows = (np.eye(u.size, k=1) - np.eye(u.size, k=-1))[1:-1] / 0.2
    rows[np.arange(u.size - 2), np.arange(1, u.size - 1)] -= 0.5 * wheel.rate(u[1:-1]) / u[1:-1]  # v = sqrt(2 a x)
    plain = speed_response(along, u[1:-1], wheel.rate(u[1:-1]), wheel.inertia(u[1:-1]), acceleration=G_R)
    slow = np.sin(0.4 * along.nodes)
    truth = plain.force @ slow
    np.testing.assert_allclose(response.through(rows).force @ slow, truth, atol=0.03 * np.abs(truth).max())



def test_a_force_shared_by_runs_and_an_own_one_for_each():
    wheel = Wheel()
    _, _, along, response = released(wheel)
    runs = (response, replace(response, force=response.force[3:12]))
    shapes = shared_force_shapes(along, runs, own=(0.5, 2.0))
    assert np.logaddexp.reduce([shape.log_prior for shape in shapes]) == pytest.approx(0.0, abs=1e-12)
    kernel = force_kernel(along, shapes[2].length)
    shared = without_mean(kernel, along.weights)
    first, second = (run.force for run in runs)
    found = shapes[3].factor @ shapes[3].factor.T
    truth = np.block([
        [first @ (shared + 4.0 * kernel) @ first.T, first @ shared @ second.T],
        [second @ shared @ first.T, second @ (shared + 4.0 * kernel) @ second.T],
    ])
    np.testing.assert_allclose(found, truth, atol=1e-8 * np.abs(truth).max())
    deviation = diagonalise(np.ones(found.shape[0]), shapes, prior_grid(FORCE_SCALE))
    assert len(deviation.families) == 12


def test_the_force_that_is_found_is_the_conditional_one():
    """One component: against the joint normal distribution of force, parameters and observations, by dense matrices."""
    wheel = Wheel()
    _, u, along, response = released(wheel)
    grid = prior_grid(20.0, spike=0.0, scales=(1.0,), n_amplitude=1)
    amplitude, sd = grid.amplitudes[0], 0.004
    shape = force_shapes(along, response)[3]
    deviation = diagonalise(np.full(u.size, sd**2), (replace(shape, log_prior=0.0),), grid)
    jacobian, precision, pull = np.column_stack([wheel.rate(u), response.start]), np.diag([1.0, START_SD**-2]), np.array([0.3, -0.01])
    observed = response.force @ (0.02 * profile(along.nodes)) + 0.1 * wheel.rate(u)
    found = find_force(linearise(deviation, observed, jacobian, precision=precision, pull=pull), along, response)

    prior = amplitude**2 * without_mean(force_kernel(along, shape.length), along.weights)
    total = response.force @ prior @ response.force.T + sd**2 * np.eye(u.size) + jacobian @ np.linalg.inv(precision) @ jacobian.T
    gain = np.linalg.solve(total, response.force @ prior).T
    np.testing.assert_allclose(found.mean, gain @ (observed - jacobian @ pull), atol=1e-7)
    spread = np.sqrt(np.diag(prior - gain @ response.force @ prior))
    np.testing.assert_allclose(found.sd, spread, rtol=1e-3)
    np.testing.assert_allclose(found.quantiles[3] - found.quantiles[2], spread, rtol=6e-3)
    assert along.weights @ found.mean == pytest.approx(0.0, abs=1e-9)
    assert found.probability == pytest.approx(1.0)
    assert found.material_sd == pytest.approx(0.60 * amplitude, rel=0.02)


# --- fits of the wheel, by least squares that shares no code with the engine's ---------------------------------------------------------------

FIRST, REFERENCE, SIGMA = 0.3, 0.5, 2.0 * np.pi / 500.0 / np.sqrt(12.0)  # rad; the step of the encoder
FINE = np.linspace(FIRST, 17.0, 700)
STEPS = np.array([1e-5, 1e-5, 1e-4, 1e-5, 1e-4])  # of c_rr, gamma, theta0, E0 and the time at REFERENCE


def places(wheel: Wheel, start: float, late: float, t: np.ndarray, work: np.ndarray | float = 0.0) -> np.ndarray:
    """Angles at times t, for the work F (n_fine,) of a force along FINE."""
    rate = np.sqrt(2.0 * G_R * np.maximum(wheel.energy(FINE) + start + work, 1e-5) / wheel.inertia(FINE))
    slowness = 1.0 / rate
    reached = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(FINE))]
    reached += late - np.interp(REFERENCE, FINE, reached)
    inside = np.interp(t, reached, FINE)
    inside = np.where(t < reached[0], FINE[0] + rate[0] * (t - reached[0]), inside)
    return np.where(t > reached[-1], FINE[-1] + rate[-1] * (t - reached[-1]), inside)


@dataclass(frozen=True, eq=False)
class WhiteFit:
    wheel: Wheel
    start: float
    values: np.ndarray  # of the parameters that are free
    residuals: np.ndarray
    jacobian: np.ndarray
    precision: np.ndarray
    pull: np.ndarray
    at: np.ndarray  # (n_obs,) the curve

    @property
    def covariance(self) -> np.ndarray:
        return np.linalg.inv(self.jacobian.T @ self.jacobian / SIGMA**2 + self.precision)


def white_fit(t: np.ndarray, y: np.ndarray, wheel: Wheel, sds: np.ndarray) -> WhiteFit:
    """The mode with white errors; sds (5,) of the priors, 0 for what is exact."""
    free = np.flatnonzero(sds)
    mean = np.array([wheel.c_rr, wheel.gamma, wheel.theta0, 0.0, 0.0])
    precision = np.diag(sds[free] ** -2.0)

    def curve(p):
        return places(replace(wheel, c_rr=p[0], gamma=p[1], theta0=p[2]), p[3], p[4], t)

    def gradient(p):
        return np.array([(curve(p + h) - curve(p - h)) / (2.0 * STEPS[i]) for i, h in zip(free, np.diag(STEPS)[free], strict=True)]).T

    def cost(p):
        return np.sum(np.square(y - curve(p))) / SIGMA**2 + (p - mean)[free] @ precision @ (p - mean)[free]

    p, damping = mean.copy(), 1e-3
    p[4] = np.interp(REFERENCE, y, t)
    for _ in range(40):
        jacobian, r = gradient(p), y - curve(p)
        information = jacobian.T @ jacobian / SIGMA**2 + precision
        slope = jacobian.T @ r / SIGMA**2 - precision @ (p - mean)[free]
        for _ in range(12):
            trial = p.copy()
            trial[free] += np.linalg.solve(information + damping * np.diag(np.diag(information)), slope)
            if cost(trial) < cost(p):
                break
            damping *= 10.0
        else:
            break
        gained, p, damping = cost(p) - cost(trial), trial, max(damping / 10.0, 1e-9)
        if gained < 1e-4:
            break
    found = replace(wheel, c_rr=p[0], gamma=p[1], theta0=p[2])
    return WhiteFit(found, p[3], p[free], y - curve(p), gradient(p), precision, (mean - p)[free], curve(p))


def with_force(fit: WhiteFit, y: np.ndarray, *, radius: float | None = None):
    """The linearised posterior with a force, and the force."""
    along = track(float(np.max(y)), first=FIRST)
    rate = np.sqrt(2.0 * G_R * np.maximum(fit.wheel.energy(along.fine) + fit.start, 1e-5) / fit.wheel.inertia(along.fine))
    response = position_response(along, fit.at, rate, fit.wheel.inertia(along.fine), acceleration=G_R)
    deviation = diagonalise(np.full(y.size, SIGMA**2), force_shapes(along, response, radius=radius), prior_grid(FORCE_SCALE))
    found = linearise(deviation, fit.residuals, fit.jacobian, precision=fit.precision, pull=fit.pull)
    return found, find_force(found, along, response, radius=radius)


WHEEL = Path(__file__).resolve().parents[1] / "data" / "wheel"
CLASS = {"balanced": range(1, 5), "unbalanced": range(1, 4)}


def measured(name: str) -> tuple[np.ndarray, np.ndarray]:
    t, y = np.loadtxt(WHEEL / f"class-{name}.csv", delimiter=",", skiprows=2).T
    used = (y >= 0.5) & (np.arange(y.size) < (np.argmax(y > 15.0) or y.size))
    return t[used], y[used]


def handout(kind: str) -> tuple[Wheel, float]:
    """The wheel of the lab's handout (data/wheel/README.md) and its weight times the radius (N m)."""
    radius, extra = 0.235, 3.4 if kind == "unbalanced" else 0.0
    mass = 11.7 + 0.7 + extra
    inertia = 11.7 * 0.203**2 + extra * (0.178**2 + 0.019**2 / 2.0)
    return Wheel(extra * 0.178 / (mass * radius), np.radians(5.5), 0.03, inertia / (mass * radius**2)), mass * 9.81 * radius * np.cos(PHI)


@pytest.mark.parametrize("kind", ["balanced", "unbalanced"])
def test_repeated_runs_of_a_real_wheel_agree_once_the_force_is_known_of(kind):
    """The study's result: P(a > 0) = 1 in every run, and moments that agree with uncertainties of one to ten times their spread."""
    wheel, weight = handout(kind)
    sds = np.array([0.05, 0.0 if kind == "balanced" else 1e-4, 0.0 if kind == "balanced" else np.radians(10.0), START_SD, 1e3])
    moments, white = [], []
    for run in CLASS[kind]:
        t, y = measured(f"{kind}_{run}")
        fit = white_fit(t, y, wheel, sds)
        found, force = with_force(fit, y, radius=1.0)
        moments.append([weight * (fit.wheel.c_rr + found.mean[0]), weight * np.sqrt(found.covariance[0, 0])])
        white.append([weight * fit.wheel.c_rr, weight * np.sqrt(fit.covariance[0, 0])])
        assert force.probability > 0.999
        assert 0.003 < force.amplitude[1] < 0.04
        assert 0.8 < found.size("scale")[1] < 2.0
        assert 0.2 * force.amplitude[1] < force.material_sd < force.amplitude[1]
        left = found.innovations()
        assert abs(left[1:] @ left[:-1]) / (left @ left) < 0.45
        assert stats.chi2(y.size).sf(left @ left) > 1e-3
    assert 0.9 < np.mean(moments, axis=0)[0] < 1.15

    def disagreement(values):
        value, sd = np.array(values).T
        mean = np.sum(value / sd**2) / np.sum(sd**-2.0)
        return stats.chi2(value.size - 1).sf(np.sum(np.square((value - mean) / sd)))

    assert disagreement(moments) > 0.05
    assert disagreement(white) < 1e-8


def simulated(rng: np.random.Generator, size: float, push: float):
    """Thirty frames of a wheel at 10 Hz with a smooth force of amplitude `size` and an energy at release up to about `push`.

    Also the rolling resistance as the average over the track says it, from the release to the last frame.
    """
    wheel = Wheel(theta0=np.radians(5.5) + 0.1 * rng.standard_normal())
    smooth = np.exp(-0.5 * np.square((FINE[:, None] - FINE) / 3.0))[:, ::7]
    force = size * smooth @ rng.standard_normal(smooth.shape[1]) / np.sqrt(np.sum(np.square(smooth), axis=1))
    work = np.r_[0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(FINE))] + FIRST * force[0]
    t = np.arange(0.0, 6.0, 0.1) + rng.uniform(0.0, 0.1)
    y = places(wheel, abs(push * rng.standard_normal()), 0.6, t, work)
    used = (y > 0.5) & (y < 15.0)
    y = y[used] + SIGMA * rng.standard_normal(np.sum(used))
    return wheel, wheel.c_rr - np.interp(y[-1], FINE, work) / y[-1] / np.cos(PHI), t[used], y


@pytest.mark.statistics
@pytest.mark.parametrize(("size", "push", "white"), [(0.0, 0.0, "covers"), (0.0028, 0.0, "misses"), (0.0, 0.01, "misses")])
def test_the_rolling_resistance_of_a_track_is_covered_with_a_force_and_a_free_start(rng, size, push, white):
    """Nothing missing; a smooth profile, residuals of two standard deviations; a push.  White errors and a start from rest miss the last two."""
    n_run, inside, plain, alarms = 150, [], [], 0
    usual = np.array([0.05, 0.002, np.radians(10.0), START_SD, 1e3])
    at_rest = np.where(np.arange(5) == 3, 0.0, usual)
    for _ in range(n_run):
        wheel, truth, t, y = simulated(rng, size, push)
        start = replace(wheel, gamma=wheel.gamma + 0.002 * rng.standard_normal(), theta0=np.radians(5.5))
        fit = white_fit(t, y, start, usual)
        found, _ = with_force(fit, y)
        below = found.probability_below(np.eye(5)[0], truth - fit.wheel.c_rr)
        inside.append([abs(below - 0.5) < 0.5 * p for p in (0.68, 0.95)])
        alarms += found.p_deviation > 0.95
        rest = white_fit(t, y, start, at_rest)
        plain.append(abs(rest.wheel.c_rr - truth) < np.sqrt(rest.covariance[0, 0]))
    covered = np.mean(inside, axis=0)
    tolerance = 3.0 * np.sqrt(0.68 * 0.32 / n_run)
    assert 0.68 - tolerance < covered[0] < 0.88
    assert covered[1] > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / n_run)
    assert (np.mean(plain) > 0.68 - tolerance) if white == "covers" else (np.mean(plain) < 0.68 - 2.0 * tolerance)
    assert (alarms <= 0.02 * n_run) == (size == 0.0)
