"""One parameter in `result.json`."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from estim.checks import is_measured, upper_limit
from estim.pipeline import Analysis
from estim.sampling import Summary, number


class ParameterSummary(Summary, frozen=True, kw_only=True):
    prior: str
    prior_mean: float | None
    prior_sd: float | None
    ess_bulk: float | None
    ess_tail: float | None
    rhat: float | None
    mcse: float | None
    stated: str  # what was said of it before, in words and shown units; "" for nothing
    measured: bool | None  # whether the data say something of it: neither a limit nor known hardly better than before; null where not ok
    upper_95: float | None  # one-sided limit of what cannot be negative and may be zero
    true: float | None  # of synthetic data whose truth is known


def parameter_summary(truth: Mapping[str, float], analysis: Analysis, i: int) -> ParameterSummary:
    """Of the parameter at place i.  truth : name -> true value, where it is known."""
    parameter, diagnosis, draws = analysis.problem.parameters[i], analysis.diagnosis, analysis.chain.flat[:, i]
    summary = analysis.summaries[i]
    upper = upper_limit(summary, parameter.prior, draws)
    return ParameterSummary(
        **msgspec.structs.asdict(summary), prior=parameter.prior.describe(),
        prior_mean=number(parameter.prior.expectation),
        prior_sd=number(parameter.prior.sd), ess_bulk=number(diagnosis.ess_bulk[i]), ess_tail=number(diagnosis.ess_tail[i]),
        rhat=number(diagnosis.rhat[i]), mcse=number(diagnosis.mcse[i]), stated=parameter.prior.stated_words(parameter.unit, parameter.label),
        measured=is_measured(summary, parameter.prior, upper) if diagnosis.ok else None, upper_95=upper, true=truth.get(parameter.name),
    )
