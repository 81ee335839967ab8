"""Tables of rolling bodies in anybody's writing: the same numbers whatever the delimiter, decimal
mark, header and further columns.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from estim import InputError
from estim.campaign import load_campaign

ROWS = [(0.1 * i, 0.02 * i + 0.03 * i**2, 7 * i) for i in range(12)]
CAMPAIGN = """title = "Writing"
kind = "synthetic"
[shared]
phi_deg = "2.0(1)"
SHARED
[bodies.wheel]
radius_m = 0.06
gamma = "0.2(1)"
kappa = "0.45(5)"
rho = 0.5
[[runs]]
name = "first"
body = "wheel"
file = "first.txt"
theta0_deg = "0(5)"
noise = {sigma_theta_rad = 0.01}
RUN
"""


def plain(row: tuple[float, float, int]) -> str:
    return f"{row[0]:.3f},{row[1]:.4f}"


def german(row: tuple[float, float, int]) -> str:
    return f"{row[2]};{row[0]:.3f};{row[1]:.4f};ok".replace(".", ",")


WRITTEN = {
    "plain": ("t_s,theta_rad\n", plain, "", ""),
    "one key": ("No;Time (s);Theta (rad);remark\n", german, 'decimal = "comma"', ""),
    "no header": ("", german, "", 'columns = ["", "t_s", "theta_rad", ""]'),
    "lines above": (
        "Measured, on a Monday\n12,4,1\nn;t;a;b\n",
        german,
        'decimal = "comma"\nskip_rows = 3',
        'columns = ["", "t_s", "theta_rad", ""]',
    ),
    "run before shared": ("x;t_s;theta_rad;y\n", german, 'decimal = "point"', 'decimal = "comma"'),
    "latin": (
        "n;Größe;t_s;theta_rad\n",
        lambda row: f"{row[2]};é;{row[0]:.3f};{row[1]:.4f}",
        'encoding = "latin-1"',
        "",
    ),
}


def campaign(
    folder: Path, header: str, row, shared: str, run: str, encoding: str = "latin-1"
) -> Path:
    (folder / "first.txt").write_bytes(
        (header + "".join(row(one) + "\n" for one in ROWS)).encode(encoding)
    )
    (folder / "c.toml").write_text(CAMPAIGN.replace("SHARED", shared).replace("RUN", run))
    return folder / "c.toml"


@pytest.mark.parametrize("how", WRITTEN)
def test_the_same_numbers_in_any_writing(tmp_path: Path, how: str) -> None:
    table = load_campaign(campaign(tmp_path, *WRITTEN[how])).tables["first"]
    np.testing.assert_allclose(table.columns["t_s"], [round(row[0], 3) for row in ROWS])
    np.testing.assert_allclose(table.columns["theta_rad"], [round(row[1], 4) for row in ROWS])
    assert set(table.columns) == {"t_s", "theta_rad"}


@pytest.mark.parametrize(
    ("header", "shared", "said"),
    [
        (
            "n;t_s;theta_rad;b\n",
            "",
            r"first.txt:2: 'row' must have|first.txt:1: 'n' is not a column name",
        ),
        (
            "n;t;a;b\n",
            'decimal = "comma"',
            r"first.txt:1: 'header' must hold columns that are called t_s, x_m, .* .or name "
            r"all columns: columns",
        ),
        (
            "n;t_s;Time (s);b\n",
            'decimal = "comma"',
            "first.txt:1: 'header' has two columns with the same name",
        ),
        (
            "n;t_s;x;b\n",
            'decimal = "comma"',
            "first.txt:1: 'header' must hold exactly one of x_m and theta_rad",
        ),
        ("", 'columns = ["t_s", "theta_rad"]', "first.txt:1: 'columns' must name all 4 columns"),
        ("", 'decimal = "comma"', "first.txt:1: 'header' has no line of column names: name all 4"),
        ("n;t_s;theta_rad;b\n", 'delimiter = "slash"', r"c.toml:5: 'delimiter' must be one of"),
        ("n;t_s;theta_rad;b\n", 'decimal = "dot"', r"c.toml:5: 'decimal'"),
    ],
)
def test_what_cannot_be_read_is_one_line_with_its_cure(
    tmp_path: Path, header: str, shared: str, said: str
) -> None:
    with pytest.raises(InputError) as caught:
        load_campaign(campaign(tmp_path, header, german, shared, ""))
    assert re.search(said, str(caught.value))
    assert "\n" not in str(caught.value)


def test_times_must_still_increase(tmp_path: Path) -> None:
    path = campaign(tmp_path, *WRITTEN["one key"])
    lines = (tmp_path / "first.txt").read_text().splitlines()
    (tmp_path / "first.txt").write_text("\n".join([*lines, lines[-1]]))
    with pytest.raises(InputError, match=r"first.txt:14: 't_s' must increase from row to row"):
        load_campaign(path)


def test_a_file_of_tracker_says_itself_how_it_is_written(tmp_path: Path) -> None:
    path = campaign(tmp_path, *WRITTEN["plain"][:2], "", 'decimal = "comma"\ntrack = "A"')
    with pytest.raises(InputError, match="'columns' applies to tables, not to a file of Tracker"):
        load_campaign(path)


@pytest.mark.parametrize("rows", ["", ";;;\n", "7;;;\n"])
def test_a_row_without_values_makes_no_imported_track(tmp_path: Path, rows: str) -> None:
    path = campaign(tmp_path, "n;t_s;theta_rad;b\n", german, 'decimal = "comma"', "")
    with (tmp_path / "first.txt").open("a", encoding="latin-1") as file:
        file.write(rows)
    second = re.split(r"(?m)^(?=\[\[runs\]\])", path.read_text())[1].replace("first", "second")
    path.write_text(f"{path.read_text()}{second}")
    table = load_campaign(path, asked=["first"]).tables["first"]  # second.txt is not there
    assert table.blank == ((14,) if rows else ())
    assert table.interval is None
    assert not any("frame rate" in fact for fact in table.facts)


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ("1;s;rad;1", ""),
        ("1;s;;1", ""),
        (";[s];(rad);", ""),
        ("1;ms;rad;1", "first.txt:1: 't_s' must be in s, as its name says.*: ms"),
        ("1;s;°;1", "'theta_rad' must be in rad, .*: °"),
        ("1;s;m;1", "'theta_rad' must be in rad"),
        (";min;deg;", "'t_s' must be in s"),
    ],
)
def test_a_row_of_units_says_what_the_names_say(tmp_path: Path, units: str, said: str) -> None:
    path = campaign(tmp_path, f"n;t_s;theta_rad;b\n{units}\n", german, 'decimal = "comma"', "")
    if not said:
        assert load_campaign(path).tables["first"].n_row == len(ROWS)
        return
    with pytest.raises(InputError, match=said):
        load_campaign(path)
