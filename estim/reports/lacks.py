"""The section of a report on what a user's own curve lacks; the text stands in `templates/lacks.md.j2`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from estim.checks import deviation_finding
from estim.common import Markdown, significant
from estim.deviation import DeviationSize, FoundDeviation
from estim.pipeline import Analysis
from estim.reports.labels import Labels
from estim.reports.rendering import render
from estim.words import tell


class SizeSummary(msgspec.Struct, frozen=True):
    """One way to read what a curve lacks; quantiles 0.16, 0.5, 0.84 if it is there, null where it certainly is not."""

    share: float  # probability
    prior_scale: float  # of the half-normal prior of its amplitude, unit of y
    amplitude: list[float | None]  # standard deviation, unit of y
    length: list[float | None]
    length_unit: str


class DeviationSummary(msgspec.Struct, frozen=True):
    """What the curve of a run lacks, and what of it the curve cannot make up for, at the points; unit of y."""

    unit: str  # of y
    probability: float  # P(amplitude > 0)
    smooth: SizeSummary | None  # a deviation of y along x
    correlated: SizeSummary | None  # errors of readings that follow each other
    typical: float  # root mean square of the best estimate of the visible part
    most: float  # its largest size
    noise: list[float]  # quantiles 0.16, 0.5, 0.84 of the independent errors, in units of the stated ones, or of y where none were stated
    stated: bool  # whether the size of the errors was stated
    conservative: bool  # whether the readings scatter by far less than stated
    growth: dict[str, float]  # sd of each parameter over that with independent errors, both linearised; empty where the status is not ok
    words: str
    x: list[float]
    low_95: list[float]
    low_68: list[float]
    median: list[float]
    high_68: list[float]
    high_95: list[float]


@dataclass(frozen=True)
class _Section:
    run: str
    summary: DeviationSummary
    y_unit: str
    grown: list[tuple[str, str]]


def curve_deviations(analysis: Analysis) -> dict[str, DeviationSummary] | None:
    """Run -> what its curve lacks; None where that was not asked for."""
    return {found.run: _summary(analysis, found) for found in analysis.fit.deviations} or None


def lacks_text(found: Mapping[str, DeviationSummary], labels: Labels, pictures: Collection[str]) -> Markdown:
    """Markdown fragment without a heading.  pictures : paths of the figures beside it."""
    sections = []
    for run, summary in found.items():
        grown = [(labels.symbol(name), significant(factor, 2)) for name, factor in summary.growth.items()]
        sections.append(_Section(run, summary, "" if summary.unit == "1" else summary.unit, grown))
    return render("lacks.md.j2", pictures=pictures, sections=sections)


def _summary(analysis: Analysis, found: FoundDeviation) -> DeviationSummary:
    problem, visible = analysis.problem, found.visible
    run = next(run for run in problem.runs if run.name == found.run)
    low_95, low_68, median, high_68, high_95 = visible.quantiles.tolist()
    return DeviationSummary(
        unit=run.y_unit, probability=found.probability, smooth=_size(found.smooth, run.x_unit),
        correlated=_size(found.correlated, found.lacks.along_unit),
        typical=visible.typical, most=visible.most, noise=list(found.noise), stated=found.lacks.stated, conservative=found.conservative,
        growth=dict(found.growth) if analysis.diagnosis.ok else {},
        words=tell(deviation_finding(found, x_unit=run.x_unit, y_unit=run.y_unit)),
        x=visible.x.tolist(), low_95=low_95, low_68=low_68, median=median, high_68=high_68, high_95=high_95,
    )


def _size(size: DeviationSize | None, unit: str) -> SizeSummary | None:
    if size is None:
        return None
    amplitude, length = ([None if np.isnan(one) else one for one in three] for three in (size.amplitude, size.length))
    return SizeSummary(size.share, size.scale, amplitude, length, unit)
