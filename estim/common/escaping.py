"""Text that others wrote, on its way to a reader: it is shown literally, and a renderer or a
terminal takes no part of it for a command.

Which to use: `one_line` for a terminal and for messages; `markdown` for a report, whatever stands
around the text (prose, a heading, a cell of a table, the text of a link); `code` where it should
look like code; `destination` for where a link leads; `mathtext` for a figure; `as_json` for a
record.  Templates need none of them: `estim.reports.rendering` puts every value through `markdown`,
and `estim.drawing.png` every text through `mathtext`.
"""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
from collections.abc import Iterable
from typing import Any, TypeAlias
from urllib.parse import quote

_SPECIAL = re.compile(
    r"""
    # an index, as in gamma[heavy]: no link without "(", "[" or ":" behind it
    (?<=\w)\[(?P<index>[\w .+-]+)\](?![(\[:])
    | \[(?P<interval>[-−+\d.e∞×⁰¹²³⁴-⁹⁻]+,\ [-−+\d.e∞×⁰¹²³⁴-⁹⁻]+)\](?![(\[:])
    | [\\`*\[\]|$~]
    | <(?=[A-Za-z/!?]|$)                        # "< 3" is no tag
    | &(?=\#?\w+;|\#?\w*$)
    # inside a word it emphasises nothing (CommonMark 0.31, section 6.2)
    | (?<![^\W_])_++ | _++(?![^\W_])
    """,
    re.VERBOSE,
)
# up to where a backslash is needed: at the beginning of a block, or the end of a heading
_BLOCK = re.compile(
    r"^(?:\d{1,9}(?=[.)](?: |$))|(?=\#{1,6}(?: |$)|[>=]|[-+](?:[- ]|$)))|(?:(?<= )|^)(?=\#+$)"
)
# of a subscript in a figure; not every letter is in matplotlib's mathematics
LETTERS = "0-9A-Za-zÀ-ɏΑ-ω"
# what `estim.common.labels` makes of one
_MATH = re.compile(rf"(\$_\{{\\mathrm\{{(?:[{LETTERS}]|\\_)+\}}\}}\$)")


Json: TypeAlias = dict[str, Any]
"""An object of JSON, as a file of results has it: `as_json` writes it, `json_of` reads it."""


class Markdown(str):
    """Text that is Markdown on purpose; whoever makes it has escaped what others wrote in it."""

    __slots__ = ()


def one_line(text: str) -> str:
    """`text` on one line, and visible: a blank for white space of any kind, '\\x1b' for what would
    move a cursor or turn the writing.

    A byte of a file name that is not UTF-8 is shown as '\\xff'.  Emoji joined by invisible marks
    are taken apart.
    """
    return (
        text
        if text.isprintable()
        else "".join(mark if mark.isprintable() else _printable(mark) for mark in text)
    )


def plain(text: str) -> str:
    """`text` with what UTF-8 cannot hold, such as other bytes in the name of a file, written with a
    backslash.
    """
    return text.encode("utf-8", "backslashreplace").decode()


def _printable(mark: str) -> str:
    if mark.isspace():
        return " "
    if "\udc80" <= mark <= "\udcff":  # how Python holds such a byte (PEP 383)
        return f"\\x{ord(mark) - 0xDC00:02x}"
    return mark.encode("unicode_escape").decode()


def markdown(text: object) -> Markdown:
    """`text` as Markdown that shows it literally; what is `Markdown` already stays as it is.

    Source: CommonMark 0.31, sections 2.4 (backslash escapes), 2.5 (entities), 4 and 5 (what begins
    a block); tables, strikethrough and mathematics as GitHub adds them.
    """
    if isinstance(text, Markdown):
        return text
    line = _SPECIAL.sub(_escaped, re.sub(r" {2,}", " ", one_line(str(text)).strip()))
    return Markdown(_BLOCK.sub(r"\g<0>\\", line))


def _escaped(match: re.Match[str]) -> str:
    if inside := match["index"] or match["interval"]:
        return f"[{_SPECIAL.sub(_escaped, inside)}]"
    return "".join({"<": "&lt;", "&": "&amp;"}.get(mark, f"\\{mark}") for mark in match[0])


def unescaped(line: str) -> str:
    """The text that a line of Markdown made by `markdown` shows."""
    return html.unescape(re.sub(r"\\([!-/:-@\[-`{-~])", r"\1", line))


def code(text: object) -> Markdown:
    """`text` as a code span where one can hold it as it is, in a table too; else as `markdown`."""
    raw = str(text)
    fits = raw.isprintable() and raw == raw.strip() != "" and not {"`", "|"} & set(raw)
    return Markdown(f"`{raw}`") if fits else markdown(text)


def destination(path: object) -> Markdown:
    """`path` as the destination of a link or an image."""
    return Markdown(quote(str(path), safe="/.-_+~", errors="surrogateescape"))


def number(value: float) -> float | None:
    """`value`, or None where JSON cannot express it."""
    return float(value) if math.isfinite(value) else None


def as_json(record: object) -> bytes:
    """`record` as indented JSON, UTF-8: an array is a list, and null a number that is nan or
    infinite.  Marks that do not print are written as JSON escapes, so that a terminal can show the
    file.
    """
    import msgspec

    encoded = msgspec.json.encode(record, enc_hook=lambda array: array.tolist())
    text = msgspec.json.format(encoded, indent=1).decode()
    return (
        re.sub(
            r"[^\n -~]",
            lambda match: match[0] if match[0].isprintable() else json.dumps(match[0])[1:-1],
            text,
        ).encode()
        + b"\n"
    )


def as_csv(rows: Iterable[Iterable[object]]) -> str:
    """Rows as CSV, a line each."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def json_of(data: bytes) -> Any:
    """The value of a JSON file that somebody may have written by hand.

    Raises ValueError where it is none by RFC 8259, where it is too deep, and where a key stands
    twice in one object: programs read that differently.
    """

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        members: dict[str, Any] = {}
        for key, value in pairs:
            if key in members:
                raise ValueError(f"the key {key!r} stands twice")
            members[key] = value
        return members

    def no_number(text: str) -> float:
        raise ValueError(f"{text} is no number")

    try:
        value = json.loads(data.decode(), object_pairs_hook=once, parse_constant=no_number)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if is_nested_deeper(value, 100):
        raise ValueError("is nested too deeply")
    return value


def is_nested_deeper(tree: object, most: int) -> bool:
    """Whether tables and lists stand in each other so that `most` levels do not hold all of it."""
    level = [tree]
    for _ in range(most):
        inner = (
            node.values() if isinstance(node, dict) else node
            for node in level
            if isinstance(node, dict | list)
        )
        level = [item for items in inner for item in items]
    return bool(level)


def mathtext(text: str) -> str:
    """`text` as matplotlib shows it literally, but for our own subscripts; matplotlib takes what
    stands between two $ for mathematics.
    """
    parts = _MATH.split(one_line(text))
    return "".join(part if i % 2 else part.replace("$", r"\$") for i, part in enumerate(parts))
