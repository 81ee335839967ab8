"""How far each marginal posterior leans on the priors and on the likelihood, by power-scaling.

The posterior with prior^alpha (or likelihood^alpha) in place of the prior is reached from the draws at hand by Pareto-smoothed
importance weights prior^(alpha - 1), for alpha = 0.8 and 1.25; how far a marginal moves is the cumulative Jensen-Shannon distance
per doubling of alpha.  Above 0.05 it counts as sensitive, about a shift by 0.3 standard deviations (Kallioinen, Paananen, Buerkner,
Vehtari, Stat. Comput. 34 (2024) 57).  Distances and smoothing are those of arviz-stats.

Sensitivity to both is what two sources of like weight show, and what two that disagree show.  They are told apart by

    z = (prior centre - posterior mean) / sqrt(prior variance - posterior variance),

which scatters with unit variance when the data come from the prior (law of total variance; exactly normal for a linear model
with normal priors): beyond 2 it is called a conflict.

A uniform prior has no power to scale: its sensitivity is 0 however much its edges matter.  `estim.fitting.profile` sees edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.fitting import MANY
from estim.problem import Posterior, Prior, Problem
from estim.sampling import K_HAT_LIMIT, pareto_smoothed

THRESHOLD = 0.05
_ALPHAS = (0.8, 1.25)
_CONFLICT = 2.0  # of z

DETERMINED = "determined by the data"
PRIOR_MATTERS = "the prior matters"
BOTH_MATTER = "data and prior both matter"
CONFLICT = "data and prior disagree (conflict)"
WEAK = "weak likelihood"
UNRELIABLE = "cannot be told from these draws"


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """What one parameter's posterior leans on.

    prior, likelihood : distance per doubling of all priors together, and of the likelihood.
    by_prior : name -> the same for the prior of that parameter alone, in order: every parameter, or of many runs those that some run needs together
        with this one (any other is felt through these alone).
    strongest : the name of the single prior that matters most, None where none is above the threshold.
    disagreement : z above; 0 where the data narrow the prior by less than 5 %.
    k_hat : largest Pareto k of the weights used for `prior` and `likelihood`.
    verdict : in words.
    """

    name: str
    prior: float
    likelihood: float
    by_prior: dict[str, float]
    strongest: str | None
    disagreement: float
    k_hat: float
    verdict: str


def power_scaling(problem: Problem, posterior: Posterior, draws: FloatArray, *, threshold: float = THRESHOLD) -> tuple[Sensitivity, ...]:
    """Sensitivity of every parameter of `problem` to priors and likelihood, from posterior draws (n_draw, n_par); a few thousand are enough."""
    each = np.column_stack([p.prior.log_density(draws[:, j]) for j, p in enumerate(problem.parameters)])
    prior, prior_k = _weights(each.sum(axis=1))
    likelihood, likelihood_k = _weights(posterior.log_likelihood(draws))
    alone = [_weights(column)[0] for column in each.T]
    k_hat = max(prior_k, likelihood_k)
    rows, beside = [], _beside(problem)
    for i, name in enumerate(problem.names):
        column = draws[:, i]
        by_prior = {problem.names[k]: _distance(column, alone[k]) for k in beside[i]}
        strongest = max(by_prior, key=lambda other: by_prior[other])
        s_prior, s_likelihood = _distance(column, prior), _distance(column, likelihood)
        z = _disagreement(problem.parameters[i].prior, column)
        rows.append(
            Sensitivity(
                name=name, prior=s_prior, likelihood=s_likelihood, by_prior=by_prior, disagreement=z, k_hat=k_hat,
                strongest=strongest if by_prior[strongest] >= threshold else None,
                verdict=_verdict(s_prior, s_likelihood, z, k_hat, threshold),
            )
        )
    return tuple(rows)


def _beside(problem: Problem) -> list[list[int]]:
    """For each parameter the places of those whose priors are asked for by themselves."""
    every = range(problem.n_par)
    if len(problem.groups) <= MANY:
        return [list(every) for _ in every]
    found = [{i} for i in every]
    for used in problem.columns:
        for i in used.tolist():
            found[i].update(used.tolist())
    return [sorted(one) for one in found]


def _weights(log_density: FloatArray) -> tuple[tuple[FloatArray, FloatArray] | None, float]:
    """Smoothed normalised weights (n_draw,) for the two powers, and the larger Pareto k (inf: raw weights); None where nothing scales."""
    if np.ptp(log_density) < 1e-12:
        return None, -math.inf
    found = [pareto_smoothed((alpha - 1.0) * log_density) for alpha in _ALPHAS]
    return (np.exp(found[0][0]), np.exp(found[1][0])), max(k_hat for _, k_hat, _ in found)


def _distance(column: FloatArray, weights: tuple[FloatArray, FloatArray] | None) -> float:
    """Cumulative Jensen-Shannon distance per doubling of the power, of one marginal."""
    from arviz_stats.base import array_stats

    if weights is None or np.ptp(column) == 0.0:
        return 0.0
    return float(array_stats.power_scale_sense(column[None], weights[0][None], weights[1][None], *_ALPHAS, chain_axis=0, draw_axis=1))


def _disagreement(prior: Prior, column: FloatArray) -> float:
    if not math.isfinite(prior.sd):
        return 0.0
    learnt = 1.0 - (float(column.std()) / prior.sd) ** 2
    return (prior.expectation - float(column.mean())) / (prior.sd * math.sqrt(learnt)) if learnt > 0.1 else 0.0


def _verdict(prior: float, likelihood: float, z: float, k_hat: float, threshold: float) -> str:
    if not k_hat < K_HAT_LIMIT:
        return UNRELIABLE
    if prior >= threshold and likelihood >= threshold:
        return CONFLICT if abs(z) >= _CONFLICT else BOTH_MATTER
    if prior >= threshold:
        return PRIOR_MATTERS
    return DETERMINED if likelihood >= threshold else WEAK
