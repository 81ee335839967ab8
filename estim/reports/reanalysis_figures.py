"""Figures of a reanalysis: bands over each other, their widths, energies, what more runs bring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.common import phrase, signed
from estim.drawing import BLUE, GREY, INK, MARKS, ORANGE, name_ticks, new_figure
from estim.reports.joint_figures import RUN_COLOURS
from estim.reports.residual_panels import draw_faded, draw_points_with_bars, draw_residuals, panel_pairs, residuals_of, tidy_labels
from estim.sampling import curve_draws
from estim.studies import BodyAnalysis, Narrowing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def overlay_figure(body: BodyAnalysis) -> Figure:
    """Data, the propagated band of the stated inputs, and the posterior band of the joint fit; below it all of them less the fit."""
    runs, trusted = body.joint.problem.runs, body.joint.diagnosis.ok
    figure, pairs = panel_pairs(len(runs), height=3.3)
    propagated = {band.run: band for band in body.propagated}
    of_paper = any(band.published for band in body.propagated) and not any(band.held for band in body.propagated)
    whose = phrase("the paper's band, 68 %") if of_paper else phrase("stated inputs propagated, 68 %")
    for (ax, below), run, bands, residuals in zip(pairs, runs, body.joint.bands, residuals_of(body.joint), strict=True):
        band, reach = propagated.get(run.name), 0.0
        if band is not None:
            draw_faded(ax, band.x, band.mc_low, band.mc_high, ORANGE, alpha=0.4, label=whose)
            ax.plot(band.x, band.value, color=ORANGE, lw=1.2, label=phrase("curve at the stated inputs"))
            fit = np.interp(band.x, bands.x, bands.median)
            draw_faded(below, band.x, band.mc_low - fit, band.mc_high - fit, ORANGE, alpha=0.4)
            below.plot(band.x, band.value - fit, color=ORANGE, lw=1.0)
            reach = 1.3 * float(np.nanmedian(np.abs([band.mc_low - fit, band.mc_high - fit])))
        if trusted:
            ax.fill_between(bands.x, *bands.credible[0.68], color=BLUE, alpha=0.6, lw=0)
            ax.plot(bands.x, bands.median, color=BLUE, lw=1.0, label=phrase("posterior, median and 68 % band"))
        else:
            mode = curve_draws(body.joint.problem, run, bands.x, body.joint.fit.values[None, :])[0][0]
            said = phrase("most probable curve ({status}: no band)", status=body.joint.diagnosis.status)
            ax.plot(bands.x, mode, color=BLUE, lw=1.0, label=said)
        draw_points_with_bars(ax, residuals, label=phrase("data used"))
        draw_residuals(below, residuals, bands if trusted else None, reach=reach)
        ax.set(ylabel=run.y_label, xlim=(0.0, None), ylim=(0.0, None))
        ax.set_title(run.name, fontsize=9)
    tidy_labels(pairs)
    figure.legend(*pairs[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    figure.align_ylabels()
    return figure


def _shown(tilt: float) -> str:
    return signed(f"{tilt:.1f}")


def tilts_figure(body: BodyAnalysis) -> Figure:
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
    ax.set_title(body.body, fontsize=10)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def width_figure(bodies: Sequence[BodyAnalysis]) -> Figure:
    """Width of the posterior band relative to the propagated one along each run."""

    figure = new_figure(3.2)
    axes = figure.subplots(1, len(bodies), squeeze=False, sharey=True)[0]
    for ax, body in zip(axes, bodies, strict=True):
        for k, band in enumerate(body.propagated):
            style = ("-", "--", ":", "-.")[k // len(RUN_COLOURS) % 4]
            ax.plot(band.x, 100.0 * band.ratio, color=RUN_COLOURS[k % len(RUN_COLOURS)], ls=style, lw=1.4, label=band.run)
        ax.axhline(100.0, color=GREY, lw=0.8, ls="--")
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.set(xlabel=body.joint.problem.runs[0].x_label)
        ax.legend(fontsize=8, frameon=False, ncols=2, loc="upper center")
    axes[0].set_ylim(top=800.0)
    axes[0].set_ylabel(phrase("posterior / propagated band (%)"))
    return figure


def narrowing_figure(tables: Sequence[Narrowing]) -> Figure:
    """Uncertainty of gamma and kappa against the number of runs fit together, beside single runs."""
    names = [name for table in tables for name in table.names]
    figure = new_figure(2.9 * -(-len(names) // 2))
    axes = figure.subplots(-(-len(names) // 2), 2, squeeze=False).ravel()
    pairs = [(table, i) for table in tables for i in range(len(table.names))]
    for ax, (table, i) in zip(axes, pairs, strict=False):
        count = np.arange(1, len(table.runs) + 1)
        ax.plot(count, table.u[:, i], "o-", color=BLUE, label=phrase("runs up to this one together"))
        ax.plot(count, table.u_single[:, i], "s", color=INK, label=phrase("this run alone"), zorder=3, mfc="none", mew=1.6, ms=8)
        if np.isfinite(table.u_prior[i]):
            ax.axhline(table.u_prior[i], ls=":", color=ORANGE, lw=1.8, label=phrase("stated before"))
        shown = np.array([*table.u[:, i], *table.u_single[:, i], table.u_prior[i]])
        top = 1.1 * float(np.max(shown[np.isfinite(shown)]))
        ax.set(ylabel=f"u({table.labels[i].tex})", ylim=(0.0, top), xlim=(0.6, len(count) + 0.4))
        upright = sum(len(run) for run in table.runs) > 36
        name_ticks(ax.xaxis, count, table.runs, fontsize=8, rotation=90 if upright else 0)
    for extra in axes[len(pairs) :]:
        extra.set_visible(False)
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=8, frameon=False, loc="outside lower center", ncols=3)
    return figure
