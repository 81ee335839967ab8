"""A report as one HTML file that needs nothing else: figures are in it, folded parts open, tables
scroll, light or dark as the reader's system is.

It is made of `report.md` and its figures alone, by markdown-it (CommonMark, with GitHub's tables),
and has the same content.  No script, no outside address: the page forbids itself both
(Content-Security-Policy).  Of HTML in the Markdown only what `rendering.folded` makes passes; all
else is shown as text.
"""

from __future__ import annotations

import re
import struct
from base64 import b64encode
from collections.abc import Iterator
from html import escape, unescape
from importlib.resources import files as package_files
from itertools import count
from urllib.parse import unquote

from markdown_it import MarkdownIt

from estim.common import Files, language, phrase, unescaped
from estim.reports.rendering import FENCED

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
_MARK = re.compile(
    rf"{FENCED}|^<details>\n<summary><b>(?P<title>[^\n]*)</b></summary>$|^(?P<end></details>)$",
    re.DOTALL | re.MULTILINE,
)
"""Code, in which nothing is a mark; how a folded part begins, with its title, and ends: what
`rendering.folded` makes.
"""
_HEADING = re.compile(r"<h(\d)>(.*?)</h\1>\n")
_IMAGE = re.compile(r'<img src="([^"]*)" alt="([^"]*)" />')
_ALONE = re.compile(r"<p>(<img [^>]*>)</p>\n(?:<p><em>((?:(?!</?em>).)*)</em></p>\n)?", re.DOTALL)
_TABLE = re.compile(r"(?:<p><em>((?:(?!</?em>).)*)</em></p>\n)?<table>(.*?)</table>", re.DOTALL)


def html_page(files: Files, *, paper: bool = False) -> bytes:
    """`report.html` of the files of a report (path -> bytes; `report.md` and the figures that it
    shows), in the current language.

    paper : for a printer: nothing to open or to click, and what is folded stands open in an
        appendix that begins a page.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    standing, folded, titles = "", "", list[str]()
    for title, text in _parts(files["report.md"].decode()):
        html = parser.render(text)
        if not title:
            standing += _with_places(html, titles)
        elif paper:
            folded += f"<section>\n<h2>{escape(title)}</h2>\n{_below(html, title)}</section>\n"
        else:
            titles.append(title)
            standing += (
                f'<details id="part-{len(titles)}">\n<summary><h2>{escape(title)}</h2></summary>\n'
                f'<div class="part">\n{_below(html, title)}</div>\n</details>\n'
            )
    if folded:
        words = phrase("Appendix: sections that are collapsed on the page")
        folded = f'<h2 class="appendix">{escape(words)}</h2>\n{folded}'
    folds = "<details id=" in standing
    entries = "".join(
        f'<li><a href="#part-{i}">{escape(words)}</a></li>\n' for i, words in enumerate(titles, 1)
    )
    contents = _CONTENTS.format(
        title=escape(phrase("Contents")),
        entries=entries,
        switch=_SWITCH.format(words=escape(phrase("open all sections, also for printing")))
        if folds
        else "",
    )
    main = re.search(r"<h1>(.*?)</h1>", standing)
    words = escape(phrase("Sections that are collapsed on the page are not printed."))
    templates = package_files("estim.reports").joinpath("templates")
    return _PAGE.format(
        lang=language(),
        policy=_POLICY,
        title=escape(_text(main[1])) if main else "",
        style=templates.joinpath("page.css").read_text(encoding="utf-8"),
        contents=contents if entries and not paper else "",
        body=_dressed(standing + folded, files),
        left_out=_LEFT_OUT.format(words=words) if folds else "",
    ).encode()


def _parts(text: str) -> Iterator[tuple[str, str]]:
    """Title and Markdown of each part of a report, in order; "" of what is not folded."""
    title, begin = "", 0
    for mark in _MARK.finditer(text):
        if bool(mark["end"]) == bool(title) and not mark["fence"]:
            yield title, text[begin : mark.start()]
            title, begin = "" if title else unescaped(mark["title"]), mark.end()
    yield title, text[begin:]


def _with_places(html: str, titles: list[str]) -> str:
    """Each heading of level 2 with a place, its text put to the `titles` of the contents."""

    def placed(match: re.Match[str]) -> str:
        if match[1] != "2":
            return match[0]
        titles.append(_text(match[2]))
        return f'<h2 id="part-{len(titles)}">{match[2]}</h2>\n'

    return _HEADING.sub(placed, html)


def _below(html: str, title: str) -> str:
    """A folded part with its headings below its title, which is of level 2 and stands once."""
    first = _HEADING.search(html)
    if first and _text(first[2]) == title:
        html = html.replace(first[0], "", 1)
    least = min((int(heading[1]) for heading in _HEADING.finditer(html)), default=0)

    def lower(match: re.Match[str]) -> str:
        level = int(match[1]) - least + 3
        return f"<h{level}>{match[2]}</h{level}>\n"

    return _HEADING.sub(lower, html)


def _text(html: str) -> str:
    return unescape(re.sub(r"<[^>]*>", "", html))


def _dressed(html: str, pictures: Files) -> str:
    """HTML of markdown-it with images in it (an image alone is a figure, the italics below it its
    caption; so are those above a table), tables that scroll, and links to other reports that lead
    to their pages.
    """
    numbers = count(1)

    def image(match: re.Match[str]) -> str:
        png = pictures.get(unquote(unescape(match[1])), b"")
        if not png.startswith(b"\x89PNG"):
            return f"[{match[2]}]"
        width, height = struct.unpack(">II", png[16:24])  # PNG specification, 11.2.2
        return (
            f'<img src="data:image/png;base64,{b64encode(png).decode()}" alt="{match[2]}" '
            f'width="{width}" height="{height}">'
        )

    def figure(match: re.Match[str]) -> str:
        caption = f"\n<figcaption>{match[2]}</figcaption>" if match[2] else ""
        return f"<figure>{match[1]}{caption}</figure>\n"

    def table(match: re.Match[str]) -> str:
        wide = ' class="wide"' if match[2].count("<th>") >= 7 else ""  # smaller on paper
        cells = re.sub(r"<th></th>", "<td></td>", match[2]).replace("<th>", '<th scope="col">')
        name = match[1] and _text(match[1]).partition(".")[0]
        name = escape(name or phrase("List {n}", n=next(numbers)))
        caption = f"<caption>{match[1]}</caption>" if match[1] else ""
        return (
            f'<div class="table" role="region" aria-label="{name}" tabindex="0">'
            f"<table{wide}>{caption}{re.sub('<td>(.*?)</td>', cell, cells)}</table></div>"
        )

    def cell(match: re.Match[str]) -> str:
        """One that is a number with its uncertainty and unit stays on one line."""
        words = _text(match[1])
        number = len(words) <= 24 and any(mark.isdigit() for mark in words)
        return f'<td class="number">{match[1]}</td>' if number else match[0]

    for pattern, dressed in (
        (_ALONE, figure),
        (_IMAGE, image),
        (_TABLE, table),
        (r'(?<=<a href=")([^"]*/)?report\.md(?=")', r"\g<1>report.html"),
        (r"<pre><code[^>]*>", '<pre tabindex="0"><code>'),
    ):
        html = re.sub(pattern, dressed, html)
    return html


def pdf_page(files: Files) -> bytes:
    """`report.pdf` of the files of a report (path -> bytes).  ImportError without the extra
    `pdf`.
    """
    from weasyprint import HTML, URLFetcher

    page = html_page(files, paper=True).decode()
    nothing_from_elsewhere = URLFetcher(allowed_protocols={"data"})
    return bytes(
        HTML(string=page, url_fetcher=nothing_from_elsewhere).write_pdf(pdf_variant="pdf/ua-1")
    )
