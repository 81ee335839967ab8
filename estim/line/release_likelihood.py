"""The likelihood of trials of release, and its posterior.

With s = sin(phi) + c_rr cos(phi) a body at rest climbs between theta_min = asin(s/gamma) and
theta_max = pi - theta_min.  A hand that lets it go takes something away: the body climbs only where
it is set `release` >= 0 inside that range (paper, section IV: measured angles are "always bigger").
What differs from trial to trial is logistic, of standard deviation `scatter` (width w = sqrt(3)
scatter/pi):

    P(climb | theta, phi) = logistic((m - theta_min - release)/w)
    m = theta below 90 degrees, pi - theta above

The far end is left out: it matters only where theta_min comes within a few w of 90 degrees.  Where
s > gamma nothing climbs; theta_min goes on beyond 90 degrees as pi/2 + acos(2 - s/gamma), the
mirror image of its square-root edge.

The error of a tilt's reading is common to all trials at that tilt and integrated out.  The true
tilts are taken from a normal distribution whose mean and variance are those of the readings (less
u_phi^2, but not below it), plugged in: a true tilt is m + s z, z standard normal,

    m = mean + k (read - mean),   s = sqrt(k) u_phi,   k = spread^2/(spread^2 + u_phi^2),

by the trapezoid rule, which converges exponentially for so smooth an integrand.  With k = 1 shallow
lines are rewarded and gamma comes out too large, as for any line with errors in x
(`estim.line.posterior`): for the series of docs/statistics.md the 68 % intervals then cover 62 to
63 %.  Zero errors of the two scales are further unknowns.

Priors: gamma uniform in (0, 1), or one for each end (`split`); c_rr as the campaign states it;
release half-normal; scatter log-normal about the stated u_theta, known to a factor of 4 at 95 %.
With all refusals below all ascents the likelihood has no maximum in the scatter (the smaller, the
better, down to 0): it is bounded, so the posterior exists, and the prior states how closely an
angle can be set at all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, log_sum_exp
from estim.line.trial_data import HIGH, LOW, Tilt, Trials
from estim.model.phase_curve import effective_slope
from estim.problem import HalfNormal, LogNormal, Normal, Prior, Uniform

FACTOR = 4.0  # to which the stated u_theta is taken as known, 95 %
LOG_SD = math.log(FACTOR) / 1.959964
_REACH = 4.5  # standard deviations of a tilt that are integrated over
_MOST_NODES = 161
_BLOCK = 10_000  # draws times nodes at once: arrays that stay in the cache of a processor


@dataclass(frozen=True, eq=False)
class ReleasePosterior:
    """The posterior of gamma, c_rr, scatter, release and zero errors; a `Density` for the sampler.

    names : of the unknowns, in the order of the draws; angles in rad.
    priors : of each.  resistance : c_rr where it is exact, else nan.
    mean, shrinkage : mean of the tilts (rad) and k of the head of this file.
    nodes, log_weights : (n_node,) z, and log of their weights.
    """

    names: tuple[str, ...]
    trials: Trials
    priors: Mapping[str, Prior]
    resistance: float
    mean: float
    shrinkage: float
    nodes: FloatArray
    log_weights: FloatArray

    @property
    def support(self) -> tuple[FloatArray, FloatArray]:
        """(n_par,) lowest and highest values."""
        return np.array([self.priors[name].low for name in self.names]), np.array(
            [self.priors[name].high for name in self.names]
        )

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log of likelihood times prior at draws (n_draw, n_par), normalised in the data;
        -inf outside the support.
        """
        values = {name: draws[:, i] for i, name in enumerate(self.names)}
        total = np.sum([self.priors[name].log_density(values[name]) for name in self.names], axis=0)
        inside = np.flatnonzero(np.isfinite(total))
        for rows in np.array_split(
            inside, max(1, math.ceil(inside.size * self.nodes.size / _BLOCK))
        ):
            total[rows] += self.log_likelihood(
                {name: column[rows] for name, column in values.items()}
            )
        return total

    def log_likelihood(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """(n_draw,) log probability of the outcomes; values : name -> (n_draw,) inside the
        support.
        """
        total = np.zeros(next(iter(values.values())).size)
        for tilt in self.trials.tilts:
            phi = self.true_tilts(tilt.phi)
            at_nodes = np.zeros((total.size, self.nodes.size))
            for end in (LOW, HIGH):
                part = tilt.end(end)
                if part.theta.size:
                    start = effective_start(values, end, phi, self.resistance)
                    at_nodes += outcomes(
                        part, end, start, values["scatter"][:, None], values.get("zero_theta")
                    )
            total += log_sum_exp(at_nodes + self.log_weights, axis=1)
        return total

    def true_tilts(self, read: float) -> FloatArray:
        """(n_node,) rad, true tilts of a reading at the nodes."""
        return (
            self.mean
            + self.shrinkage * (read - self.mean)
            + math.sqrt(self.shrinkage) * self.trials.u_phi * self.nodes
        )


def effective_start(
    values: Mapping[str, FloatArray], end: str, phi: FloatArray, resistance: float
) -> FloatArray:
    """(n_draw, n_phi) rad: theta_min + release at true tilts `phi` (n_phi,), but for a common zero
    error of their scale.

    values : unknowns (n_draw,) by name; c_rr is `resistance` where it is none of them.
    """
    gamma = values["gamma"] if "gamma" in values else values[f"gamma_{end}"]
    zero = values.get("zero_phi", np.zeros(1))[:, None]
    slope = effective_slope(
        phi - zero, values.get("rolling_resistance", np.full(1, resistance))[:, None]
    )
    return start_angle(slope / gamma[:, None]) + values.get("release", np.zeros(1))[:, None]


def start_angle(sine: FloatArray) -> FloatArray:
    """theta_min (rad) for s/gamma = `sine`, continued beyond 90 degrees where nothing climbs."""
    return np.where(
        sine <= 1.0,
        np.arcsin(np.clip(sine, -1.0, 1.0)),
        0.5 * np.pi + np.arccos(np.clip(2.0 - sine, -1.0, 1.0)),
    )


def outcomes(
    part: Tilt, end: str, start: FloatArray, scatter: FloatArray, zero_theta: FloatArray | None
) -> FloatArray:
    """(n_draw, n_node) log probability of the outcomes at one end of a tilt, of starts (n_draw,
    n_node) and scatters (n_draw, 1).
    """
    angles, which = np.unique(part.theta, return_inverse=True)
    rose = np.bincount(which, weights=part.climbed, minlength=angles.size)
    stayed = np.bincount(which, weights=~part.climbed, minlength=angles.size)
    inside, sign = (angles, 1.0) if end == LOW else (np.pi - angles, -1.0)
    shift = start if zero_theta is None else start + sign * zero_theta[:, None]
    per_width = math.pi / (math.sqrt(3.0) * scatter)
    total = np.zeros(start.shape)
    for angle, n_rose, n_stayed in zip(inside, rose, stayed, strict=True):
        z = (angle - shift) * per_width
        at = np.abs(z)
        # log P(climb) = (z - |z|)/2 - soft, log P(not) = (-z - |z|)/2 - soft, soft = log(1 +
        # exp(-|z|))
        soft = np.log1p(np.exp(-at))
        n = n_rose + n_stayed
        total += 0.5 * (n_rose - n_stayed) * z - (0.5 * n) * at - n * soft
    return total


def release_posterior(
    trials: Trials, resistance: Prior | float, *, split: bool = False
) -> ReleasePosterior:
    """The posterior of trials.

    resistance : prior of c_rr, or its exact value.
    split : gamma_min and gamma_max in place of one gamma.
    """
    gammas = ("gamma_min", "gamma_max") if split else ("gamma",)
    priors: dict[str, Prior] = {name: Uniform(0.0, 1.0) for name in gammas}
    if not isinstance(resistance, float):
        priors["rolling_resistance"] = resistance
    priors["scatter"] = LogNormal(trials.u_theta, LOG_SD)
    if trials.release > 0.0:
        priors["release"] = HalfNormal(trials.release)
    for name, u in (("zero_phi", trials.u_zero_phi), ("zero_theta", trials.u_zero_theta)):
        if u > 0.0:
            priors[name] = Normal(0.0, u)
    nodes, (mean, shrinkage) = _nodes(trials), _tilts_of(trials)
    weights = np.exp(-0.5 * nodes**2)
    return ReleasePosterior(
        tuple(priors),
        trials,
        priors,
        resistance if isinstance(resistance, float) else math.nan,
        mean,
        shrinkage,
        nodes,
        np.log(weights / weights.sum()),
    )


def _tilts_of(trials: Trials) -> tuple[float, float]:
    """Mean of the tilts (rad), and k: 1 for exact readings, and for a single tilt."""
    read = np.array([tilt.phi for tilt in trials.tilts])
    if read.size < 2 or trials.u_phi == 0.0:
        return float(read.mean()) if read.size else 0.0, 1.0
    spread2 = max(float(read.var(ddof=1)) - trials.u_phi**2, trials.u_phi**2)
    return float(read.mean()), spread2 / (spread2 + trials.u_phi**2)


def _nodes(trials: Trials) -> FloatArray:
    """Deviations of a tilt in units of u_phi, close enough for the least scatter that the prior
    allows (2.5 %).

    theta_min moves by cos(phi)/(gamma cos(theta_min)) for each radian of tilt; the logistic has its
    poles pi w = sqrt(3) scatter away.
    """
    if trials.u_phi == 0.0:
        return np.zeros(1)
    smallest = math.sqrt(3.0) * trials.u_theta / FACTOR
    pole = min(
        smallest / (trials.u_phi * _steepness(tilt, rough_gamma(trials))) for tilt in trials.tilts
    )
    # step over the distance of the integrand's nearest pole: an error of exp(-2 pi/1.3) = 0.8 %
    # where the scatter is smallest
    n_node = 2 * math.ceil(_REACH / min(1.3 * pole, 0.7)) + 1
    return np.linspace(-_REACH, _REACH, min(n_node, _MOST_NODES))


def _steepness(tilt: Tilt, gamma: float) -> float:
    sine = min(abs(math.sin(tilt.phi)) / gamma, 0.95)
    return math.cos(tilt.phi) / (gamma * math.sqrt(1.0 - sine**2))


def rough_gamma(trials: Trials) -> float:
    """sin(phi)/sin(theta) halfway between the outcomes, the middle one of all tilts; for starting
    values only.
    """
    gammas = []
    for tilt in trials.tilts:
        inside = np.minimum(tilt.theta, np.pi - tilt.theta)
        highest = float(np.max(inside[~tilt.climbed], initial=0.0))
        lowest = float(np.min(inside[tilt.climbed], initial=0.5 * np.pi))
        gammas.append(abs(math.sin(tilt.phi)) / max(math.sin(0.5 * (highest + lowest)), 1e-3))
    return min(max(float(np.median(gammas)), 0.01), 0.9)
