"""Cells that a spreadsheet could not compute begin with `#`, as comments do: no row of numbers
vanishes as one, and no comment is read as a row.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from estim.common.errors import InputError
from estim.reading.cells import is_comment
from estim.reading.named_columns import read_columns
from estim.reading.run import read_run
from estim.reading.tracker.export import read_export

ERRORS = (
    "#N/A",
    "#DIV/0!",
    "#VALUE!",
    "#REF!",
    "#NUM!",
    "#NV",
    "#WERT!",
    "#¡DIV/0!",
    "#¡NUM!",
    "#N/D",
    "#VALEUR!",
    "#n/a",
)


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("row", ["0.5;{};2", "{};{};2", "{};2;3", "{};{};{}"])
def test_a_row_that_a_spreadsheet_could_not_compute_is_refused_with_its_line(
    tmp_path: Path, error: str, row: str
) -> None:
    path, bad = tmp_path / "a.csv", row.replace("{}", error)
    for rows in (f"0.1;1;1\n{bad}\n0.3;2;3\n0.4;4;4\n", f"0.1;1;1\n{bad}\n"):
        path.write_text(f"t;y;z\n{rows}", encoding="utf-8")
        with pytest.raises(InputError, match=r"a\.csv:3: "):
            read_columns(path, needed=("t", "y"), min_rows=1)


def test_it_is_said_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t;y\n0.1;1\n#N/A;2\n0.3;3\n")
    with pytest.raises(InputError, match=r"a\.csv:3: 't' must be a number: #N/A"):
        read_columns(path, needed=("t", "y"), min_rows=2)


@pytest.mark.parametrize(
    "row",
    [
        "#N/A;2",
        "#N/A\t2,5",
        "#N/A 2",
        "#N/A 2,5",
        "#####;2",
        "#DIV/0!,#DIV/0!",
        "#N/A;2;run A",
        "#N/A",
        " #N/A;",
    ],
)
def test_errors_of_a_spreadsheet_are_no_comment(row: str) -> None:
    assert not is_comment(row)


@pytest.mark.parametrize(
    "line",
    [
        "# t;y",
        "#t,y",
        "#",
        "# 0.1;2",
        "#0.1;2",
        "#####",
        "### 1 ###",
        "#### , part 2",
        "#NOTE!, see below",
        "#N/A in 3 rows",
        "#STOP!",
        "#1",
        "#REF! was mended, 2 times",
        "# #N/A;2",
        "# N/A means no value",
        "#N/A means that there is none",
        "t;y",
        "%t",
    ],
)
def test_comments_stay_comments(line: str) -> None:
    assert is_comment(line) == line.startswith("#")


@pytest.mark.parametrize("first", [True, False])
def test_the_first_row_is_no_line_of_names(tmp_path: Path, first: bool) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "t;y\n#DIV/0!;#DIV/0!\n0.2;1\n0.3;2\n" if first else "t;y\n#DIV/0!;0\n0.2;1\n0.3;2\n"
    )
    with pytest.raises(InputError, match=r"a\.csv:2: 'row' must be a row of numbers"):
        read_columns(path, needed=("t", "y"), min_rows=2)


def test_an_error_in_a_column_that_is_not_needed_costs_no_row(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("k;t;y\n1;0.1;1\n#N/A;0.2;2\n3;0.3;3\n")
    assert read_columns(path, needed=("t", "y"), min_rows=2).columns["t"].tolist() == [
        0.1,
        0.2,
        0.3,
    ]


def test_no_other_reader_loses_it(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{0.1 * i:.1f},{0.01 * i * i:.4f}" for i in range(9)]
    rows[4] = "#N/A,0.16"
    path.write_text("\n".join(["t_s,x_m", *rows]))
    with pytest.raises(InputError, match=r"a\.csv:6: 't_s' must be a number: #N/A"):
        read_run(path, name="a")
    path.write_text("\n".join(["ball,,", "t,x,y", *(f"{row},0" for row in rows)]))
    with pytest.raises(InputError, match=r"a\.csv:7: 't' must be a number"):
        read_export(path, unit="m")
