"""What is stated of errors that points of a table share: files with covariance matrices, and errors
common to all readings of an axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, phrase, read_number
from estim.line.joint_covariance import MOST_POINTS, Common, joint_covariance, with_zeros
from estim.line.regression import LineFit, StandardError
from estim.line.slope_interval import SlopeInterval
from estim.problem import check_covariance
from estim.reading import Dialect, read_columns


@dataclass(frozen=True)
class LineCovariances:
    """cov : file with the covariance matrix of all x, then all y.  cov_x, cov_y : of one axis
    alone.  common : errors that all readings share.
    """

    cov: Path | None = None
    cov_x: Path | None = None
    cov_y: Path | None = None
    common: tuple[Common, ...] = ()

    @property
    def words(self) -> list[str]:
        """What is stated, for a report."""
        files = ((phrase("x, then y,"), self.cov), ("x", self.cov_x), ("y", self.cov_y))
        sentences = [
            phrase("covariances of {what} from {file}", what=what, file=path.name)
            for what, path in files
            if path is not None
        ]
        return sentences + [_shared(error) for error in self.common]

    def __bool__(self) -> bool:
        return bool(self.words)


def _shared(error: Common) -> str:
    if error.relative:
        return phrase(
            "standard uncertainty {size:g} % of the scale of {axis}, shared by all points",
            size=100.0 * error.u,
            axis=error.axis,
        )
    return phrase(
        "standard uncertainty {size:g} of the zero of {axis}, shared by all points",
        size=error.u,
        axis=error.axis,
    )


def common_error(axis: str, text: str) -> Common:
    """An error common to all readings: "0.1" in the unit of the axis, or "2%" of the reading.
    Raises InputError.
    """
    number = text.strip().removesuffix("%")
    try:
        u = read_number(number.strip())
    except ValueError:
        raise InputError(
            "must be a number, or a share like 2%", field=f"--common-{axis}", value=text
        ) from None
    if not 0.0 < u < float("inf"):
        raise InputError("must be > 0", field=f"--common-{axis}", value=text)
    relative = number != text.strip()
    return Common(axis, u / 100.0 if relative else u, relative)


def stated_covariance(
    stated: LineCovariances,
    n: int,
    u_x: FloatArray | float | None,
    u_y: FloatArray | float | None,
    r_xy: FloatArray | float,
    dialect: Dialect,
) -> FloatArray:
    """(2 n, 2 n) covariance of x, then y, of n points.

    u_x, u_y, r_xy : of each point alone.  Errors of scales are left to `with_scales`.  Raises
        InputError.
    """
    if n > MOST_POINTS:
        raise InputError(f"goes with at most {MOST_POINTS} points", field="covariance", value=n)
    if stated.cov is not None:
        joint = read_matrix(stated.cov, 2 * n, "all x, then all y", dialect)
    else:
        joint = _own_errors(stated, n, u_x, u_y, r_xy, dialect)
    return with_zeros(joint, stated.common)


def with_scales(fit: LineFit, common: Sequence[Common]) -> LineFit:
    """`fit` with the errors of scales that all points share.

    An error of the scale of y is a common factor of intercept and slope, one of x a factor of the
    slope.  Both widen the uncertainties and leave the best line where it is.  As covariances of
    the readings they would move it (Peelle's pertinent puzzle).
    """
    if not math.isfinite(fit.slope):
        return fit
    errors = {
        name: _with_scales(error, fit.intercept, fit.slope, common)
        for name, error in fit.standard_errors.items()
    }
    return replace(fit, standard_errors=MappingProxyType(errors))


def _with_scales(
    error: StandardError, intercept: float, slope: float, common: Sequence[Common]
) -> StandardError:
    # of the height at the pivot, and of the slope
    cov = np.diag([error.u_pivot**2, error.u_slope**2])
    for scale in common:
        if scale.relative:
            part = slope * error.x_pivot + (intercept if scale.axis == "y" else 0.0)
            cov += scale.u**2 * np.outer([part, slope], [part, slope])
    return StandardError.of(cov, error.x_pivot)


def slope_with_scales(
    interval: SlopeInterval, slope: float, k: float, common: Sequence[Common]
) -> SlopeInterval:
    """The interval of the slope, each side combined in quadrature with k u of the scales."""
    scales = [scale.u for scale in common if scale.relative]
    if not scales or not math.isfinite(slope):
        return interval
    u = abs(slope) * math.hypot(*scales)
    return interval._replace(
        low=slope - math.hypot(slope - interval.low, k * u),
        high=slope + math.hypot(interval.high - slope, k * u),
    )


def _own_errors(
    stated: LineCovariances,
    n: int,
    u_x: FloatArray | float | None,
    u_y: FloatArray | float | None,
    r_xy: FloatArray | float,
    dialect: Dialect,
) -> FloatArray:
    """(2 n, 2 n) covariance of each point alone, or of the axes whose matrix is stated."""
    uncertainties = [
        np.broadcast_to(0.0 if u is None else np.asarray(u, dtype=float), n) for u in (u_x, u_y)
    ]
    cov_x, cov_y = (
        None if path is None else read_matrix(path, n, axis, dialect)
        for path, axis in ((stated.cov_x, "x"), (stated.cov_y, "y"))
    )
    if u_x is None and u_y is None and cov_x is None and cov_y is None:
        raise InputError(
            "also needs the uncertainty of each reading: --uy, --ux, or a matrix",
            field=f"--common-{stated.common[0].axis}",
        )
    return joint_covariance(
        uncertainties[0], uncertainties[1], np.broadcast_to(r_xy, n), cov_x=cov_x, cov_y=cov_y
    )


def read_matrix(path: Path, size: int, what: str, dialect: Dialect) -> FloatArray:
    """(size, size) numbers from a table without names, or with a line of them.  Raises
    InputError.
    """
    names = tuple(f"{i + 1}" for i in range(size))
    rule = (
        f"must have {size} rows and {size} columns of covariances: those of {what}, in the "
        "order of the rows that are fit"
    )
    written = Dialect(names, dialect.delimiter, dialect.decimal, None, None, dialect.encoding)
    try:
        table = read_columns(path, needed=names, min_rows=1, dialect=written)
    except InputError as error:
        if error.field not in ("columns", "row"):
            raise
        raise InputError(rule, field="matrix", file=path, line=error.line) from None
    if table.lines.size != size:
        raise InputError(rule, field="matrix", value=f"{table.lines.size} rows", file=path)
    matrix = np.column_stack([table.columns[name] for name in names])
    try:
        return check_covariance(matrix, size, field="matrix", singular=True)
    except InputError as error:
        raise error.at(path) from None


def commons(x: Sequence[str], y: Sequence[str]) -> tuple[Common, ...]:
    """The errors of both axes as they are written.  Raises InputError."""
    return (*(common_error("x", text) for text in x), *(common_error("y", text) for text in y))
