"""`estim verify` and `estim diff`: a report recomputed from its inputs, and two results side by
side.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from stat import S_ISDIR

import click

from estim.cli.machine import keep_result
from estim.cli.options import PATH, Real
from estim.cli.origin import ORIGIN, WITHOUT_EFFECT, Origin, read_origin
from estim.cli.terminal import NOT_OK, say
from estim.common import (
    EstimError,
    InputError,
    Json,
    behind,
    format_rounded,
    json_of,
    names_in,
    read_file,
    signed,
)
from estim.verification import WHOLE, Difference, Pair, compare_results, differences, only_estimate

_MOST_LISTED = 12  # differences of one kind that are listed one by one
# not compared: what needs an extra that may not be installed or depends on fonts and on the clock
_OWN_BYTES = (".pdf", ".nc", "times.csv")


@click.command()
@click.argument("report", type=PATH)
def verify(report: Path) -> None:
    """Recompute REPORT (its folder) from the inputs that it names, and list what differs.

    Reports of single runs in folders below are verified with it.  It lists files that were changed
    after they were written, inputs that are no longer the same, results that differ by more than
    the tolerances (docs/verifying.md), and what was not compared.  Exit code 0: everything that was
    compared agrees; 3: something does not.
    """
    try:
        folder = report if S_ISDIR(report.stat().st_mode) else report.parent
    except OSError as error:
        rule = f"cannot be read ({(error.strerror or str(error)).lower()})"
        raise InputError(rule, field="report", value=str(report)) from None
    if folder != report and not (folder / ORIGIN).is_file():
        rule = f"must be the folder of a report, or a file beside its {ORIGIN}"
        raise InputError(rule, field="report", value=str(report))
    origin = read_origin(folder)
    _check_command(origin, folder)
    place = _root_of(folder, origin)
    say(f"recomputing: {origin.line}")
    checks = _Checks()
    with tempfile.TemporaryDirectory() as temporary:
        trouble = _recompute(origin, Path(temporary), place)
        folder_now = Path(temporary) / origin.part
        if not trouble and not (folder_now / ORIGIN).is_file():
            trouble = "the command makes no such report"
        if trouble:
            checks.wrong.append(f"cannot be recomputed: {trouble}")
        else:
            _compare(folder, folder_now, checks)
    keep_result("verification", {"verified": not checks.wrong} | vars(checks))
    for line in checks.wrong:
        say(line)
    rest = f"; not compared: {', '.join(_first(checks.aside))}" if checks.aside else ""
    if checks.wrong:
        say(f"not verified: {folder}{rest}")
        sys.exit(NOT_OK)
    compared = ", ".join(_first(checks.compared))
    say(f"verified: {folder} follows from its inputs; compared: {compared}{rest}")


@dataclass(frozen=True)
class _Checks:
    """wrong : what does not hold, in lines.  compared, aside : files, and parts of them, that were
    compared and that were not.
    """

    wrong: list[str] = field(default_factory=list)
    compared: list[str] = field(default_factory=list)
    aside: list[str] = field(default_factory=list)


def _check_command(origin: Origin, folder: Path) -> None:
    """Raises InputError unless the command is one that makes a report, without any option that a
    report never names.

    The origin may come from elsewhere: such options choose places and processes, and change no
    number.
    """
    group = click.get_current_context().find_root().command
    assert isinstance(group, click.Group)
    command = group.commands.get((origin.command or [""])[0])
    words = origin.command[1:]
    if command is not None and all(word.isprintable() and len(word) <= 4096 for word in words):
        options = {parameter.name for parameter in command.params}
        with contextlib.suppress(click.ClickException):
            values = command.make_parser(click.Context(command)).parse_args(list(words))[0]
            # and no --help, which click adds
            if "formats" in options and values.keys() <= options - WITHOUT_EFFECT:
                return
    raise InputError(
        "must name a command that makes a report, and no place, processes or --resume",
        field="command",
        value=origin.line,
        file=folder / ORIGIN,
    )


def _root_of(folder: Path, origin: Origin) -> Path:
    """The folder in which all inputs are found under their names: this one, or the nearest above
    the report.  Raises InputError.
    """
    working_folder = Path.cwd()
    for place in (working_folder, *folder.resolve().parents):
        if all(os.path.exists(place / path) for path in origin.inputs):
            return place
    missing = next(path for path in origin.inputs if not os.path.exists(working_folder / path))
    raise InputError(
        "cannot be found under this name, in this folder or in one above the report",
        field="input",
        value=missing,
    )


def _recompute(origin: Origin, out: Path, place: Path) -> str:
    """Runs the command of the report again, silently; what kept it from being run, or ""."""
    group = click.get_current_context().find_root().command
    name, *words = origin.command
    with contextlib.chdir(place), contextlib.redirect_stdout(io.StringIO()):
        try:
            group.main([name, "--out", str(out), *words], prog_name="estim", standalone_mode=False)
        except SystemExit as ended:  # a result that is not ok has a report all the same
            return "" if ended.code in (None, 0, NOT_OK) else f"exit code {ended.code}"
        except (EstimError, click.ClickException) as error:
            return str(error)
    return ""


def _compare(folder: Path, folder_now: Path, checks: _Checks) -> None:
    """Every report that the command makes there and below."""
    parts = sorted(path.parent.relative_to(folder_now) for path in folder_now.rglob(ORIGIN))
    before, now = (
        {part: read_origin(root / part, within=root) for part in parts}
        for root in (folder, folder_now)
    )
    inputs, inputs_now = (
        {entry for origin in origins.values() for entry in origin.inputs.items()}
        for origins in (before, now)
    )
    for path in sorted({path for path, _ in inputs ^ inputs_now}):
        checks.wrong.append(
            f"changed: the input {path} is not the one that the report was made from"
        )
    versions, versions_now = before[Path()].versions, now[Path()].versions
    for package, stated in versions.items():
        if (present := versions_now.get(package)) != stated:
            say(f"note: made with {package} {stated}, recomputed with {present or 'none'}")
    files: dict[str, Pair] = {}
    for part in parts:
        outputs = before[part].outputs
        for name, digest in outputs.items():
            label = (part / name).as_posix()
            old, new = (read_file(root / label, within=root) for root in (folder, folder_now))
            if old is None:
                checks.wrong.append(f"changed: {label} is missing")
                continue
            if hashlib.sha256(old).hexdigest() != digest:
                checks.wrong.append(f"changed: {label} is not as it was written")
            if name.endswith(_OWN_BYTES):
                checks.aside.append(label)
            elif new is None:
                checks.wrong.append(f"{label}: is not made any more")
            else:
                files[label] = (old, new)
        # figures may have been made smaller since
        checks.wrong.extend(
            f"{(part / name).as_posix()}: is made now, and {ORIGIN} does not name it"
            for name in now[part].outputs
            if name not in outputs and not name.endswith((*_OWN_BYTES, ".png"))
        )
        unnamed = _present(folder, part) - {ORIGIN, *outputs}
        checks.aside.extend((part / name).as_posix() for name in sorted(unnamed))
    for label, found in differences(files, same_versions=versions == versions_now).items():
        _tell(label, found, checks)


def _present(folder: Path, part: Path) -> set[str]:
    """Files that stand in a report; what its origin does not name may come from elsewhere."""
    names = (
        f"{below}{name}"
        for below in ("", "figures/", "tables/")
        for name in names_in(folder / part / below, within=folder)
    )
    return {name for name in names if not os.path.isdir(folder / part / name)}


def _tell(label: str, found: Sequence[Difference], checks: _Checks) -> None:
    """What differs in one file."""
    checks.wrong.extend(_first([f"{label}, {one}" for one in found if one.wrong]))
    aside = [one for one in found if not one.wrong]
    if aside and aside[0].where == WHOLE:
        checks.aside.append(label)
        return
    checks.compared.append(label)
    if aside:
        names = [one.where.rpartition(".")[2].partition("[")[0] for one in aside]
        words = ", ".join(_first(list(dict.fromkeys(names))))
        checks.aside.append(f"of {label} {len(aside)} entries ({words})")
    for one in aside if label.endswith(".md") else ():
        say(f"not compared: {label}, {one}")


@click.command()
@click.argument("first", metavar="FIRST|VALUE")
@click.argument("second", metavar="SECOND|VALUE")
@click.option(
    "--r", type=Real(-1.0, 1.0), help="Correlation of the errors of two values.  [default: 0]"
)
def diff(first: str, second: str, r: float | None) -> None:
    """Compare two values, "9.81(2)" and "9.79(3)", or the results of two analyses, FIRST and SECOND
    (folders, or files result.json).

    Of two analyses it lists inputs, settings and versions, then the shift of each estimate in
    standard deviations of the first.  Of two values, one of which may be the result that has only
    one, it tells the difference, its uncertainty and E_n (ISO 13528).
    """
    result, other_result = map(_result, (first, second))
    if result is None or other_result is None:
        from estim.means import compare_values

        two = compare_values(
            first if result is None else only_estimate(result),
            second if other_result is None else only_estimate(other_result),
            r=r or 0.0,
        )
        keep_result("difference", two)
        for line in str(two).splitlines():
            say(line)
        return
    if r is not None:
        raise InputError("is for two values, not for two analyses", field="--r", value=r)
    pair = compare_results(result, other_result)
    keep_result("comparison", pair)
    if result == other_result:
        say("the results are the same")
        return
    lines = [
        f"{row.name}: {_quoted(row.first)} -> {_quoted(row.second)}{behind(row.unit)}, "
        f"moved by {signed(f'{row.shift:+.2f}')} sd"
        for row in pair.estimates
    ]
    for line in (*_first(pair.inputs), *_first(lines)):
        say(line)
    for what, names in (("the first alone has", pair.lost), ("the second alone has", pair.gained)):
        if names:
            say(f"{what}: {', '.join(_first(names))}")


def _quoted(estimate: tuple[float, float]) -> str:
    value, sd = estimate
    return f"{format_rounded(value, 0.1 * sd)} ± {format_rounded(sd, 0.1 * sd)}"


def _first(lines: Sequence[str]) -> list[str]:
    """The first of many, and how many more there are."""
    more = len(lines) - _MOST_LISTED
    return [*lines[:_MOST_LISTED], *([f"and {more} more"] if more > 0 else [])]


def _result(text: str) -> Json | None:
    """None for a value: what no file is called, and begins with a number.  Raises InputError where
    there is no result.
    """
    if not os.path.exists(text) and text.lstrip(" +-−(.")[:1].isdigit():
        return None
    file = Path(text) / "result.json" if os.path.isdir(text) else Path(text)
    data = read_file(file)
    if data is None:
        raise InputError("cannot be found", field="result", value=str(file))
    try:
        record = json_of(data)
    except ValueError:
        record = None
    if not isinstance(record, dict) or not str(record.get("schema", "")).startswith("estim-"):
        raise InputError("must be a result.json of estim", field="result", value=str(file))
    return record
