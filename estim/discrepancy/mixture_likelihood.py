"""The likelihood of many draws under a deviation that is summed over: one product of matrices a
length, then a few numbers a component.

    log L(r) = log sum_k w_k N(r | 0, C_k + H H^T)

`keep_probable` makes it from the posterior of the components.  H holds small systematic effects
that are linear in the observations (a push at release, the clock, the scale of length), each column
times the standard deviation of its cause: they cost no sampled dimension.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.linalg import solve_triangular

from estim.arrays import FloatArray, IntArray, in_blocks, log_sum_exp
from estim.discrepancy.linearised import Linearised
from estim.discrepancy.precomputed_terms import Terms, Weight, terms_of
from estim.discrepancy.scale_mixture import Deviation, Family
from estim.problem import Root, beside

# what the directions left out of a basis may add to the variances, relative to the noise and summed
_ROUGHNESS = 1e-2

_ROUNDING = 1e-13  # share of a component below which rounding hides it
_AT_ONCE = 50  # draws at once of the density of each point


@dataclass(frozen=True, eq=False)
class Mixture:
    """A normal mixture in the observations.

    deviation : the components that are kept, in bases of the directions that matter.
    columns : (n_obs, n_column) H, whitened.
    """

    deviation: Deviation
    columns: FloatArray

    @cached_property
    def terms(self) -> tuple[Terms, ...]:
        """What every draw needs, one for each family."""
        return tuple(terms_of(family, self.columns) for family in self.deviation.families)

    @cached_property
    def highest(self) -> float:
        """The log likelihood where all residuals are 0."""
        return float(self.log_likelihood(np.zeros((1, self.deviation.n_obs)))[0])

    def log_likelihood(self, residuals: FloatArray, *, weight: Weight | None = None) -> FloatArray:
        """(n_draw,) of residuals (n_draw, n_obs), data minus curve.  weight : of the draws, where
        it is not that of the fit.
        """
        return log_sum_exp(self.log_components(residuals, weight=weight), axis=0)

    def log_components(self, residuals: FloatArray, *, weight: Weight | None = None) -> FloatArray:
        """(n_component, n_draw) logarithm of each w_k N(r | 0, C_k + H H^T)."""
        z = np.ascontiguousarray(self.deviation.whiten(np.atleast_2d(residuals)).T)
        square, along = np.einsum("ij,ij->j", z, z), self.columns.T @ z
        ends = np.cumsum([family.spectrum.size for family in self.deviation.families])
        projected = np.split(self._directions.T @ z, ends[:-1])
        logs = np.concatenate(
            [
                terms.log_density(square, part, along, weight)
                for terms, part in zip(self.terms, projected, strict=True)
            ]
        )
        logs -= self.deviation.root.log_volume
        logs -= 0.5 * z.shape[0] * np.log(2.0 * np.pi)
        return logs

    def drawn(
        self, residuals: FloatArray, rng: np.random.Generator
    ) -> Iterator[tuple[Family, int, IntArray]]:
        """Each component, a place in its family, with those of the residuals (n_draw, n_obs) that
        drew it, by its probability there.
        """
        logs = self.log_components(residuals)
        chosen = np.argmax(logs + rng.gumbel(size=logs.shape[::-1]).T, axis=0)
        for family, members in self.deviation.each(np.arange(logs.shape[0])):
            for k, member in enumerate(members):
                rows = np.flatnonzero(chosen == member)
                if rows.size:
                    yield family, k, rows

    def shares(self, residuals: FloatArray) -> FloatArray:
        """(n_component,) probability of each component at residuals (n_obs,)."""
        logs = self.log_components(residuals)[:, 0]
        return np.exp(logs - np.logaddexp.reduce(logs))

    @cached_property
    def _directions(self) -> FloatArray:
        """(n_obs, n_dir) the bases of all families side by side."""
        return np.hstack([family.basis for family in self.deviation.families])

    def pulls(self, rows: FloatArray, residuals: FloatArray) -> FloatArray:
        """Rows (n, n_obs) of whitened observations times Q with d log L/dr = -Q r at residuals
        (n_obs,).

        Least squares weighted by Q, taken anew at its own result until nothing moves, ends at a
        maximum of the likelihood.
        """
        pulls, shares = np.zeros_like(rows), self.deviation.each(self.shares(residuals))
        for (family, share), terms in zip(shares, self.terms, strict=True):
            # of whitened observations: white + directions middle directions^T, by the shares
            *gain, white, _ = -2.0 * share @ terms.gain
            middle = -np.tensordot(
                share[:, None, None] * terms.cross, terms.cross, axes=((0, 1), (0, 1))
            )
            middle[np.diag_indices(len(gain))] += gain
            directions = np.hstack([family.basis, self.columns])
            pulls += float(white) * rows + rows @ directions @ middle @ directions.T
        return pulls

    def pull(self, residuals: FloatArray) -> FloatArray:
        """(n_obs,) Q r of the same Q at residuals (n_obs,), in the unit of the observations: minus
        the slope of `log_likelihood`.
        """
        z = self.deviation.whiten(residuals)
        return self.deviation.turned_back(self.pulls(z[None], residuals)[0])

    def likely(self, residuals: FloatArray) -> Root:
        """The root of the covariance of the errors at residuals (n_obs,): the sum of the C_k by
        their `shares`, and H H^T.
        """
        basis, lifted, white = self.lifted(residuals)
        significant = lifted > _ROUNDING * white
        causes = np.hstack(
            [basis[:, significant] * np.sqrt(lifted[significant]), self.columns]
        ) / np.sqrt(white)
        return beside(self.deviation.root.times(float(np.sqrt(white))), causes)

    def causes(self, family: Family, k: int) -> FloatArray:
        """(n_obs, n_cause) what a deviation of component k does to whitened observations, and H."""
        lifted = family.amplitude[k] * np.sqrt(family.spectrum)
        return np.hstack([lifted * family.basis, self.columns])

    def lifted(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """What that covariance is made of, but for H, in whitened observations: directions (n_obs,
        n_dir), the variances (n_dir,) that the deviation has there, and that of the noise.
        """
        share = self.shares(residuals)
        lifted = [
            (weights @ np.square(family.amplitude)) * family.spectrum
            for family, weights in self.deviation.each(share)
        ]
        return (
            self._directions,
            np.concatenate(lifted),
            float(share @ np.square(self.deviation.column("scale"))),
        )

    def pointwise(self, residuals: FloatArray) -> FloatArray:
        """(n_draw, n_obs) log density of every point given all the other points of residuals
        (n_draw, n_obs).

        log sum_k w_k N_k(r) - log sum_k w_k N_k(r)/N_k(r_i | others), each N_k(r_i | others) normal
        with precision Q_ii and mean r_i - (Q r)_i/Q_ii
        """
        compute = partial(self._pointwise, tuple(self._conditionals()))
        return in_blocks(compute, np.atleast_2d(residuals), _AT_ONCE)

    def _conditionals(self) -> Iterator[_Given]:
        """For each family, what `_pointwise` needs whatever the residuals."""
        back, precisions = self.deviation.turned_back, self.deviation.root.precisions
        for family, terms in zip(self.deviation.families, self.terms, strict=True):
            directions = back(np.vstack([family.basis.T, self.columns.T]))
            known, white, _ = np.split(-2.0 * terms.gain, [-2, -1], axis=1)
            gain = np.hstack([known, np.zeros((len(known), self.columns.shape[1]))])
            explained = terms.cross @ directions
            diagonal = white * precisions + gain @ directions**2
            half = np.sqrt(0.5 / (diagonal - np.sum(explained**2, axis=1)))
            coefficients = (
                gain[:, :, None] * directions - np.swapaxes(terms.cross, 1, 2) @ explained
            )
            log = -np.log(2.0 * np.sqrt(np.pi) * half)
            yield _Given(white * half, coefficients * half[:, None], log)

    def _pointwise(self, conditionals: tuple[_Given, ...], residuals: FloatArray) -> FloatArray:
        logs = self.log_components(residuals)
        z = self.deviation.whiten(residuals)
        along, back = z @ self.columns, self.deviation.turned_back(z)
        without = np.full(z.shape, -np.inf)
        for (family, own_logs), each in zip(self.deviation.each(logs), conditionals, strict=True):
            parts = np.hstack([z @ family.basis, along]) @ each.coefficients
            parts += back * each.white[:, None]
            np.square(parts, out=parts)
            parts += own_logs[:, :, None] - each.log[:, None]
            highest = np.maximum(np.max(parts, axis=0), -1e300)  # finite where all densities are 0
            np.exp(np.subtract(parts, highest, out=parts), out=parts)
            np.logaddexp(without, highest + np.log(np.sum(parts, axis=0)), out=without)
        return np.logaddexp.reduce(logs)[:, None] - without


@dataclass(frozen=True, eq=False)
class _Given:
    """The components of a family, for the density of a point given the others: N_k(r_i | others) =
    exp(log - root^2).

    white, coefficients : (n_component, n_obs), (n_component, n_dir + n_column, n_obs) what whitened
        residuals turned back, and those along basis and columns, add to the root.
    log : (n_component, n_obs) half the logarithm of the inverse of its variance over 2 pi.
    """

    white: FloatArray
    coefficients: FloatArray
    log: FloatArray


def inverse_times(rows: FloatArray, causes: FloatArray, white: float) -> FloatArray:
    """Rows (n, n_obs) times the inverse of white I + H H^T for `causes` H (n_obs, n_cause)."""
    known = np.linalg.cholesky(white * np.eye(causes.shape[1]) + causes.T @ causes)
    turned = solve_triangular(known, causes.T, lower=True)
    return (rows - (rows @ turned.T) @ turned) / white


def keep_probable(
    linearised: Linearised, *, columns: FloatArray | None = None, neglected: float = 5e-3
) -> Mixture:
    """The mixture of the most probable components: those left out hold at most the posterior
    probability `neglected` together, and no probability that follows is off by more.

    columns : (n_obs, n_column) shifts of the observations by one standard deviation of each small
        systematic effect; None for none.  Give them to `linearise` as well (columns of the Jacobian
        with precision 1), so that the components are weighed with them.
    """
    deviation, n_obs = linearised.deviation, linearised.deviation.n_obs
    order = np.argsort(linearised.weights)
    dropped = order[np.cumsum(linearised.weights[order]) <= neglected]
    keep = np.ones(order.size, dtype=bool)
    keep[dropped] = False
    families = [
        compact(merged(family.chosen(chosen)))
        for family, chosen in deviation.each(keep)
        if chosen.any()
    ]
    shifts = np.zeros((n_obs, 0)) if columns is None else deviation.whiten(columns.T).T
    return Mixture(Deviation(deviation.root, tuple(families)), shifts)


def merged(family: Family) -> Family:
    """The family with components that are the same counted once."""
    values, place = np.unique(
        np.column_stack([family.amplitude, family.scale]), axis=0, return_inverse=True
    )
    log_prior = np.full(len(values), -np.inf)
    np.logaddexp.at(log_prior, place.ravel(), family.log_prior)
    return replace(family, amplitude=values[:, 0], scale=values[:, 1], log_prior=log_prior)


def compact(family: Family) -> Family:
    """The family in those directions that its largest amplitude lifts above the noise."""
    lifted = family.spectrum * np.max(np.square(family.amplitude / family.scale))
    order = np.argsort(lifted)[::-1]
    remaining = np.cumsum(lifted[order][::-1])[::-1]  # of each direction and all weaker ones
    used = order[: int(np.sum(remaining > _ROUGHNESS))]
    basis = np.ascontiguousarray(family.basis[:, used])
    return replace(family, basis=basis, spectrum=family.spectrum[used])
