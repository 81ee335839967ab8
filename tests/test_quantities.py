"""Arguments with units, as those of pint: a stand-in with what is asked of one, so that pint need
not be installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from estim import DataSet, InputError, fit_curve, fit_curves

BASE = {
    "min": (60.0, "s"),
    "s": (1.0, "s"),
    "cm": (0.01, "m"),
    "mm": (0.001, "m"),
    "m": (1.0, "m"),
    "km/h": (1.0 / 3.6, "m/s"),
    "m/s": (1.0, "m/s"),
}


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
        return Quantity(
            np.asarray(self.magnitude) * factor
            if np.ndim(self.magnitude)
            else self.magnitude * factor,
            name,
        )


T = np.linspace(0.0, 5.0, 30)
S = 3.0 + 12.0 * T + 0.5 * np.random.default_rng(1).standard_normal(T.size)


def test_any_mixture_of_units_is_the_fit_in_base_units() -> None:
    start = {"s0": Quantity(0.0, "m"), "v": Quantity(1.0, "km/h")}
    bounds = {"v": (Quantity(0.0, "m/s"), None)}
    mixed = fit_curve(
        "s0 + v*x",
        Quantity(T, "min"),
        Quantity(S, "cm"),
        u_y=Quantity(5.0, "mm"),
        start=start,
        bounds=bounds,
    )
    units = {"s0": "m", "v": "m/s"}
    plain = fit_curve(
        "s0 + v*x",
        60.0 * T,
        0.01 * S,
        u_y=0.005,
        start={"s0": 0.0, "v": 1.0 / 3.6},
        bounds={"v": (0.0, None)},
        units=units,
    )
    assert mixed.values == plain.values
    assert mixed.intervals == plain.intervals
    assert abs(mixed.values["v"] - 0.12 / 60.0) < 4.0 * mixed.sds["v"]
    assert " m/s, 68 % in" in str(mixed)
    assert (mixed.problem.runs[0].x_unit, mixed.problem.runs[0].y_unit) == ("s", "m")
    held = fit_curve(
        "s0 + v*x",
        Quantity(T, "min"),
        Quantity(S, "cm"),
        u_y=Quantity(0.5, "cm"),
        start={"v": 0.002},
        fixed={"s0": Quantity(3.0, "cm")},
    )
    assert held.fixed == {"s0": 0.03}


@pytest.mark.parametrize(
    "wrong",
    [
        {"u_y": Quantity(5.0, "s")},
        {"u_x": Quantity(1.0, "m"), "u_y": Quantity(1.0, "cm")},
        {"bounds": {"v": (Quantity(0.0, "m"), None)}},
    ],
)
def test_a_unit_of_another_kind_is_refused(wrong: dict[str, Any]) -> None:
    start = {"s0": Quantity(0.0, "m"), "v": Quantity(1.0, "m/s")}
    with pytest.raises(InputError, match="must be of the same kind as what it belongs to"):
        fit_curve("s0 + v*x", Quantity(T, "min"), Quantity(S, "cm"), start=start, **wrong)


@dataclass(frozen=True)
class Celsius(Quantity):
    @property
    def _is_multiplicative(self) -> bool:
        return False


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"u_y": 0.5}, "'u_y' must have a unit, since what it belongs to has one"),
        ({"u_y": np.full(T.size, 0.5)}, "'u_y' must have a unit"),
        ({"bounds": {"v": (0, 3.0)}}, "'v' must have a unit"),
        ({"u_y": Celsius(0.5, "cm")}, "must be a difference"),
        ({"u_y": None, "cov_y": Quantity(np.eye(T.size), "cm")}, "'cov_y' must be plain numbers"),
        ({"deviation": Quantity(1.0, "cm")}, "'deviation' must be plain numbers"),
    ],
)
def test_what_would_lose_its_unit_is_refused(change: dict[str, Any], said: str) -> None:
    start = {"s0": Quantity(0.0, "m"), "v": Quantity(1.0, "m/s")}
    with pytest.raises(InputError, match=said):
        fit_curve(
            "s0 + v*x",
            Quantity(T, "min"),
            Quantity(S, "cm"),
            **({"start": start, "u_y": Quantity(5.0, "mm")} | change),
        )


def test_no_number_loses_its_unit_on_the_way_back_or_in_several_data_sets() -> None:
    u, start = Quantity(5.0, "mm"), {"s0": 0.0, "v": 0.01}
    sets = {
        "a": DataSet(Quantity(T, "min"), Quantity(S, "cm"), u_y=u),
        "b": DataSet(Quantity(60.0 * T, "s"), Quantity(0.01 * S, "m"), u_y=u),
    }
    fit = fit_curves("s0 + v*x", sets, shared=["v"], start=start)
    assert fit.values["s0[a]"] == pytest.approx(fit.values["s0[b]"], rel=1e-9)
    assert fit.values["v"] == pytest.approx(0.12 / 60.0, abs=4.0 * fit.sds["v"])
    with pytest.raises(InputError, match="'x' must be plain numbers"):
        fit.predict(Quantity(1.0, "min"), data="a")
    with pytest.raises(InputError, match="in the same units"):
        fit_curves("s0 + v*x", {**sets, "b": DataSet(T, S, u_y=0.5)}, shared=["v"], start=start)
    with pytest.raises(InputError, match="'cov_y' of data set 'a' must be plain"):
        fit_curves(
            "s0 + v*x",
            {"a": DataSet(T, S, cov_y=Quantity(np.eye(T.size), "cm"))},
            shared=[],
            start=start,
        )
