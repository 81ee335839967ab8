"""What a report's cells say: which values are lopsided, signs, what is stated once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from estim.common import markdown, spoken
from estim.common.labels import Notation
from estim.common.quantity_text import format_quantity, format_rounded, signed
from estim.problem.observations import Parameter
from estim.problem.priors import HalfNormal
from estim.reports.derived import derived_rows
from estim.reports.records import Labels
from estim.reports.rendering import render, translated
from estim.reports.result import RunSummary
from estim.sampling import parameter_cells, value_cell
from estim.sampling.summary import Summary, summarise


def summary(draws: np.ndarray, unit: str = "1") -> Summary:
    return summarise(draws, unit=unit, meaning="a quantity")


def test_a_half_normal_and_a_constant_times_it_are_both_lopsided(rng: np.random.Generator) -> None:
    draws = np.abs(rng.standard_normal(20_000))
    for factor in (0.005, 0.65 * 0.005, -3.0):
        cell = parameter_cells(summary(factor * draws), Notation("c_rr").label("1"))[2]
        assert "±" not in cell
        assert " −" in cell
    normal = summary(0.3 + 0.1 * rng.standard_normal(20_000))
    assert value_cell(normal, Notation("γ").label("1")) == "0.30 ± 0.10"


def test_halves_of_the_interval_decide_at_three_to_two() -> None:
    def of(q975: float) -> Summary:
        return Summary("1", "", 0.0, 1.0, 0.0, -2.0, -1.0, 1.0, q975)

    assert "±" in value_cell(of(2.9), Notation("γ").label("1"))
    assert "±" not in value_cell(of(3.1), Notation("γ").label("1"))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("-0.42", "−0.42"),
        ("-0.00", "0.00"),
        ("+0.00", "0.00"),
        ("+0.97", "+0.97"),
        ("-0.05", "−0.05"),
        ("-0", "0"),
        ("-1.5e-07", "−1.5e-07"),
        ("(-0.0 ± 1.0)×10⁻⁷", "(0.0 ± 1.0)×10⁻⁷"),
        ("-10 ± 3", "−10 ± 3"),
    ],
)
def test_a_rounded_zero_has_no_sign_and_minus_is_no_hyphen(text: str, shown: str) -> None:
    assert signed(text) == shown


def test_numbers_are_formatted_with_such_signs() -> None:
    assert format_quantity(-1e-5, 0.001) == "0.0000 ± 0.0010"
    assert format_quantity(-0.5, 0.1) == "−0.50 ± 0.10"
    assert format_quantity(-0.5, 0.1, plus_minus=False) == "-0.50(10)"  # what a campaign reads
    assert format_rounded(-0.0271, 0.04) == "−0.027"


def test_what_is_the_same_for_every_run_is_stated_once(rng: np.random.Generator) -> None:
    j, slopes = (
        summary(rng.standard_normal(1000)),
        [summary(rng.standard_normal(1000)) for _ in range(2)],
    )
    blank = dict.fromkeys(RunSummary.__struct_fields__)
    runs = {
        name: RunSummary(**(blank | {"derived": {"inertia_ratio": j, "slope": s}}))
        for name, s in zip(("a", "b"), slopes, strict=True)
    }
    shown = {"inertia_ratio": Notation("j").label("1"), "slope": Notation("s").label("1")}
    assert [row[0] for row in derived_rows(runs, Labels({}, {}, dict.fromkeys(runs, shown)))] == [
        "j",
        "s[a]",
        "s[b]",
    ]


def test_the_table_of_models_prints_a_value_as_the_report_does(rng: np.random.Generator) -> None:
    p = Parameter("rolling_resistance", "1", HalfNormal(0.005), "")
    posterior = summary(0.005 * np.abs(rng.standard_normal(20_000)))
    none = dict.fromkeys(("elpd", "se_elpd", "behind", "se_behind", "log_evidence", "influential"))
    rows = [
        SimpleNamespace(
            name=name, status=status, words="", reasons=[], n_obs=9, posterior={p.name: posterior}
        )
        for name, status in (("white", "ok"), ("robust", "poor-fit"))
    ]
    for row in rows:
        vars(row).update(none)
    text = render(
        "compare.md.j2",
        title="",
        runs=["a"],
        verdict="1 of 2 models have status ok",
        kind="measured",
        rows=rows,
        common=[p],
        influential=0.7,
        behind=4.0,
        folder=str,
        several_data=False,
        data=["speeds", "speeds"],
    )
    value = markdown(parameter_cells(posterior, p.label)[2])
    assert f"| [white](white/report.md) | ok | {value} |" in text
    assert "| [robust](robust/report.md) | poor-fit | — |" in text


def test_an_item_below_another_stays_below_it_in_another_language() -> None:
    source = "- {{ run }}\n{% for why in excluded %}\n  - excluded: {{ why }}\n{% endfor %}\n"
    assert translated(source) == source
    with spoken("es"):
        assert translated(source) == source.replace("excluded: ", "excluido: ")
