"""Profile-posterior intervals against closed forms and brute force, and where they are open."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from formulas import formula_problem
from scipy.optimize import minimize
from scipy.stats import chi2, norm

from estim.campaign import load_campaign
from estim.common.errors import InputError
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.profile import contour, profile_intervals
from estim.fitting.profile_search import search_of
from estim.problem.posterior import Posterior, Problem
from estim.problem.priors import HalfNormal, Normal, Uniform

X = np.linspace(0.0, 2.0, 12)


def line(x, a, b):
    return a + b * x


def fitted(problem: Problem, **choices: object) -> Fit:
    return fit_least_squares(problem, **choices)


def linear(rng: np.random.Generator) -> tuple[Fit, np.ndarray, np.ndarray]:
    """A line with normal priors: its fit, and mean and covariance of the posterior by the textbook
    formula.
    """
    y = 0.4 + 1.3 * X + 0.2 * rng.standard_normal(X.size)
    fit = fitted(formula_problem(line, X, y, 0.2, {"a": Normal(0.5, 0.1), "b": Normal(1.0, 0.5)}))
    design = np.column_stack([np.ones_like(X), X])
    cov = np.linalg.inv(design.T @ design / 0.2**2 + np.diag([100.0, 4.0]))
    return fit, cov @ (design.T @ y / 0.2**2 + np.array([50.0, 4.0])), cov


def crossings(x: np.ndarray, rise: np.ndarray, level: float) -> tuple[float, float]:
    """Outermost places where a rise tabulated on a fine grid passes `level`."""
    below = np.flatnonzero(rise < level)
    ends = []
    for inner, outer in ((below[0], below[0] - 1), (below[-1], below[-1] + 1)):
        share = (level - rise[inner]) / (rise[outer] - rise[inner])
        ends.append(x[inner] + share * (x[outer] - x[inner]))
    return ends[0], ends[1]


def test_linear_gaussian_interval_is_value_plus_minus_z_sd(rng: np.random.Generator) -> None:
    fit, mean, cov = linear(rng)
    for i, found in enumerate(profile_intervals(fit, probabilities=(0.5, 0.68, 0.95, 0.997))):
        sd = math.sqrt(cov[i, i])
        assert found.value == pytest.approx(mean[i], abs=1e-6 * sd)
        for p in found.low:
            z = norm.ppf(0.5 + 0.5 * p)
            assert (mean[i] - found.low[p]) / (z * sd) == pytest.approx(1.0, rel=1e-6)
            assert (found.high[p] - mean[i]) / (z * sd) == pytest.approx(1.0, rel=1e-6)
            # held at the mode the other parameter would make the interval too short
            assert found.high[p] - mean[i] > 1.2 * z / math.sqrt(np.linalg.inv(cov)[i, i])
        assert not any(found.open_low.values())
        assert not any(found.open_high.values())
        assert found.n_failed == 0
        assert found.found_better == 0.0


def test_contour_of_a_linear_problem_is_the_ellipse(rng: np.random.Generator) -> None:
    fit, mean, cov = linear(rng)
    found = contour(fit, "a", "b", (0.68, 0.95), n=11)
    a, b = np.meshgrid(found.x - mean[0], found.y - mean[1], indexing="ij")
    ellipse = np.einsum("i...,ij,j...->...", np.array([a, b]), np.linalg.inv(cov), np.array([a, b]))
    np.testing.assert_allclose(found.rise, ellipse, atol=1e-6)
    assert found.levels == pytest.approx({0.68: chi2.ppf(0.68, 2), 0.95: chi2.ppf(0.95, 2)})
    # the grid holds the widest contour on every side
    edge = np.concatenate([found.rise[[0, -1]].ravel(), found.rise[:, [0, -1]].ravel()])
    assert np.min(edge) > found.levels[0.95]


def test_decay_agrees_with_a_dense_grid(rng: np.random.Generator) -> None:
    """y = a exp(-k x): a is eliminated exactly at each k of a grid; over k on a grid at each a."""
    y = 1.0 * np.exp(-1.5 * X) + 0.1 * rng.standard_normal(X.size)
    fit = fitted(
        formula_problem(
            lambda x, a, k: a * np.exp(-k * x),
            X,
            y,
            0.1,
            {"a": Uniform(0.0, 5.0), "k": Uniform(0.0, 20.0)},
        )
    )
    by_a, by_k = profile_intervals(fit)
    k = np.linspace(0.3, 6.0, 4001)
    shape = np.exp(-np.outer(k, X))
    best = shape @ y / np.sum(shape**2, axis=1)
    chi2_k = np.sum((y - best[:, None] * shape) ** 2, axis=1) / 0.1**2
    a = np.linspace(0.5, 1.6, 1001)
    chi2_a = np.min(
        [np.sum((y[None] - a[:, None] * row[None]) ** 2, axis=1) / 0.1**2 for row in shape], axis=0
    )
    for found, grid, square in ((by_k, k, chi2_k), (by_a, a, chi2_a)):
        for p in (0.68, 0.95):
            low, high = crossings(grid, square - square.min(), chi2.ppf(p, 1))
            assert found.low[p] == pytest.approx(low, abs=2e-3 * (high - low))
            assert found.high[p] == pytest.approx(high, abs=2e-3 * (high - low))
    # the decay's interval is lopsided, which a symmetric one would miss
    assert by_k.high[0.95] - by_k.value > 1.15 * (by_k.value - by_k.low[0.95])


def test_inferred_noise_is_profiled_with_its_determinant(rng: np.random.Generator) -> None:
    """A constant with unknown sigma: at each sigma the mean is that of the data, -2 log L = n log
    sigma^2 + S/sigma^2.
    """
    y = 3.0 + 0.5 * rng.standard_normal(X.size)
    priors = {"m": Uniform(-10.0, 10.0), "s": HalfNormal(2.0)}
    mean, noise = profile_intervals(
        fitted(formula_problem(lambda x, m: m + 0.0 * x, X, y, "s", priors))
    )
    square = np.sum((y - y.mean()) ** 2)
    s = np.linspace(0.15, 3.0, 40001)
    by_s = X.size * np.log(s**2) + square / s**2 + (s / 2.0) ** 2
    m = np.linspace(2.0, 4.0, 801)
    by_m = np.array(
        [
            np.min(
                X.size * np.log(s**2)
                + (square + X.size * (y.mean() - c) ** 2) / s**2
                + (s / 2.0) ** 2
            )
            for c in m
        ]
    )
    for found, grid, objective in ((noise, s, by_s), (mean, m, by_m)):
        for p in (0.68, 0.95):
            low, high = crossings(grid, objective - objective.min(), chi2.ppf(p, 1))
            assert found.low[p] == pytest.approx(low, abs=1e-3 * (high - low))
            assert found.high[p] == pytest.approx(high, abs=1e-3 * (high - low))


def test_banana_is_followed_along_its_bend() -> None:
    """a is measured, and b - a^2: profile of a is that of its own measurement, profile of b by a
    dense grid over a.
    """

    def banana(x, a, b):
        return np.where(np.real(x) < 1.0, a, 10.0 * (b - a**2))

    x, y = np.array([0.0, 2.0]), np.array([1.0, 0.0])
    fit = fitted(
        formula_problem(banana, x, y, 0.5, {"a": Uniform(-8.0, 8.0), "b": Uniform(-60.0, 60.0)})
    )
    by_a, by_b = profile_intervals(fit)
    assert by_a.low[0.95] == pytest.approx(1.0 - 0.5 * norm.ppf(0.975), abs=1e-5)
    assert by_a.high[0.95] == pytest.approx(1.0 + 0.5 * norm.ppf(0.975), abs=1e-5)
    a = np.linspace(-3.0, 5.0, 16001)
    b = np.linspace(-1.0, 6.0, 1401)
    rise = np.array([np.min((a - 1.0) ** 2 + 100.0 * (value - a**2) ** 2) for value in b]) / 0.25
    low, high = crossings(b, rise, chi2.ppf(0.68, 1))
    assert by_b.low[0.68] == pytest.approx(low, abs=2e-3)
    assert by_b.high[0.68] == pytest.approx(high, abs=2e-3)
    assert by_b.n_failed == 0


def test_flat_direction_is_open_on_both_sides_and_says_so(rng: np.random.Generator) -> None:
    priors = {"a": Normal(0.0, 5.0), "b": Uniform(0.0, 1.0)}
    fit = fitted(
        formula_problem(
            lambda x, a, b: a + 0.0 * b * x, X, rng.standard_normal(X.size), 1.0, priors
        )
    )
    _, flat = profile_intervals(fit)
    assert (flat.low[0.68], flat.high[0.95]) == (0.0, 1.0)
    assert all(flat.open_low.values())
    assert all(flat.open_high.values())
    assert "unbounded above: there is no limit below the edge 1 of the prior" in flat.sentence
    assert "unbounded below: there is no limit above the edge 0 of the prior" in flat.sentence


def test_sum_of_two_unknowns_leaves_each_open(rng: np.random.Generator) -> None:
    """Not flat in either alone: only re-optimising the other shows it."""
    y = 1.0 + 0.01 * rng.standard_normal(X.size)
    fit = fitted(
        formula_problem(
            lambda x, a, b: a + b + 0.0 * x,
            X,
            y,
            0.01,
            {"a": Uniform(0.0, 1.0), "b": Uniform(0.0, 1.0)},
        )
    )
    for found in profile_intervals(fit):
        assert found.high[0.95] - found.low[0.95] > 0.98


def test_mode_at_a_bound_is_open_there_and_limited_on_the_other_side() -> None:
    """One parameter measured as -0.1 +- 0.2 but not negative: the upper end is where ((b +
    .1)/.2)^2 - .25 reaches the quantile.
    """
    x = np.array([1.0])
    fit = fitted(
        formula_problem(lambda x, b: b * x, x, np.array([-0.1]), 0.2, {"b": Uniform(0.0, 5.0)})
    )
    (found,) = profile_intervals(fit)
    assert found.value == pytest.approx(0.0, abs=1e-5)
    assert found.low[0.95] == 0.0
    assert found.open_low == {0.68: True, 0.95: True}
    assert found.open_high == {0.68: False, 0.95: False}
    for p in (0.68, 0.95):
        assert found.high[p] == pytest.approx(
            0.2 * math.sqrt(0.25 + chi2.ppf(p, 1)) - 0.1, abs=1e-4
        )
    assert "the mode lies at the edge 0 of the prior" in found.sentence


def test_another_parameter_at_its_bound_is_held_there() -> None:
    """a + b measured as 1, b >= 0 and pulled below 0 by its own measurement -1: at a < 1 it is
    freed, at a > 1 held at 0.
    """

    def both(x, a, b):
        return np.where(np.real(x) < 1.0, a + b, b)

    x, y = np.array([0.0, 2.0]), np.array([1.0, -1.0])
    fit = fitted(
        formula_problem(both, x, y, 0.5, {"a": Uniform(-10.0, 10.0), "b": Uniform(0.0, 10.0)})
    )
    found = profile_intervals(fit, names=["a"])[0]
    b = np.linspace(0.0, 3.0, 3001)
    a = np.linspace(-3.0, 4.0, 7001)
    objective = np.array([np.min((1.0 - value - b) ** 2 + (1.0 + b) ** 2) for value in a]) / 0.25
    low, high = crossings(a, objective - objective.min(), chi2.ppf(0.95, 1))
    assert found.low[0.95] == pytest.approx(low, abs=2e-3)
    assert found.high[0.95] == pytest.approx(high, abs=2e-3)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_holes_in_the_model_are_walls_and_not_crashes(bad: float, rng: np.random.Generator) -> None:
    """b*x, but no number where a > 1 or b > 1.25: the interval ends at the wall."""

    def holed(x, a, b):
        return np.where((np.real(a) > 1.0) | (np.real(b) > 1.25), bad, b * x + 0.1 * a)

    y = 1.2 * X + 0.5 * rng.standard_normal(X.size)
    problem = formula_problem(holed, X, y, 0.5, {"a": Normal(0.0, 0.5), "b": Uniform(0.0, 5.0)})
    fit = fitted(problem, start=np.array([0.0, 1.0]))
    for found in profile_intervals(fit):
        assert np.all(np.isfinite(found.rise))
        assert found.low[0.95] <= found.value <= found.high[0.95]
    assert found.high[0.95] <= 1.2500001
    assert np.isfinite(contour(fit, "a", "b", n=7).rise).any()


def test_fit_in_a_hole_has_no_interval_and_no_crash() -> None:
    def holed(x, a):
        return np.where(np.real(a) > 1.0, np.nan, a * x)

    fit = fitted(
        formula_problem(holed, X, 0.5 * X, 0.5, {"a": Uniform(0.0, 5.0)}), start=np.array([0.4])
    )
    lost = replace(fit, values=np.array([2.0]))
    (found,) = profile_intervals(lost)
    assert found.open_low == found.open_high == {0.68: True, 0.95: True}
    assert "no interval" in found.sentence


def test_a_lower_mode_met_on_the_way_is_reported() -> None:
    """a^2 measured as 1 with a pull towards positive a; the fit is started, and ends, on the wrong
    side.
    """
    x, y = np.array([1.0]), np.array([1.0])
    problem = formula_problem(lambda x, a: a**2 * x, x, y, 0.7, {"a": Normal(0.5, 2.0)})
    wrong = fitted(problem, start=np.array([-0.9]))
    assert wrong.values[0] < -0.5
    (found,) = profile_intervals(wrong)
    a = np.linspace(-2.0, 2.0, 400_001)
    objective = ((1.0 - a**2) / 0.7) ** 2 + ((a - 0.5) / 2.0) ** 2
    assert found.found_better == pytest.approx(
        objective[a < 0.0].min() - objective[a > 0.0].min(), rel=1e-5
    )
    assert "the search found a better point than the fit" in found.sentence
    right = profile_intervals(fitted(problem))[0]
    assert right.found_better == 0.0
    # the barrier between the two modes is lower than the 95 % level
    assert right.low[0.95] < -0.5
    assert "several separate pieces" in found.sentence


@pytest.mark.slow
def test_ends_of_the_replicas_intervals_are_found_by_another_optimiser(replica: Path) -> None:
    """At each 95 % end scipy's SLSQP, from scattered starts, finds no lower objective than the
    quantile.
    """
    fit = fitted(load_campaign(replica / "campaign.toml").problem(["heavy-04"]))
    low = np.array([p.prior.low for p in fit.problem.parameters])
    sd = np.array([p.prior.sd for p in fit.problem.parameters])
    lowest = -2.0 * fit.posterior.log_density(fit.values[None])[0]
    rng = np.random.default_rng(2)
    for i, found in list(enumerate(profile_intervals(fit)))[:5]:
        rest = np.arange(6) != i

        def rise(z: np.ndarray, end: float, i: int = i, rest: np.ndarray = rest) -> float:
            values = fit.values.copy()
            values[rest] = z * sd[rest]
            values[i] = end
            with np.errstate(all="ignore"):  # a step may lead to a radius of 0
                height = -2.0 * fit.posterior.log_density(values[None])[0]
            return float(np.clip(height - lowest, None, 1e6))

        bounds = [(bottom, None) for bottom in (low / sd)[rest]]
        for end, opened in (
            (found.low[0.95], found.open_low[0.95]),
            (found.high[0.95], found.open_high[0.95]),
        ):
            starts = fit.values[rest] / sd[rest] + 0.3 * rng.standard_normal((4, 5))
            best = min(
                minimize(
                    rise,
                    np.maximum(start, 0.05),
                    (end,),
                    "SLSQP",
                    bounds=bounds,
                    options={"ftol": 1e-10},
                ).fun
                for start in starts
            )
            assert best == pytest.approx(chi2.ppf(0.95, 1), abs=5e-3) or (
                opened and best < chi2.ppf(0.95, 1)
            )
        assert opened is False


def test_names_and_probabilities_are_checked(rng: np.random.Generator) -> None:
    fit, *_ = linear(rng)
    assert [found.name for found in profile_intervals(fit, names=["b"])] == ["b"]
    with pytest.raises(InputError, match="must be one of a, b"):
        profile_intervals(fit, names=["c"])
    with pytest.raises(InputError, match="between 0 and 1"):
        profile_intervals(fit, probabilities=(95.0,))
    with pytest.raises(InputError, match="another parameter"):
        contour(fit, "a", "a")


def test_walks_of_all_parameters_together_are_those_of_each_alone(rng: np.random.Generator) -> None:
    """Two decays, whose walks need different numbers of points."""
    y = np.exp(-0.6 * X) + 0.5 * np.exp(-3.0 * X) + 0.05 * rng.standard_normal(X.size)
    priors = {
        "a": Uniform(0.0, 3.0),
        "k": Uniform(0.0, 8.0),
        "b": Uniform(0.0, 3.0),
        "q": Uniform(0.0, 8.0),
    }
    fit = fitted(
        formula_problem(
            lambda x, a, k, b, q: a * np.exp(-k * x) + b * np.exp(-q * x), X, y, 0.05, priors
        )
    )
    together = profile_intervals(fit)
    assert len({found.x.size for found in together}) > 1
    for found, sd in zip(
        together, search_of(fit.posterior, fit.values, fit.cov).scale, strict=True
    ):
        (alone,) = profile_intervals(fit, names=[found.name])
        for p in (0.68, 0.95):
            assert (alone.open_low[p], alone.open_high[p]) == (
                found.open_low[p],
                found.open_high[p],
            )
            assert alone.low[p] == pytest.approx(found.low[p], abs=1e-6 * sd)
            assert alone.high[p] == pytest.approx(found.high[p], abs=1e-6 * sd)


def test_runs_differentiated_each_in_its_own_parameters_give_the_whole_slope(replica: Path) -> None:
    """Against differences of the whole density, at the fit and beside it."""
    fit = fitted(load_campaign(replica / "campaign.toml").problem(["heavy-02", "heavy-04"]))
    search = search_of(fit.posterior, fit.values, fit.cov)
    assert len(fit.posterior.likelihoods) == 2
    points = np.clip(
        fit.values + np.array([[0.0], [0.4], [-0.3]]) * search.scale, search.low, search.high
    )
    steps = 2e-3 * np.diag(search.scale)
    for point, slope in zip(points, search.gradients(points), strict=True):
        inside = (point - search.low > 0.01 * search.scale) & (
            search.high - point > 0.01 * search.scale
        )
        up, down = search.objectives(point + steps), search.objectives(point - steps)
        np.testing.assert_allclose(
            slope[inside], ((up - down) / 4e-3)[inside], rtol=1e-3, atol=1e-3
        )


def test_profile_of_a_replica_run_takes_few_calls_of_the_density(
    replica: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Walks that waited for each other would take thousands."""
    fit = fitted(load_campaign(replica / "campaign.toml").problem(["heavy-04"]))
    calls, log_density = [], Posterior.log_density

    def counted(self: Posterior, draws: np.ndarray) -> np.ndarray:
        calls.append(len(draws))
        return log_density(self, draws)

    monkeypatch.setattr(Posterior, "log_density", counted)
    found = profile_intervals(fit)
    assert sum(interval.x.size for interval in found) > 90
    assert len(calls) < 80


@pytest.mark.parametrize("seed", [19, 33, 46])
def test_a_lowest_point_beside_an_edge_where_the_curve_is_not_defined_is_reached(seed: int) -> None:
    """v x/(k + x) at x = 0 is not a number for k = 0, and there is the lowest point where v is
    small.
    """
    y = X / (1.0 + X) + 0.4 * np.random.default_rng(seed).standard_normal(X.size)
    priors = {"v": Uniform(0.0, 20.0), "k": Uniform(0.0, 20.0)}

    def saturating(x, v, k):
        with np.errstate(invalid="ignore"):
            return v * x / (k + x)

    by_v = profile_intervals(fitted(formula_problem(saturating, X, y, 0.4, priors)))[0]
    k = np.geomspace(1e-9, 20.0, 20_001)
    curve = X / (k[:, None] + X)

    def lowest(v: float) -> float:
        return float(np.min(np.sum(((y - v * curve) / 0.4) ** 2, axis=1)))

    assert lowest(by_v.low[0.95]) - lowest(by_v.value) == pytest.approx(chi2.ppf(0.95, 1), abs=2e-3)
    assert by_v.n_failed == 0
