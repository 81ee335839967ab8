"""What a fitted curve says beside its values: predictions, criteria, correlations."""

from __future__ import annotations

import math

import lmfit
import numpy as np
import pytest

from estim import fit_curve
from estim.common import InputError
from estim.pipeline import sample_curve
from estim.reports.curve import curve_report
from estim.sampling import Target

X = np.linspace(0.0, 2.0, 14)
Y = 1.0 + 3.0 * X + 0.2 * np.random.default_rng(7).standard_normal(14)
START = {"a": 1.0, "b": 0.0}


def test_the_band_of_a_line_is_that_of_the_textbook() -> None:
    """s^2 (1/n + (x - mean)^2/S_xx) with Student's t (Draper and Smith, Applied Regression
    Analysis, section 1.4).
    """
    from scipy import stats

    at = np.array([-1.0, 1.0, 5.0])
    found = fit_curve("a*x + b", X, Y, start=START).predict(at, probability=0.9)
    slope, intercept = np.polyfit(X, Y, 1)
    s = math.sqrt(float(np.sum((Y - slope * X - intercept) ** 2)) / 12)
    u = s * np.sqrt(1.0 / 14 + (at - X.mean()) ** 2 / np.sum((X - X.mean()) ** 2))
    assert found.value == pytest.approx(slope * at + intercept)
    assert found.u == pytest.approx(u, rel=1e-6)
    assert found.high - found.value == pytest.approx(stats.t.ppf(0.95, 12) * u, rel=1e-6)


def test_a_fit_that_is_not_ok_predicts_without_a_band() -> None:
    fit = fit_curve("a*x + b", X, 5.0 * X**2, u_y=0.01, start=START)
    found = fit.predict(1.0)
    assert fit.status == "poor-fit"
    assert np.isfinite(found.value).all()
    assert np.isnan(found.u).all()
    assert "correlations" not in fit.summary()


@pytest.mark.parametrize("wrong", [np.nan, [[1.0, 2.0]], None, "a"])
def test_places_that_are_none_are_refused(wrong: object) -> None:
    with pytest.raises(InputError, match="'x' must be"):
        fit_curve("a*x + b", X, Y, start=START).predict(wrong)  # type: ignore[arg-type]


def test_criteria_differ_between_curves_as_those_of_lmfit() -> None:
    line, parabola = (
        fit_curve("a*x + b", X, Y, start=START),
        fit_curve("a*x + b + c*x**2", X, Y, start={**START, "c": 0.0}),
    )
    theirs = [
        lmfit.models.PolynomialModel(degree).fit(
            Y, x=X, **{f"c{i}": 0.1 for i in range(degree + 1)}
        )
        for degree in (1, 2)
    ]
    assert parabola.aic - line.aic == pytest.approx(theirs[1].aic - theirs[0].aic, rel=1e-6)
    assert parabola.bic - line.bic == pytest.approx(theirs[1].bic - theirs[0].bic, rel=1e-6)
    assert line.r_squared == pytest.approx(np.corrcoef(X, Y)[0, 1] ** 2)


def test_with_errors_of_unknown_size_it_is_that_of_the_most_probable_size() -> None:
    """-2 ln L at the maximum in the size too, which counts as a parameter."""
    from scipy import stats

    fit = fit_curve("a*x + b", X, Y, start=START)
    left = Y - np.polyval(np.polyfit(X, Y, 1), X)
    best = float(np.sum(stats.norm.logpdf(left, scale=np.sqrt(np.mean(left**2)))))
    assert fit.aic == pytest.approx(-2.0 * best + 2.0 * 3)


def test_with_stated_errors_the_criterion_is_chi2_and_the_normalisation() -> None:
    fit = fit_curve("a*x + b", X, Y, u_y=0.2, start=START)
    assert fit.aic == pytest.approx(fit.chi2 + 14 * math.log(2.0 * math.pi * 0.04) + 4.0)
    assert fit.bic - fit.aic == pytest.approx(2.0 * math.log(14) - 4.0)
    assert math.isnan(fit_curve("a*x + b", X, Y, u_y=0.2, start=START, priors={"a": "3.0(1)"}).aic)


def test_the_summary_has_the_correlation_of_slope_and_intercept() -> None:
    fit = fit_curve("a*x + b", X, Y, u_y=0.2, start=START)
    expected = -X.mean() / math.sqrt(float(np.mean(X**2)))
    assert fit.correlation[0, 1] == pytest.approx(expected, rel=1e-6)
    assert f"b, a: −{abs(expected):.3f}" in fit.summary()
    assert "AIC = " in fit.summary()


def test_the_second_opinion_of_a_line_has_the_covariance_of_the_normal_equations() -> None:
    """Posterior of a line with stated errors: normal."""
    fit = fit_curve("a*x + b", X, Y, u_y=0.2, start=START)
    found = sample_curve(fit, seed=1, target=Target(ess=300.0))
    certificate, design = found.certificate, np.column_stack([X, np.ones(X.size)])
    assert found.comparison.verdict == "agree"
    sds = 0.2 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    assert np.all(np.abs(certificate.sd - sds) < 4.0 * certificate.mcse_sd)
    assert np.all(certificate.mcse_sd < 0.015 * sds)
    report = curve_report(fit, found, title="Line", kind="synthetic", figures="none")
    shown = (
        f"({certificate.n_draw} draws with an effective sample size of {round(certificate.ess)};"
    )
    assert shown in " ".join(report["report.md"].decode().split())
