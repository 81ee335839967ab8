"""How often intervals hold the truth, by repeated sampling: the table "By repeated sampling" of
docs/statistics.md and those of docs/means.md and docs/propagation.md.

    nice python benchmarks/intervals.py [STUDY ...] [--seconds 90] [--sets 1000] [--out FOLDER]

A study is a word that its cases begin with (jitter, robust, mean, groups, readings, bent, law); all
without one.  Data are SYNTHETIC and made with NumPy alone; the same seed makes the same data.  Each
case stops after as many sets or seconds of a core, whichever comes first, and prints a row with the
sets that it had.  With --out it is kept in a file of FOLDER, and taken up there the next time.
tests/test_repeated_sampling.py runs cases of it.
"""

from __future__ import annotations

import argparse
import json
import math
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special

import estim

LEVELS = (0.68, 0.95)
Ends = Mapping[float, tuple[float, float]]
Found = tuple[str, Mapping[str, Ends]]  # status, name -> probability -> (low, high)
NORMAL = {0.68: 0.994458, 0.95: 1.959964}  # quantiles of the normal distribution
U = 0.1  # stated error of y
OF_ENDS = ("held", "there", "width")
BATCH = 5  # sets between two looks at the clock


@dataclass(frozen=True)
class Case:
    """truth : name -> true value.  once : makes one set and analyses it."""

    name: str
    truth: Mapping[str, float]
    once: Callable[[np.random.Generator], Found]


@dataclass(frozen=True)
class Tally:
    """n : sets.  ok : share whose status is ok.  held : name -> (2,) share of intervals, of those
    that there are, that hold the truth at 68 and 95 %.  there : name -> (2,) share of sets that
    have an interval.  width : name -> (2,) mean width.
    """

    n: int
    ok: float
    held: Mapping[str, np.ndarray]
    there: Mapping[str, np.ndarray]
    width: Mapping[str, np.ndarray]


def tally(
    case: Case, n: int, *, seed: int = 1, seconds: float = math.inf, kept: Path | None = None
) -> Tally:
    """Of the first n sets, or as many as the file `kept` has and these seconds add."""
    start = time.process_time()
    count = {"n": 0, "ok": 0} | {key: {name: [0, 0] for name in case.truth} for key in OF_ENDS}
    if kept and kept.exists():
        count = json.loads(kept.read_text())
    while count["n"] < n and time.process_time() - start < seconds:
        for _ in range(min(BATCH, n - count["n"])):
            rng = np.random.default_rng([seed, zlib.crc32(case.name.encode()), count["n"]])
            status, intervals = case.once(rng)
            count["n"], count["ok"] = count["n"] + 1, count["ok"] + (status == "ok")
            for name, true in case.truth.items():
                for k, p in enumerate(LEVELS):
                    low, high = intervals[name][p]
                    if not math.isnan(low + high):
                        count["there"][name][k] += 1
                        count["held"][name][k] += bool(low <= true <= high)
                        count["width"][name][k] += float(high - low)
        if kept:
            part = kept.with_suffix(".part")
            part.write_text(json.dumps(count))
            part.replace(kept)
    there = {name: np.array(of) for name, of in count["there"].items()}
    held, width = (
        {name: np.array(of) / np.maximum(there[name], 1) for name, of in count[key].items()}
        for key in ("held", "width")
    )
    of_sets = {name: of / count["n"] for name, of in there.items()}
    return Tally(count["n"], count["ok"] / count["n"], held, of_sets, width)


def error(p: float, n: int) -> float:
    """Monte-Carlo standard deviation of a share p of n sets."""
    return math.sqrt(p * (1.0 - p) / n)


# curves of the studies: formula, range of x, true values
CURVES: Mapping[str, tuple[str, float, Mapping[str, float]]] = {
    "line": ("a + b*x", 1.0, {"a": 1.0, "b": 2.0}),
    "sinusoid": ("A*sin(w*x + p)", 10.0, {"A": 2.0, "w": 1.5, "p": 0.4}),
}


def true_y(curve: str, x: np.ndarray) -> np.ndarray:
    return 1.0 + 2.0 * x if curve == "line" else 2.0 * np.sin(1.5 * x + 0.4)


def fitted(
    formula: str, x: np.ndarray, y: np.ndarray, start: Mapping[str, float], **given
) -> Found:
    fit = estim.fit_curve(formula, x, y, start=start, scan=False, **given)
    return str(fit.status), fit.intervals


def with_jitter(curve: str, n: int, ratio: float, *, jitter: bool = True) -> Case:
    """Further errors of ratio times the stated ones."""
    formula, end, truth = CURVES[curve]
    x = np.linspace(0.0, end, n)

    def once(rng: np.random.Generator) -> Found:
        y = true_y(curve, x) + U * math.hypot(1.0, ratio) * rng.standard_normal(n)
        return fitted(formula, x, y, truth, u_y=U, jitter=jitter)

    label = "" if jitter else ", without"
    return Case(
        f"jitter {ratio:g} u_y, {curve}, {n} points{label}",
        {**truth, "jitter": ratio * U} if jitter else truth,
        once,
    )


def scatter(law: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) errors whose good part has the scale 1."""
    if law == "student":
        return rng.standard_normal(n) / np.sqrt(rng.chisquare(4.0, n) / 4.0)
    good = rng.standard_normal(n)
    return np.where(rng.random(n) < 0.05, 20.0, 1.0) * good if law == "blunders" else good


def robust(curve: str, n: int, law: str, kind: str | None, *, stated: bool = True) -> Case:
    formula, end, truth = CURVES[curve]
    x = np.linspace(0.0, end, n)

    def once(rng: np.random.Generator) -> Found:
        y = true_y(curve, x) + U * scatter(law, n, rng)
        return fitted(formula, x, y, truth, u_y=U if stated else None, robust=kind)

    size = "" if stated else ", u_y left out"
    return Case(f"robust {kind}, {law} errors, {curve}, {n} points{size}", truth, once)


MEANS = ("hierarchical", "weighted", "Birge", "DerSimonian-Laird", "Mandel-Paule")


def of_values(n: int, tau: float) -> Case:
    """All means of the same values, and the one that is quoted."""

    def once(rng: np.random.Generator) -> Found:
        u = rng.uniform(0.5, 2.0, n)
        x = rng.normal(0.0, np.hypot(u, tau))
        ends: dict[str, dict[float, tuple[float, float]]] = {}
        for p in LEVELS:
            found = estim.mean(x, u, probability=p)
            for name, average in {"quoted": found.best, **found.averages}.items():
                ends.setdefault(name, {})[p] = (average.low, average.high)
        return "ok" if found.consistent else "scatter", ends

    return Case(f"mean of {n} values, tau {tau:g}", dict.fromkeys(("quoted", *MEANS), 0.0), once)


def of_groups(sizes: tuple[int, ...], between: float) -> Case:
    """Readings that scatter by 1 within a group; "readings" is the mean that knows no groups."""
    at = np.repeat(np.arange(len(sizes)), sizes)

    def once(rng: np.random.Generator) -> Found:
        x = rng.standard_normal(at.size) + between * rng.standard_normal(len(sizes))[at]
        ends: dict[str, dict[float, tuple[float, float]]] = {"groups": {}, "readings": {}}
        for p in LEVELS:
            found = estim.mean(x, groups=at.tolist(), probability=p)
            for name, of in ends.items():
                of[p] = (found.averages[name].low, found.averages[name].high)
        return "ok", ends

    each = str(sizes[0]) if len(set(sizes)) == 1 else "2 to 8"
    truth = {"groups": 0.0, "readings": 0.0}
    return Case(f"groups: {len(sizes)} of {each} readings, between {between:g}", truth, once)


def of_readings(what: str, n: int) -> Case:
    """Formulas of inputs of which n readings were taken: U = k u by the GUM, draws (JCGM 101), and
    k of the normal distribution whatever the degrees of freedom ("normal", wrong).

    "g" 4 pi^2 L/T^2: readings of T, L from a certificate, contributions to u 6 to 1.  "R" V/I: n
    readings of each, contributions alike.  "sum": readings, and a certificate that contributes as
    much.
    """
    formula, true = {"g": ("4*pi**2*L/T**2", math.pi**2), "R": ("V/I", 2.5), "sum": ("m + c", 1.0)}[
        what
    ]
    root = math.sqrt(n)

    def once(rng: np.random.Generator) -> Found:
        def readings(value: float, u: float) -> list[float]:
            return rng.normal(value, u * root, n).tolist()

        inputs: dict[str, object] = {}
        if what == "g":
            inputs["T"] = readings(2.0, 0.01)
            inputs["L"] = estim.Input("L", rng.normal(1.0, 0.0017), 0.0017)
        elif what == "R":
            inputs["V"], inputs["I"] = readings(5.0, 0.05), readings(2.0, 0.02)
        else:
            inputs["m"] = readings(1.0, 0.01)
            inputs["c"] = estim.Input("c", rng.normal(0.0, 0.01), 0.01)
        ends: dict[str, dict[float, tuple[float, float]]] = {"GUM": {}, "draws": {}, "normal": {}}
        for p in LEVELS:
            linear = estim.propagate_linear(formula, inputs, probability=p)
            drawn = estim.propagate_monte_carlo(
                formula, inputs, rng=np.random.default_rng(1), probability=p, n_draw=20_000
            ).symmetric
            value, half = float(linear.value), NORMAL[p] * float(linear.u)
            ends["GUM"][p] = (float(linear.low), float(linear.high))
            ends["draws"][p] = (float(drawn.low), float(drawn.high))
            ends["normal"][p] = (value - half, value + half)
        return "ok", ends

    truth = dict.fromkeys(("GUM", "draws", "normal"), true)
    return Case(f"readings: {what}, {n} of each", truth, once)


def bent(n: int, u_x: float, *, stated: bool = True) -> Case:
    """exp(3 x) from 0 to 1 with errors of x: its slope changes by 3 u_x over one of them."""
    true, truth = np.linspace(0.0, 1.0, n), {"a": 1.0, "b": 3.0}

    def once(rng: np.random.Generator) -> Found:
        x = true + u_x * rng.standard_normal(n)
        y = np.exp(3.0 * true) + U * rng.standard_normal(n)
        return fitted("a*exp(b*x)", x, y, truth, u_y=U, u_x=u_x if stated else None)

    label = "" if stated else ", u_x left out"
    return Case(f"bent exponential, u_x {u_x:g}, {n} points{label}", truth, once)


def mistyped(kind: str | None) -> Case:
    """A cup that cools, one of twelve readings written ten times as large; no start is given."""
    truth = {"a": 60.0, "tau": 7.5, "c": 23.0}
    x = np.linspace(0.0, 22.0, 12)

    def once(rng: np.random.Generator) -> Found:
        y = 60.0 * np.exp(-x / 7.5) + 23.0 + 0.5 * rng.standard_normal(12)
        y[rng.integers(12)] *= 10.0
        fit = estim.fit_curve("a*exp(-x/tau) + c", x, y, robust=kind)
        return str(fit.status), fit.intervals

    return Case(f"robust {kind}, one reading ten times as large, decay, 12 points", truth, once)


def with_unequal_errors(*, jitter: bool = True) -> Case:
    """A jitter of 0.2 beside stated errors from 0.05 to 0.6."""
    x, u, truth = np.linspace(0.0, 5.0, 12), np.linspace(0.05, 0.6, 12), {"a": 1.0, "b": 2.0}

    def once(rng: np.random.Generator) -> Found:
        y = 1.0 + 2.0 * x + np.hypot(u, 0.2) * rng.standard_normal(12)
        return fitted("a + b*x", x, y, truth, u_y=u, jitter=jitter)

    return Case(
        f"jitter beside unequal u_y, line, 12 points{'' if jitter else ', without'}", truth, once
    )


def single_trials(*, wrong: bool = False) -> Case:
    """Success or failure at 60 places, as by a logistic law; the wrong one holds its width."""
    x, truth = np.linspace(-3.0, 3.0, 60), {"a": -0.375, "b": 1.25}

    def once(rng: np.random.Generator) -> Found:
        y = rng.binomial(1, 1.0 / (1.0 + np.exp(-(x - 0.3) / 0.8)))
        formula = "1/(1+exp(-(a + b*x)))" if not wrong else "1/(1+exp(-(a + b*x/2)))"
        return fitted(formula, x, y, truth, noise=estim.Binomial(trials=1))

    return Case(f"law of single trials, 60{', half the slope' if wrong else ''}", truth, once)


def lifetimes(*, wrong: bool = False) -> Case:
    """30 times of a Gamma law, k = 2, by its log density; the wrong one is exponential."""
    truth = {"s": 6.0} if wrong else {"k": 2.0, "s": 3.0}

    def gamma(t, k, s):
        return (k - 1.0) * np.log(t) - t / s - k * np.log(s) - special.gammaln(k)

    def exponential(t, s):
        return -t / s - np.log(s)

    def once(rng: np.random.Generator) -> Found:
        t = np.sort(rng.gamma(2.0, 3.0, 30))
        law = exponential if wrong else gamma
        bounds = dict.fromkeys(truth, (0.001, None))
        return fitted(law, t, None, truth, noise=estim.LogDensity(), bounds=bounds)

    return Case(f"law of one's own, Gamma, 30 times{', exponential' if wrong else ''}", truth, once)


def complex_values(*, wrong: bool = False) -> Case:
    """A resonator's response at 12 frequencies; the wrong errors are half of them."""
    f, truth = np.linspace(9.0, 11.0, 12), {"f_0": 10.1, "q": 12.0}

    def response(f, f_0, q):
        return 1.0 / (1.0 + 2j * q * (f - f_0) / f_0)

    def once(rng: np.random.Generator) -> Found:
        errors = rng.standard_normal(12) + 1j * rng.standard_normal(12)
        y = response(f, **truth) + 0.05 * errors
        return fitted(response, f, y, truth, u_y=0.025 if wrong else 0.05)

    return Case(f"law of complex values, 12{', half their error' if wrong else ''}", truth, once)


def joint_priors(*, wrong: bool = False) -> Case:
    """A line through 6 points beside an earlier result, r = -0.9; the wrong one leaves r out."""
    x, truth = np.linspace(0.0, 5.0, 6), {"a": 1.0, "b": 2.0}
    sds, r = np.array([0.2, 0.07]), -0.9
    cov = np.array([[sds[0] ** 2, r * sds[0] * sds[1]], [r * sds[0] * sds[1], sds[1] ** 2]])

    def once(rng: np.random.Generator) -> Found:
        earlier = rng.multivariate_normal([1.0, 2.0], cov)
        y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(6)
        alone = {"a": (earlier[0], sds[0]), "b": (earlier[1], sds[1])}
        priors = (
            {name: f"{value:.6f} +/- {sd:.6f}" for name, (value, sd) in alone.items()}
            if wrong
            else {("a", "b"): (earlier, cov)}
        )
        return fitted("a + b*x", x, y, truth, u_y=0.1, priors=priors)

    return Case(f"law of joint priors, line{', each alone' if wrong else ''}", truth, once)


def in_groups(*, wrong: bool = False) -> Case:
    """A line whose 12 points share a zero error by threes; the wrong one does not know it."""
    x, day, truth = np.linspace(0.0, 5.0, 12), np.repeat(range(4), 3), {"a": 1.0, "b": 2.0}
    errors = [] if wrong else [estim.Component("zero_y", 0.3, "day", groups=day)]

    def once(rng: np.random.Generator) -> Found:
        zeros = 0.3 * rng.standard_normal(4)
        y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(12) + zeros[day]
        return fitted("a + b*x", x, y, truth, u_y=0.1, errors=errors)

    return Case(f"law of errors in groups, line{', as independent' if wrong else ''}", truth, once)


def two_sided(*, wrong: bool = False) -> Case:
    """A line whose errors are 0.3 above and 0.1 below (two-piece normal); the wrong way round."""
    x, truth = np.linspace(0.0, 5.0, 20), {"a": 1.0, "b": 2.0}
    below, above = (0.3, 0.1) if wrong else (0.1, 0.3)

    def once(rng: np.random.Generator) -> Found:
        size = np.abs(rng.standard_normal(20))
        # the truth lies above a reading with probability 0.3/(0.1 + 0.3)
        off = np.where(rng.random(20) < 0.75, -0.3 * size, 0.1 * size)
        y = 1.0 + 2.0 * x + off
        u_y = np.full(20, below), np.full(20, above)
        return fitted("a + b*x", x, y, truth, u_y=u_y)

    return Case(f"law of two-sided errors, line{', wrong way round' if wrong else ''}", truth, once)


def cases() -> Iterator[Case]:
    for jitter in (True, False):
        yield with_unequal_errors(jitter=jitter)
    for law in (single_trials, lifetimes, complex_values, joint_priors, in_groups, two_sided):
        for wrong in (False, True):
            yield law(wrong=wrong)
    for curve in CURVES:
        for n in (20, 60):
            for ratio in (0.0, 0.5, 2.0):
                yield with_jitter(curve, n, ratio)
            yield with_jitter(curve, n, 2.0, jitter=False)
    for curve in CURVES:
        for law, kind in (
            ("student", "student-t"),
            ("normal", "student-t"),
            ("blunders", "student-t"),
            ("blunders", "mixture"),
            ("normal", "mixture"),
            ("blunders", None),
        ):
            yield robust(curve, 40, law, kind)
    for law, kind in (("student", "student-t"), ("blunders", "mixture")):
        yield robust("line", 40, law, kind, stated=False)
    yield robust("line", 12, "blunders", "mixture", stated=False)
    yield from map(mistyped, ("mixture", None))
    for n in (2, 3, 5, 10):
        for tau in (0.0, 1.0, 3.0):
            yield of_values(n, tau)
    for n in (3, 5, 10):
        for between in (0.0, 1.0, 3.0):
            yield of_groups((4,) * n, between)
        yield of_groups(tuple(np.resize((2, 8, 4), n).tolist()), 1.0)
    for what in ("g", "R", "sum"):
        for n in (3, 4, 5, 10):
            yield of_readings(what, n)
    for n in (20, 60):
        for u_x in (0.03, 0.1):
            yield bent(n, u_x)
        yield bent(n, 0.03, stated=False)


def row(case: Case, found: Tally) -> str:
    cells = []
    for name in case.truth:
        held = "/".join(f"{100.0 * share:.1f}" for share in found.held[name])
        gap = found.there[name].min()
        cells.append(f"{name} {held}" + (f" (of {100.0 * gap:.0f} %)" if gap < 1.0 else ""))
    spread = "/".join(f"{100.0 * error(p, found.n):.1f}" for p in LEVELS)
    return f"| {case.name} | {found.n} | {'; '.join(cells)} | {spread} | {100.0 * found.ok:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", nargs="*")
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--sets", type=int, default=1000)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    if chosen.out:
        chosen.out.mkdir(parents=True, exist_ok=True)
    print("| case | sets | held at 68/95 %, in % | Monte-Carlo sd | status ok, % |")
    print("|---|---|---|---|---|")
    for case in cases():
        if not chosen.study or any(case.name.startswith(word) for word in chosen.study):
            kept = chosen.out / f"{case.name.replace('/', ' over ')}.json" if chosen.out else None
            found = tally(case, chosen.sets, seconds=chosen.seconds, kept=kept)
            print(row(case, found), flush=True)


if __name__ == "__main__":
    main()
