"""The exact posterior of independent positions at known times with an unmodelled force, a free
start and errors of scale and clock, by importance sampling.

Written in NumPy alone: nothing of the project is imported.  Every draw solves its own equation of
motion, with its own force.  The coefficients of the force are proposed from the normal distribution
that they would have if the positions were linear in it; the weights make it exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

G, R, SIGMA = 9.81, 0.15, 0.001
N_NODE, N_CAUSE, N_STEP, DOF, BLOCK = 61, 24, 80, 6.0, 4000
NAMES = ("gamma[b]", "kappa[b]", "theta0[r]", "phi[r]", "scale_x", "scale_t", "start")
NAMES += ("release_time[r]", "offset[r]")
SIZES = np.geomspace(0.01, 4.0, 14) * 0.02  # of the force, in units of the weight
# each has a proposal of its own, and so many of the draws: no force, a small one, a large one
PARTS, SHARES, N_ROUND = (None, slice(0, 7), slice(7, 14)), (0.2, 0.25, 0.55), 8

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Posterior:
    """Means and standard deviations in the order of NAMES, P(a > 0) and the effective number of
    draws.
    """

    mean: Floats
    sd: Floats
    p_force: float
    n_eff: float


def positions(t: Floats, p: Floats, force: Floats, end: float) -> Floats:
    """(n_draw, n_obs) read at times t by the clock; p (n_draw, 9) in the order of NAMES.

    force : (n_draw, 2, N_NODE) in units of the weight on the way out and back, linear between nodes
        on the first `end` metres.
    D a + D' v^2/2 = g/R (W' + f),    W' = gamma sin(theta) - sin(phi), by Runge and Kutta's rule
    from rest where start + W = 0
    """
    gamma, kappa, theta0, phi, scale, clock, start, release, offset = (
        np.ascontiguousarray(column) for column in p.T
    )
    tilt, nodes = np.sin(phi), np.ascontiguousarray(force.reshape(-1))
    row, pull = 2 * N_NODE * np.arange(len(p)), G / R

    def acceleration(u: Floats, w: Floats) -> Floats:
        place = np.clip(u * (R / end * (N_NODE - 1)), 0.0, N_NODE - 1.000001)
        left = place.astype(np.int64)
        at, share = row + left + np.where(w < 0.0, N_NODE, 0), place - left
        f = nodes[at] * (1.0 - share) + nodes[at + 1] * share
        theta = theta0 + u
        inertia = 1.0 + (1.0 - gamma) * kappa + gamma + 2.0 * gamma * np.cos(theta + phi)
        return np.asarray(
            (pull * (gamma * np.sin(theta) - tilt + f) + gamma * np.sin(theta + phi) * w * w)
            / inertia
        )

    u = np.zeros(len(p))
    for _ in range(6):
        work = gamma * (np.cos(theta0) - np.cos(theta0 + u)) - u * tilt + start
        u -= work / np.maximum(gamma * np.sin(theta0 + u) - tilt, 0.02)
    since = np.maximum((t - release[:, None]) / (1.0 + clock[:, None]), 0.0)
    h = since.max(axis=1) / N_STEP
    w, path = np.zeros(len(p)), np.empty((3, N_STEP + 1, len(p)))
    for i in range(N_STEP + 1):
        k1 = acceleration(u, w)
        path[:, i] = u, w, k1
        v2 = w + 0.5 * h * k1
        k2 = acceleration(u + 0.5 * h * w, v2)
        v3 = w + 0.5 * h * k2
        k3 = acceleration(u + 0.5 * h * v2, v3)
        v4 = w + h * k3
        k4 = acceleration(u + h * v3, v4)
        u, w = u + h / 6.0 * (w + 2.0 * (v2 + v3) + v4), w + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    step = h[:, None]
    left = np.minimum((since / step).astype(np.int64), N_STEP - 1)
    s = since / step - left
    u0, u1 = (np.take_along_axis(path[0].T, left + i, axis=1) for i in (0, 1))
    w0, w1 = (step * np.take_along_axis(path[1].T, left + i, axis=1) for i in (0, 1))
    angle = (
        u0 * (1.0 + 2.0 * s) * (1.0 - s) ** 2
        + w0 * s * (1.0 - s) ** 2
        + u1 * s**2 * (3.0 - 2.0 * s)
        + w1 * s**2 * (s - 1.0)
    )
    before = t <= release[:, None]
    return np.where(before, 0.0, R * angle) * (1.0 + scale[:, None]) + offset[:, None]


def natural(p: Floats) -> tuple[Floats, Floats]:
    """p with gamma, sin(phi) and start over m = 1 + j, which are all that a motion shows of them
    but for cos(theta + phi), and log |d natural/d p|.
    """
    q, m = p.copy(), 1.0 + p[:, 1] + p[:, 0] * (1.0 - p[:, 1])
    q[:, 0], q[:, 3], q[:, 6] = p[:, 0] / m, np.sin(p[:, 3]) / m, p[:, 6] / m
    return q, np.log((1.0 + p[:, 1]) * np.cos(p[:, 3])) - 4.0 * np.log(m)


def from_natural(q: Floats) -> Floats:
    """The inverse."""
    p = q.copy()
    p[:, 0] = q[:, 0] * (1.0 + q[:, 1]) / (1.0 - q[:, 0] * (1.0 - q[:, 1]))
    m = 1.0 + p[:, 1] + p[:, 0] * (1.0 - p[:, 1])
    p[:, 3], p[:, 6] = np.arcsin(np.clip(q[:, 3] * m, -1.0, 1.0)), q[:, 6] * m
    return p


def shapes(end: float, back_to: float | None) -> tuple[list[Floats], Floats]:
    """Covariances of a force of unit size (2 N_NODE, 2 N_NODE), each way without its mean, and
    their prior probabilities.

    back_to : where the way back ends; None where there is none.  Then the force there is that of
        the way out, another one, or one that turns with the body.
    """
    nodes = np.linspace(0.0, end, N_NODE)
    apart, both = np.abs(nodes[:, None] - nodes), np.ones((2, 2))
    out = np.ones(N_NODE)
    out[[0, -1]] = 0.5
    back = out if back_to is None else np.where(nodes < back_to, 0.0, out)
    centred = np.zeros((2 * N_NODE, 2 * N_NODE))
    for i, weights in enumerate((out, back)):
        here = slice(i * N_NODE, (i + 1) * N_NODE)
        centred[here, here] = np.eye(N_NODE) - np.ones((N_NODE, 1)) * weights / weights.sum()
    lengths = end * np.geomspace(1.0 / 30.0, 0.6, 6)
    prior = np.exp(-0.5 * (np.log(6.0 * lengths / end) / 0.7) ** 2)
    turn, found, logs = np.cos(apart / R) + np.cos(2.0 * apart / R), [], []
    for length, share in zip(lengths, prior / prior.sum(), strict=True):
        q = np.sqrt(3.0) * apart / length
        kernel = (1.0 + q) * np.exp(-q) + turn
        for ways in [both] if back_to is None else [both, np.eye(2)]:
            found.append(centred @ np.kron(ways, kernel) @ centred.T)
            logs.append(share if back_to is None else share / 3.0)
    if back_to is not None:
        found.append(centred @ np.kron(both, turn) @ centred.T)
        logs.append(1.0 / 3.0)
    return found, np.log(logs)


def exact_posterior(
    t: Floats,
    x: Floats,
    *,
    theta0: float,
    phi: float,
    n_draw: int,
    rng: np.random.Generator,
    forced: bool = True,
) -> Posterior:
    """theta0(1.5 deg) and phi(.4 deg) as stated, rad; gamma and kappa uniform in [0, .5] and [0,
    1]; time of release flat.
    """
    end, last = float(x.max()), float(x[-1])
    covariances, log_shapes = shapes(end, last if last < end - 0.05 else None)
    centre = np.array([0.187, 0.5, theta0, phi, 0.0, 0.0, 0.0, 0.0, 0.0])
    stated = np.array(
        [np.inf, np.inf, np.radians(1.5), np.radians(0.4), 0.003, 0.0005, 0.02, np.inf, SIGMA]
    )
    far = np.array([0.3, 0.15, 0.03, 0.005, 0.1, 0.15, 0.02])  # more than ten standard deviations
    slab = SIZES * np.exp(-0.5 * (SIZES / 0.02) ** 2)
    log_slab = np.log(slab / slab.sum())
    none = np.zeros((1, 2, N_NODE))

    def read(p: Floats, force: Floats) -> Floats:
        return positions(t, p, np.broadcast_to(force, (len(p), 2, N_NODE)), end)

    # to begin with: the highest density without a force and with errors five times as large
    steps = np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3, 1e-4])
    at, stiff = centre.copy(), np.diag(stated**-2.0)
    stiff[1, 1] += 9.0
    for _ in range(12):
        both = read(np.vstack([at + np.diag(steps), at - np.diag(steps), at]), none)
        slopes = (both[:9] - both[9:18]).T / (2.0 * steps)
        information = slopes.T @ slopes / (5.0 * SIGMA) ** 2 + stiff
        pull = slopes.T @ (x - both[18]) / (5.0 * SIGMA) ** 2 - stiff @ (at - centre)
        at = at + np.linalg.solve(information, pull)
        at[:2] = np.clip(at[:2], [0.02, 0.02], [0.48, 0.98])
    turn = (natural(at + np.diag(steps))[0] - natural(at - np.diag(steps))[0]).T / (2.0 * steps)
    mean0 = natural(at[None])[0][0]
    cov0 = turn @ np.linalg.inv(information) @ turn.T

    # positions as linear in the force, about a force that is renewed with the proposal
    def linear(at: Floats, about: Floats) -> tuple[Floats, list[Floats], list[Floats]]:
        unit = 1e-4 * np.eye(2 * N_NODE).reshape(-1, 2, N_NODE)
        lots = np.tile(at, (2 * N_NODE, 1))
        lever = (read(lots, about + unit) - read(lots, about - unit)).T / 2e-4 / SIGMA
        roots, seen = [], []
        for covariance in covariances:
            spectrum, basis = np.linalg.eigh(covariance)
            root = basis * np.sqrt(np.maximum(spectrum, 0.0))
            u, s, v = np.linalg.svd(lever @ root, full_matrices=False)
            roots.append(root @ v[:N_CAUSE].T)
            seen.append(u[:, :N_CAUSE] * s[:N_CAUSE])
        return lever @ about.ravel(), roots, seen

    def blocks(
        n: int, sizes: Floats, log_sizes: Floats, mean: Floats, cov: Floats, about: Floats
    ) -> Iterator[tuple[Floats, Floats, Floats, Floats]]:
        middle = from_natural(mean[None])
        shift, roots, seen = linear(middle[0], about)
        root = np.linalg.cholesky(cov)
        log_root = np.sum(np.log(np.diag(root)))
        for _ in range(0, n, BLOCK):
            e, spread = rng.standard_normal((BLOCK, 9)), np.sqrt(DOF / rng.chisquare(DOF, BLOCK))
            p = from_natural(mean + (e * spread[:, None]) @ root.T)
            log_w = 0.5 * (DOF + 9.0) * np.log1p(np.sum(e**2, axis=1) * spread**2 / DOF)
            log_w -= 0.5 * np.sum(np.square((p - centre) / stated), axis=1)
            inside = (p[:, 0] > 0.0) & (p[:, 0] < 0.5) & (p[:, 1] > 0.0) & (p[:, 1] < 1.0)
            inside &= np.all(np.abs(p - centre)[:, 2:] < far, axis=1)
            p[~inside] = middle
            log_w = np.where(inside, log_w + log_root - natural(p)[1], -np.inf)
            # a body of twice the inertia answers half as much
            heavier = (p[:, 0] / natural(p)[0][:, 0] * mean[0] / middle[0, 0])[:, None]
            if not sizes.any():
                off = (x - read(p, none)) / SIGMA
                yield (
                    p,
                    log_w - 0.5 * np.sum(off**2, axis=1),
                    np.zeros(BLOCK),
                    np.zeros((BLOCK, 2, N_NODE)),
                )
                continue
            off = (x - read(p, about * heavier[:, :, None])) / SIGMA + shift
            logs, turned = [], []
            for log_shape, lever in zip(log_shapes, seen, strict=True):
                strength = np.linalg.norm(lever, axis=0)
                along = off @ (lever / strength)
                variance = 1.0 + np.square((sizes / heavier)[:, :, None] * strength)
                evidence = np.square(along)[:, None] * (1.0 - 1.0 / variance) - np.log(variance)
                logs.append(log_shape + log_sizes + 0.5 * np.sum(evidence, axis=2))
                turned.append((strength, along))
            every = np.hstack(logs)
            total = np.logaddexp.reduce(every, axis=1)
            share = np.cumsum(np.exp(every - total[:, None]), axis=1)
            which = np.minimum(np.sum(share < rng.random((BLOCK, 1)), axis=1), every.shape[1] - 1)
            kind, size = which // sizes.size, sizes[which % sizes.size]
            z, force = rng.standard_normal((BLOCK, N_CAUSE)), np.zeros((BLOCK, 2 * N_NODE))
            log_z = -0.5 * np.sum(z**2, axis=1)
            for k, (strength, along) in enumerate(turned):
                mine = kind == k
                reach = size[mine, None] / heavier[mine] * strength
                variance = 1.0 / (1.0 + reach**2)
                log_z[mine] -= 0.5 * np.sum(np.log(variance), axis=1)
                z[mine] = variance * reach * along[mine] + np.sqrt(variance) * z[mine]
                force[mine] = size[mine, None] * z[mine] @ roots[k].T
            force = force.reshape(-1, 2, N_NODE)
            prior = log_shapes[kind] + log_sizes[which % sizes.size]
            log_w += prior - 0.5 * np.sum(z**2, axis=1) - log_z
            log_w -= every[np.arange(BLOCK), which] - total
            log_w -= 0.5 * np.sum(np.square((x - read(p, force)) / SIGMA), axis=1)
            yield p, np.where(np.isfinite(log_w), log_w, -np.inf), size, force / heavier[:, :, None]

    parts = []
    for chosen, share in zip(PARTS if forced else PARTS[:1], SHARES, strict=False):
        sizes = np.zeros(1) if chosen is None else SIZES[chosen]
        log_sizes = np.zeros(1) if chosen is None else log_slab[chosen]
        mean, cov, about = mean0, cov0, none[0]
        for _ in range(N_ROUND):
            draws = blocks(3 * BLOCK, sizes, log_sizes, mean, cov, about)
            p, log_w, size, force = (np.concatenate(part) for part in zip(*draws, strict=True))
            weights = np.exp(log_w - log_w.max())
            weights = np.minimum(weights, np.sort(weights)[-150])
            weights /= weights.sum()
            q = natural(p)[0]
            mean = weights @ q
            cov = 1.2 * ((q - mean) * weights[:, None]).T @ (q - mean)
            about = np.einsum("n,nij->ij", weights, force)
        draws = blocks(int(share * n_draw), sizes, log_sizes, mean, cov, about)
        p, log_w, size, _ = (np.concatenate(part) for part in zip(*draws, strict=True))
        parts.append((p, log_w - np.log(len(p)), size))
    p, log_w, size = (np.concatenate(part) for part in zip(*parts, strict=True))
    weights = np.exp(log_w - log_w.max())
    weights /= weights.sum()
    mean = weights @ p
    return Posterior(
        mean,
        np.sqrt(weights @ np.square(p - mean)),
        float(weights @ (size > 0.0)),
        float(1.0 / np.sum(weights**2)),
    )
