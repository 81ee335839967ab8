"""A line through points with any covariance matrix: against least squares over all true abscissas,
differences, special cases and Monte Carlo.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.optimize import minimize

from estim import Component, InputError, fit_curve, fit_line, slope_interval
from estim.cli import commands as cli
from estim.line.joint_covariance import MOST_POINTS, Common, joint_covariance, with_zeros
from estim.line.stated_errors import slope_with_scales, with_scales

N = 8
TRUE = np.linspace(1.0, 8.0, N)


def any_covariance(rng: np.random.Generator) -> np.ndarray:
    """Correlated without any pattern, and an error of y in common."""
    mixed = rng.standard_normal((2 * N, 2 * N))
    of_y = np.repeat([0.0, 1.0], N)
    return 0.02 * mixed @ mixed.T / (2 * N) + 0.03 * np.outer(of_y, of_y)


def drawn(rng: np.random.Generator, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    errors = np.linalg.cholesky(cov) @ rng.standard_normal(2 * N)
    return TRUE + errors[:N], 1.0 + 0.7 * TRUE + errors[N:]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_line_is_that_of_least_squares_over_all_true_abscissas(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cov = any_covariance(rng)
    x, y = drawn(rng, cov)
    weight = np.linalg.inv(cov)

    def squares(p: np.ndarray) -> float:
        off = np.concatenate([x - p[2:], y - p[0] - p[1] * p[2:]])
        return float(off @ weight @ off)

    brute = minimize(
        squares,
        np.concatenate([[1.0, 0.7], x]),
        method="BFGS",
        options={"gtol": 1e-8, "maxiter": 5000},
    )
    fit = fit_line(x, y, cov=cov)
    assert fit.method == "correlated"
    assert fit.chi2 == pytest.approx(brute.fun, rel=1e-7)
    assert [fit.intercept, fit.slope] == pytest.approx(brute.x[:2], rel=1e-5)
    assert fit_line(
        x, y, u_x=np.sqrt(np.diag(cov)[:N]), u_y=np.sqrt(np.diag(cov)[N:])
    ).chi2 != pytest.approx(brute.fun, rel=0.01)


@pytest.mark.slow
def test_propagated_uncertainties_are_those_of_differences(rng: np.random.Generator) -> None:
    cov = any_covariance(rng)
    data = np.concatenate(drawn(rng, cov))

    def line(readings: np.ndarray) -> np.ndarray:
        fit = fit_line(readings[:N], readings[N:], cov=cov)
        return np.array([fit.intercept, fit.slope])

    slopes = np.array(
        [(line(data + 1e-4 * one) - line(data - 1e-4 * one)) / 2e-4 for one in np.eye(2 * N)]
    ).T
    expected = slopes @ cov @ slopes.T
    found = fit_line(data[:N], data[N:], cov=cov).standard_errors["propagated"]
    assert [found.u_intercept**2, found.u_slope**2, found.cov] == pytest.approx(
        [expected[0, 0], expected[1, 1], expected[0, 1]], rel=1e-5
    )


def test_a_matrix_without_correlations_of_points_is_york() -> None:
    rng = np.random.default_rng(4)
    u_x, u_y, r = np.full(N, 0.1), rng.uniform(0.1, 0.3, N), np.full(N, 0.3)
    x, y = TRUE + 0.1 * rng.standard_normal(N), 1.0 + 0.7 * TRUE + u_y * rng.standard_normal(N)
    york, joint = (
        fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r),
        fit_line(x, y, cov=joint_covariance(u_x, u_y, r)),
    )
    assert joint.slope == pytest.approx(york.slope, rel=1e-12)
    for name, errors in york.standard_errors.items():
        assert joint.standard_errors[name] == pytest.approx(errors, rel=1e-9)
    assert slope_interval(joint)[:2] == pytest.approx(slope_interval(york)[:2], rel=1e-9)


def test_exact_x_gives_generalised_least_squares() -> None:
    """Aitken's formula, whatever the matrix of y."""
    rng = np.random.default_rng(5)
    cov = any_covariance(rng)[N:, N:]
    y = 1.0 + 0.7 * TRUE + np.linalg.cholesky(cov) @ rng.standard_normal(N)
    design, weight = np.column_stack([np.ones(N), TRUE]), np.linalg.inv(cov)
    of_line = np.linalg.inv(design.T @ weight @ design)
    fit = fit_line(TRUE, y, cov=joint_covariance(np.zeros(N), np.zeros(N), np.zeros(N), cov_y=cov))
    assert [fit.intercept, fit.slope] == pytest.approx(of_line @ design.T @ weight @ y, rel=1e-9)
    error = fit.standard_errors["propagated"]
    assert [error.u_intercept, error.u_slope, error.cov] == pytest.approx(
        [*np.sqrt(np.diag(of_line)), of_line[0, 1]], rel=1e-8
    )


def test_a_common_zero_moves_the_line_and_leaves_its_slope() -> None:
    own = joint_covariance(np.full(N, 0.05), np.full(N, 0.1), np.zeros(N))
    y = 1.0 + 0.7 * TRUE + 0.1 * np.random.default_rng(6).standard_normal(N)
    alone, shared = (
        fit_line(TRUE, y, cov=with_zeros(own, common)) for common in ([], [Common("y", 0.4)])
    )
    before, after = (fit.standard_errors["propagated"] for fit in (alone, shared))
    assert shared.slope == pytest.approx(alone.slope, rel=1e-9)
    assert after.u_slope == pytest.approx(before.u_slope, rel=1e-6)
    assert after.u_intercept == pytest.approx(np.hypot(before.u_intercept, 0.4), rel=1e-6)


@pytest.mark.parametrize(
    ("cov", "said"),
    [
        (np.eye(N), "must have 16 rows and columns"),
        (-np.eye(2 * N), "no negative variance"),
        (np.triu(np.ones((2 * N, 2 * N))), "must be symmetric"),
        (np.full((2 * N, 2 * N), np.nan), "must be finite"),
        (
            np.eye(2 * N) + 2.0 * np.eye(2 * N, k=1) + 2.0 * np.eye(2 * N, k=-1),
            "no negative variance",
        ),
    ],
)
def test_what_is_no_covariance_matrix_is_refused(cov: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        fit_line(TRUE, TRUE, cov=cov)


def test_a_matrix_holds_all_uncertainties_of_few_points() -> None:
    with pytest.raises(InputError, match="'cov' holds all uncertainties"):
        fit_line(TRUE, TRUE, u_y=1.0, cov=np.eye(2 * N))
    many = np.arange(MOST_POINTS + 1.0)
    with pytest.raises(InputError, match="at most 300 points"):
        fit_line(many, many, cov=np.eye(2 * many.size))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)
    t = np.arange(1.0, 13.0)
    rows = zip(t, 2.15 + 0.505 * t + 0.05 * rng.standard_normal(12), strict=True)
    (tmp_path / "cal.csv").write_text(
        "T,U,u_U\n" + "".join(f"{a:g},{b:.4f},0.05\n" for a, b in rows)
    )
    none, of_y = np.zeros(12), 0.05**2 * np.eye(12) + 0.1**2
    np.savetxt(tmp_path / "cov.csv", of_y, delimiter=",")
    np.savetxt(tmp_path / "all.csv", joint_covariance(none, none, none, cov_y=of_y), delimiter=",")
    return tmp_path / "cal.csv"


def said_of(table: Path, *options: str, code: int = 0) -> tuple[str, dict]:
    out = table.parent / "out"
    done = CliRunner().invoke(
        cli.cli,
        [
            "line",
            str(table),
            "--x",
            "T",
            "--y",
            "U",
            "--figures",
            "none",
            "--out",
            str(out),
            *options,
        ],
    )
    assert done.exit_code == code, done.output
    return done.output, json.loads((out / "result.json").read_text()) if code == 0 else {}


def test_files_and_options_say_the_same(table: Path) -> None:
    folder = table.parent
    ways = [
        ("--common-y", "0.1"),
        ("--cov-y", str(folder / "cov.csv")),
        ("--cov", str(folder / "all.csv")),
    ]
    found = [said_of(table, *way)[1] for way in ways]
    for one in found:
        assert one["method"] == "correlated"
        assert one["standard_errors"]["propagated"] == pytest.approx(
            found[0]["standard_errors"]["propagated"], rel=1e-6
        )
    assert found[0]["correlated"] == [
        "standard uncertainty 0.1 of the zero of y, shared by all points"
    ]
    assert (
        "(covariances of x, then y, from all.csv), 12 points"
        in (folder / "out" / "report.md").read_text()
    )
    plain = said_of(table)[1]
    assert plain["method"] == "weighted"
    assert (
        found[0]["standard_errors"]["propagated"][0]
        > 3.0 * plain["standard_errors"]["propagated"][0]
    )


def test_an_error_of_the_scale_does_not_draw_the_line_down(table: Path) -> None:
    """Taken at the readings it does (Peelle's pertinent puzzle): 50 % between readings that
    scatter.
    """
    scattered = "T,U,u_U\n" + "".join(f"{t:g},{10.0 + 2.0 * (-1) ** t},2.0\n" for t in range(1, 13))
    table.write_text(scattered)
    plain, scaled = (said_of(table, *way)[1] for way in ((), ("--common-y", "50%")))
    assert scaled["intercept"] + 6.5 * scaled["slope"] == pytest.approx(
        plain["intercept"] + 6.5 * plain["slope"], rel=0.02
    )
    both = table.parent / "both.csv"
    both.write_text(
        "\n".join(
            ",".join(f"{value:g}" for value in row) for row in np.diag(np.repeat([0.0, 4.0], 12))
        )
        + "\n"
    )
    by_file = said_of(table, "--cov", str(both), "--common-y", "50%")[1]
    assert (by_file["intercept"], by_file["slope"]) == pytest.approx(
        (scaled["intercept"], scaled["slope"]), rel=1e-9
    )
    y = np.array([10.0 + 2.0 * (-1) ** t for t in range(1, 13)])
    own = joint_covariance(np.zeros(12), np.full(12, 2.0), np.zeros(12))
    own[12:, 12:] += np.outer(0.5 * y, 0.5 * y)
    drawn_down = fit_line(np.arange(1.0, 13.0), y, cov=own)
    assert drawn_down.intercept + 6.5 * drawn_down.slope < 9.5


@pytest.mark.parametrize("axis", ["x", "y"])
def test_an_error_of_a_scale_widens_the_line_and_leaves_it_where_it_is(
    axis: str, rng: np.random.Generator
) -> None:
    """As a shared component of `fit_curve` does, which shares no code with it."""
    x, y = TRUE + 0.1 * rng.standard_normal(N), 1.0 + 2.0 * TRUE + 0.2 * rng.standard_normal(N)
    alone = fit_line(x, y, u_x=0.1, u_y=0.2)
    scales = [Common(axis, 0.1, relative=True)]
    line = with_scales(alone, scales)
    curve = fit_curve("a + b*x", x, y, u_x=0.1, u_y=0.2, errors=[Component(f"scale_{axis}", 0.1)])
    assert (line.intercept, line.slope) == (alone.intercept, alone.slope)
    error = line.standard_errors["propagated"]
    for name, u in (("a", error.u_intercept), ("b", error.u_slope)):
        assert u == pytest.approx(curve.sds[name], rel=0.04)
    assert error.u_slope > 3.0 * alone.standard_errors["propagated"].u_slope
    narrow = slope_interval(alone)
    wide = slope_with_scales(narrow, line.slope, 1.96, scales)
    for end, own in ((wide.low, narrow.low), (wide.high, narrow.high)):
        assert abs(end - line.slope) == pytest.approx(
            np.hypot(own - line.slope, 1.96 * 0.1 * line.slope), rel=1e-6
        )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ("--cov", "cov.csv"),
            "cov.csv:1: 'matrix' must have 24 rows and 24 columns of covariances: those of "
            "all x, then all y",
        ),
        (
            ("--cov-y", "cov.csv", "--uy", "u_U"),
            "'--uy' cannot be combined with a covariance matrix, which already contains it",
        ),
        (("--cov", "all.csv", "--cov-y", "cov.csv"), "'--cov-y' cannot be combined with --cov"),
        (("--common-y", "two"), "'--common-y' must be a number, or a share like 2%: two"),
        (("--common-x", "-1"), "'--common-x' must be > 0: -1"),
        (("--cov-y", "none.csv"), "none.csv"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    table: Path, options: tuple[str, ...], said: str
) -> None:
    at = [str(table.parent / text) if text.endswith(".csv") else text for text in options]
    done = CliRunner().invoke(
        cli.cli, ["line", str(table), "--x", "T", "--y", "U", *at], standalone_mode=False
    )
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)


def test_a_common_error_needs_errors_of_its_own_beside_it(table: Path) -> None:
    table.write_text(table.read_text().replace("u_U", "w"))
    done = CliRunner().invoke(
        cli.cli,
        ["line", str(table), "--x", "T", "--y", "U", "--common-y", "0.1"],
        standalone_mode=False,
    )
    assert "'--common-y' also needs the uncertainty of each reading" in str(done.exception)


@pytest.mark.statistics
def test_intervals_hold_what_they_say_and_those_without_the_correlations_do_not() -> None:
    rng = np.random.default_rng(12)
    shared = [Common("y", 0.3), Common("x", 0.1)]
    cov = with_zeros(joint_covariance(np.full(N, 0.15), np.full(N, 0.1), np.full(N, 0.4)), shared)
    n, inside, blind, slopes = 400, 0, 0, 0
    for _ in range(n):
        x, y = drawn(rng, cov)
        fit = fit_line(x, y, cov=cov)
        error = fit.standard_errors["propagated"]
        inside += abs(fit.intercept - 1.0) < 1.959964 * error.u_intercept
        slopes += slopes_hold(fit)
        alone = fit_line(x, y, u_x=0.15, u_y=0.1, r_xy=0.4)
        blind += (
            abs(alone.intercept - 1.0) < 1.959964 * alone.standard_errors["propagated"].u_intercept
        )
    spread = 3.0 * np.sqrt(0.95 * 0.05 / n)
    assert abs(inside / n - 0.95) < spread
    assert abs(slopes / n - 0.95) < spread
    assert blind / n < 0.8


def test_a_vertical_line_has_every_slope_beside_an_error_of_a_scale() -> None:
    upright = fit_line([1.0] * 4, [1.0, 2.0, 3.0, 4.0], u_x=0.1, u_y=0.1)
    for scales in ([], [Common("y", 0.02, relative=True)]):
        assert with_scales(upright, scales) is upright
        interval = slope_with_scales(slope_interval(upright), upright.slope, 1.96, scales)
        assert interval[:2] == (-np.inf, np.inf)


@pytest.mark.statistics
@pytest.mark.parametrize("axis", ["x", "y"])
def test_intervals_beside_an_error_of_a_scale_hold_what_they_say(axis: str) -> None:
    """As covariances of the readings it turns the line: b was 4.27 in the mean for 3."""
    rng, n, at = np.random.default_rng(5), 400, np.linspace(1.0, 10.0, 30)
    scales = [Common(axis, 0.1, relative=True)]
    inside, turned = 0, []
    for _ in range(n):
        x, y, factor = at, 2.0 + 3.0 * at, 1.0 + 0.1 * rng.standard_normal()
        x, y = (x * factor, y) if axis == "x" else (x, y * factor)
        x, y = x + 0.3 * rng.standard_normal(30), y + rng.standard_normal(30)
        line = with_scales(fit_line(x, y, u_x=0.3, u_y=1.0), scales)
        inside += abs(line.slope - 3.0) < 1.959964 * line.standard_errors["propagated"].u_slope
        if len(turned) < 20:
            cov = joint_covariance(np.full(30, 0.3), np.ones(30), np.zeros(30))
            part = slice(0, 30) if axis == "x" else slice(30, 60)
            cov[part, part] += 0.01 * np.outer(x, x) if axis == "x" else 0.01 * np.outer(y, y)
            turned.append(fit_line(x, y, cov=cov).slope - line.slope)
    # the share that is held, within four times its Monte-Carlo error; errors of 10 % are not quite
    # normal in 1/x
    assert abs(inside / n - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / n)
    assert abs(np.mean(turned)) > 0.2


def slopes_hold(fit) -> bool:
    """Whether the exact interval holds the true slope, by its own test at that slope alone."""
    from estim.line.angle_profile import profile, scaled_points

    points = scaled_points(fit.data)
    at = profile(np.asarray(np.arctan(0.7 * points.scale[0] / points.scale[1])), points)
    return bool(float(at.score) ** 2 < 1.959964**2 * float(at.information))
