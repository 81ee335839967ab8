"""The true motion of a rolling body: Lagrange's equation solved by SciPy, every mass and force
written out in SI units.

Shares no code and no formula with `estim/model/`.  The parts are point masses with places r_i(u), u
the angle turned, and moments of inertia I; primes are derivatives with respect to u:

    m(u) u'' + (m'/2) u'^2 = Q,    m = sum m_i r_i'.r_i' + I,    m'/2 = sum m_i r_i'.r_i''

Q are the forces per unit of u.  The force of the ramp is Newton's law for all parts together, N =
n.sum m_i (a_i + g).  The ramp is any curve, given by its tilt along the path of the axle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp, trapezoid

MOST_LEGS = 40


def nothing(_x: float) -> float:
    return 0.0


def _dot(a: complex, b: complex) -> float:
    return a.real * b.real + a.imag * b.imag


@dataclass(frozen=True)
class Truth:
    """Everything that is true of one run; SI units and radians.

    tilt, bend : extra tilt (rad) of the ramp and its derivative (rad/m) at a path x (m) of the
        axle, added to phi.
    gusts : force (N) along the ramp at x (m), for anything else.
    """

    radius: float = 0.15
    gamma: float = 0.187
    kappa: float = 0.45
    rho: float = 1.0
    trailing_fraction: float = 0.0
    particle_gyration: float = 0.0
    mass: float = 0.4
    phi: float = math.radians(4.0)
    theta0: float = math.radians(60.0)
    g: float = 9.81
    release_speed: float = 0.0
    release_place: float = 0.0  # m, from where x and theta0 count
    rolling_resistance: float = 0.0
    load_resistance: float = 0.0
    moment: float = 0.0  # N m
    viscous: float = 0.0  # N s/m
    quadratic: float = 0.0  # N s^2/m^2
    once: tuple[float, float] = (0.0, 0.0)  # amplitude in N m, phase in rad, of a cos(theta - p)
    twice: tuple[float, float] = (0.0, 0.0)
    tilt: Callable[[float], float] = nothing
    bend: Callable[[float], float] = nothing
    gusts: Callable[[float], float] = nothing

    def acceleration(self, u: float, rate: float, sense: float) -> float:
        """u'' where friction acts against `sense` (+1, -1, 0)."""
        particle = self.gamma * self.mass / self.rho
        disk = self.mass * (1.0 - self.trailing_fraction) - particle
        trailing = self.mass * self.trailing_fraction
        x, theta = self.radius * u, self.theta0 + u
        ramp, bend = self.phi + self.tilt(x), self.bend(x)
        # places in the plane of the motion as complex numbers: across + i up
        along = complex(math.cos(ramp), math.sin(ramp))
        up = 1j * along
        arm = self.rho * self.radius * complex(math.cos(theta), -math.sin(theta))
        axle = self.radius * along, self.radius**2 * bend * up
        parts = ((disk + trailing, *axle), (particle, axle[0] + arm, axle[1] - 1j * arm))
        inertia = (disk * self.kappa + particle * self.particle_gyration**2) * self.radius**2
        generalised = sum(m * _dot(first, first) for m, first, _ in parts) + inertia
        centrifugal = sum(m * _dot(first, second) for m, first, second in parts)
        weight = -self.g * sum(m * first.imag for m, first, _ in parts)
        v = self.radius * rate
        moments = -sense * (
            self.moment
            + self.rolling_resistance * self.mass * self.g * math.cos(ramp) * self.radius
        )
        moments += self.radius * (self.gusts(x) - self.viscous * v - self.quadratic * v * abs(v))
        moments -= self.once[0] * math.cos(theta - self.once[1]) + self.twice[0] * math.cos(
            2.0 * theta - self.twice[1]
        )
        # N = up.sum m (first u'' + second u'^2 + g) depends on u'': one linear equation
        grip = sense * self.load_resistance * self.radius
        lever = grip * sum(m * _dot(up, first) for m, first, _ in parts)
        still = grip * sum(
            m * (_dot(up, second) * rate**2 + self.g * up.imag) for m, _, second in parts
        )
        return (weight + moments - still - centrifugal * rate**2) / (generalised + lever)

    def direction(self, u: float) -> float:
        """Where a body at rest starts to: +1, -1, or 0 where friction holds it."""
        return next(
            (sense for sense in (1.0, -1.0) if sense * self.acceleration(u, 0.0, sense) > 0.0), 0.0
        )


@dataclass(frozen=True, eq=False)
class Motion:
    """Dense solution: (begin, end, function t -> (u, rate)) of each leg, in s and rad."""

    truth: Truth
    legs: tuple[tuple[float, float, Callable], ...]

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (m) and velocity (m/s) of the axle at times t (n,) after release; at rest
        before.
        """
        t = np.asarray(t, dtype=float)
        x, v = np.zeros(t.shape), np.zeros(t.shape)
        for begin, end, function in self.legs:
            chosen = (t > begin) & (t <= end)
            if np.any(chosen):
                x[chosen], v[chosen] = self.truth.radius * function(t[chosen])
        return x, v

    @property
    def first_rest(self) -> float:
        """Time (s) of the first turning point; inf where there is none."""
        return self.legs[0][1] if len(self.legs) > 1 else math.inf

    def average_resistance(self, last: float) -> float:
        """The coefficient of rolling resistance that takes as much energy as all that resists, on
        the first way up to the time `last` (s).

        That is: friction, drag, moments, gusts, and the ramp where it is steeper than phi.
        """
        truth = self.truth
        t = np.linspace(0.0, min(last, self.legs[0][1]), 4001)
        x, v = self(t)
        theta, weight = truth.theta0 + x / truth.radius, truth.mass * truth.g
        force = (
            truth.viscous * v
            + truth.quadratic * v * np.abs(v)
            - np.array([truth.gusts(one) for one in x])
        )
        force += (
            truth.moment
            + truth.once[0] * np.cos(theta - truth.once[1])
            + truth.twice[0] * np.cos(2.0 * theta - truth.twice[1])
        ) / truth.radius
        force += weight * (
            np.sin(truth.phi + np.array([truth.tilt(one) for one in x])) - math.sin(truth.phi)
        )
        return (
            float(trapezoid(force, x) / (x[-1] - x[0])) / (weight * math.cos(truth.phi))
            + truth.rolling_resistance
            + truth.load_resistance
        )

    def speed_at(self, x: np.ndarray) -> np.ndarray:
        """Speed (m/s) on the first way at positions x (m), by root search in time; nan where it
        never gets.
        """
        from scipy.optimize import brentq

        begin, end, function = self.legs[0]
        found = np.full(np.shape(x), np.nan)
        for i, wanted in enumerate(np.asarray(x)):
            if wanted <= self.truth.radius * function(end)[0]:
                t = brentq(
                    lambda t, wanted=wanted: self.truth.radius * function(t)[0] - wanted,
                    begin,
                    end,
                    xtol=1e-14,
                )
                found[i] = self.truth.radius * function(t)[1]
        return found


@lru_cache(maxsize=64)
def solve(truth: Truth, last: float) -> Motion:
    """The motion up to the time `last` (s), back and forth; `rtol` 1e-12."""
    legs, begin, state = (
        [],
        0.0,
        np.array([truth.release_place, truth.release_speed]) / truth.radius,
    )
    sense = (
        math.copysign(1.0, truth.release_speed)
        if truth.release_speed
        else truth.direction(state[0])
    )
    for _ in range(MOST_LEGS):
        if sense == 0.0:
            legs.append(
                (
                    begin,
                    math.inf,
                    lambda t, u=state[0]: np.array(
                        [np.full(np.shape(t), u), np.zeros(np.shape(t))]
                    ),
                )
            )
            break

        def at_rest(_t, y):
            return y[1]

        at_rest.direction, at_rest.terminal = -sense, True
        found = solve_ivp(
            lambda _t, y, sense=sense: [y[1], truth.acceleration(y[0], y[1], sense)],
            (begin, last),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            dense_output=True,
            events=at_rest,
            first_step=1e-4,
        )
        if not found.success:
            raise ArithmeticError(found.message)
        legs.append((begin, float(found.t[-1]), found.sol))
        if found.status == 0:
            break
        begin, state = float(found.t[-1]), np.array([found.y[0, -1], 0.0])
        sense = truth.direction(state[0])
    return Motion(truth, tuple(legs))
