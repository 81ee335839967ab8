"""Mechanical energy of a rolling body at measured positions and speeds, per unit mass.

T/M = v^2 D/2,    V/M = g R (theta sin(phi) + gamma cos(theta)),    D = 1 + j + 2 gamma cos(theta +
phi)

(paper, eqs. kinetic_nrg_2 and potential_nrg, here for any body; V is zero where theta sin(phi) +
gamma cos(theta) is.) With rolling resistance T + V falls by c_rr g cos(phi) per metre.  `forces`
(`estim.model.forces`): the tilt of D and the height follow a ramp that is not straight; every other
force, a moment that depends on the angle too, counts as work done on T + V.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.model.body import Body
from estim.model.forces import Forces, inertia, ramp_height
from estim.model.phase_curve import STANDARD_GRAVITY


def kinetic_energy(
    x: ArrayLike,
    v: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    forces: Forces | None = None,
) -> FloatArray:
    """T/M, J/kg, of the body at `x` (m from release) with speed `v` (m/s) of the axle; translation
    and rotation.
    """
    angle, acting = np.asarray(x) / body.radius, forces or Forces()
    return 0.5 * np.square(v) * inertia(angle, body, phi=phi, theta0=theta0, forces=acting)


def potential_energy(
    x: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    g: ArrayLike = STANDARD_GRAVITY,
    forces: Forces | None = None,
) -> FloatArray:
    """V/M, J/kg, of the body at `x` (m from release); the paper's zero of height."""
    angle, bend = np.asarray(x) / body.radius, (forces or Forces()).phi_slope * body.radius
    climbed = ramp_height(angle, phi=phi, bend=bend)[0]
    height = np.asarray(theta0) * np.sin(phi) + climbed
    return np.asarray(g) * body.radius * (height + body.gamma * np.cos(np.asarray(theta0) + angle))
