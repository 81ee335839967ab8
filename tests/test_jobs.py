"""Work spread over processes: what becomes of it where one of them is killed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from math import factorial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from estim.common.errors import Interrupted, NumericalError
from estim.common.interruption import STOPPING, ended_by_signals
from estim.common.jobs import run_parallel

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals")
PATIENCE = 120.0  # s, for what happens at once unless it never does
LATE = 30.0  # s, for what nobody should wait for


def square_or_die(folder: Path, once: bool, n: int) -> int:
    """n squared; at 3 the process is killed, the first time or always."""
    with (folder / "done").open("a") as file:
        file.write(f"{n}\n")
    died = folder / "died"
    if n == 3 and not (once and died.exists()):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


@pytest.mark.slow
def test_what_a_killed_worker_left_is_done_again(tmp_path: Path) -> None:
    seen: list[int] = []
    assert run_parallel(
        partial(square_or_die, tmp_path, True), range(12), jobs=2, progress=seen.append
    ) == [n * n for n in range(12)]
    assert seen == list(range(1, 13))
    done = [int(n) for n in (tmp_path / "done").read_text().split()]
    assert 2 <= done.count(3) <= 3
    assert len(done) < 12 + 2 * 2 + 1  # what was queued and no more


@pytest.mark.slow
def test_a_second_killed_worker_ends_the_work_in_words(tmp_path: Path) -> None:
    with pytest.raises(NumericalError, match="worker process was killed, twice"):
        run_parallel(partial(square_or_die, tmp_path, False), range(12), jobs=2)


HOLDING = """
import os, sys, time
sys.path.insert(0, os.path.dirname(__file__))
from functools import partial
from estim.common.jobs import run_parallel

def hold(fifo, n):
    with open(fifo, "w") as file:
        print(os.getpid(), file=file, flush=True)
        time.sleep(3600)

if __name__ == "__main__":
    run_parallel(partial(hold, sys.argv[1]), range(2), jobs=2)
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
        [sys.executable, str(tmp_path / "holding.py"), str(tmp_path / "held")],
        env={**os.environ, "PYTHONPATH": str(project)},
        stderr=subprocess.DEVNULL,
    )
    # a parent that never writes must not be waited for
    reader, workers = os.open(tmp_path / "held", os.O_RDONLY | os.O_NONBLOCK), []
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


def test_the_work_is_taken_up_again_by_half_as_many(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[list[int], int]] = []

    def by_workers(
        task: object, numbers: list[int], jobs: int, wait_on_error: bool
    ) -> Iterator[tuple[int, int]]:
        asked.append((numbers, jobs))
        yield numbers[0], -numbers[0]
        raise BrokenProcessPool

    monkeypatch.setattr("estim.common.jobs._by_workers", by_workers)
    with pytest.raises(NumericalError, match="is there memory for 5 processes"):
        run_parallel(abs, range(1, 9), jobs=5)
    assert asked == [(list(range(1, 9)), 5), (list(range(2, 9)), 2)]


def finish_late(folder: Path, n: int) -> int:
    if n:
        time.sleep(LATE)
        (folder / "finished").touch()
    return n


def test_an_impatient_caller_that_is_interrupted_waits_for_no_call(tmp_path: Path) -> None:
    """Between two results, as Ctrl-C may come; an error of a call is the same."""

    def interrupted(n: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_parallel(
            partial(finish_late, tmp_path),
            range(3),
            jobs=2,
            on_done=interrupted,
            wait_on_error=False,
        )
    assert not (tmp_path / "finished").exists()


INTERRUPTED = """
import signal, sys, time
from concurrent.futures import ThreadPoolExecutor
from estim.common.errors import Interrupted
from estim.common.jobs import run_parallel

class Alarmed(ThreadPoolExecutor):
    def submit(self, task, n):
        if n == LAST:
            signal.setitimer(signal.ITIMER_REAL, delay)
        return super().submit(task, n)

def interrupt(number, frame):
    raise Interrupted

LAST = 2_000
signal.signal(signal.SIGALRM, interrupt)
for delay in (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.06, 0.1):
    try:
        with Alarmed(1) as executor:
            run_parallel(lambda n: time.sleep(0.02), range(10 * LAST), jobs=2, executor=executor)
    except Interrupted:
        print(delay)
"""


@pytest.mark.slow
def test_an_interrupt_right_after_many_were_handed_over_ends_the_work() -> None:
    """`as_completed` of the standard library, interrupted while it starts, leaves the futures
    locked for ever.
    """
    ended = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=PATIENCE
    )
    assert (ended.stderr, len(ended.stdout.split())) == ("", 10)


def test_so_many_calls_are_submitted_that_a_signal_to_stop_need_not_wait() -> None:
    """The executors of the standard library take 100,000 calls in seconds, and a signal waits."""
    submitted = []

    class Counting(ThreadPoolExecutor):
        def submit(self, *args: Any) -> Future[Any]:  # type: ignore[override]
            submitted.append(args)
            return super().submit(*args)

    class EndedError(Exception):
        pass

    def end(_done: int) -> None:
        raise EndedError

    with Counting(1) as executor:
        with pytest.raises(EndedError):
            run_parallel(abs, range(-20_000, 0), jobs=2, executor=executor, progress=end)
        assert len(submitted) < 2_100
        submitted.clear()
        numbers = range(-3_000, 0)
        assert run_parallel(abs, numbers, jobs=2, executor=executor) == list(range(3_000, 0, -1))
        assert len(submitted) == 3_000


class Held:
    """What a read-only mapping is part of, which pickle does not know by itself."""

    def __init__(self, n: int) -> None:
        self.values = MappingProxyType({n: np.float64(n) / 3.0})


@pytest.mark.slow
def test_results_may_hold_read_only_mappings() -> None:
    assert [dict(held.values) for held in run_parallel(Held, range(2), jobs=2)] == [
        {0: 0.0},
        {1: np.float64(1.0) / 3.0},
    ]


def inherited(name: str) -> tuple[str | None, set[int]]:
    return os.environ.get(name), signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_workers_compute_with_one_thread_and_leave_signals_to_the_parent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    ((threads, held),) = run_parallel(inherited, ["OMP_NUM_THREADS"], jobs=2)
    assert threads == "1"
    assert held & set(STOPPING) == set(STOPPING) - {signal.SIGTERM}  # by which the parent ends them
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ()) & set(STOPPING)


SPREADING = """
from math import factorial
from estim.common.jobs import run_parallel

if __name__ == "__main__":
    print(run_parallel(factorial, range(4), jobs=2))
"""


@pytest.mark.slow
def test_workers_import_nothing_from_the_working_folder(tmp_path: Path, project: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    for name in ("pickle", "signal", "socket", "tempfile", "subprocess", "random", "queue"):
        (data / f"{name}.py").write_text("open('imported', 'a').write(__name__)\n")
    (tmp_path / "spreading.py").write_text(SPREADING)
    command = [sys.executable, str(tmp_path / "spreading.py")]
    ran = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(project)},
        cwd=data,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ran.stdout, ran.stderr) == (f"{[factorial(n) for n in range(4)]}\n", "")
    assert not (data / "imported").exists()


@pytest.mark.parametrize("number", STOPPING)
def test_every_signal_to_stop_interrupts(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    try:
        signal.signal(number, signal.SIG_DFL)  # whatever runs the tests may ignore it
        with ended_by_signals(), pytest.raises(Interrupted):
            signal.raise_signal(number)
        assert signal.getsignal(number) is signal.SIG_DFL
        signal.signal(number, signal.SIG_IGN)  # as `nohup` does
        with ended_by_signals():
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)


def test_the_signals_to_stop_are_all_there() -> None:
    assert {signal.SIGINT, signal.SIGTERM, signal.SIGHUP} == set(STOPPING)
