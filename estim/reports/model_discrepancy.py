"""The sections of a report on what the curve lacks: an unmodelled force along a track, or the
deviation of a user's own curve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estim.arrays import FloatArray, root_mean_square
from estim.checks import deviation_finding, force_finding, noise_finding
from estim.common import OF_BODY, number, phrase
from estim.discrepancy import DeviationSize, FoundDeviation, FoundForce
from estim.drawing import GREY, INK, ORANGE, RUN_COLOURS, Figure, draw_bands, grid, legend_below
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.reports.records import Record
from estim.words import describe

_AVERAGE = "rolling_resistance"  # what a constant force is part of


class AverageResistance(Record):
    """The coefficient of rolling resistance: the average over this track, and what it says of the
    material.
    """

    parameter: str
    sd: float
    sd_material: float  # as a constant that holds on another track too


class Band(Record, kw_only=True):
    """An estimate along x, with the ends of its 68 and 95 % intervals."""

    x: list[float]
    low_95: list[float]
    low_68: list[float]
    median: list[float]
    high_68: list[float]
    high_95: list[float]


class ForceSummary(Band):
    """An unmodelled force along the track of a run, in units of the weight; positions in `unit`."""

    prior_scale: float  # of the half-normal prior of its amplitude
    probability: float  # P(amplitude > 0)
    amplitude: list[float]  # quantiles 0.16, 0.5, 0.84
    length: list[float | None]  # the same, over which it changes
    unit: str
    typical: float  # root mean square of the best estimate along the track
    most: float  # its largest size
    # quantiles 0.16, 0.5, 0.84 of the size of the noise of the readings, 1: as stated
    noise: list[float]
    conservative: bool  # whether the readings scatter by far less than stated
    runs: list[str]  # that share it; one where it is that of a run alone
    # run -> root mean square of what it adds to a shared force; empty where none is shared
    own: dict[str, float]
    # sd of each parameter over that with the stated noise and an exact start, linearised; empty
    # where not ok
    growth: dict[str, float]
    average: AverageResistance | None
    words: str
    drawn: bool  # whether the bands of the curve hold it
    noise_words: str | None  # where the readings scatter plainly otherwise than stated


def force_summary(analysis: Analysis, found_force: FoundForce) -> ForceSummary:
    """The record of an unmodelled force."""
    force, problem, noise = found_force.force, analysis.problem, noise_finding(found_force)
    sds = dict(zip(problem.names, np.std(analysis.chain.flat, axis=0).tolist(), strict=True))
    ok = analysis.diagnosis.ok
    return ForceSummary(
        prior_scale=found_force.scale,
        probability=force.probability,
        amplitude=list(force.amplitude),
        length=list(map(number, force.length)),
        unit=found_force.unit,
        typical=force.typical,
        most=force.most,
        noise=list(found_force.noise),
        conservative=found_force.conservative,
        runs=list(found_force.runs),
        own={entry.run: root_mean_square(entry.mean) for entry in found_force.own},
        growth=dict(found_force.growth) if ok else {},
        average=_average(analysis, found_force, sds) if ok else None,
        words=describe(force_finding(found_force)),
        drawn=found_force.completed is not None,
        noise_words=None if noise is None else describe(noise),
        **_band(force.x, force.quantiles),
    )


def _band(x: FloatArray, quantiles: FloatArray) -> dict[str, list[float]]:
    """The fields of a `Band`.  x : (n_x,).  quantiles : (5, n_x) at `QUANTILES`."""
    names = ("x", "low_95", "low_68", "median", "high_68", "high_95")
    return dict(zip(names, np.vstack([x, quantiles]).tolist(), strict=True))


def _average(
    analysis: Analysis, found_force: FoundForce, sds: Mapping[str, float]
) -> AverageResistance | None:
    run = next(run for run in analysis.problem.runs if run.name == found_force.runs[0])
    name = run.arguments.get(_AVERAGE)
    if not isinstance(name, str):
        return None
    return AverageResistance(
        name,
        sds[name],
        float(np.hypot(sds[name], found_force.force.material_sd / found_force.upright)),
    )


def force_figure(forces: Sequence[FoundForce], runs: Sequence[Observations]) -> Figure:
    """Median with 68 and 95 % bands, in percent of the weight; ticks where the points lie."""
    figure, axes = grid(len(forces), height=2.8)
    by_name = {run.name: run for run in runs}
    for ax, estimate in zip(axes, forces, strict=True):
        several, force = [by_name[name] for name in estimate.runs], estimate.force
        draw_bands(ax, force.x, 100.0 * force.quantiles, median=phrase("median"))
        ax.axhline(0.0, color=GREY)
        if force.back is not None:
            ax.plot(
                force.x,
                100.0 * force.back[2],
                color=ORANGE,
                ls="--",
                label=phrase("way back, median and 68 %"),
            )
            ax.plot(np.tile(force.x, (2, 1)).T, 100.0 * force.back[[1, 3]].T, color=ORANGE, ls=":")
        for addition, colour in zip(
            estimate.own, RUN_COLOURS[1:] * len(estimate.own), strict=False
        ):
            ax.plot(
                addition.x,
                100.0 * addition.mean,
                color=colour,
                label=phrase("{run} adds", run=addition.run),
            )
        place = np.concatenate([run.position for run in several])
        label = several[0].y_label if several[0].positions else several[0].x_label
        ax.plot(
            place,
            0.0 * place + 0.025,
            "|",
            color=INK,
            transform=ax.get_xaxis_transform(),
            label=phrase("fitted points"),
        )
        ax.set(
            xlabel=label,
            ylabel=phrase("force (% of the weight)"),
            xlim=(force.x[0], force.x[-1]),
            title=phrase(
                "{title}: P(amplitude > 0) = {p:.3f}", title=_title(estimate), p=force.probability
            ),
        )
    legend_below(figure, ncols=4)
    return figure


def _title(found_force: FoundForce) -> str:
    return (
        found_force.run
        if len(found_force.runs) == 1
        else phrase(
            "body {body}, shared by {n} runs",
            body=found_force.run.removeprefix(OF_BODY),
            n=len(found_force.runs),
        )
    )


class SizeSummary(Record):
    """One way to read what a curve lacks; quantiles 0.16, 0.5, 0.84 if it is there, null where it
    certainly is not.
    """

    share: float  # probability
    prior_scale: float  # of the half-normal prior of its amplitude, unit of y
    amplitude: list[float | None]  # standard deviation, unit of y
    length: list[float | None]
    length_unit: str


class DeviationSummary(Band):
    """What the curve of a run lacks, and what of it the curve cannot make up for, at the points;
    unit of y.
    """

    unit: str  # of y
    probability: float  # P(amplitude > 0)
    smooth: SizeSummary | None  # a deviation of y along x
    correlated: SizeSummary | None  # errors of readings that follow each other
    typical: float  # root mean square of the best estimate of the visible part
    most: float  # its largest size
    # quantiles 0.16, 0.5, 0.84 of the independent errors, in units of the stated ones, or of y
    # where none were stated
    noise: list[float]
    stated: bool  # whether the size of the errors was stated
    conservative: bool  # whether the readings scatter by far less than stated
    # sd of each parameter over that with independent errors, both linearised; empty where the
    # status is not ok
    growth: dict[str, float]
    words: str


def deviation_summary(analysis: Analysis, deviation: FoundDeviation) -> DeviationSummary:
    """The record of what the curve of a run lacks."""
    problem, visible = analysis.problem, deviation.residual_part
    run = next(run for run in problem.runs if run.name == deviation.run)
    return DeviationSummary(
        unit=run.y_unit,
        probability=deviation.probability,
        smooth=_size(deviation.smooth, run.x_unit),
        correlated=_size(deviation.correlated, deviation.lacks.along_unit),
        typical=visible.typical,
        most=visible.most,
        noise=list(deviation.noise),
        stated=deviation.lacks.stated,
        conservative=deviation.conservative,
        growth=dict(deviation.growth) if analysis.diagnosis.ok else {},
        words=describe(deviation_finding(deviation, x_unit=run.x_unit, y_unit=run.y_unit)),
        **_band(visible.x, visible.quantiles),
    )


def _size(size: DeviationSize | None, unit: str) -> SizeSummary | None:
    if size is None:
        return None
    amplitude, length = (list(map(number, three)) for three in (size.amplitude, size.length))
    return SizeSummary(size.share, size.scale, amplitude, length, unit)


def discrepancy_figure(
    deviations: Sequence[FoundDeviation], runs: Sequence[Observations]
) -> Figure:
    """Median with 68 and 95 % bands; points: the residuals of the best curve with independent
    errors.
    """
    figure, axes = grid(len(deviations), height=2.8)
    by_name = {run.name: run for run in runs}
    for ax, deviation in zip(axes, deviations, strict=True):
        run, visible = by_name[deviation.run], deviation.residual_part
        draw_bands(ax, visible.x, visible.quantiles, median=phrase("median"))
        ax.plot(visible.x, visible.residuals, ".", color=INK, label=phrase("residuals"))
        ax.axhline(0.0, color=GREY)
        ax.set(
            xlabel=run.x_label,
            ylabel=phrase("deviation of {y}", y=run.y_label),
            xlim=(visible.x[0], visible.x[-1]),
            title=phrase(
                "{title}: P(amplitude > 0) = {p:.3f}", title=run.name, p=deviation.probability
            ),
        )
    legend_below(figure, ncols=4)
    return figure
