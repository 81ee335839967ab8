"""Which deviation is how probable, and the parameters with it: one normal distribution a component,
where the curve is linear in its parameters.

Linearise once, at the fit with white errors and a free start, which follows the data: r = y -
f(p0), J = df/dp there.  Linearising again at the parameters found without carrying the deviation
along leads astray (1.8 standard deviations where the profile is 8 of a reading).

    A_k = J^T C_k^-1 J + P
    b_k = J^T C_k^-1 r + P (m - p0)
    p | k ~ N(p0 + A_k^-1 b_k, A_k^-1)

and the probability of k from the integral over p.  Exact for a linear curve; elsewhere the fast
answer, and the proposal for the slow one.

What was stated of the noise is never narrowed: a scale s < 1 may be the most probable (residuals
that are too small, or red with little white noise in them), and then determines how large the
deviation is, but p is inferred with s = 1 beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.special import ndtr

from estim.arrays import BoolArray, FloatArray, IntArray, bisected, squared_rows
from estim.discrepancy.scale_mixture import Deviation, Family
from estim.problem import Root, beside

_NEGLIGIBLE = 1e-9  # of the noise: sds of a direction that are smaller change no digit


@dataclass(frozen=True, eq=False)
class Linearised:
    """The posterior as a mixture of normal distributions; components in the order of
    `deviation.families`.

    deviation : the components as they serve for p, with scales of at least 1 and priors that leave
        each its probability.
    weights : (n_component,) probabilities.
    scales : (n_component,) of the noise, as the evidence has them.
    steps : (n_component, n_par) means, from the point of linearisation.
    covariances : (n_component, n_par, n_par).
    residuals, jacobian : (n_obs,), (n_obs, n_par) what it was made of.
    """

    deviation: Deviation
    weights: FloatArray
    scales: FloatArray
    steps: FloatArray
    covariances: FloatArray
    residuals: FloatArray
    jacobian: FloatArray

    @property
    def mean(self) -> FloatArray:
        """(n_par,) from the point of linearisation."""
        return self.weights @ self.steps

    @property
    def covariance(self) -> FloatArray:
        """(n_par, n_par) within components and between them."""
        return self.moments(np.arange(self.weights.size))[2]

    def moments(self, chosen: IntArray) -> tuple[float, FloatArray, FloatArray]:
        """Probability, mean (n_par,) and covariance (n_par, n_par) of some components together."""
        probability = float(self.weights[chosen].sum())
        shares = self.weights[chosen] / probability
        mean = shares @ self.steps[chosen]
        deviations = self.steps[chosen] - mean
        return (
            probability,
            mean,
            np.einsum("k,kij->ij", shares, self.covariances[chosen])
            + (shares[:, None] * deviations).T @ deviations,
        )

    def first(self, n_par: int) -> Linearised:
        """Of the first parameters alone, whatever the others."""
        covariances = self.covariances[:, :n_par, :n_par]
        return replace(self, steps=self.steps[:, :n_par], covariances=covariances)

    def from_narrow_to_wide(self) -> IntArray:
        """The components by the volume of their covariances."""
        return np.argsort(np.linalg.slogdet(self.covariances)[1])

    @property
    def likelier(self) -> IntArray:
        """The components with a deviation, where it is more likely than not that there is one; else
        those without.
        """
        present = self.deviation.column("amplitude") > 0.0
        return np.flatnonzero(present == (self.p_deviation > 0.5))

    @property
    def best(self) -> int:
        """The most probable of them: one without a deviation is a single one, of those with it
        there are as many as the grid has sizes.
        """
        return int(self.likelier[np.argmax(self.weights[self.likelier])])

    @property
    def p_deviation(self) -> float:
        """P(a > 0): the probability that there is a deviation; above 0.95 it is an alarm (none
        false in 300 clean runs).
        """
        return float(self.weights[self.deviation.column("amplitude") > 0.0].sum())

    def p_noise(self, least: float) -> float:
        """P(s >= least): the probability that the readings scatter by at least `least` times what
        was stated.
        """
        return float(self.weights[self.scales >= least].sum())

    def quantiles(self, direction: ArrayLike, probabilities: ArrayLike) -> FloatArray:
        """(n_probability,) quantiles of direction . (p - p0), for a direction (n_par,)."""
        along = np.asarray(direction, dtype=float)
        sds = np.sqrt(np.einsum("i,kij,j->k", along, self.covariances, along))
        return mixture_quantiles(self.weights, self.steps @ along, sds, probabilities)

    def probability_below(self, direction: ArrayLike, value: float) -> float:
        """P(direction . (p - p0) < value)."""
        along = np.asarray(direction, dtype=float)
        sds = np.sqrt(np.einsum("i,kij,j->k", along, self.covariances, along))
        return float(self.weights @ ndtr((value - self.steps @ along) / sds))

    def size(self, name: str) -> tuple[float, float, float]:
        """Quantiles 0.16, 0.5, 0.84 of "amplitude", "length" or "scale"; nan for the length where
        there is certainly no deviation.

        The probability of a value of the grid is spread evenly, in its logarithm, half way to its
        neighbours; that of 0 stays there.
        """
        values = (
            self.deviation.lengths()
            if name == "length"
            else self.scales
            if name == "scale"
            else self.deviation.column(name)
        )
        finite = np.isfinite(values)
        nodes, which = np.unique(values[finite], return_inverse=True)
        share = np.bincount(which.ravel(), self.weights[finite])
        if not share.sum() > 0.0:
            return np.nan, np.nan, np.nan
        share = share / share.sum()
        none = float(share[nodes == 0.0].sum())
        share, logs = share[nodes > 0.0], np.log(nodes[nodes > 0.0])
        between = 0.5 * (logs[1:] + logs[:-1])
        edges = np.r_[logs[0], between, logs[-1]]
        reached = none + np.r_[0.0, np.cumsum(share)]
        low, middle, high = (
            0.0 if p < none else float(np.exp(np.interp(p, reached, edges)))
            for p in (0.16, 0.5, 0.84)
        )
        return low, middle, high

    def probable(self, share: float) -> IntArray:
        """The most probable components, which hold this share of the probability, in their
        order.
        """
        order = np.argsort(self.weights)[::-1]
        enough = 1 + int(np.searchsorted(np.cumsum(self.weights[order]), share))
        return np.sort(order[:enough])

    def errors(self) -> FloatArray:
        """(n_obs,) what of the residuals is error of the readings, on average under the best
        component.
        """
        family, i = self.component(self.best)
        z = self.deviation.whiten(self.residuals - self.jacobian @ self.steps[self.best])
        lifted = family.amplitude[i] ** 2 * family.spectrum
        share = lifted / (family.scale[i] ** 2 + lifted)
        return self.deviation.root.coloured(
            (z - ((z @ family.basis) * share) @ family.basis.T)[None]
        )[0]

    def best_root(self, columns: FloatArray | None = None, *, size: float = 1.0) -> Root:
        """Of the covariance of the most probable component, with the scale of the noise that the
        evidence has, over `size` squared.

        columns : (n_obs, n_column) further errors, unit of the observations, beside it.
        """
        family, i = self.component(self.best)
        scale, amplitude = float(self.scales[self.best]), float(family.amplitude[i])
        lifted = amplitude * np.sqrt(family.spectrum) / scale
        significant = lifted > _NEGLIGIBLE
        causes = family.basis[:, significant] * lifted[significant]
        if columns is not None:
            causes = np.column_stack([causes, self.deviation.whiten(columns.T).T * (size / scale)])
        return beside(self.deviation.root.times(scale / size), causes)

    def component(self, k: int) -> tuple[Family, int]:
        """The family of component k, and its place there."""
        for family in self.deviation.families:
            if k < family.amplitude.size:
                return family, k
            k -= family.amplitude.size
        raise IndexError(k)


def linearise(
    deviation: Deviation,
    residuals: FloatArray,
    jacobian: FloatArray,
    *,
    precision: FloatArray,
    pull: ArrayLike = 0.0,
    stated: bool = True,
) -> Linearised:
    """The posterior of a curve that is linear about a point p0.

    residuals : (n_obs,) y - f(p0).
    jacobian : (n_obs, n_par) df/dp at p0.
    precision : (n_par, n_par) inverse covariance of the prior, rows of zeros where it is flat.
    pull : (n_par,) prior mean - p0.
    stated : whether the size of the noise was stated, and is not to be narrowed.
    """
    n_obs, n_par = jacobian.shape
    r, j = deviation.whiten(residuals), deviation.whiten(jacobian.T).T
    pulled = precision @ np.broadcast_to(np.asarray(pull, dtype=float), (n_par,))
    offset = float(np.sum(np.asarray(pull) * pulled))
    square, along, gram = float(r @ r), j.T @ r, j.T @ j
    logs, steps, covariances, families = [], [], [], []
    for family in deviation.families:
        projected, turned = r @ family.basis, family.basis.T @ j
        variance, white = family.variances(), 1.0 / np.square(family.scale)
        # nothing lies outside a basis that is complete, not even rounding errors
        known, outside = 1.0 / variance, float(projected.size < n_obs)
        pairs = squared_rows(turned).reshape(projected.size, n_par**2)
        rest = (
            outside * (gram - turned.T @ turned),
            outside * (along - projected @ turned),
            outside * (square - float(projected @ projected)),
        )
        information = (
            white[:, None, None] * rest[0] + (known @ pairs).reshape(-1, n_par, n_par) + precision
        )
        slope = white[:, None] * rest[1] + known @ (turned * projected[:, None]) + pulled
        covariance = np.linalg.inv(information)
        step = np.einsum("kij,kj->ki", covariance, slope)
        misfit = (
            white * rest[2]
            + known @ np.square(projected)
            + offset
            - np.einsum("ki,ki->k", slope, step)
        )
        log_volume = (
            np.sum(np.log(variance), axis=1)
            - (n_obs - projected.size) * np.log(white)
            + np.linalg.slogdet(information)[1]
        )
        log_likelihood = -0.5 * (misfit + log_volume)
        serves = _at_least_stated(family) if stated else np.arange(family.amplitude.size)
        logs.append(family.log_prior + log_likelihood)
        steps.append(step[serves])
        covariances.append(covariance[serves])
        carried = family.log_prior + log_likelihood - log_likelihood[serves]
        families.append(replace(family, scale=family.scale[serves], log_prior=carried))
    log_weight = np.concatenate(logs)
    weights = np.exp(log_weight - np.logaddexp.reduce(log_weight))
    return Linearised(
        deviation=Deviation(deviation.root, tuple(families)),
        weights=weights,
        scales=deviation.column("scale"),
        steps=np.vstack(steps),
        covariances=np.concatenate(covariances),
        residuals=residuals,
        jacobian=jacobian,
    )


def linearise_with_effects(
    deviation: Deviation,
    residuals: FloatArray,
    jacobian: FloatArray,
    columns: FloatArray,
    *,
    precision: FloatArray,
    pull: FloatArray,
) -> Linearised:
    """The same with small linear systematic effects, `columns` (n_obs, n_column), each of unit size
    beforehand: parameters behind the others.
    """
    n = columns.shape[1]
    return linearise(
        deviation,
        residuals,
        np.column_stack([jacobian, columns]),
        precision=block_diag(precision, np.eye(n)),
        pull=np.append(pull, np.zeros(n)),
    )


def _at_least_stated(family: Family) -> IntArray:
    """(n_component,) for each component itself, or, where its scale is below 1, the one with the
    same amplitude and scale 1.
    """
    stated = np.flatnonzero(family.scale == 1.0)
    rising = stated[np.argsort(family.amplitude[stated])]
    same = rising[np.searchsorted(family.amplitude[rising], family.amplitude[family.scale < 1.0])]
    serves = np.arange(family.scale.size)
    serves[family.scale < 1.0] = same
    return serves


def mixture_quantiles(
    weights: FloatArray, means: FloatArray, sds: FloatArray, probabilities: ArrayLike
) -> FloatArray:
    """Quantiles (n_probability, ...) of mixtures of normal distributions; means and sds
    (n_component, ...), weights (n_component,).

    By halving between the outermost quantiles of the components, to 1e-9 of their distance.
    """
    p = np.asarray(probabilities, dtype=float).reshape(-1, *(1,) * (means.ndim - 1))
    spread = 40.0 * np.max(sds, axis=0)
    low = np.broadcast_to(np.min(means, axis=0) - spread, (p.shape[0], *means.shape[1:]))
    high = np.broadcast_to(np.max(means, axis=0) + spread, low.shape)
    width = np.where(sds > 0.0, sds, np.finfo(float).tiny)

    def reached(values: FloatArray) -> BoolArray:
        shares = ndtr((values[None] - means[:, None]) / width[:, None])
        return np.tensordot(weights, shares, axes=1) >= p

    with np.errstate(over="ignore"):  # beside a component without any width
        return bisected(reached, low, high, 36)
