"""The versions of installed packages, which take a millisecond to find and stay as they are while a
program runs.
"""

from __future__ import annotations

from functools import cache

_ENGINES = ("estim", "numpy", "scipy", "lmfit", "emcee")


@cache
def version(package: str) -> str:
    """As `importlib.metadata` says.  Raises its PackageNotFoundError."""
    from importlib import metadata

    return metadata.version(package)


def engine_versions() -> dict[str, str]:
    """Versions of what computes the numbers: of numba, too, where it is installed (the extra
    `fast`).
    """
    from importlib import metadata

    found = {package: version(package) for package in _ENGINES}
    try:
        return found | {"numba": version("numba")}
    except metadata.PackageNotFoundError:
        return found
