"""The angle at which ascents begin, at each tilt by itself: no line is assumed, only the scatter of
all trials.

With L(t, scatter) the likelihood of the trials at one end of one tilt and a prior of the threshold
t uniform between 0 and 90 degrees,

    p(t | trials) = mean over scatter of L(t, scatter)/integral of L(t', scatter) dt'

on a grid of t, over values of the scatter as the fit of all trials gives it: no draws.  A few
trials cannot determine their own scatter: under a uniform prior of t one ascent among refusals
would do for a scatter of 20 degrees and a threshold far above.  What comes out is the angle as it
is measured, with the release in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import QUANTILES
from estim.line.release_likelihood import outcomes
from estim.line.trial_data import HIGH, LOW, Trials

_N_SCATTER = 40  # values of the scatter, equally probable
# of the grid of angles: this, or this share of u_theta where that is smaller
_STEP, _SHARE = math.radians(0.1), 0.1


@dataclass(frozen=True, eq=False)
class Threshold:
    """Where ascents begin at one tilt.

    end : "min" or "max".
    phi : rad.  n_trial, n_climbed : trials at that end.
    quantiles : (5,) rad, at 2.5, 16, 50, 84, 97.5 %, angles from the vertical.  Where all trials
        climbed or none did, the prior is one of the ends.
    """

    end: str
    phi: float
    n_trial: int
    n_climbed: int
    quantiles: FloatArray


def thresholds(trials: Trials, scatter: FloatArray) -> tuple[Threshold, ...]:
    """The threshold at each end of each tilt where there are trials, by end and tilt.

    scatter : (n_draw,) rad, draws of the standard deviation from trial to trial.
    """
    n_angle = min(
        math.ceil(0.5 * np.pi / min(_STEP, _SHARE * float(np.quantile(scatter, 0.01)))) + 1, 9001
    )
    angles = np.linspace(0.0, 0.5 * np.pi, n_angle)
    spread = np.quantile(scatter, (np.arange(_N_SCATTER) + 0.5) / _N_SCATTER)[:, None]
    starts = np.broadcast_to(angles, (_N_SCATTER, n_angle))
    results = []
    for end in (LOW, HIGH):
        for part in trials.end(end).tilts:
            logs = outcomes(part, end, starts, spread, None)
            shapes = np.exp(logs - logs.max(axis=1, keepdims=True))
            density = np.mean(shapes / shapes.sum(axis=1, keepdims=True), axis=0)
            below = np.cumsum(density) - 0.5 * density
            at = np.interp(QUANTILES, below / below[-1], angles)
            at = at if end == LOW else np.pi - at[::-1]
            results.append(
                Threshold(end, part.phi, part.theta.size, int(np.count_nonzero(part.climbed)), at)
            )
    return tuple(results)
