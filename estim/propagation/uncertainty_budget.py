"""What limits a result: the uncertainty budget of a linear propagation.

Use `budget` for a number and `budget_along` for a curve.  A share is a part of the variance, so an
input with a share of 1 % still contributes 10 % of u; and the shares describe the straight-line
approximation, so look at `estim.propagation.validation.compare` first.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, positive_or
from estim.common import InputError, Shown, Tabled, percentage, phrase, signed, significant
from estim.given_numbers import real_numbers
from estim.propagation.inputs import Input
from estim.propagation.linear import (
    EXPANDED,
    LinearResult,
    expanded_cells,
    frozen,
    uncertainty_components,
)


@dataclass(frozen=True, eq=False)
class BudgetRow:
    """One input's part.

    sensitivity : c = dy/dx.
    contribution : |c| u(x) in the unit of the output.   share : 100 c^2 u^2(x)/u^2(y) in %.
    """

    input: Input
    sensitivity: float
    contribution: float
    share: float


@dataclass(frozen=True, eq=False)
class CorrelationRow:
    """A correlated pair's part: share 200 c_i c_j r u_i u_j/u^2(y) in %, negative where the
    correlation helps.
    """

    names: tuple[str, str]
    correlation: float
    share: float


@dataclass(frozen=True, eq=False, repr=False)
class Budget(Tabled):
    """Uncertainty budget of one output.

    value, u, dof, k, low, high, probability : as in `LinearResult`.
    rows : one an input, largest share first (equal ones in the order given).
    pairs : correlated pairs, largest |share| first.
    correlation_share : the sum over `pairs`, in %.  The shares of `rows` and this one add up to
        100; without u they are all NaN.
    """

    value: float
    u: float
    dof: float
    k: float
    low: float
    high: float
    probability: float
    rows: tuple[BudgetRow, ...]
    pairs: tuple[CorrelationRow, ...]
    correlation_share: float
    notes: tuple[str, ...]

    @property
    def expanded(self) -> float:
        """Expanded uncertainty k u, for `probability`."""
        return self.k * self.u

    def shown(self) -> Shown:
        """Inputs with their sensitivities, contributions and shares, the largest first."""
        cells = expanded_cells(self.value, self.u, self.dof, self.k, self.expanded)
        head = (phrase("input"), phrase("value"), "u", "c", "|c| u", phrase("share"))
        rows = [
            (
                row.input.name,
                signed(f"{row.input.value:.10g}"),
                *(significant(n, 3) for n in (row.input.u, row.sensitivity, row.contribution)),
                percentage(row.share / 100.0),
            )
            for row in self.rows
        ] + [
            (
                f"r({', '.join(p.names)})",
                signed(f"{p.correlation:.4g}"),
                "",
                "",
                "",
                percentage(p.share / 100.0),
            )
            for p in self.pairs
        ]
        title = ", ".join(f"{name}: {cell}" for name, cell in zip(EXPANDED, cells, strict=True))
        return Shown(title, head, rows, self.notes)


def budget(linear: LinearResult, *, output: int | None = None) -> Budget:
    """Uncertainty budget of a scalar result, or of output number `output` of a curve.  Source: GUM
    5.1.3, H.1 table H.1.

    Raises InputError if `output` is missing for a curve, given for a scalar, or out of range.

    >>> from estim import budget, propagate_linear
    >>> linear = propagate_linear("4*pi**2*L/T**2", {"L": "0.850(1) m", "T": "1.851(3) s"})
    >>> print(budget(linear))
    value: 9.794, u: 0.034, dof: ∞, k: 1.96, U = k u: 0.066
      input  value  u        c      |c| u   share
      T      1.851  0.00300  −10.6  0.0317  88 %
      L      0.85   0.00100  11.5   0.0115  12 %
    """
    n_out = linear.value.size
    if linear.value.ndim == 0 and output is not None:
        raise InputError("must be left out for a scalar result", field="output", value=output)
    if linear.value.ndim == 1 and (
        isinstance(output, bool)
        or not isinstance(output, (int, np.integer))
        or not 0 <= output < n_out
    ):
        raise InputError(
            f"must number one of the outputs 0 to {n_out - 1} (or use budget_along)",
            field="output",
            value=output,
        )
    at = output or 0
    components = uncertainty_components(linear.inputs, linear.sensitivities)[:, at]
    u = float(linear.u.reshape(-1)[at])
    relative = components / u if u > 0.0 else np.full_like(components, np.nan)
    rows = [
        BudgetRow(quantity, float(c), float(abs(component)), float(100.0 * part**2))
        for quantity, c, component, part in zip(
            linear.inputs,
            linear.sensitivities.reshape(len(components), -1)[:, at],
            components,
            relative,
            strict=True,
        )
    ]
    pairs = [
        CorrelationRow(
            (linear.inputs[i].name, linear.inputs[j].name),
            float(linear.correlation[i, j]),
            float(200.0 * linear.correlation[i, j] * relative[i] * relative[j]),
        )
        for i, j in combinations(range(len(components)), 2)
        if linear.correlation[i, j] != 0.0
    ]
    value, dof, k, low, high = (
        float(array.reshape(-1)[at])
        for array in (linear.value, linear.dof, linear.k, linear.low, linear.high)
    )
    return Budget(
        value=value,
        u=u,
        dof=dof,
        k=k,
        low=low,
        high=high,
        probability=linear.probability,
        rows=tuple(sorted(rows, key=lambda row: -row.share)),
        pairs=tuple(sorted(pairs, key=lambda pair: -abs(pair.share))),
        correlation_share=float(sum(pair.share for pair in pairs)),
        notes=linear.notes,
    )


@dataclass(frozen=True, eq=False)
class Stretch:
    """From abscissa `start` to `stop`, both included, the input `name` has the largest share; ""
    where u is 0 or unknown.
    """

    start: float
    stop: float
    name: str


@dataclass(frozen=True, eq=False)
class BudgetAlong:
    """Uncertainty budget along a curve.

    x : (n_out,).   names : of the inputs, in the order given.   u : (n_out,) of the curve.
    contributions : (n_in, n_out) |c_i| u_i.
    shares : (n_in, n_out) in %.   correlation_share : (n_out,) in %, what is missing to 100.
    dominating : (n_out,) names of the inputs of largest share (the first in the order given if
        equal); "" where u is 0 or unknown.
    stretches : runs of neighbouring x with one dominating input, in the order of x.
    """

    x: FloatArray
    names: tuple[str, ...]
    u: FloatArray
    contributions: FloatArray
    shares: FloatArray
    correlation_share: FloatArray
    dominating: tuple[str, ...]
    stretches: tuple[Stretch, ...]


def budget_along(linear: LinearResult, x: ArrayLike) -> BudgetAlong:
    """Share of each input at every point of a curve, and which one dominates where.

    linear : a propagation to many outputs, (n_out,).
    x : (n_out,) abscissas of the outputs, in any unit, increasing or not.
    Raises InputError for a scalar result or an `x` that does not fit.

    >>> import numpy as np
    >>> from estim import Input, budget_along, propagate_linear
    >>> t = np.array([1.0, 3.0, 4.0])
    >>> inputs = [Input("v", 2.0, 0.1), Input("a", 1.0, 0.1)]
    >>> linear = propagate_linear(lambda p: p["v"] * t + p["a"] * t**2 / 2, inputs)
    >>> budget_along(linear, t).dominating
    ('v', 'a', 'a')
    """
    if linear.value.ndim == 0:
        raise InputError(
            "must be a curve (use budget for a number)", field="linear", value=linear.value.shape
        )
    abscissa = frozen(real_numbers(x, "x"))
    if abscissa.shape != linear.value.shape:
        raise InputError(f"must be shaped {linear.value.shape}", field="x", value=abscissa.shape)
    names = tuple(quantity.name for quantity in linear.inputs)
    components = uncertainty_components(linear.inputs, linear.sensitivities)
    relative = components / positive_or(linear.u, np.nan)
    shares = 100.0 * relative**2
    known = np.isfinite(shares).all(axis=0)
    indices = np.atleast_1d(np.argmax(np.where(known, shares, 0.0), axis=0)).tolist()
    dominating = tuple(
        names[i] if good else ""
        for i, good in zip(indices, np.atleast_1d(known).tolist(), strict=True)
    )
    off_diagonal = linear.correlation - np.eye(len(names))
    return BudgetAlong(
        x=abscissa,
        names=names,
        u=linear.u,
        contributions=frozen(np.abs(components)),
        shares=frozen(shares),
        correlation_share=frozen(100.0 * np.sum(relative * (off_diagonal @ relative), axis=0)),
        dominating=dominating,
        stretches=_stretches(abscissa, dominating),
    )


def _stretches(x: FloatArray, dominating: tuple[str, ...]) -> tuple[Stretch, ...]:
    order = np.argsort(x, kind="stable")
    stretches: list[Stretch] = []
    for i in order:
        at, name = float(x[i]), dominating[i]
        if stretches and stretches[-1].name == name:
            stretches[-1] = Stretch(stretches[-1].start, at, name)
        else:
            stretches.append(Stretch(at, at, name))
    return tuple(stretches)
