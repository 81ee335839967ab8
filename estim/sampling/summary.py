"""The summary of one quantity's draws: mean, standard deviation, quantiles, as far as the status
allows them; and how it is quoted.
"""

from __future__ import annotations

import msgspec
import numpy as np

from estim.arrays import FloatArray, all_finite
from estim.common import QUANTILES, Label, Status, format_quantity, format_rounded, number
from estim.fitting import Fit, Limit, limit_cell, limit_of

_LOPSIDED = 1.5
# standard deviations over half of the 68 % interval: a ratio whose denominator comes near 0
_HEAVY = 2.0


class Summary(msgspec.Struct, frozen=True):
    """Posterior of one quantity, SI units and radians.

    mean, sd : None where the status does not allow them, and where `limit` holds what is known.
    limit : of a parameter whose most probable value is an edge of its prior; None for all others.
    """

    unit: str
    meaning: str
    mean: float | None
    sd: float | None
    median: float | None
    q025: float | None
    q16: float | None
    q84: float | None
    q975: float | None
    limit: Limit | None = None


def summarise(draws: FloatArray, *, unit: str, meaning: str) -> Summary:
    """Mean, sd and quantiles of draws (n_draw,)."""
    q025, q16, median, q84, q975 = map(number, _quantiles(draws))
    return Summary(
        unit, meaning, number(draws.mean()), number(draws.std(ddof=1)), median, q025, q16, q84, q975
    )


def summarise_parameter(fit: Fit, name: str, draws: FloatArray) -> Summary:
    """The summary of a parameter's draws (n_draw,): a limit where it lies on an edge of its
    prior.
    """
    parameter = fit.problem.parameters[fit.names.index(name)]
    summary = summarise(draws, unit=parameter.unit, meaning=parameter.meaning)
    limit = limit_of(fit, name, draws)
    return (
        summary
        if limit is None
        else msgspec.structs.replace(summary, mean=None, sd=None, limit=limit)
    )


def _quantiles(draws: FloatArray) -> FloatArray:
    ordered = np.sort(draws)
    if all_finite(ordered):
        return np.quantile(ordered, QUANTILES)
    return ordered[[round(q * (ordered.size - 1)) for q in QUANTILES]]


def trusted(summary: Summary, status: Status, *, sampled: bool = True) -> Summary:
    """`summary` without what its status does not allow: no mean and sd unless ok, nothing at all
    where the draws mean nothing, or are none of a posterior (not `sampled`).
    """
    if status.ok:
        return summary
    if not (status.draws_count and sampled):
        return Summary(summary.unit, summary.meaning, None, None, None, None, None, None, None)
    return msgspec.structs.replace(summary, mean=None, sd=None)


def value_cell(p: Summary, shown: Label) -> str:
    """mean ± sd, median +up −down where the posterior is lopsided, or the limit of what lies on an
    edge.
    """
    if p.limit is not None:
        return limit_cell(p.limit, shown.factor)
    if p.mean is None or p.sd is None or p.median is None or p.q16 is None or p.q84 is None:
        return "n/a"
    if lopsided(p):
        up, down = (p.q84 - p.median) * shown.factor, (p.median - p.q16) * shown.factor
        centre = format_rounded(p.median * shown.factor, min(up, down))
        return (
            f"{centre} +{format_rounded(up, min(up, down))} −{format_rounded(down, min(up, down))}"
        )
    return format_quantity(p.mean * shown.factor, p.sd * shown.factor)


def lopsided(p: Summary) -> bool:
    """Whether one half of the 68 or of the 95 % interval is more than 1.5 times the other, or tails
    make the sd meaningless: then ± misleads.
    """
    if p.median is None or p.q16 is None or p.q84 is None or p.q025 is None or p.q975 is None:
        return False
    halves = ((p.median - p.q16, p.q84 - p.median), (p.median - p.q025, p.q975 - p.median))
    return _heavy(p) or any(max(pair) > _LOPSIDED * min(pair) for pair in halves)


def _heavy(p: Summary) -> bool:
    return (
        p.sd is not None
        and p.q84 is not None
        and p.q16 is not None
        and p.sd > _HEAVY * 0.5 * (p.q84 - p.q16)
    )


def interval_cell(p: Summary, shown: Label) -> str:
    """The 95 % interval, rounded by its width; from the edge on for what lies on one."""
    if p.limit is not None:
        ends = sorted((p.limit.edge * shown.factor, p.limit.limit_95 * shown.factor))
        low, high = (format_rounded(end, 0.25 * (ends[1] - ends[0])) for end in ends)
        return f"[{low}, {high}]"
    if p.q025 is None or p.q975 is None:
        return "n/a"
    u = (p.sd if p.sd is not None and not _heavy(p) else 0.25 * (p.q975 - p.q025)) * shown.factor
    return (
        f"[{format_rounded(p.q025 * shown.factor, u)}, {format_rounded(p.q975 * shown.factor, u)}]"
    )


def parameter_cells(p: Summary, shown: Label) -> tuple[str, str, str, str, str]:
    """Symbol, meaning, value, 95 % interval and unit of one quantity."""
    return (
        shown.symbol,
        p.meaning,
        value_cell(p, shown),
        interval_cell(p, shown),
        "" if shown.unit == "1" else shown.unit,
    )
