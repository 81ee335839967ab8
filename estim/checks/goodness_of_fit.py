"""Does the curve explain the data?  Tests on whitened residuals, for each run.

A residual vector with covariance C = L L^T is whitened in the order of the observations, z = L^-1
(y - f): if model and noise are right, z is nearly unit white noise.  Nearly, because the fit has
pulled the residuals towards zero; the null distribution of each statistic is therefore simulated
with that projection in it (`estim.problem.whitened_residuals`).

What each test detects: `chi2` the size of the residuals (only where the size of the noise was
stated); `runs` too few changes of sign; `autocorrelation` correlated neighbours; `trend` a slow
drift along the run; `largest` a single outlier, of residuals over their standard deviations after
the fit, sqrt(1 - leverage) (not beside a mixture, which has room for some).  Of a curve that is no
motion two more are made.  `uneven` (not beside a smooth deviation, which may be local): whether
residuals are larger or smaller where the curve f, its size |f| or x is large, the largest of |sum
|z| w|/sum |z| over standardised w = f, |f|, x.  `repeated`, where x were read more than once: the F
test of lack of fit, whether the means at each x scatter more about the curve than the readings of
one x about their mean (its statistic is the share of chi2 that the means have, which rises with
F).  Residuals that are all zero have no pattern to test: they fail as such (`zero`).

Whether a curve is a `poor-fit` is decided here and nowhere else, for a line, a curve, a run or a
joint fit: a test fails below P_POOR_FIT.  There are up to seven tests of a run, each of which would
reject a right curve with that probability, so that all of them together reject fewer than one of
100 (simulated: docs/statistics.md).  A level of 0.01 for each would reject one right curve of 20.
`speed` is reported and fails nothing, for it does not bias the curve: whether residuals of a motion
are larger where the body is fast, as those of blurred pictures are (paper, section IV: "at high
speeds the image of the disk center becomes fuzzy").  Its statistic is sum |z| (v^2/mean(v^2) -
1)/sum |z|, large where the noise grows with the speed v of the fitted curve, whatever its size.
Residuals beyond three times their median count as three times: a single bad reading where the body
is fast is no noise that grows.  An inferred scatter swallows chi2, so the scatter itself is
compared with what the instrument explains.

A stated error may be far larger than what the readings show, for what they all share: then a
pattern in the residuals does no harm as long as all of it together is smaller than one stated
standard deviation,

    chi2 + 4 slow <= 1        slow: the part of chi2 along polynomials of order 5 or less

whatever the number of points, because the standard deviation of a parameter falls as 1/sqrt(n) and
a pattern does not.  A parameter is then off by one of its standard deviations only if the part of
the pattern that looks like the curve outweighs all that does not; the slow part weighs more because
it is a sign of that.  docs/statistics.md has the coverage.

Speeds made of positions, with an unmodelled force beside them, tolerate correlated neighbours
(errors of successive readings that follow each other), as long as they are no larger than stated
and show neither a trend nor a bad point: differences take out what such errors share, the force
takes up what is left, and the intervals have their coverage (docs/statistics.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from estim.arrays import FloatArray, max_abs, positive_or, root_mean_square
from estim.fitting import MANY_RUNS, Fit, chi2_p, no_scatter, spreads_by_runs
from estim.problem import Linear, Observations, Whitened, reading_sd
from estim.words import TESTS

P_POOR_FIT = 1e-3  # of each test
P_TOLD = 5e-3  # of `speed`, below which it is reported
_CLIP = 3.0  # medians of the residuals, at which their size is clipped for it
P_MARGINAL = 0.01  # of `uneven` and `repeated`, of little power with few points: a note below it
# times what the instrument explains: nine tenths of the variance would be something else
SCATTER_LIMIT = 3.0
_NO_ERRORS = 1e-9  # standard deviations; residuals that are all smaller are rounding errors
_FINE = 1e12  # steps in one standard deviation, of readings that have none
# records of few digits give the same residuals, and hence statistics, but for rounding errors
_ROUNDING = 1e-5
# simulated values at least as extreme: a p-value is then uncertain by 20 % or less; by 32 % where
# it is that many times P_POOR_FIT
_ENOUGH, _FEWER, _CLEARLY = 25, 10, 3.0
_N_SIMULATED = 20_000  # data sets, if a p-value has not come out before
_LEAST_SIMULATED = 2600  # of many points: a p-value below P_POOR_FIT can come out
_MOST_NUMBERS = 4e7  # errors that are drawn, beyond the least
_AT_ONCE, _MOST_AT_ONCE = 500, 1e5  # data sets and numbers
_SLOW_ORDER, _SLOW_WEIGHT = 5, 4.0
_SAME = 1e-9  # of its size: what varies less is the same everywhere
_LEAST_REPEATED = 2  # readings beyond the first of their x: a single one may be a copied row
_LEAST_LEFT = 0.3  # standard deviations: of a point that determines a parameter alone less is left
_NO_DRIFT = 0.5  # standard deviations of a slow shape in independent residuals
_OF_NEIGHBOURS = frozenset(("runs", "autocorrelation"))
P_FLOOR = 1.0 / (1.0 + _N_SIMULATED)  # a p-value of the tests below cannot come out smaller


# Computes a statistic (n,) from the whitened residuals (n, n_obs) of n data sets; it is large where
# the model is wrong
Statistic = Callable[[FloatArray], FloatArray]
_OF_SIZE = ("chi2", "repeated")  # statistics that are compared with those of exact residuals
# What gives the exact residuals of simulated data sets, and what gives them as recorded, once:
# one and the same where nothing is rounded
Drawn = tuple[Callable[[], FloatArray], Callable[[], FloatArray]]


@dataclass(frozen=True)
class Check:
    """One test: its statistic, the probability of a value at least as extreme under the model, what
    failing it means, and the probability of a value at most as large.
    """

    statistic: float
    p_value: float
    meaning: str
    p_below: float = 1.0


@dataclass(frozen=True, eq=False)
class Goodness:
    """How well one run is explained.

    whitened : (n_obs,) residuals with unit covariance, in order; heavy tails are mapped to normal
        scores.
    raw : (n_obs,) residuals in units of the ordinate.
    sd : (n_obs,) their standard deviations.
    speed : whether the noise grows with the speed of a body; None where nothing moves.
    checks : name -> Check.
    scatter_ratio : inferred scatter / instrument's share of the noise; nan where not inferred.
    pattern : size of all residuals together, chi2 + 4 slow, 1: as large as one standard deviation;
        times the number of runs that are fit together, since all of them may have it.
    curve : whether it is a curve of the user's, taken as complete.
    tolerates_correlation : whether the intervals have their coverage although neighbouring
        residuals are correlated.
    counted : whether they are signed roots of the deviance of counts.
    among : by how much less probable a failure must be than in a fit of a few runs, since hundreds
        are tested.
    """

    run: str
    whitened: FloatArray
    raw: FloatArray
    sd: FloatArray
    checks: Mapping[str, Check]
    scatter_ratio: float
    pattern: float
    curve: bool
    tolerates_correlation: bool = False
    speed: Check | None = None
    counted: bool = False
    among: float = 1.0

    @property
    def level(self) -> float:
        """Of a test, below which the run fails it."""
        return P_POOR_FIT / self.among

    @property
    def tolerated(self) -> tuple[str, ...]:
        """Names of the tests of neighbours that fail, where they alone do and the intervals
        tolerate it.
        """
        tolerated = (
            self.tolerates_correlation
            and "chi2" in self.checks
            and not self.covered
            and _OF_NEIGHBOURS.issuperset(self._below)
        )
        return self._below if tolerated else ()

    @property
    def covered(self) -> tuple[str, ...]:
        """Names of the tests that fail although the stated error covers all that the residuals
        show.
        """
        chi2 = self.checks.get("chi2")
        small = chi2 is not None and chi2.p_below < P_POOR_FIT and self.pattern <= 1.0
        return self._below if small else ()

    @property
    def marginal(self) -> tuple[str, ...]:
        """Names of tests of the noise that the run passes, but not well."""
        return tuple(
            n
            for n in ("uneven", "repeated")
            if n in self.checks and self.level <= self.checks[n].p_value < P_MARGINAL / self.among
        )

    @property
    def only_too_large(self) -> bool:
        """Whether the residuals are as random as they should be, and only larger than stated."""
        return self.failed == ("chi2",)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the tests that the run fails."""
        return () if self.covered or self.tolerated else self._below

    @property
    def _below(self) -> tuple[str, ...]:
        return tuple(name for name, check in self.checks.items() if check.p_value < self.level)


def check_goodness(fit: Fit, *, rng: np.random.Generator) -> tuple[Goodness, ...]:
    """One `Goodness` for each run of a fit; `rng` draws the simulated null distributions, of each
    group of runs by itself.

    A p-value that could count among hundreds of runs is simulated until it can be distinguished
    from that of the worst of them.

    >>> import numpy as np
    >>> from estim import check_goodness, fit_curve
    >>> x = np.linspace(0.0, 5.0, 20)
    >>> fit = fit_curve("a*x", x, 2.0 * x + 0.1 * np.sin(50.0 * x), u_y=0.1).fit
    >>> (goodness,) = check_goodness(fit, rng=np.random.default_rng(1))
    >>> goodness.run, sorted(goodness.checks)
    ('data', ['autocorrelation', 'chi2', 'largest', 'runs', 'trend', 'uneven'])
    """
    problem, posterior = fit.problem, fit.posterior
    named, n_run = problem.named(fit.values), len(problem.runs)
    # a parameter on a limit does not follow the errors: a fit beyond is not allowed
    follows = ~np.isin(fit.names, fit.at_bound)
    columns = [used[follows[used]] for used in problem.columns]
    responses = [
        likelihood.whitened(named, [problem.names[i] for i in used])
        for likelihood, used in zip(posterior.likelihoods, columns, strict=True)
    ]
    pulls = fit.prior_jacobian
    pulls[:, [name in problem.noise_names for name in problem.names]] = 0.0
    spreads = spreads_by_runs([response.root for response in responses], columns, pulls)
    known = (
        n_run == 1
        and posterior.likelihoods[0].normal is not None
        and not (pulls.any() or fit.deviations or fit.forces)
    )
    raw_and_sd = {
        run.name: both for run, both in zip(problem.runs, _raw_and_sd(fit, named), strict=True)
    }
    results = {}
    for group, response, spread in zip(problem.groups, responses, spreads, strict=True):
        whitened = group.split(response.z)
        dof = _dof(response.root) if known else 0
        left = group.split(_left_by_fit(response.slopes_at_fit, spread))
        tested = [
            _Tested(z, _tests_of(run, named, raw_and_sd[run.name][1], own), dof)
            for run, z, own in zip(group.runs, whitened, left, strict=True)
        ]
        record = _recording(
            [(run.y, z, *raw_and_sd[run.name]) for run, z in zip(group.runs, whitened, strict=True)]
        )
        simulate = _simulated(response, spread, record, rng)
        density = any(run.noise.own_density for run in group.runs)  # whose residuals mean nothing
        checked = [{}] if density else _checks(tested, simulate, max(1.0, n_run / MANY_RUNS))
        for run, z, checks in zip(group.runs, whitened, checked, strict=True):
            results[run.name] = _goodness_of(fit, run, z, *raw_and_sd[run.name], checks, named)
    return tuple(results[run.name] for run in problem.runs)


def check_linear(
    z: FloatArray,
    root: FloatArray,
    *,
    x: FloatArray,
    y: FloatArray,
    f: FloatArray,
    sd: FloatArray,
    stated: bool,
    rng: np.random.Generator,
) -> Goodness:
    """The same of least squares that are not posed as a problem, linear near their minimum.

    z : (n_obs,) whitened residuals in the order of x.
    root : (n_obs, n_par) minus their derivatives.  x, y, f, sd : (n_obs,) abscissas, readings,
        curve and standard deviations about it.
    stated : whether the size of the errors was.
    """
    n_par = root.shape[1]
    (spread,) = spreads_by_runs([root], [np.arange(n_par)], np.zeros((n_par, n_par)))
    tests = _of_order(_left_by_fit(root, spread), stated=stated)
    tests |= _uneven(f, x) | _repeated(x, sd)
    tested = _Tested(z, tests, _dof(root))
    record = _recording([(y, z, y - f, sd)])
    (checks,) = _checks([tested], _simulated(Linear(z, root), spread, record, rng))
    return Goodness("", z, z * sd, sd, checks, float("nan"), pattern=_pattern(z), curve=True)


def _recording(
    runs: Sequence[tuple[FloatArray, FloatArray, FloatArray, FloatArray]],
) -> Callable[[FloatArray], FloatArray] | None:
    """What turns errors (n_obs, n) of n data sets, in units of sd, into those that are recorded,
    where the y of a run are steps apart; None where no run has a step.

    Residuals of few digits are often as far from each other as they can be (three readings on a
    line and one beside it), or on one side of the curve, which continuous errors never are.

    runs : y, whitened residuals z, y - f and sd, all (n_obs,), of each run of a group.
    """
    y, _, raw, sd = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    # correlated errors, counts and robust ones are whitened in another way
    independent = [np.allclose(z * sd, raw, rtol=1e-6, atol=0.0) for _, z, raw, sd in runs]
    steps = [
        _step(run[0]) if as_read else 0.0 for run, as_read in zip(runs, independent, strict=True)
    ]
    step = np.repeat(steps, [run[0].size for run in runs])
    coarse = step > 0.0
    if not coarse.any():
        return None
    curve = np.divide(-raw, step, out=np.zeros_like(y), where=coarse)
    curve = (curve - np.rint(curve))[:, None]  # in steps, from the next place of a reading
    sd = np.divide(sd, step, out=np.full_like(y, _FINE), where=coarse)[:, None]

    def record(errors: FloatArray) -> FloatArray:
        errors = errors * sd
        errors += curve
        np.rint(errors, out=errors)
        errors -= curve
        errors /= sd
        return errors

    return record


def _step(y: FloatArray) -> float:
    """The largest number of which all differences of y (n_obs,) are multiples; 0 where there is
    none within six digits of their range.  Two values have one difference, which is hardly one
    step: they themselves are multiples then.
    """
    size, width = max_abs(y), float(np.ptp(y))
    if not 1e-290 < width <= 2.0 * size < np.inf:
        return 0.0
    units = 10.0 ** (np.floor(np.log10(width)) - np.arange(7.0))
    differences = (y - np.min(y)) / units[:, None]
    multiples = np.rint(differences)
    rounding = 4.0 * np.finfo(float).eps * size + 1e-6 * units
    written = np.max(np.abs(differences - multiples), axis=1) <= rounding / units
    if not written.any():
        return 0.0
    unit, whole = units[np.argmax(written)], multiples[np.argmax(written)]
    largest = int(np.gcd.reduce(whole.astype(int)))
    if np.unique(whole).size == 2:
        largest = math.gcd(largest, round(np.min(y) / unit))
    return float(unit * largest)


def _simulated(
    response: Whitened,
    spread: FloatArray,
    record: Callable[[FloatArray], FloatArray] | None,
    rng: np.random.Generator,
) -> Callable[[int], Drawn]:
    """What draws residuals (n_obs, n) of a group of runs in n data sets, given a root F of the
    covariance of the parameters that it uses.

    Errors e of its points move the parameters by F M^T e with M = J F, and all other errors by F
    times a normal vector of covariance 1 - M^T M, whose symmetric root is the same on every
    processor; its eigenvectors are not.
    """
    moves = response.root @ spread
    spectrum, basis = np.linalg.eigh(np.eye(spread.shape[1]) - moves.T @ moves)
    by_others = spread @ (basis * np.sqrt(np.maximum(spectrum, 0.0))) @ basis.T

    def simulate(n: int) -> Drawn:
        errors = response.drawn(n, rng)
        others = by_others @ rng.standard_normal((by_others.shape[1], n))

        def fitted(errors: FloatArray) -> FloatArray:
            shifts = spread @ (moves.T @ response.score_residuals(errors)) + others
            return response.moved(errors, shifts)

        def exact() -> FloatArray:
            return fitted(errors)

        return exact, exact if record is None else lambda: fitted(record(errors))

    return simulate


def _left_by_fit(slopes: FloatArray, spread: FloatArray) -> FloatArray:
    """(n_obs,) standard deviations of whitened residuals after the fit, sqrt(1 - leverage), at
    least `_LEAST_LEFT`, since no fit follows a point as closely as it would if it were linear.

    slopes : (n_obs, n_par) minus the derivatives of the residuals.  spread : as above.
    """
    leverage = np.sum(np.square(slopes @ spread), axis=1)
    return np.sqrt(np.maximum(1.0 - leverage, _LEAST_LEFT**2))


def _goodness_of(
    fit: Fit,
    run: Observations,
    z: FloatArray,
    raw: FloatArray,
    sd: FloatArray,
    checks: dict[str, Check],
    named: Mapping[str, FloatArray],
) -> Goodness:
    """A run with its whitened residuals z (n_obs,) and their tests."""
    n_run = len(fit.problem.runs)
    among = max(1.0, n_run / MANY_RUNS)
    readings = run.noise.counted is None and not run.noise.own_density
    empty = readings and (no_scatter(run, fit) or max_abs(z) < _NO_ERRORS)
    if empty:
        checks = {"zero": Check(0.0, P_FLOOR / among, TESTS["zero"])}
    if not math.isnan(run.noise.outlier_share(named)):
        checks.pop("largest", None)  # the noise model has outliers
    speed = None if empty else checks.pop("speed", None)
    forced = any(run.name in force.runs for force in fit.forces)
    return Goodness(
        run.name,
        z,
        raw,
        sd,
        checks,
        _scatter_ratio(run, named),
        pattern=n_run * _pattern(z),
        curve=run.motion is None and run.lacks is None and run.noise.counted is None,
        tolerates_correlation=forced and run.noise.made_of_positions,
        speed=speed,
        counted=run.noise.counted is not None,
        among=among,
    )


def untested(fit: Fit) -> tuple[Goodness, ...]:
    """Residuals of which no test can be made: as many parameters as points, or rounding errors
    only.
    """
    named = fit.named
    return tuple(
        Goodness(run.name, z, *raw_and_sd, {}, np.nan, _pattern(z), curve=False)
        for run, z, raw_and_sd in zip(
            fit.problem.runs,
            fit.posterior.standardised(fit.values),
            _raw_and_sd(fit, named),
            strict=True,
        )
    )


def _pattern(z: FloatArray) -> float:
    return float(z @ z + _SLOW_WEIGHT * np.sum(np.square(z @ _slow(z.size, _SLOW_ORDER))))


def _raw_and_sd(fit: Fit, named: Mapping[str, FloatArray]) -> list[tuple[FloatArray, FloatArray]]:
    """For each run (n_obs,) y - f and their standard deviations, unit of y."""
    posterior = fit.posterior
    ys = posterior.by_run(likelihood.y for likelihood in posterior.likelihoods)
    sds = posterior.by_run(likelihood.sd(named) for likelihood in posterior.likelihoods)
    runs = zip(fit.problem.runs, ys, sds, strict=True)
    return [(y - run.drawn(named), sd) for run, y, sd in runs]


def _scatter_ratio(run: Observations, named: Mapping[str, FloatArray]) -> float:
    if run.motion is None:  # the jitter of a curve is an option, and may be of any size
        return float("nan")
    instrument = root_mean_square(reading_sd(run.noise, named))
    size = run.noise.size
    if size.scatter.parameter is None or size.sigma.parameter is not None or instrument == 0.0:
        return float("nan")
    return float(named[size.scatter.parameter]) / instrument


def _dof(root: FloatArray) -> int:
    """Of chi2, from the derivatives (n_obs, n_par) of the residuals."""
    lengths = np.maximum(np.linalg.norm(root, axis=0), np.finfo(float).tiny)
    return len(root) - int(np.linalg.matrix_rank(root / lengths))


@dataclass(frozen=True, eq=False)
class _Tested:
    """Whitened residuals z (n_obs,), and their tests by name.

    dof : of chi2, where its distribution is known; 0 where it is simulated too.
    """

    z: FloatArray
    tests: Mapping[str, Statistic]
    dof: int = 0

    @cached_property
    def statistics(self) -> dict[str, float]:
        return {name: float(test(self.z[None, :])[0]) for name, test in self.tests.items()}


@dataclass(eq=False)
class _Tally:
    """A statistic of run number `run` among those of simulated data sets: how many of these are not
    smaller, not larger, and `simulated` at all; and the largest.
    """

    run: int
    name: str
    statistic: float
    largest: float
    above: int = 0
    below: int = 0
    simulated: int = 0

    @property
    def check(self) -> Check:
        if self.name == "trend" and self.largest < _NO_DRIFT:
            # the curve itself can take every slow shape: what is left of them is rounding, or the
            # fit's own criterion
            return Check(self.statistic, 1.0, TESTS[self.name])
        p_value, p_below = ((1.0 + n) / (1.0 + self.simulated) for n in (self.above, self.below))
        return Check(self.statistic, p_value, TESTS[self.name], p_below)


def _checks(
    tested: Sequence[_Tested], simulate: Callable[[int], Drawn], among: float = 1.0
) -> list[dict[str, Check]]:
    """The tests of several runs against the same simulated data sets.

    simulate : (n_obs, n) whitened residuals of all these runs in n data sets, exact and as
        recorded.  `chi2` and `repeated` are tested by exact ones: a step far beyond the stated
        errors, or beyond what readings of one x differ by, explains nothing.  Recorded ones that
        are all zero do not count: such data have no pattern to test.
    among : by how many times more of them may be needed.

    Data sets are drawn until every statistic has been met or exceeded by `_ENOUGH` of them, and
    chi2 been above as many (Besag and Clifford, Biometrika 78 (1991) 301), or by fewer: a p-value
    that decides nothing needs few.
    """
    tallies = [
        _Tally(i, name, statistic, largest=statistic)
        for i, run in enumerate(tested)
        for name, statistic in run.statistics.items()
        if name != "chi2" or run.dof == 0
    ]
    sized = any(tally.name in _OF_SIZE for tally in tallies)
    ends = np.cumsum([run.z.size for run in tested])
    n_error = int(ends[-1])
    n_most = int(among * np.clip(_MOST_NUMBERS / n_error, _LEAST_SIMULATED, _N_SIMULATED))
    at_once, n = max(1, min(_AT_ONCE, int(_MOST_AT_ONCE / n_error))), 0

    def fewest() -> int:
        """Of the data sets on one side of a statistic: the upper one, of chi2 either."""
        return min(
            min(tally.above, tally.below) if tally.name == "chi2" else tally.above
            for tally in tallies
        )

    while n < n_most and (few := fewest()) < (
        _FEWER if few > _CLEARLY * P_POOR_FIT * n else _ENOUGH
    ):
        more = min(at_once, n_most - n)
        exact, recorded = simulate(more)
        recorded_parts = np.split(recorded().T, ends[:-1], axis=1)
        separate = sized and exact is not recorded
        exact_parts = np.split(exact().T, ends[:-1], axis=1) if separate else []
        zero = [_squares(z) < z.shape[1] * _ROUNDING**2 for z in recorded_parts]
        recorded_parts = [
            z[~none] if none.any() else z for z, none in zip(recorded_parts, zero, strict=True)
        ]
        for tally in tallies:
            drawn = exact_parts if separate and tally.name in _OF_SIZE else recorded_parts
            simulated = tested[tally.run].tests[tally.name](drawn[tally.run])
            # the others are of the order of 1, and rounding where the curve leaves them no room
            room = _ROUNDING * (abs(tally.statistic) if tally.name == "chi2" else 1.0)
            excess = simulated - tally.statistic
            tally.above += int(np.count_nonzero(excess >= -room))
            tally.below += int(np.count_nonzero(excess <= room))
            tally.simulated += simulated.size
            tally.largest = max(tally.largest, float(np.max(simulated, initial=0.0)))
        n += more
    checked: list[dict[str, Check]] = [{} for _ in tested]
    for run, checks in zip(tested, checked, strict=True):
        if run.dof > 0 and "chi2" in run.tests:
            chi2 = run.statistics["chi2"]
            p = chi2_p(chi2, run.dof)
            checks["chi2"] = Check(chi2, max(p, P_FLOOR / among), TESTS["chi2"], 1.0 - p)
    for tally in tallies:
        checked[tally.run][tally.name] = tally.check
    return checked


def _tests_of(
    run: Observations, named: Mapping[str, FloatArray], sd: FloatArray, left: FloatArray
) -> dict[str, Statistic]:
    """The tests of a run.  sd : (n_obs,) standard deviations of y about the curve.  left : (n_obs,)
    those of the whitened residuals.
    """
    tests, arguments = _of_order(left, stated=run.stated), run.bind(named)
    values = (
        run.curve.local(run.x, arguments).slope
        if run.positions
        else run.curve.value(run.x, arguments)
    )[0]
    if run.motion is None:
        # what makes up for a bump is not the same everywhere
        local = run.lacks is not None and run.lacks.deviation > 0.0
        return tests | ({} if local else _uneven(values, run.x)) | _repeated(run.x, sd)
    return tests | _speed(values)


def _of_order(left: FloatArray, *, stated: bool) -> dict[str, Statistic]:
    """Tests of the order of residuals, whose standard deviations after the fit are left (n_obs,),
    and of their size if that was `stated`.
    """
    slow, n = _slow(left.size, 3), left.size
    tests: dict[str, Statistic] = {
        "runs": lambda z: -np.sum(np.diff(np.signbit(z), axis=1), axis=1).astype(float),
        "autocorrelation": lambda z: np.einsum("ij,ij->i", z[:, 1:], z[:, :-1]) / _size(z),
        "trend": lambda z: np.max(np.abs(z @ slow), axis=1) / np.sqrt(_size(z) / n),
        "largest": lambda z: np.max(np.abs(z / left), axis=1) / np.sqrt(_size(z) / n),
    }
    return {"chi2": _squares} | tests if stated else tests


def _squares(z: FloatArray) -> FloatArray:
    return np.einsum("ij,ij->i", z, z)


def _size(z: FloatArray) -> FloatArray:
    """Sums of squares; 1 where all residuals are exactly zero, which have no shape."""
    return positive_or(_squares(z), 1.0)


def _uneven(f: FloatArray, x: FloatArray) -> dict[str, Statistic]:
    """Tests whether residuals grow with the curve (n_obs,), its size or the abscissa; what is
    constant is left out.
    """
    centred = [w - np.mean(w) for w in (f, np.abs(f), x) if float(np.ptp(w)) > _SAME * max_abs(w)]
    if not centred:
        return {}
    growing = np.array([w / root_mean_square(w) for w in centred])

    def uneven(z: FloatArray) -> FloatArray:
        sizes = np.abs(z)
        return np.max(np.abs(sizes @ growing.T), axis=1) / positive_or(np.sum(sizes, axis=1), 1.0)

    return {"uneven": uneven}


def _repeated(x: FloatArray, sd: FloatArray) -> dict[str, Statistic]:
    """The part of chi2 that the means of the readings at each x have; none where too few are
    repeated.
    """
    order = np.argsort(x, kind="stable")
    _, begins, counts = np.unique(x[order], return_index=True, return_counts=True)
    if x.size - begins.size < _LEAST_REPEATED:
        return {}
    precisions = 1.0 / np.square(sd[order])
    # squares of sum 1 at each x
    weights = np.sqrt(precisions / np.repeat(np.add.reduceat(precisions, begins), counts))

    def repeated(z: FloatArray) -> FloatArray:
        means = np.add.reduceat(z[:, order] * weights, begins, axis=1)
        return np.sum(means**2, axis=1) / _size(z)

    return {"repeated": repeated}


def _speed(v: FloatArray) -> dict[str, Statistic]:
    """Whether residuals grow with the speed (n_obs,) of a body."""
    square = np.square(v)
    if not np.ptp(square) > 0.0:
        return {}
    faster = square / np.mean(square) - 1.0

    def speed(z: FloatArray) -> FloatArray:
        sizes = np.abs(z)
        clipped = np.minimum(sizes, _CLIP * np.median(sizes, axis=1, keepdims=True))
        return (clipped @ faster) / positive_or(np.sum(clipped, axis=1), 1.0)

    return {"speed": speed}


@lru_cache(maxsize=4)
def _slow(n: int, order: int) -> FloatArray:
    """(n, n_shape) orthonormal polynomials up to an order."""
    abscissas = np.linspace(-1.0, 1.0, n)
    return np.linalg.qr(np.polynomial.legendre.legvander(abscissas, min(order, n - 1)))[0]
