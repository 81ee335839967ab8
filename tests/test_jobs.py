"""Work spread over processes: what becomes of it where one of them is killed."""

from __future__ import annotations

import os
import platform
import select
import signal
import subprocess
import sys
import time
from functools import partial
from math import factorial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from estim.common.errors import NumericalError
from estim.common.interruption import STOPPING, ended_by_signals
from estim.common.jobs import spread

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals")
PATIENCE = 120.0  # s, for what happens at once unless it never does


def square_or_die(folder: Path, once: bool, n: int) -> int:
    """n squared; at 3 the process is killed, the first time or always."""
    with (folder / "done").open("a") as file:
        file.write(f"{n}\n")
    died = folder / "died"
    if n == 3 and not (once and died.exists()):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def test_what_a_killed_worker_left_is_done_again(tmp_path: Path) -> None:
    seen: list[int] = []
    assert spread(partial(square_or_die, tmp_path, True), range(12), jobs=2, progress=seen.append) == [n * n for n in range(12)]
    assert seen == list(range(1, 13))
    done = [int(n) for n in (tmp_path / "done").read_text().split()]
    assert 2 <= done.count(3) <= 3
    assert len(done) < 12 + 2 * 2 + 1  # what was queued and no more


def test_a_second_killed_worker_ends_the_work_in_words(tmp_path: Path) -> None:
    with pytest.raises(NumericalError, match="worker process was killed, twice"):
        spread(partial(square_or_die, tmp_path, False), range(12), jobs=2)


HOLDING = """
import os, sys, time
sys.path.insert(0, os.path.dirname(__file__))
from functools import partial
from estim.common.jobs import spread

def hold(fifo, n):
    with open(fifo, "w") as file:
        print(os.getpid(), file=file, flush=True)
        time.sleep(3600)

if __name__ == "__main__":
    spread(partial(hold, sys.argv[1]), range(2), jobs=2)
"""


def lines_until(reader: int, enough: int | None) -> list[str]:
    """Lines that come through a pipe: `enough` of them, or all until nobody holds its other end."""
    got = b""
    while enough is None or got.count(b"\n") < enough:
        ready, _, _ = select.select([reader], [], [], PATIENCE)
        if not ready:
            pytest.fail("somebody still holds the other end")
        piece = os.read(reader, 1000)
        if not piece:
            break
        got += piece
    return got.decode().split()


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path, project: Path) -> None:
    (tmp_path / "holding.py").write_text(HOLDING)
    os.mkfifo(tmp_path / "held")
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "holding.py"), str(tmp_path / "held")], env={**os.environ, "PYTHONPATH": str(project)},
        stderr=subprocess.DEVNULL,
    )
    reader, workers = os.open(tmp_path / "held", os.O_RDONLY | os.O_NONBLOCK), []  # a parent that never writes must not be waited for
    try:
        workers = [int(pid) for pid in lines_until(reader, 2)]
        assert len(workers) == 2
        parent.kill()
        parent.wait()
        assert lines_until(reader, None) == []
        workers = []
    finally:
        os.close(reader)
        parent.kill()
        parent.wait()
        for pid in workers:
            os.kill(pid, signal.SIGKILL)


def last_for_ever(n: int) -> int:
    if n:
        time.sleep(3600.0)
    return n


def test_an_impatient_caller_that_is_interrupted_waits_for_no_call() -> None:
    """Between two results, as Ctrl-C may come; an error of a call is the same."""

    def interrupted(n: int, result: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        spread(last_for_ever, range(3), jobs=2, keep=interrupted, patient=False)


class Held:
    """What a read-only mapping is part of, which pickle does not know by itself."""

    def __init__(self, n: int) -> None:
        self.values = MappingProxyType({n: np.float64(n) / 3.0})


def test_results_may_hold_read_only_mappings() -> None:
    assert [dict(held.values) for held in spread(Held, range(2), jobs=2)] == [{0: 0.0}, {1: np.float64(1.0) / 3.0}]


def pages_asked_for(_: int) -> int:
    """How often a process that takes and leaves 96 MB ten times has to ask for a page of them, after the first time."""
    import resource

    before = 0
    for i in range(11):
        held = [np.ones(2_000_000) for _ in range(6)]
        del held
        if i == 0:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc alone")
@pytest.mark.parametrize(("stated", "stays"), [(None, True), ("131072", False)])
def test_workers_keep_memory_for_the_next_call_unless_told_otherwise(stated: str | None, stays: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)
    if stated is not None:
        monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", stated)
    (asked,) = set(spread(pages_asked_for, range(1), jobs=2))
    assert (asked < 2000) == stays
    assert os.environ.get("MALLOC_TRIM_THRESHOLD_") == stated


SPREADING = """
from math import factorial
from estim.common.jobs import spread

if __name__ == "__main__":
    print(spread(factorial, range(4), jobs=2))
"""


def test_workers_import_nothing_from_the_working_folder(tmp_path: Path, project: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    for name in ("pickle", "signal", "socket", "tempfile", "subprocess", "random", "queue"):
        (data / f"{name}.py").write_text("open('imported', 'a').write(__name__)\n")
    (tmp_path / "spreading.py").write_text(SPREADING)
    command = [sys.executable, str(tmp_path / "spreading.py")]
    ran = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(project)}, cwd=data, capture_output=True, text=True, check=False)
    assert (ran.stdout, ran.stderr) == (f"{[factorial(n) for n in range(4)]}\n", "")
    assert not (data / "imported").exists()


@pytest.mark.parametrize("number", STOPPING)
def test_every_signal_to_stop_is_as_ctrl_c(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    try:
        signal.signal(number, signal.SIG_DFL)  # whatever runs the tests may ignore it
        with ended_by_signals(), pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        assert signal.getsignal(number) is signal.SIG_DFL
        signal.signal(number, signal.SIG_IGN)  # as `nohup` does
        with ended_by_signals():
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)


def test_the_signals_to_stop_are_all_there() -> None:
    assert {signal.SIGINT, signal.SIGTERM, signal.SIGHUP} == set(STOPPING)
