"""Agreement in words: of runs with each other, and of data with what was stated before."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, format_p, split_level
from estim.words.parameters import symbol, value_words
from estim.words.table import Table

_KEY_UNITS = MappingProxyType({"°": "_deg", "m": "_m", "1/s": "_per_s", "1/m": "_per_m", "°/m": "_deg_m", "N m": "_n_m", "m/s": "_m_s"})


def _stated(verb: str, f: Finding) -> str:
    parts = [_pull(part) for part in f.parts]
    one_of = "; each of these, or the scale of the data, may be what is wrong" if len(parts) > 1 else ""
    return f"the data {verb} with what was stated before ({format_p(f.p)}){': ' if parts else ''}{'; '.join(parts)}{one_of}"


def _pull(f: Finding) -> str:
    (stated,) = f.parameters
    off = f"{abs(f.size):.1f} standard deviations {'below' if f.size > 0.0 else 'above'}"
    return f"{symbol(stated)} was stated as {value_words(stated)}, {off} what all else says"


def _tied(f: Finding) -> str:
    named = ", ".join(f.names[:-1]) + f" and {f.names[-1]}"
    return f"the runs do not agree about what they share ({format_p(f.p)}), and these data cannot tell which is wrong among {named}{_let_it_vary(f)}"


def _let_it_vary(f: Finding) -> str:
    """The line that lets a quantity of the campaign vary between runs, where one is offered."""
    if not f.parameters:
        return ""
    (apart,) = f.parameters
    base, level = split_level(apart.name)
    factor, unit = (apart.label.factor, apart.label.unit) if apart.label else (1.0, "1")
    key = {"moment": "resisting_moment"}.get(base, base) + _KEY_UNITS.get(unit, "")
    where = f"[bodies.{level[1:-1]}]" if level else "[shared]"
    line = f"between_runs = {{{key} = {apart.value * factor:.2g}}}"
    return f"; where runs differ by nature rather than by mistake, let {symbol(apart)} vary from run to run: {line}, under {where}"


_SHARE, _MM, _DEGREES = (100.0, " %"), (1e3, " mm"), (180.0 / math.pi, "°")
_COMMON = MappingProxyType(
    {
        "clock": (_SHARE, "of the clock"), "length": (_SHARE, "of the scale of length"), "sag": (_MM, "of sag in the middle of the track"),
        "scale_x": (_SHARE, "of the scale of x"), "scale_y": (_SHARE, "of the scale of y"), "radius": (_SHARE, "of the radius"),
        "g": (_SHARE, "of g"), "gamma": (_SHARE, "of gamma"), "kappa": (_SHARE, "of kappa"), "phi": (_DEGREES, "of the tilt"),
        "theta0": (_DEGREES, "of the angle at release"),
    }
)


def common_error(name: str, size: float) -> str:
    """'1 % of the clock'; size in SI units, or as a share."""
    (factor, mark), words = _COMMON[name]
    return f"{size * factor:.3g}{mark} {words}"


def _common(f: Finding) -> str:
    (moved,) = f.parameters
    return f"{common_error(f.test, f.size)}: {symbol(moved)} by {moved.value:.1f}"


WORDS: Table = MappingProxyType(
    {
        Kind.STATED_UNCOMPARED: "the data say next to nothing about what was stated before: there is nothing to compare",
        Kind.STATED_AGREE: lambda f: f"the data agree with what was stated before ({format_p(f.p)})",
        Kind.STATED_HARDLY: lambda f: _stated("hardly agree", f),
        Kind.STATED_DISAGREE: lambda f: _stated("do not agree", f),
        Kind.STATED_AND_CURVE: lambda f: _stated("do not agree", f) + "; but the curve does not explain them with other values either",
        Kind.PULL: _pull,
        Kind.COMMON_ERROR: _common,
        Kind.COMMON_ERRORS: lambda f: (
            f"errors that no residual shows would move the result, in posterior standard deviations: {'; '.join(map(_common, f.parts))}"
        ),
        Kind.RUNS_UNCOMPARED: "the runs have nothing in common that two of them determine: there is nothing to compare",
        Kind.RUNS_AGREE: lambda f: f"the {f.size:.0f} runs agree about what they share ({format_p(f.p)})",
        Kind.RUNS_AGAINST_STATED: lambda f: (
            f"the runs agree with each other but not with the stated values of what they share ({format_p(f.p)})"
        ),
        Kind.RUN_DISAGREES: lambda f: (
            f"run {f.run} disagrees with the others about what they share, which agree without it ({format_p(f.p)} with it){_let_it_vary(f)}"
        ),
        Kind.RUNS_TIED: _tied,
        Kind.RUNS_DISAGREE: lambda f: (
            f"the runs do not agree about what they share ({format_p(f.p)}), and leaving out a single one does not heal it{_let_it_vary(f)}"
        ),
    }
)
