"""Triangular roots L of covariances C = L L^T, without the matrix where it is large.

`BandedFactor` where only neighbours are correlated: independent points, speeds made of neighbouring
positions.  `LowRankRoot` where a few causes move all points beside that: an error of the clock, a
push at the start, a force along the track.  `Dense` for any other matrix, and for few points, where
one product of matrices is faster than many small ones.  `Stacked` for runs below each other.

L is the same triangle in each: whitened residuals stand in the order of the points, each what is
new in a point given those before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import cholesky_banded, solve_triangular
from scipy.linalg.lapack import dtbtrs, dtrtrs

from estim.arrays import FloatArray

DENSE = 500  # points, up to which one product of whole matrices is faster than many small ones
_BLOCK = 128  # points
_ROWS = 512


class Root(Protocol):
    """L (n_obs, n_obs).  Rows are (..., n_obs)."""

    @property
    def n_obs(self) -> int: ...

    @property
    def log_volume(self) -> float:
        """Half the logarithm of the determinant of C."""

    @property
    def variances(self) -> FloatArray:
        """(n_obs,) diagonal of C."""

    @property
    def precisions(self) -> FloatArray:
        """(n_obs,) diagonal of C^-1."""

    def whiten(self, rows: FloatArray) -> FloatArray:
        """L^-1 r of each row r."""

    def turned_back(self, rows: FloatArray) -> FloatArray:
        """L^-T r of each row r: what is a slope in whitened points as a slope in the points."""

    def coloured(self, rows: FloatArray) -> FloatArray:
        """L r of each row r."""

    def times(self, factor: float) -> Root:
        """factor L."""


def covariance_of(root: Root) -> FloatArray:
    """C (n_obs, n_obs), for few points."""
    rows = root.coloured(np.eye(root.n_obs))
    return rows.T @ rows


@dataclass(frozen=True, eq=False)
class Dense:
    """lower : L."""

    lower: FloatArray

    @classmethod
    def of(cls, covariance: FloatArray) -> Dense:
        """Raises LinAlgError where it is not positive definite."""
        return cls(np.asarray(np.linalg.cholesky(covariance), dtype=float))

    @property
    def n_obs(self) -> int:
        return len(self.lower)

    @property
    def log_volume(self) -> float:
        return float(np.sum(np.log(np.diag(self.lower))))

    @property
    def variances(self) -> FloatArray:
        return np.sum(self.lower**2, axis=1)

    @property
    def precisions(self) -> FloatArray:
        return np.sum(self._whitener**2, axis=1)

    @cached_property
    def _whitener(self) -> FloatArray:
        """L^-T."""
        return np.ascontiguousarray(solve_triangular(self.lower, np.eye(self.n_obs), lower=True).T)

    def whiten(self, rows: FloatArray) -> FloatArray:
        return rows @ self._whitener

    def turned_back(self, rows: FloatArray) -> FloatArray:
        return rows @ self._whitener.T

    def coloured(self, rows: FloatArray) -> FloatArray:
        return rows @ self.lower.T

    def times(self, factor: float) -> Dense:
        return Dense(factor * self.lower)


@dataclass(frozen=True, eq=False)
class BandedFactor:
    """lower : (n_band + 1, n_obs), [d, i] the element (i + d, i) of L."""

    lower: FloatArray

    @classmethod
    def of(cls, bands: FloatArray) -> BandedFactor:
        """Of a covariance in bands (n_band + 1, n_obs); one that rounding leaves indefinite is
        lifted by as much.  Raises LinAlgError.
        """
        if len(bands) == 1:
            if not np.all(bands > 0.0):
                raise np.linalg.LinAlgError("must be positive definite")
            return cls(np.sqrt(bands))
        try:
            return cls(cholesky_banded(bands, lower=True))
        except np.linalg.LinAlgError:
            lifted = bands.copy()
            lifted[0] += 4.0 * np.finfo(float).eps * bands.shape[1] * np.max(bands[0])
            return cls(cholesky_banded(lifted, lower=True))

    @property
    def n_obs(self) -> int:
        return self.lower.shape[1]

    @property
    def log_volume(self) -> float:
        return float(np.sum(np.log(self.lower[0])))

    @property
    def variances(self) -> FloatArray:
        diagonal = np.zeros(self.n_obs)
        for d, band in enumerate(self.lower):
            diagonal[d:] += band[: self.n_obs - d] ** 2
        return diagonal

    @property
    def precisions(self) -> FloatArray:
        if len(self.lower) == 1:
            return 1.0 / self.lower[0] ** 2
        diagonal = np.empty(self.n_obs)
        for start in range(0, self.n_obs, _ROWS):
            block = np.arange(start, min(start + _ROWS, self.n_obs))
            single = np.zeros((block.size, self.n_obs))
            single[np.arange(block.size), block] = 1.0
            diagonal[block] = np.sum(self.whiten(single) ** 2, axis=1)
        return diagonal

    def whiten(self, rows: FloatArray) -> FloatArray:
        return self._solved(rows, "N")

    def turned_back(self, rows: FloatArray) -> FloatArray:
        return self._solved(rows, "T")

    def _solved(self, rows: FloatArray, trans: str) -> FloatArray:
        if len(self.lower) == 1:
            return rows / self.lower[0]
        flat = np.asarray(rows, dtype=float).reshape(-1, self.n_obs)
        if not flat.size:  # SciPy's wrapper writes beyond an empty array
            return flat.reshape(rows.shape)
        # (n_obs, n) in the order of Fortran: no copy but the one it solves in
        solution, _ = dtbtrs(self.lower, flat.T, uplo="L", trans=trans)
        return solution.T.reshape(rows.shape)

    def coloured(self, rows: FloatArray) -> FloatArray:
        product = rows * self.lower[0]
        for d in range(1, len(self.lower)):
            product[..., d:] += rows[..., :-d] * self.lower[d, :-d]
        return product

    def times(self, factor: float) -> BandedFactor:
        return BandedFactor(factor * self.lower)


@dataclass(frozen=True, eq=False)
class LowRankRoot:
    """L = L_base M with M M^T = I + H H^T, H (n_obs, n_cause) what independent causes of unit size
    do to whitened points.

    M is never written down.  With c the causes given the points before a block, c ~ N(m, P), a
    block b of points has M_b M_b^T = I + H_b P H_b^T, and passes on P H_b^T M_b^-T =: G_b of what
    is new in it (a Kalman filter whose state stands still).

    causes : H.  parts : M_b, and gains : G_b, (n_cause, n_block), of each block.
    """

    base: Root
    causes: FloatArray
    parts: tuple[FloatArray, ...]
    gains: tuple[FloatArray, ...]

    @classmethod
    def of(cls, base: Root, causes: FloatArray) -> LowRankRoot:
        information, parts, gains = np.eye(causes.shape[1]), [], []
        for start in range(0, len(causes), _BLOCK):
            block = causes[start : start + _BLOCK]
            carried = np.linalg.solve(information, block.T)
            parts.append(
                np.asfortranarray(
                    np.linalg.cholesky(np.eye(len(block)) + block @ carried), dtype=float
                )
            )
            gains.append(solve_triangular(parts[-1], carried.T, lower=True, check_finite=False).T)
            information = (
                information + block.T @ block
            )  # P^-1: loses no digits where causes are large
        return cls(base, causes, tuple(parts), tuple(gains))

    @property
    def n_obs(self) -> int:
        return len(self.causes)

    @property
    def log_volume(self) -> float:
        return self.base.log_volume + float(
            sum(np.sum(np.log(np.diag(part))) for part in self.parts)
        )

    @property
    def variances(self) -> FloatArray:
        return self.base.variances + np.sum(self.base.coloured(self.causes.T) ** 2, axis=0)

    @property
    def precisions(self) -> FloatArray:
        lower = np.linalg.cholesky(np.eye(self.causes.shape[1]) + self.causes.T @ self.causes)
        solved = solve_triangular(
            lower, self.base.turned_back(self.causes.T), lower=True, check_finite=False
        )
        return self.base.precisions - np.sum(solved**2, axis=0)

    def whiten(self, rows: FloatArray) -> FloatArray:
        z = np.array(self.base.whiten(rows), dtype=float).reshape(-1, self.n_obs).T
        known = np.zeros((self.causes.shape[1], z.shape[1]))
        for block, causes, part, gain in self._blocks():
            z[block] = _solved(part, z[block] - causes @ known)
            known += gain @ z[block]
        return z.T.reshape(rows.shape)

    def turned_back(self, rows: FloatArray) -> FloatArray:
        y = np.array(rows, dtype=float).reshape(-1, self.n_obs).T
        later = np.zeros((self.causes.shape[1], y.shape[1]))
        for block, causes, part, gain in reversed(self._blocks()):
            y[block] = _solved(part, y[block] - gain.T @ later, transposed=True)
            later += causes.T @ y[block]
        return self.base.turned_back(y.T.reshape(rows.shape))

    def coloured(self, rows: FloatArray) -> FloatArray:
        z = np.asarray(rows, dtype=float).reshape(-1, self.n_obs).T
        product, known = np.empty(z.shape), np.zeros((self.causes.shape[1], z.shape[1]))
        for block, causes, part, gain in self._blocks():
            product[block] = part @ z[block] + causes @ known
            known += gain @ z[block]
        return self.base.coloured(product.T.reshape(rows.shape))

    def times(self, factor: float) -> LowRankRoot:
        return LowRankRoot(self.base.times(factor), self.causes, self.parts, self.gains)

    def _blocks(self) -> list[tuple[slice, FloatArray, FloatArray, FloatArray]]:
        starts = range(0, self.n_obs, _BLOCK)
        somes = [slice(start, start + _BLOCK) for start in starts]
        return [
            (block, self.causes[block], part, gain)
            for block, part, gain in zip(somes, self.parts, self.gains, strict=True)
        ]


def _solved(lower: FloatArray, columns: FloatArray, *, transposed: bool = False) -> FloatArray:
    """The columns (n, m) solved by a triangle, without what `scipy.linalg.solve_triangular` checks
    of it each time.
    """
    if not columns.size:  # SciPy's wrapper writes beyond an empty array
        return columns
    return dtrtrs(lower, columns, lower=1, trans=int(transposed))[0]


def beside(base: Root, causes: FloatArray) -> Root:
    """The root of L (I + H H^T) L^T for L of `base` and the causes H (n_obs, n_cause) in whitened
    points.
    """
    if causes.shape[1] == 0:
        return base
    if base.n_obs > DENSE:
        return LowRankRoot.of(base, causes)
    inner = np.asarray(np.linalg.cholesky(np.eye(base.n_obs) + causes @ causes.T), dtype=float)
    return Dense(base.coloured(inner.T).T)


def with_columns(base: Root, columns: FloatArray) -> Root:
    """The root of C + H H^T for columns H (n_obs, n_cause) in the unit of the points."""
    return beside(base, base.whiten(columns.T).T)


@dataclass(frozen=True, eq=False)
class Stacked:
    """Runs below each other, each with its own root."""

    parts: tuple[Root, ...]

    @property
    def n_obs(self) -> int:
        return sum(part.n_obs for part in self.parts)

    @property
    def log_volume(self) -> float:
        return sum(part.log_volume for part in self.parts)

    @property
    def variances(self) -> FloatArray:
        return np.concatenate([part.variances for part in self.parts])

    @property
    def precisions(self) -> FloatArray:
        return np.concatenate([part.precisions for part in self.parts])

    def whiten(self, rows: FloatArray) -> FloatArray:
        return np.concatenate([part.whiten(block) for part, block in self._each(rows)], axis=-1)

    def turned_back(self, rows: FloatArray) -> FloatArray:
        return np.concatenate(
            [part.turned_back(block) for part, block in self._each(rows)], axis=-1
        )

    def coloured(self, rows: FloatArray) -> FloatArray:
        return np.concatenate([part.coloured(block) for part, block in self._each(rows)], axis=-1)

    def times(self, factor: float) -> Stacked:
        return Stacked(tuple(part.times(factor) for part in self.parts))

    def _each(self, rows: FloatArray) -> list[tuple[Root, FloatArray]]:
        ends = np.cumsum([part.n_obs for part in self.parts])[:-1]
        return list(zip(self.parts, np.split(rows, ends, axis=-1), strict=True))


def stacked_root(roots: Sequence[Root]) -> Root:
    """Of runs below each other."""
    return roots[0] if len(roots) == 1 else Stacked(tuple(roots))


def root_of(covariance: FloatArray) -> Root:
    """Of variances (n_obs,) or a covariance (n_obs, n_obs).  Raises LinAlgError where it is not
    positive definite.
    """
    return BandedFactor.of(covariance[None, :]) if covariance.ndim == 1 else Dense.of(covariance)
