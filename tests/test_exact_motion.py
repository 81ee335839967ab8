"""Positions at known times with an unmodelled force, a free start and errors of scale and clock,
against the exact posterior, which shares no code with the project.
"""

from __future__ import annotations

from pathlib import Path

import exact_motion
import numpy as np
import pytest
from exact_motion import NAMES, SIGMA, G, Posterior, R
from scipy.integrate import solve_ivp
from test_exact_force import CAMPAIGN, GAMMA, KAPPA

from estim.arrays import FloatArray
from estim.campaign import Campaign, load_campaign
from estim.discrepancy.grid import prior_grid
from estim.discrepancy.residuals import Residuals
from estim.pipeline import Analysis, analyse

# gamma, kappa, theta0 and phi of the runs below, by their seeds: `exact_posterior` with n_draw =
# 120,000 and 80,000 and rng = default_rng(2), twenty seconds each
EXACT = {
    21: Posterior(
        np.array([0.176864453, 0.388987760, 1.05284686, 0.0394407969]),
        np.array([0.02386509, 0.24461862, 0.01533176, 0.00532469]),
        0.183915485,
        4781.39834,
    ),
    24: Posterior(
        np.array([0.187147948, 0.377419479, 0.928834636, 0.0655823328]),
        np.array([0.01835636, 0.16658778, 0.01018545, 0.00660507]),
        0.105947806,
        10637.36,
    ),
}

# what these runs are: the sum of their positions (m), and what is stated of theta0 and phi (deg)
RUNS = {21: (7.66075443, 59.56726385, 1.95410296), 24: (22.38687638, 54.76849697, 3.59458137)}


def rolled(seed: int, *, turns: bool, hill: float) -> tuple[FloatArray, FloatArray, float, float]:
    """Positions, 40 a second, and what is stated of theta0 and phi (deg): most of the way out, or
    out and most of the way back, on hills of a height (m), .6 m apart.
    """
    rng, theta0, phi = (
        np.random.default_rng(seed),
        np.radians(55.0 if turns else 60.0),
        np.radians(3.7 if turns else 2.5),
    )
    k, t = 2.0 * np.pi / 0.6, np.arange(1, (90 if turns else 45) + 1) / 40.0

    def moves(_: float, state: FloatArray) -> list[float]:
        u, w = state
        theta, slope = theta0 + u, hill * k * np.cos(k * R * u + 1.0)
        inertia = 1.0 + (1.0 - GAMMA) * KAPPA + GAMMA + 2.0 * GAMMA * np.cos(theta + phi)
        drive = G / R * (GAMMA * np.sin(theta) - np.sin(phi) - slope)
        return [w, (drive + GAMMA * np.sin(theta + phi) * w * w) / inertia]

    path = solve_ivp(moves, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-10, atol=1e-12)
    return (
        t,
        R * path.y[0] + SIGMA * rng.standard_normal(t.size),
        float(np.degrees(theta0) + 1.5 * rng.standard_normal()),
        float(np.degrees(phi) + 0.4 * rng.standard_normal()),
    )


def campaign(folder: Path, t: FloatArray, x: FloatArray, theta0: float, phi: float) -> Campaign:
    (folder / "r.csv").write_text(
        "t_s,x_m\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), x.tolist(), strict=True))
    )
    (folder / "c.toml").write_text(
        CAMPAIGN.replace('"independent", sigma_v_m_s = 0.02', f'"positions", sigma_x_m = {SIGMA}')
        + f'phi_deg = "{phi!r} +/- 0.4"\ntheta0_deg = "{theta0!r} +/- 1.5"\n'
    )
    return load_campaign(folder / "c.toml")


def assert_same(analysis: Analysis, exact: Posterior) -> None:
    """Means within 0.06 standard deviations and these within 5 %, beyond three Monte-Carlo errors
    of the exact answer.
    """
    draws = dict(zip(analysis.fit.names, analysis.chain.flat.T, strict=True))
    error = 3.0 / np.sqrt(exact.n_eff)
    for i, name in enumerate(NAMES[:4]):
        assert abs(draws[name].mean() - exact.mean[i]) < (0.06 + error) * exact.sd[i], name
        assert abs(draws[name].std() / exact.sd[i] - 1.0) < 0.05 + error, name


@pytest.mark.parametrize(("turns", "hill", "seed"), [(False, 0.0, 21), (True, 0.001, 24)])
def test_the_exact_posteriors_are_those_of_these_runs(turns: bool, hill: float, seed: int) -> None:
    """Other random numbers would make others."""
    _, x, theta0, phi = rolled(seed, turns=turns, hill=hill)
    assert (np.sum(x), theta0, phi) == pytest.approx(RUNS[seed], rel=1e-7)


@pytest.mark.statistics
def test_an_exact_posterior_is_found_again_by_fewer_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_motion, "BLOCK", 1000)
    t, x, theta0, phi = rolled(21, turns=False, hill=0.0)
    found = exact_motion.exact_posterior(
        t,
        x,
        theta0=np.radians(theta0),
        phi=np.radians(phi),
        n_draw=20_000,
        rng=np.random.default_rng(3),
    )
    error = 4.0 / np.sqrt(found.n_eff)
    assert found.n_eff > 300.0
    assert np.all(np.abs(found.mean[:4] - EXACT[21].mean) < error * EXACT[21].sd)
    assert found.sd[:4] == pytest.approx(EXACT[21].sd, rel=error)
    assert found.p_force == pytest.approx(EXACT[21].p_force, abs=0.5 * error)


@pytest.mark.statistics
@pytest.mark.parametrize(("turns", "hill", "seed"), [(False, 0.0, 21), (True, 0.001, 24)])
def test_posteriors_of_positions_are_the_exact_ones(
    turns: bool, hill: float, seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert prior_grid.__kwdefaults__ is not None
    monkeypatch.setitem(prior_grid.__kwdefaults__, "scales", (1.0,))  # as in the exact answer
    posed, right = campaign(tmp_path, *rolled(seed, turns=turns, hill=hill)), EXACT[seed]
    found = analyse(posed, ["r"], seed=1)
    assert found.diagnosis.ok
    assert_same(found, right)
    if seed == 21:  # as if force and start did as much to a heavier body
        monkeypatch.setattr(Residuals, "weight", lambda *_: None)
        with pytest.raises(AssertionError, match=r"gamma|kappa"):
            assert_same(analyse(posed, ["r"], seed=1), right)
