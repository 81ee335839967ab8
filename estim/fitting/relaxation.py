"""Rounds of a fit of many runs, each run at its own pace: where the covariance of one swings, the
others need not wait.

The covariance of the noise follows the curve, so a fit goes in rounds: curve, covariance there,
curve again.  Near a turning point this map can swing for ever, or have no place where it stays: the
slope of the curve is infinite there.  Among hundreds of runs there are a few like that.  The own
parameters of such a run go a share of their step, found from two steps (Aitken's relaxation).  If
that does not help, its covariance is held at the best place that it has been, and the fit is one
with that covariance; the record states how far off that point is.

Source: Irons and Tuck, Int. J. Numer. Methods Eng. 1 (1969) 275 (relaxation from two steps).
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
_TRIED = 3  # rounds at a share, before a covariance is held
_PATIENCE = 15  # rounds, after which the covariance of the run that moves farthest is held
_BETWEEN = 3  # rounds between two of these
_HELPS = 0.02  # of the first swing, which the rounds at a share must come below
_WITH_IT = 0.3  # of the farthest, what is held with it
LEAST_SHARE = 0.05  # of a step of rounds that swing


@dataclass(frozen=True)
class Held:
    """A group of runs whose covariance was not taken at the mode: its rounds found no place where
    it stays.

    runs : names.
    off : how far the mode lies from where the covariance was taken, standard deviations of the
        parameter of its own that is farthest.
    influence : by how much its swings moved any parameter of another run, or of all, standard
        deviations.
    """

    runs: tuple[str, ...]
    off: float
    influence: float


@dataclass(eq=False)
class _Pace:
    """Of one group.

    mine : indices of its own parameters.
    share : of its steps.  since : the round in which it was found to swing, and `swing`, how far.
    height, place, likelihood : the highest density that it had, where, and with which covariance.
    influence : see `Held`.  held : whether it is.
    """

    mine: IntArray
    share: float = 1.0
    since: int | None = None
    swing: float = math.inf
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
    paces = [_Pace(mine) for mine in own_columns(problem.columns, problem.n_par)]
    before, moved, last = np.zeros_like(values), math.inf, 0
    far, scale = np.full(len(paces), math.inf), np.ones(values.size)
    for number in range(MAX_ROUNDS):
        shares = np.ones(values.size)
        for pace in paces:
            shares[pace.mine] = pace.share
        step = best(posterior, values) - values
        values = values + shares * step
        posterior = _linearised(problem, values, paces)
        curved = spread(posterior, values)
        if curved is None:
            return values, posterior, math.nan, ()
        scale = curved
        step = step / scale
        moved = float(np.max(np.abs(step), initial=0.0))
        if moved < SETTLED:
            break
        now = np.array([float(np.max(np.abs(step[pace.mine]), initial=0.0)) for pace in paces])
        # before a swing is taken for one
        if number >= 5:
            _remember(paces, posterior, values)
            swings = (now > 0.5 * far) & (now > _WITH_IT * np.max(now))  # the others only follow
            others = np.ones(values.size, dtype=bool)
            for i, pace in enumerate(paces):
                _relax(pace, step, before, number, now[i], swings=bool(swings[i]))
                others[pace.mine] = pace.since is None
            largest = float(np.max(np.abs(step[others]), initial=0.0))
            for pace in paces:
                if pace.since is not None and not pace.held:
                    pace.influence = max(pace.influence, largest)
            worst = _to_hold(
                paces, now, far, number, tired=number >= _PATIENCE and number - last >= _BETWEEN
            )
            for pace in worst:
                pace.held, pace.share, pace.influence = True, 1.0, max(pace.influence, largest)
                values[pace.mine] = pace.place
            if worst:
                last, posterior = number, _linearised(problem, values, paces)
        before, far = step, now
    held = tuple(
        Held(
            group.run_names,
            float(np.max(np.abs(values[pace.mine] - pace.place) / scale[pace.mine], initial=0.0)),
            pace.influence,
        )
        for pace, group in zip(paces, problem.groups, strict=True)
        if pace.held and pace.place is not None
    )
    return values, posterior, moved, held


def _linearised(problem: Problem, values: FloatArray, paces: list[_Pace]) -> Posterior:
    """The posterior linearised at the values, but for what is held."""
    posterior = problem.linearised(values)
    likelihoods = zip(posterior.likelihoods, paces, strict=True)
    return replace(
        posterior,
        likelihoods=tuple(
            pace.likelihood if pace.held and pace.likelihood else new for new, pace in likelihoods
        ),
    )


def _remember(paces: list[_Pace], posterior: Posterior, values: FloatArray) -> None:
    """The place where each group is, if its own density, with the covariance taken there, is higher
    than at those before.
    """
    parameters = posterior.problem.parameters
    named = posterior.problem.named(values[None, :])
    for pace, likelihood in zip(paces, posterior.likelihoods, strict=True):
        if pace.held:
            continue
        height = float(likelihood.log_likelihood(named)[0]) + sum(
            float(parameters[i].prior.log_density(values[i : i + 1])[0]) for i in pace.mine
        )
        if height > pace.height:
            pace.height, pace.place, pace.likelihood = height, values[pace.mine], likelihood


def _relax(
    pace: _Pace, step: FloatArray, before: FloatArray, number: int, now: float, *, swings: bool
) -> None:
    """The share of its next step; `step` and `before` (n_par,) are the whole steps of this round
    and the one before.
    """
    if pace.held or (
        pace.since is None and not (swings and step[pace.mine] @ before[pace.mine] < 0.0)
    ):
        return
    if pace.since is None:
        pace.since, pace.swing = number, now
    turn = step[pace.mine] - before[pace.mine]
    size = float(turn @ turn)
    share = -pace.share * float(before[pace.mine] @ turn) / size if size > 0.0 else pace.share
    pace.share = min(max(share, LEAST_SHARE), 1.0)


def _to_hold(
    paces: list[_Pace], now: FloatArray, far: FloatArray, number: int, *, tired: bool
) -> list[_Pace]:
    """The groups whose covariance is to be held from here on."""
    free = [
        (pace, moved, before)
        for pace, moved, before in zip(paces, now, far, strict=True)
        if not pace.held and pace.place is not None and moved >= SETTLED
    ]
    stuck = [
        pace
        for pace, moved, _ in free
        if number - (pace.since or number) >= _TRIED and moved > _HELPS * pace.swing
    ]
    if stuck or not tired or not free:
        return stuck
    farthest = max(moved for _, moved, _ in free)
    return [
        pace for pace, moved, before in free if moved > _WITH_IT * farthest and moved > 0.5 * before
    ]
