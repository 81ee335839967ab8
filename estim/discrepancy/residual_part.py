"""What the data show of a deviation: the part of it that the curve cannot compensate for, with its
band.

A deviation shares its level, its slope and whatever else the parameters can imitate with the curve;
how much of that is deviation cannot be determined.  Shown is the rest, the deviation about the
curve that fits it best (least squares over the points, M = 1 - J (J^T C0^-1 J)^-1 J^T C0^-1):

    d_k ~ N(0, a^2 K)
    M d | data, k        normal, the parameters integrated out; a mixture over the components k
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.inferred_force import WithMean, posterior_at
from estim.discrepancy.linearised import Linearised
from estim.discrepancy.scale_mixture import Shape
from estim.problem import Observations


@dataclass(frozen=True, eq=False)
class ResidualPart(WithMean):
    """The part of a deviation that shows, at the points, unit of y.

    x : (n_obs,).
    quantiles : (5, n_obs) at `QUANTILES`.  mean : (n_obs,).
    residuals : (n_obs,) of the curve that fits best.
    """

    x: FloatArray
    quantiles: FloatArray
    mean: FloatArray
    residuals: FloatArray


def find_residual_part(
    linear: Linearised, run: Observations, shapes: Sequence[Shape]
) -> ResidualPart:
    """What shows of the deviation of `run` under the posterior `linear`.  shapes : that its
    components were made of, one for each family.
    """
    whiten = linear.deviation.whiten
    whitener, slopes = whiten(np.eye(run.n_obs)), whiten(linear.jacobian.T)
    # (n_obs, n_obs) M
    rest = np.eye(run.n_obs) - linear.jacobian @ np.linalg.pinv(slopes.T, rcond=1e-10) @ whitener.T
    kernels = [rest @ shape.covariance for shape in shapes]
    posterior = posterior_at(
        linear, [(kernel, np.einsum("ij,ij->i", kernel, rest)) for kernel in kernels]
    )
    return ResidualPart(run.x, posterior.quantiles(), posterior.mean, rest @ linear.residuals)
