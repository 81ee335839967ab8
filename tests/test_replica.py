"""The synthetic replica of the paper's campaign: each run fit by itself recovers the truth."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from estim.reports.result import result_of
from estim.studies.reanalysis import Reanalysis

RUNS = [f"heavy-0{i}" for i in (2, 4, 6, 8)] + [f"light-0{i}" for i in (1, 2, 3, 4)]


@pytest.mark.slow
def test_every_run_recovers_its_true_parameters(replica: Path, reanalysed: Reanalysis) -> None:
    truth = tomllib.loads((replica / "truth.toml").read_text())
    assert sorted(reanalysed.single_runs) == RUNS
    for run, analysis in reanalysed.single_runs.items():
        found = result_of(reanalysed.campaign, analysis)
        assert found.status == "ok", run
        for name, parameter in found.parameters.items():
            if parameter.limit is not None:  # a loss that this run alone cannot tell from none
                assert name == "rolling_resistance"
                assert parameter.limit.edge < truth[name] < parameter.limit.limit_95, run
                continue
            assert abs(parameter.mean - truth.get(name, 0.0)) < 3.0 * parameter.sd, (run, name)


def test_rolling_resistance_costs_about_five_percent_of_the_energy(replica: Path) -> None:
    """As the paper saw: relative to E0 = M g R (theta0 sin phi + gamma cos theta0), up to the
    turning point.
    """
    from estim.model import Body, turning_angle

    truth = tomllib.loads((replica / "truth.toml").read_text())
    losses = []
    for run in RUNS:
        gamma, kappa = truth[f"gamma[{run[:5]}]"], truth[f"kappa[{run[:5]}]"]
        phi, theta0, c_rr = (
            truth[f"phi[{run}]"],
            truth[f"theta0[{run}]"],
            truth["rolling_resistance"],
        )
        turned = float(
            turning_angle(
                Body(truth["radius"], gamma, kappa), phi=phi, theta0=theta0, rolling_resistance=c_rr
            )
        )
        losses.append(c_rr * np.cos(phi) * turned / (theta0 * np.sin(phi) + gamma * np.cos(theta0)))
    assert np.mean(losses) == pytest.approx(0.05, abs=0.025)
    assert max(losses) < 0.10
