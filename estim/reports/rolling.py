"""Whether bodies rolled without slipping: the record, the rows of a table, and the figure of the
force of the ramp along the way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estim.arrays import FloatArray, finite_or
from estim.checks import Rolling, way_of
from estim.common import QUANTILES, number, phrase, significant
from estim.drawing import GREY, ORANGE, Axes, Figure, draw_bands, grid, legend_below
from estim.pipeline import Analysis
from estim.problem import Motion, Problem
from estim.reports.records import Record
from estim.words import describe


class RollingSummary(Record):
    """The friction that rolling without slipping takes along the measured way, and how sure it
    is.
    """

    friction_needed: float | None  # median of the largest |F|/N; null: none is enough
    friction_enough_95: float | None  # enough with probability 95 %; null: none is
    where: float  # of the largest need, as x is read
    unit: str
    least_normal: float | None  # N/(M g), median of the smallest
    hops: float  # probability that the ramp would have to pull
    # of rolling all the way with the stated friction; null where none is stated
    probability: float | None
    words: str


def rolling_summaries(analysis: Analysis) -> dict[str, RollingSummary] | None:
    """By run, where there are bodies and the status is ok."""
    if not analysis.rolling or not analysis.diagnosis.ok:
        return None
    return {
        check.run: RollingSummary(
            number(check.typical),
            number(check.enough),
            check.where,
            check.unit,
            number(float(np.median(check.least_normal))),
            check.hops,
            number(check.holds),
            describe(check.finding),
        )
        for check in analysis.rolling
    }


def friction_cell(friction: float | None) -> str:
    """A coefficient of friction, None where none is enough."""
    return phrase("no friction is sufficient") if friction is None else significant(friction, 2)


def rolling_figure(problem: Problem, draws: FloatArray, rolling: Sequence[Rolling]) -> Figure:
    """N/(M g) and |F|/N from the release to the farthest reading, one panel a run with a stated
    friction: median, 68 and 95 % bands.

    draws : (n_draw, n_par).
    """
    stated = {check.run: check for check in rolling if check.stated}
    figure, axes = grid(len(stated), height=2.8)
    named = problem.named(draws)
    for ax, run in zip(axes, (run for run in problem.runs if run.name in stated), strict=True):
        footing = run.body.footing(way_of(run), run.bind(named))
        along = np.median(footing.along, axis=0)
        draw_bands(ax, along, _quantiles(footing.normal), GREY, median="N/(M g)")
        draw_bands(ax, along, _quantiles(finite_or(footing.needed, np.nan)), median="|F|/N")
        _grip(ax, run.body)
        label = run.y_label if run.positions else run.x_label
        ax.set(xlabel=label, ylabel=phrase("share"), ylim=(0.0, None), xlim=(along[0], along[-1]))
        ax.set_title(
            phrase(
                "{run}: rolls along the whole path with probability {p:.2f}",
                run=run.name,
                p=stated[run.name].holds,
            )
        )
    legend_below(figure)
    return figure


def _quantiles(values: FloatArray) -> FloatArray:
    """(5, n_x) where half of the draws get: beyond, a band would be that of the few that do."""
    reached = np.mean(np.isfinite(values), axis=0) > 0.5
    quantiles = np.full((len(QUANTILES), reached.size), np.nan)
    quantiles[:, reached] = np.nanquantile(values[:, reached], QUANTILES, axis=0)
    return quantiles


def _grip(ax: Axes, motion: Motion) -> None:
    """The stated friction, a line with one standard uncertainty."""
    grip = motion.grip
    if grip is None:
        return
    centre, sd = (grip, 0.0) if isinstance(grip, float) else (grip.expectation, grip.sd)
    ax.axhline(centre, color=ORANGE, ls="--", label=phrase("stated friction"))
    ax.axhspan(centre - sd, centre + sd, color=ORANGE, alpha=0.2)
