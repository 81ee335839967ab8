"""Mutated campaigns through every command, judged by an oracle that shares no code with the
readers.

`benchmarks/fuzz_campaigns.py` runs thousands of them.
"""

from __future__ import annotations

import ast
from pathlib import Path
from unittest import mock

import campaign_fuzzing as fuzz
import campaign_oracle as oracle
import pytest

SOUND = [
    *(
        (command, base)
        for command in ("fit", "calibrate")
        for base in ("disk", "own", "imported", "speeds")
    ),
    *((command, "disk") for command in ("line", "energy", "reanalyse")),
    ("simulate", "design"),
]


def outcome_of(case: fuzz.Case, folder: Path) -> fuzz.Outcome:
    with mock.patch.object(fuzz, "make", return_value=case):
        return fuzz.in_fresh_folder(case.seed, folder)


@pytest.mark.parametrize(("command", "base"), SOUND)
def test_sound_campaigns_are_read_as_the_oracle_reads_them(
    command: str, base: str, tmp_path: Path
) -> None:
    # to start processes costs more than to read
    alone = ["--jobs", "1"] if command == "reanalyse" else []
    case = fuzz.Case(
        0, base, dict(fuzz.FILES[base]), [command, "c.toml", "--out", "out", *alone], full=False
    )
    outcome = outcome_of(case, tmp_path)
    assert (outcome.wrong, outcome.doubts) == ([], [])
    assert outcome.stopped or outcome.code == 0


@pytest.mark.parametrize("slip", ["a last digit", "a row", "an uncertainty"])
def test_readers_that_were_a_little_wrong_would_be_seen(slip: str, tmp_path: Path) -> None:
    read, table = oracle.stated, oracle.table

    def other_stated(value: object) -> oracle.Stated:
        stated = read(value)
        change = {"a last digit": (1.0 + 1e-9, 1.0), "an uncertainty": (1.0, 10.0)}.get(
            slip, (1.0, 1.0)
        )
        return oracle.Stated(
            stated.kind, tuple(n * f for n, f in zip(stated.numbers, change, strict=False))
        )

    def other_table(data: bytes, *, motion: bool = False) -> dict[str, list[float]]:
        return {
            name: column[:-1] if slip == "a row" else column for name, column in table(data).items()
        }

    case = fuzz.Case(
        0, "disk", dict(fuzz.FILES["disk"]), ["fit", "c.toml", "--out", "out"], full=False
    )
    with (
        mock.patch.object(oracle, "stated", other_stated),
        mock.patch.object(oracle, "table", other_table),
    ):
        assert outcome_of(case, tmp_path).wrong


def test_the_oracle_shares_no_code_with_the_readers() -> None:
    tree = ast.parse(Path(oracle.__file__).read_text())
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {
        "__future__",
        "csv",
        "math",
        "re",
        "tomllib",
        "unicodedata",
        "dataclasses",
        "pathlib",
        "typing",
    }


@pytest.mark.slow
def test_mutated_campaigns_are_refused_in_one_line_or_read_as_the_oracle_reads_them(
    tmp_path: Path,
) -> None:
    outcomes = [fuzz.in_fresh_folder(seed, tmp_path) for seed in range(60)]
    assert [(o.case.seed, o.wrong) for o in outcomes if o.wrong] == []
    assert [
        (o.case.seed, o.doubts)
        for o in outcomes
        if any(doubt.startswith("accepted") for doubt in o.doubts)
    ] == []
    assert sum(o.stopped or o.code in (0, 3) for o in outcomes) > 15
    assert sum(o.code == 2 for o in outcomes) > 15
