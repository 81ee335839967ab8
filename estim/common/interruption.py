"""Signals to stop: Ctrl-C (SIGINT), SIGTERM, and SIGHUP, which comes when a terminal is closed or a
connection lost.

A signal that is ignored (`nohup`, a job in the background) stays ignored.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from estim.common.errors import Interrupted

STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Every signal to stop raises Interrupted where the program is: files are written whole, so
    that it may be anywhere.
    """

    def handle(_number: int, _frame: FrameType | None) -> None:
        raise Interrupted

    caught = [number for number in STOPPING if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handle) for number in caught}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
