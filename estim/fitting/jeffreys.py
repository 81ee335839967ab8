"""The prior of parameters about which nothing was stated.

A flat prior is one of how the curve was written: that of the constant `a` of a*exp(-E/x), known to
a factor 3, favours large ones, and moves E by a standard deviation; that of log(a) does not.
Jeffreys' prior (`estim.problem.prior_measures`) is the same for both.  It is computed at some
places around the fit, and a polynomial of second degree through its logarithm stands for it; where
none is good enough, far from the fit, and with many parameters, it is computed at every draw.

Counts keep flat priors, those of the usual limits of a rate where hardly any were seen, and so do
parameters with limits on both sides, which state a uniform prior.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, all_finite, sds_of
from estim.problem import (
    WIDE,
    BandedFactor,
    Coordinates,
    InformationBlock,
    JeffreysPrior,
    Posterior,
    Problem,
    ResponseSurface,
    compensated,
)

_RADIUS = 5.0  # standard deviations, within which the places lie
_MANY = 20  # parameters, beyond which a polynomial has too many terms
_LEAST = 0.01  # weight of a point that counts
_ROUGH = 0.05  # of the logarithm, by which the polynomial may miss it


def jeffreys_prior(
    posterior: Posterior,
    values: FloatArray,
    cov: FloatArray,
    *,
    limited: bool = False,
    coordinates: Coordinates | None = None,
) -> JeffreysPrior | None:
    """That of the unstated parameters of `posterior` about the fit `values` (n_par,) of covariance
    `cov`; None where there are none, or counts are fit.

    limited : of those with limits on both sides too.
    coordinates : in which the posterior is nearly normal, where its ceiling and a polynomial are
        wanted.
    """
    problem = posterior.problem
    free = np.flatnonzero(problem.unstated | (problem.limited & limited))
    if not free.size or problem.counted:
        return None
    uses = sum(np.isin(free, columns).astype(int) for columns in problem.columns)
    named, runs = problem.named(values), []
    for likelihood, columns in zip(posterior.likelihoods, problem.columns, strict=True):
        normal = likelihood.normal
        root = (
            BandedFactor.of(likelihood.sd(named)[None] ** 2)
            if normal is None
            else normal.root(named)
        )
        used = np.isin(free, columns)
        alone = used & (uses == 1) & (len(problem.groups) > 1)
        own, shared = np.flatnonzero(alone), np.flatnonzero(used & ~alone)
        runs.append(InformationBlock(likelihood.points, root, own, shared))
    names = tuple(problem.names[i] for i in free)
    prior = JeffreysPrior(names, sds_of(cov)[free], tuple(runs))
    centre = float(prior.exact(problem.named(values[None]))[0])
    if not math.isfinite(centre):
        return None
    prior = replace(prior, centre=centre, coordinates=coordinates)
    return prior if coordinates is None else _around_the_fit(posterior, prior, values, cov)


def _around_the_fit(
    posterior: Posterior, prior: JeffreysPrior, values: FloatArray, cov: FloatArray
) -> JeffreysPrior:
    """`prior` with its ceiling and, where one is good enough, a polynomial: in the parameters, or
    in the logarithms of those that are hardly known.

    Points count by the fourth root of the density.
    """
    columns = np.array(posterior.problem.of_curve)
    few = columns.size <= _MANY
    n_term = (columns.size + 1) * (columns.size + 2) // 2
    surfaces = [
        _around(values, cov, columns, by_size) for by_size in _in_logarithms(values, cov, columns)
    ]
    rng, n_point = np.random.default_rng(1), 3 * n_term + 20 if few else 5 * columns.size
    draws = np.concatenate(
        [_points_around(each, posterior.problem, values, n_point, rng) for each in surfaces]
    )
    heights = posterior.log_density(np.vstack([values, draws]))
    weights = np.exp(np.minimum(0.25 * (heights[1:] - heights[0]), 0.0))
    draws, weights = draws[weights > _LEAST], weights[weights > _LEAST]
    if not len(draws):
        return replace(prior, ceiling=0.0)
    logs = prior.exact(posterior.problem.named(draws))
    prior = replace(prior, ceiling=max(0.0, float(np.max(logs + prior.log_volume(draws)))))
    if not few or len(draws) < 2 * n_term or not np.all(np.isfinite(logs)):
        return prior
    fitted = (_fitted(surface, draws, logs, weights) for surface in surfaces)
    return replace(
        prior, smooth=next((surface for missed, surface in fitted if missed < _ROUGH), None)
    )


def _in_logarithms(values: FloatArray, cov: FloatArray, columns: IntArray) -> list[BoolArray]:
    """(n_par,) which of the parameters `columns` may have logarithms taken, in order of preference:
    all that are hardly known, those of them that others go with (whose sign the data know), none.
    """
    of_curve = np.isin(np.arange(values.size), columns)
    wide = of_curve & (sds_of(cov) > WIDE * np.abs(values)) & (values != 0.0)
    tied = of_curve & compensated(values, cov)
    choices = [wide, tied, np.zeros_like(wide)]
    return [
        choice
        for i, choice in enumerate(choices)
        if not any(np.all(choice == o) for o in choices[:i])
    ]


def _around(
    values: FloatArray, cov: FloatArray, columns: IntArray, by_size: BoolArray
) -> ResponseSurface:
    """A polynomial of the parameters `columns` without coefficients."""
    coordinates = Coordinates(values, by_size)
    unit = coordinates.slopes(values)[columns]
    root = np.linalg.cholesky(cov[np.ix_(columns, columns)] / np.outer(unit, unit))
    return ResponseSurface(columns, coordinates, np.linalg.inv(root), np.zeros(0))


def _points_around(
    surface: ResponseSurface, problem: Problem, values: FloatArray, n: int, rng: np.random.Generator
) -> FloatArray:
    """(at most n, n_par) values around the fit within the limits, evenly spread over the distance
    from it.
    """
    z = rng.standard_normal((8 * n, surface.columns.size))
    z *= _RADIUS * rng.random((8 * n, 1)) / np.linalg.norm(z, axis=1, keepdims=True)
    points = np.tile(surface.coordinates.of(values), (8 * n, 1))
    points[:, surface.columns] += np.linalg.solve(surface.whitener, z.T).T
    draws = surface.coordinates.values(points)
    low, high = problem.support()
    return draws[np.all((draws > low) & (draws < high), axis=1)][:n]


def _fitted(
    surface: ResponseSurface, draws: FloatArray, logs: FloatArray, weights: FloatArray
) -> tuple[float, ResponseSurface]:
    """By how much the polynomial through `logs` (n_draw,) misses them, and it."""
    with np.errstate(all="ignore"):
        rows = surface.terms(surface.standardised(draws))
    if not all_finite(rows):  # draws of a sign that it does not have, or too far for their squares
        return math.inf, surface
    root = np.sqrt(weights)
    coefficients = np.linalg.lstsq(rows * root[:, None], logs * root, rcond=None)[0]
    missed = np.average(np.square(rows @ coefficients - logs), weights=weights)
    return math.sqrt(missed), replace(surface, coefficients=np.asarray(coefficients, dtype=float))
