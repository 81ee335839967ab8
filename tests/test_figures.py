"""Figures as a reader meets them: labels on the canvas, ticks clear of each other, the right
parameters.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from joint_runs import LINE, problem_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from scipy.interpolate import RegularGridInterpolator

from estim import drawing
from estim.campaign import load_campaign
from estim.checks import Outliers
from estim.common import Finding, Kind
from estim.common.labels import Notation
from estim.curves.rolling import RollingMotion
from estim.problem.observations import Parameter
from estim.problem.posterior import Problem
from estim.problem.priors import Normal, Uniform
from estim.reports import corner_figures, curve_figures
from estim.reports.consistency import _within
from estim.reports.corner_figures import density_of, trace_figure
from estim.reports.curve_figures import (
    DrawnResiduals,
    draw_residuals,
    far_off,
    panel_pairs,
    residuals_of,
)
from estim.reports.pages import marked
from estim.reports.reanalysis import narrowing_figure
from estim.sampling.bands import Bands
from estim.studies.limits import Narrowing

X = np.linspace(0.0, 1.0, 8)
NEAR = np.zeros(8, dtype=bool)  # points that are drawn to scale: all


def analysed(problem: Problem, draws: np.ndarray) -> SimpleNamespace:
    """As much of an analysis as a corner figure asks for."""
    return SimpleNamespace(problem=problem, chain=SimpleNamespace(thinned=lambda n: draws))


def corner_of(problem: Problem, rng: np.random.Generator) -> Figure:
    figure = corner_figures.corner_figure(
        analysed(problem, 0.4 + 0.1 * rng.standard_normal((4000, problem.n_par)))
    )
    FigureCanvasAgg(figure).draw()
    return figure


def single_run(n_par: int) -> Problem:
    run = problem_of(
        LINE, {name: Normal(0.4, 0.2) for name in ("slope", "bend", "offset")}, {}, X, [X], 0.1
    ).runs[0]
    return Problem(
        tuple(Parameter(f"parameter {i}", "m", Normal(0.4, 0.2), "") for i in range(n_par)), (run,)
    )


@pytest.mark.slow
@pytest.mark.parametrize("n_par", [1, 2, 3, 5, 7])
def test_every_label_of_a_corner_figure_is_on_the_canvas_and_clear_of_the_ticks(
    n_par: int, rng: np.random.Generator
) -> None:
    figure = corner_of(single_run(n_par), rng)
    axes = [axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
    named = [axis for axis in axes if axis.label.get_text()]
    assert len(named) == 2 * n_par - 1
    numbers = [
        tick.label1.get_window_extent()
        for axis in axes
        for tick in axis.get_major_ticks()
        if tick.label1.get_text()
    ]
    assert len(numbers) >= 2 * len(named)
    for axis in named:
        box = axis.label.get_window_extent()
        assert all(figure.bbox.contains(x, y) for x, y in box.corners()), axis.label.get_text()
        assert not any(box.overlaps(number) for number in numbers), axis.label.get_text()


@pytest.mark.slow
def test_tick_labels_of_neighbouring_panels_do_not_touch(rng: np.random.Generator) -> None:
    problem = single_run(7)
    figure = corner_of(problem, rng)
    below = [
        tick.label1.get_window_extent()
        for ax in figure.axes
        for tick in ax.xaxis.get_major_ticks()
        if tick.label1.get_text()
    ]
    # turned by 45 degrees their boxes overlap before they do: what counts is the distance of their
    # centres across the text
    centres = sorted(0.5 * (box.x0 + box.x1) for box in below)
    assert len(centres) >= 14
    assert np.min(np.diff(centres)) > 1.2 * 7.0 * figure.dpi / 72.0
    for column in corner_figures.columns_of(
        analysed(problem, 0.4 + 0.1 * rng.standard_normal((4000, 7)))
    ):
        shares = (column.ticks - column.low) / (column.high - column.low)
        assert np.all((shares > 0.07) & (shares < 0.93))


def test_a_corner_figure_ends_where_the_prior_does(rng: np.random.Generator) -> None:
    problem = problem_of(
        LINE,
        {"slope": Uniform(0.35, 0.9), "bend": Normal(0.4, 0.2)},
        {"offset": Normal(0.4, 0.1)},
        X,
        [X],
        0.1,
    )
    columns = corner_figures.columns_of(
        analysed(problem, 0.4 + 0.1 * rng.standard_normal((4000, problem.n_par)))
    )
    assert columns[0].low == 0.35
    assert columns[1].low < 0.35


def test_the_contours_hold_what_they_say_but_for_the_smoothing(rng: np.random.Generator) -> None:
    """Two independent normal quantities: cells and kernel add their variance, s^2, and 1 - (1 -
    p)^(1 + s^2) of fresh draws lie inside.
    """
    x, y, *fresh = rng.standard_normal((4, 200_000))
    for n_bin, smooth in ((40, 1.0), (80, 1.5)):
        found = density_of(x, y, [(-5.0, 5.0), (-4.8, 5.2)], n_bin=n_bin, smooth=smooth)
        at = RegularGridInterpolator((found.x, found.y), found.z)(
            np.clip(np.column_stack(fresh), -4.8, 5.0)
        )
        variance = (smooth**2 + 1.0 / 12.0) * (10.0 / n_bin) ** 2
        for level, probability in zip(found.levels, (0.95, 0.68), strict=True):
            assert np.mean(at > level) == pytest.approx(
                1.0 - (1.0 - probability) ** (1.0 + variance), abs=0.01
            )


def test_contours_end_at_the_edge_and_not_before(rng: np.random.Generator) -> None:
    found = density_of(
        np.abs(rng.standard_normal(50_000)),
        rng.standard_normal(50_000),
        [(0.0, 4.0), (-4.0, 4.0)],
        n_bin=30,
        smooth=1.2,
    )
    assert found.x[0] == 0.0
    assert found.z[0].max() > 0.9 * found.z.max()
    assert found.z.shape == (found.x.size, found.y.size)


@pytest.mark.parametrize("draws", [np.zeros(4000), np.repeat([0.0, 1.0], [3900, 100])])
def test_levels_increase_where_one_cell_holds_nearly_all(draws: np.ndarray) -> None:
    found = density_of(draws, draws, [(-1.0, 2.0), (-1.0, 2.0)], n_bin=30, smooth=0.01)
    low, high = found.levels
    assert 0.0 < low < high <= found.z.max()


@pytest.mark.parametrize(
    ("ticks", "texts"),
    [
        ([57.5, 60.0, 62.5], ["57.5", "60.0", "62.5"]),
        ([0.005, 0.01, 0.015], ["0.005", "0.010", "0.015"]),
        ([-1.0, 0.0, 1.0], ["−1", "0", "1"]),
        ([0.1 * 3 - 0.3, 0.2], ["0.0", "0.2"]),
        ([2e-6, 4e-6], ["2e-06", "4e-06"]),
        ([1.5e7, 2e7], ["1.5e+07", "2.0e+07"]),
        ([1000.0, 2000.0], ["1000", "2000"]),
        ([0.4, 0.4 + 1e-11], ["0.40000000000", "0.40000000001"]),
        ([], []),
    ],
)
def test_ticks_have_as_many_digits_as_tell_them_apart(ticks: list[float], texts: list[str]) -> None:
    assert drawing.tick_texts(np.array(ticks)) == texts


def trace_of(n_par: int, draws: np.ndarray) -> Figure:
    chain = SimpleNamespace(draws=draws, n_burn=20)
    figure = trace_figure(SimpleNamespace(problem=single_run(n_par), chain=chain))
    FigureCanvasAgg(figure).draw()
    return figure


@pytest.mark.slow
@pytest.mark.parametrize("n_par", [1, 6, 11])
def test_every_parameter_has_a_strip_of_the_trace_with_its_name_clear_of_its_numbers(
    n_par: int, rng: np.random.Generator
) -> None:
    scale = 10.0 ** np.arange(-5, n_par - 5)
    figure = trace_of(n_par, scale * rng.standard_normal((3, 50, 8, n_par)))
    strips = [ax for ax in figure.axes if ax.get_visible()]
    assert {ax.get_ylabel() for ax in strips} == {f"parameter {i} (m)" for i in range(n_par)}
    for ax in strips:
        numbers = [tick.label1.get_window_extent() for tick in ax.yaxis.get_major_ticks()]
        assert ax.yaxis.label.get_window_extent().x1 < min(box.x0 for box in numbers)


def test_a_trace_holds_a_walker_and_the_mean_of_every_ensemble(rng: np.random.Generator) -> None:
    draws = 5.0 + rng.standard_normal((2, 50, 8, 2))
    for i, ax in enumerate(trace_of(2, draws).axes):
        shown = [line.get_ydata() for line in ax.get_lines()]
        assert np.array(shown) == pytest.approx(
            np.array([one for mine in draws[..., i] for one in (mine[:, 0], mine.mean(axis=1))])
        )
        assert ax.get_lines()[0].get_xdata() == pytest.approx(np.arange(20, 70))


def test_chains_that_never_moved_are_drawn() -> None:
    assert trace_of(1, np.full((2, 50, 8, 1), 0.3)).axes


def test_runs_show_what_they_share_first_and_nothing_else_where_there_is_no_room(
    replica: Path,
) -> None:
    campaign = load_campaign(replica / "campaign.toml")
    problem = campaign.problem(["heavy-02", "heavy-04"])
    shared = ("gamma[heavy]", "kappa[heavy]", "rolling_resistance", "radius")
    assert problem.names[:4] == shared
    assert tuple(problem.names[i] for i in corner_figures.corner_parameters(problem)) == shared
    assert (
        "Only 4 of the 8 parameters are drawn, those shared by the runs"
        in corner_figures.corner_words(problem)
    )
    single = campaign.problem(["heavy-04"])
    assert len(corner_figures.corner_parameters(single)) == single.n_par == 6
    assert "Only" not in corner_figures.corner_words(single)


def test_frames_of_the_way_back_are_counted_and_no_marker_at_the_axis_is_cut(
    rng: np.random.Generator,
) -> None:
    run = single_run(1).runs[0]
    left = np.array([[0.01, 0.0], [0.5, -0.4], [0.4, -0.5]])
    excluded = (Finding(Kind.WAY_BACK, size=2), Finding(Kind.BESIDE_RELEASE, size=1))
    run = replace(
        run,
        x=X[1:],
        y=X[1:],
        excluded=excluded,
        excluded_points=left,
        words=RollingMotion(angular=False).words(),
    )
    figure = Figure()
    curve_figures._draw_points(
        ax := figure.subplots(), run, DrawnResiduals(run, np.zeros(7), np.full(7, 0.1), NEAR[1:])
    )
    assert [text.get_text() for text in ax.texts] == [
        "2 frames of the way back (v < 0) are not shown"
    ]
    crosses = next(line for line in ax.lines if line.get_marker() == "x")
    assert crosses.get_xydata().tolist() == [[0.01, 0.0]]
    assert not crosses.get_clip_on()


def test_neither_an_outlier_far_off_nor_what_was_left_out_presses_the_points_flat() -> None:
    y = np.array([3.365, 3.361, 1.366, 3.363, 3.354, 3.364, 5.4, 3.380])
    probability = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.9])
    left = np.array([[1.05, 3.36], [1.05, -150.0]])
    run = replace(single_run(1).runs[0], x=X, y=y, excluded_points=left)
    far = far_off(run, [Outliers("other", np.ones(8)), Outliers(run.name, probability)])
    assert np.flatnonzero(far).tolist() == [2, 6]
    curve_figures._draw_points(
        ax := Figure().subplots(), run, DrawnResiduals(run, np.zeros(8), np.full(8, 1e-4), far)
    )
    curve_figures._draw_outliers(ax, run, [Outliers(run.name, probability)], far)
    low, high = ax.get_ylim()
    assert 3.35 < low < 3.354 < 3.380 < high < 3.39
    assert [text.get_text() for text in ax.texts] == ["1.366", "5.4"]
    assert [name for name in ax.get_legend_handles_labels()[1] if name != "data used"] == [
        "excluded data",
        "outlier",
        "distant outlier",
    ]
    rolling = replace(run, words=RollingMotion(angular=False).words())
    assert not np.any(far_off(rolling, [Outliers(run.name, probability)]))


def test_narrowing_names_the_runs() -> None:
    u, alone, before = np.array([[0.2], [0.1]]), np.array([[0.2], [0.3]]), np.array([0.4])
    table = Narrowing(
        ("gamma[b]",), (Notation("γ").label("1", "[b]"),), ("zebra", "ant"), u, alone, before
    )
    figure = narrowing_figure([table])
    assert [tick.get_text() for tick in figure.axes[0].get_xticklabels()] == ["zebra", "ant"]
    assert figure.axes[0].get_ylabel() == "u(γ[b])"


@pytest.mark.parametrize(
    "column",
    [
        np.zeros(4000),
        np.full(4000, 1e99),
        np.full(4000, 0.4) + 1e-16,
        -1e99 * (1.0 + 2e-16 * (np.arange(4000) % 3)),
    ],
)
def test_a_corner_figure_survives_draws_that_are_all_but_equal(
    column: np.ndarray, rng: np.random.Generator
) -> None:
    draws = np.column_stack([column, rng.standard_normal(4000)])
    assert drawing.png(
        lambda: corner_figures.corner_figure(analysed(single_run(2), draws))
    ).startswith(b"\x89PNG")


def test_counts_are_compared_with_the_median_of_their_curve_in_their_own_unit() -> None:
    bands = Bands(
        "r", X, 3.0 * X, {}, {0.68: np.array([3.0 * X - 0.2, 3.0 * X + 0.2])}, np.array([np.inf])
    )
    problem = single_run(1)
    run = replace(problem.runs[0], x=X, y=3.0 * X + 0.1)
    posed = Problem(problem.parameters, (run,))
    fit, ok = SimpleNamespace(values=np.full(posed.n_par, 0.4)), SimpleNamespace(ok=True)
    (found,) = residuals_of(
        SimpleNamespace(problem=posed, bands=[bands], fit=fit, diagnosis=ok, outliers=())
    )
    assert found.rest == pytest.approx(0.1)
    assert found.sd == pytest.approx(0.1)  # what was stated of the readings


@pytest.mark.parametrize(
    ("name", "own", "label"),
    [
        ("speed v", False, "v − fit (m/s)"),
        ("energy per cm² and s", True, "data − fit (m/s)"),
        ("U", True, "U − fit (m/s)"),
        ("current", True, "data − fit (m/s)"),
    ],
)
def test_the_axis_of_residuals_names_a_symbol_only_where_there_is_one(
    name: str, own: bool, label: str
) -> None:
    run = single_run(1).runs[0]
    run = replace(
        run, x=X, y=2.0 * X, y_name=name, y_unit="m/s", motion=None if own else SimpleNamespace()
    )
    ax = Figure().add_subplot()
    draw_residuals(
        ax, DrawnResiduals(run, np.linspace(-0.1, 0.1, X.size), np.full(X.size, 0.1), NEAR), None
    )
    assert ax.get_ylabel() == label


@pytest.mark.slow
@pytest.mark.parametrize(("n", "columns"), [(1, 1), (2, 2), (4, 2), (7, 3)])
def test_every_run_has_its_residuals_right_below_its_curve(n: int, columns: int) -> None:
    figure, pairs = panel_pairs(n, height=3.0)
    FigureCanvasAgg(figure).draw()
    assert len(pairs) == n
    for top, low in pairs:
        above, below = top.get_position(), low.get_position()
        assert (above.x0, above.x1) == pytest.approx((below.x0, below.x1), abs=1e-3)
        assert below.y1 < above.y0
        assert above.height > 2.0 * below.height > 0.0
    assert len({round(top.get_position().x0, 3) for top, _ in pairs}) == min(n, columns)


@pytest.mark.parametrize("title", ["", "bold: mean"])
def test_every_figure_of_synthetic_data_says_so_once(title: str) -> None:
    figure = drawing.new_figure(2.0)
    figure.suptitle(title)
    assert sum("SYNTHETIC" in text.get_text() for text in marked(figure).findobj(Text)) == 1
    assert title in figure.get_suptitle()


def test_true_values_are_drawn_in_every_panel_that_holds_them(rng: np.random.Generator) -> None:
    problem = single_run(3)
    draws = 0.4 + 0.1 * rng.standard_normal((4000, 3))
    count = []
    for truth in ({}, {"parameter 0": 0.4}, {"parameter 0": 40.0}):
        figure = corner_figures.corner_figure(analysed(problem, draws), truth)
        count.append(
            sum(line.get_linestyle() == "--" for ax in figure.axes for line in ax.get_lines())
        )
    assert count == [0, 3, 0]  # down its column; no parameter stands left of the first


def test_bars_of_the_consistency_figure_end_at_the_edge_of_the_prior() -> None:
    value, ((left,), (right,)) = _within(0.002, 0.004, 0.0, np.inf)
    assert (value, left, right) == (0.002, 0.002, 0.004)
    assert _within(-0.001, 0.004, 0.0, np.inf)[0] == 0.0
    assert _within(1.0, 0.5, -np.inf, np.inf) == (1.0, [[0.5], [0.5]])
