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
from scipy import constants
from scipy.optimize import curve_fit, least_squares
from scipy.stats import poisson

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import gallery

from estim.campaign import load_campaign
from estim.cli import commands as cli
from estim.common.quantity_text import Quantity

pytestmark = pytest.mark.usefixtures("reports")
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
    particles, intervals = columns("alpha_counts_1910.csv", 0, 1)
    assert (intervals.sum(), particles @ intervals) == (2608, 10097)
    time = columns("newcomb_1882.csv", 1)
    assert (time.size, round(time[time > 24.76].mean(), 5)) == (66, 24.82729)
    assert columns("forbes_1857.csv", 0).size == 17
    assert columns("51_pegasi_harps.csv", 0).size == 90


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


def clear_of(place: tuple[str, str], by_hand: float, other: float, within: float = 0.2) -> Quantity:
    """The result, which is the one by hand within some standard uncertainties, and not the one of
    a wrong analysis.
    """
    value = value_of(*place)
    assert abs(value.value - by_hand) < within * value.u, place
    assert abs(value.value - other) > 2.0 * within * value.u, place
    return value


def test_alpha_particles_and_passage_times_by_hand() -> None:
    particles, intervals = columns("alpha_counts_1910.csv", 0, 1)
    full = intervals > 0
    (naive,), _ = curve_fit(
        lambda k, m: 2608.0 * poisson.pmf(k, m),
        particles[full],
        intervals[full],
        [4.0],
        sigma=np.sqrt(intervals[full]),
    )
    assert round(naive, 3) == 3.854  # least squares, as gallery.toml says
    mean = clear_of(("alpha_counts", "m"), 10097 / 2608, naive)
    assert mean.u == pytest.approx(np.sqrt(10097) / 2608, rel=0.05)
    time = columns("newcomb_1882.csv", 1)
    good = time[time > 24.8]
    passage = clear_of(("newcomb", "robust:tau"), good.mean(), time.mean())
    assert passage.u == pytest.approx(good.std(ddof=1) / np.sqrt(good.size), rel=0.1)
    assert good.mean() - time[time > 24.76].mean() < passage.u
    assert -9.0 < (passage.value - 24.83302) / passage.u < -7.5
    off = (good.mean() - np.sort(time)[:2]) / good.std(ddof=1)
    assert list(np.round(off)) == [14.0, 6.0]


def test_boiling_points_by_hand() -> None:
    """ln p is a straight line in 1/T; here with errors of ln p, which the curve turns into errors
    of T: nearly the same, because the line is steep and short.
    """
    pressure, fahrenheit = columns("forbes_1857.csv", 0, 1)
    inverse = 1.0 / ((fahrenheit - 32.0) / 1.8 + 273.15)
    good = np.arange(17) != 11

    def line(which: np.ndarray) -> tuple[float, float]:
        slope, level = np.polyfit(inverse[which], np.log(pressure[which] / 29.9213), 1)
        return -slope * constants.R / 1000.0, -slope / level - 273.15

    (latent, boiling), (spoiled, too_low) = line(good), line(np.ones(17, dtype=bool))
    slope = clear_of(("forbes", "robust:L"), latent, spoiled, 0.3)
    clear_of(("forbes", "robust:T0"), boiling, too_low, 0.3)
    ohio = np.log(0.08461 / 0.07018) / (1.0 / 363.15 - 1.0 / 368.15)
    assert round(ohio * constants.R / 1000.0, 2) == 41.57
    assert round(2256.66 * 0.01801528, 2) == 40.65
    assert slope.value - 40.65 > 4.0 * slope.u
    (run,) = gallery.result_of("forbes", "robust")["runs"].values()
    assert [point["row"] for point in run["outliers"]] == [12]


def refraction(wavenumber: np.ndarray) -> np.ndarray:
    """Ciddor (1996), equation 1: the refractive index of dry air at 15 °C; wavenumbers in 1/cm."""
    squared = (wavenumber * 1e-4) ** 2
    return np.asarray(
        1.0 + 0.05792105 / (238.0185 - squared) + 0.00167917 / (57.362 - squared), dtype=float
    )


def test_hydrogen_by_a_straight_line() -> None:
    """1/λ against 1/4 - 1/n² in closed form: air is taken out of the wavelengths, not put in."""
    n, air, u = columns("balmer.csv", 0, 1, 2)
    bohr = 0.25 - 1.0 / n**2
    wavenumber = 1e7 / air
    for _ in range(5):
        wavenumber = 1e7 / (air * refraction(wavenumber))
    weight = 1.0 / (u * wavenumber**2 / 1e7) ** 2  # u(1/λ) = u(λ)/λ²

    def through_origin(y: np.ndarray) -> float:
        return float((weight * bohr) @ y / ((weight * bohr) @ bohr))

    slope, shift = np.polyfit(bohr, wavenumber, 1, w=np.sqrt(weight))
    rydberg, ratio = constants.Rydberg / 100.0, constants.m_e / constants.m_p
    for place, by_hand, other in (
        ("as-if-in-vacuum:R", through_origin(1e7 / air), through_origin(wavenumber)),
        ("bohr:R", through_origin(wavenumber), slope),
        ("with-fine-structure:R", slope, through_origin(wavenumber)),
        ("with-fine-structure:d", shift, 0.0),
        ("with-fine-structure:R_inf", slope * (1.0 + ratio), slope),
    ):
        clear_of(("balmer", place), by_hand, other, 0.1)
    assert rydberg / (1.0 + ratio) == pytest.approx(109677.5834, abs=1e-3)
    levels = [constants.alpha**2 * rydberg * (2.0 / (j + 0.5) - 0.75) / 16.0 for j in (1.5, 0.5)]
    assert [round(level, 2) for level in levels] == [0.09, 0.46]
    high, forgotten = (value_of("balmer", f"{run}:R") for run in ("bohr", "as-if-in-vacuum"))
    assert 14.0 < (high.value - rydberg / (1.0 + ratio)) / high.u < 16.0
    assert forgotten.value - high.value > 300.0 * high.u
    assert value_of("balmer", "with-fine-structure:R").u == pytest.approx(10.0 * high.u, rel=0.1)


def test_the_planet_by_generalised_least_squares() -> None:
    """Errors that follow each other, exp(-|t - t'|/length), their size and length summed over on a
    grid (flat in the logarithms), the four parameters of the orbit by Laplace's approximation.
    Another prior than that of estim: half a standard uncertainty.
    """
    days, speed, u = columns("51_pegasi_harps.csv", 0, 1, 2)
    gap = np.abs(days[:, None] - days)

    def orbit(p: np.ndarray) -> np.ndarray:
        return np.asarray(p[0] - p[1] * np.sin(2.0 * np.pi * (days - p[2]) / p[3]))

    def fitted(cov: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        root = np.linalg.cholesky(cov)
        fit = least_squares(
            lambda p: np.linalg.solve(root, speed - orbit(p)),
            [-33152.5, 56.0, 0.4, 4.2295],
            x_scale=[1.0, 1.0, 0.01, 0.001],
        )
        information = fit.jac.T @ fit.jac
        log_weight = (
            -fit.cost - np.log(np.diag(root)).sum() - 0.5 * np.linalg.slogdet(information)[1]
        )
        return log_weight, fit.x, np.diag(np.linalg.inv(information))

    found = [
        fitted(np.diag(u**2) + size**2 * np.exp(-gap / length))
        for length in np.geomspace(0.01, 1.3, 8)
        for size in np.geomspace(0.3, 3.0, 7)
    ]
    log_weight, values, variances = (np.array(part) for part in zip(*found, strict=True))
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ values
    sd = np.sqrt(weight @ (variances + (values - mean) ** 2))
    _, naive, naive_variance = fitted(np.diag(u**2))
    for place, k in (("K", 1), ("P", 3)):
        value = value_of("51_pegasi", f"correlated:{place}")
        assert abs(value.value - mean[k]) < 0.5 * value.u
        assert value.u == pytest.approx(sd[k], rel=0.35)
        assert np.sqrt(naive_variance[k]) < 0.3 * value.u  # independent errors
    assert (round(naive[3], 4), round(np.sqrt(naive_variance[3]), 4)) == (4.2295, 0.0002)
    assert 6.0 < (4.230785 - naive[3]) / np.sqrt(naive_variance[3]) < 7.0


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
            ("newcomb", "normal:tau"),
            ("forbes", "normal:T0"),
            ("51_pegasi", "stated-errors:K"),
            ("51_pegasi", "jitter:K"),
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
    (run,) = gallery.result_of("newcomb", "robust")["runs"].values()
    assert [point["row"] for point in run["outliers"]] == [6, 10]
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
    assert ["robust: mixture" in line for line in normal].count(True) == 1
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
        ("alpha_counts", "m"),
        ("newcomb", "robust:tau"),
        ("balmer", "with-fine-structure:R"),
        ("forbes", "robust:L"),
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
