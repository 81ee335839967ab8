"""The whole analysis on one page: campaign -> problem -> fit -> draws -> second opinion -> diagnosis -> bands.

Read this first.  Each stage takes records and returns one; each lives in the file of its verb.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.bands import Bands, posterior_bands
from estim.campaign import Campaign
from estim.campaign_file import NoiseTable
from estim.certify import MAX_PARAMETERS, Certificate, Comparison, adapt_proposal, certify, compare_with_chain, no_comparison, too_many
from estim.checkpoint import Store
from estim.conflict import Conflict, check_stated_values
from estim.consistency import Consistency, check_consistency, comparable
from estim.diagnosis import Diagnosis, diagnose
from estim.errors import InputError
from estim.fitting import Fit, fit_least_squares
from estim.goodness import Goodness, check_goodness, untested
from estim.headline import headline, parameter_cells
from estim.identifiability import Identifiability, identify
from estim.marginal_chain import marginal_chain
from estim.modes import Modes, find_modes
from estim.optimum import fit_optimum
from estim.outliers import Outliers, find_outliers
from estim.problem import Problem
from estim.sampling import Chain, Progress, Target, sample_posterior
from estim.stepping import Stop
from estim.summary import summarise

_BAND_DRAWS = 4000
_MODE_DRAWS = 20_000
_OUTLIER_DRAWS = 1000
_MANY_RUNS = 16  # beyond, the marginal over runs takes the place of a chain
_STARTS, _FEW_STARTS = 8, 2  # of the fit


@dataclass(frozen=True, eq=False)
class Analysis:
    """Everything that one fit of one or more runs produced.

    certificate : the second computation; None where there are too many parameters for it.
    consistency : whether several runs agree about what they share; None where that cannot be asked.
    conflict : whether the data agree with what was stated of the parameters.
    title, kind : of the campaign, "" where there is none.
    """

    problem: Problem
    fit: Fit
    certificate: Certificate | None
    chain: Chain
    comparison: Comparison
    goodness: tuple[Goodness, ...]
    identifiability: Identifiability
    modes: Modes
    outliers: tuple[Outliers, ...]
    consistency: Consistency | None
    conflict: Conflict
    diagnosis: Diagnosis
    bands: tuple[Bands, ...]
    seed: int
    title: str = ""
    kind: str = ""

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the values, or why there are none."""
        rows = [
            parameter_cells(p.name, summarise(draws, unit=p.unit, meaning=p.meaning))
            for p, draws in zip(self.problem.parameters, self.chain.flat.T if self.diagnosis.ok else (), strict=False)
        ]
        return headline(
            ": ".join(part for part in (self.title, ", ".join(run.name for run in self.problem.runs)) if part), kind=self.kind,
            status=self.diagnosis.status, reasons=self.diagnosis.reasons, advice=[f.advice for f in self.diagnosis.findings], rows=rows,
        )


def analyse(
    campaign: Campaign, runs: Sequence[str], *, seed: int, target: Target | None = None, progress: Progress | None = None,
    noise: NoiseTable | None = None, store: Store | None = None, stop: Stop | None = None, marginal: bool | None = None,
) -> Analysis:
    """The joint analysis of `runs` of a campaign; the same seed gives the same numbers.  Raises InputError.

    noise : in place of the noise tables of the campaign.
    store, stop : keep the chain on disk, resume it, end it early (`sample_posterior`).
    marginal : whether a joint posterior is sampled through the marginal over runs; None: for more than 16 of them, and where the density
        is dear (`positions`) and the chain has no proposal (more than 12 unknowns).
    """
    problem = campaign.problem(runs, noise=noise)
    campaign.require_unknowns(problem)
    rng = np.random.default_rng(seed).spawn(1)[0]
    if campaign.curve is not None:
        try:
            fit = fit_optimum(problem, rng=rng)
        except InputError as error:
            raise campaign.curve.place_of(error, problem, campaign.tables) from None
        campaign.curve.require_scatter(fit)
        campaign.curve.require_determined(fit)
    else:
        fit = fit_least_squares(problem, rng=rng, n_start=_STARTS if len(runs) <= _MANY_RUNS else _FEW_STARTS)
    analysis = analyse_fit(fit, seed=seed, target=target, progress=progress, store=store, stop=stop, marginal=marginal)
    return replace(analysis, title=campaign.title, kind=campaign.kind)


def analyse_fit(
    fit: Fit, *, seed: int, target: Target | None = None, progress: Progress | None = None, store: Store | None = None,
    stop: Stop | None = None, marginal: bool | None = None, tested: bool = True,
) -> Analysis:
    """What follows a fit, however its problem was posed.  tested : whether there are residuals to test."""
    target, problem = target or Target(), fit.problem
    chain_rng, check_rng, band_rng, proposal_rng = np.random.default_rng(seed).spawn(5)[1:]
    certificate = None
    if marginal if marginal is not None else _through_marginal(problem):
        chain, comparison = marginal_chain(fit, target=target, rng=chain_rng)
    else:
        proposal = None
        if problem.n_par <= MAX_PARAMETERS:
            proposal = adapt_proposal(fit.posterior, fit.values, fit.cov, rng=proposal_rng, starts=tuple(fit.others))
            certificate = certify(fit.posterior, proposal, rng=proposal_rng)
        chain = sample_posterior(
            fit.posterior, fit.values, fit.cov, target=target, rng=chain_rng, progress=progress, proposal=proposal, store=store, stop=stop
        )
        comparison = no_comparison(fit.names, too_many(problem.n_par)) if certificate is None else compare_with_chain(certificate, chain)
    goodness = check_goodness(fit, rng=check_rng) if tested else untested(fit)
    identifiability = identify(fit)
    modes = find_modes(fit, chain.thinned(_MODE_DRAWS))
    outliers = find_outliers(fit.posterior, chain.thinned(_OUTLIER_DRAWS))
    consistency = check_consistency(fit) if comparable(fit) else None
    conflict = check_stated_values(fit)
    diagnosis = diagnose(
        fit, chain, goodness, comparison=comparison, identifiability=identifiability, modes=modes, consistency=consistency, conflict=conflict
    )
    bands = posterior_bands(problem, chain.thinned(_BAND_DRAWS), rng=band_rng)
    return Analysis(
        problem, fit, certificate, chain, comparison, goodness, identifiability, modes, outliers, consistency, conflict, diagnosis, bands, seed
    )


def _through_marginal(problem: Problem) -> bool:
    dear = any(run.noise.positions for run in problem.runs) and problem.n_par > MAX_PARAMETERS
    return len(problem.runs) > (1 if dear else _MANY_RUNS)
