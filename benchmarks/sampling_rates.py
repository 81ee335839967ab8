"""Effective draws per processor second while sampling: the chain and importance sampling of `estim
fit`, six parameters; a section of RESULTS.md.

    OMP_NUM_THREADS=1 python benchmarks/sampling_rates.py

The posterior of `bench.py`, from three seeds.  The fit, the adapted proposals and the second
opinion that chooses between them are made before the clock starts: they are part of "To 4,000
effective draws".  Ten times as many effective draws as a fit asks for, so that what is done once
weighs little.  Of the chain: rank-normalised bulk size of the worst parameter by arviz-stats; of
importance sampling: Kish's size of the weights.
"""

from __future__ import annotations

import time

import numpy as np
from bench_samplers import ESS, described, posed

_SEEDS = (1, 2, 3)
_TIMES = 10.0


def rates(seed: int) -> tuple[float, float]:
    """Of the chain and of importance sampling."""
    from estim.checks import optima_of
    from estim.common import Stream, stream
    from estim.sampling import Target
    from estim.sampling.certificate import certify
    from estim.sampling.chain import sample_posterior
    from estim.sampling.independent_check import second_opinion
    from estim.sampling.proposal import adapt_proposal
    from estim.sampling.ridges import ridge_proposal

    fit = posed()
    density, optima, support = fit.posterior, optima_of(fit), fit.problem.support()
    rng = stream(seed, Stream.PROPOSAL)
    adapted = adapt_proposal(
        density, optima.value, optima.cov, starts=optima.starts, covs=optima.covs, rng=rng
    )
    _, proposal = second_opinion(
        density, optima.value, optima.cov, adapted, starts=optima.modes, rng=rng, support=support
    )
    began = time.process_time()
    target = Target(ess=_TIMES * ESS)
    chain = sample_posterior(
        density,
        optima.value,
        optima.cov,
        target=target,
        rng=stream(seed, Stream.CHAIN),
        proposal=proposal,
    )
    spent = time.process_time() - began
    draws = np.moveaxis(chain.draws, 1, 2)
    ess = described(draws.reshape(-1, *draws.shape[2:]))[0]
    mixed = adapted.mixed_with(
        ridge_proposal(density, optima.value, optima.cov, starts=optima.modes, support=support), 0.5
    )
    began = time.process_time()
    certificate = certify(density, mixed, rng=rng, least_ess=_TIMES * ESS)
    return ess / spent, certificate.ess / (time.process_time() - began)


def table() -> list[str]:
    lines = ["| seed | chain, effective draws per CPU s | importance sampling |", "|---|---|---|"]
    rates(0)  # what is loaded once
    for seed in _SEEDS:
        chain, sampled = rates(seed)
        lines.append(f"| {seed} | {chain:,.0f} | {sampled:,.0f} |")
        print(lines[-1], flush=True)
    return lines


if __name__ == "__main__":
    table()
