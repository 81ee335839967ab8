"""A curve given by differential equations: `ode`, whose result `fit_curve` takes in place of a
function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from estim.arrays import all_finite, max_abs
from estim.common import InputError
from estim.curves.several_abscissas import arguments_taken

Method = Literal["DOP853", "RK45", "Radau", "BDF"]
_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class OdeCurve:
    """curve(x, **parameters): what is observed of the solution of dy/dx = rhs(x, y, **parameters)
    at x (n_obs,); nan where it has none.

    A complex step through the solver gives derivatives that are exact for the steps it takes, where
    `rhs` is made of functions that take complex numbers; else `estim.curves.function` takes
    differences.
    """

    rhs: Callable[..., Any]
    at_start: tuple[float | str, ...]
    x0: float
    observed: int | Callable[..., Any]
    method: Method

    @property
    def __name__(self) -> str:
        return f"ode {getattr(self.rhs, '__name__', 'rhs')}"

    @property
    def scanned(self) -> bool:
        """Whether a fit scans for other optima by default: that takes thousands of solutions."""
        return False

    @property
    def precision(self) -> float:
        """Relative error of values and derivatives."""
        return _TOLERANCE

    def __call__(self, x: Any, **parameters: Any) -> Any:
        """(n_obs,), or (n_draw, n_obs) where parameters are (n_draw, 1)."""
        abscissas = np.atleast_1d(x)
        if abscissas.dtype.kind not in "fiuc" or any(
            np.asarray(value).dtype.kind not in "fiuc" for value in parameters.values()
        ):
            raise TypeError("takes plain numbers")
        n_draw = max((np.size(value) for value in parameters.values()), default=1)
        draws = {
            name: np.broadcast_to(np.ravel(value), (n_draw,)) for name, value in parameters.items()
        }
        of_rhs = [entry.name for entry in arguments_taken(self.rhs)[2:]]  # after x and y
        own = {
            name: value
            for name, value in draws.items()
            if name not in self.at_start or name in of_rhs
        }
        state = np.array(
            [
                draws[entry] if isinstance(entry, str) else np.full(n_draw, entry)
                for entry in self.at_start
            ]
        )
        states = self._solved(abscissas.real, state, own)
        if abscissas.dtype.kind == "c":  # to first order, which is all that a complex step needs
            slopes = np.stack(
                [self._rate(at, states[:, :, k], own) for k, at in enumerate(abscissas.real)],
                axis=-1,
            )
            states = states + 1j * abscissas.imag * slopes
        if callable(self.observed):
            observed = np.asarray(
                self.observed(
                    abscissas, states, **{name: value[:, None] for name, value in own.items()}
                )
            )
            observed = np.broadcast_to(observed, (n_draw, abscissas.size))
        else:
            observed = states[self.observed]
        return observed if any(np.ndim(value) for value in parameters.values()) else observed[0]

    def _rate(self, x: float, y: Any, own: dict[str, Any]) -> Any:
        """(n_state, n_draw); one draw is given to the user's function as plain numbers."""
        if y.shape[1] == 1:
            return np.asarray(
                self.rhs(x, y[:, 0], **{name: value.item() for name, value in own.items()})
            )[:, None]
        return np.stack(
            [np.broadcast_to(component, y.shape[1:]) for component in self.rhs(x, y, **own)]
        )

    def _solved(self, x: Any, state: Any, own: dict[str, Any]) -> Any:
        """(n_state, n_draw, n_obs), forwards and backwards from x0."""
        kind = np.result_type(state.dtype, *(value.dtype for value in own.values()), float)
        state, n_draw = state.astype(kind), state.shape[1]
        reach = max_abs(x - self.x0) or 1.0
        with np.errstate(all="ignore"):
            covered = reach * np.abs(self._rate(self.x0, state, own))
        # of the state itself: a fast reaction's rate, times the range of x, exceeds all its values
        size = np.abs(state.real)
        size = np.where(size > 0.0, size, np.minimum(covered, np.max(size) or math.inf))
        size = np.where(
            (size > 0.0) & np.isfinite(size),
            size,
            float(np.max(size[np.isfinite(size)], initial=0.0)) or 1.0,
        )
        solution = np.full((*state.shape, x.size), math.nan, dtype=kind)
        solution[:, :, x == self.x0] = state[:, :, None]
        for side in (x > self.x0, x < self.x0):
            if np.any(side):
                abscissas, inverse = np.unique(x[side], return_inverse=True)
                ordered = abscissas if abscissas[0] > self.x0 else abscissas[::-1]
                values = self._along(ordered, state, own, size)
                if values is None and n_draw > 1:  # one of the draws has no solution
                    halves = np.array_split(np.arange(n_draw), 2)
                    parts = [
                        self._solved(
                            x, state[:, half], {name: value[half] for name, value in own.items()}
                        )
                        for half in halves
                    ]
                    return np.concatenate(parts, axis=1)
                if values is not None:
                    solution[:, :, side] = (values if ordered is abscissas else values[:, :, ::-1])[
                        :, :, inverse
                    ]
        return solution

    def _along(self, abscissas: Any, state: Any, own: dict[str, Any], size: Any) -> Any:
        """(n_state, n_draw, n) at abscissas from x0 on, None where the solver does not get to their
        end.
        """
        from scipy.integrate import solve_ivp

        # evaluations of a right side in one integration: some 10,000 steps, after which there is no
        # solution
        budget = iter(range(100_000))

        def rate(at: float, y: Any) -> Any:
            if next(budget, None) is None:
                raise ValueError("too many steps")
            return self._rate(at, y.reshape(state.shape), own).ravel()

        with np.errstate(all="ignore"):
            try:
                ends, smallest = (self.x0, float(abscissas[-1])), _TOLERANCE * size.ravel()
                solved = solve_ivp(
                    rate,
                    ends,
                    state.ravel(),
                    method=self.method,
                    t_eval=abscissas,
                    rtol=_TOLERANCE,
                    atol=smallest,
                )
            except ValueError:  # of a solver that meets infinite numbers, or of too many steps
                return None
        return (
            solved.y.reshape(*state.shape, abscissas.size)
            if solved.status == 0 and all_finite(solved.y)
            else None
        )


def ode(
    rhs: Callable[..., Any],
    start: Sequence[float | str],
    *,
    x0: float = 0.0,
    observed: int | Callable[..., Any] = 0,
    method: Method = "DOP853",
) -> OdeCurve:
    """The curve that dy/dx = rhs(x, y, **parameters) gives, for `fit_curve(ode(...), x, y,
    start={...})`.

    rhs : function of x, the state y (n_state,) and parameters by name, which returns dy/dx
        (n_state,).
    start : the state at x0, each entry a number or the name of a parameter, which rhs gets if it
        has an argument of that name.
    observed : which entry of the state is measured, or a function of x (n_obs,), the states
        (n_state, n_obs) and the parameters of rhs.
    method : of `scipy.integrate.solve_ivp`; "Radau" or "BDF" for stiff equations.  Relative
        tolerance 1e-10.

    Raises InputError where an argument breaks a rule.

    >>> from estim import fit_curve, ode
    >>> decay = ode(lambda x, y, k: [-k * y[0]], ["y0"])
    >>> fit = fit_curve(decay, [0, 1, 2, 3], [8, 4, 2, 1], u_y=0.1, start={"k": 1, "y0": 5})
    >>> round(fit.values["k"], 3)  # log 2
    0.693
    """
    if not callable(rhs):
        raise InputError("must be a function rhs(x, y, **parameters)", field="rhs", value=rhs)
    entries = list(start) if isinstance(start, Sequence) and not isinstance(start, str) else []
    if not entries or not all(
        isinstance(entry, str) or (isinstance(entry, int | float) and math.isfinite(entry))
        for entry in entries
    ):
        raise InputError(
            'must be the state at x0, numbers or names of parameters, like ["s0", 0.0]',
            field="start",
            value=start,
        )
    if not callable(observed) and observed not in range(len(entries)):
        raise InputError(
            f"must be a function or the number of an entry of the state, 0 to {len(entries) - 1}",
            field="observed",
            value=observed,
        )
    if not isinstance(x0, int | float) or not math.isfinite(x0):
        raise InputError("must be finite", field="x0", value=x0)
    if method not in ("DOP853", "RK45", "Radau", "BDF"):
        raise InputError("must be DOP853, RK45, Radau or BDF", field="method", value=method)
    return OdeCurve(
        rhs,
        tuple(entry if isinstance(entry, str) else float(entry) for entry in entries),
        float(x0),
        observed,
        method,
    )
