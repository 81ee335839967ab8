"""An unmodelled force: its linear responses against an integrator that shares no code, and the
force that is found by dense matrices.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from one_way import fine_places, position_response, through
from scipy import stats
from wheels import G_R, Wheel

from estim.discrepancy.force import (
    force_kernel,
    force_shapes,
    shared_force_shapes,
    speed_response,
    track,
)
from estim.discrepancy.grid import FORCE_SCALE, START_SD, Grid, prior_grid
from estim.discrepancy.inferred_force import find_force
from estim.discrepancy.kernels import without_mean
from estim.discrepancy.linearised import linearise
from estim.discrepancy.scale_mixture import diagonalise
from estim.problem.roots import root_of


def profile(u):
    return np.sin(1.3 * u + 0.4) + 0.3 * np.cos(2.9 * u)


def released(wheel: Wheel, first: float = 0.0):
    """A track of 15 rad with the response of positions at frames of 1/10 s."""
    t = np.arange(0.3, 3.6, 0.1)
    u = wheel.motion(t, lambda u: 0.0 * u)
    along = track(u[-1])
    fine = fine_places(along, first)
    return (
        t,
        u,
        along,
        position_response(along, fine, u, wheel.rate(fine), wheel.inertia(fine), acceleration=G_R),
    )


def test_positions_answer_to_a_force_as_an_integrator_says():
    wheel = Wheel()
    t, _, along, response = released(wheel)
    size = 1e-5
    truth = (
        wheel.motion(t, lambda u: size * profile(u)) - wheel.motion(t, lambda u: -size * profile(u))
    ) / (2.0 * size)
    linear = response.force @ profile(along.nodes)
    np.testing.assert_allclose(linear, truth, atol=5e-3 * np.abs(truth).max())


def test_positions_answer_to_a_push_but_for_a_shift_of_time():
    wheel = Wheel()
    _, u, _, response = released(wheel)
    size, shift = 1e-4, wheel.rate(u)[:, None]
    # by the time that a place is reached, from 0.02 rad on
    place, late = np.linspace(0.02, u[-1], 400_001), []
    for start in (size, -size):
        slowness = 1.0 / wheel.rate(place, start)
        late.append(
            np.interp(
                u,
                place,
                np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))] * (place[1] - place[0]),
            )
        )
    truth = -(late[0] - late[1]) / (2.0 * size) * wheel.rate(u)
    left = truth - response.start
    rest = left - shift @ np.linalg.lstsq(shift, left, rcond=None)[0]
    alone = response.start - shift @ np.linalg.lstsq(shift, response.start, rcond=None)[0]
    assert np.abs(rest).max() < 4e-3 * np.abs(alone).max()
    assert np.abs(alone).max() > 3.0  # and not a shift of time itself


def test_where_the_observations_begin_does_not_matter_but_for_a_shift_of_time():
    wheel = Wheel()
    _, u, along, whole = released(wheel)
    _, _, _, late = released(wheel, first=u[0])
    shift = wheel.rate(u)[:, None]
    left = (whole.force - late.force) @ profile(along.nodes)
    rest = left - shift @ np.linalg.lstsq(shift, left, rcond=None)[0]
    assert np.abs(rest).max() < 1e-3 * np.abs(whole.force @ profile(along.nodes)).max()


def test_speeds_answer_to_a_force_and_to_a_push():
    wheel, size = Wheel(), 1e-6
    u = np.linspace(0.5, 15.0, 25)
    response = speed_response(
        along := track(15.0), u, wheel.rate(u), wheel.inertia(u), acceleration=G_R
    )
    work = (np.cos(0.4) - np.cos(1.3 * u + 0.4)) / 1.3 + 0.3 * np.sin(2.9 * u) / 2.9
    truth = (wheel.rate(u, size * work) - wheel.rate(u, -size * work)) / (2.0 * size)
    np.testing.assert_allclose(
        response.force @ profile(along.nodes), truth, atol=5e-3 * np.abs(truth).max()
    )
    np.testing.assert_allclose(
        response.start, (wheel.rate(u, size) - wheel.rate(u, -size)) / (2.0 * size), rtol=1e-6
    )


def test_speeds_by_differences_answer_as_the_positions_that_they_are_made_of():
    wheel, size = Wheel(), 1e-5
    t, u, along, response = released(wheel)
    n = t.size
    stencil = (np.eye(n, k=1) - np.eye(n, k=-1))[1:-1] / 0.2
    slope = np.array([(wheel.rate(a + 1e-6) - wheel.rate(a - 1e-6)) / 2e-6 for a in u[1:-1]])
    rows = stencil.copy()
    rows[np.arange(n - 2), np.arange(1, n - 1)] -= slope
    found = through(response, rows)

    def residual(eps):
        shifted = wheel.motion(t, lambda u: eps * profile(u))
        return stencil @ shifted - wheel.rate(shifted[1:-1])

    truth = (residual(size) - residual(-size)) / (2.0 * size)
    np.testing.assert_allclose(
        found.force @ profile(along.nodes), truth, atol=6e-3 * np.abs(truth).max()
    )


def test_speeds_by_differences_answer_as_speeds_do_where_little_changes_between_frames():
    wheel = Wheel(gamma=0.0)
    _, u, along, response = released(wheel)
    rows = (np.eye(u.size, k=1) - np.eye(u.size, k=-1))[1:-1] / 0.2
    # v = sqrt(2 a x)
    rows[np.arange(u.size - 2), np.arange(1, u.size - 1)] -= 0.5 * wheel.rate(u[1:-1]) / u[1:-1]
    plain = speed_response(
        along, u[1:-1], wheel.rate(u[1:-1]), wheel.inertia(u[1:-1]), acceleration=G_R
    )
    slow = np.sin(0.4 * along.nodes)
    truth = plain.force @ slow
    np.testing.assert_allclose(
        through(response, rows).force @ slow, truth, atol=0.03 * np.abs(truth).max()
    )


def test_a_force_shared_by_runs_and_an_own_one_for_each():
    wheel = Wheel()
    _, _, along, response = released(wheel)
    runs = (response, replace(response, force=response.force[3:12]))
    shapes = shared_force_shapes(along, runs, own=(0.5, 2.0))
    assert np.logaddexp.reduce([shape.log_prior for shape in shapes]) == pytest.approx(
        0.0, abs=1e-12
    )
    kernel = force_kernel(along, shapes[2].length)
    shared = without_mean(kernel, along.weights)
    first, second = (run.force for run in runs)
    found = shapes[3].factor @ shapes[3].factor.T
    truth = np.block(
        [
            [first @ (shared + 4.0 * kernel) @ first.T, first @ shared @ second.T],
            [second @ shared @ first.T, second @ (shared + 4.0 * kernel) @ second.T],
        ]
    )
    np.testing.assert_allclose(found, truth, atol=1e-8 * np.abs(truth).max())
    deviation = diagonalise(root_of(np.ones(found.shape[0])), shapes, prior_grid(FORCE_SCALE))
    assert len(deviation.families) == 12


def test_the_force_that_is_found_is_the_conditional_one():
    """One component: against the joint normal distribution of force, parameters and observations,
    by dense matrices.
    """
    wheel = Wheel()
    _, u, along, response = released(wheel)
    grid = Grid(np.array([0.02]), np.zeros(1), np.ones(1), np.zeros(1))
    amplitude, sd = grid.amplitudes[0], 0.004
    shape = force_shapes(along, response)[3]
    deviation = diagonalise(root_of(np.full(u.size, sd**2)), (replace(shape, log_prior=0.0),), grid)
    jacobian, precision, pull = (
        np.column_stack([wheel.rate(u), response.start]),
        np.diag([1.0, START_SD**-2]),
        np.array([0.3, -0.01]),
    )
    observed = response.force @ (0.02 * profile(along.nodes)) + 0.1 * wheel.rate(u)
    found = find_force(
        linearise(deviation, observed, jacobian, precision=precision, pull=pull), along, response
    )

    prior = amplitude**2 * without_mean(force_kernel(along, shape.length), along.weights)
    total = (
        response.force @ prior @ response.force.T
        + sd**2 * np.eye(u.size)
        + jacobian @ np.linalg.inv(precision) @ jacobian.T
    )
    gain = np.linalg.solve(total, response.force @ prior).T
    np.testing.assert_allclose(found.mean, gain @ (observed - jacobian @ pull), atol=1e-7)
    spread = np.sqrt(np.diag(prior - gain @ response.force @ prior))
    np.testing.assert_allclose(
        found.quantiles[3] - found.quantiles[1], 2.0 * stats.norm.ppf(0.84) * spread, rtol=1e-3
    )
    np.testing.assert_allclose(found.quantiles[3] - found.quantiles[2], spread, rtol=6e-3)
    assert along.weights @ found.mean == pytest.approx(0.0, abs=1e-9)
    assert found.probability == pytest.approx(1.0)
    assert found.material_sd == pytest.approx(0.60 * amplitude, rel=0.02)
