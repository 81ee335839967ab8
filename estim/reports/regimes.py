"""The report of a map of motions: `report.md`, `result.json` and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from estim.arrays import FloatArray
from estim.campaign import Campaign
from estim.common import as_json, decide, format_quantity, kind_words, later, one_line, phrase, signed
from estim.line import ThetaMinSeries
from estim.reports.kept_fit import fitted_values as fitted_values
from estim.reports.pages import page
from estim.reports.regime_figures import reach_figure, regime_figure
from estim.reports.regime_words import place_words
from estim.reports.rendering import render
from estim.reports.result import Provenance, provenance
from estim.sampling import number
from estim.studies import BodyMap, RunPlace
from estim.words import STATUS_WORDS, Voice, advice_for, tell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAP_SCHEMA = "estim-map/1"
_DEGREES = float(np.degrees(1.0))
_ROWS = 7  # tilts in a table, at most
_TILT_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
_ORIGINS = {
    "asked": later("as asked for"), "stated": later("ramp_length_m less ramp_start_m"),
}


class Spread(msgspec.Struct, frozen=True):
    """Median, 68 and 95 % interval."""

    median: float | None
    low_68: float | None
    high_68: float | None
    low_95: float | None
    high_95: float | None


class TiltOnMap(msgspec.Struct, frozen=True):
    """What the body does at one tilt.  Angles of release in rad, distances in m; null where there is none."""

    phi: float
    least: Spread  # angle of release from which it sets off
    largest: Spread
    rolls_on_up_to: Spread | None  # from the least angle to here it rolls over the top and on
    passes_up_to: Spread | None  # and to here it passes the end of the ramp
    farthest: Spread | None  # how far it gets, released at the least angle; null where it may roll on


class RunOnMap(msgspec.Struct, frozen=True):
    """Where a run lies and what follows; angles in rad, distances in m, probabilities."""

    phi: float
    u_phi: float
    theta0: float
    u_theta0: float
    sets_off: float
    turning_point: Spread
    recorded: float  # how far the recording goes
    turned: bool  # whether it turns there
    agreement: float  # probability to get as far, two-sided where it turned
    words: str


class BodyOnMap(msgspec.Struct, frozen=True):
    """The map of one body."""

    ramp_end: float  # m from the release
    ramp_end_origin: str
    steepest: Spread  # rad, the tilt beyond which it climbs from no angle
    tilts: list[TiltOnMap]
    runs: dict[str, RunOnMap]
    left_out: list[str]


class MapResult(msgspec.Struct, frozen=True, rename={"schema_": "schema"}):
    """Everything of `estim map`; the report prints from it."""

    schema_: str
    title: str
    kind: str
    status: str
    reasons: list[str]
    advice: list[str]
    fitted: str | None  # the fit that the values come from; null where they are as stated
    bodies: dict[str, BodyOnMap]
    provenance: Provenance


def map_result(campaign: Campaign, maps: Sequence[BodyMap], *, seed: int, voice: Voice = Voice.PYTHON) -> MapResult:
    """The record of maps."""
    findings = [finding for found in maps for finding in found.findings]
    fitted = maps[0].known.fitted
    return MapResult(
        MAP_SCHEMA, campaign.title, campaign.kind, decide(findings), list(map(tell, findings)), advice_for(findings, voice),
        None if fitted is None else one_line(fitted.place), {found.body: _body(found) for found in maps},
        provenance(campaign, [place.run for found in maps for place in found.runs], seed),
    )


def map_report(
    campaign: Campaign, maps: Sequence[BodyMap], line: ThetaMinSeries | None, *, seed: int, voice: Voice = Voice.PYTHON, figures: bool = True
) -> dict[str, bytes]:
    """`report.md`, `result.json` and the figures of each body.  line : measured least angles, of one body."""
    result = map_result(campaign, maps, seed=seed, voice=voice)
    drawers: dict[str, Callable[[], Figure]] = {}
    for found in maps:
        own = line if line is not None and line.body == found.body else None
        drawers[f"figures/map-{found.body}.png"] = partial(regime_figure, found, own)
        if found.uphill:
            drawers[f"figures/reach-{found.body}.png"] = partial(reach_figure, found)
    text = partial(
        render, "map.md.j2", result=result, kind=kind_words(campaign.kind), status_words=STATUS_WORDS,
        parts=[(found, result.bodies[found.body], _tilt_rows(result.bodies[found.body])) for found in maps],
        origins={origin: phrase(words) for origin, words in _ORIGINS.items()},
        spread=_spread_words, degrees=_degrees, line_body=None if line is None else line.body,
        way=_way_words,
    )
    return page(drawers, text, wanted=figures, kind=campaign.kind) | {"result.json": as_json(result)}


def _way_words(found: BodyMap) -> dict[str, str]:
    """What tables and captions call the end of the ramp, or of the recorded way in its place."""
    if found.end.origin == "recorded":
        return {
            "passes": phrase("passes the end of the recorded way up to (°)"),
            "against": phrase("Against the length of the recorded way."),
        }
    return {
        "passes": phrase("passes the end of the ramp up to (°)"),
        "against": phrase("Against the length of the ramp."),
    }


def map_lines(found: BodyMap) -> list[str]:
    """A line a run for a terminal."""
    return [place_words(found, place) for place in found.runs]


def _body(found: BodyMap) -> BodyOnMap:
    return BodyOnMap(
        found.end.length, found.end.origin, _spread(found.steepest), [_tilt(found, phi) for phi in _tilts(found)],
        {place.run: _run(found, place) for place in found.runs}, list(found.left_out),
    )


def _tilts(found: BodyMap) -> FloatArray:
    """Round tilts of a table, rad."""
    low, high = found.phi[0] * _DEGREES, found.phi[-1] * _DEGREES
    step = next((step for step in _TILT_STEPS if (high - low) / step < _ROWS), _TILT_STEPS[-1])
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step / _DEGREES


def _tilt(found: BodyMap, phi: float) -> TiltOnMap:
    def at(border: FloatArray, places: FloatArray) -> Spread:
        with np.errstate(invalid="ignore"):
            return _spread(np.array([np.interp(phi, places, level) for level in border]))

    lowest, on, passes = (at(border, found.phi) for border in (found.lowest, found.rolls_on, found.passes))
    sets_off = bool(np.interp(phi, found.phi, found.highest[2] - found.lowest[2]) > 1e-6)
    some_on = sets_off and bool(np.interp(phi, found.phi, found.rolls_on[4] - found.lowest[4]) > 1e-6)
    some_pass = sets_off and bool(np.interp(phi, found.phi, found.passes[2] - found.rolls_on[2]) > 1e-6)
    farthest = at(found.farthest, found.far_phi)
    return TiltOnMap(
        float(phi), lowest if sets_off else _NOWHERE, at(found.highest, found.phi) if sets_off else _NOWHERE, on if some_on else None,
        passes if some_pass else None, farthest if farthest.high_95 is not None and sets_off and phi >= 0.0 else None,
    )


def _spread(quantiles: FloatArray) -> Spread:
    low_95, low_68, median, high_68, high_95 = (number(float(value)) for value in quantiles)
    return Spread(median, low_68, high_68, low_95, high_95)


_NOWHERE = Spread(None, None, None, None, None)


def _run(found: BodyMap, place: RunPlace) -> RunOnMap:
    return RunOnMap(
        *place.phi, *place.theta0, place.sets_off, _spread(place.stop), place.farthest, place.turned, place.agrees, place_words(found, place),
    )


def _degrees(spread: Spread | None) -> str:
    """Median and 68 % half-width of an angle as degrees."""
    return _spread_words(spread, _DEGREES)


def _spread_words(spread: Spread | None, factor: float = 1.0) -> str:
    if spread is None or spread.median is None or spread.low_68 is None or spread.high_68 is None:
        return "—"
    return signed(format_quantity(factor * spread.median, 0.5 * factor * (spread.high_68 - spread.low_68)))


def _tilt_rows(body: BodyOnMap) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for tilt in body.tilts:
        passes = tilt.passes_up_to
        rows.append((
            signed(f"{tilt.phi * _DEGREES:.3g}"), _degrees(tilt.least), _degrees(tilt.largest), _degrees(tilt.rolls_on_up_to), _degrees(passes),
            _spread_words(tilt.farthest),
        ))  # fmt: skip
    return rows
