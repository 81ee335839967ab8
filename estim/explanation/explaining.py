"""What may be missing where a curve does not explain the data: each candidate refit by least
squares, the one that gains most first.

    gain = AIC of the fit as stated - AIC with the candidate
    AIC = -2 log L + sum of squared pulls of the priors + 2 (numbers that it adds)

L at its largest over a size of the noise that is at least the stated one, so that no candidate is
paid for taking up noise that was stated too small.  A candidate has a prior as wide as such a thing
may be.  How to read it: a gain of 10 or more does not come by chance (`FOUND`; about 1 of 100 clean
recordings has one, with all candidates tried); candidates whose gains differ by less than 10 (odds
of 150) cannot be distinguished by these data (`TIED`; a true cause was up to 9 behind a smooth
alias of it).

With white noise a candidate takes up all that is left, also what is none of it: its number is not
what a fit of the campaign with it gives, where an unmodelled force stands beside it.  So the first
ones are fit again as the campaign would be (`Outcome`), and one is an answer only where that ends
well and leaves no force to be explained; one that no line states, where the residuals are random
with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.checks import P_POOR_FIT, check_goodness
from estim.common import Notation, NumericalError, Status, later, phrase
from estim.discrepancy import AutoCorrelated
from estim.explanation.bad_frames import frame_causes
from estim.explanation.candidates import Cause, Estimated, Suspects
from estim.fitting import Fit, fit_least_squares
from estim.problem import Problem

FOUND = 10.0  # gain
TIED = 10.0  # difference of gains
_UMBRELLA = later(
    "a smooth disturbance (an uneven track, correlated errors of successive readings)"
)
_SIZE = "chi2"  # the one test that is not of order


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a fit of the campaign gives where the lines of a candidate are added to it.

    numbers : its parameters, none where the status is not ok or one lies on its edge.
    lacks_force : whether the curve surely lacks a force all the same.
    """

    status: Status
    numbers: tuple[Estimated, ...]
    lacks_force: bool

    @property
    def cures(self) -> bool:
        return self.status.ok and not self.lacks_force


@dataclass(frozen=True, eq=False, kw_only=True)
class RefitCandidate(Cause):
    """One thing that may be missing, refit.

    gain : see above.  numbers : what was found of it, beside white noise.
    outcome : of the campaign with it; None where that was not fit.
    p_order : probability of the residuals with it, by the worst of the tests of order; nan where
        that was not tested.
    p_size : the same by chi-squared; nan where the size of the noise is inferred.
    """

    gain: float = 0.0
    numbers: tuple[Estimated, ...] = ()
    p_order: float = math.nan
    p_size: float = math.nan
    outcome: Outcome | None = None

    @property
    def explains(self) -> bool:
        """Whether it is an answer: where the campaign was fit with it, by what that gave, else by
        the order of the residuals.
        """
        return self.random if self.outcome is None else self.outcome.cures

    @property
    def found(self) -> bool:
        return self.gain >= FOUND

    @property
    def random(self) -> bool:
        """Whether the residuals are in random order with it."""
        return self.p_order >= P_POOR_FIT

    @property
    def as_large_as_stated(self) -> bool:
        """Whether they are no larger than stated either."""
        return not self.p_size < P_POOR_FIT


@dataclass(frozen=True, eq=False)
class Explanation:
    """What may be missing of runs fit together, the strongest first.  plain : the fit without any
    of them, "" its name.
    """

    runs: tuple[str, ...]
    plain: RefitCandidate
    candidates: tuple[RefitCandidate, ...]

    @property
    def found(self) -> tuple[RefitCandidate, ...]:
        return tuple(candidate for candidate in self.candidates if candidate.found)

    @property
    def slip(self) -> RefitCandidate | None:
        """A slip in what was stated that explains what is left as well as anything, if there is
        one.
        """
        first = next(iter(self.found), None)
        return first if first is not None and first.slip and first.random else None

    @property
    def tied(self) -> tuple[RefitCandidate, ...]:
        """The first and those that these data cannot distinguish from it; none where nothing is
        found.
        """
        candidates = self.found
        return tuple(
            candidate for candidate in candidates if candidate.gain > candidates[0].gain - TIED
        )

    @property
    def offered(self) -> RefitCandidate | None:
        """The first of these that is an answer and that lines of the campaign state."""
        return next(
            (candidate for candidate in self.tied if candidate.lines and candidate.explains), None
        )

    def with_outcomes(self, outcome: Callable[[RefitCandidate], Outcome]) -> Explanation:
        """The same with what fits of the campaign with the first of these give."""
        # candidates with which the campaign is fit again
        leading = [candidate for candidate in self.tied if candidate.posed is not None][:6]
        return replace(
            self,
            candidates=tuple(
                replace(candidate, outcome=outcome(candidate))
                if candidate in leading
                else candidate
                for candidate in self.candidates
            ),
        )


def explain(
    suspects: Suspects,
    *,
    rng: np.random.Generator,
    values: FloatArray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Explanation:
    """The candidates for what runs lack: those of `suspects`, errors that are correlated in time,
    one bad frame.

    values : (n_par,) where the fit without any of them may start.
    progress : called with how many of how many are done.
    """
    plain = suspects.plain
    base = fit_least_squares(plain, start=values)
    every = [*suspects.causes, *_correlated_errors(suspects), *frame_causes(base)]
    fits: dict[str, tuple[RefitCandidate, Fit]] = {}
    lowest = badness(base)
    for done, cause in enumerate(every, start=1):
        fit = _with(cause, base)
        if fit is not None:
            gain = lowest - badness(fit) - 2.0 * cause.n_number - cause.searched
            candidate = RefitCandidate(**vars(cause), gain=gain, numbers=_numbers(cause, fit))
            if (candidate.found or not cause.slip) and (
                cause.name not in fits or candidate.gain > fits[cause.name][0].gain
            ):
                fits[cause.name] = candidate, fit
        if progress is not None:
            progress(done, len(every))
    best = max((entry.gain for entry, _ in fits.values()), default=0.0)
    # rounded: the order of causes that gain the same is no matter of the last bits
    ordered = sorted(
        fits.values(),
        key=lambda pair: (
            not (pair[0].slip and pair[0].gain > best - TIED),
            -round(pair[0].gain, 6),
        ),
    )
    # candidates whose residuals are tested
    tested = [
        _tested(entry, fit, rng) if i < 8 and entry.found else entry
        for i, (entry, fit) in enumerate(ordered)
    ]
    names = tuple(run.name for run in plain.runs)
    return Explanation(
        names, _tested(RefitCandidate("", "", plain, (), ()), base, rng), tuple(tested)
    )


def badness(fit: Fit) -> float:
    """-2 log L + sum of squared pulls of the priors, the noise of each run scaled up where it was
    stated too small.
    """
    named = fit.problem.named(fit.values[None, :])
    total = float(np.sum(fit.posterior.prior_residuals(fit.values) ** 2))
    for run, likelihood in zip(fit.problem.runs, fit.posterior.likelihoods, strict=True):
        total -= 2.0 * float(likelihood.log_likelihood(named)[0])
        if likelihood.normal is not None:
            chi2 = float(np.sum(likelihood.size_residuals(named)[0] ** 2))
            larger = max(1.0, chi2 / run.n_obs)
            total += chi2 / larger - chi2 + run.n_obs * math.log(larger)
    return total


def _correlated_errors(suspects: Suspects) -> Iterable[Cause]:
    """Readings whose errors are correlated."""
    plain = suspects.plain
    if plain.counted:
        return
    if any(
        run.noise.robust
        or run.noise.x_gain().any()
        or not run.noise.size.reading_variance(dict.fromkeys(plain.names, 1.0)).any()
        for run in plain.runs
    ):
        return
    name = later("correlation")
    for correlation in (0.3, 0.5, 0.7, 0.85, 0.95):
        runs = tuple(
            replace(run, noise=AutoCorrelated(run.noise, correlation)) for run in plain.runs
        )
        yield Cause(
            "correlated_errors",
            phrase(_UMBRELLA),
            Problem(plain.parameters, runs),
            (),
            (),
            suspects.room,
            scanned=Estimated(name, correlation, math.nan, Notation(phrase(name)).label("1")),
        )


def _with(cause: Cause, base: Fit) -> Fit | None:
    """The fit with a candidate, from that without; None where it cannot be had."""
    try:
        fit = fit_least_squares(cause.problem, start=cause.starting(base))
    except NumericalError:
        return None
    return fit if math.isfinite(badness(fit)) else None


def _numbers(cause: Cause, fit: Fit) -> tuple[Estimated, ...]:
    if cause.scanned is not None:
        return (cause.scanned,)
    parameters = {p.name: p for p in cause.problem.parameters}
    estimates = []
    for name in cause.parameters:
        i = fit.names.index(name)
        estimates.append(
            Estimated(
                name, float(fit.values[i]), float(fit.sds[i]) * _larger(fit), parameters[name].label
            )
        )
    return tuple(estimates)


def _larger(fit: Fit) -> float:
    """Factor of the noise that the residuals show, 1 at least."""
    n_data = sum(run.n_obs for run in fit.problem.runs)
    chi2 = float(np.sum(fit.posterior.size_residuals(fit.values) ** 2))
    return math.sqrt(max(1.0, chi2 / n_data))


def _tested(candidate: RefitCandidate, fit: Fit, rng: np.random.Generator) -> RefitCandidate:
    checks = [good.checks for good in check_goodness(fit, rng=rng)]
    order = [check.p_value for of_run in checks for name, check in of_run.items() if name != _SIZE]
    size = [of_run[_SIZE].p_value for of_run in checks if _SIZE in of_run]
    return replace(
        candidate, p_order=min(order, default=math.nan), p_size=min(size, default=math.nan)
    )
