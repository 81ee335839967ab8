"""Examples of other programs' documentation: estim's numbers are those of the program (printed
there, or said by it when it was run: `benchmarks/peers`), within the tolerance of each example.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks" / "peers"))

import cases  # noqa: E402
import run  # noqa: E402

EXAMPLES = run.load()
KEPT = cases.stored()


@pytest.mark.slow
@pytest.mark.parametrize("item", EXAMPLES, ids=[item.name for item in EXAMPLES])
def test_estim_says_what_the_peer_says(item: cases.Example) -> None:
    if item.slow:
        pytest.skip("run by benchmarks/peers/run.py: it takes more than two seconds")
    found = cases.differences(item, item.numbers(), KEPT.get(item.name, {}))
    assert found, "the peer has no numbers"
    assert [row for row in found if not row.agrees] == []


def test_a_number_that_is_off_is_seen() -> None:
    item = next(item for item in EXAMPLES if item.name == "GTC_weighted_line")
    ours = item.numbers()
    value, sd = ours["slope"]
    for wrong in ({"slope": (value + 0.1 * sd, sd)}, {"slope": (value, 1.05 * sd)}):
        rows = cases.differences(item, {**ours, **wrong}, {})
        assert not all(row.agrees for row in rows)


def test_the_tolerance_follows_from_the_printed_digits() -> None:
    assert cases.half_digit("1.14") == pytest.approx(0.005)
    assert cases.half_digit("2.5e-3") == pytest.approx(5e-5)
    item = next(item for item in EXAMPLES if item.name == "GTC_relative_weights")
    rough = replace(item, printed={"slope": ("2.0", "0.04")})
    (row,) = cases.differences(rough, item.numbers(), {})
    assert row.agrees
    assert row.apart_limit == pytest.approx(0.05 / 0.04 + item.within)


def test_every_example_has_its_section_on_the_page() -> None:
    page = (ROOT / "docs" / "peers.md").read_text(encoding="utf-8")
    for item in EXAMPLES:
        assert f"{item.peer}: {item.page}" in page
        assert item.lines() in page, f"docs/peers.md is stale: {item.name}"
