"""Where on the plane of tilt and angle of release a body that starts from rest does what: the
borders between its motions.

With V(theta)/(M g R) = gamma cos theta + theta s (energy lost to rolling resistance counted as
height) a body sets off with theta increasing where gamma sin theta0 > s, and turns where V is
V(theta0) again.  V has its hill tops at theta_min = asin(s/gamma) + 2 pi n and its valleys at
theta_max = pi - theta_min.

- It sets off between theta_min and theta_max; uphill (s > 0) that is the paper's condition for
  climbing.
- It stops after a turn by u < 2 pi where W(theta0 + u) = 0, that is 2 gamma sin(theta0 + u/2)
  sin(u/2) = u s:

      theta0 = pi - asin(u s/(2 gamma sin(u/2))) - u/2                  (`release_for_turn`)

  The other solution of the sine is where a body thrown past theta0 would have come from.  The
  farther the release is beyond theta_min, the sooner it stops.
- Downhill (s < 0) it rolls on for ever where it starts higher than the next hill top
  (`release_that_rolls_on`); uphill it never does.

All functions broadcast, as those of `estim.model.phase_curve`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, bisected
from estim.model.phase_curve import effective_slope


def range_of_release(
    gamma: ArrayLike, phi: ArrayLike, *, rolling_resistance: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """(theta_min, theta_max) in rad, between which a body sets off with theta increasing: within
    [-pi/2, 3 pi/2].

    Both are pi/2 where it never does (s > gamma), and -pi/2 and 3 pi/2, the same angle, where it
    always does (s < -gamma).

    gamma : of the body.  phi : rad.  rolling_resistance : c_rr.  Scalars or arrays.

    >>> from estim.model import range_of_release
    >>> low, high = range_of_release(0.19, 0.07)
    >>> round(float(low), 3), round(float(high), 3)
    (0.377, 2.765)
    """
    slope, gamma = np.broadcast_arrays(effective_slope(phi, rolling_resistance), gamma)
    sine = np.divide(slope, gamma, out=np.array(np.sign(slope)), where=np.abs(slope) < gamma)
    lowest = np.arcsin(sine)
    return lowest, np.pi - lowest


def release_for_turn(
    angle: ArrayLike, gamma: ArrayLike, phi: ArrayLike, *, rolling_resistance: ArrayLike = 0.0
) -> FloatArray:
    """Angle of release (rad) from which the body stops after a turn by `angle` u (rad); nan where
    there is none.

    theta0 = pi - asin(u s/(2 gamma sin(u/2))) - u/2;   none for u >= 2 pi, nor where it would not
    set off, or not get there

    angle : u.  gamma, phi (rad), rolling_resistance : as in `range_of_release`.

    >>> from estim.model import release_for_turn
    >>> round(float(release_for_turn(3.0, 0.19, 0.07)), 3)
    1.055
    """
    angle, gamma, slope = np.broadcast_arrays(
        angle, gamma, effective_slope(phi, rolling_resistance)
    )
    chord = 2.0 * gamma * np.sin(0.5 * angle)
    possible = (angle > 0.0) & (angle < 2.0 * np.pi) & (np.abs(angle * slope) <= chord)
    sine = np.divide(angle * slope, chord, out=np.zeros(chord.shape), where=possible)
    release = np.pi - np.arcsin(sine) - 0.5 * angle
    # W rises from the release and falls where it stops
    falls = (gamma * np.sin(release) > slope) & (gamma * np.sin(release + angle) <= slope)
    return np.where(possible & falls, release, np.nan)


def release_that_rolls_on(
    gamma: ArrayLike, phi: ArrayLike, *, rolling_resistance: ArrayLike = 0.0
) -> FloatArray:
    """Angle of release (rad) up to which, from theta_min on, the body rolls over the next hill top
    and on for ever; beyond it turns.

    V(theta0) = V(2 pi + theta_min), by halving between theta_min and theta_max.  theta_min where
    nothing rolls on (s >= 0), theta_max where all does.

    gamma, phi (rad), rolling_resistance : as in `range_of_release`.

    >>> from estim.model import release_that_rolls_on
    >>> round(float(release_that_rolls_on(0.19, -0.02)), 3)
    1.094
    """
    slope, gamma = np.broadcast_arrays(effective_slope(phi, rolling_resistance), gamma)
    lowest, highest = range_of_release(gamma, phi, rolling_resistance=rolling_resistance)
    top = gamma * np.cos(lowest) + (2.0 * np.pi + lowest) * slope
    turns = bisected(
        lambda angle: gamma * np.cos(angle) + angle * slope <= top, lowest, highest, 60
    )
    return np.where(slope >= 0.0, lowest, np.where(slope <= -gamma, highest, turns))
