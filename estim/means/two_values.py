"""Two values of one quantity compared: their difference and E_n (ISO 13528)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estim.common import InputError, Quantity, behind, difference, e_n, read_with_unit, rounded


@dataclass(frozen=True)
class TwoValues:
    """difference : first minus second.  unit : of both, "1" for none.  e_n : the difference in
    units of its expanded uncertainty U = 2 u.
    """

    difference: Quantity
    unit: str
    e_n: float

    @property
    def agree(self) -> bool:
        """Whether |E_n| <= 1."""
        return abs(self.e_n) <= 1.0

    def __str__(self) -> str:
        apart = self.difference
        u, expanded = (
            rounded(size, apart.u, 2, beside=apart.value) + behind(self.unit)
            for size in (apart.u, 2.0 * apart.u)
        )
        shown = rounded(apart.value, apart.u, 2) + behind(self.unit)
        told = "agree" if self.agree else "do not agree"
        return (
            f"difference: {shown}, u = {u}, U = k u = {expanded} with k = 2\n"
            f"E_n = {self.e_n:.2f}: the two values {told} (|E_n| <= 1)"
        )


def compare_values(
    first: str | tuple[Quantity, str], second: str | tuple[Quantity, str], *, r: float = 0.0
) -> TwoValues:
    """The difference of two values in text, "9.81(2) m/s²", or as quantities with their units.

    first, second : the two, of independent errors unless `r` says otherwise.
    r : correlation of their errors.  Raises InputError where the units differ, and where nothing is
    uncertain.

    >>> from estim import compare_values
    >>> print(compare_values("9.81(2) m/s²", "9.75(1) m/s²"))
    difference: 0.060 m/s², u = 0.022 m/s², U = k u = 0.045 m/s² with k = 2
    E_n = 1.34: the two values do not agree (|E_n| <= 1)
    """
    (a, unit), (b, other) = (
        read_with_unit(given, field=field) if isinstance(given, str) else given
        for field, given in (("first", first), ("second", second))
    )
    if unit != other:
        raise InputError(f"must be in {unit}, as the first", field="second", value=other)
    if not abs(r) <= 1.0:
        raise InputError("must be between -1 and 1", field="r", value=r)
    apart, score = difference(a, b, correlation=r), e_n(a, b, correlation=r)
    if math.isnan(score):
        raise InputError(
            "has no uncertainty, so that nothing tells whether the values agree",
            field="difference",
            value=apart.value,
        )
    return TwoValues(apart, unit, score)
