"""Tables as the software of laboratories writes them: one command reads them, or says the cure."""

from __future__ import annotations

import json
import re
import sys
import zipfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_runner import runner
from messy_tables import LINE, MESSY
from workbooks import xlsx

from estim import InputError, fit_curve
from estim.cli.commands import cli
from estim.curve_fitting.tables import read_table
from estim.reading.dialect import Dialect, name_and_unit
from estim.reading.layout import read_layout
from estim.reading.named_columns import read_columns
from estim.reading.source import read_suffixes


def _needs_package(file: str) -> None:
    if file.endswith((".xlsx", ".ods")):
        pytest.importorskip("python_calamine")


@pytest.mark.slow
@pytest.mark.parametrize("name", list(MESSY))
def test_a_messy_table_is_read_by_one_command_or_refused_with_the_cure(
    name: str, tmp_path: Path
) -> None:
    messy = MESSY[name]
    _needs_package(messy.file)
    path = tmp_path / messy.file
    path.write_bytes(messy.content)
    arguments = ["fit", str(path), *LINE, *messy.options, "--figures", "none"]
    done = runner().invoke(cli, [*arguments, "--out", str(tmp_path / "out")], standalone_mode=False)
    if messy.refused:
        assert isinstance(done.exception, InputError)
        assert all(words in str(done.exception) for words in messy.refused)
        return
    assert done.exception is None, done.exception
    assert all(words in done.stdout for words in messy.told), done.stdout
    weights = None if messy.u_y is None else 1 / np.array(messy.u_y)
    b, a = np.polyfit(messy.x, messy.y, 1, w=weights)  # shares no code with the fit
    found = json.loads((tmp_path / "out" / "result.json").read_text())["parameters"]
    for key, value in (("a", a), ("b", b)):
        assert abs(found[key]["mean"] - value) < 0.1 * found[key]["sd"]
    y_unit = messy.units[1]
    assert not y_unit or found["a"]["unit"] == y_unit


def test_a_workbook_without_its_package_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    (tmp_path / "a.xlsx").write_bytes(xlsx({"A": [["t", "U"], [0, 1]]}))
    with pytest.raises(InputError, match=r'pip install "estim\[excel\]"'):
        read_table(tmp_path / "a.xlsx")


def test_python_reads_what_the_command_reads(tmp_path: Path) -> None:
    messy = MESSY["value ± uncertainty"]
    (tmp_path / messy.file).write_bytes(messy.content)
    points = read_table(tmp_path / messy.file).points("t", "U")
    np.testing.assert_array_equal(points["x"], messy.x)
    np.testing.assert_array_equal(points["y"], messy.y)
    np.testing.assert_allclose(points["u_y"], messy.u_y, rtol=1e-12)
    assert (points["axes"].x_unit, points["axes"].y_unit) == messy.units


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (["t,U", "03/05/2024,1", "04/05/2024,2", "05/05/2024,3"], "--dates dmy or mdy"),
        (["t,U", "23:59:59,1", "00:00:00,2", "00:00:01,3"], "goes back"),
        (["t;U", "0;1 V", "1;2", "2;3 V"], "must be written like the cells above it"),
        (["t,U", "0,2.1 ± 2%", "1,2.2 ± 2%"], r"csv:2: 'U' must be .* or \"2\.1 ± 0\.042\""),
    ],
)
def test_what_may_be_read_in_two_ways_is_refused(
    tmp_path: Path, rows: list[str], says: str
) -> None:
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match=says):
        read_table(tmp_path / "a.csv")


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_rows_that_end_early_are_refused_at_the_first_of_them(tmp_path: Path, mark: str) -> None:
    rows = [f"{i}{mark}{0.5 * i}" for i in range(9)]
    (tmp_path / "a.csv").write_text("\n".join([f"t{mark}U", *rows, "9", "10"]) + "\n")
    with pytest.raises(InputError, match=r"a\.csv:11: 'row' must have 2 cells, not 1: 9"):
        read_table(tmp_path / "a.csv")


@pytest.mark.parametrize("encoding", ["utf-32", "utf-16", "utf-8-sig"])
def test_a_mark_at_the_start_of_a_file_tells_its_encoding(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_bytes("ϑ,U\n1,2\n2,3\n3,4\n".encode(encoding))
    assert read_table(tmp_path / "a.csv")["ϑ"].tolist() == [1.0, 2.0, 3.0]


def test_the_order_of_day_and_month_is_told_with_the_mark_of_the_cells(tmp_path: Path) -> None:
    rows = [f"0{i}/04/2024 10:00,{i}" for i in range(1, 5)]
    (tmp_path / "a.csv").write_text("\n".join(["t,U", *rows]) + "\n")
    table = read_columns(
        tmp_path / "a.csv", needed=["t", "U"], min_rows=3, dialect=Dialect(dates="dmy")
    )
    assert table.facts[-1].endswith(", dates read as day/month/year")


@pytest.mark.parametrize(
    ("stated", "needed", "refused"),
    [
        ({"dates": "dmy"}, "U", False),  # needed to read the file at all
        ({"since": "2024-05-03 00:00"}, "day", False),
        ({"time_unit": "d"}, "day", False),
        ({"since": "2024-05-03 00:00"}, "U", True),
        ({"time_unit": "d"}, "U", True),
        ({"dates": "dmy"}, "n", True),
    ],
)
def test_what_is_stated_of_dates_is_refused_where_no_column_holds_any(
    tmp_path: Path, stated: dict[str, Any], needed: str, refused: bool
) -> None:
    names = "n,U" if needed == "n" else "day,U"
    rows = [f"{i},{i}" if needed == "n" else f"{i + 12}.05.2024 00:00,{i}" for i in range(1, 5)]
    (tmp_path / "a.csv").write_text("\n".join([names, *rows]) + "\n")
    with (
        pytest.raises(InputError, match=f"'{next(iter(stated))}' goes with columns of dates")
        if refused
        else nullcontext()
    ):
        read_columns(
            tmp_path / "a.csv", needed=[needed, "U"], min_rows=3, dialect=Dialect(**stated)
        )


def test_a_frame_of_pandas_is_read_as_a_table_with_units_and_uncertainties() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(
        {"t (s)": [0.0, 1.0, 2.0, 3.0], "U (V)": [2.0, 1.2, 0.8, 0.4], "u_U (V)": [0.1] * 4}
    )
    given = read_table(frame).points("t", "U")
    assert given["x"].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert given["u_y"].tolist() == [0.1] * 4
    assert given["axes"].y_unit == "V"
    fit = fit_curve("a*exp(-x/tau)", **given)
    assert fit.status == "ok"


NAMESAKES = {"t (s)": [0.0, 1.0], "U (V)": [2.0, 1.0], "U (mV)": [7.0, 8.0], "u_U (V)": [0.5, 0.5]}


@pytest.mark.parametrize("framed", [False, True])
def test_columns_of_one_name_in_two_units_are_two(tmp_path: Path, framed: bool) -> None:
    if framed:
        table = read_table(pytest.importorskip("pandas").DataFrame(NAMESAKES))
    else:
        lines = [
            ";".join(map(str, row)) for row in (NAMESAKES, *zip(*NAMESAKES.values(), strict=True))
        ]
        (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
        table = read_table(tmp_path / "a.csv")
    assert {name: table[name].tolist() for name in NAMESAKES} == NAMESAKES
    assert table.units == {"t": "s", "U (V)": "V", "U (mV)": "mV", "u_U": "V"}
    points = table.points("t", "U (V)")
    assert (points["u_y"].tolist(), points["axes"].y_name) == ([0.5, 0.5], "U")
    for name, says in (("U", "of two columns"), ("t (ms)", "is no column"), ("W", "no column")):
        with pytest.raises(InputError, match=says):
            table[name]


@pytest.mark.parametrize(("y", "u"), [("T", "u(T)"), ("V", "u(V)"), ("m (g)", "u(m)")])
def test_a_symbol_that_is_a_unit_too_has_uncertainties(tmp_path: Path, y: str, u: str) -> None:
    (tmp_path / "a.csv").write_text(f"x,{y},{u}\n1,2,0.1\n2,3,0.1\n3,4,0.1\n")
    table = read_table(tmp_path / "a.csv")
    assert table.points("x", y)["u_y"].tolist() == [0.1] * 3
    assert table.units[u] == ""
    frame = pytest.importorskip("pandas").DataFrame({"x": [1.0], y: [2.0], u: [0.1]})
    assert read_table(frame).points("x", y)["u_y"].tolist() == [0.1]


@pytest.mark.parametrize("head", ["T,V,u(T),u(V)", "T (K),V (mL),u(T) (K),u(V)"])
def test_a_line_has_the_uncertainties_of_two_such_symbols(tmp_path: Path, head: str) -> None:
    (tmp_path / "a.csv").write_text(f"{head}\n1,2,0.1,0.2\n2,3,0.1,0.2\n3,4.1,0.1,0.2\n")
    asked = ["line", str(tmp_path / "a.csv"), "--x", "T", "--y", "V", "--figures", "none"]
    done = runner().invoke(cli, [*asked, "--out", str(tmp_path / "o")], standalone_mode=False)
    assert done.exception is None, done.exception
    assert "u_x = u(T)" in done.stdout
    assert "u_y = u(V)" in done.stdout


@pytest.mark.parametrize(
    ("head", "says"),
    [
        ("t,L (cm),u_L (mm)", "'u_L' must be in the unit of 'L', cm"),
        ("t,L,u_L (%)", "'u_L' has a unit, and 'L' states none"),
    ],
)
def test_uncertainties_in_another_unit_are_refused(tmp_path: Path, head: str, says: str) -> None:
    (tmp_path / "a.csv").write_text(f"{head}\n1,2,1\n2,3,1\n")
    table = read_table(tmp_path / "a.csv")
    with pytest.raises(InputError, match=says):
        table.points("t", "L")
    with pytest.raises(InputError, match=says):
        table.uncertainties  # noqa: B018
    assert table.points("L", "t")["u_y"] is None


def test_a_frame_has_the_columns_that_are_asked_for_once() -> None:
    pandas = pytest.importorskip("pandas")
    for frame, asked, says in (
        (pandas.DataFrame(NAMESAKES), ["t", "W"], "'W' is missing"),
        (pandas.DataFrame(NAMESAKES), ["t", "U"], "'U' occurs twice"),
        (pandas.DataFrame([[1, 2], [3, 4]], columns=["t", "t"]), None, "'t' occurs twice"),
    ):
        with pytest.raises(InputError, match=says):
            read_table(frame, columns=asked)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("a.xlsx", {"word/document.xml": "<a/>"}),
        ("a.xlsx", {"xl/workbook.xml": "<workbook><sheets><sheet name='A'/></sheets></workbook>"}),
        ("a.ods", {"content.xml": "<a"}),
        ("a.ods", {"content.xml": "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"}),
        ("a.zip", {"readme.txt": "hello"}),
    ],
)
def test_an_archive_that_is_no_table_is_refused_in_one_line(
    tmp_path: Path, name: str, parts: dict[str, str]
) -> None:
    pytest.importorskip("python_calamine")
    with zipfile.ZipFile(tmp_path / name, "w") as archive:
        for part, content in parts.items():
            archive.writestr(part, content)
    arguments = ["fit", str(tmp_path / name), "--formula", "a*x + b"]
    done = runner().invoke(cli, arguments, standalone_mode=False)
    assert isinstance(done.exception, InputError)
    assert len(str(done.exception).splitlines()) == 1


def test_what_is_neither_a_file_nor_a_frame_is_refused() -> None:
    with pytest.raises(InputError, match="must be a file or a data frame"):
        read_table(3)


@pytest.mark.parametrize(
    ("name", "part", "xml"),
    [
        ("a.xlsx", "xl/workbook.xml", '<s><row r="1048576"><c/></row><row><c r="XFD1"/></row></s>'),
        (
            "a.ods",
            "content.xml",
            '<d xmlns:table="t" xmlns:office="o"><table:table><table:table-row '
            'table:number-rows-repeated="1000000"><table:table-cell office:value-type="float" '
            'table:number-columns-repeated="1000"/></table:table-row></table:table></d>',
        ),
    ],
)
def test_a_sheet_that_would_fill_the_memory_is_refused(
    tmp_path: Path, name: str, part: str, xml: str
) -> None:
    pytest.importorskip("python_calamine")
    with zipfile.ZipFile(tmp_path / name, "w") as archive:
        archive.writestr(part, xml)
    with pytest.raises(InputError, match="'sheet' must have at most 4000000 cells"):
        read_table(tmp_path / name)


@pytest.mark.parametrize(
    ("last", "said"),
    [
        ("10;20", "line 6 stands apart"),
        ("6;12,6", "what stands below the table was not read (line 6)"),  # the sum
        ("2;4,2", "what stands below the table was not read (line 6)"),  # the mean
        ("# total\n6;12,6", ""),
    ],
)
def test_a_last_row_below_an_empty_line_is_named_or_left_out(
    tmp_path: Path, last: str, said: str
) -> None:
    (tmp_path / "a.csv").write_text(f"t;U\n1;2,1\n2;4,3\n3;6,2\n\n{last}\n")
    table = read_columns(tmp_path / "a.csv", needed=["t", "U"], min_rows=2)
    assert [fact for fact in table.facts if not fact.startswith(said)] == []
    assert bool(table.facts) == bool(said)
    assert len(table.lines) == 3 + ("apart" in said or not said)


def test_a_column_that_cannot_be_read_stops_only_those_who_read_it(tmp_path: Path) -> None:
    rows = "\n".join(f"0{i}/05/2024,{i},{2 * i},{i} {unit}" for i, unit in enumerate("VVA", 1))
    (tmp_path / "a.csv").write_text(f"day,t,U,I\n{rows}\n")
    table = read_columns(tmp_path / "a.csv", needed=["t", "U"], min_rows=2)
    assert table.columns["U"].tolist() == [2.0, 4.0, 6.0]
    assert table.unread == ("day", "I")
    for name, says in (("day", "--dates dmy or mdy"), ("I", "written like the cells above it")):
        with pytest.raises(InputError, match=f"a.csv:.*{says}"):
            read_columns(tmp_path / "a.csv", needed=["t", name], min_rows=2)


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("a.xlsx", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "is an old .xls or has a password"),
        ("a.trk", b"<object/>", "is of the program Tracker: .*estim import"),
        (
            "a.csv",
            b"t [s];U [V]\n1;+1.9E+00 VDC\n2;+2.1E+00 VDC\n3;+3.0E+00 VDC\n",
            ":2: 'U .V.' must be in the unit of its header, V, or numbers alone: .1.9E.00 VDC",
        ),
    ],
)
def test_what_is_no_table_of_these_is_named(
    tmp_path: Path, file: str, content: bytes, says: str
) -> None:
    (tmp_path / file).write_bytes(content)
    done = runner().invoke(cli, ["line", str(tmp_path / file)], standalone_mode=False)
    assert isinstance(done.exception, InputError)
    assert re.search(says, str(done.exception))
    assert ".xls" not in read_suffixes()


AXES = "time,seconds_elapsed,z,y,x\n" + "".join(
    f"{i + 1},0.{i},9.{i},0.0{i},0.1{i}\n" for i in range(9)
)


@pytest.mark.parametrize("command", [["line"], ["fit", "--formula", "a*x + b"]])
def test_the_axes_of_a_sensor_are_no_abscissa_and_ordinate(
    command: list[str], tmp_path: Path
) -> None:
    (tmp_path / "Accelerometer.csv").write_text(AXES)
    arguments = [command[0], str(tmp_path / "Accelerometer.csv"), *command[1:]]
    refused = runner().invoke(cli, arguments, standalone_mode=False)
    assert isinstance(refused.exception, InputError)
    assert "'column' must be named by --x and --y (there are time, " in str(refused.exception)
    refused = runner().invoke(
        cli, ["fit", arguments[1], "--formula", "a*time + b"], standalone_mode=False
    )
    assert "'column' must be named by --y (there are time, " in str(refused.exception)


@pytest.mark.parametrize(
    "end",
    [
        ">>>>>End Spectral Data<<<<<\n",
        "\n\nDate and Time:\tMon Mar 04 10:11:12 2024\nTemperature (C):\t-70\n",
    ],
)
def test_what_a_spectrometer_writes_below_its_table_is_not_read(end: str, tmp_path: Path) -> None:
    rows = "".join(f"{500 + i}.5\t{40 + i}\n" for i in range(9))
    (tmp_path / "a.asc").write_text(rows + end)
    layout = read_layout(tmp_path / "a.asc", Dialect(columns=("nm", "counts")))
    assert len(layout.rows) == 9
    assert "what stands below the table was not read" in layout.assumed[0]


def test_a_remark_among_the_rows_is_shown_with_the_cure(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("t_ms,d_cm\n0,1.5\nWARN: timeout\n20,1.7\n30,1.8\n")
    with pytest.raises(InputError, match=r"a\.log:3: .* not 1 \(a remark\?.*#.*\): WARN: timeout"):
        read_columns(tmp_path / "a.log", needed=["t_ms", "d_cm"], min_rows=3)


def test_the_unit_stands_before_the_number_of_a_run() -> None:
    assert name_and_unit("Position (m) Run #1") == ("Position Run #1", "m")
    assert name_and_unit("Time (s) #2") == ("Time #2", "s")
    assert name_and_unit("f(x) Run #1") == ("f(x) Run #1", "")
