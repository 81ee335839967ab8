"""Ways along the ridges of a density, and the proposal that is made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from targets import COV, banana, bimodal, half_normal, normal

from estim.campaign import load_campaign
from estim.fitting import fit_least_squares
from estim.levenberg_marquardt import End, run_descents
from estim.problem import folded
from estim.sampling.cholesky import lower_factor
from estim.sampling.log_density import Density, Support
from estim.sampling.ridges import Ridges, about_mode, ridge_proposal

OPEN = np.full(2, -np.inf), np.full(2, np.inf)
ROUNDING = 1e-8  # standard deviations, and of log densities

Case = tuple[Density, np.ndarray, np.ndarray, Sequence[np.ndarray], Support | None]


@dataclasses.dataclass
class RowByRow:
    """A density whose rounding errors do not depend on what else is asked in a call."""

    density: Density

    @property
    def names(self) -> tuple[str, ...]:
        return self.density.names

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return np.concatenate([self.density.log_density(draw[None]) for draw in draws])


def real(replica: Path) -> Case:
    problem = load_campaign(replica / "campaign.toml").problem(["heavy-04"])
    fit = fit_least_squares(problem)
    return (
        RowByRow(folded(fit.posterior, fit.symmetry, fit.values, fit.cov)),
        fit.values,
        fit.cov,
        (),
        problem.support(),
    )


CASES: dict[str, Callable[[Path], Case]] = {
    "normal": lambda _: (normal(COV), np.zeros(4), COV, (), None),
    "banana": lambda _: (banana(1.5), np.array([0.0, -1.5]), np.eye(2), (), None),
    "half-normal": lambda _: (
        half_normal(3),
        np.zeros(3),
        0.4 * np.eye(3),
        (),
        (np.zeros(3), np.full(3, np.inf)),
    ),
    "limits not stated": lambda _: (half_normal(3), np.full(3, 0.1), 0.4 * np.eye(3), (), None),
    "two modes": lambda _: (
        bimodal(3),
        np.full(3, 4.0),
        1.05 * np.eye(3),
        (np.full(3, -4.0),),
        None,
    ),
    "one parameter": lambda _: (normal(np.eye(1)), np.zeros(1), np.eye(1), (), None),
    "heavy-04": real,
}


def path_of(ridges: Ridges, mode: End, held: int) -> list[End]:
    """From end to end."""
    down, up = (
        run_descents(ridges, [ridges.path(mode, held, way)], max_steps=10)[0] for way in (-1.0, 1.0)
    )
    return [*down[::-1], mode, *up]


@pytest.mark.parametrize("name", CASES)
def test_ridges_followed_together_are_those_followed_one_by_one(name: str, replica: Path) -> None:
    density, start, cov, starts, support = CASES[name](replica)
    together = ridge_proposal(density, start, cov, starts=starts, support=support)
    ends = support or (np.full(start.size, -np.inf), np.full(start.size, np.inf))
    sds, first, weights = np.sqrt(np.diag(cov)), 0, []
    for at in (start, *starts):
        ridges, mode = about_mode(density, at, cov, ends)
        for i in range(start.size):
            path = path_of(ridges, mode, i)
            assert len(path) > 2
            weight, means, covs = ridges.components(path, i, path.index(mode))
            of_path = slice(first, first + len(path))
            np.testing.assert_allclose(
                together.means[of_path] / sds, means / sds, rtol=0.0, atol=10.0 * ROUNDING
            )
            np.testing.assert_allclose(
                together.factors[of_path] / sds[:, None],
                lower_factor(covs) / sds[:, None],
                rtol=0.0,
                atol=10.0 * ROUNDING,
            )
            first += len(path)
            weights += weight.tolist()
    assert first == together.weights.size
    np.testing.assert_allclose(together.weights, np.array(weights) / np.sum(weights), rtol=1e-6)


def test_a_way_along_a_normal_density_is_its_regression() -> None:
    """The others are where they are expected given the first, and the density falls by half the
    square of its standard deviations.
    """
    ridges, mode = about_mode(
        normal(COV), np.zeros(4), COV, (np.full(4, -np.inf), np.full(4, np.inf))
    )
    for axis in range(4):
        path = path_of(ridges, mode, axis)
        points = np.array([end.values for end in path])
        expected = points[:, axis, None] * COV[axis] / COV[axis, axis]
        np.testing.assert_allclose(points, expected, atol=1e-6)
        heights = [ridges.log_marginal(end, axis) - ridges.log_marginal(mode, axis) for end in path]
        np.testing.assert_allclose(
            heights, -0.5 * points[:, axis] ** 2 / COV[axis, axis], atol=1e-6
        )
        assert np.max(np.abs(points[:, axis])) > 4.0 * np.sqrt(COV[axis, axis])


def test_a_ridge_that_bends_is_followed() -> None:
    """Given x, y is most probable at bend (x^2 - 1), with standard deviation 1; a search ends where
    -2 log density would fall by less than 0.001.
    """
    ridges, mode = about_mode(banana(2.0), np.array([0.0, -2.0]), np.eye(2), OPEN)
    x, y = np.array([end.values for end in path_of(ridges, mode, 0)]).T
    np.testing.assert_allclose(y, 2.0 * (x**2 - 1.0), atol=np.sqrt(0.001))
    assert np.ptp(x) > 8.0
    closely = dataclasses.replace(ridges, tolerance=1e-10)
    x, y = np.array([end.values for end in path_of(closely, mode, 0)]).T
    np.testing.assert_allclose(y, 2.0 * (x**2 - 1.0), atol=1e-5)
    assert np.ptp(x) > 8.0


def test_what_is_pressed_against_a_limit_is_as_wide_as_the_density_falls() -> None:
    """exp(-3 x - y^2/2), x > 0: an exponential distribution of standard deviation 1/3."""
    falling = dataclasses.replace(
        normal(np.eye(2)),
        function=lambda x: np.where(x[:, 0] >= 0.0, -3.0 * x[:, 0] - 0.5 * x[:, 1] ** 2, -np.inf),
    )
    ridges, mode = about_mode(
        falling, np.zeros(2), 50.0 * np.eye(2), (np.array([0.0, -np.inf]), np.full(2, np.inf))
    )
    np.testing.assert_allclose(mode.values, 0.0, atol=1e-6)
    sds = np.sqrt(np.diag(np.linalg.inv(ridges.precision(mode))))
    assert sds == pytest.approx([1.0 / 3.0, 1.0], rel=0.01)


def test_ridges_are_weighted_alike_in_any_units() -> None:
    """Two parameters that do not know of each other, in other units: ridges of the same shape weigh
    the same.
    """
    together = ridge_proposal(normal(np.diag([1.0, 1e-6])), np.zeros(2), np.diag([1.0, 1e-6]))
    first = np.isclose(together.means[:, 1], 0.0, atol=1e-9) & (together.means[:, 0] != 0.0)
    second = np.isclose(together.means[:, 0], 0.0, atol=1e-6) & (together.means[:, 1] != 0.0)
    assert np.sum(first) == np.sum(second) > 3
    np.testing.assert_allclose(
        np.sum(together.weights[first]), np.sum(together.weights[second]), rtol=1e-6
    )


def test_more_ridges_need_hardly_more_calls_of_the_density() -> None:
    def n_call(n_par: int) -> int:
        sizes: list[int] = []
        plain = normal(np.eye(n_par))

        def log_density(x: np.ndarray) -> np.ndarray:
            sizes.append(len(x))
            return plain.log_density(x)

        ridge_proposal(
            dataclasses.replace(plain, function=log_density), np.zeros(n_par), np.eye(n_par)
        )
        return len(sizes)

    assert n_call(6) < 1.5 * n_call(2)


@dataclasses.dataclass
class Deep:
    """A normal density times next to nothing: x > x - 50 is false of its logarithms."""

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return normal(np.eye(2)).log_density(draws) - 4.7e30


def test_the_mode_of_a_density_next_to_nothing_is_not_left_out() -> None:
    assert np.any(ridge_proposal(Deep(), np.zeros(2), np.eye(2)).means != 0.0)
