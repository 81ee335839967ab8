"""Triangular roots of covariances that hold a few causes beside what the points have each by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtrtrs

from estim.arrays import FloatArray
from estim.problem.roots import Dense, Root

DENSE = 500  # points, up to which one product of whole matrices is faster than many small ones
_BLOCK = 128


@dataclass(frozen=True, eq=False)
class Beside:
    """L = L_base M with M M^T = I + H H^T, H (n_obs, n_cause) what independent causes of unit size do to whitened points.

    M is never written down.  With c the causes given the points before a block, c ~ N(m, P), a block b of points has M_b M_b^T = I + H_b P H_b^T, and
    passes on P H_b^T M_b^-T =: G_b of what is new in it (a Kalman filter whose state stands still).

    causes : H.  parts : M_b, and gains : G_b, (n_cause, n_block), of each block.
    """

    base: Root
    causes: FloatArray
    parts: tuple[FloatArray, ...]
    gains: tuple[FloatArray, ...]

    @classmethod
    def of(cls, base: Root, causes: FloatArray) -> Beside:
        told, parts, gains = np.eye(causes.shape[1]), [], []
        for start in range(0, len(causes), _BLOCK):
            own = causes[start : start + _BLOCK]
            carried = np.linalg.solve(told, own.T)
            parts.append(np.asfortranarray(np.linalg.cholesky(np.eye(len(own)) + own @ carried), dtype=float))
            gains.append(solve_triangular(parts[-1], carried.T, lower=True, check_finite=False).T)
            told = told + own.T @ own  # P^-1: loses no digits where causes are large
        return cls(base, causes, tuple(parts), tuple(gains))

    @property
    def n_obs(self) -> int:
        return len(self.causes)

    @property
    def log_volume(self) -> float:
        return self.base.log_volume + float(sum(np.sum(np.log(np.diag(part))) for part in self.parts))

    @property
    def variances(self) -> FloatArray:
        return np.asarray(self.base.variances + np.sum(self.base.coloured(self.causes.T) ** 2, axis=0))

    @property
    def precisions(self) -> FloatArray:
        lower = np.linalg.cholesky(np.eye(self.causes.shape[1]) + self.causes.T @ self.causes)
        back = solve_triangular(lower, self.base.turned_back(self.causes.T), lower=True, check_finite=False)
        return np.asarray(self.base.precisions - np.sum(back**2, axis=0))

    def whiten(self, rows: FloatArray) -> FloatArray:
        z = np.array(self.base.whiten(rows), dtype=float).reshape(-1, self.n_obs).T
        known = np.zeros((self.causes.shape[1], z.shape[1]))
        for some, own, part, gain in self._blocks():
            z[some] = _solved(part, z[some] - own @ known)
            known += gain @ z[some]
        return np.asarray(z.T.reshape(rows.shape))

    def turned_back(self, rows: FloatArray) -> FloatArray:
        y = np.array(rows, dtype=float).reshape(-1, self.n_obs).T
        later = np.zeros((self.causes.shape[1], y.shape[1]))
        for some, own, part, gain in reversed(self._blocks()):
            y[some] = _solved(part, y[some] - gain.T @ later, transposed=True)
            later += own.T @ y[some]
        return self.base.turned_back(y.T.reshape(rows.shape))

    def coloured(self, rows: FloatArray) -> FloatArray:
        z = np.asarray(rows, dtype=float).reshape(-1, self.n_obs).T
        found, known = np.empty(z.shape), np.zeros((self.causes.shape[1], z.shape[1]))
        for some, own, part, gain in self._blocks():
            found[some] = part @ z[some] + own @ known
            known += gain @ z[some]
        return self.base.coloured(found.T.reshape(rows.shape))

    def times(self, factor: float) -> Beside:
        return Beside(self.base.times(factor), self.causes, self.parts, self.gains)

    def _blocks(self) -> list[tuple[slice, FloatArray, FloatArray, FloatArray]]:
        starts = range(0, self.n_obs, _BLOCK)
        somes = [slice(start, start + _BLOCK) for start in starts]
        return [(some, self.causes[some], part, gain) for some, part, gain in zip(somes, self.parts, self.gains, strict=True)]


def _solved(lower: FloatArray, columns: FloatArray, *, transposed: bool = False) -> FloatArray:
    """The columns (n, m) solved by a triangle, without what `scipy.linalg.solve_triangular` asks of it each time."""
    if not columns.size:  # SciPy's wrapper writes beyond an empty array
        return columns
    return np.asarray(dtrtrs(lower, columns, lower=1, trans=int(transposed))[0])


def beside(base: Root, causes: FloatArray) -> Root:
    """The root of L (I + H H^T) L^T for L of `base` and the causes H (n_obs, n_cause) in whitened points."""
    if causes.shape[1] == 0:
        return base
    if base.n_obs > DENSE:
        return Beside.of(base, causes)
    inner = np.asarray(np.linalg.cholesky(np.eye(base.n_obs) + causes @ causes.T), dtype=float)
    return Dense(base.coloured(inner.T).T)


def with_columns(base: Root, columns: FloatArray) -> Root:
    """The root of C + H H^T for columns H (n_obs, n_cause) in the unit of the points."""
    return beside(base, base.whiten(columns.T).T)
