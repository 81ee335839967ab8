"""Several data sets fit together from Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from estim import (
    Component,
    DataSet,
    Poisson,
    Target,
    fit_curve,
    fit_curves,
    load_campaign,
    sample_curve,
)
from estim.campaign import TableChoices, campaign_of_table
from estim.common import InputError, Kind
from estim.fitting import fit_problem
from estim.fitting.optimum import fit_optimum
from estim.pipeline import analyse_fit

T = np.linspace(0.0, 6.0, 30)
RNG = np.random.default_rng(3)
SWINGS = {
    "first": DataSet(T, 5.0 * np.exp(-T / 2.0) + 1.0 + 0.1 * RNG.standard_normal(30), u_y=0.1),
    "second": DataSet(
        T[:20], 3.0 * np.exp(-T[:20] / 2.0) + 1.0 + 0.05 * RNG.standard_normal(20), u_y=0.05
    ),
}
FORMULA, START = "A*exp(-x/tau) + c", {"A": 1.0, "tau": 1.0, "c": 0.0}


def test_a_joint_fit_is_least_squares_of_everything_at_once() -> None:
    fit = fit_curves(
        FORMULA,
        SWINGS,
        shared=["tau", "c"],
        start=START,
        derived={"rate": "1/tau", "ratio": "A/c"},
        units={"tau": "s"},
    )

    def residuals(p: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                (s.y - a * np.exp(-s.x / p[0]) - p[1]) / s.u_y
                for s, a in zip(SWINGS.values(), p[2:], strict=True)
            ]
        )

    best = least_squares(residuals, [1.5, 0.5, 4.0, 2.0], xtol=1e-14, ftol=1e-14)
    names = ("tau", "c", "A[first]", "A[second]")
    assert set(fit.names) == set(names)
    assert [fit.values[name] for name in names] == pytest.approx(best.x, rel=1e-6)
    assert [fit.sds[name] for name in names] == pytest.approx(
        np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac))), rel=1e-4
    )
    assert (fit.chi2, fit.dof) == (pytest.approx(2.0 * best.cost), 46)
    assert fit.status == "ok"
    assert fit.derived["rate"].value == pytest.approx(1.0 / fit.values["tau"])
    assert fit.derived["ratio[second]"].value == pytest.approx(
        fit.values["A[second]"] / fit.values["c"]
    )
    assert fit.predict(0.0, data="second").value[0] == pytest.approx(
        fit.values["A[second]"] + fit.values["c"]
    )
    assert fit.plot(data="second").axes[0].get_title() == f"second: {FORMULA}: ok"
    assert fit.contour("tau", "A[second]").n_failed == 0
    assert fit.fit.posterior.problem.n_obs == 50


def test_a_campaign_of_the_same_runs_says_the_same(tmp_path) -> None:
    text = (
        f'title = "t"\nkind = "synthetic"\n[curve]\nexpression = "{FORMULA}"\nx = "t"\ny = '
        '"y"\n[curve.parameters]\n'
    )
    text += "tau = {start = 1.0}\nc = {start = 0.0}\nA = {start = 1.0}\n"
    for name, points in SWINGS.items():
        np.savetxt(
            tmp_path / f"{name}.csv",
            np.column_stack([points.x, points.y]),
            delimiter=",",
            header="t,y",
            comments="",
            fmt="%.17g",
        )
        text += (
            f'[[runs]]\nname = "{name}"\nfile = "{name}.csv"\nu_y = '
            f"{points.u_y}\n[runs.parameters]\nA = {{start = 1.0}}\n"
        )
    (tmp_path / "c.toml").write_text(text)
    theirs = fit_optimum(
        load_campaign(tmp_path / "c.toml").problem(["first", "second"]),
        rng=np.random.default_rng(1),
    )
    ours = fit_curves(FORMULA, SWINGS, shared=["tau", "c"], start=START)
    assert ours.values == pytest.approx(
        dict(zip(theirs.names, theirs.values, strict=True)), rel=1e-8
    )
    assert ours.sds == pytest.approx(dict(zip(theirs.names, theirs.sds, strict=True)), rel=1e-6)


def test_with_nothing_shared_each_set_is_fit_as_if_alone() -> None:
    together = fit_curves("exponential + constant", SWINGS, shared=[])
    for name, points in SWINGS.items():
        alone = fit_curve("exponential + constant", points.x, points.y, u_y=points.u_y)
        assert {one: together.values[f"{one}[{name}]"] for one in alone.names} == pytest.approx(
            alone.values, rel=1e-5
        )
        assert {one: together.sds[f"{one}[{name}]"] for one in alone.names} == pytest.approx(
            alone.sds, rel=1e-3
        )


def test_a_wrong_curve_is_refused_with_the_name_of_its_set() -> None:
    bad = {
        **SWINGS,
        "second": DataSet(T, 3.0 * np.exp(-T / 2.0) + 1.0 + 0.3 * np.sin(3 * T), u_y=0.3),
    }
    fit = fit_curves(FORMULA, bad, shared=["tau", "c"], start=START)
    assert fit.status == "poor-fit"
    assert any("second" in reason for reason in fit.reasons)
    assert "±" not in str(fit)


@pytest.mark.parametrize("jitter", [False, True])
def test_data_sets_that_disagree_about_what_they_share_are_a_poor_fit(jitter: bool) -> None:
    """As in `estim fit --joint`: 40 points within their errors, slopes far apart."""
    x = np.linspace(0.0, 5.0, 20)
    slopes, data = {"a": 2.0, "b": 2.035}, {}
    rng = np.random.default_rng(1)
    for name, slope in slopes.items():
        data[name] = DataSet(x, slope * x + 0.1 * rng.standard_normal(20), u_y=0.1)
    apart = np.diff([float(x @ data[name].y / (x @ x)) for name in slopes])[0]
    p = chi2.sf(0.5 * apart**2 * (x @ x) / 0.1**2, 1)
    fit = fit_curves("m*x", data, jitter=jitter)
    assert fit.status == "poor-fit"
    assert "the runs disagree about the quantities they share" in fit.reasons[0]
    (found,) = fit.findings
    if not jitter:
        assert fit.p_value > 0.1
        assert found.p == pytest.approx(p, rel=1e-3)
    same = {"a": data["a"], "b": replace(data["b"], y=data["b"].y - 0.035 * x)}
    assert fit_curves("m*x", same, jitter=jitter).status == "ok"


def test_what_is_said_of_one_set_has_the_last_word() -> None:
    said = {
        "fixed": {"c[second]": 1.0},
        "priors": {"A[first]": "5.0(1)"},
        "bounds": {"tau": (0.1, 9.0)},
    }
    fit = fit_curves(FORMULA, SWINGS, shared=["tau"], start=START, **said)  # type: ignore[arg-type]
    assert set(fit.names) == {"tau", "A[first]", "c[first]", "A[second]"}
    assert fit.fixed == {"c[second]": 1.0}
    assert fit.dof == 50 + 1 - 4


def test_counts_and_readings_may_be_fit_together() -> None:
    counts = np.random.default_rng(4).poisson(50.0 * np.exp(-T / 2.0) + 10.0)
    fit = fit_curves(
        FORMULA,
        {"read": SWINGS["first"], "counted": DataSet(T, counts, noise=Poisson())},
        shared=["tau"],
        start={**START, "A": 5.0},
    )
    assert fit.status == "ok"
    assert (
        fit.sds["tau"] < fit_curve(FORMULA, T, SWINGS["first"].y, u_y=0.1, start=START).sds["tau"]
    )


def test_an_error_of_all_points_is_one_unknown_of_all_data_sets() -> None:
    """Against the whole covariance matrix: every y has 0.5 in common."""
    fit = fit_curves(
        FORMULA, SWINGS, shared=["tau"], start=START, errors=[Component("zero_y", 0.5, "offset")]
    )
    assert [name for name in fit.names if "offset" in name] == ["offset"]
    x, y = (np.concatenate([getattr(s, axis) for s in SWINGS.values()]) for axis in "xy")
    second = np.arange(y.size) >= T.size
    cov = np.diag(np.where(second, 0.05, 0.1) ** 2) + 0.25
    at = [fit.values[name] for name in ("tau", "A[first]", "c[first]", "A[second]", "c[second]")]
    e = np.exp(-x / at[0])
    amplitude = np.where(second, at[3], at[1])
    jacobian = np.column_stack(
        [amplitude * e * x / at[0] ** 2, ~second * e, ~second, second * e, second]
    )
    sds = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ np.linalg.solve(cov, jacobian))))
    assert [
        fit.sds[name] for name in ("tau", "A[first]", "c[first]", "A[second]", "c[second]")
    ] == pytest.approx(sds, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"shared": ["B"]}, "'shared' names 'B'"),
        ({"start": {**START, "A[third]": 1.0}}, "'start' names a data set that there is not"),
        ({"start": {**START, "A[second": 1.0}}, "'start' names a data set that there is not"),
        (
            {"priors": {"tau[second]": "9.0(1)"}},
            "'priors' refers to one data set, but 'tau' is shared by all",
        ),
        (
            {"bounds": {"tau[first]": (0.0, 1.0)}},
            "'bounds' refers to one data set, but 'tau' is shared by all",
        ),
        ({"data": {"a": DataSet(T, T)}}, "needs u_y, cov_y or noise"),
        ({"data": {"a[1]": DataSet(T, T, u_y=1.0)}}, r"without \[ and \]"),
        ({"data": {"a": (T, T)}}, "must be a DataSet"),
        (
            {"data": {"a": DataSet(T, T[:3], u_y=1.0)}},
            "'y' of data set 'a' must have as many values as x",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(change: dict[str, object], said: str) -> None:
    arguments = {"data": SWINGS, "shared": ["tau"], "start": START} | change
    with pytest.raises(InputError, match=said):
        fit_curves(FORMULA, **arguments)  # type: ignore[arg-type]


def test_which_data_set_must_be_said() -> None:
    with pytest.raises(InputError, match="must be one of first, second"):
        fit_curves(FORMULA, SWINGS, shared=["tau"], start=START).predict(1.0)


@pytest.mark.parametrize("command", [False, True])
def test_halves_of_a_peak_begin_where_the_whole_does(tmp_path: Path, command: bool) -> None:
    """From the left half alone no start leads to the peak that both make together."""
    x = np.linspace(0.0, 10.0, 15)
    for seed in range(3):
        y = 3.0 * np.exp(-((x - 5.0) ** 2) / 2.88)
        y += 0.4 * np.random.default_rng(seed).standard_normal(15)
        formula = "a*exp(-(x - m)**2/(2*s**2))"
        whole = fit_curve(formula, x, y, u_y=0.4)
        halves = {"left": slice(0, 7), "right": slice(7, 15)}
        if command:
            files = []
            for name, half in halves.items():
                files.append(tmp_path / f"{name}.csv")
                rows = zip(x[half].tolist(), y[half].tolist(), strict=True)
                files[-1].write_text("x,y\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
            choices = TableChoices(formula=formula, u_y="0.4")
            campaign = campaign_of_table(files[0], choices, *files[1:])
            problem = campaign.problem(campaign.run_names)
            chi2 = fit_problem(problem, rng=np.random.default_rng(1)).chi2
        else:
            sets = {name: DataSet(x[half], y[half], 0.4) for name, half in halves.items()}
            together = fit_curves(formula, sets)
            assert together.status == "ok"
            chi2 = together.chi2
        assert chi2 == pytest.approx(whole.chi2, rel=1e-6)


@pytest.mark.parametrize("curve", ["line", "a*x + b"])
def test_points_that_help_to_find_starts_are_counted_once(curve: str) -> None:
    rng = np.random.default_rng(1)
    x = np.linspace(0.0, 5.0, 6)
    data = {
        name: DataSet(x + place, 2.0 * (x + place) + 0.1 * rng.standard_normal(6), u_y=0.1)
        for name, place in (("a", 0.0), ("b", 0.5))
    }
    found = fit_curves(curve, data)
    assert (found.problem.n_obs, found.dof) == (12, 10)
    named = {"line": ("slope", "intercept")}.get(curve, ("a", "b"))
    priors = {named[0]: "2.0(5)", named[1]: "0.0(5)"}
    assert fit_curves(curve, data, priors=priors).problem.n_obs == 12


def test_sets_with_exact_values_of_their_own_begin_each_by_itself() -> None:
    x = np.linspace(0.0, 6.0, 20)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        data = {
            name: DataSet(x, 2.0 * np.sin(1.3 * k * x + 0.4) + 0.1 * rng.standard_normal(20), 0.1)
            for name, k in (("a", 1.0), ("b", 5.3))
        }
        fixed = {"k[a]": 1.0, "k[b]": 5.3}
        found = fit_curves("A*sin(w*k*x + p)", data, shared=["A", "w", "p"], fixed=fixed)
        assert found.status == "ok"


@pytest.mark.parametrize("jitter", [False, True])
def test_readings_that_stand_in_two_data_sets_are_said_to_count_twice(jitter: bool) -> None:
    x, rng = np.arange(10.0), np.random.default_rng(1)
    first, other = (2.0 * x + 0.1 * rng.standard_normal(10) for _ in range(2))
    sets = {
        "monday": DataSet(x, first, 0.1, jitter=jitter),
        "copy": DataSet(x[2:], first[2:], 0.1, jitter=jitter),
    }
    copied = fit_curves("a*x + b", sets, start={"a": 1.0, "b": 0.0})
    assert [f.names for f in copied.remarks if f.kind is Kind.READINGS_COPIED] == [
        ("monday", "copy")
    ]
    sets["copy"] = DataSet(x, other, 0.1, jitter=jitter)
    right = fit_curves("a*x + b", sets, start={"a": 1.0, "b": 0.0})
    assert Kind.READINGS_COPIED not in [f.kind for f in right.remarks]


@pytest.mark.slow
def test_a_spread_between_sets_is_identified_though_the_joint_mode_is_in_a_corner() -> None:
    """c + s z with z = 0(1) in each set: the highest density has s at its limit and all z near 0,
    which next to no probability has.  The marginal of s is that of normal means, on a grid.
    """
    rng, x, n = np.random.default_rng(2), np.linspace(0.0, 2.0, 6), 5
    means = 10.0 + rng.standard_normal(n)
    sets = {f"s{k}": DataSet(x, m + 0.3 * rng.standard_normal(6), 0.3) for k, m in enumerate(means)}
    fit = fit_curves(
        "c + s*z + 0*x",
        sets,
        shared=["c", "s"],
        start={"c": 10.0, "s": 1.0, "z": 0.0},
        bounds={"s": (0.0, 10.0)},
        priors={"z": "0(1)"},
    )
    analysis = sample_curve(fit, seed=1, target=Target(ess=1000.0))
    assert analysis.diagnosis.status == "ok", analysis.diagnosis.reasons
    y = np.array([points.y for points in sets.values()]).mean(axis=1)
    s = np.linspace(0.0, 10.0, 4001)
    variance = s**2 + 0.3**2 / 6.0
    log_density = -0.5 * (n - 1) * (np.log(variance) + y.var(ddof=1) / variance)
    shares = np.cumsum(np.exp(log_density - log_density.max()))
    draws = analysis.chain.column("s")
    for p in (0.16, 0.5, 0.84):
        exact = float(np.interp(p, shares / shares[-1], s))
        assert np.mean(draws < exact) == pytest.approx(p, abs=4.0 * 0.5 / np.sqrt(1000.0))
    # what is measured of a set is no limit: z enters with its sign, whatever that of s
    assert all(estimate.upper is None for estimate in analysis.estimates)


def test_a_sum_whose_terms_only_their_limits_hold_is_not_identified() -> None:
    x = np.linspace(1.0, 2.0, 12)
    y = 5.0 + 6.0 * x + 0.1 * np.random.default_rng(1).standard_normal(12)
    limits = {"a": (0.0, 4.0), "b": (0.0, 4.0)}
    fit = fit_curve("a + b + c*x", x, y, u_y=0.1, start={"a": 2.0, "b": 3.0}, bounds=limits)
    analysis = analyse_fit(fit.fit, seed=1, target=Target(ess=400.0))
    assert analysis.chain.convergence.met
    assert analysis.diagnosis.status == "not-identified"
