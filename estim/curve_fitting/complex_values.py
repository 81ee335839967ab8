"""Complex y: the real and the imaginary parts as two data sets that have everything in common, and
the fit of both as that of one complex curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, update_wrapper
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.common import InputError
from estim.curve_fitting.result import CurveFit
from estim.curves import DataSet, numbered
from estim.given_numbers import are_complex


@dataclass(frozen=True, eq=False)
class ComplexFit(CurveFit):
    """A fitted curve of complex values: a `CurveFit` of the data sets "real" and "imaginary", whose
    curve `fit(x)` and `residuals` (n_obs,) are complex.

    Each complex value counts as two, in `dof` too; `sigma` is the standard deviation of each part.
    A result of one part is chosen by its name: `fit.plot(data="real")`,
    `fit.predict(x, data="imaginary")`.

    >>> import numpy as np
    >>> from estim import fit_curve
    >>> f = np.linspace(9.0, 11.0, 40)
    >>> def response(f, f_0, Q):
    ...     return 1 / (1 + 2j * Q * (f - f_0) / f_0)
    >>> fit = fit_curve(response, f, response(f, 10.1, 12.0), u_y=0.01, start={"f_0": 10, "Q": 10})
    >>> complex(fit(10.1).round(4)), round(fit.values["Q"], 2)
    ((1+0j), 12.0)
    """

    def __call__(self, x: ArrayLike, *, data: str | None = None) -> Any:
        if data is not None:
            return super().__call__(x, data=data)
        return self(x, data="real") + 1j * self(x, data="imaginary")

    @cached_property
    def residuals(self) -> Any:
        real, imaginary = np.split(super().residuals, 2)
        return real + 1j * imaginary


def parts_of(points: DataSet, **others: Any) -> dict[str, DataSet]:
    """The real and the imaginary parts of complex points.  Raises InputError.

    others : arguments that complex values do not have, None where they were not given.
    """
    others |= {name: getattr(points, name) for name in ("cov_y", "noise", "u_x", "cov_x", "r_xy")}
    y: Any = points.y
    u_y: Any = points.u_y
    curve = points.curve
    for field, argument in (others | {"u_y": u_y if isinstance(u_y, str) else None}).items():
        if argument is not None:
            raise InputError("cannot be combined with complex y", field=field, value=argument)
    if not callable(curve):
        rule = "must be a Python function that returns complex numbers, because y is complex"
        raise InputError(rule, field="curve", value=curve)
    parts = {}
    for name, part in (("real", np.real), ("imaginary", np.imag)):
        own, x = numbered(_Part(curve, part), points.x)
        u_own = part(u_y) if are_complex(u_y) else u_y
        parts[name] = replace(points, x=x, y=part(y), u_y=u_own, curve=own)
    return parts


class _Part:
    """The curve of one part, with the name and the arguments of `curve`."""

    def __init__(self, curve: Any, part: Any) -> None:
        update_wrapper(self, curve)
        self.curve, self.part = curve, part

    def __call__(self, x: Any, **parameters: Any) -> Any:
        return self.part(self.curve(x, **parameters))
