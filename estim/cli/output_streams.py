"""Standard output and standard error that a command can always write to: closed, full, without a
reader, unable to show a letter.

Where nothing can be written any more, what follows is dropped and the reason kept: the numbers and
files that a command makes do not depend on whether somebody reads what it says.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import BinaryIO, TextIO

# EX_IOERR of sysexits.h; what a shell says of a command that SIGPIPE ended
CANNOT_SAY, NO_READER = 74, 141


class Outlet(io.TextIOBase):
    """A text stream that drops what cannot be written.  A letter that it cannot show is written
    like '\\u03b3'.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._error = stream, 0
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding

    @property
    def buffer(self) -> BinaryIO | None:
        """Where click writes what a shell asks it to complete, as bytes."""
        return getattr(self._stream, "buffer", None)

    @property
    def trouble(self) -> str:
        """Why something could not be written, in words; "" where all was, or only the reader was
        gone, as `head` is.
        """
        return (
            f"cannot be written ({os.strerror(self._error).lower()})"
            if self.code == CANNOT_SAY
            else ""
        )

    @property
    def code(self) -> int:
        """The exit code that this asks for where nothing else asks for one."""
        return 0 if not self._error else NO_READER if self._error == errno.EPIPE else CANNOT_SAY

    def write(self, text: str, /) -> int:
        if not self._error:
            try:
                self._stream.write(text)
            except OSError as error:
                self._drop(error)
        return len(text)

    def flush(self) -> None:
        """Also called when this is thrown away, perhaps after the stream beneath was closed."""
        if not (self._error or self._stream.closed):
            try:
                self._stream.flush()
            except OSError as error:
                self._drop(error)

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    def writable(self) -> bool:
        return True

    def _drop(self, error: OSError) -> None:
        """Nothing is written from now on; what the stream still holds goes nowhere, or Python would
        complain at its end.
        """
        self._error = error.errno or errno.EIO
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), self._stream.fileno())


@contextlib.contextmanager
def outlets() -> Iterator[Outlet]:
    """`sys.stdout` and `sys.stderr` as outlets while the block runs; the first is given."""
    # a closed one must not become the number of a file that is written
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    before = sys.stdout, sys.stderr
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        out, err = (Outlet(nowhere if stream is None else stream) for stream in before)
        sys.stdout, sys.stderr = out, err
        try:
            yield out
        finally:
            out.flush()
            err.flush()
            sys.stdout, sys.stderr = before
