"""From a track to a run: direction, tilt, release, warnings, `estim import`, and campaigns that
name a file of Tracker.
"""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from stand_ins import ROLLS
from tracker_files import point_mass, trk

from estim import InputError, load_campaign
from estim.reading.run import read_run
from estim.reading.tracker.importing import Choices, import_track, run_table
from estim.reading.tracker.ramp import run_along
from estim.reading.tracker.track import Track


def made(t, x, y, speed=None) -> Track:
    lines = np.arange(1, len(t) + 1)
    x, y = (None if a is None else np.array(a, dtype=float) for a in (x, y))
    return Track("a.trk", "0" * 64, "A", np.array(t, dtype=float), x, y, None, lines, speed, (), ())


def rolling(
    angle_deg: float, *, n: int = 40, back: bool = False, origin=(0.3, -0.2)
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, true distances from rest, x and y of a motion along `angle_deg`; `back` turns in the
    middle and comes back.
    """
    t = 0.02 * np.arange(n)
    s = 0.5 * 0.8 * t**2
    if back:
        s = 0.6 * t - 0.5 * 1.5 * t**2
    a = math.radians(angle_deg)
    return t, s, origin[0] + s * math.cos(a), origin[1] + s * math.sin(a)


def export(t, *columns, names: str = "t,x,y", head: str = "A") -> str:
    rows = [",".join(repr(float(v)) for v in row) for row in zip(t, *columns, strict=True)]
    return "\n".join([head, names, *rows, ""])


@pytest.fixture
def write(tmp_path):
    def write(text: str, name: str = "a.txt") -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


# direction


@pytest.mark.parametrize("angle", [-170.0, -91.0, -4.0, 0.0, 4.0, 45.0, 90.0, 135.0, 180.0])
@pytest.mark.parametrize("back", [False, True])
def test_fitted_direction_points_the_way_the_motion_starts(angle: float, back: bool) -> None:
    t, s, x, y = rolling(angle, back=back)
    ramp = run_along(made(t, x, y))
    np.testing.assert_allclose(ramp.along - ramp.along[0], s, atol=1e-12)
    np.testing.assert_allclose(ramp.across - ramp.across[0], 0.0, atol=1e-12)
    said = float(re.search(r": (\S+) deg", ramp.direction)[1])
    assert math.cos(math.radians(said - angle)) == pytest.approx(1.0)
    uphill = math.degrees(math.asin(math.sin(math.radians(angle))))
    assert math.degrees(ramp.tilt.value) == pytest.approx(uphill, abs=1e-9)


SLANTED = (math.sqrt(3) / 2, 0.5)


@pytest.mark.parametrize(
    ("along", "expected"),
    [
        ("x", (1, 0)),
        ("-x", (-1, 0)),
        ("y", (0, 1)),
        ("-y", (0, -1)),
        (30.0, SLANTED),
        ("30", SLANTED),
    ],
)
def test_stated_direction_is_taken_as_it_is_and_the_fitted_tilt_stands_beside(
    along, expected
) -> None:
    t, _, x, y = rolling(25.0)
    ramp = run_along(made(t, x, y), along)
    np.testing.assert_allclose(ramp.along, expected[0] * x + expected[1] * y, atol=1e-12)
    assert math.degrees(ramp.tilt.value) == pytest.approx(25.0)


@pytest.mark.parametrize("along", ["up", "nan", 400.0, "inf", ""])
def test_a_direction_that_is_none_is_refused(along) -> None:
    t, _, x, y = rolling(25.0)
    with pytest.raises(
        InputError, match="'along' must be fit, x, y, -x, -y or an angle in degrees"
    ):
        run_along(made(t, x, y), along)


def test_one_coordinate_runs_along_its_axis() -> None:
    t, s, _, _ = rolling(0.0)
    down = run_along(made(t, None, 0.5 - s))
    np.testing.assert_allclose(down.along - down.along[0], s, atol=1e-12)
    assert down.tilt is None
    np.testing.assert_allclose(run_along(made(t, None, 0.5 - s), "y").along, 0.5 - s)
    with pytest.raises(
        InputError, match="must be fit, y or -y: the file holds no other coordinate: 4"
    ):
        run_along(made(t, None, s), 4.0)


def test_a_point_at_rest_has_no_direction() -> None:
    with pytest.raises(InputError, match="'track A' does not move: 0 m"):
        run_along(made(range(6), [1.0] * 6, [2.0] * 6))


def test_uncertainty_of_the_fitted_tilt_is_its_scatter(rng: np.random.Generator) -> None:
    """2000 tracks with independent errors of 1 mm: pulls have a standard deviation of 1 within 4
    errors, without the scatter's share not.
    """
    t, _, x, y = rolling(4.0)
    pulls, plain = [], []
    for _ in range(2000):
        ramp = run_along(
            made(t, x + rng.normal(0.0, 1e-3, t.size), y + rng.normal(0.0, 1e-3, t.size))
        )
        pulls.append((ramp.tilt.value - math.radians(4.0)) / ramp.tilt.u)
        plain.append((ramp.tilt.value - math.radians(4.0)) / (1e-3 / np.ptp(np.hypot(x, y))))
    error = 4.0 / math.sqrt(2 * 2000)
    assert abs(np.mean(pulls)) < 4.0 / math.sqrt(2000)
    # Student's t with 38 degrees of freedom: 1.027
    assert np.std(pulls) == pytest.approx(1.0, abs=error + 0.03)
    assert np.std(plain) != pytest.approx(1.0, abs=error + 0.03)


# release


def test_x_is_zero_at_the_first_point_the_origin_or_the_release_stated(write) -> None:
    t, s, x, y = rolling(0.0, origin=(0.3, 0.0))
    path = write(export(t, x, y))
    np.testing.assert_allclose(import_track(path, Choices()).x, s, atol=1e-12)
    np.testing.assert_allclose(import_track(path, Choices(release="keep")).x, s + 0.3, atol=1e-12)
    late = import_track(path, Choices(release=0.101))
    np.testing.assert_allclose(late.x, s[5:] - s[5], atol=1e-12)
    np.testing.assert_allclose(late.t, t[5:], atol=1e-12)
    assert "5 earlier points were excluded" in late.facts[-1]


@pytest.mark.parametrize("release", [-1.0, 0.75, 99.0, math.nan])
def test_a_release_outside_the_track_is_refused(write, release: float) -> None:
    t, _, x, y = rolling(0.0)
    with pytest.raises(InputError, match="'release' must"):
        import_track(write(export(t, x, y)), Choices(release=release))


# suspicions


def warned(write, *columns, names="t,x,y", **choices) -> str:
    return " | ".join(
        import_track(write(export(*columns, names=names)), Choices(**choices)).warnings
    )


def test_a_clean_track_is_not_suspected(write) -> None:
    t, _, x, y = rolling(4.0)
    assert warned(write, t, x, y) == ""


def test_implausible_scale_is_suspected(write) -> None:
    t, _, x, y = rolling(4.0)
    assert "the acceleration reaches 16 m/s²" in warned(write, t, 20 * x, 20 * y)
    assert "the acceleration reaches 20 m/s²" in warned(write, t / 5, x, y)
    assert "is the unit of length centimetres" in warned(write, t, 100 * x, 100 * y)


def test_noise_of_the_positions_is_no_acceleration(write, rng: np.random.Generator) -> None:
    t, _, x, y = rolling(4.0, n=200)
    assert "acceleration" not in warned(write, t / 2, x / 4 + rng.normal(0, 1e-3, 200), y / 4)


def test_missing_and_unequal_frames_are_said(write) -> None:
    t, _, x, y = rolling(4.0)
    keep = np.arange(t.size) != 17
    assert "1 of 40 frames are missing" in warned(write, t[keep], x[keep], y[keep])
    shifted = t + np.where(np.arange(t.size) == 17, 0.007, 0.0)
    assert "whole multiples of 0.02 s" in warned(write, shifted, x, y)


def test_path_that_is_no_line_is_suspected(write) -> None:
    t, s, x, _ = rolling(0.0)
    assert "the path is not straight" in warned(write, t, x, 3.0 * s**2)


def test_track_that_begins_in_motion_is_suspected(write) -> None:
    t, _, x, y = rolling(4.0)
    assert "m/s in the first frames" in warned(write, t[20:], x[20:], y[20:])
    assert "first frames" not in warned(write, t, x, y)


def test_speed_column_is_checked_against_the_positions(write) -> None:
    t, _, x, y = rolling(4.0, back=True)
    v = np.hypot(np.gradient(x, t), np.gradient(y, t))
    text = warned(write, t, x, y, v, names="t,x,y,v")
    assert "the column v is a magnitude" in text
    assert "central difference" not in text
    assert "not the central difference" in warned(write, t, x, y, 1.1 * v, names="t,x,y,v")
    # times changed after v was made
    assert "not the central difference" in warned(write, 4 * t, x, y, v, names="t,x,y,v")


# the command


def estim(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "estim", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_command_writes_a_run_that_is_read_back_unchanged(write, tmp_path) -> None:
    t, _, x, y = rolling(4.0)
    path = write(export(t[10:], x[10:], y[10:]))
    done = estim("import", path, "-o", tmp_path / "new" / "run.csv")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 7
    assert done.stderr.startswith("warning: the body already moves")
    imported = import_track(path, Choices())
    run = read_run(tmp_path / "new" / "run.csv", name="a")
    assert np.array_equal(run.columns["t_s"], imported.t)
    assert np.array_equal(run.columns["x_m"], imported.x)
    assert run.warnings == imported.warnings  # they are kept with the numbers
    text = (tmp_path / "new" / "run.csv").read_text()
    for fact in (
        imported.track.sha256,
        "tilt of the fitted line 4.000 deg",
        "x_m = 0 at the first point",
    ):
        assert fact in text
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["run.csv"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--track", "B"], "'track' must name one of the tracks (A): B"),
        (["--release", "soon"], "'release' must be first, keep or a time in s: soon"),
        (
            ["--frame-ms", "4"],
            "'frame_ms' goes with .trk and .trz files: an export states its times",
        ),
        (["--along", "-y", "--unit", "inch"], "'inch' is not one of"),
    ],
)
def test_command_refuses_in_one_line(write, tmp_path, options: list[str], message: str) -> None:
    t, _, x, y = rolling(4.0)
    done = estim("import", write(export(t, x, y)), *options, "-o", tmp_path / "run.csv")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert message in done.stderr
    assert not (tmp_path / "run.csv").exists()


def test_command_does_not_write_over_its_input(write) -> None:
    t, _, x, y = rolling(4.0)
    path = write(export(t, x, y))
    done = estim("import", path, "-o", path)
    assert done.returncode == 2
    assert "a.txt" in done.stderr  # of another making: nothing is written over it
    assert path.read_text() == export(t, x, y)


def test_axis_options_that_look_like_options_are_values(write, tmp_path) -> None:
    t, s, _, y = rolling(-90.0, origin=(0.0, 0.0))
    done = estim(
        "import", write(export(t, s * 0.0, y)), "--along", "-y", "-o", tmp_path / "run.csv"
    )
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(
        read_run(tmp_path / "run.csv", name="a").columns["x_m"], s, atol=1e-12
    )


# recordings: stand-ins, and real files where they are present


READ = {
    "viscosity/CIMG9886.trk": Choices(),
    "viscosity/CIMG9888.trk": Choices(),
    "viscosity/CIMG9892.trk": Choices(),
    "viscosity/a1.txt": Choices(),
    "viscosity/a2.txt": Choices(),
    "viscosity/b3.txt": Choices(),
    "halfpipe/Klipp0.csv": Choices(),
    "halfpipe/Klipp1.csv": Choices(),
    "halfpipe/52.txt": Choices(drop_duplicates=True),
    "rolling_ball/kulefullbane.txt": Choices(unit="cm"),
    "rolling_ball/ringfullbane.txt": Choices(unit="cm"),
    "rolling_ball/Vid3.txt": Choices(),
}


@pytest.mark.parametrize("file", READ)
def test_every_sound_file_becomes_a_run(tracker_folder: Path, tmp_path: Path, file: str) -> None:
    imported = import_track(tracker_folder / file, READ[file])
    (tmp_path / "run.csv").write_bytes(run_table(imported))
    run = read_run(tmp_path / "run.csv", name="a")
    assert np.array_equal(run.columns["x_m"], imported.x)
    assert run.columns["x_m"][0] == 0.0
    assert np.all(run.columns["x_m"] > -0.05)  # it runs forward
    assert np.max(run.columns["x_m"]) < 2.0


@pytest.mark.statistics
def test_real_files_are_those_that_have_stand_ins(stand_ins: Path, real_files: list[Path]) -> None:
    """None in a plain clone; how many there were stands below the tests."""
    made = {"/".join(path.parts[-2:]) for path in stand_ins.rglob("*") if path.is_file()}
    assert {"/".join(path.parts[-2:]) for path in real_files} in (set(), made)


def test_a_trk_and_its_export_make_the_same_run(tracker_folder: Path) -> None:
    video, table = (
        import_track(tracker_folder / "viscosity" / name, Choices(along="-y"))
        for name in ("CIMG9886.trk", "a1.txt")
    )
    np.testing.assert_allclose(video.x, table.x, atol=1.1e-8)


@pytest.mark.slow
def test_suspicions_of_the_recordings(tracker_folder: Path) -> None:
    def said(file: str, **choices) -> str:
        return " | ".join(import_track(tracker_folder / file, Choices(**choices)).warnings)

    assert "is the unit of length centimetres" in said("rolling_ball/kulefullbane.txt")
    assert "centimetres" not in said("rolling_ball/kulefullbane.txt", unit="cm")
    assert "the path is not straight" in said("halfpipe/Klipp0.csv")
    assert "v is a magnitude" in said("halfpipe/Klipp0.csv")
    assert "1 row that copies" in said("halfpipe/52.txt", drop_duplicates=True)


# campaigns

CAMPAIGN = """
title = "x"
kind = "measured"
[bodies.b]
radius_m = 0.15
gamma = 0.187
kappa = {prior = "uniform", low = 0.0, high = 1.0}
phi_deg = "4.0(4)"
theta0_deg = "60.0(15)"
noise = {sigma_x_m = 0.001}
"""


def run(name: str, file: str, more: str = "") -> str:
    return f'[[runs]]\nname = "{name}"\nbody = "b"\nfile = "{file}"\n{more}\n'


def test_a_campaign_names_an_export_directly(write) -> None:
    t, s, x, y = rolling(4.0)
    write(export(t, 100 * x, 100 * y))
    write(export(t, x, y, 2 * x, 2 * y, names="t,x,y,x,y", head=",A,,B,"), "two.txt")
    campaign = load_campaign(
        write(
            CAMPAIGN
            + run("one", "a.txt", 'unit = "cm"')
            + run("two", "two.txt", 'track = "A"\nalong = 4.0'),
            "c.toml",
        )
    )
    for name in ("one", "two"):
        np.testing.assert_allclose(campaign.tables[name].columns["x_m"], s, atol=1e-9)
        assert math.degrees(campaign.tables[name].tilt.value) == pytest.approx(4.0)
        assert any(
            "tilt of the fitted line 4.000 deg" in fact for fact in campaign.tables[name].facts
        )


def test_a_campaign_names_a_trk_directly(write) -> None:
    t, s, x, y = rolling(4.0)
    points = {n: (100.0 + 50.0 * x[n], 200.0 - 50.0 * y[n]) for n in range(t.size)}
    write(
        trk(point_mass("mass A", points), point_mass("mass B", points), delta_t=20.0), "video.trk"
    )
    loaded = load_campaign(write(CAMPAIGN + run("one", "video.trk", 'track = "mass A"'), "c.toml"))
    np.testing.assert_allclose(loaded.tables["one"].columns["x_m"], s, atol=1e-9)
    with pytest.raises(
        InputError,
        match=r"video.trk: 'track' must be named, as there are several \(mass A, mass B\)",
    ):
        load_campaign(write(CAMPAIGN + run("one", "video.trk"), "c.toml"))


def test_choices_in_a_campaign_are_checked(write) -> None:
    t, s, x, y = rolling(4.0)
    write(export(t, x, y))
    write("t_s,x_m\n" + "".join(f"{a},{b}\n" for a, b in zip(t, s, strict=True)), "own.csv")
    cases = {
        'unit = "inch"': r"c.toml:\d+: 'unit'",
        "release = true": r"c.toml:\d+: 'release'",
        'along = "up"': "a.txt: 'along' must be fit",
        "frame_ms = 4": "a.txt: 'frame_ms' goes with",
    }
    for more, message in cases.items():
        with pytest.raises(InputError, match=message):
            load_campaign(write(CAMPAIGN + run("one", "a.txt", more), "c.toml"))
    with pytest.raises(InputError, match=r"own.csv:1: 'header' must have a line of column names"):
        load_campaign(write(CAMPAIGN + run("one", "own.csv", 'along = "x"'), "c.toml"))


def test_a_frame_rate_unlike_that_of_the_other_runs_is_suspected(write) -> None:
    t, _, x, y = rolling(4.0)
    for i in range(4):
        write(export(4 * t if i == 2 else t, x, y), f"{i}.txt")
    campaign = load_campaign(
        write(CAMPAIGN + "".join(run(f"r{i}", f"{i}.txt") for i in range(4)), "c.toml")
    )
    assert campaign.tables["r2"].warnings == (
        "the frames are 0.08 s apart, while those of most runs are 0.02 s apart: is the "
        "frame rate right?",
    )
    assert campaign.tables["r1"].warnings == ()


@pytest.mark.parametrize("factor", [1e-40, 1e-12])
def test_times_that_no_clock_tells_apart_are_refused(write, factor: float) -> None:
    t, _, x, y = rolling(4.0)
    with pytest.raises(
        InputError, match=r":\d+: 't' must advance by at least 1e-09 s from row to row"
    ) as caught:
        import_track(write(export(t * factor, x, y)), Choices())
    assert "\n" not in str(caught.value)


def test_frames_of_no_duration_are_refused(tmp_path) -> None:
    points = {n: (100.0 + 5.0 * n, 200.0 - 2.0 * n) for n in range(12)}
    (tmp_path / "a.trk").write_text(trk(point_mass("A", points), delta_t=1e-300))
    with pytest.raises(InputError, match=r"'t' must advance by at least 1e-09 s"):
        import_track(tmp_path / "a.trk", Choices())


def test_a_small_ball_on_a_long_way_is_asked_about_its_unit_only_if_it_is_wrong(
    tracker_folder: Path, stand_ins: Path, tmp_path: Path
) -> None:
    text = f"""title = "a ball of 1 cm on 1.4 m"
kind = "measured"
[bodies.ball]
radius_m = "0.010(1)"
gamma = {{prior = "half-normal", scale = 0.05}}
kappa = 0.4
[[runs]]
name = "r"
body = "ball"
file = "{tracker_folder / "rolling_ball" / "kulefullbane.txt"}"
unit = "cm"
phi_deg = "-2.0(20)"
theta0_deg = {{prior = "uniform", low = 0.0, high = 360.0}}
noise = {{sigma_x_m = 0.002}}
"""
    (tmp_path / "c.toml").write_text(text)
    load_campaign(tmp_path / "c.toml")
    (tmp_path / "c.toml").write_text(text.replace('"cm"', '"m"'))
    reach = "139.4"  # cm, of the real file
    if tracker_folder == stand_ins:
        n, a = ROLLS["kulefullbane"]
        reach = f"{50.0 * a * ((n - 2) / 30.0) ** 2:.4g}"  # the last frame that has a speed
    with pytest.raises(
        InputError,
        match=rf"kulefullbane\.txt: 'x_m' reaches {reach} m, .* is it in cm or mm, or the time not "
        r"in s\?$",
    ):
        load_campaign(tmp_path / "c.toml")


BARE = "t,x\n0,0.01\n0.1,0.02\n0.2,0.04\n0.3,0.07\n0.4,0.11\n"


def test_a_table_of_t_and_x_alone_is_not_taken_for_an_export_whose_zero_moves(write) -> None:
    """Nothing in such a file shows whether x is counted from the release (a table) or from the
    first point (a track).
    """
    for text, line in (
        (BARE, 1),
        (f"# by hand\n{BARE.replace(',', ';')}", 2),
        (BARE.replace("t,x", "t (s),x (m)"), 1),
        (BARE.replace("x", "y"), 1),
    ):
        with pytest.raises(
            InputError,
            match=rf"a\.txt:{line}: 'header' may be a table or an export .* write t_s,x_m .* "
            r"release = \"first\"",
        ):
            read_run(write(text), name="r")
    stated = [
        read_run(write(text), name="r", choices=choices)
        for text, choices in (
            (BARE, Choices(release="keep", along="x")), (BARE, Choices(release="first")),
            (f"mass A\n{BARE}", None),
            (BARE.replace("t,x", "t_s,x_m"), None),
        )
    ]  # fmt: skip
    assert [round(run.columns["x_m"][0].item(), 9) for run in stated] == [0.01, 0.0, 0.0, 0.01]
