"""The body: ratios from masses, the inertia ratio against a sum over parts, and uncertainties that
pass through.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from uncertainties import ufloat

from estim.model import Body

WHEEL = Body.from_masses(
    0.235,
    11.7,
    3.4,
    kappa=(0.203 / 0.235) ** 2,
    rho=0.178 / 0.235,
    mass_trailing=0.7,
    particle_gyration=0.019 / 0.235 / 2**0.5,
)


def test_gamma_of_the_paper_is_the_particles_share_of_the_mass():
    body = Body.from_masses(0.15, 0.303, 0.0697, kappa=0.45)
    assert body.gamma == pytest.approx(0.0697 / 0.3727, rel=1e-15)
    assert body.gamma == pytest.approx(0.187, abs=5e-4)  # arXiv 1403.7220, section IV
    assert body.trailing_fraction == 0.0
    assert body.mass == pytest.approx(0.3727)


def test_inertia_ratio_of_the_paper():
    body = Body(radius=0.15, gamma=0.187, kappa=0.45)
    assert body.inertia_ratio == pytest.approx((1 - 0.187) * 0.45 + 0.187, rel=1e-15)


def test_centre_of_mass_of_the_wheel_is_that_of_its_parts():
    # x of the centre of mass of cylinder, trailing frame and mass when the mass stands beside the
    # axle
    assert WHEEL.gamma * 0.235 == pytest.approx(
        (11.7 * 0.0 + 0.7 * 0.0 + 3.4 * 0.178) / 15.8, rel=1e-14
    )


def test_inertia_ratio_of_the_wheel_is_the_sum_over_its_parts():
    about_axle = 11.7 * 0.203**2 + 3.4 * (0.178**2 + 0.5 * 0.019**2)  # the frame does not rotate
    assert WHEEL.inertia_ratio == pytest.approx(about_axle / (15.8 * 0.235**2), rel=1e-14)
    assert about_axle / (15.8 * 0.235**2) == pytest.approx(0.6763, abs=5e-4)


def test_trailing_mass_lowers_gamma_and_inertia_alike():
    bare, towed = (
        Body.from_masses(0.15, 0.3, 0.07, kappa=0.45, mass_trailing=m) for m in (0.0, 0.37)
    )
    assert towed.trailing_fraction == pytest.approx(0.5)
    assert towed.gamma == pytest.approx(bare.gamma / 2)
    assert towed.inertia_ratio == pytest.approx(bare.inertia_ratio / 2)


@pytest.mark.parametrize(
    "name", ["gamma", "kappa", "rho", "trailing_fraction", "particle_gyration"]
)
def test_inertia_gradient_is_the_complex_step(name):
    step = 1e-30
    moved = dataclasses.replace(WHEEL, **{name: getattr(WHEEL, name) + 1j * step})
    assert WHEEL.inertia_ratio_gradient()[name] == pytest.approx(
        moved.inertia_ratio.imag / step, rel=1e-13
    )


def test_inertia_depends_on_no_field_outside_its_gradient():
    moved = dataclasses.replace(WHEEL, radius=7.0, mass=None)
    assert moved.inertia_ratio == WHEEL.inertia_ratio
    assert set(WHEEL.inertia_ratio_gradient()) == {f.name for f in dataclasses.fields(Body)} - {
        "radius",
        "mass",
    }


def test_uncertainties_pass_through_the_masses():
    disk, particle = ufloat(0.303, 0.001), ufloat(0.0697, 0.0046)
    body = Body.from_masses(ufloat(0.15, 0.001), disk, particle, kappa=ufloat(0.45, 0.02))
    total = 0.303 + 0.0697
    expected = math.hypot(0.303 / total**2 * 0.0046, 0.0697 / total**2 * 0.001)
    assert body.gamma.std_dev == pytest.approx(expected, rel=1e-9)
    # j = (1 - gamma) kappa + gamma, and gamma is the same gamma in both places
    gamma = body.gamma.nominal_value
    assert body.inertia_ratio.std_dev == pytest.approx(
        math.hypot((1 - 0.45) * expected, (1 - gamma) * 0.02), rel=1e-9
    )


def test_fields_may_be_columns_of_draws():
    body = Body(radius=0.15, gamma=np.array([[0.1], [0.2]]), kappa=np.array([[0.4], [0.5]]))
    assert body.inertia_ratio == pytest.approx(np.array([[0.9 * 0.4 + 0.1], [0.8 * 0.5 + 0.2]]))


def test_a_body_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        WHEEL.gamma = 0.3
