"""What a profile needs of a posterior: -2 log density and its derivatives, at many points in one
call.

Only the log density decides; it is differentiated by differences, so any likelihood will do.  Runs
that are independent of each other are differentiated each in its own parameters alone.  It is an
`ObjectiveFunction` of `estim.levenberg_marquardt`.

Points are coordinates (`estim.problem.coordinates`): logarithms of parameters whose sign the data
know, but hardly their size, else values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, all_finite, in_blocks, sds_of
from estim.fitting.fisher_information import information, known_from_data, prior_sds
from estim.levenberg_marquardt import Start, minima
from estim.problem import Coordinates, Likelihood, Posterior, compensated

# of a conditional standard deviation, for differences: their error moves an optimum by 1e-6 sd
_STEP = 1e-3
_MANY = 20  # parameters, beyond which all stay values: the search for each takes too long
_FARTHEST = 300.0  # of the logarithm of a ratio to the fit
_AT_ONCE = 512  # rows of a call: what they need stays small


@dataclass(frozen=True, eq=False)
class ProfileSearch:
    """A posterior with the bounds and scales of its parameters, all in coordinates.

    low, high : (n_par,) bounds.
    scale : (n_par,) standard deviations at the fit, uniform priors counted with theirs.
    conditional : (n_par,) those of each parameter while the others are held.
    prior_sd : (n_par,).
    cov : (n_par, n_par) that belongs to `scale`.
    """

    posterior: Posterior
    coordinates: Coordinates
    low: FloatArray
    high: FloatArray
    scale: FloatArray
    conditional: FloatArray
    prior_sd: FloatArray
    cov: FloatArray

    quasi_newton, fraction_to_bound = True, 1.0

    def objectives(self, points: FloatArray) -> FloatArray:
        """(n_point,) -2 log density, inf where there is none."""
        # the exponential of a logarithm may lie beyond a limit, in its last digit
        draws = np.clip(self.coordinates.values(points), *self.posterior.problem.support())
        with np.errstate(all="ignore"):
            return _minus_twice(in_blocks(self.posterior.log_density, draws, _AT_ONCE))

    def objective(self, point: FloatArray) -> float:
        return float(self.objectives(point[None, :])[0])

    def reach(self, points: FloatArray) -> FloatArray:
        """(n, n_par) beyond which the curvature at points is of no use: the farther from the fit,
        the longer.
        """
        return 5.0 * self.scale + np.abs(points - self.coordinates.of(self.coordinates.centre))

    def evaluate(self, points: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        """The points and their objectives."""
        return points, self.objectives(points)

    def derivatives(
        self, points: FloatArray, which: IntArray, curved: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Slopes of the objective, and the curvatures that the Fisher information expects."""
        units = np.outer(self.scale, self.scale)
        curvatures = np.zeros((*points.shape, self.scale.size))
        for k in np.flatnonzero(curved):
            expected = self.information(points[k])
            curvatures[k] = (
                expected if all_finite(expected) else 2.0 * np.linalg.inv(self.cov) * units
            ) / units
        return self.gradients(points) / self.scale, curvatures

    def tangent(self, values: FloatArray, i: int) -> FloatArray:
        """(n_par,) how the best values of all parameters move with parameter i, to first order at
        the fit.
        """
        slope = self.cov[:, i] / self.cov[i, i]
        at_bound = ((values <= self.low) | (values >= self.high)) & (np.arange(values.size) != i)
        return np.where(at_bound, 0.0, slope)

    def gradients(self, points: FloatArray) -> FloatArray:
        """(n_point, n_par) derivatives of the objective in standard deviations; one-sided at a
        bound, to second order, and beside a hole in the density.
        """
        step = _STEP * self.conditional
        up, down = np.minimum(points + step, self.high), np.maximum(points - step, self.low)
        up = np.where(up > points, up, np.maximum(points - 0.5 * step, self.low))
        down = np.where(down < points, down, np.minimum(points + 0.5 * step, self.high))
        values = self.coordinates.away_from_zero(self.coordinates.values(points))
        with np.errstate(all="ignore"):
            slopes = 2.0 * self.posterior.problem.prior_gradient(values)
        slopes *= self.coordinates.slopes(values)
        for likelihood, indices in zip(
            self.posterior.likelihoods, self.posterior.problem.columns, strict=True
        ):
            n = indices.size
            rows = np.repeat(points[:, None, :], 1 + 2 * n, axis=1)
            rows[:, 1 + np.arange(n), indices], rows[:, 1 + n + np.arange(n), indices] = (
                up[:, indices],
                down[:, indices],
            )
            heights = self._heights(likelihood, indices, rows)
            above, below = heights[:, 1 : 1 + n], heights[:, 1 + n :]
            slopes[:, indices] += _quotients(
                above, heights[:, :1], below, up[:, indices], points[:, indices], down[:, indices]
            )
        return slopes * self.scale

    def information(self, point: FloatArray) -> FloatArray:
        """(n_par, n_par) the second derivatives that the Fisher information expects at a point, in
        standard deviations.
        """
        values = self.coordinates.away_from_zero(self.coordinates.values(point))
        units = self.coordinates.slopes(values) * self.scale
        with np.errstate(all="ignore"):
            return 2.0 * information(self.posterior, values) * np.outer(units, units)

    def _heights(self, likelihood: Likelihood, own: IntArray, rows: FloatArray) -> FloatArray:
        """(n_point, n_row) -2 log likelihood of a group, inf where there is none, at rows (n_point,
        n_row, n_par).
        """
        flat = self.coordinates.values(rows.reshape(-1, rows.shape[-1]))

        def minus_twice(some: FloatArray) -> FloatArray:
            named = {self.posterior.names[i]: some[:, i : i + 1] for i in own}
            return np.broadcast_to(_minus_twice(likelihood.log_likelihood(named)), len(some))

        with np.errstate(all="ignore"):
            return in_blocks(minus_twice, flat, _AT_ONCE).reshape(rows.shape[:-1])


def _minus_twice(log_density: FloatArray) -> FloatArray:
    """-2 log density; inf where it is not a number, or so large that products of its differences
    would overflow.
    """
    minus = -2.0 * log_density
    # the density counts as zero
    return np.where(minus < 1e30, minus, np.inf)


def _quotients(
    above: FloatArray,
    centre: FloatArray,
    below: FloatArray,
    up: FloatArray,
    at: FloatArray,
    down: FloatArray,
) -> FloatArray:
    """Slopes at `at` of the parabolas through it and the points at `up` and `down`; of the straight
    line through one of these where the density is zero at the other.
    """
    known_up, known_down = np.isfinite(above) & (up != at), np.isfinite(below) & (down != at)
    far, near = up - at, down - at
    from_above, from_below = (
        np.divide(height - centre, step, out=np.zeros(up.shape), where=known)
        for height, step, known in ((above, far, known_up), (below, near, known_down))
    )
    bent = np.divide(
        from_above * near - from_below * far, near - far, out=np.zeros(up.shape), where=near != far
    )
    return np.where(known_up & known_down, bent, np.where(known_up, from_above, from_below))


def search_of(
    posterior: Posterior,
    values: FloatArray,
    cov: FloatArray,
    level: float = np.inf,
    *,
    squared: bool = False,
) -> ProfileSearch:
    """The search around the fit `values` (n_par,) of covariance `cov`, with the scales of the
    Gaussian there.

    level : the highest rise of the objective that is needed: where it rises by more towards 0,
        a parameter has one sign.
    squared : whether sizes of errors go by their squares: of the density itself, for no point has
        a volume then.
    """
    problem = posterior.problem
    sds = prior_sds(problem, cov)
    sizes = problem.sizes_from_zero & squared
    nothing = np.zeros(sds.size, dtype=bool)
    coordinates = Coordinates(values, nothing, np.where(sizes, sds, 0.0))
    with np.errstate(all="ignore"):
        data = known_from_data(posterior, values)
        slopes = coordinates.slopes(data.inside)  # where the information is taken
        sds = np.where(sizes, 1.0, sds)
        whitened = data.matrix * np.outer(slopes * sds, slopes * sds)
    if not all_finite(whitened):
        whitened = np.zeros_like(whitened)
    # its eigenvalues are positive: terms that all but cancel leave rounding errors for some
    known, basis = np.linalg.eigh(whitened)
    precision = 1.0 + np.maximum(known, 0.0)  # in units of the priors' standard deviations
    cov = (basis / precision) @ basis.T * np.outer(sds, sds)
    conditional = sds / np.sqrt(np.square(basis) @ precision)
    low, high = (coordinates.of(end) for end in problem.support())
    linear = ProfileSearch(posterior, coordinates, low, high, sds_of(cov), conditional, sds, cov)
    by_size = _known_by_size(linear, values, level, data.on_limit)
    if not np.any(by_size):
        return linear
    coordinates = replace(coordinates, by_size=by_size)
    unit = np.where(by_size, coordinates.slopes(values), 1.0)
    low, high = (coordinates.of(end) for end in problem.support())
    return ProfileSearch(
        posterior,
        coordinates,
        np.where(by_size, np.maximum(low, -_FARTHEST), low),
        np.where(by_size, np.minimum(high, _FARTHEST), high),
        linear.scale / unit,
        conditional / unit,
        sds / unit,
        cov / np.outer(unit, unit),
    )


def _known_by_size(
    search: ProfileSearch, values: FloatArray, level: float, at_limit: BoolArray
) -> BoolArray:
    """(n_par,) which parameters others go with, so that the data determine their size poorly, and
    which are not 0: without them, the objective is higher by more than `level`.
    """
    known = np.zeros(values.size, dtype=bool)
    if not level < np.inf or values.size > _MANY:
        return known
    tied = compensated(values, search.cov)
    squared = search.coordinates.squared
    candidates = np.flatnonzero(tied & ~squared & ~at_limit)
    at, starts = search.coordinates.of(values), []
    for i in candidates:
        # where the others are, and where they go with it to first order: either may be far off
        for slope in (np.zeros(at.size), search.tangent(at, int(i))):
            without = np.clip(at - slope * at[i], search.low, search.high)
            without[i] = 0.0
            starts.append(Start(without, (int(i),)))
    heights = np.array([end.objective for end in minima(search, starts)]).reshape(-1, 2)
    known[candidates] = np.min(heights, axis=1) - search.objective(at) > level
    return known
