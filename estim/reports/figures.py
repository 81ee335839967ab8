"""Figures of an analysis, by matplotlib's object interface (no pyplot state).

White background and dark ink: legible on a light and on a dark page.  Colours are those of Okabe and Ito, which readers
with any colour vision can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.checks import Goodness
from estim.common import mathtext, signed
from estim.problem import Observations

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
_MANY = 200  # points in one panel
_LINE = 0.01  # of the height of a curve: what a line hides


def png(draw: Callable[[], Figure]) -> bytes:
    """What `draw` draws, as PNG without a date in it: the same figure gives the same bytes, whatever a user's own style is.

    Every text is shown literally; what matplotlib would take for mathematics is that only where `estim.common.labels` made it so.
    The parts are placed here, once: left to it, `savefig` would draw the whole figure for that and then a second time.
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    with style.context("default"):
        figure = draw()
        for text in _texts(figure):
            text.set_text(mathtext(text.get_text()))
        figure.set_dpi(_DPI)
        canvas = FigureCanvasAgg(figure)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")
        canvas.print_png(buffer, metadata={"Software": None}, pil_kwargs={"compress_level": _COMPRESSION})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _texts(artist: Artist) -> Iterator[Text]:
    """The texts of a figure but for those of ticks, which are written anew whenever they are drawn (`name_ticks`)."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for part in artist.get_children():
        if isinstance(part, Text):
            yield part
        elif isinstance(part, Axis):
            yield part.label
        else:
            yield from _texts(part)


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


def residual_figure(runs: Sequence[Observations], goodness: Sequence[Goodness], *, synthetic: bool) -> Figure:
    """Whitened residuals along each run, and how they are distributed."""
    figure = new_figure(2.5 * len(runs))
    axes = figure.subplots(len(runs), 2, squeeze=False, width_ratios=(3, 1), sharey="row")
    for (left, right), run, good in zip(axes, runs, goodness, strict=True):
        for sigma, shade in ((1.0, 0.20), (2.0, 0.10)):
            left.axhspan(-sigma, sigma, color=GREY, alpha=shade, lw=0)
        left.axhline(0.0, color=GREY, lw=0.8)
        left.plot(run.x, good.whitened, "-", color=BLUE, lw=0.6, alpha=0.6)
        left.plot(run.x, good.whitened, "o", color=INK, ms=3)
        reach = max(3.3, 1.1 * float(np.max(np.abs(good.whitened))))
        edges = np.linspace(-reach, reach, 15)
        right.hist(good.whitened, bins=edges, orientation="horizontal", color=BLUE, alpha=0.55)
        z = np.linspace(-reach, reach, 200)
        right.plot(run.n_obs * (edges[1] - edges[0]) * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi), z, color=INK, lw=1)
        left.set_ylim(-reach, reach)
        left.set(xlabel=run.x_label, ylabel="whitened residual")
        left.set_title(run.name + (" (SYNTHETIC data)" if synthetic else ""), fontsize=10)
        right.set(xlabel=run.words.rows)
        right.set_title("line: expected", fontsize=8)
    return figure
