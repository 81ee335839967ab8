"""What the data can determine, as a reader sees it: the rows of its table and its sentences
(`templates/identifiability.md.j2`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.checks import CONFLICT, PRIOR_DOMINATED, THRESHOLD, Identifiability, Sensitivity
from estim.common import (
    QUANTILES,
    Label,
    Markdown,
    format_rounded,
    phrase,
    raised,
    signed,
    significant,
)
from estim.distributions import chi2_quantile
from estim.drawing import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    Axes,
    Figure,
    grid,
    legend_below,
    name_ticks,
    new_figure,
)
from estim.fitting import ProfileInterval
from estim.problem import Problem

_FLOOR = 1e-4  # of the axis of information: what is smaller is as good as nothing
_TOP_RISE = 5.0


def identify_section(
    problem: Problem,
    identifiability: Identifiability,
    intervals: Sequence[ProfileInterval],
    sensitivity: Sequence[Sensitivity],
    draws: FloatArray,
) -> dict[str, Any]:
    """What `identifiability.md.j2` shows under the name `identify`; every cell of its rows as text,
    whose `unit` applies to all but `ratio`.

    intervals : with probabilities 0.68 and 0.95, of some parameters.  sensitivity : of every one.
    draws : (n_draw, n_par).
    """
    profiles = {interval.name: interval for interval in intervals}
    posterior_sds = draws.std(axis=0, ddof=1)
    rows, doubts = [], []  # what went wrong with single intervals
    for i, (parameter, leaning) in enumerate(zip(problem.parameters, sensitivity, strict=True)):
        interval = profiles.get(parameter.name)
        label, prior_sd = parameter.label, parameter.prior.sd
        sd = float(posterior_sds[i])
        flat = not np.isfinite(prior_sd)
        rows.append(
            {
                "symbol": label.symbol,
                "unit": "" if label.unit == "1" else label.unit,
                "prior_sd": phrase("flat") if flat else significant(prior_sd * label.factor, 2),
                "posterior_sd": significant(sd * label.factor, 2),
                "ratio": "—" if flat else f"{sd / prior_sd:.2f}",
                "profile_68": _cell(interval, 0.68, sd, label),
                "profile_95": _cell(interval, 0.95, sd, label),
                "verdict": _verdict(problem, leaning, float(draws[:, i].mean())),
            }
        )
        if interval is not None and (interval.n_failed or interval.found_better or interval.pieces):
            doubts.append(interval.sentence)
    k_hat = max((s.k_hat for s in sensitivity), default=-np.inf)
    if k_hat >= 0.7:
        doubts.append(
            phrase(
                "the importance weights of the power-scaling are unreliable (Pareto k "
                "{k_hat:.2f}): the last column is "
                "not informative",
                k_hat=k_hat,
            )
        )
    return {
        "sentences": [*identifiability.sentences, *_hardly_better_known(problem, posterior_sds)],
        "rows": rows,
        "doubts": doubts,
        # the two limits that the words refer to
        "prior_dominated": PRIOR_DOMINATED,
        "threshold": THRESHOLD,
        # whether a prior has no width
        "flat": any(not np.isfinite(p.prior.sd) for p in problem.parameters),
    }


def _hardly_better_known(problem: Problem, posterior_sds: FloatArray) -> list[str]:
    """Which parameters the data leave nearly as uncertain as they were, by the ratios of the table:
    one sentence, or none.
    """
    of_draws = zip(problem.parameters, posterior_sds, strict=True)
    symbols = [
        p.label.symbol
        for p, sd in of_draws
        if np.isfinite(p.prior.sd) and sd > PRIOR_DOMINATED * p.prior.sd
    ]
    if not symbols:
        return []
    *others, last = symbols
    return [
        phrase(
            "{symbols} are hardly better known than before the data (posterior sd above "
            "{share} of the prior's)."
            if others
            else "{symbols} is hardly better known than before the data (posterior sd above "
            "{share} of the prior's).",
            symbols=phrase("{names} and {last}", names=", ".join(others), last=last)
            if others
            else last,
            share=PRIOR_DOMINATED,
        )
    ]


def _cell(interval: ProfileInterval | None, p: float, sd: float, shown: Label) -> str:
    """'[0.181, 0.199]', '< 0.0107' or '> 0.3' where one side is open, 'open' where both are; '—'
    where it was not computed.
    """
    if interval is None:
        return "—"
    low, high = (
        format_rounded(end * shown.factor, sd * shown.factor)
        for end in (interval.low[p], interval.high[p])
    )
    if interval.open_low[p] and interval.open_high[p]:
        return phrase("unbounded on both sides")
    if interval.open_low[p]:
        return phrase("< {high} (unbounded below)", high=high)
    return (
        Markdown(phrase("> {low} (unbounded above)", low=low))
        if interval.open_high[p]
        else f"[{low}, {high}]"
    )


def _verdict(problem: Problem, leaning: Sensitivity, mean: float) -> str:
    """The verdict, with the pull of the posterior `mean` where it is a conflict, and whose prior
    matters most where that is another parameter's.
    """
    words = phrase(leaning.verdict)
    if leaning.verdict == CONFLICT:
        prior = problem.parameters[problem.names.index(leaning.name)].prior
        words = phrase(
            "data and prior disagree (conflict): the posterior lies {pull} prior sd from "
            "the mean of the prior",
            pull=signed(f"{(mean - prior.expectation) / prior.sd:+.1f}"),
        )
    if leaning.strongest is None or leaning.strongest == leaning.name:
        return words
    strongest = problem.parameters[problem.names.index(leaning.strongest)]
    return phrase("{words}; mainly that of {symbol}", words=words, symbol=strongest.label.symbol)


def direction_figure(problem: Problem, identifiability: Identifiability) -> Figure:
    """Information of the data along each direction, in units of the prior's, and what each
    direction is made of.
    """
    n = len(identifiability.directions)
    single = len(problem.runs) == 1
    labels = [p.bare_label if single else p.label for p in problem.parameters]
    figure = new_figure(1.5 + 0.30 * n + (0.0 if single else 0.6))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25 if n < 8 else 1.7))
    information = np.array([d.information for d in identifiability.directions])
    places = np.arange(n)
    colours = [
        {"data": BLUE, "prior": ORANGE}.get(d.held_by, INK) for d in identifiability.directions
    ]
    top = 10.0 * max(10.0, float(information.max()))
    left.barh(
        places,
        np.maximum(information, 2.0 * _FLOOR) - _FLOOR,
        left=_FLOOR,
        color=colours,
        height=0.62,
    )
    left.axvline(1.0, color=INK)
    left.set(
        xscale="log",
        xlim=(_FLOOR, top),
        ylim=(n - 0.5, -0.5),
        xlabel=phrase("information of the data / of the prior"),
        ylabel=phrase("direction"),
    )
    first, last = math.ceil(math.log10(_FLOOR)), math.floor(math.log10(top))
    powers = range(
        first, last + 1, 1 if last - first < 9 and n < 8 else 2 * -(-(last - first) // 18)
    )
    left.xaxis.set_ticks([], minor=True)
    name_ticks(
        left.xaxis, [10.0**power for power in powers], ["10" + raised(power) for power in powers]
    )
    name_ticks(left.yaxis, places, [f"{k + 1}" for k in places])
    left.text(0.8, -0.6, phrase("only the prior"), color=ORANGE, ha="right", va="bottom")
    left.text(1.25, -0.6, phrase("the data"), color=BLUE, ha="left", va="bottom")
    for place, value in zip(places, information, strict=True):
        if value < _FLOOR:
            left.text(
                3.0 * _FLOOR, place, f"< {_FLOOR:.0e}".replace("e-0", "e-"), va="center", color=INK
            )
    _components(
        right,
        np.array([d.vector for d in identifiability.directions]),
        [label.tex for label in labels],
        upright=not single or max(len(label.symbol) for label in labels) > 8,
    )
    return figure


def _components(ax: Axes, vectors: FloatArray, symbols: list[str], *, upright: bool) -> None:
    """A heat map of unit directions (n, n), rows as in the bars beside it."""
    n = len(vectors)
    ax.imshow(vectors, cmap="PuOr_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for row, column in np.ndindex(n, n):
        if abs(vectors[row, column]) >= 0.15:
            # purple is darker than orange of the same size
            colour = INK if -0.57 < vectors[row, column] < 0.72 else "white"
            text = signed(f"{vectors[row, column]:+.1f}")
            ax.text(
                column,
                row,
                text,
                ha="center",
                va="center",
                fontsize=7 if n < 10 else 6,
                color=colour,
            )
    name_ticks(
        ax.xaxis, np.arange(n), symbols, fontsize=7 if upright else 9, rotation=90 if upright else 0
    )
    ax.set_yticks([])
    ax.tick_params(axis="x", length=0)
    ax.set_title(phrase("components, in prior standard deviations"))


def profile_figure(
    problem: Problem, intervals: Sequence[ProfileInterval], draws: FloatArray
) -> Figure:
    """How the objective rises with each parameter, all others re-optimised, with posterior
    quantiles below.

    draws : (n_draw, n_par) of the posterior.
    """
    figure, axes = grid(len(intervals), height=1.75, columns=3)
    for k, (ax, interval) in enumerate(zip(axes, intervals, strict=True)):
        index = problem.names.index(interval.name)
        parameter = problem.parameters[index]
        label = parameter.label if len(problem.runs) > 1 else parameter.bare_label
        _draw_profile(ax, interval, draws[:, index] * label.factor, label.factor)
        ax.set_xlabel(label.axis)
        if k % 3 == 0:
            ax.set_ylabel(phrase("increase of −2 ln p"))
    legend_below(figure)
    return figure


def _draw_profile(ax: Axes, interval: ProfileInterval, draws: FloatArray, factor: float) -> None:
    sides = ((interval.open_low, interval.low), (interval.open_high, interval.high))
    x, indices = np.unique(interval.x * factor, return_index=True)
    # the signed square root of a rise is nearly a straight line: smooth in between
    root = np.sqrt(np.maximum(interval.rise[indices], 0.0)) * np.where(
        x < interval.value * factor, -1.0, 1.0
    )
    fine = np.linspace(x[0], x[-1], 300)
    ax.plot(fine, np.interp(fine, x, root) ** 2, color=BLUE, label=phrase("profile"))
    levels = {p: float(chi2_quantile(p, 1)) for p in interval.low}
    ax.hlines(
        list(levels.values()),
        0.0,
        1.0,
        color=GREY,
        ls="--",
        zorder=1,
        transform=ax.get_yaxis_transform(),
        label=phrase("68 and 95 % levels"),
    )
    closed = [
        (ends[p] * factor, level)
        for p, level in levels.items()
        for opened, ends in sides
        if not opened[p]
    ]
    ax.vlines(
        [end for end, _ in closed], 0.0, [level for _, level in closed], color=BLUE, alpha=0.6
    )
    for (opened, ends), anchor in zip(sides, ("left", "right"), strict=True):
        for place in {ends[p] * factor for p in opened if opened[p]}:
            ax.axvline(place, color=ORANGE)
            ax.annotate(
                phrase("unbounded"),
                (place, 0.97),
                (3 if anchor == "left" else -3, 0),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                ha=anchor,
                va="top",
                color=ORANGE,
            )
    q025, q16, median, q84, q975 = np.quantile(draws, QUANTILES)
    ax.plot([q025, q975], [-0.55, -0.55], color=INK)
    ax.plot(
        [q16, q84], [-0.55, -0.55], color=INK, lw=3, label=phrase("posterior: median, 68 and 95 %")
    )
    ax.plot(median, -0.55, "|", color=INK, ms=7)
    extent = np.concatenate([x[np.square(root) <= _TOP_RISE], [q025, q975]])
    width = float(np.ptp(extent))
    margin = 0.06 * width if 0.0 < width < math.inf else 1.0
    ax.set(
        xlim=(extent.min() - margin, extent.max() + margin),
        ylim=(-1.1, _TOP_RISE),
        yticks=[0, 1, 2, 3, 4],
    )
    ax.locator_params(axis="x", nbins=4)
