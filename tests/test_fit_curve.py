"""A user's own curve from points to a result: closed-form answers, recovery, calibration,
refusals.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import optimize, special

from estim import Component, InputError, fit_curve
from estim.curves.function import wrap_function
from estim.curves.units import AxisNames
from estim.fitting import Fit
from estim.fitting.unconstrained import silent_parameters
from estim.pipeline import sample_curve
from estim.problem.priors import Flat, Normal, Uniform
from estim.reports.curve import curve_report
from estim.sampling.chain import Target

LINE = "a + b*x"
T = np.linspace(0.0, 10.0, 41)


def normal_equations(
    design: np.ndarray, y: np.ndarray, cov: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    inverse = np.linalg.inv(cov)
    information = design.T @ inverse @ design
    return np.linalg.solve(information, design.T @ inverse @ y), np.linalg.inv(information)


def test_a_line_with_stated_errors_is_the_weighted_mean_of_the_textbook(
    rng: np.random.Generator,
) -> None:
    u = rng.uniform(0.1, 0.5, T.size)
    y = 2.0 + 0.3 * T + u * rng.standard_normal(T.size)
    shuffled = rng.permutation(T.size)
    fit = fit_curve(LINE, T[shuffled], y[shuffled], start={"b": 9.0, "a": -5.0}, u_y=u[shuffled])
    values, cov = normal_equations(np.column_stack([T, np.ones_like(T)]), y, np.diag(u**2))
    np.testing.assert_allclose([fit.values["b"], fit.values["a"]], values, rtol=1e-12)
    np.testing.assert_allclose(fit.cov, cov, rtol=1e-10)
    assert fit.names == ("b", "a")
    assert fit.chi2 == pytest.approx(
        np.sum(((y - 2.0 - 0.3 * T - (values - [0.3, 2.0]) @ [T, np.ones_like(T)]) / u) ** 2)
    )
    assert fit.dof == T.size - 2
    assert fit.status == "ok"
    assert fit.sigma is None


def test_without_stated_errors_their_size_comes_from_the_residuals(
    rng: np.random.Generator,
) -> None:
    y = 2.0 + 0.3 * T + 0.2 * rng.standard_normal(T.size)
    fit = fit_curve(LINE, T, y, start={"a": 0.0, "b": 0.0})
    coefficients, cov = np.polyfit(T, y, 1, cov=True)
    np.testing.assert_allclose([fit.values["b"], fit.values["a"]], coefficients, rtol=1e-11)
    np.testing.assert_allclose([fit.sds["b"], fit.sds["a"]], np.sqrt(np.diag(cov)), rtol=1e-9)
    assert math.isnan(fit.p_value)
    assert fit.sigma == pytest.approx(math.sqrt(fit.chi2 / fit.dof))
    assert "estimated" in str(fit)
    assert "estimated" in fit._repr_markdown_()


def test_a_covariance_matrix_weighs_as_the_general_least_squares_do(
    rng: np.random.Generator,
) -> None:
    cov = 0.04 * np.exp(-np.abs(T[:, None] - T) / 2.0) + 0.01 * np.eye(T.size)
    y = 2.0 + 0.3 * T + np.linalg.cholesky(cov) @ rng.standard_normal(T.size)
    fit = fit_curve(LINE, T, y, start={"a": 0.0, "b": 0.0}, cov_y=cov)
    values, expected = normal_equations(np.column_stack([np.ones_like(T), T]), y, cov)
    np.testing.assert_allclose(list(fit.values.values()), values, rtol=1e-10)
    np.testing.assert_allclose(fit.cov, expected, rtol=1e-8)
    blind = fit_curve(LINE, T, y, start={"a": 0.0, "b": 0.0}, u_y=np.sqrt(np.diag(cov)))
    assert blind.sds["a"] < 0.6 * fit.sds["a"]  # the wrong model claims too much


def test_shared_errors_are_the_covariance_they_stand_for(rng: np.random.Generator) -> None:
    y = 2.0 + 0.3 * T + 0.1 * rng.standard_normal(T.size)
    fit = fit_curve(
        LINE, T, y, start={"a": 1.0, "b": 1.0}, u_y=0.1, errors=[Component("zero_y", 0.5, "offset")]
    )
    _, cov = normal_equations(
        np.column_stack([np.ones_like(T), T]), y, 0.01 * np.eye(T.size) + 0.25
    )
    np.testing.assert_allclose(fit.cov[:2, :2], cov, rtol=1e-8)
    assert fit.names == ("a", "b", "offset")
    assert fit.sds["a"] > 0.5 > 10.0 * fit.sds["b"]


def held_line(x, a, b):
    return a + b * x


@pytest.mark.parametrize("curve", [LINE, held_line])
@pytest.mark.parametrize("u_y", [0.2, None])
def test_a_fixed_parameter_is_the_line_with_its_value_taken_off(
    curve, u_y: float | None, rng: np.random.Generator
) -> None:
    y = 2.0 + 0.3 * T + 0.2 * rng.standard_normal(T.size)
    fit = fit_curve(curve, T, y, start={"b": 1.0}, fixed={"a": 2.5}, u_y=u_y)
    slope, residual = float(T @ (y - 2.5) / (T @ T)), y - 2.5 - float(T @ (y - 2.5) / (T @ T)) * T
    sigma = 0.2 if u_y else math.sqrt(float(residual @ residual) / (T.size - 1))
    assert (fit.names, dict(fit.fixed), fit.dof) == (("b",), {"a": 2.5}, T.size - 1)
    assert fit.values["b"] == pytest.approx(slope, rel=1e-9)
    assert fit.sds["b"] == pytest.approx(sigma / math.sqrt(float(T @ T)), rel=1e-6)
    free = fit_curve(curve, T, y, start={"a": 2.0, "b": 1.0}, u_y=u_y)
    assert free.values["b"] != pytest.approx(slope, rel=0.05)
    assert "a = 2.5 (fixed)" in str(fit)
    assert "a = 2.5 (fixed)" in fit._repr_markdown_()


@pytest.mark.usefixtures("undrawn")
def test_a_report_lists_what_was_fixed(rng: np.random.Generator) -> None:
    y = 2.0 + 0.3 * T + 0.2 * rng.standard_normal(T.size)
    fit = fit_curve(LINE, T, y, start={"b": 1.0}, fixed={"a": 2.0}, u_y=0.2)
    analysis = sample_curve(fit, seed=1, target=Target(ess=100.0, max_step=100))
    files = curve_report(fit, analysis, title="a line through a known point", kind="synthetic")
    assert json.loads(files["result.json"])["runs"]["data"]["facts"] == ["a is fixed at 2"]
    assert "a is fixed at 2" in files["report.md"].decode()


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        (
            {"priors": {"b": 0.3}},
            r"^'priors\[b\]' must be a prior, or text like .* \(an exact value is held by "
            r"fixed=\{'b': 0.3\}\): 0.3$",
        ),
        ({"priors": {"b": (0.3, 0.1)}}, r"^'priors\[b\]' must be a prior"),
        ({"priors": {"b": Normal}}, r"^'priors\[b\]' must be a prior"),
        ({"priors": {"b": "0.3"}}, "must have an uncertainty.*goes into `fixed`"),
        ({"priors": ["b"]}, "^'priors' must be a mapping"),
        ({"bounds": [(0.0, 1.0)]}, "^'bounds' must be a mapping"),
        ({"units": {"b": 1}}, "^'units' must be text for 'b'"),
        ({"errors": ["zero_y"]}, "^'errors' must be a list of components"),
        ({"axes": "time"}, "^'axes' must be names and units"),
        ({"fixed": {"b": 1.0}}, "^'fixed' names 'b', which has a starting value too"),
        ({"fixed": {"k": 1.0}}, "^'fixed' names 'k', which is not in the formula"),
        ({"fixed": 3.0}, "^'fixed' must be a mapping"),
        (
            {"start": {"b": 1.0}, "fixed": {"a": "2.0(1)"}},
            r"^'fixed' must be a finite number for 'a' \(a value with an uncertainty is a prior\)",
        ),
        ({"start": {"b": 1.0}, "fixed": {"a": math.nan}}, "^'fixed' must be a finite number"),
        (
            {"start": {"b": 1.0}, "fixed": {"a": 1.0}, "bounds": {"a": (0.0, 2.0)}},
            "^'bounds' names 'a', which is fixed",
        ),
        (
            {"start": {"b": 1.0}, "fixed": {"a": 1.0}, "priors": {"a": "1.0(2)"}},
            "^'priors' names 'a', which is fixed",
        ),
        (
            {"start": {"b": 1.0}, "fixed": {"a": 1.0}, "errors": [Component("zero_y", 0.1, "a")]},
            "has a name that is taken",
        ),
    ],
)
def test_a_choice_of_another_kind_is_refused_in_one_line(
    choice: dict[str, object], says: str
) -> None:
    with pytest.raises(InputError, match=says) as caught:
        fit_curve(LINE, T, 2.0 + 0.3 * T, **{"start": {"a": 1.0, "b": 1.0}, "u_y": 0.1, **choice})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "u", "share"), [("scale_y", 0.02, 1.0), ("scale_x", 0.02, 1.0), ("zero_x", 0.3, None)]
)
def test_a_shared_error_reaches_the_parameter_it_acts_on(
    kind: str, u: float, share: float | None
) -> None:
    y = 3.0 * np.exp(-T / 4.0)
    plain = fit_curve("a*exp(-x/tau)", T, y, start={"a": 1.0, "tau": 1.0}, u_y=1e-4)
    fit = fit_curve(
        "a*exp(-x/tau)", T, y, start={"a": 1.0, "tau": 1.0}, u_y=1e-4, errors=[Component(kind, u)]
    )
    name = "tau" if kind == "scale_x" else "a"
    expected = u * share if share else u / 4.0  # a exp(x0/tau)
    assert fit.sds[name] / fit.values[name] == pytest.approx(expected, rel=1e-2)
    assert plain.sds[name] / plain.values[name] < 0.01 * expected
    assert fit.values[name] == pytest.approx(plain.values[name], rel=1e-6)


def test_a_prior_and_the_data_share_the_work() -> None:
    y = np.full(T.size, 5.0)
    fit = fit_curve(
        "a + 0*x",
        T,
        y,
        start={"a": 0.0},
        u_y=math.sqrt(T.size) * 0.2,
        priors={"a": Normal(4.0, 0.1)},
    )
    assert fit.values["a"] == pytest.approx((5.0 / 0.04 + 4.0 / 0.01) / (1 / 0.04 + 1 / 0.01))
    assert fit.sds["a"] == pytest.approx((1 / 0.04 + 1 / 0.01) ** -0.5)
    assert fit.dof == T.size
    text = fit_curve(
        "a + 0*x", T, y, start={"a": 0.0}, u_y=math.sqrt(T.size) * 0.2, priors={"a": "4.00(10)"}
    )
    assert text.values == fit.values


def test_with_a_prior_the_estimated_size_of_the_errors_settles(rng: np.random.Generator) -> None:
    y = 5.0 + 0.2 * rng.standard_normal(T.size)
    fit = fit_curve("a + 0*x", T, y, start={"a": 0.0}, priors={"a": Normal(4.9, 0.05)})
    weight = T.size / fit.sigma**2
    assert fit.values["a"] == pytest.approx(
        (np.mean(y) * weight + 4.9 / 0.0025) / (weight + 1 / 0.0025)
    )
    assert fit.sigma == pytest.approx(math.sqrt(np.sum((y - fit.values["a"]) ** 2) / T.size))


@pytest.mark.slow
def test_a_frequency_far_from_the_start_is_found(rng: np.random.Generator) -> None:
    y = 3.0 * np.exp(-0.1 * T) * np.cos(4.0 * T + 0.5) + 0.1 * rng.standard_normal(T.size)
    for start in (1.0, 9.0):
        fit = fit_curve(
            "a*exp(-b*x)*cos(w*x + p)",
            T,
            y,
            start={"a": 1.0, "b": 0.3, "w": start, "p": 0.0},
            u_y=0.1,
        )
        assert fit.status == "ok"
        assert abs(fit.values["w"] - 4.0) < 4 * fit.sds["w"] < 0.1
        # not its mirror image, -3 with the phase turned
        assert fit.values["a"] == pytest.approx(3.0, abs=4 * fit.sds["a"])


def test_exchanged_exponentials_keep_the_order_of_the_start() -> None:
    y = 2.0 * np.exp(-0.2 * T) + 3.0 * np.exp(-1.5 * T)
    for start in ({"p": 0.1, "q": 3.0}, {"p": 3.0, "q": 0.1}):
        fit = fit_curve(
            "a*exp(-p*x) + b*exp(-q*x)", T, y, start={"a": 1.0, "b": 1.0} | start, u_y=1e-3
        )
        assert (fit.values["p"] < fit.values["q"]) == (start["p"] < start["q"])
        assert sorted((fit.values["p"], fit.values["q"])) == pytest.approx([0.2, 1.5])


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_units_do_not_matter(rng: np.random.Generator, scale: float) -> None:
    y = 3.0 * np.exp(-T / 4.0) + 1.0 + 0.05 * rng.standard_normal(T.size)
    one = fit_curve("a*exp(-x/tau) + c", T, y, start={"a": 1.0, "tau": 20.0, "c": 0.0})
    other = fit_curve(
        "a*exp(-x/tau) + c", T / scale, y * scale, start={"a": scale, "tau": 20.0 / scale, "c": 0.0}
    )
    assert other.values["tau"] * scale == pytest.approx(one.values["tau"], rel=1e-8)
    assert other.sds["a"] / scale == pytest.approx(one.sds["a"], rel=1e-6)
    assert other.status == one.status


@pytest.mark.statistics
def test_intervals_cover_what_they_promise() -> None:
    hits = {"right": 0, "wrong": 0}
    truth, n = {"a": 3.0, "tau": 4.0, "c": 1.0}, 100
    for seed in range(n):
        noise = np.random.default_rng(seed).standard_normal(15)
        x = np.linspace(0.0, 12.0, 15)
        y = 3.0 * np.exp(-x / 4.0) + 1.0 + 0.1 * noise
        for claimed, key in ((0.1, "right"), (0.04, "wrong")):
            fit = fit_curve(
                "a*exp(-x/tau) + c",
                x,
                y,
                start={"a": 2.0, "tau": 3.0, "c": 0.0},
                u_y=claimed,
                scan=False,
            )
            hits[key] += abs(fit.values["tau"] - truth["tau"]) < fit.sds["tau"]
    expected, sd = 0.683 * n, math.sqrt(n * 0.683 * 0.317)
    assert abs(hits["right"] - expected) < 3.5 * sd
    assert abs(hits["wrong"] - expected) > 5 * sd


def test_a_curve_that_does_not_fit_is_not_ok(rng: np.random.Generator) -> None:
    y = 2.0 + 0.1 * (T - 5.0) ** 2 + 0.05 * rng.standard_normal(T.size)
    stated = fit_curve(LINE, T, y, start={"a": 0.0, "b": 0.0}, u_y=0.05)
    assert stated.status == "poor-fit"
    assert stated.p_value < 1e-10
    unstated = fit_curve(LINE, T, y, start={"a": 0.0, "b": 0.0})
    assert unstated.status == "poor-fit"
    right = fit_curve("a + b*x + c*x**2", T, y, start={"a": 0.0, "b": 0.0, "c": 0.0}, u_y=0.05)
    assert right.status == "ok"


def test_what_the_data_do_not_determine_gets_no_standard_deviation() -> None:
    fit = fit_curve("a*b*x", T, 2.0 * T, start={"a": 1.0, "b": 1.0}, u_y=0.1)
    assert fit.status == "not-identified"
    assert all(math.isnan(sd) for sd in fit.sds.values())
    with pytest.raises(InputError, match="cannot be sampled"):
        sample_curve(fit, seed=1)


def test_a_limit_is_reported_as_a_limit(rng: np.random.Generator) -> None:
    y = 2.0 - 0.3 * T + 0.1 * rng.standard_normal(T.size)
    wrong = fit_curve(LINE, T, y, start={"a": 1.0, "b": 1.0}, u_y=0.1, bounds={"b": (0.0, None)})
    assert wrong.status == "poor-fit"  # a limit from a curve that does not fit is none
    level = y - (fit_curve(LINE, T, y, start={"a": 1.0, "b": 1.0}).values["b"] + 1e-3) * T
    assert any(
        "b lies at its limit 0, and the data favour values beyond it" in reason
        for reason in wrong.reasons
    )
    fit = fit_curve(LINE, T, level, start={"a": 1.0, "b": 1.0}, u_y=0.1, bounds={"b": (0.0, None)})
    assert fit.status == "ok"  # where a value belongs that is no larger than its error
    assert math.isnan(fit.sds["b"])
    assert fit.values["b"] == pytest.approx(0.0, abs=1e-6)
    assert "b lies at its limit 0: it has no standard deviation; use its interval" in fit.notes
    edge = fit_curve(LINE, T, y, start={"a": 1.0, "b": 1.0}).values["b"] - 1e-4
    near = fit_curve(LINE, T, y, start={"a": 1.0, "b": 1.0}, u_y=0.1, bounds={"b": (edge, None)})
    assert near.status == "ok"
    assert math.isnan(near.sds["b"])
    assert any(
        note.startswith("b is less than one standard deviation from its limit")
        for note in near.notes
    )


@pytest.mark.parametrize("estimated", [False, True])
def test_an_amplitude_of_0_at_its_limit_does_not_take_the_others_intervals_away(
    estimated: bool,
) -> None:
    """Where A = 0 is best the curve does not depend on t, but the limits of t are known, and with
    them what A and c can be: as where rounding left 1e-9 of A.
    """
    x = np.linspace(0.0, 10.0, 60)
    y = 2.0 + 0.1 * np.random.default_rng(3).standard_normal(60)
    exact, rounded = (
        fit_curve(
            "c + A*exp(-x/t)",
            x,
            y,
            u_y=None if estimated else 0.1,
            bounds={"A": (least, None), "t": (0.5, 5.0)},
        )
        for least in (0.0, 1e-9)
    )
    assert exact.values["A"] == 0.0
    assert exact.status == rounded.status == "ok"
    assert exact.intervals["t"][0.95] == (0.5, 5.0)
    for name in ("A", "c"):
        assert exact.intervals[name][0.95] == pytest.approx(rounded.intervals[name][0.95], abs=1e-3)
    silent = fit_curve(
        "c + A*exp(-x/3) + 0*b", x, y, u_y=0.1, bounds={"A": (0.0, None), "b": (0.5, 5.0)}
    )
    assert silent.status == "not-identified"


def test_a_place_that_an_amplitude_of_0_hides_is_not_said_to_lie_at_a_limit() -> None:
    x = np.linspace(0.0, 10.0, 60)
    y = 2.0 + 0.1 * np.random.default_rng(25).standard_normal(60)
    bounds, start = {"A": (0.0, None), "m": (4.5, 5.5)}, {"A": 0.1, "m": 5.0, "c": 2.0}
    fit = fit_curve("c + A*exp(-((x - m)/0.7)**2)", x, y, u_y=0.1, bounds=bounds, start=start)
    assert 4.6 < fit.values["m"] < 5.4
    assert fit.intervals["m"][0.95] == (4.5, 5.5)
    assert [note.split(":")[0] for note in fit.notes[:2]] == [
        "A lies at its limit 0",
        "m is less than one standard deviation from its limit 4.5",
    ]


def test_as_many_parameters_as_points_leave_nothing_to_test() -> None:
    fit = fit_curve(LINE, [0.0, 1.0], [1.0, 3.0], start={"a": 0.0, "b": 0.0}, u_y=0.1)
    assert fit.values == pytest.approx({"a": 1.0, "b": 2.0})
    assert fit.sds == pytest.approx({"a": 0.1, "b": 0.1 * math.sqrt(2.0)})
    assert (fit.dof, fit.status, fit.goodness) == (0, "ok", ())


def test_a_perfect_curve_is_no_reason_to_fail() -> None:
    fit = fit_curve("a*x + b", T, 2.0 * T + 1.0, start={"a": 1.0, "b": 0.0})
    assert fit.status == "ok"
    assert "through every point" in fit.message
    assert fit.values == pytest.approx({"a": 2.0, "b": 1.0})
    assert all(math.isnan(sd) for sd in fit.sds.values())  # nothing tells how large the errors are
    assert any("no scatter" in note for note in fit.notes)
    assert "±" not in str(fit)


def test_points_without_scatter_and_a_parameter_at_its_limit_are_no_reason_to_fail() -> None:
    fit = fit_curve("gaussian + constant", T, np.ones(T.size))
    assert fit.status == "ok"
    assert "through every point" in fit.message
    assert all(math.isnan(sd) for sd in fit.sds.values())


@pytest.mark.slow
def test_exact_points_with_stated_errors_can_be_sampled() -> None:
    x = np.linspace(0.0, 1.0, 5)
    analysis = sample_curve(
        fit_curve(LINE, x, 1.0 + 2.0 * x, start={"a": 0.0, "b": 0.0}, u_y=0.1),
        seed=1,
        target=Target(ess=500),
    )
    expected = math.sqrt(
        normal_equations(np.column_stack([np.ones(5), x]), x, 0.01 * np.eye(5))[1][1, 1]
    )
    assert analysis.chain.flat[:, 1].std() == pytest.approx(expected, rel=0.1)
    assert analysis.diagnosis.ok
    with pytest.raises(InputError, match="passes through every point"):
        sample_curve(fit_curve(LINE, x, 1.0 + 2.0 * x, start={"a": 0.0, "b": 0.0}), seed=1)


def good(**changes: object) -> dict[str, object]:
    return {"curve": LINE, "x": T, "y": 2.0 + T, "start": {"a": 1.0, "b": 1.0}} | changes


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"y": T[:-1]}, "'y' must have as many values as x"),
        ({"x": [[1.0]]}, "'x' must be a sequence of numbers"),
        ({"x": ["a"] * 41}, "'x' must be a sequence of numbers"),
        ({"y": np.where(T > 5, np.nan, T)}, "'y' must be finite .value number 22"),
        ({"u_y": 0.0}, "'u_y' must be > 0"),
        ({"u_y": -1.0}, "'u_y' must be > 0"),
        ({"u_y": np.ones(3)}, "'u_y' must be a number or"),
        ({"u_y": math.nan}, "'u_y' must be finite"),
        ({"cov_y": np.eye(3)}, "'cov_y' must have the shape"),
        ({"cov_y": -np.eye(41)}, "'cov_y' must be positive definite"),
        ({"cov_y": np.triu(np.ones((41, 41)))}, "'cov_y' must be symmetric"),
        ({"cov_y": np.eye(41), "u_y": 1.0}, "'cov_y' cannot be combined with"),
        ({"u_x": 0.1}, "'u_x' needs a known u_y beside it"),
        ({"start": {"a": 1.0, "b": 1.0, "c": 1.0}}, "names 'c', which is not in the formula"),
        ({"start": {"a": math.nan, "b": 1.0}}, "'start' must be finite for 'a'"),
        ({"start": {"a": "one", "b": 1.0}}, "'start' must be a number for 'a'"),
        ({"start": {"x": 1.0, "b": 1.0}}, "named like the variable"),
        ({"curve": "a + b*y"}, "must hold x, its variable, or the name of its axis"),
        ({"curve": "a + b*import"}, "'curve' is not a formula"),
        ({"curve": 3.0}, "'curve' must be a formula"),
        ({"bounds": {"a": (2.0, 1.0)}}, "'bounds' of 'a' must be below"),
        ({"bounds": {"a": (2.0, 3.0)}}, "'start' of 'a' must lie within"),
        ({"bounds": {"a": 2.0}}, "'bounds' must be \\(low, high\\)"),
        ({"bounds": {"z": (0, 1)}}, "names 'z', which is not a parameter"),
        ({"priors": {"z": "1(1)"}}, "names 'z', which is not a parameter"),
        ({"priors": {"a": "1.0"}}, "must have an uncertainty"),
        (
            {"priors": {"a": "1(1)"}, "bounds": {"a": (0, 2)}},
            "cannot be combined with a prior for 'a'",
        ),
        ({"errors": [Component("zero_y", 0.1, "a")]}, "has a name that is taken"),
        ({"x": T[:2], "y": T[:2]}, "must have more points than parameters"),
        ({"x": T[:1], "y": T[:1], "u_y": 1.0}, "must have at least as many points"),
        ({"curve": lambda x, a: a * x}, "cannot be called as curve"),
        ({"curve": lambda x, a, b: x[:3]}, "must return one value for each x"),
        ({"curve": lambda x, a, b: np.nan * x}, "not finite at any x"),
        ({"curve": lambda x, a, b: 1 / 0}, "fails at the starting values: ZeroDivisionError"),
        ({"curve": lambda x, a, b: "text"}, "'curve' must return numbers, not text"),
        ({"curve": "log(-a*a - x) + b"}, "not finite"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(changes: dict[str, object], says: str) -> None:
    given = good(**changes)
    with pytest.raises(InputError, match=says) as caught:
        fit_curve(given.pop("curve"), given.pop("x"), given.pop("y"), **given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "arguments", [("nothing", 1.0), ("zero_y", 0.0), ("zero_y", math.inf), ("scale_y", 2.0)]
)
def test_components_are_checked(arguments: tuple[str, float]) -> None:
    with pytest.raises(InputError):
        Component(*arguments)


def test_a_flat_prior_is_uniform_or_improper() -> None:
    flat = Flat(-math.inf, math.inf, 3.0)
    assert flat.centre == 3.0
    assert not flat.proper
    np.testing.assert_array_equal(flat.log_density([-1e300, 0.0]), 0.0)
    with pytest.raises(InputError, match="nothing can be drawn"):
        flat.draw(np.random.default_rng(1), 3)
    proper, uniform = Flat(1.0, 3.0, 1.5), Uniform(1.0, 3.0)
    np.testing.assert_array_equal(proper.log_density([0.0, 2.0]), uniform.log_density([0.0, 2.0]))
    assert proper.sd == uniform.sd


def test_the_same_call_gives_the_same_numbers(rng: np.random.Generator) -> None:
    y = np.cos(2.0 * T) + 0.1 * rng.standard_normal(T.size)
    fits = [fit_curve("cos(w*x) + c", T, y, start={"w": 1.0, "c": 0.0}) for _ in range(2)]
    assert fits[0].values == fits[1].values
    assert fits[0].sds == fits[1].sds


@pytest.mark.slow
def test_draws_of_a_line_with_unknown_errors_follow_the_t_distribution(
    rng: np.random.Generator,
) -> None:
    from scipy.stats import t

    x = np.linspace(0.0, 1.0, 8)
    y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(8)
    fit = fit_curve(LINE, x, y, start={"a": 0.0, "b": 0.0})
    analysis = sample_curve(fit, seed=3, target=Target(ess=3000))
    draws = analysis.chain.flat[:, 1]
    low, high = np.quantile(draws, [0.025, 0.975])
    half = t.ppf(0.975, 6) * fit.sds["b"]
    assert analysis.diagnosis.ok
    # a factor-20 prior of sigma is nearly the 1/sigma of the textbook
    assert (high - low) / 2 == pytest.approx(half, rel=0.06)
    # a normal distribution would be too narrow
    assert (high - low) / 2 > 1.15 * 1.96 * fit.sds["b"]
    assert 0.5 * (low + high) == pytest.approx(fit.values["b"], abs=0.1 * half)


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered")
def test_the_report_of_a_curve_speaks_of_the_curve(rng: np.random.Generator) -> None:
    y = 60.0 * np.exp(-T / 4.0) + 20.0 + 0.3 * rng.standard_normal(T.size)
    fit = fit_curve(
        "dT*exp(-x/tau) + room",
        T,
        y,
        start={"dT": 50.0, "tau": 1.0, "room": 25.0},
        u_y=0.3,
        units={"dT": "°C", "tau": "min", "room": "°C"},
        errors=[Component("zero_y", 0.5)],
        axes=AxisNames("time", "min", "temperature", "°C"),
    )
    files = curve_report(
        fit, sample_curve(fit, seed=1, target=Target(ess=1000)), title="Cooling", kind="synthetic"
    )
    text = files["report.md"].decode().replace("\u00a0", " ")
    wanted = (
        "Curve: `y = dT*exp(-x/tau) + room`",
        "temperature (°C) against time (min)",
        "SYNTHETIC",
        "| tau |",
        "zero error of y",
        "points fit",
    )
    for word in wanted:
        assert word in text
    for word in ("turning point", "speed", "mass", "radians", "frame"):
        assert word not in text, word
    assert {"result.json", "figures/phase.png"} <= set(files)


def peak(x, a, x0, w, b):
    return b + a * np.exp(-0.5 * ((x - x0) / w) ** 2)


def peak_of_plain_numbers(x, a, x0, w, b):
    return peak(np.asarray(x, dtype=float), *(float(one) for one in (a, x0, w, b)))


@pytest.mark.parametrize("curve", [peak, peak_of_plain_numbers])
def test_a_narrow_peak_far_from_zero_is_fit_as_well_as_near_it(
    curve, rng: np.random.Generator
) -> None:
    x = np.linspace(-1.25, 1.25, 120)
    y = peak(x, 5.0, 0.0, 0.05, 1.0) + 0.1 * rng.standard_normal(x.size)
    start = {"a": 4.0, "x0": 0.04, "w": 0.08, "b": 0.8}

    def off(p):
        return (peak(x, *p) - y) / 0.1

    near = optimize.least_squares(off, list(start.values()), jac="3-point", xtol=1e-14, ftol=1e-14)
    sds = np.sqrt(np.diag(np.linalg.inv(near.jac.T @ near.jac)))
    far = fit_curve(curve, x + 780.24, y, u_y=0.1, start=start | {"x0": 780.28})
    assert far.status == "ok"
    np.testing.assert_allclose(
        (np.array(list(far.values.values())) - near.x - [0.0, 780.24, 0.0, 0.0]) / sds,
        0.0,
        atol=1e-4,
    )
    np.testing.assert_allclose(list(far.sds.values()), sds, rtol=1e-5)


def test_a_formula_may_call_its_variable_t() -> None:
    x = np.linspace(0.0, 5.0, 30)
    y = 2.0 * np.exp(-x / 1.7) + 0.01 * np.random.default_rng(1).standard_normal(30)
    there, here = (fit_curve(f"a*exp(-{v}/tau)", x, y, u_y=0.01) for v in "xt")
    assert here.values == pytest.approx(there.values, rel=1e-9)
    assert here.text == "a*exp(-t/tau)"
    given = fit_curve("a*exp(-t/tau)", x, y, u_y=0.01, start={"a": 1.0, "tau": 1.0})
    assert given.values == pytest.approx(there.values, rel=1e-6)
    assert given(1.0) == pytest.approx(there(1.0), rel=1e-6)
    # t with a value of its own is a parameter
    assert fit_curve("a*x + t", x, y, start={"a": 1.0, "t": 0.0}).names == ("a", "t")


def test_a_formula_may_call_its_variable_as_its_axis_is_called() -> None:
    f = np.linspace(0.5, 5.0, 30)
    y = 2.0 * np.exp(-f / 1.7) + 0.01 * np.random.default_rng(1).standard_normal(30)
    there = fit_curve("a*exp(-x/f0)", f, y, u_y=0.01)
    here = fit_curve("a*exp(-f/f0)", f, y, u_y=0.01, axes=AxisNames("frequency f", "Hz"))
    assert here.values == pytest.approx(there.values, rel=1e-9)
    with pytest.raises(InputError, match="must hold x, its variable, or the name of its axis"):
        fit_curve("a*exp(-f/f0)", f, y, u_y=0.01)


def test_one_letter_is_a_constant() -> None:
    y = [9.8, 9.9, 9.7, 9.85]
    fit = fit_curve("c", [1.0, 2.0, 3.0, 4.0], y, start={"c": 9.0})
    assert fit.values["c"] == pytest.approx(np.mean(y))
    assert fit.sds["c"] == pytest.approx(np.std(y, ddof=1) / 2.0)
    assert fit_curve("c", [1.0, 2.0, 3.0, 4.0], y).values == fit.values


def test_numbers_by_default_are_the_starts_of_a_function() -> None:
    def decay(x, a=1.0, tau=1.0, c=0.0):
        return a * np.exp(-x / tau) + c

    x = np.linspace(0.0, 5.0, 30)
    y = decay(x, 2.0, 1.7) + 0.01 * np.random.default_rng(1).standard_normal(30)
    fit = fit_curve(decay, x, y, u_y=0.01)
    assert fit.names == ("a", "tau", "c")
    assert fit.values["tau"] == pytest.approx(1.7, abs=4.0 * fit.sds["tau"])
    assert fit_curve(decay, x, y, u_y=0.01, fixed={"c": 0.0}).names == ("a", "tau")
    # beside a start they are held, as arguments with defaults always were
    assert fit_curve(decay, x, y, u_y=0.01, start={"a": 3.0, "tau": 1.0}).names == ("a", "tau")


def test_a_parameter_without_a_derivative_is_one_that_the_data_are_silent_about() -> None:
    """The width of a sigmoid that has become a step: its Jacobian is not finite."""
    jacobian = np.column_stack([np.arange(5.0), np.full(5, np.inf)])
    problem = SimpleNamespace(noise_names=())
    posterior = SimpleNamespace(jacobian=lambda values: jacobian)
    fit = SimpleNamespace(
        names=("A", "w"), values=np.zeros(2), posterior=posterior, problem=problem
    )
    assert silent_parameters(cast(Fit, fit)) == ("w",)


@pytest.mark.parametrize("start", [None, {"b": 0.05}])
@pytest.mark.parametrize(
    "formula", ["sqrt(a**2 + (b*x)**2)", "a/(1 + (b*x)**2)", "a*cos(b*x)", "a + b*b*x"]
)
def test_a_parameter_best_where_its_sign_changes_is_told_to_take_the_limit(
    formula: str, start: dict[str, float] | None
) -> None:
    """There the curve has no derivative in it, although the data determine it: that they do not was
    said, or that the search did not converge.
    """
    x = np.linspace(0.0, 10.0, 60)
    seen = 0
    for seed in (1, 2, 6):
        y = 2.0 + 0.1 * np.random.default_rng(seed).standard_normal(60)
        fit = fit_curve(formula, x, y, u_y=0.1, start=start)
        if fit.status == "ok":
            continue
        seen += 1
        assert fit.status == "not-identified"
        assert fit.reasons == (
            "b has no standard deviation at its best value, 0: the curve is the same on both sides "
            "of it, so that it does not change there to first order; give it the limit 0",
        )
        limited = fit_curve(formula, x, y, u_y=0.1, bounds={"b": (0.0, None)})
        assert limited.status == "ok"
        assert 0.0 < limited.intervals["b"][0.95][1] < 0.2
    assert seen


@pytest.mark.parametrize("stated", [{"u_y": 0.1}, {}, {"u_y": 0.1, "jitter": True}])
def test_an_interval_ends_where_the_curve_is_even(stated: dict[str, Any]) -> None:
    """Beyond 0 the same curves come again: it is the interval that the limit 0 gives."""
    x, rng = np.linspace(0.0, 10.0, 40), np.random.default_rng(2)
    y, start = 3.0 + 0.1 * rng.standard_normal(40), {"a": 3.0, "w": 0.05}
    free = fit_curve("a*cos(w*x)", x, y, start=start, **stated)
    limited = fit_curve("a*cos(w*x)", x, y, start=start, bounds={"w": (0.0, None)}, **stated)
    assert free.status == limited.status == "ok"
    assert free.values["w"] > 0.0
    assert math.isnan(free.sds["w"])
    for p, ends in free.intervals["w"].items():
        assert ends[0] == 0.0
        assert ends == pytest.approx(limited.intervals["w"][p], rel=1e-3)
    assert "w < 0.02" in str(free).replace("w      <", "w <")
    clear = fit_curve("a*cos(w*x)", x, 3.0 * np.cos(0.2 * x) + y - 3.0, start=start, **stated)
    assert clear.intervals["w"][0.95][0] > 0.19
    assert clear.sds["w"] > 0.0


def test_a_parameter_that_no_point_sees_is_not_determined_on_any_side_of_0() -> None:
    x = np.linspace(0.0, 10.0, 20)
    y = 2.0 + 0.1 * np.random.default_rng(1).standard_normal(20)
    fit = fit_curve("a + b*b*max(x - 20, 0)", x, y, u_y=0.1, start={"b": 1.0})
    assert fit.status == "not-identified"
    assert "do not determine b" in fit.reasons[0]


def no_root_beyond(x: np.ndarray, a: float, b: float) -> np.ndarray:
    """As `scipy.optimize.newton`, which raises where it does not converge."""
    if b > 2.0:
        raise RuntimeError("failed to converge after 50 iterations")
    return a / (1.0 + b * x)


def ended_early(x: np.ndarray, a: float, k: float) -> np.ndarray:
    """As `scipy.integrate.solve_ivp`, which gives the places that it came to."""
    return (a * np.exp(-k * x))[: x.size if k < 5.0 else 3]


@pytest.mark.parametrize(
    ("curve", "true", "start"),
    [
        (
            lambda x, v, k, n: v * x**n / (k**n + x**n),
            (5.0, 2.0, 2.0),
            {"v": 4.0, "k": 3.0, "n": 1.5},
        ),
        (
            lambda x, v, k, i: v * x / (k + x + x**2 / i),
            (5.0, 2.0, 10.0),
            {"v": 4.0, "k": 3.0, "i": 8.0},
        ),
        (lambda x, a, k: a + math.sqrt(k) * np.sqrt(x), (1.0, 4.0), {"a": 0.0, "k": 3.0}),
        (
            lambda x, a, t: a * np.array([math.exp(-at / t) for at in x]),
            (3.0, 2.0),
            {"a": 1.0, "t": 1.0},
        ),
        (no_root_beyond, (2.0, 0.5), {"a": 1.0, "b": 0.2}),
        (ended_early, (3.0, 0.5), {"a": 2.0, "k": 0.3}),
        (
            lambda x, a, b: a * np.exp(-b * x) if b < 1.0 else a * math.exp(-b) ** x,
            (3.0, 1.2),
            {"a": 1.0, "b": 0.8},
        ),
    ],
)
def test_where_a_function_has_no_value_a_search_goes_elsewhere(
    curve: Callable[..., Any], true: tuple[float, ...], start: dict[str, float]
) -> None:
    """Far from the optimum k**n overflows, i is 0, math.sqrt has no root: Python raises there."""
    x = np.linspace(0.2, 10.0, 25)
    y = curve(x, *true) + 0.05 * np.random.default_rng(1).standard_normal(25)
    fit = fit_curve(curve, x, y, u_y=0.05, start=start)
    assert fit.status == "ok"
    for value, (name, best) in zip(true, fit.values.items(), strict=True):
        assert best == pytest.approx(value, abs=4.0 * fit.sds[name])


def test_a_complex_value_is_none() -> None:
    """`np.emath.sqrt` returns real numbers where it can."""
    x = np.linspace(0.5, 5.0, 20)
    y = 2.0 * np.sqrt(x + 0.3) + 0.02 * np.random.default_rng(1).standard_normal(20)

    def root(x: np.ndarray, a: float, b: float) -> np.ndarray:
        return a * np.emath.sqrt(x - b)

    curve = wrap_function(root, ("a", "b"), x, {"a": 1.0, "b": 0.0})
    value = curve.value(x, {"a": 2.0, "b": 1.0})[0]
    assert np.all(np.isnan(value[x < 1.0]))
    assert value[x > 1.0] == pytest.approx(2.0 * np.sqrt(x[x > 1.0] - 1.0))
    fit = fit_curve(root, x, y, u_y=0.02, start={"a": 1.0, "b": 0.0})
    assert fit.status == "ok"
    assert fit.values["b"] == pytest.approx(-0.3, abs=4.0 * fit.sds["b"])


@pytest.mark.parametrize("k", [0.3, 1e-7, 0.0])
def test_a_term_that_is_off_at_the_start_is_differentiated_as_it_is_later(k: float) -> None:
    """The size of a complex number has no derivative, which a factor of 0 hides."""
    x, values = np.linspace(-3.0, 3.0, 40), {"a": 2.0, "b": 1.0, "k": 0.3}

    def bent(x: np.ndarray, a: float, b: float, k: float) -> np.ndarray:
        y = a * special.dawsn(b * x)
        return y - k * np.abs(y) * y

    curve = wrap_function(bent, tuple(values), x, {**values, "k": k})
    shape = special.dawsn(x)
    exact = shape * (1.0 - 2.0 * 0.3 * np.abs(2.0 * shape))
    assert curve.local(x, values).gradient["a"][0] == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("limits", [("a", "b"), (0.0, math.nan), (0.0,), (5.0, 1.0)])
def test_what_is_no_limit_is_refused_in_one_line(limits: Any) -> None:
    x = np.arange(1.0, 10.0)
    with pytest.raises(InputError, match="'bounds'"):
        fit_curve("A*exp(-x/t)", x, np.exp(-x), u_y=0.1, bounds={"t": limits})


@pytest.mark.parametrize("limits", [(0.0, math.inf), [np.int64(0), np.int64(9)]])
def test_limits_are_numbers_of_any_kind(limits: Any) -> None:
    x = np.arange(1.0, 10.0)
    y = 3.0 * np.exp(-x / 2.0) + 0.01 * np.random.default_rng(1).standard_normal(9)
    assert fit_curve("A*exp(-x/t)", x, y, u_y=0.01, bounds={"t": limits}).status == "ok"


@pytest.mark.parametrize("unit", [1.0, 1e5])
def test_a_minimum_at_a_kink_is_one_in_any_unit(unit: float) -> None:
    x = np.linspace(0.0, 10.0, 30)
    for seed in range(6):
        y = 0.5 + np.maximum(x - 4.0, 0.0) + np.random.default_rng(seed).normal(0.0, 0.5, x.size)
        assert fit_curve("b + a*max(x - x0, 0)", x, unit * y).status == "ok"


def test_a_minimum_at_a_kink_is_a_minimum() -> None:
    """Of an onset x0 the lowest point often lies at a reading: steps lead to and fro across it."""
    x = np.linspace(0.0, 10.0, 30)
    grid = np.linspace(2.0, 6.0, 4001)
    at_reading = 0
    for seed in range(10):
        y = 0.5 + np.maximum(x - 4.0, 0.0) + np.random.default_rng(seed).normal(0.0, 0.5, x.size)
        fit = fit_curve("b + a*max(x - x0, 0)", x, y, u_y=0.5)
        columns = [np.column_stack([np.ones(30), np.maximum(x - x0, 0.0)]) for x0 in grid]
        chi2 = np.array([np.sum((y - c @ np.linalg.lstsq(c, y)[0]) ** 2) / 0.5**2 for c in columns])
        best = grid[np.argmin(chi2)]
        assert fit.status == "ok"
        assert fit.values["x0"] == pytest.approx(best, abs=2e-3)
        at_reading += bool(np.min(np.abs(best - x)) < 1e-3)
    assert at_reading >= 3
    alone = fit_curve(
        "max(x - x0, 0)", x, np.maximum(x - 4.0, 0.0) + 0.3 * np.cos(7.0 * x), u_y=0.3
    )
    assert alone.status == "ok"


@pytest.mark.parametrize("field", ["start", "bounds", "priors", "fixed", "tied", "units"])
def test_what_is_no_mapping_is_told_where_no_start_is_given(field: str) -> None:
    with pytest.raises(InputError, match=f"^'{field}' must be a mapping"):
        fit_curve("a*exp(-x/tau)", T, np.exp(-T), **{field: 3})  # type: ignore[arg-type]
