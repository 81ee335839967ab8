"""Commands in processes of their own: a queue, limits, progress, and an end that nobody waits for.

A process has its own group, which is killed as a whole: at a limit, on a click, or with the server
(`worker` ends when its standard input does).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from estim.common import one_line, shorten

_WORKER = Path(__file__).with_name("worker.py")
_BYTES = 4 * 1024**3  # address space: libraries are mapped whole
_MOST_LINES = 300


class Job:
    """One process: what it is to do, how far it is, and what it said.

    state : "waiting", "running", "done", "cancelled", "stopped" (a limit).
    """

    def __init__(self, folder: Path, task: Sequence[str], *, seconds: int) -> None:
        self.folder, self.task, self.seconds = folder, tuple(task), seconds
        self.state, self.percent, self.doing = "waiting", 0, ""
        self.code: int | None = None
        self.said = list[str]()
        self.error, self.field = "", ""
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def end(self, state: str) -> None:
        """Kills it, or keeps it from beginning; `state` says why.  One that has ended stays."""
        with self._lock:
            if self.state in ("waiting", "running"):
                self.state = state
                _kill(self._process)

    def run(self) -> None:
        """Until its process has ended; in a thread."""
        reading, writing = os.pipe()
        with open(reading, encoding="utf-8", errors="replace") as lines:
            try:
                with self._lock:
                    if self.state != "waiting":
                        return
                    self._process = self._started(writing)
                    self.state = "running"
            finally:
                os.close(writing)
            timer = threading.Timer(self.seconds, self.end, ["stopped"])
            timer.start()
            for line in lines:
                self._hear(line)
        self.code = self._process.wait()
        timer.cancel()
        with self._lock:
            _kill(self._process)  # what it may have started
            if self._process.stdin is not None:
                self._process.stdin.close()
            if self.state == "running":
                self.state = "stopped" if self.code in _ENDED_BY_LIMITS else "done"

    def _started(self, writing: int) -> subprocess.Popen[bytes]:
        own = {
            "ESTIM_PROGRESS": "json",
            "ESTIM_INPUTS_WITHIN": str(self.folder.resolve()),
            "PYTHONSAFEPATH": "1",
            "PYTHONIOENCODING": "utf-8",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        return subprocess.Popen(
            [sys.executable, str(_WORKER), str(self.seconds), str(_BYTES), *self.task],
            cwd=self.folder,
            env={**os.environ, **own},
            stdin=subprocess.PIPE,
            stdout=writing,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def _hear(self, line: str) -> None:
        """A line of the command: progress or an error for a program, or words for a person."""
        record = _record(line)
        if "error" in record:
            self.error, self.field = str(record["error"]), str(record.get("field") or "")
        elif "percent" in record:
            self.percent, self.doing = int(str(record["percent"])), str(record.get("doing"))
        elif len(self.said) < _MOST_LINES and (words := line.rstrip()):
            self.said.append(one_line(shorten(words, 500)))


class Workers:
    """So many processes at once, and a queue of so many jobs."""

    def __init__(self, count: int, queue: int) -> None:
        self._pool = ThreadPoolExecutor(count)
        self._most = count + queue
        self._under_way = dict[Job, tuple[Future[None], Callable[[], None]]]()

    @property
    def is_full(self) -> bool:
        return len(self._under_way) >= self._most

    def submit(self, job: Job, then: Callable[[], None]) -> Future[None] | None:
        """`job` in its turn, and `then` after its end; None where the queue is full."""
        if self.is_full:
            return None
        future = self._pool.submit(job.run)
        self._under_way[job] = future, then
        future.add_done_callback(lambda _: self._ended(job))
        return future

    def ahead(self, job: Job) -> int:
        """How many jobs wait before this one."""
        waiting = [other for other in list(self._under_way) if other.state == "waiting"]
        return waiting.index(job) if job in waiting else 0

    def cancel(self, job: Job) -> None:
        """Ends a job, whether it runs or waits."""
        job.end("cancelled")
        if job in self._under_way:
            self._under_way[job][0].cancel()

    def close(self) -> None:
        """Ends all jobs."""
        for job in list(self._under_way):
            job.end("interrupted")
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _ended(self, job: Job) -> None:
        _, then = self._under_way.pop(job)
        then()


def _record(line: str) -> dict[str, object]:
    if not line.startswith("{"):
        return {}
    try:
        record = json.loads(line)
    except ValueError:
        return {}
    return record if isinstance(record, dict) else {}


def _limits() -> Iterator[int]:
    for name in ("SIGXCPU", "SIGKILL"):  # the first of one's own limit, the second of the system
        if hasattr(signal, name):
            yield -getattr(signal, name)


_ENDED_BY_LIMITS = tuple(_limits())


def _kill(process: subprocess.Popen[bytes] | None) -> None:
    if process is None:
        return
    try:
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return
