"""The friction that rolling needs over the plane of tilt and angle of release: it has no closed border, so it is computed on a grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.curves import Fate, fate_at
from estim.studies.run_places import LEVELS

FIELD_DRAWS = 64
_N_PHI, _N_THETA0, _WAY = 46, 61, 32  # cells, and places on the way
_MIXING = 37  # has no factor in common with FIELD_DRAWS


@dataclass(frozen=True, eq=False)
class FrictionField:
    """On a grid.  phi (n_phi,), theta0 (n_theta0,) rad; all others (n_theta0, n_phi).

    needed : median friction that rolling needs, among the draws that set off; nan where none does.
    of_grip : (5, n_theta0, n_phi) quantiles (`LEVELS`) of the friction needed over the stated one, likewise; None where none is stated.
    hops : probability that the ramp would have to pull.
    """

    phi: FloatArray
    theta0: FloatArray
    needed: FloatArray
    of_grip: FloatArray | None
    hops: FloatArray


def friction_field(
    arguments: Mapping[str, ArrayLike], tilts: tuple[float, float], angles: tuple[float, float], *, ramp_end: float, grip: FloatArray | None,
    progress: Callable[[int], None],
) -> FrictionField:
    """The friction that rolling needs over tilts and angles of release (ends of their ranges, rad).

    arguments : scalars or (n_draw, 1); the first `FIELD_DRAWS` are used.  ramp_end : m.  grip : (n_draw, 1) the stated friction, if any.
    """
    phi, theta0 = np.linspace(*tilts, _N_PHI), np.linspace(*angles, _N_THETA0)
    cells = [np.ravel(axis) for axis in np.meshgrid(phi, theta0)]
    fates: list[Fate] = []
    for i in range(FIELD_DRAWS):
        one = {name: value if np.ndim(value) == 0 else np.asarray(value)[i : i + 1] for name, value in arguments.items()}
        fates.append(fate_at(one, *cells, ramp_end=ramp_end, n_angle=_WAY))
        progress(i + 1)
    needed = np.vstack([fate.needed for fate in fates])
    shape = (theta0.size, phi.size)
    ratio = None if grip is None else needed / np.maximum(_evenly(grip), 1e-9)
    return FrictionField(
        phi, theta0, _quantiles(needed, (0.5,))[0].reshape(shape), None if ratio is None else _quantiles(ratio, LEVELS).reshape(len(LEVELS), *shape),
        np.mean(np.isinf(needed), axis=0).reshape(shape),
    )


def _evenly(draws: FloatArray) -> FloatArray:
    """(FIELD_DRAWS, 1) quantiles of draws (n_draw, 1) in steps of equal probability, in a mixed order."""
    order = (np.arange(FIELD_DRAWS) * _MIXING) % FIELD_DRAWS
    return np.quantile(draws, (order[:, None] + 0.5) / FIELD_DRAWS)


def _quantiles(values: FloatArray, levels: Sequence[float]) -> FloatArray:
    """(n_level, n_cell) quantiles over those draws (n_draw, n_cell) that are no nan; inf is the largest."""
    ordered, count = np.sort(values, axis=0), np.sum(~np.isnan(values), axis=0)
    found = [ordered[np.ceil(level * np.maximum(count - 1, 0)).astype(int), np.arange(count.size)] for level in levels]
    return np.where(count > 0, np.array(found), np.nan)
