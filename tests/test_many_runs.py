"""Least squares run by run against dense ones, closed forms and bounded linear least squares; what
reports of many runs leave out.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_runs import DECAY, LINE, Formula, problem_of
from scipy.optimize import least_squares, lsq_linear

from estim import load_campaign
from estim.arrays import inverse_of
from estim.campaign.campaign_file import read_campaign_file
from estim.checks import goodness_of_fit, prior_sensitivity
from estim.checks.goodness_of_fit import Check, Goodness
from estim.fitting import arrowhead
from estim.fitting.fisher_information import information
from estim.fitting.least_squares import _fit_curve, fit_least_squares
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale
from estim.problem.posterior import Problem
from estim.problem.priors import Normal, Uniform
from estim.problem.whitened_residuals import Linear
from estim.reports.curve_figures import MOST_DRAWN, drawn_runs

X = np.linspace(0.0, 1.0, 9)
MANY = arrowhead.MANY_RUNS + 4
REPLICA = Path(__file__).parents[1] / "data" / "replica" / "campaign.toml"


def lines(n: int, rng: np.random.Generator, slope: Normal | Uniform) -> tuple[Problem, np.ndarray]:
    """Lines of one slope and bend with offsets of their own, and their ordinates (n, n_obs)."""
    ys = np.array(
        [
            1.3 * X + 0.2 * X**2 + rng.normal(0.0, 0.7) + 0.2 * rng.standard_normal(X.size)
            for _ in range(n)
        ]
    )
    return problem_of(
        LINE,
        {"slope": slope, "bend": Normal(0.0, 1.0)},
        {"offset": Normal(0.0, 0.7)},
        X,
        list(ys),
        0.2,
    ), ys


def dense(ys: np.ndarray, slope_row: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray]:
    """Design and target of the same least squares, written out.  slope_row : 1/sd and mean/sd of
    the prior of the slope, if it pulls.
    """
    n = len(ys)
    design, target = np.zeros((n * X.size, n + 2)), ys.ravel() / 0.2
    for i in range(n):
        rows = slice(i * X.size, (i + 1) * X.size)
        design[rows, 0], design[rows, 1], design[rows, 2 + i] = X / 0.2, X**2 / 0.2, 1.0 / 0.2
    priors = np.diag([slope_row[0] if slope_row else 0.0, 1.0, *[1.0 / 0.7] * n])
    return np.vstack([design, priors]), np.concatenate(
        [target, [slope_row[1] if slope_row else 0.0], np.zeros(n + 1)]
    )


def test_lines_of_many_runs_have_the_mode_and_covariance_of_linear_algebra(rng):
    problem, ys = lines(MANY, rng, Normal(1.0, 0.5))
    fit = fit_least_squares(problem)
    design, target = dense(ys, (2.0, 2.0))
    expected, cov = np.linalg.lstsq(design, target, rcond=None)[0], np.linalg.inv(design.T @ design)
    assert arrowhead.many(problem)
    assert np.allclose(fit.values, expected, rtol=0.0, atol=1e-10)
    assert np.allclose(fit.cov, cov, rtol=1e-9, atol=1e-12)
    # a model whose runs share their offset ends elsewhere
    assert not np.allclose(
        np.linalg.lstsq(design[:, :3], target, rcond=None)[0][:2], expected[:2], atol=1e-2
    )


def test_a_slope_beyond_its_range_ends_at_the_limit_and_the_others_make_the_best_of_it(rng):
    problem, ys = lines(MANY, rng, Uniform(0.0, 0.8))
    found = arrowhead.descend_by_runs(
        problem.linearised(problem.start()), problem.start(), range(problem.n_par)
    )
    design, target = dense(ys, None)
    low, high = np.full(problem.n_par, -np.inf), np.full(problem.n_par, np.inf)
    low[0], high[0] = 0.0, 0.8
    expected = lsq_linear(design, target, bounds=(low, high), method="bvls").x
    assert found[0] == pytest.approx(0.8, abs=1e-12)
    assert np.allclose(found, expected, rtol=0.0, atol=1e-9)
    cut_off = np.clip(np.linalg.lstsq(design, target, rcond=None)[0], low, high)
    assert not np.allclose(found, cut_off, atol=1e-3)


def test_of_two_parameters_at_their_limits_one_leaves_again(rng):
    """Slope and bend would both be beyond a limit; with the slope at its own the bend is not."""
    problem, ys = lines(MANY, rng, Uniform(0.0, 0.8))
    slope, bend, *offsets = problem.parameters
    problem = Problem((slope, replace(bend, prior=Uniform(0.35, 5.0)), *offsets), problem.runs)
    design, target = dense(ys, None)
    design[MANY * X.size + 1] = 0.0
    low, high = np.full(problem.n_par, -np.inf), np.full(problem.n_par, np.inf)
    low[:2], high[:2] = (0.0, 0.35), (0.8, 5.0)
    free, expected = (
        np.linalg.lstsq(design, target, rcond=None)[0],
        lsq_linear(design, target, bounds=(low, high), method="bvls").x,
    )
    assert free[0] > 0.8 == pytest.approx(expected[0])
    assert free[1] < 0.35 < expected[1] - 0.1
    found = arrowhead.descend_by_runs(
        problem.linearised(problem.start()), problem.start(), range(problem.n_par)
    )
    assert np.allclose(found, expected, rtol=0.0, atol=1e-9)


def test_the_others_make_the_best_of_a_limit_in_the_same_step(rng):
    problem, ys = lines(MANY, rng, Uniform(0.0, 0.8))
    start = problem.start()
    found = arrowhead.descend_by_runs(
        problem.linearised(start), start, range(problem.n_par), most=1
    )
    design, target = dense(ys, None)
    low, high = np.full(problem.n_par, -np.inf), np.full(problem.n_par, np.inf)
    low[0], high[0] = 0.0, 0.8
    assert np.allclose(
        found, lsq_linear(design, target, bounds=(low, high), method="bvls").x, rtol=0.0, atol=1e-9
    )


def test_a_prior_draws_a_parameter_off_the_limit_that_the_points_push_it_to(rng):
    """A bend of 1 by its prior, limited from below, where the points have none and would rather
    have less.
    """
    ys = np.array([1.3 * X - 0.2 * X**2 + 0.2 * rng.standard_normal(X.size) for _ in range(MANY)])
    problem = problem_of(
        LINE,
        {"slope": Normal(1.0, 0.5), "bend": Normal(1.0, 0.01, low=0.0)},
        {"offset": Normal(0.0, 0.7)},
        X,
        list(ys),
        0.2,
    )
    start = problem.start()
    start[:2] = 3.0, 0.0  # above the points
    found = arrowhead.descend_by_runs(problem.linearised(start), start, range(problem.n_par))
    design, target = dense(ys, (2.0, 2.0))
    design[MANY * X.size + 1, 1], target[MANY * X.size + 1] = 100.0, 100.0
    expected = np.linalg.lstsq(design, target, rcond=None)[0]
    assert expected[1] > 0.5
    assert np.allclose(found, expected, rtol=0.0, atol=1e-9)


def test_steps_too_far_are_damped_and_what_is_no_number_is_left(rng):
    """Roots of 1 - rate x: whole steps from far off end where there is no root, and at its edge
    there is no derivative.
    """
    sizes = rng.normal(2.0, 0.1, MANY)
    ys = [size * np.sqrt(1.0 - 0.9 * X) + 0.02 * rng.standard_normal(X.size) for size in sizes]

    def root(x, a):
        return np.sqrt(1.0 - a["rate"] * x)

    curve = Formula(
        lambda x, a: a["size"] * root(x, a),
        {"size": root, "rate": lambda x, a: -0.5 * a["size"] * x / root(x, a)},
    )
    problem = problem_of(
        curve, {"rate": Uniform(-20.0, 20.0)}, {"size": Uniform(0.0, 10.0)}, X, ys, 0.02
    )

    def residuals(values):
        return np.concatenate(
            [
                (size * np.sqrt(1.0 - values[0] * X) - y) / 0.02
                for size, y in zip(values[1:], ys, strict=True)
            ]
        )

    expected = least_squares(
        residuals,
        [0.8, *sizes],
        bounds=([-20.0, *[0.0] * MANY], [0.999, *[10.0] * MANY]),
        x_scale="jac",
        xtol=1e-12,
    )
    for rate in (-15.0, 1.0):
        start = np.array([rate, *[5.0] * MANY])
        found = arrowhead.descend_by_runs(problem.linearised(start), start, range(problem.n_par))
        assert np.allclose(found, expected.x, rtol=1e-6)


def test_eight_runs_end_where_dense_least_squares_do_to_eight_digits(rng):
    ys = [
        rng.normal(2.0, 0.1) * np.exp(-1.5 * X) + 0.02 * rng.standard_normal(X.size)
        for _ in range(8)
    ]
    problem = problem_of(
        DECAY, {"rate": Normal(1.0, 1.0)}, {"size": Uniform(0.0, 10.0)}, X, ys, 0.02
    )
    posterior = problem.linearised(problem.start())
    one_by_one, together = (
        arrowhead.descend_by_runs(posterior, problem.start(), range(problem.n_par)),
        _fit_curve(posterior, problem.start()),
    )
    assert not arrowhead.many(problem)
    assert np.allclose(one_by_one, together, rtol=1e-8, atol=0.0)


def test_eight_runs_of_the_replica_end_where_dense_least_squares_do():
    campaign = load_campaign(REPLICA)
    problem = campaign.problem(campaign.run_names)
    problem = replace(problem, runs=tuple(replace(run, force=0.0) for run in problem.runs))
    posterior = problem.linearised(problem.start())
    free = range(problem.n_par)
    one_by_one, together = (
        arrowhead.descend_by_runs(posterior, problem.start(), free),
        _fit_curve(posterior, problem.start()),
    )
    matrix = information(posterior, together)
    assert np.max(np.abs(one_by_one - together) * np.sqrt(np.diag(matrix))) < 1e-5
    assert arrowhead._height(posterior, one_by_one) <= arrowhead._height(posterior, together) * (
        1.0 + 1e-13
    )


def test_what_is_not_positive_has_the_inverse_of_what_is_said(rng):
    problem, _ = lines(MANY, rng, Normal(1.0, 0.5))
    matrix = information(problem.linearised(problem.start()), problem.start())
    assert np.allclose(inverse_of(matrix) @ matrix, np.eye(problem.n_par), atol=1e-9)
    matrix[3], matrix[:, 3] = 0.0, 0.0
    said = np.diag(np.arange(problem.n_par) != 3)
    assert np.allclose(inverse_of(matrix) @ matrix, said, atol=1e-9)


def test_derivatives_of_each_run_in_its_own_parameters_are_those_of_differences(rng):
    problem, _ = lines(5, rng, Normal(1.0, 0.5))
    posterior, at, step = problem.linearised(problem.start()), problem.start() + 0.1, 1e-5
    columns = [
        (posterior.residuals(at + step * e) - posterior.residuals(at - step * e)) / (2.0 * step)
        for e in np.eye(problem.n_par)
    ]
    assert np.allclose(posterior.jacobian(at), np.column_stack(columns), atol=1e-6)
    assert [used.tolist() for used in problem.columns] == [[0, 1, 2 + i] for i in range(5)]


def test_spreads_of_each_run_are_the_blocks_of_the_inverse(rng):
    problem, ys = lines(MANY, rng, Normal(1.0, 0.5))
    roots, slopes = (
        [
            jacobian
            for jacobian, _ in problem.linearised(problem.start()).narrow_scoring(problem.start())
        ],
        1.0 / np.array([0.5, 1.0, *[0.7] * MANY]),
    )
    design, _ = dense(ys, (2.0, 2.0))
    whole = np.linalg.inv(design.T @ design)
    for found, used in zip(
        arrowhead.spreads_by_runs(roots, problem.columns, np.diag(slopes)),
        problem.columns,
        strict=True,
    ):
        assert np.allclose(found @ found.T, whole[np.ix_(used, used)], rtol=1e-9)
    nothing = arrowhead.spreads_by_runs(
        [np.array([[1.0, 0.0], [2.0, 0.0]])] * 2,
        [np.array([0, i]) for i in (1, 2)],
        np.zeros((3, 3)),
    )
    assert np.allclose([root @ root.T for root in nothing], [[0.1, 0.0], [0.0, 0.0]])


def test_units_of_a_runs_own_parameters_change_nothing(rng):
    """Columns of which one is 1e21 times as long as the other: an amplitude in pC and a rate in 1/s
    written in SI units.
    """
    units = np.array([1.0, 1e-12, 1e9])
    roots, slopes = [rng.standard_normal((9, 3)) for _ in range(3)], np.array([0.5, *[0.0] * 6])
    columns = [np.array([0, 1 + 2 * i, 2 + 2 * i]) for i in range(3)]
    found, other = (
        np.array(
            [
                spread @ spread.T
                for spread in arrowhead.spreads_by_runs(
                    [root / unit for root in roots], columns, np.diag(slopes)
                )
            ]
        )
        for unit in (1.0, units)
    )
    assert np.allclose(other / np.outer(units, units), found, rtol=1e-9)


def test_many_runs_share_the_foremost_parameters(rng):
    problem, _ = lines(MANY, rng, Normal(1.0, 0.5))
    assert problem.foremost(5) == [0, 1, 2, 3, 4]
    assert problem.foremost(problem.n_par) == list(range(problem.n_par))


def test_of_many_runs_priors_are_asked_for_where_a_run_needs_both(rng):
    problem, _ = lines(MANY, rng, Normal(1.0, 0.5))
    beside = prior_sensitivity._neighbours(problem)
    assert [problem.names[i] for i in beside[2]] == ["slope", "bend", "offset[0]"]
    assert len(beside[0]) == problem.n_par


def test_of_many_runs_those_are_drawn_that_the_curve_explains_worst():
    def judged(i: int) -> Goodness:
        p_value = 0.001 if i >= 30 else 0.5
        return Goodness(
            f"r{i}",
            np.zeros(2),
            np.zeros(2),
            np.ones(2),
            {"chi2": Check(0.0, p_value, "")},
            np.nan,
            0.0,
            np.nan,
        )

    drawn = drawn_runs([judged(i) for i in range(40)])
    assert len(drawn) == MOST_DRAWN
    assert set(range(30, 40)) < set(drawn)
    assert drawn == sorted(drawn)
    assert drawn_runs([judged(i) for i in range(8)]) == list(range(8))


def test_a_campaign_file_that_changes_is_read_anew(tmp_path):
    path = tmp_path / "campaign.toml"
    path.write_text(REPLICA.read_text())
    first = read_campaign_file(path)
    assert read_campaign_file(path) is first
    path.write_text(REPLICA.read_text().replace("Synthetic replica", "Another"))
    assert read_campaign_file(path).title.startswith("Another")


def test_simulated_residuals_of_each_run_are_those_of_all_runs_together(rng):
    """Two runs of twenty say most of what all share, so that errors of the other one move the
    residuals of the first.
    """
    problem, ys = lines(MANY, rng, Normal(1.0, 0.5))
    precise = tuple(
        replace(run, noise=Independent(Scale(0.02), Scale(0.0), np.ones(X.size)))
        for run in problem.runs[:2]
    )
    problem = Problem(problem.parameters, (*precise, *problem.runs[2:]))
    fit = fit_least_squares(problem)
    root = fit.posterior.narrow_scoring(fit.values)[0][0]
    design, _ = dense(ys, (2.0, 2.0))
    design[: 2 * X.size] *= 10.0
    rows, spread_of_all = design[: X.size], np.linalg.inv(design.T @ design)
    taken = rows @ spread_of_all @ rows.T
    spread = arrowhead.spreads_by_runs(
        [jacobian for jacobian, _ in fit.posterior.narrow_scoring(fit.values)],
        problem.columns,
        fit.prior_jacobian,
    )[0]
    n = 40_000
    none = np.zeros(X.size)
    readings = goodness_of_fit._recording([(none, none, none, none + 1.0)])
    draws = goodness_of_fit._simulated(Linear(none, root), spread, readings, rng)(n)[0]().T
    within = 5.0 * np.sqrt(2.0 / n)
    assert np.all(np.abs(np.cov(draws.T) - (np.eye(X.size) - taken)) < within)
    assert np.max(np.abs(taken)) > 2.0 * within  # what the fit takes is seen
    assert np.max(np.abs(taken - taken @ taken)) > 2.0 * within  # and what errors of the others add


def test_a_second_look_at_a_long_run_holds_one_block_of_residuals_at_a_time(rng, monkeypatch):
    sizes = []
    simulated = goodness_of_fit._simulated

    def counted(*given):
        draw = simulated(*given)
        return lambda n: sizes.append(n) or draw(n)

    monkeypatch.setattr(goodness_of_fit, "_simulated", counted)
    monkeypatch.setattr(goodness_of_fit, "_MOST_AT_ONCE", 5e4)
    problem, _ = lines(MANY, rng, Normal(1.0, 0.5))
    bent = replace(problem.runs[0], y=problem.runs[0].y + 6.0 * (X - 0.5) ** 2)
    goodness_of_fit.check_goodness(
        fit_least_squares(Problem(problem.parameters, (bent, *problem.runs[1:]))), rng=rng
    )
    # one run fails, and is simulated to the end; the others are told to pass much sooner
    assert 20_000 < sum(sizes) < 20_000 * (MANY + 1)
    assert max(sizes) * X.size <= 5e4
