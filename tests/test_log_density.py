"""A log density of one's own: the fit beside brute force (closed forms, SciPy's simplex and second
derivatives by differences), its statuses, and coverage.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import optimize, special, stats

from estim import (
    Component,
    DataSet,
    InputError,
    LogDensity,
    Target,
    fit_curve,
    fit_curves,
    sample_curve,
    write_curve_report,
)
from estim.curves.dual_numbers import Dual
from estim.curves.formula import read_formula
from estim.problem.likelihood import Points
from estim.problem.own_density import OwnDensity

OWN = LogDensity()


def gamma(x: Any, k: Any, s: Any) -> Any:
    return (k - 1) * np.log(x) - x / s - k * np.log(s) - special.gammaln(k)


def normal(x: Any, m: Any, s: Any) -> Any:
    return -0.5 * ((x - m) / s) ** 2 - np.log(s) - 0.5 * np.log(2 * np.pi)


def waiting(t: Any, tau: Any) -> Any:
    return -np.log(tau) - t / tau


def censored(at: Any, m: Any, s: Any) -> Any:
    """Readings beyond the end of a scale are known to lie there."""
    beyond = special.log_ndtr((m - at["x"]) / s)
    return np.where(at["beyond"] > 0, beyond, normal(at["x"], m, s))


def mixture(x: Any, w: Any, m: Any) -> Any:
    return np.log(w * np.exp(normal(x, m, 0.1)) + (1 - w) / 10)


def two_peaks(x: Any, w: Any, m_1: Any, s_1: Any, m_2: Any, s_2: Any) -> Any:
    first, second = normal(x, m_1, s_1), normal(x, m_2, s_2)
    return np.logaddexp(np.log(w) + first, np.log1p(-w) + second)


RNG = np.random.default_rng(3)
GAMMA = RNG.gamma(3.0, 2.0, 100)
READ = RNG.normal(5.0, 2.0, 80)
BEYOND = {"x": np.minimum(READ, 6.0), "beyond": (READ > 6.0).astype(float)}
EVENTS = np.concatenate([RNG.uniform(0, 10, 100), RNG.normal(7, 0.1, 12)])
PEAKS = np.concatenate([RNG.normal(0, 1, 300), RNG.normal(4, 0.5, 200)])
POSITIVE = (0.0, None)
CASES: dict[str, tuple[Callable[..., Any], Any, dict[str, float], dict[str, Any]]] = {
    "a Gamma law": (gamma, GAMMA, {"k": 1.0, "s": 1.0}, {"k": POSITIVE, "s": POSITIVE}),
    "a censored sample": (censored, BEYOND, {"m": 1.0, "s": 1.0}, {"s": POSITIVE}),
    "a peak on a background": (mixture, EVENTS, {"w": 0.1, "m": 5.0}, {"w": (0, 1), "m": (0, 10)}),
    "two peaks": (
        two_peaks, PEAKS, {"w": 0.5, "m_1": -1.0, "s_1": 2.0, "m_2": 5.0, "s_2": 1.0},
        {"w": (0, 1), "s_1": POSITIVE, "s_2": POSITIVE},
    ),
}  # fmt: skip


def fit_of(case: str, **more: Any) -> Any:
    density, x, start, bounds = CASES[case]
    return fit_curve(density, x, None, noise=OWN, start=start, bounds=bounds, **more)


def brute_force(density: Any, x: Any, near: Any) -> tuple[Any, Any, float]:
    """Where SciPy's simplex finds the highest likelihood, the inverse of its second derivatives by
    differences, and its height.
    """

    def minus(p: Any) -> float:
        with np.errstate(all="ignore"):
            value = -float(np.sum(density(x, *p)))
        return value if np.isfinite(value) else np.inf

    options = {"xatol": 1e-10, "fatol": 1e-11, "maxiter": 20_000, "maxfev": 20_000}
    options |= {"initial_simplex": near * (1.0 + 0.002 * np.eye(len(near) + 1, len(near)))}
    found = optimize.minimize(minus, near, method="Nelder-Mead", options=options)
    step = 1e-4 * np.abs(found.x)
    moves = np.diag(step)
    hessian = [
        [
            (minus(found.x + a + b) - minus(found.x + a - b) - minus(found.x - a + b)
             + minus(found.x - a - b)) / (4 * step[i] * step[j])
            for j, b in enumerate(moves)
        ]
        for i, a in enumerate(moves)
    ]  # fmt: skip
    return found.x, np.linalg.inv(np.array(hessian)), -float(found.fun)


@pytest.mark.parametrize("case", CASES)
def test_optimum_and_covariance_are_those_of_brute_force(case: str) -> None:
    density, x, *_ = CASES[case]
    fit = fit_of(case)
    values, cov, height = brute_force(density, x, [1.001 * v for v in fit.values.values()])
    sds = np.sqrt(np.diag(cov))
    assert fit.status == "ok"
    assert np.all(np.abs(np.array([*fit.values.values()]) - values) < 1e-4 * sds)
    assert -0.5 * fit.chi2 == pytest.approx(height, abs=1e-8)
    np.testing.assert_allclose(fit.cov, cov, rtol=3e-4, atol=3e-4 * np.min(np.diag(cov)))
    assert fit.aic == pytest.approx(2 * len(values) - 2 * height)


def test_a_gamma_law_has_the_covariance_of_the_textbook_and_the_profile_of_a_scan() -> None:
    """The observed information of k and the scale s is n [[psi'(k), 1/s], [1/s, k/s^2]]."""
    fit = fit_of("a Gamma law")
    k, s = fit.values.values()
    told = GAMMA.size * np.array([[special.polygamma(1, k), 1 / s], [1 / s, k / s**2]])
    np.testing.assert_allclose(fit.cov, np.linalg.inv(told), rtol=1e-5)
    assert stats.gamma.fit(GAMMA, floc=0)[::2] == pytest.approx((k, s), rel=1e-3)

    def rise(k: float) -> float:  # the best scale is mean/k
        height = np.sum(gamma(GAMMA, k, GAMMA.mean() / k))
        return 2 * (-0.5 * fit.chi2 - height) - stats.chi2.ppf(0.95, 1)

    ends = optimize.brentq(rise, 1.0, k), optimize.brentq(rise, k, 9.0)
    assert fit.intervals["k"][0.95] == pytest.approx(ends, rel=1e-4)


def test_draws_are_those_of_the_density_on_a_grid_and_the_second_opinion_agrees() -> None:
    drawn = sample_curve(fit_of("a Gamma law"), seed=1)
    assert (drawn.diagnosis.status, drawn.comparison.verdict) == ("ok", "agree")
    k, s = np.linspace(1.2, 6.0, 400), np.linspace(0.8, 5.0, 400)
    height = np.sum([gamma(x, k[:, None], s) for x in GAMMA], axis=0)
    density = np.exp(height - height.max())
    density /= density.sum()
    mean = float(np.sum(k[:, None] * density))
    sd = float(np.sqrt(np.sum((k[:, None] - mean) ** 2 * density)))
    assert np.mean(drawn.chain.flat[:, 0]) == pytest.approx(mean, abs=0.06 * sd)
    assert np.std(drawn.chain.flat[:, 0]) == pytest.approx(sd, rel=0.05)


def test_a_likelihood_says_that_nothing_tests_it() -> None:
    fit = fit_of("a Gamma law")
    assert "a likelihood alone has no goodness of fit" in fit.notes[-1]
    assert "log-likelihood = " in str(fit)
    assert "chi2" not in str(fit)
    assert np.isnan(fit.p_value)
    assert fit([3.0]) == pytest.approx(gamma(3.0, **fit.values))
    assert "AIC" in fit.summary()
    for method in (fit.plot, lambda: fit.residuals):
        with pytest.raises(InputError, match="a log density has none"):
            method()
    with pytest.raises(InputError, match="a log density has none"):
        write_curve_report(fit, "nowhere", title="", kind="synthetic", target=Target(ess=400.0))
    wrong = fit_curve(waiting, GAMMA, None, noise=OWN, start={"tau": 1.0})
    assert wrong.aic > fit.aic + 20.0  # what tells them apart


def test_statuses_are_those_of_any_fit() -> None:
    x = np.random.default_rng(1).normal(1.0, 1.0, 50)
    sum_alone = partial(fit_curve, lambda x, a, b: normal(x, a + b, 1.0), x, None, noise=OWN)
    assert sum_alone(start={"a": 1.0, "b": 1.0}).status == "not-identified"
    helped = sum_alone(start={"a": 1.0, "b": 1.0}, priors={"b": "0.5(1)"})
    assert helped.status == "ok"
    assert helped.sds["a"] == pytest.approx(np.sqrt(1 / 50 + 0.1**2), rel=1e-6)
    far = sum_alone(start={"a": 0.0}, fixed={"b": 0.0}, priors={"a": "7.0(1)"})
    assert far.status == "contradiction"
    empty = np.random.default_rng(3).uniform(0, 10, 30)
    held = fit_curve(
        lambda x, w: mixture(x, w, 7.0), empty[np.abs(empty - 7.0) > 0.6], None, noise=OWN,
        start={"w": 0.1}, bounds={"w": (0, 1)},
    )  # fmt: skip
    assert (held.values["w"], held.status) == (pytest.approx(0.0, abs=1e-9), "at-bound")
    cauchy = fit_curve(
        lambda x, m: -np.log1p((x - m) ** 2), [-5.0, -4.9, 5.0, 5.1], None, noise=OWN,
        start={"m": 1.0}, bounds={"m": (-20, 20)},
    )  # fmt: skip
    assert cauchy.status == "multimodal"
    # a density without an end, of a width that may be 0
    spike = fit_curve(
        lambda x, s: np.logaddexp(normal(x, 1.0, s), normal(x, 0.0, 1.0)), [1.0, 0.2, -0.3], None,
        noise=OWN, start={"s": 0.1}, bounds={"s": POSITIVE},
    )  # fmt: skip
    assert spike.status != "ok"


def test_a_density_and_readings_share_a_parameter() -> None:
    rng = np.random.default_rng(5)
    t, times = np.linspace(0.0, 5.0, 20), rng.exponential(1.5, 200)
    y = 2.0 * np.exp(-t / 1.5) + 0.05 * rng.standard_normal(20)
    decay = DataSet(t, y, u_y=0.05, curve="2*exp(-x/tau)")
    single = DataSet(times, None, noise=OWN, curve=waiting)
    both = fit_curves(None, {"decay": decay, "single": single}, start={"tau": 1.0})

    def minus(tau: float) -> float:
        off = (y - 2.0 * np.exp(-t / tau)) / 0.05
        return 0.5 * float(off @ off) - float(np.sum(waiting(times, tau)))

    best = optimize.minimize_scalar(minus, bracket=(1.0, 2.0), tol=1e-10).x
    assert both.values["tau"] == pytest.approx(best, rel=1e-6)
    curvature = (minus(best + 1e-3) - 2 * minus(best) + minus(best - 1e-3)) / 1e-6
    # of readings the information is the expected one
    assert both.sds["tau"] == pytest.approx(1 / np.sqrt(curvature), rel=0.02)
    unsure = DataSet(t, y, u_y=0.01, jitter=True, curve="2*exp(-x/tau)")
    jittered = fit_curves(None, {"decay": unsure, "single": single}, start={"tau": 1.0})
    assert jittered.values["tau"] == pytest.approx(best, abs=both.sds["tau"])
    assert "log-likelihood = " in str(jittered)
    assert "a likelihood alone" in jittered.notes[-1]
    bent = DataSet(t, y + 0.2 * np.sin(3 * t), u_y=0.05, curve="2*exp(-x/tau)")
    wrong = fit_curves(None, {"decay": bent, "single": single}, start={"tau": 1.0})
    assert wrong.status == "poor-fit"
    assert sample_curve(both, seed=1, target=Target(ess=400.0)).diagnosis.status in (
        "ok", "methods-disagree",
    )  # fmt: skip


@pytest.mark.slow
def test_an_unbinned_fit_has_the_numbers_of_iminuit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of `benchmarks/peers`, as iminuit says them: HESSE takes second derivatives too."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks" / "peers"))
    import cases
    import of_iminuit

    def log_density(x: Any, z: Any, mu: Any, sigma: Any, tau: Any) -> Any:
        peak = np.exp(-0.5 * ((x - mu) / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
        return np.log(z * peak + (1 - z) * np.exp(-x / tau) / (tau * (1 - np.exp(-2 / tau))))

    fit = fit_curve(
        log_density, of_iminuit.mixture(), None, noise=OWN,
        start={"z": 0.4, "mu": 1.0, "sigma": 0.2, "tau": 1.0},
        bounds={"z": (0, 1), "mu": (0, 2), "sigma": (0.01, None), "tau": (0.01, None)},
    )  # fmt: skip
    for name, (value, sd) in cases.stored()["iminuit_unbinned"]["values"].items():
        assert abs(fit.values[name] - value) < 0.005 * sd
        assert fit.sds[name] == pytest.approx(sd, rel=1e-3)


@pytest.mark.parametrize("function", [special.gammaln, special.log_ndtr])
def test_functions_of_log_densities_are_differentiated_exactly(function: Any) -> None:
    x, h = np.linspace(0.3, 5.0, 9), 1e-5
    slope = function(Dual(x, {"x": 1.0})).partials["x"]
    np.testing.assert_allclose(slope, (function(x + h) - function(x - h)) / (2 * h), rtol=1e-7)


def test_a_formula_is_a_log_density_too() -> None:
    times = np.random.default_rng(2).exponential(2.0, 40)
    fit = fit_curve("-x/tau - log(tau)", times, None, noise=OWN, start={"tau": 1.0})
    assert fit.values["tau"] == pytest.approx(times.mean(), rel=1e-6)
    assert fit.sds["tau"] == pytest.approx(times.mean() / np.sqrt(40), rel=1e-5)


def test_the_likelihood_keeps_to_its_contract() -> None:
    """Half the squares of residuals are minus the log-likelihood but for a constant, and
    scoring is its derivatives.
    """
    points = Points(
        read_formula("log(r) - r*x + 0*b + b**2*0"), np.arange(1.0, 6.0), np.zeros(5),
        {"r": "r", "b": "b"},
    )  # fmt: skip
    here = {"r": np.float64(0.5), "b": np.float64(1.0)}
    likelihood = OwnDensity(5).likelihood(points, here)
    there = {"r": np.array([[0.5], [0.6]]), "b": np.array([[1.0], [1.0]])}
    squares = np.sum(likelihood.residuals(there) ** 2, axis=1)
    assert -0.5 * np.diff(squares) == pytest.approx(np.diff(likelihood.log_likelihood(there)))
    jacobian, aim = likelihood.scoring(here, ["r"])
    assert -(jacobian.T @ aim)[0] == pytest.approx(5 / 0.5 - 15.0)
    assert (jacobian.T @ jacobian)[0, 0] == pytest.approx(5 / 0.5**2, rel=1e-5)


REFUSED: dict[str, dict[str, Any]] = {
    "y": {"y": GAMMA},
    "errors of y": {"u_y": 0.1},
    "no start": {"curve": "-x/tau - log(tau)", "start": None},
    "an error in common": {"errors": [Component("scale_x", 0.1)]},
    "nothing finite": {"curve": lambda x, k, s: np.nan * x},
    "another shape": {"curve": lambda x, k, s: np.ones(3)},
    "too few": {"x": [1.0]},
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_a_density_does_not_have_is_refused_in_one_line(what: str) -> None:
    given = {"curve": gamma, "x": GAMMA, "y": None, "start": {"k": 1.0, "s": 1.0}, **REFUSED[what]}
    with pytest.raises(InputError) as refused:
        fit_curve(**given, noise=OWN)
    assert "\n" not in str(refused.value)


@pytest.mark.statistics
def test_intervals_of_a_density_hold_what_they_say_and_those_of_a_wrong_one_do_not() -> None:
    """30 waiting times of a Gamma law, and its mean taken as that of an exponential law, which is
    said to be known to 1/sqrt(n) of itself where 1/sqrt(3 n) is right.
    """
    n_fit, hits, wrong = 200, np.zeros((2, 2)), np.zeros(2)
    for seed in range(n_fit):
        x = np.random.default_rng(seed).gamma(3.0, 2.0, 30)
        fit = fit_curve(
            gamma, x, None, noise=OWN, start={"k": 2.0, "s": 3.0}, scan=False,
            bounds={"k": POSITIVE, "s": POSITIVE},
        )  # fmt: skip
        other = fit_curve(waiting, x, None, noise=OWN, start={"tau": 5.0}, scan=False)
        for i, p in enumerate((0.68, 0.95)):
            for j, (name, true) in enumerate({"k": 3.0, "s": 2.0}.items()):
                low, high = fit.intervals[name][p]
                hits[i, j] += low <= true <= high
            low, high = other.intervals["tau"][p]
            wrong[i] += low <= 6.0 <= high
    sd = np.sqrt(np.array([0.68 * 0.32, 0.95 * 0.05]) / n_fit)[:, None]
    # the profile of 30 readings is good to about 1/n
    assert np.all(np.abs(hits / n_fit - [[0.68], [0.95]]) < 3.5 * sd + 0.02)
    assert wrong[0] / n_fit > 0.68 + 5.0 * sd[0]


def test_a_density_beside_readings_of_unknown_error_is_told_by_its_likelihood() -> None:
    """The height of a log density is arbitrary: its squares say nothing by their ratio."""

    def gauss(x: Any, m: float, s: float) -> Any:
        return -np.log(s) - 0.5 * np.log(2.0 * np.pi) - 0.5 * ((x - m) / s) ** 2

    rng = np.random.default_rng(1)
    z, x = rng.normal(1.0, 2.0, 30), np.arange(12.0)
    y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(12)
    density = DataSet(z, None, noise=LogDensity(), curve=gauss)
    line = DataSet(x, y, u_y=0.05, jitter=True, curve=lambda x, m, b: m + b * x)
    found = fit_curves(
        None, {"density": density, "line": line}, start={"m": 0.0, "s": 1.0, "b": 1.0}
    )
    assert found.status == "ok"
    assert found.values["s"] == pytest.approx(
        np.sqrt(np.mean((z - found.values["m"]) ** 2)), rel=1e-4
    )


def test_nothing_passes_through_the_points_of_a_density() -> None:
    found = fit_curve(
        lambda x, m: -(m**2) + 0.0 * x, np.arange(5.0), None, noise=LogDensity(), start={"m": 1.0}
    )
    assert found.status == "ok"
    assert "rounding" not in str(found)


@pytest.mark.parametrize("columns", [1, 2])
def test_a_sum_over_all_observations_is_refused(columns: int) -> None:
    """It would count for each of them: standard deviations sqrt(n) times too small."""
    x = np.random.default_rng(1).normal(2.0, 1.0, 30)
    at: Any = x if columns == 1 else {"u": x, "v": np.ones(30)}

    def total(x: Any, m: float) -> Any:
        return np.sum(-0.5 * ((x if columns == 1 else x["u"]) - m) ** 2)

    with pytest.raises(InputError, match="each of the 30 observations, not one number"):
        fit_curve(total, at, None, noise=LogDensity(), start={"m": 1.0})
