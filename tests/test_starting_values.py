"""Starting values of a formula from the points alone: which unit a parameter has, which parameters
are linear, and that the optimum is reached.

The certified sums of squares are those of NIST (see `test_nist.py`, whose files give no start
here).
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from test_nist import FILES, FOLDER, HARDEST, LINEAR, check, read

from estim import EventTimes, InputError, fit_curve, fit_curves
from estim.campaign import load_campaign
from estim.cli import commands as cli
from estim.curves import DataSet, linear_in, read_formula, starting_values
from estim.curves.dimensions import dimensions_of
from estim.curves.starting_values import guess_starts
from estim.fitting.optimum import fit_optimum

NONLINEAR = [path for path in [*FILES, FOLDER / f"{HARDEST}.dat"] if path.stem not in LINEAR]
QUICK = ("Bennett5", "Chwirut2", "Eckerle4", "Kirby2", "MGH09", "MGH17", "Rat43", "Roszman1")


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("a*exp(-x/tau) + c", {"a": (0, 1), "tau": (1, 0), "c": (0, 1)}),
        ("A*exp(-b*x)*cos(2*pi*x/T + p)", {"A": (0, 1), "b": (-1, 0), "T": (1, 0), "p": (0, 0)}),
        (
            "b1*(x**2 + x*b2)/(x**2 + x*b3 + b4)",
            {"b1": (0, 1), "b2": (1, 0), "b3": (1, 0), "b4": (2, 0)},
        ),
        ("a*voigt(x - c, s, g)", {"a": (1, 1), "c": (1, 0), "s": (1, 0), "g": (1, 0)}),
        ("a*sqrt(x - x0)", {"a": (-0.5, 1), "x0": (1, 0)}),
        ("where(x > edge, a*x, b)", {"edge": (1, 0), "a": (-1, 1), "b": (0, 1)}),
        ("a*x**n", {"n": (0, 0)}),  # the unit of a depends on n
        ("a + b*cos(2*pi*x/12)", {"a": (0, 1), "b": (0, 1)}),  # 12 has a unit of its own
        ("a*b*x", {}),
    ],
)
def test_the_unit_of_a_parameter_follows_from_the_formula(
    text: str, units: dict[str, tuple[float, float]]
) -> None:
    assert dimensions_of(read_formula(text))[0] == units


def test_linear_parameters_are_linear_together() -> None:
    formula = read_formula("a*exp(-b*x) + c*d*x + f")
    assert linear_in(formula, formula.names) == ("a", "c", "f")
    assert linear_in(formula, ["d", "c", "b"]) == ("d",)


@pytest.mark.parametrize(
    ("text", "x", "true", "u"),
    [
        ("1/(1/V + K/(V*x))", (0.2, 10.0), {"V": 5.0, "K": 2.0}, 0.1),
        ("U*exp(-x/(R*1e-6))", (0.0, 0.1), {"U": 5.0, "R": 2e4}, 0.05),
        ("1/sqrt(1 + (2*pi*x*R*1e-9)**2)", (50.0, 5000.0), {"R": 1e5}, 0.01),
        ("a*x**3/(exp(6.626e-34*x/(1.381e-23*T)) - 1)", (1e12, 2e14), {"a": 1e-40, "T": 1e3}, 0.1),
        ("T0 + dT*exp(-x/(1000*t))", (0.0, 20000.0), {"T0": 20.0, "dT": 50.0, "t": 4.0}, 0.5),
    ],
)
def test_numbers_in_a_formula_do_not_hide_its_start(
    text: str, x: tuple[float, float], true: dict[str, float], u: float, rng: np.random.Generator
) -> None:
    formula, at = read_formula(text), np.linspace(*x, 25)
    y = formula.value(at, true)[0] + u * rng.standard_normal(25)
    start = guess_starts(formula, at, y, np.full(25, u), known={}, limits={})
    left = (y - formula.value(at, start)[0]) / u
    assert np.sum(left**2) < np.sum((y - formula.value(at, true)[0]) ** 2) / u**2


def test_a_small_number_makes_no_parameter_linear() -> None:
    assert linear_in(read_formula("1/sqrt(1 + (x*R*1e-6)**2)"), ["R"]) == ()
    assert linear_in(read_formula("1e-15*exp(b*x)"), ["b"]) == ()
    assert linear_in(read_formula("1/(1/V + K/(V*x))"), ["V", "K"]) == ()
    assert linear_in(read_formula("1e-15*a*exp(b*x) + c"), ["a", "b", "c"]) == ("a", "c")


@pytest.mark.parametrize("text", ["a*exp(-x*1e-34*b**0.1)", "a*exp(-x*1e34*b**0.1)"])
def test_a_scale_beyond_all_numbers_is_no_traceback(text: str) -> None:
    assert 0.0 < dimensions_of(read_formula(text))[1]["b"] < np.inf


def test_an_origin_far_off_in_the_formula_is_no_warning(rng: np.random.Generator) -> None:
    x = np.arange(0.0, 20.0, 0.5)
    y = 40.0 * np.exp(-x / 4.0) + 5.0 + rng.normal(0.0, 1.0, x.size)
    near = fit_curve("a*exp(-x/t)+b", x, y, u_y=1.0)
    far = fit_curve("a*exp(-(x-2459000.5)/t)+b", x + 2459000.5, y, u_y=1.0)
    assert far.values == pytest.approx(near.values, rel=1e-6)


def test_data_in_any_unit_give_the_same_start() -> None:
    rng = np.random.default_rng(2)
    x = np.linspace(0.0, 10.0, 60)
    y = 3.0 * np.exp(-x / 1.7) + 0.5 + 0.02 * rng.standard_normal(60)
    formula, u = read_formula("a*exp(-x/tau) + c"), np.ones(60)
    plain = guess_starts(formula, x, y, u, known={}, limits={})
    small = guess_starts(formula, 1e-9 * x, 1e6 * y, u, known={}, limits={})
    assert small == pytest.approx(
        {"a": 1e6 * plain["a"], "tau": 1e-9 * plain["tau"], "c": 1e6 * plain["c"]}, rel=1e-4
    )
    assert guess_starts(formula, x, y, u, known={"tau": 3.0}, limits={})["tau"] == 3.0
    assert guess_starts(formula, x, y, u, known={}, limits={"tau": (2.0, 9.0)})[
        "tau"
    ] == pytest.approx(2.0, rel=0.01)


def squares_without_starts(path: Path) -> float:
    """Squares that the starts leave, over the certified ones."""
    reference = read(path)
    formula = read_formula(reference.expression)
    found = guess_starts(
        formula, reference.x, reference.y, np.ones(reference.x.size), known={}, limits={}
    )
    return (
        float(np.sum((reference.y - formula.value(reference.x, found)[0]) ** 2)) / reference.squares
    )


@pytest.mark.parametrize("name", QUICK)
def test_the_certified_optimum_is_reached_without_starts(name: str) -> None:
    assert squares_without_starts(FOLDER / f"{name}.dat") < 1.0001


@pytest.mark.statistics
@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem) for path in NONLINEAR if path.stem not in QUICK]
)
def test_every_certified_optimum_is_reached_without_starts(path: Path) -> None:
    assert squares_without_starts(path) < 1.0001


def test_there_are_27_such_sets() -> None:
    # Nelson's y depends on two variables
    assert len({path.stem for path in NONLINEAR} | {"Nelson"}) == 27


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["filament", "falling_phone", "muon_binned", "alpha_counts", "balmer", "forbes"]
)
def test_formulas_of_the_gallery_reach_their_optimum_without_starts(
    name: str, project: Path, tmp_path: Path
) -> None:
    source = project / "data" / "gallery" / f"{name}.toml"
    text = source.read_text()
    bare = re.sub(r"\bstart = [-+.\de]+(, )?", "", text)
    assert bare.count("start") < text.count("start")
    for table in re.findall(r'file = "(.*)"', text):
        shutil.copy(source.parent / table, tmp_path)
    (tmp_path / "bare.toml").write_text(bare)
    ends = []
    for path in (source, tmp_path / "bare.toml"):
        campaign = load_campaign(path)
        ends.append(
            fit_optimum(
                campaign.problem(list(campaign.run_names)[:1]), rng=np.random.default_rng(1)
            )
        )
    np.testing.assert_allclose(
        (ends[1].values - ends[0].values) / np.sqrt(np.diag(ends[0].cov)), 0.0, atol=0.01
    )


@pytest.mark.parametrize("name", ["Eckerle4", "Kirby2"])
def test_one_descent_from_1_does_not_reach_them(name: str) -> None:
    """A wrong search fails where this one does not."""
    reference = read(FOLDER / f"{name}.dat")
    fit = fit_curve(
        reference.expression,
        reference.x,
        reference.y,
        start=dict.fromkeys(reference.certified, 1.0),
        scan=False,
    )
    assert fit.chi2 > 100.0 * reference.squares


def test_fit_curve_needs_no_starts() -> None:
    reference = read(FOLDER / "Chwirut2.dat")
    check(reference, fit_curve(reference.expression, reference.x, reference.y), "Chwirut2")


def test_several_data_sets_need_no_starts() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 8.0, 40)
    data = {
        name: DataSet(x, a * np.exp(-x / 2.0) + 0.05 * rng.standard_normal(40), u_y=0.05)
        for name, a in (("one", 3.0), ("two", 5.0))
    }
    fit = fit_curves("a*exp(-x/tau)", data, shared=["tau"])
    assert fit.status == "ok"
    assert abs(fit.values["tau"] - 2.0) < 4.0 * fit.sds["tau"]


def test_searches_that_end_at_different_places_ask_for_a_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    squares = iter(np.linspace(2.0, 1.0, 6))
    monkeypatch.setattr(
        starting_values,
        "_searched",
        lambda search, rng: ((np.ones(2), float(next(squares))), False),
    )
    x = np.linspace(0.0, 1.0, 20)
    with pytest.raises(
        InputError,
        match=r"'start' of b and c could not be found from the points: give one .*--start b=1, or "
        r"{start = 1.0} in",
    ):
        guess_starts(read_formula("a*sin(b*x + c)"), x, x, np.ones(20), known={}, limits={})


def test_a_formula_without_a_finite_value_asks_for_a_start() -> None:
    x = np.linspace(-2.0, -1.0, 20)
    with pytest.raises(InputError, match="'start' of n could not be found"):
        fit_curve("a*x**n", x - 0.01, x)


def test_a_table_and_a_formula_are_enough(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 10.0, 60)
    rows = zip(t, 3.0 * np.exp(-t / 1.7) + 0.5 + 0.02 * rng.standard_normal(60), strict=True)
    (tmp_path / "decay.csv").write_text(
        "t [s],U [V]\n" + "".join(f"{a:.4f},{b:.5f}\n" for a, b in rows)
    )
    said = [
        "--formula",
        "a*exp(-t/tau) + c",
        "--u-y",
        "0.02",
        "--figures",
        "none",
        "--out",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(cli.cli, ["fit", str(tmp_path / "decay.csv"), *said])
    assert done.exit_code == 0, done.output
    assert "decay: ok" in done.output
    assert "tau = {" in (tmp_path / "out" / "report.md").read_text()


def test_single_events_need_no_start_and_no_factor() -> None:
    """Only the shape of their density counts: a formula of height 1 is as good as any other."""
    times = np.random.default_rng(8).exponential(2.2, 400)
    fit = fit_curve("exp(-x/tau)", times[times < 10.0], None, noise=EventTimes(0.0, 10.0))
    assert fit.status == "ok"
    assert abs(fit.values["tau"] - 2.2) < 4.0 * fit.sds["tau"]


def test_a_start_beyond_all_numbers_in_another_data_set_is_no_warning() -> None:
    x = np.linspace(0.0, 1000.0, 40)
    sets = {
        name: DataSet(x, size * np.exp(-x / 300.0), 0.01) for name, size in (("a", 1), ("b", 2))
    }
    fit = fit_curves("a*exp(b*x)", sets, shared=["b"], start={"b": 0.5})
    assert fit.values["a[b]"] == pytest.approx(2.0, rel=1e-6)
