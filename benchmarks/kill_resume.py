"""Kills a fit with SIGKILL at random moments, resumes it, and compares with the fit that ran through; prints a Markdown table.

    python benchmarks/kill_resume.py [--kills 100] [--seed 1] [--interval 0.0] [--command]

A trial is one analysis of the replica's run heavy-04 in an empty folder, killed once or twice at moments uniform over the time that a
whole one takes, then resumed to its end.  Compared are the bytes of result.json and of every draw.  With `--interval 0` each
step is a chunk, so that many kills fall into a write.  After each kill the chain on disk must hold every step whose saving had
been confirmed.  By default an analysis is a process forked from this one, through the Python API (POSIX only); `--command` runs
`estim fit ... --resume` itself, chunks of 2 s, and compares result.json and report.md.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.campaign import load_campaign
from estim.common.storage import write_whole
from estim.pipeline import analyse
from estim.reports.result import result_of, to_json
from estim.sampling.chain import Target
from estim.sampling.checkpoint import Record, Store, read_checkpoint
from estim.sampling.chunk import Chunk

ROOT = Path(__file__).resolve().parents[1]
CAMPAIGN = ROOT / "data" / "replica" / "campaign.toml"
RUN, MAX_STEP = "heavy-04", 400


@dataclass
class Tally:
    """What happened; every entry of `lost` and `different` is a failure."""

    kills: int = 0
    before_chunks: int = 0
    in_write: int = 0
    finished_first: int = 0
    lost: int = 0
    trials: int = 0
    different: int = 0
    kept_steps: list[int] = field(default_factory=list)


def run_analysis(folder: Path, *, interval: float, confirm: int) -> None:
    """One analysis with a checkpoint; the steps on disk are written to the pipe `confirm` after each chunk."""
    append = Record.append

    def confirmed(record: Record, chunk: Chunk) -> None:
        append(record, chunk)
        os.write(confirm, record.n_step.to_bytes(4, "big"))

    Record.append = confirmed  # type: ignore[method-assign]
    campaign = load_campaign(CAMPAIGN)
    store = Store(folder / "checkpoint", resume=True, interval=interval)
    analysis = analyse(campaign, [RUN], seed=1, target=Target(max_step=MAX_STEP), store=store)
    write_whole(folder / "result.json", to_json(result_of(campaign, analysis)))
    draws = analysis.chain.draws.tobytes() + analysis.chain.log_density.tobytes()
    write_whole(folder / "draws.sha256", hashlib.sha256(draws).hexdigest().encode())


def forked(folder: Path, *, interval: float, kill_after: float | None) -> tuple[bool, int]:
    """Run an analysis in a child; whether it was killed, and the steps whose saving it had confirmed."""
    out, into = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(out)
            run_analysis(folder, interval=interval, confirm=into)
            code = 0
        finally:
            os._exit(code)
    os.close(into)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    with os.fdopen(out, "rb") as pipe:
        confirmed = pipe.read()
    _, status = os.waitpid(child, 0)
    killed = os.WIFSIGNALED(status)
    if not killed and os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit("an analysis failed")
    return killed, int.from_bytes(confirmed[-4:], "big")


def commanded(folder: Path, *, kill_after: float | None) -> tuple[bool, int]:
    """The same by the command line; nothing is confirmed."""
    command = [sys.executable, "-m", "estim", "fit", str(CAMPAIGN), "--run", RUN, "--out", str(folder), "--resume"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": str(ROOT)})
    try:
        code = process.wait(timeout=kill_after)
    except subprocess.TimeoutExpired:
        process.kill()
        code = process.wait()
    if code > 0:
        raise SystemExit(f"estim fit ended with {code}")
    return code == -signal.SIGKILL, 0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="kill a fit at random moments and resume it")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--interval", type=float, default=0.0)
    parser.add_argument("--command", action="store_true")
    chosen = parser.parse_args()
    rng = np.random.default_rng(chosen.seed)
    files = ("result.json", "report.md") if chosen.command else ("result.json", "draws.sha256")
    place = Path(".checkpoint") / RUN if chosen.command else Path("checkpoint")

    def run(folder: Path, kill_after: float | None = None) -> tuple[bool, int]:
        if chosen.command:
            return commanded(folder, kill_after=kill_after)
        return forked(folder, interval=chosen.interval, kill_after=kill_after)

    tally, begun = Tally(), time.monotonic()
    with tempfile.TemporaryDirectory() as work:
        run(Path(work) / "whole")
        whole = {file: (Path(work) / "whole" / file).read_bytes() for file in files}
        start = time.monotonic()
        run(Path(work) / "timed")
        duration = time.monotonic() - start
        while tally.kills < chosen.kills:
            folder = Path(work) / f"trial{tally.trials}"
            for _ in range(min(int(rng.integers(1, 3)), chosen.kills - tally.kills)):
                killed, confirmed = run(folder, kill_after=float(rng.uniform(0.0, duration)))
                if not killed:
                    tally.finished_first += 1
                    break
                tally.kills += 1
                kept = read_checkpoint(folder / place)
                n_step = 0 if kept is None else kept.n_step
                tally.kept_steps.append(n_step)
                tally.before_chunks += n_step == 0
                tally.in_write += any((folder / place).glob(".*.npz.*"))
                tally.lost += n_step < confirmed
            run(folder)
            tally.trials += 1
            tally.different += any((folder / file).read_bytes() != whole[file] for file in files)
    print(f"one whole analysis {duration:.2f} s, all {time.monotonic() - begun:.0f} s\n\n| | |\n|---|---|")
    for label, number in (
        ("kills by SIGKILL", tally.kills), ("trials, each resumed to its end", tally.trials), ("kills before the first chunk", tally.before_chunks),
        ("kills that left a chunk half written", tally.in_write), ("analyses that ended before their kill", tally.finished_first),
        ("median of the steps kept at a kill", int(np.median(tally.kept_steps))), ("**kills that lost a confirmed step**", tally.lost),
        (f"**trials that differ in a byte ({', '.join(files)})**", tally.different),
    ):
        print(f"| {label} | {number} |")
    sys.exit(1 if tally.lost or tally.different else 0)


if __name__ == "__main__":
    main()
