"""Curves that are known by name: their definitions, their starting values, sums of them."""

from __future__ import annotations

import json
from pathlib import Path

import lmfit
import numpy as np
import pytest
from command_runner import runner

from estim import EventTimes, Poisson, fit_curve, load_campaign
from estim.cli.commands import cli
from estim.common import InputError, NumericalError
from estim.curves.formula import read_formula
from estim.curves.models import MODELS, read_model
from estim.curves.starting_values import guess_starts


@pytest.mark.parametrize(
    ("sigma", "gamma"), [(1.0, 0.5), (0.3, 0.1), (0.05, 0.4), (2.0, 0.2), (0.004, 1.0), (0.0, 0.7)]
)
def test_the_voigt_profile_and_its_derivatives_are_those_of_the_convolution(
    sigma: float, gamma: float
) -> None:
    """A Lorentzian averaged over a normal distribution, by the trapezoidal rule."""
    x = np.array([-6.0, -1.3, -0.2, 0.0, 0.4, 2.0, 9.0])
    u = np.linspace(-9.0, 9.0, 40001)
    weight = np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi) * (u[1] - u[0])
    off = x[:, None] - sigma * u
    below = off**2 + gamma**2
    slope = -2.0 * off * gamma / np.pi / below**2
    found = read_formula("voigt(x, s, g)").local(x, {"s": sigma, "g": gamma})
    assert found.value[0] == pytest.approx((gamma / np.pi / below) @ weight, rel=1e-9)
    assert found.slope[0] == pytest.approx(slope @ weight, rel=1e-9, abs=1e-12)
    assert found.gradient["s"][0] == pytest.approx((-u * slope) @ weight, rel=1e-8, abs=1e-12)
    assert found.gradient["g"][0] == pytest.approx(
        ((off**2 - gamma**2) / np.pi / below**2) @ weight, rel=1e-9, abs=1e-12
    )


LMFITS = {
    "constant": lmfit.models.ConstantModel(),
    "line": lmfit.models.LinearModel(),
    "polynomial3": lmfit.models.PolynomialModel(3),
    "exponential": lmfit.models.ExponentialModel(),
    "power": lmfit.models.PowerLawModel(),
    "gaussian": lmfit.models.GaussianModel(),
    "lorentzian": lmfit.models.LorentzianModel(),
    "voigt": lmfit.models.VoigtModel(),
    "logistic": lmfit.models.StepModel(form="logistic"),
}


@pytest.mark.parametrize("name", LMFITS)
def test_a_model_is_that_of_lmfit(name: str) -> None:
    model, x = LMFITS[name], np.linspace(0.3, 4.0, 23)
    values = {parameter: 0.4 + 0.3 * i for i, parameter in enumerate(MODELS[name].parameters)}
    formula = read_formula(MODELS[name].expression)
    assert (
        set(formula.names)
        == set(MODELS[name].parameters)
        == {*model.param_names, *(["gamma"] if name == "voigt" else [])}
    )
    assert formula.value(x, values)[0] == pytest.approx(
        np.broadcast_to(model.eval(model.make_params(**values), x=x), x.shape), rel=1e-9
    )


def test_every_model_is_compared_or_an_oscillation() -> None:
    left = {name for name in MODELS if name not in LMFITS and not name.startswith("polynomial")}
    assert left == {"oscillation", "damped_oscillation"}


def test_a_sum_has_the_parameters_of_its_terms() -> None:
    asked = read_model("left_gaussian + right_gaussian+line")
    assert asked.parameters == (
        "left_amplitude",
        "left_center",
        "left_sigma",
        "right_amplitude",
        "right_center",
        "right_sigma",
        "slope",
        "intercept",
    )
    assert set(asked.formula.names) == set(asked.parameters)
    assert read_model("damped_oscillation").terms[0].prefix == ""
    assert read_model("my_damped_oscillation").terms[0].prefix == "my_"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gausian + line", "did you mean 'gaussian'"),
        ("gaussian + gaussian", 'like "a_gaussian \\+ b_gaussian"'),
        ("spam", "there are constant, line"),
        ("damped_sine", "there are constant, line"),  # not: did you mean 'line'
        (" + ".join(f"p{i}_gaussian" for i in range(9)), "at most 8 terms"),
    ],
)
def test_names_of_no_model_are_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        fit_curve(text, X, X)


def test_a_name_with_a_start_is_a_parameter() -> None:
    assert fit_curve(
        "line + constant",
        X,
        np.full(30, 3.0) + X**2 / 40,
        start={"line": 1.0},
        fixed={"constant": 1.0},
    ).names == ("line",)


X = np.linspace(0.0, 20.0, 30)


def test_starts_priors_bounds_and_fixed_values_of_the_user_hold() -> None:
    rng = np.random.default_rng(3)
    y = 20.0 / np.sqrt(2 * np.pi) * (
        np.exp(-0.5 * (X - 5.0) ** 2) + 0.5 * np.exp(-0.5 * (X - 14.0) ** 2)
    ) + 0.1 * rng.standard_normal(30)
    assert fit_curve("gaussian", X, y, u_y=0.1).values["center"] == pytest.approx(5.0, abs=0.5)
    within = fit_curve(
        "gaussian", X, y, u_y=0.1, bounds={"center": (10.0, 20.0), "sigma": (0.5, 2.0)}, scan=False
    )
    assert within.values["center"] == pytest.approx(14.0, abs=0.1)
    begun = fit_curve("gaussian", X, y, u_y=0.1, start={"center": 13.0, "sigma": 1.0}, scan=False)
    assert begun.values["center"] == pytest.approx(14.0, abs=0.1)
    both = fit_curve(
        "a_gaussian + b_gaussian",
        X,
        y,
        u_y=0.1,
        fixed={"b_center": 14.0},
        priors={"a_sigma": "1.00(1)"},
    )
    assert both.fixed == {"b_center": 14.0}
    assert both.status == "ok"
    assert both.values["a_center"] == pytest.approx(5.0, abs=0.05)
    assert both.called == "a_gaussian + b_gaussian"
    assert str(both).startswith("a_gaussian + b_gaussian: ok")


def test_starts_weigh_the_points_by_their_errors() -> None:
    asked, x, rng = read_model("gaussian"), np.linspace(0.0, 20.0, 120), np.random.default_rng(2)
    true = {"amplitude": 9.0, "center": 6.0, "sigma": 1.4}
    u = np.where(np.arange(x.size) % 3 == 0, 100.0, 0.01)
    y = asked.formula.value(x, true)[0] + u * rng.standard_normal(x.size)
    start = guess_starts(asked.formula, x, y, u, known={}, limits=asked.limits)
    assert start == pytest.approx(true, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "true"),
    [
        ("oscillation", {"amplitude": 3.0, "phase": 1.0, "frequency": 0.11}),
        (
            "damped_oscillation",
            {"amplitude": 3.0, "phase": -2.0, "frequency": 0.17, "damping": 0.05},
        ),
        (
            "a_exponential + b_exponential",
            {"a_amplitude": 8.0, "a_decay": 1.5, "b_amplitude": 3.0, "b_decay": 5.0},
        ),
        ("logistic + constant", {"amplitude": 3.0, "center": 12.0, "sigma": 1.5, "c": 1.0}),
        (
            "a_gaussian + b_lorentzian",
            {
                "a_amplitude": 9.0,
                "a_center": 6.0,
                "a_sigma": 1.4,
                "b_amplitude": 4.0,
                "b_center": 14.0,
                "b_sigma": 0.9,
            },
        ),
    ],
)
def test_without_noise_the_start_is_the_curve(text: str, true: dict[str, float]) -> None:
    """A search afterwards would hide a start of the wrong sign or phase."""
    asked, x = read_model(text), np.linspace(0.0, 20.0, 120)
    formula = asked.formula
    y = formula.value(x, true)[0]
    start = guess_starts(asked.formula, x, y, np.ones(x.size), known={}, limits=asked.limits)
    assert formula.value(x, start)[0] == pytest.approx(y, abs=1e-3 * float(np.ptp(y)))


def test_widths_in_metres_of_things_in_nanometres_are_found() -> None:
    """Limits and steps know no unit: 2e-10 is not close to a limit at 0."""
    rng = np.random.default_rng(5)
    y = (
        30.0 / np.sqrt(2 * np.pi) * np.exp(-0.5 * (X - 8.0) ** 2)
        + X
        + 0.2 * rng.standard_normal(30)
    )
    large, small = (
        fit_curve("gaussian + line", X, y, u_y=0.2),
        fit_curve("gaussian + line", X * 1e-10, y, u_y=0.2),
    )
    assert small.status == large.status == "ok"
    assert small.values["sigma"] == pytest.approx(1e-10 * large.values["sigma"], rel=1e-6)
    assert small.sds["sigma"] == pytest.approx(1e-10 * large.sds["sigma"], rel=1e-4)


def test_counts_give_starts_too() -> None:
    rng = np.random.default_rng(8)
    times = rng.exponential(2.2, 400)
    counts, edges = np.histogram(times[times < 10.0], np.linspace(0.0, 10.0, 26))
    binned = fit_curve("exponential", edges[:-1] + 0.2, counts, noise=Poisson(bins=0.4), scan=False)
    single = fit_curve(
        "exponential",
        times[times < 10.0],
        None,
        noise=EventTimes(0.0, 10.0),
        fixed={"amplitude": 1.0},
        scan=False,
    )
    for fit in (binned, single):
        assert fit.status == "ok"
        assert abs(fit.values["decay"] - 2.2) < 4.0 * fit.sds["decay"]


def test_a_power_of_negative_numbers_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="no finite value at these x"):
        fit_curve("power", -X - 0.123, X)


EVERYTHING = (
    "constant",
    "line",
    "polynomial3",
    "exponential",
    "power",
    "gaussian",
    "lorentzian",
    "voigt",
    "oscillation",
    "damped_oscillation",
    "logistic",
    "gaussian + line",
    "left_gaussian + right_gaussian + constant",
    "a_lorentzian + b_exponential",
    "logistic + constant",
    "damped_oscillation + line",
    "a_exponential + b_exponential",
)


def reached(text: str, rng: np.random.Generator, *, blind: bool = False) -> bool:
    """Whether the search from the starts found, alone, is as good as that from the truth.  blind :
    from 1 everywhere in their place.
    """
    x, y, u, truth = synthetic(text, rng)
    ones = dict.fromkeys(truth, 1.0) if blind else None
    try:
        found = fit_curve(text, x, y, u_y=u, scan=False, start=ones)
    except (InputError, NumericalError):
        return False
    return found.chi2 < fit_curve(text, x, y, u_y=u, scan=False, start=truth).chi2 + 0.01


@pytest.mark.parametrize("text", EVERYTHING[::4])
def test_starts_lead_to_the_optimum(text: str) -> None:
    assert reached(text, np.random.default_rng(1))


@pytest.mark.statistics
def test_starts_lead_to_the_optimum_in_more_than_95_of_100_random_data_sets() -> None:
    rng = np.random.default_rng(11)
    found = [reached(text, rng) for text in EVERYTHING for _ in range(5)]
    assert np.mean(found) >= 0.95
    assert np.mean([reached(text, rng, blind=True) for text in EVERYTHING[3:]]) < 0.6


def synthetic(
    text: str, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float, dict[str, float]]:
    """Random points of the model `text` in random units: x and y between 1e-9 and 1e9, 30 to 119 of
    them, u between 0.1 and 5 % of the range.
    """
    asked, n, length = read_model(text), int(rng.integers(30, 120)), 10.0 ** rng.uniform(-9, 9)
    low = length * (
        rng.uniform(0.02, 0.3) if "power" in text else rng.choice([0.0, rng.uniform(-1, 1)])
    )
    even = "oscillation" in text or rng.random() < 0.5
    x = low + length * (np.linspace(0.0, 1.0, n) if even else np.sort(rng.uniform(0.0, 1.0, n)))
    height, values, y = 10.0 ** rng.uniform(-6, 6), dict[str, float](), np.zeros(n)
    for term in asked.terms:
        bent = SHAPES.get(term.model.name, lambda *_: {})(rng, low, length, length / (n - 1))
        unit = {name: rng.normal() for name in term.model.parameters if name not in bent}
        unit |= {
            name: value / length ** int(name[1:])
            for name, value in unit.items()
            if name[0] == "c" and name[1:].isdigit()
        }
        unit |= {"slope": unit["slope"] / length} if "slope" in unit else {}
        curve = read_formula(term.model.expression).value(x, {**unit, **bent})[0]
        size = height * 10.0 ** rng.uniform(-0.3, 0.3) / float(np.ptp(curve) or abs(curve[0]))
        unit = {name: value * (1.0 if name == "phase" else size) for name, value in unit.items()}
        values |= term.renamed({**unit, **bent})
        y = y + curve * size
    u = height * 10.0 ** rng.uniform(-3.0, -1.3)
    return x, y + u * rng.standard_normal(n), u, values


def _peak(rng: np.random.Generator, low: float, length: float, step: float) -> dict[str, float]:
    return {
        "center": low + length * rng.uniform(0.1, 0.9),
        "sigma": np.exp(rng.uniform(np.log(1.5 * step), np.log(length / 5))),
    }


def _wave(rng: np.random.Generator, low: float, length: float, step: float) -> dict[str, float]:
    return {"frequency": np.exp(rng.uniform(np.log(0.8 / length), np.log(0.4 / step)))}


SHAPES = {
    "exponential": lambda rng, low, length, step: {
        "decay": rng.choice([-1, 1]) * length * 10.0 ** rng.uniform(-0.8, 0.7)
    },
    "power": lambda rng, low, length, step: {"exponent": rng.uniform(-4, 4)},
    "gaussian": _peak,
    "lorentzian": _peak,
    "voigt": lambda *given: (
        (peak := _peak(*given)) | {"gamma": peak["sigma"] * 10.0 ** given[0].uniform(-0.5, 0.5)}
    ),
    "oscillation": _wave,
    "damped_oscillation": lambda *given: (
        _wave(*given) | {"damping": given[0].uniform(0, 4) / given[2]}
    ),
    "logistic": lambda rng, low, length, step: {
        "center": low + length * rng.uniform(0.2, 0.8),
        "sigma": rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(0.5 * step), np.log(length / 8))),
    },
}


def swings(text: str, seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Noisy points of the sum of oscillations `text`, and its parameters: amplitudes positive,
    phases within half a turn, frequencies rising.
    """
    rng = np.random.default_rng(seed)
    x, y, truth = np.arange(80) / 10.0 + rng.choice([0.0, 3.0]), np.zeros(80), {}
    for i, term in enumerate(read_model(text).terms):
        values = {
            "amplitude": rng.uniform(2.0, 9.0),
            "frequency": rng.uniform(0.4, 1.2) + i,
            "phase": rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 3.1),
            "damping": rng.uniform(0.02, 0.2),
            "c": rng.normal(),
        }
        values = {name: values[name] for name in term.model.parameters}
        y += read_formula(term.model.expression).value(x, values)[0]
        truth |= term.renamed(values)
    return x, y + 0.1 * rng.standard_normal(80), truth


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", ["oscillation", "damped_oscillation + constant", "a_oscillation + b_oscillation"]
)
def test_a_swing_has_a_positive_amplitude_and_a_phase_within_half_a_turn(text: str) -> None:
    """-amplitude with phase + pi is the same curve, and so is a swing exchanged with another: two
    of these are, where starts are not put in order.
    """
    for seed in (1, 5, 6):
        x, y, truth = swings(text, seed)
        found = fit_curve(text, x, y, u_y=0.1)
        assert found.status == "ok", (seed, found.reasons)
        for name, value in truth.items():
            assert abs(found.values[name] - value) < 5.0 * found.sds[name], (seed, name)
    # what is stated of the amplitude has the last word
    x, y, truth = swings("oscillation", 1)
    turned = fit_curve("oscillation", x, y, u_y=0.1, bounds={"amplitude": (None, 0.0)})
    assert turned.values["amplitude"] == pytest.approx(-truth["amplitude"], abs=0.1)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_so_it_has_at_the_command_line(tmp_path: Path) -> None:
    for seed in range(3):
        x, y, truth = swings("damped_oscillation", seed)
        rows = "\n".join(f"{t:.6f},{v:.6f}" for t, v in zip(x, y, strict=True))
        (tmp_path / "swing.csv").write_text(f"t (s),y (cm)\n{rows}\n")
        words = ["fit", tmp_path / "swing.csv", "--formula", "damped_oscillation", "--u-y", "0.1"]
        done = runner().invoke(cli, [*map(str, words), "--out", str(tmp_path / "out")])
        assert done.exit_code == 0, done.output
        record = json.loads((tmp_path / "out" / "result.json").read_bytes())
        for name, value in truth.items():
            of = record["parameters"][name]
            assert abs(of["mean"] - value) < 5.0 * of["sd"], (seed, name)


CAMPAIGN = """
title = "Two peaks"
kind = "synthetic"
[curve]
model = "left_gaussian + right_gaussian + constant"
x = {column = "e_keV", unit = "keV"}
y = "rate"
u_y = 0.5
[curve.parameters]
left_center = {unit = "keV"}
c = 2.0
[[runs]]
name = "first"
file = "first.csv"
[[runs]]
name = "second"
file = "second.csv"
[runs.parameters]
left_amplitude = {}
"""


def campaign(folder: Path, text: str = CAMPAIGN) -> Path:
    (folder / "campaign.toml").write_text(text)
    rng, x = np.random.default_rng(4), np.linspace(0.0, 20.0, 81)
    for name, area in (("first", 30.0), ("second", 50.0)):
        peaks = area / 1.2 * np.exp(-0.5 * ((x - 8.0) / 1.2) ** 2) + 12.0 / 0.8 * np.exp(
            -0.5 * ((x - 12.0) / 0.8) ** 2
        )
        y = 2.0 + peaks / np.sqrt(2.0 * np.pi) + 0.5 * rng.standard_normal(81)
        np.savetxt(
            folder / f"{name}.csv",
            np.column_stack([x, y]),
            delimiter=",",
            header="e_keV,rate",
            comments="",
        )
    return folder / "campaign.toml"


@pytest.mark.slow
def test_a_campaign_may_name_its_model(tmp_path: Path) -> None:
    problem = load_campaign(campaign(tmp_path)).problem(["first", "second"])
    starts = {p.name: p.prior.centre for p in problem.parameters}
    shared = {"left_center", "left_sigma", "right_amplitude", "right_center", "right_sigma"}
    assert set(starts) == shared | {"left_amplitude[first]", "left_amplitude[second]"}
    truth = {
        "left_center": 8.0,
        "left_sigma": 1.2,
        "right_center": 12.0,
        "left_amplitude[first]": 30.0,
        "left_amplitude[second]": 50.0,
    }
    assert {name: starts[name] for name in truth} == pytest.approx(truth, rel=0.1)
    assert next(p for p in problem.parameters if p.name == "left_center").unit == "keV"
    begun = CAMPAIGN.replace(
        "c = 2.0", "c = 2.0\nleft_sigma = {start = 1.0}\nright_sigma = {start = 1.0, low = -5.0}"
    )
    told = {
        p.name: p.prior
        for p in load_campaign(campaign(tmp_path, begun)).problem(["first", "second"]).parameters
    }
    # the model's limit, and one that was stated
    assert (told["left_sigma"].low, told["right_sigma"].low) == (0.0, -5.0)


@pytest.mark.parametrize(
    ("written", "instead", "said"),
    [
        (
            "right_gaussian",
            "right_gausian",
            "5: 'model' must name a model .did you mean 'gaussian'",
        ),
        (
            "model",
            'expression = "a*x"\nmodel',
            "4: 'curve' must have an 'expression', or a 'model' .*not both",
        ),
        (
            'model = "left_gaussian + right_gaussian + constant"',
            "",
            "4: 'curve' must have an 'expression', or a 'model'",
        ),
        ("c = 2.0", "d = 2.0", "11: 'd' is not in the formula"),
        (
            "c = 2.0",
            "c = 2.0\nleft_sigma = {start = -1.0}",
            r"12: 'left_sigma' 'start' must lie within \[0, inf\]: -1",
        ),
        (
            "c = 2.0",
            "c = 2.0\nleft_sigma = {low = 3.0, high = 1.0}",
            "12: 'left_sigma' 'low' must be below 'high': 3",
        ),
    ],
)
def test_what_is_wrong_with_a_model_is_said_with_its_line(
    tmp_path: Path, written: str, instead: str, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        load_campaign(campaign(tmp_path, CAMPAIGN.replace(written, instead)))


def test_the_page_has_every_model(project: Path) -> None:
    page = (project / "docs" / "your-own-curve.md").read_text()
    assert [name for name in MODELS if f"| `{name}`" not in page] == [
        f"polynomial{degree}" for degree in range(3, 8)
    ]


def test_a_model_within_a_formula_is_no_parameter() -> None:
    x = np.linspace(0.0, 5.0, 40)
    rule = "uses the model 'damped_oscillation' inside a formula.*amplitude\\*exp"
    with pytest.raises(InputError, match=rule):
        fit_curve("damped_oscillation + s*heaviside(x - 3, 0)", x, np.cos(3.0 * x), u_y=0.1)
    fit = fit_curve("gaussian*x", x, 2.0 * x, u_y=0.1, start={"gaussian": 1.0})
    assert fit.values["gaussian"] == pytest.approx(2.0)
