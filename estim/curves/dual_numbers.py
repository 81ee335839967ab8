"""Exact derivatives by dual numbers: NumPy code run on `Dual` arrays carries its first derivatives
along.

A `Dual` is a value with its partial derivatives by name.  Operators and NumPy's elementwise
functions follow the chain rule (forward-mode automatic differentiation; Griewank and Walther,
Evaluating Derivatives, 2nd ed. 2008, ch. 3), to rounding error and without a step to choose.  A
value may be complex, of real parameters: the modulus, argument, real and imaginary part follow the
chain rule of their two real components.  Anything else (`math.exp`, linear algebra, a cast to
float) raises TypeError.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

Slope = Callable[..., Any]


class Dual(NDArrayOperatorsMixin):
    """value : an array.  partials : name -> derivative of the value, arrays that broadcast to
    it.
    """

    __slots__ = ("partials", "value")
    __hash__ = None  # type: ignore[assignment]  # equality compares values, elementwise

    def __init__(self, value: Any, partials: Mapping[str, Any]) -> None:
        self.value, self.partials = value, partials

    def __array__(self, *_: object, **__: object) -> Any:
        raise TypeError("a dual number is no plain array")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        values = [plain(value) for value in inputs]
        if method != "__call__" or options:
            return NotImplemented
        if ufunc in _STEPS:
            return ufunc(*values)
        if ufunc in _OF_COMPLEX and np.iscomplexobj(values[0]):
            return _OF_COMPLEX[ufunc](*inputs)
        slopes = _slopes().get(ufunc)
        if slopes is None:
            return NotImplemented
        result = ufunc(*values)
        partials: dict[str, Any] = {}
        for value, slope in zip(inputs, slopes, strict=True):
            if isinstance(value, Dual):
                local = slope(result, *values)
                for name, partial in value.partials.items():
                    term = local * partial
                    partials[name] = partials[name] + term if name in partials else term
        return Dual(result, partials)

    @property
    def real(self) -> Dual:
        return Dual(
            self.value.real, {name: partial.real for name, partial in self.partials.items()}
        )

    @property
    def imag(self) -> Dual:
        return Dual(
            self.value.imag, {name: partial.imag for name, partial in self.partials.items()}
        )

    def conjugate(self) -> Any:
        return np.conjugate(self)

    def __array_function__(
        self, function: Callable[..., Any], types: Any, arguments: Any, options: Any
    ) -> Any:
        if function in _OF_COMPLEX and len(arguments) == 1 and not options:
            return _OF_COMPLEX[function](*arguments)
        if function is not np.where or len(arguments) != 3 or options:
            return NotImplemented
        condition, yes, no = arguments
        condition = plain(condition)
        names = dict.fromkeys(
            name for branch in (yes, no) if isinstance(branch, Dual) for name in branch.partials
        )
        partials = {
            name: np.where(condition, _partial(yes, name), _partial(no, name)) for name in names
        }
        return Dual(np.where(condition, plain(yes), plain(no)), partials)


def plain(value: Any) -> Any:
    """The value of a Dual, anything else as it is."""
    return value.value if isinstance(value, Dual) else value


def _partial(value: Any, name: str) -> Any:
    return value.partials.get(name, 0.0) if isinstance(value, Dual) else 0.0


_STEPS = {
    np.less,
    np.less_equal,
    np.greater,
    np.greater_equal,
    np.equal,
    np.not_equal,
    np.isfinite,
    np.isnan,
    np.sign,
    np.floor,
    np.ceil,
    np.rint,
    np.logical_and,
    np.logical_or,
    np.logical_not,
}  # constant between their jumps: plain values come out


_OF_COMPLEX: Mapping[Any, Callable[[Any], Any]] = {
    np.absolute: lambda z: np.hypot(z.real, z.imag),
    np.conjugate: lambda z: z.real - 1j * z.imag,
    np.angle: lambda z: np.arctan2(z.imag, z.real),
    np.real: lambda z: z.real,
    np.imag: lambda z: z.imag,
}  # functions of a complex number that have no complex derivative


def _power_of_base(r: Any, a: Any, b: Any) -> Any:
    if isinstance(b, int | float) and b == 0.0:  # not 0 times the infinity of 1/a at a = 0
        return 0.0
    return b * np.power(a, b - 1.0)


def _power_of_exponent(r: Any, a: Any, b: Any) -> Any:
    positive = a > 0.0
    return np.where(
        positive, r * np.log(np.where(positive, a, 1.0)), np.where(a == 0.0, 0.0, np.nan)
    )


def _voigt_slopes(r: Any, x: Any, sigma: Any, gamma: Any) -> tuple[Any, Any, Any]:
    """Derivatives of Re w(z)/(sigma sqrt(2 pi)), z = (|x| + i gamma)/(sigma sqrt 2), in x, sigma
    and gamma.

    w' = 2i/sqrt(pi) - 2 z w (Abramowitz and Stegun 7.1.20); far out the derivatives of its
    expansion 7.1.23.
    """
    from scipy import special

    # a width that stands for 0
    sign, width = np.where(np.asarray(sigma) < 0.0, -1.0, 1.0), np.maximum(np.abs(sigma), 1e-60)
    z = (np.abs(x) + 1j * np.asarray(gamma)) / (width * np.sqrt(2.0))
    # from here on the Faddeeva function's own derivative would be a small difference of large
    # numbers
    far = np.abs(z) > 100.0
    inverse, near = np.where(far, 1.0 / np.where(far, z, 1.0), 0.0), np.where(far, 0.0, z)
    square, faddeeva = inverse**2, special.wofz(near)
    slope = np.where(
        far,
        -square * (1.0 + square * (1.5 + square * (3.75 + square * 13.125))) * 1j / np.sqrt(np.pi),
        2j / np.sqrt(np.pi) - 2.0 * near * faddeeva,
    )
    shrinking = np.where(
        far,
        -inverse * square * (1.0 + square * (3.0 + square * 11.25)) * 1j / np.sqrt(np.pi),
        faddeeva + near * slope,
    )
    size = 2.0 * np.sqrt(np.pi) * width**2
    return (
        np.sign(x) * slope.real / size,
        -sign * np.sqrt(2.0) * shrinking.real / size,
        -slope.imag / size,
    )


@lru_cache(maxsize=1)
def _slopes() -> dict[np.ufunc, tuple[Slope, ...]]:
    """Elementwise function -> derivative in each of its arguments, from its result and its
    arguments.
    """
    from scipy import special

    two_over_root_pi = 2.0 / np.sqrt(np.pi)
    zero: Slope = lambda *_: 0.0  # noqa: E731
    return {
        np.add: (lambda r, a, b: 1.0, lambda r, a, b: 1.0),
        np.subtract: (lambda r, a, b: 1.0, lambda r, a, b: -1.0),
        np.multiply: (lambda r, a, b: b, lambda r, a, b: a),
        np.true_divide: (lambda r, a, b: 1.0 / b, lambda r, a, b: -r / b),
        np.power: (_power_of_base, _power_of_exponent),
        np.float_power: (_power_of_base, _power_of_exponent),
        np.remainder: (lambda r, a, b: 1.0, lambda r, a, b: -np.floor(a / b)),
        np.maximum: (
            lambda r, a, b: np.where(a >= b, 1.0, 0.0),
            lambda r, a, b: np.where(a >= b, 0.0, 1.0),
        ),
        np.minimum: (
            lambda r, a, b: np.where(a <= b, 1.0, 0.0),
            lambda r, a, b: np.where(a <= b, 0.0, 1.0),
        ),
        np.arctan2: (lambda r, a, b: b / (a * a + b * b), lambda r, a, b: -a / (a * a + b * b)),
        np.hypot: (lambda r, a, b: a / r, lambda r, a, b: b / r),
        np.logaddexp: (lambda r, a, b: np.exp(a - r), lambda r, a, b: np.exp(b - r)),
        np.heaviside: (zero, zero),
        np.negative: (lambda r, a: -1.0,),
        np.positive: (lambda r, a: 1.0,),
        np.absolute: (lambda r, a: np.sign(a),),
        np.fabs: (lambda r, a: np.sign(a),),
        np.exp: (lambda r, a: r,),
        np.exp2: (lambda r, a: r * np.log(2.0),),
        np.expm1: (lambda r, a: np.exp(a),),
        np.log: (lambda r, a: 1.0 / a,),
        np.log2: (lambda r, a: 1.0 / (a * np.log(2.0)),),
        np.log10: (lambda r, a: 1.0 / (a * np.log(10.0)),),
        np.log1p: (lambda r, a: 1.0 / (1.0 + a),),
        np.sqrt: (lambda r, a: 0.5 / r,),
        np.cbrt: (lambda r, a: r / (3.0 * a),),
        np.square: (lambda r, a: 2.0 * a,),
        np.reciprocal: (lambda r, a: -r * r,),
        np.sin: (lambda r, a: np.cos(a),),
        np.cos: (lambda r, a: -np.sin(a),),
        np.tan: (lambda r, a: 1.0 + r * r,),
        np.arcsin: (lambda r, a: 1.0 / np.sqrt(1.0 - a * a),),
        np.arccos: (lambda r, a: -1.0 / np.sqrt(1.0 - a * a),),
        np.arctan: (lambda r, a: 1.0 / (1.0 + a * a),),
        np.sinh: (lambda r, a: np.cosh(a),),
        np.cosh: (lambda r, a: np.sinh(a),),
        np.tanh: (lambda r, a: 1.0 - r * r,),
        np.arcsinh: (lambda r, a: 1.0 / np.sqrt(1.0 + a * a),),
        np.arccosh: (lambda r, a: 1.0 / (np.sqrt(a - 1.0) * np.sqrt(a + 1.0)),),
        np.arctanh: (lambda r, a: 1.0 / (1.0 - a * a),),
        np.deg2rad: (lambda r, a: np.pi / 180.0,),
        np.radians: (lambda r, a: np.pi / 180.0,),
        np.rad2deg: (lambda r, a: 180.0 / np.pi,),
        np.degrees: (lambda r, a: 180.0 / np.pi,),
        special.gammaln: (lambda r, a: special.digamma(a),),
        special.log_ndtr: (lambda r, a: np.exp(-0.5 * a * a - r) / np.sqrt(2.0 * np.pi),),
        special.erf: (lambda r, a: two_over_root_pi * np.exp(-a * a),),
        special.voigt_profile: tuple(
            lambda *arguments, i=i: _voigt_slopes(*arguments)[i] for i in range(3)
        ),
        special.erfc: (lambda r, a: -two_over_root_pi * np.exp(-a * a),),
    }
