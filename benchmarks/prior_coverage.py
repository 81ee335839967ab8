"""How often medians of sampled posteriors lie above the truth, which should be in half of the
experiments, and how often intervals hold it, under flat priors and under Jeffreys'
prior: the table of docs/statistics.md, "Parameters without a stated prior".

    python benchmarks/prior_coverage.py [SETS]

Nothing of estim is used: curves and their derivatives by differences, least squares by SciPy, and
importance sampling from a Student-t distribution about the fit, with exact weights.  Errors are
normal and known.  What has no sign to lose is drawn by its logarithm.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

Array = np.ndarray
N_DRAW, NU, WIDER = 20_000, 5.0, 1.3
ENDS = (0.025, 0.16, 0.5, 0.84, 0.975)


@dataclass(frozen=True)
class Case:
    """value : curve at x of draws (n_draw, n_par).  logs : which parameters are positive.
    of : the one that is asked for.
    """

    words: str
    value: Callable[[Array, Array], Array]
    x: Array
    truth: tuple[float, ...]
    sd: Callable[[Array], Array]
    logs: tuple[bool, ...]
    of: int


def column(draws: Array, i: int) -> Array:
    return draws[:, i : i + 1]


def decay(x: Array, p: Array) -> Array:
    return column(p, 0) * np.exp(-x / column(p, 1)) + column(p, 2)


def arrhenius(x: Array, p: Array) -> Array:
    return column(p, 0) * np.exp(-column(p, 1) / x)


def peak(x: Array, p: Array) -> Array:
    z = (x - column(p, 1)) / column(p, 2)
    return column(p, 0) * np.exp(-0.5 * z**2) + column(p, 3)


T = np.linspace(290.0, 350.0, 9)
CASES = (
    Case(
        "a·exp(−E/x), 9 of x = 290 to 350, sd 5 % of the range",
        arrhenius,
        T,
        (2e6, 4000.0),
        lambda y: np.full(y.size, 0.05 * np.ptp(y)),
        (True, True),
        1,
    ),
    Case(
        "a·exp(−E/x), the same, sd 5 % of y",
        arrhenius,
        T,
        (2e6, 4000.0),
        lambda y: 0.05 * y,
        (True, True),
        1,
    ),
    Case(
        "a·(1 − exp(−x/τ)), 10 up to x = 1.2 τ",
        lambda x, p: column(p, 0) * (1.0 - np.exp(-x / column(p, 1))),
        np.linspace(0.5, 6.0, 10),
        (5.0, 5.0),
        lambda y: np.full(y.size, 0.08),
        (True, True),
        1,
    ),
    Case(
        "V·x/(K + x), 6 up to x = 3.3 K",
        lambda x, p: column(p, 0) * x / (column(p, 1) + x),
        np.array([0.2, 0.4, 0.8, 1.5, 3.0, 5.0]),
        (2.0, 1.5),
        lambda y: np.full(y.size, 0.06),
        (True, True),
        1,
    ),
    Case(
        "a·exp(−x/τ) + c, 12 up to x = 3.3 τ",
        decay,
        np.linspace(0.0, 10.0, 12),
        (5.0, 3.0, 1.0),
        lambda y: np.full(y.size, 0.25),
        (True, True, False),
        1,
    ),
    Case(
        "a·xⁿ, 9 of x = 20 to 200",
        lambda x, p: column(p, 0) * x ** column(p, 1),
        np.geomspace(20.0, 200.0, 9),
        (3.0, 1.5),
        lambda y: 0.05 * y,
        (True, True),
        1,
    ),
    Case(
        "a peak above a constant, 15 across 10 widths",
        peak,
        np.linspace(0.0, 10.0, 15),
        (3.0, 5.0, 1.0, 1.0),
        lambda y: np.full(y.size, 0.4),
        (True, False, True, False),
        2,
    ),
)


def log_information(case: Case, draws: Array, sd: Array) -> Array:
    """(n_draw,) half the logarithm of the determinant of the Fisher information."""
    size = np.abs(draws)
    slopes = []
    for i in range(draws.shape[1]):
        step = np.zeros_like(draws)
        step[:, i] = 1e-5 * size[:, i]
        rise = case.value(case.x, draws + step) - case.value(case.x, draws - step)
        slopes.append(rise / (2e-5 * sd))  # for a step of the parameter's own size
    rows = np.stack(slopes, axis=1)
    return 0.5 * np.linalg.slogdet(rows @ np.moveaxis(rows, 1, 2))[1] - np.sum(np.log(size), axis=1)


def quantiles(case: Case, y: Array, sd: Array, rng: np.random.Generator) -> Array:
    """(2, 5) those of the posterior under a flat prior and under Jeffreys' prior."""
    logs = np.array(case.logs)

    def natural(z: Array) -> Array:
        return np.where(logs, np.exp(np.where(logs, z, 0.0)), z)

    start = np.where(logs, np.log(np.where(logs, case.truth, 1.0)), case.truth)
    fit = least_squares(
        lambda z: (case.value(case.x, natural(z)[None])[0] - y) / sd, start, x_scale="jac"
    )
    root = np.linalg.cholesky(np.linalg.pinv(fit.jac.T @ fit.jac))
    g = rng.standard_normal((N_DRAW, start.size))
    scale = np.sqrt(rng.chisquare(NU, N_DRAW) / NU)
    z = fit.x + WIDER * (g / scale[:, None]) @ root.T
    log_q = -0.5 * (NU + start.size) * np.log1p(np.sum(g**2, axis=1) / scale**2 / NU)
    draws = natural(z)
    log_p = -0.5 * np.sum(((case.value(case.x, draws) - y) / sd) ** 2, axis=1)
    flat = log_p + np.sum(z * logs, axis=1) - log_q
    asked = draws[:, case.of]
    order = np.argsort(asked)
    found = []
    for log_weight in (flat, flat + log_information(case, draws, sd)):
        log_weight = np.where(np.isfinite(log_weight), log_weight, -np.inf)
        weight = np.exp(log_weight - np.max(log_weight))
        below = np.cumsum(weight[order])
        found.append(np.interp(ENDS, below / below[-1], asked[order]))
    return np.array(found)


def main() -> None:
    n_set = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for number, case in enumerate(CASES):
        true = case.truth[case.of]
        y = case.value(case.x, np.array([case.truth]))[0]
        sd = case.sd(y)
        cells = []
        ends = np.empty((n_set, 2, len(ENDS)))
        for k in range(n_set):
            rng = np.random.default_rng([number, k])
            with np.errstate(all="ignore"):
                ends[k] = quantiles(case, y + sd * rng.standard_normal(y.size), sd, rng)
        low_95, low_68, middle, high_68, high_95 = np.moveaxis(ends, 2, 0)
        above = 100.0 * np.mean(middle > true, axis=0)
        held = [
            100.0 * np.mean((low < true) & (true < high), axis=0)
            for low, high in ((low_68, high_68), (low_95, high_95))
        ]
        for i, name in enumerate(("flat", "Jeffreys")):
            cells.append(
                f"{name}: above {above[i]:.0f} %, {held[0][i]:.0f} and {held[1][i]:.0f} % held"
            )
        print(f"{case.words} | {' | '.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
