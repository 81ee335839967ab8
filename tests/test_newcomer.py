"""What a newcomer gets wrong: each slip is one line that says where it is and what to write
instead, or a note in the report.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from click.testing import CliRunner
from command_runner import runner
from test_noise import CAMPAIGN, POSITIONS, TIMES
from uncertainties import ufloat

from estim import fit_curve, fit_line, mean, read_table
from estim.campaign import Campaign, load_campaign
from estim.campaign.row_selection import way_back
from estim.checks.goodness_of_fit import P_FLOOR
from estim.cli import commands as cli
from estim.common.errors import EstimError, InputError
from estim.common.quantity_text import Quantity
from estim.reading.dialect import Dialect
from estim.reading.named_columns import read_columns
from estim.reading.run import read_run
from estim.reading.tracker.importing import stated_tilt
from estim.reports.derived import origin_facts, origin_warnings, speed_facts
from estim.reports.rendering import p_words

SPEEDS = "{sigma_x_m = 0.001}"


def write(folder: Path, noise: str = SPEEDS, head: str = "", tilt: str = "phi_deg = 4.0") -> Path:
    (folder / "c.toml").write_text(CAMPAIGN.replace("NOISE", noise).replace("phi_deg = 4.0", tilt))
    rows = "\n".join(f"{t:.6f},{x:.9f}" for t, x in zip(TIMES, POSITIONS, strict=True))
    (folder / "r.csv").write_text(f"{head}t_s,x_m\n{rows}\n")
    return folder / "c.toml"


def refused(*arguments: object) -> str:
    """The one line that the command line says; fails where it says anything else."""
    done = CliRunner().invoke(
        cli.cli, [str(argument) for argument in arguments], standalone_mode=False
    )
    assert isinstance(done.exception, EstimError), done.output
    assert "\n" not in str(done.exception)
    return str(done.exception)


@pytest.fixture
def never_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    def sampled(*_: object, **__: object) -> None:
        pytest.fail("it was sampled before it was refused")

    monkeypatch.setattr("estim.sampling.certified.sample_posterior", sampled)


@pytest.mark.usefixtures("never_sampled")
@pytest.mark.parametrize("command", ["energy", "reanalyse"])
@pytest.mark.parametrize(
    ("noise", "says"),
    [
        (
            '{model = "positions", sigma_x_m = 0.001}',
            r"'model' must not be 'positions' for estim \w+, which needs speeds",
        ),
        (
            '{model = "positions", sigma_x_m = 0.001, robust = "mixture"}',
            r"'model' must not be 'positions'",
        ),
        (
            '{model = "independent", sigma_v_m_s = 0.01, derivative = "central", robust = '
            '"student-t"}',
            r"'robust' does not go with estim \w+",
        ),
    ],
)
def test_energy_and_reanalysis_refuse_positions_and_robust_errors_at_once(
    tmp_path: Path, command: str, noise: str, says: str
) -> None:
    campaign = write(tmp_path, noise)
    line = next(
        n for n, text in enumerate(campaign.read_text().splitlines(), start=1) if "noise" in text
    )
    assert re.match(
        rf"{re.escape(str(campaign))}:{line}: {says}",
        refused(command, campaign, "--out", tmp_path / "out"),
    )
    assert not (tmp_path / "out").exists()


def test_decimal_commas_are_told_as_such(tmp_path: Path) -> None:
    for text, says in (
        (
            "t_s,x_m\n0,0,0,1\n",
            r"a.csv:2: 'row' must have 2 cells, not \d \(decimal commas\? write decimal points, or",
        ),
        ("t_s;x_m\n0;x\n", r"a.csv:2: 'x_m' must be a number: x"),
    ):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(InputError, match=says):
            read_run(tmp_path / "a.csv", name="a")


@pytest.mark.parametrize("noise", ["{sigma_x_m = 1.0}", '{model = "positions", sigma_x_m = 1.0}'])
def test_reading_error_in_millimetres_is_asked_about(tmp_path: Path, noise: str) -> None:
    assert "'sigma_x_m' must be well below the length of the run" in refused(
        "fit", write(tmp_path, noise), "--out", tmp_path
    )
    assert "is it in mm?" in refused("fit", write(tmp_path, noise), "--out", tmp_path)
    reach = float(np.ptp(POSITIONS))
    # just below the limit of a tenth
    load_campaign(write(tmp_path, f'{{model = "positions", sigma_x_m = {0.09 * reach:.6f}}}'))
    with pytest.raises(InputError, match="well below"):
        load_campaign(write(tmp_path, noise.replace("1.0", f"{0.11 * reach:.6f}")))


def test_missing_run_file_names_its_line_in_the_campaign(tmp_path: Path) -> None:
    campaign = write(tmp_path)
    (tmp_path / "r.csv").unlink()
    line = next(
        n
        for n, text in enumerate(campaign.read_text().splitlines(), start=1)
        if text.startswith("file")
    )
    says = refused("fit", campaign)
    assert says.startswith(f"{campaign}:{line}: 'file' cannot be found")
    assert says.endswith("names are relative to the folder of the campaign file): r.csv")


def test_wrong_run_is_told_as_the_option_it_was_given_by(tmp_path: Path) -> None:
    campaign = write(tmp_path)
    for command in ("fit", "energy"):
        assert (
            refused(command, campaign, "--run", "x")
            == f"{campaign}: '--run' must name one of the runs (r): x"
        )


def test_least_p_value_is_told_as_a_limit() -> None:
    assert p_words(P_FLOOR) == "< 5e-5"
    assert p_words(2.0 * P_FLOOR) == "0.00010"
    assert p_words(0.031) == "0.031"


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_least_p_value_is_a_limit_wherever_it_is_told(tmp_path: Path, project: Path) -> None:
    """A line through a cooling curve fails three tests as clearly as simulation can tell; counts
    scatter as much.
    """
    tea = project / "data" / "tutorial" / "tea.csv"
    done = runner().invoke(
        cli.cli, ["fit", str(tea), "--formula", "a + b*t", "--out", str(tmp_path / "out")]
    )
    minutes, temperature = np.loadtxt(tea, delimiter=",", skiprows=2, unpack=True)
    line = fit_curve("a + b*x", minutes, temperature, u_y=0.3)
    counts = fit_curve(
        "m + 0*x", np.arange(20.0), np.tile([20, 80], 10), start={"m": 10.0}, noise="poisson"
    )
    said = [
        done.output + done.stderr,
        (tmp_path / "out" / "report.md").read_text(),
        str(line.reasons),
        counts.summary(),
    ]
    assert all(re.search("p.<.5e-5", text) for text in said)
    assert not any(re.search("p.=.5.0e-5", text) for text in said)


def test_size_of_errors_is_to_be_inferred_only_where_nothing_but_the_size_is_wrong(
    tmp_path: Path,
) -> None:
    """Random errors twice as large as stated: infer them.  A drift: do not."""
    from estim.checks.diagnosis import failed_tests
    from estim.checks.goodness_of_fit import check_goodness
    from estim.fitting.least_squares import fit_least_squares
    from estim.words import advice_for

    def advice(errors: np.ndarray) -> str:
        pattern = load_campaign(write(tmp_path, '{model = "positions", sigma_x_m = 0.001}'))
        table = replace(
            pattern.tables["r"], columns=MappingProxyType({"t_s": TIMES, "x_m": POSITIONS + errors})
        )
        problem = replace(pattern, tables=MappingProxyType({"r": table})).problem(["r"])
        fit = fit_least_squares(problem)
        return " ".join(
            advice_for(failed_tests(check_goodness(fit, rng=np.random.default_rng(2)), dof=fit.dof))
        )

    noise = np.random.default_rng(3).standard_normal(TIMES.size)
    assert 'sigma_x_m = {prior = "log-normal"' in advice(0.003 * noise)
    drift = advice(0.001 * noise + 0.005 * np.sin(np.linspace(0.0, 20.0, TIMES.size)))
    assert "look at the residuals" in drift
    assert "log-normal" not in drift


def tilted(folder: Path, tilt: str) -> tuple[Campaign, tuple[str, ...], tuple[str, ...]]:
    head = (
        "# made by estim import\n# track 'A' of a.trk\n# tilt of the fitted line 4.300 deg "
        "against the x axis, positive uphill, standard"
    )
    head += (
        " uncertainty 0.020 deg from the scatter of the points alone\n# warning: 2 of 30 "
        "frames are missing\n"
    )
    campaign = load_campaign(write(folder, head=head, tilt=tilt))
    problem = campaign.problem(["r"])
    return campaign, *(
        told(campaign.tables["r"], problem.runs[0], problem)
        for told in (origin_facts, origin_warnings)
    )


@pytest.mark.parametrize(
    ("tilt", "warned"),
    [
        ('phi_deg = "4.0(4)"', False),
        ('phi_deg = "4.26(2)"', False),
        ('phi_deg = "4.0(1)"', False),
        ('phi_deg = "4.0(9)"', False),
        ('phi_deg = "4.20(1)"', True),
        ("phi_deg = 4.0", True),
        ("phi_deg = -4.3", True),
        ('phi_deg = "4.0(1)"\nphi_zero_deg = "0.00(5)"', False),
        ('phi_deg = "3.9(1)"', True),
        ('phi_deg = "3.9(1)"\nphi_zero_deg = "0.0(2)"', False),
    ],
)
def test_tilt_of_the_track_stands_beside_the_stated_one_and_a_contradiction_is_a_warning(
    tmp_path: Path, tilt: str, warned: bool
) -> None:
    """4.30(2) deg from the track: three combined standard uncertainties are the limit, the common
    zero error counts.
    """
    campaign, facts, warnings = tilted(tmp_path, tilt)
    found = campaign.tables["r"].tilt
    assert found is not None
    assert (np.degrees(found.value), np.degrees(found.u)) == pytest.approx((4.3, 0.02))
    assert facts[0] == "track 'A' of a.trk"
    assert facts[-1].startswith("tilt measured from the track 4.300 ± 0.020 deg, stated ")
    assert warnings[0] == "2 of 30 frames are missing"
    assert (len(warnings) == 2) == warned
    assert not warned or "the tilt of the track" in warnings[1]


def test_tilt_is_read_as_it_was_written() -> None:
    assert stated_tilt(()) is None
    assert stated_tilt(("tilt of the fitted line ? deg",)) is None
    found = stated_tilt(
        (
            "tilt of the fitted line -87.274 deg against the x axis, positive uphill, "
            "standard uncertainty 0.042 deg from",
        )
    )
    assert found == Quantity(np.radians(-87.274), np.radians(0.042))


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.usefixtures("undrawn")
def test_facts_and_warnings_of_a_file_stand_in_report_and_result(tmp_path: Path) -> None:
    from estim.pipeline import analyse
    from estim.reports.analysis import analysis_report
    from estim.sampling.chain import Target

    campaign, facts, warnings = tilted(tmp_path, 'phi_deg = "4.20(1)"\nunmodelled_force = 0')
    files = analysis_report(
        campaign, analyse(campaign, ["r"], seed=1, target=Target(ess=200, max_step=200))
    )
    for text in (*facts, *warnings):
        assert text in files["report.md"].decode().replace("\u00a0", " ")
        assert text in files["result.json"].decode()


@pytest.mark.parametrize(
    ("noise", "offset", "said"),
    [
        (
            "{sigma_x_m = 0.0008}",
            "",
            ['if it is a single reading, state offset_m, e.g. offset_m = "0.0000(8)"'],
        ),
        (
            '{model = "independent", sigma_v_m_s = 0.01, derivative = "central"}',
            "",
            ['offset_m = "0.0000(10)"'],
        ),
        ("{sigma_x_m = 0.0008}", 'offset_m = "0.0000(8)"\n', []),
        ("{sigma_x_m = 0.0008}", "offset_m = 0.0\n", []),
        ('{model = "positions", sigma_x_m = 0.0008}', "", []),
    ],
)
def test_a_zero_that_is_taken_as_exact_is_said(
    tmp_path: Path, noise: str, offset: str, said: list[str]
) -> None:
    run = (
        load_campaign(write(tmp_path, noise, tilt=f"{offset}phi_deg = 4.0")).problem(["r"]).runs[0]
    )
    facts = speed_facts(run)
    assert len(facts) == len(said)
    for fact, words in zip(facts, said, strict=True):
        assert fact.startswith("the zero of x (the release) is taken as exact;")
        assert words in fact


@pytest.mark.parametrize(("frames", "said"), [(20, True), (4, False)])
def test_frames_of_the_way_back_that_a_fit_of_positions_would_use_are_said(
    tmp_path: Path, frames: int, said: bool
) -> None:
    campaign = write(tmp_path, tilt="offset_m = 0.0\nphi_deg = 4.0")
    step = TIMES[1] - TIMES[0]
    with (tmp_path / "r.csv").open("a") as file:
        for k in range(frames):
            file.write(f"{TIMES[-1] + (k + 1) * step:.6f},{POSITIONS[-2 - k]:.9f}\n")
    (run,) = load_campaign(campaign).problem(["r"]).runs
    facts = speed_facts(run)
    assert bool(facts) == said
    if said:
        assert 'model = "positions" would also use the' in facts[0]
        assert f"the {way_back(run.excluded)} frames of the way back" in facts[0]
        assert abs(way_back(run.excluded) - frames) <= 3  # the last has no central difference


@pytest.mark.parametrize(
    ("written", "says"),
    [
        ("0,03", "must be a number as 4.0, or"),
        ("30 mV", "must be a number as 4.0, or"),
        ("0.1.2", "as 4.0, or"),
    ],
)
def test_an_uncertainty_that_is_no_number_is_told_how_one_is_written(
    tmp_path: Path, written: str, says: str
) -> None:
    (tmp_path / "cap.csv").write_text("t;U\n0;1\n1;2\n2;3\n3;4\n")
    assert says in refused("fit", tmp_path / "cap.csv", "--formula", "a*t + b", "--u-y", written)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            'kind = "measured"',
            'kind = "mesured"',
            ":2: 'kind' must be one of synthetic, measured, published (did you mean "
            "'measured'?): mesured",
        ),
        ("[[runs]]", "[[run]]", ":9: 'run' is not a known key here (did you mean 'runs'?)"),
        (
            "u_y = 0.1",
            'noise = {model = "event-time"}',
            ":7: 'model' must be one of poisson, binomial, event-times (did you mean "
            "'event-times'?): ",
        ),
        (
            "a = {}",
            'a = {prior = "half-norml"}',
            ":8: 'prior' must be one of normal, uniform, half-normal, log-normal, "
            "truncated-normal, beta (did",
        ),
        (
            "u_y = 0.1",
            'u_y = {prior = "gauss"}',
            ":7: 'prior' must be one of normal, uniform, half-normal, log-normal, "
            "truncated-normal, beta",
        ),
        (
            'kind = "measured"',
            'kind = "it\'s"',
            ":2: 'kind' must be one of synthetic, measured, published: it's",
        ),
        (
            'kind = "measured"',
            "kind = 'say \"measured\"'",
            ":2: 'kind' must be one of synthetic, measured, published (did you mean 'measured'?)",
        ),
        (
            'kind = "measured"',
            'kind = "it\'s \\"so\\""',
            ":2: 'kind' must be one of synthetic, measured, published: it's \"so\"",
        ),
        ("a = {}", "a = {start = nan}", ":8: 'a' 'start' must be finite: nan"),
        ("a = {}", "a = {start = 1.0, high = nan}", ":8: 'a' 'high' must be a number: nan"),
        ("a = {}", "a = {start = 3.0, high = 2.0}", ":8: 'a' 'start' must lie within [-inf, 2]: 3"),
    ],
)
def test_a_word_that_is_none_of_the_choices_is_told_them(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    lines = (
        'title = "c"', 'kind = "measured"', "[curve]", 'expression = "a*x"', 'x = "t"', 'y = "U"',
        "u_y = 0.1", "parameters = {a = {}}", "[[runs]]",
        'name = "c"', 'file = "cap.csv"',
    )  # fmt: skip
    text = "\n".join(lines)
    assert old in text
    (tmp_path / "cap.csv").write_text("t;U\n0;1\n1;2\n2;3\n3;4\n")
    (tmp_path / "c.toml").write_text(text.replace(old, new))
    assert refused("fit", tmp_path / "c.toml").startswith(f"{tmp_path / 'c.toml'}{says}")


def test_one_column_of_decimal_commas_is_read_where_its_name_shows_it_and_else_asked_for(
    tmp_path: Path,
) -> None:
    path = tmp_path / "events.csv"
    for name in ("t (s)", "t in s"):
        path.write_text(f"{name}\n0,5\n1,25\n2,0\n")
        assert read_columns(path, needed=["t"], min_rows=3).columns["t"].tolist() == [
            0.5,
            1.25,
            2.0,
        ]
    path.write_text("t\n0,5\n1,25\n2,0\n")
    assert (
        "the comma is taken to part the cells: if it is the decimal mark, say --decimal comma"
        in refused("fit", path, "--formula", "a*t")
    )
    stated = Dialect(decimal="comma")
    assert read_columns(path, needed=["t"], min_rows=3, dialect=stated).columns["t"].tolist() == [
        0.5,
        1.25,
        2.0,
    ]
    path.write_text("t,n\n1,2\n2,3\n3,4\n")
    assert read_columns(path, needed=["t", "n"], min_rows=3).columns["n"].tolist() == [
        2.0,
        3.0,
        4.0,
    ]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["propagate", "F*l/(A*d)"], "is a formula: write the values of its inputs after it"),
        (["propagate", "+".join("a" * 200)], "is a formula: write the values of its inputs"),
        (["propagate", "model (2).toml"], r"model \(2\).toml: cannot be read"),
        (["propagate", "y = a*b", "a=1(1)"], "'formula' names no input .*state its value.: b"),
        (["propagate", "y = a", "a=1(1) foo"], "'a' must have a known unit"),
        (["plan", "t.csv"], "t.csv:1: 'file' is a table, not a TOML file"),
        (
            ["fit", "n.txt", "--formula", "exp(-t/tau)", "--noise", "event-times"],
            "n.txt:1: 'header' has no line of column names: name all 1 from",
        ),
        (
            ["fit", "n.txt", "--columns", "t", "--formula", "exp(-t/t0)", "--noise", "event-times"],
            "--window MIN:MAX",
        ),
        (["line", "t.csv", "--cov-y", "c.csv"], "c.csv: 'matrix' must be symmetric"),
        (["line", "p.csv"], "p.csv: 'file' must be text"),
        (["line", "d.csv"], "d.csv:1: 'm/g' occurs twice in the header"),
        (["fit", "d.csv", "--formula", "line"], "d.csv:1: 'm/g' occurs twice in the header"),
        (["line", "t.csv", "--x", "x", "--y", "x"], "'--y' must name another column than --x"),
        (["mean", "k.csv"], r"k.csv: 'column' must be named by --y \(there are run, p\)"),
        (["mean", "k.csv", "--y", "p"], "k.csv:2: 'p' must be a number .as 1234.5 or"),
        (["mean", "t.csv", "--y", "y", "--u-y", "5%"], "'--u-y' must be a number or a column: put"),
        (["line", "r.csv"], "r.csv:3: 'row' must have 2 cells, not 3: "),
        (
            ["line", "s.csv"],
            r"s.csv:2: 'row' must have 2 cells, not \d \(decimal commas\? write decimal",
        ),
        (["fit", "k.csv", "--formula", "line"], "k.csv:2: 'p' must be a number .as 1234.5 or"),
        (
            ["fit", "t.csv", "--formula", "line", "--every", "2"],
            "^command line: 'every' must leave between 3 and",
        ),
        (
            ["fit", "t.csv", "--formula", "line", "--x", "z"],
            r"t.csv:1: 'z' is missing \(the header",
        ),
        (
            ["fit", "t.csv", "--formula", "line", "--y", "z"],
            r"t.csv:1: 'z' is missing \(the header",
        ),
        (["line", "t.csv", "--x", "z"], r"t.csv:1: 'z' is missing \(the header has x, y\)"),
        (["mean", "t.csv", "--y", "z"], r"t.csv:1: 'z' is missing \(the header has x, y\)"),
        (["fit", "t.csv", "--formula", "line", "--run", "a"], "^command line: '--run' must name"),
        (
            ["fit", "e.csv", "--formula", "a*exp(-x/tau) + c", "--start", "tau=-3e4"],
            "^command line: 'a' is not determined .* if a start that was stated is far off",
        ),
        (
            ["fit", "u.csv", "--formula", "exponential + constant"],
            "far from 0, at 1700000000 to 1700000011: count .* as x - 1700000000 in the formula",
        ),
        (
            ["fit", "e.csv", "--formula", "a*exp(-x/tau) + c", "--start", "a=1e30"],
            "^command line: 'start' of tau could not be found",
        ),
    ],
)
def test_a_slip_of_the_first_hour_is_told_with_its_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("x,y\n1,2\n2,3.1\n3,4\n")
    Path("r.csv").write_text("x,y\n1,2\n2,3.1,a draught\n3,4\n4,5.1\n")
    Path("s.csv").write_text("x,y\n0,5,1,2\n1,0,2,1\n1,5,2,9\n")
    Path("k.csv").write_text("run,p\n1,1'234\n2,1'236\n3,1'231\n")
    for name, since in (("e.csv", 0), ("u.csv", 1_700_000_000)):
        decay = (f"{since + t},{100.0 * math.exp(-t / 3.0) + 5.0 + (-1) ** t},1" for t in range(12))
        Path(name).write_text("\n".join(["x,y,u_y", *decay]))
    Path("d.csv").write_text("m/g,m/g\n1,2\n2,3.1\n3,4\n")
    Path("n.txt").write_text("1.5\n2.5\n3.5\n")
    Path("c.csv").write_text("1,2,0\n0,1,0\n0,0,1\n")
    Path("p.csv").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    assert re.search(says, refused(*arguments))


def test_a_column_that_is_not_used_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,err\n1,2,.1\n2,3.1,.1\n3,4,.1\n")
    said = ["--x", "x", "--y", "y", "--figures", "none", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(cli.cli, ["line", str(tmp_path / "a.csv"), *said])
    assert "columns: x = x, y = y; columns not used: err" in done.output


def test_a_function_without_starting_values_is_told_them() -> None:
    x = np.arange(5.0)
    for start in (None, {"a": 1.0}):
        with pytest.raises(InputError, match=r"'start' must give .*, as \{'a': 1.0, 'b': 1.0\}"):
            fit_curve(lambda x, a, b: a + b * x, x, x, start=start)
    with pytest.raises(InputError, match=r"'start' cannot be called as curve\(x, c\)"):
        fit_curve(lambda x, a: a * x, x, x, start={"c": 1.0})
    with pytest.raises(InputError, match=r"as \{'a': 1.0\}: b$"):
        fit_curve(lambda x, a, b: a * x + b, x, x, fixed={"b": 1.0})
    with pytest.raises(InputError, match=r"curve\(x, p\): multiple values for argument 'p'"):
        fit_curve(lambda p, x: p * x, x, x, start={"p": 1.0})
    with pytest.raises(InputError, match=r"'curve' must take all abscissas .*x\['v'\] in it"):
        fit_curve(lambda u, v, a: a * u * v, {"u": x, "v": x}, x, start={"a": 1.0})


def test_what_python_shows_of_a_result_is_what_print_shows() -> None:
    x, y = np.arange(5.0), np.array([1.1, 1.9, 3.2, 3.9, 5.1])
    for result in (fit_curve("a + b*x", x, y), fit_line(x, y), mean(y)):
        assert repr(result) == str(result)
        assert len(repr(result)) < 600


def test_numbers_with_uncertainties_are_told_where_each_part_goes() -> None:
    y = [ufloat(value, 0.1) for value in (1.0, 2.0, 3.0)]
    for given in (y, np.array(y)):
        for use in (lambda v: fit_curve("a*x", np.arange(3.0), v), lambda v: mean(v)):
            with pytest.raises(InputError, match=r"nominal values here, .* as u_y, u_x or u"):
                use(given)


@pytest.mark.parametrize(
    "said",
    [
        {"start": {"a": ufloat(1.0, 0.1)}},
        {"bounds": {"a": (ufloat(0.0, 0.1), None)}},
        {"fixed": {"a": ufloat(1.0, 0.1)}},
    ],
)
def test_one_number_with_an_uncertainty_has_no_place_for_it(said: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"without an uncertainty \(its nominal_value\)"):
        fit_curve("a*x", np.arange(3.0), np.arange(3.0), **said)  # type: ignore[arg-type]


def test_a_table_is_a_dictionary_of_its_columns(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x (s),y\n1,2\n2,3.1\n3,4\n")
    table = read_table(tmp_path / "a.csv")
    assert {name: [*column] for name, column in dict(table).items()} == {
        "x": [1, 2, 3],
        "y": [2, 3.1, 4],
    }
    with pytest.raises(InputError, match="'name' must be the name of a column: 0"):
        table[0]  # type: ignore[index]


def test_the_command_alone_shows_its_help() -> None:
    done = CliRunner().invoke(cli.cli, [])
    assert done.exit_code == 0
    assert "\n  fit " in done.output
    assert re.search(r"\n  line +Fit a straight line ", done.output)
    assert re.search(r"\n  diff +Compare two values,", done.output)
    assert "error" not in done.output


def test_the_command_that_is_advised_for_a_new_campaign_can_be_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("x,y\n1,2\n2,3.1\n3,4\n")
    done = runner().invoke(cli.cli, ["new", "my tea", "--from", "t.csv"])
    assert "fit it by: estim fit 'my tea.toml'\n" in done.output
