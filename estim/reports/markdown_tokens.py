"""The tokens of a report in Markdown, arranged for a page: figures with their captions, folded parts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from estim.common import unescaped

if TYPE_CHECKING:
    from markdown_it.token import Token

FOLD = re.compile(r"<details>\n<summary><b>([^\n]*)</b></summary>\s*")
END = re.compile(r"</details>\s*")
"""How a folded part begins, with its title, and ends: what `rendering.folded` makes."""


def arranged(tokens: Sequence[Token]) -> list[Token]:
    """The tokens with an image that stands alone as a figure, the italics below it as its caption, no part's title twice."""
    left: list[Token] = []
    i, summary = 0, ""
    while i < len(tokens):
        token = tokens[i]
        if token.type == "html_block":
            found = FOLD.fullmatch(token.content)
            summary = unescaped(found[1]) if found else ""
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
                left += tokens[i : i + 6]
                i += 6
                continue
        left.append(token)
        i += 1
    _levelled(left)
    return left


def _levelled(tokens: Sequence[Token]) -> None:
    """Notes with each heading of a folded part its level below the title of the part, which is of level 2."""
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
        begins, ends = (token.type == "html_block" and mark.fullmatch(token.content) is not None for mark in (FOLD, END))
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
        return [one.type for one in inside] == ["image"]
    ends = [k for k, one in enumerate(inside) if one.type == "em_close" and one.level == 0]
    return bool(inside) and inside[0].type == "em_open" and ends == [len(inside) - 1]
