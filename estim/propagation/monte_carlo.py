"""Propagation of distributions by Monte Carlo (JCGM 101): mean, standard deviation and coverage
intervals, with their own errors.

Which interval to quote: the symmetric one (equal tails) is steadier and follows a change of scale;
the shortest one contains the most probable values and is the one to take where the distribution
leans against a limit.  They agree for a symmetric distribution.  If it is unknown, quote the
symmetric one and look at the other.

Where the tails are so long that no standard deviation exists (1/a with a near 0), u is NaN however
many draws are made, and a note says so: intervals exist all the same.

The draws themselves are kept (`MonteCarloResult.draws`); every other number is a view of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.common import (
    Shown,
    Tabled,
    format_rounded,
    interval,
    later,
    per_cent,
    phrase,
    require_one_of,
)
from estim.given_numbers import check_probability, check_whole, random_generator
from estim.propagation.copula import copula_matrix, draw_inputs
from estim.propagation.evaluation import (
    MeasurementFunction,
    callable_of,
    check_draws,
    evaluate_draws,
    evaluate_point,
)
from estim.propagation.inputs import (
    Correlation,
    Input,
    StatedInputs,
    check_inputs,
    correlation_matrix,
)
from estim.propagation.linear import frozen, how_many, output_names
from estim.propagation.tail_index import NO_MEAN, NO_VARIANCE, tail_index

IntervalKind = Literal["symmetric", "shortest"]
BatchProgress = Callable[[int, int], None]

_LEAST_BLOCKS = 10
MOST_VALUES = 20_000_000  # of n_draw * n_out by default: 160 MB
_STATISTICS = (
    later("mean"),
    "u",
    later("symmetric low"),
    later("symmetric high"),
    later("shortest low"),
    later("shortest high"),
)
_WATCHED: dict[str, list[int]] = {"symmetric": [0, 1, 2, 3], "shortest": [0, 1, 4, 5]}


@dataclass(frozen=True, eq=False)
class Interval:
    """A coverage interval, fields () or (n_out,) in the unit of the output; the errors are
    Monte-Carlo standard errors.
    """

    low: FloatArray
    high: FloatArray
    low_error: FloatArray
    high_error: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloResult(Tabled):
    """Propagation of distributions.  Arrays are read-only; "()" below stands for () or (n_out,).

    inputs, correlation : as for `LinearResult`.
    draws : (n_draw,) or (n_draw, n_out) outputs, as the function returned them.
    n_block : blocks they were drawn in.
    mean, u : () mean and standard deviation of the draws; NaN where the tails say that none exists.
    mean_error, u_error : () their Monte-Carlo standard errors.
    symmetric, shortest : coverage intervals for `probability`, with equal tails and of least
        length.
    undefined : () fraction of the draws for which the function has no finite value.  Where it is
        above 0 the statistics are NaN, for they could only be conditional on the function being
        defined; `where_defined` gives those.
    conditional : True for what `where_defined` returned.
    tolerance : () numerical tolerance delta for `n_digits` digits of u (JCGM 101, 7.9.2).
    tail_index : () Hill's estimate of 1/alpha where the distribution falls off as |y|^-alpha: no
        standard deviation from 1/2 on, no mean from 1 on.
    stabilised : whether twice the standard errors of mean, u and both ends of the `watched`
        interval are within `tolerance` for all outputs.
    notes : sentences about what a reader must know; empty where all is well.
    """

    inputs: tuple[Input, ...]
    correlation: FloatArray
    draws: FloatArray
    n_block: int
    mean: FloatArray
    u: FloatArray
    mean_error: FloatArray
    u_error: FloatArray
    symmetric: Interval
    shortest: Interval
    probability: float
    undefined: FloatArray
    conditional: bool
    tail_index: FloatArray
    tolerance: FloatArray
    n_digits: int
    watched: IntervalKind
    stabilised: bool
    notes: tuple[str, ...]

    @property
    def n_draw(self) -> int:
        """Number of draws, those without a value included."""
        return len(self.draws)

    def shown(self) -> Shown:
        """Each output with its standard uncertainty and both its intervals."""
        ends = (self.symmetric, self.shortest)
        columns = (self.mean, self.u, *(a for end in ends for a in (end.low, end.high)))
        rows = []
        for name, mean, u, *bounds in zip(
            output_names(self.mean), *(column.reshape(-1) for column in columns), strict=True
        ):
            size = u if math.isfinite(u) else 0.25 * (bounds[1] - bounds[0])
            cells = (interval(pair[0], pair[1], size, 2) for pair in (bounds[:2], bounds[2:]))
            rows.append(
                (name, format_rounded(mean, size), format_rounded(u, u, beside=mean), *cells)
            )
        title = phrase("Monte Carlo (JCGM 101), {n} draws", n=self.n_draw)
        percent = per_cent(self.probability)
        heads = (f"{percent}, {phrase(word)}" for word in ("symmetric", "shortest"))
        return Shown(title, ("", phrase("mean"), "u", *heads), rows, self.notes)

    def covariance(self) -> FloatArray:
        """Covariance of the outputs over the draws, () or (n_out, n_out); NaN where some draws
        leave one undefined or u does not exist.
        """
        return frozen(
            np.cov(
                np.where(
                    np.isfinite(self.draws) & ~(self.tail_index > NO_VARIANCE), self.draws, np.nan
                ),
                rowvar=False,
            )
        )

    def where_defined(self) -> MonteCarloResult:
        """The same statistics of the draws that have a value, output by output: conditional on the
        function being defined.
        """
        blocks = np.array(
            [
                _block_statistics(block, self.probability)
                for block in np.array_split(self.draws, self.n_block)
            ]
        )
        return _result(
            self.inputs,
            self.correlation,
            self.draws,
            blocks,
            self.probability,
            self.n_digits,
            self.watched,
            conditional=True,
        )


def propagate_monte_carlo(
    function: MeasurementFunction | str,
    inputs: StatedInputs,
    *,
    rng: np.random.Generator | int,
    n_draw: int | None = None,
    correlation: Correlation | None = None,
    probability: float = 0.95,
    n_digits: int = 2,
    watched: IntervalKind = "symmetric",
    max_draw: int | None = None,
    progress: BatchProgress | None = None,
) -> MonteCarloResult:
    """Mean, standard deviation and coverage intervals of the output's distribution (JCGM 101,
    section 7), and the draws.

    With `n_draw` that many draws are made.  Without it blocks of max(ceil(100/(1 - probability)),
    10^4) draws are added until the result has stabilised to `n_digits` digits of u (JCGM 101,
    7.9.4): over the h blocks, twice s/sqrt(h), s the standard deviation of the block values, is
    within delta for the mean, u and both ends of the `watched` interval, for every output.  Unlike
    there, h >= 10: the spread of two blocks is often small by chance.  After `max_draw` draws
    (default 10^7, for a curve at most 2e7/n_out) it ends and says "not stabilised"; where these are
    less than ten blocks, the blocks are smaller.

    function, inputs : as for `propagate_linear`.
    progress : called as progress(draws made, most draws) after each block.
    Raises InputError for inputs, a correlation, choices or a function that break a rule.

    >>> import numpy as np
    >>> from estim import propagate_monte_carlo
    >>> inputs = {"L": "0.850(1) m", "T": "1.851(3) s"}
    >>> drawn = propagate_monte_carlo("4*pi**2*L/T**2", inputs, rng=np.random.default_rng(1))
    >>> print(drawn)
    Monte Carlo (JCGM 101), 110000 draws
         mean   u      95 %, symmetric  95 %, shortest
      y  9.794  0.034  [9.728, 9.861]   [9.729, 9.862]
    """
    checked, rng = check_inputs(inputs), random_generator(rng)
    function = callable_of(function, checked)
    matrix = correlation_matrix(checked, correlation)
    check_probability(probability)
    _check_choices(n_draw, max_draw, n_digits, watched, probability)
    copula = copula_matrix(checked, matrix)
    value = evaluate_point(function, {quantity.name: quantity.value for quantity in checked})
    n_out = None if value.ndim == 0 else value.size
    sizes = _block_sizes(
        n_draw, max_draw or min(10_000_000, MOST_VALUES // value.size), probability
    )
    outputs: list[FloatArray] = []
    blocks: list[FloatArray] = []
    for size in sizes:
        outputs.append(
            evaluate_draws(
                function, draw_inputs(checked, copula, rng=rng, n_draw=size), n_out=n_out
            )
        )
        check_draws(value, outputs[-1])
        blocks.append(_block_statistics(outputs[-1], probability))
        if progress is not None:
            progress(sum(map(len, outputs)), sum(sizes))
        if (
            n_draw is None
            and len(blocks) >= _LEAST_BLOCKS
            and np.all(_stabilised(np.array(blocks), n_digits, watched))
        ):
            break
    draws = np.concatenate(outputs)
    draws.flags.writeable = False
    return _result(
        checked, matrix, draws, np.array(blocks), probability, n_digits, watched, conditional=False
    )


def numerical_tolerance(u: FloatArray, n_digits: int) -> FloatArray:
    """delta = 10^l/2 where u = c 10^l and c is an integer of `n_digits` digits (JCGM 101, 7.9.2); 0
    for u = 0.  Shape of `u`.
    """
    u = np.asarray(u, dtype=float)
    positive = np.where(np.isfinite(u) & (u > 0.0), u, 1.0)
    exponent = np.floor(np.log10(positive)) - (n_digits - 1)
    # 0.0996 has the two digits 0.10
    exponent += np.round(positive / 10.0**exponent) >= 10.0**n_digits
    return np.where(np.isfinite(u), np.where(u > 0.0, 0.5 * 10.0**exponent, 0.0), np.nan)


def coverage_interval(
    ordered: FloatArray, probability: float, kind: IntervalKind
) -> tuple[float, float]:
    """Ends of the coverage interval from draws in increasing order, (n_draw,): JCGM 101, 7.7.2
    (symmetric), 7.7.4 (shortest).
    """
    n_draw = ordered.size
    n_inside = min(int(probability * n_draw + 0.5), n_draw - 1)
    if kind == "symmetric":
        start = (n_draw - n_inside + 1) // 2 - 1
    else:
        start = int(np.argmin(ordered[n_inside:] - ordered[: n_draw - n_inside]))
    return float(ordered[start]), float(ordered[start + n_inside])


def _block_sizes(n_draw: int | None, most: int, probability: float) -> list[int]:
    """Draws in each block: the size of JCGM 101, 7.9.4 b, or less where ten such blocks are too
    many.
    """
    # JCGM 101, 7.9.4 b
    standard = max(_draws_for(probability), 10_000)
    total = n_draw or most
    n_block = max(total // standard, _LEAST_BLOCKS)
    larger = total % n_block
    return [total // n_block + 1] * larger + [total // n_block] * (n_block - larger)


def _draws_for(probability: float) -> int:
    return math.ceil(100.0 / (1.0 - probability) - 1e-6)  # 1 - 0.99 is a little below 0.01


def _block_statistics(draws: FloatArray, probability: float) -> FloatArray:
    """Number of finite draws and the six `_STATISTICS` of them, output by output: (n_draw,) or
    (n_draw, n_out) -> (7, n_out).
    """
    table = np.full((1 + len(_STATISTICS), 1 if draws.ndim == 1 else draws.shape[1]), np.nan)
    for j, column in enumerate(draws.reshape(len(draws), -1).T):
        ordered = np.sort(column[np.isfinite(column)])
        table[0, j] = ordered.size
        if ordered.size > 1:
            # a sum over equal numbers would leave a rounding error as u
            constant = ordered[0] == ordered[-1]
            mean, u = (ordered[0], 0.0) if constant else (ordered.mean(), ordered.std(ddof=1))
            symmetric, shortest = (
                coverage_interval(ordered, probability, kind) for kind in get_args(IntervalKind)
            )
            table[1:, j] = mean, u, *symmetric, *shortest
    return table


def _standard_errors(blocks: FloatArray) -> FloatArray:
    """s/sqrt(h) over the blocks for each statistic: (n_block, 7, n_out) -> (6, n_out)."""
    # rounding would leave a standard deviation
    constant = blocks[:, 1:].max(axis=0) == blocks[:, 1:].min(axis=0)
    return np.where(constant, 0.0, blocks[:, 1:].std(axis=0, ddof=1) / math.sqrt(len(blocks)))


def _stabilised(blocks: FloatArray, n_digits: int, watched: IntervalKind) -> BoolArray:
    """Whether each output has stabilised (JCGM 101, 7.9.4 g-k): (n_block, 7, n_out) -> (n_out,)."""
    count, mean, u = blocks[:, 0], blocks[:, 1], blocks[:, 2]
    total = count.sum(axis=0)
    between = np.sum(count * (mean - np.sum(count * mean, axis=0) / total) ** 2, axis=0)
    pooled = np.sqrt((np.sum((count - 1.0) * u**2, axis=0) + between) / (total - 1.0))
    errors = _standard_errors(blocks)[_WATCHED[watched]]
    return np.all(2.0 * errors <= numerical_tolerance(pooled, n_digits), axis=0)


def _result(
    inputs: tuple[Input, ...],
    correlation: FloatArray,
    draws: FloatArray,
    blocks: FloatArray,
    probability: float,
    n_digits: int,
    watched: IntervalKind,
    *,
    conditional: bool,
) -> MonteCarloResult:
    shape = draws.shape[1:]
    total = _block_statistics(draws, probability)
    undefined = (len(draws) - total[0]) / len(draws)
    partial = (undefined > 0.0) & (not conditional)
    statistics = np.where(partial, np.nan, total[1:])
    errors = np.where(partial, np.nan, _standard_errors(blocks))
    tails = np.atleast_1d(tail_index(draws))
    for row, limit in ((_STATISTICS.index("mean"), NO_MEAN), (_STATISTICS.index("u"), NO_VARIANCE)):
        statistics[row, tails > limit] = errors[row, tails > limit] = np.nan
    tolerance = numerical_tolerance(statistics[1], n_digits)
    stable = np.all(2.0 * errors[_WATCHED[watched]] <= tolerance, axis=0)
    values = [frozen(row, shape) for row in statistics]
    spreads = [frozen(row, shape) for row in errors]
    notes = _undefined_notes(undefined, conditional, scalar=not shape)
    endless = (tails > NO_VARIANCE) & ~partial
    if endless.any():
        notes.append(
            how_many(endless, scalar=not shape)
            + phrase(
                "the tails are so heavy (index {index:.2g}; a standard deviation exists "
                "below 0.5, a mean below 1) that there is no "
                "standard deviation: more draws do not help, quote an interval",
                index=tails.max(),
            )
        )
    if not stable[(undefined == 0.0) & ~endless].all() or (conditional and not stable.all()):
        notes.append(
            _unstable_note(
                errors, tolerance, stable, len(draws), n_digits, watched, scalar=not shape
            )
        )
    return MonteCarloResult(
        inputs=inputs,
        correlation=correlation,
        draws=draws,
        n_block=len(blocks),
        mean=values[0],
        u=values[1],
        mean_error=spreads[0],
        u_error=spreads[1],
        symmetric=Interval(values[2], values[3], spreads[2], spreads[3]),
        shortest=Interval(values[4], values[5], spreads[4], spreads[5]),
        probability=probability,
        undefined=frozen(undefined, shape),
        conditional=conditional,
        tail_index=frozen(tails, shape),
        tolerance=frozen(tolerance, shape),
        n_digits=n_digits,
        watched=watched,
        stabilised=bool(stable.all()),
        notes=(*notes, *_input_notes(inputs)),
    )


def _undefined_notes(undefined: FloatArray, conditional: bool, *, scalar: bool) -> list[str]:
    affected = undefined > 0.0
    if not affected.any():
        return []
    consequence = (
        phrase("the statistics are conditional on the function being defined")
        if conditional
        else phrase(
            "no mean, u or interval is given there; state a distribution of the inputs for "
            "which it has one everywhere, as lognormal of a positive quantity (distribution in "
            "a file of the model; in Python, where_defined leaves these draws out)"
        )
    )
    values = {"share": 100.0 * undefined.max(), "consequence": consequence}
    if scalar:
        return [phrase("{share:.3g} % of the draws give no finite value: {consequence}", **values)]
    return [
        how_many(affected, scalar=scalar)
        + phrase("up to {share:.3g} % of the draws give no finite value: {consequence}", **values)
    ]


def _unstable_note(
    errors: FloatArray,
    tolerance: FloatArray,
    stable: BoolArray,
    n_draw: int,
    n_digits: int,
    watched: IntervalKind,
    *,
    scalar: bool,
) -> str:
    unstable = ~stable & np.isfinite(tolerance)
    if not unstable.any():
        return how_many(~stable, scalar=scalar) + phrase(
            "not stabilised: too few draws have a finite value"
        )
    rows = _WATCHED[watched]
    ratio = np.where(unstable, errors[rows] / np.maximum(tolerance, np.finfo(float).tiny), -1.0)
    row, output = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    error = 2.0 * errors[rows[int(row)], output]
    return how_many(unstable, scalar=scalar) + phrase(
        "not stabilised to {digits} digits of u after {n} draws: twice the standard error "
        "of {what} is {error:.2g}, while the tolerance "
        "is {tolerance:.2g}",
        digits=n_digits,
        n=n_draw,
        what=phrase(_STATISTICS[rows[int(row)]]),
        error=error,
        tolerance=tolerance[output],
    )


def _input_notes(inputs: Sequence[Input]) -> list[str]:
    notes = []
    for quantity in inputs:
        if quantity.u == 0.0:
            continue
        if math.isinf(quantity.standard_deviation):
            notes.append(
                phrase(
                    "'{name}' (t, dof {dof:g}) has no standard deviation: mean and u may "
                    "not converge, so quote intervals only",
                    name=quantity.name,
                    dof=quantity.drawn_dof,
                )
            )
        if quantity.distribution not in ("t", "standardised-t") and math.isfinite(quantity.dof):
            notes.append(
                phrase(
                    "'{name}' is drawn from a {distribution} distribution: its {dof:g} "
                    "degrees of freedom are not used",
                    name=quantity.name,
                    distribution=quantity.distribution,
                    dof=quantity.dof,
                )
            )
    return notes


def _check_choices(
    n_draw: object, max_draw: object, n_digits: object, watched: object, probability: float
) -> None:
    least = _draws_for(probability)
    for field, count in (("n_draw", n_draw), ("max_draw", max_draw)):
        if count is not None:
            check_whole(count, field, least)
    check_whole(n_digits, "n_digits", 1)
    require_one_of(watched, get_args(IntervalKind), field="watched")
