"""Correlation of a deviation between two places, for unit amplitude.

- `matern32`: smooth but for its curvature; for a force along a track, and for a deviation of a
  curve in its abscissa.
- `exponential`: AR(1) in continuous time (equal steps dt give the coefficient exp(-dt/l)); for
  errors of readings that follow each other.
- `turning`: `matern32` and a moment once and twice per turn, for a wheel that is not quite round or
  not quite balanced.

What is constant over the track cannot be distinguished from a parameter that is constant
too: `without_mean` leaves the constant to the parameter, which then *means* the average over this
track, and `sd_of_mean` gives the uncertainty of that parameter elsewhere.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray

_ROUNDING = 1e-10


def distances(x: FloatArray) -> FloatArray:
    """(n, n) distances between all places x (n,)."""
    return np.abs(x[:, None] - x)


def matern32(distance: FloatArray, length: float) -> FloatArray:
    """Matern correlation of order 3/2, (1 + sqrt(3) d/l) exp(-sqrt(3) d/l); 1 at distance 0."""
    scaled = np.sqrt(3.0) * distance / length
    return (1.0 + scaled) * np.exp(-scaled)


def exponential(distance: FloatArray, length: float) -> FloatArray:
    """exp(-d/l), the correlation of a stationary AR(1) process."""
    return np.exp(-distance / length)


def turning(distance: FloatArray, length: float, *, radius: float) -> FloatArray:
    """`matern32` + cos u + cos 2u with u = d/radius the angle turned between both places; 3 at
    distance 0.

    radius : length of the track for one radian, in the unit of `distance` (1 where that is rad).
    """
    angle = distance / radius
    return matern32(distance, length) + np.cos(angle) + np.cos(2.0 * angle)


def without_mean(covariance: FloatArray, weights: FloatArray) -> FloatArray:
    """Covariance (n, n) of a process minus its own mean, M K M^T with M = 1 - 1 w^T.

    weights : (n,) w, of sum 1.
    """
    row = weights @ covariance
    return covariance - row - row[:, None] + row @ weights


def root(covariance: FloatArray) -> FloatArray:
    """(n, n_cause) X with X X^T the covariance (n, n), to 1e-10 of its largest eigenvalue."""
    spectrum, basis = np.linalg.eigh(covariance)
    significant = spectrum > _ROUNDING * spectrum[-1]
    return basis[:, significant] * np.sqrt(spectrum[significant])


def sd_of_mean(covariance: FloatArray, weights: FloatArray) -> float:
    """sqrt(w^T K w): standard deviation of the mean of a process over the track."""
    return float(np.sqrt(np.maximum(weights @ covariance @ weights, 0.0)))
