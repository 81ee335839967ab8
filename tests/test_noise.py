"""The noise of differentiated positions: what it claims, against brute-force simulation of that
noise.

The simulation shares no code with the likelihood: positions come from the equation of motion by an
ODE solver, get independent normal errors, and are differenced by hand.
"""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estim.campaign import Campaign, load_campaign
from estim.curves.formula import read_formula
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.likelihood import Points
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale
from estim.reading.run import Run

G, RADIUS, GAMMA, KAPPA, PHI, THETA0, SIGMA = (
    9.81,
    0.15,
    0.187,
    0.45,
    np.radians(4.0),
    np.radians(60.0),
    0.001,
)
TRUTH = {"gamma[heavy]": GAMMA, "kappa[heavy]": KAPPA, "theta0[r]": THETA0}

CAMPAIGN = """
title = "one run with known tilt"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
phi_deg = 4.0
[bodies.heavy]
gamma = {prior = "uniform", low = 0.05, high = 0.40}
kappa = {prior = "uniform", low = 0.0, high = 2.0}
[[runs]]
name = "r"
body = "heavy"
file = "r.csv"
theta0_rad = {prior = "uniform", low = 0.6, high = 1.5}
noise = NOISE
"""
DIFFERENTIATED = '{sigma_x_m = 0.001, derivative = "central"}'
INDEPENDENT = f'{{model = "independent", sigma_v_m_s = {SIGMA * 30.0 / np.sqrt(2.0)}}}'


def true_positions(t: np.ndarray) -> np.ndarray:
    """x(t) from the equation of motion: D theta'' = (g/R)(gamma sin theta - sin phi) + gamma
    sin(theta + phi) theta'^2.
    """
    j = (1.0 - GAMMA) * KAPPA + GAMMA

    def rates(_: float, y: np.ndarray) -> list[float]:
        theta, rate = y
        inertia = 1.0 + j + 2.0 * GAMMA * np.cos(theta + PHI)
        force = (
            G / RADIUS * (GAMMA * np.sin(theta) - np.sin(PHI))
            + GAMMA * np.sin(theta + PHI) * rate**2
        )
        return [rate, force / inertia]

    solution = solve_ivp(rates, [0.0, t[-1]], [THETA0, 0.0], t_eval=t, rtol=1e-10, atol=1e-12)
    return np.asarray(RADIUS * (solution.y[0] - THETA0))


TIMES = np.arange(0.5 / 30.0, 1.40, 1.0 / 30.0)
POSITIONS = true_positions(TIMES)


def campaign_file(folder: Path, noise: str, text: str = CAMPAIGN) -> Campaign:
    (folder / "c.toml").write_text(text.replace("NOISE", noise))
    speeds = np.gradient(POSITIONS, TIMES)
    rows = "\n".join(f"{t},{x},{v}" for t, x, v in zip(TIMES, POSITIONS, speeds, strict=True))
    (folder / "r.csv").write_text("t_s,x_m,v_m_s\n" + rows + "\n")
    return load_campaign(folder / "c.toml")


def with_positions(campaign: Campaign, x: np.ndarray) -> Campaign:
    """The campaign with other positions, and the speeds that central differences make of them."""
    run: Run = campaign.tables["r"]
    inner = slice(1, -1)
    v = (x[2:] - x[:-2]) / (TIMES[2:] - TIMES[:-2])
    if campaign.source.runs[0].noise.model == "independent":
        used = x[inner] > 5.0 * SIGMA
        used &= x[inner] < x.max() - 5.0 * SIGMA
        columns = {"t_s": TIMES[inner][used], "x_m": x[inner][used], "v_m_s": v[used]}
    else:
        columns = {"t_s": TIMES, "x_m": x}
    table = replace(run, columns=MappingProxyType(columns), lines=np.arange(columns["x_m"].size))
    return replace(campaign, tables={"r": table})


def repeated_fits(
    campaign: Campaign, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and claimed standard deviations of `n` repetitions of the experiment."""
    fits: list[Fit] = []
    for _ in range(n):
        problem = with_positions(
            campaign, POSITIONS + SIGMA * rng.standard_normal(TIMES.size)
        ).problem(["r"])
        fits.append(fit_least_squares(problem))
    return np.array([f.values for f in fits]), np.sqrt(np.array([np.diag(f.cov) for f in fits]))


def test_independent_points_take_no_square_matrix(rng: np.random.Generator) -> None:
    """At 3000 points one is 72 MB."""
    n = 3000
    noise, curve = (
        Independent(Scale(0.1), Scale(0.2), rng.uniform(1.0, 2.0, n)),
        read_formula("a + b*x"),
    )
    tracemalloc.start()
    named = {"a": 1.0, "b": 2.0}
    likelihood = noise.likelihood(
        Points(curve, np.linspace(0.0, 1.0, n), np.zeros(n), {"a": "a", "b": "b"}), named
    )
    sd, whitened = likelihood.sd(named), likelihood.whitened(named, ("a", "b"))
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert taken < 40 * 8 * n
    np.testing.assert_allclose(sd, np.sqrt(0.01 * noise.relative**2 + 0.04))
    np.testing.assert_allclose(whitened.z, -(1.0 + 2.0 * np.linspace(0.0, 1.0, n)) / sd)


@pytest.mark.statistics
def test_differentiated_noise_claims_the_scatter_that_brute_force_shows(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    n = 500
    campaign = campaign_file(tmp_path, DIFFERENTIATED)
    values, sds = repeated_fits(campaign, n, rng)
    names = campaign.problem(["r"]).names
    truth = np.array([TRUTH[name] for name in names])
    pulls = (values - truth) / sds
    theta0 = names.index("theta0[r]")
    assert np.median(sds[:, theta0]) == pytest.approx(values[:, theta0].std(ddof=1), rel=0.10)
    # unbiased within 3.5 Monte-Carlo errors of the mean, pulls of unit width within 3.5 of theirs
    assert np.all(np.abs(pulls.mean(axis=0)) < 3.5 / np.sqrt(n)), pulls.mean(axis=0)
    assert np.all(np.abs(pulls.std(axis=0) - 1.0) < 3.5 / np.sqrt(2.0 * n)), pulls.std(axis=0)


@pytest.mark.statistics
def test_treating_the_same_speeds_as_independent_misstates_the_scatter(tmp_path: Path) -> None:
    campaign = campaign_file(tmp_path, INDEPENDENT)
    values, sds = repeated_fits(campaign, 200, np.random.default_rng(1))
    theta0 = campaign.problem(["r"]).names.index("theta0[r]")
    claimed, shown = np.median(sds[:, theta0]), values[:, theta0].std(ddof=1)
    assert abs(claimed / shown - 1.0) > 0.10
    # and it wastes data: the exact covariance reaches a smaller scatter on the same positions, 0.85
    # of it; the ratio is uncertain by 0.04, since the estimates are correlated by 0.8
    right = campaign_file(tmp_path, DIFFERENTIATED)
    exact, _ = repeated_fits(right, 200, np.random.default_rng(1))
    assert exact[:, theta0].std(ddof=1) < 0.95 * shown
