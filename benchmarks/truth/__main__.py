"""How far is a result off, and does it say so, when something is wrong that nobody told?  Writes a Markdown table.

    python benchmarks/truth [--replicas 20] [--only NAME ...] [--priors default sharp] [--noise speeds positions] [--jobs 2] [--seed 1]
                            [--out benchmarks/RESULTS-truth.md] [--keep FOLDER]

Each line: a disturbance of one run (`recordings.py`; the motion is solved by SciPy and shares no code with `model/`), analysed as
`estim fit` does by default, with no hint.  Shift: mean of (posterior mean - true value)/posterior sd over the replicas, whatever the status.
Coverage: share of central 68 and 95 % intervals of the five quantities that hold the true value, among results with status `ok`.
Last column: share of results that are `ok` with some |z| > 4.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from estim.campaign import load_campaign
from estim.common import EstimError
from estim.pipeline import analyse
from truth.recordings import DISTURBANCES, FREE, NOISES, PRIORS, write_campaign

SYMBOLS = {"gamma": "γ", "kappa": "κ", "theta0": "θ₀", "phi": "φ", "rolling_resistance": "c_rr"}
CENTRAL = (0.68, 0.95)


@dataclass(frozen=True)
class Outcome:
    """One replica: z and the share of draws below the true value, by name of the quantity; empty where the command refuses."""

    status: str
    z: tuple[float, ...] = ()
    rank: tuple[float, ...] = ()
    seconds: float = 0.0


def outcome(case: tuple[str, str, str, int, int, str | None]) -> Outcome:
    """Make one recording and analyse it."""
    name, priors, noise, replica, seed, keep = case
    # a replica's noise is the same whatever else is run beside it
    key = int.from_bytes(hashlib.sha256(f"{name} {priors} {noise}".encode()).digest()[:4], "big")
    rng = np.random.default_rng([seed, key, replica])
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(keep) / name / priors / noise / str(replica) if keep else Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        truth = write_campaign(folder, DISTURBANCES[name], priors=priors, noise=noise, rng=rng)
        start = time.perf_counter()
        try:
            analysis = analyse(load_campaign(folder / "campaign.toml"), ["r"], seed=replica + 1)
        except EstimError as error:
            print(f"{name}, {priors}, {noise}, {replica}: {error}", file=sys.stderr)
            return Outcome("refused", seconds=time.perf_counter() - start)
        except Exception as error:
            print(f"{name}, {priors}, {noise}, {replica}: {type(error).__name__}: {error}", file=sys.stderr)
            return Outcome("CRASHED", seconds=time.perf_counter() - start)
    draws = analysis.chain.flat
    columns = [draws[:, analysis.problem.names.index(parameter)] for parameter in truth]
    z = tuple(float((c.mean() - true) / c.std()) for c, true in zip(columns, truth.values(), strict=True))
    rank = tuple(float(np.mean(c < true)) for c, true in zip(columns, truth.values(), strict=True))
    return Outcome(analysis.diagnosis.status, z, rank, time.perf_counter() - start)


def row(name: str, priors: str, noise: str, outcomes: list[Outcome]) -> str:
    done = [o for o in outcomes if o.z]
    ok = [o for o in done if o.status == "ok"]
    z = np.array([o.z for o in done]).reshape(-1, len(FREE))
    shifts = [f"{m:+.1f}" if len(done) else "" for m in (z.mean(axis=0) if len(done) else np.zeros(len(FREE)))]
    statuses = ", ".join(f"{status} {count}" for status, count in Counter(o.status for o in outcomes).most_common())
    rank = np.array([o.rank for o in ok])
    coverage = " / ".join(f"{np.mean(np.abs(rank - 0.5) < 0.5 * p):.0%}" for p in CENTRAL) if ok else ""
    confident = sum(max(map(abs, o.z)) > 4.0 for o in ok) / len(outcomes)
    seconds = f"{np.median([o.seconds for o in outcomes]):.1f}"
    cells = [DISTURBANCES[name].words, priors, noise, *shifts, statuses, coverage, f"{confident:.0%}", seconds]
    return "| " + " | ".join(cells) + " |"


def heads() -> list[str]:
    cells = ["disturbance", "priors", "read as", *SYMBOLS.values(), "status", "68 / 95 % among ok", "ok and some abs(z) > 4", "seconds, median"]
    return ["| " + " | ".join(cells) + " |", "|" + "---|" * len(cells)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replicas", type=int, default=20)
    parser.add_argument("--only", nargs="+", choices=DISTURBANCES, default=list(DISTURBANCES), metavar="NAME", help=", ".join(DISTURBANCES))
    parser.add_argument("--priors", nargs="+", choices=PRIORS, default=list(PRIORS))
    parser.add_argument("--noise", nargs="+", choices=NOISES, default=list(NOISES))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="file for the table beside stdout")
    parser.add_argument("--keep", help="folder to keep campaigns and recordings in")
    chosen = parser.parse_args()
    what = f"{chosen.replicas} replicas a line, seed {chosen.seed}.  Shifts of the mean in posterior standard deviations, mean over replicas: one of "
    what += "random sign or phase (moments per turn, ramp, outliers) averages out there, not in the coverage."
    lines = ["# What is wrong and untold: shift, status, coverage", "", f"Made by `python benchmarks/truth`: {what}", "", *heads()]
    print(*lines, sep="\n", flush=True)
    with ProcessPoolExecutor(chosen.jobs) as pool:
        kinds = list(product(chosen.only, chosen.priors, chosen.noise))
        running = {kind: [pool.submit(outcome, (*kind, i, chosen.seed, chosen.keep)) for i in range(chosen.replicas)] for kind in kinds}
        for kind, futures in running.items():
            lines.append(row(*kind, [future.result() for future in futures]))
            print(lines[-1], flush=True)
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
