"""Report and `result.json` of a measurement model: GUM and Monte Carlo side by side, budgets, a
statement to paste, regions.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from estim.arrays import FloatArray, sds_of
from estim.common import (
    FigureChoice,
    Files,
    Json,
    PhraseTable,
    behind,
    bracketed,
    format_rounded,
    gravest,
    interval,
    per_cent,
    phrase,
)
from estim.distributions import student_log_density, student_quantile
from estim.drawing import BLUE, GREEN, INK, ORANGE, PALE, Axes, Figure, grid, legend_below
from estim.measurement_model import Propagation, Region, ellipse
from estim.reports.corner_figures import density_of
from estim.reports.pages import Drawers, page
from estim.reports.result import provenance_of
from estim.reports.uncertainty_budget import budget_figure

_DIGITS = 3  # of u in tables: one more than a statement has
_EMPTY = 0.5  # of the interval, without any draw: two separate groups
_INTERVALS = PhraseTable({"symmetric": "symmetric", "shortest": "shortest"})
_LAWS = PhraseTable(
    {
        "normal": "normal",
        "rectangular": "rectangular",
        "triangular": "triangular",
        "trapezoidal": "trapezoidal",
        "curvilinear-trapezoidal": "curvilinear-trapezoidal",
        "arcsine": "arcsine",
        "t": "t",
        "standardised-t": "standardised-t",
        "exponential": "exponential",
        "lognormal": "lognormal",
        "gamma": "gamma",
        "exact": "exact",
    }
)
_BY_DRAWS = PhraseTable(
    {
        "symmetric": (
            "{what}{best} the probabilistically symmetric {percent} coverage interval {ends}, by "
            "propagation of distributions ({n} Monte Carlo trials, JCGM 101)."
        ),
        "shortest": (
            "{what}{best} the shortest {percent} coverage interval {ends}, by "
            "propagation of distributions ({n} Monte Carlo trials, JCGM 101)."
        ),
    }
)
_INTERVALS_DRAWN = PhraseTable(
    {
        "symmetric": "{percent} interval of the draws, symmetric",
        "shortest": "{percent} interval of the draws, shortest",
    }
)


def measurement_result(propagation: Propagation, *, seed: int) -> Json:
    """Everything of `estim propagate`, as `result.json` has it; the report prints from it."""
    model, linear = propagation.model, propagation.linear
    meanings = [meaning for quantity in model.quantities for meaning in quantity.meanings]
    return {
        "schema": "estim-propagation/1",
        "title": model.title,
        "source": model.source,
        "status": gravest(propagation.statuses),
        "probability": model.probability,
        "digits": model.digits,
        "interval": model.interval,
        "outputs": {output.name: _output(propagation, i) for i, output in enumerate(model.outputs)},
        "inputs": {  # and components of inputs; u 0: exact
            entry.name: {
                "value": entry.value,
                "u": entry.u,
                "unit": entry.unit,
                "distribution": entry.distribution if entry.u > 0.0 else "exact",
                "dof": entry.dof,
                "meaning": meaning,
            }
            for entry, meaning in zip(linear.inputs, meanings, strict=True)
        },
        "correlations": [[a, b, r] for (a, b), r in (model.correlation or {}).items()],
        "regions": [
            {
                "outputs": [model.outputs[k].name for k in region.pair],
                "correlation": region.correlation[0],
                "correlation_drawn": region.correlation[1],
                "k_ellipse": region.k_ellipse,
                "k_ellipse_drawn": region.k_drawn,
                "k_rectangle": region.k_rectangle,
                "k_rectangle_drawn": region.k_rectangle_drawn,
                "gum_ellipse_holds": region.coverage,  # share of the draws in it
            }
            for region in propagation.regions
        ],
        "validation": propagation.validation.message,
        "notes": propagation.notes,
        "provenance": provenance_of(model.path, model.sha256, {}, seed),
    }


def _output(propagation: Propagation, i: int) -> Json:
    """One measurand."""
    output, budget = propagation.model.outputs[i], propagation.budgets[i]
    checked, drawn = propagation.validation, propagation.sampled
    second = propagation.second_order
    k_whole = (
        float(student_quantile(0.5 * (1.0 + budget.probability), max(math.floor(budget.dof), 1)))
        if math.isfinite(budget.dof)
        else math.nan
    )
    symmetric, shortest = drawn.symmetric, drawn.shortest
    return {
        "formula": output.formula.text,
        "unit": output.unit,
        "meaning": output.meaning,
        "status": propagation.statuses[i],
        "quoted": _quoted(propagation, i),
        "statement": statement(propagation, i),
        "gum": {  # null: none, or infinitely many degrees of freedom
            "value": budget.value,
            "u": budget.u,
            "dof": budget.dof,
            "k": budget.k,
            "U": budget.expanded,
            "low": budget.low,
            "high": budget.high,
            # with dof rounded down, as tables ask (GUM G.4.1)
            "k_whole": k_whole,
            "U_whole": k_whole * budget.u,
            "u_second_order": math.nan if second is None else second[i],
        },
        "monte_carlo": {  # *_error : Monte-Carlo standard errors of the two ends
            "n_draw": drawn.n_draw,
            "mean": drawn.mean[i],
            "u": drawn.u[i],
            "symmetric": [symmetric.low[i], symmetric.high[i]],
            "symmetric_error": [symmetric.low_error[i], symmetric.high_error[i]],
            "shortest": [shortest.low[i], shortest.high[i]],
            "shortest_error": [shortest.low_error[i], shortest.high_error[i]],
            "undefined": drawn.undefined[i],  # share of draws without a value
        },
        "gum_holds": propagation.gum_holds[i],
        "decided": checked.decided[i],
        "d_low": checked.d_low[i],
        "d_high": checked.d_high[i],
        "tolerance": checked.tolerance[i],
        "budget": [  # share in %
            {
                "input": row.input.name,
                "sensitivity": row.sensitivity,
                "contribution": row.contribution,
                "share": row.share,
            }
            for row in budget.rows
            if row.input.u > 0.0
        ],
        "correlation_share": budget.correlation_share,
    }


def _quoted(propagation: Propagation, i: int) -> str:
    """The method whose interval is quoted, "GUM" or "Monte Carlo"; "" where neither can be."""
    if not propagation.statuses[i].ok:
        return ""
    return "GUM" if propagation.gum_holds[i] else "Monte Carlo"


def statement(propagation: Propagation, i: int) -> str:
    """A sentence for a certificate or a paper (GUM 7.2.2-7.2.4; JCGM 101, 5.5), "" where nothing
    can be quoted.
    """
    budget, drawn = propagation.budgets[i], propagation.sampled
    output, quoted = propagation.model.outputs[i], _quoted(propagation, i)
    unit = behind(output.unit)
    what = f"{output.name}, {output.meaning}: " if output.meaning else ""
    percent = per_cent(budget.probability)
    if quoted == "GUM":
        if budget.u == 0.0:
            return phrase(
                "{what}{name} = {value}, exact.",
                what=what,
                name=output.name,
                value=format_rounded(budget.value, 0.0) + unit,
            )
        return expanded_statement(
            what,
            output.name,
            unit,
            budget.value,
            budget.u,
            budget.k,
            budget.dof,
            budget.probability,
        )
    if quoted == "Monte Carlo":
        low, high = (float(end[i]) for end in (propagation.interval.low, propagation.interval.high))
        scale = float(drawn.u[i]) if math.isfinite(drawn.u[i]) else 0.25 * (high - low)
        mean = float(drawn.mean[i])
        best = (
            phrase(
                "{name} = {value} with standard uncertainty u = {u} and",
                name=output.name,
                value=format_rounded(mean, scale) + unit,
                u=format_rounded(scale, scale, beside=mean) + unit,
            )
            if math.isfinite(drawn.u[i])
            else phrase(
                "{name} has no standard uncertainty (the tails of its draws are too heavy), but",
                name=output.name,
            )
        )
        sentence = _BY_DRAWS[propagation.model.interval].format(
            what=what,
            best=best,
            percent=percent,
            ends=interval(low, high, scale, 2) + unit,
            n=drawn.n_draw,
        )
        below, above = _gap(drawn.draws[:, i])
        if above - below < _EMPTY * (high - low):
            return sentence
        return sentence + phrase(
            " These trials lie in two separate groups, up to {below} and from {above}, with none "
            "between them: mean and u describe neither.",
            below=format_rounded(below, 0.1 * scale) + unit,
            above=format_rounded(above, 0.1 * scale) + unit,
        )
    return ""


def _gap(draws: FloatArray) -> tuple[float, float]:
    """The ends of the widest gap between neighbours of the inner nine tenths of finite draws
    (n_draw,).
    """
    inner = np.sort(draws)[len(draws) // 20 : -(len(draws) // 20) or None]
    k = int(np.argmax(np.diff(inner)))
    return float(inner[k]), float(inner[k + 1])


def expanded_statement(
    what: str,
    name: str,
    unit: str,
    value: float,
    u: float,
    k: float,
    dof: float,
    probability: float,
) -> str:
    """A value with its expanded uncertainty, stated as GUM 7.2.4 requires.  what : stands before
    it, with a colon, or "".
    """
    expanded = f"{format_rounded(value, k * u)} ± {format_rounded(k * u, k * u, beside=value)}"
    return phrase(
        "{what}{name} = {value}, where the number after ± is the expanded "
        "uncertainty U = k u, with the standard "
        "uncertainty u = {u} and the coverage factor k = {k:.2f} from {law} for a "
        "coverage probability of {percent}.",
        what=what,
        name=name,
        value=f"({expanded}){unit}" if unit else expanded,
        u=format_rounded(u, u, beside=value) + unit,
        k=k,
        law=phrase("the normal distribution")
        if dof > 1e6
        else phrase("the t distribution with 1 effective degree of freedom")
        if f"{dof:.3g}" == "1"
        else phrase("the t distribution with {dof:.3g} effective degrees of freedom", dof=dof),
        percent=per_cent(probability),
    )


def measurement_report(propagation: Propagation, *, seed: int, figures: FigureChoice) -> Files:
    """`report.md`, `result.json` and the figures."""
    result = measurement_result(propagation, seed=seed)
    drawers: Drawers = {"figures/distribution.png": partial(distribution_figure, propagation)}
    if any(np.isfinite(row.share) for budget in propagation.budgets for row in budget.rows):
        drawers["figures/budget.png"] = partial(shares_figure, propagation)
    if propagation.regions:
        drawers["figures/regions.png"] = partial(region_figure, propagation)
    return page(
        drawers,
        "measurement.md.j2",
        {"result.json": result},
        figure_choice=figures,
        result=result,
        percent=f"{100.0 * result['probability']:g}",
        which_interval=_INTERVALS[result["interval"]],
        laws=_LAWS,
        cell=_cell,
        ends=_ends,
        dof=_dof,
    )


def _cell(value: float, u: float, beside: float = 0.0) -> str:
    return format_rounded(value, u, _DIGITS, beside=beside)


def _ends(u: float, low: float, high: float) -> str:
    return interval(low, high, u if u > 0.0 else 0.25 * (high - low), _DIGITS)


def _dof(dof: float, form: str = "%.4g") -> str:
    """Degrees of freedom, if not infinitely many."""
    return "∞" if math.isinf(dof) else form % dof


def _density_name(unit: str) -> str:
    below = f"({unit})" if set(unit) & set(" /*·") else unit
    return phrase("density") + ("" if unit == "1" else f" (1/{below})")


def distribution_figure(propagation: Propagation) -> Figure:
    """A histogram of the draws of each output, the distribution that the GUM's interval assumes
    over it, and both intervals.
    """
    outputs = propagation.model.outputs
    figure, axes = grid(len(outputs), height=3.1)
    for i, (ax, output) in enumerate(zip(axes, outputs, strict=True)):
        _distribution(ax, propagation, i)
        ax.set(xlabel=output.name + bracketed(output.unit), ylabel=_density_name(output.unit))
        ax.ticklabel_format(axis="both", style="sci", scilimits=(-4, 5), useMathText=True)
        ax.locator_params(axis="x", nbins=6)
    legend_below(figure, ncols=2)
    return figure


def _distribution(ax: Axes, propagation: Propagation, i: int) -> None:
    gum, sampled = propagation.budgets[i], propagation.sampled
    draws = sampled.draws[:, i]
    draws = draws[np.isfinite(draws)]
    percent = per_cent(sampled.probability)
    known = gum.u > 0.0 and math.isfinite(gum.value)
    tail = 0.1 * (1.0 - sampled.probability)
    ends = list(np.quantile(draws, [tail, 1.0 - tail])) if draws.size else []
    if known:
        room = 0.25 * (gum.high - gum.low)
        ends += [gum.low - room, gum.high + room]
    low, high = min(ends, default=0.0), max(ends, default=1.0)
    high = high if high > low else low + 1.0
    ax.set_xlim(low, high)  # tails go on beyond the frame, those of the draws and of the curve
    if draws.size:
        counts, edges = np.histogram(draws, bins=120, range=(low, high))
        ax.stairs(
            counts / (draws.size * np.diff(edges)),
            edges,
            fill=True,
            color=PALE,
            label=phrase("draws (Monte Carlo)"),
        )
        interval = propagation.interval
        label = _INTERVALS_DRAWN[propagation.model.interval].format(percent=percent)
        for end in (interval.low[i], interval.high[i]):
            ax.axvline(float(end), color=BLUE, label=label)
    if known:
        x = np.linspace(low, high, 400)
        ax.plot(
            x,
            # normal for very many degrees of freedom
            np.exp(student_log_density((x - gum.value) / gum.u, min(gum.dof, 1e6))) / gum.u,
            color=ORANGE,
            label=phrase("the GUM's normal or t distribution"),
        )
        label = phrase("{percent} interval of the GUM", percent=percent)
        for end in (gum.low, gum.high):
            ax.axvline(end, color=ORANGE, ls="--", label=label)
    ax.set_ylim(bottom=0.0)


def shares_figure(propagation: Propagation) -> Figure:
    """Share of each input in the linear variance of each output, largest first, and that of the
    correlations.
    """
    budgets = propagation.budgets
    shares = np.nan_to_num([[row.share for row in budget.rows] for budget in budgets]).T
    names = [row.input.name for row in budgets[0].rows]
    order = np.argsort(-shares.max(axis=1), kind="stable")
    largest = [i for i in order if shares[i].max() >= 0.5][:16]
    rest = [i for i in order if i not in largest]
    sources, rows = [names[i] for i in largest], [shares[i] for i in largest]
    if shares[rest].max(initial=0.0) > 0.0:
        sources.append(phrase("{n} more", n=len(rest)) if len(rest) > 1 else names[rest[0]])
        rows.append(shares[rest].sum(axis=0))
    correlated = np.nan_to_num([budget.correlation_share for budget in budgets])
    if np.any(correlated != 0.0):
        sources.append(phrase("correlations"))
        rows.append(correlated)
    return budget_figure(
        [output.name for output in propagation.model.outputs], sources, np.array(rows)
    )


def region_figure(propagation: Propagation) -> Figure:
    """For each pair of outputs the draws, the ellipses of the GUM and of the draws, the rectangle,
    and the smallest region.
    """
    regions = propagation.regions[:6]
    figure, axes = grid(len(regions), height=3.9)
    for ax, region in zip(axes, regions, strict=True):
        _region(ax, propagation, region)
    legend_below(figure, ncols=2)
    return figure


def _region(ax: Axes, propagation: Propagation, region: Region) -> None:
    draws = propagation.sampled.draws[:400_000, list(region.pair)]
    percent = per_cent(region.probability)
    of_gum = ellipse(region.value, region.covariance, region.k_ellipse)
    of_draws = ellipse(region.mean, region.drawn, region.k_drawn)
    rings = np.hstack([of_gum, of_draws])
    ends = np.quantile(draws, [0.005, 0.995], axis=0).T
    lows = np.minimum(rings.min(axis=1), ends[:, 0])
    highs = np.maximum(rings.max(axis=1), ends[:, 1])
    limits = [
        (low - 0.08 * (high - low), high + 0.08 * (high - low))
        for low, high in zip(lows, highs, strict=True)
    ]
    density = density_of(
        draws[:, 0], draws[:, 1], limits, n_bin=70, smooth=0.7, probabilities=(region.probability,)
    )
    ax.pcolormesh(
        density.x,
        density.y,
        np.ma.masked_less(density.z.T, 0.5),
        cmap="Greys",
        vmax=1.6 * density.z.max(),
        rasterized=True,
    )
    ax.contour(
        density.x,
        density.y,
        density.z.T,
        levels=density.levels,
        colors=INK,
        linewidths=0.9,
        linestyles=":",
    )
    ax.plot(
        [],
        [],
        color=INK,
        ls=":",
        label=phrase(
            "smallest region containing {percent} of the draws, approximate", percent=percent
        ),
    )
    ax.plot(
        *of_gum,
        color=ORANGE,
        ls="--",
        label=phrase("{percent} ellipse of the GUM", percent=percent),
    )
    ax.plot(*of_draws, color=BLUE, label=phrase("{percent} ellipse of the draws", percent=percent))
    half = region.k_rectangle_drawn * sds_of(region.drawn)
    (a, b), (c, d) = region.mean - half, region.mean + half
    ax.plot(
        [a, c, c, a, a],
        [b, b, d, d, b],
        color=GREEN,
        ls="-.",
        label=phrase("{percent} rectangle of the draws", percent=percent),
    )
    first, second = (propagation.model.outputs[k] for k in region.pair)
    ax.set(xlabel=first.name + bracketed(first.unit), ylabel=second.name + bracketed(second.unit))
    ax.ticklabel_format(style="sci", scilimits=(-4, 5), useMathText=True)
    ax.locator_params(nbins=5)
