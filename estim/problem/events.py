"""Times of single events, without bins: the density of the events is a curve, normalised over a
window.

`Events` is the noise.  Its points are the numbers of events in cells of the window, which figures
and tests show; the likelihood uses every time:

    log L = sum_i log rate(t_i) - sum_k (expected number in cell k) + constant

With the rate scaled so that as many events are expected in the window as there are, this is the
likelihood of the times given their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from estim.arrays import FloatArray, IntArray, Named
from estim.common import InputError, behind, phrase
from estim.problem.count_noise import CountErrors, Counts
from estim.problem.curve import Curve, LocalCurve, Wording
from estim.problem.errors_in_x import ROOTED, rooted
from estim.problem.likelihood import Likelihood, Points, n_draws


@runtime_checkable
class RateCurve(Curve, Protocol):
    """A curve of expected numbers of events in cells that knows the rate within them."""

    def nodes(self, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """Times and weights (n_node,) of an integral over all cells, for single arguments."""

    def rate(self, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """(n_draw, n_event) events per unit of time at the events and (n_draw, n_cell) their
        expected number; nan where it is no rate.
        """

    def local_rate(self, t: FloatArray, arguments: Named) -> LocalCurve:
        """The same with its gradient."""


@dataclass(frozen=True, eq=False)
class EventErrors(CountErrors):
    """Events at `times` (n_event,) in cells, number first[k] to first[k + 1] of them in cell k;
    spacing : (n_event,) between neighbours.
    """

    times: FloatArray
    first: IntArray
    spacing: FloatArray

    resolved = ROOTED

    def pointwise(self, named: Named) -> FloatArray:
        """Of each cell: the density of the times of its events, and of their number."""
        with np.errstate(all="ignore"):
            rate, expected = self._rates.rate(self.points.bind(named))
            return np.broadcast_to(
                self._by_cell(np.log(rate)) - expected, (n_draws(named), self.y.size)
            )

    def standardised(self, named: Named) -> FloatArray:
        """Of the numbers in cells."""
        return super().residuals(named)

    def residuals(self, named: Named) -> FloatArray:
        """Up to a constant that keeps the squares positive: no density of single times is the
        highest.
        """
        # the exponential of it is how far a rate may exceed one event between an event and its
        # nearest neighbour
        highest = self._by_cell(-np.log(self.spacing)[None, :])[0] + 3.0 * self.y + 1.0
        with np.errstate(all="ignore"):
            rate, expected = self._rates.rate(self.points.bind(named))
            # never 0: the number in a cell does not tell where in it events lie
            sign = np.where(self.y < expected, -1.0, 1.0)
            return sign * np.sqrt(
                2.0 * np.maximum(highest - self._by_cell(np.log(rate)) + expected, 0.0)
            )

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        return rooted(
            self.information(named, names, {}),
            np.sum(self._scores(named, names), axis=0),
            self.y.size,
        )

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_node, n_par): the information is the integral of the squared derivatives of the rate
        over the rate.
        """
        times, weights = self._rates.nodes(self.points.bind(named))
        rate, slopes = self._rate_and_slopes(times, named, names)
        with np.errstate(all="ignore"):
            # the quotient first would overflow for a rate that is all but 0
            root = np.where(rate > 0.0, np.sqrt(weights) / np.sqrt(rate), 0.0)
            return root[:, None] * slopes

    def _scores(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n_par) derivatives of `pointwise`."""
        rate, slopes = self._rate_and_slopes(self.times, named, names)
        with np.errstate(all="ignore"):
            return self._by_cell((slopes / rate[:, None]).T).T - self.points.gradient(named, names)

    def _rate_and_slopes(
        self, times: FloatArray, named: Named, names: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        local = self._rates.local_rate(times, self.points.bind(named))
        at_times = replace(self.points, x=times)
        return local.value[0], at_times.gradients_of(local, named, names, 1)[0]

    def _by_cell(self, of_events: FloatArray) -> FloatArray:
        """Sums (n, n_obs) over the events (n, n_event) of each cell."""
        total = np.concatenate(
            [np.zeros((of_events.shape[0], 1)), np.cumsum(of_events, axis=1)], axis=1
        )
        return np.diff(total[:, self.first], axis=1)

    @property
    def _rates(self) -> RateCurve:
        if not isinstance(self.points.curve, RateCurve):
            raise InputError("need a curve that knows their rate", field="event-times")
        return self.points.curve


@dataclass(frozen=True, eq=False, kw_only=True)
class Events(Counts):
    """times : (n_event,) in order.  window : its ends."""

    times: FloatArray
    window: tuple[float, float]

    single = True

    def likelihood(self, points: Points, named: Named) -> Likelihood:
        assert self.bins is not None, "events have cells"
        first = np.append(
            np.searchsorted(self.times, self.bins[:, 0], side="left"), self.times.size
        )
        first[0] = 0
        return EventErrors(points, self.law, self.trials, self.times, first, self._spacing)

    @cached_property
    def _spacing(self) -> FloatArray:
        """(n_event,) from each event to the nearest other, of those at one time the least of all:
        no cell shows how high a rate may be.
        """
        low, high = self.window
        gaps = np.diff(self.times, prepend=2.0 * low - high, append=2.0 * high - low)
        nearest = np.minimum(gaps[:-1], gaps[1:])
        return np.where(nearest > 0.0, nearest, np.min(nearest[nearest > 0.0], initial=high - low))

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        unit = behind(x_unit)
        low, high = self.window
        return phrase(
            "{n} times of single events, unbinned, the curve normalised over the window "
            "from {low:.6g} to {high:.6g}{unit}; "
            "figures and tests count them in {cells} cells",
            n=self.times.size,
            low=low,
            high=high,
            unit=unit,
            cells=self.trials.size,
        )
