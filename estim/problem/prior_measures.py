"""What a density is multiplied by before it is sampled, so that values get no weight by how the
curve was written.

`Measure` for readings of many runs, which else pull what the runs share
(`estim.fitting.incidental_parameters` tells why, and makes it).  `JeffreysPrior` for parameters
about which nothing was stated: a flat prior of the constant of an Arrhenius law, known to a factor
3, favours large ones, and moves the activation energy by a standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, Named, in_blocks
from estim.problem.coordinates import Coordinates
from estim.problem.likelihood import Points, StackedPoints, n_draws, some_draws
from estim.problem.roots import Root

# posterior standard deviations beyond which a measure that is known about the fit grows no further
_REACH = 4.0
_FITTED = 6.0  # standard deviations from the fit, within which a polynomial is believed
_BLOCK = 4_000_000  # values of the curve whose derivatives are computed at once


@dataclass(frozen=True, eq=False)
class Measure:
    """exp(slope^T (s - centre)) of the parameters s that several runs share.

    columns : (n_shared,) their indices among the parameters.
    centre, slope : (n_shared,).
    spread : posterior standard deviation of the exponent.
    felt : by how many standard deviations it moves the mean of the shared parameter that it moves
        most.
    """

    columns: IntArray
    centre: FloatArray
    slope: FloatArray
    spread: float
    influence: float

    def log(self, shared: FloatArray) -> FloatArray:
        """(n_draw,) its logarithm at shared (n_draw, n_shared), 0 at the fit."""
        return np.clip(
            (shared - self.centre) @ self.slope, -_REACH * self.spread, _REACH * self.spread
        )


@dataclass(frozen=True, eq=False)
class ResponseSurface:
    """A function of the parameters as a polynomial of second degree, fitted around a centre.

    columns : (n,) indices of the parameters that it depends on.
    coordinates : of which it is one, about their centre.
    whitener : (n, n) turns differences from the centre into standard deviations.
    coefficients : of 1, of each parameter, and of each product of two.
    """

    columns: IntArray
    coordinates: Coordinates
    whitener: FloatArray
    coefficients: FloatArray

    def standardised(self, draws: FloatArray) -> FloatArray:
        """(n_draw, n) draws (n_draw, n_par) in standard deviations from the centre."""
        differences = self.coordinates.of(draws) - self.coordinates.of(self.coordinates.centre)
        with np.errstate(invalid="ignore"):
            return differences[:, self.columns] @ self.whitener.T

    def value(self, z: FloatArray) -> FloatArray:
        """(n_draw,) at standardised z (n_draw, n)."""
        return self.terms(z) @ self.coefficients

    def terms(self, z: FloatArray) -> FloatArray:
        """(n_draw, n_term) what the coefficients multiply."""
        row, column = np.triu_indices(z.shape[1])
        return np.hstack([np.ones((len(z), 1)), z, z[:, row] * z[:, column]])


@dataclass(frozen=True, eq=False)
class InformationBlock:
    """Points of a run, or of a group, and the parameters that they give information about.

    root : of the covariance of their errors.
    own, shared : (n,) indices among `JeffreysPrior.names` of the parameters that these points alone
        depend on, and of the others that they depend on.
    """

    points: Points | StackedPoints
    root: Root
    own: IntArray
    shared: IntArray


@dataclass(frozen=True, eq=False)
class JeffreysPrior:
    """Jeffreys' prior of parameters of curves, given all others: the root of the determinant of the
    Fisher information about them, the errors held as they are at the fit.

    To first order, intervals of the posterior then have their stated coverage however the curve is
    written; where it is linear in the parameters the prior is flat.

    names : of the parameters, in the order of their scales (n,), which keep the matrix well
        conditioned.
    centre : its logarithm at the fit.
    smooth : the logarithm as a polynomial; None where no polynomial is good enough.
    ceiling : highest logarithm around the fit, which none elsewhere exceeds: else each of the
        endlessly many faster oscillations through the same points would count as much as the one
        that was found.
    coordinates : of which that is the logarithm; of values if None.

    Source: Jeffreys, Proc. R. Soc. A 186 (1946) 453; Box and Tiao, Bayesian Inference in
    Statistical Analysis (1973), 1.3.6.
    """

    names: tuple[str, ...]
    scales: FloatArray
    runs: tuple[InformationBlock, ...]
    centre: float = 0.0
    smooth: ResponseSurface | None = None
    ceiling: float = np.inf
    coordinates: Coordinates | None = None

    def log(self, draws: FloatArray, named: Callable[[FloatArray], Named]) -> FloatArray:
        """(n_draw,) its logarithm at draws (n_draw, n_par), which `named` turns into columns: by
        the polynomial, and exactly farther from the fit than that was fitted.
        """
        if self.smooth is None:
            return self._capped(draws, named)
        z = self.smooth.standardised(draws)
        with np.errstate(invalid="ignore"):
            logs = self.smooth.value(z)
        far = ~(np.linalg.norm(z, axis=1) <= _FITTED)
        if np.any(far):
            logs[far] = self._capped(draws[far], named)
        return logs

    def _capped(self, draws: FloatArray, named: Callable[[FloatArray], Named]) -> FloatArray:
        """(n_draw,) its logarithm, at most that of the ceiling."""
        return np.minimum(self.exact(named(draws)), self.ceiling - self.log_volume(draws))

    def log_volume(self, draws: FloatArray) -> FloatArray | float:
        """(n_draw,) logarithm of the volume of values that a unit of coordinates takes, 0 at the
        fit.
        """
        if self.coordinates is None:
            return 0.0
        log_volumes = self.coordinates.log_volume(np.vstack([self.coordinates.centre, draws]))
        return log_volumes[1:] - log_volumes[0]

    def exact(self, named: Named) -> FloatArray:
        """(n_draw,) its logarithm at columns (n_draw, 1) of all parameters, 0 at the fit; -inf
        where the points do not constrain some combination of the parameters.
        """
        n_draw = n_draws(named)
        size = max(run.points.y.size * (run.own.size + run.shared.size + 1) for run in self.runs)
        return in_blocks(
            lambda rows: self._exact(some_draws(named, rows)), np.arange(n_draw), _BLOCK // size
        )

    def _exact(self, named: Named) -> FloatArray:
        n_draw = n_draws(named)
        # of the own parameters of each run, then of what is left of the others
        others = np.unique(np.concatenate([run.shared for run in self.runs]))
        schur = np.zeros((n_draw, others.size, others.size))
        log_det, usable = np.zeros(n_draw), np.ones(n_draw, dtype=bool)
        with np.errstate(all="ignore"):
            for run in self.runs:
                information = self._information(run, named, n_draw)
                n = run.own.size
                own, cross = information[:, :n, :n], information[:, :n, n:]
                log_det += _log_det(own, usable)
                own = np.where(usable[:, None, None], own, np.eye(n))
                index = np.searchsorted(others, run.shared)
                schur[:, index[:, None], index] += information[:, n:, n:] - np.moveaxis(
                    cross, 1, 2
                ) @ np.linalg.solve(own, cross)
            log_det += _log_det(schur, usable)
            return np.where(usable, 0.5 * log_det - self.centre, -np.inf)

    def _information(self, run: InformationBlock, named: Named, n_draw: int) -> FloatArray:
        """(n_draw, n, n) of one run about its own parameters and then those it shares."""
        used = np.concatenate([run.own, run.shared])
        names = [self.names[i] for i in used]
        slopes = run.points.gradients(named, names, n_draw) * self.scales[used]
        rows = run.root.whiten(np.moveaxis(slopes, 1, 2))
        return rows @ np.moveaxis(rows, 1, 2)


def _log_det(matrices: FloatArray, usable: BoolArray) -> FloatArray:
    """(n_draw,) logarithms of determinants; where there is none, `usable` becomes false."""
    usable &= np.all(np.isfinite(matrices), axis=(1, 2))
    sign, log_det = np.linalg.slogdet(
        np.where(usable[:, None, None], matrices, np.eye(matrices.shape[1]))
    )
    usable &= sign > 0.0
    return np.where(usable, log_det, 0.0)
