"""Tables as the software of laboratories writes them: one command reads them, or says the cure."""

from __future__ import annotations

import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner
from messy_tables import LINE, MESSY
from workbooks import xlsx

from estim import InputError, fit_curve
from estim.cli.commands import cli
from estim.curve_fitting.tables import read_table


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
