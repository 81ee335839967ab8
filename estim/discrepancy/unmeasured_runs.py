"""The information of runs with an unmodelled force that are not yet measured: a force as large as
the data at hand leave probable.

    C = s^2 C0 + sum_l (a_l^2 X_l X_l^T + b_l^2 Y_l Y_l^T) + p p^T

X_l: the shared force of length l with its mean removed, Y_l: the plain ones of the single runs, p:
a push at release (`force`); s^2, a_l^2, b_l^2 are mean squares over the posterior of the
components.  With them C is the covariance of `MixtureErrors.information_root`, for any other runs.
The size of the force stays as it is: the information of further data about it is not anticipated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from estim.arrays import FloatArray
from estim.discrepancy.force import FORCE, OWN, Response, force_kernel, own_kind
from estim.discrepancy.joint_runs import Tracked
from estim.discrepancy.kernels import without_mean
from estim.discrepancy.likelihood import MixtureErrors
from estim.discrepancy.residuals import stacked
from estim.problem import Observations, Posterior, Problem, StackedPoints, covariance_of


@dataclass(frozen=True, eq=False)
class ForceSize:
    """How large the force of some runs is, as mean squares over what their data leave probable.

    noise : of the factor of the stated noise.
    lengths : (n,) in the unit of position, shared and own (n,) of the amplitudes, in units of the
        weight.
    several : whether several runs share the force; else `own` is 0, and not known.
    """

    noise: float
    lengths: FloatArray
    shared: FloatArray
    own: FloatArray
    several: bool

    def between(self) -> FloatArray:
        """(n,) mean squares of the own forces; of a run that shared with none those of the
        prior.
        """
        return self.own if self.several else self.shared * float(np.mean(np.square(OWN)))


def force_sizes(posterior: Posterior, values: FloatArray) -> dict[str, ForceSize]:
    """Run -> how large its force is, at `values` (n_par,); runs without one are left out."""
    named, sizes = posterior.problem.named(values), {}
    for group, likelihood in zip(posterior.problem.groups, posterior.likelihoods, strict=True):
        if isinstance(likelihood, MixtureErrors):
            size = _size(likelihood, likelihood.residuals_at(named), several=len(group.runs) > 1)
            sizes.update({run.name: size for run in group.runs})
    return sizes


def expected_root(
    runs: Sequence[Observations], problem: Problem, values: FloatArray, size: ForceSize
) -> FloatArray:
    """J (n_obs, n_par) with J^T J the information that `runs`, which share a force of this size,
    give about the parameters at `values`.

    Raises InputError where a body hardly moves somewhere along its track.
    """
    named = problem.named(values)
    points = StackedPoints(tuple(run.points for run in runs))
    tracked, several = Tracked.of(runs, points, named, scale=1.0), len(runs) > 1
    track, responses = tracked.track, tracked.responses
    lever = Response.stacked(responses).force
    between = size.between() if several else np.zeros(size.lengths.size)
    covariance = size.noise * block_diag(*(covariance_of(errors.root) for errors in tracked.stated))
    for length, shared, own in zip(size.lengths, size.shared, between, strict=True):
        kernel = force_kernel(track, float(length), radius=tracked.alongs[0].radian)
        covariance += shared * lever @ without_mean(kernel, track.weights) @ lever.T
        covariance += own * block_diag(
            *(response.force @ kernel @ response.force.T for response in responses)
        )
    lower = np.linalg.cholesky(covariance + tracked.pushes @ tracked.pushes.T)
    gradient = stacked(tracked.formed).gradient(points, named, problem.names)
    return solve_triangular(lower, gradient, lower=True)


def _size(likelihood: MixtureErrors, residuals: FloatArray, *, several: bool) -> ForceSize:
    mixture = likelihood.mixture
    ratios = {own_kind(ratio): ratio for ratio in OWN} if several else {FORCE: 0.0}
    noise, shared, own = 0.0, dict[float, float](), dict[float, float]()
    for family, weights in mixture.deviation.each(mixture.shares(residuals)):
        noise += float(weights @ np.square(family.scale))
        square = float(weights @ np.square(family.amplitude))
        shared[family.length] = shared.get(family.length, 0.0) + square
        own[family.length] = own.get(family.length, 0.0) + square * ratios[family.kind] ** 2
    lengths = sorted(shared)
    return ForceSize(
        noise,
        np.array(lengths),
        np.array([shared[length] for length in lengths]),
        np.array([own[length] for length in lengths]),
        several,
    )
