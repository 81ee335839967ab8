"""Findings and their words: every kind has a sentence, every status a meaning, and nobody at a
prompt is told of options of a command.
"""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest

import estim
from estim.common.labels import Notation
from estim.common.phrases import spoken
from estim.common.statuses import LEADS_TO, Amount, Finding, Kind, Status, decide, gravest, wrong
from estim.words import residuals
from estim.words.sentences import ADVICE, WORDS, advice, advice_for, describe
from estim.words.statuses import STATUS_WORDS

ANGLE = Notation("θ₀", "°", 180.0 / math.pi)
PARTS = {
    Kind.CHAIN_SHORT: Kind.RHAT_HIGH,
    Kind.METHODS_DIFFER: Kind.CHAIN_DIFFERS,
    Kind.CHAIN_DIFFERS: Kind.DIFFERENCE,
    Kind.SEVERAL_SOLUTIONS: Kind.SOLUTION,
    Kind.EXCHANGED: Kind.EXCHANGE,
    Kind.IMAGES: Kind.IMAGE,
    Kind.OTHER_NUMBERS: Kind.VALUES,
    Kind.COMMON_ERRORS: Kind.COMMON_ERROR,
    Kind.FASTER_CURVES: Kind.VALUES,
    Kind.STATED_HARDLY: Kind.PULL,
    Kind.STATED_DISAGREE: Kind.PULL,
    Kind.STATED_AND_CURVE: Kind.PULL,
}
TESTS = {
    Kind.COMMON_ERROR: "clock",
    Kind.LIMIT: "upper",
    Kind.RANKS_UNEVEN: "low",
    Kind.COVERAGE_OFF: "wide",
    Kind.NO_DERIVATIVE: "central",
}


NUMBERS = dict.fromkeys(
    [
        "along",
        "apart",
        "bayes",
        "before",
        "after",
        "chi2",
        "correlated",
        "correlated_length",
        "correlated_long",
        "correlated_short",
        "correlated_size",
        "counts",
        "coverage",
        "dof",
        "draws",
        "enough",
        "errors",
        "ess",
        "every",
        "expected",
        "factor",
        "farthest",
        "felt",
        "frames",
        "high",
        "hops",
        "k_hat",
        "length",
        "limit",
        "line",
        "long",
        "low",
        "most",
        "n_trial",
        "nodes",
        "pictures",
        "probability",
        "runs",
        "sd",
        "sd_frames",
        "sds",
        "sets_off",
        "share",
        "short",
        "smooth",
        "smooth_length",
        "smooth_long",
        "smooth_short",
        "smooth_size",
        "starts",
        "stated",
        "t",
        "tau",
        "tried",
        "trials",
        "typical",
        "u",
        "where",
        "x",
        "york",
    ],
    2.0,
)  # every further number that a kind may ask for
MEASURED = {
    Kind.GAMMA_DISAGREES: {"u_line": 0.5, "u_stated": 0.5},
    Kind.TRIALS_DISAGREE: {"u_trials": 0.5, "u_stated": 0.5},
    Kind.ENDS_DISAGREE: {"u_apart": 0.5},
}  # standard uncertainties beside numbers


def example(kind: Kind) -> Finding:
    return Finding(
        kind,
        run="r",
        test=TESTS.get(kind, "chi2"),
        p=0.004,
        size=3.0,
        numbers={**NUMBERS, **MEASURED.get(kind, {})},
        parameters=(Amount("theta0", 0.5, ANGLE.label("rad")),),
        names=("first", "second"),
        parts=(example(PARTS[kind]),) if kind in PARTS else (),
    )


def test_every_status_has_a_meaning_and_a_kind_that_leads_to_it() -> None:
    assert set(STATUS_WORDS) == set(Status)
    assert len(set(STATUS_WORDS.values())) == len(Status)
    assert set(LEADS_TO.values()) == set(Status) - {Status.OK}


def test_every_kind_has_words_and_advice_where_something_is_wrong() -> None:
    assert set(WORDS) == set(Kind)
    assert set(ADVICE) == set(LEADS_TO)


@pytest.mark.parametrize("kind", Kind)
def test_a_finding_is_told_in_one_line(kind: Kind) -> None:
    told = describe(example(kind))
    assert len(told) > 8 or kind in (Kind.IMAGE, Kind.VALUES, Kind.EXCHANGE)
    assert told == " ".join(told.split())
    assert "nan" not in told
    assert not told.endswith(".")


def test_a_number_with_its_uncertainty_is_told_with_it() -> None:
    assert "γ of the line, 2.0 ± 0.5, and γ as stated" in describe(example(Kind.GAMMA_DISAGREES))


def test_options_of_a_command_are_named_to_nobody_else() -> None:
    found = [example(kind) for kind in LEADS_TO]
    assert not any(
        "--" in words or "{" in words.replace("{prior", "") for words in advice_for(found)
    )
    short = example(Kind.CHAIN_SHORT)
    assert advice(short).endswith("; otherwise increase target=Target(max_step=...)")
    assert "another seed=, and" in advice(example(Kind.WALKERS_STUCK))
    with spoken("en", commands=True):
        assert sum("--" in words for words in advice_for(found)) == 3
        assert advice(short).endswith("; otherwise increase the number of steps (--max-steps)")


@pytest.mark.slow
def test_own_curves_are_sampled_and_reported_without_options() -> None:
    x = np.linspace(0.0, 1.0, 12)
    y = 1.0 + 2.0 * x + 0.1 * np.random.default_rng(3).standard_normal(x.size)
    fit = estim.fit_curve("a + b*x", x, y, u_y=0.1, start={"a": 0.0, "b": 1.0})
    hasty = estim.sample_curve(fit, seed=1, target=estim.Target(max_step=60))
    assert hasty.diagnosis.status is Status.NOT_CONVERGED
    report = estim.curve_report(fit, hasty, title="hasty", kind="synthetic")["report.md"].decode()
    for shown in (hasty._repr_markdown_(), report):
        assert "Target(max" in shown
        assert "--max-steps" not in shown
        assert "--seed" not in shown


def test_the_gravest_finding_decides_in_any_order() -> None:
    kinds = (Kind.PRESSED_EDGE, Kind.FIT_UNSETTLED, Kind.STATED_HARDLY, Kind.CHI2_TOO_LARGE)
    for order in permutations(kinds):
        findings = [Finding(kind) for kind in order]
        assert decide(findings) is Status.NOT_CONVERGED
        assert [finding.kind for finding in wrong(findings)] == [
            Kind.FIT_UNSETTLED,
            Kind.CHI2_TOO_LARGE,
            Kind.PRESSED_EDGE,
        ]
    assert decide(()) is decide([Finding(Kind.STATED_HARDLY)]) is gravest(()) is Status.OK
    assert gravest([Status.OK, Status.POOR_FIT, Status.AT_BOUND]) is Status.POOR_FIT


def test_a_status_is_a_word_too() -> None:
    assert f"{Status.POOR_FIT}" == Status.POOR_FIT == "poor-fit"
    assert repr(Status.OK) == "'ok'"
    assert Status("ok").ok
    assert not Status.AT_BOUND.ok
    assert not Status.METHODS_DISAGREE.draws_count
    assert Status.POOR_FIT.draws_count
    with pytest.raises(ValueError, match="nearly-ok"):
        Status("nearly-ok")


def test_one_finding_is_said_in_the_units_of_a_reader() -> None:
    edge = Finding(
        Kind.PRESSED_EDGE,
        p=0.004,
        parameters=(Amount("theta0[r]", math.radians(30.0), ANGLE.label("rad", "[r]")),),
    )
    assert (
        describe(edge)
        == "θ₀[r] lies at the edge of its prior, 30 °, and the data favour values beyond it "
        "(p = 0.0040)"
    )
    limit = Finding(Kind.PRESSED_LIMIT, p=0.004, parameters=(Amount("b", 0.25),))
    assert (
        describe(limit)
        == "b lies at its limit 0.25, and the data favour values beyond it (p = 0.0040): is "
        "the limit right?"
    )
    failed = Finding(
        Kind.RESIDUALS_NOT_RANDOM, run="r", test="runs", p=5e-5, numbers={"least": 5e-5}
    )
    assert (
        describe(failed)
        == "run r: the points stay on one side of the curve too long (test 'runs', p < 5e-5)"
    )


def test_tests_of_the_residuals_have_names_in_the_language_and_keys_in_english() -> None:
    assert [residuals.name_of_test(name) for name in residuals.TESTS] == list(residuals.TESTS)
    with spoken("es"):
        assert [residuals.name_of_test(name) for name in ("runs", "trend", "largest")] == [
            "rachas",
            "tendencia",
            "mayor",
        ]
