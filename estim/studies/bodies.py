"""Bodies from their parts: values by linear propagation and by Monte Carlo, which of them to
believe, correlations and budgets.

All bodies of a file are propagated together, so that what two of them share moves both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import BoolArray, FloatArray
from estim.campaign import CampaignFile, PartedBody, correlations, known_to, notes_of, parted_bodies
from estim.common import InputError
from estim.propagation import (
    Budget,
    LinearResult,
    MonteCarloResult,
    Validation,
    budget,
    compare,
    propagate_linear,
    propagate_monte_carlo,
)


@dataclass(frozen=True, eq=False)
class BodyProperties:
    """The properties of bodies, by their parts.

    names : (body, output) of each of the (n_out,) outputs of `linear` and `sampled`.
    budgets : (n_out,), of `linear`.
    notes : cautions about the linear result.
    """

    bodies: tuple[PartedBody, ...]
    names: tuple[tuple[str, str], ...]
    linear: LinearResult
    sampled: MonteCarloResult
    validation: Validation
    budgets: tuple[Budget, ...]
    notes: tuple[str, ...]

    @property
    def linear_holds(self) -> BoolArray:
        """(n_out,) whether the linear interval is that of the draws; else believe the draws."""
        return self.validation.passes

    @property
    def u(self) -> FloatArray:
        """(n_out,) linear standard uncertainties, 0 for what is exact."""
        return known_to(self.linear.value, self.linear.u)

    @property
    def correlation(self) -> FloatArray:
        """(n_out, n_out), linear; 0 beside what is exact."""
        return correlations(self.linear.covariance)


def weigh(source: CampaignFile, *, rng: np.random.Generator) -> BodyProperties:
    """The bodies of a file that give `parts`.  Raises InputError where there is none, or they are
    wrong.
    """
    bodies = parted_bodies(source)
    if not bodies:
        raise InputError(
            'must hold a body with parts = ["...", ...], each a table [parts.NAME]',
            field="bodies",
            file=source.path,
        )
    inputs = list(
        {name: quantity for body in bodies for name, quantity in body.inputs.items()}.values()
    )

    def values(q: Mapping[str, Any]) -> Sequence[ArrayLike]:
        return [value for body in bodies for value in body.values(q)]

    linear = propagate_linear(values, inputs)
    sampled = propagate_monte_carlo(values, inputs, rng=rng, n_draw=400_000)
    names = tuple((body.name, out) for body in bodies for out in body.outputs)
    budgets = tuple(budget(linear, output=i) for i in range(len(names)))
    return BodyProperties(
        bodies,
        names,
        linear,
        sampled,
        compare(linear, sampled, n_digits=1),
        budgets,
        notes_of(linear, values),
    )
