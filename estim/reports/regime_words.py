"""A run on the map of motions in one sentence, for the report and the terminal."""

from __future__ import annotations

import numpy as np

from estim.common import format_quantity
from estim.studies import BodyMap, RunPlace
from estim.words import sure


def place_words(found: BodyMap, place: RunPlace) -> str:
    """What a run should do, and what its recording shows."""
    uphill = place.phi[0] >= 0.0
    starts = "climbs" if uphill else "rolls down"
    said = [f"{place.run}: {starts} ({sure(place.sets_off)})"]
    if place.sets_off < 0.5:
        said = [f"{place.run}: does not {'climb' if uphill else 'set off downhill'} (it does with {sure(place.sets_off)})"]
    elif np.isfinite(place.stop[2]):
        u = 0.5 * (place.stop[3] - place.stop[1])
        on, past = f"on the {found.end.of} ({sure(place.on_ramp)})", f"beyond the end of the {found.end.of} ({sure(place.passes)})"
        where = on if place.on_ramp >= 0.5 else past
        said.append(f"turns at {format_quantity(float(place.stop[2]), float(u))} m, {where}")
    else:
        said.append(f"and on for ever ({sure(place.rolls_on)})")
    if place.sets_off >= 0.5:
        said.append(_friction_words(place))
    shows = "turns at" if place.turned else "goes to"
    said.append(f"its recording {shows} {place.farthest:.3g} m" + ("" if found.known.fitted else f", as it may ({sure(place.agrees)})"))
    return "; ".join(said)


def _friction_words(place: RunPlace) -> str:
    if np.isinf(place.needed[0]):
        return f"would hop ({sure(place.hops)})"
    enough = "no friction is enough with 95 %" if np.isinf(place.needed[1]) else f"{place.needed[1]:.2g} is enough with 95 %"
    rolls = "" if np.isnan(place.rolls) else f", the stated one is with {sure(place.rolls)}"
    return f"needs a friction of {place.needed[0]:.2g} ({enough}{rolls})"
