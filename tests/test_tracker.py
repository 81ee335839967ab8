"""Files of the program Tracker: recordings against Tracker's own exports, small ones against
numbers worked out by hand.
"""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from pathlib import Path

import numpy as np
import pytest
from stand_ins import EXPORTS, START, TRUTH
from tracker_files import array, point_mass, prop, stored, thing, trk

from estim import InputError
from estim.reading.tracker.trk import read_tracker

LINE = {n: (100.0 + 5.0 * n, 200.0 - 2.0 * n) for n in range(8)}


@pytest.fixture
def write(tmp_path):
    def write(text: str | bytes, name: str = "a.trk") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


# recordings: stand-ins, and real files where they are present


@pytest.mark.parametrize(
    ("video", "export", "digits"),
    [("CIMG9886", "a1", 5e-9), ("CIMG9888", "a2", 5e-9), ("CIMG9892", "b3", 5e-8)],
)
def test_positions_and_times_are_those_of_trackers_own_export(
    tracker_folder: Path, video: str, export: str, digits: float
) -> None:
    """An export prints seven digits: half a unit of the last one is all that may differ."""
    path = tracker_folder / "viscosity" / f"{video}.trk"
    track = read_tracker(path)
    rows = [
        [float(cell) for cell in line.split(",")]
        for line in (tracker_folder / "viscosity" / f"{export}.txt").read_text().splitlines()[2:]
    ]
    t, y = np.array(rows).T
    assert track.name == "mass A"
    assert track.t.size == t.size
    np.testing.assert_allclose(track.t, t, atol=5.1e-7, rtol=0)
    np.testing.assert_allclose(track.y, y, atol=1.001 * digits, rtol=0)
    assert track.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert not np.allclose(-track.y, y, atol=100 * digits)  # the axis points up, and that is seen


@pytest.mark.parametrize("video", EXPORTS)
def test_stand_ins_are_read_as_they_were_made(stand_ins: Path, write, video: str) -> None:
    """To the rounding of pixels, 1e-13 of some 500; also from an archive."""
    text = (stand_ins / "viscosity" / f"{video}.trk").read_text()
    for track in (
        read_tracker(stand_ins / "viscosity" / f"{video}.trk"),
        read_tracker(write(stored(text), "a.trz")),
    ):
        for found, made in zip((track.t, track.x, track.y), TRUTH[video], strict=True):
            np.testing.assert_allclose(found, made, atol=1e-12, rtol=0)
        assert track.frames.tolist() == list(range(START, START + track.t.size))
        assert track.warnings == ()


def test_wrong_scale_is_reproduced_and_the_stick_that_made_it_is_shown(
    tracker_folder: Path,
) -> None:
    wrong, right = (
        read_tracker(tracker_folder / "viscosity" / f"{name}.trk")
        for name in ("CIMG9892", "CIMG9886")
    )
    assert 9.0 < np.ptp(wrong.y) / np.ptp(right.y) < 11.0
    assert any("calibration stick A: 1 for" in fact for fact in wrong.calibration)
    assert any("calibration stick A: 0.1 for" in fact for fact in right.calibration)


def test_lines_of_the_file_go_with_the_points(tracker_folder: Path) -> None:
    path = tracker_folder / "viscosity" / "CIMG9886.trk"
    track = read_tracker(path)
    lines = path.read_text().splitlines()
    assert all("PointMass$FrameData" in lines[n - 1] for n in track.lines)
    assert track.frames[0] == START


def test_files_with_other_kinds_of_tracks_say_what_they_hold(tracker_folder: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"asinewave.trk: 'tracks' must hold a point mass .* axes \(CoordAxes\), model A "
        r"\(DynamicParticle\)",
    ):
        read_tracker(tracker_folder / "osp" / "asinewave.trk")
    path = tracker_folder / "osp" / "protractor.trk"
    with pytest.raises(InputError, match=r"several \(mass A, mass B\)"):
        read_tracker(path)
    with pytest.raises(
        InputError,
        match=r"has no marked positions to read \(it is a Protractor; point masses: mass A, mass "
        r"B\): protractor A",
    ):
        read_tracker(path, track="protractor A")
    with pytest.raises(
        InputError, match=r"is not in the file \(point masses: mass A, mass B\): disk"
    ):
        read_tracker(path, track="disk")
    with pytest.raises(InputError, match="'track mass B' must hold at least 5 points: 1"):
        read_tracker(path, track="mass B")


# small files, by hand


def test_level_axes(write) -> None:
    track = read_tracker(write(trk(point_mass("A", LINE))))
    np.testing.assert_allclose(track.t, 0.04 * np.arange(8), atol=1e-15)
    np.testing.assert_allclose(track.x, 0.1 * np.arange(8), atol=1e-15)
    np.testing.assert_allclose(track.y, 0.04 * np.arange(8), atol=1e-15)
    assert track.frames.tolist() == list(range(8))
    assert track.warnings == ()


def test_axes_turned_by_30_degrees(write) -> None:
    """Points on the turned x axis: they rise to the right on the screen and have y = 0."""
    along = {
        n: (100.0 + 50.0 * 0.1 * n * math.sqrt(3) / 2, 200.0 - 50.0 * 0.1 * n / 2) for n in range(6)
    }
    track = read_tracker(
        write(trk(point_mass("A", along), axes={0: (100.0, 200.0, 30.0, 50.0, 50.0)}))
    )
    np.testing.assert_allclose(track.x, 0.1 * np.arange(6), atol=1e-12)
    np.testing.assert_allclose(track.y, 0.0, atol=1e-12)
    other = read_tracker(
        write(trk(point_mass("A", along), axes={0: (100.0, 200.0, -30.0, 50.0, 50.0)}))
    )
    assert np.max(np.abs(other.y)) > 0.1  # the sense of the turn matters


def test_scale_comes_before_rotation_where_the_two_scales_differ(write) -> None:
    """Turned by 90 degrees: x counts up the screen with the vertical scale, y counts leftward with
    the horizontal one.
    """
    points = {n: (100.0 - 40.0 * n, 200.0 - 10.0 * n) for n in range(5)}
    track = read_tracker(
        write(trk(point_mass("A", points), axes={0: (100.0, 200.0, 90.0, 80.0, 50.0)}))
    )
    np.testing.assert_allclose(track.x, 0.2 * np.arange(5), atol=1e-12)
    np.testing.assert_allclose(track.y, 0.5 * np.arange(5), atol=1e-12)


def test_a_key_frame_of_the_axes_holds_until_the_next(write) -> None:
    axes = {
        0: (100.0, 200.0, 0.0, 50.0, 50.0),
        3: (110.0, 190.0, 0.0, 50.0, 50.0),
        5: (110.0, 190.0, 0.0, 100.0, 100.0),
    }
    track = read_tracker(
        write(trk(point_mass("A", dict.fromkeys(range(7), (150.0, 150.0))), axes=axes))
    )
    np.testing.assert_allclose(track.x, [1.0, 1.0, 1.0, 0.8, 0.8, 0.4, 0.4])
    np.testing.assert_allclose(track.y, [1.0, 1.0, 1.0, 0.8, 0.8, 0.4, 0.4])
    assert any("2 later changes" in fact for fact in track.calibration)


def test_start_frame_step_size_and_missing_steps(write) -> None:
    """Frames 4, 6, 8, ... are steps 0, 1, 2, ...; step 2 is missing, frame 5 and those outside the
    clip do not count.
    """
    points = {n: (100.0 + n, 200.0) for n in (0, 2, 4, 5, 6, 10, 12, 14, 16, 18)}
    track = read_tracker(
        write(trk(point_mass("A", points), start=4, step=2, count=7, delta_t=10.0))
    )
    assert track.frames.tolist() == [4, 6, 10, 12, 14, 16]
    np.testing.assert_allclose(track.t, [0.0, 0.02, 0.06, 0.08, 0.10, 0.12], atol=1e-15)
    assert "4 points outside the clip were excluded" in track.calibration


def test_start_time_of_the_clip_is_added(write) -> None:
    assert read_tracker(write(trk(point_mass("A", LINE), start_time=500.0))).t[0] == 0.5


def test_one_of_several_tracks_by_name(write) -> None:
    path = write(
        trk(
            point_mass("A", LINE),
            point_mass("disk  B", {n: (u + 50.0, w) for n, (u, w) in LINE.items()}),
        )
    )
    np.testing.assert_allclose(
        read_tracker(path, track="disk B").x - read_tracker(path, track="A").x, 1.0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("said", "stated", "factor"),
    [("cm", None, 0.01), ("m", "cm", 0.01), ("", None, 1.0), ("inch", "mm", 0.001)],
)
def test_unit_of_length_is_the_files_unless_the_user_states_it(
    write, said: str, stated: str | None, factor: float
) -> None:
    track = read_tracker(write(trk(point_mass("A", LINE), unit=said)), unit=stated)
    np.testing.assert_allclose(track.x, factor * 0.1 * np.arange(8), atol=1e-15)


@pytest.mark.parametrize("name", ["clip.trk", "../../../etc/clip.trk", "/clip.TRK"])
def test_trz_is_read_in_memory_whatever_its_members_are_called(write, tmp_path, name: str) -> None:
    text = trk(point_mass("A", LINE))
    data = stored(text, name=name)
    track = read_tracker(write(data, "a.trz"))
    assert np.array_equal(track.x, read_tracker(write(text)).x)
    assert track.sha256 == hashlib.sha256(data).hexdigest()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.trk", "a.trz"]


def start_times(times: list[float]) -> str:
    listed = prop(
        "start_times", prop("array", "{" + ",".join(map(str, times)) + "}", "string"), "array"
    )
    return prop("video", thing("x.XuggleVideo", listed), "object")


def test_unequal_frames_of_the_video_are_used_and_said(write) -> None:
    times = [0.0, 40.0, 80.0, 125.0, 160.0, 200.0, 240.0, 280.0]
    track = read_tracker(write(trk(point_mass("A", LINE), video=start_times(times), count=8)))
    np.testing.assert_allclose(track.t, np.array(times) / 1e3, atol=1e-12)
    assert any("not equally spaced" in warning for warning in track.warnings)
    rounded = [round(1000.0 / 30.0 * n, 3) for n in range(8)]
    even = read_tracker(
        write(trk(point_mass("A", LINE), video=start_times(rounded), count=8, delta_t=1000 / 30))
    )
    np.testing.assert_allclose(even.t, np.arange(8) / 30.0, atol=1e-15)
    assert even.warnings == ()


def test_frame_duration_against_the_video_is_refused_until_it_is_stated(write) -> None:
    path = write(
        trk(point_mass("A", LINE), video=start_times([10.0 * n for n in range(8)]), count=8)
    )
    with pytest.raises(
        InputError,
        match=r"a.trk:\d+: 'delta_t' contradicts the video, whose frames last 10 ms; "
        r".*frame_ms\): 40",
    ):
        read_tracker(path)
    np.testing.assert_allclose(read_tracker(path, frame_ms=10.0).t, 0.01 * np.arange(8), atol=1e-15)
    slow = read_tracker(path, frame_ms=2.5)
    np.testing.assert_allclose(slow.t, 0.0025 * np.arange(8), atol=1e-15)
    assert any(
        "as stated by the user; according to the file it is 40 ms" in fact
        for fact in slow.calibration
    )


def test_uncalibrated_video_and_edited_stick_are_suspicious(write) -> None:
    flat = read_tracker(write(trk(point_mass("A", LINE), axes={0: (0.0, 0.0, 0.0, 1.0, 1.0)})))
    assert any("not calibrated" in warning for warning in flat.warnings)
    ends = thing(
        "x.FrameData",
        *(
            prop(name, value)
            for name, value in (("x1", 0.0), ("y1", 0.0), ("x2", 30.0), ("y2", 40.0))
        ),
    )
    lengths = prop("worldlengths", prop("[0]", 0.1), "array")
    stick = thing(
        "x.TapeMeasure",
        prop("name", "stick", "string"),
        prop("stickmode", "true", "boolean"),
        array("framedata", {0: ends}),
        lengths,
    )
    track = read_tracker(write(trk(point_mass("A", LINE), stick)))
    assert "the length of stick is 1 on the scale of the axes, but 0.1 was stated" in track.warnings


@pytest.mark.parametrize("declared", [True, False])
def test_latin_letters_under_a_declaration_of_utf8_are_read(tmp_path: Path, declared: bool) -> None:
    text = trk(point_mass("B\xe4r", LINE))
    (tmp_path / "a.trk").write_bytes(
        (text if declared else text.partition("?>\n")[2]).encode("latin-1")
    )
    plain = tmp_path / "b.trk"
    plain.write_text(text, encoding="utf-8")
    latin, utf8 = read_tracker(tmp_path / "a.trk"), read_tracker(plain)
    assert latin.name == utf8.name == "B\xe4r"
    np.testing.assert_array_equal(latin.x, utf8.x)


# refused

GOOD = trk(point_mass("A", LINE))
DOCTYPE = (
    '<?xml version="1.0"?>\n<!DOCTYPE object [<!ENTITY a "ha"><!ENTITY b '
    '"&a;&a;&a;&a;&a;&a;&a;&a;">]>\n'
)
REFUSED = {
    "empty": ("", "a.trk: must not be empty: its size is 0"),
    "blank": ("\n", "is not a whole XML text (no element found)"),
    "truncated": (GOOD[: GOOD.index("</property>")], "is not a whole XML text (no element found)"),
    "text": ("t,x\n0,1\n", "a.trk:1: 'XML' is not a whole XML text"),
    "another program's": (
        "<html></html>",
        "a.trk:1: 'XML' must hold nothing but <object> and <property>, as Tracker writes it: html",
    ),
    "another object": (
        thing("x.DataTool"),
        "a.trk:1: 'object' must be the TrackerPanel of a .trk file: x.DataTool",
    ),
    "billion laughs": (
        DOCTYPE + GOOD.split("?>\n")[1].replace(">A<", ">&b;<"),
        "a.trk:2: 'XML' must not hold a document type or entities",
    ),
    "external entity": (
        '<!DOCTYPE object SYSTEM "file:///etc/passwd"><object/>',
        "a.trk:1: 'XML' must not hold a document type or entities",
    ),
    "unknown entity": (
        GOOD.replace(">A<", ">&secret;<"),
        "is not a whole XML text (undefined entity)",
    ),
    "deep": ("<object>" * 200 + "</object>" * 200, "'XML' must be nested at most 100 deep"),
    "many elements": (
        "<object>" + "<property/>" * 500_000 + "</object>",
        "'XML' must hold at most 300000 elements",
    ),
    "neither UTF-8 nor Latin": (
        GOOD.replace(">A<", ">B\xe4\x81r<").encode("latin-1"),
        "'byte' must be UTF-8 text (this may be Latin-1 or",
    ),
    "no number": (GOOD.replace(">110.0<", ">NaN<"), "'x' must be a number within ±1e+09: NaN"),
    "infinite": (GOOD.replace(">110.0<", ">1e999<"), "'x' must be a number within ±1e+09: 1e999"),
    "underscore": (GOOD.replace(">110.0<", ">1_1<"), "'x' must be a number within ±1e+09: 1_1"),
    "no scale": (
        trk(point_mass("A", LINE), axes={0: (0.0, 0.0, 0.0, 0.0, 1.0)}),
        "'xscale' must be > 0: 0.0",
    ),
    "late axes": (
        trk(point_mass("A", LINE), axes={2: (0.0, 0.0, 0.0, 1.0, 1.0)}),
        "'framedata' must begin at frame 0",
    ),
    "no duration": (trk(point_mass("A", LINE), delta_t=0.0), "'delta_t' must be > 0: 0.0"),
    "no step": (trk(point_mass("A", LINE), step=0), "'stepsize' must be >= 1"),
    "no clip": (GOOD.replace('"videoclip"', '"video_clip"'), "a.trk:2: 'videoclip' is missing"),
    "half a frame": (
        trk(point_mass("A", LINE)).replace('"int">100<', '"int">1.5<'),
        "'stepcount' must be a whole number: 1.5",
    ),
    "unit": (
        trk(point_mass("A", LINE), unit="inch"),
        "'length_unit' must be one of m, cm, mm; say which holds by --unit",
    ),
    "few points": (
        trk(point_mass("A", dict(list(LINE.items())[:4]))),
        "a.trk: 'track A' must hold at least 5 points: 4",
    ),
    "same names": (
        trk(point_mass("A", LINE), point_mass("A", LINE)),
        "must be named, as there are several (A, A)",
    ),
    "moving axes": (
        trk(point_mass("A", LINE), extra=prop("referenceframe", "A", "string")),
        "'referenceframe' must be at rest",
    ),
    "old points": (
        GOOD.replace('name="[3]"', 'name="three"'),
        "'three' must be an object with an index like [0]",
    ),
    "no tracks": (
        trk(),
        "'tracks' must hold a point mass with marked positions (it holds no track at all)",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_track_is_refused_in_one_line(write, case: str) -> None:
    text, message = REFUSED[case]
    with pytest.raises(InputError) as caught:
        read_tracker(write(text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def bomb() -> bytes:
    return stored("<object>" + " " * 50_000_000 + "</object>")


ARCHIVES = {
    "not an archive": (lambda: b"no", "a.trz: cannot be read as an archive (it has no end)"),
    "no trk": (
        lambda: stored(GOOD, name="notes.txt"),
        "a.trz: 'archive' must hold a .trk (it holds none)",
    ),
    "truncated": (lambda: stored(GOOD)[:-30], "a.trz: cannot be read as an archive"),
    "damaged": (
        lambda: stored(GOOD).replace(b"PK\x03\x04", b"PK\x03\x05"),
        "a.trz: cannot be read as an archive",
    ),
    "bomb": (bomb, "when it is unpacked: clip.trk"),
    "rare compression": (
        lambda: stored(GOOD, how=zipfile.ZIP_LZMA),
        "must have no password, and be compressed in the ordinary way",
    ),
}


@pytest.mark.parametrize("case", ARCHIVES)
def test_archive_that_holds_no_track_is_refused_in_one_line(write, case: str) -> None:
    make, message = ARCHIVES[case]
    with pytest.raises(InputError) as caught:
        read_tracker(write(make(), "a.trz"))
    assert message in str(caught.value)


@pytest.mark.parametrize(("count", "more"), [(2, ""), (20, ""), (23, " and 3 more")])
def test_archive_with_several_trk_lists_them(write, count: int, more: str) -> None:
    """Whole names, and their number where there are too many for a line."""
    names = [f"measurement of the {n}th of May.trk" for n in range(count)]
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in (*names, "__MACOSX/._a.trk"):
            archive.writestr(name, GOOD)
    with pytest.raises(
        InputError,
        match=r"'track' must say which of several .trk: .* \(it holds "
        rf"{', '.join(names[:20])}{more}\)$",
    ):
        read_tracker(write(stream.getvalue(), "a.trz"))


def test_one_of_several_trk_in_an_archive_is_read_by_its_name(write) -> None:
    stream, two = (
        io.BytesIO(),
        trk(
            point_mass("A", LINE),
            point_mass("B", {frame: (x, y + 9.0) for frame, (x, y) in LINE.items()}),
        ),
    )
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("first.trk", GOOD)
        archive.writestr("day 2/second.trk", two)
    path = write(stream.getvalue(), "a.trz")
    first = read_tracker(path, track="first.trk")
    assert first.name == "A"
    np.testing.assert_array_equal(first.x, read_tracker(write(GOOD), track="A").x)
    second = read_tracker(path, track="day 2/second.trk/B")
    np.testing.assert_array_equal(second.y, read_tracker(write(two), track="B").y)
    with pytest.raises(InputError, match="'track' must be named, as there are several"):
        read_tracker(path, track="day 2/second.trk")
    with pytest.raises(InputError, match=r"'track' must say which of several \.trk"):
        read_tracker(path, track="third.trk")
