"""One simulated campaign with known truth, analysed: where does the truth lie among the posterior
draws, and in which intervals?

The stages are those of the pipeline, with less demanded of the sampler: `ESS` says how much.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, all_finite
from estim.calibration.experiment import Experiment
from estim.calibration.uniformity import N_RANK
from estim.checks import optima_of
from estim.common import PROBABILITIES, InputError, Label, NumericalError, Stream, stream
from estim.fitting import Fit, fit_least_squares, fit_white
from estim.problem import Parameter, Prior, Problem
from estim.sampling import Chain, InCoordinates, Target, certify, marginal_chain, sample_posterior

What = Literal["sbc", "coverage"]

# effective sample size, of importance sampling or, where its weights are uneven, of the chain
ESS = 1000.0
_MOST_TRIES = 2000  # truths drawn for one simulated campaign
_KINDS = {"sbc": Stream.RANK_TRIALS, "coverage": Stream.COVERAGE_TRIALS}


@dataclass(frozen=True, eq=False)
class TrialPlan:
    """What is common to all trials.

    truth : (n_par,) the truth of every trial where `what` is "coverage".
    effects : parameters that a spread between runs scales; their truths are drawn from the priors
        in every trial.
    reported : names of the numbers that are looked at.  ess : effective sample size.
    """

    design: Experiment
    what: What
    truth: FloatArray
    reported: tuple[str, ...]
    ess: float
    seed: int
    effects: frozenset[str] = frozenset()

    @property
    def inputs(self) -> tuple[object, ...]:
        """What decides a trial beside the design, in numbers and words."""
        return self.what, self.truth.tolist(), self.reported, self.ess, self.seed


@dataclass(frozen=True, eq=False)
class Trial:
    """One simulated campaign.

    truth : (n_reported,).
    rank : (n_reported,) of the truth among 99 draws; -1 where there are none.
    covered : (n_reported, 2) whether the 68 and 95 % intervals hold it.
    n_rejected : truths drawn before this one that gave no data, or too few rows.
    how : "importance sampling", "chain" or "none".
    shortfall : what the engine did not reach, or "".  failure : why there are no draws, or "".
    """

    truth: FloatArray
    rank: IntArray
    covered: BoolArray
    n_rejected: int
    how: str
    shortfall: str
    failure: str


def run_trial(plan: TrialPlan, index: int) -> Trial:
    """Trial number `index`: the same whatever the process and the other trials."""
    rng = stream(plan.seed, _KINDS[plan.what], index)
    values, problem, n_rejected = _experiment(plan, rng)
    truth = reported(plan.design.problem, values[None, :], plan.reported)[0]
    n = len(plan.reported)
    try:
        draws, how, shortfall = posterior_draws(_fit(problem, values, rng), plan.ess, rng)
    except NumericalError as error:
        return Trial(
            truth,
            np.full(n, -1),
            np.zeros((n, len(PROBABILITIES)), dtype=bool),
            n_rejected,
            "none",
            "",
            error.rule,
        )
    numbers = reported(plan.design.problem, draws, plan.reported)
    rank = _rank(truth, numbers[rng.choice(numbers.shape[0], N_RANK, replace=False)], rng)
    return Trial(truth, rank, _covered(truth, numbers), n_rejected, how, shortfall, "")


def _experiment(plan: TrialPlan, rng: np.random.Generator) -> tuple[FloatArray, Problem, int]:
    """A truth, the problem that its simulated data pose, and how many had to be drawn again.
    Raises NumericalError.
    """
    problem = plan.design.problem
    for n_rejected in range(_MOST_TRIES):
        if plan.what == "sbc":
            values = problem.prior_draw(rng)
            stated = measured_anew(problem, values, rng, problem.readings)
        else:
            # an effect differs from run to run, and was measured in none
            values = np.array(
                [
                    p.prior.draw(rng, 1)[0] if p.name in plan.effects else value
                    for p, value in zip(problem.parameters, plan.truth, strict=True)
                ]
            )
            read = set(problem.names) - stated_only(problem) - plan.effects
            stated = measured_anew(problem, values, rng, read)
        simulated = plan.design.simulate(values, stated, rng)
        if simulated is not None:
            return values, simulated, n_rejected
    raise NumericalError(
        f"calibration cannot start: of {_MOST_TRIES} draws of the priors none gives data "
        "that could be fit (state narrower priors)"
    )


def stated_only(problem: Problem) -> frozenset[str]:
    """Parameters whose priors stand for no measurement: uniform and half-normal ones, and those of
    outliers.
    """
    outliers = {name for run in problem.runs for name in run.noise.outlier_parameters}
    unmeasured = {p.name for p in problem.parameters if not p.prior.measured}
    return frozenset(outliers | unmeasured)


def measured_anew(
    problem: Problem,
    truth: FloatArray,
    rng: np.random.Generator,
    names: Collection[str] | None = None,
) -> tuple[Parameter, ...]:
    """The parameters with the centres of priors that stand for measurements drawn around `truth`
    (n_par,): of `names`, None for all of them.
    """
    fixed = stated_only(problem) if names is None else set(problem.names).difference(names)
    return tuple(
        p if p.name in fixed else replace(p, prior=_around(p.prior, float(value), rng))
        for p, value in zip(problem.parameters, truth, strict=True)
    )


def _around(prior: Prior, truth: float, rng: np.random.Generator) -> Prior:
    """`prior` as another measurement of `truth` with the same uncertainty would have given it."""
    while True:
        try:
            return prior.measured_again(truth, float(rng.standard_normal()))
        # a measurement so far beyond the limit that nothing is left of its prior
        except InputError:
            continue


def _fit(problem: Problem, start: FloatArray, rng: np.random.Generator) -> Fit:
    """The fit from the truth; from the priors where the simulated data exclude the truth itself."""
    try:
        return fit_least_squares(problem, start=start)
    except NumericalError:
        return fit_white(problem, rng=rng)


def posterior_draws(fit: Fit, ess: float, rng: np.random.Generator) -> tuple[FloatArray, str, str]:
    """Draws (n_draw, n_par) of the posterior, which engine gave them, and what it did not reach (or
    "").  Raises NumericalError.
    """
    spreads, _ = fit.spreads_and_effects
    # a chain does not get from spreads as large as at the mode to those that are probable
    if spreads and (chain := _integrated(fit, ess, rng)) is not None:
        return chain.flat, "importance sampling", ""
    density = InCoordinates(fit.sampled, fit.coordinates)
    at = optima_of(fit).of(fit.coordinates)
    # draws in each round of adaptation
    for n_round in (1000, 4000):
        proposal = at.adapted(density, rng, n_round=n_round)
        n_draw, most = int(2.0 * ess), int(16.0 * ess)
        certificate = certify(
            density, proposal, rng=rng, n_draw=n_draw, least_ess=ess, max_draw=most
        )
        if certificate.k_hat < 0.5 and certificate.ess >= ess:
            return fit.coordinates.values(certificate.draws), "importance sampling", ""
    target = Target(rhat=1.02, ess=ess, n_tau=20.0, max_step=4000, n_ensemble=2)
    chain = sample_posterior(density, at.value, at.cov, target=target, rng=rng, proposal=proposal)
    return (
        fit.coordinates.values(chain.thinned(20_000)),
        "chain",
        "" if chain.convergence.met else chain.convergence.message,
    )


def _integrated(fit: Fit, ess: float, rng: np.random.Generator) -> Chain | None:
    """Draws by the marginal over runs, None where that does not do."""
    with suppress(InputError, NumericalError):
        chain, _ = marginal_chain(fit, target=Target(ess=ess), rng=rng)
        return chain if chain.convergence.met else None
    return None


def reported(problem: Problem, draws: FloatArray, names: Sequence[str]) -> FloatArray:
    """(n_draw, n_reported) the numbers `names` at draws (n_draw, n_par)."""
    columns = _everything(problem, draws)
    return np.column_stack([columns[name][0] for name in names])


def reported_names(problem: Problem, draws: FloatArray) -> dict[str, str]:
    """Name -> unit of every number with an interval in a report: parameters, derived quantities and
    turning points that vary.
    """
    columns = _everything(problem, draws)
    return {
        name: unit
        for name, (column, unit, _) in columns.items()
        if all_finite(column) and np.ptp(column) > 0.0
    }


def reported_labels(problem: Problem, values: FloatArray) -> dict[str, Label]:
    """Name -> how it is shown, of everything that may be reported; values (n_par,)."""
    return {name: shown for name, (_, _, shown) in _everything(problem, values[None, :]).items()}


def _everything(problem: Problem, draws: FloatArray) -> dict[str, tuple[FloatArray, str, Label]]:
    """Name -> draws (n_draw,), unit and label."""
    columns = {p.name: (draws[:, i], p.unit, p.label) for i, p in enumerate(problem.parameters)}
    for run in problem.runs:
        arguments, level = run.bind(problem.named(draws)), f"[{run.name}]"
        derived = [
            (name, d.values, d.unit, d.notation) for name, d in run.derived(arguments).items()
        ]
        ends = (
            []
            if run.motion is None
            else [("turning_point", run.end(arguments), run.x_unit, run.motion.end_notation)]
        )
        for name, column, unit, notation in (*ends, *derived):
            columns[name + level] = (
                np.broadcast_to(column, (draws.shape[0], 1))[:, 0],
                unit,
                notation.label(unit, level),
            )
    return columns


def _rank(truth: FloatArray, draws: FloatArray, rng: np.random.Generator) -> IntArray:
    """(n,) how many of draws (n_rank, n) lie below truth (n,); equal ones (a motion that never
    stops) count or not, evenly at random.
    """
    return np.sum(draws < truth, axis=0) + rng.integers(0, np.sum(draws == truth, axis=0) + 1)


def _covered(truth: FloatArray, draws: FloatArray) -> BoolArray:
    """(n, 2) whether truth (n,) lies between the quantiles of draws (n_draw, n) that a report
    quotes.
    """
    covered = []
    for p in PROBABILITIES:
        ends = np.sort(draws, axis=0)[
            np.rint(np.array([0.5 - 0.5 * p, 0.5 + 0.5 * p]) * (draws.shape[0] - 1)).astype(int)
        ]
        covered.append((ends[0] <= truth) & (truth <= ends[1]))
    return np.transpose(covered)
