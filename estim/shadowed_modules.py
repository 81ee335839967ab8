"""Files of a user that take the place of a module: a `random.py` beside the data is found before
Python's.

It imports next to nothing, so that it works where a `re.py` or a `typing.py` is in the way.
"""

from __future__ import annotations

import os
import sys
from importlib.machinery import PathFinder, all_suffixes

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

HOME = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
"""The folder that holds the package `estim`."""


def forget_working_folder() -> None:
    """Takes the working folder from the places where modules are looked for, as `python -P` would.

    `python -m estim` puts it first.  It stays where estim itself is there: nobody else offers it
    then.
    """
    if not sys.flags.safe_path and sys.path[:1] == [working_folder()] and sys.path[0] != HOME:
        del sys.path[0]


def namesake_behind(error: BaseException) -> str:
    """The file that has the name of a module of Python, or of a package found later on the path,
    and let `error` happen; "" if none did.
    """
    return next((file for file in _named(error) if _in_the_way(os.path.abspath(file))), "")


def in_the_way(file: str) -> str:
    """What to say of a namesake: one line."""
    shown = file if file.isprintable() else ascii(file)
    return (
        f"{shown}: is in the way: it is found in place of the module '{_module(file)}' that estim "
        "needs; rename it, or take its folder off Python's path"
    )


def _module(file: str) -> str:
    """The name under which a file is imported."""
    path = _folder(file) if _is_package(file) else file
    return os.path.splitext(os.path.basename(path))[0]


def _named(error: BaseException | None) -> Iterator[str]:
    """The files that an error names, and those it came through."""
    while error is not None:
        module = sys.modules.get(str(getattr(error, "name", None)).partition(".")[0])
        behind = [getattr(error, "path", None), getattr(error, "filename", None)]
        behind += [
            getattr(m, "__file__", None)
            for m in (getattr(error, "obj", None), module)
            if isinstance(m, type(sys))
        ]
        yield from (file for file in behind if isinstance(file, str))
        trace = error.__traceback__
        while trace is not None:
            yield trace.tb_frame.f_code.co_filename
            trace = trace.tb_next
        error = error.__cause__ or error.__context__


def _in_the_way(file: str) -> bool:
    """Whether a file takes the place of another module."""
    standard = os.path.dirname(os.path.abspath(os.__file__))
    if _own(file) or file.startswith(os.path.join(standard, "")):
        return False
    if not file.endswith(tuple(all_suffixes())):  # a random.toml takes the place of nothing
        return False
    folder = os.path.dirname(_folder(file)) if _is_package(file) else _folder(file)
    name = _module(file)
    places = [working_folder(), *(os.path.abspath(place) for place in sys.path)]
    if folder not in places:
        return False
    return (
        name in sys.stdlib_module_names
        or PathFinder.find_spec(name, places[places.index(folder) + 1 :]) is not None
    )


def working_folder() -> str:
    """Its path; "" where it was removed."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _own(file: str) -> bool:
    return os.path.realpath(file).startswith(os.path.join(os.path.realpath(HOME), "estim", ""))


def _is_package(file: str) -> bool:
    return os.path.basename(file) == "__init__.py"


def _folder(file: str) -> str:
    return os.path.dirname(os.path.abspath(file))
