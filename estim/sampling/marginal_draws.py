"""The marginal over runs in the place of a chain: equally weighted draws, and its own check as the
second opinion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.common import Finding, Kind, NumericalError
from estim.fitting import Fit
from estim.sampling.certificate import Agreement, no_comparison
from estim.sampling.chain import Chain, Convergence, Progress, Target
from estim.sampling.diagnostics import mixing_of
from estim.sampling.importance import K_HAT_LIMIT
from estim.sampling.marginal import MarginalPosterior, sample_marginal

_N_CHAIN = 4  # parts that the independent draws are shown in


def marginal_chain(
    fit: Fit, *, target: Target, rng: np.random.Generator, progress: Progress | None = None
) -> tuple[Chain, Agreement]:
    """Independent draws of a joint posterior by `estim.sampling.marginal`, and the verdict of exact
    weights in all dimensions on them.

    Where Laplace's approximation moves a parameter, the runs are integrated by 5 x 5 nodes, and
    where the proposal misses a tail, some of the draws come from far around.

    Raises InputError where noise is not normal or too much is shared, NumericalError where the fit
    leaves something undetermined or a run's own parameters cannot be integrated out.
    """
    n_draw = int(max(8000, 2.5 * target.ess))
    try:
        marginal = sample_marginal(fit, rng=rng, n_draw=n_draw, progress=progress)
        if not marginal.trusted:
            wide = not marginal.k_hat < K_HAT_LIMIT
            marginal = sample_marginal(
                fit, rng=rng, n_draw=n_draw, n_node=5, wide=wide, progress=progress
            )
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            f"the marginal over runs cannot be computed ({error}): use the sampler"
        ) from error
    # no more draws than the weights are worth: their number then is their effective size
    n_kept = max(_N_CHAIN * 10, int(min(marginal.ess, n_draw)) // _N_CHAIN * _N_CHAIN)
    draws = rng.permutation(marginal.resampled(n_kept, rng=rng)).reshape(
        _N_CHAIN, -1, 1, len(fit.names)
    )
    flat = draws.reshape(-1, draws.shape[-1])
    short = marginal.ess < target.ess
    findings = (Finding(Kind.INDEPENDENT_DRAWS),) if marginal.trusted else marginal.findings
    if short:
        findings = (
            Finding(Kind.DRAWS_SHORT, size=marginal.ess, numbers={"limit": target.ess}),
            *findings,
        )
    convergence = Convergence(
        n_step=draws.shape[1],
        rhat=float(np.max(mixing_of(draws).rhat)),
        ess_bulk=marginal.ess,
        ess_tail=marginal.ess,
        tau=1.0,
        met=marginal.trusted and not short,
        findings=findings,
    )
    log_density = fit.sampled.log_density(flat).reshape(draws.shape[:3])
    chain = Chain(fit.names, draws, log_density, 0, np.ones(_N_CHAIN), 0, convergence)
    return chain, _agreement(marginal, len(fit.names))


def _agreement(marginal: MarginalPosterior, n_par: int) -> Agreement:
    """The exact weights in all dimensions as a comparison; "missing" where they are too uneven for
    a verdict.
    """
    disagree = any(finding.kind is Kind.WEIGHTS_MOVE for finding in marginal.findings)
    conclusive = marginal.k_hat_all < K_HAT_LIMIT or len(marginal.sampled) == n_par
    verdict = "disagree" if disagree else "agree" if marginal.trusted and conclusive else "missing"
    return replace(no_comparison(n_par, *marginal.findings), verdict=verdict)
