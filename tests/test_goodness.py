"""Tests of fit quality: right models pass at the stated rate, wrong ones fail."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from estim import fit_curve, fit_line
from estim.campaign import load_campaign
from estim.checks import goodness_of_fit
from estim.checks.goodness_of_fit import P_POOR_FIT, check_goodness, check_linear
from estim.fitting.least_squares import fit_least_squares
from estim.line.findings import line_goodness
from estim.pipeline import analyse
from estim.problem.priors import HalfNormal
from estim.problem.roots import covariance_of
from estim.sampling.chain import Target

WHEEL = """
title = "a wheel like the real one, simulated"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.235
phi_deg = -5.5
[bodies.wheel]
gamma = GAMMA
kappa = 0.75
[[runs]]
name = "r"
body = "wheel"
file = "r.csv"
theta0_rad = {prior = "normal", mean = 0.1, sd = 0.3}
rolling_resistance = {prior = "half-normal", scale = 0.05}
[runs.noise]
encoder_step_rad = 0.0125663706
derivative = "five-point"
scatter = {prior = "half-normal", scale = 0.5}
[runs.window]
theta_min_rad = 0.5
"""


def wheel(folder: Path, *, gamma: str, rng: np.random.Generator) -> Path:
    """An encoder record of an eccentric wheel rolling down, true gamma 0.163, and a campaign that
    claims `gamma`.
    """
    from estim.model import Body, trajectory

    body = Body(radius=0.235, gamma=0.163, kappa=0.75)
    t = np.arange(0.03, 3.5, 0.1)
    x, _ = trajectory(t, body, phi=np.radians(-5.5), theta0=0.15, rolling_resistance=0.03, g=9.81)
    step = 2.0 * np.pi / 500
    counts = np.floor(x[0] / 0.235 / step + rng.uniform())
    (folder / "r.csv").write_text(
        "t_s,theta_rad\n"
        + "\n".join(f"{a:.1f},{b * step}" for a, b in zip(t - t[0], counts, strict=True))
    )
    (folder / "c.toml").write_text(WHEEL.replace("GAMMA", gamma))
    return folder / "c.toml"


def test_right_model_with_inferred_scatter_passes(tmp_path: Path, rng: np.random.Generator) -> None:
    fit = fit_least_squares(load_campaign(wheel(tmp_path, gamma="0.163", rng=rng)).problem(["r"]))
    (good,) = check_goodness(fit, rng=rng)
    assert good.failed == ()
    assert good.scatter_ratio < 2.0


@pytest.mark.slow
def test_wrong_model_fails_although_its_scatter_is_inferred(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    fit = fit_least_squares(load_campaign(wheel(tmp_path, gamma="0.0", rng=rng)).problem(["r"]))
    (good,) = check_goodness(fit, rng=rng)
    assert "chi2" not in good.checks  # the inferred scatter has swallowed it
    assert "autocorrelation" in good.failed
    assert good.scatter_ratio > 10.0
    diagnosis = analyse(
        load_campaign(tmp_path / "c.toml"), ["r"], seed=1, target=Target(ess=400)
    ).diagnosis
    assert diagnosis.status == "poor-fit"
    assert any("scatter" in reason for reason in diagnosis.reasons)


@pytest.mark.statistics
def test_p_values_are_uniform_under_the_right_model(
    rng: np.random.Generator, replica: Path
) -> None:
    """Refit data simulated from the fit itself: each test rejects 5 % of right models at the 5 %
    level.
    """
    from dataclasses import replace

    problem = load_campaign(replica / "campaign.toml").problem(["heavy-06"])
    fit = fit_least_squares(problem)
    run, named = problem.runs[0], problem.named(fit.values)
    curve = run.curve.value(run.x, run.bind(named)) + run.y - fit.posterior.likelihoods[0].y
    factor = np.linalg.cholesky(covariance_of(fit.posterior.likelihoods[0].normal.root(named)))
    n, below = 300, {}
    for _ in range(n):
        y = curve.ravel() + factor @ rng.standard_normal(run.n_obs)
        again = fit_least_squares(replace(problem, runs=(replace(run, y=y),)), start=fit.values)
        (good,) = check_goodness(again, rng=rng)
        for name, check in good.checks.items():
            below[name] = below.get(name, 0) + (check.p_value < 0.05)
    for name, count in below.items():
        # priors are not redrawn here, which makes chi2 a little small: only an excess is an error
        # of the test
        assert count / n < 0.05 + 3.5 * np.sqrt(0.05 * 0.95 / n), name
        if name not in ("chi2", "runs"):  # runs is discrete, its level lies below 5 %
            assert count / n > 0.05 - 3.5 * np.sqrt(0.05 * 0.95 / n), name


def test_understated_noise_is_a_poor_fit(
    replica: Path, tmp_path: Path, rng: np.random.Generator
) -> None:
    text = (replica / "campaign.toml").read_text()
    assert "sigma_x_m = 0.001" in text
    (tmp_path / "campaign.toml").write_text(text.replace("sigma_x_m = 0.001", "sigma_x_m = 0.0005"))
    (tmp_path / "runs").symlink_to(replica / "runs")
    fit = fit_least_squares(load_campaign(tmp_path / "campaign.toml").problem(["heavy-02"]))
    (good,) = check_goodness(fit, rng=rng)
    assert good.checks["chi2"].p_value < P_POOR_FIT


def test_truth_of_the_replica_is_never_read(replica: Path) -> None:
    truth = tomllib.loads((replica / "truth.toml").read_text())
    assert truth["gamma[heavy]"] == 0.187
    assert "truth" not in (replica / "campaign.toml").read_text()


# --- a stated error far larger than the residuals
# ------------------------------------------------------------------------------------------


def parabola(pattern: np.ndarray, stated: float):
    x = np.linspace(0.0, 1.0, pattern.size)
    from estim import fit_curve

    return fit_curve(
        "a + b*x + c*x**2",
        x,
        1.0 + 2.0 * x - 3.0 * x**2 + pattern,
        start={"a": 1.0, "b": 1.0, "c": 1.0},
        u_y=stated,
    )


def test_a_stated_error_that_covers_the_pattern_is_conservative_and_kept(
    rng: np.random.Generator,
) -> None:
    """3.5 mm of a sine under a stated 5 cm: ok, with the standard deviations of 5 cm."""
    x = np.linspace(0.0, 1.0, 40)
    pattern = 0.0035 * np.sin(19.0 * x) + 0.001 * rng.standard_normal(40)
    fit = parabola(pattern, 0.05)
    assert fit.status == "ok"
    design = np.vander(x, 3, increasing=True)
    stated = 0.05 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    np.testing.assert_allclose([fit.sds[name] for name in "abc"], stated, rtol=1e-6)
    note, complete = fit.notes
    assert "assumed to be complete" in complete
    assert "conservative" in note
    assert "'autocorrelation'" in note
    assert fit.goodness[0].covered == ("runs", "autocorrelation")
    assert fit.goodness[0].failed == ()


@pytest.mark.parametrize(("size", "n"), [(0.03, 40), (0.0035, 1000)])
def test_a_pattern_as_large_as_a_stated_standard_deviation_is_a_poor_fit(
    rng: np.random.Generator, size: float, n: int
) -> None:
    """Also where it is small, if there are so many points that a standard deviation of a parameter
    is smaller still.
    """
    fit = parabola(
        size * np.sin(19.0 * np.linspace(0.0, 1.0, n)) + 0.001 * rng.standard_normal(n), 0.05
    )
    assert fit.goodness[0].checks["chi2"].p_value > 1.0 - P_POOR_FIT
    assert fit.status == "poor-fit"


def test_small_white_residuals_have_no_pattern_to_cover(rng: np.random.Generator) -> None:
    fit = parabola(0.001 * rng.standard_normal(40), 0.05)
    assert fit.status == "ok"
    assert fit.goodness[0].covered == ()
    assert "smaller than u_y implies" in fit.notes[0]


@pytest.mark.statistics
def test_stated_deviations_cover_where_the_pattern_is_called_covered(
    rng: np.random.Generator,
) -> None:
    """Patterns over a tenth and a fifth of the range: what passes the rule is covered, all of them
    together are not.
    """
    from estim.checks.goodness_of_fit import _pattern

    n = 300
    x = np.linspace(0.0, 1.0, n)
    basis, triangle = np.linalg.qr(np.vander(x, 2))
    sd = np.linalg.norm(np.linalg.inv(triangle), axis=1)
    for length in (0.1, 0.2):
        apart = np.sqrt(3.0) * np.abs(x[:, None] - x) / length
        lower = np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(n))
        size = np.tile([0.05, 0.1, 0.2, 0.3], 250)[:, None]
        errors = size * (rng.standard_normal((1000, n)) @ lower.T) + 0.02 * rng.standard_normal(
            (1000, n)
        )
        off = np.abs(errors @ basis @ np.linalg.inv(triangle).T) / sd
        left = errors - errors @ basis @ basis.T
        covered = np.array([_pattern(row) <= 1.0 for row in left])
        assert np.sum(covered) > 80
        assert np.mean(off[covered] < 0.9945) > 0.9
        assert np.mean(off[covered] < 1.96) > 0.98
        assert np.mean(off[~covered] < 0.9945) < 0.75


CUBIC = {"start": {"a": 1.0, "b": 0.0, "c": 0.0, "d": 0.0}}


@pytest.mark.slow
@pytest.mark.parametrize("correlated", [False, True])
def test_a_curve_that_can_take_every_slow_shape_shows_no_drift(correlated: bool) -> None:
    """A cubic leaves nothing of the shapes of `trend` but rounding, or what the mixture of
    correlated errors leaves: no sign of a wrong curve.
    """
    x = np.linspace(-0.8, 0.8, 17)
    failed = []
    for seed in range(6):
        y = 5.0 - 1.5 * x**2 + 0.3 * x**3 + 0.02 * np.random.default_rng(seed).standard_normal(17)
        failed.append(
            fit_curve("a + b*x + c*x**2 + d*x**3", x, y, correlated=correlated, **CUBIC).status
        )
    assert failed == ["ok"] * 6


def test_a_drift_that_the_curve_cannot_take_is_seen(rng: np.random.Generator) -> None:
    x = np.linspace(-1.0, 1.0, 60)
    fit = fit_curve(
        "a + b*x", x, x + 0.3 * x**2 + 0.1 * rng.standard_normal(60), start={"a": 0.0, "b": 1.0}
    )
    assert "trend" in {finding.test for finding in fit.findings}


@pytest.mark.slow
@pytest.mark.parametrize("n_error", [30, 13_333, 1_000_000])
def test_data_sets_are_simulated_until_every_p_value_is_known_well_enough(
    n_error: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(1 + k)/(1 + n) at k = 25 has a relative error of 20 %; k = 10 do where p is clearly above
    what fails.  Few are held at a time.  Twenty points stand for `n_error`.
    """
    rng, sizes = np.random.default_rng(1), []
    for limit in ("_MOST_NUMBERS", "_MOST_AT_ONCE"):
        monkeypatch.setattr(goodness_of_fit, limit, getattr(goodness_of_fit, limit) * 20 / n_error)

    def simulate(n: int) -> goodness_of_fit.Drawn:
        sizes.append(n)
        errors = rng.standard_normal((20, n))
        return (lambda: errors,) * 2

    tests = goodness_of_fit._of_order(np.ones(20), stated=True)
    usual = goodness_of_fit._Tested(np.random.default_rng(2).standard_normal(20), tests)
    (checks,) = goodness_of_fit._checks([usual], simulate)
    least = min(check.p_value for check in checks.values())
    assert 10.0 <= round(least * (1 + sum(sizes)) - 1.0, 9) < 11.0 + least * 500
    assert max(sizes) * n_error <= 1e5 or max(sizes) == 1
    sizes.clear()
    errors = np.random.default_rng(2).standard_normal(20)
    nearly = goodness_of_fit._Tested(errors + np.linspace(-1.5, 1.5, 20), tests)
    (checks,) = goodness_of_fit._checks([nearly], simulate)
    least = min(check.p_value for check in checks.values())
    if n_error == 30:  # enough can be drawn
        assert P_POOR_FIT < least < 3.0 * P_POOR_FIT
        assert round(least * (1 + sum(sizes)) - 1.0, 9) >= 25.0
    sizes.clear()
    trending = goodness_of_fit._Tested(np.linspace(-2.0, 2.0, 20), tests)
    (checks,) = goodness_of_fit._checks([trending], simulate)
    assert sum(sizes) == max(2600, min(20_000, int(4e7 / n_error)))
    assert checks["trend"].p_value == 1.0 / (1.0 + sum(sizes)) < P_POOR_FIT
    sizes.clear()
    # smaller than those of one data set in 200: not of all
    small = goodness_of_fit._Tested(errors * np.sqrt(7.43 / (errors @ errors)), tests)
    (checks,) = goodness_of_fit._checks([small], simulate)
    if n_error == 30:
        below = (1.0 - checks["chi2"].p_value) * (1 + sum(sizes))
        assert round(below, 9) >= 10.0
        assert below / sum(sizes) == pytest.approx(0.005, rel=4.0 / np.sqrt(below))


@pytest.mark.slow
def test_the_p_values_of_right_curves_are_uniform_though_simulation_ends_early() -> None:
    rng, x = np.random.default_rng(3), np.linspace(0.1, 1.0, 12)
    root = -x[:, None]
    p_values = []
    for _ in range(300):
        errors = rng.standard_normal(x.size)
        z = errors - x * (x @ errors) / (x @ x)
        found = check_linear(z, root, x=x, y=x + z, f=x, sd=np.ones(12), stated=True, rng=rng)
        p_values.append(found.checks["largest"].p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 0.01
    # against the wrong curve, y = 1, they are not
    p_values = []
    for _ in range(100):
        errors = 3.0 + rng.standard_normal(x.size)
        z = errors - x * (x @ errors) / (x @ x)
        found = check_linear(z, root, x=x, y=x + z, f=x, sd=np.ones(12), stated=True, rng=rng)
        p_values.append(found.checks["autocorrelation"].p_value)
    assert stats.kstest(p_values, "uniform").pvalue < 1e-6


@pytest.mark.parametrize("n", [5, 9])
def test_a_blunder_at_the_end_of_a_short_series_is_found_as_one_in_the_middle(n: int) -> None:
    """The fit follows a reading at the end, so that less is left of it."""
    x = np.arange(1.0, n + 1.0)
    for i in range(n):
        y = 2.0 * x + 0.1 * np.random.default_rng(i).standard_normal(n)
        assert fit_curve("a*x + b", x, y).status == "ok"
        y[i] += 40.0
        fit = fit_curve("a*x + b", x, y)
        assert fit.status == "poor-fit", i
        assert fit.goodness[0].failed == ("largest",), i


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("step", [1.0, 2.0])  # standard deviations
def test_few_readings_of_few_digits_are_no_poor_fit(
    stated: bool, step: float, rng: np.random.Generator
) -> None:
    x = np.arange(4.0)
    readings = [step * np.rint((1.0 + 20.3 * x + rng.normal(size=4)) / step) for _ in range(25)]
    u_y = np.hypot(1.0, step / np.sqrt(12.0)) if stated else None
    fits = [
        fit_curve(
            "a + b*x", x, 0.001 * y, u_y=u_y and 0.001 * u_y, scan=False, start={"a": 1.0, "b": 2.0}
        )
        for y in readings
        if np.ptp(np.diff(y, n=2)) + abs(y[2] - 2.0 * y[1] + y[0]) > 0.0  # not all on one line
    ]
    assert len(fits) > 20
    # a level of 0.001 for each of six tests: two of 25 are as rare as 0.01
    assert sum(fit.status == "poor-fit" for fit in fits) <= 1


@pytest.mark.parametrize("n", [12, 15, 30, 200])
@pytest.mark.parametrize("step", [2.0, 3.0])  # standard deviations
def test_readings_of_few_digits_are_no_poor_fit_however_many(
    n: int, step: float, rng: np.random.Generator
) -> None:
    failed = 0
    for _ in range(20):
        y = step * np.rint((rng.uniform(0.0, step) + rng.normal(size=n)) / step)
        y[0] += step * (np.ptp(y) == 0.0)
        failed += fit_curve("c", np.arange(n), y).status == "poor-fit"
    assert failed <= 1  # without the step a third of them


def test_readings_of_few_digits_are_judged_as_such_by_either_front_door() -> None:
    x, y = np.arange(5.0), np.array([1.0, 3.0, 5.1, 7.0, 9.0])
    assert fit_curve("a + b*x", x, y, u_y=0.1).status == "ok"
    assert line_goodness(fit_line(x, y, u_y=0.1)).failed == ()
    # of readings with many digits four would not lie on a line so exactly
    many = y + 1e-6 * np.array([0.31, -0.97, 0.23, 0.71, -0.5])
    assert "largest" in line_goodness(fit_line(x, many, u_y=0.1)).failed
    # whatever the unit
    assert line_goodness(fit_line(x, 1e-9 * y, u_y=1e-10)).failed == ()


@pytest.mark.parametrize("n", [5, 8, 12])
def test_a_blunder_among_few_readings_of_few_digits_is_found(
    n: int, rng: np.random.Generator
) -> None:
    x = np.arange(float(n))
    for _ in range(5):
        y = np.round(1.0 + 2.03 * x + rng.normal(0.0, 0.1, n), 1)
        y[n // 2] += 15.0
        assert (
            fit_curve("a + b*x", x, y, start={"a": 1.0, "b": 2.0}, scan=False).status == "poor-fit"
        )


@pytest.mark.parametrize("u_y", [0.01, 0.05])
def test_a_step_beyond_the_stated_errors_explains_nothing(u_y: float) -> None:
    x, y = np.arange(1.0, 6.0), np.array([0.0, 1.0, 2.0, 4.0, 5.0])
    for priors in ({}, {"b": "0(100)"}):
        fit = fit_curve("a*x + b", x, y, u_y=u_y, priors=priors)
        assert fit.status == "poor-fit"
        assert fit.goodness[0].checks["chi2"].p_value < 1e-3


def test_readings_repeated_to_the_digit_do_not_hide_a_bend() -> None:
    x, y = np.repeat([1.0, 2.0, 3.0, 4.0], 2), np.repeat([10.0, 20.0, 40.0, 70.0], 2)
    assert fit_curve("a*x + b", x, y).status == "poor-fit"


def test_a_right_curve_whose_constant_lies_on_its_limit_is_no_poor_fit() -> None:
    """With the null distribution of a constant that is free, 16 of these 40 sets of five points
    were refused.
    """
    x, start = np.linspace(0.0, 6.0, 5), {"a": 3.0, "tau": 1.5, "c": 0.1}
    fits = [
        fit_curve(
            "a*exp(-x/tau) + c",
            x,
            3.0 * np.exp(-x / 1.5) + 0.12 * np.random.default_rng(seed).standard_normal(5),
            u_y=0.12,
            bounds={"c": (0.0, None)},
            start=start,
            scan=False,
        )
        for seed in range(40)
    ]
    assert sum("c" in fit.fit.at_bound for fit in fits) > 12
    # each of seven tests refuses one of a thousand
    assert sum(fit.status == "poor-fit" for fit in fits) <= 2
    many = np.linspace(0.0, 6.0, 20)
    waves = 3.0 * np.exp(-many / 1.5) + 0.5 * np.sin(2.5 * many) - 0.2
    wrong = fit_curve(
        "a*exp(-x/tau) + c", many, waves, u_y=0.12, bounds={"c": (0.0, None)}, start=start
    )
    assert "c" in wrong.fit.at_bound
    assert wrong.status == "poor-fit"


@pytest.mark.parametrize(
    ("formula", "x", "u_y"),
    [
        ("a + b*x", [0.0, 1.0, 2.0], None),  # residuals r(1, -2, 1): no line, no growth
        ("a*x**2 + b", [-1.0, 0.0, 1.0], None),  # r(1, 0, -1): no autocorrelation
        ("a + b*x", [-5.0, -5.0, 5.0, 5.0], 0.05),  # a curve through both means
        ("a + b*x", [-5.0, -5.0, 5.0, 5.0], None),
    ],
)
def test_what_the_curve_leaves_no_room_for_is_no_pattern(
    formula: str, x: list[float], u_y: float | None
) -> None:
    """Statistics that are 0 whatever the errors are: rounding errors were compared with rounding
    errors, and up to nine tenths of these data were refused.
    """
    at = np.array(x)
    right = 1.0 + 2.0 * (at**2 if "**" in formula else at)
    fits = [
        fit_curve(formula, at, np.round(right + 0.05 * rng.standard_normal(at.size), 2), u_y=u_y)
        for rng in map(np.random.default_rng, range(40))
    ]
    assert sum(fit.status == "poor-fit" for fit in fits) <= 1


def test_a_parameter_on_its_limit_is_none_that_was_fitted() -> None:
    """Against the line without it, which SciPy solves."""
    x = np.linspace(0.0, 1.0, 6)
    y = 2.0 * x - 0.3 + np.array([0.1, -0.1, 0.05, 0.1, -0.1, -0.05])
    slope = float(x @ y / (x @ x))
    squares = float(np.sum((y - slope * x) ** 2))
    bounds: dict[str, tuple[float | None, float | None]] = {"b": (0.0, None)}
    stated = fit_curve("a*x + b", x, y, u_y=0.2, bounds=bounds)
    assert (stated.fit.at_bound, stated.dof) == (("b",), 5)
    assert stated.p_value == pytest.approx(stats.chi2.sf(squares / 0.2**2, 5), rel=1e-6)
    unstated = fit_curve("a*x + b", x, y, bounds=bounds)
    assert unstated.sigma == pytest.approx(np.sqrt(squares / 5), rel=1e-6)


def test_a_parameter_that_anothers_limit_makes_uncertain_follows_the_errors() -> None:
    """tau on its limit leaves a unknown to ten times itself, but far from 0: were both held, a line
    that is refused by itself would be `ok` as the beginning of an exponential.
    """
    x = np.linspace(0.0, 1.0, 10)
    y = 2.0 * x + 0.15 * np.random.default_rng(23).standard_normal(10)
    bounds, start = {"tau": (0.0, 1e3), "a": (0.0, 1e5)}, {"a": 5.0, "tau": 2.0}
    curve = fit_curve("a*(1 - exp(-x/tau))", x, y, u_y=0.1, bounds=bounds, start=start)
    assert curve.fit.at_bound == ("tau",)
    line = fit_curve("a*x", x, y, u_y=0.1)
    assert line.status == curve.status == "poor-fit"
    assert curve.goodness[0].checks["chi2"].p_value == pytest.approx(line.p_value, rel=1e-2)


def test_the_only_parameter_may_lie_on_its_limit_beside_errors_of_x() -> None:
    y = -0.02 * np.abs(np.random.default_rng(0).standard_normal(8))
    places, bounds = np.linspace(0.5, 6.0, 8), {"a": (0.0, None)}
    assert fit_curve("a*x", places, y, u_y=0.1, u_x=0.1, bounds=bounds).status == "ok"


def test_a_prior_of_a_parameter_on_its_limit_is_no_reading() -> None:
    x, y = np.arange(4.0), np.array([3.0, 2.1, 1.6, 0.4])
    fit = fit_curve("a + b*x", x, y, priors={"b": HalfNormal(1.0)})
    assert (fit.fit.at_bound, fit.dof) == (("b",), 3)
    assert fit.sigma == pytest.approx(np.std(y, ddof=1))


def test_a_parameter_that_the_data_do_not_see_lies_on_no_limit() -> None:
    x = np.linspace(0.0, 5.0, 8)
    y = 2.0 * x + 0.1 * np.random.default_rng(1).standard_normal(8)
    fit = fit_curve(
        "a*x + b*max(0, x - 100)",
        x,
        y,
        u_y=0.1,
        bounds={"b": (0.0, None)},
        start={"a": 1, "b": 0.5},
    )
    assert fit.fit.at_bound == ()
    assert fit.status == "not-identified"


@pytest.mark.parametrize("offset", [0.0, 5.0, 1e7, 1e9])
def test_readings_in_steps_of_an_encoder_from_any_zero_are_no_poor_fit(offset: float) -> None:
    """Readings 12 apart, to which the zero adds what is no multiple of 12."""
    x = np.linspace(0.0, 10.0, 40)
    for seed in range(4):
        errors = 2.0 * np.random.default_rng(seed).standard_normal(x.size)
        y = offset + 12.0 * np.round((3.0 * x + errors) / 12.0)
        assert fit_curve("line", x, y).status == "ok"
    bent = offset + 12.0 * np.round((3.0 * x + 3.0 * (x - 5.0) ** 2) / 12.0)
    assert fit_curve("line", x, bent).status == "poor-fit"


@pytest.mark.parametrize("common", [0.0, 1e7, 1e10])
def test_what_all_readings_have_in_common_hides_no_wrong_curve(common: float) -> None:
    """A frequency near 10 MHz is read to a tenth of a hertz: its digits are no step of 10 MHz."""
    x, found = np.arange(30.0), {}
    noise = 0.05 * np.random.default_rng(1).standard_normal(30)
    for name, bend in (("right", 0.0), ("wrong", 0.02)):
        y = common + np.round(2.0 * x + bend * (x - 15.0) ** 2 + noise, 1)
        found[name] = fit_curve("line", x, y).goodness[0]
        pulls = found[name].checks["trend"].p_value, found[name].checks["runs"].p_value
        assert name == "right" or max(pulls) < P_POOR_FIT
    assert not found["right"].failed
    # simulated data sets are rounded as these are, so that p is no 1 and no least one
    assert 0.001 < found["right"].checks["largest"].p_value < 1.0


def test_simulated_p_values_do_not_depend_on_the_signs_of_eigenvectors(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """These are a matter of the processor: a report would not be verified on another one."""
    x = np.linspace(0.0, 5.0, 20)
    y = 2.0 * x + 1.0 + 0.1 * rng.standard_normal(20)
    fit = fit_curve("a*x + b", x, y, u_y=0.1, priors={"a": "2.00(3)", "b": "1.0(1)"}).fit

    def p_values() -> list[float]:
        (goodness,) = check_goodness(fit, rng=np.random.default_rng(1))
        return [check.p_value for check in goodness.checks.values()]

    before, eigh = p_values(), np.linalg.eigh

    def turned(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        spectrum, basis = eigh(matrix)
        return spectrum, -basis

    monkeypatch.setattr(np.linalg, "eigh", turned)
    assert p_values() == before
