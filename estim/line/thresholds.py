"""The angle at which ascents begin, at each tilt by itself: no line is assumed, only one scatter for all.

With L_j(t, scatter) the likelihood of the trials at one end of one tilt and a prior of the threshold t uniform between 0 and 90 degrees,

    p(scatter | all) ~ prior(scatter) prod_j E_j(scatter),   E_j = mean over t of L_j,    p(t_j | all) = sum over scatter of p(scatter | all) L_j/E_j,

on a grid: no draws.  What comes out is the angle as it is measured, with the release in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.line.release import LOG_SD, outcomes
from estim.line.trials import HIGH, LOW, Trials

_N_SCATTER, _REACH = 41, 3.5  # nodes, and how far they reach in prior sds
_STEP, _SHARE = math.radians(0.1), 0.1  # of the grid of angles: this, or this share of u_theta where that is smaller
_MOST = 9001
QUANTILES = (0.025, 0.16, 0.5, 0.84, 0.975)


@dataclass(frozen=True, eq=False)
class Threshold:
    """Where ascents begin at one tilt.

    end : "min" or "max".  phi : rad.  n_trial, n_climbed : trials at that end.
    quantiles : (5,) rad, at 2.5, 16, 50, 84, 97.5 %, angles from the vertical.  Where all trials climbed or none did, the prior is one of the ends.
    """

    end: str
    phi: float
    n_trial: int
    n_climbed: int
    quantiles: FloatArray

    @property
    def bracketed(self) -> bool:
        """Whether both outcomes were seen."""
        return 0 < self.n_climbed < self.n_trial


def thresholds(trials: Trials) -> tuple[Threshold, ...]:
    """The threshold at each end of each tilt where there are trials, by end and tilt."""
    parts = [(end, part) for end in (LOW, HIGH) for tilt in trials.tilts if (part := tilt.end(end)).theta.size]
    n_angle = min(math.ceil(0.5 * np.pi / min(_STEP, _SHARE * trials.u_theta)) + 1, _MOST)
    angles = np.linspace(0.0, 0.5 * np.pi, n_angle)
    deviations = np.linspace(-_REACH, _REACH, _N_SCATTER)
    scatter = trials.u_theta * np.exp(LOG_SD * deviations)[:, None]
    starts = np.broadcast_to(angles, (_N_SCATTER, n_angle))
    log_likelihoods = [outcomes(part, end, starts, scatter, None) for end, part in parts]
    heights = [log.max(axis=1, keepdims=True) for log in log_likelihoods]
    shapes = [np.exp(log - height) for log, height in zip(log_likelihoods, heights, strict=True)]
    areas = [shape.mean(axis=1, keepdims=True) for shape in shapes]
    log_weight = -0.5 * deviations**2 + sum(h[:, 0] + np.log(a[:, 0]) for h, a in zip(heights, areas, strict=True))
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    found = []
    for (end, part), shape, area in zip(parts, shapes, areas, strict=True):
        density = weight @ (shape / area)
        below = np.cumsum(density) - 0.5 * (density + density[0])
        at = np.interp(QUANTILES, below / below[-1], angles)
        found.append(
            Threshold(end, part.phi, part.theta.size, int(np.count_nonzero(part.climbed)), at if end == LOW else np.pi - at[::-1])
        )
    return tuple(found)
