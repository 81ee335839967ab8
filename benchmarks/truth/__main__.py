"""How far is a result off, and does it say so, when something is wrong that nobody told?  Writes
two Markdown tables.

    python benchmarks/truth [--replicas 20] [--only NAME ...] [--priors default sharp] [--noise
    speeds positions | --joint]
                            [--peers | --slow-peers] [--derived] [--jobs 2] [--seed 1] [--log FILE]
                            [--out FILE] [--keep FOLDER]

Each line: a disturbance of one run (`recordings.py`; the motion is solved by SciPy and shares no
code with `estim/model/`), analysed as `estim fit` does by default, with no hint; beside it, if
asked for, what lmfit makes of the same recordings (`peers.py`).  --joint: three runs of one body at
three tilts of one ramp instead, analysed as `estim fit --joint` does; θ₀ and φ count once for
each run.
The true c_rr is its average over the track, drag and hills included.  --derived (with --noise
speeds): what follows from these, too, as a method of its own: the inertia ratio j, the effective
slope s, the turning point.  Shift: mean of (posterior mean - true value)/posterior sd over the
replicas, whatever the status.  Coverage: share of central 68 and 95 % intervals of the five
quantities that hold the true value, among results with status `ok`; behind it the Monte-Carlo
standard deviation, of the shares of single recordings.  Last column: share of results that are `ok`
with some |z| > 4.

--only prior (with --priors default --noise speeds): the truth, force and start included, is drawn
from what the analysis assumes, and each recording is analysed with `unmodelled_force = 0` too,
which is wrong.  Ranks of the true values must then be uniform: simulation-based calibration.

--log keeps every outcome as it comes, one line of JSON each; what it already holds is not made
again.  `outcomes.jsonl.gz` holds those of `RESULTS-truth.md`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import chisquare

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from estim.campaign import load_campaign
from estim.common import EstimError
from estim.pipeline import Analysis, analyse
from truth.motion import solve
from truth.peers import CENTRAL, intervals_of_lmfit
from truth.recordings import (
    BASE,
    DISTURBANCES,
    FREE,
    JOINT,
    LONGEST,
    NOISES,
    OF_RUN,
    PRIORS,
    write_campaign,
)

SYMBOLS = {"gamma": "γ", "kappa": "κ", "theta0": "θ₀", "phi": "φ", "rolling_resistance": "c_rr"}
ESTIM, OF_DRAWS = "estim", "estim: j, s, turning point"
COMPLETE = "estim, no force"
DRAWN = "prior"
MEDIAN_FORCE = 0.0135  # of the half-normal prior of scale .02
N_BIN = 10  # of rank histograms


@dataclass(frozen=True)
class Case:
    """One recording.  peers : 0, 1 for lmfit's least squares beside it, 2 for its profiles and
    emcee as well.
    """

    name: str
    priors: str
    noise: str
    replica: int
    seed: int
    peers: int = 0
    keep: str | None = None
    derived: bool = False

    @property
    def line(self) -> tuple[str, str, str]:
        return self.name, self.priors, self.noise


@dataclass(frozen=True)
class Outcome:
    """What one method makes of one recording; z, inside68 and inside95 of the quantities in the
    order of `FREE`, θ₀ and φ of each run.

    Empty where it has no result.
    """

    name: str
    priors: str
    noise: str
    replica: int
    seed: int
    method: str
    status: str
    z: Sequence[float] = ()
    inside68: Sequence[bool] = ()
    inside95: Sequence[bool] = ()
    seconds: float = 0.0
    below: Sequence[float] = ()  # share of the draws below each true value: its rank
    force: Sequence[float] = ()  # amplitude and length of the true one, where it is drawn


def generator(case: Case) -> np.random.Generator:
    """The random numbers of one recording: a replica's noise is the same whatever else is run
    beside it.
    """
    key = int.from_bytes(hashlib.sha256(" ".join(case.line).encode()).digest()[:4], "big")
    return np.random.default_rng([case.seed, key, case.replica])


def outcomes(case: Case) -> list[Outcome]:
    """Make one recording and analyse it."""
    rng = generator(case)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(case.keep, *case.line, str(case.replica)) if case.keep else Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        truth = write_campaign(
            folder, DISTURBANCES[case.name], priors=case.priors, noise=case.noise, rng=rng
        )
        found = _by_default(case, folder, truth)
        if case.name == DRAWN:
            force = DISTURBANCES[DRAWN].motion(generator(case), BASE).gusts
            path = folder / "campaign.toml"
            text = path.read_text(encoding="utf-8")
            path.write_text(text.replace("[shared]", "[shared]\nunmodelled_force = 0"), "utf-8")
            found += [replace(o, method=COMPLETE) for o in _by_default(case, folder, truth)]
            found = [replace(o, force=(force.amplitude, force.length)) for o in found]
        if case.peers and case.noise == "speeds":
            sides = intervals_of_lmfit(folder, truth, slow=case.peers > 1, seed=case.replica + 1)
            for method, intervals in sides.items():
                if intervals is None:
                    found.append(_outcome(case, method, "no interval"))
                    continue
                inside = [
                    [bool(low <= value <= high) for low, high in ends]
                    for ends, value in zip(intervals, truth.values(), strict=True)
                ]
                found.append(
                    _outcome(
                        case,
                        method,
                        "given",
                        (),
                        [one[0] for one in inside],
                        [one[1] for one in inside],
                    )
                )
    return found


def _outcome(
    case: Case,
    method: str,
    status: str,
    z: Sequence[float] = (),
    inside68: Sequence[bool] = (),
    inside95: Sequence[bool] = (),
    seconds: float = 0.0,
    below: Sequence[float] = (),
) -> Outcome:
    return Outcome(
        *case.line, case.replica, case.seed, method, status, z, inside68, inside95, seconds, below
    )


def _by_default(case: Case, folder: Path, truth: dict[str, float]) -> list[Outcome]:
    start = time.process_time()
    try:
        campaign = load_campaign(folder / "campaign.toml")
        analysis = analyse(campaign, campaign.run_names, seed=case.replica + 1)
    except EstimError as error:
        print(f"{case}: {error}", file=sys.stderr)
        return [_outcome(case, ESTIM, "refused", seconds=time.process_time() - start)]
    except Exception as error:
        print(f"{case}: {type(error).__name__}: {error}", file=sys.stderr)
        return [_outcome(case, ESTIM, "CRASHED", seconds=time.process_time() - start)]
    draws, status = analysis.chain.flat, str(analysis.diagnosis.status)
    columns = [draws[:, analysis.problem.names.index(parameter)] for parameter in truth]
    found = [
        _outcome(
            case,
            ESTIM,
            status,
            *against(columns, list(truth.values())),
            time.process_time() - start,
            [float(np.mean(c < true)) for c, true in zip(columns, truth.values(), strict=True)],
        )
    ]
    if case.derived:
        columns, true = _derived(case, analysis, truth)
        found.append(_outcome(case, OF_DRAWS, status, *against(columns, true)))
    return found


def against(
    columns: Sequence[np.ndarray], truth: Sequence[float]
) -> tuple[list[float], list[bool], list[bool]]:
    """z, and whether the central 68 and 95 % intervals hold the true value, of each column of
    draws.
    """
    # a motion that never stops stops beyond every place
    told = [c[np.isfinite(c)] for c in columns]
    z = [float((c.mean() - true) / c.std()) for c, true in zip(told, truth, strict=True)]
    below = np.array([np.mean(c < true) for c, true in zip(columns, truth, strict=True)])
    narrow, wide = ([bool(one) for one in np.abs(below - 0.5) < 0.5 * p] for p in CENTRAL)
    return z, narrow, wide


def _derived(
    case: Case, analysis: Analysis, truth: dict[str, float]
) -> tuple[list[np.ndarray], list[float]]:
    """Draws and true values of the inertia ratio, the effective slope and, with what start and
    force add, the turning point (m).

    The turning point as the camera's scale reads it.
    """
    (run,), gamma, kappa = analysis.problem.runs, truth["gamma[b]"], truth["kappa[b]"]
    phi, c_rr = truth["phi[r]"], truth["rolling_resistance"]
    disturbance = DISTURBANCES[case.name]
    motion = solve(disturbance.motion(generator(case), BASE), LONGEST)
    stops = (1.0 + disturbance.camera.scale_x) * float(motion(np.array([motion.first_rest]))[0][0])
    true = [(1.0 - gamma) * kappa + gamma, np.sin(phi) + c_rr * np.cos(phi), stops]
    derived = run.derived(run.bind(analysis.problem.named(analysis.chain.flat)))
    end = analysis.bands[0].end
    return [np.ravel(derived["inertia_ratio"].values), np.ravel(derived["slope"].values), end], true


def row(name: str, priors: str, noise: str, found: Sequence[Outcome]) -> str:
    done = [o for o in found if o.z]
    ok = [o for o in done if o.status == "ok"]
    z = np.array([by_quantity(o.z) for o in done]).reshape(-1, len(FREE))
    shifts = [
        f"{m:+.1f}" if len(done) else ""
        for m in (z.mean(axis=0) if len(done) else np.zeros(len(FREE)))
    ]
    statuses = ", ".join(
        f"{status} {count}" for status, count in Counter(o.status for o in found).most_common()
    )
    confident = sum(max(map(abs, o.z)) > 4.0 for o in ok) / len(found)
    seconds = f"{np.median([o.seconds for o in found]):.1f}"
    cells = [
        DISTURBANCES[name].words,
        priors,
        noise,
        str(len(found)),
        *shifts,
        statuses,
        coverage(ok),
        f"{confident:.0%}",
        seconds,
    ]
    return "| " + " | ".join(cells) + " |"


def by_quantity(values: Sequence[float]) -> list[float]:
    """One for each of `FREE`: the mean over the runs of what each of them has."""
    n_run = 1 + (len(values) - len(FREE)) // len(OF_RUN)
    ends = np.cumsum([n_run if name in OF_RUN else 1 for name in FREE])
    return [float(np.mean(part)) for part in np.split(np.asarray(values), ends[:-1])]


def coverage(found: Sequence[Outcome]) -> str:
    """Shares of intervals that hold the true value, with the Monte-Carlo sd: that of the mean over
    recordings, whose five intervals are alike.
    """
    if not found:
        return ""
    cells = []
    for each in (np.array([o.inside68 for o in found]), np.array([o.inside95 for o in found])):
        own = each.mean(axis=1)
        error = f"({np.std(own, ddof=1) / np.sqrt(own.size) * 100:.0f})" if own.size > 1 else ""
        cells.append(f"{100 * own.mean():.0f}{error}")
    return " / ".join(cells)


def peer_row(
    name: str, priors: str, methods: Sequence[str], found: dict[str, list[Outcome]]
) -> str:
    cells = [DISTURBANCES[name].words, priors]
    for method in methods:
        mine = [o for o in found.get(method, []) if o.inside68]
        if method == ESTIM:
            mine = [o for o in mine if o.status == "ok"]
        cells.append(
            f"{coverage(mine)}; {len(mine)} of {len(found.get(method, []))}"
            if method in found
            else ""
        )
    return "| " + " | ".join(cells) + " |"


def rank_rows(found: Sequence[Outcome]) -> list[str]:
    """Simulation-based calibration (Talts et al. 2018): coverage, and of each quantity p of a
    chi-square test of a rank histogram of `N_BIN` bins, also split by the force that is true.
    """
    lines = heads(
        ["analysis", "of", "N", "68 / 95 %", *(f"{s}: 68, 95; p" for s in SYMBOLS.values())]
    )
    for method in dict.fromkeys(o.method for o in found):
        mine = [o for o in found if o.method == method and o.below]
        groups = {
            "all": mine,
            "ok": [o for o in mine if o.status == "ok"],
            "no force": [o for o in mine if o.force[0] == 0.0],
            "force below .0135": [o for o in mine if 0.0 < o.force[0] < MEDIAN_FORCE],
            "force above .0135": [o for o in mine if o.force[0] >= MEDIAN_FORCE],
            "a force, shorter than a sixth": [o for o in mine if o.force[0] and o.force[1] < 1 / 6],
            "a force, longer": [o for o in mine if o.force[0] and o.force[1] >= 1 / 6],
            "ok, force above .0135": [
                o for o in mine if o.status == "ok" and o.force[0] >= MEDIAN_FORCE
            ],
        }
        for words, group in groups.items():
            if len(group) < 2:
                continue
            cells = [method, words, str(len(group)), coverage(group)]
            for i in range(len(FREE)):
                ranks = np.array([o.below[i] for o in group])
                held = [100 * np.mean(np.abs(ranks - 0.5) < 0.5 * p) for p in CENTRAL]
                counts = np.histogram(ranks, N_BIN, (0.0, 1.0))[0]
                cells.append(f"{held[0]:.0f}, {held[1]:.0f}; {chisquare(counts).pvalue:.2g}")
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def heads(cells: Sequence[str]) -> list[str]:
    return ["| " + " | ".join(cells) + " |", "|" + "---|" * len(cells)]


def tables(found: Sequence[Outcome]) -> list[str]:
    by_line: dict[tuple[str, str, str], dict[str, list[Outcome]]] = defaultdict(
        lambda: defaultdict(list)
    )
    for o in found:
        by_line[o.name, o.priors, o.noise][o.method].append(o)
    order = sorted(
        by_line,
        key=lambda line: (
            [*NOISES, JOINT].index(line[2]),
            list(DISTURBANCES).index(line[0]),
            list(PRIORS).index(line[1]),
        ),
    )
    cells = [
        "disturbance",
        "priors",
        "read as",
        "N",
        *SYMBOLS.values(),
        "status",
        "68 / 95 % among ok",
        "ok and some abs(z) > 4",
        "CPU s, median",
    ]
    lines = [*heads(cells), *(row(*line, by_line[line][ESTIM]) for line in order)]
    methods = list(dict.fromkeys(o.method for o in found))
    if len(methods) > 1:
        lines += [
            "",
            *heads(["disturbance", "priors", *(f"{method}: 68 / 95 %; of" for method in methods)]),
        ]
        lines += [
            peer_row(*line[:2], methods, by_line[line]) for line in order if len(by_line[line]) > 1
        ]
    drawn = [o for o in found if o.name == DRAWN]
    return lines + (["", *rank_rows(drawn)] if drawn else [])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replicas", type=int, default=20)
    parser.add_argument(
        "--only",
        nargs="+",
        choices=DISTURBANCES,
        default=[name for name, one in DISTURBANCES.items() if not one.drawn],
        metavar="NAME",
        help=", ".join(DISTURBANCES),
    )
    parser.add_argument("--priors", nargs="+", choices=PRIORS, default=list(PRIORS))
    read = parser.add_mutually_exclusive_group()
    read.add_argument("--noise", nargs="+", choices=NOISES, default=list(NOISES))
    read.add_argument(
        "--joint",
        dest="noise",
        action="store_const",
        const=[JOINT],
        help="three runs at three tilts of one ramp, fitted together",
    )
    parser.add_argument(
        "--peers",
        dest="peers",
        action="store_const",
        const=1,
        default=0,
        help="lmfit's least squares beside it",
    )
    parser.add_argument(
        "--slow-peers",
        dest="peers",
        action="store_const",
        const=2,
        help="its conf_interval and emcee, too",
    )
    parser.add_argument(
        "--derived",
        action="store_true",
        help="what follows from the parameters, too (with --noise speeds)",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, help="file of outcomes, made longer")
    parser.add_argument("--out", type=Path, help="file for the tables beside stdout")
    parser.add_argument("--keep", help="folder to keep campaigns and recordings in")
    chosen = parser.parse_args()
    if chosen.derived and chosen.noise != ["speeds"]:
        parser.error(
            "--derived goes with --noise speeds alone: other curves are not asked where "
            "the motion ends"
        )
    if DRAWN in chosen.only and (chosen.priors, chosen.noise) != (["default"], ["speeds"]):
        parser.error("--only prior goes with --priors default --noise speeds alone")
    found = (
        [Outcome(**json.loads(text)) for text in chosen.log.read_text().splitlines()]
        if chosen.log and chosen.log.exists()
        else []
    )
    made = {(o.name, o.priors, o.noise, o.replica, o.seed) for o in found}
    # a replica of each first, then the next
    kinds = list(product(range(chosen.replicas), chosen.only, chosen.priors, chosen.noise))
    cases = [
        Case(*kind, replica, chosen.seed, chosen.peers, chosen.keep, chosen.derived)
        for replica, *kind in kinds
    ]
    with ProcessPoolExecutor(chosen.jobs) as pool:
        running = [
            pool.submit(outcomes, case)
            for case in cases
            if (*case.line, case.replica, case.seed) not in made
        ]
        for future in as_completed(running):
            found += future.result()
            if chosen.log:
                with chosen.log.open("a", encoding="utf-8") as log:
                    log.writelines(json.dumps(asdict(o)) + "\n" for o in future.result())
    print(*tables(found), sep="\n")
    if chosen.out:
        chosen.out.write_text("\n".join(tables(found)) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
