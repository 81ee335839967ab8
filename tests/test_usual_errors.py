"""Usual errors of clock and length scale inside the covariance: the same as unknowns with that prior, and told."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from estim.campaign import Campaign, load_campaign
from estim.common.streams import Stream, stream
from estim.deviation import USUAL, WithUsualErrors, read_off
from estim.deviation.usual_errors import usual_errors_of
from estim.fitting.least_squares import Fit, fit_least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.recordings import Camera, Disturbance, write_campaign

SAID = 'scale_x = "0.0000(30)"\nscale_t = "0.0000(5)"\n'
CURVE = ("gamma[b]", "kappa[b]", "theta0[r]", "phi[r]", "rolling_resistance", "radius")


def recorded(folder: Path, lines: str = "", *, noise: str = "speeds", scale: float = 0.003) -> Campaign:
    write_campaign(folder, Disturbance("s", camera=Camera(scale_x=scale)), priors="sharp", noise=noise, rng=np.random.default_rng(4))
    path = folder / "campaign.toml"
    force = "unmodelled_force = 0\n" if noise == "speeds" else ""
    path.write_text(path.read_text().replace("[shared]\n", f"[shared]\n{force}{lines}"))
    return load_campaign(path)


def fitted(campaign: Campaign) -> Fit:
    problem = campaign.with_usual_errors(campaign.problem(["r"]))
    return fit_least_squares(problem, rng=stream(1, Stream.FIT), n_start=1)


@pytest.mark.parametrize("noise", ["speeds", "positions"])
def test_the_covariance_holds_what_sampled_unknowns_would_do(tmp_path: Path, noise: str) -> None:
    """Against the keys with the same priors: modes, standard deviations, and what is read off of the errors themselves; without them it differs."""
    inside, sampled, without = (fitted(recorded(tmp_path, lines, noise=noise)) for lines in ("", SAID, "scale_x = 0\nscale_t = 0\n"))
    assert inside.names == without.names
    assert set(sampled.names) - set(inside.names) == {"scale_x", "scale_t"}
    pairs = [(inside.names.index(name), sampled.names.index(name)) for name in CURVE]
    ours, theirs = np.array(pairs).T
    sds = np.sqrt(np.diag(sampled.cov))[theirs]
    assert np.max(np.abs(inside.values[ours] - sampled.values[theirs]) / sds) < 0.1  # first order, beside an edge
    assert np.sqrt(np.diag(inside.cov))[ours] == pytest.approx(sds, rel=0.05)
    resistance = CURVE.index("rolling_resistance")
    assert np.sqrt(np.diag(without.cov))[ours][resistance] < 0.9 * sds[resistance]
    found = {one.name: one for one in read_off(inside.posterior, inside.values, inside.cov)}
    for name, key in (("length", "scale_x"), ("clock", "scale_t")):
        i = sampled.names.index(key)
        assert found[name].prior_sd == USUAL[name]
        assert found[name].mean == pytest.approx(sampled.values[i], abs=0.1 * USUAL[name])
        assert found[name].sd == pytest.approx(sampled.sds[i], rel=0.1)


def test_what_is_said_takes_the_place_of_the_default(tmp_path: Path) -> None:
    for lines, left in (("", {"length", "clock"}), ("scale_x = 0\n", {"clock"}), ('scale_t = "0.000(1)"\n', {"length"}), (SAID, set())):
        campaign = recorded(tmp_path, lines)
        problem = campaign.problem(["r"])
        with_errors = campaign.with_usual_errors(problem)
        noise = usual_errors_of(with_errors.runs[0].noise)
        assert (set() if noise is None else set(noise.sds)) == left
        assert with_errors.runs[0].curve is problem.runs[0].curve  # the curve itself is as it was


def test_angles_of_an_encoder_have_no_scale_and_an_inferred_noise_none_of_either(project: Path) -> None:
    wheel = load_campaign(project / "data" / "wheel" / "campaign.toml")
    name = wheel.run_names[0]
    problem = wheel.problem([name])
    noise = wheel.with_usual_errors(problem).runs[0].noise
    inferred = bool(problem.runs[0].noise.parameters)
    assert isinstance(noise, WithUsualErrors) != inferred
    assert inferred or set(noise.sds) == {"clock"}


def test_runs_fit_together_have_none(project: Path) -> None:
    replica = load_campaign(project / "data" / "replica" / "campaign.toml")
    problem = replica.problem(replica.run_names[:2])
    assert replica.with_usual_errors(problem) is problem
