"""Tracks of the video-analysis program Tracker (Open Source Physics), read from its .trk and .trz
files without Tracker.

A point that was marked at the pixel (u, w) of frame n has in the calibrated axes the position

    a = (u - xorigin)/xscale
    b = (yorigin - w)/yscale
    x = a cos(angle) + b sin(angle)
    y = -a sin(angle) + b cos(angle)

with the origin, scale and angle of the last key frame up to n, and the time (n - startframe)
delta_t/1000 + starttime/1000.  Source: Tracker's own code (ImageCoordSystem.updateTransforms,
StepperClipControl.getStepTime), checked against its exports.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.common import InputError, in_its_file, listed, phrase, read_number
from estim.reading.input_file import read_bytes
from estim.reading.tracker.track import METRES, Track
from estim.reading.tracker.xml import Element, parse_tracker_xml, unpack_trz

_MAX_BYTES = 64 * 1024**2
_MAX_ARCHIVE = 512 * 1024**2
_MAX_FRAMES = 10_000_000


@dataclass(frozen=True, eq=False)
class _Clip:
    """Which frames belong to the clip and when they are: start, step, number of steps; start_time
    and duration of a frame, ms.
    """

    start: int
    step: int
    count: int
    start_time: float
    duration: float
    video_times: FloatArray | None
    facts: tuple[str, ...]
    warnings: tuple[str, ...]

    def includes(self, frame: int) -> bool:
        steps, rest = divmod(frame - self.start, self.step)
        return rest == 0 and 0 <= steps < self.count

    def times(self, frames: IntArray) -> FloatArray:
        if self.video_times is None:
            return np.asarray(
                (self.start_time + (frames - self.start) * self.duration) / 1e3, dtype=np.float64
            )
        return (self.start_time + self.video_times[frames] - self.video_times[self.start]) / 1e3


@in_its_file
def read_tracker(
    path: Path, *, track: str | None = None, unit: str | None = None, frame_ms: float | None = None
) -> Track:
    """The point mass `track` of the .trk or .trz file at `path`; without a name, the only one.  Of
    one of several .trk in a .trz: "NAME.trk/mass A".

    unit : of the calibrated lengths, where the file's own statement is wrong.
    frame_ms : duration of a frame, where the file contradicts the video (a film taken at high
        speed).  Raises InputError with file, line, field, rule and value.
    """
    archive = path.suffix.lower() == ".trz"
    data = read_bytes(path, limit=_MAX_ARCHIVE if archive else _MAX_BYTES)
    text, track = unpack_trz(data, track) if archive else (data, track)
    panel = parse_tracker_xml(text)
    if not panel.kind.endswith(".TrackerPanel"):
        raise InputError(
            "must be the TrackerPanel of a .trk file",
            field="object",
            value=panel.kind,
            line=panel.line,
        )
    name, points = _choose(panel, track)
    clip = _read_clip(panel, frame_ms)
    axes = _read_axes(panel)
    factor, unit_fact = _unit(panel, unit)
    marked = points.indexed()
    included = [frame for frame in sorted(marked) if clip.includes(frame)]
    frames = np.array(included, dtype=np.int64)
    pixels = np.array(
        [[marked[frame].number(c) for c in ("x", "y")] for frame in included]
    ).reshape(-1, 2)
    world = axes.world(frames, pixels) * factor
    outside = len(marked) - len(included)
    left_out = [phrase("{n} points outside the clip were excluded", n=outside)] if outside else []
    of_sticks, against_sticks = _sticks(panel, axes)
    facts = (unit_fact, *axes.facts(factor), *of_sticks, *clip.facts, *left_out)
    return Track(
        file=str(path),
        sha256=hashlib.sha256(data).hexdigest(),
        name=name,
        t=clip.times(frames),
        x=world[:, 0].copy(),
        y=world[:, 1].copy(),
        frames=frames,
        lines=np.array([marked[frame].line for frame in included], dtype=np.int64),
        speed=None,
        calibration=facts,
        warnings=(*clip.warnings, *axes.warnings(), *against_sticks),
    )


def _tracks(panel: Element) -> list[tuple[str, str, Element]]:
    """Name, kind (the last part of its class) and object of every track."""
    element = panel.find("tracks")
    objects = (
        [item.parts[0] for item in element.parts if item.parts and item.parts[0].tag == "object"]
        if element
        else []
    )
    return [(_name(track), track.kind.rpartition(".")[2], track) for track in objects]


def _name(track: Element) -> str:
    element = track.find("name")
    return " ".join(element.text.split())[:100] if element and element.text else "unnamed"


def _choose(panel: Element, track_name: str | None) -> tuple[str, Element]:
    """The point mass called `track_name` and its points; the only one where no name is given.
    Raises InputError listing what there is.
    """
    tracks = _tracks(panel)
    masses = [(name, track) for name, kind, track in tracks if kind == "PointMass"]
    names = listed([name for name, _ in masses])
    if not masses:
        other = listed([f"{name} ({kind})" for name, kind, _ in tracks]) or "no track at all"
        raise InputError(
            "must hold a point mass with marked positions",
            field="tracks",
            quoted=f"it holds {other}",
        )
    if track_name is None and len(masses) > 1:
        raise InputError("must be named, as there are several", field="track", quoted=names)
    chosen = [(name, track) for name, track in masses if track_name is None or name == track_name]
    if not chosen:
        kind = next((kind for name, kind, _ in tracks if name == track_name), None)
        rule, what = (
            ("is not in the file", "")
            if kind is None
            else ("has no marked positions to read", f"it is a {kind}; ")
        )
        raise InputError(
            rule, field="track", value=track_name, quoted=f"{what}point masses: {names}"
        )
    if len(chosen) > 1:
        raise InputError(
            "must be the name of one track: several are called so",
            field="track",
            value=chosen[0][0],
        )
    name, track = chosen[0]
    if panel.find("referenceframe") or panel.find("reference_frame"):
        raise InputError(
            "must be at rest: the axes move with another track; export the table from Tracker "
            "instead",
            field="referenceframe",
        )
    return name, track.need("framedata")


def _read_clip(panel: Element, frame_ms: float | None) -> _Clip:
    clip, control = panel.object("videoclip"), panel.object("clipcontrol")
    if clip is None or control is None:
        raise InputError(
            "is missing", field="videoclip" if clip is None else "clipcontrol", line=panel.line
        )
    start, step, count = (
        clip.integer(name, default)
        for name, default in (("startframe", 0), ("stepsize", 1), ("stepcount", _MAX_FRAMES))
    )
    for name, value, low in (("stepsize", step, 1), ("startframe", start, 0)):
        if not low <= value <= _MAX_FRAMES:
            raise clip.need(name).error(f"must be >= {low} and at most {_MAX_FRAMES}", value=value)
    stated = control.number("delta_t")
    if stated <= 0.0:
        raise control.need("delta_t").error("must be > 0", value=stated)
    duration = stated if frame_ms is None else frame_ms
    of_video = _video_times(clip)
    average = None if of_video is None else (of_video[-1] - of_video[0]) / (of_video.size - 1)
    # how far the frame durations of the clip and of the video may differ
    if average is not None and frame_ms is None and abs(stated / average - 1.0) > 0.02:
        raise control.need("delta_t").error(
            f"contradicts the video, whose frames last {average:.6g} ms; say which holds by "
            "--frame-ms (in a campaign: frame_ms)",
            value=stated,
        )
    facts = [
        phrase(
            "frame {start} is step 0, every frame, {duration:.8g} ms a frame"
            if step == 1
            else "frame {start} is step 0, every {step} frames, {duration:.8g} ms a frame",
            start=start,
            step=step,
            duration=duration,
        )
    ]
    if frame_ms is not None and frame_ms != stated:
        facts.append(
            phrase(
                "frame duration as stated by the user; according to the file it is {stated:.8g} ms",
                stated=stated,
            )
        )
    times, warnings = _unequal(of_video, start, step, count, duration)
    return _Clip(
        start,
        step,
        max(count, 0),
        clip.number("starttime", 0.0),
        duration,
        times,
        tuple(facts),
        warnings,
    )


def _video_times(clip: Element) -> FloatArray | None:
    """Times of the video's frames in ms, where the file holds them; increasing."""
    video = clip.object("video")
    stated = None if video is None else video.find("start_times")
    array = None if stated is None else stated.find("array")
    if video is None:
        return None
    if array is None:
        duration, count = video.number("duration", 0.0), video.integer("frame_count", 0)
        return (
            np.linspace(0.0, 1e3 * duration, count + 1)
            if duration > 0.0 and 1 < count <= _MAX_FRAMES
            else None
        )
    try:
        times = np.array(
            [read_number(cell.strip()) for cell in array.text.strip("{} \n\t").split(",")]
        )
    except ValueError:
        raise array.error("must be a list of numbers", value=array.text) from None
    if not np.all(np.abs(times) < 1e12):
        raise array.error("must be a list of times in ms")
    return times if times.size > 1 and np.all(np.diff(times) > 0.0) else None


def _unequal(
    of_video: FloatArray | None, start: int, step: int, count: int, duration: float
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """The video's own times, ms, stretched to the clip's mean `duration` (ms), and a warning, where
    its frames are not equally long.
    """
    end = start + step * (count - 1)
    if of_video is None or not start < end < of_video.size:
        return None, ()
    scaled = (of_video - of_video[start]) * (
        duration * (end - start) / (of_video[end] - of_video[start])
    )
    largest = float(
        np.max(np.abs(scaled - (np.arange(of_video.size) - start) * duration)[start : end + 1])
    )
    # equal but for rounding
    if largest <= max(1e-3 * duration, 0.002):
        return None, ()
    warning = phrase(
        "the frames of the video are not equally spaced (times differ by up to {off:.3g} "
        "ms): the video's own times are used, as in "
        "Tracker",
        off=largest,
    )
    return scaled, (warning,)


@dataclass(frozen=True, eq=False)
class _Axes:
    """Key frames of the coordinate system: frames (n_key,), values (n_key, 5) xorigin, yorigin,
    angle (deg), xscale, yscale.
    """

    frames: tuple[int, ...]
    values: FloatArray

    def world(self, frames: IntArray, pixels: FloatArray) -> FloatArray:
        """(n, 2) positions in the calibrated axes of (n, 2) pixels."""
        key = [bisect_right(self.frames, int(frame)) - 1 for frame in frames]
        x0, y0, angle, x_scale, y_scale = self.values[key].T
        a, b = (pixels[:, 0] - x0) / x_scale, (y0 - pixels[:, 1]) / y_scale
        cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        return np.column_stack([a * cos + b * sin, b * cos - a * sin])

    def facts(self, factor: float) -> tuple[str, ...]:
        x0, y0, angle, x_scale, y_scale = self.values[0]
        scale = f"{x_scale / factor:.8g}"
        if x_scale != y_scale:
            scale = phrase("{x:.8g} (x) and {y:.8g} (y)", x=x_scale / factor, y=y_scale / factor)
        first = phrase(
            "scale {scale} pixels/m, origin at pixel ({x:.6g}, {y:.6g}), axes turned by "
            "{angle:.6g} deg",
            scale=scale,
            x=x0,
            y=y0,
            angle=angle,
        )
        more = len(self.frames) - 1
        return (
            first
            + (
                phrase(" at frame {frame}; {n} later changes", frame=self.frames[0], n=more)
                if more
                else ""
            ),
        )

    def warnings(self) -> tuple[str, ...]:
        if np.all(self.values[:, 3:] == 1.0):
            return (
                phrase("the scale is 1 pixel per unit of length: the video was not calibrated"),
            )
        return ()


def _read_axes(panel: Element) -> _Axes:
    coords = panel.object("coords")
    if coords is None or not coords.kind.endswith(".ImageCoordSystem"):
        raise InputError(
            "must be an ImageCoordSystem",
            field="coords",
            value=None if coords is None else coords.kind,
        )
    keys = coords.need("framedata").indexed()
    if 0 not in keys:
        raise coords.need("framedata").error("must begin at frame 0")
    frames = sorted(keys)
    values = [
        [keys[f].number(name) for name in ("xorigin", "yorigin", "angle", "xscale", "yscale")]
        for f in frames
    ]
    for frame, row in zip(frames, values, strict=True):
        for name, scale in (("xscale", row[3]), ("yscale", row[4])):
            if scale < 1e-9:
                raise keys[frame].need(name).error("must be > 0", value=scale)
    return _Axes(tuple(frames), np.array(values))


def _unit(panel: Element, stated: str | None) -> tuple[float, str]:
    """Metres in the unit of the calibration, and where that is stated."""
    element = panel.find("length_unit")
    written = element.text if element else ""
    if stated is not None:
        other = (
            phrase("; according to the file: {unit}", unit=written)
            if written and written != stated
            else ""
        )
        return METRES[stated], phrase(
            "lengths in {unit} as stated by the user", unit=stated
        ) + other
    if element is not None and written not in METRES:
        raise element.error(
            f"must be one of {', '.join(METRES)}; say which holds by --unit (in a campaign: unit)",
            value=written,
        )
    if not written:
        return METRES["m"], phrase("the file states no unit of length: m is assumed")
    return METRES[written], phrase("lengths in {unit}, as stated in the file", unit=written)


def _sticks(panel: Element, axes: _Axes) -> tuple[list[str], list[str]]:
    """What the file states of every calibration stick at its first frame, and of a stick whose
    length by the scale is not its stated length; sticks set the scale, so they agree unless one was
    edited.
    """
    facts, warnings = [], []
    for name, kind, track in _tracks(panel):
        stick, lengths, ends = map(track.find, ("stickmode", "worldlengths", "framedata"))
        place = ends and ends.object("[0]")
        is_stick = kind == "TapeMeasure" and stick and stick.text == "true"
        if not (is_stick and lengths and lengths.find("[0]") and place):
            continue
        x1, y1, x2, y2 = (place.number(end) for end in ("x1", "y1", "x2", "y2"))
        dx, dy, length = x2 - x1, y2 - y1, lengths.number("[0]")
        facts.append(
            phrase(
                "{name}: {length:.6g} for {pixels:.6g} pixels",
                name=name,
                length=length,
                pixels=np.hypot(dx, dy),
            )
        )
        by_scale = float(np.hypot(dx / axes.values[0, 3], dy / axes.values[0, 4]))
        if abs(by_scale - length) > 0.01 * abs(length):
            warnings.append(
                phrase(
                    "the length of {name} is {by_scale:.4g} on the scale of the axes, but "
                    "{length:.4g} was stated",
                    name=name,
                    by_scale=by_scale,
                    length=length,
                )
            )
    return facts, warnings
