"""An unmodelled force stands beside the curve of a run unless the campaign says otherwise: runs of
the wheel end in a number.

Where it does not go the curve is taken as complete and the report says why; the key
`unmodelled_force` is refused there.
"""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from test_noise import CAMPAIGN, DIFFERENTIATED, INDEPENDENT, POSITIONS, TIMES, TRUTH

from estim.arrays import FloatArray
from estim.campaign import Campaign, as_complete, load_campaign
from estim.common import InputError
from estim.discrepancy.grid import prior_grid
from estim.fitting import fit_problem, unmodelled_force
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.unmodelled_force import fit_with_forces
from estim.pipeline import Analysis, analyse
from estim.problem import Problem
from estim.reports.analysis import analysis_report
from estim.reports.model_discrepancy import force_figure
from estim.reports.result import result_of
from estim.sampling.chain import Target
from estim.sampling.proposal import Proposal
from estim.words import describe

WHEEL = Path(__file__).resolve().parents[1] / "data" / "wheel"
KEY, OFF = "unmodelled_force = 0.02\n", "unmodelled_force = 0\n"


def body(folder: Path, *, noise: str = DIFFERENTIATED, shared: str = "", run: str = "") -> Campaign:
    """One run of an eccentric disk, its positions by an ODE solver with errors of a millimetre."""
    errors = 0.001 * np.random.default_rng(5).standard_normal(TIMES.size)
    rows = [f"{t:.6f},{x:.9f}" for t, x in zip(TIMES, POSITIONS + errors, strict=True)]
    (folder / "r.csv").write_text("t_s,x_m\n" + "\n".join(rows))
    text = CAMPAIGN.replace("[shared]\n", f"[shared]\n{shared}").replace(
        "noise = NOISE", f"{run}noise = {noise}"
    )
    (folder / "c.toml").write_text(text)
    return load_campaign(folder / "c.toml")


def fitted(campaign: Campaign) -> Fit:
    problem = campaign.problem(["r"])
    with campaign.placing(problem):
        return fit_problem(problem, rng=np.random.default_rng(1))


def wheel(folder: Path, force: str) -> Campaign:
    """The wheel with a line of its own about the force."""
    text = (
        (WHEEL / "campaign.toml")
        .read_text()
        .replace('file = "', f'file = "{WHEEL}/')
        .replace("[shared]\n", f"[shared]\n{force}")
    )
    (folder / "wheel.toml").write_text(text)
    return load_campaign(folder / "wheel.toml")


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Analysis]:
    campaign = load_campaign(WHEEL / "campaign.toml")
    return campaign, analyse(campaign, ["class-balanced_2"], seed=1, target=Target(ess=1000.0))


@pytest.mark.slow
def test_it_is_there_unless_the_campaign_says_0_and_a_stated_size_replaces_the_default(
    tmp_path: Path,
) -> None:
    default, stated = fitted(body(tmp_path)), fitted(body(tmp_path, shared=KEY))
    assert default.forces[0].scale == stated.forces[0].scale == 0.02
    assert np.array_equal(default.values, stated.values)
    assert np.array_equal(default.cov, stated.cov)
    assert body(tmp_path, shared="unmodelled_force = 0.1\n").problem(["r"]).runs[0].force == 0.1
    off, switched = (
        fitted(body(tmp_path, shared=OFF)),
        fitted(body(tmp_path, shared=KEY, run="unmodelled_force = 0.0\n")),
    )
    assert off.forces == switched.forces == ()
    assert np.array_equal(off.values, switched.values)
    assert off.problem.runs[0].complete is not None
    assert (
        describe(off.problem.runs[0].complete) == "the curve is assumed to be complete: as stated"
    )


AS_READ = '{model = "positions", sigma_x_m = 0.001}'


def nearby(campaign: Campaign) -> Fit:
    """`fitted` from one start beside the truth."""
    problem, rng = campaign.problem(["r"]), np.random.default_rng(1)
    start = np.array(
        [{**TRUTH, "release_time[r]": 0.0, "offset[r]": 0.0}[name] for name in problem.names]
    )
    white = fit_least_squares(problem, start=start)
    if not problem.runs[0].force:
        return white
    return fit_with_forces(white, rng=rng)


def test_positions_as_read_know_the_same_force(tmp_path: Path) -> None:
    white, fit = (
        nearby(body(tmp_path, noise=AS_READ, shared=OFF)),
        nearby(body(tmp_path, noise=AS_READ, shared=KEY)),
    )
    (found,) = fit.forces
    assert found.unit == "m"
    assert found.force.probability < 0.95
    assert found.bad.jumps == ()
    assert found.moved < 1.0
    curve = [name in TRUTH for name in fit.names]
    sds = np.sqrt(np.diag(white.cov))
    assert np.all(np.abs(fit.values - white.values)[curve] < 2.0 * sds[curve])
    assert np.all(np.sqrt(np.diag(fit.cov))[curve] < 2.5 * sds[curve])


@pytest.mark.slow
@pytest.mark.parametrize(
    "noise",
    [DIFFERENTIATED, INDEPENDENT.replace('independent"', 'independent", derivative = "central"')],
)
def test_on_a_clean_run_it_finds_little_and_costs_little(tmp_path: Path, noise: str) -> None:
    white, fit = (
        fitted(body(tmp_path, noise=noise, shared=OFF)),
        fitted(body(tmp_path, noise=noise)),
    )
    assert fit.success
    (found,) = fit.forces
    assert found.force.probability < 0.95
    sds = np.sqrt(np.diag(white.cov))
    assert np.all(np.abs(fit.values - white.values) < 2.0 * sds)
    assert np.all(np.sqrt(np.diag(fit.cov)) < 2.5 * sds)


def test_the_fit_is_a_maximum_of_the_density_that_is_sampled(tmp_path: Path) -> None:
    fit = fitted(body(tmp_path))
    sds = np.sqrt(np.diag(fit.cov))
    (likelihood,) = fit.posterior.likelihoods
    # least squares leave out how much a force counts at other inertias
    even = replace(likelihood, formed=replace(likelihood.formed, inertias=()))

    def density(u: np.ndarray) -> float:
        point = (fit.values + u * sds)[None, :]
        named = fit.problem.named(point)
        return float(
            (
                fit.posterior.log_density(point)
                - likelihood.log_likelihood(named)
                + even.log_likelihood(named)
            )[0]
        )

    assert np.abs(approx_fprime(np.zeros(sds.size), density, 1e-5)).max() < 0.01
    whole = approx_fprime(
        np.zeros(sds.size),
        lambda u: float(fit.posterior.log_density((fit.values + u * sds)[None, :])[0]),
        1e-5,
    )
    # which moves the mode by about that many standard deviations at most
    assert np.abs(whole).max() < 0.3


def test_a_wheel_that_the_curve_alone_does_not_explain_ends_in_a_number(
    found: tuple[Campaign, Analysis], tmp_path: Path
) -> None:
    campaign, analysis = found
    white = analyse(wheel(tmp_path, OFF), ["class-balanced_2"], seed=1, target=Target(ess=1000.0))
    assert white.diagnosis.status == "poor-fit"
    assert analysis.diagnosis.status == "ok"
    assert analysis.comparison.verdict == "agree"
    result, without = result_of(campaign, analysis), result_of(campaign, white)
    assert without.deviation is None
    assert result.deviation is not None
    force = result.deviation["class-balanced_2"]
    assert force.probability > 0.99
    assert 0.003 < force.typical < 0.03
    moment = result.runs["class-balanced_2"].derived["resisting_moment"]
    assert moment.mean == pytest.approx(0.955, abs=0.03)
    # the tilt limits both; what is the force's own adds to it
    assert 1.02 < force.growth["rolling_resistance"] < 2.0
    assert force.average is not None
    assert force.average.sd_material > 1.5 * force.average.sd
    assert any("P(amplitude > 0)" in note for note in result.notes)


@pytest.mark.parametrize(("n", "agrees"), [(17, True), (6, False)])
def test_sizes_of_a_force_are_summed_over_a_grid_that_is_fine_enough(
    monkeypatch: pytest.MonkeyPatch, project: Path, n: int, agrees: bool
) -> None:
    """Against 96 sizes, of a wheel whose force is far larger than the errors of its readings."""
    campaign = load_campaign(project / "data" / "wheel" / "mixed.toml", only="mixed-unbalanced_1")
    problem = campaign.problem(["mixed-unbalanced_1"], usual=True)

    def fitted(n_amplitude: int) -> Fit:
        defaults = {**prior_grid.__kwdefaults__, "n_amplitude": n_amplitude}
        monkeypatch.setattr(prior_grid, "__kwdefaults__", defaults)
        return fit_problem(problem, rng=np.random.default_rng(1))

    assert prior_grid.__kwdefaults__["n_amplitude"] == 17
    fine, coarse = fitted(96), fitted(n)
    proposal = Proposal.single(fine.values, fine.cov)
    draws = proposal.draw(np.random.default_rng(2), 4000)

    def moments(fit: Fit) -> tuple[FloatArray, FloatArray]:
        log_ratio = fit.posterior.log_density(draws) - proposal.log_density(draws)
        weights = np.exp(log_ratio - np.max(log_ratio))
        weights /= np.sum(weights)
        mean = weights @ draws
        return mean, np.sqrt(weights @ np.square(draws - mean))

    (mean, sd), (exact_mean, exact_sd) = moments(coarse), moments(fine)
    moved = np.max(np.abs(mean - exact_mean) / exact_sd)
    narrowed = np.max(np.abs(sd / exact_sd - 1.0))
    assert (moved < 0.01 and narrowed < 0.01) == agrees, (moved, narrowed)


def test_draws_are_those_of_the_linearised_answer_but_for_curvature(
    found: tuple[Campaign, Analysis],
) -> None:
    fit, draws = found[1].fit, found[1].chain.flat
    i = fit.names.index("rolling_resistance")
    assert draws[:, i].mean() == pytest.approx(fit.values[i], abs=0.3 * draws[:, i].std())
    assert np.sqrt(fit.cov[i, i]) == pytest.approx(draws[:, i].std(), rel=0.25)


@pytest.mark.usefixtures("undrawn")
def test_a_report_says_and_draws_what_the_curve_lacks(found: tuple[Campaign, Analysis]) -> None:
    """Of its figures that of the force is drawn, which no other test draws."""
    campaign, analysis = found
    files = analysis_report(campaign, analysis, figures="all")
    png = io.BytesIO()
    force_figure(analysis.fit.forces, analysis.problem.runs).savefig(png)
    assert len(png.getvalue()) > 10_000
    text = files["report.md"].decode()
    assert "## Discrepancy between curve and data" in text
    assert "figures/force.png" in files
    assert "means the average over this track" in text
    assert "an unmodelled force along the track and a free start" in text


OBSTACLES = {
    "robust": (
        {"run": KEY, "noise": INDEPENDENT[:-1] + ', derivative = "central", robust = "student-t"}'},
        16,
        "'robust'",
    ),
    "errors of x": (
        {"run": KEY, "noise": INDEPENDENT[:-1] + ', derivative = "central", sigma_x_m = 0.001}'},
        16,
        "errors of the positions",
    ),
    "scatter": (
        {
            "shared": KEY,
            "noise": '{sigma_x_m = 0.001, scatter = {prior = "half-normal", scale = 0.01}}',
        },
        5,
        "'scatter' that is inferred",
    ),
    "sigma": (
        {"shared": KEY, "noise": '{sigma_x_m = "0.001(1)"}'},
        5,
        "'sigma_x' that is inferred",
    ),
}

REFUSED = {
    "negative": ({"shared": "unmodelled_force = -0.1\n"}, 5, "is a share of the weight"),
    "more than the weight": ({"shared": "unmodelled_force = 2.0\n"}, 5, "is a share of the weight"),
    **OBSTACLES,
}


@pytest.mark.parametrize(("written", "line", "rule"), REFUSED.values(), ids=REFUSED)
def test_where_it_does_not_go_one_line_says_so(
    tmp_path: Path, written: dict[str, str], line: int, rule: str
) -> None:
    with pytest.raises(InputError, match=rf"c\.toml:{line}: 'unmodelled_force' .*{rule}"):
        body(tmp_path, **written)


@pytest.mark.parametrize(
    ("written", "rule"), [(written, rule) for written, _, rule in OBSTACLES.values()], ids=OBSTACLES
)
def test_where_nobody_asked_for_it_the_curve_is_taken_as_complete_and_the_reason_is_kept(
    tmp_path: Path, written: dict[str, str], rule: str
) -> None:
    run = body(tmp_path, noise=written["noise"]).problem(["r"]).runs[0]
    assert run.force == 0.0
    assert run.complete is not None
    assert rule in describe(run.complete)


def test_other_commands_refuse_it_where_it_is_stated(tmp_path: Path) -> None:
    campaign = wheel(tmp_path, KEY)
    place = (
        r"wheel\.toml:9: 'unmodelled_force' (cannot be combined with|is not supported by|does "
        r"not go with)"
    )
    assert [
        run.force for run in campaign.problem(["class-balanced_1", "class-balanced_2"]).runs
    ] == [0.02, 0.02]
    with pytest.raises(InputError, match=f"{place} a comparison"):
        campaign.noise_models("class-balanced_1")
    with pytest.raises(InputError, match=f"{place} estim energy"):
        campaign.require_complete(["class-balanced_1"], "estim energy")
    with pytest.raises(InputError, match=f"{place} estim calibrate"):
        campaign.require_draws(campaign.problem(["class-balanced_1"]), of_priors=True)


def test_a_joint_fit_has_forces_by_itself_and_other_commands_take_the_curve_as_complete(
    tmp_path: Path,
) -> None:
    campaign = wheel(tmp_path, "")
    campaign.require_complete(["class-balanced_1"], "estim energy")
    alone = campaign.problem(["class-balanced_1"])
    campaign.require_draws(alone, of_priors=True)
    together = campaign.problem(["class-balanced_1", "class-balanced_2"])
    energy = as_complete(alone, "estim energy")
    assert [run.force for run in (*alone.runs, *together.runs, *energy.runs)] == [
        0.02,
        0.02,
        0.02,
        0.0,
    ]
    assert "estim energy" in said(energy)
    assert fit_problem(energy, rng=np.random.default_rng(1)).forces == ()


@pytest.mark.slow
def test_a_run_that_cannot_be_linearised_is_fit_without_and_says_so_unless_a_force_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def at_rest(*_: object, **__: object) -> None:
        raise InputError("must be > 0 along the track", field="speed")

    white = fitted(body(tmp_path, shared=OFF))
    monkeypatch.setattr(unmodelled_force, "pose_forces", at_rest)
    fit = fitted(body(tmp_path))
    assert fit.forces == ()
    assert np.array_equal(fit.values, white.values)
    assert (
        said(fit.problem)
        == "the curve is assumed to be complete: an unmodelled force cannot be linearised: "
        "must be > 0 along the track"
    )
    with pytest.raises(
        InputError, match=r"c\.toml:5: 'unmodelled_force' cannot be linearised: must be > 0"
    ):
        fitted(body(tmp_path, shared=KEY))


def said(problem: Problem) -> str:
    """Why the curve of its first run is taken as complete."""
    assert problem.runs[0].complete is not None
    return describe(problem.runs[0].complete)
