"""The same runs with several models of the body, side by side (`estim compare-models`): which one
the data favour, and what each makes of the result.

Log evidences (of the second computation, so with a Monte-Carlo error) and leave-one-out predictions
are compared between models of the same points under noise with the same room.  An evidence depends
on the width of the priors of what a model adds: each is made half and twice as wide.  The room for
the start, whose width is a convention, costs some units of log evidence a run; what it costs is
known and held against no model.

A model is distinguished from another by odds of 20 (log evidence by 3: "strong", Kass and Raftery,
J. Am. Stat. Assoc. 90 (1995) 773).  The default, with an unmodelled force and a free start, is left
only for a model of something that it does not contain and that is distinguished from all that do
not have it.  A simpler model that the default contains is no reason to leave it: that no room was
needed does not show that nothing is missing, and an interval of a model chosen by its own data is
too narrow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import Campaign, CurveModel
from estim.checks import difference
from estim.common import InputError, PieceStore, Stream, later, phrase, stream
from estim.discrepancy import BadFrames, MixtureErrors, log_rescaled, log_restarted
from estim.explanation import Predicted, predictive_checks
from estim.fitting import Fit, fit_problem, fit_white, fit_without_force
from estim.pipeline import Analysis, analyse_fit
from estim.problem import Prior
from estim.sampling import (
    K_HAT_LIMIT,
    Target,
    adapt_proposal,
    certify,
    log_mean_uncertainty,
    pareto_smoothed,
)
from estim.studies.noise_comparison import (
    LOO_DRAWS,
    ProgressOf,
    Refit,
    beside_the_best,
    refit_of,
    same_points,
    shown,
)

APART = 3.0  # of log evidence
# of elpd: less, or less than so many of its standard errors, decides nothing
BEHIND, SES = 4.0, 2.0
FACTORS = (0.5, 2.0)  # of the width of a prior
# what the default adds beside parameters
FORCE, START = later("the force"), later("the free start")


class Ground(StrEnum):
    """Why a model is recommended."""

    ROOM = "room"  # the default: nothing that it does not contain has more evidence
    # the default: something that it does not contain has more evidence, and is not distinguished
    UNDECIDED = "undecided"
    SHOWN = "shown"  # something that the default does not contain
    BEST = "best"  # there is no default to fall back on
    NONE = "none"  # no model is ok


class NoEvidence(StrEnum):
    """Why a model has no evidence that can be compared."""

    NOT_COMPUTED = "not-computed"  # too many unknowns, or runs were integrated out
    UNRELIABLE = "unreliable"
    OTHER_NOISE = "other-noise"  # its noise has not the room that the others have
    IMPROPER = "improper"  # a prior that is no distribution


@dataclass(frozen=True)
class Width:
    """By how much the log evidence grows where the prior of one thing (a parameter, `FORCE`,
    `START`) is `factor` times as wide; 0: exact.
    """

    of: str
    factor: float
    change: float
    u: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedModel(Refit):
    """A model with its analysis.

    log_evidence, u_log_evidence : nan where there is none to compare, for the reason in `lack`.
    odds : log evidence below that of the best row.
    widths : of everything that it adds.
    predicted : of every run.
    """

    model: CurveModel
    log_evidence: float
    u_log_evidence: float
    lack: NoEvidence | None
    odds: float
    widths: tuple[Width, ...]
    predicted: tuple[Predicted, ...]

    @property
    def price_of_start(self) -> float:
        """What its free start costs in log evidence, where exact starts would have more; 0 for a
        model without.
        """
        return max(
            (
                width.change
                for width in self.widths
                if width.of == START and width.factor == 0.0 and width.change > 0.0
            ),
            default=0.0,
        )


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """rows : as `Campaign.curve_models` has them.  recommended : name, "" where none is.  ground :
    why.  by_evidence : else by elpd.
    """

    rows: tuple[ComparedModel, ...]
    recommended: str
    ground: Ground
    by_evidence: bool


def compare_models(
    campaign: Campaign,
    runs: Sequence[str],
    *,
    seed: int,
    target: Target | None = None,
    chosen: Sequence[str] = (),
    progress_of: ProgressOf | None = None,
    store: PieceStore | None = None,
) -> ModelComparison:
    """Every model of `runs`, fit jointly.  chosen : names of models, for those alone; empty for
    all.

    store : keeps the draws of each model (`analyse`).  Raises InputError where there is nothing to
        compare, or models would not have the same points.
    """
    every = campaign.curve_models(runs)
    for name in chosen:
        if name not in [model.name for model in every]:
            raise InputError(
                f"must name one of the models ({', '.join(model.name for model in every)})",
                field="--model",
                value=name,
            )
    models = [model for model in every if not chosen or model.name in chosen]
    if len(models) < 2:
        raise InputError("must name two models or more", field="--model", value=", ".join(chosen))
    check_same_points(models)
    bad: Mapping[str, BadFrames] = {}
    refits: dict[str, Refit] = {}
    # it shows the bad frames that all have
    for model in sorted(models, key=lambda model: not model.forced):
        with shown(progress_of, model.name) as progress:
            if progress is not None:
                progress(0, phrase("fit"))
            with campaign.placing(model.problem):
                fit = fit_model(model, bad=bad, rng=stream(seed, Stream.FIT))
            if model.forced and len(runs) == 1:
                bad = {force.run: force.bad for force in fit.forces}
            model_store = (
                None if store is None else store.with_inputs(campaign.digests(runs), model.name)
            )
            analysis = analyse_fit(
                fit, seed=seed, target=target, progress=progress, store=model_store
            )
        analysis = replace(analysis, title=campaign.title, kind=campaign.kind)
        refits[model.name] = refit_of(model.name, model.words, analysis)
    return _compared(models, refits, seed)


def fit_model(model: CurveModel, *, bad: Mapping[str, BadFrames], rng: np.random.Generator) -> Fit:
    """The posterior mode of a model; bad : run -> frames that are shifted, in models without a
    force.
    """
    if model.forced or not model.roomy:
        return fit_problem(model.problem, rng=rng)
    return fit_without_force(fit_white(model.problem, rng=rng), bad=bad, rng=rng)


def check_same_points(models: Sequence[CurveModel]) -> None:
    """Raises InputError where a model has other points than the first one: densities of different
    data cannot be compared.
    """
    for model in models[1:]:
        if not same_points(model.problem, models[0].problem):
            raise InputError(
                f"has other points than {models[0].name}, and cannot be compared with it",
                field="model",
                value=model.name,
            )


def _compared(
    models: Sequence[CurveModel], refits: Mapping[str, Refit], seed: int
) -> ModelComparison:
    evidences = {model.name: _evidence(refits[model.name].analysis, model) for model in models}
    highest = max(
        (value for value, _, lack in evidences.values() if lack is None), default=math.nan
    )
    compared = []
    for i, model in enumerate(models):
        refit = refits[model.name]
        analysis, (value, u, lack) = refit.analysis, evidences[model.name]
        draws, rng = analysis.chain.thinned(LOO_DRAWS), stream(seed, Stream.WIDTHS, i)
        compared.append(
            ComparedModel(
                **vars(refit),
                model=model,
                log_evidence=value,
                u_log_evidence=u,
                lack=lack,
                odds=highest - value,
                widths=() if lack is not None else _widths(model, analysis, rng=rng),
                predicted=predictive_checks(
                    analysis.fit.posterior, draws, rng=stream(seed, Stream.AGAIN)
                ),
            )
        )
    rows = beside_the_best(compared)
    by_evidence = all(row.lack is None for row in rows if row.ok)
    return ModelComparison(rows, *recommend(rows, by_evidence=by_evidence), by_evidence)


def recommend(rows: Sequence[ComparedModel], *, by_evidence: bool) -> tuple[str, Ground]:
    """The model to report, "" for none, and why."""
    good = [row for row in rows if row.ok]
    if not good:
        return "", Ground.NONE
    default = next((row for row in good if row.model.forced), None)
    if default is None:
        return min(
            good, key=lambda row: row.odds if by_evidence else row.behind
        ).model.name, Ground.BEST
    rival = rival_of(good, by_evidence=by_evidence)
    if rival is None:
        return default.model.name, Ground.ROOM
    if all(
        _distinguished(rival, row, by_evidence=by_evidence)
        for row in good
        if row is default or contains(default, row)
    ):
        return rival.model.name, Ground.SHOWN
    return default.model.name, Ground.UNDECIDED


def rival_of(rows: Sequence[ComparedModel], *, by_evidence: bool) -> ComparedModel | None:
    """The best of the models that are ok and have something that the default does not contain; None
    where none is better than the default.
    """
    good = [row for row in rows if row.ok]
    default = next((row for row in good if row.model.forced), None)
    if default is None:
        return None

    def lead(row: ComparedModel) -> float:
        return log_odds(row, default) if by_evidence else default.behind - row.behind

    others = (row for row in good if row is not default and not contains(default, row))
    best = max(others, key=lead, default=None)
    return best if best is not None and lead(best) > 0.0 else None


def log_odds(row: ComparedModel, other: ComparedModel) -> float:
    """Log evidence of `row` less that of `other`; what the free start of one costs is left out
    where the other starts exactly at rest.
    """
    return other.odds - row.odds + _penalty_of_start(row, other) - _penalty_of_start(other, row)


def _penalty_of_start(row: ComparedModel, other: ComparedModel) -> float:
    at_rest = not other.model.forced and not any(
        name.startswith(("release_energy", "release_speed")) for name in other.model.own
    )
    return row.price_of_start if at_rest else 0.0


def contains(larger: ComparedModel, row: ComparedModel) -> bool:
    """Whether a model has all that another has; one with a force has a free start too."""
    if larger.model.forced and row.model.name == "free-start":
        return True
    return larger.model.forced >= row.model.forced and set(row.model.own) <= set(larger.model.own)


def _distinguished(better: ComparedModel, worse: ComparedModel, *, by_evidence: bool) -> bool:
    if by_evidence:
        return log_odds(better, worse) >= APART
    gain, se = difference(better.loo, worse.loo)
    return gain > max(BEHIND, SES * se)


def _evidence(analysis: Analysis, model: CurveModel) -> tuple[float, float, NoEvidence | None]:
    """Log evidence and its error, or why there is none to compare."""
    certificate, likelihoods = analysis.certificate, analysis.fit.posterior.likelihoods
    lack = None
    if any(not math.isfinite(p.prior.sd) for p in analysis.problem.parameters):
        lack = NoEvidence.IMPROPER
    elif model.roomy and not all(
        isinstance(likelihood, MixtureErrors) for likelihood in likelihoods
    ):
        lack = NoEvidence.OTHER_NOISE
    elif certificate is None:
        lack = NoEvidence.NOT_COMPUTED
    elif not certificate.reliable:
        lack = NoEvidence.UNRELIABLE
    if lack is not None or certificate is None:
        return math.nan, math.nan, lack
    return certificate.log_evidence, certificate.u_log_evidence, None


def _widths(
    model: CurveModel, analysis: Analysis, *, rng: np.random.Generator
) -> tuple[Width, ...]:
    """From the draws: the posterior mean of new over old prior; by a computation of its own where
    too few draws tell.
    """
    fit, draws, widths = analysis.fit, analysis.chain.thinned(8000), []
    for name in model.own:
        i = fit.names.index(name)
        prior = fit.problem.parameters[i].prior
        for factor in FACTORS:
            wider = prior.widened(factor)
            if wider is prior:
                continue
            width = _width(
                name, factor, wider.log_density(draws[:, i]) - prior.log_density(draws[:, i])
            )
            widths.append(
                width
                if math.isfinite(width.change)
                else Width(name, factor, *_recomputed(analysis, name, wider, rng))
            )
    if model.forced:
        widths += [_width(FORCE, factor, _log_ratio(analysis, FORCE, factor)) for factor in FACTORS]
        widths += [
            _width(START, factor, _log_ratio(analysis, START, factor)) for factor in (0.0, *FACTORS)
        ]
    return tuple(widths)


def _width(of: str, factor: float, log_ratio: FloatArray) -> Width:
    """From the posterior mean of new over old likelihood or prior (n_draw,); nan where too few
    draws tell.
    """
    log_weights, k_hat, change = pareto_smoothed(log_ratio)
    if k_hat > K_HAT_LIMIT:
        return Width(of, factor, math.nan, math.nan)
    return Width(of, factor, change, log_mean_uncertainty(log_weights))


def _log_ratio(analysis: Analysis, of: str, factor: float) -> FloatArray:
    """(n_draw,) of the likelihood with more or less room for a force, or for the start."""
    fit, draws = analysis.fit, analysis.chain.thinned(LOO_DRAWS)
    ratio, named = np.zeros(draws.shape[0]), fit.problem.named(draws)
    for group, likelihood in zip(fit.problem.groups, fit.posterior.likelihoods, strict=True):
        assert isinstance(likelihood, MixtureErrors), "asked before"
        if of == FORCE:
            ratio += log_rescaled(likelihood, named, scale=group.runs[0].force, factor=factor)
        else:
            ratio += log_restarted(likelihood, named, n_run=len(group.runs), factor=factor)
    return ratio


def _recomputed(
    analysis: Analysis, name: str, prior: Prior, rng: np.random.Generator
) -> tuple[float, float]:
    fit, certificate = analysis.fit, analysis.certificate
    assert certificate is not None, "asked before"
    density = replace(fit.sampled, problem=fit.problem.with_priors({name: prior}))
    once_more = certify(density, adapt_proposal(density, fit.values, fit.cov, rng=rng), rng=rng)
    if not once_more.reliable:
        return math.nan, math.nan
    return once_more.log_evidence - certificate.log_evidence, math.hypot(
        once_more.u_log_evidence, certificate.u_log_evidence
    )
