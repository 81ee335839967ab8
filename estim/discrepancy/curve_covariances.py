"""What a user's own curve lacks: a smooth deviation of y along x, or errors of readings that are
correlated in time.

- `deviation_shapes`: y = f(x) + d(x), d smooth over some part of the range of x (Matern-3/2).
- `correlated_shapes`: errors whose neighbours are correlated, AR(1) in continuous time, beside
  white ones.

Both go into `diagonalise`, alone or together (`equally_probable`), each times the scale of its
amplitude (`Shape.times`), with `relative_grid`.

Nothing is taken out of d, neither its mean nor its slope: every parameter keeps the meaning that it
has in the formula, and what a deviation has in common with the curve makes its parameters less
certain.  Where the curve has a constant of its own, all other parameters are the same as with the
mean of d taken out; where it has none, taking it out would claim that the curve is right on
average.

The rule of the stated error: where the residuals are far smaller than stated nothing is narrowed
(`linearised` ensures that), and `stated_is_conservative` reports it.  (A pattern of 3.5 mm under a
stated 5 cm has no information on errors that all points share: narrowed to it, 68 % intervals cover
33-58 %.)  Where no size of the errors was stated, the residuals determine it: all sizes are equally
probable beforehand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.discrepancy.grid import SCALES, Grid, prior_grid, track_lengths
from estim.discrepancy.kernels import distances, exponential, matern32, root
from estim.discrepancy.linearised import Linearised
from estim.discrepancy.scale_mixture import Shape

DEVIATION, TIME = "deviation", "time"
# where an error may be stated for what no residual shows
FREE_SCALES = (0.01, 0.016, 0.025, 0.04, 0.063, *SCALES)
# sizes of unstated errors, in units of the residuals' standard deviation
_SMALLEST, _LARGEST, _N_SIZE = 0.01, 1.6, 60
_CONSERVATIVE = 0.5  # a stated error is conservative where the white noise is less than half of it
# of the range of x, or of the recording: a trend, as a wrong curve leaves
LONG = {DEVIATION: 0.25, TIME: 1.0 / 3.0}
_SURE = 0.95
# of the duration: with a third, intervals under AR(1) errors of .9 and 40 points are too short
_N_TIME, _PART_OF_TIME = 6, 0.5
_SPIKE = 0.2  # probability of no deviation beforehand: who asks for one has a reason


def relative_grid(*, stated: bool, spike: float = _SPIKE) -> Grid:
    """The grid of amplitudes in units of their scale, and of sizes of the noise in units of what
    was stated, or of the residuals.

    stated : whether the size of the errors was stated; else all sizes are equally probable in their
        logarithm.
    spike : probability of no deviation.
    """
    # 17 amplitudes, as of a force, made a standard deviation 3 % too small
    grid = prior_grid(1.0, spike=spike, scales=FREE_SCALES, n_amplitude=24)
    if stated:
        return grid
    sizes = np.geomspace(_SMALLEST, _LARGEST, _N_SIZE)
    return replace(grid, scales=sizes, log_scales=np.full(_N_SIZE, -np.log(_N_SIZE)))


def deviation_shapes(x: FloatArray) -> tuple[Shape, ...]:
    """Smooth deviations along x (n_obs,), over lengths about a sixth of its range."""
    separations = distances(x)
    lengths, log_prior = track_lengths(_extent(x, "x"))
    return tuple(
        Shape(DEVIATION, float(length), root(matern32(separations, float(length))), float(log))
        for length, log in zip(lengths, log_prior, strict=True)
    )


def correlated_shapes(t: FloatArray) -> tuple[Shape, ...]:
    """Errors correlated in time t (n_obs,), exp(-dt/l): lengths from the typical step, but
    at least a thousandth of the duration, to half of the duration, equally probable.
    """
    separations = distances(t)
    extent = _extent(t, "t")
    step = float(np.median(np.diff(np.sort(t))))
    lengths = np.geomspace(max(step, 1e-3 * extent), _PART_OF_TIME * extent, _N_TIME)
    return tuple(
        Shape(
            TIME,
            float(length),
            root(exponential(separations, float(length))),
            -float(np.log(_N_TIME)),
        )
        for length in lengths
    )


def equally_probable(*groups: tuple[Shape, ...]) -> tuple[Shape, ...]:
    """The shapes of several groups, each group with the same prior probability."""
    return tuple(
        replace(shape, log_prior=shape.log_prior - float(np.log(len(groups))))
        for group in groups
        for shape in group
    )


def stated_is_conservative(linearised: Linearised) -> bool:
    """Whether readings scatter, with all deviations, probably (> 0.95) by less than half of what
    was stated for them.
    """
    deviation = linearised.deviation
    spread = [f.amplitude**2 * np.sum(f.spectrum) / deviation.n_obs for f in deviation.families]
    total = np.square(linearised.scales) + np.concatenate(spread)
    return bool(linearised.weights[total < _CONSERVATIVE**2].sum() > _SURE)


def _extent(x: FloatArray, name: str) -> float:
    extent = float(np.ptp(x))
    if not extent > 0.0:
        raise InputError("must not be all the same", field=name, value=float(x[0]))
    return extent
