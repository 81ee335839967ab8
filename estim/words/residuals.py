"""Residuals in words: what failing each test of them means, and what a fitted curve says of its
errors.
"""

from __future__ import annotations

import math

from estim.common import Finding, Kind, PhraseTable, at_commands, percentage, phrase
from estim.words.table import Table, facts, worded

TESTS = PhraseTable(
    {
        "chi2": "the points lie farther from the curve than their errors explain",
        "runs": "the points stay on one side of the curve too long",
        "autocorrelation": "neighbouring points lie off the curve by similar amounts",
        "trend": "the points drift slowly from one side of the curve to the other",
        "largest": "one point lies much farther from the curve than the others",
        "uneven": "the points scatter more about one part of the curve than about another",
        "repeated": (
            "the means of readings at the same x scatter more about the curve than the "
            "scatter of the readings about their "
            "mean explains"
        ),
        "speed": "the residuals are larger where the body is fast",
        "zero": (
            "all residuals are zero apart from rounding errors, which never happens with "
            "measurements: were the data computed?"
        ),
    }
)


_NAMES = PhraseTable(
    {
        "chi2": "test|chi2",
        "runs": "test|runs",
        "autocorrelation": "test|autocorrelation",
        "trend": "test|trend",
        "largest": "test|largest",
        "speed": "test|speed",
        "zero": "test|zero",
        "uneven": "test|uneven",
        "repeated": "test|repeated",
    }
)  # what stands before | tells these words from others that are written alike


def name_of_test(test: str) -> str:
    """The name of a test of the residuals; its key in `result.json` is the English word."""
    return _NAMES[test].removeprefix("test|") if test in _NAMES else test


def _failed(f: Finding) -> str:
    return worded(
        f,
        "{of_run}{what} (test '{test}', {p})",
        what=_times_too_far(f.numbers["times"]) if "times" in f.numbers else TESTS[f.test],
        test=name_of_test(f.test),
    )


def _larger(f: Finding) -> str:
    if "dof" not in f.numbers:
        return _failed(f)
    return worded(
        f,
        "{what}: chi2 = {size:.4g} for {dof:.0f} degrees of freedom, {p}",
        what=_times_too_far(math.sqrt(f.size / f.numbers["dof"])),
    )


def _times_too_far(times: float) -> str:
    return phrase(
        "the points lie {times} times as far from the curve as their errors explain",
        times=f"{times:.2g}" if times < 100.0 else f"{times:.0f}",
    )


def _small(f: Finding) -> str:
    if not f.size > 0.0:
        return worded(
            f,
            "the residuals are smaller than u_y implies (chi2 = {size:.4g} for {dof:.0f} "
            "degrees of freedom): is u_y too large, and so every interval too? Or do the "
            "points share their errors, or were they smoothed?",
        )
    return worded(
        f,
        "the residuals are smaller than u_y implies (chi2 = {size:.4g} for {dof:.0f} degrees "
        "of freedom): is u_y too large, by a factor of about {times:.2g}, and so every "
        "interval too? Or do the points share their errors, or were they smoothed?",
        times=math.sqrt(f.numbers["dof"] / f.size),
    )


def _deviance(f: Finding) -> str:
    return worded(f, "deviance = {size:.4g} for {dof:.0f} degrees of freedom")


def _counts_as_readings(f: Finding) -> str:
    run = phrase("run {run}: ", run=f.run) if f.run not in ("", "data") else ""
    return run + phrase(
        "y are whole numbers and u_y their square roots: these are counts. Errors "
        "estimated from the counts themselves bias the curve "
        "downwards, and where the counts are few the intervals contain the true value far "
        "less often than stated (leaving out an empty "
        "bin makes it worse). Fit them as counts, including empty bins: {choice}, in "
        "place of u_y",
        choice="noise: poisson" if at_commands() else 'noise="poisson"',
    )


def _tests(f: Finding) -> str:
    return phrase(
        "tests {names}" if len(f.names) > 1 else "test {names}",
        names=phrase(" and ").join(f"'{name}'" for name in f.names),
    )


WORDS: Table = {
    Kind.RESIDUALS_ZERO: _failed,
    Kind.RESIDUALS_TOO_LARGE: _failed,
    Kind.RESIDUALS_NOT_RANDOM: _failed,
    Kind.CURVE_LACKS: _failed,
    Kind.RESIDUALS_HARDLY: lambda f: (
        _failed(f)
        + phrase(
            ": this is not enough to reject the fit, but the coverage of its intervals "
            "may be lower than stated"
        )
    ),
    Kind.RESIDUALS_SMALL: (
        "{of_run}the residuals are smaller than the stated noise ({p}): is the "
        "stated sigma too large?"
    ),
    Kind.NOISE_WITH_SPEED: lambda f: worded(
        f,
        "{of_run}the readings scatter more where the body is fast ({p}): were the images "
        "blurred? State the exposure time of each frame, exposure_s in the noise table"
        if f.numbers["pictures"]
        else "{of_run}the readings scatter more where the body is fast ({p}): timing errors, or "
        "counts missed by an encoder there, would explain it",
    ),
    Kind.PATTERN_COVERED: lambda f: worded(
        f,
        "{of_run}the stated error is conservative: the residuals are {size:.2g} times the "
        "stated error and show a pattern ({failed}), but taken together they are smaller than "
        "one stated standard deviation (chi2 = {chi2:.2g}); the stated value is kept, and "
        "{failed} are disregarded"
        if len(f.names) > 1
        else "{of_run}the stated error is conservative: the residuals are {size:.2g} times the "
        "stated error and show a pattern ({failed}), but taken together they are smaller than "
        "one stated standard deviation (chi2 = {chi2:.2g}); the stated value is kept, and "
        "{failed} is disregarded",
        failed=_tests(f),
    ),
    Kind.NEIGHBOURS_ALIKE: lambda f: worded(
        f,
        "{of_run}neighbouring residuals are correlated ({tests}, {p}), although they are no "
        "larger than stated: the errors of successive readings are correlated. The unmodelled "
        "force absorbs their common part, and in simulated runs of this kind the intervals had "
        "their nominal coverage",
        tests=_tests(f),
    ),
    Kind.CHI2_TOO_LARGE: _larger,
    Kind.CHI2_SMALL: _small,
    Kind.COUNTS_SCATTER: lambda f: worded(
        f,
        "{of_run}the counts scatter more about the curve than independent events can ({found})",
        found=f"{_deviance(f)}, {facts(f)['p']}"
        if "dof" in f.numbers
        else worded(f, "test '{test}', {p}", test=name_of_test(f.test)),
    ),
    Kind.COUNTS_EVEN: lambda f: worded(
        f,
        "{of_run}the counts scatter less than independent events can ({found}): are they "
        "averages, scaled, smoothed or made by hand?",
        found=_deviance(f) if "dof" in f.numbers else facts(f)["p"],
    ),
    Kind.COUNTS_AS_READINGS: _counts_as_readings,
    Kind.READINGS_COPIED: lambda f: phrase(
        "{first} and {second} hold the same readings, which therefore count twice: the "
        "uncertainties are too small; leave one of them out",
        first=f.names[0],
        second=f.names[1],
    ),
    Kind.SCATTER_TOO_LARGE: (
        "{of_run}the inferred scatter is {n:.0f} times that expected from the instrument"
    ),
    Kind.SCATTER_LARGE: (
        "{of_run}the inferred scatter is {n:.1f} times that expected from the instrument"
    ),
    Kind.OUTLIERS_CROWD: lambda f: worded(
        f,
        "{of_run}{share} of the readings would be outliers: perhaps it is the others that do "
        "not belong to the curve",
        share=percentage(f.size),
    ),
    Kind.ROUNDING: (
        "floating-point rounding errors may shift the values by {n:.1g} standard deviations"
    ),
    Kind.CANCELLATION: (
        "the terms of the curve almost cancel at these x, so that rounding leaves few "
        "correct digits in the values: write the "
        "formula in x - x0, with x0 in the middle of the data"
    ),
    Kind.FEW_DEGREES: lambda f: worded(
        f,
        "there are only {n:.0f} degrees of freedom: value ± standard error contains the true "
        "value in {share:.0f} % of such experiments, not in 68 %; the intervals (Student's t) "
        "allow for it"
        if f.size > 1
        else "there is only {n:.0f} degree of freedom: value ± standard error contains the true "
        "value in {share:.0f} % of such experiments, not in 68 %; the intervals (Student's t) "
        "allow for it",
        share=100.0 * f.numbers["coverage"],
    ),
    Kind.NOT_TESTABLE: (
        "a likelihood alone has no goodness of fit: nothing here tests the density, so compare it "
        "with the data by a histogram, or with another density by AIC"
    ),
    Kind.NO_SCATTER: (
        "the points have no scatter beyond rounding errors (are they computed values, "
        "not readings?), so the size of their errors "
        "cannot be estimated: there is no standard deviation; state u_y"
    ),
    Kind.AT_LIMIT: (
        "{name} lies at its limit {value:.6g}: it has no standard deviation; use its interval"
    ),
    Kind.NEAR_LIMIT: (
        "{name} is less than one standard deviation from its limit {value:.6g}: "
        "no standard deviation is given; use its interval"
    ),
    Kind.CUT_BY_LIMIT: (
        "{name} has no standard deviation, because the limit of {names} "
        "truncates it: use its interval"
    ),
    Kind.LOPSIDED: (
        "{name} has no standard deviation, because its interval reaches farther on one side than "
        "on the other: use its interval"
    ),
    Kind.CUT_BY_NONE: (
        "{name} has no standard deviation, because the curve expects none where 0 was counted "
        "and cannot expect less: use its interval, which is too short beside counts of 0 (that "
        "of 95 % for a single one ends at 1.9 instead of 3.0)"
    ),
}
