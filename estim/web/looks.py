"""How a page looks: its template, filled in and escaped, in the language of its reader."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse

from estim.common import LANGUAGES, language, phrase, spoken

if TYPE_CHECKING:
    import jinja2
    from starlette.datastructures import Headers

LANGUAGE = "estim-lang"
"""Name of the cookie of a language that was chosen."""


@contextmanager
def language_of(headers: Headers) -> Iterator[None]:
    """Speaks the language that was chosen, else the first of the browser's that there is."""
    asked = [cookie_parser(headers.get("cookie", "")).get(LANGUAGE, "")]
    asked += [part[:2].lower() for part in headers.get("accept-language", "").split(",")]
    with spoken(next((name for name in asked if name in LANGUAGES), "en")):
        yield


def page(template: str, status: int = 200, **values: object) -> HTMLResponse:
    """A template of `templates/` as an answer.  Every value is escaped by the environment."""
    text = _environment().get_template(f"{template}.html.j2").render(lang=language(), **values)
    return HTMLResponse(text, status)


def static(name: str) -> bytes | None:
    """A file of `static/`, None where there is none of that name."""
    kept = {file.name: file for file in files("estim.web").joinpath("static").iterdir()}
    return kept[name].read_bytes() if name in kept else None


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
    environment.globals |= {"phrase": phrase, "languages": LANGUAGES}
    return environment
