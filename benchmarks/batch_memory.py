"""Memory of `estim batch` along a thousand runs: resident memory of the parent and of its workers
as results come in.

    OMP_NUM_THREADS=1 nice -n 19 python benchmarks/batch_memory.py [--runs 1000] [--jobs 2] [--until
    11:40]

The runs are synthetic ones of the two disks of data/replica without an unmodelled force, fifty to a
campaign.  A worker that kept anything of a run would grow by what it keeps times the number of
runs; what Python and its libraries need of themselves is there after the first few.  At the time of
--until (UTC) it stops with what is there by then.  Reads /proc, so it runs on Linux alone.  `python
benchmarks/bench.py --only batch` puts the table into RESULTS.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench import campaign_of_runs

_OF_A_CAMPAIGN = 50
# of all runs, at which memory is read
_PARTS = (
    0.002,
    0.005,
    0.02,
    0.05,
    0.1,
    0.15,
    0.2,
    0.25,
    0.3,
    0.4,
    0.5,
    0.6,
    0.7,
    0.75,
    0.8,
    0.9,
    0.995,
)
_FEWEST = 20  # runs
_WAIT = 0.5  # s


def resident(pid: int) -> float:
    """Resident memory of a process, MB; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next(
        (float(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), 0.0
    )


def workers_of(pid: int) -> Iterator[int]:
    """The processes that `pid` started to compute."""
    for place in Path("/proc").glob("[0-9]*"):
        try:
            parent = place.joinpath("stat").read_text().rpartition(")")[2].split()[1]
            if int(parent) == pid and b"spawn_main" in place.joinpath("cmdline").read_bytes():
                yield int(place.name)
        except OSError:
            continue


@dataclass(frozen=True)
class Measured:
    """readings : runs done, MB of the parent, MB of each worker.  done : runs.  parent : most MB
    that it was seen with.  cpu, wall : s a run.
    """

    readings: list[tuple[int, float, list[float]]]
    done: int
    parent: float
    cpu: float
    wall: float


def measured(n_run: int, jobs: int, until: str | None = None) -> Measured:
    """Memory for some numbers of runs that are done, up to `until` (HH:MM, UTC)."""
    found = []
    wanted = [n for n in (int(part * n_run) for part in _PARTS) if n >= _FEWEST]
    most = 0.0
    done = 0
    stopped = False
    with tempfile.TemporaryDirectory() as folder:
        for i in range(-(-n_run // _OF_A_CAMPAIGN)):
            place = Path(folder) / f"set{i:03d}"
            place.mkdir()
            campaign_of_runs(place, min(_OF_A_CAMPAIGN, n_run - i * _OF_A_CAMPAIGN), seed=i)
        out = Path(folder) / "batch"
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "estim",
            "batch",
            folder,
            "--jobs",
            str(jobs),
            "--out",
            str(out),
        ]
        process = subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        while process.poll() is None:
            done, parent = sum(1 for _ in out.glob("*/*/*")), resident(process.pid)
            most = max(most, parent)
            if wanted and done >= wanted[0]:
                wanted.pop(0)
                found.append(
                    (done, parent, sorted(resident(worker) for worker in workers_of(process.pid)))
                )
                print(found[-1], f"{time.perf_counter() - began:.0f} s", flush=True)
            if until is not None and time.strftime("%H:%M", time.gmtime()) >= until:
                found.append(
                    (done, parent, sorted(resident(worker) for worker in workers_of(process.pid)))
                )
                process.send_signal(signal.SIGTERM)
                stopped = True
                process.wait()
            time.sleep(_WAIT)
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    done = max(1, done) if stopped else n_run
    return Measured(
        found,
        done,
        most,
        (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / done,
        wall / done,
    )


def table(n_run: int = 1000, jobs: int = 2, until: str | None = None) -> list[str]:
    """The measurement in Markdown."""
    found = measured(n_run, jobs, until)
    rows = [
        f"| {done} | {parent:.0f} | {', '.join(f'{one:.0f}' for one in workers)} |"
        for done, parent, workers in found.readings
    ]
    of = (
        f"{n_run} runs"
        if found.done == n_run
        else f"{found.done} of {n_run} runs until it was stopped"
    )
    return [
        f"`estim batch --jobs {jobs}`, {of}, without figures, {found.cpu:.2f} CPU s a run; "
        f"the parent never had more than {found.parent:.0f} MB.",
        "",
        "| runs done | resident memory of the parent MB | of each worker MB |",
        "|---|---|---|",
        *rows,
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--until", help="HH:MM, UTC")
    asked = parser.parse_args()
    print("\n".join(table(asked.runs, asked.jobs, asked.until)))
