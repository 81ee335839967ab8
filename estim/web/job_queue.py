"""Commands in processes of their own: a queue, limits, progress, and an end without a wait.

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
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from estim.common import one_line, shorten

_WORKER = Path(__file__).with_name("worker.py")
_BYTES = 4 * 1024**3  # address space: libraries are mapped whole
_MOST_LINES = 300
_MOST_WAITING = 100  # jobs
_ENVIRONMENT = {
    "ESTIM_PROGRESS": "json",
    "PYTHONSAFEPATH": "1",
    "PYTHONIOENCODING": "utf-8",
    "OMP_NUM_THREADS": "1",
}


class Job:
    """One process: what it is to do, how far it is, and the lines that it printed.

    state : "waiting", "running", "done", "cancelled", "interrupted", "stopped" (a limit).
    """

    def __init__(self, folder: Path, task: Sequence[str], *, seconds: int) -> None:
        self.folder, self.task, self.seconds = folder, task, seconds
        self.state, self.percent, self.doing, self.error, self.field = "waiting", 0, "", "", ""
        self.code: int | None = None
        self.lines = list[str]()
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def end(self, state: str) -> None:
        """Kills it, or keeps it from beginning; `state` says why.  One that has ended stays."""
        with self._lock:
            if self.state in ("waiting", "running"):
                self.state = state
                self._kill()

    def run(self) -> None:
        """Until its process has ended; in a thread."""
        reading, writing = os.pipe()
        with open(reading, encoding="utf-8", errors="replace") as lines:
            try:
                with self._lock:
                    if self.state != "waiting":
                        return
                    self.state = "stopped"  # where no process can be started
                    process = self._process = self._started(writing)
                    self.state = "running"
            finally:
                os.close(writing)
            timer = threading.Timer(self.seconds, self.end, ["stopped"])
            timer.start()
            for line in lines:
                self._read_line(line)
        self.code = process.wait()
        timer.cancel()
        assert process.stdin is not None
        process.stdin.close()
        # a signal from elsewhere is a limit
        self.end("done" if self.code >= 0 else "stopped")

    def _started(self, output: int) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, str(_WORKER), str(self.seconds), str(_BYTES), *self.task],
            cwd=self.folder,
            env=os.environ | _ENVIRONMENT | {"ESTIM_INPUTS_WITHIN": str(self.folder.resolve())},
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def _kill(self) -> None:
        """Ends the process, and all that it started and that may outlive it."""
        if self._process is not None:
            with suppress(ProcessLookupError, PermissionError):
                if sys.platform == "win32":
                    self._process.kill()
                else:
                    os.killpg(self._process.pid, signal.SIGKILL)

    def _read_line(self, line: str) -> None:
        """A line of the command: progress or an error for a program, or words for a person."""
        with suppress(ValueError):
            record = json.loads(line) if line.startswith("{") else {}
            self.error, self.field = (
                record.get("error", self.error),
                record.get("field", self.field) or "",
            )
            self.percent = max(self.percent, record.get("percent", 0))
            self.doing = record.get("doing", self.doing)
            if record:
                return
        if len(self.lines) < _MOST_LINES and line.strip():
            self.lines.append(one_line(shorten(line.rstrip(), 500)))


class JobQueue:
    """So many processes at once, one for each core unless stated, and a queue of so many jobs."""

    def __init__(self, count: int | None = None, queue: int = _MOST_WAITING) -> None:
        count = count or os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(count)
        self._most = count + queue
        self._under_way = dict[Job, Future[None]]()

    @property
    def is_full(self) -> bool:
        return len(self._under_way) >= self._most

    def submit(self, job: Job, then: Callable[[], None]) -> Future[None]:
        """`job` in its turn, and `then` after its end; none may be given to a full queue."""
        assert not self.is_full
        future = self._under_way[job] = self._pool.submit(job.run)

        def ended(_: Future[None]) -> None:
            self._under_way.pop(job)
            then()

        future.add_done_callback(ended)
        return future

    def cancel(self, job: Job) -> None:
        """Ends a job, whether it runs or waits."""
        job.end("cancelled")
        if future := self._under_way.get(job):
            future.cancel()

    def close(self) -> None:
        """Ends all jobs."""
        for job in list(self._under_way):
            job.end("interrupted")
        self._pool.shutdown(cancel_futures=True)
