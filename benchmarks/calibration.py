"""Do posteriors tell the truth about their uncertainty, for every noise model?  Prints a Markdown
table.

    python benchmarks/calibration.py [--trials 1000] [--only NAME ...] [--what sbc|coverage] [--jobs
    2] [--seed 1]

One run of a disk (gamma 0.187, kappa 0.45, tilt 4 degrees, released at 60 degrees), every unknown
with a proper prior.  Each trial draws truths from the priors (`--what coverage`: takes the fit, and
draws the stated measurements anew), simulates the table, and analyses it as `estim fit` would:
`estim.calibration.calibration`.  p: of uniform ranks, smallest over all quantities with its name;
then the share of the 68 and 95 % intervals that held the truth, mean over quantities and the one
farthest off in Monte-Carlo standard deviations.  The two last lines analyse the data wrongly on
purpose and must fail.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.calibration.calibration import Calibration, findings, run_trials
from estim.calibration.experiment import campaign_design
from estim.calibration.trial import What
from estim.campaign import Campaign, load_campaign
from estim.campaign.campaign_file import NoiseTable
from estim.fitting.least_squares import fit_least_squares
from estim.model import Body, trajectory

CAMPAIGN = """
title = "one run for calibration"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
phi_deg = "4.0(2)"
[bodies.heavy]
gamma = "0.187(10)"
kappa = {{prior = "uniform", low = 0.2, high = 0.8}}
[[runs]]
name = "r"
body = "heavy"
file = "r.csv"
theta0_deg = "60(2)"
{extra}
noise = {noise}
"""
CLOCK = 'release_time_s = "0.000(5)"\noffset_m = "0.0000(5)"'


class Case(NamedTuple):
    """A noise model and, where it is to be analysed wrongly, the noise that is assumed."""

    noise: str
    n_frame: int = 24
    extra: str = ""
    analysed: NoiseTable | None = None


CASES = {
    "independent": Case('{model = "independent", sigma_v_m_s = 0.02}'),
    "independent, errors in x": Case(
        '{model = "independent", sigma_v_m_s = 0.02, sigma_x_m = 0.002}'
    ),
    "independent, sigma inferred": Case(
        '{model = "independent", sigma_v_m_s = {prior = "log-normal", median = 0.02, log_sd = 0.5}}'
    ),
    "independent, mixture": Case('{model = "independent", sigma_v_m_s = 0.02, robust = "mixture"}'),
    "differentiated": Case('{model = "differentiated", sigma_x_m = 0.001}'),
    "differentiated, sigma inferred": Case(
        '{model = "differentiated", sigma_x_m = {prior = "log-normal", median = 0.001, '
        "log_sd = 0.5}}"
    ),
    "positions": Case('{model = "positions", sigma_x_m = 0.001}', 14, CLOCK),
    "positions, student-t": Case(
        '{model = "positions", sigma_x_m = 0.001, robust = "student-t"}', 14, CLOCK
    ),
    "positions, mixture": Case(
        '{model = "positions", sigma_x_m = 0.001, robust = "mixture"}', 14, CLOCK
    ),
    "WRONG: sigma half as large": Case(
        '{model = "differentiated", sigma_x_m = 0.001}', analysed=NoiseTable(sigma_x_m=0.0005)
    ),
    "WRONG: differences as independent": Case(
        '{model = "differentiated", sigma_x_m = 0.001}',
        48,
        analysed=NoiseTable(model="independent", derivative="central", sigma_v_m_s=0.024),
    ),
}


def campaign(case: Case, folder: Path) -> Campaign:
    """The case's campaign, with data of the stated noise at the centres of the priors."""
    rng = np.random.default_rng(1)
    t = np.linspace(0.04, 1.30, case.n_frame)
    (x,), (v,) = trajectory(
        t,
        Body(radius=0.15, gamma=0.187, kappa=0.45),
        phi=np.radians(4.0),
        theta0=np.radians(60.0),
        g=9.81,
    )
    measured = "independent" in case.noise
    x, v = (
        (x, v + 0.02 * rng.standard_normal(t.size))
        if measured
        else (x + 0.001 * rng.standard_normal(t.size), v)
    )
    columns = {"t_s": t, "x_m": x} | ({"v_m_s": v} if measured else {})
    rows = "\n".join(
        ",".join(f"{cell:.9g}" for cell in row) for row in zip(*columns.values(), strict=True)
    )
    (folder / "r.csv").write_text(",".join(columns) + "\n" + rows + "\n")
    (folder / "campaign.toml").write_text(CAMPAIGN.format(noise=case.noise, extra=case.extra))
    return load_campaign(folder / "campaign.toml")


def calibrate(
    case: Case, *, what: What, n_trial: int, jobs: int, seed: int, ess: float
) -> Calibration:
    """The trials of one case."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = campaign(case, Path(folder))
        fit = fit_least_squares(loaded.problem(["r"]))
        design = campaign_design(loaded, ["r"], fitted=fit.values, analysed=case.analysed)
        return run_trials(design, fit, what, n_trial=n_trial, jobs=jobs, seed=seed, ess=ess)


def row(name: str, result: Calibration, seconds: float) -> str:
    """One line of the table."""
    names = list(result.reported)
    p_values = {n: result.p_value(n) for n in names}
    worst = min(p_values, key=p_values.__getitem__)
    shares = np.array([result.share(n) for n in names])
    cells = [name, str(result.n_trial), f"{p_values[worst]:.2g} ({worst})"]
    for i, p in enumerate(result.probabilities):
        off = (shares[:, i] - p) / result.share_sd()[i]
        far = int(np.argmax(np.abs(off)))
        cells.append(
            f"{shares[:, i].mean():.1%}, {names[far]} {shares[far, i]:.1%} ({off[far]:+.1f} sd)"
        )
    how = ", ".join(f"{count} {engine}" for engine, count in sorted(result.how.items()))
    cells += [
        how,
        f"{result.n_short} / {result.n_failed} / {result.n_rejected}",
        "fails" if findings(result) else "passes",
        f"{seconds:.0f} s",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--what", choices=["sbc", "coverage"], default="sbc")
    parser.add_argument("--ess", type=float, default=500.0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(
        "| noise | trials | least p | 68 % intervals | 95 % intervals | engine | short / "
        "failed / drawn again | verdict | time |"
    )
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    details = []
    for name in options.only:
        start = time.perf_counter()
        result = calibrate(
            CASES[name],
            what=options.what,
            n_trial=options.trials,
            jobs=options.jobs,
            seed=options.seed,
            ess=options.ess,
        )
        print(row(name, result, time.perf_counter() - start), flush=True)
        details.append(f"\n{name}")
        for n in result.reported:
            share = result.share(n)
            details.append(
                f"  {n:24s} p = {result.p_value(n):.3g}  68 %: {share[0]:.1%}  95 %: {share[1]:.1%}"
            )
        details += [f"  FINDING {finding.sentence}" for finding in findings(result)]
        details += [
            f"  FAILURE {count} x {sentence}" for sentence, count in result.failures.items()
        ]
    print("\n".join(details))


if __name__ == "__main__":
    main()
