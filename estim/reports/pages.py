"""A report as files: the page and the figures that it shows.  Here alone it is known whether anybody wants figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Protocol

from estim.reports import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CODE = re.compile(r"(^```.*?^```$|`[^`\n]*`|^#.*$)", re.DOTALL | re.MULTILINE)
_BREAKS = re.compile(r"(?<=[\d)]) (?=(?:±|%|×|°|sd|mm|cm|m|s|kg|N|J|rad|Hz|deg)(?![\w]))|(?<=±) (?=\d)")

Drawers = Mapping[str, "Callable[[], Figure]"]
"""Path of a figure -> what draws it."""


class Text(Protocol):
    """A report in Markdown that shows the figures at the paths `pictures`."""

    def __call__(self, *, pictures: Collection[str]) -> str: ...


def unbroken(text: str) -> str:
    """Markdown whose numbers keep their "±", "%" and units on one line; code stays as it is."""
    return "".join(part if i % 2 else _BREAKS.sub("\u00a0", part) for i, part in enumerate(_CODE.split(text)))


def page(drawers: Drawers, text: Text, *, wanted: bool) -> dict[str, bytes]:
    """The figures and `report.md`, path -> bytes; without figures where they are not `wanted`."""
    drawn = drawers if wanted else {}
    return {path: figures.png(draw) for path, draw in drawn.items()} | {"report.md": unbroken(text(pictures=drawn.keys())).encode()}
