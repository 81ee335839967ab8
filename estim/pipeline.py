"""The whole analysis on one page: campaign -> problem -> fit -> draws -> second opinion ->
diagnosis; bands when a reader asks for them.

Read this first.  Each stage takes records and returns one; each lives in the file of its verb.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import Campaign, NoiseTable, as_complete
from estim.checks import (
    SURE,
    Conflict,
    Consistency,
    Diagnosis,
    Estimate,
    Goodness,
    Identifiability,
    Influence,
    Modes,
    Outliers,
    Rolling,
    check_consistency,
    check_goodness,
    check_rolling,
    check_stated_values,
    comparable,
    diagnose,
    estimates_of,
    find_modes,
    find_outliers,
    headline,
    held_by_draws,
    identify,
    influences,
    not_measured,
    optima_of,
    p_sentence,
    print_lines,
    result_table,
    screen_lines,
    unidentified,
    untested,
)
from estim.common import (
    Finding,
    InputError,
    Kind,
    NumericalError,
    PieceStore,
    Status,
    Stream,
    phrase,
    stream,
)
from estim.curve_fitting import CurveFit
from estim.explanation import Explanation, Outcome, RefitCandidate, explain
from estim.fitting import Fit, fit_problem
from estim.problem import JeffreysPrior, Problem, folded
from estim.sampling import (
    MAX_PARAMETERS,
    MAX_TIED,
    Agreement,
    Bands,
    Certificate,
    Certified,
    Chain,
    Progress,
    Summary,
    Target,
    certified_chain,
    marginal_chain,
    no_comparison,
    posterior_bands,
    proposed_chain,
    sample_posterior,
    summarise_parameter,
    too_many,
    trusted,
)
from estim.words import advice_for

_LOG = logging.getLogger("estim")
_NONLINEAR = 0.15  # of the logarithm of Jeffreys' prior, over a standard deviation of a parameter


@dataclass(frozen=True, eq=False)
class Analysis:
    """Everything that one fit of one or more runs produced.

    problem : points, parameters and priors.  fit : the posterior mode.
    certificate : the second computation; None where there are too many parameters for it.
    chain : draws of the posterior.  comparison : how chain and second computation agree.
    goodness : of each run, tests of its residuals.
    identifiability : how well the data determine each parameter.
    modes : other optima that were found.  outliers : of each run, points that are far off.
    consistency : whether several runs agree about what they share; None where there is nothing to
        compare.
    conflict : whether the data agree with the stated values of the parameters.
    influences : how far errors that no residual can show would shift the parameters.
    rolling : whether bodies rolled without slipping; none for a curve that is no body's.
    explanation : candidates for what the curve lacks, where they were looked for.
    diagnosis : all findings and the status.  seed : of every random number.
    title, kind : of the campaign, "" without one.

    >>> from estim import Target, fit_curve, sample_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> analysis = sample_curve(fit, seed=1, target=Target(ess=400.0))
    >>> analysis.diagnosis.status, analysis.chain.flat.shape[1]
    ('ok', 2)
    """

    problem: Problem
    fit: Fit
    certificate: Certificate | None
    chain: Chain
    comparison: Agreement
    goodness: tuple[Goodness, ...]
    identifiability: Identifiability
    modes: Modes
    outliers: tuple[Outliers, ...]
    consistency: Consistency | None
    conflict: Conflict
    influences: tuple[Influence, ...]
    rolling: tuple[Rolling, ...]
    diagnosis: Diagnosis
    seed: int
    title: str = ""
    kind: str = ""
    explanation: Explanation | None = None

    @cached_property
    def bands(self) -> tuple[Bands, ...]:
        """Bands of every run."""
        rng = stream(self.seed, Stream.BANDS)
        return posterior_bands(
            self.problem, self.chain.thinned(4000), rng=rng, forces=self.fit.forces
        )

    @cached_property
    def ends(self) -> Mapping[str, FloatArray]:
        """Run -> where its motion ends (n_draw,), by its band; only of runs that are motions."""
        return {
            band.run: band.end
            for band, run in zip(self.bands, self.problem.runs, strict=True)
            if run.motion is not None
        }

    @cached_property
    def summaries(self) -> tuple[Summary, ...]:
        """Of every parameter, as far as the status allows them."""
        named = zip(self.fit.names, self.chain.flat.T, strict=True)
        return tuple(
            trusted(
                summarise_parameter(self.fit, name, draws),
                self.diagnosis.status,
                sampled=self.diagnosis.sampled,
            )
            for name, draws in named
        )

    @cached_property
    def estimates(self) -> tuple[Estimate, ...]:
        """Every parameter with what was stated of it, as far as the status allows numbers."""
        return estimates_of(self.fit, self.summaries, self.chain.flat)

    @property
    def _title(self) -> str:
        return ": ".join(part for part in (self.title, ", ".join(self.problem.run_names)) if part)

    @property
    def _tests(self) -> str:
        return p_sentence(self.fit.p_value, self.conflict.p_value if self.conflict.dof else None)

    def __str__(self) -> str:
        """What `print` shows: the values that the data give, beside the stated values, or why
        there are none.
        """
        return print_lines(
            self._title,
            status=self.diagnosis.status,
            reasons=self.diagnosis.reasons,
            advice=advice_for(self.diagnosis.findings),
            shown=screen_lines(self.estimates, tests=self._tests),
        )

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the same."""
        return headline(
            self._title,
            kind=self.kind,
            status=self.diagnosis.status,
            reasons=self.diagnosis.reasons,
            advice=advice_for(self.diagnosis.findings),
            shown=result_table(self.estimates),
            tests=self._tests,
            left=not_measured(self.estimates),
        )


def analyse(
    campaign: Campaign,
    runs: Sequence[str],
    *,
    seed: int,
    target: Target | None = None,
    progress: Progress | None = None,
    noise: NoiseTable | None = None,
    store: PieceStore | None = None,
    marginal: bool | None = None,
    complete: str = "",
) -> Analysis:
    """The joint analysis of `runs` of a campaign; the same seed gives the same numbers.  Raises
    InputError.

    runs : names of runs of the campaign, fit together.
    target : when the sampling stops (`estim.Target`).
    progress : called with the per cent done and a message.
    noise : in place of the noise tables of the campaign.
    store : stores the draws and the second opinion when both are done, and returns them where it
        has them for the same data, settings and fit.
    marginal : whether a joint posterior is sampled through the marginal over runs; None: where the
        chain has no proposal (more than 14 unknowns), or a quantity varies between runs; never
        where runs share a force, which ties them together.
    complete : the reason to take the curves as complete, without a default unmodelled force ("estim
        energy"); "" for none.

    >>> from estim import Target, analyse, load_campaign
    >>> campaign = load_campaign("data/gallery/hubble.toml", only="with-intercept")
    >>> analysis = analyse(campaign, ["with-intercept"], seed=1, target=Target(ess=400.0))
    >>> analysis.diagnosis.status, analysis.chain.names
    ('ok', ('H', 'K[with-intercept]', 'sigma_y[with-intercept]'))
    """
    problem = campaign.problem(runs, noise=noise)
    campaign.require_unknowns(problem)
    problem = (
        as_complete(problem, complete)
        if complete
        else campaign.problem(runs, noise=noise, usual=True)
    )
    _logged(progress)(0, phrase("fit"))
    with campaign.placing(problem):
        fit = fit_problem(problem, rng=stream(seed, Stream.FIT))
    fit_store = (
        None if store is None else store.with_inputs(campaign.digests(runs), noise, complete)
    )
    analysis = analyse_fit(
        fit, seed=seed, target=target, progress=progress, store=fit_store, marginal=marginal
    )
    return replace(analysis, title=campaign.title, kind=campaign.kind)


def _logged(progress: Progress | None) -> Progress:
    """`progress`, with each of its messages sent to the logger "estim" as well (level INFO)."""

    def log_and_report(percent: int, message: str) -> None:
        _LOG.info("%d %%, %s", percent, message)
        if progress is not None:
            progress(percent, message)

    return log_and_report


# a parameter that is known by its size may be so large that its square is infinite
@np.errstate(over="ignore", invalid="ignore")
def analyse_fit(
    fit: Fit,
    *,
    seed: int,
    target: Target | None = None,
    progress: Progress | None = None,
    store: PieceStore | None = None,
    marginal: bool | None = None,
    tested: bool = True,
) -> Analysis:
    """What follows a fit, however its problem was posed.  tested : whether there are residuals to
    test.

    store : stores the draws; its `inputs` determine the problem.
    """
    target, problem, conflict = target or Target(), fit.problem, check_stated_values(fit)
    progress = _logged(progress)
    identifiability = identify(fit)
    unheld = unidentified(fit, identifiability)
    improper = any(finding.kind is Kind.OPEN_SIDE for finding in unheld)
    max_step = target.max_step
    if unheld or conflict.flagrant:
        # where the draws have no meaning, a few steps for figures alone; where a direction is flat,
        # enough for a chain that mixes, and no wait for one that does not
        max_step = min(max_step, 60 if conflict.flagrant or improper else 1000)
    draw = partial(
        _drawn,
        fit,
        conflict.flagrant or improper,
        seed=seed,
        target=replace(target, max_step=max_step),
        progress=progress,
        marginal=marginal,
    )
    drawn = (
        draw()
        if store is None
        else store.with_inputs(fit.names, fit.values.tolist(), seed, target, marginal).piece(
            "draws", Certified, draw
        )
    )
    chain, comparison = drawn.chain, drawn.comparison
    unheld = tuple(finding for finding in unheld if not held_by_draws(finding, fit, chain))
    progress(100, phrase("checks"))
    goodness = check_goodness(fit, rng=stream(seed, Stream.GOODNESS)) if tested else untested(fit)
    modes = find_modes(fit, chain.thinned(20_000))
    outliers = find_outliers(fit.posterior, chain.thinned(1000))
    consistency = check_consistency(fit) if comparable(fit) else None
    spread = None if conflict.flagrant or improper else np.std(chain.thinned(20_000), axis=0)
    moved = influences(fit, spread)
    rolling = check_rolling(problem, chain.thinned(400), rng=stream(seed, Stream.FRICTION))
    diagnosis = diagnose(
        fit,
        chain,
        goodness,
        comparison=comparison,
        unheld=unheld,
        modes=modes,
        consistency=consistency,
        conflict=conflict,
        influences=moved,
        rolling=rolling,
    )
    return Analysis(
        problem,
        fit,
        drawn.certificate,
        chain,
        comparison,
        goodness,
        identifiability,
        modes,
        outliers,
        consistency,
        conflict,
        moved,
        rolling,
        diagnosis,
        seed,
    )


def _drawn(
    fit: Fit,
    meaningless: bool,
    *,
    seed: int,
    target: Target,
    progress: Progress | None,
    marginal: bool | None,
) -> Certified:
    """Draws of the posterior of a fit, and a second opinion where there can be one.

    meaningless : whether no posterior deserves a second opinion: the draws are for figures alone.
    """
    problem, rng = fit.problem, stream(seed, Stream.CHAIN)
    max_parameters = MAX_TIED if problem.shared else MAX_PARAMETERS
    if meaningless:
        chain = sample_posterior(
            fit.posterior, fit.values, fit.cov, target=target, rng=rng, progress=progress
        )
        return Certified(chain, None, no_comparison(problem.n_par, Finding(Kind.NOT_SAMPLED)))
    if marginal or (marginal is None and _hard_for_a_chain(fit) and _integrable(fit)):
        try:
            chain, comparison = marginal_chain(fit, target=target, rng=rng, progress=progress)
            return Certified(chain, None, comparison)
        except NumericalError:
            # a chain needs no integral over a run's own parameters
            if marginal:
                raise
            rng = stream(seed, Stream.CHAIN)
    density = folded(fit.sampled, fit.symmetry, fit.values, fit.cov)
    start = optima_of(fit)
    if problem.n_par <= max_parameters:
        drawn = certified_chain(
            density,
            start,
            target=target,
            seed=seed,
            most=max_parameters,
            support=problem.support(),
            coordinates=fit.coordinates,
            progress=progress,
        )
    else:
        chain = proposed_chain(density, start, target=target, seed=seed, progress=progress)
        drawn = Certified(
            chain, None, no_comparison(problem.n_par, too_many(problem.n_par, max_parameters))
        )
    return drawn


def asks_for_a_cause(analysis: Analysis) -> bool:
    """Whether something is missing, and a few seconds may show what: the curve does not explain the
    data, or surely lacks a force.

    Not beside a deviation that is refused: a refit would find the same deviation, and the advice is
    to use another curve.
    """
    lacking = analysis.diagnosis.status is Status.POOR_FIT or _lacks_a_force(analysis.fit)
    refused = any(
        finding.kind in (Kind.DEVIATION_TOO_LARGE, Kind.DEVIATION_TOO_SLOW)
        for finding in analysis.diagnosis.findings
    )
    return lacking and not refused and len(analysis.problem.runs) <= 4


def _lacks_a_force(fit: Fit) -> bool:
    """Whether its curve surely lacks a force."""
    return any(force.force.probability > SURE for force in fit.forces)


def explained(
    campaign: Campaign, analysis: Analysis, *, progress: Callable[[int, int], None] | None = None
) -> Analysis:
    """The analysis with candidates for what its curve lacks, each refit by least squares, and the
    first of them as the campaign would be with it.

    progress : called with the number of candidates that are done, and with their number.  The
        analysis is returned as it is where there are no candidates, or the curve alone cannot be
        refit.
    """
    suspects = campaign.suspects(analysis.problem.run_names)
    names = suspects.plain.names
    known = dict(zip(analysis.fit.names, analysis.fit.values.tolist(), strict=True))
    values = np.array([known[name] for name in names]) if known.keys() >= set(names) else None
    rng = stream(analysis.seed, Stream.EXPLANATION)
    try:
        explanation = explain(suspects, rng=rng, values=values, progress=progress)
    except NumericalError:
        return analysis
    if not explanation.candidates:
        return analysis
    return replace(
        analysis, explanation=explanation.with_outcomes(partial(outcome_of, seed=analysis.seed))
    )


def outcome_of(candidate: RefitCandidate, *, seed: int) -> Outcome:
    """The result of the campaign with the lines of a candidate, fit with this seed."""
    assert candidate.posed is not None, "asked of candidates that can be posed"
    try:
        fit = fit_problem(candidate.posed(), rng=stream(seed, Stream.FIT))
        analysis = analyse_fit(fit, seed=seed)
    except InputError:
        return Outcome(Status.NOT_IDENTIFIED, (), False)
    except NumericalError:
        return Outcome(Status.NOT_CONVERGED, (), False)
    numbers = []
    for parameter in candidate.numbers if analysis.diagnosis.ok else ():
        if parameter.name in fit.names and parameter.name not in fit.at_bound:
            draws = analysis.chain.flat[:, fit.names.index(parameter.name)]
            numbers.append(
                replace(parameter, value=float(np.mean(draws)), sd=float(np.std(draws, ddof=1)))
            )
    return Outcome(analysis.diagnosis.status, tuple(numbers), _lacks_a_force(fit))


def _integrable(fit: Fit) -> bool:
    """Whether there are several runs whose own parameters can be integrated out."""
    if len(fit.problem.runs) < 2 or any(run.normal is None for run in fit.posterior.likelihoods):
        return False
    return fit.jeffreys is None or not _is_nonlinear(fit, fit.jeffreys)


def _hard_for_a_chain(fit: Fit) -> bool:
    """Whether there are many parameters, or a spread and the effects that it scales, which are easy
    given each other.
    """
    spreads, _ = fit.spreads_and_effects
    return fit.problem.n_par > MAX_PARAMETERS or bool(spreads)


def _is_nonlinear(fit: Fit, prior: JeffreysPrior) -> bool:
    """Whether the logarithm of a prior is far from a straight line within a standard deviation of
    some parameter, which is then no normal variable.
    """
    low, high = fit.problem.support()
    steps = fit.cov / fit.scale[:, None]
    up, down = (
        prior.exact(fit.problem.named(np.clip(fit.values + sign * steps, low, high)))
        for sign in (1.0, -1.0)
    )
    return not np.all(np.abs(up + down) < 2.0 * _NONLINEAR)


def sample_curve(
    fit: CurveFit, *, seed: int, target: Target | None = None, progress: Progress | None = None
) -> Analysis:
    """Draws of the posterior of a fitted curve, with diagnosis and bands; the same seed gives the
    same numbers.

    Without u_y the standard deviation of y is drawn too, so that its uncertainty is in every
    interval.

    seed : of every random number.  target : when to stop (`estim.Target`).
    progress : called with the per cent done and a message.

    Raises InputError where the fit leaves nothing to sample: parameters that the data do not
    determine, or no residuals.

    >>> from estim import Target, fit_curve, sample_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> analysis = sample_curve(fit, seed=1, target=Target(ess=400.0))
    >>> analysis.chain.flat.mean(axis=0).round(1).tolist()
    [2.0, 1.0]
    """
    if fit.status in (Status.NOT_IDENTIFIED, Status.NOT_CONVERGED):
        raise InputError(f"cannot be sampled: {fit.reasons[0]}", field="fit", value=str(fit.status))
    if fit.fit.singular:
        raise InputError(
            "cannot be sampled: rounding leaves its parameters too few digits; write the "
            "formula in x - x0, with x0 in the middle of the data",
            field="fit",
        )
    if fit.sigma is not None and not fit.goodness:
        raise InputError(
            "cannot be sampled: the curve passes through every point, so the size of the "
            "errors is unknown; give u_y",
            field="fit",
        )
    return analyse_fit(
        fit.fit, seed=seed, target=target, progress=progress, tested=bool(fit.goodness)
    )
