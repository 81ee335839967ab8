"""The exact posterior of independent speeds with an unmodelled force, a free start and errors of
scale and clock, by importance sampling.

Written in NumPy alone: nothing of the project is imported, nothing is linear.  The coefficients of
the force are proposed from the normal distribution that they would have if the energies had normal
errors; the weights make it exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

G, R, SIGMA = 9.81, 0.15, 0.02
N_NODE, N_CAUSE, DOF, BLOCK = 60, 25, 5.0, 6000
NAMES = ("gamma[b]", "kappa[b]", "theta0[r]", "phi[r]", "scale_x", "scale_t", "start")

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


def work_by_nodes(x: Floats, nodes: Floats) -> Floats:
    """(n_obs, n_node) int_0^x f dx of a force that is linear between its nodes."""
    h = nodes[1]
    total = h * (np.tril(np.ones((nodes.size, nodes.size))) - 0.5 * np.eye(nodes.size))
    total[:, 0] -= 0.5 * h
    total[0] = 0.0
    place = np.minimum((x / h).astype(int), nodes.size - 2)
    share, rows = x / h - place, np.arange(x.size)
    work = total[place]
    work[rows, place] += h * (share - 0.5 * share**2)
    work[rows, place + 1] += 0.5 * h * share**2
    return work


def causes(x: Floats) -> tuple[Floats, Floats]:
    """Energies at x of unit causes (n_length, n_obs, N_CAUSE) and the prior probabilities of the
    six lengths.
    """
    nodes = np.linspace(0.0, x.max(), N_NODE)
    apart = np.abs(nodes[:, None] - nodes)
    weights = np.ones(N_NODE)
    weights[[0, -1]] = 0.5
    centred = np.eye(N_NODE) - np.ones((N_NODE, 1)) * weights / weights.sum()
    lengths = x.max() * np.geomspace(1.0 / 30.0, 0.6, 6)
    prior = np.exp(-0.5 * (np.log(6.0 * lengths / x.max()) / 0.7) ** 2)
    work, found = work_by_nodes(x, nodes) / R, []
    for length in lengths:
        q = np.sqrt(3.0) * apart / length
        kernel = (1.0 + q) * np.exp(-q) + np.cos(apart / R) + np.cos(2.0 * apart / R)
        spectrum, basis = np.linalg.eigh(centred @ kernel @ centred.T)
        u, s, _ = np.linalg.svd(
            work @ (basis * np.sqrt(np.maximum(spectrum, 0.0))), full_matrices=False
        )
        found.append(u[:, :N_CAUSE] * s[:N_CAUSE])
    return np.array(found), prior / prior.sum()


def exact_posterior(
    x: Floats,
    v: Floats,
    *,
    theta0: float,
    phi: float,
    n_draw: int,
    rng: np.random.Generator,
    forced: bool = True,
) -> Posterior:
    """theta0(1.5 deg) and phi(.4 deg) as stated, rad; gamma and kappa uniform in [0, .5] and [0,
    1].
    """
    unit, lengths = causes(x)
    centre = np.array([0.19, 0.6, theta0, phi, 0.0, 0.0, 0.0])
    stated = np.array([np.inf, np.inf, np.radians(1.5), np.radians(0.4), 0.003, 0.0005, 0.02])

    def log_weights(p: Floats) -> tuple[Floats, Floats]:
        n = len(p)
        gamma, kappa, angle, tilt, scale, clock, start = (p[:, i, None] for i in range(7))
        which = rng.choice(lengths.size, n, p=lengths)
        amplitude = (
            np.where(rng.random(n) < 0.5, 0.0, 0.02 * np.abs(rng.standard_normal(n))) * forced
        )
        theta, stretch = angle + x / (1.0 + scale) / R, (1.0 + scale) / (1.0 + clock)
        energy = gamma * (np.cos(angle) - np.cos(theta)) - (theta - angle) * np.sin(tilt) + start
        inertia = 1.0 + (1.0 - gamma) * kappa + gamma + 2.0 * gamma * np.cos(theta + tilt)
        lever = amplitude[:, None, None] * unit[which]
        read = v / stretch
        moving = np.maximum(np.abs(read), 1.5 * SIGMA)
        sd = SIGMA * moving * inertia / (G * R) / stretch
        off = ((read * np.abs(read) - SIGMA**2) * inertia / (2.0 * G * R) - energy) / sd
        lever_white = lever / sd[:, :, None]
        root = np.linalg.cholesky(
            np.eye(N_CAUSE) + np.einsum("nik,nij->nkj", lever_white, lever_white)
        )
        half = np.linalg.solve(root, np.einsum("nik,ni->nk", lever_white, off)[..., None])
        e = rng.standard_normal((n, N_CAUSE))
        z = np.linalg.solve(root.transpose(0, 2, 1), half + 1.1 * e[..., None])[..., 0]
        log_z = np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1) - 0.5 * np.sum(
            e**2, axis=1
        )
        square = 2.0 * G * R * (energy + np.einsum("nik,nk->ni", lever, z)) / inertia
        log_p = (
            -0.5 * np.sum(((v - np.sqrt(np.maximum(square, 0.0)) * stretch) / SIGMA) ** 2, axis=1)
            - 0.5 * np.sum(z**2, axis=1)
            - log_z
        )
        log_p -= 0.5 * np.sum(np.square((p - centre) / stated)[:, 2:], axis=1)
        inside = (gamma > 0.0) & (gamma < 0.5) & (kappa > 0.0) & (kappa < 1.0)
        return np.where(inside[:, 0], log_p, -np.inf), amplitude

    correlation = np.eye(7)
    for i, j, r in ((0, 1, 0.95), (0, 3, 0.9), (1, 3, 0.85), (2, 6, -0.5)):
        correlation[i, j] = correlation[j, i] = r
    sds = np.array([0.02, 0.22, 0.025, 0.0065, 0.003, 0.0005, 0.004])
    spectrum, basis = np.linalg.eigh(correlation)
    mean, cov = centre, (basis * np.maximum(spectrum, 1e-3)) @ basis.T * np.outer(sds, sds)
    for step in range(9):
        root = 1.3 * np.linalg.cholesky(cov)
        draws, logs, sizes = [], [], []
        for _ in range(0, n_draw if step == 8 else 2 * BLOCK, BLOCK):
            e, spread = rng.standard_normal((BLOCK, 7)), np.sqrt(DOF / rng.chisquare(DOF, BLOCK))
            p = mean + (e * spread[:, None]) @ root.T
            log_w, amplitude = log_weights(p)
            draws.append(p)
            logs.append(
                log_w + 0.5 * (DOF + 7.0) * np.log1p(np.sum(e**2, axis=1) * spread**2 / DOF)
            )
            sizes.append(amplitude)
        p, log_w, amplitude = np.vstack(draws), np.concatenate(logs), np.concatenate(sizes)
        weights = np.exp(log_w - log_w.max())
        weights = weights if step == 8 else np.minimum(weights, np.sort(weights)[-100])
        weights /= weights.sum()
        mean = weights @ p
        cov = ((p - mean) * weights[:, None]).T @ (p - mean)
    return Posterior(
        mean,
        np.sqrt(np.diag(cov)),
        float(weights @ (amplitude > 0.0)),
        float(1.0 / np.sum(weights**2)),
    )
