"""How things are shown to a reader: symbol and unit of a quantity, the kind of data, a Markdown
table.

Whoever makes a quantity states its symbol (`Notation`); no name is listed here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from estim.common.escaping import LETTERS, Markdown, markdown
from estim.common.phrases import PhraseTable

KINDS = PhraseTable(
    {
        "synthetic": "**SYNTHETIC data**: made by a program, not measured.",
        "measured": "Measured data.",
        "published": "Data taken from a publication.",
    }
)
FigureChoice: TypeAlias = Literal["main", "all", "none"]
"""Which figures a report has."""
FIGURE_CHOICES: tuple[str, ...] = get_args(FigureChoice)
OF_BODY = "body "  # before the name of a body, where something that its runs share is named
_SUBSCRIPT = re.compile(rf"(?<=[^_])_((?:[{LETTERS}]+_)*[{LETTERS}]+)$")


@dataclass(frozen=True)
class Label:
    """symbol : with its level in brackets, for text.  tex : the same for a figure.  unit : shown;
    factor : shown units per SI unit.
    """

    symbol: str
    tex: str
    unit: str
    factor: float

    @property
    def axis(self) -> str:
        return self.tex + bracketed(self.unit)

    @property
    def head(self) -> str:
        """The head of a column."""
        return self.symbol + bracketed(self.unit)


@dataclass(frozen=True)
class Notation:
    """How a quantity is written, stated where it is made: a symbol and, where it is not shown in
    its own unit, another one.

    unit : shown in place of the quantity's own, None for that.  factor : shown units per own unit.
    """

    symbol: str
    unit: str | None = None
    factor: float = 1.0

    def label(self, unit: str, level: str = "") -> Label:
        """The label of a quantity in `unit`; `level` ("[heavy-04]") stands behind the symbol."""
        return Label(
            self.symbol + level,
            subscripted(self.symbol) + level,
            unit if self.unit is None else self.unit,
            self.factor,
        )


def bracketed(unit: str) -> str:
    """A unit as it stands behind a name."""
    return "" if unit == "1" else f" ({unit})"


def subscripted(symbol: str) -> str:
    """A symbol as a figure shows it: what follows an underscore is a subscript, where mathematics
    has the letters.
    """
    return _SUBSCRIPT.sub(
        lambda match: "$_{\\mathrm{" + match[1].replace("_", r"\_") + "}}$", symbol
    )


def kind_words(kind: str) -> Markdown:
    """What a report states of the kind of its data, one of `KINDS`."""
    return Markdown(KINDS[kind])


def split_level(name: str) -> tuple[str, str]:
    """'theta0[heavy-04]' as 'theta0' and '[heavy-04]'; without a level the second is ''."""
    base, bracket, level = name.partition("[")
    return base, bracket + level


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Markdown:
    """A Markdown table; cells that are not `Markdown` are shown literally."""
    lines = [head, [Markdown("---")] * len(head), *rows]
    return Markdown("\n".join(f"| {' | '.join(map(markdown, cells))} |" for cells in lines))
