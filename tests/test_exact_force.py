"""An unmodelled force, a free start and errors of scale and clock, against the exact posterior,
which shares no code with the project.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exact_force import NAMES, SIGMA, G, Posterior, R, exact_posterior

from estim.arrays import FloatArray
from estim.campaign import Campaign, load_campaign
from estim.discrepancy.grid import prior_grid
from estim.pipeline import Analysis, analyse
from estim.sampling import Target

GAMMA, KAPPA = 0.187, 0.45
CAMPAIGN = """title = "a wheel on a ramp with hills"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
noise = {model = "independent", sigma_v_m_s = 0.02}
[bodies.b]
gamma = {prior = "uniform", low = 0.0, high = 0.5}
kappa = {prior = "uniform", low = 0.0, high = 1.0}
[[runs]]
name = "r"
body = "b"
file = "r.csv"
"""

# with and without a force, of the first of the runs below, by 90,000 draws
BESIDE_A_TURNING_POINT = {
    True: Posterior(
        np.array([0.177741875, 0.415863348, 0.943753821, 0.0629421814]),
        np.array([0.0190257335, 0.197017207, 0.0214459252, 0.0064650052]),
        0.301641117,
        5007.86521,
    ),
    False: Posterior(
        np.array([0.177895364, 0.407022504, 0.946244481, 0.0628494714]),
        np.array([0.0190828098, 0.190882561, 0.0200053259, 0.00646804777]),
        0.0,
        23878.289,
    ),
}


# of the other runs, by their seeds: `exact` with 480,000 draws, half a minute each
OTHERS = {
    12: Posterior(
        np.array([0.205233431, 0.703797345, 1.04172418, 0.0453078765]),
        np.array([0.01963622, 0.22222079, 0.02083258, 0.00612631]),
        0.29336585,
        66827.1858,
    ),
    13: Posterior(
        np.array([0.200971465, 0.569133635, 0.97763824, 0.0681354447]),
        np.array([0.01948314, 0.20091508, 0.02080159, 0.00632083]),
        0.262437076,
        8152.93799,
    ),
    14: Posterior(
        np.array([0.20417664, 0.553663157, 0.938468897, 0.0690603789]),
        np.array([0.01968156, 0.19826272, 0.01991629, 0.00644257]),
        0.274211006,
        29767.672,
    ),
}

# what these runs are: the sum of their speeds (m/s), and what is stated of theta0 and phi (deg)
RUNS = {
    11: (19.60450561, 53.07312883, 3.43535483),
    12: (23.08484402, 59.80679830, 2.73754979),
    13: (19.79233310, 56.11489782, 3.79437990),
    14: (20.16283898, 53.34858230, 3.82926179),
}


def rolled(seed: int, *, turns: bool, hill: float) -> tuple[FloatArray, FloatArray, float, float]:
    """43 speeds and what is stated of theta0 and phi (deg): up to the turning point or 3/4 of the
    way, on hills of a height (m), .6 m apart.
    """
    rng, theta0, phi = (
        np.random.default_rng(seed),
        np.radians(55.0 if turns else 60.0),
        np.radians(3.7 if turns else 2.5),
    )
    k, x = 2.0 * np.pi / 0.6, np.linspace(0.0, 1.5, 150_001)
    theta = theta0 + x / R
    energy = (
        GAMMA * (np.cos(theta0) - np.cos(theta))
        - x / R * np.sin(phi)
        - hill / R * (np.sin(k * x + 1.0) - np.sin(1.0))
    )
    square = (
        2.0
        * G
        * R
        * energy
        / (1.0 + (1.0 - GAMMA) * KAPPA + GAMMA + 2.0 * GAMMA * np.cos(theta + phi))
    )
    end = x[1:][square[1:] <= 0.0][0]
    at = np.linspace(0.01, (0.998 if turns else 0.75) * end, 43)
    v = np.sqrt(np.interp(at, x, np.maximum(square, 0.0))) + SIGMA * rng.standard_normal(43)
    return (
        at,
        v,
        float(np.degrees(theta0) + 1.5 * rng.standard_normal()),
        float(np.degrees(phi) + 0.4 * rng.standard_normal()),
    )


def campaign(folder: Path, x: FloatArray, v: FloatArray, theta0: float, phi: float) -> Campaign:
    (folder / "r.csv").write_text(
        "x_m,v_m_s\n"
        + "".join(f"{a!r},{b!r}\n" for a, b in zip(x.tolist(), v.tolist(), strict=True))
    )
    (folder / "c.toml").write_text(
        CAMPAIGN + f'phi_deg = "{phi!r} +/- 0.4"\ntheta0_deg = "{theta0!r} +/- 1.5"\n'
    )
    return load_campaign(folder / "c.toml")


def assert_same(analysis: Analysis, exact: Posterior, *, mean: float, sd: float) -> None:
    """mean, sd : tolerances in standard deviations and as a share, beyond three Monte-Carlo errors
    of the exact answer.
    """
    draws = dict(zip(analysis.fit.names, analysis.chain.flat.T, strict=True))
    error = 3.0 / np.sqrt(exact.n_eff)
    for i, name in enumerate(NAMES[:4]):
        assert abs(draws[name].mean() - exact.mean[i]) < (mean + error) * exact.sd[i], name
        assert abs(draws[name].std() / exact.sd[i] - 1.0) < sd + error, name


@pytest.mark.parametrize(
    ("turns", "hill", "seed"),
    [(True, 0.0, 11), (False, 0.0, 12), (True, 0.0, 13), (True, 0.001, 14)],
)
def test_the_exact_posteriors_are_those_of_these_runs(turns: bool, hill: float, seed: int) -> None:
    """Other random numbers would make others."""
    _, v, theta0, phi = rolled(seed, turns=turns, hill=hill)
    assert (np.sum(v), theta0, phi) == pytest.approx(RUNS[seed], rel=1e-7)


@pytest.fixture
def noise_of_known_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the exact answer."""
    assert prior_grid.__kwdefaults__ is not None
    monkeypatch.setitem(prior_grid.__kwdefaults__, "scales", (1.0,))


@pytest.mark.slow
@pytest.mark.usefixtures("noise_of_known_size")
def test_the_posterior_beside_a_turning_point_is_the_exact_one(tmp_path: Path) -> None:
    x, v, theta0, phi = rolled(11, turns=True, hill=0.0)
    analysis = analyse(campaign(tmp_path, x, v, theta0, phi), ["r"], seed=1)
    assert analysis.diagnosis.ok
    exact = BESIDE_A_TURNING_POINT[True]
    assert_same(analysis, exact, mean=0.06, sd=0.05)
    assert analysis.fit.forces[0].force.probability == pytest.approx(exact.p_force, abs=0.06)
    with pytest.raises(AssertionError, match=r"kappa|theta0|gamma|phi"):
        assert_same(analysis, BESIDE_A_TURNING_POINT[False], mean=0.06, sd=0.05)


def exact(
    run: tuple[FloatArray, FloatArray, float, float], n_draw: int, *, forced: bool = True
) -> Posterior:
    x, v, theta0, phi = run
    return exact_posterior(
        x,
        v,
        theta0=np.radians(theta0),
        phi=np.radians(phi),
        n_draw=n_draw,
        rng=np.random.default_rng(1),
        forced=forced,
    )


@pytest.mark.statistics
def test_the_exact_posterior_beside_a_turning_point_is_what_is_written_above() -> None:
    found, written = exact(rolled(11, turns=True, hill=0.0), 90_000), BESIDE_A_TURNING_POINT[True]
    assert found.mean[:4] == pytest.approx(written.mean, rel=1e-6)
    assert found.sd[:4] == pytest.approx(written.sd, rel=1e-6)
    assert (found.p_force, found.n_eff) == pytest.approx((written.p_force, written.n_eff), rel=1e-6)
    assert found.n_eff > 2000.0


@pytest.mark.statistics
@pytest.mark.usefixtures("noise_of_known_size")
@pytest.mark.parametrize(
    ("turns", "hill", "seed"),
    [
        (False, 0.0, 12), (True, 0.001, 14),
        pytest.param(True, 0.0, 13, marks=pytest.mark.xfail(
            strict=True, reason="the last speed is two errors from 0: the body may rest there, "
                "which no energy residual knows; 0.12 to 0.14 off",
        )),
    ],
)  # fmt: skip
def test_posteriors_with_turning_points_and_hills_are_the_exact_ones(
    turns: bool, hill: float, seed: int, tmp_path: Path
) -> None:
    posed = campaign(tmp_path, *rolled(seed, turns=turns, hill=hill))
    assert_same(
        analyse(posed, ["r"], seed=1, target=Target(ess=10_000)), OTHERS[seed], mean=0.06, sd=0.05
    )


@pytest.mark.statistics
def test_ten_seeds_give_one_answer(tmp_path: Path) -> None:
    """Their means scatter by Monte-Carlo error, which chi^2 of ten means shows to a factor of
    two.
    """
    x, v, theta0, phi = rolled(11, turns=True, hill=0.0)
    posed = campaign(tmp_path, x, v, theta0, phi)
    found = [analyse(posed, ["r"], seed=seed) for seed in range(10)]
    means = np.array([one.chain.flat.mean(axis=0) for one in found])
    errors = np.array(
        [one.chain.flat.std(axis=0) / np.sqrt(one.diagnosis.ess_bulk) for one in found]
    )
    chi2 = np.sum(np.square((means - means.mean(axis=0)) / errors), axis=0)
    assert np.all(chi2 < 27.9), chi2  # p = 0.001 with 9 degrees of freedom
