"""How every figure is drawn: by matplotlib's object interface (no pyplot state), texts literally,
one set of colours.

White background and dark ink: legible on a light and on a dark page.  Colours are those of Okabe
and Ito, which readers with any colour vision can distinguish.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, max_abs
from estim.common import mathtext, phrase, signed

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure
    from matplotlib.artist import Artist
    from matplotlib.axis import Axis
    from matplotlib.text import Text

Axes: TypeAlias = "matplotlib.axes.Axes"
Figure: TypeAlias = "matplotlib.figure.Figure"
"""For annotations, without matplotlib loaded."""

BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
GREY = "#8A8A8A"
INK = "#222222"
PALE = "#AAD0E5"  # a third of the blue on white
VERMILION = "#D55E00"  # what is wrong; orange is what was stated before
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, INK, GREY)
RUN_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, VERMILION, "#56B4E9", "#8C6D31", "#6A3D9A")
MARKS = ("o", "s", "^", "D", "v", "P")
WIDTH = 7.2
MOST_BARS = 150  # points in one panel, beyond which bars hide the points
STYLE = {  # of what has no size of its own for a reason
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "figure.labelsize": 8,
    "figure.titlesize": 8,
    "font.size": 8,  # of legends, ticks and texts
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "lines.solid_capstyle": "butt",
    "patch.linewidth": 0,
}


def png(draw: Callable[[], Figure], finish: Callable[[Figure], object] | None = None) -> bytes:
    """What `draw` draws, as PNG without a date in it: the same figure gives the same bytes,
    whatever a user's own style is.  finish : changes it.

    Every text is shown literally; what matplotlib would take for mathematics is that only where
    `estim.common.labels` made it so.
    """
    from matplotlib import style

    with style.context(["default", STYLE]):
        figure = draw()
        if finish is not None:
            finish(figure)
        show_literally(figure)
        return as_png(figure)


def show_literally(figure: Artist) -> None:
    """Marks every text of a finished figure, or of one of its axes, as no mathematics but where
    `estim.common.labels` made it so.  To be done once.
    """
    for text in texts_of(figure):
        text.set_text(mathtext(text.get_text()))


def as_png(figure: Figure) -> bytes:
    """A figure as PNG."""
    buffer = io.BytesIO()
    # compressed to 4 of 9; more costs time and saves next to nothing
    options: dict[str, Any] = {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 4}}
    figure.savefig(buffer, format="png", dpi=150, **options)
    return buffer.getvalue()


def handed_out(
    figure: Figure | None, draw: Callable[[Figure], None], height: float, ax: Axes | None
) -> Figure:
    """What a user gets: `draw` on the user's own figure, or on its axes `ax`, in the user's style,
    or on a new one, which a notebook shows by itself.
    """
    from matplotlib import style

    if ax is not None:
        figure = cast("Figure", ax.get_figure())
        draw(figure)
        show_literally(ax)
        return figure
    if figure is None:
        with style.context("default"):
            figure = _notebook_figure()(
                figsize=(WIDTH, height), layout="constrained", facecolor="white"
            )
            draw(figure)
    else:
        draw(figure)
    show_literally(figure)
    return figure


@cache
def _notebook_figure() -> type[Figure]:
    from matplotlib import figure

    class NotebookFigure(figure.Figure):
        """A figure that a notebook shows, whatever its settings."""

        def _repr_png_(self) -> bytes:
            return as_png(self)

    return NotebookFigure


def logarithmic(ax: Axes, x: bool, y: FloatArray, sd: FloatArray) -> None:
    """Logarithmic axes: of `x` where it is requested, of y (n_obs,) where all readings are positive
    by more than two standard deviations sd (n_obs,) and cover three decades or more.
    """
    if x:
        ax.set_xscale("log")
    if np.all(y > 2.0 * sd) and 0.0 < 1e3 * np.min(y) <= np.max(y):
        ax.set_yscale("log")
        ax.set_ylim(0.5 * np.min(y - sd), 2.0 * np.max(y + sd))


def texts_of(artist: Artist) -> Iterator[Text]:
    """The texts of a figure but for those of ticks, which are written anew whenever they are drawn
    (`name_ticks`).
    """
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for part in artist.get_children():
        if isinstance(part, Text):
            yield part
        elif isinstance(part, Axis):
            yield part.label
        else:
            yield from texts_of(part)


def name_ticks(
    axis: Axis,
    places: ArrayLike,
    names: Sequence[str],
    *,
    fontsize: float = 8.0,
    rotation: float = 0.0,
) -> None:
    """Ticks at `places` with `names`, shown literally as `png` shows all other text.  fontsize :
    points.  rotation : degrees.
    """
    axis.set_ticks(places, [mathtext(name) for name in names], fontsize=fontsize, rotation=rotation)


def whole_ticks(axis: Axis) -> None:
    """Ticks at whole numbers, of what is counted."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator("auto", integer=True))


def tick_texts(ticks: FloatArray) -> list[str]:
    """Numbers (n_tick,), all with as many digits as distinguish them."""
    largest = float(np.max(np.abs(ticks), initial=0.0))
    spacing = float(np.min(np.diff(ticks))) if ticks.size > 1 else largest
    notation = "f" if 1e-4 <= largest < 1e6 or largest == 0.0 else "e"
    for digits in range(17):
        texts = [f"{tick + 0.0:.{digits}{notation}}" for tick in ticks]
        if all(
            abs(float(text) - tick) <= 1e-3 * spacing
            for text, tick in zip(texts, ticks, strict=True)
        ):
            break
    return [signed(text) for text in texts]


def new_figure(height: float) -> Figure:
    from matplotlib import figure

    return figure.Figure(figsize=(WIDTH, height), layout="constrained", facecolor="white")


def grid(
    n: int, *, height: float, columns: int | None = None, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with `n` panels, each `height` inches high.  columns : at most so many; None: two if
    there are more than two panels.
    """
    columns = min(columns or (1 if n <= 2 else 2), max(n, 1))
    rows = -(-max(n, 1) // columns)
    figure = new_figure(height * rows + 0.5)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey).ravel()
    for extra in axes[n:]:
        extra.set_visible(False)
    return figure, list(axes[:n])


def legend_below(figure: Figure | matplotlib.figure.SubFigure, *, ncols: int = 3) -> None:
    """What all panels of a figure show, each name once, below them."""
    named = {
        name: handle
        for ax in figure.axes
        for handle, name in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=ncols)


def draw_bands(
    ax: Axes,
    x: FloatArray,
    quantiles: FloatArray,
    colour: str = BLUE,
    *,
    median: str = "",
    label: str | None = "",
    zorder: float = 1.0,
) -> None:
    """The median, under the name `median`, with its 68 and 95 % bands.

    quantiles : (5, n_x) at `QUANTILES`, nan where nothing is known.
    label : what the bands are, with {p}; "": their per cent alone; None: no legend names them.
    """
    for low, high, p, alpha in ((0, 4, 95, 0.18), (1, 3, 68, 0.36)):
        fill(
            ax,
            x,
            quantiles[low],
            quantiles[high],
            colour,
            alpha,
            label=None if label is None else phrase(label, p=p) if label else f"{p} %",
            zorder=zorder,
        )
    ax.plot(x, quantiles[2], color=colour, label=median or None, zorder=zorder + 0.5)


def fill(
    ax: Axes,
    x: FloatArray,
    low: FloatArray,
    high: FloatArray,
    colour: str,
    alpha: float,
    **style: Any,
) -> None:
    """A band between two lines, without an edge."""
    ax.fill_between(x, low, high, color=colour, alpha=alpha, lw=0, **style)


def draw_pulls(ax: Axes, pulls: FloatArray) -> float:
    """What lies below pulls (n,), which have a standard deviation of 1: zero, one and two of them;
    the axis reaches as far as is returned.
    """
    for sigma, shade in ((2.0, 0.12), (1.0, 0.20)):
        ax.axhspan(-sigma, sigma, color=GREY, alpha=shade)
    ax.axhline(0.0, color=GREY)
    reach = max(3.3, 1.1 * max_abs(pulls))
    ax.set_ylim(-reach, reach)
    return reach
