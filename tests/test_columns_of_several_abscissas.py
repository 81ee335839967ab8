"""Curves of several abscissas at the command line and in campaign files."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_runner import runner

from estim import InputError, fit_curve
from estim.campaign import TableChoices, campaign_of_table, load_campaign
from estim.campaign.campaign import Campaign
from estim.cli.commands import cli
from estim.common.errors import EstimError
from estim.fitting import fit_problem
from estim.reports.curve_figures import abscissas_figure, phase_figure

U, V = (grid.ravel() for grid in np.meshgrid(np.linspace(-3, 3, 9), np.linspace(-2, 2, 8)))
PLANE = "a*u + b*v + c"


def written(path: Path, head: str, *columns: Any) -> Path:
    rows = zip(*columns, strict=True)
    path.write_text(head + "\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows))
    return path


@pytest.fixture
def plane(tmp_path: Path) -> Path:
    z = 2.0 * U - V + 0.5 + 0.2 * np.random.default_rng(1).standard_normal(U.size)
    return written(tmp_path / "plane.csv", "u [mm],v [K],z [V]", U, V, z)


def run(*arguments: object) -> Any:
    return runner().invoke(cli, [str(argument) for argument in arguments], standalone_mode=False)


def told(*arguments: object) -> str:
    """The one line that a command is refused with."""
    done = run(*arguments)
    assert isinstance(done.exception, EstimError), done.output
    return str(done.exception)


def fitted(campaign: Campaign) -> Any:
    return fit_problem(campaign.problem([*campaign.tables]), rng=np.random.default_rng(1))


def test_a_plane_at_the_command_line_is_the_linear_regression(plane: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("fit", plane, "--formula", PLANE, "--u-y", 0.2, "--out", out)
    assert done.exception is None, done.output
    assert done.output.startswith("columns: u = u (mm), v = v (K), y = z (V)\nplane: ok")
    z = np.loadtxt(plane, delimiter=",", skiprows=1)[:, 2]
    design = np.column_stack([U, V, np.ones(U.size)])
    best = np.linalg.lstsq(design, z)[0]
    sds = 0.2 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    result = json.loads((out / "result.json").read_text())
    for i, name in enumerate("abc"):
        told = result["parameters"][name]
        assert result["fit"]["values"][name] == pytest.approx(best[i], abs=1e-6)
        assert told["mean"] == pytest.approx(best[i], abs=0.1 * sds[i])
        assert told["sd"] == pytest.approx(sds[i], rel=0.05)
    units = [result["parameters"][name]["unit"] for name in "abc"]
    assert units == ["V/mm", "V/K", "V"]
    report = (out / "report.md").read_text()
    assert "with u (mm), v (K) as abscissas and y = z (V)." in report
    assert {p.name for p in (out / "figures").iterdir()} == {"phase.png", "abscissas.png"}
    assert run("verify", out).exit_code == 0


def test_the_campaign_in_the_report_gives_the_same_numbers(plane: Path, tmp_path: Path) -> None:
    arguments = ("--u-y", "0.2", "--figures", "none", "--out")
    assert run("fit", plane, "--formula", PLANE, *arguments, tmp_path / "one").exception is None
    (text,) = re.findall(r"```toml\n(.*?)```", (tmp_path / "one/report.md").read_text(), flags=re.S)
    assert 'x = [{column = "u [mm]", name = "u", unit = "mm"}, ' in text
    (tmp_path / "kept.toml").write_text(text)
    two = tmp_path / "two"
    assert run("fit", tmp_path / "kept.toml", "--figures", "none", "--out", two).exception is None
    first, second = (
        json.loads((tmp_path / name / "result.json").read_text())["parameters"]
        for name in ("one", "two")
    )
    assert first == second
    assert run("verify", two).exit_code == 0


def test_figures_are_against_the_fitted_value_and_each_abscissa(plane: Path) -> None:
    from estim import Target, analyse

    campaign = campaign_of_table(plane, TableChoices(formula=PLANE, u_y="0.2"))
    analysis = analyse(campaign, ["plane"], seed=1, target=Target(ess=400.0))
    top, low = phase_figure(analysis).axes[:2]
    z = np.loadtxt(plane, delimiter=",", skiprows=1)[:, 2]
    design = np.column_stack([U, V, np.ones(U.size)])
    curve = design @ np.linalg.lstsq(design, z)[0]
    line, points = (top.lines[i].get_xydata() for i in (0, 1))
    assert np.asarray(line)[:, 0] == pytest.approx(np.asarray(line)[:, 1])
    assert np.asarray(points) == pytest.approx(np.column_stack([curve, z]), abs=1e-6)
    assert low.get_xlabel() == "fitted value (V)"
    for ax, label, x in zip(
        abscissas_figure(analysis).axes, ("u (mm)", "v (K)"), (U, V), strict=True
    ):
        assert ax.get_xlabel() == label
        rest = np.asarray(ax.lines[1].get_xydata())
        assert rest == pytest.approx(np.column_stack([x, z - curve]), abs=1e-6)


def test_a_decay_of_time_and_temperature_is_that_of_python(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    t, theta = np.linspace(0.0, 10.0, 60), rng.uniform(20.0, 80.0, 60)
    y = 3.0 * np.exp(-t / 4.0) + 0.02 * theta + 0.05 * rng.standard_normal(60)
    table = written(tmp_path / "decay.csv", "t (s),theta (°C),y,u_y", t, theta, y, 0.05 + 0.0 * t)
    formula = "a*exp(-t/tau) + b*theta"
    choices = TableChoices(formula=formula, x="t", further_x=["theta"], start={"tau": "3 s"})
    fit = fitted(campaign_of_table(table, choices))
    same = fit_curve(formula, {"t": t, "theta": theta}, y, u_y=0.05, start={"tau": 3.0})
    assert fit.values == pytest.approx([same.values[name] for name in fit.names], rel=1e-5)
    command = ("fit", table, "--formula", formula, "--out", tmp_path / "out", "--x", "t")
    assert "or --start tau=...)" in told(*command, "--x", "theta")
    # t is the abscissa of a formula that names it: theta then is a parameter, and this is told
    assert "'b' is not determined by the data, nor is 'theta'" in told(*command)
    assert "to use the column theta as an abscissa" in told(*command)
    done = run(*command, "--value", "b=0.02", "--figures", "none")
    assert "read as a parameter, although the table has a column of that name: theta" in done.output


def test_runs_share_parameters(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    files = [
        written(tmp_path / f"{name}.csv", "u,v,z", U, V, 2 * U - V + c + rng.normal(0, 0.2, U.size))
        for name, c in (("one", 0.5), ("two", 3.0))
    ]
    choices = TableChoices(formula=PLANE, own=["c"], u_y="0.2")
    campaign = campaign_of_table(files[0], choices, files[1])
    fit = fitted(campaign)
    z = [np.loadtxt(file, delimiter=",", skiprows=1)[:, 2] for file in files]
    one, none = np.ones(U.size), np.zeros(U.size)
    design = np.column_stack([np.tile(U, 2), np.tile(V, 2), [*one, *none], [*none, *one]])
    assert fit.names == ("a", "b", "c[one]", "c[two]")
    assert fit.values == pytest.approx(np.linalg.lstsq(design, np.concatenate(z))[0], abs=1e-6)


def test_a_wrong_surface_is_refused(tmp_path: Path) -> None:
    z = 2.0 * U - V + 0.15 * U * V + np.random.default_rng(1).normal(0.0, 0.2, U.size)
    table = written(tmp_path / "saddle.csv", "u,v,z", U, V, z)
    for formula, code in ((PLANE, 3), (f"{PLANE} + d*u*v", 0)):
        command = ("fit", table, "--formula", formula, "--u-y", 0.2, "--figures", "none")
        assert run(*command, "--out", tmp_path / "out").exit_code == code


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--window 0:1", "'window' cannot be combined with several abscissas"),
        ("--u-x 0.1 --u-y 0.1", "'u_x' cannot be combined with several abscissas"),
        ("--deviation 0.1", "'deviation' cannot be combined with several abscissas"),
        ("--x u --x w --y z", "'x' must appear in the formula under exactly one name .*: w"),
        ("--x u --x u --y z", "'x' must appear in the formula under exactly one name .*: u"),
        ("--x u --x v --start v=1", "'x' must appear in the formula under exactly one name .*: v"),
        ("--start q=1", "'--start' names no parameter of the formula"),
    ],
)
def test_what_does_not_go_together_is_refused(plane: Path, options: str, words: str) -> None:
    command = ("fit", plane, "--formula", PLANE, "--out", plane.parent / "out")
    assert re.search(words, told(*command, *options.split()))


@pytest.mark.parametrize(
    ("x", "formula", "words"),
    [
        ('["u"]', "a*u", "4: 'x' "),
        ('["u", "z"]', "a*u + b*z", "'y' must name another column than x"),
        ('["u", {column = "v", unit = "s"}]', "a*u + b*v", "'x' must be in K, as the header"),
        ('["u", "v"]', "a*u + b*v + x", "holds x, which is none of its abscissas"),
        ('["u", {column = "angle", unit = "°"}]', "a*u + sin(angle)", "takes radians"),
        ('["u", "v"]', "a*u + exp(b*v)", "'b' needs a starting value"),
        ('["u", "v"]\nerrors = {zero_x = 0.1}', "a*u + b*v", "5: 'errors' cannot be combined"),
    ],
)
def test_a_campaign_that_breaks_a_rule_is_told_its_line(
    plane: Path, x: str, formula: str, words: str
) -> None:
    plane.write_text(plane.read_text().replace("\n", ",1\n").replace("[V],1", "[V],angle [°]"))
    (plane.parent / "bad.toml").write_text(
        f'title = "T"\nkind = "synthetic"\n[curve]\nx = {x}\ny = "z"\n'
        f'expression = "{formula}"\n[curve.parameters]\n'
        + ("a = {}\n" if "a*" in formula else "")
        + ("b = {}\n" if "b*" in formula else "")
        + '[[runs]]\nname = "r"\nfile = "plane.csv"\n'
    )
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        load_campaign(plane.parent / "bad.toml").problem(["r"])
    assert "bad.toml:" in str(refused.value)


def test_a_row_without_a_value_is_left_out_and_a_plan_is_refused(plane: Path) -> None:
    lines = plane.read_text().splitlines()
    lines[3] = lines[3].replace(lines[3].split(",")[1], "")
    bad, out = plane.parent / "bad.csv", plane.parent / "draft"
    bad.write_text("\n".join(lines) + "\n")
    assert campaign_of_table(bad, TableChoices(formula=PLANE)).problem(["bad"]).n_obs == U.size - 1
    assert run("new", out, "--from", plane, "--formula", PLANE).exception is None
    assert "'x' must name a single column: estim plan does not handle several abscissas" in told(
        "plan", f"{out}.toml"
    )
