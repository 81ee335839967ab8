"""From a fit of a user's own curve with independent errors to noise with what the curve lacks, made
once and held.

    fit with independent errors -> linearise -> which deviations are how probable
        -> `WithMixture`, and the deviation for a reader

The scale of a smooth deviation is the user's, who knows what y may be off by.  That of correlated
errors is twice the residuals' standard deviation, or the stated one where that is larger: the prior
is flat over all smaller sizes in any case.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray, inverse_of, positive_or, root_mean_square, sds_of
from estim.common import PROBABILITIES, later
from estim.discrepancy.curve_covariances import (
    DEVIATION,
    LONG,
    TIME,
    correlated_shapes,
    deviation_shapes,
    equally_probable,
    relative_grid,
    stated_is_conservative,
)
from estim.discrepancy.grid import SPIKE
from estim.discrepancy.linearised import Linearised, linearise
from estim.discrepancy.mixture_likelihood import keep_probable
from estim.discrepancy.noise_with_discrepancy import WithMixture, normal_covariance
from estim.discrepancy.noise_with_force import (
    NormalParts,
    TrialInformation,
    as_prior,
    growth_over,
    information_of_run,
    likelihood_information,
    likely_root,
    linear_groups,
)
from estim.discrepancy.residual_part import ResidualPart, find_residual_part
from estim.discrepancy.residuals import Residuals
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.problem import Discrepancy, Observations, Problem, Root

_TIMES_NOISE = 2.0  # scale of correlated errors
_SMOOTH = later("a smooth deviation from the curve")
_FOLLOWING = later("errors that are correlated between successive readings")
Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class DeviationSize:
    """One way to read what the curve lacks.

    share : probability that it is there.
    long : that it is there and changes as slowly as a trend (`generic.LONG`).
    scale : of the prior of its amplitude, unit of y.
    amplitude, length : quantiles 0.16, 0.5, 0.84 if it is there, in the units of y and of x (of a
        step where errors follow each other in order).
    """

    share: float
    long: float
    scale: float
    amplitude: tuple[float, float, float]
    length: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class FoundDeviation:
    """What the curve of one run lacks.

    lacks : the options.
    probability : P(amplitude > 0).  smooth, correlated : how it is read; None where it was not
        an option.
    residual_part : what of it the curve cannot make up for, with the points.
    noise : quantiles 0.16, 0.5, 0.84 of the standard deviation of the noise beside it, in units of
        the stated one, or in the unit of y.
    conservative : whether the readings scatter by far less than stated.
    growth : parameter -> its standard deviation over that with independent errors alone, both
        linearised.
    mean, cov : (n_par,), (n_par, n_par) of the linearised posterior.
    about, information : (n_par,) the point of linearisation, and the information of all data
        there as one normal distribution, whatever the size of the deviation.
    intervals : parameter -> probability (0.68, 0.95) -> its ends.
    parts : of the linearised posterior, the narrowest first.
    """

    run: str
    lacks: Discrepancy
    probability: float
    smooth: DeviationSize | None
    correlated: DeviationSize | None
    residual_part: ResidualPart
    noise: tuple[float, float, float]
    conservative: bool
    growth: Mapping[str, float]
    mean: FloatArray
    cov: FloatArray
    about: FloatArray
    information: TrialInformation
    intervals: Mapping[str, Mapping[float, Interval]]
    parts: NormalParts


@dataclass(frozen=True, eq=False)
class PosedDeviation:
    """noise : of the run, with what its curve lacks.  found : that, for a reader."""

    noise: WithMixture
    found: FoundDeviation


def pose_deviation(run: Observations, problem: Problem, values: FloatArray) -> PosedDeviation:
    """What the curve of `run` lacks, linear about `values` (n_par,), those of a fit with
    independent errors.

    Where other runs share parameters, their information is that without a deviation.
    """
    lacks = run.lacks
    assert lacks is not None, "called for runs that may lack something"
    root, shift, residuals, jacobian = _measured(run, problem, values, stated=lacks.stated)
    precision, pull = _other_information(run, problem, values)
    scales = _scales(lacks, root, residuals)
    shapes = _shapes(run, lacks, scales)
    deviation = diagonalise(root, shapes, relative_grid(stated=lacks.stated))
    slopes = deviation.whiten(jacobian.T)
    without = sds_of(inverse_of(slopes @ slopes.T + precision))
    linear = linearise(
        deviation, residuals, jacobian, precision=precision, pull=pull, stated=lacks.stated
    )
    lacking: tuple[str, ...] = (_SMOOTH,) if lacks.deviation else ()
    lacking += (_FOLLOWING,) if lacks.along is not None else ()
    noise = WithMixture(
        run.noise,
        keep_probable(linear),
        likely_root(linear, stated=lacks.stated),
        Residuals(shift),
        lacking,
        sized=lacks.stated,
    )
    extents = {
        kind: float(np.ptp(run.x if kind == DEVIATION or lacks.along is None else lacks.along))
        for kind in scales
    }
    sizes = {
        kind: _size(linear, kind, scale, LONG[kind] * extents[kind])
        for kind, scale in scales.items()
    }
    unit = 1.0 if lacks.stated else _typical(root)
    low, middle, high = (unit * quantile for quantile in linear.size("scale"))
    summary = FoundDeviation(
        run=run.name,
        lacks=lacks,
        probability=linear.p_deviation,
        smooth=sizes.get(DEVIATION),
        correlated=sizes.get(TIME),
        residual_part=find_residual_part(linear, run, shapes),
        noise=(low, middle, high),
        conservative=lacks.stated and stated_is_conservative(linear),
        growth=growth_over(problem, linear, without),
        mean=values + linear.mean,
        cov=linear.covariance,
        about=values,
        information=likelihood_information(linear, _prior(problem, values)),
        intervals=_intervals(linear, problem, values),
        parts=linear_groups(linear, values),
    )
    return PosedDeviation(noise, summary)


def presence(run: Observations, problem: Problem, values: FloatArray) -> float:
    """Probability that a curve taken as complete lacks something about as large as one error, 1/2
    beforehand; linear about `values` (n_par,).
    """
    root, _, residuals, jacobian = _measured(run, problem, values, stated=run.stated)
    precision, pull = _other_information(run, problem, values)
    # neither a slope nor a flat prior has information on the size of the errors; nor on what
    # another parameter hides on its limit
    uninformed = (np.diag(precision) == 0.0) & ~np.any(jacobian, axis=0)
    shapes = tuple(shape.times(_typical(root)) for shape in deviation_shapes(run.x))
    grid = relative_grid(stated=run.stated, spike=SPIKE)
    turned = _orthogonal_combinations(jacobian)
    return linearise(
        diagonalise(root, shapes, grid),
        residuals,
        jacobian @ turned,
        precision=turned.T @ (precision + np.diag(1.0 * uninformed)) @ turned,
        pull=np.linalg.solve(turned, pull),
        stated=run.stated,
    ).p_deviation


def _orthogonal_combinations(jacobian: FloatArray) -> FloatArray:
    """(n_par, n_par) combinations of the parameters whose slopes are orthogonal: terms that all but
    cancel leave no inverse of their information.
    """
    n_par = jacobian.shape[1]
    sizes = positive_or(np.linalg.norm(jacobian, axis=0), 1.0)
    upper = np.linalg.qr(np.vstack([jacobian / sizes, np.zeros((n_par, n_par))]), mode="r")
    # what the slopes do not constrain stays as it is
    upper += np.diag(1.0 * (np.abs(np.diag(upper)) < 1e-12))
    return np.linalg.inv(upper) / sizes[:, None]


def _measured(
    run: Observations, problem: Problem, values: FloatArray, *, stated: bool
) -> tuple[Root, FloatArray, FloatArray, FloatArray]:
    """The root of the covariance of the errors, shift and residuals (n_obs,), slopes (n_obs,
    n_par).  stated : whether the size of the errors was; else they are as large as the residuals.
    """
    named = problem.named(values)
    errors = normal_covariance(run.noise, run.points, named)
    residuals = run.y - errors.shift - run.drawn(named)
    root = errors.root
    if not stated:
        squares = float(np.sum(np.square(residuals) / root.variances))
        root = root.times(np.sqrt(squares / max(1, run.n_obs - len(run.curve_parameters))))
    return root, errors.shift, residuals, run.points.gradient(named, problem.names)


def _typical(root: Root) -> float:
    """Standard deviation of a typical reading."""
    return float(np.sqrt(np.median(root.variances)))


def _shapes(
    run: Observations, lacks: Discrepancy, scales: Mapping[str, float]
) -> tuple[Shape, ...]:
    """The shapes of the options, each in units of the scale of its amplitude."""
    groups = [deviation_shapes(run.x)] if lacks.deviation else []
    groups += [correlated_shapes(lacks.along)] if lacks.along is not None else []
    return tuple(shape.times(scales[shape.kind]) for shape in equally_probable(*groups))


def _scales(lacks: Discrepancy, root: Root, residuals: FloatArray) -> dict[str, float]:
    """Kind -> scale of its amplitude, unit of y."""
    observed = _TIMES_NOISE * root_mean_square(residuals)
    scales = {DEVIATION: lacks.deviation} if lacks.deviation else {}
    return scales | (
        {TIME: max(observed, _TIMES_NOISE * _typical(root))} if lacks.along is not None else {}
    )


def _other_information(run: Observations, problem: Problem, values: FloatArray) -> TrialInformation:
    """Precision and pull of priors and other runs."""
    others = [other for other in problem.runs if other is not run]
    return as_prior(
        [_prior(problem, values), *(information_of_run(o, problem, values) for o in others)]
    )


def _prior(problem: Problem, values: FloatArray) -> TrialInformation:
    """The information of the priors at `values`."""
    return problem.prior_information(values), -problem.prior_gradient(values)


def _size(linear: Linearised, kind: str, scale: float, long: float) -> DeviationSize:
    members = np.concatenate(
        [np.where(f.amplitude > 0.0, f.kind == kind, False) for f in linear.deviation.families]
    )
    share = float(linear.weights[members].sum())
    if not share > 0.0:
        return DeviationSize(0.0, 0.0, scale, (np.nan, np.nan, np.nan), (np.nan, np.nan, np.nan))
    alone = replace(linear, weights=np.where(members, linear.weights, 0.0) / share)
    low, middle, high = (scale * quantile for quantile in alone.size("amplitude"))
    slow = float(linear.weights[members & (linear.deviation.lengths() > long)].sum())
    return DeviationSize(share, slow, scale, (low, middle, high), alone.size("length"))


def _intervals(
    linear: Linearised, problem: Problem, values: FloatArray
) -> dict[str, dict[float, Interval]]:
    """Equal-tailed, each inside the support of the parameter's prior."""
    intervals = {}
    for parameter, value, direction in zip(
        problem.parameters, values, np.eye(problem.n_par), strict=True
    ):
        low, high = parameter.prior.low, parameter.prior.high
        below, above = (
            linear.probability_below(direction, edge - value)
            if np.isfinite(edge)
            else float(edge > 0)
            for edge in (low, high)
        )
        ends = {}
        for p in PROBABILITIES:
            levels = below + (above - below) * np.array([0.5 - 0.5 * p, 0.5 + 0.5 * p])
            ends[p] = tuple(
                np.clip(value + linear.quantiles(direction, levels), low, high).tolist()
            )
        intervals[parameter.name] = ends
    return intervals
