"""The phase curve: speed as a function of position, and where the motion can start and end.

Energy conservation for rolling without slipping (paper, eq. phase_curve, here with rolling
resistance and any body):

    v^2      = 2 g R W/D
    W(theta) = gamma (cos theta0 - cos theta) - (theta - theta0) s
    D(theta) = 1 + j + 2 gamma cos(theta + phi)
    theta = theta0 + x/R,    s = sin phi + c_rr cos phi

All functions broadcast: give `x` shaped (n_obs,) and parameters as scalars or shaped (n_draw, 1) to
get (n_draw, n_obs).  Use `speed` for measured positions in metres and `angular_rate` for measured
angles of rotation.  They hold for motion with theta increasing from rest.  Where energy
conservation leaves no speed (W/D < 0) the speed is 0; behind a turning point W may become positive
again, so ask `turning_angle` what can be reached.

A `release_energy` E0 (weights x R) adds to W: v^2 = 2 g R (E0 + W)/D, `estim.model.forces` has what
else may act.

The triple (gamma, s, 1 + j) multiplied by one factor leaves the curve unchanged: positions and
speeds alone never tell the three apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import BoolArray, FloatArray, bisected
from estim.model.body import Body
from estim.model.forces import Forces, energy_series, inertia, work
from estim.model.time_integration import driven_passage

STANDARD_GRAVITY = 9.80665  # m/s^2, exact by convention (3rd CGPM, 1901)

_FAR = 4.0 * np.pi  # rad, how far a turning point is looked for where it has no closed bracket


def effective_slope(phi: ArrayLike, rolling_resistance: ArrayLike = 0.0) -> FloatArray:
    """s = sin(phi) + c_rr cos(phi), dimensionless: the slope that a body with theta increasing
    works against.
    """
    return np.asarray(np.sin(phi) + np.asarray(rolling_resistance) * np.cos(phi), dtype=float)


def speed(
    x: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
) -> FloatArray:
    """Speed of the axle at position `x` along the ramp, m/s; 0 where the energy does not suffice.

    v = sqrt(max(2 g R (E0 + W)/D, 0)),    theta = theta0 + x/R,    s = sin phi + c_rr cos phi
    W = gamma (cos theta0 - cos theta) - (theta - theta0) s,    D = 1 + j + 2 gamma cos(theta + phi)

    with j the inertia of all that turns / (M R^2) (arXiv 1403.7220, eq. phase_curve, here with
    rolling resistance and any body).

    body : `Body`.  rolling_resistance : c_rr, dimensionless.  g : m/s^2.
    x : (n_obs,) m from the point of release.  The result is (n_obs,), or (n_draw, n_obs) where a
        parameter is (n_draw, 1).
    phi, theta0 : rad.  release_energy : E0, in weights x R; None: at rest.
    forces : what else acts (`Forces`).

    >>> from estim.model import Body, speed
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> speed([0.1, 0.2], body, phi=0.07, theta0=1.0).round(3).tolist()
    [0.383, 0.57]
    """
    turned = np.asarray(x) / body.radius
    ratio = energy_ratio(
        turned,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        release_energy=release_energy,
        forces=forces,
        g=g,
    )
    return np.sqrt(np.maximum(2.0 * np.asarray(g) * body.radius * ratio, 0.0))


def angular_rate(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
) -> FloatArray:
    """Rate of rotation after the body has turned by `angle` since release, rad/s: `speed` divided
    by R.

    rolling_resistance, g : as in `speed`.
    angle : (n_obs,) rad, theta - theta0.
    phi, theta0 : rad.  release_energy, forces : as in `speed`.

    >>> from estim.model import Body, angular_rate
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> angular_rate([0.5, 1.0], body, phi=0.07, theta0=1.0).round(2).tolist()
    [2.14, 3.26]
    """
    ratio = energy_ratio(
        angle,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        release_energy=release_energy,
        forces=forces,
        g=g,
    )
    return np.sqrt(np.maximum(2.0 * np.asarray(g) / body.radius * ratio, 0.0))


def energy_ratio(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
    g: ArrayLike = STANDARD_GRAVITY,
) -> FloatArray:
    """W/D after the body has turned by `angle` (rad) since release, dimensionless; negative where
    it cannot be.

    release_energy : E0, weights x R, added to W; negative: what a body at rest lacks there.
    forces : what else acts.  With drag or resistance by load, by series to 1e-9 m/s
        (`model.time_integration`): 0 where it never gets.
    g : m/s^2, matters only beside viscous drag.
    """
    if forces is not None:
        energy = 0.0 if release_energy is None else np.asarray(release_energy)
        place = {"phi": phi, "theta0": theta0, "rolling_resistance": rolling_resistance}
        if forces.with_speed:
            total = driven_passage(
                angle, body, **place, g=g, release_energy=energy, forces=forces
            ).energy
        else:
            total = energy + work(angle, body, **place, forces=forces)
        return np.asarray(total / inertia(angle, body, phi=phi, theta0=theta0, forces=forces))
    w, d = energy_terms(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance)
    angle = np.asarray(angle, dtype=float)
    # by t = tan(u/4), many times faster than a sine and a cosine; 1 - cos u as 2 sin^2(u/2): no
    # cancellation close to the release
    quarter = np.tan(0.25 * angle)
    square = quarter * quarter
    inverse = 1.0 / (1.0 + square)
    half = 2.0 * quarter * inverse
    functions = (2.0 * half * half, 2.0 * half * ((1.0 - square) * inverse), angle)
    total = (
        _combined(w, functions)
        if release_energy is None
        else np.asarray(release_energy) + _combined(w, functions)
    )
    return total / (d[0] + _combined(d[1:], functions[:2]))


def energy_terms(
    body: Body, *, phi: ArrayLike, theta0: ArrayLike, rolling_resistance: ArrayLike = 0.0
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Coefficients of W and D as sums of functions of the angle u turned since release,
    dimensionless.

    W = gamma cos theta0 (1 - cos u) + gamma sin theta0 sin u - s u D = (1 + j + 2 gamma cos a) - 2
    gamma cos a (1 - cos u) - 2 gamma sin a sin u,    a = theta0 + phi

    Angles that are the same for all draws thus cost two small matrix products and no trigonometry
    for each draw.
    """
    theta0, gamma = np.asarray(theta0), body.gamma
    tilted = theta0 + phi
    across, along = 2.0 * gamma * np.cos(tilted), 2.0 * gamma * np.sin(tilted)
    w = [gamma * np.cos(theta0), gamma * np.sin(theta0), -effective_slope(phi, rolling_resistance)]
    return w, [1.0 + body.inertia_ratio + across, -across, -along]


def _combined(coefficients: list[FloatArray], functions: tuple[FloatArray, ...]) -> FloatArray:
    """sum_i coefficients_i functions_i: a matrix product where coefficients are (n_draw, 1) and
    functions (n_obs,).
    """
    if functions[0].ndim == 1 and any(c.ndim == 2 for c in coefficients):
        shape = np.broadcast(*coefficients).shape
        if len(shape) == 2 and shape[1] == 1:
            columns = np.empty((shape[0], len(coefficients)))
            for i, c in enumerate(coefficients):
                columns[:, i : i + 1] = c
            return np.asarray(columns @ np.array(functions))
    total, *others = (np.asarray(c * f) for c, f in zip(coefficients, functions, strict=True))
    for part in others:
        total = (
            np.add(total, part, out=part) if total.shape == part.shape else np.asarray(total + part)
        )
    return total


def energy_ratio_derivatives(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    order: int,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
    g: ArrayLike = STANDARD_GRAVITY,
) -> list[FloatArray]:
    """H = W/D and its derivatives with respect to theta up to `order`, a list of order + 1 arrays,
    rad^-n, by Taylor series (`forces.energy_series`).

    release_energy, forces, g : as in `energy_ratio`.
    """
    forces = forces or Forces()
    place = {"phi": phi, "theta0": theta0, "rolling_resistance": rolling_resistance}
    ratio = energy_ratio(angle, body, **place, release_energy=release_energy, forces=forces, g=g)
    energy = ratio * inertia(angle, body, phi=phi, theta0=theta0, forces=forces)
    return energy_series(angle, energy, body, **place, g=g, forces=forces, order=order)


def root_derivatives(
    square: FloatArray, slope: FloatArray, gradient: dict[str, FloatArray]
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """sqrt of `square` with the chain rule applied to its slope and gradient, all 0 where `square`
    is not positive.
    """
    moving = square > 0.0
    root = np.sqrt(np.where(moving, square, 0.0))
    half = np.where(moving, 0.5, 0.0) / np.where(moving, root, 1.0)
    return root, half * slope, {name: half * d for name, d in gradient.items()}


def theta_min(
    gamma: ArrayLike, phi: ArrayLike, *, rolling_resistance: ArrayLike = 0.0
) -> FloatArray:
    """Smallest angle of release (rad) from which the body ascends from rest; nan where it never
    does (s > gamma).

    theta_min = asin(s/gamma)      (paper, eq. theta_min)

    gamma : of the body.  phi : rad.  rolling_resistance : c_rr, dimensionless.

    >>> from estim.model import theta_min
    >>> round(float(theta_min(0.19, 0.07)), 3)
    0.377
    """
    slope, gamma = np.broadcast_arrays(effective_slope(phi, rolling_resistance), gamma)
    sine = np.divide(slope, gamma, out=np.full(slope.shape, np.nan), where=gamma > 0.0)
    return np.arcsin(np.where(np.abs(sine) <= 1.0, sine, np.nan))


def theta_max(
    gamma: ArrayLike, phi: ArrayLike, *, rolling_resistance: ArrayLike = 0.0
) -> FloatArray:
    """Largest angle of release (rad) from which the body ascends from rest: pi - theta_min; nan
    where it never does.

    Arguments as in `theta_min`.

    >>> from estim.model import theta_max
    >>> round(float(theta_max(0.19, 0.07)), 3)
    2.765
    """
    return np.pi - theta_min(gamma, phi, rolling_resistance=rolling_resistance)


def ascends(
    body: Body, *, phi: ArrayLike, theta0: ArrayLike, rolling_resistance: ArrayLike = 0.0
) -> BoolArray:
    """Whether the body starts from rest with theta increasing: gamma sin(theta0) > s.

    phi, theta0 : rad.  rolling_resistance : c_rr, dimensionless.  Scalars or arrays.

    >>> from estim.model import Body, ascends
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> bool(ascends(body, phi=0.07, theta0=1.0))
    True
    """
    return np.asarray(body.gamma * np.sin(theta0) > effective_slope(phi, rolling_resistance))


def turning_angle(
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
    g: ArrayLike = STANDARD_GRAVITY,
    far: float = _FAR,
) -> FloatArray:
    """How far the body turns before it stops, rad: the first zero of W beyond theta0, minus theta0.

    0 where it does not start with theta increasing, inf where it never stops (it rolls over the top
    for ever).

    W(theta0 + 2 pi) = -2 pi s: uphill the first zero comes within one turn; downhill later minima
    of W lie higher, so it comes within the first turn or never.  It lies between the maximum of W
    at pi - asin(s/gamma) and the minimum at 2 pi + asin(s/gamma), where halvings find it to the
    last bits.

    With release_energy or forces (as in `speed`) there is no such bracket: it is followed in
    time, (n_draw, 1), up to `far` (rad), and inf where it has not stopped by then.

    phi, theta0 : rad.  rolling_resistance, g : as in `speed`.  Scalars or arrays.

    >>> from estim.model import Body, turning_angle
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> round(float(turning_angle(body, phi=0.07, theta0=1.0)), 2)
    3.08
    """
    if release_energy is not None or forces is not None:
        place = {"phi": phi, "theta0": theta0, "rolling_resistance": rolling_resistance}
        energy = 0.0 if release_energy is None else release_energy
        return driven_passage(
            far, body, **place, g=g, release_energy=energy, forces=forces or Forces()
        ).stop
    gamma, theta0, slope = np.broadcast_arrays(
        body.gamma, theta0, effective_slope(phi, rolling_resistance)
    )
    starts = gamma * np.sin(theta0) > slope
    turns = starts & (np.abs(slope) < gamma)
    # elsewhere it is not asked for
    lowest = np.arcsin(
        np.divide(slope, gamma, out=np.zeros_like(slope), where=np.abs(slope) < gamma)
    )
    start = lowest + np.mod(theta0 - lowest, 2.0 * np.pi)

    def work(angle: FloatArray) -> FloatArray:
        return 2.0 * gamma * np.sin(start + 0.5 * angle) * np.sin(0.5 * angle) - angle * slope

    high = lowest + 2.0 * np.pi - start
    low = np.pi - lowest - start
    turns &= work(high) <= 0.0
    angle = bisected(lambda angle: work(angle) <= 0.0, low, high, 53)
    return np.where(turns, angle, np.where(starts, np.inf, 0.0))


def turning_point(
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    release_energy: ArrayLike | None = None,
    forces: Forces | None = None,
    g: ArrayLike = STANDARD_GRAVITY,
    far: float = _FAR,
) -> FloatArray:
    """Distance from release at which the body stops, m: R times `turning_angle`; inf where it never
    stops.

    Arguments as in `turning_angle`.

    >>> from estim.model import Body, turning_point
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> round(float(turning_point(body, phi=0.07, theta0=1.0)), 3)
    0.462
    """
    angle = turning_angle(
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        release_energy=release_energy,
        forces=forces,
        g=g,
        far=far,
    )
    return np.asarray(body.radius * angle)


def time_derivative(square: list[FloatArray], order: int) -> FloatArray:
    """Time derivative of `order` 2 or 4 of the speed along a curve v^2 = F(x), from [F, F', ...,
    F^(order)].

    With a = F'/2 the acceleration:  v'' = a' v,   v'''' = (a''' v^2 + 3 a a'' + a'^2) v      (' on
    a: d/dx)

    Any consistent units: F as (unit)^2/s^2, result unit/s^(order + 1).
    """
    v = np.sqrt(np.maximum(square[0], 0.0))
    a = [0.5 * f for f in square[1:]]
    if order == 2:
        return np.asarray(a[1] * v)
    if order == 4:
        return np.asarray((a[3] * v**2 + 3.0 * a[0] * a[2] + a[1] ** 2) * v)
    raise ValueError(f"order must be 2 or 4: {order}")
