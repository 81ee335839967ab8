"""Priors of what nobody stated."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estim.common import format_quantity, phrase, with_unit
from estim.problem.priors import LogNormal, Normal


@dataclass(frozen=True)
class Unstated(LogNormal):
    """Log-normal about what the points themselves show, so wide that it hardly matters."""

    def describe(self, unit: str = "1") -> str:
        median = with_unit(f"{self.median:.2g}", unit)
        return phrase("inferred; weak prior, within a factor {factor:.0f} of {median}", factor=math.exp(self.log_sd), median=median)


@dataclass(frozen=True)
class Usual(Normal):
    """Normal about 0 with the size that such an error usually has."""

    def describe(self, unit: str = "1") -> str:
        return phrase("{value} (default)", value=format_quantity(self.mean, self.sd))
