"""A report as one HTML file that needs nothing else: figures are in it, folded parts open, tables
scroll, light or dark as the reader's system is.

It is made of `report.md` and its figures alone, by markdown-it (CommonMark, with GitHub's tables),
and says the same.  No script, no outside address: the page forbids itself both
(Content-Security-Policy).  Of HTML in the Markdown only what `rendering.folded` makes passes; all
else is shown as text.
"""

from __future__ import annotations

import re
import struct
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files as package_files
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML

from estim.common import language, phrase, unescaped

if TYPE_CHECKING:
    from markdown_it.token import Token

_NUMBER, _WIDE = 24, 7  # marks of a number on one line; columns of a table that is smaller on paper

_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'"
)
_PAGE = """<!DOCTYPE html>
<html lang="{lang}">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
{contents}<main>
{body}{left_out}</main>
</body>
</html>
"""
_CONTENTS = """<nav aria-label="{title}">
<details class="contents">
<summary>{title}</summary>
<ol>
{entries}</ol>
{switch}</details>
</nav>
"""
_SWITCH = '<p class="all"><label><input type="checkbox" id="all"> {words}</label></p>\n'
_LEFT_OUT = '<p class="left-out">{words}</p>\n'
FOLD = re.compile(r"<details>\n<summary><b>([^\n]*)</b></summary>\s*")
END = re.compile(r"</details>\s*")
"""How a folded part begins, with its title, and ends: what `rendering.folded` makes."""


@dataclass(frozen=True)
class _Entry:
    """A line of the contents."""

    place: str
    words: str
    folded: bool


@dataclass
class _State:
    """What the renderer has met so far.  summary : of the folded part that it is in."""

    pictures: Mapping[str, bytes]
    entries: list[_Entry] = field(default_factory=list)
    title: str = ""
    summary: str = ""
    n_table: int = 0
    paper: bool = False


def html_page(files: Mapping[str, bytes], *, paper: bool = False) -> bytes:
    """`report.html` of the files of a report (path -> bytes; `report.md` and the figures that it
    shows), in the language that is spoken.

    paper : for a printer: nothing to open or to click, and what is folded stands open in an
        appendix that begins a page.
    """
    state = _State(files, paper=paper)
    body = _rendered(files["report.md"].decode(), state)
    style = (
        package_files("estim.reports").joinpath("templates", "page.css").read_text(encoding="utf-8")
    )
    folds = not paper and any(entry.folded for entry in state.entries)
    entries = "".join(
        f'<li><a href="#{entry.place}">{escape(entry.words)}</a></li>\n' for entry in state.entries
    )
    switch = (
        _SWITCH.format(words=escape(phrase("open all sections, also for printing")))
        if folds
        else ""
    )
    contents = (
        _CONTENTS.format(title=escape(phrase("Contents")), entries=entries, switch=switch)
        if entries and not paper
        else ""
    )
    page = _PAGE.format(
        lang=language(),
        policy=_POLICY,
        title=escape(state.title),
        style=style,
        contents=contents,
        body=body,
        left_out=_LEFT_OUT.format(
            words=escape(phrase("Sections that are collapsed on the page are not printed."))
        )
        if folds
        else "",
    )
    return page.encode()


def _rendered(text: str, state: _State) -> str:
    parser = MarkdownIt("commonmark", {"html": True}, renderer_cls=_Renderer).enable("table")
    tokens, env = arranged(parser.parse(text)), {"state": state}
    if not state.paper:
        return str(parser.renderer.render(tokens, parser.options, env))
    standing, folded = apart(tokens)
    appendix = str(parser.renderer.render(folded, parser.options, env))
    words = phrase("Appendix: sections that are collapsed on the page")
    heading = f'<h2 class="appendix">{escape(words)}</h2>\n' if folded else ""
    return str(parser.renderer.render(standing, parser.options, env)) + heading + appendix


def _size(png: bytes) -> tuple[int, int]:
    """Width and height, points (PNG specification, 11.2.2)."""
    width, height = struct.unpack(">II", png[16:24])
    return width, height


class _Renderer(RendererHTML):
    """Rules by the kind of token; those of other kinds are markdown-it's own."""

    def html_block(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        state: _State = env["state"]
        content = tokens[i].content
        if match := FOLD.fullmatch(content):
            state.summary = unescaped(match[1])
            if state.paper:
                return f"<section>\n<h2>{escape(state.summary)}</h2>\n"
            place = self._entry(state, state.summary, folded=True)
            return (
                "<details "
                f'id="{place}">\n<summary><h2>{escape(state.summary)}</h2></summary>\n<div '
                'class="part">\n'
            )
        if END.fullmatch(content) and state.summary:
            state.summary = ""
            return "</section>\n" if state.paper else "</div>\n</details>\n"
        return f"<p>{escape(content)}</p>\n"

    def html_inline(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return escape(tokens[i].content)

    def heading_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        state: _State = env["state"]
        level, words = int(tokens[i].tag[1]), _plain(tokens[i + 1])
        if level == 1:
            state.title = state.title or words
            return "<h1>"
        place = self._entry(state, words, folded=False) if level == 2 and not state.summary else ""
        mark = f' id="{place}"' if place else ""
        return f"<h{_level(tokens[i])}{mark}>"

    def heading_close(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return f"</h{_level(tokens[i])}>\n"

    def _entry(self, state: _State, words: str, *, folded: bool) -> str:
        place = f"part-{len(state.entries) + 1}"
        state.entries.append(_Entry(place, words, folded))
        return place

    def figure_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return "<figure>"

    def figure_image_close(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return "\n"

    def caption_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return "<figcaption>"

    def figure_close(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return "</figcaption></figure>\n" if tokens[i].meta.get("captioned") else "</figure>\n"

    def image(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        alt = escape(_plain(tokens[i]))
        png = env["state"].pictures.get(unquote(str(tokens[i].attrs.get("src", ""))), b"")
        if not png.startswith(b"\x89PNG"):
            return f"[{alt}]"
        width, height = _size(png)
        return (
            f'<img src="data:image/png;base64,{b64encode(png).decode()}" alt="{alt}" '
            f'width="{width}" height="{height}">'
        )

    def link_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        """A link to another report leads to its page."""
        where = re.sub(
            r"(?:^|(?<=/))report\.md$", "report.html", str(tokens[i].attrs.get("href", ""))
        )
        return f'<a href="{escape(where)}">'

    def table_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        state: _State = env["state"]
        state.n_table += 1
        row = next(k for k in range(i, len(tokens)) if tokens[k].type == "tr_close")
        kind = (
            ' class="wide"'
            if sum(token.type == "th_open" for token in tokens[i:row]) >= _WIDE
            else ""
        )
        name = escape(phrase("Table {n}", n=state.n_table))
        return f'<div class="table" role="region" aria-label="{name}" tabindex="0"><table{kind}>\n'

    def table_close(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return "</table></div>\n"

    def th_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return '<th scope="col">' if tokens[i + 1].content else "<td>"

    def th_close(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return "</th>\n" if tokens[i - 1].content else "</td>\n"

    def td_open(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        """A cell that is a number with its uncertainty and unit stays on one line."""
        words = tokens[i + 1].content
        return (
            '<td class="number">'
            if len(words) <= _NUMBER and any(mark.isdigit() for mark in words)
            else "<td>"
        )

    def fence(self, tokens: Sequence[Token], i: int, options: Any, env: Any) -> str:
        return f'<pre tabindex="0"><code>{escape(tokens[i].content)}</code></pre>\n'


def _level(heading: Token) -> int:
    return int(heading.meta.get("level", heading.tag[1]))


def _plain(token: Token) -> str:
    """The text of a heading or an image, without its marks."""
    return "".join(
        child.content
        if child.type in ("text", "text_special", "code_inline")
        else " "
        if child.type in ("softbreak", "hardbreak")
        else ""
        for child in token.children or []
    )


def arranged(tokens: Sequence[Token]) -> list[Token]:
    """The tokens with an image that stands alone as a figure, the italics below it as its caption,
    no part's title twice.
    """
    result: list[Token] = []
    i, summary = 0, ""
    while i < len(tokens):
        token = tokens[i]
        if token.type == "html_block":
            match = FOLD.fullmatch(token.content)
            summary = unescaped(match[1]) if match else ""
        elif token.type == "heading_open":
            if summary and tokens[i + 1].content == summary:
                i, summary = i + 3, ""
                continue
            summary = ""
        elif _alone(tokens, i, "image"):
            captioned = _alone(tokens, i + 3, "em")
            token.type, token.meta = "figure_open", {"captioned": captioned}
            tokens[i + 2].type = "figure_image_close" if captioned else "figure_close"
            if captioned:
                tokens[i + 3].type, tokens[i + 5].type = "caption_open", "figure_close"
                tokens[i + 5].meta = {"captioned": True}
                inline = tokens[i + 4]
                inline.children = (inline.children or [])[1:-1]
                result += tokens[i : i + 6]
                i += 6
                continue
        result.append(token)
        i += 1
    _levelled(result)
    return result


def _levelled(tokens: Sequence[Token]) -> None:
    """Notes with each heading of a folded part its level below the title of the part, which is of
    level 2.
    """
    inside: list[Token] | None = None
    for token in tokens:
        if token.type == "html_block" and FOLD.fullmatch(token.content):
            inside = []
        elif token.type == "html_block" and inside is not None:
            least = min((int(heading.tag[1]) for heading in inside), default=0)
            for heading in inside:
                heading.meta = {"level": int(heading.tag[1]) - least + 3}
            inside = None
        elif token.type in ("heading_open", "heading_close") and inside is not None:
            inside.append(token)


def apart(tokens: Sequence[Token]) -> tuple[list[Token], list[Token]]:
    """What stands, and what is folded."""
    standing: list[Token] = []
    folded: list[Token] = []
    inside = False
    for token in tokens:
        begins, ends = (
            token.type == "html_block" and mark.fullmatch(token.content) is not None
            for mark in (FOLD, END)
        )
        inside = inside or begins
        (folded if inside else standing).append(token)
        inside = inside and not ends
    return standing, folded


def _alone(tokens: Sequence[Token], i: int, kind: str) -> bool:
    """Whether a paragraph begins at `i` that is one image, or all in italics."""
    if i + 2 >= len(tokens) or tokens[i].type != "paragraph_open":
        return False
    inside = tokens[i + 1].children or []
    if kind == "image":
        return [child.type for child in inside] == ["image"]
    ends = [k for k, child in enumerate(inside) if child.type == "em_close" and child.level == 0]
    return bool(inside) and inside[0].type == "em_open" and ends == [len(inside) - 1]


def pdf_page(files: Mapping[str, bytes]) -> bytes:
    """`report.pdf` of the files of a report (path -> bytes).  ImportError without the extra
    `pdf`.
    """
    from weasyprint import HTML, URLFetcher

    page = html_page(files, paper=True).decode()
    nothing_from_elsewhere = URLFetcher(allowed_protocols={"data"})
    return bytes(
        HTML(string=page, url_fetcher=nothing_from_elsewhere).write_pdf(pdf_variant="pdf/ua-1")
    )
