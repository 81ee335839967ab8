"""A prior as a TOML table, `{prior = "...", ...}`, and what it states."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta

from estim.campaign.key_table import KeyTable
from estim.common import InputError, Quantity, read_quantity
from estim.problem import PRIORS, Prior, as_prior

if TYPE_CHECKING:
    PriorKind = str
else:
    PriorKind = Literal[*PRIORS]

_NO_UNIT = ("log_sd",)


class PriorKeys(KeyTable, frozen=True, kw_only=True):
    """The keys of a prior, for tables that may hold one; which of them it needs is checked by
    `read_prior`.
    """

    prior: PriorKind | None = None
    mean: float | None = None
    sd: float | None = None
    low: float | None = None
    high: float | None = None
    scale: float | None = None
    median: float | None = None
    log_sd: float | None = None


class PriorTable(PriorKeys, frozen=True, kw_only=True):
    """A table that must hold a prior."""

    prior: PriorKind


Value = float | str | PriorTable
Stated = Value | None  # under a key that may be left out
Positive = Annotated[float, Meta(gt=0.0, le=1e100)]
Finite = Annotated[float, Meta(ge=-1e100, le=1e100)]

Keys = TypeVar("Keys", bound=PriorKeys)


def numbers_of(table: PriorKeys) -> dict[str, float]:
    """The numbers that a prior's table gives, by key."""
    return {
        key: number
        for key in PriorKeys.__struct_fields__
        if key != "prior" and (number := getattr(table, key)) is not None
    }


def times(table: Keys, factor: float) -> Keys:
    """The same prior in a unit `factor` times as small."""
    return msgspec.structs.replace(
        table,
        **{
            key: number * factor for key, number in numbers_of(table).items() if key not in _NO_UNIT
        },
    )


def read_prior(table: PriorKeys, *, factor: float, field: str) -> Prior:
    """The prior of a quantity in SI units, `factor` times the unit of the table.

    Raises InputError naming `field` where a key is missing, does not belong to this prior, or has
    no sense.
    """
    if table.prior is None:
        raise InputError("needs a 'prior' or a 'column'", field=field)
    prior, numbers = PRIORS[table.prior], numbers_of(table)
    for key in prior.keys:
        if key not in numbers:
            raise InputError(f"needs '{key}' for a {table.prior} prior", field=field)
    for key, number in numbers.items():
        if key not in (*prior.keys, *prior.optional):
            raise InputError(f"takes no '{key}' with a {table.prior} prior", field=field)
        if not math.isfinite(number):
            raise InputError(f"needs a finite '{key}'", field=field, value=number)
    optional = numbers_of(times(table, factor))
    required = [optional.pop(key) for key in prior.keys]
    try:
        return prior(*required, **optional)
    except InputError as error:
        raise InputError(
            f"has a prior whose '{error.field}' {error.rule}", field=field, value=error.value
        ) from None


def read_value(
    value: float | str | PriorKeys, *, factor: float = 1.0, field: str
) -> Quantity | Prior:
    """A number, a measured quantity or a prior, in SI units (`factor` times the unit of the key).

    Raises InputError naming `field`.
    """
    if isinstance(value, PriorKeys):
        return read_prior(value, factor=factor, field=field)
    return read_quantity(value, field=field).scaled(factor)


def read_source(
    value: float | str | PriorKeys, *, factor: float = 1.0, field: str, low: float = -math.inf
) -> float | Prior:
    """The same as an exact number, or as a prior that does not reach below `low` where a quantity
    was measured.
    """
    read = read_value(value, factor=factor, field=field)
    if not isinstance(read, Quantity):
        return read
    if math.isfinite(low) and not read.exact and read.value <= low:
        raise InputError(f"must be > {low:g}", field=field, value=value)
    return read.value if read.exact else as_prior(read, low=low)
