"""Quantities that follow from parameters by a user's formula: from `fit_curve`, and from the draws
of a campaign.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from estim import fit_curve
from estim.campaign import Campaign, load_campaign
from estim.common import InputError
from estim.curves import seek
from estim.pipeline import Analysis, analyse
from estim.reports.analysis import analysis_report
from estim.reports.corner_figures import columns_of
from estim.reports.derived import derived_facts
from estim.reports.result import first_screen, result_of
from estim.sampling import Target

CURVE = """title = "Two pendulums"
kind = "synthetic"
[curve]
expression = "slope*x + c"
x = {column = "l_m", name = "length", unit = "m"}
y = {column = "t2_s2", name = "squared period", unit = "s²"}
u_y = 0.02
errors = {ruler = {kind = "scale_x", u = 0.01}}
[curve.parameters]
slope = {start = 1.0, unit = "s²/m"}
c = {prior = "normal", mean = 0.0, sd = 0.02, unit = "s²"}
[derived]
g = {formula = "4*pi**2/slope", unit = "m/s²", meaning = "acceleration of free fall"}
second = "2*pi/sqrt(g)"
ratio = "slope[short]/slope[long]"
impossible = "log(c)"
[[runs]]
name = "short"
file = "short.csv"
[[runs]]
name = "long"
file = "long.csv"
"""
PLAIN = CURVE.replace(
    '[[runs]]\nname = "long"', '[[runs]]\nname = "long"\nparameters = {slope = {start = 1.0}}'
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place, rng = tmp_path_factory.mktemp("pendulums"), np.random.default_rng(3)
    for name, low, high in (("short", 0.2, 0.6), ("long", 0.6, 1.4)):
        length = np.linspace(low, high, 9)
        squared = 4.0 * np.pi**2 / 9.81 * length + 0.02 * rng.standard_normal(9)
        rows = "\n".join(f"{a:.4f},{b:.6f}" for a, b in zip(length, squared, strict=True))
        (place / f"{name}.csv").write_text(f"l_m,t2_s2\n{rows}\n")
    return place


def load(folder: Path, text: str) -> Campaign:
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder / "campaign.toml")


@pytest.fixture(scope="module")
def joint(folder: Path) -> tuple[Campaign, Analysis]:
    campaign = load(folder, PLAIN)
    return campaign, analyse(campaign, ["short", "long"], seed=1, target=Target(ess=1500))


def line(slope: float, u: float, **more: object) -> object:
    x = np.linspace(0.0, 1.0, 9)
    return fit_curve("slope*x + c", x, slope * x, u_y=u, start={"slope": 1.0, "c": 0.0}, **more)  # type: ignore[arg-type]


def test_the_uncertainty_of_g_is_that_of_the_slope_to_first_order() -> None:
    fit = line(4.0, 0.002, derived={"g": "4*pi**2/slope"}, units={"g": "m/s²"})
    assert fit.derived["g"].value == pytest.approx(4.0 * math.pi**2 / 4.0)
    assert fit.derived["g"].sd == pytest.approx(
        4.0 * math.pi**2 / 16.0 * fit.sds["slope"], rel=1e-4
    )
    assert "g     = 9.87" in str(fit)
    assert "m/s²" in str(fit)
    assert "(derived, linear)" in str(fit)


def test_correlation_of_the_parameters_counts() -> None:
    fit = line(4.0, 0.1, derived={"end": "slope + c", "start": "c"})
    expected = math.sqrt(fit.cov.sum())
    assert fit.derived["end"].sd == pytest.approx(expected)
    assert expected < 0.9 * math.hypot(fit.sds["slope"], fit.sds["c"])


def test_the_interval_of_a_bent_quantity_is_that_of_its_parameter() -> None:
    fit = line(1.0, 0.5, derived={"grown": "exp(slope)", "square": "grown**2"})
    grown = fit.derived["grown"]
    assert math.isnan(grown.sd)  # ± would mislead
    for p in (0.68, 0.95):
        assert grown.interval[p] == pytest.approx(
            tuple(np.exp(fit.intervals["slope"][p])), rel=1e-6
        )
        assert fit.derived["square"].interval[p] == pytest.approx(
            tuple(np.exp(2.0 * np.array(fit.intervals["slope"][p]))), rel=1e-6
        )


def test_a_pole_within_reach_leaves_no_interval() -> None:
    fit = line(1.0, 2.0, derived={"q": "1/slope"})
    assert math.isnan(fit.derived["q"].interval[0.95][0])
    assert "q     = 1 (no uncertainty)" in str(fit)


def test_what_has_no_value_beside_the_fit_has_no_interval() -> None:
    fit = line(1.0, 2.0, derived={"q": "sqrt(slope - 0.99999)"})
    assert fit.derived["q"].value > 0.0
    assert math.isnan(fit.derived["q"].interval[0.95][0])
    assert "q     = " in str(fit)


def test_what_depends_on_a_parameter_at_its_limit_has_no_plus_minus() -> None:
    x = np.linspace(0.0, 1.0, 20)
    y = 2.0 * x - 0.01 + 0.05 * np.random.default_rng(1).standard_normal(20)
    fit = fit_curve(
        "a*x + b",
        x,
        y,
        u_y=0.05,
        start={"a": 1.0, "b": 1.0},
        bounds={"b": (0.0, None)},
        derived={"twice": "2*b", "half": "a/2"},
    )
    assert math.isnan(fit.sds["b"])
    assert math.isnan(fit.derived["twice"].sd)
    assert fit.derived["twice"].interval[0.95] == pytest.approx(
        (0.0, 2.0 * fit.intervals["b"][0.95][1])
    )


@pytest.mark.parametrize("formula", ["a*(1 - exp(-k*x))", "a*(1 - 2**(-k*x))"])
def test_what_depends_on_one_parameter_has_the_interval_of_its_profile(formula: str) -> None:
    """That of 1/k was linear in k, and twice as wide on one side as that of tau."""
    x = np.linspace(0.3, 4.0, 12)
    y = 3.0 * (1.0 - np.exp(-x / 2.5)) + 0.2 * np.random.default_rng(2).standard_normal(12)
    unit = "1/k" if "exp" in formula else "1/(k*log(2))"
    fit = fit_curve(formula, x, y, u_y=0.2, derived={"tau": unit})
    direct = fit_curve("a*(1 - exp(-x/tau))", x, y, u_y=0.2)
    for p in (0.68, 0.95):
        assert fit.derived["tau"].interval[p] == pytest.approx(direct.intervals["tau"][p], rel=1e-3)


def test_a_fit_that_is_not_ok_shows_no_plus_minus() -> None:
    x = np.linspace(0.0, 1.0, 30)
    fit = fit_curve("a*x", x, 3.0 * x**2, u_y=0.01, start={"a": 1.0}, derived={"twice": "2*a"})
    assert fit.status == "poor-fit"
    assert "±" not in str(fit)
    assert "twice" in str(fit)


@pytest.mark.parametrize(
    ("derived", "said"),
    [
        (
            {"g": "4*pi**2/slop"},
            "names 'slop', which is neither a parameter nor a derived quantity before it",
        ),
        ({"g": "slope*x"}, "must not hold x"),
        ({"c": "slope"}, "is the name of something else"),
        ({"pi": "slope"}, "named like the variable, a constant or a function"),
        ({"a": "b", "b": "slope"}, "names 'b'"),
        ({"a": "slope[run]"}, "there are no runs"),
        ({"a": 3}, "must be a formula"),
    ],
)
def test_a_formula_that_makes_no_sense_is_refused(derived: dict[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        line(1.0, 0.1, derived=derived)


def test_draws_are_computed_as_by_hand(joint: tuple[Campaign, Analysis]) -> None:
    campaign, analysis = joint
    result = result_of(campaign, analysis)
    draws = dict(zip(analysis.problem.names, analysis.chain.thinned(20_000).T, strict=True))
    for run, name in (("short", "slope[short]"), ("long", "slope[long]")):
        by_hand = 4.0 * np.pi**2 / draws[name]
        g, second = result.runs[run].derived["g"], result.runs[run].derived["second"]
        assert g.mean == pytest.approx(by_hand.mean())
        assert g.sd == pytest.approx(by_hand.std(ddof=1))
        assert g.unit == "m/s²"
        assert second.median == pytest.approx(np.median(2.0 * np.pi / np.sqrt(by_hand)))
    ratio = draws["slope[short]"] / draws["slope[long]"]
    assert result.runs["short"].derived["ratio"].q975 == pytest.approx(np.quantile(ratio, 0.975))


def test_the_report_has_them_once_where_runs_agree_and_by_run_where_not(
    joint: tuple[Campaign, Analysis],
) -> None:
    campaign, analysis = joint
    report = analysis_report(campaign, analysis, figures="none")["report.md"].decode()
    assert "| ratio | slope[short]/slope[long] (derived) |" in report
    assert "| g[short] | acceleration of free fall (derived) |" in report
    assert "| impossible | log(c) (derived) | | n/a | n/a |" in report
    assert "has no value at" in report
    (told,) = [
        line
        for line in first_screen(result_of(campaign, analysis)).lines
        if "no value for some of the draws" in line
    ]
    assert told.startswith("there is no value for some of the draws (a division by zero, a root or")
    assert "impossible" in told
    first = report.partition("<details>")[0]
    # what was asked for stands first
    assert all(f"| {symbol}, " in first for symbol in ("ratio", "g[short]", "g[long]"))
    assert [column.label.symbol for column in columns_of(analysis)][-3:] == [
        "g[short]",
        "g[long]",
        "second[short]",
    ]


def test_what_needs_another_run_is_left_out_and_says_so(folder: Path) -> None:
    campaign = load(folder, PLAIN)
    problem = campaign.problem(["short"])
    (run,) = problem.runs
    assert "ratio" not in run.derived(run.bind(problem.named(problem.start())))
    lacking = [one.lacking for one in run.sought if one.name == "ratio"]
    assert lacking == [("slope[long]",)]


def test_facts_name_what_is_missing(joint: tuple[Campaign, Analysis]) -> None:
    _, analysis = joint
    facts = derived_facts(analysis, analysis.problem.runs[0])
    assert len(facts) == 1
    assert facts[0].startswith("impossible = log(c) has no value at")


@pytest.mark.parametrize(
    ("old", "new", "place", "said"),
    [
        ('second = "2*pi/sqrt(g)"', 'second = "2*pi/sqrt(h)"', 14, "names 'h'"),
        (
            'ratio = "slope[short]/slope[long]"',
            'ratio = "slope[short]/slope[wide]"',
            15,
            "there is no run or body 'wide'",
        ),
        ('ratio = "slope[short]/slope[long]"', 'ratio = "g[short]"', 15, "no run has 'g'"),
        ('second = "2*pi/sqrt(g)"', "second = 3", 14, "must be text"),
        (
            'second = "2*pi/sqrt(g)"',
            'second = {formula = "g", unti = "s"}',
            14,
            "did you mean 'unit'",
        ),
        ('second = "2*pi/sqrt(g)"', 'slope = "g"', 14, "is the name of something else"),
    ],
)
def test_a_mistake_in_the_table_is_told_with_its_line(
    folder: Path, old: str, new: str, place: int, said: str
) -> None:
    with pytest.raises(InputError, match=said) as refused:
        load(folder, PLAIN.replace(old, new))
    assert refused.value.line == place


def test_a_name_with_a_level_stands_for_one_quantity_wherever_it_is_stated() -> None:
    one = seek("d", "gamma[heavy] - gamma[light no. 2] + gamma_0*gamma[heavy]")
    assert sorted(one.of_levels.values()) == [("gamma", "heavy"), ("gamma", "light no. 2")]
    assert one.own == ("gamma_0",)
    found = one.of({"gamma[heavy]": 0.3, "gamma[light no. 2]": 0.1, "gamma_0": 2.0})
    assert found is not None
    assert found.values == pytest.approx(np.array([[0.8]]))
    assert one.of({"gamma[heavy]": 0.3, "gamma_0": 2.0}) is None


def test_the_body_of_the_replica_knows_its_levels(project: Path, tmp_path: Path) -> None:
    text = (
        (project / "data" / "replica" / "campaign.toml")
        .read_text()
        .replace("runs/", f"{project}/data/replica/runs/")
    )
    text = "\n".join(
        row for row in text.partition("[line]")[0].splitlines() if not row.startswith("published")
    )
    (tmp_path / "campaign.toml").write_text(
        text
        + '\n[derived]\nd = "gamma[heavy] - gamma[light]"\na = "g*sin(phi)/(1 + inertia_ratio)"\n'
    )
    problem = load_campaign(tmp_path / "campaign.toml").problem(["heavy-04", "light-01"])
    values = problem.start()
    named = dict(zip(problem.names, values, strict=True))
    for run in problem.runs:
        found = run.derived(run.bind(problem.named(values)))
        assert found["d"].values[0, 0] == pytest.approx(
            named["gamma[heavy]"] - named["gamma[light]"]
        )
        expected = (
            9.81 * math.sin(named[f"phi[{run.name}]"]) / (1.0 + found["inertia_ratio"].values[0, 0])
        )
        assert found["a"].values[0, 0] == pytest.approx(expected)
