"""What differs between a file of a report and what is computed now: what no chance explains, and
what was not compared.

Another processor, or another version of NumPy, changes the last digits of a number.  A chain then
makes the same draws, and all estimates agree to a thousandth of their standard deviations; or at
some step it decides otherwise, and the draws are others.  Which of the two happened is asked for
each part of a result by itself:

- the same draws: every number must agree, to 1e-3 of it (estimates: of their standard deviation);
- other draws: estimates must agree within their Monte-Carlo errors, statuses, names and units
  exactly.  The rest follows from the draws and has no stated error (shares, correlations, bands,
  which of two sentences is said): it is not compared, and named.

Diagnostics of the sampling and versions are compared with neither.  A Monte-Carlo error is taken
from the recomputation: a forged report could state a large one.
"""

from __future__ import annotations

import csv
import difflib
import hashlib
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from estim.common import json_of

# of a standard deviation; the Monte-Carlo error of other draws is fifteen times that
SAME_DRAWS = 1e-3
SDS = 5.0  # Monte-Carlo errors of a difference
FEWEST = 400  # effective draws behind an estimate that has no stated Monte-Carlo error
_SAME, _SIMILAR = 1e-9, 1e-3  # relative: the last bits; a number that follows from the same draws
_NOISE = 1e-4  # of the largest number beside it: what is left of a difference that is 0
_LARGEST = 1e300
_PICTURE = re.compile(rb"data:image/png;base64,[\w+/=]+")  # within a page
_ERRORS = {
    "mean": 1.0,
    "value": 1.0,
    "median": 1.3,
    "sd": 1.0,
    "u": 1.0,
    "q16": 1.6,
    "q84": 1.6,
    "q025": 3.0,
    "q975": 3.0,
}
"""Monte-Carlo error of each number of an estimate over that of its mean; of a normal
distribution, rounded up.
"""
_PAIRS = (("mean", "sd"), ("value", "u"), ("mean", "u"))
_DIAGNOSTICS = frozenset(
    {"rhat", "ess_bulk", "ess_tail", "mcse", "certificate", "k_hat", "versions"}
)
_STATED = frozenset(
    {  # words that no draw decides
        "status",
        "statuses",
        "kind",
        "title",
        "schema",
        "formula",
        "unit",
        "meaning",
        "campaign",
        "run",
        "body",
        "error",
        "prior",
        "stated",
    }
)
# numbers that no draw decides
_FIXED = frozenset({"prior_mean", "prior_sd", "stated", "true", "seed", "n_obs", "dof"})
_NUMBER = re.compile(r"(?<!\w)[-−+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?")
_PLUS_MINUS = re.compile(rf"({_NUMBER.pattern})[\s\u00a0]*±[\s\u00a0]*({_NUMBER.pattern})")
_VERSIONS = re.compile(r"(?m)^\|[^|\n]*\| python \d[^|\n]*\|$")  # a row of a table of the report
_DIGITS = re.compile(r"(?<!\w)[-−+]?\d[\d.,e⁰¹²³⁴⁵⁶⁷⁸⁹⁻]*")


class Verdict(Enum):
    """WRONG : nothing explains it.  WITHIN : within the tolerance.  ASIDE : not compared."""

    WRONG = "wrong"
    WITHIN = "within"
    ASIDE = "aside"


@dataclass(frozen=True)
class Difference:
    """where : line or key.  before, now : as the report has it, as it was recomputed; "" where
    there is nothing.
    """

    file: str
    where: str
    before: str
    now: str
    verdict: Verdict = Verdict.WRONG


def differences(
    file: str, before: bytes, now: bytes, *, same_draws: bool, exact: bool
) -> list[Difference]:
    """What differs, empty where the bytes are the same.

    same_draws : whether all results of the report come from the same draws (`draws_are_same`).
    exact : whether all their numbers are the same.
    """
    if before == now:
        return []
    if file.endswith((".json", ".csv")):
        try:
            found = _of_values(file, "", _values(file, before), _values(file, now), same_draws)
            # what was put in, before what follows
            return sorted(
                found, key=lambda one: one.where.rpartition(".")[2] not in _FIXED | _STATED
            )
        except ValueError as error:
            return [Difference(file, "all of it", f"cannot be read ({error})", "")]
    if file.endswith((".md", ".html")):
        old, new = (
            _PICTURE.sub(_digest, data).decode("utf-8", "replace") for data in (before, now)
        )
        before_lines, now_lines = (_VERSIONS.sub("", text).splitlines() for text in (old, new))
        return list(_of_lines(file, before_lines, now_lines, same_draws, exact))
    return [Difference(file, "", "other bytes than", "those that are made now", Verdict.ASIDE)]


def draws_are_same(file: str, before: bytes, now: bytes) -> bool:
    """Whether all estimates in a file of numbers agree so well that they come from the same draws;
    True for other files.
    """
    if not file.endswith((".json", ".csv")) or before == now:
        return True
    try:
        return _apart(_values(file, before), _values(file, now)) <= SAME_DRAWS
    except ValueError:
        return True


def different_values(before: object, now: object) -> list[str]:
    """Where two decoded JSON values differ, by more than the last bits."""
    return [one.where for one in _of_values("", "", before, now, True, exact=True)]


def is_number(value: object) -> bool:
    """A number of JSON, but for those that are too large to be one of ours."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _digest(picture: re.Match[bytes]) -> bytes:
    return b"picture with SHA-256 " + hashlib.sha256(picture[0]).hexdigest().encode()


def _values(file: str, data: bytes) -> Any:
    """The decoded JSON, or the rows of a table: cells by their heads, and a quantity with its
    columns "sd", "q025" ... as one estimate.

    Raises ValueError.
    """
    if file.endswith(".json"):
        return json_of(data)
    try:
        rows = list(csv.reader(io.StringIO(data.decode()), strict=True))
    except csv.Error as error:
        raise ValueError(str(error)) from None
    heads = rows[0] if rows else []
    if any(len(row) != len(heads) for row in rows) or len(set(heads)) < len(heads):
        return rows
    parts = {
        f"{head} {end}": (head, end)
        for head in heads
        if f"{head} sd" in heads
        for end in ("sd", "q025", "q975")
    }
    parts |= {head: (head, "mean") for head, _ in [*parts.values()]}
    found: list[Any] = [heads]
    for row in rows[1:]:
        line: dict[str, Any] = {}
        for head, cell in zip(heads, row, strict=True):
            name, inner = parts.get(head, (head, ""))
            if inner:
                line.setdefault(name, {})[inner] = _number(cell)
            else:
                line[name] = _number(cell)
        found.append(line)
    return found


def _number(cell: str) -> float | str:
    try:
        value = float(cell)
    except ValueError:
        return cell
    return value if math.isfinite(value) else cell


def _spread(now: object) -> float | None:
    """The standard deviation of an estimate, None where `now` is none."""
    if isinstance(now, dict):
        for value, spread in _PAIRS:
            if is_number(now.get(value)) and is_number(now.get(spread)):
                return float(abs(now[spread]))
    return None


def _apart(before: object, now: object) -> float:
    """The largest difference of an estimate, in its standard deviations (0 where there is none)."""
    if isinstance(before, dict) and isinstance(now, dict):
        spread = _spread(now)
        both = [key for key in now if key in before]
        if spread is None:
            return max((_apart(before[key], now[key]) for key in both), default=0.0)
        return max(_moves(before, now, spread), default=0.0)
    if isinstance(before, list) and isinstance(now, list):
        return max((_apart(a, b) for a, b in zip(before, now, strict=False)), default=0.0)
    return 0.0


def _moves(before: Mapping[str, Any], now: Mapping[str, Any], spread: float) -> list[float]:
    """By how many of its standard deviations each number of an estimate differs."""
    pairs = [
        (before[key], now[key])
        for key in now
        if key in _ERRORS and is_number(before.get(key)) and is_number(now[key])
    ]
    return [
        0.0
        if abs(a - b) <= _SAME * max(abs(a), abs(b))
        else abs(a - b) / spread
        if spread > 0.0
        else math.inf
        for a, b in pairs
    ]


def _has_estimate(now: object) -> bool:
    if isinstance(now, dict):
        return _spread(now) is not None or any(map(_has_estimate, now.values()))
    return isinstance(now, list) and any(map(_has_estimate, now))


def _of_values(
    file: str,
    path: str,
    before: Any,
    now: Any,
    same: bool,
    *,
    exact: bool = False,
    scale: float = 0.0,
) -> Iterator[Difference]:
    """exact : every number that differs by more than the last bits is wrong.  scale : of the
    numbers beside it.
    """
    key = re.sub(r"(\[\d+\])+$", "", path.rpartition(".")[2])
    if not exact and key in _DIAGNOSTICS:
        if before != now and key != "versions":
            yield Difference(file, path, _short(before), _short(now), Verdict.ASIDE)
        return
    if isinstance(before, dict) and isinstance(now, dict):
        same = _apart(before, now) <= SAME_DRAWS if _has_estimate(now) else same
        spread, scale = None if exact else _spread(now), _scale(now.values())
        # other draws move most numbers of an estimate: where a few differ, somebody changed them
        if spread is not None:
            moved = _moves(before, now, spread)
            scale = 0.0  # beside an estimate stand numbers of draws
            n_moved = sum(one > SAME_DRAWS for one in moved)
            same = 2 * n_moved <= len(moved) if len(moved) > 2 else n_moved == 0
        for name in [*before, *(name for name in now if name not in before)]:
            place = f"{path}.{name}" if path else name
            if name not in now or name not in before:
                yield Difference(
                    file, place, _short(before.get(name, "")), _short(now.get(name, ""))
                )
            elif spread is not None and name in _ERRORS:
                yield from _of_estimate(
                    file, place, before[name], now[name], _tolerance(name, now, spread, same)
                )
            else:
                yield from _of_values(
                    file, place, before[name], now[name], same, exact=exact, scale=scale
                )
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for i, (one, other) in enumerate(zip(before, now, strict=True)):
            yield from _of_values(
                file, f"{path}[{i}]", one, other, same, exact=exact, scale=max(scale, _scale(now))
            )
    elif is_number(before) and is_number(now):
        apart, size = abs(before - now), max(abs(before), abs(now))
        if apart > _SAME * size:
            same, noise = same or key in _FIXED, 0.0 if key in _FIXED else _NOISE * scale
            verdict = Verdict.WITHIN if apart <= max(_SIMILAR * size, noise) else Verdict.WRONG
            yield Difference(
                file,
                path,
                _short(before),
                _short(now),
                Verdict.WRONG if exact else verdict if same else Verdict.ASIDE,
            )
    elif before != now or type(before) is not type(now):
        stated = (
            same
            or exact
            or bool(
                _STATED & {*re.findall(r"[^.\[\]]+", path)}
                and isinstance(before, str)
                and isinstance(now, str)
            )
        )
        alike = (
            not exact
            and isinstance(before, str)
            and isinstance(now, str)
            and key not in _STATED
            and _alike(before, now)
        )
        yield Difference(
            file,
            path,
            _short(before),
            _short(now),
            Verdict.WITHIN if alike else Verdict.WRONG if stated else Verdict.ASIDE,
        )


def _scale(values: Iterable[Any]) -> float:
    """The largest number among `values` and in lists among them."""
    sizes = (
        _scale(value) if isinstance(value, list) else float(abs(value)) if is_number(value) else 0.0
        for value in values
    )
    return max(sizes, default=0.0)


def _tolerance(name: str, now: Mapping[str, Any], spread: float, same: bool) -> float:
    if same:
        return SAME_DRAWS * spread
    mcse = float(now["mcse"]) if is_number(now.get("mcse")) else spread / math.sqrt(FEWEST)
    return SDS * math.sqrt(2.0) * _ERRORS[name] * mcse


def _of_estimate(
    file: str, place: str, before: Any, now: Any, tolerance: float
) -> Iterator[Difference]:
    if is_number(before) and is_number(now):
        apart, bits = abs(before - now), _SAME * max(abs(before), abs(now))
        if apart > bits:
            yield Difference(
                file,
                place,
                _short(before),
                _short(now),
                Verdict.WITHIN if apart <= max(tolerance, bits) else Verdict.WRONG,
            )
    elif before != now or type(before) is not type(now):
        yield Difference(file, place, _short(before), _short(now))


def _of_lines(
    file: str, before: list[str], now: list[str], same: bool, exact: bool
) -> Iterator[Difference]:
    """Line by line; lines with the same words belong together, whatever their numbers.

    Other words are wrong where every number is the same.  Else they can be a matter of the last
    digits: which of two equal shares is named first.
    """
    if len(before) > 4 * len(now) + 100:
        yield Difference(file, "", f"{len(before)} lines", f"{len(now)} lines")
        return
    old, new = ([_DIGITS.sub("#", line) for line in lines] for lines in (before, now))
    for tag, i, j, k, m in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        if tag != "equal":
            a, b = _shown(" / ".join(before[i:j]), " / ".join(now[k:m]))
            yield Difference(file, f"line {i + 1}", a, b, Verdict.WRONG if exact else Verdict.ASIDE)
            continue
        for at, (one, other) in enumerate(zip(before[i:j], now[k:m], strict=True), start=i + 1):
            if one != other:
                wrong = not _alike(one, other) if same else not _estimates_agree(one, other)
                a, b = _shown(one, other)
                yield Difference(
                    file,
                    f"line {at}",
                    a,
                    b,
                    Verdict.WRONG if wrong else Verdict.WITHIN if same else Verdict.ASIDE,
                )


def _alike(one: str, other: str) -> bool:
    """Whether two texts have the same words, and numbers that differ by the rounding of their last
    digit or by a thousandth.
    """
    a, b = _NUMBER.findall(one), _NUMBER.findall(other)
    if _NUMBER.sub("#", one) != _NUMBER.sub("#", other) or len(a) != len(b):
        return False
    return all(
        x == y
        or abs(_value(x) - _value(y)) <= max(1.01 * _last_digit(y), _SIMILAR * abs(_value(y)))
        for x, y in zip(a, b, strict=True)
    )


def _estimates_agree(one: str, other: str) -> bool:
    """Whether what stands as value ± uncertainty in two lines agrees within Monte-Carlo errors."""
    for (a, u_a), (b, u_b) in zip(
        _PLUS_MINUS.findall(one), _PLUS_MINUS.findall(other), strict=False
    ):
        tolerance = SDS * math.sqrt(2.0 / FEWEST) * abs(_value(u_b))
        for x, y in ((a, b), (u_a, u_b)):
            if abs(_value(x) - _value(y)) > tolerance + _last_digit(y):
                return False
    return True


def _value(text: str) -> float:
    return float(text.replace("−", "-").replace(",", "."))


def _last_digit(text: str) -> float:
    digits, _, power = text.partition("e")
    decimals = len(re.split(r"[.,]", digits)[1]) if re.search(r"[.,]", digits) else 0
    return 10.0 ** (max(min(int(power or 0), 300), -300) - decimals)


def _shown(one: str, other: str, width: int = 80) -> tuple[str, str]:
    """Two long lines from a little before they differ."""
    at = next((i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), 0)
    begin = max(at - width // 2, 0) if max(len(one), len(other)) > width else 0
    return _short(one[begin:]), _short(other[begin:])


def _short(value: object) -> str:
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 80 else text[:77] + "..."
