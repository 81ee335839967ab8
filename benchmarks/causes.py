"""Is the right cause named, and how often is a wrong one?  Candidates of `estim fit --explain` on
data solved by SciPy.  Writes a Markdown table.

    python benchmarks/causes.py [--replicas 40] [--only NAME ...] [--priors sharp] [--noise speeds]

Each line: a disturbance of one run (`truth/recordings.py`); how often its own cause gains most, is
tied with the one that does, how often something is found at all (of "nothing": false alarms), and
which are tied with it otherwise.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from truth.recordings import (
    BASE,
    DISTURBANCES,
    NOISES,
    PRIORS,
    Camera,
    Disturbance,
    ar1,
    changed,
    sagging,
    write_campaign,
)

from estim.campaign import load_campaign
from estim.explanation import explain

WEIGHT = BASE.mass * BASE.g * BASE.radius
CASES = {  # disturbance -> the candidate that is it
    "none": (DISTURBANCES["none"], ""),
    "clock": (Disturbance("clock 3 % fast", camera=Camera(scale_t=0.03)), "clock"),
    "scale": (Disturbance("length scale 3 % long", camera=Camera(scale_x=0.03)), "length_scale"),
    "viscous": (Disturbance("viscous drag .3/s", changed(viscous=0.3 * BASE.mass)), "viscous_drag"),
    "quadratic": (
        Disturbance("quadratic drag .5/m", changed(quadratic=0.5 * BASE.mass)),
        "quadratic_drag",
    ),
    "push": (DISTURBANCES["push"], "start"),
    "sag": (Disturbance("ramp sags 2 mm on .5 m", sagging(0.002, 0.5, 0.03)), "sag"),
    "once": (
        Disturbance(
            "moment once per turn, .02",
            lambda r, b: replace(b, once=(0.02 * WEIGHT, r.uniform(0.0, 6.28))),
        ),
        "moment_once",
    ),
    "twice": (
        Disturbance(
            "moment twice per turn, .02",
            lambda r, b: replace(b, twice=(0.02 * WEIGHT, r.uniform(0.0, 6.28))),
        ),
        "moment_twice",
    ),
    "distortion": (Disturbance("image bowed by 40 mm", camera=Camera(bow=0.04)), "distortion"),
    "load": (
        Disturbance(
            "resistance .03 of the load", changed(load_resistance=0.03, rolling_resistance=0.0)
        ),
        "load_resistance",
    ),
    "alike": (Disturbance("AR(1) noise, .9", camera=Camera(noise=ar1(0.9))), "correlated_errors"),
    "blur": (DISTURBANCES["blur"], "blur"),
}


def named(name: str, priors: str, noise: str, replica: int) -> tuple[bool, tuple[str, ...]]:
    """Whether anything is found, and the names of the first and those that are tied with it."""
    key = int.from_bytes(hashlib.sha256(f"{name} {priors} {noise}".encode()).digest()[:4], "big")
    with tempfile.TemporaryDirectory() as folder:
        write_campaign(
            Path(folder),
            CASES[name][0],
            priors=priors,
            noise=noise,
            rng=np.random.default_rng([7, key, replica]),
        )
        suspects = load_campaign(Path(folder) / "campaign.toml").suspects(["r"])
        found = explain(suspects, rng=np.random.default_rng(1))
    return bool(found.found), tuple(one.name for one in found.tied)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replicas", type=int, default=40)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--priors", nargs="+", choices=PRIORS, default=["sharp"])
    parser.add_argument("--noise", nargs="+", choices=NOISES, default=["speeds"])
    chosen = parser.parse_args()
    heads = [
        "disturbance",
        "priors",
        "read as",
        "first",
        "first or tied",
        "anything found",
        "tied with the first",
    ]
    print("| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), sep="\n", flush=True)
    for name in chosen.only:
        for priors in chosen.priors:
            for noise in chosen.noise:
                outcomes = [named(name, priors, noise, i) for i in range(chosen.replicas)]
                n, right = len(outcomes), CASES[name][1]
                first = sum(names[:1] == (right,) for _, names in outcomes) / n
                tied = sum(right in names for _, names in outcomes) / n
                others = Counter(
                    other for _, names in outcomes for other in names if other != right
                ).most_common(4)
                said = ", ".join(f"{other} {count}" for other, count in others)
                found = sum(any_found for any_found, _ in outcomes) / n
                print(
                    f"| {CASES[name][0].words} | {priors} | {noise} | {first:.0%} | "
                    f"{tied:.0%} | {found:.0%} | {said} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
