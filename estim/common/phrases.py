"""The language of what is written for a reader: English, unless `spoken` sets another.

A sentence is written where it is used, in English, as `phrase("{n} of {total} starts ended
elsewhere", n=3, total=8)`; what it is in another language stands in `catalogue/LANGUAGE/*.toml`,
under the English sentence.  `later` marks a sentence that is stored, and translated where it is
used; those of a `PhraseTable`, and of the tables and of `worded` in `estim.words`, need no mark.  A
sentence that a catalogue lacks stays in English.  Not translated: errors, names of parameters, keys
and statuses.
"""

from __future__ import annotations

import re
import tomllib
from collections import UserDict
from collections.abc import Hashable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib.resources import files
from typing import TypeVar

from estim.common.errors import InputError

LANGUAGES = {"en": "English", "es": "español"}
_ENGLISH = "en"
_LANGUAGE: ContextVar[str] = ContextVar("language", default=_ENGLISH)
_COMMANDS: ContextVar[bool] = ContextVar("commands", default=False)
K = TypeVar("K", bound=Hashable)
_SPACES = re.compile(r"\s+")


@contextmanager
def spoken(language: str, *, commands: bool | None = None) -> Iterator[None]:
    """While it lasts, `phrase` translates into `language`, one of `LANGUAGES`, in this thread of
    work and in the processes that `run_parallel` starts.

    commands : whether the reader is a person at the command line, who has options, or one who calls
        functions; None: as before.

    Raises InputError for any other.
    """
    if language not in LANGUAGES:
        raise InputError(f"must be one of {', '.join(LANGUAGES)}", field="language", value=language)
    before = _LANGUAGE.set(language)
    others = None if commands is None else _COMMANDS.set(commands)
    try:
        yield
    finally:
        _LANGUAGE.reset(before)
        if others is not None:
            _COMMANDS.reset(others)


def language() -> str:
    """The current language."""
    return _LANGUAGE.get()


def at_commands() -> bool:
    """Whether the reader is a person at the command line."""
    return _COMMANDS.get()


def phrase(english: str, /, **values: object) -> str:
    """A sentence in the current language, `values` put in as `str.format` does.  Without values,
    braces stay as they are.
    """
    words = english if language() == _ENGLISH else catalogue(language()).get(english, english)
    return words.format(**values) if values else words


def later(english: str) -> str:
    """`english`, for `phrase` to look up where it is used."""
    return english


class PhraseTable(UserDict[K, str]):
    """A table of English sentences, each translated into the current language where it is looked
    up.
    """

    def __getitem__(self, key: K) -> str:
        return phrase(self.data[key])


@cache
def catalogue(language: str) -> Mapping[str, str]:
    """English sentence -> the same in `language`, of all files of its catalogue."""
    sentences: dict[str, str] = {}
    for file in sorted(
        files("estim.common").joinpath("catalogue", language).iterdir(), key=lambda file: file.name
    ):
        sentences |= tomllib.loads(file.read_text(encoding="utf-8"))
    return {
        _SPACES.sub(" ", english).strip() if "\n" in english else english: words
        for english, words in sentences.items()
    }
