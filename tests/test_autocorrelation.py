"""The autocorrelation time of a chain, against emcee's and that of a known process."""

from __future__ import annotations

import math

import numpy as np
import pytest
from emcee.autocorr import integrated_time

from estim.sampling.diagnostics import autocorrelation_time, mixing_of


def remembering(
    rng: np.random.Generator, shares: tuple[float, ...], shape: tuple[int, int, int]
) -> np.ndarray:
    """Chains x_k = share x_(k-1) + noise, (n_ensemble, n_step, n_walker, n_par), one share a
    parameter.
    """
    noise = rng.standard_normal((*shape, len(shares)))
    chain = np.zeros_like(noise)
    for step in range(1, shape[1]):
        chain[:, step] = np.array(shares) * chain[:, step - 1] + noise[:, step]
    return chain


@pytest.mark.parametrize("n_step", [64, 65, 700])
def test_time_is_emcees(n_step: int, rng: np.random.Generator) -> None:
    chain = remembering(rng, (0.2, 0.8), (3, n_step, 20))
    emcees = np.mean([integrated_time(ensemble, quiet=True, tol=0) for ensemble in chain], axis=0)
    assert autocorrelation_time(chain) == pytest.approx(np.max(emcees), rel=1e-10)


def test_time_of_an_autoregression_is_known(rng: np.random.Generator) -> None:
    """tau = (1 + share)/(1 - share), 9 for .8.  Error of the sum over a window of M = 45 steps:
    sqrt(2 (2 M + 1)/N) = 1.1 % for N = 1.6e6.
    """
    assert autocorrelation_time(remembering(rng, (0.8,), (4, 20_000, 20))) == pytest.approx(
        9.0, rel=0.044
    )


def test_a_walker_that_never_moved_has_no_time(rng: np.random.Generator) -> None:
    chain = remembering(rng, (0.5,), (2, 100, 10))
    chain[1, :, 3] = 1.0
    assert math.isnan(autocorrelation_time(chain))


def test_a_chain_of_longer_memory_has_fewer_effective_draws(rng: np.random.Generator) -> None:
    mixing = mixing_of(remembering(rng, (0.3, 0.6), (2, 200, 12)))
    assert mixing.ess_bulk[0] > 1.5 * mixing.ess_bulk[1]
