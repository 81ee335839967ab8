"""The server: where it listens, the address that it announces, and its end.  Starlette and uvicorn
are imported only once it starts.
"""

from __future__ import annotations

import secrets
import socket
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING

from estim.common import Interrupted, held
from estim.web.listening import At, listening

if TYPE_CHECKING:
    from estim.web.gate import Gate

_NEEDED = ("starlette", "uvicorn", "python_multipart")


def missing_packages() -> list[str]:
    """Names of the packages that the page needs and that are not installed."""
    return [name for name in _NEEDED if find_spec(name) is None]


def serve(at: At, announce: Callable[[str], None], *, browser: bool) -> None:
    """Serves the page until it is interrupted.

    announce : is called with the address, with its token, as soon as the page is available.
        browser : whether it is opened.  Raises InputError where the port is taken, EstimError where
        another server has the folder.
    """
    import uvicorn

    token = secrets.token_urlsafe(24)
    with (
        suppress(Interrupted, KeyboardInterrupt),  # its usual end
        held(at.folder / ".serving" / ".lock", within=at.folder),
        application(at, token) as (app, listener, address),
    ):
        config = uvicorn.Config(
            app,
            lifespan="off",
            ws="none",
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=2,
            limit_concurrency=500,
        )
        url = f"http://{address}/?token={token}"
        announce(url)
        if browser:
            webbrowser.open_new_tab(url)
        uvicorn.Server(config).run(sockets=[listener])


@contextmanager
def application(at: At, token: str) -> Iterator[tuple[Gate, socket.socket, str]]:
    """The page behind its gate, the socket that it is to listen on, and its address; its workers
    end with the block.  Raises InputError where the port is taken.
    """
    from estim.web.gate import Gate
    from estim.web.job_queue import JobQueue
    from estim.web.pages import Pages
    from estim.web.store import Store

    fits, previews = JobQueue(), JobQueue()
    listener, address = listening(at)
    try:
        app = Pages(Store(at.folder), fits, previews).app()
        yield Gate(app, address=address, token=token, at=at), listener, address
    finally:
        listener.close()
        fits.close()
        previews.close()
