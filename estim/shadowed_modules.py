"""Files of a user that take the place of a module: a `random.py` beside the data is found before
Python's.

It imports next to nothing, so that it works where a `re.py` or a `typing.py` is in the way.
"""

from __future__ import annotations

import os
import sys

HOME = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
"""The folder that holds the package `estim`."""


def forget_working_folder() -> None:
    """Takes the working folder from the places where modules are looked for, as `python -P` would.

    `python -m estim` puts it first.  It stays where estim itself is there: nobody else offers it
    then.
    """
    if not sys.flags.safe_path and sys.path[:1] == [working_folder()] and sys.path[0] != HOME:
        del sys.path[0]


def working_folder() -> str:
    """Its path; "" where it was removed."""
    try:
        return os.getcwd()
    except OSError:
        return ""
