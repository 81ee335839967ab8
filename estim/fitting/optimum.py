"""The best point of a problem whose starting values may be far off.

Parameters that the curve is linear in need no start: they are solved for at every step (variable
projection; Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, with Kaufman's Jacobian), so the
search runs in the others alone.  It goes down from the starting values.  From there, because a
frequency or a rate has many local optima, every nonlinear parameter is scanned through its whole
range (`estim.fitting.further_optima`), so that other optima are met, better ones or equal ones; a
better one is scanned from in turn.  The best is polished by Gauss-Newton steps with a QR
decomposition until they are at rounding error.  Values
that draw the same curve everywhere (two exponentials can change places) are one optimum, given with
the labels closest to the user's start, whether a map of all parameters leads from one to the other
(`estim.problem.symmetry`) or not.  All else that is not much worse
is another solution.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import BoolArray, FloatArray, Named, all_finite, sds_of
from estim.common import Amount, Finding, InputError, Kind, NumericalError, phrase
from estim.fitting.distinct_optima import (
    MOST_OTHERS,
    PLACE,
    SAME,
    chi2_limit,
    choose,
    distance,
    distinct_ends,
    equal_to,
    is_at,
    is_same,
    repeats,
)
from estim.fitting.fisher_information import known_from_data
from estim.fitting.further_optima import far_points, further_optima
from estim.fitting.gauss_newton import (
    End,
    descended,
    inverse_information,
    is_close,
    near_bound,
    spread_at,
    stepped,
    unit_at,
)
from estim.fitting.least_squares import (
    WITHIN_REACH,
    Fit,
    at_mode,
    converged_message,
    distinct_from,
    fit_least_squares,
    unconverged_message,
)
from estim.fitting.noise_fit import fit_noise
from estim.fitting.profile_search import search_of
from estim.fitting.separable import RESOLVED, SeparableSearch, separated
from estim.fitting.symmetry_search import find_symmetry
from estim.levenberg_marquardt import Start, minima
from estim.problem import (
    MOST_REWEIGHTED,
    Observations,
    Problem,
    Symmetry,
    errors_widened,
    no_symmetry,
)

_LEVEL = 0.1  # in log share: starts that are as good as the best
# ratio of singular values, whose square, of the correlations, is lost by rounding
_FRAIL = 1e-8
_FLAT = 1e-10  # fall of -2 log density that is still predicted where a descent ends
_MOST_REFITTED = 6  # of them by full fits, where the curve is a model of the study
_ALIKE = 0.01  # squared distance of starts that are not worth two descents
_AROUND = 8  # descents from points around one where the curve is not finite
_MOST_DESCENTS = 24  # from the dips of one round of scans
# of -2 log density: what lies far from the mode is as improbable as three standard deviations are
_HELD = 9.0
# where a prior does not give the posterior an end, that of counts or of a frequency: the density
# is below 1e-4 of that at the mode
_HELD_WITHOUT_END = 18.0
# standard deviations to the side of a kink; rise of the squares there, at most
_BESIDE, _SMALL = 1e-3, 0.1
_NOTHING = 1e-6  # standard deviations by which a curve depends on a parameter: rounding errors
MAX_PARAMETERS = 14  # of problems that are scanned, and have a second opinion


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best point found.

    values : (n_par,).
    cov : (n_par, n_par) inverse information in the whitened residuals' units; `free` parameters
        only, zero elsewhere (noise parameters, parameters on a bound).  chi2 : sum of squares,
        priors included.
    rounding : what rounding errors may leave of chi2.
    step : size of the last Gauss-Newton step in standard deviations; tolerance : what rounding
        errors may leave of it.
    mover : the parameter that it moved most.
    condition : smallest / largest singular value, columns of unit length; resolved : what it must
        exceed to be distinguished from zero.
    at_bound : (n_par,) which parameters lie on a bound.
    from_start : whether the starting values led here; else a scan did.
    others : (n_other, n_par) other optima that are not much worse, best first; not those that only
        change labels.
    symmetry : what else draws the same curve.
    aliases : other curves through the same points.
    unheld : a parameter that the data hardly keep from infinity, if there is one.
    """

    values: FloatArray
    cov: FloatArray
    chi2: float
    rounding: float
    step: float
    tolerance: float
    mover: str
    condition: float
    resolved: float
    at_bound: BoolArray
    from_start: bool
    others: FloatArray
    symmetry: Symmetry
    aliases: tuple[Finding, ...]
    unheld: Finding | None = None

    @property
    def singular(self) -> bool:
        return not self.condition > self.resolved

    @property
    def frail(self) -> bool:
        """Whether the covariance matrix is beyond what further computation with it (sampling) can
        bear.
        """
        return not self.condition > _FRAIL

    @property
    def settled(self) -> bool:
        return self.step < self.tolerance


def find_optimum(
    problem: Problem,
    start: FloatArray,
    *,
    rng: np.random.Generator,
    scan: bool = True,
    unstated: bool = False,
) -> Optimum:
    """The best point of `problem` in its curve parameters; noise parameters stay at `start`
    (n_par,).

    scan : whether other optima are looked for; else the one that `start` leads to is taken.
    unstated : whether only the residuals show how large the errors are.

    Raises InputError where the curve is not finite at the start nor at any point around it.
    """
    with np.errstate(all="ignore"):  # far from the optimum a curve may overflow: such points lose
        simpler = problem.for_search()
        if simpler is not problem:
            try:
                afar = find_optimum(simpler, start, rng=rng, scan=scan, unstated=True)
            except InputError:  # single trials look like a step, which they need not be
                search = separated(problem, start, rng, unstated=unstated)
                # of counts, profiles report what they leave open
                return replace(_optimum_of(search, start, rng, scan), unheld=None)
            # what is known of outliers is in the values of the simpler problem alone
            start = afar.values if problem.robust else start
            search = separated(problem, start, rng, unstated=unstated)
            return _optimum_near(search, start, afar, rng)
        if not problem.robust:
            return _optimum_of(separated(problem, start, rng, unstated=unstated), start, rng, scan)
        starts = _reweighted(problem, start, rng) if scan else [start]
        # what is an outlier depends on the size of the errors, and that on the curve
        ends = [end for point in starts for end in _with_errors(problem, point)]
        most = max(share for _, share in ends)
        # of the same curve at the points the one that is nearest to the start comes first
        start = next(point for point, share in ends if share > most - _LEVEL)
        return _optimum_of(separated(problem, start, rng, unstated=unstated), start, rng, scan)


def _with_errors(problem: Problem, point: FloatArray) -> Iterator[End]:
    """`point` (n_par,) with what is unknown of the errors fit to its curve, from errors as large as
    there and from smaller ones; and the log of about what that holds of the posterior, whose width
    goes with the size of the errors.  A few of few readings may lie on a curve by chance: the
    density is high there, and narrow.
    """
    sizes = np.array([name in problem.sizes_of_errors for name in problem.names])
    posterior = problem.linearised(point)
    for share in (1.0, 0.2, 0.04):
        fitted = fit_noise(posterior, np.where(sizes, share * point, point))
        named = dict(zip(problem.names, fitted.tolist(), strict=True))
        width = np.mean([_log_sd(run, named) for run in problem.runs if run.noise.robust])
        height = posterior.height(fitted)
        yield fitted, height + (len(problem.of_curve) + 1) * float(width)


def _log_sd(run: Observations, named: Named) -> float:
    """Log of the standard deviation of most readings, with all that is known of it."""
    weight = np.square(run.noise.reading_gain())
    return 0.5 * float(np.log(np.median(run.noise.size.variance(weight, named))))


def _reweighted(problem: Problem, start: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """(n_par,) each, optima under normal errors that are as much wider as readings are far from the
    curve (`errors_widened`): points that a few of them, however far off, do not decide.

    One begins with the curve at the start, one with errors as they are stated.
    """
    stated = [np.ones(run.n_obs) for run in problem.runs]
    bounds = np.cumsum([run.n_obs for run in problem.runs])[:-1]

    def errors_at(point: FloatArray, wider: list[FloatArray]) -> list[FloatArray]:
        residuals = problem.with_normal_errors(wider).linearised(point).residuals(point)
        # a start may be where a curve has no value: there no reading is far off
        of_readings = np.nan_to_num(residuals[: problem.n_obs], posinf=0.0, neginf=0.0)
        return [
            errors_widened(w * r) if run.noise.robust else w
            for run, w, r in zip(problem.runs, wider, np.split(of_readings, bounds), strict=True)
        ]

    ends = []
    for wider in (errors_at(start, stated), stated):
        point = start
        for _ in range(MOST_REWEIGHTED):
            normal, before = problem.with_normal_errors(wider), wider
            point = find_optimum(normal, point, rng=rng, unstated=True).values
            wider = errors_at(point, wider)
            if all(np.allclose(a, b, rtol=0.1) for a, b in zip(before, wider, strict=True)):
                break
        ends.append(point)
    return ends


def _optimum_of(
    search: SeparableSearch, start: FloatArray, rng: np.random.Generator, scan: bool
) -> Optimum:
    scan = bool(search.nonlinear.size) and scan
    tried = descended(search, start[None, :])
    ends = tried
    if scan and not ends:
        ends = descended(search, _scattered(search, start, rng))
    if not ends:
        raise _nowhere_finite(search.posterior.problem, start)
    best = min(ends, key=lambda end: end[1])
    _refuse_vanishing(search.posterior.problem, best[0])
    # a descent ends where the curve depends on a parameter no longer, as a^2 x does at a = 0
    if scan and not np.all(np.any(search.posterior.jacobian(best[0])[:, search.nonlinear], axis=0)):
        ends = [*ends, *descended(search, _scattered(search, start, rng))]
        best = min(ends, key=lambda end: end[1])
    if not scan:
        alone, symmetry = np.zeros((0, start.size)), no_symmetry(search.posterior.problem)
        return _polished(search, best[0], alone, symmetry, (), from_start=True)
    nonlinear = search.nonlinear.tolist()
    symmetry, first = find_symmetry(search.posterior.problem, best[0], nonlinear, rng), best
    best, every = _scanned(search, best, ends, symmetry)
    if best[1] < 0.5 * first[1]:  # on its way to infinity a parameter may seem to change nothing
        symmetry = find_symmetry(search.posterior.problem, best[0], nonlinear, rng)
    symmetry = symmetry.scaled(spread_at(search, best), nonlinear)
    optimum = _chosen(search, start, best, tried, every, symmetry)
    spread = spread_at(search, (optimum.values, optimum.chi2))  # perhaps of another alias
    symmetry = symmetry.scaled(spread, nonlinear)
    optimum = replace(optimum, symmetry=symmetry)
    steps = repeat = repeats(search, optimum.values, symmetry.period)
    if np.any(np.isfinite(repeat)):
        optimum = _repeated(search, optimum, tried, repeat, start)
        # a quarter of a step that the data leave open anyway is as good as no limit
        spread = spread_at(search, (optimum.values, optimum.chi2))
        repeat = np.where(steps > 16.0 * spread, steps, np.inf)
        optimum = replace(optimum, symmetry=replace(optimum.symmetry, repeat=repeat))
    unheld = _unheld(search, optimum, np.fmin(symmetry.period, repeat))
    if unheld is not None:
        step = float(steps[search.posterior.names.index(unheld.parameters[0].name)])
        if math.isfinite(step):
            unheld = replace(unheld, kind=Kind.STEPS_OPEN, size=step)
            # which of its images were met is chance
            optimum = replace(optimum, others=optimum.others[:0])
    return replace(optimum, unheld=unheld)


def _scattered(search: SeparableSearch, start: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(n, n_par) the best of many points around a start that leads nowhere: each nonlinear
    parameter times a factor, or one of any sign where it is 0.
    """
    points = np.repeat(start[None, :], 200, axis=0)
    sizes = np.where(start == 0.0, rng.choice([-1.0, 1.0], points.shape), start)
    factors = 10.0 ** rng.standard_normal(points.shape)
    drawn = np.clip(sizes * factors, search.low, search.high)
    points[:, search.nonlinear] = drawn[:, search.nonlinear]
    return points[np.argsort(search.squares.objectives(points), kind="stable")[:_AROUND]]


def _chosen(
    search: SeparableSearch,
    start: FloatArray,
    best: End,
    tried: list[End],
    every: list[End],
    symmetry: Symmetry,
) -> Optimum:
    """The optimum that `every` end of descents and scans gives, with the other solutions among
    them; tried : the ends that the starts led to.
    """
    distinct = distinct_ends(search, best, every, symmetry)
    values, others, aliases = choose(search, distinct, symmetry, start)
    chosen, spread = (values, search.chi2(values)), spread_at(search, best)
    from_start = any(
        is_at(end[0], values, spread, symmetry) or is_same(search, end, chosen) for end in tried
    )
    return _polished(search, values, others, symmetry, aliases, from_start=from_start)


def _repeated(
    search: SeparableSearch,
    optimum: Optimum,
    tried: Sequence[End],
    repeat: FloatArray,
    start: FloatArray,
) -> Optimum:
    """The same optimum, each parameter that repeats whole and half steps closer to where it was
    stated to start, or to 0; half a step may change the sign of a factor, and positive ones come
    first.
    """
    stated = np.array([p.prior.start_stated for p in search.posterior.problem.parameters])
    near, points = np.where(stated, start, 0.0), [optimum.values]
    for i in np.flatnonzero(np.isfinite(repeat)):
        half = 0.5 * repeat[i]
        first = optimum.values[i] - half * np.round((optimum.values[i] - near[i]) / half)
        points += [
            np.where(np.arange(near.size) == i, first + step, point)
            for point in points
            for step in (-half, 0.0, half)
        ]
    limit = equal_to(search, optimum.chi2)
    images = [
        image
        for end, chi2 in descended(search, np.array(points))
        if chi2 <= limit
        for image in optimum.symmetry.within(end, near)
    ]
    period = np.fmin(optimum.symmetry.period, repeat)
    signed = optimum.symmetry.flips | np.isin(np.arange(near.size), search.linear)

    def order(image: FloatArray) -> tuple[float, ...]:
        negative = image * np.where(stated, start, 1.0) < 0.0
        far = float(distance(search, np.where(stated, image, start), start, period))
        distances = np.abs(image - near)[np.isfinite(repeat)]
        return round(far, 9), float(np.sum(negative & signed)), float(np.sum(distances))

    return _polished(
        search,
        min(images, key=order, default=optimum.values),
        optimum.others,
        optimum.symmetry,
        tuple(f for f in optimum.aliases if f.kind is not Kind.OTHER_NUMBERS),
        from_start=any(chi2 <= limit for _, chi2 in tried),
    )


def _unheld(search: SeparableSearch, optimum: Optimum, period: FloatArray) -> Finding | None:
    """The parameter without a limit, if any, far along which the posterior density is not
    negligible.

    Its rise there, in -2 log, is that of the density over all linear parameters and the unknown
    sizes of the errors; robust errors are fit anew there.
    """
    if optimum.singular or optimum.chi2 <= optimum.rounding:
        return None
    problem = search.posterior.problem
    best = optimum.chi2 + optimum.rounding
    hardly: list[tuple[float, int]] = []
    # of the squares of n residuals those of n - n_par are left when the others are integrated out
    dof = search.dof
    spread = spread_at(search, (optimum.values, optimum.chi2))

    # the squares of a log density have any height
    scaled = search.unstated and not problem.own_density

    def rises_of(points: FloatArray, squares: FloatArray) -> FloatArray:
        if not problem.robust:
            return dof * np.log(np.maximum(squares / best, 1.0)) if scaled else squares - best
        ends = np.array([fit_noise(search.posterior, end) for end in (optimum.values, *points)])
        density = search.posterior.log_density(ends)
        return 2.0 * dof / problem.n_obs * (density[0] - density[1:])

    for i, (points, squares) in far_points(search, optimum.values, spread, period).items():
        rises = rises_of(points, squares)
        least = float(np.nanmin(rises, initial=math.inf))
        present = rises < _HELD_WITHOUT_END
        if least < _HELD or (np.any(present) and not _fades(search, i, points, present)):
            hardly.append((least, i))
    if not hardly:
        return None
    rise, i = min(hardly)
    return Finding(Kind.HARDLY_HELD, size=max(rise, 0.0), parameters=(Amount(problem.names[i]),))


def _fades(search: SeparableSearch, i: int, points: FloatArray, present: BoolArray) -> bool:
    """Whether the curve depends less on parameter i at the farther of two points (n, n_par) in
    turn, all others following: Jeffreys' prior then gives its posterior an end.

    present : (n,) whether there is any density at a point.
    """
    if search.posterior.problem.counted:
        return False
    sizes = np.zeros(len(points))
    for k, point in enumerate(points):
        rows = search.posterior.scoring(point)[0]
        if all_finite(rows):
            own, others = rows[:, i] * point[i], rows[:, search.free[search.free != i]]
            along = others @ np.linalg.lstsq(others, own, rcond=None)[0]
            sizes[k] = np.linalg.norm(own - along)
    less = sizes[1::2] <= np.maximum(sizes[::2], _NOTHING)
    return bool(np.all(less | ~present[1::2]))


def _refuse_vanishing(problem: Problem, values: FloatArray) -> None:
    """Raises InputError where the best density is one that numbers cannot hold."""
    named = problem.named(values[None, :])
    for run in problem.runs:
        look = getattr(run.curve, "vanishes", None)  # of a density (`estim.curves.binned`)
        if look is not None and look(run.points.bind(named)):
            raise InputError(
                "is a density so close to 0 at all events that numbers cannot hold it: count x "
                "from an origin near them, as in exp(-(x - origin)/tau)",
                field="curve",
            )


def _nowhere_finite(problem: Problem, start: FloatArray) -> InputError:
    named = problem.named(start[None, :])
    for run in problem.runs:
        look = getattr(run.curve, "without_integral", None)  # of a density (`estim.curves.binned`)
        if look is not None and (ends := look(run.points.bind(named))) is not None:
            rule = (
                "must have a finite integral over its bins or the range of the events: from "
                f"{ends[0]:.6g} to {ends[1]:.6g} there is none"
            )
            return InputError(
                f"{rule}; another curve or range, or other starting values, may have one",
                field="curve",
            )
    return InputError(
        "gives a curve that is not finite at the data, there and around", field="start"
    )


def _optimum_near(
    search: SeparableSearch, start: FloatArray, afar: Optimum, rng: np.random.Generator
) -> Optimum:
    """The best point of a problem from the optima of the simpler one that a search from afar takes
    (`Problem.for_search`), or, where the likelihood is not finite at these, from points around.
    """
    starts = [start]
    for point in (afar.values, *afar.others):
        if all(distance(search, point, other) > _ALIKE for other in starts):
            starts.append(point)
    tried = descended(search, np.array(starts))
    if not tried:  # fewer than 0 may be expected of what was counted
        around = rng.multivariate_normal(afar.values, 4.0 * afar.cov, 200, check_valid="ignore")
        around = np.clip(around, search.low, search.high)
        starts = list(around[np.argsort(search.squares.objectives(around))[:_AROUND]])
        tried = descended(search, np.array(starts))
    if not tried:
        raise _nowhere_finite(search.posterior.problem, start)
    best = min(tried, key=lambda end: end[1])
    optimum = _chosen(search, start, best, tried, tried, afar.symmetry)
    return replace(optimum, aliases=optimum.aliases or afar.aliases)


def _scanned(
    search: SeparableSearch, best: End, tried: list[End], symmetry: Symmetry
) -> tuple[End, list[End]]:
    """The best point after scans from ever better ones, and all ends of descents."""
    ends = list(tried)
    # scans, each from a better point
    for _ in range(3):
        # which of its images is lower in the last digits is chance
        centre, before = symmetry.nearest(best[0], search.start_values), best
        optima = further_optima(search, centre, symmetry.period)
        spread, limit = spread_at(search, best), chi2_limit(search, best)
        fresh: list[FloatArray] = []
        for point, chi2 in zip(optima, search.chi2_at(optima), strict=True):
            if chi2 > 1.5 * limit or len(fresh) == _MOST_DESCENTS:
                break
            lower = chi2 < best[1] * (1.0 - SAME) - search.rounding
            if (lower and not fresh) or not any(
                is_close(point, other, spread, PLACE)
                for other in (*fresh, *(end for end, _ in ends))
            ):
                fresh.append(point)
        ends += descended(search, np.array(fresh)) if fresh else []
        best = min(ends, key=lambda end: end[1])
        if not best[1] < before[1] * (1.0 - SAME) - search.rounding:
            break
    return best, ends


def origin_of(best: Optimum) -> str:
    """What led to an optimum, in words."""
    return phrase("the starting values led to this optimum") if best.from_start else _by_scan()


def _by_scan() -> str:
    return phrase("a scan of the parameters found this optimum, not the starting values")


def fit_optimum(
    problem: Problem,
    *,
    rng: np.random.Generator,
    scan: bool = True,
    start: FloatArray | None = None,
) -> Fit:
    """The posterior mode of a problem with a user's own curve, as `fit_least_squares` returns it,
    but found from afar.  start : (n_par,) where to begin; else where the problem does.
    """
    begin = problem.start() if start is None else start
    best = find_optimum(problem, begin, rng=rng, scan=scan)
    noisy = bool(problem.noise_names)
    refitted = (
        fit_least_squares(problem, start=best.values) if noisy else at_mode(problem, best.values)
    )
    if noisy and not (refitted.success or refitted.singular):
        # rounds of curve and noise in turn may creep; steps of both together do not
        search = search_of(refitted.posterior, refitted.values, refitted.cov, squared=True)
        (end,) = minima(search, [Start(search.coordinates.of(refitted.values), tolerance=_FLAT)])
        refitted = fit_least_squares(problem, start=search.coordinates.values(end.values))
    fit = with_other_modes(refitted, best)
    if not noisy and not np.any(best.at_bound):
        sds = np.where(np.isfinite(fit.sds), sds_of(best.cov), np.nan)
        fit = replace(fit, cov=best.cov, sds=sds, singular=best.frail)
    text = fit.message if fit.singular or not fit.success else converged_message(origin_of(best))
    fit = replace(fit, message=text)
    if best.settled or best.singular or fit.singular:
        return fit
    text = unconverged_message(best.step)
    return replace(fit, success=False, moved=best.step, mover=best.mover, message=text)


def is_resolved(fit: Fit) -> bool:
    """Whether the data (and priors) determine every parameter of the curve as far as rounding
    errors let one see, even where `fit.singular`.
    """
    jacobian = fit.posterior.jacobian(fit.values)[:, fit.problem.of_curve]
    return inverse_information(jacobian)[1] > RESOLVED


def scanned_fit(fit: Fit, *, rng: np.random.Generator) -> Fit:
    """`fit` with the optima that scans of its parameters meet (`estim.fitting.further_optima`),
    where these are few; the best of all becomes the fit.
    """
    if fit.singular or fit.problem.n_par > MAX_PARAMETERS:
        return fit
    with np.errstate(all="ignore"):
        simpler = fit.problem.for_search()
        search = separated(simpler, fit.values, rng, unstated=simpler is not fit.problem)
        optima = (
            further_optima(search, fit.values)
            if search.nonlinear.size
            else np.zeros((0, fit.values.size))
        )
        end = fit.values, search.chi2(fit.values)
        near, limit = [fit.values, *fit.others], chi2_limit(search, end)
        spread = fit.scale
        fresh: list[FloatArray] = []
        for point, chi2 in zip(optima, search.chi2_at(optima), strict=True):
            if chi2 > limit or len(fresh) == _MOST_REFITTED:
                break
            # beside a limit the other parameters may be anywhere within a standard deviation
            lower = bool(fit.at_bound) and chi2 < end[1] - 1.0 and not fresh
            if lower or not any(is_close(point, other, spread, 3.0) for other in (*near, *fresh)):
                fresh.append(point)
    refitted = [_refitted(fit, point) for point in fresh]
    known = [candidate for candidate in (fit, *refitted) if candidate and candidate.success]
    modes = [*(candidate.values for candidate in known), *fit.others]
    heights = fit.posterior.log_density(np.array(modes).reshape(-1, fit.values.size))
    best = int(np.argmax(heights[: len(known)])) if known else 0
    if known and heights[best] > fit.posterior.height(fit.values) + 0.5:
        fit = replace(known[best], message=converged_message(_by_scan()))
    ranked = [
        modes[i]
        for i in np.argsort(-heights, kind="stable")
        if heights[i] > np.max(heights) - WITHIN_REACH
    ]
    return replace(fit, others=distinct_from(fit.values, ranked, fit.scale))


def _refitted(fit: Fit, start: FloatArray) -> Fit | None:
    """The fit from another optimum; None where it ends without a curvature, as that of a sigmoid
    does where it has become a step between two readings, or nowhere near.
    """
    try:
        other = fit_least_squares(fit.problem, start=start)
    except NumericalError:
        return None
    return other if other.success else None


def with_other_modes(fit: Fit, best: Optimum) -> Fit:
    """A fit with the other optima of the search: those that hold more than next to nothing of the
    posterior, noise parameters refitted.
    """
    if best.singular or fit.singular:
        return replace(fit, unheld=best.unheld)
    # the size of the errors, where `fit` has it as a further parameter
    more = fit.values.size - best.values.size
    symmetry = best.symmetry.widened(more)
    modes = []
    for point in best.others[:MOST_OTHERS]:
        start = symmetry.nearest(np.append(point, fit.values[point.size :]), fit.values)
        if fit.problem.noise_names:
            if (other := _refitted(fit, start)) is None:
                continue
            start = other.values
        worse = float(np.diff(fit.posterior.log_density(np.vstack([start, fit.values])))[0])
        if worse < WITHIN_REACH:
            modes.append(start)
    return replace(
        fit,
        others=distinct_from(fit.values, modes, fit.scale),
        symmetry=symmetry,
        aliases=best.aliases,
        unheld=best.unheld,
    )


def _at_kink(search: SeparableSearch, values: FloatArray, tolerance: float) -> FloatArray | None:
    """The minimum at `values` if it is a kink, as that of a*max(x - x0, 0) with x0 at a reading,
    where no step ends: with one nonlinear parameter held to either side of it, and the others as
    good as can be, the sum of squares rises in proportion to the distance, not to its square.
    """
    chi2 = search.chi2(values)
    spread = spread_at(search, (values, chi2))
    least = _SMALL * unit_at(search, (values, chi2)) ** 2
    for i in search.nonlinear:
        fixed = replace(search, nonlinear=search.nonlinear[search.nonlinear != i])
        ends = []
        for side in (0.0, -_BESIDE, -0.5 * _BESIDE, 0.5 * _BESIDE, _BESIDE):
            point = values.copy()
            point[i] += side * spread[i]
            ends.append(stepped(fixed, point))
        far_below, near_below, near_above, far_above = (end[1] - ends[0][1] for end in ends[1:])
        sides = (near_below, far_below), (near_above, far_above)
        if ends[0][2] < tolerance and all(
            0.375 * far < near and 0.0 < far < least for near, far in sides
        ):
            return ends[0][0]
    return None


def _polished(
    search: SeparableSearch,
    values: FloatArray,
    others: FloatArray,
    symmetry: Symmetry,
    aliases: tuple[Finding, ...],
    *,
    from_start: bool,
) -> Optimum:
    """The optimum that Gauss-Newton steps from `values` lead to, with what else was found.  Raises
    InputError where the curve has no finite derivatives there.
    """
    free, likelihoods = search.free, search.posterior.likelihoods
    resolved = max(search.resolved, *(likelihood.resolved for likelihood in likelihoods))
    values, chi2, step_size, mover = stepped(search, values)
    jacobian, residual = search.posterior.scoring(values)
    if not all_finite(jacobian, residual):
        names = search.posterior.problem.names
        undefined = [names[i] for i in free if not all_finite(jacobian[:, i])]
        where = " and ".join(undefined) or "any parameter"
        raise InputError(
            f"leads the search to where it has no finite derivatives in {where}, as a step "
            "with a width of 0: set limits, or try other starting values",
            field="curve",
        )
    rounded = search.rounding_at(values, jacobian)
    floor = 0.1 * math.sqrt(rounded / max(chi2, 1e-300) * max(1, residual.size - free.size))
    # where a likelihood ends at the optimum, steps go to and fro across the end
    tolerance = max(1e-3 if search.creeps else 1e-4, floor)
    if not step_size < tolerance and (kink := _at_kink(search, values, tolerance)) is not None:
        values, chi2, step_size = kink, search.chi2(kink), 0.0
    near = near_bound(search, values, jacobian, residual, chi2)
    if np.any(near):
        at_limit = np.where(values - search.low < search.high - values, search.low, search.high)
        on_limit = np.where(near, at_limit, values)
        jacobian_at_limit = search.posterior.scoring(on_limit)[0]
        silent = ~np.any(jacobian_at_limit, axis=0) & np.isin(np.arange(values.size), free)
        if all_finite(jacobian_at_limit) and np.any(silent):
            # what another parameter hides on its limit lies anywhere: where it started
            inside = known_from_data(search.posterior, on_limit).inside
            jacobian_inside = search.posterior.scoring(inside)[0]
            hidden = silent & np.any(jacobian_inside, axis=0)
            restarted = np.where(hidden, search.start_values, on_limit)
            # not where it is the product of a factor and of one next to 0 that counts
            if search.chi2(restarted) <= equal_to(search, chi2):
                values, jacobian, near = restarted, jacobian_at_limit, near | hidden
    moving = free[~near[free]]
    cov, condition = inverse_information(jacobian[:, moving], resolved)
    full = np.zeros((values.size, values.size))
    full[np.ix_(moving, moving)] = cov
    return Optimum(
        values,
        full,
        chi2,
        rounded,
        step_size,
        tolerance,
        search.posterior.problem.names[mover],
        condition,
        resolved,
        near,
        from_start,
        others,
        symmetry,
        aliases,
    )
