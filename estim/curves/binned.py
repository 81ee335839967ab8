"""Expected numbers in bins: a user's curve as a density along x, integrated over each bin by
Gauss-Legendre quadrature that refines itself.

Ten nodes in every panel.  A panel is halved while the highest Legendre coefficients of the density
in it matter, and while the density somewhere in it stands out above all its nodes by an area that
matters: at an event, at an end, at the value of a parameter, or at such a value plus or minus
another one.  So a feature far narrower than its bin is found where a parameter gives its position,
or events lie in it.  What has not converged after 60 halvings is nan: a density whose integral is
not known is none.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, Named, finite_or
from estim.problem import EXACT, Curve, LocalCurve, n_draws, some_draws

_AT, _WEIGHTS = np.polynomial.legendre.leggauss(10)
# (2, node) the two highest Legendre coefficients of the polynomial through the nodes: (k + 1/2)
# sum_i w_i P_k(x_i) f_i
_HIGHEST = (
    np.polynomial.legendre.legvander(_AT, 9)[:, 8:] * _WEIGHTS[:, None] * np.array([8.5, 9.5])
).T
_SMOOTH = 1e-5  # share of the whole that the highest coefficients of a panel may have,
_PROMINENT = 1e-3  # and what stands out between its nodes; both less for many events:
# of the log-likelihood, and ten times as much for what stands out, which is nearly always a round
# top or a slope at an end
_TOLERANCE = 0.01
_LEAST = 1e-290  # the least integral that has all its digits


@dataclass(frozen=True, eq=False)
class BinnedCurve:
    """What is expected in bins from low to high (n_bin,), in order, of a `density` per unit of x;
    at any x that of the bin around it.

    total : number of events to which the density is scaled, so that its normalisation is
        irrelevant; None where it is taken as it is.
    events : (n_event,) positions of single ones in order, if they are known.
    """

    density: Curve
    low: FloatArray
    high: FloatArray
    total: float | None = None
    events: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def precision(self) -> float:
        """Relative error of the derivatives."""
        return getattr(self.density, "precision", EXACT)

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        inside, _ = self._integrals(arguments)
        return (inside * self._scale(inside))[:, self._bin_of(x)]

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        """The slope is that of a bin moved as a whole."""
        nodes, weights, bins = self._quadrature(arguments)
        local, at = self.density.local(nodes, arguments), self._bin_of(x)
        inside, *slopes = (
            self._summed(part * weights, bins) for part in (local.value, *local.gradient.values())
        )
        scale = self._scale(inside)
        gradient = {
            name: (scale * (slope - self._pull(inside, slope)))[:, at]
            for name, slope in zip(local.gradient, slopes, strict=True)
        }
        low, high = (self.density.value(edge, arguments) for edge in (self.low, self.high))
        return LocalCurve((scale * inside)[:, at], (scale * (high - low))[:, at], gradient)

    def rate(self, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """The density at the events (n_draw, n_event), scaled as the bins are, and what is expected
        in the bins (n_draw, n_bin).

        nan for draws whose density is negative anywhere.
        """
        at_events = self._at_events(arguments)
        inside, least = self._integrals(arguments, at_events)
        scale = np.where(least[:, None] >= 0.0, self._scale(inside), np.nan)
        return scale * at_events, scale * inside

    def local_rate(self, t: FloatArray, arguments: Named) -> LocalCurve:
        """The density with its gradient at t (n,), for single arguments."""
        nodes, weights, _ = self._quadrature(arguments)
        inside, at_t = self.density.local(nodes, arguments), self.density.local(t, arguments)
        integral = np.sum(inside.value * weights)
        scale = 1.0 if self.total is None else self.total / integral
        gradient = {
            name: scale
            * (
                partial
                - (
                    at_t.value / integral * np.sum(inside.gradient[name] * weights)
                    if self.total is not None
                    else 0.0
                )
            )
            for name, partial in at_t.gradient.items()
        }
        return LocalCurve(scale * at_t.value, scale * at_t.slope, gradient)

    def nodes(self, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """Nodes and weights (n_node,) of an integral over all bins, for single arguments."""
        return self._quadrature(arguments)[:2]

    def without_integral(self, arguments: Named) -> tuple[float, float] | None:
        """Ends of the first bin without a finite integral of a density that is finite in the middle
        of it, for single arguments.
        """
        inside = self._integrals(arguments)[0][0]
        middle = self.density.value(0.5 * (self.low + self.high), arguments)[0]
        bad = np.flatnonzero(~np.isfinite(inside) & np.isfinite(middle))
        return (float(self.low[bad[0]]), float(self.high[bad[0]])) if bad.size else None

    def vanishes(self, arguments: Named) -> bool:
        """Whether a density that counts up to a factor is as small as numbers can be, for single
        arguments: what is left of its shape there is rounding.
        """
        return self.total is not None and not np.sum(self._integrals(arguments)[0]) > _LEAST

    def _at_events(self, arguments: Named) -> FloatArray:
        """(n_draw, n_event) the density, not scaled."""
        n_draw = n_draws(arguments)
        if not self.events.size:
            return np.zeros((n_draw, 0))
        return np.broadcast_to(
            self.density.value(self.events, arguments), (n_draw, self.events.size)
        )

    def _quadrature(self, arguments: Named) -> tuple[FloatArray, FloatArray, IntArray]:
        """Nodes, weights and bins (n_node,) for single arguments."""
        panels = self._panels(arguments, self._at_events(arguments))
        half = 0.5 * (panels.high - panels.low)[:, None]
        return (
            _nodes(panels.low, panels.high).T.ravel(),
            (half * _WEIGHTS).ravel(),
            np.repeat(panels.bins, _AT.size),
        )

    def _integrals(
        self, arguments: Named, at_events: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Integrals (n_draw, n_bin) of the density, and the least that it is at any node
        (n_draw,); at_events : (n_draw, n_event) the density at the events, where it is known.
        """
        n_draw, n_bin = n_draws(arguments), self.low.size
        # nodes and events of several draws at once, so that memory is bounded
        rows = max(1, 300_000 // (_AT.size * n_bin + self.events.size))
        if n_draw > rows:
            parts = [
                self._integrals(
                    some_draws(arguments, part), None if at_events is None else at_events[part]
                )
                for k in range(0, n_draw, rows)
                for part in [slice(k, k + rows)]
            ]
            inside, least = (np.concatenate(part) for part in zip(*parts, strict=True))
            return inside, least
        panels = self._panels(
            arguments, self._at_events(arguments) if at_events is None else at_events
        )
        inside = np.zeros((n_draw, n_bin))
        np.add.at(inside, (panels.draw, panels.bins), panels.integral)
        least = np.full(n_draw, np.inf)
        np.minimum.at(least, panels.draw, panels.least)
        return inside, least

    def _panels(self, arguments: Named, at_events: FloatArray) -> _Panels:
        """Panels in which the density of each draw is integrated; at_events : (n_draw, n_event) the
        density there.
        """
        n_draw = at_events.shape[0]
        # in all, before any is halved
        each = -(-16 // self.low.size)
        edges = self.low[:, None] + (self.high - self.low)[:, None] * np.linspace(
            0.0, 1.0, each + 1
        )
        bins = np.repeat(np.arange(self.low.size), each)
        low = edges[:, :-1].ravel()
        high = edges[:, 1:].ravel()
        x = _nodes(low, high)
        values = np.broadcast_to(self.density.value(x.ravel(), arguments), (n_draw, x.size))
        panels = _panels_of(
            np.repeat(np.arange(n_draw), low.size),
            np.tile(low, n_draw),
            np.tile(high, n_draw),
            np.tile(bins, n_draw),
            np.moveaxis(values.reshape(n_draw, *x.shape), 1, 0).reshape(len(x), -1),
        )
        positions, heights = self._marks(arguments, n_draw)
        done: list[_Panels] = []
        converged = np.zeros(n_draw)
        for _ in range(60):
            total = converged + np.bincount(panels.draw, np.abs(panels.integral), minlength=n_draw)
            events = np.maximum(1.0, total if self.total is None else self.total)
            tolerance = total * np.maximum(
                np.minimum(_SMOOTH, _TOLERANCE / events), 10.0 * self.precision
            )
            prominence = total * np.maximum(
                np.minimum(_PROMINENT, 10.0 * _TOLERANCE / events), 10.0 * self.precision
            )
            outstanding = (
                np.maximum(
                    self._highest_event(panels, at_events),
                    _highest_mark(panels, positions, heights),
                )
                - panels.highest
            )
            coarse = (panels.rough > tolerance[panels.draw]) | (
                outstanding * (panels.high - panels.low) > prominence[panels.draw]
            )
            many = np.bincount(panels.draw[coarse], minlength=n_draw) > 400
            done.append(panels.where(~coarse))
            converged = converged + np.bincount(
                done[-1].draw, np.abs(done[-1].integral), minlength=n_draw
            )
            panels = panels.where(coarse)
            hopeless = many[panels.draw]
            panels.integral[hopeless] = np.nan
            done.append(panels.where(hopeless))
            panels = panels.where(~hopeless)
            if not panels.draw.size:
                break
            panels = self._halved(panels, arguments, n_draw)
        panels.integral[:] = np.nan
        return _joined([*done, panels])

    def _halved(self, panels: _Panels, arguments: Named, n_draw: int) -> _Panels:
        middle = 0.5 * (panels.low + panels.high)
        draw, bins = np.tile(panels.draw, 2), np.tile(panels.bins, 2)
        low, high = np.concatenate([panels.low, middle]), np.concatenate([middle, panels.high])
        x = _nodes(low, high)
        if n_draw == 1:
            values = self.density.value(x.ravel(), arguments).reshape(x.shape)
        else:  # each panel like a draw of its own
            values = self.density.value(x.T, some_draws(arguments, draw)).T
        return _panels_of(draw, low, high, bins, values)

    def _marks(self, arguments: Named, n_draw: int) -> tuple[FloatArray, FloatArray]:
        """Positions (n_draw, n) where a density may have something narrow, and the density
        there.
        """
        values = [np.broadcast_to(np.reshape(a, (-1, 1)), (n_draw, 1)) for a in arguments.values()]
        sums = [
            a + sign * np.abs(b)
            for a in values
            for b in values
            if a is not b
            for sign in (-1.0, 1.0)
        ]
        ends = [np.full((n_draw, 1), end) for end in (self.low[0], 0.0, self.high[-1])]
        positions = np.clip(
            np.concatenate([*ends, *values, *sums], axis=1), self.low[0], self.high[-1]
        )
        return positions, self.density.value(positions, arguments)

    def _highest_event(self, panels: _Panels, at_events: FloatArray) -> FloatArray:
        """(n_panel,) the greatest finite density of its events, 0 where there is none."""
        highest, n_event = np.zeros(panels.draw.size), at_events.shape[1]
        first, last = (
            np.searchsorted(self.events, edge, side="left") for edge in (panels.low, panels.high)
        )
        filled = first < last
        if np.any(filled):
            flat = np.append(finite_or(at_events, 0.0).ravel(), 0.0)
            pairs = (panels.draw * n_event)[filled, None] + np.column_stack([first, last])[filled]
            highest[filled] = np.maximum.reduceat(flat, pairs.ravel())[::2]
        return highest

    def _summed(self, values: FloatArray, bins: IntArray) -> FloatArray:
        """(1, n_bin) sums of values (1, n_node)."""
        return np.asarray(np.bincount(bins, values[0], minlength=self.low.size)[None, :])

    def _scale(self, inside: FloatArray) -> FloatArray:
        """(n_draw, 1)."""
        if self.total is None:
            return np.ones((inside.shape[0], 1))
        with np.errstate(all="ignore"):
            return self.total / np.sum(inside, axis=1, keepdims=True)

    def _pull(self, inside: FloatArray, slope: FloatArray) -> FloatArray:
        """By how much less the bins gain where their sum is held."""
        if self.total is None:
            return np.zeros_like(inside)
        return inside / np.sum(inside, axis=1, keepdims=True) * np.sum(slope, axis=1, keepdims=True)

    def _bin_of(self, x: FloatArray) -> IntArray:
        return np.clip(np.searchsorted(self.low, x, side="right") - 1, 0, self.low.size - 1)


@dataclass(frozen=True, eq=False)
class _Panels:
    """(n_panel,) each: the draw and the bin, both ends, the integral, the share of it in the
    highest coefficients, and the range of the density.
    """

    draw: IntArray
    bins: IntArray
    low: FloatArray
    high: FloatArray
    integral: FloatArray
    rough: FloatArray
    least: FloatArray
    highest: FloatArray

    def where(self, mask: BoolArray) -> _Panels:
        return _Panels(*(part[mask] for part in vars(self).values()))


def _nodes(low: FloatArray, high: FloatArray) -> FloatArray:
    """(10, n_panel) the nodes."""
    return 0.5 * (low + high) + 0.5 * (high - low) * _AT[:, None]


def _panels_of(
    draw: IntArray, low: FloatArray, high: FloatArray, bins: IntArray, values: FloatArray
) -> _Panels:
    """values : (10, n_panel) at the nodes."""
    width = high - low
    with np.errstate(all="ignore"):
        rough = width * np.sum(np.abs(_HIGHEST @ values), axis=0)
        integral = 0.5 * width * (_WEIGHTS @ values)
        least, highest = np.min(values, axis=0), np.max(values, axis=0)
    return _Panels(draw, bins, low, high, integral, rough, least, highest)


def _joined(several: list[_Panels]) -> _Panels:
    return _Panels(
        *(
            np.concatenate(parts)
            for parts in zip(*(vars(panels).values() for panels in several), strict=True)
        )
    )


def _highest_mark(panels: _Panels, positions: FloatArray, heights: FloatArray) -> FloatArray:
    """(n_panel,) the greatest finite density at a mark (n_draw, n) in each, 0 where there is
    none.
    """
    highest = np.zeros(panels.draw.size)
    for position, height in zip(positions.T, finite_or(heights, 0.0).T, strict=True):
        at = position[panels.draw]
        inside = np.flatnonzero((at >= panels.low) & (at <= panels.high))
        highest[inside] = np.maximum(highest[inside], height[panels.draw[inside]])
    return highest
