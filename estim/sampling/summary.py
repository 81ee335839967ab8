"""The summary of one quantity's draws: mean, standard deviation, quantiles, as far as the status
allows them.
"""

from __future__ import annotations

import msgspec
import numpy as np

from estim.arrays import FloatArray, all_finite
from estim.common import QUANTILES, Status, number
from estim.fitting import Fit, Limit, limit_of


class Summary(msgspec.Struct, frozen=True):
    """Posterior of one quantity, SI units and radians.

    mean, sd : None where the status does not allow them, and where `limit` says what is known.
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
