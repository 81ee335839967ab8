"""One curve fit to thousands of data sets, each on its own: `fit_many`, for Monte-Carlo studies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import BoolArray, FloatArray, IntArray, all_finite, positive_or, squared_rows
from estim.checks import P_POOR_FIT
from estim.common import InputError, Status
from estim.curve_fitting.single import fit_curve
from estim.curves import Formula
from estim.distributions import chi2_tail
from estim.fitting import PERFECT
from estim.given_numbers import real_numbers
from estim.levenberg_marquardt import LeastSquares

_SETTLED, _MOST_STEPS = 1e-12, 60
_CONVERGED = 1e-3  # standard deviations
_STEP = 1e-6  # of a parameter's size, for differences
_RESOLVED = 1e-5  # ratio of singular values: differences have no more digits
# steps behind a descent, and the longest from where one is taken, in standard deviations
_LAST_STEPS, _NEAR = 3, 1.0
_DIGIT = 2.3e-16  # of y, the last that is kept
_COARSE = 10.0  # times which, in standard deviations of a reading, a fit need not be settled
_ON_LIMIT = 1e-6  # of a parameter's size


@dataclass(frozen=True, eq=False)
class ManyFits:
    """One curve fit to many data sets.

    names : parameters that were fit.
    values, sds : (n_set, n_par), sds nan where a set does not determine its parameters, where one
        lies on a limit, and where the curve meets every point and u_y was not stated.
    cov : (n_set, n_par, n_par), 0 for a parameter on a limit, nan where there are no sds.
    chi2 : (n_set,) sums of squares over u_y, or of y - f where u_y was not stated.
    dof : (n_set,) points less the parameters that lie on no limit.
    p_value : (n_set,) of chi2, nan where u_y was not stated.
    sigma : (n_set,) standard deviation of y from the residuals, nan where u_y was stated.
    status : (n_set,) of "ok", "poor-fit" (p < 0.001), "not-identified" (derivatives depend on each
        other at the optimum) and "not-converged".  No profile is computed: a parameter whose
        interval has no end is "ok" here, and "not-identified" in `fit_curve`.

    >>> from estim import fit_many
    >>> fits = fit_many("a*x", [1, 2, 3], [[2.1, 3.9, 6.0], [3.0, 6.1, 8.9]], u_y=0.1)
    >>> fits.values.shape, fits.status.tolist()
    ((2, 1), ['ok', 'ok'])
    """

    names: tuple[str, ...]
    values: FloatArray
    sds: FloatArray
    cov: FloatArray
    chi2: FloatArray
    dof: IntArray
    p_value: FloatArray
    sigma: FloatArray
    status: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.values)

    def __str__(self) -> str:
        counts = Counter(self.status.tolist()).most_common()
        return f"{len(self)} fits: " + ", ".join(f"{n} {status}" for status, n in counts)


def fit_many(
    curve: str | Callable[..., Any],
    x: ArrayLike,
    y: ArrayLike,
    *,
    start: Mapping[str, float] | None = None,
    u_y: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    fixed: Mapping[str, float] | None = None,
) -> ManyFits:
    """The curve fit to each of many data sets by least squares, all sets at once.

    It is `fit_curve` without its search and its tests: one descent in each set, from the same
    start, and chi-square.  So it takes a set a tenth of a millisecond, and finds another optimum
    than the best where the start is far away.  Its derivatives are differences: parameters that are
    tied closer than one to 1e5 (the intercept of a line far from x = 0) count as not identified.
    Give a set that matters to `fit_curve`.

    curve : as for `fit_curve`; a function that takes no arrays of parameters is called once for
        each set, which is slow.
    x : (n_obs,), or (n_set, n_obs).
    y : (n_set, n_obs), a data set in each row.
    start : starting values; those that are missing come from `fit_curve` of the first set.
    u_y : standard uncertainty of y: a number, (n_obs,) or (n_set, n_obs).  Without it each set's
        own residuals show how large the errors are.
    bounds, fixed : as for `fit_curve`.

    Raises InputError where an argument breaks a rule.

    Source: Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431, with a row of the arrays for a set.

    Examples
    --------
    >>> import numpy as np
    >>> from estim import fit_many
    >>> x = np.linspace(0.0, 5.0, 30)
    >>> noise = 0.1 * np.random.default_rng(1).standard_normal((1000, 30))
    >>> fits = fit_many("a*exp(-x/tau)", x, 3.0 * np.exp(-x / 1.5) + noise, u_y=0.1)
    >>> print(fits)
    1000 fits: 1000 ok
    >>> float(np.mean(np.abs(fits.values[:, 0] - 3.0) < fits.sds[:, 0])).__round__(1)
    0.7
    """
    sets = _rows(y, "y", None)
    points = _rows(x, "x", sets.shape)
    errors = np.ones_like(sets) if u_y is None else _rows(u_y, "u_y", sets.shape)
    first = fit_curve(
        curve,
        points[0],
        sets[0],
        u_y=None if u_y is None else errors[0],
        start=start,
        bounds=bounds,
        fixed=fixed,
        scan=False if start else None,
    )
    problem = first.held.problem
    run, priors = problem.runs[0], [p.prior for p in problem.parameters]

    def residuals(values: FloatArray, which: IntArray) -> FloatArray:
        named = run.bind(problem.named(values))
        return (run.curve.value(points[which], named) - sets[which]) / errors[which]

    begin = np.array([{**first.values, **(start or {})}[name] for name in first.names])
    low, high = np.array([p.low for p in priors]), np.array([p.high for p in priors])
    size = np.maximum(np.abs(begin), np.nan_to_num(first.held.scale))  # one may lie on a limit of 0
    size = positive_or(size, 1.0)
    solved, moving = np.split(np.arange(len(priors)), [0])
    arguments = (residuals, low, high, size, solved, moving, _STEP, sets.shape[1])

    def exact(
        values: FloatArray, which: IntArray, moving: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        named = run.bind(problem.named(values))
        at, u = run.curve.local(points[which], named), errors[which]
        columns = [at.gradient[problem.names[i]] / u for i in moving]
        return (at.value - sets[which]) / u, np.stack(columns, axis=2)

    # where y has a large offset, differences have few digits
    function = LeastSquares(*arguments, exact if isinstance(run.curve, Formula) else None)
    values, chi2, _ = function.descend(
        np.tile(begin, (len(sets), 1)), ftol=_SETTLED, max_steps=_MOST_STEPS
    )
    rounding = _DIGIT * np.max(np.abs(sets) / errors, axis=1)
    return _concluded(function, first.names, values, chi2, rounding, stated=u_y is not None)


def _rows(values: ArrayLike, field: str, shape: tuple[int, ...] | None) -> FloatArray:
    """`values` as (n_set, n_obs).  Raises InputError."""
    array = real_numbers(values, field)
    if shape is None:
        if array.ndim != 2 or not array.size:
            rule = "must be an array (n_set, n_obs), a data set in each row"
            raise InputError(rule, field=field, value=str(array.shape))
        shape = array.shape
    try:
        rows = np.broadcast_to(array, shape)
    except ValueError:
        rule = f"must have the shape of y, {shape}, or that of one row of it"
        raise InputError(rule, field=field, value=str(array.shape)) from None
    if not all_finite(rows):
        raise InputError("must be finite numbers", field=field)
    if field == "u_y" and not np.all(rows > 0.0):
        raise InputError("must be positive", field=field, value=float(rows.min()))
    return rows


@dataclass(frozen=True, eq=False)
class _Step:
    """Where the derivatives lead from the values of each set.

    on_limit, moving : (n_set, n_par).  known : (n_set, n_par) directions that the data determine.
    cov : (n_set, n_par, n_par) for errors of 1.  dof : (n_set,).
    step : (n_set, n_par) to be taken off.  moved : (n_set,) its size in standard deviations.
    """

    on_limit: BoolArray
    moving: BoolArray
    known: BoolArray
    cov: FloatArray
    dof: IntArray
    step: FloatArray
    moved: FloatArray


def _step_from(
    function: LeastSquares, values: FloatArray, chi2: FloatArray, *, stated: bool
) -> _Step:
    every = np.arange(len(values))
    with np.errstate(all="ignore"):
        slopes, information = function.derivatives(values, every, every >= 0)
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    on_limit = np.minimum(values - function.low, function.high - values) < _ON_LIMIT * function.size
    moving = ~on_limit & (scale > 0.0)
    unit = np.where(moving, scale, 1.0)
    pairs = moving[:, :, None] & moving[:, None, :]
    scaled = np.where(pairs, information / squared_rows(unit), 0.0)
    squared, vectors = np.linalg.eigh(scaled + np.eye(values.shape[1]) * ~moving[:, :, None])
    known = squared > _RESOLVED**2
    inverse = np.where(known, 1.0 / np.where(known, squared, 1.0), 0.0)
    cov = np.einsum("nik,nk,njk->nij", vectors, inverse, vectors)
    cov = np.where(pairs, cov / squared_rows(unit), 0.0)
    dof = function.n_res - np.sum(~on_limit, axis=1)
    step = np.einsum("nij,nj->ni", cov, np.where(moving, slopes, 0.0))
    with np.errstate(all="ignore"):
        sds = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        variance = chi2 / np.where(dof > 0, dof, np.nan)
        noise = np.ones(len(values)) if stated else np.sqrt(np.maximum(variance, 1e-300))
        moved = np.nanmax(np.where(moving, np.abs(step) / sds, 0.0), axis=1) / noise
    return _Step(on_limit, moving, known, cov, dof, step, moved)


def _concluded(
    function: LeastSquares,
    names: tuple[str, ...],
    values: FloatArray,
    chi2: FloatArray,
    rounding: FloatArray,
    *,
    stated: bool,
) -> ManyFits:
    found = _step_from(function, values, chi2, stated=stated)
    # where the sum of squares is too coarse to descend further, its derivatives are not
    for _ in range(_LAST_STEPS):
        near = (found.moved > _CONVERGED) & (found.moved < _NEAR)
        if not np.any(near):
            break
        values = np.where(near[:, None], values - found.step, values)
        values = np.clip(values, function.low, function.high)
        chi2 = 2.0 * function.objectives(values)
        found = _step_from(function, values, chi2, stated=stated)
    on_limit, moving, known, cov = found.on_limit, found.moving, found.known, found.cov
    dof = found.dof
    positive = np.where(dof > 0, dof, np.nan)
    variance = chi2 / positive
    size = np.sqrt(chi2 / function.n_res)  # of a residual
    coarse = _COARSE * rounding / (1.0 if stated else positive_or(size, 1.0))
    p_value = chi2_tail(chi2, positive) if stated else np.full(len(values), np.nan)
    status = np.select(
        [
            ~(np.isfinite(chi2) & (found.moved < np.maximum(_CONVERGED, coarse))),
            np.any(~known, axis=1) | np.any(~on_limit & ~moving, axis=1),
            p_value < P_POOR_FIT,
        ],
        [str(Status.NOT_CONVERGED), str(Status.NOT_IDENTIFIED), str(Status.POOR_FIT)],
        str(Status.OK),
    )
    unknown = (status == str(Status.NOT_IDENTIFIED)) | (
        (not stated) & (size <= PERFECT / _DIGIT * rounding)
    )
    cov = cov * np.where(stated, 1.0, variance)[:, None, None]
    cov[unknown] = np.nan
    sds = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    return ManyFits(
        names,
        values,
        np.where(moving, sds, np.nan),
        cov,
        chi2,
        dof,
        p_value,
        np.full(len(values), np.nan) if stated else np.sqrt(variance),
        status,
    )
