"""Does the model bring back what matters?  Data sets drawn from the posterior beside the one that
was measured (posterior predictive checks).

For each draw of the parameters the readings are replicated, with what the curve lacks as the data
leave it and with new noise (`estim.discrepancy.repetition`); each statistic T of them is compared
with T of the data:

    p = 2 min{P(T_rep >= T), P(T_rep <= T)}        ties shared evenly

What was measured is used twice, for the fit and for the test, so that p is conservative: where the
model is right it is nearer to 1/2 than a uniform number would be, and small values are rarer than
nominal (Bayarri, Berger, J. Am. Stat. Assoc. 95 (2000) 1127).  A small one counts.

Source: Gelman, Meng, Stern, Stat. Sinica 6 (1996) 733.

    largest_speed, its_place    of the speeds as measured
    turning_point               where the straight line through v^2 of the last speeds ends, of a
                                body that slows down
    farthest                    of positions in time: the largest
    energy                      kinetic and potential, last readings less first ones, in units of
                                the largest kinetic energy of the curve
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named
from estim.common import Label, Notation, p_digits, phrase
from estim.discrepancy import MixtureErrors, replicas
from estim.problem import Likelihood, Observations, Points, Posterior, n_draws

P_NOT_BROUGHT_BACK = 0.01
N_DRAW, _FEW = 1000, 100  # draws; those of a noise of which every draw has another covariance
_PART, _LEAST = 8, 4  # the last and first eighth of the readings, four at least
# speeds of positions: slopes over a twelfth of the frames, five at least
_SPEED_OVER, _LEAST_OVER = 12, 5


@dataclass(frozen=True, eq=False)
class Predicted:
    """One statistic of one run.

    name : short.
    words : what it is.  label : how it is shown.  observed, replicated : (n_draw,) of the data and
        of the data sets, in SI units; observed is one number where the parameters do not enter.
    p : two-sided.
    """

    run: str
    name: str
    words: str
    label: Label
    observed: FloatArray
    replicated: FloatArray
    p: float

    @property
    def p_words(self) -> str:
        """p, no smaller than the number of data sets can resolve."""
        least = 1.0 / self.replicated.size
        return f"< {p_digits(least, 1)}" if self.p <= least else p_digits(self.p)

    @property
    def brought_back(self) -> bool:
        return self.p >= P_NOT_BROUGHT_BACK


_Motion = tuple[FloatArray, FloatArray]
"""Places and speeds, (n_set, n) or (1, n) each, in the order of the motion."""


def predictive_checks(
    posterior: Posterior, draws: FloatArray, *, rng: np.random.Generator
) -> tuple[Predicted, ...]:
    """The statistics of every run of a body from posterior draws (n, n_par), at most 1000 of them;
    none of runs whose errors are not normal.
    """
    problem = posterior.problem
    checks: dict[str, tuple[Predicted, ...]] = {}
    for group, likelihood in zip(problem.groups, posterior.likelihoods, strict=True):
        if any(run.motion is None for run in group.runs):
            continue
        subset = draws[np.linspace(0, draws.shape[0] - 1, min(N_DRAW, draws.shape[0])).astype(int)]
        drawn = _replicated(likelihood, problem.named, subset, rng)
        if drawn is None:
            continue
        replicated, used = drawn
        # as the likelihood has them: without the shifts of bad frames
        parts = zip(group.runs, likelihood.points.runs, group.split(replicated.T), strict=True)
        for run, run_points, y in parts:
            checks[run.name] = _of_run(run, run_points, y.T, run_points.bind(problem.named(used)))
    return tuple(check for run in problem.runs for check in checks.get(run.name, ()))


def _replicated(
    likelihood: Likelihood,
    named: Callable[[FloatArray], Named],
    draws: FloatArray,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray] | None:
    """Data sets (n_set, n_obs) and the draws (n_set, n_par) that they belong to; None where errors
    are not normal.
    """
    if isinstance(likelihood, MixtureErrors):
        return replicas(likelihood, named(draws), rng=rng), draws
    normal, points = likelihood.normal, likelihood.points
    if normal is None:
        return None
    few = draws[:: max(1, draws.shape[0] // _FEW)]
    curve = np.broadcast_to(points.value(named(few)), (few.shape[0], points.y.size))
    each = draws.shape[0] // few.shape[0]
    sets = []
    for expected, values in zip(curve, few, strict=True):
        root = normal.root(named(values))
        sets.append(
            expected
            + points.y
            - likelihood.y
            + root.coloured(rng.standard_normal((each, expected.size)))
        )
    return np.vstack(sets), np.repeat(few, each, axis=0)


def _of_run(
    run: Observations, points: Points, replicated: FloatArray, arguments: Named
) -> tuple[Predicted, ...]:
    order = np.argsort(points.x, kind="stable")
    x, measured, replicated = points.x[order], points.y[None, order], replicated[:, order]
    if not run.positions:
        return _of_motion(
            run, (x[None, :], measured), (x[None, :], replicated), arguments, run.x_unit
        )
    over = min(max(_LEAST_OVER, x.size // _SPEED_OVER), x.size)
    slope, mean = _sliding(x, over)
    farthest = _compared(
        run,
        "farthest",
        phrase("farthest reading"),
        Notation("x").label(run.y_unit),
        np.max(measured, axis=1),
        np.max(replicated, axis=1),
    )
    pairs = [(y @ mean.T, y @ slope.T) for y in (measured, replicated)]
    return (farthest, *_of_motion(run, pairs[0], pairs[1], arguments, run.y_unit))


def _of_motion(
    run: Observations, measured: _Motion, replicated: _Motion, arguments: Named, unit: str
) -> tuple[Predicted, ...]:
    x, v = (part[0] for part in measured)
    position, speed = Notation("x").label(unit), Notation("v").label(f"{unit}/s")
    size = min(max(_LEAST, x.size // _PART), x.size)
    first, last = slice(0, size), slice(x.size - size, x.size)

    def compared(
        name: str, words: str, label: Label, statistic: Callable[[_Motion], FloatArray]
    ) -> Predicted:
        return _compared(run, name, words, label, statistic(measured), statistic(replicated))

    def place(motion: _Motion) -> FloatArray:
        where, speeds = np.broadcast_arrays(*motion)
        top = np.argmax(np.abs(speeds), axis=1)[:, None]
        return np.take_along_axis(where, top, axis=1)[:, 0]

    def energies(motion: _Motion) -> tuple[FloatArray, FloatArray]:
        kinetic, potential = run.body.energies(*motion, arguments)
        n_set = max(n_draws(arguments), motion[1].shape[0])
        shape = n_set, x.size
        return np.broadcast_to(kinetic, shape), np.broadcast_to(potential, shape)

    def energy_change(motion: _Motion) -> FloatArray:
        total = np.add(*energies(motion))
        return (total[:, last].mean(axis=1) - total[:, first].mean(axis=1)) / scale

    fastest = phrase("largest speed")
    statistics = [compared("largest_speed", fastest, speed, lambda m: np.max(np.abs(m[1]), axis=1))]
    top = int(np.argmax(np.abs(v)))
    if first.stop <= top < last.start:
        words = phrase("position of the largest speed")
        statistics.append(compared("its_place", words, position, place))
        # of the largest speed: a body that is slower at the end is on its way to a turning point
        if not run.positions and np.mean(v[last]) < 0.7 * v[top]:
            end, words = x[last], phrase("turning point")
            statistics.append(
                compared("turning_point", words, position, lambda m: _zero_of(end, m[1][:, last]))
            )
    scale = np.max(energies(measured)[0], axis=1)
    percent = Notation("ΔE/T", "%", 100.0).label("1")
    words = phrase(
        "energy at the end minus energy at the start, relative to the largest kinetic energy"
    )
    return (*statistics, compared("energy", words, percent, energy_change))


def _zero_of(x: FloatArray, v: FloatArray) -> FloatArray:
    """(n_set,) where the straight line through v^2 (n_set, n) at x (n,) is 0; inf where it does not
    fall.
    """
    centred = x - x.mean()
    square = np.square(v)
    slope = square @ centred / (centred @ centred)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(slope < 0.0, x.mean() - square.mean(axis=1) / slope, np.inf)


def _sliding(t: FloatArray, over: int) -> tuple[FloatArray, FloatArray]:
    """(n - over + 1, n) slopes of straight lines through `over` neighbours in t (n,), and their
    means.
    """
    n = t.size - over + 1
    slope, mean = np.zeros((n, t.size)), np.zeros((n, t.size))
    for i in range(n):
        near = slice(i, i + over)
        centred = t[near] - t[near].mean()
        slope[i, near], mean[i, near] = centred / (centred @ centred), 1.0 / over
    return slope, mean


def _compared(
    run: Observations,
    name: str,
    words: str,
    label: Label,
    observed: FloatArray,
    replicated: FloatArray,
) -> Predicted:
    above, same = np.mean(replicated > observed), np.mean(replicated == observed)
    p = 2.0 * float(min(above + 0.5 * same, 1.0 - above - 0.5 * same))
    return Predicted(
        run.name, name, words, label, observed, replicated, max(p, 1.0 / replicated.size)
    )
