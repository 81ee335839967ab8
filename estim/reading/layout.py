"""Where the numbers of a table are: the line of names, a line of units, the first row, what stands
above them.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import fsum
from pathlib import Path

from estim.common import InputError, in_its_file, is_unit, phrase
from estim.reading.cell_formats import holds_a_value, in_plain_numbers
from estim.reading.cells import (
    Row,
    is_comment,
    is_formula,
    is_missing,
    is_spreadsheet_error,
    looks_like_a_number,
)
from estim.reading.dialect import (
    Dialect,
    bare_name,
    is_uncertainty,
    name_and_unit,
    names_and_units,
    shown_delimiter,
)
from estim.reading.source import read_source
from estim.reading.table import (
    NOTE,
    Layout,
    Lines,
    facts_of,
    line_numbers,
    numbered_lines,
    split_cells,
)

_ONE_COLUMN = ";"  # stands in no row then
_RULE = re.compile(r"[-=_+|\s]+")  # a line drawn below the header
# in a line of units, beside those whose size is known
_FURTHER_UNITS = {"px", "frame", "frames", "count", "counts", "arb", "a.u.", "au", "dB"}
_NO_UNIT = {"1", "-", "--", "–", "—", "dimensionless", "unitless", "none", "n/a"}
_NUMBER_FIRST = re.compile(r"(?!1\s*/|10\s*[\^⁻⁰¹²³⁴⁵⁶⁷⁸⁹])[+-]?[.,]?\d")  # but 1/s, 10^-3 N
_THOUSANDS = {  # under a stated decimal mark
    decimal: re.compile(rf"[+-]?[1-9]\d{{0,2}}({marks})\d{{3}}(\1\d{{3}})*{mark}\d*", re.ASCII)
    for decimal, marks, mark in (("comma", r"[. '\u00a0\u202f]", ","), ("point", "[, ']", r"\."))
}
_BEGINS_WITH_A_NUMBER = re.compile(r"\W{0,3}\d")
_MEANT_AS_A_NUMBER = re.compile(r"[^\w#]{0,3}\d[\W\dxXeE]*")  # ~1, 1/2, 2x10^3, 1 234
_BEGINS_WITH_A_WORD = re.compile(r"\W{0,9}[^\W\d_]{2}")  # or as >>>>>End of data
_COMMENT = re.compile(r"comments?", re.IGNORECASE)  # LabVIEW names a column that has no cells
_OF_SUMS = (
    "mean average avg median sum total stdev stddev mittelwert mittel summe gesamt durchschnitt "
    "standardabweichung media promedio mediana suma moyenne somme std sd sem stabw stabwn "
    "std.dev. variance varianz min max minimum maximum mín máx"
)
_SUMS = {
    *_OF_SUMS.split(),
    "mean value",
    "standard deviation",
    "standard error",
    "std dev",
    "std. dev.",
    "st. dev.",
    "desviación estándar",
}
_LONG_WORD = re.compile(r"[^\W\d_]{3}")
_LETTER = re.compile(r"[^\W\d_]")
_NAMED_BY_A_NUMBER = re.compile(  # 10 periods (s), 2θ (°), 1/T (1/K), 1/T
    r"(\d[^()\[\]]{0,40}[^\W\d_][^()\[\]]{0,40})[(\[]([^()\[\]]{1,19})[)\]]"
    r"|1\s*/\s*[^\W\d_]\w{0,9}"
)


@in_its_file
def read_layout(path: Path, dialect: Dialect) -> Layout:
    """How the table at `path` is laid out.  Raises InputError, also where the columns have no
    names.
    """
    source = read_source(path, dialect)
    lines = numbered_lines(source.text)
    inside, columns = dialect.within
    below = [
        (number, line)
        for number, line in lines
        if number > (dialect.skip_rows or 0) and number in inside
    ]
    table_lines, footer = _footer(
        [(number, line) for number, line in below if not is_comment(line)]
    )
    if not table_lines:
        raise InputError(
            "has no rows of numbers"
            + (" below the lines that are skipped" if dialect.skip_rows else "")
        )
    delimiter = (
        dialect.mark
        or source.delimiter
        or (
            _ONE_COLUMN
            if _is_one_column(table_lines, dialect)
            else shown_delimiter(*_of_cells(table_lines)[-2:], head=table_lines[0][1])
        )
    )
    split, ends = (
        [Row(number, line, _cells(line, delimiter)[columns]) for number, line in part]
        for part in (table_lines, footer)
    )
    facts = list(source.facts)
    if any(_is_a_row(row, like=split[-1]) for row in ends):
        split += ends
        ends = []
    if dialect.columns is None and _is_transposed(split):
        split = _transposed(split)
        facts.append(phrase("names of the columns stand in the first cell of each line"))
    else:
        split, sums = _without_sums(split)
        ends = [*sums, *ends]
    split = [row._replace(cells=_without_thousands(row.cells, dialect)) for row in split]
    start = _start(split, delimiter)
    above = split[:start]
    percent = any(row.line.lstrip().startswith("%") for row in above)
    rows = [row for row in split[start:] if not (percent and row.line.lstrip().startswith("%"))]
    heads = [
        cells
        for row in above
        if len(cells := _trimmed(row.cells)) > 1 and not any(map(holds_a_value, cells))
    ]
    repeated = [row for row in rows if _trimmed(row.cells) in heads]
    if repeated:
        rows = [row for row in rows if row not in repeated]
        same = line_numbers([row.number for row in repeated])
        facts.append(
            phrase("lines that repeat the head of the table were not read ({lines})", lines=same)
        )
    if _is_last_apart(rows, lines):
        if _sums_up(rows):
            ends = [rows.pop(), *ends]
        else:
            facts.append(
                phrase(
                    "line {line} stands apart, below an empty line, and is read like those above",
                    line=rows[-1].number,
                )
            )
    if ends:
        below_it = line_numbers([row.number for row in ends])
        facts.append(
            phrase(
                "what stands below the table was not read (line {lines})"
                if len(ends) == 1
                else "what stands below the table was not read (lines {lines})",
                lines=below_it,
            )
        )
    names, header_line, units = _header(above, below, rows, delimiter, dialect)
    if not names:
        for width in [n for row in above if (n := len(_trimmed(row.cells))) > 1]:
            odd = [row for row in rows if len(_trimmed(row.cells)) != width]
            # one row among many, or decimal commas that part cells
            if odd and (
                2 * len(odd) < len(rows) or (delimiter, 2 * width) == (",", len(odd[0].cells))
            ):
                raise cells_differ(odd[0], width, delimiter)
        raise _no_names(rows[0], delimiter)
    head = facts_of(lines, header_line or rows[0].number)
    units = [
        _unit_in(unit) or own
        for (_, own), unit in zip(
            names_and_units(names), [*units, *[""] * len(names)], strict=False
        )
    ]
    layout = Layout(
        str(path),
        source.sha256,
        dialect,
        delimiter,
        names,
        header_line,
        tuple(units),
        rows,
        tuple(line[len(NOTE) :].strip() for _, line in lines if line.startswith(NOTE)),
        head,
        columns.start if source.delimiter or dialect.range else None,
        tuple(facts),
    )
    return in_plain_numbers(layout)


def _of_cells(lines: Lines) -> list[str]:
    """The lines without those that are one number alone, where these are the fewer ones: they lack
    cells, and do not show what parts them.
    """
    parted = [text for _, text in lines if "," in text or not looks_like_a_number(text.strip())]
    return parted if 2 * len(parted) > len(lines) else [text for _, text in lines]


def _footer(lines: Lines) -> tuple[Lines, Lines]:
    """The lines, and those below the last one that begins with a number, where at least half of all
    lines do, and those below begin with words.
    """
    numbers = [i for i, (_, line) in enumerate(lines) if _BEGINS_WITH_A_NUMBER.match(line)]
    end = numbers[-1] + 1 if 2 * len(numbers) >= len(lines) > 0 else len(lines)
    words = all(
        _BEGINS_WITH_A_WORD.match(line)
        and not is_missing(re.split(r"[\t;,|]", line)[0].strip(' "'))
        for _, line in lines[end:]
    )
    return (lines[:end], lines[end:]) if words else (lines, [])


def _without_sums(rows: list[Row]) -> tuple[list[Row], list[Row]]:
    """The rows, and those at the end that are labelled as the mean, the sum and so on of the
    others, where no other row is.

    Raises InputError where such a label stands among others and may be that of a reading.
    """
    words = [_sum_word(row) for row in rows]
    end = next((i for i, word in enumerate(words) if word), len(rows))
    last = words[end:]
    if not all(last) or len(set(last)) < len(last) or 2 * end <= len(rows):
        return rows, []
    for row, word in zip(rows[end:], last, strict=True):
        place = [cell.strip(" :=").casefold() for cell in row.cells].index(word)
        above = [other.cells[place : place + 1] for other in rows[:end]]
        if 2 * sum(any(map(looks_like_a_number, cells)) for cells in above) < len(above):
            rule = (
                f"may be a reading, or the {word} of those above it: put a # before the line, or "
                "give the reading another name"
            )
            raise InputError(rule, field="row", value=row.line.strip(), line=row.number)
    return rows[:end], rows[end:]


def _sum_word(row: Row) -> str:
    """The label of a row with a value, if it is mean, sum and so on."""
    words = (cell.strip(" :=").casefold() for cell in row.cells)
    word = next((word for word in words if word in _SUMS), "")
    return word if any(map(holds_a_value, row.cells)) else ""


def _is_last_apart(rows: Sequence[Row], lines: Lines) -> bool:
    """Whether no row but the last one stands below an empty line.  lines : all that are not."""
    first, last = rows[0].number, rows[-1].number
    pairs = pairwise(number for number, _ in lines if first <= number <= last)
    return len(rows) > 3 and [below for above, below in pairs if below > above + 1] == [last]


def _sums_up(rows: Sequence[Row]) -> bool:
    """Whether each number of the last row is the sum of those above it, or each is their mean."""
    columns = [
        [float(cell.replace(",", ".")) for cell in cells]
        for i, last in enumerate(rows[-1].cells)
        for cells in [[cell for row in rows for cell in row.cells[i : i + 1] if cell]]
        if last and all(map(looks_like_a_number, cells))
    ]
    return any(
        all(
            abs(fsum(above) / (len(above) if mean else 1) - last) <= 1e-9 * max(map(abs, above))
            and len({*above}) > 1
            for *above, last in columns
        )
        for mean in (False, True)
        if columns
    )


def _is_a_row(row: Row, *, like: Row) -> bool:
    """Whether a line below the table has its cells, with a number in one: such a line is a row,
    whatever its first cell is called, unless that announces what follows: "Exposure time:".
    """
    return (
        len(_trimmed(row.cells)) == len(_trimmed(like.cells))
        and any(map(holds_a_value, row.cells))
        and not row.cells[0].endswith(":")
    )


def _is_transposed(rows: Sequence[Row]) -> bool:
    """Whether columns lie on their side: each line is a name, perhaps its unit, and more values
    than there are lines.
    """
    names = [cell for row in rows for cell in row.cells[:1]]
    return (
        1 < len(rows) == len(set(names))
        and not any(holds_a_value(name) or is_missing(name) for name in names)
        and all(
            len(values) > max(2, len(rows))
            and all(holds_a_value(cell) or is_missing(cell) for cell in values)
            for row in rows
            for values in [_trimmed(row.cells)[1:]]
        )
    )


def _transposed(rows: Sequence[Row]) -> list[Row]:
    """Rows of such a table, numbered from left to right."""
    width = max(len(_trimmed(row.cells)) for row in rows)
    cells = [[*row.cells, *[""] * width][:width] for row in rows]
    return [Row(i, "\t".join(row), list(row)) for i, row in enumerate(zip(*cells, strict=True), 1)]


def _without_thousands(cells: list[str], dialect: Dialect) -> list[str]:
    """Cells without marks between thousands, where the decimal mark is stated and a number has
    both: 1.234,5.  Alone, 1.234 shows nothing, and is left as it is.
    """
    grouped = _THOUSANDS.get(dialect.decimal or "")
    if grouped is None:
        return cells
    return [
        cell.replace(match[1], "") if (match := grouped.fullmatch(cell)) else cell for cell in cells
    ]


def _is_one_column(lines: Lines, dialect: Dialect) -> bool:
    """Whether each row is one value, as a name with its unit above them shows, `t (s)` or `t in s`;
    or the last one is, and the comma is the decimal mark.
    """
    above = [line for _, line in lines if not holds_a_value(line.strip())]
    if lines[-1][1] in above[-1:]:
        return False
    named = len(above) == 1 and "," not in above[0] and is_unit(name_and_unit(above[0])[1])
    return named or dialect.decimal == "comma"


def _no_names(first: Row, delimiter: str) -> InputError:
    """The error for a table whose columns have no names."""
    rule = (
        f"has no line of column names: name all {len(first.cells)} from left to right (--columns "
        "a,b,...; columns = [...] in a campaign)"
    )
    if delimiter == ",":
        rule += (
            "; the comma is taken to part the cells: if it is the decimal mark, say --decimal "
            'comma (decimal = "comma" in a campaign)'
        )
    return InputError(rule, field="header", value=first.line.strip(), line=first.number)


def numeric_columns(layout: Layout) -> tuple[str, ...]:
    """Names of the columns that hold numbers, in the first or the last row, or in at least half of
    their cells; those that begin with _ left out.  What is meant as a number counts as one: where
    the column is read, it is refused, and no other column takes its place.
    """
    named = [(i, name) for i, name in enumerate(layout.names) if name and not name.startswith("_")]
    return tuple(name for i, name in named if name in layout.refused or _is_numeric(layout.rows, i))


def _is_numeric(rows: Sequence[Row], column: int) -> bool:
    def number(cell: str) -> bool:
        return (
            _MEANT_AS_A_NUMBER.fullmatch(cell) is not None
            or holds_a_value(cell)
            or is_formula(cell)
        )

    ends = [row.cells[column : column + 1] for row in (*rows[:1], *rows[-1:])]
    if any(number(cell) for cells in ends for cell in cells):
        return True
    numbers = [
        number(cell)
        for row in rows
        for cell in row.cells[column : column + 1]
        if not is_missing(cell) and not is_spreadsheet_error(cell)
    ]
    return any(numbers) and 2 * sum(numbers) >= len(numbers)


def value_columns(layout: Layout, errors: Sequence[str | None]) -> tuple[str, ...]:
    """The columns of numbers that are not called as uncertainties, nor named as such in
    `errors`.
    """
    own = {f"u({name})" for name, _ in names_and_units(layout.names)}
    return tuple(
        name
        for name in numeric_columns(layout)
        if not (is_uncertainty(bare_name(name)) or name in own)
        and not {name, bare_name(name)} & {*errors}
    )


def first_and_second(columns: Sequence[str]) -> tuple[str, str] | None:
    """x and y of a table of two columns: as they are called where that is x and y, else from left
    to right.

    None where there are not two, and where the first is called y and the second not x.
    """
    if len(columns) != 2:
        return None
    first, second = columns
    if is_called(first, "y"):
        return (second, first) if is_called(second, "x") else None
    return first, second


def are_components(columns: Sequence[str]) -> bool:
    """Whether columns of values are called x, y and z beside others: of a vector at each time, so
    that x and y are no abscissa and ordinate.
    """
    return {"x", "y", "z"} < {bare_name(name).lower() for name in columns}


def is_called(column: str, letter: str) -> bool:
    """Whether a column is called x, X, x_m or x [m], for the letter x."""
    return bare_name(column).partition("_")[0].lower() == letter


def _start(rows: Sequence[Row], delimiter: str) -> int:
    """Index of the first row of numbers: like the last row it has as many cells, with numbers (or
    nothing) in the same columns.

    Raises InputError where rows above it look like data.
    """
    last = rows[-1]
    shape = _shape(last.cells)
    checks = {
        index: looks_like_a_number if looks_like_a_number(cell) else holds_a_value
        for index, cell in enumerate(last.cells)
        if holds_a_value(cell)
    }
    for first, row in enumerate(rows):  # noqa: B007
        fits = shape & _shape(row.cells) and all(
            check(cell) or is_missing(cell)
            for index, check in checks.items()
            for cell in row.cells[index : index + 1]
        )
        if fits and any(map(holds_a_value, row.cells)):
            break
    else:
        rule = "must hold cells that are numbers, alone or with their unit: the last line has none"
        raise InputError(rule, field="row", value=last.line, line=last.number)
    while first and _is_blank(rows[first - 1], shape):
        first -= 1
    odd = [
        row
        for row in rows[:first]
        if sum(map(bool, row.cells)) > 1 and all(map(looks_like_a_number, filter(None, row.cells)))
    ]
    if len(odd) > len(rows) - first:
        raise cells_differ(rows[first], len(odd[0].cells), delimiter)
    if odd:
        rule = (
            "is a row with another number of cells than the last one: say how many lines "
            "stand above the table (--skip-rows; skip_rows = ... in a campaign)"
        )
        raise InputError(rule, field="row", value=odd[0].line, line=odd[0].number)
    return first


def _is_blank(row: Row, shape: set[int]) -> bool:
    """Whether a line is a row in which no cell has a value."""
    return (
        bool(shape & _shape(row.cells))
        and not _RULE.fullmatch(row.line)
        and all(map(is_missing, row.cells))
    )


def _shape(cells: list[str]) -> set[int]:
    """Number of cells of a line, with and without blank ones at its end."""
    return {len(cells), len(_trimmed(cells))}


def _cells(line: str, delimiter: str) -> list[str]:
    """Cells of a line that need not be a row; one cell where it cannot be split."""
    try:
        return split_cells(line, delimiter)
    except csv.Error:
        return [line]


def _trimmed(cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _header(
    above: Sequence[Row], below: Lines, rows: Sequence[Row], delimiter: str, dialect: Dialect
) -> tuple[tuple[str, ...], int | None, list[str]]:
    """Names of the columns, their line, and the cells of a line of units below it.  above : lines
    over the numbers, which stand in `rows`; below : all lines with comments.
    """
    # most cells that a row has, without and with blank ones at its end
    columns = dialect.within[1]
    least = max(len(_trimmed(row.cells)) for row in rows)
    most = max(len(row.cells) for row in rows)

    def fits(cells: Sequence[str]) -> bool:
        return least <= len(cells) <= most

    def are_names(cells: Sequence[str]) -> bool:
        return fits(cells) and not any(map(looks_like_a_number, cells))

    if above:
        _refuse_half_a_row(above, fits)
    if dialect.columns is not None:
        if not fits(dialect.columns):
            raise InputError(
                f"must name all {least} columns from left to right",
                field="columns",
                value=", ".join(dialect.columns),
                line=rows[0].number,
            )
        return dialect.columns, None, []
    units: list[str] = []
    for i, (number, line, untrimmed) in reversed(list(enumerate(above))):
        percent = line.lstrip().startswith("%")
        cells = _trimmed(
            _cells(line.strip().lstrip("% "), delimiter)[columns] if percent else untrimmed
        )
        if len(cells) == most + 1 and _COMMENT.fullmatch(cells[-1]):
            del cells[-1]
        if _RULE.fullmatch(line) or (percent and not are_names(cells)):
            continue
        over = _trimmed(above[i - 1].cells) if i else []
        if not units and fits(over) and fits(untrimmed) and _are_units(untrimmed):
            units = untrimmed
            continue
        return (tuple(cells), number, units) if are_names(cells) else ((), None, [])
    comments = [
        (number, line.lstrip("# \t").rstrip())
        for number, line in below
        if number < rows[0].number and is_comment(line) and line.strip("# \t")
    ]
    for number, line in comments[-1:]:
        if are_names(cells := _cells(line, delimiter)[columns]):
            return tuple(cells), number, []
    return (), None, []


def _refuse_half_a_row(above: Sequence[Row], fits: Callable[[Sequence[str]], bool]) -> None:
    """Raises InputError where the line over the first row looks like one more, with something in it
    that is no number.
    """
    drawn = Row(0, "", [])
    number, line, cells = next(
        (row for row in reversed(above) if not _RULE.fullmatch(row.line)), drawn
    )
    cells = _trimmed(cells)
    if not fits(cells) or line.lstrip().startswith("%") or _are_units(cells):
        return
    if any(
        is_spreadsheet_error(cell)
        or (re.match(r"[+-]?[.,]?\d", cell) and not _is_named_by_a_number(cell))
        for cell in cells
    ):
        raise InputError(
            "must be a row of numbers, like those below it, or of names, which begin with a "
            "letter (if it is neither: --skip-rows; skip_rows = ... in a campaign)",
            field="row",
            value=line,
            line=number,
        )


def _is_named_by_a_number(cell: str) -> bool:
    """Whether a cell that begins with a number is a name: with its unit, or an inverse."""
    match = _NAMED_BY_A_NUMBER.fullmatch(cell)
    return match is not None and (
        match[2] is None
        or is_unit(match[2].strip())
        or bool(_LONG_WORD.search(match[1]) and _LETTER.search(match[2]))
    )


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line below the names holds units alone."""
    units = {*map(_unit_in, cells)} - {"", "1"}
    known = all(
        unit in _FURTHER_UNITS
        or (is_unit(unit) and unit != "t" and not _NUMBER_FIRST.match(unit))  # t is rather a name
        for unit in units
    )
    return known and any(cell not in ("", "1") for cell in cells)


def _unit_in(cell: str) -> str:
    """The unit in a cell below a name, without brackets; "1" for a pure number."""
    unit = cell.strip("()[] ")
    return "1" if unit.lower() in _NO_UNIT else unit


def cells_differ(row: Row, width: int, delimiter: str) -> InputError:
    """The error for a row that has not `width` cells."""
    cells = len(row.cells)
    # a blank last cell has no comma
    commas = delimiter == "," and 2 * width - (width > 2) <= cells <= 2 * width
    hint = ""
    if commas:
        hint = " (decimal commas? write decimal points, or separate the cells by semicolons)"
    elif cells == 1 and _BEGINS_WITH_A_WORD.match(row.line):
        hint = " (a remark? Put a # before it)"
    rule = f"must have {width} cells, not {cells}{hint}"
    return InputError(rule, field="row", value=row.line.strip(), line=row.number)
