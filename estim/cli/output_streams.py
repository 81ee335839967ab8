"""Standard output and standard error that a command can always write to: closed, full, without a
reader, unable to show a letter.

Where nothing can be written any more, what follows is dropped and the reason kept: the numbers and
files that a command makes do not depend on whether what it prints is read.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TextIO

from estim.common import in_ascii

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

# EX_IOERR of sysexits.h; what a shell reports of a command that SIGPIPE ended
CANNOT_SAY, NO_READER = 74, 141


class Outlet(io.RawIOBase):
    """The bytes of a stream, of which those that cannot be written are dropped."""

    def __init__(self, stream: Any) -> None:
        """stream : bytes without a buffer of their own.  error : number of what kept one from being
        written, 0 while all are.
        """
        self._stream, self.error = stream, 0

    def write(self, data: ReadableBuffer, /) -> int:
        if not self.error:
            try:
                if (written := self._stream.write(data)) is not None:
                    return int(written)
                self.error = errno.EAGAIN
            except OSError as error:
                self.error = error.errno or errno.EIO
        return len(memoryview(data))

    def isatty(self) -> bool:
        return bool(self._stream.isatty())

    def fileno(self) -> int:
        return int(self._stream.fileno())

    def writable(self) -> bool:
        return True


class _Legible(io.TextIOWrapper):
    """Text of an encoding that may lack the marks of numbers and units."""

    def write(self, text: str, /) -> int:
        try:
            text.encode(self.encoding)
        except UnicodeEncodeError:
            text = in_ascii(text)
        return super().write(text)


@contextlib.contextmanager
def outlets() -> Iterator[Outlet]:
    """`sys.stdout` and `sys.stderr` through outlets while the block runs; that of the first is
    given.  Marks of numbers and units that they cannot show are written as on a keyboard, other
    letters like '\\u03b3'.
    """
    # a closed one must not become the number of a file that is written
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    before = sys.stdout, sys.stderr
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        outlet, sys.stdout = _through(sys.stdout or nowhere)
        _, sys.stderr = _through(sys.stderr or nowhere)
        try:
            yield outlet
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            sys.stdout, sys.stderr = before


def _through(stream: TextIO) -> tuple[Outlet, TextIO]:
    """A stream of text through an outlet; one that has no bytes, of a notebook say, as it is."""
    if not hasattr(stream, "buffer"):
        return Outlet(None), stream
    outlet = Outlet(getattr(stream.buffer, "raw", stream.buffer))
    buffer = io.BufferedWriter(outlet)
    return outlet, _Legible(buffer, stream.encoding, "backslashreplace", line_buffering=True)
