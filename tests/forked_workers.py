"""JobQueue of the page forked from a process that has loaded estim already, for tests of pages and
statuses: what is computed has a quarter of the draws, and a pixel in place of every figure.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from estim.web import job_queue, worker
from estim.web.job_queue import Job

FORKING = get_context("forkserver")
LOADED = ("estim.cli.tables", "estim.pipeline", "estim.web.preview", "estim.reports.analysis")
FORKING.set_forkserver_preload([*LOADED, "estim.reports.curve_figures", "estim.cli.commands"])


def _work(
    words: Sequence[str],
    folder: str,
    environment: Mapping[str, str],
    pixel: bytes,
    given: Connection,
    output: Connection,
) -> None:
    """In the new process: what `subprocess` does before a program begins, and the program."""
    from estim import sampling
    from estim.reports import pages

    sampling.Target = partial(sampling.Target, ess=1000.0)
    pages.png = lambda *_: pixel
    os.setsid()
    os.chdir(folder)
    os.environ.update(environment)
    for end, number in ((given, 0), (output, 1), (output, 2)):
        os.dup2(end.fileno(), number)
    given.close()  # or the end of what the server writes would not be seen
    output.close()
    sys.stdout, sys.stderr = (os.fdopen(fd, "w", encoding="utf-8", closefd=False) for fd in (1, 2))
    sys.argv = ["worker.py", *words]
    worker.main()


class Forked:
    """As much of `subprocess.Popen` as a job asks for."""

    def __init__(self, process: BaseProcess, stdin: Connection) -> None:
        self._process, self.stdin = process, stdin
        self.pid = process.pid

    def wait(self) -> int | None:
        self._process.join()
        return self._process.exitcode


def started(job: Job, output: int) -> Forked:
    """In the place of `Job._started`."""
    from conftest import PIXEL  # which the new process need not load

    given, stdin = FORKING.Pipe(duplex=False)
    environment = os.environ | job_queue._ENVIRONMENT
    environment |= {"ESTIM_INPUTS_WITHIN": str(job.folder.resolve())}
    words = [str(job.seconds), str(job_queue._BYTES), *job.task]
    said = Connection(os.dup(output), readable=False)
    process = FORKING.Process(
        target=_work, args=(words, str(job.folder), environment, PIXEL, given, said)
    )
    process.start()
    given.close()
    said.close()
    return Forked(process, stdin)
