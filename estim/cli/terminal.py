"""What the commands share: one line printed for a person, exit codes, progress bars, which runs,
files written whole.
"""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from estim.cli.machine import answer, begin_answer, keep_files
from estim.cli.options import chosen
from estim.cli.origin import ORIGIN, with_origin, written_before
from estim.cli.output_streams import CANNOT_SAY, NO_READER, outlets
from estim.common import (
    EstimError,
    Files,
    InputError,
    Interrupted,
    NumericalError,
    PieceStore,
    as_json,
    held,
    one_line,
    phrase,
    replace_own,
    require_own,
    require_room,
    write_whole,
)

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.sampling import Progress

_GO_ON = "continue with --resume"
BAD_INPUT, NOT_OK, INTERRUPTED = 2, 3, 130  # exit codes; those of streams are in `output_streams`


def say(line: str, *, err: bool = False) -> None:
    """One line on stdout or stderr, whatever `line` holds.  Every line of a command goes through
    here.
    """
    if not err and (result := answer()) is not None:
        result.lines.append(one_line(line))
        return
    stream = sys.stderr if err else sys.stdout
    stream.write(one_line(line) + "\n")
    stream.flush()


def _reported(**facts: object) -> bool:
    """Whether progress and errors are reported to a program, as lines of JSON on stderr: where it
    set ESTIM_PROGRESS to "json".
    """
    requested = os.environ.get("ESTIM_PROGRESS") == "json"
    if requested:
        say(json.dumps(facts), err=True)
    return requested


def exit_code(command: Callable[[], object]) -> int:
    """The exit code of a command, whose errors become one line on stderr.  Streams that cannot be
    written to stop nothing.
    """
    with outlets() as stdout:
        code = _code(command)
        sys.stdout.flush()
        if stdout.error == errno.EPIPE:  # its reader was gone, as `head` is
            return code or NO_READER
        if stdout.error:
            why = os.strerror(stdout.error).lower()
            say(f"error: standard output: cannot be written ({why})", err=True)
            return code or CANNOT_SAY
    return code


def _code(command: Callable[[], object]) -> int:
    try:
        status = command()
    except SystemExit as ended:
        status = ended.code
    except (Interrupted, click.exceptions.Abort) as error:
        say(": ".join(("interrupted", *error.args)), err=True)
        return INTERRUPTED
    except (click.ClickException, EstimError) as error:
        message = error.format_message() if isinstance(error, click.ClickException) else str(error)
        if not _reported(error=message, field=getattr(error, "field", None)):
            say(f"error: {message}", err=True)
        return NOT_OK if isinstance(error, NumericalError) else BAD_INPUT
    # of a file that a person named, looked for where nothing opens it: too long a name, a folder of
    # others
    except OSError as error:
        if error.filename is None:
            raise
        say(
            f"error: {error.filename}: cannot be used ({(error.strerror or str(error)).lower()})",
            err=True,
        )
        return BAD_INPUT
    return status if isinstance(status, int) else 0


def with_json(command: click.Command) -> None:
    """Gives a command the option.  Whatever else would go to standard output, a question of `estim
    new` for instance, goes to standard error.  Nothing is written there where the input is wrong.
    """
    callback = command.callback
    assert callback is not None

    def answering(*, json: bool, **arguments: Any) -> None:
        if not json:
            callback(**arguments)
            return
        result, code = begin_answer(), 0
        with redirect_stdout(sys.stderr):
            try:
                callback(**arguments)
            except SystemExit as ended:
                code = int(ended.code or 0)
        sys.stdout.write(as_json(result.record(command.name or "", code)).decode())
        sys.stdout.flush()
        sys.exit(code)

    command.callback = answering
    click.option(
        "--json",
        is_flag=True,
        help="Print one JSON object in place of lines: what they say, every estimate with unit and "
        "uncertainty, the files, and the results in them (docs/interop.md).",
    )(command)


@contextmanager
def counted_progress(
    what: str, unit: str, *, resumable: bool = False
) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr for equal pieces of work, how many are done of how many.

    resumable : whether an interrupted command can go on with those that are done.
    """
    with _bar(what, unit=unit) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)
            _reported(percent=100 * done // max(total, 1), doing=what)

        try:
            yield show
        except Interrupted as error:
            raise Interrupted(*([_GO_ON] if resumable else error.args)) from None


def _bar(what: str, **options: Any) -> Any:
    from tqdm import tqdm

    return tqdm(desc=one_line(what), leave=False, disable=None, dynamic_ncols=True, **options)


def conclude(what: str, status: str, reasons: Iterable[str], notes: Iterable[str] = ()) -> None:
    """Prints a status, what stands below it, and those notes that do not."""
    say(f"{what}: {status}")
    lines = list(reasons)
    for line in (
        *lines,
        *(phrase("note: {text}", text=text) for text in notes if text not in lines),
    ):
        say(f"  {line}")


@contextmanager
def announced(what: str) -> Iterator[Progress]:
    """A progress bar, and a line when it is done, for a command of several minutes."""
    with progress_bar(what) as progress:
        yield progress
    say(phrase("sampled: {what}", what=what))


@contextmanager
def progress_bar(what: str) -> Iterator[Progress]:
    """A progress bar on stderr: the share of the draws needed, and what is being done or is still
    missing.
    """
    words = phrase("{desc} {bar:20} {n_fmt} % of the draws needed, {elapsed}{postfix}")
    with _bar(what, total=100, bar_format=words) as bar:

        def show(percent: int, message: str) -> None:
            bar.n = percent
            bar.set_postfix_str(one_line(message[:60]), refresh=True)
            _reported(percent=percent, doing=message)

        yield show


def write_files(folder: Path, files: Files) -> None:
    """Write every file whole.  Raises EstimError, with nothing written, where another file of that
    name is there already.
    """
    require_own(
        folder,
        files,
        {name: sha256(data).hexdigest() for name, data in files.items()},
        within=folder,
        rule="is there already with other contents, and is not overwritten: remove it, or choose "
        "another name",
    )
    for name, data in files.items():
        write_whole(folder / name, data, within=folder)
    keep_files(folder, dict(files))


def reserve_output(
    folder: Path, *names: str, groups: Sequence[Sequence[str]] = (), within: Path | None = None
) -> None:
    """Raises EstimError, before anything is computed, where a report in `folder` would replace what
    estim did not write, or what was changed since.

    names : of what a report has beside `report.md`.
    groups : of runs, each of which has a report in the folder of its first run if they are several.
    """
    for part in ("", *(group[0] for group in groups if len(groups) > 1)):
        place = folder / part
        before = written_before(place, within=within or folder)
        require_room(place, names, before.outputs if before else {}, within=within or folder)


def write_report(
    folder: Path, files: Files, *, within: Path | None = None, manifest: str = ORIGIN
) -> None:
    """Write a report whole, and how it was made (the file `manifest`), in place of the report that
    was there, of which nothing stays; says so where that was of other files, or of another
    command.

    Raises EstimError, with nothing written, where a file would be replaced that is not as estim
    wrote it.
    """
    root = within or folder
    part = folder.relative_to(root).as_posix()
    contents, origin = with_origin(files, "" if part == "." else part)
    before = written_before(folder, within=root, name=manifest)
    replace_own(
        folder,
        contents,
        before.outputs if before else {},
        manifest,
        lambda outputs: as_json(replace(origin, outputs=dict(outputs))),
        within=root,
    )
    if before and folder == root and before.subject != origin.subject:
        say(
            f"{folder}: the report of `{before.line}` is replaced (--out would keep both)", err=True
        )
    keep_files(folder, contents)


def exit_unless(ok: bool) -> None:
    """Ends the command with 3 where a result is not to be trusted."""
    if not ok:
        sys.exit(NOT_OK)


def report_at(folder: Path, outside: Iterable[str] = ()) -> None:
    """Where the report stands, and which of the files that were read lie outside the campaign's
    folder.
    """
    for sentence in outside:
        say(phrase("note: {text}", text=sentence))
    for name in chosen() or ["md"]:
        say(phrase("report: {path}", path=folder / f"report.{name}"))


def finish(folder: Path, ok: bool, outside: Iterable[str] = ()) -> None:
    """The last lines of a command that writes one report, and its exit code."""
    report_at(folder, outside)
    exit_unless(ok)


@contextmanager
def checkpoint(folder: Path, *, resume: bool) -> Iterator[PieceStore]:
    """Where a command keeps what it has finished, in OUT/.checkpoint, until all its reports are
    written.

    Without `resume` what an earlier command left there is discarded.  A signal to stop ends in a
    line that states whether anything was finished.  Raises EstimError, before anything is computed,
    where another process is at work there, or nothing can be written.
    """
    store = PieceStore(folder / ".checkpoint")
    with held(store.folder / ".lock", within=folder):
        count = len(store.names())
        if resume:
            rest = (
                f"finished pieces: {count}; those made from the same inputs are used"
                if count
                else "nothing to resume, all is computed anew"
            )
            say(f"{store.folder}: {rest}", err=True)
        elif count:
            say(
                f"{store.folder}: what an unfinished command left is discarded (--resume "
                "would continue it)",
                err=True,
            )
            store.clear()
        try:
            yield store
        except Interrupted:
            raise Interrupted(*([_GO_ON] if store.names() else [])) from None
        store.clear()


def run_label(runs: Sequence[str]) -> str:
    """The runs of a fit as they are named on the screen."""
    return (
        ", ".join(runs)
        if len(runs) <= 24
        else phrase(
            "{first}, {second} ... {last} ({n} runs)",
            first=runs[0],
            second=runs[1],
            last=runs[-1],
            n=len(runs),
        )
    )


def groups_of(campaign: Campaign, runs: Iterable[str], *, joint: bool) -> list[tuple[str, ...]]:
    """The runs that are fit together.  Raises InputError where there is none."""
    names = tuple(dict.fromkeys(runs)) or campaign.run_names
    for name in names:
        if name not in campaign.run_names:
            raise InputError(
                f"must name one of the runs ({', '.join(campaign.source.names)})",
                field="--run",
                value=name,
                file=campaign.source.places.file,
            )
    if not names:
        raise InputError(
            "has no [[runs]] (estim line fits its theta_min series)",
            field="campaign",
            file=campaign.source.places.file,
        )
    return [names] if joint else [(name,) for name in names]
