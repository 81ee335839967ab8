"""Tables of other people's making: the same numbers whatever the dialect, or one line that says the
cure; never other numbers.
"""

from __future__ import annotations

import random
import re
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner

from estim.cli.commands import cli
from estim.common.errors import InputError
from estim.line.table_line import LineColumns, straight_line
from estim.means.table_mean import mean_of_table
from estim.reading.dialect import Dialect, name_and_unit
from estim.reading.layout import read_layout
from estim.reading.named_columns import line_numbers, place_of, read_columns


def read(
    path: Path,
    data: str | bytes,
    needed: tuple[str, ...] = ("t", "y"),
    *,
    letters: str = "utf-8",
    **said,
) -> dict[str, list[float]]:
    path.write_bytes(data if isinstance(data, bytes) else data.encode(letters))
    table = read_columns(path, needed=needed, min_rows=2, dialect=Dialect(**said))
    return {name: column.tolist() for name, column in table.columns.items()}


@pytest.mark.parametrize(
    ("text", "said", "t", "y"),
    [
        ("t;y\n0,5;1,2\n1;2\n2;3,25\n", {}, [0.5, 1, 2], [1.2, 2, 3.25]),
        ("t\ty\tnote\n0.5\t1\tgood\n1\t2\t\n", {}, [0.5, 1], [1, 2]),
        ("t y\n0,5 1,2\n1 2\n", {}, [0.5, 1], [1.2, 2]),
        ("t,y\n1, 2\n3, 4\n", {}, [1, 3], [2, 4]),
        ("t|y\n1|2\n3|4\n", {}, [1, 3], [2, 4]),
        ("   t    y \n  1   2  \n  3   4  \n", {}, [1, 3], [2, 4]),
        ("t y\n-----\n1 2\n3 4\n", {}, [1, 3], [2, 4]),
        ("# t;y\n0,1;1\n0,2;2\n", {}, [0.1, 0.2], [1, 2]),
        ("%t\ty\n\t%2/27/2015\n0.1\t1\n0.2\t2\n", {}, [0.1, 0.2], [1, 2]),
        ("Device: abc\nDate: 12.3.2024\n\nt;y\n1,5;2\n2,5;4\n", {}, [1.5, 2.5], [2, 4]),
        ("t;y\ns;mV\n0,1;1\n0,2;2\n", {}, [0.1, 0.2], [1, 2]),
        ("mass A;\nt;y\n0,1;1\n0,2;2\n", {}, [0.1, 0.2], [1, 2]),
        ('"t","y"\n"0,5","1,5"\n"1","2"\n', {}, [0.5, 1], [1.5, 2]),
        ("t;y;v\n1;2;\n3;4;5\n", {}, [1, 3], [2, 4]),
        ("t,y,\n1,2,\n3,4,\n", {"decimal": "point"}, [1, 3], [2, 4]),
        ("t;y\n1e-3;2E5\n1.5e-3;3E5\n", {}, [1e-3, 1.5e-3], [2e5, 3e5]),
        ("1,234;2\n2,345;3\n", {"columns": ("t", "y"), "decimal": "comma"}, [1.234, 2.345], [2, 3]),
        ("0.1\t7\t5\n0.2\t8\t6\n", {"columns": ("t", "", "y")}, [0.1, 0.2], [5, 6]),
        ("9 9 9\nt y\n1 2\n3 4\n", {"skip_rows": 1}, [1, 3], [2, 4]),
        ("t,y,n\n1,2,3\n4,5,6\n", {"delimiter": "comma"}, [1, 4], [2, 5]),
        ("time,t,y\n1.0,2,3\n4,5,6\n", {}, [2, 5], [3, 6]),
        ("t;y\n−0,5;−1e−1\n0,5;1e−1\n", {}, [-0.5, 0.5], [-0.1, 0.1]),
        ("t;y;z\n−0,5;1;−2 ± 1\n0,5;2;−3 ± 1\n", {}, [-0.5, 0.5], [1, 2]),
        ("t,y\n1,2\n2,−\n3,4\n", {}, [1, 3], [2, 4]),
        ("1/t,ln k,t,y\n0.5,1,2,1\n0.25,2,4,3\n", {}, [2, 4], [1, 3]),
        ("1/t (1/s),1000/K (1/mm),t,y\n0.5,1,2,1\n0.25,2,4,3\n", {}, [2, 4], [1, 3]),
        ("2θ (°);t;y\n1,5;2;1\n2;4;3\n", {}, [2, 4], [1, 3]),
        ("10 T [s];t;y\n1,5;2;1\n2;4;3\n", {}, [2, 4], [1, 3]),
        ("Group 3;;\nt;10 periods (s);y\n0,5;8,9;1\n1;9,1;2\n", {}, [0.5, 1], [1, 2]),
    ],
)
def test_a_table_is_read_as_it_is_written(
    tmp_path: Path, text: str, said: dict, t: list[float], y: list[float]
) -> None:
    for written in (text, text.replace("\n", "\r\n"), text.rstrip("\n")):
        assert read(tmp_path / "a.csv", written, **said) == {"t": t, "y": y}


@pytest.mark.parametrize(
    ("text", "said", "says"),
    [
        (
            "t;y\n1,234;1\n2,345;2\n",
            {},
            "a.csv:2: 'comma' may part thousands or be a decimal comma, .* --decimal comma",
        ),
        (
            "t;y\n1.234;1,5\n2.345;2\n",
            {},
            "a.csv:2: 'row' has numbers with decimal points and others with commas",
        ),
        (
            "t;y\n1,5;1\n2.5;2\n",
            {"decimal": "comma"},
            "a.csv:3: 't' must be a number .as 1234,5 or 2e3; .*: 2.5",
        ),
        (
            "t;y\n1.234,5;1\n2.345,5;2\n",
            {},
            "a.csv:3: 'row' must hold cells that are numbers|a.csv:2: ",
        ),
        (
            "t;y\n1;2\n1 000;3\n1;2\n",
            {},
            "a.csv:3: 't' must be a number .as 1234.5 or 2e3; .*: 1 000",
        ),
        ("t,y\n0,5,1,2\n1,0,2,0\n", {}, r"a.csv:2: 'row' must have 2 cells, not 4 \(decimal"),
        ("t,y,n\n1,2,3\n4,5,6\n", {}, "a.csv:2: 'row' may hold decimal commas: .* --decimal point"),
        (
            "0.1\t0.2\t3\n0.1\t0.2\t3\n",
            {},
            r"a.csv:1: 'header' has no line of column names: name all 3 .*--columns "
            r"a,b,\.\.\.; columns = ",
        ),
        (
            "0.1\t0.2\t3\n0.1\t0.2\t3\n",
            {"columns": ("t", "y")},
            "a.csv:1: 'columns' must name all 3 columns",
        ),
        (
            "t,t,y\n0.5,1,2\n1,3,2\n",
            {},
            "a.csv:1: 't' occurs twice in the header: name all columns",
        ),
        ("t,u\n0.5,1\n1,3\n", {}, r"a.csv:1: 'y' is missing \(the header has t, u\)"),
        ("t,y\n0.1,1\n0.2\n0.3,2\n", {}, "a.csv:3: 'row' must have 2 cells, not 1: 0.2"),
        (
            "t,y\n0.0,1.0,3\n0.2,2\n0.3,2\n",
            {},
            "a.csv:2: 'row' is a row with another number of cells .*--skip-rows",
        ),
        (
            "t,y\n13:00,1\n13:01,2\n",
            {},
            r"a.csv:2: 't' must be a number .* a time as 13:05:00\): 13:00",
        ),
        ("t,y\n0.1,1\n0.2,2\n0.3,3\n0.4,4,1\n", {}, "a.csv:5: 'row' must have 2 cells, not 3: 0.4"),
        ("t,y\n0.1,1x\n0.2,2\n0.3,2\n", {}, "a.csv:2: 'row' must be a row of numbers"),
        (
            "t,y\n10 s (or so),1\n0.2,2\n0.3,2\n",
            {},
            "a.csv:2: 'row' must be a row of numbers.* names, which begin with a letter",
        ),
        ("t,y\n0.1,1\n0.2,2x\n0.3,2\n", {}, "a.csv:3: 'y' must be a number .*: 2x"),
        (
            "t,y\n0.1,1\n0.2,2x10^3\n0.3,2\n",
            {},
            r"a.csv:3: 'y' must be a number \(as 1234.5 or 2e3; .*\): 2x10\^3",
        ),
        ("t,y\n0,1\n% 1,2\n1,3\n2,3\n", {}, "a.csv:3: 't' must be a number .*: % 1"),
        (
            "t,y\n0,inf\n1,3\n2,3\n",
            {},
            "a.csv:2: 'row' must be a row of numbers|'y' must be a number: inf",
        ),
        ("t,y\n", {}, "a.csv:1: 'row' must hold cells that are numbers"),
        (b"PK\x03\x04 and so on", {}, "a.csv: cannot be read as an archive"),
        (b"t,y\n1,2\n\xff\n", {"encoding": "utf-8"}, "'encoding' cannot be read as utf-8"),
        ("t,y\n1,2\n2,3\n", {"skip_rows": 3}, "a.csv: has no rows of numbers"),
    ],
)
def test_what_may_be_read_in_two_ways_is_one_line_with_the_cure(
    tmp_path: Path, text: str | bytes, said: dict, says: str
) -> None:
    with pytest.raises(InputError, match=says) as told:
        read(tmp_path / "a.csv", text, **said)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("said", "says"),
    [
        ({"delimiter": "%"}, "'delimiter' must be one of tab"),
        ({"skip_rows": -1}, "'skip_rows' must be"),
        ({"columns": ("a", "a")}, "'columns' must name"),
    ],
)
def test_a_dialect_that_makes_no_sense_is_refused(said: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Dialect(**said)


def test_rows_without_a_value_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t;y;k\n0,1;1;a\n0,2;;b\n0,3;nan;\n0,4;4;c\n")
    table = read_columns(path, needed=("t", "y"), min_rows=2)
    assert table.lines.tolist() == [2, 5]
    assert table.facts == ("2 rows without a value of 'y' were excluded (lines 3, 4)",)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([4, 7, 10, 13], "4, 7, 10, 13"),
        ([3, 4, 5, 6], "3 to 6"),
        ([3, 5, 8, 9, 10], "3, 5, 8 to 10"),
        ([3, 4, 9], "3, 4, 9"),
        ([7], "7"),
        (list(range(2, 40, 3)), "2, 5, 8, 11, 14, 17, and 7 more"),
        ([*range(2, 500), 600], "2 to 499, 600"),
    ],
)
def test_only_lines_without_a_value_are_told(lines: list[int], said: str) -> None:
    assert line_numbers(lines) == said


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig"])
def test_letters_of_other_encodings_change_no_number(tmp_path: Path, encoding: str) -> None:
    text = "t (µs);y / °C\n0,1;1\n0,2;2\n"
    assert read(tmp_path / "a.csv", text, letters=encoding) == {"t": [0.1, 0.2], "y": [1.0, 2.0]}
    layout = read_layout(tmp_path / "a.csv", Dialect())
    assert layout.units == ("µs", "°C")
    assert bool(layout.assumed) == (encoding == "latin-1")


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("U (mV)", "U", "mV"),
        ("time [s]", "time", "s"),
        ("x / cm", "x", "cm"),
        ("a/b", "a/b", ""),
        ("t_s", "t_s", ""),
        ("v (m/s)", "v", "m/s"),
    ],
)
def test_a_unit_in_the_header(cell: str, name: str, unit: str) -> None:
    assert name_and_unit(cell) == (name, unit)


def written(source: random.Random, t: list[float], y: list[float]) -> str:
    """A table in a dialect by chance: rows of t, y and further columns."""
    mark, comma = source.choice("\t;, |"), source.random() < 0.5
    comma = comma and mark != ","

    def number(value: float) -> str:
        text = source.choice((repr, lambda v: f"{v:.17g}", lambda v: f"{v:.17e}"))(value)
        return text.replace(".", ",") if comma else text

    further = source.randrange(3)
    names = ["t", "y", "n", "note"][: 2 + further]
    rows = [
        [number(a), number(b), str(i), source.choice(("good", "3", "b2"))][: 2 + further]
        for i, (a, b) in enumerate(zip(t, y, strict=True))
    ]
    head = source.choice((["# made by hand"], ["A measurement", ""], []))
    return "\n".join([*head, *(mark.join(row) for row in [names, *rows])]) + "\n"


def tried(path: Path, text: str) -> tuple[dict[str, list[float]], str]:
    """What is read, or why nothing is."""
    try:
        return read(path, text), ""
    except InputError as error:
        return {}, str(error)


def test_every_dialect_gives_the_same_numbers_or_is_refused(tmp_path: Path) -> None:
    """Also with slips: a mark that is lost, doubled or changed for another never gives other
    numbers in as many rows.
    """
    source, read_plain, read_slips = random.Random(5), 0, 0
    for _ in range(400):
        t, y = (
            [
                source.choice((source.random(), source.randrange(9), 1e-7 * source.random(), -2.5))
                for _ in range(5)
            ]
            for _ in "ty"
        )
        text = written(source, t, y)
        found, refusal = tried(tmp_path / "a.csv", text)
        assert found == {"t": t, "y": y} or re.search(r"--\w+|decimal commas\?", refusal), text
        read_plain += bool(found)
        places = [i for i, mark in enumerate(text) if mark in ",.;|\t"]
        place = source.choice(places)
        slipped = (
            text[:place] + source.choice(("", ",", ".", ";", text[place] * 2)) + text[place + 1 :]
        )
        found, _ = tried(tmp_path / "a.csv", slipped)
        if not found:
            continue
        read_slips += 1
        different = sum(
            a != b
            for name, true in (("t", t), ("y", y))
            for a, b in zip(found[name], true, strict=False)
        )
        assert different <= 1, slipped  # the number whose own mark was lost
    assert read_plain > 300
    assert read_slips > 30


def test_the_tables_of_other_people_are_read(real_files: list[Path]) -> None:
    if not real_files:
        return  # a plain clone
    shared = next(folder for folder in real_files[0].parents if folder.name == "tracker").parent
    rows = {
        "tracker/halfpipe/Klipp0.csv": 4143,
        "tracker/halfpipe/52.txt": 2017,
        "tracker/rolling_ball/kulefullbane.txt": 40,
        "tracker/rolling_ball/Vid3.txt": 47,
        "tracker/viscosity/a1.txt": 50,
        "wheel/class_2015/balanced_1.txt": 161,
        "lines/hogg_bovy_lang_2010_table1.csv": 20,
        "gallery/table_length_2009.txt": 17,
        "gallery/hubble_1929.csv": 24,
    }
    for name, n in rows.items():
        layout = read_layout(shared / name, Dialect())
        table = read_columns(
            shared / name,
            needed=[*layout.names][1:3] if len(layout.names) > 2 else layout.names,
            min_rows=3,
        )
        assert table.lines.size == n, name
    nist = read_columns(
        shared / "nist_strd" / "Misra1a.dat",
        needed=("x", "y"),
        min_rows=3,
        dialect=Dialect(columns=("y", "x")),
    )
    np.testing.assert_array_equal(nist.columns["x"][[0, -1]], [77.6, 760.0])
    destroyed, named = (
        shared / "tracker" / "halfpipe" / "Klipp5.csv",
        Dialect(columns=("t", "x", "y", "v", "a")),
    )
    with pytest.raises(InputError, match="decimal points and others with commas"):
        read_columns(destroyed, needed=("t", "y"), min_rows=3, dialect=named)


@pytest.mark.parametrize("head", ["t,y,u_y (%)", "t,y,u_y (mm)", "t,y,u_y\ns,,V"])
def test_uncertainties_with_a_unit_beside_values_without_are_refused(
    tmp_path: Path, head: str
) -> None:
    (tmp_path / "a.csv").write_text(f"{head}\n1.5,2,3\n4,5,6\n7,8,9\n")
    said = "has a unit, and 'y' states none: write the uncertainties in the unit of 'y'"
    table = read_columns(tmp_path / "a.csv", needed=("t", "y", "u_y"), min_rows=2)
    with pytest.raises(InputError, match=said) as caught:
        table.require_unit("u_y", "y")
    assert ("--columns" in str(caught.value)) is ("%" not in head)  # 2 % is no 2
    for command in (["fit", "--formula", "a*t + b"], ["line", "--x", "t"], ["mean"]):
        asked = [command[0], str(tmp_path / "a.csv"), *command[1:], "--y", "y"]
        asked += ["--figures", "none", "--out", str(tmp_path / "o")]
        with pytest.raises(InputError, match=said):
            runner().invoke(cli, asked, standalone_mode=False, catch_exceptions=False)


def test_uncertainties_in_another_unit_than_their_column_are_refused(tmp_path: Path) -> None:
    def table(head: str, **said):
        (tmp_path / "a.csv").write_text(f"{head}\n1,2,3\n4,5,6\n")
        return read_columns(
            tmp_path / "a.csv", needed=("t", "y", "u_y"), min_rows=2, dialect=Dialect(**said)
        )

    for head, said in (
        ("t,y [V],u_y [mV]", {}),
        ("x,x,x", {"columns": ("t", "y (V)", "u_y (%)")}),
        ("t,y,u_y\ns,V,mV", {}),
    ):
        with pytest.raises(
            InputError,
            match=r"a\.csv(:[12])?: 'u_y' must be in the unit of 'y', V; write it in that unit, "
            r"or name the columns",
        ):
            table(head, **said).require_unit("u_y", "y")
    for head, said in (
        ("t,y [V],u_y [V]", {}),
        ("t,y [V],u_y", {}),
        ("t,y,u_y (1 sigma)", {}),
        ("t,y,u_y (1)", {}),
        ("t,y [µm],u_y [um]", {}),
        ("t,y,u_y\ns,V,V", {}),
    ):
        table(head, **said).require_unit("u_y", "y")


@pytest.mark.parametrize(
    ("cell", "value", "u"),
    [
        ("1.23(4)e-3", 1.23e-3, 4e-5),
        ("1,23(4)E+2", 123.0, 4.0),
        ("1.23(0.04)e-3", 1.23e-3, 4e-5),
        ("(1.23 ± 0.04)e-3 V", 1.23e-3, 4e-5),
        ("1.23e-3(4)", 1.23e-3, 4e-5),
        ("123(4)", 123.0, 4.0),
    ],
)
def test_a_cell_with_an_uncertainty_and_a_power_of_ten(
    tmp_path: Path, cell: str, value: float, u: float
) -> None:
    found = read(tmp_path / "a.csv", f"t;y\n1;{cell}\n2;{cell}\n", ("y", "u_y"))
    assert found["y"] == pytest.approx([value] * 2, rel=1e-12)
    assert found["u_y"] == pytest.approx([u] * 2, rel=1e-12)


def test_uncertainties_stand_in_cells_or_in_a_column(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="and a column of their own as well"):
        read(tmp_path / "a.csv", "t;U (V);u_U (V)\n1;2.0(1);0.2\n2;3.0(1);0.2\n", ("U",))


@pytest.mark.parametrize(
    ("head", "cells", "unit"),
    [
        ("x", ["20.0 °C", "30.0 °C", "313.15 K"], "°C"),
        ("x (°C)", ["293.15 K", "303.15 K", "313.15 K"], "°C"),
        ("x (K)", ["20.0(5) °C", "30.0(5) °C", "40.0(5) °C"], "K"),
        ("x", ["1.0 Hz", "2.0 rad/s", "3.0 Hz"], "Hz"),
        ("x", ["1.0 rad/s", "2.0 rad/s", "3.0 Hz"], "rad/s"),
        ("x (Hz)", ["1.0 °/s", "2.0 °/s", "3.0 °/s"], "Hz"),
        ("x", ["1.0 mV", "2.0 V", "3.0 V"], "mV"),
    ],
)
def test_units_are_not_mixed(tmp_path: Path, head: str, cells: list[str], unit: str) -> None:
    text = "".join(f"{i};{cell}\n" for i, cell in enumerate(cells))
    with pytest.raises(InputError, match=f"must be written like the cells .* and in {unit}: "):
        read(tmp_path / "a.csv", f"t;{head}\n{text}", ("x",))


@pytest.mark.parametrize(
    ("head", "cells", "x"),
    [
        ("x", ["20 °C", "30 deg C", "40 C"], [20, 30, 40]),
        ("x", ["20 °", "30 deg", "40 °"], [20, 30, 40]),
        ("x", ["1 Hz", "2 s^-1", "3 Hz"], [1, 2, 3]),
        ("u_x (K)", ["1 °C", "2 °C", "3 K"], [1, 2, 3]),
    ],
)
def test_units_that_mean_the_same_are_mixed(
    tmp_path: Path, head: str, cells: list[str], x: list[float]
) -> None:
    text = "".join(f"{i};{cell}\n" for i, cell in enumerate(cells))
    name = head.partition(" ")[0]
    assert read(tmp_path / "a.csv", f"t;{head}\n{text}", (name,))[name] == pytest.approx(x)


SUMMED = ["n;t;y", "1;1,5;2,5", "2;2,5;3,5", "3;3,5;4"]


@pytest.mark.parametrize(
    ("rows", "lines"),
    [
        ([*SUMMED, "Mean;2,5;3,33"], "5"),
        ([*SUMMED, "Mittelwert:;2,5;3,33"], "5"),
        ([*SUMMED, "Sum;7,5;10", "Media;2,5;3,33"], "5, 6"),
        ([*SUMMED, ";;", "Total;7,5;10"], "6"),
        ([*SUMMED, "Mittelwert;2,5;3,33", "Stabw;1;0,76"], "5, 6"),
        ([*SUMMED, "", "min;1,5;2,5", "Max:;3,5;4"], "6, 7"),
    ],
)
def test_a_row_of_means_or_sums_is_no_reading(tmp_path: Path, rows: list[str], lines: str) -> None:
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    table = read_columns(tmp_path / "a.csv", needed=("t", "y"), min_rows=2)
    assert table.columns["y"].tolist() == [2.5, 3.5, 4.0]
    line = "lines" if "," in lines else "line"
    assert f"what stands below the table was not read ({line} {lines})" in table.facts


@pytest.mark.parametrize(
    "rows",
    [
        ["n;t;y", "sum;1,5;2,5", "mean;2,5;3,5", "c;3,5;4"],
        ["n;t;y", "a;1,5;2,5", "mean;2,5;3,5", "b;3,5;4", "mean;3,5;4"],
        ["n;t;y", "sum;1,5;2,5", "mean;2,5;3,5", "total;3,5;4"],
    ],
)
def test_rows_that_are_called_so_among_others_are_read(tmp_path: Path, rows: list[str]) -> None:
    found = read(tmp_path / "a.csv", "\n".join(rows) + "\n")
    assert len(found["y"]) == len(rows) - 1


@pytest.mark.parametrize(
    "rows",
    [
        ["n;t;y", "a;1,5;2,5", "b;2,5;3,5", "c;3,5;4", "Average;2,5;3,33"],
        ["t;y;n", "1,5;2,5;", "2,5;3,5;", "3,5;4;", "2,5;3,33;mean value"],
        ["level;t;y", "baja;1,5;2,5", "alta;2,5;3,5", "media;9,5;4"],
        ["n;t;y", "Anna;1,5;2,5", "Eva;2,5;3,5", "Max;2,0;3,0"],
    ],
)
def test_what_may_be_a_mean_or_a_reading_is_asked(tmp_path: Path, rows: list[str]) -> None:
    with pytest.raises(InputError, match=rf"a.csv:{len(rows)}: 'row' may be a reading, or the "):
        read(tmp_path / "a.csv", "\n".join(rows) + "\n")


COPIES = [
    (
        "t,y\n1,5\n2,6\n2,6\n3,7\n",
        "rows identical to an earlier one: 4 (a copy is counted twice, so remove it)",
    ),
    (
        "t,y\n1,5\n2,6\n3,7\n1,5\n2,6\n",
        "rows identical to an earlier one: 5, 6 (a copy is counted twice, so remove it)",
    ),
    ("t;y;n\n1;5;1\n2;6;2\n2;6;3\n3;7;4\n", ""),  # another reading, by its number
    ("t,y\n1,5\n1,6\n2,6\n2,6\n3,7\n", ""),  # readings at the same t
    ("t,y\n1,5\n2,6\n3,6\n", ""),
]


@pytest.mark.parametrize(("text", "told"), COPIES)
def test_a_row_that_copies_an_earlier_one_is_told_where_no_reading_is_repeated(
    tmp_path: Path, text: str, told: str
) -> None:
    (tmp_path / "a.csv").write_text(text)
    table = read_columns(tmp_path / "a.csv", needed=("t", "y"), min_rows=2)
    assert list(table.warnings) == ([told] if told else [])
    assert table.lines.size == text.count("\n") - 1


@pytest.mark.parametrize("mark", ["±", " ± ", " +/- ", " +- "])
def test_an_uncertainty_in_a_cell_does_not_part_cells(tmp_path: Path, mark: str) -> None:
    rows = "".join(f"{i},{v}{mark}0.1\n" for i, v in [(1, "2"), (2, "3.5"), (3, "4")])
    found = read(tmp_path / "a.csv", f"t,y\n{rows}", ("t", "y", "u_y"))
    assert found == {"t": [1, 2, 3], "y": [2, 3.5, 4], "u_y": [0.1] * 3}
    found = read(tmp_path / "a.csv", f"y (s)\n1,20{mark}0,1\n1,30{mark}0,1\n", ("y (s)", "u_y"))
    assert found == {"y (s)": [1.2, 1.3], "u_y": [0.1, 0.1]}


def test_the_cells_of_a_range_without_any_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.csv:3: 'row' must hold cells that are numbers"):
        read(tmp_path / "a.csv", "t,y\n1,2\n3,4\n", range="Z1:ZZ9")


def test_a_unit_of_several_symbols_stands_behind_a_slash() -> None:
    assert name_and_unit("c / mol L-1") == ("c", "mol L-1")
    assert name_and_unit("v / m s^-1") == ("v", "m s^-1")
    for text in ("v / (m/s)", "v in (m/s)", "v / [m/s]", "v in [m/s]", "v / ( m/s )", "v in m/s"):
        assert name_and_unit(text) == ("v", "m/s")
    assert name_and_unit("k in 1/(m s)") == ("k", "1/(m s)")
    assert name_and_unit("ratio / reading of day 2") == ("ratio / reading of day 2", "")


@pytest.mark.parametrize(
    "cell", ["1/2", "~1", "2x10^3", "<0.1", "2.0*", "2E 3", "1.5-1.6", "1.2.3", "12:30", "$1.20"]
)
def test_no_other_column_takes_the_place_of_one_that_cannot_be_read(cell, tmp_path):
    (tmp_path / "a.csv").write_text("t,v,w\n" + "".join(f"{i},{cell},{2 * i}\n" for i in range(5)))
    for read in (
        lambda: mean_of_table(tmp_path / "a.csv"),
        lambda: straight_line(tmp_path / "a.csv", LineColumns()),
    ):
        with pytest.raises(InputError, match=r"'column' must be named .* \(there are t, v, w\)"):
            read()
    with pytest.raises(InputError, match=r"a\.csv:2: 'v' must be a number"):
        mean_of_table(tmp_path / "a.csv", y="v")


@pytest.mark.parametrize("cell", ["1a", "A1", "run 1"])
def test_a_column_of_labels_is_no_column_of_numbers(cell, tmp_path):
    (tmp_path / "a.csv").write_text("v,w\n" + "".join(f"{cell},{2 * i}\n" for i in range(5)))
    assert mean_of_table(tmp_path / "a.csv").name == "w"


def test_a_unit_may_stand_in_other_brackets() -> None:
    header = ["t (s)", "U / V", "T (s)"]
    assert [place_of(name, header) for name in ("t [s]", "U [V]", "U", "T (s)")] == [0, 1, 1, 2]
    with pytest.raises(InputError, match=r"'t \[ms\]' is missing"):
        place_of("t [ms]", header)
