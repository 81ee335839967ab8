"""Templates of `templates/` filled in.

Every value that a template prints goes through `markdown`, which no template can forget: it is the environment's `finalize`.
What is `Markdown` already passes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from functools import cache
from typing import TYPE_CHECKING

from estim.checks import P_FLOOR
from estim.common import Markdown, code, destination, format_p, language, markdown, p_digits, percentage, phrase, signed, significant
from estim.reports.sentences import translated

if TYPE_CHECKING:
    import jinja2


def p_words(p: float) -> str:
    """A p-value for a table: '0.031', or '< 5e-5' where it is the least that simulation can tell."""
    return f"< {p_digits(P_FLOOR, 1)}" if p <= P_FLOOR else p_digits(p)


def cells(row: Iterable[object]) -> Markdown:
    """Neighbouring cells of a table, without the lines at both ends."""
    return Markdown(" | ".join(markdown(cell) for cell in row))


def sentence(words: str) -> str:
    """`words` with a capital at the beginning; the rest stays as it is."""
    return words[:1].upper() + words[1:]


def folded(title: str, body: str, *, opened: bool) -> Markdown:
    """A part of a report that a reader opens, or one that stands `opened`; nothing where it is empty.

    GitHub wants blank lines around Markdown inside; a program that knows no such tags shows everything.
    """
    inside = body.strip("\n")
    if not inside.strip():
        return Markdown("")
    return Markdown(inside if opened else f"<details>\n<summary><b>{markdown(title)}</b></summary>\n\n{inside}\n\n</details>")


def render(template: str, *, pictures: Collection[str] = (), opened: Collection[str] = (), **values: object) -> Markdown:
    """A template of `templates/` filled in.

    pictures : paths of the figures beside the report.  `{% call figure(alt, path) %} caption {% endcall %}` shows one of them, and nothing else.
    opened : keys of the parts that stand open.  `{% call fold(key, title) %} sections {% endcall %}` is folded unless its key is among them.
    """
    def figure(alt: str, path: str, caller: Callable[[], str] = str) -> Markdown:
        plain = alt.replace("[", "(").replace("]", ")")  # brackets inside those of an image are not for every program
        if path not in pictures:
            return Markdown("")
        return Markdown(f"![{markdown(plain)}]({destination(path)})" + (f"\n\n{caption}" if (caption := caller()) else ""))

    def fold(key: str, title: str, caller: Callable[[], str]) -> Markdown:
        body = folded(title, caller(), opened=key in opened)
        return Markdown(f"{body}\n") if body else body  # a template loses the end of the line of its tag, and HTML ends at a blank line

    return Markdown(_environment(language()).get_template(template).render(pictures=pictures, figure=figure, fold=fold, **values))


@cache
def _environment(_language: str) -> jinja2.Environment:
    """What compiles templates in a language, each of them once."""
    import jinja2

    class Translated(jinja2.PackageLoader):
        """Templates whose sentences are translated before they are compiled."""

        def get_source(self, environment: jinja2.Environment, template: str) -> tuple[str, str, Callable[[], bool] | None]:
            source, path, fresh = super().get_source(environment, template)
            return translated(source), path, fresh

    environment = jinja2.Environment(
        loader=Translated("estim.reports"), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False, finalize=markdown,
    )
    environment.filters["number"] = lambda v, digits=3: "n/a" if v is None else significant(v, digits)
    environment.filters |= {"signed": signed, "p": p_words, "p_is": format_p, "percent": percentage}
    environment.globals["phrase"] = phrase
    environment.filters |= {"cells": cells, "sentence": sentence, "code": code, "destination": destination}
    return environment
