"""Where the uncertainty of a result comes from, as a reader sees it: records for `result.json`, and
the rows of a table of shares.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import Label, behind, format_rounded, number, phrase, signed, split_level
from estim.discrepancy import DEVIATION, FORCE, FRAMES, START
from estim.drawing import BLUE, INK, Figure, grid, name_ticks
from estim.pipeline import Analysis
from estim.reports.derived import derived_columns
from estim.reports.records import DRAWS, Labels, Record
from estim.studies.fit_uncertainty_budget import (
    PRIOR,
    READINGS,
    STATED,
    BudgetSource,
    FitBudget,
    uncertainty_budget,
)


class UncertaintySource(Record):
    # a parameter whose stated value or prior it is, or a part of the errors of the readings
    source: str
    # "stated", "prior" (not a measured value's), "common" (clock, scale: the default), "curve"
    # (what it lacks, its start), "readings"
    kind: str
    # standard uncertainty of the quantity, linear; of a stated value signed: how far the quantity
    # moves if it grows by one of its own
    u: float
    share: float  # of the variance, linear
    share_drawn: float | None  # the same from the draws; null where they do not tell


class UncertaintyBudget(Record):
    """Parts of the uncertainty of one parameter, or of what is derived; the squares of `u` and of
    `others` add up to that of `sd_linear`.
    """

    unit: str
    sd_linear: float
    sd_posterior: float
    # the largest first; those below a thousandth of the variance are `others`
    sources: list[UncertaintySource]
    others: float


@dataclass(frozen=True, eq=False)
class Shares:
    """What a table and a figure show.

    symbols : (n_quantity,).
    sources : (n_source,) in words.  shares : (n_source, n_quantity) of the variance, columns add up
        to 1.
    drawn : the same from draws, nan where they do not determine it.
    sums, posterior : (n_quantity,) standard deviations as text.
    n_left : how many quantities are not shown.
    bent : symbols of those whose sds differ by more than a fifth.
    """

    labels: tuple[Label, ...]
    sources: tuple[str, ...]
    shares: FloatArray
    drawn: FloatArray
    sums: tuple[str, ...]
    posterior: tuple[str, ...]
    n_left: int
    bent: tuple[str, ...]

    def cells(self) -> list[tuple[str, list[str]]]:
        """Rows of a table: a source, and its share of each quantity with that of the draws in
        brackets.
        """
        return [
            (source, [_cell(a, b) for a, b in zip(linear, drawn, strict=True)])
            for source, linear, drawn in zip(self.sources, self.shares, self.drawn, strict=True)
        ]


def budget_of(analysis: Analysis) -> FitBudget | None:
    """None where the status allows no standard deviation, or there is no covariance."""
    return (
        uncertainty_budget(analysis.fit, analysis.chain.thinned(DRAWS))
        if analysis.diagnosis.ok
        else None
    )


def budget_records(
    analysis: Analysis, budget: FitBudget | None
) -> dict[str, UncertaintyBudget] | None:
    """One for each quantity of the budget; None where there is none."""
    if budget is None:
        return None
    units = {
        quantity.name: quantity.unit for run in analysis.problem.runs for quantity in run.sought
    } | {p.name: p.unit for p in analysis.problem.parameters}
    return {
        name: _record(budget, k, units.get(name) or units[name.partition("[")[0]])
        for k, name in enumerate(budget.names)
    }


def _record(budget: FitBudget, k: int, unit: str) -> UncertaintyBudget:
    shares, drawn = budget.shares[:, k], budget.shares_drawn[:, k]
    # share of the variance below which a source goes with the others
    order = [int(i) for i in np.argsort(-shares, kind="stable") if shares[i] >= 1e-3]
    sources = [
        UncertaintySource(
            budget.sources[i].name,
            budget.sources[i].kind,
            float(budget.contributions[i, k]),
            float(shares[i]),
            number(float(drawn[i])),
        )
        for i in order
    ]
    rest = float(np.sum(np.delete(shares, order)))
    return UncertaintyBudget(
        unit,
        float(budget.sds[k]),
        float(budget.posterior[k]),
        sources,
        float(budget.sds[k]) * max(rest, 0.0) ** 0.5,
    )


def shares_of(analysis: Analysis, budget: FitBudget, labels: Labels) -> Shares:
    """The requested quantities first, then the parameters that runs share; sources of one kind (the
    tilts of many runs) together, small ones too.
    """
    between = {name for name in analysis.problem.names if split_level(name)[0].endswith("_shift")}
    derived = {name: label for name, (_, label) in derived_columns(analysis).items()}
    known = [  # how far single runs are from the mean of all is no result
        (budget.names.index(name), label)
        for name, label in (*derived.items(), *labels.parameters.items())
        if name in budget.names and name not in between
    ]
    chosen = known[:8]
    columns = [k for k, _ in chosen]
    shares, drawn = budget.shares[:, columns], budget.shares_drawn[:, columns]
    groups: dict[str, list[int]] = {}
    counts = Counter((source.kind, split_level(source.name)[0]) for source in budget.sources)
    for i, source in enumerate(budget.sources):
        groups.setdefault(_words(source, counts, labels), []).append(i)
    sizes = {words: np.max(np.sum(shares[members], axis=0)) for words, members in groups.items()}
    ordered = sorted(groups, key=lambda words: -float(sizes[words]))
    rows = {words: groups[words] for words in ordered[:10] if sizes[words] >= 0.005}
    rest = [i for words in ordered if words not in rows for i in groups[words]]
    if np.max(np.abs(np.sum(shares[rest], axis=0))) >= 5e-4:  # below, no reader would see a bar
        rows[phrase("all others")] = rest
    return Shares(
        tuple(label for _, label in chosen),
        tuple(rows),
        np.array([np.sum(shares[members], axis=0) for members in rows.values()]),
        np.array([np.sum(drawn[members], axis=0) for members in rows.values()]),
        tuple(_sd(budget.sds[k], label) for k, label in chosen),
        tuple(_sd(budget.posterior[k], label) for k, label in chosen),
        len(known) - len(chosen),
        tuple(
            label.symbol
            for k, label in chosen
            if not abs(budget.posterior[k] / budget.sds[k] - 1.0) <= 0.2
        ),
    )


def _words(source: BudgetSource, counts: Mapping[tuple[str, str], int], labels: Labels) -> str:
    """counts : how many sources there are of a kind and a base name."""
    if source.kind not in (STATED, PRIOR):
        return {
            READINGS: phrase("readings"),
            "scale_x": phrase("length scale (default)"),
            "scale_t": phrase("clock (default)"),
            FORCE: phrase("unmodelled force"),
            DEVIATION: phrase("the unmodelled deviation"),
            START: phrase("push at release"),
            FRAMES: phrase("bad frames"),
        }[source.name]
    base = split_level(source.name)[0]
    n = counts[source.kind, base]
    symbol = (
        phrase("{symbol} of {n} runs or bodies", symbol=labels.symbol(base), n=n)
        if n > 2
        else labels.symbol(source.name)
    )
    return phrase("{shown}, stated" if source.kind == STATED else "{shown}, prior", shown=symbol)


def _sd(value: float, label: Label) -> str:
    return format_rounded(value * label.factor, value * label.factor) + behind(label.unit)


def _cell(share: float, drawn: float) -> str:
    text = "< 1 %" if share < 0.005 else f"{100.0 * share:.0f} %"
    return text if np.isnan(drawn) or share < 0.005 else f"{text} ({100.0 * drawn:.0f})"


def budget_figure(quantities: Sequence[str], sources: Sequence[str], shares: FloatArray) -> Figure:
    """Shares (n_source, n_quantity) of each source in the variance of each quantity, in %; that of
    correlations may be negative.
    """
    figure, panels = grid(
        len(quantities), height=0.27 * max(len(sources), 2) + 0.7, columns=3, sharey=True
    )
    places = np.arange(len(sources))
    for ax, name, widths in zip(panels, quantities, shares.T, strict=True):
        bars = ax.barh(places, widths, color=BLUE, height=0.7)
        ax.bar_label(
            bars,
            # %, from which a share has its number beside it
            [signed(f"{width:.1f}") if abs(width) >= 0.5 else "" for width in widths],
            padding=3,
        )
        ax.axvline(0.0, color=INK)
        ax.margins(x=0.28 if np.all(widths >= 0.0) else 0.45)
        ax.set_title(f"u²({name})")
        ax.set_xlabel(phrase("contribution (%)"))
        ax.spines[["top", "right"]].set_visible(False)
    name_ticks(panels[0].yaxis, places, sources)
    panels[0].set_ylim(len(sources) - 0.4, -0.6)
    return figure
