"""How every figure is drawn: by matplotlib's object interface (no pyplot state), texts literally, one set of colours.

White background and dark ink: legible on a light and on a dark page.  Colours are those of Okabe and Ito, which readers
with any colour vision can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import mathtext, signed

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.text import Text

BLUE, ORANGE, GREEN, PURPLE, GREY, INK = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#8A8A8A", "#222222"
PALE = "#AAD0E5"  # a third of the blue on white
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, INK, GREY)
_DPI = 150
_COMPRESSION = 4  # of 9; more costs time and saves next to nothing
MARKS = ("o", "s", "^", "D", "v", "P")
WIDTH = 7.2


def png(draw: Callable[[], Figure]) -> bytes:
    """What `draw` draws, as PNG without a date in it: the same figure gives the same bytes, whatever a user's own style is.

    Every text is shown literally; what matplotlib would take for mathematics is that only where `estim.common.labels` made it so.
    """
    from matplotlib import style

    with style.context("default"):
        figure = draw()
        show_literally(figure)
        return as_png(figure)


def show_literally(figure: Figure) -> None:
    """Marks every text of a finished figure as no mathematics but where `estim.common.labels` made it so.  To be done once."""
    for text in texts_of(figure):
        text.set_text(mathtext(text.get_text()))


def as_png(figure: Figure) -> bytes:
    """A figure as PNG.  Its parts are placed here, once: left to it, `savefig` would draw the whole figure for that and then a second time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    figure.set_dpi(_DPI)
    canvas = FigureCanvasAgg(figure)
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    canvas.print_png(buffer, metadata={"Software": None}, pil_kwargs={"compress_level": _COMPRESSION})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def handed_out(figure: Figure | None, draw: Callable[[Figure], None], height: float) -> Figure:
    """What a user gets: `draw` on the user's own figure in the user's style, or on a new one, which a notebook shows by itself."""
    from matplotlib import style

    if figure is None:
        with style.context("default"):
            figure = _notebook_figure()(figsize=(WIDTH, height), layout="constrained", facecolor="white")
            draw(figure)
    else:
        draw(figure)
    show_literally(figure)
    return figure


@cache
def _notebook_figure() -> type[Figure]:
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that a notebook shows, whatever its settings."""

        def _repr_png_(self) -> bytes:
            return as_png(self)

    return NotebookFigure


def texts_of(artist: Artist) -> Iterator[Text]:
    """The texts of a figure but for those of ticks, which are written anew whenever they are drawn (`name_ticks`)."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for part in artist.get_children():
        if isinstance(part, Text):
            yield part
        elif isinstance(part, Axis):
            yield part.label
        else:
            yield from texts_of(part)


def name_ticks(axis: Axis, places: ArrayLike, names: Sequence[str], *, fontsize: float = 10.0, rotation: float = 0.0) -> None:
    """Ticks at `places` with `names`, shown literally as `png` shows all other text.  fontsize : points.  rotation : degrees."""
    axis.set_ticks(places, [mathtext(name) for name in names], fontsize=fontsize, rotation=rotation)


def tick_texts(ticks: FloatArray) -> list[str]:
    """Numbers (n_tick,) with as many digits as tell them apart, all alike."""
    largest = float(np.max(np.abs(ticks), initial=0.0))
    apart = float(np.min(np.diff(ticks))) if ticks.size > 1 else largest
    notation = "f" if 1e-4 <= largest < 1e6 or largest == 0.0 else "e"
    for digits in range(17):
        texts = [f"{tick + 0.0:.{digits}{notation}}" for tick in ticks]
        if all(abs(float(text) - tick) <= 1e-3 * apart for text, tick in zip(texts, ticks, strict=True)):
            break
    return [signed(text) for text in texts]


def new_figure(height: float, width: float = WIDTH) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def grid(n: int, *, height: float) -> tuple[Figure, list[Axes]]:
    """A figure with `n` panels, in two columns if there are more than two."""
    columns = 1 if n <= 2 else 2
    rows = -(-n // columns)
    figure = new_figure(height * rows if n > 1 else 1.25 * height)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for extra in axes[n:]:
        extra.set_visible(False)
    return figure, list(axes[:n])
