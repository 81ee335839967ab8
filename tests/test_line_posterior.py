"""The Bayesian line: brute-force integrals, symmetries, evidence.  Its coverage is tested with the
fit's in ``test_line.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from estim.common.errors import InputError
from estim.line.analysis import intercept_evidence, weigh_line
from estim.line.posterior import line_posterior, without_intercept
from estim.line.regression import fit_line


@pytest.fixture
def rng():
    return np.random.default_rng(20140328)


def measured(rng, *, n_obs=15, intercept=1.0, slope=-1.7, scatter=0.0):
    """Points with uneven, correlated errors and scatter about a line."""
    truth = rng.uniform(0.0, 5.0, n_obs)
    u_x, u_y, r = (
        rng.uniform(0.05, 0.4, n_obs),
        rng.uniform(0.05, 0.6, n_obs),
        rng.uniform(-0.8, 0.8, n_obs),
    )
    e_x = rng.standard_normal(n_obs)
    e_y = r * e_x + np.sqrt(1.0 - r**2) * rng.standard_normal(n_obs)
    y = intercept + slope * truth + scatter * rng.standard_normal(n_obs)
    return truth + u_x * e_x, y + u_y * e_y, {"u_x": u_x, "u_y": u_y, "r_xy": r}


def credible_interval(sample, name, *, probability=0.95):
    """Equal-tailed interval of one parameter."""
    ends = [0.5 * (1.0 - probability), 0.5 * (1.0 + probability)]
    return tuple(np.quantile(sample.draws[:, sample.names.index(name)], ends))


def log_prior(p, x, y, *, scatter=None, zeros=()):
    """The documented prior, written again: angle, spread along the line, scatter, zero offsets."""
    ratio = np.std(x) / np.std(y)
    beta = p["slope"] * ratio
    spread = np.exp(p["log_tau"]) / np.std(x) * np.sqrt(1.0 + beta**2)
    total = (
        stats.cauchy.logpdf(beta)
        + np.log(ratio)
        + stats.halfcauchy.logpdf(spread, scale=np.sqrt(2.0))
        + np.log(spread)
    )
    if scatter is not None:
        total += stats.halfnorm.logpdf(np.exp(p["log_scatter"]), scale=scatter) + p["log_scatter"]
    return total + sum(stats.norm.logpdf(p[name], scale=u) for name, u in zeros)


# the density


def test_density_equals_numerical_integration_over_the_true_abscissas(rng):
    x, y, u = measured(rng, n_obs=4)
    posterior = line_posterior(x, y, **u, scatter=0.5, u_zero_x=0.1, u_zero_y=0.2)
    assert posterior.names == (
        "intercept",
        "slope",
        "mu_x",
        "log_tau",
        "log_scatter",
        "zero_x",
        "zero_y",
    )
    values = np.array([1.2, -1.5, 2.4, 0.3, -0.8, 0.05, -0.1])
    p = dict(zip(posterior.names, values, strict=True))
    expected = log_prior(p, x, y, scatter=0.5, zeros=(("zero_x", 0.1), ("zero_y", 0.2)))
    sd = np.exp(p["log_scatter"])
    for k in range(4):
        cross = u["r_xy"][k] * u["u_x"][k] * u["u_y"][k]
        errors = stats.multivariate_normal(
            [0.0, 0.0], [[u["u_x"][k] ** 2, cross], [cross, u["u_y"][k] ** 2 + sd**2]]
        )

        def integrand(xi, k=k, errors=errors):
            e = (x[k] - xi - p["zero_x"], y[k] - p["intercept"] - p["slope"] * xi - p["zero_y"])
            return errors.pdf(e) * stats.norm.pdf(xi, p["mu_x"], np.exp(p["log_tau"]))

        expected += np.log(
            integrate.quad(
                integrand,
                x[k] - 5.0,
                x[k] + 5.0,
                points=[x[k]],
                epsabs=0.0,
                epsrel=1e-11,
                limit=200,
            )[0]
        )
    assert posterior.log_density(values[None])[0] == pytest.approx(expected, rel=1e-10)


def test_density_is_the_same_with_x_and_y_exchanged(rng):
    x, y, u = measured(rng)
    there = line_posterior(x, y, **u)
    back = line_posterior(y, x, u_x=u["u_y"], u_y=u["u_x"], r_xy=u["r_xy"])
    draws = there.start + 0.2 * rng.standard_normal((50, 4))
    a, b, mu, log_tau = draws.T
    exchanged = np.column_stack([-a / b, 1.0 / b, a + b * mu, log_tau + np.log(np.abs(b))])
    jacobian = 2.0 * np.log(np.abs(b))
    assert there.log_density(draws) == pytest.approx(
        back.log_density(exchanged) - jacobian, rel=1e-12
    )


def test_density_moves_with_units_and_shifts_and_not_with_the_order(rng):
    x, y, u = measured(rng)
    order = rng.permutation(len(x))
    moved = line_posterior(
        1e-3 * x[order] + 2.0,
        50.0 * y[order],
        u_x=1e-3 * u["u_x"][order],
        u_y=50.0 * u["u_y"][order],
        r_xy=u["r_xy"][order],
    )
    still = line_posterior(x, y, **u)
    draws = still.start + 0.2 * rng.standard_normal((50, 4))
    a, b, mu, log_tau = draws.T
    slope = 5e4 * b
    difference = still.log_density(draws) - moved.log_density(
        np.column_stack([50.0 * a - 2.0 * slope, slope, 1e-3 * mu + 2.0, log_tau + np.log(1e-3)])
    )
    assert difference == pytest.approx(np.full(50, difference[0]), abs=1e-8)


def test_extreme_parameters_have_no_density_and_no_warning(rng):
    x, y, u = measured(rng)
    posterior = line_posterior(x, y, **u, scatter=1.0)
    draws = np.tile(posterior.start, (6, 1))
    draws[0, 3], draws[1, 3], draws[2, 4], draws[3, 1], draws[4, 4], draws[5, 3] = (
        1e4,
        -1e4,
        1e4,
        1e300,
        -1e4,
        np.nan,
    )
    log_density = posterior.log_density(draws)
    assert not np.any(np.isnan(log_density))
    assert np.all(log_density[[0, 2, 3, 5]] == -np.inf)
    assert np.all(log_density[[1, 4]] < posterior.log_density(posterior.start[None]) - 1e3)


# the draws


@pytest.mark.parametrize("slope", [1e-6, 1e6])
def test_draws_agree_with_the_york_line_for_well_known_lines(rng, slope):
    truth = np.linspace(0.0, 1.0, 30)
    x, y = (
        truth + 0.005 * rng.standard_normal(30),
        slope * (3.0 + truth + 0.005 * rng.standard_normal(30)),
    )
    fit, posterior = (
        fit_line(x, y, u_x=0.005, u_y=0.005 * slope),
        line_posterior(x, y, u_x=0.005, u_y=0.005 * slope),
    )
    sample, error = weigh_line(posterior, rng=rng), fit.standard_errors["propagated"]
    assert abs(sample.mean[1] - fit.slope) < 0.1 * error.u_slope
    for column, u in ((0, error.u_intercept), (1, error.u_slope)):
        assert abs(sample.sd[column] - u) < 0.02 * u + 4.0 * sample.mcse_sd[column]


def test_unknown_scatter_alone_gives_the_ordinary_line(rng):
    x = np.linspace(0.0, 10.0, 60)
    y = 2.0 + 0.3 * x + 0.5 * rng.standard_normal(60)
    fit, posterior = fit_line(x, y), line_posterior(x, y, scatter=10.0)
    sample = weigh_line(posterior, rng=rng)
    error = fit.standard_errors["scaled"]
    for name, estimate, u in (
        ("intercept", fit.intercept, error.u_intercept),
        ("slope", fit.slope, error.u_slope),
    ):
        half = stats.t.ppf(0.975, fit.dof) * u
        # 4000 effective draws give the quantiles a Monte-Carlo sd of 0.04 sds; the priors of angle
        # and scatter move them by 0.05
        assert credible_interval(sample, name) == pytest.approx(
            (estimate - half, estimate + half), abs=0.2 * u
        )


def test_common_zero_offsets_widen_the_intercept_and_nothing_else(rng):
    x, y, u = measured(rng)
    plain, offset = (
        weigh_line(line_posterior(x, y, **u, **choice), rng=rng, n_draw=40_000)
        for choice in ({}, {"u_zero_x": 0.3, "u_zero_y": 0.5})
    )
    apart = np.abs(offset.mean[:4] - plain.mean)
    assert np.all(apart < 4.0 * np.hypot(offset.mcse_mean[:4], plain.mcse_mean))
    wider = np.hypot(plain.sd[0], np.hypot(0.5, 0.3 * plain.mean[1]))
    assert abs(offset.sd[0] - wider) < 0.01 * wider + 4.0 * offset.mcse_sd[0]
    assert abs(offset.sd[1] - plain.sd[1]) < 4.0 * np.hypot(offset.mcse_sd[1], plain.mcse_sd[1])
    # through the origin the points do speak: an apparent intercept of 1 is read as an offset
    origin = weigh_line(
        line_posterior(x, y, **u, u_zero_x=0.0, u_zero_y=5.0, through_origin=True), rng=rng
    )
    assert origin.mean[3] == pytest.approx(plain.mean[0], abs=0.1 * plain.sd[0] + 0.05)


def test_a_zero_error_of_an_angle_turns_the_line_of_its_sines(rng):
    """By generalised least squares, written out; the same error of all sines leaves the slope."""
    angle = np.radians(np.linspace(10.0, 57.0, 16))
    x, each, u_y = 0.187 * np.sin(angle), 0.026 * np.cos(angle), 0.01
    y = np.sin(angle) + u_y * rng.standard_normal(16)
    columns = np.column_stack([np.ones(16), x])
    found, exact = [], []
    for zero in (each, np.full(16, each.mean())):
        cov = u_y**2 * np.eye(16) + np.outer(zero, zero)
        inverse = np.linalg.inv(columns.T @ np.linalg.solve(cov, columns))
        exact += [(inverse @ columns.T @ np.linalg.solve(cov, y))[1], np.sqrt(inverse[1, 1])]
        line = weigh_line(line_posterior(x, y, u_y=u_y, u_zero_y=zero), rng=rng, n_draw=40_000)
        found += [line.mean[1], line.sd[1]]
    assert exact[1] > 1.5 * exact[3]
    assert found == pytest.approx(exact, rel=0.03)


# sampling and evidence


def test_quadrature_over_two_parameters_gives_the_sampled_evidence_and_slope(rng):
    x = rng.uniform(0.0, 1.0, 9)
    y = 0.2 + 1.4 * x + 0.1 * rng.standard_normal(9)
    posterior = line_posterior(x, y, u_y=0.1, intercept_sd=0.5)
    # exact x: given slope and tau, intercept and mu_x are integrals over normals
    slope, log_tau = np.linspace(-1.0, 4.0, 801)[:, None], np.linspace(-3.5, 2.0, 401)[None]
    ratio, n_obs = np.std(x) / np.std(y), len(x)
    residual, tau = y - slope[..., None] * x, np.exp(log_tau)
    spread = tau / np.std(x) * np.sqrt(1.0 + (ratio * slope) ** 2)
    prior = (
        stats.cauchy.pdf(slope * ratio)
        * ratio
        * stats.halfcauchy.pdf(spread, scale=np.sqrt(2.0))
        * spread
    )
    of_x = (
        tau ** (1 - n_obs)
        * np.exp(-0.5 * n_obs * np.var(x) / tau**2)
        * (2.0 * np.pi) ** (0.5 - 0.5 * n_obs)
        * n_obs**-0.5
    )
    free = stats.multivariate_normal(np.zeros(n_obs), 0.1**2 * np.eye(n_obs) + 0.5**2).pdf(residual)
    fixed = stats.multivariate_normal(np.zeros(n_obs), 0.1**2 * np.eye(n_obs)).pdf(residual)
    cell = (slope[1, 0] - slope[0, 0]) * (log_tau[0, 1] - log_tau[0, 0])
    integrals = [
        float(np.sum(of_y * prior * of_x) * cell) for of_y in (free[:, None], fixed[:, None])
    ]

    sample = weigh_line(posterior, rng=rng)
    assert abs(sample.log_evidence - np.log(integrals[0])) < 4.0 * sample.u_log_evidence < 0.1
    marginal = (free[:, None] * prior * of_x).sum(axis=1)
    mean = float(marginal @ slope[:, 0] / marginal.sum())
    sd = float(np.sqrt(marginal @ (slope[:, 0] - mean) ** 2 / marginal.sum()))
    assert abs(sample.mean[1] - mean) < 4.0 * sample.mcse_mean[1]
    assert abs(sample.sd[1] - sd) < 4.0 * sample.mcse_sd[1]

    found = intercept_evidence(posterior, rng=rng)
    assert (
        abs(found.log_bayes_factor - np.log(integrals[0] / integrals[1]))
        < 4.0 * found.u_log_bayes_factor
        < 0.1
    )
    assert (found.intercept_sd, found.message) == (0.5, "")


def test_bayes_factor_is_prior_over_posterior_density_at_no_intercept(rng):
    x, y, u = measured(rng, intercept=0.5)
    posterior = line_posterior(x, y, **u, scatter=0.5, intercept_sd=2.0)
    found = intercept_evidence(posterior, rng=rng)
    sample = weigh_line(posterior, rng=rng)
    window = 0.1
    near = float(np.mean(np.abs(sample.draws[:, 0]) < window))
    prior = 2.0 * stats.norm.cdf(window / 2.0) - 1.0
    error = np.hypot((near * len(sample.draws)) ** -0.5, found.u_log_bayes_factor)
    assert abs(found.log_bayes_factor - np.log(prior / near)) < 4.0 * error < 0.4


def test_evidence_finds_an_intercept_that_is_there_and_favours_the_origin_otherwise(rng):
    for intercept, sign in ((3.0, 1.0), (0.0, -1.0)):
        x, y, u = measured(rng, n_obs=30, intercept=intercept)
        found = intercept_evidence(line_posterior(x, y, **u, intercept_sd=5.0), rng=rng)
        assert sign * found.log_bayes_factor > 1.0


def test_scatter_that_is_there_is_found(rng):
    x, y, u = measured(rng, n_obs=60, scatter=0.8)
    posterior = line_posterior(x, y, **u, scatter=2.0)
    sample = weigh_line(posterior, rng=rng)
    low, high = credible_interval(sample, "log_scatter", probability=0.997)
    assert low < np.log(0.8) < high
    # without it the uncertainties do not explain the points
    assert fit_line(x, y, **u).p_value < 1e-3


def test_same_rng_gives_the_same_draws(rng):
    x, y, u = measured(rng)
    posterior = line_posterior(x, y, **u)
    first, second = (weigh_line(posterior, rng=np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.draws, second.draws)
    assert first.log_evidence == second.log_evidence


def test_points_through_the_origin_have_no_intercept(rng):
    x, y, u = measured(rng, intercept=0.0)
    free, fixed = (
        line_posterior(x, y, **u, scatter=0.2),
        line_posterior(x, y, **u, scatter=0.2, through_origin=True),
    )
    assert (
        without_intercept(free).names == fixed.names == ("slope", "mu_x", "log_tau", "log_scatter")
    )
    at = fixed.start
    assert without_intercept(free).log_density(at[None]) == pytest.approx(
        fixed.log_density(at[None])
    )
    assert free.log_density(np.insert(at, 0, 0.0)[None]) == pytest.approx(
        fixed.log_density(at[None])
    )


# mistakes


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({}, "'scatter' must be given"),
        ({"u_y": 0.1, "scatter": 0.0}, "'scatter' must be > 0"),
        ({"u_y": 0.1, "scatter": np.inf}, "'scatter' must be > 0 and finite"),
        ({"u_y": 0.1, "u_zero_x": -1.0}, "'u_zero_x' must be >= 0"),
        ({"u_y": 0.1, "u_zero_y": [0.1, 0.2]}, "'u_zero_y' must be >= 0"),
        ({"u_y": 0.1, "intercept_sd": -1.0}, "'intercept_sd' must be > 0"),
        (
            {"u_y": 0.1, "intercept_sd": 1.0, "through_origin": True},
            "'intercept_sd' has no meaning",
        ),
        ({"u_y": [0.1, 0.2]}, "'u_y' must be one number or 4 values"),
    ],
)
def test_bad_choices_are_refused(choice, words):
    with pytest.raises(InputError) as caught:
        line_posterior([0.0, 1.0, 2.0, 3.0], [0.0, 1.1, 1.9, 3.2], **choice)
    assert words in str(caught.value)


def test_bad_questions_are_refused(rng):
    posterior = line_posterior([0.0, 1.0, 2.0, 3.0], [0.0, 1.1, 1.9, 3.2], u_y=0.1)
    with pytest.raises(InputError, match="'intercept_sd' must be given"):
        intercept_evidence(posterior, rng=rng)
    with pytest.raises(InputError, match="vertical"):
        line_posterior([1.0, 1.0, 1.0], [0.0, 1.0, 2.0], u_x=0.1, u_y=0.1)
