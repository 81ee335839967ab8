"""Which rows of a run are fit, and why the others are not.

- Outside the `window` of the campaign: left out.
- For speeds made by differences, within five standard deviations of a position reading from the
  release or from the turning point: there the curve bends so sharply that an error of the position
  moves the speed by more than a linear law allows.  A window that names that end (`x_min_m = 0`)
  keeps them.
- After the largest position reached, where speeds are fit: the way back is another motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray
from estim.campaign.lookup_levels import Levels
from estim.common import Finding, InputError, Kind
from estim.discrepancy import GUARD
from estim.reading import Run
from estim.words import describe

_MIN_OBS = 5
MAX_OBS = 10_000


@dataclass(frozen=True)
class Window:
    """Limits of time (s) and position (m or rad); -inf or inf where open."""

    t_min: float
    t_max: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Selection:
    """indices : (n,) indices of the speeds to fit.  reasons : why and how many others were left out
    (`Finding.size`).
    """

    indices: IntArray
    reasons: tuple[Finding, ...]


def way_back(reasons: Sequence[Finding]) -> int:
    """How many frames were left out as those of the way back."""
    return sum(int(finding.size) for finding in reasons if finding.kind is Kind.WAY_BACK)


def select(
    position: FloatArray,
    speed: FloatArray | None,
    t: FloatArray | None,
    *,
    window: Window,
    sigma_position: float,
) -> Selection:
    """The rows to fit out of (n,) positions, speeds and times.

    `sigma_position` 0 switches the guard zones off.  Without speeds it is the positions that are
    fit, on every way.
    """
    selected = np.ones(position.size, dtype=bool)
    reasons: list[Finding] = []

    def leave_out(mask: BoolArray, why: Kind) -> None:
        nonlocal selected
        count = int(np.sum(mask & selected))
        if count:
            reasons.append(Finding(why, size=count))
        selected &= ~mask

    if t is not None:
        leave_out((t < window.t_min) | (t > window.t_max), Kind.OUTSIDE_TIMES)
    leave_out((position < window.low) | (position > window.high), Kind.OUTSIDE_POSITIONS)
    inside = np.flatnonzero(selected)
    if inside.size and speed is not None:
        farthest = inside[np.argmax(position[inside])]
        if t is not None:
            leave_out(t > t[farthest], Kind.WAY_BACK)
        guard = GUARD * sigma_position
        if guard > 0.0 and not np.isfinite(window.low):
            leave_out(position < guard, Kind.BESIDE_RELEASE)
        # of the largest speed: slower than this at its farthest, a body is taken to have turned
        # there
        slow = abs(speed[farthest]) < 0.25 * np.max(np.abs(speed[inside]))
        if guard > 0.0 and slow and not np.isfinite(window.high):
            leave_out(position > position[farthest] - guard, Kind.BESIDE_TURNING)
    return Selection(np.flatnonzero(selected), tuple(reasons))


def check_count(
    selection: Selection,
    run: Run,
    levels: Levels,
    blank: tuple[Finding, ...] = (),
    *,
    most: int = MAX_OBS,
) -> None:
    """As many rows as can be fit are left; raises InputError at the window that is stated, or with
    what else left rows out.
    """
    count = selection.indices.size
    if _MIN_OBS <= count <= most:
        return
    stated = levels.first("window")
    if stated is not None:
        rule = (
            f"must leave between {_MIN_OBS} and {most} of the {run.n_row} rows of {run.file} to fit"
        )
        raise levels.error(rule, (*stated.path, "window"), value=count)
    if count > most:
        raise InputError(
            f"must be at most {most}: state a window for run '{run.name}'",
            field="rows to fit",
            value=count,
            file=run.file,
        )
    position = run.position
    if np.max(position) - position[0] <= 0.1 * np.ptp(position):
        raise InputError(
            "must increase as the body moves from its release: it does not rise above its "
            "first value by a tenth of its range",
            field=run.coordinate,
            value=f"{position[0]:.6g} to {position[-1]:.6g}",
            file=run.file,
        )
    why = "; ".join(map(describe, (*blank, *selection.reasons))) or "the file has no more"
    raise InputError(
        f"must be at least {_MIN_OBS} of the {run.n_row} in the file ({why})",
        field="rows to fit",
        value=count,
        file=run.file,
    )
