"""Tables with every kind of slip, read by rules that are stated here once more: a reader gives the
same numbers or refuses.

The oracle shares no code with the reader: lines end as Python's universal newlines have them, cells
are split by `csv`, numbers are decimal literals of ASCII characters.  It says what a table holds,
or that nobody could be sure.
"""

from __future__ import annotations

import csv
import io
import random
import re
from decimal import Decimal, InvalidOperation
from pathlib import Path

import pytest

from estim.common.errors import EstimError
from estim.reading.run import read_run

KNOWN = {"t_s", "x_m", "v_m_s", "theta_rad", "omega_rad_s", "sigma_x_m", "sigma_v_m_s"}
PLAIN = "".join(f"{0.1 * n:.2f},{0.01 * n * n:.4f}\n" for n in range(8))
BASES = (
    "t_s,x_m\n" + PLAIN,
    "# c\n"
    + "t_s,x_m,_n\n".replace(",", ";")
    + "".join(f"{0.1 * n:.2f};{0.01 * n * n:.4f};{n}\n" for n in range(8)),
    ("t_s,x_m,sigma_x_m\n" + PLAIN.replace("\n", ",0.1\n")).replace(",", "\t"),
    "t_s,x_m,_n\n" + "".join(f"{n},{n * n}.0,{n}\n" for n in range(8)),
    "x_m,t_s,v_m_s,_w\r\n"
    + "".join(f'"{0.1 * n * n:.2f}",{n},{0.1 * n:.3e},"a, b"\r\n' for n in range(8)),
    "%t_s\tx_m\n\t%date\n" + PLAIN.replace(",", "\t"),
)
TOKENS = (
    "+1",
    "1e5",
    "0x10",
    "1_000",
    "\uff11",
    "nan",
    "inf",
    "-inf",
    '"1"',
    '"1\n2"',
    '"',
    "'",
    ",",
    ";",
    "\t",
    "|",
    " ",
    "\n",
    "\r",
    "\r\n",
    "\0",
    "\ufeff",
    "\u2028",
    "\x85",
    "\x0b",
    "\x0c",
    "\x1c",
    "#",
    "%",
    "1.5.5",
    "1,5",
    "1.000,5",
    "\u22121",
    "\u00a0",
    "1 000",
    "1'000",
    "1e",
    "e1",
    "1d5",
    "1f",
    "0b1",
    "--1",
    "1e+",
    "\u0661",
    "\u00bd",
    "\u00b2",
    "\u221e",
    "True",
    "None",
    "",
    "-0.0",
    "1E5",
    "1.e3",
    ".5",
    "5.",
    "00012",
    "0.1#c",
    "t_s",
    "x_m",
    "_x",
    "T_S",
    "t_s ",
    "# t_s,x_m\n",
    "1e-400",
    "1e400",
    "1/2",
    "5%",
    "(1)",
    "1\\",
    "=1+1",
    "# c\r",
)


def oracle(data: bytes) -> dict[str, list[float]] | None:
    """The columns that the bytes hold; None where a careful person would not be sure.

    What stands above the line of names is no data.  Blank cells behind the last column are nothing.
    Decimals have a point, or all a comma where commas do not part the cells.
    """
    text = data.decode("utf-8")
    text = text[1:] if text.startswith("\ufeff") else text
    if "\0" in text:
        return None
    header, mark, rows, ended = None, ",", [], False
    comments = ("#",)
    for line in io.StringIO(text, newline=None).read().split("\n"):
        bare = line.strip()
        if (
            not rows
            and (names := _header(bare.lstrip("#% "))) is not None
            and not (header and bare.startswith("#"))
        ):
            comments = ("#", "%") if bare.startswith("%") else ("#",)
            header, mark = names
            continue
        if header is None or not bare or bare.startswith(comments):
            continue
        try:
            cells = (
                line.split()
                if mark == " "
                else [
                    cell.strip() for cell in next(csv.reader([line], delimiter=mark, strict=True))
                ]
            )
        except csv.Error:
            return None
        while len(cells) > len(header) and not cells[-1]:
            cells.pop()
        if cells == header:  # repeated, as loggers do that are started again
            continue
        # notes under the table begin with words, which mark no missing value
        if cells[0][:1].isalpha() and cells[0].lower() not in ("nan", "na", "n/a", "inf"):
            if len(cells) == len(header) and any(any(map(str.isdigit, cell)) for cell in cells):
                return None
            ended = True
            continue
        if len(cells) != len(header) or ended:
            return None
        rows.append(cells)
    if header is None or len(set(header)) != len(header):
        return None
    read = {name: [row[i] for row in rows] for i, name in enumerate(header) if name in KNOWN}
    commas = mark != "," and not any("." in cell for column in read.values() for cell in column)
    try:
        return {
            name: [_number(cell.replace(",", ".") if commas else cell) for cell in column]
            for name, column in read.items()
        }
    except InvalidOperation:
        return None


def _header(line: str) -> tuple[list[str], str] | None:
    """The names on a line that is one of names, and what parts them."""
    mark = next((m for m in "\t;,| " if m in line), ",")
    cells = line.split() if mark == " " else [cell.strip() for cell in line.split(mark)]
    while cells and not cells[-1]:
        cells.pop()
    return (
        (cells, mark)
        if cells and all(name in KNOWN or name.startswith("_") for name in cells)
        else None
    )


def _number(cell: str) -> float:
    cell = cell.replace("\u2212", "-")  # the minus of Unicode is one
    if not cell.isascii() or "_" in cell or not Decimal(cell).is_finite():
        raise InvalidOperation
    return float(Decimal(cell))


def slip(text: str, source: random.Random) -> str:
    at, token, lines = source.randrange(len(text) + 1), source.choice(TOKENS), text.split("\n")
    row = source.randrange(len(lines))
    match source.randrange(7):
        case 0:
            return text[:at] + token + text[at:]
        case 1:
            return text[:at] + text[at + source.randrange(1, 6) :]
        case 2:
            cells = list(re.finditer(r"[^,;\t\r\n]+", text))
            cell = source.choice(cells)
            return text[: cell.start()] + token + text[cell.end() :]
        case 3:
            lines[row] += token
        case 4:
            lines[row] = token + lines[row]
        case 5:
            return text.replace(
                source.choice(".,;\t\n"),
                source.choice([",", ".", ";", "\r", "\r\n", "\t", "|", " "]),
            )
        case _:
            lines.insert(source.randrange(len(lines)), lines[row])
    return "\n".join(lines)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.statistics) for seed in range(1, 4))]
)
def test_a_table_is_read_as_it_is_written_or_refused(tmp_path: Path, seed: int) -> None:
    source, read = random.Random(seed), 0
    for _ in range(700):
        text = slip(source.choice(BASES), source)
        data = (slip(text, source) if source.random() < 0.3 else text).encode()
        (tmp_path / "a.csv").write_bytes(data)
        try:
            run = read_run(tmp_path / "a.csv", name="a")
        except EstimError:
            continue
        read += 1
        assert {name: column.tolist() for name, column in run.columns.items()} == oracle(data), data
    assert read > 100  # the oracle was asked


@pytest.mark.parametrize(
    "text",
    [
        "t_s,x_m\n0,1\n% 1,2\n1,3\n2,3\n3,4\n4,5\n5,6\n",
        "t_s,x_m\n0,1\n1,2\n\t%2,3\n3,4\n4,5\n5,6\n",
        "# c\0\nt_s,x_m\n" + PLAIN,
        "t_s,x_m,_n\n0,1,\0\n" + PLAIN,
    ],
)
def test_a_row_is_never_taken_for_a_comment_and_a_null_never_for_a_blank(
    tmp_path: Path, text: str
) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(EstimError, match=r"a\.csv:[1-4]: "):
        read_run(tmp_path / "a.csv", name="a")
