"""The section of a report on what the curve lacks; the text stands in `templates/deviation.md.j2`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from estim.checks import force_finding, noise_finding
from estim.common import Markdown, significant
from estim.deviation import FoundForce
from estim.pipeline import Analysis
from estim.reports.labels import Labels
from estim.reports.rendering import render
from estim.words import tell

_AVERAGE = "rolling_resistance"  # what a constant force is part of


class AverageResistance(msgspec.Struct, frozen=True):
    """The coefficient of rolling resistance: the average over this track, and what it says of the material."""

    parameter: str
    sd: float
    sd_material: float  # as a constant that holds on another track too


class ForceSummary(msgspec.Struct, frozen=True):
    """An unmodelled force along the track of a run, in units of the weight; positions in `unit`."""

    prior_scale: float  # of the half-normal prior of its amplitude
    probability: float  # P(amplitude > 0)
    amplitude: list[float]  # quantiles 0.16, 0.5, 0.84
    length: list[float | None]  # the same, over which it changes
    unit: str
    typical: float  # root mean square of the best estimate along the track
    most: float  # its largest size
    noise: list[float]  # quantiles 0.16, 0.5, 0.84 of the size of the noise of the readings, 1: as stated
    conservative: bool  # whether the readings scatter by far less than stated
    runs: list[str]  # that share it; one where it is that of a run alone
    own: dict[str, float]  # run -> root mean square of what it adds to a shared force; empty where none is shared
    growth: dict[str, float]  # sd of each parameter over that with the stated noise and an exact start, linearised; empty where not ok
    average: AverageResistance | None
    words: str
    drawn: bool  # whether the bands of the curve hold it
    noise_words: str | None  # where the readings scatter plainly otherwise than stated
    x: list[float]
    low_95: list[float]
    low_68: list[float]
    median: list[float]
    high_68: list[float]
    high_95: list[float]


@dataclass(frozen=True)
class _Section:
    run: str
    summary: ForceSummary
    grown: list[tuple[str, str]]
    average: str
    sd: str
    sd_material: str


def deviations(analysis: Analysis) -> dict[str, ForceSummary] | None:
    """Run, or body of runs that share one -> its unmodelled force; None where none was asked for."""
    return {found.run: _summary(analysis, found) for found in analysis.fit.forces} or None


def deviation_text(forces: Mapping[str, ForceSummary], labels: Labels, pictures: Collection[str]) -> Markdown:
    """Markdown fragment without a heading.  pictures : paths of the figures beside it."""
    sections = []
    for run, force in forces.items():
        grown = [(labels.symbol(name), significant(factor, 2)) for name, factor in force.growth.items()]
        average = force.average
        sections.append(
            _Section(
                run, force, grown, "" if average is None else labels.symbol(average.parameter),
                "" if average is None else significant(average.sd, 2), "" if average is None else significant(average.sd_material, 2),
            )
        )
    return render("deviation.md.j2", pictures=pictures, sections=sections)


def _summary(analysis: Analysis, found: FoundForce) -> ForceSummary:
    force, problem, noise = found.force, analysis.problem, noise_finding(found)
    sds = dict(zip(problem.names, np.std(analysis.chain.flat, axis=0).tolist(), strict=True))
    ok = analysis.diagnosis.ok
    low_95, low_68, median, high_68, high_95 = force.quantiles.tolist()
    return ForceSummary(
        prior_scale=found.scale, probability=force.probability, amplitude=list(force.amplitude),
        length=[None if np.isnan(one) else one for one in force.length], unit=found.unit, typical=force.typical, most=force.most,
        noise=list(found.noise), conservative=found.conservative, runs=list(found.runs),
        own={one.run: float(np.sqrt(np.mean(np.square(one.mean)))) for one in found.own},
        growth=dict(found.growth) if ok else {}, average=_average(analysis, found, sds) if ok else None,
        words=tell(force_finding(found)), drawn=found.completed is not None, noise_words=None if noise is None else tell(noise), x=force.x.tolist(),
        low_95=low_95, low_68=low_68, median=median, high_68=high_68, high_95=high_95,
    )


def _average(analysis: Analysis, found: FoundForce, sds: Mapping[str, float]) -> AverageResistance | None:
    run = next(run for run in analysis.problem.runs if run.name == found.runs[0])
    name = run.arguments.get(_AVERAGE)
    if not isinstance(name, str):
        return None
    return AverageResistance(name, sds[name], float(np.hypot(sds[name], found.force.material_sd / found.upright)))
