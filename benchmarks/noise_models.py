"""What the choice of the noise model does to widths and coverage, and what gross outliers do;
prints Markdown tables.

    python benchmarks/noise_models.py [--campaigns 200] [--spoiled 100] [--seed 1]

All data are SYNTHETIC.  Three experiments, least squares only (value +- standard deviation of the
fit):

1. The eight runs of data/replica, each by itself with the campaign's priors, against
data/replica/truth.toml.
2. Fresh runs on a ramp of known tilt (4 degrees, R = 0.15 m, no resistance, 30 frames/s, 1 mm):
gamma, kappa and theta0 drawn from their priors, the first frame at a random moment, new errors.
Once with positions counted exactly from the release, once with a zero that is wrong by a normal
error of 1 mm, as large as that of a reading.
3. Fresh runs as in 2 with an exact zero, 5 % of the frames (at least two) moved by 20 to 60
standard deviations either way.

Every model sees the same files.  Speeds are fit between five standard deviations from the release
and from the farthest point; positions are all fit.  Takes about 8 minutes on one core.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.campaign import Campaign, load_campaign
from estim.checks.outliers import find_outliers
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.model import Body, ascends
from estim.model.simulate import frame_times, simulate_positions

FloatArray = NDArray[np.float64]
PROJECT = Path(__file__).resolve().parents[1]

SIGMA, INTERVAL, RADIUS, TILT, RAMP = 0.001, 1.0 / 30.0, 0.15, 4.0, 0.877
SIGMA_V = SIGMA / (np.sqrt(2.0) * INTERVAL)  # of one central difference
QUANTITIES = ("gamma", "kappa", "theta0")
SYMBOLS = {"gamma": "γ", "kappa": "κ", "theta0": "θ₀ (rad)"}
PRIORS = {"gamma": (0.187, 0.03), "kappa": (0.45, 0.10), "theta0": (1.05, 0.10)}  # mean, sd
MODELS = {
    "positions, zero known": ("offset_m = 0.0", 'model = "positions", sigma_x_m = 0.001'),
    "positions, zero uncertain": ("", 'model = "positions", sigma_x_m = 0.001'),
    "differentiated": ("", 'model = "differentiated", sigma_x_m = 0.001, derivative = "central"'),
    "differentiated, zero uncertain": (
        'offset_m = "0.0000(10)"',
        'model = "differentiated", sigma_x_m = 0.001, derivative = "central"',
    ),
    "independent": (
        "",
        f'model = "independent", sigma_v_m_s = {SIGMA_V:.9f}, derivative = "central"',
    ),
}
TAILS = {"none": "", "student-t": ', robust = "student-t"', "mixture": ', robust = "mixture"'}
BY_HAND = "none, the bad frames left out by hand"


@dataclass(frozen=True, eq=False)
class Experiment:
    """One simulated run: times (n,) s, positions (n,) m, and the true values of the unknowns."""

    t: FloatArray
    x: FloatArray
    truth: Mapping[str, float]


def simulate(rng: np.random.Generator) -> Experiment:
    """A run whose gamma, kappa and theta0 are drawn from the priors (again where the body would not
    ascend for half a second).
    """
    while True:
        truth = {name: float(rng.normal(mean, sd)) for name, (mean, sd) in PRIORS.items()}
        body = Body(radius=RADIUS, gamma=truth["gamma"], kappa=truth["kappa"])
        motion = {"phi": np.radians(TILT), "theta0": truth["theta0"]}
        if not ascends(body, **motion):
            continue
        t = frame_times(body, **motion, g=9.81, interval=INTERVAL, x_end=RAMP, rng=rng)
        if t.size >= 15:
            return Experiment(
                t, simulate_positions(t, body, **motion, g=9.81, sigma_x=SIGMA, rng=rng), truth
            )


def pattern(folder: Path, zero: str, noise: str) -> Campaign:
    """A campaign with one run that stands for all simulated ones."""
    priors = {
        name: f'{{prior = "normal", mean = {mean}, sd = {sd}}}'
        for name, (mean, sd) in PRIORS.items()
    }
    (folder / "c.toml").write_text(f"""title = "simulated runs"
kind = "synthetic"
[shared]
g = 9.81
radius_m = {RADIUS}
phi_deg = {TILT}
[bodies.b]
gamma = {priors["gamma"]}
kappa = {priors["kappa"]}
[[runs]]
name = "r"
body = "b"
file = "r.csv"
theta0_rad = {priors["theta0"]}
{zero}
noise = {{{noise}}}
""")
    (folder / "r.csv").write_text(
        "t_s,x_m\n" + "".join(f"{INTERVAL * i},{0.02 * i}\n" for i in range(30))
    )
    return load_campaign(folder / "c.toml")


def fit(campaign: Campaign, t: FloatArray, x: FloatArray) -> Fit:
    """The fit of other data in the place of the campaign's run."""
    table = replace(
        campaign.tables["r"],
        columns=MappingProxyType({"t_s": t, "x_m": x}),
        lines=np.arange(t.size),
    )
    problem = replace(campaign, tables=MappingProxyType({"r": table})).problem(["r"])
    start = problem.start()
    if "release_time[r]" in problem.names:
        start[problem.names.index("release_time[r]")] = t[0] - 0.5 * INTERVAL
    if "outlier_fraction[r]" in problem.names:
        start[problem.names.index("outlier_fraction[r]")] = 0.05
    return fit_least_squares(problem, start=start)


def estimates(found: Fit) -> dict[str, tuple[float, float]]:
    """Quantity -> value and standard deviation."""
    sd = np.sqrt(np.diag(found.cov))
    return {
        name.split("[")[0]: (float(v), float(u))
        for name, v, u in zip(found.names, found.values, sd, strict=True)
    }


def on_replica() -> list[str]:
    """Widths and hits for the runs of data/replica."""
    import tomllib

    replica = PROJECT / "data" / "replica"
    source = (
        (replica / "campaign.toml")
        .read_text(encoding="utf-8")
        .replace('file = "', f'file = "{replica.as_posix()}/')
    )
    truth = tomllib.loads((replica / "truth.toml").read_text(encoding="utf-8"))
    rows = []
    for name, (zero, noise) in MODELS.items():
        text = source.replace(
            'noise = {sigma_x_m = 0.001, derivative = "central"}', f"noise = {{{noise}}}\n{zero}"
        )
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "c.toml").write_text(text, encoding="utf-8")
            campaign = load_campaign(Path(folder) / "c.toml")
        sds, pulls = [], []
        for run in campaign.run_names:
            problem = campaign.problem([run])
            found = fit_least_squares(problem)
            body = next(r.body for r in campaign.source.runs if r.name == run)
            names = [f"gamma[{body}]", f"kappa[{body}]", f"theta0[{run}]"]
            chosen = [found.names.index(n) for n in names]
            sds.append(np.sqrt(np.diag(found.cov))[chosen])
            pulls.append((found.values[chosen] - [truth[n] for n in names]) / sds[-1])
        inside = [f"{int(np.sum(np.abs(pulls) < k))} of {np.size(pulls)}" for k in (1.0, 1.96)]
        rows.append(_row(name, *[f"{u:.4f}" for u in np.mean(sds, axis=0)], *inside))
    return _table(
        ["model", *[f"u({SYMBOLS[q]})" for q in QUANTITIES], "truth within 1 sd", "within 1.96 sd"],
        rows,
    )


def on_fresh_runs(n: int, rng: np.random.Generator) -> list[str]:
    """Median widths and coverage of each model, with an exact zero and with a wrong one."""
    runs = [simulate(rng) for _ in range(n)]
    zeros = SIGMA * rng.standard_normal(n)
    rows = []
    for name, (zero, noise) in MODELS.items():
        with tempfile.TemporaryDirectory() as folder:
            campaign = pattern(Path(folder), zero, noise)
        for words, wrong in (("exact", 0.0), ("off by 1 mm (sd)", 1.0)):
            found = [
                estimates(fit(campaign, run.t, run.x + wrong * z, rng))
                for run, z in zip(runs, zeros, strict=True)
            ]
            cells = []
            for q in QUANTITIES:
                pulls = np.array(
                    [(e[q][0] - run.truth[q]) / e[q][1] for e, run in zip(found, runs, strict=True)]
                )
                cells.append(
                    " / ".join(
                        _share(np.mean(np.abs(pulls) < k), p, n)
                        for k, p in ((0.9944579, 0.68), (1.959964, 0.95))
                    )
                )
            widths = [f"{np.median([e[q][1] for e in found]):.4f}" for q in QUANTITIES]
            rows.append(_row(name, words, *widths, *cells))
            print(".", end="", file=sys.stderr, flush=True)
    heads = [f"u({SYMBOLS[q]})" for q in QUANTITIES] + [
        f"{SYMBOLS[q].split()[0]}: 68 / 95 %" for q in QUANTITIES
    ]
    return _table(["model", "zero of x", *heads], rows)


@dataclass(frozen=True, eq=False)
class Spoiled:
    """What outliers did to one fit: |shift of gamma| and its sd, both in sds of the clean fit; (4,)
    found, outliers, false alarms, good frames.
    """

    shift: float
    width: float
    named: FloatArray


def with_outliers(n: int, rng: np.random.Generator) -> list[str]:
    """What 5 % of gross outliers do to gamma, and whether they are found."""
    return outlier_table([spoil(stream) for stream in rng.spawn(n)])


def spoil(rng: np.random.Generator) -> dict[str, Spoiled]:
    """Shape of the errors -> what it makes of one spoiled run."""
    with tempfile.TemporaryDirectory() as folder:
        campaigns = {
            name: pattern(
                Path(folder), "offset_m = 0.0", f'model = "positions", sigma_x_m = 0.001{tails}'
            )
            for name, tails in TAILS.items()
        }
    run = simulate(rng)
    clean, u = estimates(fit(campaigns["none"], run.t, run.x))["gamma"]
    bad = rng.choice(run.t.size, max(2, round(0.05 * run.t.size)), replace=False)
    kept = np.setdiff1d(np.arange(run.t.size), bad)
    x = run.x.copy()
    x[bad] += rng.choice([-1.0, 1.0], bad.size) * rng.uniform(20.0, 60.0, bad.size) * SIGMA
    fits = {name: fit(campaign, run.t, x) for name, campaign in campaigns.items()}
    fits[BY_HAND] = fit(campaigns["none"], run.t[kept], run.x[kept])
    results = {}
    for name, found in fits.items():
        value, sd = estimates(found)["gamma"]
        named = np.zeros(4)
        for outliers in find_outliers(found.posterior, found.values[None, :]):
            hits = np.isin(bad, outliers.frames).sum()
            named[:] = hits, bad.size, outliers.frames.size - hits, kept.size
        results[name] = Spoiled(abs(value - clean) / u, sd / u, named)
    return results


def outlier_table(spoiled: list[dict[str, Spoiled]]) -> list[str]:
    rows = []
    for name in spoiled[0]:
        size = np.array([one[name].shift for one in spoiled])
        quantiles = [f"{q:.2f}" for q in np.quantile(size, (0.5, 0.9, 1.0))]
        found, total, false, good = np.sum([one[name].named for one in spoiled], axis=0)
        told = [f"{found:.0f} of {total:.0f}", f"{false:.0f} of {good:.0f}"] if total else ["", ""]
        width = np.median([one[name].width for one in spoiled])
        rows.append(_row(name, *quantiles, f"{np.mean(size < 0.5):.0%}", f"{width:.2f}", *told))
    heads = [
        "`robust`",
        "median shift",
        "90 %",
        "largest",
        "below 0.5 sd",
        "u(γ) / u(γ) without outliers",
        "outliers named",
        "false alarms",
    ]
    return _table(heads, rows)


def _share(share: float, claimed: float, n: int) -> str:
    """A share of `n` in per cent, bold where more than 3 Monte-Carlo standard deviations from what
    is claimed.
    """
    off = abs(share - claimed) > 3.0 * np.sqrt(claimed * (1.0 - claimed) / n)
    return f"**{100 * share:.0f}**" if off else f"{100 * share:.0f}"


def _row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def _table(heads: list[str], rows: list[str]) -> list[str]:
    return [_row(*heads), "|" + "---|" * len(heads), *rows, ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--spoiled", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    fresh, spoiled = np.random.default_rng(chosen.seed).spawn(3)[1:]
    print(
        "The eight runs of data/replica, each by itself (mean widths):\n",
        *on_replica(),
        sep="\n",
        flush=True,
    )
    print(
        f"{chosen.campaigns} fresh runs (median widths; coverage in %):\n",
        *on_fresh_runs(chosen.campaigns, fresh),
        sep="\n",
        flush=True,
    )
    print(
        f"{chosen.spoiled} runs, 5 % of the frames gross outliers (|shift of γ| in sd of "
        "the clean fit):\n",
        sep="\n",
        flush=True,
    )
    print(*with_outliers(chosen.spoiled, spoiled), sep="\n")


if __name__ == "__main__":
    main()
