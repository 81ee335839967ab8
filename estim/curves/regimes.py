"""What a rolling body does from rest at a tilt and an angle of release, for draws of what is known
of it: borders and distances.

Arguments are those of the curves of `estim.curves.rolling`, scalars or (n_draw, 1).  Further
forces, a push at the start and errors of the readings are not in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named
from estim.curves.rolling import body_of
from estim.model import (
    Body,
    range_of_release,
    release_for_turn,
    release_that_rolls_on,
    turning_point,
)


def _rolling(arguments: Named) -> tuple[Body, FloatArray]:
    """The body, and its coefficient of rolling resistance."""
    body, motion = body_of(arguments)
    return body, np.asarray(motion["rolling_resistance"], dtype=float)


@dataclass(frozen=True, eq=False)
class Borders:
    """Angles of release (rad) at which the motion changes, at given tilts, (n_draw, n_phi) each.

    lowest, highest : between them it sets off with theta increasing.
    rolls_on : from `lowest` to here it rolls on for ever.
    passes : from `lowest` to here it passes the end of the ramp, of those that turn; `rolls_on`
        where none does.
    """

    lowest: FloatArray
    highest: FloatArray
    rolls_on: FloatArray
    passes: FloatArray


def borders_of(arguments: Named, phi: FloatArray, *, ramp_end: float) -> Borders:
    """The borders at true tilts phi (n_phi,) rad.  ramp_end : m from the release."""
    body, resistance = _rolling(arguments)
    lowest, highest = range_of_release(body.gamma, phi, rolling_resistance=resistance)
    on = release_that_rolls_on(body.gamma, phi, rolling_resistance=resistance)
    at_end = release_for_turn(
        ramp_end / np.asarray(body.radius), body.gamma, phi, rolling_resistance=resistance
    )
    lowest, highest, on, at_end = np.broadcast_arrays(*np.atleast_2d(lowest, highest, on, at_end))
    return Borders(lowest, highest, on, np.where(np.isnan(at_end), on, np.maximum(at_end, on)))


def turning_contours(arguments: Named, phi: FloatArray, stops: FloatArray) -> FloatArray:
    """(n_draw, n_stop, n_phi) rad, from where the body stops after `stops` (n_stop,) m at true
    tilts phi (n_phi,); nan where from nowhere.
    """
    body, resistance = _rolling(arguments)
    radius, gamma, resistance = (
        np.atleast_2d(value)[..., None] for value in (body.radius, body.gamma, resistance)
    )
    return release_for_turn(stops[:, None] / radius, gamma, phi, rolling_resistance=resistance)


def steepest_tilt(arguments: Named) -> FloatArray:
    """(n_draw, 1) rad, the tilt beyond which the body climbs from no angle of release: sin phi +
    c_rr cos phi = gamma.

    phi = asin(gamma/sqrt(1 + c_rr^2)) - atan(c_rr)
    """
    body, resistance = _rolling(arguments)
    return np.atleast_2d(
        np.arcsin(np.minimum(body.gamma / np.hypot(1.0, resistance), 1.0)) - np.arctan(resistance)
    )


def farthest_stop(arguments: Named, phi: FloatArray) -> FloatArray:
    """(n_draw, n_phi) m, how far the body gets at true tilts phi (n_phi,) from the release from
    which it gets farthest, the least angle.

    0 where it sets off from none, inf where it may roll on for ever.
    """
    body, resistance = _rolling(arguments)
    lowest, _ = range_of_release(body.gamma, phi, rolling_resistance=resistance)
    # rad, from an angle at which it would stay
    return np.atleast_2d(
        turning_point(body, phi=phi, theta0=lowest + 1e-7, rolling_resistance=resistance)
    )


def placed(arguments: Named) -> tuple[FloatArray, FloatArray]:
    """(true tilt, true angle of release) of a run, rad, (n_draw, 1) each: its readings with the
    common zero errors.
    """
    _, motion = body_of(arguments)
    return np.atleast_2d(motion["phi"]), np.atleast_2d(motion["theta0"])
