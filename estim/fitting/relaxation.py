"""Rounds of a fit of many runs, each run at its own pace: where the covariance of one swings, the
others need not wait.

The covariance of the noise follows the curve, so a fit goes in rounds: curve, covariance there,
curve again.  Near a turning point this map can swing for ever, or have no place where it stays: the
slope of the curve is infinite there.  Among hundreds of runs there are a few like that.  The own
parameters of such a run go a share of their step, found from two steps (Aitken's relaxation).  If
that does not help, its covariance is held at the best place that it has been, and the fit is one
with that covariance; the record says how far off the place is.

Source: Irons and Tuck, Int. J. Numer. Methods Eng. 1 (1969) 275 (relaxation from two steps).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
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

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Held:
    """A group of runs whose covariance was not taken at the mode: its rounds found no place where
    it stays.

    runs : names.
    off : how far the mode lies from where the covariance was taken, standard deviations of the
        parameter of its own that is farthest.
    felt : by how much its swings moved any parameter of another run, or of all, standard
        deviations.
    """

    runs: tuple[str, ...]
    off: float
    felt: float


@dataclass(frozen=True, eq=False)
class FixedPoint:
    """values : (n_par,).  posterior : with the covariances there, or where they are held.  moved :
    by the last round, nan without curvature.
    """

    values: FloatArray
    posterior: Posterior
    moved: float
    held: tuple[Held, ...]


@dataclass(frozen=True, eq=False)
class _Pace:
    """Of one group.

    mine : places of its own parameters.
    share : of its steps.  since : the round in which it was seen to swing, and `swing`, how far.
    height, place, likelihood : the highest density that it had, where, and with which covariance.
    felt : see `Held`.  held : whether it is.
    """

    mine: Indices
    share: float = 1.0
    since: int | None = None
    swing: float = math.inf
    height: float = -math.inf
    place: FloatArray | None = None
    likelihood: Likelihood | None = None
    felt: float = 0.0
    held: bool = False


def settle_by_runs(
    values: FloatArray,
    posterior: Posterior,
    *,
    best: Callable[[Posterior, FloatArray], FloatArray],
    spread: Callable[[Posterior, FloatArray], FloatArray | None],
) -> FixedPoint:
    """Rounds from a posterior linearised at `values` (n_par,) until they settle, at most
    `MAX_ROUNDS`.

    best : where the density is highest with given covariances.
    spread : (n_par,) standard deviations there, None without curvature.
    """
    problem = posterior.problem
    paces = [_Pace(mine) for mine in own_columns(problem.columns, problem.n_par)]
    pace, before, moved, last = np.ones(values.size), np.zeros_like(values), math.inf, 0
    far, scale = np.full(len(paces), math.inf), np.ones(values.size)
    for number in range(MAX_ROUNDS):
        step = best(posterior, values) - values
        values = values + pace * step
        posterior = _linearised(problem, values, paces)
        curved = spread(posterior, values)
        if curved is None:
            return FixedPoint(values, posterior, math.nan, ())
        scale = curved
        step = step / scale
        moved = float(np.max(np.abs(step), initial=0.0))
        if moved < SETTLED:
            break
        now = np.array([float(np.max(np.abs(step[group.mine]), initial=0.0)) for group in paces])
        # before a swing is taken for one
        if number >= 5:
            paces = _been(paces, posterior, values)
            swings = (now > 0.5 * far) & (now > _WITH_IT * np.max(now))  # the others only follow
            paces = [
                _relaxed(group, step, before, number, now[i], swings=bool(swings[i]))
                for i, group in enumerate(paces)
            ]
            others = np.ones(values.size, dtype=bool)
            for group in paces:
                if group.since is not None:
                    others[group.mine] = False
            largest = float(np.max(np.abs(step[others]), initial=0.0))
            paces = [
                group
                if group.held or group.since is None
                else replace(group, felt=max(group.felt, largest))
                for group in paces
            ]
            worst = _to_hold(
                paces, now, far, number, tired=number >= _PATIENCE and number - last >= _BETWEEN
            )
            if worst:
                last = number
                paces = [
                    replace(group, held=True, share=1.0, felt=max(group.felt, largest))
                    if i in worst
                    else group
                    for i, group in enumerate(paces)
                ]
                for i in worst:
                    values[paces[i].mine] = paces[i].place
                posterior = _linearised(problem, values, paces)
        pace = np.ones(values.size)
        for group in paces:
            pace[group.mine] = group.share
        before, far = step, now
    return FixedPoint(values, posterior, moved, _held(paces, problem, values, scale))


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


def _been(paces: list[_Pace], posterior: Posterior, values: FloatArray) -> list[_Pace]:
    """Each with the place where it is, if its own density, with the covariance taken there, is
    higher than at those before.
    """
    parameters = posterior.problem.parameters
    named = posterior.problem.named(values[None, :])
    updated = []
    for pace, likelihood in zip(paces, posterior.likelihoods, strict=True):
        if not pace.held:
            height = float(likelihood.log_likelihood(named)[0]) + sum(
                float(parameters[i].prior.log_density(values[i : i + 1])[0]) for i in pace.mine
            )
            pace = (
                replace(pace, height=height, place=values[pace.mine], likelihood=likelihood)
                if height > pace.height
                else pace
            )
        updated.append(pace)
    return updated


def _relaxed(
    one: _Pace, step: FloatArray, before: FloatArray, number: int, now: float, *, swings: bool
) -> _Pace:
    """With the share of its next step; `step` and `before` (n_par,) are the whole steps of this
    round and the one before.
    """
    if one.held or (one.since is None and not (swings and step[one.mine] @ before[one.mine] < 0.0)):
        return one
    if one.since is None:
        one = replace(one, since=number, swing=now)
    turn = step[one.mine] - before[one.mine]
    size = float(turn @ turn)
    share = -one.share * float(before[one.mine] @ turn) / size if size > 0.0 else one.share
    return replace(one, share=min(max(share, LEAST_SHARE), 1.0))


def _to_hold(
    paces: list[_Pace], now: FloatArray, far: FloatArray, number: int, *, tired: bool
) -> list[int]:
    """The groups whose covariance is to be held from here on."""
    free = [
        i
        for i, pace in enumerate(paces)
        if not pace.held and pace.place is not None and now[i] >= SETTLED
    ]
    lost = [
        i
        for i in free
        if number - (paces[i].since or number) >= _TRIED and now[i] > _HELPS * paces[i].swing
    ]
    if lost or not tired or not free:
        return lost
    farthest = max(now[i] for i in free)
    return [i for i in free if now[i] > _WITH_IT * farthest and now[i] > 0.5 * far[i]]


def _held(
    paces: list[_Pace], problem: Problem, values: FloatArray, scale: FloatArray
) -> tuple[Held, ...]:
    held = []
    for pace, group in zip(paces, problem.groups, strict=True):
        if pace.held and pace.place is not None:
            off = float(
                np.max(np.abs(values[pace.mine] - pace.place) / scale[pace.mine], initial=0.0)
            )
            held.append(Held(group.run_names, off, pace.felt))
    return tuple(held)
