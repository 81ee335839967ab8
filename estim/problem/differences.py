"""A matrix whose rows hold a few numbers each: what shifts of single readings do to points that are
differences of neighbouring readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Differences:
    """A (n_obs, n_row).  places, weights : (n_obs, n_each), A[i, places[i, k]] is the sum of the
    weights[i, k] that stand there.
    """

    places: IntArray
    weights: FloatArray
    n_row: int

    @classmethod
    def of_single(cls, n_obs: int) -> Differences:
        """The readings themselves."""
        return cls(np.arange(n_obs)[:, None], np.ones((n_obs, 1)), n_obs)

    def __matmul__(self, columns: FloatArray) -> FloatArray:
        """A times (n_row,) or (n_row, n)."""
        shape = (-1,) + (1,) * (columns.ndim - 1)
        return np.asarray(
            sum(
                self.weights[:, k].reshape(shape) * columns[self.places[:, k]]
                for k in range(self.places.shape[1])
            )
        )

    def back(self, columns: FloatArray) -> FloatArray:
        """A^T times (n_obs, n): (n_row, n)."""
        product = np.zeros((self.n_row, columns.shape[1]))
        for k in range(self.places.shape[1]):
            np.add.at(product, self.places[:, k], self.weights[:, k, None] * columns)
        return product

    def dense(self) -> FloatArray:
        """(n_obs, n_row)."""
        matrix = np.zeros((len(self.places), self.n_row))
        np.add.at(matrix, (np.arange(len(self.places))[:, None], self.places), self.weights)
        return matrix

    def of(self, kept: IntArray) -> Differences:
        """Some of the rows."""
        return replace(self, places=self.places[kept], weights=self.weights[kept])

    def among(self, used: BoolArray) -> Differences:
        """A without the other columns, in which nothing may stand."""
        place = np.cumsum(used) - 1
        return Differences(np.where(used, place, 0)[self.places], self.weights, int(np.sum(used)))

    def less(self, at: IntArray, slope: FloatArray) -> Differences:
        """A less slope (n_obs,) in the columns `at` (n_obs,)."""
        return replace(
            self,
            places=np.column_stack([self.places, at]),
            weights=np.column_stack([self.weights, -slope]),
        )

    def times(self, relative: FloatArray) -> Differences:
        """A diag(relative), relative (n_row,)."""
        return replace(self, weights=self.weights * relative[self.places])

    def rows_times(self, factor: FloatArray) -> Differences:
        """diag(factor) A, factor (n_obs,)."""
        return replace(self, weights=self.weights * factor[:, None])

    @property
    def used(self) -> BoolArray:
        """(n_row,) columns in which something stands."""
        mask = np.zeros(self.n_row, dtype=bool)
        mask[self.places[self.weights != 0.0]] = True
        return mask

    def covariance(self, correlation: float = 0.0) -> FloatArray:
        """A R A^T in bands (n_band + 1, n_obs), [d, i] its element (i + d, i), with R_jk =
        correlation^|j - k|; below 1e-14 R counts as 0.

        correlation : between -1 and 1.

        Rows must stand in the order of their places.
        """
        n, bands = len(self.places), []
        reach = int(np.log(1e-14) / np.log(abs(correlation))) if correlation else 0
        first = np.min(self.places, axis=1)
        last = np.maximum.accumulate(np.max(self.places, axis=1))
        powers = np.append(correlation ** np.arange(reach + 1), 0.0)
        for d in range(n):
            if d and not np.any(first[d:] <= last[: n - d] + reach):
                break
            apart = np.abs(self.places[d:, :, None] - self.places[: n - d, None, :])
            bands.append(np.zeros(n))
            bands[-1][: n - d] = np.einsum(
                "ia,iab,ib->i",
                self.weights[d:],
                powers[np.minimum(apart, reach + 1)],
                self.weights[: n - d],
            )
        return np.array(bands)
