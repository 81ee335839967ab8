"""What a reader of a report has to read."""

from __future__ import annotations

import re


def words(text: str) -> list[str]:
    """Those with two letters or more, neither of a figure nor of a link."""
    return [
        word
        for word in re.sub(r"!\[[^\]]*\]\([^)]*\)|[*_#|`]", " ", text).split()
        if re.search(r"[^\W\d_]{2,}", word)
    ]


def first_screen(report: str) -> str:
    """A report up to its first folded part."""
    return report.partition("<details>")[0]


def printed_words(text: str) -> list[str]:
    """Everything that a reader meets between blanks, numbers too, but for figures and addresses."""
    plain = re.sub(r"\]\([^)]*\)", " ", re.sub(r"!\[[^\]]*\]\([^)]*\)", " ", text))
    return [word for word in re.sub(r"[*_#|`]", " ", plain).split() if re.search(r"\w", word)]
