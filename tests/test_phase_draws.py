"""The phase curve of many draws at once: matrix products give what the formula gives for each draw
by itself.
"""

from __future__ import annotations

import numpy as np
import pytest

from estim.model import Body, phase_curve


def literal(angle, gamma, j, theta0, phi, resistance):
    """W/D as it is written, in extended precision, cos theta0 - cos theta as a product."""
    angle, gamma, j, theta0, phi, resistance = (
        np.asarray(a, dtype=np.longdouble) for a in (angle, gamma, j, theta0, phi, resistance)
    )
    fall = 2.0 * np.sin(theta0 + 0.5 * angle) * np.sin(0.5 * angle)
    work = gamma * fall - angle * (np.sin(phi) + resistance * np.cos(phi))
    return work / (1.0 + j + 2.0 * gamma * np.cos(theta0 + angle + phi))


@pytest.mark.parametrize("per_draw_radius", [False, True])
@pytest.mark.parametrize("scale", [1e-9, 1e-4, 1.0])
def test_many_draws_at_once_give_the_formula_to_rounding_also_close_to_the_release(
    per_draw_radius, scale, rng
):
    n = 300
    column = lambda low, high: rng.uniform(low, high, (n, 1))  # noqa: E731
    gamma, kappa, theta0, phi, resistance = (
        column(0.05, 0.4),
        column(0.0, 1.0),
        column(-1.0, 3.0),
        column(-0.3, 0.3),
        column(0.0, 0.01),
    )
    radius = column(0.1, 0.2) if per_draw_radius else 0.15
    body = Body(radius=radius, gamma=gamma, kappa=kappa)
    x = scale * np.linspace(0.0, 0.8, 40)
    angle = x / radius
    ratio = phase_curve.energy_ratio(
        angle, body, phi=phi, theta0=theta0, rolling_resistance=resistance
    )
    expected = literal(angle, gamma, body.inertia_ratio, theta0, phi, resistance)
    assert ratio.shape == (n, 40)
    # rounding of the terms, which are of the order of the angle: no loss towards angle 0
    assert np.all(np.abs(ratio - expected) <= 3e-15 * np.abs(angle))
    # 1 - cos u taken literally would lose everything there: the bound can fail
    if scale == 1e-9:
        crude = gamma * (
            np.cos(theta0) - np.cos(theta0 + angle)
        ) - angle * phase_curve.effective_slope(phi, resistance)
        assert np.any(
            np.abs(
                crude / (1.0 + body.inertia_ratio + 2.0 * gamma * np.cos(theta0 + phi)) - expected
            )
            > 3e-15 * np.abs(angle)
        )


def test_speeds_do_not_depend_on_the_draws_beside_them(rng):
    values = rng.uniform(0.1, 0.3, (5, 1))
    x = np.linspace(0.0, 0.4, 7)
    together = phase_curve.speed(
        x, Body(radius=0.15, gamma=values, kappa=0.45), phi=0.05, theta0=1.0
    )
    for row, gamma in zip(together, values[:, 0], strict=True):
        alone = phase_curve.speed(
            x, Body(radius=0.15, gamma=gamma, kappa=0.45), phi=0.05, theta0=1.0
        )
        assert alone.shape == (7,)
        assert np.allclose(row, alone, rtol=1e-12, atol=1e-9)
