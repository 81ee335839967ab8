"""One thing that may be missing: the problem with it, and the lines of a campaign that state it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import Label
from estim.fitting import Fit
from estim.problem import Problem


@dataclass(frozen=True)
class Estimated:
    """A number of a candidate in SI units, how it is shown, and its standard deviation (nan at the
    edge of what is possible, and where some values were tried).
    """

    name: str
    value: float
    sd: float
    label: Label


@dataclass(frozen=True, eq=False)
class Cause:
    """Something that the curve or the noise of a campaign lacks.

    name : short, for files; several of one name are values of a number that was `scanned`, and the
        best of them counts.
    words : what it is.
    problem : with it.
    parameters : its own.  lines : to be added to the campaign, the first a table.  remark : where
        no line states it.
    begin : value of its parameters at which a search starts, where 0 is possible.
    searched : how much a gain is less because the best of many positions was searched for.
    posed : makes the problem of the campaign with its lines, with all that a fit of the campaign
        has room for; None where no lines state it.
    slip : whether it is no physics, but another reading of what was stated: reported only where it
        is found, and then before others that do as well.
    """

    name: str
    words: str
    problem: Problem
    parameters: tuple[str, ...]
    lines: tuple[str, ...]
    remark: str = ""
    scanned: Estimated | None = None
    searched: float = 0.0
    begin: float = 0.0
    slip: bool = False
    posed: Callable[[], Problem] | None = None

    @property
    def n_number(self) -> int:
        """How many numbers are adjusted beside those of the plain fit."""
        return max(len(self.parameters), 1)

    def starting(self, base: Fit) -> FloatArray:
        """(n_par,) where a search starts: the mode without it, and its own parameters at `begin`,
        or at a tenth of their sd where 0 is an edge.

        A slip starts afresh, from the centres of the priors: what was fitted under a wrong number
        is far off.
        """
        if self.slip:
            return self.problem.start()
        known = dict(zip(base.names, base.values, strict=True))
        return np.array(
            [
                known.get(p.name, 0.1 * p.prior.sd if p.prior.low == 0.0 else self.begin)
                for p in self.problem.parameters
            ]
        )


@dataclass(frozen=True, eq=False)
class Suspects:
    """plain : runs with their stated noise, and nothing that a curve may lack.  causes : the same
    with one thing more each.

    room : what of a campaign has room for a smooth disturbance that has no key.
    """

    plain: Problem
    room: str
    causes: tuple[Cause, ...] = ()
