"""Quantities that enter an uncertainty propagation: their distributions, their correlations, and
draws from them.

Which distribution to choose (GUM 4.3, JCGM 101 section 6):

- ``normal``       a calibration certificate or a fit: value and standard uncertainty.  The default.
- ``t``            the mean of a few readings (`Input.from_readings`): u = s/sqrt(n), dof = n - 1.
- ``standardised-t``  Student's t whose standard deviation, not its scale, is u (NIST TN 1900 states
  it so); dof > 2.
- ``rectangular``  only limits are known (a digital display, a tolerance, a rounding): u = half
  width/sqrt(3).
- ``triangular``   limits, with the middle more likely (a sum of two equal roundings): u = half
  width/sqrt(6).
- ``arcsine``      a quantity that oscillates between limits (room temperature, vibration): u = half
  width/sqrt(2).
- ``trapezoidal``  limits, with a plateau in the middle (a sum of two unequal roundings); `shape` is
  the width of the plateau / that of the base.
- ``curvilinear-trapezoidal``  limits that are themselves known only so well; `shape` is the error
  of the half width / half width (JCGM 101, 6.4.3).
- ``exponential``  not negative, and only the mean is known (value = u, JCGM 101, 6.4.10); with
  another u it begins at value - u.
- ``lognormal``, ``gamma``  a positive quantity, given by its mean and standard deviation.

If it is unknown, take limits you would bet on and ``rectangular`` (`Input.from_half_width`).

For ``t`` the field `u` is the scale s/sqrt(n), as in the GUM, and not the standard deviation of the
distribution, which is larger: u sqrt(dof/(dof - 2)), infinite for dof <= 2 (JCGM 101, 6.4.9).  So
the Monte-Carlo u exceeds the linear one for few readings, while the linear method pays for the same
ignorance with a larger coverage factor.

Correlations are linear (Pearson) correlation coefficients of the quantities themselves, as in GUM
5.2.  Draws of correlated quantities come from a normal copula whose parameters are chosen so that
these coefficients are met exactly, whatever the marginal distributions (Cario and Nelson 1997,
"Modeling and generating random vectors with arbitrary marginal distributions and correlation
matrix").
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError, read_with_unit, require_one_of
from estim.given_numbers import finite_numbers, real_number, real_numbers
from estim.propagation.scores import BOUNDED, POSITIVE, SHAPED, Distribution, half_width_in_u

Correlation = Mapping[tuple[str, str], float] | ArrayLike

PSD_TOLERANCE = 1e-9  # smallest eigenvalue that still counts as zero


@dataclass(frozen=True, eq=False)
class Input:
    """One input quantity of a measurement function.

    name : how the function finds it.
    value : the estimate, in `unit`: the mean of the distribution, and its middle where that is
        symmetric.
    u : standard uncertainty, in `unit`, >= 0; 0 is a constant.  The scale s/sqrt(n) for ``t``, else
        the standard deviation.
    distribution : "normal", "t", "rectangular" and so on (docs/propagation.md has the table of
        all); used by Monte Carlo only.
    dof : degrees of freedom of `u` (GUM G.3, G.4); used by the linear method, and by Monte Carlo
        for ``t`` only.
    unit : text, for tables.
    group : inputs with the same group were read together: a multivariate t, for the scale of their
        errors is one unknown; all of them ``t`` with the same dof.  "" for none.
    joint_dof : degrees of freedom of that multivariate t where they are not `dof`: n - N for n sets
        of N readings (JCGM 102, 5.3.2); its scale is then u sqrt(dof/joint_dof).  For Monte Carlo
        only; 0 for `dof`.
    shape : of the two trapezoids only: width of the plateau / that of the base, or error of the
        half width / half width; 0 (triangle, rectangle) to 1.

    Raises InputError for a value that breaks one of these rules.

    >>> from estim import Input, propagate_linear
    >>> length = Input("L", 0.85, 0.01, unit="m")
    >>> period = Input.from_readings("T", [1.851, 1.849, 1.855], unit="s")
    >>> print(propagate_linear("4*pi**2*L/T**2", [length, period]))
    Linear propagation (GUM), 95 %
         value  u     dof       k     U = k u
      y  9.79   0.12  3.06e+03  1.96  0.23
    """

    name: str
    value: float
    u: float
    distribution: Distribution = "normal"
    dof: float = math.inf
    unit: str = ""
    shape: float = 0.0
    group: str = ""
    joint_dof: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError("must be a non-empty text", field="name", value=self.name)
        for field in ("value", "u", "dof", "shape", "joint_dof"):
            object.__setattr__(
                self, field, real_number(getattr(self, field), f"{self.name}.{field}")
            )
        kind, dof, shape = self.distribution, self.dof, self.shape
        require_one_of(kind, get_args(Distribution), field=f"{self.name}.distribution")
        for field, valid, rule in (
            ("value", math.isfinite(self.value), "must be finite"),
            ("u", 0.0 <= self.u < math.inf, "must be finite and >= 0"),
            ("dof", dof > 0.0, "must be > 0"),
            ("dof", kind != "t" or dof < math.inf, "must be finite for the t distribution"),
            (
                "dof",
                kind != "standardised-t" or 2.0 < dof < math.inf,
                "must be finite and > 2 for the standardised t distribution",
            ),
            (
                "joint_dof",
                0.0 <= self.joint_dof < math.inf and (not self.joint_dof or self.group),
                "must be a number > 0, and be left out for an input of no group",
            ),
            (
                "shape",
                0.0 <= shape <= 1.0 and (shape == 0.0 or kind in SHAPED),
                "must lie between 0 and 1, and be left out for all distributions but the "
                "trapezoids",
            ),
            (
                "value",
                kind not in POSITIVE or self.value > 0.0,
                f"must be > 0 for the {kind} distribution",
            ),
            ("unit", isinstance(self.unit, str), "must be a text"),
        ):
            if not valid:
                raise InputError(rule, field=f"{self.name}.{field}", value=getattr(self, field))

    @classmethod
    def of(cls, name: str, stated: Input | str | float | ArrayLike) -> Input:
        """The quantity that is stated as text, "0.85(1) m", as an exact number, by readings (one
        dimension, `from_readings`), or as an Input, whatever its name.
        """
        if isinstance(stated, Input):
            return replace(stated, name=name)
        if isinstance(stated, (str, float, int)):
            quantity, unit = read_with_unit(stated, field=name)
            return cls(name, quantity.value, quantity.u, unit=unit)
        return cls.from_readings(name, stated)

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
        """The quantity that lies within value +/- half_width for certain (GUM 4.3.7, 4.3.9; JCGM
        101, 6.4.2-6.4.6).
        """
        require_one_of(distribution, BOUNDED, field=f"{name}.distribution")
        width = real_number(half_width, f"{name}.half_width")
        if not (math.isfinite(width) and width >= 0.0):
            raise InputError(
                "must be finite and >= 0", field=f"{name}.half_width", value=half_width
            )
        return cls(
            name,
            value,
            width / half_width_in_u(distribution, shape),
            distribution,
            dof,
            unit,
            shape,
        )

    @classmethod
    def from_readings(cls, name: str, readings: ArrayLike, *, unit: str = "") -> Input:
        """The mean of n >= 2 repeated, independent readings, with a t distribution of n - 1 degrees
        of freedom.

        u = s/sqrt(n), s the standard deviation of the readings (GUM 4.2.3; JCGM 101, 6.4.9)

        readings : (n,) in `unit`.
        """
        sample = finite_numbers(readings, f"{name}.readings")
        if sample.ndim != 1 or sample.size < 2:
            raise InputError(
                "must be a list of at least two", field=f"{name}.readings", value=readings
            )
        if np.ptp(sample) == 0.0:
            rule = "are all the same, so that their scatter tells no uncertainty: state it"
            raise InputError(
                f"{rule}, as Input({name!r}, {sample[0]:g}, u)",
                field=f"{name}.readings",
                value=float(sample[0]),
            )
        u = float(sample.std(ddof=1)) / math.sqrt(sample.size)
        return cls(name, float(sample.mean()), u, "t", float(sample.size - 1), unit)

    @property
    def dof_of_u(self) -> float:
        """Degrees of freedom of `u` for the linear method: infinite where u is the standard
        deviation of a stated distribution.
        """
        return math.inf if self.distribution == "standardised-t" else self.dof

    @property
    def drawn_dof(self) -> float:
        """Degrees of freedom of the t distribution that Monte Carlo draws from."""
        return self.joint_dof or self.dof

    @property
    def drawn_scale(self) -> float:
        """Scale of the distribution that Monte Carlo draws from, in `unit`: u, but for a
        `joint_dof`.
        """
        return self.u * math.sqrt(self.dof / self.joint_dof) if self.joint_dof else self.u

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the distribution that Monte Carlo draws from, in `unit`; infinite
        for ``t`` with dof <= 2.
        """
        if self.distribution != "t" or self.u == 0.0:
            return self.u
        return (
            self.drawn_scale * math.sqrt(self.drawn_dof / (self.drawn_dof - 2.0))
            if self.drawn_dof > 2.0
            else math.inf
        )


StatedInputs = Sequence[Input] | Mapping[str, Input | str | float | ArrayLike]


def check_inputs(inputs: StatedInputs) -> tuple[Input, ...]:
    """`inputs` as a tuple, not empty, each name once."""
    checked = (
        tuple(Input.of(name, stated) for name, stated in inputs.items())
        if isinstance(inputs, Mapping)
        else tuple(inputs)
    )
    if not checked:
        raise InputError("must hold at least one Input", field="inputs")
    for position, quantity in enumerate(checked):
        if not isinstance(quantity, Input):
            raise InputError("must be an Input", field=f"inputs[{position}]", value=quantity)
    for group in {quantity.group for quantity in checked} - {""}:
        kinds = {
            (quantity.distribution, quantity.dof, quantity.drawn_dof)
            for quantity in checked
            if quantity.group == group
        }
        if len(kinds) > 1 or next(iter(kinds))[0] != "t":
            raise InputError(
                "must be made of t distributions with the same dof", field="group", value=group
            )
    names = [quantity.name for quantity in checked]
    for name in names:
        if names.count(name) > 1:
            raise InputError("must hold each name once", field="inputs", value=name)
    return checked


def correlation_matrix(inputs: Sequence[Input], correlation: Correlation | None) -> FloatArray:
    """Correlation matrix of the inputs, (n_in, n_in), read-only.

    correlation : None, a matrix in the order of `inputs`, or pairs {("V", "I"): -0.36}.

    Raises InputError for an unknown name, a pair given twice, a coefficient outside [-1, 1], a
    correlation with a constant, a matrix of the wrong shape, not symmetric or without ones on the
    diagonal, and one that no quantities can have (a negative eigenvalue).
    """
    names = [quantity.name for quantity in inputs]
    if correlation is None:
        matrix = np.eye(len(names))
    elif isinstance(correlation, Mapping):
        matrix = _matrix_from_pairs(names, correlation)
    else:
        matrix = _checked_matrix(names, correlation)
    for i, quantity in enumerate(inputs):
        if quantity.u == 0.0 and np.count_nonzero(matrix[i]) > 1:
            raise InputError(
                "must be 0 for a constant (u = 0)", field="correlation", value=quantity.name
            )
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -PSD_TOLERANCE:
        raise InputError(
            "must have no negative eigenvalue (no quantities are correlated like this)",
            field="correlation",
            value=smallest,
        )
    matrix.flags.writeable = False
    return matrix


def _matrix_from_pairs(names: list[str], pairs: Mapping[tuple[str, str], float]) -> FloatArray:
    matrix = np.eye(len(names))
    known: set[frozenset[str]] = set()
    for pair, stated in pairs.items():
        if not (isinstance(pair, tuple) and len(pair) == 2):
            raise InputError("must have pairs of names as keys", field="correlation", value=pair)
        for name in pair:
            if name not in names:
                raise InputError("names no input", field="correlation", value=name)
        if pair[0] == pair[1]:
            raise InputError("must relate two different inputs", field="correlation", value=pair)
        if frozenset(pair) in known:
            raise InputError("must give each pair once", field="correlation", value=pair)
        known.add(frozenset(pair))
        coefficient = real_number(stated, "correlation")
        if not abs(coefficient) <= 1.0:
            raise InputError("must lie within [-1, 1]", field="correlation", value=stated)
        i, j = names.index(pair[0]), names.index(pair[1])
        matrix[i, j] = matrix[j, i] = coefficient
    return matrix


def _checked_matrix(names: list[str], stated: ArrayLike) -> FloatArray:
    matrix = real_numbers(stated, "correlation", "must be a matrix of numbers or pairs of names")
    if matrix.shape != (len(names), len(names)):
        raise InputError(
            f"must be shaped ({len(names)}, {len(names)})", field="correlation", value=matrix.shape
        )
    if not np.all(np.abs(matrix) <= 1.0):
        raise InputError("must lie within [-1, 1]", field="correlation", value=stated)
    if not np.array_equal(np.diag(matrix), np.ones(len(names))):
        raise InputError(
            "must have ones on the diagonal", field="correlation", value=np.diag(matrix).tolist()
        )
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12):
        raise InputError("must be symmetric", field="correlation", value=stated)
    return 0.5 * (matrix + matrix.T)
