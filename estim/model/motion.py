"""Motion in time from rest or a push: travel time, position and velocity at given times.

`estim.model.time_integration` follows the motion by series in time, under any forces.  Everything
is vectorised over draws: parameters as scalars or (n_draw, 1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.model.body import Body
from estim.model.forces import Forces
from estim.model.phase_curve import STANDARD_GRAVITY
from estim.model.time_integration import driven_motion, driven_passage


def travel_time(
    x: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
) -> FloatArray:
    """Time from release until the axle is first at `x`, s, shaped (n_draw, n_obs); nan where it
    never gets there.

    body, phi, theta0 (rad), rolling_resistance, g : as in `speed`.
    x : (n_obs,) m.
    Parameters scalars or (n_draw, 1).

    >>> from estim.model import Body, travel_time
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> travel_time([0.1, 0.2], body, phi=0.07, theta0=1.0).round(3).tolist()
    [[0.586, 0.795]]
    """
    return driven_passage(
        np.asarray(x) / body.radius,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        g=g,
        forces=Forces(),
    ).time


def trajectory(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and speed (m/s) at times `t` after release, each (n_draw, n_obs).

    At rest at 0 before release; nan after the turning point (the way back is another motion:
    resistance changes sign); nan for every t > 0 where the body does not start.

    phi, theta0 : rad.  rolling_resistance, g : as in `speed`.
    t : (n_obs,) s.  Parameters scalars or (n_draw, 1).

    >>> from estim.model import Body, trajectory
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> x, v = trajectory([0.5, 1.0], body, phi=0.07, theta0=1.0)
    >>> x.shape
    (1, 2)
    """
    return driven_motion(
        t,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        g=g,
        forces=Forces(),
        back=False,
    )


def back_and_forth(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    release_speed: ArrayLike | None = None,
    forces: Forces | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and velocity (m/s, negative on the way back) at times `t` after release, each
    (n_draw, n_obs).

    At rest at 0 before release.  Where the body stops it starts back, unless rolling resistance
    holds it: then it stays.  nan where the way is too long to be resolved (hundreds of turns).

    phi, theta0 : rad.  rolling_resistance, g : as in `speed`.
    t : (n_obs,) or (n_draw, n_obs) s.
    Parameters scalars or (n_draw, 1).
    release_speed : m/s at t = 0, either sign.
    forces : what else acts.

    >>> from estim.model import Body, back_and_forth
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> x, v = back_and_forth([0.5, 3.0], body, phi=0.07, theta0=1.0)
    >>> x.shape, bool(v[0, 0] > 0.0)
    ((1, 2), True)
    """
    return driven_motion(
        t,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        g=g,
        release_speed=0.0 if release_speed is None else release_speed,
        forces=forces or Forces(),
    )
