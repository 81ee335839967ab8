"""The two ways to fit a curve, `estim.fit_curve` and `estim fit TABLE --formula`: what one says of
a table, the other says too.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from estim import fit_curve
from estim.campaign.table_campaign import TableChoices, campaign_of_table
from estim.cli.commands import cli
from estim.common import InputError, NumericalError
from estim.fitting import Fit, fit_problem, profile_intervals
from estim.pipeline import sample_curve

SINKING = "y0 - v*x + v*tau*(1 - exp(-x/tau))"


def slowing_ball() -> tuple[np.ndarray, np.ndarray]:
    """A ball that sinks ever slower, where the formula of one released from rest (`SINKING`) fits
    best at the edge tau = 0 of its range.
    """
    x = np.linspace(0.0, 1.6, 50)
    return x, 0.028 - 0.068 * x + 0.004 * x**2 + 1e-4 * np.random.default_rng(1).standard_normal(
        x.size
    )


def test_profiles_end_in_words_where_the_density_falls_off_a_cliff() -> None:
    # beyond tau = 0 the curve is exp(+x/|tau|) in size: differences of the density overflowed in
    # the products that descents make of them
    found = fit_curve(SINKING, *slowing_ball())
    assert abs(found.values["tau"]) < 1e-10
    for interval in profile_intervals(found.fit):
        assert all(np.isfinite([*interval.low.values(), *interval.high.values()]))


# one curve, two writings


def malus(seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    rng = np.random.default_rng(seed)
    truth = {
        "A": rng.uniform(2.0, 8.0),
        "phi": rng.uniform(-80.0, 80.0),
        "c": rng.uniform(0.0, 1.0),
    }
    x = np.linspace(0.0, 360.0, 37)
    return (
        x,
        truth["A"] * np.cos(np.radians(x - truth["phi"])) ** 2
        + truth["c"]
        + 0.1 * rng.standard_normal(x.size),
        truth,
    )


def swing(seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    rng = np.random.default_rng(seed)
    truth = {
        "A": rng.uniform(2.0, 8.0),
        "tau": rng.uniform(5.0, 15.0),
        "w": rng.uniform(3.0, 7.0),
        "p": rng.uniform(-2.9, 2.9),
        "c": 0.3,
    }
    x = np.linspace(0.0, 10.0, 60)
    y = truth["A"] * np.exp(-x / truth["tau"]) * np.cos(truth["w"] * x + truth["p"]) + truth["c"]
    return x, y + 0.1 * rng.standard_normal(x.size), truth


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(k, marks=pytest.mark.statistics) for k in range(2, 8))]
)
def test_malus_and_swings_have_one_solution_with_a_positive_amplitude_and_a_phase_within_a_turn(
    seed: int,
) -> None:
    for formula, data in (
        ("A*cos(pi/180*(x - phi))**2 + c", malus),
        ("A*exp(-x/tau)*cos(w*x + p) + c", swing),
    ):
        x, y, truth = data(seed)
        found = fit_curve(formula, x, y)
        assert found.status == "ok", found.reasons
        for name, value in truth.items():
            assert abs(found.values[name] - value) < 5.0 * found.sds[name]


def test_what_the_user_states_chooses_the_writing() -> None:
    x, y, truth = malus(1)
    formula = "A*cos(pi/180*(x - phi))**2 + c"
    falling = fit_curve(formula, x, y, start={"A": -5.0})
    assert falling.status == "ok"
    assert falling.values["A"] == pytest.approx(-truth["A"], abs=0.3)
    assert falling.values["c"] == pytest.approx(truth["c"] + truth["A"], abs=0.3)
    assert fit_curve(formula, x, y, bounds={"A": (None, 0.0)}).values["A"] == pytest.approx(
        -truth["A"], abs=0.3
    )
    turned = fit_curve(formula, x, y, start={"A": 5.0, "phi": 360.0 + truth["phi"], "c": 0.0})
    assert turned.values["phi"] == pytest.approx(360.0 + truth["phi"], abs=3.0)


def test_a_step_may_be_written_up_or_down() -> None:
    x = np.linspace(-5.0, 5.0, 41)
    y = (
        3.0 / (1.0 + np.exp(-1.3 * (x - 0.4)))
        + 1.0
        + 0.05 * np.random.default_rng(2).standard_normal(x.size)
    )
    found = fit_curve("L/(1 + exp(-k*(x - m))) + c", x, y)
    assert found.status == "ok"
    assert "-L, -k, c + L" in found.message or "-k, -L, c + L" in found.message
    assert found.values["L"] == pytest.approx(3.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_a_period_and_its_alias_are_one_solution_as_a_frequency_and_its_alias_are(
    seed: int,
) -> None:
    """1/T' = 1/dx - 1/T draws the same points.  A flat density in T gives it 1 % of the posterior;
    only in a frequency it was left aside.
    """
    x = np.linspace(0.0, 9.0, 45)
    y = (
        4.0 * np.exp(-x / 6.0) * np.sin(2.0 * np.pi * x / 2.5 + 0.5)
        + 0.1
        + 0.08 * np.random.default_rng(seed).standard_normal(x.size)
    )
    formula = "a*exp(-x/tau)*sin(2*pi*x/T+p)+c"
    found = fit_curve(formula, x, y)
    assert found.status == "ok", found.reasons
    assert abs(found.values["T"] - 2.5) < 4.0 * found.sds["T"]
    assert "curves that vary faster between the points pass through them too (T = " in found.message
    assert "T = 0.22" in found.message
    # a range that was stated to hold both
    assert fit_curve(formula, x, y, bounds={"T": (0.1, 10.0)}).status == "multimodal"


def test_a_solution_with_next_to_nothing_of_the_posterior_is_not_reported() -> None:
    # two values of m draw the same points, one in a well that is 3e5 times as narrow; the start
    # lies in that
    x = np.arange(10.0)
    y = 0.1 * np.random.default_rng(1).standard_normal(10)
    found = fit_curve("(m - 2)*tanh((m + 1)/1e-5) + 0*x", x, y, start={"m": -1.0000001}, u_y=0.1)
    assert found.values["m"] == pytest.approx(2.0, abs=0.2)
    assert found.status == "ok"


# what the data hold, by both doors


def table(folder: Path, x: np.ndarray, y: np.ndarray) -> Path:
    file = folder / "points.csv"
    file.write_text(
        "x,y\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    )
    return file


def by_command(file: Path, formula: str, *, u_y: float | None, low: dict[str, float]) -> Fit:
    """The fit of `estim fit FILE --formula ...`, before it draws."""
    choices = TableChoices(
        formula=formula,
        u_y=None if u_y is None else str(u_y),
        low={name: str(end) for name, end in low.items()},
    )
    campaign = campaign_of_table(file, choices)
    return fit_problem(campaign.problem(campaign.run_names), rng=np.random.default_rng(7))


DECAY, PEAK, SWING = "a*exp(-x/tau) + c", "gaussian + constant", "A*exp(-x/tau)*cos(w*x + p) + c"


def noisy(shape: str, seed: int) -> tuple[str, np.ndarray, np.ndarray, float]:
    """A formula, points, and the standard deviation of their errors."""
    rng = np.random.default_rng(seed)
    if shape == "decay":
        x, u = np.linspace(0.0, 1.0, 20), (0.01, 0.02, 0.03, 0.045, 0.06, 0.08)[seed]
        return DECAY, x, 3.0 * np.exp(-x / 1.5) + 1.0 + u * rng.standard_normal(x.size), u
    if shape == "peak":
        x, u = np.linspace(1.0, 6.0, 6 + seed % 2), 0.3
        return (
            PEAK,
            x,
            1.0 + 10.0 * np.exp(-((x - 3.2) ** 2) / 1.28) + u * rng.standard_normal(x.size),
            u,
        )
    if shape == "malus":
        x, y, _ = malus(seed)
        return "A*cos(pi/180*(x - phi))**2 + c", x, y, 0.1
    if shape == "line":
        x = np.linspace(0.0, 5.0, 8)
        return "a + b*x", x, 1.0 + 2.0 * x + 0.1 * rng.standard_normal(x.size), 0.1
    if shape == "silent":
        x = np.linspace(0.0, 5.0, 12)
        return (
            "a*b*exp(-x/tau)",
            x,
            2.0 * np.exp(-x / 2.0) + 0.05 * rng.standard_normal(x.size),
            0.05,
        )
    if shape == "sinking":
        return SINKING, *slowing_ball(), 1e-4
    x, y, _ = swing(seed)
    return SWING, x, y, 0.1


# ok, refused whatever is stated (decay 5), and refused unless the errors are stated (peak 2)
TABLES = [("decay", 0), ("decay", 5), ("peak", 1), ("peak", 2), ("malus", 0), ("swing", 0)]


@pytest.mark.slow
@pytest.mark.parametrize("stated", [False, True], ids=["unstated", "stated"])
@pytest.mark.parametrize(("shape", "seed"), [*TABLES, ("line", 0), ("silent", 0), ("sinking", 0)])
def test_both_doors_say_the_same_of_a_table(
    shape: str, seed: int, stated: bool, tmp_path: Path
) -> None:
    formula, x, y, u = noisy(shape, seed)
    found = fit_curve(formula, x, y, u_y=u if stated else None)
    # no posterior to draw from: the command names the parameter that needs a limit, and so does the
    # status
    if found.status == "not-identified":
        with pytest.raises(InputError) as refused:
            by_command(table(tmp_path, x, y), formula, u_y=u if stated else None, low={})
        assert refused.value.field is not None
        assert any(refused.value.field in reason for reason in found.reasons), (
            str(refused.value),
            found.reasons,
        )
        return
    fit = by_command(table(tmp_path, x, y), formula, u_y=u if stated else None, low={})
    assert fit.success == (found.status != "not-converged"), found.reasons
    if fit.success:
        values = dict(zip(fit.names, fit.values.tolist(), strict=True))
        for name, value in found.values.items():
            assert abs(values[name] - value) < 1e-3 * found.sds[name]
    else:
        assert fit.mover == "tau"
        assert "shifted tau" in found.reasons[0]
        assert "give it limits" in found.reasons[0]


def test_an_edge_of_what_the_curve_is_defined_for_is_named_by_both_doors(tmp_path: Path) -> None:
    x, y = slowing_ball()
    found = fit_curve(SINKING, x, y, bounds={"tau": (0.0, None)})
    assert found.status == "poor-fit"
    assert "tau lies at its limit 0" in str(found)
    assert by_command(table(tmp_path, x, y), SINKING, u_y=None, low={"tau": 0.0}).at_bound == (
        "tau",
    )


def narrow_peak(seed: int) -> tuple[np.ndarray, np.ndarray]:
    x, rng = np.linspace(1.0, 6.0, 6), np.random.default_rng(seed)
    return x, 1.0 + 10.0 * np.exp(-((x - 3.2) ** 2) / 1.28) + 0.3 * rng.standard_normal(x.size)


def test_a_search_that_runs_away_from_few_points_names_the_parameter_in_both_doors(
    tmp_path: Path,
) -> None:
    """The command said that terms of the formula all but cancel."""
    x, y = narrow_peak(8)
    found = fit_curve("lorentzian + constant", x, y)
    # how far the search runs is decided by rounding
    assert found.status in ("not-converged", "not-identified")
    assert any(re.search("hardly constrain (center|sigma)", reason) for reason in found.reasons)
    with pytest.raises(
        InputError, match=r"'(center|sigma)' is hardly constrained by the data.*give it limits"
    ):
        by_command(table(tmp_path, x, y), "lorentzian + constant", u_y=None, low={})


def test_a_width_of_which_the_points_say_nothing_at_all_ends_in_words(tmp_path: Path) -> None:
    """A peak on one point, whose derivatives are so small that their squares vanish: to divide by
    these overflowed.
    """
    x, y = narrow_peak(30)
    formula = "a*exp(-((x-m)/w)**2)+c"
    assert fit_curve(formula, x, y).status != "ok"
    with pytest.raises(InputError, match=r"give it limits|by limits"):
        by_command(table(tmp_path, x, y), formula, u_y=None, low={})


def test_draws_where_the_curve_is_beyond_all_numbers_have_no_density() -> None:
    """Two decays, one of which grows like exp(x/0.01) in some proposals: their squares overflowed,
    with a warning.
    """
    x = np.linspace(0.0, 9.0, 45)
    y = (
        3.0 * np.exp(-x / 0.8)
        + 2.0 * np.exp(-x / 6.0)
        + 0.08 * np.random.default_rng(2).standard_normal(x.size)
    )
    found = fit_curve("a*exp(-x/t)+b*exp(-x/s)", x, y)
    assert sample_curve(found, seed=2).diagnosis.ok


def test_a_curve_that_has_lost_its_digits_has_not_met_every_point(tmp_path: Path) -> None:
    """Three numbers for an amplitude and a phase: the search ran to p = 8e9, where rounding is as
    large as the noise, and was called perfect.
    """
    x = np.linspace(0.0, 9.0, 45)
    y = (
        np.cos(1.7 * x)
        + 2.0 * np.sin(1.7 * x + 0.5)
        + 0.08 * np.random.default_rng(2).standard_normal(x.size)
    )
    formula = "A*cos(w*x)+B*sin(w*x+p)"
    found = fit_curve(formula, x, y)
    # how far the search runs is decided by rounding
    assert found.status in ("not-converged", "not-identified"), found.message
    assert "every point" not in found.message
    assert re.search("limits|do not determine .* individually", found.reasons[0])
    with pytest.raises(InputError, match="limits"):
        by_command(table(tmp_path, x, y), formula, u_y=None, low={})


def test_a_search_for_what_the_curve_lacks_that_fails_costs_no_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise NumericalError("the fit ends where the curve has no finite derivatives in tau")

    monkeypatch.setattr("estim.pipeline.explain", fails)
    x = np.linspace(0.0, 5.0, 30)
    file = table(tmp_path, x, x**2 + 0.01 * np.random.default_rng(1).standard_normal(x.size))
    told = CliRunner().invoke(
        cli,
        [
            "fit",
            str(file),
            "--formula",
            "a + b*x",
            "--figures",
            "none",
            "--out",
            str(tmp_path / "out"),
        ],
    )
    assert told.exit_code == 3, told.output
    assert "poor-fit" in told.output
    assert "possible missing effects cannot be tested" in told.output
    assert (tmp_path / "out" / "report.md").is_file()


@pytest.mark.slow
def test_a_peak_of_few_points_needs_a_limit_and_has_an_answer_with_one() -> None:
    x = np.linspace(1.0, 6.0, 6)
    y = (
        1.0
        + 10.0 * np.exp(-((x - 3.2) ** 2) / 1.28)
        + 0.3 * np.random.default_rng(2).standard_normal(x.size)
    )
    found = fit_curve(PEAK, x, y)
    assert found.status == "not-identified"
    assert "hardly constrain" in found.reasons[0]
    assert "give it limits" in found.reasons[0]
    limits = {"sigma": (0.0, 3.0), "center": (1.0, 6.0)}
    assert fit_curve(PEAK, x, y, bounds=limits).status == "ok"
    assert fit_curve(PEAK, x, y, u_y=0.3).status == "ok"


@pytest.mark.parametrize(
    ("formula", "x"),
    [("m*x + c", 1.7e9 + np.arange(10.0)), ("a*x^3 + b*x^2 + m*x + c", np.arange(2000.0, 2021.0))],
)
def test_terms_that_rounding_cannot_tell_apart_are_told_by_both_doors(
    tmp_path: Path, formula: str, x: np.ndarray
) -> None:
    """A line against Unix time, a cubic against years: a covariance matrix of their parameters is
    singular in double precision, and was inverted.
    """
    y = 0.3 * (x - x[0]) + 0.1 * np.random.default_rng(1).standard_normal(x.size)
    found = fit_curve(formula, x, y, u_y=0.1)
    assert found.status == "ok"
    assert any("write the formula in x - x0" in note for note in found.notes)
    with pytest.raises(InputError, match=r"all but cancel at these x.*write it in x - x0"):
        by_command(table(tmp_path, x, y), formula, u_y=0.1, low={})


def test_a_time_of_a_swing_many_turns_from_the_data_is_told_to_start_near_them(
    tmp_path: Path,
) -> None:
    """It was said that the data do not show the term: they do, at 19 standard deviations."""
    x = 1000.0 + np.linspace(0.0, 6.0, 30)
    y = 5.0 * np.sin(2.0 * np.pi * (x - 1000.1) / 1.5)
    y += np.random.default_rng(3).standard_normal(x.size)
    formula, start = "A*sin(2*pi*(x-t0)/T)", {"T": 1.5, "t0": 0.0}
    found = fit_curve(formula, x, y, u_y=1.0, start=start)
    assert found.status == "not-identified"
    assert "same after each step of 1." in found.reasons[0]
    assert "start it near the data" in found.reasons[0]
    assert fit_curve(formula, x, y, u_y=1.0, start=start | {"t0": 1000.0}).status == "ok"
    choices = TableChoices(formula=formula, u_y="1", start={"T": "1.5", "t0": "0"})
    campaign = campaign_of_table(table(tmp_path, x, y), choices)
    with pytest.raises(InputError, match=r"'t0' is known to several steps of 1.*start near the"):
        fit_problem(campaign.problem(campaign.run_names), rng=np.random.default_rng(7))
