"""A zero error that all readings of an angle share is one unknown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_runs import simulated_campaign

from estim.campaign import load_campaign
from estim.common.errors import InputError
from estim.fitting.least_squares import fit_least_squares

OFFSET = 0.8  # degrees, true tilt minus reading
ZERO = 'phi_zero_deg = "0.0(1.0)"'


@pytest.mark.slow
def test_common_offset_of_the_protractor_is_recovered_and_ignoring_it_biases_gamma(
    tmp_path: Path,
) -> None:
    """Eight runs with precise readings off by one offset.  Left out, it drags gamma along."""
    settings = {
        "gammas": [0.187] * 8,
        "stated_gamma": "0.187(30)",
        "offset_deg": OFFSET,
        "u_phi_deg": 0.05,
    }
    fits = []
    for shared in (ZERO, ""):
        campaign = simulated_campaign(
            tmp_path, np.random.default_rng(12), shared=shared, kappa='"0.450(1)"', **settings
        )
        fits.append(fit_least_squares(campaign.problem(campaign.run_names)))
    with_zero, without = fits
    zero, gamma = (with_zero.names.index(name) for name in ("phi_zero", "gamma[b]"))
    sd = np.sqrt(np.diag(with_zero.cov))
    assert abs(np.degrees(with_zero.values[zero]) - OFFSET) < 3.0 * np.degrees(sd[zero])
    assert np.degrees(sd[zero]) < 0.3 * OFFSET
    assert abs(with_zero.values[gamma] - 0.187) < 3.0 * sd[gamma]
    assert with_zero.p_value > 0.01
    # the wrong version
    i = without.names.index("gamma[b]")
    assert abs(without.values[i] - 0.187) > 10.0 * np.sqrt(without.cov[i, i])
    assert without.p_value < 1e-6


@pytest.mark.parametrize(("zero", "angle"), [("phi_zero", "phi"), ("theta0_zero", "theta0")])
def test_curve_moves_with_the_zero_as_with_the_angle(zero: str, angle: str, replica: Path) -> None:
    run = load_campaign(replica / "campaign.toml").problem(["heavy-04"]).runs[0]
    at = {
        "gamma": 0.187,
        "kappa": 0.45,
        "radius": 0.15,
        "rolling_resistance": 0.002,
        "phi": 0.07,
        "theta0": 1.05,
    }
    arguments = dict(run.arguments) | at
    shifted = arguments | {angle: at[angle] + 0.01}
    assert run.curve.value(run.x, arguments | {zero: 0.01}) == pytest.approx(
        run.curve.value(run.x, shifted), rel=1e-12
    )
    assert run.end(arguments | {zero: 0.01}) == pytest.approx(run.end(shifted), rel=1e-12)
    above, below = (run.curve.value(run.x, arguments | {zero: step}) for step in (1e-6, -1e-6))
    assert np.atleast_2d(run.curve.local(run.x, arguments).gradient[zero]) == pytest.approx(
        np.atleast_2d(above - below) / 2e-6, rel=1e-4, abs=1e-6
    )


def test_zero_is_one_unknown_at_its_level_and_absent_if_not_said(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    campaign = simulated_campaign(
        tmp_path, rng, gammas=[0.187] * 2, shared=ZERO + '\ntheta0_zero_rad = "0.00(1)"'
    )
    problem = campaign.problem(campaign.run_names)
    assert {"phi_zero", "theta0_zero", "phi[r0]", "phi[r1]"} <= set(problem.names)
    zero = problem.parameters[problem.names.index("phi_zero")]
    assert zero.prior.sd == pytest.approx(np.radians(1.0))
    assert (zero.label.symbol, zero.label.unit) == ("δφ", "°")
    plain = simulated_campaign(tmp_path, rng, gammas=[0.187] * 2)
    assert "phi_zero" not in plain.problem(plain.run_names).names


def test_zero_said_twice_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="must not stand beside 'phi_zero_deg'"):
        simulated_campaign(tmp_path, rng, gammas=[0.187], shared=ZERO + '\nphi_zero_rad = "0.0(1)"')
