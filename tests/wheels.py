"""A wheel that rolls down, written down a second time: its motion by an integrator, its fits by
least squares; nothing of the engine's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp

G_R, PHI = 9.81 / 0.235, np.radians(-5.5)


@dataclass(frozen=True)
class Wheel:
    """Angle turned u (rad) and its rate w for dw/dt = [acceleration (W' + f) - D' w^2/2]/D."""

    gamma: float = 0.12
    theta0: float = np.radians(5.5)
    c_rr: float = 0.03
    j: float = 0.7

    def inertia(self, u):
        return 1.0 + self.j + 2.0 * self.gamma * np.cos(self.theta0 + u + PHI)

    def energy(self, u):
        return self.gamma * (np.cos(self.theta0) - np.cos(self.theta0 + u)) - u * (
            np.sin(PHI) + self.c_rr * np.cos(PHI)
        )

    def rate(self, u, start=0.0):
        return np.sqrt(2.0 * G_R * np.maximum(self.energy(u) + start, 0.0) / self.inertia(u))

    def motion(self, t, force, start=0.0):
        """u at times t since release, by an ODE solver."""

        def change(_, state):
            u, w = state
            push = (
                self.gamma * np.sin(self.theta0 + u)
                - (np.sin(PHI) + self.c_rr * np.cos(PHI))
                + force(u)
            )
            steeper = -2.0 * self.gamma * np.sin(self.theta0 + u + PHI)
            return [w, (G_R * push - 0.5 * steeper * w**2) / self.inertia(u)]

        w0 = np.sqrt(2.0 * G_R * start / self.inertia(0.0))
        return solve_ivp(
            change, (0.0, t[-1]), [0.0, w0], t_eval=t, rtol=1e-11, atol=1e-12, method="DOP853"
        ).y[0]


# rad; the step of the encoder
FIRST, REFERENCE, SIGMA = 0.3, 0.5, 2.0 * np.pi / 500.0 / np.sqrt(12.0)
FINE = np.linspace(FIRST, 17.0, 700)
# of c_rr, gamma, theta0, E0 and the time at REFERENCE
STEPS = np.array([1e-5, 1e-5, 1e-4, 1e-5, 1e-4])


def places(
    wheel: Wheel, start: float, late: float, t: np.ndarray, work: np.ndarray | float = 0.0
) -> np.ndarray:
    """Angles at times t, for the work F (n_fine,) of a force along FINE."""
    rate = np.sqrt(
        2.0 * G_R * np.maximum(wheel.energy(FINE) + start + work, 1e-5) / wheel.inertia(FINE)
    )
    slowness = 1.0 / rate
    reached = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(FINE))]
    reached += late - np.interp(REFERENCE, FINE, reached)
    inside = np.interp(t, reached, FINE)
    inside = np.where(t < reached[0], FINE[0] + rate[0] * (t - reached[0]), inside)
    return np.where(t > reached[-1], FINE[-1] + rate[-1] * (t - reached[-1]), inside)


@dataclass(frozen=True, eq=False)
class WhiteFit:
    wheel: Wheel
    start: float
    values: np.ndarray  # of the parameters that are free
    residuals: np.ndarray
    jacobian: np.ndarray
    precision: np.ndarray
    pull: np.ndarray
    at: np.ndarray  # (n_obs,) the curve

    @property
    def covariance(self) -> np.ndarray:
        return np.linalg.inv(self.jacobian.T @ self.jacobian / SIGMA**2 + self.precision)


def white_fit(t: np.ndarray, y: np.ndarray, wheel: Wheel, sds: np.ndarray) -> WhiteFit:
    """The mode with white errors; sds (5,) of the priors, 0 for what is exact."""
    free = np.flatnonzero(sds)
    mean = np.array([wheel.c_rr, wheel.gamma, wheel.theta0, 0.0, 0.0])
    precision = np.diag(sds[free] ** -2.0)

    def curve(p):
        return places(replace(wheel, c_rr=p[0], gamma=p[1], theta0=p[2]), p[3], p[4], t)

    def gradient(p):
        return np.array(
            [
                (curve(p + h) - curve(p - h)) / (2.0 * STEPS[i])
                for i, h in zip(free, np.diag(STEPS)[free], strict=True)
            ]
        ).T

    def cost(p):
        return (
            np.sum(np.square(y - curve(p))) / SIGMA**2
            + (p - mean)[free] @ precision @ (p - mean)[free]
        )

    p, damping = mean.copy(), 1e-3
    p[4] = np.interp(REFERENCE, y, t)
    for _ in range(40):
        jacobian, r = gradient(p), y - curve(p)
        information = jacobian.T @ jacobian / SIGMA**2 + precision
        slope = jacobian.T @ r / SIGMA**2 - precision @ (p - mean)[free]
        for _ in range(12):
            trial = p.copy()
            trial[free] += np.linalg.solve(
                information + damping * np.diag(np.diag(information)), slope
            )
            if cost(trial) < cost(p):
                break
            damping *= 10.0
        else:
            break
        gained, p, damping = cost(p) - cost(trial), trial, max(damping / 10.0, 1e-9)
        if gained < 1e-4:
            break
    found = replace(wheel, c_rr=p[0], gamma=p[1], theta0=p[2])
    return WhiteFit(
        found, p[3], p[free], y - curve(p), gradient(p), precision, (mean - p)[free], curve(p)
    )
