"""Positions in machine code (the extra `fast`) against NumPy, and what that does to whole commands;
a section of RESULTS.md.

    OMP_NUM_THREADS=1 python benchmarks/positions_speed.py [--commands]

42 positions in 1.4 s of draws about the paper's heavy disk, by both ways in turn, the quicker of
seven each.  `--commands`: processor seconds of three commands, twice each way in turn; what is
compiled once has been compiled before.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.model import Body, back_and_forth, motion

PROJECT = Path(__file__).resolve().parents[1]
COMMANDS = {  # words -> noise of the campaign, arguments
    "`fit` of one run, positions": ("positions", ("--run", "light-01")),
    "`fit --compare`, one run": ("differentiated", ("--run", "light-01", "--compare")),
    "`fit --compare`, eight runs": ("differentiated", ("--compare",)),
}


def draws(n_draw: int) -> tuple[Body, dict[str, Any]]:
    rng = np.random.default_rng(n_draw)

    def normal(mean: float, sd: float) -> np.ndarray:
        return mean + sd * rng.standard_normal((n_draw, 1))

    body = Body(radius=normal(0.15, 0.0005), gamma=normal(0.187, 0.005), kappa=normal(0.45, 0.05))
    return body, {
        "phi": normal(0.07, 0.005),
        "theta0": normal(1.05, 0.02),
        "rolling_resistance": abs(normal(0.0, 0.003)),
        "g": 9.81,
    }


def microseconds(n_draw: int) -> tuple[float, float, float]:
    """Of one draw by NumPy and by machine code, and the largest difference (m)."""
    t, (body, place), compiled = np.linspace(0.0, 1.4, 42), draws(n_draw), motion._compiled
    best, x = {False: np.inf, True: np.inf}, {}
    for _ in range(7):
        for fast in best:
            motion._compiled = compiled if fast else lambda: None
            began = time.process_time()
            for _ in range(repeats := max(1, 3000 // n_draw)):
                x[fast] = back_and_forth(t, body, **place)[0]
            best[fast] = min(best[fast], (time.process_time() - began) / repeats / n_draw * 1e6)
    motion._compiled = compiled
    return best[False], best[True], float(np.max(np.abs(x[True] - x[False])))


def seconds(noise: str, arguments: tuple[str, ...], fast: bool) -> float:
    """Processor time of `estim fit` of the replica, without figures."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_DISABLE_JIT": "0" if fast else "1"}
    with tempfile.TemporaryDirectory() as folder:
        replica = shutil.copytree(PROJECT / "data" / "replica", Path(folder) / "replica")
        if noise == "positions":
            text = (replica / "campaign.toml").read_text()
            (replica / "campaign.toml").write_text(
                text.replace('derivative = "central"', 'model = "positions"')
            )
        command = [
            sys.executable,
            "-m",
            "estim",
            "fit",
            str(replica / "campaign.toml"),
            "--figures",
            "none",
            "--out",
            f"{folder}/out",
            *arguments,
        ]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, env=environment, cwd=PROJECT, capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def table(commands: bool = True) -> list[str]:
    if motion._compiled() is None:
        return ["not run: numba is not installed"]
    lines = [
        "| draws at once | NumPy, µs a draw | machine code | ratio | largest difference |",
        "|---|---|---|---|---|",
    ]
    for n_draw in (1, 30, 300, 3000):
        numpy, machine, apart = microseconds(n_draw)
        lines.append(
            f"| {n_draw} | {numpy:.1f} | {machine:.1f} | {numpy / machine:.1f} | {apart:.0e} m |"
        )
    lines += ["", "| command | NumPy, CPU s | machine code, CPU s | ratio |", "|---|---|---|---|"]
    for words, (noise, arguments) in COMMANDS.items() if commands else ():
        pairs = [[seconds(noise, arguments, fast) for fast in (False, True)] for _ in range(2)]
        slow, fast = (" ".join(f"{pair[i]:.1f}" for pair in pairs) for i in (0, 1))
        lines.append(
            f"| {words} | {slow} | {fast} | "
            f"{sum(p[0] for p in pairs) / sum(p[1] for p in pairs):.2f} |"
        )
        print(lines[-1], flush=True)
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--commands", action="store_true")
    print("\n".join(table(parser.parse_args().commands)))
