"""How often the intervals of gamma from trials of release hold the truth; prints a Markdown table.

    python benchmarks/release_coverage.py [--repeats 1000] [--seed 1] [--cases fixed prior]

20 trials in each series: 4 at each of 5 tilts (2, 3, 5, 6, 8 degrees, read with 0.4 degrees), up
and down in steps of 2 degrees about the angle that a gamma known to 10 % gives.  "fixed": gamma
0.187, c_rr 0.002, scatter 1.5 degrees, release 1.5 degrees.  "exponential": the release costs
another amount at each trial, exponential with mean 3 degrees; the model has one shift.  "large": it
costs 3 degrees at every trial.

In four cases c_rr, scatter and release come from their priors and gamma from a uniform distribution
on 0.15 to 0.4.  Only "prior" is a test of the analysis: gamma's prior is that distribution, and the
first angle is chosen by another gamma drawn from it, so that it says nothing of the truth.  Each of
the others takes something from the analysis that the simulation knows.  "wide": gamma uniform in
(0, 1), as `estim line` has it.  "near": also the first angle is set by a gamma within 10 % of the
truth.  "told": the same, and gamma's prior is log-normal about that gamma, 10 % wide.

Ways: the posterior; the same with the release left out; the same without the errors of the tilts;
York's line through the lowest angle that climbed at each tilt, with u = 1.5 degrees ("wide", "near"
and "told": the posterior alone).  Bias: mean of estimate (median; 1/slope) over truth less 1.
Width: median of half of the 68 % interval, of the truth.  A bold number is more than 3 Monte-Carlo
standard deviations from the stated probability.  Takes about an hour on one core.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.line.regression import coverage_factor, fit_line
from estim.line.release_analysis import weigh
from estim.line.release_likelihood import release_posterior
from estim.line.trial_data import Trials, by_tilt
from estim.model.simulate import simulate_trials
from estim.problem import HalfNormal, LogNormal, Prior, Uniform

FloatArray = NDArray[np.float64]
DEGREE = math.pi / 180.0
PROBABILITIES = (0.6827, 0.95)
RESISTANCE, RELEASE, U_THETA, U_PHI = HalfNormal(0.005), 3.0 * DEGREE, 1.5 * DEGREE, 0.4 * DEGREE
TILTS = np.array([2.0, 3.0, 5.0, 6.0, 8.0]) * DEGREE
PAPER = {
    "gamma": 0.187,
    "rolling_resistance": 0.002,
    "scatter": 1.5 * DEGREE,
    "release": 1.5 * DEGREE,
}
GAMMA, KNOWN_TO = Uniform(0.15, 0.4), 0.1
DRAWN = ("prior", "wide", "near", "told")
CASES = ("fixed", *DRAWN, "exponential", "large")


def truth_of(case: str, rng: np.random.Generator) -> dict[str, float]:
    """True values of one series."""
    if case in DRAWN:
        scatter = release_posterior(empty(), RESISTANCE).priors["scatter"]
        one = {"rolling_resistance": RESISTANCE, "scatter": scatter, "release": HalfNormal(RELEASE)}
        return {"gamma": float(GAMMA.draw(rng, 1)[0])} | {
            name: float(prior.draw(rng, 1)[0]) for name, prior in one.items()
        }
    return PAPER | ({} if case == "fixed" else {"release": 3.0 * DEGREE})


def empty() -> Trials:
    return Trials("disk", "", "", (), 0.0, U_THETA, RELEASE)


def expected_gamma(case: str, truth: float, rng: np.random.Generator) -> float:
    """The gamma by which the first angles are set."""
    return (
        float(GAMMA.draw(rng, 1)[0])
        if case in ("prior", "wide")
        else truth * math.exp(KNOWN_TO * rng.standard_normal())
    )


def prior_of_gamma(case: str, expected: float) -> Prior | None:
    """What the analysis knows of gamma; None: what `estim line` takes, uniform in (0, 1)."""
    return GAMMA if case == "prior" else LogNormal(expected, KNOWN_TO) if case == "told" else None


def simulated(
    case: str, truth: dict[str, float], expected: float, rng: np.random.Generator
) -> Trials:
    """A series of 20 trials."""
    found = simulate_trials(
        TILTS,
        truth["gamma"],
        rolling_resistance=truth["rolling_resistance"],
        u_phi=U_PHI,
        scatter=truth["scatter"],
        release=truth["release"],
        steady=case != "exponential",
        expected=expected,
        n_trial=4,
        step=2.0 * DEGREE,
        rng=rng,
    )
    return replace(empty(), tilts=by_tilt(*found), u_phi=U_PHI)


def ways(
    trials: Trials, truth: float, known: Prior | None, rng: np.random.Generator, *, every: bool
) -> dict[str, list[float]]:
    """Way -> whether the truth lies in the 68 and 95 % intervals (0, 1), relative error, relative
    half width.

    known : prior of gamma, where it is not the usual one.
    every : whether the posterior is not the only way.
    """
    if not every:
        return {"posterior": central(trials, truth, known, rng)}
    variants = {
        "posterior": trials,
        "release left out": replace(trials, release=0.0),
        "tilts taken as exact": replace(trials, u_phi=0.0),
    }
    held = {name: central(variant, truth, known, rng) for name, variant in variants.items()}
    climbed = [
        (tilt.phi, float(tilt.theta[tilt.climbed].min()))
        for tilt in trials.tilts
        if np.any(tilt.climbed)
    ]
    if len(climbed) < 3:
        return held
    phi, theta = np.array(climbed).T
    fit = fit_line(np.sin(phi), np.sin(theta), u_x=np.cos(phi) * U_PHI, u_y=np.cos(theta) * U_THETA)
    u = fit.standard_errors["propagated"].u_slope
    factors = [coverage_factor(fit, probability=p, convention="propagated") for p in PROBABILITIES]
    inside = [float(abs(fit.slope - 1.0 / truth) < k * u) for k in factors]
    return held | {
        "York, lowest ascents": [*inside, 1.0 / fit.slope / truth - 1.0, u / fit.slope**2 / truth]
    }


def central(
    trials: Trials, truth: float, known: Prior | None, rng: np.random.Generator
) -> list[float]:
    """The same of the posterior, with its central intervals."""
    posterior = release_posterior(trials, RESISTANCE)
    if known is not None:
        posterior = replace(posterior, priors={**posterior.priors, "gamma": known})
    found = weigh(posterior, rng=rng)
    gamma = found.draws[:, 0]
    below, (low, middle, high) = (
        float(np.mean(gamma < truth)),
        np.quantile(gamma, [0.16, 0.5, 0.84]),
    )
    return [
        *(float(abs(below - 0.5) < 0.5 * p) for p in PROBABILITIES),
        middle / truth - 1.0,
        0.5 * (high - low) / truth,
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description="coverage of the intervals of gamma from trials of release"
    )
    parser.add_argument("--repeats", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    chosen = parser.parse_args()
    limits = [3.0 * (p * (1.0 - p) / chosen.repeats) ** 0.5 for p in PROBABILITIES]
    print(
        f"{chosen.repeats} repeats; 3 Monte-Carlo sds: {100 * limits[0]:.1f} (68.3 %), "
        f"{100 * limits[1]:.1f} (95 %)\n"
    )
    print("| truth | way | γ 68 | γ 95 | bias % | width % |\n|---|---|---|---|---|---|")
    for k, case in enumerate(CASES):
        if case not in chosen.cases:
            continue
        rng = np.random.default_rng([chosen.seed, k])
        hits: dict[str, list[list[float]]] = {}
        for _ in range(chosen.repeats):
            truth = truth_of(case, rng)
            expected = expected_gamma(case, truth["gamma"], rng)
            known, every = prior_of_gamma(case, expected), case not in ("wide", "near", "told")
            for way, held in ways(
                simulated(case, truth, expected, rng), truth["gamma"], known, rng, every=every
            ).items():
                hits.setdefault(way, []).append(held)
        for way, held in hits.items():
            shares = np.mean(np.array(held)[:, :2], axis=0)
            off = np.mean(np.array(held)[:, 2])
            width = np.median(np.array(held)[:, 3])
            texts = [
                f"**{100 * s:.1f}**" if abs(s - p) > m else f"{100 * s:.1f}"
                for s, p, m in zip(shares, PROBABILITIES, limits, strict=True)
            ]
            print(
                f"| {case} | {way} | {' | '.join(texts)} | {100 * off:+.1f} | {100 * width:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
