"""Templates of `templates/` filled in.

Every value that a template prints goes through `markdown`, which no template can forget: it is the environment's `finalize`.
What is `Markdown` already passes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from estim.checks import P_FLOOR
from estim.common import Markdown, code, destination, markdown, signed


def p_words(p: float) -> str:
    """A p-value for a table: '0.031', or '< 5e-05' where it is the least that simulation can tell."""
    return f"< {P_FLOOR:.1g}" if p <= P_FLOOR else f"{p:.2g}"


def cells(row: Iterable[object]) -> Markdown:
    """Neighbouring cells of a table, without the lines at both ends."""
    return Markdown(" | ".join(markdown(cell) for cell in row))


def sentence(words: str) -> str:
    """`words` with a capital at the beginning; the rest stays as it is."""
    return words[:1].upper() + words[1:]


def render(template: str, *, pictures: Collection[str] = (), **values: object) -> Markdown:
    """A template of `templates/` filled in.

    pictures : paths of the figures beside the report.  `{% call figure(alt, path) %} caption {% endcall %}` shows one of them, and nothing else.
    """
    import jinja2

    def figure(alt: str, path: str, caller: Callable[[], str] = str) -> Markdown:
        return Markdown(f"![{markdown(alt)}]({destination(path)})" + (f"\n\n{caption}" if (caption := caller()) else "") if path in pictures else "")

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("estim.reports"), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False, finalize=markdown,
    )
    environment.filters["number"] = lambda v, digits=3: "n/a" if v is None else signed(f"{v:.{digits}g}")
    environment.filters |= {"signed": signed, "p": p_words, "cells": cells, "sentence": sentence, "code": code, "destination": destination}
    return Markdown(environment.get_template(template).render(pictures=pictures, figure=figure, **values))
