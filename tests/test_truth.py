"""The recordings of `benchmarks/truth`: a campaign that loads for every disturbance, and the plain motion where there is none."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from estim.campaign import load_campaign
from model import Body, trajectory

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.recordings import BASE, DISTURBANCES, NOISES, PRIORS, SIGMA, write_campaign


def recorded(folder, name, rng, *, priors="default", noise="speeds"):
    truth = write_campaign(folder, DISTURBANCES[name], priors=priors, noise=noise, rng=rng)
    campaign = load_campaign(folder / "campaign.toml")
    columns = campaign.tables["r"].columns
    return truth, campaign, np.asarray(columns["t_s"]), np.asarray(columns["x_m"])


def test_without_a_disturbance_it_is_the_plain_motion_with_white_noise(tmp_path, rng):
    truth, _, t, x = recorded(tmp_path, "none", rng)
    place = {"phi": BASE.phi, "theta0": BASE.theta0, "rolling_resistance": BASE.rolling_resistance, "g": BASE.g}
    errors = x - trajectory(t, Body(BASE.radius, BASE.gamma, BASE.kappa), **place)[0][0]
    assert t.size > 30
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(SIGMA, rel=5.0 / np.sqrt(2 * t.size))
    assert truth["gamma[b]"] == BASE.gamma


@pytest.mark.parametrize("name", DISTURBANCES)
def test_every_disturbance_is_a_campaign_that_changes_something(tmp_path, name):
    truth, campaign, t, x = recorded(tmp_path, name, np.random.default_rng(5), priors="sharp", noise="positions")
    problem = campaign.problem(["r"])
    assert set(truth) <= set(problem.names)
    assert t.size == x.size >= 9
    if name != "none":
        text, table = (tmp_path / "campaign.toml").read_text(), (tmp_path / "run.csv").read_text()
        recorded(tmp_path, "none", np.random.default_rng(5), priors="sharp", noise="positions")
        stated = [line for line in text.splitlines() if "=" in line and "title" not in line]
        plain = [line for line in (tmp_path / "campaign.toml").read_text().splitlines() if "=" in line and "title" not in line]
        assert (table, stated) != ((tmp_path / "run.csv").read_text(), plain)


def test_stated_values_scatter_about_the_true_ones(tmp_path, rng):
    pulls = []
    for priors in PRIORS:
        for _ in range(10):
            truth, campaign, _, _ = recorded(tmp_path, "none", rng, priors=priors, noise=next(iter(NOISES)))
            for parameter in campaign.problem(["r"]).parameters:
                if parameter.name in ("phi[r]", "theta0[r]", "gamma[b]"):
                    pulls.append(parameter.prior.residual(truth[parameter.name]))
    assert np.std(pulls) == pytest.approx(1.0, abs=0.45)  # 5 sd of that of 60 pulls
