"""The two ways to fit a curve, `estim.fit_curve` and `estim fit TABLE --formula`: what one says of a table, the other says too."""

from __future__ import annotations

import numpy as np
import pytest

from estim import fit_curve
from estim.fitting import profile_intervals

SINKING = "y0 - v*x + v*tau*(1 - exp(-x/tau))"


def slowing_ball() -> tuple[np.ndarray, np.ndarray]:
    """A ball that sinks ever slower, where the formula of one released from rest (`SINKING`) fits best at the edge tau = 0 of its range."""
    x = np.linspace(0.0, 1.6, 50)
    return x, 0.028 - 0.068 * x + 0.004 * x**2 + 1e-4 * np.random.default_rng(1).standard_normal(x.size)


def test_profiles_end_in_words_where_the_density_falls_off_a_cliff() -> None:
    # beyond tau = 0 the curve is exp(+x/|tau|) in size: differences of the density overflowed in the products that descents make of them
    found = fit_curve(SINKING, *slowing_ball())
    assert abs(found.values["tau"]) < 1e-10
    for interval in profile_intervals(found.fit):
        assert all(np.isfinite([*interval.low.values(), *interval.high.values()]))


# one curve, two writings


def malus(seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    rng = np.random.default_rng(seed)
    truth = {"A": rng.uniform(2.0, 8.0), "phi": rng.uniform(-80.0, 80.0), "c": rng.uniform(0.0, 1.0)}
    x = np.linspace(0.0, 360.0, 37)
    return x, truth["A"] * np.cos(np.radians(x - truth["phi"])) ** 2 + truth["c"] + 0.1 * rng.standard_normal(x.size), truth


def swing(seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    rng = np.random.default_rng(seed)
    truth = {"A": rng.uniform(2.0, 8.0), "tau": rng.uniform(5.0, 15.0), "w": rng.uniform(3.0, 7.0), "p": rng.uniform(-2.9, 2.9), "c": 0.3}
    x = np.linspace(0.0, 10.0, 60)
    y = truth["A"] * np.exp(-x / truth["tau"]) * np.cos(truth["w"] * x + truth["p"]) + truth["c"]
    return x, y + 0.1 * rng.standard_normal(x.size), truth


@pytest.mark.parametrize("seed", range(8))
def test_malus_and_swings_have_one_solution_with_a_positive_amplitude_and_a_phase_within_a_turn(seed: int) -> None:
    for formula, data in (("A*cos(pi/180*(x - phi))**2 + c", malus), ("A*exp(-x/tau)*cos(w*x + p) + c", swing)):
        x, y, truth = data(seed)
        found = fit_curve(formula, x, y)
        assert found.status == "ok", found.reasons
        for name, value in truth.items():
            assert abs(found.values[name] - value) < 5.0 * found.sds[name]


def test_what_the_user_states_chooses_the_writing() -> None:
    x, y, truth = malus(1)
    formula = "A*cos(pi/180*(x - phi))**2 + c"
    falling = fit_curve(formula, x, y, start={"A": -5.0})
    assert falling.status == "ok"
    assert falling.values["A"] == pytest.approx(-truth["A"], abs=0.3)
    assert falling.values["c"] == pytest.approx(truth["c"] + truth["A"], abs=0.3)
    assert fit_curve(formula, x, y, bounds={"A": (None, 0.0)}).values["A"] == pytest.approx(-truth["A"], abs=0.3)
    turned = fit_curve(formula, x, y, start={"A": 5.0, "phi": 360.0 + truth["phi"], "c": 0.0})
    assert turned.values["phi"] == pytest.approx(360.0 + truth["phi"], abs=3.0)


def test_a_step_may_be_written_up_or_down() -> None:
    x = np.linspace(-5.0, 5.0, 41)
    y = 3.0 / (1.0 + np.exp(-1.3 * (x - 0.4))) + 1.0 + 0.05 * np.random.default_rng(2).standard_normal(x.size)
    found = fit_curve("L/(1 + exp(-k*(x - m))) + c", x, y)
    assert found.status == "ok"
    assert "-L, -k, c + L" in found.message or "-k, -L, c + L" in found.message
    assert found.values["L"] == pytest.approx(3.0, abs=0.1)


def test_a_solution_with_next_to_nothing_of_the_posterior_is_not_reported() -> None:
    # two values of m draw the same points, one in a well that is 3e5 times as narrow; the start lies in that
    x = np.arange(10.0)
    y = 0.1 * np.random.default_rng(1).standard_normal(10)
    found = fit_curve("(m - 2)*tanh((m + 1)/1e-5) + 0*x", x, y, start={"m": -1.0000001}, u_y=0.1)
    assert found.values["m"] == pytest.approx(2.0, abs=0.2)
    assert found.status == "ok"
