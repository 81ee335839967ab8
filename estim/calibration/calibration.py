"""Does the whole pipeline tell the truth about its own uncertainty?  Simulated campaigns with known
truth, analysed as real ones.

Two questions, each with its own answer:

- "sbc", simulation-based calibration: truths drawn from the priors. If data, likelihood and
  computation belong together, the rank of a truth among posterior draws is uniform and an interval
  of probability p holds it with probability p: exactly, for any priors (Talts, Betancourt, Simpson,
  Vehtari, Gelman 2018, arXiv 1804.06788; Modrak et al., Bayesian Analysis 20 (2025) 461). It finds
  mistakes.  In joint fits readings of single runs (`estim.fitting.incidental_parameters`) are read
  anew around the truth, which is what they are taken for: there ranks are uniform to first order.
- "coverage": one truth, the fitted values, so that it speaks of *this* experiment.  The experiment
  is repeated together with the measurements that its normal and log-normal priors stand for: their
  centres are drawn anew around the truth with their own standard uncertainty.  With the centre
  held, a parameter that the data do not determine would be covered always or never.  Uniform and
  half-normal priors and those of outliers are no measurements and stay.  Nor are those of the
  effects that a spread between runs scales: new runs have new effects, drawn from them.  Where
  priors that stay say little beside the data, intervals cover with their probability to first
  order.  Where one of them says much (`leaning`), intervals that lean on it cover too often at a
  truth near its middle and too rarely at its edge, and are right on average over it only: there
  covering too often is no fault.

Truths that give no data (`estim.calibration.experiment`) are drawn again and counted.  An
experiment of which too few rows are left is repeated with a new truth as well: that depends on the
data alone, and ranks are uniform for any given data.

Each simulated campaign is analysed by the pipeline's own stages: posed with derivative and
selection, fit (the search starts at the truth), and its posterior computed by importance sampling
from the adapted proposal where k-hat is below 0.5, by the chain otherwise.  Where no posterior
comes out, that is a failure: an interval that does not hold the truth.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray
from estim.calibration.experiment import Experiment
from estim.calibration.trial import (
    ESS,
    Trial,
    TrialPlan,
    What,
    posterior_draws,
    reported_labels,
    reported_names,
    run_trial,
    stated_only,
)
from estim.calibration.uniformity import LEAST_P, N_RANK, uniformity_p_value
from estim.common import (
    PROBABILITIES,
    Amount,
    Finding,
    Kind,
    Label,
    PieceStore,
    Stream,
    format_quantity,
    phrase,
    run_parallel,
    stream,
)
from estim.distributions import normal_quantile
from estim.fitting import Fit

TrialProgress = Callable[[int], None]
"""Called with the number of trials done."""

# chance that ranks are called uneven where none of them are, all quantities considered
UNIFORM_BELOW = 0.001
OFF_BELOW = 0.0027  # the same of coverage, all intervals considered: 3 standard deviations of one


@dataclass(frozen=True, eq=False)
class Calibration:
    """Trials of one design.

    reported : name -> unit.
    labels : name -> how it is shown.  truth : (n_trial, n_reported).
    ranks : (n_trial, n_reported) in 0 .. N_RANK, -1 where the analysis failed.
    covered : (n_trial, n_reported, 2), for PROBABILITIES; False where the analysis failed.
    n_rejected : truths drawn again because they gave no data or too few.
    how : engine -> trials.
    n_short : trials whose engine did not meet its target (they count as they are).
    failures : sentence -> trials that gave no posterior.
    leaning : parameters that depend strongly on a prior which is no measurement.
    """

    what: What
    runs: tuple[str, ...]
    reported: Mapping[str, str]
    labels: Mapping[str, Label]
    truth: FloatArray
    ranks: IntArray
    covered: BoolArray
    n_rejected: int
    how: Mapping[str, int]
    n_short: int
    failures: Mapping[str, int]
    leaning: tuple[str, ...]
    ess: float
    seed: int

    @property
    def n_trial(self) -> int:
        return int(self.ranks.shape[0])

    @property
    def n_failed(self) -> int:
        return sum(self.failures.values())

    def ranks_of(self, name: str) -> IntArray:
        """(n_trial - n_failed,) ranks of the truth of one quantity."""
        column = self.ranks[:, list(self.reported).index(name)]
        return column[column >= 0]

    def places_of(self, name: str) -> FloatArray:
        """The same as shares of all ranks; 0.5 in the mean where estimates are not biased."""
        return (self.ranks_of(name) + 0.5) / (N_RANK + 1)

    def p_value(self, name: str) -> float:
        """Of uniform ranks; nan where every trial failed."""
        ranks = self.ranks_of(name)
        return uniformity_p_value(ranks) if ranks.size else float("nan")

    def share(self, name: str) -> FloatArray:
        """(2,) share of the trials whose interval contains the truth."""
        return self.covered[:, list(self.reported).index(name)].mean(axis=0)

    def share_sd(self) -> FloatArray:
        """(2,) standard deviation of that share where intervals keep their word."""
        p = np.array(PROBABILITIES)
        return np.sqrt(p * (1.0 - p) / self.n_trial)

    @property
    def off_sds(self) -> float:
        """How many of these standard deviations a share must be off to count as wrong, given that
        many shares are tested.
        """
        n_share = len(PROBABILITIES) * len(self.reported)
        return -float(normal_quantile(0.5 * OFF_BELOW / max(n_share, 1)))


def run_trials(
    design: Experiment,
    fit: Fit,
    what: What,
    *,
    n_trial: int,
    seed: int,
    jobs: int = 1,
    ess: float = ESS,
    progress: TrialProgress | None = None,
    store: PieceStore | None = None,
) -> Calibration:
    """Ranks and coverage for `n_trial` truths drawn from the priors ("sbc"), or coverage for as
    many repetitions of the experiment at the fitted values ("coverage").

    There the truth is the posterior mode; a parameter whose mode lies at a bound of its prior has
    its posterior median instead, since no interval between quantiles can hold a bound, and so has a
    spread between runs, which is too large at the mode.

    fit : of the real data; it determines which numbers of the report vary at all.
    store : keeps each trial, its `inputs` what decides the design.  The same seed gives the same
        numbers for any `jobs`.

    Raises NumericalError where hardly any draw of the priors gives data.
    """
    truth, reported = fit.values.copy(), _varying(fit)
    spreads, effects = fit.spreads_and_effects
    if what == "coverage" and (fit.at_bound or spreads):
        draws, _, _ = posterior_draws(fit, ess, stream(seed, Stream.CALIBRATION_TRUTH))
        moved = [fit.names.index(name) for name in {*fit.at_bound, *spreads}]
        truth[moved] = np.median(draws[:, moved], axis=0)
    plan = TrialPlan(design, what, truth, tuple(reported), ess, seed, effects)
    trial = (
        partial(run_trial, plan)
        if store is None
        else partial(_kept_trial, plan, store.with_inputs(*plan.inputs))
    )
    trials = run_parallel(trial, range(n_trial), jobs=jobs, progress=progress)
    return Calibration(
        what=what,
        runs=design.problem.run_names,
        reported=reported,
        labels=reported_labels(fit.problem, fit.values),
        truth=np.array([t.truth for t in trials]),
        ranks=np.array([t.rank for t in trials]),
        covered=np.array([t.covered for t in trials]),
        n_rejected=sum(t.n_rejected for t in trials),
        how=Counter(t.how for t in trials),
        n_short=sum(bool(t.shortfall) for t in trials),
        failures=Counter(t.failure for t in trials if t.failure),
        leaning=_leaning(fit),
        ess=ess,
        seed=seed,
    )


def _varying(fit: Fit) -> dict[str, str]:
    """Numbers of the report that change within a fraction of the posterior's width."""
    step = 1e-3 * fit.scale
    inward = [
        np.where(v + s < p.prior.high, s, -s)
        for v, s, p in zip(fit.values, step, fit.problem.parameters, strict=True)
    ]
    return reported_names(fit.problem, np.array([fit.values, fit.values + np.array(inward)]))


def _kept_trial(plan: TrialPlan, store: PieceStore, index: int) -> Trial:
    return store.piece(f"trial {index}", Trial, partial(run_trial, plan, index))


def _leaning(fit: Fit) -> tuple[str, ...]:
    unmeasured, sds = stated_only(fit.problem), fit.scale
    return tuple(
        p.name
        for p, sd in zip(fit.problem.parameters, sds, strict=True)
        if p.name in unmeasured and sd > 0.3 * p.prior.sd
    )


def findings(calibration: Calibration) -> tuple[Finding, ...]:
    """Where the calibration fails, and in which direction; empty where it does not.

    Uneven ranks count for truths drawn from the priors only (p < 0.001, divided by the number of
    quantities): at one truth they need not be uniform.  Coverage counts where it is more than
    `Calibration.off_sds` Monte-Carlo standard deviations off; at one truth, where something leans
    on a prior that is no measurement, only if it is too small.
    """
    faults = []
    least = max(UNIFORM_BELOW / max(len(calibration.reported), 1), 1.01 * LEAST_P)
    excused = calibration.what == "coverage" and bool(calibration.leaning)
    for name in calibration.reported:
        p_value = calibration.p_value(name) if calibration.what == "sbc" else 1.0
        if p_value < least:
            faults.append(
                Finding(
                    Kind.RANKS_UNEVEN,
                    test=direction(calibration, name),
                    p=p_value,
                    parameters=(Amount(name),),
                )
            )
        for p, share, u in zip(
            PROBABILITIES, calibration.share(name), calibration.share_sd(), strict=True
        ):
            limit = calibration.off_sds * u
            if p - share > limit or (share - p > limit and not excused):
                how = direction(calibration, name) or ("narrow" if share < p else "wide")
                numbers = {"probability": p, "errors": float(abs(share - p) / u)}
                faults.append(
                    Finding(
                        Kind.COVERAGE_OFF,
                        test=how,
                        size=float(share),
                        numbers=numbers,
                        parameters=(Amount(name),),
                    )
                )
    if calibration.n_failed > 0.01 * calibration.n_trial:
        worst = max(calibration.failures, key=lambda sentence: calibration.failures[sentence])
        faults.append(
            Finding(
                Kind.TRIALS_FAILED,
                size=calibration.n_failed,
                numbers={"trials": calibration.n_trial},
                names=(worst,),
            )
        )
    return tuple(faults)


def direction(calibration: Calibration, name: str) -> str:
    """How a quantity is wrong, by the mean or the spread of its ranks: estimates "low" or "high",
    intervals "narrow" or "wide"; "none" where there is no posterior, "" where neither shows it.
    """
    place = calibration.places_of(name)
    if place.size == 0:
        return "none"
    shift = (float(np.mean(place)) - 0.5) * np.sqrt(12.0 * place.size)
    spread_out = (float(np.mean((place - 0.5) ** 2)) - 1.0 / 12.0) * np.sqrt(180.0 * place.size)
    # Monte-Carlo standard deviations from which ranks have a direction
    if max(abs(shift), abs(spread_out)) < 3.0:
        return ""
    if abs(shift) > abs(spread_out):
        return "low" if shift > 0.0 else "high"
    return "narrow" if spread_out > 0.0 else "wide"


def coverage_sentence(calibration: Calibration, name: str) -> str:
    """'the 68 % interval of gamma[heavy] covered 66 ± 2 % of 500 simulated truths'."""
    p, share = PROBABILITIES[0], float(calibration.share(name)[0])
    n = calibration.n_trial
    sd = np.sqrt(max(share * (1.0 - share), 0.25 / n) / n)
    return phrase(
        "the {p:.0f} % interval of {name} covered {held} % of {n} simulated true values",
        p=p * 100,
        name=name,
        held=format_quantity(100 * share, max(100 * sd, 0.1)),
        n=n,
    )
