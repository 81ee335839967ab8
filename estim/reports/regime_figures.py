"""Figures of the map of motions: the regimes with their borders and runs, and how far the body gets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.common import Notation, later, phrase
from estim.drawing import BLUE, GREEN, INK, MARKS, ORANGE, new_figure
from estim.line import ThetaMinSeries
from estim.studies import BodyMap, RunPlace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.container import ErrorbarContainer
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

_STILL, _TURNS, _PASSES, _ROLLS = "#E4E4E4", "#D6E9F5", "#FBE3B3", "#C9E8DC"
_VERMILION = "#B34700"
_NEAR = 0.02  # of an axis: runs nearer than this have one label
_NAMED = 4  # names in one label
_RUN = 8.5  # points
_LETTER, _LINE_HEIGHT, _GAP = 0.0125, 0.036, 0.012  # of a name, shares of the axes
_THETA_MIN = Notation("θ_min").label("rad").tex
_DEGREES = float(np.degrees(1.0))
_ENDS = {
    "turns": {"ramp": later("turns at the end of the ramp ({m:.3g} m)"), "recorded way": later("turns at the end of the recorded way ({m:.3g} m)")},
    "there": {"ramp": later("end of the ramp, {m:.3g} m"), "recorded way": later("end of the recorded way, {m:.3g} m")},
    "climbs on": {"ramp": later("climbs and turns on the ramp"), "recorded way": later("climbs and turns on the recorded way")},
    "turns on": {"ramp": later("turns on the ramp"), "recorded way": later("turns on the recorded way")},
    "climbs past": {"ramp": later("climbs past the end of the ramp"), "recorded way": later("climbs past the end of the recorded way")},
    "turns beyond": {
        "ramp": later("turns only beyond the end of the ramp"), "recorded way": later("turns only beyond the end of the recorded way"),
    },
}


def regime_figure(found: BodyMap, line: ThetaMinSeries | None) -> Figure:
    """What the body does, over tilt and angle of release; the distance to the turning point as contours in m."""
    from matplotlib.lines import Line2D

    figure = new_figure(6.2)
    ax = figure.subplots()
    _zones(ax, found)
    _distances(ax, found)
    handles: list[Patch | Line2D | ErrorbarContainer] = list(_zone_patches(found))
    for low, high, colour in _borders(found):
        _band(ax, found.phi, low, colour)
        if high is not None:
            _band(ax, found.phi, high, colour)
    limits = (
        phrase("least and largest angle to set off, with 68 and 95 %") if found.downhill
        else phrase("least and largest angle to climb, with 68 and 95 %")
    )
    handles.append(Line2D([], [], color=INK, lw=1.8, label=limits))
    if found.end.length and np.any(found.passes[2] > found.rolls_on[2]):
        said = phrase(_ENDS["turns"][found.end.of], m=found.end.length)
        handles.append(Line2D([], [], color=_VERMILION, lw=1.8, label=said))
    if found.downhill and np.any((found.rolls_on[2] > found.lowest[2]) & (found.rolls_on[2] < found.highest[2])):
        handles.append(Line2D([], [], color=GREEN, lw=1.8, label=phrase("just gets over the top, and rolls on")))
    if np.any(np.isfinite(found.contours)):
        handles.append(Line2D([], [], color=BLUE, lw=0.8, label=phrase("turns after this many m")))
    if line is not None:
        handles.append(_line_points(ax, line))
    _frame(ax, found)
    _runs(ax, found)
    handles.append(Line2D([], [], color=INK, marker="o", ls="", ms=5, label=phrase("runs, one standard uncertainty")))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def reach_figure(found: BodyMap) -> Figure:
    """How far the body gets against the tilt: the farthest from any release, and where the runs should turn, beside how far they were recorded."""
    figure = new_figure(4.6)
    ax = figure.subplots()
    phi, far = found.far_phi * _DEGREES, np.where(np.isfinite(found.farthest), found.farthest, np.nan)
    there = found.farthest[2] > 0.0
    for low, high, alpha in ((0, 4, 0.18), (1, 3, 0.35)):
        ax.fill_between(phi, np.where(far[low] > 0.0, far[low], 0.0), far[high], where=far[high] > 0.0, color=BLUE, alpha=alpha, lw=0)
    ax.plot(phi[there], far[2][there], color=BLUE, lw=1.8, label=phrase("farthest, released at the least angle; 68 and 95 %"))
    ax.axhline(found.end.length, color=_VERMILION, lw=1.8, ls="--", label=phrase(_ENDS["there"][found.end.of], m=found.end.length))
    top = found.end.length
    for i, place in enumerate(found.runs):
        at, u = place.phi[0] * _DEGREES, place.phi[1] * _DEGREES
        if np.isfinite(place.stop[2]):
            low_95, low, middle, high, high_95 = place.stop
            ax.errorbar(at, middle, xerr=u, yerr=[[middle - low], [high - middle]], fmt="o", color=INK, ms=5, capsize=0, elinewidth=2.2, zorder=5,
                        label=phrase("run: turning point expected, 68 and 95 %") if i == 0 else None)  # fmt: skip
            ax.plot([at, at], [low_95, high_95], color=INK, lw=0.9, zorder=5)
            top = max(top, high_95)
        mark = "_" if place.turned else "^"
        ax.plot(at, place.farthest, mark, color=ORANGE, mec=INK if mark == "^" else ORANGE, ms=8 if mark == "^" else 14,
                mew=0.8 if mark == "^" else 2.5, zorder=6)  # fmt: skip
        ax.annotate(place.run, (at, place.farthest), xytext=(9, -12), textcoords="offset points", fontsize=8, color=INK, zorder=7)
        top = max(top, place.farthest)
    if any(not place.turned for place in found.runs):
        ax.plot([], [], "^", color=ORANGE, mec=INK, mew=0.8, ms=8, label=phrase("recorded as far as this"))
    if any(place.turned for place in found.runs):
        ax.plot([], [], "_", color=ORANGE, ms=14, mew=2.5, label=phrase("recorded: turns here"))
    ax.set(xlabel=phrase("tilt φ (°)"), ylabel=phrase("distance from the release (m)"), xlim=(phi[0], phi[-1]), ylim=(0.0, 1.25 * top))
    ax.set_title(found.body, fontsize=10)
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _frame(ax: Axes, found: BodyMap) -> None:
    along = phrase("tilt φ (°), uphill positive") if found.downhill else phrase("tilt φ (°)")
    ax.set(xlabel=along, ylabel=phrase("angle of release θ₀ (°)"))
    ax.set_xlim(found.phi[0] * _DEGREES, found.phi[-1] * _DEGREES)
    ax.set_ylim(*(end * _DEGREES for end in found.theta0_range))
    ax.yaxis.set_ticks(np.arange(np.ceil(found.theta0_range[0] * _DEGREES / 30.0), found.theta0_range[1] * _DEGREES / 30.0 + 1e-9) * 30.0)
    ax.set_title(found.body, fontsize=10)


def _zones(ax: Axes, found: BodyMap) -> None:
    ax.set_facecolor(_STILL)
    phi, lowest, highest, on, passes = found.phi * _DEGREES, *(b[2] * _DEGREES for b in (found.lowest, found.highest, found.rolls_on, found.passes))
    for low, high, colour in ((lowest, on, _ROLLS), (on, passes, _PASSES), (passes, highest, _TURNS)):
        ax.fill_between(phi, low, high, where=high > low, color=colour, lw=0, zorder=0.5, interpolate=True)


def _zone_patches(found: BodyMap) -> Iterator[Patch]:
    from matplotlib.patches import Patch

    down = phrase("rolls down, or stays") if not found.downhill else phrase("sets off the other way")
    yield Patch(fc=_STILL, label=phrase("sets off uphill instead, or stays") if not found.uphill else down)
    if np.any(found.highest[2] > found.passes[2]):
        yield Patch(fc=_TURNS, label=phrase(_ENDS["turns on" if found.downhill else "climbs on"][found.end.of]))
    if np.any(found.passes[2] > found.rolls_on[2]):
        yield Patch(fc=_PASSES, label=phrase(_ENDS["turns beyond" if found.downhill else "climbs past"][found.end.of]))
    if np.any(found.rolls_on[2] > found.lowest[2]):
        yield Patch(fc=_ROLLS, label=phrase("rolls on for ever"))


def _borders(found: BodyMap) -> Iterator[tuple[FloatArray, FloatArray | None, str]]:
    if np.any(found.passes[2] > found.rolls_on[2]):
        yield np.where(found.passes > found.rolls_on, found.passes, np.nan), None, _VERMILION
    if found.downhill:
        on = np.where((found.rolls_on > found.lowest) & (found.rolls_on < found.highest), found.rolls_on, np.nan)
        yield on, None, GREEN
    yield found.lowest, found.highest, INK


def _band(ax: Axes, phi: FloatArray, border: FloatArray, colour: str) -> None:
    """A border with its 68 and 95 % bands; its line where half of the draws have it.  border : (5, n_phi) rad."""
    degrees = border * _DEGREES
    for low, high, alpha in ((0, 4, 0.16), (1, 3, 0.30)):
        ax.fill_between(phi * _DEGREES, degrees[low], degrees[high], color=colour, alpha=alpha, lw=0, zorder=2.0)
    jump = np.flatnonzero(np.abs(np.diff(border[2])) > 2.0)  # of a body without a heavy side, which sets off from every angle or from none
    for at in jump:
        ax.axvline(phi[at] * _DEGREES, color=colour, lw=1.8, zorder=2.5)
    flat = np.isclose(np.abs(degrees[2] - 90.0), 0.0) | np.isclose(np.abs(degrees[2] - 90.0), 180.0)  # it is nowhere
    ax.plot(phi * _DEGREES, np.where(flat, np.nan, degrees[2]), color=colour, lw=1.8, zorder=2.5)


def _distances(ax: Axes, found: BodyMap) -> None:
    """From where it turns after so many metres, each line with its number."""
    phi = found.phi * _DEGREES
    for i, (stop, release) in enumerate(zip(found.stops, found.contours, strict=True)):
        there = np.flatnonzero(np.isfinite(release))
        if there.size < 2:
            continue
        ax.plot(phi, release * _DEGREES, color=BLUE, lw=0.8, zorder=1.5)
        if there.size > 0.06 * phi.size:
            at = there[int((0.35 + 0.12 * (i % 2)) * there.size)]
            ax.text(phi[at], release[at] * _DEGREES, f"{stop:.3g}", fontsize=8, color=BLUE, ha="center", va="center", zorder=1.6, clip_on=True,
                    bbox={"fc": _TURNS, "ec": "none", "pad": 0.6})  # fmt: skip


def _line_points(ax: Axes, line: ThetaMinSeries) -> ErrorbarContainer:
    return ax.errorbar(
        line.phi * _DEGREES, line.theta_min * _DEGREES, xerr=line.u_phi * _DEGREES, yerr=line.u_theta_min * _DEGREES, fmt="s", color=_VERMILION,
        mfc="white", ms=4.5, lw=0.9, zorder=4, label=phrase("{theta_min} as measured", theta_min=_THETA_MIN),
    )


def _runs(ax: Axes, found: BodyMap) -> None:
    """Error bars of the runs; runs at one place have one label."""
    width, height = np.ptp(found.phi), found.theta0_range[1] - found.theta0_range[0]
    groups: list[list[RunPlace]] = []
    for i, place in enumerate(found.runs):
        at = np.array([place.phi[0], place.theta0[0]]) * _DEGREES
        u = np.array([place.phi[1], place.theta0[1]]) * _DEGREES
        ax.errorbar(at[0], at[1], xerr=u[0], yerr=u[1], fmt=MARKS[i % len(MARKS)], color=INK, ms=5, lw=1.2, zorder=5)
        near = (g for g in groups if abs(g[0].phi[0] - place.phi[0]) < _NEAR * width and abs(g[0].theta0[0] - place.theta0[0]) < _NEAR * height)
        group = next(near, None)
        if group is None:
            groups.append([place])
        else:
            group.append(place)
    taken = [np.array([*_at(ax, group[0]), *_at(ax, group[0])]) for group in groups]
    for group in groups:
        _label(ax, group, taken)


def _at(ax: Axes, place: RunPlace) -> FloatArray:
    """Where a run lies, as shares of the axes."""
    return np.asarray(ax.transAxes.inverted().transform(ax.transData.transform((place.phi[0] * _DEGREES, place.theta0[0] * _DEGREES))))


def _label(ax: Axes, group: Sequence[RunPlace], taken: list[FloatArray]) -> None:
    """Names beside a run, on the first side where there is room.  taken : boxes (left, bottom, right, top), shares of the axes."""
    names = [place.run for place in group[:_NAMED]] + ([phrase("and {n} more", n=len(group) - _NAMED)] if len(group) > _NAMED else [])
    x, y = _at(ax, group[0])
    width, line = _LETTER * max(map(len, names)), _LINE_HEIGHT
    places = []
    for right, up in ((True, True), (True, False), (False, True), (False, False)):
        left = x + _GAP if right else x - _GAP - width
        bottom = y + 0.5 * _GAP if up else y - 0.5 * _GAP - line * len(names)
        box = np.array([left, bottom, left + width, bottom + line * len(names)])
        outside = left < 0.0 or box[2] > 1.0 or bottom < 0.0 or box[3] > 1.0
        overlaps = sum(bool(np.all(box[:2] <= other[2:]) and np.all(other[:2] <= box[2:])) for other in taken)
        places.append((overlaps + 10 * outside, box))
    box = min(places, key=lambda found: found[0])[1]
    taken.append(box)
    for i, name in enumerate(names):
        ax.text(
            box[0], box[3] - line * (i + 0.5), name, transform=ax.transAxes, ha="left", va="center", fontsize=_RUN, color=INK, zorder=7,
            bbox={"fc": "white", "ec": "none", "alpha": 0.65, "pad": 0.6},
        )
