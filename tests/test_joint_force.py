"""Runs that share an unmodelled force: one likelihood of all their points, who shares it, whether
the runs agree, and coverage.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_runs import LINE, problem_of
from scipy import stats
from scipy.linalg import block_diag
from scipy.optimize import approx_fprime
from test_deviation_study import moved
from wheels import FINE, FIRST, PHI, SIGMA, Wheel, places, white_fit

from estim.campaign import Campaign, load_campaign
from estim.checks import check_consistency, check_goodness
from estim.common import InputError
from estim.discrepancy.force import shared_force_shapes, track
from estim.discrepancy.grid import FORCE_SCALE, START_SD, prior_grid
from estim.discrepancy.joint_runs import Together, sharing_runs
from estim.discrepancy.linearised import linearise
from estim.discrepancy.mixture_likelihood import keep_probable
from estim.discrepancy.noise_with_discrepancy import formed_about
from estim.discrepancy.residuals import Residuals
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.discrepancy.trajectory import Trajectory
from estim.fitting import fit_problem
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.posterior import Problem
from estim.problem.priors import Normal
from estim.problem.roots import root_of

WHEEL = Path(__file__).resolve().parents[1] / "data" / "wheel"
X = np.linspace(0.0, 1.0, 6)
SD = 0.1


def tied(
    rng: np.random.Generator, *, sizes: tuple[float, ...] = (0.3,), apart: float = 0.0
) -> tuple[Problem, list[np.ndarray]]:
    """Three runs of a line, the first and the last with a common deviation of unknown size; also
    the covariances of these two together.
    """
    common = 0.3 * np.sin(5.0 * X)
    ys = [
        1.0 * X
        + (0.5 + i)
        + (common if i != 1 else 0.0)
        + (apart * X if i == 2 else 0.0)
        + SD * rng.standard_normal(X.size)
        for i in range(3)
    ]
    prior = Normal(0.0, 30.0)
    problem = problem_of(LINE, {"slope": prior, "bend": prior}, {"offset": prior}, X, ys, SD)
    factor = np.vstack([np.cos(np.outer(X, [1.0, 3.0, 5.0]))] * 2)
    grid = replace(
        prior_grid(0.3, scales=(1.0,), n_amplitude=max(2, len(sizes))),
        amplitudes=np.array(sizes),
        log_amplitudes=np.zeros(len(sizes)),
    )
    deviation = diagonalise(
        root_of(np.full(2 * X.size, SD**2)), (Shape("force", 1.0, factor, 0.0),), grid
    )
    linear = linearise(
        deviation, np.zeros(2 * X.size), np.ones((2 * X.size, 1)), precision=np.zeros((1, 1))
    )
    parts = [SD**2 * np.eye(2 * X.size) + size**2 * factor @ factor.T for size in sizes]
    likely = root_of(parts[-1])
    shared = Together(
        ("r0", "r2"), keep_probable(linear, neglected=0.0), likely, Residuals(np.zeros(2 * X.size))
    )
    return Problem(problem.parameters, problem.runs, (shared,)), parts


def line(values: np.ndarray, i: int) -> np.ndarray:
    slope, bend = values[:2]
    return slope * X + bend * X**2 + values[2 + i]


def test_the_posterior_of_tied_runs_is_that_of_their_stacked_points(
    rng: np.random.Generator,
) -> None:
    """Against SciPy's densities; run 1 stands between the two that are tied."""
    problem, parts = tied(rng, sizes=(0.1, 0.5))
    values = np.array([1.1, -0.2, 0.4, 1.6, 2.3])
    posterior = problem.linearised(values)
    assert [tuple(run.name for run in group.runs) for group in problem.groups] == [
        ("r0", "r2"),
        ("r1",),
    ]
    y = [run.y for run in problem.runs]
    off = np.concatenate([y[0] - line(values, 0), y[2] - line(values, 2)])
    expected = np.logaddexp.reduce(
        [stats.multivariate_normal(np.zeros(12), part).logpdf(off) for part in parts]
    )
    expected += np.sum(stats.norm(0.0, SD).logpdf(y[1] - line(values, 1)))
    found = posterior.log_likelihood(np.vstack([values, values + 0.1]))
    # the components' prior probabilities differ by a factor that draws share
    again = np.concatenate([y[0] - line(values + 0.1, 0), y[2] - line(values + 0.1, 2)])
    moved_by = np.logaddexp.reduce(
        [stats.multivariate_normal(np.zeros(12), part).logpdf(again) for part in parts]
    )
    moved_by += np.sum(stats.norm(0.0, SD).logpdf(y[1] - line(values + 0.1, 1)))
    assert found[1] - found[0] == pytest.approx(moved_by - expected, rel=1e-9)
    # as if the runs were independent
    apart = [stats.multivariate_normal(np.zeros(6), part[:6, :6]).logpdf(off[:6]) for part in parts]
    assert abs(np.logaddexp.reduce(apart) * 2 - expected) > 1.0
    jacobian, residuals = posterior.scoring(values)
    slopes = approx_fprime(values, lambda at: 0.5 * np.sum(posterior.residuals(at) ** 2), 1e-6)
    assert jacobian.T @ residuals == pytest.approx(slopes, abs=1e-3 * np.abs(slopes).max())
    assert [rows.shape for rows in posterior.pointwise(values[None])] == [(1, 6)] * 3
    assert posterior.standardised(values)[1] == pytest.approx((y[1] - line(values, 1)) / SD)
    with pytest.raises(InputError, match="cannot be separated"):
        problem.restricted(problem.runs[:1])
    assert problem.restricted((problem.runs[0], problem.runs[2])).shared == problem.shared


def test_tied_runs_are_compared_with_what_ties_them(rng: np.random.Generator) -> None:
    """chi^2 of the joint minimum less that with a line for each run, by generalised least squares;
    independent errors give another number.
    """
    problem, (covariance,) = tied(rng, apart=0.6)
    fit = fit_least_squares(problem)
    found = check_consistency(fit)
    y = np.concatenate([problem.runs[i].y for i in (0, 2, 1)])
    every = block_diag(covariance, SD**2 * np.eye(6))

    def least(columns: np.ndarray, sds: np.ndarray, cov: np.ndarray) -> float:
        root = np.linalg.cholesky(block_diag(cov, np.diag(sds**2)))
        rows = np.linalg.solve(root, np.vstack([columns, np.eye(sds.size)]))
        aim = np.linalg.solve(root, np.append(y, np.zeros(sds.size)))
        return float(np.sum((aim - rows @ np.linalg.lstsq(rows, aim, rcond=None)[0]) ** 2))

    shape, offsets = np.column_stack([X, X**2]), block_diag(*[np.ones((6, 1))] * 3)
    together = np.hstack([np.vstack([shape] * 3), offsets])
    separate = np.hstack([block_diag(shape, shape, shape), offsets])
    # apart, the priors of what is shared are one more source
    stated, loose = np.full(5, 30.0), np.r_[np.full(6, 1e4), np.full(3, 30.0)]

    def distance(cov: np.ndarray) -> float:
        return least(together, stated, cov) - least(separate, loose, cov)

    assert (found.chi2, found.dof) == (pytest.approx(distance(every), rel=0.01), 4)
    assert abs(distance(np.diag(np.diag(every))) - found.chi2) > 0.2 * found.chi2


def campaign(folder: Path, **edits: str):
    text = (
        (WHEEL / "campaign.toml")
        .read_text()
        .replace('file = "', f'file = "{WHEEL}/')
        .replace("[shared]\n", "[shared]\nunmodelled_force = 0.02\n")
    )
    for old, new in edits.values():
        assert old in text
        text = text.replace(old, new)
    (folder / "c.toml").write_text(text)
    return load_campaign(folder / "c.toml")


@pytest.fixture(scope="module")
def joint(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    held = campaign(
        tmp_path_factory.mktemp("joint"),
        tilt=('phi_deg = "-5.5(1)"', "phi_deg = -5.5"),
        kappa=('kappa = "0.746(7)"', "kappa = 0.746"),
    )
    return fit_problem(
        held.problem([f"class-unbalanced_{i}" for i in (1, 2, 3)]), rng=np.random.default_rng(1)
    )


def test_a_constant_force_answers_as_the_rolling_resistance_does(joint: Fit) -> None:
    problem, named = joint.problem, joint.problem.named(joint.values)
    run = problem.runs[0]
    t, theta = np.loadtxt(WHEEL / "class-unbalanced_1.csv", delimiter=",", skiprows=2)[:, :2].T
    assert run.rows is not None
    assert np.array_equal(run.rows.positions, theta)
    assert np.array_equal(run.rows.kept, np.searchsorted(t, run.t))
    course = Trajectory.of(run)

    formed, _ = formed_about(course, run.noise.base, run.points, named, scale=0.02)
    along = course.along(run.points, named, run.noise.base, about=formed.speed)
    by_curve = formed.gradient(run.points, named, ["rolling_resistance"])[:, 0]
    assert -along.response.force.sum(axis=1) * along.upright == pytest.approx(by_curve, rel=0.012)


def test_repeated_runs_share_a_force_agree_and_leave_white_residuals(joint: Fit) -> None:
    assert joint.success
    (force,) = joint.forces
    assert (force.run, len(force.runs), [own.run for own in force.own]) == (
        "body unbalanced",
        3,
        list(force.runs),
    )
    assert force.force.probability > 0.999
    # most of it repeats
    assert all(np.sqrt(np.mean(own.mean**2)) < 0.5 * force.force.typical for own in force.own)
    assert not any(good.failed for good in check_goodness(joint, rng=np.random.default_rng(1)))
    assert check_consistency(joint).agree
    run = joint.problem.runs[0]
    moment = run.derived(run.bind(joint.problem.named(joint.values)))["resisting_moment"].values[
        0, 0
    ]
    i = joint.names.index("rolling_resistance")
    sd = moment * np.sqrt(joint.cov[i, i]) / joint.values[i]
    assert moment == pytest.approx(1.044, abs=0.091)  # of a prototype that shares no code with this
    assert 0.02 < sd < 0.12
    white = joint.problem.for_search()
    assert white.shared == ()
    assert any(
        good.failed
        for good in check_goodness(
            fit_least_squares(white, start=joint.values), rng=np.random.default_rng(1)
        )
    )


def rolled(folder: Path, resistances: list[float], *, tilt: str, seed: int = 3) -> Campaign:
    """Runs of one wheel by an ODE solver: a force that all share and one of each, both of mean 0
    over the track; angles by the encoder.
    """
    rng, step, turns = (
        np.random.default_rng(seed),
        2.0 * np.pi / 500.0,
        2.0 * np.pi * np.arange(1, 6) / 15.0,
    )
    shared, runs = 0.006 * rng.standard_normal(5), []
    for i, c_rr in enumerate(resistances):
        waves = shared + 0.005 * rng.standard_normal(5)
        t = np.arange(0.0, 6.0, 0.1) + rng.uniform(0.0, 0.1)
        theta = Wheel(c_rr=c_rr).motion(t, lambda u, waves=waves: float(waves @ np.cos(turns * u)))
        rows = "".join(
            f"{a:.4f},{step * np.floor(b / step + 0.5):.6f}\n"
            for a, b in zip(t, theta, strict=True)
            if b < 15.0
        )
        (folder / f"r{i}.csv").write_text("t_s,theta_rad\n" + rows)
        runs.append(
            f'[[runs]]\nname = "r{i}"\nbody = "b"\nfile = "r{i}.csv"\ntheta0_deg = "5.5(20)"\n'
        )
    (folder / "c.toml").write_text(
        'title = "T"\nkind = "synthetic"\n[shared]\ng = 9.81\nradius_m = 0.235\nphi_deg = '
        f'"{tilt}"\n'
        'rolling_resistance = {prior = "half-normal", scale = 0.05}\nwindow = '
        "{theta_min_rad = 0.5}\n"
        f"[shared.noise]\nencoder_step_rad = {step!r}\nderivative = "
        f'"five-point"\n[bodies.b]\ngamma = 0.12\nkappa = {0.58 / 0.88!r}\n' + "".join(runs)
    )
    return load_campaign(folder / "c.toml")


def _resistance(fit: Fit) -> tuple[float, float]:
    i = fit.names.index("rolling_resistance")
    return float(fit.values[i]), float(np.sqrt(fit.cov[i, i]))


def _from_the_stated_values(campaign: Campaign, names: Sequence[str]) -> Fit:
    """Near which they are: nothing is sought from afar."""
    problem = campaign.problem(names)
    return fit_problem(problem, rng=np.random.default_rng(1), near=problem.start())


@pytest.mark.slow
def test_runs_whose_own_values_differ_do_not_agree_though_each_may_have_a_force_of_its_own(
    tmp_path: Path,
) -> None:
    """As a reader of single reports finds it: each run's own value and standard deviation, what all
    share held, about their weighted mean.
    """
    resistances = [0.030, 0.030, 0.030, 0.030, 0.020]
    held = rolled(tmp_path, resistances, tilt="-5.5")
    fits = [_from_the_stated_values(held, [name]) for name in held.run_names]
    values, sds = np.array([_resistance(fit) for fit in fits]).T
    weights = sds**-2.0
    distance = float(weights @ np.square(values - weights @ values / weights.sum()))
    assert stats.chi2.sf(distance, 4) < 0.003
    for tilt in ("-5.5", "-5.5(1)"):
        every = rolled(tmp_path, resistances, tilt=tilt)
        found = check_consistency(_from_the_stated_values(every, every.run_names))
        # a tilt that was stated, of which runs say next to nothing, adds none
        assert found.dof == 4
        assert found.chi2 == pytest.approx(distance, rel=0.2)
        assert found.suspects == ("r4",)
    assert check_consistency(_from_the_stated_values(every, every.run_names[:4])).agree
    # the line that is offered heals it
    (offered,) = re.findall(
        r"let c_rr vary from run to run: (between_runs = {rolling_resistance = [0-9.]+}), "
        r"under \[shared\]",
        found.verdict,
    )
    (tmp_path / "c.toml").write_text(
        (tmp_path / "c.toml").read_text().replace("[shared]\n", f"[shared]\n{offered}\n")
    )
    varying = load_campaign(tmp_path / "c.toml")
    assert check_consistency(_from_the_stated_values(varying, varying.run_names)).agree


@pytest.mark.slow
def test_the_resistance_of_a_run_is_the_average_over_what_was_fitted_within_its_own_part(
    tmp_path: Path,
) -> None:
    """The force of `rolled`, averaged by hand; without it the errors are no part of the own sds."""
    held, rng = rolled(tmp_path, [0.03] * 4, tilt="-5.5", seed=104), np.random.default_rng(104)
    turns, shared = 2.0 * np.pi * np.arange(1, 6) / 15.0, 0.006 * rng.standard_normal(5)
    off, with_force = [], []
    for name in held.run_names:
        waves = shared + 0.005 * rng.standard_normal(5)
        rng.uniform()
        fit = _from_the_stated_values(held, [name])
        x = fit.problem.runs[0].x
        along = np.linspace(x.min(), x.max(), 2000)
        value, sd = _resistance(fit)
        off.append((value - 0.03) / sd)
        with_force.append(off[-1] + np.mean(waves @ np.cos(turns[:, None] * along)) / sd)
    assert np.sqrt(np.mean(np.square(with_force))) < 1.5
    assert np.sqrt(np.mean(np.square(off))) > 2.0


def test_the_level_of_the_key_says_which_runs_share(tmp_path: Path) -> None:
    every = campaign(tmp_path)
    problem = every.problem(every.run_names)
    shared = sharing_runs(problem.runs)
    assert {label: len(runs) for label, runs in shared.items()} == {
        "body balanced": 4,
        "body unbalanced": 3,
    }
    file = f'file = "{WHEEL}/class-balanced_2.csv"'
    own = campaign(tmp_path, own=(file, f"{file}\nunmodelled_force = 0.01"))
    problem = own.problem(own.run_names)
    shared = sharing_runs(problem.runs)
    assert {label: len(runs) for label, runs in shared.items()} == {
        "body balanced": 3,
        "class-balanced_2": 1,
        "body unbalanced": 3,
    }


def test_so_many_points_that_it_takes_too_long_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estim.campaign.unmodelled_force.MOST_POINTS", 100)
    every = campaign(tmp_path)
    with pytest.raises(
        InputError,
        match=r"c\.toml:9: 'unmodelled_force' does not go with runs that share it and have 146 "
        r"points, more than 100",
    ):
        every.problem(every.run_names)
    assert every.problem(["class-balanced_1"]).runs[0].force == 0.02


def profile(rng: np.random.Generator, size: float) -> np.ndarray:
    """A smooth force along the fine track and its work from the release."""
    smooth = np.exp(-0.5 * np.square((FINE[:, None] - FINE) / 3.0))[:, ::7]
    force = (
        size
        * smooth
        @ rng.standard_normal(smooth.shape[1])
        / np.sqrt(np.sum(np.square(smooth), axis=1))
    )
    return np.r_[0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(FINE))] + FIRST * force[0]


def one_set(
    rng: np.random.Generator, size: float, own_size: float, own: tuple[float, ...], n_run: int = 4
) -> float:
    """Four runs with a common profile and one of each: where the posterior of the average
    resistance has the true one.
    """
    wheel = Wheel(theta0=np.radians(5.5))
    common = profile(rng, size)
    fits, runs = [], []
    for _ in range(n_run):
        t = np.arange(0.0, 6.0, 0.1) + rng.uniform(0.0, 0.1)
        y = places(wheel, 0.0, 0.6, t, common + profile(rng, own_size))
        used = (y > 0.5) & (y < 15.0)
        t, y = t[used], y[used] + SIGMA * rng.standard_normal(np.sum(used))
        fits.append(white_fit(t, y, wheel, np.array([0.05, 0.0, 0.0, START_SD, 1e3])))
        runs.append(y)
    along = track(max(float(y[-1]) for y in runs))
    truth = wheel.c_rr - np.interp(along.end, FINE, common) / along.end / np.cos(PHI)
    c_rr = fits[0].wheel.c_rr
    residuals = np.concatenate(
        [fit.residuals + fit.jacobian[:, 0] * (fit.wheel.c_rr - c_rr) for fit in fits]
    )
    jacobian = np.hstack(
        [
            np.concatenate([fit.jacobian[:, 0] for fit in fits])[:, None],
            block_diag(*(fit.jacobian[:, 1:] for fit in fits)),
        ]
    )
    precision = block_diag(fits[0].precision[:1, :1], *(fit.precision[1:, 1:] for fit in fits))
    pull = np.r_[wheel.c_rr - c_rr, np.concatenate([fit.pull[1:] for fit in fits])]
    grid = prior_grid(FORCE_SCALE, scales=(0.8, 1.0, 1.25), n_amplitude=10)
    shapes = shared_force_shapes(along, tuple(moved(along, fit) for fit in fits), own=own)
    found = linearise(
        diagonalise(root_of(np.full(residuals.size, SIGMA**2)), shapes, grid),
        residuals,
        jacobian,
        precision=precision,
        pull=pull,
    )
    return found.probability_below(np.eye(precision.shape[0])[0], truth - c_rr)


@pytest.mark.statistics
def test_the_average_resistance_of_repeated_runs_is_covered_and_a_shared_force_alone_is_too_narrow(
    rng: np.random.Generator,
) -> None:
    n_set = 30
    below = np.array([one_set(rng, 0.0028, 0.0028, (0.0, 0.1, 0.3, 1.0)) for _ in range(n_set)])
    alone = np.array([one_set(rng, 0.0028, 0.0028, (0.0,)) for _ in range(n_set)])
    held, narrow = (np.mean(np.abs(part - 0.5) < 0.34) for part in (below, alone))
    assert held > 0.68 - 2.5 * np.sqrt(0.68 * 0.32 / n_set)
    assert np.mean(np.abs(below - 0.5) < 0.475) > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / n_set)
    assert narrow < 0.68 - 2.0 * np.sqrt(0.68 * 0.32 / n_set)
