"""What the ends of a search are: one place or several, the same curve under other numbers, or
another solution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estim.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    all_finite,
    max_abs,
    root_mean_square,
    sds_of,
)
from estim.common import Amount, Finding, Kind
from estim.fitting.gauss_newton import (
    End,
    inverse_information,
    is_close,
    near_bound,
    spread_at,
    unit_at,
)
from estim.fitting.least_squares import WITHIN_REACH
from estim.fitting.separable import SeparableSearch
from estim.problem import TURNS, Symmetry

SAME = 1e-6  # relative difference of sums of squares between equal optima
MOST_OTHERS = 16  # other optima that are kept
PLACE = 0.5  # standard deviations: closer ends are one place
_EXACT, _ROUNDED = 1e-9, 0.01  # of the distance between two points: from its even place
_ASIDE = 0.382  # of the distance: no simple share, at which other aliases meet again
_WIDER = 3.0  # in log share: an optimum that is not the lowest, but holds far more
_AS_GOOD = 4.5  # in log likelihood: three standard deviations
# abscissas at which curves that do not repeat are recognised at a glance, by so much of their size
_GLANCED, _GLANCE = 16, 1e-3
# root mean square of the difference between curves through nearly the same points, of the scatter;
# times that, between the points
_NEARLY, _APART = 0.7, 5.0
_SCATTER_SHARE = 0.01  # of the scatter, by which curves through the same points differ
# ratio of singular values from which a normal distribution gives the probability of an optimum
_SOUND = 1e-6


def equal_to(search: SeparableSearch, chi2: float) -> float:
    """The largest sum of squares that counts as equal to `chi2`."""
    return chi2 * (1.0 + SAME) + search.rounding


def chi2_limit(search: SeparableSearch, best: End) -> float:
    """The sum of squares beyond which an optimum holds next to nothing of the posterior; by the
    residuals where their size is not stated.
    """
    if search.unstated:
        return best[1] * math.exp(min(2.0 * WITHIN_REACH / search.dof, 10.0)) + search.rounding
    return best[1] + 2.0 * WITHIN_REACH


def is_at(end: FloatArray, values: FloatArray, spread: FloatArray, symmetry: Symmetry) -> bool:
    """Whether a descent ended within `PLACE` of the standard deviations `spread` (n_par,) of
    `values`, labels aside.
    """
    return is_close(end, values, spread, PLACE) or any(
        is_close(image, values, spread, PLACE) for image in symmetry.within(end, values)
    )


def distinct_ends(
    search: SeparableSearch, best: End, ends: list[End], symmetry: Symmetry
) -> list[End]:
    """Ends that are not much worse than the best, each point once, labels apart; the best first."""
    distinct: list[End] = []
    spreads: list[FloatArray] = []
    limit = chi2_limit(search, best)
    for end in sorted(ends, key=lambda candidate: candidate[1]):
        if end[1] > limit or len(distinct) > MOST_OTHERS:
            break
        if not any(
            is_at(end[0], other, spread, symmetry)
            for (other, _), spread in zip(distinct, spreads, strict=True)
        ):
            distinct.append(end)
            spreads.append(spread_at(search, end))
    return distinct


def choose(
    search: SeparableSearch, distinct: list[End], symmetry: Symmetry, start: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[Finding, ...]]:
    """The lowest optimum, or one with a far larger share of the posterior, the other solutions
    (n_other, n_par), and findings about those left out.

    Other numbers that draw the same curve everywhere are one solution with it, given in `canonical`
    form, but not by numbers that hold next to nothing of the posterior.  Of curves
    through the same points or nearly so (a frequency plus the rate of sampling; through points that
    only rounded times distinguish, too) the one closest to the start is taken, or the smoothest
    where none was stated, or where ratios and differences do not agree on which that is.  Their
    weights do not count: they depend on how the curve is written.  Where the user gave no range
    that holds the others and the one taken is the smoothest of all, the others are left out and no
    solutions.  A worse end from which the next step would still lead away is no optimum: a
    parameter on its way to infinity has any share.
    """
    if len(distinct) == 1:
        return canonical(search, [distinct[0][0]], symmetry, start), np.zeros((0, start.size)), ()
    solutions: list[list[End]] = []
    for end in distinct[:1] + [end for end in distinct[1:] if _is_optimum(search, end)]:
        known = next((ends for ends in solutions if is_same(search, end, ends[0])), None)
        if known is None:
            solutions.append([end])
        else:
            known.append(end)
    named, shares = [], []
    for members in solutions:
        weights = [_log_share(search, end) for end in members]
        shares.append(max(weights))
        heavy = [w >= shares[-1] - WITHIN_REACH for w in weights]
        same_curve = [
            values for (values, _), is_heavy in zip(members, heavy, strict=True) if is_heavy
        ]
        named.append(canonical(search, same_curve, symmetry, start))
    ends = [(values, members[0][1]) for values, members in zip(named, solutions, strict=True)]
    widest = int(np.argmax(shares))
    best = ends[widest if math.isfinite(shares[0]) and shares[widest] > shares[0] + _WIDER else 0]
    through = [
        i
        for i, end in enumerate(ends)
        if end is best or _is_alias(search, end, best) or _as_good(search, end, best, between=False)
    ]
    ranges = np.ptp([named[i] for i in through], axis=0)
    steady = np.array(
        [i for i in search.nonlinear if not math.isfinite(symmetry.period[i])], dtype=np.int64
    )
    spread = spread_at(search, best)
    moved = steady[ranges[steady] > spread[steady]]
    chosen, findings = through[0], list[Finding]()
    if moved.size:
        reference = canonical(search, [start], symmetry, start)
        alone = np.isin(np.arange(start.size), moved)

        def by_ratio(i: int) -> float:
            return float(distance(search, np.where(alone, named[i], reference), reference))

        def by_difference(i: int) -> float:
            return float(np.sum(((named[i] - reference)[moved] / ranges[moved]) ** 2))

        chosen, parameters = min(through, key=by_ratio), search.posterior.problem.parameters
        if chosen != min(through, key=by_difference) or not any(
            parameters[k].prior.start_stated for k in moved
        ):  # far from all of them, or from nowhere
            chosen = min(through, key=lambda i: _roughness(search, named[i]))

    def report(kind: Kind, others: list[FloatArray], which: IntArray) -> None:
        names = search.posterior.problem.names
        parts = tuple(
            Finding(Kind.VALUES, parameters=tuple(Amount(names[k], float(other[k])) for k in which))
            for other in others[:2]
        )
        if parts and which.size:
            findings.append(Finding(kind, parts=parts))

    same_curve = [canonical(search, [values], symmetry, start) for values, _ in solutions[chosen]]
    differ = np.max(np.abs(np.array(same_curve) - named[chosen]), axis=0) > spread
    same_curve = [
        values for values in same_curve if not is_close(values, named[chosen], spread, PLACE)
    ]
    differing = steady[differ[steady]]
    report(Kind.OTHER_NUMBERS, same_curve, differing if differing.size else np.flatnonzero(differ))
    aliases = [
        i
        for i, end in enumerate(ends)
        if i != chosen and (i in through or _is_alias(search, ends[chosen], end))
    ]
    if np.all(_has_range(search, moved)) or any(
        _roughness(search, named[i]) < _roughness(search, named[chosen]) for i in aliases
    ):
        aliases = []
    report(Kind.FASTER_CURVES, [named[i] for i in aliases], moved)
    rest = [named[i] for i in range(len(named)) if i != chosen and i not in aliases]
    return named[chosen], np.array(rest).reshape(-1, start.size), tuple(findings)


def canonical(
    search: SeparableSearch,
    equivalents: Sequence[FloatArray],
    symmetry: Symmetry,
    start: FloatArray,
) -> FloatArray:
    """Of the values `equivalents` that draw the same curve, and of their images, those closest to
    the starts that were stated; of these those with positive frequencies and widths, then with
    positive amplitudes, with phases within half a turn, and closest to starts that were found from
    the points.
    """
    stated = np.array([p.prior.start_stated for p in search.posterior.problem.parameters])
    near = np.where(~stated & np.isfinite(symmetry.period), 0.0, start)
    flips = np.flatnonzero(symmetry.flips)
    linear = np.isin(flips, search.linear)
    phase = np.isfinite(symmetry.period[flips])

    def order(image: FloatArray) -> tuple[float, ...]:
        negative = image[flips] < 0.0
        turned = np.abs(image - near)[np.isfinite(symmetry.period)]
        far = float(distance(search, np.where(stated, image, start), start, symmetry.period))
        kinds = ~(linear | phase), linear, phase
        signs = [float(np.sum(negative & kind)) for kind in kinds]
        return (
            round(far, 9),
            *signs,
            round(float(np.sum(turned)), 9),
            float(distance(search, image, start, symmetry.period)),
        )

    images = [image for values in equivalents for image in symmetry.within(values, near)]
    return min(images, key=order, default=equivalents[0])


def _is_optimum(search: SeparableSearch, end: End) -> bool:
    """Whether the next step of Gauss and Newton stays within half a standard deviation, limits
    held.
    """
    (jacobian, residuals), moving = search.posterior.scoring(end[0]), _moving(search, end)
    jacobian = jacobian[:, moving]
    if not all_finite(jacobian):
        return True
    cov = inverse_information(jacobian)[0]
    step = np.abs(cov @ (jacobian.T @ residuals))
    return bool(np.all(step <= PLACE * unit_at(search, end) * sds_of(cov)))


def _moving(search: SeparableSearch, end: End) -> IntArray:
    """The parameters that are moved and not pressed onto a limit at an end."""
    jacobian, residuals = search.posterior.scoring(end[0])
    return search.free[~near_bound(search, end[0], jacobian, residuals, end[1])[search.free]]


def _log_share(search: SeparableSearch, end: End) -> float:
    """Log of what an optimum holds of the posterior, by the normal distribution there and, of
    parameters pressed onto a limit, by how fast the density falls; -inf where that tells nothing.
    """
    (jacobian, residuals), moving = search.posterior.scoring(end[0]), _moving(search, end)
    if not all_finite(jacobian[:, search.free]):
        return -math.inf
    cov, condition = inverse_information(jacobian[:, moving])
    if not condition > _SOUND:
        return -math.inf
    # beside a limit an optimum is no wider than the room to it
    room = np.minimum(end[0] - search.low, search.high - end[0])[moving]
    cut = np.minimum(1.0, room / sds_of(cov))
    pressed = np.setdiff1d(search.free, moving)
    fall = np.maximum(np.abs(jacobian.T @ residuals), np.linalg.norm(jacobian, axis=0))[pressed]
    width = 1.0 / np.maximum(fall, 1.0 / search.squares.size[pressed])
    volume = 0.5 * float(np.linalg.slogdet(cov)[1]) + float(np.sum(np.log([*cut, *width])))
    share = _height(search, end[1]) + volume
    return share if math.isfinite(share) else -math.inf


def _height(search: SeparableSearch, chi2: float) -> float:
    """Log likelihood at a sum of squares, by the residuals where their size is not stated."""
    if search.unstated:
        return -0.5 * search.dof * math.log(chi2 + search.rounding)
    return -0.5 * chi2


def is_same(search: SeparableSearch, end: End, other: End) -> bool:
    """Whether two ends draw the same curve everywhere; not where a range holds both of the only
    nonlinear parameter in which they differ: it shows that both are meant.
    """
    if not _as_good(search, end, other, between=True):
        return False
    differs = np.abs(end[0] - other[0]) > PLACE * spread_at(search, other)
    moved = search.nonlinear[differs[search.nonlinear]]
    return moved.size > 1 or not bool(np.all(_has_range(search, moved)))


def _has_range(search: SeparableSearch, which: IntArray) -> BoolArray:
    return np.isfinite(search.low[which]) & np.isfinite(search.high[which])


def _as_good(search: SeparableSearch, end: End, other: End, *, between: bool) -> bool:
    """Whether two ends draw the same curves (`_same_curve`) and their priors are as good."""
    return abs(end[1] - other[1]) <= SAME * other[1] + search.rounding and _same_curve(
        search, end[0], other[0], between=between, scatter_share=_SCATTER_SHARE
    )


def _same_curve(
    search: SeparableSearch,
    values: FloatArray,
    other: FloatArray,
    *,
    between: bool,
    scatter_share: float = 0.0,
) -> bool:
    """Whether two sets of values draw the same curves at the points, or, `between`, at places
    between them as well.  scatter_share : times the scatter about the curve, of two ends of
    searches that may differ by so much.
    """
    problem = search.posterior.problem
    named = problem.named(other)
    for run in problem.runs:
        x = np.linspace(run.x.min(), run.x.max(), 3 * run.n_obs + 7) if between else run.x
        a, b = (run.drawn(point, x) for point in (problem.named(values), named))
        scatter = root_mean_square(run.y - run.drawn(named)) if scatter_share else 0.0
        tolerance = max(1e-5 * max_abs(a), scatter_share * scatter, 1e-305)
        if not np.max(np.abs(a - b)) <= tolerance:
            return False
    return True


def repeats(search: SeparableSearch, values: FloatArray, period: FloatArray) -> FloatArray:
    """(n_par,) the least step after which a nonlinear parameter without limits draws the same curve
    again, a whole turn times or over another argument; inf where there is none.
    """
    problem, steps = search.posterior.problem, np.full(values.size, np.inf)
    named = problem.named(values)
    glances = [np.linspace(run.x.min(), run.x.max(), _GLANCED) for run in problem.runs]
    sizes = {
        abs(float(np.ravel(size)[0])) for run in problem.runs for size in run.bind(named).values()
    } - {0.0}
    tried = sorted(turn * s for turn in TURNS for size in sizes for s in (size, 1.0 / size))
    for i in search.nonlinear:
        if math.isfinite(period[i]) or math.isfinite(problem.parameters[i].prior.sd):
            continue
        unit = np.eye(values.size)[i]
        shifted = problem.named(values + np.multiply.outer([0.0, *tried], unit))
        same = np.ones(len(tried), dtype=bool)
        for run, x in zip(problem.runs, glances, strict=True):
            curves = np.broadcast_to(run.curve.value(x, run.bind(shifted)), (1 + same.size, x.size))
            same &= ~(np.max(np.abs(curves[1:] - curves[0]), axis=1) > _GLANCE * max_abs(curves))
        for step in np.array(tried)[same].tolist():
            if all(
                _same_curve(search, values, values + share * step * unit, between=True) is same
                for share, same in ((1.0, True), (0.37, False))
            ):
                steps[i] = step
                break
    return steps


def _is_alias(search: SeparableSearch, end: End, other: End) -> bool:
    """Whether the curve at `end` explains the points about as well as another, at least, that is
    nearly the same there, and between them far from it.  Points that are evenly spaced but for
    rounding are moved to where they would be.
    """
    problem, is_far, moved = search.posterior.problem, False, False
    named, others = problem.named(end[0]), problem.named(other[0])
    for run in problem.runs:
        number = np.arange(run.n_obs) - 0.5 * (run.n_obs - 1)
        step = float(number @ run.x) / max(float(number @ number), 1.0)
        even = np.mean(run.x) + step * number
        rounded = _EXACT * step < max_abs(run.x - even) <= _ROUNDED * step
        x = even if rounded else np.sort(run.x)
        at_points, between = (
            root_mean_square(run.drawn(named, at) - run.drawn(others, at))
            for at in (x, x + _ASIDE * np.diff(x, append=x[-1]))
        )
        # of the points about a curve
        scatter = root_mean_square(run.y - run.drawn(named))
        if not at_points <= _NEARLY * scatter:
            return False
        moved |= rounded
        is_far |= between > _APART * max(at_points, _SCATTER_SHARE * scatter)
    return is_far and (moved or _height(search, end[1]) >= _height(search, other[1]) - _AS_GOOD)


def _roughness(search: SeparableSearch, values: FloatArray) -> float:
    """How much the curves go up and down between the points."""
    named = search.posterior.problem.named(values)
    total = 0.0
    for run in search.posterior.problem.runs:
        # abscissas at which curves through the same points are compared
        x = np.linspace(run.x.min(), run.x.max(), 400 * (1 + run.n_obs // 20))
        total += float(np.sum(np.abs(np.diff(run.drawn(named, x)))))
    return total


def distance(
    search: SeparableSearch,
    values: FloatArray,
    other: FloatArray,
    period: FloatArray | float = math.inf,
) -> FloatArray:
    """(...) how far points (..., n_par) are from another (n_par,): changes of sign, then factors,
    of the nonlinear parameters, or turns of those with a `period`, whose 0 is a value like any
    other; signs of the linear ones.
    """
    a, b = values[..., search.nonlinear], other[search.nonlinear]
    turn = np.broadcast_to(period, other.shape)[search.nonlinear]
    with np.errstate(all="ignore"):
        factors = np.where(
            b == 0.0,
            np.minimum(np.abs(a), 10.0),
            np.log(np.maximum(np.abs(a / np.where(b == 0.0, 1.0, b)), 1e-6)),
        )
        squares = np.where(a * b < 0.0, 100.0, 0.0) + factors**2
        squares = np.where(np.isfinite(turn), ((a - b) / turn) ** 2, squares)
    signs = np.sum(values[..., search.linear] * other[search.linear] < 0.0, axis=-1)
    return np.sum(squares, axis=-1) + 30.0 * signs
