"""Each contract of the house, and every implementation of it run through the same test."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estim import Component, InputError
from estim.campaign import load_campaign
from estim.curves.formula import read_formula
from estim.curves.function import wrap_function
from estim.curves.rolling import MotionCurve, PhaseCurve, RollingMotion
from estim.curves.shared_errors import DistortedCurve
from estim.fitting.least_squares import Fit
from estim.problem.curve import POINTS, Motion, SpeedCurve
from estim.problem.problem import Problem

X = np.linspace(0.05, 0.30, 6)
BODY = {
    "radius": 0.15, "gamma": 0.187, "kappa": 0.45, "rho": 1.0, "trailing_fraction": 0.0, "particle_gyration": 0.0, "phi": 0.07, "theta0": 1.05,
    "rolling_resistance": 0.002, "g": 9.81,
}
DECAY = {"a": 2.0, "k": 1.3}
FORMULA = read_formula("a*exp(-k*x)")


def smooth(x, a, k):
    return a * np.exp(-k * x)


def stubborn(x, a, k):
    """No dual number, no complex step and no column of draws gets through `float`."""
    return np.array([a * np.exp(-float(k) * float(v)) for v in np.ravel(x)])


CURVES = {
    "phase curve": (PhaseCurve(False), BODY), "phase curve, angles": (PhaseCurve(True), BODY),
    "motion in time": (MotionCurve(False), BODY | {"release_time": -0.2, "offset": 0.0}),
    "motion in time, angles": (MotionCurve(True), BODY | {"release_time": -0.2, "offset": 0.0}),
    "formula": (FORMULA, DECAY), "function": (wrap_function(smooth, ("a", "k"), X, DECAY), DECAY),
    "function draw by draw": (wrap_function(stubborn, ("a", "k"), X, DECAY), DECAY),
    "formula with common errors": (
        DistortedCurve(FORMULA, (Component("scale_x", 0.01), Component("zero_y", 0.1))), DECAY | {"scale_x": 0.01, "zero_y": 0.02},
    ),
}


@pytest.mark.parametrize(("curve", "arguments"), CURVES.values(), ids=CURVES)
def test_a_curve_is_vectorised_over_draws_and_knows_its_derivatives(curve, arguments) -> None:
    varied = [name for name, value in arguments.items() if value and name not in ("particle_gyration", "trailing_fraction", "rho")]
    factors = np.array([[1.0], [1.001], [0.998]])
    draws = {name: value * factors if name in varied else value for name, value in arguments.items()}
    together = np.broadcast_to(curve.value(X, draws), (3, X.size))
    for row, factor in zip(together, factors[:, 0], strict=True):
        single = curve.value(X, {name: value * factor if name in varied else value for name, value in arguments.items()})
        assert np.broadcast_to(single, (1, X.size))[0] == pytest.approx(row, rel=1e-9)
    local = curve.local(X, arguments)
    assert np.broadcast_to(local.value, (1, X.size))[0] == pytest.approx(together[0], rel=1e-12)
    step = 1e-5
    slope = (curve.value(X + step, arguments) - curve.value(X - step, arguments)) / (2.0 * step)
    assert np.ravel(np.broadcast_to(local.slope, (1, X.size))) == pytest.approx(np.ravel(slope), rel=1e-5, abs=1e-8)
    for name in varied:
        h = 1e-5 * abs(arguments[name])
        ends = [curve.value(X, arguments | {name: arguments[name] + sign * h}) for sign in (1.0, -1.0)]
        expected = np.ravel(ends[0] - ends[1]) / (2.0 * h)
        found = np.ravel(np.broadcast_to(local.gradient[name], (1, X.size)))
        assert found == pytest.approx(expected, rel=1e-4, abs=1e-6 * float(np.max(np.abs(expected))))


SPEEDS = {name: pair for name, pair in CURVES.items() if isinstance(pair[0], SpeedCurve) and name != "function draw by draw"}


def test_positions_in_time_and_distorted_curves_are_no_curves_of_speeds() -> None:
    assert set(SPEEDS) == {"phase curve", "phase curve, angles", "formula", "function"}


@pytest.mark.parametrize(("curve", "arguments"), SPEEDS.values(), ids=SPEEDS)
def test_a_curve_of_speeds_knows_how_it_changes_along_its_own_motion(curve, arguments) -> None:
    """f'' in time along dx/dt = f(x) is f (f'^2 + f f''), with f' and f'' by differences."""
    h = 1e-4
    low, middle, high = (np.ravel(np.broadcast_to(curve.value(X + s, arguments), (1, X.size))) for s in (-h, 0.0, h))
    first, second = (high - low) / (2.0 * h), (high - 2.0 * middle + low) / h**2
    found = np.ravel(np.broadcast_to(curve.time_derivative(X, arguments, 2), (1, X.size)))
    assert found == pytest.approx(middle * (first**2 + middle * second), rel=1e-4)


@pytest.mark.parametrize("in_time", [False, True])
@pytest.mark.parametrize("angular", [False, True])
def test_a_motion_has_an_end_energies_and_words(angular: bool, in_time: bool) -> None:
    motion: Motion = RollingMotion(angular, 0.3, in_time)
    x = X / (0.15 if angular else 1.0)
    v = np.ravel(PhaseCurve(angular).value(x, BODY))
    kinetic = np.ravel(motion.energies(x, v, BODY)[0])
    assert np.all(kinetic > 0.0)
    if not in_time:
        assert float(motion.end(BODY)[0, 0]) > x[-1]
    else:
        assert np.isinf(motion.end(BODY)[0, 0])
    frictionless = BODY | {"rolling_resistance": 0.0}
    v = np.ravel(PhaseCurve(angular).value(x, frictionless))
    total = np.sum([np.ravel(e) for e in motion.energies(x, v, frictionless)], axis=0)
    assert total == pytest.approx(total[0], rel=1e-9)
    assert ("turning_point" in motion.derived(BODY)) == in_time
    assert {"inertia_ratio", "slope", "resisting_moment"} <= set(motion.derived(BODY))
    assert motion.words().what == {(0, 0): "speeds", (1, 0): "angular rates", (0, 1): "positions", (1, 1): "angles"}[(angular, in_time)]


OWN_CURVE = """
title = "decay"
kind = "synthetic"
[curve]
expression = "a*exp(-k*x)"
x = "t"
y = "u"
u_y = 0.02
[curve.parameters]
a = {start = 1.0, low = 0.0, high = 10.0}
k = {start = 1.0, low = 0.0, high = 10.0}
[[runs]]
name = "one"
file = "one.csv"
[[runs]]
name = "two"
file = "two.csv"
"""


@pytest.fixture(params=["rolling body", "own curve"])
def campaign(request, tmp_path: Path, replica: Path, rng: np.random.Generator):
    if request.param == "rolling body":
        return load_campaign(replica / "campaign.toml")
    t = np.linspace(0.0, 2.0, 12)
    for name in ("one", "two"):
        u = smooth(t, 2.0, 1.3) + 0.02 * rng.standard_normal(t.size)
        (tmp_path / f"{name}.csv").write_text("t,u\n" + "\n".join(f"{a},{b:.5f}" for a, b in zip(t, u, strict=True)) + "\n")
    (tmp_path / "campaign.toml").write_text(OWN_CURVE)
    return load_campaign(tmp_path / "campaign.toml")


def test_a_study_poses_and_fits_its_runs_and_knows_what_may_be_asked(campaign, rng: np.random.Generator) -> None:
    study, names = campaign.study, campaign.run_names[:2]
    joint = study.problem(names, campaign.tables)
    assert isinstance(joint, Problem)
    assert tuple(run.name for run in joint.runs) == names
    for run in joint.runs:
        assert run.parameters <= set(joint.names)
        assert (run.motion is None) == (study.body_of(run.name) is None) == (run.words.what == POINTS.what)
        alone = study.problem([run.name], campaign.tables)
        assert joint.restricted([run]).n_par == alone.n_par
    problem = study.problem(names[:1], campaign.tables)
    fit = study.fit(problem, campaign.tables, rng=rng)
    assert isinstance(fit, Fit)
    assert fit.success
    study.check(names[0], campaign.tables)
    study.require_draws(problem)
    assert study.place_of_unknowns(names[0])[0] in ("runs", "curve")
    if study.formula is None:
        study.require_body()
        study.require_speeds(names, "a command")
        models = study.noise_models(names[0], campaign.tables[names[0]])
        assert len(models) > 1
        assert study.problem(names[:1], campaign.tables, noise=models[0].table).n_obs > 0
    else:
        refused = (
            study.require_body, lambda: study.require_speeds(names, "a command"), lambda: study.noise_models(names[0], campaign.tables[names[0]]),
        )
        for ask in refused:
            with pytest.raises(InputError, match=r"campaign\.toml:\d+: 'curve'"):
                ask()
