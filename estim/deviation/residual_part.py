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
from estim.deviation.inferred_force import see
from estim.deviation.kernels import distances, exponential, matern32
from estim.deviation.linearised import Linearised
from estim.problem import Observations


@dataclass(frozen=True, eq=False)
class ResidualPart:
    """The part of a deviation that shows, at the points, unit of y.

    x : (n_obs,).
    quantiles : (5, n_obs) at `LEVELS`.  mean : (n_obs,).
    residuals : (n_obs,) of the curve that fits best.
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
    whiten, lacks = linear.deviation.whiten, run.lacks
    assert lacks is not None, "asked of runs that may lack something"
    rest = _rest(whiten(np.eye(run.n_obs)), whiten(linear.jacobian.T), linear.jacobian)
    along = run.x if lacks.along is None else lacks.along
    seen = see(
        linear,
        (
            _prior(family, run.x if family.kind == DEVIATION else along, scales, rest)
            for family in linear.deviation.families
        ),
    )
    return ResidualPart(
        run.x, seen.quantiles(), np.asarray(seen.weights @ seen.means), rest @ linear.residuals
    )


def _rest(whitener: FloatArray, j: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(n_obs, n_obs) M; whitener: W as rows, j: (n_par, n_obs) whitened."""
    return np.asarray(
        np.eye(jacobian.shape[0]) - jacobian @ np.linalg.pinv(j.T, rcond=1e-10) @ whitener.T
    )


def _prior(
    family: Family, along: FloatArray, scales: Mapping[str, float], rest: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """M K (n_obs, n_obs) and the diagonal of M K M^T (n_obs,) for unit amplitude."""
    correlation = matern32 if family.kind == DEVIATION else exponential
    kernel = rest @ (scales[family.kind] ** 2 * correlation(distances(along), family.length))
    return kernel, np.einsum("ij,ij->i", kernel, rest)
