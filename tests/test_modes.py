"""Several solutions: aliases, many dips of a frequency, exchanged components; against brute force
that shares no code.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit
from troubles import Formula

from estim import CurveFit, DataSet, fit_curve, fit_curves
from estim.campaign import load_campaign
from estim.common import InputError
from estim.fitting.symmetry_search import find_symmetry
from estim.pipeline import analyse, sample_curve
from estim.problem import Uniform
from estim.problem.symmetry import folded, same_curves
from estim.sampling.chain import Target
from estim.words import describe

SINE = "A*sin(2*pi*f*x + p)"
WAVE = "A*sin(2*pi*f*x) + B*cos(2*pi*f*x)"
WHOLE = np.arange(20.0)
T = np.linspace(0.0, 10.0, 41)


def swing(**choices: object) -> CurveFit:
    y = 2.0 * np.sin(2.0 * np.pi * 0.13 * WHOLE + 0.4) + 0.05 * np.random.default_rng(
        1
    ).standard_normal(WHOLE.size)
    return fit_curve(
        SINE, WHOLE, y, **({"start": {"A": 1.0, "f": 0.9, "p": 0.0}, "u_y": 0.05} | choices)
    )


# aliases: the same at every measured point, another curve between them


@pytest.mark.slow
def test_aliases_within_the_bounds_are_several_solutions() -> None:
    fit = swing(bounds={"f": (0.0, 2.0)})
    assert fit.status == "multimodal"
    frequencies = sorted([fit.values["f"], *fit.fit.others[:, 1]])
    assert frequencies == pytest.approx([0.13, 0.87, 1.13, 1.87], abs=1e-3)
    assert fit.reasons[0].count("25 % of the posterior") == 4
    assert "a range that contains one of them" in fit.reasons[0]
    unstated = swing(bounds={"f": (0.0, 2.0)}, u_y=None)
    assert unstated.status == "multimodal"


def test_bounds_that_hold_one_alias_leave_one_solution() -> None:
    fit = swing(bounds={"f": (0.0, 0.5)}, start={"A": 1.0, "f": 0.3, "p": 0.0})
    assert fit.status == "ok"
    assert fit.values["f"] == pytest.approx(0.13, abs=4 * fit.sds["f"])
    assert fit.fit.others.size == 0


@pytest.mark.slow
def test_without_bounds_the_smoothest_alias_is_meant_unless_the_start_says_another() -> None:
    fit = swing(start={"A": 1.0, "f": 0.4, "p": 0.0})
    assert fit.status == "ok"
    assert fit.values["f"] == pytest.approx(0.13, abs=1e-3)
    assert "curves that vary faster between the points pass through them too" in fit.message
    fast = swing()
    assert fast.status == "multimodal"
    assert fast.values["f"] == pytest.approx(0.87, abs=1e-3)


def test_uneven_points_have_no_aliases() -> None:
    x = WHOLE + np.random.default_rng(5).uniform(-0.3, 0.3, WHOLE.size)
    y = 2.0 * np.sin(2.0 * np.pi * 0.13 * x + 0.4) + 0.05 * np.random.default_rng(
        1
    ).standard_normal(x.size)
    fit = fit_curve(
        SINE, x, y, start={"A": 1.0, "f": 0.9, "p": 0.0}, u_y=0.05, bounds={"f": (0.0, 2.0)}
    )
    assert fit.status == "ok"
    assert fit.values["f"] == pytest.approx(0.13, abs=1e-3)


EVEN = np.linspace(0.0, 10.0, 60)
SLIT = "I*(sin(k*(x - c))/(k*(x - c)))**2"


def rabi(seed: int) -> np.ndarray:
    return 3.0 * np.sin(1.4 * EVEN) ** 2 + 0.1 * np.random.default_rng(seed).standard_normal(60)


@pytest.mark.parametrize("seed", [2, 3, 4, 7, 10])
def test_a_square_of_a_sine_is_the_slowest_that_passes_through_the_points(seed: int) -> None:
    """17.135, beyond what the points can show, was given for 1.4 in 9 of 20 sets, without a
    word.
    """
    found = fit_curve("A*sin(w*x)**2", EVEN, rabi(seed), u_y=0.1)
    assert found.status == "ok"
    assert abs(found.values["w"] - 1.4) < 5.0 * found.sds["w"]


@pytest.mark.parametrize("seed", [0, 3, 5, 6])
def test_a_product_of_cosines_is_the_slowest_that_passes_through_the_points(seed: int) -> None:
    x = np.linspace(0.0, 10.0, 80)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(80)
    y = 3.0 * np.cos(2.0 * x) * np.cos(0.3 * x) + noise
    found = fit_curve("A*cos(w*x)*cos(q*w*x)", x, y, u_y=0.05)
    assert found.status == "ok"
    both = found.values["w"], found.values["q"] * found.values["w"]
    assert sorted(both) == pytest.approx([0.3, 2.0], abs=0.01)


def test_counts_of_the_square_of_a_sine_are_those_of_the_slowest() -> None:
    for seed in (2, 5):
        rng = np.random.default_rng(seed)
        y = rng.poisson(100.0 * np.sin(1.4 * EVEN) ** 2 + 5.0)
        found = fit_curve("A*sin(w*x)**2 + b", EVEN, y, noise="poisson")
        assert found.status == "ok"
        assert abs(found.values["w"] - 1.4) < 5.0 * found.sds["w"]


@pytest.mark.parametrize("fast", [{"w": 54.2}, {"T": np.pi / 54.2}])
def test_a_start_far_beyond_what_points_show_does_not_hide_the_slowest(fast: dict) -> None:
    """It is what the start says, and one of several: two descents beside it never saw the slow
    one, so that it was `ok`.
    """
    (name,) = fast
    curve = "A*sin(w*x)**2" if name == "w" else "A*sin(pi*x/T)**2"
    for seed in range(2):
        found = fit_curve(curve, EVEN, rabi(seed), u_y=0.1, start={**fast, "A": 3.0}, scan=True)
        assert found.status == "multimodal"
        assert found.values[name] == pytest.approx(fast[name], rel=0.01)
        slow = 1.4 if name == "w" else np.pi / 1.4
        others = found.fit.others[:, found.names.index(name)]
        assert np.min(np.abs(others - slow)) < 0.01 * slow


@pytest.mark.parametrize("start", [None, {"k": 2.5, "c": 4.0, "I": 2.0}])
def test_a_single_slit_is_the_curve_that_everybody_draws(start: dict | None) -> None:
    """Faster curves with another centre pass through nearly the same points: k = 71.6 with I = 1609
    held more of the posterior, as I is written.
    """
    for seed in range(3):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(60)
        y = 2.0 * np.sinc(0.8 * (EVEN - 4.0)) ** 2 + noise
        found = fit_curve(SLIT, EVEN, y, u_y=0.05, **({} if start is None else {"start": start}))
        assert found.status == "ok"
        assert abs(found.values["k"] - 0.8 * np.pi) < 5.0 * found.sds["k"]
        assert "curves that vary faster between the points pass through them too" in found.message


@pytest.mark.slow
def test_two_slits_are_the_curve_that_everybody_draws() -> None:
    curve = "I*cos(a*(x - c))**2*(sin(b*(x - c))/(b*(x - c)))**2"
    for seed in range(3):
        noise = 0.1 * np.random.default_rng(seed).standard_normal(60)
        y = 4.0 * np.cos(3.0 * (EVEN - 5.0)) ** 2 * np.sinc(0.3 * (EVEN - 5.0)) ** 2 + noise
        found = fit_curve(curve, EVEN, y, u_y=0.1)
        assert found.status == "ok"
        assert abs(found.values["b"] - 0.3 * np.pi) < 5.0 * found.sds["b"]


def test_few_readings_that_several_frequencies_explain_stay_multimodal() -> None:
    """Curves that are as good but pass through other points are no aliases, without limits too."""
    for seed in (0, 5, 6):
        x, y = seven(seed)
        assert fit_curve(WAVE, x, y, u_y=0.5).status == "multimodal"


@pytest.mark.slow
def test_aliases_of_a_campaign_have_their_shares_and_their_evidence(tmp_path: Path) -> None:
    """Four equal solutions hold four times the integral of one."""
    limits = {4: "2.0", 1: "0.5"}
    found = {}
    for n, high in limits.items():
        text = (
            Formula(
                "A*sin(20*pi*f*x + p)",
                "",
                lambda x: 2.0 * np.sin(2.6 * np.pi * x + 0.4),
                error=0.1,
                u_y="0.1",
            )
            .write(tmp_path)
            .read_text()
        )
        rows = (("A", 1.0, 0.0, 10.0), ("f", 0.3, 0.0, high), ("p", 0.0, -3.2, 3.2))
        table = "".join(
            f"{name} = {{start = {start}, low = {low}, high = {top}}}\n"
            for name, start, low, top in rows
        )
        (tmp_path / "campaign.toml").write_text(
            text.replace("[curve.parameters]\n", f"[curve.parameters]\n{table}")
        )
        found[n] = analyse(
            load_campaign(tmp_path / "campaign.toml"), ["r"], seed=1, target=Target(ess=1000.0)
        )
    assert found[1].diagnosis.status == "ok"
    assert found[4].diagnosis.status == "multimodal"
    assert found[4].modes.shares == pytest.approx(np.full(4, 0.25), abs=0.06)
    # per unit of f: the prior of f is four times as wide
    excess = found[4].certificate.log_evidence - found[1].certificate.log_evidence
    assert excess == pytest.approx(np.log(4.0) - np.log(2.0 / 0.5), abs=0.06)


# seven points and a frequency


def seven(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0.0, 6.0, 7))
    return x, 2.0 * np.sin(2.0 * np.pi * 0.731 * x + 0.4) + 0.5 * rng.standard_normal(7)


def fit_seven(seed: int, *, scan: bool = True) -> CurveFit:
    x, y = seven(seed)
    start, bounds = (
        {"A": 1.0, "B": 1.0, "f": 1.0},
        {"A": (-10.0, 10.0), "B": (-10.0, 10.0), "f": (0.0, 10.0)},
    )
    return fit_curve(WAVE, x, y, start=start, bounds=bounds, u_y=0.5, scan=scan)


def grid_evidence(
    x: np.ndarray, y: np.ndarray, *, high: float = 10.0, reach: float = 10.0, u: float = 0.5
) -> float:
    """log of the mean likelihood over A, B in [-reach, reach] and f in [0, high], by the midpoint
    rule on a grid.
    """
    f, a = (
        (np.arange(2000) + 0.5) * high / 2000,
        -reach + (np.arange(100) + 0.5) * 2.0 * reach / 100,
    )
    s, c = np.sin(2.0 * np.pi * np.outer(f, x)), np.cos(2.0 * np.pi * np.outer(f, x))
    total, top = 0.0, 0.0
    for k in range(0, f.size, 200):
        i = slice(k, k + 200)
        ys, yc, ss, cc, sc = (
            v[:, None, None]
            for v in (
                s[i] @ y,
                c[i] @ y,
                (s[i] ** 2).sum(1),
                (c[i] ** 2).sum(1),
                (s[i] * c[i]).sum(1),
            )
        )
        square = (
            y @ y
            - 2 * a[:, None] * ys
            - 2 * a * yc
            + a[:, None] ** 2 * ss
            + a**2 * cc
            + 2 * a[:, None] * a * sc
        )
        total += float(np.sum(np.exp(top - 0.5 * square / u**2)))
    return float(np.log(total / (f.size * a.size**2)) - x.size * np.log(u * np.sqrt(2.0 * np.pi)))


def misled(fit: CurveFit) -> bool:
    """Whether a number is given that is more than 4 standard deviations from the truth."""
    return fit.status == "ok" and not abs(fit.values["f"] - 0.731) <= 4.0 * fit.sds["f"]


@pytest.mark.statistics
def test_seven_points_mislead_nobody_about_a_frequency() -> None:
    assert not any(misled(fit_seven(seed)) for seed in range(20))
    # the wrong way: one descent from the start
    wrong = (seed for seed in range(40) if misled(fit_seven(seed, scan=False)))
    assert len(list(islice(wrong, 10))) == 10


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.statistics)])
def test_evidence_of_many_solutions_is_that_of_a_grid(seed: int) -> None:
    fit = fit_seven(seed)
    found = sample_curve(fit, seed=1, target=Target(ess=500.0))
    expected = grid_evidence(*seven(seed))
    assert found.diagnosis.status == "multimodal"
    assert found.certificate.log_evidence == pytest.approx(expected, abs=0.05)
    if seed == 1:  # in the second data set one solution holds 98 %
        # it needs no chain
        best_alone = sample_curve(
            fit_seven(seed, scan=False), seed=1, target=Target(max_step=60)
        ).certificate.log_evidence
        assert abs(best_alone - expected) > 0.15


# the same curve under another label

DECAYS = (
    2.0 * np.exp(-0.2 * T)
    + 3.0 * np.exp(-1.5 * T)
    + 0.02 * np.random.default_rng(1).standard_normal(T.size)
)
TWO = "a*exp(-k*x) + b*exp(-q*x)"


def test_exchange_of_two_exponentials_is_named_and_no_second_solution() -> None:
    fit = fit_curve(TWO, T, DECAYS, start={"a": 1.0, "b": 1.0, "k": 0.1, "q": 3.0}, u_y=0.02)
    assert fit.status == "ok"
    assert fit.values["k"] == pytest.approx(0.2, abs=4 * fit.sds["k"])
    assert (
        "components are exchanged (a with b and k with q): set bounds that order them"
        in fit.message
    )
    assert "the starting values led to this optimum" in fit.message
    ordered = fit_curve(
        TWO,
        T,
        DECAYS,
        start={"a": 1.0, "b": 1.0, "k": 0.1, "q": 3.0},
        u_y=0.02,
        bounds={"k": (0.0, 0.8), "q": (0.8, 9.0)},
    )
    assert "exchanged" not in ordered.message
    assert ordered.values == pytest.approx(fit.values)


@pytest.mark.slow
def test_draws_of_two_exponentials_describe_one_label() -> None:
    """Badly separated rates: without folding the draws wander from one label to the other and their
    means mean nothing.
    """
    y = (
        2.0 * np.exp(-0.5 * T)
        + 3.0 * np.exp(-1.0 * T)
        + 0.06 * np.random.default_rng(4).standard_normal(T.size)
    )
    bounds = {"a": (0.0, 8.0), "b": (0.0, 8.0), "k": (0.05, 4.0), "q": (0.05, 4.0)}
    fit = fit_curve(
        TWO, T, y, start={"a": 1.0, "b": 1.0, "k": 0.3, "q": 2.0}, u_y=0.06, bounds=bounds
    )
    found = sample_curve(fit, seed=1, target=Target(max_step=200))
    draws, at, weight = found.chain.flat, found.fit.values, fit.fit.symmetry.weight
    away = np.sum(weight * (draws - at) ** 2, axis=1)
    assert np.all(
        away <= np.sum(weight * (draws[:, [1, 0, 3, 2]] - at) ** 2, axis=1) * (1.0 + 1e-9)
    )
    assert np.mean(draws[:, 2] < draws[:, 3]) > 0.99  # the amplitudes count a little
    assert fit.names == ("a", "b", "k", "q")
    assert any("exchanged" in note for note in found.diagnosis.notes)
    assert len(found.modes.values) == 1


def test_folded_posterior_keeps_the_whole_integral() -> None:
    """Importance sampling of the posterior itself over the box, and of the folded one: the same
    evidence, one label.
    """
    twins = fit_curve(
        "exp(-k*x) + exp(-q*x)",
        T[:9],
        np.exp(-0.5 * T[:9]) + np.exp(-T[:9]),
        start={"k": 0.3, "q": 2.0},
        u_y=0.3,
        bounds={"k": (0.0, 3.0), "q": (0.0, 2.5)},
    ).fit
    box = np.random.default_rng(0).uniform([0.0, 0.0], [3.0, 2.5], (40_000, 2))
    whole = np.exp(twins.posterior.log_density(box))
    half = np.exp(folded(twins.posterior, twins.symmetry, twins.values, twins.cov).log_density(box))
    assert np.mean(half) == pytest.approx(np.mean(whole), rel=0.05)
    assert 0.3 < np.mean(half > 0.0) < 0.7


@pytest.mark.parametrize(
    ("curve", "start", "n_label", "words"),
    [
        (TWO, {"a": 1.0, "b": 2.0, "k": 0.1, "q": 3.0}, 2, "a with b and k with q"),
        (
            "a*exp(-k*x) - b*exp(-q*x) + c",
            {"a": 1.0, "b": 2.0, "k": 0.1, "q": 3.0, "c": 0.5},
            2,
            "a with b and k with q",
        ),
        pytest.param(
            "a*exp(-k*x) + b*exp(-q*x) + c*exp(-r*x)",
            {"a": 1.0, "b": 2.0, "c": 0.7, "k": 0.1, "q": 3.0, "r": 0.6},
            6,
            "b with c and q with r",
            marks=pytest.mark.slow,
        ),
        (
            "a*exp(-(x - m)**2/2/s**2) + b*exp(-(x - n)**2/2/t**2)",
            {"a": 1.0, "b": 2.0, "m": 3.0, "n": 6.0, "s": 1.0, "t": 0.7},
            8,
            "s with t",
        ),
        (SINE, {"A": 1.0, "f": 0.3, "p": 0.2}, 4, "-A, p + pi"),
        ("A*sin(radians(360*f*x + p))", {"A": 1.0, "f": 0.3, "p": 20.0}, 4, "-A, p + 180"),
        ("a**2*x", {"a": 2.0}, 2, "-a"),
        # none: a rate and a rate of another kind, a line, a decay towards a level
        ("a*exp(-k*x) + b*exp(-q*x**2)", {"a": 1.0, "b": 2.0, "k": 0.1, "q": 3.0}, 1, ""),
        ("a + b*x", {"a": 1.0, "b": 1e-13}, 1, ""),
        ("a*exp(-x/tau) + c", {"a": 1e12, "tau": 2e12, "c": 0.0}, 1, ""),
    ],
)
def test_symmetries_of_a_curve_are_found_and_named(
    curve: str, start: dict[str, float], n_label: int, words: str
) -> None:
    x = T * max(1.0, start.get("tau", 1.0))
    names = {"exp": np.exp, "sin": np.sin, "radians": np.radians, "pi": np.pi}
    fit = fit_curve(
        curve, x, eval(curve, names, {"x": x, **start}), start=start, u_y=0.1, scan=False
    )
    found = find_symmetry(
        fit.problem, np.array(list(start.values())), range(len(start)), np.random.default_rng(0)
    )
    assert found.shift.shape[0] == n_label
    assert words in "; ".join(
        map(describe, same_curves(found, fit.names, np.array(list(start.values()))))
    )


def test_a_full_turn_within_bounds_is_the_same_solution_and_said() -> None:
    fit = swing(
        start={"A": 1.0, "f": 0.1, "p": 6.0},
        bounds={"p": (0.0, 13.0), "f": (0.0, 0.5), "A": (0.0, None)},
    )
    assert fit.status == "ok"
    # the one closest to the start
    assert fit.values["p"] == pytest.approx(0.4 + 2.0 * np.pi, abs=0.1)
    assert "the limits of p hold a full turn" in fit.message
    noise = fit.problem.runs[0].noise
    assert "turn" not in noise.describe(x_unit="1", y_unit="1", words=fit.problem.runs[0].words)


def test_an_exchange_hides_no_other_solution() -> None:
    """Two waves may be exchanged, and each may be an alias: the first is a note, the second is
    not.
    """
    y = (
        2.0 * np.sin(2 * np.pi * 0.13 * WHOLE)
        + np.sin(2 * np.pi * 0.31 * WHOLE)
        + 0.02 * np.random.default_rng(2).standard_normal(20)
    )
    curve, start = "A*sin(2*pi*f*x) + B*sin(2*pi*g*x)", {"A": 1.0, "B": 1.0, "f": 0.1, "g": 0.3}
    several = fit_curve(
        curve, WHOLE, y, start=start, u_y=0.02, bounds={"f": (0.0, 1.0), "g": (0.0, 1.0)}
    )
    assert several.status == "multimodal"
    alone = fit_curve(
        curve, WHOLE, y, start=start, u_y=0.02, bounds={"f": (0.0, 0.5), "g": (0.0, 0.5)}
    )
    assert alone.status == "ok"
    assert "A with B and f with g" in alone.message


RATIO = "a*exp(-x/t) + b*exp(-x/(t*r))"
TWO_TIMES = (
    4.0 * np.exp(-T) + 6.0 * np.exp(-T / 5.0) + 0.02 * np.random.default_rng(1).standard_normal(41)
)


@pytest.mark.parametrize(
    ("formula", "choices"),
    [
        (RATIO, {}),
        (RATIO, {"bounds": {"t": (0.01, 100.0), "r": (0.01, 100.0)}}),
        (RATIO, {"priors": {"t": Uniform(0.1, 10.0), "r": Uniform(0.1, 10.0)}, "start": {"a": 1}}),
        ("s*(f*exp(-x/t) + (1 - f)*exp(-x/(t*r)))", {}),
        ("a*exp(-x/t) + b*exp(-x/u)", {"tied": {"u": "r*t"}, "start": {"r": 4.0}}),
        ("a*exp(-x/t) + b*exp(-x/u)", {"tied": {"u": "r*t"}, "start": {"r": 0.3}}),
        ("a*exp(-x/t) + b*exp(-x/u)", {"tied": {"b": "r*a"}, "start": {"r": 2.0}}),
        ("a*exp(-x/t) + b*exp(-x/u)", {"tied": {"b": "r*a"}, "start": {"r": 0.5}}),
    ],
)
def test_components_that_a_ratio_ties_are_exchanged_and_no_second_solution(
    formula: str, choices: dict
) -> None:
    """r becomes 1/r and t becomes r*t, which is no exchange of parameters: the weight of each
    spelling depends on the ratio, that of the curve does not.
    """
    plain = fit_curve("a*exp(-x/t) + b*exp(-x/u)", T, TWO_TIMES, u_y=0.02)
    fit = fit_curve(formula, T, TWO_TIMES, u_y=0.02, **choices)
    assert fit.status == "ok", fit.reasons
    assert fit.chi2 == pytest.approx(plain.chi2, rel=1e-9)
    assert fit.values["t"] == pytest.approx(plain.values["t"], rel=1e-6) or fit.values[
        "t"
    ] == pytest.approx(plain.values["u"], rel=1e-6)
    if "r" in choices.get("start", {}):  # the one that was meant
        assert (fit.values["r"] > 1.0) == (choices["start"]["r"] > 1.0)
    if choices.get("start") == {"r": 4.0}:  # the scan meets the other one
        assert "the curve is the same with other parameter values" in fit.message


def test_draws_of_components_that_a_ratio_ties_describe_one_solution() -> None:
    fit = fit_curve(RATIO, T, TWO_TIMES, u_y=0.02, start={"t": 1.0, "r": 5.0})
    found = sample_curve(fit, seed=1, target=Target(max_step=200))
    assert found.diagnosis.status == "ok"
    assert np.min(found.chain.flat[:, fit.names.index("r")]) > 4.0
    assert any("other parameter values" in note for note in found.diagnosis.notes)


def test_a_range_of_a_shift_that_holds_several_says_that_each_is_meant() -> None:
    """Draws would go from one to the next; of what a ratio ties they do not."""
    y = 8.0 * np.sin(4.5 * (T - 0.2)) + 0.3 * np.random.default_rng(1).standard_normal(41)
    fit = fit_curve("A*sin(w*(x - t0))", T, y, u_y=0.3, bounds={"t0": (0.0, 5.0)})
    assert fit.status == "multimodal"
    assert fit_curve("A*sin(w*(x - t0))", T, y, u_y=0.3).status == "ok"


def test_a_ratio_hides_no_other_solution() -> None:
    """Two waves whose frequencies a ratio ties may change places, and each may be an alias."""
    y = (
        2.0 * np.sin(2 * np.pi * 0.13 * WHOLE)
        + np.sin(2 * np.pi * 0.31 * WHOLE)
        + 0.02 * np.random.default_rng(2).standard_normal(20)
    )
    fit = fit_curve(
        "A*sin(2*pi*f*x) + B*sin(2*pi*f*r*x)",
        WHOLE,
        y,
        start={"A": 1.0, "B": 1.0, "f": 0.1, "r": 3.0},
        u_y=0.02,
        bounds={"f": (0.05, 1.0), "r": (0.1, 6.0)},
    )
    assert fit.status == "multimodal"
    assert "the curve is the same with other parameter values" not in fit.reasons[0]


@pytest.mark.parametrize("distance", [6.0, -6.0])
def test_a_distance_between_two_peaks_keeps_the_sign_of_its_start(distance: float) -> None:
    x = np.arange(0.0, 20.0, 0.5)
    right = (
        100.0 * np.exp(-((x - 6.0) ** 2) / 2.88) + 60.0 * np.exp(-((x - 12.0) ** 2) / 2.88) + 5.0
    )
    fit = fit_curve(
        "l_gaussian + r_gaussian + constant",
        x,
        np.random.default_rng(4).poisson(right),
        noise="poisson",
        tied={"r_sigma": "l_sigma", "r_center": "l_center + d"},
        start={"d": distance},
    )
    assert fit.status == "ok"
    assert fit.values["d"] == pytest.approx(distance, abs=0.5)


# where there is one solution


def simple(seed: int) -> CurveFit:
    rng = np.random.default_rng(seed)
    curves = {
        "a*exp(-x/tau) + c": ({"a": 1.0, "tau": 2.0, "c": 0.0}, 3.0 * np.exp(-T / 4.0) + 1.0),
        "a + b*x + c*x**2": ({"a": 0.0, "b": 0.0, "c": 0.0}, 1.0 + 0.3 * T - 0.02 * T**2),
        "a*x/(k + x)": ({"a": 1.0, "k": 1.0}, 3.0 * T / (2.0 + T)),
        "a*exp(-(x - m)**2/2/s**2)": (
            {"a": 1.0, "m": 4.0, "s": 2.0},
            3.0 * np.exp(-((T - 5.0) ** 2) / 2.0),
        ),
        "a*exp(-b*x)*cos(w*x + p)": (
            {"a": 1.0, "b": 0.3, "w": 3.0, "p": 0.0},
            3.0 * np.exp(-0.1 * T) * np.cos(4.0 * T + 0.5),
        ),
    }
    curve = list(curves)[seed % len(curves)]
    start, truth = curves[curve]
    return fit_curve(curve, T, truth + 0.1 * rng.standard_normal(T.size), start=start, u_y=0.1)


@pytest.mark.statistics
def test_simple_curves_have_one_solution() -> None:
    assert [seed for seed in range(50) if simple(seed).status == "multimodal"] == []


@pytest.mark.slow
def test_a_parameter_on_its_way_to_infinity_is_no_solution() -> None:
    """Two peaks over an exponential: far out in its decay length the sum of squares hardly changes,
    so that the curvature there promises a share of the posterior without end.
    """
    x = np.linspace(0.0, 10.0, 40)
    rng = np.random.default_rng(1)
    y = 5.0 * np.exp(-x / 5.0) + 0.4 * rng.standard_normal(40)
    for height, center in ((2.0, 2.0), (3.0, 5.0)):
        y += height * np.exp(-((x - center) ** 2) / 2.0)
    curve = "A*exp(-(x-p)**2/(2*s**2)) + 1.5*A*exp(-(x-q)**2/(2*s**2)) + B*exp(-x/w)"
    start = {"A": 2.0, "s": 1.0, "p": 2.0, "q": 5.0, "w": 4.0, "B": 5.0}
    settings = {"start": start, "bounds": {"s": (0.0, None)}}
    near, found = (fit_curve(curve, x, y, scan=scan, **settings) for scan in (False, None))
    assert found.status == near.status == "ok"
    assert found.chi2 <= near.chi2 * (1.0 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("far", [661.7, 5e4])
def test_the_place_of_a_peak_far_from_zero_is_no_angle(far: float) -> None:
    """A narrow peak that lies outside the points is not seen, and does not change when it is moved
    by 360: once, center = -58 was given for 662, and called not identified.
    """
    x = far + np.linspace(-60.0, 70.0, 53)
    y = 38.0 * np.exp(-((x - far) ** 2) / (2.0 * 9.5**2)) + 8.0 - 0.02 * (x - far)
    for seed in range(4):
        noisy = y + 0.5 * np.random.default_rng(seed).standard_normal(x.size)
        for curve in ("gaussian + line", "A*exp(-(x - center)**2/(2*s**2)) + b*x + c"):
            found = fit_curve(curve, x, noisy)
            assert found.status == "ok", found.reasons
            assert abs(found.values["center"] - far) < 5.0 * found.sds["center"]


@pytest.mark.slow
@pytest.mark.parametrize("decimals", [6, 4])
def test_times_that_a_file_rounds_leave_aliases_what_they_are(decimals: int) -> None:
    """At 30 pictures a second, times of a few decimals tell aliases apart by what was rounded away:
    not by a reading.
    """
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0.0, 0.05, 60)
        times = np.arange(60) / 30.0
        y = 2.0 * np.exp(-0.3 * times) * np.sin(2.0 * np.pi * 1.3 * times + 0.4) + noise
        file = "".join(f"{t:.{decimals}f},{v:.5f}\n" for t, v in zip(times, y, strict=True))
        t, read = np.loadtxt(file.splitlines(), delimiter=",", unpack=True)
        fit = fit_curve("damped_oscillation", t, read, u_y=0.05)
        assert fit.status == "ok"
        assert abs(fit.values["frequency"] - 1.3) < 4.0 * fit.sds["frequency"]
        assert "curves that vary faster between the points pass through them too" in fit.message


@pytest.mark.parametrize("decimals", [15, 6])
def test_other_values_that_nearly_draw_the_same_curve_stay_solutions(decimals: int) -> None:
    """p near .34 and near 1.53, a tenth of the scatter apart at most, between the points too: no
    alias, and no reason to choose one.
    """
    x = np.round(np.arange(60) / 30.0, decimals)
    y = 0.5 - x + np.random.default_rng(2).normal(0.0, 0.05, 60)
    curve = "(p**3 - 3*p)*x + 1e-3*p*x**2 + c"
    fit = fit_curve(curve, x, y, u_y=0.05, start={"p": 0.3, "c": 0.4})
    assert fit.status == "multimodal"


def test_a_sigmoid_is_fit_beside_an_optimum_that_is_a_step() -> None:
    """Where the width is 0 the curve has no derivatives: that ended the fit, in 92 of 100 sets."""
    x = np.linspace(0.0, 9.0, 8)

    def sigmoid(x, height, middle, width):
        return height / (1.0 + np.exp(-(x - middle) / width))

    for seed in range(4):
        readings = sigmoid(x, 6.0, 4.0, 0.9) + 0.25 * np.random.default_rng(seed).standard_normal(
            x.size
        )
        fit = fit_curve("L/(1 + exp(-(x - m)/w))", x, readings)
        assert fit.status == "ok"
        best, cov = curve_fit(sigmoid, x, readings, p0=(6.0, 4.0, 0.9))
        for name, value, sd in zip(fit.names, best, np.sqrt(np.diag(cov)), strict=True):
            assert abs(fit.values[name] - value) < 1e-3 * sd


@pytest.mark.parametrize(
    "formula",
    ["A*exp(-w*x/(2*Q))*cos(w*x + p)", "A*exp(-z*w*x)*cos(w*x + p)", "A*exp(-g*x)*cos(w*x + p)"],
)
def test_a_damped_oscillation_is_one_solution_however_it_is_written(formula: str) -> None:
    """Curves of higher frequency pass through evenly spaced points; the weight of each by flat
    priors depends on whether its damping is a rate or a quality factor.
    """
    x = np.linspace(0.0, 8.0, 30)
    right = np.exp(-3.7 * x / 24.0) * np.cos(3.7 * x + 0.4)
    for seed in range(3):
        y = right + 0.033 * np.random.default_rng(seed).standard_normal(30)
        fit = fit_curve(formula, x, y, u_y=0.033)
        assert fit.status == "ok"
        assert fit.values["w"] == pytest.approx(3.7, abs=0.03)


def test_a_good_start_is_no_worse_than_none() -> None:
    x = np.linspace(0.0, 6.0, 20)
    right = np.cos(2.0 * np.pi * 0.593 * x + 0.4) + 0.2
    for seed in range(6):
        y = right + 0.4 * np.random.default_rng(seed).standard_normal(20)
        for start in (None, {"f": 0.593}):
            fit = fit_curve("A*cos(2*pi*f*x + p) + c", x, y, u_y=0.4, start=start)
            assert fit.status == "ok"
            assert fit.values["f"] == pytest.approx(0.593, abs=0.05)


def test_a_frequency_is_positive_whatever_sign_its_sine_has() -> None:
    x = np.linspace(0.0, 8.0, 30)
    y = np.cos(3.7 * x) - 0.6 * np.sin(3.7 * x) + 0.1 * np.random.default_rng(1).standard_normal(30)
    fit = fit_curve("a*cos(w*x) + b*sin(w*x)", x, y, u_y=0.1)
    assert fit.values["w"] == pytest.approx(3.7, abs=0.05)
    assert fit.values["b"] == pytest.approx(-0.6, abs=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_an_optimum_beyond_a_fold_is_found(seed: int) -> None:
    """At b = 0 the curve of b and that of a are the same: optima lie on both sides, and a grid of
    b, the others solved for, shows them.
    """
    x = np.linspace(1.0, 5.0, 25)
    y = 25.0 / (x - 0.2) - 3.0 / x**2 + np.random.default_rng(seed).normal(0.0, 0.1, x.size)

    def left(b: float) -> float:
        columns = np.column_stack([1.0 / (x - b), -1.0 / x**2])
        return float(np.sum((y - columns @ np.linalg.lstsq(columns, y)[0]) ** 2)) / 0.1**2

    grid = np.linspace(-0.9, 0.6, 3001)
    chi2 = np.array([left(b) for b in grid])
    minima = 1 + np.flatnonzero((chi2[1:-1] < chi2[:-2]) & (chi2[1:-1] < chi2[2:]))
    barrier = chi2[minima[0] : minima[-1]].max() - chi2.min()
    fit = fit_curve("R/(x-b)-a/x**2", x, y, u_y=0.1)
    assert minima.size == 2
    if barrier > 3.84:
        assert fit.status == "multimodal"
        assert sorted([fit.values["b"], *fit.fit.others[:, 1]]) == pytest.approx(
            grid[minima].tolist(), abs=1e-3
        )
    else:
        assert fit.status == "ok"
        within = grid[chi2 < left(fit.values["b"]) + 3.84]
        assert fit.intervals["b"][0.95] == pytest.approx((within[0], within[-1]), abs=2e-3)


@pytest.mark.parametrize("seed", [14, 22, 25])
@pytest.mark.parametrize("start", [None, {"b": -0.1}, {"b": 0.04}])
def test_an_optimum_beyond_a_fold_is_found_from_either_side(
    seed: int, start: dict[str, float] | None
) -> None:
    """Where the curve turns back faster than its second derivatives say."""
    x = np.linspace(0.3, 2.0, 14)
    y = 24.0 / (x - 0.04) - 3.6 / x**2 + 0.2 * np.random.default_rng(seed).standard_normal(14)
    fit = fit_curve("a/(x-b)-c/x**2", x, y, u_y=0.2, start=start)
    assert fit.status == "multimodal"
    low, high = sorted([fit.values["b"], *fit.fit.others[:, 1]])
    assert low < 0.0 < high


def test_a_start_of_the_wrong_sign_is_left() -> None:
    x = np.arange(12.0)
    y = 100.0 * np.exp(-x / 3.0) + 5.0 + (-1.0) ** x
    fit = fit_curve("a*exp(-x/tau) + c", x, y, u_y=1.0, start={"tau": -3.0})
    assert (fit.status, fit.values["tau"]) == ("ok", pytest.approx(3.0, abs=0.2))


@pytest.mark.parametrize("seed", [703, 711])
@pytest.mark.parametrize(("origin", "sign"), [(0.0, 1.0), (-5.0, 1.0), (-10.0, 1.0), (5.0, -1.0)])
def test_places_of_a_peak_are_looked_for_on_both_sides_of_0(
    seed: int, origin: float, sign: float
) -> None:
    """SYNTHETIC: two peaks, of which a curve with one can be either."""
    x = np.linspace(0.0, 10.0, 41)
    peaks = np.exp(-0.5 * ((x[:, None] - [3.0, 7.0]) / 0.3) ** 2).sum(axis=1)
    y = 1.0 + 0.5 * peaks + 0.2 * np.random.default_rng(seed).standard_normal(41)
    fit = fit_curve("h*exp(-(x-m)**2/(2*w**2))+c", origin + sign * x, y, u_y=0.2, fixed={"w": 0.3})
    assert fit.status == "multimodal"
    i = fit.names.index("m")
    places = sign * (np.array([fit.values["m"], *fit.fit.others[:, i]]) - origin)
    # the best two; lesser ones are dips of the noise
    assert sorted(places[:2].tolist()) == pytest.approx([3.0, 7.0], abs=0.2)


def _sampled_period(origin: float, amplitude: float, *, seed: int) -> tuple[str, float, float]:
    """Status of a sampled swing read off a clock that begins at -origin; how far the mean of its
    period is from that of the fit at origin 0, and how large its standard deviation is, in standard
    deviations of that.
    """
    x = np.arange(0.0, 6.0, 0.2)
    noise = np.random.default_rng(3).standard_normal(x.size)
    y = amplitude * np.cos(2 * np.pi * x / 1.5 + 0.4) + noise
    start = {"A": amplitude, "T": 1.5, "p": 0.0}
    near = fit_curve("A*cos(2*pi*x/T + p)", x, y, u_y=1.0, start=start)
    fit = fit_curve("A*cos(2*pi*x/T + p)", x + origin, y, u_y=1.0, start=start)
    sampled = sample_curve(fit, seed=seed, target=Target(ess=1000.0))
    draws = sampled.chain.flat[:, list(sampled.fit.names).index("T")]
    off = float(np.mean(draws) - near.values["T"]) / near.sds["T"]
    return sampled.diagnosis.status, off, float(np.std(draws)) / near.sds["T"]


@pytest.mark.parametrize(
    ("origin", "amplitude"),
    [(0.0, 5.0), (300.0, 5.0), (1000.0, 5.0), (10000.0, 5.0), (3000.0, 1.5)],
)
@pytest.mark.slow
def test_a_period_is_sampled_whole_wherever_x_begins(origin: float, amplitude: float) -> None:
    """Far from the origin a phase makes turns within a standard deviation of the period: one turn
    about the mode cut a stripe out of the ridge, and u(T) was 5 times too small, `ok`.
    """
    status, off, spread = _sampled_period(origin, amplitude, seed=1)
    assert status == "ok"
    assert off == pytest.approx(0.0, abs=0.15)
    assert spread == pytest.approx(1.0, rel=0.12)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.slow
def test_a_ridge_that_bends_by_many_turns_is_sampled_whole_or_not_at_all(seed: int) -> None:
    """p makes 160 turns within its standard deviation, and bends by five: some chains stay in a
    part of it, which part depends on the processor, and say so.
    """
    status, off, spread = _sampled_period(10000.0, 1.5, seed=seed)
    whole = off == pytest.approx(0.0, abs=0.15) and spread == pytest.approx(1.0, rel=0.12)
    assert whole or status == "not-converged"


@pytest.mark.slow
def test_two_phases_that_turn_together_are_sampled_whole() -> None:
    """Each was followed while the other stayed, and u(w) came out 9 times too small, `ok`."""
    x = np.arange(0.0, 6.0, 0.2)
    noise = 0.5 * np.random.default_rng(3).standard_normal(x.size)
    y = 3.0 * np.cos(4.0 * x + 0.4) * np.cos(1.2 * x - 0.3) + noise
    start = {"A": 3.0, "w": 4.0, "p": 0.4, "q": -0.3}
    near, fit = (
        fit_curve("A*cos(w*x + p)*cos(0.3*w*x + q)", x + origin, y, u_y=0.5, start=start)
        for origin in (0.0, 300.0)
    )
    sampled = sample_curve(fit, seed=1, target=Target(ess=1000.0))
    draws = sampled.chain.flat[:, list(sampled.fit.names).index("w")]
    assert sampled.diagnosis.status == "ok"
    assert np.mean(draws) == pytest.approx(near.values["w"], abs=0.15 * near.sds["w"])
    assert np.std(draws) == pytest.approx(near.sds["w"], rel=0.12)


@pytest.mark.parametrize("origin", [0.0, 1000.0, 10000.0])
def test_a_folded_density_has_each_curve_once(origin: float) -> None:
    """Summed over many turns of the phase it is the density of one."""
    x = np.arange(0.0, 6.0, 0.2)
    y = 1.5 * np.cos(2 * np.pi * x / 1.5 + 0.4) + np.random.default_rng(3).standard_normal(x.size)
    start = {"A": 1.5, "T": 1.5, "p": 0.0}
    fit = fit_curve("A*cos(2*pi*x/T + p)", x + origin, y, u_y=1.0, start=start).fit
    density = folded(fit.posterior, fit.symmetry, fit.values, fit.cov)
    i, period = fit.names.index("p"), 2.0 * np.pi
    turn = np.linspace(0.0, 1.0, 48, endpoint=False)
    for off in (-2.0, 0.0, 1.5):
        at = fit.values + off * fit.cov[fit.names.index("T")] / fit.sds[fit.names.index("T")]
        rows = np.tile(at, (48 * 121, 1))
        rows[:, i] += period * (np.arange(-60, 61)[:, None] + turn).ravel()
        one = np.logaddexp.reduce(fit.posterior.log_density(rows[:48]))
        maps = np.log(len(fit.symmetry.shift))
        assert np.logaddexp.reduce(density.log_density(rows)) == pytest.approx(one + maps, abs=1e-6)


@pytest.mark.parametrize("origin", [0.0, 300.0])
@pytest.mark.parametrize("limits", [(0.0, 2.0 * np.pi), (-3.14, 3.14)])
def test_limits_that_hold_a_full_turn_cut_nothing(
    origin: float, limits: tuple[float, float]
) -> None:
    """Far from the origin of x they left a stripe of the period, 2 to 9 times too narrow, `ok`."""
    x = np.arange(0.0, 6.0, 0.2)
    y = 5.0 * np.cos(2 * np.pi * x / 1.5 - 0.05) + np.random.default_rng(3).standard_normal(30)
    start = {"A": 5.0, "T": 1.5, "p": 1.0}
    free = fit_curve("A*cos(2*pi*x/T + p)", x, y, u_y=1.0, start=start)
    fit = fit_curve(
        "A*cos(2*pi*x/T + p)", x + origin, y, u_y=1.0, start=start, bounds={"p": limits}
    )
    assert fit.status == "ok"
    assert fit.intervals["T"][0.95] == pytest.approx(free.intervals["T"][0.95], rel=2e-3)
    assert "the limits of p hold a full turn" in fit.summary()


def test_limits_of_less_than_a_turn_or_of_no_phase_stay() -> None:
    x = np.arange(0.0, 6.0, 0.2)
    y = 5.0 * np.cos(2 * np.pi * x / 1.5 - 0.05) + np.random.default_rng(3).standard_normal(30)
    bounds = {"p": (0.0, 3.0), "A": (0.0, 20.0)}
    fit = fit_curve("A*cos(2*pi*x/T + p)", x, y, u_y=1.0, start={"T": 1.5}, bounds=bounds)
    assert fit.intervals["p"][0.95][0] >= 0.0
    assert "full turn" not in fit.summary()


def test_other_numbers_of_the_same_curves_are_told_by_what_differs() -> None:
    """Two swings of one period: the amplitude of one may change its sign alone, which leaves all
    but phases and amplitudes as they are, and the brackets were empty.
    """
    x, rng = np.linspace(0.0, 8.0, 41), np.random.default_rng(3)
    swing = "A*exp(-b*x)*cos(2*pi*x/T+p)"
    data = {
        name: DataSet(
            x,
            5.0 * np.exp(-0.1 * x) * np.cos(2.0 * np.pi * x / 1.5 + p)
            + 0.3 * rng.standard_normal(x.size),
            u_y=0.3,
        )
        for name, p in (("one", 0.4), ("two", 2.8))
    }
    start = {"A": 5.0, "p": 0.0, "T": 1.5, "b": 0.1}
    found = fit_curves(swing, data, shared=["T", "b"], start=start)
    text = " ".join([found.message, *found.notes])
    assert "the curve is the same" in text
    assert "()" not in text


def test_a_curve_without_a_value_at_a_reading_is_fit_with_errors_of_x() -> None:
    """x**n has none below 0, where an error of x may put a reading: nan is not equal to nan, and
    the optimum was not found among the curves through its own points (a ValueError).
    """
    rng = np.random.default_rng(2)
    true = np.geomspace(0.1, 30.0, 14)
    y = 2.0 * true**1.8 / (3.0**1.8 + true**1.8) + 0.05 * rng.standard_normal(14)
    x = true + 0.3 * rng.standard_normal(14)
    x[0] = -0.1
    start = {"V": 2.0, "n": 1.8, "K": 3.0}
    fit = fit_curve("V*x**n/(K**n + x**n)", x, y, start=start, u_y=0.05, u_x=0.3)
    assert fit.values["K"] == pytest.approx(3.0, abs=4.0 * fit.sds["K"])


def test_a_start_where_the_curve_is_not_finite_is_left() -> None:
    """sqrt(x - x0) has no value at any x below x0."""
    rng = np.random.default_rng(1)
    x = np.linspace(1.0, 5.0, 30)
    y = 2.0 * np.sqrt(x - 0.5) + 0.05 * rng.standard_normal(30)
    near = fit_curve("a*sqrt(x - x0)", x, y, u_y=0.05, start={"a": 1.0, "x0": 0.9})
    beyond = fit_curve("a*sqrt(x - x0)", x, y, u_y=0.05, start={"a": 1.0, "x0": 3.0})
    assert beyond.status == "ok"
    assert beyond.values == pytest.approx(near.values, rel=1e-6)
    assert "the starting values led to this optimum" in near.message
    assert "not the starting values" in beyond.message
    with pytest.raises(InputError, match="not finite"):
        fit_curve("a*sqrt(x - x0)", x, y, u_y=0.05, start={"a": 1.0, "x0": 3.0}, scan=False)
