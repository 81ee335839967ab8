"""Readings with another error above than below."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize

from estim import Component, InputError, Target, fit_curve, sample_curve
from estim.campaign import load_campaign
from estim.fitting import fit_problem

CURVE = "a*exp(-x/tau) + c"
X = np.linspace(0.0, 4.0, 15)
MINUS = 0.05 + 0.025 * np.random.default_rng(1).random(15)
PLUS = 2.0 * MINUS


def decay(x: np.ndarray, a: float = 3.0, tau: float = 1.7, c: float = 0.5) -> np.ndarray:
    return a * np.exp(-x / tau) + c


def read(true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Readings that lie below the truth as often as PLUS is large: by half normal errors."""
    below = rng.random(true.size) < PLUS / (PLUS + MINUS)
    return true + np.where(below, -PLUS, MINUS) * np.abs(rng.standard_normal(true.size))


Y = read(decay(X), np.random.default_rng(2))


def minus_twice(values: np.ndarray, y: np.ndarray = Y) -> float:
    off = y - decay(X, *values)
    return float(np.sum((off / np.where(off < 0.0, PLUS, MINUS)) ** 2))


def least(*, held: tuple[int, float] | None = None) -> tuple[np.ndarray, float]:
    """The least of it by a search of SciPy, one parameter held at a value."""

    def whole(free: np.ndarray) -> np.ndarray:
        return free if held is None else np.insert(free, held[0], held[1])

    begin = np.array([3.0, 1.7, 0.5])
    begin = begin if held is None else np.delete(begin, held[0])
    tight = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 10_000, "maxfev": 10_000}
    found = minimize(
        lambda free: minus_twice(whole(free)), begin, method="Nelder-Mead", options=tight
    )
    return whole(found.x), float(found.fun)


def test_the_fit_is_the_maximum_of_the_likelihood() -> None:
    values, height = least()
    for u_y in ((MINUS, PLUS), np.array([MINUS, PLUS])):
        fit = fit_curve(CURVE, X, Y, u_y=u_y)
        assert list(fit.values.values()) == pytest.approx(values, rel=1e-5)
        assert fit.chi2 == pytest.approx(height, rel=1e-8)
    shuffled = np.random.default_rng(3).permutation(15)
    again = fit_curve(CURVE, X[shuffled], Y[shuffled], u_y=(MINUS[shuffled], PLUS[shuffled]))
    assert again.values == pytest.approx(fit.values, rel=1e-5)
    even = fit_curve(CURVE, X, Y, u_y=(MINUS, MINUS))
    assert even.values == pytest.approx(fit_curve(CURVE, X, Y, u_y=MINUS).values, rel=1e-5)


def test_intervals_are_profiles() -> None:
    """At either end the least sum with that parameter held is 1 (0.68: 0.989) above the least."""
    fit = fit_curve(CURVE, X, Y, u_y=(MINUS, PLUS))
    height = least()[1]
    for i, name in enumerate(fit.names):
        for end in fit.intervals[name][0.95]:
            assert least(held=(i, end))[1] - height == pytest.approx(3.8415, rel=0.02)


def test_one_reading_has_its_own_two_errors() -> None:
    """A constant through a single reading: the interval is what was published."""
    fit = fit_curve(
        "c + 0*x", [1.0, 2.0], [1.0, 1.0], u_y=np.sqrt(2.0) * np.array([[0.2], [0.3]]) * [1.0, 1.0]
    )
    low, high = fit.intervals["c"][0.68]
    one = stats.norm.ppf(0.84)
    assert (low, high) == pytest.approx((1.0 - 0.2 * one, 1.0 + 0.3 * one), rel=1e-3)


def test_a_figure_has_both_errors() -> None:
    figure = fit_curve(CURVE, X, Y, u_y=(MINUS, PLUS)).plot()
    (bars,) = figure.axes[0].containers[0][2]
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    assert ends[:, 0] == pytest.approx(Y - MINUS)
    assert ends[:, 1] == pytest.approx(Y + PLUS)


@pytest.mark.slow
def test_draws_follow_the_density_on_a_grid() -> None:
    """Of a line, whose prior is flat."""
    y = read(2.0 * X + 1.0, np.random.default_rng(4))
    fit = fit_curve("a*x + b", X, y, u_y=(MINUS, PLUS))
    analysis = sample_curve(fit, seed=1, target=Target(ess=4000))
    assert analysis.diagnosis.status == "ok"
    draws = analysis.chain.draws.reshape(-1, 2)
    a, b = (draws.mean(axis=0) + np.linspace(-6.0, 6.0, 401)[:, None] * draws.std(axis=0)).T
    off = y - a[:, None, None] * X - b[:, None]
    weights = np.exp(-0.5 * np.sum((off / np.where(off < 0.0, PLUS, MINUS)) ** 2, axis=2))
    for column, at, weight in ((0, a, weights.sum(axis=1)), (1, b, weights.sum(axis=0))):
        mean = np.average(at, weights=weight)
        sd = np.sqrt(np.average((at - mean) ** 2, weights=weight))
        assert abs(draws[:, column].mean() - mean) < 0.06 * sd
        assert draws[:, column].std() == pytest.approx(sd, rel=0.05)


@pytest.mark.statistics
def test_intervals_hold_the_truth_and_a_wrong_curve_fails() -> None:
    """150 data sets.  Their p-values are uniform; with errors taken the other way round 95 %
    intervals of the constant hold it in less than half, and a straight line through a decay fails.
    """
    rng = np.random.default_rng(5)
    truth = {"a": 2.0, "b": 1.0}
    held = {0.68: 0, 0.95: 0}
    wrong_side, p_values = 0, []
    for k in range(150):
        y = read(2.0 * X + 1.0, rng)
        fit = fit_curve("a*x + b", X, y, u_y=(MINUS, PLUS), rng=rng, n_start=1)
        p_values.append(fit.p_value)
        if k < 60:
            turned = fit_curve("a*x + b", X, y, u_y=(PLUS, MINUS), rng=rng, n_start=1)
            low, high = turned.intervals["b"][0.95]
            wrong_side += low <= truth["b"] <= high
        for p in held:
            held[p] += sum(
                fit.intervals[name][p][0] <= value <= fit.intervals[name][p][1]
                for name, value in truth.items()
            )
    assert abs(held[0.68] / 300 - 0.68) < 4.0 * np.sqrt(0.68 * 0.32 / 200)
    assert abs(held[0.95] / 300 - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 200)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    assert wrong_side < 30
    assert fit_curve("a*x + b", X, read(decay(X), rng), u_y=(MINUS, PLUS)).status == "poor-fit"


@pytest.mark.parametrize(
    ("u_y", "beside", "said"),
    [
        (np.ones((3, 15)), {}, r"'u_y' must be one row of errors, or two: .*\(3, 15\)"),
        ((MINUS, -PLUS), {}, r"'u_y\[plus\]' must be > 0 \(value number 1\): -"),
        (
            (MINUS[:9], PLUS[:9]),
            {},
            r"'u_y' must be a number or have as many values as x \(15\): 9",
        ),
        (
            (MINUS, PLUS),
            {"u_x": 0.1},
            "'u_y' with another error above than below does not go with u_x, cov_x, dev",
        ),
        (
            (MINUS, PLUS),
            {"jitter": True},
            "'u_y' with another error above than below does not go with u_x, cov_x, dev",
        ),
        (
            (MINUS, PLUS),
            {"robust": "student-t"},
            "'u_y' with another error above than below does not go with u_x, cov_x, dev",
        ),
        (
            (MINUS, PLUS),
            {"deviation": 0.1},
            "'u_y' with another error above than below does not go with u_x, cov_x, dev",
        ),
        (
            (MINUS, PLUS),
            {"correlated": True},
            "'u_y' with another error above than below does not go with u_x, cov_x, dev",
        ),
        ((MINUS, PLUS), {"cov_y": np.eye(15)}, "'cov_y' cannot be combined with u_y"),
        (
            (MINUS, PLUS),
            {"errors": [Component("zero_y", 0.1, groups=np.ones(15))]},
            "'u_y' with another error above than below does not go with u_x, cov_x, dev",
        ),
    ],
)
def test_bad_pairs_of_errors_are_refused(u_y: object, beside: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        fit_curve("a*x + b", X, Y, u_y=u_y, **beside)


CAMPAIGN = """title = "Two errors"
kind = "synthetic"
[curve]
expression = "a*exp(-x/tau) + c"
x = "x"
y = "y"
u_y = {minus = "down", plus = "up"}
[curve.parameters]
a = {}
tau = {}
c = {}
[[runs]]
name = "run"
file = "run.csv"
"""


def written(folder: Path, text: str, plus: np.ndarray = PLUS) -> Path:
    rows = np.column_stack([X, Y, MINUS, plus])
    np.savetxt(folder / "run.csv", rows, header="x,y,down,up", delimiter=",", comments="")
    (folder / "c.toml").write_text(text, encoding="utf-8")
    return folder / "c.toml"


def test_a_campaign_names_both_columns(tmp_path: Path) -> None:
    campaign = load_campaign(written(tmp_path, CAMPAIGN))
    assert "u_y = down, u_y[plus] = up" in campaign.columns(["run"])
    fit = fit_problem(campaign.problem(["run"]), rng=np.random.default_rng(1))
    assert fit.values == pytest.approx(least()[0], rel=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"down", plus = "up"', '"down"', r"c.toml:7: .*must be a 'column', or for y both 'minus'"),
        ("u_y = {", "u_y = 0.1\nu_x = {", r"c.toml:8: .*must be a 'column', or for y both 'minus'"),
        ('"up"', '"high"', "'high' is missing"),
        (
            '"up"}',
            '"up", prior = "half-normal", scale = 0.1}',
            r"c.toml:7: .*must be a 'column' or have a 'prior', not both",
        ),
    ],
)
def test_bad_pairs_of_a_campaign_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in CAMPAIGN
    with pytest.raises(InputError) as refused:
        load_campaign(written(tmp_path, CAMPAIGN.replace(old, new)))
    assert re.search(said, str(refused.value)), str(refused.value)


def test_an_error_of_a_row_names_its_own_column(tmp_path: Path) -> None:
    plus = np.where(np.arange(15) == 3, -0.1, PLUS)
    with pytest.raises(InputError, match=r"run.csv:5: 'up' must be > 0: -0.1"):
        load_campaign(written(tmp_path, CAMPAIGN, plus))


def test_the_p_value_is_that_of_its_chi2() -> None:
    fit = fit_curve(CURVE, X, Y, u_y=(MINUS, PLUS))
    assert fit.p_value == pytest.approx(stats.chi2.sf(fit.chi2, fit.dof))
