"""What an error in common to all points does to a result, against fits of data that have it."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estim.checks import influences
from estim.curve_fit import fit_curve
from estim.curves import DisturbedMotion, DisturbedMotionCurve, MotionCurve, PhaseCurve, RollingMotion
from estim.fitting import Fit, fit_least_squares
from estim.problem import Independent, Normal, Observations, Parameter, Problem, Scale
from model import Body, speed

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.motion import solve
from truth.recordings import BASE, sagging

TRUTH = {"gamma": 0.2, "kappa": 0.45, "theta0": 1.0, "phi": 0.07, "rolling_resistance": 0.0, "radius": 0.15, "g": 9.81}
EXACT = {"rho": 1.0, "trailing_fraction": 0.0, "particle_gyration": 0.0}
PRIORS = {"gamma": Normal(0.2, 0.01), "kappa": Normal(0.45, 0.1), "theta0": Normal(1.0, 0.03)}
X = np.linspace(0.03, 0.4, 40)
MOVES = ("clock", "length", "sag", "g")


def fitted(x: np.ndarray, v: np.ndarray, g: float = 9.81) -> Fit:
    parameters = tuple(Parameter(name, "1", prior, name) for name, prior in PRIORS.items())
    arguments = {name: name if name in PRIORS else value for name, value in {**TRUTH, **EXACT, "g": g}.items()}
    noise = Independent(Scale(0.01), Scale(), np.ones(x.size))
    run = Observations("r", x, v, None, PhaseCurve(False), arguments, noise, "x", "m", "v", "m/s", (), np.zeros((0, 2)), RollingMotion(False))
    return fit_least_squares(Problem(parameters, (run,)), rng=np.random.default_rng(1), n_start=2)


def body() -> Body:
    return Body(**{name: TRUTH[name] for name in ("radius", "gamma", "kappa")})


def true_speed(x: np.ndarray, g: float = 9.81) -> np.ndarray:
    return np.ravel(speed(x, body(), phi=TRUTH["phi"], theta0=TRUTH["theta0"], g=g))


def sagging_speed(depth: float) -> np.ndarray:
    """From the balance of energy alone: the height of the centre of mass of a disk on a parabola, the rotation unchanged."""
    b, th0, phi = TRUTH, TRUTH["theta0"], TRUTH["phi"]
    th = th0 + X / b["radius"]
    inertia = 1.0 + b["gamma"] + (1.0 - b["gamma"]) * b["kappa"] + 2.0 * b["gamma"] * np.cos(th + phi)
    lowered = depth * 4.0 * (X / X[-1]) * (1.0 - X / X[-1])
    fall = b["gamma"] * b["radius"] * (np.cos(th0) - np.cos(th)) - X * np.sin(phi) + lowered
    return np.sqrt(2.0 * b["g"] * fall / inertia)


@pytest.mark.parametrize("error", MOVES)
def test_the_response_is_that_of_a_new_fit(error: str) -> None:
    """Data with a tenth of the error, fit as if they had none."""
    share = 0.1
    clean = fitted(X, true_speed(X))
    told = next(one for one in influences(clean) if one.name == error)
    v = true_speed(X)
    spoilt = {
        "clock": lambda: fitted(X, v / (1.0 + 0.01 * share)),
        "length": lambda: fitted(X * (1.0 + 0.01 * share), v * (1.0 + 0.01 * share)),
        "sag": lambda: fitted(X, sagging_speed(1e-3 * share)),
        "g": lambda: fitted(X, v, g=9.81 * (1.0 + 1e-3 * share)),
    }[error]()
    moved = (spoilt.values - clean.values) / clean.sds / share
    expected = np.array([told.shifts[name] for name in clean.names])
    assert np.max(np.abs(expected)) > 0.01
    assert moved == pytest.approx(expected, abs=0.05 * np.max(np.abs(expected)))


def test_sagging_speed_without_sag_is_the_phase_curve() -> None:
    assert sagging_speed(0.0) == pytest.approx(true_speed(X), rel=1e-9)


def test_the_strongest_comes_first_and_a_wrong_size_would_fail() -> None:
    found = influences(fitted(X, true_speed(X)))
    assert [one.largest for one in found] == sorted((one.largest for one in found), reverse=True)
    assert len({one.name for one in found}) == len(found) >= 5
    first = found[0]
    assert first.largest == abs(first.shifts[first.strongest]) == max(map(abs, first.shifts.values()))


def test_a_users_curve_has_scales() -> None:
    """y = a x: a per cent more of y is a per cent more of a, a per cent more of x a per cent less."""
    x = np.linspace(1.0, 5.0, 9)
    fit = fit_curve("a*x", x, 2.0 * x + 0.01 * np.cos(7.0 * x), u_y=0.05, start={"a": 1.0}).fit
    moved = {one.name: one.shifts["a"] * fit.sds[0] / fit.values[0] for one in influences(fit)}
    assert moved["scale_y"] == pytest.approx(0.01, rel=0.01)
    assert moved["scale_x"] == pytest.approx(-0.01, rel=0.01)


def test_errors_of_the_abscissas_and_angles_do_not_hinder(rng: np.random.Generator) -> None:
    x = np.linspace(1.0, 5.0, 9)
    fit = fit_curve("a*x", x, 2.0 * x + 0.05 * rng.standard_normal(9), u_y=0.05, u_x=0.05, start={"a": 1.0}).fit
    assert {one.name: round(one.shifts["a"] * fit.sds[0] / fit.values[0], 3) for one in influences(fit)} == {
        "scale_y": 0.01, "scale_x": -0.01,
    }
    clean = fitted(X, true_speed(X))
    turning = replace(clean.problem.runs[0], motion=RollingMotion(True))
    assert "length" not in {e.name for e in turning.errors_in_common(turning.bind(clean.problem.named(clean.values)))}


@pytest.mark.parametrize(("moving", "pushed"), [("up and back", 0.0), ("pushed, with drag", 0.1)])
def test_a_sag_moves_positions_as_the_true_motion_says(moving: str, pushed: float) -> None:
    """Against Lagrange's equation on a bent ramp, solved by SciPy; a hump would be off by twice as much."""
    truth = replace(BASE, release_speed=pushed, viscous=0.2 * BASE.mass if pushed else 0.0)
    t = np.linspace(0.1, 1.9 if not pushed else 1.3, 30)
    straight, _ = solve(truth, 2.0)(t)
    way = float(np.max(np.abs(straight)))
    bent, _ = solve(sagging(1e-3, way, 0.0)(np.random.default_rng(1), truth), 2.0)(t)
    arguments = {name: getattr(BASE, name) for name in ("radius", "gamma", "kappa", "theta0", "phi", "rolling_resistance", "g")}
    arguments |= {**EXACT, "release_time": 0.0, "offset": 0.0}
    if pushed:
        arguments |= {"release_speed": pushed, "viscous_drag": 0.2}
    motion = DisturbedMotion(False, None, True) if pushed else RollingMotion(False, None, True)
    curve = (DisturbedMotionCurve if pushed else MotionCurve)(False)
    found = next(e for e in motion.errors_in_common(t, straight, curve.local(t, arguments), arguments, ()) if e.name == "sag").shift
    assert np.max(np.abs(found)) > 1e-3
    assert found == pytest.approx(bent - straight, abs=0.02 * np.max(np.abs(found)))
