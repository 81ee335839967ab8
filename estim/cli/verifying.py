"""`estim verify` and `estim diff`: a report recomputed from its inputs, and two results side by
side.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import math
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from stat import S_ISDIR
from typing import Any

import click

from estim.cli.machine import keep_result
from estim.cli.options import FOLDER, PATH, Real
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
    spoken,
)
from estim.verification import (
    Difference,
    Moved,
    Verdict,
    compare_results,
    differences,
    draws_are_same,
    only_estimate,
)

_MOST_LISTED = 12  # differences of one kind that are listed one by one
_HEADER = 33  # bytes of a PNG: its signature and its first chunk
_PAGE, _TIMES = "report.html", "times.csv"
_OPTIONAL = (".pdf", ".nc")  # what needs an extra that may not be installed
_OWN_BYTES = (*_OPTIONAL, ".png", _PAGE, _TIMES)  # what has no part in whether all is the same
_FAR = 0.1  # sds: estimates that moved by less are summarised in one line


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
        folder = report if S_ISDIR(report.stat().st_mode) else report.parent
    except OSError as error:
        rule = f"cannot be read ({(error.strerror or str(error)).lower()})"
        raise InputError(rule, field="report", value=str(report)) from None
    origin = read_origin(folder)
    options = _options_of(origin, folder)
    place = root or _root_of(folder, origin)
    say(f"recomputing: {origin.line}")
    with tempfile.TemporaryDirectory() as temporary:
        trouble = _recompute(origin, Path(temporary), place)
        folder_now = Path(temporary) / origin.part
        if not trouble and not (folder_now / ORIGIN).is_file():
            trouble = "cannot be recomputed: the command makes no such report"
        comparison = _Comparison(folder, folder_now, str(options.get("lang", "en")))
        if trouble:
            comparison.wrong.extend([*comparison.changed_outputs(Path(), origin), trouble])
        else:
            comparison.compare()
    lists = {
        "wrong": comparison.wrong,
        "compared": comparison.compared,
        "aside": comparison.not_compared,
    }
    keep_result("verification", {"verified": not comparison.wrong} | lists)
    for line in comparison.wrong:
        say(line)
    rest = f"; not compared: {_listed(comparison.not_compared)}" if comparison.not_compared else ""
    if comparison.wrong:
        say(f"not verified: {folder}{rest}")
        sys.exit(NOT_OK)
    compared = _listed(comparison.compared)
    say(f"verified: {folder} follows from its inputs; compared: {compared}{rest}")


def _options_of(origin: Origin, folder: Path) -> dict[str, Any]:
    """The options of the command.  Raises InputError unless it is one that makes a report, without
    any option that a report never names.

    The origin may come from elsewhere: such options choose places and processes, and change no
    number.
    """
    group = click.get_current_context().find_root().command
    assert isinstance(group, click.Group)
    name, words = (origin.command or [""])[0], origin.command[1:]
    command = group.commands.get(name)
    options = set() if command is None else {parameter.name for parameter in command.params}
    sane = all(word.isprintable() and len(word) <= 4096 for word in words)
    if command is not None and "formats" in options and sane:
        try:
            values = command.make_parser(click.Context(command)).parse_args(list(words))[0]
        except click.ClickException as error:
            raise InputError(
                f"is no command of estim ({error.format_message()})",
                field="command",
                value=origin.line,
                file=folder / ORIGIN,
            ) from None
        # and no --help, which click adds
        if values.keys() <= options - WITHOUT_EFFECT:
            return dict(values)
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
        "cannot be found, here or above the report; --from says from which folder it is named",
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


@dataclass(frozen=True)
class _ReportPair:
    """A report of those that a command makes.  folder : within the whole.  before, now : how it was
    made.  files : name -> as it was written before, and now; None where it is not there.
    """

    folder: Path
    before: Origin
    now: Origin
    files: Mapping[str, tuple[bytes | None, bytes | None]]


@dataclass(frozen=True)
class _Comparison:
    """A report and all below it, against those that its command makes now.

    folder : of the report.  recomputed : of the one that was made now.  lang : its language.
    wrong : what does not hold, in lines.  compared, not_compared : files, and parts of them, that
        were compared and that were not.
    """

    folder: Path
    recomputed: Path
    lang: str
    wrong: list[str] = field(default_factory=list)
    compared: list[str] = field(default_factory=list)
    not_compared: list[str] = field(default_factory=list)

    def compare(self) -> None:
        """Every report that the command makes there and below."""
        folders = sorted(
            path.parent.relative_to(self.recomputed) for path in self.recomputed.rglob(ORIGIN)
        )
        parts = [part for folder in folders if (part := self._part(folder)) is not None]
        entries = [
            (name, old, new)
            for part in parts
            for name, (old, new) in part.files.items()
            if old is not None and new is not None and not name.endswith(_OWN_BYTES)
        ]
        same_draws = all(draws_are_same(*entry) for entry in entries)
        exact = all(old == new for name, old, new in entries if not name.endswith(".md"))
        if not same_draws:
            say(
                "note: the draws are others, as on another processor: estimates are compared "
                "within their Monte-Carlo errors, and what has none is not"
            )
        for part in parts:
            self.wrong.extend(self.changed_outputs(part.folder, part.before))
            changed = _changed_inputs(part.before.inputs, part.now.inputs)
            self.wrong.extend(line for line in changed if line not in self.wrong)
            self._compare_part(part, same_draws=same_draws, exact=exact)

    def _part(self, folder: Path) -> _ReportPair | None:
        """None where its origin cannot be read, which is wrong."""
        now = read_origin(self.recomputed / folder)
        try:
            before = read_origin(self.folder / folder, within=self.folder)
        except InputError as error:
            self.wrong.append(str(error))
            return None
        if (before.command, before.part) != (now.command, now.part):
            label = (folder / ORIGIN).as_posix()
            self.wrong.append(f"{label}: is that of another command: {before.line}")
        old, new = (
            {name: read_file(root / folder / name, within=root) for name in before.outputs}
            for root in (self.folder, self.recomputed)
        )
        return _ReportPair(folder, before, now, {name: (old[name], new[name]) for name in old})

    def changed_outputs(self, folder: Path, origin: Origin) -> Iterator[str]:
        for name, digest in origin.outputs.items():
            data = read_file(self.folder / folder / name, within=self.folder)
            label = (folder / name).as_posix()
            if data is None:
                yield f"changed: {label} is missing"
            elif hashlib.sha256(data).hexdigest() != digest:
                yield f"changed: {label} is not as it was written"

    def _compare_part(self, part: _ReportPair, *, same_draws: bool, exact: bool) -> None:
        """same_draws : in all parts.  exact : whether all files of numbers are the same to the last
        byte.
        """
        before, now = part.before, part.now
        for package, stated in before.versions.items() if part.folder == Path() else ():
            if (present := now.versions.get(package)) != stated:
                say(f"note: made with {package} {stated}, recomputed with {present or 'none'}")
        drawn = any(map(_is_picture, before.outputs))
        self.wrong.extend(
            f"{(part.folder / name).as_posix()}: is made now, and {ORIGIN} does not name it"
            for name in now.outputs
            if name not in before.outputs
            and not name.endswith(_OPTIONAL)
            and (drawn or not _is_picture(name))
        )
        self.not_compared.extend(self._not_named(part))
        for name, (old, new) in part.files.items():
            label = (part.folder / name).as_posix()
            page = name == _PAGE
            if old is None:  # which is reported already
                continue
            if new is None and not name.endswith(_OPTIONAL):
                self.wrong.append(f"{label}: is not made any more")
            elif name == _TIMES or name.endswith(".pdf") or new is None:
                self.not_compared.append(label)
            elif not _is_picture(name):
                new = self._page(part) if page else new
                same = same_draws or page
                differing = differences(name, old, new, same_draws=same, exact=exact or page)
                self._compare_file(label, differing)
            elif _same_picture(old, new):
                self.compared.append(label)
            elif exact and before.versions == now.versions:
                self.wrong.append(f"{label}: shows another picture than the one that is drawn now")
            else:
                self.not_compared.append(label)

    def _compare_file(self, label: str, differing: Sequence[Difference]) -> None:
        wrong, within, not_compared = (
            [entry for entry in differing if entry.verdict is verdict]
            for verdict in (Verdict.WRONG, Verdict.WITHIN, Verdict.ASIDE)
        )
        if not_compared and not not_compared[0].where:
            self.not_compared.append(label)
            return
        self.compared.append(label)
        if within:
            say(f"{label}: {len(within)} entries differ within the tolerances")
        if not_compared:
            names = [entry.where.rpartition(".")[2].partition("[")[0] for entry in not_compared]
            words = _listed(list(dict.fromkeys(names)))
            self.not_compared.append(f"of {label} {len(not_compared)} entries ({words})")
        for entry in not_compared if label.endswith(".md") else ():
            say(f"not compared: {label}, {entry.where}: {entry.before!r}, recomputed {entry.now!r}")
        self.wrong.extend(
            f"{label}, {entry.where}: {entry.before!r}, recomputed {entry.now!r}"
            for entry in wrong[:_MOST_LISTED]
        )
        if len(wrong) > _MOST_LISTED:
            self.wrong.append(f"{label}: and {len(wrong) - _MOST_LISTED} more")

    def _not_named(self, part: _ReportPair) -> Iterator[str]:
        """Files that stand there and that the origin does not name: they may come from elsewhere
        there.
        """
        place = self.folder / part.folder
        for below in ("", "figures/", "tables/"):
            for name in names_in(place / below, within=self.folder):
                path = f"{below}{name}"
                if path not in {*part.before.outputs, ORIGIN} and not os.path.isdir(place / path):
                    yield (part.folder / path).as_posix()

    def _page(self, part: _ReportPair) -> bytes:
        """`report.html` as it follows from the report and the figures beside it."""
        from estim.reports.pages import with_formats

        files = {
            name: old for name, (old, _) in part.files.items() if old is not None and name != _PAGE
        }
        with spoken(self.lang):
            return with_formats(files, ["html"])[_PAGE]


def _changed_inputs(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """Of the inputs as the origin has them and as they were read now."""
    for path in sorted({*before, *now}):
        if path not in before:
            yield f"changed: the input {path} is read, and {ORIGIN} does not name it"
        elif path not in now:
            yield f"changed: the input {path} is named by {ORIGIN} and is not read"
        elif before[path] != now[path]:
            yield f"changed: the input {path} is not the one that the report was made from"


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
    if pair.same:
        say("the results are the same")
        return
    far = [
        row
        for row in pair.estimates
        if not abs(row.shift) <= _FAR or not 1.0 / 1.1 <= row.ratio <= 1.1
    ]
    n, alone = len(pair.estimates), len(pair.lost) + len(pair.gained)
    verdict = (
        f"{len(far)} of {n} estimates differ, {far[0].name} most, by {_shift(far[0])}"
        if far
        else f"the {n} estimates in both results agree within {_FAR} sd"
    )
    say(verdict + (f"; {alone} are in one result only" if alone else ""))
    for line in pair.inputs:
        say(line)
    for row in far:
        values = " -> ".join(
            f"{format_rounded(mean, 0.1 * sd)} ± {format_rounded(sd, 0.1 * sd)}"
            for mean, sd in (row.first, row.second)
        )
        moved = f"moved by {_shift(row)}"
        if math.isfinite(row.ratio):
            moved += f", sd × {row.ratio:.2f}"
        say(f"{row.name}: {values}{behind(row.unit)}, {moved}")
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


def _shift(row: Moved) -> str:
    """In standard deviations of the first result, or in its unit where that has none."""
    if math.isfinite(row.shift):
        return f"{signed(f'{row.shift:+.2f}')} sd"
    return f"{signed(f'{row.second[0] - row.first[0]:+.3g}')}{behind(row.unit)}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_MOST_LISTED]) + (
        f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    )


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
