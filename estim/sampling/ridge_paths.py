"""Ways along the ridge of a density: one parameter is led from the mode outwards, all later ones re-optimised (`estim.sampling.ridge`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.sampling.ridge import Frame, climb

IntArray = NDArray[np.int64]

_MOST_STEPS = 60  # of a walk, those taken back included


class Panels(NamedTuple):
    """One step of each of some walks.

    row : (n,) which walk.  left, right : (n, n_par) points at either end.  left_mass, right_mass : (n,) log masses there.
    precisions : (n, n_free, n_free) at the outer end.
    """

    row: IntArray
    left: FloatArray
    right: FloatArray
    left_mass: FloatArray
    right_mass: FloatArray
    precisions: FloatArray


@dataclass(frozen=True)
class Rule:
    """How fine.

    depth : to which the log of the density is followed.  fall : of a step at the mode; more by 1 for each unit of depth.
    tolerance : relative, of a panel.
    least : step in scales below which a walk ends: before a jump.  quick : second derivatives are taken once where that will do (`climb`).
    """

    depth: float
    fall: float
    tolerance: float
    least: float = 1e-7
    quick: bool = False


def walk(
    frame: Frame, axis: int, start: FloatArray, start_masses: FloatArray, top: float | FloatArray, direction: float | FloatArray, rule: Rule
) -> tuple[list[Panels], bool]:
    """Steps from `start` (n, n_par) on, and whether a walk found no end.

    top, direction : one, or (n,).  frame : one, or n stacked.  All walks advance together.
    """
    tops, sense = np.broadcast_to(top, len(start)), np.broadcast_to(direction, len(start))
    upwards = sense > 0.0
    edge = np.where(upwards, frame.high[..., axis], frame.low[..., axis])
    active = np.arange(len(start))
    here, mass = start.copy(), start_masses.copy()
    before = start.copy()
    first = np.broadcast_to(frame.factor[..., axis, axis], len(start))
    along = np.broadcast_to(_along(frame, axis), start.shape)
    step = first.copy()
    at_zero = np.zeros(len(start), dtype=bool)  # nothing lies behind: a limit that nobody stated
    panels: list[Panels] = []
    open_end = np.zeros(len(start), dtype=bool)  # a walk ended too early
    for _ in range(_MOST_STEPS):
        active = active[(np.abs(edge - here[:, axis]) > 1e-12 * first)[active] & (mass > tops - rule.depth)[active]]
        small = step[active] <= rule.least * first[active]
        open_end[active[small & ~at_zero[active]]] = True  # before a jump: what lies behind it is not known
        active = active[~small]
        if active.size == 0:
            break
        own = frame.rows(active)
        here_, step_, up = here[active], step[active], upwards[active]
        at = here_[:, axis] + sense[active] * step_
        at = np.where(up, np.minimum(at, edge[active]), np.maximum(at, edge[active]))
        length = here_[:, axis] - before[active, axis]
        slope = np.where((length != 0.0)[:, None], (here_ - before[active]) / np.where(length == 0.0, 1.0, length)[:, None], along[active])
        guess = here_ + slope * (at - here_[:, axis])[:, None]
        guess[:, : axis + 1] = here_[:, : axis + 1]
        guess[:, axis] = at
        guess[:, axis + 1 :] = np.clip(guess[:, axis + 1 :], own.low[..., axis + 1 :], own.high[..., axis + 1 :])
        found = climb(own, guess, axis + 1, otherwise=here_, quick=rule.quick)
        masses = found.log_masses
        allowed = rule.fall + (tops - mass)[active].clip(0.0)
        fall = mass[active] - masses
        at_zero[active] = np.isneginf(masses)
        taken = np.isfinite(masses) & (fall <= 1.5 * allowed)
        where = active[taken]
        inner, outer, inner_mass, outer_mass, up = here_[taken], found.points[taken], mass[where], masses[taken], up[taken]
        ends = np.where(up[:, None], inner, outer), np.where(up[:, None], outer, inner)
        heights = np.where(up, inner_mass, outer_mass), np.where(up, outer_mass, inner_mass)
        panels.append(Panels(where, *ends, *heights, found.precisions[taken]))
        before[where], here[where], mass[where] = inner, outer, outer_mass
        with np.errstate(divide="ignore", invalid="ignore"):
            better = np.sqrt(allowed / np.maximum(np.abs(fall), 1e-3))
        step[active] = step_ * np.where(taken, np.clip(better, 0.4, 2.0), np.where(np.isfinite(fall), np.clip(0.8 * better, 0.1, 0.5), 0.25))
    open_end[active] = True
    return panels, bool(np.any(mass[open_end] > tops[open_end] - 0.5 * rule.depth))


def _along(frame: Frame, axis: int) -> FloatArray:
    """(n_par,) how the inner parameters follow this one in the frame's covariance; (n, n_par) for n stacked frames."""
    column = np.zeros(frame.centre.shape)
    column[..., axis:] = frame.factor[..., axis:, axis] / frame.factor[..., axis, axis, None]
    return column


def follow(frames: Frame, rule: Rule) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Points of the ridges along the first parameter of n stacked frames, both ways from their centres at once.

    Returned: (n_point,) the frame of each; points (n_point, n_par), frame by frame, from end to end; their log masses (n_point,) relative to
    that of their mode; the precisions (n_point, n_par - 1, n_par - 1) of the other parameters there.
    """
    n = len(frames.centre)
    top = climb(frames, frames.centre, 1, n_step=0)
    whose = np.repeat(np.arange(n), 2)
    sense = np.tile([-1.0, 1.0], n)
    panels, _ = walk(frames.rows(whose), 0, top.points[whose], top.log_masses[whose], top.log_masses[whose], sense, rule)
    rows, points, masses, precisions = [np.arange(n)], [top.points], [top.log_masses], [top.precisions]
    for panel in panels:
        up = sense[panel.row] > 0.0
        rows.append(whose[panel.row])
        points.append(np.where(up[:, None], panel.right, panel.left))
        masses.append(np.where(up, panel.right_mass, panel.left_mass))
        precisions.append(panel.precisions)
    row, way, heights = np.concatenate(rows), np.concatenate(points), np.concatenate(masses)
    order = np.lexsort((way[:, 0], row))
    row = row[order]
    return row, way[order], heights[order] - top.log_masses[row], np.concatenate(precisions)[order]
