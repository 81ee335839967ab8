"""Motion in machine code (numba, the extra `fast`) against the same in NumPy, which is tested
against an ODE solver.
"""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from estim.model import Body, back_and_forth, motion

compiled = pytest.importorskip(
    "estim.model.compiled", reason="numba, the extra fast, is not installed"
)
N = 150


def by_numpy(monkeypatch, function, *args, **keywords):
    with monkeypatch.context() as patch:
        patch.setattr(motion, "_compiled", lambda: None)
        return function(*args, **keywords)


def settled(t, body, place, n_draw):
    return compiled.states(
        np.asarray(t, dtype=float), body, {"rolling_resistance": 0.0, "g": 9.81} | place, n_draw
    )[2]


def within(a, b, tolerance):
    assert np.array_equal(np.isnan(a), np.isnan(b))
    return np.nanmax(np.abs(a - b) / (1.0 + np.abs(a)), initial=0.0) < tolerance


def any_draws(rng, **ranges):
    """Draws of everything between wide limits: bodies that turn, roll on, stay, and may be balanced
    the wrong way.
    """
    wide = {
        "radius": (0.02, 0.5),
        "gamma": (-0.05, 0.5),
        "kappa": (0.3, 1.0),
        "rho": (0.5, 1.0),
        "phi": (-0.3, 0.3),
        "theta0": (-7.0, 7.0),
        "rolling_resistance": (0.0, 0.02),
    } | ranges
    columns = {name: rng.uniform(low, high, (N, 1)) for name, (low, high) in wide.items()}
    body = Body(**{name: columns.pop(name) for name in ("radius", "gamma", "kappa", "rho")})
    return body, columns


@pytest.mark.parametrize("own_times", [False, True])
@pytest.mark.parametrize(
    "ranges",
    [{}, {"phi": (-0.02, 0.02)}, {"gamma": (0.05, 0.2), "phi": (0.01, 0.08), "theta0": (0.6, 2.0)}],
)
def test_any_draws_move_as_numpy_says(rng, monkeypatch, ranges, own_times):
    body, place = any_draws(rng, **ranges)
    t = rng.uniform(-0.2, 4.0, (N, 25)) if own_times else np.linspace(-0.1, 5.0, 25)
    x, v = by_numpy(monkeypatch, back_and_forth, t, body, **place)
    here, there = back_and_forth(t, body, **place)
    assert within(x, here, 1e-10)
    assert within(v, there, 1e-10)
    assert np.mean(settled(t, body, place, N)) > 0.5  # the machine code did it
    assert np.any(v < 0.0)
    moved = place | {"theta0": place["theta0"] + 1e-6}
    elsewhere, _ = by_numpy(monkeypatch, back_and_forth, t, body, **moved)
    assert not np.allclose(x, elsewhere, rtol=0.0, atol=1e-9)


def test_all_draws_of_a_usual_run_are_settled(rng):
    body, place = any_draws(
        rng,
        gamma=(0.17, 0.2),
        kappa=(0.4, 0.5),
        rho=(0.95, 1.0),
        phi=(0.06, 0.08),
        theta0=(1.0, 1.1),
    )
    assert np.all(settled(np.linspace(-0.1, 3.0, 60), body, place, N))


def test_what_is_hard_is_left_to_numpy(monkeypatch):
    # barely over the top, hardly starting, not finite, hundreds of turns
    crest = math.asin(math.sin(math.radians(4.0)) / 0.187)
    theta0 = np.array([[1.05], [1e-4 + crest], [np.nan], [1.05], [1.05]])
    gamma = np.array([[0.187], [0.187], [0.187], [np.nan], [0.187]])
    phi = np.array([[math.radians(4.0)]] * 4 + [[-0.3]])
    body, place, t = (
        Body(0.15, gamma, 0.45),
        {"phi": phi, "theta0": theta0},
        np.linspace(0.0, 40.0, 80),
    )
    assert settled(t, body, place, 5).tolist() == [False] * 5  # the first turns more than 16 times
    assert settled(t[:5], body, place, 5).tolist() == [True, False, False, False, False]
    with np.errstate(all="ignore"):
        for one, other in zip(
            by_numpy(monkeypatch, back_and_forth, t, body, **place),
            back_and_forth(t, body, **place),
            strict=True,
        ):
            assert within(one, other, 1e-12)


def test_a_body_without_size_is_nowhere_and_no_error(monkeypatch):
    body, t = Body(np.array([[0.0], [0.15], [np.nan]]), 0.187, 0.45), np.linspace(0.0, 1.0, 5)
    with np.errstate(all="ignore"):
        for theta0 in (1.05, 0.1):  # it starts, or stays
            expected = by_numpy(monkeypatch, back_and_forth, t, body, phi=0.07, theta0=theta0)[0]
            assert within(expected, back_and_forth(t, body, phi=0.07, theta0=theta0)[0], 1e-12)


def test_numbers_of_one_run_need_no_columns():
    x, v = back_and_forth([-1.0, 0.5], Body(0.15, 0.187, 0.45), phi=0.07, theta0=1.05)
    assert x.shape == v.shape == (1, 2)
    assert x[0, 0] == v[0, 0] == 0.0 < x[0, 1]


def test_numba_that_compiles_nothing_is_not_used():
    code = "from estim.model import motion; print(motion._compiled())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "None"
    assert motion._compiled() is compiled.states
