"""Bodies made of parts, against sums over many small pieces of the solids, and against textbook
limits.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from estim.model import Body, Part, assemble, bolt, disk, ring, rod, speed

R = 0.15


def flat(radius, inner=0.0, n=400, m=8):
    """(share of the mass, x, y) of pieces of a ring, from its centre; m directions integrate x and
    x^2 exactly.
    """
    edges = np.linspace(inner, radius, n + 1)
    area, middle = (
        np.diff(edges**2) / (radius**2 - inner**2),
        np.sqrt(0.5 * (edges[1:] ** 2 + edges[:-1] ** 2)),
    )
    angle = 2 * np.pi * np.arange(m) / m
    return (
        np.repeat(area / m, m),
        np.outer(middle, np.cos(angle)).ravel(),
        np.outer(middle, np.sin(angle)).ravel(),
    )


def lying(length, diameter, n=400):
    """The same of a round rod along x, seen along the axle: pieces along it and across, the height
    of the round at each.
    """
    x = (np.arange(n) + 0.5) / n * length - length / 2
    turn = (np.arange(n) + 0.5) / n * np.pi
    y, share = 0.5 * diameter * np.cos(turn), 2 / n * np.sin(turn) ** 2
    return np.repeat(np.full(n, 1 / n), n) * np.tile(share, n), np.repeat(x, n), np.tile(y, n)


SOLIDS = {
    "disk": (disk(R), flat(R)),
    "ring": (ring(0.06, 0.0075), flat(0.06, 0.0075)),
    "rod": (rod(0.08, 0.012), lying(0.08, 0.012)),
    "bolt": (bolt(0.01), flat(0.005)),
    "point": (0.0, (np.ones(1), np.zeros(1), np.zeros(1))),
}


def pieces(kind, part):
    """Masses and places of the small pieces of a part on the body; a rod lies in any direction."""
    share, x, y = SOLIDS[kind][1]
    turned = 0.7 + np.arctan2(y, x)
    r = np.hypot(x, y)
    place = part.distance * np.array([math.cos(part.angle), math.sin(part.angle)])
    return part.mass * share, place[0] + r * np.cos(turned), place[1] + r * np.sin(turned)


@pytest.mark.parametrize("kind", SOLIDS)
def test_radius_of_gyration_is_the_sum_over_the_solid(kind):
    square, (share, x, y) = SOLIDS[kind]
    assert np.sum(share) == pytest.approx(1.0, rel=1e-12)
    assert square == pytest.approx(np.sum(share * (x**2 + y**2)), rel=1e-5, abs=1e-15)


def some_body(rng):
    parts = []
    for kind in SOLIDS:
        distance = 0.0 if kind in ("disk", "ring") else rng.uniform(0.05, 0.14)
        parts.append(
            (kind, Part(rng.uniform(0.01, 0.3), SOLIDS[kind][0], distance, rng.uniform(-3.0, 3.0)))
        )
    return parts


@pytest.mark.parametrize("imbalance", [0.0, 0.004])
def test_body_is_the_sum_over_the_pieces_of_all_parts(rng, imbalance):
    """M, gamma, j and the direction; with a disk that is not centred too."""
    parts = some_body(rng)
    parts[0] = (parts[0][0], dataclasses.replace(parts[0][1], distance=imbalance))
    m, x, y = (
        np.concatenate(columns) for columns in zip(*(pieces(*part) for part in parts), strict=True)
    )
    found = assemble([part for _, part in parts], R, particle=[2, 3, 4])
    assert found.body.mass == pytest.approx(m.sum(), rel=1e-12)
    assert found.body.gamma * R == pytest.approx(
        np.hypot(np.sum(m * x), np.sum(m * y)) / m.sum(), rel=1e-5
    )
    assert found.direction == pytest.approx(math.atan2(np.sum(m * y), np.sum(m * x)), rel=1e-5)
    assert found.inertia == pytest.approx(np.sum(m * (x**2 + y**2)), rel=1e-5)
    assert found.body.inertia_ratio * found.body.mass * R**2 == pytest.approx(
        found.inertia, rel=1e-12
    )
    assert found.body.gamma / found.body.rho == pytest.approx(
        found.mass_particle / found.body.mass, rel=1e-12
    )


def test_particle_and_disk_are_those_of_the_definitions(rng):
    """kappa = I_C/(M_D R^2) of the disk alone, rho the distance of the particle's own centre, k_P
    about it.
    """
    parts = some_body(rng)
    body = assemble([part for _, part in parts], R).body
    m, x, y = (
        np.concatenate(columns)
        for columns in zip(*(pieces(*part) for part in parts[:2]), strict=True)
    )
    assert body.kappa == pytest.approx(np.sum(m * (x**2 + y**2)) / (m.sum() * R**2), rel=1e-5)
    m, x, y = (
        np.concatenate(columns)
        for columns in zip(*(pieces(*part) for part in parts[2:]), strict=True)
    )
    cx, cy = np.sum(m * x) / m.sum(), np.sum(m * y) / m.sum()
    assert body.rho == pytest.approx(math.hypot(cx, cy) / R, rel=1e-5)
    assert body.particle_gyration == pytest.approx(
        math.sqrt(np.sum(m * ((x - cx) ** 2 + (y - cy) ** 2)) / m.sum()) / R, rel=1e-4
    )


def test_motion_does_not_know_what_is_called_the_particle(rng):
    parts = [part for _, part in some_body(rng)]
    x = np.linspace(0.01, 0.2, 7)
    ways = [assemble(parts, R, particle=chosen).body for chosen in (None, (2,), (1, 4), ())]
    speeds = [speed(x, body, phi=0.0, theta0=1.0) for body in ways]
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-12)
    assert speeds[2] == pytest.approx(speeds[0], rel=1e-12)
    assert speeds[3] == pytest.approx(speeds[0], rel=1e-12)
    assert ways[1].kappa != pytest.approx(ways[0].kappa, rel=1e-3)


@pytest.mark.parametrize(
    ("part", "kappa"),
    [(Part(0.2, disk(R)), 0.5), (Part(0.2, ring(R, R)), 1.0), (Part(0.2, rod(2 * R)), 1 / 3)],
)
def test_one_part_alone_is_the_textbooks(part, kappa):
    body = assemble([part], R).body
    assert (body.gamma, body.rho, body.trailing_fraction, body.particle_gyration) == (
        0.0,
        1.0,
        0.0,
        0.0,
    )
    assert body.kappa == pytest.approx(kappa, rel=1e-14)
    assert body.mass == 0.2


def test_disk_with_a_point_on_its_rim_is_the_body_of_the_paper():
    body, expected = (
        assemble([Part(0.303, 0.45 * R**2), Part(0.0697, 0.0, R)], R).body,
        Body.from_masses(R, 0.303, 0.0697, kappa=0.45),
    )
    for field in dataclasses.fields(Body):
        assert getattr(body, field.name) == pytest.approx(
            getattr(expected, field.name), rel=1e-14
        ), field.name


def test_an_imbalance_without_a_particle_counts_as_one_on_the_rim():
    found = assemble([Part(0.3, disk(R), 0.002), Part(0.1, disk(0.05))], R, particle=())
    assert (found.body.rho, found.body.gamma) == pytest.approx((1.0, 0.3 * 0.002 / 0.4 / R))
    assert found.body.inertia_ratio * 0.4 * R**2 == pytest.approx(
        0.3 * (R**2 / 2 + 0.002**2) + 0.1 * 0.05**2 / 2, rel=1e-12
    )
    assert assemble([Part(0.3, disk(R))], R, particle=()).body.kappa == pytest.approx(0.5)


def test_weights_opposite_to_each_other_balance():
    found = assemble(
        [Part(0.3, disk(R)), Part(0.02, 0.0, 0.1, 0.4), Part(0.01, 0.0, 0.2, 0.4 + math.pi)], R
    )
    assert found.body.gamma == pytest.approx(0.0, abs=1e-15)
    assert found.inertia == pytest.approx(0.3 * R**2 / 2 + 0.02 * 0.01 + 0.01 * 0.04, rel=1e-14)


def test_what_is_towed_weighs_and_does_not_turn():
    turning = [Part(0.3, disk(R)), Part(0.05, 0.0, 0.12)]
    bare, towed = assemble(turning, R), assemble([*turning, Part(0.35, 1.0, 0.3, rotates=False)], R)
    assert towed.body.trailing_fraction == pytest.approx(0.5)
    assert towed.body.gamma == pytest.approx(bare.body.gamma / 2)
    assert (towed.inertia, towed.body.kappa, towed.body.rho) == pytest.approx(
        (bare.inertia, bare.body.kappa, bare.body.rho)
    )


def test_draws_of_parts_are_bodies_one_by_one(rng):
    mass, distance = rng.normal(0.07, 0.001, 5), rng.normal(0.145, 0.001, 5)
    many = assemble([Part(0.303, disk(R)), Part(mass, bolt(0.008), distance)], R).body
    for i in range(5):
        one = assemble([Part(0.303, disk(R)), Part(mass[i], bolt(0.008), distance[i])], R).body
        assert (many.gamma[i], many.kappa[i], many.rho[i]) == pytest.approx(
            (one.gamma, one.kappa, one.rho)
        )
