"""Synthetic measurements of a body rolling up an incline, for given true parameters and a random
generator.

What is simulated is what a camera sees: frames at a fixed interval that start at a random fraction
of an interval after the release, positions with independent normal errors, and angles read with a
protractor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import BoolArray, FloatArray
from estim.model.body import Body
from estim.model.motion import trajectory, travel_time
from estim.model.phase_curve import STANDARD_GRAVITY, theta_min, turning_point


def film_time(
    body: Body,
    *,
    phi: float,
    theta0: float,
    rolling_resistance: float = 0.0,
    g: float = STANDARD_GRAVITY,
    x_end: float,
) -> float:
    """Time (s) from the release until the body stops or passes `x_end` (m)."""
    stop = float(turning_point(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance))
    x_last = np.array([min(x_end, stop)])
    return float(
        travel_time(
            x_last, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g
        )[0, 0]
    )


def frame_times(
    body: Body,
    *,
    phi: float,
    theta0: float,
    rolling_resistance: float = 0.0,
    g: float = STANDARD_GRAVITY,
    interval: float,
    x_end: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Times (n_frame,) s of the frames from the release until the body stops or passes `x_end` (m).

    The first frame comes a uniformly random share of `interval` (s) after the release.
    """
    last = film_time(
        body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g, x_end=x_end
    )
    return np.arange(rng.uniform(0.0, interval), last, interval)


def simulate_positions(
    t: ArrayLike,
    body: Body,
    *,
    phi: float,
    theta0: float,
    rolling_resistance: float = 0.0,
    g: float = STANDARD_GRAVITY,
    sigma_x: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Measured positions (n_frame,) m at times `t` (s) after release: x(t) plus normal errors of sd
    `sigma_x` (m).
    """
    x, _ = trajectory(t, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g)
    return x[0] + sigma_x * rng.standard_normal(x.shape[1])


def simulate_theta_min(
    phi: ArrayLike,
    gamma: float,
    *,
    rolling_resistance: float = 0.0,
    u_phi: float,
    u_theta_min: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Measured tilts and smallest ascending angles (rad, (n_obs,) each) at the true tilts `phi`,
    both with normal errors.
    """
    phi = np.asarray(phi, dtype=float)
    angle = theta_min(gamma, phi, rolling_resistance=rolling_resistance)
    return phi + u_phi * rng.standard_normal(phi.size), angle + u_theta_min * rng.standard_normal(
        phi.size
    )


def simulate_trials(
    phi: ArrayLike,
    gamma: float,
    *,
    rolling_resistance: float = 0.0,
    u_phi: float,
    scatter: float,
    release: float,
    steady: bool = False,
    expected: float,
    n_trial: int,
    step: float,
    largest: bool = False,
    readings: FloatArray | None = None,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Trials of release at true tilts `phi` (n_tilt,): tilts as read and angles as set (rad),
    whether the body climbed; (n_tilt n_trial,) each.

    At each tilt up and down: the first angle is that which the `expected` gamma gives without any
    resistance, to a multiple of `step` (rad); after an ascent the next is one step lower, else one
    higher.  The body climbs where the angle, with a logistic error of sd `scatter`, is above
    theta_min by more than the release costs: `release` (rad) at every trial if `steady`, else
    exponential with that mean.

    largest : whether the angles are those of the other end, mirrored at 90 degrees.
    readings : (n_tilt,) of the tilts, where they were taken before.  Source of the scheme: Dixon
        and Mood 1948, J. Am. Stat. Assoc. 43, 109.
    """
    phi = np.asarray(phi, dtype=float)
    read = phi + u_phi * rng.standard_normal(phi.size) if readings is None else readings
    angles, climbed = np.zeros((phi.size, n_trial)), np.zeros((phi.size, n_trial), dtype=bool)
    for i, smallest in enumerate(theta_min(gamma, phi, rolling_resistance=rolling_resistance)):
        angle = step * np.round(np.arcsin(min(np.sin(read[i]) / expected, 1.0)) / step)
        for k in range(n_trial):
            cost = release * (1.0 if steady else rng.exponential())
            angles[i, k] = angle
            climbed[i, k] = (
                angle + np.sqrt(3.0) / np.pi * scatter * rng.logistic() > smallest + cost
            )
            angle = np.clip(
                angle - step if climbed[i, k] else angle + step, 0.0, 0.5 * np.pi - step
            )
    angles = np.pi - angles if largest else angles
    return np.repeat(read, n_trial), angles.ravel(), climbed.ravel()
