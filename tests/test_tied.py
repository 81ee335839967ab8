"""Parameters that follow from others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estim import AxisNames, DataSet, fit_curve, fit_curves
from estim.common import InputError

X = np.linspace(0.0, 10.0, 40)
Y = (
    3.0 * np.exp(-X / 2.0)
    + 1.5 * np.exp(-X / 4.0)
    + 0.02 * np.random.default_rng(2).standard_normal(40)
)
SUM = "a*exp(-x/s) + b*exp(-x/t)"


def two(x, a, s, b, t):
    return a * np.exp(-x / s) + b * np.exp(-x / t)


@pytest.mark.parametrize("curve", [SUM, two])
def test_a_tied_parameter_is_the_same_as_its_formula_written_in(curve: object) -> None:
    written = fit_curve(
        "a*exp(-x/s) + a/2*exp(-x/(2*s))", X, Y, u_y=0.02, start={"a": 1.0, "s": 1.0}
    )
    tied = fit_curve(
        curve,
        X,
        Y,
        u_y=0.02,
        start={"a": 1.0, "s": 1.0},
        tied={"b": "a/2", "t": "2*s"},
        units={"t": "s"},
    )
    assert tied.names == ("a", "s")
    assert tied.values == pytest.approx(written.values, rel=1e-6)
    assert tied.cov == pytest.approx(written.cov, rel=1e-4)
    assert tied.dof == written.dof == 38
    assert tied.derived["t"].value == pytest.approx(2.0 * tied.values["s"])
    assert tied.derived["t"].sd == pytest.approx(2.0 * tied.sds["s"])
    assert "t = " in str(tied)
    assert " s, " in next(line for line in str(tied).splitlines() if line.startswith("t = "))
    assert tied.predict(X).u == pytest.approx(written.predict(X).u, rel=1e-4)


def test_a_parameter_may_stand_in_ties_alone_and_ties_in_ties() -> None:
    fit = fit_curve(
        "m*x + c", X, 2.0 * X + 8.0, u_y=0.1, start={"k": 1.0}, tied={"m": "2*k", "c": "4*m"}
    )
    assert fit.values["k"] == pytest.approx(1.0)
    assert fit.derived["c"].value == pytest.approx(8.0)


def test_peaks_of_one_width() -> None:
    y = sum(
        area / np.sqrt(2 * np.pi) * np.exp(-((X - at) ** 2) / 2)
        for area, at in ((10.0, 3.0), (6.0, 7.0))
    )
    rng = np.random.default_rng(1)
    fit = fit_curve(
        "a_gaussian + b_gaussian",
        X,
        y + 0.05 * rng.standard_normal(40),
        u_y=0.05,
        tied={"b_sigma": "a_sigma"},
    )
    assert fit.status == "ok"
    assert len(fit.names) == 5
    assert abs(fit.values["a_sigma"] - 1.0) < 4.0 * fit.sds["a_sigma"] < 0.1


@pytest.mark.parametrize(
    ("tied", "said"),
    [
        ({"a": "2*s"}, "'tied' names 'a', which has a starting"),
        ({"b": "2*q"}, r"tied\[b\]' names 'q'"),
        ({"b": "2*x"}, "must not hold x"),
        ({"b": "t", "t": "s"}, "names 't'"),
        (
            {"b": "a", "t": "s", "u": "a"},
            r"'tied' names 'u', which is not a parameter of the curve \(a, s, b, t\): a",
        ),
        ({"b": "open(1)"}, "calls 'open'"),
    ],
)
@pytest.mark.parametrize("curve", [SUM, two])
def test_what_is_wrong_with_a_tie(curve: object, tied: dict[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        fit_curve(curve, X, Y, u_y=0.02, start={"a": 1.0, "s": 1.0}, tied=tied)


def test_a_tie_across_data_sets_is_refused_with_what_to_do() -> None:
    curve, other = "a*exp(-x/s)", "b*exp(-x/t)"
    data = {"p": DataSet(X, Y, u_y=0.02), "q": DataSet(X, 2.0 * Y, u_y=0.04)}
    with pytest.raises(InputError, match=r"give each DataSet a curve of its own.*a\[q\] = 2"):
        fit_curves(curve, data, shared=["s"], tied={"a[q]": "2*a[p]"})
    own = {"p": replace(data["p"], curve=curve), "q": replace(data["q"], curve=other)}
    fit = fit_curves(None, own, tied={"b": "2*a", "t": "s"})
    assert fit.names == ("a", "s")
    assert fit.derived["b"].value == pytest.approx(2.0 * fit.values["a"])


def test_a_tied_formula_needs_no_starting_values() -> None:
    """The starts come from the points, by the formula with its relations put in."""
    x = np.linspace(0.0, 6.0, 25)
    noise = 0.02 * np.random.default_rng(1).standard_normal(25)
    y = 3.0 * np.exp(-x / 1.5) + 0.9 * np.exp(-x / 4.5) + noise
    tied = {"r": "3*s", "b": "0.3*a"}
    fit = fit_curve("a*exp(-x/s) + b*exp(-x/r)", x, y, u_y=0.02, tied=tied)
    assert fit.status == "ok"
    assert fit.values["s"] == pytest.approx(1.5, abs=4.0 * fit.sds["s"])
    with pytest.raises(InputError, match=r"tied\[b\]' names 'q', which is no parameter"):
        fit_curve("a*exp(-x/s) + b*exp(-x/r)", x, y, u_y=0.02, tied=tied | {"b": "q*a"})


def test_a_tied_parameter_is_in_the_unit_that_the_curve_says() -> None:
    axes = AxisNames("t", "s", "U", "V")
    fit = fit_curve(SUM, X, Y, u_y=0.02, axes=axes, tied={"t": "2*s"}, derived={"k": "1/t"})
    units = {quantity.name: quantity.unit for quantity in fit.derived.values()}
    assert units == {"t": "s", "k": "1/s"}
    open_number = fit_curve(SUM, X, Y, u_y=0.02, axes=axes, tied={"t": "25/s"}, start={"s": 2.0})
    assert open_number.derived["t"].unit == "s"  # of 25 s^2


@pytest.mark.parametrize(
    ("tie", "unit"), [("a*s", r"in V·s"), ("2/s", "in 1/s"), ("s**2/2", "in s²"), ("s/s", "a pure")]
)
def test_a_tie_in_another_unit_than_the_curve_says_is_refused(tie: str, unit: str) -> None:
    axes = AxisNames("t", "s", "U", "V")
    with pytest.raises(InputError, match=f"'t' would be {unit}.*, but must be in s,"):
        fit_curve(SUM, X, Y, u_y=0.02, axes=axes, tied={"t": tie}, start={"s": 2.0})
