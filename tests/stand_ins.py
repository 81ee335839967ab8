"""Files of the program Tracker made here: every dialect that the real recordings of the tests have,
with motions and calibrations that are known.

`write` lays them out under the names of the real ones, so that a test reads either; `TRUTH` says
what was put in.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tracker_files import array, prop, thing, trk

FRAME = 0.033367  # s, and the frame at which the clip begins
START = 20
SCALE = 2500.0  # pixels/m
DOWN = np.radians(-92.0)  # the direction of a fall in the axes, and where it begins in m
BEGIN = (-0.052, 0.0278)
# m; a mark is the mean of three independent errors, so that frames three apart are independent
OUTER, JITTER = 0.00015, np.ones(3) / 3.0
# number of points, speed in m/s at t = 0, acceleration in m/s²
FALLS = {"CIMG9886": (50, 0.0698, -0.0080), "CIMG9888": (49, 0.0685, -0.0076)}
# towards the speed v; m/s, s, m; the stick is called ten times too long
SLOWING = {"n": 61, "v": 0.0420, "v0": 0.0680, "tau": 0.7, "sigma": 0.00003}
EXPORTS = {"CIMG9886": "a1", "CIMG9888": "a2", "CIMG9892": "b3"}
# 1/s, 1/s², m, m, m/s, m: f grows, A falls evenly
SWING = {"f": 0.446, "rate": 0.0007, "rest": 0.72, "A": 0.53, "loss": 0.0112, "R": 0.85}
# number of points, acceleration in m/s², from rest
ROLLS = {"kulefullbane": (40, 1.71), "ringfullbane": (49, 1.16), "Vid3": (46, 1.22)}

Motion = tuple[np.ndarray, np.ndarray, np.ndarray]  # t in s, x and y in m


def phase(t: np.ndarray) -> np.ndarray:
    """Phase of the swing, rad: its frequency is f + rate t."""
    return 2.0 * np.pi * (SWING["f"] * t + 0.5 * SWING["rate"] * t**2)


def frequency(low: float, high: float) -> float:
    """Mean frequency of the swing between two times, 1/s."""
    return SWING["f"] + 0.5 * SWING["rate"] * (low + high)


def error_of_slope(t: np.ndarray) -> float:
    """Standard deviation of the slope of a straight line through frames `t` of the first fall, m/s,
    by the covariance of its marks.
    """
    weights = (t - t.mean()) / np.sum((t - t.mean()) ** 2)
    return float(OUTER * np.linalg.norm(np.convolve(weights, JITTER)))


def motions() -> dict[str, Motion]:
    """What each sound file holds, in the axes of the file; of CIMG9892 as its wrong scale
    shows it.
    """
    rng = np.random.default_rng(9886)
    made = {}
    for name, (n, v, a) in FALLS.items():
        t = FRAME * np.arange(n)
        made[name] = _fall(
            t,
            v * t
            + 0.5 * a * t**2
            + np.convolve(OUTER * rng.standard_normal(n + 2), JITTER, "valid"),
        )
    t = FRAME * np.arange(SLOWING["n"])
    v, v0, tau = (SLOWING[name] for name in ("v", "v0", "tau"))
    t, x, y = _fall(
        t,
        v * t
        + (v0 - v) * tau * (1.0 - np.exp(-t / tau))
        + SLOWING["sigma"] * rng.standard_normal(t.size),
    )
    made["CIMG9892"] = (t, 10.0 * x, 10.0 * y)
    made |= {export: made[video] for video, export in EXPORTS.items()}
    made["Klipp0"] = _swing(0.01 * np.arange(4143))
    t, x, y = _swing(0.04 * np.arange(900))
    made["Klipp1"] = (8.44 + t, x, y)
    made["52"] = _swing(0.01 * np.arange(2016))
    for name, (n, a) in ROLLS.items():
        t = np.arange(n) / 30.0
        s = 0.02 + 0.5 * a * t**2
        made[name] = (t, s * np.cos(np.radians(-8.0)), 0.46 + s * np.sin(np.radians(-8.0)))
    return made


def _fall(t: np.ndarray, s: np.ndarray) -> Motion:
    return t, BEGIN[0] + s * np.cos(DOWN), BEGIN[1] + s * np.sin(DOWN)


def _swing(t: np.ndarray) -> Motion:
    x = SWING["rest"] - (SWING["A"] - SWING["loss"] * t) * np.cos(phase(t))
    return t, x, 0.10 + SWING["R"] - np.sqrt(SWING["R"] ** 2 - (x - SWING["rest"]) ** 2)


TRUTH = motions()


def write(folder: Path) -> Path:
    """All files, sound and spoiled, in folders of `folder`."""
    for name, text in (_videos() | _exports() | _spoiled()).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode())
    return folder


def _number(value: float, digits: int, *, comma: bool = False) -> str:
    """As Tracker writes a number: 1.234567E-1, or with a decimal comma."""
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}E{int(exponent)}".replace(".", "," if comma else ".")


def _derivatives(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speed by central differences, blank (nan) at the ends, and acceleration, blank at two frames
    of each.
    """
    v, a = np.full(t.size, np.nan), np.full(t.size, np.nan)
    v[1:-1] = np.hypot(x[2:] - x[:-2], y[2:] - y[:-2]) / (t[2:] - t[:-2])
    a[2:-2] = np.hypot(
        *((c[4:] - 2.0 * c[2:-2] + c[:-4]) / (t[3:-1] - t[1:-3]) ** 2 for c in (x, y))
    )
    return v, a


def _table(
    head: list[str],
    columns: list[np.ndarray],
    mark: str,
    digits: int,
    *,
    comma: bool = False,
    end: str = "\n",
) -> str:
    rows = [
        mark.join("" if np.isnan(c) else _number(c, digits, comma=comma) for c in row)
        for row in zip(*columns, strict=True)
    ]
    return end.join([*head, *rows, ""])


def _exports() -> dict[str, str]:
    """Commas with a track named over its column; semicolons with decimal commas, in m and cm;
    commas and no name; tabs and a copied row.
    """
    files = {
        f"viscosity/{name}.txt": _table(
            [",mass A,", "t,y,"], [TRUTH[name][0], TRUTH[name][2]], ",", 6
        )
        for name in EXPORTS.values()
    }
    for name in ("Klipp0", "Klipp1"):
        columns = [*TRUTH[name], *_derivatives(*TRUTH[name])]
        files[f"halfpipe/{name}.csv"] = _table(["mass_A", "t;x;y;v;a"], columns, ";", 9, comma=True)
    rows = ["\t".join(repr(float(c)) for c in row) for row in zip(*TRUTH["52"], strict=True)]
    files["halfpipe/52.txt"] = "\n".join(["mass_A", "t\tx\ty", rows[0], *rows]) + "\n"
    for name, track in (("kulefullbane", "kule"), ("ringfullbane", "ring")):
        t, x, y = TRUTH[name]
        columns = [t, 100.0 * x, 100.0 * y, 100.0 * _derivatives(t, x, y)[0]]
        files[f"rolling_ball/{name}.txt"] = _table(
            [track, "t;x;y;v"], columns, ";", 9, comma=True, end="\r\n"
        )
    files["rolling_ball/Vid3.txt"] = _table(
        ["t,x,y,v,"], [*TRUTH["Vid3"], _derivatives(*TRUTH["Vid3"])[0]], ",", 6
    )
    return files


def _spoiled() -> dict[str, str]:
    """Times rounded by a spreadsheet; numbers that it took for dates; a track of three points."""
    t, x, y = (column[:1500] for column in TRUTH["Klipp0"])
    v, a = (np.nan_to_num(column) for column in _derivatives(t, x, y))
    rounded = [
        ";".join(f"{cell:.2E}" for cell in row).replace(".", ",")
        for row in zip(t, x, y, a, v, strict=True)
    ]
    mixed = [f"43513,00;{a:.3g};{b:.3g};0,00E+00;{c:.3g}" for a, b, c in zip(x, y, v, strict=True)]
    few = [
        column[:3] for column in (*TRUTH["kulefullbane"], _derivatives(*TRUTH["kulefullbane"])[0])
    ]
    return {
        "halfpipe/Klipp34.csv": "\n".join(["mass_A;;;;", "t;x;y;a;v", *rounded, ""]),
        "halfpipe/Klipp5.csv": "\n".join([*mixed, ""]),
        "rolling_ball/Kule4.txt": _table(["Kule4", "t;x;y;v"], few, ";", 9, comma=True, end="\r\n"),
    }


def _track(kind: str, name: str, *parts: str) -> str:
    colour = thing(
        "java.awt.Color", *(prop(part, 200, "int") for part in ("red", "green", "blue", "alpha"))
    )
    shown = (
        prop("footprint", "Footprint.Diamond", "string"),
        prop("visible", "true", "boolean"),
        prop("trail", "false", "boolean"),
    )
    return thing(
        f"org.opensourcephysics.cabrillo.tracker.{kind}",
        prop("name", name, "string"),
        prop("color", colour, "object"),
        *shown,
        *parts,
    )


def _marks(points: dict[int, tuple[float, float]]) -> str:
    kind = "org.opensourcephysics.cabrillo.tracker.PointMass$FrameData"
    return array(
        "framedata", {n: thing(kind, prop("x", u), prop("y", w)) for n, (u, w) in points.items()}
    )


def _videos() -> dict[str, str]:
    """Three falls, whose axes and stick say one scale (of the third ten times too small a one), and
    two files with other kinds of tracks.
    """
    times = ",".join(f"{1e3 * FRAME * n:.3f}" for n in range(90))
    listed = prop("start_times", prop("array", "{" + times + "}", "string"), "array")
    turned = thing(
        "org.opensourcephysics.media.core.RotateFilter",
        prop("rotation", "CCW", "string"),
        prop("reverse", "false", "boolean"),
    )
    filters = prop("filters", prop("item", turned, "object"), "collection")
    axes = _track("CoordAxes", "axes")
    files = {}
    for name in EXPORTS:
        scale, length = (SCALE / 10.0, 1.0) if name == "CIMG9892" else (SCALE, 0.1)
        t, x, y = TRUTH[name]
        points = {START + n: (320.0 + scale * x[n], 240.0 - scale * y[n]) for n in range(t.size)}
        ends = thing(
            "x.FrameData",
            *(
                prop(key, value)
                for key, value in (
                    ("x1", 40.0),
                    ("y1", 160.0),
                    ("x2", 40.0),
                    ("y2", 160.0 + scale * length),
                )
            ),
        )
        stick = _track(
            "TapeMeasure",
            "calibration stick A",
            prop("stickmode", "true", "boolean"),
            array("framedata", {0: ends}),
            prop("worldlengths", prop("[0]", length), "array"),
        )
        path = prop("path", f"{name}.AVI", "string")
        video = prop(
            "video",
            thing("org.opensourcephysics.media.xuggle.XuggleVideo", path, filters, listed),
            "object",
        )
        mass = _track("PointMass", "mass A", _marks(points))
        files[f"viscosity/{name}.trk"] = trk(
            axes,
            stick,
            mass,
            axes={0: (320.0, 240.0, 0.0, scale, scale)},
            start=START,
            count=t.size,
            delta_t=1e3 * FRAME,
            video=video,
        )
    keys = prop("keyFrames", prop("array", "{0}", "string"), "array")
    one = [_track("PointMass", f"mass {name}", _marks({0: (440.0, 150.0)}), keys) for name in "AB"]
    corners = prop(
        "framedata", prop("array", "{{420.0,240.0,370.0,150.0,320.0,240.0}}", "string"), "array"
    )
    files["osp/protractor.trk"] = trk(
        axes,
        one[0],
        _track("Protractor", "protractor A", corners),
        one[1],
        axes={0: (320.0, 240.0, 0.0, 1.0, 1.0)},
    )
    gravity = prop("[0]", prop("[0]", "g", "string") + prop("[1]", 10.0), "array")
    files["osp/asinewave.trk"] = trk(
        axes, _track("DynamicParticle", "model A", prop("constants", gravity, "array"))
    )
    return files
