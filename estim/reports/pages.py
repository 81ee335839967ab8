"""A report as files: the page and the figures that it shows.  Here alone it is known whether anybody wants figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import TYPE_CHECKING, Protocol

from estim.common import later, phrase
from estim.drawing import texts_of
from estim.reports import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SYNTHETIC = later("SYNTHETIC")
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


def marked(draw: Callable[[], Figure]) -> Figure:
    """A figure that says of its data that they are SYNTHETIC, where none of its titles does."""
    figure = draw()
    if any(phrase(_SYNTHETIC) in one.get_text() for one in texts_of(figure)):
        return figure
    said = figure.get_suptitle()
    at_top = [legend for legend in figure.legends if getattr(legend, "_outside_loc", None) == "upper"]
    if at_top:  # where a title of the figure would lie
        at_top[0].set_title(phrase("SYNTHETIC data"))
        at_top[0].get_title().set_fontsize(9)
    elif said:
        figure.suptitle(phrase("{title}; SYNTHETIC data", title=said), fontsize=8)
    elif figure.get_layout_engine() is None:  # placed by hand
        figure.text(0.98, 0.99, phrase("SYNTHETIC data"), ha="right", va="top", fontsize=9)
    else:
        figure.suptitle(phrase("SYNTHETIC data"), fontsize=9)
    return figure


def page(drawers: Drawers, text: Text, *, wanted: bool, synthetic: bool = False) -> dict[str, bytes]:
    """The figures and `report.md`, path -> bytes; without figures where they are not `wanted`.

    synthetic : whether data are; then every figure says so.
    """
    drawn = drawers if wanted else {}
    shown = {path: figures.png(partial(marked, draw) if synthetic else draw) for path, draw in drawn.items()}
    return shown | {"report.md": unbroken(text(pictures=drawn.keys())).encode()}
