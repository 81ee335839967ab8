"""What data and prior each know: closed forms, a flat direction, and the ridge of the phase
curve.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from formulas import formula_problem
from matplotlib import colormaps
from matplotlib.colors import to_rgb

from estim.campaign import load_campaign
from estim.checks.identifiability import Identifiability, identify
from estim.drawing import new_figure
from estim.fitting import prior_sds
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.model import Body, speed
from estim.problem.priors import HalfNormal, Normal, Uniform
from estim.reports.identifiability import _components

X = np.linspace(0.0, 2.0, 12)


def fitted(function, y, sigma, priors) -> Fit:
    return fit_least_squares(formula_problem(function, X, y, sigma, priors))


def test_one_parameter_conjugate_numbers() -> None:
    """n readings of sd sigma against a prior of sd tau: lambda = n tau^2/sigma^2."""
    found = identify(
        fitted(lambda x, a: a + 0.0 * x, np.full(12, 1.0), 2.0, {"a": Normal(0.0, 1.5)})
    )
    expected = 12 * 1.5**2 / 2.0**2
    assert found.directions[0].information == pytest.approx(expected, rel=1e-9)
    assert found.directions[0].held_by == "data"
    assert found.sentences == (
        "The data constrain 0.9 of 1 combinations of the parameters; every combination is "
        "determined by the data.",
    )


def learnt(found: Identifiability) -> float:
    return sum(d.information / (1.0 + d.information) for d in found.directions)


def test_number_learnt_is_the_trace_of_prior_to_posterior() -> None:
    """sum lambda/(1 + lambda) = trace(1 - prior^-1 posterior), which needs no eigenvalues."""
    fit = fitted(
        lambda x, a, b: a + b * x, 1.0 + X, 0.7, {"a": Normal(0.5, 0.2), "b": Normal(1.0, 0.3)}
    )
    shrink = np.eye(2) - np.diag([0.2**-2, 0.3**-2]) @ fit.cov
    assert learnt(identify(fit)) == pytest.approx(np.trace(shrink), rel=1e-9)


def test_difference_is_the_priors_where_only_the_sum_is_seen() -> None:
    found = identify(
        fitted(
            lambda x, a, b: a + b + 0.0 * x,
            np.ones(12),
            0.1,
            {"a": Normal(10.0, 0.5), "b": Normal(-9.0, 0.5)},
        )
    )
    weak, strong = found.directions
    assert abs(weak.vector @ [1.0, -1.0]) / math.sqrt(2.0) == pytest.approx(1.0, abs=1e-6)
    assert weak.information == pytest.approx(0.0, abs=1e-8)
    assert (weak.held_by, strong.held_by) == ("prior", "data")
    # 12 readings of 0.1 on a sum of prior sd sqrt(2) 0.5
    assert learnt(found) == pytest.approx(600.0 / 601.0, rel=1e-9)
    assert "together do not change the predicted data at all" in weak.words
    assert "3.5 %" in weak.words  # 0.5/sqrt(2) of 10
    assert {"up", "down"} <= set(weak.words.split())


def test_uniform_priors_do_not_hold_what_the_data_do_not_see() -> None:
    found = identify(
        fitted(
            lambda x, a, b: a + b + 0.0 * x,
            np.ones(12),
            0.1,
            {"a": Uniform(0.0, 1.0), "b": Uniform(0.0, 1.0)},
        )
    )
    assert found.directions[0].held_by == "nothing"
    assert found.sentences[0].startswith("Constrained neither by the data nor by the prior: ")
    # with one normal prior the same direction is held by it
    held = identify(
        fitted(
            lambda x, a, b: a + b + 0.0 * x,
            np.ones(12),
            0.1,
            {"a": Normal(0.5, 0.1), "b": Uniform(0.0, 1.0)},
        )
    )
    assert held.directions[0].held_by == "prior"


def test_inferred_noise_counts_as_learnt_from_the_data(rng: np.random.Generator) -> None:
    """12 readings give 2 n/sigma^2 of information on sigma."""
    y = 3.0 + 0.5 * rng.standard_normal(12)
    fit = fitted(
        lambda x, m: m + 0.0 * x, y, "s", {"m": Uniform(-10.0, 10.0), "s": HalfNormal(2.0)}
    )
    found = identify(fit)
    sd = 2.0 * math.sqrt(1.0 - 2.0 / math.pi)
    expected = 2 * 12 / fit.values[1] ** 2 * sd**2
    assert min(d.information for d in found.directions) == pytest.approx(expected, rel=1e-6)


def heavy_04(replica: Path) -> Fit:
    return fit_least_squares(load_campaign(replica / "campaign.toml").problem(["heavy-04"]))


def ridge(fit: Fit) -> np.ndarray:
    """Displacement that scales gamma, s = sin phi + c cos phi and 1 + j by one factor at the same
    phi; j = (1 - gamma) kappa + gamma.
    """
    at = dict(zip(("gamma", "kappa", "theta0", "phi", "c", "radius"), fit.values, strict=True))
    d_gamma = at["gamma"]
    d_kappa = (
        1.0 + (1.0 - at["gamma"]) * at["kappa"] + at["gamma"] - (1.0 - at["kappa"]) * d_gamma
    ) / (1.0 - at["gamma"])
    return np.array([d_gamma, d_kappa, 0.0, 0.0, math.tan(at["phi"]) + at["c"], 0.0])


def test_scaling_gamma_slope_and_inertia_leaves_the_speeds_unchanged(replica: Path) -> None:
    """The exact degeneracy itself, from the physics and not from the fit."""
    truth = tomllib.loads((replica / "truth.toml").read_text())
    gamma, kappa, phi, c = (
        truth["gamma[heavy]"],
        truth["kappa[heavy]"],
        truth["phi[heavy-04]"],
        0.002,
    )
    factor = 1.05
    s = factor * (math.sin(phi) + c * math.cos(phi))
    inertia = factor * (1.0 + (1.0 - gamma) * kappa + gamma)
    scaled = Body(0.15, factor * gamma, (inertia - 1.0 - factor * gamma) / (1.0 - factor * gamma))
    x = np.linspace(0.01, 0.4, 30)
    before = speed(x, Body(0.15, gamma, kappa), phi=phi, theta0=1.0, rolling_resistance=c)
    after = speed(
        x, scaled, phi=phi, theta0=1.0, rolling_resistance=(s - math.sin(phi)) / math.cos(phi)
    )
    np.testing.assert_allclose(after, before, rtol=1e-12)


def test_weakest_direction_of_the_replica_is_the_known_ridge(replica: Path) -> None:
    fit = heavy_04(replica)
    found = identify(fit)
    sds = prior_sds(fit.problem, fit.cov)
    unit = ridge(fit) / sds
    unit /= np.linalg.norm(unit)
    assert abs(found.directions[0].vector @ unit) > 0.999
    assert found.directions[0].information < 1e-6
    # kappa alone instead of 1 + j, or the slope left out, is not the direction
    for wrong in (
        ridge(fit) * [1.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        ridge(fit) * [1.0, -1.0, 0.0, 0.0, 1.0, 0.0],
    ):
        assert abs(found.directions[0].vector @ (wrong / sds)) / np.linalg.norm(wrong / sds) < 0.95


def test_replica_run_tells_half_of_its_six_parameters(replica: Path) -> None:
    """One run fixes three combinations (start, scale of the speed, shape); R, the tilt and the
    resistance come from rulers.
    """
    found = identify(heavy_04(replica))
    assert learnt(found) == pytest.approx(2.8, abs=0.2)
    assert sum(direction.held_by != "data" for direction in found.directions) == 3
    assert all("nan" not in sentence for sentence in found.sentences)


def test_numbers_in_the_map_of_directions_can_be_read() -> None:
    """Contrast of at least 3.5 with what lies below (WCAG 2.1 asks 3 of large text)."""

    def luminance(colour: object) -> float:
        c = np.array(to_rgb(colour))
        return np.where(c < 0.03928, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ (
            0.2126,
            0.7152,
            0.0722,
        )

    ax = new_figure(2.0).subplots()
    sizes = np.array([[-1.0, -0.69, -0.6, -0.5], [-0.3, 0.3, 0.5, 0.6], [0.68, 0.7072, 0.8, 1.0]])
    vectors = np.vstack([sizes, np.zeros(4)])
    _components(ax, vectors, ["a", "b", "c", "d"], upright=False)
    colours = colormaps["PuOr_r"](0.5 + 0.5 * sizes.ravel())[:, :3]
    assert len(ax.texts) == sizes.size
    for text, colour in zip(ax.texts, colours, strict=True):
        dark, light = sorted((luminance(text.get_color()), luminance(colour)))
        assert (light + 0.05) / (dark + 0.05) > 3.5, text.get_text()
