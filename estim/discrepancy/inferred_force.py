"""The force that was found, for a reader: along the track with its band, how large, over what
distance, and what it means for c_rr elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, IntArray, max_abs, root_mean_square
from estim.common import QUANTILES
from estim.discrepancy.force import FORCE, ForceTrack, Response, force_kernel, force_priors
from estim.discrepancy.linearised import Linearised, mixture_quantiles

_NEGLECTED = 0.01


class WithMean:
    """What has a mean at each of some places."""

    mean: FloatArray

    @property
    def typical(self) -> float:
        """Root mean square of the mean."""
        return root_mean_square(self.mean)

    @property
    def most(self) -> float:
        """Largest size of the mean."""
        return max_abs(self.mean)


@dataclass(frozen=True, eq=False)
class Force(WithMean):
    """A force along the track, in units of the weight, its mean over the track removed (that is
    part of the rolling resistance).

    x : (n_node,) m or rad.
    mean : (n_node,).
    quantiles : (5, n_node) at `QUANTILES`.  All of the way out, where the body also came back.
    back : quantiles of the way back; None where there is none.
    probability : P(a > 0).
    amplitude, length : quantiles 0.16, 0.5, 0.84 of the size and the distance over which it
        changes.
    material_sd : standard deviation of the average over another track of the same kind, which a
        c_rr as a constant of the material has beside its own, at slope 0 (divide by cos phi).
    """

    x: FloatArray
    mean: FloatArray
    quantiles: FloatArray
    back: FloatArray | None
    probability: float
    amplitude: tuple[float, float, float]
    length: tuple[float, float, float]
    material_sd: float


def find_force(
    linearised: Linearised, along: ForceTrack, response: Response, *, radius: float | None = None
) -> Force:
    """The force under the posterior of `force_shapes`, or the shared one of `shared_force_shapes`;
    same track and radius.

    response : that of the run, or of all runs stacked (`Response.stacked`).
    """
    families = linearised.deviation.families
    every = {(prior.kind, prior.length): prior for prior in force_priors(along, radius=radius)}
    priors = [every.get((f.kind, f.length)) or every[FORCE, f.length] for f in families]
    posterior = _posterior_of_force(linearised, response, [prior.covariance for prior in priors])
    sizes = [
        (f.amplitude * prior.elsewhere) ** 2 for f, prior in zip(families, priors, strict=True)
    ]
    elsewhere = float(posterior.weights @ np.concatenate(sizes)[posterior.components])
    quantiles, n = posterior.quantiles(), along.nodes.size
    return Force(
        x=along.nodes,
        mean=posterior.mean[:n],
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

    x : (n_node,) m or rad, to the end of the run.  mean : (n_node,).
    """

    run: str
    x: FloatArray
    mean: FloatArray


def find_own_force(
    linearised: Linearised,
    along: ForceTrack,
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
    posterior = _posterior_of_force(
        linearised,
        response,
        [ratio**2 * kernels[f.length] for f, ratio in zip(families, ratios, strict=True)],
    )
    reached = along.nodes <= end
    return OwnForce(run, along.nodes[reached], posterior.mean[reached])


@dataclass(frozen=True, eq=False)
class Seen:
    """A deviation at some places given each of the probable components, with the parameters p
    integrated out.

    f | k ~ N(a^2 S^T C^-1 (r - J p), a^2 K - a^4 S^T C^-1 S)

    components : (n_kept,) indices.  weights : (n_kept,) of sum 1.  means, sds : (n_kept, n_place).
    """

    components: IntArray
    weights: FloatArray
    means: FloatArray
    sds: FloatArray

    @property
    def mean(self) -> FloatArray:
        """(n_place,) of the mixture."""
        return self.weights @ self.means

    def quantiles(self) -> FloatArray:
        """(5, n_place) at `QUANTILES`."""
        return mixture_quantiles(self.weights, self.means, self.sds, QUANTILES)


def posterior_at(linear: Linearised, priors: Iterable[tuple[FloatArray, FloatArray]]) -> Seen:
    """The deviation under the posterior `linear`.

    priors : of each family, for unit amplitude, S (n_place, n_obs), the covariance of places and
    points, and the variances (n_place,) of the places.
    """
    deviation, means, sds = linear.deviation, [], []
    r, j = deviation.whiten(linear.residuals), deviation.whiten(linear.jacobian.T)
    components = linear.probable(1.0 - _NEGLECTED)
    members = deviation.each(np.arange(linear.weights.size))
    for (family, every), (along, variance) in zip(members, priors, strict=True):
        place = np.flatnonzero(np.isin(every, components))
        selected = every[place]
        projected = deviation.whiten(along) @ family.basis  # (n_place, n_dir)
        precision = 1.0 / family.variances()[place]
        square = np.square(family.amplitude[place])[:, None]
        residuals, turned = (r - linear.steps[selected] @ j) @ family.basis, j @ family.basis
        means.append(square * ((residuals * precision) @ projected.T))
        moved = square[:, :, None] * ((precision[:, None] * projected) @ turned.T)
        spread = square * variance - np.square(square) * (precision @ np.square(projected).T)
        spread += np.sum((moved @ linear.covariances[selected]) * moved, axis=2)
        sds.append(np.sqrt(np.maximum(spread, 0.0)))
    weights = linear.weights[components]
    return Seen(components, weights / weights.sum(), np.vstack(means), np.vstack(sds))


def _posterior_of_force(
    linear: Linearised, response: Response, kernels: Sequence[FloatArray]
) -> Seen:
    """kernels : covariance (n_node, n_node) of the force for unit amplitude, one for each
    family.
    """
    return posterior_at(
        linear, [(kernel @ response.force.T, np.diag(kernel)) for kernel in kernels]
    )
