"""Joint fits of hundreds of runs: covariances that are held, levels of tests, and reports that
stay readable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from joint_runs import READ_AT as X
from joint_runs import readings

from estim import DataSet, fit_curves
from estim.checks.conflict import _pulls_at_once
from estim.checks.goodness_of_fit import check_goodness
from estim.fitting import arrowhead
from estim.fitting.held_covariances import Held, settle_by_runs
from estim.fitting.least_squares import fit_least_squares
from estim.fitting.prior_limits import around
from estim.problem.posterior import Problem
from estim.reports.pages import MOST_ROWS, shortened


def test_all_pulls_from_one_solution_are_those_of_leaving_each_out_and_name_a_wrong_tilt() -> None:
    rng = np.random.default_rng(5)
    fit = fit_least_squares(readings(60, rng, wrong=7))
    model, n = around(fit), fit.values.size
    slopes = np.array(
        [p.prior.residual_slope(v) for p, v in zip(fit.problem.parameters, fit.values, strict=True)]
    )
    off = np.array(
        [p.prior.residual(v) for p, v in zip(fit.problem.parameters, fit.values, strict=True)]
    )
    pulls, together = (
        _pulls_at_once(model, np.diag(slopes), off, np.eye(off.size)),
        model.least(np.diag(slopes), off)[1],
    )
    for k in (0, 1, 15, n - 1):
        others = np.arange(n) != k
        assert pulls[k] ** 2 == pytest.approx(
            together - model.least(np.diag(slopes)[others], off[others])[1], rel=1e-6, abs=1e-8
        )
    assert fit.names[int(np.argmax(np.abs(pulls)))] == "tilt[7]"


@pytest.mark.slow
def test_of_many_runs_one_that_is_wrong_fails_and_the_others_do_not() -> None:
    rng = np.random.default_rng(6)
    problem = readings(100, rng)
    bent = problem.runs[31]
    problem = Problem(
        problem.parameters,
        (*problem.runs[:31], replace(bent, y=bent.y + 1.0 * (X - 0.5) ** 2), *problem.runs[32:]),
    )
    fit = fit_least_squares(problem)
    checked = check_goodness(fit, rng=rng)
    assert [run.run for run in checked if run.failed] == ["r31"]
    assert checked[0].level == pytest.approx(1e-3 * arrowhead.MANY_RUNS / 100)
    mean = np.mean([run.checks["chi2"].p_value for run in checked])
    assert abs(mean - 0.5) < 4.0 / np.sqrt(12.0 * 100)


# --- rounds: each group has one parameter of its own, and a round leads it from v to leads(v)


@dataclass(frozen=True, eq=False)
class Place:
    """In place of a likelihood linearised at a value: where a round leads from there, and the
    density.
    """

    leads: float
    height: float

    def log_likelihood(self, _: object) -> np.ndarray:
        return np.array([self.height])


@dataclass(frozen=True, eq=False)
class Map:
    """In place of a posterior, and of its problem."""

    maps: tuple[Callable[[float], float], ...]
    likelihoods: tuple[Place, ...] = ()

    @property
    def problem(self) -> Any:
        return self

    @property
    def n_par(self) -> int:
        return len(self.maps)

    @property
    def columns(self) -> list[np.ndarray]:
        return [np.array([i]) for i in range(self.n_par)]

    @property
    def groups(self) -> list[Any]:
        return [SimpleNamespace(run_names=(f"r{i}",)) for i in range(self.n_par)]

    @property
    def parameters(self) -> list[Any]:
        return [
            SimpleNamespace(prior=SimpleNamespace(log_density=lambda v: np.zeros(v.shape)))
        ] * self.n_par

    def named(self, _: np.ndarray) -> dict[str, np.ndarray]:
        return {}

    def linearised(self, values: np.ndarray) -> Map:
        return replace(
            self,
            likelihoods=tuple(
                Place(f(v), -abs(v - 0.4)) for f, v in zip(self.maps, values, strict=True)
            ),
        )


def settled(
    *maps: Callable[[float], float], start: float = 0.3
) -> tuple[np.ndarray, float, tuple[Held, ...]]:
    values = np.full(len(maps), start)
    best = lambda posterior, _: np.array([place.leads for place in posterior.likelihoods])  # noqa: E731
    ones = np.ones(len(maps))
    begun = Map(maps).linearised(values)
    values, _, moved, held = settle_by_runs(values, begun, best=best, spread=lambda *_: ones)  # type: ignore[arg-type]
    return values, moved, held


def test_a_run_that_comes_to_rest_slowly_is_not_held() -> None:
    values, moved, held = settled(lambda v: 0.8 - 0.6 * v, lambda v: 0.5 * v)
    assert moved < 1e-4
    assert not held
    assert values == pytest.approx([0.5, 0.0], abs=1e-3)


def test_a_run_that_finds_no_place_is_held_where_it_was_best_and_named() -> None:
    values, moved, held = settled(lambda v: 1.0 if v < 0.5 else 0.0, lambda v: 0.5 * v)
    assert moved < 1e-4
    assert [one.runs for one in held] == [("r0",)]
    assert held[0].off > 0.1
    assert values[1] == pytest.approx(0.0, abs=1e-3)


def test_a_long_table_is_cut_and_the_whole_of_it_stands_beside() -> None:
    rows = [f"| r{i} | {i} \\| m |" for i in range(MOST_ROWS + 1)]
    text = "\n".join(["## All values", "", "| run | value |", "|---|---|", *rows, "", "after"])
    files = shortened(text)
    report = files["report.md"].decode()
    assert "| r0 | 0" in report
    assert f"r{MOST_ROWS} " not in report
    assert report.endswith("after")
    assert (
        files["tables/all-values.csv"].decode().splitlines()[MOST_ROWS + 1]
        == f"r{MOST_ROWS},{MOST_ROWS} | m"
    )
    assert shortened(text.replace(rows[-1] + "\n", ""))["report.md"].decode() == text.replace(
        rows[-1] + "\n", ""
    )


@pytest.mark.slow
def test_readings_without_scatter_fail_among_hundreds_of_data_sets() -> None:
    x, rng = np.arange(4.0), np.random.default_rng(2)
    data = {f"s{i}": DataSet(x, 2.0 * x + 0.1 * rng.standard_normal(4), 0.1) for i in range(340)}
    data["s7"] = DataSet(x, 2.0 * x, 1e12)  # its errors are stated far too large
    fit = fit_curves("a*x", data)
    (zero,) = (run for run in fit.goodness if "zero" in run.checks)
    assert zero.run == "s7"
    assert zero.failed == ("zero",)
    assert fit.status == "poor-fit"
