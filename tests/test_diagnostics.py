"""R-hat, effective sizes, Pareto smoothing and distances of power-scaling, against arviz-stats,
which shares no code with them.
"""

from __future__ import annotations

import numpy as np
import pytest
from arviz_stats.base import array_stats

from estim.checks.prior_sensitivity import _ALPHAS, _distances
from estim.sampling import mcse_mean, mixing_of, pareto_smoothed
from estim.sampling.diagnostics import effective_size


def remembering(rng: np.random.Generator, share: float, shape: tuple[int, int, int]) -> np.ndarray:
    """Chains (n_ensemble, n_step, n_walker, 1) of x_k = share x_(k-1) + noise."""
    chain = rng.standard_normal((*shape, 1))
    for step in range(1, shape[1]):
        chain[:, step] += share * chain[:, step - 1]
    return chain


def walkers(chain: np.ndarray) -> np.ndarray:
    """(n_ensemble * n_walker, n_step)."""
    return np.moveaxis(chain[..., 0], 1, 2).reshape(-1, chain.shape[1])


@pytest.mark.parametrize("shape", [(4, 90, 8), (2, 91, 6), (3, 4, 2), (2, 5, 4), (2, 11, 3)])
@pytest.mark.parametrize(("share", "digits"), [(0.9, 8), (-0.7, 8), (0.0, 1)])
def test_mixing_is_that_of_arviz(
    shape: tuple[int, int, int], share: float, digits: int, rng: np.random.Generator
) -> None:
    # with one digit most draws have equals, as where moves are rejected
    chain = np.round(remembering(rng, share, shape), digits)
    even = chain[:, shape[1] % 2 :]  # of an odd number of steps the first is left out
    each, mixing = walkers(chain), mixing_of(chain)
    theirs = array_stats.rhat(even[..., 0].reshape(shape[0], -1), chain_axis=0, draw_axis=1)
    assert mixing.rhat[0] == pytest.approx(float(theirs), rel=1e-12)
    for found, of, method, prob in (
        (mixing.ess_bulk, walkers(even), "bulk", None),
        (mixing.ess_tail, walkers(even), "tail", (0.05, 0.95)),
        (effective_size(chain), each, "mean", None),
    ):
        assert found[0] == pytest.approx(
            float(array_stats.ess(of, chain_axis=0, draw_axis=1, method=method, prob=prob)),
            rel=1e-11,
        )
    assert mcse_mean(chain)[0] == pytest.approx(
        float(array_stats.mcse(each, chain_axis=0, draw_axis=1, method="mean")), rel=1e-12
    )


def test_draws_that_say_nothing_have_no_size(rng: np.random.Generator) -> None:
    brief = mixing_of(remembering(rng, 0.0, (2, 3, 4)))
    assert np.isnan([brief.ess_bulk[0], brief.ess_tail[0]]).all()
    assert brief.rhat[0] > 0.0
    assert np.isnan(effective_size(remembering(rng, 0.0, (2, 3, 4)))[0])
    frozen = mixing_of(np.ones((2, 20, 4, 1)))
    assert np.isnan(frozen.rhat[0])
    assert frozen.ess_bulk[0] == 160.0
    gaps = remembering(rng, 0.0, (2, 20, 4))
    gaps[0, 3, 1] = np.nan
    assert np.isnan([mixing_of(gaps).ess_bulk[0], mcse_mean(gaps)[0]]).all()


@pytest.mark.parametrize("n_draw", [60, 200, 226, 4000])
@pytest.mark.parametrize(("dof", "scale"), [(30.0, 0.1), (30.0, 2.0), (4.0, 1.5)])
def test_pareto_smoothing_is_that_of_arviz(
    n_draw: int, dof: float, scale: float, rng: np.random.Generator
) -> None:
    log_ratio = scale * rng.standard_t(dof, n_draw) - 7.0
    log_ratio[rng.random(n_draw) < 0.2] = -np.inf
    with np.errstate(all="ignore"):
        theirs, theirs_k = array_stats.psislw(-log_ratio)
    log_weights, k_hat, log_mean = pareto_smoothed(log_ratio)
    if not np.isfinite(theirs_k):
        assert k_hat == np.inf
        return
    assert k_hat == pytest.approx(float(theirs_k), abs=1e-9)
    np.testing.assert_allclose(log_weights, theirs, atol=1e-9)
    unsmoothed = np.argsort(log_ratio)[: n_draw // 2]
    kept = unsmoothed[np.isfinite(log_ratio[unsmoothed])]
    # below the tail nothing changes
    np.testing.assert_allclose(
        log_weights[kept] + log_mean + np.log(n_draw), log_ratio[kept], atol=1e-9
    )


def test_distances_of_power_scaling_are_those_of_arviz(rng: np.random.Generator) -> None:
    column = np.round(rng.standard_normal(1500), 2)
    pairs = [
        tuple(w / w.sum() for w in (rng.random(1500) ** k, np.exp(0.3 * k * column)))
        for k in (1, 3)
    ]
    pairs[0][0][:500] = 0.0
    theirs = [
        array_stats.power_scale_sense(
            column[None], low[None], high[None], *_ALPHAS, chain_axis=0, draw_axis=1
        )
        for low, high in pairs
    ]
    np.testing.assert_allclose(
        _distances(column, [pairs[0], None, pairs[1]]), [theirs[0], 0.0, theirs[1]], rtol=1e-10
    )
    assert _distances(np.ones(1500), pairs) == [0.0, 0.0]
