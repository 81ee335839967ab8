"""Least squares of many runs: each depends on a few parameters that runs share and on a few of its
own.

With the own parameters of run r in o_r and the shared ones in s, the information is an arrow head:
blocks of each run's own parameters on the diagonal, and a border of the shared ones.  Each run is
turned into a triangle (QR) by itself; what is left below it speaks of s alone.  Those rows of all
runs together give s, and each triangle then the run's own parameters.  The cost grows with the
number of runs, not with its cube, and no precision is lost to normal equations.

Use it for more than `MANY` independent groups of runs; fewer are fit by lmfit.

Source: Golub and Plemmons, Linear Algebra Appl. 34 (1980) 3 (dissection of adjustments); Nielsen,
IMM-REP-1999-05 (damping).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.problem import Posterior, Problem

MANY = 16
_MOST_STEPS = 200
_ROUNDING = 1e-13  # of chi^2
_SHORTER = 0.1  # what a step promises, of the step before
_LEAST_DAMPING, _FACTOR, _MOST_DAMPING = 1e-6, 10.0, 1e12
_HELD_ROUNDS = 4
_NOTHING = 1e-13  # of the largest singular value

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Rows:
    """What one group of runs asks: jacobian (n, n_used) times the parameters in `columns` (n_used,)
    shall be target (n, n_target).
    """

    columns: Indices
    jacobian: FloatArray
    target: FloatArray


@dataclass(frozen=True, eq=False)
class _Part:
    """One group of runs in triangles: basis triangle own + rest wide shared, and `along` of the
    shared parameters in the basis of its own.

    mine, shared : (n_own,), (n_shared,) columns of the parameters.  basis (n + n_own, n_own),
        triangle (n_own, n_own), along (n_own, n_shared), rest (n + n_own, n_shared or fewer), wide
        (n_shared or fewer, n_shared); the last n_own rows are those of the priors.  An own
        parameter of which nothing is said is left out.
    """

    mine: Indices
    shared: Indices
    basis: FloatArray
    triangle: FloatArray
    along: FloatArray
    rest: FloatArray
    wide: FloatArray

    @classmethod
    def of(cls, columns: Indices, jacobian: FloatArray, mine: Indices, slopes: FloatArray) -> _Part:
        inner = np.isin(columns, mine)
        informed = inner & (np.any(jacobian != 0.0, axis=0) | (slopes[columns] != 0.0))
        mine, shared = columns[informed], columns[~inner]
        basis, triangle = np.linalg.qr(np.vstack([jacobian[:, informed], np.diag(slopes[mine])]))
        across = np.vstack([jacobian[:, ~inner], np.zeros((mine.size, shared.size))])
        along = basis.T @ across
        rest, wide = np.linalg.qr(across - basis @ along)
        return cls(mine, shared, basis, triangle, along, rest, wide)

    def below(self, place: Indices, n_border: int) -> FloatArray:
        """What is left for the shared parameters, in the columns `place` (n_par,) of the border."""
        block = np.zeros((len(self.wide), n_border))
        block[:, place[self.shared]] = self.wide
        return block


def many(problem: Problem) -> bool:
    """Whether the problem has so many independent groups of runs that its least squares are solved
    run by run.
    """
    return len(problem.groups) > MANY


def own_columns(columns: Sequence[Indices], n_par: int) -> list[Indices]:
    """For each group, given the columns that it uses, the parameters that no other one uses."""
    uses = np.zeros(n_par, dtype=np.int64)
    for used in columns:
        uses[used] += 1
    return [used[uses[used] == 1] for used in columns]


def solve_by_runs(rows: Sequence[Rows], slopes: FloatArray, pulls: FloatArray) -> FloatArray:
    """(n_par, n_target) x of least sum |jacobian x - target|^2 + |slopes x - pulls|^2.

    slopes : (n_par,).  pulls : (n_par, n_target).  A parameter of which nothing is said stays at 0.
    """
    n_par, n_target = pulls.shape
    solution = np.zeros((n_par, n_target))
    own = own_columns([run.columns for run in rows], n_par)
    border = np.setdiff1d(np.arange(n_par), np.concatenate([np.zeros(0, dtype=np.int64), *own]))
    place = np.full(n_par, -1)
    place[border] = np.arange(border.size)
    below, aims, parts = [np.diag(slopes[border])], [pulls[border]], []
    for run, mine in zip(rows, own, strict=True):
        part, n = _Part.of(run.columns, run.jacobian, mine, slopes), len(run.jacobian)
        added = pulls[part.mine]
        below.append(part.below(place, border.size))
        aims.append(part.rest[:n].T @ run.target + part.rest[n:].T @ added)
        parts.append((part, part.basis[:n].T @ run.target + part.basis[n:].T @ added))
    design = np.vstack(below)
    solution[border] = _solved(design, np.vstack(aims))
    for part, aim in parts:
        if part.mine.size:
            solution[part.mine] = _solved(part.triangle, aim - part.along @ solution[part.shared])
    return solution


def spreads_by_runs(
    roots: Sequence[FloatArray], columns: Sequence[Indices], slopes: FloatArray
) -> list[FloatArray]:
    """For each group a root F (n_used, n_used or fewer) of the covariance F F^T of the least
    squares of `solve_by_runs`, between the parameters `columns` that it uses.

    roots : of each group (n, n_used), in units of the standard deviation.  A parameter of which
        nothing is said has no covariance.
    """
    n_par = slopes.size
    own = own_columns(columns, n_par)
    border = np.setdiff1d(np.arange(n_par), np.concatenate([np.zeros(0, dtype=np.int64), *own]))
    place = np.full(n_par, -1)
    place[border] = np.arange(border.size)
    parts = [
        _Part.of(used, root, mine, slopes)
        for used, root, mine in zip(columns, roots, own, strict=True)
    ]
    design = np.vstack(
        [np.diag(slopes[border]), *(part.below(place, border.size) for part in parts)]
    )
    root_of_shared = _inverted(design)
    spreads = []
    for part, used in zip(parts, columns, strict=True):
        turned, of_shared = _inverted(part.triangle), root_of_shared[place[part.shared]]
        own_too = np.hstack([turned, -turned @ part.along @ of_shared])
        follow = np.zeros((used.size, own_too.shape[1]))
        follow[np.isin(used, part.mine)] = own_too
        follow[np.isin(used, part.shared), part.mine.size :] = of_shared
        spreads.append(np.transpose(np.linalg.qr(follow.T, mode="r")))
    return spreads


def _solved(design: FloatArray, aims: FloatArray) -> FloatArray:
    """(n_column, n_target) least squares of a design (n_row, n_column), whatever the units of its
    columns; 0 where nothing is said.
    """
    scale = _lengths(design)
    return np.asarray(np.linalg.lstsq(design / scale, aims, rcond=None)[0] / scale[:, None])


def _inverted(design: FloatArray) -> FloatArray:
    """(n_column, n_row) pseudo-inverse of a design (n_row, n_column), whatever the units of its
    columns.
    """
    scale = _lengths(design)
    return np.asarray(np.linalg.pinv(design / scale, rcond=_NOTHING) / scale[:, None])


def _lengths(design: FloatArray) -> FloatArray:
    """(n_column,) of the columns, 1 where they are nothing."""
    scale = np.linalg.norm(design, axis=0)
    return np.where(scale > 0.0, scale, 1.0)


def inverse_by_runs(matrix: FloatArray, problem: Problem) -> FloatArray | None:
    """(n_par, n_par) inverse of an information matrix (n_par, n_par) of the problem, None where it
    is not positive.
    """
    n_par = len(matrix)
    own = [mine for mine in own_columns(problem.columns, n_par) if mine.size]
    border = np.setdiff1d(np.arange(n_par), np.concatenate([np.zeros(0, dtype=np.int64), *own]))
    core, follow = matrix[np.ix_(border, border)].copy(), np.zeros((n_par, border.size))
    inverse = np.zeros((n_par, n_par))
    try:
        for mine in own:
            block = matrix[np.ix_(mine, mine)]
            np.linalg.cholesky(block)
            inverse[np.ix_(mine, mine)] = np.linalg.inv(block)
            across = matrix[np.ix_(mine, border)]
            follow[mine] = -inverse[np.ix_(mine, mine)] @ across
            core += across.T @ follow[mine]
        root = np.linalg.inv(np.linalg.cholesky(core))
    except np.linalg.LinAlgError:
        return None
    follow[border] = np.eye(border.size)
    turned = follow @ root.T
    return inverse + turned @ turned.T


def descend_by_runs(
    posterior: Posterior, values: FloatArray, free: Sequence[int], *, most: int = _MOST_STEPS
) -> FloatArray:
    """`values` (n_par,) with the parameters `free` where the squared residuals are least, between
    the limits of their priors; after `most` steps.

    Damped Gauss-Newton steps (Levenberg and Marquardt); a parameter that a step would take beyond a
    limit goes to the limit, and the others make the best of it.
    """
    problem = posterior.problem
    low, high = problem.support()
    moving = np.isin(np.arange(problem.n_par), list(free))
    values = np.where(moving, np.clip(values, low, high), values)
    height = _height(posterior, values)
    damping = 0.0
    scale = np.zeros(problem.n_par)
    before = math.inf
    for _ in range(most):
        with np.errstate(all="ignore"):
            pairs = posterior.narrow_scoring(values)
        rows = [
            Rows(columns, np.where(np.isfinite(jacobian), jacobian, 0.0), -residuals[:, None])
            for (jacobian, residuals), columns in zip(pairs, problem.columns, strict=True)
        ]
        slopes, pulls = posterior.prior_slopes(values), posterior.prior_residuals(values)
        scale = np.maximum(scale, _norms(rows, slopes))
        while True:
            step, promise = _step(
                rows, slopes, pulls, np.sqrt(damping) * scale, low - values, high - values, moving
            )
            trial = np.where(moving, np.clip(values + step, low, high), values)
            reached = _height(posterior, trial)
            if reached < height or promise < _ROUNDING * height:
                break
            damping = max(_FACTOR * damping, _LEAST_DAMPING)
            if damping > _MOST_DAMPING:
                return values
        # the sum of squares has no say any more: on while the steps get shorter
        if promise < _ROUNDING * height:
            if not (promise < _SHORTER * before and math.isfinite(reached)):
                break
            before = promise
        damping = damping / _FACTOR if damping > _LEAST_DAMPING else 0.0
        values, height = trial, reached
    return values


def _height(posterior: Posterior, values: FloatArray) -> float:
    """Sum of squared residuals, inf where it is not a number."""
    with np.errstate(all="ignore"):
        named = posterior.problem.named(values[None, :])
        total = sum(
            float(np.sum(likelihood.residuals(named) ** 2)) for likelihood in posterior.likelihoods
        )
        total += float(np.sum(posterior.prior_residuals(values) ** 2))
    return total if math.isfinite(total) else math.inf


def _norms(rows: Sequence[Rows], slopes: FloatArray) -> FloatArray:
    """(n_par,) lengths of the columns."""
    squares = slopes**2
    for run in rows:
        squares[run.columns] += np.sum(run.jacobian**2, axis=0)
    return np.sqrt(squares)


def _step(
    rows: Sequence[Rows],
    slopes: FloatArray,
    pulls: FloatArray,
    damping: FloatArray,
    low: FloatArray,
    high: FloatArray,
    moving: NDArray[np.bool_],
) -> tuple[FloatArray, float]:
    """The step (n_par,) between `low` and `high`, and by how much it promises to lower the sum of
    squares.
    """
    slope = np.hypot(slopes, damping)
    # one row for the prior and the damping of a parameter: the same minimum
    pull = np.divide(-slopes * pulls, slope, out=np.zeros_like(slope), where=slope > 0.0)
    free, step = moving.copy(), np.zeros(slope.size)
    gradient = slopes * pulls
    for run in rows:
        gradient[run.columns] -= run.jacobian.T @ run.target[:, 0]
    free &= ~(((low >= 0.0) & (gradient > 0.0)) | ((high <= 0.0) & (gradient < 0.0)))
    for _ in range(_HELD_ROUNDS):
        held = np.where(free, 0.0, step)
        reduced = [
            Rows(
                run.columns,
                run.jacobian * free[run.columns],
                run.target - run.jacobian @ held[run.columns][:, None],
            )
            for run in rows
        ]
        step = np.where(
            free,
            solve_by_runs(reduced, np.where(free, slope, 0.0), np.where(free, pull, 0.0)[:, None])[
                :, 0
            ],
            held,
        )
        beyond = free & ((step < low) | (step > high))
        if not np.any(beyond):
            break
        step = np.clip(step, low, high)
        free &= ~beyond
    step = np.clip(step, low, high)
    after = sum(
        float(
            np.sum(
                (run.jacobian @ step[run.columns] - run.target[:, 0])
                * (run.jacobian @ step[run.columns])
            )
        )
        for run in rows
    )
    before = -sum(float(run.target[:, 0] @ (run.jacobian @ step[run.columns])) for run in rows)
    after += float(np.sum((slopes * step + pulls) * slopes * step))
    before += float(np.sum(pulls * slopes * step))
    return step, -(after + before)
