"""Numbers and arrays that a person hands over in Python: the one gate, which lets no value pass for
another.

NumPy turns dates into counts of whatever unit they are kept in, drops masks and imaginary parts,
and reads text and truth values as numbers.  Here each of them is refused by one line that says the
cure.
"""

from __future__ import annotations

from datetime import date, timedelta
from numbers import Number, Real
from typing import Any

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.common import EXTREME, InputError, extreme

_UNITS = ", not quantities with units: take their magnitudes, all in one unit"
_REFUSED = {
    "M": ", not dates: count them from one of them, (t - t[0])/numpy.timedelta64(1, 's')",
    "m": ", not differences of times: divide them by a unit, t/numpy.timedelta64(1, 's')",
    "c": ", real ones: of complex ones take the real part, the imaginary part or the size",
    "b": ", not true and false: where 0 and 1 are meant, say so by .astype(float)",
    "U": ", not text",
    "S": ", not text",
    "V": ", not records of several fields: take one field",
    "±": ", not ones with uncertainties: give nominal values here, and their uncertainties as u_y, "
    "u_x or u (nominal_values and std_devs of uncertainties.unumpy)",
}
_KINDS = ((bool, "b"), (str, "U"), (bytes, "S"), (complex, "c"), (date, "M"), (timedelta, "m"))


def random_generator(rng: np.random.Generator | int | None, seed: int = 1) -> np.random.Generator:
    """`rng`, or a generator of the seed that it is; of `seed` where it is None.  Raises
    InputError.
    """
    rng = seed if rng is None else rng
    whole = isinstance(rng, int | np.integer) and not isinstance(rng, bool) and rng >= 0
    if whole or isinstance(rng, np.random.Generator):
        return np.random.default_rng(rng)
    rule = "must be a seed (a whole number from 0) or a numpy.random.Generator"
    raise InputError(rule, field="rng", value=rng)


def real_numbers(values: Any, field: str, rule: str = "must be numbers") -> FloatArray:
    """`values` as floats in an array of its own, of whatever shape.  Raises InputError naming
    `field` for whatever is no real number.

    rule : what is required, to which the reason why the values are not that is added.
    """
    if hasattr(values, "to_base_units") or (
        hasattr(values, "unit") and hasattr(values, "to_value")
    ):
        raise InputError(f"must be plain numbers here{_UNITS}", field=field, value=str(values))
    if masked := _masked(values):
        cure = (
            "must not be masked: leave those points out of all arrays, as x[~y.mask] and y[~y.mask]"
        )
        raise InputError(cure, field=field, value=f"{masked} masked")
    why, kinds = "", _kinds(values)
    if "q" in kinds:  # NumPy would warn, and take their numbers in whatever unit
        raise InputError(rule + _UNITS, field=field, value=values)
    try:
        array = np.asarray(values)
        kinds |= {array.dtype.kind, *(_kinds(array) if array.dtype.kind == "O" else ())}
        why = next((words for kind, words in _REFUSED.items() if kind in kinds), "")
        if values is not None and not why:
            return np.array(array, dtype=float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(rule + why, field=field, value=values)


def real_number(value: Any, field: str, rule: str = "must be a number") -> float:
    """One number as a float.  Raises InputError naming `field`."""
    if hasattr(value, "nominal_value"):  # there is no u beside it
        rule += ", without an uncertainty (its nominal_value)"
        raise InputError(rule, field=field, value=value)
    number = real_numbers(value, field, rule)
    if number.ndim:
        raise InputError(rule, field=field, value=value)
    return float(number)


def finite_numbers(values: Any, field: str, rule: str = "must be numbers") -> FloatArray:
    """`real_numbers` that are finite.  Raises InputError naming `field`."""
    array = real_numbers(values, field, rule)
    bad = array[~np.isfinite(array)]
    if bad.size:
        raise InputError("must be finite", field=field, value=float(bad[0]))
    check_size(array, field)
    return array


def require_each(
    valid: BoolArray, values: FloatArray, rule: str, field: str, *, of_many: bool = True
) -> None:
    """Raises InputError naming `field` at the first of `values` (n,), or of their rows (n, ...),
    that is not `valid` (n,).

    of_many : whether a person gave several, of which it has a number.
    """
    if not np.all(valid):
        at = int(np.argmin(valid))
        raise InputError(
            rule, field=field, value=values[at].tolist(), index=at if of_many else None
        )


def check_size(values: FloatArray, field: str, *, each: bool = False) -> None:
    """Raises InputError naming `field` where the largest of finite `values` is beyond all measure,
    so that its square may be no number.

    each : whether none may be; one that is 0 is not.
    """
    sizes = np.abs(values[values != 0.0])
    for size in (np.max(sizes), np.min(sizes))[: 1 + each] if sizes.size else ():
        if extreme(float(size)):
            raise InputError(EXTREME, field=field, value=float(size))


def check_lengths(x: FloatArray, y: FloatArray) -> None:
    """Raises InputError naming y where it has not a value for each x."""
    if y.size != x.size:
        edges = (
            "; edges of bins are no x: give the middles of the bins, and noise=Poisson(bins=edges) "
            "for counts"
        )
        rule = f"must have as many values as x ({x.size})"
        raise InputError(rule + edges * (x.size == y.size + 1), field="y", value=y.size)


def check_whole(value: Any, field: str, least: int) -> None:
    """Raises InputError naming `field` for what is no whole number from `least` on."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least:
        raise InputError(f"must be a whole number >= {least}", field=field, value=value)


def are_complex(values: Any) -> bool:
    """Whether `values`, an array, a column, a list of numbers or one of them, are complex."""
    if isinstance(values, list | tuple):
        return any(map(are_complex, values)) and all(isinstance(one, Number) for one in values)
    numbers = getattr(values, "magnitude", values)  # pint has no `iscomplexobj` of its own
    return not hasattr(values, "nominal_value") and bool(np.iscomplexobj(numbers))


def check_probability(probability: Any, field: str = "probability") -> None:
    """Raises InputError naming `field` for what is no probability between 0 and 1."""
    if not isinstance(probability, Real) or not 0.0 < float(probability) < 1.0:
        raise InputError("must lie between 0 and 1", field=field, value=probability)


def _masked(values: Any) -> int:
    """How many values are masked, also in lists of arrays and numbers."""
    if isinstance(values, np.ma.MaskedArray):
        return int(np.count_nonzero(np.ma.getmaskarray(values)))
    return sum(map(_masked, values)) if isinstance(values, list | tuple) else 0


def _kinds(values: Any) -> set[str]:
    """The letters by which NumPy calls what lists and arrays of objects are made of, before numbers
    of several types become one type.
    """
    if isinstance(values, np.ndarray):
        return (
            {_kind(one) for one in set(map(type, values.flat))}
            if values.dtype.kind == "O"
            else {values.dtype.kind}
        )
    if not isinstance(values, list | tuple):
        return {_kind(type(values))}
    inner = [_kinds(one) for one in values if isinstance(one, list | tuple | np.ndarray)]
    return {_kind(one) for one in set(map(type, values))}.union(*inner)


def _kind(made_of: type) -> str:
    if issubclass(made_of, np.generic):
        return np.dtype(made_of).kind
    if hasattr(made_of, "to_base_units"):  # of pint
        return "q"
    if hasattr(made_of, "nominal_value"):  # of the package uncertainties
        return "±"
    return next((kind for known, kind in _KINDS if issubclass(made_of, known)), "f")
