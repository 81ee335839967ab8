"""What the data show of a deviation: the part of it that the curve cannot make up for, with its
band.

A deviation shares its level, its slope and whatever else the parameters can imitate with the curve;
how much of that is deviation nothing can tell.  Shown is the rest, the deviation about the curve
that fits it best (least squares over the points, M = 1 - J (J^T C0^-1 J)^-1 J^T C0^-1):

    d_k ~ N(0, a^2 K),    M d | data, k  normal, the parameters integrated out;    a mixture over
    the components k
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.deviation.components import Family
from estim.deviation.generic import DEVIATION
from estim.deviation.inferred_force import BAND
from estim.deviation.kernels import distances, exponential, matern32
from estim.deviation.linearised import Linearised, mixture_quantiles
from estim.problem import Observations

_LOST = 0.01


@dataclass(frozen=True, eq=False)
class ResidualPart:
    """The part of a deviation that shows, at the points, unit of y.

    x : (n_obs,).
    quantiles : (5, n_obs) at BAND.  mean : (n_obs,).  residuals : (n_obs,) of the curve that fits
        best.
    """

    x: FloatArray
    quantiles: FloatArray
    mean: FloatArray
    residuals: FloatArray

    @property
    def typical(self) -> float:
        """Root mean square of the mean."""
        return float(np.sqrt(np.mean(np.square(self.mean))))

    @property
    def most(self) -> float:
        """Largest size of the mean."""
        return float(np.max(np.abs(self.mean)))


def see_deviation(
    linear: Linearised, run: Observations, scales: Mapping[str, float]
) -> ResidualPart:
    """What shows of the deviation of `run` under the posterior `linear`.  scales : kind -> unit of
    its amplitudes.
    """
    deviation = linear.deviation
    j = deviation.whiten(linear.jacobian.T)  # (n_par, n_obs) whitened
    rest = _rest(deviation.whiten(np.eye(run.n_obs)), j, linear.jacobian)
    r = deviation.whiten(linear.residuals)
    components = linear.probable(1.0 - _LOST)
    lacks = run.lacks
    assert lacks is not None, "asked of runs that may lack something"
    means = np.zeros((linear.weights.size, run.n_obs))
    sds = np.zeros((linear.weights.size, run.n_obs))
    for family, every in deviation.each(np.arange(linear.weights.size)):
        place = np.flatnonzero(np.isin(every, components))
        members = every[place]
        along = run.x if family.kind == DEVIATION or lacks.along is None else lacks.along
        kernel, prior = _seen(family, along, scales, rest)
        seen = deviation.whiten(kernel) @ family.basis  # (n_obs, n_dir)
        precision = 1.0 / family.variances()[place]
        square = np.square(family.amplitude[place])[:, None]
        off, turned = (r - linear.steps[members] @ j) @ family.basis, j @ family.basis
        means[members] = square * ((off * precision) @ seen.T)
        moved = square[:, :, None] * np.einsum(
            "id,kd,pd->kip", seen, precision, turned, optimize=True
        )
        spread = square * prior - np.square(square) * (precision @ np.square(seen).T)
        sds[members] = np.sqrt(
            np.maximum(
                spread
                + np.einsum(
                    "kip,kpq,kiq->ki", moved, linear.covariances[members], moved, optimize=True
                ),
                0.0,
            )
        )
    means, sds = means[components], sds[components]
    weights = linear.weights[components] / linear.weights[components].sum()
    return ResidualPart(
        run.x,
        mixture_quantiles(weights, means, sds, BAND),
        np.asarray(weights @ means),
        rest @ linear.residuals,
    )


def _rest(whitener: FloatArray, j: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(n_obs, n_obs) M; whitener: W as rows, j: (n_par, n_obs) whitened."""
    return np.asarray(
        np.eye(jacobian.shape[0]) - jacobian @ np.linalg.pinv(j.T, rcond=1e-10) @ whitener.T
    )


def _seen(
    family: Family, along: FloatArray, scales: Mapping[str, float], rest: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """M K (n_obs, n_obs) and the diagonal of M K M^T (n_obs,) for unit amplitude."""
    correlation = matern32 if family.kind == DEVIATION else exponential
    kernel = rest @ (scales[family.kind] ** 2 * correlation(distances(along), family.length))
    return kernel, np.einsum("ij,ij->i", kernel, rest)
