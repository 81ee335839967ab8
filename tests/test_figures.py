"""Figures as a reader meets them: labels on the canvas, ticks clear of each other, the right parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from joint_runs import LINE, problem_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from estim.campaign import load_campaign
from estim.common import Finding, Kind
from estim.common.labels import Notation
from estim.curves.rolling import RollingMotion
from estim.problem.observations import Parameter
from estim.problem.posterior import Problem
from estim.problem.priors import Normal, Uniform
from estim.reports import figures
from estim.reports.reanalysis_figures import narrowing_figure
from estim.sampling.bands import Bands
from estim.studies.limits import Narrowing

X = np.linspace(0.0, 1.0, 8)


def corner_of(problem: Problem, rng: np.random.Generator) -> Figure:
    draws = 0.4 + 0.1 * rng.standard_normal((4000, problem.n_par))
    figure = figures.corner_figure(SimpleNamespace(problem=problem, chain=SimpleNamespace(thinned=lambda n: draws)))
    FigureCanvasAgg(figure).draw()
    return figure


def single_run(n_par: int) -> Problem:
    run = problem_of(LINE, {name: Normal(0.4, 0.2) for name in ("slope", "bend", "offset")}, {}, X, [X], 0.1).runs[0]
    return Problem(tuple(Parameter(f"parameter {i}", "m", Normal(0.4, 0.2), "") for i in range(n_par)), (run,))


@pytest.mark.parametrize("n_par", [1, 2, 3, 5, 7])
def test_every_label_of_a_corner_figure_is_on_the_canvas_and_clear_of_the_ticks(n_par: int, rng: np.random.Generator) -> None:
    figure = corner_of(single_run(n_par), rng)
    axes = np.array(figure.axes).reshape(n_par, n_par)
    for axis in [*(ax.xaxis for ax in axes[-1]), *(ax.yaxis for ax in axes[1:, 0])]:
        words, box = axis.label.get_text(), axis.label.get_window_extent()
        assert words.startswith("parameter")
        assert all(figure.bbox.contains(x, y) for x, y in box.corners()), words
        assert not any(box.overlaps(tick.get_window_extent()) for tick in axis.get_ticklabels()), words


def test_tick_labels_of_neighbouring_panels_do_not_touch(rng: np.random.Generator) -> None:
    axes = np.array(corner_of(single_run(7), rng).axes).reshape(7, 7)
    below = [tick.get_window_extent() for ax in axes[-1] for tick in ax.xaxis.get_ticklabels()]
    # turned by 45 degrees their boxes overlap before they do: what counts is the distance of their centres across the text
    centres = [0.5 * (box.x0 + box.x1) for box in below]
    assert np.min(np.diff(centres)) > 1.2 * 7.0 * axes[0, 0].figure.dpi / 72.0
    for ax in axes[-1]:
        low, high = ax.get_xlim()
        assert all(low + 0.07 * (high - low) < tick < high - 0.07 * (high - low) for tick in ax.get_xticks())


def test_a_corner_figure_ends_where_the_prior_does(rng: np.random.Generator) -> None:
    problem = problem_of(LINE, {"slope": Uniform(0.35, 0.9), "bend": Normal(0.4, 0.2)}, {"offset": Normal(0.4, 0.1)}, X, [X], 0.1)
    assert corner_of(problem, rng).axes[0].get_xlim()[0] == pytest.approx(0.35)


def test_runs_show_what_they_share_first_and_nothing_else_where_there_is_no_room(replica: Path) -> None:
    campaign = load_campaign(replica / "campaign.toml")
    problem = campaign.problem(["heavy-02", "heavy-04"])
    shared = ("gamma[heavy]", "kappa[heavy]", "rolling_resistance", "radius")
    assert problem.names[:4] == shared
    assert tuple(problem.names[i] for i in figures.corner_parameters(problem)) == shared
    assert "Only 4 of the 8 parameters are drawn, those that runs share" in figures.corner_words(problem)
    single = campaign.problem(["heavy-04"])
    assert len(figures.corner_parameters(single)) == single.n_par == 6
    assert "Only" not in figures.corner_words(single)


def test_frames_of_the_way_back_are_counted_and_no_marker_at_the_axis_is_cut(rng: np.random.Generator) -> None:
    run = single_run(1).runs[0]
    left = np.array([[0.01, 0.0], [0.5, -0.4], [0.4, -0.5]])
    excluded = (Finding(Kind.WAY_BACK, size=2), Finding(Kind.BESIDE_RELEASE, size=1))
    run = replace(run, x=X[1:], y=X[1:], excluded=excluded, excluded_points=left, words=RollingMotion(angular=False).words())
    figure = Figure()
    figures._draw_points(ax := figure.subplots(), run)
    assert [text.get_text() for text in ax.texts] == ["2 frames of the way back (v < 0) not shown"]
    crosses = next(line for line in ax.lines if line.get_marker() == "x")
    assert crosses.get_xydata().tolist() == [[0.01, 0.0]]
    assert not crosses.get_clip_on()


def test_a_band_that_its_line_hides_is_called_so() -> None:
    x = np.linspace(0.0, 1.0, 50)
    for half, hidden in ((0.001, True), (0.1, False)):
        band = np.array([x - half, x + half])
        bands = Bands("r", x, x, {0.68: band, 0.95: band}, {0.68: band, 0.95: band}, np.array([1.0]))
        figures._draw_bands(ax := Figure().subplots(), bands, "a new point")
        names = [name for name in ax.get_legend_handles_labels()[1] if name.startswith("the curve")]
        assert [("under its line" in name) for name in names] == [hidden] * 2


def test_narrowing_names_the_runs() -> None:
    u, alone, before = np.array([[0.2], [0.1]]), np.array([[0.2], [0.3]]), np.array([0.4])
    table = Narrowing(("gamma[b]",), (Notation("γ").label("1", "[b]"),), ("zebra", "ant"), u, alone, before)
    figure = narrowing_figure([table], synthetic=False)
    assert [tick.get_text() for tick in figure.axes[0].get_xticklabels()] == ["zebra", "ant"]
    assert figure.axes[0].get_ylabel() == "u(γ[b])"


@pytest.mark.parametrize("column", [np.zeros(4000), np.full(4000, 1e99), np.full(4000, 0.4) + 1e-16, -1e99 * (1.0 + 2e-16 * (np.arange(4000) % 3))])
def test_a_corner_figure_survives_draws_that_are_all_but_equal(column: np.ndarray, rng: np.random.Generator) -> None:
    draws = np.column_stack([column, rng.standard_normal(4000)])
    analysis = SimpleNamespace(problem=single_run(2), chain=SimpleNamespace(thinned=lambda n: draws))
    assert figures.png(lambda: figures.corner_figure(analysis)).startswith(b"\x89PNG")
