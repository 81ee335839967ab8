"""Energy: an identity of the physics, and what the check of a run claims against the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_noise import CAMPAIGN, POSITIONS, SIGMA, TIMES, campaign_file, with_positions

from estim.energy import energy_along
from estim.pipeline import analyse
from estim.sampling import Target
from model import Body, trajectory
from model.energy import kinetic_energy, potential_energy

BODY = Body(radius=0.15, gamma=0.187, kappa=0.45)
MOTION = {"phi": np.radians(4.0), "theta0": np.radians(60.0)}


@pytest.mark.parametrize("c_rr", [0.0, 0.01])
def test_energy_falls_by_the_work_of_the_resistance_and_nothing_else(c_rr: float) -> None:
    x, v = trajectory(np.linspace(0.0, 1.2, 50), BODY, **MOTION, rolling_resistance=c_rr, g=9.81)
    total = kinetic_energy(x, v, BODY, **MOTION) + potential_energy(x, BODY, **MOTION, g=9.81)
    loss = c_rr * 9.81 * np.cos(MOTION["phi"]) * x
    assert np.allclose(total + loss, total[0, 0], rtol=0.0, atol=1e-12)


def test_kinetic_energy_is_that_of_disk_and_particle() -> None:
    """Paper: T = M_D v^2/2 + I omega^2/2 + M_P v_P^2/2 with v_P from the geometry."""
    m_d, x, v = 0.303, 0.2, 0.5
    m_p = m_d * BODY.gamma / (1.0 - BODY.gamma)
    theta = MOTION["theta0"] + x / 0.15
    omega = v / 0.15
    particle = np.array([v + 0.15 * omega * np.cos(theta + MOTION["phi"]), -0.15 * omega * np.sin(theta + MOTION["phi"])])
    expected = 0.5 * m_d * v**2 + 0.5 * 0.45 * m_d * 0.15**2 * omega**2 + 0.5 * m_p * particle @ particle
    assert kinetic_energy(x, v, BODY, **MOTION) * (m_d + m_p) == pytest.approx(expected, rel=1e-12)


LOSSY = CAMPAIGN.replace("phi_deg = 4.0", 'phi_deg = 4.0\nrolling_resistance = {prior = "uniform", low = 0.0, high = 0.05}')
KNOWN = LOSSY.replace('gamma = {prior = "uniform", low = 0.05, high = 0.40}', "gamma = 0.187").replace(
    'kappa = {prior = "uniform", low = 0.0, high = 2.0}', "kappa = 0.45"
)


@pytest.mark.slow
def test_loss_per_metre_is_zero_within_its_uncertainty_where_nothing_is_lost(tmp_path: Path, rng: np.random.Generator) -> None:
    """Twelve repetitions with known body and tilt: the noisy loss scatters as its uncertainty says."""
    campaign = campaign_file(tmp_path, '{sigma_x_m = 0.001, derivative = "central"}', KNOWN)
    scores, steady = [], []
    for _ in range(12):
        noisy = with_positions(campaign, POSITIONS + SIGMA * rng.standard_normal(TIMES.size))
        (record,) = energy_along(analyse(noisy, ["r"], seed=2, target=Target(ess=500)), rng=rng)
        # the prior keeps the fitted resistance above 0, so a true loss of 0 lies in the lower tail
        scores.append(record.loss.value / record.loss.u)
        steady.append(record.steady_p)
    assert np.mean(scores) < 2.0
    assert np.max(scores) < 3.5
    assert np.min(steady) > 1e-3


def test_relative_change_is_that_of_the_formula(tmp_path: Path, rng: np.random.Generator) -> None:
    campaign = campaign_file(tmp_path, '{sigma_x_m = 0.001, derivative = "central"}', KNOWN)
    (record,) = energy_along(analyse(campaign, ["r"], seed=2, target=Target(ess=300, max_step=800)), rng=rng)
    start = 9.81 * 0.15 * (MOTION["theta0"] * np.sin(MOTION["phi"]) + 0.187 * np.cos(MOTION["theta0"]))
    assert abs(record.start.value - start) < 4.0 * record.start.u
    expected = (record.total - record.start.value) / record.start.value
    assert np.all(np.abs(record.relative - expected) < 4.0 * record.u_relative + 2e-3)
    assert record.mean_relative.value == pytest.approx(record.relative.mean(), abs=1e-9)
