"""What was counted, in place of an error of y: `Poisson`, `Binomial`, `EventTimes`, and the points
that come of it.

- `Poisson`: y is a number of events.  With `bins` the curve is their density along x, integrated
  over each bin; without, what is expected at x.
- `Binomial`: y is the number of successes among `trials`; the curve is the probability of one.
- `EventTimes`: x are the times of single events within a window; the curve is their density, whose
  normalisation is irrelevant.  A background is part of the formula ("exp(-x/tau) + b").
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import BoolArray, FloatArray
from estim.common import InputError, later
from estim.curves.binned import BinnedCurve
from estim.curves.columns import column
from estim.curves.systematic_errors import Component
from estim.given_numbers import (
    check_lengths,
    finite_numbers,
    real_number,
    real_numbers,
    require_each,
)
from estim.problem import (
    BINOMIAL,
    POISSON,
    Counts,
    Curve,
    Events,
    OwnDensity,
    Wording,
    counted_words,
)

MAX_OBS = 1_000_000  # what costs in proportion: independent errors of y alone, counts, events
_MOST_CELLS = 1000


@dataclass(frozen=True, eq=False)
class Poisson:
    """Counts.  bins : None, the width of bins with x in their middle, or their edges: (n_obs + 1,)
    in order, or (n_obs, 2) low and high.

    Without bins the curve is the expected count at x, with bins the density of counts along x, per
    unit of x.  A fit raises InputError where y are not whole numbers from 0, or bins overlap or do
    not hold their x.  Source of the deviance: Baker and Cousins, Nucl. Instrum. Methods 221 (1984)
    437.

    >>> from estim import Poisson, fit_curve
    >>> fit = fit_curve("r", [1.0, 3.0, 5.0], [9, 12, 9], noise=Poisson(bins=2.0))
    >>> round(fit.values["r"], 3)
    5.0
    """

    bins: ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class Binomial:
    """Successes among `trials`, a number or (n_obs,).

    y are the numbers of successes, and the curve is the probability of one, from 0 to 1.  A fit
    raises InputError where y or trials are not whole, or y exceeds the trials.

    >>> from estim import Binomial, fit_curve
    >>> fit = fit_curve("p", [1.0, 2.0, 3.0], [3, 5, 4], noise=Binomial(trials=20))
    >>> round(fit.values["p"], 3)
    0.2
    """

    trials: ArrayLike


@dataclass(frozen=True, eq=False)
class EventTimes:
    """Single events that were recorded wherever low <= x <= high.

    cells : how many figures and tests have; None: about the root of the number of events.

    x are the events (n_event,), y is None, and the curve is their density up to a factor.  A fit
    raises InputError where an event lies outside, or low is not below high.  Source: G. Cowan,
    Statistical Data Analysis (1998), chapter 6.

    >>> from estim import EventTimes, fit_curve
    >>> times = [0.1, 0.3, 0.4, 0.8, 0.9, 1.3, 1.7, 2.2, 3.1, 4.2]
    >>> fit = fit_curve("exp(-x/tau)", times, None, noise=EventTimes(0.0, 100.0))
    >>> round(fit.values["tau"], 2)  # the mean of the times
    1.5
    """

    low: float
    high: float
    cells: int | None = None


@dataclass(frozen=True, eq=False)
class LogDensity:
    """A density of one's own: the curve is the logarithm of that of each observation.

    x are the observations (n_obs,), or several columns of them, and y is None.  The density must be
    normalised over what could have been observed, whatever the parameters, or the likelihood
    prefers those that make it large; a censored observation has the probability of what is known.

    >>> import numpy as np
    >>> from estim import LogDensity, fit_curve
    >>> def waiting(t, tau):
    ...     return -np.log(tau) - t / tau
    >>> times = [0.1, 0.3, 0.4, 0.8, 0.9, 1.3, 1.7, 2.2, 3.1, 4.2]
    >>> fit = fit_curve(waiting, times, None, noise=LogDensity(), start={"tau": 1.0})
    >>> round(fit.values["tau"], 3), round(fit.sds["tau"], 3)  # the mean, and that / sqrt(10)
    (1.5, 0.474)
    """


Counting = Poisson | Binomial | EventTimes | LogDensity


@dataclass(frozen=True, eq=False)
class CountedPoints:
    """Points (n_obs,) in order of x whose y were counted.

    noise : `Events` where only their density counts; `OwnDensity` has no y.
    times : (n_event,) of single events, in order.
    """

    x: FloatArray
    y: FloatArray
    noise: Counts | OwnDensity
    times: FloatArray | None = None

    @property
    def single(self) -> bool:
        """Whether they are single events in cells."""
        return self.times is not None

    @property
    def bins(self) -> FloatArray | None:
        """(n_obs, 2) edges, or None."""
        return None if isinstance(self.noise, OwnDensity) else self.noise.bins

    @property
    def words(self) -> Wording:
        """The words for them."""
        if self.single:
            return counted_words(later("cells of events"), later("a new count"))
        if isinstance(self.noise, OwnDensity):
            return counted_words(later("observations"), later("a new observation"))
        law = self.noise.law
        return counted_words(later("bins") if self.bins is not None else law.word, law.new)

    @property
    def density(self) -> bool | None:
        """Whether the curve is y per unit of x; None where it is known up to a factor."""
        return None if self.single else self.bins is not None

    def expected(self, curve: Curve) -> Curve:
        """The curve of the expectations of y."""
        if self.bins is None:
            return curve
        low, high = self.bins.T
        if self.times is None:
            return BinnedCurve(curve, low, high)
        return BinnedCurve(curve, low, high, float(self.times.size), self.times)


def points_of_noise(
    noise: Any, x: ArrayLike, y: ArrayLike | None, *, what: str, reading_errors: Iterable[str]
) -> CountedPoints | None:
    """The points that the argument `noise` of `fit_curve` makes of x and y, None for readings.

    reading_errors : arguments that state errors of readings, which counts do not have.  Raises
        InputError.
    """
    if noise is None:
        return None
    counting = Poisson() if isinstance(noise, str) and noise == "poisson" else noise
    if not isinstance(counting, Counting):
        rule = (
            'must be "poisson", Poisson(bins=...), Binomial(trials=...), EventTimes(low, high) or '
            "LogDensity()"
        )
        raise InputError(rule, field="noise", value=noise)
    for name in reading_errors:
        rule = "cannot be combined with 'noise', which defines the scatter of counts: omit it"
        raise InputError(rule, field=name)
    return counted_points(
        counting, column(x, "x"), None if y is None else column(y, "y"), what=what
    )


def refuse_common_errors(points: CountedPoints, errors: Sequence[Component]) -> None:
    """Raises InputError for an error in common that means nothing beside a density."""
    for component in errors:
        if points.noise.own_density:
            rule = (
                "cannot be combined with a log density: include this error in the density, as a "
                "parameter with a prior"
            )
            raise InputError(rule, field="errors", value=component.kind)
        if component.kind == "zero_y" and points.bins is not None:
            raise InputError(
                "has no zero error for counts in bins: put a background into the formula",
                field=f"errors[{component.parameter_name}]",
                value=component.kind,
            )
        if component.kind == "scale_y" and points.single:
            raise InputError(
                "has no scale of y where only the density of the events counts",
                field=f"errors[{component.parameter_name}]",
                value=component.kind,
            )


def counted_points(
    noise: Counting, x: FloatArray, y: FloatArray | None, *, what: str
) -> CountedPoints:
    """The points of x and y (n_obs,) as counted.  Raises InputError naming x, y, bins, trials, low
    or high.
    """
    if isinstance(noise, EventTimes | LogDensity) and y is not None:
        rule = "must be None where x are the times of single events, or observations of a density"
        raise InputError(rule, field="y")
    if isinstance(noise, LogDensity):
        return CountedPoints(np.sort(x), np.zeros(x.size), OwnDensity(x.size))
    if isinstance(noise, EventTimes):
        low, high = real_number(noise.low, "low"), real_number(noise.high, "high")
        if noise.cells is not None and not (
            isinstance(noise.cells, int) and 2 <= noise.cells <= _MOST_CELLS
        ):
            raise InputError(
                f"must be a whole number from 2 to {_MOST_CELLS}", field="cells", value=noise.cells
            )
        return _events(x, low, high, noise.cells, what)
    if y is None:
        raise InputError("must hold the counts", field="y")
    check_lengths(x, y)
    if isinstance(noise, Poisson):
        return _poisson(x, y, noise.bins, what)
    return _binomial(x, y, noise.trials, what)


def _are_counts(y: FloatArray) -> BoolArray:
    """Which y are whole numbers from 0."""
    # 1e15: a float still distinguishes it from the next
    return (y >= 0.0) & (y <= 1e15) & (np.abs(y - np.rint(y)) <= 1e-9)


def _bin_centres(bins: FloatArray) -> FloatArray:
    """(n_obs,) of bins (n_obs, 2)."""
    return 0.5 * (bins[:, 0] + bins[:, 1])


def _poisson(x: FloatArray, y: FloatArray, bins: ArrayLike | None, what: str) -> CountedPoints:
    _require_counts(y, "the number of events, not a rate or an average")
    if not np.any(y):
        raise InputError(
            "are all 0, which no curve can be fit to: fewer than 3 events were expected in "
            "all (95 %)",
            field="y",
        )
    if bins is None:
        order = np.argsort(x, kind="stable")
        return CountedPoints(x[order], y[order], Counts(POISSON, np.ones(x.size), y[order], what))
    edges = _edges(bins, x)
    order = np.lexsort((x, edges[:, 0]))
    edges, counts = edges[order], y[order]
    # bins that overlap by less of a width share an edge
    overlap = edges[:-1, 1] - edges[1:, 0] > 1e-9 * (edges[:-1, 1] - edges[:-1, 0])
    if np.any(overlap):
        k = int(np.argmax(overlap))
        raise InputError(
            "must not overlap",
            field="bins",
            value=f"{edges[k].tolist()} and {edges[k + 1].tolist()}",
        )
    noise = Counts(POISSON, np.ones(x.size), counts, what, edges)
    return CountedPoints(_bin_centres(edges), counts, noise)


def _binomial(x: FloatArray, y: FloatArray, trials: ArrayLike, what: str) -> CountedPoints:
    _require_counts(y, "the number of successes")
    counts = finite_numbers(trials, "trials")
    try:
        size = np.array(np.broadcast_to(counts, y.shape))
    except ValueError:
        raise InputError(
            f"must be a number or have as many values as y ({y.size})", field="trials"
        ) from None
    whole, rule = _are_counts(size) & (size >= 1.0), "must be whole and at least 1"
    require_each(whole, size, rule, "trials", of_many=counts.ndim > 0)
    require_each(y <= size, y, "must not exceed the trials", "y")
    if not np.any(y) or np.all(y == size):
        none = "failures" if np.any(y) else "successes"
        raise InputError(
            f"show no {none}, so no curve can be fit to them: their probability is below "
            f"{1.0 - 0.05 ** (1.0 / float(np.sum(size))):.2g} (95 %)",
            field="y",
        )
    order = np.argsort(x, kind="stable")
    share, size = (y / size)[order], size[order]
    return CountedPoints(x[order], share, Counts(BINOMIAL, size, share, what))


def _events(
    times: FloatArray, low: float, high: float, cells: int | None, what: str
) -> CountedPoints:
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(
            "must be finite, the low end below the high one",
            field="window",
            value=f"{low:g}, {high:g}",
        )
    rule = "must lie within the window; leave out what does not"
    require_each((times >= low) & (times <= high), times, rule, "x")
    if times.size > MAX_OBS:
        raise InputError(
            f"must be at most {MAX_OBS} times: count them in bins", field="x", value=times.size
        )
    n_cell = cells or min(max(8, round(math.sqrt(times.size))), 200)
    edges = np.linspace(low, high, n_cell + 1)
    ordered = np.sort(times)
    counts = np.histogram(ordered, edges)[0].astype(float)
    bins = np.column_stack([edges[:-1], edges[1:]])
    noise = Events(POISSON, np.ones(n_cell), counts, what, bins, times=ordered, window=(low, high))
    return CountedPoints(_bin_centres(bins), counts, noise, ordered)


def _require_counts(y: FloatArray, meaning: str) -> None:
    require_each(_are_counts(y), y, f"must be a whole number from 0 ({meaning})", "y")


def _edges(bins: ArrayLike, x: FloatArray) -> FloatArray:
    """(n_obs, 2) in the order of x as it was given."""
    values = real_numbers(bins, "bins")
    if values.ndim == 0:
        width = float(values)
        if not (math.isfinite(width) and width > 0.0):
            raise InputError("must be a width > 0", field="bins", value=width)
        edges = np.column_stack([x - 0.5 * values, x + 0.5 * values])
    elif values.shape == (x.size + 1,):
        edges = np.column_stack([values[:-1], values[1:]])
    elif values.shape == (x.size, 2):
        edges = values
    else:
        raise InputError(
            f"must be a width, {x.size + 1} edges in order, or ({x.size}, 2) low and high edges",
            field="bins",
            value=values.shape,
        )
    proper = np.isfinite(edges).all(axis=1) & (edges[:, 0] < edges[:, 1])
    rule = "must have its high edge above its low one, both finite"
    require_each(proper, edges, rule, "bins")
    if np.any((x < edges[:, 0]) | (x > edges[:, 1])):
        bad = int(np.argmax((x < edges[:, 0]) | (x > edges[:, 1])))
        raise InputError(
            "must hold their x",
            field="bins",
            value=f"{x[bad]:g} in {edges[bad].tolist()}",
            index=bad,
        )
    return edges
