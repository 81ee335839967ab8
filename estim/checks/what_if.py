"""What an error that no residual can show would do to the result: a clock, a scale, a ramp that sags, a value taken as exact.

To first order an error that moves the residuals by d moves the mode by

    -(J^T J)^-1 J^T d,        J the Jacobian of the residuals of data and priors,

the linear response of least squares.  Told in posterior standard deviations: more than half of one, and the result is only as good as
what is known of that input.  The errors belong to what was measured (`Observations.errors_in_common`); values taken as exact to the campaign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.fitting import Fit, curve_indices

TOLD_FROM = 0.5  # posterior standard deviations


@dataclass(frozen=True)
class Influence:
    """One input that the data cannot check.

    what : the error, in words ("1 % of the clock").  runs : those that it concerns.
    shifts : parameter -> how far it moves, in posterior standard deviations.
    """

    what: str
    runs: tuple[str, ...]
    shifts: Mapping[str, float]

    @property
    def strongest(self) -> str:
        """The parameter that moves most."""
        return max(self.shifts, key=lambda name: abs(self.shifts[name]))

    @property
    def largest(self) -> float:
        return abs(self.shifts[self.strongest])


def influences(fit: Fit) -> tuple[Influence, ...]:
    """What each error in common to the data would do, the strongest first; none where the fit has no standard deviations."""
    inside = [i for i in curve_indices(fit.problem) if np.isfinite(fit.sds[i])]
    if fit.singular or not inside:
        return ()
    jacobian = fit.posterior.jacobian(fit.values)
    named = fit.problem.named(fit.values)
    moved: dict[str, dict[int, FloatArray]] = {}
    for number, run in enumerate(fit.problem.runs):
        for error in run.errors_in_common(run.bind(named)):
            moved.setdefault(error.what, {})[number] = error.shift
    found = [_influence(fit, what, shifts, jacobian, inside) for what, shifts in moved.items()]
    return tuple(sorted(found, key=lambda influence: -influence.largest))


def _influence(fit: Fit, what: str, shifts: Mapping[int, FloatArray], jacobian: FloatArray, inside: Sequence[int]) -> Influence:
    """`shifts` : number of a run -> (n_obs,) by how much its residuals y - f(x) grow."""
    change = np.zeros(jacobian.shape[0])
    start = 0
    for number, run in enumerate(fit.problem.runs):
        if number in shifts:
            change[start : start + run.n_obs] = fit.posterior.whitened(number, shifts[number], fit.values)
        start += run.n_obs
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = 1.0
    step = np.linalg.lstsq(jacobian / scale, -change, rcond=None)[0] / scale
    names = [fit.names[i] for i in inside]
    return Influence(what, tuple(fit.problem.runs[number].name for number in shifts), dict(zip(names, (step / fit.sds)[inside].tolist(), strict=True)))
