"""A formula whose linear parameters are solved for at every trial of the others (variable
projection; Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413), many trials at once.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estim.arrays import FloatArray, all_finite, max_abs
from estim.curves.dimensions import dimensions_of, factors_of
from estim.curves.dual_numbers import Dual, plain
from estim.curves.formula import CONSTANTS, FUNCTIONS, Formula, angles_in, evaluate, names_in
from estim.curves.models import Limits
from estim.curves.parameter_sizes import Scale, places_of, scale_of
from estim.levenberg_marquardt import LeastSquares


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
            one, other, between, zero = (
                formula.local(x, {**others, **at})
                for at in (first, second, middle, dict.fromkeys(tried, 0.0))
            )
            pairs = [(0.5 * (one.value + other.value), between.value)]
            pairs += [
                (at.gradient[key], between.gradient[key])
                for at in (one, other, zero)
                for key in tried
            ]
        if all(_alike(*pair) for pair in pairs) and np.any(between.gradient[name]):
            linear.append(name)
    return tuple(linear)


def _alike(a: FloatArray, b: FloatArray) -> bool:
    return all_finite(b) and np.allclose(a, b, rtol=1e-10, atol=1e-12 * max_abs(b))


@dataclass(frozen=True, eq=False)
class ProjectedCurve:
    """x, y, weight : (n_obs,), y weighted.
    linear, nonlinear : names of the parameters that are solved for and drawn.

    scales, blocks : of those drawn; which of them stand in one term of the formula.
    owned : linear parameters of these terms alone.
    turning : angles that the formula takes the sine, cosine or tangent of.
    """

    formula: Formula
    x: FloatArray
    y: FloatArray
    weight: FloatArray
    known: Mapping[str, float]
    linear: tuple[str, ...]
    nonlinear: tuple[str, ...]
    scales: tuple[Scale, ...]
    blocks: tuple[tuple[int, ...], ...]
    owned: tuple[set[str], ...]
    turning: tuple[ast.expr, ...]

    def function(self, absent: Sequence[Sequence[int]] = ()) -> LeastSquares:
        """The sum of squares as a function of the drawn parameters, which descents minimise,
        without the terms of the blocks `absent`.
        """
        return LeastSquares(
            lambda points, _which: self.left(points, absent),
            np.array([scale.low for scale in self.scales]),
            np.array([scale.high for scale in self.scales]),
            np.array([scale.sizes[0][0] for scale in self.scales]),
            np.zeros(0, dtype=np.int64),
            np.arange(len(self.nonlinear)),
            1e-7,
            self.x.size,
        )

    @property
    def rounding(self) -> float:
        return 1e-20 * float(self.y @ self.y)

    def whole(self, nonlinear: FloatArray) -> dict[str, float]:
        """Name -> value of the parameters that are sought; those solved for within their limits."""
        rest, columns = self._parts(nonlinear[None, :], self.linear)
        size = np.linalg.norm(columns[:, 0], axis=1)
        size[size == 0.0] = 1.0
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

    def linear_of(self, block: Sequence[int]) -> set[str]:
        """Linear parameters that stand in the terms of a block, and in no other."""
        return self.owned[self.blocks.index(tuple(block))]

    def left(self, nonlinear: FloatArray, absent: Sequence[Sequence[int]] = ()) -> FloatArray:
        """(n, n_obs) what the curves at nonlinear (n, n_nonlinear) leave of y, without the terms of
        the blocks `absent`; not finite where the curve is not.
        """
        gone = set().union(*(self.linear_of(block) for block in absent))
        rest, columns = self._parts(nonlinear, [name for name in self.linear if name not in gone])
        taken: list[FloatArray] = []
        with np.errstate(all="ignore"):
            for column in columns:
                column /= np.sqrt(_dot(column, column))
                for earlier in taken * 2:
                    column -= _dot(column, earlier) * earlier
                size = np.sqrt(_dot(column, column))
                # share of a column that must be left where those before it are taken out
                column *= np.where(size > 1e-9, 1.0 / size, 0.0)
                taken.append(column)
                rest -= _dot(column, rest) * column
        return rest

    def squares(self, nonlinear: FloatArray, absent: Sequence[Sequence[int]] = ()) -> FloatArray:
        """(n,) sums of squares, inf where the curve is not finite or turns unseen."""
        sums = 2.0 * self.function(absent).objectives(nonlinear)
        return np.where(self._turns_unseen(nonlinear), math.inf, sums)

    def _turns_unseen(self, nonlinear: FloatArray) -> FloatArray:
        """(n,) whether an oscillation makes more than half a turn from a point to the nearest other
        one: a slower one draws the same curve there.
        """
        # places at which angles are compared
        unseen, places = np.zeros(nonlinear.shape[0], dtype=bool), np.unique(self.x)[:50]
        if places.size < 2 or not self.turning:
            return unseen
        step = np.diff(places)
        symbols = {
            "x": places,
            **self.known,
            **{name: nonlinear[:, [i]] for i, name in enumerate(self.nonlinear)},
        }
        with np.errstate(all="ignore"):
            for tree in self.turning:
                angle = np.broadcast_to(
                    np.asarray(evaluate(tree, symbols)), (nonlinear.shape[0], places.size)
                )
                unseen |= (
                    np.median(np.abs(np.diff(angle, axis=1) / step), axis=1) * float(np.min(step))
                    > 1.01 * math.pi
                )
        return unseen

    def _parts(self, nonlinear: FloatArray, solved: Sequence[str]) -> tuple[FloatArray, FloatArray]:
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
        still = np.broadcast_to(plain(curve), shape)
        columns = np.empty((len(solved), *shape))
        with np.errstate(all="ignore"):
            for column, name in zip(columns, solved, strict=True):
                np.multiply(curve.partials[name], self.weight, out=column)
            return self.y - still * self.weight, columns


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, 1) scalar products of the rows of a and b (n, n_obs)."""
    return np.einsum("ij,ij->i", a, b)[:, None]


def projected(
    formula: Formula,
    x: FloatArray,
    y: FloatArray,
    u: FloatArray,
    known: Mapping[str, float],
    limits: Mapping[str, Limits],
    sought: Sequence[str],
) -> ProjectedCurve:
    """The curve at the points x, y with relative errors u (n_obs,), or some of them if there are
    many; `sought`: all names but the known ones.
    """
    # points at which a search looks
    every = max(1, -(-x.size // 1000))
    x, y, weight = x[::every], y[::every], float(np.median(u)) / u[::every]
    ends = {}
    for name in sought:
        low, high = limits.get(name, (None, None))
        ends[name] = -math.inf if low is None else low, math.inf if high is None else high
    linear = linear_in(
        formula, [name for name in sought if not any(map(math.isfinite, ends[name]))]
    )
    nonlinear = tuple(name for name in sought if name not in linear)
    units, factors, places = dimensions_of(formula), factors_of(formula), places_of(formula)
    scales = tuple(
        scale_of(units.get(name), factors[name], x, y, *ends[name], place=name in places)
        for name in nonlinear
    )
    turning = _turning(formula, {*nonlinear, *known, "x"})
    return ProjectedCurve(
        formula,
        x,
        y * weight,
        weight,
        known,
        linear,
        nonlinear,
        scales,
        *_blocks(formula, linear, nonlinear),
        turning,
    )


def _blocks(
    formula: Formula, linear: Sequence[str], nonlinear: Sequence[str]
) -> tuple[tuple[tuple[int, ...], ...], tuple[set[str], ...]]:
    """Parameters that stand together in terms of a sum, and the linear parameters of these terms
    alone.
    """
    terms = [names_in(term) for term in _terms(formula.tree)]
    blocks: list[set[str]] = []
    for names in terms:
        block = names & {*nonlinear}
        joined = [other for other in blocks if other & block]
        blocks = [other for other in blocks if not other & block] + (
            [block.union(*joined)] if block else []
        )
    owned = []
    for block in blocks:
        outside = set().union(*(names for names in terms if not names & block))
        owned.append(
            {name for names in terms if names & block for name in names & {*linear}} - outside
        )
    return tuple(
        tuple(nonlinear.index(name) for name in nonlinear if name in block) for block in blocks
    ), tuple(owned)


def _turning(formula: Formula, given: Collection[str]) -> tuple[ast.expr, ...]:
    """Angles that the formula takes the sine, cosine or tangent of, if they are made of x and of
    names that are given.
    """
    known = {*given, *CONSTANTS, *FUNCTIONS, "power"}
    angles = angles_in(formula.tree)
    return tuple(a for a in angles if (names := names_in(a)) <= known and "x" in names)


def _terms(tree: ast.expr) -> list[ast.expr]:
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub):
        return [*_terms(tree.left), *_terms(tree.right)]
    return [tree]
