"""The whole analysis on one page: campaign -> problem -> fit -> draws -> diagnosis -> bands.

Read this first.  Each stage takes records and returns one; each lives in the file of its verb.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.bands import Bands, posterior_bands
from estim.campaign import Campaign
from estim.diagnosis import Diagnosis, diagnose
from estim.fitting import Fit, fit_least_squares
from estim.goodness import Goodness, check_goodness
from estim.optimum import fit_optimum
from estim.problem import Problem
from estim.sampling import Chain, Progress, Target, sample_posterior

BAND_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Analysis:
    """Everything that one fit of one or more runs produced."""

    problem: Problem
    fit: Fit
    chain: Chain
    goodness: tuple[Goodness, ...]
    diagnosis: Diagnosis
    bands: tuple[Bands, ...]
    seed: int


def analyse(
    campaign: Campaign, runs: Sequence[str], *, seed: int, target: Target | None = None, progress: Progress | None = None
) -> Analysis:
    """The joint analysis of `runs` of a campaign; the same seed gives the same numbers.  Raises InputError."""
    fit_rng, chain_rng, check_rng, band_rng = np.random.default_rng(seed).spawn(4)
    problem = campaign.problem(runs)
    fit = fit_least_squares(problem, rng=fit_rng) if campaign.curve is None else fit_optimum(problem, rng=fit_rng)
    chain = sample_posterior(fit.posterior, fit.values, fit.cov, target=target or Target(), rng=chain_rng, progress=progress)
    goodness = check_goodness(fit, rng=check_rng)
    diagnosis = diagnose(fit, chain, goodness)
    bands = posterior_bands(problem, chain.thinned(BAND_DRAWS), rng=band_rng)
    return Analysis(problem, fit, chain, goodness, diagnosis, bands, seed)
