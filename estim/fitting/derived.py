"""What follows from the parameters, linear about a fit: values, standard deviations and intervals
without any draw.

    u^2(q) = g^T S g,    g = dq/dp        JCGM 100:2008, 5.2.2

An interval is q at p + k S g / sqrt(g^T S g) for k = ± a quantile: along the direction in which q
changes most for its probability.  For a q that is monotonic in one combination of the parameters it
is exact, however bent q is; where q is linear it is q ± k u(q).  A q of one parameter alone has the
interval of that parameter, which may be that of its profile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, all_finite, sds_of
from estim.common import PROBABILITIES, Label
from estim.distributions import student_quantile
from estim.fitting.degrees_of_freedom import STATED, ErrorSizes
from estim.problem import Derived, Observations

# relative difference of a half interval from a standard deviation, or from t of them, beyond which
# ± misleads
LOPSIDED = 0.2


@dataclass(frozen=True, eq=False)
class LinearDerived:
    """One quantity.

    gradient : (n_par,).
    sd : nan where ± would mislead, or there is none; `interval` then tells more, if it is not nan
        itself.
    interval : probability (0.68, 0.95) -> its ends.
    """

    name: str
    unit: str
    meaning: str
    label: Label
    value: float
    gradient: FloatArray
    sd: float
    interval: Mapping[float, tuple[float, float]]


def linear_derived(
    run: Observations,
    names: Sequence[str],
    values: FloatArray,
    cov: FloatArray,
    *,
    sizes: ErrorSizes = STATED,
    unknown: Sequence[str] = (),
    intervals: Mapping[str, Mapping[float, tuple[float, float]]] = {},
) -> tuple[LinearDerived, ...]:
    """What follows from the parameters `names` of a run at values (n_par,) with covariance cov
    (n_par, n_par), but for what is exact.

    sizes : of the errors.
    unknown : parameters without a standard deviation; what depends on one has none either.
    intervals : name -> probability (0.68, 0.95) -> interval of a parameter, where it has another
        than value ± k u.
    """
    n = values.size
    sds = sds_of(cov)
    # standard deviations, of differences
    steps = 0.01 * np.where(
        np.isfinite(sds) & (sds > 0.0), sds, 1e-4 * np.maximum(np.abs(values), 1e-4)
    )
    varying = {
        q: d
        for q, d in _at(
            run, names, np.vstack([values, values + np.diag(steps), values - np.diag(steps)])
        ).items()
        if d.values.size > 1
    }
    if not varying:
        return ()
    with np.errstate(invalid="ignore"):
        gradients: dict[str, FloatArray] = {
            q: (d.values[1 : n + 1, 0] - d.values[n + 1 :, 0]) / (2.0 * steps)
            for q, d in varying.items()
        }
    quantities = []
    for q, derived in varying.items():
        centre, along = float(derived.values[0, 0]), cov @ gradients[q]
        sd = float(np.sqrt(max(float(gradients[q] @ along), 0.0)))
        (dof,) = sizes.degrees_of_freedom(sizes.shares(gradients[q][None]))
        k68, k95 = (student_quantile(0.5 + 0.5 * p, dof) for p in PROBABILITIES)
        reach = np.array([-k95, -k68, -1.0, 1.0, k68, k95])
        interval, symmetric_sd = dict.fromkeys(PROBABILITIES, (np.nan, np.nan)), np.nan
        moving = np.flatnonzero(gradients[q])
        alone = names[moving[0]] if moving.size == 1 and all_finite(gradients[q]) else ""
        known = sd > 0.0 and not np.any(gradients[q][np.isin(names, list(unknown))])
        if alone in intervals or (np.isfinite(sd) and known):
            points = np.tile(values, (reach.size, 1))
            if alone in intervals:
                (low68, high68), (low95, high95) = (intervals[alone][p] for p in PROBABILITIES)
                points[:, moving[0]] += reach * sds[moving[0]]
                points[[0, 1, 4, 5], moving[0]] = low95, low68, high68, high95
                points = points[:: int(np.sign(gradients[q][moving[0]]))]
            else:
                points += reach[:, None] * along / sd
            low95, low68, below, above, high68, high95 = (
                _at(run, names, points)[q].values[:, 0].tolist()
            )
            # else it has no value there, or turns back
            if low95 <= low68 <= centre <= high68 <= high95:
                interval = dict(zip(PROBABILITIES, ((low68, high68), (low95, high95)), strict=True))
                symmetric_sd = (
                    sd
                    if known
                    and max(abs(above - centre - sd), abs(centre - below - sd)) <= LOPSIDED * sd
                    else np.nan
                )
        quantities.append(
            LinearDerived(
                q,
                derived.unit,
                derived.meaning,
                derived.label,
                centre,
                gradients[q],
                symmetric_sd,
                interval,
            )
        )
    return tuple(quantities)


def _at(run: Observations, names: Sequence[str], points: FloatArray) -> Mapping[str, Derived]:
    """Values (n, 1) of everything that follows at points (n, n_par)."""
    return run.derived(run.bind(dict(zip(names, points.T[..., None], strict=True))))
