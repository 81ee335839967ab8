"""Certified fits: NIST Statistical Reference Datasets, with default settings, from both published
starts.

Source: https://www.itl.nist.gov/div898/strd/ (public domain); certified values are in the header of
each file.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from estim import InputError, fit_curve
from estim.pipeline import sample_curve

FOLDER = Path(__file__).resolve().parent / "reference" / "nist_strd"
# Digits that values and standard deviations must have at least.  Residuals of Wampler5 are 10^7
# times its values; the columns of Filip, at unit length, have a condition of 5e9, so that rounding
# alone (5e9 x 2e-16) takes all but six digits, how much of them depends on the processor.
LINEAR = {
    "Norris": (10.0, 10.0),
    "Pontius": (10.0, 10.0),
    "NoInt1": (12.0, 12.0),
    "NoInt2": (12.0, 12.0),
    "Filip": (6.0, 6.0),
    "Wampler3": (9.0, 12.0),
    "Wampler4": (7.0, 12.0),
    "Wampler5": (5.0, 12.0),
}
FEW = (
    "BoxBOD",
    "Eckerle4",
    "Filip",
    "Hahn1",
    "Lanczos3",
    "MGH09",
    "MGH17",
    "Norris",
    "Thurber",
    "Wampler5",
)
DEFAULT = (*FEW, "MGH10")  # three of them are not reached from the farther start alone
EXACT = ("Wampler1", "Wampler2")  # without residuals
MULTIPLE = ("Longley", "Nelson")  # several predictors
HARDEST = "Lanczos1"  # the residuals are the rounding errors of y, in its fourteenth digit
FILES = sorted(
    path for path in FOLDER.glob("*.dat") if path.stem not in (*EXACT, *MULTIPLE, HARDEST)
)


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
    first, last = (
        int(n)
        for n in re.search(r"Data\s+\(lines\s+(\d+)\s+to\s+(\d+)\)", path.read_text()).groups()
    )
    y, x = np.array(
        [[float(v) for v in line.split()] for line in lines[first - 1 : last] if line.split()]
    ).T
    text = "\n".join(lines[: first - 1])
    if path.stem in (*LINEAR, *EXACT):
        rows = re.findall(r"^\s*(B\d+)\s+([-\d.E]+)\s+([-\d.E]+)\s*$", text, flags=re.M)
        certified = {name: (float(value), float(sd)) for name, value, sd in rows}
        squares = float(re.search(r"^\s*Residual\s+\d+\s+(\S+)", text, flags=re.M)[1])
        expression = " + ".join(f"{name}*x**{name[1:]}" for name in certified)
        starts = (
            dict.fromkeys(certified, 0.0),
            {name: 500.0 * (-1.0) ** i for i, name in enumerate(certified)},
        )
        return Reference(expression, starts, certified, squares, x, y)
    expression = (
        re.search(r"^ +y\s*=(.*?)\+\s*e\s*\n", text.partition("\nModel:")[2], flags=re.S | re.M)[1]
        .replace("[", "(")
        .replace("]", ")")
    )
    rows = re.findall(r"^\s*(b\d)\s*=\s*(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", text, flags=re.M)
    starts = tuple({row[0]: float(row[i]) for row in rows} for i in (1, 2))
    squares = float(re.search(r"Residual Sum of Squares:\s*(\S+)", text)[1])
    return Reference(
        expression, starts, {row[0]: (float(row[3]), float(row[4])) for row in rows}, squares, x, y
    )


def digits(got: float, certified: float) -> float:
    """Correct digits: -log10 of the relative error."""
    return -math.log10(max(abs(got / certified - 1.0), 1e-16))


def check(reference: Reference, fit, name: str) -> None:
    wanted_value, wanted_sd = LINEAR.get(name, (6.0, 4.0))
    for parameter, (value, sd) in reference.certified.items():
        assert digits(fit.values[parameter], value) >= wanted_value, (
            parameter,
            fit.values[parameter],
            value,
        )
        assert digits(fit.sds[parameter], sd) >= wanted_sd, (parameter, fit.sds[parameter], sd)
    assert digits(fit.chi2, reference.squares) >= 6.0
    assert fit.dof == reference.x.size - len(reference.certified)


def test_the_reference_data_are_there() -> None:
    assert {
        "Norris",
        "MGH09",
        "MGH17",
        "BoxBOD",
        "Hahn1",
        "Lanczos3",
        "Eckerle4",
        "Thurber",
        "ENSO",
    } <= {path.stem for path in FILES}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "start"),
    [  # most sets are left to `make test-long`, and to the next test
        pytest.param(
            path,
            start,
            marks=[] if path.stem in (FEW if start else DEFAULT) else pytest.mark.statistics,
            id=f"{path.stem}-{start}",
        )
        for path in FILES
        for start in (0, 1)
    ],
)
def test_a_formula_reaches_the_certified_values_from_either_start(path: Path, start: int) -> None:
    reference = read(path)
    check(
        reference,
        fit_curve(reference.expression, reference.x, reference.y, start=reference.starts[start]),
        path.stem,
    )


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem) for path in FILES if path.stem not in DEFAULT]
)
def test_a_formula_reaches_the_certified_values_from_the_farther_start_alone(path: Path) -> None:
    """Harder than by default, where the parameters are scanned from there, and cheaper."""
    reference = read(path)
    check(
        reference,
        fit_curve(
            reference.expression, reference.x, reference.y, start=reference.starts[0], scan=False
        ),
        path.stem,
    )


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[] if path.stem in FEW else pytest.mark.statistics, id=path.stem)
        for path in FILES
    ],
)
def test_a_function_reaches_the_certified_values_as_a_formula_does(path: Path) -> None:
    reference = read(path)
    names = {"exp": np.exp, "cos": np.cos, "sin": np.sin, "arctan": np.arctan, "pi": np.pi}
    function = eval(
        f"lambda x, {', '.join(reference.certified)}: {' '.join(reference.expression.split())}",
        names,
    )
    check(
        reference,
        fit_curve(function, reference.x, reference.y, start=reference.starts[0]),
        path.stem,
    )


@pytest.mark.parametrize("name", EXACT)
def test_data_without_residuals_give_the_certified_values_and_no_standard_deviation(
    name: str,
) -> None:
    reference = read(FOLDER / f"{name}.dat")
    fit = fit_curve(reference.expression, reference.x, reference.y, start=reference.starts[0])
    for parameter, (value, sd) in reference.certified.items():
        assert sd == 0.0
        assert digits(fit.values[parameter], value) >= 9.0
        assert math.isnan(fit.sds[parameter])
    assert any("no scatter" in note for note in fit.notes)


def test_residuals_in_the_fourteenth_digit_leave_standard_deviations_of_two() -> None:
    reference = read(FOLDER / f"{HARDEST}.dat")
    fit = fit_curve(reference.expression, reference.x, reference.y, start=reference.starts[1])
    for parameter, (value, sd) in reference.certified.items():
        assert digits(fit.values[parameter], value) >= 9.0
        assert digits(fit.sds[parameter], sd) >= 2.0
    assert any("rounding errors" in note for note in fit.notes)


def test_several_nearly_collinear_predictors_reach_the_certified_values() -> None:
    """Longley, as a function of the row: its derivatives come from differences."""
    lines = (FOLDER / "Longley.dat").read_text().splitlines()
    first, last = (
        int(n)
        for n in re.search(r"Data\s+\(lines\s+(\d+)\s+to\s+(\d+)\)", "\n".join(lines)).groups()
    )
    y, *predictors = np.array(
        [[float(v) for v in line.split()] for line in lines[first - 1 : last] if line.split()]
    ).T
    rows = re.findall(r"^\s*B(\d)\s+(\S+)\s+(\S+)\s*$", "\n".join(lines), flags=re.M)
    certified = {f"b{i}": (float(value), float(sd)) for i, value, sd in rows}

    def curve(row, b0, b1, b2, b3, b4, b5, b6):
        at = np.clip(np.round(np.asarray(row, dtype=float)), 0, y.size - 1).astype(int)
        return b0 + sum(
            b * column[at] for b, column in zip((b1, b2, b3, b4, b5, b6), predictors, strict=True)
        )

    fit = fit_curve(curve, np.arange(y.size), y, start=dict.fromkeys(certified, 0.0))
    for name, (value, sd) in certified.items():
        assert digits(fit.values[name], value) >= 7.0
        assert digits(fit.sds[name], sd) >= 7.0


def exact_least_squares(
    columns: list[list[float]], y: list[float]
) -> tuple[list[float], list[float]]:
    """Values and standard errors by rational arithmetic."""
    design, target = [[Fraction(v) for v in column] for column in columns], [Fraction(v) for v in y]
    n = len(design)
    rows = [
        [sum(a * b for a, b in zip(design[i], design[j], strict=True)) for j in range(n)]
        + [Fraction(i == j) for j in range(n)]
        + [sum(a * b for a, b in zip(design[i], target, strict=True))]
        for i in range(n)
    ]
    for i in range(n):
        rows[i] = [v / rows[i][i] for v in rows[i]]
        for j in range(n):
            if j != i:
                rows[j] = [a - rows[j][i] * b for a, b in zip(rows[j], rows[i], strict=True)]
    values = [row[-1] for row in rows]
    residuals = [
        v - sum(value * column[k] for value, column in zip(values, design, strict=True))
        for k, v in enumerate(target)
    ]
    variance = sum(r * r for r in residuals) / (len(target) - n)
    return [float(v) for v in values], [math.sqrt(variance * rows[i][n + i]) for i in range(n)]


@pytest.mark.parametrize("start", [0.0, 1.0])
@pytest.mark.parametrize("centre", [1e3, 1e6])
def test_a_parabola_far_from_its_origin_is_that_of_rational_arithmetic(
    centre: float, start: float, rng: np.random.Generator
) -> None:
    """At x = 10^6 ... 10^6 + 10 the terms are 5 10^11 and cancel to 50; a sum of them in float64
    has errors of 10^-4 for a scatter of 0.1.
    """
    x = centre + np.arange(11.0)
    y = 1.0 + 2.0 * (x - centre) + 0.5 * (x - centre) ** 2 + 0.1 * rng.standard_normal(11)
    values, sds = exact_least_squares(
        [[1.0] * 11, x.tolist(), [Fraction(v) ** 2 for v in x.tolist()]], y.tolist()
    )
    fit = fit_curve("a + b*x + c*x**2", x, y, start=dict.fromkeys("abc", start))
    assert fit.status == "ok"
    for name, value, sd in zip("abc", values, sds, strict=True):
        assert abs(fit.values[name] - value) < 0.005 * sd
        assert fit.sds[name] == pytest.approx(sd, rel=0.002)
    assert any("almost cancel" in note for note in fit.notes) == (centre == 1e6)
    if centre == 1e6:
        with pytest.raises(InputError, match="write the formula in x - x0"):
            sample_curve(fit, seed=1)


@pytest.mark.parametrize(
    "curve", ["a*b*x", "a + b + c*x", "a*x + b*(x + 1) + c", "a*exp(b + x/9) + c", "a*x + b*x"]
)
def test_what_nothing_determines_is_still_told_from_what_is_hard(
    curve: str, rng: np.random.Generator
) -> None:
    x = np.linspace(0.0, 10.0, 20)
    fit = fit_curve(
        curve,
        x,
        1.0 + 2.0 * x + 0.1 * rng.standard_normal(20),
        start={name: 1.0 for name in "abc" if name in curve.replace("exp", "")},
    )
    assert fit.status == "not-identified"


@pytest.mark.statistics
@pytest.mark.parametrize("name", ["MGH09", "MGH17", "BoxBOD", "Lanczos3"])
def test_the_certified_values_do_not_depend_on_the_random_starts(name: str) -> None:
    reference = read(FOLDER / f"{name}.dat")
    for seed in range(3, 6):
        check(
            reference,
            fit_curve(
                reference.expression,
                reference.x,
                reference.y,
                start=reference.starts[0],
                rng=np.random.default_rng(seed),
            ),
            name,
        )


@pytest.mark.parametrize(
    "start", [{"b1": 2.0, "b2": 4e5, "b3": 25e3}, {"b1": 0.02, "b2": 4e3, "b3": 250.0}]
)
def test_a_thermistor_is_fit_from_a_start_that_is_off_by_a_factor_of_a_hundred(
    start: dict[str, float],
) -> None:
    # MGH10 of the same collection: Meyer's thermistor, sixteen points, values and standard
    # deviations as certified there
    y = [
        34780,
        28610,
        23650,
        19630,
        16370,
        13720,
        11540,
        9744,
        8261,
        7030,
        6005,
        5147,
        4427,
        3820,
        3307,
        2872,
    ]
    fit = fit_curve("b1*exp(b2/(x + b3))", np.arange(50.0, 126.0, 5.0), y, start=start)
    certified = {
        "b1": (5.6096364710e-3, 1.5687892471e-4),
        "b2": (6.1813463463e3, 2.3309021107e1),
        "b3": (3.4522363462e2, 7.8486103508e-1),
    }
    for name, (value, sd) in certified.items():
        assert digits(fit.values[name], value) > 9.0
        assert digits(fit.sds[name], sd) > 9.0


def test_plain_least_squares_from_the_far_start_fails_where_this_one_does_not() -> None:
    from scipy.optimize import OptimizeWarning, curve_fit

    reference = read(FOLDER / "BoxBOD.dat")

    def curve(x, b1, b2):
        return b1 * (1 - np.exp(-b2 * x))

    with np.errstate(all="ignore"), pytest.warns(OptimizeWarning):
        found, _ = curve_fit(curve, reference.x, reference.y, p0=[1.0, 1.0])
    assert digits(found[1], reference.certified["b2"][0]) < 1.0
