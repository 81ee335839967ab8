"""The line below the names: units, a row without a value, or half a row of numbers, which is
refused.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from estim.common.errors import InputError
from estim.reading.dialect import Dialect
from estim.reading.layout import read_layout
from estim.reading.named_columns import read_columns
from estim.reading.table import Table

ROWS = "0,1;1\n0,2;2\n0,3;3\n"


def read(path: Path, text: str, *, needed: tuple[str, ...] = ("t", "n")) -> Table:
    path.write_text(text, encoding="utf-8")
    return read_columns(path, needed=needed, min_rows=2)


@pytest.mark.parametrize(
    ("row", "units"),
    [
        ("s;1/s", ("s", "1/s")),
        ("1/s;s", ("1/s", "s")),
        ("s;1", ("s", "1")),
        ("s;-", ("s", "1")),
        ("s;dimensionless", ("s", "1")),
        ("s;", ("s", "")),
        (";V", ("", "V")),
        ("[s];[-]", ("s", "1")),
        ("(s);(1/s)", ("s", "1/s")),
        ("ms;10^-3 N", ("ms", "10^-3 N")),
        ("s;m/s²", ("s", "m/s²")),
        ("µs;None", ("µs", "1")),
        ("s;10⁻³ m", ("s", "10⁻³ m")),
        ("1;V", ("1", "V")),
    ],
)
def test_units_below_the_names(tmp_path: Path, row: str, units: tuple[str, str]) -> None:
    table = read(tmp_path / "a.csv", f"t;n\n{row}\n{ROWS}")
    assert (table.units["t"], table.units["n"]) == units
    assert table.columns["t"].tolist() == [0.1, 0.2, 0.3]
    # nobody says which columns are needed
    layout = read_layout(tmp_path / "a.csv", Dialect())
    assert (layout.names, layout.units) == (("t", "n"), units)


def test_the_last_column_may_have_none(tmp_path: Path) -> None:
    table = read(tmp_path / "a.csv", "t;n;remark\ns;1/s;\n0,1;1;ok\n0,2;2;ok\n")
    assert dict(table.units) == {"t": "s", "n": "1/s"}


@pytest.mark.parametrize("row", [";", "-;-", "nan;", ";\n;"])
def test_a_first_row_without_a_value_is_left_out_and_told(tmp_path: Path, row: str) -> None:
    table = read(tmp_path / "a.csv", f"t;n\n{row}\n{ROWS}")
    assert table.columns["n"].tolist() == [1.0, 2.0, 3.0]
    assert table.blank == tuple(range(2, 3 + row.count("\n")))
    below = read(tmp_path / "a.csv", f"t;n\ns;V\n{row}\n{ROWS}")
    assert dict(below.units) == {"t": "s", "n": "V"}


@pytest.mark.parametrize("row", ["0,1;m", "0.5;V", "5 s;V", "3;V 2", "12;kg"])
def test_half_a_row_is_no_row_of_units(tmp_path: Path, row: str) -> None:
    with pytest.raises(InputError, match=r"a\.csv:2: 'row' must be a row of numbers"):
        read(tmp_path / "a.csv", f"t;n\n{row}\n{ROWS}")


def test_names_that_are_no_symbols_stay_names(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"Group;three\nt;n\n{ROWS}")
    layout = read_layout(tmp_path / "a.csv", Dialect())
    assert layout.names == ("t", "n")
