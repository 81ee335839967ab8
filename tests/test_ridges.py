"""Ridges followed all at once are those that are followed one by one, each in its own frame and each sense for itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from targets import COV, banana, bimodal, half_normal, normal

from estim.campaign import load_campaign
from estim.fitting import fit_least_squares
from estim.problem import folded
from estim.sampling.exploration import along_ridges, ridge_proposal
from estim.sampling.factors import lower_factor
from estim.sampling.protocol import Density
from estim.sampling.ridge import Frame, Support, climb, framed, reordered, rescaled, separate_modes
from estim.sampling.ridge_paths import Rule, follow, walk

RULE = Rule(depth=10.0, fall=2.0, tolerance=1e-2, least=1e-2, quick=True)
ROUNDING = 1e-8  # standard deviations, and of log densities

Case = tuple[Density, np.ndarray, np.ndarray, Sequence[np.ndarray], Support | None]


def real(replica: Path) -> Case:
    problem = load_campaign(replica / "campaign.toml").problem(["heavy-04"])
    fit = fit_least_squares(problem, rng=np.random.default_rng(1))
    return folded(fit.posterior, fit.symmetry, fit.values), fit.values, fit.cov, (), problem.support()


CASES: dict[str, Callable[[Path], Case]] = {
    "normal": lambda _: (normal(COV), np.zeros(4), COV, (), None),
    "banana": lambda _: (banana(1.5), np.array([0.0, -1.5]), np.eye(2), (), None),
    "half-normal": lambda _: (half_normal(3), np.zeros(3), 0.4 * np.eye(3), (), (np.zeros(3), np.full(3, np.inf))),
    "limits not stated": lambda _: (half_normal(3), np.full(3, 0.1), 0.4 * np.eye(3), (), None),
    "two modes": lambda _: (bimodal(3), np.full(3, 4.0), 1.05 * np.eye(3), (np.full(3, -4.0),), None),
    "one parameter": lambda _: (normal(np.eye(1)), np.zeros(1), np.eye(1), (), None),
    "heavy-04": real,
}


def frame_alone(frame: Frame, mode: np.ndarray, axis: int) -> Frame:
    """A stack of one."""
    order = np.array([axis, *(i for i in range(frame.n_par) if i != axis)])
    factor = lower_factor((frame.factor @ frame.factor.T)[np.ix_(order, order)])
    own = frame.order[order]
    return rescaled(Frame(frame.density, own[None], mode[None, order], factor[None], frame.low[None, order], frame.high[None, order]))


def ridge_alone(one: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Points and log masses from end to end, one sense after the other."""
    top = climb(one, one.centre[None], 1, n_step=0)
    highest = float(top.log_masses[0])
    down, _ = walk(one, 0, top.points, top.log_masses, highest, -1.0, RULE)
    up, _ = walk(one, 0, top.points, top.log_masses, highest, 1.0, RULE)
    points = [*(panel.left for panel in reversed(down)), top.points, *(panel.right for panel in up)]
    masses = [*(panel.left_mass for panel in reversed(down)), top.log_masses, *(panel.right_mass for panel in up)]
    return np.vstack(points), np.concatenate(masses) - highest


@pytest.mark.parametrize("name", CASES)
def test_ridges_followed_together_are_those_followed_one_by_one(name: str, replica: Path) -> None:
    density, start, cov, starts, support = CASES[name](replica)
    sds = np.sqrt(np.diag(cov))
    frame = framed(density, start, cov, support)
    modes = separate_modes(frame, starts)
    assert len(modes) == (2 if name == "two modes" else 1)
    row, points, log_masses, _ = follow(reordered(frame, modes), RULE)
    together = ridge_proposal(density, start, cov, starts=starts, support=support)
    assert row.size == len(together.weights) > 3 * len(modes) * frame.n_par
    singles = [frame_alone(frame, mode, axis) for mode in modes for axis in range(frame.n_par)]
    for i, single in enumerate(singles):
        of_ridge, one = row == i, single.rows(0)
        way, masses = ridge_alone(one)
        np.testing.assert_allclose(points[of_ridge] / sds[one.order], way / sds[one.order], rtol=0.0, atol=ROUNDING)
        slope = np.sqrt(2.0 * np.maximum(-masses, 0.5))  # of a normal log density where it lies so deep, per standard deviation
        assert np.all(np.abs(log_masses[of_ridge] - masses) < ROUNDING * slope)
        alone = along_ridges(single)
        np.testing.assert_allclose(together.means[of_ridge] / sds, one.original(way) / sds, rtol=0.0, atol=ROUNDING)
        np.testing.assert_allclose(together.factors[of_ridge] / sds[:, None], alone.factors / sds[:, None], rtol=0.0, atol=10.0 * ROUNDING)
        shares = together.weights[of_ridge] / np.sum(together.weights[of_ridge])
        assert np.all(np.abs(shares / alone.weights - 1.0) < ROUNDING * (1.0 + slope))  # the root of a mass, times the way to its neighbours


def test_ridges_are_weighted_by_the_root_of_their_masses_and_their_steps() -> None:
    """Two parameters that do not know of each other, in other units: ridges of the same shape weigh the same."""
    together = ridge_proposal(normal(np.diag([1.0, 1e-6])), np.zeros(2), np.diag([1.0, 1e-6]))
    first = np.isclose(together.means[:, 1], 0.0, atol=1e-9) & (together.means[:, 0] != 0.0)
    second = np.isclose(together.means[:, 0], 0.0, atol=1e-6) & (together.means[:, 1] != 0.0)
    assert np.sum(first) == np.sum(second) > 3
    np.testing.assert_allclose(np.sum(together.weights[first]), np.sum(together.weights[second]), rtol=1e-6)


def test_more_ridges_need_hardly_more_calls_of_the_density() -> None:
    def n_call(n_par: int) -> int:
        sizes: list[int] = []
        plain = normal(np.eye(n_par))

        def log_density(x: np.ndarray) -> np.ndarray:
            sizes.append(len(x))
            return plain.log_density(x)

        ridge_proposal(dataclasses.replace(plain, function=log_density), np.zeros(n_par), np.eye(n_par))
        return len(sizes)

    assert n_call(6) < 1.5 * n_call(2)
