"""What a person sees in a sheet is what is read: formats, hidden rows and sheets, formulas."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from workbooks import Cells, Formula, Percent, changed, ods, xlsx

from estim import InputError
from estim.reading.dialect import Dialect
from estim.reading.named_columns import read_columns
from estim.reading.table import Table

pytest.importorskip("python_calamine")

Make = Callable[[Mapping[str, Cells]], bytes]
BOTH = pytest.mark.parametrize("make", [xlsx, ods])
ROWS = [[0, 1.0], [1, 2.0], [2, 3.0]]


def read(folder: Path, book: bytes, *needed: str, sheet: str | None = None) -> Table:
    path = folder / ("a.xlsx" if b"xl/workbook.xml" in book else "a.ods")
    path.write_bytes(book)
    return read_columns(path, needed=needed, min_rows=2, dialect=Dialect(sheet=sheet))


@BOTH
@pytest.mark.parametrize("name", ["T (%)", "T"])
def test_cells_shown_in_per_cent_are_read_in_per_cent(
    tmp_path: Path, make: Make, name: str
) -> None:
    shares = [Percent(0.021), Formula("A2/10", Percent(0.029)), Percent(0.07)]
    table = read(tmp_path, make({"A": [["t", name], *enumerate(shares)]}), "T")
    assert table.columns["T"].tolist() == [2.1, 2.9, 7.0]
    assert table.units["T"] == "%"


@BOTH
@pytest.mark.parametrize(
    ("name", "shares", "says"),
    [
        ("T", [Percent(0.02), 0.03, Percent(0.07)], "3: 'T' must be written like the cells above"),
        ("T (%)", [0.03, Percent(0.02), Percent(0.07)], "3: 'T' must be a number .*: 2%"),
    ],
)
def test_a_column_shown_in_per_cent_in_part_is_refused(
    tmp_path: Path, make: Make, name: str, shares: list[object], says: str
) -> None:
    with pytest.raises(InputError, match=rf"a\.\w+:{says}"):
        read(tmp_path, make({"A": [["t", name], *enumerate(shares)]}), "T")


def test_a_percent_sign_that_is_text_of_the_format_is_no_factor(tmp_path: Path) -> None:
    book = xlsx({"A": [["t", "T"], *([t, Percent(2.1 + t)] for t in range(3))]})
    table = read(tmp_path, changed(book, ('"0.0%"', '"0.0&quot;%&quot;"')), "T")
    assert table.columns["T"].tolist() == [2.1, 3.1, 4.1]


@BOTH
def test_hidden_rows_are_left_out_and_named(tmp_path: Path, make: Make) -> None:
    book = make({"A": [["t", "U"], *ROWS[:2], [7, 99.0], *ROWS[2:], [8, 99.0]]})
    hidden = (
        [('<row r="4"', '<row r="4" hidden="1"'), ('<row r="6"', '<row hidden="1" r="6"')]
        if make is xlsx
        else [
            (f"<table:table-row>{cell}", f'<table:table-row table:visibility="filter">{cell}')
            for cell in (
                f'<table:table-cell office:value-type="float" office:value="{t}">' for t in (7, 8)
            )
        ]
    )
    table = read(tmp_path, changed(book, *hidden), "t", "U")
    assert table.columns["U"].tolist() == [1.0, 2.0, 3.0]
    assert table.assumed == ("rows that are hidden or filtered out were not read (4, 6)",)


@BOTH
def test_hidden_columns_are_named(tmp_path: Path, make: Make) -> None:
    book = make({"A": [["t", "U"], *ROWS]})
    hidden = (
        ("<sheetData>", '<cols><col min="2" max="9" hidden="1"/></cols><sheetData>')
        if make is xlsx
        else (
            '<table:table table:name="A">',
            '<table:table table:name="A"><table:table-column/>'
            '<table:table-column table:visibility="collapse"/>',
        )
    )
    table = read(tmp_path, changed(book, hidden), "t", "U")
    assert table.assumed == ("columns that are hidden in the sheet: B",)


def test_a_hidden_sheet_is_read_where_it_is_named(tmp_path: Path) -> None:
    rows = [["t", "U"], *ROWS]
    book = changed(
        xlsx({"Old": rows, "New": [["t", "U"], [0, 5], [1, 6]]}),
        ('name="Old"', 'name="Old" state="hidden"'),
    )
    assert read(tmp_path, book, "U").columns["U"].tolist() == [5.0, 6.0]
    assert read(tmp_path, book, "U", sheet="Old").columns["U"].tolist() == [1.0, 2.0, 3.0]
    book = changed(xlsx({"Old": rows, "New": []}), ('name="Old"', 'name="Old" state="hidden"'))
    with pytest.raises(InputError, match="--sheet NAME reads a hidden sheet"):
        read(tmp_path, book, "U")


@BOTH
def test_columns_of_dates_and_single_columns_are_tables(tmp_path: Path, make: Make) -> None:
    dates = [[datetime(2024, 3, 5, 10, minute), 1.0 + minute] for minute in range(3)]
    notes: Cells = [["Measured on"], ["Friday", 5]]
    table = read(tmp_path, make({"Notes": notes, "A": [["when", "U"], *dates]}), "when", "U")
    assert table.columns["when"].tolist() == [0.0, 60.0, 120.0]
    table = read(tmp_path, make({"Notes": notes, "A": [["U"], [1.5], [2.5]]}), "U")
    assert table.columns["U"].tolist() == [1.5, 2.5]


@BOTH
def test_formulas_that_were_never_computed_are_called_so(tmp_path: Path, make: Make) -> None:
    formulas = [[Formula(f"{i}+1", None), Formula(f"{i}+2", None)] for i in range(3)]
    with pytest.raises(InputError, match="but formulas that were never computed: open"):
        read(tmp_path, make({"A": [["t", "U"], *formulas]}), "U")
    book = make({"A": [["t", "U", "W"], *([*row, Formula("A1/2", None)] for row in ROWS)]})
    assert read(tmp_path, book, "U").unread == ("t", "W")
    with pytest.raises(
        InputError, match=r":2: 'W' must be a number, not a formula that was never .*C2"
    ):
        read(tmp_path, book, "W")


@pytest.mark.parametrize("text", ["Err:502", "#DIV/0!"])
def test_an_error_called_the_number_0_is_refused_where_it_is_read_and_comments_are_not(
    tmp_path: Path, text: str
) -> None:
    book = changed(
        ods({"A": [["t", "U", "W"], *([*row, 77.25] for row in ROWS)]}),
        ('"77.25"><text:p>77,25', f'"0"><text:p>{text}'),
        (
            '"3.0"><text:p>',
            '"3.0"><office:annotation><text:p># checked</text:p></office:annotation><text:p>',
        ),
    )
    np.testing.assert_array_equal(read(tmp_path, book, "U").columns["U"], [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match=rf"a.ods:2: 'W' must be a number .*C2\): {text}"):
        read(tmp_path, book, "W")
