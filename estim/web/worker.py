"""The process that works for the page: a command of estim, or a preview of a file, within limits.

    python worker.py SECONDS BYTES run ARGUMENT...                   `estim ARGUMENT...`
    python worker.py SECONDS BYTES preview LANG FILE                 preview-LANG.json
    python worker.py SECONDS BYTES preview LANG FILE X Y [FILE...]   points-X-Y.png
    python worker.py SECONDS BYTES start LANG FILE FIELDS            start-N.json, start-N.png
    python worker.py SECONDS BYTES paper LANG                        report.pdf

The working folder is that of the answer or the file.  The process ends, and all that it started,
as soon as its standard input does: a server that is killed can send no signal.
"""

from __future__ import annotations

import os
import runpy
import signal
import sys
import threading
from contextlib import suppress


def _end_with_the_server(pipe: int) -> None:
    """Ends this process group at the end of what the server writes."""
    while os.read(pipe, 1024):
        pass
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _limit(seconds: int, size: int) -> None:
    """Limits of processor time (s), memory and files (bytes), where the system has them: macOS
    refuses one of memory.
    """
    if sys.platform != "win32":
        import resource

        limits = {"CPU": seconds, "AS": size, "FSIZE": 2**28, "CORE": 0}
        for name, most in limits.items():
            what = getattr(resource, f"RLIMIT_{name}")
            hard = resource.getrlimit(what)[1]
            least = most if hard == resource.RLIM_INFINITY else min(most, hard)
            with suppress(ValueError, OSError):
                resource.setrlimit(what, (least, least))


def main() -> None:
    seconds, size, task, *arguments = sys.argv[1:]
    # Windows lets whoever looks at a pipe wait for its reader, and libraries look at standard input
    # as they are loaded: they find an empty one
    pipe = os.dup(0)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    threading.Thread(target=_end_with_the_server, args=[pipe], daemon=True).start()
    _limit(int(seconds), int(size))
    # at the end: where estim is not installed, this is where it lies
    sys.path.append(os.path.abspath(os.path.join(__file__, "..", "..", "..")))
    if task != "run":
        from estim.web import preview

        getattr(preview, task)(*arguments)
        return
    sys.argv = ["estim", *arguments]
    runpy.run_module("estim", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
