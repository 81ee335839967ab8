"""SIGINT (Ctrl-C) and SIGTERM as a question that a long computation asks at moments when it can stop."""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from estim.errors import Interrupted

_GRACE = 1.0  # s in which a computation may stop by itself


@contextmanager
def asked_to_stop() -> Iterator[Callable[[], bool]]:
    """A function that tells whether a signal has asked to stop; call it where stopping is safe.

    If nobody calls it within a second of the signal (no step ends, or nothing is being sampled), or a second signal comes,
    Interrupted is raised wherever the program is.  A signal that is ignored (`nohup`, a job in the background) stays ignored.
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

    caught = [number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handle) for number in caught}
    try:
        yield asked
    finally:
        asked()
        for number, handler in before.items():
            signal.signal(number, handler)
