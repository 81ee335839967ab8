"""`estim fit` in one process without helpers, as it has to run inside a browser: no process, no
thread.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from shutil import rmtree

import pytest
from command_runner import runner

from estim.cli.commands import cli

ALONE = """
import concurrent.futures, multiprocessing, os, subprocess, sys, threading

def forbidden(*_args, **_kwargs):
    raise RuntimeError("not in a browser")

def none_here(*_args, **_kwargs):  # as in a browser: `platform` asks it for the processor
    raise OSError("not in a browser")

concurrent.futures.ProcessPoolExecutor.__init__ = forbidden
concurrent.futures.ThreadPoolExecutor.__init__ = forbidden
multiprocessing.get_context = multiprocessing.Pool = multiprocessing.Manager = forbidden
multiprocessing.process.BaseProcess.start = forbidden
threading.Thread.start, subprocess.Popen.__init__ = forbidden, none_here
for name in ("fork", "forkpty", "posix_spawn", "posix_spawnp", "system", "popen"):
    setattr(os, name, forbidden)
"""
RUN = """
import runpy
runpy.run_module("estim", run_name="__main__", alter_sys=True)
"""
ROLLING = {
    "radius_m": "0.14929(50)",
    "gamma": "0.193(10)",
    "phi_deg": "3.69(40)",
    "theta0_deg": "61.7(1.5)",
    "sigma_x_m": "0.001",
}


def ran(script: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", script, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize("what", ["curve", "rolling"])
def test_a_report_needs_no_process_and_no_thread(
    what: str, tmp_path: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if what == "curve":
        file = project / "data" / "tutorial" / "tea.csv"
        said = ["--formula", "room + excess*exp(-t/tau)"]
    else:
        file = project / "data" / "replica" / "runs" / "heavy-04.csv"
        said = [f"--rolling={key}={text}" for key, text in ROLLING.items()]
    (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    words = ["fit", file.name, *said, "--format", "html", "--out", "r"]
    plain = runner().invoke(cli, words)
    assert plain.exit_code == 0, plain.output
    here = [Path("r", part).read_bytes() for part in PARTS]
    rmtree("r")
    alone = ran(ALONE + RUN, tmp_path, *words)
    assert alone.returncode == 0, alone.stderr
    assert [Path("r", part).read_bytes() for part in PARTS] == here


PARTS = ("report.html", "report.md", "result.json")


@pytest.mark.parametrize(
    "use",
    [
        "import threading; threading.Thread(target=print).start()",
        "import concurrent.futures as f; f.ProcessPoolExecutor(1)",
        "import multiprocessing as m; m.Process(target=print).start()",
        "import subprocess; subprocess.run(['true'])",
        "import os; os.fork()",
    ],
)
def test_what_is_forbidden_here_would_be_seen(use: str, tmp_path: Path) -> None:
    done = ran(f"{ALONE}\n{use}", tmp_path)
    assert done.returncode == 1
    assert "not in a browser" in done.stderr
