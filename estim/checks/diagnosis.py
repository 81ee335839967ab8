"""The status of a result: one place decides whether a number may be trusted, and says why not and what to do.

Statuses, first that applies: `not-converged`, `methods-disagree` (the draws mean nothing, not even as limits), `multimodal`,
`not-identified`, `poor-fit` (a limit from a wrong curve is none), `at-bound`, `ok`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.checks.conflict import NOTE_BELOW, Conflict, conflict_words
from estim.checks.consistency import Consistency
from estim.checks.goodness import P_FLOOR, P_POOR_FIT, SCATTER_LIMIT, Goodness
from estim.checks.identifiability import Identifiability
from estim.checks.modes import Modes
from estim.common import STATUSES, Finding, format_p
from estim.fitting import PRESSED_BELOW, Fit, limit_words, pressed, shown_edge
from estim.problem import Mixture, Parameter, in_words
from estim.sampling import Agreement, Chain, effective_size, mcse_mean, r_hat

_FLAT = 0.05  # curvature of the log prior along a direction, 1 for a normal prior, below which it does not hold it

_CROWD = 0.35  # share of outliers beyond which they may be another motion, and the frames called good a part of it

_MOST_TOLD = 5  # separate solutions that are listed

_TOO_LARGE = (
    "the residuals look random, only larger than stated: if nothing in the file explains it, let the data say how large the errors are, "
    "by a prior in place of the number, for example sigma_x_m = {prior = \"log-normal\", median = 0.001, log_sd = 1.0} "
    "(in a [curve] table leave u_y out)"
)

_NOT_RANDOM = "look at the residuals: a bad frame, a wrong window, or physics that the curve lacks; the uncertainties assume random errors"

_COMPUTED = "give the readings themselves, not numbers computed or smoothed by the curve; simulated data need their errors added"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is known about the trustworthiness of a result.

    status : one of STATUSES.  findings : everything wrong, gravest first.  notes : worth knowing, not wrong.
    rhat, ess_bulk, ess_tail, mcse : (n_par,) of each parameter.
    """

    status: str
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    rhat: FloatArray
    ess_bulk: FloatArray
    ess_tail: FloatArray
    mcse: FloatArray

    @property
    def ok(self) -> bool:
        return self.status == "ok"

    @property
    def reasons(self) -> tuple[str, ...]:
        return tuple(finding.reason for finding in self.findings)


def diagnose(
    fit: Fit, chain: Chain, goodness: Sequence[Goodness], *, comparison: Agreement, identifiability: Identifiability, modes: Modes,
    consistency: Consistency | None, conflict: Conflict,
) -> Diagnosis:
    """The status of a sampled fit."""
    findings = [
        *_convergence(fit, chain), *several_solutions(fit, modes), *_flat_directions(fit, identifiability), *_bounds(fit), *_goodness(goodness),
        *_methods(comparison), *_consistency(consistency), *_conflict(fit, conflict), *too_many_outliers(fit),
    ]
    findings.sort(key=lambda finding: STATUSES.index(finding.status))
    return Diagnosis(
        status=findings[0].status if findings else "ok", findings=tuple(findings), notes=tuple(_notes(fit, chain, goodness, conflict)),
        rhat=r_hat(chain.draws), ess_bulk=effective_size(chain.draws, "bulk"), ess_tail=effective_size(chain.draws, "tail"),
        mcse=mcse_mean(chain.draws),
    )


def _convergence(fit: Fit, chain: Chain) -> list[Finding]:
    findings = []
    if not fit.success:
        findings.append(Finding("not-converged", f"the least-squares fit {fit.message}", "check the starting values and the priors"))
    return findings + sampling_findings(chain)


def sampling_findings(chain: Chain) -> list[Finding]:
    findings = []
    if not chain.convergence.met:
        findings.append(
            Finding(
                "not-converged", f"sampling stopped after {chain.convergence.n_step} steps although {chain.convergence.message}",
                "raise --max-steps; if that does not help, look at the traces: a parameter that wanders needs a tighter prior or more data",
            )
        )
    if chain.stuck:
        reason = f"{chain.stuck} walker{'s' if chain.stuck > 1 else ''} never moved"
        findings.append(Finding("not-converged", reason, "start again with another --seed, and look at the traces"))
    return findings


def _bounds(fit: Fit) -> list[Finding]:
    """Edges that the data contradict.  A parameter that merely lies on one is a limit, which is a result (`_notes`)."""
    findings = []
    for name, p_value in pressed(fit).items():
        if p_value < PRESSED_BELOW:
            i = fit.names.index(name)
            parameter, value = fit.problem.parameters[i], float(fit.values[i])
            edge = f"{parameter.label.symbol} lies at the edge of its prior, {shown_edge(parameter, value)}"
            findings.append(
                Finding(
                    "at-bound", f"{edge}, and the data ask for values beyond it ({format_p(p_value)})",
                    "if values beyond the edge are possible, widen the prior; if not, something else is wrong: a stated value, a scale, the curve",
                )
            )
    return findings


def several_solutions(fit: Fit, modes: Modes) -> list[Finding]:
    """Separate solutions, each with its share."""
    if not modes.several:
        return []
    sds = np.sqrt(np.diag(fit.cov))
    apart = np.max(np.abs(modes.values[1:] - modes.values[0]), axis=0) / np.where(sds > 0.0, sds, np.inf)
    told = sorted(np.argsort(-apart)[:3].tolist())
    solutions = [
        f"{', '.join(_shown(fit.problem.parameters[i], values[i]) for i in told)} ({share:.0%} of the posterior)"
        for values, share in zip(modes.values[:_MOST_TOLD], modes.shares[:_MOST_TOLD], strict=True)
    ]
    n = len(modes.values)
    more = f"; and {n - _MOST_TOLD} more" if n > _MOST_TOLD else ""
    advice = "decide between the solutions by a prior (a range that holds one of them) or by a further measurement, and fit again"
    return [Finding("multimodal", f"the data allow {n} separate solutions: {'; or '.join(solutions)}{more}", advice)]


def same_curve(fit: Fit) -> list[str]:
    """What else draws the same curve, or another one through the same points, and was left aside."""
    words = [] if fit.symmetry is None else list(in_words(fit.symmetry, fit.names, fit.values))
    return [*words, *([fit.aliases] if fit.aliases else [])]


def _shown(parameter: Parameter, value: float) -> str:
    """'θ₀[r] = 60.1 °'."""
    shown = parameter.label
    return f"{shown.symbol} = {value * shown.factor:.4g}{'' if shown.unit == '1' else f' {shown.unit}'}"


def _flat_directions(fit: Fit, identifiability: Identifiability) -> list[Finding]:
    """Combinations of the curve's parameters that neither the data nor a prior with a pull hold, only the edges of ranges."""
    noise = np.array([name in fit.problem.noise_names for name in fit.names])
    findings = []
    for direction in identifiability.directions:
        loose = direction.information < 1.0 and direction.prior_pull < _FLAT
        if loose and np.sum(direction.vector[~noise] ** 2) > 0.5:
            reason = f"data and priors do not fix a combination of parameters, only the edges of their ranges do: {direction.words}"
            advice = "state one of these parameters as a measured value with its uncertainty (a uniform range does not count)"
            findings.append(Finding("not-identified", reason, advice))
    if fit.singular and not findings:
        reason = "a combination of the parameters is determined neither by the data nor by the priors"
        advice = "state at least one of the parameters with an uncertainty; the table of correlations shows which go together"
        findings.append(Finding("not-identified", reason, advice))
    return findings


def _methods(comparison: Agreement) -> list[Finding]:
    if comparison.verdict != "disagree":
        return []
    advice = "try another --seed and a higher --max-steps; if they still differ, report it: one of two computations of the same thing is wrong"
    return [Finding("methods-disagree", comparison.reason, advice)]


def _consistency(consistency: Consistency | None) -> list[Finding]:
    if consistency is None or consistency.agree:
        return []
    advice = "fit the run that disagrees by itself, look at its file and its stated values; leave it out only for a reason found there"
    return [Finding("poor-fit", consistency.verdict, advice)]


def _conflict(fit: Fit, conflict: Conflict) -> list[Finding]:
    if conflict.agree:
        return []
    advice = "check what was stated: its unit, its uncertainty, and the scale and zero of the data; a compromise between two that disagree is neither"
    return [Finding("poor-fit", conflict_words(fit, conflict), advice)]


def _goodness(goodness: Sequence[Goodness]) -> list[Finding]:
    findings = []
    for run in goodness:
        for name in run.failed:
            check = run.checks[name]
            findings.append(
                Finding(
                    "poor-fit", f"run {run.run}: {check.meaning} (test '{name}', {_p(check.p_value)})",
                    _COMPUTED if name == "zero" else _TOO_LARGE if run.only_too_large else _NOT_RANDOM,
                )
            )
        if run.scatter_ratio > SCATTER_LIMIT:
            findings.append(
                Finding(
                    "poor-fit", f"run {run.run}: the inferred scatter is {run.scatter_ratio:.0f} times what the instrument explains",
                    "the curve does not describe this motion, or the stated resolution of the instrument is far too good",
                )
            )
    return findings


def too_many_outliers(fit: Fit) -> list[Finding]:
    """Runs of which so many frames would be outliers that nothing tells which of the two groups is the motion."""
    findings = []
    for run in fit.problem.runs:
        if isinstance(run.noise.tails, Mixture):
            share = float(fit.values[fit.names.index(run.noise.tails.fraction)])
            if share > _CROWD:
                reason = f"run {run.name}: {share:.0%} of the frames would be outliers: it may be the others that are not the motion"
                advice = "leave out by a window what is not the motion; robust noise is for a minority of bad frames"
                findings.append(Finding("poor-fit", reason, advice))
    return findings


def _p(p: float) -> str:
    return f"p < {P_FLOOR:.1g}" if p <= P_FLOOR else f"p = {p:.1g}"


def _notes(fit: Fit, chain: Chain, goodness: Sequence[Goodness], conflict: Conflict) -> list[str]:
    notes = [conflict_words(fit, conflict)] if conflict.agree and conflict.p_value < NOTE_BELOW else []
    notes += same_curve(fit)
    if fit.n_same < fit.n_start:
        notes.append(f"{fit.n_start - fit.n_same} of {fit.n_start} starts of the fit ended elsewhere than at the best optimum")
    for good in goodness:
        chi2 = good.checks.get("chi2")
        if chi2 is not None and chi2.p_value > 1.0 - P_POOR_FIT:
            p = _p(1.0 - chi2.p_value)
            notes.append(f"run {good.run}: the residuals are smaller than the stated noise ({p}): is the stated sigma too large?")
        if good.scatter_ratio > 3.0:
            notes.append(f"run {good.run}: the inferred scatter is {good.scatter_ratio:.1f} times what the instrument explains")
    for run in fit.problem.runs:
        exact = [name for name in (run.motion.instrument_readings if run.motion else ()) if isinstance(run.arguments.get(name), float)]
        if exact:
            notes.append(f"run {run.name}: {' and '.join(exact)} taken as exact: every result is only as good as that")
    notes += [limit_words(fit, name, chain.flat[:, fit.names.index(name)]) for name in fit.at_bound]
    return notes
