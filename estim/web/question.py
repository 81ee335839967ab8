"""A question as it is asked on a page, and the arguments of the command that answers it.

What a person wrote is one argument together with its option (`--formula=...`), or stands behind
`--`: it can be no other option, and it is never the name of a file.  What is missing is said in a
sentence for the page (`InputError.rule`).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from estim.common import InputError, PhraseTable, later, phrase

KINDS = PhraseTable(
    {
        "formula": later("A curve"),
        "line": later("A straight line"),
        "mean": later("The mean of a column"),
    }
)
MODELS = (
    "line",
    "polynomial2",
    "exponential",
    "exponential + constant",
    "power",
    "gaussian",
    "gaussian + line",
    "lorentzian",
    "oscillation",
    "damped_oscillation",
    "logistic",
)
"""Models by name, for a click; `estim.curves` says what they are."""

OPTIONS = MappingProxyType(
    {  # field -> option of the command
        "formula": "--formula",
        "x": "--x",
        "y": "--y",
        "u_x": "--u-x",
        "u_y": "--u-y",
        "group": "--group",
        "window": "--window",
        "robust": "--robust",
        "data": "--kind",
        "title": "--title",
        "track": "--track",
        "sheet": "--sheet",
        "decimal": "--decimal",
        "known": "--value",
        "start": "--start",
        "low": "--low",
        "high": "--high",
    }
)
_DIALECT = ("sheet", "decimal")
_OF_KIND = MappingProxyType(
    {
        "formula": (
            "fit",
            ("formula", "x", "y", "u_x", "u_y", "window", "robust", "data", "title", "track"),
        ),
        "line": ("line", ("x", "y", "u_x", "u_y")),
        "mean": ("mean", ("y", "u_y", "group")),
    }
)
_NAMED = ("known", "start", "low", "high")  # one NAME = VALUE a line
_FLAGS = ("correlated", "jitter")
FIELDS = frozenset({"kind", "values", "joint", "runs", *OPTIONS, *_FLAGS})
_MOST = 4000  # characters of a field
_END = ("--format", "html", "--out", "report")


def fields_of(form: Iterable[tuple[str, object]]) -> dict[str, str]:
    """What was filled in, of the fields that there are; of several alike, a line each."""
    found: dict[str, str] = {}
    for name, value in form:
        if name in FIELDS and isinstance(value, str) and (text := value.strip()):
            if len(text) > _MOST:
                raise InputError(phrase("This is too long."), field=OPTIONS.get(name))
            found[name] = f"{found[name]}\n{text}" if name in found else text
    return found


def arguments_of(fields: Mapping[str, str], file: str, given: str, lang: str) -> list[str]:
    """Arguments of `estim` for a question about `file`, the stored name of a table or campaign.

    given : what a person calls it, the title of the report of a curve.

    Raises InputError where nothing was asked.
    """
    end = [*_END, *(("--lang", lang) if lang != "en" else ())]
    if file.endswith(".toml"):
        runs = [f"--run={run}" for run in fields.get("runs", "").splitlines()]
        return ["fit", file, *runs, *(["--joint"] if "joint" in fields else []), *end]
    kind = fields.get("kind", "formula")
    if kind not in _OF_KIND:
        raise InputError(phrase("Choose what you want to know."))
    command, options = _OF_KIND[kind]
    if kind == "formula" and "formula" not in fields:
        raise InputError(phrase("Write a formula, or choose a model."), field="--formula")
    said = [f"{OPTIONS[k]}={fields[k]}" for k in (*options, *_DIALECT) if k in fields]
    if kind == "formula":
        said += [f"{OPTIONS[key]}={text}" for key in _NAMED for text in _lines(fields.get(key, ""))]
        said += [f"--{key}" for key in _FLAGS if key in fields]
        if "title" not in fields and file.rpartition(".")[0] != given:
            said.append(f"--title={given}")
    return [command, file, *said, *end]


def arguments_of_propagation(fields: Mapping[str, str], lang: str) -> list[str]:
    """Arguments of `estim` for a formula of named values.  Raises InputError without a value, with
    which the formula would be the name of a file.
    """
    values = _lines(fields.get("values", ""))
    if "formula" not in fields or not values:
        raise InputError(phrase("Write a formula, and the value of each name in it."))
    end = [*_END, *(("--lang", lang) if lang != "en" else ())]
    return ["propagate", *end, "--", fields["formula"], *values]


def command_line(arguments: Iterable[str]) -> str:
    """What a person types for the same answer."""
    return shlex.join(["estim", *arguments])


def _lines(text: str) -> list[str]:
    """One NAME=VALUE a line, without blanks about the mark; several may stand on a line, parted by
    a semicolon.
    """
    parts = [part.strip() for part in re.split(r"[\n;]", text)]
    return [re.sub(r"\s*=\s*", "=", part, count=1) for part in parts if part]
