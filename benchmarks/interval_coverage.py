"""Disturbances of real laboratories, five everyday curves and a rolling body, programs as they
come: how often is there an answer, and how often does its interval hold the truth?
docs/coverage.md.

    python benchmarks/interval_coverage.py --out FOLDER [--sets 1000] [--seconds 25] [--docs docs]

Data are SYNTHETIC: the curves' are made with NumPy alone, the body's motion is solved by SciPy
(truth/), neither with code of estim/.  A cell is a curve with a disturbance; all programs get the
same sets.  Each cell is a JSON file in FOLDER: begun again, the run takes up each cell where it
stopped.  All cells are brought to 25 sets before one gets more, then to 50 and so on to --sets,
each with at most --seconds of a core at a step.  A program that is not installed is left out, and
the run says so; what FOLDER knows of it stays, and it catches up where it is installed.  Then the
table and its figure are written: coverage.md and coverage.png in FOLDER; with --docs into the page
and the figure there.

estim: `fit_curve` with nothing but the curve, the points, the stated error and starts; it answers
where its status is ok and it has an interval.  lmfit: `Model.fit` as it comes (scale_covar=True).
curve_fit: SciPy, with both settings of absolute_sigma.  iminuit: LeastSquares, migrad and minos,
with parameters from 0 where y are counts; it answers where both say that they are valid.  kafe2:
XYFit and its errors.  Intervals of lmfit, SciPy and kafe2 are value ± z standard errors; there is
an answer where these are finite.

The rolling body: a recording of positions and what is stated of the body, as truth/ makes them;
estim analyses it as `estim fit` does, with the central intervals of its draws; lmfit gets speeds by
differences and the stated values as residuals (truth/peers.py).
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import json
import math
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit
from truth.motion import solve
from truth.peers import SCALED, intervals_of_lmfit
from truth.recordings import BASE, FREE, INTERVAL, LONGEST, PRIORS, SIGMA, write_campaign
from truth.recordings import DISTURBANCES as RECORDINGS

from estim import fit_curve
from estim.campaign import load_campaign
from estim.common import EstimError
from estim.pipeline import analyse

LEVELS = {"68": 0.994458, "95": 1.959964}  # quantile of the normal distribution
SHARES = (0.68, 0.95)
PROGRAMS = {  # its package
    "estim": "estim",
    "lmfit": "lmfit",
    "curve_fit": "scipy",
    "curve_fit, absolute": "scipy",
    "iminuit": "iminuit",
    "kafe2": "kafe2",
}
Array = np.ndarray
Answer = tuple[Array, Mapping[str, Array]]  # values (n_par,), level -> (n_par, 2) ends
Found = tuple[str, Answer | None]  # what it says of its answer


@dataclass(frozen=True)
class Trial:
    """One set.  truth : (n_par,).  ideal : (n_par,) standard deviations by linear theory, at the
    truth and without the disturbance.  by : program -> what analyses the set.
    """

    truth: Array
    ideal: Array
    by: Mapping[str, Callable[[], Found]]


@dataclass(frozen=True)
class Curve:
    formula: str
    f: Callable[..., Array]
    end: float  # x from begin to this
    few: float  # the same, of few points
    truth: Mapping[str, float]
    u: float  # standard deviation of an undisturbed y
    slope: float  # root mean square of dy/dx
    counted: Mapping[str, float]  # true values where y are counts, 3 to 300
    begin: float = 0.0


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
    "peak": Curve(
        "c + A*exp(-0.5*((x - m)/s)**2)",
        lambda x, c, A, m, s: c + A * np.exp(-0.5 * ((x - m) / s) ** 2),  # noqa: N803
        10.0,
        10.0,
        {"c": 1.0, "A": 10.0, "m": 5.0, "s": 1.5},
        0.3,
        2.43,
        {"c": 3.0, "A": 297.0, "m": 5.0, "s": 1.5},
    ),
    "power law": Curve(  # periods of a pendulum, s, against its length, m
        "a*x**b",
        lambda x, a, b: a * x**b,
        2.0,
        2.0,
        {"a": 2.0, "b": 0.5},
        0.03,
        1.13,
        {"a": 75.0, "b": 2.0},
        begin=0.2,
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
    "errors in x, told": "the same; estim and kafe2 are told, the others take none",
    "counts": "3 to 300 events; estim, iminuit and kafe2 are told, the others have max(1, √y)",
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
    x = true_x = np.linspace(curve.begin, curve.end, n)
    if disturbance == "few points":  # uneven, so that no other frequency gives the same
        width = curve.few - curve.begin
        x = true_x = curve.begin + width * (np.arange(n) + rng.random(n)) / n
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


def by_estim(curve: Curve, data: Points, start: Mapping[str, float]) -> Found:
    fit = fit_curve(curve.formula, data.x, data.y, start=start, **data.told)
    ends = {
        level: np.array([fit.intervals[name][p] for name in data.truth])
        for level, p in zip(LEVELS, SHARES, strict=True)
    }
    told = fit.status.ok and all(np.all(np.isfinite(of)) for of in ends.values())
    values = np.array([fit.values[name] for name in data.truth])
    return str(fit.status), (values, ends) if told else None


def symmetric(values: Array, sds: Array) -> Found:
    if not np.all(np.isfinite(values)) or not np.all(np.isfinite(sds) & (sds > 0.0)):
        return "no errors", None
    return "given", (
        values,
        {
            level: np.column_stack([values - z * sds, values + z * sds])
            for level, z in LEVELS.items()
        },
    )


def by_lmfit(curve: Curve, data: Points, start: Mapping[str, float]) -> Found:
    import lmfit

    model = lmfit.Model(curve.f)
    try:
        found = model.fit(data.y, x=data.x, weights=1.0 / data.u, **start)
    except ValueError:  # a trial curve that is not finite
        return "not finite", None
    if not found.success or found.covar is None:
        return "not converged", None
    of = [found.params[name] for name in data.truth]
    return symmetric(np.array([p.value for p in of]), np.array([p.stderr or np.nan for p in of]))


def by_scipy(curve: Curve, data: Points, start: Mapping[str, float], *, absolute: bool) -> Found:
    first = [start[name] for name in data.truth]
    try:
        values, cov = curve_fit(
            curve.f, data.x, data.y, first, sigma=data.u, absolute_sigma=absolute
        )
    except RuntimeError:
        return "not converged", None
    return symmetric(values, np.sqrt(np.diag(cov)))


def by_iminuit(curve: Curve, data: Points, start: Mapping[str, float]) -> Found:
    from iminuit import Minuit, cost

    if "noise" in data.told:

        def lost(*p: float) -> float:
            return cost.poisson_chi2(data.y, curve.f(data.x, *p))

        lost.errordef = Minuit.LEAST_SQUARES
    else:
        lost = cost.LeastSquares(data.x, data.y, data.u, curve.f)
    fit = Minuit(lost, *start.values(), name=tuple(start))
    if "noise" in data.told:  # poisson_chi2 falls where an expectation is below 0
        fit.limits = [(0.0, None)] * len(start)
    fit.migrad()
    values = np.array(fit.values)
    if not fit.valid:
        return "migrad invalid", None
    ends = {}
    for level, p in zip(LEVELS, SHARES, strict=True):
        fit.minos(cl=p)
        if not all(one.is_valid for one in fit.merrors.values()):
            return "minos invalid", None
        ends[level] = np.array(
            [(v + e.lower, v + e.upper) for v, e in zip(values, fit.merrors.values(), strict=True)]
        )
    return "given", (values, ends)


def by_kafe2(curve: Curve, data: Points, start: Mapping[str, float]) -> Found:
    from kafe2 import IndexedFit, XYFit

    if "noise" in data.told:  # XYFit has this likelihood for whole numbers of x alone

        def expected(*p: float) -> Array:
            return curve.f(data.x, *p)

        one = inspect.Parameter.POSITIONAL_OR_KEYWORD
        names = [inspect.Parameter(name, one, default=v) for name, v in start.items()]
        expected.__signature__ = inspect.Signature(names)
        fit = IndexedFit(data.y, expected, cost_function="nll")
    else:
        fit = XYFit([data.x, data.y], curve.f)
        fit.add_error("y", data.u)
        if "u_x" in data.told:
            fit.add_error("x", data.told["u_x"])
        fit.set_parameter_values(**start)
    if not fit.do_fit()["did_fit"]:
        return "not converged", None
    return symmetric(np.array(fit.parameter_values), np.array(fit.parameter_errors, dtype=float))


def ideal(curve: Curve, truth: Mapping[str, float], x: Array, u: Array) -> Array:
    """(n_par,) standard deviations by linear theory at the truth, of undisturbed points."""
    columns = []
    for name, value in truth.items():
        step = 1e-5 * abs(value)
        up, down = (curve.f(x, **{**truth, name: value + d}) for d in (step, -step))
        columns.append((up - down) / (2.0 * step) / u)
    jacobian = np.array(columns).T
    return np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))


@contextlib.contextmanager
def of_curve(curve: Curve, disturbance: str, rng: np.random.Generator) -> Iterator[Trial]:
    data = points(curve, disturbance, rng)
    # what a person reads off the figure: 20 % off
    start = {k: v * rng.uniform(0.8, 1.2) for k, v in data.truth.items()}
    u = np.full(data.x.size, curve.u)
    if disturbance.startswith("counts"):
        u = np.sqrt(curve.f(data.true_x, **data.truth))
    programs = {
        "estim": by_estim,
        "lmfit": by_lmfit,
        "curve_fit": partial(by_scipy, absolute=False),
        "curve_fit, absolute": partial(by_scipy, absolute=True),
        "iminuit": by_iminuit,
        "kafe2": by_kafe2,
    }
    yield Trial(
        np.array(list(data.truth.values())),
        ideal(curve, data.truth, data.true_x, u),
        {name: partial(by, curve, data, start) for name, by in programs.items()},
    )


OF_BODY = {  # name of truth/
    "none": "none",
    "drag": "viscous",
    "hills": "ramp",
    "clock": "clock",
    "scale": "scale",
    "drift": "drift",
}


@cache
def ideal_of_body() -> Array:
    """(5,) of gamma, kappa, theta0, phi, c_rr: linear theory of undisturbed speeds, which are
    differences of positions with independent errors, at those positions; and of what is stated
    (c_rr: the variance of its half-normal distribution).
    """
    stated = {**PRIORS["default"], FREE[-1]: 0.005 * math.sqrt(1.0 - 2.0 / math.pi)}
    free = [name for name, u in stated.items() if u != 0.0]
    motion = solve(BASE, LONGEST)
    x = motion(np.arange(0.5, motion.first_rest / INTERVAL - 1.0) * INTERVAL)[0]
    inner = x[1:-1]

    def slopes(name: str) -> Array:
        step = 1e-4 * getattr(BASE, name)
        up, down = (replace(BASE, **{name: getattr(BASE, name) + d}) for d in (step, -step))
        rise = solve(up, LONGEST).speed_at(inner) - solve(down, LONGEST).speed_at(inner)
        return rise / (2.0 * step)

    jacobian = np.array([slopes(name) for name in free]).T
    difference = (np.eye(x.size)[2:] - np.eye(x.size)[:-2]) / (2.0 * INTERVAL)
    along = (motion.speed_at(inner + 1e-5) - motion.speed_at(inner - 1e-5)) / 2e-5
    of_errors = difference - along[:, None] * np.eye(x.size)[1:-1]
    information = jacobian.T @ np.linalg.solve(SIGMA**2 * of_errors @ of_errors.T, jacobian)
    weight = np.diag([0.0 if stated[name] is None else stated[name] ** -2 for name in free])
    sds = np.sqrt(np.diag(np.linalg.inv(information + weight)))
    return np.array([sds[free.index(name)] for name in FREE])


def body_by_estim(folder: Path, names: list[str]) -> Found:
    campaign = load_campaign(folder / "campaign.toml")
    try:
        found = analyse(campaign, campaign.run_names, seed=1)
    except EstimError:
        return "refused", None
    status = found.diagnosis.status
    columns = found.chain.flat[:, [found.problem.names.index(name) for name in names]]
    ends = {
        level: np.quantile(columns, [0.5 - 0.5 * p, 0.5 + 0.5 * p], axis=0).T
        for level, p in zip(LEVELS, SHARES, strict=True)
    }
    return str(status), (columns.mean(axis=0), ends) if status.ok else None


def body_by_lmfit(folder: Path, truth: Mapping[str, float]) -> Found:
    found = intervals_of_lmfit(folder, truth, slow=False, seed=1)[SCALED]
    if found is None:
        return "no errors", None
    ends = np.array(found)  # (n_par, level, 2)
    of_level = dict(zip(LEVELS, ends.swapaxes(0, 1), strict=True))
    return "given", (ends[:, 0].mean(axis=1), of_level)


@contextlib.contextmanager
def of_body(disturbance: str, rng: np.random.Generator) -> Iterator[Trial]:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        truth = write_campaign(
            folder, RECORDINGS[OF_BODY[disturbance]], priors="default", noise="speeds", rng=rng
        )
        yield Trial(
            np.array(list(truth.values())),
            ideal_of_body(),
            {
                "estim": partial(body_by_estim, folder, list(truth)),
                "lmfit": partial(body_by_lmfit, folder, truth),
            },
        )


@dataclass(frozen=True)
class Subject:
    """disturbances : named.  make : a set with one of them.  programs : that can analyse it."""

    disturbances: Mapping[str, str]
    make: Callable[[str, np.random.Generator], contextlib.AbstractContextManager[Trial]]
    programs: tuple[str, ...] = tuple(PROGRAMS)


SUBJECTS = {
    **{name: Subject(DISTURBANCES, partial(of_curve, curve)) for name, curve in CURVES.items()},
    "rolling body": Subject(OF_BODY, of_body, ("estim", "lmfit")),
}
KEYS = ("68", "95", "width")


def judged(answer: Answer, trial: Trial) -> dict[str, float]:
    """Share of the parameters that are held; log of the 68 % width in units of the ideal; the worst
    error in stated standard deviations (half the 68 % interval's width over its z).
    """
    values, ends = answer
    made = {
        level: float(np.mean((of[:, 0] <= trial.truth) & (trial.truth <= of[:, 1])))
        for level, of in ends.items()
    }
    width = np.diff(ends["68"], axis=1)[:, 0] / (2.0 * LEVELS["68"])
    made["width"] = float(np.mean(np.log(np.maximum(width / trial.ideal, 1e-9))))
    made["worst"] = float(np.max(np.abs(values - trial.truth) / np.maximum(width, 1e-300)))
    return made


def blank() -> dict[str, object]:
    numbers = {"n": 0, "answers": 0, "seconds": 0.0, "worst": 0.0}
    sums = {f"{k} {of}": 0.0 for k in KEYS for of in ("sum", "squares")}
    return {name: {**numbers, **sums, "statuses": {}} for name in PROGRAMS}


def file_of(folder: Path, subject: str, disturbance: str) -> Path:
    at = list(SUBJECTS[subject].disturbances).index(disturbance)
    return folder / f"{subject.replace(' ', '-')}-{at:02d}.json"


def kept(folder: Path, subject: str, disturbance: str) -> dict[str, dict]:
    file = file_of(folder, subject, disturbance)
    return json.loads(file.read_text()) if file.exists() else blank()


def analysed(trial: Trial, program: str, record: dict) -> None:
    begun = time.process_time()
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("default" if program == "estim" else "ignore")
        status, answer = trial.by[program]()
    record["seconds"] += time.process_time() - begun
    record["n"] += 1
    record["statuses"][status] = record["statuses"].get(status, 0) + 1
    if answer is not None:
        made = judged(answer, trial)
        record["answers"] += 1
        record["worst"] = max(record["worst"], made["worst"])
        for key in KEYS:
            record[f"{key} sum"] += made[key]
            record[f"{key} squares"] += made[key] ** 2


def advance(
    folder: Path, subject: str, disturbance: str, *, sets: int, seconds: float, programs: set[str]
) -> None:
    """Bring those of these programs that can analyse it to as many sets, in at most these seconds
    of a core.
    """
    file, cell = file_of(folder, subject, disturbance), kept(folder, subject, disturbance)
    programs = programs & set(SUBJECTS[subject].programs)
    seed, start = zlib.crc32(f"{subject}, {disturbance}".encode()), time.process_time()
    for at in range(min(cell[name]["n"] for name in programs), sets):
        if time.process_time() - start > seconds:
            return
        with SUBJECTS[subject].make(disturbance, np.random.default_rng([seed, at])) as trial:
            for name in programs:
                if cell[name]["n"] == at:
                    analysed(trial, name, cell[name])
        part = file.with_suffix(".part")
        part.write_text(json.dumps(cell))
        part.replace(file)


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
    if n == 0:
        return math.nan, math.nan
    p = min(max(k / n, 0.5 / n), 1.0 - 0.5 / n)
    return k / n, math.sqrt(p * (1.0 - p) / n)


def percent(mean: float, error: float) -> str:
    """Per cent, with the simulation error in brackets, rounded up."""
    return f"{100.0 * mean:.0f}({math.ceil(100.0 * error)})"


def words(record: Mapping[str, float], n: int) -> str:
    """What a program's column of the table says of a cell of n sets."""
    if record["n"] == 0:
        return ""
    said = []
    if record["answers"]:
        said.append("/".join(percent(*mean_and_error(record, level)) for level in LEVELS))
        said.append(f"{math.exp(mean_and_error(record, 'width')[0]):.2f}")
    if record["answers"] < 0.995 * record["n"]:
        said.append(f"{100.0 * record['answers'] / record['n']:.0f} %")
    return ", ".join(said) + ("" if record["n"] == n else f" ({record['n']} sets)")


def rows(cells: Mapping[tuple[str, str], dict]) -> Iterator[str]:
    yield "| curve | disturbance | sets | " + " | ".join(PROGRAMS) + " |"
    yield "|---" * (3 + len(PROGRAMS)) + "|"
    for (subject, disturbance), cell in cells.items():
        n = cell["estim"]["n"]
        found = (words(cell[program], n) for program in PROGRAMS)
        yield f"| {subject} | {disturbance} | {n} | " + " | ".join(found) + " |"


def draw(cells: Mapping[tuple[str, str], dict], file: Path) -> None:
    """Coverage of the 95 % intervals among the answers, and how many sets have an answer."""
    from PIL import Image

    from estim.drawing import MARKS, RUN_COLOURS, as_png, new_figure

    figure = new_figure(11.0)
    figure.set_figwidth(17.0)
    grid = figure.subplots(4, len(SUBJECTS) // 2)
    pairs = grid.reshape(2, 2, -1).swapaxes(1, 2).reshape(-1, 2)  # an upper panel and the one below
    for pair, (title, subject) in zip(pairs, SUBJECTS.items(), strict=True):
        at = np.arange(len(subject.disturbances))
        for i, program in enumerate(PROGRAMS):
            cell = [cells[title, name][program] for name in subject.disturbances]
            if not any(record["n"] for record in cell):
                continue
            held = [mean_and_error(record, "95") for record in cell]
            answered = [share(record["answers"], record["n"]) for record in cell]
            for ax, of in zip(pair, (held, answered), strict=True):
                mean, error = 100.0 * np.array(of).T
                there = np.isfinite(mean)
                ends = np.clip([mean - error, mean + error], 0.0, 100.0)
                ax.errorbar(
                    mean[there],
                    (at + 0.13 * (i - 2.5))[there],
                    xerr=np.abs(ends - mean)[:, there],
                    fmt=MARKS[i],
                    ms=3.5,
                    lw=1.0,
                    color=RUN_COLOURS[i],
                    label=program,
                )
        for ax in pair:
            ax.set_xlim(-3.0, 103.0)
            ax.set_ylim(len(at) - 0.5, -0.5)
            ax.set_yticks(at, list(subject.disturbances))
            ax.hlines(at[1:] - 0.5, -3.0, 103.0, color="0.85", lw=0.6)
        pair[0].axvline(95.0, color="0.5", lw=0.8)
        pair[0].set_title(title)
        pair[0].set_xlabel("95 % intervals that hold, %")
        pair[1].set_xlabel("sets with an answer, %")
    for ax in pairs[[1, 2, 4]].flat:
        ax.set_yticklabels([])  # those of the first column
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(PROGRAMS))
    # in 256 colours, a third of the bytes
    Image.open(io.BytesIO(as_png(figure))).convert("RGB").quantize(256).save(file, optimize=True)


MARK = "<!-- the table -->"
GOALS = (25, 50, 100, 200, 400)  # sets that all cells have before one gets more


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--docs", type=Path)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    programs = {name for name, package in PROGRAMS.items() if find_spec(package)}
    for name in PROGRAMS:
        if name not in programs:
            print(f"{name} is not installed and left out", flush=True)
    named = [(subject, name) for subject, of in SUBJECTS.items() for name in of.disturbances]
    for goal in (*(goal for goal in GOALS if goal < chosen.sets), chosen.sets):
        for cell in named:
            advance(chosen.out, *cell, sets=goal, seconds=chosen.seconds, programs=programs)
        print(f"{goal} sets, or what the time allowed", flush=True)
    cells = {cell: kept(chosen.out, *cell) for cell in named}
    made = "\n".join(rows(cells)) + "\n"
    (chosen.out / "coverage.md").write_text(made)
    draw(cells, chosen.out / "coverage.png")
    if chosen.docs:
        page = chosen.docs / "coverage.md"
        page.write_text(page.read_text().split(MARK)[0] + f"{MARK}\n\n{made}")
        (chosen.docs / "coverage.png").write_bytes((chosen.out / "coverage.png").read_bytes())


if __name__ == "__main__":
    main()
