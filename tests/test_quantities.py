"""Arguments with units, as those of pint: a stand-in with what is asked of one, so that pint need
not be installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from estim import AxisNames, DataSet, InputError, fit_curve, fit_curves, fit_line, mean

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

    def __array_function__(self, *_: object) -> Any:
        return NotImplemented  # as of pint for functions of NumPy that it does not know

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


class Registry:
    """A stand-in for a unit registry: it knows metres and seconds."""

    def Quantity(self, number: Any, unit: str) -> tuple[Any, str]:  # noqa: N802
        if unit not in ("m", "m/s", "1/s"):
            raise ValueError(f"'{unit}' is not defined")
        return number, unit


def test_results_are_quantities_of_a_registry() -> None:
    x = np.linspace(0.0, 4.0, 9)
    wave = 0.01 * np.cos(9.0 * x)
    axes = AxisNames("t", "s", "s", "m")
    fit = fit_curve("v*x + c", x, 2.0 * x + 1.0 + wave, u_y=0.01, axes=axes, derived={"k": "v/c"})
    known = fit.quantities(Registry())
    assert {name: unit for name, (_, unit) in known.items()} == {"v": "m/s", "c": "m", "k": "1/s"}
    v, c, k = (known[name][0] for name in ("v", "c", "k"))
    assert v.nominal_value == fit.values["v"]
    assert (k - v / c).std_dev < 1e-3 * k.std_dev
    odd = fit_curve("v*x + c", x, 2.0 * x + wave, u_y=0.01, axes=AxisNames("t", "s", "n", "apples"))
    with pytest.raises(InputError, match=r"has a unit that the registry does not know: .*apples"):
        odd.quantities(Registry())
    with pytest.raises(InputError, match="poor-fit"):
        fit_curve("v*x + c", x, x**3, u_y=0.01).quantities(Registry())


def test_where_no_quantities_are_taken_they_are_refused_with_the_cure() -> None:
    lengths, list_of_lengths = Quantity(np.ones(3), "m"), [Quantity(1.0, "m"), Quantity(2.0, "m")]
    for given in (lengths, list_of_lengths):
        with pytest.raises(InputError, match=r"not quantities with units: take their magnitudes"):
            mean(given, 0.1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"not quantities with units: take their magnitudes"):
        fit_line(lengths, [1.0, 2.0, 3.0])  # type: ignore[arg-type]
    assert mean(np.array([1, 2, 3], dtype=np.uint8), 0.1).best.value == 2.0


def test_results_are_quantities_of_pint() -> None:
    pint = pytest.importorskip("pint")
    registry = pint.UnitRegistry()
    minutes = np.linspace(0.0, 5.0, 20)
    volts = 3.0 * np.exp(-minutes / 2.0) + 0.01 * np.cos(9.0 * minutes)
    fit = fit_curve(
        "a*exp(-x/tau)", minutes * registry.min, volts * registry.V, u_y=0.01 * registry.V
    )
    known = fit.quantities(registry)
    tau = known["tau"].to("min")
    assert tau.magnitude.nominal_value == pytest.approx(fit.values["tau"] / 60.0)
    assert tau.magnitude.std_dev == pytest.approx(fit.sds["tau"] / 60.0)
    assert known["a"].to("mV").magnitude.nominal_value == pytest.approx(3000.0, rel=0.01)
