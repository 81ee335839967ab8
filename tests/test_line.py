"""The straight line by least squares: published values, limits, brute force, coverage.

Reference values: York et al. 2004, Am. J. Phys. 72, 367 and Pearson's data with York's weights
(three conventions of standard errors); ISO/TS 28037:2010 clause 6 examples; Hogg, Bovy and Lang
2010, arXiv 1008.4686, exercises 1 and 2; Bevington and Robinson table 6.1; GUM H.3 (JCGM 100:2008);
NIST StRD Norris.  The data files lie in tests/reference.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import optimize, stats

from estim.common.errors import InputError
from estim.line.conventions import CONVENTIONS
from estim.line.regression import (
    confidence_band,
    coverage_factor,
    fit_line,
    inverse_prediction,
    line_values,
    prediction_band,
)
from estim.line.slope_interval import slope_interval

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "tests" / "reference"


@pytest.fixture
def rng():
    return np.random.default_rng(20140328)


def columns(name, *, delimiter=",", skip=2, rows=None):
    """Columns of a reference file, below its header (a line of its source, and one of names) where
    it has one.
    """
    path = DATA / name
    return np.loadtxt(path, delimiter=delimiter, skiprows=skip, max_rows=rows).T


def pearson_york():
    x, y, w_x, w_y = columns("lines/pearson_york.csv")
    return x, y, w_x**-0.5, w_y**-0.5


def correlated_points(rng, n_obs=12):
    """Points with uneven, correlated errors."""
    truth = np.sort(rng.uniform(0.0, 5.0, n_obs))
    u_x, u_y, r = (
        rng.uniform(0.05, 0.4, n_obs),
        rng.uniform(0.05, 0.6, n_obs),
        rng.uniform(-0.8, 0.8, n_obs),
    )
    e_x = rng.standard_normal(n_obs)
    e_y = r * e_x + np.sqrt(1.0 - r**2) * rng.standard_normal(n_obs)
    return truth + u_x * e_x, 1.0 - 1.7 * truth + u_y * e_y, u_x, u_y, r


def load_benchmark() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "line_coverage", ROOT / "benchmarks" / "line_coverage.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# published values


def test_pearson_york_line_agrees_to_every_published_digit():
    x, y, u_x, u_y = pearson_york()
    fit = fit_line(x, y, u_x=u_x, u_y=u_y)
    assert fit.intercept == pytest.approx(5.47991022403, abs=6e-12)
    assert fit.slope == pytest.approx(-0.48053340745, abs=6e-12)
    assert fit.chi2 == pytest.approx(11.8663531941, abs=6e-11)
    assert (fit.dof, fit.method, fit.message) == (8, "york", "")
    assert fit.p_value == pytest.approx(stats.chi2.sf(11.8663531941, 8), rel=1e-9)


@pytest.mark.parametrize(
    ("convention", "u_intercept", "u_slope", "half_digit"),
    [
        ("york", 0.294970735, 0.0579850090, (6e-10, 6e-11)),
        ("propagated", 0.29193, 0.057617, (6e-6, 6e-7)),
        ("scaled", 0.359246523, 0.070620270, (6e-10, 6e-10)),
    ],
)
def test_pearson_york_standard_errors_agree_by_each_convention(
    convention, u_intercept, u_slope, half_digit
):
    x, y, u_x, u_y = pearson_york()
    error = fit_line(x, y, u_x=u_x, u_y=u_y).standard_errors[convention]
    assert error.u_intercept == pytest.approx(u_intercept, abs=half_digit[0])
    assert error.u_slope == pytest.approx(u_slope, abs=half_digit[1])
    assert convention in CONVENTIONS


def test_pearson_data_without_uncertainties_give_the_published_ordinary_line():
    x, y, _, _ = pearson_york()
    fit = fit_line(x, y)
    assert (fit.method, fit.recommended) == ("ols", "scaled")
    assert fit.intercept == pytest.approx(5.76118519, abs=6e-9)
    assert fit.slope == pytest.approx(-0.53957728, abs=6e-9)


@pytest.mark.parametrize(
    ("name", "line", "errors", "chi2", "y0", "x0"),
    [
        (
            "equal",
            (1.866667, 1.757143, 6e-7),
            (0.4654747, 0.1195229, -0.050),
            1.665,
            (10.5, 0.5),
            (4.913, 0.322),
        ),
        (
            "unequal",
            (0.8852, 2.0570, 6e-5),
            (0.5297081, 0.1778920, -0.08227848),
            4.131,
            (10.5, 1.0),
            (4.674, 0.533),
        ),
    ],
)
def test_iso_28037_examples_agree_with_inverse_prediction(name, line, errors, chi2, y0, x0):
    x, y, u_y = columns(f"lines/iso28037_sec6_{name}_weights.csv")
    fit = fit_line(x, y, u_y=u_y)
    error = fit.standard_errors["propagated"]
    assert (fit.method, fit.recommended) == ("weighted", "propagated")
    assert (fit.intercept, fit.slope) == pytest.approx(line[:2], abs=line[2])
    assert error[:2] == pytest.approx(errors[:2], abs=6e-8)
    assert error.cov == pytest.approx(errors[2], abs=6e-9)
    assert fit.chi2 == pytest.approx(chi2, abs=6e-4)
    found = inverse_prediction(fit, y0[0], u_y0=y0[1])
    assert found[:2] == pytest.approx(x0, abs=6e-4)


@pytest.mark.parametrize(
    ("first", "intercept", "slope", "chi2"),
    [
        (4, (34.04773, 18.24617), (2.23992, 0.10778), 18.681),
        (0, (213.27349, 14.39403), (1.07675, 0.07741), None),
    ],
)
def test_hogg_bovy_lang_exercises_agree(first, intercept, slope, chi2):
    _, x, y, u_y, _, _ = columns("lines/hogg_bovy_lang_2010_table1.csv")[:, first:]
    fit = fit_line(x, y, u_y=u_y)
    error = fit.standard_errors["propagated"]
    assert (fit.intercept, error.u_intercept) == pytest.approx(intercept, abs=6e-6)
    assert (fit.slope, error.u_slope) == pytest.approx(slope, abs=6e-6)
    if chi2 is not None:
        assert fit.chi2 == pytest.approx(chi2, abs=6e-4)
        assert (fit.dof, fit.recommended, fit.message) == (14, "propagated", "")
    else:  # the outliers are in: no headline from the stated uncertainties
        assert fit.recommended == "scaled"
        assert "Poor fit" in fit.message


def test_bevington_table_6_1_agrees():
    fit = fit_line(*columns("lines/bevington_table6.1.csv"))
    error = fit.standard_errors["scaled"]
    assert (fit.intercept, fit.slope) == pytest.approx((-0.222142, 0.992780), abs=6e-7)
    assert error.u_intercept == pytest.approx(0.06962967, abs=6e-9)
    assert error.u_slope == pytest.approx(0.002636608, abs=6e-10)
    assert error.cov == pytest.approx(-0.0001616271, abs=6e-11)


def test_gum_h3_thermometer_agrees_with_its_prediction_at_30_degrees():
    t, b = columns("gum/gum_h3_table_h6.csv")
    fit = fit_line(t - 20.0, b)
    error = fit.standard_errors["scaled"]
    assert (fit.intercept, error.u_intercept) == pytest.approx((-0.1712, 0.0029), abs=6e-5)
    assert (fit.slope, error.u_slope) == pytest.approx((0.00218, 0.00067), abs=6e-6)
    assert error.cov / (error.u_intercept * error.u_slope) == pytest.approx(-0.930, abs=6e-4)
    assert np.sqrt(fit.chi2 / fit.dof) == pytest.approx(0.0035, abs=6e-5)
    values, u = line_values(fit, 10.0)
    assert (values[0], u[0]) == pytest.approx((-0.1494, 0.0041), abs=6e-5)
    assert fit.dof == 9
    assert coverage_factor(fit, probability=0.95) == pytest.approx(stats.t.ppf(0.975, 9))


def test_nist_norris_certified_values_agree():
    y, x = columns("nist_strd/Norris.dat", delimiter=None, skip=60, rows=36)
    fit = fit_line(x, y)
    error = fit.standard_errors["scaled"]
    assert fit.intercept == pytest.approx(-0.262323073774029, rel=1e-11)
    assert fit.slope == pytest.approx(1.00211681802045, rel=1e-13)
    assert error[:2] == pytest.approx((0.232818234301152, 0.429796848199937e-3), rel=1e-11)
    assert fit.chi2 == pytest.approx(26.6173985294224, rel=1e-11)


# limits and properties


def test_exchanging_x_and_y_gives_the_reciprocal_slope(rng):
    for x, y, u_x, u_y, r in [(*pearson_york(), 0.0), correlated_points(rng)]:
        fit, exchanged = (
            fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r),
            fit_line(y, x, u_x=u_y, u_y=u_x, r_xy=r),
        )
        assert exchanged.slope * fit.slope == pytest.approx(1.0, abs=1e-10)
        assert exchanged.intercept == pytest.approx(-fit.intercept / fit.slope, rel=1e-10)
        assert exchanged.chi2 == pytest.approx(fit.chi2, rel=1e-12)
        for name, error in fit.standard_errors.items():
            assert exchanged.standard_errors[name].u_slope == pytest.approx(
                error.u_slope / fit.slope**2, rel=1e-9
            )
        there, back = slope_interval(fit), slope_interval(exchanged)
        assert (1.0 / back.high, 1.0 / back.low) == pytest.approx((there.low, there.high), rel=1e-9)


def test_units_shifts_and_order_of_points_do_not_matter(rng):
    x, y, u_x, u_y, r = correlated_points(rng)
    fit = fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r)
    order = rng.permutation(len(x))
    k_x, k_y, c_x, c_y = 1e-6, 250.0, 3.0, -70.0
    moved = fit_line(
        (k_x * x + c_x)[order],
        (k_y * y + c_y)[order],
        u_x=k_x * u_x[order],
        u_y=k_y * u_y[order],
        r_xy=r[order],
    )
    slope = fit.slope * k_y / k_x
    assert moved.slope == pytest.approx(slope, rel=1e-7)  # k_x x + 3 keeps 1e-16 * 3/1e-6 of x
    assert moved.intercept == pytest.approx(k_y * fit.intercept + c_y - slope * c_x, rel=1e-7)
    assert moved.chi2 == pytest.approx(fit.chi2, rel=1e-7)
    for name, error in fit.standard_errors.items():
        u_slope = moved.standard_errors[name].u_slope
        assert u_slope == pytest.approx(error.u_slope * k_y / k_x, rel=1e-7)
        at = (
            line_values(fit, x, convention=name),
            line_values(moved, k_x * x + c_x, convention=name),
        )
        assert at[1].u == pytest.approx(k_y * at[0].u, rel=1e-6)


def test_york_becomes_weighted_least_squares_as_x_becomes_exact(rng):
    x, y, _, u_y, _ = correlated_points(rng)
    weighted, york = fit_line(x, y, u_y=u_y), fit_line(x, y, u_x=0.0, u_y=u_y)
    solution, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(x), x]) / u_y[:, None], y / u_y)
    cov = np.linalg.inv(
        (np.column_stack([np.ones_like(x), x]) / u_y[:, None] ** 2).T
        @ np.column_stack([np.ones_like(x), x])
    )
    for fit in (weighted, york):
        assert (fit.intercept, fit.slope) == pytest.approx(solution, rel=1e-11)
        error = fit.standard_errors["propagated"]
        assert error[:3] == pytest.approx(
            (cov[0, 0] ** 0.5, cov[1, 1] ** 0.5, cov[0, 1]), rel=1e-10
        )
    assert york.standard_errors["york"] == pytest.approx(
        york.standard_errors["propagated"], rel=1e-9
    )


@pytest.mark.parametrize("slope", [1e-9, -1e-3, 1e5, -1e12])
def test_steep_and_flat_lines_are_found(rng, slope):
    truth = np.linspace(0.0, 1.0, 15)
    u_x, u_y = 0.01, 0.01 * abs(slope)
    x, y = (
        truth + u_x * rng.standard_normal(15),
        2.0 * slope + slope * truth + u_y * rng.standard_normal(15),
    )
    fit = fit_line(x, y, u_x=u_x, u_y=u_y)
    error = fit.standard_errors["propagated"]
    assert abs(fit.slope - slope) < 4.0 * error.u_slope < 0.2 * abs(slope)
    assert fit.message == ""


def test_a_vertical_line_is_told_in_words():
    fit = fit_line([1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 4.0], u_x=0.1, u_y=0.1)
    assert np.isinf(fit.slope)
    assert np.isnan(fit.intercept)
    assert np.isnan(fit.standard_errors["york"].u_slope)
    assert "vertical" in fit.message
    assert "Quote" not in str(fit)
    assert not np.isfinite(slope_interval(fit).high)
    flat = fit_line([0.0, 1.0, 2.0, 4.0], [1.0, 1.0, 1.0, 1.0], u_x=0.1, u_y=0.1)
    assert flat.slope == pytest.approx(0.0, abs=1e-12)
    assert (flat.intercept, flat.message) == (pytest.approx(1.0), "")


def test_points_that_prefer_no_direction_are_told_in_words():
    fit = fit_line([0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0], u_x=0.5, u_y=0.5)
    assert "direction" in fit.message
    assert "vertical" in slope_interval(fit).message


def test_points_exactly_on_a_line_give_it_back():
    x = np.arange(6.0)
    for u in ({}, {"u_y": 0.1}, {"u_x": 0.1, "u_y": 0.2, "r_xy": 0.5}):
        fit = fit_line(x, 3.0 - 0.5 * x, **u)
        assert (fit.intercept, fit.slope) == pytest.approx((3.0, -0.5), rel=1e-13)
        assert fit.chi2 == pytest.approx(0.0, abs=1e-20)
        assert slope_interval(fit, convention="scaled")[:2] == pytest.approx((-0.5, -0.5), rel=1e-9)


def test_points_exact_in_one_coordinate_are_allowed():
    x, y = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.1, 0.9, 2.2, 2.9])
    u_x, u_y = np.array([0.0, 0.1, 0.1, 0.0]), np.array([0.1, 0.0, 0.1, 0.2])
    fit = fit_line(x, y, u_x=u_x, u_y=u_y)
    near = fit_line(x, y, u_x=u_x + 1e-7, u_y=u_y + 1e-7)
    assert (fit.slope, fit.intercept, fit.chi2) == pytest.approx(
        (near.slope, near.intercept, near.chi2), rel=1e-4
    )
    only_x = fit_line(x, y, u_x=0.1)
    inverse = fit_line(y, x, u_y=0.1)
    assert only_x.slope == pytest.approx(1.0 / inverse.slope, rel=1e-12)


@pytest.mark.parametrize("least", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("both", [False, True])
def test_one_very_precise_point_is_one_that_the_line_passes_through(rng, least, both):
    x = np.arange(10.0)
    y = 2.0 + 0.5 * x + 0.1 * rng.standard_normal(10)
    u = np.append(least, np.full(9, 0.1))
    fit = fit_line(x, y, u_y=u, u_x=1e-3 * u if both else None)
    slope = np.sum(x * (y - y[0])) / np.sum(x**2)
    u_slope = 0.1 / np.sqrt(np.sum(x**2))
    assert (fit.intercept, fit.slope) == pytest.approx((y[0], slope), rel=1e-6)
    errors = fit.standard_errors["propagated"]
    assert (errors.u_intercept, errors.u_slope) == pytest.approx((least, u_slope), rel=1e-5)


# independent answers


def test_joint_fit_of_line_and_latent_abscissas_gives_the_same_minimum(rng):
    for _ in range(5):
        x, y, u_x, u_y, r = correlated_points(rng)

        def residuals(p, x=x, y=y, u_x=u_x, u_y=u_y, r=r):
            e_x, e_y = (x - p[2:]) / u_x, (y - p[0] - p[1] * p[2:]) / u_y
            return np.concatenate([e_x, (e_y - r * e_x) / np.sqrt(1.0 - r**2)])

        brute = optimize.least_squares(
            residuals, np.concatenate([[1.0, -1.7], x]), xtol=1e-15, ftol=1e-15, gtol=1e-12
        )
        fit = fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r)
        assert fit.chi2 == pytest.approx(2.0 * brute.cost, rel=1e-10)
        assert (fit.intercept, fit.slope) == pytest.approx(brute.x[:2], rel=1e-6)


def test_no_direction_has_a_lower_sum_than_the_fit(rng):
    angles = np.linspace(-np.pi / 2, np.pi / 2, 20001)[1:-1]
    slopes = np.tan(angles)[:, None]
    # points without a line in them, uncertainties over three decades: several minima
    for _ in range(100):
        n_obs = int(rng.integers(3, 8))
        x, y = rng.standard_normal((2, n_obs))
        u_x, u_y = 10.0 ** rng.uniform(-2.5, 0.5, (2, n_obs))
        r = rng.uniform(-0.99, 0.99, n_obs)
        w = 1.0 / (u_y**2 - 2.0 * slopes * r * u_x * u_y + slopes**2 * u_x**2)
        residual = y - slopes * x
        centre = (w * residual).sum(axis=1) / w.sum(axis=1)
        brute = float(np.min((w * (residual - centre[:, None]) ** 2).sum(axis=1)))
        assert fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r).chi2 <= brute * (1.0 + 1e-9)


def test_propagated_covariance_is_that_of_refits_with_each_datum_moved(rng):
    x, y, u_x, u_y, r = correlated_points(rng)
    fit = fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r)

    def derivative(of_x):
        rows = []
        for k in range(len(x)):
            step = np.zeros(len(x))
            step[k] = 1e-5
            ends = [
                fit_line(x + s * of_x * step, y + s * (1 - of_x) * step, u_x=u_x, u_y=u_y, r_xy=r)
                for s in (1.0, -1.0)
            ]
            rows.append(
                [
                    (ends[0].intercept - ends[1].intercept) / 2e-5,
                    (ends[0].slope - ends[1].slope) / 2e-5,
                ]
            )
        return np.array(rows)

    by_x, by_y = derivative(1), derivative(0)
    both = (by_x * (r * u_x * u_y)[:, None]).T @ by_y
    cov = (by_x * u_x[:, None] ** 2).T @ by_x + (by_y * u_y[:, None] ** 2).T @ by_y + both + both.T
    error = fit.standard_errors["propagated"]
    assert error[:3] == pytest.approx((cov[0, 0] ** 0.5, cov[1, 1] ** 0.5, cov[0, 1]), rel=1e-6)


@pytest.mark.parametrize("convention", ["propagated", "scaled"])
def test_ends_of_the_slope_interval_are_rejected_at_exactly_the_stated_probability(rng, convention):
    x, y, u_x, u_y, r = correlated_points(rng, n_obs=6)
    fit = fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r)
    interval = slope_interval(fit, probability=0.9, convention=convention)
    assert interval.low < fit.slope < interval.high
    # regress the residual on the abscissa that is independent of it: no dependence if b is true
    for b in interval[:2]:
        v = u_y**2 - 2.0 * b * r * u_x * u_y + b**2 * u_x**2
        d = y - b * x
        d = d - np.average(d, weights=1.0 / v)
        z = x - (r * u_x * u_y - b * u_x**2) / v * d
        design = np.column_stack([np.ones_like(z), z]) / np.sqrt(v)[:, None]
        solution, rest, *_ = np.linalg.lstsq(design, d / np.sqrt(v))
        t = abs(solution[1]) / np.sqrt(np.linalg.inv(design.T @ design)[1, 1])
        if convention == "scaled":
            assert t / np.sqrt(rest[0] / fit.dof) == pytest.approx(
                stats.t.ppf(0.95, fit.dof), rel=1e-8
            )
        else:
            assert t == pytest.approx(stats.norm.ppf(0.95), rel=1e-8)


def test_slope_interval_is_the_classical_one_for_exact_x(rng):
    x, y, _, u_y, _ = correlated_points(rng)
    for fit in (fit_line(x, y), fit_line(x, y, u_y=u_y), fit_line(x, y, u_y=0.01 * u_y)):
        half = coverage_factor(fit, probability=0.95) * fit.standard_errors[fit.recommended].u_slope
        assert slope_interval(fit)[:2] == pytest.approx(
            (fit.slope - half, fit.slope + half), rel=1e-9
        )
    assert fit.recommended == "scaled"  # the last one, whose uncertainties are far too small


def test_bands_are_the_line_with_the_named_uncertainties(rng):
    x, y, u_x, u_y, r = correlated_points(rng)
    fit = fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r)
    error, at, k = fit.standard_errors["york"], np.array([-1.0, 0.0, 7.0]), stats.norm.ppf(0.84)
    u2 = error.u_intercept**2 + at**2 * error.u_slope**2 + 2.0 * at * error.cov
    band = confidence_band(fit, at, probability=0.68, convention="york")
    assert band.high - band.centre == pytest.approx(k * np.sqrt(u2), rel=1e-10)
    wide = prediction_band(fit, at, probability=0.68, u_y=0.3, u_x=0.2, convention="york")
    assert wide.centre - wide.low == pytest.approx(
        k * np.sqrt(u2 + 0.3**2 + (0.2 * fit.slope) ** 2), rel=1e-10
    )
    ols = fit_line(x, y)
    spread = prediction_band(ols, at).high - ols.intercept - ols.slope * at
    expected = stats.t.ppf(0.975, ols.dof) * np.hypot(
        line_values(ols, at).u, np.sqrt(ols.chi2 / ols.dof)
    )
    assert spread == pytest.approx(expected, rel=1e-10)
    with pytest.raises(ValueError, match="read-only"):
        band.low[0] = 0.0


# statistics


@pytest.mark.statistics
def test_intervals_of_york_hold_their_probability_and_the_naive_likelihood_does_not():
    benchmark = load_benchmark()
    n_repeat = 150
    limits = [3.0 * (p * (1.0 - p) / n_repeat) ** 0.5 for p in benchmark.PROBABILITIES]
    for k, cell in enumerate((benchmark.Cell(0.1, 8), benchmark.Cell(0.1, 40))):
        shares = benchmark.coverage(cell, n_repeat=n_repeat, rng=np.random.default_rng([11, k]))
        for method in ("propagated", "scaled", "Bayesian"):
            for parameter in ("slope", "intercept"):
                assert np.all(
                    np.abs(shares[method, parameter] - benchmark.PROBABILITIES) < limits
                ), (method, parameter, cell)
        for method in ("slope_interval", "slope_interval, scaled"):
            assert np.all(np.abs(shares[method, "slope"] - benchmark.PROBABILITIES) < limits), (
                method,
                cell,
            )
    # of the 40 points
    assert np.all(
        shares["naive", "slope"] < np.array(benchmark.PROBABILITIES) - 2.0 * np.array(limits)
    )


@pytest.mark.statistics
def test_york_2004_errors_are_too_small_where_both_uncertainties_are_large(rng):
    # predicted: var(true x) is 1/12, that of an adjusted abscissa about it u^2/2: too small by 1 +
    # 6 u^2, so 62 % are held
    truth, u = np.linspace(0.0, 1.0, 40), 0.15
    held = {"york": 0, "propagated": 0, "exact": 0}
    n_repeat = 2000
    for _ in range(n_repeat):
        fit = fit_line(
            truth + u * rng.standard_normal(40), truth + u * rng.standard_normal(40), u_x=u, u_y=u
        )
        for name in ("york", "propagated"):
            held[name] += abs(fit.slope - 1.0) < fit.standard_errors[name].u_slope
        interval = slope_interval(fit, probability=stats.chi2.cdf(1.0, 1), convention="propagated")
        held["exact"] += interval.low < 1.0 < interval.high
    p, sd = stats.chi2.cdf(1.0, 1), (0.6827 * 0.3173 / n_repeat) ** 0.5
    assert held["york"] / n_repeat < p - 3.0 * sd
    assert (
        abs(held["york"] / n_repeat - stats.chi2.cdf(1.0 / (1.0 + 6.0 * u**2) ** 2, 1)) < 3.0 * sd
    )
    assert abs(held["propagated"] / n_repeat - p) < 3.0 * sd
    assert abs(held["exact"] / n_repeat - p) < 3.0 * sd


@pytest.mark.slow
def test_sum_follows_chi_squared_when_the_uncertainties_are_right(rng):
    p_values = []
    for _ in range(400):
        truth = rng.uniform(0.0, 1.0, 10)
        x, y = truth + 0.03 * rng.standard_normal(10), truth + 0.05 * rng.standard_normal(10)
        p_values.append(fit_line(x, y, u_x=0.03, u_y=0.05).p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


# mistakes


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"y": [1.0, 2.0]}, "'y' must have as many values as x"),
        ({"x": [1.0, 2.0], "y": [1.0, 2.0]}, "'x' must have at least 3 points"),
        ({"y": [1.0, np.nan, 2.0, 3.0]}, "'y' must be finite: nan"),
        ({"y": ["a", "b", "c", "d"]}, "'y' must be numbers"),
        ({"x": [[0.0, 1.0, 2.0, 3.0]]}, "'x' must be one-dimensional"),
        ({"u_y": [0.1, 0.1]}, "'u_y' must be one number or 4 values"),
        ({"u_y": -0.1}, "'u_y' must be >= 0: -0.1"),
        ({"u_y": 0.0}, "must not both be 0"),
        ({"u_x": 0.1, "u_y": 0.1, "r_xy": 1.0}, "'r_xy' must lie between -1 and 1: 1.0"),
        ({"u_y": 0.1, "r_xy": 0.5}, "'r_xy' needs both u_x and u_y"),
        (
            {"u_x": [0.0, 0.1, 0.1, 0.1], "u_y": [0.0, 0.1, 0.1, 0.1]},
            "must not both be 0 (value number 1)",
        ),
        ({"x": [1.0, 1.0, 1.0, 1.0]}, "'x' must not all be equal: 1.0"),
        ({"x": [1.0] * 4, "y": [2.0] * 4, "u_x": 0.1, "u_y": 0.1}, "'x' must not all be equal"),
        ({"y": [1.0] * 4, "u_x": 0.1}, "'y' must not all be equal where y is exact"),
    ],
)
def test_bad_points_are_refused_with_field_rule_and_value(arguments, words):
    points = {"x": [0.0, 1.0, 2.0, 3.0], "y": [0.0, 1.1, 1.9, 3.2]} | arguments
    with pytest.raises(InputError) as caught:
        fit_line(points.pop("x"), points.pop("y"), **points)
    assert words in str(caught.value)


def test_bad_choices_are_refused():
    fit = fit_line([0.0, 1.0, 2.0], [0.0, 1.1, 1.9], u_y=0.1)
    with pytest.raises(InputError, match="'convention' must be one of propagated, scaled"):
        confidence_band(fit, 1.0, convention="york")
    with pytest.raises(InputError, match="'probability' must lie between 0 and 1"):
        confidence_band(fit, 1.0, probability=95)
    with pytest.raises(InputError, match="'u_y0' must be given"):
        inverse_prediction(fit, 1.0)
    with pytest.raises(InputError, match="'u_y' must be >= 0"):
        prediction_band(fit, 1.0, u_y=-1.0)
    with pytest.raises(InputError, match="no inverse"):
        inverse_prediction(fit_line([0.0, 1.0, 2.0], [1.0, 1.0, 1.0], u_y=0.1), 1.0, u_y0=0.1)


def test_nobody_can_change_a_fit():
    x = np.array([0.0, 1.0, 2.0])
    fit = fit_line(x, [0.0, 1.1, 1.9], u_y=0.1)
    x[0] = 5.0
    assert fit.data.x[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        fit.data.x[0] = 1.0
    with pytest.raises(TypeError):
        fit.standard_errors["york"] = None


@pytest.mark.parametrize("u_x", [None, 1e-3])
def test_scatter_that_is_almost_too_large_is_not_passed_over(u_x: float | None) -> None:
    x, turns = np.arange(10.0), (-1.0) ** np.arange(10)
    for size, low in ((1.0, False), (1.35, True)):
        fit = fit_line(x, x + 0.1 * size * turns, u_x=u_x, u_y=0.1)
        assert (fit.p_value < 0.05) is low
        assert fit.p_value > 0.001
        assert fit.recommended == "propagated"
        assert ("not below the threshold of 0.001" in fit.reason) is low
        assert ("does not contradict" in fit.reason or "S agrees" in fit.reason) is not low


def test_with_few_points_and_no_uncertainties_the_standard_error_holds_less_than_it_seems() -> None:
    few = fit_line([0.0, 1.0, 2.0], [0.0, 1.1, 1.9])
    assert "contains the true value in 50 % of such experiments" in few.reason
    assert coverage_factor(few, probability=0.68) == pytest.approx(1.82, abs=0.01)
    assert "contains the true value in 50 % of such experiments" in few._repr_markdown_()
    many = np.arange(20.0)
    assert "experiments" not in fit_line(many, np.sin(many)).reason
    assert "nothing indicates how large the errors are" in fit_line(many, 0.1 + 0.3 * many).reason
