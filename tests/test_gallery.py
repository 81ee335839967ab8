"""The gallery: its campaigns pose problems, its index says what the results say, and the results
are those of the data beside them.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import gallery

from estim.campaign import load_campaign
from estim.cli import commands as cli
from estim.common.quantity import Quantity

STEPS = {step["name"]: step for experiment in gallery.experiments() for step in experiment["step"]}
CAMPAIGNS = sorted(file for file in gallery.DATA.glob("*.toml") if file.name != "gallery.toml")


def columns(name: str, *which: int) -> np.ndarray:
    """Columns of a table of the gallery, (n_column, n_row)."""
    return np.loadtxt(gallery.DATA / name, delimiter=",", skiprows=1, usecols=which, unpack=True)


def value_of(step: str, place: str) -> Quantity:
    status, value, _ = gallery.found(step, place)
    assert status == "ok"
    assert value is not None
    return value


@pytest.mark.parametrize("file", CAMPAIGNS, ids=lambda file: file.stem)
def test_every_campaign_is_read_and_run(file: Path) -> None:
    campaign = load_campaign(file)
    assert [
        campaign.problem([name]).n_obs
        for name in campaign.source.names
        if campaign.problem([name]).n_obs < 3
    ] == []
    assert f"fit data/gallery/{file.name}" in " ".join(step["command"] for step in STEPS.values())


def test_the_index_is_what_the_results_say(monkeypatch: pytest.MonkeyPatch) -> None:
    text = (gallery.REPORTS / "README.md").read_text(encoding="utf-8")
    assert gallery.index() == text

    def shifted(step: str, place: str) -> tuple[str, Quantity | None, str]:
        status, value, unit = found(step, place)
        return status, None if value is None else Quantity(value.value + value.u, value.u), unit

    found = gallery.found
    monkeypatch.setattr(gallery, "found", shifted)
    differing = [line for line in gallery.index().splitlines() if line not in text.splitlines()]
    assert len([line for line in differing if line.startswith("| [")]) == len(gallery.experiments())


def test_the_reports_are_of_the_data_and_campaigns_beside_them() -> None:
    seen = 0
    for step in STEPS:
        for file in (gallery.REPORTS / step).rglob("result.json"):
            made = gallery.result_of(step, str(file.parent.relative_to(gallery.REPORTS / step)))[
                "provenance"
            ]
            for name, digest in {
                made["campaign"]: made["campaign_sha256"],
                **made["data_sha256"],
            }.items():
                assert (
                    hashlib.sha256((gallery.PROJECT / name).read_bytes()).hexdigest() == digest
                ), f"{file}: run `make gallery`"
                seen += 1
    assert seen > 40


def test_the_reports_are_small_and_no_link_is_broken() -> None:
    files = [file for file in gallery.REPORTS.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 3e6
    assert not [file for file in files if file.suffix == ".nc"]
    for report in (file for file in files if file.suffix == ".md"):
        for target in gallery.re.findall(r"\]\(([^)#:]+)\)", report.read_text(encoding="utf-8")):
            assert (report.parent / target).exists(), f"{report}: {target}"


def test_the_peaks_are_those_that_were_found() -> None:
    assert gallery.collected(STEPS["franck_hertz_peaks"]) == (
        gallery.DATA / "franck_hertz_peaks.csv"
    ).read_text(encoding="utf-8")


def test_the_tables_are_those_that_were_published() -> None:
    """Michelson: certified by NIST StRD.  Cavendish: his printed mean is that with 5.88 for the
    third value (README of the data).
    """
    speed, density = columns("michelson_1879.csv", 2), columns("cavendish_1798.csv", 1)
    assert speed.mean() == pytest.approx(299.8524, abs=1e-9)
    assert speed.std(ddof=1) == pytest.approx(0.0790105478, abs=1e-9)
    assert density[2] == 4.88
    assert round(density.mean() + 1.0 / density.size, 2) == 5.48


def test_results_against_what_can_be_done_by_hand() -> None:
    """Means and slopes in closed form, within a tenth of a standard uncertainty."""
    density, (distance, velocity) = (
        columns("cavendish_1798.csv", 1),
        columns("hubble_1929.csv", 1, 2),
    )
    number, voltage, u = columns("franck_hertz_peaks.csv", 0, 1, 2)
    found = {
        ("cavendish", "all:D"): density.mean(),
        ("cavendish", "stiffer-wire:D"): density[6:].mean(),
        ("hubble", "through-origin:H"): distance @ velocity / (distance @ distance),
        ("hubble", "with-intercept:H"): np.polyfit(distance, velocity, 1)[0],
        ("franck_hertz_spacing", "growing:g"): 2.0 * np.polyfit(number, voltage, 2, w=1.0 / u)[0],
        ("filament", "b2"): 3.8604055871,  # NIST StRD, certified
    }
    for (step, place), by_hand in found.items():
        value = value_of(step, place)
        assert abs(value.value - by_hand) < 0.1 * value.u, (step, place)
    shifted = value_of("hubble", "through-origin:H")
    # another line is told from this one
    assert abs(shifted.value - found["hubble", "with-intercept:H"]) > 0.5 * shifted.u


def test_what_the_texts_say_is_so() -> None:
    """Words of gallery.toml that no number of the tables holds."""
    status = {
        place: gallery.found(step, place)[0]
        for step, place in (
            ("michelson_mean", "independent:c"),
            ("falling_phone", "speed-squared:D"),
            ("table_length", "2m-ruler-normal:L"),
            ("table_length", "30cm-ruler-normal:L"),
            ("franck_hertz_spacing", "even:E"),
        )
    }
    assert set(status.values()) == {"poor-fit"}
    independent = 0.0790105478 / 10.0  # the standard deviation of the mean of 100
    assert (
        independent
        < 0.5 * value_of("michelson_mean", "correlated:c").u
        < value_of("michelson", "c").u
    )
    speed = value_of("michelson", "c")
    assert 4.0 < (speed.value - 299.7345) / speed.u < 5.0
    assert value_of("filament", "b2").u == pytest.approx(1.5 * 0.0517, rel=0.1)
    for ruler, blunders in (("2m-ruler", [3, 6]), ("30cm-ruler", [3, 15])):
        (run,) = gallery.result_of("table_length", ruler)["runs"].values()
        assert [point["row"] for point in run["outliers"]] == blunders
    agree = (gallery.REPORTS / "wheel" / "report.md").read_text(encoding="utf-8")
    assert "The 7 runs agree about the quantities they share" in agree


def test_reports_say_what_is_exact_and_what_may_be_done_about_blunders() -> None:
    exact = {
        (step, run): [
            fact for r in gallery.result_of(step, run)["runs"].values() for fact in r["facts"]
        ]
        for step, run in (
            ("hubble", "through-origin"),
            ("hubble", "with-intercept"),
            ("falling_phone", "speed-squared"),
        )
    }
    assert list(exact.values()) == [
        ["K is fixed at 0"],
        [],
        ["n is fixed at 2", "T is fixed at 0.621"],
    ]
    normal, robust = (
        gallery.result_of("table_length", run)["advice"] for run in ("2m-ruler-normal", "2m-ruler")
    )
    assert ['robust = "mixture" in [curve]' in line for line in normal].count(True) == 1
    assert robust == []
    drifting = gallery.result_of("falling_phone", "speed-squared")["advice"]
    assert not any("mixture" in line for line in drifting)  # a wrong curve is no blunder


def test_a_published_value_has_the_uncertainty_of_its_side() -> None:
    number = {"value": 2.0, "u": [0.2, 0.1]}
    assert gallery.published(number, Quantity(1.0, 0.1)).u == 0.2
    assert gallery.published(number, Quantity(3.0, 0.1)).u == 0.1
    assert gallery.published({"value": 2.0}, Quantity(3.0, 0.1)).u == 0.0


@pytest.mark.statistics
@pytest.mark.parametrize(
    ("step", "place"),
    [
        ("hubble", "through-origin:H"),
        ("filament", "b2"),
        ("falling_phone", "any-power:n"),
        ("muon", "tau"),
    ],
)
def test_the_commands_give_the_numbers_again(
    step: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = value_of(step, place)
    monkeypatch.chdir(gallery.PROJECT)
    CliRunner().invoke(
        cli.cli,
        [*STEPS[step]["command"].split(), "--figures", "none", "--out", str(tmp_path / step)],
    )
    monkeypatch.setattr(gallery, "REPORTS", tmp_path)
    again = value_of(step, place)
    assert abs(again.value - kept.value) < 0.1 * kept.u
    assert again.u == pytest.approx(kept.u, rel=0.1)
