"""Errors that all readings of a series share, as nuisance parameters of the curve.

Which to choose:
- `zero_y`: the instrument for y reads y + d, with d common to all readings, known to be 0 within u
  (unit of y).
- `scale_y`: it reads (1 + d) y, with d known to be 0 within u (a fraction: 0.01 is 1 %).
- `zero_x`, `scale_x`: the same of x.

`scale_errors_of` tells how a fit accounts for scales that nobody stated.

d is a parameter with a normal prior of mean 0 and standard deviation u.  It is fit and sampled with
the others, so that its uncertainty and its correlations reach every result, and the data may narrow
it where they can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estim.arrays import FloatArray, Named
from estim.common import InputError, PhraseTable, require_one_of
from estim.curves.binned import BinnedCurve
from estim.curves.columns import errors_of
from estim.problem import EXACT, CommonError, Curve, LocalCurve, Normal, Parameter

_SHARE = 0.01  # how far a scale is taken to be off
KINDS = PhraseTable(
    {
        "zero_y": "common zero error of y",
        "scale_y": "common relative error of y",
        "zero_x": "common zero error of x",
        "scale_x": "common relative error of x",
    }
)


@dataclass(frozen=True)
class Component:
    """One shared error: `kind` out of KINDS, standard uncertainty `u`, and the name of its
    parameter ("" means its kind).

    kind : "zero_x" or "zero_y", an offset of all x or all y, with u in their unit; "scale_x" or
        "scale_y", a factor 1 + error, with u a pure number, 0.01 for 1 %.

    groups : (n_obs,) labels, where only points with the same label share a zero error of y: of the
        instrument, the day, the batch.  u may then be (n_obs,), 0 where a point has no part in it.

    The error is one more parameter, with a normal prior of mean 0 and standard deviation u, so that
    more points do not average it out; with `groups` it stands in the covariance of y.  Raises
    InputError for another kind, and for u that is not > 0 or, of a scale, above 0.5.  Source: GUM
    (JCGM 100:2008), F.1.2.

    >>> from estim import Component
    >>> Component("scale_y", 0.01, name="gain").parameter_name
    'gain'
    """

    kind: str
    u: Any
    name: str = ""
    groups: Any = None

    def __post_init__(self) -> None:
        require_one_of(self.kind, KINDS, field="kind")
        if self.groups is not None:  # u is checked beside the points
            if self.kind != "zero_y":
                raise InputError("must be zero_y with groups", field="kind", value=self.kind)
            return
        if (
            isinstance(self.u, bool)
            or not isinstance(self.u, int | float)
            or not (np.isfinite(self.u) and self.u > 0.0)
        ):
            raise InputError("must be > 0 and finite", field="u", value=self.u)
        if self.kind.startswith("scale") and self.u > 0.5:
            raise InputError(
                "is a fraction of the reading (0.01 means 1 %) and must be at most 0.5",
                field="u",
                value=self.u,
            )

    @property
    def parameter_name(self) -> str:
        """The name of its parameter: `name`, or its kind."""
        return self.name or self.kind

    def parameter(self, *, x_unit: str, y_unit: str) -> Parameter:
        """The nuisance parameter of this error, in the unit of x or y, "1" for a scale."""
        unit = (
            "1" if self.kind.startswith("scale") else y_unit if self.kind.endswith("y") else x_unit
        )
        return Parameter(self.parameter_name, unit, Normal(0.0, float(self.u)), KINDS[self.kind])


def covariance_in_groups(errors: Sequence[Component], n_obs: int) -> FloatArray:
    """(n_obs, n_obs) of the errors that the points of a group share.  Raises InputError."""
    total = np.zeros((n_obs, n_obs))
    for component in errors:
        field, labels = f"errors[{component.parameter_name}]", np.asarray(component.groups)
        missing = any(
            group is None or group != group for group in np.ravel(component.groups).tolist()
        )
        if labels.shape != (n_obs,):
            rule = f"must have as many groups as values of x ({n_obs})"
            raise InputError(rule, field=field, value=labels.shape)
        if missing or "nan" in labels.astype(str):
            raise InputError("must have the group of each point, not nan", field=field)
        u = errors_of(component.u, n_obs, field, some_exact=True)
        total += np.outer(u, u) * (labels[:, None] == labels)
    return total


@dataclass(frozen=True, eq=False)
class DistortedCurve:
    """A curve as read by instruments with shared errors; its arguments are those of `curve`
    and one for each component.

    `curve` must take x that differs from draw to draw, (n_draw, n_obs), as formulas and functions
    do.

        y = (1 + sum of scale_y) f(x_true) + sum of zero_y
        x_true = (x - sum of zero_x) / (1 + sum of scale_x)
    """

    curve: Curve
    components: tuple[Component, ...]

    @property
    def precision(self) -> float:
        """Relative error of the derivatives."""
        return getattr(self.curve, "precision", EXACT)

    def _sum(self, kind: str, arguments: Named) -> FloatArray:
        return np.sum(
            [
                np.asarray(arguments[c.parameter_name], dtype=float)
                for c in self.components
                if c.kind == kind
            ],
            axis=0,
        )

    def _undistorted(self, x: FloatArray, arguments: Named) -> FloatArray:
        return (x - self._sum("zero_x", arguments)) / (1.0 + self._sum("scale_x", arguments))

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        inner = self.curve.value(self._undistorted(x, arguments), arguments)
        return (1.0 + self._sum("scale_y", arguments)) * inner + self._sum("zero_y", arguments)

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        true = self._undistorted(x, arguments)
        inner = self.curve.local(true, arguments)
        scale = 1.0 + self._sum("scale_y", arguments)
        stretch = 1.0 + self._sum("scale_x", arguments)
        slope = scale * inner.slope / stretch
        by_kind = {
            "zero_y": np.ones_like(inner.value),
            "scale_y": inner.value,
            "zero_x": -slope,
            "scale_x": -slope * true,
        }
        gradient = {name: scale * partial for name, partial in inner.gradient.items()}
        gradient |= {c.parameter_name: by_kind[c.kind] for c in self.components}
        return LocalCurve(scale * inner.value + self._sum("zero_y", arguments), slope, gradient)


def scale_errors_of(curve: Curve, kinds: Sequence[str]) -> tuple[CommonError, ...]:
    """A per cent of each of these scales ("scale_x", "scale_y") that is no unknown already."""
    known = (
        {component.kind for component in curve.components}
        if isinstance(curve, DistortedCurve)
        else set[str]()
    )
    return tuple(_scale_error(curve, kind) for kind in kinds if kind not in known)


def _scale_error(curve: Curve, kind: str) -> CommonError:
    name = f"error of {kind}"
    error = Component(kind, _SHARE, name)
    if not isinstance(curve, BinnedCurve):
        return CommonError(kind, _SHARE, "1", DistortedCurve(curve, (error,)), {name: _SHARE})
    # the events of a longer bin are as many: fewer for each unit of x
    thinned = Component("scale_y", _SHARE, f"{name}, per unit")
    density = DistortedCurve(curve.density, (error, thinned))
    return CommonError(
        kind,
        _SHARE,
        "1",
        replace(curve, density=density),
        {name: _SHARE, thinned.parameter_name: 1.0 / (1.0 + _SHARE) - 1.0},
    )
