"""Two values of one quantity compared: their difference and E_n (ISO 13528)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal

from estim.common import (
    InputError,
    Quantity,
    behind,
    difference,
    format_rounded,
    read_with_unit,
    same_numbers,
    signed,
    with_unit,
)
from estim.distributions import student_quantile


@dataclass(frozen=True)
class TwoValues:
    """difference : first minus second.  unit : of both, "1" for none.  e_n : the difference in
    units of its expanded uncertainty U = k u.

    dof : effective degrees of freedom of u.  k : coverage factor, 2 or that of Student's t for
        95 %, whichever is larger.
    """

    difference: Quantity
    unit: str
    e_n: float
    dof: float = math.inf
    k: float = 2.0

    @property
    def agree(self) -> bool:
        """Whether |E_n| <= 1, but for rounding errors."""
        return abs(self.e_n) <= 1.0 + 1e-9

    def __str__(self) -> str:
        delta = self.difference
        u, expanded = (
            format_rounded(size, delta.u, beside=delta.value) + behind(self.unit)
            for size in (delta.u, self.k * delta.u)
        )
        shown = format_rounded(delta.value, delta.u) + behind(self.unit)
        k = "2" if self.k == 2.0 else f"{self.k:.2f} for {self.dof:.3g} degrees of freedom"
        verdict = "agree (|E_n| <= 1)" if self.agree else "do not agree (|E_n| > 1)"
        return (
            f"difference: {shown}, u = {u}, U = k u = {expanded} with k = {k}\n"
            f"E_n = {signed(f'{self.e_n:.2f}')}: the two values {verdict}"
        )


def compare_values(
    first: str | tuple[Quantity, str] | tuple[Quantity, str, float],
    second: str | tuple[Quantity, str] | tuple[Quantity, str, float],
    *,
    r: float = 0.0,
) -> TwoValues:
    """The difference of two values in text, "9.81(2) m/s²", or as quantities with their units and,
    where they are few, the degrees of freedom of their uncertainties.

    first, second : the two, of independent errors unless `r` is given.
    r : correlation of their errors.  Raises InputError where the units differ, and where nothing is
    uncertain.

    >>> from estim import compare_values
    >>> print(compare_values("9.81(2) m/s²", "9.75(1) m/s²"))
    difference: 0.060 m/s², u = 0.022 m/s², U = k u = 0.045 m/s² with k = 2
    E_n = 1.34: the two values do not agree (|E_n| > 1)
    """
    (a, unit, dof), (b, other, dof_b) = (
        (*value, math.inf)[:3]
        if isinstance(value, tuple) and isinstance(value[0], Quantity)
        else (*read_with_unit(value, field=field), math.inf)
        for field, value in (("first", first), ("second", second))
    )
    if unit != other and not same_numbers(unit, other):
        wanted = "have no unit" if unit == "1" else f"be in {unit}"
        value = "no unit" if other == "1" else other
        raise InputError(f"must {wanted}, as the first", field="second", value=value)
    if not abs(r) <= 1.0:
        raise InputError("must be between -1 and 1", field="r", value=r)
    delta = difference(a, b, correlation=r)
    dof = min(dof, dof_b) if r else _effective_dof(a.u, dof, b.u, dof_b)
    # 95 %, as in other results; 2 is as large as for 60 degrees of freedom
    k = max(2.0, float(student_quantile(0.975, dof)))
    if not delta.u > 0.0:
        raise InputError(
            "has no uncertainty, so that nothing tells whether the values agree",
            field="difference",
            value=with_unit(
                signed(f"{Decimal(repr(float(a.value))) - Decimal(repr(float(b.value))):g}"), unit
            ),
        )
    return TwoValues(delta, unit, delta.value / (k * delta.u), dof, k)


def _effective_dof(u: float, dof: float, u_b: float, dof_b: float) -> float:
    """Those of a difference (Welch-Satterthwaite, GUM eq. G.2b)."""
    combined = math.hypot(u, u_b)
    inverse = (u / combined) ** 4 / dof + (u_b / combined) ** 4 / dof_b if combined > 0.0 else 0.0
    return 1.0 / inverse if inverse > 0.0 else math.inf
