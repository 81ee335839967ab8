"""Starts that are led down together: to where each leads alone, in a part of the calls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estim.campaign import load_campaign
from estim.campaign.campaign_file import NoiseTable
from estim.curves.posing import AxisNames, pose_curve
from estim.fitting import least_squares, starts
from estim.fitting.least_squares import fit_least_squares
from estim.fitting.starts import led_together
from estim.problem import Problem
from estim.problem.priors import Prior, Uniform

POSITIONS = NoiseTable(model="positions", sigma_x_m=0.001)


def problem(replica: Path, noise: NoiseTable | None) -> Problem:
    return load_campaign(replica / "campaign.toml").problem(["heavy-04"], noise=noise)


@pytest.mark.parametrize("noise", [POSITIONS, None], ids=["positions", "differentiated"])
def test_starts_lead_together_to_where_they_lead_alone(
    replica: Path, monkeypatch: pytest.MonkeyPatch, noise: NoiseTable | None
) -> None:
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
    np.testing.assert_allclose(
        (together.values - alone.values) / np.sqrt(np.diag(alone.cov)), 0.0, atol=1e-4
    )


def test_heavy_tails_and_single_starts_stay_where_they_are(replica: Path) -> None:
    robust = problem(replica, NoiseTable(model="positions", sigma_x_m=0.001, robust="student-t"))
    two = np.stack([robust.start(), robust.start() * 1.01])
    assert led_together(robust.linearised(two[0]), two) is two
    plain = problem(replica, POSITIONS)
    one = plain.start()[None]
    assert led_together(plain.linearised(one[0]), one) is one


def test_a_flat_place_stands_for_no_start(replica: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the curve does not come near the points a first look is not believed: every start goes
    its own way.
    """
    posed = problem(replica, POSITIONS)
    settled, settle = [], least_squares._settle

    def counted(*args: object, **keywords: object) -> object:
        settled.append(keywords["max_rounds"])
        return settle(*args, **keywords)

    monkeypatch.setattr(least_squares, "_settle", counted)
    monkeypatch.setattr(starts, "_NEAR", 0.0)
    fit_least_squares(posed, rng=np.random.default_rng(1), n_start=3)
    assert settled.count(1) == 3


X = np.arange(12.0)
SCATTER = 0.1 * np.random.default_rng(1).standard_normal(X.size)


def posed(formula: str, y: np.ndarray, parameter: str, prior: Prior, **choices: object) -> Problem:
    """One curve with one parameter; errors of y of 0.1 unless `choices` say more."""
    return pose_curve(
        formula,
        X,
        y,
        start={parameter: prior.centre},
        bounds={},
        priors={parameter: prior},
        cov_y=None,
        errors=(),
        units={},
        axes=AxisNames(),
        **{"u_y": 0.1, "u_x": None, **choices},
    ).with_sigma(1.0)


def test_a_first_look_stands_for_a_search_only_at_the_same_height_and_near_the_points() -> None:
    line = posed("a*x", 2.0 * X + SCATTER, "a", Uniform(0.0, 4.0))
    at = fit_least_squares(line, rng=np.random.default_rng(1), n_start=1)
    assert starts.stands_for(at.posterior, at.values, at.values + 0.5 * at.sds)
    assert not starts.stands_for(at.posterior, at.values, at.values + 1.5 * at.sds)
    # no line passes near points that bend
    bent = posed("a*x", 2.0 * X + 0.1 * X * (X - 11.0), "a", Uniform(0.0, 4.0))
    far = fit_least_squares(bent, rng=np.random.default_rng(1), n_start=1)
    assert not starts.stands_for(far.posterior, far.values, far.values)


def test_starts_are_led_no_farther_than_the_limits() -> None:
    beyond = posed("a*x", 2.0 * X + SCATTER, "a", Uniform(0.0, 1.5))
    led = led_together(beyond.linearised(beyond.start()), np.array([[0.2], [1.0]]))
    assert led == pytest.approx(np.array([[1.5], [1.5]]))


def test_counts_errors_of_x_and_many_runs_stay_where_they_are(replica: Path) -> None:
    counts = posed("a*x", np.round(2.0 * X), "a", Uniform(0.0, 4.0), u_y=None, noise="poisson")
    in_x = posed("a*x", 2.0 * X + SCATTER, "a", Uniform(0.0, 4.0), u_x=0.1)
    runs = load_campaign(replica / "campaign.toml").problem(
        ["heavy-04", "heavy-06"], noise=POSITIONS
    )
    for problem in (counts, in_x, runs):
        two = np.stack([problem.start(), problem.start() * 1.01])
        assert led_together(problem.linearised(two[0]), two) is two


def test_solutions_as_high_as_each_other_stay_apart() -> None:
    """A wave of frequency w at whole numbers is one of 2 pi - w as well."""
    wave = posed("cos(w*x)", np.cos(1.3 * X) + SCATTER, "w", Uniform(0.1, 6.1))
    fit = fit_least_squares(wave, rng=np.random.default_rng(2))
    found = sorted([float(fit.values[0]), *fit.others[:, 0]])
    assert found == pytest.approx([1.3, 2.0 * np.pi - 1.3], abs=0.02)
    assert fit.n_same < fit.n_start
