"""Sparse matrices A (n_obs, n_row): what shifts of single readings do to points that are
differences of neighbouring readings.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from estim.arrays import FloatArray, IntArray


def in_rows(columns: IntArray, weights: FloatArray, n_row: int) -> csr_array:
    """A with the weights (n_obs, n_each) at `columns` (n_obs, n_each)."""
    ends = np.arange(0, columns.size + 1, columns.shape[1])
    return csr_array((weights.ravel(), columns.ravel(), ends), shape=(len(columns), n_row))


def used_columns(matrix: csr_array) -> IntArray:
    """Those in which something stands."""
    return np.unique(matrix.indices[matrix.data != 0.0])


def covariance_in_bands(matrix: csr_array, correlation: float = 0.0) -> FloatArray:
    """A R A^T in bands (n_band + 1, n_obs), [d, i] its element (i + d, i), with R_jk =
    correlation^|j - k|; below 1e-14 R counts as 0.

    correlation : between -1 and 1.
    """
    used = used_columns(matrix)
    reach = int(np.log(1e-14) / np.log(abs(correlation))) if correlation else 0
    above = [np.full(used.size, 0.5)]  # a triangle that gives R with its transpose
    for k in range(1, used.size):
        distance = used[k:] - used[:-k]
        if np.min(distance) > reach:
            break
        above.append(np.where(distance <= reach, correlation**distance, 0.0))
    lever = matrix[:, used]
    half = (lever @ diags_array(above, offsets=range(len(above))) @ lever.T).tocoo()
    band, n_obs = np.abs(half.row - half.col), matrix.shape[0]
    position = band * n_obs + np.minimum(half.row, half.col)
    bands = np.zeros((np.max(band) + 1) * n_obs)
    np.add.at(bands, position, half.data)
    bands[:n_obs] *= 2.0
    return bands.reshape(-1, n_obs)
