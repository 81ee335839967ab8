"""What estim did not write is neither removed nor overwritten, and that is said before anything is
computed.
"""

from __future__ import annotations

import json
import re
import shutil
from hashlib import sha256
from importlib import import_module
from pathlib import Path

import pytest
from command_runner import runner

from estim.cli.commands import cli
from estim.common import EstimError, InputError, replace_own, write_whole
from estim.common.ownership import FIGURES

PROJECT = Path(__file__).parent.parent
MODEL = """\
title = "A sum"
draws = 10000
[measurand]
formula = "a + b"
[inputs]
a = {value = 1.0, u = 0.1}
b = {value = 2.0, u = 0.2}
"""
COMMANDS = {
    "fit": ["data/replica/campaign.toml", "--run", "light-01"],
    "energy": ["data/replica/campaign.toml", "--run", "light-01"],
    "reanalyse": ["data/replica/campaign.toml"],
    "map": ["data/replica/campaign.toml"],
    "plan": ["data/replica/campaign.toml"],
    "compare-models": ["data/replica/campaign.toml", "--run", "light-01"],
    "calibrate": ["data/replica/campaign.toml", "--run", "light-01"],
    "line": ["data/replica/campaign.toml"],
    "line of a table": ["points.csv"],
    "line of trials": ["data/trials/campaign.toml"],
    "fit of a table": ["points.csv", "--formula", "a + b*x"],
    "fit --compare": ["data/replica/campaign.toml", "--run", "light-01", "--compare"],
    "propagate": ["model.toml"],
    "mean": ["points.csv", "--y", "y"],
    "body": ["data/wheel/campaign.toml"],
    "batch": ["data/wheel"],
}
RECORDS = {
    "plan": "plan.json",
    "compare-models": "models.json",
    "calibrate": "calibration.json",
    "fit --compare": "comparison.json",
    "batch": "summary.csv",
    "line of trials": "trials.json",
}


def run(*arguments: object):
    return runner().invoke(cli, [str(argument) for argument in arguments])


@pytest.fixture
def place(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(
        project / "data", tmp_path / "data", ignore=shutil.ignore_patterns("*.trk", "gallery")
    )
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "points.csv").write_text("x,y\n0,1\n1,2.1\n2,2.9\n3,4\n")
    monkeypatch.chdir(tmp_path)
    # what is first imported below would keep the stand-in
    for file in sorted((project / "estim").glob("*/[a-z]*.py")):
        import_module(f"estim.{file.parent.name}.{file.stem}")
    for name in (
        "estim.pipeline.analyse",
        "estim.measurement_model.propagate",
        "estim.planning.plan",
        "estim.studies.bodies.weigh",
        "estim.line.straight_line",
    ):
        monkeypatch.setattr(name, computed)
    return tmp_path


def computed(*_: object, **__: object) -> None:
    raise AssertionError("computed before it was asked whether there is room")


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_somebody_else_stops_every_command_before_it_computes(
    command: str, place: Path
) -> None:
    record = RECORDS.get(command, "result.json")
    for name in (
        "report.md",
        "figures/phase.png",
        "figures/map-light.png",
        "draws.nc",
        "report.html",
        record,
        "origin.json",
    ):
        mine = place / "out" / name
        mine.parent.mkdir(parents=True, exist_ok=True)
        mine.write_text("![a photo](figures/photo.png)")
        (place / "out" / "figures").mkdir(exist_ok=True)
        (place / "out" / "figures" / "photo.png").write_text("years of work")
        done = run(command.split()[0], *COMMANDS[command], "--out", "out")
        assert isinstance(done.exception, EstimError), (name, done.output, done.exception)
        assert str(done.exception).startswith(f"out/{name}: "), str(done.exception)
        assert mine.read_text() == "![a photo](figures/photo.png)"
        left = {
            str(path.relative_to(place / "out"))
            for path in (place / "out").rglob("*")
            if path.is_file()
        }
        assert left == {name, "figures/photo.png"}
        mine.unlink()


@pytest.mark.usefixtures("few_draws")
def test_a_report_of_another_file_or_command_is_not_replaced_silently(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    long = "x" * 85  # names of folders are cut
    for day in ("mon", "tue"):
        (tmp_path / day).mkdir()
        for name in ("data", f"{long}-{day}"):
            (tmp_path / day / f"{name}.csv").write_text("x,y\n0,1\n1,2.1\n2,2.9\n3,4\n")

    def said(*arguments: str) -> str:
        done = run(*arguments, "--figures", "none")
        assert done.exit_code in (0, 3), done.exception
        return done.stderr

    assert said("line", "mon/data.csv") == ""
    assert said("line", "./mon/data.csv", "--predict", "1") == ""
    assert said("line", "tue/data.csv") == (
        "out/data: the report of `estim line mon/data.csv --predict 1 --figures none` is "
        "replaced (--out would keep both)\n"
    )
    assert "`estim line tue/data.csv" in said("mean", "tue/data.csv", "--y", "y")
    assert said("mean", "tue/data.csv", "--y", "y") == ""
    fit = "--formula", "line", "--max-steps", "60"
    assert said("fit", f"mon/{long}-mon.csv", *fit) == ""
    assert f"mon/{long}-mon.csv" in said("fit", f"tue/{long}-tue.csv", *fit)


def test_what_the_report_before_had_goes_and_a_photo_in_its_folder_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)
    assert run("propagate", "model.toml", "--out", ".").exit_code == 0
    drawn = sorted(path.name for path in (tmp_path / "figures").iterdir())
    (tmp_path / "figures" / "photo.png").write_text("years of work")
    assert run("propagate", "model.toml", "--out", ".", "--figures", "none").exit_code == 0
    assert drawn
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["photo.png"]
    (tmp_path / "report.md").write_text((tmp_path / "report.md").read_text() + "My remarks.\n")
    done = run("propagate", "model.toml", "--out", ".")
    assert isinstance(done.exception, InputError)
    assert (
        str(done.exception)
        == "report.md: was not written by estim, or was changed since: move it away, or "
        "choose another folder"
    )
    assert "My remarks." in (tmp_path / "report.md").read_text()


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_draws_of_an_earlier_fit_do_not_stay_beside_a_newer_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estim.reports.interop.can_write_netcdf", lambda: True)
    monkeypatch.setattr("estim.reports.interop.to_netcdf", lambda analysis: b"draws")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.csv").write_text("x,y\n0,1\n1,2.1\n2,2.9\n3,4\n4,5.1\n5,5.9\n")
    fit = (
        "fit",
        "points.csv",
        "--formula",
        "a + b*x",
        "--u-y",
        "0.1",
        "--figures",
        "none",
        "--out",
        "out",
    )
    assert run(*fit).exception is None or run(*fit).exit_code == 3
    origin = json.loads((tmp_path / "out" / "origin.json").read_text())
    assert origin["outputs"]["draws.nc"] == sha256(b"draws").hexdigest()
    monkeypatch.setattr("estim.reports.interop.can_write_netcdf", lambda: False)
    run(*fit)
    assert not (tmp_path / "out" / "draws.nc").exists()
    (tmp_path / "out" / "draws.nc").write_bytes(b"draws of another fit")
    assert "draws.nc: was not written by estim" in str(run(*fit).exception)


def test_an_import_and_a_simulation_overwrite_nothing_that_is_not_theirs(
    project: Path, tmp_path: Path
) -> None:
    (tmp_path / "sim").mkdir()
    shutil.copy(project / "data" / "replica" / "design.toml", tmp_path / "design.toml")
    (tmp_path / "sim" / "truth.toml").write_text("mine")
    done = run("simulate", tmp_path / "design.toml", "--out", tmp_path / "sim")
    assert "truth.toml: was not written by estim" in str(done.exception)
    assert [path.name for path in (tmp_path / "sim").iterdir()] == ["truth.toml"]
    (tmp_path / "sim" / "truth.toml").unlink()
    for change in ("seed = 1", "seed = 2"):
        design = re.sub(r"(?m)^seed = \d+", change, (tmp_path / "design.toml").read_text())
        (tmp_path / "design.toml").write_text(design)
        assert run("simulate", tmp_path / "design.toml", "--out", tmp_path / "sim").exit_code == 0
    before = {
        path.name: path.read_bytes() for path in (tmp_path / "sim").iterdir() if path.is_file()
    }
    (tmp_path / "model.toml").write_text(MODEL)
    assert (
        run(
            "propagate", tmp_path / "model.toml", "--out", tmp_path / "sim", "--figures", "none"
        ).exit_code
        == 0
    )
    # a report takes nothing from the campaign
    assert all((tmp_path / "sim" / name).read_bytes() == data for name, data in before.items())
    track = next((project / "data").rglob("*.trk"))
    (tmp_path / "run.csv").write_text("mine")
    done = run("import", track, "-o", tmp_path / "run.csv")
    assert "run.csv: is there already with other contents" in str(done.exception)
    assert (tmp_path / "run.csv").read_text() == "mine"


def test_a_crash_while_a_report_is_replaced_leaves_nothing_that_nobody_owns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At whatever file it happens, the next report can be written, and what is somebody else's
    stays.
    """

    def record(digests) -> bytes:
        return json.dumps(dict(digests)).encode()

    def written(text: bytes, *names: str) -> None:
        place = tmp_path / "manifest.json"
        before = json.loads(place.read_text()) if place.exists() else {}
        replace_own(
            tmp_path, dict.fromkeys(names, text), before, "manifest.json", record, within=tmp_path
        )

    (tmp_path / "mine.txt").write_text("mine")
    for crash_at in range(1, 6):
        written(b"old", "a", "b", "figures/c.png")
        count = 0

        def crashing(path: Path, data: bytes, *, within: Path, at: int = crash_at) -> None:
            nonlocal count
            count += 1
            if count == at:
                raise KeyboardInterrupt
            write_whole(path, data, within=within)

        with monkeypatch.context() as patched:
            patched.setattr("estim.common.ownership.write_whole", crashing)
            with pytest.raises(KeyboardInterrupt):
                written(b"new", "a", "b", "d")
        written(b"newer", "a", "b")
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            "a",
            "b",
            "manifest.json",
            "mine.txt",
        ]


def test_every_figure_has_a_name_that_is_looked_for() -> None:
    sources = "".join(
        path.read_text()
        for path in (PROJECT / "estim").rglob("*.py")
        if path.name != "ownership.py"
    )
    drawn = set(re.findall(r"\"figures/([a-z_]+)(?:-\{[^}]+\})?\.png", sources))
    assert drawn == set(FIGURES)
