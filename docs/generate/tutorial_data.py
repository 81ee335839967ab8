"""Makes the SYNTHETIC data of the tutorials: data/tutorial/tea.csv and data/tutorial/fall.trk, the
latter as the program Tracker writes it.

    python docs/generate/tutorial_data.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parents[2] / "data" / "tutorial"
ROOM, EXCESS, TAU, U_T = 21.0, 61.0, 17.5, 0.3  # °C, °C, min, °C
G, V_T, T0, DROP, U_MARK = 9.81, 8.6, -0.006, 1.9, 0.7  # m/s², m/s, s, m, pixels
SCALE, FRAME_MS, START = 340.0, 1000.0 / 60.0, 12  # pixels/m, ms, frame at which the clip begins


def tea() -> str:
    """A cup of tea that cools: time and temperature, read every two minutes for an hour."""
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 61.0, 2.0)
    read = ROOM + EXCESS * np.exp(-t / TAU) + U_T * rng.standard_normal(t.size)
    rows = [f"{minute:.0f},{temperature:.1f}" for minute, temperature in zip(t, read, strict=True)]
    return "\n".join(
        [
            "# SYNTHETIC data: made by docs/generate/tutorial_data.py",
            "time [min],temperature [°C]",
            *rows,
            "",
        ]
    )


def fall() -> str:
    """A table tennis ball that falls with drag by the square of its speed, x = (v_t²/g) ln cosh(g
    (t - t0)/v_t), marked frame by frame.
    """
    rng = np.random.default_rng(9)
    t = np.arange(0.0, 2.0, FRAME_MS / 1e3)
    x = V_T**2 / G * np.log(np.cosh(G * (t - T0) / V_T))
    n = int(np.sum(x < DROP))
    column = 642.0 + U_MARK * rng.standard_normal(n)
    row = 48.0 + SCALE * x[:n] + U_MARK * rng.standard_normal(n)
    points = "".join(_point(START + i, column[i], row[i]) for i in range(n))
    return _TRK.format(
        points=points,
        n=n,
        frames=START + n + 5,
        start=START,
        delta_t=FRAME_MS,
        scale=SCALE,
        end=660.0 - SCALE,
    )


def _point(frame: int, x: float, y: float) -> str:
    return f"""            <property name="[{frame}]" type="object">
            <object class="org.opensourcephysics.cabrillo.tracker.PointMass$FrameData">
                <property name="x" type="double">{x:.4f}</property>
                <property name="y" type="double">{y:.4f}</property>
            </object>
            </property>
"""


_TRK = """<?xml version="1.0" encoding="UTF-8"?>
<object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
    <property name="semantic_version" type="string">6.1.0</property>
    <property name="description" type="string">SYNTHETIC data: made by docs/generate/tutorial_data.py</property>
    <property name="videoclip" type="object">
    <object class="org.opensourcephysics.media.core.VideoClip">
        <property name="video_framecount" type="int">{frames}</property>
        <property name="startframe" type="int">{start}</property>
        <property name="stepsize" type="int">1</property>
        <property name="stepcount" type="int">{n}</property>
        <property name="starttime" type="double">0.0</property>
    </object>
    </property>
    <property name="clipcontrol" type="object">
    <object class="org.opensourcephysics.media.core.StepperClipControl">
        <property name="rate" type="double">1.0</property>
        <property name="delta_t" type="double">{delta_t:.6f}</property>
    </object>
    </property>
    <property name="coords" type="object">
    <object class="org.opensourcephysics.media.core.ImageCoordSystem">
        <property name="fixedorigin" type="boolean">true</property>
        <property name="fixedangle" type="boolean">true</property>
        <property name="fixedscale" type="boolean">true</property>
        <property name="framedata" type="array" class="[Lorg.opensourcephysics.media.core.ImageCoordSystem$FrameData;">
            <property name="[0]" type="object">
            <object class="org.opensourcephysics.media.core.ImageCoordSystem$FrameData">
                <property name="xorigin" type="double">642.0</property>
                <property name="yorigin" type="double">48.0</property>
                <property name="angle" type="double">0.0</property>
                <property name="xscale" type="double">{scale}</property>
                <property name="yscale" type="double">{scale}</property>
            </object>
            </property>
        </property>
    </object>
    </property>
    <property name="length_unit" type="string">m</property>
    <property name="tracks" type="collection" class="java.util.ArrayList">
        <property name="item" type="object">
        <object class="org.opensourcephysics.cabrillo.tracker.CoordAxes">
            <property name="name" type="string">axes</property>
        </object>
        </property>
        <property name="item" type="object">
        <object class="org.opensourcephysics.cabrillo.tracker.TapeMeasure">
            <property name="name" type="string">metre stick</property>
            <property name="stickmode" type="boolean">true</property>
            <property name="framedata" type="array" class="[Lorg.opensourcephysics.cabrillo.tracker.TapeMeasure$FrameData;">
                <property name="[0]" type="object">
                <object class="org.opensourcephysics.cabrillo.tracker.TapeMeasure$FrameData">
                    <property name="x1" type="double">900.0</property>
                    <property name="y1" type="double">660.0</property>
                    <property name="x2" type="double">900.0</property>
                    <property name="y2" type="double">{end}</property>
                </object>
                </property>
            </property>
            <property name="worldlengths" type="array" class="[Ljava.lang.Double;">
                <property name="[0]" type="double">1.0</property>
            </property>
        </object>
        </property>
        <property name="item" type="object">
        <object class="org.opensourcephysics.cabrillo.tracker.PointMass">
            <property name="name" type="string">ball</property>
            <property name="framedata" type="array" class="[Lorg.opensourcephysics.cabrillo.tracker.PointMass$FrameData;">
{points}            </property>
        </object>
        </property>
    </property>
</object>
"""

if __name__ == "__main__":
    DATA.mkdir(parents=True, exist_ok=True)
    for name, text in (("tea.csv", tea()), ("fall.trk", fall())):
        (DATA / name).write_text(text, encoding="utf-8", newline="\n")
        print(DATA / name)
