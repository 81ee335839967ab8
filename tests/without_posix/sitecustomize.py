"""Python, at its start, as estim finds it on Windows: for estim's modules alone, what is missing
there is missing, no folder can be opened, and some names are impossible.

On any system: a text file that estim opens without saying its encoding is an error.
"""

from __future__ import annotations

import builtins
import io
import os
import signal
import sys
from pathlib import PurePath
from types import ModuleType
from typing import Any

MODULES = ("fcntl", "grp", "pwd", "resource", "termios")
MISSING = {
    "os": """fork forkpty killpg setsid setpgid getpgid getuid geteuid getgid chown fchmod mkfifo
        nice set_blocking sched_getaffinity sysconf uname statvfs wait4 WNOHANG O_NOFOLLOW
        O_DIRECTORY O_CLOEXEC O_NONBLOCK""",
    "signal": """SIGKILL SIGHUP SIGALRM SIGPIPE SIGUSR1 SIGUSR2 SIGCHLD SIG_BLOCK SIG_UNBLOCK
        SIG_SETMASK pthread_sigmask alarm setitimer""",
    "sys": "",
}
RESERVED = {"con", "prn", "aux", "nul"}


class Stand(ModuleType):
    """A module less what is missing, with some things instead."""

    def __init__(self, module: ModuleType, missing: str, instead: dict[str, Any]) -> None:
        vars(self).update(_module=module, _missing=set(missing.split()), _instead=instead)

    def __getattr__(self, name: str) -> Any:
        if name in self._missing:
            raise AttributeError(f"module {self._module.__name__!r} has no attribute {name!r}")
        return self._instead.get(name) or getattr(self._module, name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self._module, name, value)


def possible(path: object) -> None:
    """Raises OSError for a name that no file can have."""
    for part in (
        PurePath(os.fsdecode(path)).parts[1:] if isinstance(path, str | os.PathLike) else ()
    ):
        if set('<>:"|?*\\') & set(part) or part[-1] in ". " or part.split(".")[0] in RESERVED:
            raise OSError(22, "Invalid argument", os.fspath(path))


def of_paths(name: str) -> Any:
    """A function of `os` that takes no folder to start from and no impossible name."""
    real = getattr(os, name)

    def function(path: Any, *arguments: Any, **named: Any) -> Any:
        if any(named.pop(key, None) is not None for key in ("dir_fd", "src_dir_fd", "dst_dir_fd")):
            raise NotImplementedError("dir_fd unavailable on this platform")
        possible(path)
        if name == "open" and os.path.isdir(path):
            raise PermissionError(13, "Permission denied", path)
        return real(path, *arguments, **named)

    return function


RELATIVE = ("mkdir", "open", "replace", "rmdir", "stat", "unlink")
FUNCTIONS = {name: of_paths(name) for name in RELATIVE}
INSTEAD = {
    "os": FUNCTIONS | {"supports_dir_fd": {FUNCTIONS["mkdir"]}, "name": "nt"},
    "signal": {},
    "sys": {"platform": "win32"},
}
STANDS = {
    name: Stand(module, MISSING[name], INSTEAD[name])
    for name, module in {"os": os, "signal": signal, "sys": sys}.items()
}
_import, _open, _text_encoding = builtins.__import__, builtins.open, io.text_encoding


def is_ours(names: dict[str, Any] | None) -> bool:
    """Whether the names of a module are those of one of estim's, or of a command or a worker."""
    said = names or {}
    package = PurePath(str(said.get("__file__"))).parts[-3:]
    return str(said.get("__name__")).partition(".")[0] == "estim" or (
        said.get("__name__") == "__main__"
        and (package[-2:] == ("estim", "__main__.py") or package == ("estim", "web", "worker.py"))
    )


def importing(name: str, *rest: Any, **named: Any) -> Any:
    """rest : names of who imports, local names, what is wanted of the module, level."""
    module = _import(name, *rest, **named)
    if rest[3:] not in ((), (0,)) or not is_ours(rest[0] if rest else None):
        return module
    if name in MODULES:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return STANDS.get(name, module)


def opening(
    file: Any, mode: str = "r", buffering: int = -1, encoding: Any = None, *rest: Any, **named: Any
) -> Any:
    if "b" not in mode and encoding is None and is_ours(sys._getframe(1).f_globals):
        raise LookupError(f"{file}: opened without an encoding")
    return _open(file, mode, buffering, encoding, *rest, **named)


def text_encoding(encoding: Any, stacklevel: int = 2) -> Any:
    """Of `Path.open`, `read_text` and `write_text`, called by who wants that."""
    if encoding is None and is_ours(sys._getframe(2).f_globals):
        raise LookupError("a path opened without an encoding")
    return _text_encoding(encoding, stacklevel)


builtins.open, io.text_encoding = opening, text_encoding
if os.environ.get("ESTIM_TESTS_SYSTEM") == "windows":
    builtins.__import__ = importing
