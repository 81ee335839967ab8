"""Synthetic measurements of a body rolling up an incline, for given true parameters and a random generator.

What is simulated is what a camera sees: frames at a fixed interval that start at a random fraction of an interval after
the release, positions with independent normal errors, and angles read with a protractor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.body import Body
from model.motion import trajectory, travel_time
from model.phase import STANDARD_GRAVITY, theta_min, turning_point

FloatArray = NDArray[np.float64]


def film_time(
    body: Body, *, phi: float, theta0: float, rolling_resistance: float = 0.0, g: float = STANDARD_GRAVITY, x_end: float
) -> float:
    """Time (s) from the release until the body stops or passes `x_end` (m)."""
    stop = float(turning_point(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance))
    x_last = np.array([min(x_end, stop)])
    return float(travel_time(x_last, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g)[0, 0])


def frame_times(
    body: Body, *, phi: float, theta0: float, rolling_resistance: float = 0.0, g: float = STANDARD_GRAVITY, interval: float,
    x_end: float, rng: np.random.Generator,
) -> FloatArray:
    """Times (n_frame,) s of the frames from the release until the body stops or passes `x_end` (m).

    The first frame comes a uniformly random share of `interval` (s) after the release.
    """
    last = film_time(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g, x_end=x_end)
    return np.arange(rng.uniform(0.0, interval), last, interval)


def simulate_positions(
    t: ArrayLike, body: Body, *, phi: float, theta0: float, rolling_resistance: float = 0.0, g: float = STANDARD_GRAVITY, sigma_x: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Measured positions (n_frame,) m at times `t` (s) after release: x(t) plus normal errors of sd `sigma_x` (m)."""
    x, _ = trajectory(t, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g)
    return x[0] + sigma_x * rng.standard_normal(x.shape[1])


def simulate_theta_min(
    phi: ArrayLike, gamma: float, *, rolling_resistance: float = 0.0, u_phi: float, u_theta_min: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Measured tilts and smallest ascending angles (rad, (n_obs,) each) at the true tilts `phi`, both with normal errors."""
    phi = np.asarray(phi, dtype=float)
    angle = theta_min(gamma, phi, rolling_resistance=rolling_resistance)
    return phi + u_phi * rng.standard_normal(phi.size), angle + u_theta_min * rng.standard_normal(phi.size)
