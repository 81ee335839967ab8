"""Certified fits: NIST Statistical Reference Datasets, with default settings, from both published starts.

Source: https://www.itl.nist.gov/div898/strd/ (public domain); certified values are in the header of each file.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from estim import fit_curve

FOLDER = Path(os.environ.get("ESTIM_SHARED_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "nist_strd"
FILES = sorted(FOLDER.glob("*.dat"))


@dataclass(frozen=True)
class Reference:
    expression: str
    starts: tuple[dict[str, float], dict[str, float]]
    certified: dict[str, tuple[float, float]]
    squares: float
    x: np.ndarray
    y: np.ndarray


def read(path: Path) -> Reference:
    lines = path.read_text().splitlines()
    first, last = (int(n) for n in re.search(r"Data\s+\(lines\s+(\d+)\s+to\s+(\d+)\)", path.read_text()).groups())
    y, x = np.array([[float(v) for v in line.split()] for line in lines[first - 1 : last] if line.split()]).T
    text = "\n".join(lines[: first - 1])
    expression = re.search(r"^ +y\s*=(.*?)\+\s*e\s*\n", text.partition("\nModel:")[2], flags=re.S | re.M)[1].replace("[", "(").replace("]", ")")
    if path.stem == "Norris":
        rows = re.findall(r"^\s*(B\d)\s+(\S+)\s+(\S+)\s*$", text, flags=re.M)
        certified = {name: (float(value), float(sd)) for name, value, sd in rows}
        squares = float(re.search(r"Residual\s+34\s+(\S+)", text)[1])
        return Reference(expression, ({"B0": 0.0, "B1": 0.0}, {"B0": 500.0, "B1": -3.0}), certified, squares, x, y)
    rows = re.findall(r"^\s*(b\d)\s*=\s*(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", text, flags=re.M)
    starts = tuple({row[0]: float(row[i]) for row in rows} for i in (1, 2))
    squares = float(re.search(r"Residual Sum of Squares:\s*(\S+)", text)[1])
    return Reference(expression, starts, {row[0]: (float(row[3]), float(row[4])) for row in rows}, squares, x, y)


def digits(got: float, certified: float) -> float:
    """Correct digits: -log10 of the relative error."""
    return -math.log10(max(abs(got / certified - 1.0), 1e-16))


def check(reference: Reference, fit, name: str) -> None:
    wanted_value, wanted_sd = (10.0, 10.0) if name == "Norris" else (6.0, 4.0)
    for parameter, (value, sd) in reference.certified.items():
        assert digits(fit.values[parameter], value) >= wanted_value, (parameter, fit.values[parameter], value)
        assert digits(fit.sds[parameter], sd) >= wanted_sd, (parameter, fit.sds[parameter], sd)
    assert digits(fit.chi2, reference.squares) >= 6.0
    assert fit.dof == reference.x.size - len(reference.certified)


def test_the_reference_data_are_there() -> None:
    if not FILES:
        pytest.skip(f"no reference data at {FOLDER}")
    assert {"Norris", "MGH09", "MGH17", "BoxBOD", "Hahn1", "Lanczos3", "Eckerle4", "Thurber", "ENSO"} <= {path.stem for path in FILES}


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_formula_reaches_the_certified_values_from_either_start(path: Path, start: int) -> None:
    reference = read(path)
    check(reference, fit_curve(reference.expression, reference.x, reference.y, start=reference.starts[start]), path.stem)


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_function_reaches_the_certified_values_from_either_start(path: Path, start: int) -> None:
    reference = read(path)
    names = {"exp": np.exp, "cos": np.cos, "sin": np.sin, "pi": np.pi}
    function = eval(f"lambda x, {', '.join(reference.certified)}: {' '.join(reference.expression.split())}", names)
    check(reference, fit_curve(function, reference.x, reference.y, start=reference.starts[start]), path.stem)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["MGH09", "MGH17", "BoxBOD", "Lanczos3"])
def test_the_certified_values_do_not_depend_on_the_random_starts(name: str) -> None:
    if not FILES:
        pytest.skip(f"no reference data at {FOLDER}")
    reference = read(FOLDER / f"{name}.dat")
    for seed in range(3, 6):
        check(reference, fit_curve(reference.expression, reference.x, reference.y, start=reference.starts[0], rng=np.random.default_rng(seed)), name)


@pytest.mark.parametrize("start", [{"b1": 2.0, "b2": 4e5, "b3": 25e3}, {"b1": 0.02, "b2": 4e3, "b3": 250.0}])
def test_a_thermistor_is_fit_from_a_start_that_is_off_by_a_factor_of_a_hundred(start: dict[str, float]) -> None:
    # MGH10 of the same collection: Meyer's thermistor, sixteen points, values and standard deviations as certified there
    y = [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872]
    fit = fit_curve("b1*exp(b2/(x + b3))", np.arange(50.0, 126.0, 5.0), y, start=start)
    certified = {"b1": (5.6096364710e-3, 1.5687892471e-4), "b2": (6.1813463463e3, 2.3309021107e1), "b3": (3.4522363462e2, 7.8486103508e-1)}
    for name, (value, sd) in certified.items():
        assert digits(fit.values[name], value) > 9.0
        assert digits(fit.sds[name], sd) > 9.0


def test_plain_least_squares_from_the_far_start_fails_where_this_one_does_not() -> None:
    if not FILES:
        pytest.skip(f"no reference data at {FOLDER}")
    from scipy.optimize import OptimizeWarning, curve_fit

    reference = read(FOLDER / "BoxBOD.dat")

    def curve(x, b1, b2):
        return b1 * (1 - np.exp(-b2 * x))

    with np.errstate(all="ignore"), pytest.warns(OptimizeWarning):
        found, _ = curve_fit(curve, reference.x, reference.y, p0=[1.0, 1.0])
    assert digits(found[1], reference.certified["b2"][0]) < 1.0
