"""Numbers beyond all measure, curves without derivatives, data without scatter: one line or a
status, never a traceback or a warning of NumPy.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from troubles import Disk, Formula

from estim import fit_curve
from estim.campaign import load_campaign
from estim.common.errors import InputError, NumericalError
from estim.fitting.least_squares import fit_least_squares
from estim.pipeline import analyse
from estim.sampling.chain import Target

STRAIGHT = Formula("a*x + b", "a = {start = 1.0}\nb = {start = 0.0}", lambda x: 2.0 * x + 1.0)
QUICK = Target(max_step=60)


def scaled_run(folder: Path, factor: float, **choices: str) -> Path:
    """A disk's campaign whose positions are all wrong by one factor."""
    path = Disk(**choices).write(folder)
    head, *rows = (folder / "r.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    (folder / "r.csv").write_text(
        "\n".join([head, *(f"{t},{float(x) * factor!r}" for t, x in cells)]) + "\n"
    )
    return path


def curve(
    folder: Path, expression: str, parameters: str, *, u_y: str = "u_y = 0.02", error: float = 0.02
) -> Path:
    path = Formula(expression, parameters, STRAIGHT.truth, error=error).write(folder)
    path.write_text(path.read_text().replace("u_y = 0.02", u_y))
    return path


@pytest.fixture
def any_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the refusal of speeds that gravity cannot give, which would come first."""
    monkeypatch.setattr("estim.campaign.bodies.check_speeds", lambda *arguments, **named: None)


@pytest.mark.statistics  # half a minute, in which least squares look for an optimum
@pytest.mark.usefixtures("any_speed")
def test_positions_in_a_wrong_unit_end_in_words(tmp_path: Path) -> None:
    """Parameters are pressed against their limits, up to a hundred thousand standard deviations
    from what was stated, log densities as far as -1e30: rounding decides whether a chain can
    begin at all.
    """
    campaign = load_campaign(scaled_run(tmp_path, 1000.0))
    try:
        diagnosis = analyse(campaign, ["r"], seed=1, target=QUICK).diagnosis
    except NumericalError as error:
        assert "density is zero or not finite everywhere around the fit" in str(error)  # noqa: PT017
    else:
        assert diagnosis.status in ("not-converged", "poor-fit")
        assert any("times as far from the curve as" in one for one in diagnosis.reasons)


@pytest.mark.parametrize("sigma", ["1e-200", "1e200"])
def test_a_sigma_beyond_all_measure_is_refused_at_its_line(tmp_path: Path, sigma: str) -> None:
    path = Disk().write(tmp_path)
    path.write_text(path.read_text().replace("sigma_x_m = 0.001", f"sigma_x_m = {sigma}"))
    with pytest.raises(InputError, match=r"campaign\.toml:6: 'sigma_x_m' must be 0 or between"):
        load_campaign(path)


def test_a_reading_beyond_all_measure_is_refused_at_its_line(tmp_path: Path) -> None:
    path = curve(tmp_path, "a*x + b", STRAIGHT.parameters)
    lines = (tmp_path / "r.csv").read_text().splitlines()
    (tmp_path / "r.csv").write_text("\n".join([*lines[:4], "1e150,3.0", *lines[5:]]) + "\n")
    with pytest.raises(InputError, match=r"r\.csv:5: 'x' must be 0 or between"):
        load_campaign(path)


@pytest.mark.parametrize(
    ("expression", "parameters", "blamed"),
    [
        ("a*x + 0*b", "a = {start = 1.0}\nb = {start = 0.0}", "'b' is not determined"),
        ("a*x/b**0", "a = {start = 1.0}\nb = {start = 1.0}", "'b' is not determined"),
        (
            "a*x + b*abs(c)",
            "a = {start = 1.0}\nb = {start = 1.0}\nc = {start = 1.0}",
            "'b' is not determined by the data, nor is 'c'",
        ),
        ("where(x > a, 1, 2)*b", "a = {start = 1.0}\nb = {start = 1.0}", "'a' is not determined"),
    ],
)
def test_the_parameter_that_is_not_determined_is_the_one_named(
    tmp_path: Path, expression: str, parameters: str, blamed: str
) -> None:
    with pytest.raises(InputError, match=blamed):
        analyse(load_campaign(curve(tmp_path, expression, parameters)), ["r"], seed=1, target=QUICK)


def test_errors_of_x_as_large_as_its_range_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"campaign\.toml:8: 'u_x' must be below the standard deviation of x, "
    ):
        load_campaign(curve(tmp_path, "a*x + b", STRAIGHT.parameters, u_y="u_y = 0.02\nu_x = 1e10"))


def test_an_error_of_y_below_its_digits_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"campaign\.toml:7: 'u_y' must be above the last digit"):
        load_campaign(
            curve(tmp_path, "a*x + b", STRAIGHT.parameters, u_y="u_y = 1e-16", error=0.0)
        ).problem(["r"])


def test_points_without_scatter_are_told_as_such(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'u_y' must be stated: the curve meets every point"):
        analyse(
            load_campaign(curve(tmp_path, "a*x + b", STRAIGHT.parameters, u_y="", error=0.0)),
            ["r"],
            seed=1,
            target=QUICK,
        )
    stated = analyse(
        load_campaign(curve(tmp_path, "a*x + b", STRAIGHT.parameters, error=0.0)),
        ["r"],
        seed=1,
        target=QUICK,
    )
    assert [reason for reason in stated.diagnosis.reasons if reason.startswith("run r")] == [
        "run r: all residuals are zero apart from rounding errors, which never happens "
        "with measurements: "
        "were the data computed? (test 'zero', p < 5e-5)"
    ]
    noisy = analyse(
        load_campaign(curve(tmp_path, "a*x + b", STRAIGHT.parameters, u_y="")), ["r"], seed=1
    )
    assert noisy.diagnosis.ok


@pytest.mark.slow
@pytest.mark.usefixtures("any_speed")
def test_positions_in_a_wrong_unit_fit_as_they_are_end_in_a_fit(tmp_path: Path) -> None:
    """Hundreds of times too large."""
    path = scaled_run(tmp_path, 300.0)
    path.write_text(
        path.read_text().replace("sigma_x_m = 0.001", 'sigma_x_m = 0.001, model = "positions"')
    )
    fit = fit_least_squares(load_campaign(path).problem(["r"]))
    assert np.all(np.isfinite(fit.values))
    assert fit.p_value < 1e-6


def test_a_point_on_the_edge_of_where_the_curve_is_defined_does_not_stop_the_fit(
    tmp_path: Path,
) -> None:
    """At the start the curve begins at the first point, with a slope without limit."""
    path = Formula(
        "a*sqrt(x - c)", "a = {start = 1.0}\nc = {start = 0.1}", lambda x: 2.0 * np.sqrt(x - 0.05)
    ).write(tmp_path)
    problem = load_campaign(path).problem(["r"])
    start = np.array([1.0, 0.1])
    with np.errstate(divide="ignore"):
        assert not np.all(np.isfinite(problem.linearised(start).jacobian(start)))
        fit = fit_least_squares(problem, start=start)
    assert np.all(np.abs(fit.values - [2.0, 0.05]) < 4.0 * np.sqrt(np.diag(fit.cov)))


@pytest.mark.parametrize("common", [3e7, 1e8, 1e10])
@pytest.mark.parametrize("u_y", [None, 0.05])
def test_a_curve_beside_a_large_constant_is_found_as_without_it(
    common: float, u_y: float | None
) -> None:
    x = np.arange(40.0)
    y = 3.0 + 5.0 * np.exp(-x / 10.0) + 0.05 * np.random.default_rng(2).standard_normal(40)
    alone, beside = (fit_curve("b + a*exp(-x/tau)", x, at + y, u_y=u_y) for at in (0.0, common))
    assert beside.status == "ok", beside.reasons
    for name in ("a", "tau"):
        # a reading is known to about 2e-16 of the constant
        assert beside.values[name] == pytest.approx(
            alone.values[name], abs=(1e-6 + 1e-13 * common) * alone.sds[name]
        )
        assert beside.sds[name] == pytest.approx(alone.sds[name], rel=1e-5)
