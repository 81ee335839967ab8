"""A report of hundreds of runs that stays readable: of a long table or list its beginning, the whole of it in a file beside.

Shared parameters stand first in every table, so they stay.  Reports of a few runs are as they were.
"""

from __future__ import annotations

import csv
import io
import re
import unicodedata

from estim.common import phrase

MOST_ROWS, MOST_COLUMNS, MOST_POINTS = 150, 60, 60
_ROWS, _COLUMNS, _POINTS = 24, 12, 12  # what is kept of a longer one
_CELLS = re.compile(r"(?<!\\)\|")


def shortened(text: str) -> dict[str, bytes]:
    """`report.md` of a report in Markdown, and the files with what was taken out of it."""
    files: dict[str, bytes] = {}
    told: list[str] = []
    title, coded, lines = "report", False, text.split("\n")
    i = 0
    while i < len(lines):
        line = lines[i]
        coded ^= line.startswith("```")
        if line.startswith("#") and not coded:
            title = re.sub(r"[^a-z0-9]+", "-", unicodedata.normalize("NFKD", line.lower()).encode("ascii", "ignore").decode()).strip("-") or "table"
        end = i
        while not coded and end < len(lines) and lines[end].startswith("|"):
            end += 1
        if end > i:
            told += _table(lines[i:end], _name(files, title, "csv"), files)
        elif not coded and line.startswith("- "):
            end = _list_end(lines, i)
            told += _list(lines[i:end], _name(files, title, "md"), files)
        else:
            told.append(line)
            end = i + 1
        i = end
    return {"report.md": "\n".join(told).encode(), **files}


def _name(files: dict[str, bytes], title: str, kind: str) -> str:
    """A path that is still free."""
    name, n = f"tables/{title}.{kind}", 2
    while name in files:
        name, n = f"tables/{title}-{n}.{kind}", n + 1
    return name


def _cells(row: str) -> list[str]:
    return [cell.strip().replace("\\|", "|") for cell in _CELLS.split(row)[1:-1]]


def _table(rows: list[str], path: str, files: dict[str, bytes]) -> list[str]:
    n_row, n_column = len(rows) - 2, len(_CELLS.split(rows[0])) - 2
    if n_row <= MOST_ROWS and n_column <= MOST_COLUMNS:
        return rows
    whole = io.StringIO()
    csv.writer(whole, lineterminator="\n").writerows(_cells(row) for row in (rows[0], *rows[2:]))
    files[path] = whole.getvalue().encode()
    kept = rows[: 2 + _ROWS] if n_row > MOST_ROWS else rows
    if n_column > MOST_COLUMNS:
        kept = ["|".join(_CELLS.split(row)[: 1 + _COLUMNS]) + "|" for row in kept]
    return [*kept, "", phrase("All {rows} rows and {columns} columns: `{path}`.", rows=n_row, columns=n_column, path=path)]


def _list_end(lines: list[str], start: int) -> int:
    """Where a list ends: at the first line that is neither a point, nor below one, nor empty between two."""
    end = start
    for i in range(start, len(lines)):
        if lines[i].startswith(("- ", "  ")):
            end = i + 1
        elif lines[i]:
            break
    return end


def _list(lines: list[str], path: str, files: dict[str, bytes]) -> list[str]:
    points = [i for i, line in enumerate(lines) if line.startswith("- ")]
    if len(points) <= MOST_POINTS:
        return lines
    files[path] = ("\n".join(lines) + "\n").encode()
    return [*lines[: points[_POINTS]], "", phrase("All {n} points: `{path}`.", n=len(points), path=path)]
