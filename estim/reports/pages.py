"""A report as files: the page and the figures that it shows.  Here alone it is known whether anybody wants figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Protocol

from estim.common import phrase
from estim.drawing import png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CODE = re.compile(r"(^```.*?^```$|`[^`\n]*`|^#[^\n]*$)", re.DOTALL | re.MULTILINE)
_BREAKS = re.compile(r"(?<=[\d)]) (?=(?:±|%|×|°|sd|mm|cm|m|s|kg|N|J|rad|Hz|deg)(?![\w]))|(?<=±) (?=\d)")

Drawers = Mapping[str, "Callable[[], Figure]"]
"""Path of a figure -> what draws it."""


class Text(Protocol):
    """A report in Markdown that shows the figures at the paths `pictures`."""

    def __call__(self, *, pictures: Collection[str]) -> str: ...


def unbroken(text: str) -> str:
    """Markdown whose numbers keep their "±", "%" and units on one line; code stays as it is."""
    return "".join(part if i % 2 else _BREAKS.sub("\u00a0", part) for i, part in enumerate(_CODE.split(text)))


def marked(figure: Figure) -> Figure:
    """The figure, saying of its data that they are SYNTHETIC."""
    said = figure.get_suptitle()
    figure.suptitle(phrase("{title}; SYNTHETIC data", title=said) if said else phrase("SYNTHETIC data"), fontsize=9)
    return figure


def page(drawers: Drawers, text: Text, *, wanted: bool, kind: str = "") -> dict[str, bytes]:
    """The figures and `report.md`, path -> bytes; without figures where they are not `wanted`.

    kind : of the data; where they are "synthetic" every figure says so.
    """
    drawn = drawers if wanted else {}
    shown = {path: png(lambda draw=draw: marked(draw()) if kind == "synthetic" else draw()) for path, draw in drawn.items()}
    return shown | {"report.md": unbroken(text(pictures=drawn.keys())).encode()}
