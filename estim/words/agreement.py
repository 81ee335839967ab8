"""Agreement in words: of runs with each other, and of data with what was stated before."""

from __future__ import annotations

import math

from estim.common import Finding, Kind, later, phrase, split_level
from estim.words.table import Table, symbol, worded

_KEY_UNITS = {
    "°": "_deg",
    "m": "_m",
    "1/s": "_per_s",
    "1/m": "_per_m",
    "°/m": "_deg_m",
    "N m": "_n_m",
    "m/s": "_m_s",
}


_DISAGREE = later("the data disagree with the values stated beforehand ({p})")


def _stated(verdict: str, f: Finding) -> str:
    parts = [_pull(part) for part in f.parts]
    one_of = (
        phrase("; any of these values, or the scale of the data, may be wrong")
        if len(parts) > 1
        else ""
    )
    return f"{worded(f, verdict)}{': ' if parts else ''}{'; '.join(parts)}{one_of}"


def _pull(f: Finding) -> str:
    return worded(
        f,
        "{symbol} was stated as {shown}, {size:.1f} standard deviations below what the rest implies"
        if f.size > 0.0
        else "{symbol} was stated as {shown}, {size:.1f} standard deviations above what the rest "
        "implies",
        size=abs(f.size),
    )


def _tied(f: Finding) -> str:
    named = phrase("{names} and {last}", names=", ".join(f.names[:-1]), last=f.names[-1])
    return worded(
        f,
        "the runs disagree about the quantities they share ({p}), and these data cannot show which "
        "of these is wrong: {named}",
        named=named,
    ) + _let_it_vary(f)


def _let_it_vary(f: Finding) -> str:
    """The line that lets a quantity of the campaign vary between runs, where one is offered."""
    if not f.parameters:
        return ""
    (varying,) = f.parameters
    base, level = split_level(varying.name)
    factor, unit = (varying.label.factor, varying.label.unit) if varying.label else (1.0, "1")
    key = {"moment": "resisting_moment"}.get(base, base) + _KEY_UNITS.get(unit, "")
    return phrase(
        "; if the runs differ genuinely rather than by mistake, let {symbol} vary from run "
        "to run: {line}, under {where}",
        symbol=symbol(varying),
        line=f"between_runs = {{{key} = {varying.value * factor:.2g}}}",
        where=f"[bodies.{level[1:-1]}]" if level else "[shared]",
    )


_SHARE, _MM, _DEGREES = 100.0, 1e3, 180.0 / math.pi
_COMMON = {
    "clock": (_SHARE, later("{size} % error in the clock rate")),
    "length": (_SHARE, later("{size} % error in the length scale")),
    "sag": (_MM, later("{size} mm of sag in the middle of the ramp")),
    "scale_x": (_SHARE, later("{size} % error in the scale of x")),
    "scale_y": (_SHARE, later("{size} % error in the scale of y")),
    "radius": (_SHARE, later("{size} % error in the radius")),
    "g": (_SHARE, later("{size} % error in g")),
    "gamma": (_SHARE, later("{size} % error in gamma")),
    "kappa": (_SHARE, later("{size} % error in kappa")),
    "phi": (_DEGREES, later("{size}° error in the tilt")),
    "theta0": (_DEGREES, later("{size}° error in the angle at release")),
}


def common_error(name: str, size: float, along: float | None) -> str:
    """'1 % of the clock'; size in SI units, or as a share.  along : m, length of a ramp that sags,
    None where there are several or none.
    """
    factor, words = _COMMON[name]
    amount = f"{size * factor:.3g}"
    return (
        phrase(words, size=amount)
        if along is None
        else phrase("{size} mm of sag on a {length:.3g} m ramp", size=amount, length=along)
    )


WORDS: Table = {
    Kind.STATED_UNCOMPARED: (
        "the data hardly constrain the quantities that were stated beforehand, so "
        "there is nothing to compare"
    ),
    Kind.STATED_AGREE: "the data agree with the values stated beforehand ({p})",
    Kind.STATED_HARDLY: lambda f: _stated(
        later("the data agree only marginally with the values stated beforehand ({p})"), f
    ),
    Kind.STATED_DISAGREE: lambda f: _stated(_DISAGREE, f),
    Kind.STATED_AND_CURVE: lambda f: (
        _stated(_DISAGREE, f)
        + phrase("; but other values do not make the curve fit the data either")
    ),
    Kind.PULL: _pull,
    Kind.COMMON_ERROR: lambda f: worded(
        f,
        "{error}: {symbol} shifts by {value:.1f}"
        if f.parameters
        else "{error}: no fit that allows for it converges",
        error=common_error(f.test, f.size, f.numbers.get("along")),
    ),
    Kind.COMMON_ERRORS: (
        "errors that leave no trace in the residuals would shift the result, in "
        "posterior standard deviations: {parts}"
    ),
    Kind.RUNS_UNCOMPARED: (
        "no shared quantity is determined by two of the runs, so there is nothing to compare"
    ),
    Kind.RUNS_AGREE: "the {n:.0f} runs agree about the quantities they share ({p})",
    Kind.RUNS_AGAINST_STATED: (
        "the runs agree with each other but not with the stated values of the "
        "quantities they share ({p})"
    ),
    Kind.RUN_DISAGREES: lambda f: (
        worded(
            f,
            "run {run} disagrees with the others about the quantities they "
            "share; without it the others agree ({p} with it)",
        )
        + _let_it_vary(f)
    ),
    Kind.RUNS_TIED: _tied,
    Kind.RUNS_DISAGREE: lambda f: (
        worded(
            f,
            "the runs disagree about the quantities they share ({p}), and "
            "leaving out any single run does not resolve this",
        )
        + _let_it_vary(f)
    ),
}
