"""Do intervals hold the truth when the curve lacks something, with the unmodelled force of the
default and without it?  Writes a Markdown table.

    python benchmarks/unmodelled_force.py [--replicas 20] [--only NAME ...] [--seed 1]

Recordings of `truth/recordings.py` (the motion solved by SciPy), differentiated speeds, default
priors.  Coverage: share of central 68 and 95 % intervals of gamma, kappa, theta0, phi and c_rr that
hold the true value, whatever the status, and for theta0 alone, which the start and the force touch
most.  Width: mean posterior sd of theta0 over that without the force on the same recordings.  c_rr
is compared with its true value, of which the average over the track may differ: on a curved ramp it
does.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from truth.recordings import DISTURBANCES, write_campaign

from estim.campaign import load_campaign
from estim.common import EstimError
from estim.pipeline import analyse
from estim.sampling import Target

CHOSEN = ("none", "ramp", "push", "ar1-9")
QUICK = Target(ess=400.0, n_ensemble=2)


def outcome(name: str, replica: int, seed: int, *, force: bool) -> tuple[str, list[float], float]:
    """Status, share of the draws below each true value, and sd of theta0 of one recording."""
    rng = np.random.default_rng([seed, CHOSEN.index(name) if name in CHOSEN else 99, replica])
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        truth = write_campaign(
            folder, DISTURBANCES[name], priors="default", noise="speeds", rng=rng
        )
        if not force:
            path = folder / "campaign.toml"
            path.write_text(
                path.read_text(encoding="utf-8").replace(
                    "[shared]\n", "[shared]\nunmodelled_force = 0\n"
                ),
                encoding="utf-8",
            )
        try:
            analysis = analyse(
                load_campaign(folder / "campaign.toml"), ["r"], seed=replica + 1, target=QUICK
            )
        except EstimError as error:
            print(f"{name} {replica}: {error}", file=sys.stderr)
            return "refused", [], np.nan
    names, draws = analysis.problem.names, analysis.chain.flat
    below = [
        float(np.mean(draws[:, names.index(parameter)] < value))
        for parameter, value in truth.items()
    ]
    return analysis.diagnosis.status, below, float(draws[:, names.index("theta0[r]")].std())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicas", type=int, default=20)
    parser.add_argument("--only", nargs="*", default=CHOSEN)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    print(
        "| disturbance | force | statuses | all, 68 % | 95 % | θ₀, 68 % | 95 % | width of "
        "θ₀ |\n|---|---|---|---|---|---|---|---|"
    )
    for name in chosen.only:
        narrow = 1.0
        for force in (False, True):
            found = [
                outcome(name, replica, chosen.seed, force=force)
                for replica in range(chosen.replicas)
            ]
            rank = np.array([below for _, below, _ in found if below])
            width = float(np.nanmean([sd for _, _, sd in found]))
            narrow = narrow if force else width
            held = [
                f"{np.mean(np.abs(part - 0.5) < 0.5 * p):.2f}"
                for part in (rank, rank[:, 2])
                for p in (0.68, 0.95)
            ]
            statuses = ", ".join(
                f"{status} {n}"
                for status, n in Counter(str(status) for status, _, _ in found).most_common()
            )
            print(
                f"| {DISTURBANCES[name].words} | {'0.02' if force else '—'} | {statuses} | "
                f"{' | '.join(held)} | {width / narrow:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
