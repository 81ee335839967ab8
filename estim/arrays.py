"""The types of arrays that annotations use, and what is often tested of arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Named = Mapping[str, float | FloatArray]
"""Parameter or argument -> its value, or a column (n_draw, 1) of draws."""


def all_finite(*arrays: ArrayLike) -> bool:
    """Whether every number of the arrays is finite."""
    return all(bool(np.isfinite(array).all()) for array in arrays)


def bisected(
    beyond: Callable[[FloatArray], BoolArray], low: FloatArray, high: FloatArray, n: int
) -> FloatArray:
    """The places between low and high from which on values are `beyond` something, after `n`
    halvings; where none is, high.
    """
    for _ in range(n):
        middle = 0.5 * (low + high)
        over = beyond(middle)
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return high


def diagonal_scale(matrix: FloatArray) -> FloatArray:
    """(n,) units in which the diagonal of a matrix (n, n) is 1, of covariances or of information; 1
    where it is next to nothing.
    """
    diagonal = np.diag(matrix)
    # the inverse of less could not be squared
    return np.sqrt(np.where(diagonal > 1e-200, diagonal, 1.0))


def inverse_of(information: FloatArray, *, rcond: float = 1e-15) -> FloatArray:
    """(n, n) inverse of an information matrix, of what it says something of, whatever the units of
    its parameters.  rcond : relative to the largest, eigenvalues that count as zero.
    """
    unit = diagonal_scale(information)
    units = np.outer(unit, unit)
    return np.linalg.pinv(information / units, rcond=rcond, hermitian=True) / units


def finite_or(values: ArrayLike, otherwise: ArrayLike) -> FloatArray:
    """`values`, with `otherwise` in place of those that are not finite; no copy where all are."""
    finite = np.isfinite(values)
    return np.asarray(values) if finite.all() else np.where(finite, values, otherwise)


def in_blocks(
    compute: Callable[[NDArray[Any]], FloatArray], rows: NDArray[Any], size: int
) -> FloatArray:
    """What `compute` makes of rows (n, ...), (n, ...), `size` of them at a time: what it needs
    stays small.
    """
    return np.concatenate(
        [compute(rows[k : k + size]) for k in range(0, max(len(rows), 1), max(size, 1))]
    )


def log_sum_exp(terms: FloatArray, axis: int | None = None) -> FloatArray:
    """log sum exp without overflow; -inf where all terms are.  Several times faster than those of
    NumPy and SciPy.
    """
    largest = np.max(terms, axis=axis, keepdims=True)
    safe = finite_or(largest, 0.0)
    with np.errstate(divide="ignore"):
        total = np.log(np.sum(np.exp(terms - safe), axis=axis, keepdims=True)) + safe
    return np.squeeze(total, axis=axis)


def max_abs(array: ArrayLike) -> float:
    """The largest absolute value."""
    return float(np.max(np.abs(array)))


def positive_or(values: FloatArray, otherwise: float) -> FloatArray:
    """`values`, with `otherwise` in place of those that are not above 0."""
    return np.where(values > 0.0, values, otherwise)


def root_mean_square(values: ArrayLike) -> float:
    """The root of the mean of the squares."""
    return float(np.sqrt(np.mean(np.square(values))))


def sds_of(covariance: FloatArray) -> FloatArray:
    """(n,) standard deviations of a covariance (n, n)."""
    return np.sqrt(np.diag(covariance))


def squared_rows(rows: FloatArray) -> FloatArray:
    """(n, k, k) the outer product of each of the rows (n, k) with itself."""
    return rows[:, :, None] * rows[:, None, :]
