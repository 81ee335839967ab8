"""A deviation that is summed over: likelihood by dense matrices, responses by an integrator of its own, coverage, and a real wheel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from estim.common.errors import InputError
from estim.deviation.components import Shape, diagonalise
from estim.deviation.force import force_kernel, position_response, speed_response, track
from estim.deviation.generic import correlated_shapes, stated_is_conservative
from estim.deviation.grid import prior_grid, track_lengths
from estim.deviation.kernels import distances, exponential, matern32, sd_of_mean, turning, without_mean
from estim.deviation.linearised import linearise, mixture_quantiles
from estim.deviation.mixture import keep_probable

SMALL = prior_grid(0.7, scales=(0.8, 1.0, 1.4), n_amplitude=5)


def two_shapes(n: int) -> tuple[Shape, ...]:
    x = np.linspace(0.0, 10.0, n)
    return tuple(Shape("deviation", length, matern32(distances(x), length), np.log(0.5)) for length in (1.0, 4.0))


def correlated(n: int, rng: np.random.Generator) -> np.ndarray:
    root = np.eye(n) + 0.3 * rng.standard_normal((n, n)) / np.sqrt(n)
    return 0.04 * root @ root.T


def dense(deviation, base, shapes):
    """Log prior and covariance of each component, from their definition."""
    covariance = {shape.length: shape.covariance for shape in shapes}
    for family in deviation.families:
        for a, s, log_prior in zip(family.amplitude, family.scale, family.log_prior, strict=True):
            yield log_prior, s**2 * base + a**2 * covariance[family.length]


def dense_likelihood(deviation, base, shapes, residuals, extra=0.0):
    parts = [w + stats.multivariate_normal(cov=c + extra).logpdf(residuals) for w, c in dense(deviation, base, shapes)]
    return np.logaddexp.reduce(parts, axis=0)


@pytest.mark.parametrize("diagonal", [True, False])
def test_the_likelihood_of_draws_is_that_of_dense_matrices(rng, diagonal):
    n = 14
    shapes = two_shapes(n)
    variances = 0.04 * rng.uniform(0.5, 2.0, n)
    base = np.diag(variances) if diagonal else correlated(n, rng)
    deviation = diagonalise(variances if diagonal else base, shapes, SMALL)
    residuals = rng.standard_normal((7, n)) * 0.4
    jacobian = np.vander(np.linspace(-1.0, 1.0, n), 2)
    found = linearise(deviation, residuals[0], jacobian, precision=np.eye(2))
    everything = keep_probable(found, lost=0.0)
    truth = dense_likelihood(found.deviation, base, shapes, residuals)
    np.testing.assert_allclose(everything.log_likelihood(residuals), truth, atol=1e-6)

    columns = 0.3 * jacobian
    tilted = keep_probable(found, columns=columns, lost=0.0)
    truth = dense_likelihood(found.deviation, base, shapes, residuals, columns @ columns.T)
    np.testing.assert_allclose(tilted.log_likelihood(residuals), truth, atol=1e-6)

    relative = rng.uniform(0.7, 1.5, 7)
    truth = [dense_likelihood(found.deviation, f**2 * base, shapes, r, columns @ columns.T) for f, r in zip(relative, residuals, strict=True)]
    np.testing.assert_allclose(tilted.log_likelihood(residuals, relative=relative), truth, atol=1e-6)


def test_the_precision_is_the_slope_of_the_likelihood(rng):
    n = 9
    deviation = diagonalise(correlated(n, rng), two_shapes(n), SMALL)
    r = rng.standard_normal(n) * 0.5
    columns = rng.standard_normal((n, 1)) * 0.2
    mixture = keep_probable(linearise(deviation, r, np.ones((n, 1)), precision=np.eye(1)), columns=columns)
    step = 1e-5 * np.eye(n)
    slope = (mixture.log_likelihood(r + step) - mixture.log_likelihood(r - step)) / 2e-5
    np.testing.assert_allclose(-mixture.precision(r) @ r, slope, rtol=1e-5, atol=1e-6)


def test_what_is_left_out_is_no_more_than_stated(rng):
    n = 30
    deviation = diagonalise(np.full(n, 0.04), two_shapes(n), prior_grid(2.0))
    r = rng.standard_normal(n) * 0.2 + 0.5 * np.sin(np.linspace(0.0, 6.0, n))
    found = linearise(deviation, r, np.ones((n, 1)), precision=np.eye(1))
    whole, part = keep_probable(found, lost=0.0), keep_probable(found, lost=1e-3)
    assert part.lost <= 1e-3
    assert part.n_component < 0.5 * whole.n_component
    shifts = found.mean + 3.0 * np.sqrt(found.covariance[0]) * np.linspace(-1.0, 1.0, 41)[:, None]
    log_prior = -0.5 * np.square(shifts[:, 0])
    density = [np.exp(m.log_likelihood(r - shifts) + log_prior) for m in (whole, part)]
    assert np.sum(density[0] - density[1]) / np.sum(density[0]) == pytest.approx(part.lost, rel=0.05)
    assert np.all(density[1] <= density[0] * (1.0 + 1e-9))


def test_the_linearised_posterior_is_that_of_a_straight_line(rng):
    n = 12
    shapes, base = two_shapes(n), correlated(n, rng)
    deviation = diagonalise(base, shapes, SMALL)
    jacobian, precision, pull = np.vander(np.linspace(-1.0, 1.0, n), 2), np.diag([4.0, 0.5]), np.array([0.1, -0.2])
    r = rng.standard_normal(n) * 0.5
    found = linearise(deviation, r, jacobian, precision=precision, pull=pull)
    marginal = dense_likelihood(deviation, base, shapes, r - jacobian @ pull, jacobian @ np.linalg.inv(precision) @ jacobian.T)
    assert found.log_evidence == pytest.approx(float(marginal), abs=1e-8)
    k = found.best
    _, covariance = list(dense(found.deviation, base, shapes))[k]
    information = jacobian.T @ np.linalg.solve(covariance, jacobian) + precision
    step = np.linalg.solve(information, jacobian.T @ np.linalg.solve(covariance, r) + precision @ pull)
    np.testing.assert_allclose(found.steps[k], step, rtol=1e-8)
    left = r - jacobian @ step
    _, covariance = list(dense(deviation, base, shapes))[k]
    assert found.innovations() @ found.innovations() == pytest.approx(left @ np.linalg.solve(covariance, left))
    q = found.quantiles([1.0, 0.0], [0.16, 0.5, 0.84])
    assert [found.probability_below([1.0, 0.0], value) for value in q] == pytest.approx([0.16, 0.5, 0.84], abs=1e-9)


def test_quantiles_of_a_mixture_of_one_are_those_of_the_normal_distribution():
    p = [0.025, 0.5, 0.84]
    found = mixture_quantiles(np.ones(1), np.array([[3.0, -1.0]]), np.array([[2.0, 0.5]]), p)
    np.testing.assert_allclose(found, stats.norm([3.0, -1.0], [2.0, 0.5]).ppf(np.array(p)[:, None]), atol=1e-9)


def line_with(errors: np.ndarray, stated: float, shapes: tuple[Shape, ...], scale: float):
    """A straight line through errors (n,) whose standard deviation was stated, and the same with white errors of that size alone."""
    jacobian = np.vander(np.linspace(-1.0, 1.0, errors.size), 2)
    deviation = diagonalise(np.full(errors.size, stated**2), shapes, prior_grid(scale))
    found = linearise(deviation, errors, jacobian, precision=np.zeros((2, 2)))
    return found, stated**2 * np.linalg.inv(jacobian.T @ jacobian)


def test_a_stated_error_is_never_narrowed(rng):
    for errors in (0.1 * rng.standard_normal(40), 0.1 * np.sin(np.linspace(0.0, 20.0, 40))):
        found, white = line_with(errors, 1.0, two_shapes(40), 2.0)
        assert np.linalg.eigvalsh(found.covariance - white).min() > -1e-9
        assert found.size("scale")[1] < 0.3
        assert stated_is_conservative(found)
    # residuals that are merely small show no deviation
    found, _ = line_with(0.1 * rng.standard_normal(40), 1.0, two_shapes(40), 2.0)
    assert found.p_deviation < 0.5
    found, _ = line_with(rng.standard_normal(40), 1.0, two_shapes(40), 2.0)
    assert not stated_is_conservative(found)


def test_red_errors_widen_though_little_of_them_is_white(rng):
    red = np.zeros(200)
    for i in range(1, 200):
        red[i] = 0.95 * red[i - 1] + np.sqrt(1.0 - 0.95**2) * rng.standard_normal()
    t = np.arange(200) * 0.1
    found, white = line_with(red, 1.0, correlated_shapes(t), 2.0)
    assert found.p_deviation > 0.99
    assert found.size("scale")[1] < 0.6
    assert found.covariance[1, 1] > 4.0 * white[1, 1]
    assert stats.kstest(found.innovations(), "norm").pvalue > 0.01


def test_kernels_are_covariances_and_a_mean_can_be_removed():
    x = np.linspace(0.0, 15.0, 120)
    apart = distances(x)
    for kernel in (matern32(apart, 2.0), exponential(apart, 2.0), turning(apart, 2.0, radius=1.0)):
        assert np.linalg.eigvalsh(kernel).min() > -1e-9
        np.testing.assert_allclose(without_mean(kernel).sum(axis=0), 0.0, atol=1e-10)
    assert turning(apart, 2.0, radius=1.0)[0, 0] == 3.0
    # a unit step and a straight line: removing the mean twice changes nothing, and the mean of white noise falls with n
    centred = without_mean(matern32(apart, 2.0))
    np.testing.assert_allclose(without_mean(centred), centred, atol=1e-12)
    assert sd_of_mean(np.eye(25)) == pytest.approx(0.2)


def test_a_constant_of_the_material_is_less_certain_than_the_mean_over_one_track():
    """The study's factors for a track of 15 rad: .36, .60, .86 of the amplitude at lengths .9, 2.8, 9 rad."""
    along = track(15.0)
    found = [sd_of_mean(force_kernel(along, length), along.weights) for length in (0.9, 2.8, 9.0)]
    np.testing.assert_allclose(found, [0.36, 0.60, 0.86], atol=0.006)


def test_lengths_follow_the_track():
    lengths, log_prior = track_lengths(15.0)
    np.testing.assert_allclose(lengths, [0.5, 0.9, 1.6, 2.8, 5.0, 9.0], rtol=0.05)
    assert lengths[np.argmax(log_prior)] == pytest.approx(2.8, rel=0.05)
    assert np.exp(log_prior).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("call", "said"), [
    (lambda: prior_grid(0.0), "amplitude"),
    (lambda: prior_grid(1.0, spike=1.0), "spike"),
    (lambda: prior_grid(1.0, scales=(1.0, 0.0)), "scales"),
    (lambda: diagonalise(np.array([1.0, 0.0]), two_shapes(2), SMALL), "variance"),
    (lambda: diagonalise(-np.eye(3), two_shapes(3), SMALL), "covariance"),
    (lambda: diagonalise(np.ones(3), (), SMALL), "shapes"),
    (lambda: track(1.0, first=2.0), "end"),
    (lambda: speed_response(track(1.0), np.array([0.5]), np.array([0.0]), np.array([1.0]), acceleration=9.81), "speed"),
])
def test_what_breaks_a_rule_is_named(call, said):
    with pytest.raises(InputError, match=said):
        call()


# --- a wheel that rolls down, written down a second time, and integrated in time -----------------------------------------------------------

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
