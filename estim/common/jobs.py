"""The same function for many numbers (or other small things), by several processes.

Workers are spawned (no state is inherited by chance), compute with one thread each, and leave
Ctrl-C and the end of a terminal to the parent, which waits for the calls under way and raises it.
They end with their parent, however it ends.  Where one of them is killed (for want of memory, say)
what is missing is done again, once, by half as many.
"""

from __future__ import annotations

import copyreg
import gc
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from itertools import islice
from queue import SimpleQueue
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from estim.common.errors import NumericalError
from estim.common.interruption import STOPPING
from estim.common.phrases import at_commands, language, spoken

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future, ProcessPoolExecutor

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
_MOST = 61 if sys.platform == "win32" else 2**10  # processes: Windows waits for no more of them
_MOST_SUBMITTED = 2 * 2**10  # calls at once: a signal to stop waits while they are submitted
_task: Callable[[Any], Any] | None = None  # of a worker process


def run_parallel(
    task: Callable[[K], T],
    numbers: Sequence[K],
    *,
    jobs: int,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
    on_done: Callable[[K], None] | None = None,
    wait_on_error: bool = True,
) -> list[T]:
    """`task(n)` for each of `numbers`, in their order, by `jobs` processes (1: this one), or by
    `executor`, which takes care of its own workers.

    progress : called with how many are done.
    on_done : called with each that is done.  `task` must be picklable, read-only mappings included;
        so must what it returns.  wait_on_error : whether an error or an interrupt waits for the
        calls that are under way, which may keep what they find; else they are given up.

    Raises NumericalError where a worker is killed, and another after the work was taken up again.
    """
    done: dict[K, T] = {}
    task = partial(_speaking, task, language(), at_commands())
    results: Generator[tuple[K, T]]
    if executor is not None:
        results = _through(executor, task, numbers)
    elif jobs <= 1 or not numbers:
        results = ((n, task(n)) for n in numbers)
    else:
        results = _in_pool(task, numbers, min(jobs, len(numbers), _MOST), wait_on_error)
    with closing(results):  # an error here ends the workers before it goes on
        for n, result in results:
            done[n] = result
            if on_done is not None:
                on_done(n)
            if progress is not None:
                progress(len(done))
    return [done[n] for n in numbers]


def _speaking(task: Callable[[K], T], language: str, commands: bool, n: K) -> T:
    """`task(n)` in a process whose language and reader may be others."""
    with spoken(language, commands=commands):
        return task(n)


def _through(
    executor: Executor, task: Callable[[K], T], numbers: Sequence[K]
) -> Generator[tuple[K, T]]:
    """By an executor, which may have any number of workers: those calls that wait are given up on
    an error.

    Not by `as_completed`, which holds the locks of all futures while it starts: an interrupt there
    leaves them locked, and the executor waits for them for ever.
    """
    waiting = iter(numbers)
    numbered: dict[Future[T], K] = {}
    done: SimpleQueue[Future[T]] = SimpleQueue()

    def submit(most: int) -> None:
        with _interrupts_held():  # an executor may start its processes now
            for n in islice(waiting, most):
                future = executor.submit(task, n)
                numbered[future] = n
                future.add_done_callback(done.put)

    try:
        submit(_MOST_SUBMITTED)
        while numbered:
            future = done.get()
            submit(1)
            yield numbered.pop(future), future.result()
    finally:
        for future in numbered:
            future.cancel()


def _in_pool(
    task: Callable[[K], T], numbers: Sequence[K], jobs: int, wait_on_error: bool
) -> Generator[tuple[K, T]]:
    from concurrent.futures.process import BrokenProcessPool

    missing = dict.fromkeys(numbers)
    for n_worker in (jobs, max(jobs // 2, 1)):
        try:
            for n, result in _by_workers(task, list(missing), n_worker, wait_on_error):
                del missing[n]
                yield n, result
        except BrokenProcessPool:
            continue
        return
    raise NumericalError(
        f"a worker process was killed, twice: is there memory for {jobs} processes?  Fewer "
        "take less ('jobs')"
    )


def _by_workers(
    task: Callable[[K], T], numbers: Sequence[K], jobs: int, wait_on_error: bool
) -> Generator[tuple[K, T]]:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ExitStack() as stack:
        stack.enter_context(_environment_of_workers())
        with _interrupts_held():  # a process of multiprocessing's own is started here
            pool = stack.enter_context(
                ProcessPoolExecutor(
                    jobs,
                    get_context("spawn"),
                    _start,
                    (pickle.dumps(task, pickle.HIGHEST_PROTOCOL),),
                )
            )
        try:
            for n, result in _through(pool, _call, numbers):
                yield n, pickle.loads(result)
        # where the caller was interrupted between two results this is GeneratorExit
        except BaseException:
            if not wait_on_error:
                _end(pool)
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _end(pool: ProcessPoolExecutor) -> None:
    """Ends the workers, as `terminate_workers` does from Python 3.14 on."""
    for process in list(pool._processes.values()):
        process.terminate()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Signals to stop come after this: processes started meanwhile never see Ctrl-C or the end of a
    terminal, the parent does.
    """
    if sys.platform == "win32":
        yield
    else:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, set(STOPPING))
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment_of_workers() -> Iterator[None]:
    """What spawned processes inherit: linear algebra on one thread; Python starts from its own
    modules, not from files in the working folder.
    """
    stated = dict.fromkeys((*_THREADS, "PYTHONSAFEPATH"), "1")
    before = {name: os.environ.get(name) for name in stated}
    os.environ.update(stated)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


# results hold read-only mappings, which neither pickle nor copy supports
copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))


def _start(task: bytes) -> None:
    """Prepare a worker process."""
    global _task
    gc.set_threshold(500_000)  # as in the command line, before the task loads its modules
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        # blocked when this process was started; its parent ends it by this signal
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if not sys.warnoptions:
        # as in the command line: a result that is no number is reported as such
        warnings.simplefilter("ignore")
    _task = pickle.loads(task)


def _end_with_parent() -> None:
    """Ends this process as soon as its parent has ended: a parent that is killed can notify
    nobody.
    """
    from multiprocessing import parent_process

    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _call(n: Any) -> bytes:
    assert _task is not None
    return pickle.dumps(_task(n), pickle.HIGHEST_PROTOCOL)
