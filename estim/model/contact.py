"""The force between ramp and body: how hard it presses, and the friction that rolling needs.

With H = W/D the energy ratio of `estim.model.phase_curve` (theta'^2 = 2 g H/R, theta'' = g H'/R)
and a = theta + phi_x the angle of the particle from the normal of the ramp, Newton's law for the
centre of mass gives, per unit weight,

    N/(M g) = cos phi_x + 2 phi' R H - gamma [H' sin a + 2 H cos a]
    F/(M g) = sin phi_x + H' + gamma [H' cos a - 2 H sin a] + k_1 v/g + k_2 v^2/g

N : normal force, away from the ramp.
F : friction on the body, uphill positive.  Rolling holds while N > 0 and |F| <= mu N.  Since |F| <=
    mu N fails before N = 0 unless F vanishes there, a body slips before it hops, whatever mu.

Rolling resistance and moments are torques here as everywhere: they act through H' alone.  Drag
(k_1, k_2) is a force on the axle.  A trailing part is carried by the axle alone: where it rests on
the ramp with a foot of its own, N and F are those of axle and foot together.

Limits: J. E. Littlewood's hoop without mass (A Mathematician's Miscellany, 1953; W. F. D. Theron
and M. F. Maritz, Math. Comput. Model. 47 (2008) 1077), gamma = j = 1 on the level from rest at the
top: N/(M g) = cos theta, F/N = tan(theta/2).

Use `contact_forces` along a motion, and `needed_friction` for the coefficient that it asks for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.model.body import Body
from estim.model.forces import Forces, energy_series, inertia
from estim.model.phase_curve import STANDARD_GRAVITY, energy_ratio_derivatives


@dataclass(frozen=True, eq=False)
class ContactForces:
    """normal, friction : N and F/(M g), dimensionless; nan where the energy does not reach;
    (n_obs,) or (n_draw, n_obs).

    >>> from estim.model import Body, contact_forces
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> contact = contact_forces([0.0, 0.5], body, phi=0.07, theta0=1.0)
    >>> contact.normal.shape
    (2,)
    """

    normal: FloatArray
    friction: FloatArray


def contact_forces(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
    rate: ArrayLike | None = None,
) -> ContactForces:
    """Normal force and friction per unit weight after the body has turned by `angle` (rad) since
    release.

    g : m/s^2.
    phi, theta0, rolling_resistance, release_energy, forces : as in `speed`.
    rate : rad/s, theta' there, either sign, where it is known; else that of the motion from release
        with theta increasing.

    >>> from estim.model import Body, contact_forces
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> contact_forces([0.0, 0.5], body, phi=0.07, theta0=1.0).normal.round(2).tolist()
    [0.99, 0.98]
    """
    angle = np.asarray(angle, dtype=float)
    place: dict[str, Any] = {"phi": phi, "theta0": theta0}
    acting, radius, g = forces or Forces(), body.radius, np.asarray(g)
    if rate is None:
        sense: ArrayLike = 1.0
        motion = {
            **place,
            "rolling_resistance": rolling_resistance,
            "release_energy": release_energy,
            "g": g,
        }
        ratio, slope = energy_ratio_derivatives(angle, body, **motion, forces=forces, order=1)
    else:
        sense = np.where(np.asarray(rate) < 0.0, -1.0, 1.0)
        energy = np.square(rate) * radius / (2.0 * g) * inertia(angle, body, **place, forces=acting)
        against = _turned(acting, sense)
        ratio, slope = energy_series(
            angle,
            energy,
            body,
            **place,
            rolling_resistance=np.asarray(rolling_resistance) * sense,
            g=g,
            forces=against,
            order=1,
        )
    bend = acting.phi_slope * radius
    tilt = phi + bend * angle
    across = theta0 + angle + tilt
    sine, cosine, gamma = np.sin(across), np.cos(across), body.gamma
    ratio = np.where(ratio >= 0.0, ratio, np.nan)
    normal = np.cos(tilt) + 2.0 * bend * ratio - gamma * (slope * sine + 2.0 * ratio * cosine)
    friction = np.sin(tilt) + slope + gamma * (slope * cosine - 2.0 * ratio * sine)
    if np.any(acting.viscous_drag) or np.any(acting.quadratic_drag):
        v = np.sqrt(2.0 * g * radius * ratio)
        friction = friction + sense * (acting.viscous_drag + acting.quadratic_drag * v) * v / g
    return ContactForces(np.asarray(normal), np.asarray(friction))


def _turned(forces: Forces, sense: ArrayLike) -> Forces:
    """What resists, against the motion of either `sense`, as the energy equation for theta
    increasing has it.
    """
    return replace(
        forces,
        moment=forces.moment * sense,
        load_resistance=forces.load_resistance * sense,
        viscous_drag=forces.viscous_drag * sense,
        quadratic_drag=forces.quadratic_drag * sense,
    )


def needed_friction(contact: ContactForces) -> FloatArray:
    """Coefficient of static friction that rolling needs, |F|/N; inf where the body would hop (N <=
    0).

    contact : of `contact_forces`; the result has its shape.

    >>> from estim.model import Body, contact_forces, needed_friction
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> contact = contact_forces([0.0, 0.5], body, phi=0.07, theta0=1.0)
    >>> needed_friction(contact).round(2).tolist()
    [0.13, 0.14]
    """
    pressed = contact.normal > 0.0
    needed = np.abs(contact.friction) / np.where(pressed, contact.normal, 1.0)
    return np.where(np.isnan(contact.normal), np.nan, np.where(pressed, needed, np.inf))
