"""Errors of y that are a share of the curve, u_y = "15%", beside a share of the readings, "15% of
y".  The likelihood itself is a case of the contract (`noises.py`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_runner import runner
from numpy.typing import NDArray
from scipy.optimize import minimize

from estim import Component, DataSet, InputError, fit_curve, fit_curves, fit_many, sample_curve
from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.problem.curve_noise import Readings
from estim.problem.noise_variance import Scale

Array = NDArray[np.float64]
# kafe2 2.11.0, examples/006_advanced_errors/03_relative_uncertainties.py
X = np.array([19.8, 3.0, 5.1, 16.1, 8.2, 11.7, 6.2, 10.1])
Y = np.array([23.2, 3.2, 4.5, 19.9, 7.1, 12.5, 4.5, 7.2])
LINE = {"a": 0.0, "b": 1.0}


def minus_log(values: Array, share: float, floor: float = 0.0) -> float:
    f = values[0] + values[1] * X
    variance = (share * f) ** 2 + floor**2
    return float(np.sum(0.5 * (Y - f) ** 2 / variance + 0.5 * np.log(variance)))


def highest(share: float) -> Array:
    options = {"xatol": 1e-10, "fatol": 1e-13, "maxiter": 4000}
    start = np.array([-0.2, 1.0])
    return minimize(minus_log, start, args=(share,), method="Nelder-Mead", options=options).x


@pytest.mark.parametrize("share", [0.02, 0.15, 0.4])
def test_the_fit_is_the_highest_likelihood_with_its_fisher_information(share: float) -> None:
    fit = fit_curve("a + b*x", X, Y, start=LINE, u_y=f"{100 * share:g}%")
    best = highest(share)
    assert list(fit.values.values()) == pytest.approx(best, rel=1e-6)
    f, slopes = best[0] + best[1] * X, np.column_stack([np.ones(X.size), X])
    # y is N(f, s^2 f^2): 1/V of its mean, and (dV/df)^2/(2 V^2) of its variance
    information = slopes.T @ ((1.0 / (share * f) ** 2 + 2.0 / f**2)[:, None] * slopes)
    assert fit.cov == pytest.approx(np.linalg.inv(information), rel=1e-5)
    assert fit.chi2 == pytest.approx(np.sum(((Y - f) / (share * f)) ** 2), rel=1e-6)


def test_intervals_end_where_the_likelihood_says_even_those_of_a_line() -> None:
    fit = fit_curve("a + b*x", X, Y, start=LINE, u_y="40%")
    lowest = minus_log(highest(0.4), 0.4)
    for i, name in enumerate(LINE):
        for probability, rise in ((0.68, 0.9889), (0.95, 3.8415)):
            for end in fit.intervals[name][probability]:
                best = minimize(
                    lambda other, i=i, end=end: minus_log(np.insert(other, i, end), 0.4),
                    list(fit.values.values())[1 - i],
                    method="Nelder-Mead",
                )
                assert 2.0 * (best.fun - lowest) == pytest.approx(rise, rel=2e-3)


def test_a_share_of_the_readings_is_another_fit_and_told_as_such() -> None:
    of_readings = fit_curve("a + b*x", X, Y, start=LINE, u_y="15% of y")
    by_hand = fit_curve("a + b*x", X, Y, start=LINE, u_y=0.15 * np.abs(Y))
    of_curve = fit_curve("a + b*x", X, Y, start=LINE, u_y=" 15 %")
    assert of_readings.values == by_hand.values
    # low readings pull: their errors are said to be small
    assert of_readings.values["b"] < of_curve.values["b"] - of_curve.sds["b"]
    assert "15 % of each reading" in str(of_readings)
    assert "15 % of the curve" in str(of_curve)
    assert "%" not in str(by_hand).splitlines()[-1]


def test_jitter_is_a_floor_beside_the_share() -> None:
    prior = "2(0.001)"
    fit = fit_curve("a + b*x", X, Y, start=LINE, u_y="15%", jitter=prior)
    options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000}
    found = minimize(minus_log, [0.0, 1.0], args=(0.15, 2.0), method="Nelder-Mead", options=options)
    assert [fit.values["a"], fit.values["b"]] == pytest.approx(found.x, rel=2e-3)
    assert found.x != pytest.approx(highest(0.15), rel=2e-3)


def test_the_draws_are_of_the_posterior_whose_errors_move_with_the_curve() -> None:
    fit = fit_curve("b*x", X, Y, start={"b": 1.0}, u_y="15%")
    draws = sample_curve(fit, seed=3).chain.draws[:, 0]
    b = np.linspace(0.5, 2.0, 4001)
    moved = np.array([minus_log(np.array([0.0, v]), 0.15) for v in b])
    held = 0.5 * np.sum((Y - b[:, None] * X) ** 2 / (0.15 * fit.values["b"] * X) ** 2, axis=1)
    centres = []
    for height in (moved, held):
        weight = np.exp(-height + height.min())
        centres.append(np.sum(weight * b) / np.sum(weight))
    sd = float(np.std(draws))
    # 2,000 draws at least that are worth being called independent
    assert np.mean(draws) == pytest.approx(centres[0], abs=4.0 * sd / np.sqrt(2000.0))
    assert np.mean(draws) != pytest.approx(centres[1], abs=4.0 * sd / np.sqrt(2000.0))


def test_a_new_reading_is_as_uncertain_as_the_curve_is_high() -> None:
    fit = fit_curve("b*x", X, Y, start={"b": 1.0}, u_y="15%")
    (bands,) = sample_curve(fit, seed=3).bands
    low, high = bands.predictive[0.68]
    width = 0.5 * (high - low) / bands.median
    assert width == pytest.approx(width[0], rel=0.02)
    assert width[0] == pytest.approx(np.hypot(0.15, fit.sds["b"] / fit.values["b"]), rel=0.1)


def test_a_new_reading_is_as_uncertain_as_the_readings_beside_it() -> None:
    x = np.linspace(0.0, 1.0, 21)
    u = 0.01 * np.exp(3.0 * x)
    fit = fit_curve("a + b*x", x, 1.0 + x + u * np.cos(40.0 * x), u_y=u)
    (bands,) = sample_curve(fit, seed=3).bands
    low, high = bands.predictive[0.68]
    curve = np.ptp(bands.credible[0.68], axis=0)
    expected = np.hypot(2.0 * 0.994 * np.interp(bands.x, x, u), curve)
    # not as uncertain as readings are on average, at either end
    assert high - low == pytest.approx(expected, rel=0.06)


def test_simulated_readings_scatter_about_the_curve_not_about_the_data(
    rng: np.random.Generator,
) -> None:
    noise = Readings(Scale(1.0), Scale(), np.full(4000, 7.0), share=0.1)
    read = noise.read(np.full(4000, 20.0), noise.reading_gain(), {}, rng)
    assert np.std(read) == pytest.approx(2.0, rel=4.0 / np.sqrt(2.0 * 4000))


@pytest.mark.slow
def test_a_share_goes_with_errors_of_x_common_errors_and_data_sets() -> None:
    beside_x = fit_curve("a + b*x", X, Y, start=LINE, u_y="15%", u_x=0.3)
    # kafe2: 1.0447 with errors of x as errors of y by the slope
    assert beside_x.values["b"] == pytest.approx(1.0447, abs=0.1 * beside_x.sds["b"])
    scale = [Component("scale_y", 0.05)]
    common = fit_curve("a + b*x", X, Y, start=LINE, u_y="15%", errors=scale)
    assert common.sds["b"] > fit_curve("a + b*x", X, Y, start=LINE, u_y="15%").sds["b"]
    sets = {"one": DataSet(X[:4], Y[:4], u_y="15%"), "two": DataSet(X[4:], Y[4:], u_y="15%")}
    joint = fit_curves("a + b*x", sets, start=LINE, shared=["a", "b"])
    assert list(joint.values.values()) == pytest.approx(highest(0.15), rel=1e-5)
    assert str(joint).count("of the curve") == 1


@pytest.mark.parametrize(
    ("u_y", "rule"),
    [
        ("15", "must be numbers, or a share"),
        ("15% of x", "must be numbers, or a share"),
        ("-3%", "must be numbers, or a share"),
        ("1e2%", "must be numbers, or a share"),
        ("0%", "between 0 and 100 %: 0%"),
        ("100 %", "between 0 and 100 %: 100 %"),
    ],
)
def test_nonsense_is_refused_in_one_line(u_y: str, rule: str) -> None:
    with pytest.raises(InputError, match=f"'u_y' .*{rule}"):
        fit_curve("a + b*x", X, Y, start=LINE, u_y=u_y)


def test_what_does_not_go_with_a_share_is_refused() -> None:
    for word in ("15%", "15% of y"):
        with pytest.raises(InputError, match="'y' must not be 0 where u_y is a share"):
            fit_curve("a + b*x", X, Y * (X > 4.0), start=LINE, u_y=word)
    for other in ({"deviation": 1.0}, {"correlated": True}, {"robust": "student-t"}):
        with pytest.raises(InputError, match="'u_y' as a share of the curve cannot be combined"):
            fit_curve("a + b*x", X, Y, start=LINE, u_y="15%", **other)
    with pytest.raises(InputError, match="'cov_y' cannot be combined with u_y"):
        fit_curve("a + b*x", X, Y, start=LINE, u_y="15%", cov_y=np.eye(8))
    with pytest.raises(InputError, match="'u_y'"):
        fit_many("a + b*x", X, np.vstack([Y, Y]), start=LINE, u_y="15%")


CAMPAIGN = """\
title = "a meter of 15 %"
kind = "measured"
[curve]
expression = "a + b*x"
x = "x"
y = "y"
u_y = "{u_y}"
[curve.parameters]
a = {{start = 0.0}}
b = {{start = 1.0}}
[[runs]]
name = "one"
file = "d.csv"
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    rows = "".join(f"{x},{y}\n" for x, y in zip(X, Y, strict=True))
    (tmp_path / "d.csv").write_text("x,y\n" + rows)
    return tmp_path


def test_a_campaign_says_it_in_the_same_words(table: Path) -> None:
    (table / "c.toml").write_text(CAMPAIGN.format(u_y="15%"))
    (run,) = load_campaign(table / "c.toml").problem(["one"]).runs
    assert run.noise.share == 0.15
    (table / "c.toml").write_text(CAMPAIGN.format(u_y="15% of y"))
    (run,) = load_campaign(table / "c.toml").problem(["one"]).runs
    assert run.noise.share == 0.0
    assert run.noise.reading_gain() == pytest.approx(0.15 * run.y)
    (table / "c.toml").write_text(CAMPAIGN.format(u_y="15% of x"))
    with pytest.raises(InputError, match=r"c\.toml:7: 'u_y' must be numbers, or a share"):
        load_campaign(table / "c.toml").problem(["one"])
    (table / "c.toml").write_text(CAMPAIGN.format(u_y="15%"))
    (table / "d.csv").write_text("x,y\n1,2\n2,0\n3,4\n4,5\n")
    with pytest.raises(InputError, match=r"d\.csv:3: 'y' must not be 0"):
        load_campaign(table / "c.toml").problem(["one"])


@pytest.mark.slow
def test_the_command_line_says_which_share_in_its_report(table: Path) -> None:
    for word, told in (("15%", "15 % of the curve"), ("15% of y", "15 % of each reading")):
        out = table / told
        arguments = ["fit", table / "d.csv", "--formula", "line", "--out", out, "--figures", "none"]
        done = runner().invoke(
            cli, [str(a) for a in (*arguments, "--u-y", word)], standalone_mode=False
        )
        assert done.exception is None, done.stderr
        assert told in " ".join((out / "report.md").read_text().split())
    for word in ("15%%", "150%", "2% of x"):
        with pytest.raises(InputError, match="'u_y' must be"):
            runner().invoke(
                cli,
                ["fit", str(table / "d.csv"), "--formula", "line", "--u-y", word],
                standalone_mode=False,
                catch_exceptions=False,
            )


def coverage(law: str, n_set: int) -> Array:
    """(2, 2) of a and b, by intervals of 68 % and 95 %, of readings with errors of 15 % of the
    curve.
    """
    rng, x, truth = np.random.default_rng(5), np.linspace(1.0, 20.0, 15), {"a": 3.0, "b": 1.2}
    inside = np.zeros((2, 2))
    for _ in range(n_set):
        y = (truth["a"] + truth["b"] * x) * (1.0 + 0.15 * rng.standard_normal(x.size))
        fit = fit_curve("a + b*x", x, y, start=truth, u_y=law, scan=False)
        for i, (name, true) in enumerate(truth.items()):
            ends = (fit.intervals[name][p] for p in (0.68, 0.95))
            inside[i] += [low <= true <= high for low, high in ends]
    return inside / n_set


@pytest.mark.statistics
def test_intervals_cover_what_they_say_where_errors_are_a_share_of_the_curve() -> None:
    """Errors of 15 % of each reading hold the slope in 54 and 85 %, which nine of ten such studies
    see.
    """
    probability, n_set = np.array([0.68, 0.95]), 150
    error = np.sqrt(probability * (1.0 - probability) / n_set)
    assert np.all(np.abs(coverage("15%", n_set) - probability) < 3.2 * error)


@pytest.mark.statistics
def test_a_share_of_the_readings_covers_the_slope_far_too_rarely() -> None:
    probability, n_set = np.array([0.68, 0.95]), 250
    error = np.sqrt(probability * (1.0 - probability) / n_set)
    assert np.any(coverage("15% of y", n_set)[1] < probability - 3.2 * error)
