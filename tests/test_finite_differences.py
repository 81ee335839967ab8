"""Speeds by differences: exact on polynomials, truncation against Taylor, covariance against
simulation, gaps and unequal steps.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from estim import InputError
from estim.problem.finite_differences import STENCILS, differentiate

EACH = pytest.mark.parametrize("name", STENCILS)


@pytest.mark.parametrize(("name", "degree"), [("central", 2), ("spill2", 2), ("five-point", 4)])
def test_exact_on_polynomials_up_to_a_degree_and_not_beyond(name, degree):
    t = 0.3 + np.arange(12) / 30
    for power in range(degree + 2):
        derivative = differentiate(t, t**power, STENCILS[name])
        exact = power * t[derivative.rows] ** max(power - 1, 0)
        error = np.abs(derivative.value - exact).max()
        assert (error < 1e-12) == (power <= degree), power


@EACH
def test_printed_weights_of_each_stencil(name):
    x, dt = np.array([3.0, -1.0, 4.0, 1.0, -5.0]), 0.1
    by_hand = {
        "central": (x[3] - x[1]) / (2 * dt),
        "five-point": (x[0] - 8 * x[1] + 8 * x[3] - x[4]) / (12 * dt),
        "spill2": (2 * x[4] + x[3] - x[1] - 2 * x[0]) / (10 * dt),
    }
    derivative = differentiate(np.arange(5) * dt, x, STENCILS[name])
    assert derivative.value[derivative.rows == 2] == pytest.approx(by_hand[name], rel=1e-12)


def test_spill2_is_the_slope_of_the_least_squares_line_through_five_frames(rng):
    t, x = np.arange(5) / 30, rng.standard_normal(5)
    assert differentiate(t, x, STENCILS["spill2"]).value == pytest.approx(
        np.polyfit(t, x, 1)[0], rel=1e-12
    )


@EACH
def test_truncation_is_that_of_taylor(name):
    # x = sin(w t): v = w cos(w t), d^n v/dt^n = (-1)^(n/2) w^n v for even n
    stencil, w, t0 = STENCILS[name], 1.7, 0.4
    truncations = []
    for dt in (0.08, 0.04):
        t = t0 + dt * np.arange(-2, 3)
        derivative = differentiate(t, np.sin(w * t), stencil)
        v = w * math.cos(w * t0)
        bent = (-1) ** (stencil.order // 2) * w**stencil.order * v
        truncations.append(
            (derivative.value[derivative.rows == 2][0] - v) / (dt**stencil.order * bent)
        )
    # the next order is dt^2 smaller: extrapolate it away
    extrapolated = (4 * truncations[1] - truncations[0]) / 3
    assert extrapolated == pytest.approx(stencil.truncation, rel=1e-3)
    assert truncations[1] != pytest.approx(stencil.truncation, rel=1e-5)


@EACH
def test_truncation_and_order_follow_from_the_weights(name):
    stencil = STENCILS[name]
    moments = [
        sum(w * k**p for k, w in zip(stencil.offsets, stencil.weights, strict=True))
        / math.factorial(p)
        for p in range(stencil.order + 2)
    ]
    assert moments[:2] == pytest.approx([0.0, 1.0], abs=1e-15)
    assert moments[2 : stencil.order + 1] == pytest.approx([0.0] * (stencil.order - 1), abs=1e-15)
    assert moments[stencil.order + 1] == pytest.approx(stencil.truncation, rel=1e-14)


@EACH
def test_speeds_are_the_matrix_times_the_positions(name, rng):
    t = np.delete(np.arange(30) / 30, [7, 8, 20])
    x = rng.standard_normal(t.size)
    derivative = differentiate(t, x, STENCILS[name])
    assert derivative.matrix.toarray().shape == (derivative.rows.size, t.size)
    assert derivative.matrix @ x == pytest.approx(derivative.value, rel=1e-14)
    assert (
        np.count_nonzero(derivative.matrix.toarray(), axis=1).tolist()
        == [len(STENCILS[name].offsets)] * derivative.rows.size
    )


@EACH
def test_noise_gain_is_the_scatter_of_simulated_speeds(name, rng):
    t, sigma = np.arange(9) / 30, 0.001
    errors = np.array(
        [
            differentiate(t, sigma * rng.standard_normal(9), STENCILS[name]).value
            for _ in range(2000)
        ]
    )
    predicted = sigma * STENCILS[name].noise_gain * 30
    assert errors.std(axis=0) == pytest.approx(
        np.full(errors.shape[1], predicted), rel=4.5 / math.sqrt(2 * 2000)
    )
    wrong = {"central": 1.0, "five-point": 0.5, "spill2": 1.0}[name] * sigma * 30
    assert errors.std() != pytest.approx(wrong, rel=0.05)


def test_covariance_of_neighbouring_speeds_is_the_one_of_the_matrix(rng):
    t = np.arange(12) / 30
    matrix = differentiate(t, np.zeros(12), STENCILS["central"]).matrix.toarray()
    errors = rng.standard_normal((4000, 12)) @ matrix.T / 30
    simulated, exact = np.cov(errors.T), matrix @ matrix.T / 30**2
    assert np.abs(simulated - exact).max() < 5 * 0.5 / math.sqrt(4000)
    # speeds two frames apart share one position: correlation -1/2, which independent speeds would
    # not have
    assert np.diag(exact, 2) / exact[0, 0] == pytest.approx(np.full(8, -0.5))
    assert np.diag(exact, 1) == pytest.approx(np.zeros(9))


@pytest.mark.parametrize(
    ("name", "left_out"), [("central", {0, 6, 7, 10}), ("five-point", {0, 1, 5, 6, 7, 8, 9, 10})]
)
def test_a_missing_frame_leaves_a_hole_on_either_side(name, left_out):
    frames = np.delete(np.arange(12), 7)  # rows 0-6 are frames 0-6, rows 7-10 are frames 8-11
    derivative = differentiate(frames / 30, (frames / 30) ** 2, STENCILS[name])
    assert set(range(11)) - set(derivative.rows.tolist()) == left_out
    assert derivative.value == pytest.approx(2 * frames[derivative.rows] / 30, rel=1e-11)


def test_speeds_beside_several_missing_frames_are_left_out():
    frames = np.array([0, 1, 2, 3, 7, 8, 9, 11, 12, 13])
    derivative = differentiate(frames * 0.04, frames * 1.0, STENCILS["central"])
    assert derivative.interval == pytest.approx(0.04, rel=1e-12)
    assert derivative.rows.tolist() == [1, 2, 5, 8]


def test_no_frame_with_neighbours_is_an_error():
    with pytest.raises(
        InputError,
        match=r"^a\.csv: 't_s' leaves no frame with the neighbours that the five-point derivative "
        r"needs$",
    ):
        differentiate(
            np.array([0.0, 0.1, 0.2, 0.4, 0.5, 0.6]),
            np.zeros(6),
            STENCILS["five-point"],
            file="a.csv",
        )


@pytest.mark.parametrize(
    ("steps", "line", "value"),
    [
        ([1, 1, 1, 1.5, 1, 1], 9, 4.5),
        ([1, 1, 0.4, 1, 1, 1], 8, 2.4),
        ([1, 1.2, 1, 1, 1, 1], 7, 2.2),
    ],
)
def test_unequal_steps_are_refused_with_their_line(steps, line, value):
    t = np.concatenate([[0.0], np.cumsum(steps)])
    with pytest.raises(InputError, match=r"must advance by equal steps") as caught:
        differentiate(t, t, STENCILS["central"], file="a.csv", lines=np.arange(7) + 5)
    assert (caught.value.file, caught.value.line, caught.value.field) == ("a.csv", line, "t_s")
    assert caught.value.value == pytest.approx(value)


@pytest.mark.parametrize("rate", [25, 30, 59.94, 120, 240])
def test_times_rounded_to_four_decimals_are_equal_steps(rate):
    exact = np.arange(100) / rate
    derivative = differentiate(np.round(exact, 4), np.sin(exact), STENCILS["central"])
    assert derivative.interval == pytest.approx(1 / rate, abs=1e-4 / 99)
    assert derivative.rows.size == 98
    # and the rounding of single times does not reach the speeds
    assert derivative.value == pytest.approx(
        np.sin(1 / rate) * rate * np.cos(exact[1:-1]), rel=4e-4, abs=1e-6
    )


def test_shifting_the_clock_or_the_origin_changes_no_speed(rng):
    t, x = np.arange(20) / 30, rng.standard_normal(20)
    plain = differentiate(t, x, STENCILS["five-point"]).value
    assert differentiate(t + 100.0, x + 5.0, STENCILS["five-point"]).value == pytest.approx(
        plain, abs=1e-9
    )


def test_a_derivative_cannot_be_written_to():
    derivative = differentiate(np.arange(6) * 0.1, np.zeros(6), STENCILS["central"])
    for array in (derivative.rows, derivative.value, derivative.matrix.data):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(TypeError):
        STENCILS["central"] = STENCILS["spill2"]


def test_a_long_recording_needs_no_dense_matrix():
    t = np.arange(100_000.0)
    derivative = differentiate(t, t**2, STENCILS["central"])
    assert derivative.value[-1] == pytest.approx(2.0 * t[-2])
    assert derivative.matrix.nnz == 2 * derivative.rows.size
