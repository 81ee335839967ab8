"""What a reader meets first: results of the data apart from what had been put in, limits for what
may be zero, everything else folded.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest
from command_runner import runner
from replica_run import heavy_04
from report_words import words

from estim.campaign import load_campaign
from estim.checks.quoted_results import (
    Estimate,
    is_measured,
    not_measured,
    p_sentence,
    result_table,
    screen_lines,
    upper_limit,
)
from estim.cli.commands import cli
from estim.common import Finding, Kind
from estim.common.errors import InputError
from estim.common.labels import Notation
from estim.common.quantity_text import format_p, p_digits, percentage, significant, with_unit
from estim.curve_fitting.single import fit_curve
from estim.fitting.prior_limits import Limit
from estim.pipeline import Analysis, sample_curve
from estim.problem.priors import HalfNormal, Normal, Uniform
from estim.reports.analysis import analysis_report
from estim.reports.copying import _symbol, _unit, copies_of
from estim.reports.pages import unbroken
from estim.reports.rendering import folded
from estim.reports.result import Result, first_reasons, first_screen, opened_by, result_of
from estim.reports.theta_min_line import evidence_words
from estim.sampling.chain import Convergence, Target, _percent
from estim.sampling.summary import Summary, summarise
from estim.words import first_step
from estim.words.sentences import ADVICE

PROJECT = Path(__file__).parents[1]
REPLICA = PROJECT / "data" / "replica" / "campaign.toml"
PLAIN = Notation("c_rr").label("1")


@cache
def fitted() -> tuple[Analysis, Result, str]:
    campaign, analysis = heavy_04()
    return (
        analysis,
        result_of(campaign, analysis),
        analysis_report(campaign, analysis, figures="none")["report.md"].decode(),
    )


def pages(text: str) -> float:
    """Printed: 55 lines of 90 characters."""
    return sum(max(1, -(-len(line) // 90)) for line in text.splitlines()) / 55.0


@pytest.mark.slow
def test_the_first_screen_is_short_and_has_the_result_the_rest_is_folded() -> None:
    *_, report = fitted()
    first, folds = (
        report.partition("<details>")[0],
        re.findall(r"<summary><b>(.*?)</b></summary>\n\n.*?\n\n</details>", report, re.DOTALL),
    )
    assert len(words(first)) < 120
    assert len(folds) == 6
    assert "| κ, inertia of the disk / (M_D R²) |" in first
    assert "p\u00a0=\u00a0" not in first
    assert pages(first) + 0.5 < 3.0  # the main figure takes half a page
    open_part = re.sub(r"<details>.*?</details>", "", report, flags=re.DOTALL)
    assert pages(report) > 3.0 > pages(open_part)


def test_what_the_data_leave_as_it_was_is_no_result(rng: np.random.Generator) -> None:
    prior = Normal(1.0, 0.1)
    for ratio, measured in ((0.79, True), (0.81, False)):
        assert is_measured(summary(1.0 + ratio * 0.1 * standard(rng)), prior, None) is measured
    moved = 1.12 + 0.09 * standard(rng)
    assert is_measured(summary(moved), prior, None), "no longer the number that was put in"
    result = fitted()[1]
    for name, p in result.parameters.items():
        expected = p.limit is None and p.upper_95 is None and p.sd <= 0.8 * p.prior_sd
        assert p.measured is expected, name
    screen = first_screen(result)
    assert re.findall(r"^\| (\w+), ", screen.table, re.MULTILINE) == ["κ", "φ"]
    assert all(f"{symbol} = " in screen.left for symbol in ("γ", "R"))
    assert "(stated 0.193 ± 0.010)" in screen.left


def altered(result: Result, **fields: object) -> Result:
    """The result with other fields, shown as before."""
    other = msgspec.structs.replace(result, **fields)
    other.__dict__["labels"] = result.labels
    return other


def test_what_to_mind_is_what_limits_most_and_a_force_that_is_sure() -> None:
    result = fitted()[1]
    assert result.budget is not None
    assert result.deviation is not None
    (budget, force), symbol = (
        (result.budget["kappa[heavy]"], result.deviation["heavy-04"]),
        "are strongly correlated",
    )

    def minds(share: float, probability: float) -> str:
        limited = msgspec.structs.replace(
            budget,
            sources=[msgspec.structs.replace(budget.sources[0], share=share), *budget.sources[1:]],
        )
        sure = msgspec.structs.replace(force, probability=probability)
        return "; ".join(
            first_screen(
                altered(result, budget={"kappa[heavy]": limited}, deviation={"heavy-04": sure})
            ).cautions
        )

    assert symbol in minds(0.51, 0.9)
    assert symbol not in minds(0.49, 0.9)
    assert "there is an unmodelled force" in minds(0.51, 0.96)
    assert "there is an unmodelled force" not in minds(0.51, 0.94)


def standard(rng: np.random.Generator) -> np.ndarray:
    draws = rng.standard_normal(4000)
    return (draws - draws.mean()) / draws.std(ddof=1)


def summary(draws: np.ndarray) -> Summary:
    return summarise(draws, unit="1", meaning="a quantity")


@pytest.mark.parametrize(("rate", "seed"), [(0.0, 100), (0.0, 102), (0.5, 100)])
def test_what_enters_by_its_square_may_be_zero_however_narrow_its_draws_are(
    rate: float, seed: int
) -> None:
    """SYNTHETIC: Jeffreys' prior of w in cos(w*t) is 0 at 0, and so is the density of its draws."""
    t = np.linspace(0.0, 5.0, 30)
    y = 2.0 * np.cos(rate * t) + 0.05 * np.random.default_rng(seed).standard_normal(30)
    fit = fit_curve("a*cos(w*t)", t, y, u_y=0.05, start={"a": 2.0, "w": 0.1})
    analysis = sample_curve(fit, seed=1, target=Target(ess=1000.0))
    (w,) = (estimate for estimate in analysis.estimates if estimate.label.symbol == "w")
    assert w.measured == (w.upper is None) == (rate > 0.0)
    assert (rate > 0.0) or 0.03 < w.upper < 0.07
    assert np.quantile(analysis.chain.column("w"), 0.025) > 0.0


def test_what_may_be_zero_has_an_upper_limit(rng: np.random.Generator) -> None:
    draws = np.abs(rng.standard_normal(20_000)) * 0.005
    prior = HalfNormal(0.005)
    limit = upper_limit(summary(draws), prior, draws)
    # of a folded normal the 95 % quantile is 1.96 sd
    assert limit == pytest.approx(1.96 * 0.005, rel=0.03)
    shown = Estimate(PLAIN, summary(draws), "half-normal", False, limit)
    assert re.fullmatch(r"c_rr < 0\.00\d+ \(95 %\)", shown.relation)
    for sds, limited in ((1.9, True), (2.1, False)):
        near = sds * 0.003 + 0.003 * standard(rng)
        assert (upper_limit(summary(near), prior, near) is not None) is limited
    # far from 0, with a long tail above
    tailed = 0.047 * np.exp(0.42 * standard(rng) + 0.3 * np.abs(standard(rng)) ** 3)
    assert np.quantile(tailed, 0.025) > 0.015
    assert summary(tailed).mean < 2.0 * summary(tailed).sd
    assert upper_limit(summary(tailed), HalfNormal(10.0), tailed) is None
    sure = 0.02 + 0.003 * standard(rng)
    assert upper_limit(summary(sure), prior, sure) is None
    assert upper_limit(summary(draws), Normal(0.0, 1.0), draws) is None  # may be negative
    assert upper_limit(summary(draws), Uniform(-1.0, 1.0), draws) is None


def test_what_lies_on_an_edge_has_a_value_at_every_draw() -> None:
    """It has a limit in place of a mean, which is no division by zero."""
    result = fitted()[1]
    name = "rolling_resistance"
    p = result.parameters[name]
    edge = Limit("upper", 0.0, float(p.q84), float(p.q975))
    limited = msgspec.structs.replace(
        p, mean=None, sd=None, limit=edge, measured=False, upper_95=None
    )
    minds = first_screen(altered(result, parameters={**result.parameters, name: limited})).cautions
    assert not [words for words in minds if "no value at some of the draws" in words]
    nothing = msgspec.structs.replace(
        limited, limit=None, median=None, q025=None, q16=None, q84=None, q975=None
    )
    minds = first_screen(altered(result, parameters={**result.parameters, name: nothing})).cautions
    assert minds[0].endswith(f": {result.labels.symbol(name)}")


def test_values_stand_beside_what_was_stated_and_what_is_true(rng: np.random.Generator) -> None:
    degrees = Notation("φ", "°", 180.0 / np.pi).label("rad")
    draws = np.radians(4.0 + 0.25 * standard(rng))
    one = Estimate(
        degrees,
        summary(draws),
        Normal(np.radians(3.7), np.radians(0.4)).stated_words("rad", degrees),
        True,
        None,
        np.radians(3.5),
    )
    assert result_table([one]) == (
        "|  | from these data | stated value | true |\n| --- | --- | --- | --- |\n"
        "| φ, a quantity | (4.00 ± 0.25)° | (3.7 ± 0.4)° | 3.5° (+2.0 sd) |"
    )
    bare = replace(one, stated="", true=None)
    assert result_table([bare]).startswith("|  | from these data |\n")
    assert result_table([replace(one, measured=False)]) == ""
    assert screen_lines([one], tests="p") == [
        "p",
        "φ = (4.00 ± 0.25)°   stated (3.7 ± 0.4)°; true 3.5° (+2.0 sd)",
    ]
    assert not_measured([one]) == ""
    assert (
        not_measured([replace(one, measured=False)]) == "φ = (4.00 ± 0.25)° (stated (3.7 ± 0.4)°)"
    )
    assert Uniform(0.0, 1.0).stated_words("1", PLAIN) == "uniform in [0, 1]"


def test_true_values_stand_in_a_file_beside_synthetic_data_alone(tmp_path: Path) -> None:
    assert fitted()[1].parameters["kappa[heavy]"].true == 0.45
    text = REPLICA.read_text().replace('file = "', f'file = "{REPLICA.parent}/')
    (tmp_path / "truth.toml").write_text('"kappa[heavy]" = 0.4\nradius = 0.15\n')
    (tmp_path / "c.toml").write_text(text)
    assert load_campaign(tmp_path / "c.toml").truth == {"kappa[heavy]": 0.4, "radius": 0.15}
    (tmp_path / "c.toml").write_text(text.replace('"synthetic"', '"measured"'))
    assert load_campaign(tmp_path / "c.toml").truth == {}
    (tmp_path / "c.toml").write_text(text)
    (tmp_path / "truth.toml").write_text('radius = 0.15\n"kappa[heavy]" = "0.4"\n')
    with pytest.raises(InputError, match=r"truth.toml:2: 'kappa\[heavy\]' must be a finite number"):
        load_campaign(tmp_path / "c.toml")


def test_the_part_with_the_reason_stands_open() -> None:
    result = fitted()[1]
    assert opened_by(result) == frozenset()
    for status, key in (
        ("poor-fit", "curve"),
        ("contradiction", "values"),
        ("not-converged", "computing"),
        ("not-identified", "limits"),
    ):
        assert opened_by(msgspec.structs.replace(result, status=status)) == {key}
    assert (
        folded("a <b>", "text\n", opened=False)
        == "<details>\n<summary><b>a &lt;b></b></summary>\n\ntext\n\n</details>"
    )
    assert folded("a", "text\n", opened=True) == "text"
    assert folded("a", "\n", opened=False) == ""


def test_results_are_copied_as_siunitx_reads_them(rng: np.random.Generator) -> None:
    tau = Notation("tau").label("µs")
    one = Estimate(tau, summary(2.07 + 0.05 * standard(rng)), "", True)
    large = Estimate(Notation("N").label("1"), summary(4196.0 + 83.0 * standard(rng)), "", False)
    small = Estimate(Notation("I₀").label("A"), summary(1.2e-6 + 1e-7 * standard(rng)), "", True)
    copies = copies_of([one, large, small])
    assert copies.plain.splitlines()[1:-1] == [
        "tau = (2.07 ± 0.05) µs",
        "N = (4.20 ± 0.08)×10³ (not measured here)",
        "I₀ = (1.20 ± 0.10)×10⁻⁶ A",
    ]
    assert copies.brackets.splitlines()[1:-1] == [
        r"$\tau = \qty{2.07(5)}{\micro\second}$",
        r"$N = \num{4.20(8)e3}$  % not measured here",
        r"$I_{0} = \qty{1.20(10)e-6}{\ampere}$",
    ]
    assert copies.plus_minus.splitlines()[1:-1] == [
        r"$\tau = \qty{2.07 +- 0.05}{\micro\second}$",
        r"$N = \num{4.20 +- 0.08 e3}$  % not measured here",
        r"$I_{0} = \qty{1.20 +- 0.10 e-6}{\ampere}$",
    ]
    assert (
        copies.table.splitlines()[1]
        == "quantity,value,u,low_68,high_68,low_95,high_95,unit,measured"
    )
    assert copies.table.splitlines()[2].startswith("tau,2.07,0.05,2.02")
    assert copies.table.splitlines()[3].endswith(",,no")
    made = copies_of([one], kind="synthetic")
    firsts = [block.splitlines()[1] for block in (made.plain, made.brackets, made.plus_minus)]
    assert firsts == ["SYNTHETIC data", "% SYNTHETIC data", "% SYNTHETIC data"]
    assert made.table.splitlines()[1] == "# SYNTHETIC data"
    tilt = Estimate(
        Notation("φ", "°", 180.0 / np.pi).label("rad"),
        summary(np.radians(4.0 + 0.25 * standard(rng))),
        "",
        True,
    )
    symbol, value, u, *ends, unit, measured = copies_of([tilt]).table.splitlines()[2].split(",")
    assert (symbol, value, u, unit, measured) == ("φ", "4", "0.25", "°", "yes")
    assert [float(end) for end in ends] == pytest.approx([3.75, 4.25, 3.51, 4.49], abs=0.03)


def test_the_table_resolves_the_interval_of_a_value_known_to_a_part_in_a_million(
    rng: np.random.Generator,
) -> None:
    draws = 109677.58 + 0.06 * standard(rng)
    copies = copies_of([Estimate(Notation("R").label("1/cm"), summary(draws), "", True)])
    _, value, u, *ends, _, _ = copies.table.splitlines()[2].split(",")
    assert (value, float(u)) == ("109677.58", pytest.approx(0.06, rel=1e-5))
    shown = np.quantile(draws, [0.15865525, 0.84134475, 0.025, 0.975])
    assert [float(end) for end in ends] == pytest.approx(shown.tolist(), abs=0.002)


def test_every_copy_of_a_lopsided_value_has_the_same_number(rng: np.random.Generator) -> None:
    """Its median, since ± would mislead; the mean is another number."""
    draws = np.exp(0.5 * standard(rng))
    copies = copies_of([Estimate(PLAIN, summary(draws), "", True)])
    assert copies.plain.splitlines()[1] == "c_rr = 1.00 +0.64 −0.39"
    assert "= 1.00^{+0.64}_{-0.39}$" in copies.brackets
    _, value, u, low, high, *_ = copies.table.splitlines()[2].split(",")
    assert (float(value), u) == (pytest.approx(np.median(draws), rel=1e-5), "")
    assert (float(low), float(high)) == pytest.approx((np.exp(-0.5), np.exp(0.5)), rel=0.03)
    assert abs(draws.mean() - float(value)) > 0.1


@pytest.mark.parametrize(
    ("unit", "written"),
    [
        ("m/s²", r"\metre\per\second\tothe{2}"),
        ("1/µs", r"\per\micro\second"),
        ("N m", r"\newton\metre"),
        ("mm", r"\milli\metre"),
        ("1", ""),
        ("m s⁻²", r"\metre\per\second\tothe{2}"),
        ("°", r"\degree"),
        ("min", r"\minute"),
        ("furlong_2", r"\text{furlong\_2}"),
        ("kg", r"\kilo\gram"),
    ],
)
def test_units_are_written_in_words_of_siunitx_or_as_text(unit: str, written: str) -> None:
    assert _unit(unit) == written


def test_symbols_are_written_as_mathematics() -> None:
    level = Notation("θ₀").label("rad", "[heavy_04]")
    assert _symbol(level) == r"\theta_{0,\text{heavy\_04}}"
    assert _symbol(PLAIN) == r"c_{\mathrm{rr}}"
    assert _symbol(Notation("E₀").label("1")) == _symbol(Notation("E0").label("1")) == "E_{0}"
    assert _symbol(Notation("outlier fraction").label("1")) == r"\mathrm{outlier\ fraction}"


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.09, 2, "0.090"),
        (0.2, 2, "0.20"),
        (5.46e-5, 3, "5.46×10⁻⁵"),
        (-0.004, 2, "−0.0040"),
        (24.0, 2, "24"),
        (120.0, 2, "120"),
        (0.0, 2, "0"),
        (9.9995e-5, 2, "0.00010"),
        (1.5e7, 2, "1.5×10⁷"),
        (float("nan"), 2, "n/a"),
    ],
)
def test_significant_digits_keep_their_zeros(value: float, digits: int, shown: str) -> None:
    assert significant(value, digits) == shown


def test_probabilities_and_shares_are_written_one_way() -> None:
    assert [format_p(p) for p in (0.9, 0.91, 0.0003, 1e-9)] == [
        "p = 0.90",
        "p = 0.91",
        "p = 0.00030",
        "p < 1e-6",
    ]
    assert format_p(5e-5, 5e-5) == "p < 5e-5"
    assert p_digits(2e-5) == "2.0e-5"
    assert [percentage(share) for share in (1.06, 0.086, 0.003, 0.95)] == [
        "106 %",
        "8.6 %",
        "0.30 %",
        "95 %",
    ]
    pairs = (
        ("10.4 ± 0.5", "°"),
        ("0.4", "m"),
        ("1 ± 2", "1"),
        ("n/a", "m"),
        ("(1.2 ± 0.1)×10⁻⁶", "A"),
    )
    assert [with_unit(*pair) for pair in pairs] == [
        "(10.4 ± 0.5)°",
        "0.4 m",
        "1 ± 2",
        "n/a",
        "(1.2 ± 0.1)×10⁻⁶ A",
    ]
    assert p_sentence(0.91, None) == "goodness of fit: p = 0.91"
    assert evidence_words(-1.06) == "2.9 : 1 for a line through the origin, positive evidence"
    assert evidence_words(6.0).startswith("400 : 1 for an intercept, very strong")


def test_progress_is_the_share_of_the_draws_needed_by_the_criterion_farthest_from_met() -> None:
    at = Convergence(
        n_step=300, rhat=1.005, ess_bulk=3000.0, ess_tail=1000.0, tau=3.0, met=False, findings=()
    )
    assert _percent(at, Target(ess=4000.0)) == 25
    assert _percent(replace(at, n_step=30), Target(ess=4000.0)) == 20  # of 50 autocorrelation times
    # R-hat is still too large
    assert (
        _percent(replace(at, ess_tail=9000.0, ess_bulk=9000.0, n_step=900), Target(ess=4000.0))
        == 99
    )
    assert _percent(replace(at, met=True), Target(ess=4000.0)) == 100
    assert _percent(replace(at, tau=float("nan")), Target(ess=4000.0)) == 0


def test_the_first_screen_has_the_gravest_reasons_and_room_for_one_at_least() -> None:
    short, long = "two words", "word " * 80
    assert first_reasons([short] * 5) == [short] * 3
    assert first_reasons([long, short]) == [long]
    assert first_reasons([short, long, short]) == [short]
    assert first_reasons([]) == []


def test_what_to_do_first_is_short_and_one_reading_far_off_comes_before_physics() -> None:
    size, far, order = (
        Finding(Kind.CURVE_LACKS, run="r", test=test, p=1e-5, numbers={"deviation": 1.0})
        for test in ("chi2", "largest", "runs")
    )
    assert first_step([]) == ""
    assert first_step([size, far]).startswith("look at the outlying reading; if single readings")
    assert "an effect that the curve does not model" in first_step([size, far, order])
    assert "an effect that the curve does not model" in first_step([order])
    assert "check the stated value" in first_step([Finding(Kind.STATED_DISAGREE), size, far])
    for kind in ADVICE:
        assert len(first_step([Finding(kind)]).split()) <= 30, kind


def test_what_python_prints_is_what_the_terminal_says() -> None:
    analysis, result, _ = fitted()
    assert (
        first_screen(result).lines[1:3]
        == screen_lines(estimates_with_truth(analysis), tests="p")[1:3]
    )


def estimates_with_truth(analysis: Analysis) -> list[Estimate]:
    truth = load_campaign(REPLICA).truth
    return [
        replace(one, true=truth.get(name, float("nan")))
        for one, name in zip(analysis.estimates, analysis.problem.names, strict=True)
    ]


def test_numbers_keep_their_units_on_one_line_and_code_stays_as_it_is() -> None:
    assert unbroken(
        "# 5 % x\n(3 ± 1) m, 5 % of x\n`a = 1 ± 2`\n# 5 % x\n```\n1 ± 2\n```\n2 ± 1"
    ) == (
        "# 5 % x\n(3\u00a0±\u00a01)\u00a0m, 5\u00a0% of x\n`a = 1 ± 2`\n# 5 % x\n```\n1 ± "
        "2\n```\n2\u00a0±\u00a01"
    )
    *_, report = fitted()
    assert re.search("\\(3\\.\\d\\d\u00a0±\u00a00\\.\\d\\d\\)°", report.partition("<details>")[0])


def test_the_sample_report_prints_on_six_pages_and_publishes_nothing_that_was_put_in(
    reports: Path,
) -> None:
    report = (reports / "replica" / "report.md").read_text(encoding="utf-8")
    before_figures = report.partition("![")[0]
    assert len(words(before_figures)) < 120
    assert len(words(report.partition("<details>")[0])) < 120
    open_part = re.sub(r"<details>.*?</details>", "", report, flags=re.DOTALL)
    assert pages(open_part) + 2 * 0.8 < 6.0  # two figures, each less than a page
    published = report.partition("## Published and reanalysed")[2].partition("\n## ")[0]
    assert "inertia parameter" in published
    assert "radius of the disk" not in published
    assert report.count("**recommended**") == 1
    assert report.count("<details>") == report.count("</details>") > 5


def fit_of_a_table(folder: Path, y: Sequence[float], *options: str) -> tuple[str, str]:
    """What a terminal and a report say of a line through y at t = 0, 1, ... s."""
    rows = "".join(f"{i},{value}\n" for i, value in enumerate(y))
    (folder / "r.csv").write_text("t (s),U [V]\n" + rows)
    arguments = ["fit", str(folder / "r.csv"), "--formula", "m*t + c", *options]
    out = folder / "out"
    result = runner().invoke(cli, [*arguments, "--figures", "none", "--out", str(out)])
    assert result.exit_code in (0, 3), result.output
    report = (out / "report.md").read_text().replace("\N{NO-BREAK SPACE}", " ")
    return result.output, " ".join(report.split())


def test_a_curve_that_does_not_fit_shows_its_best_values_without_uncertainties(
    tmp_path: Path,
) -> None:
    # of y = t^2 at 0..7 the line of least squares is 7 t - 7, farthest off by 7 at both ends
    said, report = fit_of_a_table(tmp_path, [t * t for t in range(8)], "--u-y", "0.5")
    first = report.partition("<details>")[0]
    best = "est values, not a result: m = 7.00 V/s, c = −7.00 V; points lie up to 14 standard"
    for text in (said, first):
        assert best in text
        assert re.search(r"from the best curve, at t = [07] s", text)
        assert re.search(r"[Ff]irst step: look at the residuals", text)
    assert "±" not in first.replace("data ± one standard deviation", "")
    assert len(words(first)) < 120
    record = json.loads((tmp_path / "out" / "result.json").read_bytes())
    far = record["runs"]["r"]["farthest"]
    assert far["where"] in ("t = 0 s", "t = 7 s")
    assert far["sds"] == pytest.approx(14.0, rel=1e-3)


@pytest.mark.slow
def test_a_scatter_that_sets_the_errors_is_called_no_test_of_the_curve(tmp_path: Path) -> None:
    y = [0.21, 2.05, 3.82, 5.71, 7.49, 9.36, 11.14, 13.03]
    _, report = fit_of_a_table(tmp_path, y)
    assert "were estimated from the scatter about the curve, so the size of the residuals" in report
    assert "χ² = " not in report
    assert "farthest" not in (tmp_path / "out" / "result.json").read_text()
    _, report = fit_of_a_table(tmp_path, y, "--u-y", "0.05")
    assert "χ² = 2.115 for 6 degrees of freedom (data and priors), p = 0.91." in report
    assert "estimated from the scatter" not in report
