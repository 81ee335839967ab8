"""The force that was found, for a reader: along the track with its band, how large, over what
distance, and what it means for c_rr elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.deviation.force import FORCE, Response, Track, force_kernel, force_priors
from estim.deviation.linearised import Linearised, mixture_quantiles

BAND = (0.025, 0.16, 0.5, 0.84, 0.975)
_LOST = 0.01


@dataclass(frozen=True, eq=False)
class Force:
    """A force along the track, in units of the weight, its mean over the track removed (that is
    part of the rolling resistance).

    x : (n_node,) m or rad.
    mean, sd : (n_node,).  quantiles : (5, n_node) at BAND.  All of the way out, where the body also
        came back.
    back : quantiles of the way back; None where there is none.
    probability : P(a > 0).
    amplitude, length : quantiles 0.16, 0.5, 0.84 of the size and the distance over which it
        changes.
    material_sd : standard deviation of the average over another track of the same kind, which a
        c_rr as a constant of the material has beside its own, at slope 0 (divide by cos phi).
    """

    x: FloatArray
    mean: FloatArray
    sd: FloatArray
    quantiles: FloatArray
    back: FloatArray | None
    probability: float
    amplitude: tuple[float, float, float]
    length: tuple[float, float, float]
    material_sd: float

    @property
    def typical(self) -> float:
        """Root mean square of the mean along the track."""
        return float(np.sqrt(np.mean(np.square(self.mean))))

    @property
    def most(self) -> float:
        """Largest size of the mean."""
        return float(np.max(np.abs(self.mean)))


def find_force(
    linearised: Linearised, along: Track, response: Response, *, radius: float | None = None
) -> Force:
    """The force under the posterior of `force_shapes`, or the shared one of `shared_force_shapes`;
    same track and radius.

    response : that of the run, or of all runs stacked (`Response.stacked`).
    """
    families = linearised.deviation.families
    every = {(prior.kind, prior.length): prior for prior in force_priors(along, radius=radius)}
    priors = [every.get((f.kind, f.length)) or every[FORCE, f.length] for f in families]
    seen = _seen(linearised, response, [prior.covariance for prior in priors])
    sizes = [
        (f.amplitude * prior.elsewhere) ** 2 for f, prior in zip(families, priors, strict=True)
    ]
    elsewhere = float(seen.weights @ np.concatenate(sizes)[seen.kept])
    mean, sd = seen.mean_and_sd()
    quantiles, n = mixture_quantiles(seen.weights, seen.means, seen.sds, BAND), along.nodes.size
    return Force(
        x=along.nodes,
        mean=mean[:n],
        sd=sd[:n],
        quantiles=quantiles[:, :n],
        back=quantiles[:, n:] if along.n_way == 2 else None,
        probability=linearised.p_deviation,
        amplitude=linearised.size("amplitude"),
        length=linearised.size("length"),
        material_sd=float(np.sqrt(elsewhere)),
    )


@dataclass(frozen=True, eq=False)
class OwnForce:
    """What the force of one run adds to the one that runs share, in units of the weight.

    x : (n_node,) m or rad, to the end of the run.  mean, sd : (n_node,).
    """

    run: str
    x: FloatArray
    mean: FloatArray
    sd: FloatArray


def find_own_force(
    linearised: Linearised,
    along: Track,
    response: Response,
    *,
    run: str,
    end: float,
    ratios: Sequence[float],
    radius: float | None = None,
) -> OwnForce:
    """The own force of one run under the posterior of `shared_force_shapes`.

    response : that of the run, rows of 0 where other runs are stacked.  end : where the run ends.
    ratios : of its amplitude to that of the shared one, one for each family.
    """
    families = linearised.deviation.families
    kernels = {f.length: force_kernel(along, f.length, radius=radius) for f in families}
    seen = _seen(
        linearised,
        response,
        [ratio**2 * kernels[f.length] for f, ratio in zip(families, ratios, strict=True)],
    )
    reached = along.nodes <= end
    mean, sd = seen.mean_and_sd()
    return OwnForce(run, along.nodes[reached], mean[reached], sd[reached])


@dataclass(frozen=True, eq=False)
class _Seen:
    """A force at the nodes given each of the probable components, with the parameters p integrated
    out.

    f | k ~ N(a^2 K L^T C^-1 (r - J p), a^2 K - a^4 K L^T C^-1 L K)

    kept : (n_kept,) components.  weights : (n_kept,) of sum 1.  means, sds : (n_kept, n_node).
    """

    kept: NDArray[np.int64]
    weights: FloatArray
    means: FloatArray
    sds: FloatArray

    def mean_and_sd(self) -> tuple[FloatArray, FloatArray]:
        """(n_node,) of the mixture."""
        mean = self.weights @ self.means
        return mean, np.sqrt(
            np.maximum(self.weights @ (np.square(self.sds) + np.square(self.means - mean)), 0.0)
        )


def _seen(linearised: Linearised, response: Response, kernels: Sequence[FloatArray]) -> _Seen:
    """kernels : covariance (n_node, n_node) of the force for unit amplitude, one for each
    family.
    """
    deviation = linearised.deviation
    r, j = deviation.whiten(linearised.residuals), deviation.whiten(linearised.jacobian.T).T
    lever = deviation.whiten(response.force.T).T
    components = linearised.probable(1.0 - _LOST)
    means, sds = [], []
    members = deviation.each(np.arange(linearised.weights.size))
    for (family, every), kernel in zip(members, kernels, strict=True):
        here = np.flatnonzero(np.isin(every, components))
        if here.size:
            reach = (kernel @ lever.T) @ family.basis
            seen = family.basis.T @ r
            turned = family.basis.T @ j
        for k in here:
            square = family.amplitude[k] ** 2
            variance = family.scale[k] ** 2 + square * family.spectrum
            gain = square * reach / variance  # (n_node, n_dir)
            parameters = gain @ turned
            spread = square * np.diag(kernel) - np.einsum("ij,ij->i", gain * variance, gain)
            covariance = linearised.covariances[every[k]]
            spread += np.einsum("ip,pq,iq->i", parameters, covariance, parameters)
            means.append(gain @ (seen - turned @ linearised.steps[every[k]]))
            sds.append(np.sqrt(np.maximum(spread, 0.0)))
    return _Seen(
        components,
        linearised.weights[components] / linearised.weights[components].sum(),
        np.array(means),
        np.array(sds),
    )
