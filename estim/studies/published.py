"""Published numbers beside reanalysed ones: value, value, E_n; and the statements of a paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from estim.campaign import KeyTable, checked
from estim.common import Quantity, e_n
from estim.reading import TOML_BYTES, parse_toml, read_text


class PublishedNumber(KeyTable, frozen=True):
    """A number that a paper prints.  parameter, body : what a campaign calls it.  u : None where
    the paper states none.
    """

    name: str
    parameter: str
    value: float
    unit: str
    section: str
    body: str | None = None
    u: float | None = None


class Claim(KeyTable, frozen=True):
    """What a paper says in its own words.  about : what of a reanalysis stands beside them."""

    about: Literal["energy", "theta_min"]
    words: str
    section: str


class Paper(KeyTable, frozen=True):
    """The name of a paper, its numbers and its words."""

    paper: str = ""
    number: tuple[PublishedNumber, ...] = ()
    claim: tuple[Claim, ...] = ()


@dataclass(frozen=True)
class PublishedComparison:
    """A published number, the reanalysed one, how the latter was found, and E_n (k = 2) of the two.

    Where the paper states no uncertainty, E_n counts the reanalysis' alone.
    """

    published: PublishedNumber
    value: Quantity
    how: str
    e_n: float


def read_published(path: Path) -> Paper:
    """The paper that a TOML file describes.  Raises InputError."""
    text, _ = read_text(path, limit=TOML_BYTES)
    tree, places = parse_toml(text, str(path))
    return checked(tree, Paper, places, ())


def compare_published(
    numbers: Sequence[PublishedNumber], reanalysed: Sequence[tuple[str, str | None, Quantity, str]]
) -> tuple[PublishedComparison, ...]:
    """Every published number that one of `reanalysed` (parameter, body or None, value, how) speaks
    of, in the order published; its E_n is nan where that has no uncertainty.
    """
    return tuple(
        PublishedComparison(
            number,
            value,
            how,
            e_n(value, Quantity(number.value, number.u or 0.0)) if value.u > 0.0 else math.nan,
        )
        for number in numbers
        for parameter, body, value, how in reanalysed
        if parameter == number.parameter and (None in (number.body, body) or body == number.body)
    )
