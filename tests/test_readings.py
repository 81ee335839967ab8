"""What instruments read of a motion."""

from __future__ import annotations

import numpy as np
import pytest

from estim.model import Readings, blurred_sigma

ODD = Readings(scale_x=0.01, scale_t=-0.02, bow=0.005, length=0.6, start=0.1)


def test_perfect_instruments_read_what_is_true():
    x, perfect = np.linspace(-0.1, 0.5, 7), Readings()
    assert np.array_equal(perfect.position(x), x)
    assert perfect.true_position(x) == pytest.approx(x, abs=1e-15)
    assert np.array_equal(perfect.speed(x, x), x)
    assert np.array_equal(perfect.time(x), x)


def test_true_positions_and_times_come_back():
    x = np.linspace(-0.1, 0.5, 13)
    assert ODD.true_position(ODD.position(x)) == pytest.approx(x, abs=1e-14)
    assert ODD.true_time(ODD.time(x)) == pytest.approx(x)
    draws = Readings(bow=np.array([[0.0], [-0.004], [0.004]]), length=0.6)
    assert draws.true_position(draws.position(x)) == pytest.approx(np.tile(x, (3, 1)), abs=1e-14)


def test_the_bow_leaves_the_ends_of_the_picture_and_the_release_alone():
    bent = Readings(bow=0.005, length=0.6, start=0.1)
    place = np.array([-0.1, 0.0, 0.2, 0.5])  # an end, the release, the middle, the other end
    moved = bent.position(place) - place
    at_release = 4 * 0.005 * 0.1 * 0.5 / 0.36
    assert moved == pytest.approx([-at_release, 0.0, 0.005 - at_release, -at_release])


def test_speeds_are_the_change_of_what_is_read():
    t, h = np.linspace(0.2, 1.0, 9), 1e-5
    path = lambda t: 0.3 * t**2  # noqa: E731
    difference = (ODD.position(path(t + h)) - ODD.position(path(t - h))) / (
        ODD.time(t + h) - ODD.time(t - h)
    )
    assert ODD.speed(0.6 * t, path(t)) == pytest.approx(difference, rel=1e-9)


def test_a_reading_beyond_the_farthest_is_no_position():
    assert np.isnan(Readings(bow=0.3, length=0.6).true_position([0.2, 5.0])).tolist() == [
        False,
        True,
    ]


def test_motion_blur_grows_with_speed(rng):
    assert blurred_sigma(0.001, 0.0, exposure=0.02) == pytest.approx(0.001)
    v, exposure = 0.8, 0.02
    marked = 0.001 * rng.standard_normal(40_000) + v * exposure * rng.uniform(-0.5, 0.5, 40_000)
    assert marked.std() == pytest.approx(
        blurred_sigma(0.001, v, exposure=exposure), rel=5.0 / np.sqrt(2 * 40_000)
    )
    assert blurred_sigma(0.001, -v, exposure=exposure) == blurred_sigma(0.001, v, exposure=exposure)
