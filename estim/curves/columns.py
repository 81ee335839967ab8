"""Arrays that users give: one axis, finite numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError
from estim.given_numbers import real_numbers


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
    array.setflags(write=False)
    return array


def errors_of(u: ArrayLike, n_obs: int, field: str) -> FloatArray:
    """(n_obs,) standard deviations given as a number or one for each point."""
    given = real_numbers(u, field)
    sizes = column(np.full(n_obs, given) if given.ndim == 0 else given, field)
    if sizes.size != n_obs:
        raise InputError(
            f"must be a number or have as many values as x ({n_obs})", field=field, value=sizes.size
        )
    if np.any(sizes <= 0.0):
        bad = int(np.argmax(sizes <= 0.0))
        raise InputError(
            "must be > 0", field=field, value=float(sizes[bad]), index=bad if given.ndim else None
        )
    return sizes
