"""What the commands share: which runs, progress bars, one line for each result, files written whole."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from estim.errors import InputError
from estim.storage import write_whole

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.sampling import Progress


@contextmanager
def counted(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr for a number of equal pieces of work."""
    from tqdm import tqdm

    with tqdm(total=total, desc=what, unit="campaign", leave=False, disable=None, dynamic_ncols=True) as bar:

        def show(done: int) -> None:
            bar.update(done - bar.n)

        yield show


def conclude(what: str, status: str, reasons: Iterable[str], notes: Iterable[str] = ()) -> None:
    click.echo(f"{what}: {status}")
    for line in (*reasons, *(f"note: {text}" for text in notes)):
        click.echo(f"  {line}")


@contextmanager
def announced(what: str, max_steps: int) -> Iterator[Progress]:
    """A progress bar, and a line when it is done, for a command of several minutes."""
    with progress_bar(what, max_steps) as progress:
        yield progress
    click.echo(f"sampled: {what}")


@contextmanager
def progress_bar(what: str, max_steps: int) -> Iterator[Progress]:
    """A progress bar on stderr that says what sampling still lacks."""
    from tqdm import tqdm

    with tqdm(total=max_steps, desc=what, unit="step", leave=False, disable=None, dynamic_ncols=True) as bar:

        def show(step: int, message: str) -> None:
            bar.n = step
            bar.set_postfix_str(message[:60], refresh=True)

        yield show


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write every file whole, or say which one cannot be written."""
    for name, data in files.items():
        write_whole(folder / name, data)


def note(line: str) -> None:
    """A line on stderr that leaves a progress bar intact."""
    from tqdm import tqdm

    tqdm.write(line, file=sys.stderr)


def groups_of(campaign: Campaign, runs: Iterable[str], *, joint: bool) -> list[tuple[str, ...]]:
    """The runs that are fit together.  Raises InputError where there is none."""
    names = tuple(dict.fromkeys(runs)) or campaign.run_names
    for name in names:
        if name not in campaign.run_names:
            raise InputError(f"must name one of the runs ({', '.join(campaign.run_names)})", field="--run", value=name, file=campaign.source.path)
    if not names:
        raise InputError("has no [[runs]] (estim line fits its theta_min series)", field="campaign", file=campaign.source.path)
    return [names] if joint else [(name,) for name in names]
