"""Ways along the ridge of a density: one parameter is led from the mode outwards, all later ones re-optimised (`estim.sampling.ridge`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.sampling.ridge import Frame, climb

IntArray = NDArray[np.int64]
Panels = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]

_MOST_STEPS = 60  # of a walk, those taken back included


@dataclass(frozen=True)
class Rule:
    """How fine.

    depth : to which the log of the density is followed.  fall : of a step at the mode; more by 1 for each unit of depth.
    tolerance : relative, of a panel.
    """

    depth: float
    fall: float
    tolerance: float


def walk(
    frame: Frame, axis: int, start: FloatArray, start_masses: FloatArray, top: float, direction: float, rule: Rule
) -> tuple[list[Panels], bool]:
    """Panels (row, points at the left and the right end, log masses there) from `start` (n, n_par) on in one direction."""
    edge = frame.high[axis] if direction > 0.0 else frame.low[axis]
    active = np.arange(len(start))
    here, mass = start.copy(), start_masses.copy()
    before = start.copy()
    first = frame.factor[axis, axis]
    step = np.full(len(start), first)
    at_zero = np.zeros(len(start), dtype=bool)  # nothing lies behind: a limit that nobody stated
    panels: list[Panels] = []
    lost = -np.inf  # log mass where a walk ended too early
    for _ in range(_MOST_STEPS):
        active = active[(np.abs(edge - here[active, axis]) > 1e-12 * first) & (mass[active] > top - rule.depth)]
        stuck = active[(step[active] <= 1e-7 * first) & ~at_zero[active]]  # before a jump: what lies behind it is not known
        lost = max(lost, *mass[stuck], -np.inf)
        active = active[step[active] > 1e-7 * first]
        if active.size == 0:
            break
        here_, step_ = here[active], step[active]
        at = here_[:, axis] + direction * step_
        at = np.minimum(at, edge) if direction > 0.0 else np.maximum(at, edge)
        length = here_[:, axis] - before[active, axis]
        slope = np.where((length != 0.0)[:, None], (here_ - before[active]) / np.where(length == 0.0, 1.0, length)[:, None], _along(frame, axis))
        guess = here_ + slope * (at - here_[:, axis])[:, None]
        guess[:, : axis + 1] = here_[:, : axis + 1]
        guess[:, axis] = at
        guess[:, axis + 1 :] = np.clip(guess[:, axis + 1 :], frame.low[axis + 1 :], frame.high[axis + 1 :])
        nowhere = ~np.isfinite(frame.heights(guess))
        guess[nowhere, axis + 1 :] = here_[nowhere, axis + 1 :]
        found = climb(frame, guess, axis + 1)
        masses = found.log_masses
        allowed = rule.fall + (top - mass[active]).clip(0.0)
        fall = mass[active] - masses
        at_zero[active] = np.isneginf(masses)
        taken = np.isfinite(masses) & (fall <= 1.5 * allowed)
        where = active[taken]
        ends = (here_[taken], found.points[taken]) if direction > 0.0 else (found.points[taken], here_[taken])
        values = (mass[where], masses[taken]) if direction > 0.0 else (masses[taken], mass[where])
        panels.append((where, *ends, *values))
        before[where], here[where], mass[where] = here_[taken], found.points[taken], masses[taken]
        with np.errstate(divide="ignore", invalid="ignore"):
            better = np.sqrt(allowed / np.maximum(np.abs(fall), 1e-3))
        step[active] = step_ * np.where(taken, np.clip(better, 0.4, 2.0), np.where(np.isfinite(fall), np.clip(0.8 * better, 0.1, 0.5), 0.25))
    return panels, max(lost, *mass[active], -np.inf) > top - 0.5 * rule.depth


def _along(frame: Frame, axis: int) -> FloatArray:
    """(n_par,) how the inner parameters follow this one in the frame's covariance."""
    column = np.zeros(frame.n_par)
    column[axis:] = frame.factor[axis:, axis] / frame.factor[axis, axis]
    return column


def follow(frame: Frame, rule: Rule) -> tuple[FloatArray, FloatArray]:
    """Points (n, n_par) of the ridge along the frame's first parameter, from end to end, and their log masses relative to that of the mode."""
    top = climb(frame, frame.centre[None], 1, n_step=0)
    highest = float(top.log_masses[0])
    points, masses = [top.points], [top.log_masses]
    for direction in (-1.0, 1.0):
        panels, _ = walk(frame, 0, top.points, top.log_masses, highest, direction, rule)
        for _, left, right, left_mass, right_mass in panels:
            points.append(right if direction > 0.0 else left)
            masses.append(right_mass if direction > 0.0 else left_mass)
    way, heights = np.concatenate(points), np.concatenate(masses)
    order = np.argsort(way[:, 0])
    return way[order], heights[order] - highest
