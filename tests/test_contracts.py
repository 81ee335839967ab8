"""Each contract of the house, and every implementation of it run through the same test."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from noises import CASES, VALUES, Case, Y, line
from scipy import stats

from estim import Component, InputError
from estim.campaign import load_campaign
from estim.curves.formula import read_formula
from estim.curves.function import wrap_function
from estim.curves.rolling import MotionCurve, PhaseCurve, Place, RollingMotion, Setting
from estim.curves.systematic_errors import DistortedCurve
from estim.fitting import Fit, fit_problem
from estim.problem.count_noise import CountErrors
from estim.problem.curve import POINTS as PLAIN
from estim.problem.curve import Motion, SpeedCurve
from estim.problem.likelihood import Likelihood, reading_sd
from estim.problem.posterior import Problem
from estim.problem.roots import covariance_of
from estim.problem.whitened_residuals import Linear

X = np.linspace(0.05, 0.30, 6)
BODY = {
    "radius": 0.15,
    "gamma": 0.187,
    "kappa": 0.45,
    "rho": 1.0,
    "trailing_fraction": 0.0,
    "particle_gyration": 0.0,
    "phi": 0.07,
    "theta0": 1.05,
    "rolling_resistance": 0.002,
    "g": 9.81,
}
SETTING = Setting(0.4, Place(1.2, 0.1), Place(0.9, 0.05))
FORCES = {
    "moment": 0.002,
    "moment_once_cos": 0.004,
    "moment_once_sin": -0.003,
    "moment_twice_cos": 0.002,
    "moment_twice_sin": 0.005,
    "sag": 0.001,
}
DRAG = {"load_resistance": 0.003, "viscous_drag": 0.08, "quadratic_drag": 0.1, "phi_slope": 0.02}
READ = {"scale_x": 0.02, "scale_t": -0.01, "distortion": 0.004}
ANGLES = {name: value for name, value in READ.items() if name != "distortion"}
IN_TIME = {"release_time": -0.2, "offset": 0.003}
DECAY = {"a": 2.0, "k": 1.3}
FORMULA = read_formula("a*exp(-k*x)")


def smooth(x, a, k):
    return a * np.exp(-k * x)


def stubborn(x, a, k):
    """No dual number, no complex step and no column of draws gets through `float`."""
    return np.array([a * np.exp(-float(k) * float(v)) for v in np.ravel(x)])


CURVES = {
    "phase curve": (PhaseCurve(False), BODY),
    "phase curve, angles": (PhaseCurve(True), BODY),
    "motion in time": (MotionCurve(False), BODY | {"release_time": -0.2, "offset": 0.0}),
    "motion in time, angles": (MotionCurve(True), BODY | {"release_time": -0.2, "offset": 0.0}),
    "phase curve, pushed": (PhaseCurve(False), BODY | {"release_energy": 0.01}),
    "phase curve, late": (PhaseCurve(False), BODY | {"release_energy": -0.0005}),
    "phase curve, forces and image": (
        PhaseCurve(False, SETTING),
        BODY | FORCES | READ | {"release_speed": 0.1, "offset": 0.004},
    ),
    "phase curve, drag": (PhaseCurve(False, SETTING), BODY | FORCES | DRAG | READ),
    "phase curve, angles, forces": (
        PhaseCurve(True, SETTING),
        BODY | FORCES | ANGLES | {"release_energy": 0.01},
    ),
    "motion in time, pushed": (MotionCurve(False), BODY | IN_TIME | {"release_speed": 0.1}),
    "motion in time, scales": (MotionCurve(True), BODY | IN_TIME | ANGLES),
    "motion in time, all": (
        MotionCurve(False, SETTING),
        BODY | IN_TIME | FORCES | DRAG | READ | {"release_speed": -0.05},
    ),
    "formula": (FORMULA, DECAY),
    "function": (wrap_function(smooth, ("a", "k"), X, DECAY), DECAY),
    "function draw by draw": (wrap_function(stubborn, ("a", "k"), X, DECAY), DECAY),
    "formula with common errors": (
        DistortedCurve(FORMULA, (Component("scale_x", 0.01), Component("zero_y", 0.1))),
        DECAY | {"scale_x": 0.01, "zero_y": 0.02},
    ),
}


@pytest.mark.parametrize(("curve", "arguments"), CURVES.values(), ids=CURVES)
def test_a_curve_is_vectorised_over_draws_and_knows_its_derivatives(curve, arguments) -> None:
    varied = [
        name
        for name, value in arguments.items()
        if value and name not in ("particle_gyration", "trailing_fraction", "rho")
    ]
    factors = np.array([[1.0], [1.001], [0.998]])
    draws = {
        name: value * factors if name in varied else value for name, value in arguments.items()
    }
    together = curve.value(X, draws)
    assert together.shape == (3, X.size)
    for row, factor in zip(together, factors[:, 0], strict=True):
        single = curve.value(
            X,
            {
                name: value * factor if name in varied else value
                for name, value in arguments.items()
            },
        )
        assert single.shape == (1, X.size)
        assert single[0] == pytest.approx(row, rel=1e-9)
    local = curve.local(X, arguments)
    assert local.value.shape == local.slope.shape == (1, X.size)
    assert local.value[0] == pytest.approx(together[0], rel=1e-12)
    step = 1e-5
    slope = (curve.value(X + step, arguments) - curve.value(X - step, arguments)) / (2.0 * step)
    assert local.slope[0] == pytest.approx(slope[0], rel=1e-5, abs=1e-8)
    for name in varied:
        h = 1e-5 * abs(arguments[name])
        ends = [
            curve.value(X, arguments | {name: arguments[name] + sign * h}) for sign in (1.0, -1.0)
        ]
        expected = np.ravel(ends[0] - ends[1]) / (2.0 * h)
        found = np.ravel(np.broadcast_to(local.gradient[name], (1, X.size)))
        assert found == pytest.approx(
            expected, rel=1e-4, abs=1e-6 * float(np.max(np.abs(expected)))
        )


SPEEDS = {name: pair for name, pair in CURVES.items() if isinstance(pair[0], SpeedCurve)}


def test_only_the_phase_curve_is_a_curve_of_speeds() -> None:
    assert set(SPEEDS) == {name for name in CURVES if name.startswith("phase curve")}


@pytest.mark.parametrize(("curve", "arguments"), SPEEDS.values(), ids=SPEEDS)
def test_a_curve_of_speeds_knows_how_it_changes_along_its_own_motion(curve, arguments) -> None:
    """f'' in time along dx/dt = f(x) is f (f'^2 + f f''), with f' and f'' by differences."""
    h = 1e-4
    low, middle, high = (
        np.ravel(np.broadcast_to(curve.value(X + s, arguments), (1, X.size))) for s in (-h, 0.0, h)
    )
    first, second = (high - low) / (2.0 * h), (high - 2.0 * middle + low) / h**2
    found = np.ravel(np.broadcast_to(curve.time_derivative(X, arguments, 2), (1, X.size)))
    assert found == pytest.approx(middle * (first**2 + middle * second), rel=1e-4)


@pytest.mark.parametrize(
    "name",
    [
        "phase curve",
        "phase curve, forces and image",
        "phase curve, drag",
        "phase curve, angles, forces",
    ],
)
def test_the_fourth_time_derivative_is_the_second_of_the_second(name: str) -> None:
    """d^4 f/dt^4 = f (d/dx)(f d/dx) of d^2 f/dt^2."""
    curve, arguments = CURVES[name]
    h = 1e-3
    low, middle, high = (curve.time_derivative(X + s, arguments, 2)[0] for s in (-h, 0.0, h))
    v, slope = np.ravel(curve.value(X, arguments)), curve.local(X, arguments).slope[0]
    expected = v * (slope * (high - low) / (2.0 * h) + v * (high - 2.0 * middle + low) / h**2)
    found = np.ravel(curve.time_derivative(X, arguments, 4))
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-3 * float(np.max(np.abs(expected))))


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
    assert (
        motion.words().what
        == {(0, 0): "speeds", (1, 0): "angular rates", (0, 1): "positions", (1, 1): "angles"}[
            (angular, in_time)
        ]
    )


@pytest.mark.parametrize("angular", [False, True])
def test_a_disturbed_motion_keeps_its_energy_where_nothing_resists_and_ends_as_it_is_read(
    angular: bool,
) -> None:
    arguments = BODY | ANGLES | {"rolling_resistance": 0.0, "release_energy": 0.02, "sag": 0.002}
    motion: Motion = RollingMotion(angular, 0.4, False, SETTING, 3.0)
    x = X / (0.15 if angular else 1.0)
    v = np.ravel(PhaseCurve(angular, SETTING).value(x, arguments))
    total = np.sum([np.ravel(e) for e in motion.energies(x, v, arguments)], axis=0)
    assert total == pytest.approx(total[0], rel=1e-9)
    end = motion.end(arguments)
    assert end > x[-1]
    near = np.ravel(
        PhaseCurve(angular, SETTING).value(np.array([0.999, 1.001]) * end[0, 0], arguments)
    )
    assert near[0] > near[1] == 0.0
    draws = {name: np.full((3, 1), value) for name, value in (arguments | FORCES | DRAG).items()}
    assert motion.end(draws).shape == (3, 1)
    derived = motion.derived(draws)
    assert {
        "speed_at_release",
        "resisting_moment",
        "moment_once",
        "moment_twice_phase",
        "slope",
    } <= set(derived)
    assert derived["moment_once"].values == pytest.approx(np.full((3, 1), 0.005))
    assert derived["speed_at_release"].values == pytest.approx(
        np.sqrt(2.0 * 9.81 * 0.15 * 0.02 / inertia_at_release()), rel=0.02
    )


def inertia_at_release() -> float:
    return 1.0 + 0.45 * (1.0 - 0.187) + 0.187 + 2.0 * 0.187 * np.cos(1.05 + 0.07)


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
        (tmp_path / f"{name}.csv").write_text(
            "t,u\n" + "\n".join(f"{a},{b:.5f}" for a, b in zip(t, u, strict=True)) + "\n"
        )
    (tmp_path / "campaign.toml").write_text(OWN_CURVE)
    return load_campaign(tmp_path / "campaign.toml")


def test_a_campaign_poses_its_runs_and_knows_what_may_be_asked(
    campaign, rng: np.random.Generator
) -> None:
    names = campaign.run_names[:2]
    joint = campaign.problem(names)
    assert isinstance(joint, Problem)
    assert tuple(run.name for run in joint.runs) == names
    for run in joint.runs:
        assert run.parameters <= set(joint.names)
        assert (
            (run.motion is None)
            == (campaign.body_of(run.name) is None)
            == (run.words.what == PLAIN.what)
        )
        alone = campaign.problem([run.name])
        assert joint.restricted([run]).n_par == alone.n_par
    problem = campaign.problem(names[:1])
    fit = fit_problem(problem, rng=rng)
    assert isinstance(fit, Fit)
    assert fit.success
    campaign.check(names[0])
    campaign.require_draws(problem, of_priors=True)
    assert campaign._path_of_unknowns(names[0])[0] in ("runs", "curve")
    if campaign.formula is None:
        campaign.require_body()
        campaign.require_speeds(names, "a command")
        campaign.require_complete(names, "a command")
        models = campaign.noise_models(names[0])
        assert len(models) > 1
        assert campaign.problem(names[:1], noise=models[0].table).n_obs > 0
    else:
        refused = (
            campaign.require_body,
            lambda: campaign.require_speeds(names, "a command"),
            lambda: campaign.require_complete(names, "a command"),
            lambda: campaign.noise_models(names[0]),
        )
        for ask in refused:
            with pytest.raises(InputError, match=r"campaign\.toml:\d+: 'curve'"):
                ask()


STEP = 1e-5


def column(*rows: dict[str, float]) -> dict[str, np.ndarray]:
    return {name: np.array([[row[name]] for row in rows]) for name in rows[0]}


def derivative(value, named: dict[str, float], name: str) -> np.ndarray:
    """Of value(named) in a parameter, by a central difference."""
    low, high = (value(column(named | {name: named[name] + sign * STEP})) for sign in (-1.0, 1.0))
    return (np.asarray(high) - np.asarray(low)) / (2.0 * STEP)


def check_of_draws(case: Case, noise: Likelihood) -> None:
    """The densities are those of brute force, at every draw; one draw gives the same as many."""
    rows = [
        {name: value * factor for name, value in case.here.items()} for factor in (1.0, 1.02, 0.97)
    ]
    every = column(*rows)
    assert noise.log_likelihood(every) == pytest.approx(
        [case.brute.log_density(case.y, row) for row in rows], abs=case.within
    )
    for row, parts in zip(rows, noise.pointwise(every), strict=True):
        assert parts == pytest.approx(case.conditional.pointwise(case.y, row), abs=case.within)
    for ask in (
        noise.log_likelihood,
        noise.pointwise,
        noise.standardised,
        noise.residuals,
        noise.size_residuals,
        noise.outlier_probability,
    ):
        for row, together in zip(rows, ask(every), strict=True):
            assert ask(column(row))[0] == pytest.approx(together, rel=1e-9)
    told = case.outliers and case.told_apart
    assert np.any(noise.outlier_probability(every) > 0.0) == told


def check_steps(case: Case, noise: Likelihood) -> None:
    """Residuals, their derivatives and the steps that they make fit together with the densities."""
    here, names = case.here, tuple(case.here)
    height = (
        noise.log_likelihood
        if case.single is None
        else lambda named: np.sum(noise.pointwise(named), axis=1)
    )
    both = column(here, here | {"a": here["a"] + 0.1, "b": here["b"] - 0.07})
    assert np.diff(np.sum(noise.residuals(both) ** 2, axis=1)) == pytest.approx(
        -2.0 * np.diff(height(both)), rel=1e-8
    )
    rows, aim = noise.scoring(here, names)
    for i, name in enumerate(names):
        if name not in VALUES:
            assert not np.any(rows[:, i])
            continue
        if not noise.creeps:
            numeric = derivative(noise.residuals, here, name)[0]
            assert rows[:, i] == pytest.approx(
                numeric, rel=1e-5, abs=1e-6 * float(np.max(np.abs(numeric)))
            )
        assert -rows[:, i] @ aim == pytest.approx(derivative(height, here, name)[0], rel=1e-5)
    root, curve = noise.information_root(here, names), np.ix_([0, 1], [0, 1])
    assert (root.T @ root)[curve] == pytest.approx(
        noise.information(here, names, {})[curve], rel=1e-6
    )
    whitened = noise.whitened(here, names)
    assert whitened.z == pytest.approx(case.conditional.scores(case.y, here), abs=case.within)
    assert whitened.root.shape[1] == len(names)


def check_size(case: Case, noise: Likelihood) -> None:
    """Information and size of the errors, against a covariance or densities by brute force."""
    here, names = case.here, tuple(case.here)
    ends = {
        n: (here | {n: here[n] - STEP}, here | {n: here[n] + STEP}, 2.0 * STEP)
        for n in case.noise.parameters
    }
    information = noise.information(here, names, ends)
    assert information == pytest.approx(information.T, rel=1e-9)
    assert (noise.normal is None) == (
        case.outliers
        or case.mixed
        or case.unlike
        or case.of_curve
        or case.lopsided
        or case.single is not None
    )
    if noise.normal is None:
        if case.single is None:
            assert np.diag(information) == pytest.approx(case.brute.information(here), rel=0.05)
        return
    cov, brute = covariance_of(noise.normal.root(here)), case.brute
    assert cov == pytest.approx(brute.cov(here), rel=1e-9, abs=1e-15)
    assert noise.sd(here) ** 2 == pytest.approx(np.diag(cov), rel=1e-9)
    assert noise.squared_size(Y, here) == pytest.approx(Y @ np.linalg.solve(cov, Y), rel=1e-9)
    assert Y - noise.y == pytest.approx(brute.mean(here) - line(here), abs=1e-12)
    assert information == pytest.approx(brute.information(here, names), rel=1e-5, abs=1e-5)
    draws = column(here, {name: 1.01 * value for name, value in here.items()})
    z, logs = noise.normal.residuals(draws), noise.normal.log_variances(draws)
    assert np.diff(-0.5 * np.sum(z**2 + logs, axis=1)) == pytest.approx(
        np.diff(noise.log_likelihood(draws)), rel=1e-9
    )


def check_noise(case: Case, noise: Likelihood) -> None:
    check_of_draws(case, noise)
    check_steps(case, noise)
    check_size(case, noise)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_noise_says_of_draws_and_at_a_point_what_brute_force_says(case: Case) -> None:
    likelihood = case.noise.likelihood(case.points, VALUES)
    check_noise(case, likelihood)
    afar = case.noise.for_search()
    assert not afar.likelihood(case.points, VALUES).creeps
    assert (afar is case.noise) == (not likelihood.creeps)
    assert set(case.noise.parameters) == set(case.values)
    assert set(case.noise.outlier_parameters) <= set(case.noise.parameters)
    assert case.noise.robust == case.outliers
    assert case.noise.outlier_share(case.here) == pytest.approx(
        case.here.get("fraction", np.nan), nan_ok=True
    )
    assert case.noise.describe(x_unit="m", y_unit="m/s", words=PLAIN)


@pytest.mark.parametrize(
    "name",
    [
        name
        for name, case in CASES.items()
        if case.single is None and not case.mixed and not case.unlike and not case.of_curve
    ],
)
def test_noise_reads_what_its_likelihood_expects(name: str, rng: np.random.Generator) -> None:
    case, here, ones = CASES[name], CASES[name].here, np.ones(Y.size)
    if not case.outliers:
        cov, variance = case.noise.carried(-VALUES["b"] * ones, ones, here)
        assert cov == pytest.approx(case.brute.cov(here), rel=1e-9, abs=1e-15)
        assert np.all(variance > 0.0)
    gain = case.noise.reading_gain()
    assert reading_sd(case.noise, here) == pytest.approx(
        np.sqrt(case.noise.size.reading_variance(here)) * gain
    )
    if not (case.noise.made_of_positions or case.noise.size.step):
        scores = np.array(
            [
                case.brute.scores(case.noise.read(line(here), gain, here, rng), here)
                for _ in range(200)
            ]
        )
        assert stats.kstest(scores.ravel(), "norm").pvalue > 1e-3
        assert stats.kstest(1.4 * scores.ravel(), "norm").pvalue < 1e-3


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.unlike])
def test_counts_scatter_as_their_law_says(name: str, rng: np.random.Generator) -> None:
    case = CASES[name]
    mean = np.ravel(case.points.value(case.here))
    drawn = np.array(
        [case.noise.read(mean, case.noise.reading_gain(), case.here, rng) for _ in range(4000)]
    )
    sd = case.noise.likelihood(case.points, VALUES).sd(case.here)
    assert np.abs(drawn.mean(axis=0) - mean) == pytest.approx(
        0.0, abs=4.0 * np.max(sd) / np.sqrt(4000.0)
    )
    assert drawn.var(axis=0) == pytest.approx(sd**2, rel=0.15)
    assert sd**2 == pytest.approx(
        case.brute.law(case.brute.mean(case.here)).var() / case.brute.trials**2
    )


def without_the_norm(self, named):
    return -0.5 * np.sum(self.residuals(named) ** 2, axis=1)


def without_neighbours(self, named):
    return stats.norm(
        0.0, self.sd({name: np.ravel(value)[0] for name, value in named.items()})
    ).logpdf(self.y - self.points.value(named))


def of_the_first_draw(self, named):
    return type(self).__base__.pointwise(
        self, {name: np.broadcast_to(value[:1], value.shape) for name, value in named.items()}
    )


def too_steep(self, named, names):
    rows, aim = type(self).__base__.scoring(self, named, names)
    return 1.01 * rows, aim


def too_sure(self, named, names, ends):
    return 1.3 * type(self).__base__.information(self, named, names, ends)


def out_of_order(self, named, names):
    return Linear(self.standardised(column(named))[0], self.information_root(named, names))


WRONG = [
    ("independent", "log_likelihood", without_the_norm),
    ("differentiated", "log_likelihood", without_the_norm),
    ("errors of x", "log_likelihood", lambda self, named: np.sum(self.pointwise(named), axis=1)),
    ("differentiated", "pointwise", without_neighbours),
    ("stated covariance", "pointwise", without_neighbours),
    ("independent, mixture", "pointwise", of_the_first_draw),
    ("errors of x, mixture", "pointwise", of_the_first_draw),
    ("independent, Student-t", "scoring", too_steep),
    ("errors of x", "scoring", too_steep),
    ("positions", "information", too_sure),
    ("unmodelled force", "log_likelihood", without_the_norm),
    ("unmodelled force", "pointwise", without_neighbours),
    ("unmodelled force", "scoring", too_steep),
    ("unmodelled force", "information", too_sure),
    ("Poisson counts", "log_likelihood", without_the_norm),
    ("event times", "pointwise", lambda self, named: CountErrors.pointwise(self, named)),
    ("Poisson counts", "scoring", too_steep),
    ("event times", "scoring", too_steep),
    ("binomial fractions", "information", too_sure),
    ("independent, Student-t", "information", too_sure),
    ("differentiated", "whitened", out_of_order),
    ("another error above than below", "log_likelihood", without_the_norm),
    ("another error above than below", "scoring", too_steep),
    ("another error above than below", "information", too_sure),
    ("another error above than below", "whitened", out_of_order),
]


@pytest.mark.parametrize(
    ("name", "member", "wrong"), WRONG, ids=[f"{name}: {member}" for name, member, _ in WRONG]
)
def test_wrong_noise_breaks_the_contract(name: str, member: str, wrong) -> None:
    case = CASES[name]
    right = case.noise.likelihood(case.points, VALUES)
    broken = type("Broken", (type(right),), {member: wrong})(
        **{field.name: getattr(right, field.name) for field in fields(right)}
    )
    with pytest.raises(AssertionError):
        check_noise(case, broken)
