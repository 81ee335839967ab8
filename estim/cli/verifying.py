"""`estim verify` and `estim diff`: a report recomputed from its inputs, and two results side by
side.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from estim.cli.options import FOLDER, PATH
from estim.cli.origin import OF_THE_MOMENT
from estim.cli.origin_record import ORIGIN, Origin, read_origin
from estim.cli.terminal import NOT_OK, say
from estim.common import (
    EstimError,
    InputError,
    format_rounded,
    json_of,
    names_in,
    read_file,
    spoken,
)
from estim.verification import Difference, Verdict, compare_results, differences, draws_are_same

_LARGEST = 2**28
_TOLD = 12  # differences of one kind that are told one by one
_MAKING_REPORTS = frozenset(
    {
        "fit",
        "line",
        "energy",
        "reanalyse",
        "calibrate",
        "compare-models",
        "map",
        "plan",
        "propagate",
        "body",
        "batch",
    }
)
_LONGEST_WORD = 4096
_HEADER = 33  # bytes of a PNG: its signature and its first chunk
_PAGE, _TIMES = "report.html", "times.csv"
_OPTIONAL = (".pdf", ".nc")  # what needs an extra that may be missing here
_OWN_BYTES = (*_OPTIONAL, ".png", _PAGE, _TIMES)  # what has no part in whether all is the same
_FAR = 0.1  # sds: what moved by less is told together


@click.command()
@click.argument("report", type=PATH)
@click.option(
    "--from", "root", type=FOLDER, help="Folder from which the inputs are named.  [default: found]"
)
def verify(report: Path, root: Path | None) -> None:
    """Recompute REPORT (its folder) from the inputs that it names, and list what differs.

    Reports of single runs in folders below are verified with it.  It lists files that were changed
    after they were written, inputs that are no longer the same, results that differ by more than
    the tolerances (docs/verifying.md), and what was not compared.  Exit code 0: everything that was
    compared agrees; 3: something does not.
    """
    try:
        os.stat(report)
    except (OSError, ValueError) as error:
        message = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"cannot be read ({message.lower()})", field="report", value=str(report)
        ) from None
    folder = report if _is_folder(report) else report.parent
    origin = read_origin(folder)
    given = _given(origin, folder)
    place = root or _root_of(folder, origin)
    say(f"recomputing: {origin.line}")
    with tempfile.TemporaryDirectory() as temporary:
        trouble = _recompute(origin, Path(temporary), place)
        if not trouble and not (Path(temporary) / origin.part / ORIGIN).is_file():
            trouble = "cannot be recomputed: the command makes no such report"
        result = Found([], [], [])
        if trouble:
            result.wrong.extend([*_changed_outputs(folder, folder, origin), trouble])
        else:
            _compare(
                folder,
                Path(temporary) / origin.part,
                place.resolve(),
                result,
                lang=str(given.get("lang", "en")),
            )
    for line in result.wrong:
        say(line)
    aside = f"; not compared: {_listed(result.aside)}" if result.aside else ""
    if result.wrong:
        say(f"not verified: {folder}{aside}")
        sys.exit(NOT_OK)
    say(f"verified: {folder} follows from its inputs; compared: {_listed(result.compared)}{aside}")


@dataclass(frozen=True)
class Found:
    """wrong : what does not hold, in lines.  compared, aside : files, and parts of them, that were
    compared and that were not.
    """

    wrong: list[str]
    compared: list[str]
    aside: list[str]


def _given(origin: Origin, folder: Path) -> dict[str, Any]:
    """The options of the command.  Raises InputError unless it is one that makes a report, without
    any option that a report never names.

    The origin may be somebody else's: such options choose places and processes, and change no
    number.
    """
    group = click.get_current_context().find_root().command
    assert isinstance(group, click.Group)
    name, words = (origin.command or [""])[0], origin.command[1:]
    command = group.commands.get(name) if name in _MAKING_REPORTS else None
    if command is not None and all(
        word.isprintable() and len(word) <= _LONGEST_WORD for word in words
    ):
        try:
            given = command.make_parser(click.Context(command)).parse_args(list(words))[0]
        except click.ClickException as error:
            raise InputError(
                f"is no command of estim ({error.format_message()})",
                field="command",
                value=origin.line,
                file=folder / ORIGIN,
            ) from None
        # and no --help, which click adds
        if given.keys() <= {parameter.name for parameter in command.params} - OF_THE_MOMENT:
            return dict(given)
    rule = "must name a command that makes a report, and no place, processes or --resume"
    raise InputError(rule, field="command", value=origin.line, file=folder / ORIGIN)


def _root_of(folder: Path, origin: Origin) -> Path:
    """The folder in which all inputs are found under their names: this one, or the nearest above
    the report.  Raises InputError.
    """
    here = Path.cwd()
    for place in (here, *folder.resolve().parents):
        if all(_kind_of(place / path) for path in origin.inputs):
            return place
    missing = next(path for path in origin.inputs if not _kind_of(here / path))
    raise InputError(
        "cannot be found, here or above the report; --from says from which folder it is named",
        field="input",
        value=missing,
    )


def _kind_of(path: Path) -> int:
    """The kind of what stands there (`stat.S_IFMT`), 0 where nothing does or the name can be
    none.
    """
    try:
        return stat.S_IFMT(os.stat(path).st_mode)
    except (OSError, ValueError):
        return 0


def _is_folder(path: Path) -> bool:
    return stat.S_ISDIR(_kind_of(path))


def _changed_outputs(root: Path, folder: Path, origin: Origin) -> Iterator[str]:
    for name, digest in origin.outputs.items():
        data = read_file(folder / name, at_most=_LARGEST, within=root)
        if data is None:
            yield f"changed: {_shown(root, folder, name)} is missing"
        elif hashlib.sha256(data).hexdigest() != digest:
            yield f"changed: {_shown(root, folder, name)} is not as it was written"


def _shown(root: Path, folder: Path, name: str) -> str:
    return (folder.relative_to(root) / name).as_posix()


def _changed_inputs(
    place: Path, before: Mapping[str, str], now: Mapping[str, str]
) -> Iterator[str]:
    """Of the inputs as the origin has them and as they were read now."""
    old, new = (
        {os.path.normpath(place / path): (path, digest) for path, digest in inputs.items()}
        for inputs in (before, now)
    )
    for where in sorted({*old, *new}):
        path = (old.get(where) or new[where])[0]
        if where not in old:
            yield f"changed: the input {path} is read, and {ORIGIN} does not name it"
        elif where not in new:
            yield f"changed: the input {path} is named by {ORIGIN} and is not read"
        elif old[where][1] != new[where][1]:
            yield f"changed: the input {path} is not the one that the report was made from"


def _recompute(origin: Origin, out: Path, place: Path) -> str:
    """Runs the command of the report again, silently; what kept it from being run, or ""."""
    group = click.get_current_context().find_root().command
    name, *words = origin.command
    with contextlib.chdir(place), contextlib.redirect_stdout(io.StringIO()):
        try:
            group.main([name, "--out", str(out), *words], prog_name="estim", standalone_mode=False)
        except SystemExit as ended:  # a result that is not ok has a report all the same
            return (
                ""
                if ended.code in (None, 0, NOT_OK)
                else f"cannot be recomputed: exit code {ended.code}"
            )
        except (EstimError, click.ClickException) as error:
            return (
                "cannot be recomputed: "
                f"{error.format_message() if isinstance(error, click.ClickException) else error}"
            )
    return ""


def _compare(folder: Path, made: Path, place: Path, found: Found, *, lang: str) -> None:
    """Every report that the command makes there and below, against the one that was made now."""
    parts = sorted(path.parent.relative_to(made) for path in made.rglob(ORIGIN))
    pairs = []
    for part in parts:
        now = read_origin(made / part)
        try:
            before = read_origin(folder / part, within=folder)
        except InputError as error:
            found.wrong.append(str(error))
            continue
        if (before.command, before.part) != (now.command, now.part):
            found.wrong.append(
                f"{_shown(folder, folder / part, ORIGIN)}: is that of another command: "
                f"{before.line}"
            )
        pairs.append((part, before, now))
    files = {
        part: {
            name: (_bytes(folder, folder / part, name), _bytes(made, made / part, name))
            for name in before.outputs
        }
        for part, before, _ in pairs
    }
    whole = [
        (name, old, new)
        for of_part in files.values()
        for name, (old, new) in of_part.items()
        if old is not None and new is not None and not name.endswith(_OWN_BYTES)
    ]
    same_draws = all(draws_are_same(*entry) for entry in whole)
    exact = all(old == new for name, old, new in whole if not name.endswith(".md"))
    how = _How(folder, same_draws=same_draws, exact=exact, lang=lang)
    if not how.same_draws:
        say(
            "note: the draws are others, as on another processor: estimates are compared "
            "within their Monte-Carlo errors, and what has none is not"
        )
    for part, before, now in pairs:
        found.wrong.extend(_changed_outputs(folder, folder / part, before))
        found.wrong.extend(
            line
            for line in _changed_inputs(place, before.inputs, now.inputs)
            if line not in found.wrong
        )
        _compare_part(how, folder / part, files[part], before, now, found)


_Pairs = Mapping[str, tuple[bytes | None, bytes | None]]


@dataclass(frozen=True)
class _How:
    """root : of the whole report.  same_draws : in all of its parts.  exact : whether all files of
    numbers are the same to the last byte.
    """

    root: Path
    same_draws: bool
    exact: bool
    lang: str


def _bytes(root: Path, folder: Path, name: str) -> bytes | None:
    return read_file(folder / name, at_most=_LARGEST, within=root)


def _compare_part(
    how: _How, folder: Path, files: _Pairs, before: Origin, now: Origin, found: Found
) -> None:
    other = {
        name: (old, now.versions.get(name, "none"))
        for name, old in before.versions.items()
        if now.versions.get(name) != old
    }
    for package, (stated, present) in other.items() if folder == how.root else ():
        say(f"note: made with {package} {stated}, recomputed with {present}")
    unnamed = [
        name for name in now.outputs if name not in before.outputs and not name.endswith(_OPTIONAL)
    ]
    if not any(map(_is_picture, before.outputs)):
        unnamed = [name for name in unnamed if not _is_picture(name)]
    found.wrong.extend(
        f"{_shown(how.root, folder, name)}: is made now, and {ORIGIN} does not name it"
        for name in unnamed
    )
    found.aside.extend(
        _shown(how.root, folder, name) for name in _not_named(how.root, folder, before)
    )
    for name, (old, new) in files.items():
        label = _shown(how.root, folder, name)
        if old is None or (new is None and not name.endswith(_OPTIONAL)):
            found.wrong.append(
                f"{label}: " + ("is missing" if old is None else "is not made any more")
            )
            continue
        if name == _PAGE:
            new = _page(files, lang=how.lang)
        if (
            name.endswith(".pdf")
            or name == _TIMES
            or new is None
            or (_is_picture(name) and not _same_picture(old, new))
        ):
            if _is_picture(name) and how.exact and before.versions == now.versions:
                found.wrong.append(f"{label}: shows another picture than the one that is drawn now")
            else:
                found.aside.append(label)
        elif _is_picture(name):
            found.compared.append(label)
        else:
            _compare_file(
                label,
                differences(
                    name,
                    old,
                    new,
                    same_draws=how.same_draws or name == _PAGE,
                    exact=how.exact or name == _PAGE,
                ),
                found,
            )


def _compare_file(shown: str, differing: Sequence[Difference], found: Found) -> None:
    wrong, within, aside = (
        [entry for entry in differing if entry.verdict is verdict]
        for verdict in (Verdict.WRONG, Verdict.WITHIN, Verdict.ASIDE)
    )
    if aside and not aside[0].where:
        found.aside.append(shown)
        return
    found.compared.append(shown)
    if within:
        say(f"{shown}: {len(within)} entries differ within the tolerances")
    if aside:
        names = dict.fromkeys(entry.where.rpartition(".")[2].partition("[")[0] for entry in aside)
        found.aside.append(f"of {shown} {len(aside)} entries ({_listed(list(names))})")
        for entry in aside if shown.endswith(".md") else ():
            say(f"not compared: {shown}, {entry.where}: {entry.before!r}, recomputed {entry.now!r}")
    found.wrong.extend(
        f"{shown}, {entry.where}: {entry.before!r}, recomputed {entry.now!r}"
        for entry in wrong[:_TOLD]
    )
    found.wrong.extend([f"{shown}: and {len(wrong) - _TOLD} more"] if len(wrong) > _TOLD else [])


def _not_named(root: Path, folder: Path, origin: Origin) -> list[str]:
    """Files that stand there and that the origin does not name: anybody may have put them there."""
    names = [
        f"{part}{name}"
        for part in ("", "figures/", "tables/")
        for name in names_in(folder / part, within=root)
    ]
    return [
        name
        for name in names
        if name not in {*origin.outputs, ORIGIN} and not _is_folder(folder / name)
    ]


def _page(files: _Pairs, *, lang: str) -> bytes:
    """`report.html` as it follows from the report and the figures beside it."""
    from estim.reports import with_formats

    with spoken(lang):
        return with_formats(
            {
                name: pair[0]
                for name, pair in files.items()
                if pair[0] is not None and name != _PAGE
            },
            ["html"],
        )[_PAGE]


def _is_picture(name: str) -> bool:
    return name.endswith(".png")


def _same_picture(before: bytes, now: bytes) -> bool:
    """Whether two files show the same, point by point."""
    if before == now:
        return True
    # sizes and colours: what is read is no larger than what was drawn
    if before[:_HEADER] != now[:_HEADER]:
        return False
    from matplotlib.image import imread

    try:
        image, other = (imread(io.BytesIO(data), format="png") for data in (before, now))
    except (OSError, ValueError, SyntaxError):
        return False
    return image.shape == other.shape and bool((image == other).all())


@click.command()
@click.argument("first", type=PATH)
@click.argument("second", type=PATH)
def diff(first: Path, second: Path) -> None:
    """What differs between the results of two analyses, FIRST and SECOND (folders, or files
    result.json).

    It lists inputs, settings and versions, then the shift of each estimate in standard deviations
    of the first.
    """
    pair = compare_results(_result(first), _result(second))
    for line in pair.inputs:
        say(line)
    if pair.same:
        say("the results are the same")
        return
    far = [
        row
        for row in pair.estimates
        if not abs(row.shift) <= _FAR or not 1.0 / 1.1 <= row.ratio <= 1.1
    ]
    for row in far:
        unit = "" if row.unit == "1" else f" {row.unit}"
        values = " -> ".join(
            f"{format_rounded(mean, 0.1 * sd)} +- {format_rounded(sd, 0.1 * sd)}"
            for mean, sd in (row.first, row.second)
        )
        say(f"{row.name}: {values}{unit}, moved by {row.shift:+.2f} sd, sd x {row.ratio:.2f}")
    if len(pair.estimates) > len(far):
        say(
            f"{len(pair.estimates) - len(far)} estimates moved by at most {_FAR} sd, their "
            "sds by at most 10 %"
        )
    if pair.others:
        say(f"other entries that differ: {_listed(pair.others)}")
    for what, names in (("the first alone has", pair.lost), ("the second alone has", pair.gained)):
        if names:
            say(f"{what}: {_listed(names)}")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_TOLD]) + (
        f" and {len(names) - _TOLD} more" if len(names) > _TOLD else ""
    )


def _result(path: Path) -> dict[str, Any]:
    """Raises InputError where there is no result."""
    file = path / "result.json" if _is_folder(path) else path
    data = read_file(file, at_most=_LARGEST)
    if data is None:
        raise InputError("cannot be found", field="result", value=str(file))
    try:
        record = json_of(data)
    except ValueError:
        record = None
    if not isinstance(record, dict) or not str(record.get("schema", "")).startswith("estim-"):
        raise InputError("must be a result.json of estim", field="result", value=str(file))
    return record
