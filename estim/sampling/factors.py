"""Cholesky factors of covariances, round-off included."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray


def lower_factor(cov: FloatArray) -> FloatArray:
    """Lower Cholesky factor of a covariance; directions without any variance get a millionth of the others'."""
    sds = np.sqrt(np.maximum(np.diag(cov), 0.0))
    sds = np.where(sds > 0.0, sds, 1e-6 * max(float(np.max(sds)), 1e-140))
    values, vectors = np.linalg.eigh(cov / np.outer(sds, sds))
    root = vectors * np.sqrt(np.maximum(values, 1e-10))
    # R of the QR decomposition of root^T is a Cholesky factor even where round-off spoils the matrix itself
    upper = np.asarray(np.linalg.qr(root.T, mode="r"))
    lower = upper.T * np.sign(np.diag(upper))
    return np.asarray(sds[:, None] * lower)
