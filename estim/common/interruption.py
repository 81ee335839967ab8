"""Signals to stop: Ctrl-C (SIGINT), SIGTERM, and SIGHUP, which comes when a terminal is closed or a connection lost.

`asked_to_stop` makes them a question that a long computation asks at moments when it can stop; `ended_by_signals` is for what has
nothing to keep.  A signal that is ignored (`nohup`, a job in the background) stays ignored.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from estim.common import Interrupted

STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_GRACE = 1.0  # s in which a computation may stop by itself


@contextmanager
def asked_to_stop() -> Iterator[Callable[[], bool]]:
    """A function that tells whether a signal has asked to stop; call it where stopping is safe.

    If nobody calls it within a second of the signal (no step ends, or nothing is being sampled), or a second signal comes,
    Interrupted is raised wherever the program is.
    """
    timers: list[threading.Timer] = []

    def handle(number: int, _frame: FrameType | None) -> None:
        if timers:
            raise Interrupted
        timers.append(threading.Timer(_GRACE, _thread.interrupt_main, (number,)))
        timers[0].daemon = True
        timers[0].start()

    def asked() -> bool:
        for timer in timers:
            timer.cancel()
        return bool(timers)

    with _handled(handle):
        try:
            yield asked
        finally:
            asked()


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Every signal to stop raises KeyboardInterrupt, as Ctrl-C does."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    with _handled(handle):
        yield


@contextmanager
def _handled(handle: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """`handle` in place of what the signals to stop do now; those that are ignored stay ignored."""
    caught = [number for number in STOPPING if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handle) for number in caught}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
