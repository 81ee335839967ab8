"""How far each marginal posterior leans on the priors and on the likelihood, by power-scaling.

The posterior with prior^alpha (or likelihood^alpha) in place of the prior is reached from the draws
at hand by Pareto-smoothed importance weights prior^(alpha - 1), for alpha = 0.8 and 1.25; how far a
marginal moves is the cumulative Jensen-Shannon distance per doubling of alpha.  Above 0.05 it
counts as sensitive, about a shift by 0.3 standard deviations (Kallioinen, Paananen, Buerkner,
Vehtari, Stat. Comput. 34 (2024) 57).  Tests hold the distances against arviz-stats.

Sensitivity to both is what two sources of like weight show, and what two that disagree show.  They
are distinguished by

    z = (prior centre - posterior mean) / sqrt(prior variance - posterior variance),

which scatters with unit variance when the data come from the prior (law of total variance; exactly
normal for a linear model with normal priors): beyond 2 it is called a conflict.

A uniform prior has no power to scale: its sensitivity is 0 however much its edges matter.
`estim.fitting.profile` shows them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import later
from estim.fitting import MANY_RUNS
from estim.problem import Prior, Problem
from estim.sampling import K_HAT_LIMIT, pareto_smoothed

Weights = tuple[FloatArray, FloatArray]

THRESHOLD = 0.05
_ALPHAS = (0.8, 1.25)
_CONFLICT = 2.0  # of z

DETERMINED = later("determined by the data")
PRIOR_MATTERS = later("sensitive to the prior")
BOTH_MATTER = later("sensitive to both data and prior")
CONFLICT = later("data and prior disagree (conflict)")
WEAK = later("weak likelihood")
UNRELIABLE = later("undecided from these draws")


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """What one parameter's posterior leans on.

    prior, likelihood : distance per doubling of all priors together, and of the likelihood.
    strongest : the name of the single prior that matters most, None where none is above the
        threshold; of many runs, of those that some run needs together with this one (any other
        acts through these alone).
    disagreement : z above; 0 where the data narrow the prior by less than 5 %.
    k_hat : largest Pareto k of the weights used for `prior` and `likelihood`.
    verdict : in words.
    """

    name: str
    prior: float
    likelihood: float
    strongest: str | None
    disagreement: float
    k_hat: float
    verdict: str


def power_scaling(
    problem: Problem, draws: FloatArray, log_likelihood: FloatArray
) -> tuple[Sensitivity, ...]:
    """Sensitivity of every parameter of `problem` to priors and likelihood, from posterior draws
    (n_draw, n_par); a few thousand are enough.

    log_likelihood : (n_draw,) of the draws, up to a constant.
    """
    each = np.column_stack(
        [p.prior.log_density(draws[:, j]) for j, p in enumerate(problem.parameters)]
    )
    prior, prior_k = _weights(problem.log_prior(draws))
    likelihood, likelihood_k = _weights(log_likelihood)
    alone = [_weights(column)[0] for column in each.T]
    k_hat = max(prior_k, likelihood_k)
    rows, neighbours = [], _neighbours(problem)
    for i, name in enumerate(problem.names):
        column = draws[:, i]
        s_prior, s_likelihood, *each_alone = _distances(
            column, [prior, likelihood, *(alone[k] for k in neighbours[i])]
        )
        most = int(np.argmax(each_alone))
        z = _disagreement(problem.parameters[i].prior, column)
        rows.append(
            Sensitivity(
                name=name,
                prior=s_prior,
                likelihood=s_likelihood,
                disagreement=z,
                k_hat=k_hat,
                strongest=problem.names[neighbours[i][most]]
                if each_alone[most] >= THRESHOLD
                else None,
                verdict=_verdict(s_prior, s_likelihood, z, k_hat),
            )
        )
    return tuple(rows)


def _neighbours(problem: Problem) -> list[list[int]]:
    """For each parameter the indices of those whose priors are scaled one by one."""
    every = range(problem.n_par)
    if len(problem.groups) <= MANY_RUNS:
        return [list(every) for _ in every]
    neighbours = [{i} for i in every]
    for used in problem.columns:
        for i in used.tolist():
            neighbours[i].update(used.tolist())
    return [sorted(indices) for indices in neighbours]


def _weights(log_density: FloatArray) -> tuple[Weights | None, float]:
    """Smoothed normalised weights (n_draw,) for the two powers, and the larger Pareto k (inf: raw
    weights); None where nothing scales.
    """
    if np.ptp(log_density) < 1e-12:
        return None, -math.inf
    smoothed = [pareto_smoothed((alpha - 1.0) * log_density) for alpha in _ALPHAS]
    return (np.exp(smoothed[0][0]), np.exp(smoothed[1][0])), max(k_hat for _, k_hat, _ in smoothed)


def _distances(column: FloatArray, weights: Sequence[Weights | None]) -> list[float]:
    """Cumulative Jensen-Shannon distance per doubling of the power, of one marginal (n_draw,), for
    each pair of `weights`; 0 for None.

    The larger of those from below and from above, averaged over the two powers.
    """
    averages, present = (
        [0.0] * len(weights),
        [k for k, pair in enumerate(weights) if pair is not None],
    )
    if np.ptp(column) == 0.0 or not present:
        return averages
    order = np.argsort(column)
    widths = np.diff(column[order])
    both = np.array([row for pair in weights if pair is not None for row in pair])[:, order]
    distances = np.maximum(
        _jensen_shannon(both, widths), _jensen_shannon(both[:, ::-1], widths[::-1])
    )
    per_doubling = distances.reshape(-1, 2) / np.abs(np.log2(_ALPHAS))
    for k, distance in zip(present, np.mean(per_doubling, axis=1), strict=True):
        averages[k] = float(distance)
    return averages


def _jensen_shannon(weights: FloatArray, widths: FloatArray) -> FloatArray:
    """(n,) distances between draws of equal weight and with `weights` (n, n_draw), both in order,
    `widths` (n_draw - 1,) apart.

    Nguyen, Vreeken, ECML PKDD (2015) 173: sqrt of the sum of both divergences of the distribution
    functions P and Q, over their integrals.
    """
    n_draw = weights.shape[1]
    p = np.linspace(1.0 / n_draw, 1.0 - 1.0 / n_draw, n_draw - 1)
    q = np.cumsum(weights / np.sum(weights, axis=1, keepdims=True), axis=1)[:, :-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = np.log2(0.5 * (p + q))
        reference, other = (
            p * (np.log2(p) - middle),
            np.where(q > 0.0, q * (np.log2(q) - middle), 0.0),
        )
    area, areas = p @ widths, q @ widths
    tilt = (areas - area) / (2.0 * np.log(2.0))
    return np.sqrt(
        (np.maximum(reference @ widths + tilt, 0.0) + np.maximum(other @ widths - tilt, 0.0))
        / (area + areas)
    )


def _disagreement(prior: Prior, column: FloatArray) -> float:
    if not math.isfinite(prior.sd):
        return 0.0
    learnt = 1.0 - (float(column.std()) / prior.sd) ** 2
    return (
        (prior.expectation - float(column.mean())) / (prior.sd * math.sqrt(learnt))
        if learnt > 0.1
        else 0.0
    )


def _verdict(prior: float, likelihood: float, z: float, k_hat: float) -> str:
    if not k_hat < K_HAT_LIMIT:
        return UNRELIABLE
    if prior >= THRESHOLD and likelihood >= THRESHOLD:
        return CONFLICT if abs(z) >= _CONFLICT else BOTH_MATTER
    if prior >= THRESHOLD:
        return PRIOR_MATTERS
    return DETERMINED if likelihood >= THRESHOLD else WEAK
