"""A run on the map of motions in one sentence, for the report and the terminal."""

from __future__ import annotations

import numpy as np

from estim.common import format_quantity, phrase
from estim.studies import BodyMap, RunPlace
from estim.words import sure


def place_words(found: BodyMap, place: RunPlace) -> str:
    """What a run should do, and what its recording shows."""
    said = [f"{place.run}: {_start_words(place)}"]
    if place.sets_off >= 0.5:
        said.append(_end_words(place))
    return "; ".join([*said, _recording_words(place, as_it_may=not found.known.fitted)])


def _start_words(place: RunPlace) -> str:
    uphill, chance = place.phi[0] >= 0.0, sure(place.sets_off)
    if place.sets_off < 0.5:
        return (
            phrase("does not climb (it does with {chance})", chance=chance) if uphill
            else phrase("does not set off downhill (it does with {chance})", chance=chance)
        )
    return phrase("climbs ({chance})", chance=chance) if uphill else phrase("rolls down ({chance})", chance=chance)


def _end_words(place: RunPlace) -> str:
    """Where it turns."""
    if not np.isfinite(place.stop[2]):
        return phrase("and on for ever")
    return phrase("turns at {at} m", at=format_quantity(float(place.stop[2]), float(0.5 * (place.stop[3] - place.stop[1]))))


def _recording_words(place: RunPlace, *, as_it_may: bool) -> str:
    at, chance = place.farthest, sure(place.agrees)
    if place.turned:
        return phrase("its recording turns at {at:.3g} m, as it may ({chance})", at=at, chance=chance) if as_it_may else phrase(
            "its recording turns at {at:.3g} m", at=at
        )
    return phrase("its recording goes to {at:.3g} m, as it may ({chance})", at=at, chance=chance) if as_it_may else phrase(
        "its recording goes to {at:.3g} m", at=at
    )
