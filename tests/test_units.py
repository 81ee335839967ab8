"""Units of parameters that follow from those of the axes, and reports of several data sets from
Python.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from estim import AxisNames, DataSet, Poisson, Target, fit_curve, fit_curves, write_curve_report
from estim.curves import read_formula, units_of


@pytest.mark.parametrize(
    ("text", "x", "y", "units"),
    [
        ("a*exp(-x/tau) + c", "s", "V", {"a": "V", "tau": "s", "c": "V"}),
        ("a + b*x + c*x**2", "s", "m/s", {"a": "m/s", "b": "m/s²", "c": "m/s³"}),
        ("A*exp(-b*x)*cos(2*pi*x/T + p)", "s", "°", {"A": "°", "b": "1/s", "T": "s", "p": "1"}),
        (
            "a/(sqrt(2*pi)*s)*exp(-(x - c)**2/(2*s**2))",
            "keV",
            "1/s",
            {"a": "keV/s", "s": "keV", "c": "keV"},
        ),
        ("slope*x + c", "1000 K", "1", {"slope": "1/(1000 K)", "c": "1"}),
        ("a*x", "cm⁻¹", "mV", {"a": "mV·cm"}),
        ("a*x**2", "V", "V", {"a": "1/V"}),
        ("a*sqrt(x)", "s", "m", {}),  # no root of a unit is written
        ("a + b*9.81*x**2/2", "s", "m", {"a": "m"}),  # 9.81 may have a unit of its own
        ("b*60*x", "min", "m", {}),
        ("a + b*cos(2*pi*x/(3*c))", "month", "mm", {"a": "mm", "b": "mm", "c": "month"}),
        # 3 has one, for x is no number
        ("a + b*cos(2*pi*x/3 + c*x)", "month", "mm", {"a": "mm", "b": "mm", "c": "1/month"}),
        ("a*x + b", "1", "1", {}),
    ],
)
def test_units_follow_from_those_of_the_axes(
    text: str, x: str, y: str, units: dict[str, str]
) -> None:
    formula = read_formula(text)
    assert units_of(formula, AxisNames("x", x, "y", y), formula.names) == units


def test_a_unit_is_a_change_of_scale() -> None:
    """Points in milliseconds in place of seconds change each value by the factor that its unit
    says.
    """
    rng = np.random.default_rng(4)
    x = np.linspace(0.0, 5.0, 40)
    y = 3.0 * np.exp(-x / 1.5) * np.cos(6.0 * x) + 0.5 * x + 0.05 * rng.standard_normal(40)
    text, axes = "A*exp(-b*x)*cos(w*x + p) + v*x", AxisNames("t", "s", "s", "m")
    start = {"A": 3.0, "b": 0.7, "w": 6.0, "p": 0.0, "v": 0.5}
    fit = fit_curve(text, x, y, u_y=0.05, axes=axes, start=start, scan=False)
    factors = {"1/s": 1e-3, "m": 1.0, "m/s": 1e-3, "1": 1.0}
    units = {p.name: p.unit for p in fit.problem.parameters}
    assert units == {"A": "m", "b": "1/s", "w": "1/s", "p": "1", "v": "m/s"}
    scaled = {name: value * factors[units[name]] for name, value in start.items()}
    slow = fit_curve(text, 1e3 * x, y, u_y=0.05, start=scaled, scan=False)
    for name, unit in units.items():
        assert slow.values[name] == pytest.approx(fit.values[name] * factors[unit], rel=1e-6)


def test_units_that_are_said_hold_and_counts_in_bins_are_a_density() -> None:
    x = np.linspace(0.0, 5.0, 20)
    counts = np.random.default_rng(1).poisson(40.0 * np.exp(-x / 2.0))
    fit = fit_curve(
        "N/tau*exp(-x/tau) + B",
        x,
        counts,
        noise=Poisson(bins=x[1] - x[0]),
        axes=AxisNames("t", "µs", "events", "1"),
        units={"tau": "us"},
        scan=False,
    )
    assert {p.name: p.unit for p in fit.problem.parameters} == {"N": "1", "tau": "us", "B": "1/µs"}


def test_several_data_sets_have_a_report(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    t = np.linspace(0.0, 6.0, 30)
    known = (("first", 5.0, 0.05), ("second", 3.0, 0.1))
    voltages = {
        name: DataSet(t, height * np.exp(-t / 2.0) + u * rng.standard_normal(30), u_y=u)
        for name, height, u in known
    }
    fit = fit_curves(
        "exponential", voltages, shared=["decay"], axes=AxisNames("time", "s", "voltage", "V")
    )
    analysis = write_curve_report(
        fit,
        tmp_path / "joint",
        title="Two discharges",
        kind="synthetic",
        target=Target(ess=400),
        figures="none",
    )
    assert analysis.diagnosis.status == "ok"
    text = (tmp_path / "joint" / "report.md").read_text()
    assert "SYNTHETIC" in text
    for words in (
        "| amplitude[second] | parameter of the curve |",
        "| V |",
        "## Do the runs agree?",
        "**second** (`(arrays)`): 30 points fit",
    ):
        assert words in text
    result = json.loads((tmp_path / "joint" / "result.json").read_text())
    assert "amplitude[first]" in json.dumps(result)
    draws = analysis.chain.flat[:, fit.names.index("decay")]
    assert abs(float(np.mean(draws)) - fit.values["decay"]) < 0.2 * fit.sds["decay"]


def test_arbitrary_units_are_one_word() -> None:
    axes = AxisNames("wavelength", "nm", "intensity", "a.u.")
    x = np.linspace(-3.0, 3.0, 31)
    y = np.exp(-(x**2) / 2.0) + 0.01 * np.cos(40.0 * x)
    assert fit_curve("gaussian", x, y, axes=axes).fit.problem.parameters[0].unit == "a.u.·nm"
