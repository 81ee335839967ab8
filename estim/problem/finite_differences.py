"""Speeds from positions: the linear stencils in use, where each can be applied, and what truncation
does to its mean.

v_i = (1/dt) sum_k w_k x_{i+k}

- `central` (x[+1] - x[-1])/(2 dt): the midpoint rule of the paper and the default of the program
  Tracker.
- `five-point` (x[-2] - 8 x[-1] + 8 x[+1] - x[+2])/(12 dt): smaller truncation, more noise.
- `spill2` (2 x[+2] + x[+1] - x[-1] - 2 x[-2])/(10 dt): least squares over five frames, least noise,
  most truncation.

Neighbouring speeds share positions, so their errors are correlated; the matrix of the stencil says
exactly how.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.sparse import csr_array

from estim.arrays import FloatArray, IntArray
from estim.common import InputError, later
from estim.problem.differences import in_rows


@dataclass(frozen=True)
class Stencil:
    """A linear derivative: offsets in frames, weights per frame interval.

    The mean of its result is v + truncation * dt^order * d^order v/dt^order to the leading order.
    """

    name: str
    offsets: tuple[int, ...]
    weights: tuple[float, ...]
    order: int
    truncation: float

    @property
    def noise_gain(self) -> float:
        """Standard deviation of the result for unit independent errors of the positions, times
        dt.
        """
        return float(np.sqrt(np.sum(np.square(self.weights))))


STENCILS: Mapping[str, Stencil] = MappingProxyType(
    {
        "central": Stencil(later("central"), (-1, 1), (-1 / 2, 1 / 2), 2, 1 / 6),
        "five-point": Stencil(
            later("five-point"), (-2, -1, 1, 2), (1 / 12, -8 / 12, 8 / 12, -1 / 12), 4, -1 / 30
        ),
        "spill2": Stencil("spill2", (-2, -1, 1, 2), (-2 / 10, -1 / 10, 1 / 10, 2 / 10), 2, 17 / 30),
    }
)


@dataclass(frozen=True, eq=False)
class Derivative:
    """Speeds of a run.

    rows : (n_obs,) rows of the run at which every neighbour exists.
    value : (n_obs,) derivative there, unit of position per second.
    matrix : with value = matrix @ position, 1/s.
    interval : the frame interval dt, s.
    """

    stencil: Stencil
    rows: IntArray
    value: FloatArray
    matrix: csr_array
    interval: float


def differentiate(
    t: FloatArray,
    position: FloatArray,
    stencil: Stencil,
    *,
    file: str = "data",
    lines: IntArray | None = None,
) -> Derivative:
    """Derivative of `position` (n_row,) at equally spaced times `t` (n_row,) s, where frames may be
    missing.

    A speed next to a missing frame does not exist and is left out, as Tracker leaves it blank.
    Raises InputError where the steps of time are no multiples of one interval.
    """
    interval, frame = _frames(t, file=file, lines=lines)
    neighbours = frame[:, None] + np.array(stencil.offsets)
    rows = np.flatnonzero(np.all(np.isin(neighbours, frame), axis=1))
    if not rows.size:
        raise InputError(
            f"leaves no frame with the neighbours that the {stencil.name} derivative needs",
            field="t_s",
            file=file,
        )
    weights = np.tile(np.array(stencil.weights) / interval, (rows.size, 1))
    matrix = in_rows(np.searchsorted(frame, neighbours[rows]), weights, t.size)
    value = matrix @ position
    for array in (rows, value, matrix.indices, matrix.data):
        array.setflags(write=False)
    return Derivative(stencil, rows, value, matrix, interval)


def _frames(t: FloatArray, *, file: str, lines: IntArray | None) -> tuple[float, IntArray]:
    """The frame interval (s) and the frame number of each row."""
    steps = np.diff(t)
    counts = np.rint(steps / np.median(steps))
    if np.all(counts >= 1):
        interval = float((t[-1] - t[0]) / counts.sum())
        deviations = np.abs(steps - counts * interval) / interval
        # of a frame interval: what rounding a time to a few decimals may cost
        if np.all(deviations <= 0.1):
            return interval, np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    else:
        deviations = np.where(counts >= 1, 0.0, 1.0)
    row = int(np.argmax(deviations)) + 1
    raise InputError(
        "must advance by equal steps (or whole multiples of one step) for a derivative by "
        "differences",
        field="t_s",
        value=float(t[row]),
        file=file,
        line=None if lines is None else int(lines[row]),
    )
