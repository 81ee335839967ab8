"""Arguments with units, as those of pint: a stand-in with what is asked of one, so that pint need not be installed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from estim import InputError, fit_curve

BASE = {"min": (60.0, "s"), "s": (1.0, "s"), "cm": (0.01, "m"), "mm": (0.001, "m"), "m": (1.0, "m"), "km/h": (1.0 / 3.6, "m/s"), "m/s": (1.0, "m/s")}


@dataclass(frozen=True)
class Unit:
    name: str

    def __format__(self, form: str) -> str:
        assert form == "~P"
        return self.name


@dataclass(frozen=True)
class Quantity:
    magnitude: Any
    unit: str

    @property
    def units(self) -> Unit:
        return Unit(self.unit)

    def to_base_units(self) -> Quantity:
        factor, name = BASE[self.unit]
        return Quantity(np.asarray(self.magnitude) * factor if np.ndim(self.magnitude) else self.magnitude * factor, name)


T = np.linspace(0.0, 5.0, 30)
S = 3.0 + 12.0 * T + 0.5 * np.random.default_rng(1).standard_normal(T.size)


def test_any_mixture_of_units_is_the_fit_in_base_units() -> None:
    start = {"s0": Quantity(0.0, "m"), "v": Quantity(1.0, "km/h")}
    bounds = {"v": (Quantity(0.0, "m/s"), None)}
    mixed = fit_curve("s0 + v*x", Quantity(T, "min"), Quantity(S, "cm"), u_y=Quantity(5.0, "mm"), start=start, bounds=bounds)
    units = {"s0": "m", "v": "m/s"}
    plain = fit_curve("s0 + v*x", 60.0 * T, 0.01 * S, u_y=0.005, start={"s0": 0.0, "v": 1.0 / 3.6}, bounds={"v": (0.0, None)}, units=units)
    assert mixed.values == plain.values
    assert mixed.intervals == plain.intervals
    assert abs(mixed.values["v"] - 0.12 / 60.0) < 4.0 * mixed.sds["v"]
    assert " m/s, 68 % in" in str(mixed)
    assert (mixed.problem.runs[0].x_unit, mixed.problem.runs[0].y_unit) == ("s", "m")
    held = fit_curve("s0 + v*x", Quantity(T, "min"), Quantity(S, "cm"), u_y=0.005, start={"v": 0.002}, fixed={"s0": Quantity(3.0, "cm")})
    assert held.fixed == {"s0": 0.03}


@pytest.mark.parametrize(
    "wrong", [{"u_y": Quantity(5.0, "s")}, {"u_x": Quantity(1.0, "m"), "u_y": 0.01}, {"bounds": {"v": (Quantity(0.0, "m"), None)}}]
)
def test_a_unit_of_another_kind_is_refused(wrong: dict[str, Any]) -> None:
    start = {"s0": Quantity(0.0, "m"), "v": Quantity(1.0, "m/s")}
    with pytest.raises(InputError, match="must be of the same kind as what it belongs to"):
        fit_curve("s0 + v*x", Quantity(T, "min"), Quantity(S, "cm"), start=start, **wrong)
