"""Columns whose cells are not plain numbers: with units, with uncertainties, dates and times.  They
become columns of plain numbers, and what was assumed is reported.

Nothing is rounded: numbers stay as they are written; those that are computed here are written
without a decimal mark (2.5 as 25e-1), so that they do not show which mark the others have.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from decimal import Decimal
from itertools import pairwise

from estim.common import InputError, in_unit, is_unit, phrase, require_clear_share, same_numbers
from estim.reading.cells import Row, is_missing, looks_like_a_number
from estim.reading.dialect import bare_name, is_uncertainty, uncertainty_of
from estim.reading.table import Layout

_NUMBER = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)"
_QUANTITY = re.compile(
    rf"(\()?\s*({_NUMBER}(?:[eE][+-]?\d{{1,3}})?)\s*"
    rf"(?:\((\d+(?:[.,]\d+)?)\)|(?:±|\+/?-)\s*({_NUMBER}(?:[eE][+-]?\d{{1,3}})?))?\s*"
    r"(?(1)\))\s*([eE][+-]?\d{1,3}(?!\w))?\s*([^\s\d(].{0,19})?",
    re.ASCII,
)
_MOMENT = re.compile(
    r"(?:(?P<y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)"
    r"|(?P<first>\d\d?)(?P<mark>[./-])(?P<second>\d\d?)(?P=mark)(?P<year>\d{4}))?(?:[T,]?\s*)"
    r"(?:(?P<hour>\d{1,3}):(?P<minute>[0-5]\d)(?::(?P<s>[0-5]\d(?:[.,]\d{1,12})?))?"
    r"\s*(?P<half>[AP]\.?M\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?)?",
    re.ASCII | re.IGNORECASE,
)
_DAY = 86400


def holds_a_value(cell: str) -> bool:
    """Whether a cell holds a number, a quantity with a unit or an uncertainty, a date or a time."""
    return looks_like_a_number(cell) or _quantity(cell) is not None or _moment(cell) is not None


def in_plain_numbers(table: Layout) -> Layout:
    """The table with numbers in the columns of quantities, dates and times; of quantities with
    uncertainties, these in further columns u_NAME.  Rows have a cell for each column, or are left
    for their reader to refuse.

    Columns that are not written in one format stay as they are, and are `refused`.
    """
    width, dates = len(table.names), -1
    for index in reversed(range(width)):
        cells = [
            (row.number, row.cells[index])
            for row in table.rows
            if len(row.cells) >= width and not is_missing(row.cells[index])
        ]
        ends = [cells[0][1], cells[-1][1]] if cells else []
        name = table.names[index]
        if name.startswith("_") or index == dates or all(map(looks_like_a_number, ends)):
            continue
        try:
            if all(_quantity(cell) for cell in ends):
                table = _quantities(table, index, cells)
            elif all(_moment(cell) for cell in ends):
                before = _dates_before(table, index, cells)
                table = _moments(table, index, cells, before)
                dates = index - 1 if before else dates
            elif (
                table.units[index]
                and all(_QUANTITY.fullmatch(cell) for cell in ends)
                and not all(map(holds_a_value, ends))
            ):
                number, cell = next(pair for pair in cells if not holds_a_value(pair[1]))
                rule = f"must be in the unit of its header, {table.units[index]}, or numbers alone"
                raise InputError(rule, field=name, value=cell, line=number)
        except InputError as error:
            table = replace(table, refused={**table.refused, name: error})
    return table


def _quantity(cell: str) -> re.Match[str] | None:
    """The parts of a number with a unit or an uncertainty."""
    match = _QUANTITY.fullmatch(cell)
    if match is None or (match[6] and not is_unit(match[6].strip("[]() "))):
        return None
    return match if match[3] or match[4] or match[6] else None


def _quantities(table: Layout, index: int, cells: Sequence[tuple[int, str]]) -> Layout:
    name, stated = table.names[index], table.units[index]
    values = dict[int, list[str]]()
    unit, with_u, differences = stated, None, is_uncertainty(bare_name(name))
    for number, cell in cells:
        require_clear_share(cell, field=name, line=number)
        match = _quantity(cell)
        with_this = match is not None and bool(match[3] or match[4])
        unit_here = match[6].strip("[]() ") if match is not None and match[6] else stated
        with_u = with_this if with_u is None else with_u
        unit = unit or unit_here
        if match is None or with_this != with_u or not _same(unit_here, unit, differences):
            rule = (
                "must be written like the cells above it: all with an uncertainty or none, all "
                f"with a unit or none{f', and in {unit}' if unit else ''}"
            )
            raise InputError(rule, field=name, value=cell, line=number)
        _, value, digits, plus_minus, power, _ = match.groups()
        values[number] = [value + (power or "")]
        if digits:
            values[number].append(_last_digits(value, digits, power or ""))
        elif plus_minus:
            values[number].append(plus_minus + (power or ""))
    notes = []
    if unit and not stated:
        notes.append(
            phrase("the values of '{name}' are in {unit}, as its cells say", name=name, unit=unit)
        )
    if not with_u:
        return _replaced(table, index, values, unit, notes)
    if (column := uncertainty_of(name, table.names)) is not None:
        rule = "has uncertainties in its cells, and a column of their own as well"
        raise InputError(rule, field=name, value=column, line=cells[0][0])
    notes.append(phrase("the cells of '{name}' hold its standard uncertainties", name=name))
    return _replaced(table, index, values, unit, notes, (f"u_{bare_name(name)}",))


def _same(unit: str, other: str, differences: bool) -> bool:
    """Whether numbers in two units are the same, and not only may be."""
    if unit == other:
        return True
    same = same_numbers(unit, other, differences=differences)
    return same is True and in_unit(1.0, unit, other) in (1.0, None)


def _last_digits(value: str, digits: str, power: str) -> str:
    """The uncertainty that (12) means after 1.234 and before a power: 12e-3, 12e-6 before e-3."""
    if "." in digits or "," in digits:
        return digits + power
    mantissa, _, exponent = value.lower().partition("e")
    decimals = len(mantissa.replace(",", ".").partition(".")[2])
    return f"{digits}e{int(exponent or 0) + int(power[1:] or 0) - decimals}"


def _without_mark(value: Decimal) -> str:
    sign, digits, exponent = value.as_tuple()
    return f"{'-' * sign}{''.join(map(str, digits))}e{exponent}"


def _replaced(
    table: Layout,
    index: int,
    values: Mapping[int, Sequence[str]],
    unit: str,
    notes: Sequence[str],
    further: tuple[str, ...] = (),
) -> Layout:
    """The table with other cells in the column at `index`, and in columns called `further` behind
    all others.  values : line -> its cells.
    """
    width = len(table.names)

    def with_cells(row: Row) -> Row:
        blank = (row.cells[index], *[""] * len(further))
        cell, *further_cells = values.get(row.number, blank)
        return row._replace(
            cells=[*row.cells[:index], cell, *row.cells[index + 1 : width], *further_cells]
        )

    return replace(
        table,
        names=(*table.names, *further),
        units=(*table.units[:index], unit, *table.units[index + 1 :], *[unit] * len(further)),
        rows=[
            row if len(row.cells) < width or any(row.cells[width:]) else with_cells(row)
            for row in table.rows
        ],
        assumed=(*table.assumed, *notes),
    )


def _moment(cell: str) -> re.Match[str] | None:
    """The parts of a date, a time or both."""
    match = _MOMENT.fullmatch(cell.strip())
    if match is None or (match["y"] is None and match["first"] is None and match["s"] is None):
        return None
    return match


def _dates_before(table: Layout, index: int, cells: Sequence[tuple[int, str]]) -> dict[int, str]:
    """Line -> date, of the column before one of times alone, where that holds dates."""
    date_of_line = {
        row.number: row.cells[index - 1] for row in table.rows if len(row.cells) > index > 0
    }
    for number, cell in (cells[0], cells[-1]):
        day, time = _moment(date_of_line.get(number, "")), _moment(cell)
        if time is None or time["y"] or time["first"] or day is None or day["hour"] is not None:
            return {}
    return date_of_line


def _moments(
    table: Layout, index: int, cells: Sequence[tuple[int, str]], before: dict[int, str]
) -> Layout:
    """The table with a column of seconds, or of the stated unit, in the place of dates or times.

    before : line -> its date, where that stands in the column before; else empty.
    """
    name, notes, dialect = table.names[index], [], table.dialect
    if before:
        date_name = table.names[index - 1]
        notes.append(
            phrase("'{date}' and '{time}' are read as one time", date=date_name, time=name)
        )
    matches = [
        (number, cell, _moment(cell))
        for number, time in cells
        for cell in [f"{before.get(number, '')} {time}".strip()]
    ]
    order = _order(name, matches, dialect.dates)
    moments = [
        (number, *_seconds(name, number, cell, match, order)) for number, cell, match in matches
    ]
    kinds = {kind for _, kind, _ in moments}
    if len(kinds) > 1:
        number, cell = next(
            (number, cell)
            for (number, cell, _), (_, kind, _) in zip(matches, moments, strict=True)
            if kind != moments[0][1]
        )
        rule = "must be written like the first one: all with a date or none, a zone or none"
        raise InputError(rule, field=name, value=cell, line=number)
    kind, origin, shown = moments[0][1], moments[0][2], matches[0][1]
    step_back = next((i for i, (a, b) in enumerate(pairwise(moments), 1) if b[2] < a[2]), None)
    if kind == "time" and step_back is not None:
        rule = "goes back: past midnight times need dates, in the cell or in a column before it"
        raise InputError(rule, field=name, value=matches[step_back][1], line=matches[step_back][0])
    if dialect.since is not None:
        match = _moment(dialect.since)
        if match is None or match["first"]:
            rule = "must be written as 2024-03-05 10:15:30, or 10:15:30"
            raise InputError(rule, field="since", value=dialect.since)
        since_kind, origin = _seconds("since", 0, dialect.since, match, "dmy")
        if since_kind != kind:
            rule = "must have a date and a zone where the column has them, and only there"
            raise InputError(rule, field="since", value=dialect.since)
        shown = dialect.since
    unit = dialect.time_unit or "s"
    factor = Decimal(repr(in_unit(1.0, unit, "s")))
    values = {number: [_without_mark((at - origin) / factor)] for number, _, at in moments}
    mark = next((match["mark"] for _, _, match in matches if match and match["mark"]), "")
    words = {
        "dmy": phrase(", dates read as day{mark}month{mark}year", mark=mark),
        "mdy": phrase(", dates read as month{mark}day{mark}year", mark=mark),
        "": "",
    }
    notes.append(
        phrase(
            "'{name}' is in {unit} since {moment}{order}",
            name=name,
            unit=unit,
            moment=shown,
            order=words[order],
        )
    )
    read = replace(table, moments=(*table.moments, name))
    return _replaced(read, index, values, unit, notes)


def _order(
    name: str, matches: Sequence[tuple[int, str, re.Match[str] | None]], stated: str | None
) -> str:
    """dmy or mdy, "" where years come first.  Raises InputError where the dates do not show it."""
    written_first = [
        (number, cell, match) for number, cell, match in matches if match and match["first"]
    ]
    if not written_first:
        return ""
    if stated is not None:
        return stated
    number, cell, match = written_first[0]
    if match["mark"] == ".":
        return "dmy"
    days = {
        order
        for _, _, match in written_first
        for order, key in (("dmy", "first"), ("mdy", "second"))
        if int(match[key]) > 12
    }
    if len(days) != 1:
        raise InputError(
            "may be day/month or month/day: say --dates dmy or mdy (dates = ... in a campaign)",
            field=name,
            value=cell,
            line=number,
        )
    return days.pop()


def _seconds(
    name: str, number: int, cell: str, match: re.Match[str] | None, order: str
) -> tuple[str, Decimal]:
    """What a moment is, "date", "zone" (with its zone) or "time" (of a day), and its seconds."""
    if match is None:
        raise InputError(
            "must be a date or a time like the first one", field=name, value=cell, line=number
        )
    second = Decimal((match["s"] or "0").replace(",", "."))
    hour, minute = int(match["hour"] or 0), int(match["minute"] or 0)
    if match["half"]:
        hour = hour % 12 + 12 * (match["half"][0].lower() == "p")
    seconds = 3600 * hour + 60 * minute + second
    if match["y"] is None and match["first"] is None:
        return "time", seconds
    parts = (
        [match["y"], match["m"], match["d"]]
        if match["y"]
        else [match["year"], match["second"], match["first"]]
        if order == "dmy"
        else [match["year"], match["first"], match["second"]]
    )
    try:
        if hour > 23:
            raise ValueError
        days = date(*map(int, parts)).toordinal()
    except ValueError:
        raise InputError(
            "is no date of the calendar", field=name, value=cell, line=number
        ) from None
    zone = match["zone"]
    if zone is None:
        return "date", days * _DAY + seconds
    sign = -1 if zone.startswith("-") else 1
    digits = "".join(mark for mark in zone if mark.isdecimal()) or "0000"
    offset = sign * (3600 * int(digits[:2]) + 60 * int(digits[2:]))
    return "zone", days * _DAY + seconds - offset
