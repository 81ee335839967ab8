"""What an example of a peer is: the lines of estim that solve it, the peer's numbers, and how far
apart the two may be.

An example is a function of one file `of_PEER.py` whose lines are those that a user of estim writes;
`example(...)` puts it in the list.  It returns a fit, or name -> (value, standard deviation).  The
peer's numbers are either printed in its documentation (`printed`) or those of the peer itself, run
by `peer` and kept in `numbers.toml`.
"""

from __future__ import annotations

import inspect
import math
import textwrap
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
DATA = HERE / "data"
Numbers = Mapping[str, tuple[float, float]]
EXAMPLES: list[Example] = []
VALUE, SPREAD = 0.01, 0.01  # how exactly a search ends: in standard deviations, and of one of them


@dataclass(frozen=True)
class Example:
    """An example and how it is judged.

    peer, page : whose it is, and where it stands in its documentation or repository.
    needs : what it asks of a program, in words.
    solve : the lines of estim.  peer_run : the peer's, or None.
    printed : name -> (value, standard deviation) as printed, "" for one that is not.
    within : how far apart values may be, in the peer's standard deviations; spread: how far the
        ratio of the standard deviations may be from 1.  Half a unit of the last printed digit is
        added to both.
    why : the reason where the two differ, in one or two sentences.
    """

    peer: str
    page: str
    needs: str
    solve: Callable[[], Any]
    peer_run: Callable[[], Numbers] | None = None
    printed: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    within: float = VALUE
    spread: float = SPREAD
    why: str = ""
    slow: bool = False

    @property
    def name(self) -> str:
        return f"{self.peer}_{self.solve.__name__}"

    def lines(self) -> str:
        """The body of `solve` without its docstring and its last line, the return."""
        body = inspect.getsource(self.solve).split("\n")
        first = next(i for i, line in enumerate(body) if line.startswith("def ")) + 1
        return textwrap.dedent("\n".join(body[first:])).strip()

    def numbers(self) -> Numbers:
        """What estim says: name -> (value, standard deviation)."""
        return numbers_of(self.solve())


def example(peer: str, page: str, needs: str, **rest: Any) -> Callable[[Any], Any]:
    """Put the function below in the list of examples."""

    def enlist(solve: Callable[[], Any]) -> Callable[[], Any]:
        EXAMPLES.append(Example(peer, page, needs, solve, rest.pop("run", None), **rest))
        return solve

    return enlist


def numbers_of(solved: Any) -> Numbers:
    """Of a fit its parameters and what follows from them; anything else is what it says."""
    if isinstance(solved, Mapping):
        return solved
    derived = {name: (item.value, item.sd) for name, item in solved.derived.items()}
    return {name: (solved.values[name], solved.sds[name]) for name in solved.names} | derived


def stored() -> dict[str, dict[str, Any]]:
    """Name of the example -> the numbers of the peer that were kept, with "by", its version."""
    path = HERE / "numbers.toml"
    return tomllib.loads(path.read_text()) if path.exists() else {}


@dataclass(frozen=True)
class Difference:
    """One number of both: value, its difference in the peer's standard deviations and how large it
    may be; the ratio of the standard deviations, estim's over the peer's, and how far it may be
    from 1.  NaN where the peer says none.
    """

    name: str
    ours: tuple[float, float]
    theirs: tuple[float, float]
    shown: tuple[str, str]
    apart: float
    apart_limit: float
    ratio: float
    ratio_limit: float

    @property
    def agrees(self) -> bool:
        spread = self.shown[1] == "" or abs(self.ratio - 1.0) <= self.ratio_limit
        return spread and self.apart <= self.apart_limit


def differences(item: Example, ours: Numbers, kept: Mapping[str, Any]) -> list[Difference]:
    """Each number that the peer states, beside estim's."""
    shown = {name: (value, sd) for name, (value, sd) in item.printed.items()} or {
        name: (f"{value[0]:.8g}", f"{value[1]:.6g}")
        for name, value in kept.get("values", {}).items()
    }
    found = []
    for name, (value, sd) in shown.items():
        u = float(sd) if sd else ours[name][1]
        apart = abs(ours[name][0] - float(value)) / u
        ratio = ours[name][1] / float(sd) if sd else math.nan
        found.append(
            Difference(
                name,
                ours[name],
                (float(value), u),
                (value, sd),
                apart,
                item.within + half_digit(value) / u,
                ratio,
                item.spread + (half_digit(sd) / u if sd else 0.0),
            )
        )
    return found


def half_digit(text: str) -> float:
    """Half a unit of the last digit that is written."""
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)
