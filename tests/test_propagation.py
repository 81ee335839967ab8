"""Propagation of uncertainty: linear, Monte Carlo, their comparison, and budgets.

Published values and where they are printed:
- JCGM 101:2008 (GUM Supplement 1): 9.2.2 and 9.2.3 (additive model: +-3.92, +-3.88), 9.2.4 (one
  wide rectangle: u 10.1, GUM +-19.9, Monte Carlo +-17.0), 9.4 (comparison loss), 7.9.2 (numerical
  tolerance).
- JCGM 100:2008 (GUM): H.1 (end gauge), H.2 with table H.2 (simultaneous readings of V, I, phi),
  G.4.1 (effective degrees of freedom).
- NPL report DEM-ES-011, table 9.2: y = ln x, x ~ U(0.1, 1.1).  Its lower end -1.895 carries the
  sampling error of its own draws: the exact end is ln 0.15 = -1.8971.
"""

import itertools
import math
import re

import numpy as np
import pytest
from scipy import stats
from uncertainties import correlated_values_norm, correlation_matrix, umath

import estim
from estim.common.errors import InputError
from estim.propagation.copula import copula_matrix, draw_inputs, standard_score
from estim.propagation.evaluation import gradient
from estim.propagation.inputs import Input
from estim.propagation.inputs import correlation_matrix as checked_correlation
from estim.propagation.linear import propagate_linear
from estim.propagation.monte_carlo import (
    coverage_interval,
    numerical_tolerance,
    propagate_monte_carlo,
)
from estim.propagation.tail_index import tail_index
from estim.propagation.uncertainty_budget import budget, budget_along
from estim.propagation.validation import compare

ROOT3 = math.sqrt(3.0)
LOG_INPUT = [Input.from_half_width("x", 0.6, 0.5)]
H2_READINGS = {  # GUM table H.2: V (V), I (A), phi (rad)
    "V": [5.007, 4.994, 5.005, 4.990, 4.999],
    "I": [19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3],
    "phi": [1.0456, 1.0438, 1.0468, 1.0428, 1.0433],
}


@pytest.fixture
def rng():
    return np.random.default_rng(20240611)


def log_x(q):
    return np.log(q["x"])


def total(q):
    return sum(q.values())


def impedance(q):
    z = q["V"] / q["I"]
    return z * np.cos(q["phi"]), z * np.sin(q["phi"]), z


def four(make):
    return [make(f"x{i}") for i in range(1, 5)]


def end_gauge():
    """GUM H.1, in nm: the difference d and the temperature have two independent parts each
    (H.1.3.2, H.1.3.4).
    """
    inputs = [
        Input("ls", 50_000_623.0, 25.0, dof=18, unit="nm"),
        Input("d", 215.0, 9.7, dof=25.6, unit="nm"),
        Input.from_half_width("alpha_s", 11.5e-6, 2e-6, unit="1/K"),
        Input("theta_mean", -0.1, 0.2, unit="K"),
        Input.from_half_width("theta_cycle", 0.0, 0.5, distribution="arcsine", unit="K"),
        Input.from_half_width("d_alpha", 0.0, 1e-6, dof=50, unit="1/K"),
        Input.from_half_width("d_theta", 0.0, 0.05, dof=2, unit="K"),
    ]

    def length(q):
        theta = q["theta_mean"] + q["theta_cycle"]
        return q["ls"] + q["d"] - q["ls"] * (q["d_alpha"] * theta + q["alpha_s"] * q["d_theta"])

    return length, inputs


# Published examples, linear


def test_impedance_of_gum_h2_from_its_readings():
    inputs = [Input.from_readings(name, readings) for name, readings in H2_READINGS.items()]
    correlation = np.corrcoef(list(H2_READINGS.values()))
    np.testing.assert_allclose(correlation[[0, 0, 1], [1, 2, 2]], [-0.36, 0.86, -0.65], atol=0.005)
    result = propagate_linear(impedance, inputs, correlation=correlation)
    np.testing.assert_allclose(result.value, [127.732, 219.847, 254.260], rtol=0, atol=0.0005)
    # u(X) is 0.29558: the GUM cut it
    np.testing.assert_allclose(result.u, [0.071, 0.295, 0.236], rtol=0, atol=0.001)
    r = result.covariance / np.outer(result.u, result.u)
    np.testing.assert_allclose(
        r[[0, 0, 1], [1, 2, 2]], [-0.588, -0.485, 0.993], rtol=0, atol=0.0005
    )
    # five simultaneous readings, whatever is computed from them (H.2.4)
    np.testing.assert_allclose(result.dof, 4.0, rtol=1e-12)
    assert result.notes == ()


def test_ignoring_the_correlations_of_gum_h2_misstates_the_uncertainty():
    inputs = [
        Input("V", 4.9990, 0.0032),
        Input("I", 19.6610e-3, 0.0095e-3),
        Input("phi", 1.04446, 0.00075),
    ]
    pairs = {("V", "I"): -0.36, ("phi", "V"): 0.86, ("I", "phi"): -0.65}
    right, wrong = (
        propagate_linear(impedance, inputs, correlation=pairs),
        propagate_linear(impedance, inputs),
    )
    # The rounded statements of table H.2 give the printed u within what the rounding allows.
    np.testing.assert_allclose(right.u, [0.071, 0.295, 0.236], rtol=0.02)
    assert wrong.u[0] > 2.5 * right.u[0]
    assert wrong.u[2] < 0.9 * right.u[2]


def test_end_gauge_of_gum_h1_and_its_table():
    function, inputs = end_gauge()
    result = propagate_linear(function, inputs, probability=0.99)
    assert result.value == pytest.approx(50_000_838.0, abs=0.5)
    assert round(float(result.u)) == 32
    assert result.dof == pytest.approx(16.7, abs=0.1)  # printed from u rounded to 32
    assert stats.t.ppf(0.995, 17) < result.k < stats.t.ppf(0.995, 16)
    table = budget(result)
    contributions = {row.input.name: row.contribution for row in table.rows}
    printed = {
        "ls": 25.0,
        "d": 9.7,
        "alpha_s": 0.0,
        "theta_mean": 0.0,
        "theta_cycle": 0.0,
        "d_alpha": 2.9,
        "d_theta": 16.6,
    }
    for name, value in printed.items():
        assert contributions[name] == pytest.approx(value, abs=0.05), name
    assert [row.input.name for row in table.rows[:4]] == ["ls", "d_theta", "d", "d_alpha"]
    assert (table.u, table.dof, table.k) == (float(result.u), float(result.dof), float(result.k))


def test_effective_degrees_of_freedom_of_gum_g41():
    inputs = [
        Input("a", 1.0, 0.0025, dof=9),
        Input("b", 1.0, 0.0057, dof=4),
        Input("c", 1.0, 0.0082, dof=14),
    ]
    result = propagate_linear(lambda q: 7.0 * q["a"] * q["b"] * q["c"], inputs)
    assert result.u / result.value == pytest.approx(0.0103, abs=0.00005)
    assert result.dof == pytest.approx(19.0, abs=0.05)
    assert result.k == pytest.approx(2.09, abs=0.005)


def test_correlated_inputs_of_different_dof_take_the_smallest_and_say_so():
    inputs = [
        Input("a", 1.0, 0.1, dof=4),
        Input("b", 1.0, 0.1, dof=30),
        Input("c", 0.0, 1e-9, dof=2),
    ]
    result = propagate_linear(total, inputs, correlation={("a", "b"): 0.5})
    assert result.dof == pytest.approx(4.0)
    assert "have different degrees of freedom" in result.notes[0]
    assert propagate_linear(total, inputs).dof == pytest.approx(
        (2 * 0.01) ** 2 / (0.01**2 / 4 + 0.01**2 / 30)
    )


# Linear: identities and an independent computation


def test_linear_agrees_with_uncertainties_on_random_expressions_with_correlations(rng):
    names = ["a", "b", "c", "d"]
    for _ in range(5):
        values, u = rng.uniform(0.5, 1.5, 4), rng.uniform(0.01, 0.1, 4)
        factor = rng.standard_normal((4, 6))
        covariance = factor @ factor.T
        scale = np.sqrt(np.diag(covariance))
        r = covariance / np.outer(scale, scale)
        np.fill_diagonal(r, 1.0)
        p = rng.uniform(-2, 2, 3)

        def function(q, p=p, m=np):
            first = m.exp(p[0] * q["a"] * q["b"]) / q["c"]
            return first + m.sin(p[1] * q["d"]), m.sqrt(q["a"] + q["c"]) * q["d"] ** p[2]

        inputs = [Input(*three) for three in zip(names, values, u, strict=True)]
        result = propagate_linear(function, inputs, correlation=r)
        reference = function(
            dict(
                zip(
                    names, correlated_values_norm(list(zip(values, u, strict=True)), r), strict=True
                )
            ),
            m=umath,
        )
        np.testing.assert_allclose(result.value, [y.nominal_value for y in reference], rtol=1e-14)
        np.testing.assert_allclose(result.u, [y.std_dev for y in reference], rtol=1e-9)
        np.testing.assert_allclose(
            result.covariance[0, 1] / np.prod(result.u),
            correlation_matrix(reference)[0, 1],
            atol=1e-9,
        )
        wrong = propagate_linear(function, inputs)
        assert np.max(np.abs(wrong.u / result.u - 1.0)) > 0.01


def test_ufloats_of_a_result_keep_the_correlations_of_its_outputs():
    inputs = [
        Input("V", 4.999, 0.0032),
        Input("I", 0.019661, 9.5e-6),
        Input("phi", 1.04446, 0.00075),
        Input("one", 1.0, 0.0),
    ]
    result = propagate_linear(
        impedance, inputs, correlation={("V", "I"): -0.36, ("V", "phi"): 0.86}
    )
    r, x, z = result.as_ufloat()
    np.testing.assert_allclose([y.std_dev for y in (r, x, z)], result.u, rtol=1e-9)
    # R^2 + X^2 = Z^2 whatever V, I and phi are
    assert (r**2 + x**2 - z**2).std_dev < 1e-6 * (z**2).std_dev
    scalar = propagate_linear(lambda q: q["V"] / q["I"], inputs).as_ufloat()
    assert (scalar.nominal_value, scalar.std_dev) == pytest.approx(
        (4.999 / 0.019661, float(z.std_dev)), rel=0.4
    )


def test_covariance_along_a_curve_is_that_of_the_straight_line():
    x = np.linspace(-1.0, 2.0, 7)
    inputs = [Input("intercept", -0.1712, 0.0029), Input("slope", 0.00218, 0.00067)]  # GUM H.3
    curve = propagate_linear(
        lambda q: q["intercept"] + q["slope"] * x,
        inputs,
        correlation={("intercept", "slope"): -0.930},
    )
    design = np.stack([np.ones_like(x), x], axis=1)
    u = np.array([0.0029, 0.00067])
    np.testing.assert_allclose(
        curve.covariance, design @ (np.outer(u, u) * [[1, -0.93], [-0.93, 1]]) @ design.T, rtol=1e-9
    )
    np.testing.assert_allclose(curve.u**2, np.diag(curve.covariance), rtol=1e-12)
    assert curve.sensitivities.shape == (2, 7)


@pytest.mark.parametrize(
    ("function", "derivative", "value", "u"),
    [
        (np.log, lambda x: 1 / x, 0.6, 0.289),
        (np.sqrt, lambda x: 0.5 / np.sqrt(x), 0.01, 0.02),  # undefined within one u
        (np.exp, np.exp, 3.0, 2.0),
        (np.tan, lambda x: 1 / np.cos(x) ** 2, 1.5, 0.01),
        (np.sin, np.cos, 1e6, 1e-3),  # a phase far from zero
        (np.sin, np.cos, 1.0, 1e-10),  # far below the rounding error of value * 1e-6
        # u is four periods
        (lambda x: np.sin(2 * np.pi * x), lambda x: 2 * np.pi * np.cos(2 * np.pi * x), 0.0, 4.0),
        (lambda x: 1 / (1 + np.exp(-x)), lambda x: 0.25, 0.0, 1.0),
        (lambda x: x**3, lambda x: 3 * x**2, 2.0, 0.0),  # a constant has a sensitivity too
    ],
)
def test_sensitivities_are_derivatives_to_eight_digits(function, derivative, value, u):
    slopes = gradient(lambda q: function(q["x"]), [Input("x", value, u)])
    assert slopes.derivative[0] == pytest.approx(derivative(value), rel=2e-8)
    assert abs(slopes.derivative[0] - derivative(value)) <= 10 * slopes.error[0]


def test_sensitivity_is_not_the_quotient_over_one_u():
    """At an inflection the quotient over +-u of the note to GUM 5.1.3 gives u^2 where the
    derivative is 0.
    """
    result = propagate_linear(lambda q: q["x"] ** 3, [Input("x", 0.0, 1.0)])
    assert abs(result.sensitivities[0]) < 1e-12
    assert abs(result.u) < 1e-12


def test_stated_error_of_a_derivative_covers_the_noise_of_the_function(rng):
    """A solver's tolerance looks like noise; extrapolation alone would claim an error hundreds of
    times too small.
    """
    ratios = []
    for _ in range(100):
        slopes = gradient(
            lambda q: np.exp(q["x"]) + 1e-8 * rng.standard_normal(), [Input("x", 0.0, 0.5)]
        )
        ratios.append(abs(slopes.derivative[0] - 1.0) / slopes.error[0])
    assert np.percentile(ratios, 90) < 3.0


@pytest.mark.parametrize(
    ("function", "sentence"),
    [
        (lambda q: np.abs(q["x"]), "differs on the two sides"),
        (lambda q: np.sqrt(np.maximum(q["x"], 0.0)), "differs on the two sides"),
        (lambda q: np.sqrt(q["x"]), "undefined, next to the estimate"),
        (lambda q: np.arctan2(q["x"], -1.0), "jumps"),
        (lambda q: np.log(q["x"] - 1.0), "no finite value at the estimates"),
        (lambda q: q["x"] ** 2, "all first derivatives vanish"),
        (lambda q: q["x"] + 5e-6 * np.sin(1e7 * q["x"] + 1.0), "is known only to"),
    ],
)
def test_what_linear_propagation_cannot_do_is_said(function, sentence):
    result = propagate_linear(function, [Input("x", 0.0, 0.5)])
    assert any(sentence in note for note in result.notes), result.notes
    assert propagate_linear(log_x, LOG_INPUT).notes == ()


def test_noise_of_a_function_that_an_input_hardly_moves_is_no_jump(rng):
    def noisy(q):
        return q["a"] + 1e-12 * q["b"] + 1e-9 * rng.standard_normal()

    for _ in range(20):
        result = propagate_linear(noisy, [Input("a", 1.0, 0.1), Input("b", 1.0, 0.1)])
        assert result.u == pytest.approx(0.1, rel=1e-3)


def test_an_undefined_output_of_a_curve_leaves_the_others_alone():
    x = np.array([-1.0, 0.0, 1.0])
    curve = propagate_linear(lambda q: np.sqrt(x + q["a"]), [Input("a", 0.5, 0.01)])
    assert np.isnan(curve.u[0])
    np.testing.assert_allclose(curve.u[1:], 0.01 * 0.5 / np.sqrt([0.5, 1.5]), rtol=1e-9)
    assert curve.notes == ("at 1 of 3 outputs: the function has no finite value at the estimates",)


# Monte Carlo: published and exact answers


def exact_sum_cdf(half_widths):
    """P(sum of independent U(-a, a) <= y): the piecewise polynomial, from all 2^n corners."""
    a = np.array(half_widths)
    signs = np.array(list(itertools.product([-1.0, 1.0], repeat=a.size)))
    norm = math.factorial(a.size) * np.prod(2.0 * a)
    return lambda y: float(
        np.sum(np.prod(signs, axis=1) * np.maximum(y + signs @ a, 0.0) ** a.size) / norm
    )


@pytest.mark.slow
def test_additive_model_of_gum_s1_92():
    rng = np.random.default_rng(92)
    cases = [
        (four(lambda name: Input(name, 0.0, 1.0)), 2.0, 3.92, 3.92),
        (four(lambda name: Input(name, 0.0, 1.0, "rectangular")), 2.0, 3.92, 3.88),
        (
            [
                *four(lambda name: Input(name, 0.0, 1.0, "rectangular"))[:3],
                Input("x4", 0.0, 10.0, "rectangular"),
            ],
            10.1,
            19.9,
            17.0,
        ),
    ]
    for inputs, u, linear_end, end in cases:
        digit = 0.005 if u < 10 else 0.05
        linear = propagate_linear(total, inputs)
        sampled = propagate_monte_carlo(total, inputs, rng=rng, n_draw=2_000_000)
        assert linear.high == pytest.approx(linear_end, abs=digit)
        assert abs(sampled.mean) < 4 * sampled.mean_error
        assert sampled.u == pytest.approx(
            math.sqrt(sum(one.u**2 for one in inputs)), abs=4 * float(sampled.u_error)
        )
        assert sampled.u == pytest.approx(u, abs=0.05 + 4 * float(sampled.u_error))
        for interval in (sampled.symmetric, sampled.shortest):
            assert interval.high == pytest.approx(end, abs=digit + 4 * float(interval.high_error))
            assert interval.low == pytest.approx(-end, abs=digit + 4 * float(interval.low_error))
        if inputs[3].distribution == "rectangular":
            cdf = exact_sum_cdf([ROOT3 * one.u for one in inputs])
            # 4 sqrt(0.975 0.025/2e6) = 4.4e-4
            assert cdf(float(sampled.symmetric.high)) == pytest.approx(0.975, abs=5e-4)
            # the normal interval must fail here
            assert sampled.symmetric.high < linear.high - 5 * sampled.symmetric.high_error
    assert pytest.approx(3.88, abs=0.005) == 2 * ROOT3 * (2 - 0.6**0.25)  # JCGM 101, 9.2.3.3


def test_logarithm_of_a_rectangular_quantity():
    linear = propagate_linear(log_x, LOG_INPUT)
    assert (
        round(float(linear.value), 3),
        round(float(linear.u), 3),
        round(float(linear.high), 3),
    ) == (-0.511, 0.481, 0.432)
    sampled = propagate_monte_carlo(
        log_x, LOG_INPUT, rng=np.random.default_rng(9), n_draw=4_000_000
    )
    assert sampled.mean == pytest.approx(-0.665, abs=0.0005 + 4 * float(sampled.mean_error))
    assert sampled.u == pytest.approx(0.606, abs=0.0005 + 4 * float(sampled.u_error))
    assert sampled.shortest.high == pytest.approx(0.095, abs=0.0005)
    # printed from a sample; exact below
    assert sampled.shortest.low == pytest.approx(-1.895, abs=0.005)
    exact = [
        1.1 * math.log(1.1) - 0.1 * math.log(0.1) - 1.0,
        math.log(0.15),
        math.log(0.125),
        math.log(1.075),
    ]
    found = [sampled.mean, sampled.shortest.low, sampled.symmetric.low, sampled.symmetric.high]
    errors = [
        sampled.mean_error,
        sampled.shortest.low_error,
        sampled.symmetric.low_error,
        sampled.symmetric.high_error,
    ]
    np.testing.assert_allclose((np.array(found) - exact) / errors, 0.0, atol=4.0)
    assert max(map(float, errors)) < 0.0015


def test_comparison_loss_of_gum_s1_94():
    """dY = X1^2 + X2^2 in 1e-6, u(X) = 0.005: u as printed; for r = 0 the interval by the
    noncentral chi-squared law.
    """
    printed_u = {
        (0.0, 0.0): 50,
        (0.010, 0.0): 112,
        (0.050, 0.0): 502,
        (0.0, 0.9): 67,
        (0.010, 0.9): 121,
        (0.050, 0.9): 505,
    }
    rng = np.random.default_rng(94)
    n_draw = 1_000_000
    for (x1, r), u in printed_u.items():
        inputs = [Input("x1", x1, 0.005), Input("x2", 0.0, 0.005)]
        sampled = propagate_monte_carlo(
            lambda q: 1e6 * (q["x1"] ** 2 + q["x2"] ** 2),
            inputs,
            rng=rng,
            n_draw=n_draw,
            correlation={("x1", "x2"): r},
        )
        assert sampled.mean == pytest.approx(1e6 * x1**2 + 50.0, abs=4 * float(sampled.mean_error))
        assert sampled.u == pytest.approx(u, abs=0.5 + 4 * float(sampled.u_error))
        if r == 0.0:
            law = stats.ncx2(2, (x1 / 0.005) ** 2, scale=25.0)
            tail = np.linspace(0.0, 0.05, 2001)[:-1]
            length = np.min(law.ppf(tail + 0.95) - np.where(tail > 0.0, law.ppf(tail), 0.0))
            low, high = float(sampled.shortest.low), float(sampled.shortest.high)
            error = float(np.hypot(sampled.shortest.low_error, sampled.shortest.high_error))
            assert high - low == pytest.approx(length, abs=4 * error)
            assert law.cdf(high) - law.cdf(low) == pytest.approx(
                0.95, abs=4 * math.sqrt(0.95 * 0.05 / n_draw) + 2e-4
            )


def test_monte_carlo_reproduces_correlated_outputs(rng):
    inputs = [
        Input("V", 4.9990, 0.0032),
        Input("I", 19.6610e-3, 0.0095e-3),
        Input("phi", 1.04446, 0.00075),
    ]
    pairs = {("V", "I"): -0.36, ("V", "phi"): 0.86, ("I", "phi"): -0.65}
    linear = propagate_linear(impedance, inputs, correlation=pairs)
    sampled = propagate_monte_carlo(impedance, inputs, rng=rng, n_draw=200_000, correlation=pairs)
    np.testing.assert_allclose((sampled.u - linear.u) / sampled.u_error, 0.0, atol=4.5)
    scale = np.outer(linear.u, linear.u)
    np.testing.assert_allclose(
        sampled.covariance() / scale, linear.covariance / scale, atol=4 * math.sqrt(2 / 200_000)
    )
    ignored = propagate_monte_carlo(impedance, inputs, rng=rng, n_draw=200_000)
    assert abs(ignored.u[0] - linear.u[0]) > 50 * ignored.u_error[0]


def test_student_t_input_widens_monte_carlo_and_the_linear_interval_alike(rng):
    one = Input.from_readings("x", [9.9, 10.1, 10.0, 10.4, 9.7, 10.2])
    linear = propagate_linear(lambda q: 3.0 * q["x"], [one])
    sampled = propagate_monte_carlo(lambda q: 3.0 * q["x"], [one], rng=rng, n_draw=400_000)
    assert linear.dof == pytest.approx(5.0)
    assert sampled.u / linear.u == pytest.approx(math.sqrt(5 / 3), rel=0.01)
    assert (sampled.symmetric.high - linear.high) / sampled.symmetric.high_error == pytest.approx(
        0.0, abs=4.0
    )
    as_normal = propagate_monte_carlo(
        lambda q: 3.0 * q["x"], [Input("x", one.value, one.u, dof=5)], rng=rng, n_draw=400_000
    )
    assert abs(as_normal.symmetric.high - linear.high) > 20 * as_normal.symmetric.high_error
    assert "degrees of freedom are not used" in as_normal.notes[0]


# Distributions and their correlation


@pytest.mark.parametrize(
    ("distribution", "reference"),
    [
        ("normal", stats.norm()),
        ("rectangular", stats.uniform(-ROOT3, 2 * ROOT3)),
        ("triangular", stats.triang(0.5, -math.sqrt(6), 2 * math.sqrt(6))),
        ("arcsine", stats.arcsine(-math.sqrt(2), 2 * math.sqrt(2))),
        ("t", stats.t(4)),
    ],
)
def test_each_distribution_has_its_quantiles_and_its_standard_deviation(
    distribution, reference, rng
):
    one = Input("x", 5.0, 2.0, distribution, dof=4 if distribution == "t" else math.inf)
    z = np.linspace(-6.0, 6.0, 41)
    np.testing.assert_allclose(
        standard_score(one, z), reference.ppf(stats.norm.cdf(z)), rtol=1e-6, atol=1e-12
    )
    assert one.standard_deviation == pytest.approx(2.0 * reference.std())
    drawn = draw_inputs([one], np.eye(1), rng=rng, n_draw=20_000)["x"]
    assert stats.kstest((drawn - 5.0) / 2.0, reference.cdf).pvalue > 1e-3


def test_limits_give_the_standard_uncertainty():
    for distribution, divisor in (("rectangular", 3), ("triangular", 6), ("arcsine", 2)):
        one = Input.from_half_width("x", 1.0, 0.6, distribution=distribution)
        assert one.u == pytest.approx(0.6 / math.sqrt(divisor))
        assert one.value + one.u * standard_score(one, np.array([40.0]))[0] == pytest.approx(1.6)


@pytest.mark.slow
def test_copula_meets_the_stated_correlation_for_all_pairs_of_distributions(rng):
    kinds = [
        ("normal", math.inf),
        ("rectangular", math.inf),
        ("triangular", math.inf),
        ("arcsine", math.inf),
        ("t", 6),
    ]
    for first, second in itertools.combinations_with_replacement(kinds, 2):
        for r in (-0.7, 0.9):
            inputs = [Input("a", 0.0, 1.0, *first), Input("b", 3.0, 2.0, *second)]
            copula = copula_matrix(inputs, checked_correlation(inputs, {("a", "b"): r}))
            drawn = draw_inputs(inputs, copula, rng=rng, n_draw=200_000)
            assert np.corrcoef(drawn["a"], drawn["b"])[0, 1] == pytest.approx(r, abs=0.006), (
                first,
                second,
            )


def test_copula_of_rectangular_quantities_is_the_known_one_and_the_plain_copula_fails(rng):
    inputs = [Input("a", 0.0, 1.0, "rectangular"), Input("b", 0.0, 1.0, "rectangular")]
    for r in (-1.0, -0.5, 0.8, 0.99, 1.0):
        copula = copula_matrix(inputs, checked_correlation(inputs, {("a", "b"): r}))
        assert copula[0, 1] == pytest.approx(2 * math.sin(math.pi * r / 6), abs=1e-9)
    arcs = [Input("a", 0.0, 1.0, "arcsine"), Input("b", 0.0, 1.0, "arcsine")]
    plain = draw_inputs(arcs, np.array([[1.0, 0.7], [0.7, 1.0]]), rng=rng, n_draw=200_000)
    assert abs(np.corrcoef(plain["a"], plain["b"])[0, 1] - 0.7) > 0.02


def test_correlated_rectangular_inputs_propagate_with_the_linear_u(rng):
    inputs = [
        Input("a", 0.0, 1.0, "rectangular"),
        Input("b", 0.0, 2.0, "triangular"),
        Input("c", 0.0, 1.0),
    ]
    pairs = {("a", "b"): 0.8, ("b", "c"): -0.3}
    linear = propagate_linear(total, inputs, correlation=pairs)
    sampled = propagate_monte_carlo(total, inputs, rng=rng, n_draw=400_000, correlation=pairs)
    assert (sampled.u - linear.u) / sampled.u_error == pytest.approx(0.0, abs=4.0)
    assert (
        abs(propagate_monte_carlo(total, inputs, rng=rng, n_draw=400_000).u - linear.u)
        > 30 * sampled.u_error
    )


# Monte Carlo: errors, stopping, undefined draws


@pytest.mark.statistics
def test_stated_monte_carlo_errors_are_the_scatter_of_repeated_runs():
    pulls = []
    for seed in range(60):
        run = propagate_monte_carlo(
            log_x, LOG_INPUT, rng=np.random.default_rng(seed), n_draw=100_000
        )
        exact = (1.1 * math.log(1.1) - 0.1 * math.log(0.1) - 1.0, math.log(0.125), math.log(1.075))
        pulls.append(
            [
                (run.mean - exact[0]) / run.mean_error,
                (run.symmetric.low - exact[1]) / run.symmetric.low_error,
                (run.symmetric.high - exact[2]) / run.symmetric.high_error,
            ]
        )
    spread = np.sqrt(np.mean(np.square(pulls), axis=0))
    # A t variate with 9 degrees of freedom has sd 1.13; 60 of them scatter by 0.13.
    assert np.all((spread > 0.7) & (spread < 1.6)), spread


@pytest.mark.slow
def test_adaptive_rule_stops_within_its_tolerance():
    exact = math.log(0.125)
    misses, sizes = 0, []
    for seed in range(40):
        run = propagate_monte_carlo(log_x, LOG_INPUT, rng=np.random.default_rng(seed))
        assert run.stabilised
        assert run.tolerance == 0.005
        misses += abs(run.symmetric.low - exact) > run.tolerance
        sizes.append(run.n_draw)
    assert misses <= 8  # two standard errors: 5 % each; 8 of 40 has a chance of 4e-4
    assert min(sizes) >= 100_000
    # One digit more must cost about a hundredfold: the rule reacts to what is asked.
    more = propagate_monte_carlo(
        log_x, LOG_INPUT, rng=np.random.default_rng(1), n_digits=3, max_draw=1_000_000
    )
    assert not more.stabilised
    assert more.notes[0].startswith("not stabilised to 3 digits of u after 1000000 draws")


def test_progress_is_called_after_each_block(rng):
    calls = []
    run = propagate_monte_carlo(
        log_x,
        LOG_INPUT,
        rng=rng,
        n_draw=105_003,
        progress=lambda done, most: calls.append((done, most)),
    )
    assert len(calls) == run.n_block == 10
    assert calls[-1] == (105_003, 105_003)
    assert run.n_draw == run.draws.size == 105_003


def test_numerical_tolerance_of_gum_s1_792():
    u = np.array([0.00035, 2.0, 0.0996, 0.0994, 1000.0, 33.0, 0.0, np.nan])
    expected = [0.5e-5, 0.05, 0.005, 0.0005, 50.0, 0.5, 0.0, np.nan]
    np.testing.assert_allclose(numerical_tolerance(u, 2), expected, rtol=1e-12)
    assert numerical_tolerance(np.array(0.00035), 1) == pytest.approx(0.5e-4)


def test_coverage_interval_takes_the_order_statistics_of_gum_s1_77():
    ordered = np.arange(1.0, 101.0)
    # q = 95, r = (100 - 95 + 1)/2
    assert coverage_interval(ordered, 0.95, "symmetric") == (3.0, 98.0)
    assert coverage_interval(ordered, 0.9, "symmetric") == (5.0, 95.0)  # q = 90, r = (100 - 90)/2
    assert coverage_interval(ordered**2, 0.9, "shortest") == (1.0, 91.0**2)
    assert coverage_interval(-(ordered[::-1] ** 2), 0.9, "shortest") == (-(91.0**2), -1.0)


def test_draws_without_a_value_are_reported_and_nothing_is_stated_without_asking(rng):
    inputs = [Input("x", 1.0, 0.5)]
    run = propagate_monte_carlo(lambda q: np.sqrt(q["x"]), inputs, rng=rng, n_draw=100_000)
    expected = stats.norm.cdf(-2.0)
    assert run.undefined == pytest.approx(expected, abs=4 * math.sqrt(expected / 100_000))
    assert np.isnan([run.mean, run.u, run.symmetric.low, run.shortest.high, run.mean_error]).all()
    assert np.isnan(run.draws).mean() == run.undefined
    assert not run.stabilised
    assert "of the draws give no finite value" in run.notes[0]
    some = run.where_defined()
    truncated = stats.truncnorm(-2.0, np.inf, 1.0, 0.5)
    assert some.conditional
    assert "conditional on the function being defined" in some.notes[0]
    assert some.undefined == run.undefined
    assert some.symmetric.low == pytest.approx(
        math.sqrt(truncated.ppf(0.025)), abs=4 * float(some.symmetric.low_error)
    )
    assert some.mean == pytest.approx(truncated.expect(np.sqrt), abs=4 * float(some.mean_error))
    linear = propagate_linear(lambda q: np.sqrt(q["x"]), inputs)
    assert compare(linear, run).status == "undecided"
    assert "a result is unknown" in compare(linear, run).message
    assert compare(linear, some).message.endswith(
        "(Monte Carlo conditional on the function being defined)"
    )


def test_infinities_count_as_undefined_and_only_at_their_outputs(rng):
    x = np.array([0.0, 1.0])
    run = propagate_monte_carlo(
        lambda q: 1.0 / np.maximum(x + q["a"], 0.0), [Input("a", 0.0, 0.1)], rng=rng, n_draw=50_000
    )
    assert run.undefined[0] == pytest.approx(0.5, abs=0.01)
    assert run.undefined[1] == 0.0
    assert np.isnan(run.u[0])
    assert run.u[1] == pytest.approx(0.103, abs=0.003)
    assert run.notes[0].startswith(
        f"at 1 of 2 outputs: up to {100 * run.undefined[0]:.3g} % of the draws"
    )
    assert np.isnan(run.covariance()[0]).all()
    never = propagate_monte_carlo(
        lambda q: np.log(-1.0 - q["a"] ** 2), [Input("a", 0.0, 0.1)], rng=rng, n_draw=10_000
    )
    assert never.undefined == 1.0
    assert np.isnan(never.where_defined().mean)
    assert "too few draws have a finite value" in never.where_defined().notes[1]


def test_a_constant_output_is_exact(rng):
    inputs = [Input("a", 0.1, 0.0), Input("b", 3.0, 1.0)]
    run = propagate_monte_carlo(lambda q: q["a"] + 0.0 * q["b"], inputs, rng=rng, n_draw=10_000)
    linear = propagate_linear(lambda q: q["a"] + 0.0 * q["b"], inputs)
    assert (run.mean, run.u, run.shortest.low, run.stabilised) == (0.1, 0.0, 0.1, True)
    assert compare(linear, run).status == "valid"
    assert math.isnan(budget(linear).rows[0].share)


def test_few_degrees_of_freedom_are_pointed_out(rng):
    run = propagate_monte_carlo(
        total, [Input.from_readings("x", [1.0, 1.2])], rng=rng, n_draw=10_000
    )
    assert any("no standard deviation" in note for note in run.notes)


# Comparison


def test_comparison_rejects_the_linear_interval_of_a_logarithm(rng):
    linear = propagate_linear(log_x, LOG_INPUT)
    for n_digits, kind in itertools.product((1, 2), ("symmetric", "shortest")):
        verdict = compare(
            linear, propagate_monte_carlo(log_x, LOG_INPUT, rng=rng), n_digits=n_digits, kind=kind
        )
        assert verdict.status == "invalid"
        assert not verdict.passes
        assert "quote the Monte-Carlo interval" in verdict.message
    exact = propagate_monte_carlo(log_x, LOG_INPUT, rng=rng, n_draw=1_000_000)
    verdict = compare(linear, exact)
    assert verdict.d_low == pytest.approx(abs(float(linear.low) - math.log(0.125)), abs=0.01)
    assert verdict.d_high == pytest.approx(abs(float(linear.high) - math.log(1.075)), abs=0.01)
    assert verdict.tolerance == pytest.approx(0.005)


def test_comparison_accepts_a_nearly_linear_function_and_wants_enough_draws(rng):
    inputs = [Input("x", 100.0, 0.5), Input("y", 50.0, 0.5)]

    def function(q):
        return q["x"] + 2.0 * q["y"] + 1e-6 * q["x"] * q["y"]

    linear = propagate_linear(function, inputs)
    good = compare(linear, propagate_monte_carlo(function, inputs, rng=rng, n_draw=1_000_000))
    assert (good.status, bool(good.passes), bool(good.decided)) == ("valid", True, True)
    hasty = compare(linear, propagate_monte_carlo(function, inputs, rng=rng, n_draw=4_000))
    assert hasty.status == "undecided"
    assert "use more draws" in hasty.message


def test_comparison_finds_a_vanishing_derivative(rng):
    inputs = [Input("x1", 0.0, 0.005), Input("x2", 0.0, 0.005)]
    linear = propagate_linear(lambda q: q["x1"] ** 2 + q["x2"] ** 2, inputs)
    assert linear.u == pytest.approx(0.0, abs=1e-15)
    assert (
        compare(
            linear, propagate_monte_carlo(lambda q: q["x1"] ** 2 + q["x2"] ** 2, inputs, rng=rng)
        ).status
        == "invalid"
    )


@pytest.mark.parametrize("n_digits", [1, 2])
@pytest.mark.parametrize("seed", range(8))
def test_reciprocal_of_what_may_be_zero_is_never_certified(seed, n_digits):
    """y = 1/a, a = 1 +- 0.5, falls off as 1/y^2: no mean and no u exist, and a tolerance that
    followed them would pass anything.
    """
    inputs = [Input("a", 1.0, 0.5)]
    sampled = propagate_monte_carlo(
        lambda q: 1.0 / q["a"],
        inputs,
        rng=np.random.default_rng(seed),
        n_draw=300_000,
        n_digits=n_digits,
    )
    assert math.isnan(sampled.u)
    assert math.isnan(sampled.covariance())
    assert not sampled.stabilised
    assert "there is no standard deviation" in sampled.notes[0]
    verdict = compare(propagate_linear(lambda q: 1.0 / q["a"], inputs), sampled, n_digits=n_digits)
    assert verdict.tolerance == pytest.approx(0.05 if n_digits == 1 else 0.005)  # of u = 0.5
    # the ends exist, and the linear ones are far off: 2.5 % of 1/a lies above 6.0, not 1.98
    assert verdict.status == "invalid"
    assert sampled.symmetric.high == pytest.approx(6.0, abs=0.2)


def test_agreement_of_the_ends_alone_is_no_agreement(rng):
    """Ends of 95 % that agree by construction, and tails beyond them without a standard
    deviation.
    """
    inputs = [Input("a", 0.0, 1.0)]

    def function(q):
        return np.where(
            np.abs(q["a"]) < 2.2,
            q["a"],
            np.sign(q["a"])
            * 2.2
            / (2.0 * stats.norm.sf(np.abs(q["a"])))
            * 2.0
            * stats.norm.sf(2.2),
        )

    sampled = propagate_monte_carlo(function, inputs, rng=rng, n_draw=1_000_000)
    verdict = compare(propagate_linear(function, inputs), sampled, n_digits=1)
    assert (verdict.status, bool(verdict.passes)) == ("undecided", True)
    assert "have not stabilised" in verdict.message
    # the same with the tails of the normal distribution
    plain = propagate_monte_carlo(total, inputs, rng=rng, n_draw=1_000_000)
    assert compare(propagate_linear(total, inputs), plain, n_digits=1).status == "valid"


@pytest.mark.parametrize(
    ("alpha", "exists"), [(1.0, False), (1.5, False), (3.0, True), (5.0, True), (math.inf, True)]
)
def test_standard_deviation_is_stated_where_it_exists(alpha, exists, rng):
    for _ in range(8):
        draws = (
            rng.standard_normal(200_000) if math.isinf(alpha) else rng.standard_t(alpha, 200_000)
        )
        assert (tail_index(draws) < 0.45) == exists
        assert (tail_index(-np.exp(rng.standard_normal(200_000)))) < 0.45
    table = tail_index(np.column_stack([draws, rng.standard_cauchy(200_000)]))
    assert (table < 0.45).tolist() == [exists, False]


@pytest.mark.parametrize(
    ("inputs", "n_digits", "expected"),
    [
        ([Input(f"x{i}", 0.0, 1.0) for i in range(4)], 2, "valid"),  # JCGM 101, 9.2.2: both 3.92
        # 9.2.3: 3.88 for 3.92
        ([Input(f"x{i}", 0.0, 1.0, distribution="rectangular") for i in range(4)], 1, "valid"),
        ([Input(f"x{i}", 0.0, 1.0, distribution="rectangular") for i in range(4)], 3, "invalid"),
        # 9.2.4: 17.0 for 19.9
        (
            [
                Input(f"x{i}", 0.0, 10.0 if i == 3 else 1.0, distribution="rectangular")
                for i in range(4)
            ],
            2,
            "invalid",
        ),
    ],
)
@pytest.mark.parametrize(
    "seeds",
    [range(2), pytest.param(range(2, 8), marks=pytest.mark.statistics)],
    ids=["few", "more"],
)
def test_verdicts_on_the_additive_examples_of_gum_s1(inputs, n_digits, expected, seeds):
    for seed in seeds:
        sampled = propagate_monte_carlo(
            total, inputs, rng=np.random.default_rng(seed), n_draw=1_000_000
        )
        assert (
            compare(propagate_linear(total, inputs), sampled, n_digits=n_digits).status == expected
        )


def test_comparison_along_a_curve_names_the_worst_output(rng):
    x = np.array([0.0, 0.1, 3.0])
    inputs = [Input("a", 1.0, 0.01), Input("b", 1.0, 0.2)]
    linear = propagate_linear(lambda q: q["a"] * np.exp(-q["b"] * x), inputs)
    sampled = propagate_monte_carlo(
        lambda q: q["a"] * np.exp(-q["b"] * x), inputs, rng=rng, n_draw=400_000
    )
    verdict = compare(linear, sampled)
    assert verdict.passes.tolist() == [True, False, False]
    assert verdict.message.startswith("at 2 of 3 outputs: ")
    assert "(output 2)" in verdict.message


# Budgets


def test_shares_of_a_budget_and_of_its_correlations_add_up_to_100(rng):
    inputs = [
        Input("V", 4.9990, 0.0032),
        Input("I", 19.6610e-3, 0.0095e-3),
        Input("phi", 1.04446, 0.00075),
    ]
    linear = propagate_linear(
        impedance, inputs, correlation={("V", "I"): -0.36, ("V", "phi"): 0.86, ("I", "phi"): -0.65}
    )
    for output in range(3):
        table = budget(linear, output=output)
        shares = [row.share for row in table.rows]
        assert shares == sorted(shares, reverse=True)
        assert sum(shares) + table.correlation_share == pytest.approx(100.0, abs=1e-9)
        assert table.correlation_share == pytest.approx(sum(pair.share for pair in table.pairs))
        assert table.u == linear.u[output]
        along = budget_along(linear, [1.0, 2.0, 3.0])
        np.testing.assert_allclose(np.sort(along.shares[:, output])[::-1], shares, rtol=1e-12)
        assert along.correlation_share[output] == pytest.approx(table.correlation_share)
    assert budget(propagate_linear(impedance, inputs), output=0).pairs == ()


def test_budget_along_a_line_changes_hands_where_the_contributions_are_equal():
    x = np.linspace(-2.0, 2.0, 41)
    linear = propagate_linear(
        lambda q: q["a"] + q["b"] * x, [Input("a", 1.0, 0.1), Input("b", 2.0, 0.101)]
    )
    along = budget_along(linear, x)
    assert [(round(s.start, 6), round(s.stop, 6), s.name) for s in along.stretches] == [
        (-2.0, -1.0, "b"),
        (-0.9, 0.9, "a"),
        (1.0, 2.0, "b"),
    ]
    np.testing.assert_allclose(along.shares.sum(axis=0), 100.0)
    np.testing.assert_allclose(along.contributions[1], 0.101 * np.abs(x), atol=1e-12)
    flat = budget_along(propagate_linear(lambda q: q["a"] * x, [Input("a", 1.0, 0.1)]), x)
    assert flat.dominating[20] == ""
    assert [s.name for s in flat.stretches] == ["a", "", "a"]


# Properties


def test_order_of_the_inputs_changes_nothing():
    function, inputs = end_gauge()
    correlation = {("ls", "d"): 0.3, ("d_theta", "d_alpha"): -0.4}
    forward, backward = (
        propagate_linear(function, order, correlation=correlation)
        for order in (inputs, inputs[::-1])
    )
    for name in ("value", "u", "dof", "low", "high"):
        assert getattr(forward, name) == pytest.approx(getattr(backward, name), rel=1e-13), name
    np.testing.assert_array_equal(forward.sensitivities, backward.sensitivities[::-1])
    assert [row.input for row in budget(forward).rows[:4]] == [
        row.input for row in budget(backward).rows[:4]
    ]
    runs = [
        propagate_monte_carlo(
            function, order, rng=np.random.default_rng(5), n_draw=20_000, correlation=correlation
        )
        for order in (inputs, inputs[::-1])
    ]
    np.testing.assert_array_equal(runs[0].draws, runs[1].draws)


def test_units_of_inputs_and_output_change_nothing():
    """A power of two is exact in binary, so the numbers must be the same to the last bit."""
    inputs = [Input("x", 0.6, 0.1, "rectangular"), Input("y", 2.0, 0.3, "t", dof=7)]
    scaled = [
        Input(one.name, 1024 * one.value, 1024 * one.u, one.distribution, one.dof) for one in inputs
    ]

    def function(q):
        return np.sqrt(q["x"]) / q["y"]

    def other(q):
        return 8.0 * function({name: value / 1024 for name, value in q.items()})

    first, second = propagate_linear(function, inputs), propagate_linear(other, scaled)
    assert (second.u, second.low, second.dof) == (8 * first.u, 8 * first.low, first.dof)
    np.testing.assert_array_equal(second.sensitivities, first.sensitivities / 128)
    assert [row.share for row in budget(second).rows] == [row.share for row in budget(first).rows]
    one, two = (
        propagate_monte_carlo(f, i, rng=np.random.default_rng(3), n_draw=20_000)
        for f, i in ((function, inputs), (other, scaled))
    )
    np.testing.assert_array_equal(two.draws, 8 * one.draws)
    assert (two.u, two.shortest.low) == (8 * one.u, 8 * one.shortest.low)


def test_scalar_curve_and_stacked_outputs_agree(rng):
    x = np.array([0.5, 1.0])
    inputs = [Input("theta0[heavy-04]", 1.0, 0.1), Input("phi", 0.1, 0.01)]

    def at(q, x):
        return np.sin(q["theta0[heavy-04]"] * x) - q["phi"]

    forms = [
        lambda q: at(q, x),
        lambda q: (at(q, 0.5), at(q, 1.0)),
        lambda q: np.array([at(q, 0.5), at(q, 1.0)]),
    ]
    curves = [
        propagate_monte_carlo(form, inputs, rng=np.random.default_rng(1), n_draw=20_000)
        for form in forms
    ]
    scalar = propagate_monte_carlo(
        lambda q: at(q, 1.0), inputs, rng=np.random.default_rng(1), n_draw=20_000
    )
    for curve in curves:
        assert curve.draws.shape == (20_000, 2)
        np.testing.assert_array_equal(curve.draws[:, 1], scalar.draws)
        assert curve.u[1] == scalar.u
    assert scalar.u.shape == ()
    lines = [propagate_linear(form, inputs) for form in forms]
    np.testing.assert_array_equal(lines[0].covariance, lines[1].covariance)
    np.testing.assert_array_equal(lines[0].covariance, lines[2].covariance)


def test_records_are_read_only(rng):
    cached = np.array([1.0, 2.0])
    linear = propagate_linear(lambda q: q["x"] * cached, [Input("x", 1.0, 0.1)])
    sampled = propagate_monte_carlo(
        lambda q: q["x"] * cached, [Input("x", 1.0, 0.1)], rng=rng, n_draw=2_000
    )
    along = budget_along(linear, [0.0, 1.0])
    verdict = compare(linear, sampled)
    for record in (linear, sampled, sampled.symmetric, along, verdict):
        for field in record.__dataclass_fields__:
            value = getattr(record, field)
            if isinstance(value, np.ndarray):
                assert not value.flags.writeable, field
    assert cached.flags.writeable
    assert sampled.draws is sampled.where_defined().draws


# Bad input: one line with field, rule, value


A, B = Input("a", 1.0, 0.1), Input("b", 2.0, 0.1)
NOISE = np.random.default_rng(1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Input("", 1.0, 0.1), "'name' must be a non-empty text: "),
        (lambda: Input("a", math.nan, 0.1), "'a.value' must be finite: nan"),
        (lambda: Input("a", "1.0(1)", 0.1), "'a.value' must be a number, not text: 1.0(1)"),
        (lambda: Input("a", 1.0, -0.1), "'a.u' must be finite and >= 0: -0.1"),
        (lambda: Input("a", 1.0, math.inf), "'a.u' must be finite and >= 0: inf"),
        (lambda: Input("a", 1.0, None), "'a.u' must be a number"),
        (
            lambda: Input("a", 1.0, 0.1, "gauss"),
            "'a.distribution' must be one of normal, rectangular, triangular, trapezoidal, ",
        ),
        (
            lambda: Input("a", -1.0, 0.1, "gamma"),
            "'a.value' must be > 0 for the gamma distribution: -1.0",
        ),
        (
            lambda: Input("a", 1.0, 0.1, "trapezoidal", shape=1.5),
            "'a.shape' must lie between 0 and 1",
        ),
        (
            lambda: Input("a", 1.0, 0.1, "normal", shape=0.5),
            "'a.shape' must lie between 0 and 1, and be left out",
        ),
        (lambda: Input("a", 1.0, 0.1, dof=0), "'a.dof' must be > 0: 0.0"),
        (lambda: Input("a", 1.0, 0.1, dof=math.nan), "'a.dof' must be > 0: nan"),
        (lambda: Input("a", 1.0, 0.1, "t"), "'a.dof' must be finite for the t distribution: inf"),
        (lambda: Input("a", 1.0, 0.1, unit=3), "'a.unit' must be a text: 3"),
        (
            lambda: Input.from_half_width("a", 1.0, -1.0),
            "'a.half_width' must be finite and >= 0: -1.0",
        ),
        (
            lambda: Input.from_half_width("a", 1.0, 1.0, distribution="normal"),
            "'a.distribution' must be one of rectangular, triangular, trapezoidal, "
            "curvilinear-trapezoidal, arcsine: normal",
        ),
        (
            lambda: Input.from_readings("a", [1.0]),
            "'a.readings' must be a list of at least two: [1.0]",
        ),
        (lambda: Input.from_readings("a", [1.0, math.nan]), "'a.readings' must be finite: nan"),
        (
            lambda: propagate_linear("a", {"a": [1.85, 1.85, 1.85]}),
            "'a.readings' are all the same, so that their scatter tells no uncertainty: state it, "
            "as Input('a', 1.85, u): 1.85",
        ),
        (
            lambda: Input.from_readings("a", ["x", "y"]),
            "'a.readings' must be numbers, not text: ['x', 'y']",
        ),
        (lambda: propagate_linear(total, []), "'inputs' must hold at least one Input"),
        (lambda: propagate_linear(total, [A, A]), "'inputs' must hold each name once: a"),
        (lambda: propagate_linear(total, [(1.0, 0.1)]), "'inputs[0]' must be an Input: (1.0, 0.1)"),
        (
            lambda: propagate_linear(total, [A, B], correlation={("a", "z"): 0.1}),
            "'correlation' names no input: z",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation={("a", "a"): 1.0}),
            "'correlation' must relate two different inputs",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation={"ab": 1.0}),
            "'correlation' must have pairs of names as keys: ab",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation={("a", "b"): 0.1, ("b", "a"): 0.1}),
            "'correlation' must give each pair once: ('b', 'a')",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation={("a", "b"): 1.5}),
            "'correlation' must lie within [-1, 1]: 1.5",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation=np.eye(3)),
            "'correlation' must be shaped (2, 2): (3, 3)",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation=[[1, 2], [2, 1]]),
            "'correlation' must lie within [-1, 1]",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation=[[1, 0.1], [0.2, 1]]),
            "'correlation' must be symmetric",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation=[[1, 0.1], [0.1, 0.5]]),
            "'correlation' must have ones on the diagonal",
        ),
        (
            lambda: propagate_linear(total, [A, B], correlation="high"),
            "'correlation' must be a matrix of numbers or pairs of names, not text: high",
        ),
        (
            lambda: propagate_linear(
                total, [A, Input("c", 1.0, 0.0)], correlation={("a", "c"): 0.5}
            ),
            "'correlation' must be 0 for a constant (u = 0): c",
        ),
        (
            lambda: propagate_linear(
                total,
                [A, B, Input("c", 0.0, 1.0)],
                correlation={("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9},
            ),
            "'correlation' must have no negative eigenvalue (no quantities are correlated "
            "like this): -0.8",
        ),
        (
            lambda: propagate_linear(total, [A], probability=95),
            "'probability' must lie between 0 and 1: 95",
        ),
        (
            lambda: propagate_linear(lambda q: "high", [A]),
            "'function' must return real numbers, all outputs of one shape",
        ),
        (
            lambda: propagate_linear(lambda q: 1j * q["a"], [A]),
            "'function' must return real numbers, all outputs of one shape",
        ),
        (
            lambda: propagate_linear(lambda q: [[q["a"]]], [A]),
            "'function' must return a number or a list of numbers at one point: (1, 1)",
        ),
        (lambda: propagate_linear(3, [A]), "'function' must be callable: 3"),
        (
            lambda: budget(propagate_linear(total, [A]), output=0),
            "'output' must be left out for a scalar result: 0",
        ),
        (
            lambda: budget(propagate_linear(lambda q: (q["a"], 1.0), [A])),
            "'output' must number one of the outputs 0 to 1 (or use budget_along)",
        ),
        (
            lambda: budget_along(propagate_linear(total, [A]), [0.0]),
            "'linear' must be a curve (use budget for a number): ()",
        ),
        (
            lambda: budget_along(propagate_linear(lambda q: (q["a"], 1.0), [A]), [0.0]),
            "'x' must be shaped (2,): (1,)",
        ),
    ],
)
def test_bad_input_gives_one_line(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def sampled(function=total, inputs=(A,), **choices):
    return propagate_monte_carlo(
        function, inputs, **{"rng": np.random.default_rng(1), "n_draw": 2_000, **choices}
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sampled(n_draw=100), "'n_draw' must be a whole number >= 2000: 100"),
        (lambda: sampled(n_draw=1e6), "'n_draw' must be a whole number >= 2000: 1000000.0"),
        (
            lambda: sampled(n_draw=5_000, probability=0.99),
            "'n_draw' must be a whole number >= 10000: 5000",
        ),
        (
            lambda: sampled(n_draw=None, max_draw=10),
            "'max_draw' must be a whole number >= 2000: 10",
        ),
        (lambda: sampled(n_digits=0), "'n_digits' must be a whole number >= 1: 0"),
        (lambda: sampled(watched="both"), "'watched' must be one of symmetric, shortest: both"),
        (lambda: sampled(probability=0.0), "'probability' must lie between 0 and 1: 0.0"),
        (lambda: sampled(lambda q: math.cos(q["a"])), "'function' must accept arrays"),
        (
            lambda: sampled(lambda q: np.mean(q["a"])),
            "'function' must return (200,) for 200 draws shaped (n_draw,): ()",
        ),
        (
            lambda: sampled(lambda q: q["a"] - np.mean(q["a"])),
            "'function' must treat every draw by itself, and give the same value again",
        ),
        (
            lambda: sampled(lambda q: q["a"] + NOISE.standard_normal(np.shape(q["a"]))),
            "'function' must treat every draw by itself, and give the same value again",
        ),
        (
            lambda: sampled(
                inputs=[Input("a", 0, 1, "arcsine"), B], correlation={("a", "b"): 0.95}
            ),
            "'correlation' between 'a' and 'b' can be 0.9484 at most with these "
            "distributions: 0.95",
        ),
        (
            lambda: sampled(
                inputs=[Input("a", 0, 1, "t", dof=2), B], correlation={("a", "b"): 0.5}
            ),
            "'correlation' cannot include a t distribution with dof <= 2 (it has no "
            "standard deviation): a",
        ),
        (
            lambda: sampled(
                inputs=[Input(name, 0, 1, "arcsine") for name in "abc"],
                correlation={("a", "b"): 0.8, ("b", "c"): 0.8, ("a", "c"): 0.28},
            ),
            "'correlation' cannot be reached by a normal copula of these distributions "
            "(negative eigenvalue)",
        ),
        (
            lambda: compare(propagate_linear(total, [B]), sampled()),
            "'monte_carlo' must come from the same inputs and correlations",
        ),
        (
            lambda: compare(propagate_linear(total, [A], probability=0.9), sampled()),
            "'monte_carlo' must be for probability 0.9 as linear is",
        ),
        (
            lambda: compare(propagate_linear(lambda q: (q["a"], 1.0), [A]), sampled()),
            "'monte_carlo' must have outputs shaped (2,)",
        ),
        (
            lambda: compare(propagate_linear(total, [A]), sampled(), n_digits=0),
            "'n_digits' must be a whole number >= 1: 0",
        ),
        (
            lambda: compare(propagate_linear(total, [A]), sampled(), kind="x"),
            "'kind' must be one of symmetric, shortest: x",
        ),
    ],
)
def test_bad_choices_for_monte_carlo_give_one_line(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_formula_in_text_is_the_same_function() -> None:
    stated = {"L": "0.85(1) m", "T": [1.851, 1.849, 1.855], "pi2": math.pi**2}
    by_text = estim.propagate_linear("4*pi2*L/T**2", stated)
    inputs = [
        Input("L", 0.85, 0.01, unit="m"),
        Input.from_readings("T", [1.851, 1.849, 1.855]),
        Input("pi2", math.pi**2, 0.0),
    ]
    by_hand = estim.propagate_linear(lambda q: 4.0 * q["pi2"] * q["L"] / q["T"] ** 2, inputs)
    assert by_text.value == pytest.approx(float(by_hand.value), rel=1e-14)
    assert by_text.u == pytest.approx(float(by_hand.u), rel=1e-9)
    assert by_text.inputs[0].unit == "m"
    called = estim.propagate_linear("g = 4*pi2*L/T**2", stated)  # as for `estim propagate`
    assert (called.value, called.u) == (by_text.value, by_text.u)
    assert by_text.expanded == pytest.approx(float(by_hand.high - by_hand.value), rel=1e-9)
    drawn = [
        estim.propagate_monte_carlo(f, i, rng=np.random.default_rng(3), n_draw=10_000).draws
        for f, i in (
            ("4*pi2*L/T**2", stated),
            (lambda q: 4 * q["pi2"] * q["L"] / q["T"] ** 2, inputs),
        )
    ]
    np.testing.assert_allclose(drawn[0], drawn[1], rtol=1e-12)


@pytest.mark.parametrize(
    ("formula", "inputs", "message"),
    [
        ("a*b", {"a": "1.0(1)"}, "'function' names no input: b"),
        ("a", {"a": "1.0(1)", "b": 2.0}, "'b' is not in the formula: a"),
        ("a", {"a": "1.0(1) hurz"}, "'a' must have a known unit"),
        ("a.real", {"a": "1.0(1)"}, "'function' must not reach into"),
    ],
)
def test_formula_in_text_says_what_is_wrong(formula, inputs, message) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        estim.propagate_linear(formula, inputs)


def test_print_shows_results_of_propagation() -> None:
    stated = {"V": Input("V", 4.999, 0.0032, dof=4), "I": Input("I", 0.019661, 9.5e-6, dof=4)}
    linear = estim.propagate_linear("V/I", stated, correlation={("V", "I"): -0.36})
    sampled = estim.propagate_monte_carlo(
        "V/I", stated, rng=np.random.default_rng(1), n_draw=20_000
    )
    assert "254.26  0.24  4    2.78  0.66" in str(linear)
    assert "| y | 254.26 | 0.24 | 4 | 2.78 | 0.66 |" in linear._repr_markdown_()
    assert "r(V, I)  −0.36" in str(estim.budget(linear))
    assert "20000 draws" in str(sampled)
    assert "[253." in str(sampled)
    curve = estim.propagate_linear(lambda q: q["V"] * np.arange(20.0), [stated["V"]])
    assert len(str(curve).splitlines()) < 20


def test_correlated_inputs_that_cancel_have_slopes_all_the_same() -> None:
    inputs = {"a": "1.0(1)", "b": "2.0(2)"}
    found = propagate_linear("a - b/2", inputs, correlation={("a", "b"): 1.0})
    assert float(found.u) == pytest.approx(0.0, abs=1e-9)
    assert not any("slope" in note or "derivatives" in note for note in found.notes)


@pytest.mark.parametrize("function", [lambda length, time: length / time, lambda: 1.0])
def test_a_function_of_other_arguments_is_refused_with_an_example(function) -> None:
    inputs = [Input("L", 0.85, 0.01), Input("T", 1.85, 0.003)]
    rule = r"'function' must take one argument, .* as lambda q: 2\*q\[\"L\"\]: \("
    with pytest.raises(InputError, match=rule):
        propagate_linear(function, inputs)
    with pytest.raises(InputError, match=rule):
        propagate_monte_carlo(function, inputs, rng=1)
    assert propagate_linear(lambda q, scale=2.0: scale * q["L"] / q["T"], inputs).u > 0.0
