"""Residuals in words: what failing each test of them means, and what a fitted curve says of its errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from estim.common import Finding, Kind, format_p, percentage
from estim.words.table import Table

TESTS: Mapping[str, str] = MappingProxyType(
    {
        "chi2": "the residuals are larger than the noise",
        "runs": "the residuals change sign too seldom",
        "autocorrelation": "neighbouring residuals are alike",
        "trend": "the residuals drift along the run",
        "largest": "one residual is far larger than the others",
        "speed": "the residuals are larger where the body is fast",
        "zero": "all residuals are zero but for rounding errors, as those of measurements never are: were the data computed?",
    }
)


def _p(f: Finding) -> str:
    """'p = 0.0002', or that it is as small as simulation can tell."""
    least = f.numbers.get("least", 0.0)
    return format_p(f.p, least)


def _of_run(f: Finding) -> str:
    return f"run {f.run}: " if f.run else ""


def _failed(f: Finding) -> str:
    return f"{_of_run(f)}{TESTS[f.test]} (test '{f.test}', {_p(f)})"


def _too_large(f: Finding) -> str:
    return f"the residuals are larger than u_y allows: chi2 = {f.size:.4g} for {f.numbers['dof']:.0f} degrees of freedom, {format_p(f.p)}"


def _small(f: Finding) -> str:
    dof = f.numbers["dof"]
    larger = f", about {math.sqrt(dof / f.size):.2g} times" if f.size > 0.0 else ""
    return (
        f"the residuals are smaller than u_y says (chi2 = {f.size:.4g} for {dof:.0f} degrees of freedom): is u_y too large{larger}, and with it "
        "every interval? Or do the points share their errors, or were they smoothed?"
    )


def _counts_scatter(f: Finding) -> str:
    size = f"test '{f.test}', {_p(f)}"
    if "dof" in f.numbers:
        size = f"deviance = {f.size:.4g} for {f.numbers['dof']:.0f} degrees of freedom, {format_p(f.p)}"
    return f"{_of_run(f)}the counts scatter more about the curve than independent events can ({size})"


def _counts_even(f: Finding) -> str:
    size = f"deviance = {f.size:.4g} for {f.numbers['dof']:.0f} degrees of freedom" if "dof" in f.numbers else _p(f)
    return f"{_of_run(f)}the counts scatter less than independent events can ({size}): are they averages, scaled, smoothed or made by hand?"


def _counts_as_readings(f: Finding) -> str:
    run = f"run {f.run}: " if f.run not in ("", "data") else ""
    return (
        f"{run}y are whole numbers and u_y their square roots: these are counts. Errors taken from the counts themselves pull the curve down, "
        "and where counts are few the intervals hold far less than they say (an empty bin, left out, makes it worse). Fit them as counts, "
        'empty bins among them: noise = {model = "poisson"} in [curve], noise="poisson" in Python, in place of u_y'
    )


def _tests(f: Finding) -> str:
    return f"test{'s' if len(f.names) > 1 else ''} " + " and ".join(f"'{name}'" for name in f.names)


def _alike(f: Finding) -> str:
    return (
        f"{_of_run(f)}neighbouring residuals are alike ({_tests(f)}, {_p(f)}), although they are no larger than stated: errors of successive "
        "readings follow each other. The force takes up what they share, and in simulated runs of this kind the intervals held the true "
        "values as often as they say"
    )


def _covered(f: Finding) -> str:
    failed = _tests(f)
    return (
        f"{_of_run(f)}the stated error is conservative: the residuals are {f.size:.2g} of it and have a pattern ({failed}), but all of them "
        f"together are smaller than one stated standard deviation (chi2 = {f.numbers['chi2']:.2g}); it is kept as stated, and {failed} "
        f"{'do' if len(f.names) > 1 else 'does'} not count"
    )


def _few(f: Finding) -> str:
    share = f"{100.0 * f.numbers['coverage']:.0f} %"
    held = f"value ± standard error holds the true value in {share} of such experiments, not in 68 %"
    return f"only {f.size:.0f} degree{'s' if f.size > 1 else ''} of freedom: {held}; the intervals (Student's t) hold what they say"


def _crowd(f: Finding) -> str:
    return f"run {f.run}: {percentage(f.size)} of the frames would be outliers: it may be the others that are not the motion"


def _limit(where: str, f: Finding) -> str:
    (limit,) = f.parameters
    return f"{limit.name} {where} its limit {limit.value:.6g}: no standard deviation, read its interval"


def _cut(f: Finding) -> str:
    return f"{f.parameters[0].name} has no standard deviation, because the limit of {' and '.join(f.names)} cuts it: read its interval"


WORDS: Table = MappingProxyType(
    {
        Kind.RESIDUALS_ZERO: _failed,
        Kind.RESIDUALS_TOO_LARGE: _failed,
        Kind.RESIDUALS_NOT_RANDOM: _failed,
        Kind.CURVE_LACKS: _failed,
        Kind.RESIDUALS_SMALL: lambda f: (
            f"{_of_run(f)}the residuals are smaller than the stated noise ({_p(f)}): is the stated sigma too large?"
        ),
        Kind.NOISE_WITH_SPEED: lambda f: (
            f"{_of_run(f)}the readings scatter more where the body is fast ({_p(f)}): were the pictures blurred? State how long each was exposed, "
            "exposure_s in the noise table"
        ),
        Kind.PATTERN_COVERED: _covered,
        Kind.NEIGHBOURS_ALIKE: _alike,
        Kind.CHI2_TOO_LARGE: _too_large,
        Kind.CHI2_SMALL: _small,
        Kind.COUNTS_SCATTER: _counts_scatter,
        Kind.COUNTS_EVEN: _counts_even,
        Kind.COUNTS_AS_READINGS: _counts_as_readings,
        Kind.SCATTER_TOO_LARGE: lambda f: f"{_of_run(f)}the inferred scatter is {f.size:.0f} times what the instrument explains",
        Kind.SCATTER_LARGE: lambda f: f"{_of_run(f)}the inferred scatter is {f.size:.1f} times what the instrument explains",
        Kind.OUTLIERS_CROWD: _crowd,
        Kind.ROUNDING: lambda f: f"rounding errors of the computer's numbers may move the values by {f.size:.1g} standard deviations",
        Kind.CANCELLATION: (
            "the terms of the curve all but cancel at these x, so that rounding leaves the values few digits: write the formula in x - x0, "
            "with x0 in the middle of the data"
        ),
        Kind.FEW_DEGREES: _few,
        Kind.NO_SCATTER: (
            "the points have no scatter but rounding errors (computed values, not readings?), so nothing tells how large their errors are: "
            "there is no standard deviation; give u_y"
        ),
        Kind.AT_LIMIT: lambda f: _limit("lies on", f),
        Kind.NEAR_LIMIT: lambda f: _limit("is less than a standard deviation from", f),
        Kind.CUT_BY_LIMIT: _cut,
    }
)
