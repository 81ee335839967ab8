"""A fit of a table by one command: it is the campaign that its report prints; `estim new` writes
one to begin with; many points.
"""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner
from conftest import REAL
from tracker_files import point_mass, trk

from estim import Binomial, EventTimes, fit_curve
from estim.campaign import Campaign, TableChoices, campaign_of_table, load_campaign
from estim.campaign.table_campaign import run_names, text_of_table
from estim.cli.commands import cli
from estim.common.errors import EstimError, InputError
from estim.fitting import Fit, fit_problem
from estim.fitting.optimum import fit_optimum

FORMULA = "a*exp(-x/tau) + c"


@pytest.fixture
def table(tmp_path: Path, rng: np.random.Generator) -> Path:
    t = np.linspace(0.0, 10.0, 41)
    u = 2.0 * np.exp(-t / 3.0) + 0.5 + 0.02 * rng.standard_normal(t.size)
    rows = "\n".join(f"{a:.3f};{b:.6f};x".replace(".", ",") for a, b in zip(t, u, strict=True))
    (tmp_path / "data.csv").write_text(f"Logger 7\ntime [s];U (V);note\n{rows}\n")
    return tmp_path / "data.csv"


def told(*arguments: object) -> str:
    """The one line that a command is refused with."""
    done = runner().invoke(cli, [str(argument) for argument in arguments], standalone_mode=False)
    assert isinstance(done.exception, EstimError), done.output
    return str(done.exception)


def test_one_command_is_the_campaign_that_its_report_prints(table: Path) -> None:
    out = table.parent / "out"
    arguments = [
        "fit",
        table,
        "--formula",
        FORMULA,
        "--start",
        "tau=1 s",
        "--low",
        "tau=0",
        "--u-y",
        "0.02",
        "--out",
        out,
        "--figures",
        "none",
    ]
    done = runner().invoke(cli, [str(argument) for argument in arguments], standalone_mode=False)
    assert (done.exception, done.output.splitlines()[:2]) == (
        None,
        ["columns: x = time (s), y = U (V)", "data: ok"],
    )
    report = (out / "report.md").read_text()
    (text,) = re.findall(r"```toml\n(.*?)```", report, flags=re.S)
    (table.parent / "kept.toml").write_text(text)
    kept, result = (
        load_campaign(table.parent / "kept.toml"),
        json.loads((out / "result.json").read_text()),
    )
    fit = fit_problem(kept.problem(["data"]), rng=np.random.default_rng(1))
    assert result["parameters"]["tau"]["unit"] == "s"
    assert result["runs"]["data"]["x"] == "time (s)"
    assert result["runs"]["data"]["y"] == "U (V)"
    for name, true in (("a", 2.0), ("tau", 3.0), ("c", 0.5)):
        value, sd = fit.values[fit.names.index(name)], result["fit"]["sds"][name]
        assert result["fit"]["values"][name] == pytest.approx(value, abs=1e-6 * sd)
        assert abs(value - true) < 4.0 * sd
    assert result["provenance"]["campaign_sha256"] == kept.sha256


def test_a_wrong_curve_ends_with_3(table: Path) -> None:
    arguments = [
        "fit",
        str(table),
        "--formula",
        "a + b*x",
        "--u-y",
        "0.02",
        "--out",
        str(table.parent / "out"),
        "--figures",
        "none",
    ]
    done = runner().invoke(cli, arguments, standalone_mode=False)
    assert "data: poor-fit" in done.output
    assert done.exit_code == 3


def test_every_option_is_a_key_of_the_campaign(table: Path) -> None:
    choices = TableChoices(
        formula="a*exp(-x/tau) + c + g*k",
        start={"tau": "2"},
        low={"tau": "0"},
        high={"tau": "9"},
        value={"g": "9.81(2)", "k": "0"},
        x="time",
        y="U (V)",
        u_y="0.02",
        window=(None, 8.0),
        every=2,
        title="T",
        kind="synthetic",
    )
    text = text_of_table(table, choices)
    for line in (
        'title = "T"',
        'kind = "synthetic"',
        'x = {column = "time", unit = "s"}',
        'y = {column = "U (V)", name = "U", unit = "V"}',
        "u_y = 0.02",
        "window = {max = 8.0}",
        "every = 2",
        "tau = {start = 2.0, low = 0.0, high = 9.0}",
        'g = "9.81(2)"',
        "k = 0.0",
        "a = {}",
    ):
        assert line in text.splitlines()
    problem = campaign_of_table(table, choices).problem(["data"])
    assert problem.names == ("a", "tau", "c", "g")
    assert problem.n_obs == 17


def test_a_parameter_may_be_called_like_a_column(tmp_path: Path) -> None:
    (tmp_path / "fall.csv").write_text(
        "t,x,v\n" + "".join(f"{0.1 * i:g},{i**2:g},{2 * i:g}\n" for i in range(9))
    )
    text = text_of_table(tmp_path / "fall.csv", TableChoices(formula="x0 + v*t + a*t**2/2", y="x"))
    assert 'x = {column = "t"}' in text.splitlines()
    assert "v = {}" in text.splitlines()


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("a + b*x + c*x**2", "a = {}"),
        ("a*exp(-x/tau) + c", "tau = {}"),
        ("a*b*x", "b = {}"),
        ("A*sin(w*x) + B*cos(w*x)", "w = {}"),
        ("a*log(x/b)", "b = {}"),
    ],
)
def test_starts_are_left_to_the_points(table: Path, formula: str, said: str) -> None:
    assert said in text_of_table(table, TableChoices(formula=formula)).splitlines()
    assert (
        "b = {start = 3.0}"
        in text_of_table(
            table, TableChoices(formula="a*exp(-b*x) + c", start={"b": "3"})
        ).splitlines()
    )


def test_the_starts_of_linear_parameters_are_the_optimum(table: Path) -> None:
    table.write_text("x,y\n" + "".join(f"{x},{3e6 * x - 4e-3}\n" for x in (0.5, 1.0, 2.0, 3.0)))
    problem = campaign_of_table(table, TableChoices(formula="a + b*x", u_y="1e-3")).problem(
        ["data"]
    )
    assert problem.start() == pytest.approx([-4e-3, 3e6], rel=1e-6)
    assert fit_optimum(problem, rng=np.random.default_rng(1)).values == pytest.approx(
        [-4e-3, 3e6], rel=1e-6
    )


def test_a_curve_by_name_needs_no_starts(tmp_path: Path) -> None:
    x = np.linspace(500.0, 520.0, 81)
    y = (
        7.0 * np.exp(-0.5 * ((x - 509.3) / 1.2) ** 2)
        + 0.02 * x
        - 7.0
        + 0.1 * np.random.default_rng(4).standard_normal(x.size)
    )
    path = tmp_path / "peak.csv"
    path.write_text(
        "wavelength [nm],U\n" + "".join(f"{a:.2f},{b:.4f}\n" for a, b in zip(x, y, strict=True))
    )
    text = text_of_table(
        path, TableChoices(formula="gaussian + line", u_y="0.1", low={"sigma": "0.5"})
    )
    assert 'model = "gaussian + line"' in text
    assert text.partition("[curve.parameters]")[2].split("\n\n")[0].strip() == "sigma = {low = 0.5}"
    campaign = campaign_of_table(path, TableChoices(formula="gaussian + line", u_y="0.1"))
    fit = fit_problem(campaign.problem(campaign.run_names), rng=np.random.default_rng(1))
    named = dict(
        zip(fit.names, zip(fit.values, np.sqrt(np.diag(fit.cov)), strict=True), strict=True)
    )
    for name, truth in (("center", 509.3), ("sigma", 1.2), ("slope", 0.02)):
        assert abs(named[name][0] - truth) < 4.0 * named[name][1]
    assert "model" not in text_of_table(path, TableChoices(formula="line*x + gaussian", u_y="0.1"))


def test_a_formula_may_be_one_in_t(table: Path) -> None:
    in_x, in_t = (
        campaign_of_table(
            table, TableChoices(formula=f"a*exp(-{name}/tau) + c", start={"tau": "1"})
        ).problem(["data"])
        for name in ("x", "t")
    )
    assert in_x.names == in_t.names
    values = in_x.start()
    np.testing.assert_array_equal(
        *(one.runs[0].curve.local(one.runs[0].x, one.named(values)).value for one in (in_x, in_t))
    )
    slopes = [one.runs[0].curve.local(one.runs[0].x, one.named(values)) for one in (in_x, in_t)]
    np.testing.assert_array_equal(slopes[0].slope, slopes[1].slope)
    with pytest.raises(
        InputError,
        match=r"'--formula' holds neither x nor the name of its column, .* --start: a.exp",
    ):
        # not how the column is called
        campaign_of_table(table, TableChoices(formula="a*exp(-s/tau)", start={"tau": "1"}))
    t_is_known = TableChoices(formula="a*exp(-t/tau)*x", start={"tau": "1", "t": "1"})
    assert "t" in campaign_of_table(table, t_is_known).problem(["data"]).names


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], r"'CAMPAIGN\|FILE' is a table, not a campaign: say --formula"),
        (["--start", "a=1"], "'--start' needs --formula as well"),
        (
            ["--formula", "a*x", "--start", "b=1"],
            r"'--start' names no parameter of the formula \(a\): b",
        ),
        (["--formula", "a*x", "--start", "a"], "'--start' must be written NAME=VALUE: a"),
        (
            ["--formula", "a*x + b", "--start", "a=1,b=2"],
            "'--start' must be one NAME=VALUE: give several one by one: a=1,b=2",
        ),
        (["--formula", "a*x", "--start", "a=one"], "'--start a' must be a number: one"),
        (
            ["--formula", "a*x", "--value", "a=1", "--low", "a=0"],
            "'--value' gives a parameter its value",
        ),
        (
            ["--formula", "a*x", "--y", "I"],
            r"data.csv:2: 'I' is missing \(the header has time \[s\], U \(V\), note",
        ),
        (["--formula", "a*open(x)"], "'--formula' calls 'open'"),
        (["--formula", "a*x", "--window", "3"], "'--window' must be written MIN:MAX"),
        (["--formula", "a*x", "--delimiter", "%"], "'--delimiter' must be one of tab"),
        (
            ["--formula", "a*x", "--decimal", "point"],
            r"data.csv:3: 'time \[s\]' must be a number .as 1234.5 or 2e3",
        ),
        (["--formula", "a*x", "--u-y", "none"], "data.csv:2: 'none' is missing"),
    ],
)
def test_what_is_missing_is_one_line_with_the_option(
    table: Path, arguments: list[str], says: str
) -> None:
    assert re.search(says, told("fit", table, *arguments, "--out", table.parent / "out"))
    assert not (table.parent / "out").exists()


def test_options_of_a_table_do_not_go_with_a_campaign(table: Path) -> None:
    for option in (["--formula", "a*x"], ["--columns", "a,b"]):
        assert re.search(
            "a campaign (it )?is stated in (its|the) file",
            told("fit", table.with_suffix(".toml"), *option),
        )


def test_units_of_the_header_are_those_of_the_column_that_is_read(table: Path) -> None:
    table.write_text("t [ms],t,y [V],u_y [mV]\n0.5,1,2,5\n1,2,3,5\n2,3,4,5\n3,4,5.1,5\n")
    assert 'x = {column = "t"}\n' in text_of_table(
        table, TableChoices(formula="a*x", x="t", y="y", u_y="0.1")
    )
    assert 'x = {column = "t [ms]", name = "t", unit = "ms"}' in text_of_table(
        table, TableChoices(formula="a*x", x="t [ms]", y="y", u_y="0.1")
    )
    for u_y in ([], ["--u-y", "u_y"]):
        said = told("fit", table, "--formula", "a*x", "--x", "t", "--y", "y", *u_y)
        assert re.search(r"data.csv:1: 'u_y( \[mV\])?' must be in the unit of 'y', V", said)


def test_columns_that_must_be_named_are_listed(table: Path) -> None:
    table.write_text("t,a,b\n0.5,1,2\n1,2,3\n2,3,4\n")
    assert r"'column' must be named by --y (there are t, a, b)" in told(
        "fit", table, "--formula", "k*t"
    )
    table.write_text("t,U,u_U\n0.5,1,0.1\n1,2,0.1\n2,3,0.2\n")
    assert 'u_y = {column = "u_U"}' in text_of_table(table, TableChoices(formula="k*t"))
    table.write_text("t,U,u_t,u_U\n0.5,1,0.1,0.1\n1,2,0.1,0.1\n2,3,0.1,0.2\n")
    assert 'u_x = {column = "u_t"}' in text_of_table(table, TableChoices(formula="k*t"))
    assert "u_x" not in text_of_table(table, TableChoices(formula="k*t", correlated=True))
    assert "u_x = 0.2\n" in text_of_table(table, TableChoices(formula="k*t", u_x="0.2"))


def test_the_command_of_the_page_gives_what_was_put_in(project: Path, tmp_path: Path) -> None:
    page, data = (project / "docs" / "your-own-curve.md").read_text(), project / "data" / "trials"
    (formula,) = re.findall(
        r'estim fit data/trials/theta_min\.csv --formula "(.*?)" --start gamma=0\.3 --low '
        r"gamma=0\.15",
        page,
    )
    choices = TableChoices(
        formula=formula, start={"gamma": "0.3"}, low={"gamma": "0.15"}, kind="synthetic"
    )
    problem = campaign_of_table(data / "theta_min.csv", choices).problem(["theta_min"])
    assert problem.runs[0].noise.x_gain()[0] == 0.4
    fit = fit_optimum(problem, rng=np.random.default_rng(1))
    assert abs(fit.values[0] - 0.187) < 3.0 * fit.sds[0]
    assert f"{fit.values[0]:.2f}" == "0.18"


def test_a_campaign_says_how_its_tables_are_written(table: Path) -> None:
    (table.parent / "raw.txt").write_text(
        "top\n" + "".join(f"{i},5 {2 * i},25 9,5\n" for i in range(6))
    )
    head = 'title = "T"\nkind = "synthetic"\n[curve]\nexpression = "a*x + b"\nx = "t"\ny = "U"\n'
    text = (
        head + "[curve.parameters]\na = {start = 1.0}\nb = {start = 1.0}\n[[runs]]\nname = "
        '"r"\nfile = "raw.txt"\n'
    )
    path = table.parent / "c.toml"
    path.write_text(
        text + 'columns = ["t", "U", "_"]\nskip_rows = 1\ndecimal = "comma"\ndelimiter = "blank"\n'
    )
    np.testing.assert_array_equal(
        load_campaign(path).tables["r"].columns["U"], 2 * np.arange(6) + 0.25
    )
    for key, says in (
        ("skip_rows = -1", r"c\.toml:14: 'skip_rows' must be"),
        ('columns = ["t", "t"]', r"c\.toml:14: 'columns' must name"),
        ('decimal = "dot"', r"c\.toml:14: 'decimal' "),
    ):
        path.write_text(f"{text}\n{key}\n")
        with pytest.raises(InputError, match=says):
            load_campaign(path)


def test_a_track_has_both_coordinates_and_those_along_its_way(tmp_path: Path) -> None:
    points = {n: (100.0 + 50.0 * 0.3 * n, 200.0 - 50.0 * 0.4 * n) for n in range(12)}
    (tmp_path / "clip.trk").write_text(trk(point_mass("ball", points)))
    for y, factor in (("x", 0.3), ("y", 0.4), ("x_m", 0.5)):
        choices = TableChoices(formula="a + v*t", y=y, release="0.08" if y == "x_m" else None)
        run = campaign_of_table(tmp_path / "clip.trk", choices).problem(["clip"]).runs[0]
        start = 2 if y == "x_m" else 0
        np.testing.assert_allclose(run.x, 0.04 * np.arange(start, 12), atol=1e-12)
        np.testing.assert_allclose(run.y, factor * np.arange(12 - start), atol=1e-9)
    assert "'--y' must name a column of the track" in told(
        "fit", tmp_path / "clip.trk", "--formula", "a*t"
    )
    with pytest.raises(InputError, match=r"'v' is missing \(a track has t, x, y, frame"):
        campaign_of_table(tmp_path / "clip.trk", TableChoices(formula="a*t", y="v"))


def test_new_writes_a_campaign_that_can_be_fit_and_overwrites_nothing(table: Path) -> None:
    folder = table.parent / "new"
    folder.mkdir()
    done = runner().invoke(
        cli, ["new", str(folder / "c"), "--from", str(table)], standalone_mode=False
    )
    assert done.exception is None, done.exception
    text = (folder / "c.toml").read_text()
    assert text.startswith("# Columns of numbers in data.csv: time [s], U (V)\n")
    assert 'file = "../data.csv"' in text
    assert load_campaign(folder / "c.toml").problem(["data"]).names == ("a", "b", "sigma_y[data]")
    assert "is there already and is not overwritten" in told("new", folder / "c", "--from", table)
    assert (folder / "c.toml").read_text() == text
    assert "'--from' must name the table" in told("new", folder / "d")
    assert "cannot be read" in told("new", folder / "d", "--from", folder / "none.csv")
    assert not (folder / "d.toml").exists()


@pytest.mark.parametrize("name", ["", "."])
def test_new_needs_the_name_of_a_file(name: str, table: Path) -> None:
    assert "'NAME' must be the name of a file" in told("new", name, "--from", table)


def test_new_asks_in_a_terminal(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("estim.cli.new._in_a_terminal", lambda: True)
    answers = "\n".join([str(table), "time", "U", FORMULA, "0.02", "tau=2", "Discharge"]) + "\n"
    done = runner().invoke(
        cli, ["new", str(table.parent / "c.toml")], input=answers, standalone_mode=False
    )
    assert done.exception is None, done.output
    assert "columns: time [s], U (V)" in done.output
    loaded = load_campaign(table.parent / "c.toml")
    assert (loaded.title, loaded.problem(["data"]).names) == ("Discharge", ("a", "tau", "c"))


@pytest.mark.slow
@pytest.mark.parametrize(("bump", "fits"), [(0.0, True), (0.1, False)])
def test_of_many_points_a_wrong_curve_is_found_block_by_block(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, bump: float, fits: bool
) -> None:
    monkeypatch.setattr("estim.checks.goodness_of_fit._MOST_AT_ONCE", 3500 * 70)
    x = np.linspace(0.0, 1.0, 3500)
    y = 1.0 + 2.0 * x + bump * np.sin(9.0 * x) + rng.standard_normal(x.size)
    fit = fit_curve("a + b*x", x, y, u_y=1.0, start={"a": 1.0, "b": 1.0})
    assert (fit.status == "ok") == fits
    density = fit.fit.posterior.log_likelihood(np.tile([1.0, 2.0], (2400, 1)))
    assert density == pytest.approx(
        np.full(2400, np.sum(-0.5 * (y - 1.0 - 2.0 * x) ** 2 - 0.5 * np.log(2.0 * np.pi)))
    )


def test_what_needs_a_dense_matrix_keeps_its_limit(table: Path) -> None:
    x = np.linspace(0.0, 1.0, 3001)
    with pytest.raises(
        InputError, match=r"'x' must have between 1 and 3000 values; .*every so many"
    ):
        fit_curve("a*x", x, x, u_y=0.1, u_x=0.1, start={"a": 1.0})
    table.write_text("x,y\n" + "".join(f"{value},{value}\n" for value in x))
    with pytest.raises(
        InputError, match="'rows' must be between 3 and 3000 where x has errors: say every = 2"
    ):
        campaign_of_table(table, TableChoices(formula="a*x", u_y="0.1", u_x="0.1"))
    campaign_of_table(table, TableChoices(formula="a*x", u_y="0.1", u_x="0.1", every=2))


def test_a_word_of_the_columns_name_may_stand_for_x(tmp_path: Path) -> None:
    rows = "".join(f"{x},{2.0 * np.sqrt(x / 9.8):.4f}\n" for x in range(1, 12))
    (tmp_path / "p.csv").write_text(f"rod length l (m),10 periods (s)\n{rows}")
    for said, column in (
        ({}, "rod length l (m)"),
        ({"x": "rod length l", "y": "10 periods"}, "rod length l"),
    ):
        choices = TableChoices(formula="2*sqrt(l/g)", start={"g": "1"}, **said)
        assert f'x = {{column = "{column}", name = "rod length l", unit = "m"}}' in text_of_table(
            tmp_path / "p.csv", choices
        )
        assert campaign_of_table(tmp_path / "p.csv", choices).problem(["p"]).names[0] == "g"


def test_a_track_without_a_column_of_y_is_told_which_there_are(tmp_path: Path) -> None:
    (tmp_path / "a.trk").write_text(
        trk(point_mass("A", {n: (100.0 + n * n, 150.0) for n in range(8)}))
    )
    with pytest.raises(
        InputError, match=r"'--y' must name a column of the track: x or y .* or x_m"
    ):
        campaign_of_table(tmp_path / "a.trk", TableChoices(formula="a + b*t"))
    assert (
        campaign_of_table(tmp_path / "a.trk", TableChoices(formula="a + b*t", y="x_m"))
        .problem(["a"])
        .n_obs
        == 8
    )


AXES = [
    ("t [s],x [m]", "v*t + b", ("t [s]", "x [m]")),
    ("t [s],x [m]", "line", ("t [s]", "x [m]")),
    ("t [s],y", "v*x + b", ("t [s]", "y")),
    ("x [m],t [s]", "v*x + b", ("x [m]", "t [s]")),
    ("x [m],t [s]", "v*t + b", ("t [s]", "x [m]")),
    ("y,x", "v*x + b", ("x", "y")),
    ("y,x", "line", ("x", "y")),
    ("U,I", "G*x + I0", ("U", "I")),
    ("U,I", "R*I", ("I", "U")),
    ("t,T", "v*t + b", ("t", "T")),
    ("t [s],T [K]", "t*T0 + b", ("t [s]", "T [K]")),
]


@pytest.mark.parametrize(("header", "formula", "axes"), AXES)
def test_of_two_columns_the_first_is_x_unless_the_names_or_the_formula_say_another(
    tmp_path: Path, header: str, formula: str, axes: tuple[str, str]
) -> None:
    (tmp_path / "two.csv").write_text(
        header + "\n" + "".join(f"{0.5 * i:g},{0.8 * i + 0.01 * (i % 3):g}\n" for i in range(9))
    )
    posed = campaign_of_table(tmp_path / "two.csv", TableChoices(formula=formula))
    assert (posed.x_column, posed.y_column) == axes


@pytest.mark.parametrize(
    ("header", "formula"),
    [
        ("t [s],x [m]", "v*x + b"),
        ("t_s,x_m", "v*x + b"),
        ("t,X", "v*x + b"),
        ("y,t", "line"),
        ("x,y", "a*y + b"),
        ("U,I", "a*U + b*I"),
    ],
)
@pytest.mark.parametrize("command", ["fit", "new"])
def test_where_formula_and_header_disagree_one_line_asks_and_the_answer_is_taken(
    tmp_path: Path, command: str, header: str, formula: str
) -> None:
    file = tmp_path / "two.csv"
    file.write_text(
        header + "\n" + "".join(f"{0.5 * i:g},{0.8 * i + 0.01 * (i % 3):g}\n" for i in range(9))
    )
    said = told(
        *(["fit", file] if command == "fit" else ["new", tmp_path / "n", "--from", file]),
        "--formula",
        formula,
    )
    first, second = header.split(",")
    assert f"{file}:1: 'x' may be either column" in said
    assert f'(--x "{first}" --y "{second}", or --x "{second}" --y "{first}")' in said
    if formula == "v*x + b":
        for x, y in ((first, second), (second, first)):
            posed = campaign_of_table(file, TableChoices(formula=formula, x=x, y=y))
            assert (posed.x_column, posed.y_column) == (x, y)


@pytest.mark.slow
def test_the_first_line_says_which_column_is_which_and_what_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "iv.csv"
    file.write_text(
        "U [V],u_U [V],I [mA],u(I) [mA],T\n"
        + "".join(f"{i},0.1,{2 * i + 0.1 * (-1) ** i},0.2,{i * i}\n" for i in range(9))
    )
    out = ["--out", str(tmp_path / "out"), "--figures", "none"]
    first = "columns: x = U (V), y = I (mA), u_y = u(I) (mA), u_x = u_U (V); columns not used: T"
    done = runner().invoke(
        cli,
        ["fit", str(file), "--formula", "a + b*x", "--x", "U", "--y", "I", *out],
        standalone_mode=False,
    )
    assert done.stdout.splitlines()[0] == first
    done = runner().invoke(
        cli, ["new", str(tmp_path / "iv"), "--from", str(file)], standalone_mode=False
    )
    assert done.stdout.splitlines()[0] == first
    done = runner().invoke(cli, ["fit", str(tmp_path / "iv.toml"), *out], standalone_mode=False)
    assert done.stdout.splitlines()[0] == first
    done = runner().invoke(
        cli, ["line", str(file), "--x", "U", "--y", "I", *out], standalone_mode=False
    )
    assert (
        done.stdout.splitlines()[0]
        == "columns: x = U (V), y = I (mA), u_x = u_U (V), u_y = u(I) (mA); columns not used: T"
    )


def test_a_first_guess_takes_no_uncertainties_for_y_and_keeps_them(tmp_path: Path) -> None:
    file = tmp_path / "iv.csv"
    file.write_text(
        "U [V],u_U [V],I [mA],u_I [mA]\n"
        + "".join(f"{i},0.1,{2 * i + 0.1 * (-1) ** i},0.2\n" for i in range(9))
    )
    assert runner().invoke(cli, ["new", str(tmp_path / "iv"), "--from", str(file)]).exit_code == 0
    lines = (tmp_path / "iv.toml").read_text().splitlines()
    for line in (
        'y = {column = "I [mA]", name = "I", unit = "mA"}',
        'u_y = {column = "u_I [mA]"}',
        'u_x = {column = "u_U [V]"}',
    ):
        assert line in lines
    assert not any("found from the residuals" in line for line in lines)
    file.write_text("U,u_U\n1,2\n2,3\n3,5\n")
    assert "has fewer than two columns of numbers that are not uncertainties" in told(
        "new", tmp_path / "other", "--from", file
    )


def test_a_column_is_there_though_its_first_and_last_cells_are_empty(tmp_path: Path) -> None:
    file = tmp_path / "gaps.csv"
    cells = [
        f"{i},{2 * i + 0.1 * (-1) ** i},{'' if i in (0, 8) else i * i},"
        f"{'good' if i % 2 else i}{'!' if i == 4 else ''}"
        for i in range(9)
    ]
    file.write_text("x,a,b,remark\n" + "\n".join(cells) + "\n")
    assert "must be named by --y (there are x, a, b, remark)" in told(
        "fit", file, "--formula", "p + q*x"
    )
    done = runner().invoke(cli, ["new", str(tmp_path / "n"), "--from", str(file)])
    assert "; columns not used: b, remark" in done.output.splitlines()[0]


def test_a_title_that_is_too_long_is_refused_by_its_name(table: Path) -> None:
    title = 2100 * "x"
    assert told("fit", table, "--formula", "a*x", "--title", title).startswith("'--title' must")


@pytest.mark.parametrize("command", [["fit", "--formula", "a + b*x"], ["line"]])
def test_a_copied_row_is_told_where_the_result_is(tmp_path: Path, command: list[str]) -> None:
    file = tmp_path / "twice.csv"
    rows = [f"{i},{2 * i + 0.1 * (-1) ** i}" for i in range(9)]
    for lines, told in ((rows, False), ([*rows[:4], *rows[3:]], True)):
        file.write_text("t,y\n" + "\n".join(lines) + "\n")
        done = runner().invoke(
            cli,
            [
                command[0],
                str(file),
                *command[1:],
                "--out",
                str(tmp_path / "out"),
                "--figures",
                "none",
            ],
            standalone_mode=False,
        )
        assert (
            "rows identical to an earlier one: 6 (a copy is counted twice, so remove it)"
            in done.output
        ) == told, done.output


@pytest.mark.parametrize("said", [["--x", "x"], ["--y", "x"], []])
def test_two_columns_of_one_name_are_refused_in_one_line(tmp_path: Path, said: list[str]) -> None:
    (tmp_path / "twice.csv").write_text("x;x\n1;2.1\n2;3.9\n3;6.2\n4;8.1\n")
    for command in (["fit", "--formula", "a*x"], ["line"], ["new", str(tmp_path / "n"), "--from"]):
        where = (
            [command[0], tmp_path / "twice.csv", *command[1:]]
            if command[0] != "new"
            else [*command, tmp_path / "twice.csv"]
        )
        line = told(*where, *said)
        rules = (
            "must be named by",
            "occurs twice in the header",
            "may be either column",
            "must name another column",
            "fewer than two columns",
        )
        assert any(rule in line for rule in rules), line


def test_a_misspelt_model_is_no_constant_of_that_name(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("x,y\n1,2\n2,3\n3,5\n4,4\n5,6\n")
    for formula in ("gausian", "gausian + line"):
        with pytest.raises(InputError, match=r"must name a model \(did you mean 'gaussian'\?\)"):
            text_of_table(file, TableChoices(formula=formula))
    assert 'expression = "mean"' in text_of_table(
        file, TableChoices(formula="mean", start={"mean": "3"})
    )
    assert 'expression = "x + b"' in text_of_table(file, TableChoices(formula="x + b"))


# ---- a disk that rolled, in place of a formula ----

ROLLED = {
    "radius_m": "0.15(1)",
    "gamma": "0.19(1)",
    "phi_deg": "4.0(4)",
    "theta0_deg": "60(2)",
    "sigma_x_m": "0.001",
}


def rolled(file: Path, **said: str) -> Campaign:
    choices = {key: said.pop(key) for key in ("x", "y", "track", "release") if key in said}
    return campaign_of_table(file, TableChoices(formula="", rolling=ROLLED | said, **choices))


@pytest.mark.parametrize("run", ["heavy-02", "heavy-08", "light-01"])
def test_a_rolling_disk_by_options_is_the_run_of_the_campaign(replica: Path, run: str) -> None:
    """The density of a run of the replica at random values, by its file and by options."""
    wanted = load_campaign(replica / "campaign.toml", only=run)
    table = tomllib.loads((replica / "campaign.toml").read_text())
    (row,) = (row for row in table["runs"] if row["name"] == run)
    said = {key: row[key] for key in ("phi_deg", "theta0_deg")}
    said |= {key: v for key, v in table["bodies"][row["body"]].items() if key != "kappa"}
    said |= {"kappa": "0:1", "radius_m": "0.14929(50)", "g": "9.81", "ramp_length_m": "0.877"}
    said |= {"sigma_x_m": "0.001", "derivative": "central"}
    file = replica / "runs" / f"{run}.csv"

    def densities(said: dict[str, str]) -> np.ndarray:
        choices = TableChoices(formula="", rolling=said, x="t_s", y="x_m")
        made, ours = (c.problem([run]) for c in (campaign_of_table(file, choices), wanted))
        names = [name.replace(f"[{row['body']}]", "[disk]") for name in ours.names]
        order = [names.index(name) for name in made.names]
        start = ours.start()
        values = start * (1.0 + 0.01 * np.random.default_rng(1).standard_normal((20, start.size)))
        one = ours.linearised(start).log_density(values)
        return np.array([one, made.linearised(start[order]).log_density(values[:, order])])

    one, other = densities(said)
    assert np.isfinite(one).all()
    assert np.allclose(one, other, rtol=1e-12)
    one, other = densities(said | {"sigma_x_m": "0.002"})
    assert not np.allclose(one, other)


def test_columns_of_a_rolling_disk_are_called_by_what_they_are(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 30)
    rows = "\n".join(f"{i},{a:.4f},{0.2 * a * a:.5f},{0.4 * a:.5f}" for i, a in enumerate(t))
    for head, x, y, read in (
        ("no,time [s],way [m],v [m/s]", "time", "way", {"t_s", "x_m"}),
        ("no,time [s],way [m],v [m/s]", "way [m]", "v [m/s]", {"x_m", "v_m_s"}),
        ("no,t,x,v", "x", "v", {"x_m", "v_m_s"}),
        ("no,t,x_m,speed", "t", "x_m", {"t_s", "x_m"}),
    ):
        file = tmp_path / "run.csv"
        file.write_text(f"{head}\n{rows}\n")
        speeds = {"sigma_v_m_s": "0.01"} if "v_m_s" in read else {}
        said = {key: v for key, v in ROLLED.items() if not speeds or key != "sigma_x_m"}
        choices = TableChoices(formula="", rolling=said | speeds, x=x, y=y)
        campaign = campaign_of_table(file, choices)
        assert set(campaign.tables["run"].columns) == read
    file.write_text(f"no,t [s],x [cm],v\n{rows}\n")
    with pytest.raises(InputError, match="'--y' must be in m: nothing is converted"):
        rolled(file, x="t", y="x")
    with pytest.raises(InputError, match="is no column"):
        rolled(file, x="t", y="z")


def test_what_is_wrong_of_a_rolling_disk_names_its_key(replica: Path) -> None:
    file = replica / "runs" / "heavy-04.csv"
    for said, field in (
        ({"radius_m": "0.15 cm"}, "radius_m"),
        ({"radius_m": "-1"}, "radius_m"),
        ({"kappa": "0:x"}, "kappa"),
        ({"kappa": "1:0"}, "kappa"),
        ({"kappa": '{prior = "normal", mean = 0.5}'}, "kappa"),
        ({"kappa": '{prior = "normal" mean}'}, "kappa"),
        ({"radius_mm": "1"}, "radius_mm"),
        ({"model": "wrong"}, "model"),
        ({"x_max_m": "far"}, "x_max_m"),
        ({"theta0_rad": "1"}, "theta0_rad"),
    ):
        with pytest.raises(InputError) as refused:
            rolled(file, **said)
        assert field in str(refused.value), said
    assert told("fit", file, "--rolling", "kappa={") == "'kappa' is not valid TOML: {"
    words = told("fit", file, "--rolling", "radius_m=0.15(1)", "--u-y", "0.1")
    assert words == "'--u-y' cannot be combined with --rolling"
    assert "'--rolling' must be written NAME=VALUE" in told("fit", file, "--rolling", "0.15")


def test_a_campaign_to_begin_with_for_a_rolling_disk(replica: Path, tmp_path: Path) -> None:
    file = replica / "runs" / "heavy-04.csv"
    said = [word for key, text in ROLLED.items() for word in ("--rolling", f"{key}={text}")]
    done = runner().invoke(cli, ["new", str(tmp_path / "c"), "--from", str(file), *said])
    assert done.exit_code == 0, done.output
    assert "guess" not in done.output
    text = (tmp_path / "c.toml").read_text()
    assert 'kappa = {prior = "uniform", low = 0.0, high = 1.0}' in text
    assert "noise = {sigma_x_m = 0.001}" in text
    made = load_campaign(tmp_path / "c.toml").problem(["heavy-04"])
    assert made.names == rolled(file).problem(["heavy-04"]).names


@pytest.mark.skipif(not REAL.is_dir(), reason="the real recordings are not here")
@pytest.mark.parametrize(
    ("name", "unit"), [("rolling_ball/kulefullbane.txt", "cm"), ("viscosity/CIMG9886.trk", "m")]
)
def test_a_real_recording_as_a_rolling_disk(name: str, unit: str) -> None:
    campaign = rolled(REAL / name, unit=unit)
    (run,) = campaign.tables.values()
    assert run.imported
    assert run.columns["x_m"][0] == 0.0
    with pytest.raises(InputError, match="goes with a table"):
        rolled(REAL / name, y="x")


# ---- several tables with one curve ----


@pytest.fixture
def two(tmp_path: Path, rng: np.random.Generator) -> list[Path]:
    """Tables of one decay from 2.0 and from 3.0, the second in a folder of its own."""
    files = [tmp_path / "cup.csv", tmp_path / "later" / "cup.csv"]
    files[1].parent.mkdir()
    t = np.linspace(0.0, 10.0, 31)
    for file, size in zip(files, (2.0, 3.0), strict=True):
        u = size * np.exp(-t / 3.0) + 0.5 + 0.02 * rng.standard_normal(t.size)
        rows = "\n".join(f"{a:.4f},{b:.6f}" for a, b in zip(t, u, strict=True))
        file.write_text(f"t [s],U [V]\n{rows}\n")
    return files


def test_several_tables_share_all_parameters_but_those_of_their_own(
    two: list[Path], rng: np.random.Generator
) -> None:
    choices = TableChoices(formula="a*exp(-t/tau) + c", own=("a", "a"), u_y="0.02")
    problem = campaign_of_table(two[0], choices, two[1]).problem(["cup", "cup-2"])
    assert problem.names == ("tau", "c", "a[cup]", "a[cup-2]")
    fit = fit_problem(problem, rng=rng)
    found = dict(zip(problem.names, zip(fit.values, fit.sds, strict=True), strict=True))
    for name, truth in {"a[cup]": 2.0, "a[cup-2]": 3.0, "tau": 3.0, "c": 0.5}.items():
        value, sd = found[name]
        assert abs(value - truth) < 4.0 * sd, name
    # one value for both is a wrong model
    alike = campaign_of_table(two[0], TableChoices(formula=choices.formula, u_y="0.02"), two[1])
    wrong = fit_problem(alike.problem(["cup", "cup-2"]), rng=rng)
    assert wrong.values.size == 3
    assert wrong.chi2 > 100.0 * fit.chi2


def test_a_file_gives_its_run_a_name_that_no_other_has() -> None:
    files = [Path(name) for name in ("a.csv", "a-2.csv", "b/A.csv", "a.txt", "report.csv", "+.csv")]
    assert run_names(files) == ["a", "a-2", "A-3", "a-4", "report-run", "run"]


@pytest.mark.slow
def test_one_line_fits_tables_jointly_as_the_campaign_that_its_report_prints(
    two: list[Path],
) -> None:
    folder = two[0].parent
    curve = ["--formula", FORMULA, "--own", "a", "--u-y", "0.02"]
    said = ["--joint", "--figures", "none", "--out"]
    done = runner().invoke(cli, ["fit", *map(str, two), *curve, *said, str(folder / "one")])
    assert done.exit_code == 0, done.output
    report = (folder / "one" / "report.md").read_text()
    assert "`estim fit --joint` gives the same result from it" in report
    (text,) = re.findall("```toml\n(.*?)```", report, re.DOTALL)
    (folder / "both.toml").write_text(text)
    done = runner().invoke(cli, ["fit", str(folder / "both.toml"), *said, str(folder / "two")])
    assert done.exit_code == 0, done.output
    one, other = (
        json.loads((folder / out / "result.json").read_text())["parameters"]
        for out in ("one", "two")
    )
    assert one == other
    assert set(one) == {"a[cup]", "a[cup-2]", "tau", "c"}
    made = ["new", folder / "n", *(f"--from={file}" for file in two), *curve]
    assert runner().invoke(cli, list(map(str, made))).exit_code == 0
    problem = load_campaign(folder / "n.toml").problem(["cup", "cup-2"])
    assert problem.names == tuple(one)


def test_what_does_not_go_with_several_tables_is_refused(two: list[Path], tmp_path: Path) -> None:
    assert "'FILE...' goes with --formula and tables" in told("fit", *two)
    assert "'--own' needs --joint" in told("fit", *two, "--formula", FORMULA, "--own", "a")
    said = ("--formula", FORMULA, "--joint")
    assert "names no parameter" in told("fit", *two, *said, "--own", "q")
    (tmp_path / "c.toml").write_text("")
    assert "needs a table of points" in told("fit", two[0], tmp_path / "c.toml", *said)
    assert "'FILE...' must name each table once" in told("fit", *two, two[0], *said)
    two[1].write_text(two[1].read_text().replace("[s]", "[ms]"))
    assert "'t [s]' is missing (the header has t [ms], U [V])" in told("fit", *two, *said)
    assert "must be in ms, as the header of" in told("fit", *two, *said, "--x", "t", "--y", "U")


def test_times_of_events_and_numbers_of_successes_need_no_campaign(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    times = rng.exponential(2.2, 2000)
    times = times[times < 10.0]
    (tmp_path / "times.csv").write_text("t_us\n" + "\n".join(f"{t:.6f}" for t in times))
    events = TableChoices(formula="exp(-t/tau)", start={"tau": "2"}, noise="event-times")
    fit = fitted(tmp_path / "times.csv", replace(events, window=(0.0, 10.0)))
    noise = EventTimes(0.0, 10.0)
    alone = fit_curve("exp(-x/tau)", np.round(times, 6), None, noise=noise, start={"tau": 2.0})
    assert fit.named["tau"] == pytest.approx(alone.values["tau"], rel=1e-6)

    dose, shots = np.linspace(-3.0, 3.0, 13), rng.integers(20, 60, 13)
    dead = rng.binomial(shots, 1.0 / (1.0 + np.exp(-(dose - 0.4) / 0.8)))
    rows = "\n".join(f"{x},{k},{n}" for x, k, n in zip(dose, dead, shots, strict=True))
    (tmp_path / "doses.csv").write_text(f"dose,dead,shots\n{rows}\n")
    logistic, start = "1/(1 + exp(-(x - m)/s))", {"m": "0", "s": "1"}
    counted = TableChoices(formula=logistic, start=start, noise="binomial", trials="shots")
    fit = fitted(tmp_path / "doses.csv", counted)  # the column of trials is no y
    alone = fit_curve(logistic, dose, dead, noise=Binomial(shots), start={"m": 0.0, "s": 1.0})
    for name, value in alone.values.items():
        assert fit.named[name] == pytest.approx(value, rel=1e-6)
    for wrong, rule in (
        (replace(counted, trials=None), "must say how many trials"),
        (replace(counted, noise=None), "goes with --noise binomial"),
    ):
        with pytest.raises(InputError, match=f"'--trials' {rule}"):
            campaign_of_table(tmp_path / "doses.csv", wrong)


def fitted(table: Path, choices: TableChoices) -> Fit:
    campaign = campaign_of_table(table, choices)
    return fit_problem(campaign.problem(list(campaign.runs)), rng=np.random.default_rng(1))
