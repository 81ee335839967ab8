"""Expected numbers in bins: a user's curve as a density along x, integrated over each bin by Gauss-Legendre quadrature.

Eight nodes in every bin, and more where there are few bins: exact for polynomials of order 15 there.  A peak far narrower than its bin, or a jump
inside one, is beyond them: choose bins that end at a jump.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import FloatArray
from estim.problem import EXACT, Curve, LocalCurve

_ORDER = 8
_LEAST_PANELS = 32  # in all


@dataclass(frozen=True, eq=False)
class BinnedCurve:
    """What is expected in bins from low to high (n_bin,), in order, of a `density` per unit of x; at any x that of the bin around it.

    total : number of events to which the density is scaled, so that its own size has no say; None where it is taken as it is.
    """

    density: Curve
    low: FloatArray
    high: FloatArray
    total: float | None = None

    @property
    def precision(self) -> float:
        """Relative error of the derivatives."""
        return getattr(self.density, "precision", EXACT)

    @cached_property
    def nodes(self) -> tuple[FloatArray, FloatArray]:
        """Places and weights (n_node,), as many in each bin."""
        at, weights = np.polynomial.legendre.leggauss(_ORDER)
        panels = -(-_LEAST_PANELS // self.low.size)
        edges = self.low[:, None] + (self.high - self.low)[:, None] * np.linspace(0.0, 1.0, panels + 1)
        half = 0.5 * np.diff(edges, axis=1)[:, :, None]
        middle = 0.5 * (edges[:, 1:] + edges[:, :-1])[:, :, None]
        return (middle + half * at).ravel(), (half * weights).ravel()

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        times, _ = self.nodes
        inside = self._integrated(self.density.value(times, arguments))
        return np.asarray((inside * self._scale(inside))[:, self._bin_of(x)])

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        """The slope is that of a bin moved as a whole."""
        local = self.density.local(self.nodes[0], arguments)
        inside, at = self._integrated(local.value), self._bin_of(x)
        scale = self._scale(inside)
        gradient = {}
        for name, partial in local.gradient.items():
            slope = self._integrated(partial)
            gradient[name] = (scale * (slope - self._pull(inside, slope)))[:, at]
        ends = [np.broadcast_to(self.density.value(edge, arguments), (1, edge.size)) for edge in (self.low, self.high)]
        return LocalCurve((scale * inside)[:, at], (scale * (ends[1] - ends[0]))[:, at], gradient)

    def rate(self, t: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """(n_draw, n) the density at t (n,), scaled as the bins are; nan for draws whose density is negative anywhere."""
        every = self.density.value(self.nodes[0], arguments)
        scale = self._scale(self._integrated(every))
        possible = np.min(np.atleast_2d(every), axis=1, keepdims=True) >= 0.0
        return np.asarray(np.where(possible, scale * np.atleast_2d(self.density.value(t, arguments)), np.nan))

    def local_rate(self, t: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        """The density with its gradient at t (n,), for single arguments."""
        inside, here = self.density.local(self.nodes[0], arguments), self.density.local(t, arguments)
        whole = self._integrated(inside.value)
        scale = self._scale(whole)
        gradient = {
            name: scale * (partial - (here.value / whole.sum() * self._integrated(inside.gradient[name]).sum() if self.total is not None else 0.0))
            for name, partial in here.gradient.items()
        }
        return LocalCurve(scale * here.value, scale * here.slope, gradient)

    def _integrated(self, values: FloatArray) -> FloatArray:
        """(n_draw, n_bin) integrals of values at the nodes, which broadcast to (n_draw, n_node)."""
        times, weights = self.nodes
        values = np.atleast_2d(values)
        return np.asarray((np.broadcast_to(values, (values.shape[0], times.size)) * weights).reshape(values.shape[0], self.low.size, -1).sum(axis=-1))

    def _scale(self, inside: FloatArray) -> FloatArray:
        """(n_draw, 1)."""
        if self.total is None:
            return np.ones((inside.shape[0], 1))
        with np.errstate(all="ignore"):
            return np.asarray(self.total / np.sum(inside, axis=1, keepdims=True))

    def _pull(self, inside: FloatArray, slope: FloatArray) -> FloatArray:
        """By how much less the bins gain where their sum is held."""
        if self.total is None:
            return np.zeros_like(inside)
        return np.asarray(inside / np.sum(inside, axis=1, keepdims=True) * np.sum(slope, axis=1, keepdims=True))

    def _bin_of(self, x: FloatArray) -> NDArray[np.int64]:
        return np.clip(np.searchsorted(self.low, x, side="right") - 1, 0, self.low.size - 1)
