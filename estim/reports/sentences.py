"""The sentences of a template: what a catalogue translates, before the template is compiled.

One is a row of a table, an item of a list, a heading, or the lines of a paragraph up to a blank line or a line of tags alone; white space in
it counts as a blank.  Tags inside it belong to it: a translation keeps them and puts them where its grammar wants them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from estim.common import phrase

_TAG = re.compile(r"\{%.*?%\}|\{#.*?#\}", re.DOTALL)
_MARKED = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}|`[^`]*`|</?\w[^>]*>", re.DOTALL)
_QUOTED = re.compile(r"\{[{%][^}]*?(?:\bif\b|\belse\b|~)[^}]*?[\"'][^\"']*[A-Za-z]{2}[^\"']*[\"'][^}]*?[%}]\}")
_WORD = re.compile(r"[^\W\d_]{2}")
_OWN_LINE = ("|", "#", "-", "*", ">", "<")  # begins a sentence of its own


def sentences(source: str) -> Iterator[str]:
    """Those of a template's source that have words, in their order."""
    found: list[str] = []

    def kept(words: str) -> str:
        found.append(words)
        return words

    _each(source, kept)
    yield from found


def translated(source: str) -> str:
    """A template's source in the language that is spoken."""
    return _each(source, phrase)


def _each(source: str, of: Callable[[str], str]) -> str:
    """`source` with each sentence that has words replaced by `of` it; where that is the same, the lines stay as they are."""
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
        bare = line.strip()
        if not bare or not _TAG.sub("", bare).strip():
            close()
            out.append(line)
            continue
        if bare.startswith(_OWN_LINE) or (block and block[-1].strip().startswith(("|", "#"))):
            close()
        block.append(line)
    close()
    return "\n".join(out)


def _has_words(text: str) -> bool:
    return bool(_WORD.search(_MARKED.sub("", text)) or _QUOTED.search(text))
