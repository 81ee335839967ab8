"""Mutated campaigns through the command line, judged by `campaign_oracle`: `trial(seed, folder)`
makes one, runs it and says what is wrong.

A command is stopped where it would begin to fit, and the problem that it is about to fit is
compared with what the oracle reads in the same files; one in `FULL` goes on to its end with the
fewest steps, and its report and result.json are compared.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
import os
import random
import re
import shutil
import sys
import tomllib
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import campaign_oracle as oracle
import fuzzing

from estim import campaign as campaigns
from estim import line as lines_page
from estim.cli import commands as cli
from estim.fitting import posterior_mode
from estim.studies import reanalysis

ROOT = Path(__file__).resolve().parents[1]
REPLICA = ROOT / "data" / "replica"
FULL = 60  # one command in so many samples and writes its report
COMMANDS = ("fit", "line", "energy", "reanalyse", "calibrate", "simulate", "import")
_DISK_RUNS = ("heavy-04", "light-03")


def _disk() -> bytes:
    """The replica with two of its runs."""
    head, *runs = (REPLICA / "campaign.toml").read_text().split("[[runs]]\n")
    last, _, line = runs[-1].partition("[line]")
    kept = [
        run for run in (*runs[:-1], last) if any(f'name = "{name}"' in run for name in _DISK_RUNS)
    ]
    return (
        head.replace('published = "../paper/published.toml"\n', "")
        + "".join(f"[[runs]]\n{run}" for run in kept)
        + "[line]"
        + line
    ).encode()


OWN = b"""title = "Two decays"
kind = "measured"
[curve]
expression = "A*exp(-x/tau) + c"
x = {column = "t_s", name = "time", unit = "s"}
y = {column = "x_m", name = "level", unit = "m"}
u_y = "0.010(1)"
[curve.parameters]
A = {prior = "normal", mean = 1.0, sd = 0.3, unit = "m"}
tau = {start = 2.0, low = 0.1, high = 30.0, unit = "s", meaning = "time constant"}
c = {value = "0.10(2)", unit = "m"}
[[runs]]
name = "one"
file = "one.csv"
[[runs]]
name = "two"
file = "two.csv"
u_y = 0.02
"""


def _decay(tau: float, seed: int) -> bytes:
    source = random.Random(seed)
    rows = [
        f"{0.25 * n:.3f},{math.exp(-0.25 * n / tau) + 0.1 + source.gauss(0, 0.01):.4f}"
        for n in range(24)
    ]
    return ("# a level that falls\nt_s,x_m\n" + "\n".join(rows) + "\n").encode()


FILES: dict[str, dict[str, bytes]] = {
    "disk": {"c.toml": _disk(), "theta_min.csv": (REPLICA / "theta_min.csv").read_bytes()}
    | {f"runs/{name}.csv": (REPLICA / "runs" / f"{name}.csv").read_bytes() for name in _DISK_RUNS},
    "own": {"c.toml": OWN, "one.csv": _decay(2.0, 1), "two.csv": _decay(3.0, 2)},
    "imported": {
        "c.toml": fuzzing.CAMPAIGN,
        "run.csv": fuzzing.RUN,
        "two.txt": fuzzing.TWO,
        "theta_min.csv": fuzzing.LINE,
    },
    "positions": {
        "c.toml": fuzzing.ROBUST,
        "run.csv": fuzzing.RUN,
        "two.txt": fuzzing.TWO,
        "theta_min.csv": fuzzing.LINE,
    },
    "speeds": {
        "c.toml": fuzzing.MODEL,
        "i.csv": fuzzing.IMPORTED,
        "two.txt": fuzzing.TWO,
        "theta_min.csv": fuzzing.LINE,
    },
    "curve": {"c.toml": fuzzing.CURVE, "i.csv": fuzzing.IMPORTED},
    "design": {
        "c.toml": (REPLICA / "design.toml")
        .read_bytes()
        .replace(b"../paper/published.toml", b"p.toml")
    },
    "export": {"c.txt": fuzzing.EXPORT},
    "video": {"c.trk": fuzzing.VIDEO},
    "archive": {"c.trz": fuzzing.BASES["trz"][0]},
}
MOTIONS = ("disk", "imported", "positions", "speeds")
HOSTILE = (
    "\x1b[2J\x1b]0;x\x07",
    "a\nb",
    "a\rb",
    "\u202eevil\u2066",
    "<script>alert(1)</script>",
    "| a | b |",
    "[x](http://a.b)",
    "![x](x)",
    "`rm -rf`",
    "a\x00b",
    "\u2028",
    "\x85",
    "$\\frac{1}{0}$",
    "a_b_c_",
    "é" * 200,
    "\ud7ff",
    "../../etc/passwd",
    "/dev/zero",
    "/proc/kmsg",
    "con",
    "",
    " ",
    "x" * 5000,
    "{{7*7}}",
    "%s%n",
    "\u0430",
    "print",
    "__class__",
    "\x0b\x0c\x1c",
)
CELLS = (
    "",
    "nan",
    "inf",
    "1e999",
    "-",
    "x",
    "1,5",
    "1 000",
    "0x1",
    "1_0",
    "٣",
    "1e400",
    "−1",
    "1.2.3",
    '"1.5"',
    '"',
    "#1",
    "1e99",
    "1e-320",
    "0",
)
# but for the return, none ends a line of a table
NO_ENDS = ("\u2028", "\x85", "\x0b", "\x0c", "\x1c", "\r", "")
VALUES: tuple[Any, ...] = (
    0,
    -1,
    1,
    1e-320,
    1e-99,
    1e99,
    1e300,
    10**400,
    float("inf"),
    float("nan"),
    True,
    [],
    {},
    [1, 2],
    "1.0(1)",
    "1.0(0)",
    "1.0 +/- 0.1",
    "1.0±.1",
    "4.0 +/- nan",
    "1,5",
    "1.5(1,5)",
    "1_000",
    "0x10",
    "1e5",
    "1e-3(1)",
    "(1.0 +/- 0.1)e-3",
    "1.0(1)e-2",
    " 2.0(3) ",
    "2.0( 3)",
    "2.0 (3)",
    "1.0(12)",
    "10(12)",
    ".5(1)",
    "5.(1)",
    "1.0+-0.1",
    "1.0 +/- -0.1",
    "-0.0(1)",
    "١.٠(١)",
    "1.0(1)(2)",
    "1.0 ± 10%",
    "12.0(1.5)",
    "12(1.5)",
    "nan(1)",
    "1e400",
    "1.0(1)e400",
    {"prior": "uniform", "low": 0.0, "high": 1.0},
    {"prior": "uniform", "low": 1.0, "high": 0.0},
    {"prior": "normal", "mean": 1.0, "sd": 0.2},
    {"prior": "half-normal", "scale": 0.01},
    {"prior": "log-normal", "median": 0.1, "log_sd": 0.5},
    {"prior": "log-normal", "median": 0.1, "log_sd": 1e99},
    {"prior": "truncated-normal", "mean": 0.5, "sd": 0.3, "low": 0.0},
    {"prior": "normal", "mean": 1.0, "sd": 0.0},
    {"prior": "beta"},
    {"prior": 3},
)


# a campaign as tables, changed and written again


def written(table: dict[str, Any]) -> str:
    """TOML of a campaign's tables: plain keys, then tables, then arrays of tables."""
    return "\n".join(_lines(table, ())) + "\n"


def _lines(table: dict[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    nested = {
        k: v
        for k, v in table.items()
        if len(path) < 2 and ((isinstance(v, dict) and "prior" not in v) or _tables(v))
    }
    for key, value in table.items():
        if key not in nested:
            yield f"{_word(key)} = {_inline(value)}"
    for key, value in nested.items():
        name = ".".join(map(_word, (*path, key)))
        for one in value if isinstance(value, list) else [value]:
            yield f"[[{name}]]" if isinstance(value, list) else f"[{name}]"
            yield from _lines(one, (*path, key))


def _tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _word(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _inline(key)


def _inline(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return (
            '"'
            + "".join(
                m if m.isprintable() and m not in '"\\' else f"\\u{ord(m):04X}" for m in value
            )
            + '"'
        )
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_word(k)} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return repr(value)


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items: list[tuple[Any, Any]] = (
        list(value.items())
        if isinstance(value, dict)
        else list(enumerate(value))
        if isinstance(value, list)
        else []
    )
    return ([path] if path else []) + [
        found for key, inner in items for found in _paths(inner, (*path, key))
    ]


def change_tables(data: bytes, source: random.Random) -> bytes:
    """A key lost, doubled, renamed or moved, or a value replaced."""
    tables = tomllib.loads(data.decode())
    for _ in range(source.choice((1, 1, 1, 2, 3))):
        paths = _paths(tables)
        if not paths:
            break
        path = source.choice(paths)
        above = tables
        for step in path[:-1]:
            above = above[step]
        key = path[-1]
        match source.randrange(10):
            case 0:
                del above[key]
            case 1 if isinstance(above, dict):
                above[
                    source.choice(("x", "phi_rad", "u_y", "prior", key.upper(), key + "_", "a b"))
                ] = above.pop(key)
            case 2 if isinstance(above, list):
                above.append(above[key])
            case 3:
                above[key] = source.choice(HOSTILE)
            case 4 if isinstance(above[key], int | float) and not isinstance(above[key], bool):
                number = above[key]
                above[key] = source.choice(
                    (
                        -number,
                        number * 10.0 ** source.randrange(-6, 7),
                        str(number),
                        f"{number}(1)",
                        f"{number} +/- 0.1",
                    )
                )
            case 5 if isinstance(above[key], str) and re.match(r"[-\d.]+\(", above[key]):
                above[key] = re.sub(r"\d", lambda m: str(source.randrange(10)), above[key])
            case _:
                above[key] = source.choice(VALUES)
    return written(tables).encode()


def change_cells(data: bytes, source: random.Random) -> bytes:
    """Cells, rows and columns of a table lost, doubled, swapped or replaced, comments and ends of
    lines put in.
    """
    lines = data.decode().split("\n")
    rows = [i for i, line in enumerate(lines) if line and not line.startswith("#")]
    for _ in range(source.choice((1, 1, 2, 4))):
        i = source.choice(rows[: 1 + len(rows)])
        cells = lines[i].split(",")
        k = source.randrange(len(cells))
        match source.randrange(12):
            case 0:
                cells[k] = source.choice(CELLS)
            case 1:
                del cells[k]
            case 2:
                cells.append(source.choice(("", "1", "x")))
            case 3:
                lines[i] = lines[source.choice(rows)]
                continue
            case 4:
                lines[i] = (
                    "# "
                    + source.choice(HOSTILE[5:]).replace("\n", " ")
                    + source.choice(NO_ENDS)
                    + lines[i]
                )
                continue
            case 5:
                j = source.choice(rows)
                lines[i], lines[j] = lines[j], lines[i]
                continue
            case 6:
                lines = [
                    ",".join((line, "_n" if m == rows[0] else str(m))) if m in rows else line
                    for m, line in enumerate(lines)
                ]
                continue
            case 7:
                lines = [
                    line.replace(".", ",") if m in rows else line for m, line in enumerate(lines)
                ]
                continue
            case 8:
                lines = [
                    line.replace(",", source.choice((";", "\t"))) if m in rows else line
                    for m, line in enumerate(lines)
                ]
                continue
            case 9:
                lines = [line + "\r" for line in lines]
                continue
            case _:
                numbers = (-1, 0.5, 2, 10, 1e3, 1e-3, source.uniform(-1, 1))
                cells[k] = (
                    str(source.choice(numbers))
                    if i != rows[0]
                    else source.choice(("t_s", "x_m", "v_m_s", "_x", "y", "1", "X_M"))
                )
        lines[i] = ",".join(cells)
    return "\n".join(lines).encode(errors="surrogatepass")


def _again(text: str, source: random.Random) -> str:
    """Another measured value, or the same kind of value in another notation: sound ones for the
    most part.
    """
    value = source.uniform(0.8, 1.25) * (float(re.split(r"[( ±+]", text.lstrip("+-"))[0]) or 1.0)
    places = source.randrange(6)
    number, u = f"{value:.{places}f}", source.randrange(1, 40)
    size = f"{u * 10.0**-places:.{places}f}"
    chosen = (
        f"{number}({u})",
        f"{number}({u})",
        f"{number}({size})" if places else f"{number}({u}.0)",
        f"{number} +/- {size}",
        f"{number}+/-{size}",
        f"{number} ± {size}",
        f" {number}({u}) ",
        f"{number}({u})e0",
        f"{value:.3e}",
        f"+{number}",
        f"{value * 1e3:.{places}f}({u})e-3",
        number,
        f"{number}e0 +/- {size}",
    )
    return source.choice(chosen)


def _reworded(line: str, source: random.Random) -> str:
    if source.random() < 0.3:
        return re.sub(r'"([-+]?\d[^"]*\))"', lambda m: f'"{_again(m[1], source)}"', line)
    if source.random() < 0.1:
        return re.sub(
            r"(?<== )(\d+\.\d+)(?= *[,}\n]|$)",
            lambda m: f"{float(m[1]) * source.uniform(0.8, 1.25):.6g}",
            line,
        )
    return line


def reword(data: bytes, source: random.Random) -> bytes:
    """Stated values of a campaign said anew; comments, blanks and ends of lines put in."""
    lines = data.decode().split("\n")
    for _ in range(source.choice((1, 2, 4))):
        i = source.randrange(len(lines))
        match source.randrange(8):
            case 0:
                lines[i] += source.choice(
                    ("  # as read", "  # \u202e", "\t", " # \u2028 = 1", "\r")
                )
            case 1:
                lines[i] = source.choice(("# x = 1", "", "   ")) + "\n" + lines[i]
            case _:
                lines = [_reworded(line, source) for line in lines]
    return "\n".join(lines).encode()


def remeasure(data: bytes, source: random.Random) -> bytes:
    """A table with other numbers, columns, comments and separators that all mean something."""
    rows = data.decode().split("\n")
    head = next(i for i, line in enumerate(rows) if line and not line.startswith("#"))
    comments, names = rows[:head], rows[head].split(",")
    cells = [line.split(",") for line in rows[head + 1 :] if line and not line.startswith("#")]
    for _ in range(source.choice((1, 2, 3))):
        match source.randrange(6):
            case 0:
                order = source.sample(range(len(names)), len(names))
                names, cells = [names[k] for k in order], [[row[k] for k in order] for row in cells]
            case 1:
                k = source.randrange(len(names) + 1)
                names, cells = (
                    [*names[:k], f"_{len(names)}", *names[k:]],
                    [[*row[:k], source.choice(("", "x", "7")), *row[k:]] for row in cells],
                )
            case 2:
                cells = (
                    [row for row in cells if source.random() < 0.95] if len(cells) > 12 else cells
                )
            case 3:
                k = source.randrange(len(names))
                if names[k] != "t_s" and not names[k].startswith("_"):
                    as_read = f".{source.randrange(3, 8)}{source.choice('fe')}"
                    cells = [
                        [
                            *row[:k],
                            format(float(row[k]) * source.uniform(0.97, 1.03), as_read),
                            *row[k + 1 :],
                        ]
                        for row in cells
                    ]
            case 4:
                comments = [
                    *comments,
                    "# "
                    + source.choice(
                        ("t,x", "0.1,0.2", "warning: <b>x</b>", "caf\u00e9", "\u2028 1,2")
                    ),
                ]
            case _:
                cells = [[source.choice(("", " ")) + cell for cell in row] for row in cells]
    mark, end = source.choice((",", ",", ";", "\t")), source.choice(("\n", "\n", "\r\n"))
    return end.join([*comments, *(mark.join(row) for row in (names, *cells)), ""]).encode()


@dataclass
class Case:
    """Files of a mutated campaign and the command for them."""

    seed: int
    base: str
    files: dict[str, bytes]
    words: list[str]
    full: bool
    changed: str = ""


def make(seed: int) -> Case:
    """The case of a seed."""
    source = random.Random(seed)
    command = source.choice((*COMMANDS[:5], "fit", "fit", "simulate", "import"))
    bases = {
        "simulate": ("design",),
        "import": ("export", "video", "archive"),
        "fit": ("disk", "disk", "own", "own", "curve", *MOTIONS),
    }
    bases |= {"calibrate": ("disk", "disk", "own", "imported"), "line": ("disk", *MOTIONS, "own")}
    base = source.choice(bases.get(command, ("disk",) * 12 + ("imported",) * 8 + ("own",)))
    files = dict(FILES[base])
    changed = ""
    if source.random() > 0.04:  # else sound
        changed = source.choice(list(files) if source.random() < 0.5 else [next(iter(files))])
        data = files[changed]
        how = source.random()
        if source.random() < 0.6 and changed == "c.toml" and base in ("disk", "own", "design"):
            data = reword(data, source)
            for table in [
                name for name in files if name.endswith(".csv") and source.random() < 0.4
            ]:
                files[table] = remeasure(files[table], source)
        elif source.random() < 0.5 and changed.endswith(".csv") and base in ("disk", "own"):
            data = remeasure(data, source)
        elif changed == "c.toml" and how < 0.75:
            data = change_tables(data, source)
        elif changed.endswith(".csv") and how < 0.8:
            data = change_cells(data, source)
        else:
            data = fuzzing.damage(data, source)
        files[changed] = data
    first = next(iter(files))
    words = [command, first]
    if command in ("simulate", "import"):
        words += ["--out", "out" if command == "simulate" else "out.csv"]
        if command == "import":
            words += ["--track", source.choice(HOSTILE[:5]) if source.random() < 0.1 else "A"]
            words += (
                ["--along", source.choice(("x", "fit", "-y", "30", "nan", "q"))]
                if source.random() < 0.5
                else []
            )
    else:
        words += ["--out", "out"]
        if command in ("fit", "energy", "calibrate") and source.random() < 0.4:
            words += ["--joint"]
        if command in ("fit", "energy", "reanalyse"):
            words += ["--max-steps", "50"]
        if command == "reanalyse":
            words += ["--jobs", "1"]
        if command == "calibrate":
            words += ["--simulations", "20", "--jobs", "1", "--what", "sbc"]
    full = (
        command in ("line", "fit", "energy")
        and base in ("disk", "own")
        and source.randrange(FULL) == 0
    )
    return Case(seed, base, files, words, full, changed)


# one case


class StoppedError(BaseException):
    """What would be fit, in place of fitting it."""

    def __init__(self, thing: Any) -> None:
        self.thing = thing


def _stop(thing: Any, *_: Any, **__: Any) -> None:
    raise StoppedError(thing)


@dataclass
class Outcome:
    """wrong : what must not be.  doubts : where oracle and estim do not agree whether a file means
    something.
    """

    case: Case
    code: int | None = None
    said: str = ""
    stopped: bool = False
    wrong: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def trial(seed: int, folder: Path) -> Outcome:
    """One case, run in the empty `folder`."""
    case = make(seed)
    for name, data in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    outcome = Outcome(case)
    loaded: list[Any] = []
    load = campaigns.load_campaign

    def remembered(path: Path, **choices: Any) -> Any:
        loaded.append(load(path, **choices))
        return loaded[-1]

    out, err, before = io.StringIO(), io.StringIO(), Path.cwd()
    thing: Any = None
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(campaigns, "load_campaign", remembered))
        if not case.full:
            stack.enter_context(mock.patch.object(posterior_mode, "fit_least_squares", _stop))
            stack.enter_context(mock.patch.object(posterior_mode, "fit_optimum", _stop))
            for module in (lines_page, reanalysis):
                stack.enter_context(mock.patch.object(module, "analyse_line", _stop))
        stack.enter_context(mock.patch.object(sys, "argv", ["estim", *case.words]))
        stack.enter_context(warnings.catch_warnings())
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        os.chdir(folder)
        try:
            cli.main()
        except SystemExit as error:
            outcome.code = 0 if error.code is None else int(error.code)
        except StoppedError as error:
            outcome.stopped, thing = True, error.thing
        except Exception as error:  # what this is looking for
            last = traceback.extract_tb(error.__traceback__)[-1]
            outcome.wrong.append(
                f"traceback: {type(error).__name__}: {str(error)[:100]} "
                f"({Path(last.filename).name}:{last.lineno})"
            )
        finally:
            os.chdir(before)
    outcome.said = err.getvalue()
    _judge_outputs(outcome, out.getvalue(), err.getvalue(), folder)
    if not outcome.wrong:
        _judge_numbers(outcome, loaded[0] if loaded else None, thing, folder)
    return outcome


def _judge_outputs(outcome: Outcome, out: str, err: str, folder: Path) -> None:
    wrong = outcome.wrong
    if not outcome.stopped and not wrong and outcome.code not in (0, 2, 3):
        wrong.append(f"exit code {outcome.code}")
    if outcome.code == 2:
        if err.count("\n") != 1 or not err.startswith("error: "):
            wrong.append(f"not one line: {err[:200]!r}")
        if not any(name in err for name in (*outcome.case.files, "--", "out")):
            wrong.append(f"names no file: {err[:200]!r}")
    if "Traceback" in err:
        wrong.append("Traceback")
    for what, text in (("stdout", out), ("stderr", err)):
        if found := oracle.raw_marks(text):
            wrong.append(f"{what} has {found}")
    for path in sorted(folder.rglob("report.md")) + sorted(folder.glob("out.csv")):
        if found := oracle.raw_marks(path.read_bytes().decode()):
            wrong.append(f"{path.name} has {found}")
        if "<script" in path.read_text():
            wrong.append(f"{path.name} has raw HTML")
    for path in folder.rglob("*"):
        if oracle.raw_marks(path.name):
            wrong.append(f"file name {path.name!r}")


def _judge_numbers(outcome: Outcome, loaded: Any, thing: Any, folder: Path) -> None:
    """What estim is about to use against what the oracle reads."""
    case = outcome.case
    if case.base not in ("own", *MOTIONS):
        return
    accepted = outcome.stopped or outcome.code in (0, 3)
    try:
        document = oracle.document(case.files["c.toml"])
        runs = oracle.runs_of(document)
        tables = {
            run.get("name"): oracle.run_table(folder, run, motion=case.base in MOTIONS)
            for run in runs
        }
        said = (
            {run.get("name"): oracle.quantities(document, run) for run in runs}
            if case.base in MOTIONS
            else {}
        )
        series = (
            case.words[0] in ("line", "reanalyse")
            and "line" in document
            and document["line"].get("file") == "theta_min.csv"
        )
        line = oracle.table(case.files["theta_min.csv"]) if series else None
    except oracle.MalformedError as error:
        if accepted:
            outcome.doubts.append(f"accepted though the oracle says malformed: {str(error)[:100]}")
        return
    except (TypeError, ValueError, AttributeError) as error:
        if accepted:
            outcome.doubts.append(
                f"accepted though the oracle cannot read it: {type(error).__name__} "
                f"{str(error)[:100]}"
            )
        return
    if not accepted:
        if loaded is None:
            outcome.doubts.append(
                "refused though the oracle reads it: "
                + re.sub(r"\d+", "N", outcome.said.partition(": ")[2])[:110]
            )
        return
    for name, columns in tables.items():
        _same_table(outcome, loaded, name, columns)
    if hasattr(thing, "theta_min") and line is not None:
        for column, used in (("phi_deg", thing.phi), ("theta_min_deg", thing.theta_min)):
            _same(
                outcome,
                f"line {column}",
                [math.radians(v) for v in line.get(column, [])],
                list(map(float, used)),
            )
    elif hasattr(thing, "parameters"):
        (_same_motion if case.base in MOTIONS else _same_curve)(outcome, document, thing, said)
    if case.full and accepted:
        _same_result(outcome, document, tables, said, folder)


def _same(outcome: Outcome, what: str, expected: list[float], used: list[float]) -> None:
    if len(expected) != len(used) or any(
        not math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-300)
        for a, b in zip(expected, used, strict=True)
    ):
        outcome.wrong.append(f"{what}: oracle {expected[:4]}..., estim {used[:4]}...")


def _same_table(
    outcome: Outcome, loaded: Any, name: Any, columns: dict[str, list[float]] | None
) -> None:
    if columns is None or name not in loaded.tables:
        return
    used = loaded.tables[name].columns
    if not set(used) <= set(columns):
        outcome.wrong.append(f"{name}: columns {sorted(used)} for {sorted(columns)}")
        return
    for column in used:
        _same(outcome, f"{name}, column {column}", columns[column], list(map(float, used[column])))


def numbers_of(prior: Any) -> tuple[str, tuple[float, ...]]:
    """Of estim's record of a prior: its kind and numbers as the oracle gives them."""
    names = {
        "Normal": ("normal", "mean", "sd"),
        "TruncatedNormal": ("normal", "mean", "scale"),
        "Uniform": ("uniform", "low", "high"),
        "HalfNormal": ("half-normal", "scale"),
        "LogNormal": ("log-normal", "median", "log_sd"),
    }
    kind, *fields = names[type(prior).__name__]
    return kind, tuple(float(getattr(prior, name)) for name in fields)


def _same_stated(outcome: Outcome, what: str, stated: oracle.Stated, prior: Any) -> None:
    kind, used = numbers_of(prior)
    if kind != stated.kind.removeprefix("truncated-"):
        outcome.wrong.append(f"{what}: {stated} became {prior}")
    else:
        _same(outcome, what, list(stated.numbers), list(used))


def _same_motion(
    outcome: Outcome,
    document: dict[str, Any],
    problem: Any,
    said: dict[Any, dict[str, tuple[str, oracle.Stated]]],
) -> None:
    priors = {p.name: p.prior for p in problem.parameters}
    for run in problem.runs:
        for name, (where, stated) in said[run.name].items():
            used = run.arguments.get(name)
            if stated.kind == "exact":
                _same(
                    outcome,
                    f"{run.name}: {name}",
                    list(stated.numbers),
                    [used] if isinstance(used, float) else [],
                )
            elif used != name + where:
                outcome.wrong.append(f"{run.name}: {name} is {used}, not {name + where}")
            else:
                _same_stated(outcome, str(used), stated, priors[used])
        if "gamma" not in said[run.name]:
            _gamma_of_masses(outcome, document, run, priors)


def _gamma_of_masses(
    outcome: Outcome, document: dict[str, Any], run: Any, priors: dict[str, Any]
) -> None:
    """gamma = M_P/(M_D + M_P), with the uncertainties of two independent masses."""
    own = next(one for one in document["runs"] if one.get("name") == run.name)
    levels = [own, document.get("bodies", {}).get(own.get("body"), {}), document.get("shared", {})]
    if any(key in level for level in levels for key in ("mass_trailing_kg", "rho")):
        return
    disk, particle = (
        next((oracle.stated(level[key]) for level in levels if key in level), None)
        for key in ("mass_disk_kg", "mass_particle_kg")
    )
    if disk is None or particle is None or {disk.kind, particle.kind} - {"exact", "normal"}:
        return
    (d, u_d), (p, u_p) = ((*mass.numbers, 0.0)[:2] for mass in (disk, particle))
    value, u = p / (d + p), math.hypot(d * u_p, p * u_d) / (d + p) ** 2
    used = run.arguments["gamma"]
    expected = [value] if u == 0.0 else [value, u]
    found = [used] if isinstance(used, float) else list(numbers_of(priors[used])[1])
    if len(expected) != len(found) or any(
        not math.isclose(a, b, rel_tol=1e-9) for a, b in zip(expected, found, strict=True)
    ):
        outcome.wrong.append(f"gamma of the masses: oracle {expected}, estim {found}")


def _same_curve(outcome: Outcome, document: dict[str, Any], problem: Any, _: Any) -> None:
    priors = {p.name: p.prior for p in problem.parameters}
    for run in problem.runs:
        own = next(one for one in document["runs"] if one.get("name") == run.name)
        for name, value in {**document["curve"]["parameters"], **own.get("parameters", {})}.items():
            if name not in run.arguments:
                continue
            used = run.arguments[name]
            if isinstance(value, dict) and "start" in value and "prior" not in value:
                low, high = value.get("low"), value.get("high")
                if low is not None and high is not None and isinstance(used, str):
                    _same(
                        outcome,
                        name,
                        [float(low), float(high)],
                        [float(priors[used].low), float(priors[used].high)],
                    )
                continue
            try:
                stated = oracle.stated(
                    value["value"] if isinstance(value, dict) and "value" in value else value
                )
            except oracle.MalformedError:
                outcome.doubts.append(
                    f"accepted though the oracle says malformed: {name} = {value!r}"[:140]
                )
                continue
            if stated.kind == "exact":
                _same(
                    outcome,
                    f"{run.name}: {name}",
                    list(stated.numbers),
                    [used] if isinstance(used, float) else [],
                )
            elif isinstance(used, str):
                _same_stated(outcome, used, stated, priors[used])
            else:
                outcome.wrong.append(f"{run.name}: {name} = {value!r} became {used}")


def _same_result(
    outcome: Outcome,
    document: dict[str, Any],
    tables: dict[Any, Any],
    said: dict[Any, Any],
    folder: Path,
) -> None:
    """What result.json says was used: files by their digests, rows, stated values."""
    for path in sorted(folder.rglob("result.json")):
        result = json.loads(path.read_text())
        if result.get("schema") != "estim-result/1":
            continue
        provenance = result["provenance"]
        if (
            provenance["campaign_sha256"]
            != hashlib.sha256(outcome.case.files["c.toml"]).hexdigest()
        ):
            outcome.wrong.append("result.json: digest of the campaign")
        known = {hashlib.sha256(data).hexdigest() for data in outcome.case.files.values()}
        if not set(provenance["data_sha256"].values()) <= known:
            outcome.wrong.append("result.json: digests of the data")
        if result["title"] != document.get("title"):
            outcome.wrong.append("result.json: title")
        for name, run in result["runs"].items():
            rows = tables[name] and len(next(iter(tables[name].values())))
            left = sum(
                int(found[1]) for words in run["excluded"] if (found := re.match(r"(\d+) ", words))
            )
            if rows is not None and run["n_obs"] + left != rows:
                outcome.wrong.append(
                    f"result.json: {run['n_obs']} of {rows} rows and {run['excluded']}"
                )
            for quantity, (where, stated) in said.get(name, {}).items():
                if stated.kind == "normal":
                    used = result["parameters"][quantity + where]
                    if used["prior"] == "normal":
                        _same(
                            outcome,
                            f"result.json: {quantity}",
                            list(stated.numbers),
                            [used["prior_mean"], used["prior_sd"]],
                        )


def in_fresh_folder(seed: int, work: Path) -> Outcome:
    """`trial` in a folder of its own, removed afterwards."""
    folder = work / str(seed)
    folder.mkdir(parents=True)
    try:
        return trial(seed, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


Trial = Callable[[int, Path], Outcome]
