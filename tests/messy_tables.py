"""Tables as the software of laboratories writes them, each with the one command that a person would
try, and the numbers that stand in it.

All hold the straight line 2 + 3 t with the same errors, in other units and spellings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from workbooks import Cells, Formula, ods, xlsx, zipped

T = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
U = (2.03, 4.98, 8.01, 11.02, 13.97, 16.99, 20.04, 22.98)
LINE = ("--formula", "a + b*x")


@dataclass(frozen=True)
class Messy:
    """file : name and content.  options : of `estim fit FILE --formula "a + b*x"`.

    x, y, u_y : the numbers that are fit, u_y None where the file has none.
    units : of x and y.  told : words of the output.  refused : words of the one line in their
        place.
    """

    file: str
    content: bytes
    options: Sequence[str] = ()
    x: Sequence[float] = T
    y: Sequence[float] = U
    u_y: Sequence[float] | None = None
    units: tuple[str, str] = ("s", "V")
    told: Sequence[str] = ()
    refused: Sequence[str] = field(default=())


def lines(*written: str, end: str = "\r\n", encoding: str = "utf-8") -> bytes:
    return (end.join(written) + end).encode(encoding)


def _rows(form: Callable[[float, float], str]) -> list[str]:
    return [form(t, u) for t, u in zip(T, U, strict=True)]


def comma(value: float) -> str:
    return f"{value}".replace(".", ",")


def german(value: float) -> str:
    return f"{value:,.1f}".translate(str.maketrans(",.", ".,"))


_NOTES: Cells = [["Experiment 12"], ["Ana & Luis"], ["Voltage of the ramp generator"]]
_SHEET: Cells = [
    ["Ramp generator"],
    ["Measured on", datetime(2024, 3, 5)],
    [],
    ["t [s]", "U [V]", "U/2 [V]"],
    *([t, u, Formula(f"B{i}/2", u / 2)] for i, (t, u) in enumerate(zip(T, U, strict=True), 5)),
]
_TWO_TABLES: Cells = [
    ["Calibration", None, None, "Ramp"],
    [None],
    ["I [mA]", "R [Ohm]", None, "t [s]", "U [V]"],
    *([10 * t, 100 + t, None, t, u] for t, u in zip(T, U, strict=True)),
    [None],
    ["Mean", None, None, None, sum(U) / len(U)],
]
_START = datetime(2024, 3, 5, 23, 59, 57)


def _at(t: float, how: str) -> str:
    return (_START + timedelta(seconds=t)).strftime(how)


MESSY = {
    "excel: notes on the first sheet, the table on row 4 of the second, a formula": Messy(
        "ramp.xlsx",
        xlsx({"Notes": _NOTES, "Data": _SHEET}),
        ("--x", "t", "--y", "U"),
        told=["sheet 'Data'", "columns not used: U/2 [V]"],
    ),
    "libreoffice in German": Messy(
        "Rampe.ods", ods({"Tabelle1": [["t / s", "U / V"], *zip(T, U, strict=True), [None, None]]})
    ),
    "excel: two tables side by side": Messy(
        "both.xlsx",
        xlsx({"Plot": [["see below"]], "Werte": _TWO_TABLES}),
        ("--sheet", "Werte", "--range", "D3:E11"),
    ),
    "excel: a value that could not be computed": Messy(
        "broken.xlsx",
        xlsx({"A": [["t [s]", "U [V]"], *zip(T, U, strict=True), [8, Formula("A1/0", "#DIV/0!")]]}),
        told=["1 row was excluded because a value is missing (line 10)"],
    ),
    "phyphox: a zip with one table": Messy(
        "Acceleration 2024-03-05.zip",
        zipped(
            {
                "Raw Data.csv": lines(
                    '"Time (s)","Voltage (V)"', *_rows(lambda t, u: f"{t:.9E},{u:.9E}"), end="\n"
                ),
                "meta/device.csv": lines('"property","value"', '"version","1.1.13"', end="\n"),
                "meta/time.csv": lines('"event","experiment time"', '"START",0.0', end="\n"),
            }
        ),
        told=["'Raw Data.csv'"],
    ),
    "phyphox: a zip with several tables": Messy(
        "Collision.zip",
        zipped(
            {
                name: lines('"Time (s)","Voltage (V)"', *_rows(lambda t, u: f"{t},{u}"), end="\n")
                for name in ("Intervals.csv", "Raw Data.csv")
            }
        ),
        refused=["holds several tables", "Intervals.csv", "Raw Data.csv", "--sheet"],
    ),
    "a logger with ISO 8601 and a zone": Messy(
        "log.csv",
        lines(
            "timestamp,voltage [V]", *_rows(lambda t, u: f"{_at(t, '%Y-%m-%dT%H:%M:%S')}.250Z,{u}")
        ),
        told=["'timestamp'", "s since", "2024-03-05T23:59:57.25"],
    ),
    "a German logger": Messy(
        "messung.csv",
        lines(
            "Datum/Uhrzeit;Spannung [V]",
            *_rows(lambda t, u: f"{_at(t, '%d.%m.%Y %H:%M:%S')};{comma(u)}"),
            encoding="windows-1252",
        ),
        told=["day.month.year"],
    ),
    "a logger with date and time in two columns": Messy(
        "hobo.csv",
        lines(
            '"Plot Title: ramp"',
            '"#","Date","Time","Voltage (V)"',
            *_rows(lambda t, u: f"{int(t) + 1},{_at(t, '%Y-%m-%d')},{_at(t, '%H:%M:%S')},{u}"),
        ),
        ("--x", "Time", "--y", "Voltage"),
        told=["'Date'", "'Time'"],
    ),
    "a logger of the United States, through midnight": Messy(
        "export.csv",
        lines(
            "Time,Voltage (V)",
            *_rows(
                lambda t, u: (
                    (datetime(2023, 12, 30, 6) + timedelta(days=t)).strftime("%m/%d/%Y %H:%M")
                    + f",{u}"
                )
            ),
        ),
        ("--time-unit", "d"),
        units=("d", "V"),
        told=["month/day/year"],
    ),
    "units in the cells": Messy(
        "notebook.csv",
        lines("t;U", *_rows(lambda t, u: f"{comma(t)} s;{comma(u)} V")),
        told=["'t' are in s", "'U' are in V"],
    ),
    "two units in one column": Messy(
        "mixed.csv",
        lines(
            "t;U", *_rows(lambda t, u: f"{t:g} s;" + (f"{u:g} V" if u > 5 else f"{1000 * u:g} mV"))
        ),
        refused=["mixed.csv:4: 'U' must be written like the cells above it", "and in mV: 8.01 V"],
    ),
    "value ± uncertainty": Messy(
        "values.csv",
        lines("t [s],U [V]", *_rows(lambda t, u: f"{t},{u} ± {0.02 + 0.01 * t:.2f}")),
        u_y=tuple(0.02 + 0.01 * t for t in T),
        told=["uncertainties", "'U [V]'"],
    ),
    "uncertainties of last digits, with units": Messy(
        "digits.txt",
        lines("t\tU", *_rows(lambda t, u: f"{t} s\t{u:.2f}({2 + int(t)}) V"), end="\n"),
        u_y=tuple(0.02 + 0.01 * t for t in T),
        told=["uncertainties", "'U' are in V"],
    ),
    "names in the first column": Messy(
        "lying.csv",
        lines("t [s];" + ";".join(map(comma, T)), "U [V];" + ";".join(map(comma, U)) + ";"),
        told=["names of the columns stand in the first cell of each line"],
    ),
    "thousands in German": Messy(
        "tausend.csv",
        lines("t [s];U [mV]", *_rows(lambda t, u: f"{comma(t)};{german(1000 * u)}")),
        ("--decimal", "comma"),
        y=tuple(1000 * u for u in U),
        units=("s", "mV"),
    ),
    "excel's CSV: empty columns and empty rows": Messy(
        "excel.csv",
        b"\xef\xbb\xbf"
        + lines("t [s];U [V];;", *_rows(lambda t, u: f"{comma(t)};{comma(u)};;"), ";;;", ";;;"),
    ),
    "a logger that was started twice": Messy(
        "again.csv",
        lines(
            "Time,Voltage",
            "s,V",
            *_rows(lambda t, u: f"{t},{u}")[:4],
            "Time,Voltage",
            "s,V",
            *_rows(lambda t, u: f"{t},{u}")[4:],
        ),
        told=["repeat the head of the table were not read (7, 8)"],
    ),
    "notes under the table": Messy(
        "notes.csv",
        lines(
            "t [s];U [V]",
            *_rows(lambda t, u: f"{comma(t)};{comma(u)}"),
            "",
            "Remark: range 30 V, read by A.",
            "Multimeter No. 3",
        ),
        told=["below the table was not read (lines 11, 12)"],
    ),
    "LabVIEW": Messy(
        "ramp.lvm",
        lines(
            "LabVIEW Measurement\t",
            "Writer_Version\t2",
            "Reader_Version\t2",
            "Separator\tTab",
            "Decimal_Separator\t.",
            "Date\t2024/03/05",
            "***End_of_Header***\t\t\t",
            "\t\t\t",
            "Channels\t1\t\t",
            "Samples\t8\t\t",
            "Y_Unit_Label\tV\t\t",
            "X_Dimension\tTime\t\t",
            "***End_of_Header***\t\t\t",
            "X_Value\tVoltage\tComment",
            *_rows(lambda t, u: f"{t:.6f}\t{u:.6f}"),
        ),
        units=("", ""),
    ),
    "an oscilloscope of Tektronix": Messy(
        "F0000CH1.CSV",
        lines(
            *(
                f"{head},{t:.12f},{u:.5f},"
                for head, t, u in zip(
                    (
                        "Record Length,8.000000e+00,",
                        "Sample Interval,1.000000e+00,",
                        "Trigger Point,0.000000000000e+00,",
                        ",,",
                        "Source,CH1,",
                        "Vertical Units,V,",
                        "Firmware Version,FV:v24.26,",
                        ",,",
                    ),
                    T,
                    U,
                    strict=True,
                )
            )
        ),
        ("--columns", "_a,_b,_c,t [s],U [V],_d"),
    ),
    "Logger Pro: names, symbols, units": Messy(
        "vernier.txt",
        lines(
            "Vernier Format 2",
            "Untitled.cmbl 3/5/2024 10:15:30 .",
            "Run 1",
            "Time\tVoltage",
            "t\tU",
            "s\tV",
            "",
            *_rows(lambda t, u: f"{t}\t{u}"),
        ),
        ("--x", "t", "--y", "U"),
    ),
}
