"""Arrays that users give: one axis, finite numbers."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError
from estim.given_numbers import check_size, real_numbers, require_each


def column(values: ArrayLike | None, field: str) -> FloatArray:
    """(n,) read-only.  Raises InputError naming `field`."""
    array = real_numbers(values, field, "must be a sequence of numbers")
    if array.ndim != 1:
        raise InputError("must be a sequence of numbers, one axis", field=field, value=array.shape)
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise InputError(
            "must be finite", field=field, value=float(array[bad[0]]), index=int(bad[0])
        )
    check_size(array, field)
    array.setflags(write=False)
    return array


_SHARE = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*%(\s+of\s+y)?\s*")


def share_of(text: str) -> tuple[float, bool]:
    """The share that text like "15%" states, and whether it is one of each reading ("15% of y")
    rather than of the curve.  Raises InputError.
    """
    match = _SHARE.fullmatch(text)
    if match is None:
        rule = 'must be numbers, or a share: "15%" of the curve, "15% of y" of each reading'
        raise InputError(rule, field="u_y", value=text)
    if not 0.0 < float(match[1]) < 100.0:
        raise InputError("must be a share between 0 and 100 %", field="u_y", value=text)
    return float(match[1]) / 100.0, match[2] is not None


def errors_of(u: ArrayLike, n_obs: int, field: str, *, some_exact: bool = False) -> FloatArray:
    """(n_obs,) standard deviations given as a number or one for each point.  some_exact : whether
    some of these, not all, may be 0.
    """
    values = real_numbers(u, field)
    sizes = column(np.full(n_obs, values) if values.ndim == 0 else values, field)
    if sizes.size != n_obs:
        raise InputError(
            f"must be a number or have as many values as x ({n_obs})", field=field, value=sizes.size
        )
    valid = sizes >= 0.0 if some_exact and np.any(sizes > 0.0) else sizes > 0.0
    require_each(valid, sizes, "must be > 0", field, of_many=values.ndim > 0)
    check_size(sizes, field, each=True)
    return sizes


def skew_of(u: Any, n_obs: int) -> tuple[Any, FloatArray | None]:
    """Errors of y, and (n_obs,) the root of those above over those below where two rows are given;
    the first are then their geometric means.  Raises InputError.
    """
    if u is None or isinstance(u, str) or np.ndim(rows := real_numbers(u, "u_y")) < 2:
        return u, None
    if len(rows) != 2:
        rule = "must be one row of errors, or two: those below and those above"
        raise InputError(rule, field="u_y", value=rows.shape)
    minus, plus = (
        errors_of(row, n_obs, f"u_y{of}") for row, of in zip(rows, ("", "[plus]"), strict=True)
    )
    return np.sqrt(minus * plus), np.sqrt(plus / minus)
