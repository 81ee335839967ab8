"""Figures of a report that stands in a folder: which it shows, and how they go when it goes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

from estim.common.errors import EstimError
from estim.common.storage import read_file, remove_empty, remove_files

_LONGEST_REPORT = 2**26  # bytes; what is longer is no report of ours
_PICTURE = re.compile(rb"\]\(figures/([\w%.+~-]+\.png)\)")


def pictures_of(report: Path, *, within: Path) -> set[str]:
    """Names of the figures that a report shows; none where there is no report, or what stands there cannot be one of ours."""
    with suppress(EstimError):
        names = {unquote(name.decode()) for name in _PICTURE.findall(read_file(report, at_most=_LONGEST_REPORT, within=within) or b"")}
        return {name for name in names if name.isprintable() and Path(name).name == name}
    return set()


def remove_pictures(folder: Path, names: Iterable[str], *, within: Path) -> None:
    """Remove the figures `names` of the report in `folder`, and their folder where nothing else is in it."""
    for name in names:
        with suppress(EstimError):  # what is no plain file is none of ours
            remove_files(folder / "figures", [name], within=within)
    remove_empty(folder / "figures", within=within)
