"""Errors of x: the likelihood against brute force, the fits that used to fail, and what intervals
cover.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from posed import curve_problem
from scipy import stats
from scipy.optimize import minimize

from estim import Component
from estim.calibration.experiment import PointDesign
from estim.checks.goodness_of_fit import check_goodness
from estim.common.errors import InputError
from estim.curve_fitting.single import fit_curve
from estim.fitting.fisher_information import information
from estim.fitting.least_squares import fit_least_squares
from estim.problem.curve import POINTS
from estim.problem.errors_in_x_quadrature import predictive, true_abscissas
from estim.problem.posterior import Problem
from estim.problem.roots import covariance_of
from estim.problem.tails import GAUSSIAN, OutlierMixture

ROOT = Path(__file__).resolve().parents[1]


def posed(
    formula: str, x: np.ndarray, y: np.ndarray, start: dict[str, float], u_y: float, u_x: float
) -> Problem:
    return curve_problem(formula, x, y, start=start, u_y=u_y, u_x=u_x).with_sigma(1.0)


def brute_force(y: float, f, *, sd: float = 1.0) -> float:
    """log of int N(y; f(z), sd^2) N(z; 0, 1) dz on 40000 points."""
    z = np.linspace(-8.0, 8.0, 40_001)
    return float(
        np.log(
            np.trapezoid(np.exp(-0.5 * ((y - f(z)) / sd) ** 2 - 0.5 * z**2), z) / (2.0 * np.pi * sd)
        )
    )


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0, 10.0])
@pytest.mark.parametrize(("bend", "within"), [(0.0, 1e-3), (0.1, 2e-3), (0.3, 0.01)])
def test_the_sum_over_components_is_the_integral(
    ratio: float, bend: float, within: float, rng: np.random.Generator
) -> None:
    def curve(z):
        # `bend`: relative change of the slope over one standard deviation of x
        return ratio * (z + 0.5 * bend * z**2)

    nodes = true_abscissas(np.zeros(1), np.ones((1, 1))).nodes
    for z in rng.standard_normal(15):
        y = float(curve(z) + rng.standard_normal())
        ours = predictive(curve(nodes), np.ones((1, 1))).log_density(np.array([y]), GAUSSIAN, {})
        assert ours[0, 0] == pytest.approx(brute_force(y, curve), abs=within)


def test_a_wild_curve_is_a_density_that_is_spread_not_hit() -> None:
    """However fast it oscillates: the density of y integrates to one, and nowhere exceeds what a
    spread over the range allows by much.
    """
    y = np.linspace(-15.0, 15.0, 15_001)
    nodes = true_abscissas(np.zeros(1), np.ones((1, 1))).nodes
    for w in (1.0, 7.3, 78.0, 1e4):
        density = np.exp(
            predictive(2.0 * np.sin(w * nodes + 0.4), np.full((1, 1), 0.01)).log_density(
                y[:, None], GAUSSIAN, {}
            )
        ).ravel()
        assert np.trapezoid(density, y) == pytest.approx(1.0, abs=1e-6)
        if w > 5.0:  # the range is 4; a curve through the point has 4.0
            assert np.max(density) < 1.2


def test_where_the_curve_is_not_defined_no_true_abscissa_lies() -> None:
    x, u_x = np.array([0.02, 0.5, 1.0, 1.5]), 0.05
    problem = posed("a*sqrt(x)", x, np.sqrt(x), {"a": 1.0}, 0.1, u_x)
    (parts,) = problem.linearised(np.ones(1)).pointwise(np.ones((1, 1)))
    assert np.all(np.isfinite(parts))
    values = np.array([1.0, 1.1])
    ours = problem.linearised(np.ones(1)).jacobian(values[:1])[0, 0]
    high, low = (
        problem.linearised(np.ones(1)).residuals(np.array([1.0 + h]))[0] for h in (1e-6, -1e-6)
    )
    assert ours == pytest.approx((high - low) / 2e-6, rel=1e-5)


@pytest.mark.parametrize("huge", [1e155, 1e200, 1e308, np.inf, np.nan])
def test_a_curve_that_overflows_loses_and_gives_no_nan(huge: float) -> None:
    """Warnings are errors here; inf - inf between two nodes made the density not a number."""
    nodes = true_abscissas(np.zeros(1), np.ones((1, 1))).nodes
    here = np.where(nodes > 1.0, huge * np.where(np.arange(nodes.size) % 2, 1.0, -1.0), nodes)
    density = predictive(here, np.ones((1, 1))).log_density(np.zeros(1), GAUSSIAN, {})
    assert density[0, 0] == pytest.approx(
        predictive(nodes, np.ones((1, 1))).log_density(np.zeros(1), GAUSSIAN, {})[0, 0], abs=0.5
    )
    lost = predictive(0.1 * huge * (1.0 + nodes), np.ones((1, 1))).log_density(
        np.zeros(1), GAUSSIAN, {}
    )
    assert lost[0, 0] == -np.inf or lost[0, 0] < -300.0


@pytest.fixture
def line(rng: np.random.Generator) -> Problem:
    true = rng.uniform(0.0, 1.0, 12)
    x, y = true + 0.08 * rng.standard_normal(12), 1.0 + 2.0 * true + 0.05 * rng.standard_normal(12)
    return posed("a + b*x", x, y, {"a": 1.0, "b": 2.0}, 0.05, 0.08)


def test_a_line_has_the_density_of_correlated_normal_errors(line: Problem) -> None:
    """Its true abscissas N(m, v), their mean and ln(variance) uncertain: y is normal, with a
    covariance that can be written down.
    """
    x, y, u_x, (a, b) = line.runs[0].x, line.runs[0].y, 0.08, (0.95, 2.1)
    n, variance = x.size, np.var(x, ddof=1)
    share = u_x**2 / variance
    expected = a + b * (x - share * (x - x.mean()))
    of_mean = b * share * np.sqrt(variance / n) * np.ones(n)
    of_variance = (
        b
        * share
        * (1.0 - share)
        * (x - x.mean())
        * np.sqrt(2.0 / (n - 1))
        * variance
        / (variance - u_x**2)
    )
    cov = (
        (0.05**2 + b**2 * u_x**2 * (1.0 - share)) * np.eye(n)
        + np.outer(of_mean, of_mean)
        + np.outer(of_variance, of_variance)
    )
    exact = (
        -0.5 * (y - expected) @ np.linalg.solve(cov, y - expected)
        - 0.5 * np.linalg.slogdet(2.0 * np.pi * cov)[1]
    )
    values = np.array([[a, b]])
    posterior = line.linearised(values[0])
    # (what the variance of the true abscissas does to v is left out on both sides but for second
    # order)
    assert posterior.log_likelihood(values)[0] == pytest.approx(exact, abs=1e-3)
    assert abs(np.sum(posterior.pointwise(values)[0]) - exact) > 0.01
    # far off, where the nodes end, a point loses more than it should; never does the common
    # displacement make a misfit worth while
    for far in ([a - 3.0, b + 2.0], [a, 10.0 * b], [a + 5.0, -b], [a - 40.0, 40.0 * b]):
        off = y - far[0] - far[1] * (x - share * (x - x.mean()))
        tilt = cov - 0.05**2 * np.eye(n)
        wide = 0.05**2 * np.eye(n) + tilt * (far[1] / b) ** 2
        bound = (
            -0.5 * off @ np.linalg.solve(wide, off) - 0.5 * np.linalg.slogdet(2.0 * np.pi * wide)[1]
        )
        assert posterior.log_likelihood(np.array([far]))[0] < bound + 1e-3


@pytest.mark.parametrize("formula", ["a + b*x", "a*exp(b*x)", "a*sin(b*x)"])
def test_derivatives_are_those_of_the_density(formula: str, line: Problem) -> None:
    run, values, h = line.runs[0], np.array([1.05, 1.4]), 1e-6
    problem = posed(formula, run.x, run.y, {"a": 1.0, "b": 2.0}, 0.05, 0.08)
    posterior = problem.linearised(values)
    numeric = [
        (posterior.residuals(values + h * e) - posterior.residuals(values - h * e)) / (2.0 * h)
        for e in np.eye(2)
    ]
    np.testing.assert_allclose(
        posterior.jacobian(values), np.transpose(numeric), atol=1e-6 * np.max(np.abs(numeric))
    )
    ((jacobian, residual),) = posterior.narrow_scoring(values)
    heights = [
        posterior.pointwise(values + h * np.array([e, -e]))[0].sum(axis=1) for e in np.eye(2)
    ]
    np.testing.assert_allclose(
        -jacobian.T @ residual, [(high - low) / (2.0 * h) for high, low in heights], rtol=1e-5
    )


def test_the_information_is_the_mean_square_of_the_score(
    line: Problem, rng: np.random.Generator
) -> None:
    run, values, n = line.runs[0], np.array([1.05, 1.4]), 20_000
    problem = posed("a*exp(b*x)", run.x, run.y, {"a": 1.0, "b": 2.0}, 0.05, 0.08)
    named = problem.named(values)
    latent = problem.runs[0].likelihood(named)
    (part,) = (latent._predictive(named),)
    weight = np.exp(part.log_weight[0])
    chosen = np.array([rng.choice(row.size, n, p=row / row.sum()) for row in weight])
    mean, variance = (
        np.take_along_axis(array[0], chosen, 1) for array in (part.mean, part.variance)
    )
    scores = latent._scores(
        mean + np.sqrt(variance) * rng.standard_normal(mean.shape), named, problem.names, {}
    )
    full = np.einsum("inp,inq->pq", scores, scores) / n
    expected = full[:2, :2] - full[:2, 2:] @ np.linalg.solve(full[2:, 2:] + np.eye(2), full[2:, :2])
    np.testing.assert_allclose(latent.information(named, problem.names, {}), expected, rtol=0.03)
    np.testing.assert_allclose(
        information(problem.linearised(values), values),
        latent.information(named, problem.names, {}),
        rtol=1e-9,
    )


def data(f, x: np.ndarray, u_x: float, u_y: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return x + u_x * rng.standard_normal(x.size), f(x) + u_y * rng.standard_normal(x.size)


@pytest.mark.parametrize("u_x", [0.05, 0.001])
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.statistics) for seed in (1, 2))]
)
def test_exponentials_and_powers_are_fit(u_x: float, seed: int) -> None:
    x = np.linspace(0.1, 2.0, 20)
    cases = [
        ("a*exp(b*x)", lambda x: 2.0 * np.exp(0.8 * x), {"a": 2.0, "b": 0.8}, {"a": 1.0, "b": 1.0}),
        (
            "a*x**b + c",
            lambda x: 2.0 * x**1.5 + 1.0,
            {"a": 2.0, "b": 1.5, "c": 1.0},
            {"a": 1.0, "b": 1.0, "c": 0.0},
        ),
    ]
    for formula, f, truth, start in cases:
        fit = fit_curve(formula, *data(f, x, u_x, 0.1, seed), start=start, u_y=0.1, u_x=u_x)
        assert fit.status == "ok", str(fit)
        assert all(
            abs(fit.values[name] - true) < 4.0 * fit.sds[name] < 1.0 for name, true in truth.items()
        ), str(fit)


@pytest.mark.parametrize("seed", range(2))
def test_ever_steeper_curves_are_not_rewarded(seed: int) -> None:
    x, y = data(lambda x: 2.0 * np.sin(1.5 * x), np.linspace(0.0, 6.0, 40), 0.05, 0.1, seed)
    fit = fit_curve(
        "A*sin(w*x)",
        x,
        y,
        start={"A": 1.0, "w": 1.2},
        u_y=0.1,
        u_x=0.05,
        bounds={"w": (0.0, 100.0)},
    )
    assert fit.status == "ok", str(fit)
    assert abs(fit.values["w"] - 1.5) < 4.0 * fit.sds["w"] < 0.1
    steep = [
        np.array([amplitude, w]) for amplitude in (2.0, 8.0, 200.0) for w in (67.2, 78.55, 78.7)
    ]
    heights = fit.fit.posterior.log_density(np.vstack([fit.fit.values, *steep]))
    assert np.max(heights[1:]) < heights[0] - 50.0
    slopes = np.array([amplitude * w * np.cos(w * x) for amplitude, w in steep])
    chi2 = np.sum(
        (y - [amplitude * np.sin(w * x) for amplitude, w in steep]) ** 2
        / (0.01 + 0.0025 * slopes**2),
        axis=1,
    )
    # the sum of squares over u_y^2 + f'^2 u_x^2 would have preferred them
    assert np.min(chi2) < fit.chi2


def test_a_search_that_ends_without_derivatives_says_so() -> None:
    x = np.arange(11.0)
    with pytest.raises(InputError, match="no finite derivatives"):
        fit_curve(
            "sqrt(abs(x - a))", x, np.sqrt(np.abs(x - 5.0)), start={"a": 5.0}, u_y=0.1, n_start=1
        )


def test_errors_of_x_as_large_as_the_spread_of_x_are_refused() -> None:
    x = np.linspace(0.0, 1.0, 9)
    with pytest.raises(
        InputError, match=r"'u_x' must be below the standard deviation of x, 0\.3423"
    ):
        fit_curve("a + b*x", x, x, start={"a": 0.0, "b": 1.0}, u_y=0.1, u_x=0.4)


def test_simulated_true_abscissas_are_as_spread_as_the_fitted_distribution(
    rng: np.random.Generator,
) -> None:
    x = rng.normal(0.0, 1.0, 400)
    problem = posed("a + b*x", x, x, {"a": 0.0, "b": 1.0}, 1e-6, 0.6)
    simulated = PointDesign(problem).simulate(np.array([0.0, 1.0]), problem.parameters, rng).runs[0]
    # y is the true abscissa here; errors added to the readings themselves would give 1 and 1.36
    assert np.var(simulated.y) == pytest.approx(
        np.var(x) - 0.36, abs=4.0 * 0.64 * np.sqrt(2.0 / 400)
    )
    assert np.var(simulated.x) == pytest.approx(np.var(x), abs=4.0 * np.sqrt(2.0 / 400))


def test_an_outlier_is_named_where_x_has_errors(rng: np.random.Generator) -> None:
    from dataclasses import replace

    true = np.linspace(0.0, 1.0, 30)
    x, y = true + 0.03 * rng.standard_normal(30), 1.0 + 2.0 * true + 0.05 * rng.standard_normal(30)
    y[11] += 2.0
    problem = posed("a + b*x", x, y, {"a": 1.0, "b": 2.0}, 0.05, 0.03)
    run = replace(
        problem.runs[0],
        noise=replace(problem.runs[0].noise, tails=OutlierMixture("fraction", "log_width")),
    )
    named = {"a": 1.0, "b": 2.0, "fraction": 0.05, "log_width": np.log(10.0)}
    (probability,) = run.likelihood(named).outlier_probability(named)
    assert set(np.flatnonzero(probability > 0.5)) == {int(np.argmax(run.y - 2.0 * run.x))}


def benchmark():
    spec = importlib.util.spec_from_file_location(
        "errors_in_x", ROOT / "benchmarks" / "errors_in_x.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["errors_in_x"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.statistics
@pytest.mark.parametrize("curve", ["line", "exponential", "power", "sine"])
def test_intervals_cover_where_x_has_errors(curve: str) -> None:
    study, n = benchmark(), 60
    case = study.CASES[curve]
    for ratio in (0.3, 3.0):
        errors, sds = np.empty(n), np.empty(n)
        for k in range(n):
            rng = np.random.default_rng([11, 8, round(10 * ratio), k])
            data = study.simulate(case, n_obs=8, ratio=ratio, share=case.share, rng=rng)
            value, sds[k], _ = study.marginal(case, data)
            errors[k] = value - case.truth[case.watched]
        coverage = study.held(errors, sds)
        for p in (0.68, 0.95):
            error = np.sqrt(p * (1.0 - p) / n)
            assert abs(coverage[p] - p) < 3.0 * error + 0.02, (ratio, coverage)


@pytest.mark.statistics
def test_the_naive_density_does_not_cover() -> None:
    study = benchmark()
    found = study.study(study.CASES["line"], n_obs=40, ratio=3.0, share=0.1, repeats=80, seed=12)
    error = np.sqrt(0.68 * 0.32 / 80)
    assert abs(found.coverage["fit"][0.68] - 0.68) < 3.0 * error
    assert found.coverage["naive"][0.68] < 0.68 - 6.0 * error
    assert found.bias["naive"] < -1.0


@pytest.mark.statistics
def test_p_values_are_even_where_x_has_errors(rng: np.random.Generator) -> None:
    """Of the simulated chi^2 test, for a curved model; with errors of x taken as half their size it
    fails.
    """
    study = benchmark()
    case = study.CASES["exponential"]
    ps: dict[float, list[float]] = {1.0: [], 0.5: []}
    for k in range(30):
        points = study.simulate(
            case, n_obs=8, ratio=3.0, share=0.05, rng=np.random.default_rng([5, k])
        )
        for factor, found in ps.items():
            problem = posed(
                case.formula, points.x, points.y, dict(case.truth), points.u_y, factor * points.u_x
            )
            fit = fit_least_squares(problem, rng=rng, n_start=1)
            found.append(
                check_goodness(fit, rng=np.random.default_rng(k))[0].checks["chi2"].p_value
            )
    from scipy.stats import kstest

    assert kstest(ps[1.0], "uniform").pvalue > 0.01
    assert kstest(ps[0.5], "uniform").pvalue < 1e-4


def test_the_simulated_null_of_the_residuals_holds_for_a_line(
    line: Problem, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For small errors of x the normal scores are plain residuals: both forms of the null
    distribution must agree.
    """
    monkeypatch.setattr("estim.checks.goodness_of_fit._ENOUGH", 20_000)
    monkeypatch.setattr("estim.checks.goodness_of_fit._FEWER", 20_000)
    run = line.runs[0]
    small = posed("a + b*x", run.x, run.y, {"a": 1.0, "b": 2.0}, 0.1, 1e-6)
    fit = fit_least_squares(small, rng=rng, n_start=1)
    exact = fit_curve("a + b*x", run.x, run.y, start={"a": 1.0, "b": 2.0}, u_y=0.1)
    (ours,), (theirs,) = (
        check_goodness(fit, rng=np.random.default_rng(1)),
        check_goodness(exact.fit, rng=np.random.default_rng(1)),
    )
    np.testing.assert_allclose(ours.whitened, theirs.whitened, atol=1e-4)
    for name, check in ours.checks.items():
        assert check.p_value == pytest.approx(theirs.checks[name].p_value, abs=0.01)


@pytest.mark.parametrize("seed", [15, 26, 40])
def test_search_settles_where_a_limit_holds_a_parameter(seed: int) -> None:
    """Steps that were merely cut off at the limit crept, and the fit was said to be up to 2.5
    standard deviations from settled.
    """
    rng = np.random.default_rng([77, seed])
    x, (b, c) = np.linspace(0.0, 1.5, 12), rng.uniform(-0.3, 0.3, 2)
    y = np.exp(-b * x) + c * x + 0.02 * rng.standard_normal(x.size)
    start, bounds = {"a": 1.0, "b": 0.1, "c": 0.1}, dict.fromkeys("abc", (0.0, 5.0))
    fit = fit_curve(
        "a*exp(-b*x) + c*x",
        x + 0.03 * rng.standard_normal(x.size),
        y,
        u_y=0.02,
        u_x=0.03,
        start=start,
        bounds=bounds,
    )
    assert fit.status == "ok", fit.reasons
    posterior = fit.fit.posterior
    # a search without derivatives finds no better place
    height = lambda values: float(np.sum(posterior.residuals(values) ** 2))  # noqa: E731
    found = minimize(
        height, fit.fit.values, method="Nelder-Mead", bounds=[(0.0, 5.0)] * 3, tol=1e-10
    )
    assert height(fit.fit.values) < found.fun + 1e-7


@pytest.mark.parametrize("seed", [11, 14, 15, 18, 22, 27, 30, 32])
def test_two_parameters_that_do_the_same_at_a_limit_are_told_apart_by_it(seed: int) -> None:
    """At b = 0 both b and c are slopes: the gradient in b is that in c, 0, and the sign of its
    rounding decided between ok and not-identified.
    """
    rng, x = np.random.default_rng(seed), np.linspace(0.0, 1.5, 12)
    y = 1.0 + 0.3 * x - 0.03 * x**2 + 0.02 * rng.standard_normal(x.size)
    start, bounds = {"a": 1.0, "b": 0.1, "c": 0.1}, dict.fromkeys("abc", (0.0, 5.0))
    fit = fit_curve(
        "a*exp(-b*x) + c*x",
        x + 0.03 * rng.standard_normal(x.size),
        y,
        u_y=0.02,
        u_x=0.03,
        start=start,
        bounds=bounds,
    )
    assert fit.status == "ok", fit.reasons


def test_some_x_may_be_exact_while_others_have_errors() -> None:
    x, y = data(lambda x: 2.0 * np.exp(0.8 * x), np.linspace(0.1, 2.0, 12), 0.0, 0.1, 4)
    u_x = np.where(np.arange(12) % 3 == 0, 0.1, 0.0)
    start = {"a": 2.0, "b": 0.8}
    fit = fit_curve("a*exp(b*x)", x, y, start=start, u_y=0.1, u_x=u_x)
    named = {name: np.array([[value]]) for name, value in fit.values.items()}
    (pointwise,) = fit.problem.runs[0].likelihood(fit.values).pointwise(named)
    a, b = fit.values.values()
    # mean and variance of the true abscissas are those of the x less the errors of all
    tau2 = np.var(x, ddof=1) - np.mean(u_x**2)
    for i in range(12):
        if u_x[i] == 0.0:
            expected = -0.5 * ((y[i] - a * np.exp(b * x[i])) / 0.1) ** 2 - np.log(0.1)
            expected -= 0.5 * np.log(2.0 * np.pi)
        else:
            share = u_x[i] ** 2 / (u_x[i] ** 2 + tau2)
            centre, sd = x[i] - share * (x[i] - x.mean()), u_x[i] * np.sqrt(1.0 - share)

            def curve(z, centre=centre, sd=sd):
                return a * np.exp(b * (centre + sd * z))

            expected = brute_force(y[i], curve, sd=0.1)
        # components are narrow normal ones: `errors_in_x_quadrature` says how exactly
        assert pointwise[i] == pytest.approx(expected, abs=1e-9 if u_x[i] == 0.0 else 2e-3)
    nearly = fit_curve("a*exp(b*x)", x, y, start=start, u_y=0.1, u_x=np.maximum(u_x, 1e-5))
    assert list(fit.values.values()) == pytest.approx(list(nearly.values.values()), rel=1e-4)
    assert list(fit.sds.values()) == pytest.approx(list(nearly.sds.values()), rel=1e-3)
    alike = fit_curve("a*exp(b*x)", x, y, start=start, u_y=0.1, u_x=0.1)
    assert alike.sds["a"] > 1.2 * fit.sds["a"]


@pytest.mark.parametrize(
    ("u_x", "value"), [(0.0, "0.0"), (np.zeros(9), "0.0"), (np.r_[0.1, -0.1, np.zeros(7)], "-0.1")]
)
def test_x_that_are_all_exact_have_no_errors_to_state(u_x: object, value: str) -> None:
    x = np.linspace(0.0, 1.0, 9)
    with pytest.raises(InputError, match=rf"'u_x'.* must be > 0.*: {value}"):
        fit_curve("a + b*x", x, x, start={"a": 0.0, "b": 1.0}, u_y=0.1, u_x=u_x)


def test_a_covariance_of_x_is_a_common_zero_beside_errors_of_each(rng: np.random.Generator) -> None:
    true, n = rng.normal(0.0, 1.0, 25), 25
    x, y = true + 0.15 * rng.standard_normal(n) + 0.2, 1.0 + 2.0 * true
    y += 0.1 * rng.standard_normal(n)
    start, each = {"a": 0.0, "b": 1.0}, 0.15**2 * np.eye(n)
    zero = [Component("zero_x", 0.2)]
    known = fit_curve("a + b*x", x, y, start=start, u_x=0.15, u_y=0.1, errors=zero)
    whole = fit_curve("a + b*x", x, y, start=start, cov_x=each + 0.2**2, cov_y=0.01 * np.eye(n))
    for name in "ab":
        # one takes the size of the residuals as told by the slope, the other does not
        assert whole.values[name] == pytest.approx(known.values[name], abs=0.3 * known.sds[name])
        assert whole.sds[name] == pytest.approx(known.sds[name], rel=0.05)
    without = fit_curve("a + b*x", x, y, start=start, cov_x=each, u_y=0.1)
    assert without.sds["a"] < 0.3 * whole.sds["a"]
    alone = fit_curve("a + b*x", x, y, start=start, u_x=0.15, cov_y=0.01 * np.eye(n))
    assert alone.values == pytest.approx(without.values, rel=1e-9)
    far = fit_curve("a + b*x", x, y, start={"a": 1e5, "b": -1e5}, cov_x=each, u_y=0.1)
    assert far.values == pytest.approx(without.values, rel=1e-6)
    assert "errors of x with a standard deviation of about 0.15" in (
        alone.problem.runs[0].noise.describe(x_unit="1", y_unit="1", words=POINTS)
    )


def test_the_covariance_of_y_is_that_of_a_line_about_the_expected_abscissas() -> None:
    x, y = data(lambda x: 1.0 + 2.0 * x, np.linspace(0.0, 3.0, 9), 0.2, 0.1, 2)
    x, y = x[np.argsort(x)], y[np.argsort(x)]  # as a problem holds them
    rng = np.random.default_rng(6)
    root_x, root_y = (0.1 * rng.standard_normal((9, 9)) for _ in range(2))
    cov_x, cov_y = root_x @ root_x.T + 0.01 * np.eye(9), root_y @ root_y.T + 0.01 * np.eye(9)
    start = {"a": 0.0, "b": 1.0}
    fit = fit_curve("a + b*x", x, y, start=start, cov_x=cov_x, cov_y=cov_y)
    # by draws of what is not known: mean and ln variance of the true abscissas, these, and y
    mean, at_mean = np.mean(x), np.sum(cov_x) / 81.0
    error = (np.trace(cov_x) - 9.0 * at_mean) / 8.0
    tau2 = np.var(x, ddof=1) - error
    n_draw = 200_000
    mu = mean + np.sqrt(tau2 / 9.0 + at_mean) * rng.standard_normal(n_draw)
    gain = np.linalg.solve(cov_x + tau2 * np.eye(9), cov_x).T
    centre = x - (x - mu[:, None]) @ gain.T
    steeper = np.linalg.solve(cov_x + (tau2 + 1e-4) * np.eye(9), cov_x).T
    by_tau2 = ((gain - steeper) @ (x - mean)) / 1e-4
    centre += np.outer(rng.standard_normal(n_draw), by_tau2 * np.sqrt(2.0 / 8.0) * (tau2 + error))
    rest = np.linalg.inv(np.linalg.inv(cov_x) + np.eye(9) / tau2)
    centre += rng.multivariate_normal(np.zeros(9), rest, n_draw)
    drawn = fit.values["b"] * centre + rng.multivariate_normal(np.zeros(9), cov_y, n_draw)
    likelihood = fit.problem.runs[0].likelihood(fit.values)
    assert likelihood.normal is not None
    found, expected = covariance_of(likelihood.normal.root(fit.values)), np.cov(drawn.T)
    sds = np.sqrt(np.diag(expected))
    assert np.max(np.abs(found - expected) / np.outer(sds, sds)) < 6.0 / np.sqrt(n_draw)
    assert likelihood.points.x == pytest.approx(np.mean(centre, axis=0), abs=6e-3)
    # and the fit is generalised least squares with it
    columns = np.column_stack([np.ones(9), likelihood.points.x])
    weighed = columns.T @ np.linalg.inv(found)
    solution = np.linalg.solve(weighed @ columns, weighed @ y)
    assert list(fit.values.values()) == pytest.approx(solution, rel=1e-6)
    assert fit.cov == pytest.approx(np.linalg.inv(weighed @ columns), rel=1e-5)


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"cov_x": np.eye(9)}, "'cov_x' needs a known u_y"),
        ({"cov_x": np.eye(9), "u_y": 0.1}, "'cov_x' must be below the standard deviation of x"),
        ({"cov_x": np.eye(8), "u_y": 0.1}, "'cov_x' must have the shape"),
        ({"cov_x": 1e-3 * np.eye(9), "u_x": 0.1, "u_y": 0.1}, "'cov_x' cannot be combined"),
        ({"cov_x": 1e-3 * np.eye(9), "u_y": "2%"}, "'cov_x' does not go with"),
        ({"cov_x": 1e-3 * np.eye(9), "u_y": 0.1, "robust": "mixture"}, "'cov_x' cannot be comb"),
        ({"cov_x": 1e-3 * np.eye(9), "u_y": 0.1, "correlated": True}, "'u_x'|'correlated'"),
    ],
)
def test_what_does_not_go_with_a_covariance_of_x_is_refused(
    arguments: dict[str, object], rule: str
) -> None:
    x = np.linspace(1.0, 2.0, 9)
    with pytest.raises(InputError, match=rule):
        fit_curve("a + b*x", x, x, start={"a": 0.0, "b": 1.0}, **arguments)


@pytest.mark.statistics
def test_intervals_with_covariances_of_x_and_y_cover_what_they_say() -> None:
    rng, n, n_set, n_flat = np.random.default_rng(8), 25, 200, 60
    truth = {"a": 1.0, "b": 2.0}
    cov_x = 0.3**2 * np.eye(n) + 0.2**2
    cov_y = 0.04 * 0.6 ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    root, start = np.linalg.cholesky(cov_y), {"a": 0.0, "b": 1.0}
    inside, flat = np.zeros(2), np.zeros(2)
    for k in range(n_set):
        true = rng.normal(0.0, 1.0, n)
        x = true + 0.3 * rng.standard_normal(n) + 0.2 * rng.standard_normal()
        y = 1.0 + 2.0 * true + root @ rng.standard_normal(n)
        # errors of x as errors of y by the slope, at the x that were read
        wrong = {"cov_y": cov_y + 4.0 * cov_x}
        for given, count in (({"cov_x": cov_x, "cov_y": cov_y}, inside), (wrong, flat)):
            if count is flat and k >= n_flat:
                continue
            fit = fit_curve("a + b*x", x, y, start=start, n_start=1, **given)
            ends = (fit.intervals[name][0.68] for name in truth)
            count += [
                low <= true <= high for (low, high), true in zip(ends, truth.values(), strict=True)
            ]
    assert np.all(np.abs(inside / n_set - 0.68) < 3.3 * np.sqrt(0.68 * 0.32 / n_set))
    assert flat[1] / n_flat < 0.68 - 3.3 * np.sqrt(0.68 * 0.32 / n_flat)


def test_correlated_errors_of_a_point_are_the_integral_of_their_joint_density() -> None:
    rng, n = np.random.default_rng(11), 14
    true = np.linspace(0.2, 2.0, n)
    u_x, u_y, r_xy = np.full(n, 0.08), np.linspace(0.1, 0.3, n), np.linspace(-0.9, 0.8, n)
    u_x[3] = 0.0
    e = rng.standard_normal((2, n))
    x = true + u_x * e[0]
    y = 2.0 * np.exp(0.8 * true) + u_y * (r_xy * e[0] + np.sqrt(1.0 - r_xy**2) * e[1])
    start = {"a": 2.0, "b": 0.8}
    fit = fit_curve("a*exp(b*x)", x, y, start=start, u_y=u_y, u_x=u_x, r_xy=r_xy)
    a, b = fit.values.values()
    draw = {name: np.array([[value]]) for name, value in fit.values.items()}
    (pointwise,) = fit.problem.runs[0].likelihood(fit.values).pointwise(draw)
    mu, tau2, off = np.mean(x), np.var(x, ddof=1) - np.mean(u_x**2), []
    for k, i in enumerate(np.argsort(x)):
        if u_x[i] == 0.0:
            alone = -0.5 * ((y[i] - a * np.exp(b * x[i])) / u_y[i]) ** 2
            expected = alone - np.log(u_y[i]) - 0.5 * np.log(2.0 * np.pi)
        else:
            xi = np.linspace(x[i] - 8.0 * u_x[i], x[i] + 8.0 * u_x[i], 20_001)
            cov = r_xy[i] * u_x[i] * u_y[i]
            joint = stats.multivariate_normal([0.0, 0.0], [[u_x[i] ** 2, cov], [cov, u_y[i] ** 2]])
            weight = stats.norm(mu, np.sqrt(tau2)).pdf(xi)
            both = joint.pdf(np.column_stack([x[i] - xi, y[i] - a * np.exp(b * xi)]))
            of_x = stats.norm(0.0, u_x[i]).pdf(x[i] - xi)
            expected = np.log(np.sum(both * weight) / np.sum(of_x * weight))
        off.append(pointwise[k] - expected)
    assert np.max(np.abs(off)) < 5e-3
    without = fit_curve("a*exp(b*x)", x, y, start=start, u_y=u_y, u_x=u_x)
    (apart,) = without.problem.runs[0].likelihood(fit.values).pointwise(draw)
    assert np.max(np.abs(apart - pointwise)) > 0.1


def test_the_scores_of_correlated_errors_are_derivatives() -> None:
    x, y = data(lambda x: 2.0 * np.exp(0.8 * x), np.linspace(0.1, 2.0, 8), 0.1, 0.1, 3)
    fit = fit_curve("a*exp(b*x)", x, y, start={"a": 2.0, "b": 0.8}, u_y=0.1, u_x=0.1, r_xy=0.7)
    likelihood, names, h = fit.problem.runs[0].likelihood(fit.values), ("a", "b"), 1e-5
    scores = likelihood.scores({"a": 2.1, "b": 0.75}, names, {})
    for i, (da, db) in enumerate(np.eye(2)):
        high, low = (
            likelihood.pointwise(
                {"a": np.array([[2.1 + s * da]]), "b": np.array([[0.75 + s * db]])}
            )[0]
            for s in (h, -h)
        )
        assert scores[:, i] == pytest.approx((high - low) / (2.0 * h), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"u_y": 0.1, "r_xy": 0.5}, "needs u_x and u_y"),
        ({"u_y": "2%", "u_x": 0.1, "r_xy": 0.5}, "needs u_x and u_y in their units"),
        ({"u_y": 0.1, "u_x": 0.1, "r_xy": 0.5, "robust": "mixture"}, "normal errors alone"),
        ({"u_y": 0.1, "u_x": 0.1, "r_xy": 1.0}, "between -1 and 1"),
        ({"u_y": 0.1, "u_x": 0.1, "r_xy": [0.1, 0.2]}, "between -1 and 1"),
        ({"u_y": 0.1, "u_x": 0.1, "r_xy": float("nan")}, "between -1 and 1"),
        ({"cov_y": np.eye(9), "u_x": 0.1, "r_xy": 0.1}, "needs u_x and u_y"),
    ],
)
def test_a_correlation_that_has_no_meaning_is_refused(
    arguments: dict[str, object], rule: str
) -> None:
    x = np.linspace(1.0, 2.0, 9)
    with pytest.raises(InputError, match=f"'r_xy' .*{rule}"):
        fit_curve("a + b*x", x, x, start={"a": 0.0, "b": 1.0}, **arguments)
