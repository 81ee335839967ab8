"""A unit has one meaning, or each that people write it for; what follows from it is refused only
where no reading of the formula allows it.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from test_newcomer import refused

from estim import AxisNames, Poisson, fit_curve
from estim.campaign import load_campaign
from estim.common import in_unit, is_angle, is_in_degrees, is_unit, same_unit
from estim.common.errors import InputError
from estim.curves import read_formula, units_of
from estim.curves.dimensions import certain_dimensions
from estim.curves.units import contradiction, refuse_degrees
from estim.reading import Dialect, name_and_unit, read_layout
from estim.reports.copying import _unit as latex_of

T = np.linspace(0.0, 1.5, 16)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("ms⁻¹", "m/s", True), ("ms^-1", "1/ms", True), ("ms-2", "m/s²", True),
        ("ms-1", "km/h", False), ("1/ms", "m/s", False),
        ("kgm⁻³", "kg/m³", True), ("Wm-2", "W/m^2", True), ("mm-1", "1", False),
        ("m.s-1", "m/s", True), ("m s^{-1}", "m s^(-1)", True),
        ("1/(m/s)", "s/m", True), ("(m/s)/s", "m/s²", True), ("kg (m/s)", "kg m/s", None),
        ("deg C", "K", True), ("° C", "°C", True), ("Grad Celsius", "°C", True),
        ("Grad", "°", True), ("Grad", "rad", False), ("grados", "°", True),
        ("º", "deg", True), ("º", "rad", False), ("S", "s", True), ("mS", "ms", True),
        ("Sekunden", "ms", False), ("Volt", "V", True),
        ("rpm", "1/min", True), ("rpm", "1/s", False), ("10^400", "1", False),
        ("1 10^999 m/s", "m/s", False), ("1/eV^20", "eV-20", True),
        ("10^99999", "m", None), ("1" * 400, "m", None), ("(" * 150, "m", None),
    ],
)  # fmt: skip
def test_a_unit_means_what_people_write_it_for(one: str, other: str, same: bool | None) -> None:
    assert same_unit(one, other) is same
    assert same_unit(other, one) is same


def test_a_value_is_turned_only_where_both_units_have_one_meaning() -> None:
    assert in_unit(5.0, "ms⁻¹", "km/h") == 18.0
    assert in_unit(30.0, "rpm", "1/s") is None
    assert in_unit(20.0, "°", "mK") is None  # zeros differ
    assert in_unit(1.0, "10^999 m", "m") is None


def test_angles_are_known_by_every_name_that_they_have() -> None:
    assert all(map(is_in_degrees, ("°", "deg", "degrees", "Grad", "º", "grados")))
    assert all(
        is_angle(unit) and not is_in_degrees(unit) for unit in ("rad", "mrad", "arcmin", "″", "gon")
    )
    assert not any(map(is_angle, ("%", "1", "°/s", "K", "°C", "month")))


def rule_of(text: str, x: str, y: str, stated: str, *, density: bool | None = False) -> str | None:
    """What is said of `p` in that formula."""
    return contradiction(
        read_formula(text), AxisNames("x", x, "y", y), "p", stated, density=density
    )


@pytest.mark.parametrize(
    ("text", "x", "y", "stated", "says"),
    [
        ("s0 + 9.81*sin(p)*x**2/2", "s", "m", "°", "must be in rad"),
        ("9.81*cos(1.5*p)*x", "s", "m", "mrad", "must be in rad"),
        ("9.81*cos(p*x)", "s", "m", "°/s", "must be in 1/s"),
        ("a*log(x)*sin(p)", "s", "m", "deg", "must be in rad"),
        ("9.81*sin(x + p)", "rad", "m", "°", "must be in rad"),
        ("exp(-x/p)", "s", "1", "ms", "must be in s"),
        ("exp(-x/p)", "s", "%", "ms", "must be in s"),
        ("exp(-2*x/p)", "s", "V", "ms", "must be in s"),
        ("log(U0) - x/p", "s", "1", "ms", "must be in s"),
        ("9.81*exp(-x/p)", "s", "V", "ms", "must be in s"),
        ("a*max(x - p, 0)", "s", "m", "ms", "must be in s"),
        ("p + 9.81*x**2/2", "s", "m", "cm", "must be in m"),
        ("20*log10(x/p)", "V", "dB", "mV", "must be in V"),
        ("1/(1/p - 1/x)", "cm", "cm", "mm", "must be in cm"),
        ("sqrt(p**2 - (x - c)**2)", "m", "m", "cm", "must be in m"),
        ("a + b*x + p*x**2", "kg·m/s", "kg·m²/s³", "mW", r"must be in 1/\(kg·s\)"),
        ("9.81*exp(-(x/p)**2)", "Hz", "V", "rad/s", "must be in Hz"),
        ("a/((x - p)**2 + (b/(2*pi))**2)", "Hz", "V", "rad/s", "must be in Hz"),
        ("b*(x**4 - p**4)", "K", "W", "°C", "must be in K"),
        ("b*(1/x - 1/p)", "K", "W", "°C", "must be in K"),
        ("b*(1 - (x/p)**2)", "K", "T", "°C", "must be in K"),
        ("p + b*exp(-x/c)", "s", "°C", "K", "must be in °C"),
        ("b + (p - b)*exp(-x/c)", "s", "°C", "K", "must be in °C"),
        ("b*((x + 273.15)**4 - p**4)", "°C", "W", "°C", "must be in K"),
        ("b*(x + 273.15 - p)", "°C", "W", "°C", "must be in K"),
    ],
)  # fmt: skip
def test_a_wrong_unit_is_found_beside_numbers_that_may_have_units(
    text: str, x: str, y: str, stated: str, says: str
) -> None:
    assert re.search(says, rule_of(text, x, y, stated) or "")


@pytest.mark.parametrize(
    ("text", "x", "y", "stated"),
    [
        ("s0 + 9.81*sin(p)*x**2/2", "s", "m", "rad"), ("A*cos(p*pi/180)*9.81", "s", "m", "°"),
        ("A*cos(p/57.3)*x", "s", "m", "°"),
        ("A*cos(radians(x - p))", "°", "V", "°"), ("9.81*cos((x - p)/4)", "s", "m", "s"),
        ("A*cos(2*pi*x/12 + b)*p", "month", "mm", "mm"),
        ("p*x*0.25", "m/s²", "N·m", "kg"), ("p*x*1.5", "s", "m", "m"),
        ("log(p) - x/tau", "s", "1", "V"), ("p*x + 1", "s", "V", "V/s"),
        ("exp(-1000*x/p)", "s", "1", "ms"), ("p*x**n", "s", "m", "furlong"),
        ("s0 + p*x", "s", "m", "ms⁻¹"),
        ("s0 + v*x + p*x**2/2", "s", "m", "ms^-2"),
        ("a*heaviside(x - p, 0.5)", "s", "m", "s"), ("exp(-x/p)", "1", "1", "ms"),
        ("1/(1/p - 1/x)", "cm", "mm", "cm"), ("1/(1/p - 1/x)", "cm", "cm", "cm"),
        ("p*x", "cm", "cm", "1"), ("2*pi*sqrt(x/p)", "kg", "s", "N/m"),
        ("p*x", "V", "mA", "1/kΩ"), ("a + p*x", "Hz", "V", "V s"),
        ("A*cos(p*x + c)", "s", "°", "rad/s"), ("9.81*x/p", "s", "m", "kg"),
        ("a/(p**2 - (2*pi*x)**2)", "Hz", "V", "rad/s"), ("p*x", "Hz", "rad/s", "rad/s/Hz"),
        ("a*exp(-((x - b)/p)**2)", "K", "V", "°C"), ("b + p*exp(-x/c)", "s", "°C", "K"),
        ("b + p*x", "°C", "V", "V/K"), ("b*exp(-x/p)", "°C", "V", "K"),
        ("b*(x**4 - (p + 273.15)**4)", "K", "W", "°C"),
        ("b*(x - 273.15 - p)", "K", "W", "°C"),
    ],
)  # fmt: skip
def test_a_unit_that_some_reading_allows_is_taken(text: str, x: str, y: str, stated: str) -> None:
    assert rule_of(text, x, y, stated) is None


def test_a_rule_that_takes_a_number_to_be_pure_says_the_way_out() -> None:
    assert "a number in the formula" in (rule_of("p*x/2", "s", "m", "m") or "")
    assert "a number in the formula" not in (rule_of("p*x", "s", "m", "m") or "")
    assert rule_of("p*x*b", "m/s²", "N·m", "kg") is None  # the way out


def test_counts_in_bins_have_no_unit_of_their_own() -> None:
    for unit in ("1", "events"):
        assert rule_of("N/tau*exp(-x/tau) + p", "µs", unit, "1/s", density=True)
        assert rule_of("N/tau*exp(-x/tau) + p", "µs", unit, "1/us", density=True) is None
    assert rule_of("a*exp(-x/tau) + p", "min", "1", "1/min") is None  # counts of a minute each
    counts = np.random.default_rng(1).poisson(50.0 * np.exp(-T))
    with pytest.raises(InputError, match="must be in 1/µs here"):
        fit_curve(
            "A*exp(-x/tau) + B",
            T,
            counts,
            noise=Poisson(bins=T[1]),
            axes=AxisNames("t", "µs"),
            units={"B": "1/s"},
            scan=False,
        )


@pytest.mark.parametrize(
    "text",
    [
        "exp(-x/p)",
        "exp(-2*x/p) + c",
        "log(a) - x/p",
        "a + b*log(x/p)",
        "a*max(x - p, 0) + b",
        "a*sin(2*pi*x/p + c)**2",
        "a*(1 + x/p)**(-1.5)",
        "sin(p*x)/(p*x)",
    ],
)
def test_what_follows_for_certain_is_how_numbers_change_with_the_unit_of_x(text: str) -> None:
    """x in other units, and each parameter that is found turned: the same curve but for a factor or
    a shift.
    """
    formula, rng = read_formula(text), np.random.default_rng(2)
    found = certain_dimensions(formula)
    named = {name: float(rng.uniform(0.5, 1.0)) for name in formula.names}
    turned = {name: value * 10.0 ** found.get(name, (0.0, 0.0))[0] for name, value in named.items()}
    assert found["p"][0] != 0.0
    x = T[1:]
    right, wrong = (
        formula.value(10.0 * x, values) / formula.value(x, named)
        for values in (turned, turned | {"p": named["p"]})
    )
    np.testing.assert_allclose(right, right[0, -1])
    assert not np.allclose(wrong, wrong[0, -1])


@pytest.mark.parametrize(
    ("text", "x", "y", "units"),
    [
        ("a + b*x", "s", "m/s²", {"a": "m/s²", "b": "m/s³"}),
        ("a + b*x", "1/s", "s^-1", {"a": "s^-1", "b": "1"}),
        ("a + b*x", "s", "ms⁻¹", {"a": "ms⁻¹", "b": "(ms⁻¹)/s"}),
        ("a*x", "°C", "J/(kg K)", {"a": "J/(kg·K·°C)"}),
        ("a*x**2", "µs", "m.s-1", {"a": "m/(s·µs²)"}), ("m*x*0.25", "m/s²", "N·m", {}),
        ("exp(-x/tau)", "s", "%", {"tau": "s"}),
        ("a*exp(b/(x + 273.15))", "°C", "kΩ", {"a": "kΩ", "b": "K"}),
        ("a*exp(b/(x + 273.15))", "C", "kΩ", {"a": "kΩ", "b": "K"}),
        ("a*exp(b/(x + 273.15))", "K", "C", {"a": "C", "b": "K"}),
        ("a*exp(b*(1/(x + 273.15) - 1/298.15))", "deg C", "kΩ", {"a": "kΩ", "b": "K"}),
        ("a*exp(b*(1/(273.15 + x) - 1/(c + 273.15)))", "°C", "V", {"a": "V", "b": "K", "c": "°C"}),
        ("a*(x + 273.15) + b*(x - c)", "°C", "V", {"a": "V/K", "b": "V/K", "c": "°C"}),
        ("1/(1/a - b*log(x/c)) - 273.15", "hPa", "°C", {"a": "K", "b": "1/K", "c": "hPa"}),
    ],
)  # fmt: skip
def test_units_are_put_together_by_what_they_mean(
    text: str, x: str, y: str, units: dict[str, str]
) -> None:
    formula = read_formula(text)
    assert units_of(formula, AxisNames("x", x, "y", y), formula.names) == units


def test_the_sine_of_milliradians_is_refused_as_that_of_degrees() -> None:
    for unit, says in (
        ("mrad", "write the column in radians"),
        ("Grad", r"write radians\(\.\.\.\) around it"),
        ("º", "radians"),
    ):
        with pytest.raises(InputError, match=f"takes sin of an angle in {unit}, .*{says}"):
            refuse_degrees(read_formula("a*sin(2*x)"), AxisNames("x", unit, "y", "V"))
    refuse_degrees(read_formula("a*sin(2*x)"), AxisNames("x", "rad", "y", "V"))
    refuse_degrees(read_formula("a*sin(0.001*x)"), AxisNames("x", "mrad", "y", "V"))


@pytest.mark.parametrize(
    "text", ["atan(x/a)", "c - 2*asin(x/a)", "arctan2(x, a)/2 + c", "-acos(x/a)"]
)
def test_an_arctangent_gives_no_degrees(text: str) -> None:
    for unit, says in (("°", r"write degrees\("), ("mrad", "write the column in radians")):
        with pytest.raises(
            InputError, match=f"gives an angle in radians, and y is in {unit}: {says}"
        ):
            refuse_degrees(read_formula(text), AxisNames("x", "m", "y", unit))
    refuse_degrees(read_formula(text), AxisNames("x", "m", "y", "rad"))
    refuse_degrees(read_formula(f"degrees({text})"), AxisNames("x", "m", "y", "°"))
    refuse_degrees(read_formula(f"b*({text})"), AxisNames("x", "m", "y", "°"))
    refuse_degrees(read_formula(f"180/pi*({text})"), AxisNames("x", "m", "y", "°"))


def test_a_unit_that_contradicts_the_axes_is_refused_with_any_start() -> None:
    given = {"u_y": 0.1, "axes": AxisNames("t", "s", "s", "m"), "scan": False}
    for start in ({}, {"s0": 1.0}):
        with pytest.raises(
            InputError, match=r"'units\[v\]' must be in m/s here.*nothing is converted: mm/s$"
        ):
            fit_curve(
                "s0 + v*x",
                T,
                T,
                units={"v": "mm/s"},
                bounds={"v": (0.0, 10.0)},
                start=start,
                **given,
            )


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("s(t)", "s", ""), ("x(t)", "x", ""), ("T(l)", "T", ""), ("N(E)", "N", ""),
        ("ln(U/V)", "ln(U/V)", ""), ("ln (I/A)", "ln (I/A)", ""),
        ("ln(U/V) (1)", "ln(U/V)", "1"), ("x(t) (m)", "x(t)", "m"), ("v / (m/s)", "v", "m/s"),
        ("v/(m/s)", "v", "m/s"), ("U(mV)", "U", "mV"),
        ("E/keV", "E", "keV"), ("t/s", "t", "s"), ("U_R/mV", "U_R", "mV"), ("λ/nm", "λ", "nm"),
        ("m/s", "m/s", ""), ("N/m", "N/m", ""), ("counts/min", "counts/min", ""),
        ("U/I", "U/I", ""),
        ("t(s)", "t", "s"),
        ("V(l)", "V", "l"), ("m (t)", "m", "t"), ("Masse(t)", "Masse", "t"), ("t(h)", "t", "h"),
        ("Zeit(h)", "Zeit", "h"),
        ("N(counts)", "N", "counts"), ("R(Ω)", "R", "Ω"),
    ],
)  # fmt: skip
def test_a_function_of_something_is_no_quantity_in_a_unit(
    header: str, name: str, unit: str
) -> None:
    assert name_and_unit(header) == (name, unit)


def line(folder: Path, header: str, name: str = "a.csv") -> Path:
    (folder / name).write_text(
        header
        + "\n"
        + "".join(f"{t:.1f},{1.0 + 2.0 * t + 0.01 * (-1) ** i:.3f}\n" for i, t in enumerate(T))
    )
    return folder / name


def test_a_row_of_units_goes_before_brackets_in_the_names(tmp_path: Path) -> None:
    layout = read_layout(line(tmp_path, "t,x(t)\ns,m"), Dialect())
    assert (layout.names, layout.units) == (("t", "x(t)"), ("s", "m"))
    assert read_layout(line(tmp_path, "ln(t/s),ln(U/V)"), Dialect()).units == ("", "")


def test_the_commands_refuse_and_take_the_same(tmp_path: Path) -> None:
    line(tmp_path, "t (s),s (m)")
    said = ("fit", tmp_path / "a.csv", "--u-y", 0.01, "--out", tmp_path / "out")
    message = refused(*said, "--formula", "s0 + 9.81*sin(alpha)*t**2/2", "--start", "alpha=5 °")
    assert re.search("'alpha' must be in rad here", message)
    line(tmp_path, "t (s),N (10^400)")
    assert "'v' must be in (10^400)/s here" in refused(
        *said, "--formula", "a + v*t", "--start", "v=1 10^999 m/s"
    )
    for header, start in (
        ("t (s),x (m)", "v=1 ms^-1"),
        ("t (s),s(t)", "v=1 m/s"),
        ("t (s),x[ms⁻¹]", "v=1 m/s²"),
        ("t (S),x (m)", "v=1 m/s"),
    ):
        line(tmp_path, header)
        # refused later, for another reason
        assert "'window'" in refused(
            *said, "--formula", "a + v*t", "--start", start, "--window", "5:1"
        )


MS = 'start = 1000.0, unit = "ms"'


def campaign(
    folder: Path,
    *,
    x: str = "",
    tau: str = MS,
    headers: tuple[str, ...] = ("t (s),U (V)",),
    own: str = "",
) -> Path:
    text = 'title = "c"\nkind = "synthetic"\n[curve]\nexpression = "A*exp(-t/tau)"\n'
    text += f'x = {{column = "t"{x}}}\ny = {{column = "U", unit = "V"}}\nu_y = 0.02\n'
    text += "[curve.parameters]\nA = {start = 5.0}\n" + (f"tau = {{{tau}}}\n" if tau else "")
    for i, header in enumerate(headers):
        line(folder, header, f"{i}.csv")
        text += f'[[runs]]\nname = "run{i}"\nfile = "{i}.csv"\n' + (
            f"[runs.parameters]\n{own}\n" if own else ""
        )
    (folder / "c.toml").write_text(text)
    return folder / "c.toml"


def test_a_header_says_the_unit_of_an_axis_that_the_campaign_does_not(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"c\.toml:10: 'tau' must be in s here"):
        load_campaign(campaign(tmp_path))
    load_campaign(campaign(tmp_path, tau='start = 1.0, unit = "s"'))
    load_campaign(campaign(tmp_path, headers=("t,U (V)",)))  # nobody says the unit


def test_a_wrong_axis_is_named_before_the_parameters_that_follow_from_it(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"c\.toml:5: 'x' must be in s, as the header of .*0\.csv says"
    ):
        load_campaign(campaign(tmp_path, x=', unit = "min"', tau='start = 1.0, unit = "s"'))


def test_runs_that_share_a_parameter_have_headers_in_one_unit(tmp_path: Path) -> None:
    files = load_campaign(
        campaign(tmp_path, tau="start = 1.0", headers=("t (s),U (V)", "t (ms),U (V)"))
    )
    files.problem(["run1"])
    with pytest.raises(
        InputError,
        match=r"c\.toml:5: 'x' is in s by the header of run 'run0', in ms by that of 'run1'",
    ):
        files.problem(["run0", "run1"])
    same = load_campaign(
        campaign(tmp_path, tau="start = 1.0", headers=("t (s),U (V)", "t / sec,U (V)"))
    )
    same.problem(["run0", "run1"])


def test_a_run_is_compared_with_its_own_header_alone(tmp_path: Path) -> None:
    own = 'tau = {start = 1.0, unit = "s"}'
    assert load_campaign(campaign(tmp_path, tau="", own=own)).run_names
    with pytest.raises(InputError, match=r"'tau' must be in ms here"):
        load_campaign(campaign(tmp_path, tau="", own=own, headers=("t (ms),U (V)",)))


def test_uncertainties_are_in_the_unit_that_the_campaign_says(tmp_path: Path) -> None:
    path = campaign(tmp_path, tau="start = 1.0")
    path.write_text(path.read_text().replace("u_y = 0.02", 'u_y = {column = "u_U"}'))
    rows = "".join(f"{t},{3.0 + t},20\n" for t in T)
    (tmp_path / "0.csv").write_text("t,U,u_U (mV)\n" + rows)
    with pytest.raises(
        InputError,
        match=r"0\.csv:1: 'u_U' must be in the unit that the campaign says of 'U', V; nothing is "
        r"converted: mV",
    ):
        load_campaign(path)
    (tmp_path / "0.csv").write_text("t,U,u_U (Volt)\n" + rows)
    load_campaign(path)


def test_is_unit_knows_what_stands_in_headers() -> None:
    assert all(
        map(is_unit, ("mV", "m/s", "m·s⁻¹", "1/(m·s)", "°C", "10^-3", "kΩ", "µm", "Sekunden"))
    )
    assert not any(map(is_unit, ("U)", "m/s V", "", "/", "(", "^2", "Teilstriche")))
    assert math.isclose(in_unit(1.0, "kgm⁻³", "g/cm³") or 0.0, 1e-3)


@pytest.mark.parametrize(
    ("x", "y", "says"),
    [("ms", "m", "'x' must be in s"), ("s", "cm", "'y' must be in m"), ("s", "m", "")],
)
def test_a_track_is_in_metres_and_seconds(
    tmp_path: Path, project: Path, x: str, y: str, says: str
) -> None:
    (tmp_path / "c.toml").write_text(
        'title = "c"\nkind = "synthetic"\n[curve]\nexpression = "x0 + v*t"\nu_y = 0.002\n'
        f'x = {{column = "t", unit = "{x}"}}\ny = {{column = "x_m", unit = '
        f'"{y}"}}\n[curve.parameters]\nx0 = {{}}\nv = {{}}\n'
        f'[[runs]]\nname = "r"\nfile = "{(project / "data/tutorial/fall.trk").as_posix()}"\n'
    )
    if says:
        with pytest.raises(InputError, match=rf"{says}, as .*fall\.trk says; nothing is converted"):
            load_campaign(tmp_path / "c.toml")
    else:
        load_campaign(tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("unit", "words"),
    [("ms⁻¹", r"\text{ms⁻¹}"), ("1000 K", r"\text{1000 K}"), ("m/s V", r"\text{m/s V}"),
    ("kg/(s²·K)", r"\kilo\gram\per\second\tothe{2}\per\kelvin"),
     ("m/s/s", r"\metre\per\second\tothe{2}"), ("deg C", r"\degreeCelsius")],
)  # fmt: skip
def test_latex_has_the_meaning_of_a_unit_or_its_text(unit: str, words: str) -> None:
    assert latex_of(unit) == words
