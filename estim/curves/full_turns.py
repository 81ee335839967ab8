"""Limits of a phase that hold a full turn.

They exclude no curve.  Kept, they would cut the phase's interval where it is near one of them, and
where a period makes the phase turn (all x far from 0) all but a stripe of the ridge, and with it
the interval of the period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray, all_finite, max_abs
from estim.common import phrase
from estim.problem import TURNS, Curve, Flat, Parameter

_WHOLE = 0.999  # of a turn: who writes 6.28 or 3.14 means one
_SAME, _MOVED = 1e-9, 1e-6  # of the size of the curve
_ASIDE, _N_PLACE = 0.382, 16  # of a turn: no simple share; places at which curves are compared


def without_full_turns(
    curve: Curve, x: FloatArray, values: Mapping[str, float], parameters: Sequence[Parameter]
) -> tuple[tuple[Parameter, ...], tuple[str, ...]]:
    """The parameters, phases without such limits, and notes on those left out.

    x : (n_obs,).  values : of all arguments of the curve, about which it is tried.
    """
    free, notes = [], []
    for parameter in parameters:
        prior, name = parameter.prior, parameter.name
        if isinstance(prior, Flat) and prior.proper:
            width = prior.high - prior.low
            periods = [turn for turn in TURNS if _WHOLE * turn <= width]
            if any(_repeats(curve, x, values, name, turn) for turn in periods):
                parameter = replace(parameter, prior=replace(prior, low=-math.inf, high=math.inf))
                notes.append(
                    phrase(
                        "the limits of {name} hold a full turn, exclude no curve, and are not used",
                        name=name,
                    )
                )
        free.append(parameter)
    return tuple(free), tuple(notes)


def _repeats(
    curve: Curve, x: FloatArray, values: Mapping[str, float], name: str, turn: float
) -> bool:
    """Whether the curve is the same a turn of `name` farther, and another one part of the way."""
    rng = np.random.default_rng(1)
    for _ in range(3):
        at = {key: value * math.exp(0.2 * rng.standard_normal()) for key, value in values.items()}
        # between the points, too: an alias repeats at them alone
        abscissas = rng.uniform(np.min(x), np.max(x), _N_PLACE)
        unshifted, shifted, part_way = (
            curve.value(abscissas, {**at, name: at[name] + step})
            for step in (0.0, turn, _ASIDE * turn)
        )
        size = max_abs(unshifted)
        if not (
            all_finite(unshifted, shifted, part_way)
            and max_abs(shifted - unshifted) <= _SAME * size
            and max_abs(part_way - unshifted) > _MOVED * size
        ):
            return False
    return True
