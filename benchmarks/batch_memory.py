"""Memory of `estim batch` along a thousand runs: resident memory of the parent and of its workers as results come in.

    OMP_NUM_THREADS=1 nice -n 19 python benchmarks/batch_memory.py [--runs 1000] [--jobs 2]

The runs are synthetic ones of the two disks of data/replica without an unmodelled force, fifty to a campaign.  A worker that kept anything of a run
would grow by what it keeps times the number of runs; what Python and its libraries need of themselves is there after the first few.  Reads /proc,
so it runs on Linux alone.  `python benchmarks/bench.py --only batch` puts the table into RESULTS.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench import campaign_of_runs

_OF_A_CAMPAIGN = 50
_PARTS = (0.02, 0.1, 0.25, 0.5, 0.75, 0.995)  # of all runs, at which memory is read
_WAIT = 0.2  # s


def resident(pid: int) -> float:
    """Resident memory of a process, MB; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), 0.0)


def workers_of(pid: int) -> Iterator[int]:
    """The processes that `pid` started to compute."""
    for place in Path("/proc").glob("[0-9]*"):
        try:
            parent = place.joinpath("stat").read_text().rpartition(")")[2].split()[1]
            if int(parent) == pid and b"spawn_main" in place.joinpath("cmdline").read_bytes():
                yield int(place.name)
        except OSError:
            continue


def measured(n_run: int, jobs: int) -> tuple[list[tuple[int, float, list[float]]], float]:
    """For some numbers of runs that are done the MB of the parent and of each worker; CPU s of a run."""
    found, wanted = [], [max(1, int(part * n_run)) for part in _PARTS]
    with tempfile.TemporaryDirectory() as folder:
        for i in range(-(-n_run // _OF_A_CAMPAIGN)):
            place = Path(folder) / f"set{i:03d}"
            place.mkdir()
            campaign_of_runs(place, min(_OF_A_CAMPAIGN, n_run - i * _OF_A_CAMPAIGN), seed=i)
        out = Path(folder) / "batch"
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "estim", "batch", folder, "--jobs", str(jobs), "--out", str(out)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env={**os.environ, "OMP_NUM_THREADS": "1"})
        while process.poll() is None:
            done = sum(1 for _ in out.glob("**/result.json"))
            if wanted and done >= wanted[0]:
                wanted.pop(0)
                found.append((done, resident(process.pid), sorted(resident(worker) for worker in workers_of(process.pid))))
                print(found[-1], flush=True)
            time.sleep(_WAIT)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found, (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / n_run


def table(n_run: int = 1000, jobs: int = 2) -> list[str]:
    """The measurement in Markdown."""
    found, seconds = measured(n_run, jobs)
    rows = [f"| {done} | {parent:.0f} | {', '.join(f'{one:.0f}' for one in workers)} |" for done, parent, workers in found]
    return [
        f"`estim batch --jobs {jobs}`, {n_run} runs without figures, {seconds:.2f} CPU s a run.", "",
        "| runs done | resident memory of the parent MB | of each worker MB |", "|---|---|---|", *rows,
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    print("\n".join(table(asked.runs, asked.jobs)))
