"""Small .trk and .trz files for tests, written as the program Tracker writes them."""

from __future__ import annotations

import io
import zipfile

PANEL = "org.opensourcephysics.cabrillo.tracker.TrackerPanel"
AXES = {0: (100.0, 200.0, 0.0, 50.0, 50.0)}  # xorigin, yorigin, angle, xscale, yscale


def prop(name: str, value: object, kind: str = "double") -> str:
    return f'<property name="{name}" type="{kind}">{value}</property>\n'


def thing(kind: str, *parts: str) -> str:
    return f'<object class="{kind}">\n{"".join(parts)}</object>\n'


def array(name: str, entries: dict[int, str]) -> str:
    return prop(
        name,
        "\n" + "".join(prop(f"[{i}]", entry, "object") for i, entry in entries.items()),
        "array",
    )


def point_mass(name: str, points: dict[int, tuple[float, float]]) -> str:
    data = {
        n: thing("x.PointMass$FrameData", prop("x", u), prop("y", w))
        for n, (u, w) in points.items()
    }
    return thing(
        "org.opensourcephysics.cabrillo.tracker.PointMass",
        prop("name", name, "string"),
        array("framedata", data),
    )


def trk(
    *tracks: str,
    axes: dict[int, tuple[float, ...]] = AXES,
    start: int = 0,
    step: int = 1,
    count: int = 100,
    delta_t: float = 40.0,
    extra: str = "",
    video: str = "",
    unit: str = "m",
    start_time: float = 0.0,
) -> str:
    names = ("xorigin", "yorigin", "angle", "xscale", "yscale")
    keys = {
        n: thing(
            "x.FrameData", *(prop(name, value) for name, value in zip(names, row, strict=True))
        )
        for n, row in axes.items()
    }
    clip = [
        prop("startframe", start, "int"),
        prop("stepsize", step, "int"),
        prop("stepcount", count, "int"),
        prop("starttime", start_time),
    ]
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + thing(
        PANEL,
        prop("videoclip", thing("x.VideoClip", video, *clip), "object"),
        prop("clipcontrol", thing("x.StepperClipControl", prop("delta_t", delta_t)), "object"),
        prop(
            "coords",
            thing("org.opensourcephysics.media.core.ImageCoordSystem", array("framedata", keys)),
            "object",
        ),
        prop("length_unit", unit, "string") if unit else "",
        prop("tracks", "".join(prop("item", track, "object") for track in tracks), "collection"),
        extra,
    )


def stored(text: str, *, name: str = "clip.trk", how: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", how) as archive:
        archive.writestr("videos/film.mp4", b"0" * 1000)
        archive.writestr(name, text)
    return stream.getvalue()
