"""Bands along the curve from draws of the posterior.

- credible: where the true curve lies with the stated probability, point by point; together with the
  unmodelled force and the start, where the fit has room for them.
- predictive: where one more measured speed would lie at that position, with the noise of the
  readings as large as it was found to be.

A draw whose motion ends before x has no speed there and counts as 0.  The grid is finer towards
both ends, where the curve is steep.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import PROBABILITIES
from estim.discrepancy import Completed, FoundForce
from estim.problem import Observations, Problem, reading_sd


@dataclass(frozen=True, eq=False)
class Bands:
    """Bands of one run.

    x : (n_x,) positions.  median : (n_x,) of the curve.
    credible, predictive : probability -> (2, n_x) lower and upper end.
    end : (n_draw,) where the motion ends, inf for draws in which it does not.
    completed : whether the curve stands there with the force that it lacks and a free start.
    """

    run: str
    x: FloatArray
    median: FloatArray
    credible: Mapping[float, FloatArray]
    predictive: Mapping[float, FloatArray]
    end: FloatArray
    completed: bool = False


def posterior_bands(
    problem: Problem,
    draws: FloatArray,
    *,
    rng: np.random.Generator,
    probabilities: tuple[float, ...] = PROBABILITIES,
    n_x: int = 200,
    forces: Sequence[FoundForce] = (),
) -> tuple[Bands, ...]:
    """Bands of every run of `problem` from posterior draws (n_draw, n_par).  forces : what the
    curves of some of them lack.

    rng : chooses the draws, and draws new readings.  probabilities : of the bands.
    n_x : points of the grid in x, four times as many for a curve that is no motion.

    >>> import numpy as np
    >>> from estim import Target, fit_curve, posterior_bands, sample_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> chain = sample_curve(fit, seed=1, target=Target(ess=400.0)).chain
    >>> (bands,) = posterior_bands(fit.problem, chain.flat, rng=np.random.default_rng(1), n_x=50)
    >>> bands.x.shape
    (200,)
    """
    completed = {force.run: force.completed for force in forces}
    pairs = zip(problem.runs, rng.spawn(len(problem.runs)), strict=True)
    return tuple(
        _bands(problem, run, draws, completed.get(run.name), rng, probabilities, n_x)
        for run, rng in pairs
    )


def curve_grid(run: Observations, end: FloatArray, n_x: int) -> FloatArray:
    """(n_x,) positions from the release to the end of the data, or of the motion where that is
    close, denser at both ends.

    A curve that is no motion from a release is drawn where its data are.
    """
    if not run.words.from_release:
        return run.along(float(np.min(run.x)), float(np.max(run.x)), 4 * n_x)  # it may oscillate
    last = float(np.max(run.x))
    stop = float(np.sort(end)[int(0.98 * (end.size - 1))])
    far = stop if stop < 1.25 * last else 1.05 * last
    return 0.5 * max(far, last) * (1.0 - np.cos(np.linspace(0.0, np.pi, n_x)))


def curve_draws(
    problem: Problem, run: Observations, x: FloatArray, draws: FloatArray, end: FloatArray
) -> FloatArray:
    """The curve (n_draw, n_x) at each draw, 0 beyond the `end` (n_draw,) of its motion."""
    value = np.broadcast_to(
        run.curve.value(x, run.bind(problem.named(draws))), (draws.shape[0], x.size)
    )
    return np.where(x <= end[:, None], value, 0.0)


def motion_end(problem: Problem, run: Observations, draws: FloatArray) -> FloatArray:
    """(n_draw,) where the motion of the curve alone ends at each draw (n_draw, n_par), inf where it
    does not.
    """
    return np.broadcast_to(run.end(run.bind(problem.named(draws))), (draws.shape[0], 1))[:, 0]


def _bands(
    problem: Problem,
    run: Observations,
    draws: FloatArray,
    completed: Completed | None,
    rng: np.random.Generator,
    probabilities: tuple[float, ...],
    n_x: int,
) -> Bands:
    end = motion_end(problem, run, draws)
    x = curve_grid(run, end, n_x)
    curve = curve_draws(problem, run, x, draws, end)
    named, scale = problem.named(draws), np.ones(draws.shape[0])
    if completed is not None:
        gained, scale = completed.gained(x, named, rng)
        curve, end = moved_on(x, curve, end, gained)
    if (counted := run.noise.counted) is not None:
        new = counted.law.draw(curve, np.atleast_1d(np.rint(np.median(counted.trials))), rng)
    else:
        new = curve + _new_errors(run, named, x, curve, scale, rng)
    median, credible = central_intervals(curve, probabilities)
    _, predictive = central_intervals(new, probabilities)
    return Bands(
        run=run.name,
        x=x,
        median=median,
        end=end,
        credible=credible,
        predictive=predictive,
        completed=completed is not None,
    )


def _new_errors(
    run: Observations,
    named: Mapping[str, FloatArray],
    x: FloatArray,
    curve: FloatArray,
    scale: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Errors of one more reading (n_draw, n_x), as large as those of the readings beside it or a
    share of the curve (n_draw, n_x); one normal score for all positions of a draw, so that the band
    is smooth.
    """
    if run.noise.share:
        reading = reading_sd(run.noise, named, curve)
    else:
        order = np.argsort(run.x)
        gain = np.interp(x, run.x[order], run.noise.reading_gain()[order])
        reading = np.sqrt(run.noise.size.reading_variance(named)) * gain
    sd = np.hypot(reading, run.noise.size.scatter.at(named)) * scale[:, None]
    return sd * rng.standard_normal((scale.size, 1))


def moved_on(
    x: FloatArray, curve: FloatArray, end: FloatArray, gained: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The curve (n_draw, n_x) and its end (n_draw,) with v^2 `gained` (n_draw, n_x); about the end
    v^2 falls like a straight line.
    """
    last, rows = np.clip(np.sum(x < end[:, None], axis=1) - 1, 0, x.size - 1), np.arange(end.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        fall = np.square(curve[rows, last]) / (end - x[last])
        ends = np.isfinite(end) & np.isfinite(fall) & (fall > 0.0)
        moved = np.where(ends, end + gained[rows, last] / fall, end)
    extrapolated = np.where(
        ends[:, None] & (x > end[:, None]),
        np.where(ends, fall, 0.0)[:, None] * (x - np.where(ends, end, 0.0)[:, None]),
        0.0,
    )
    square = np.square(curve) - extrapolated + gained
    return np.sqrt(np.maximum(square, 0.0)), moved


def central_intervals(
    values: FloatArray, probabilities: Sequence[float]
) -> tuple[FloatArray, dict[float, FloatArray]]:
    """(n_x,) medians of (n_draw, n_x) values, and probability -> (2, n_x) ends of the intervals."""
    levels = [0.5, *(0.5 + half for p in probabilities for half in (-0.5 * p, 0.5 * p))]
    median, *ends = np.quantile(values, levels, axis=0)
    return median, {p: np.array(ends[2 * k : 2 * k + 2]) for k, p in enumerate(probabilities)}
