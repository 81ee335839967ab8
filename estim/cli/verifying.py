"""`estim verify` and `estim diff`: a report recomputed from its inputs, and two results side by side."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from estim.cli.crate import CRATE, crate_troubles
from estim.cli.origin_record import ORIGIN, Origin, inside, read_origin
from estim.cli.terminal import NOT_OK, say
from estim.common import EstimError, InputError, format_rounded, read_file

_LARGEST = 2**28
_TOLD = 12  # differences of one kind that are told one by one
_MAKING_REPORTS = frozenset({"fit", "line", "energy", "reanalyse", "calibrate", "compare-models", "map", "plan", "propagate", "body", "batch"})
_CHOICES_OF_PLACE = ("--out", "-o", "--scheduler")
_FAR = 0.1  # sds: what moved by less is told together


@click.command()
@click.argument("report", type=click.Path(path_type=Path))
@click.option("--from", "root", type=click.Path(path_type=Path, file_okay=False), help="Folder from which the inputs are named.  [default: found]")
def verify(report: Path, root: Path | None) -> None:
    """Recompute REPORT (its folder) from the inputs that it names, and say what holds.

    Told are files of the report that were changed after they were written, inputs that are no longer the same, and every
    number that moved by more than Monte-Carlo error.  Exit code 0: everything holds; 3: something does not.
    """
    folder = report if report.is_dir() else report.parent
    origin = read_origin(folder)
    _check_command(origin, folder)
    place = root or _root_of(folder, origin)
    wrong = [*_changed_outputs(folder, origin), *_changed_inputs(place, origin)]
    for line in wrong:
        say(line)
    say(f"recomputing: {origin.line}")
    with tempfile.TemporaryDirectory() as made:
        trouble = _recompute(origin, Path(made), place)
        if not trouble and not (Path(made) / origin.part / ORIGIN).is_file():
            trouble = "cannot be recomputed: the command makes no such report"
        moved = [trouble] if trouble else _compare(folder, Path(made) / origin.part, origin)
    for line in moved:
        say(line)
    if wrong or moved:
        say(f"not verified: {folder}")
        sys.exit(NOT_OK)
    say(f"verified: {folder} follows from its inputs; compared: {_listed(list(origin.outputs))}")


def _check_command(origin: Origin, folder: Path) -> None:
    """Raises InputError unless the command is one that makes a report, in a folder that is not its own choice: the origin may be somebody else's.

    Nor may its part and outputs lead out of what the command makes: the report could be compared with itself.
    """
    named = [word for word in origin.command[1:] if word.startswith(_CHOICES_OF_PLACE)]
    if not origin.command or origin.command[0] not in _MAKING_REPORTS or named:
        raise InputError("must name a command that makes a report, and no place", field="command", value=origin.line, file=str(folder / ORIGIN))
    for field, places in (("part", [origin.part]), ("outputs", origin.outputs)):
        for place in places:
            if not inside(place):
                raise InputError("must lie within what the command writes", field=field, value=place, file=str(folder / ORIGIN))


def _root_of(folder: Path, origin: Origin) -> Path:
    """The folder in which all inputs are found under their names: this one, or the nearest above the report.  Raises InputError."""
    here = Path.cwd()
    for place in (here, *folder.resolve().parents):
        if all((place / path).exists() for path in origin.inputs):
            return place
    missing = next(path for path in origin.inputs if not (here / path).exists())
    raise InputError("cannot be found, here or above the report; --from says from which folder it is named", field="input", value=missing)


def _changed_outputs(folder: Path, origin: Origin) -> Iterator[str]:
    for name, digest in origin.outputs.items():
        data = read_file(folder / name, at_most=_LARGEST, within=folder)
        if data is None:
            yield f"changed: {name} is missing"
        elif hashlib.sha256(data).hexdigest() != digest:
            yield f"changed: {name} is not as it was written"
    yield from crate_troubles(lambda name: read_file(folder / name, at_most=_LARGEST, within=folder), origin)


def _changed_inputs(place: Path, origin: Origin) -> Iterator[str]:
    for path, digest in origin.inputs.items():
        data = (place / path).read_bytes() if (place / path).is_file() else b""
        if hashlib.sha256(data).hexdigest() != digest:
            yield f"changed: the input {path} is not the one that the report was made from"


def _recompute(origin: Origin, out: Path, place: Path) -> str:
    """Runs the command of the report again, silently; what kept it from being run, or ""."""
    group = click.get_current_context().find_root().command
    with contextlib.chdir(place), contextlib.redirect_stdout(io.StringIO()):
        try:
            group.main([*origin.command, "--out", str(out)], prog_name="estim", standalone_mode=False)
        except SystemExit as ended:  # a result that is not ok has a report all the same
            return "" if ended.code in (None, 0, NOT_OK) else f"cannot be recomputed: exit code {ended.code}"
        except (EstimError, click.ClickException) as error:
            return f"cannot be recomputed: {error.format_message() if isinstance(error, click.ClickException) else error}"
    return ""


def _is_picture(name: str) -> bool:
    return name.endswith(".png")


def _compare(folder: Path, made: Path, origin: Origin) -> list[str]:
    from estim.verification import differences

    told: list[str] = []
    now = read_origin(made)
    others = {name: (old, now.versions.get(name)) for name, old in origin.versions.items() if now.versions.get(name) != old}
    told += [f"note: made with {name} {old}, recomputed with {new}" for name, (old, new) in others.items()]
    n_before = len(told)
    unnamed = [name for name in now.outputs if name not in origin.outputs]
    if unnamed and not any(map(_is_picture, origin.outputs)):
        unnamed = [name for name in unnamed if not _is_picture(name)]
        say(f"note: {ORIGIN} names no figure: text and numbers are compared, figures are not")
    told += [f"{name}: is made now, and {ORIGIN} does not name it" for name in unnamed]
    for name in (name for name in origin.outputs if name != CRATE):  # it only describes the others
        before, after = (read_file(place / name, at_most=_LARGEST, within=place) for place in (folder, made))
        if before is None or after is None:
            told.append(f"{name}: " + ("is missing" if before is None else "is not made any more"))
            continue
        if name.endswith(".pdf"):
            if before != after:
                say(f"note: {name} is drawn otherwise now, as other fonts do: not compared")
            continue
        found = differences(name, before, after)
        chance = [one for one in found if one.by_chance]
        if chance:
            say(f"{name}: {len(chance)} numbers differ by no more than Monte-Carlo error")
        left = [one for one in found if not one.by_chance]
        told += [f"{one.file}, {one.where}: {one.before!r}, recomputed {one.now!r}" for one in left[:_TOLD]]
        told += [f"{name}: and {len(left) - _TOLD} more"] if len(left) > _TOLD else []
    return told if len(told) > n_before else []


@click.command()
@click.argument("first", type=click.Path(path_type=Path))
@click.argument("second", type=click.Path(path_type=Path))
def diff(first: Path, second: Path) -> None:
    """What differs between the results of two analyses, FIRST and SECOND (folders, or files result.json).

    Inputs, settings and versions; then each estimate, by how many of the first's standard deviations it moved.
    """
    from estim.verification import compare_results

    pair = compare_results(_result(first), _result(second))
    for line in pair.inputs:
        say(line)
    if pair.same:
        say("the results are the same")
        return
    far = [one for one in pair.estimates if not abs(one.shift) <= _FAR or not 1.0 / 1.1 <= one.ratio <= 1.1]
    for one in far:
        unit = "" if one.unit == "1" else f" {one.unit}"
        values = " -> ".join(f"{format_rounded(mean, 0.1 * sd)} +- {format_rounded(sd, 0.1 * sd)}" for mean, sd in (one.first, one.second))
        say(f"{one.name}: {values}{unit}, moved by {one.shift:+.2f} sd, sd x {one.ratio:.2f}")
    if len(pair.estimates) > len(far):
        say(f"{len(pair.estimates) - len(far)} estimates moved by at most {_FAR} sd, their sds by at most 10 %")
    if pair.others:
        say(f"other entries that differ: {_listed(pair.others)}")
    for what, names in (("the first alone has", pair.lost), ("the second alone has", pair.gained)):
        if names:
            say(f"{what}: {_listed(names)}")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_TOLD]) + (f" and {len(names) - _TOLD} more" if len(names) > _TOLD else "")


def _result(path: Path) -> dict[str, Any]:
    """Raises InputError where there is no result."""
    file = path / "result.json" if path.is_dir() else path
    data = read_file(file, at_most=_LARGEST)
    if data is None:
        raise InputError("cannot be found", field="result", value=str(file))
    try:
        record = json.loads(data)
    except (ValueError, RecursionError):
        record = None
    if not isinstance(record, dict) or not str(record.get("schema", "")).startswith("estim-"):
        raise InputError("must be a result.json of estim", field="result", value=str(file))
    return record


