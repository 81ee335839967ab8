"""`--json`: every command prints one JSON object and nothing else on standard output."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from command_runner import runner
from pages import blocks
from test_hostile import body_campaign

from estim.cli.commands import cli

FOLDERS = ("everyday", "tutorial", "device", "replica/runs")
# beside what --json adds: {body} is a small campaign of a rolling body
COMMANDS = {
    "batch": ("{body}", "--max-steps", "60", "--jobs", "1"),
    "body": ("data/device/bodies.toml",),
    "calibrate": ("{body}", "--simulations", "20", "--what", "sbc", "--jobs", "1"),
    "compare-models": ("{body}", "--model", "paper", "--model", "free-start", "--max-steps", "60"),
    "diff": ("9.81(2) m/s²", "9.75(1) m/s²"),
    "energy": ("{body}", "--max-steps", "60"),
    "fit": ("data/everyday/spring.csv", "--formula", "line", "--lang", "es"),
    "import": ("data/tutorial/fall.trk", "-o", "run.csv"),
    "line": ("data/everyday/calibration.csv",),
    "map": ("{body}",),
    "mean": ("data/everyday/laboratories.csv",),
    "models": (),
    "new": ("tea", "--from", "data/tutorial/tea.csv"),
    "plan": ("{body}",),
    "propagate": ("g = 4*pi**2*L/T**2", "L=0.85(1) m", "T=1.851(3) s"),
    "reanalyse": ("{body}", "--max-steps", "60", "--jobs", "1"),
    "simulate": ("design.toml", "--out", "made"),
    "verify": ("out/laboratories",),
}
LONG = ("calibrate", "compare-models", "energy", "map", "plan", "reanalyse", "batch")
# what a result has an uncertainty of; the others tell shares, counts or files
ESTIMATED = {
    "body": "kappa",
    "diff": "difference",
    "fit": "slope",
    "line": "slope",
    "mean": "mean",
    "propagate": "g",
}
KEYS = {"schema", "command", "exit_code", "lines", "estimates", "files", "results"}


@pytest.fixture
def place(
    project: Path, replica: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, str]:
    for name in FOLDERS:
        shutil.copytree(project / "data" / name, tmp_path / "data" / name)
    shutil.copy(replica / "design.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    return {"body": str(body_campaign(tmp_path / "body", replica, "word", "r.csv"))}


def ran(command: str, *arguments: str) -> dict[str, Any]:
    """What a command prints with --json, a JSON object by RFC 8259."""

    def refused(constant: str) -> float:
        raise AssertionError(f"{constant} is no JSON")

    done = runner().invoke(cli, [command, *arguments, "--json"])
    assert done.exit_code in (0, 3), (done.stdout, done.stderr, done.exception)
    said = json.loads(done.stdout, parse_constant=refused)
    assert set(said) == KEYS
    assert (said["command"], said["exit_code"]) == (command, done.exit_code)
    return said


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=[pytest.mark.slow] if c in LONG else []) for c in COMMANDS]
)
def test_every_command_prints_one_object_with_estimates_units_and_files(
    command: str, place: dict[str, str]
) -> None:
    if command == "verify":
        ran("mean", *COMMANDS["mean"])
    said = ran(command, *(word.format(**place) for word in COMMANDS[command]))
    assert said["lines"]
    assert all(isinstance(line, str) and "\n" not in line for line in said["lines"])
    assert command in ("diff", "models", "verify") or said["files"]
    for file in said["files"]:
        assert Path(file).is_file()
        assert (
            not file.endswith(".json")
            or json.loads(Path(file).read_bytes()) == (said["results"][file])
        )
    assert said["results"] or command in ("import", "models", "new", "simulate")
    for one in said["estimates"]:
        assert set(one) == {"result", "name", "unit", "value", "u"}
        assert one["result"] in said["results"]
        assert math.isfinite(one["value"])
        assert one["u"] >= 0.0
        assert one["unit"], one
    assert any(ESTIMATED.get(command, "") in one["name"] for one in said["estimates"]) or (
        command not in ESTIMATED
    )


def test_numbers_are_those_that_are_said(place: dict[str, str]) -> None:
    said = ran("diff", "9.81(2) m/s²", "9.75(1) m/s²")
    (one,) = said["estimates"]
    assert (one["name"], one["unit"]) == ("difference", "m/s²")
    assert (one["value"], one["u"]) == pytest.approx((0.06, math.hypot(0.02, 0.01)))
    plain = runner().invoke(cli, ["diff", "9.81(2) m/s²", "9.75(1) m/s²"])
    assert plain.stdout.splitlines() == said["lines"]
    line = ran("line", "data/everyday/calibration.csv", "--figures", "none")
    named = [(one["name"], one["unit"]) for one in line["estimates"]]
    assert named == [("intercept", "V"), ("slope", "V/A")]
    # of a line there are two estimates: none of them is the one to be compared with a value
    refused = runner().invoke(cli, ["diff", "out/calibration", "1.2(1)"])
    assert "must have one estimate" in str(refused.exception)


def test_what_is_not_a_number_is_null(place: dict[str, str]) -> None:
    Path("two.csv").write_text("g,u_g\n9.81,0.02\n9.79,0.03\n")
    said = ran("mean", "two.csv", "--figures", "none")
    (record,) = said["results"].values()
    assert record["averages"]["hierarchical"]["u"] is None  # two values: it does not exist
    assert "averages.hierarchical" not in {one["name"] for one in said["estimates"]}


@pytest.mark.slow
def test_nothing_is_printed_where_the_input_is_wrong(place: dict[str, str]) -> None:
    words = [sys.executable, "-m", "estim", "mean", "data/everyday/periods.csv", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: data/everyday/periods.csv: 'column' must be named")


def test_questions_go_to_standard_error(
    place: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(["data/tutorial/tea.csv", "time", "temperature", "a + b*x", "", "", "tea"])

    def asked(question: str, **_: object) -> str:
        click.echo(question)
        return next(answers)

    monkeypatch.setattr("estim.cli.new._in_a_terminal", lambda: True)
    monkeypatch.setattr("click.prompt", asked)
    done = runner().invoke(cli, ["new", "tea", "--json"])
    assert json.loads(done.stdout)["files"] == ["tea.toml"]
    assert "Table" in done.stderr


def test_a_report_does_not_tell_how_it_was_printed(place: dict[str, str]) -> None:
    ran("mean", *COMMANDS["mean"], "--figures", "none")
    assert "--json" not in Path("out/laboratories/report.md").read_text()
    assert ran("verify", "out/laboratories")["results"]["verification"]["verified"]
    with Path("out/laboratories/report.md").open("a") as report:
        report.write("tampered\n")
    assert not ran("verify", "out/laboratories")["results"]["verification"]["verified"]


def test_every_command_is_walked_over_and_the_page_shows_what_is_printed(
    project: Path, place: dict[str, str]
) -> None:
    assert set(COMMANDS) == set(cli.commands) - {"serve"}  # a page, until it is stopped
    (shown,) = blocks((project / "docs" / "interop.md").read_text(encoding="utf-8"), "json")
    page = json.loads(shown)
    said = ran("mean", "data/everyday/periods.csv", "--y", "T")
    assert page.keys() == said.keys()
    for key in ("schema", "command", "exit_code"):
        assert page[key] == said[key]
    assert page["lines"][0] == said["lines"][0]
    assert set(page["files"]) == set(said["files"])
    assert list(page["results"]) == list(said["results"])
    ((one,), (other,)) = (of["estimates"] for of in (page, said))
    for key, value in one.items():
        assert other[key] == (value if isinstance(value, str) else pytest.approx(value, rel=0.01))
