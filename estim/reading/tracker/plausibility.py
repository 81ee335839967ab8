"""What is suspicious about a track though it breaks no rule: each finding is a sentence for the
report, nothing is repaired.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from estim.arrays import FloatArray, root_mean_square
from estim.common import later, phrase
from estim.reading.tracker.ramp import Ramp
from estim.reading.tracker.track import Track

_WINDOW = 0.2  # s over which an acceleration is taken
_NOT_THE_RELEASE = later("if a rolling body is fit, whose curve counts x from the release,")
# in files of earlier versions
_EARLIER_WORDS = "that is not the release, from which the phase curve counts x"
_SPEEDS_MADE = later("speeds are made from the positions")


def suspicions(track: Track, ramp: Ramp, *, from_row: int) -> tuple[str, ...]:
    """Sentences about what does not look right in `track`, from its row `from_row` (the release)
    on.
    """
    t, along = track.t[from_row:], ramp.along[from_row:]
    step, steps = _steps(t)
    reach = float(np.ptp(along))
    return (
        *_times(t, step, steps),
        *_scale(t, along, step, reach),
        *_off_line(ramp, reach),
        *_first_speed(t, along, step),
        *_speed_column(track, ramp),
    )


def missing_frames(t: FloatArray) -> tuple[str, ...]:
    """What the times (s) of a track alone show."""
    missing = _n_missing(_steps(t)[1])
    return (
        (phrase("{k} of {n} frames are missing", k=missing, n=t.size + missing),) if missing else ()
    )


def of_any_curve(warnings: Iterable[str]) -> tuple[str, ...]:
    """Those of `warnings` that matter where the curve is the user's own, which has no release and
    fits no speeds made of positions.
    """
    of_release = (_NOT_THE_RELEASE, _EARLIER_WORDS, _SPEEDS_MADE)
    return tuple(
        words
        for words in warnings
        if not any(sentence in words or phrase(sentence) in words for sentence in of_release)
    )


def _steps(t: FloatArray) -> tuple[float, FloatArray]:
    """The median step of time, and the steps in its units."""
    steps = np.diff(t)
    step = float(np.median(steps))
    return step, steps / step


def _n_missing(steps: FloatArray) -> int:
    return int(np.sum(np.maximum(np.rint(steps), 1.0) - 1.0))


def _times(t: FloatArray, step: float, steps: FloatArray) -> list[str]:
    multiples, missing = np.rint(steps), _n_missing(steps)
    sentences = []
    if missing:
        sentences.append(
            phrase(
                "{k} of {n} frames are missing: no speed can be computed next to them",
                k=missing,
                n=t.size + missing,
            )
        )
    if np.any(np.abs(steps - multiples) > 0.1) or np.any(multiples < 1):
        worst = int(np.argmax(np.abs(steps - multiples)))
        sentences.append(
            phrase(
                "the times are not spaced by whole multiples of {usual:.5g} s (after t = "
                "{t:.6g} s), so no speeds can be computed from differences",
                usual=step,
                t=t[worst],
            )
        )
    return sentences


def _scale(t: FloatArray, along: FloatArray, step: float, reach: float) -> list[str]:
    # no ramp in a laboratory is so long, in metres
    if reach > 20.0:
        return [
            phrase(
                "the path is {reach:.3g} m long: is the unit of length centimetres (unit "
                "cm), or the scale wrong?",
                reach=reach,
            )
        ]
    width = max(7, int(np.ceil(_WINDOW / step)) if _WINDOW / step < t.size else t.size)
    largest = 0.0
    for first in range(0, t.size - width + 1, max(1, width // 2)):
        inside = slice(first, first + width)
        quadratic = np.polyfit(t[inside] - np.mean(t[inside]), along[inside], 2)
        largest = max(largest, 2.0 * abs(float(quadratic[0])))
    # a body that rolls or falls accelerates by less
    if largest > 1.5 * 9.8:
        return [
            phrase(
                "the acceleration reaches {largest:.3g} m/s², more than gravity can give: "
                "is the scale, the unit or the frame rate wrong?",
                largest=largest,
            )
        ]
    return []


def _off_line(ramp: Ramp, reach: float) -> list[str]:
    if ramp.across is None or not ramp.scatter > 0.01 * reach:
        return []
    return [
        phrase(
            "the points scatter by {scatter:.3g} mm about the fitted line, {share:.2g} % "
            "of the path:"
            " the path is not straight or not in the plane of the axes",
            scatter=1e3 * ramp.scatter,
            share=100 * ramp.scatter / reach,
        )
    ]


def _first_speed(t: FloatArray, along: FloatArray, step: float) -> list[str]:
    """A track that begins in motion: then its first point is not the release."""
    few = max(2, min(int(0.1 / step) if step > 1e-4 else 1000, t.size // 5))
    speeds = np.abs(along[few:] - along[:-few]) / (t[few:] - t[:-few])
    largest = float(np.max(speeds))
    first = float(speeds[0])
    if first <= 0.2 * largest:
        return []
    return [
        phrase(
            "the body already moves at {first:.2g} m/s in the first frames: {what} start "
            "the track where it is at rest, or give the time "
            "of release by --release T (in a campaign: release)",
            first=first,
            what=phrase(_NOT_THE_RELEASE),
        )
    ]


def _speed_column(track: Track, ramp: Ramp) -> list[str]:
    """The column v: a magnitude, and the central difference of the positions, as Tracker makes
    it.
    """
    if track.speed is None or track.x is None or track.y is None:
        return (
            []
            if track.speed is None
            else [phrase("the column v is not used: {why}", why=phrase(_SPEEDS_MADE))]
        )
    sentences = []
    v = track.speed[1:-1]
    span = track.t[2:] - track.t[:-2]
    step, _ = _steps(track.t)
    computed = np.hypot(track.x[2:] - track.x[:-2], track.y[2:] - track.y[:-2]) / span
    compared = np.isfinite(v) & (span < 2.5 * step)
    if np.any(compared):
        rms = root_mean_square((v - computed)[compared])
        if rms > 0.02 * float(np.max(computed)):
            sentences.append(
                phrase(
                    "the column v is not the central difference of x and y (they differ by "
                    "{off:.3g} m/s, rms): v, the times or the "
                    "lengths have been altered",
                    off=rms,
                )
            )
    moved = np.diff(ramp.along)
    reach = float(np.ptp(ramp.along))
    if -float(np.sum(moved[moved < 0.0])) > 0.2 * reach and not np.any(track.speed < 0.0):
        words = phrase(
            "the column v is a magnitude (never negative, although the motion turns back): "
            "it is not used, "
            "{why}",
            why=phrase(_SPEEDS_MADE),
        )
        sentences.append(words)
    return sentences


def odd_intervals(intervals: Mapping[str, float]) -> dict[str, str]:
    """A sentence for each run whose frame interval (s) is not that of most runs of the campaign, by
    name of the run.
    """
    if len(intervals) < 3:
        return {}
    typical = float(np.median(list(intervals.values())))
    return {
        name: phrase(
            "the frames are {interval:.4g} s apart, while those of most runs are "
            "{usual:.4g} s apart: is the frame "
            "rate right?",
            interval=interval,
            usual=typical,
        )
        for name, interval in intervals.items()
        if abs(interval / typical - 1.0) > 0.2
    }
