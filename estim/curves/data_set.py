"""Points (x, y) and what is stated of their errors; each argument is checked here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, IntArray, root_mean_square, sds_of
from estim.common import InputError, phrase
from estim.curves.columns import errors_of, share_of, skew_of
from estim.curves.count_data import Counting
from estim.curves.systematic_errors import Component, covariance_in_groups
from estim.curves.units import AxisNames
from estim.given_numbers import real_numbers, require_each
from estim.problem import (
    Correlated,
    Noise,
    Readings,
    Scale,
    Tails,
    TwoPiece,
    check_covariance,
    hide_the_range,
)

_ERRORS = ("u_y", "cov_y", "u_x", "cov_x", "r_xy", "robust")  # of a `DataSet`


@dataclass(frozen=True, eq=False)
class DataSet:
    """Points x, y (n_obs,) of one of several data sets, with what `fit_curve` takes of their
    errors: u_y, cov_y, u_x, `jitter`, `robust`, or `noise` for counts.

    x : several abscissas too, as `fit_curve` takes them.
    u_y, u_x : standard uncertainties, a number or (n_obs,), in the units of y and x.
    cov_y : (n_obs, n_obs) covariance matrix of y, in place of u_y.
    cov_x, r_xy : covariance matrix of x in place of u_x, correlation of both errors of a point.
    y : None for the times of single events.
    curve, axes : of this data set, in the place of those of `fit_curves`; jitter and robust too,
        where they are not None.

    It is checked where it is fitted: `fit_curves` raises InputError.

    >>> from estim import DataSet, fit_curves
    >>> first, second = DataSet([1, 2, 3], [1.1, 2.0, 3.1], 0.1), DataSet([1, 2], [2.0, 3.0], 0.1)
    >>> fit = fit_curves("k*x + c", {"a": first, "b": second}, shared=["k"])
    >>> round(fit.values["k"], 2)
    1.0
    """

    x: ArrayLike
    y: ArrayLike | None
    u_y: ArrayLike | None = None
    cov_y: ArrayLike | None = None
    u_x: ArrayLike | None = None
    noise: Counting | str | None = None
    curve: str | Callable[..., Any] | None = None
    axes: AxisNames | None = None
    jitter: Any = None
    robust: str | None = None
    cov_x: ArrayLike | None = None
    r_xy: ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class PointErrors:
    """What is stated of the errors of points (n_obs,), in the order in which they were given.

    sizes : (n_obs,) standard deviations of y; 1 where none is stated.
    sizes_x : (n_obs,) the same of x; None where x is exact.
    cov, cov_x : (n_obs, n_obs) covariance matrices; None where errors are independent.
    r_xy : (n_obs,) correlation of both errors of a point; None where there is none.
    share : standard deviation of y over the curve; 0 where it is not stated so.
    skew : (n_obs,) root of the errors above over those below; None where they are the same.
    words : the share that was stated, of the curve or of each reading; "" for none.
    """

    sizes: FloatArray
    sizes_x: FloatArray | None
    cov: FloatArray | None
    cov_x: FloatArray | None
    r_xy: FloatArray | None
    share: float
    skew: FloatArray | None
    words: str

    def noise(self, order: IntArray, scatter: Scale, tails: Tails, what: str) -> Noise:
        """The noise of the points in the `order` (n_obs,) of x, `what` being y."""
        if self.cov is not None:
            square = np.ix_(order, order)
            return Correlated(
                self.cov[square], what, None if self.cov_x is None else self.cov_x[square]
            )
        return Readings(
            Scale(1.0),
            scatter,
            self.sizes[order],
            sigma_x=None if self.sizes_x is None else Scale(1.0),
            relative_x=None if self.sizes_x is None else self.sizes_x[order],
            tails=tails if self.skew is None else TwoPiece(skew=self.skew[order]),
            share=self.share,
            r_xy=None if self.r_xy is None else self.r_xy[order],
            what=what,
            stated_as=self.words,
        )


def what_is_given(points: DataSet) -> dict[str, bool]:
    """Argument that states an error -> whether it was given."""
    given = {name: getattr(points, name) is not None for name in _ERRORS}
    return given | {"jitter": points.jitter is not None and points.jitter is not False}


def stated_errors(
    points: DataSet,
    x: FloatArray,
    y: FloatArray,
    in_groups: Sequence[Component],
    specified: Mapping[str, bool],
    *,
    counts: bool,
) -> PointErrors:
    """The errors of x and y (n_obs,), those common to the points of a group among them.

    specified : argument -> whether it was given.  counts : whether y are counts, which have no
    errors but their own.

    Raises InputError where they are wrong, or do not go together.
    """
    n_obs, u_y = y.size, points.u_y
    share, words = 0.0, ""
    if isinstance(u_y, str):
        share, words, u_y = _share_of_y(u_y, y)
        if share and (specified["deviation"] or specified["correlated"] or specified["robust"]):
            raise InputError(
                "as a share of the curve cannot be combined with 'deviation', 'correlated' or "
                "'robust'",
                field="u_y",
                value=f"{100.0 * share:.4g}%",
            )
    u_y, skew = skew_of(u_y, n_obs)
    of_readings = ("u_x", "cov_x", "deviation", "correlated", "jitter", "robust")
    if skew is not None and (in_groups or any(specified[name] for name in of_readings)):
        rule = (
            "with another error above than below does not go with u_x, cov_x, deviation, "
            "correlated, jitter, robust, or errors in groups"
        )
        raise InputError(rule, field="u_y")
    sizes, cov = _errors_of_y(u_y, points.cov_y, n_obs)
    if in_groups:
        if counts or share or (u_y is None and cov is None):
            rule = "with groups needs u_y (in the unit of y) or cov_y beside it"
            raise InputError(rule, field=f"errors[{in_groups[0].parameter_name}]")
        cov = covariance_in_groups(in_groups, n_obs) + (np.diag(sizes**2) if cov is None else cov)
        sizes = sds_of(cov)
    sizes_x, cov_x = _errors_of_x(
        points.u_x, points.cov_x, x, stated=specified["u_y"] or specified["cov_y"]
    )
    if cov_x is None and cov is not None and sizes_x is not None:
        cov_x = np.diag(np.square(sizes_x))
    if cov_x is not None and share:
        raise InputError("does not go with a 'u_y' that is a share of the curve", field="cov_x")
    r_xy = real_numbers(points.r_xy, "r_xy") if specified["r_xy"] else None
    if r_xy is not None:
        if not (specified["u_x"] and specified["u_y"]) or share or specified["robust"]:
            raise InputError(
                "needs u_x and u_y in their units, and goes with normal errors alone", field="r_xy"
            )
        if r_xy.shape not in ((), (n_obs,)) or not np.all(np.abs(r_xy) < 1.0):
            rule = f"must be a number between -1 and 1, or as many as values of x ({n_obs})"
            raise InputError(rule, field="r_xy", value=points.r_xy)
        r_xy = np.broadcast_to(r_xy, n_obs)
    if cov_x is not None and cov is None:
        cov = np.diag(np.square(sizes))
    return PointErrors(sizes, sizes_x, cov, cov_x, r_xy, share, skew, words)


def _share_of_y(text: str, y: FloatArray) -> tuple[float, str, FloatArray]:
    """The share of the curve that errors of y are, 0 where it is one of each reading; that in
    words; and standard deviations (n_obs,) as the readings show them.
    """
    share, of_readings = share_of(text)
    rule = "must not be 0 where u_y is a share, which leaves it no error: state u_y as numbers"
    require_each(y != 0.0, y, rule, "y")
    percent = 100.0 * share
    words = (
        phrase("standard deviations of {percent:.4g} % of each reading", percent=percent)
        if of_readings
        else phrase("standard deviations of {percent:.4g} % of the curve", percent=percent)
    )
    return 0.0 if of_readings else share, words, share * np.abs(y)


def _errors_of_y(
    u_y: ArrayLike | None, cov_y: ArrayLike | None, n_obs: int
) -> tuple[FloatArray, FloatArray | None]:
    """Standard deviations (n_obs,) and the covariance matrix, if one is given."""
    if u_y is not None and cov_y is not None:
        raise InputError("cannot be combined with u_y", field="cov_y")
    if cov_y is not None:
        cov = check_covariance(cov_y, n_obs, field="cov_y")
        return sds_of(cov), cov
    if u_y is None:
        return np.ones(n_obs), None
    return errors_of(u_y, n_obs, "u_y"), None


def _errors_of_x(
    u_x: ArrayLike | None, cov_x: ArrayLike | None, x: FloatArray, *, stated: bool
) -> tuple[FloatArray | None, FloatArray | None]:
    """Standard deviations (n_obs,) of x and the covariance matrix, if one is given; None where x is
    exact.
    """
    field, cov = "u_x" if cov_x is None else "cov_x", None
    if cov_x is not None:
        if u_x is not None:
            raise InputError("cannot be combined with u_x", field=field)
        cov = check_covariance(cov_x, x.size, field=field)
        sizes = sds_of(cov)
    elif u_x is not None:
        sizes = errors_of(u_x, x.size, field, some_exact=True)
    else:
        return None, None
    if not stated:
        raise InputError(
            "needs a known u_y beside it: the sizes of both errors cannot be told from the "
            "residuals",
            field=field,
        )
    if hide_the_range(x, sizes):
        raise InputError(
            f"must be below the standard deviation of x, {float(np.std(x, ddof=1)):.4g}: points "
            "that may lie anywhere along x hold no curve",
            field=field,
            value=root_mean_square(sizes),
        )
    return sizes, cov
