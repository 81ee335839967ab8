"""Fourteen everyday tasks, each by one command and by three lines of Python, as docs/everyday.md
says them: what they print is what the page says, and their numbers are those of independent fits
(numpy.polyfit, scipy.optimize, formulas by hand) to a few hundredths of a standard deviation.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from pages import blocks, run_page
from scipy import optimize, special

PROJECT = Path(__file__).resolve().parents[1]
PAGE = PROJECT / "docs" / "everyday.md"
# of a standard deviation: least squares against least squares, and against a posterior's median,
# which has errors of 1000 draws and is not where the density is highest
NEAR, NEAR_DRAWS = 0.02, 0.2

Estimates = Mapping[str, tuple[float, float]]


def table(name: str, columns: int, *, mark: str | None = ",", comma: bool = False) -> np.ndarray:
    """(n_col, n_row) numbers in a table of the page; other rows are left out."""
    rows = []
    text = (PROJECT / "data" / "everyday" / f"{name}.csv").read_text(encoding="utf-8")
    for line in (text.replace(",", ".") if comma else text).splitlines():
        try:
            rows.append([float(cell) for cell in line.split(mark)[:columns]])
        except ValueError:
            continue
    found = np.array([row for row in rows if len(row) == columns]).T
    return found[:, np.all(np.isfinite(found), axis=0)]


def least_squares(
    curve: Callable[..., np.ndarray], data: np.ndarray, names: str, start: list[float]
) -> Estimates:
    """scipy's, with the errors that the third row states, or else the scatter tells."""
    u = data[2] if len(data) > 2 else None
    values, cov = optimize.curve_fit(
        curve, data[0], data[1], start, u, absolute_sigma=u is not None, xtol=1e-13, ftol=1e-13
    )
    return dict(zip(names.split(), zip(values, np.sqrt(np.diag(cov)), strict=True), strict=True))


def by_polyfit(data: np.ndarray, names: str) -> Estimates:
    """names : of the coefficients, that of the highest power first."""
    values, cov = np.polyfit(*data, names.count(" "), cov=True)
    return dict(zip(names.split(), zip(values, np.sqrt(np.diag(cov)), strict=True), strict=True))


def lorentzian(x: np.ndarray, area: float, center: float, sigma: float) -> np.ndarray:
    return area / np.pi * sigma / ((x - center) ** 2 + sigma**2)


def poisson() -> Estimates:
    """The maximum of the Poisson likelihood, with the inverse of the expected information."""
    t, n = table("decays", 2)

    def expected(p: np.ndarray) -> np.ndarray:
        return p[0] * np.exp(-t / p[1]) + p[2]

    def nll(p: np.ndarray) -> float:
        return float(np.sum(expected(p) - n * np.log(expected(p)) + special.gammaln(n + 1.0)))

    best = optimize.minimize(
        nll, [250.0, 2.0, 4.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}
    ).x
    fall = np.exp(-t / best[1])
    slopes = np.array([fall, best[0] * t / best[1] ** 2 * fall, np.ones(t.size)])
    sds = np.sqrt(np.diag(np.linalg.inv(slopes / expected(best) @ slopes.T)))
    return dict(zip(("N0", "tau", "b"), zip(best, sds, strict=True), strict=True))


def york() -> Estimates:
    """The least sum of (y - a - b x)²/(u_y² + b² u_x²); standard errors by brute force, from what
    shifts of each coordinate by a part of its u do to the line.
    """
    x, u_x, y, u_y = table("calibration", 4)

    def line(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        def chi2(p: np.ndarray) -> float:
            return float(np.sum((y - p[0] - p[1] * x) ** 2 / (u_y**2 + (p[1] * u_x) ** 2)))

        options = {"xatol": 1e-11, "fatol": 1e-13}
        return optimize.minimize(chi2, [0.4, 1.2], method="Nelder-Mead", options=options).x

    best, moved, share = line(x, y), [], 0.01
    for i in range(x.size):
        step = share * np.eye(x.size)[i]
        moved += [line(x + step * u_x, y) - best, line(x, y + step * u_y) - best]
    sds = np.sqrt(np.sum(np.square(moved), axis=0)) / share
    return dict(zip(("intercept", "slope"), zip(best, sds, strict=True), strict=True))


def weighted() -> Estimates:
    rows = (PROJECT / "data/everyday/laboratories.csv").read_text(encoding="utf-8").splitlines()
    value, u = np.array([[float(cell) for cell in row.split(",")[1:]] for row in rows[2:]]).T
    return {"mean": (float(np.sum(value / u**2) / np.sum(u**-2)), float(np.sum(u**-2) ** -0.5))}


def readings() -> Estimates:
    _, period = table("periods", 2)
    return {
        "mean": (float(np.mean(period)), float(np.std(period, ddof=1) / math.sqrt(period.size)))
    }


def independent() -> dict[str, Estimates]:
    """Task -> parameter -> value and standard uncertainty, without estim."""
    root = math.sqrt(2.0 * np.pi)
    g = 4.0 * np.pi**2 * 0.850 / 1.851**2
    return {
        "spring": by_polyfit(table("spring", 2, mark=";", comma=True), "slope intercept"),
        "throw": by_polyfit(table("throw", 2, mark="\t"), "c2 c1 c0"),
        "absorption": least_squares(
            lambda x, a, d: a * np.exp(-x / d),
            table("absorption", 3),
            "amplitude decay",
            [0.4, 9.0],
        ),
        "spectrum": least_squares(
            lambda x, a, c, s, b, k: (
                a / (s * root) * np.exp(-((x - c) ** 2) / (2.0 * s**2)) + b * x + k
            ),
            table("spectrum", 2, mark=None),
            "amplitude center sigma slope intercept",
            [900.0, 660.0, 9.0, 0.0, 8.0],
        ),
        "doublet": least_squares(
            lambda x, a, m, s, b, n, t, c: lorentzian(x, a, m, s) + lorentzian(x, b, n, t) + c,
            table("doublet", 2),
            "a_amplitude a_center a_sigma b_amplitude b_center b_sigma c",
            [40.0, 589.0, 0.1, 20.0, 589.6, 0.1, 3.0],
        ),
        "decays": poisson(),
        "swing": least_squares(
            lambda x, a, p, f, d, c: a * np.exp(-d * x) * np.cos(2.0 * np.pi * f * x + p) + c,
            table("swing", 2, mark=";", comma=True),
            "amplitude phase frequency damping c",
            [9.0, 2.4, 0.65, 0.06, 0.4],
        ),
        "resonance": least_squares(
            lambda f, a, f0, q: a / np.sqrt((1.0 - (f / f0) ** 2) ** 2 + (f / (f0 * q)) ** 2),
            table("resonance", 2),
            "A f0 Q",
            [0.6, 1.1, 7.0],
        ),
        "capacitor": least_squares(
            lambda t, u, tau: u * (1.0 - np.exp(-t / tau)),
            table("capacitor", 2),
            "U0 tau",
            [5.0, 5.0],
        ),
        "calibration": york(),
        "laboratories": weighted(),
        "periods": readings(),
        "agreement": {"difference": (9.81 - 9.75, math.hypot(0.02, 0.01))},
        "g": {"g": (g, g * math.hypot(0.001 / 0.850, 2.0 * 0.003 / 1.851))},
    }


def by_python(name: str, found: object) -> Estimates:
    """What three lines of Python gave."""
    if name == "calibration":
        sds = found.standard_errors[found.recommended]
        return {"intercept": (found.intercept, sds[0]), "slope": (found.slope, sds[1])}
    if name in ("laboratories", "periods"):
        return {"mean": (found.best.value, found.best.u)}
    if name == "agreement":
        return {"difference": (found.difference.value, found.difference.u)}
    if name == "g":
        return {"g": (float(found.value), float(found.u))}
    return {key: (found.values[key], found.sds[key]) for key in found.values}


def by_command(record: Mapping[str, object]) -> Estimates:
    """What a result.json holds that was computed without draws: values at the mode."""
    if "fit" in record:
        return {key: (record["fit"]["values"][key], sd) for key, sd in record["fit"]["sds"].items()}
    if "standard_errors" in record:
        sds = record["standard_errors"][record["recommended"]]
        return {
            key: (record[key], sd) for key, sd in zip(("intercept", "slope"), sds, strict=False)
        }
    if "averages" in record:
        best = record["averages"][record["recommended"]]
        return {"mean": (best["value"], best["u"])}
    return {"g": (record["outputs"]["g"]["gum"]["value"], record["outputs"]["g"]["gum"]["u"])}


def apart(found: Estimates, wanted: Estimates) -> float:
    """The largest difference of a value, in standard deviations."""
    return max(abs(found[name][0] - value) / sd for name, (value, sd) in wanted.items())


def wider(found: Estimates, wanted: Estimates) -> tuple[float, float]:
    """The least and the largest ratio of the standard deviations."""
    ratios = [found[name][1] / sd for name, (_, sd) in wanted.items()]
    return min(ratios), max(ratios)


@pytest.fixture
def beside_the_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(PROJECT / "data" / "everyday", tmp_path / "data" / "everyday")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_three_lines_of_python_give_what_independent_fits_give(beside_the_data: Path) -> None:
    codes = blocks(PAGE.read_text(encoding="utf-8"), "python")
    names: dict[str, object] = {}
    for code in codes:
        assert len(code.splitlines()) <= 3
        with redirect_stdout(StringIO()):
            exec(compile(code, PAGE.name, "exec"), names)
    tasks = independent()
    assert len(codes) == len(tasks) == 14
    for name, wanted in tasks.items():
        found = by_python(name, names[name])
        assert getattr(names[name], "status", "ok") == "ok"
        assert apart(found, wanted) < NEAR, name
        assert wider(found, wanted) == pytest.approx((1.0, 1.0), abs=0.02), name


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_the_page_prints_what_it_says_and_commands_give_what_independent_fits_give(
    beside_the_data: Path,
) -> None:
    assert len(blocks(PAGE.read_text(encoding="utf-8"), "sh")) == 14
    run_page(PAGE, beside_the_data)
    for name, wanted in independent().items():
        if name == "agreement":
            continue  # has no report: what it prints is on the page
        record = json.loads((beside_the_data / "out" / name / "result.json").read_bytes())
        assert record["status" if name != "g" else "title"] in ("ok", "g = 4*pi**2*L/T**2")
        assert apart(by_command(record), wanted) < NEAR, name
        if "parameters" in record:
            drawn = {key: (of["median"], of["sd"]) for key, of in record["parameters"].items()}
            assert apart(drawn, wanted) < NEAR_DRAWS, name
            # the size of the errors is uncertain too: with 8 degrees of freedom by √(8/6), and a
            # little by its prior
            low, high = wider(drawn, wanted)
            assert 0.9 < low <= high < 1.35, name
        else:
            assert wider(by_command(record), wanted) == pytest.approx((1.0, 1.0), abs=0.02), name


def test_a_wrong_fit_is_found_out() -> None:
    """Counts without their weights, and a line without the errors of x."""
    tasks = independent()
    unweighted = least_squares(
        lambda t, n, tau, b: n * np.exp(-t / tau) + b,
        table("decays", 2),
        "N0 tau b",
        [250.0, 2.0, 4.0],
    )
    assert apart(unweighted, tasks["decays"]) > 5.0 * NEAR
    assert wider(unweighted, tasks["decays"])[0] < 0.9
    x, _, y, u_y = table("calibration", 4)
    exact = least_squares(
        lambda x, a, b: a + b * x, np.array([x, y, u_y]), "intercept slope", [0.0, 1.0]
    )
    assert apart(exact, tasks["calibration"]) > 5.0 * NEAR
    assert wider(exact, tasks["calibration"])[1] < 0.9


def test_the_tables_come_out_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(PROJECT / "docs" / "generate")
    import everyday_data

    made = everyday_data.tables()
    assert len(made) == 12
    for name, text in made.items():
        assert (PROJECT / "data" / "everyday" / name).read_text(encoding="utf-8") == text
