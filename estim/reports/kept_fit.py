"""A fit that was kept as `result.json`, read back as the normal distribution of its parameters."""

from __future__ import annotations

import msgspec
import numpy as np

from estim.campaign import Campaign
from estim.common import InputError
from estim.reports.result import SCHEMA, Result
from estim.studies import FittedValues


def fitted_values(campaign: Campaign, text: str, *, place: str) -> FittedValues:
    """Means and covariance of the parameters in `text`, a `result.json` that stands at `place`.

    A parameter on an edge of its prior has no mean: it is left to its prior.  Raises InputError where it is no result of this campaign as it stands,
    or not ok.
    """
    try:
        result = msgspec.json.decode(text, type=Result)
    except (msgspec.DecodeError, msgspec.ValidationError):
        raise InputError(f"must be the result.json of `estim fit` ({SCHEMA})", field="--fit", file=place) from None
    if result.status != "ok":
        raise InputError("must be that of a fit that is ok", field="status", value=result.status, file=place)
    if result.provenance.campaign_sha256 != campaign.sha256:
        raise InputError("must be that of the campaign as it stands: fit it again", field="campaign_sha256", file=place)
    known = {name: p for name, p in result.parameters.items() if p.mean is not None and p.sd is not None}
    chosen = [i for i, name in enumerate(result.correlation.names) if name in known]
    names = tuple(result.correlation.names[i] for i in chosen)
    sds = np.array([known[name].sd for name in names], dtype=float)
    correlation = np.array(result.correlation.matrix, dtype=float)
    if correlation.shape != (len(result.correlation.names),) * 2 or not names:
        raise InputError("must be a square matrix with a row for each parameter", field="correlation", file=place)
    means = np.array([known[name].mean for name in names], dtype=float)
    return FittedValues(names, means, correlation[np.ix_(chosen, chosen)] * np.outer(sds, sds), place)
