"""Cholesky factors of covariances, round-off included."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray


def lower_factor(cov: FloatArray) -> FloatArray:
    """Lower Cholesky factors of covariances (..., n, n); directions without any variance get a
    millionth of the others'.
    """
    sds = np.sqrt(np.maximum(np.diagonal(cov, axis1=-2, axis2=-1), 0.0))
    sds = np.where(sds > 0.0, sds, 1e-6 * np.maximum(np.max(sds, axis=-1, keepdims=True), 1e-140))
    values, vectors = np.linalg.eigh(cov / (sds[..., :, None] * sds[..., None, :]))
    root = vectors * np.sqrt(np.maximum(values, 1e-10))[..., None, :]
    # R of the QR decomposition of root^T is a Cholesky factor even where round-off spoils the
    # matrix itself
    upper = np.linalg.qr(np.swapaxes(root, -1, -2), mode="r")
    lower = (
        np.swapaxes(upper, -1, -2) * np.sign(np.diagonal(upper, axis1=-2, axis2=-1))[..., None, :]
    )
    return sds[..., :, None] * lower
