"""The versions of installed packages, which take a millisecond to find and stay as they are while a
program runs.
"""

from __future__ import annotations

from contextvars import ContextVar
from functools import cache

_ENGINES = ("estim", "numpy", "scipy", "emcee")
USED: ContextVar[dict[str, str]] = ContextVar("USED")
"""Of packages whose plug-ins were used in the block of `estim.common.inputs_read` under way, or the
session.
"""


@cache
def version(package: str) -> str:
    """As `importlib.metadata` says.  Raises its PackageNotFoundError."""
    from importlib import metadata

    return metadata.version(package)


def engine_versions() -> dict[str, str]:
    """Versions of what computes the numbers, and of packages whose plug-ins were used."""
    return {package: version(package) for package in _ENGINES} | USED.get({})
