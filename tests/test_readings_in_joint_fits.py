"""Readings of single runs in joint fits: one measure for any number of runs, against a posterior on
a grid that is written out here.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_runs import READ_AT as X
from joint_runs import U_OFFSET, U_TILT, U_Y, readings

from estim import DataSet, fit_curves, load_campaign
from estim.calibration.experiment import PointDesign
from estim.calibration.trial import ESS, TrialPlan, _experiment, posterior_draws
from estim.checks.diagnosis import _equally_weighted_runs
from estim.fitting import fit_problem
from estim.fitting.incidental_parameters import measure_of
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale
from estim.problem.observations import Parameter
from estim.problem.posterior import Problem
from estim.problem.priors import HalfNormal, Normal
from estim.sampling.marginal import sample_marginal

SCALES = np.linspace(0.5, 1.8, 521)
REPLICA = Path(__file__).parents[1] / "data" / "replica" / "campaign.toml"


# --- the posterior of the scale on a grid: y = tilt/scale x + offset + error in every run, tilt
# read with `U_TILT`, scale 1.0(5) beforehand


def slopes_of(ys: np.ndarray) -> tuple[np.ndarray, float]:
    """(n_run,) weighted least squares of the slopes of ys (n_run, n_obs), the offsets integrated
    out, and their standard deviation.
    """
    weights = np.linalg.solve(U_Y**2 * np.eye(X.size) + U_OFFSET**2, X)
    return ys @ weights / (X @ weights), float(1.0 / np.sqrt(X @ weights))


def on_a_grid(
    slopes: np.ndarray, u_slope: float, read: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n_scale,) of the scales: where each run counts by the mass of its tilts over the
    width of their distribution, and where it counts by the mass.
    """
    log_p = -0.5 * ((SCALES - 1.0) / 0.5) ** 2
    log_width = np.zeros(SCALES.size)
    z = np.linspace(-6.0, 6.0, 41)  # 0.3 apart: sums over a normal density are exact to 1e-9
    for slope, reading in zip(slopes, read, strict=True):
        tilts = SCALES[:, None] * (slope + u_slope * z)
        mass = np.exp(-0.5 * z**2 - 0.5 * ((tilts - reading) / U_TILT) ** 2) * SCALES[:, None]
        total = np.sum(mass, axis=1)
        mean = np.sum(mass * tilts, axis=1) / total
        width = np.sqrt(np.sum(mass * (tilts - mean[:, None]) ** 2, axis=1) / total)
        log_p += np.log(total)
        log_width += np.log(width)
    alike, flat = (np.exp(one - np.max(one)) for one in (log_p - log_width, log_p))
    return alike / np.sum(alike), flat / np.sum(flat)


def mean_and_sd(weights: np.ndarray) -> tuple[float, float]:
    mean = float(weights @ SCALES)
    return mean, float(np.sqrt(weights @ (SCALES - mean) ** 2))


def grids(problem: Problem) -> tuple[tuple[float, float], tuple[float, float]]:
    """Mean and standard deviation of the scale with readings that count alike, and with flat
    weights of all tilts.
    """
    slopes, u_slope = slopes_of(np.array([run.y for run in problem.runs]))
    read = np.array([p.prior.centre for p in problem.parameters if p.name.startswith("tilt")])
    alike, flat = map(mean_and_sd, on_a_grid(slopes, u_slope, read))
    return alike, flat


def fitted(problem: Problem) -> Fit:
    return fit_least_squares(problem)


@pytest.mark.parametrize("n", [2, 4, 16, 17, 30])
def test_the_marginal_over_any_number_of_runs_is_the_posterior_on_a_grid(n: int) -> None:
    problem = readings(n, np.random.default_rng(n))
    (mean, sd), (flat, _) = grids(problem)
    found = sample_marginal(fitted(problem), rng=np.random.default_rng(2), n_draw=4000, n_check=200)
    error = 4.0 / np.sqrt(found.ess) + 0.03  # the measure is taken to first order
    assert found.trusted
    assert abs(found.mean[0] - mean) < error * sd
    assert found.sd[0] == pytest.approx(sd, rel=0.1)
    assert flat - mean > 0.7 * U_TILT * np.sqrt(n) * sd > error * sd


def test_a_chain_in_all_dimensions_has_the_same_measure() -> None:
    problem = readings(4, np.random.default_rng(4))
    (mean, sd), (flat, _) = grids(problem)
    fit = fitted(problem)
    draws, _, shortfall = posterior_draws(fit, 2000.0, np.random.default_rng(1))
    assert not shortfall
    assert abs(draws[:, 0].mean() - mean) < (4.0 / np.sqrt(2000.0) + 0.03) * sd
    assert flat - mean > 0.25 * sd
    # samples the plain posterior
    without, _, _ = posterior_draws(replace(fit, singular=True), 2000.0, np.random.default_rng(1))
    assert abs(without[:, 0].mean() - flat) < (4.0 / np.sqrt(2000.0) + 0.03) * sd


@pytest.mark.statistics
@pytest.mark.parametrize(("read_about_truth", "right"), [(True, True), (False, False)])
def test_readings_about_true_values_are_counted_rightly_and_values_that_were_set_are_not(
    read_about_truth: bool, right: bool
) -> None:
    """400 campaigns of 16 runs: where true values scatter about what was stated, flat weights are
    right, and this measure is as much too low.
    """
    rng, n, pulls, held = np.random.default_rng(3), 16, [], []
    for _ in range(400):
        stated = rng.uniform(0.5, 1.5, n)
        off = U_TILT * rng.standard_normal(n)
        true, read = (stated, stated + off) if read_about_truth else (stated + off, stated)
        slopes = true + 0.01 * rng.standard_normal(n)
        alike, flat = on_a_grid(slopes, 0.01, read)
        weights = (alike, flat) if right else (flat, alike)
        pulls.append([(mean - 1.0) / sd for mean, sd in map(mean_and_sd, weights)])
        below = [float(np.sum(one[SCALES < 1.0])) for one in weights]
        held.append([[abs(p - 0.5) < half for half in (0.34, 0.475)] for p in below])
    error = 1.0 / np.sqrt(400)
    mean, share = np.mean(pulls, axis=0), np.mean(held, axis=0)
    assert abs(mean[0]) < 4.0 * error
    assert abs(mean[1]) > 0.5
    assert np.all(
        np.abs(share[0] - [0.68, 0.95]) < 4.0 * np.sqrt(np.array([0.68 * 0.32, 0.95 * 0.05]) / 400)
    )
    assert share[1, 0] < 0.68 - 0.05


@pytest.mark.slow
def test_a_size_of_errors_that_runs_share_is_integrated_and_not_pulled() -> None:
    """40 runs of four points: with the measure of all that is own, the inferred standard deviation
    is too small by three of its own.
    """
    rng, n, pulls = np.random.default_rng(8), 40, []
    for _ in range(4):
        problem = readings(n, rng)
        few = np.array([0, 2, 5, 7])
        noise = Independent(Scale(parameter="sigma"), Scale(0.0), np.ones(few.size))
        runs = tuple(replace(run, x=run.x[few], y=run.y[few], noise=noise) for run in problem.runs)
        fit = fitted(
            Problem((*problem.parameters, Parameter("sigma", "1", HalfNormal(0.1), "sigma")), runs)
        )
        assert fit.sampled.measure is not None
        assert [fit.names[i] for i in fit.sampled.measure.columns] == ["scale"]
        found = sample_marginal(fit, rng=rng, n_draw=1000, n_check=100)
        k = fit.names.index("sigma")
        pulls.append((found.mean[k] - U_Y) / found.sd[k])
    assert abs(np.mean(pulls)) < 4.0 / np.sqrt(len(pulls))


def test_one_prior_for_all_runs_says_how_true_values_are_distributed_and_is_integrated() -> None:
    problem = readings(3, np.random.default_rng(1))
    assert problem.readings == {"tilt[0]", "tilt[1]", "tilt[2]"}
    alike = tuple(
        replace(p, prior=Normal(1.0, U_TILT)) if p.name.startswith("tilt") else p
        for p in problem.parameters
    )
    same = Problem(alike, problem.runs)
    assert not same.readings
    assert fitted(same).sampled.measure is None
    assert fitted(problem.restricted(problem.runs[:1])).sampled.measure is None


@pytest.mark.slow
def test_a_force_changes_nothing_about_how_readings_count() -> None:
    """Runs that share an unmodelled force are one group; the measure is that of the runs
    without.
    """
    campaign = load_campaign(REPLICA)
    problem = campaign.problem(["heavy-02", "heavy-04"])
    plain = replace(problem, runs=tuple(replace(run, force=0.0) for run in problem.runs))
    fits = [fit_problem(one, rng=np.random.default_rng(1)) for one in (problem, plain)]
    assert [len(fit.problem.groups) for fit in fits] == [1, 2]
    pulls = []
    for fit in fits:
        measure = fit.sampled.measure
        assert measure is not None
        cov = fit.cov[np.ix_(measure.columns, measure.columns)]
        pulls.append(cov @ measure.slope / np.sqrt(np.diag(cov)))
        draws = fit.values + 0.3 * np.sqrt(np.diag(fit.cov)) * np.array([[1.0], [-1.0]])
        added = fit.sampled.log_density(draws) - fit.posterior.log_density(draws)
        assert added == pytest.approx((draws - fit.values)[:, measure.columns] @ measure.slope)
    assert pulls[0] == pytest.approx(pulls[1], abs=0.03)
    assert pulls[0][0] < -0.05


def test_it_is_told_where_flat_weights_would_show() -> None:
    few, many = (
        _equally_weighted_runs(fitted(readings(n, np.random.default_rng(1)))) for n in (1, 16)
    )
    assert few == []
    assert many[0].numbers == {"runs": 16}
    assert many[0].size == pytest.approx(U_TILT * 4.0, rel=0.3)


def test_ranks_of_joint_fits_are_those_of_truths_that_are_read_anew() -> None:
    problem = readings(3, np.random.default_rng(1))
    values, posed, _ = _experiment(
        TrialPlan(PointDesign(problem), "sbc", problem.start(), problem.names, ESS, 1),
        np.random.default_rng(5),
    )
    for value, before, after in zip(values, problem.parameters, posed.parameters, strict=True):
        if before.name in problem.readings:
            assert after.prior.centre != before.prior.centre
            assert abs(after.prior.centre - value) < 4.0 * U_TILT
        else:
            assert after.prior == before.prior


@pytest.mark.slow
def test_an_own_amplitude_of_counts_leaves_the_shared_lifetime_where_it_is(
    rng: np.random.Generator,
) -> None:
    """Under flat weights of N the density of tau is that of the conditional likelihood divided by
    the sum of the curve, once for each run: 16 runs of 16 events pull tau by a standard deviation.
    """
    x, n_run = np.arange(0.25, 10.0, 0.5), 16
    runs = {
        f"r{k}": DataSet(x, rng.poisson(4.0 * np.exp(-x / 2.0)).astype(float), noise="poisson")
        for k in range(n_run)
    }
    fit = fit_curves("N*exp(-x/tau)", runs, shared=["tau"]).fit
    tau = float(fit.values[list(fit.names).index("tau")])
    measure = fit.measure
    assert measure is not None
    step = 1e-4
    low, high = (np.log(np.sum(np.exp(-x / t))) for t in (tau - step, tau + step))
    assert measure.slope == pytest.approx([n_run * (high - low) / (2.0 * step)], rel=0.03)
    assert measure.influence > 0.5
    # of readings with errors Jeffreys' prior says that, and of one run the usual limits hold
    assert (
        fit_curves("N*exp(-x/tau)", dict([*runs.items()][:1]), shared=["tau"]).fit.measure is None
    )


def test_a_step_that_meets_a_limit_stays_on_the_ridge() -> None:
    """Near no rolling resistance: the slope over one standard deviation is that beside the point.
    With the resistance alone cut off at 0 it was twice as large, the tilts on their way already.
    """
    problem = load_campaign(REPLICA).problem(["heavy-02", "heavy-04", "heavy-06", "heavy-08"])
    fit = fitted(problem)
    i = fit.names.index("rolling_resistance")
    sd = np.sqrt(fit.cov[i, i])
    values = fit.values + fit.cov[i] / sd * (0.2 - fit.values[i] / sd)
    far, near = (
        measure_of(fit.posterior, values, scale * fit.cov, jeffreys=None) for scale in (1.0, 1e-4)
    )
    assert far is not None
    assert near is not None
    sds = np.sqrt(np.diag(fit.cov))[far.columns]
    np.testing.assert_allclose(far.slope * sds, near.slope * sds, atol=0.03)


def test_own_parameters_on_limits_stay_there_while_what_is_shared_moves() -> None:
    """Backgrounds of counts at 0, some of which rise with a step and some with its opposite: both
    ended at once, and the slope was 0.
    """
    rng, sets = np.random.default_rng(3), {}
    for i in range(10):
        x = np.linspace(0.2, 2.5 + 2.0 * (i % 4), 14)
        sets[f"r{i}"] = DataSet(x, rng.poisson(60.0 * x**0.7 * np.exp(-x / 1.5)), noise="poisson")
    fit = fit_curves(
        "N*x**p*exp(-x/tau) + b",
        sets,
        shared=("p", "tau"),
        bounds={"b": (0.0, None), "N": (0.0, None), "tau": (0.0, None)},
        start={"N": 60.0, "p": 0.7, "tau": 1.5, "b": 0.5},
        scan=False,
    ).fit
    assert sum(name.startswith("b") for name in fit.at_bound) == 3
    measure = measure_of(fit.posterior, fit.values, fit.cov)
    near = measure_of(fit.posterior, fit.values, 1e-4 * fit.cov)
    assert measure is not None
    assert near is not None
    sds = np.sqrt(np.diag(fit.cov))[measure.columns]
    np.testing.assert_allclose(measure.slope * sds, near.slope * sds, atol=0.1)
    assert np.all(np.abs(near.slope * sds) > 0.1)
