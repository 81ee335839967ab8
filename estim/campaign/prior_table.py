"""A prior as a TOML table, `{prior = "...", ...}`, and what it says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import msgspec

from estim.common import InputError
from estim.problem import HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform

PriorKind = Literal["normal", "uniform", "half-normal", "log-normal", "truncated-normal"]


class PriorKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The keys of a prior, for tables that may hold one; which of them it needs is checked by `read_prior`."""

    prior: PriorKind | None = None
    mean: float | None = None
    sd: float | None = None
    low: float | None = None
    high: float | None = None
    scale: float | None = None
    median: float | None = None
    log_sd: float | None = None


class PriorTable(PriorKeys, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """A table that must hold a prior."""

    prior: PriorKind


Value = float | str | PriorTable


_PRIOR_KEYS: Mapping[str, tuple[str, ...]] = {
    "normal": ("mean", "sd"),
    "uniform": ("low", "high"),
    "half-normal": ("scale",),
    "log-normal": ("median", "log_sd"),
    "truncated-normal": ("mean", "sd", "low", "high"),
}


def read_prior(table: PriorTable, *, factor: float, field: str) -> Prior:
    """The prior of a quantity in SI units, `factor` times the unit of the table.

    Raises InputError naming `field` where a key is missing, does not belong to this prior, or has no sense.
    """
    wanted = _PRIOR_KEYS[table.prior]
    given = {key: number for key in PriorKeys.__struct_fields__ if key != "prior" and (number := getattr(table, key)) is not None}
    optional = ("low", "high") if table.prior == "truncated-normal" else ()
    for key in wanted:
        if key not in given and key not in optional:
            raise InputError(f"needs '{key}' for a {table.prior} prior", field=field)
    for key, number in given.items():
        if key not in wanted:
            raise InputError(f"takes no '{key}' with a {table.prior} prior", field=field)
        if not math.isfinite(number):
            raise InputError(f"needs a finite '{key}'", field=field, value=number)
    scaled = {key: number * (1.0 if key == "log_sd" else factor) for key, number in given.items()}
    try:
        match table.prior:
            case "normal":
                return Normal(scaled["mean"], scaled["sd"])
            case "uniform":
                return Uniform(scaled["low"], scaled["high"])
            case "half-normal":
                return HalfNormal(scaled["scale"])
            case "log-normal":
                return LogNormal(scaled["median"], scaled["log_sd"])
            case "truncated-normal":
                return TruncatedNormal(scaled["mean"], scaled["sd"], scaled.get("low", -math.inf), scaled.get("high", math.inf))
    except InputError as error:
        raise InputError(f"has a prior whose '{error.field}' {error.rule}", field=field, value=error.value) from None
