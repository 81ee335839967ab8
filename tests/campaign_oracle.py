"""What a campaign says, read by rules of its own: tomllib, csv, and a few regular expressions.
Shares no code with estim.

It knows less than estim does, and is strict: what it cannot read it calls malformed.  Both answers
of estim are then compared, that a file is refused and which numbers are used
(`campaign_fuzzing.py`).
"""

from __future__ import annotations

import csv
import math
import re
import tomllib
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DIGITS = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
PLAIN = re.compile(rf"[+-]?{DIGITS}(?:[eE][+-]?[0-9]+)?")
SHORT = re.compile(rf"(?P<value>[+-]?{DIGITS})\((?P<u>{DIGITS})\)(?P<power>[eE][+-]?[0-9]+)?")
LONG = re.compile(rf"(?P<value>{PLAIN.pattern})\s*(?:\+/-|\+-|±)\s*(?P<u>{PLAIN.pattern})")
WHOLE = re.compile(rf"\({LONG.pattern}\)(?P<power>[eE][+-]?[0-9]+)")
KINDS = {
    "normal": ("mean", "sd"),
    "uniform": ("low", "high"),
    "half-normal": ("scale",),
    "log-normal": ("median", "log_sd"),
}
KINDS["truncated-normal"] = ("mean", "sd")
ANGLES = {"phi": ("phi_deg", "phi_rad"), "theta0": ("theta0_deg", "theta0_rad")}
OTHERS = {
    "radius": "radius_m",
    "kappa": "kappa",
    "gamma": "gamma",
    "rolling_resistance": "rolling_resistance",
    "g": "g",
}
NOT_TEXT = {"Cc", "Cf", "Cs", "Zl", "Zp"}


class MalformedError(Exception):
    """A value that means nothing."""


@dataclass(frozen=True)
class Stated:
    """kind : "exact", "normal", ... .  numbers : value, or value and standard uncertainty, or those
    of the prior, SI.
    """

    kind: str
    numbers: tuple[float, ...]

    def times(self, factor: float) -> Stated:
        scaled = self.kind != "log-normal"
        return Stated(
            self.kind,
            tuple(n * factor if scaled or i == 0 else n for i, n in enumerate(self.numbers)),
        )


def number(text: str) -> float:
    if not PLAIN.fullmatch(text):
        raise MalformedError(text)
    return sized(float(text))


def sized(value: float) -> float:
    try:
        value = float(value)
    except OverflowError:
        raise MalformedError("beyond all numbers") from None
    if not math.isfinite(value) or (value and not 1e-100 <= abs(value) <= 1e100):
        raise MalformedError(value)
    return value


def stated(value: Any) -> Stated:
    """A value of a campaign.  Raises MalformedError."""
    if isinstance(value, bool) or not isinstance(value, int | float | str | dict):
        raise MalformedError(value)
    if isinstance(value, dict):
        names = KINDS.get(value.get("prior", ""), ()) if isinstance(value.get("prior"), str) else ()
        if not names or any(
            isinstance(value.get(name), bool) or not isinstance(value.get(name), int | float)
            for name in names
        ):
            raise MalformedError(value)
        numbers = tuple(sized(value[name]) for name in names)
        if (names[-1] in ("sd", "scale", "log_sd") and numbers[-1] <= 0) or (
            names == ("low", "high") and numbers[0] >= numbers[1]
        ):
            raise MalformedError(value)
        return Stated(value["prior"], numbers)
    if not isinstance(value, str):
        return Stated("exact", (sized(value),))
    text = value.strip()
    if PLAIN.fullmatch(text):
        return Stated("exact", (number(text),))
    if found := SHORT.fullmatch(text):
        power = float("1" + (found["power"] or ""))
        places = len(found["value"].partition(".")[2])
        u = float(found["u"]) if "." in found["u"] else float(found["u"]) * 10.0**-places
        pair = sized(float(found["value"]) * power), sized(u * power)
    elif found := WHOLE.fullmatch(text):
        power = float("1" + found["power"])
        pair = sized(number(found["value"]) * power), sized(number(found["u"]) * power)
    elif found := LONG.fullmatch(text):
        pair = number(found["value"]), number(found["u"])
    else:
        raise MalformedError(value)
    if pair[1] <= 0.0:
        raise MalformedError(value)
    return Stated("normal", pair)


def table(data: bytes, *, motion: bool = False) -> dict[str, list[float]]:
    """The columns of a CSV file; those that begin with _ are left out.  motion : whether its times
    must increase.  Raises MalformedError.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MalformedError("no UTF-8") from error
    lines = [
        line
        for line in re.split(r"\r\n|\n|\r", text)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise MalformedError("empty")
    mark = next((c for c in "\t;," if c in lines[0]), ",")
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=mark)]
    names, body = rows[0], rows[1:]
    if (
        len(set(names)) < len(names)
        or not all(names)
        or any(PLAIN.fullmatch(name) for name in names)
    ):
        raise MalformedError(names)
    columns: dict[str, list[float]] = {name: [] for name in names if not name.startswith("_")}
    for row in body:
        if len(row) != len(names):
            raise MalformedError(row)
        for name, cell in zip(names, row, strict=True):
            if not name.startswith("_"):
                columns[name].append(number(cell))
    if motion and any(
        b <= a for a, b in zip(columns.get("t_s", []), columns.get("t_s", [])[1:], strict=False)
    ):
        raise MalformedError("times")
    return columns


def document(data: bytes) -> dict[str, Any]:
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise MalformedError("TOML") from error


def runs_of(campaign: dict[str, Any]) -> list[dict[str, Any]]:
    runs = campaign.get("runs", [])
    if not isinstance(runs, list) or not all(isinstance(run, dict) for run in runs):
        raise MalformedError("runs")
    return runs


def run_table(folder: Path, run: dict[str, Any], *, motion: bool) -> dict[str, list[float]] | None:
    """The table that a run names; None where it is not a plain CSV file of ours."""
    name = run.get("file")
    if not isinstance(name, str):
        raise MalformedError("file")
    if not name.endswith(".csv") or "\0" in name or not (folder / name).is_file():
        return None
    return table((folder / name).read_bytes(), motion=motion)


def quantities(campaign: dict[str, Any], run: dict[str, Any]) -> dict[str, tuple[str, Stated]]:
    """Of a rolling body's run: quantity -> where it is said ("[run]", "[body]" or ""), and what, in
    SI units.  Raises MalformedError.
    """
    bodies = campaign.get("bodies", {})
    body = (
        bodies.get(run.get("body"), {})
        if isinstance(bodies, dict) and isinstance(run.get("body"), str)
        else {}
    )
    levels = [
        (f"[{run.get('name')}]", run),
        (f"[{run.get('body')}]", body),
        ("", campaign.get("shared", {})),
    ]
    if not all(isinstance(level, dict) for _, level in levels):
        raise MalformedError("levels")
    found: dict[str, tuple[str, Stated]] = {}
    keys = {name: {keys[0]: math.pi / 180.0, keys[1]: 1.0} for name, keys in ANGLES.items()} | {
        name: {key: 1.0} for name, key in OTHERS.items()
    }
    for name, factors in keys.items():
        for where, level in levels:
            here = [key for key in factors if key in level]
            if len(here) > 1:
                raise MalformedError(name)
            if here:
                found[name] = where, stated(level[here[0]]).times(factors[here[0]])
                break
    return found


def raw_marks(text: str) -> list[str]:
    """Characters that move a cursor, turn the direction of writing or cannot be seen."""
    return sorted(
        {
            f"U+{ord(mark):04X}"
            for mark in text
            if mark not in "\n\t" and unicodedata.category(mark) in NOT_TEXT
        }
    )
