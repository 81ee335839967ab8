"""How often intervals of a mean lifetime hold the truth where events are counted, and where their
square roots pass for errors.

    nice python benchmarks/counts_coverage.py            # 1000 simulated experiments of 30, 300 and
    3000 events: about ten minutes

Times of decay (mean 2.2 µs) in a window of 10 µs are simulated, and fit one by one, in 20 bins, and
in the same bins as readings with u_y = sqrt(y), empty bins left out.  Intervals: profiles of the
likelihood, the posterior with flat priors by sums over a grid, and value ± z standard deviations
for readings.  The table says in how many per cent they hold 2.2 µs, and how far the fit lies off on
average, in standard deviations.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from estim.curves import DataSet, ParameterSettings, pose_points
from estim.curves.count_data import EventTimes, Poisson
from estim.distributions import normal_quantile
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.profile import profile_intervals

TRUTH, END, WIDTH = 2.2, 10.0, 0.5
LEVELS = (0.68, 0.95)
DENSITY, SHAPE = "N/tau*exp(-x/tau)", "exp(-x/tau)"
LIMITS = {"tau": (0.01, None), "N": (0.0, None)}
Held = tuple[bool, ...]


def times_of(n: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) decays seen within the window."""
    return -TRUTH * np.log1p(-rng.random(n) * -math.expm1(-END / TRUTH))


def fitted(
    curve: str, x: np.ndarray, y: np.ndarray | None, start: dict[str, float], **errors: object
) -> Fit:
    settings = ParameterSettings(start, {name: LIMITS[name] for name in start})
    posed = pose_points(DataSet(x, y, curve=curve, **errors), settings, ())
    problem = posed.with_sigma(1.0)
    return fit_least_squares(problem, start=problem.start())


def by_profile(fit: Fit) -> Held:
    (interval,) = profile_intervals(fit, names=["tau"], probabilities=LEVELS)
    return tuple(interval.low[p] < TRUTH < interval.high[p] for p in LEVELS)


def by_posterior(fit: Fit) -> Held:
    """Central intervals under flat priors, by sums over a grid in all parameters."""
    sds, i = np.sqrt(np.diag(fit.cov)), fit.names.index("tau")
    ends = [
        (max(value - 6.0 * sd, 0.02), value + 9.0 * sd)
        for value, sd in zip(fit.values, sds, strict=True)
    ]
    axes = [np.linspace(low, high, 200 if k == i else 40) for k, (low, high) in enumerate(ends)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, fit.values.size)
    height = np.concatenate(
        [
            fit.posterior.log_density(part)
            for part in np.array_split(grid, max(1, grid.shape[0] * 3000 // 10_000_000 + 1))
        ]
    )
    weight = (
        np.exp(height - height.max())
        .reshape([axis.size for axis in axes])
        .sum(axis=tuple(k for k in range(len(axes)) if k != i))
    )
    below = np.interp(TRUTH, axes[i], (np.cumsum(weight) - 0.5 * weight) / weight.sum())
    return tuple(bool(0.5 - 0.5 * p < below < 0.5 + 0.5 * p) for p in LEVELS)


def experiment(n: int, rng: np.random.Generator) -> dict[str, tuple[Held, float]]:
    times = times_of(n, rng)
    edges = np.linspace(0.0, END, round(END / WIDTH) + 1)
    counts = np.histogram(times, edges)[0].astype(float)
    middles = 0.5 * (edges[1:] + edges[:-1])
    single = fitted(SHAPE, times, None, {"tau": TRUTH}, noise=EventTimes(0.0, END))
    start = {"N": n * 1.01, "tau": TRUTH}
    binned = fitted(DENSITY, middles, counts, start, noise=Poisson(WIDTH))
    some = counts > 0.0
    student = fitted(
        f"{WIDTH}*{DENSITY}", middles[some], counts[some], start, u_y=np.sqrt(counts[some])
    )
    found = {
        "single times, profile": (by_profile(single), off(single)),
        "single times, posterior": (by_posterior(single), off(single)),
    }
    found |= {
        "bins, profile": (by_profile(binned), off(binned)),
        "bins, posterior": (by_posterior(binned), off(binned)),
    }
    half = [float(normal_quantile(0.5 - 0.5 * p)) for p in LEVELS]
    return found | {
        "sqrt(y), empty bins left out": (
            tuple(abs(off(student)) < abs(z) for z in half),
            off(student),
        )
    }


def off(fit: Fit) -> float:
    """Of tau from the truth, in standard deviations."""
    i = fit.names.index("tau")
    return float((fit.values[i] - TRUTH) / np.sqrt(fit.cov[i, i]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--events", type=int, nargs="+", default=[30, 300, 3000])
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    errors = [100.0 * math.sqrt(p * (1.0 - p) / given.trials) for p in LEVELS]
    print(
        f"{given.trials} experiments; Monte-Carlo standard deviations {errors[0]:.1f} and "
        f"{errors[1]:.1f} %\n"
    )
    print(
        "| events | fit | 68 % interval holds | 95 % interval holds | mean of (tau - "
        "truth)/sd |\n|---|---|---|---|---|"
    )
    for n in given.events:
        rng = np.random.default_rng([given.seed, n])
        every = [experiment(n, rng) for _ in range(given.trials)]
        for name in every[0]:
            shares = 100.0 * np.mean([one[name][0] for one in every], axis=0)
            print(
                f"| {n} | {name} | {shares[0]:.1f} % | {shares[1]:.1f} % | "
                f"{np.mean([one[name][1] for one in every]):+.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
