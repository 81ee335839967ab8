"""What a curve lacks, in words: of a user's own curve a deviation, of a rolling body a force, how
large it is, over what distance it changes; and the verdict on candidates for it that were refit.
"""

from __future__ import annotations

from collections.abc import Mapping

from estim.common import Finding, Kind, PhraseTable, behind, later, phrase
from estim.words.table import Table, worded

_READ_AS = PhraseTable(
    {
        "smooth": "a smooth deviation from the curve",
        "correlated": "correlated errors of successive readings",
    }
)
_SLOW: Mapping[str, str] = {
    "smooth": later(
        "{of_run}the discrepancy between curve and data is a trend: with "
        "probability {prob:.2g} the correlation length of the deviation exceeds "
        "a quarter of the range of x, as happens when the curve is wrong"
    ),
    "correlated": later(
        "{of_run}the discrepancy between curve and data is a trend: with "
        "probability {prob:.2g} the errors would remain correlated over more "
        "than a third of the recording, as happens when the curve is wrong"
    ),
}


def _how(f: Finding) -> str:
    """The probable reading of the discrepancy, and its probability where both were tried."""
    n = f.numbers
    readings = [reading for reading in _READ_AS if reading in n]
    probable = max(readings, key=lambda reading: n[reading])
    along = behind(f.names[0]) if probable == "smooth" else f" {f.names[2]}"
    size, length, short, long = (
        n[f"{probable}_{what}"] for what in ("size", "length", "short", "long")
    )
    other = _READ_AS[next(w for w in readings if w != probable)] if len(readings) > 1 else ""
    return phrase(
        "{what}{share} with standard deviation {size:.2g}{unit} and correlation length "
        "about {length:.2g}{along} ({short:.2g} to {long:.2g})",
        what=_READ_AS[probable],
        share=phrase(
            " (probability {p:.2g}; the alternative is {other})", p=n[probable], other=other
        )
        if other
        else "",
        size=size,
        unit=behind(f.names[1]),
        length=length,
        along=along,
        short=short,
        long=long,
    )


WORDS: Table = {
    Kind.DEVIATION_FOUND: lambda f: worded(
        f,
        "{of_run}the residuals about the curve are not white noise; they are interpreted as "
        "{how}; the part that no parameter values can reproduce is {typical:.2g}{unit} (root "
        "mean square, at most {most:.2g}{unit}), P(amplitude > 0) = {prob:.3f}",
        how=_how(f),
        unit=behind(f.names[1]),
    ),
    Kind.DEVIATION_UNDECIDED: (
        "{of_run}it cannot be decided whether the curve deviates from the data, "
        "P(amplitude > 0) = {prob:.2f}; the intervals allow for an irregular "
        "deviation, but not for a different curve"
    ),
    Kind.DEVIATION_UNLIKELY: (
        "{of_run}there is no evidence of a deviation from the curve, P(amplitude > 0) = {prob:.2f}"
    ),
    Kind.DEVIATION_UNASKED: (
        "{of_run}the curve is assumed to be complete: the intervals do not allow "
        "for a smooth deviation from it; a deviation about as large as the error "
        "of one reading has probability {prob:.2f} (0.5 before the data)"
    ),
    Kind.DEVIATION_TOO_LARGE: (
        "{of_run}the deviation from the curve would have to be {size:.2g} times "
        "its stated size (a half-normal prior of this scale exceeds 2.5 once in "
        "80 cases): either the curve or the stated size of the deviation is wrong"
    ),
    Kind.DEVIATION_TOO_SLOW: lambda f: worded(
        f, _SLOW["correlated" if "correlated" in f.names else "smooth"]
    ),
    Kind.FORCE_FOUND: lambda f: worded(
        f,
        "{who}: the residuals about the curve are not white noise; interpreted as {what}, "
        "they amount to {share:.2g} % of the weight (root mean square along the track; at most "
        "{most:.2g} %), with correlation length about {length:.2g} {names} ({short:.2g} to "
        "{long:.2g}), P(amplitude > 0) = {prob:.3f}",
        what=phrase(
            "an unmodelled force along the track that they share"
            if f.numbers.get("runs", 1) > 1
            else "an unmodelled force along the track"
        ),
    ),
    Kind.FORCE_UNDECIDED: (
        "{who}: it cannot be decided whether there is an unmodelled force, P(amplitude > 0) = "
        "{prob:.2f}; if there is, it is about {share:.2g} % of the weight (root mean square "
        "along the track), and every interval allows for it"
    ),
    Kind.FORCE_UNLIKELY: (
        "{who}: there is no evidence of an unmodelled force, P(amplitude > 0) = {prob:.2f}; "
        "every interval allows for one that may have gone undetected"
    ),
    Kind.FORCE_TOO_LARGE: (
        "{who}: the unmodelled force needed to explain the data is {share:.2g} % of the weight "
        "(root mean square along the track), {size:.2g} times its expected size: this is a "
        "different motion"
    ),
    Kind.FORCE_NOT_LINEAR: (
        "{who}: the force required by the residuals is so large that the motion no longer "
        "responds linearly to it: the fit ends {size:.2g} standard deviations from the linear "
        "prediction, and no interval is reliable"
    ),
    Kind.SPEEDS_NOT_LINEAR: (
        "{who}: beside the force required by the residuals the parameters are so uncertain that "
        "the curve is no longer linear in them: the fit ends {size:.2g} standard deviations from "
        "the linear prediction, and no interval is reliable"
    ),
    Kind.NOISE_CONSERVATIVE: (
        "{who}: the stated error is conservative: the scatter of the readings is about "
        "{size:.2g} times the stated error; the stated value is kept, and no interval becomes "
        "narrower"
    ),
    Kind.NOISE_LARGER: (
        "{who}: in addition to the force, the scatter of the readings is about {size:.2g} "
        "times the stated error ({low:.2g} to {high:.2g}); every interval allows for it"
    ),
    Kind.NOISE_TOO_LARGE: (
        "{who}: after an unmodelled force is removed, the scatter of the readings is at least "
        "{size:.2g} times the stated error (probability {prob:.2f})"
    ),
    Kind.CURVE_COMPLETE: "the curve is assumed to be complete: {name}",
    Kind.CAUSE_NAMED: (
        "the most likely missing effect is {name}: with it, no discrepancy remains to be "
        "explained (AIC falls by {size:.0f})"
    ),
    Kind.CAUSES_ALIKE: lambda f: worded(
        f,
        "these data cannot distinguish between: {names}. Each of these causes explains the "
        "remaining discrepancy; an independent measurement of one of them, or a different "
        "run (another tilt, another body, a longer path), would decide",
        names="; ".join(f.names),
    ),
    Kind.CAUSE_IN_PART: lambda f: worded(
        f,
        "{which} improves the fit most (AIC falls by {size:.0f}) but does not remove the "
        "lack of fit: at best it is part of the cause",
        which=phrase(" or ").join(f.names),
    ),
    Kind.CAUSE_UNKNOWN: (
        "none of the {tried:.0f} known causes explains any of the discrepancy "
        "between curve and data"
    ),
}
