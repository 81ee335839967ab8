"""Models of a rolling body side by side: the same points and noise, evidences that are right, and
the model that made the data is found.

Evidences are compared with closed forms (a linear curve), with the Savage-Dickey ratio of nested
models, and with each other.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_runner import runner
from joint_runs import LINE, problem_of
from report_words import first_screen, words
from scipy.stats import gaussian_kde, multivariate_normal
from test_noise import CAMPAIGN, DIFFERENTIATED, TIMES

from estim.campaign import Campaign, load_campaign
from estim.cli.commands import cli
from estim.common import InputError, Stream, stream
from estim.curves import RollingMotion
from estim.discrepancy import MixtureErrors, Trajectory, pose_without_force, replicas
from estim.discrepancy.grid import SCALES, Grid, noise_grid
from estim.discrepancy.linearised import linearise
from estim.discrepancy.mixture_likelihood import keep_probable
from estim.discrepancy.residuals import Residuals
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.explanation import predictive_checks
from estim.fitting import fit_problem
from estim.fitting.least_squares import fit_least_squares
from estim.model import Body
from estim.model.simulate import simulate_positions
from estim.problem import HalfNormal, Normal, Problem
from estim.problem.roots import root_of
from estim.reports.models import ground_words, price_words, verdicts
from estim.sampling import Target, adapt_proposal, certify
from estim.studies.model_comparison import (
    APART,
    START,
    Ground,
    ModelComparison,
    check_same_points,
    compare_models,
    contains,
    fit_model,
    recommend,
)

QUICK = Target(ess=1000.0, max_step=1500)
KNOWN = CAMPAIGN.replace(
    'gamma = {prior = "uniform", low = 0.05, high = 0.40}', 'gamma = "0.187(1)"'
).replace('kappa = {prior = "uniform", low = 0.0, high = 2.0}', 'kappa = "0.45(1)"')
WITHOUT_DRAG = ("paper", "rolling-resistance", "unmodelled-force")


def rolled(
    folder: Path,
    *,
    seed: int = 1,
    resistance: float = 0.0,
    bump: float = 0.0,
    shared: str = "",
    noise: str = DIFFERENTIATED,
    text: str = KNOWN,
) -> Campaign:
    """A disk of known gamma and kappa; bump : m, by which a hollow of the ramp shifts readings
    about its middle.
    """
    body = Body(radius=0.15, gamma=0.187, kappa=0.45)
    start = {"phi": np.radians(4.0), "theta0": np.radians(60.0)}
    x = simulate_positions(
        TIMES,
        body,
        **start,
        rolling_resistance=resistance,
        g=9.81,
        sigma_x=0.001,
        rng=np.random.default_rng(seed),
    )
    x = x + bump * np.exp(-0.5 * ((x - 0.22) / 0.04) ** 2)
    (folder / "r.csv").write_text(
        "t_s,x_m\n" + "\n".join(f"{t:.6f},{one:.9f}" for t, one in zip(TIMES, x, strict=True))
    )
    (folder / "c.toml").write_text(
        text.replace("[shared]\n", f"[shared]\n{shared}").replace("NOISE", noise)
    )
    return load_campaign(folder / "c.toml")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> ModelComparison:
    """Data of the paper's model."""
    return compare_models(
        rolled(tmp_path_factory.mktemp("plain")),
        ["r"],
        seed=1,
        target=QUICK,
        chosen=(*WITHOUT_DRAG, "free-start"),
    )


def names(campaign: Campaign) -> dict[str, tuple[str, ...]]:
    return {model.name: model.own for model in campaign.curve_models(["r"])}


def test_models_are_the_papers_and_one_thing_more_of_the_same_points(tmp_path: Path) -> None:
    models = rolled(tmp_path).curve_models(["r"])
    assert {model.name: model.own for model in models} == {
        "paper": (),
        "rolling-resistance": ("rolling_resistance",),
        "viscous-drag": ("viscous_drag",),
        "quadratic-drag": ("quadratic_drag",),
        "free-start": ("release_energy[r]",),
        "unmodelled-force": (),
    }
    check_same_points(models)
    assert [model.name for model in models if model.forced] == ["unmodelled-force"]
    shorter = replace(
        models[1],
        problem=rolled(tmp_path, noise="{sigma_x_m = 0.001}\nwindow = {x_max_m = 0.3}").problem(
            ["r"]
        ),
    )
    with pytest.raises(
        InputError,
        match=r"has other points than paper, and cannot be compared with it: rolling-resistance",
    ):
        check_same_points([models[0], shorter])


def test_what_a_campaign_states_keeps_its_prior_and_a_force_needs_normal_errors_of_stated_size(
    tmp_path: Path,
) -> None:
    said = (
        'rolling_resistance = {prior = "half-normal", scale = 0.003}\nload_resistance = {prior '
        '= "half-normal", scale = 0.004}\n'
    )
    both = ("rolling_resistance", "load_resistance")
    found = names(rolled(tmp_path, shared=said))
    assert found["load-resistance"] == both[1:]
    assert found["as-stated"] == found["unmodelled-force"] == both
    (model,) = (
        one
        for one in rolled(tmp_path, shared=said).curve_models(["r"])
        if one.name == "rolling-resistance"
    )
    assert model.lines == ()
    assert [p.prior for p in model.problem.parameters if p.name == "rolling_resistance"] == [
        HalfNormal(0.003)
    ]
    assert "unmodelled-force" not in names(
        rolled(tmp_path, noise='{sigma_x_m = 0.001, model = "positions", robust = "student-t"}')
    )
    assert "unmodelled-force" in names(rolled(tmp_path, shared="unmodelled_force = 0\n"))


def test_a_model_without_a_force_has_the_numbers_of_the_stated_noise(
    tmp_path: Path, plain: ModelComparison
) -> None:
    fit, complete = plain.rows[0].analysis.fit, rolled(tmp_path, shared="unmodelled_force = 0\n")
    stated = fit_problem(complete.problem(["r"], usual=True), rng=stream(1, Stream.FIT))
    assert stated.names == fit.names
    np.testing.assert_allclose((fit.values - stated.values) / stated.sds, 0.0, atol=0.05)
    assert all(0.95 < ratio < 1.1 for ratio in fit.sds / stated.sds)


def line_problem(y: np.ndarray, x: np.ndarray) -> Problem:
    return problem_of(
        LINE,
        {"slope": Normal(0.0, 2.0), "bend": Normal(0.0, 1.0), "offset": Normal(0.0, 3.0)},
        {},
        x,
        [y],
        0.1,
    )


def test_an_evidence_with_room_for_the_noise_is_the_sum_over_its_sizes(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Trajectory, "speed", lambda *_: None)  # of a straight line
    x = np.linspace(0.0, 1.0, 12)
    for size in (0.1, 0.16):  # as stated, and larger
        y = 0.3 + 0.8 * x + size * rng.standard_normal(x.size)
        problem = line_problem(y, x)
        white = fit_least_squares(problem)
        (run,) = problem.runs
        roomy = replace(run, motion=RollingMotion(False, None, True), force=1.0)
        noises, shared = pose_without_force(
            Problem(problem.parameters, (roomy,)), white.values, bad={}
        )
        assert shared == ()
        run = replace(problem.runs[0], noise=noises[problem.runs[0].name])
        fit = fit_least_squares(Problem(problem.parameters, (run,)), start=white.values)
        found = certify(
            fit.posterior, adapt_proposal(fit.posterior, fit.values, fit.cov, rng=rng), rng=rng
        )
        design, prior = np.column_stack([x, x**2, np.ones_like(x)]), np.diag([4.0, 1.0, 9.0])
        logs = [
            multivariate_normal(
                np.zeros(12), design @ prior @ design.T + (s * 0.1) ** 2 * np.eye(12)
            ).logpdf(y)
            for s in SCALES
        ]
        known = np.logaddexp.reduce(np.array(logs) + noise_grid().log_scales)
        assert found.log_evidence == pytest.approx(known, abs=5.0 * found.u_log_evidence + 0.01)
        assert abs(known - logs[SCALES.index(1.0)]) > 0.1  # with the stated size alone


def test_evidences_of_nested_models_have_the_savage_dickey_ratio(plain: ModelComparison) -> None:
    rows = {row.model.name: row for row in plain.rows}
    exact, free, forced = rows["paper"], rows["free-start"], rows["unmodelled-force"]
    energy = free.analysis.chain.flat[:, free.analysis.fit.names.index("release_energy[r]")]
    ratio = np.log(gaussian_kde(energy[::5])(0.0)[0]) - Normal(0.0, 0.02).log_density(0.0)
    assert ratio > 1.0
    assert exact.log_evidence - free.log_evidence == pytest.approx(ratio, abs=0.1)
    (force,) = forced.analysis.fit.forces
    assert free.log_evidence - forced.log_evidence == pytest.approx(
        np.log((1.0 - force.force.probability) / 0.5), abs=0.15
    )
    # a start whose width is scaled to nothing is exact: what is left between them is the force
    assert forced.price_of_start == pytest.approx(exact.log_evidence - free.log_evidence, abs=0.5)


def test_a_prior_twice_as_wide_halves_the_evidence_where_the_data_say_everything(
    plain: ModelComparison,
) -> None:
    rows = {row.model.name: row for row in plain.rows}
    changes = {one.factor: one.change for one in rows["free-start"].widths}
    assert changes == pytest.approx({0.5: np.log(2.0), 2.0: -np.log(2.0)}, abs=0.02)
    (row,) = (row for row in plain.rows if row.model.name == "rolling-resistance")
    fit = row.analysis.fit
    for one in row.widths:
        wide = tuple(
            replace(p, prior=HalfNormal(one.factor * 0.01)) if p.name == one.of else p
            for p in fit.problem.parameters
        )
        density = replace(fit.posterior, problem=replace(fit.problem, parameters=wide))
        again = certify(
            density,
            adapt_proposal(density, fit.values, fit.cov, rng=np.random.default_rng(2)),
            rng=np.random.default_rng(3),
        )
        assert one.change == pytest.approx(
            again.log_evidence - row.log_evidence,
            abs=4.0 * np.hypot(one.u, 2.0 * again.u_log_evidence) + 0.02,
        )
    assert {one.factor for one in rows["unmodelled-force"].widths if one.of == START} == {
        0.0,
        0.5,
        2.0,
    }


def test_a_clean_run_is_reported_with_room_though_simpler_models_have_more_evidence(
    plain: ModelComparison,
) -> None:
    assert (plain.recommended, plain.ground, plain.by_evidence) == (
        "unmodelled-force",
        Ground.ROOM,
        True,
    )
    assert all(row.ok for row in plain.rows)
    assert all(one.brought_back for row in plain.rows for one in row.predicted)
    assert plain.rows[0].odds < plain.rows[-1].odds


def stand_in(
    name: str,
    odds: float,
    *,
    own: tuple[str, ...] = (),
    forced: bool = False,
    ok: bool = True,
    price: float = 0.0,
) -> SimpleNamespace:
    return SimpleNamespace(
        model=SimpleNamespace(name=name, own=own, forced=forced),
        odds=odds,
        behind=odds,
        ok=ok,
        price_of_start=price,
    )


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (
            [("paper", 0.0), ("drag", 4.0, ("k",)), ("unmodelled-force", 9.0, "forced")],
            ("unmodelled-force", Ground.UNDECIDED),
        ),
        (
            [("paper", 0.0), ("drag", 4.0, ("k",)), ("unmodelled-force", 3.0, "forced")],
            ("unmodelled-force", Ground.ROOM),
        ),
        (
            [("paper", 0.4), ("drag", 1.0, ("k",)), ("unmodelled-force", 3.2, "forced", 2.9)],
            ("unmodelled-force", Ground.ROOM),
        ),
        (
            [("paper", 5.0), ("drag", 0.0, ("k",)), ("unmodelled-force", 4.0, "forced")],
            ("drag", Ground.SHOWN),
        ),
        (
            [("paper", 2.0), ("drag", 0.0, ("k",)), ("unmodelled-force", 9.0, "forced")],
            ("unmodelled-force", Ground.UNDECIDED),
        ),
        (
            [("paper", 9.0), ("drag", 0.0, ("k",)), ("unmodelled-force", 4.0, "forced", 3.0)],
            ("unmodelled-force", Ground.UNDECIDED),
        ),
        (
            [("paper", 9.0), ("drag", 0.0, ("k",), "bad"), ("unmodelled-force", 4.0, "forced")],
            ("unmodelled-force", Ground.ROOM),
        ),
        ([("paper", 1.0), ("drag", 0.0, ("k",))], ("drag", Ground.BEST)),
        ([("paper", 0.0, "bad"), ("unmodelled-force", 4.0, "forced", "bad")], ("", Ground.NONE)),
    ],
)
def test_the_default_is_left_only_for_something_that_it_does_not_contain_and_that_is_told_apart(
    rows, expected
) -> None:
    made = [
        stand_in(
            name,
            odds,
            own=next((one for one in more if isinstance(one, tuple)), ()),
            forced="forced" in more,
            ok="bad" not in more,
            price=next((one for one in more if isinstance(one, float)), 0.0),
        )
        for name, odds, *more in rows
    ]
    assert recommend(made, by_evidence=True) == expected


def test_what_the_first_lines_say_of_the_odds_is_true() -> None:
    """A model that the default does not contain has more evidence only with odds for it; what the
    free start costs counts in neither.
    """
    own = {
        "paper": (),
        "drag": ("k",),
        "free-start": ("release_energy[r]",),
        "unmodelled-force": (),
    }

    def compared(**odds: float) -> ModelComparison:
        rows = [
            stand_in(
                name.replace("_", "-"),
                behind,
                own=own[name.replace("_", "-")],
                forced="force" in name,
                price=2.9 if "force" in name else 0.0,
            )
            for name, behind in odds.items()
        ]
        rows = [SimpleNamespace(**vars(row), lack=None) for row in rows]
        return ModelComparison(tuple(rows), *recommend(rows, by_evidence=True), True)

    cheap = compared(paper=0.4, drag=0.9, free_start=3.4, unmodelled_force=3.2)
    said = dict(verdicts(cheap))
    assert "no model with an effect that it does not contain has higher evidence" in ground_words(
        cheap
    )
    assert said["drag"].startswith("the odds against it are 1.8 to 1")
    assert "odds for it" not in said["paper"].replace("the odds for it are 1 to 1", "")
    # which pays for its start as well
    assert "the odds against it are 1.2 to 1" in said["free-start"]
    assert "the penalty for the free start of unmodelled-force, 18 to 1" in price_words(cheap)
    beaten = compared(paper=1.5, drag=0.0, free_start=4.0, unmodelled_force=5.2)
    assert ground_words(beaten).startswith(
        "drag has higher evidence, 10 to 1 (positive), but these data do not distinguish it"
    )
    assert dict(verdicts(beaten))["drag"] == "the odds for it are 10 to 1 (positive)"


def test_only_a_model_with_all_that_another_has_contains_it() -> None:
    """The paper's model has no free start, and one with resistance alone no unmodelled force."""
    paper = stand_in("paper", 0.0)
    drag = stand_in("drag", 0.0, own=("k",))
    free = stand_in("free-start", 0.0, own=("release_energy[r]",))
    stated = stand_in("as-stated", 0.0, own=("k", "release_energy[r]"))
    force = stand_in("unmodelled-force", 0.0, own=("k",), forced=True)
    held = {
        (larger.model.name, row.model.name)
        for larger in (paper, drag, free, stated, force)
        for row in (paper, drag, free, stated, force)
        if larger is not row and contains(larger, row)
    }
    assert held == {
        ("drag", "paper"),
        ("free-start", "paper"),
        *(("as-stated", name) for name in ("paper", "drag", "free-start")),
        *(("unmodelled-force", name) for name in ("paper", "drag", "free-start")),
    }


def test_data_sets_drawn_again_have_the_mean_and_covariance_of_the_same_deviation_with_new_noise(
    rng: np.random.Generator,
) -> None:
    x = np.linspace(0.0, 1.0, 6)
    y = 0.2 * np.sin(9.0 * x) + 0.05 * rng.standard_normal(x.size)
    problem = line_problem(y, x)
    factor, push = 0.3 * np.exp(-0.5 * ((x[:, None] - x) / 0.3) ** 2), 0.1 * x[:, None]
    base = 0.05**2 * (np.eye(6) + 0.4 * np.eye(6, k=1) + 0.4 * np.eye(6, k=-1))
    deviation = diagonalise(
        root_of(base),
        (Shape("deviation", 0.3, factor, 0.0),),
        Grid(np.array([2.0]), np.zeros(1), np.ones(1), np.zeros(1)),
    )
    linear = linearise(
        deviation, y, np.column_stack([np.ones(6), push]), precision=np.diag([0.0, 1.0])
    )
    errors = MixtureErrors(
        problem.runs[0].points,
        keep_probable(linear, columns=push),
        root_of(np.ones(6)),
        Residuals(np.zeros(6)),
    )
    values = np.array([0.1, 0.0, -0.02])
    again = replicas(errors, problem.named(np.tile(values, (40_000, 1))), rng=rng)
    curve, lacking = values[0] * x + values[2], 4.0 * factor @ factor.T + push @ push.T
    gain = lacking @ np.linalg.inv(lacking + base)
    mean, cov = curve + gain @ (y - curve), lacking - gain @ lacking + base
    assert np.all(np.abs(again.mean(axis=0) - mean) < 5.0 * np.sqrt(np.diag(cov) / 40_000))
    np.testing.assert_allclose(
        np.cov(again.T), cov, atol=6.0 * np.max(np.diag(cov)) * np.sqrt(2.0 / 40_000)
    )
    assert np.max(np.abs(mean - curve)) > 0.1  # a deviation drawn from its prior would have none


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "failing", "every"),
    [
        (DIFFERENTIATED, ["energy"], ["largest_speed", "its_place", "turning_point", "energy"]),
        pytest.param(
            '{sigma_x_m = 0.001, model = "positions"}',
            ["farthest", "energy"],
            ["farthest", "largest_speed", "its_place", "energy"],
            marks=pytest.mark.statistics,
        ),
    ],
)
def test_a_model_without_resistance_does_not_bring_back_the_end_of_a_braked_run(
    tmp_path: Path, noise: str, failing: list[str], every: list[str]
) -> None:
    text = KNOWN.replace(
        'theta0_rad = {prior = "uniform", low = 0.6, high = 1.5}', 'theta0_rad = "1.047(5)"'
    )
    # which take up some of it
    braked = rolled(
        tmp_path, resistance=0.012, noise=noise, text=text, shared="scale_x = 0\nscale_t = 0\n"
    )
    models = {model.name: model for model in braked.curve_models(["r"])}
    checked = {}
    for name in ("paper", "rolling-resistance"):
        fit = fit_model(models[name], bad={}, rng=np.random.default_rng(1))
        draws = np.random.default_rng(2).multivariate_normal(fit.values, fit.cov, 1000)
        draws = draws[np.isfinite(fit.problem.log_prior(draws))]
        checked[name] = {
            one.name: one
            for one in predictive_checks(fit.posterior, draws, rng=np.random.default_rng(3))
        }
        assert list(checked[name]) == every
    assert [one.name for one in checked["paper"].values() if not one.brought_back] == failing
    assert all(one.p > 0.02 for one in checked["rolling-resistance"].values())


@pytest.mark.slow
def test_the_command_writes_a_report_and_says_what_is_recommended(
    tmp_path: Path, few_draws: None, undrawn: None
) -> None:
    rolled(tmp_path, resistance=0.01)
    ask = ["compare-models", str(tmp_path / "c.toml"), "--out", str(tmp_path / "out")]
    done = runner().invoke(cli, [*ask, "--model", "paper", "--model", "rolling-resistance"])
    assert done.exit_code == 0, done.output
    assert (
        "r: recommended: rolling-resistance: of the models with status ok it has the "
        "highest evidence" in done.stdout
    )
    report, record = (
        (tmp_path / "out" / "report.md").read_text(),
        json.loads((tmp_path / "out" / "models.json").read_text()),
    )
    assert "**Recommended: rolling-resistance**" in report
    assert '`rolling_resistance = {prior = "half-normal", scale = 0.01}`' in report
    first = first_screen(report)
    assert "figures/values.png" in first
    assert len(words(first)) < 120
    assert record["recommended"] == "rolling-resistance"
    assert [row["name"] for row in record["models"]] == ["paper", "rolling-resistance"]
    assert {path.name for path in (tmp_path / "out" / "figures").iterdir()} == {
        "values.png",
        "predictive.png",
    }
    assert not (tmp_path / "out" / ".checkpoint").exists()


def test_a_wrong_name_one_model_and_a_formula_are_refused(tmp_path: Path) -> None:
    campaign = rolled(tmp_path)
    with pytest.raises(
        InputError,
        match=r"'--model' must name one of the models \(paper, rolling-resistance, "
        r".*unmodelled-force\): drag",
    ):
        compare_models(campaign, ["r"], seed=1, chosen=["paper", "drag"])
    with pytest.raises(InputError, match="must name two models or more"):
        compare_models(campaign, ["r"], seed=1, chosen=["paper"])


@pytest.mark.statistics
def test_each_model_is_found_in_data_that_it_made_and_its_predictive_p_values_are_not_small(
    tmp_path: Path,
) -> None:
    found, small, total = [], 0, 0
    for seed in range(3):
        clean = compare_models(
            rolled(tmp_path, seed=10 + seed), ["r"], seed=1, target=QUICK, chosen=WITHOUT_DRAG
        )
        braked = compare_models(
            rolled(tmp_path, seed=20 + seed, resistance=0.01),
            ["r"],
            seed=1,
            target=QUICK,
            chosen=WITHOUT_DRAG,
        )
        found.append((clean.recommended, braked.recommended))
        p = [one.p for row in clean.rows for one in row.predicted]
        small, total = small + sum(one < 0.02 for one in p), total + len(p)
    assert sum(one == "unmodelled-force" for one, _ in found) >= 2
    assert sum(other == "rolling-resistance" for _, other in found) >= 2
    assert small <= 0.1 * total
    bumped = compare_models(
        rolled(tmp_path, seed=40, bump=0.008),
        ["r"],
        seed=1,
        target=QUICK,
        chosen=("paper", "unmodelled-force"),
    )
    assert bumped.recommended == "unmodelled-force"
    assert not bumped.rows[0].ok
    assert bumped.rows[0].odds > APART
