"""Tails and quantiles against scipy.stats, which estim does not import for them."""

from __future__ import annotations

import numpy as np
from scipy import stats

from estim.distributions import (
    chi2_quantile,
    chi2_tail,
    normal_below,
    normal_quantile,
    normal_tail,
    student_quantile,
    student_tail,
)

EQUAL = {"rtol": 1e-12, "atol": 0.0, "strict": True}
Z = np.array([-37.0, -5.0, -1.0, 0.0, 0.3, 2.0, 8.0, 37.0])
P = np.array([1e-300, 1e-12, 0.001, 0.025, 0.16, 0.4, 0.5, 0.84, 0.975, 0.999])
DOFS = np.array([0.7, 1.0, 2.0, 3.5, 11.0, 300.0, np.inf])


def test_normal_distribution():
    np.testing.assert_allclose(normal_below(Z), stats.norm.cdf(Z), **EQUAL)
    np.testing.assert_allclose(normal_tail(Z), stats.norm.sf(Z), **EQUAL)
    np.testing.assert_allclose(normal_quantile(P), stats.norm.ppf(P), **EQUAL)
    np.testing.assert_allclose(-normal_quantile(P), stats.norm.isf(P), **EQUAL)


def test_students_t_with_the_normal_distribution_at_its_end():
    t, dof = Z[:, None], DOFS[None, :]
    np.testing.assert_allclose(student_tail(t, dof), stats.t.sf(t, dof), **EQUAL)
    p = P[1:, None]  # t of 0.7 degrees of freedom at 1e-300 is beyond the largest number
    np.testing.assert_allclose(student_quantile(p, dof), stats.t.ppf(p, dof), **EQUAL)
    np.testing.assert_allclose(-student_quantile(p, dof), stats.t.isf(p, dof), **EQUAL)
    assert np.isnan(
        [
            student_tail(1.0, 0),
            student_quantile(0.9, 0),
            student_tail(1.0, np.nan),
            student_quantile(0.9, np.nan),
        ]
    ).all()


def test_chi_squared():
    chi2, dof = np.array([-1e-9, 0.0, 0.1, 1.0, 7.0, 60.0, 700.0])[:, None], DOFS[None, :-1]
    np.testing.assert_allclose(chi2_tail(chi2, dof), stats.chi2.sf(chi2, dof), **EQUAL)
    p = P[2:, None]
    np.testing.assert_allclose(chi2_quantile(p, dof), stats.chi2.ppf(p, dof), **EQUAL)
    np.testing.assert_allclose(chi2_quantile(1.0 - p, dof), stats.chi2.isf(p, dof), **EQUAL)
    assert np.isnan(chi2_tail(np.nan, 3))
