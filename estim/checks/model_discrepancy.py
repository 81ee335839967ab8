"""Whether the data show that a user's own curve lacks something, as findings.

A deviation that is larger than was stated of it, or that changes as slowly as a trend, is what a
wrong curve leaves: the intervals of a mixture over deviations then have no coverage
(docs/statistics.md), whatever its size, and the result is a `poor-fit`.
"""

from __future__ import annotations

from collections.abc import Iterable

from estim.checks.unmodelled_force import FAR_LARGER, LIKELY
from estim.common import Finding, Kind
from estim.discrepancy import FoundDeviation, presence
from estim.fitting import MANY_RUNS, Fit

SURE = 0.99  # probability of a deviation beyond which it counts as found
_FEWEST, _MOST = 20, 300  # points of a run, for `unasked`


def deviation_finding(deviation: FoundDeviation, *, x_unit: str, y_unit: str) -> Finding:
    """Whether there is a deviation, and as what it is read in numbers; names: the units of x, y and
    of what errors follow each other in.
    """
    undecided = (
        Kind.DEVIATION_UNDECIDED if deviation.probability > LIKELY else Kind.DEVIATION_UNLIKELY
    )
    kind = Kind.DEVIATION_FOUND if deviation.probability > SURE else undecided
    numbers = {"typical": deviation.residual_part.typical, "most": deviation.residual_part.most}
    for name, size in (("smooth", deviation.smooth), ("correlated", deviation.correlated)):
        if size is not None:
            numbers[name] = (
                size.share / deviation.probability if deviation.probability > 0.0 else 0.0
            )
            numbers |= {
                f"{name}_short": size.length[0],
                f"{name}_length": size.length[1],
                f"{name}_long": size.length[2],
            }
            numbers |= {f"{name}_size": size.amplitude[1]}
    return Finding(
        kind,
        run=deviation.run,
        p=deviation.probability,
        numbers=numbers,
        names=(x_unit, y_unit, deviation.lacks.along_unit),
    )


def deviation_remarks(
    deviation: FoundDeviation, *, x_unit: str, y_unit: str
) -> tuple[Finding, ...]:
    """What is worth a note: a deviation that is surely there, and readings that scatter far less
    than stated.
    """
    finding = deviation_finding(deviation, x_unit=x_unit, y_unit=y_unit)
    conservative = (
        (Finding(Kind.NOISE_CONSERVATIVE, run=deviation.run, size=deviation.noise[1]),)
        if deviation.conservative
        else ()
    )
    return ((finding,) if finding.kind is Kind.DEVIATION_FOUND else ()) + conservative


def unasked(fit: Fit) -> list[Finding]:
    """How probable it is that a curve of the user's, taken as complete, lacks something: of the run
    where that is most probable.
    """
    if fit.problem.shared or len(fit.problem.runs) > MANY_RUNS:
        return []
    runs = [
        run
        for run, likelihood in zip(fit.problem.runs, fit.posterior.likelihoods, strict=True)
        if run.motion is None
        and run.lacks is None
        and not run.numbered
        and run.noise.counted is None
        and likelihood.normal is not None
        and _FEWEST <= run.n_obs <= _MOST
    ]
    candidates = [(presence(run, fit.problem, fit.values), run.name) for run in runs]
    if not candidates:
        return []
    p, name = max(candidates)
    return [Finding(Kind.DEVIATION_UNASKED, run=name if len(fit.problem.runs) > 1 else "", p=p)]


def wrong_curves(deviations: Iterable[FoundDeviation]) -> list[Finding]:
    """The runs whose deviation is larger than there is room for, or a trend."""
    findings = []
    for deviation in deviations:
        smooth = deviation.smooth
        if (
            smooth is not None
            and smooth.share > LIKELY
            and smooth.amplitude[1] > FAR_LARGER * smooth.scale
        ):
            findings.append(
                Finding(
                    Kind.DEVIATION_TOO_LARGE,
                    run=deviation.run,
                    p=deviation.probability,
                    size=smooth.amplitude[1] / smooth.scale,
                )
            )
        slow = {
            part: size.long
            for part, size in (("smooth", smooth), ("correlated", deviation.correlated))
            if size is not None
        }
        if sum(slow.values()) > LIKELY:
            findings.append(
                Finding(
                    Kind.DEVIATION_TOO_SLOW,
                    run=deviation.run,
                    p=sum(slow.values()),
                    names=(max(slow, key=lambda part: slow[part]),),
                )
            )
    return findings
