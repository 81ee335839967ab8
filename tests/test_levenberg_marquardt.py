"""Batched least squares (`estim.levenberg_marquardt`) against SciPy's, one start at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.special import voigt_profile

from estim import fit_curve
from estim.arrays import FloatArray, IntArray
from estim.levenberg_marquardt import LeastSquares, bounded_steps

X = np.linspace(0.0, 6.0, 40)


def decays(points: FloatArray) -> FloatArray:
    a, rate, c = (points[:, [i]] for i in range(3))
    return a * np.exp(-rate * X) + c


def function(y: FloatArray, low: float, linear: tuple[int, ...]) -> LeastSquares:
    """Data sets y (n, n_obs), one for each descent, and a rate of at least `low`."""

    def residuals(points: FloatArray, which: IntArray) -> FloatArray:
        return decays(points) - y[which]

    nonlinear = np.array([i for i in range(3) if i not in linear])
    return LeastSquares(
        residuals,
        np.array([-np.inf, low, -np.inf]),
        np.full(3, np.inf),
        np.ones(3),
        np.array(linear, dtype=np.int64),
        nonlinear,
        1e-7,
        X.size,
    )


def test_linear_parameters_alone_are_solved_for_at_one_look(rng: np.random.Generator) -> None:
    """As those of a curve are whose rate is held, however far it is off; where the curve is not
    finite a point stays where it is.
    """
    truth = np.array([[3.0, 0.5, 1.0]])
    y = decays(truth) + 0.05 * rng.standard_normal((1, X.size))
    looks = []

    def residuals(points: FloatArray, _which: IntArray) -> FloatArray:
        looks.append(len(points))
        return decays(points) - y

    search = replace(
        function(y, 0.0, (0, 2)), residuals=residuals, nonlinear=np.zeros(0, dtype=np.int64)
    )
    starts = np.array([[9.0, rate, -2.0] for rate in (0.2, 0.5, 4.0, -1e3)])
    ends, squares, converged = search.descend(starts, ftol=1e-12, max_steps=100)
    assert looks == [4 * 3]  # each point, and beside it in both linear parameters
    for rate, end, square in zip(starts[:3, 1], ends[:3], squares[:3], strict=True):
        columns = np.column_stack([np.exp(-rate * X), np.ones(X.size)])
        exact, least, *_ = np.linalg.lstsq(columns, y[0])
        np.testing.assert_allclose(end, [exact[0], rate, exact[1]], rtol=1e-8)
        assert square == pytest.approx(float(least[0]), rel=1e-9)
    assert converged.tolist() == [True, True, True, False]
    assert ends[3].tolist() == starts[3].tolist()
    assert squares[3] == np.inf


def test_objectives_are_those_of_points_as_they_are(rng: np.random.Generator) -> None:
    """Linear parameters are not solved for; of no points there are none."""
    y = rng.standard_normal((1, X.size))
    points = np.array([[3.0, 0.5, 1.0], [0.0, 1.0, 2.0], [1.0, -1e3, 0.0]])
    search = replace(function(y, 0.0, (0, 2)), residuals=lambda points, _: decays(points) - y)
    with np.errstate(over="ignore"):
        expected = 0.5 * np.sum((decays(points) - y) ** 2, axis=1)
    np.testing.assert_allclose(search.objectives(points), expected, rtol=1e-14)
    assert search.objectives(points[:0]).shape == (0,)


@pytest.mark.parametrize("linear", [(), (0, 2)])
@pytest.mark.parametrize("low", [0.0, 0.7])
def test_all_descents_end_where_scipy_ends(
    linear: tuple[int, ...], low: float, rng: np.random.Generator
) -> None:
    truth = np.column_stack(
        [rng.uniform(1.0, 5.0, 30), rng.uniform(0.3, 1.5, 30), rng.uniform(-1.0, 1.0, 30)]
    )
    y = decays(truth) + 0.05 * rng.standard_normal((30, X.size))
    start = np.tile([2.0, 1.0, 0.5], (30, 1))
    ends, squares, converged = function(y, low, linear).descend(start, ftol=1e-12, max_steps=100)
    for k in range(30):
        best = least_squares(
            lambda p, k=k: decays(p[None, :])[0] - y[k],
            start[k],
            bounds=([-np.inf, low, -np.inf], np.inf),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        assert squares[k] == pytest.approx(2.0 * best.cost, rel=1e-6)
        np.testing.assert_allclose(ends[k], best.x, rtol=1e-3, atol=1e-4)
    assert np.all(converged)


def test_where_there_is_no_height_a_point_stays() -> None:
    y = decays(np.array([[3.0, 0.5, 1.0]]))
    start = np.array([[2.0, -1e4, 0.5]])
    _, squares, converged = function(y, -np.inf, ()).descend(start, ftol=1e-9, max_steps=20)
    assert np.isinf(squares[0])
    assert not converged[0]


def test_a_width_near_its_limit_leaves_it_though_the_curve_is_all_but_level_there(
    rng: np.random.Generator,
) -> None:
    """A Voigt profile is even in sigma: at 0 its derivative is 0, whatever the data say."""
    x = np.linspace(0.0, 12.0, 80)
    y = 5.0 * voigt_profile(x - 6.0, 0.8, 0.7) + 3.0 + 0.1 * rng.standard_normal(x.size)
    formula, bounds = (
        "A*voigt(x - m, sigma, gamma) + c",
        {"sigma": (0.0, None), "gamma": (0.0, None)},
    )
    start = {"A": 6.0, "m": 5.9, "sigma": 0.01, "gamma": 1.2, "c": 2.8}
    from_near = fit_curve(formula, x, y, u_y=0.1, start=start, bounds=bounds, scan=False)
    inside = fit_curve(formula, x, y, u_y=0.1, start=start | {"sigma": 0.8}, bounds=bounds)
    assert from_near.chi2 == pytest.approx(inside.chi2, rel=1e-6)
    assert from_near.values["sigma"] > 0.3


def test_a_parameter_that_the_squares_do_not_see_shortens_no_step_of_the_others() -> None:
    # rounding errors of its slope lead it as far as its box, and along with it whatever they say
    # that goes with it
    gradient, silent = np.array([[1.0, -4e-11, 36.0]]), 7e-21
    along = 0.9 * np.sqrt(silent * 128.0)
    hessian = np.array([[[1.2, 0.0, -8.0], [0.0, silent, along], [-8.0, along, 128.0]]])
    box = np.array([[5.0, 300.0, 1.0]])
    free = np.ones((1, 3), dtype=bool)
    step, decrease = bounded_steps(gradient, hessian, np.array([1e-9]), free, -box, box)
    alone, best = bounded_steps(
        gradient[:, [0, 2]],
        hessian[:, [0, 2]][:, :, [0, 2]],
        np.array([1e-9]),
        free[:, [0, 2]],
        -box[:, [0, 2]],
        box[:, [0, 2]],
    )
    assert decrease[0] == pytest.approx(best[0], rel=1e-3)
    assert step[0, [0, 2]] == pytest.approx(alone[0], rel=1e-3)


@pytest.mark.parametrize("linear", [(), (0, 2)])
def test_the_objective_is_that_of_the_residuals_where_linear_parameters_are_solved_for(
    linear: tuple[int, ...],
) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0.2, 3.0, (12, 3))
    y = decays(points) + 0.1 * rng.standard_normal((12, X.size))
    sought = function(y, 0.0, linear)
    begun = points * rng.uniform(0.5, 2.0, points.shape)
    reached, halves = sought.evaluate(begun, np.arange(12))
    np.testing.assert_allclose(halves, sought.objectives(reached), rtol=1e-10)
    assert np.all(halves <= sought.objectives(begun))
    assert np.array_equal(reached[:, 1], begun[:, 1])
