"""Densities with known moments and evidence, for the tests of samplers and of importance
sampling.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.sampling.chain import Chain
from estim.sampling.diagnostics import effective_size

COV = np.array(
    [[1.0, 0.9, 0.0, 0.0], [0.9, 1.0, 0.0, 0.0], [0.0, 0.0, 4.0, -1.0], [0.0, 0.0, -1.0, 0.5]]
)


@dataclass(frozen=True, eq=False)
class Known:
    """A density with its exact log evidence, means and standard deviations."""

    function: Callable[[np.ndarray], np.ndarray]
    log_evidence: float
    mean: np.ndarray
    sd: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"p{i}" for i in range(self.mean.size))

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return self.function(draws)


def normal(cov: np.ndarray) -> Known:
    precision = np.linalg.inv(cov)
    log_evidence = 0.5 * len(cov) * np.log(2.0 * np.pi) + 0.5 * np.linalg.slogdet(cov)[1]
    return Known(
        lambda x: -0.5 * np.sum(x @ precision * x, axis=1),
        log_evidence,
        np.zeros(len(cov)),
        np.sqrt(np.diag(cov)),
    )


def half_normal(n_par: int) -> Known:
    def log_density(x: np.ndarray) -> np.ndarray:
        return np.where(np.all(x >= 0.0, axis=1), -0.5 * np.sum(x**2, axis=1), -np.inf)

    mean = np.full(n_par, np.sqrt(2.0 / np.pi))
    return Known(log_density, 0.5 * n_par * np.log(0.5 * np.pi), mean, np.sqrt(1.0 - mean**2))


def exponential(n_par: int) -> Known:
    """Most probable where all bounds meet, with a slope there."""

    def log_density(x: np.ndarray) -> np.ndarray:
        return np.where(np.all(x >= 0.0, axis=1), -np.sum(x, axis=1), -np.inf)

    return Known(log_density, 0.0, np.ones(n_par), np.ones(n_par))


def box(n_par: int) -> Known:
    """Flat between hard edges at -1 and 1."""
    log_evidence, sd = n_par * np.log(2.0), np.full(n_par, 1.0 / np.sqrt(3.0))
    return Known(
        lambda x: np.where(np.all(np.abs(x) <= 1.0, axis=1), 0.0, -np.inf),
        log_evidence,
        np.zeros(n_par),
        sd,
    )


def banana(bend: float) -> Known:
    """x normal; y - bend (x^2 - 1) normal: var y = 1 + 2 bend^2."""

    def log_density(x: np.ndarray) -> np.ndarray:
        return -0.5 * x[:, 0] ** 2 - 0.5 * (x[:, 1] - bend * (x[:, 0] ** 2 - 1.0)) ** 2

    return Known(
        log_density, np.log(2.0 * np.pi), np.zeros(2), np.array([1.0, np.sqrt(1.0 + 2.0 * bend**2)])
    )


def bimodal(n_par: int, share: float = 0.3, apart: float = 4.0) -> Known:
    """Unit normals at +apart (weight `share`) and of half the width at -apart, in every
    parameter.
    """

    def log_density(x: np.ndarray) -> np.ndarray:
        narrow = -2.0 * np.sum((x + apart) ** 2, axis=1) + n_par * np.log(2.0) + np.log(1.0 - share)
        return np.logaddexp(-0.5 * np.sum((x - apart) ** 2, axis=1) + np.log(share), narrow)

    mean = (2.0 * share - 1.0) * apart
    sd = np.sqrt(share + 0.25 * (1.0 - share) + apart**2 - mean**2)
    return Known(
        log_density, 0.5 * n_par * np.log(2.0 * np.pi), np.full(n_par, mean), np.full(n_par, sd)
    )


def chain_errors(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """(n_par,) Monte-Carlo standard errors of a chain's means and standard deviations.

    From the effective size of the draws and of their squared deviations, every walker a chain (its
    split halves included).
    """
    deviation = chain.draws - chain.flat.mean(axis=0)
    squares = deviation**2
    spread, of_squares = deviation.std(axis=(0, 1, 2)), squares.std(axis=(0, 1, 2))
    u_mean = spread / np.sqrt(effective_size(chain.draws))
    with np.errstate(divide="ignore", invalid="ignore"):  # walkers that never moved
        return u_mean, of_squares / np.sqrt(effective_size(squares)) / (2.0 * spread)
