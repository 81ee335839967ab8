"""A parameter of the formula that differs between runs, mean + s z with z ~ N(0, 1) in each:
the marginal over runs against the exact integral, and what happens where it cannot be computed.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner

from estim import pipeline
from estim.arrays import log_sum_exp
from estim.calibration import findings, posterior_draws, run_trials
from estim.calibration.experiment import PointDesign
from estim.calibration.trial import TrialPlan, _experiment
from estim.campaign import Campaign, load_campaign
from estim.cli.commands import cli
from estim.common import Kind, NumericalError, Status
from estim.curve_fitting.joint_fit import fit_curves
from estim.curve_fitting.single import fit_curve
from estim.curves import DataSet
from estim.fitting import Fit, fit_problem
from estim.fitting.incidental_parameters import spreads_and_effects
from estim.pipeline import analyse_fit
from estim.planning.planning import plan
from estim.problem.priors import HalfNormal, LogNormal, Normal, Uniform
from estim.sampling import Optima, conditional, marginal_draws
from estim.sampling.chain import Chain, Target, sample_posterior
from estim.sampling.importance import difference
from estim.sampling.log_density import Density
from estim.sampling.marginal import MarginalPosterior, sample_marginal
from estim.sampling.summary import summarise_parameter

LEVELS = """title = "levels of several days"
kind = "synthetic"
[curve]
expression = "c + s*z"
x = {column = "number", name = "number"}
y = {column = "U_V", name = "U", unit = "V"}
[curve.parameters]
c = {start = 5.0, unit = "V"}
s = {prior = "half-normal", scale = 0.3, unit = "V"}
"""
X = np.linspace(0.0, 3.0, 6)
CENTRED = X - X.mean()


def lines(seed: int, n_run: int, spread: float) -> tuple[Fit, np.ndarray]:
    """Lines with offsets of their own, whose slopes scatter; and the slope of each by itself."""
    rng = np.random.default_rng(seed)
    ys = [
        rng.uniform(0.0, 1.0)
        + (2.0 + spread * rng.standard_normal()) * X
        + 0.1 * rng.standard_normal(X.size)
        for _ in range(n_run)
    ]
    data = {f"r{i}": DataSet(X, y, u_y=0.1) for i, y in enumerate(ys)}
    priors = {"s": HalfNormal(0.3), "z": Normal(0.0, 1.0)}
    found = fit_curves("a + (b + s*z)*x", data, shared=["b", "s"], priors=priors, scan=False)
    return found.fit, np.array([CENTRED @ y for y in ys]) / (CENTRED @ CENTRED)


def exact(slopes: np.ndarray) -> tuple[float, float, float]:
    """Mean and standard deviation of s, standard deviation of b: offsets, z and b in closed form,
    s on a grid.
    """
    s = np.linspace(0.0, 1.5, 6001)[1:]
    variance = s**2 + 0.01 / (CENTRED @ CENTRED)
    log_p = (
        -0.5 * (slopes.size - 1) * np.log(variance)
        - 0.5 * np.sum((slopes - slopes.mean()) ** 2) / variance
        - 0.5 * (s / 0.3) ** 2
    )
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    mean = p @ s
    return mean, float(np.sqrt(p @ (s - mean) ** 2)), float(np.sqrt(p @ variance / slopes.size))


@pytest.mark.parametrize(("n_run", "off"), [(3, 0.2), (10, 3.0)])
def test_a_spread_that_is_fitted_with_its_effects_has_no_interval(n_run: int, off: float) -> None:
    """Where the density of s and all z is highest, s is too large: for ten runs twice what it is by
    the integral over the z, so that no interval about it would hold what it says.
    """
    rng = np.random.default_rng(5)
    ys = [
        (2.0 + 0.2 * rng.standard_normal()) * X + 0.1 * rng.standard_normal(6) for _ in range(n_run)
    ]
    data = {f"r{i}": DataSet(X, y, u_y=0.1) for i, y in enumerate(ys)}
    priors = {"s": HalfNormal(0.3), "z": Normal(0.0, 1.0)}
    found = fit_curves("a + (b + s*z)*x", data, shared=["b", "s"], priors=priors, scan=False)
    mean, sd, _ = exact(np.array([CENTRED @ y for y in ys]) / (CENTRED @ CENTRED))
    assert found.values["s"] > mean + off * sd
    assert found.status == Status.METHODS_DISAGREE
    assert "the values of z, which" in found.reasons[0]
    assert "sample_curve" in found.reasons[0]
    assert np.isnan([found.sds["s"], *found.intervals["s"][0.95]]).all()


def test_a_spread_that_is_stated_by_its_value_has_no_interval_either() -> None:
    """It came out as 0.45 ± 0.26 where the integral over the z leaves 0.07 ± 0.13, and was ok."""
    rng = np.random.default_rng(3)
    levels = 5.0 + 0.2 * rng.standard_normal(10)
    data = {
        f"r{i}": DataSet(X, y + 0.1 * rng.standard_normal(6), 0.1) for i, y in enumerate(levels)
    }
    priors = {"s": Normal(0.3, 0.3), "z": Normal(0.0, 1.0)}
    found = fit_curves("c + s*z + 0*x", data, shared=["c", "s"], priors=priors, scan=False)
    assert found.status == Status.METHODS_DISAGREE
    assert np.isnan(found.sds["s"])
    correction = fit_curve(
        "c + k*dT*x",
        X,
        5.0 + 0.1 * rng.standard_normal(6),
        u_y=0.1,
        priors={"k": "0.10(2)", "dT": "0(1)"},
        rng=1,
    )
    assert correction.fit.spreads_and_effects == (frozenset(), frozenset())


def test_a_spread_within_one_data_set_has_no_interval_either() -> None:
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(6), 4)
    y = 5.0 + 0.2 * rng.standard_normal(6)[group] + 0.1 * rng.standard_normal(24)
    names = [f"z{i}" for i in range(6)]
    terms = " + ".join(f"z{i}*g{i}" for i in range(6))
    found = fit_curve(
        f"c + s*({terms})",
        {f"g{i}": (group == i).astype(float) for i in range(6)},
        y,
        u_y=0.1,
        start={"c": 5.0, "s": 0.2, **dict.fromkeys(names, 0.1)},
        priors={"s": HalfNormal(0.3), **dict.fromkeys(names, "0(1)")},
        scan=False,
    )
    assert found.values["s"] > 1.4 * np.std(y.reshape(6, 4).mean(axis=1), ddof=1)
    assert found.status == Status.METHODS_DISAGREE
    assert np.isnan(found.intervals["s"][0.95]).all()


def test_errors_of_each_run_with_one_prior_leave_a_joint_fit_as_it_is() -> None:
    """Of a gain hardly anything depends on what is shared, of a zero of time much does; but both
    were read, and neither belongs to a spread.
    """
    rng = np.random.default_rng(6)
    late = 0.3 * rng.standard_normal(12)
    ys = [5.0 * np.exp(-(X - t) / 0.5) + 0.5 * rng.standard_normal(6) for t in late]
    data = {f"r{i}": DataSet(X, y, u_y=0.5) for i, y in enumerate(ys)}
    for formula, priors in (
        ("a*exp(-(x - t0)/tau)", {"t0": Normal(0.0, 0.3)}),
        ("gain*a*exp(-x/tau)", {"gain": Normal(1.0, 0.6)}),
    ):
        found = fit_curves(formula, data, shared=["a", "tau"], priors=priors, scan=False)
        assert found.status == Status.OK


def spreads(found: MarginalPosterior) -> tuple[float, float, float]:
    s, b = found.names.index("s"), found.names.index("b")
    return found.mean[s], found.sd[s], found.sd[b]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "n_run", "spread"), [(2, 8, 0.02), (4, 20, 0.2)])
def test_a_spread_of_slopes_is_that_of_the_exact_integral(
    seed: int, n_run: int, spread: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, slopes = lines(seed, n_run, spread)
    few = {"n_draw": 5000, "n_check": 2000}
    expected = exact(slopes)
    found = sample_marginal(fit, rng=np.random.default_rng(1), **few)
    assert found.trusted
    # the fourth moment of a skewed s: its sd is uncertain by some 2 % from 4000 draws
    assert spreads(found) == pytest.approx(expected, rel=0.07)
    # the wrong version: without the room that z has, which is less where s is large
    monkeypatch.setattr(conditional, "log_volume", lambda root: np.zeros(root.shape[0]))
    wrong = sample_marginal(fit, rng=np.random.default_rng(1), **few)
    assert abs(spreads(wrong)[0] / expected[0] - 1.0) > 0.1


def test_a_spread_with_limits_on_both_sides_is_a_value_and_does_not_press_the_upper_one() -> None:
    """Beside its effects it is best at the upper limit whatever the data say."""
    rng = np.random.default_rng(5)
    data = {
        f"r{i}": DataSet(X, 10.0 + 0.25 * rng.standard_normal() + 0.1 * rng.standard_normal(6), 0.1)
        for i in range(40)
    }
    priors = {"s": Uniform(0.0, 0.6), "z": Normal(0.0, 1.0)}
    fit = fit_curves("c + s*z + 0*x", data, shared=["c", "s"], priors=priors, scan=False).fit
    assert fit.values[fit.names.index("s")] == pytest.approx(0.6)
    analysis = analyse_fit(fit, seed=1)
    assert analysis.diagnosis.ok
    assert not [told for told in analysis.diagnosis.remarks if told.kind is Kind.LIMIT]
    drawn = summarise_parameter(fit, "s", analysis.chain.flat[:, fit.names.index("s")])
    s = np.linspace(0.0, 0.6, 6001)[1:]
    variance, levels_read = s**2 + 0.01 / 6, np.array([np.mean(read.y) for read in data.values()])
    log_p = -19.5 * np.log(variance) - 20.0 * np.var(levels_read) / variance
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    sd = float(np.sqrt(p @ (s - p @ s) ** 2))
    assert drawn.mean == pytest.approx(p @ s, abs=0.06 * sd)
    assert drawn.sd == pytest.approx(sd, rel=0.06)


@pytest.mark.slow
def test_draws_for_plans_and_calibrations_have_the_exact_spread_too() -> None:
    """Where a chain of as many steps as they allow does not converge."""
    fit, slopes = lines(5, 5, 0.2)
    draws, how, shortfall = posterior_draws(fit, 1000.0, np.random.default_rng(2))
    assert (how, shortfall) == ("importance sampling", "")
    s, b = draws[:, fit.names.index("s")], draws[:, fit.names.index("b")]
    assert (s.mean(), s.std(), b.std()) == pytest.approx(exact(slopes), rel=0.1)


def levels(folder: Path, seed: int, n_run: int, n: int) -> tuple[Fit, np.ndarray]:
    """Readings about a level of each run, whose scatter is inferred and differs between runs."""
    rng = np.random.default_rng(seed)
    own, sd = 0.2 * rng.standard_normal((n_run, 1)), rng.uniform(0.07, 0.15, (n_run, 1))
    ys = 5.0 + own + sd * rng.standard_normal((n_run, n))
    rows = "\n".join(f"{i},{y:.6f}" for i, y in enumerate(ys.ravel()))
    (folder / "readings.csv").write_text(f"number,U_V\n{rows}\n")
    runs = "".join(
        f'[[runs]]\nname = "r{i}"\nfile = "readings.csv"\n'
        f"window = {{min = {i * n}, max = {i * n + n - 1}}}\n"
        '[runs.parameters]\nz = {prior = "normal", mean = 0.0, sd = 1.0}\n'
        for i in range(n_run)
    )
    (folder / "campaign.toml").write_text(LEVELS + runs)
    campaign = load_campaign(folder / "campaign.toml")
    return fit_problem(campaign.problem(list(campaign.runs)), rng=rng), np.round(ys, 6)


def exact_levels(fit: Fit, ys: np.ndarray) -> tuple[float, float, float]:
    """Mean and standard deviation of s, standard deviation of c: z in closed form, the others on
    grids.
    """
    n, means, s, log_sd = ys.shape[1], ys.mean(axis=1), np.linspace(1e-4, 1.2, 200), np.log(20.0)
    c, u = means.mean() + np.linspace(-1.2, 1.2, 241)[:, None, None], np.linspace(-6.0, 2.0, 300)
    log_p = -0.5 * (s / 0.3) ** 2 * np.ones((241, 1))
    priors = {p.name: p.prior for p in fit.problem.parameters}
    for i, (y, mean) in enumerate(zip(ys, means, strict=True)):
        prior = priors[f"sigma_y[r{i}]"]
        assert isinstance(prior, LogNormal)
        variance = s[:, None] ** 2 + np.exp(2.0 * u) / n
        terms = (
            (1 - n) * u
            - 0.5 * np.sum((y - mean) ** 2) * np.exp(-2.0 * u)
            - 0.5 * ((u - np.log(prior.median)) / log_sd) ** 2
            - 0.5 * np.log(variance)
            - 0.5 * (mean - c) ** 2 / variance
        )
        log_p += log_sum_exp(terms, axis=2)
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    of_c, of_s, place = p.sum(axis=1), p.sum(axis=0), c[:, 0, 0]
    mean = of_s @ s
    return (
        mean,
        float(np.sqrt(of_s @ (s - mean) ** 2)),
        float(np.sqrt(of_c @ (place - of_c @ place) ** 2)),
    )


@pytest.mark.slow
@pytest.mark.parametrize(("n_run", "n"), [(8, 4), (6, 10)])
def test_a_spread_of_levels_beside_scatters_that_are_inferred_is_the_exact_one(
    n_run: int, n: int, tmp_path: Path
) -> None:
    fit, ys = levels(tmp_path, 5, n_run, n)
    found = sample_marginal(fit, rng=np.random.default_rng(1))
    s, c = found.names.index("s"), found.names.index("c")
    mean, sd, sd_of_c = exact_levels(fit, ys)
    assert abs(found.mean[s] - mean) < 0.06 * sd
    assert found.sd[s] == pytest.approx(sd, rel=0.07)
    assert found.sd[c] == pytest.approx(sd_of_c, rel=0.07)
    assert set(found.sampled) == {"c", "s"}


@pytest.mark.slow
def test_a_spread_is_sampled_by_the_marginal_where_a_chain_does_not_converge(
    tmp_path: Path,
) -> None:
    fit, _ = levels(tmp_path, 1, 6, 10)
    assert analyse_fit(fit, seed=1, target=Target(ess=1000.0)).diagnosis.status is Status.OK
    few = Target(ess=1000.0, max_step=5000)  # which are enough where a chain converges
    chain = analyse_fit(fit, seed=1, target=few, marginal=False)
    assert chain.diagnosis.status is Status.NOT_CONVERGED


@pytest.mark.slow
def test_a_report_says_which_value_of_a_spread_counts(tmp_path: Path) -> None:
    """Beside the draws stands the mode together with all z, where s is far too large."""
    levels(tmp_path, 1, 6, 10)
    place = str(tmp_path / "campaign.toml")
    arguments = ["fit", place, "--joint", "--out", str(tmp_path / "out"), "--figures", "none"]
    assert runner().invoke(cli, arguments).exit_code == 0
    report = (tmp_path / "out" / "report.md").read_text()
    assert "Least squares fit s together with the values of z, which" in report


def stated_levels(folder: Path, seed: int) -> tuple[Campaign, Fit, np.ndarray]:
    """Levels of six runs of four readings, whose errors are stated."""
    ys = 5.0 + 0.2 * np.random.default_rng(seed).standard_normal((6, 1))
    ys = np.round(ys + 0.1 * np.random.default_rng(seed + 1).standard_normal((6, 4)), 6)
    rows = "\n".join(f"{i},{y:.6f}" for i, y in enumerate(ys.ravel()))
    (folder / "readings.csv").write_text(f"number,U_V\n{rows}\n")
    runs = "".join(
        f'[[runs]]\nname = "r{i}"\nfile = "readings.csv"\n'
        f"window = {{min = {i * 4}, max = {i * 4 + 3}}}\n"
        '[runs.parameters]\nz = {prior = "normal", mean = 0.0, sd = 1.0}\n'
        for i in range(6)
    )
    text = LEVELS.replace("[curve.parameters]", "u_y = 0.1\n[curve.parameters]")
    text = text.replace("c = {start = 5.0", "c = {low = 0.0, high = 10.0")
    (folder / "campaign.toml").write_text(text + runs)
    campaign = load_campaign(folder / "campaign.toml")
    problem = campaign.problem(list(campaign.runs))
    return campaign, fit_problem(problem, rng=np.random.default_rng(seed)), ys


EFFECTS = frozenset(f"z[r{i}]" for i in range(6))


def test_a_spread_and_its_effects_are_told_from_corrections(tmp_path: Path) -> None:
    campaign, fit, _ = stated_levels(tmp_path, 5)
    assert fit.spreads_and_effects == ({"s"}, EFFECTS)
    path = tmp_path / "campaign.toml"
    stated = path.read_text()
    for formula, s, spreads, effects in (
        ("c + exp(s)*z", "s = {start = -1.0, low = -5.0, high = 1.0}", {"s"}, EFFECTS),
        ("c + s + z", 's = "0.0(1)"', set(), set()),
        ("c + s*z", 's = "0.3(2)"', {"s"}, EFFECTS),
    ):
        text = re.sub("(?m)^s = .*$", s, stated.replace("c + s*z", formula))
        path.write_text(text)
        campaign = load_campaign(path)
        problem = campaign.problem(list(campaign.runs))
        found = spreads_and_effects(problem.linearised(problem.start()), problem.start())
        assert found == (spreads, effects)


def test_a_plan_knows_the_size_of_a_spread_and_has_no_run_measure_its_own_effect(
    tmp_path: Path,
) -> None:
    """At the mode s is too large: u(c) came out 1.6 times as large as it is, and was to be halved
    by "z to ±0.48 (from 1), all 6".
    """
    campaign, _, ys = stated_levels(tmp_path, 5)
    found = plan(campaign, list(campaign.runs), target_names=["c"], seed=1)
    s = np.linspace(0.0, 1.5, 6001)[1:]
    variance = s**2 + 0.1**2 / 4
    log_p = -0.5 * (5 * np.log(variance) + 5 * np.var(ys.mean(axis=1), ddof=1) / variance)
    p = np.exp(log_p - 0.5 * (s / 0.3) ** 2 - np.max(log_p))
    u = np.sqrt(p @ variance / p.sum() / 6)
    assert found.drawn == pytest.approx([u], rel=0.07)
    assert found.now == pytest.approx([u], rel=0.15)
    assert not any(option.change.u for option in found.options)
    assert not any(way.words.startswith("z ") for way in found.halving[0].ways)


def test_runs_that_are_repeated_have_effects_of_their_own(tmp_path: Path) -> None:
    """What was stated of them is no measurement: in each repetition all are drawn anew."""
    _, fit, _ = stated_levels(tmp_path, 5)
    trial = TrialPlan(
        PointDesign(fit.problem), "coverage", fit.values, ("c", "s"), 100.0, 1, EFFECTS
    )
    for seed in range(3):
        values, problem, _ = _experiment(trial, np.random.default_rng(seed))
        kept = np.isin(fit.names, ["c", "s"])
        assert np.all(values[kept] == fit.values[kept])
        assert np.all(values[~kept] != fit.values[~kept])
        assert [p.prior for p in problem.parameters] == [p.prior for p in fit.problem.parameters]


@pytest.mark.statistics
def test_the_interval_of_a_spread_is_found_calibrated(tmp_path: Path) -> None:
    """With each effect kept, and its prior taken for a measurement of it, 1 of 20 held s."""
    _, fit, _ = stated_levels(tmp_path, 5)
    design = PointDesign(fit.problem)
    found = run_trials(design, fit, "coverage", n_trial=60, seed=1, ess=400.0)
    assert findings(found) == ()
    assert found.share("s")[0] > 0.55
    draws, _, _ = posterior_draws(fit, 400.0, np.random.default_rng(1))
    s = draws[:, fit.names.index("s")]
    assert found.truth[0, list(found.reported).index("s")] == pytest.approx(np.median(s), rel=0.1)


def decays(seed: int) -> tuple[Fit, list[np.ndarray], np.ndarray]:
    """Decays of eight runs whose lifetimes scatter; tau + s z may be negative."""
    rng, x = np.random.default_rng(seed), np.linspace(0.0, 6.0, 10)
    ys = [
        rng.uniform(3.0, 6.0) * np.exp(-x / (2.0 + 0.3 * rng.standard_normal()))
        + 0.05 * rng.standard_normal(x.size)
        for _ in range(8)
    ]
    data = {f"r{i}": DataSet(x, y, u_y=0.05) for i, y in enumerate(ys)}
    priors = {"s": HalfNormal(0.5), "z": Normal(0.0, 1.0)}
    found = fit_curves(
        "A*exp(-x/(tau + s*z))", data, shared=["tau", "s"], priors=priors, scan=False
    )
    return found.fit, ys, x


@pytest.mark.slow
def test_a_spread_of_lifetimes_is_that_of_a_grid_though_some_may_be_negative() -> None:
    fit, ys, x = decays(3)
    found = analyse_fit(fit, seed=1, target=Target(ess=2000.0))
    assert found.diagnosis.ok, found.diagnosis.reasons
    # by quadrature: A in closed form, over the lifetime of each run, then over tau and s
    lifetimes, tau, s = (
        np.linspace(1.0, 4.0, 1501),
        np.linspace(1.2, 2.8, 161),
        np.linspace(0.02, 1.5, 149),
    )
    shape = np.exp(-x / lifetimes[:, None])
    size = np.sum(shape**2, axis=1)
    each = [
        -0.5 * np.sum((y - ((shape @ y) / size)[:, None] * shape) ** 2, axis=1) / 0.05**2
        for y in ys
    ]
    log_p = np.empty((tau.size, s.size))
    for k, width in enumerate(s):
        normal = np.exp(-0.5 * ((lifetimes - tau[:, None]) / width) ** 2) / width
        log_p[:, k] = -0.5 * (width / 0.5) ** 2 + sum(
            np.log(normal @ np.exp(one - one.max())) for one in each
        )
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    for name, grid, weight in (("tau", tau, p.sum(axis=1)), ("s", s, p.sum(axis=0))):
        mean = weight @ grid
        sd = np.sqrt(weight @ (grid - mean) ** 2)
        draws = found.chain.column(name)
        assert draws.mean() == pytest.approx(mean, abs=0.1 * sd)
        assert draws.std() == pytest.approx(sd, rel=0.08)


@pytest.mark.slow
def test_where_the_marginal_cannot_be_computed_a_chain_samples_or_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def singular(*args: object, **kwargs: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    fit, _ = lines(1, 8, 0.2)
    monkeypatch.setattr(marginal_draws, "sample_marginal", singular)
    with pytest.raises(NumericalError, match=r"cannot be computed \(Singular matrix\): use"):
        analyse_fit(fit, seed=1, marginal=True)
    brief = Target(max_step=60)

    def chain(density: Density, optima: Optima, **_: object) -> Chain:
        rng = np.random.default_rng(1)
        return sample_posterior(density, optima.value, optima.cov, target=brief, rng=rng)

    monkeypatch.setattr(pipeline, "proposed_chain", chain)
    found = analyse_fit(fit, seed=1)
    assert found.chain.convergence.n_step == brief.max_step
    assert found.diagnosis.status is Status.NOT_CONVERGED


def test_two_sets_of_weights_that_differ_in_a_width_alone_differ() -> None:
    z = np.random.default_rng(1).standard_normal((20_000, 1))
    narrow = -0.5 * z[:, 0] ** 2 * (1.0 / 0.8**2 - 1.0)
    even = np.full(len(z), -np.log(len(z)))
    size, u = difference(z, even, narrow - np.log(np.sum(np.exp(narrow))))
    assert size == pytest.approx(0.5 * (1.0 - 0.8**2), abs=0.02)
    assert u < 0.02


def test_a_coefficient_of_a_correction_is_no_spread(rng: np.random.Generator) -> None:
    """One that was measured times a correction of 0: the marginal of the coefficient is its
    prior.
    """
    x = np.linspace(0.0, 10.0, 20)
    y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(x.size)
    priors = {"k": "0.010(5)", "dT": "0(1)"}
    fit = fit_curve("a + b*x + k*dT*x", x, y, u_y=0.1, priors=priors, rng=1)
    assert fit.status == "ok"
    assert fit.sds["k"] == pytest.approx(0.005, rel=0.01)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("width", ["sqrt(s)", "log(s)"])
def test_a_spread_beside_the_end_of_its_range_is_named_without_a_warning(width: str) -> None:
    """One standard deviation away the curve may have no value."""
    rng = np.random.default_rng(0)
    x = np.linspace(0.1, 3.0, 8)
    slopes = 2.0 + 0.2 * rng.standard_normal(4)
    sets = {
        f"s{i}": DataSet(x, slope * x + 0.1 * rng.standard_normal(8), 0.1)
        for i, slope in enumerate(slopes)
    }
    fit = fit_curves(
        f"m*x + {width}*z*x",
        sets,
        shared=["m", "s"],
        priors={"z": "0(1)"},
        start={"m": 2.0, "s": 0.3},
        bounds={"s": (0.0, 5.0)},
        rng=1,
    )
    assert fit.status == Status.METHODS_DISAGREE
    assert np.isnan(fit.sds["s"])


def test_no_note_refers_to_an_interval_that_is_not_there() -> None:
    """Of a spread that its limit of 0 cuts off, and of the values beside it."""
    rng = np.random.default_rng(1)
    x = np.linspace(0.0, 5.0, 12)
    sets = {
        f"d{i}": DataSet(x, 2.0 * x + 1.0 + 0.1 * rng.standard_normal(12), u_y=0.1)
        for i in range(4)
    }
    fit = fit_curves(
        "a*x + m + s*z",
        sets,
        shared=["a", "m", "s"],
        priors={"z": "0(1)"},
        bounds={"s": (0.0, 1.0)},
        start={"s": 0.1},
    )
    assert {finding.kind for finding in fit.seen} & {Kind.AT_LIMIT, Kind.CUT_BY_LIMIT}
    shown = str(fit)
    assert "use its interval" not in shown
    assert "-0.0" not in shown
