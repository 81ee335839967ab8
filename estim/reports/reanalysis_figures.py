"""Figures of a reanalysis: bands over each other, their widths, energies, what more runs bring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.common import signed
from estim.drawing import BLUE, COLOURS, GREY, INK, MARKS, ORANGE, grid, name_ticks, new_figure
from estim.reports.joint_figures import RUN_COLOURS
from estim.sampling import curve_draws
from estim.studies import BodyAnalysis, Narrowing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def overlay_figure(body: BodyAnalysis, *, synthetic: bool) -> Figure:
    """Data, the propagated band of the stated inputs, and the posterior band of the joint fit."""
    runs = body.joint.problem.runs
    figure, axes = grid(len(runs), height=2.9)
    propagated = {band.run: band for band in body.propagated}
    for ax, run, bands in zip(axes, runs, body.joint.bands, strict=True):
        band = propagated.get(run.name)
        if band is not None:
            ax.fill_between(band.x, band.mc_low, band.mc_high, color=ORANGE, alpha=0.35, lw=0, label="stated inputs propagated, 68 %")
            ax.plot(band.x, band.value, color=ORANGE, lw=1.2, label="curve at the stated inputs")
        if body.joint.diagnosis.ok:
            ax.fill_between(bands.x, *bands.credible[0.68], color=BLUE, alpha=0.6, lw=0)
            ax.plot(bands.x, bands.median, color=BLUE, lw=1.0, label="posterior, median and 68 % band")
        else:
            mode = curve_draws(body.joint.problem, run, bands.x, body.joint.fit.values[None, :])[0][0]
            ax.plot(bands.x, mode, color=BLUE, lw=1.0, label=f"most probable curve ({body.joint.diagnosis.status}: no band)")
        ax.plot(run.x, run.y, "o", color=INK, ms=2.2, label="data used", zorder=5)
        ax.set(xlabel=run.x_label, ylabel=run.y_label, xlim=(0.0, None), ylim=(0.0, None))
        ax.set_title(run.name + (" (SYNTHETIC data)" if synthetic else ""), fontsize=9)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _shown(tilt: float) -> str:
    return signed(f"{tilt:.1f}")


def tilts_figure(body: BodyAnalysis, *, synthetic: bool) -> Figure:
    """All runs of a body in one pair of axes: data, and of each curve the median and the 95 % band of the joint fit, the lowest tilt first."""
    analysis = body.joint
    named = analysis.problem.named(analysis.fit.values)
    tilts = [float(np.degrees(np.ravel(run.bind(named)["phi"])[0])) for run in analysis.problem.runs]
    figure = new_figure(4.4)
    ax = figure.subplots()
    for k, i in enumerate(np.argsort(tilts)):
        run, bands, colour = analysis.problem.runs[i], analysis.bands[i], RUN_COLOURS[k % len(RUN_COLOURS)]
        if analysis.diagnosis.ok:
            ax.fill_between(bands.x, *bands.credible[0.95], color=colour, alpha=0.25, lw=0)
            ax.plot(bands.x, bands.median, color=colour, lw=1.2)
        ax.plot(run.x, run.y, MARKS[k % len(MARKS)], color=colour, ms=3.5, mec=INK, mew=0.3, label=f"{run.name}, φ = {_shown(tilts[i])}°", zorder=5)
    ax.set(xlabel=analysis.problem.runs[0].x_label, ylabel=analysis.problem.runs[0].y_label, xlim=(0.0, None), ylim=(0.0, None))
    ax.set_title(body.body + (" (SYNTHETIC data)" if synthetic else ""), fontsize=10)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def width_figure(bodies: Sequence[BodyAnalysis], *, synthetic: bool) -> Figure:
    """Width of the posterior band relative to the propagated one along each run."""

    figure = new_figure(3.2)
    axes = figure.subplots(1, len(bodies), squeeze=False, sharey=True)[0]
    for ax, body in zip(axes, bodies, strict=True):
        for band, colour in zip(body.propagated, COLOURS * 4, strict=False):
            ax.plot(band.x, band.ratio, color=colour, lw=1.4, label=band.run)
        ax.axhline(1.0, color=GREY, lw=0.8, ls="--")
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.set(xlabel=body.joint.problem.runs[0].x_label)
        ax.legend(fontsize=8, frameon=False, ncols=2, loc="upper center")
    axes[0].set_ylim(top=8.0)
    axes[0].set_ylabel("posterior / propagated width (68 %)")
    if synthetic:
        figure.suptitle("SYNTHETIC data", fontsize=9)
    return figure


def narrowing_figure(tables: Sequence[Narrowing], *, synthetic: bool) -> Figure:
    """Uncertainty of gamma and kappa against the number of runs fit together, beside single runs."""
    names = [name for table in tables for name in table.names]
    figure = new_figure(2.9 * -(-len(names) // 2))
    axes = figure.subplots(-(-len(names) // 2), 2, squeeze=False).ravel()
    pairs = [(table, i) for table in tables for i in range(len(table.names))]
    for ax, (table, i) in zip(axes, pairs, strict=False):
        count = np.arange(1, len(table.runs) + 1)
        ax.plot(count, table.u[:, i], "o-", color=BLUE, label="runs up to this one together")
        ax.plot(count, table.u_single[:, i], "s", color=ORANGE, label="this run alone", zorder=3, mfc="none", mew=1.6, ms=8)
        if np.isfinite(table.u_prior[i]):
            ax.axhline(table.u_prior[i], ls=":", color=GREY, label="prior alone")
        shown = np.array([*table.u[:, i], *table.u_single[:, i], table.u_prior[i]])
        top = 1.1 * float(np.max(shown[np.isfinite(shown)]))
        ax.set(ylabel=f"u({table.labels[i].tex})", ylim=(0.0, top), xlim=(0.6, len(count) + 0.4))
        upright = sum(len(run) for run in table.runs) > 36
        name_ticks(ax.xaxis, count, table.runs, fontsize=8, rotation=90 if upright else 0)
    for extra in axes[len(pairs) :]:
        extra.set_visible(False)
    axes[0].legend(fontsize=8, frameon=False)
    if synthetic:
        figure.suptitle("SYNTHETIC data", fontsize=9)
    return figure
