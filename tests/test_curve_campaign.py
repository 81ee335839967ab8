"""Campaigns with a [curve] table: what is read, what is refused, what the report says; and two
experiments recorded by the program Tracker.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from stand_ins import DOWN, SLOWING, frequency

from estim.campaign import Campaign, load_campaign
from estim.cli.commands import cli
from estim.common import InputError, spoken
from estim.fitting.optimum import fit_optimum
from estim.pipeline import analyse
from estim.sampling.chain import Target
from estim.words import describe

CAMPAIGN = """title = "Discharge of a capacitor"
kind = "synthetic"
[curve]
expression = "U0*exp(-x/tau) + offset"
x = {column = "t_s", name = "time t", unit = "s"}
y = {column = "u_V", name = "voltage U", unit = "V"}
u_y = 0.02
[curve.parameters]
U0 = {start = 1.0, unit = "V", meaning = "voltage at the start"}
tau = {start = 1.0, low = 0.0, unit = "s", meaning = "time constant"}
offset = "0.00(1)"
[[runs]]
name = "first"
file = "first.csv"
[[runs]]
name = "second"
file = "second.csv"
[runs.parameters]
U0 = {start = 2.0}
"""
TRUTH = {"U0[first]": 5.0, "U0[second]": 3.0, "tau": 4.0, "offset": 0.005}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)
    for name, start in (("first", 5.0), ("second", 3.0)):
        t = np.linspace(0.0, 10.0, 26)
        u = start * np.exp(-t / 4.0) + 0.005 + 0.02 * rng.standard_normal(t.size)
        rows = "\n".join(f"{a:.3f},{b:.6f},0.02" for a, b in zip(t, u, strict=True))
        (tmp_path / f"{name}.csv").write_text(f"t_s,u_V,_u_V\n{rows}\n")
    return tmp_path


def load(folder: Path, text: str = CAMPAIGN) -> Campaign:
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder / "campaign.toml")


def test_where_a_parameter_stands_is_where_it_is_one_unknown(folder: Path) -> None:
    campaign = load(folder)
    # shared first
    assert campaign.problem(["first", "second"]).names == (
        "tau",
        "offset",
        "U0[first]",
        "U0[second]",
    )
    assert campaign.problem(["first"]).names == ("U0", "tau", "offset")
    assert campaign.problem(["second"]).names == ("U0[second]", "tau", "offset")
    problem = campaign.problem(["first", "second"])
    assert {p.name: (p.unit, p.meaning) for p in problem.parameters}["U0[second]"] == (
        "V",
        "voltage at the start",
    )
    assert problem.runs[0].x_label == "time t (s)"


def test_a_joint_fit_recovers_what_was_put_in(folder: Path, rng: np.random.Generator) -> None:
    fit = fit_optimum(load(folder).problem(["first", "second"]), rng=rng)
    pulls = [
        (value - TRUTH[name]) / sd
        for name, value, sd in zip(fit.names, fit.values, fit.sds, strict=True)
    ]
    assert np.max(np.abs(pulls)) < 4.0
    assert 1e-3 < fit.p_value < 1 - 1e-3
    too_small = load(folder, CAMPAIGN.replace("u_y = 0.02", "u_y = 0.01"))
    assert fit_optimum(too_small.problem(["first", "second"]), rng=rng).p_value < 1e-3


def test_correlated_errors_of_one_run_do_not_go_with_a_jitter_of_another(folder: Path) -> None:
    """It ended in a traceback: a singular matrix."""
    mixed = CAMPAIGN.replace('file = "first.csv"', 'file = "first.csv"\ncorrelated = true')
    mixed = mixed.replace('file = "second.csv"', 'file = "second.csv"\njitter = true')
    campaign = load(folder, mixed)
    with pytest.raises(InputError, match=r":15: 'correlated' .* fit the runs one by one"):
        campaign.problem(["first", "second"])
    assert campaign.problem(["first"]).runs[0].lacks is not None


@pytest.mark.parametrize(
    ("u_y", "names", "values"),
    [
        ("", ("sigma_y[first]",), None),
        ('u_y = "0.020(5)"', ("sigma_y",), None),
        ('u_y = {prior = "half-normal", scale = 0.1}', ("sigma_y",), None),
        ('u_y = {column = "s"}', (), 0.02),
    ],
)
def test_the_size_of_the_errors_is_stated_or_inferred(
    folder: Path, u_y: str, names: tuple[str, ...], values: float | None
) -> None:
    for name in ("first", "second"):
        path = folder / f"{name}.csv"
        if "column" in u_y:
            path.write_text(path.read_text().replace("_u_V", "s"))
    problem = load(folder, CAMPAIGN.replace("u_y = 0.02", u_y)).problem(["first"])
    assert problem.names[3:] == names
    if values is not None:
        np.testing.assert_array_equal(problem.runs[0].noise.reading_gain(), values)
    else:
        fit = fit_optimum(problem, rng=np.random.default_rng(1))
        assert 0.012 < fit.values[3] < 0.03


@pytest.mark.parametrize("u_y", ['"-0.02(1)"', '"0.00(1)"', "-0.02"])
def test_errors_of_no_size_are_refused_where_they_stand(folder: Path, u_y: str) -> None:
    with pytest.raises(InputError, match="'u_y' must be > 0"):
        load(folder, CAMPAIGN.replace("u_y = 0.02", f"u_y = {u_y}")).problem(["first"])


def test_a_window_leaves_rows_out_and_says_so(folder: Path) -> None:
    run = (
        load(folder, CAMPAIGN.replace("u_y = 0.02", "u_y = 0.02\nwindow = {min = 1.0, max = 9.0}"))
        .problem(["first"])
        .runs[0]
    )
    assert (run.x.min(), run.x.max()) == (1.2, 8.8)
    assert [describe(why) for why in run.excluded] == ["6 outside the stated window"]
    assert run.excluded_points.shape == (6, 2)


def test_units_of_axes_are_those_of_the_headers_where_none_is_stated(folder: Path) -> None:
    for name in ("first", "second"):
        file = folder / f"{name}.csv"
        file.write_text(file.read_text().replace("t_s,u_V", "t [s],U [V]"))
    text = re.sub(', unit = "(s|V)"|, name = "[^"]*"', "", CAMPAIGN)
    text = text.replace("t_s", "t [s]").replace("u_V", "U [V]")
    problem = load(folder, text).problem(["first"])
    (run,) = problem.runs
    assert (run.x_name, run.x_unit, run.y_name, run.y_unit) == ("t", "s", "U", "V")
    assert [p.unit for p in problem.parameters] == ["V", "s", "V"]


def test_an_exact_parameter_is_no_unknown(folder: Path) -> None:
    text = CAMPAIGN.replace('offset = "0.00(1)"', "offset = 0.005")
    run = load(folder, text).problem(["first"]).runs[0]
    assert run.arguments["offset"] == 0.005
    text = CAMPAIGN.replace('offset = "0.00(1)"', 'offset = {value = "0.00(1)", unit = "V"}')
    assert load(folder, text).problem(["first"]).parameters[2].unit == "V"


def test_shared_errors_are_one_parameter_of_all_runs(
    folder: Path, rng: np.random.Generator
) -> None:
    text = CAMPAIGN.replace(
        "u_y = 0.02", 'u_y = 0.02\nerrors = {scale_y = 0.03, clock = {kind = "scale_x", u = 0.01}}'
    )
    problem = load(folder, text).problem(["first", "second"])
    assert problem.names[-2:] == ("scale_y", "clock")
    fits = [
        fit_optimum(posed, rng=rng)
        for posed in (problem, load(folder).problem(["first", "second"]))
    ]
    sds, alone = (dict(zip(fit.names, fit.sds / np.abs(fit.values), strict=True)) for fit in fits)
    assert sds["U0[first]"] == pytest.approx(np.hypot(0.03, alone["U0[first]"]), rel=1e-2)
    assert sds["tau"] == pytest.approx(np.hypot(0.01, alone["tau"]), rel=1e-2)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            '"U0*exp(-x/tau) + offset"',
            '"U0*exp(-x/tau) + open(1)"',
            r":4: 'expression' calls 'open'",
        ),
        ('"U0*exp(-x/tau) + offset"', '"x.__class__"', r":4: 'expression' must not reach"),
        (
            '"U0*exp(-x/tau) + offset"',
            '"U0*exp(-x/tau) + c + offset"',
            r":8: 'c' is missing for run 'first'",
        ),
        ("tau = {start", "lambda_ = {start", r":10: 'lambda_' is not in the formula"),
        ("low = 0.0", "low = 3.0", r":10: 'tau' 'start' must lie within"),
        ("low = 0.0", "high = 3.0, low = 4.0", r":10: 'tau' 'low' must be below"),
        ("start = 1.0, low", "sd = 1.0, low", r":10: 'tau' 'sd' requires a 'prior'"),
        (
            "start = 1.0, low",
            "stat = 1.0, low",
            r":10: 'stat' is not a known key here \(did you mean 'start'",
        ),
        (
            "u_y = 0.02",
            'noise = {model = "poisson", scatter = 0.1}',
            r":7: 'scatter' is not a known key here .model = .poisson..$",
        ),
        (
            "u_y = 0.02",
            'noise = {model = "poisson", bin = 0.1}',
            r":7: 'bin' is not a known key here .model = .poisson.. \(did you mean 'bins'\?\)$",
        ),
        (
            "u_y = 0.02",
            "window = {minn = 0.1}",
            r":7: 'minn' is not a known key here \(did you mean 'min'\?\)$",
        ),
        ("u_y = 0.02", "u_y = -0.02", r":7: 'u_y' must be > 0"),
        ("u_y = 0.02", 'u_y = {column = "none"}', r"first.csv:1: '.*' is"),
        ("u_y = 0.02", "u_y = {mean = 1.0}", r":7: 'u_y' needs a 'prior' or a 'column'"),
        (
            "u_y = 0.02",
            'u_y = {column = "s", prior = "normal", mean = 1.0, sd = 0.1}',
            r":7: 'u_y' must be a 'column' or have a 'prior', not both",
        ),
        (
            "u_y = 0.02",
            'u_y = 0.02\nu_x = {column = "s", low = 0.1}',
            r":8: 'u_x' must be a 'column' or have a 'prior'",
        ),
        ("u_y = 0.02", "u_x = 0.02", r":7: 'u_x' needs a known u_y beside it"),
        ("u_y = 0.02", "u_y = 0.02\nu_x = -1.0", r":8: 'u_x' must be > 0: -1\.0"),
        ("u_y = 0.02", "errors = {zero = 0.1}", r"'zero' 'kind' must be one of"),
        ("u_y = 0.02", "errors = {zero_y = -0.1}", r"'zero_y' 'u' must be > 0"),
        (
            "u_y = 0.02",
            "window = {min = 9.0, max = 1.0}",
            r":7: 'window' must have 'min' below 'max': min = 9\.0, max = 1\.0",
        ),
        (
            "u_y = 0.02",
            "window = {min = nan}",
            r":7: 'window' must have 'min' below 'max': min = nan, max = inf",
        ),
        (
            'offset = "0.00(1)"',
            "offset = true",
            r":11: 'offset' must be a number or text or a table, not true or false",
        ),
        (
            "u_y = 0.02",
            "errors = {zero_y = true}",
            r":7: 'zero_y' must be a number or a table, not true or false",
        ),
        (
            "U0 = {start = 2.0}",
            "U0 = [2.0]",
            r":19: 'U0' must be a number or text or a table, not a list",
        ),
        ("u_y = 0.02", "window = {min = 9.5}", r"'window' must leave between 3"),
        ('"t_s"', '"time"', r"first.csv:1: 'time' is missing \(the header has t_s, u_V"),
        ('"t_s"', '"t"', r"first.csv:1: 't' is missing \(the header has t_s, u_V"),
        (
            '"U0*exp(-x/tau) + offset"',
            '"U0*exp(-time/tau) + t*offset"',
            r":4: 'expression' must call its variable x, .* 't_s' here: write x for t",
        ),
        (
            '"U0*exp(-x/tau) + offset"',
            '"U0*exp(-T_S/tau) + offset"',
            r":4: 'expression' must call its variable x, .*: write x for T_S",
        ),
        ("tau = {start", "t = {start = 1.0}\ntau = {start", r":10: 't' is not in the formula"),
        ('"u_V"', '"t_s"', r"'y' must name another column"),
        ('unit = "s", meaning', 'unit = "$s$", meaning', r":10: 'tau' must have a short unit"),
        ("first.csv", "none.csv", r"campaign\.toml:\d+: 'file' cannot be found .*none.csv"),
        (
            '[[runs]]\nname = "first"',
            '[shared]\ng = 9.81\n[[runs]]\nname = "first"',
            r":12: 'shared' cannot be combined with a \[curve\] table",
        ),
        ('name = "second"', 'name = "first"', r"'name' must be unique"),
    ],
)
def test_mistakes_are_named_with_their_place(folder: Path, old: str, new: str, says: str) -> None:
    assert old in CAMPAIGN
    with pytest.raises(InputError, match=says) as caught:
        load(folder, CAMPAIGN.replace(old, new, 1))
    assert "\n" not in str(caught.value)


def only(folder: Path, formula: str, parameters: str, u_y: str = "0.02") -> Campaign:
    """The first run alone, with another formula."""
    head = (
        CAMPAIGN.split("[curve.parameters]")[0]
        .replace("U0*exp(-x/tau) + offset", formula)
        .replace("u_y = 0.02", f"u_y = {u_y}")
    )
    return load(
        folder,
        f'{head}[curve.parameters]\n{parameters}\n[[runs]]\nname = "first"\nfile = "first.csv"\n',
    )


def test_a_parameter_must_not_be_called_like_the_unknown_error_of_y(folder: Path) -> None:
    parameters = "sigma_y = {start = 1.0}\nb = {start = 0.0}"
    with pytest.raises(
        InputError,
        match=r":9: 'sigma_y' is the name of the standard deviation of y, which is unknown here",
    ):
        only(folder, "sigma_y*x + b", parameters, u_y='"0.10(2)"')
    assert only(folder, "sigma_y*x + b", parameters).problem(["first"]).names == ("sigma_y", "b")


def test_names_are_written_as_python_reads_them(folder: Path) -> None:
    micro, mu = "\u00b5", "\u03bc"
    assert only(
        folder, f"{micro}*x + b", f'"{micro}" = {{start = 1.0}}\nb = {{start = 0.0}}'
    ).problem(["first"]).names == (mu, "b")
    with pytest.raises(InputError, match=r":9: '\u03bc' 'start' must lie within"):
        only(folder, f"{mu}*x", f'"{micro}" = {{start = 1.0, low = 2.0}}')
    with pytest.raises(InputError, match="is the same name as another in a formula"):
        only(
            folder,
            f"{micro}*x + b",
            f'"{micro}" = {{start = 1.0}}\n"{mu}" = {{start = 1.0}}\nb = {{start = 0.0}}',
        )


@pytest.mark.parametrize("formula", ["a/x + b", "a*log(x) + b", "b + where(x > 0, a, a/x)"])
def test_a_row_at_which_the_curve_is_not_finite_is_named(folder: Path, formula: str) -> None:
    campaign = only(folder, formula, "a = {start = 1.0}\nb = {start = 0.0}")
    with pytest.raises(
        InputError,
        match=r"first\.csv:2: 't_s' is where the curve is not finite, at the start and around: "
        r".*: 0\.0$",
    ):
        analyse(campaign, ["first"], seed=1, target=Target(max_step=50))


def test_a_curve_that_is_finite_nowhere_is_refused_with_the_file(folder: Path) -> None:
    with pytest.raises(
        InputError, match=r"campaign\.toml:8: 'start' gives a curve that is not finite at the data"
    ):
        analyse(
            only(folder, "log(-a**2)*x", "a = {start = 1.0}"),
            ["first"],
            seed=1,
            target=Target(max_step=50),
        )


@pytest.mark.parametrize(
    ("command", "parameters", "says"),
    [
        ("fit", "a = 3.0", r"campaign\.toml:8: 'run first' leaves nothing to fit"),
        (
            "calibrate",
            "a = {start = 3.0}",
            r"campaign\.toml:9: 'a' is flat without limits, so that no true value",
        ),
        (
            "calibrate",
            "a = {start = 3.0, low = 0.0}",
            r"campaign\.toml:9: 'a' is flat without limits",
        ),
    ],
)
def test_commands_say_which_parameter_is_in_the_way(
    folder: Path, command: str, parameters: str, says: str
) -> None:
    only(folder, "a", parameters)
    ran = CliRunner().invoke(
        cli, [command, str(folder / "campaign.toml"), "--out", str(folder / "out")]
    )
    assert isinstance(ran.exception, InputError)
    assert re.search(says, str(ran.exception))


def test_the_fitted_values_are_repeated_where_no_prior_can_be_drawn_from(folder: Path) -> None:
    only(folder, "U0*exp(-x/tau)", "U0 = {start = 3.0}\ntau = {start = 2.0, low = 0.0}")
    choices = ("--what", "coverage", "--simulations", "20", "--jobs", "1", "--figures", "none")
    ran = CliRunner().invoke(
        cli, ["calibrate", str(folder / "campaign.toml"), "--out", str(folder / "out"), *choices]
    )
    assert ran.exit_code == 0, ran.output
    assert "the 68 % interval of tau covered" in ran.output


@pytest.mark.parametrize("command", ["energy", "reanalyse", "line"])
def test_commands_for_rolling_bodies_say_that_there_is_none(folder: Path, command: str) -> None:
    load(folder)
    ran = CliRunner().invoke(
        cli, [command, str(folder / "campaign.toml"), "--out", str(folder / "out")]
    )
    assert isinstance(ran.exception, InputError)
    assert "has no rolling body" in str(ran.exception)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_command_line_writes_a_report_about_the_curve(folder: Path) -> None:
    load(folder)
    ran = CliRunner().invoke(
        cli,
        [
            *("fit", str(folder / "campaign.toml"), "--run", "first"),
            *("--figures", "all", "--out", str(folder / "out")),
        ],
    )
    assert ran.exit_code == 0, ran.output
    text = (folder / "out" / "report.md").read_text().replace("\u00a0", " ")
    result = json.loads((folder / "out" / "result.json").read_text())
    assert result["status"] == "ok"
    assert result["formula"] == "U0*exp(-x/tau) + offset"
    assert result["turning_point"] == {}
    assert "| tau | time constant |" in text
    assert "voltage U (V) against time t (s)" in text
    for word in ("turning point", "speed", "mass", "radian", "frame"):
        assert word not in text, word
    drawn = {"budget", "corner", "directions", "phase", "profiles", "residuals", "traces"}
    assert {path.stem for path in (folder / "out" / "figures").iterdir()} == drawn


def numbers(path: Path, columns: tuple[int, ...]) -> np.ndarray:
    """Rows of a text export of Tracker in which all `columns` hold numbers; decimal commas become
    points.
    """
    delimiter = ";" if path.suffix == ".csv" else ","
    rows = []
    for line in path.read_text().splitlines()[2:]:
        cells = [cell.replace(",", ".") for cell in line.split(delimiter)]
        if len(cells) > max(columns) and all(re.fullmatch(r"[-+.\dE]+", cells[i]) for i in columns):
            rows.append([float(cells[i]) for i in columns])
    return np.array(rows)


def measured(folder: Path, table: np.ndarray, text: str) -> Campaign:
    np.savetxt(folder / "run.csv", table, delimiter=",", header="t_s,y_m", comments="")
    return load(folder, text)


FALL = """title = "Ball in a viscous liquid"
kind = "measured"
[curve]
expression = "y0 + v*x + (v0 - v)*tau*(1 - exp(-x/tau))"
x = {column = "t_s", name = "time", unit = "s"}
y = {column = "y_m", name = "height", unit = "m"}
[curve.parameters]
y0 = {start = 0.0, unit = "m"}
v = {start = -1.0, unit = "m/s", meaning = "terminal velocity"}
v0 = {start = -1.0, unit = "m/s"}
tau = {start = 0.1, low = 0.0, high = 20.0, unit = "s"}
[[runs]]
name = "b3"
file = "run.csv"
"""


def test_the_terminal_velocity_of_a_falling_ball_is_found(
    tracker_folder: Path, stand_ins: Path, tmp_path: Path
) -> None:
    table = numbers(tracker_folder / "viscosity" / "b3.txt", (0, 1))
    fit = fit_optimum(measured(tmp_path, table, FALL).problem(["b3"]), rng=np.random.default_rng(1))
    found = dict(zip(fit.names, fit.values, strict=True))
    # the slope at the end has not quite reached it
    last = np.polyfit(table[-8:, 0], table[-8:, 1], 1)[0]
    t = table[-1, 0] - 0.1
    assert found["v"] + (found["v0"] - found["v"]) * np.exp(-t / found["tau"]) == pytest.approx(
        last, rel=0.02
    )
    assert fit.sds[1] < 0.005
    assert found["sigma_y[b3]"] < 1e-3  # a straight line leaves 18 mm of the real one
    if tracker_folder == stand_ins:
        fall = 10.0 * math.sin(DOWN)  # by the wrong scale
        for name, truth in (
            ("v", fall * SLOWING["v"]),
            ("v0", fall * SLOWING["v0"]),
            ("tau", SLOWING["tau"]),
        ):
            assert abs(found[name] - truth) < 4.0 * fit.sds[fit.names.index(name)]
        assert found["sigma_y[b3]"] == pytest.approx(
            10.0 * SLOWING["sigma"], rel=4.0 / math.sqrt(2 * len(table))
        )
    else:
        assert found["v"] == pytest.approx(-0.361, abs=0.01)


SWING = """title = "Ball in a half-pipe"
kind = "measured"
[curve]
expression = "A*exp(-b*(x - 10))*cos(w*(x - 10) + p) + c"
x = {column = "t_s", name = "time", unit = "s"}
y = {column = "y_m", name = "position", unit = "m"}
window = {min = 10.0, max = 18.0}
[curve.parameters]
A = {start = 0.2, unit = "m"}
b = {start = 0.1, low = 0.0, unit = "1/s"}
w = {start = START, unit = "rad/s"}
p = {start = 0.0, unit = "rad"}
c = {start = 0.0, unit = "m"}
[[runs]]
name = "klipp0"
file = "run.csv"
"""


@pytest.mark.parametrize("start", ["0.7", "20.0"])
def test_a_damped_oscillation_is_found_from_a_frequency_far_off(
    tracker_folder: Path, stand_ins: Path, tmp_path: Path, start: str
) -> None:
    table = numbers(tracker_folder / "halfpipe" / "Klipp0.csv", (0, 1))[::8]
    fit = fit_optimum(
        measured(tmp_path, table, SWING.replace("START", start)).problem(["klipp0"]),
        rng=np.random.default_rng(1),
    )
    found = dict(zip(fit.names, fit.values, strict=True))
    inside = table[(table[:, 0] >= 10.0) & (table[:, 0] <= 18.0)]
    rising = np.flatnonzero(np.diff(np.sign(inside[:, 1] - found["c"])) > 0)  # one a period
    assert found["w"] == pytest.approx(2 * np.pi / np.mean(np.diff(inside[rising, 0])), rel=0.01)
    assert found["w"] == pytest.approx(
        2 * np.pi * frequency(10.0, 18.0) if tracker_folder == stand_ins else 2.863, abs=0.005
    )
    assert found["A"] > 0.3


@pytest.mark.slow
def test_an_oscillation_that_the_curve_does_not_describe_gets_no_headline(
    tracker_folder: Path, tmp_path: Path
) -> None:
    table = numbers(tracker_folder / "halfpipe" / "Klipp0.csv", (0, 1))[::20]
    campaign = measured(
        tmp_path,
        table,
        SWING.replace("START", "3.0").replace("window = {min = 10.0, max = 18.0}\n", ""),
    )
    analysis = analyse(campaign, ["klipp0"], seed=1, target=Target(ess=500))
    assert analysis.diagnosis.status == "poor-fit"  # the frequency drifts as the swing gets smaller


@pytest.mark.parametrize("formula", ["x + a*0", "where(x > a, 1, 0)", "floor(a*x)"])
@pytest.mark.parametrize("size", ["u_y = 0.02\n", ""])
def test_parameter_that_nothing_holds_is_refused_before_sampling(
    folder: Path, formula: str, size: str
) -> None:
    """A flat prior without limits and a curve that does not change with the parameter: there is no
    posterior.
    """
    text = (
        CAMPAIGN.split("[curve.parameters]")[0]
        .replace("U0*exp(-x/tau) + offset", formula)
        .replace("u_y = 0.02\n", size)
    )
    text += '[curve.parameters]\na = {start = 0.5}\n[[runs]]\nname = "first"\nfile = "first.csv"\n'
    with pytest.raises(
        InputError, match=r"campaign\.toml:\d+: 'a' is not determined by the data: give it limits"
    ):
        analyse(load(folder, text), ["first"], seed=1, target=Target(max_step=50))


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered")
def test_report_of_parameters_without_limits_is_written(folder: Path) -> None:
    """Flat priors without limits cannot be drawn from, but all figures and tables are made."""
    from estim.reports.analysis import analysis_report

    campaign = load(folder, CAMPAIGN.replace('offset = "0.00(1)"', "offset = {start = 0.0}"))
    files = analysis_report(
        campaign,
        analyse(campaign, ["first"], seed=1, target=Target(ess=100, max_step=100)),
        figures="all",
    )
    assert files["figures/directions.png"].startswith(b"\x89PNG")
    assert "Jeffreys' prior" in files["report.md"].decode()


def test_warnings_that_concern_a_rolling_disk_are_not_repeated_for_another_curve(
    folder: Path,
) -> None:
    """They stand in the head of a CSV that `estim import` wrote; what concerns any track stays."""
    drop = folder / "track.csv"
    t = np.arange(0.0, 1.0, 0.04)
    rows = "".join(f"{a:.2f}\t{0.5 * a:.4f}\t0\t{0.5:.4f}\n" for a in t if not 0.30 < a < 0.34)
    (folder / "track.txt").write_text("mass A\nt\tx\ty\tv\n" + rows)
    imported = CliRunner().invoke(cli, ["import", str(folder / "track.txt"), "-o", str(drop)])
    assert imported.exit_code == 0, imported.output
    (folder / "first.csv").write_text(drop.read_text().replace("x_m", "u_V"))
    head = (folder / "first.csv").read_text()
    assert "# warning: the body already moves" in head
    warnings = load(folder).tables["first"].warnings
    assert not any("release" in words or "speeds are made" in words for words in warnings)
    assert any("frames are missing" in words for words in warnings)


def test_a_problem_that_is_kept_speaks_the_language_of_whoever_asks(folder: Path) -> None:
    campaign = only(folder, "a*x + b", "a = {start = 1.0}\nb = {start = 0.0}")
    with spoken("es"):
        spanish = campaign.problem(["first"]).parameters[0].meaning
    english = campaign.problem(["first"]).parameters[0].meaning
    assert (english, spanish) == ("parameter of the curve", "parámetro de la curva")
    assert campaign.problem(["first"]).runs[0] is campaign.problem(["first"]).runs[0]
