"""What the energy report says: a loss is measured only where the data show one, and every report
begins with its status.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from troubles import Disk

from estim.cli.commands import cli
from estim.reports.energy import drift_words, summarise_drift
from estim.studies.energy import Drift

SEEN = Drift(free=True, narrowing=0.48, gain=15.0, p_value=1e-4, limit=0.012)


def test_a_loss_is_called_measured_only_where_the_data_show_one() -> None:
    assert "is measured" in drift_words(summarise_drift(SEEN))
    null = drift_words(summarise_drift(replace(SEEN, gain=0.0, p_value=0.44)))
    assert "is measured" not in null
    assert "consistent with no loss" in null
    assert "c_rr ≤ 0.012 with probability 95 %" in null


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_speeds_of_the_wrong_sign_are_a_poor_fit_and_the_report_says_so_first(
    tmp_path: Path,
) -> None:
    """The curve comes to rest at once: no line of energies, no result, and no traceback."""
    path = Disk(more='rolling_resistance = {prior = "half-normal", scale = 0.005}').write(tmp_path)
    path.write_text(path.read_text().replace("sigma_x_m = 0.001", "sigma_v_m_s = 0.02"))
    t, x = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1).T
    (tmp_path / "r.csv").write_text(
        "x_m,v_m_s\n" + "".join(f"{a},{-b}\n" for a, b in zip(x, np.gradient(x, t), strict=True))
    )
    done = CliRunner().invoke(
        cli, ["energy", str(path), "--out", str(tmp_path / "out"), "--max-steps", "400"]
    )
    assert isinstance(done.exception, SystemExit), done.exception
    assert done.exit_code == 3
    report = (tmp_path / "out" / "report.md").read_text()
    assert report.index("**Status: ") < report.index("- **r: ")
    assert "is measured" not in report


def test_positions_are_told_which_model_the_check_of_the_energy_takes(tmp_path: Path) -> None:
    path = Disk().write(tmp_path)
    path.write_text(
        path.read_text().replace("sigma_x_m = 0.001", 'sigma_x_m = 0.001, model = "positions"')
    )
    done = CliRunner().invoke(cli, ["energy", str(path)])
    assert 'give it a campaign with model = "differentiated"' in str(done.exception)
