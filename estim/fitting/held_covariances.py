"""Rounds of a fit of many runs: where the covariance of one swings, the others need not wait.

The covariance of the noise follows the curve, so a fit goes in rounds: curve, covariance there,
curve again.  Near a turning point this map can swing for ever, or have no place where it stays: the
slope of the curve is infinite there.  Among hundreds of runs there are a few like that.  The
covariance of such a run is held at the best place that it has been, and the fit is one with that
covariance; the record states how far off that point is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.fitting.arrowhead import own_columns
from estim.problem import Likelihood, Posterior, Problem

MAX_ROUNDS = 60
SETTLED = 1e-4  # of a standard deviation, between two rounds
_SEEN = 5  # rounds, after which the best place of a run is looked for
_PATIENCE = 10  # rounds, after which the covariance of the run that moves farthest is held
_BETWEEN = 3  # rounds between two of these
_WITH_IT = 0.3  # of the farthest, what is held with it
_NO_REST = 0.7  # of a step of a run, from which its next one does not come to rest


@dataclass(frozen=True)
class Held:
    """A group of runs whose covariance was not taken at the mode: its rounds found no place where
    it stays.

    runs : names.
    off : how far the mode lies from where the covariance was taken, standard deviations of the
        parameter of its own that is farthest.
    influence : by how much the round before it was held moved any parameter of another run, or of
        all, standard deviations.
    """

    runs: tuple[str, ...]
    off: float
    influence: float


@dataclass(eq=False)
class _Group:
    """Of one group.

    mine : indices of its own parameters.
    height, place, likelihood : the highest density that it had, where, and with which covariance.
    influence : see `Held`.  held : whether it is.
    """

    mine: IntArray
    height: float = -math.inf
    place: FloatArray | None = None
    likelihood: Likelihood | None = None
    influence: float = 0.0
    held: bool = False


def settle_by_runs(
    values: FloatArray,
    posterior: Posterior,
    *,
    best: Callable[[Posterior, FloatArray], FloatArray],
    spread: Callable[[Posterior, FloatArray], FloatArray | None],
) -> tuple[FloatArray, Posterior, float, tuple[Held, ...]]:
    """Rounds from a posterior linearised at `values` (n_par,) until they settle, at most
    `MAX_ROUNDS`.

    best : where the density is highest with given covariances.
    spread : (n_par,) standard deviations there, None without curvature.

    Returns the values, the posterior with the covariances there, or where they are held, by how
    much the last round moved, nan without curvature, and the groups that are held.
    """
    problem = posterior.problem
    groups = [_Group(mine) for mine in own_columns(problem.columns, problem.n_par)]
    moved, last = math.inf, 0
    far, scale = np.full(len(groups), math.inf), np.ones(values.size)
    for number in range(MAX_ROUNDS):
        step = best(posterior, values) - values
        values = values + step
        posterior = _linearised(problem, values, groups)
        curved = spread(posterior, values)
        if curved is None:
            return values, posterior, math.nan, ()
        scale = curved
        step = np.abs(step) / scale
        moved = float(np.max(step, initial=0.0))
        if moved < SETTLED:
            break
        now = np.array([float(np.max(step[group.mine], initial=0.0)) for group in groups])
        if number >= _SEEN:
            _remember(groups, posterior, values)
        if number >= _PATIENCE and number - last >= _BETWEEN:
            worst = _to_hold(groups, now, far)
            for group in worst:
                group.held = True
                values[group.mine] = group.place
            others = np.ones(values.size, dtype=bool)
            for group in groups:
                others[group.mine] = not group.held
            for group in worst:
                group.influence = float(np.max(step[others], initial=0.0))
            if worst:
                last, posterior = number, _linearised(problem, values, groups)
        far = now
    held = tuple(
        Held(
            runs.run_names,
            float(
                np.max(np.abs(values[group.mine] - group.place) / scale[group.mine], initial=0.0)
            ),
            group.influence,
        )
        for group, runs in zip(groups, problem.groups, strict=True)
        if group.held and group.place is not None
    )
    return values, posterior, moved, held


def _linearised(problem: Problem, values: FloatArray, groups: list[_Group]) -> Posterior:
    """The posterior linearised at the values, but for what is held."""
    posterior = problem.linearised(values)
    likelihoods = zip(posterior.likelihoods, groups, strict=True)
    return replace(
        posterior,
        likelihoods=tuple(
            group.likelihood if group.held and group.likelihood else new
            for new, group in likelihoods
        ),
    )


def _remember(groups: list[_Group], posterior: Posterior, values: FloatArray) -> None:
    """The place where each group is, if its own density, with the covariance taken there, is higher
    than at those before.
    """
    parameters = posterior.problem.parameters
    named = posterior.problem.named(values[None, :])
    for group, likelihood in zip(groups, posterior.likelihoods, strict=True):
        if group.held:
            continue
        height = float(likelihood.log_likelihood(named)[0]) + sum(
            float(parameters[i].prior.log_density(values[i : i + 1])[0]) for i in group.mine
        )
        if height > group.height:
            group.height, group.place, group.likelihood = height, values[group.mine], likelihood


def _to_hold(groups: list[_Group], now: FloatArray, far: FloatArray) -> list[_Group]:
    """The groups whose covariance is to be held from here on: those that move about as far as the
    one that moves farthest, and do not come to rest.

    now, far : (n_group,) by how much the last round and the one before moved each.
    """
    free = [
        (group, moved, before)
        for group, moved, before in zip(groups, now, far, strict=True)
        if not group.held and group.place is not None and moved >= SETTLED
    ]
    farthest = max((moved for _, moved, _ in free), default=0.0)
    return [
        group
        for group, moved, before in free
        if moved > _WITH_IT * farthest and moved > _NO_REST * before
    ]
