"""Reading a run: what is accepted, every refusal with its place, and the wheel's files as the
laboratory wrote them.
"""

from __future__ import annotations

import hashlib
import os
import time
from pathlib import Path

import numpy as np
import pytest

from estim import InputError
from estim.reading.run import read_run
from estim.reading.tracker.importing import Choices

ROWS = [(0.0, 0.001), (0.1, 0.004), (0.2, 0.009), (0.3, 0.016), (0.4, 0.025), (0.5, 0.036)]


def table(header="t_s,x_m", rows=ROWS, mark=","):
    return "\n".join([header, *(mark.join(str(cell) for cell in row) for row in rows), ""])


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(content, name="a.csv"):
        path = Path(name)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


# accepted


def test_numbers_names_and_lines_come_back_unchanged(write):
    path = write(table())
    run = read_run(path, name="one")
    assert (run.name, run.file, run.n_row) == ("one", "a.csv", 6)
    assert run.columns["t_s"].tolist() == [row[0] for row in ROWS]
    assert run.columns["x_m"].tolist() == [row[1] for row in ROWS]
    assert run.lines.tolist() == [2, 3, 4, 5, 6, 7]
    assert (run.coordinate, run.rate) == ("x_m", "v_m_s")
    assert run.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_angles_are_a_coordinate_too(write):
    run = read_run(write(table("theta_rad,omega_rad_s")), name="one")
    assert (run.coordinate, run.rate) == ("theta_rad", "omega_rad_s")


@pytest.mark.parametrize("mark", [",", ";", "\t", " , ", "; "])
def test_commas_semicolons_and_tabs_separate(write, mark):
    plain = read_run(write(table()), name="one")
    run = read_run(write(table(mark.join(["t_s", "x_m"]), mark=mark)), name="one")
    assert all(np.array_equal(run.columns[c], plain.columns[c]) for c in ("t_s", "x_m"))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_any_line_ending_and_a_byte_order_mark_are_read(write, end):
    run = read_run(write(b"\xef\xbb\xbf" + table().replace("\n", end).encode()), name="one")
    assert run.columns["x_m"].tolist() == [row[1] for row in ROWS]


def test_comments_and_blank_lines_are_skipped_and_lines_still_count(write):
    lines = table().splitlines()
    text = "\n".join(
        [
            "# a run",
            "# t_s in seconds",
            "",
            lines[0],
            "",
            lines[1],
            "# in between",
            *lines[2:],
            "",
            "",
        ]
    )
    run = read_run(write(text), name="one")
    assert run.columns["x_m"].tolist() == [row[1] for row in ROWS]
    assert run.lines.tolist() == [6, 8, 9, 10, 11, 12]


def test_order_of_columns_does_not_matter(write):
    run = read_run(write(table("x_m,t_s", [row[::-1] for row in ROWS])), name="one")
    assert run.columns["t_s"].tolist() == [row[0] for row in ROWS]


def test_a_column_that_begins_with_an_underscore_is_left_unread(write):
    run = read_run(write(table("t_s,_note,x_m", [(t, "what?", x) for t, x in ROWS])), name="one")
    assert set(run.columns) == {"t_s", "x_m"}


def test_labview_header_is_understood(write):
    text = (
        "%Time (s)\tTheta (rad)\tOmega (rad/s)\n\t%2/27/201510:38 AM\n"
        + table("", [(*row, 0.1) for row in ROWS], "\t").lstrip()
    )
    run = read_run(write(text), name="one")
    assert set(run.columns) == {"t_s", "theta_rad", "omega_rad_s"}
    assert run.lines[0] == 3


def test_numbers_may_be_written_with_exponents_and_signs(write):
    run = read_run(
        write(table(rows=[(0, "-1e-3"), (1, "+2.5E-3"), (2, ".5"), (3, "6."), (4, "7")])),
        name="one",
    )
    assert run.columns["x_m"].tolist() == [-0.001, 0.0025, 0.5, 6.0, 7.0]


def test_speeds_without_times_are_a_run(write):
    run = read_run(write(table("x_m,v_m_s,sigma_v_m_s", [(0.1, 1, 0.01)] * 5)), name="one")
    assert "t_s" not in run.columns


def test_columns_cannot_be_written_to(write):
    run = read_run(write(table()), name="one")
    with pytest.raises(ValueError, match="read-only"):
        run.columns["x_m"][0] = 1.0
    with pytest.raises(TypeError):
        run.columns["x_m"] = run.columns["t_s"]


# str.splitlines ends a line at each, no editor does
MARKS = ["\u2028", "\u2029", "\x85", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e"]


@pytest.mark.parametrize("mark", MARKS, ids=map(ascii, MARKS))
@pytest.mark.parametrize("names", ["t_s,x_m", "t,x"])
def test_a_comment_ends_where_its_line_ends(write, mark, names):
    choices = None if names == "t_s,x_m" else Choices()
    plain = read_run(write(table(names), "b.csv"), name="one", choices=choices)
    for comment in (f"# weighed again{mark}0.6,99\n", f"#{mark}{names}{mark}0.6,99\n"):
        for text in (
            table(names) + comment,
            comment + table(names),
            table(names).replace("\n0.2", f"\n{comment}0.2"),
        ):
            run = read_run(write(text), name="one", choices=choices)
            assert all(
                run.columns[name].tolist() == column.tolist()
                for name, column in plain.columns.items()
            )
            assert run.lines[-1] == next(
                n for n, line in enumerate(text.split("\n"), start=1) if line.startswith("0.5,")
            )


@pytest.mark.parametrize("mark", MARKS, ids=map(ascii, MARKS))
def test_no_other_mark_ends_a_row(write, mark):
    with pytest.raises(InputError, match=r"^a\.csv:4: "):
        read_run(write(table().replace("0.2,0.009\n", f"0.2,0.009{mark}0.25,0.012\n")), name="one")


def test_a_carriage_return_alone_does_not_end_a_comment_among_other_lines(write):
    for names in ("t_s,x_m", "t,x"):
        with pytest.raises(
            InputError,
            match=r"^a\.csv:9: 'row' must not follow a comment after a carriage return alone",
        ):
            read_run(write(table(names) + "# again\r0.6,99\n"), name="one")
    assert read_run(write(table() + "# again\r\r\n"), name="one").n_row == 6


COMMAS = [
    ("t_s,x_m,_n", "0,5,1"),
    ("t_s,x_m,_n,_m", "0,5,1,2"),
    ("_n,t_s,x_m,_m", "3,0,5,1"),
    ("t_s,x_m,_n", "0,5,"),
    ("t_s,x_m,_n", "0,5,1e-3"),
]


@pytest.mark.parametrize(("names", "row"), COMMAS)
def test_cells_that_may_be_decimal_commas_are_asked_about(write, names, row):
    """ "0,5,1,2" under t, x and two columns that nobody reads: 0, 5 and two others, or 0.5 and 1.2
    with the others left blank.
    """
    at = names.split(",").index("t_s")
    rows = [[*row.split(",")[:at], str(n), *row.split(",")[at + 1 :]] for n in range(6)]
    text = "\n".join([names, *map(",".join, rows), ""])
    with pytest.raises(
        InputError,
        match=r"^a\.csv:2: 'row' may hold decimal commas: .* semicolons, or write one number with "
        r"a decimal point",
    ):
        read_run(write(text), name="one")
    first = rows[0][at]
    said = [text.replace(",", ";"), text.replace(",", "\t"), text.replace(",", ", ")]
    said += [
        "\n".join(
            [
                names,
                ",".join([*rows[0][:at], f"{first}.0", *rows[0][at + 1 :]]),
                *map(",".join, rows[1:]),
                "",
            ]
        )
    ]
    said += ["\n".join([names, *(",".join(f'"{cell}"' for cell in r) for r in rows)])]
    for plain in said:
        assert read_run(write(plain), name="one").columns["t_s"].tolist() == [
            0.0,
            1.0,
            2.0,
            3.0,
            4.0,
            5.0,
        ]


def test_whole_numbers_in_columns_that_are_all_read_are_whole_numbers(write):
    assert (
        read_run(
            write(table("t_s,x_m,sigma_x_m", [(n, n * n, 1) for n in range(6)])), name="one"
        ).columns["x_m"][5]
        == 25.0
    )
    assert (
        read_run(
            write(table("t_s,x_m,_why", [(n, n * n, "late") for n in range(6)])), name="one"
        ).columns["x_m"][5]
        == 25.0
    )


# refused


def _changed(row, cell):
    """The table with one cell of data row `row` (0 is on line 2) replaced."""
    rows = [list(r) for r in ROWS]
    rows[row][cell[0]] = cell[1]
    return table(rows=rows)


KNOWN = "t_s, x_m, v_m_s, theta_rad, omega_rad_s, sigma_x_m, sigma_v_m_s"
ONE = "a.csv:1: 'header' must hold exactly one of x_m and theta_rad: "
TIME_OR_SPEED = "a.csv:1: 'header' must hold a time (t_s) or a speed (v_m_s, omega_rad_s): "
REFUSED = {
    "empty file": ("", "a.csv: must not be empty: its size is 0"),
    "only comments": ("# nothing\n\n# here\n", "a.csv: has no rows of numbers"),
    "no header": (
        table().split("\n", 1)[1],
        "a.csv:1: 'header' has no line of column names: name all 2 from left to right",
    ),
    "unknown column": (
        table("t_s,x_cm"),
        f"a.csv:1: 'x_cm' is not a column name (known: {KNOWN}; start a name with _ to skip it)",
    ),
    "repeated column": (
        table("t_s,x_m,x_m", [(*r, 1) for r in ROWS]),
        "a.csv:1: 'x_m' occurs twice in the header",
    ),
    "both coordinates": (
        table("t_s,x_m,theta_rad", [(*r, 1) for r in ROWS]),
        ONE + "t_s, x_m, theta_rad",
    ),
    "no coordinate": (table("t_s,v_m_s"), ONE + "t_s, v_m_s"),
    "position only": (table("x_m,sigma_x_m", [(1, 1)] * 5), TIME_OR_SPEED + "x_m, sigma_x_m"),
    "word for a number": (_changed(2, (1, "far")), "a.csv:4: 'x_m' must be a number: far"),
    "decimal comma": (
        table("t_s;x_m", [(t, str(x).replace(".", ",")) for t, x in ROWS], ";"),
        "a.csv:2: 'row' has numbers with decimal points and others with commas: write them alike",
    ),
    "date for a number": (
        _changed(1, (0, "2015-02-27")),
        "a.csv:3: 't_s' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 2015-02-27",
    ),
    "underscore in a number": (
        _changed(2, (1, "1_000")),
        "a.csv:4: 'x_m' must be a number (as 1234.5 or 2e3; a time as 13:05:00): 1_000",
    ),
    "digits of another script": (
        _changed(2, (1, "\u0661\u0662")),
        "a.csv:4: 'x_m' must be a number (as 1234.5 or 2e3; a time as 13:05:00): \u0661\u0662",
    ),
    "wide digits": (
        _changed(2, (1, "\uff11.5")),
        "a.csv:4: 'x_m' must be a number (as 1234.5 or 2e3; a time as 13:05:00): \uff11.5",
    ),
    "text behind quotes": (
        _changed(2, (1, '"1"2')),
        "a.csv:4: 'row' cannot be split into cells (',' expected after '\"'): 0.2,\"1\"2",
    ),
    "blank cell": (_changed(3, (1, "")), "a.csv:5: 'x_m' must be a number: "),
    "nan": (_changed(4, (1, "nan")), "a.csv:6: 'x_m' must be a number: nan"),
    "inf": (_changed(5, (1, "-inf")), "a.csv:7: 'x_m' must be a number: -inf"),
    "too large": (_changed(0, (1, "1e999")), "a.csv:2: 'x_m' must be finite: 1e999"),
    "cell too many": (_changed(1, (1, "0.004,9")), "a.csv:3: 'row' must have 2 cells, not 3: "),
    "cell too few": (
        table().replace("0.2,0.009", "0.2"),
        "a.csv:4: 'row' must have 2 cells, not 1: 0.2",
    ),
    "time back": (_changed(3, (0, 0.15)), "a.csv:5: 't_s' must increase from row to row: 0.15"),
    "time again": (_changed(2, (0, 0.1)), "a.csv:4: 't_s' must increase from row to row: 0.1"),
    "times of a nanosecond's parts": (
        table(rows=[(1e-12 * t, x) for t, x in ROWS]),
        "a.csv:3: 't_s' must advance by at least 1e-09 s: 1e-13",
    ),
    "times beyond the age of the universe": (
        table(rows=[(1e20 * t, x) for t, x in ROWS]),
        "a.csv:3: 't_s' must lie within ±1e+10: 1e+19",
    ),
    "negative sigma": (
        table("x_m,v_m_s,sigma_v_m_s", [(1, 1, 0.1)] * 4 + [(1, 1, -0.1)]),
        "a.csv:6: 'sigma_v_m_s' must be > 0: -0.1",
    ),
    "zero sigma": (
        table("t_s,x_m,sigma_x_m", [(*r, 0) for r in ROWS]),
        "a.csv:2: 'sigma_x_m' must be > 0: 0.0",
    ),
    "too few rows": (table(rows=ROWS[:4]), "a.csv: 'rows' must hold at least 5 rows of numbers: 4"),
}


@pytest.mark.parametrize("mistake", REFUSED)
def test_refused_with_file_line_field_rule_and_value(write, mistake):
    text, told = REFUSED[mistake]
    with pytest.raises(InputError) as caught:
        read_run(write(text), name="one")
    assert str(caught.value).startswith(told)
    assert "\n" not in str(caught.value)


def test_nul_bytes_are_refused_in_words(write):
    with pytest.raises(InputError, match=r"^a\.csv:3: "):
        read_run(write(table().replace("0.004", "0.0\x0004")), name="one")


def test_an_unclosed_quote_is_refused_in_words(write):
    with pytest.raises(InputError, match=r"^a\.csv:3: "):
        read_run(write(table().replace("0.1,0.004", '"0.1,0.004')), name="one")


def test_quotes_around_whole_cells_are_read(write):
    assert (
        read_run(write(table().replace("0.1,0.004", '"0.1","0.004"')), name="one").columns["x_m"][1]
        == 0.004
    )


def test_many_digits_and_a_letter_are_refused_at_once(write):
    start = time.process_time()
    for header in ("t_s,x_m", "t,x"):
        with pytest.raises(InputError, match=r":4: 'x(_m)?' must be a number .*: 111"):
            read_run(write(table(header).replace("0.009", "1" * 90_000 + "x")), name="one")
    assert time.process_time() - start < 2.0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("name", ["a.csv", "a.txt", "a.trk"])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=r"must be a regular file, not a pipe"):
        read_run(tmp_path / name, name="one")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no such device")
def test_a_device_is_refused():
    with pytest.raises(InputError, match=r"must be a regular file"):
        read_run(Path("/dev/zero"), name="one")


def test_a_huge_cell_is_refused_in_words(write):
    with pytest.raises(InputError, match=r"^a\.csv:3: ") as caught:
        read_run(write(table().replace("0.004", "x" * 200_000)), name="one")
    assert len(str(caught.value)) < 200


def test_a_missing_file_is_named():
    with pytest.raises(
        InputError, match=r"^runs/none\.csv: cannot be read \(no such file or directory\)$"
    ):
        read_run(Path("runs/none.csv"), name="one")


def test_a_folder_is_no_run(tmp_path):
    with pytest.raises(InputError, match=r": cannot be read \(is a directory\)$"):
        read_run(tmp_path, name="one")


def test_a_file_name_with_a_null_is_refused_in_words(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_run(tmp_path / "a\0.csv", name="one")


# the wheel: a dialect with two header lines, the second with a leading tab, and the recorded angles

WHEEL = sorted(
    path.stem for path in (Path(__file__).resolve().parents[1] / "data" / "wheel").glob("*.csv")
)


def test_a_file_with_two_header_lines_and_tabs_reads_as_it_is(project, tmp_path):
    measured = read_run(project / "data" / "wheel" / "class-balanced_2.csv", name="wheel")
    pairs = zip(measured.columns["t_s"], measured.columns["theta_rad"], strict=True)
    rows = [f"{t:.4f}\t{theta:.4f}\t{0.1 * i:.4f}" for i, (t, theta) in enumerate(pairs)]
    (tmp_path / "wheel.txt").write_text(
        "\n".join(["%Time (s)\tTheta (rad)\tOmega (rad/s)", "\t%2/27/201510:35 AM", *rows]) + "\n"
    )
    run = read_run(tmp_path / "wheel.txt", name="wheel")
    assert run.n_row == len(rows)
    assert run.lines[0] == 3
    for column, name in enumerate(("t_s", "theta_rad", "omega_rad_s")):
        assert run.columns[name].tolist() == [float(row.split("\t")[column]) for row in rows]


def test_the_wheel_has_eleven_runs():
    assert len(WHEEL) == 11


@pytest.mark.parametrize("file", WHEEL)
def test_wheel_angles_are_counts_of_an_encoder_with_500_steps(project, file):
    run = read_run(project / "data" / "wheel" / f"{file}.csv", name="wheel")
    counts = run.columns["theta_rad"] * 500 / (2 * np.pi)
    assert counts == pytest.approx(np.rint(counts), abs=0.51e-4 * 500 / (2 * np.pi))
    assert np.diff(run.columns["t_s"]) == pytest.approx(np.full(run.n_row - 1, 0.1), abs=1e-9)
