"""What certified draws cost, against other samplers and in the size of the problem; writes
RESULTS.md and scaling.png beside this file.

    make bench OMP_NUM_THREADS=1 python benchmarks/bench.py [--peers PYTHON] [--only
    peers|scaling|batch|rates] [--most-runs 64]

PYTHON is that of an environment of its own in which estim, dynesty, bumps, pymc and nutpie are
installed; what fails there is named as not run.

The posterior: run light-01 of data/replica as `estim fit` poses it, six parameters.  Each method
runs in a process of its own, one after the other, from the start of Python to 4,000 effective draws
of the worst parameter: imports, campaign and the fit that all start from included, and what is
compiled.  All use the same density, PyMC one that is written anew (`bench_pymc.py`: the same to
1e-12 at 50 points); what takes many points at once is given them, and each has one core.  Effective
draws of dynesty are those that the spread of its resampled runs is worth.  The certified posterior
includes its second computation.  Right: means and standard deviations within 4.5 Monte-Carlo errors
of a long chain of emcee.  Times are told as ratios within one run of this file.

Effective draws a second while sampling (`sampling_rates.py`).  The size of the problem: joint fits
and long data sets; memory along a batch of a thousand runs (`batch_memory.py`).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from bench_samplers import ESS, HERE, METHODS, MOST_SECONDS, SEED, Measured, by_emcee, one, posed

_ERRORS = 4.5
_PEERS = "To 4,000 effective draws of six parameters"
_SCALING = "Scaling"
_BATCH = "Memory of a batch"
_RATES = "While sampling"
NAMES = {
    "estim": "estim, certified",
    "emcee": "emcee, vectorised, 64 walkers, stretch moves",
    "emcee-de": "emcee, vectorised, 128 walkers, differential evolution",
    "pymc": "PyMC + nutpie",
    "dynesty": "dynesty",
    "lmfit": "lmfit's emcee",
    "bumps": "bumps (DREAM)",
}
_SETTINGS = (
    "Settings were chosen on this posterior for two: nutpie has a low-rank mass matrix and "
    "target_accept 0.95, the fastest of four; dynesty walks",
    "of 80 steps, since its own choice had not ended after 125 CPU s, and walks of 26 or "
    "slices were 6 to 9 errors off estim's draws.",
)
_ELSEWHERE = ("dynesty", "bumps", "pymc")


def reference() -> Measured:
    """emcee with ten times as many effective draws as are asked for: it shares no code with
    ours.
    """
    fit = posed()
    ess, mean, sd, u_mean, u_sd = by_emcee(fit, 10.0 * MOST_SECONDS, wanted=10.0 * ESS, seed=987)
    return {
        "ess": ess,
        "mean": list(mean),
        "sd": list(sd),
        "u_mean": list(u_mean),
        "u_sd": list(u_sd),
        "names": list(fit.names),
    }


def in_a_process(python: str, *arguments: str) -> Measured:
    """What this file prints in a process of its own, with its wall and CPU seconds from start to
    end and its peak memory in MB.
    """
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [python, str(Path(__file__).resolve()), *arguments]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    process = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        return {"failed": (process.stderr.strip().splitlines() or ["no words"])[-1]}
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**json.loads(process.stdout.strip().splitlines()[-1]), "wall": wall, "cpu": cpu}


def off(found: Measured, true: Measured) -> float:
    """Largest deviation of a mean or standard deviation from the reference, in Monte-Carlo errors
    of both.
    """
    worst = 0.0
    for value in ("mean", "sd"):
        error = np.hypot(found[f"u_{value}"], true[f"u_{value}"])
        worst = max(worst, float(np.max(np.abs(np.array(found[value]) - true[value]) / error)))
    return worst


def peers_table(python: str, peers: str) -> list[str]:
    true = reference()
    rows, ours = [], None
    for name, words in NAMES.items():
        found = in_a_process(peers if name in _ELSEWHERE else python, "--method", name)
        if "failed" in found:
            rows.append(f"| {words} | not run: {found['failed']} | | | | |")
            print(rows[-1], flush=True)
            continue
        # of the sampling, to reach the effective draws asked for
        full = max(1.0, ESS / found["ess"])
        fixed = (found["wall"] - found["sampling"], found["cpu"] - found["sampling_cpu"])
        wall, cpu = fixed[0] + full * found["sampling"], fixed[1] + full * found["sampling_cpu"]
        ours = ours or (wall, cpu)
        deviation = off(found, true)
        told = "" if full == 1.0 else f" ({found['ess']:.0f} reached, times scaled)"
        rows.append(
            f"| {words} | {wall:.1f} s ({wall / ours[0]:.1f}) | {cpu:.1f} s "
            f"({cpu / ours[1]:.1f}) | {found['ess'] / found['sampling_cpu']:.0f} "
            f"| {deviation:.1f} | {'yes' if deviation < _ERRORS else '**no**'}{told} |"
        )
        print(
            rows[-1],
            {
                key: found[key]
                for key in ("ess", "sampling", "sampling_cpu", "wall", "cpu", "memory")
                if key in found
            },
            flush=True,
        )
    return [
        f"Reference: emcee, {true['ess']:.0f} effective draws; parameters "
        f"{', '.join(true['names'])}.",
        "",
        "| method | wall to 4,000 effective draws (ratio) | CPU (ratio) | effective draws "
        "per CPU s of sampling | off by, MC errors | right |",
        "|---|---|---|---|---|---|",
        *rows,
        "",
        *_SETTINGS,
    ]


def campaign_of_runs(folder: Path, n_run: int, seed: int | None = None) -> Path:
    """A synthetic campaign of `n_run` runs of the two disks of data/replica, without unmodelled
    forces.  seed : of the angles, `n_run` for None.
    """
    design = (HERE.parent / "data" / "replica" / "design.toml").read_text()
    head, line = design.split("[[runs]]")[0], design[design.index("[line]") :]
    rng = np.random.default_rng(n_run if seed is None else seed)
    runs = []
    for i in range(n_run):
        body, (low, high) = (("heavy", (2.0, 8.0)), ("light", (1.0, 4.0)))[i % 2]
        phi, theta0 = rng.uniform(low, high), rng.uniform(55.0, 80.0)
        runs.append(
            f'[[runs]]\nname = "{body}-{i:04d}"\nbody = "{body}"\nphi_deg = '
            f"{phi:.2f}\ntheta0_deg = {theta0:.1f}\n"
        )
    path = folder / f"design{n_run}.toml"
    path.write_text(head + "".join(runs) + line)
    out = folder / f"runs{n_run}"
    subprocess.run(
        [sys.executable, "-m", "estim", "simulate", str(path), "--out", str(out)],
        cwd=HERE.parent,
        check=True,
        capture_output=True,
    )
    campaign = out / "campaign.toml"
    campaign.write_text(
        campaign.read_text().replace("g = 9.81\n", "g = 9.81\nunmodelled_force = 0\n", 1)
    )
    return campaign


def joint(path: str) -> Measured:
    """The joint analysis of all runs of a campaign with its report, without figures."""
    from estim import load_campaign
    from estim.pipeline import analyse
    from estim.reports.analysis import analysis_report

    began = time.process_time()
    campaign = load_campaign(Path(path))
    analysis = analyse(campaign, campaign.run_names, seed=SEED)
    analysed = time.process_time() - began
    analysis_report(campaign, analysis, figures="none")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {
        "analysis": analysed,
        "seconds": time.process_time() - began,
        "memory": peak,
        "status": str(analysis.diagnosis.status),
    }


def frames(n_obs: str) -> Measured:
    """A damped oscillation of `n_obs` points through `estim.fit_curve`, with draws where there are
    at most 3,000.
    """
    import estim

    rng, t = np.random.default_rng(SEED), np.linspace(0.0, 20.0, int(n_obs))
    y = 2.0 * np.exp(-t / 15.0) * np.cos(3.0 * t + 0.4) + 0.05 * rng.standard_normal(t.size)
    began = time.process_time()
    fit = estim.fit_curve(
        "a*exp(-x/tau)*cos(w*x + p)",
        t,
        y,
        u_y=0.05,
        start={"a": 1.8, "tau": 12.0, "w": 3.02, "p": 0.3},
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {"seconds": time.process_time() - began, "memory": peak, "status": str(fit.status)}


def slope(sizes: list[int], seconds: list[float], least: int) -> float:
    """Exponent of seconds against sizes, of those of at least `least`."""
    used = [i for i, n in enumerate(sizes) if n >= least]
    return (
        float(
            np.polyfit(np.log([sizes[i] for i in used]), np.log([seconds[i] for i in used]), 1)[0]
        )
        if len(used) > 1
        else math.nan
    )


def scaling_table(python: str, most_runs: int) -> list[str]:
    lines, drawn = list[str](), {}
    studies = {
        "joint runs": ([n for n in (1, 4, 16, 64, 256, 1000) if n <= most_runs], 16),
        "frames": ([30, 300, 3000, 30_000, 100_000], 3000),
    }
    with tempfile.TemporaryDirectory() as folder:
        for study, (sizes, least) in studies.items():
            found = []
            for n in sizes:
                argument = (
                    str(campaign_of_runs(Path(folder), n)) if study == "joint runs" else str(n)
                )
                found.append(
                    in_a_process(
                        python, "--joint" if study == "joint runs" else "--frames", argument
                    )
                )
                print(study, n, found[-1], flush=True)
            kept = [(n, one) for n, one in zip(sizes, found, strict=True) if "failed" not in one]
            exponent = slope([n for n, _ in kept], [one["seconds"] for _, one in kept], least)
            drawn[study] = (
                [n for n, _ in kept],
                [one["seconds"] for _, one in kept],
                [one["memory"] for _, one in kept],
                exponent,
                least,
            )
            rows = [
                f"| {n} | {one['seconds']:.2f} | {one['memory']:.0f} | {one['status']} |"
                if "failed" not in one
                else f"| {n} | | | {one['failed']} |"
                for n, one in zip(sizes, found, strict=True)
            ]
            head = ["", f"### {study}"] if lines else [f"### {study}"]
            lines += [
                *head,
                "",
                f"Exponent from {least} on: {exponent:.2f}.",
                "",
                f"| {study} | CPU s | peak memory MB | status |",
                "|---|---|---|---|",
                *rows,
            ]
    draw_scaling(drawn)
    return [*lines, "", "![scaling](scaling.png)"]


def draw_scaling(drawn: dict[str, tuple[list[int], list[float], list[float], float, int]]) -> None:
    from estim.drawing import BLUE, GREY, ORANGE, as_png, new_figure

    figure = new_figure(3.4)
    for ax, (study, (sizes, seconds, memory, exponent, least)) in zip(
        figure.subplots(1, len(drawn), squeeze=False)[0], drawn.items(), strict=True
    ):
        ax.loglog(sizes, seconds, "o-", color=BLUE, label="CPU time (s)")
        ax.loglog(sizes, memory, "s--", color=ORANGE, label="peak memory (MB)")
        if math.isfinite(exponent):
            from_here = [n for n in sizes if n >= least]
            line = (
                seconds[sizes.index(from_here[-1])]
                * (np.array(from_here) / from_here[-1]) ** exponent
            )
            ax.loglog(from_here, line, ":", color=GREY, lw=2.5, label=f"slope {exponent:.2f}")
        ax.set(xlabel=f"number of {study}")
        ax.legend(fontsize=8, frameon=False)
    (HERE / "scaling.png").write_bytes(as_png(figure))


def versions(python: str) -> str:
    names = ["numpy", "scipy", "emcee", "lmfit", "dynesty", "bumps", "pymc", "nutpie"]
    asked = (
        f"import importlib.metadata as m\nfor n in {names!r}:\n try: print(n, m.version(n))\n "
        "except m.PackageNotFoundError: pass"
    )
    return ", ".join(
        subprocess.run(
            [python, "-c", asked], capture_output=True, text=True, check=False
        ).stdout.split("\n")
    ).strip(", ")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--method", choices=METHODS)
    parser.add_argument("--joint")
    parser.add_argument("--frames")
    parser.add_argument("--peers", default=sys.executable)
    parser.add_argument(
        "--only",
        choices=("peers", "scaling", "batch", "rates"),
        help="makes one section anew and keeps the others",
    )
    parser.add_argument("--most-runs", type=int, default=64)
    asked = parser.parse_args()
    for told, measure in ((asked.method, one), (asked.joint, joint), (asked.frames, frames)):
        if told:
            print(json.dumps(measure(told)))
            return
    parts = HERE / "RESULTS.md"
    try:
        head = f"estim {version('estim')}"
    except PackageNotFoundError:
        head = "estim"
    text = [
        "# Benchmarks",
        "",
        "Made by `make bench` (benchmarks/bench.py says what is measured).  Trust the "
        "ratios: the machine was shared.",
        "",
        f"{head}, Python {platform.python_version()}, {versions(asked.peers)}; "
        f"{os.cpu_count()} cores.",
    ]
    sections = kept_sections(parts.read_text() if asked.only else "")
    if asked.only in (None, "peers"):
        sections[_PEERS] = peers_table(sys.executable, asked.peers)
    if asked.only in (None, "scaling"):
        sections[_SCALING] = scaling_table(sys.executable, asked.most_runs)
    if asked.only in (None, "batch"):
        from batch_memory import table

        sections[_BATCH] = table()
    if asked.only in (None, "rates"):
        from sampling_rates import table as rates_table

        sections[_RATES] = rates_table()
    for head in (_PEERS, _RATES, _SCALING, _BATCH):
        text += ["", f"## {head}", "", *sections[head]] if head in sections else []
    parts.write_text("\n".join(text) + "\n")


def kept_sections(text: str) -> dict[str, list[str]]:
    """Head -> lines of the sections of a file of results."""
    found = {}
    for part in ("\n" + text).split("\n## ")[1:]:
        head, _, lines = part.partition("\n")
        found[head] = lines.strip("\n").split("\n")
    return found


if __name__ == "__main__":
    main()
