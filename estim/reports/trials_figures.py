"""Figures of trials of release: all of them in the plane of tilt and angle, and the chance of an ascent at each tilt."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.common import format_quantity, later, phrase
from estim.drawing import BLUE, GREY, INK, ORANGE, grid, new_figure
from estim.line import HIGH, LOW, TrialsAnalysis, effective_start

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_PANELS = 12
_BANDS = ((0.95, 0.22), (0.68, 0.40))
_ASIDE = 0.011  # of the width of the panel: from a mark to the next of the same angle
_MARKS = {(LOW, True): ("^", BLUE), (LOW, False): ("o", "white"), (HIGH, True): ("v", ORANGE), (HIGH, False): ("s", "white")}
_NAMES = {LOW: later("below 90°"), HIGH: later("above 90°")}


def starts_figure(analysis: TrialsAnalysis) -> Figure:
    """Every trial, the intervals of each tilt by itself, and where ascents begin and end by all trials at once; a panel for each end."""
    trials = analysis.trials
    figure = new_figure(3.4 * len(trials.ends) + 0.8)
    axes = figure.subplots(len(trials.ends), 1, squeeze=False)[:, 0]
    read = np.array([tilt.phi for tilt in trials.tilts])
    room = 0.08 * max(float(np.ptp(read)), 0.01)
    phi = np.linspace(min(0.0, read.min() - room), read.max() + room, 120)
    for ax, end in zip(axes, reversed(trials.ends), strict=True):
        _draw_starts(ax, analysis, end, phi)
        _draw_trials(ax, analysis, end, float(np.degrees(np.ptp(phi))))
        ax.set(xlim=np.degrees(phi[[0, -1]]), ylabel=phrase("θ, angle of release as set (°)"))
        low, high = ax.get_ylim()
        ax.set_ylim(max(low, 0.0), min(high, 180.0))
    axes[-1].set_xlabel(phrase("φ, tilt of the ramp as read (°)"))
    axes[0].set_title(trials.body + ("" if analysis.status.ok else f" — {analysis.status}"), fontsize=10)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _draw_starts(ax: Axes, analysis: TrialsAnalysis, end: str, phi: FloatArray) -> None:
    if analysis.status.ok:
        starts = analysis.starts(end, phi)
        for probability, alpha in _BANDS:
            low, high = np.quantile(starts, [0.5 - 0.5 * probability, 0.5 + 0.5 * probability], axis=0)
            label = phrase("limit of the ascents, all trials at once, {p:.0f} %", p=100 * probability)
            ax.fill_between(np.degrees(phi), np.degrees(low), np.degrees(high), color=BLUE, alpha=alpha, lw=0, label=label)
    gamma = analysis.gamma_masses
    if gamma is not None:
        sine = np.sin(phi) / gamma.value
        smallest = np.degrees(np.where(np.abs(sine) <= 1.0, np.arcsin(np.clip(sine, -1.0, 1.0)), np.nan))
        label = phrase("theory, γ = {gamma} as stated", gamma=format_quantity(gamma.value, gamma.u))
        ax.plot(np.degrees(phi), smallest if end == LOW else 180.0 - smallest, color=ORANGE, lw=1.8, label=label)
    for i, found in enumerate(one for one in analysis.thresholds if one.end == end):
        low, high = np.degrees(found.quantiles[[0, -1]])
        label = phrase("limit of the ascents, each tilt by itself, 95 %") if i == 0 else "_"
        ax.plot([np.degrees(found.phi)] * 2, [low, high], color=GREY, lw=2.5, solid_capstyle="butt", zorder=3, label=label)


def _draw_trials(ax: Axes, analysis: TrialsAnalysis, end: str, width: float) -> None:
    """Ascents right of their tilt, refusals left of it, those of one angle side by side.  width : degrees, of the panel."""
    for climbed, mark, face, label in (
        (True, "^", BLUE, phrase("climbed (right of the tilt)")), (False, "o", "white", phrase("did not climb (left of it)")),
    ):
        x, y = [], []
        for tilt in analysis.trials.tilts:
            part = tilt.end(end)
            for place, angle in _side_by_side(part.theta[part.climbed == climbed]):
                x.append(np.degrees(tilt.phi) + (1.0 if climbed else -1.0) * (place + 1.0) * _ASIDE * width)
                y.append(angle)
        ax.plot(x, y, mark, ms=5, mfc=face, mec=INK, mew=0.8, ls="", label=label, zorder=4)


def _side_by_side(angles: FloatArray) -> list[tuple[int, float]]:
    """Angles in degrees, each with how many of the same came before it."""
    seen: Counter[float] = Counter()
    placed = []
    for angle in np.round(np.degrees(angles), 6).tolist():
        placed.append((seen[angle], angle))
        seen[angle] += 1
    return placed


def chances_figure(analysis: TrialsAnalysis) -> Figure:
    """The chance of an ascent against the angle, a panel for each tilt, and its trials at 1 and 0; angles above 90 degrees mirrored there."""
    trials = analysis.trials
    chosen = np.unique(np.linspace(0, len(trials.tilts) - 1, min(len(trials.tilts), _MOST_PANELS)).round().astype(int))
    figure, axes = grid(len(chosen), height=2.2 if len(chosen) > 2 else 2.8)
    for ax, which in zip(axes, chosen, strict=True):
        tilt = trials.tilts[which]
        inside = np.minimum(tilt.theta, np.pi - tilt.theta)
        room = 4.0 * float(np.median(analysis.column("scatter")))
        angles = np.linspace(max(0.0, inside.min() - room), min(0.5 * np.pi, inside.max() + room), 161)
        chance = _chances(analysis, tilt.phi, angles, trials.ends[0])
        for probability, alpha in _BANDS:
            ends = np.quantile(chance, [0.5 - 0.5 * probability, 0.5 + 0.5 * probability], axis=0)
            label = phrase("chance of an ascent, {p:.0f} %", p=100 * probability)
            ax.fill_between(np.degrees(angles), *ends, color=BLUE, alpha=alpha, lw=0, label=label)
        ax.plot(np.degrees(angles), np.median(chance, axis=0), color=BLUE, lw=1.2)
        if len(trials.ends) > 1 and trials.u_zero_theta > 0.0:  # else the two ends have one curve
            middle = np.median(_chances(analysis, tilt.phi, angles, HIGH), axis=0)
            ax.plot(np.degrees(angles), middle, color=ORANGE, lw=1.4, ls="--", label=phrase("median above 90°"))
        for climbed, level, step in ((True, 1.0, -0.07), (False, 0.0, 0.07)):
            below: Counter[float] = Counter()
            for end in trials.ends:
                part = tilt.end(end)
                angles_in = np.degrees(np.minimum(part.theta, np.pi - part.theta)[part.climbed == climbed])
                heights = []
                for angle in np.round(angles_in, 6).tolist():
                    heights.append(level + step * below[angle])
                    below[angle] += 1
                mark, face = _MARKS[end, climbed]
                label = phrase("climbed") if climbed else phrase("did not climb")
                label += f", {phrase(_NAMES[end])}" if len(trials.ends) > 1 else ""
                ax.plot(angles_in, heights, mark, ms=5, mfc=face, mec=INK, mew=0.8, ls="", label=label, clip_on=False, zorder=4)
        ax.set(xlim=np.degrees(angles[[0, -1]]), ylim=(-0.08, 1.08))
        ax.set_yticks([0.0, 0.5, 1.0])
        ax.set_title(phrase("φ read as {phi:.2f}°", phi=math.degrees(tilt.phi)), fontsize=9)
    as_set = phrase("θ, angle of release as set (°)")
    mirrored = phrase("θ, or 180° − θ (°)") if len(trials.ends) > 1 else "180° − θ (°)" if trials.ends == (HIGH,) else as_set
    for ax in axes[-2:] if len(axes) > 2 else axes[-1:]:
        ax.set_xlabel(mirrored)
    for ax in axes[::2] if len(axes) > 2 else axes:
        ax.set_ylabel(phrase("chance of an ascent"))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def _chances(analysis: TrialsAnalysis, phi: float, inside: FloatArray, end: str, *, n_draw: int = 300) -> FloatArray:
    """(n_draw, n_angle) chance of an ascent at a tilt read as `phi`, over its errors, `inside` rad from the vertical at that end."""
    posterior, names = analysis.posterior, analysis.chain.names
    draws = analysis.chain.thinned(n_draw)
    values = {name: draws[:, i] for i, name in enumerate(names)}
    starts = effective_start(values, end, posterior.true_tilts(phi), posterior.resistance)
    zero = draws[:, [names.index("zero_theta")]] * (1.0 if end == LOW else -1.0) if "zero_theta" in names else 0.0
    per_width = math.pi / math.sqrt(3.0) / draws[:, [names.index("scatter")]]
    total = np.zeros((len(draws), inside.size))
    for k, weight in enumerate(np.exp(posterior.log_weights)):
        total += weight * 0.5 * (1.0 + np.tanh(0.5 * (inside - starts[:, [k]] - zero) * per_width))
    return total
