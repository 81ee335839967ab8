"""Rows without a value are named where they are seen; runs that nobody asked for are not read."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from estim.campaign import load_campaign
from estim.cli import commands as cli
from estim.common.errors import InputError

REPLICA = Path(__file__).parents[1] / "data" / "replica"


def test_a_row_without_a_value_is_named_in_the_terminal_and_on_the_first_screen(
    tmp_path: Path,
) -> None:
    rows = [f"{t};{2.0 * math.exp(-t / 5.0) + 0.01 * (-1) ** t:.3f}" for t in range(12)]
    rows[3] = "3;NaN"
    (tmp_path / "cap.csv").write_text("\n".join(["t / s;U / V", *rows, "12;"]))
    said = [
        "fit",
        tmp_path / "cap.csv",
        "--formula",
        "U*exp(-t/tau)",
        "--u-y",
        0.01,
        "--figures",
        "none",
        "--out",
        tmp_path / "out",
    ]
    done = CliRunner().invoke(cli.cli, list(map(str, said)))
    assert done.exit_code == 0, done.output
    assert "  2 rows were excluded because a value is missing (lines 5, 14)\n" in done.output
    first = (tmp_path / "out" / "report.md").read_text().partition("<details>")[0]
    assert "- Note: 2 rows were excluded because a value is missing (lines 5, 14)." in first
    assert first.startswith("# cap\n")  # not "cap: cap"
    assert '"blank": [\n    5,\n    14\n' in (tmp_path / "out" / "result.json").read_text()


@pytest.fixture
def spoilt(tmp_path: Path) -> Path:
    """The replica with an empty file, one with a number missing, and one that is not there."""
    shutil.copytree(REPLICA, tmp_path / "replica")
    runs = tmp_path / "replica" / "runs"
    (runs / "heavy-02.csv").write_text("")
    (runs / "heavy-04.csv").write_text(
        (runs / "heavy-04.csv").read_text().replace("-0.00", "nan", 1)
    )
    (runs / "heavy-08.csv").unlink()
    return tmp_path / "replica"


def test_runs_that_were_not_asked_for_are_not_read(spoilt: Path) -> None:
    assert load_campaign(spoilt / "campaign.toml", asked=["heavy-06", "light-01"]).run_names == (
        "heavy-06",
        "light-01",
    )
    with pytest.raises(InputError, match=r"heavy-02\.csv: must not be empty"):
        load_campaign(spoilt / "campaign.toml", asked=["heavy-06", "heavy-02"])
    with pytest.raises(InputError, match="heavy-02"):
        load_campaign(spoilt / "campaign.toml")


def test_a_run_that_is_not_there_is_named_beside_all_that_are(spoilt: Path) -> None:
    done = CliRunner().invoke(
        cli.cli, ["fit", str(spoilt / "campaign.toml"), "--run", "heavy-66"], standalone_mode=False
    )
    assert (
        "(heavy-02, heavy-04, heavy-06, heavy-08, light-01, light-02, light-03, light-04): heavy-66"
        in str(done.exception)
    )


def test_an_imported_track_is_still_compared_with_the_others_that_can_be_read(
    tmp_path: Path,
) -> None:
    shutil.copytree(REPLICA, tmp_path / "replica")
    runs = tmp_path / "replica" / "runs"
    for file in runs.glob("*.csv"):
        lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
        slow = 3.0 if file.stem == "heavy-06" else 1.0
        rows = [f"{slow * float(t):.5f},{x}" for t, x in (line.split(",") for line in lines[1:])]
        file.write_text("\n".join(["# made by estim import", "# from a video", lines[0], *rows]))
    path = tmp_path / "replica" / "campaign.toml"
    whole, alone = (
        load_campaign(path).tables["heavy-06"],
        load_campaign(path, asked=["heavy-06"]).tables["heavy-06"],
    )
    assert alone.warnings == whole.warnings != ()
    assert alone.facts == whole.facts
    (runs / "light-04.csv").write_text("")
    spoilt = load_campaign(path, asked=["heavy-06"]).tables["heavy-06"]
    assert spoilt.warnings == whole.warnings
    assert (
        spoilt.facts[-1]
        == "its frame rate was not compared with that of light-04, because their files cannot "
        "be read"
    )
