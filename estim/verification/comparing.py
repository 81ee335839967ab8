"""What differs between a file of a report and what is computed now: what no chance explains, and
what was not compared.

Another processor, or another version of NumPy, changes the last digits of a number.  A chain then
makes the same draws, and all estimates agree to a thousandth of their standard deviations; or at
some step it decides otherwise, and the draws are others.  Which of the two happened is decided for
each part of a result by itself:

- the same draws: every number must agree, to 1e-3 of it (estimates: of their standard deviation);
- other draws: estimates must agree within their Monte-Carlo errors, statuses, names and units
  exactly.  The rest follows from the draws and has no stated error (shares, correlations, bands,
  which of two sentences is shown): it is not compared, and named.

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
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from estim.common import Json, json_of, shorten

# of a standard deviation; the Monte-Carlo error of other draws is fifteen times that
SAME_DRAWS = 1e-3
SDS = 5.0  # Monte-Carlo errors of a difference
FEWEST = 400  # effective draws behind an estimate that has no stated Monte-Carlo error
_SAME, _SIMILAR = 1e-9, 1e-3  # relative: the last bits; a number that follows from the same draws
_COUNTED = 0.1  # relative: of a simulated p-value, whose own error is 20 % where it is small
_WIDTH = 80  # characters of a difference that are shown
_PICTURE = re.compile(rb"data:image/png;base64,[\w+/=]+")  # within a page
_ERRORS = {
    **dict.fromkeys(("mean", "value", "sd", "u"), 1.0),
    "median": 1.3,
    **dict.fromkeys(("q16", "q84"), 1.6),
    "limit_68": 1.6,
    **dict.fromkeys(("q025", "q975", "upper_95", "limit_95"), 3.0),
}
"""Monte-Carlo error of each number of an estimate over that of its mean; of a normal
distribution, rounded up.
"""
_PAIRS = (("mean", "sd"), ("value", "u"), ("mean", "u"))
_DIAGNOSTICS = {"rhat", "ess_bulk", "ess_tail", "mcse", "certificate", "k_hat", "versions"}
_STATED = {
    *("status", "statuses", "kind", "title", "schema", "formula", "unit", "meaning"),
    *("campaign", "run", "body", "error", "prior", "stated"),
}  # words that no draw decides
_FIXED = {"prior_mean", "prior_sd", "stated", "true", "seed", "n_obs", "dof"}  # numbers of the kind
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
            entries = _of_values("", _values(file, before), _values(file, now), same_draws)
            # what was put in, before what follows
            return sorted(
                entries, key=lambda difference: _key(difference.where) not in _FIXED | _STATED
            )
        except ValueError as error:
            return [Difference("all of it", f"cannot be read ({error})", "")]
    if file.endswith((".md", ".html")):
        texts = (_PICTURE.sub(_digest, data).decode("utf-8", "replace") for data in (before, now))
        old, new = (_VERSIONS.sub("", text).splitlines() for text in texts)
        return list(_of_lines(old, new, same_draws, exact))
    return [Difference("", "other bytes than", "those that are made now", Verdict.ASIDE)]


def draws_are_same(file: str, before: bytes, now: bytes) -> bool:
    """Whether all estimates in a file of numbers agree so well that they come from the same draws;
    True for other files.
    """
    if not file.endswith((".json", ".csv")) or before == now:
        return True
    try:
        return all(move <= SAME_DRAWS for move in _moves(_values(file, before), _values(file, now)))
    except ValueError:
        return True


def different_values(before: object, now: object) -> list[str]:
    """Where two decoded JSON values differ, by more than the last bits."""
    return [difference.where for difference in _of_values("", before, now, True, exact=True)]


def is_number(value: object) -> bool:
    """A number of JSON, but for those that are too large to be one of ours."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e300


def estimate_in(node: object) -> tuple[float, float] | None:
    """The value of an estimate and its standard deviation, or standard uncertainty; None where
    `node` is none.
    """
    if isinstance(node, dict):
        for value, spread in _PAIRS:
            if is_number(node.get(value)) and is_number(node.get(spread)):
                return float(node[value]), float(abs(node[spread]))
    return None


def _spread_in(node: object) -> float | None:
    """The standard deviation of an estimate, of one that is a limit (no mean and sd) half its 68 %
    interval; None where `node` is none.
    """
    if (estimate := estimate_in(node)) is not None:
        return estimate[1]
    if isinstance(node, dict) and is_number(node.get("q16")) and is_number(node.get("q84")):
        return float(0.5 * abs(node["q84"] - node["q16"]))
    return None


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
    parts: dict[str, tuple[str, str]] = {}
    for head in heads:
        if f"{head} sd" in heads:
            parts[head] = (head, "mean")
            parts |= {f"{head} {end}": (head, end) for end in ("sd", "q025", "q975")}
    records: list[Any] = [heads]
    for row in rows[1:]:
        line: Json = {}
        for head, cell in zip(heads, row, strict=True):
            name, inner = parts.get(head, (head, ""))
            (line.setdefault(name, {}) if inner else line)[inner or name] = _number(cell)
        records.append(line)
    return records


def _number(cell: str) -> float | str:
    try:
        value = float(cell)
    except ValueError:
        return cell
    return value if math.isfinite(value) else cell


def _moves(before: Any, now: Any) -> Iterator[float]:
    """By how many of its standard deviations each number of each estimate differs."""
    if isinstance(before, dict) and isinstance(now, dict):
        spread = _spread_in(now)
        for key in now.keys() & before.keys():
            a, b = before[key], now[key]
            if spread is None:
                yield from _moves(a, b)
            elif key in _ERRORS and is_number(a) and is_number(b):
                change = abs(a - b)
                bits = _SAME * max(abs(a), abs(b))
                yield 0.0 if change <= bits else change / spread if spread > 0.0 else math.inf
    elif isinstance(before, list) and isinstance(now, list):
        for a, b in zip(before, now, strict=False):
            yield from _moves(a, b)


def _key(path: str) -> str:
    """The last name of a path, without places in lists."""
    return path.rpartition(".")[2].partition("[")[0]


def _of_values(
    path: str,
    before: Any,
    now: Any,
    same: bool,
    *,
    exact: bool = False,
    scale: float = 0.0,
    same_beside: bool = True,
    spread: float | None = None,
) -> Iterator[Difference]:
    """exact : every number that differs by more than the last bits is wrong.  scale : of the
    numbers beside it.  same_beside : whether most numbers of the estimates beside it are of the
    same draws.  spread : of the estimate of which this is a part.
    """
    key = _key(path)
    if not exact and key in _DIAGNOSTICS:
        if before != now and key != "versions":
            yield _difference(path, before, now, Verdict.ASIDE)
    elif isinstance(before, dict) and isinstance(now, dict):
        spread = None if exact else _spread_in(now) if key != "limit" else spread
        moved = [move > SAME_DRAWS for move in _moves(before, now)]
        if spread is not None:  # beside it stand numbers of draws
            # other draws move most numbers of an estimate, and of those beside it: where a few
            # differ, somebody changed them
            few = 2 * sum(moved) <= len(moved) if len(moved) > 2 else not any(moved)
            same, scale = few and same_beside if moved else same, 0.0
        else:
            same, scale = not any(moved) if moved else same, _scale([*now.values()])
            same_beside = 2 * sum(moved) <= len(moved)
        for name in dict.fromkeys([*before, *now]):
            place = f"{path}.{name}" if path else name
            if name not in now or name not in before:
                yield _difference(place, before.get(name, ""), now.get(name, ""))
            elif spread is None or name not in _ERRORS:
                yield from _of_values(
                    place,
                    before[name],
                    now[name],
                    same,
                    exact=exact,
                    scale=scale,
                    same_beside=same_beside,
                    spread=spread,
                )
            else:
                tolerance = SAME_DRAWS * spread if same else _tolerance(name, now, spread)
                yield from _of_numbers(place, before[name], now[name], tolerance)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for i, (old, new) in enumerate(zip(before, now, strict=True)):
            yield from _of_values(
                f"{path}[{i}]",
                old,
                new,
                same,
                exact=exact,
                scale=max(scale, _scale(now)),
                same_beside=same_beside,
            )
    elif is_number(before) and is_number(now):
        stated = key in _FIXED
        tolerance = _similar_numbers(path, before, now)
        # what is left of a difference that is 0, of the largest number beside it
        yield from _of_numbers(
            path,
            before,
            now,
            0.0 if exact else tolerance if stated else max(tolerance, 1e-4 * scale),
            otherwise=Verdict.WRONG if exact or same or stated else Verdict.ASIDE,
            within=same or stated,
        )
    elif before != now or type(before) is not type(now):
        words = isinstance(before, str) and isinstance(now, str)
        similar = words and not exact and key not in _STATED and _similar(before, now)
        stated = words and bool(_STATED & {*re.findall(r"[^.\[\]]+", path)})
        wrong = Verdict.WRONG if same or exact or stated else Verdict.ASIDE
        yield _difference(path, before, now, Verdict.WITHIN if similar else wrong)


def _similar_numbers(path: str, before: float, now: float) -> float:
    """By how much two numbers that follow from the same draws may differ: shifts are in standard
    deviations and may be nothing but rounding; p-values count simulated data sets, some of which
    the last bits put on the other side.
    """
    least = 0.0
    if ".shifts." in path:
        least = SAME_DRAWS
    elif _key(path) in ("p_value", "p_below"):
        least = _COUNTED * min(now, 1.0 - now)
    return max(_SIMILAR * max(abs(before), abs(now)), least)


def _difference(
    path: str, before: object, now: object, verdict: Verdict = Verdict.WRONG
) -> Difference:
    return Difference(path, _short(before), _short(now), verdict)


def _of_numbers(
    path: str,
    before: Any,
    now: Any,
    tolerance: float,
    *,
    otherwise: Verdict = Verdict.WRONG,
    within: bool = True,
) -> Iterator[Difference]:
    """Numbers that differ by more than the last bits; what is no number must be the same.

    otherwise : the verdict beyond the tolerance.  within : whether the tolerance counts at all.
    """
    if not (is_number(before) and is_number(now)):
        if before != now or type(before) is not type(now):
            yield _difference(path, before, now)
        return
    change = abs(before - now)
    if change > _SAME * max(abs(before), abs(now)):
        yield _difference(
            path, before, now, Verdict.WITHIN if within and change <= tolerance else otherwise
        )


def _scale(values: list[Any]) -> float:
    """The largest number among `values` and in lists among them."""
    sizes = (
        _scale(value) if isinstance(value, list) else float(abs(value)) if is_number(value) else 0.0
        for value in values
    )
    return max(sizes, default=0.0)


def _tolerance(name: str, now: Json, spread: float) -> float:
    """Of an estimate from other draws."""
    mcse = float(now["mcse"]) if is_number(now.get("mcse")) else spread / math.sqrt(FEWEST)
    return SDS * math.sqrt(2.0) * _ERRORS[name] * mcse


def _of_lines(before: list[str], now: list[str], same: bool, exact: bool) -> Iterator[Difference]:
    """Line by line; lines with the same words belong together, whatever their numbers.

    Other words are wrong where every number is the same.  Else they can be a matter of the last
    digits: which of two equal shares is named first.
    """
    if len(before) > 4 * len(now) + 100:
        yield Difference("", f"{len(before)} lines", f"{len(now)} lines")
        return
    old_words, new_words = ([_DIGITS.sub("#", line) for line in lines] for lines in (before, now))
    for tag, i, j, k, m in difflib.SequenceMatcher(
        None, old_words, new_words, autojunk=False
    ).get_opcodes():
        if tag == "equal":
            pairs = list(zip(range(i + 1, j + 1), before[i:j], now[k:m], strict=True))
        else:
            pairs = [(i + 1, " / ".join(before[i:j]), " / ".join(now[k:m]))]
        for at, old_line, new_line in pairs:
            if old_line == new_line:
                continue
            if tag != "equal":
                verdict = Verdict.WRONG if exact else Verdict.ASIDE
            elif same:
                verdict = Verdict.WITHIN if _similar(old_line, new_line) else Verdict.WRONG
            else:
                verdict = Verdict.ASIDE if _estimates_agree(old_line, new_line) else Verdict.WRONG
            yield _difference(f"line {at}", *_shown(old_line, new_line), verdict)


def _similar(first: str, second: str) -> bool:
    """Whether two texts have the same words, and numbers that differ by the rounding of their last
    digit or by a thousandth.
    """
    return _NUMBER.sub("#", first) == _NUMBER.sub("#", second) and all(
        _near(x, y, _SIMILAR * abs(_value(y)), 1.01)
        for x, y in zip(_NUMBER.findall(first), _NUMBER.findall(second), strict=True)
    )


def _estimates_agree(first: str, second: str) -> bool:
    """Whether what stands as value ± uncertainty in two lines agrees within Monte-Carlo errors."""
    pairs = zip(_PLUS_MINUS.findall(first), _PLUS_MINUS.findall(second), strict=False)
    return all(
        _near(x, y, SDS * math.sqrt(2.0 / FEWEST) * abs(_value(b[1])) + _last_digit(y))
        for a, b in pairs
        for x, y in zip(a, b, strict=True)
    )


def _near(first: str, second: str, tolerance: float, digits: float = 0.0) -> bool:
    """Whether two numbers differ by no more than `tolerance`, or `digits` units of the last."""
    change = abs(_value(first) - _value(second))
    return first == second or change <= max(tolerance, digits * _last_digit(second))


def _value(text: str) -> float:
    return float(text.replace("−", "-").replace(",", "."))


def _last_digit(text: str) -> float:
    digits, _, power = text.partition("e")
    decimals = len(digits.replace(",", ".").partition(".")[2])
    return 10.0 ** (max(min(int(power or 0), 300), -300) - decimals)


def _shown(first: str, second: str) -> tuple[str, str]:
    """Two long lines from a little before they differ."""
    at = next((i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a != b), 0)
    begin = max(at - _WIDTH // 2, 0) if max(len(first), len(second)) > _WIDTH else 0
    return first[begin:], second[begin:]


def _short(value: object) -> str:
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    return shorten(text, _WIDTH)
