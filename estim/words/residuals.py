"""Residuals in words: what failing each test of them means, and what a fitted curve says of its
errors.
"""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, PhraseTable, format_p, later, percentage, phrase
from estim.words.table import Table

TESTS = PhraseTable(
    {
        "chi2": later("the residuals are larger than the noise"),
        "runs": later("the residuals change sign too rarely"),
        "autocorrelation": later("neighbouring residuals are correlated"),
        "trend": later("the residuals drift along the run"),
        "largest": later("one residual is far larger than the others"),
        "uneven": later("the residuals are larger in one part of the curve than in another"),
        "repeated": later(
            "the means of readings at the same x scatter more about the curve than the "
            "scatter of the readings about their "
            "mean explains"
        ),
        "speed": later("the residuals are larger where the body is fast"),
        "zero": later(
            "all residuals are zero apart from rounding errors, which never happens with "
            "measurements: were the data computed?"
        ),
    }
)


_NAMES = MappingProxyType(
    {
        "chi2": later("test|chi2"),
        "runs": later("test|runs"),
        "autocorrelation": later("test|autocorrelation"),
        "trend": later("test|trend"),
        "largest": later("test|largest"),
        "speed": later("test|speed"),
        "zero": later("test|zero"),
        "uneven": later("test|uneven"),
        "repeated": later("test|repeated"),
    }
)  # what stands before | tells these words from others that are written alike


def name_of_test(test: str) -> str:
    """How a reader knows a test of the residuals; its key in `result.json` is the English word."""
    return phrase(_NAMES[test]).removeprefix("test|") if test in _NAMES else test


def _p(f: Finding) -> str:
    """'p = 0.0002', or that it is as small as simulation can tell."""
    return format_p(f.p, f.numbers["least"]) if "least" in f.numbers else format_p(f.p)


def _of_run(f: Finding) -> str:
    return phrase("run {run}: ", run=f.run) if f.run else ""


def _failed(f: Finding) -> str:
    return _of_run(f) + phrase(
        "{what} (test '{test}', {p})", what=TESTS[f.test], test=name_of_test(f.test), p=_p(f)
    )


def _too_large(f: Finding) -> str:
    return phrase(
        "the residuals are larger than u_y allows: chi2 = {chi2:.4g} for {dof:.0f} degrees "
        "of freedom, {p}",
        chi2=f.size,
        dof=f.numbers["dof"],
        p=_p(f),
    )


def _small(f: Finding) -> str:
    dof = f.numbers["dof"]
    if not f.size > 0.0:
        return phrase(
            "the residuals are smaller than u_y implies (chi2 = {chi2:.4g} for {dof:.0f} "
            "degrees of freedom): is u_y too large, and so "
            "every interval too? Or do the points share their errors, or were they smoothed?",
            chi2=f.size,
            dof=dof,
        )
    return phrase(
        "the residuals are smaller than u_y implies (chi2 = {chi2:.4g} for {dof:.0f} "
        "degrees of freedom): is u_y too large, by a factor "
        "of about {times:.2g}, and so every interval too? Or do the points share their "
        "errors, or were they smoothed?",
        chi2=f.size,
        dof=dof,
        times=math.sqrt(dof / f.size),
    )


def _deviance(f: Finding) -> str:
    return phrase(
        "deviance = {size:.4g} for {dof:.0f} degrees of freedom", size=f.size, dof=f.numbers["dof"]
    )


def _counts_scatter(f: Finding) -> str:
    size = (
        f"{_deviance(f)}, {_p(f)}"
        if "dof" in f.numbers
        else phrase("test '{test}', {p}", test=name_of_test(f.test), p=_p(f))
    )
    return _of_run(f) + phrase(
        "the counts scatter more about the curve than independent events can ({size})", size=size
    )


def _counts_even(f: Finding) -> str:
    size = _deviance(f) if "dof" in f.numbers else _p(f)
    return _of_run(f) + phrase(
        "the counts scatter less than independent events can ({size}): are they averages, "
        "scaled, smoothed or made by hand?",
        size=size,
    )


def _counts_as_readings(f: Finding) -> str:
    run = phrase("run {run}: ", run=f.run) if f.run not in ("", "data") else ""
    return run + phrase(
        "y are whole numbers and u_y their square roots: these are counts. Errors "
        "estimated from the counts themselves bias the curve "
        "downwards, and where the counts are few the intervals contain the true value far "
        "less often than stated (leaving out an empty "
        "bin makes it worse). Fit them as counts, including empty bins: noise = {model = "
        '"poisson"} in [curve], noise="poisson" in '
        "Python, in place of u_y"
    )


def _tests(f: Finding) -> str:
    names = phrase(" and ").join(f"'{name}'" for name in f.names)
    return (
        phrase("tests {names}", names=names)
        if len(f.names) > 1
        else phrase("test {names}", names=names)
    )


def _alike(f: Finding) -> str:
    return _of_run(f) + phrase(
        "neighbouring residuals are correlated ({tests}, {p}), although they are no larger "
        "than stated: the errors of successive "
        "readings are correlated. The unmodelled force absorbs their common part, and in "
        "simulated runs of this kind the intervals had "
        "their nominal coverage",
        tests=_tests(f),
        p=_p(f),
    )


def _covered(f: Finding) -> str:
    values = {"size": f.size, "failed": _tests(f), "chi2": f.numbers["chi2"]}
    if len(f.names) > 1:
        return _of_run(f) + phrase(
            "the stated error is conservative: the residuals are {size:.2g} times the "
            "stated error and show a pattern ({failed}), but "
            "taken together they are smaller than one stated standard deviation (chi2 = "
            "{chi2:.2g}); the stated value is kept, and "
            "{failed} are disregarded",
            **values,
        )
    return _of_run(f) + phrase(
        "the stated error is conservative: the residuals are {size:.2g} times the stated "
        "error and show a pattern ({failed}), but taken "
        "together they are smaller than one stated standard deviation (chi2 = {chi2:.2g}); "
        "the stated value is kept, and {failed} is "
        "disregarded",
        **values,
    )


def _few(f: Finding) -> str:
    values = {"n": f.size, "share": 100.0 * f.numbers["coverage"]}
    if f.size > 1:
        return phrase(
            "there are only {n:.0f} degrees of freedom: value ± standard error contains "
            "the true value in {share:.0f} % of such "
            "experiments, not in 68 %; the intervals (Student's t) have their nominal coverage",
            **values,
        )
    return phrase(
        "there is only {n:.0f} degree of freedom: value ± standard error contains the true "
        "value in {share:.0f} % of such experiments, "
        "not in 68 %; the intervals (Student's t) have their nominal coverage",
        **values,
    )


def _crowd(f: Finding) -> str:
    return phrase(
        "run {run}: {share} of the frames would be outliers: perhaps it is the other "
        "frames that do not "
        "belong to the motion",
        run=f.run,
        share=percentage(f.size),
    )


def _limit(words: str, f: Finding) -> str:
    (limit,) = f.parameters
    return phrase(words, name=limit.name, limit=limit.value)


def _cut(f: Finding) -> str:
    return phrase(
        "{name} has no standard deviation, because the limit of {names} truncates it: use "
        "its interval",
        name=f.parameters[0].name,
        names=phrase(" and ").join(f.names),
    )


def _with_speed(f: Finding) -> str:
    if not f.numbers["pictures"]:
        return _of_run(f) + phrase(
            "the readings scatter more where the body is fast ({p}): timing errors, or "
            "counts missed by an encoder there, would explain it",
            p=_p(f),
        )
    return _of_run(f) + phrase(
        "the readings scatter more where the body is fast ({p}): were the images blurred? "
        "State the exposure time of each frame, "
        "exposure_s in the noise table",
        p=_p(f),
    )


WORDS: Table = MappingProxyType(
    {
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
        Kind.RESIDUALS_SMALL: lambda f: (
            _of_run(f)
            + phrase(
                "the residuals are smaller than the stated noise ({p}): is the stated "
                "sigma too large?",
                p=_p(f),
            )
        ),
        Kind.NOISE_WITH_SPEED: _with_speed,
        Kind.PATTERN_COVERED: _covered,
        Kind.NEIGHBOURS_ALIKE: _alike,
        Kind.CHI2_TOO_LARGE: _too_large,
        Kind.CHI2_SMALL: _small,
        Kind.COUNTS_SCATTER: _counts_scatter,
        Kind.COUNTS_EVEN: _counts_even,
        Kind.COUNTS_AS_READINGS: _counts_as_readings,
        Kind.SCATTER_TOO_LARGE: lambda f: (
            _of_run(f)
            + phrase(
                "the inferred scatter is {n:.0f} times that expected from the instrument", n=f.size
            )
        ),
        Kind.SCATTER_LARGE: lambda f: (
            _of_run(f)
            + phrase(
                "the inferred scatter is {n:.1f} times that expected from the instrument", n=f.size
            )
        ),
        Kind.OUTLIERS_CROWD: _crowd,
        Kind.ROUNDING: lambda f: phrase(
            "floating-point rounding errors may shift the values by {n:.1g} standard deviations",
            n=f.size,
        ),
        Kind.CANCELLATION: later(
            "the terms of the curve almost cancel at these x, so that rounding leaves few "
            "correct digits in the values: write the "
            "formula in x - x0, with x0 in the middle of the data"
        ),
        Kind.FEW_DEGREES: _few,
        Kind.NO_SCATTER: later(
            "the points have no scatter beyond rounding errors (are they computed values, "
            "not readings?), so the size of their errors "
            "cannot be estimated: there is no standard deviation; state u_y"
        ),
        Kind.AT_LIMIT: lambda f: _limit(
            later(
                "{name} lies at its limit {limit:.6g}: it has no standard deviation; use "
                "its interval"
            ),
            f,
        ),
        Kind.NEAR_LIMIT: lambda f: _limit(
            later(
                "{name} is less than one standard deviation from its limit {limit:.6g}: no "
                "standard deviation is given; use its interval"
            ),
            f,
        ),
        Kind.CUT_BY_LIMIT: _cut,
    }
)
