"""How a page looks: its template, filled in and escaped, in the language of its reader."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, get_args

from starlette.responses import HTMLResponse

from estim.common import LANGUAGES, format_quantity, format_rounded, language, phrase
from estim.reading import Encoding
from estim.web.labels import LABELS, on_page
from estim.words import status_words

if TYPE_CHECKING:
    import jinja2
    from starlette.requests import Request

LANGUAGE = "estim-lang"
"""Name of the cookie of a language that was chosen."""


def language_of(request: Request) -> str:
    """The language that was chosen, else the first of the browser's that there is."""
    accepted = request.headers.get("accept-language", "").split(",")
    preferred = (request.cookies.get(LANGUAGE, ""), *(part.strip()[:2] for part in accepted))
    return next((name for name in preferred if name in LANGUAGES), "en")


def page(template: str, status: int = 200, **values: object) -> HTMLResponse:
    """A template of `templates/` as an answer.  Every value is escaped by the environment."""
    values |= {"lang": language(), "status": status}
    text = _environment().get_template(f"{template}.html.j2").render(values)
    return HTMLResponse(text, status)


def closed(status: int, message: str = "", *, ask: bool = False) -> HTMLResponse:
    """A sentence in place of a page: the one of the status, or the `message` of estim itself.

    ask : for the passphrase, where `message` is the one that was typed.
    """
    return page("closed", status, message=message, ask=ask)


@cache
def _environment() -> jinja2.Environment:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("estim.web"),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["when"] = lambda at: f"{at[:4]}-{at[4:6]}-{at[6:8]} {at[9:11]}:{at[11:13]}"
    environment.globals |= {
        "phrase": phrase,
        "languages": LANGUAGES,
        "quantity": format_quantity,
        "rounded": format_rounded,
        "labels": LABELS,
        "on_page": on_page,
        "encodings": [(name, name) for name in get_args(Encoding)],
        "status_words": status_words,
    }
    return environment
