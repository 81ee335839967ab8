"""An unmodelled force in words: whether there is one, how large it is, over what distance it
changes.
"""

from __future__ import annotations

from estim.common import Kind, phrase
from estim.words.table import Table, worded

WORDS: Table = {
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
}
