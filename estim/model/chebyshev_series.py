"""Chebyshev series, many at once: coefficients (n, n_draw), one column for each draw."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

FloatArray = NDArray[Any]


def integral(coefficients: FloatArray) -> FloatArray:
    """Of Chebyshev series (n, n_draw) from -1: (n + 1, n_draw), by  2 int T_k = T_{k+1}/(k + 1) -
    T_{k-1}/(k - 1).
    """
    n = coefficients.shape[0]
    padded = np.concatenate(
        [2.0 * coefficients[:1], coefficients[1:], np.zeros((2, coefficients.shape[1]))]
    )
    order = np.arange(1, n + 1)[:, None]
    rest = (padded[:n] - padded[2:]) / (2.0 * order)
    return np.concatenate([-np.sum(np.where(order % 2, -rest, rest), axis=0, keepdims=True), rest])


def cosine_transform(values: FloatArray) -> FloatArray:
    """sum_k values[:, k] cos(pi m (k + 1/2)/n) for m = 0 .. n - 1, by one FFT of twice the
    length.
    """
    n = values.shape[1]
    spectrum = np.fft.rfft(np.concatenate([values, values[:, ::-1]], axis=1), axis=1)[:, :n]
    return np.real(0.5 * np.exp(-0.5j * np.pi * np.arange(n) / n) * spectrum)


def evaluate(z: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Chebyshev series of each draw at its own z: z (n_draw, n_obs), coefficients (n, n_draw) ->
    (n_draw, n_obs).
    """
    return chebyshev.chebval(z.T, coefficients[:, None, :], tensor=False).T
