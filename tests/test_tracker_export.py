"""Text exports of Tracker: every dialect gives the same numbers; what another program has done to a
file is refused.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from stand_ins import TRUTH

from estim import InputError
from estim.reading.table import numbered_lines
from estim.reading.tracker.export import head_of_export, read_export

ROWS = [
    (0.0, 0.10, 0.50, None),
    (0.04, 0.11, 0.52, 0.60),
    (0.08, 0.13, 0.55, 0.75),
    (0.12, 0.16, 0.57, 0.62),
    (0.16, 0.18, 0.60, None),
]


def text(
    mark: str = "\t",
    *,
    comma: bool = False,
    head: str | None = "mass A",
    names: str = "t x y v",
    end: str = "\n",
    rows=ROWS,
    form: str = "{:.3E}",
) -> str:
    def cell(value: float | None) -> str:
        shown = "" if value is None else form.format(value)
        return shown.replace(".", ",") if comma else shown

    lines = ([head] if head is not None else []) + [mark.join(names.split())]
    return end.join([*lines, *(mark.join(map(cell, row)) for row in rows), ""])


@pytest.fixture
def write(tmp_path):
    def write(content: str | bytes, name: str = "a.txt") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def check(track, rows=ROWS) -> None:
    np.testing.assert_allclose(track.t, [r[0] for r in rows], atol=1e-12)
    np.testing.assert_allclose(track.x, [r[1] for r in rows], atol=1e-12)
    np.testing.assert_allclose(track.y, [r[2] for r in rows], atol=1e-12)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("mark", "comma"),
    [
        ("\t", False),
        ("\t", True),
        (";", False),
        (";", True),
        (",", False),
        ("|", True),
        ("; ", True),
    ],
)
def test_separators_decimal_marks_and_line_ends(write, mark: str, comma: bool, end: str) -> None:
    track = read_export(write(text(mark, comma=comma, end=end)))
    check(track)
    assert track.name == "mass A"
    assert track.lines.tolist() == [3, 4, 5, 6, 7]
    assert np.isnan(track.speed[[0, 4]]).all()
    assert track.speed[1] == 0.6


@pytest.mark.parametrize("mark", [" ", "   "])
@pytest.mark.parametrize("comma", [False, True])
def test_blanks_separate_where_no_cell_is_blank(write, mark: str, comma: bool) -> None:
    check(
        read_export(write(text(mark, comma=comma, names="t x y", rows=[row[:3] for row in ROWS])))
    )


@pytest.mark.parametrize("head", ["mass A", "mass A;;;", ";mass A;", "  mass   A"])
def test_line_of_the_tracks_name_in_any_form(write, head: str) -> None:
    assert read_export(write(text(";", head=head))).name == "mass A"


def test_without_a_line_of_names_the_track_has_no_name_and_takes_the_one_asked_for(write) -> None:
    path = write(text(",", head=None))
    check(read_export(path))
    assert read_export(path).name == "unnamed"
    assert read_export(path, track="disk").name == "disk"


def test_byte_order_mark_and_comments(write) -> None:
    check(read_export(write(b"\xef\xbb\xbf" + b"# from the lab\n" + text().encode())))


def test_commas_at_the_ends_of_lines(write) -> None:
    """Tracker ends the line of names with a separator and drops blank cells at the end of a row."""
    lines = text(",", head=",mass A,,").splitlines()
    lines[1] += ","
    lines[2] = lines[2].rstrip(",")
    check(read_export(write("\n".join(lines))))


def test_columns_in_any_order_and_unknown_ones_between(write) -> None:
    rows = [(v, y, 7.0, t, x, float(n)) for n, (t, x, y, v) in enumerate(ROWS, start=20)]
    track = read_export(write(text(";", names="v y θ t x frame", rows=rows)))
    check(track)
    assert track.frames.tolist() == [20, 21, 22, 23, 24]


def test_two_tracks_beside_each_other(write) -> None:
    rows = [(t, x, y, 2 * x, 2 * y) for t, x, y, _ in ROWS]
    path = write(text(",", head=",A,,B,", names="t x y x y", rows=rows))
    check(read_export(path, track="A"))
    check(read_export(path, track="B"), [(t, 2 * x, 2 * y) for t, x, y, _ in ROWS])
    with pytest.raises(
        InputError, match=r"a.txt:2: 'track' must be named, as there are several \(A, B\)"
    ):
        read_export(path)
    with pytest.raises(
        InputError, match=r"a.txt:2: 'track' must name one of the tracks \(A, B\): C"
    ):
        read_export(path, track="C")


def test_a_row_without_a_position_or_a_time_is_left_out_and_told(write) -> None:
    rows = [*ROWS[:2], (0.06, None, None, None), *ROWS[2:], (None, 0.2, 0.6, None)]
    track = read_export(write(text(";", rows=rows).replace("6.000E-02;;", "6.000E-02;NaN;")))
    check(track)
    assert track.calibration[1:] == (
        "1 row without a value of 'x' was excluded (line 5)",
        "1 row without a value of 't' was excluded (line 9)",
    )


def test_one_coordinate_is_enough(write) -> None:
    track = read_export(write(text(",", names="t y", rows=[(t, y) for t, _, y, _ in ROWS])))
    assert track.x is None
    np.testing.assert_allclose(track.y, [row[2] for row in ROWS])


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ("t(s) x(cm) y(cm) v(cm/s)", None),
        ("t x[cm] y[cm] v", None),
        ("t(ms) x(cm) y v", "cm"),
        ("t x y v", "cm"),
    ],
)
def test_centimetres_by_the_columns_names_or_as_stated(write, names: str, unit: str | None) -> None:
    second = 1e3 if "ms" in names else 1.0
    rows = [(second * t, 100 * x, 100 * y, v) for t, x, y, v in ROWS]
    check(read_export(write(text(";", names=names, rows=rows)), unit=unit))


def test_contradicting_units_are_refused(write) -> None:
    with pytest.raises(
        InputError, match=r"a.txt:2: 'x, y' must all have one unit; --unit says cm: m"
    ):
        read_export(write(text(names="t x(m) y v")), unit="cm")
    with pytest.raises(InputError, match=r"a.txt:2: 'x, y' must all have one unit: cm, m"):
        read_export(write(text(names="t x(m) y(cm) v")))
    with pytest.raises(InputError, match=r"a.txt:2: 'x' must be in one of m, cm, mm: px"):
        read_export(write(text(names="t x(px) y v")))


@pytest.mark.parametrize("mark", ["\t", ";", ",", " "])
def test_an_export_is_told_from_a_table_of_the_project(mark: str) -> None:
    assert head_of_export(text(mark))
    assert not head_of_export(mark.join(["t_s", "x_m"]) + "\n")
    assert not head_of_export(f"# t{mark}x\n" + mark.join(["t_s", "x_m"]) + "\n")


# refused

MIXED = text(";", comma=True).replace("1,200E-01", "0.12")
NO_NAMES = (
    "a.txt:1: 'header' must have a line of column names with t and x or y, as Tracker exports it "
    "(where a spreadsheet has changed it: export it again); any table may be fit (estim fit FILE "
    "--columns t,x,y), or named in a campaign as it is"
)
REFUSED = {
    "empty": ("", "a.txt: must not be empty: its size is 0"),
    "blank": ("\n# t,x\n", f"{NO_NAMES}: nothing".replace(":1:", ":")),
    "no names but 0.0": ("0.0\t0.1\n0.1\t0.2\n", f"{NO_NAMES}: 0.0"),
    "names of columns above those of Logger Pro": (
        "Position\tTime\nx\tt\n0.1\t0.2\n",
        "a.txt:1: 'header' must have a line of column names",
    ),
    "no names but 12.5": ("12.5;0.1\n", "a.txt:1: 'header' must have a line of column names"),
    "begins with a date": ("2019-02-17;0.1\n", f"{NO_NAMES}: 2019-02-17;0.1"),
    "maybe decimal commas": (
        "t,x,n,m\n" + "".join(f"{n},5,1,2\n" for n in range(6)),
        "or write one number with a decimal point, as 0.0: 0,5,1,2",
    ),
    "no names": ("1;2;3\n", f"{NO_NAMES}: 1;2;3"),
    "estim's own": ("t_s,x_m\n0,1\n", f"{NO_NAMES}: t_s,x_m"),
    "only v": (
        text(names="t v a b"),
        "a.txt:1: 'header' must have a line of column names with t and x or y",
    ),
    "two x": (text(names="t x x v"), "a.txt:2: 'x' occurs twice in the header"),
    "mixed decimals": (
        MIXED,
        "a.txt:6: 't' must be a number (as 1234,5 or 2e3; a time as 13:05:00): 0.12",
    ),
    "mixed decimals in the speeds alone": (
        text().replace("7.500E-01", "7,500E-01"),
        "a.txt:5: 'v' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 7,500E-01",
    ),
    "nothing below the names": ("t,x,a\n", "a.txt: 'track unnamed' must hold at least 5 points: 0"),
    "decimal commas between commas": (
        text(",", comma=True),
        "(decimal commas? write decimal points, or separate the cells by semicolons): 0,000E+00",
    ),
    "a date": (
        text(";").replace("8.000E-02;", "12.mai;"),
        "a.txt:5: 't' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 12.mai",
    ),
    "another date": (
        text(";").replace("8.000E-02;", "2019-02-17;"),
        "a.txt:5: 't' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 2019-02-17",
    ),
    "word": (text().replace("1.300E-01", "far"), "a.txt:5: 'x' must be a number: far"),
    "underscore": (
        text().replace("1.300E-01", "1_3"),
        "a.txt:5: 'x' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 1_3",
    ),
    "thousands": (
        text().replace("1.300E-01", "1,300.5"),
        "a.txt:5: 'x' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 1,300.5",
    ),
    "no positions": (
        text(rows=[(t, None, None, v) for t, _, _, v in ROWS]),
        "a.txt: 'track mass A' must hold at least 5 points: 0",
    ),
    "far": (
        text().replace("1.300E-01", "-1.1e6"),
        "a.txt:5: 'x' must lie within ±1e+06 m: -1100000.0",
    ),
    "far in y": (text(names="y t x v").replace("4.000E-02", "1e7"), "'y' must lie within ±1e+06 m"),
    "late": (
        text().replace("1.600E-01", "1.6e6"),
        "a.txt:7: 't' must lie within ±1e+06 s: 1600000.0",
    ),
    "infinite": (text().replace("1.300E-01", "1e999"), "a.txt:5: 'x' must be finite: 1e999"),
    "too many cells": (
        text(";").replace(";7.500E-01", ";7.500E-01;1"),
        "a.txt:5: 'row' must have 4 cells, not 5: ",
    ),
    "backward": (
        text(rows=[*ROWS[:3], ROWS[1], *ROWS[3:]]),
        "a.txt:6: 't' must increase from row to row: 0.04",
    ),
    "repeated": (
        text(rows=[*ROWS[:3], ROWS[2], *ROWS[3:]]),
        "a.txt:6: 't' must increase from row to row (1 row repeats its time; if it is a copy",
    ),
    "few": (text(rows=ROWS[:4]), "a.txt: 'track mass A' must hold at least 5 points: 4"),
    "long line": (
        "t;x\n" + "1" * 200_000,
        "a.txt:2: 'row' must have at most 100000 characters: 200000",
    ),
    "binary": (b"\x00\x01\xff\xfe", "a.txt:1: 'text' must not hold a null character"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_export_is_refused_in_one_line(write, case: str) -> None:
    content, message = REFUSED[case]
    with pytest.raises(InputError) as caught:
        read_export(write(content))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_copies_of_a_row_are_dropped_only_when_asked_and_only_if_they_are_copies(write) -> None:
    copy, other = ROWS[2], (0.08, 0.131, 0.55, 0.75)
    path = write(text(rows=[*ROWS[:3], copy, *ROWS[3:]]))
    track = read_export(path, drop_duplicates=True)
    check(track)
    assert track.lines.tolist() == [3, 4, 5, 7, 8]
    assert track.warnings == ("1 row that copies the previous one was dropped",)
    with pytest.raises(InputError, match="must increase"):
        read_export(
            write(text(rows=[*ROWS[:3], other, *ROWS[3:]], form="{:.4f}")), drop_duplicates=True
        )


@pytest.mark.parametrize(
    ("row", "copy", "dropped"),
    [
        ("0\t0\t2", "0.0\t0\t2.", True),
        ("0\t0\t2", "0\t-0.0\t2e0\t", True),
        ("0\t0\t2\t1", "0\t0\t2\t1.0", True),
        ("0\t0\t2\t1", "0\t0\t2\t1.5", False),
        ("0\t0\t2\t1", "0\t0\t2", False),
        ("0\t0\t2\t\t7", "0\t0\t2\t\t7.0\tpushed", True),
        ("0\t0\t2\t\t7", "0\t0\t2\t\t8", False),
    ],
)
def test_a_copy_has_the_numbers_of_the_row_before_however_written(
    write, row: str, copy: str, dropped: bool
) -> None:
    rows = [row, copy, *(f"{n}\t{n}\t2" for n in range(1, 5))]
    path = write("\n".join(["t\tx\ty\tv\tframe\tnote", *rows]))
    if dropped:
        track = read_export(path, drop_duplicates=True)
        assert track.t.tolist() == [0, 1, 2, 3, 4]
        assert track.lines.tolist() == [2, 4, 5, 6, 7]
        assert track.warnings == ("1 row that copies the previous one was dropped",)
    else:
        with pytest.raises(InputError, match=r"a\.txt:3: 't' must increase"):
            read_export(path, drop_duplicates=True)


def test_another_track_has_no_part_in_copies_and_decimal_marks(write) -> None:
    """A comma before three digits is a decimal comma too: Tracker parts no thousands."""
    rows = [f"{n};{n},125;{n / 10};far" for n in range(6)]
    path = write("\n".join([";A;B;", "t;x;x;y", *rows[:3], "2,0;2,125;9.9;", *rows[3:]]))
    track = read_export(path, track="A", drop_duplicates=True)
    assert track.x.tolist() == [n + 0.125 for n in range(6)]
    assert track.lines.tolist() == [3, 4, 5, 7, 8, 9]


def test_speeds_of_some_rows_are_read_as_the_whole_table_is(write) -> None:
    """Of the rows with a speed all cells are whole, as if commas were decimal ones."""
    rows = ["0.5,1,,8", "1,2,1,8", "2,3,1,8", "3,4,1,8", "4,5,,8"]
    track = read_export(write("\n".join(["t,x,v,a", *rows])))
    assert track.t.tolist() == [0.5, 1, 2, 3, 4]
    np.testing.assert_array_equal(track.speed, [np.nan, 1, 1, 1, np.nan])


# recordings: stand-ins, and real files where they are present


def numbers(path: Path, columns: int, skip: int) -> np.ndarray:
    """The first `columns` numbers of each row, read by a regular expression of its own."""
    import re

    lines = path.read_text().replace(",", ".").replace("\t", ";").splitlines()[skip:]
    return np.array(
        [[float(cell) for cell in re.split(";", line)[:columns]] for line in lines if line.strip()]
    )


@pytest.mark.parametrize(
    ("file", "name", "skip"),
    [
        ("halfpipe/Klipp0.csv", "mass_A", 2),
        ("halfpipe/Klipp1.csv", "mass_A", 2),
        ("rolling_ball/kulefullbane.txt", "kule", 2),
        ("rolling_ball/ringfullbane.txt", "ring", 2),
    ],
)
def test_semicolons_with_decimal_commas(
    tracker_folder: Path, file: str, name: str, skip: int
) -> None:
    unit = "cm" if "bane" in file else "m"
    track = read_export(tracker_folder / file, unit=unit)
    rows = numbers(tracker_folder / file, 3, skip)
    assert track.name == name
    np.testing.assert_array_equal(track.t, rows[:, 0])
    np.testing.assert_array_equal(track.x, rows[:, 1] * (0.01 if unit == "cm" else 1.0))
    np.testing.assert_array_equal(track.y, rows[:, 2] * (0.01 if unit == "cm" else 1.0))


def test_commas_without_a_line_of_names(tracker_folder: Path) -> None:
    track = read_export(tracker_folder / "rolling_ball" / "Vid3.txt")
    rows = [
        line.split(",")
        for line in (tracker_folder / "rolling_ball" / "Vid3.txt").read_text().splitlines()[1:]
    ]
    assert track.x.tolist() == [float(row[1]) for row in rows]
    assert np.isnan(track.speed[0])


def test_one_copied_row_between_tabs(tracker_folder: Path) -> None:
    path = tracker_folder / "halfpipe" / "52.txt"
    with pytest.raises(
        InputError,
        match=r"52.txt:4: 't' must increase from row to row \(1 row repeats its time; if it is a "
        r"copy",
    ):
        read_export(path)
    track = read_export(path, drop_duplicates=True)
    assert track.t.size == len(path.read_text().splitlines()) - 3


SPOILED = {
    "halfpipe/Klipp34.csv": r"Klipp34.csv:1004: 't' must increase from row to row \(ALL rows "
    r"repeat their time: rounded by a spreadsheet\?\): 10.0",
    "halfpipe/Klipp5.csv": r"Klipp5.csv:1: 'header' must have a line of column names .*"
    r"spreadsheet has changed it.*: 43513,00;0\.1",
    "rolling_ball/Kule4.txt": r"Kule4.txt: 'track Kule4' must hold at least 5 points: 3$",
}


@pytest.mark.parametrize("file", SPOILED)
def test_spoiled_files_are_refused_with_the_place(tracker_folder: Path, file: str) -> None:
    times = [line.split(";")[0] for line in (tracker_folder / file).read_text().splitlines()]
    repeated = sum(a == b for a, b in itertools.pairwise(times))  # 2794 of the real one
    with pytest.raises(InputError, match=SPOILED[file].replace("ALL", str(repeated))):
        read_export(tracker_folder / file)


SOUND = {
    "viscosity/a1.txt": 6,
    "viscosity/a2.txt": 6,
    "viscosity/b3.txt": 6,
    "halfpipe/Klipp0.csv": 9,
    "halfpipe/Klipp1.csv": 9,
    "halfpipe/52.txt": 15,
    "rolling_ball/kulefullbane.txt": 9,
    "rolling_ball/ringfullbane.txt": 9,
    "rolling_ball/Vid3.txt": 6,
}


@pytest.mark.parametrize("file", SOUND)
def test_stand_ins_are_read_as_they_were_made(stand_ins: Path, file: str) -> None:
    """To half a unit of the last of so many decimals of the mantissa, which is at least 1."""
    track = read_export(
        stand_ins / file,
        unit="cm" if "bane" in file else "m",
        drop_duplicates=file.endswith("52.txt"),
    )
    t, x, y = TRUTH[Path(file).stem]
    np.testing.assert_allclose(track.t, t, rtol=0.51 * 10.0 ** -SOUND[file], atol=1e-15)
    np.testing.assert_allclose(track.y, y, rtol=0.51 * 10.0 ** -SOUND[file], atol=1e-15)
    assert (
        track.x is None
        if "viscosity" in file
        else np.allclose(track.x, x, rtol=0.51 * 10.0 ** -SOUND[file], atol=1e-15)
    )


def test_number_of_lines_is_limited() -> None:
    with pytest.raises(InputError, match=r"'number of lines' must be at most 1000000: 1000001"):
        numbered_lines("1\n" * 1_000_001)


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "utf-16", "utf-8-sig"])
def test_an_export_may_be_in_any_encoding_that_a_table_may(encoding: str, tmp_path: Path) -> None:
    rows = "".join(f"{0.04 * i:.2f};{0.1 * i:.1f};{0.2 * i:.1f}\n" for i in range(6))
    (tmp_path / "a.txt").write_bytes(f"boule d'été\nt;x;y\n{rows}".encode(encoding))
    track = read_export(tmp_path / "a.txt")
    assert track.name == "boule d'été"
    assert track.t.size == 6
    told = "was read as Windows-1252" in " ".join(track.calibration)
    assert told == (encoding in ("latin-1", "cp1252"))
