"""What `estim line` says of series with one trouble each, and what it keeps to itself where the
status is not ok.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from estim.cli.commands import cli
from estim.verification import estimates

pytestmark = pytest.mark.usefixtures("undrawn", "few_draws")
PHI = np.arange(1.0, 9.0)
RISING = np.degrees(np.arcsin(np.sin(np.radians(PHI)) / 0.187 + 0.01))
SCATTERED = RISING + np.array([0, 3, -3, 3, -3, 3, -3, 3])


def line(
    folder: Path,
    phi: np.ndarray,
    theta: np.ndarray,
    *,
    u: tuple[float, float] = (0.4, 1.5),
    gamma: str = "0.187(10)",
) -> tuple[Result, str, dict]:
    """`estim line` on pairs of angles with uncertainties u: what it printed, its report and its
    result.
    """
    (folder / "c.toml").write_text(
        'title = "T"\nkind = "synthetic"\n[bodies.heavy]\nradius_m = 0.15\ngamma = '
        f'"{gamma}"\nkappa = 0.45\n[line]\nfile = "l.csv"\nbody = "heavy"\n'
    )
    rows = "".join(f"{a:.4f},{b:.4f},{u[0]},{u[1]}\n" for a, b in zip(phi, theta, strict=True))
    (folder / "l.csv").write_text("phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n" + rows)
    done = CliRunner().invoke(cli, ["line", str(folder / "c.toml"), "--out", str(folder / "out")])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return (
        done,
        (folder / "out" / "report.md").read_text().replace("\u00a0", " "),
        json.loads((folder / "out" / "result.json").read_text()),
    )


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, str, dict]:
    return line(tmp_path_factory.mktemp("good"), PHI, RISING, u=(0.1, 0.5))


def test_every_estimate_of_a_line_has_its_unit(good: tuple[Result, str, dict]) -> None:
    units = {one.name: one.unit for one in estimates(good[2])}
    assert units["steepest_phi"] == units["above_theory.excess"] == "rad"
    assert set(units.values()) == {"1", "rad"}


def test_points_on_a_line_though_their_uncertainties_are_large_are_sampled(tmp_path: Path) -> None:
    """Three points whose exact 95 % interval of the slope is [2.2, 9.4]: known badly, but known."""
    done, _, result = line(tmp_path, PHI[:3], RISING[:3])
    assert done.exit_code == 0
    low, high = result["slope_interval"]
    assert result["posterior"]["gamma"]["q025"] == pytest.approx(1.0 / high, rel=0.4)
    assert low > 0.0


def test_a_body_that_always_ascends_has_no_gamma(tmp_path: Path) -> None:
    done, report, result = line(tmp_path, PHI, np.zeros(8))
    assert (done.exit_code, result["status"]) == (3, "not-identified")
    assert "do not determine a rising line" in report


def test_swapped_columns_are_suspected(tmp_path: Path) -> None:
    done, report, result = line(tmp_path, RISING, PHI, u=(0.5, 0.1))
    assert (done.exit_code, result["status"]) == (3, "poor-fit")
    assert "gamma below 1" in done.output
    assert "are the columns phi_deg and theta_min_deg swapped" in report


def test_a_stated_gamma_that_the_line_contradicts_is_said_at_once(
    good: tuple[Result, str, dict], tmp_path: Path
) -> None:
    done, report, result = line(tmp_path, PHI, RISING, u=(0.1, 0.5), gamma="0.400(1)")
    assert (done.exit_code, result["status"]) == (0, "ok")
    assert "disagree: E_n = −" in done.output
    assert report.index("disagree: E_n = −") < report.index("## Result")
    agreeing, report, _ = good
    assert "disagree" not in agreeing.output + report


def test_a_poor_line_gives_limits_and_nothing_else(
    good: tuple[Result, str, dict], tmp_path: Path
) -> None:
    done, report, result = line(tmp_path, PHI, SCATTERED, u=(0.1, 0.5))
    assert (done.exit_code, result["status"]) == (3, "poor-fit")
    assert "±" not in report.replace("γ of heavy as stated is 0.187 ± 0.010", "")
    for word in ("E_n", "Bayes factor", "bands of the Bayesian line", "- What to do"):
        assert word not in report
    assert "What to do:\n\n- check the uncertainties" in report
    assert "95 % of the posterior" in report
    assert result["posterior"]["gamma"]["sd"] is None
    assert all(
        row["gamma"] is None and not row["standard_errors"] for row in result["methods"].values()
    )
    done, report, _ = good
    assert done.exit_code == 0
    assert all(
        word in report
        for word in ("E_n", "Bayes factor", "bands of the Bayesian line", "level of Student's t")
    )
