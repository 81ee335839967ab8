"""Arguments with units, as those of pint, are refused, and results are given as such: a stand-in
with what is asked of one, so that pint need not be installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from estim import AxisNames, InputError, fit_curve, fit_line, mean


@dataclass(frozen=True)
class Quantity:
    magnitude: Any
    unit: str

    def __array_function__(self, *_: object) -> Any:
        return NotImplemented  # as of pint for functions of NumPy that it does not know

    def to_base_units(self) -> Quantity:
        return self


T = np.linspace(0.0, 5.0, 30)
S = 3.0 + 12.0 * T + 0.5 * np.random.default_rng(1).standard_normal(T.size)
START = {"s0": 0.0, "v": 10.0}


@pytest.mark.parametrize(
    "change",
    [
        {"x": Quantity(T, "min")},
        {"y": Quantity(S, "cm")},
        {"u_y": Quantity(5.0, "mm")},
        {"u_x": Quantity(0.1, "s")},
        {"u_y": None, "cov_y": Quantity(np.eye(T.size), "cm")},
        {"start": {**START, "v": Quantity(1.0, "km/h")}},
        {"start": {"v": 10.0}, "fixed": {"s0": Quantity(3.0, "cm")}},
        {"bounds": {"v": (Quantity(0.0, "m/s"), None)}},
        {"deviation": Quantity(1.0, "cm")},
    ],
)
def test_no_quantity_loses_its_unit_in_silence(change: dict[str, Any]) -> None:
    given: dict[str, Any] = {"x": T, "y": S, "u_y": 0.5, "start": START} | change
    with pytest.raises(InputError, match="not quantities with units: take their magnitudes"):
        fit_curve("s0 + v*x", **given)


def test_a_curve_is_predicted_at_plain_numbers() -> None:
    fit = fit_curve("s0 + v*x", T, S, u_y=0.5, start=START)
    for ask in (fit, fit.predict):
        with pytest.raises(InputError, match="'x' must be plain numbers"):
            ask(Quantity(1.0, "min"))


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
    axes = AxisNames("t", "min", "U", "V")
    fit = fit_curve("a*exp(-x/tau)", minutes, volts, u_y=0.01, axes=axes)
    known = fit.quantities(registry)
    tau = known["tau"].to("s")
    assert tau.magnitude.nominal_value == pytest.approx(60.0 * fit.values["tau"])
    assert tau.magnitude.std_dev == pytest.approx(60.0 * fit.sds["tau"])
    assert known["a"].to("mV").magnitude.nominal_value == pytest.approx(3000.0, rel=0.01)
    with pytest.raises(InputError, match="take their magnitudes"):
        fit_curve("a*exp(-x/tau)", minutes * registry.min, volts, u_y=0.01)
