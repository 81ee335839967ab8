"""A formula whose linear parameters are solved for at every trial of the others (variable
projection; Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413), many trials at once.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from estim.arrays import FloatArray, all_finite, max_abs, positive_or
from estim.curves.dimensions import dimensions_of
from estim.curves.dual_numbers import Dual, plain
from estim.curves.formula import Formula, evaluate, names_in
from estim.curves.models import Limits
from estim.curves.parameter_sizes import ParameterSizes, location_parameters, scale_of
from estim.levenberg_marquardt import LeastSquares

_INDEPENDENT = 1e-9  # share of a column that must be left where those before it are taken out


def linear_in(formula: Formula, names: Collection[str]) -> tuple[str, ...]:
    """Those of `names` in which the curve is linear together: half way between two sets of values
    it is the mean of both curves, with the same finite slopes as at these and where all of them
    are 0 (not so V in 1/(1/V + K/(V*x))).
    """
    rng = np.random.default_rng(1)
    x, others = rng.uniform(0.5, 2.0, 16), {name: rng.uniform(0.5, 2.0) for name in formula.names}

    linear: list[str] = []
    for name in names:
        tried = [*linear, name]
        first, second = (
            dict(zip(tried, (sign * rng.uniform(0.5, 2.0, len(tried))).tolist(), strict=True))
            for sign in (1.0, -1.0)
        )
        middle = {key: 0.5 * (first[key] + second[key]) for key in tried}
        with np.errstate(all="ignore"):  # an origin far off may make a curve overflow here
            at_first, at_second, at_middle, at_zero = (
                formula.local(x, {**others, **at})
                for at in (first, second, middle, dict.fromkeys(tried, 0.0))
            )
            pairs = [(0.5 * (at_first.value + at_second.value), at_middle.value)]
            pairs += [
                (at.gradient[key], at_middle.gradient[key])
                for at in (at_first, at_second, at_zero)
                for key in tried
            ]
        if all(_close(*pair) for pair in pairs) and np.any(at_middle.gradient[name]):
            linear.append(name)
    return tuple(linear)


def _close(a: FloatArray, b: FloatArray) -> bool:
    return all_finite(b) and np.allclose(a, b, rtol=1e-10, atol=1e-12 * max_abs(b))


@dataclass(frozen=True, eq=False)
class ProjectedCurve:
    """The residuals of a curve as functions of its nonlinear parameters.

    x, y, weight : (n_obs,), y weighted.
    linear, nonlinear : names of the parameters that are solved for, which have no limits, and of
        the others.
    scales : of the nonlinear ones.  blocks : which of them occur in one term of the formula.
    """

    formula: Formula
    x: FloatArray
    y: FloatArray
    weight: FloatArray
    known: Mapping[str, float]
    linear: tuple[str, ...]
    nonlinear: tuple[str, ...]
    scales: tuple[ParameterSizes, ...]
    blocks: tuple[tuple[int, ...], ...]

    @cached_property
    def function(self) -> LeastSquares:
        """The sum of squares as a function of the nonlinear parameters, for descents."""
        return LeastSquares(
            lambda points, _which: self.residuals(points),
            low=np.array([scale.low for scale in self.scales]),
            high=np.array([scale.high for scale in self.scales]),
            size=np.array([scale.sizes[0][0] for scale in self.scales]),
            linear=np.zeros(0, dtype=np.int64),  # solved for in the residuals
            nonlinear=np.arange(len(self.nonlinear)),
            step=1e-7,
            n_res=self.x.size,
        )

    @property
    def rounding(self) -> float:
        """A sum of squares that is one of rounding errors."""
        return 1e-20 * float(self.y @ self.y)

    def parameters_at(self, nonlinear: FloatArray) -> dict[str, float]:
        """Name -> value of the parameters that are fit."""
        rest, columns = self._parts(nonlinear[None, :])
        with np.errstate(over="ignore"):  # inf: such a parameter is 0
            size = positive_or(np.linalg.norm(columns[:, 0], axis=1), 1.0)
        solved = (
            np.linalg.lstsq((columns[:, 0] / size[:, None]).T, rest[0], rcond=None)[0] / size
            if self.linear
            else np.zeros(0)
        )
        return dict(
            zip(
                (*self.nonlinear, *self.linear),
                (*nonlinear.tolist(), *solved.tolist()),
                strict=True,
            )
        )

    def residuals(self, nonlinear: FloatArray) -> FloatArray:
        """(n, n_obs) what the curves at nonlinear (n, n_nonlinear) leave of y; not finite where the
        curve is not.  By Gram-Schmidt on the curves of the linear parameters.
        """
        rest, columns = self._parts(nonlinear)
        basis: list[FloatArray] = []
        with np.errstate(all="ignore"):
            for column in columns:
                column /= np.sqrt(_dot(column, column))
                for earlier in basis * 2:  # twice, for rounding
                    column -= _dot(column, earlier) * earlier
                size = np.sqrt(_dot(column, column))
                column *= np.where(size > _INDEPENDENT, 1.0 / size, 0.0)
                basis.append(column)
                rest -= _dot(column, rest) * column
        return rest

    def squares(self, nonlinear: FloatArray) -> FloatArray:
        """(n,) sums of squares, inf where the curve is not finite."""
        return 2.0 * self.function.objectives(nonlinear)

    def _parts(self, nonlinear: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, n_obs) y without what the linear parameters do not move, and (n_linear, n, n_obs) the
        curves of a unit of each.
        """
        symbols: dict[str, Any] = {
            "x": self.x,
            **{name: np.float64(value) for name, value in self.known.items()},
            **{name: nonlinear[:, [i]] for i, name in enumerate(self.nonlinear)},
            **{name: Dual(np.float64(0.0), {name: 1.0}) for name in self.linear},
        }
        curve, shape = evaluate(self.formula.tree, symbols), (nonlinear.shape[0], self.x.size)
        constant = np.broadcast_to(plain(curve), shape)
        columns = np.empty((len(self.linear), *shape))
        with np.errstate(all="ignore"):
            for column, name in zip(columns, self.linear, strict=True):
                np.multiply(curve.partials[name], self.weight, out=column)
            return self.y - constant * self.weight, columns


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, 1) scalar products of the rows of a and b (n, n_obs)."""
    return np.einsum("ij,ij->i", a, b)[:, None]


def project_curve(
    formula: Formula,
    x: FloatArray,
    y: FloatArray,
    u: FloatArray,
    known: Mapping[str, float],
    limits: Mapping[str, Limits],
    names: Sequence[str],
) -> ProjectedCurve:
    """The curve at the points x, y with relative errors u (n_obs,), or some of them if there are
    many; `names`: all but the known ones.
    """
    # points at which a search looks
    every = max(1, -(-x.size // 1000))
    x, y, weight = x[::every], y[::every], float(np.median(u)) / u[::every]
    ends = {}
    for name in names:
        low, high = limits.get(name, (None, None))
        ends[name] = -math.inf if low is None else low, math.inf if high is None else high
    linear = linear_in(formula, [name for name in names if not any(map(math.isfinite, ends[name]))])
    nonlinear = tuple(name for name in names if name not in linear)
    (units, factors), locations = dimensions_of(formula), location_parameters(formula)
    scales = tuple(
        scale_of(units.get(name), factors[name], x, y, *ends[name], is_location=name in locations)
        for name in nonlinear
    )
    return ProjectedCurve(
        formula,
        x,
        y * weight,
        weight,
        known,
        linear,
        nonlinear,
        scales,
        _blocks(formula, nonlinear),
    )


def _blocks(formula: Formula, nonlinear: Sequence[str]) -> tuple[tuple[int, ...], ...]:
    """Parameters that stand together in terms of a sum."""
    blocks: list[set[str]] = []
    for term in _terms(formula.tree):
        block = names_in(term) & {*nonlinear}
        joined = [other for other in blocks if other & block]
        blocks = [other for other in blocks if not other & block] + (
            [block.union(*joined)] if block else []
        )
    return tuple(
        tuple(nonlinear.index(name) for name in nonlinear if name in block) for block in blocks
    )


def _terms(tree: ast.expr) -> list[ast.expr]:
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub):
        return [*_terms(tree.left), *_terms(tree.right)]
    return [tree]
