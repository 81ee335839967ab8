"""A finding as a sentence, and what to do about it.

Advice that names a choice of the reader names arguments in Python, and else uses words that hold
for an option, a key of a campaign and a field of the page (`estim.common.spoken`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from estim.common import Finding, Kind, at_commands, later, phrase
from estim.words import (
    agreement,
    draws,
    frames,
    model_discrepancy,
    parameters,
    releases,
    residuals,
    rolling,
    trials,
)
from estim.words.table import Table, filled

_NOT_RANDOM = later(
    "look at the residuals: a bad reading, a wrong window, or an effect that the curve does "
    "not model; the uncertainties "
    "assume random errors"
)
_ONE_RUN = later(
    "fit the disagreeing run alone, and check its file and its stated values; leave it out "
    "only for a reason found there"
)
_ANOTHER = later(
    "try {curve}: in simulations with a wrong curve, intervals that allow for a "
    "deviation seldom contained the true value"
)
_ONE_FAR_OFF = later(
    "look at the outlying reading; if single readings may be blunders, allow for outliers "
    "({robust}): each is named and has hardly any weight"
)
_OF_TEST: Mapping[str, str] = {
    "largest": _ONE_FAR_OFF,
    "uneven": later(
        "where the residuals are largest, the curve may lack something, a damping for instance; "
        "if only the errors differ, state the standard deviation of each reading ({u_y}), for "
        "example as a fraction of the reading"
    ),
    "repeated": later(
        "readings at the same x share an error, or the curve is wrong: if the curve is "
        "known to be right, fit the mean of the "
        "readings at each x without u_y, so that the scatter of the means about the "
        "curve determines the size of their errors"
    ),
}  # what to do about a curve whose residuals fail one test
_OF_RESIDUALS = (Kind.CURVE_LACKS, Kind.RESIDUALS_TOO_LARGE, Kind.CHI2_TOO_LARGE)


@dataclass(frozen=True)
class Choice:
    """What a reader may choose anew for another fit: an option of `estim fit`, without its hyphens,
    and its value; "" where the reader must say it, NAME= where that of a parameter.
    """

    option: str
    value: str


_CHOICES: Mapping[str, tuple[str, str, Choice | None]] = {
    "{seed}": ("seed=", later("seed (--seed)"), None),
    "{steps}": ("target=Target(max_step=...)", later("the number of steps (--max-steps)"), None),
    "{curve}": (later("another curve"), later("another curve"), Choice("formula", "")),
    "{correlated}": (
        "correlated=True",
        later("correlated errors (correlated)"),
        Choice("correlated", "true"),
    ),
    "{robust}": ('robust="mixture"', "robust: mixture", Choice("robust", "mixture")),
    "{jitter}": (
        "jitter=True",
        later("further errors of y, beside those stated (jitter)"),
        Choice("jitter", "true"),
    ),
    "{u_y}": (later("a column of u_y"), later("a column of u_y"), Choice("u-y", "")),
    "{value}": (
        later("a measured value with its uncertainty"),
        later("a measured value with its uncertainty"),
        Choice("value", "{name}="),
    ),
}
"""What is chosen, as it stands in advice -> how in Python, how in words for an option, a key of a
campaign and a field of the page, and as an option."""

WORDS: Table = {
    **parameters.WORDS,
    **draws.WORDS,
    **residuals.WORDS,
    **model_discrepancy.WORDS,
    **frames.WORDS,
    **agreement.WORDS,
    **trials.WORDS,
    **rolling.WORDS,
    **releases.WORDS,
}

ADVICE: Mapping[Kind, str] = {
    Kind.FIT_UNSETTLED: (
        "check the starting values and the priors; a parameter that still changes may need a limit"
    ),
    Kind.STEP_UNSETTLED: "give it limits, or try other starting values",
    Kind.ROUNDING: (
        "set limits on parameters that became far too large, or write the formula in x "
        "- x0, with x0 in the middle of the data"
    ),
    Kind.VALUE_OUTSIDE: "try other starting values",
    Kind.BETTER_ELSEWHERE: "start the fit there",
    Kind.CHAIN_SHORT: (
        "look at the trace plots: where parameters drift, drop or state one of them, or take "
        "data over a longer range; otherwise increase {steps}"
    ),
    Kind.WALKERS_STUCK: "repeat with another {seed}, and look at the trace plots",
    Kind.METHODS_DIFFER: (
        "try another {seed} and increase {steps}; if they still differ, report it as a "
        "bug: one of two computations of the same "
        "quantity is wrong"
    ),
    Kind.EFFECTS_FITTED: "draw the posterior: sample_curve(fit, seed=1)",
    Kind.SLOPES_DIFFER: ("the priors of the Bayesian line influence the result: take more points"),
    Kind.SEVERAL_SOLUTIONS: (
        "choose between the solutions by a prior (a range that contains one of them) "
        "or by a further measurement, and fit again"
    ),
    Kind.DIRECTION_FLAT: (
        "state one of these parameters as {value} (a uniform range does not count)"
    ),
    Kind.SINGULAR: (
        "state {value} for at least one of the parameters; the table of "
        "correlations shows which are correlated"
    ),
    Kind.UNDETERMINED: "state {value} for one of the parameters, or fix it",
    Kind.HARDLY_HELD: (
        "give it limits or {value}, or leave out the term that the data do not show"
    ),
    Kind.STEPS_OPEN: "start it near the data, where its uncertainty is smallest",
    Kind.OPEN_SIDE: (
        "state {value} for it or one that compensates, leave out the term that the data do not "
        "show, or take data over a longer range"
    ),
    Kind.LINE_NOT_RISING: (
        "gamma = 1/slope requires a slope that is definitely positive: measure at more "
        "tilts and at steeper ones"
    ),
    Kind.RESIDUALS_ZERO: (
        "use the readings themselves, not numbers computed or smoothed from the curve; "
        "simulated data need simulated errors added"
    ),
    Kind.RESIDUALS_TOO_LARGE: (
        "the residuals look random, but larger than stated: if nothing in the file "
        "explains this, let the data determine the size of "
        "the errors, by a prior in place of the number, for example sigma_x_m = {prior "
        '= "log-normal", median = 0.001, log_sd = '
        "1.0}"
    ),
    Kind.RESIDUALS_NOT_RANDOM: _NOT_RANDOM,
    Kind.CURVE_LACKS: (
        "look at the residuals for a bad reading or a wrong window; otherwise try "
        "{curve}, because this one does not fit. Keep "
        "it only if the formula is known to be right: if successive readings are "
        "correlated, use {correlated}; if something "
        "irregular disturbs y and its size is known from elsewhere, not from these "
        "residuals, state that size (deviation)"
    ),
    Kind.DEVIATION_TOO_LARGE: _ANOTHER,
    Kind.DEVIATION_TOO_SLOW: _ANOTHER,
    Kind.FORCE_NOT_LINEAR: (
        "fit a shorter section of the motion, or speeds in place of positions, and look for a "
        "defect of the ramp: the figure of the force shows where"
    ),
    Kind.SPEEDS_NOT_LINEAR: (
        "state body, tilt and start more exactly, and look for a defect of the ramp: the figure "
        "of the force shows where"
    ),
    Kind.FRAMES_CROWD: (
        "check the file and the window for a section that belongs to another motion, "
        "or for a stated reading error that is too small"
    ),
    Kind.CHI2_TOO_LARGE: (
        "look at the figure: if the points scatter at random about the curve, allow for {jitter}, "
        "or leave u_y out; their scatter then determines how large the errors are"
    ),
    Kind.COUNTS_SCATTER: (
        "look at the pulls: possible causes are a wrong curve, a bin that is too wide "
        "for it, dead time, or events that come in "
        "bursts; if none of these can be remedied, fit the counts as readings without "
        "u_y, and their scatter determines how large "
        "the errors are"
    ),
    Kind.SCATTER_TOO_LARGE: (
        "the curve does not describe this motion, or the stated resolution of the "
        "instrument is much too optimistic"
    ),
    Kind.FORCE_TOO_LARGE: (
        "look at the figure of the force: the stated values of body, tilt and start "
        "may be wrong, or something drives the body; if "
        "so large a force is plausible, state it by unmodelled_force"
    ),
    Kind.NOISE_TOO_LARGE: (
        "look for readings that jump (lost counts, a mark mistaken for another) and "
        "exclude them by a window; otherwise state the "
        "actual error of a reading"
    ),
    Kind.OUTLIERS_CROWD: (
        "exclude by a window readings that do not belong to the curve; robust errors are meant "
        "for a minority of bad readings, and few readings need a stated uncertainty"
    ),
    Kind.RUNS_DISAGREE: _ONE_RUN,
    Kind.RUN_DISAGREES: _ONE_RUN,
    Kind.RUNS_TIED: _ONE_RUN,
    Kind.RUNS_AGAINST_STATED: _ONE_RUN,
    Kind.STATED_DISAGREE: (
        "check the stated value: its unit, its uncertainty, and the scale and zero of "
        "the data; a compromise between two values that "
        "disagree is neither of them"
    ),
    Kind.STATED_AND_CURVE: _NOT_RANDOM,
    Kind.RUN_OFF_MAP: (
        "check its tilt (including the sign), its angle of release (the direction in "
        "which it is measured) and gamma; a fit of the "
        "run shows which of them is wrong"
    ),
    Kind.GAMMA_TOO_LARGE: (
        "are the columns phi_deg and theta_min_deg swapped, or is the unit of one of them wrong?"
    ),
    Kind.TRIALS_SILENT: (
        "choose angles on both sides of the threshold of climbing: some trials must "
        "climb and some must not, "
        "at two or more tilts"
    ),
    Kind.TRIALS_SCATTER: (
        "look for a trial whose outcome or angle was recorded wrongly, and for a tilt "
        "that was read wrongly; otherwise state a "
        "larger u_theta_deg"
    ),
    Kind.POINTS_SCATTER: "check the uncertainties and look for a bad point",
    Kind.PRESSED_EDGE: (
        "if values beyond the edge are possible, widen the prior; if not, something "
        "else is wrong: a stated value, a scale or the curve"
    ),
    Kind.PRESSED_LIMIT: "is the limit right?",
    Kind.RANKS_UNEVEN: (
        "do not quote this interval: the priors, the noise or the curve are not those "
        "of the simulated data"
    ),
    Kind.COVERAGE_OFF: "do not quote this interval with its nominal probability",
    Kind.TRIALS_FAILED: (
        "state narrower priors: where they allow values for which the curve cannot be "
        "computed, there is no posterior"
    ),
}


def describe(finding: Finding) -> str:
    """The finding as a sentence without a full stop."""
    return filled(WORDS, finding)


def advice(finding: Finding) -> str:
    """What to do about a finding with which a result is not ok."""
    words = phrase(_advice(finding))
    for token, (in_python, in_words, _) in _CHOICES.items():
        words = words.replace(token, phrase(in_words if at_commands() else in_python))
    return words


def advice_for(findings: Iterable[Finding]) -> list[str]:
    """What to do about several findings, each piece of advice once."""
    return list(dict.fromkeys(map(advice, _decisive(findings))))


def choices_for(findings: Iterable[Finding]) -> tuple[Choice, ...]:
    """The choices that the advice about `findings` names, each once, for a fit with that one."""
    return tuple(
        dict.fromkeys(
            replace(choice, value=choice.value.format(name=name))
            for finding in _decisive(findings)
            for token, (_, _, choice) in _CHOICES.items()
            if choice and token in _advice(finding)
            for name in (_parameters(finding) if "{" in choice.value else [""])
        )
    )


def _advice(finding: Finding) -> str:
    by_test = _OF_TEST.get(finding.test) if finding.kind is Kind.CURVE_LACKS else None
    return by_test or ADVICE[finding.kind]


def _decisive(findings: Iterable[Finding]) -> list[Finding]:
    """Those that decide what to do: one reading far off explains the size of all of its run."""
    known = list(findings)
    spoilt = {f.run for f in known if one_is_far_off([g for g in known if g.run == f.run])}
    return [
        f for f in known if f.test != "chi2" or f.kind not in _OF_RESIDUALS or f.run not in spoilt
    ]


def one_is_far_off(findings: Iterable[Finding]) -> bool:
    """Whether the residuals fail no test but by one reading, and by the size that follows."""
    tests = {finding.test for finding in findings if finding.kind in _OF_RESIDUALS}
    return "largest" in tests <= {"chi2", "largest"}


def _parameters(finding: Finding) -> list[str]:
    """Those whose value a reader may state: of no run, and no noise."""
    all_findings = (finding, *finding.parts)
    names = [name for f in all_findings for name in (*(a.name for a in f.parameters), *f.names)]
    return [name for name in names if name.isidentifier()]
