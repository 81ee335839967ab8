"""A straight line through the points of any table: columns by name, predictions, and the abscissa
at a measured ordinate (a calibration line).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import (
    Finding,
    InputError,
    Kind,
    Quantity,
    Status,
    in_file,
    listed,
    phrase,
    read_number,
)
from estim.curves import AxisNames, read_formula, units_of
from estim.line.conventions import is_exact
from estim.line.findings import points_findings
from estim.line.regression import (
    LineFit,
    coverage_factor,
    fit_line,
    inverse_prediction,
    line_values,
    standard_error,
)
from estim.line.slope_interval import SlopeInterval, slope_interval
from estim.line.stated_errors import (
    LineCovariances,
    slope_with_scales,
    stated_covariance,
    with_scales,
)
from estim.reading import (
    PLAIN,
    Dialect,
    Layout,
    are_components,
    bare_name,
    columns_sentence,
    first_and_second,
    is_column,
    read_layout,
    table_of,
    uncertainty_of,
    value_columns,
)
from estim.words import describe, first_step


@dataclass(frozen=True, eq=False)
class LineColumns:
    """Names of columns; "" for x and y, or the two that there are, from left to right.

    An uncertainty and a correlation may be one number for all points, None for the column "u_NAME"
    or "u(NAME)", "r_xy" if there.
    """

    x: str = ""
    y: str = ""
    u_x: str | None = None
    u_y: str | None = None
    r_xy: str | None = None


@dataclass(frozen=True, eq=False)
class PredictedPoint:
    """A prediction, y of the line at a `given` x, or an inverse one, x at which it reaches a
    `given` y.

    u : of the line, with the uncertainty of what is given; of x linear.
    low, high : interval for the probability of the line; of x Fieller's exact one, infinite where
        the slope may be 0.
    u_reading : with the uncertainty of one more reading of y too, nan where that is not known.
    """

    given: float
    u_given: float
    value: float
    u: float
    low: float
    high: float
    u_reading: float = math.nan


@dataclass(frozen=True, eq=False)
class StraightLine:
    """A line through the points of a table.  columns : as they were read, None for what was not
    there.  facts : how the table was read, in words.

    correlated : what is stated of errors that points share, in words.
    axes : names of x and y, with the units that the header states.
    told : which columns are what, in words.
    findings : the evidence of the residuals against the line.
    """

    path: Path
    sha256: str
    columns: LineColumns
    fit: LineFit
    slope: SlopeInterval
    k: float
    probability: float
    predictions: tuple[PredictedPoint, ...]
    inverses: tuple[PredictedPoint, ...]
    axes: AxisNames
    told: str
    facts: tuple[str, ...] = ()
    correlated: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def status(self) -> Status:
        if self.findings:
            return Status.POOR_FIT
        return Status.NOT_IDENTIFIED if self.fit.message or self.slope.message else Status.OK

    @property
    def units(self) -> Mapping[str, str]:
        """Of "x", "y", "intercept" and "slope"; "1" where the header states none."""
        names = "intercept", "slope"
        follows = units_of(read_formula("intercept + slope*x"), self.axes, names)
        own = {"x": self.axes.x_unit, "y": self.axes.y_unit}
        return own | {name: follows.get(name, "1") for name in names}

    @property
    def first_step(self) -> str:
        """What to do first about a line that is no result."""
        if any(finding.kind is not Kind.POINTS_SCATTER for finding in self.findings):
            return phrase(
                "look at the residuals: if the points bend, fit another curve (estim fit); if "
                "one reading is far off, check it"
            )
        if self.findings:
            return first_step(self.findings)
        if math.isinf(self.fit.slope):
            return phrase("exchange x and y")
        if self.slope.message:
            return phrase("exchange x and y, or measure over a wider range of x")
        return phrase("measure over a wider range of x, or more precisely")

    @property
    def message(self) -> str:
        """What a reader must know before using the numbers; "" if nothing."""
        # which the fit states itself
        sentences = (
            describe(finding)
            for finding in self.findings
            if finding.kind is not Kind.POINTS_SCATTER
        )
        determined = self.fit.message or self.slope.message
        return " ".join(
            [determined] * bool(determined)
            + [f"{words[0].upper()}{words[1:]}." for words in sentences]
        )


def straight_line(
    path: Path,
    columns: LineColumns,
    *,
    predict: Sequence[Quantity] = (),
    inverse: Sequence[Quantity] = (),
    probability: float = 0.95,
    dialect: Dialect = PLAIN,
    correlated: LineCovariances | None = None,
) -> StraightLine:
    """The line through the CSV table at `path`.  Raises InputError with file, line, column, rule
    and value.

    inverse : values of y with their uncertainties; a plain number has the scatter of the residuals
        where no uncertainties are known.
    dialect : how the table is written, as far as that is stated.
    correlated : errors that points share.
    """
    stated = correlated or LineCovariances()
    layout = read_layout(path, dialect)
    columns = _with_axes(columns, layout)
    candidates = [name for name in layout.names if columns.x in (name, bare_name(name))]
    if columns.x == columns.y and len(candidates) < 2:
        raise InputError("must name another column than --x", field="--y", value=columns.y)
    named_columns = replace(
        columns,
        u_x=columns.u_x or _own_uncertainty(columns.x, layout),
        u_y=columns.u_y or _own_uncertainty(columns.y, layout),
        r_xy=columns.r_xy or "r_xy",
    )
    named = [
        name
        for name in dict.fromkeys(vars(named_columns).values())
        if name is not None
        and _number(name) is None
        and (name in vars(columns).values() or is_column(name, layout.names))
    ]
    table = table_of(layout, named, 3)

    def column(name: str | None) -> FloatArray | float | None:
        return None if name is None else table.columns.get(name, _number(name))

    unread: dict[str, Any] = {
        key: None for key, name in vars(named_columns).items() if column(name) is None
    }
    read = _without_contained(columns, replace(named_columns, **unread), stated)
    if read.u_x is None or read.u_y is None:
        if columns.r_xy is not None:
            raise InputError(
                "needs uncertainties of x and y", field="--correlation", value=columns.r_xy
            )
        read = replace(read, r_xy=None)
    u_x, u_y = column(read.u_x), column(read.u_y)
    for option, u, of, values in (("--ux", read.u_x, read.x, u_x), ("--uy", read.u_y, read.y, u_y)):
        name = str(u)
        table.require_unit(name, of)
        positive = np.atleast_1d(1.0 if values is None else values) > 0.0
        if name in table.columns:
            table.require(name, positive, "must be > 0")
        elif not np.all(positive):
            raise InputError("must be > 0", field=option, value=values)
    x, y, r_xy = table.columns[read.x], table.columns[read.y], column(read.r_xy)
    if r_xy is None:
        r_xy = 0.0
    with in_file(path):
        if stated:
            cov = stated_covariance(stated, x.size, u_x, u_y, r_xy, dialect)
            fit = with_scales(fit_line(x, y, cov=cov), stated.common)
        else:
            fit = fit_line(x, y, u_x=u_x, u_y=u_y, r_xy=r_xy)
    if fit.method == "ols" and is_exact(fit.data, fit.chi2):
        rule = (
            "has no scatter about a line but rounding errors (computed values, not readings?): "
            "nothing tells how large its errors are"
        )
        raise InputError(f"{rule}; give --uy", field=read.y, file=table.file)
    k = coverage_factor(fit, probability=probability)
    used = [
        (key, name, table.units[name]) for key, name in vars(read).items() if name in table.columns
    ]
    return StraightLine(
        path=path,
        sha256=table.sha256,
        columns=read,
        fit=fit,
        slope=slope_with_scales(
            slope_interval(fit, probability=probability), fit.slope, k, stated.common
        ),
        k=k,
        probability=probability,
        predictions=tuple(_prediction(fit, x0, k) for x0 in predict),
        inverses=tuple(_inverse(fit, y0, k, probability) for y0 in inverse),
        axes=AxisNames(
            *(
                word
                for name in (read.x, read.y)
                for word in (bare_name(name), table.units[name] or "1")
            )
        ),
        told=columns_sentence(used, table.unread),
        facts=(*table.facts, *table.warnings),
        correlated=tuple(stated.words),
        findings=tuple(points_findings(fit)),
    )


def _own_uncertainty(name: str, layout: Layout) -> str | None:
    """The column u_NAME, without its unit, or u(NAME), if it is there."""
    column = uncertainty_of(name, layout.names)
    return column if column is None or column.startswith("u(") else bare_name(column)


def _with_axes(columns: LineColumns, layout: Layout) -> LineColumns:
    """The columns with names of x and y: x and y, where they have these names, or those of the two
    columns of values.  Raises InputError.
    """
    names = [
        bare_name(name)
        for name in value_columns(layout, (columns.u_x, columns.u_y, columns.r_xy or "r_xy"))
    ]
    own = () if are_components(names) else ("x", "y")
    defaults = {name for name in own if is_column(name, layout.names)} - {columns.x, columns.y}
    x, y = (
        columns.x or ("x" if "x" in defaults else ""),
        columns.y or ("y" if "y" in defaults else ""),
    )
    if not columns.x and not columns.y and not (x and y):
        x, y = first_and_second(names) or (x, y)
    elif len(others := [name for name in names if name not in (x, y)]) == 1:
        x, y = x or others[0], y or others[0]
    if missing := [option for option, name in (("--x", x), ("--y", y)) if not name]:
        known = listed([column for column in layout.names if column])
        raise InputError(
            f"must be named by {' and '.join(missing)}",
            field="column",
            quoted=f"there are {known}",
            file=layout.file,
            line=layout.header_line,
        )
    return replace(columns, x=x, y=y)


def _without_contained(
    columns: LineColumns, read: LineColumns, stated: LineCovariances
) -> LineColumns:
    """The columns without those of uncertainties that a matrix holds.  Raises InputError where one
    of these was named.
    """
    contained = [
        key
        for key, of_axis in (("u_x", stated.cov_x), ("u_y", stated.cov_y))
        if stated.cov is not None or of_axis is not None
    ]
    if not contained:
        return read
    contained.append("r_xy")
    for key, option in (("u_x", "--ux"), ("u_y", "--uy"), ("r_xy", "--correlation")):
        if key in contained and getattr(columns, key) is not None:
            raise InputError(
                "cannot be combined with a covariance matrix, which already contains it",
                field=option,
                value=getattr(columns, key),
            )
    if stated.cov is not None and (stated.cov_x is not None or stated.cov_y is not None):
        raise InputError(
            "cannot be combined with --cov, which already contains it",
            field="--cov-x" if stated.cov_x is not None else "--cov-y",
        )
    none: dict[str, Any] = dict.fromkeys(contained)
    return replace(read, **none)


def _number(text: str) -> float | None:
    try:
        return read_number(text)
    except ValueError:
        return None


def _prediction(fit: LineFit, x0: Quantity, k: float) -> PredictedPoint:
    values = line_values(fit, x0.value)
    y, u = float(values.values[0]), math.hypot(float(values.u[0]), fit.slope * x0.u)
    u_reading = math.hypot(u, _u_of_reading(fit))
    return PredictedPoint(x0.value, x0.u, y, u, y - k * u, y + k * u, u_reading)


def _u_of_reading(fit: LineFit) -> float:
    """Standard uncertainty of one more reading of y: the scatter of the residuals, or what all
    points state equally; nan where they differ.
    """
    if fit.method == "correlated":
        return math.nan
    if fit.method == "ols":
        return math.sqrt(fit.chi2 / fit.dof)
    u = np.unique(fit.data.u_y)
    scale = math.sqrt(fit.chi2 / fit.dof) if fit.recommended == "scaled" else 1.0
    return scale * float(u[0]) if u.size == 1 else math.nan


def _inverse(fit: LineFit, y0: Quantity, k: float, probability: float) -> PredictedPoint:
    """Fieller's interval: all x with (y0 - a - b x)^2 <= k^2 (u_y0^2 + u^2(a + b x)).  Source:
    Fieller 1954, J. R. Stat. Soc. B 16, 175.
    """
    if y0.exact and fit.method != "ols":
        raise InputError(
            'must have an uncertainty, as "10.5(5)": the table gives only those of its points',
            field="--inverse",
            value=y0.value,
        )
    u_y0 = _u_of_reading(fit) if y0.exact else y0.u
    linear = inverse_prediction(fit, y0.value, u_y0=u_y0, probability=probability)
    error = standard_error(fit)
    above = y0.value - fit.intercept - fit.slope * error.x_pivot
    curvature = fit.slope**2 - k**2 * error.u_slope**2
    room = above**2 - k**2 * (u_y0**2 + error.u_pivot**2)
    if curvature <= 0.0:
        return PredictedPoint(y0.value, u_y0, linear.x0, linear.u_x0, -math.inf, math.inf)
    middle = above * fit.slope / curvature
    half = math.sqrt(max((above * fit.slope) ** 2 - curvature * room, 0.0)) / curvature
    centre = error.x_pivot + middle
    return PredictedPoint(y0.value, u_y0, linear.x0, linear.u_x0, centre - half, centre + half)
