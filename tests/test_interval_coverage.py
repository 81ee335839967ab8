"""`benchmarks/interval_coverage.py`: cells are taken up where they stopped, a program that is not
installed is left out, and programs that should agree do.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from estim.campaign import as_complete, load_campaign
from estim.fitting import fit_least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import interval_coverage as study
from truth.recordings import DISTURBANCES, write_campaign

BOTH = {"estim", "curve_fit, absolute"}


def without_time(cell: dict) -> dict:
    return {
        name: {key: value for key, value in record.items() if key != "seconds"}
        for name, record in cell.items()
    }


def advanced(folder: Path, sets: int, programs: set[str], seconds: float = 60.0) -> dict:
    cell = (folder, "line", "stated / 2")
    study.advance(*cell, sets=sets, seconds=seconds, programs=programs)
    return study.kept(*cell)


def test_a_cell_is_taken_up_where_it_stopped_and_a_program_that_came_later_catches_up(tmp_path):
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    whole = advanced(tmp_path / "whole", 6, BOTH)
    part = advanced(tmp_path / "parts", 4, {"estim"})
    assert (part["estim"]["n"], part["curve_fit, absolute"]["n"]) == (4, 0)
    assert advanced(tmp_path / "parts", 6, BOTH, seconds=-1.0) == part
    assert without_time(advanced(tmp_path / "parts", 6, BOTH)) == without_time(whole)
    assert whole["estim"]["n"] == whole["curve_fit, absolute"]["n"] == 6
    assert whole["kafe2"]["n"] == 0
    assert whole["estim"]["answers"] < 6  # errors half of what is true are refused


@pytest.mark.slow
def test_a_program_that_is_not_installed_is_left_out_and_the_run_says_so(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(study, "find_spec", lambda package: package != "kafe2" or None)
    monkeypatch.setattr(sys, "argv", ["interval_coverage", "--out", str(tmp_path), "--sets", "0"])
    study.main()
    said = capsys.readouterr().out
    assert "kafe2 is not installed" in said
    assert "lmfit is not" not in said
    assert (tmp_path / "coverage.png").stat().st_size > 0


@pytest.mark.parametrize("program", study.PROGRAMS)
def test_a_line_with_normal_errors_has_the_same_intervals_everywhere(program):
    """All are linear least squares; those that scale by chi-square are wider by its root."""
    if not study.find_spec(study.PROGRAMS[program]):
        pytest.skip(f"{program} is not installed")
    with study.SUBJECTS["line"].make("none", np.random.default_rng(1)) as trial:
        values, ends = trial.by[program]()[1]
        best, stated = trial.by["curve_fit, absolute"]()[1]
    wide = program in ("lmfit", "curve_fit")
    ratio = np.diff(ends["95"]) / np.diff(stated["95"])
    np.testing.assert_allclose(values, best, atol=1e-4)
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=1e-3)
    assert (abs(ratio.mean() - 1.0) > 0.01) == wide
    np.testing.assert_allclose(np.diff(stated["68"])[:, 0] / 2 / 0.994458, trial.ideal, rtol=1e-6)


@pytest.mark.parametrize("name", study.CURVES)
def test_a_curve_has_the_slope_and_the_counts_that_its_entry_states(name):
    curve = study.CURVES[name]
    x = np.linspace(curve.begin, curve.end, 10001)
    rise = np.gradient(curve.f(x, **curve.truth), x)
    assert np.sqrt(np.mean(rise**2)) == pytest.approx(curve.slope, rel=0.06)
    counts = curve.f(x, **curve.counted)
    assert counts.min() > 2.99
    assert 280.0 < counts.max() < 300.01


@pytest.mark.parametrize("name", study.CURVES)
def test_undisturbed_curves_have_the_errors_of_linear_theory_and_estim_fits_the_same_formula(name):
    with study.SUBJECTS[name].make("none", np.random.default_rng(1)) as trial:
        values, ends = trial.by["estim"]()[1]
        best, stated = trial.by["curve_fit, absolute"]()[1]
    np.testing.assert_allclose(values / trial.ideal, best / trial.ideal, atol=0.01)
    for of in (ends, stated):
        np.testing.assert_allclose(np.diff(of["95"])[:, 0] / 2 / 1.959964, trial.ideal, rtol=0.2)


@pytest.mark.statistics
@pytest.mark.parametrize("name", study.CURVES)
def test_undisturbed_intervals_hold_the_truth_as_stated_and_those_of_half_the_error_do_not(
    name, tmp_path
):
    held = {}
    for disturbance in ("none", "stated / 2"):
        cell = (tmp_path, name, disturbance)
        study.advance(*cell, sets=200, seconds=600.0, programs={"curve_fit, absolute"})
        held[disturbance] = study.mean_and_error(study.kept(*cell)["curve_fit, absolute"], "68")
    assert abs(held["none"][0] - 0.68) < 4.0 * held["none"][1]
    assert abs(held["stated / 2"][0] - 0.68) > 4.0 * held["stated / 2"][1]


@pytest.mark.slow
def test_linear_theory_of_the_body_agrees_with_least_squares_of_estim(tmp_path, rng):
    """Which share no code; phi and c_rr are left out, since the half-normal prior of c_rr has no
    one width.
    """
    write_campaign(tmp_path, DISTURBANCES["none"], priors="default", noise="speeds", rng=rng)
    problem = as_complete(load_campaign(tmp_path / "campaign.toml").problem(["r"]), "as simulated")
    sds = np.sqrt(np.diag(fit_least_squares(problem).cov))
    found = [sds[problem.names.index(name)] for name in ("gamma[b]", "kappa[b]", "theta0[r]")]
    np.testing.assert_allclose(study.ideal_of_body()[:3], found, rtol=0.1)


def test_the_body_is_analysed_by_estim_and_lmfit(rng):
    assert set(study.SUBJECTS["rolling body"].programs) == {"estim", "lmfit"}
    with study.SUBJECTS["rolling body"].make("drift", rng) as trial:
        values, ends = trial.by["lmfit"]()[1]
    assert values.shape == trial.truth.shape == trial.ideal.shape
    assert np.all((ends["95"][:, 0] < ends["68"][:, 0]) & (ends["68"][:, 1] < ends["95"][:, 1]))
