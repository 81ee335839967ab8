"""Errors that are inferred with a curve: a jitter beside stated ones, tails with room for outliers.
Against the maximum of a likelihood written out here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import optimize, stats

from estim import DataSet, InputError, Poisson, fit_curve, fit_curves, load_campaign, sample_curve
from estim.cli.commands import cli
from estim.fitting import contour, error_sizes, fit_problem, profile_intervals
from estim.problem import Uniform

X = np.linspace(0.0, 10.0, 40)
U = np.linspace(0.05, 0.15, 40)
TRUE = 2.0 * np.sin(1.3 * X) + 0.5


def disturbed(jitter: float, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return TRUE + rng.standard_normal(40) * np.hypot(U, jitter)


def test_a_jitter_is_that_of_the_highest_likelihood() -> None:
    y = disturbed(0.25)

    def minus(p: np.ndarray) -> float:
        a, w, c, jitter = p
        return -float(np.sum(stats.norm.logpdf(y, a * np.sin(w * X) + c, np.hypot(U, jitter))))

    best = optimize.minimize(
        minus, [2.0, 1.3, 0.5, 0.2], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}
    )
    fit = fit_curve("a*sin(w*x) + c", X, y, u_y=U, jitter=True)
    assert fit.status == "ok"
    assert list(fit.values) == ["a", "w", "c", "jitter"]
    assert list(fit.values.values()) == pytest.approx(best.x, rel=1e-4)

    def rise(jitter: float) -> float:
        held = optimize.minimize(
            lambda p: minus(np.append(p, jitter)), best.x[:3], method="Nelder-Mead"
        )
        return 2.0 * (held.fun - best.fun) - 40.0 * np.log1p(stats.t.ppf(0.975, 37) ** 2 / 37.0)

    ends = [optimize.brentq(rise, *ends) for ends in ((0.1, best.x[3]), (best.x[3], 0.6))]
    assert fit.intervals["jitter"][0.95] == pytest.approx(ends, rel=2e-3)
    assert fit_curve("a*sin(w*x) + c", X, y, u_y=U).status == "poor-fit"


@pytest.mark.parametrize("n", [6, 20])
def test_intervals_beside_a_large_jitter_are_those_of_student(n: int) -> None:
    """A jitter beside next to nothing is an error that the residuals tell: for a line, whose
    intervals are then exactly t s.
    """
    rng = np.random.default_rng(n)
    x = np.linspace(0.0, 1.0, n)
    y = 1.0 + 2.0 * x + 0.2 * rng.standard_normal(n)
    beside, alone = (
        fit_curve("a + b*x", x, y, **given) for given in ({"u_y": 1e-4, "jitter": True}, {})
    )
    for p in (0.68, 0.95):
        assert beside.intervals["b"][p] == pytest.approx(alone.intervals["b"][p], abs=1e-3)
        assert beside.profile_interval("b", probability=p) == pytest.approx(
            beside.intervals["b"][p], abs=1e-6
        )
    levels = contour(beside.held, "a", "b", sizes=error_sizes(beside.held)).levels
    assert levels[0.95] == pytest.approx(-2.0 * n / (n - 2.0) * np.log(0.05))


@pytest.mark.parametrize("n", [5, 8, 20])
def test_standard_deviations_and_band_beside_a_large_jitter_are_those_of_its_residuals(
    n: int,
) -> None:
    """The same line without stated errors, whose standard deviations have n - 2 for n."""
    x = np.linspace(0.0, 1.0, n)
    y = 2.0 * x + 1.0 + 0.1 * np.random.default_rng(n).standard_normal(n)
    alone, beside = fit_curve("a*x + b", x, y), fit_curve("a*x + b", x, y, u_y=1e-4, jitter=True)
    assert list(beside.sds.values())[:2] == pytest.approx(list(alone.sds.values()), rel=2e-3)
    assert np.sqrt(beside.cov[0, 0]) == pytest.approx(beside.sds["a"])
    bands = [fit.predict([0.5, 1.5]) for fit in (alone, beside)]
    assert bands[1].high - bands[1].low == pytest.approx(bands[0].high - bands[0].low, rel=2e-3)


def test_data_sets_that_share_nothing_have_the_intervals_that_they_have_alone(
    rng: np.random.Generator,
) -> None:
    """Beside a set of many points with stated errors too; what they share has the degrees of
    freedom of both.
    """
    x, many = np.linspace(-2.0, 2.0, 5), np.linspace(-2.0, 2.0, 100)
    few = {"x": x, "y": 1.0 + 2.0 * x + 0.3 * rng.standard_normal(5), "u_y": 0.01}
    sets = {
        "few": DataSet(**few, jitter=True),
        "many": DataSet(many, 2.0 * many + 0.1 * rng.standard_normal(100), u_y=0.1),
    }
    alone = fit_curve("a + b*x", **few, jitter=True)
    apart = fit_curves("a + b*x", sets, shared=[])
    for name in ("a", "b", "jitter"):
        assert apart.sds[f"{name}[few]"] == pytest.approx(alone.sds[name], rel=1e-6)
        for p, ends in apart.intervals[f"{name}[few]"].items():
            assert ends == pytest.approx(alone.intervals[name][p], rel=1e-5)
    wanted = stats.t.ppf(0.975, 3)
    low, high = apart.predict(0.0, data="few").low[0], apart.predict(0.0, data="few").high[0]
    assert high - low == pytest.approx(2.0 * wanted * apart.sds["a[few]"], rel=1e-3)
    low, high = apart.intervals["b[many]"][0.95]
    assert high - low == pytest.approx(2.0 * stats.norm.ppf(0.975) * apart.sds["b[many]"], rel=1e-3)
    # Welch and Satterthwaite: of two sets alike, twice the degrees of freedom of one, about
    both = fit_curves("a + b*x", dict.fromkeys("pq", sets["few"]), shared=["b"])
    low, high = both.intervals["b"][0.95]
    assert high - low == pytest.approx(2.0 * stats.t.ppf(0.975, 7) * both.sds["b"], rel=0.15)


def test_no_limit_or_prior_makes_a_standard_deviation_beside_a_jitter_other_than_it_is() -> None:
    x = np.linspace(0.0, 1.0, 15)
    y = 2.0 * x + 1.0 + 0.1 * np.random.default_rng(4).standard_normal(15)
    given = {"u_y": 0.01, "jitter": True}
    free, cut, held = (
        fit_curve("a*x + b", x, y, **given, **more)
        for more in ({}, {"bounds": {"b": (0.99, 1.01)}}, {"priors": {"b": "1.00(1)"}})
    )
    assert held.sds["b"] <= 0.01
    assert cut.sds["a"] > 0.9 * free.sds["a"] * np.sqrt(0.25)  # the slope beside a known b


@pytest.mark.slow
def test_a_few_readings_on_a_line_are_not_the_good_ones_of_a_mixture() -> None:
    """Of eight readings four may happen to lie on a line, and the others are no outliers; where
    they are, they are too many for a result.
    """
    x = np.linspace(0.0, 1.0, 8)
    for seed in (1, 3, 7):  # the density is highest on a line through four of them
        y = 2.0 * x + 1.0 + 0.1 * np.random.default_rng(seed).standard_normal(8)
        fit, plain = fit_curve("a*x + b", x, y, robust="mixture"), fit_curve("a*x + b", x, y)
        assert fit.status == "ok"
        assert fit.sds["a"] == pytest.approx(plain.sds["a"], rel=0.2)
    rng = np.random.default_rng(1)
    many = np.linspace(0.0, 1.0, 30)
    z = 2.0 * many + 1.0 + 0.05 * rng.standard_normal(30)
    z[rng.choice(30, 11, replace=False)] += rng.choice([-1.0, 1.0], 11) * rng.uniform(1.0, 4.0, 11)
    crowded = fit_curve("a*x + b", many, z, robust="mixture")
    assert crowded.values["outlier_fraction"] > 0.35
    assert crowded.status == "poor-fit"
    assert any("of the readings would be outliers" in reason for reason in crowded.reasons)
    with pytest.raises(InputError, match="at least 8 points for robust errors whose size"):
        fit_curve("a*x + b", x[1:], y[1:], robust="mixture")


@pytest.mark.slow
@pytest.mark.parametrize("n", [8, 20])
def test_one_reading_with_its_decimal_point_in_the_wrong_place(n: int, tmp_path: Path) -> None:
    """What a report advises there (robust: mixture) leads to the right slope by either door."""
    rng = np.random.default_rng(n)
    m = np.linspace(20.0, 160.0, n)
    length = np.round(11.9 + 0.066 * m + rng.normal(0.0, 0.1, n), 1)
    length[n // 2] *= 10.0
    assert fit_curve("a*x + b", m, length).status == "poor-fit"
    fit = fit_curve("a*x + b", m, length, robust="mixture")
    assert fit.status == "ok"
    assert fit.values["a"] == pytest.approx(0.066, abs=4.0 * fit.sds["a"])
    assert fit.sds["a"] < 0.003
    table = tmp_path / "spring.csv"
    rows = [f"{a:.6g},{b:.1f}" for a, b in zip(m, length, strict=True)]
    table.write_text("\n".join(["m,l", *rows]) + "\n")
    words = ["fit", str(table), "--formula", "a*m+b", "--robust", "mixture", "--figures", "none"]
    done = CliRunner().invoke(cli, [*words, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    (outlier,) = [line for line in done.output.splitlines() if "outlier:" in line]
    assert "1 likely outlier" in outlier


def test_a_jitter_that_is_not_there_has_a_limit_and_changes_nothing() -> None:
    y = disturbed(0.0, seed=3)
    fit, plain = (
        fit_curve("a*sin(w*x) + c", X, y, u_y=2.0 * U, jitter=jitter) for jitter in (True, False)
    )
    assert fit.intervals["jitter"][0.95][0] == 0.0
    assert "jitter <" in str(fit)
    for name in plain.names:
        assert fit.values[name] == pytest.approx(plain.values[name], abs=1e-3 * plain.sds[name])
        # Student's rise with 37 degrees of freedom, for a size that may be larger
        assert 1.0 < fit.sds[name] / plain.sds[name] < 1.04
    assert 1.0 < fit.predict(1.0).u / plain.predict(1.0).u < 1.04


UNEQUAL = np.linspace(0.05, 0.6, 12)


def line_with_unequal_errors(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng([7, seed])
    x = np.linspace(0.0, 5.0, 12)
    return x, 1.0 + 2.0 * x + np.hypot(UNEQUAL, 0.2) * rng.standard_normal(12)


@pytest.mark.parametrize("seed", [0, 2, 5, 106])
def test_intervals_leave_room_for_a_jitter_that_is_best_at_0(seed: int) -> None:
    """By brute force: the slope is solved for at each intercept and each jitter of a grid.  A
    likelihood is level in a jitter of 0, and steps that begin there once ended there.
    """
    x, y = line_with_unequal_errors(seed)
    found = fit_curve("a + b*x", x, y, u_y=UNEQUAL, jitter=True)
    assert found.values["jitter"] < 1e-3
    jitters, intercepts = np.linspace(0.0, 2.0, 1001), np.linspace(0.0, 2.0, 2001)
    rest = y - intercepts[:, None]
    heights = []
    prior = found.problem.parameters[2].prior
    for jitter in jitters:
        variance = UNEQUAL**2 + jitter**2
        slope = np.sum(rest * x / variance, axis=1) / np.sum(x**2 / variance)
        squares = np.sum((rest - slope[:, None] * x) ** 2 / variance, axis=1)
        of_prior = float(prior.log_density(np.array([jitter]))[0])
        heights.append(squares + np.sum(np.log(variance)) - 2.0 * of_prior)
    profile = np.min(heights, axis=0)
    inside = intercepts[profile - profile.min() < stats.chi2.ppf(0.95, 1)]
    (interval,) = profile_intervals(found.fit, names=["a"], probabilities=(0.95,))
    assert (interval.low[0.95], interval.high[0.95]) == pytest.approx(
        (inside[0], inside[-1]), abs=2e-3
    )


@pytest.mark.parametrize("seed", [28, 32, 117])
def test_a_jitter_with_two_optima_or_a_flat_one_is_fit(seed: int) -> None:
    x, y = line_with_unequal_errors(seed)
    found = fit_curve("a + b*x", x, y, u_y=UNEQUAL, jitter=True)
    assert found.status == "ok"
    grid = np.concatenate([[1e-9], np.linspace(0.001, 2.0, 4001)])
    heights = []
    for jitter in grid:
        weight = 1.0 / (UNEQUAL**2 + jitter**2)
        (b, a), *_ = np.polyfit(x, y, 1, w=np.sqrt(weight), full=True)
        at = np.array([[a, b, jitter]])
        heights.append(float(found.fit.posterior.log_density(at)[0]))
    at = np.array([[found.values[name] for name in found.names]])
    assert float(found.fit.posterior.log_density(at)[0]) > max(heights) - 1e-5
    assert found.values["jitter"] == pytest.approx(grid[int(np.argmax(heights))], abs=1e-3)


@pytest.mark.statistics
def test_intervals_beside_a_jitter_hold_where_stated_errors_differ() -> None:
    """Where the jitter came out as 0, value ± 2 sd of errors without one held 60 % once."""
    n, held, short, none = 150, 0, 0, 0
    for seed in range(n):
        x, y = line_with_unequal_errors(seed)
        found = fit_curve("a + b*x", x, y, u_y=UNEQUAL, jitter=True, scan=False)
        low, high = found.intervals["a"][0.95]
        held += low < 1.0 < high
        if found.values["jitter"] < 0.02:
            none += 1
            sd = float(fit_curve("a + b*x", x, y, u_y=UNEQUAL, scan=False).sds["a"])
            short += abs(found.values["a"] - 1.0) < 1.96 * sd
    # profiles of a likelihood are good to the order 1/n_obs: 12 points, 3 unknowns
    assert held / n > 0.95 - 0.04 - 3.0 * np.sqrt(0.95 * 0.05 / n)
    assert short / none < 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / none)


def test_a_prior_of_the_jitter_counts() -> None:
    y = disturbed(0.25)
    fit = fit_curve("a*sin(w*x) + c", X, y, u_y=U, jitter="0.10(1)")
    assert 0.10 < fit.values["jitter"] < 0.14


@pytest.mark.slow
def test_outliers_hardly_move_a_robust_fit() -> None:
    y = disturbed(0.0)
    spoiled = y.copy()
    spoiled[[3, 17, 30]] += 3.0
    clean = fit_curve("a*sin(w*x) + c", X, y, u_y=U)
    wrong = fit_curve("a*sin(w*x) + c", X, spoiled, u_y=U)
    fit = fit_curve("a*sin(w*x) + c", X, spoiled, u_y=U, robust="mixture")
    assert fit.status == "ok"
    assert fit.intervals["outlier_fraction"][0.95][0] > 0.01
    for name in clean.names:
        assert abs(fit.values[name] - clean.values[name]) < clean.sds[name]
    assert any(abs(wrong.values[n] - clean.values[n]) > 5.0 * clean.sds[n] for n in clean.names)
    unstated = fit_curve("a*sin(w*x) + c", X, spoiled, robust="student-t")
    assert unstated.status == "ok"
    for name in clean.names:
        assert abs(unstated.values[name] - clean.values[name]) < 2.0 * clean.sds[name]


def decay(x: np.ndarray, a: float, tau: float, c: float) -> np.ndarray:
    return a * np.exp(-x / tau) + c


@pytest.mark.slow
@pytest.mark.parametrize("far_off", [{4: 10.0}, {0: 1.36}, {3: 0.6, 9: 1.8}], ids=str)
@pytest.mark.parametrize("curve", ["a*exp(-x/tau) + c", decay], ids=["formula", "function"])
def test_a_bent_curve_is_found_in_spite_of_gross_blunders(
    curve: str | Callable[..., np.ndarray], far_off: dict[int, float]
) -> None:
    """As in the readings alone that are good."""
    x = np.linspace(0.0, 22.0, 12)
    y = decay(x, 60.0, 7.5, 23.0) + 0.5 * np.random.default_rng(2).standard_normal(x.size)
    good = np.array([i not in far_off for i in range(x.size)])
    given = {} if isinstance(curve, str) else {"start": {"a": 30.0, "tau": 3.0, "c": 10.0}}
    alone = fit_curve(curve, x[good], y[good], **given)  # type: ignore[arg-type]
    for i, factor in far_off.items():
        y[i] *= factor
    fit = fit_curve(curve, x, y, robust="mixture", **given)  # type: ignore[arg-type]
    assert fit.status == "ok"
    for name in alone.names:
        assert abs(fit.values[name] - alone.values[name]) < 0.5 * alone.sds[name]
        assert 0.7 < fit.sds[name] / alone.sds[name] < 1.5
    plain = fit_curve(curve, x, y, **given)  # type: ignore[arg-type]
    assert (
        plain.status != "ok"
        or abs(plain.values["tau"] - alone.values["tau"]) > 2.0 * (alone.sds["tau"])
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "errors", [{"u_y": 0.5, "u_x": 0.1}, {"u_y": 0.2, "jitter": True}], ids=["u_x", "jitter"]
)
def test_blunders_beside_errors_of_x_and_beside_a_jitter(errors: dict[str, float]) -> None:
    x = np.linspace(0.0, 22.0, 12)
    y = decay(x, 60.0, 7.5, 23.0) + 0.5 * np.random.default_rng(2).standard_normal(x.size)
    y[4] *= 10.0
    fit = fit_curve("a*exp(-x/tau) + c", x, y, robust="mixture", **errors)  # type: ignore[arg-type]
    assert fit.status == "ok"
    assert abs(fit.values["tau"] - 7.5) < 3.0 * fit.sds["tau"] < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("curve", ["a*x + b", "a*exp(-x/tau) + c"])
def test_a_blunder_of_any_size_is_borne_beside_stated_errors_that_are_too_large(curve: str) -> None:
    """The other residuals are then smaller than one, and the blunder larger beside them."""
    x = np.linspace(0.5, 10.0, 12)
    y = (2.0 * x + 1.0) if "x +" in curve else decay(x, 5.0, 2.0, 1.0)
    y += 0.05 * np.random.default_rng(1).standard_normal(12)
    y[5] = 100.0
    fit = fit_curve(curve, x, y, u_y=0.1, robust="mixture")
    assert fit.status == "ok"
    assert fit.intervals["outlier_fraction"][0.95][0] > 0.0
    assert fit_curve(curve, x, y, u_y=0.1).status != "ok"


@pytest.mark.slow
def test_a_refused_fit_names_the_reading_that_lies_far_from_all_others(tmp_path: Path) -> None:
    x = np.linspace(0.0, 10.0, 12)
    y = decay(x, 5.0, 2.0, 1.0) + 0.05 * np.random.default_rng(1).standard_normal(12)
    clean, y[5] = 5.0 + 0.1 * y, 100.0  # a constant
    table = tmp_path / "spike.csv"
    words = ["fit", str(table), "--formula", "a*exp(-x/tau) + c", "--figures", "none"]
    for readings, named in ((y, True), (clean, False)):
        table.write_text(
            "x,y\n" + "".join(f"{a:.4g},{b:.4g}\n" for a, b in zip(x, readings, strict=True))
        )
        error = str(CliRunner().invoke(cli, [*words, "--out", str(tmp_path / "out")]).exception)
        said = "100 at x = 4.545 lies far from all other readings" in error
        assert said == named == ("(robust: mixture)" in error)


@pytest.mark.slow
def test_a_blunder_does_not_lead_to_an_alias() -> None:
    """Evenly spaced points cannot tell a frequency from that plus the rate of sampling."""
    x = np.linspace(0.0, 12.0, 12)
    for seed in (0, 3, 4):
        rng = np.random.default_rng([12, seed])
        y = 2.0 * np.sin(1.3 * x + 0.4) + 1.0 + 0.1 * rng.standard_normal(12)
        y[rng.integers(1, 11)] *= 10.0
        fit = fit_curve("a*sin(w*x + p) + c", x, y, robust="mixture")
        assert fit.status == "ok"
        assert abs(fit.values["w"] - 1.3) < 4.0 * fit.sds["w"] < 0.1


@pytest.mark.slow
def test_a_peak_is_no_single_blunder() -> None:
    """A Gaussian can meet any one reading: the one that is mistyped, or those of a narrow peak."""
    x = np.linspace(0.0, 8.0, 33)
    noise = 0.3 * np.random.default_rng(3).standard_normal(x.size)
    for width in (1.0, 0.2):
        y = 10.0 * np.exp(-0.5 * ((x - 4.0) / width) ** 2) + 2.0 + noise
        y[24] *= 10.0
        fit = fit_curve("a*exp(-(x-m)**2/(2*s**2)) + b", x, y, robust="mixture")
        assert fit.status == "ok"
        assert abs(fit.values["m"] - 4.0) < 4.0 * fit.sds["m"] < 0.5
        assert abs(abs(fit.values["s"]) - width) < 4.0 * fit.sds["s"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"jitter": True}, "'jitter' needs u_y"),
        ({"jitter": "0.2", "u_y": 0.1}, "'jitter' must have an uncertainty"),
        ({"jitter": 0.2, "u_y": 0.1}, "'jitter' must be a prior"),
        ({"robust": "huber", "u_y": 0.1}, "'robust' must be"),
        ({"jitter": True, "u_y": 0.1, "deviation": 0.1}, "'deviation' cannot be combined"),
        ({"robust": "mixture", "u_y": 0.1, "correlated": True}, "'correlated' cannot be combined"),
        ({"robust": "mixture", "noise": Poisson()}, "'robust' cannot be combined"),
        ({"jitter": True, "u_y": 0.1, "start": {"a": 1.0, "jitter": 1.0}}, "choose another"),
    ],
)
def test_what_does_not_go_together_is_refused(given, words: str) -> None:
    curve = "a*x + jitter" if "start" in given else "a*x"
    y = np.arange(40.0) if "noise" in given else TRUE
    with pytest.raises(InputError, match=words):
        fit_curve(curve, X, y, **given)


def test_a_campaign_infers_a_jitter_as_python_does(tmp_path: Path) -> None:
    y = disturbed(0.25)
    rows = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in zip(X, y, U, strict=True))
    (tmp_path / "d.csv").write_text("x,y,u\n" + rows.replace("np.float64(", "").replace(")", ""))
    (tmp_path / "c.toml").write_text(
        'title = "t"\nkind = "synthetic"\n[curve]\n'
        'x = "x"\ny = "y"\nu_y = {column = "u"}\nexpression = "a*sin(w*x) + c"\njitter = true\n'
        "parameters = {a = {start = 2}, w = {start = 1.3}, c = {start = 0.5}}\n"
        '[[runs]]\nname = "d"\nfile = "d.csv"\n'
    )
    problem = load_campaign(tmp_path / "c.toml").problem(["d"])
    found = fit_problem(problem, rng=np.random.default_rng(1))
    fit = fit_curve("a*sin(w*x) + c", X, y, u_y=U, jitter=True)
    assert found.names == ("a", "w", "c", "jitter[d]")
    assert found.values == pytest.approx(list(fit.values.values()), rel=1e-6)


@pytest.mark.statistics
def test_what_few_readings_in_several_sets_share_is_held_as_often_as_it_says() -> None:
    """Three sets of five points, each with an unknown size of its errors.  What the curvature at
    the mode says, as if these sizes were known, holds it too rarely.
    """
    rng, x, n = np.random.default_rng(3), np.linspace(-2.0, 2.0, 5), 60
    inside = {0.68: 0, 0.95: 0}
    by_curvature, n_ok = 0, 0
    for _ in range(n):
        sets = {}
        for name in "pqr":
            errors = rng.uniform(0.1, 0.5) * rng.standard_normal(5)
            sets[name] = DataSet(x, rng.standard_normal() + 2.0 * x + errors, 0.01, jitter=True)
        fit = fit_curves("a + b*x", sets, shared=["b"])
        if fit.status != "ok":
            continue
        n_ok += 1
        for p, (low, high) in ((p, fit.intervals["b"][p]) for p in inside):
            inside[p] += low < 2.0 < high
        curvature = float(fit.fit.sds[list(fit.fit.names).index("b")])
        by_curvature += abs(fit.values["b"] - 2.0) < 1.959964 * curvature
    assert n_ok > 0.9 * n
    for p, count in inside.items():
        assert abs(count / n_ok - p) < 3.0 * np.sqrt(p * (1.0 - p) / n_ok)
    assert by_curvature / n_ok < 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / n_ok)


def test_a_size_of_errors_from_few_readings_is_told_alike_whether_some_of_it_is_stated() -> None:
    """Value ± s would hold the truth in 63 % of experiments."""
    x = np.linspace(0.0, 5.0, 6)
    y = 1.0 + 2.0 * x + 0.3 * np.random.default_rng(1).standard_normal(6)
    beside, alone = fit_curve("a + b*x", x, y, u_y=0.1, jitter=True), fit_curve("a + b*x", x, y)
    (line,) = [line for line in str(alone).splitlines() if line.startswith("b")]
    assert "standard error" in line
    assert line.split() in [words.split() for words in str(beside).splitlines()]


def test_draws_beside_a_factor_known_by_its_size_do_not_fall_to_no_jitter() -> None:
    """Their coordinates are logarithms and values: where a size went by its square, every place
    below 0 was a size of 0.
    """
    t = np.linspace(300.0, 340.0, 14)
    k = 1e6 * np.exp(-5000.0 / t)
    y = k * (1.0 + 0.15 * np.random.default_rng(4).standard_normal(14))
    given = {"u_y": 0.2 * k, "jitter": True, "start": {"A": 1e6, "E": 5000.0}}
    fit = fit_curve("A*exp(-E/x)", t, y, **given)
    assert fit.fit.coordinates.by_size.any()
    drawn = sample_curve(fit, seed=1)
    assert drawn.diagnosis.status == "ok"
    jitter = drawn.chain.flat[:, list(fit.names).index("jitter")]
    assert (
        0.0
        < np.quantile(jitter, 0.025)
        < np.quantile(jitter, 0.5)
        < fit.intervals["jitter"][0.95][1]
    )


@pytest.mark.parametrize("high", [1.0, 2.0])
def test_the_upper_end_of_a_jitter_does_not_depend_on_a_limit_far_above_it(high: float) -> None:
    rng, x = np.random.default_rng(3), np.linspace(0.0, 5.0, 15)
    y = 1.0 + 2.0 * x + 0.3 * rng.standard_normal(15)
    found = fit_curve("a + b*x", x, y, u_y=0.5, jitter=Uniform(0.0, high))
    assert found.intervals["jitter"][0.95] == pytest.approx((0.0, 0.46518), abs=1e-4)
