"""A unit that contradicts the axes, a header or a function is refused: nothing is converted, so
that the number would be wrong.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from test_newcomer import refused

from estim import AxisNames, fit_curve
from estim.campaign import load_campaign
from estim.common import in_unit, is_unit, same_numbers, same_unit
from estim.common.errors import InputError
from estim.reading import name_and_unit

DISCHARGE = "Zeit (s);Spannung / V\n" + "".join(
    f"{t:.1f};{2.0 * math.exp(-t / 5.0) + 0.01 * (-1) ** t:.3f}\n" for t in range(12)
).replace(".", ",")
FORMULA = "U*exp(-t/tau)"


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("1/s", "s^-1", True), ("1/s", "s⁻¹", True), ("s**-1", "Hz", True), ("rad/s", "1/s", True),
        ("°C", "K", True), ("C", "°C", True),
        ("C", "mC", False),
        ("m/s²", "m s-2", True), ("m/s/s", "m·s⁻²", True), ("µs", "us", True), ("ms", "s", False),
        ("V", "s", False), ("1000 K", "K", False),
        ("10⁻⁶", "1e-6", True), ("10^-3 m", "mm", True), ("1e-6", "1", False), ("°", "rad", False),
        ("V/A", "Ω", True), ("%", "1", False),
        ("month", "s", None), ("counts", "1", None), ("J/mol K", "J", None), ("Mpc", "kpc", None),
        ("pH", "1", None), ("Mpc", "Mpc", True),
    ],
)  # fmt: skip
def test_units_are_compared_by_dimension_and_scale_where_both_are_known(
    one: str, other: str, same: bool | None
) -> None:
    assert same_unit(one, other) is same
    assert same_unit(other, one) is same


def test_values_change_with_their_unit() -> None:
    assert in_unit(5000.0, "ms", "s") == 5.0
    assert in_unit(3.0, "min", "s") == 180.0
    assert in_unit(90.0, "°", "rad") == pytest.approx(math.pi / 2, rel=1e-11)
    assert in_unit(20.0, "°C", "K") is None  # zeros differ
    assert in_unit(1.0, "V", "s") is None


@pytest.mark.parametrize(
    ("start", "says"),
    [
        ("tau=5000 ms", r"'tau' must be in s here.*; nothing is converted: ms$"),
        ("tau=3 min", "'tau' must be in s here"),
        (
            "tau=2 V",
            r"'tau' must be in s here, as the formula and the units of the axes say; "
            r"nothing is converted: V$",
        ),
        ("U=2000 mV", "'U' must be in V here"),
    ],
)
def test_a_start_in_another_unit_than_follows_is_refused(
    tmp_path: Path, start: str, says: str
) -> None:
    (tmp_path / "cap.csv").write_text(DISCHARGE)
    assert re.search(
        says,
        refused(
            "fit",
            tmp_path / "cap.csv",
            "--formula",
            FORMULA,
            "--u-y",
            0.01,
            "--start",
            start,
            "--out",
            tmp_path / "out",
        ),
    )
    assert not (tmp_path / "out").exists()


def campaign(folder: Path, *, tau: str, x: str = "s", expression: str = "U*exp(-x/tau)") -> Path:
    (folder / "cap.csv").write_text(DISCHARGE)
    (folder / "c.toml").write_text(
        f'title = "c"\nkind = "measured"\n[curve]\nexpression = "{expression}"\nx = '
        f'{{column = "Zeit", unit = "{x}"}}\n'
        f'y = {{column = "Spannung", unit = "V"}}\nu_y = 0.01\n[curve.parameters]\nU = '
        f'{{}}\ntau = {tau}\n[[runs]]\nname = "c"\nfile = "cap.csv"\n'
    )
    return folder / "c.toml"


@pytest.mark.parametrize(
    "tau",
    [
        '{start = 5.0, unit = "s"}',
        '{start = 5.0, unit = "sec"}',
        "{start = 5.0}",
        '{start = 5.0, unit = "Teilstriche"}',
    ],
)
def test_the_same_unit_in_another_spelling_and_unknown_ones_are_taken(
    tmp_path: Path, tau: str
) -> None:
    load_campaign(campaign(tmp_path, tau=tau))


@pytest.mark.parametrize("unit", ["ms", "V"])
def test_a_campaign_is_refused_at_its_line(tmp_path: Path, unit: str) -> None:
    with pytest.raises(InputError, match=r"c\.toml:10: 'tau' must be in s here"):
        load_campaign(campaign(tmp_path, tau=f'{{start = 5000.0, unit = "{unit}"}}'))


def test_a_number_with_a_unit_of_its_own_leaves_the_unit_open(tmp_path: Path) -> None:
    load_campaign(
        campaign(tmp_path, tau='{start = 5000.0, unit = "ms"}', expression="U*exp(-1000*x/tau)")
    )
    load_campaign(
        campaign(tmp_path, tau='{start = 5.0, unit = "cs"}', expression="U*exp(-10*x/tau)")
    )


@pytest.mark.parametrize(
    ("one", "other", "same", "of_differences"),
    [
        ("°C", "K", False, True),
        ("deg", "K", False, True),
        ("°C", "celsius", True, True),
        ("C", "A s", True, True),
        ("Hz", "rad/s", False, False),
        ("Hz", "1/s", True, True),
        ("rad/s", "1/s", True, True),
        ("V", "cts", None, None),
    ],
)
def test_numbers_in_two_units(
    one: str, other: str, same: bool | None, of_differences: bool | None
) -> None:
    assert same_numbers(one, other) is same_numbers(other, one) is same
    assert same_numbers(one, other, differences=True) is of_differences


def test_an_axis_in_another_unit_than_its_header_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"c\.toml:5: 'x' must be in s, as the header of .*cap\.csv says; nothing is "
        r"converted: ms",
    ):
        load_campaign(campaign(tmp_path, tau="{}", x="ms"))


def test_times_of_events_say_the_unit_of_a_lifetime(tmp_path: Path) -> None:
    (tmp_path / "mu.csv").write_text("t_us\n" + "".join(f"{t / 10.0}\n" for t in range(1, 60)))
    text = (
        'title = "c"\nkind = "measured"\n[curve]\nexpression = "exp(-x/tau)"\nx = {column '
        '= "t_us", unit = "µs"}\nnoise = {model = "event-times"}\n'
        "window = {min = 0.0, max = 7.0}\n[curve.parameters]\ntau = {start = 2.0, low = "
        '0.01, unit = "UNIT"}\n[[runs]]\nname = "c"\nfile = "mu.csv"\n'
    )
    for unit in ("us", "ns"):
        (tmp_path / f"{unit}.toml").write_text(text.replace("UNIT", unit))
    load_campaign(tmp_path / "us.toml")
    with pytest.raises(InputError, match=r"must be in µs here"):
        load_campaign(tmp_path / "ns.toml")


def test_python_refuses_the_same() -> None:
    x, axes = np.linspace(0.0, 10.0, 21), AxisNames("t", "s", "U", "V")
    with pytest.raises(InputError, match=r"'units\[tau\]' must be in s here"):
        fit_curve(
            "U*exp(-x/tau)",
            x,
            np.exp(-x),
            u_y=0.1,
            start={"U": 1.0, "tau": 5.0},
            units={"tau": "ms"},
            axes=axes,
        )
    with pytest.raises(InputError, match=r"'units\[p\]' must be in rad here"):
        fit_curve(
            "U*cos(x/T + p)",
            x,
            x,
            u_y=0.1,
            start={"U": 1.0, "T": 1.0, "p": 9.0},
            units={"p": "°"},
            axes=axes,
        )


@pytest.mark.parametrize(
    ("formula", "instead"),
    [
        ("I0*cos(angle - phi)**2 + b", r"write radians\(\.\.\.\) around it"),
        ("I0*sin(2*angle)", r"write radians\(\.\.\.\) around it"),
        ("I0*cos(radians(angle - phi))**2 + b", ""),
        ("I0*cos(pi/180*angle - phi)", ""),
        ("I0*cos(k*angle)", ""),
    ],
)
def test_a_cosine_of_degrees_is_refused(formula: str, instead: str) -> None:
    angle = np.linspace(0.0, 90.0, 16)
    axes = AxisNames("angle", "°", "I", "mA")
    start = {name: 1.0 for name in ("I0", "phi", "b", "k") if name in formula}
    text = formula.replace("angle", "x")
    if instead:
        with pytest.raises(InputError, match=f"'curve' takes .* of an angle in °, .*{instead}"):
            fit_curve(
                text,
                angle,
                np.cos(np.radians(angle)) ** 2,
                start=start,
                u_y=0.1,
                axes=axes,
                scan=False,
            )
    else:
        fit_curve(
            text, angle, np.cos(np.radians(angle)) ** 2, start=start, u_y=0.1, axes=axes, scan=False
        )


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [("u(U) in mV", "u(U)", "mV"), ("u(U) / mV", "u(U)", "mV"), ("t in s", "t", "s"),
    ("height in water", "height in water", ""),
     ("u(U)", "u(U)", ""), ("u (cm)", "u", "cm"), ("v in m/s", "v", "m/s")],
)  # fmt: skip
def test_units_behind_in_are_read_where_they_are_units(header: str, name: str, unit: str) -> None:
    assert name_and_unit(header) == (name, unit)
    assert is_unit(unit) or not unit


def test_an_uncertainty_in_another_unit_is_refused_in_every_way_to_write_it(tmp_path: Path) -> None:
    rows = "".join(f"{t};{2.0 * math.exp(-t / 5.0):.3f};30\n" for t in range(12))
    for header in ("u(U) in mV", "u(U) / mV", "u(U) [mV]", "u_U (mV)"):
        (tmp_path / "cap.csv").write_text(f"t in s;U in V;{header}\n{rows}")
        # the column is found by itself
        message = refused(
            "fit", tmp_path / "cap.csv", "--formula", FORMULA, "--out", tmp_path / "out"
        )
        assert "must be in the unit of 'U in V', V" in message
