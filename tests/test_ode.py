"""Curves given by differential equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from estim import fit_curve, ode
from estim.common import InputError
from estim.curves.function import _derivatives, wrap_function

T = np.linspace(-0.5, 1.5, 11)


def damped(t, state, w, b):
    return [state[1], -(w**2) * state[0] - 2.0 * b * state[1]]


def closed(t, w, b, s0):
    turned = np.sqrt(w**2 - b**2)
    return s0 * np.exp(-b * t) * (np.cos(turned * t) + b / turned * np.sin(turned * t))


VALUES = {"w": 3.0, "b": 0.2, "s0": 1.5}


def test_a_damped_oscillation_is_that_in_closed_form_with_its_derivatives() -> None:
    curve, exact = (
        wrap_function(one, tuple(VALUES), T, VALUES) for one in (ode(damped, ["s0", 0.0]), closed)
    )
    assert (curve.derivatives, curve.broadcasts, exact.derivatives) == ("complex", True, "dual")
    ours, theirs = curve.local(T, VALUES), exact.local(T, VALUES)
    assert ours.value == pytest.approx(theirs.value, abs=1e-8)
    assert ours.slope == pytest.approx(theirs.slope, abs=1e-7)
    for name in VALUES:
        assert ours.gradient[name] == pytest.approx(theirs.gradient[name], abs=1e-7), name
    draws = {name: value * np.array([[1.0], [1.1], [0.7]]) for name, value in VALUES.items()}
    assert curve.value(T, draws) == pytest.approx(exact.value(T, draws), abs=1e-7)


def test_a_fit_by_the_equation_is_that_by_its_solution() -> None:
    y = 2.0 * np.exp(-1.3 * T) + 0.02 * np.random.default_rng(1).standard_normal(T.size)
    start = {"y0": 1.0, "k": 1.0}
    fits = [
        fit_curve(one, T, y, u_y=0.02, start=start, scan=False)
        for one in (ode(lambda t, y, k: [-k * y[0]], ["y0"]), "y0*exp(-k*x)")
    ]
    assert fits[0].status == fits[1].status == "ok"
    assert fits[0].values == pytest.approx(fits[1].values, rel=1e-5)
    assert fits[0].sds == pytest.approx(fits[1].sds, rel=1e-3)
    assert (
        fit_curve(ode(lambda t, y, k: [-k], ["y0"]), T, y, u_y=0.02, start=start).status
        == "poor-fit"
    )


@pytest.mark.parametrize("degrees", [60.0, 90.0, 120.0])
@pytest.mark.slow
def test_a_pendulum_of_large_amplitude_has_the_period_of_the_elliptic_integral(
    degrees: float,
) -> None:
    """Jacobi's functions and K of SciPy; the period of a cosine is no period of small swings."""

    def swing(t, state, t0, k):
        return [state[1], -((2.0 * np.pi / t0) ** 2) * np.sin(state[0]) - 2.0 * k * state[1]]

    small, t = 2.1, np.linspace(0.0, 6.0, 40)
    most = np.sin(np.radians(0.5 * degrees))
    quarter = ellipk(most**2)
    sn, *_ = ellipj(2.0 * np.pi * t / small + quarter, most**2)
    y = 2.0 * np.arcsin(most * sn) + 0.01 * np.random.default_rng(2).standard_normal(t.size)
    start = {"angle0": y[0], "t0": 1.03 * small, "k": 0.02}
    fit = fit_curve(ode(swing, ["angle0", 0.0]), t, y, u_y=0.01, start=start)
    assert fit.status == "ok"
    for name, true in {"angle0": np.radians(degrees), "t0": small, "k": 0.0}.items():
        assert abs(fit.values[name] - true) < 3.0 * fit.sds[name], name
    cosine = fit_curve("damped_oscillation", t, y, u_y=0.01)
    assert cosine.status == ("ok" if degrees == 60.0 else "poor-fit")  # 40 readings see no more
    period = small * 2.0 / np.pi * quarter
    assert 1.0 / cosine.values["frequency"] == pytest.approx(period, rel=0.01)
    assert abs(1.0 / cosine.values["frequency"] - small) > 0.05 * small


def test_what_is_observed_may_be_computed_and_need_no_complex_numbers() -> None:
    free = ode(
        lambda t, s, g: [s[1], -abs(float(g))],
        ["h", 0.0],
        observed=lambda t, states, g: 100.0 * states[0],
    )
    values = {"h": 7.0, "g": 9.81}
    curve = wrap_function(free, ("h", "g"), T[::3], values)
    assert (curve.derivatives, curve.broadcasts) == ("differences", False)
    found = curve.local(T[::3], values)
    assert found.value[0] == pytest.approx(100.0 * (7.0 - 4.905 * T[::3] ** 2), rel=1e-8)
    assert found.gradient["g"][0] == pytest.approx(-50.0 * T[::3] ** 2, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("fast", [1e3, 1e9])
def test_a_fast_reaction_leaves_the_slow_one_exact(fast: float) -> None:
    chain = ode(
        lambda t, y, k: [-k * y[0], k * y[0] - y[1]], [1.0, 0.0], observed=1, method="Radau"
    )
    t = np.linspace(0.0, 10.0, 11)
    exact = fast / (fast - 1.0) * (np.exp(-t) - np.exp(-fast * t))
    assert chain(t, k=fast) == pytest.approx(exact, abs=1e-9)


def test_an_equation_may_name_a_parameter_that_is_a_start_too() -> None:
    reached = ode(lambda t, y, k, y0: [k * (y0 / 2.0 - y[0])], ["y0"])
    assert reached(T, k=1.3, y0=3.0) == pytest.approx(1.5 + 1.5 * np.exp(-1.3 * T), abs=1e-8)
    decay = ode(lambda t, y, k: [-k * y[0]], ["y"])
    assert decay(T, k=1.3, y=3.0) == pytest.approx(3.0 * np.exp(-1.3 * T), abs=1e-8)


def test_a_right_side_that_does_not_tell_its_arguments_is_solved() -> None:
    class Compiled:
        __signature__ = "none"

        def __call__(self, t: float, y: np.ndarray, k: float) -> list[float]:
            return [-k * y[0]]

    decay = ode(Compiled(), ["y0"])
    assert decay(T, k=1.3, y0=3.0) == pytest.approx(3.0 * np.exp(-1.3 * T), abs=1e-8)


def test_where_the_solution_ends_there_is_no_value() -> None:
    found = ode(lambda t, y, a: [a * y[0] ** 2], [1.0])(np.array([0.5, 2.0]), a=1.0)
    assert np.isnan(found).any()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"start": []}, "'start' must be the state"),
        ({"start": "s0"}, "'start' must be the state"),
        ({"start": [0.0], "observed": 1}, "'observed' must be"),
        ({"start": [0.0], "method": "LSODA"}, "'method' must be"),
        ({"start": [0.0], "x0": np.inf}, "'x0' must be finite"),
        ({"start": [0.0], "x0": "0"}, "'x0' must be finite"),
    ],
)
def test_what_is_wrong_is_said(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        ode(damped, **arguments)  # type: ignore[arg-type]


def test_what_tells_how_to_differentiate_solves_no_equation_twice() -> None:
    """A solution takes milliseconds, and this costs more of them than the rest of a fit."""
    seen: list[tuple[object, ...]] = []

    def counted(x: Any, **parameters: Any) -> Any:
        if np.isrealobj(x) and all(map(np.isrealobj, parameters.values())):
            seen.append((np.asarray(x).tobytes(), *map(float, parameters.values())))
        return parameters["a"] * np.exp(-x / parameters["tau"])

    x = np.linspace(0.1, 3.0, 9)
    assert _derivatives(counted, x, {"a": 2.0, "tau": 1.5}) == "complex"
    at_start = (x.tobytes(), 2.0, 1.5)
    moved = [called for called in seen if called != at_start]
    assert len(moved) == len(set(moved)) > 20
