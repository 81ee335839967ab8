"""Energy: an identity of the physics, and what the check of a run claims against the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from replica_run import heavy_04
from test_noise import CAMPAIGN, SIGMA, campaign_file

from estim.campaign import Campaign, load_campaign
from estim.common import as_json, json_of
from estim.model import Body, trajectory
from estim.model.energy import kinetic_energy, potential_energy
from estim.pipeline import analyse
from estim.reports.energy import summarise_energy
from estim.sampling.chain import Target
from estim.studies.energy import drift_of, energy_along
from estim.verification import estimates

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
    particle = np.array(
        [
            v + 0.15 * omega * np.cos(theta + MOTION["phi"]),
            -0.15 * omega * np.sin(theta + MOTION["phi"]),
        ]
    )
    expected = (
        0.5 * m_d * v**2 + 0.5 * 0.45 * m_d * 0.15**2 * omega**2 + 0.5 * m_p * particle @ particle
    )
    assert kinetic_energy(x, v, BODY, **MOTION) * (m_d + m_p) == pytest.approx(expected, rel=1e-12)


LOSSY = CAMPAIGN.replace(
    "phi_deg = 4.0",
    'phi_deg = 4.0\nrolling_resistance = {prior = "uniform", low = 0.0, high = 0.05}',
)
KNOWN = LOSSY.replace(
    'gamma = {prior = "uniform", low = 0.05, high = 0.40}', "gamma = 0.187"
).replace('kappa = {prior = "uniform", low = 0.0, high = 2.0}', "kappa = 0.45")


def lossy_run(
    folder: Path, c_rr: float, noise: str, text: str, rng: np.random.Generator, *, angular: bool
) -> Campaign:
    """A run that truly loses energy, in metres or in radians."""
    from estim.model import turning_point

    stop = float(turning_point(BODY, **MOTION, rolling_resistance=c_rr))
    t = np.arange(0.01, 3.0, 1.0 / 30.0)
    x = trajectory(t, BODY, **MOTION, rolling_resistance=c_rr, g=9.81)[0][0]
    t, x = t[np.isfinite(x)], x[np.isfinite(x)]
    assert x.max() <= stop
    x = x + SIGMA * rng.standard_normal(x.size)
    rows = "\n".join(f"{a},{b / 0.15 if angular else b}" for a, b in zip(t, x, strict=True))
    (folder / "r.csv").write_text(("t_s,theta_rad\n" if angular else "t_s,x_m\n") + rows + "\n")
    (folder / "c.toml").write_text(text.replace("NOISE", noise))
    return load_campaign(folder / "c.toml")


def test_known_body_and_tilt_give_the_true_loss_in_metres_and_in_radians(tmp_path: Path) -> None:
    """With gamma, kappa and phi known the data determine the loss; a body of angles loses as much
    per metre.
    """
    losses = []
    for angular, noise in (
        (False, "{sigma_x_m = 0.001}"),
        (True, f"{{sigma_theta_rad = {SIGMA / 0.15}}}"),
    ):
        campaign = lossy_run(
            tmp_path, 0.01, noise, KNOWN, np.random.default_rng(4), angular=angular
        )
        analysis = analyse(campaign, ["r"], seed=2, target=Target(ess=500), complete="estim energy")
        (record,) = energy_along(analysis, rng=np.random.default_rng(1))
        drift = drift_of(analysis)
        losses.append(record.loss)
        assert abs(record.loss.value - 0.01 * 9.81 * np.cos(MOTION["phi"])) < 3.0 * record.loss.u
        assert record.loss.u < 0.2 * record.loss.value
        assert drift.determined
        assert drift.p_value < 1e-4
    assert losses[0].value == pytest.approx(losses[1].value, rel=0.01)


@pytest.mark.statistics
def test_no_loss_is_not_found_where_there_is_none(tmp_path: Path) -> None:
    found = []
    for seed in range(3):
        campaign = lossy_run(
            tmp_path, 0.0, "{sigma_x_m = 0.001}", KNOWN, np.random.default_rng(seed), angular=False
        )
        analysis = analyse(campaign, ["r"], seed=2, target=Target(ess=200, max_step=600))
        found.append(drift_of(analysis).p_value)
    assert min(found) > 1e-3
    assert max(found) > 0.1


@pytest.mark.slow
def test_a_loss_that_is_only_its_prior_says_so() -> None:
    drift = drift_of(heavy_04()[1])
    assert drift.free
    assert not drift.determined


@pytest.mark.slow
def test_a_loss_that_was_held_fixed_is_not_tested(tmp_path: Path, rng: np.random.Generator) -> None:
    text = KNOWN.replace(
        'rolling_resistance = {prior = "uniform", low = 0.0, high = 0.05}',
        "rolling_resistance = 0.01",
    )
    campaign = lossy_run(tmp_path, 0.01, "{sigma_x_m = 0.001}", text, rng, angular=False)
    drift = drift_of(analyse(campaign, ["r"], seed=1, target=Target(ess=300, max_step=800)))
    assert not drift.free
    assert not drift.determined


@pytest.mark.slow
def test_relative_change_is_that_of_the_formula(tmp_path: Path, rng: np.random.Generator) -> None:
    campaign = campaign_file(tmp_path, '{sigma_x_m = 0.001, derivative = "central"}', KNOWN)
    (record,) = energy_along(
        analyse(campaign, ["r"], seed=2, target=Target(ess=300, max_step=800)), rng=rng
    )
    start = (
        9.81 * 0.15 * (MOTION["theta0"] * np.sin(MOTION["phi"]) + 0.187 * np.cos(MOTION["theta0"]))
    )
    assert abs(record.start.value - start) < 4.0 * record.start.u
    expected = (record.total - record.start.value) / record.start.value
    assert np.all(np.abs(record.relative - expected) < 4.0 * record.u_relative + 2e-3)
    assert record.mean_relative.value == pytest.approx(record.relative.mean(), abs=1e-9)
    units = {one.name: one.unit for one in estimates(json_of(as_json(summarise_energy(record))))}
    own = {"loss_per_metre": "J/(kg m)", "loss_force": "N"}
    assert len(units) >= 5
    assert units == dict.fromkeys(units, "1") | {name: own[name] for name in own if name in units}
