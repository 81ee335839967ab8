"""The report of a map of motions: `report.md`, `result.json` and figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import Campaign
from estim.common import (
    FigureChoice,
    Files,
    Json,
    Notation,
    PhraseTable,
    decide,
    format_quantity,
    later,
    phrase,
    signed,
)
from estim.drawing import (
    BLUE,
    GREEN,
    INK,
    MARKS,
    Axes,
    Figure,
    draw_bands,
    legend_below,
    new_figure,
)
from estim.line import ThetaMinSeries
from estim.reports.pages import Drawers, page
from estim.reports.result import provenance
from estim.studies.regimes import BodyMap
from estim.studies.run_places import RunPlace
from estim.words import advice_for, describe, sure

_DEGREES = float(np.degrees(1.0))
_TILT_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
_ORIGINS = PhraseTable({"asked": "as specified", "stated": "ramp_length_m minus ramp_start_m"})
_STILL, _TURNS, _PASSES, _ROLLS = "#E4E4E4", "#D6E9F5", "#FBE3B3", "#C9E8DC"
_DARK_VERMILION = "#B34700"
_NEAR = 0.1  # of the axis of tilts, half as much of the other: runs nearer than this have one label
_NAMED = 4  # names in one label
_ROOM = 0.14, 0.1  # that one takes beside and above its run, of both axes
_THETA_MIN = Notation("θ_min").label("rad").tex
_ENDS = {
    "turns": {
        "ramp": later("turns back at the end of the ramp ({m:.3g} m)"),
        "recorded way": later("turns back at the end of the recorded path ({m:.3g} m)"),
    },
    "climbs on": {
        "ramp": later("climbs and turns back on the ramp"),
        "recorded way": later("climbs and turns back on the recorded path"),
    },
    "turns on": {
        "ramp": later("turns back on the ramp"),
        "recorded way": later("turns back on the recorded path"),
    },
    "climbs past": {
        "ramp": later("climbs past the end of the ramp"),
        "recorded way": later("climbs past the end of the recorded path"),
    },
    "turns beyond": {
        "ramp": later("turns back only beyond the end of the ramp"),
        "recorded way": later("turns back only beyond the end of the recorded path"),
    },
}


def map_result(campaign: Campaign, maps: Sequence[BodyMap], *, seed: int) -> Json:
    """Everything of `estim map`, as `result.json` has it; the report prints from it.

    Angles in rad, distances in m; null where there is none.
    """
    findings = [finding for body_map in maps for finding in body_map.findings]
    return {
        "schema": "estim-map/1",
        "title": campaign.title,
        "kind": campaign.kind,
        "status": decide(findings),
        "reasons": list(map(describe, findings)),
        "advice": advice_for(findings),
        "bodies": {body_map.body: _body(body_map) for body_map in maps},
        "provenance": provenance(
            campaign, [place.run for body_map in maps for place in body_map.runs], seed
        ),
    }


def map_report(
    campaign: Campaign,
    maps: Sequence[BodyMap],
    line: ThetaMinSeries | None,
    *,
    seed: int,
    figures: FigureChoice,
) -> Files:
    """`report.md`, `result.json` and the figures of each body.  line : measured least angles, of
    one body.
    """
    result = map_result(campaign, maps, seed=seed)
    drawers: Drawers = {
        f"figures/map-{body_map.body}.png": partial(
            regime_figure,
            body_map,
            line if line is not None and line.body == body_map.body else None,
        )
        for body_map in maps
    }
    return page(
        drawers,
        "map.md.j2",
        {"result.json": result},
        figure_choice=figures,
        kind=campaign.kind,
        result=result,
        parts=[(body_map, result["bodies"][body_map.body]) for body_map in maps],
        origins=_ORIGINS,
        spread=_spread_words,
        degrees=partial(_spread_words, factor=_DEGREES),
        per_radian=_DEGREES,
        line_body=None if line is None else line.body,
    )


def _body(body_map: BodyMap) -> Json:
    return {
        "ramp_end": body_map.end.length,  # from the release
        "ramp_end_origin": body_map.end.origin,
        "steepest": _spread(body_map.steepest),  # the tilt beyond which it climbs from no angle
        "tilts": [_tilt(body_map, phi) for phi in _tilts(body_map)],
        "runs": {place.run: _run(place) for place in body_map.runs},
        "left_out": body_map.left_out,
    }


def _tilts(body_map: BodyMap) -> FloatArray:
    """Round tilts of a table, rad."""
    low, high = body_map.phi[0] * _DEGREES, body_map.phi[-1] * _DEGREES
    # tilts in a table, at most
    step = next((step for step in _TILT_STEPS if (high - low) / step < 7), _TILT_STEPS[-1])
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step / _DEGREES


def _tilt(body_map: BodyMap, phi: float) -> Json:
    """What the body does at one tilt."""

    def at(border: FloatArray, places: FloatArray) -> dict[str, float]:
        with np.errstate(invalid="ignore"):
            return _spread(np.array([np.interp(phi, places, level) for level in border]))

    def exceeds(above: FloatArray, below: FloatArray) -> bool:
        return bool(np.interp(phi, body_map.phi, above - below) > 1e-6)

    lowest, on, passes = (
        at(border, body_map.phi) for border in (body_map.lowest, body_map.rolls_on, body_map.passes)
    )
    sets_off = exceeds(body_map.highest[2], body_map.lowest[2])
    some_on = sets_off and exceeds(body_map.rolls_on[4], body_map.lowest[4])
    some_pass = sets_off and exceeds(body_map.passes[2], body_map.rolls_on[2])
    farthest = at(body_map.farthest, body_map.far_phi)
    nothing = _spread(np.full(5, np.nan))
    return {
        "phi": phi,
        # angles of release between which it sets off
        "least": lowest if sets_off else nothing,
        "largest": at(body_map.highest, body_map.phi) if sets_off else nothing,
        # from the least angle to here it rolls over the top and on
        "rolls_on_up_to": on if some_on else None,
        # and to here it passes the end of the ramp
        "passes_up_to": passes if some_pass else None,
        # how far it gets, released at the least angle; null where it may roll on
        "farthest": farthest
        if math.isfinite(farthest["high_95"]) and sets_off and phi >= 0.0
        else None,
    }


def _spread(quantiles: FloatArray) -> dict[str, float]:
    """Median, 68 and 95 % interval of `quantiles` (5,) at `QUANTILES`."""
    low_95, low_68, median, high_68, high_95 = quantiles.tolist()
    return {
        "median": median,
        "low_68": low_68,
        "high_68": high_68,
        "low_95": low_95,
        "high_95": high_95,
    }


def _run(place: RunPlace) -> Json:
    """Where a run lies and what follows."""
    return {
        "phi": place.phi[0],
        "u_phi": place.phi[1],
        "theta0": place.theta0[0],
        "u_theta0": place.theta0[1],
        "sets_off": place.sets_off,  # probability
        "turning_point": _spread(place.stop),
        "recorded": place.farthest,  # how far the recording goes
        "turned": place.turned,  # whether it turns there
        # probability to get as far, two-sided where it turned
        "agreement": place.agrees,
        "words": place_words(place),
    }


def _spread_words(spread: Mapping[str, float] | None, factor: float = 1.0) -> str:
    """Median and 68 % half-width, in units of which one of its own has `factor`."""
    width = factor * (math.nan if spread is None else spread["high_68"] - spread["low_68"])
    if spread is None or not math.isfinite(width):
        return "—"
    return signed(format_quantity(factor * spread["median"], 0.5 * width))


def regime_figure(body_map: BodyMap, line: ThetaMinSeries | None) -> Figure:
    """What the body does, over tilt and angle of release; the distance to the turning point as
    contours in m.
    """
    figure = new_figure(6.2)
    ax = figure.subplots()
    _zones(ax, body_map)
    _distances(ax, body_map)
    _borders(ax, body_map)
    if line is not None:
        _line_points(ax, line)
    _frame(ax, body_map)
    _runs(ax, body_map)
    legend_below(figure, ncols=2)
    return figure


def _frame(ax: Axes, body_map: BodyMap) -> None:
    from matplotlib.ticker import MultipleLocator

    along = phrase("tilt φ (°), uphill positive" if body_map.downhill else "tilt φ (°)")
    ax.set(xlabel=along, ylabel=phrase("angle of release θ₀ (°)"))
    ax.set_xlim(body_map.phi[0] * _DEGREES, body_map.phi[-1] * _DEGREES)
    ax.set_ylim(*(end * _DEGREES for end in body_map.theta0_range))
    ax.yaxis.set_major_locator(MultipleLocator(30.0))
    ax.set_title(body_map.body)


def _zones(ax: Axes, body_map: BodyMap) -> None:
    """What the body does, by colour; where it does not start as asked, the background."""
    ax.set_facecolor(_STILL)
    still = phrase(
        "starts uphill instead, or does not move"
        if not body_map.uphill
        else "starts in the other direction"
        if body_map.downhill
        else "rolls down, or does not move"
    )
    ax.fill([], [], color=_STILL, label=still)
    phi, lowest, highest, on, passes = (
        body_map.phi * _DEGREES,
        *(
            b[2] * _DEGREES
            for b in (body_map.lowest, body_map.highest, body_map.rolls_on, body_map.passes)
        ),
    )
    turns = _ENDS["turns on" if body_map.downhill else "climbs on"][body_map.end.of]
    beyond = _ENDS["turns beyond" if body_map.downhill else "climbs past"][body_map.end.of]
    for low, high, colour, words in (
        (passes, highest, _TURNS, turns),
        (on, passes, _PASSES, beyond),
        (lowest, on, _ROLLS, later("rolls on without end")),
    ):
        ax.fill_between(
            phi,
            low,
            high,
            where=high > low,
            color=colour,
            zorder=0.5,
            interpolate=True,
            label=phrase(words) if np.any(high > low) else None,
        )


def _borders(ax: Axes, body_map: BodyMap) -> None:
    if np.any(body_map.passes[2] > body_map.rolls_on[2]):
        border = np.where(body_map.passes > body_map.rolls_on, body_map.passes, np.nan)
        turns = phrase(_ENDS["turns"][body_map.end.of], m=body_map.end.length)
        _band(ax, body_map.phi, border, _DARK_VERMILION, turns)
    if body_map.downhill:
        rolls = (body_map.rolls_on > body_map.lowest) & (body_map.rolls_on < body_map.highest)
        over = phrase("just gets over the top, and rolls on") if np.any(rolls[2]) else ""
        _band(ax, body_map.phi, np.where(rolls, body_map.rolls_on, np.nan), GREEN, over)
    limits = phrase(
        "smallest and largest angle to start, with 68 and 95 %"
        if body_map.downhill
        else "smallest and largest angle to climb, with 68 and 95 %"
    )
    _band(ax, body_map.phi, body_map.lowest, INK, limits)
    _band(ax, body_map.phi, body_map.highest, INK)


def _band(ax: Axes, phi: FloatArray, border: FloatArray, colour: str, name: str = "") -> None:
    """A border with its 68 and 95 % bands; its line where half of the draws have it.  border : (5,
    n_phi) rad.
    """
    degrees = border * _DEGREES
    # of a body without a heavy side, which sets off from every angle or from none
    jump = np.flatnonzero(np.abs(np.diff(border[2])) > 2.0)
    for at in jump:
        ax.axvline(phi[at] * _DEGREES, color=colour, zorder=2.5)
    # it is nowhere
    flat = np.isclose(np.abs(degrees[2] - 90.0), 0.0) | np.isclose(np.abs(degrees[2] - 90.0), 180.0)
    degrees[2, flat] = np.nan
    draw_bands(ax, phi * _DEGREES, degrees, colour, median=name, label=None, zorder=2.0)


def _distances(ax: Axes, body_map: BodyMap) -> None:
    """From where it turns after so many metres, each line with its number."""
    phi = body_map.phi * _DEGREES
    for i, (stop, release) in enumerate(zip(body_map.stops, body_map.contours, strict=True)):
        finite = np.flatnonzero(np.isfinite(release))
        if finite.size < 2:
            continue
        ax.plot(
            phi,
            release * _DEGREES,
            color=BLUE,
            lw=0.8,
            zorder=1.5,
            label=phrase("turns back after this distance (m)"),
        )
        if finite.size > 0.06 * phi.size:
            usual = finite[int((0.35 + 0.12 * (i % 2)) * finite.size)]
            free = [j for j in finite if not _has_name(body_map, body_map.phi[j], release[j])]
            at = min(free or [usual], key=lambda j: abs(j - usual))
            ax.text(
                phi[at],
                release[at] * _DEGREES,
                f"{stop:.3g}",
                color=BLUE,
                ha="center",
                va="center",
                zorder=1.6,
                clip_on=True,
                bbox={"fc": _TURNS, "ec": "none", "pad": 0.6},
            )


def _has_name(body_map: BodyMap, phi: float, theta0: float) -> bool:
    """Whether the name of a run may cover a number here."""
    width, height = np.ptp(body_map.phi), body_map.theta0_range[1] - body_map.theta0_range[0]
    return any(
        abs(phi - place.phi[0]) < _ROOM[0] * width
        and -0.5 * _ROOM[1] < (theta0 - place.theta0[0]) / height < _ROOM[1]
        for place in body_map.runs
    )


def _line_points(ax: Axes, line: ThetaMinSeries) -> None:
    ax.errorbar(
        line.phi * _DEGREES,
        line.theta_min * _DEGREES,
        line.u_theta_min * _DEGREES,
        line.u_phi * _DEGREES,
        "s",
        color=_DARK_VERMILION,
        mfc="white",
        zorder=4,
        label=phrase("{theta_min} as measured", theta_min=_THETA_MIN),
    )


def _runs(ax: Axes, body_map: BodyMap) -> None:
    """Error bars of the runs; runs near each other have one label, on the side where there is
    room.
    """
    width, height = np.ptp(body_map.phi), body_map.theta0_range[1] - body_map.theta0_range[0]
    groups: list[list[RunPlace]] = []
    for i, place in enumerate(body_map.runs):
        (phi, u_phi), (theta0, u_theta0) = np.degrees([place.phi, place.theta0]).tolist()
        ax.errorbar(
            phi,
            theta0,
            u_theta0,
            u_phi,
            MARKS[i % len(MARKS)],
            color=INK,
            zorder=5,
            label=phrase("runs, with one standard uncertainty"),
        )
        near = [
            g
            for g in groups
            if abs(g[0].phi[0] - place.phi[0]) < _NEAR * width
            and abs(g[0].theta0[0] - place.theta0[0]) < 0.5 * _NEAR * height
        ]
        if near:
            near[0].append(place)
        else:
            groups.append([place])
    for group in groups:
        names = [place.run for place in group[:_NAMED]] + (
            [phrase("and {n} more", n=len(group) - _NAMED)] if len(group) > _NAMED else []
        )
        left = group[0].phi[0] > body_map.phi.mean()
        ax.annotate(
            "\n".join(names),
            (group[0].phi[0] * _DEGREES, group[0].theta0[0] * _DEGREES),
            (-6 if left else 6, 5),
            textcoords="offset points",
            ha="right" if left else "left",
            va="bottom",
            color=INK,
            zorder=7,
            bbox={"fc": "white", "ec": "none", "alpha": 0.65, "pad": 0.6},
        )


def place_words(place: RunPlace) -> str:
    """What a run should do, and what its recording shows."""
    clauses = [f"{place.run}: {_start_words(place)}"]
    if place.sets_off >= 0.5:
        clauses.append(_end_words(place))
    return "; ".join([*clauses, _recording_words(place)])


def _start_words(place: RunPlace) -> str:
    uphill, chance = place.phi[0] >= 0.0, sure(place.sets_off)
    if place.sets_off < 0.5:
        return phrase(
            "does not climb (it climbs with {chance})"
            if uphill
            else "does not start downhill (it does with {chance})",
            chance=chance,
        )
    return phrase("climbs ({chance})" if uphill else "rolls down ({chance})", chance=chance)


def _end_words(place: RunPlace) -> str:
    """Where it turns."""
    if not np.isfinite(place.stop[2]):
        return phrase("and on for ever")
    return phrase(
        "turns at {at} m",
        at=format_quantity(float(place.stop[2]), float(0.5 * (place.stop[3] - place.stop[1]))),
    )


def _recording_words(place: RunPlace) -> str:
    if place.turned:
        words = later(
            "its recording turns back at {at:.3g} m, which is compatible ({chance})"
            if not place.findings
            else "its recording turns back at {at:.3g} m"
        )
    else:
        words = later(
            "its recording extends to {at:.3g} m, which is compatible ({chance})"
            if not place.findings
            else "its recording extends to {at:.3g} m"
        )
    return phrase(words, at=place.farthest, chance=sure(place.agrees))
