"""The posterior mode and its covariance against independent answers."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit

from estim import fit_curve
from estim.arrays import FloatArray
from estim.campaign import load_campaign
from estim.fitting import least_squares
from estim.fitting.gauss_newton import step_between
from estim.fitting.least_squares import fit_least_squares
from estim.fitting.profile_search import search_of
from estim.pipeline import analyse
from estim.problem import Posterior
from estim.sampling.chain import Target

HEAD = """
title = "a line of code away from a hand calculation"
kind = "synthetic"
[shared]
g = 9.81
scale_x = 0.0
scale_t = 0.0
phi_deg = -5.5
theta0_deg = 5.5
[bodies.b]
radius_m = 0.235
gamma = GAMMA
kappa = KAPPA
[[runs]]
name = "r"
body = "b"
file = "r.csv"
rolling_resistance = RESISTANCE
noise = NOISE
"""


def write(folder: Path, rows: str, **words: str) -> Path:
    text = HEAD
    for key, word in ({"GAMMA": "0.0", "KAPPA": "0.75", "RESISTANCE": "0.0"} | words).items():
        text = text.replace(key, word)
    (folder / "c.toml").write_text(text)
    (folder / "r.csv").write_text(rows)
    return folder / "c.toml"


def balanced_rows(
    rng: np.random.Generator, *, c_rr: float, sigma: float, n: int = 40
) -> tuple[str, np.ndarray, np.ndarray]:
    """Speeds of a balanced wheel, v^2 = 2 g x sin(...)/(1 + kappa), with independent errors."""
    x = np.linspace(0.3, 3.0, n)
    v = np.sqrt(2.0 * 9.81 * x * (np.sin(np.radians(5.5)) - c_rr * np.cos(np.radians(5.5))) / 1.75)
    v = v + sigma * rng.standard_normal(n)
    return "x_m,v_m_s\n" + "\n".join(f"{a},{b}" for a, b in zip(x, v, strict=True)), x, v


def test_mode_and_sd_of_one_parameter_are_those_of_the_linear_formula(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    sigma, prior_sd = 0.01, 0.02
    rows, x, v = balanced_rows(rng, c_rr=0.03, sigma=sigma)
    path = write(
        tmp_path,
        rows,
        RESISTANCE='{prior = "normal", mean = 0.02, sd = 0.02}',
        NOISE='{model = "independent", sigma_v_m_s = 0.01}',
    )
    fit = fit_least_squares(load_campaign(path).problem(["r"]))

    def minus_log(c: np.ndarray) -> float:
        model = np.sqrt(
            2.0 * 9.81 * x * (np.sin(np.radians(5.5)) - c[0] * np.cos(np.radians(5.5))) / 1.75
        )
        return float(
            0.5 * np.sum((v - model) ** 2) / sigma**2 + 0.5 * ((c[0] - 0.02) / prior_sd) ** 2
        )

    best = minimize(
        minus_log, [0.03], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-10}
    )
    step = 1e-4
    curvature = (minus_log(best.x + step) - 2.0 * best.fun + minus_log(best.x - step)) / step**2
    assert fit.values[0] == pytest.approx(best.x[0], abs=1e-7)
    assert fit.sds[0] == pytest.approx(curvature**-0.5, rel=0.02)
    assert fit.chi2 == pytest.approx(2.0 * best.fun, rel=1e-6)
    assert fit.dof == 40


def test_stated_sigmas_are_kept_however_small_chi2_is(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """lmfit would rescale them by chi2/dof unless told not to."""
    rows, *_ = balanced_rows(rng, c_rr=0.03, sigma=0.001)
    noise = '{model = "independent", sigma_v_m_s = SIGMA}'
    sds = []
    for sigma in ("0.01", "0.02"):
        path = write(
            tmp_path,
            rows,
            RESISTANCE='{prior = "uniform", low = 0.0, high = 0.09}',
            NOISE=noise.replace("SIGMA", sigma),
        )
        sds.append(fit_least_squares(load_campaign(path).problem(["r"])).sds[0])
    assert sds[1] / sds[0] == pytest.approx(2.0, rel=1e-3)


def test_parameter_at_its_bound_gets_no_symmetric_sd(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows, *_ = balanced_rows(rng, c_rr=0.03, sigma=0.01)
    path = write(
        tmp_path,
        rows,
        RESISTANCE='{prior = "uniform", low = 0.05, high = 0.09}',
        NOISE='{model = "independent", sigma_v_m_s = 0.01}',
    )
    fit = fit_least_squares(load_campaign(path).problem(["r"]))
    assert fit.at_bound == ("rolling_resistance[r]",)
    assert np.isnan(fit.sds[0])


def test_inferred_sigma_is_the_rms_of_the_residuals(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    rows, x, v = balanced_rows(rng, c_rr=0.0, sigma=0.02, n=60)
    noise = '{model = "independent", sigma_v_m_s = {prior = "uniform", low = 0.0, high = 1.0}}'
    fit = fit_least_squares(load_campaign(write(tmp_path, rows, NOISE=noise)).problem(["r"]))
    rms = np.sqrt(np.mean((v - np.sqrt(2.0 * 9.81 * x * np.sin(np.radians(5.5)) / 1.75)) ** 2))
    assert fit.values[0] == pytest.approx(rms, rel=1e-5)
    assert np.sqrt(fit.cov[0, 0]) == pytest.approx(rms / np.sqrt(2 * 60), rel=1e-4)


@pytest.mark.slow
def test_posterior_agrees_with_brute_force_quadrature(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Two parameters, one of them the noise: means and sds by summing over a grid."""
    rows, x, v = balanced_rows(rng, c_rr=0.03, sigma=0.02)
    noise = '{model = "independent", sigma_v_m_s = {prior = "half-normal", scale = 0.05}}'
    path = write(tmp_path, rows, RESISTANCE='{prior = "half-normal", scale = 0.05}', NOISE=noise)
    analysis = analyse(load_campaign(path), ["r"], seed=3, target=Target(ess=20_000))
    c, s = np.meshgrid(np.linspace(0.0, 0.08, 801), np.linspace(0.008, 0.06, 801), indexing="ij")
    square = np.zeros_like(c)
    for xi, vi in zip(x, v, strict=True):
        square += (
            vi
            - np.sqrt(
                2.0 * 9.81 * xi * (np.sin(np.radians(5.5)) - c * np.cos(np.radians(5.5))) / 1.75
            )
        ) ** 2
    log_p = (
        -0.5 * square / s**2 - x.size * np.log(s) - 0.5 * (c / 0.05) ** 2 - 0.5 * (s / 0.05) ** 2
    )
    weight = np.exp(log_p - log_p.max())
    weight /= weight.sum()
    for i, grid in enumerate((c, s)):
        mean = np.sum(weight * grid)
        sd = np.sqrt(np.sum(weight * (grid - mean) ** 2))
        draws = analysis.chain.flat[:, i]
        n_eff = analysis.diagnosis.ess_bulk[i]
        assert abs(draws.mean() - mean) < 4.0 * sd / np.sqrt(n_eff)
        assert abs(draws.std() / sd - 1.0) < 4.0 * np.sqrt(1.0 / n_eff)


def test_mode_of_the_replica_run_maximises_the_posterior(
    replica: Path, rng: np.random.Generator
) -> None:
    """At the reported mode no direction leads uphill."""
    fit = fit_least_squares(load_campaign(replica / "campaign.toml").problem(["heavy-04"]))
    assert fit.success
    best = fit.posterior.log_density(fit.values[None])[0]
    around = (
        fit.values
        + 0.05 * rng.standard_normal((500, fit.values.size)) @ np.linalg.cholesky(fit.cov).T
    )
    assert np.max(fit.posterior.log_density(around)) < best + 1e-4


class Following:
    """In place of a posterior whose covariance follows the curve, and of its problem: where a round
    leads from each place.
    """

    groups = ((0,),)

    def __init__(
        self, leads: Callable[[np.ndarray], np.ndarray], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.rounds, self.problem = 0, self
        monkeypatch.setattr(
            least_squares, "_fit_curve", lambda _, values, **choices: self.round(leads, values)
        )
        monkeypatch.setattr(least_squares, "fit_noise", lambda _, values: values)
        monkeypatch.setattr(least_squares, "information", lambda _, values: np.eye(values.size))

    def round(self, leads: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
        self.rounds += 1
        return leads(values)

    def linearised(self, _: np.ndarray) -> Following:
        return self


def test_rounds_that_go_to_and_fro_settle_where_they_lead_nowhere_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A weighted mean of 0 and 1, the weight of each the larger the farther the last mean lay from
    it: full rounds end in a cycle.
    """
    leads = lambda mean: expit(-8.0 * (mean - 0.5))  # noqa: E731
    cycle = [0.3]
    for _ in range(60):
        cycle.append(float(leads(cycle[-1])))
    assert abs(cycle[-1] - cycle[-2]) > 0.5
    values, _, moved = least_squares._settle(np.array([0.3]), Following(leads, monkeypatch))
    assert moved < 1e-4
    assert values[0] == pytest.approx(0.5, abs=1e-4)


def test_rounds_across_a_jump_end_soon_and_do_not_pass_for_settled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    following = Following(lambda mean: np.where(mean < 0.5, 1.0, 0.0), monkeypatch)
    _, _, moved = least_squares._settle(np.array([0.3]), following)
    assert moved > 0.4
    assert following.rounds < 30


def test_step_between_limits_is_the_best_of_all_ways_to_hold_parameters_there(
    rng: np.random.Generator,
) -> None:
    """Against every choice of which of three parameters are held at which limit; the free step cut
    off there is worse, and may be worse than none.
    """
    nowhere = 0
    for _ in range(200):
        rows, aim = (
            rng.standard_normal((6, 3))
            @ np.array([[1.0, 0.9, 0.8], [0.0, 0.3, 0.5], [0.0, 0.0, 0.2]]),
            rng.standard_normal(6),
        )
        low, high = -rng.uniform(0.0, 0.5, 3) * rng.integers(0, 2, 3), rng.uniform(0.1, 0.5, 3)
        best = np.inf
        for sides in itertools.product((None, low, high), repeat=3):
            step = np.array([0.0 if side is None else side[i] for i, side in enumerate(sides)])
            free = [i for i, side in enumerate(sides) if side is None]
            step[free] = (
                np.linalg.lstsq(rows[:, free], -aim - rows @ step, rcond=None)[0] if free else []
            )
            if np.all((step >= low - 1e-12) & (step <= high + 1e-12)):
                best = min(best, float(np.sum((rows @ step + aim) ** 2)))
        found = step_between(rows, aim, low, high)
        assert np.all((found >= low) & (found <= high))
        assert np.sum((rows @ found + aim) ** 2) == pytest.approx(best, rel=1e-9)
        cut = np.clip(np.linalg.lstsq(rows, -aim, rcond=None)[0], low, high)
        nowhere += all(
            np.sum((rows @ (length * cut) + aim) ** 2) > np.sum(aim**2)
            for length in 0.5 ** np.arange(10)
        )
    assert nowhere > 5
    # without limits that matter, the free step
    free = np.linalg.lstsq(rows, -aim, rcond=None)[0]
    assert step_between(rows, aim, np.full(3, -np.inf), np.full(3, np.inf)) == pytest.approx(free)


def test_a_search_asks_for_the_information_at_its_fit_once(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = load_campaign("data/replica/campaign.toml").problem(["light-04"], usual=True)
    fit = fit_least_squares(problem)
    asked = list[np.ndarray]()
    plain = Posterior.information

    def counted(self: Posterior, values: np.ndarray) -> np.ndarray:
        asked.append(values)
        return plain(self, values)

    monkeypatch.setattr(Posterior, "information", counted)
    search_of(fit.posterior, fit.values, fit.cov, 30.0)
    assert len(asked) == 1


def test_the_steps_that_finish_a_fit_end_where_they_are_rounding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Shorter ones may lead to and fro between two neighbouring numbers for ever."""
    taken = [0]
    scoring = Posterior.scoring

    def counted(posterior: Posterior, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        taken[0] += 1
        return scoring(posterior, values)

    monkeypatch.setattr(Posterior, "scoring", counted)
    x = np.linspace(0.5, 10.0, 30)
    for seed in (2, 12, 15):
        y = 2.0 * x**1.5 + 0.1 * np.random.default_rng(seed).standard_normal(x.size)
        taken[0] = 0
        fit_curve("a*x**n", x, y, u_y=0.1, start={"a": 1.8, "n": 1.4}, scan=False)
        assert taken[0] < 10
