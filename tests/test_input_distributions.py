"""Distributions of inputs beyond the common ones, against scipy's and against the recipes by which
JCGM 101 draws from them.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from estim.common.errors import InputError
from estim.propagation.copula import copula_matrix, draw_inputs, standard_score
from estim.propagation.inputs import Input, correlation_matrix

SIGMA = math.sqrt(math.log1p(0.4**2))


@pytest.mark.parametrize(
    ("one", "reference"),
    [
        (
            Input.from_half_width("x", 5.0, 2.0, distribution="trapezoidal", shape=0.4),
            stats.trapezoid(0.3, 0.7, 3.0, 4.0),
        ),
        (
            Input.from_half_width("x", 5.0, 2.0, distribution="trapezoidal", shape=0.0),
            stats.triang(0.5, 3.0, 4.0),
        ),
        (
            Input.from_half_width("x", 5.0, 2.0, distribution="trapezoidal", shape=1.0),
            stats.uniform(3.0, 4.0),
        ),
        (Input("x", 5.0, 5.0, "exponential"), stats.expon(scale=5.0)),
        (Input("x", 5.0, 2.0, "exponential"), stats.expon(3.0, 2.0)),
        (
            Input("x", 5.0, 2.0, "lognormal"),
            stats.lognorm(SIGMA, scale=5.0 * math.exp(-0.5 * SIGMA**2)),
        ),
        (Input("x", 5.0, 2.0, "gamma"), stats.gamma(6.25, scale=0.8)),
    ],
)
def test_quantiles_mean_and_standard_deviation_are_those_of_scipy(one, reference):
    z = np.linspace(-5.0, 5.0, 41)
    np.testing.assert_allclose(
        one.value + one.u * standard_score(one, z),
        reference.ppf(stats.norm.cdf(z)),
        rtol=1e-6,
        atol=1e-9,
    )
    assert (reference.mean(), reference.std()) == pytest.approx((one.value, one.u))


@pytest.mark.parametrize("shape", [0.1, 0.5, 1.0])
def test_curvilinear_trapezoid_is_that_of_the_recipe_in_gum_s1_643(shape, rng):
    half, error, n = 2.0, 2.0 * shape, 100_000
    low = 3.0 - error + 2.0 * error * rng.random(n)  # a, known to +/- d; b = (a + b) - a
    recipe = low + (10.0 - 2.0 * low) * rng.random(n)
    one = Input.from_half_width("x", 5.0, half, distribution="curvilinear-trapezoidal", shape=shape)
    drawn = draw_inputs([one], np.eye(1), rng=rng, n_draw=n)["x"]
    assert one.u == pytest.approx(math.sqrt(4.0**2 / 12.0 + error**2 / 9.0))  # JCGM 101, eq. (8)
    assert drawn.std() == pytest.approx(one.u, rel=4.0 / math.sqrt(2.0 * n))
    assert stats.ks_2samp(drawn, recipe).pvalue > 1e-3
    plain = draw_inputs([Input("x", 5.0, one.u, "rectangular")], np.eye(1), rng=rng, n_draw=n)["x"]
    assert stats.ks_2samp(plain, recipe).pvalue < 1e-4


@pytest.mark.parametrize("r", [-0.5, 0.7])
@pytest.mark.parametrize(
    "other",
    [Input("b", 3.0, 2.0), Input("b", 3.0, 2.0, "rectangular"), Input("b", 3.0, 2.0, "lognormal")],
)
def test_copula_meets_the_correlation_where_a_distribution_is_skew(other, r, rng):
    inputs = [Input("a", 1.0, 1.0, "exponential"), other]
    copula = copula_matrix(inputs, correlation_matrix(inputs, {("a", "b"): r}))
    drawn = draw_inputs(inputs, copula, rng=rng, n_draw=200_000)
    assert np.corrcoef(drawn["a"], drawn["b"])[0, 1] == pytest.approx(r, abs=0.012)
    plain = draw_inputs(inputs, np.array([[1.0, r], [r, 1.0]]), rng=rng, n_draw=200_000)
    assert abs(np.corrcoef(plain["a"], plain["b"])[0, 1] - r) > 0.02


def test_copula_meets_the_correlation_of_readings_taken_together_with_another_input(rng):
    """They share the chi-square of their t distribution, the other input does not."""
    inputs = [
        Input("a", 1.0, 1.0, "t", 6.0, group="readings"),
        Input("b", 2.0, 1.0, "t", 6.0, group="readings"),
        Input("c", 3.0, 2.0, "rectangular"),
        Input("d", 4.0, 1.0, "t", 6.0, group="others"),
    ]
    pairs = {("a", "b"): 0.3, ("a", "c"): 0.6, ("b", "d"): 0.6}
    copula = copula_matrix(inputs, correlation_matrix(inputs, pairs))
    drawn = draw_inputs(inputs, copula, rng=rng, n_draw=400_000)
    for (first, second), r in pairs.items():
        assert np.corrcoef(drawn[first], drawn[second])[0, 1] == pytest.approx(r, abs=0.01)
    # on a scale that all their readings share, t distributions have the correlation of the normal
    # variates; without it the two that share none fall short
    assert copula[0, 1] == 0.3
    assert copula[1, 3] > 0.65


def test_skew_quantities_cannot_be_fully_anticorrelated():
    inputs = [Input("a", 1.0, 1.0, "exponential"), Input("b", 1.0, 1.0, "exponential")]
    assert copula_matrix(inputs, correlation_matrix(inputs, {("a", "b"): 1.0}))[
        0, 1
    ] == pytest.approx(1.0)
    # 1 - pi^2/6 = -0.6449
    with pytest.raises(InputError, match=r"between 'a' and 'b' can be -0\.64\d+ to 1\.0000"):
        copula_matrix(inputs, correlation_matrix(inputs, {("a", "b"): -0.7}))
