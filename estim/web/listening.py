"""The address of the page, and the socket that listens there."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from pathlib import Path

from estim.common import InputError

PORT = 8765
ALL = ("0.0.0.0", "::")


@dataclass(frozen=True)
class At:
    """port : None for the default one, or any other where that is taken.  passphrase : for a page
    that other machines reach; "" where none does.
    """

    host: str
    port: int | None
    folder: Path
    passphrase: str = ""

    @property
    def is_local(self) -> bool:
        """Whether no other machine reaches the page."""
        return self.host in ("127.0.0.1", "localhost", "::1")


def listening(at: At) -> tuple[socket.socket, str]:
    """A socket that listens, and the host and port to reach it by.  Raises InputError."""
    family = socket.AF_INET6 if ":" in at.host else socket.AF_INET
    try:
        listener = socket.create_server(
            (at.host, PORT if at.port is None else at.port), family=family, backlog=500
        )
    except OSError as error:
        if at.port is None:
            return listening(At(at.host, 0, at.folder))
        rule = f"cannot be listened on ({(error.strerror or str(error)).lower()})"
        raise InputError(rule, field="--port", value=f"{at.host} {at.port}") from None
    host = socket.gethostname() if at.host in ALL else f"[{at.host}]" if ":" in at.host else at.host
    return listener, f"{host}:{listener.getsockname()[1]}"
