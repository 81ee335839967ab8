"""What is wrong with a sampled fit, and what is worth knowing of it: findings, from which its
status follows (`estim.common.statuses`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, positive_or
from estim.checks.conflict import Conflict, stated_values
from estim.checks.consistency import Consistency
from estim.checks.doubtful_data import data_remarks
from estim.checks.goodness_of_fit import P_FLOOR, P_POOR_FIT, P_TOLD, SCATTER_LIMIT, Goodness
from estim.checks.identifiability import Identifiability
from estim.checks.model_discrepancy import deviation_remarks, unasked, wrong_curves
from estim.checks.modes import Modes
from estim.checks.outliers import bad_frames_found, too_many_bad_frames
from estim.checks.rolling import Rolling, rolling_remarks
from estim.checks.systematic_errors import Influence, large_influences
from estim.checks.unmodelled_force import beyond_their_priors, force_remarks
from estim.common import Amount, Finding, Kind, Status, decide, wrong
from estim.fitting import Fit, chi2_p, jeffreys_prior, limit_found, open_sides, pressed_edges
from estim.problem import Observations, same_curves
from estim.sampling import Agreement, Chain, mcse_mean, mixing_of
from estim.words import describe

# curvature of the log prior along a direction, 1 for a normal prior, below which it does not hold
# it
_FLAT = 0.05
# of a range, the part beside each limit, and of the draws, how many may lie there
_EDGE, _AT_EDGES = 0.05, 0.01

# standard deviations of a parameter, by which a run whose covariance is held may move those of
# others
_HELD_INFLUENCE = 0.2
# the same, by which flat weights of readings would move it, from which on equal weights are
# reported
_WEIGHTS_SHIFT = 0.3
_DRAWS = 4000  # that are weighted for it

# tests; residuals that fail one of them are no noise, wherever they are large
_OF_ORDER = frozenset({"runs", "autocorrelation", "trend"})

# share of outliers beyond which they may be another motion, and the frames called good a part of it
_CROWD = 0.35

_MOST_LISTED = 5  # separate solutions that are listed
# sds by which solutions must differ in a parameter for it to be reported, beside the one in which
# they differ most
_LEAST_DIFFERENCE = 0.5


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is known about the trustworthiness of a result.

    findings : everything wrong, gravest first.
    remarks : worth knowing, not wrong.  reasons, notes : the same in words.
    rhat, ess_bulk, ess_tail, mcse : (n_par,) of each parameter.
    sampled : False where the chain was given up, because the fit is not identified anyway.
    """

    status: Status
    findings: tuple[Finding, ...]
    remarks: tuple[Finding, ...]
    rhat: FloatArray
    ess_bulk: FloatArray
    ess_tail: FloatArray
    mcse: FloatArray
    sampled: bool = True

    @property
    def ok(self) -> bool:
        return self.status is Status.OK

    @property
    def reasons(self) -> tuple[str, ...]:
        return tuple(map(describe, self.findings))

    @property
    def notes(self) -> tuple[str, ...]:
        return tuple(map(describe, self.remarks))


def diagnose(
    fit: Fit,
    chain: Chain,
    goodness: Sequence[Goodness],
    *,
    comparison: Agreement,
    unheld: Sequence[Finding],
    modes: Modes,
    consistency: Consistency | None,
    conflict: Conflict,
    influences: Sequence[Influence],
    rolling: Sequence[Rolling] = (),
) -> Diagnosis:
    """The status of a sampled fit.

    goodness, comparison, modes, consistency, conflict, influences, rolling : what the checks found,
        as in `Analysis`, for which `analyse` and `sample_curve` call this.
    unheld : what the fit alone does not identify (`unidentified`); a chain that then falls short
        of its aims is not what is wrong.

    >>> from estim import Target, fit_curve, sample_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> diagnosis = sample_curve(fit, seed=1, target=Target(ess=400.0)).diagnosis
    >>> diagnosis.status, diagnosis.reasons
    ('ok', ())
    """
    sampled = chain.convergence.met or not unheld
    findings = wrong(
        [
            *([] if conflict.flagrant or not sampled else _convergence(fit, chain)),
            *several_solutions(fit, modes),
            *unheld,
            *pressed_edges(fit, Kind.PRESSED_EDGE),
            *failed_tests(goodness, dof=fit.dof),
            *beyond_their_priors(fit.forces),
            *wrong_curves(fit.deviations),
            *(
                [Finding(Kind.METHODS_DIFFER, parts=comparison.findings)]
                if sampled and comparison.verdict == "disagree"
                else []
            ),
            *([] if consistency is None or consistency.agree else [consistency.finding]),
            stated_values(fit, conflict),
            *too_many_outliers(fit),
            *(finding for force in fit.forces for finding in too_many_bad_frames(force)),
        ]
    )
    remarks = (
        _held_covariances(fit, Kind.COVARIANCE_HELD)
        + _equally_weighted_runs(fit)
        + _remarks(fit, goodness, conflict)
    )
    if not any(finding.kind is Kind.OPEN_SIDE for finding in unheld):
        draws = dict(zip(fit.names, chain.flat.T, strict=True))
        remarks += [limit_found(fit, name, draws[name]) for name in fit.limited]
    remarks += (
        []
        if findings
        else _uniform_priors(fit, chain)
        + rolling_remarks(rolling)
        + unasked(fit)
        + large_influences(fit, influences)
    )
    mixing = chain.mixing or mixing_of(chain.draws)
    return Diagnosis(
        status=decide(findings),
        findings=findings,
        remarks=tuple(remarks),
        rhat=mixing.rhat,
        ess_bulk=mixing.ess_bulk,
        ess_tail=mixing.ess_tail,
        mcse=mcse_mean(chain.draws),
        sampled=sampled,
    )


def _convergence(fit: Fit, chain: Chain) -> list[Finding]:
    unsettled = []
    if not fit.success:
        mover = (Amount(fit.mover),) if fit.mover else ()
        unsettled.append(Finding(Kind.FIT_UNSETTLED, size=fit.moved, parameters=mover))
    return unsettled + _held_covariances(fit, Kind.FIT_UNSETTLED) + sampling_findings(chain)


def _held_covariances(fit: Fit, kind: Kind) -> list[Finding]:
    """The runs whose covariance was held, where that influences other parameters (the fit
    did not settle), or where it does not (a note).
    """
    influence = max((record.influence for record in fit.held), default=0.0)
    if not fit.held or (influence > _HELD_INFLUENCE) != (kind is Kind.FIT_UNSETTLED):
        return []
    names = tuple(name for record in fit.held for name in record.runs)
    return [
        Finding(
            kind,
            size=max(record.off for record in fit.held),
            numbers={"felt": influence},
            names=names,
        )
    ]


def _equally_weighted_runs(fit: Fit) -> list[Finding]:
    """That readings of runs have equal weights whatever the shared parameters, where flat weights
    of their true values would show.
    """
    measure, readings = fit.measure, fit.problem.readings
    if measure is None or not readings or not measure.influence > _WEIGHTS_SHIFT:
        return []
    n_run = sum(not run.curve_parameters.isdisjoint(readings) for run in fit.problem.runs)
    return [Finding(Kind.RUNS_COUNT_ALIKE, size=measure.influence, numbers={"runs": n_run})]


def _uniform_priors(fit: Fit, chain: Chain) -> list[Finding]:
    """That the uniform priors of parameters with limits on both sides move one of the curve from
    where Jeffreys' prior has it.
    """
    problem = fit.problem
    if fit.singular or not np.any(problem.limited):
        return []
    old, new = (
        fit.sampled.jeffreys,
        jeffreys_prior(
            fit.posterior, fit.values, fit.cov, limited=True, coordinates=fit.coordinates
        ),
    )
    if new is None:
        return []
    draws = chain.thinned(_DRAWS)
    log_weights = new.log(draws, problem.named)
    if old is not None:
        log_weights -= old.log(draws, problem.named)
    weights = np.exp(log_weights - np.max(log_weights))
    shifts = (np.average(draws, axis=0, weights=weights) - draws.mean(axis=0)) / draws.std(axis=0)
    most = max(problem.of_curve, key=lambda i: abs(shifts[i]))
    if not abs(shifts[most]) > _WEIGHTS_SHIFT:
        return []
    indices = (most, *np.flatnonzero(problem.limited))
    amounts = tuple(Amount(fit.names[i], label=problem.parameters[i].label) for i in indices)
    return [Finding(Kind.UNIFORM_PRIOR_MOVES, size=float(shifts[most]), parameters=amounts)]


def sampling_findings(chain: Chain) -> list[Finding]:
    """What is wrong with a chain by itself."""
    findings = []
    if not chain.convergence.met:
        findings.append(
            Finding(
                Kind.CHAIN_SHORT, size=chain.convergence.n_step, parts=chain.convergence.findings
            )
        )
    if chain.stuck:
        findings.append(Finding(Kind.WALKERS_STUCK, size=chain.stuck))
    return findings


def several_solutions(fit: Fit, modes: Modes) -> list[Finding]:
    """Separate solutions, each with its share."""
    if not modes.several:
        return []
    sds = fit.scale
    largest = np.max(np.abs(modes.values[1:] - modes.values[0]), axis=0)
    differences = largest / positive_or(sds, np.inf)
    farthest = np.argsort(-differences)[:3].tolist()
    parameters = [
        fit.problem.parameters[i]
        for i in sorted(
            i for i in farthest if differences[i] > _LEAST_DIFFERENCE or i == farthest[0]
        )
    ]
    solutions = [
        Finding(
            Kind.SOLUTION,
            size=float(share),
            parameters=tuple(
                Amount(p.name, float(values[fit.names.index(p.name)]), p.label) for p in parameters
            ),
        )
        for values, share in zip(
            modes.values[:_MOST_LISTED], modes.shares[:_MOST_LISTED], strict=True
        )
    ]
    return [Finding(Kind.SEVERAL_SOLUTIONS, size=len(modes.values), parts=tuple(solutions))]


def same_curve(fit: Fit) -> tuple[Finding, ...]:
    """What else draws the same curve, or another one through the same points, and was left
    aside.
    """
    return (
        *(() if fit.symmetry is None else same_curves(fit.symmetry, fit.names, fit.values)),
        *fit.aliases,
    )


def unidentified(fit: Fit, identifiability: Identifiability) -> tuple[Finding, ...]:
    """What neither the data nor the priors hold, as the fit shows before any draw."""
    return (*_flat_directions(fit, identifiability), *open_sides(fit, fit.scale))


def held_by_draws(finding: Finding, fit: Fit, chain: Chain) -> bool:
    """Whether a direction that is flat at the fit is not so for the posterior: draws have converged
    and keep away from the limits of all that moves along it, where anything has limits.  The
    highest joint density of a spread and of what is spread by it lies in a corner of next to no
    probability.
    """
    if finding.kind is not Kind.DIRECTION_FLAT or not chain.convergence.met:
        return False
    moving = [fit.names.index(amount.name) for amount in finding.parameters]
    low, high = (limits[moving] for limits in fit.problem.support())
    limited = np.isfinite(high - low)
    if not limited.any():
        return False
    draws, low, high = chain.flat[:, moving][:, limited], low[limited], high[limited]
    at_edge = np.minimum(draws - low, high - draws) < _EDGE * (high - low)
    return bool(np.all(np.mean(at_edge, axis=0) <= _AT_EDGES))


def _flat_directions(fit: Fit, identifiability: Identifiability) -> list[Finding]:
    """Combinations of the curve's parameters that neither the data nor a prior with a pull hold,
    only the edges of ranges.
    """
    noise = np.array([name in fit.problem.noise_names for name in fit.names])
    findings = []
    for direction in identifiability.directions:
        loose = direction.information < 1.0 and direction.prior_pull < _FLAT
        if loose and np.sum(direction.vector[~noise] ** 2) > 0.5:
            findings.append(
                Finding(Kind.DIRECTION_FLAT, size=direction.information, parameters=direction.moves)
            )
    if fit.singular and not findings:
        findings.append(Finding(Kind.SINGULAR))
    return findings


def failed_tests(goodness: Sequence[Goodness], *, dof: int) -> list[Finding]:
    """The tests that the residuals of each run fail, chi2 of all runs, and a scatter that the
    instrument does not explain.

    dof : of all runs together.
    """
    findings = []
    n_obs = sum(run.whitened.size for run in goodness)
    for run in goodness:
        for name in run.failed:
            pattern = Kind.CURVE_LACKS if run.curve else Kind.RESIDUALS_NOT_RANDOM
            larger = _larger([run])
            times = {}
            if name == "chi2":  # mean square by what it should be
                share = run.whitened.size / n_obs * max(dof, 1)
                times = {"times": math.sqrt(run.checks[name].statistic / share)}
            kind = (
                Kind.RESIDUALS_ZERO if name == "zero" else larger if run.only_too_large else pattern
            )
            findings.append(
                Finding(
                    kind,
                    run=run.run,
                    test=name,
                    p=run.checks[name].p_value,
                    numbers={"least": P_FLOOR, **times},
                )
            )
        if run.scatter_ratio > SCATTER_LIMIT:
            findings.append(Finding(Kind.SCATTER_TOO_LARGE, run=run.run, size=run.scatter_ratio))
    sizes = [run.checks["chi2"].statistic for run in goodness if "chi2" in run.checks]
    if (
        1 < len(sizes) == len(goodness)
        and chi2_p(sum(sizes), dof) < P_POOR_FIT
        and not any(finding.test == "chi2" for finding in findings)
    ):
        times = {"times": math.sqrt(sum(sizes) / dof)}
        p = chi2_p(sum(sizes), dof)
        findings.append(Finding(_larger(goodness), test="chi2", p=p, numbers=times))
    return findings


def _larger(runs: Sequence[Goodness]) -> Kind:
    """What it is where nothing but the size of the residuals is wrong."""
    if all(run.counted for run in runs):
        return Kind.COUNTS_SCATTER
    return Kind.CHI2_TOO_LARGE if all(run.curve for run in runs) else Kind.RESIDUALS_TOO_LARGE


def tolerated_pattern(run: Goodness) -> list[Finding]:
    """A pattern in the residuals that the stated error covers, or that the intervals tolerate."""
    if run.tolerated:
        p = min(run.checks[name].p_value for name in run.tolerated)
        return [
            Finding(
                Kind.NEIGHBOURS_ALIKE,
                run=run.run,
                p=p,
                numbers={"least": P_FLOOR},
                names=run.tolerated,
            )
        ]
    if not run.covered:
        return []
    chi2 = run.checks["chi2"].statistic
    return [
        Finding(
            Kind.PATTERN_COVERED,
            run=run.run,
            size=(chi2 / run.whitened.size) ** 0.5,
            numbers={"chi2": chi2},
            names=run.covered,
        )
    ]


def marginal_tests(run: Goodness) -> list[Finding]:
    """Tests of the noise that a run passes, but not well."""
    return [
        Finding(
            Kind.RESIDUALS_HARDLY,
            run=run.run,
            test=name,
            p=run.checks[name].p_value,
            numbers={"least": P_FLOOR},
        )
        for name in run.marginal
    ]


def too_many_outliers(fit: Fit) -> list[Finding]:
    """Runs of which so many readings would be outliers that nothing shows which of the two groups
    belongs to the curve.
    """
    findings = []
    for run in fit.problem.runs:
        share = run.noise.outlier_share(fit.named)
        if share > _CROWD:
            findings.append(Finding(Kind.OUTLIERS_CROWD, run=run.name, size=share))
    return findings


def _from_pictures(run: Observations) -> bool:
    """Whether what was read may be places in pictures: lengths, and no counts of an encoder."""
    return run.noise.size.step == 0.0 and (run.y_unit if run.positions else run.x_unit) == "m"


def _remarks(fit: Fit, goodness: Sequence[Goodness], conflict: Conflict) -> list[Finding]:
    stated = stated_values(fit, conflict)
    remarks = [stated] if stated.kind is Kind.STATED_HARDLY else []
    remarks += same_curve(fit)
    remarks += [
        remark
        for force in fit.forces
        for remark in (*bad_frames_found(force), *force_remarks(force))
    ]
    runs = {run.name: run for run in fit.problem.runs}
    for lack in fit.deviations:
        remarks += deviation_remarks(
            lack, x_unit=runs[lack.run].x_unit, y_unit=runs[lack.run].y_unit
        )
    # readings that are off may well lie where the body is fast
    with_bad_frames = {force.run for force in fit.forces if force.bad.jumps}
    for good, run in zip(goodness, fit.problem.runs, strict=True):
        remarks += tolerated_pattern(good) + marginal_tests(good)
        chi2 = good.checks.get("chi2")
        if (
            chi2 is not None
            and chi2.p_below < good.level
            and not good.covered
            and run.lacks is None
        ):
            kind = Kind.COUNTS_EVEN if good.counted else Kind.RESIDUALS_SMALL
            remarks.append(
                Finding(kind, run=good.run, test="chi2", p=chi2.p_below, numbers={"least": P_FLOOR})
            )
        patterned = run.name in with_bad_frames or not _OF_ORDER.isdisjoint(good.failed)
        if good.speed is not None and good.speed.p_value < P_TOLD / good.among and not patterned:
            numbers = {"least": P_FLOOR, "pictures": float(_from_pictures(run))}
            remarks.append(
                Finding(
                    Kind.NOISE_WITH_SPEED,
                    run=good.run,
                    test="speed",
                    p=good.speed.p_value,
                    numbers=numbers,
                )
            )
        if 1.5 < good.scatter_ratio <= SCATTER_LIMIT:
            remarks.append(Finding(Kind.SCATTER_LARGE, run=good.run, size=good.scatter_ratio))
    remarks += data_remarks(fit.problem.runs)
    for run in fit.problem.runs:
        readings = run.motion.instrument_readings if run.motion else ()
        exact = tuple(name for name in readings if isinstance(run.arguments.get(name), float))
        if exact:
            remarks.append(Finding(Kind.TAKEN_AS_EXACT, run=run.name, names=exact))
    return remarks
