"""Templates of `templates/` filled in, their sentences translated before they are compiled; numbers
of a table that belong together.

Every value that a template prints goes through `markdown`, which no template can forget: it is the
environment's `finalize`.  What is `Markdown` already passes.  A sentence is a row of a table, an
item of a list, a heading, or the lines of a paragraph up to a blank line or a line of tags alone;
white space in it counts as a blank.  Tags inside it belong to it: a translation keeps them and puts
them where its grammar wants them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable
from functools import cache
from typing import TYPE_CHECKING

from estim.checks import P_FLOOR
from estim.common import (
    Markdown,
    Quantity,
    Status,
    code,
    destination,
    format_p,
    format_quantity,
    format_rounded,
    interval,
    kind_words,
    language,
    markdown,
    p_digits,
    percentage,
    phrase,
    signed,
    significant,
)
from estim.sampling import interval_cell, parameter_cells, value_cell
from estim.words import status_words

if TYPE_CHECKING:
    import jinja2

_TAG = re.compile(r"\{%.*?%\}|\{#.*?#\}", re.DOTALL)
_MARKED = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}|`[^`]*`|</?\w[^>]*>", re.DOTALL)
_QUOTED = re.compile(
    r"\{[{%][^}]*?(?:\bif\b|\belse\b|~)[^}]*?[\"'][^\"']*[A-Za-z]{2}[^\"']*[\"'][^}]*?[%}]\}"
)
_WORD = re.compile(r"[^\W\d_]{2}")
CITED = re.compile("\ue000(?P<cited>[^\ue000]*)\ue000")
"""What stands for the number of a figure or a table until all have theirs; no text of others has
such a mark, since it does not print.
"""
FENCED = r"^(?P<fence>`{3,})[^`\n]*\n.*?^(?P=fence)`*$"
"""A block of code, of lines and with DOTALL; one with a longer fence may hold another."""
_OWN_LINE = ("|", "#", "-", "*", ">", "<")  # begins a sentence of its own


def p_words(p: float) -> str:
    """A p-value for a table: '0.031', or '< 5e-5' where it is the least that simulation can
    resolve.
    """
    return f"< {p_digits(P_FLOOR, 1)}" if p <= P_FLOOR else p_digits(p)


def shown(quantity: Quantity | None, factor: float = 1.0) -> str:
    """A quantity as text, in units of which one of its own has `factor`."""
    return (
        "n/a" if quantity is None else format_quantity(quantity.value * factor, quantity.u * factor)
    )


def cells(row: Iterable[object]) -> Markdown:
    """Neighbouring cells of a table, without the lines at both ends."""
    return Markdown(" | ".join(markdown(cell) for cell in row))


def sentence(words: str) -> str:
    """`words` with a capital at the beginning; the rest stays as it is."""
    return words[:1].upper() + words[1:]


def folded(title: str, body: str, *, opened: bool) -> Markdown:
    """A part of a report that a reader opens, or one that stands `opened`; nothing where it is
    empty.

    GitHub needs blank lines around Markdown inside; a program without such tags shows everything.
    """
    inside = body.strip("\n")
    if not inside.strip():
        return Markdown("")
    return Markdown(
        inside
        if opened
        else f"<details>\n<summary><b>{markdown(title)}</b></summary>\n\n{inside}\n\n</details>"
    )


def cited(key: str) -> Markdown:
    """The number of the figure at the path `key`, or of the table whose caption begins with it:
    "Figure 2".
    """
    return Markdown(f"\ue000{key}\ue000")


def render(
    template: str, *, pictures: Collection[str] = (), opened: Collection[str] = (), **values: object
) -> Markdown:
    """A template of `templates/` filled in.

    pictures : paths of the figures beside the report.  `{% call figure(alt, path) %} caption {%
        endcall %}` shows one of them, and nothing else.
    opened : keys of the parts that stand open.  `{% call fold(key, title) %} sections {% endcall
        %}` is folded unless its key is among them.
    """

    def figure(alt: str, path: str, caller: Callable[[], str] = str) -> Markdown:
        # brackets inside those of an image are not for every program
        plain = alt.replace("[", "(").replace("]", ")")
        if path not in pictures:
            return Markdown("")
        return Markdown(
            f"![{markdown(plain)}]({destination(path)})"
            + (f"\n\n{caption}" if (caption := caller()) else "")
        )

    def fold(key: str, title: str, caller: Callable[[], str]) -> Markdown:
        body = folded(title, caller(), opened=key in opened)
        # a template loses the end of the line of its tag, and HTML ends at a blank line
        return Markdown(f"{body}\n") if body else body

    return Markdown(
        _environment(language())
        .get_template(template)
        .render(pictures=pictures, figure=figure, fold=fold, **values)
    )


@cache
def _environment(_language: str) -> jinja2.Environment:
    """What compiles templates in a language, each of them once."""
    import jinja2

    class Translated(jinja2.PackageLoader):
        """Templates whose sentences are translated before they are compiled."""

        def get_source(
            self, environment: jinja2.Environment, template: str
        ) -> tuple[str, str, Callable[[], bool] | None]:
            source, path, fresh = super().get_source(environment, template)
            return translated(source), path, fresh

    environment = jinja2.Environment(
        loader=Translated("estim.reports"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
        finalize=markdown,
    )
    environment.filters |= {
        "number": lambda v, digits=3: "n/a" if v is None else significant(v, digits),
        "fixed": lambda v, form, missing="n/a": (
            missing if v is None or not math.isfinite(v) else form % v
        ),
        "unit": lambda unit: "" if unit == "1" else unit,
        "beside": lambda text, unit: text if unit == "1" else f"{text} {unit}",
        "draws_count": lambda status: Status(status).draws_count,
        "limits_count": lambda status: Status(status).limits_count,
        "quantity": format_quantity,
        "shown": shown,
        "rounded_by": format_rounded,
        "degrees": math.degrees,
        "digits": p_digits,
        "signed": signed,
        "p": p_words,
        "p_is": format_p,
        "percent": percentage,
        "kind_words": kind_words,
        "status_words": status_words,
        "cells": cells,
        "sentence": sentence,
        "cited": cited,
        "code": code,
        "destination": destination,
    }
    environment.globals |= {
        "phrase": phrase,
        "interval": interval,
        "value_cell": value_cell,
        "interval_cell": interval_cell,
        "parameter_cells": parameter_cells,
    }
    return environment


def translated(source: str, of: Callable[[str], str] = phrase) -> str:
    """A template's source with each sentence that has words replaced by `of` it, its translation
    into the current language; where that is the same, the lines stay as they are.
    """
    out: list[str] = []
    block: list[str] = []

    def close() -> None:
        if block:
            before = " ".join(line.strip() for line in block)
            after = of(before) if _has_words(before) else before
            indent = block[0][: len(block[0]) - len(block[0].lstrip())]  # of an item below another
            out.extend(block if after == before else [indent + after])
            block.clear()

    for line in source.split("\n"):
        stripped = line.strip()
        if not stripped or not _TAG.sub("", stripped).strip():
            close()
            out.append(line)
            continue
        if stripped.startswith(_OWN_LINE) or (block and block[-1].strip().startswith(("|", "#"))):
            close()
        block.append(line)
    close()
    return "\n".join(out)


def _has_words(text: str) -> bool:
    return bool(_WORD.search(_MARKED.sub("", text)) or _QUOTED.search(text))
