"""Joint fits of many runs by the marginal of what they share.

Which method to use: `sample_posterior` (a chain in all dimensions) for one run or a few;
`sample_marginal` where the number of parameters grows with the number of runs.  Given the shared
parameters the runs are independent, so only the shared ones are sampled: importance sampling with a
Student-t density adapted to their marginal, each run integrated out (`estim.sampling.conditional`),
the weights Pareto-smoothed; then every run's own parameters are drawn given the shared ones.

Two things can be wrong, and each is checked.  The proposal may miss the marginal: k-hat of its
weights shows it.  The runs' own parameters may not be normal given the shared ones: on some of the
draws the weights in ALL dimensions are computed, in which nothing is approximated, and both sets of
weights must give the same means and standard deviations (a choice of several nodes removes most of
a difference).

Priors with hard edges: sampled parameters are only checked against their support.  A run's own
parameter that comes close to such an edge is no normal variable and is sampled with the shared
ones, unless its prior is log-normal: then its logarithm is integrated out.

Source: Rue, Martino, Chopin, J. R. Stat. Soc. B 71 (2009) 319 (nested Laplace approximations).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.common import Finding, InputError, Kind, NumericalError, phrase
from estim.fitting import Fit
from estim.problem import JointNormal, LogNormal, Measure
from estim.sampling.chain import Progress
from estim.sampling.conditional import run_terms
from estim.sampling.importance import (
    K_HAT_LIMIT,
    difference,
    kish_ess,
    log_mean_uncertainty,
    pareto_smoothed,
    spread,
    systematic,
)
from estim.sampling.marginal_density import Marginal
from estim.sampling.proposal import adapt_proposal
from estim.words import describe

_LEAST_ESS = 400.0
_MOST_SAMPLED = 12


@dataclass(frozen=True, eq=False)
class MarginalPosterior:
    """Weighted draws of a joint posterior.

    names : (n_par,) of the problem.
    sampled : names of the parameters drawn from the marginal, the others were drawn given these.
    draws : (n_draw, n_par) in the problem's order.
    log_weights : (n_draw,) Pareto-smoothed, their exponentials sum to 1.
    k_hat, ess : of these weights.
    log_evidence, u_log_evidence : log p(y) and its Monte-Carlo error, by the marginal.
    k_hat_all, ess_all, log_evidence_all : of the smoothed weights in all dimensions for the sampled
        parameters of the first draws.
    shift : largest difference between the means, or standard deviations, of a sampled parameter by
        the two sets of weights, posterior standard deviations.
    refined : runs whose own parameters were not normal enough given the shared ones and were
        brought to their exact distribution.
    trusted : whether the draws may be used.
    findings : why or why not.
    """

    names: tuple[str, ...]
    sampled: tuple[str, ...]
    draws: FloatArray
    log_weights: FloatArray
    k_hat: float
    ess: float
    log_evidence: float
    u_log_evidence: float
    k_hat_all: float
    ess_all: float
    log_evidence_all: float
    shift: float
    refined: tuple[str, ...]
    trusted: bool
    findings: tuple[Finding, ...]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the draws may be used or not, in words."""
        return tuple(map(describe, self.findings))

    @property
    def mean(self) -> FloatArray:
        """(n_par,) posterior means."""
        return np.exp(self.log_weights) @ self.draws

    @property
    def sd(self) -> FloatArray:
        """(n_par,) posterior standard deviations."""
        return np.sqrt(np.exp(self.log_weights) @ (self.draws - self.mean) ** 2)

    def resampled(self, n_draw: int, *, rng: np.random.Generator) -> FloatArray:
        """(n_draw, n_par) draws of equal weight, by systematic resampling; more than `ess` of them
        repeat each other.
        """
        return self.draws[systematic(np.exp(self.log_weights), n_draw, rng)]


def sample_marginal(
    fit: Fit,
    *,
    rng: np.random.Generator,
    n_draw: int = 8000,
    n_check: int = 4000,
    n_node: int = 1,
    wide: bool = False,
    progress: Progress | None = None,
) -> MarginalPosterior:
    """Draws of the posterior of a joint fit, through the marginal of its shared parameters.

    n_draw : draws of the marginal.  n_check : how many of them get exact weights in all dimensions.
    n_node : Gauss-Hermite nodes along each own parameter of a run; 1 is Laplace's approximation, 5
        leaves no visible error.
    wide : whether a quarter of the draws comes from a proposal three times as wide.

    Raises InputError where a run's noise is not normal, where runs share nothing or too many
    parameters have to be sampled, and NumericalError where the fit leaves a combination of
    parameters undetermined or the proposal finds no posterior mass.
    """
    if fit.singular:
        raise NumericalError(
            "the marginal over runs needs a fit that determines every parameter: state one "
            "more of them with an uncertainty"
        )
    columns = sampled_columns(fit)
    if not columns.size:
        raise InputError("must share a parameter, for a marginal over runs", field="runs")
    terms = run_terms(fit, columns)
    weight = fit.measure_of_shared
    target = Marginal(fit.problem, columns, terms, weight)
    if progress is not None:
        progress(0, phrase("adaptation to the marginal over the runs"))
    mean, cov = fit.values[columns], fit.cov[np.ix_(columns, columns)]
    proposal = adapt_proposal(target, mean, cov, rng=rng, n_round=1000)
    if wide:
        proposal = proposal.widened()
    shared = proposal.draw(rng, n_draw)
    log_prior = target.log_prior(shared)
    in_support = np.flatnonzero(np.isfinite(log_prior))
    draws = np.empty((n_draw, fit.problem.n_par))
    draws[:, columns] = shared
    by_run, log_q = np.zeros((2, len(terms), n_draw))
    runs = target.at_runs(shared[in_support], n_node=n_node, progress=progress)
    for i, (log_marginal, around) in enumerate(runs):
        by_run[i, in_support] = log_marginal
        own, log_q[i, in_support] = around.draw(rng)
        draws[np.ix_(in_support, terms[i].columns[terms[i].own])] = own
    log_proposal = proposal.log_density(shared)
    raw = log_prior + np.sum(by_run, axis=0) - log_proposal
    log_weights = raw - np.max(raw)
    inside = np.flatnonzero(np.isfinite(log_weights))
    outside = np.flatnonzero(~np.isfinite(log_weights))
    first = inside[inside < n_check]
    raw_all = np.full(min(n_check, n_draw), -np.inf)
    raw_all[first] = (log_prior - log_proposal)[first]
    refined = []
    for number, (term, log_marginal, log_own) in enumerate(
        zip(terms, by_run, log_q, strict=True), start=1
    ):
        if progress is not None:
            progress(0, phrase("own parameters of run {k} of {n}", k=number, n=len(terms)))
        of_run, own_columns = target.of_run(term, shared), term.columns[term.own]
        own = draws[:, own_columns]
        # where a draw of the shared ones has no weight, the fit
        own[outside] = term.linearised(term.centre[None, term.own])
        excess = term.log_joint(of_run[first], own[first]) - log_own[first]
        raw_all[first] += excess
        # spread of a run's log weights above which its own parameters are no normal variables: a
        # shift of 0.08 of their sd
        if spread(excess - log_marginal[first], log_weights[first]) > 0.1:
            own[inside] = term.refine_own(of_run[inside], own[inside], rng)
            refined.append(term.run.name)
        draws[:, own_columns] = term.values(own)
    if fit.jeffreys is not None:
        correction = fit.jeffreys.exact(fit.problem.named(draws[inside])) - _log(
            weight, draws[inside]
        )
        correction += _log(fit.measure, draws[inside])
        correction = np.where(np.isnan(correction), -np.inf, correction)
        raw[inside] += correction
        raw_all[first] += correction[: first.size]
    log_weights, k_hat, log_evidence = pareto_smoothed(raw)
    check, k_hat_all, log_evidence_all = pareto_smoothed(raw_all)
    shift, u_shift = difference(shared[: check.size], log_weights[: check.size], check)
    ess, ess_all = kish_ess(log_weights), kish_ess(check)
    trusted, findings = _judge(
        k_hat,
        ess,
        k_hat_all,
        ess_all,
        shift,
        u_shift,
        n_node=n_node,
        exact=columns.size == fit.problem.n_par,
    )
    return MarginalPosterior(
        names=fit.names,
        sampled=tuple(fit.names[i] for i in columns),
        draws=draws,
        log_weights=log_weights,
        k_hat=k_hat,
        ess=ess,
        log_evidence=log_evidence,
        u_log_evidence=log_mean_uncertainty(raw),
        k_hat_all=k_hat_all,
        ess_all=ess_all,
        log_evidence_all=log_evidence_all,
        shift=shift,
        refined=tuple(refined),
        trusted=trusted,
        findings=findings,
    )


def _log(measure: Measure | None, draws: FloatArray) -> FloatArray | float:
    """(n_draw,) logarithm of a measure at draws (n_draw, n_par); 0 where there is none."""
    return 0.0 if measure is None else measure.log(draws[:, measure.columns])


def sampled_columns(fit: Fit) -> IntArray:
    """Which parameters are sampled: those of several runs, those of none, all of a single run's,
    and those close to a hard edge.

    Raises InputError where they are too many.
    """
    problem = fit.problem
    users = Counter(name for run in problem.runs for name in run.parameters)
    shared = [
        i
        for i, p in enumerate(problem.parameters)
        if users[p.name] != 1 or len(problem.runs) == 1 or isinstance(p.prior, JointNormal)
    ]
    # standard deviations to a hard edge below which a parameter is not treated as normal
    near = problem.room(fit.values) < 4.0 * fit.scale
    edges = [
        i
        for i, p in enumerate(problem.parameters)
        if near[i] and i not in shared and not isinstance(p.prior, LogNormal)
    ]
    if len(shared) + len(edges) > _MOST_SAMPLED:
        at_edges = (
            f", {len(edges)} of them close to the edge of their range "
            f"({problem.names[edges[0]]}, ...)"
            if edges
            else ""
        )
        raise InputError(
            f"are too many to sample at once ({len(shared) + len(edges)}, at most "
            f"{_MOST_SAMPLED}){at_edges}: use the sampler",
            field="shared parameters",
        )
    return np.array(sorted([*shared, *edges]), dtype=np.int64)


def _judge(
    k_hat: float,
    ess: float,
    k_hat_all: float,
    ess_all: float,
    shift: float,
    u_shift: float,
    *,
    n_node: int,
    exact: bool,
) -> tuple[bool, tuple[Finding, ...]]:
    """Whether the draws may be used, and why or why not."""
    wrong, notes = list[Finding](), list[Finding]()
    if not k_hat < K_HAT_LIMIT:
        wrong.append(Finding(Kind.MARGINAL_MISSED, size=k_hat, numbers={"limit": K_HAT_LIMIT}))
    if ess < _LEAST_ESS:
        wrong.append(Finding(Kind.MARGINAL_DRAWS_FEW, size=ess, numbers={"limit": _LEAST_ESS}))
    if exact:
        notes.append(Finding(Kind.WEIGHTS_EXACT))
    elif not k_hat_all < K_HAT_LIMIT:
        notes.append(Finding(Kind.WEIGHTS_UNEVEN, size=k_hat_all, numbers={"ess": ess_all}))
    elif shift > max(0.1, 4.0 * u_shift):
        wrong.append(
            Finding(Kind.WEIGHTS_MOVE, size=shift, numbers={"u": u_shift, "nodes": n_node})
        )
    else:
        notes.append(
            Finding(Kind.WEIGHTS_AGREE, size=shift, numbers={"u": u_shift, "k_hat": k_hat_all})
        )
    if not wrong:
        notes.insert(0, Finding(Kind.MARGINAL_SAMPLED, size=ess, numbers={"k_hat": k_hat}))
    return not wrong, (*wrong, *notes)
