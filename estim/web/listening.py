"""Where the page is to be had, and the socket that listens there."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

from estim.common import InputError

PORT = 8765


@dataclass(frozen=True)
class At:
    """port : None for the usual one, or any other where that is taken.  passphrase : for a page
    that other machines reach; "" where none does.
    """

    host: str
    port: int | None
    folder: Path
    passphrase: str = ""

    @property
    def is_local(self) -> bool:
        """Whether no other machine reaches the page."""
        if self.host == "localhost":
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return False


@contextmanager
def listening(at: At) -> Iterator[tuple[socket.socket, str]]:
    """A socket that listens, and the host and port to reach it by.  Raises InputError."""
    family = socket.AF_INET6 if ":" in at.host else socket.AF_INET
    for port in (PORT, 0) if at.port is None else (at.port,):
        listener = socket.socket(family)
        try:
            if os.name == "posix":  # elsewhere it would share the port with others
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((at.host, port))
            listener.listen(500)
        except OSError as error:
            listener.close()
            if port == (at.port or 0):
                rule = f"cannot be listened on ({(error.strerror or str(error)).lower()})"
                value = f"{at.host} {port}"
                raise InputError(rule, field="--port", value=value) from None
            continue
        with listener:
            yield listener, f"{_shown(at.host)}:{listener.getsockname()[1]}"
        return


def _shown(host: str) -> str:
    """A host as a browser wants it; of one that stands for all addresses, the machine's name."""
    if host in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host
