"""How often the intervals of a straight line with errors in both variables hold the truth; prints a
Markdown table.

    python benchmarks/line_coverage.py [--repeats 3000] [--seed 1]

True points: equally spaced in x over [0, 1] on y = x; normal errors with sd u_x and u_y; each
repeat draws new errors.  The true abscissas are thus fixed and uniform, while the Bayesian line
assumes that they are normal.  "naive" is the posterior of N(y | a + b x, u_y^2 + b^2 u_x^2) with
flat priors, by quadrature over b (given b, a is normal).  A bold number is more than 3 Monte-Carlo
standard deviations from the stated probability.  Takes about 5 minutes on one core.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.line.analysis import weigh_line
from estim.line.posterior import line_posterior
from estim.line.regression import coverage_factor, fit_line
from estim.line.slope_interval import slope_interval

FloatArray = NDArray[np.float64]
PROBABILITIES = (float(stats.chi2.cdf(1.0, 1)), 0.95)
INTERCEPT, SLOPE = 0.0, 1.0


class Cell(NamedTuple):
    """One experiment to repeat."""

    u_x: float  # in units of the range of x
    n_obs: int
    u_y: float = 0.05  # in units of the range of y


CELLS = (
    Cell(0.03, 8),
    Cell(0.03, 40),
    Cell(0.1, 8),
    Cell(0.1, 40),
    Cell(0.1, 8, 0.1),
    Cell(0.1, 40, 0.1),
)


def coverage(
    cell: Cell, *, n_repeat: int, rng: np.random.Generator
) -> dict[tuple[str, str], FloatArray]:
    """(method, parameter) -> share (2,) of the repeats whose 68 and 95 % intervals hold the
    truth.
    """
    hits: dict[tuple[str, str], list[list[bool]]] = {}
    truth = np.linspace(0.0, 1.0, cell.n_obs)
    for _ in range(n_repeat):
        x = truth + cell.u_x * rng.standard_normal(cell.n_obs)
        y = INTERCEPT + SLOPE * truth + cell.u_y * rng.standard_normal(cell.n_obs)
        for key, held in one_repeat(x, y, cell, rng=rng).items():
            hits.setdefault(key, []).append(held)
    return {key: np.mean(held, axis=0) for key, held in hits.items()}


def one_repeat(
    x: FloatArray, y: FloatArray, cell: Cell, *, rng: np.random.Generator
) -> dict[tuple[str, str], list[bool]]:
    """(method, parameter) -> whether the 68 and 95 % intervals hold the truth, for one data set."""
    held: dict[tuple[str, str], list[bool]] = {}
    fit = fit_line(x, y, u_x=cell.u_x, u_y=cell.u_y)
    for name, error in fit.standard_errors.items():
        factors = [coverage_factor(fit, probability=p, convention=name) for p in PROBABILITIES]
        held[name, "slope"] = [abs(fit.slope - SLOPE) < k * error.u_slope for k in factors]
        held[name, "intercept"] = [
            abs(fit.intercept - INTERCEPT) < k * error.u_intercept for k in factors
        ]
    for name, convention in (
        ("slope_interval", "propagated"),
        ("slope_interval, scaled", "scaled"),
    ):
        exact = [slope_interval(fit, probability=p, convention=convention) for p in PROBABILITIES]
        held[name, "slope"] = [interval.low < SLOPE < interval.high for interval in exact]
    posterior = line_posterior(x, y, u_x=cell.u_x, u_y=cell.u_y)
    sample = weigh_line(posterior, rng=rng, n_draw=4000)
    for column, (name, true) in enumerate((("intercept", INTERCEPT), ("slope", SLOPE))):
        held["Bayesian", name] = _central(float(np.mean(sample.draws[:, column] < true)))
    below_intercept, below_slope = naive_probabilities(
        x, y, cell, slopes=fit.slope * np.linspace(0.3, 2.0, 801)
    )
    held["naive", "intercept"], held["naive", "slope"] = (
        _central(below_intercept),
        _central(below_slope),
    )
    return held


def _central(below: float) -> list[bool]:
    """Whether the truth, with that posterior probability below it, lies in the central 68 and
    95 %.
    """
    return [abs(below - 0.5) < 0.5 * p for p in PROBABILITIES]


def naive_probabilities(
    x: FloatArray, y: FloatArray, cell: Cell, *, slopes: FloatArray
) -> tuple[float, float]:
    """Posterior probabilities below the true intercept and the true slope by the biased
    likelihood.
    """
    variance = cell.u_y**2 + slopes**2 * cell.u_x**2
    residual = y - slopes[:, None] * x
    centre = residual.mean(axis=1)
    log_density = -0.5 * residual.var(axis=1) * len(x) / variance - 0.5 * (len(x) - 1) * np.log(
        variance
    )
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    below_intercept = float(
        density @ stats.norm.cdf((INTERCEPT - centre) / np.sqrt(variance / len(x)))
    )
    return below_intercept, float(np.interp(SLOPE, slopes, np.cumsum(density) - 0.5 * density))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="coverage of the intervals of a straight line")
    parser.add_argument("--repeats", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    limits = [3.0 * (p * (1.0 - p) / chosen.repeats) ** 0.5 for p in PROBABILITIES]
    print(
        f"{chosen.repeats} repeats; 3 Monte-Carlo sds: {100 * limits[0]:.1f} (68.3 %), "
        f"{100 * limits[1]:.1f} (95 %)\n"
    )
    print("| u_x | n | u_y | interval | slope 68 | slope 95 | intercept 68 | intercept 95 |")
    print("|---|---|---|---|---|---|---|---|")
    for k, cell in enumerate(CELLS):
        shares = coverage(
            cell, n_repeat=chosen.repeats, rng=np.random.default_rng([chosen.seed, k])
        )
        for method in dict.fromkeys(name for name, _ in shares):
            texts = []
            for parameter in ("slope", "intercept"):
                for share, p, limit in zip(
                    shares.get((method, parameter), (None, None)),
                    PROBABILITIES,
                    limits,
                    strict=True,
                ):
                    text = "" if share is None else f"{100 * share:.1f}"
                    texts.append(
                        f"**{text}**" if share is not None and abs(share - p) > limit else text
                    )
            print(
                f"| {cell.u_x} | {cell.n_obs} | {cell.u_y} | {method} | {' | '.join(texts)} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
