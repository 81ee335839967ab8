"""Errors of length scale and clock of which a campaign says nothing: parameters of the curve with a
small default prior.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estim.arrays import FloatArray
from estim.campaign import Campaign, load_campaign
from estim.pipeline import analyse

G, R, SIGMA = 9.81, 0.15, 0.02
GAMMA, KAPPA, THETA0, PHI = 0.187, 0.45, np.radians(55.0), np.radians(3.7)
CAMPAIGN = """title = "a wheel that turns round"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
noise = {{model = "independent", sigma_v_m_s = 0.02}}
unmodelled_force = 0
{lines}
[bodies.b]
gamma = {{prior = "uniform", low = 0.0, high = 0.5}}
kappa = {{prior = "uniform", low = 0.0, high = 1.0}}
[[runs]]
name = "r"
body = "b"
file = "r.csv"
phi_deg = "3.70(40)"
theta0_deg = "55.0(15)"
"""


def square(
    x: FloatArray, gamma: FloatArray, kappa: FloatArray, theta0: FloatArray, phi: FloatArray
) -> FloatArray:
    """v^2 of the paper's phase curve, written anew."""
    theta, s = theta0 + x / R, np.sin(phi)
    work = gamma * (np.cos(theta0) - np.cos(theta)) - (theta - theta0) * s
    return (
        2.0
        * G
        * R
        * work
        / (1.0 + (1.0 - gamma) * kappa + gamma + 2.0 * gamma * np.cos(theta + phi))
    )


def recorded(folder: Path, lines: str = "") -> tuple[Campaign, FloatArray, FloatArray]:
    """43 independent speeds nearly up to the turning point, where the slope of the curve
    diverges.
    """
    x = np.linspace(0.01, 0.41, 43)
    x = x[square(x, *map(np.array, (GAMMA, KAPPA, THETA0, PHI))) > 0.0]
    v = np.sqrt(
        square(x, *map(np.array, (GAMMA, KAPPA, THETA0, PHI)))
    ) + SIGMA * np.random.default_rng(11).standard_normal(x.size)
    (folder / "r.csv").write_text(
        "x_m,v_m_s\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(x, v, strict=True))
    )
    (folder / "campaign.toml").write_text(CAMPAIGN.format(lines=lines))
    return load_campaign(folder / "campaign.toml"), x, v


@pytest.mark.slow
def test_the_posterior_is_that_of_brute_force(tmp_path: Path) -> None:
    """Importance sampling with the exact density, written in NumPy alone, all six unknowns drawn;
    two seeds give one answer.
    """
    campaign, x, v = recorded(tmp_path)
    first, second = (analyse(campaign, ["r"], seed=seed) for seed in (1, 2))
    names, flat = list(first.fit.names), first.chain.flat
    assert set(names) == {"gamma[b]", "kappa[b]", "theta0[r]", "phi[r]", "scale_x", "scale_t"}
    mean, sd = flat.mean(axis=0), flat.std(axis=0)
    # 4 errors of a difference of means of 5,000 draws
    assert np.max(np.abs(second.chain.flat.mean(axis=0) - mean) / sd) < 0.08
    rng, n, dof = np.random.default_rng(3), 200_000, 5.0
    root = 1.2 * np.linalg.cholesky(np.cov(flat.T))
    normal, spread = rng.standard_normal((n, len(names))), np.sqrt(dof / rng.chisquare(dof, n))
    draws = mean + (normal * spread[:, None]) @ root.T
    log_proposal = (
        -0.5 * (dof + len(names)) * np.log1p(np.sum(np.square(normal), axis=1) * spread**2 / dof)
    )
    column = {name: draws[:, i, None] for i, name in enumerate(names)}
    scale, clock = 1.0 + column["scale_x"], 1.0 + column["scale_t"]
    body = (column["gamma[b]"], column["kappa[b]"], column["theta0[r]"], column["phi[r]"])
    read = np.sqrt(np.maximum(square(x / scale, *body), 0.0)) * scale / clock
    stated = {
        "theta0[r]": (THETA0, np.radians(1.5)),
        "phi[r]": (PHI, np.radians(0.4)),
        "scale_x": (0.0, 0.003),
        "scale_t": (0.0, 0.0005),
    }
    log_density = -0.5 * np.sum(np.square((v - read) / SIGMA), axis=1)
    log_density -= 0.5 * sum(
        np.square((column[name][:, 0] - at) / u) for name, (at, u) in stated.items()
    )
    inside = (draws[:, names.index("gamma[b]")] > 0.0) & (
        np.abs(draws[:, names.index("kappa[b]")] - 0.5) < 0.5
    )
    weights = np.where(
        inside, np.exp(log_density - log_proposal - np.max(log_density - log_proposal)), 0.0
    )
    weights /= weights.sum()
    exact = weights @ draws
    exact_sd = np.sqrt(weights @ np.square(draws - exact))
    assert np.max(np.abs(mean - exact) / exact_sd) < 0.06
    assert np.max(np.abs(sd / exact_sd - 1.0)) < 0.05


def test_the_default_is_a_key_with_that_prior(tmp_path: Path) -> None:
    default = recorded(tmp_path)[0].problem(["r"], usual=True)
    stated = recorded(tmp_path, 'scale_x = "0.0000(30)"\nscale_t = "0.0000(5)"')[0].problem(
        ["r"], usual=True
    )
    assert [(p.name, p.prior.centre, p.prior.sd) for p in default.parameters] == [
        (p.name, p.prior.centre, p.prior.sd) for p in stated.parameters
    ]


@pytest.mark.parametrize(
    ("lines", "left"),
    [
        ("", {"scale_x", "scale_t"}),
        ("scale_x = 0", {"scale_t"}),
        ("scale_x = 0\nscale_t = 0", set()),
        ("scale_t = 0.01", {"scale_x"}),
    ],
)
def test_what_is_said_takes_the_place_of_the_default(
    tmp_path: Path, lines: str, left: set[str]
) -> None:
    problem = recorded(tmp_path, lines)[0].problem(["r"], usual=True)
    assert {"scale_x", "scale_t"} & set(problem.names) == left


def test_angles_of_an_encoder_have_no_length_scale(project: Path) -> None:
    wheel = load_campaign(project / "data" / "wheel" / "campaign.toml")
    assert {"scale_x", "scale_t"} & set(wheel.problem([wheel.run_names[0]], usual=True).names) == {
        "scale_t"
    }


def test_runs_fit_together_share_them(project: Path) -> None:
    replica = load_campaign(project / "data" / "replica" / "campaign.toml")
    assert {"scale_x", "scale_t"} <= set(replica.problem(replica.run_names[:2], usual=True).names)
