"""One thing that might be measured: what it would do to the standard deviations that matter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, diagonal_scale
from estim.common import InputError, phrase
from estim.planning.candidates import Change
from estim.planning.planned_readings import Basis
from estim.planning.rolling import Outlook
from estim.problem import Parameter


@dataclass(frozen=True, eq=False)
class Option:
    """A change and its expected effect.

    u : (n_target,) expected standard deviations; empty where it cannot be measured, for the
        `reason`.
    ratio : (n_target,) of these to the present ones.
    remarks : notes for a reader.
    """

    change: Change
    u: FloatArray
    ratio: FloatArray
    reason: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def score(self) -> float:
        """Geometric mean of the ratios: what options are ranked by."""
        return float(np.exp(np.mean(np.log(self.ratio))))


def weigh(basis: Basis, change: Change, targets: Sequence[Parameter], now: FloatArray) -> Option:
    """What the change would do to standard deviations that are `now` (n_target,)."""
    try:
        outlook = basis.outlook(change)
        u = sds_with(outlook, change.u, targets)
    except InputError as error:
        return Option(
            change,
            np.array([]),
            np.array([]),
            phrase(error.rule) if not error.value else f"{error.field}: {phrase(error.rule)}",
        )
    return Option(change, u, u / now, remarks=outlook.remarks)


def sds_with(outlook: Outlook, u: Mapping[str, float], targets: Sequence[Parameter]) -> FloatArray:
    """(n_target,) standard deviations where quantities are stated with the uncertainties `u` in
    place of their own.

    Raises InputError where the targets are not determined.
    """
    information = outlook.information.copy()
    for name, sd in u.items():
        i = outlook.problem.names.index(name)
        prior = outlook.problem.parameters[i].prior
        stated = prior.residual_slope(float(outlook.values[i])) if prior.measured else 0.0
        information[i, i] += 1.0 / sd**2 - stated**2
    return sds_by(information, [outlook.problem.names.index(p.name) for p in targets])


def sds_by(information: FloatArray, columns: Sequence[int]) -> FloatArray:
    """(n,) standard deviations of the parameters in `columns`.  Raises InputError where they are
    not determined.
    """
    scale = diagonal_scale(information)
    try:
        lower = np.linalg.cholesky(information / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise InputError(
            "data and what is stated do not determine every unknown", field="plan"
        ) from None
    inverse = np.linalg.inv(lower)
    return np.sqrt(np.sum(np.square(inverse), axis=0))[list(columns)] / scale[list(columns)]
