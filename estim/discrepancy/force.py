"""A force along the track that the curve does not know, and what it does to speeds and positions.

    D v^2/2 = acceleration (E0 + W + F)
    F(x) = int_0^x f dx'        f in units of the weight

    energies of speeds at given positions    delta (v^2)/(2 v) = acceleration (E0 + F)/(D v)
                                             exact: `estim.discrepancy.residuals`
    positions at given times                 to first order: `estim.discrepancy.in_time`

Positions are metres with `acceleration` g, or rad with g/R for a turning wheel (v then rad/s,
lengths rad); D is the inertia of the body per unit mass, twice the kinetic energy over m v^2 (the
`energies` of a motion at unit speed).  E0 is the energy at release in units of the weight, times
one unit of position: a push, or a reading of the position at release that is not 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from estim.arrays import FloatArray
from estim.common import InputError
from estim.discrepancy.grid import track_lengths
from estim.discrepancy.kernels import distances, matern32, root, sd_of_mean, turning, without_mean
from estim.discrepancy.scale_mixture import Shape

_N_NODE = 121
# amplitudes of the own forces of runs, in units of the one that they share
OWN = (0.0, 0.1, 0.3, 1.0)
FORCE, TURN = "force", "force once and twice per turn"
# kind -> correlation between both ways
_WAY_CORRELATIONS = {FORCE: 1.0, f"{FORCE}, another on the way back": 0.0}


@dataclass(frozen=True, eq=False)
class ForceTrack:
    """A track with nodes between which the force is linear.

    start, end : place of release and the last place reached, m or rad.
    nodes : (n_node,) equally spaced, the first at the release.
    weights : (n_node,) the part of the track that each node stands for, of sum 1.
    back : (n_node,) the weights of the way back, whose force may be another; None where there is no
        such way.
    """

    start: float
    end: float
    nodes: FloatArray
    weights: FloatArray
    back: FloatArray | None = None

    @property
    def length(self) -> float:
        return self.end - self.start

    @property
    def n_way(self) -> int:
        """1, or 2 where the body also came back: causes are the nodes of the way out, then those of
        the way back.
        """
        return 1 if self.back is None else 2


@dataclass(frozen=True, eq=False)
class Response:
    """What a force at each node and an energy at release do to the observations.

    force : (n_obs, n_node) unit of the observations for a force of one weight.
    start : (n_obs,) for E0 = 1, in the unit of position.
    """

    force: FloatArray
    start: FloatArray

    def carried(self, own: ForceTrack, common: ForceTrack) -> Response:
        """The response to a force on the nodes of a `common` track that is at least as long;
        positions count from the release of each.
        """
        near = np.eye(common.nodes.size)
        since, positions = common.nodes - common.start, own.nodes - own.start
        return Response(
            self.force @ np.array([np.interp(positions, since, node) for node in near]).T,
            self.start,
        )

    @classmethod
    def stacked(cls, responses: Sequence[Response]) -> Response:
        """The responses of several runs on one track below each other."""
        return cls(
            np.vstack([r.force for r in responses]), np.concatenate([r.start for r in responses])
        )


def track(end: float, *, start: float = 0.0) -> ForceTrack:
    """The track from the release at `start` to `end`.  Raises InputError where it has no length, or
    runs backwards.
    """
    if not end > start:
        raise InputError("must lie beyond the release", field="end", value=end)
    weights = np.ones(_N_NODE)
    weights[[0, -1]] = 0.5
    return ForceTrack(start, end, np.linspace(start, end, _N_NODE), weights / weights.sum())


def track_with_ways(x: FloatArray, v: FloatArray) -> ForceTrack:
    """The track of a motion through positions x (n + 1,) in the order of time, with the velocities
    v (n,) between them.
    """
    low, high = float(np.min(x)), float(np.max(x))
    nodes = np.linspace(low, high, _N_NODE)
    passed = 0.5 * (nodes[1:] + nodes[:-1])
    shares = []
    for sense in (1.0, -1.0):
        moving = v * sense > 0.0
        ends = np.sort(np.column_stack([x[:-1], x[1:]])[moving], axis=1)
        times = np.searchsorted(np.sort(ends[:, 0]), passed) - np.searchsorted(
            np.sort(ends[:, 1]), passed
        )
        weights = np.append(times, 0.0) + np.append(0.0, times)
        shares.append(weights / max(weights.sum(), 1.0))
    out, back = shares
    one_way = not (out.any() and back.any())
    return ForceTrack(low, high, nodes, out + back if one_way else out, None if one_way else back)


def speed_response(
    along: ForceTrack, x: FloatArray, speed: FloatArray, inertia: FloatArray, *, acceleration: float
) -> Response:
    """Of the energy residuals of speeds measured at positions x (n_obs,); speed and inertia
    (n_obs,) of the fit there.  Raises InputError at rest.
    """
    _moving(speed)
    lever = acceleration / (inertia * speed)
    return Response(lever[:, None] * work_along(along, x), lever)


def force_kernel(along: ForceTrack, length: float, *, radius: float | None = None) -> FloatArray:
    """(n_node, n_node) correlation of the force, its mean over the track not yet removed.

    radius : length of track for one radian of a turning wheel, which then has a moment once and
        twice per turn; None for what does not turn.
    """
    separations = distances(along.nodes)
    return (
        matern32(separations, length)
        if radius is None
        else turning(separations, length, radius=radius)
    )


@dataclass(frozen=True, eq=False)
class ForcePrior:
    """A force before any data: what kind, over which length it changes, log of its probability, for
    unit amplitude.

    covariance : (n_cause, n_cause) its mean over the track removed, on each way by itself.
    elsewhere : standard deviation of its mean over another track of the same kind.
    """

    kind: str
    length: float
    log_prior: float
    covariance: FloatArray
    elsewhere: float


def force_priors(along: ForceTrack, *, radius: float | None = None) -> tuple[ForcePrior, ...]:
    """One for each of some six lengths, about a sixth of the track.

    Where the body came back, positions distinguish small profiles, and there are three
    kinds of each: the same force on both ways (a ramp that is not flat), another one on the way
    back (dirt, which changes its sign, beside it), and a moment once and twice per turn alone.
    """
    priors, correlations = [], {FORCE: 1.0} if along.back is None else _WAY_CORRELATIONS
    kinds = 0.0 if along.back is None else np.log(3.0)
    for length, log_prior in zip(*track_lengths(along.length), strict=True):
        kernel = force_kernel(along, float(length), radius=radius)
        elsewhere = sd_of_mean(kernel, along.weights)
        for kind, correlation in correlations.items():
            covariance = (
                without_mean(kernel, along.weights)
                if along.back is None
                else _on_both_ways(along, kernel, correlation)
            )
            priors.append(
                ForcePrior(kind, float(length), float(log_prior - kinds), covariance, elsewhere)
            )
    if along.back is not None:
        separations, turn = distances(along.nodes), radius or along.length
        kernel = turning(separations, turn, radius=turn) - matern32(separations, turn)
        priors.append(
            ForcePrior(
                TURN,
                turn,
                -float(np.log(3.0)),
                _on_both_ways(along, kernel, 1.0),
                sd_of_mean(kernel, along.weights),
            )
        )
    return tuple(priors)


def _on_both_ways(along: ForceTrack, kernel: FloatArray, correlation: float) -> FloatArray:
    """(2 n_node, 2 n_node) of a force on the way out and one on the way back, of correlation
    `correlation`, each without its mean.
    """
    assert along.back is not None
    mean = np.kron(np.eye(2), np.ones((along.nodes.size, 1))) @ block_diag(
        along.weights, along.back
    )
    centred = np.eye(mean.shape[0]) - mean
    return centred @ np.kron(np.array([[1.0, correlation], [correlation, 1.0]]), kernel) @ centred.T


def force_shapes(
    along: ForceTrack, response: Response, *, radius: float | None = None
) -> tuple[Shape, ...]:
    """The force with its mean over the track removed: one shape for each of `force_priors`.

    What is constant along the track belongs to the rolling resistance (or the slope), which then
    means the average over this track.
    """
    return tuple(
        Shape(prior.kind, prior.length, response.force @ root(prior.covariance), prior.log_prior)
        for prior in force_priors(along, radius=radius)
    )


def shared_force_shapes(
    along: ForceTrack,
    responses: Sequence[Response],
    *,
    radius: float | None = None,
    own: tuple[float, ...] = OWN,
) -> tuple[Shape, ...]:
    """One force that all runs on a track share, its mean removed, plus a plain one of each run;
    observations stacked in the order of the runs.

    responses : one for each run, on the same track, which ends where the longest run ends.
    own : amplitudes of the runs' own force in units of the shared one, equally probable.  One
        without the other is not enough: a shared force alone covers 17-44 % for 68 where the runs
        also differ, own ones alone 18 % where the profile repeats.
    """
    stacked = Response.stacked(responses).force
    shapes = []
    for length, log_prior in zip(*track_lengths(along.length), strict=True):
        kernel = force_kernel(along, float(length), radius=radius)
        shared, own_root = stacked @ root(without_mean(kernel, along.weights)), root(kernel)
        each = block_diag(*(r.force @ own_root for r in responses))
        log_each = float(log_prior - np.log(len(own)))
        shapes += [
            Shape(own_kind(ratio), float(length), np.hstack([shared, ratio * each]), log_each)
            for ratio in own
        ]
    return tuple(shapes)


def own_kind(ratio: float) -> str:
    """The kind of a shared force whose runs have own forces `ratio` times as large."""
    return f"{FORCE}, own x {ratio:g}"


def work_along(along: ForceTrack, x: FloatArray) -> FloatArray:
    """(n, n_node) F(x) = int f dx' from the release, for a force that is 1 at one node and falls to
    0 at its neighbours.
    """
    step = along.nodes[1] - along.nodes[0]
    since = np.append(np.clip(x, along.start, along.end), along.start)[:, None] - along.nodes
    total = (
        sum(
            part * np.square(np.maximum(since + shift * step, 0.0))
            for part, shift in ((0.5, 1.0), (-1.0, 0.0), (0.5, -1.0))
        )
        / step
    )
    return total[:-1] - total[-1]


def _moving(speed: FloatArray) -> None:
    if not np.all(speed > 0.0):
        raise InputError(
            "must be > 0 along the track: a force is known to first order only while the "
            "body moves",
            field="speed",
        )
