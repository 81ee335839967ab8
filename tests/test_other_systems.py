"""What another system lacks: the commands as they find things on Windows (`without_posix`), where
macOS refuses a limit, and files whose names have blanks and letters beyond ASCII.  Not the systems
themselves.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path, PureWindowsPath

import pytest
from troubles import Disk
from web_pages import Browser

from estim.batch import units
from estim.reading import way_to

FOLDER, TABLE, COPY = "Messung Öl 1", "Läufe é.csv", "Läufe ü 2"
DECAY = "room + excess*exp(-t/tau)"
PATIENCE = 300.0

Run = Callable[..., subprocess.CompletedProcess[str]]


def environment(system: str) -> dict[str, str]:
    home = Path(__file__).parent
    path = [str(home / "without_posix"), str(home.parent), *filter(None, sys.path)]
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(path),
        "ESTIM_TESTS_SYSTEM": system,
        "PYTHONIOENCODING": "utf-8",
        "PYTHONDONTWRITEBYTECODE": "",
        "OMP_NUM_THREADS": "1",
    }


@pytest.fixture
def folder(tmp_path: Path, project: Path) -> Path:
    folder = tmp_path / FOLDER
    folder.mkdir()
    for name, copy in {"tea.csv": TABLE, "fall.trk": "Fall ß.trk"}.items():
        shutil.copy(project / "data" / "tutorial" / name, folder / copy)
    return folder


@pytest.fixture
def run(folder: Path) -> Run:
    """A command in the folder, by a process of its own, as on Windows."""

    def command(*words: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [sys.executable, "-m", "estim", *words],
            cwd=folder,
            env=environment("windows"),
            capture_output=True,
            encoding="utf-8",
            timeout=PATIENCE,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode == code, done.stdout + done.stderr
        return done

    return command


def of_windows(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment("windows"),
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    return done.stdout + done.stderr


def test_the_stand_in_lacks_what_it_should(project: Path, tmp_path: Path) -> None:
    assert "hasattr: False" in of_windows(
        "import estim.web.worker as worker; print('hasattr:', hasattr(worker.os, 'killpg'))"
    )
    storage = "import estim.common.storage as s; s.os.open({!r}, 0)"
    assert "PermissionError" in of_windows(storage.format(str(tmp_path)))
    assert "Invalid argument" in of_windows(storage.format(str(tmp_path / "12:30.csv")))
    file = tmp_path / "module.py"
    for line, said in {
        "open('x', 'w')": "without an encoding",
        "import pathlib; pathlib.Path('x').read_text()": "without an encoding",
        "import fcntl": "No module named 'fcntl'",
        "from os import fork": "cannot import name 'fork'",
        "import sys; print(sys.platform)": "win32",
    }.items():
        file.write_text(line, encoding="utf-8")
        as_ours = f"import runpy; runpy.run_path({str(file)!r}, run_name='estim.module')"
        assert said in of_windows(as_ours), line


@pytest.mark.slow
def test_a_table_is_fit_and_its_report_verified(run: Run, folder: Path) -> None:
    out = "Bericht ä 1"
    fit = run("fit", TABLE, "--formula", DECAY, "--format", "html", "--lang", "es", "--out", out)
    assert "ok" in fit.stdout
    assert {"report.md", "report.html", "result.json", "figures"} <= {
        path.name for path in (folder / out).iterdir()
    }
    assert TABLE.removesuffix(".csv") in (folder / out / "report.html").read_text(encoding="utf-8")
    assert TABLE in json.loads((folder / out / "origin.json").read_text(encoding="utf-8"))["inputs"]
    run("verify", out)
    again = run("fit", TABLE, "--formula", DECAY, "--figures", "none", "--out", out)
    assert again.stdout
    assert not (folder / out / "report.html").exists()


@pytest.mark.slow
def test_campaigns_are_drafted_and_fit_by_two_processes(run: Run, folder: Path) -> None:
    first = folder / "Läufe ä"
    first.mkdir()
    run("new", f"{first.name}/campaign", "--from", TABLE, "--formula", DECAY)
    written = tomllib.loads((first / "campaign.toml").read_text(encoding="utf-8"))
    assert [one["file"] for one in written["runs"]] == [f"../{TABLE}"]
    shutil.copytree(first, folder / COPY)
    run("batch", ".", "--jobs", "2", "--figures", "none", "--out", "alle Läufe")
    summary = (folder / "alle Läufe" / "summary.csv").read_text(encoding="utf-8")
    assert len(re.findall(r",ok,", summary)) == 2, summary
    run("batch", ".", "--jobs", "1", "--figures", "none", "--out", "alle Läufe", "--resume")


def test_a_recording_of_tracker_is_imported(run: Run, folder: Path) -> None:
    run("import", "Fall ß.trk", "--out", "Läufe ß/Fall 1.csv")
    assert (folder / "Läufe ß" / "Fall 1.csv").read_text(encoding="utf-8").count("\n") > 10


@pytest.mark.slow
def test_a_campaign_is_reanalysed_by_two_processes(run: Run, folder: Path) -> None:
    data = folder / "Ramp é" / "Öl 1"
    data.mkdir(parents=True)
    Disk(more='rolling_resistance = {prior = "half-normal", scale = 0.005}').write(data)
    words = ("--jobs", "2", "--figures", "none", "--max-steps", "60", "--out", "nochmals ö")
    done = run("reanalyse", "Ramp é/Öl 1/campaign.toml", *words, code=3)
    assert "nochmals ö" in done.stdout
    assert (folder / "nochmals ö" / "report.md").stat().st_size > 3000


@pytest.mark.slow
def test_the_page_answers(folder: Path) -> None:
    words = ["serve", "--no-browser", "--folder", str(folder / "Seite ö")]
    with subprocess.Popen(
        [sys.executable, "-m", "estim", *words],
        stdout=subprocess.PIPE,
        encoding="utf-8",
        env=environment("windows"),
    ) as server:
        try:
            assert server.stdout is not None
            url = server.stdout.readline().split()[1]
            address, token = re.fullmatch(r"http://(.*)/\?token=(.*)", url).groups()
            browser = Browser(address)
            assert browser.get(f"/?token={token}").status == 303
            asked = browser.hand_in({TABLE: (folder / TABLE).read_bytes()})
            answer = browser.fill_in(asked.place, asked="formula", formula=DECAY)
            page = browser.ended(answer.place).text
            assert TABLE in page or TABLE.removesuffix(".csv") in page
            assert "17.63" in page
        finally:
            server.kill()


def test_a_worker_listens_to_another_handle_than_standard_input(tmp_path: Path) -> None:
    """On Windows a library that looks at standard input as it is loaded would wait for ever for a
    thread that reads it.
    """
    (tmp_path / "numpy.py").write_text(
        "import os, sys\nprint('read:', os.read(0, 10), flush=True)\nos._exit(0)\n",
        encoding="utf-8",
    )
    worker = Path(units.__file__).parents[1] / "web" / "worker.py"
    with subprocess.Popen(
        [sys.executable, str(worker), "60", str(2**32), "run", "mean", "x.csv"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        env=environment("here") | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        waiting = threading.Timer(PATIENCE / 4, process.kill)
        waiting.start()
        assert process.stdout.readline() == "read: b''\n"
        waiting.cancel()


def test_a_limit_that_the_system_refuses_does_not_stop_a_worker(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As macOS refuses one of memory."""
    resource = pytest.importorskip("resource")
    from estim.web import worker

    set_ones: list[int] = []

    def refusing(what: int, limits: tuple[int, int]) -> None:
        if what == resource.RLIMIT_AS:
            raise ValueError("current limit exceeds maximum limit")
        set_ones.append(what)

    monkeypatch.setattr(resource, "setrlimit", refusing)
    worker._limit(10, 2**32)
    assert set_ones == [resource.RLIMIT_CPU, resource.RLIMIT_FSIZE, resource.RLIMIT_CORE]


def on_two_drives(*_: object) -> str:
    raise ValueError("path is on mount 'D:', start on mount 'C:'")


def test_a_file_on_another_drive_is_called_by_its_whole_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert way_to(tmp_path / "a" / "b.csv", tmp_path / "c") == "../a/b.csv"
    monkeypatch.setattr("os.path.relpath", on_two_drives)
    assert way_to(tmp_path / "a" / "b.csv", tmp_path / "c") == (tmp_path / "a/b.csv").as_posix()
    assert PureWindowsPath("D:\\Öl 1\\é.csv").as_posix() == "D:/Öl 1/é.csv"


def test_campaigns_on_several_drives_have_places_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.path.commonpath", on_two_drives)
    files = [tmp_path / name / "campaign.toml" for name in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("", encoding="utf-8")
    places = [unit.place for unit in units.units_of(files)]
    assert [place.rpartition("/")[2] for place in places] == ["a", "b"]
    assert not [place for place in places if place.startswith("/") or ".." in place]
