"""Quantities that enter an uncertainty propagation: their distributions, their correlations, and draws from them.

Which distribution to choose (GUM 4.3, JCGM 101 section 6):

- ``normal``       a calibration certificate or a fit: value and standard uncertainty.  The default.
- ``t``            the mean of a few readings (`Input.from_readings`): u = s/sqrt(n), dof = n - 1.
- ``standardised-t``  Student's t whose standard deviation, not its scale, is u (NIST TN 1900 states it so); dof > 2.
- ``rectangular``  only limits are known (a digital display, a tolerance, a rounding): u = half width/sqrt(3).
- ``triangular``   limits, with the middle more likely (a sum of two equal roundings): u = half width/sqrt(6).
- ``arcsine``      a quantity that oscillates between limits (room temperature, vibration): u = half width/sqrt(2).
- ``trapezoidal``  limits, with a plateau in the middle (a sum of two unequal roundings); `shape` is the width of the plateau / that of the base.
- ``curvilinear-trapezoidal``  limits that are themselves known only so well; `shape` is the error of the half width / half width (JCGM 101, 6.4.3).
- ``exponential``  not negative, and only the mean is known (value = u, JCGM 101, 6.4.10); with another u it begins at value - u.
- ``lognormal``, ``gamma``  a positive quantity, given by its mean and standard deviation.

If it is unknown, take limits you would bet on and ``rectangular`` (`Input.from_half_width`).

For ``t`` the field `u` is the scale s/sqrt(n), as in the GUM, and not the standard deviation of the distribution, which is
larger: u sqrt(dof/(dof - 2)), infinite for dof <= 2 (JCGM 101, 6.4.9).  So the Monte-Carlo u exceeds the linear one for few
readings, while the linear method pays for the same ignorance with a larger coverage factor.

Correlations are linear (Pearson) correlation coefficients of the quantities themselves, as in GUM 5.2.  Draws of correlated
quantities come from a normal copula whose parameters are chosen so that these coefficients are met exactly, whatever the
marginal distributions (Cario and Nelson 1997, "Modeling and generating random vectors with arbitrary marginal distributions
and correlation matrix").
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError
from estim.propagation.scores import BOUNDED, POSITIVE, SHAPED, SYMMETRIC, Distribution, half_width_in_u, score
from estim.propagation.skewed import skewed_coefficient

Correlation = Mapping[tuple[str, str], float] | ArrayLike

_PSD_TOLERANCE = 1e-9  # smallest eigenvalue that still counts as zero


@dataclass(frozen=True, eq=False)
class Input:
    """One input quantity of a measurement function.

    name : how the function finds it.
    value : the estimate, in `unit`: the mean of the distribution, and its middle where that is symmetric.
    u : standard uncertainty, in `unit`, >= 0; 0 is a constant.  The scale s/sqrt(n) for ``t``, else the standard deviation.
    distribution : see the top of this file; used by Monte Carlo only.
    dof : degrees of freedom of `u` (GUM G.3, G.4); used by the linear method, and by Monte Carlo for ``t`` only.
    unit : text, for tables.
    group : inputs with one name here were read together: a multivariate t, for the scale of their errors is one unknown; all of them ``t``
        with the same dof.  "" for none.
    shape : of the two trapezoids only, see the top of this file: 0 (triangle, rectangle) to 1.

    Raises InputError for a value that breaks one of these rules.
    """

    name: str
    value: float
    u: float
    distribution: Distribution = "normal"
    dof: float = math.inf
    unit: str = ""
    shape: float = 0.0
    group: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError("must be a non-empty text", field="name", value=self.name)
        for field in ("value", "u", "dof", "shape"):
            object.__setattr__(self, field, _number(getattr(self, field), f"{self.name}.{field}"))
        if not math.isfinite(self.value):
            raise InputError("must be finite", field=f"{self.name}.value", value=self.value)
        if not (math.isfinite(self.u) and self.u >= 0.0):
            raise InputError("must be finite and >= 0", field=f"{self.name}.u", value=self.u)
        if self.distribution not in get_args(Distribution):
            known = ", ".join(get_args(Distribution))
            raise InputError(f"must be one of {known}", field=f"{self.name}.distribution", value=self.distribution)
        if not self.dof > 0.0:
            raise InputError("must be > 0", field=f"{self.name}.dof", value=self.dof)
        if self.distribution == "t" and math.isinf(self.dof):
            raise InputError("must be finite for the t distribution", field=f"{self.name}.dof", value=self.dof)
        if self.distribution == "standardised-t" and not 2.0 < self.dof < math.inf:
            raise InputError("must be finite and > 2 for the standardised t distribution", field=f"{self.name}.dof", value=self.dof)
        if not 0.0 <= self.shape <= 1.0 or (self.shape > 0.0 and self.distribution not in SHAPED):
            rule = "must lie between 0 and 1, and be left out for all distributions but the trapezoids"
            raise InputError(rule, field=f"{self.name}.shape", value=self.shape)
        if self.distribution in POSITIVE and not self.value > 0.0:
            raise InputError(f"must be > 0 for the {self.distribution} distribution", field=f"{self.name}.value", value=self.value)
        if not isinstance(self.unit, str):
            raise InputError("must be a text", field=f"{self.name}.unit", value=self.unit)

    @classmethod
    def from_half_width(
        cls,
        name: str,
        value: float,
        half_width: float,
        *,
        distribution: Distribution = "rectangular",
        dof: float = math.inf,
        unit: str = "",
        shape: float = 0.0,
    ) -> Input:
        """The quantity that lies within value +/- half_width for certain (GUM 4.3.7, 4.3.9; JCGM 101, 6.4.2-6.4.6)."""
        if distribution not in BOUNDED:
            raise InputError(f"must be one of {', '.join(BOUNDED)}", field=f"{name}.distribution", value=distribution)
        width = _number(half_width, f"{name}.half_width")
        if not (math.isfinite(width) and width >= 0.0):
            raise InputError("must be finite and >= 0", field=f"{name}.half_width", value=half_width)
        return cls(name, value, width / half_width_in_u(distribution, shape), distribution, dof, unit, shape)

    @classmethod
    def from_readings(cls, name: str, readings: ArrayLike, *, unit: str = "") -> Input:
        """The mean of n >= 2 repeated, independent readings, with a t distribution of n - 1 degrees of freedom.

        u = s/sqrt(n), s the standard deviation of the readings (GUM 4.2.3; JCGM 101, 6.4.9)

        readings : (n,) in `unit`.
        """
        try:
            sample = np.asarray(readings, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError("must be numbers", field=f"{name}.readings", value=readings) from error
        if sample.ndim != 1 or sample.size < 2:
            raise InputError("must be a list of at least two", field=f"{name}.readings", value=readings)
        if not np.all(np.isfinite(sample)):
            raise InputError("must be finite", field=f"{name}.readings", value=readings)
        u = float(sample.std(ddof=1)) / math.sqrt(sample.size)
        return cls(name, float(sample.mean()), u, "t", float(sample.size - 1), unit)

    @property
    def dof_of_u(self) -> float:
        """Degrees of freedom of `u` for the linear method: infinite where u is the standard deviation of a stated distribution."""
        return math.inf if self.distribution == "standardised-t" else self.dof

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the distribution that Monte Carlo draws from, in `unit`; infinite for ``t`` with dof <= 2."""
        if self.distribution != "t" or self.u == 0.0:
            return self.u
        return self.u * math.sqrt(self.dof / (self.dof - 2.0)) if self.dof > 2.0 else math.inf


def check_inputs(inputs: Sequence[Input]) -> tuple[Input, ...]:
    """`inputs` as a tuple, not empty, each name once."""
    checked = tuple(inputs)
    if not checked:
        raise InputError("must hold at least one Input", field="inputs")
    for position, one in enumerate(checked):
        if not isinstance(one, Input):
            raise InputError("must be an Input", field=f"inputs[{position}]", value=one)
    for group in {one.group for one in checked} - {""}:
        if {(one.distribution, one.dof) for one in checked if one.group == group} != {("t", next(o.dof for o in checked if o.group == group))}:
            raise InputError("must be made of t distributions with the same dof", field="group", value=group)
    names = [one.name for one in checked]
    for name in names:
        if names.count(name) > 1:
            raise InputError("must hold each name once", field="inputs", value=name)
    return checked


def correlation_matrix(inputs: Sequence[Input], correlation: Correlation | None) -> FloatArray:
    """Correlation matrix of the inputs, (n_in, n_in), read-only.

    correlation : None, a matrix in the order of `inputs`, or pairs {("V", "I"): -0.36}.

    Raises InputError for an unknown name, a pair given twice, a coefficient outside [-1, 1], a correlation with a constant,
    a matrix of the wrong shape, not symmetric or without ones on the diagonal, and one that no quantities can have (a
    negative eigenvalue).
    """
    names = [one.name for one in inputs]
    if correlation is None:
        matrix = np.eye(len(names))
    elif isinstance(correlation, Mapping):
        matrix = _matrix_from_pairs(names, correlation)
    else:
        matrix = _checked_matrix(names, correlation)
    for i, one in enumerate(inputs):
        if one.u == 0.0 and np.count_nonzero(matrix[i]) > 1:
            raise InputError("must be 0 for a constant (u = 0)", field="correlation", value=one.name)
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -_PSD_TOLERANCE:
        raise InputError(
            "must have no negative eigenvalue (no quantities are correlated like this)", field="correlation", value=smallest
        )
    matrix.flags.writeable = False
    return matrix


def copula_matrix(inputs: Sequence[Input], correlation: FloatArray) -> FloatArray:
    """Correlation matrix of the normal variates whose transforms to the inputs' distributions have `correlation`, (n_in, n_in).

    With g = sum_k a_k h_k(z) the standardised quantile transform (h_k the orthonormal Hermite polynomials) the correlation
    of two inputs is sum_k a_k b_k rho^k; it is solved for rho pair by pair.  Two normal quantities: rho = r; two rectangular
    ones: rho = 2 sin(pi r/6).

    Raises InputError where the marginal distributions cannot have the correlation asked for, or not all of them together.
    """
    matrix = np.array(correlation)
    for i, j in combinations(range(len(inputs)), 2):
        first, second = inputs[i], inputs[j]
        if matrix[i, j] != 0.0 and not (first.group and first.group == second.group) and not (first.distribution == second.distribution == "normal"):
            matrix[i, j] = matrix[j, i] = _copula_coefficient(first, second, float(matrix[i, j]))
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -_PSD_TOLERANCE:
        rule = "cannot be reached by a normal copula of these distributions (negative eigenvalue)"
        raise InputError(rule, field="correlation", value=smallest)
    return matrix


def draw_inputs(inputs: Sequence[Input], copula: FloatArray, *, rng: np.random.Generator, n_draw: int) -> dict[str, FloatArray]:
    """Draws of each input, name -> (n_draw,), in the input's unit.

    The normal variates are taken in the order of the names, so the order in which inputs are listed changes no draw.
    """
    order = sorted(range(len(inputs)), key=lambda i: inputs[i].name)
    normal = rng.standard_normal((len(inputs), n_draw))
    ordered = copula[np.ix_(order, order)]
    if np.count_nonzero(ordered) > len(inputs):
        variance, axes = np.linalg.eigh(ordered)
        normal = (axes * np.sqrt(np.maximum(variance, 0.0))) @ axes.T @ normal
    groups = sorted({one.group for one in inputs if one.group})
    wider = {name: np.sqrt(dof / rng.chisquare(dof, n_draw)) for name in groups for dof in {one.dof for one in inputs if one.group == name}}
    drawn = {
        inputs[i].name: inputs[i].value + inputs[i].u * (z * wider[inputs[i].group] if inputs[i].group else standard_score(inputs[i], z))
        for i, z in zip(order, normal, strict=True)
    }
    return {one.name: drawn[one.name] for one in inputs}


def standard_score(one: Input, z: FloatArray) -> FloatArray:
    """(x - value)/u at the normal quantile `z`, (n_draw,): the increasing map from N(0, 1) to the input's distribution."""
    relative = one.u / one.value if one.distribution in POSITIVE else 0.0
    return score(z, one.distribution, dof=one.dof, shape=one.shape, relative=relative)


def _number(value: object, field: str) -> float:
    if isinstance(value, (bool, str)):
        raise InputError("must be a number", field=field, value=value)
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise InputError("must be a number", field=field, value=value) from error


def _matrix_from_pairs(names: list[str], pairs: Mapping[tuple[str, str], float]) -> FloatArray:
    matrix = np.eye(len(names))
    seen: set[frozenset[str]] = set()
    for pair, given in pairs.items():
        if not (isinstance(pair, tuple) and len(pair) == 2):
            raise InputError("must have pairs of names as keys", field="correlation", value=pair)
        for name in pair:
            if name not in names:
                raise InputError("names no input", field="correlation", value=name)
        if pair[0] == pair[1]:
            raise InputError("must relate two different inputs", field="correlation", value=pair)
        if frozenset(pair) in seen:
            raise InputError("must give each pair once", field="correlation", value=pair)
        seen.add(frozenset(pair))
        coefficient = _number(given, "correlation")
        if not abs(coefficient) <= 1.0:
            raise InputError("must lie within [-1, 1]", field="correlation", value=given)
        i, j = names.index(pair[0]), names.index(pair[1])
        matrix[i, j] = matrix[j, i] = coefficient
    return matrix


def _checked_matrix(names: list[str], given: ArrayLike) -> FloatArray:
    try:
        matrix = np.array(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError("must be a matrix of numbers or pairs of names", field="correlation", value=given) from error
    if matrix.shape != (len(names), len(names)):
        raise InputError(f"must be shaped ({len(names)}, {len(names)})", field="correlation", value=matrix.shape)
    if not np.all(np.abs(matrix) <= 1.0):
        raise InputError("must lie within [-1, 1]", field="correlation", value=given)
    if not np.array_equal(np.diag(matrix), np.ones(len(names))):
        raise InputError("must have ones on the diagonal", field="correlation", value=np.diag(matrix).tolist())
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12):
        raise InputError("must be symmetric", field="correlation", value=given)
    return np.asarray(0.5 * (matrix + matrix.T))


def _copula_coefficient(first: Input, second: Input, target: float) -> float:
    from scipy.optimize import brentq

    for one in (first, second):
        if math.isinf(one.standard_deviation):
            rule = "cannot include a t distribution with dof <= 2 (it has no standard deviation)"
            raise InputError(rule, field="correlation", value=one.name)
    if not (first.distribution in SYMMETRIC and second.distribution in SYMMETRIC):
        return skewed_coefficient(lambda z: standard_score(first, z), lambda z: standard_score(second, z), target, (first.name, second.name))
    z, weight = _half_line()
    scores = [standard_score(one, z) * one.u / one.standard_deviation for one in (first, second)]
    product = _hermite(scores[0]) * _hermite(scores[1])
    same = (first.distribution, first.dof, first.shape) == (second.distribution, second.dof, second.shape)
    largest = 1.0 if same else float(2.0 * np.sum(weight * scores[0] * scores[1]))
    if abs(target) > largest:
        rule = f"between '{first.name}' and '{second.name}' can be {largest:.4f} at most with these distributions"
        raise InputError(rule, field="correlation", value=target)
    powers = 2 * np.arange(product.size) + 1
    product[-1] += largest - product.sum()  # the terms left out, so that rho = 1 gives the largest correlation exactly
    magnitude = brentq(lambda rho: float(np.sum(product * rho**powers)) - abs(target), 0.0, 1.0, xtol=1e-14)
    return math.copysign(float(magnitude), target)


def _half_line() -> tuple[FloatArray, FloatArray]:
    step = 0.01
    z = -step * (np.arange(1200, dtype=np.float64) + 0.5)
    return z, np.asarray(step * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi), dtype=np.float64)


def _hermite(score: FloatArray, n_odd: int = 40) -> FloatArray:
    """Coefficients of an odd function on the orthonormal Hermite polynomials of degree 1, 3, 5, ...: (n_odd,)."""
    z, weight = _half_line()
    coefficients = np.empty(n_odd)
    below, here = np.zeros_like(z), np.ones_like(z)
    for degree in range(2 * n_odd):
        if degree % 2 == 1:
            coefficients[degree // 2] = 2.0 * np.sum(weight * score * here)
        below, here = here, (z * here - math.sqrt(degree) * below) / math.sqrt(degree + 1)
    return coefficients
