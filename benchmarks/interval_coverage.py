"""Disturbances of real laboratories, three everyday curves, three programs as they come: how often
is there an answer, and how often does its interval hold the truth?  docs/coverage.md.

    python benchmarks/interval_coverage.py --out FOLDER [--sets 1000] [--seconds 25] [--docs docs]

Data are SYNTHETIC and made with NumPy alone.  A cell is a curve with a disturbance; all programs
get the same sets.  Each cell is a JSON file in FOLDER: begun again, the run takes up each cell
where it stopped, until it has --sets sets or has taken --seconds of a core in all.  Then the table
and its figure are written: coverage.md and coverage.png in FOLDER; with --docs into the page and
the figure there.

estim: `fit_curve` with nothing but the curve, the points, the stated error and starts; it answers
where its status is ok and it has an interval.  lmfit: `Model.fit` as it comes (scale_covar=True).
curve_fit: SciPy, with both settings of absolute_sigma.  Their intervals are value ± z standard
errors; there is an answer where these are finite.
"""

from __future__ import annotations

import argparse
import json
import math
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit

from estim import fit_curve

LEVELS = {"68": 0.994458, "95": 1.959964}  # quantile of the normal distribution
PROGRAMS = ("estim", "lmfit", "curve_fit, absolute", "curve_fit")
Array = np.ndarray
Answer = tuple[Array, Mapping[str, Array]]  # values (n_par,), level -> (n_par, 2) ends


@dataclass(frozen=True)
class Curve:
    formula: str
    f: Callable[..., Array]
    end: float  # x from 0 to this
    few: float  # the same, of few points
    truth: Mapping[str, float]
    u: float  # standard deviation of an undisturbed y
    slope: float  # root mean square of dy/dx
    counted: Mapping[str, float]  # true values where y are counts, 3 to 300


def swing(x: Array, c: float, A: float, tau: float, w: float, p: float) -> Array:  # noqa: N803
    return c + A * np.exp(-x / tau) * np.sin(w * x + p)


CURVES = {
    "line": Curve(
        "a + b*x",
        lambda x, a, b: a + b * x,
        10.0,
        10.0,
        {"a": 1.0, "b": 2.0},
        1.0,
        2.0,
        {"a": 3.0, "b": 29.7},
    ),
    "decay": Curve(
        "c + A*exp(-x/tau)",
        lambda x, c, A, tau: c + A * np.exp(-x / tau),  # noqa: N803
        10.0,
        10.0,
        {"c": 1.0, "A": 10.0, "tau": 2.0},
        0.3,
        1.58,
        {"c": 3.0, "A": 297.0, "tau": 2.0},
    ),
    "oscillation": Curve(
        "c + A*exp(-x/tau)*sin(w*x + p)",
        swing,
        10.0,
        4.0,
        {"c": 1.0, "A": 5.0, "tau": 5.0, "w": 3.0, "p": 0.4},
        0.3,
        5.0,
        {"c": 150.0, "A": 147.0, "tau": 5.0, "w": 3.0, "p": 0.4},
    ),
}

DISTURBANCES = {
    "none": "normal, independent, as stated",
    "AR(1) .5": "neighbours share errors",
    "AR(1) .9": "neighbours share errors",
    "growing": "sd from 0.1 to 1.7 of the stated one along x",
    "blunders": "5 % of the points 20 times less precise",
    "stated x 2": "the stated error is twice the true one",
    "stated / 2": "the stated error is half the true one",
    "errors in x": "x read with an error worth as much as that of y; nobody says so",
    "errors in x, told": "the same; estim is told (u_x), the others take none",
    "counts": "3 to 300 events; estim is told (poisson), the others have max(1, √y)",
    "counts, √y": "the same; max(1, √y) as errors for all",
    "few points": "two more than parameters",
}
N_OBS = 25


@dataclass(frozen=True)
class Points:
    """true_x, x, y, u : (n,).  told : what estim is told of the errors.  truth."""

    true_x: Array
    x: Array
    y: Array
    u: Array
    told: Mapping[str, object]
    truth: Mapping[str, float]


def points(curve: Curve, disturbance: str, rng: np.random.Generator) -> Points:
    n = len(curve.truth) + 2 if disturbance == "few points" else N_OBS
    x = true_x = np.linspace(0.0, curve.end, n)
    if disturbance == "few points":  # uneven, so that no other frequency gives the same
        x = true_x = curve.few * (np.arange(n) + rng.random(n)) / n
    if disturbance.startswith("counts"):
        y = rng.poisson(curve.f(x, **curve.counted)).astype(float)
        u = np.sqrt(np.maximum(y, 1.0))
        told = {"noise": "poisson"} if disturbance == "counts" else {"u_y": u}
        return Points(true_x, x, y, u, told, curve.counted)
    e, u = rng.standard_normal(n), np.full(n, curve.u)
    told: dict[str, object] = {}
    if disturbance.startswith("AR"):
        phi = float(disturbance.split()[1])
        for i in range(1, n):
            e[i] = phi * e[i - 1] + math.sqrt(1.0 - phi**2) * e[i]
    elif disturbance == "growing":
        e *= np.linspace(0.1, 1.7, n)
    elif disturbance == "blunders":
        e *= np.where(rng.random(n) < 0.05, 20.0, 1.0)
    elif disturbance.startswith("stated"):
        u = u * (2.0 if disturbance.endswith("2") and " x " in disturbance else 0.5)
    y = curve.f(x, **curve.truth) + curve.u * e
    if disturbance.startswith("errors in x"):
        u_x = curve.u / curve.slope
        x = x + u_x * rng.standard_normal(n)
        told = {"u_x": u_x} if disturbance.endswith("told") else {}
    return Points(true_x, x, y, u, {"u_y": u, **told}, curve.truth)


def by_estim(
    curve: Curve, data: Points, start: Mapping[str, float], statuses: dict[str, int]
) -> Answer | None:
    """statuses : status -> how often, counted here."""
    fit = fit_curve(curve.formula, data.x, data.y, start=start, **data.told)
    ends = {
        level: np.array([fit.intervals[name][p] for name in data.truth])
        for level, p in zip(LEVELS, (0.68, 0.95), strict=True)
    }
    statuses[str(fit.status)] = statuses.get(str(fit.status), 0) + 1
    if not fit.status.ok or not all(np.all(np.isfinite(of)) for of in ends.values()):
        return None
    return np.array([fit.values[name] for name in data.truth]), ends


def symmetric(values: Array, sds: Array) -> Answer | None:
    if not np.all(np.isfinite(values)) or not np.all(np.isfinite(sds) & (sds > 0.0)):
        return None
    return values, {
        level: np.column_stack([values - z * sds, values + z * sds]) for level, z in LEVELS.items()
    }


def by_lmfit(curve: Curve, data: Points, start: Mapping[str, float]) -> Answer | None:
    import lmfit

    model = lmfit.Model(curve.f)
    try:
        found = model.fit(data.y, x=data.x, weights=1.0 / data.u, **start)
    except ValueError:  # a trial curve that is not finite
        return None
    if not found.success or found.covar is None:
        return None
    of = [found.params[name] for name in data.truth]
    return symmetric(np.array([p.value for p in of]), np.array([p.stderr or np.nan for p in of]))


def by_scipy(
    curve: Curve, data: Points, start: Mapping[str, float], *, absolute: bool
) -> Answer | None:
    first = [start[name] for name in data.truth]
    try:
        values, cov = curve_fit(
            curve.f, data.x, data.y, first, sigma=data.u, absolute_sigma=absolute
        )
    except RuntimeError:  # not converged
        return None
    return symmetric(values, np.sqrt(np.diag(cov)))


def answers(
    curve: Curve, data: Points, start: Mapping[str, float], statuses: dict[str, int]
) -> Iterator[Answer | None]:
    """In the order of PROGRAMS."""
    yield by_estim(curve, data, start, statuses)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield by_lmfit(curve, data, start)
        yield by_scipy(curve, data, start, absolute=True)
        yield by_scipy(curve, data, start, absolute=False)


def ideal(curve: Curve, truth: Mapping[str, float], x: Array, u: Array) -> Array:
    """(n_par,) standard deviations by linear theory at the truth, of undisturbed points."""
    columns = []
    for name, value in truth.items():
        step = 1e-5 * abs(value)
        up, down = (curve.f(x, **{**truth, name: value + d}) for d in (step, -step))
        columns.append((up - down) / (2.0 * step) / u)
    jacobian = np.array(columns).T
    return np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))


KEYS = ("68", "95", "width")


def judged(answer: Answer, data: Points, sds: Array) -> dict[str, float]:
    """Share of the parameters that are held; log of the 68 % width in units of the ideal; the worst
    error in stated standard deviations (half the 68 % interval's width over its z).
    """
    values, ends = answer
    truth = np.array(list(data.truth.values()))
    made = {
        level: float(np.mean((of[:, 0] <= truth) & (truth <= of[:, 1])))
        for level, of in ends.items()
    }
    width = np.diff(ends["68"], axis=1)[:, 0] / (2.0 * LEVELS["68"])
    made["width"] = float(np.mean(np.log(np.maximum(width / sds, 1e-9))))
    made["worst"] = float(np.max(np.abs(values - truth) / np.maximum(width, 1e-300)))
    return made


def blank() -> dict[str, object]:
    one = {"answers": 0, "worst": 0.0} | {f"{k} sum": 0.0 for k in KEYS}
    return {
        "n": 0,
        "seconds": 0.0,
        "statuses": {},
        "of": {name: one | {f"{k} squares": 0.0 for k in KEYS} for name in PROGRAMS},
    }


def file_of(folder: Path, curve: str, disturbance: str) -> Path:
    at = list(DISTURBANCES).index(disturbance)
    return folder / f"{curve}-{at:02d}.json"


def advance(
    folder: Path, name: str, disturbance: str, *, sets: int, seconds: float
) -> dict[str, object]:
    """The cell, with as many more sets as it lacks."""
    file, curve = file_of(folder, name, disturbance), CURVES[name]
    cell = json.loads(file.read_text()) if file.exists() else blank()
    seed = zlib.crc32(f"{name}, {disturbance}".encode())
    while cell["n"] < sets and cell["seconds"] < seconds:
        begun = time.process_time()
        for _ in range(min(5, sets - cell["n"])):
            rng = np.random.default_rng([seed, cell["n"]])
            data = points(curve, disturbance, rng)
            # what a person reads off the figure: 20 % off
            start = {k: v * rng.uniform(0.8, 1.2) for k, v in data.truth.items()}
            true_u = np.full(data.x.size, curve.u)
            if disturbance.startswith("counts"):
                true_u = np.sqrt(curve.f(data.true_x, **data.truth))
            sds = ideal(curve, data.truth, data.true_x, true_u)
            found = answers(curve, data, start, cell["statuses"])
            for program, answer in zip(PROGRAMS, found, strict=True):
                if answer is None:
                    continue
                record, made = cell["of"][program], judged(answer, data, sds)
                record["answers"] += 1
                record["worst"] = max(record["worst"], made["worst"])
                for key in KEYS:
                    record[f"{key} sum"] += made[key]
                    record[f"{key} squares"] += made[key] ** 2
            cell["n"] += 1
        cell["seconds"] += time.process_time() - begun
        part = file.with_suffix(".part")
        part.write_text(json.dumps(cell))
        part.replace(file)
    return cell


def mean_and_error(record: Mapping[str, float], key: str) -> tuple[float, float]:
    """Mean over the answers and its Monte-Carlo standard deviation; a share of 0 or 1 has that of a
    count of one half.
    """
    n = record["answers"]
    if n == 0:
        return math.nan, math.nan
    mean = record[f"{key} sum"] / n
    variance = max(record[f"{key} squares"] / n - mean**2, 0.0)
    if key != "width":
        variance = max(variance, 0.5 * (n - 0.5) / n**2)
    return mean, math.sqrt(variance / n)


def share(k: float, n: int) -> tuple[float, float]:
    p = min(max(k / n, 0.5 / n), 1.0 - 0.5 / n)
    return k / n, math.sqrt(p * (1.0 - p) / n)


def percent(mean: float, error: float) -> str:
    return "" if math.isnan(mean) else f"{100.0 * mean:.0f} ± {100.0 * error:.0f}"


def rows(cells: Mapping[tuple[str, str], dict]) -> Iterator[str]:
    yield (
        "| curve | disturbance | sets | program | answers, % | 68 % holds | 95 % holds | width | "
        "worst error |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for (curve, disturbance), cell in cells.items():
        for i, program in enumerate(PROGRAMS):
            record = cell["of"][program]
            width, spread = mean_and_error(record, "width")
            wide = "" if math.isnan(width) else f"{math.exp(width):.2f} ± "
            wide += "" if math.isnan(width) else f"{math.exp(width) * spread:.2f}"
            head = (curve, disturbance, str(cell["n"])) if i == 0 else ("", "", "")
            body = (
                program,
                percent(*share(record["answers"], cell["n"])),
                percent(*mean_and_error(record, "68")),
                percent(*mean_and_error(record, "95")),
                wide,
                f"{record['worst']:.1f}" if record["answers"] else "",
            )
            yield "| " + " | ".join((*head, *body)) + " |"


def draw(cells: Mapping[tuple[str, str], dict], file: Path) -> None:
    """Coverage of the 95 % intervals among the answers, and how many sets have an answer."""
    from estim.drawing import COLOURS, MARKS, as_png, new_figure

    figure = new_figure(7.4, 10.0)
    axes = figure.subplots(2, len(CURVES), sharex=True, sharey="row", height_ratios=(3, 2))
    at = np.arange(len(DISTURBANCES))
    for column, curve in zip(axes.T, CURVES, strict=True):
        for i, program in enumerate(PROGRAMS):
            held, answered = [], []
            for disturbance in DISTURBANCES:
                cell = cells[curve, disturbance]
                held.append(mean_and_error(cell["of"][program], "95"))
                answered.append(share(cell["of"][program]["answers"], cell["n"]))
            for ax, of in zip(column, (held, answered), strict=True):
                mean, error = np.array(of).T
                ax.errorbar(
                    at + 0.16 * (i - 1.5),
                    100.0 * mean,
                    100.0 * error,
                    fmt=MARKS[i],
                    ms=3.5,
                    lw=1.0,
                    color=COLOURS[i],
                    label=program,
                )
        column[0].axhline(95.0, color="0.5", lw=0.8)
        column[0].set_title(curve)
        column[0].set_ylim(0.0, 104.0)
        column[1].set_xticks(at, list(DISTURBANCES), rotation=90)
    axes[0, 0].set_ylabel("95 % intervals that hold\nthe truth, of the answers, %")
    axes[1, 0].set_ylabel("sets with an answer, %")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    file.write_bytes(as_png(figure))


MARK = "<!-- the table -->"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--docs", type=Path)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    cells = {}
    for curve in CURVES:
        for disturbance in DISTURBANCES:
            cells[curve, disturbance] = advance(
                chosen.out, curve, disturbance, sets=chosen.sets, seconds=chosen.seconds
            )
            print(curve, disturbance, cells[curve, disturbance]["n"], flush=True)
    made = "\n".join(rows(cells)) + "\n"
    (chosen.out / "coverage.md").write_text(made)
    draw(cells, chosen.out / "coverage.png")
    if chosen.docs:
        page = chosen.docs / "coverage.md"
        page.write_text(page.read_text().split(MARK)[0] + f"{MARK}\n\n{made}")
        (chosen.docs / "coverage.png").write_bytes((chosen.out / "coverage.png").read_bytes())


if __name__ == "__main__":
    main()
