"""What differs between the files of a report and those that are made now: what is wrong, and what
was not compared.

On the machine that made a report all comes out the same.  If nine tenths of the numbers in the
JSON files are the same to the last digit, this is such a machine, and whatever differs is wrong.
Another processor, number of threads or version of a package changes last digits; a chain may then
make other draws.  There

- names, units, statuses and what was stated must be the same, and estimates must agree within their
  Monte-Carlo errors, which are taken from the recomputation: a forged report could state large
  ones;
- what stands as value ± uncertainty in a line of text must agree too;
- everything else has no known error: it is not compared, and named.
"""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from estim.common import json_of, shorten

WHOLE = "all of it"
Pair = tuple[bytes, bytes]  # a file as it was written before, and now
_SAME = 1e-6  # relative: numbers that are the same
_SAME_DRAWS = 1e-3  # sds; the Monte-Carlo error of other draws is fifteen times that
_FEWEST = 400  # effective draws behind an estimate that states no Monte-Carlo error
# five Monte-Carlo errors of a difference of two means; the ends of intervals have up to three times
# that of the mean
_ERRORS = {
    **dict.fromkeys(("mean", "value", "sd", "u"), 7.0),
    **dict.fromkeys(("median", "q16", "q84", "q025", "q975"), 21.0),
    **dict.fromkeys(("limit_68", "limit_95", "upper_95"), 21.0),
}
_ESTIMATES = (("mean", "sd"), ("value", "u"), ("mean", "u"))
_STATED = {
    *("status", "statuses", "kind", "title", "schema", "formula", "unit", "meaning", "campaign"),
    *("run", "body", "error", "prior", "stated", "prior_mean", "prior_sd", "true", "seed", "n_obs"),
}  # that no draw decides
_NOTHING = "(not there)"  # what stands for an entry that only one file has
_NUMBER = re.compile(r"(?<!\w)[-−+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?")
_ESTIMATE = re.compile(rf"({_NUMBER.pattern})\s*[±+]\s*({_NUMBER.pattern})")
_WIDTH = 80  # characters of a difference that are shown


@dataclass(frozen=True)
class Difference:
    """where : line or key, or `WHOLE`.  before, now : as the report has it, as it was
    recomputed, "" of what no line can show.  wrong : or else it was not compared.
    """

    where: str
    before: str
    now: str
    wrong: bool = True

    def __str__(self) -> str:
        if not (self.before or self.now):
            return f"{self.where}: differs from what is recomputed"
        return f"{self.where}: '{self.before}', recomputed '{self.now}'"


@dataclass(frozen=True)
class Entry:
    """What two JSON files have at one place.

    tolerance : by how much it may differ where not everything is the same; None where nobody
        knows.  sd : of an estimate, 0 for everything else.
    """

    where: str
    before: Any
    now: Any
    tolerance: float | None
    sd: float = 0.0

    @property
    def change(self) -> float:
        """0 where both are the same, inf for what is no number."""
        if not (is_number(self.before) and is_number(self.now)):
            same = self.before == self.now and type(self.before) is type(self.now)
            return 0.0 if same else math.inf
        change = abs(self.before - self.now)
        return change if change > _SAME * max(abs(self.before), abs(self.now)) else 0.0


def differences(files: Mapping[str, Pair], *, same_versions: bool) -> dict[str, list[Difference]]:
    """What differs in each of the files of a report.

    same_versions : whether all packages are those that the report was made with.
    """
    results = {name: _of_json(*pair) for name, pair in files.items() if name.endswith(".json")}
    every = [entry for entries in results.values() for entry in entries]
    same = [entry.before == entry.now for entry in every if isinstance(entry.now, float)]
    exact = same_versions and sum(same) >= 0.9 * len(same)
    near = all(entry.change <= _SAME_DRAWS * entry.sd for entry in every if entry.sd)
    found: dict[str, list[Difference]] = {}
    for name, (before, now) in files.items():
        if before == now:
            found[name] = []
        elif name in results:
            found[name] = list(_of_entries(results[name], exact=exact))
        elif name.endswith((".md", ".html", ".csv")):
            texts = (data.decode("utf-8", "replace").splitlines() for data in (before, now))
            found[name] = list(_of_lines(*texts, exact=exact, near=near))
        else:
            found[name] = [Difference(WHOLE, "", "", exact)]
    return found


def is_number(value: object) -> bool:
    """A number of JSON, but for those that are too large to be one of ours."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e300


def estimate_in(node: object) -> tuple[float, float] | None:
    """The value of an estimate and its standard deviation, or standard uncertainty; None where
    `node` is none.
    """
    if isinstance(node, dict):
        for value, spread in _ESTIMATES:
            if is_number(node.get(value)) and is_number(node.get(spread)):
                return float(node[value]), float(abs(node[spread]))
    return None


def short(value: object) -> str:
    """A value of JSON on a line."""
    text = f"{value:.10g}" if isinstance(value, float) else value
    return shorten(text if isinstance(text, str) else json.dumps(text), _WIDTH)


def entries_of(where: str, before: Any, now: Any, mcse: float | None = None) -> Iterator[Entry]:
    """Everything that stands in one of two decoded JSON values, or in both; where : their place.

    mcse : of an estimate, where these are its limits.
    """
    if isinstance(before, dict) and isinstance(now, dict):
        _, sd = estimate_in(now) or estimate_in(before) or (0.0, None)
        if is_number(now.get("mcse")):
            mcse = now["mcse"]
        elif sd is not None:
            mcse = sd / math.sqrt(_FEWEST)
        for name in dict.fromkeys([*before, *now]):
            place = f"{where}.{name}" if where else name
            old, new = before.get(name, _NOTHING), now.get(name, _NOTHING)
            if mcse is not None and name in _ERRORS:
                yield Entry(place, old, new, _ERRORS[name] * mcse, sd or 0.0)
            else:
                yield from entries_of(place, old, new, mcse if name == "limit" else None)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for i, (old, new) in enumerate(zip(before, now, strict=True)):
            yield from entries_of(f"{where}[{i}]", old, new)
    else:
        stated = _NOTHING in (before, now) or _STATED & {*re.findall(r"[^.\[\]]+", where)}
        yield Entry(where, before, now, 0.0 if stated else None)


def _of_json(before: bytes, now: bytes) -> list[Entry]:
    try:
        return list(entries_of("", json_of(before), json_of(now)))
    except ValueError as error:
        return [Entry(WHOLE, f"cannot be read ({error})", "a file that can be read", 0.0)]


def _of_entries(entries: list[Entry], *, exact: bool) -> Iterator[Difference]:
    for entry in entries:
        if entry.change > (0.0 if exact else entry.tolerance or 0.0):
            wrong = exact or entry.tolerance is not None
            yield Difference(entry.where, short(entry.before), short(entry.now), wrong)


def _of_lines(
    before: list[str], now: list[str], *, exact: bool, near: bool
) -> Iterator[Difference]:
    """Lines with the same words belong together, whatever their numbers.

    exact : whether all must be the same.  near : whether all estimates are, but for last digits;
    then the first page, up to what is folded, must have the same words, and its status always.
    """
    if len(before) > 4 * len(now) + 100:  # comparing takes a time that goes as their product
        yield Difference(WHOLE, f"{len(before)} lines", f"{len(now)} lines")
        return
    words, words_now = ([tuple(_NUMBER.split(line)) for line in lines] for lines in (before, now))
    matcher = difflib.SequenceMatcher(None, words, words_now, autojunk=False)
    first_page = next((i for i, line in enumerate(now) if "<details" in line), len(now))
    for tag, i, j, k, m in matcher.get_opcodes():
        if tag != "equal":
            bold = any(line.startswith("**") for line in (*before[i:j], *now[k:m]))  # the status
            wrong = exact or ((near or bold) and k < first_page)
            yield _shown(i, " / ".join(before[i:j]), " / ".join(now[k:m]), wrong)
            continue
        for at, old, new in zip(range(i, j), before[i:j], now[k:m], strict=True):
            pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
            if old != new and (exact or not all(_agree(*pair) for pair in pairs)):
                yield _shown(at, old, new, exact or not _estimates_agree(old, new, near=near))


def _estimates_agree(first: str, second: str, *, near: bool) -> bool:
    """Whether what stands as value ± uncertainty in two lines agrees within Monte-Carlo errors;
    near : within its last digit.
    """
    error = 0.0 if near else _ERRORS["mean"] / math.sqrt(_FEWEST)
    return all(
        _agree(x, y, error * abs(_value(new[1])))
        for old, new in zip(_ESTIMATE.findall(first), _ESTIMATE.findall(second), strict=False)
        for x, y in zip(old, new, strict=True)
    )


def _agree(first: str, second: str, error: float = 0.0) -> bool:
    """Whether two numbers differ by a thousandth, or a unit of the last digit, and `error`."""
    digits, _, power = second.partition("e")
    decimals = len(digits.replace(",", ".").partition(".")[2])
    last_digit = 10.0 ** (max(min(int(power or 0), 300), -300) - decimals)
    rounding = max(1e-3 * abs(_value(second)), 1.01 * last_digit)
    return abs(_value(first) - _value(second)) <= rounding + error


def _value(text: str) -> float:
    return float(text.replace("−", "-").replace(",", "."))


def _shown(line: int, first: str, second: str, wrong: bool) -> Difference:
    """Two long lines from a little before they differ."""
    at = next((i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a != b), 0)
    begin = max(at - _WIDTH // 2, 0) if max(len(first), len(second)) > _WIDTH else 0
    return Difference(f"line {line + 1}", short(first[begin:]), short(second[begin:]), wrong)
