"""What a user states in Python that a curve may lack: the arguments `deviation` and `correlated` of
`fit_curve`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import IntArray
from estim.common import InputError, phrase
from estim.given_numbers import finite_numbers, real_number
from estim.problem import MAX_LACKING, Discrepancy


def discrepancy_of(
    deviation: float, correlated: ArrayLike | bool, order: IntArray, *, stated: bool, exact_x: bool
) -> Discrepancy | None:
    """What the curve of `fit_curve` may lack, None for nothing; order : (n_obs,) of the points by
    x.  Raises InputError.
    """
    deviation = real_number(deviation, "deviation")
    if not (math.isfinite(deviation) and deviation >= 0.0):
        raise InputError(
            "is in the unit of y: it must be > 0, or 0 for none", field="deviation", value=deviation
        )
    is_flag = isinstance(correlated, bool | np.bool_)
    if not deviation and is_flag and not correlated:
        return None
    field = "deviation" if deviation else "correlated"
    if not exact_x:
        raise InputError("cannot be combined with errors of x: omit u_x", field=field)
    if order.size > MAX_LACKING:
        step = -(-order.size // MAX_LACKING)
        raise InputError(
            f"goes with at most {MAX_LACKING} points: take one in {step} of them (every = "
            f"{step} in a campaign)",
            field=field,
            value=order.size,
        )
    if is_flag:
        return Discrepancy(
            float(deviation),
            order.astype(float) if correlated else None,
            "readings" if correlated else "",
            stated,
        )
    times = np.ravel(
        finite_numbers(correlated, "correlated", "must be True, or the times of the points")
    )
    if times.size != order.size or not float(np.ptp(times)) > 0.0:
        raise InputError(
            f"must be True, or {order.size} times that are not all the same",
            field="correlated",
            value=times.size,
        )
    return Discrepancy(
        float(deviation), times[order], phrase("in the unit of 'correlated'"), stated
    )
