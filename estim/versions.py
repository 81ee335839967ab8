"""The version of an installed package, which takes a millisecond to find and stays as it is while a program runs."""

from __future__ import annotations

from functools import cache


@cache
def version(package: str) -> str:
    """As `importlib.metadata` says.  Raises its PackageNotFoundError."""
    from importlib import metadata

    return metadata.version(package)
