"""The force that was found, for a reader: along the track with its band, how large, over what distance, and what it means for c_rr elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.deviation.force import FORCE, Response, Track, force_priors
from estim.deviation.linearised import Linearised, mixture_quantiles

BAND = (0.025, 0.16, 0.5, 0.84, 0.975)
_LOST = 0.01


@dataclass(frozen=True, eq=False)
class Force:
    """A force along the track, in units of the weight, its mean over the track removed (that is part of the rolling resistance).

    x : (n_node,) m or rad.  mean, sd : (n_node,).  quantiles : (5, n_node) at BAND.  All of the way out, where the body also came back.
    back : quantiles of the way back; None where there is none.
    probability : P(a > 0).  amplitude, length : quantiles 0.16, 0.5, 0.84 of the size and the distance over which it changes.
    material_sd : standard deviation of the average over another track of the same kind, which a c_rr as a constant of the material has beside
    its own, at slope 0 (divide by cos phi).
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


def find_force(linearised: Linearised, along: Track, response: Response, *, radius: float | None = None) -> Force:
    """The force under the posterior of `force_shapes`, or the shared one of `shared_force_shapes`; same track and radius.

    response : that of the run, or of all runs stacked (`Response.stacked`).

    Given a component and the parameters p,  f ~ N(a^2 K L^T C^-1 (r - J p), a^2 K - a^4 K L^T C^-1 L K);  p is integrated out.
    """
    deviation = linearised.deviation
    r, j = deviation.whiten(linearised.residuals), deviation.whiten(linearised.jacobian.T).T
    lever = deviation.whiten(response.force.T).T
    order = np.argsort(linearised.weights)[::-1]
    kept = order[: 1 + int(np.searchsorted(np.cumsum(linearised.weights[order]), 1.0 - _LOST))]
    means, sds = np.zeros((kept.size, response.force.shape[1])), np.zeros((kept.size, response.force.shape[1]))
    priors = {(prior.kind, prior.length): prior for prior in force_priors(along, radius=radius)}
    elsewhere = 0.0
    for i, k in enumerate(kept):
        family, place = linearised.component(int(k))
        amplitude, prior = family.amplitude[place], priors.get((family.kind, family.length)) or priors[FORCE, family.length]
        kernel = prior.covariance
        variance = family.scale[place] ** 2 + amplitude**2 * family.spectrum
        gain = amplitude**2 * (kernel @ lever.T) @ family.basis / variance  # (n_node, n_obs) in the family's basis
        means[i] = gain @ (family.basis.T @ (r - j @ linearised.steps[k]))
        parameters = gain @ (family.basis.T @ j)
        spread = amplitude**2 * np.diag(kernel) - np.einsum("ij,ij->i", gain * variance, gain)
        spread += np.einsum("ip,pq,iq->i", parameters, linearised.covariances[k], parameters)
        sds[i] = np.sqrt(np.maximum(spread, 0.0))
        elsewhere += linearised.weights[k] * (amplitude * prior.elsewhere) ** 2
    weights = linearised.weights[kept] / linearised.weights[kept].sum()
    mean = weights @ means
    sd = np.sqrt(np.maximum(weights @ (np.square(sds) + np.square(means - mean)), 0.0))
    quantiles, n = mixture_quantiles(weights, means, sds, BAND), along.nodes.size
    return Force(
        x=along.nodes,
        mean=mean[:n],
        sd=sd[:n],
        quantiles=quantiles[:, :n],
        back=quantiles[:, n:] if along.n_way == 2 else None,
        probability=linearised.p_deviation,
        amplitude=linearised.size("amplitude"),
        length=linearised.size("length"),
        material_sd=float(np.sqrt(elsewhere / linearised.weights[kept].sum())),
    )
