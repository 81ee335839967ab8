"""Linear propagation of uncertainty (GUM, JCGM 100), and how it stands beside the Monte-Carlo
method.

Use `propagate_linear` for the budget (what limits what) and where the function is nearly straight
over the inputs' uncertainties.  Use `estim.propagation.monte_carlo.propagate_monte_carlo` for the
interval that is quoted: it holds for any function and any distribution.  If it is unknown which
will do, take both and ask `estim.propagation.validation.compare` (JCGM 101, section 8).

The form of a measurement function stands at the top of `estim/propagation/evaluation.py`; how to
state an input, at the top of `estim/propagation/inputs.py`.

    inputs = [Input("V", 4.999, 0.0032, unit="V"), Input("I", 0.019661, 9.5e-6, unit="A")]
    correlation = {("V", "I"): -0.36}
    linear = propagate_linear(lambda q: q["V"] / q["I"], inputs, correlation=correlation)
    sampled = propagate_monte_carlo(
        lambda q: q["V"] / q["I"], inputs, rng=rng, correlation=correlation
    )
    validation = compare(linear, sampled)

Outputs are shaped () for a scalar function and (n_out,) for a curve or a tuple of outputs, in every
record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from estim.arrays import BoolArray, FloatArray
from estim.common import Shown, Tabled, format_rounded, phrase
from estim.distributions import student_quantile
from estim.given_numbers import check_probability
from estim.propagation.evaluation import (
    Gradient,
    MeasurementFunction,
    callable_of,
    check_size,
    gradient,
)
from estim.propagation.inputs import (
    Correlation,
    Input,
    StatedInputs,
    check_inputs,
    correlation_matrix,
)


@dataclass(frozen=True, eq=False, repr=False)
class LinearResult(Tabled):
    """First-order propagation.  Arrays are read-only; "()" below stands for () or (n_out,).

    inputs : in the order given.   correlation : (n_in, n_in).
    value, u : () output at the estimates and its standard uncertainty, in the unit of the output.
    sensitivities : (n_in,) or (n_in, n_out), c_i = dy/dx_i.
    covariance : () or (n_out, n_out), of the outputs.
    dof : () effective degrees of freedom, not truncated.
    k, low, high : () coverage factor and ends of value +/- k u, for `probability`.
    notes : sentences about what a reader must know; empty where all is well.
    """

    inputs: tuple[Input, ...]
    correlation: FloatArray
    value: FloatArray
    u: FloatArray
    sensitivities: FloatArray
    covariance: FloatArray
    dof: FloatArray
    k: FloatArray
    low: FloatArray
    high: FloatArray
    probability: float
    notes: tuple[str, ...]

    @property
    def expanded(self) -> FloatArray:
        """() expanded uncertainty k u, for `probability`."""
        return self.k * self.u

    def shown(self) -> Shown:
        """Each output with its standard and its expanded uncertainty."""
        columns = (self.value, self.u, self.dof, self.k, self.expanded)
        rows = [
            (name, *expanded_cells(*numbers))
            for name, *numbers in zip(
                output_names(self.value), *(column.reshape(-1) for column in columns), strict=True
            )
        ]
        title = phrase(
            "Linear propagation (GUM), {percent} %", percent=f"{100 * self.probability:g}"
        )
        return Shown(title, ("", *EXPANDED), rows, self.notes)

    def as_ufloat(self) -> Any:
        """The same result for the package `uncertainties`: a ufloat, or an object array (n_out,) of
        them.

        All outputs depend on one set of variables tagged with the inputs' names, so correlations
        among outputs persist in further calculations.  Every call makes new variables: outputs of
        two calls are independent of each other.
        """
        from uncertainties import correlated_values_norm

        pairs = [(quantity.value, quantity.u) for quantity in self.inputs]
        variables = correlated_values_norm(
            pairs, self.correlation, tags=[quantity.name for quantity in self.inputs]
        )
        deviations = [
            variable - quantity.value
            for variable, quantity in zip(variables, self.inputs, strict=True)
        ]
        slopes = self.sensitivities.reshape(len(self.inputs), -1)
        outputs = np.empty(self.value.size, dtype=object)
        for j, value in enumerate(self.value.reshape(-1)):
            outputs[j] = sum(
                (
                    float(c) * deviation
                    for c, deviation in zip(slopes[:, j], deviations, strict=True)
                ),
                start=float(value),
            )
        return outputs[0] if self.value.ndim == 0 else outputs


EXPANDED = ("value", "u", "dof", "k", "U = k u")


def expanded_cells(
    value: float, u: float, dof: float, k: float, expanded: float
) -> tuple[str, ...]:
    """A value and its uncertainties under the heads `EXPANDED`, all to two digits of u."""
    return (
        format_rounded(value, u),
        format_rounded(u, u, beside=value),
        f"{dof:.3g}".replace("inf", "∞"),
        f"{k:.2f}",
        format_rounded(expanded, expanded, beside=value),
    )


def output_names(value: FloatArray) -> list[str]:
    """How the outputs () or (n_out,) are called where they have no names: y, or y0, y1 ..."""
    return ["y"] if value.ndim == 0 else [f"y{i}" for i in range(value.size)]


def propagate_linear(
    function: MeasurementFunction | str,
    inputs: StatedInputs,
    *,
    correlation: Correlation | None = None,
    probability: float = 0.95,
) -> LinearResult:
    """Value, uncertainty and coverage interval to first order, with exact first derivatives (see
    `estim.propagation.evaluation.gradient`).

    u^2(y) = sum_ij c_i c_j r_ij u_i u_j (GUM eq. 16);   covariance of several outputs C U C^T (GUM
    H.2.3, JCGM 102, 6.2) 1/dof = sum_g [u_g(y)/u(y)]^4/dof_g (Welch-Satterthwaite, GUM eq. G.2b);
    k = t quantile at (1 + probability)/2

    The terms g of the last sum are uncorrelated inputs and groups of inputs correlated with one
    another: a group measured together, with one dof, counts as one component (Willink 2007,
    Metrologia 44, 340).  The equation has no meaning for a group with different dof; then the
    smallest is taken and a note says so.  k is taken at the fractional dof; GUM G.4.1 rounds down
    to use a table.

    function : or a formula in text, "4*pi**2*L/T**2".
    inputs : in a row, or name -> what is stated, {"L": "0.85(1) m", "T": [1.84, 1.86, 1.85]}: a
        quantity in text, an exact number, readings, or an Input.
    correlation : of the inputs; None, a matrix (n_in, n_in), or pairs {("V", "I"): -0.36}.
    probability : of the coverage interval.  Raises InputError for inputs, a correlation or a
        function that break a rule.  A derivative that does not exist is NaN and a note.

    >>> from estim import propagate_linear
    >>> print(propagate_linear("4*pi**2*L/T**2", {"L": "0.850(1) m", "T": "1.851(3) s"}))
    Linear propagation (GUM), 95 %
         value  u      dof  k     U = k u
      y  9.794  0.034  ∞    1.96  0.066
    """
    checked = check_inputs(inputs)
    matrix = correlation_matrix(checked, correlation)
    check_probability(probability)
    slopes = gradient(callable_of(function, checked), checked)
    shape = slopes.value.shape
    components = uncertainty_components(checked, slopes.derivative)
    check_size(slopes.value, components)
    covariance = components.T @ matrix @ components
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    dof, dof_notes = _effective_dof(checked, matrix, components, u)
    k = student_quantile(0.5 * (1.0 + probability), dof)
    return LinearResult(
        inputs=checked,
        correlation=matrix,
        value=slopes.value,
        u=frozen(u, shape),
        sensitivities=slopes.derivative,
        covariance=frozen(covariance, shape + shape),
        dof=frozen(dof, shape),
        k=frozen(k, shape),
        low=frozen(slopes.value - (k * u).reshape(shape)),
        high=frozen(slopes.value + (k * u).reshape(shape)),
        probability=probability,
        notes=(*_derivative_notes(checked, slopes, components, u), *dof_notes),
    )


def uncertainty_components(inputs: Sequence[Input], sensitivities: FloatArray) -> FloatArray:
    """c_i u_i with its sign, (n_in, n_out), n_out = 1 for a scalar output; 0 for a constant,
    whatever its derivative.
    """
    u_in = np.array([quantity.u for quantity in inputs])[:, np.newaxis]
    return np.where(u_in == 0.0, 0.0, sensitivities.reshape(len(inputs), -1) * u_in)


def frozen(array: Any, shape: tuple[int, ...] | None = None) -> NDArray[Any]:
    """A read-only array of its own with the values of `array`, in another shape if one is given."""
    copy = np.array(array) if shape is None else np.array(array).reshape(shape)
    copy.flags.writeable = False
    return copy


def how_many(affected: BoolArray, *, scalar: bool) -> str:
    """Text for the outputs concerned: empty for a scalar output, else "at 3 of 20 outputs: "."""
    return (
        ""
        if scalar or affected.size == 1
        else phrase("at {k} of {n} outputs: ", k=np.count_nonzero(affected), n=affected.size)
    )


def _effective_dof(
    inputs: Sequence[Input], matrix: FloatArray, components: FloatArray, u: FloatArray
) -> tuple[FloatArray, list[str]]:
    """Effective degrees of freedom, (n_out,), and notes about them."""
    reciprocal, notes = np.zeros_like(u), []
    for group in _correlated_groups(matrix):
        all_dof = {inputs[i].dof_of_u for i in group}
        dof = min(all_dof)
        if len(all_dof) > 1:
            names = ", ".join(inputs[i].name for i in group)
            notes.append(
                phrase(
                    "{names} are correlated but have different degrees of freedom: the "
                    "smallest, {dof:g}, is used for all of them",
                    names=names,
                    dof=dof,
                )
            )
        if math.isfinite(dof):
            part = components[group]
            u_group = np.sqrt(
                np.maximum(np.sum(part * (matrix[np.ix_(group, group)] @ part), axis=0), 0.0)
            )
            reciprocal += np.divide(u_group, u, out=np.zeros_like(u), where=u != 0.0) ** 4 / dof
    with np.errstate(divide="ignore"):
        return 1.0 / reciprocal, notes


def _correlated_groups(matrix: FloatArray) -> list[list[int]]:
    """The inputs in groups that are correlated, directly or through others."""
    n, labels = connected_components(matrix != 0.0, directed=False)
    return [np.flatnonzero(labels == k).tolist() for k in range(n)]


def _derivative_notes(
    inputs: Sequence[Input], slopes: Gradient, components: FloatArray, u: FloatArray
) -> list[str]:
    """Sentences about values and derivatives that cannot be relied on."""
    scalar = slopes.value.ndim == 0
    undefined = ~np.isfinite(slopes.value.reshape(-1))
    notes = (
        [
            how_many(undefined, scalar=scalar)
            + phrase("the function has no finite value at the estimates")
        ]
        if undefined.any()
        else []
    )
    for quantity, component, error, kink in zip(
        inputs,
        components,
        slopes.error.reshape(len(inputs), -1),
        slopes.kink.reshape(len(inputs), -1),
        strict=True,
    ):
        if quantity.u == 0.0:
            continue
        missing = ~np.isfinite(component) & ~undefined
        # numerical error of a derivative times u(x), as a part of u(y), from which on it is
        # reported
        rough = ~missing & ~undefined & (u > 0.0) & (error * quantity.u > 1e-3 * u)
        # difference of the slopes to the two sides times u(x), as a part of u(y), from which on it
        # is reported; u(y) may be rounding errors, where correlated inputs cancel
        least = np.maximum(0.05 * u, 1e-6 * np.abs(component))
        bent = ~missing & ~undefined & (~np.isfinite(kink) | (np.abs(kink) * quantity.u > least))
        for affected, text in (
            (
                missing,
                phrase(
                    "there is no derivative with respect to '{name}': the function jumps, or is "
                    "undefined, next to the estimate, so u is unknown",
                    name=quantity.name,
                ),
            ),
            (
                bent,
                phrase(
                    "the slope with respect to '{name}' differs on the two sides of the "
                    "estimate: u is computed from their mean",
                    name=quantity.name,
                ),
            ),
            (
                rough & ~bent,
                phrase(
                    "the derivative with respect to '{name}' is known only to a relative "
                    "accuracy of {share:.1g}",
                    name=quantity.name,
                    share=_worst(error, component, quantity.u),
                ),
            ),
        ):
            if affected.any():
                notes.append(how_many(affected, scalar=scalar) + text)
    flat = (u == 0.0) & ~undefined & ~np.any(components, axis=0)
    if flat.any() and any(quantity.u > 0.0 for quantity in inputs):
        notes.append(
            how_many(flat, scalar=scalar)
            + phrase(
                "all first derivatives vanish, so the linear uncertainty of 0 is "
                "meaningless: use Monte Carlo"
            )
        )
    return notes


def _worst(error: FloatArray, component: FloatArray, u: float) -> float:
    """Largest relative error of a derivative over the outputs where it is not 0."""
    known = np.isfinite(component) & (component != 0.0)
    return float(np.max(error[known] * u / np.abs(component[known]), initial=0.0))
