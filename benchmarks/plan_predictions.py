"""Do plans come true?  Simulated campaigns with what a plan proposes, analysed as real ones,
against its predictions; prints a Markdown table.

    python benchmarks/plan_predictions.py [--campaign data/replica/campaign.toml] [--runs
    heavy-02,heavy-04] [--for kappa] [--trials 200]
        [--changes phi,gamma,...] [--seed 1]

The truth of every trial is the fit of the real data; every trial draws anew what was stated (the
centres of the priors) and all readings, and is fit with free start and unmodelled force as by
default.  `sd`: the root mean square of the posterior standard deviations (importance sampling) over
the predicted one.  `scatter`: the root mean square of posterior mean minus truth over the predicted
one.  After each its Monte-Carlo error.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.calibration.experiment import CampaignDesign, PointDesign
from estim.calibration.trial import measured_anew, posterior_draws
from estim.campaign import Campaign, NewRun, load_campaign, with_own_gamma, with_tables
from estim.common import NumericalError, Quantity
from estim.fitting import Fit, fit_least_squares, fit_problem
from estim.fitting.unmodelled_force import fit_with_forces
from estim.planning.candidates import (
    BETTER,
    MORE,
    OTHERWISE,
    Change,
    FurtherReadings,
    measured_better,
)
from estim.planning.expected_uncertainty import sds_with
from estim.planning.planned_readings import CurveBasis
from estim.planning.planning import targets_of
from estim.planning.rolling import Outlook, RollingBasis, rolling_basis
from estim.problem import Normal, Parameter, Problem
from estim.problem.priors import TruncatedNormal

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Achieved:
    """Over the predicted standard deviation (n_target,): posterior sd, scatter of the posterior
    means, and how many trials there were.

    predicted : (n_target,).
    """

    predicted: FloatArray
    sd: FloatArray
    scatter: FloatArray
    n: int
    failed: int


def with_stated(parameters: Sequence[Parameter], u: dict[str, float]) -> tuple[Parameter, ...]:
    """The parameters with priors as narrow as a change has them."""
    changed = []
    for p in parameters:
        prior = p.prior
        if p.name in u:
            match prior:
                case Normal():
                    prior = replace(prior, sd=u[p.name])
                case TruncatedNormal():
                    prior = replace(prior, scale=u[p.name])
        changed.append(replace(p, prior=prior))
    return tuple(changed)


def simulated(there: Outlook, change: Change, rng: np.random.Generator) -> tuple[Campaign, Problem]:
    """One experiment as the change has it: other readings, and other values of what is stated."""
    known = with_stated(there.problem.parameters, dict(change.u))
    parameters = measured_anew(replace(there.problem, parameters=known), there.values, rng)
    if all(run.motion is None for run in there.problem.runs):
        problem = PointDesign(there.problem).simulate(there.values, parameters, rng)
        assert problem is not None
        return there.campaign, problem
    names = tuple(run.name for run in there.problem.runs)
    design = CampaignDesign(there.campaign, names, there.problem, there.release)
    tables = dict(there.campaign.tables)
    for run in there.problem.runs:
        table = design._table(run, tables[run.name], there.problem.named(there.values), rng)
        assert table is not None
        tables[run.name] = table
    campaign = with_tables(there.campaign, MappingProxyType(tables))
    posed = with_own_gamma(campaign.problem(names), change.runs)
    assert posed.names == tuple(p.name for p in parameters)
    return campaign, replace(posed, parameters=parameters)


def fitted(problem: Problem, start: FloatArray, rng: np.random.Generator) -> Fit:
    """As a campaign is fit, from the truth."""
    white = fit_least_squares(problem, start=start)
    if not any(run.force for run in problem.runs):
        return white
    return fit_with_forces(white, rng=rng)


def rms(rows: list[FloatArray]) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(np.square(rows), axis=0)))


def achieved(
    basis: RollingBasis | CurveBasis,
    change: Change,
    targets: Sequence[Parameter],
    *,
    trials: int,
    seed: int,
    ess: float = 400.0,
) -> Achieved:
    """Trials of what a change proposes."""
    there = basis.outlook(change)
    predicted = sds_with(there, change.u, targets)
    columns = [there.problem.names.index(p.name) for p in targets]
    sds, off, failed = [], [], 0
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        _, problem = simulated(there, change, rng)
        try:
            draws, _, _ = posterior_draws(fitted(problem, there.values, rng), ess, rng)
        except NumericalError:
            failed += 1
            continue
        sds.append(np.std(draws[:, columns], axis=0))
        off.append(np.mean(draws[:, columns], axis=0) - there.values[columns])
        if len(sds) % 20 == 0:
            print(
                f"  {change.words}, {len(sds)}: {rms(sds) / predicted} {rms(off) / predicted}",
                file=sys.stderr,
                flush=True,
            )
    return Achieved(predicted, rms(sds) / predicted, rms(off) / predicted, len(sds), failed)


def changes_of(basis: RollingBasis | CurveBasis) -> dict[str, Change]:
    """What is tried, by a short name."""
    found = {"as is": Change("as things are", OTHERWISE)}
    found |= {
        next(iter(change.u)).partition("[")[0]: change
        for change in measured_better(basis.fit.problem, ())
    }
    found |= {"frames": Change("twice as many frames or readings", OTHERWISE, frames=2.0)}
    found |= {"error": Change("half the error of a reading", OTHERWISE, error=0.5)}
    if isinstance(basis, CurveBasis):
        run = basis.fit.problem.runs[0]
        return found | {
            "reading": Change(
                "ten readings more",
                MORE,
                readings=(FurtherReadings(run.name, float(np.quantile(run.x, 0.2)), 10),),
            )
        }
    like, name = basis.names[-1], "new"
    u = float(np.radians(0.4))
    steep = {
        "phi": Quantity(float(np.radians(8.0)), u),
        "theta0": Quantity(float(np.radians(75.0)), float(np.radians(1.5))),
    }
    found["run"] = Change("a run at 8°, 75°", MORE, runs=(NewRun(name, like, steep),))
    heavier = {"gamma": Quantity(0.28, 0.01), "phi": Quantity(0.105, u)}
    found["heavier"] = Change(
        "the disk with γ = 0.28(1), at 6°", MORE, runs=(NewRun(name, like, heavier),)
    )
    found["together"] = replace(
        found["run"], group=BETTER, words="a run at 8°, 75°, and φ of the others to half"
    )
    return (
        found | {"together": replace(found["together"], u=dict(found["phi"].u))}
        if "phi" in found
        else found
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--campaign",
        default=str(Path(__file__).resolve().parents[1] / "data" / "replica" / "campaign.toml"),
    )
    parser.add_argument("--runs", default="heavy-02,heavy-04")
    parser.add_argument("--for", dest="wanted", default="kappa")
    parser.add_argument("--changes", default="as is,phi,gamma,frames,error,run,heavier,together")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    campaign = load_campaign(chosen.campaign)
    names = tuple(chosen.runs.split(","))
    problem = campaign.problem(names)
    fit = fit_problem(problem, rng=np.random.default_rng(chosen.seed))
    basis = (
        rolling_basis(campaign, names, fit)
        if campaign.formula is None
        else CurveBasis(campaign, names, fit)
    )
    targets = targets_of(campaign, problem, [chosen.wanted])
    print(f"{chosen.trials} trials of each, runs {', '.join(names)}, seed {chosen.seed}\n")
    print(
        "| what is measured | quantity | predicted u | sd | scatter | trials "
        "|\n|---|---|---|---|---|---|"
    )
    for name, change in changes_of(basis).items():
        if name in chosen.changes.split(","):
            start = time.process_time()
            a = achieved(basis, change, targets, trials=chosen.trials, seed=chosen.seed)
            mc = 1.0 / np.sqrt(2.0 * a.n)
            for target, u, sd, scatter in zip(targets, a.predicted, a.sd, a.scatter, strict=True):
                print(
                    f"| {change.words} | {target.name} | {u:.3g} | {sd:.3f} | {scatter:.3f} ± "
                    f"{mc * scatter:.3f} | {a.n} |",
                    flush=True,
                )
            print(
                f"{name}: {time.process_time() - start:.0f} s, {a.failed} failed",
                file=sys.stderr,
                flush=True,
            )


if __name__ == "__main__":
    main()
