"""Starts that are led down together: to where each leads alone, in a part of the calls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estim.campaign import load_campaign
from estim.campaign.campaign_file import NoiseTable
from estim.fitting import least_squares, starts
from estim.fitting.least_squares import fit_least_squares
from estim.fitting.starts import led_together
from estim.problem import Problem

POSITIONS = NoiseTable(model="positions", sigma_x_m=0.001)


def problem(replica: Path, noise: NoiseTable | None) -> Problem:
    return load_campaign(replica / "campaign.toml").problem(["heavy-04"], noise=noise)


@pytest.mark.parametrize("noise", [POSITIONS, None], ids=["positions", "differentiated"])
def test_starts_lead_together_to_where_they_lead_alone(replica: Path, monkeypatch: pytest.MonkeyPatch, noise: NoiseTable | None) -> None:
    posed, settled, settle = problem(replica, noise), [], least_squares._settle

    def counted(*args: object, **keywords: object) -> object:
        settled.append(keywords["max_rounds"])
        return settle(*args, **keywords)

    monkeypatch.setattr(least_squares, "_settle", counted)
    together = fit_least_squares(posed, rng=np.random.default_rng(1))
    few = settled.count(1)
    settled.clear()
    monkeypatch.setattr(least_squares, "led_together", lambda posterior, starts: starts)
    alone = fit_least_squares(posed, rng=np.random.default_rng(1))
    assert few < settled.count(1) == 8
    assert (together.n_start, together.n_same) == (alone.n_start, alone.n_same) == (8, 8)
    np.testing.assert_allclose((together.values - alone.values) / np.sqrt(np.diag(alone.cov)), 0.0, atol=1e-4)


def test_heavy_tails_and_single_starts_stay_where_they_are(replica: Path) -> None:
    robust = problem(replica, NoiseTable(model="positions", sigma_x_m=0.001, robust="student-t"))
    two = np.stack([robust.start(), robust.start() * 1.01])
    assert led_together(robust.linearised(two[0]), two) is two
    plain = problem(replica, POSITIONS)
    one = plain.start()[None]
    assert led_together(plain.linearised(one[0]), one) is one


def test_a_flat_place_stands_for_no_start(replica: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the curve does not come near the points a first look is not believed: every start goes its own way."""
    posed = problem(replica, POSITIONS)
    settled, settle = [], least_squares._settle

    def counted(*args: object, **keywords: object) -> object:
        settled.append(keywords["max_rounds"])
        return settle(*args, **keywords)

    monkeypatch.setattr(least_squares, "_settle", counted)
    monkeypatch.setattr(starts, "_NEAR", 0.0)
    fit_least_squares(posed, rng=np.random.default_rng(1), n_start=3)
    assert settled.count(1) == 3
