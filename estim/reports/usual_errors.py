"""Usual errors of clock and length scale as a reader sees them: a record, and a row of the table of inputs."""

from __future__ import annotations

import msgspec

from estim.campaign import EFFECTS, USUAL_KEYS
from estim.common import format_quantity
from estim.deviation import read_off
from estim.pipeline import Analysis


class UsualError(msgspec.Struct, frozen=True):
    """A small error in common to all points that the campaign does not speak of, taken into the covariance; shares."""

    run: str
    error: str
    key: str  # of the campaign, which says it instead; 0 leaves it out
    prior_sd: float
    mean: float | None  # what the data say of it, to first order
    sd: float | None


def usual_errors(analysis: Analysis) -> list[UsualError]:
    """Those of all runs, with what the data say of them where the status is ok."""
    fit, ok = analysis.fit, analysis.diagnosis.ok
    return [
        UsualError(one.run, one.name, USUAL_KEYS[one.name], one.prior_sd, one.mean if ok else None, one.sd if ok else None)
        for one in read_off(fit.posterior, fit.values, fit.cov)
    ]


def usual_row(error: UsualError) -> dict[str, str]:
    """Its cells in the table of inputs."""
    kind, prior = EFFECTS[error.key], format_quantity(0.0, error.prior_sd)
    posterior = "" if error.mean is None or error.sd is None else format_quantity(error.mean, error.sd)
    return {"symbol": kind.notation.symbol, "meaning": kind.meaning, "prior": prior, "posterior": posterior, "key": error.key}
