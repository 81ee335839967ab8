"""`estim batch`: many runs one by one."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from estim.cli.options import FOLDER, JOBS, PATH, STEPS, chosen, report_options
from estim.cli.origin import inputs_so_far
from estim.cli.terminal import counted_progress, finish, reserve_output, say, write_report
from estim.common import EstimError, FigureChoice, InputError, held, phrase

if TYPE_CHECKING:
    from concurrent.futures import Executor


@contextmanager
def cluster(address: str | None) -> Iterator[Executor | None]:
    """The executor of the Dask cluster at `address`; None for None.  Raises InputError where it
    cannot be had.
    """
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            'needs dask.distributed: pip install "estim[dask]"', field="--scheduler", value=address
        ) from None
    logging.disable()  # it would print the traceback of what is reported in a line below
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot be reached ({str(error).splitlines()[0]})", field="--scheduler", value=address
        ) from None
    with client:
        try:
            yield client.get_executor()
        except EstimError:
            raise
        except Exception as error:  # of the cluster: a failure of a run is reported in its row
            raise InputError(
                f"was lost ({type(error).__name__}); what is done is kept: continue with --resume",
                field="--scheduler",
                value=address,
            ) from None


@click.command()
@click.argument("paths", nargs=-1, required=True, metavar="CAMPAIGN|FOLDER...", type=PATH)
@JOBS
@click.option(
    "--shard",
    metavar="I/N",
    help="Only every N-th run, from the I-th, for job arrays.  At the end, repeat without it, "
    "with --resume.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Use a Dask cluster: the address of its scheduler (extra `dask`).",
)
@click.option(
    "--reports",
    is_flag=True,
    help="Write a full report for each run, instead of result.json alone.",
)
@STEPS
@click.option(
    "--out",
    type=FOLDER,
    default=Path("out/batch"),
    show_default=True,
    help="Folder for the results.",
)
@report_options
@click.option(
    "--resume",
    is_flag=True,
    help="Keep the results that are there and were made from the same files, settings and "
    "versions.",
)
def batch(
    paths: tuple[Path, ...],
    jobs: int,
    shard: str | None,
    scheduler: str | None,
    reports: bool,
    max_steps: int,
    out: Path,
    seed: int,
    figures: FigureChoice,
    resume: bool,
) -> None:
    """Fit the runs of many campaigns one by one, each as `estim fit` does.

    A FOLDER stands for every campaign.toml in it and below.  Each result is written as it comes; a
    file that cannot be read, or a run that fails, is reported in its line and does not stop the
    others.  At the end there are summary.csv, a report with scatters and outlying runs, and a
    figure (docs/batch.md).  Exit code 3: some run is not ok.
    """
    from estim.batch import Settings, run_batch, shard_of, units_of
    from estim.reports.batch import batch_line, batch_report, batch_times, full_files, lean_files

    # a worker elsewhere has another working folder
    units = shard_of(units_of(path.resolve() if scheduler else path for path in paths), shard)
    formats = chosen()
    kind = "-".join(("report", *formats, f"figures {figures}")) if reports else "result"
    written = partial(full_files, figures=figures, formats=formats) if reports else lean_files
    settings = Settings(kind, seed, max_steps)
    lock = ".batch" if shard is None else f".batch-{shard.replace('/', '-of-')}"
    place = out if shard is None else out / f"shard-{shard.replace('/', '-of-')}"
    reserve_output(place, "summary.csv", "summary.json", "times.csv", within=out)
    with (
        held(out / lock / ".lock", within=out),
        cluster(scheduler) as executor,
        counted_progress(phrase("batch"), phrase("run"), resumable=True) as progress,
    ):
        progress(0, len(units))
        rows = run_batch(
            units,
            out.resolve(),
            report=written,
            settings=settings,
            resume=resume,
            jobs=jobs,
            executor=executor,
            progress=lambda done: progress(done, len(units)),
        )
    for row in rows:
        inputs_so_far().update(row.inputs)  # read by other processes
    write_report(place, batch_report(rows, figures=figures) | batch_times(rows), within=out)
    for row in rows:
        if row.error:
            say(f"error: {row.run}: {row.error}" if row.run else f"error: {row.error}", err=True)
    say(
        phrase(
            "{n} runs: {what}" if len(rows) != 1 else "{n} run: {what}",
            n=len(rows),
            what=batch_line(rows),
        )
    )
    finish(place, all(row.status == "ok" for row in rows))
