"""What to measure next: expected standard deviations against closed forms, refits of changed
campaigns, and simulated campaigns.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from report_words import first_screen, words
from scipy import stats

from estim.calibration import posterior_draws
from estim.campaign import NewRun, load_campaign
from estim.cli.commands import cli
from estim.common import InputError, Quantity, Status
from estim.discrepancy import force_sizes
from estim.fitting import expected_information, fit_problem, information
from estim.model import Body, speed, turning_point
from estim.planning.candidates import MORE, OTHERWISE, Change, FurtherReadings, measured_better
from estim.planning.expected_uncertainty import sds_with, weigh
from estim.planning.halving import ways_to_halve
from estim.planning.planned_readings import CurveBasis
from estim.planning.planning import plan, targets_of
from estim.planning.rolling import RollingBasis, posed, rolling_basis
from estim.planning.suggestions import more_runs
from estim.reports.plan import plan_answers, plan_status, shown_options, value_alone

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

NOTHING = Change("as things are", OTHERWISE)
PAIR = ("heavy-02", "heavy-04")
LINE = """title = "A line"
kind = "synthetic"
[curve]
expression = "a + b*x"
x = {column = "x"}
y = {column = "y"}
u_y = 0.1
[curve.parameters]
a = {start = 0.0}
b = {start = 1.0}
[[runs]]
name = "line"
file = "line.csv"
"""


@pytest.fixture(scope="module")
def pair() -> RollingBasis:
    campaign = load_campaign(
        Path(__file__).resolve().parents[1] / "data" / "replica" / "campaign.toml"
    )
    problem = campaign.problem(PAIR)
    fit = fit_problem(problem, rng=np.random.default_rng(1), near=problem.start())
    return rolling_basis(campaign, PAIR, fit)


def line(folder: Path, more: str = "", text: str = LINE) -> Path:
    x = np.arange(10.0)
    y = 1.0 + 2.0 * x + 0.1 * np.random.default_rng(5).standard_normal(10)
    (folder / "line.csv").write_text(
        "x,y\n" + "".join(f"{a},{b}\n" for a, b in zip(x, y, strict=True))
    )
    (folder / "campaign.toml").write_text(text + more)
    return folder / "campaign.toml"


def changed(
    folder: Path, replica: Path, *, pairs: tuple[tuple[str, str], ...] = (), more: str = ""
) -> Path:
    """The replica's campaign with other text, beside links to its data."""
    text = (replica / "campaign.toml").read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / "runs").mkdir()
    for file in (replica / "runs").glob("*.csv"):
        (folder / "runs" / file.name).write_bytes(file.read_bytes())
    (folder / "theta_min.csv").write_bytes((replica / "theta_min.csv").read_bytes())
    (folder / "campaign.toml").write_text(text + more)
    return folder / "campaign.toml"


# as things are


@pytest.mark.slow
def test_foreseen_at_the_data_at_hand_is_what_the_fit_knows(pair: RollingBasis) -> None:
    """No code shared: the fit takes the force from its own mixture, the plan makes it anew from
    tracks and amplitudes.
    """
    fit, posed = pair.fit, pair.campaign.problem(PAIR)
    sizes = force_sizes(fit.posterior, fit.values)
    expected = expected_information(posed, fit.values, sizes)
    scale = np.sqrt(np.diag(fit.cov))
    there = np.linalg.inv(expected)
    # it has the speeds of the curve, the fit those of the data
    assert np.abs((there - fit.cov) / np.outer(scale, scale)).max() < 0.04
    assert np.abs(np.sqrt(np.diag(there)) / scale - 1.0).max() < 0.02
    without = expected_information(posed, fit.values, {})
    # without start and force it is another
    assert np.abs(np.sqrt(np.diag(np.linalg.inv(without))) / scale - 1.0).max() > 0.2


@pytest.mark.slow
@pytest.mark.slow
def test_draws_of_runs_that_share_a_force_come_from_its_parts(replica: Path) -> None:
    """A proposal that begins at the mode alone missed what a force leaves probable: after 4,000
    steps a chain had a tail effective sample size of 466.
    """
    runs = load_campaign(replica / "campaign.toml")
    problem = posed(runs, ["heavy-02", "heavy-04", "heavy-06"])
    with runs.placing(problem):
        fit = fit_problem(problem, rng=np.random.default_rng(1))
    assert fit.lacking
    draws, how, shortfall = posterior_draws(fit, 1000.0, np.random.default_rng(1))
    assert (how, shortfall) == ("importance sampling", "")
    assert len(draws) >= 1000


def test_without_errors_it_is_nearly_the_same(pair: RollingBasis) -> None:
    here = pair.outlook(NOTHING)
    assert here.problem.names == pair.fit.names
    assert np.sqrt(np.diag(np.linalg.inv(here.information))) == pytest.approx(
        np.sqrt(np.diag(pair.fit.cov)), rel=0.05
    )


# one thing at a time


@pytest.mark.slow
def test_a_better_protractor_is_what_a_campaign_that_states_it_gives(
    pair: RollingBasis, tmp_path: Path, replica: Path
) -> None:
    other = load_campaign(
        changed(
            tmp_path, replica, pairs=(('"1.10(40)"', '"1.10(10)"'), ('"3.69(40)"', '"3.69(10)"'))
        )
    )
    fit, here = pair.fit, pair.outlook(NOTHING)
    problem = other.problem(PAIR)
    sizes = force_sizes(fit.posterior, fit.values)
    stated = expected_information(problem, fit.values, sizes)
    plain = expected_information(pair.campaign.problem(PAIR), fit.values, sizes)
    k = fit.names.index("kappa[heavy]")
    truth = np.sqrt(np.linalg.inv(stated)[k, k] / np.linalg.inv(plain)[k, k])
    (target,) = targets_of(pair.campaign, fit.problem, ["kappa"])
    u = {name: np.radians(0.1) for name in fit.names if name.startswith("phi")}
    assert sds_with(here, u, [target])[0] / sds_with(here, {}, [target])[0] == pytest.approx(
        truth, rel=0.01
    )
    assert truth < 0.95


@pytest.mark.slow
def test_a_run_is_repeated_as_if_it_were_independent(pair: RollingBasis) -> None:
    """Where nothing but the readings is uncertain, n equal runs leave 1/sqrt(n): all priors taken
    away but that of kappa.
    """
    fit = pair.fit
    runs = tuple(NewRun(f"again-{i}", "heavy-04", {}) for i in range(3))
    there = pair.outlook(Change("", MORE, runs=runs))
    names = [
        name
        for name in there.problem.names
        if name.startswith(("theta0", "phi")) and "heavy-02" not in name
    ]
    known = dict.fromkeys([*names, "gamma[heavy]", "radius"], 1e-9)
    (kappa,) = targets_of(pair.campaign, fit.problem, ["kappa"])
    unforced = RollingBasis(pair.campaign, ("heavy-04",), _alone(pair), pair.release, {}, pair.ramp)
    known |= {"rolling_resistance": 1e-9}
    one, four = unforced.outlook(NOTHING), unforced.outlook(Change("", MORE, runs=runs))
    here, more = (
        {name: u for name, u in known.items() if name in look.problem.names} for look in (one, four)
    )
    assert sds_with(four, more, [kappa])[0] / sds_with(one, here, [kappa])[0] == pytest.approx(
        0.5, rel=0.02
    )


def _alone(pair: RollingBasis):
    problem = pair.campaign.problem(["heavy-04"])
    return fit_problem(problem, rng=np.random.default_rng(1))


@pytest.mark.slow
def test_more_of_everything_never_harms_and_better_is_better(pair: RollingBasis) -> None:
    targets = targets_of(pair.campaign, pair.fit.problem, ["kappa", "gamma"])
    here = pair.outlook(NOTHING)
    now = sds_with(here, {}, targets)
    for change in (
        Change("", OTHERWISE, frames=2.0),
        Change("", OTHERWISE, error=0.5),
        *measured_better(here.problem, ()),
    ):
        assert np.all(weigh(pair, change, targets, now).ratio <= 1.0 + 1e-3)
    worse = weigh(pair, Change("", OTHERWISE, error=3.0), targets, now)
    assert np.all(worse.ratio > 1.01)


@pytest.mark.slow
def test_another_particle_on_the_same_disk_shares_its_kappa(pair: RollingBasis) -> None:
    said = {"gamma": Quantity(0.28, 0.01), "phi": Quantity(0.1, 0.007)}
    there = pair.outlook(Change("", MORE, runs=(NewRun("new", "heavy-04", said),)))
    run = next(run for run in there.problem.runs if run.name == "new")
    assert run.arguments["kappa"] == "kappa[heavy]"
    assert run.arguments["gamma"] == "gamma[new]"
    assert there.values[there.problem.names.index("gamma[new]")] == 0.28
    assert there.values[there.problem.names.index("phi[new]")] == 0.1


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"phi": Quantity(np.radians(14.0))}, "does not start"),
        ({"theta0": Quantity(np.radians(5.0))}, "does not start"),
    ],
)
@pytest.mark.slow
def test_a_run_that_cannot_be_measured_is_said_and_not_ranked(
    pair: RollingBasis, said: dict[str, Quantity], why: str
) -> None:
    (kappa,) = targets_of(pair.campaign, pair.fit.problem, ["kappa"])
    option = weigh(
        pair, Change("", MORE, runs=(NewRun("new", "heavy-04", said),)), [kappa], np.array([1.0])
    )
    assert why in option.reason
    assert option.u.size == 0


SPEEDS = """title = "Speeds at positions"
kind = "synthetic"
[shared]
radius_m = 0.15
unmodelled_force = 0
noise = {model = "independent", sigma_v_m_s = 0.004}
[bodies.heavy]
gamma = "0.187(20)"
kappa = "0.45(10)"
[[runs]]
name = "a"
body = "heavy"
file = "a.csv"
phi_deg = "4.2(2)"
theta0_deg = "60.5(8)"
"""


def test_speeds_are_planned_only_where_the_body_comes(tmp_path: Path) -> None:
    """From 30° it does not climb 8.4°, since gamma sin 30° < sin 8.4°; from 60° it turns on the
    way.
    """
    body, x = Body(0.15, 0.187, 0.45), np.linspace(0.02, 0.42, 25)
    v = speed(x, body, phi=np.radians(4.0), theta0=np.radians(60.0))
    v = v + 0.004 * np.random.default_rng(3).standard_normal(x.size)
    rows = (f"{a:.4f},{b:.6f}\n" for a, b in zip(x, v, strict=True))
    (tmp_path / "a.csv").write_text("x_m,v_m_s\n" + "".join(rows))
    (tmp_path / "campaign.toml").write_text(SPEEDS)
    campaign = load_campaign(tmp_path / "campaign.toml")
    problem = campaign.problem(["a"])
    fit = fit_problem(problem, rng=np.random.default_rng(1), near=problem.start())
    basis = rolling_basis(campaign, ["a"], fit)
    (gamma,) = targets_of(campaign, problem, ["gamma"])
    tilt = Quantity(np.radians(8.4), np.radians(0.2))
    for release, starts in ((30.0, False), (60.0, True)):
        said = {"phi": tilt, "theta0": Quantity(np.radians(release), np.radians(0.8))}
        change = Change("", MORE, runs=(NewRun("new", "a", said),))
        option = weigh(basis, change, [gamma], np.array([1.0]))
        assert ("does not start" in option.reason) != starts
        assert option.u.size == (1 if starts else 0)
    new = next(run for run in basis.outlook(change).problem.runs if run.name == "new")
    turn = turning_point(body, phi=tilt.value, theta0=np.radians(60.0))
    assert 0.9 * turn < np.max(new.x) < 1.05 * turn


# curves of one's own


def test_readings_of_a_line_do_what_the_closed_form_says(tmp_path: Path) -> None:
    campaign = load_campaign(line(tmp_path))
    fit = fit_problem(campaign.problem(["line"]), rng=np.random.default_rng(1))
    basis = CurveBasis(campaign, ("line",), fit)
    (b,) = targets_of(campaign, fit.problem, ["b"])

    def closed(x: np.ndarray, u: float = 0.1) -> float:
        return float(u / np.sqrt(np.sum((x - x.mean()) ** 2)))

    x = np.arange(10.0)
    for change, expected in (
        (NOTHING, closed(x)),
        (
            Change("", MORE, readings=(FurtherReadings("line", 12.0, 3),)),
            closed(np.r_[x, 12.0, 12.0, 12.0]),
        ),
        (Change("", OTHERWISE, frames=2.0), closed(np.repeat(x, 2))),
        (Change("", OTHERWISE, error=0.5), closed(x, 0.05)),
    ):
        assert sds_with(basis.outlook(change), change.u, [b])[0] == pytest.approx(
            expected, rel=1e-6
        )


def test_additional_readings_share_an_error_with_each_other_alone(tmp_path: Path) -> None:
    """Where groups of readings share one: by generalised least squares, written out."""
    keys = 'u_y = 0.1\nerrors = {day = {kind = "zero_y", u = 0.3, groups = "day"}}\n'
    path = line(tmp_path, text=LINE.replace("u_y = 0.1\n", keys))
    x, day = np.arange(10.0), np.repeat([1.0, 2.0], 5)
    rows = zip(x, 1.0 + 2.0 * x, day, strict=True)
    (tmp_path / "line.csv").write_text("x,y,day\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows))
    campaign = load_campaign(path)
    fit = fit_problem(campaign.problem(["line"]), rng=np.random.default_rng(1))
    basis = CurveBasis(campaign, ("line",), fit)
    (b,) = targets_of(campaign, fit.problem, ["b"])
    further = Change("", MORE, readings=(FurtherReadings("line", 30.0, 4),))
    sds = []
    for group in (3.0, 2.0):  # their own, and that of the nearest
        at, of = np.r_[x, np.full(4, 30.0)], np.r_[day, np.full(4, group)]
        cov = 0.01 * np.eye(14) + 0.09 * (of[:, None] == of)
        rows_of_line = np.column_stack([np.ones(14), at])
        inverse = np.linalg.inv(rows_of_line.T @ np.linalg.solve(cov, rows_of_line))
        sds.append(float(np.sqrt(inverse[1, 1])))
    assert sds_with(basis.outlook(further), {}, [b])[0] == pytest.approx(sds[0], rel=1e-6)
    assert sds[1] < 0.9 * sds[0] or sds[1] > 1.1 * sds[0]


@pytest.mark.parametrize("stated", ['"5%"', '"5% of y"', "0.1", None])
def test_half_the_error_of_a_reading_halves_what_it_makes_uncertain(
    tmp_path: Path, stated: str | None
) -> None:
    """Also an error that is a share s of the curve f: its information is 1/(s f)^2 + 2/f^2."""
    text = LINE.replace("u_y = 0.1\n", f"u_y = {stated}\n" if stated else "")
    campaign = load_campaign(line(tmp_path, text=text))
    fit = fit_problem(campaign.problem(["line"]), rng=np.random.default_rng(1))
    basis = CurveBasis(campaign, ("line",), fit)
    targets = targets_of(campaign, fit.problem, ["a", "b"])
    now, half, quarter = (
        sds_with(basis.outlook(Change("", OTHERWISE, error=error)), {}, targets)
        for error in (1.0, 0.5, 0.25)
    )
    np.testing.assert_allclose([half / now, quarter / now], [[0.5] * 2, [0.25] * 2], rtol=0.01)
    if stated == '"5%"':
        x, named = np.arange(10.0), fit.problem.named(fit.values)
        f = np.ravel(named["a"]) + np.ravel(named["b"]) * x
        columns = np.array([np.ones(10), x]) / f
        for sds, share in ((now, 0.05), (half, 0.025), (quarter, 0.0125)):
            matrix = (1.0 / share**2 + 2.0) * columns @ columns.T
            exact = np.sqrt(np.diag(np.linalg.inv(matrix)))
            np.testing.assert_allclose(sds, exact, rtol=1e-4)


@pytest.mark.parametrize(
    ("noise", "prior"), [("", -1), ("u_y = 0.001\njitter = true\n", 0)], ids=["size", "jitter"]
)
def test_an_error_that_is_inferred_has_the_size_that_the_residuals_leave(
    tmp_path: Path, noise: str, prior: int
) -> None:
    """The median given them, with the prior size^prior: S/size^2 is chi-squared.  At the mode it
    would be smaller by a fifth.
    """
    text = LINE.replace("u_y = 0.1\n", noise)
    found = plan(load_campaign(line(tmp_path, text=text)), ["line"], seed=1)
    x, y = np.loadtxt(tmp_path / "line.csv", delimiter=",", skiprows=1, unpack=True)
    columns = np.column_stack([np.ones(10), x])
    squares = np.linalg.lstsq(columns, y)[1]
    size = np.sqrt(squares / stats.chi2.median(8 - 1 - prior))
    sds = size * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    assert found.now == pytest.approx(sds, rel=0.03)  # 1 % by the draws


def test_the_best_place_for_the_slope_of_a_line_is_its_far_end(tmp_path: Path) -> None:
    campaign = load_campaign(line(tmp_path, '[plan]\nfor = ["b"]\n'))
    found = plan(campaign, ["line"], seed=1)
    (along,) = found.along
    assert along.x[np.argmin(along.ratio[0])] == along.x.max() > 9.0
    assert np.argmax(along.ratio[0]) in (
        np.argmin(np.abs(along.x - 4.5)),
        np.argmin(np.abs(along.x - 4.5)) - 1,
    )
    assert found.now == pytest.approx(found.drawn, rel=0.1)
    assert plan_status(found)[0].ok
    assert plan_answers(found)[0].startswith("u(b)")
    short = replace(found, shortfall="R-hat 1.2 is not below 1.02")
    assert plan_status(short) == (Status.NOT_CONVERGED, ["R-hat 1.2 is not below 1.02"])


def test_a_row_outside_the_window_may_lie_where_the_curve_has_no_value(tmp_path: Path) -> None:
    """x = 0 has no logarithm; no reading is proposed there."""
    text = LINE.replace("a + b*x", "a + b*x + 0*log(x)") + "[curve.window]\nmin = 1.0\n"
    found = plan(load_campaign(line(tmp_path, text=text)), ["line"], seed=1)
    x = np.arange(1.0, 10.0)
    exact = np.linalg.inv(np.array([[9.0, x.sum()], [x.sum(), x @ x]]) / 0.1**2)
    assert found.now == pytest.approx(np.sqrt(np.diag(exact)), rel=1e-6)
    assert found.along[0].x.min() > 0.0


# what is asked for


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            '[plan]\nfor = ["kapa"]\n',
            r"campaign\.toml:15: 'for' must name an unknown of these runs",
        ),
        (
            '[[plan.runs]]\nlike = "line"\n',
            r"campaign\.toml:\d+: 'plan\.runs' is for a rolling body",
        ),
        (
            "[[plan.readings]]\nx = 1.0\nn = 0\n",
            r"campaign\.toml:16: 'n' must be >= 1 and <= 10000: 0",
        ),
        ('[[plan.readings]]\nx = 1.0\nrun = "no"\n', "must name one of the runs"),
        ("[[plan.change]]\nu = {q = 0.1}\n", "is not an unknown of these runs"),
        ("[[plan.change]]\nreach = 2.0\n", "is for rolling bodies"),
        ("[[plan.change]]\nframes = 1000.0\n", "'frames' must be >= 0.01 and <= 100: 1000"),
        ("[[plan.change]]\nu = {b = -0.1}\n", "'b' must be > 0: -0.1"),
        ("[[plan.change]]\n", "changes nothing"),
        ("[plan]\nframes = 2\n", "is not a known key"),
    ],
)
def test_mistakes_in_a_plan_are_told_with_their_line(tmp_path: Path, more: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        plan(load_campaign(line(tmp_path, more)), ["line"], seed=1)


@pytest.mark.parametrize("name", ["muon_binned", "alpha_counts", "muon"])
def test_there_are_no_plans_for_counts(name: str) -> None:
    campaign = load_campaign(Path(__file__).resolve().parents[1] / f"data/gallery/{name}.toml")
    with pytest.raises(
        InputError, match=r"toml:\d+: 'noise' is that of counts or of single events"
    ):
        plan(campaign, list(campaign.tables), seed=1)


def test_what_a_curve_lacks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="estim plan"):
        plan(
            load_campaign(
                line(tmp_path, text=LINE.replace("u_y = 0.1", "u_y = 0.1\ndeviation = 0.1"))
            ),
            ["line"],
            seed=1,
        )


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('[[plan.runs]]\nlike = "heavy-99"\n', "must name one of the runs"),
        (
            '[[plan.runs]]\nlike = "heavy-04"\nphi_deg = {prior = "uniform", low = 0.0, '
            "high = 1.0}\n",
            "must be a number or",
        ),
        ('[[plan.runs]]\nlike = "heavy-04"\nphi_deg = 95.0\n', "outside what is possible"),
        ("[[plan.change]]\nu = {phi_deg = 0.5}\n", "no better than what is stated"),
        ("[[plan.readings]]\nx = 1.0\n", "is for a curve of your own"),
    ],
)
def test_mistakes_in_a_plan_for_a_body_are_told_with_their_line(
    tmp_path: Path, replica: Path, more: str, said: str
) -> None:
    with pytest.raises(InputError, match=rf"campaign\.toml:\d+: .*{said}"):
        plan(load_campaign(changed(tmp_path, replica, more=more)), ["heavy-04"], seed=1)


ASKED = """
[plan]
for = ["kappa"]
built_in = false
[[plan.runs]]
like = "heavy-04"
phi_deg = "8.0(2)"
theta0_deg = 75.0
[[plan.runs]]
like = "heavy-04"
phi_deg = 14.0
[[plan.change]]
name = "a better protractor"
u = {phi_deg = 0.1}
"""


def test_a_change_of_the_readings_is_weighed_once_for_all_targets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = load_campaign(line(tmp_path))
    fit = fit_problem(campaign.problem(["line"]), rng=np.random.default_rng(1))
    basis, asked = CurveBasis(campaign, ("line",), fit), []
    here, targets = basis.outlook(NOTHING), fit.problem.parameters
    now, plain = sds_with(here, {}, targets), CurveBasis.outlook

    def counted(self: CurveBasis, change: Change) -> object:
        asked.append((change.frames, change.error))
        return plain(self, change)

    monkeypatch.setattr(CurveBasis, "outlook", counted)
    both = ways_to_halve(basis, here, targets, now, [])
    assert len(asked) == len(set(asked)) > 2
    for k, target in enumerate(targets):
        (alone,) = ways_to_halve(basis, here, [target], now[[k]], [])
        assert [vars(way) for way in both[k].ways] == [vars(way) for way in alone.ways]


def test_what_the_data_refuse_is_no_ground_for_a_plan(tmp_path: Path) -> None:
    """A line through a parabola: stated errors say nothing of what additional readings would do."""
    x = np.linspace(0.0, 5.0, 30)
    y = 1.0 + x**2 + 0.05 * np.random.default_rng(3).standard_normal(30)
    (tmp_path / "r.csv").write_text(
        "x,y\n" + "".join(f"{a},{b}\n" for a, b in zip(x, y, strict=True))
    )
    text = (
        'title = "t"\nkind = "synthetic"\n[curve]\nexpression = "a + b*x{}"\nx = "x"\ny = '
        '"y"\nu_y = 0.05\n[curve.parameters]\n'
    )
    text += 'a = {{start = 1.0}}\nb = {{start = 1.0}}\n{}[[runs]]\nname = "r"\nfile = "r.csv"\n'
    for more, known, code in (("", "", 3), (" + c*x**2", "c = {start = 1.0}\n", 0)):
        (tmp_path / "campaign.toml").write_text(text.format(more, known))
        done = CliRunner().invoke(
            cli,
            [
                "plan",
                str(tmp_path / "campaign.toml"),
                "--out",
                str(tmp_path / "out"),
                "--figures",
                "none",
            ],
        )
        assert done.exit_code == code, done.output
        assert ("plan: poor-fit" in done.output) is bool(code)
        assert ("would be halved" in done.output) is not bool(code)
        record = json.loads((tmp_path / "out" / "plan.json").read_text())
        assert (record["status"], record["answers"] == []) == (
            ("poor-fit", True) if code else ("ok", False)
        )
        assert (
            "first look at the result of `estim fit` for"
            in (tmp_path / "out" / "report.md").read_text()
        ) is bool(code)


@pytest.mark.slow
def test_the_command_ranks_what_was_asked_for_and_says_where_linear_theory_fails(
    tmp_path: Path, replica: Path, unrendered: None
) -> None:
    """One run by itself: the posterior of kappa has a long tail, which linear theory does not
    know.
    """
    path = changed(tmp_path, replica, more=ASKED)
    done = CliRunner().invoke(
        cli, ["plan", str(path), "--run", "heavy-04", "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 3, done.output
    assert "plan: methods-disagree" in done.output
    record = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert record["schema"] == "estim-plan/2"
    assert (
        record["targets"]["kappa[heavy]"]["u_linear"]
        < 0.85 * record["targets"]["kappa[heavy]"]["u_drawn"]
    )
    assert [option["asked"] for option in record["options"]] == [True, True]
    ratios = [option["ratio"]["kappa[heavy]"] for option in record["options"]]
    assert ratios == sorted(ratios)
    assert [one["what"] for one in record["cannot_be_measured"]] == ["a run of heavy at φ = 14°"]
    report = (tmp_path / "out" / "report.md").read_text()
    assert "a better protractor (φ[heavy-04] to ±0.1° (from 0.4°))" in report
    assert "the sampled posterior gives" in report
    assert "figures/ratios.png" in first_screen(report)
    assert len(words(first_screen(report))) < 120
    assert (tmp_path / "out" / "figures" / "ratios.png").exists()


@pytest.mark.parametrize(
    ("value", "u", "said"),
    [(0.753, 0.14, "0.75"), (432.1, 38.0, "4.3×10²"), (-213.0, 59.0, "−2.1×10²")],
)
def test_a_value_is_shown_whole_without_its_uncertainty(value: float, u: float, said: str) -> None:
    """That of Hubble's 432 ± 38 km/s/Mpc was shown as '(4.3'."""
    assert value_alone(value, u) == said


@pytest.mark.slow
def test_of_the_runs_that_are_tried_the_best_of_each_kind_are_shown(pair: RollingBasis) -> None:
    (kappa,) = targets_of(pair.campaign, pair.fit.problem, ["kappa"])
    here = pair.outlook(NOTHING)
    now = sds_with(here, {}, [kappa])
    changes = more_runs(pair.campaign, pair.fit)
    tilts = {
        change.runs[0].quantities["phi"].value
        for change in changes
        if "phi" in change.runs[0].quantities
    }
    assert len(tilts) > 2
    weighed = [weigh(pair, change, [kappa], now) for change in changes[:8]]
    options = sorted(
        (option for option in weighed if not option.reason), key=lambda option: option.score
    )
    shown = shown_options(options)
    assert shown[0] is options[0]
    assert 1 < len(shown) < len(options)


# do plans come true?


@pytest.mark.statistics
@pytest.mark.slow
def test_what_is_foreseen_is_achieved(pair: RollingBasis) -> None:
    """Scatter of ten posterior means and their standard deviations over the predicted one (200:
    docs/planning.md).
    """
    from plan_predictions import achieved, changes_of

    targets, trials = targets_of(pair.campaign, pair.fit.problem, ["kappa"]), 10
    change = changes_of(pair)["run"]
    found = achieved(pair, change, targets, trials=trials, seed=3)
    assert found.failed == 0
    assert found.sd[0] == pytest.approx(1.0, abs=0.1)
    assert abs(found.scatter[0] - 1.0) < 3.0 / np.sqrt(2.0 * trials)
    # a plan that takes the masses as exact is found out
    wrong = (
        sds_with(pair.outlook(change), dict(change.u) | {"gamma[heavy]": 1e-6}, targets)
        / found.predicted
    )
    assert found.sd[0] / wrong[0] > 1.3


def test_the_information_of_a_curve_is_that_of_its_posterior(tmp_path: Path) -> None:
    campaign = load_campaign(line(tmp_path))
    fit = fit_problem(campaign.problem(["line"]), rng=np.random.default_rng(1))
    expected = expected_information(fit.problem, fit.values, {})
    assert np.allclose(expected, information(fit.posterior, fit.values))


def test_the_values_of_the_present_experiment_have_their_units(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("t (s),s (mm)\n1,2.1\n2,4.0\n3,6.1\n4,7.9\n")
    (tmp_path / "c.toml").write_text(
        'title = "a"\nkind = "measured"\n[curve]\nexpression = "a + b*t"\nu_y = 0.1\n'
        'x = {column = "t (s)", name = "t", unit = "s"}\n'
        'y = {column = "s (mm)", name = "s", unit = "mm"}\n'
        '[curve.parameters]\na = {}\nb = {}\n[[runs]]\nname = "r"\nfile = "r.csv"\n'
    )
    out = str(tmp_path / "out")
    CliRunner().invoke(cli, ["plan", str(tmp_path / "c.toml"), "--out", out, "--figures", "none"])
    report = (tmp_path / "out" / "report.md").read_text()
    assert re.search(r"\| b \| 1\.9\d\smm/s \| 0\.0\d+\smm/s \|", report), report


@pytest.mark.parametrize(
    ("language", "told"),
    [
        (
            "en",
            ["additional readings at T = ", " K, outside", "would be halved by 4 times as many"],
        ),
        ("es", ["lecturas más en T = ", " K, fuera", "se reduciría a la mitad con 4 veces"]),
    ],
)
def test_a_further_reading_has_the_name_and_the_unit_of_its_axis(
    tmp_path: Path, language: str, told: list[str]
) -> None:
    x = np.linspace(300.0, 400.0, 30)
    y = 2.0 * x + 5.0 + 0.05 * np.random.default_rng(3).standard_normal(30)
    (tmp_path / "r.csv").write_text(
        "T (K),y\n" + "".join(f"{a},{b}\n" for a, b in zip(x, y, strict=True))
    )
    (tmp_path / "c.toml").write_text(
        'title = "t"\nkind = "synthetic"\n[curve]\nexpression = "a + b*T"\n'
        'x = {column = "T (K)", name = "T", unit = "K"}\ny = "y"\nu_y = 0.05\n'
        '[curve.parameters]\na = {}\nb = {}\n[[runs]]\nname = "r"\nfile = "r.csv"\n'
    )
    arguments = ["plan", str(tmp_path / "c.toml"), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(cli, [*arguments, "--figures", "none", "--lang", language])
    assert all(words in done.output for words in told), done.output
