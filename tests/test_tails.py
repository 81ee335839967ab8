"""Shapes of errors: normalised, their residuals and informations by numerical integration, outliers
recognised.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from estim.problem.tails import GAUSSIAN, OutlierMixture, StudentT

VALUES = {"w": np.array(0.07), "k": np.log(12.0)}
SHAPES = {"normal": GAUSSIAN, "t": StudentT(), "mixture": OutlierMixture("w", "k")}


@pytest.fixture(params=SHAPES)
def shape(request):
    return SHAPES[request.param]


def density(shape, z):
    return float(np.exp(shape.log_density(np.array([z]), VALUES))[0])


def integral(function):
    return sum(
        quad(function, a, b, limit=400, epsabs=1e-12)[0]
        for a, b in [(-2000, -60), (-60, -5), (-5, 0), (0, 5), (5, 60), (60, 2000)]
    )


def test_densities_hold_one_unit_of_probability(shape):
    assert integral(lambda z: density(shape, z)) == pytest.approx(1.0, abs=1e-6)


def test_student_t_is_that_of_scipy():
    z = np.linspace(-30, 30, 61)
    np.testing.assert_allclose(
        StudentT(4.0).log_density(z, VALUES), stats.t(4).logpdf(z), rtol=1e-12
    )


def test_half_the_square_of_a_residual_is_the_loss_of_log_density(shape):
    z = np.array([-40.0, -3.0, -1e-3, 0.0, 1e-8, 0.5, 2.0, 17.0])
    residual, slope = shape.deviance_residual(z, VALUES)
    loss = shape.log_density(np.zeros_like(z), VALUES) - shape.log_density(z, VALUES)
    np.testing.assert_allclose(0.5 * residual**2, loss, atol=1e-12)
    assert np.all(residual * z >= 0.0)
    numeric = (
        shape.deviance_residual(z + 1e-4, VALUES)[0] - shape.deviance_residual(z - 1e-4, VALUES)[0]
    ) / 2e-4
    np.testing.assert_allclose(slope, numeric, rtol=2e-5)


def test_information_is_the_mean_square_of_the_score(shape):
    def score(z):
        return (
            -(
                float(shape.log_density(np.array([z + 1e-5]), VALUES)[0])
                - float(shape.log_density(np.array([z - 1e-5]), VALUES)[0])
            )
            / 2e-5
        )

    location, scale = shape.information(VALUES)
    assert location == pytest.approx(
        integral(lambda z: score(z) ** 2 * density(shape, z)), rel=1e-3
    )
    assert scale == pytest.approx(
        integral(lambda z: (z * score(z) - 1.0) ** 2 * density(shape, z)), rel=3e-3
    )


def test_normal_scores_of_drawn_errors_are_normal(shape):
    z = shape.draw(np.random.default_rng(5), 4000, VALUES)
    assert stats.kstest(shape.normal_score(z, VALUES), "norm").pvalue > 0.01
    if shape.robust:
        assert stats.kstest(z, "norm").pvalue < 1e-4


def test_outlier_probability_is_the_share_of_outliers_among_such_frames():
    rng = np.random.default_rng(8)
    n = 400_000
    bad = rng.random(n) < 0.07
    z = rng.standard_normal(n) * np.where(bad, 12.0, 1.0)
    near = np.abs(np.abs(z) - 2.7) < 0.15
    share = bad[near].mean()
    claimed = SHAPES["mixture"].outlier_probability(z[near], VALUES).mean()
    assert abs(claimed - share) < 4.0 * np.sqrt(share * (1 - share) / near.sum())
    precision = rng.gamma(2.0, 1 / 2.0, n)
    z = rng.standard_normal(n) / np.sqrt(precision)
    near = np.abs(np.abs(z) - 5.0) < 0.2
    share = (precision[near] < 1 / 9).mean()
    claimed = StudentT().outlier_probability(z[near], VALUES).mean()
    assert abs(claimed - share) < 4.0 * np.sqrt(share * (1 - share) / near.sum())
