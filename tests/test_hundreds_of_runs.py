"""Joint fits of hundreds of runs: own paces, readings that count alike, levels of tests, and reports that stay readable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from joint_runs import Formula, one, problem_of

from estim.checks.conflict import _pulls_at_once
from estim.checks.goodness import check_goodness
from estim.fitting import arrow, rounds
from estim.fitting.edges import around
from estim.fitting.least_squares import fit_least_squares
from estim.fitting.rounds import settle_by_runs
from estim.pipeline import Analysis
from estim.problem.posterior import Problem
from estim.problem.priors import Normal
from estim.reports.correlations import correlation_of
from estim.reports.long_tables import MOST_ROWS, shortened
from estim.sampling import marginal_density
from estim.sampling.marginal import MarginalOptions, sample_marginal

X = np.linspace(0.1, 1.0, 8)
SLOPES = Formula(  # only tilt / scale shows: the readings of the tilts say the scale
    lambda x, a: a["tilt"] / a["scale"] * x + a["offset"],
    {"tilt": lambda x, a: x / a["scale"], "scale": lambda x, a: -a["tilt"] / a["scale"] ** 2 * x, "offset": one},
)
U_TILT = 0.2


def readings(n: int, rng: np.random.Generator, *, wrong: int | None = None) -> Problem:
    """Runs of scale 1 whose tilts, 0.5 to 1.5, were read with an error of `U_TILT`; the tilt of run `wrong` was read 2 off."""
    tilts = rng.uniform(0.5, 1.5, n)
    ys = [tilt * X + 0.01 * rng.standard_normal(X.size) for tilt in tilts]
    problem = problem_of(SLOPES, {"scale": Normal(1.0, 0.5)}, {"tilt": Normal(1.0, U_TILT), "offset": Normal(0.0, 0.1)}, X, ys, 0.01)
    read = {f"tilt[{i}]": tilt + U_TILT * rng.standard_normal() + (2.0 if i == wrong else 0.0) for i, tilt in enumerate(tilts)}
    parameters = (replace(p, prior=Normal(read[p.name], U_TILT)) if p.name in read else p for p in problem.parameters)
    return Problem(tuple(parameters), problem.runs)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.statistics) for seed in (2, 3))])
def test_what_hundreds_of_readings_say_together_is_within_its_standard_deviation(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With flat weights of all tilts the scale is too large by (0.2/1)^2, however many runs there are."""
    rng = np.random.default_rng(seed)
    fit = fit_least_squares(readings(256, rng), rng=rng, n_start=1)
    options = MarginalOptions(n_draw=1000, n_check=100)
    found = sample_marginal(fit, rng=rng, options=options)
    assert abs(found.mean[0] - 1.0) < 3.0 * found.sd[0]
    assert found.sd[0] == pytest.approx(fit.sds[0], rel=0.15)
    pulls = np.array([fit.values[i] - p.prior.centre for i, p in enumerate(fit.problem.parameters) if p.name.startswith("tilt")]) / U_TILT
    assert abs(np.mean(pulls**2) - 1.0) < 4.0 * np.sqrt(2.0 / 256)
    if seed == 1:
        monkeypatch.setattr(marginal_density, "MANY", 10**6)
        flat = sample_marginal(fit, rng=rng, options=options)
        assert flat.mean[0] - found.mean[0] > 2.0 * flat.sd[0]
        assert flat.mean[0] - found.mean[0] == pytest.approx(U_TILT**2, rel=0.3)


def test_one_prior_for_all_runs_says_how_true_values_are_distributed_and_is_integrated() -> None:
    rng = np.random.default_rng(1)
    assert not any(name.startswith("offset") for name in marginal_density.readings_of(readings(20, rng)))
    assert len(marginal_density.readings_of(readings(20, rng))) == 20
    assert not marginal_density.readings_of(readings(16, rng))


def test_all_pulls_from_one_solution_are_those_of_leaving_each_out_and_name_a_wrong_tilt() -> None:
    rng = np.random.default_rng(5)
    fit = fit_least_squares(readings(60, rng, wrong=7), rng=rng, n_start=1)
    model, n = around(fit), fit.values.size
    slopes = np.array([p.prior.residual_slope(v) for p, v in zip(fit.problem.parameters, fit.values, strict=True)])
    off = np.array([p.prior.residual(v) for p, v in zip(fit.problem.parameters, fit.values, strict=True)])
    pulls, together = _pulls_at_once(model, np.diag(slopes), off), model.least(np.diag(slopes), off)[1]
    for k in (0, 1, 15, n - 1):
        others = np.arange(n) != k
        assert pulls[k] ** 2 == pytest.approx(together - model.least(np.diag(slopes)[others], off[others])[1], rel=1e-6, abs=1e-8)
    assert fit.names[int(np.argmax(np.abs(pulls)))] == "tilt[7]"


def test_of_many_runs_one_that_is_wrong_fails_and_the_others_do_not() -> None:
    rng = np.random.default_rng(6)
    problem = readings(100, rng)
    bent = problem.runs[31]
    problem = Problem(problem.parameters, (*problem.runs[:31], replace(bent, y=bent.y + 1.0 * (X - 0.5) ** 2), *problem.runs[32:]))
    fit = fit_least_squares(problem, rng=rng, n_start=1)
    checked = check_goodness(fit, rng=rng)
    assert [run.run for run in checked if run.failed] == ["r31"]
    assert checked[0].level == pytest.approx(1e-3 * arrow.MANY / 100)
    mean = np.mean([run.checks["chi2"].p_value for run in checked])
    assert abs(mean - 0.5) < 4.0 / np.sqrt(12.0 * 100)


# --- rounds: each group has one parameter of its own, and a round leads it from v to leads(v)


@dataclass(frozen=True, eq=False)
class Place:
    """In place of a likelihood linearised at a value: where a round leads from there, and the density."""

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
        return [SimpleNamespace(runs=(SimpleNamespace(name=f"r{i}"),)) for i in range(self.n_par)]

    @property
    def parameters(self) -> list[Any]:
        return [SimpleNamespace(prior=SimpleNamespace(log_density=lambda v: np.zeros(v.shape)))] * self.n_par

    def named(self, _: np.ndarray) -> dict[str, np.ndarray]:
        return {}

    def linearised(self, values: np.ndarray) -> Map:
        return replace(self, likelihoods=tuple(Place(f(v), -abs(v - 0.4)) for f, v in zip(self.maps, values, strict=True)))


def settled(*maps: Callable[[float], float], start: float = 0.3) -> rounds.Settled:
    values = np.full(len(maps), start)
    best = lambda posterior, _: np.array([place.leads for place in posterior.likelihoods])  # noqa: E731
    ones = np.ones(len(maps))
    return settle_by_runs(values, Map(maps).linearised(values), most=60, tolerance=1e-4, best=best, spread=lambda *_: ones)  # type: ignore[arg-type]


def test_a_run_that_swings_goes_a_share_of_its_step_and_the_others_whole_ones() -> None:
    found = settled(lambda v: 1.0 - 1.2 * v, lambda v: 0.5 * v)
    assert found.moved < 1e-4
    assert not found.held
    assert found.values == pytest.approx([1.0 / 2.2, 0.0], abs=1e-3)


def test_a_run_that_finds_no_place_is_held_where_it_was_best_and_named() -> None:
    found = settled(lambda v: 1.0 if v < 0.5 else 0.0, lambda v: 0.5 * v)
    assert found.moved < 1e-4
    assert [one.runs for one in found.held] == [("r0",)]
    assert found.held[0].off > 0.1
    assert found.values[1] == pytest.approx(0.0, abs=1e-3)


def test_a_long_table_is_cut_and_the_whole_of_it_stands_beside() -> None:
    rows = [f"| r{i} | {i} \\| m |" for i in range(MOST_ROWS + 1)]
    text = "\n".join(["## All values", "", "| run | value |", "|---|---|", *rows, "", "after"])
    files = shortened(text)
    report = files["report.md"].decode()
    assert "| r0 | 0" in report
    assert f"r{MOST_ROWS} " not in report
    assert report.endswith("after")
    assert files["tables/all-values.csv"].decode().splitlines()[MOST_ROWS + 1] == f"r{MOST_ROWS},{MOST_ROWS} | m"
    assert shortened(text.replace(rows[-1] + "\n", ""))["report.md"].decode() == text.replace(rows[-1] + "\n", "")


def test_of_many_parameters_those_that_are_tied_most_keep_their_correlations(rng: np.random.Generator) -> None:
    """100 runs of two parameters each that share two more; run 90 alone ties its own two."""
    names = ["a", "b", *(f"{name}[{i}]" for i in range(100) for name in ("c", "d"))]
    draws = rng.standard_normal((400, len(names)))
    draws[:, names.index("d[90]")] += 3.0 * draws[:, names.index("c[90]")]
    shared = np.array([0, 1])
    used = tuple(np.append(shared, [2 + 2 * i, 3 + 2 * i]) for i in range(100))
    problem = SimpleNamespace(n_par=len(names), names=names, columns=used, foremost=lambda most: list(range(most)))
    found = correlation_of(cast(Analysis, SimpleNamespace(problem=problem, chain=SimpleNamespace(flat=draws))))
    assert 148 < len(found.names) <= 150
    assert {"a", "b", "c[90]", "d[90]"} <= set(found.names)
    i, j = found.names.index("c[90]"), found.names.index("d[90]")
    assert found.matrix[i][j] == max(abs(r) for k, row in enumerate(found.matrix) for r in row[:k])
    assert found.matrix[i][j] == pytest.approx(3.0 / np.sqrt(10.0), abs=0.02)
