"""How large a parameter of a formula may be, from its unit and from where the points lie."""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, max_abs
from estim.curves.dimensions import Dimension
from estim.curves.formula import Formula

_Range = tuple[float, float, float]  # from, to, share of the draws


@dataclass(frozen=True)
class ParameterSizes:
    """What a parameter may be: locations between two ends, and sizes of either sign whose logarithm
    is drawn evenly, each (low, high, share).

    low, high : limits.
    """

    locations: _Range | None
    sizes: tuple[_Range, ...]
    low: float
    high: float

    def draw(self, rng: np.random.Generator, n: int) -> FloatArray:
        shares = [size[2] for size in self.sizes] + (
            [] if self.locations is None else [self.locations[2]]
        )
        kinds = rng.choice(len(shares), n, p=np.array(shares) / sum(shares))
        draws = rng.choice([-1.0, 1.0], n)
        for k, (small, large, _) in enumerate(self.sizes):
            draws[kinds == k] *= np.exp(
                rng.uniform(math.log(small), math.log(large), int(np.sum(kinds == k)))
            )
        if self.locations is not None:
            draws[kinds == len(self.sizes)] = rng.uniform(
                *self.locations[:2], int(np.sum(kinds == len(self.sizes)))
            )
        return self.inside(draws, rng)

    def inside(self, values: FloatArray, rng: np.random.Generator) -> FloatArray:
        """The same, those beyond a limit mirrored at it or drawn between the limits."""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return np.where(
                (values > self.low) & (values < self.high),
                values,
                rng.uniform(self.low, self.high, values.size),
            )
        if math.isfinite(self.low):
            return self.low + np.abs(values - self.low)
        return self.high - np.abs(self.high - values) if math.isfinite(self.high) else values


def scale_of(
    unit: Dimension | None,
    factor: float,
    x: FloatArray,
    y: FloatArray,
    low: float,
    high: float,
    *,
    is_location: bool,
) -> ParameterSizes:
    """What a parameter of a unit may be, times a factor; None: of any unit.

    is_location : whether the formula adds it to x, or takes it from x.
    """
    locations, sizes = _ranges(unit, x, y, is_location=is_location)
    return ParameterSizes(
        None if locations is None else (factor * locations[0], factor * locations[1], locations[2]),
        tuple((factor * small, factor * large, share) for small, large, share in sizes),
        low,
        high,
    )


def _ranges(
    unit: Dimension | None, x: FloatArray, y: FloatArray, *, is_location: bool
) -> tuple[_Range | None, tuple[_Range, ...]]:
    """Locations and sizes of a parameter of a unit."""
    length = float(np.ptp(x)) or abs(float(x[0])) or 1.0
    step, far = length / max(1, x.size - 1), max(length, max_abs(x))
    within = float(x.min()) - 0.2 * length, float(x.max()) + 0.2 * length
    if unit is None:
        sizes = (0.1, 10.0, 1.0), (step, 10.0 * far, 1.0), (0.1 / far, math.pi / step, 1.0)
        return (*within, 1.0), sizes
    power, power_y = unit
    height = math.sqrt((float(np.ptp(y)) or abs(float(y[0])) or 1.0) * (max_abs(y) or 1.0))
    if power == 0.0 and power_y == 0.0:
        return (-math.pi, math.pi, 1.0), ((0.05, 20.0, 1.0),)
    if power == 1.0 and power_y == 0.0:
        lengths = (0.5 * step, 5.0 * length, 1.0), (length, 300.0 * far, 0.3)
        return (*within, 4.0) if is_location else None, lengths
    if power == 0.0 and power_y == 1.0:
        around = float(y.min()) - height, float(y.max()) + height, 1.0
        return around, ((1e-3 * height, 100.0 * height, 1.0),)
    along = sorted(((0.3 * step) ** power, (10.0 * far) ** power))
    up = sorted(((0.01 * height) ** power_y, (100.0 * height) ** power_y))
    return None, ((along[0] * up[0], along[1] * up[1], 1.0),)


def location_parameters(formula: Formula) -> set[str]:
    """Parameters that the formula adds to x, or takes from x."""
    sums = [
        node
        for node in ast.walk(formula.tree)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)
    ]
    sides = [
        {side.id for side in (node.left, node.right) if isinstance(side, ast.Name)} for node in sums
    ]
    return set().union(*(side - {"x"} for side in sides if "x" in side))
