"""What a person sees of a record that is a small table: by `print`, and in a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from estim.common.escaping import Markdown, markdown, one_line
from estim.common.labels import table

_MOST = 12  # rows


@dataclass(frozen=True)
class Shown:
    """A title, a table and sentences below it; a row that begins with `best` is marked."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()
    best: str = ""


class Tabled(ABC):
    """A record with a method `shown`, which returns what a person sees of it."""

    @abstractmethod
    def shown(self) -> Shown:
        """What a person sees."""

    def __str__(self) -> str:
        shown = self.shown()
        lines = [shown.head, *shown.rows[:_MOST]]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        rows = [
            f"{'*' if row[0] and row[0] == shown.best else ' '} "
            + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
            for row in lines
        ]
        rest = ["  ..."] * (len(shown.rows) > _MOST)
        return "\n".join(
            line.rstrip() for line in (*map(one_line, (shown.title, *rows)), *rest, *shown.notes)
        )

    def __repr__(self) -> str:
        return str(self)

    def _repr_markdown_(self) -> str:
        shown = self.shown()
        rows = [
            (Markdown(f"**{markdown(row[0])}**") if row[0] == shown.best else row[0], *row[1:])
            for row in shown.rows[:_MOST]
        ]
        notes = [markdown(f"{note[:1].upper()}{note[1:]}") for note in shown.notes]
        return "\n\n".join([markdown(shown.title), table(shown.head, rows), *notes])
