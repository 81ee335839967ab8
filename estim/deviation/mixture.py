"""The likelihood of many draws under a deviation that is summed over: one product of matrices a length, then a few numbers a component.

    log L(r) = log sum_k w_k N(r | 0, C_k + H H^T)

`keep_probable` makes it from the posterior of the components.  H holds small systematic effects that are linear in the observations (a push at
release, the clock, the scale of length), each column times the standard deviation of its cause: they cost no sampled dimension.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from estim.arrays import FloatArray
from estim.deviation.components import Deviation, Family
from estim.deviation.linearised import Linearised

_ROUGHNESS = 1e-3  # what the directions left out of a basis may add to the variances, relative to the noise and summed

_FELT = 1e-13  # share of a component below which rounding hides it
_FEW = 16  # draws of which the calls cost more than the numbers
_CHUNK = 256  # draws at once: what they need stays in the processor's cache


@dataclass(frozen=True, eq=False)
class Mixture:
    """A normal mixture in the observations.

    deviation : the components that are kept, in bases of the directions that matter.  columns : (n_obs, n_column) H, whitened.
    terms : what every draw needs, one for each family.
    lost : posterior probability of what was left out, under the linearised posterior: no probability that follows is off by more.
    """

    deviation: Deviation
    columns: FloatArray
    terms: tuple[Terms, ...]
    lost: float

    def with_columns(self, columns: FloatArray) -> Mixture:
        """The same components beside other small systematic effects, columns (n_obs, n_column), whitened."""
        return Mixture(self.deviation, columns, tuple(_terms(family, columns) for family in self.deviation.families), self.lost)

    @property
    def n_component(self) -> int:
        return sum(family.amplitude.size for family in self.deviation.families)

    @cached_property
    def together(self) -> tuple[FloatArray, Terms]:
        """The bases of all families side by side (n_obs, n_dir), and their terms as those of one."""
        gain = np.vstack([block_diag(*(terms.gain[:-2] for terms in self.terms)), np.hstack([terms.gain[-2:] for terms in self.terms])])
        cross, cross_white = block_diag(*(terms.cross for terms in self.terms)), np.hstack([terms.cross_white for terms in self.terms])
        return np.hstack([family.basis for family in self.deviation.families]), Terms(gain, cross, cross_white)

    @cached_property
    def highest(self) -> float:
        """The log likelihood where all residuals are 0."""
        return float(self.log_likelihood(np.zeros((1, self.deviation.n_obs)))[0])

    def log_likelihood(self, residuals: FloatArray, *, relative: FloatArray | None = None) -> FloatArray:
        """(n_draw,) of residuals (n_draw, n_obs), data minus curve.

        relative : (n_draw,) factor of the stated noise in each draw, where its size is a sampled parameter; 5 to 80 times slower.
        """
        residuals = np.atleast_2d(residuals)
        total = np.empty(residuals.shape[0])
        for start in range(0, total.size, _CHUNK):
            some = slice(start, start + _CHUNK)
            logs = self.log_components(residuals[some], relative=None if relative is None else relative[some])
            highest = np.max(logs, axis=1, keepdims=True)
            np.exp(np.subtract(logs, highest, out=logs), out=logs)
            total[some] = highest[:, 0] + np.log(np.sum(logs, axis=1))
        return total

    def log_components(self, residuals: FloatArray, *, relative: FloatArray | None = None) -> FloatArray:
        """(n_draw, n_component) logarithm of each w_k N(r | 0, C_k + H H^T)."""
        z = self.deviation.whiten(np.atleast_2d(residuals))
        square, along = np.einsum("ij,ij->i", z, z), z @ self.columns
        basis, terms = self.together
        seen = z @ basis
        if relative is None and z.shape[0] <= _FEW:
            return terms.log_density(square, seen, along) - self.deviation.log_volume - 0.5 * z.shape[1] * np.log(2.0 * np.pi)
        parts, start = [], 0
        for family, own_terms in zip(self.deviation.families, self.terms, strict=True):
            own = seen[:, start : start + family.spectrum.size]
            start += family.spectrum.size
            if relative is None:
                parts.append(own_terms.log_density(square, own, along))
            else:
                parts.append(_rescaled(family, self.columns, square, own, along, np.asarray(relative, dtype=float)))
        logs = np.hstack(parts)
        logs -= self.deviation.log_volume
        logs -= 0.5 * z.shape[1] * np.log(2.0 * np.pi)
        return logs

    def shares(self, residuals: FloatArray) -> FloatArray:
        """(n_component,) probability of each component at residuals (n_obs,)."""
        logs = self.log_components(residuals)[0]
        return np.asarray(np.exp(logs - np.logaddexp.reduce(logs)))

    def precision(self, residuals: FloatArray) -> FloatArray:
        """(n_obs, n_obs) Q with d log L/dr = -Q r at residuals (n_obs,).

        Least squares weighted by Q, taken anew at its own result until nothing moves, ends at a maximum of the likelihood.
        """
        share = self.shares(residuals)
        inverse, start = np.zeros((residuals.size, residuals.size)), 0
        for family in self.deviation.families:
            own = share[start : start + family.amplitude.size]
            start += own.size
            felt = own > _FELT
            if not felt.any():
                continue
            own = own[felt]
            white = 1.0 / np.square(family.scale[felt])
            gain = 1.0 / family.variances()[felt] - white[:, None]
            inverse += (family.basis * (own @ gain)) @ family.basis.T + (own @ white) * np.eye(residuals.size)
            if self.columns.shape[1]:
                pushed = white[:, None, None] * self.columns + family.basis @ (gain[:, :, None] * (family.basis.T @ self.columns))
                information = np.eye(self.columns.shape[1]) + np.einsum("ni,knj->kij", self.columns, pushed)
                turned = np.linalg.solve(information, (own[:, None, None] * pushed).transpose(0, 2, 1))  # (k, i, m)
                inverse -= np.tensordot(pushed, turned, axes=([0, 2], [0, 1]))
        return self.deviation.turned_back(self.deviation.turned_back(inverse).T)

    def pull(self, residuals: FloatArray) -> FloatArray:
        """(n_obs,) Q r of the same Q at residuals (n_obs,), which is not made for it."""
        share, start = self.shares(residuals), 0
        z = self.deviation.whiten(residuals)
        along, whole, pull = z @ self.columns, self.columns.T @ self.columns, np.zeros(residuals.size)
        for family in self.deviation.families:
            own = share[start : start + family.amplitude.size]
            start += own.size
            felt = own > _FELT
            if not felt.any():
                continue
            own = own[felt]
            white = 1.0 / np.square(family.scale[felt])
            gain = 1.0 / family.variances()[felt] - white[:, None]
            seen, lying = z @ family.basis, family.basis.T @ self.columns
            shifts = np.zeros((own.size, self.columns.shape[1]))
            if self.columns.shape[1]:
                information = np.eye(self.columns.shape[1]) + white[:, None, None] * whole + np.einsum("mi,km,mj->kij", lying, gain, lying)
                explained = white[:, None] * along + (gain * seen) @ lying
                shifts = np.linalg.solve(information, explained[..., None])[..., 0]
            left = own[:, None] * gain * (seen - shifts @ lying.T)
            pull += (own @ white) * z + family.basis @ np.sum(left, axis=0) - self.columns @ ((own * white) @ shifts)
        return self.deviation.turned_back(pull)

    def covariance(self, residuals: FloatArray) -> FloatArray:
        """(n_obs, n_obs) of the errors at residuals (n_obs,): sum of the C_k by their `shares`, and H H^T."""
        return self.deviation.unwhiten(self.whitened_covariance(residuals))

    def whitened_covariance(self, residuals: FloatArray) -> FloatArray:
        """The same of whitened observations."""
        basis, lifted, white = self.lifted(residuals)
        return self.columns @ self.columns.T + (basis * lifted) @ basis.T + white * np.eye(residuals.size)

    def lifted(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """What that is made of, but for H: directions (n_obs, n_dir), the variances (n_dir,) that the deviation has there, and that of the noise."""
        share, start, lifted = self.shares(residuals), 0, []
        for family in self.deviation.families:
            own = share[start : start + family.amplitude.size]
            start += own.size
            lifted.append((own @ np.square(family.amplitude)) * family.spectrum)
        return self.together[0], np.concatenate(lifted), float(share @ np.square(self.deviation.column("scale")))

    def pointwise(self, residuals: FloatArray) -> FloatArray:
        """(n_draw, n_obs) log density of every point given all the other points of residuals (n_draw, n_obs).

        log sum_k w_k N_k(r) - log sum_k w_k N_k(r)/N_k(r_i | others), each N_k(r_i | others) normal with precision Q_ii and mean r_i - (Q r)_i/Q_ii
        """
        residuals = np.atleast_2d(residuals)
        plain = self.deviation.turned_back(np.eye(residuals.shape[1]))
        given = tuple(self._given(plain))
        return np.vstack([self._pointwise(residuals[start : start + _CHUNK], plain, given) for start in range(0, len(residuals), _CHUNK)])

    def _given(self, plain: FloatArray) -> Iterator[tuple[_Given, ...]]:
        """For each family, what `_pointwise` needs of each of its components whatever the residuals."""
        own, whole, moved = np.sum(plain**2, axis=0), self.columns.T @ self.columns, plain.T @ self.columns
        for family in self.deviation.families:
            basis, lying = plain.T @ family.basis, family.basis.T @ self.columns
            squared, found = basis**2, []
            for variance, scale in zip(family.variances(), family.scale, strict=True):
                gain = 1.0 / variance - 1.0 / scale**2
                diagonal = own / scale**2 + squared @ gain
                turned = gain[:, None] * lying
                root = np.linalg.inv(np.linalg.cholesky(np.eye(len(whole)) + whole / scale**2 + lying.T @ turned)).T
                pushed = (moved / scale**2 + basis @ turned) @ root
                if len(whole):
                    diagonal -= np.sum(pushed**2, axis=1)
                found.append(_Given(scale, gain, turned, root, pushed, 0.5 / diagonal, 0.5 * np.log(diagonal / (2.0 * np.pi))))
            yield tuple(found)

    def _pointwise(self, residuals: FloatArray, plain: FloatArray, given: tuple[tuple[_Given, ...], ...]) -> FloatArray:
        logs = self.log_components(residuals)
        z = self.deviation.whiten(residuals)
        without, start = np.full(z.shape, -np.inf), 0
        along, back = z @ self.columns, z @ plain
        for family, each in zip(self.deviation.families, given, strict=True):
            seen, basis = z @ family.basis, plain.T @ family.basis
            parts = np.empty((family.amplitude.size, *z.shape))
            for part, one in zip(parts, each, strict=True):
                solved = back / one.scale**2 + (seen * one.gain) @ basis.T
                if self.columns.shape[1]:
                    solved -= (along / one.scale**2 + seen @ one.turned) @ one.root @ one.pushed.T
                np.multiply(np.square(solved, out=solved), one.half, out=part)
                part -= one.log
            parts += logs[:, start : start + len(parts)].T[:, :, None]
            start += len(parts)
            highest = np.max(parts, axis=0)
            np.exp(np.subtract(parts, highest, out=parts), out=parts)
            np.logaddexp(without, highest + np.log(np.sum(parts, axis=0)), out=without)
        return np.asarray(np.logaddexp.reduce(logs, axis=1)[:, None] - without)


@dataclass(frozen=True, eq=False)
class _Given:
    """A component of a family, for the density of a point given the others.

    scale : of the noise.  gain : (n_dir,).  turned : (n_dir, n_column).  root : (n_column, n_column).  pushed : (n_obs, n_column).
    half, log : (n_obs,) half the variance of each point given the others, and half the logarithm of its inverse over 2 pi.
    """

    scale: float
    gain: FloatArray
    turned: FloatArray
    root: FloatArray
    pushed: FloatArray
    half: FloatArray
    log: FloatArray


@dataclass(frozen=True, eq=False)
class Terms:
    """Constants of a family: log density = [(z basis)^2, |z|^2, 1] gain + |explained|^2/2.

    gain : (n_dir + 2, n_component).
    cross, cross_white : (n_dir, n_component * n_column), (n_column, n_component * n_column), with (z basis) cross + (z H) cross_white
    the part of z that H explains, in units of its own standard deviation.
    """

    gain: FloatArray
    cross: FloatArray
    cross_white: FloatArray

    def log_density(self, square: FloatArray, seen: FloatArray, along: FloatArray) -> FloatArray:
        """(n_draw, n_component) for |z|^2 (n_draw,), z basis (n_draw, n_dir) and z H (n_draw, n_column)."""
        columns = np.empty((square.size, len(self.gain)))
        np.square(seen, out=columns[:, :-2])
        columns[:, -2], columns[:, -1] = square, 1.0
        density = columns @ self.gain
        if along.shape[1]:
            explained = (seen @ self.cross + along @ self.cross_white).reshape(square.size, -1, along.shape[1])
            density += 0.5 * np.einsum("ikq,ikq->ik", explained, explained)
        return density


def keep_probable(linearised: Linearised, *, columns: FloatArray | None = None, lost: float = 5e-3) -> Mixture:
    """The mixture of the most probable components: those left out hold at most the posterior probability `lost` together.

    columns : (n_obs, n_column) shifts of the observations by one standard deviation of each small systematic effect; None for none.  Give them
    to `linearise` as well (columns of the Jacobian with precision 1), so that the components are weighed with them.
    """
    deviation, n_obs = linearised.deviation, linearised.deviation.n_obs
    order = np.argsort(linearised.weights)
    dropped = order[np.cumsum(linearised.weights[order]) <= lost]
    keep = np.ones(order.size, dtype=bool)
    keep[dropped] = False
    families, start = [], 0
    for family in deviation.families:
        chosen = keep[start : start + family.amplitude.size]
        start += chosen.size
        if chosen.any():
            families.append(compact(merged(family.chosen(chosen))))
    shifts = np.zeros((n_obs, 0)) if columns is None else deviation.whiten(columns.T).T
    kept = Deviation(deviation.whitener, deviation.log_volume, tuple(families))
    return Mixture(kept, shifts, tuple(_terms(family, shifts) for family in families), float(linearised.weights[dropped].sum()))


def merged(family: Family) -> Family:
    """The family with components that are the same counted once."""
    values, place = np.unique(np.column_stack([family.amplitude, family.scale]), axis=0, return_inverse=True)
    log_prior = np.full(len(values), -np.inf)
    np.logaddexp.at(log_prior, place.ravel(), family.log_prior)
    return Family(family.kind, family.length, family.basis, family.spectrum, values[:, 0], values[:, 1], log_prior)


def compact(family: Family) -> Family:
    """The family in those directions that its largest amplitude lifts above the noise."""
    lifted = family.spectrum * np.max(np.square(family.amplitude / family.scale))
    order = np.argsort(lifted)[::-1]
    beyond = np.cumsum(lifted[order][::-1])[::-1]  # of each direction and all weaker ones
    used = order[: int(np.sum(beyond > _ROUGHNESS))]
    basis = np.ascontiguousarray(family.basis[:, used])
    return Family(family.kind, family.length, basis, family.spectrum[used], family.amplitude, family.scale, family.log_prior)


def _terms(family: Family, columns: FloatArray) -> Terms:
    n_dir, n_column = family.spectrum.size, columns.shape[1]
    inverse = 1.0 / np.square(family.scale)
    variance = family.variances()
    gain = 1.0 / variance - inverse[:, None]
    log_norm = family.log_prior - 0.5 * np.sum(np.log(variance), axis=1) + 0.5 * (columns.shape[0] - n_dir) * np.log(inverse)
    turned = family.basis.T @ columns
    information = np.eye(n_column) + inverse[:, None, None] * (columns.T @ columns) + np.einsum("mi,km,mj->kij", turned, gain, turned)
    lower = np.linalg.cholesky(information)
    log_norm -= np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    root = np.linalg.inv(lower).transpose(0, 2, 1)  # (n_component, n_column, n_column), b root has unit covariance
    cross = np.einsum("km,mi,kij->mkj", gain, turned, root).reshape(n_dir, inverse.size * n_column)
    cross_white = np.einsum("k,kij->ikj", inverse, root).reshape(n_column, inverse.size * n_column)
    return Terms(np.vstack([-0.5 * gain.T, -0.5 * inverse, log_norm]), cross, cross_white)


def _rescaled(
    family: Family, columns: FloatArray, square: FloatArray, seen: FloatArray, along: FloatArray, relative: FloatArray
) -> FloatArray:
    """(n_draw, n_component) log densities where the noise of each draw has its own factor (n_draw,)."""
    turned, n_column = family.basis.T @ columns, columns.shape[1]
    pairs = (turned[:, :, None] * turned[:, None, :]).reshape(family.spectrum.size, n_column**2)
    whole = columns.T @ columns
    each = []
    for amplitude, scale, log_prior in zip(family.amplitude, family.scale, family.log_prior, strict=True):
        white = np.square(relative * scale)
        variance = white[:, None] + amplitude**2 * family.spectrum
        gain = 1.0 / variance - 1.0 / white[:, None]
        misfit = square / white + np.sum(gain * np.square(seen), axis=1)
        volume = np.sum(np.log(variance), axis=1) + (columns.shape[0] - family.spectrum.size) * np.log(white)
        if n_column:
            information = np.eye(n_column) + whole / white[:, None, None] + (gain @ pairs).reshape(-1, n_column, n_column)
            explained = along / white[:, None] + (gain * seen) @ turned
            misfit -= np.einsum("ij,ij->i", explained, np.linalg.solve(information, explained[..., None])[..., 0])
            volume += np.linalg.slogdet(information)[1]
        each.append(log_prior - 0.5 * misfit - 0.5 * volume)
    return np.array(each).T
