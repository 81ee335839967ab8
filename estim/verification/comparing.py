"""What differs between two versions of a file of a report, and which of it Monte Carlo explains."""

from __future__ import annotations

import csv
import difflib
import hashlib
import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

_SAME = 1e-9  # relative: the last bits of another machine
_LARGEST = 1e300
_SDS = 5.0  # Monte-Carlo errors of the difference
_PICTURE = re.compile(rb"data:image/png;base64,[\w+/=]+")  # within a page
_ERRORS = {"mean": 1.0, "median": 1.3, "sd": 1.0, "q16": 1.6, "q84": 1.6, "q025": 3.0, "q975": 3.0}
"""Monte-Carlo error of each number of a summary over that of its mean; of a normal distribution, rounded up."""


@dataclass(frozen=True)
class Difference:
    """where : line or key.  before, now : as the report has it, as it was recomputed; "" where there is nothing.

    by_chance : whether Monte Carlo error explains it (None: cannot be judged).
    """

    file: str
    where: str
    before: str
    now: str
    by_chance: bool | None = False


def differences(file: str, before: bytes, now: bytes) -> list[Difference]:
    """What differs, empty where the bytes are the same or the numbers are, to the last bits."""
    if before == now:
        return []
    if file.endswith(".json"):
        try:
            return list(_of_values(file, "", json.loads(before), json.loads(now), None))
        except (ValueError, RecursionError):
            return [Difference(file, "", "no JSON", "")]
    if file.endswith(".csv"):
        return _of_cells(file, before.decode("utf-8", "replace"), now.decode("utf-8", "replace"))
    if file.endswith((".md", ".html")):
        return _of_lines(file, *(_PICTURE.sub(_digest, data).decode("utf-8", "replace") for data in (before, now)))
    return [Difference(file, "", "other bytes than", "those that are drawn now")]


def _digest(picture: re.Match[bytes]) -> bytes:
    return b"picture with SHA-256 " + hashlib.sha256(picture[0]).hexdigest().encode()


def _of_lines(file: str, before: str, now: str) -> list[Difference]:
    found, old, new = [], before.splitlines(), now.splitlines()
    for tag, i, j, k, m in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        if tag != "equal":
            found.append(Difference(file, f"line {i + 1}", " / ".join(old[i:j]), " / ".join(new[k:m])))
    return found


def _of_cells(file: str, before: str, now: str) -> list[Difference]:
    """Cell by cell where both tables have one shape, otherwise by lines."""
    try:
        old, new = (list(csv.reader(io.StringIO(text))) for text in (before, now))
    except csv.Error:
        return _of_lines(file, before, now)
    if [len(row) for row in old] != [len(row) for row in new] or old[:1] != new[:1]:
        return _of_lines(file, before, now)
    return [
        Difference(file, f"line {i}, {head}", _short(one), _short(other))
        for i, (row, row_now) in enumerate(zip(old, new, strict=True), start=1)
        for head, one, other in zip(old[0], row, row_now, strict=False)
        if one != other and not _same_number(one, other)
    ]


def _same_number(one: str, other: str) -> bool:
    try:
        a, b = float(one), float(other)
    except ValueError:
        return False
    return abs(a - b) <= _SAME * max(abs(a), abs(b))


def _of_values(file: str, path: str, before: Any, now: Any, summary: tuple[Mapping[str, Any], Mapping[str, Any]] | None) -> Iterator[Difference]:
    if isinstance(before, dict) and isinstance(now, dict):
        inside = (before, now) if {"mean", "mcse"} <= before.keys() & now.keys() else None
        for key in [*before, *(key for key in now if key not in before)]:
            place = f"{path}.{key}" if path else key
            if key not in now or key not in before:
                yield Difference(file, place, _short(before.get(key, "")), _short(now.get(key, "")))
            else:
                yield from _of_values(file, place, before[key], now[key], inside)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for i, (one, other) in enumerate(zip(before, now, strict=True)):
            yield from _of_values(file, f"{path}[{i}]", one, other, None)
    elif is_number(before) and is_number(now):
        if abs(before - now) > _SAME * max(abs(before), abs(now)):
            yield Difference(file, path, _short(before), _short(now), _by_chance(path.rpartition(".")[2], before, now, summary))
    elif before != now or type(before) is not type(now):
        yield Difference(file, path, _short(before), _short(now))


def _by_chance(name: str, before: float, now: float, summary: tuple[Mapping[str, Any], Mapping[str, Any]] | None) -> bool | None:
    if summary is None or name not in _ERRORS or not all(is_number(one["mcse"]) for one in summary):
        return None
    error = _ERRORS[name] * math.hypot(summary[0]["mcse"], summary[1]["mcse"])
    return abs(before - now) <= _SDS * error


def different_values(before: object, now: object) -> list[str]:
    """Where two decoded JSON values differ, by more than the last bits."""
    return [one.where for one in _of_values("", "", before, now, None)]


def is_number(value: object) -> bool:
    """A number of JSON, but for those that are too large to be one of ours."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _short(value: object) -> str:
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 80 else text[:77] + "..."
