"""A body built of parts that were weighed and measured: total mass, centre of mass, and moment of
inertia about the axle.

Parts are flat pieces that turn about the axle, given by their mass, where their centre is, and
their radius of gyration about an axis through it, parallel to the axle.  With r_i the place of a
centre, k_i that radius of gyration and R the rolling radius,

    M = sum m_i
    gamma R = |sum m_i r_i|/M
    j M R^2 = sum m_i (k_i^2 + |r_i|^2)        (parallel axes)

The motion depends on M, gamma and j alone.  How j is shared between "disk" (kappa) and "particle"
(rho, k_P) is a way of speaking: here the particle is all that is off the axle, unless it is said
which parts are.  rho = gamma M/M_P is its distance from the axle, the disk's own imbalance
included; k_P its radius of gyration about its own centre; kappa what is then left of j: that of the
disk alone where it is balanced.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estim.model.body import Body, Quantity


@dataclass(frozen=True, eq=False)
class Part:
    """One piece of a body.  Every number may be an array that broadcasts.

    mass : kg.
    square_gyration : m^2, inertia about its own centre / mass; `disk` and its neighbours below.
    distance : m, of its centre from the axle.
    angle : rad, where it is, from any mark on the body.
    rotates : False for what is towed by the axle and does not turn: its mass alone counts.

    >>> from estim.model import Part, disk
    >>> wheel = Part(mass=0.3, square_gyration=disk(0.15))
    >>> screw = Part(mass=0.07, distance=0.145, angle=0.0)
    >>> wheel.square_gyration
    0.01125
    """

    mass: Quantity
    square_gyration: Quantity = 0.0
    distance: Quantity = 0.0
    angle: Quantity = 0.0
    rotates: bool = True

    @property
    def on_axle(self) -> bool:
        """Whether its centre lies on the axle."""
        return not np.any(self.distance)


@dataclass(frozen=True, eq=False)
class Assembly:
    """The body that parts make.

    body : with its mass.
    mass_disk, mass_particle : kg.  direction : rad, of the centre of mass, from the mark; theta is
        counted from it.
    inertia : kg m^2, of all that rotates, about the axle.

    >>> from estim.model import Part, assemble, disk
    >>> made = assemble([Part(0.3, disk(0.15)), Part(0.07, distance=0.15)], 0.15)
    >>> round(float(made.body.gamma), 3), round(float(made.mass_particle), 3)
    (0.189, 0.07)
    """

    body: Body
    mass_disk: Quantity
    mass_particle: Quantity
    direction: Quantity
    inertia: Quantity


def disk(radius: Quantity) -> Quantity:
    """Square of the radius of gyration (m^2) of a uniform disk, or of a cylinder about its axis:
    r^2/2.

    radius : m.

    >>> from estim.model import disk
    >>> round(disk(0.15), 5)
    0.01125
    """
    return radius * radius / 2.0


def ring(radius: Quantity, inner_radius: Quantity) -> Quantity:
    """The same of a flat ring: (a^2 + b^2)/2; radius^2 for a hoop.

    radius, inner_radius : m.

    >>> from estim.model import ring
    >>> round(ring(0.06, 0.0075), 6)
    0.001828
    """
    return (radius * radius + inner_radius * inner_radius) / 2.0


def rod(length: Quantity, diameter: Quantity = 0.0) -> Quantity:
    """The same of a round rod that lies across the axle, as a spoke does: l^2/12 + d^2/16.

    length, diameter : m.

    >>> from estim.model import rod
    >>> round(rod(0.3), 4)
    0.0075
    """
    return length * length / 12.0 + diameter * diameter / 16.0


def bolt(diameter: Quantity) -> Quantity:
    """The same of a round bolt parallel to the axle, or of a nut about as wide: d^2/8.

    diameter : m.

    >>> from estim.model import bolt
    >>> bolt(0.008)
    8e-06
    """
    return diameter * diameter / 8.0


def assemble(
    parts: Sequence[Part], radius: Quantity, *, particle: Collection[int] | None = None
) -> Assembly:
    """The body of `parts` that rolls on `radius` (m).

    particle : numbers of the parts that are spoken of as the particle; None for all that are off
        the axle.  Without a particle what imbalance there is counts as one on the rim: rho is 1,
        and M_P gamma M.

    >>> from estim.model import Part, assemble, disk
    >>> made = assemble([Part(0.3, disk(0.15)), Part(0.07, distance=0.15)], 0.15)
    >>> round(float(made.inertia), 5)
    0.00495
    """
    named = [
        i
        for i, part in enumerate(parts)
        if part.rotates and (not part.on_axle if particle is None else i in particle)
    ]
    turning = [part for part in parts if part.rotates]
    mass = _sum(part.mass for part in parts)
    along = _sum(part.mass * part.distance * np.cos(part.angle) for part in turning)
    across = _sum(part.mass * part.distance * np.sin(part.angle) for part in turning)
    inertia = _sum(
        part.mass * (part.square_gyration + np.square(part.distance)) for part in turning
    )
    trailing = _sum(part.mass for part in parts if not part.rotates)
    gamma = np.hypot(along, across) / (mass * radius)
    mass_particle = _sum(parts[i].mass for i in named) if named else gamma * mass
    mass_disk = mass - trailing - mass_particle
    rho, gyration = _particle([parts[i] for i in named], mass_particle, gamma * mass, radius)
    own = mass_particle * (np.square(rho) + np.square(gyration))
    kappa = (inertia / np.square(radius) - own) / mass_disk
    body = Body(radius, gamma, kappa, rho, trailing / mass, gyration, mass)
    return Assembly(body, mass_disk, mass_particle, np.arctan2(across, along), inertia)


def _particle(parts: Sequence[Part], mass: Any, moment: Any, radius: Any) -> tuple[Any, Any]:
    """(rho, k_P) of the particle.  moment : kg, first moment of the whole body / R."""
    if not parts:
        return 1.0, 0.0
    x = _sum(part.mass * part.distance * np.cos(part.angle) for part in parts) / mass
    y = _sum(part.mass * part.distance * np.sin(part.angle) for part in parts) / mass
    square = 0.0
    for part in parts:
        away = np.square(part.distance * np.cos(part.angle) - x) + np.square(
            part.distance * np.sin(part.angle) - y
        )
        square = square + part.mass * (part.square_gyration + away)
    return moment / mass, np.sqrt(square / mass) / radius


def _sum(terms: Any) -> Any:
    return sum(terms, start=0.0)
