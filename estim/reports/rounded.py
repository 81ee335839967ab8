"""Numbers for tables in which several belong together: one number of decimals, from their uncertainty."""

from __future__ import annotations

import math

from estim.common import signed


def rounded(value: float, u: float, digits: int, *, beside: float = 0.0) -> str:
    """`value` to the decimal place of the last of `digits` significant digits of `u`; without a usable u to six significant digits.

    beside : the larger number next to which it stands, whose notation it shares.
    """
    if not math.isfinite(value):
        return "n/a"
    if not (math.isfinite(u) and u > 0.0):
        return signed(f"{value:.6g}")
    place = math.floor(math.log10(u) + 1e-12) - (digits - 1)
    if round(u / 10.0**place) >= 10**digits:
        place += 1
    exponent = math.floor(math.log10(max(abs(value), u, abs(beside))))
    if -4 <= exponent < 9 and place > -9:
        return signed(f"{value:.{max(0, -place)}f}")
    return signed(f"{value / 10.0**exponent:.{max(0, exponent - place)}f}e{exponent:+03d}")


def interval(low: float, high: float, u: float, digits: int) -> str:
    """Both ends by `rounded`, or "n/a"."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return "n/a"
    larger = max(abs(low), abs(high))
    return f"[{rounded(low, u, digits, beside=larger)}, {rounded(high, u, digits, beside=larger)}]"
