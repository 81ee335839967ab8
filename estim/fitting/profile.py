"""Profile-posterior intervals: how far one parameter can move before data and priors together
object.

The objective is  q(value) = -2 max log p(value, others | data), the maximum over all other
parameters, priors included as in the fit (with flat priors it is the profile likelihood).  The
interval of probability P is where q rises by no more than the chi-squared quantile of P with one
degree of freedom above its minimum (1.00 for 68.3 %, 3.84 for 95 %): exact where the posterior is
Gaussian in some transform of the parameter, good to the order 1/n_obs otherwise.  Use it where a
fit is asymmetric, at a bound, or weakly determined: a side on which q does not rise enough before
the edge of the prior is *open*, and this is stated.

The covariances of the noise are held at the fit, as everywhere in the posterior.  A search that
fails is a sentence in the record, never an exception.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.common import (
    PROBABILITIES,
    InputError,
    behind,
    later,
    percentage,
    phrase,
    require_one_of,
)
from estim.distributions import student_quantile
from estim.fitting.degrees_of_freedom import STATED, ErrorSizes
from estim.fitting.least_squares import Fit
from estim.fitting.profile_paths import crossing, dips, path, returns
from estim.fitting.profile_search import ProfileSearch, search_of
from estim.given_numbers import check_probability
from estim.levenberg_marquardt import End, Start, minima, run_descents
from estim.problem import Parameter

_SETTLED = 1e-9  # fall still promised at a mode
_HIDDEN = 1e-6  # difference of the objective
_LITTLE = 1e-4  # standard deviations of a parameter, the others held
_MOST_VALLEYS = 3
# part of a rise, and standard deviations, by which a point belongs to an interval that does not
# contain it
_SURELY, _FARTHER = 0.98, 0.01


@dataclass(frozen=True, eq=False)
class ProfileInterval:
    """The profile-posterior intervals of one parameter, in its own unit.

    name, value : the parameter and its value at the mode.
    low, high : probability -> end of the interval, or the edge (of the prior, or of the search) on
        an open side.
    open_low, open_high : probability -> whether the objective does not rise enough on that side.
    x, rise : (n_point,) where the profile was computed, increasing, and how far the objective
        stands above its minimum.
    by_size : whether it was computed in the logarithm of the parameter, whose sign is known.
    found_better : how far below the fit's the lowest objective met on the way lies; 0 if the fit's
        is the lowest.
    lowest : (n_par,) the values of all parameters there.
    n_failed : points at which the search over the other parameters did not settle.
    pieces : probabilities whose region has more than one piece.
    sentence : the intervals and every doubt about them, in words.
    """

    name: str
    value: float
    low: dict[float, float]
    high: dict[float, float]
    open_low: dict[float, bool]
    open_high: dict[float, bool]
    x: FloatArray
    rise: FloatArray
    by_size: bool
    found_better: float
    lowest: FloatArray
    n_failed: int
    pieces: tuple[float, ...]
    sentence: str


@dataclass(frozen=True, eq=False)
class Contour:
    """Profile of two parameters on a grid.

    a, b : names.
    x : (n,) values of a.  y : (n,) values of b.  rise : (n, n) objective above its minimum, rise[i,
        j] at (x[i], y[j]), inf where the density is zero.
    levels : probability -> rise (chi-squared with two degrees of freedom, or 2 F).
    n_failed : points at which the search over the other parameters did not settle.
    """

    a: str
    b: str
    x: FloatArray
    y: FloatArray
    rise: FloatArray
    levels: dict[float, float]
    n_failed: int


def profile_intervals(
    fit: Fit,
    *,
    names: Sequence[str] | None = None,
    probabilities: tuple[float, ...] = PROBABILITIES,
    sizes: ErrorSizes = STATED,
) -> tuple[ProfileInterval, ...]:
    """Profile-posterior intervals of the parameters `names` (all if None).  Raises InputError for
    an unknown name or probability.

    sizes : of the errors; where they were estimated, the ends are quantiles of Student's t.
    """
    indices = [_index(fit, name) for name in (fit.names if names is None else names)]
    if not indices:
        return ()
    shares = sizes.shares(np.eye(len(fit.names))[indices])
    dof = sizes.degrees_of_freedom(shares)
    ends = {
        p: sizes.rises(np.square(student_quantile(0.5 + 0.5 * p, dof)), shares)
        for p in _checked(probabilities)
    }
    rises = [{p: float(rise[k]) for p, rise in ends.items()} for k in range(len(indices))]
    search, mode = _prepared(fit, max(max(own.values()) for own in rises))
    profiles = [_intervals(fit, search, start, indices, rises) for start in _equal(search, mode)]
    return tuple(
        _with_sentence(_spanning(same), fit.problem.parameters[i])
        for i, same in zip(indices, zip(*profiles, strict=True), strict=True)
    )


def contour(
    fit: Fit,
    a: str,
    b: str,
    probabilities: tuple[float, ...] = PROBABILITIES,
    *,
    n: int = 17,
    sizes: ErrorSizes = STATED,
) -> Contour:
    """Profile of the parameters `a` and `b` on an n x n grid that holds the widest contour.  Raises
    InputError for an unknown name.

    sizes : of the errors; where they were estimated, a level is twice a quantile of Fisher's F with
        2 and dof degrees of freedom, r = dof ((1 - P)^(-2/dof) - 1), if they are held.
    """
    i, j = _index(fit, a), _index(fit, b)
    if i == j:
        raise InputError("must be another parameter than the first", field="b", value=b)
    if not probabilities:
        raise InputError("must hold one at least", field="probabilities")
    shares = np.mean(sizes.shares(np.eye(len(fit.names))[[i, j]]), axis=0, keepdims=True)
    dof = float(sizes.degrees_of_freedom(shares)[0])
    levels = {}
    for p in _checked(probabilities):
        r = -2.0 * math.log1p(-p)
        r = dof * math.expm1(r / dof) if math.isfinite(dof) else r
        levels[p] = float(sizes.rises(np.array([r]), shares)[0])
    widest = {1.0: 1.1 * max(levels.values())}
    search, mode = _prepared(fit, widest[1.0])
    axes = []
    for k, span in zip(
        (i, j), _intervals(fit, search, mode, (i, j), [widest, widest]), strict=True
    ):
        ends = np.tile(fit.values, (2, 1))
        ends[:, k] = span.low[1.0], span.high[1.0]
        low, high = search.coordinates.of(ends)[:, k]
        # the mode is one of the nodes, so that the minimum is on the grid
        below = np.linspace(low, mode.values[k], n // 2 + 1)
        axes.append(np.concatenate([below, np.linspace(mode.values[k], high, n - n // 2)[1:]]))
    rise, failed = _grid(search, mode, i, j, axes[0], axes[1])
    x, y = (search.coordinates.values_of(k, axis) for k, axis in zip((i, j), axes, strict=True))
    return Contour(a, b, x, y, rise, levels, failed)


def _prepared(fit: Fit, level: float) -> tuple[ProfileSearch, End]:
    """The search for rises up to `level`, and the mode."""
    search = search_of(fit.posterior, fit.values, fit.cov, level, squared=True)
    (mode,) = minima(search, [Start(search.coordinates.of(fit.values), (), tolerance=_SETTLED)])
    return search, mode


def _equal(search: ProfileSearch, mode: End) -> list[End]:
    """The mode, and the same with each parameter that it hides, as A = 0 does t in A exp(-x/t), at
    either of its limits: from there profiles lead into other valleys.
    """
    ends, bounded = [mode], np.isfinite(search.low) & np.isfinite(search.high)
    for i in np.flatnonzero(bounded) if math.isfinite(mode.objective) else ():
        moved = [replace(mode, values=mode.values.copy()) for _ in range(2)]
        moved[0].values[i], moved[1].values[i] = search.low[i], search.high[i]
        heights = search.objectives(np.array([end.values for end in moved]))
        if np.all(np.abs(heights - mode.objective) < _HIDDEN):
            ends += moved
    return ends


def _spanning(profiles: Sequence[ProfileInterval]) -> ProfileInterval:
    """One record of profiles of one parameter from several equal modes: the outermost ends."""
    first, *others = profiles
    for other in others:
        low = {p: min(end, other.low[p]) for p, end in first.low.items()}
        high = {p: max(end, other.high[p]) for p, end in first.high.items()}
        open_low = {p: opened or other.open_low[p] for p, opened in first.open_low.items()}
        open_high = {p: opened or other.open_high[p] for p, opened in first.open_high.items()}
        first = replace(
            other if (low, high) != (first.low, first.high) else first,
            low=low,
            high=high,
            open_low=open_low,
            open_high=open_high,
        )
    return first


def _index(fit: Fit, name: str) -> int:
    require_one_of(name, fit.names, field="names")
    return fit.names.index(name)


def _checked(probabilities: Sequence[float]) -> list[float]:
    for p in probabilities:
        check_probability(p, "probabilities")
    return sorted(probabilities)


def _intervals(
    fit: Fit,
    search: ProfileSearch,
    mode: End,
    indices: Sequence[int],
    rises: Sequence[dict[float, float]],
) -> list[ProfileInterval]:
    """Those of the parameters at `indices`, each with rises of its own: the paths of both sides of
    all of them are followed together, and then all their crossings are searched together.

    What is met on the way of one parameter counts for all: where another one is farther out than
    its own path came, in a valley beside that of the mode, a path goes on from there.
    """
    if not math.isfinite(mode.objective):
        return [
            _nowhere(fit.problem.parameters[i], i, fit.values, own)
            for i, own in zip(indices, rises, strict=True)
        ]
    sides = [(i, sign, own) for i, own in zip(indices, rises, strict=True) for sign in (-1.0, 1.0)]
    explored = [_Side([mode], {}, []) for _ in sides]
    outward = dict.fromkeys(range(len(sides)), mode)
    for _ in range(_MOST_VALLEYS):
        walks = run_descents(
            search,
            [
                path(search, mode, at, i, sign, max(own.values()))
                for at, (i, sign, own) in ((at, sides[k]) for k, at in outward.items())
            ],
        )
        for k, points in zip(outward, walks, strict=True):
            explored[k].path.extend(points)
        crossed = iter(
            run_descents(
                search,
                [
                    crossing(search, explored[k].path, sides[k][0], rise)
                    for k in outward
                    for rise in sides[k][2].values()
                ],
            )
        )
        for k in outward:
            explored[k].ends.update({p: next(crossed) for p in sides[k][2]})
            explored[k].valleys[:] = minima(
                search,
                [Start(dip.values, (), dip, tolerance=_SETTLED) for dip in dips(explored[k].path)],
            )
        if fit.problem.robust:  # whose narrow optima hold next to nothing
            break
        met = [point for side in explored for point in side.points]
        outward = {}
        for k, (i, sign, own) in enumerate(sides):
            outside = explored[k].outside(met, i, sign, own, float(search.scale[i]))
            farther = next(
                (point for point in outside if _is_nearest_image(fit, search, point)), None
            )
            if farther is not None:
                outward[k] = farther
        if not outward:
            break
    return [
        _interval(fit, search, i, explored[2 * k : 2 * k + 2], rises[k])
        for k, i in enumerate(indices)
    ]


def _is_nearest_image(fit: Fit, search: ProfileSearch, point: End) -> bool:
    """Whether a point is no image of one nearer to the fit that draws the same curve."""
    values = search.coordinates.values(point.values)
    if fit.symmetry is None:
        return True
    return np.array_equal(fit.symmetry.nearest(values, fit.values), values)


@dataclass(frozen=True, eq=False)
class _Side:
    """A path (first the mode), probability -> its crossing with the points that led there, and the
    minima of the valleys beside that of the mode.
    """

    path: list[End]
    ends: dict[float, tuple[float | None, list[End]]]
    valleys: list[End]

    @property
    def points(self) -> list[End]:
        trials = (point for _, points in self.ends.values() for point in points)
        return [*self.path, *trials, *self.valleys]

    def outside(
        self, met: Sequence[End], i: int, sign: float, rises: dict[float, float], scale: float
    ) -> list[End]:
        """The points that were met that an interval should hold, and does not; the farthest
        first.
        """
        outside = [
            point
            for p, rise in rises.items()
            if (end := self.ends[p][0]) is not None
            for point in met
            if point.objective - self.path[0].objective < _SURELY * rise
            and sign * (point.values[i] - end) > _FARTHER * scale
        ]
        return sorted(outside, key=lambda point: -sign * float(point.values[i]))


def _interval(
    fit: Fit, search: ProfileSearch, i: int, sides: Sequence[_Side], rises: dict[float, float]
) -> ProfileInterval:
    parameter, mode = fit.problem.parameters[i], sides[0].path[0]
    points = [
        mode,
        *(point for side in sides for _, trials in side.ends.values() for point in trials),
        *(p for side in sides for p in side.path[1:]),
    ]
    points.sort(key=lambda point: float(point.values[i]))
    finite = [point for point in points if math.isfinite(point.objective)]
    best = min(
        [*finite, *(point for side in sides for point in side.valleys)],
        key=lambda point: point.objective,
    )
    fall = max(0.0, search.objective(search.coordinates.of(fit.values)) - best.objective)
    # fall below the objective of the fit that counts as another, better optimum
    better = fall if fall > 0.02 and _stands(search, best, 0.5 * fall) else 0.0
    low, high = (
        dict(zip(side.ends, search.coordinates.values_of(i, ends_of).tolist(), strict=True))
        for side in sides
        for ends_of in (
            [side.path[-1].values[i] if end is None else end for end, _ in side.ends.values()],
        )
    )
    open_low, open_high = ({p: end is None for p, (end, _) in side.ends.items()} for side in sides)
    return ProfileInterval(
        name=parameter.name,
        value=float(search.coordinates.values(mode.values)[i]),
        low=low,
        high=high,
        open_low=open_low,
        open_high=open_high,
        x=search.coordinates.values_of(i, [point.values[i] for point in finite]),
        rise=np.array([point.objective - mode.objective for point in finite]),
        by_size=bool(search.coordinates.by_size[i]),
        found_better=better,
        lowest=search.coordinates.values(best.values),
        n_failed=sum(not point.converged for point in points),
        pieces=tuple(
            sorted(
                p for p, rise in rises.items() if any(returns(side.path, rise) for side in sides)
            )
        ),
        sentence="",
    )


def _stands(search: ProfileSearch, point: End, most: float) -> bool:
    """Whether the objective rises by no more than `most` with any parameter moved a little: one
    that rounding errors make low, where terms cancel, does not.
    """
    at = search.coordinates
    squared = at.squared  # by places: a little of a square at 0 is no little value
    steps = _LITTLE * np.diag(search.conditional)
    by_value = np.where(squared, 0.0, steps * at.slopes(at.centre))
    by_place = np.where(squared, steps, 0.0)
    ends_of = at.values(point.values) + np.vstack([by_value, -by_value])
    inside = np.clip(
        at.of(np.clip(ends_of, *search.posterior.problem.support()))
        + np.vstack([by_place, -by_place]),
        search.low,
        search.high,
    )
    return bool(np.all(search.objectives(inside) <= point.objective + most))


def _nowhere(
    parameter: Parameter, i: int, values: FloatArray, rises: dict[float, float]
) -> ProfileInterval:
    """The record where there is no minimum to start from."""
    value = float(values[i])
    everywhere, opened = dict.fromkeys(rises, value), dict.fromkeys(rises, True)
    sentence = phrase(
        "{symbol}: there is no interval, because the posterior density is zero or not a number at "
        "the fit",
        symbol=parameter.label.symbol,
    )
    return ProfileInterval(
        name=parameter.name,
        value=value,
        low=everywhere,
        high=dict(everywhere),
        open_low=opened,
        open_high=dict(opened),
        x=np.array([value]),
        rise=np.zeros(1),
        by_size=False,
        found_better=0.0,
        lowest=values,
        n_failed=1,
        pieces=(),
        sentence=sentence,
    )


_BELOW = (
    later("unbounded below{size}: no limit was found down to {place}, where the search ended"),
    later("unbounded below{size}: the mode lies at the edge {place} of the prior"),
    later("unbounded below{size}: there is no limit above the edge {place} of the prior"),
)
_ABOVE = (
    later("unbounded above{size}: no limit was found up to {place}, where the search ended"),
    later("unbounded above{size}: the mode lies at the edge {place} of the prior"),
    later("unbounded above{size}: there is no limit below the edge {place} of the prior"),
)


def _with_sentence(interval: ProfileInterval, parameter: Parameter) -> ProfileInterval:
    if interval.sentence:
        return interval
    label = parameter.label
    unit = behind(label.unit)
    intervals = [
        f"{percentage(p)} [{interval.low[p] * label.factor:.4g}, "
        f"{interval.high[p] * label.factor:.4g}]{unit}"
        for p in interval.low
    ]
    clauses = ["; ".join(intervals)]
    prior = parameter.prior
    for words, opened, ends, edge in (
        (_BELOW, interval.open_low, interval.low, prior.low),
        (_ABOVE, interval.open_high, interval.high, prior.high),
    ):
        which = [p for p in opened if opened[p]]
        if not which:
            continue
        end = ends[which[0]]
        end_text = f"{end * label.factor:.3g}{unit}"
        size = (
            ""
            if len(which) == len(opened)
            else phrase(
                " for {levels}", levels=phrase(" and ").join(f"{percentage(p)}" for p in which)
            )
        )
        if end != edge:
            clauses.append(phrase(words[0], size=size, place=end_text))
        elif abs(interval.value - edge) < 1e-3 * (
            max(interval.high.values()) - min(interval.low.values())
        ):
            clauses.append(phrase(words[1], size=size, place=end_text))
        else:
            clauses.append(phrase(words[2], size=size, place=end_text))
    clauses += [
        phrase(
            "the {p} region consists of several separate pieces; the interval spans them",
            p=percentage(p),
        )
        for p in interval.pieces
    ]
    if interval.found_better:
        better = phrase(
            "the search found a better point than the fit (minus twice the log density is "
            "lower by {by:.2g})",
            by=interval.found_better,
        )
        clauses.append(better)
    if interval.n_failed:
        clauses.append(
            phrase(
                "the search over the other parameters did not converge at {n} points",
                n=interval.n_failed,
            )
        )
    return replace(interval, sentence=f"{label.symbol}: " + "; ".join(clauses))


def _grid(
    search: ProfileSearch, mode: End, i: int, j: int, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, int]:
    """Rise (n, n) over the grid, each point started from its neighbour towards the mode, a ring at
    a time, and the number of failures.
    """
    rise = np.full((x.size, y.size), np.inf)
    if not math.isfinite(mode.objective):
        return rise, rise.size
    centre = (
        int(np.argmin(np.abs(x - mode.values[i]))),
        int(np.argmin(np.abs(y - mode.values[j]))),
    )
    rings: dict[int, list[tuple[int, ...]]] = {}
    for cell in np.ndindex(x.size, y.size):
        rings.setdefault(max(abs(cell[0] - centre[0]), abs(cell[1] - centre[1])), []).append(cell)
    slopes = search.cov[:, [i, j]] @ np.linalg.inv(search.cov[np.ix_([i, j], [i, j])])
    done: dict[tuple[int, ...], End] = {}
    for ring in sorted(rings):
        starts = []
        for cell in rings[ring]:
            near = done.get(
                tuple(int(c - np.sign(c - m)) for c, m in zip(cell, centre, strict=True)), mode
            )
            target = np.array([x[cell[0]], y[cell[1]]])
            values = np.clip(
                near.values + slopes @ (target - near.values[[i, j]]), search.low, search.high
            )
            instead = near.values.copy()
            values[[i, j]] = instead[[i, j]] = target
            # predicted decrease left at a point of a contour grid, good enough for a figure
            starts.append(Start(values, (i, j), near, instead, tolerance=1e-4))
        done |= zip(rings[ring], minima(search, starts), strict=True)
    for cell, point in done.items():
        rise[cell] = point.objective - mode.objective
    return rise, sum(not point.converged for point in done.values())
