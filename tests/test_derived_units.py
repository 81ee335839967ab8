"""Units of derived quantities: as they follow from those of the names in the formula; what cannot
be meant is refused, what may be right is not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estim import fit_curve
from estim.campaign import load_campaign
from estim.common import InputError, same_unit
from estim.curves import in_units, seek, unit_that_follows
from estim.measurement_model.model_file import read_model

KNOWN = {
    "tau": "s", "T": "s", "p": "deg", "q": "°", "r": "rad", "L": "m", "d": "mm", "v": "m/s",
    "b": "m/s", "k": "N/m", "A": "cm", "m": "kg",
    "g": "m/s²", "slope": "s²/m", "n": "1", "theta": "mrad", "w": "°/s", "gamma[heavy]": "deg",
    "t": "°C", "R": "Ω", "U": "mV", "h": "J s",
    "cts": "counts", "eta": "%", "u": "ms-1", "s": "deg C",     "omega": "1/s", "f": "Hz",
    "c": "V/°", "C": "J/K", "k_B": "J/K", "beta": "1/K",
    "theta_K": "K", "w_0": "rad/s",
}  # fmt: skip


def unit(formula: str, stated: str | None = None) -> str:
    (found,) = in_units([seek("found", formula, unit=stated)], KNOWN)
    return found.unit


@pytest.mark.parametrize(
    ("formula", "follows"),
    [
        ("1/tau", "1/s"), ("4*pi**2/slope", "m/s²"), ("k*A**2/2", "N·cm²/m"), ("sqrt(L**2)", "m"),
        ("p - q", "deg"), ("degrees(r)", "°"),
        ("radians(p)", "rad"), ("arctan(L/(2*L))", "rad"), ("L*arctan(n)", "m"), ("v/g", "s"),
        ("L/d", "m/mm"), ("sin(r)", "1"), ("-tau", "s"),
        ("log(tau)", "1"), ("exp(-tau)", "1"), ("5*v", "1"), ("v*0.25", "1"), ("2*pi*f", "Hz"),
        ("sqrt(g)", "1"), ("n*L", "1"), ("tau + 5", "s"),
        ("1/cts", "1/counts"), ("n", "1"), ("2", "1"), ("where(v > 1, L, 2*L)", "m"),
        ("3/2*L", "m"), ("C*(t - s)", "J"), ("k_B*(t + 273.15)", "J"), ("C*t/s", "J/K"),
        ("beta*t*L", "m"),
        ("m*v**2/2", "kg·m²/s²"),
    ],
)  # fmt: skip
def test_the_unit_follows_or_nothing_is_said(formula: str, follows: str) -> None:
    assert unit(formula) == follows


@pytest.mark.parametrize(
    ("formula", "stated", "says"),
    [
        ("tan(p)", None, r"takes tan of an angle in deg, but tan takes radians: write "
            r"tan\(radians\(p\)\)"),
        ("sin(gamma[heavy])", None, r"write sin\(radians\(gamma\[heavy\]\)\)"),
        ("cos((p - q)/2)", None, "takes cos of an angle in deg"),
        ("n*sin(2*pi*q)", "1", "takes sin of an angle in °"),
        ("tan(b)", None, "takes tan of what is in m/s"),
        ("sin(theta)", None, "sin of what is in mrad"),
        ("sin(radians(r))", None, "takes radians of what is in rad, but radians takes degrees"),
        ("degrees(p)", None, "degrees of what is in deg"),
        ("tau/T + sin(w)", None, "takes sin of what is in °/s"),
        ("1/tau", "s", "must be in 1/s, as its formula and the units in it say; nothing is "
            "converted: s"), ("tau", "ms", "must be in s"),
        ("arctan(n)", "°", r"must be in rad, .*: write degrees\(\.\.\.\)"),
        ("r", "°", "must be in rad"), ("degrees(r)", "rad", "must be in °"),
        ("L/d", "1", "must be in m/mm"), ("k*A**2/2", "J", "must be in N·cm²/m"),
        ("0.5*m*v**2", "mJ", r"must be in .* "
            r"\(give a number"),
        ("L + d", None, "adds what is in m and what is in mm"),
        ("L*(1 - eta)", None, "adds 1 and what is in %"),
        ("hypot(L, d)", "m", "compares what is in "
            "m and what is in mm"),
        ("2*p", "rad", "must be in deg"), ("sqrt(L)*sqrt(d)*sqrt(L)/sqrt(d)", "s", "must be in m"),
        ("p - r", None, "adds what is in deg and what is in rad"),
        ("L - tau", None, "adds what is in m "
            "and what is in s"),
        ("U/R", "A", "must be in mV/Ω"),
        ("k_B*t", None, r"multiplies t in °C by what is in J/K; nothing is converted: write "
            r"\(t \+ 273\.15\), or state a difference in K"),
        ("A*C*t**4", "J", "multiplies t in °C by what is in cm·J/K"),
        ("t", "K", "must be in °C"), ("f + w_0", None, "adds what is in Hz and what is in rad/s"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(formula: str, stated: str | None, says: str) -> None:
    with pytest.raises(InputError, match=says) as told:
        unit(formula, stated)
    assert told.value.field == "found"


@pytest.mark.parametrize(
    ("formula", "stated"),
    [
        ("tan(radians(p))", "1"), ("tan(p*pi/180)", "1"), ("tan(0.0174533*p)", None),
        ("arctan(n)*180/pi", "°"), ("degrees(arctan(n))", "deg"),
        ("5*v", "m"), ("2*v", "m"), ("0.5*v", "m"), ("exp(-1/tau)", "1"), ("A*cos(5*omega)", "cm"),
        ("cos(2*w)", "1"), ("1e3*L", "mm"),
        ("L/1000", "km"), ("u*tau", "m"), ("s + 273.15", "K"), ("sqrt(g)", "m"),
        ("t + 273.15", "K"), ("9/5*t + 32", "°F"), ("1.8*t + 32", "°F"), ("log10(L)", "1"),
        ("exp(L)", "m"), ("k*A**2/2e4", "J"),
        ("k*(A/100)**2/2", "J"),
        ("U/R", "mA"), ("U/(1000*R)", "A"), ("1/tau", "Hz"), ("2*pi/T", "rad/s"), ("2*pi/T", "1/s"),
        ("L/d", "10^3"), ("m*v**2/2", "J"), ("m*g", "N"),
        ("h*f", "J"), ("cts/tau", "counts/s"), ("cts/tau", "Bq"), ("n", "kg"), ("n*L", "s"),
        ("2", "min"), ("5*c", "V"), ("2*eta", "%"),
        ("eta*L/100", "m"), ("v/3.6", "km/h"), ("v*3.6", "km/h"), ("L + 0.01", "m"), ("n + L", "m"),
        ("sqrt(L/g)", "s"), ("2*pi*sqrt(L/g)", "s"),
        ("arctan2(L, d/1000)", "rad"), ("sin(r) + L", "m"), ("n**n", "V"), ("tau*log(2)", "s"),
        ("L/tau**2", "m s-2"), ("v/tau", "m/s/s"),
        ("n*t**2 + n*t", None), ("t - s", "K"), ("t + theta_K", "°C"), ("n/(f*s)", None),
        ("theta_K - (t + 273.15)", "K"), ("U + 2*n*t", "mV"), ("n*(t - s)**2", "W"),
        ("2*pi*f + w_0", "Hz"),
    ],
)  # fmt: skip
def test_what_may_be_right_is_taken(formula: str, stated: str | None) -> None:
    assert unit(formula, stated) == (stated or "1")


def test_the_cure_of_a_number_with_a_unit_of_its_own() -> None:
    found = in_units(
        [
            seek("two", "2", unit="min"),
            seek("half", "0.5*m*v**2/two", unit="J/min"),
            seek("rate", "1/half"),
        ],
        KNOWN,
    )
    assert [one.unit for one in found] == ["min", "J/min", "min/J"]


@pytest.mark.parametrize(
    "path",
    sorted((Path(__file__).parents[1] / "data" / "gum").glob("*.toml")),
    ids=lambda path: path.stem,
)
def test_published_models_have_the_units_that_their_guides_state(path: Path) -> None:
    model = read_model(path)
    units = {one.name: one.unit for one in (*model.quantities, *model.outputs)}
    for output in model.outputs:
        follows = unit_that_follows(
            output.formula.tree, {name: name for name in (*output.formula.names, "x")}, units, None
        )
        assert follows == "1" or same_unit(follows, output.stated or "1") in (True, None)
        if path.stem in (
            "gum-h1-end-gauge",
            "gum-h2-impedance",
            "s1-gauge-block",
            "s1-mass",
            "tn1900-e13-expansion",
            "tn1900-e3-viscometer",
        ):
            assert same_unit(follows, output.stated or "1") is True


MEASURED = """title = "Refraction"
[measurand.n]
formula = "FORMULA"
UNIT
[measurand.twice]
formula = "2*pi*n"
[inputs.p]
value = "57.0(2)"
unit = "deg"
[inputs.tau]
value = "2.0(1)"
unit = "s"
"""


@pytest.mark.parametrize(
    ("formula", "stated", "says"),
    [
        (
            "tan(p)*tau",
            "",
            r":3: 'formula' takes tan of an angle in deg, but tan takes radians: write "
            r"tan\(radians\(p\)\): tan\(p\)\*tau",
        ),
        ("tan(radians(p))/tau", 'unit = "s"', r":4: 'unit' must be in 1/s, .*: s"),
        ("tan(radians(p))/tau", "", ""),
    ],
)
def test_a_measurement_model_says_so_too(
    tmp_path: Path, formula: str, stated: str, says: str
) -> None:
    path = tmp_path / "m.toml"
    path.write_text(MEASURED.replace("FORMULA", formula).replace("UNIT", stated))
    if not says:
        assert [output.unit for output in read_model(path).outputs] == ["1/s", "1/s"]
        return
    with pytest.raises(InputError, match=says):
        read_model(path)


CAMPAIGN = """title = "Polariser"
kind = "synthetic"
[curve]
expression = "A*cos(radians(x - p - b))"
x = {column = "phi", unit = "°"}
y = {column = "U", unit = "V"}
u_y = 0.02
[curve.parameters]
p = PLACE
A = {start = 2.0}
b = {value = 0.0, unit = "deg"}
[derived]
n = FORMULA
[[runs]]
name = "a"
file = "a.csv"
"""


def campaign(folder: Path, formula: str, place: str = '{start = 20.0, unit = "deg"}') -> Path:
    phi = np.linspace(-40.0, 80.0, 25)
    (folder / "a.csv").write_text(
        "phi,U\n" + "\n".join(f"{a},{2.0 * np.cos(np.radians(a - 25.0)):.4f}" for a in phi)
    )
    (folder / "c.toml").write_text(CAMPAIGN.replace("FORMULA", formula).replace("PLACE", place))
    return folder / "c.toml"


@pytest.mark.parametrize(
    ("formula", "place"),
    [
        ('"tan(p)"', '{start = 20.0, unit = "deg"}'),
        ('"tan(p)"', "{start = 20.0}"),
        ('"tan(b)"', "{}"),
        ('{formula = "2*p[a]", unit = "rad"}', "{}"),
    ],
)
def test_a_campaign_names_the_line(tmp_path: Path, formula: str, place: str) -> None:
    with pytest.raises(InputError, match=r"c.toml:13: 'n' (takes tan of an angle in|must be in)"):
        load_campaign(campaign(tmp_path, formula, place))


def test_a_campaign_says_the_unit_that_follows(tmp_path: Path) -> None:
    loaded = load_campaign(campaign(tmp_path, '"A/p"'))
    (run,) = loaded.problem(["a"]).runs
    assert [one.unit for one in run.sought] == ["V/deg"]  # type: ignore[attr-defined]


def test_a_fit_in_python_says_so_too() -> None:
    x = np.linspace(0.0, 1.0, 9)
    given = {"u_y": 0.01, "start": {"k": 1.0, "c": 0.0}}
    fit = fit_curve(
        "k*x + c",
        x,
        2.0 * x,
        units={"k": "m/s", "c": "m"},
        derived={"time": "c/k", "way": "5*k"},
        **given,
    )
    assert (fit.derived["time"].unit, fit.derived["way"].unit) == ("s", "1")
    with pytest.raises(InputError, match="'time' must be in s"):
        fit_curve(
            "k*x + c",
            x,
            2.0 * x,
            units={"k": "m/s", "c": "m", "time": "ms"},
            derived={"time": "c/k"},
            **given,
        )


@pytest.mark.parametrize(
    ("formula", "given"),
    [("arctan(d/L)", "mm/m"), ("log(d/L)", "mm/m"), ("log(eta)", "%"), ("exp(p)", "deg")],
)
def test_a_function_of_a_pure_number_takes_no_other(formula: str, given: str) -> None:
    name = formula.partition("(")[0]
    with pytest.raises(InputError, match=f"takes {name} of what is in {given}, but {name} needs"):
        unit(formula)
    for fine in ("exp(-tau/T)", "log(L)", "exp(r)", "arctan(L/L)", "exp(-tau*omega)", "log(cts)"):
        unit(fine)
