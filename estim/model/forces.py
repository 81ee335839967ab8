"""What acts on a real body beside weight and plain rolling resistance, and the energy equation with
all of it.

Energies in weights x R (units of M g R), u = theta - theta0 the angle turned, x = R u the path of
the axle, v = R u':

    q(u) = v^2 D/(2 g R)
    D    = 1 + j + 2 gamma cos(theta + phi_x),    phi_x = phi + phi' x
    q(0) = E0 = v0^2 D(0)/(2 g R)

    dq/du = gamma sin theta - sin phi_x - (c_rr cos phi_x + m + c_N n)
            - sum_{k=1,2} [a_k cos(k theta) + b_k sin(k theta)]
            - k_1 v/g - k_2 v |v|/g

    n = N/(M g) = cos phi_x + 2 q phi' R/D
                  - gamma [sin(theta + phi_x) (q/D)' + 2 cos(theta + phi_x) q/D]

| symbol | name in code | unit | meaning | on the way back |
|---|---|---|---|---|
| E0 | release_energy | 1 | kinetic energy at release; negative: what a body at rest lacks | |
| m | moment | 1 | resisting moment / (M g R), see `moment_ratio` | changes sign |
| c_N | load_resistance | 1 | rolling resistance by the load that the ramp feels | changes sign |
| k_1 | viscous_drag | 1/s | force k_1 M v against the motion | changes sign |
| k_2 | quadratic_drag | 1/m | force k_2 M v^2, k_2 = c_w A rho_air/(2 M) | changes sign |
| a_k, b_k | once_cos ... twice_sin | 1 | moment k times per turn / (M g R): a bent axle | stays |
| phi' | phi_slope | rad/m | change of the tilt along the ramp: it hangs through | stays |

The curved ramp is exact, not a small correction: the axle moves by R dtheta whatever the curvature,
if x is its path and theta is counted from the vertical.  Without k_1, k_2 and c_N the equation
integrates to `work`; with them `model.time_integration` does it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.model.body import Body, Quantity


@dataclass(frozen=True, eq=False)
class Forces:
    """What acts beside weight and plain rolling resistance; zero does nothing.
    Each a number or an array (n_draw, 1).

    moment : a moment that does not depend on the load / (M g R).
    load_resistance : rolling resistance / load.  viscous_drag : 1/s.  quadratic_drag : 1/m.
    once_cos, once_sin, twice_cos, twice_sin : moments that vary once and twice per turn / (M g R).
    phi_slope : rad/m, change of the tilt along the ramp.

    >>> from estim.model import Body, Forces, speed
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> air = Forces(quadratic_drag=0.02)
    >>> speed([0.1, 0.2], body, phi=0.07, theta0=1.0, forces=air).round(3).tolist()
    [[0.382, 0.569]]
    """

    moment: Quantity = 0.0
    load_resistance: Quantity = 0.0
    viscous_drag: Quantity = 0.0
    quadratic_drag: Quantity = 0.0
    once_cos: Quantity = 0.0
    once_sin: Quantity = 0.0
    twice_cos: Quantity = 0.0
    twice_sin: Quantity = 0.0
    phi_slope: Quantity = 0.0

    @property
    def with_speed(self) -> bool:
        """Whether a force depends on the speed: the energy then has no closed form."""
        return bool(
            np.any(self.load_resistance) or np.any(self.viscous_drag) or np.any(self.quadratic_drag)
        )

    @property
    def turning(self) -> tuple[tuple[int, Quantity, Quantity], ...]:
        """(times per turn, cosine part, sine part)."""
        return (1, self.once_cos, self.once_sin), (2, self.twice_cos, self.twice_sin)

    def values(self) -> Iterator[Quantity]:
        """Its fields in their order, each in its SI unit."""
        return (getattr(self, field.name) for field in fields(self))


def moment_ratio(moment: ArrayLike, mass: ArrayLike, radius: ArrayLike, g: ArrayLike) -> Any:
    """A moment in N m as a share of M g R, dimensionless: the same moment is a smaller share for a
    heavier body.

    moment : N m.  mass : kg.  radius : m.  g : m/s^2.

    >>> from estim.model import moment_ratio
    >>> round(float(moment_ratio(0.001, 0.37, 0.15, 9.81)), 4)
    0.0018
    """
    return np.asarray(moment) / (np.asarray(mass) * np.asarray(g) * np.asarray(radius))


def turn_components(amplitude: ArrayLike, phase: ArrayLike) -> tuple[Any, Any]:
    """(a, b) with a cos(k theta) + b sin(k theta) = amplitude cos(k theta - phase); phase in rad.

    Fit a and b rather than the two: at amplitude 0 the phase has no meaning.

    >>> from estim.model import turn_components
    >>> a, b = turn_components(0.005, 0.927)
    >>> round(float(a), 4), round(float(b), 4)
    (0.003, 0.004)
    """
    return np.asarray(amplitude) * np.cos(phase), np.asarray(amplitude) * np.sin(phase)


def turn_amplitude(cosine: ArrayLike, sine: ArrayLike) -> tuple[Any, Any]:
    """(amplitude, phase in rad) of a cos(k theta) + b sin(k theta): the inverse of
    `turn_components`.

    cosine, sine : a and b, in any unit.

    >>> from estim.model import turn_amplitude
    >>> amplitude, phase = turn_amplitude(0.003, 0.004)
    >>> round(float(amplitude), 4), round(float(phase), 3)
    (0.005, 0.927)
    """
    return np.hypot(cosine, sine), np.arctan2(sine, cosine)


def sagging(
    phi: ArrayLike,
    sag: ArrayLike,
    *,
    length: ArrayLike,
    start: ArrayLike,
    phi_slope: ArrayLike = 0.0,
) -> tuple[Any, Any]:
    """(tilt at release in rad, its change in rad/m) of a ramp that hangs through as a parabola
    between two supports.

    height below the straight line = 4 s p (l - p)/l^2,   slope -4 s (l - 2 p)/l^2,   p = start + x

    phi_slope : rad/m, change of the tilt of the line itself.
    phi : rad, tilt of the line through the supports.
    sag : m, depth s in the middle, negative for a hump.
    length : m, l.
    start : m, from the lower-x support to the point of release.  Relative error of the slope: (4
        s/l)^2.

    >>> from estim.model import sagging
    >>> tilt, change = sagging(0.07, 0.001, length=1.0, start=0.1)
    >>> round(float(tilt), 4), round(float(change), 4)
    (0.0668, 0.008)
    """
    share = 4.0 * np.asarray(sag) / np.square(length)
    return np.asarray(phi) - share * (np.asarray(length) - 2.0 * np.asarray(start)), np.asarray(
        phi_slope
    ) + 2.0 * share


def release_energy(
    v: ArrayLike, body: Body, *, phi: ArrayLike, theta0: ArrayLike, g: ArrayLike
) -> Any:
    """E0 = v |v| D/(2 g R) at x = 0, in weights x R, of the axle's speed v (m/s) at release;
    negative for a negative v.

    phi, theta0 : rad.  D : as in `speed`.

    >>> from estim.model import Body, release_energy
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> round(float(release_energy(0.1, body, phi=0.07, theta0=1.0, g=9.81)), 4)
    0.0059
    """
    v = np.asarray(v)
    return (
        v * np.abs(v) * _inertia_at_release(body, phi, theta0) / (2.0 * np.asarray(g) * body.radius)
    )


def release_speed(
    energy: ArrayLike, body: Body, *, phi: ArrayLike, theta0: ArrayLike, g: ArrayLike
) -> Any:
    """v0 (m/s) of an energy at release in weights x R: the inverse of `release_energy`.

    phi, theta0 : rad.  g : m/s^2.

    >>> from estim.model import Body, release_speed
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> round(float(release_speed(0.01, body, phi=0.07, theta0=1.0, g=9.81)), 3)
    0.13
    """
    square = (
        2.0 * np.asarray(g) * body.radius * np.abs(energy) / _inertia_at_release(body, phi, theta0)
    )
    return np.sign(energy) * np.sqrt(square)


def _inertia_at_release(body: Body, phi: ArrayLike, theta0: ArrayLike) -> Any:
    return 1.0 + body.inertia_ratio + 2.0 * body.gamma * np.cos(np.asarray(theta0) + phi)


def inertia(
    angle: ArrayLike, body: Body, *, phi: ArrayLike, theta0: ArrayLike, forces: Forces
) -> FloatArray:
    """D after the body has turned by `angle` (rad), dimensionless."""
    angle = np.asarray(angle, dtype=float)
    bend = 1.0 + forces.phi_slope * body.radius
    return np.asarray(
        1.0
        + body.inertia_ratio
        + 2.0 * body.gamma * np.cos(np.asarray(theta0) + phi + bend * angle)
    )


def ramp_height(
    angle: ArrayLike, *, phi: ArrayLike, bend: Quantity
) -> tuple[FloatArray, FloatArray]:
    """Height gained and level distance covered / R after a turn by `angle` u (rad): the integrals
    of sin and cos of phi + bend u.

    u sin(phi + bend u/2) sinc(bend u/2) and the same with cos.     bend : phi' R, 1
    """
    angle = np.asarray(angle, dtype=float)
    half = 0.5 * bend * angle
    along = angle * np.sinc(half / np.pi)
    return along * np.sin(phi + half), along * np.cos(phi + half)


def work(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    forces: Forces,
) -> FloatArray:
    """W after a turn by `angle` u (rad), in weights x R, of all that does not depend on the speed.

    gamma (cos theta0 - cos theta) - h - c_rr l - m u - sum_k [a_k (sin k theta - sin k theta0) -
    b_k (cos k theta - cos k theta0)]/k

    h, l : `ramp_height`.  Differences of sines as products: no cancellation close to the release.
    """
    angle = np.asarray(angle, dtype=float)
    middle = np.asarray(theta0) + 0.5 * angle
    height, level = ramp_height(angle, phi=phi, bend=forces.phi_slope * body.radius)
    total = (
        2.0 * body.gamma * np.sin(middle) * np.sin(0.5 * angle)
        - height
        - np.asarray(rolling_resistance) * level
    )
    total = total - forces.moment * angle
    for k, cosine, sine in forces.turning:
        if np.any(cosine) or np.any(sine):
            chord = 2.0 / k * np.sin(0.5 * k * angle)
            total = total - chord * (cosine * np.cos(k * middle) + sine * np.sin(k * middle))
    return np.asarray(total)


def energy_series(
    angle: ArrayLike,
    energy: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike,
    g: ArrayLike,
    forces: Forces,
    order: int,
) -> list[FloatArray]:
    """q/D and its derivatives with respect to the angle up to `order`, for theta increasing, where
    q is `energy`; rad^-n.

    The energy equation gives each Taylor coefficient from those before it, those of D and of the
    forces being known.
    """
    angle = np.asarray(angle, dtype=float)
    radius, g = body.radius, np.asarray(g, dtype=float)
    bend = forces.phi_slope * radius
    theta, phi_x, gamma = np.asarray(theta0) + angle, phi + bend * angle, body.gamma
    sin_ramp, cos_ramp = _sine(phi_x, bend, order), _sine(phi_x + 0.5 * np.pi, bend, order)
    sin_tilted = _sine(theta + phi_x, 1.0 + bend, order)
    cos_tilted = _sine(theta + phi_x + 0.5 * np.pi, 1.0 + bend, order)
    d = [2.0 * gamma * c for c in cos_tilted]
    d[0] = d[0] + 1.0 + body.inertia_ratio
    load = forces.load_resistance
    friction = np.asarray(rolling_resistance) + load
    push = [
        gamma * s - h - friction * c
        for s, h, c in zip(_sine(theta, 1.0, order), sin_ramp, cos_ramp, strict=True)
    ]
    push[0] = push[0] - forces.moment
    for k, cosine, sine in forces.turning:
        pairs = zip(
            _sine(k * theta + 0.5 * np.pi, float(k), order),
            _sine(k * theta, float(k), order),
            strict=True,
        )
        push = [p - cosine * c - sine * s for p, (c, s) in zip(push, pairs, strict=True)]
    quadratic = 2.0 * radius * forces.quadratic_drag
    viscous = forces.viscous_drag * np.sqrt(2.0 * radius / g)
    # what the turning centre of mass takes off the load, per unit of q/D
    carried = [2.0 * load * gamma * c for c in cos_tilted]
    carried[0] = carried[0] - 2.0 * load * bend
    inner = [whole - gamma * load * s for whole, s in zip(d, sin_tilted, strict=True)]
    ratio: list[FloatArray] = [np.asarray(energy, dtype=float) / d[0]]
    root: list[FloatArray] = []
    for n in range(order):
        root.append(_root_term(root, ratio, n))
        right = push[n] + _product(ratio, carried, n) - quadratic * ratio[n] - viscous * root[n]
        # q' = (q/D)' D + (q/D) D', and the load too holds (q/D)': solved for it
        right = right - sum(ratio[k] * (n - k + 1) * d[n - k + 1] for k in range(n + 1))
        known = sum((k + 1) * ratio[k + 1] * inner[n - k] for k in range(n))
        ratio.append((right - known) / inner[0] / (n + 1))
    factorial = 1.0
    for n in range(1, order + 1):
        factorial *= n
        ratio[n] = factorial * ratio[n]
    return [np.asarray(r) for r in ratio]


def _sine(angle: FloatArray, rate: ArrayLike, order: int) -> list[FloatArray]:
    """Taylor coefficients of sin(angle + rate u) in u, order + 1 of them."""
    terms, factor = [np.sin(angle)], np.asarray(1.0)
    for n in range(1, order + 1):
        factor = factor * rate / n
        terms.append(factor * np.sin(angle + 0.5 * np.pi * n))
    return terms


def _product(a: list[FloatArray], b: list[FloatArray], n: int) -> Any:
    """Coefficient n of the product of two series."""
    return sum(a[k] * b[n - k] for k in range(n + 1))


def _root_term(root: list[FloatArray], square: list[FloatArray], n: int) -> FloatArray:
    """Coefficient n of the square root of a series, 0 where nothing moves."""
    if n == 0:
        return np.sqrt(np.maximum(square[0], 0.0))
    moving = root[0] > 0.0
    rest = square[n] - sum(root[k] * root[n - k] for k in range(1, n))
    return np.where(moving, 0.5 * rest / np.where(moving, root[0], 1.0), 0.0)
