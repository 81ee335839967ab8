"""Text that would forge a report, a terminal or a file's name, and an oracle that shares no code
with what shows it.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from markdown_it import MarkdownIt
from markdown_it.token import Token

LOOKS_LIKE_MARKDOWN = (
    "*bold* **bold** ***",
    "_under_ __under__ a_b _",
    "a | b || c",
    "<b>x</b> <script>alert(1)</script>",
    "<!-- x",
    "<?x?>",
    "</p>",
    "`x` ``",
    "```",
    "[x](y)",
    "![x](y.png)",
    "[x][y]",
    "[x]: /y",
    "[^1]",
    "x](y",
    "[ ] x",
    "[x] x",
    "<https://x.org>",
    "&lt;b&gt; &amp; &#60; &",
    "$x$ $$ \\(x\\)",
    "\\",
    "\\\\*",
    "a\\",
    "# x",
    "###### x #",
    "x ##",
    "#",
    "> x",
    ">",
    "- x",
    "-",
    "+ x",
    "* x",
    "---",
    "- - -",
    "***",
    "===",
    "1. x",
    "1)",
    "0) x",
    "~~x~~",
    "~~~",
    ":--",
    "    x",
    "\tx",
    "x  ",
    "C:\\new\\*.csv",
    "R&D",
    "%s {} {0} %",
    "{{ 7 * 7 }} {% raw %} {# x",
    "a[b](c)",
    "a[b]: c",
    "a[_b_]",
    "x<y>z",
    "5 < 6 > 4",
    "'\"",
    "$_{\\mathrm{x}}$",
    "$_{\\mathrm{𠀀}}$",
    "\\frac{1}{",
    "$\\frac{$",
)
MOVES = (
    "a\nb",
    "a\n\n# Forged",
    "a\r\nb",
    "a\rforged",
    "\n",
    "a\n|---|\n",
    "a\x0bb\x0cc",
    "a\x1c\x1d\x1e\x1fb",
    "a\x85b",
    "a\u2028b\u2029c",
    "a\x1b[2J\x1b[31mred",
    "a\x1b]0;title\x07",
    "a\x9b31m",
    "a\x00b",
    "a\x08\x08\x08b",
    "a\x7f",
    "a\u202eb\u202c",
    "a\u2066b\u2069",
    "a\u200fb\u200e",
    "a\u200bb\ufeff",
    "a\u00adb",
    "a\U000e0041b",
    "a\ufff9b",
    "a\ue000b",
    "a\u00a0b\u3000c",
)
STRINGS = LOOKS_LIKE_MARKDOWN + MOVES
_PARSER = MarkdownIt("commonmark").enable(["table", "strikethrough"])


def raw(text: str) -> set[str]:
    """The marks of `text` that a terminal or a reader must never meet: all that are no letters,
    signs, plain blanks or ends of lines.
    """
    return {
        mark
        for mark in text
        if unicodedata.category(mark) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp") and mark != "\n"
    }


def shown(text: str) -> str:
    """What a reader should see of `text`: white space as single blanks, other invisible marks as
    escapes.
    """
    marks = (
        " " if mark.isspace() else mark.encode("unicode_escape").decode() if raw(mark) else mark
        for mark in text
    )
    return re.sub(" +", " ", "".join(marks)).strip()


def outline(report: str) -> list[str]:
    """The structure of a Markdown text, without what its text says: a forged report has another
    one.
    """
    return [
        name
        for name in _names(_PARSER.parse(report))
        if name.split()[0] not in ("text", "code_inline", "softbreak")
    ]


def _names(tokens: Iterable[Token]) -> Iterable[str]:
    for token in tokens:
        yield f"{token.type} {token.tag}"
        yield from _names(token.children or ()) if token.type != "image" else ()


def seen(report: str) -> str:
    """The text that a reader of a Markdown text sees, one paragraph, heading or cell a line."""
    return "\n".join(
        _text(token.children or []) for token in _PARSER.parse(report) if token.type == "inline"
    )


def _text(children: Iterable[Token]) -> str:
    return re.sub(
        " +",
        " ",
        "".join(
            " "
            if t.type in ("softbreak", "hardbreak")
            else _text(t.children or [])
            if t.type == "image"
            else t.content
            for t in children
        ),
    ).strip()
