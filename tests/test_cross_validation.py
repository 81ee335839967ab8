"""Leave-one-out from draws against the closed form of a normal mean."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

from estim.cross_validation import leave_one_out


def test_leave_one_out_of_a_normal_mean_is_the_exact_one(rng: np.random.Generator) -> None:
    """y ~ N(mu, 1), flat prior: without y_i the next reading is N(mean of the others, 1 + 1/(n - 1))."""
    n, n_draw = 20, 40_000
    y = rng.standard_normal(n)
    draws = y.mean() + rng.standard_normal((n_draw, 1)) / np.sqrt(n)
    log_density = norm.logpdf(y, draws, 1.0)
    exact = np.array([norm.logpdf(y[i], np.delete(y, i).mean(), np.sqrt(1.0 + 1.0 / (n - 1))) for i in range(n)])
    full = norm.logpdf(y, y.mean(), np.sqrt(1.0 + 1.0 / n))  # every reading predicted with itself among the data
    found = leave_one_out(SimpleNamespace(pointwise=lambda _: (log_density,)), draws)
    assert abs(found.elpd - exact.sum()) < 0.03
    assert abs(found.p_loo - (full.sum() - exact.sum())) < 0.03
    np.testing.assert_allclose(found.pointwise[0], exact, atol=0.02)
    assert np.all(found.k_hat[0] < 0.5)
    # weights the wrong way round, proportional to the density, would flatter: even more than no weights at all
    wrong = float(np.sum(logsumexp(2.0 * log_density, axis=0) - logsumexp(log_density, axis=0)))
    assert wrong > full.sum() > found.elpd + 0.5
