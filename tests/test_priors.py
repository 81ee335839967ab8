"""Priors: densities by numerical integration, residuals against densities, draws against
moments.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import astuple
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from uncertainties import ufloat

from estim import Binomial, InputError, fit_curve
from estim.campaign.prior_table import PriorTable, read_prior
from estim.common.labels import Notation
from estim.problem.priors import PRIORS as KINDS
from estim.problem.priors import (
    Beta,
    HalfNormal,
    LogNormal,
    Normal,
    TruncatedNormal,
    Uniform,
    Unstated,
    of_other_package,
)

PRIORS = [
    pytest.param(Normal(0.187, 0.01), stats.norm(0.187, 0.01), id="normal"),
    pytest.param(
        TruncatedNormal(0.02, 0.03, 0.0, math.inf),
        stats.truncnorm(-2 / 3, math.inf, 0.02, 0.03),
        id="cut-below",
    ),
    pytest.param(
        TruncatedNormal(0.5, 0.4, 0.2, 0.9),
        stats.truncnorm(-0.75, 1.0, 0.5, 0.4),
        id="cut-on-both-sides",
    ),
    pytest.param(
        TruncatedNormal(-0.1, 0.05, 0.0, math.inf),
        stats.truncnorm(2.0, math.inf, -0.1, 0.05),
        id="mean-outside",
    ),
    pytest.param(
        TruncatedNormal(1.2, 0.05, -math.inf, 1.0),
        stats.truncnorm(-math.inf, -4.0, 1.2, 0.05),
        id="cut-above",
    ),
    pytest.param(Uniform(-0.3, 0.6), stats.uniform(-0.3, 0.9), id="uniform"),
    pytest.param(HalfNormal(0.005), stats.halfnorm(0.0, 0.005), id="half-normal"),
    pytest.param(LogNormal(0.001, 0.5), stats.lognorm(0.5, 0.0, 0.001), id="log-normal"),
    pytest.param(Beta(0.6, 0.1), stats.beta(13.8, 9.2), id="beta"),
    pytest.param(
        Beta(2.5, 0.5, 0.0, 10.0), stats.beta(18.5, 55.5, 0.0, 10.0), id="beta-between-limits"
    ),
]

ALONE = [pytest.param(case.values[0], id=case.id) for case in PRIORS]


def _inside(law, n=41):
    return law.ppf(np.linspace(0.01, 0.99, n))


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_density_integrates_to_one(prior, law):
    breaks = law.ppf([1e-13, 0.001, 0.5, 0.999, 1 - 1e-13])
    total = sum(
        quad(lambda v: math.exp(float(prior.log_density(v))), a, b, epsabs=1e-12)[0]
        for a, b in pairwise(breaks)
    )
    assert total == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_density_support_and_moments_are_those_of_the_law(prior, law):
    value = _inside(law)
    assert prior.log_density(value) == pytest.approx(law.logpdf(value), rel=1e-9, abs=1e-9)
    assert prior.sd == pytest.approx(law.std(), rel=1e-9)
    assert prior.expectation == pytest.approx(law.mean(), rel=1e-9)
    assert (prior.low, prior.high) == pytest.approx(law.support())


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_half_the_squared_residual_is_minus_the_log_density_up_to_a_constant(prior, law):
    value = _inside(law)
    constant = np.array([0.5 * prior.residual(float(v)) ** 2 for v in value]) + prior.log_density(
        value
    )
    assert np.ptp(constant) < 1e-9
    if not isinstance(prior, Uniform):
        assert np.ptp(prior.log_density(value)) > 0.1


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_residual_slope_is_the_difference_quotient(prior, law):
    for v in _inside(law, 7):
        step = 1e-5 * law.std()
        numeric = (prior.residual(v + step) - prior.residual(v - step)) / (2 * step)
        assert prior.residual_slope(v) == pytest.approx(numeric, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_quantiles_are_those_of_the_law(prior, law):
    probability = np.array([[1e-6, 0.01, 0.3], [0.5, 0.9, 1.0 - 1e-6]])
    assert prior.quantile(probability) == pytest.approx(
        law.ppf(probability), rel=1e-9, abs=1e-9 * law.std()
    )


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_a_prior_says_of_many_values_what_it_says_of_each(prior, law):
    value = _inside(law, 6).reshape(3, 2)
    for ask in (
        prior.log_density,
        prior.residual,
        prior.residual_slope,
        prior.pull,
        prior.quantile,
    ):
        given = law.cdf(value) if ask == prior.quantile else value
        assert ask(given) == pytest.approx(
            np.array([[float(ask(v)) for v in row] for row in given]), rel=1e-12
        )


@pytest.mark.parametrize("prior", ALONE)
def test_a_prior_is_what_its_table_in_a_file_says_in_any_unit(prior):
    kind = next(name for name, one in KINDS.items() if one is type(prior))
    fields = dict(zip(prior.keys, astuple(prior), strict=False)) | {
        key: getattr(prior, key) for key in prior.optional
    }
    text = ", ".join(
        f"{key} = {number!r}" for key, number in fields.items() if math.isfinite(number)
    )
    table = msgspec.convert(
        tomllib.loads(f'table = {{prior = "{kind}", {text}}}')["table"], PriorTable
    )
    assert read_prior(table, factor=1.0, field="a") == prior
    value, other = prior.centre + 0.1 * prior.sd, read_prior(table, factor=1e-3, field="a")
    assert other.log_density(1e-3 * value) + math.log(1e-3) == pytest.approx(
        prior.log_density(value)
    )


@pytest.mark.parametrize("prior", ALONE)
def test_a_measurement_of_a_true_value_is_as_far_from_it_as_was_asked(prior):
    truth = prior.centre
    for z in (-0.5, 1.2):
        again = prior.measured_again(truth, z)
        assert float(again.pull(truth)) == pytest.approx(-z) if prior.measured else again is prior


@pytest.mark.parametrize("prior", ALONE)
def test_a_wider_prior_pulls_less_from_the_same_place(prior):
    wider = prior.widened(2.0)
    if wider is not prior:
        assert wider.pull(prior.centre) - wider.pull(
            prior.centre - 0.1 * prior.sd
        ) == pytest.approx(
            0.5 * (prior.pull(prior.centre) - prior.pull(prior.centre - 0.1 * prior.sd))
        )
    assert (wider is prior) == isinstance(prior, Uniform | Beta)
    assert Normal(5.0, 1.0, low=-4.0).widened(2.0) == TruncatedNormal(5.0, 2.0, -4.0)


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_draws_follow_the_law(prior, law, rng):
    n = 20_000
    draws = prior.draw(rng, n)
    assert draws.shape == (n,)
    assert np.all((draws >= prior.low) & (draws <= prior.high))
    assert draws.mean() == pytest.approx(law.mean(), abs=4 * law.std() / math.sqrt(n))
    kurtosis = float(law.stats(moments="k"))
    assert draws.std() == pytest.approx(law.std(), rel=4 * math.sqrt((kurtosis + 2) / (4 * n)))
    assert stats.kstest(draws, law.cdf).pvalue > 1e-4
    # a law five per cent wider would be noticed
    assert (
        stats.kstest(draws, lambda v: law.cdf(law.median() + (v - law.median()) / 1.05)).pvalue
        < 0.05
    )


@pytest.mark.parametrize("prior", ALONE)
def test_the_same_generator_gives_the_same_draws(prior):
    a, b, c = (prior.draw(np.random.default_rng(seed), 5) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_a_fit_may_start_at_the_centre(prior, law):
    assert prior.low < prior.centre < prior.high or math.isinf(prior.low)
    assert np.isfinite(prior.log_density(prior.centre))
    assert 0.01 < law.cdf(prior.centre) < 0.99


@pytest.mark.parametrize("prior", ALONE)
def test_density_takes_any_shape_and_is_zero_outside_the_support(prior):
    assert prior.log_density(np.full((3, 1), prior.centre)).shape == (3, 1)
    assert np.shape(prior.log_density(prior.centre)) == ()
    for outside in (prior.low - 1e-6, prior.high + 1e-6):
        if math.isfinite(outside):
            assert prior.log_density(outside) == -math.inf
            assert prior.log_density(np.array([prior.centre, outside]))[1] == -math.inf


def test_mode_of_the_log_normal_lies_below_its_median():
    # the residual is zero at the mode exp(mu - sd^2), where the density is largest
    prior = LogNormal(0.3, 0.5)
    mode = 0.3 * math.exp(-0.25)
    assert prior.residual(mode) == pytest.approx(0.0, abs=1e-14)
    grid = np.linspace(0.05, 1.0, 100_001)
    assert grid[np.argmax(prior.log_density(grid))] == pytest.approx(mode, abs=2e-5)


def test_a_cut_far_away_changes_nothing():
    value = np.linspace(0.1, 0.3, 9)
    assert TruncatedNormal(0.2, 0.01, 0.0, math.inf).log_density(value) == pytest.approx(
        Normal(0.2, 0.01).log_density(value), abs=1e-12
    )


def test_a_wide_cut_normal_tends_to_the_half_normal():
    value = np.linspace(0.0, 0.02, 9)
    assert TruncatedNormal(0.0, 0.005, 0.0, math.inf).log_density(value) == pytest.approx(
        HalfNormal(0.005).log_density(value), abs=1e-12
    )


def test_log_normal_keeps_clear_of_zero_and_below():
    assert LogNormal(1.0, 1.0).log_density(np.array([0.0, -1.0])).tolist() == [-math.inf, -math.inf]
    assert math.isfinite(LogNormal(1.0, 1.0).residual(0.0))
    assert math.isfinite(LogNormal(1.0, 1.0).residual_slope(0.0))


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Normal(0.0, 0.0), "'sd' must be > 0 and finite: 0.0"),
        (lambda: Normal(0.0, -1.0), "'sd' must be > 0 and finite: -1.0"),
        (lambda: Normal(0.0, math.nan), "'sd' must be > 0 and finite: nan"),
        (lambda: Normal(0.0, math.inf), "'sd' must be > 0 and finite: inf"),
        (
            lambda: Normal(0.0, 1.0, low=-1.0),
            "'low' must be 8 standard deviations or more from the mean: a nearer limit makes",
        ),
        (
            lambda: Normal(0.0, 1.0, high=7.9),
            "'high' must be 8 standard deviations or more from the mean",
        ),
        (lambda: Normal(0.0, 1.0, low=math.nan), "'low' must be 8 standard deviations"),
        (lambda: TruncatedNormal(0.0, 0.0, 0.0, 1.0), "'sd' must be > 0 and finite: 0.0"),
        (lambda: TruncatedNormal(0.0, 1.0, 1.0, 1.0), "'low' must be below 'high': 1.0"),
        (lambda: TruncatedNormal(0.0, 1.0, math.nan, 1.0), "'low' must be below 'high': nan"),
        (
            lambda: TruncatedNormal(-20.0, 1.0, 0.0, math.inf),
            "'mean' must leave some of the normal distribution",
        ),
        (lambda: Uniform(1.0, 1.0), "'low' must be below 'high': 1.0"),
        (lambda: Uniform(0.0, math.inf), "'low, high' must be finite for a uniform prior"),
        (lambda: Beta(0.5, 0.0), "'sd' must be > 0 and finite: 0.0"),
        (
            lambda: Beta(0.5, 0.3),
            "'sd' must be so small that the density has its peak between 'low' and 'high': 0.3",
        ),
        (lambda: Beta(1.5, 0.1), "'mean' must lie between 'low' and 'high': 1.5"),
        (lambda: Beta(0.5, 0.1, 0.0, math.inf), "'low' must be below 'high', and both finite: 0.0"),
        (lambda: HalfNormal(0.0), "'scale' must be > 0 and finite: 0.0"),
        (lambda: LogNormal(0.0, 1.0), "'median' must be > 0 and finite: 0.0"),
        (lambda: LogNormal(1.0, -1.0), "'log_sd' must be > 0 and finite: -1.0"),
    ],
)
def test_impossible_priors_are_refused(make, told):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith(told)


@pytest.mark.parametrize("limit", ["low", "high"])
def test_a_prior_without_limits_of_its_own_takes_none(limit):
    """They were taken and ignored: the density went on below the stated limit."""
    for make, sizes in ((HalfNormal, (1.0,)), (LogNormal, (1.0, 0.5))):
        assert (make(*sizes).low, make(*sizes).high) == (0.0, math.inf)
        with pytest.raises(TypeError, match=f"unexpected keyword argument '{limit}'"):
            make(*sizes, **{limit: 3.0})
        with pytest.raises(TypeError):
            make(*sizes, 3.0)


@pytest.mark.parametrize("mean", [math.nan, math.inf])
def test_a_mean_that_is_no_number_is_refused(mean):
    with pytest.raises(InputError):
        Normal(mean, 1.0)
    with pytest.raises(InputError):
        TruncatedNormal(mean, 1.0, 0.0, 1.0)


@pytest.mark.parametrize("prior", ALONE)
def test_priors_describe_themselves(prior):
    words = prior.describe()
    beta = ("beta, 0.6 ± 0.1 in [0, 1]", "beta, 2.5 ± 0.5 in [0, 10]")
    assert words.startswith(
        (
            "normal",
            "uniform in [-0.3, 0.6]",
            "half-normal, scale 0.005",
            "log-normal, median 0.001",
            *beta,
        )
    )


def test_the_unit_stands_at_the_median_and_what_nobody_stated_is_not_called_stated():
    assert LogNormal(0.1, 0.5).describe("°C") == "log-normal, median 0.1 °C, log sd 0.5"
    label = Notation("σ_y").label("°C")
    assert LogNormal(0.1, 0.5).stated_words("°C", label) == "log-normal, median 0.1 °C, log sd 0.5"
    size = Unstated(0.3238, 3.0)
    assert size.describe("°C") == "inferred; weak prior, within a factor 20 of 0.32 °C"
    assert size.stated_words("°C", label) == ""
    assert size.log_density(0.2) == LogNormal(0.3238, 3.0).log_density(0.2)


def test_a_log_normal_prior_of_any_width_that_is_taken_has_a_standard_deviation():
    assert math.isfinite(LogNormal(1e100, 10.0).sd)
    for log_sd in (10.1, 1e99):
        with pytest.raises(InputError, match="'log_sd' must be at most 10 "):
            LogNormal(1.0, log_sd)


def test_a_beta_prior_and_counted_successes_make_a_beta_posterior():
    """Conjugate: 27 successes of 40 add to the exponents of the density, of which the mode and the
    curvature there follow.
    """
    prior = Beta(0.6, 0.1)
    fit = fit_curve(
        "p + 0*x",
        [0.0, 1.0],
        [14, 13],
        noise=Binomial([20, 20]),
        start={"p": 0.5},
        priors={"p": prior},
    )
    a, b = 12.8 + 27.0, 8.2 + 13.0
    assert fit.values["p"] == pytest.approx(a / (a + b), rel=1e-6)
    assert fit.sds["p"] == pytest.approx(math.sqrt(a * b / (a + b) ** 3), rel=0.02)


@pytest.mark.parametrize(
    ("frozen", "own"),
    [
        (stats.norm(1.0, 0.2), Normal(1.0, 0.2)),
        (stats.norm(scale=0.2, loc=1.0), Normal(1.0, 0.2)),
        (stats.uniform(-1.0, 3.0), Uniform(-1.0, 2.0)),
        (stats.halfnorm(scale=2.0), HalfNormal(2.0)),
        (stats.lognorm(0.3, scale=5.0), LogNormal(5.0, 0.3)),
        (stats.truncnorm(-1.0, 2.0, 1.0, 0.2), TruncatedNormal(1.0, 0.2, 0.8, 1.4)),
        (stats.beta(2.0, 3.0, loc=1.0, scale=2.0), Beta(1.8, 0.4, 1.0, 3.0)),
    ],
)
def test_frozen_distribution_of_scipy_is_the_same_density(frozen, own):
    taken = of_other_package(frozen, "priors[b]")
    assert type(taken) is type(own)
    for prior in (taken, own):
        at = frozen.ppf([0.02, 0.3, 0.5, 0.9])
        np.testing.assert_allclose(prior.log_density(at), frozen.logpdf(at), rtol=1e-9)


def test_distributions_that_are_no_prior_are_refused_by_name():
    for frozen in (stats.gamma(2.0), stats.lognorm(0.2, loc=1.0)):
        with pytest.raises(InputError, match=r"'priors\[b\]' must be one of norm, .*scipy\.stats"):
            of_other_package(frozen, "priors[b]")


def test_fit_takes_measured_values_of_uncertainties_and_of_scipy():
    x = np.linspace(0.0, 10.0, 20)
    y = 2.0 * x + 1.0 + np.random.default_rng(1).normal(0.0, 0.3, 20)
    fits = [
        fit_curve("a*x + b", x, y, u_y=0.3, priors={"b": prior})
        for prior in ("1.0(2)", ufloat(1.0, 0.2), stats.norm(1.0, 0.2))
    ]
    assert fits[0].values == fits[1].values == fits[2].values
    assert fits[0].sds["b"] < fit_curve("a*x + b", x, y, u_y=0.3).sds["b"]
