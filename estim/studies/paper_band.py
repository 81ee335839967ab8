"""The paper's error band: stated uncertainties of the inputs propagated through the curve, without
looking at the speeds.

Inputs are the parameters that were measured (a normal prior).  The others are what was published of
them, as the paper holds kappa and takes no rolling resistance: then the band is the paper's.  Where
nothing was published they are held at their fitted values, and the band is not the paper's, nor
made without looking at the speeds.  Linear (GUM) and by Monte Carlo (GUM Supplement 1), with the
budget along the curve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import split_level
from estim.pipeline import Analysis
from estim.problem import Parameter
from estim.propagation import BudgetAlong, Input, budget_along, propagate_linear
from estim.sampling import Bands, central_intervals
from estim.studies.published import PublishedNumber

PROBABILITY = 0.68


@dataclass(frozen=True, eq=False)
class PropagatedBand:
    """Band of one run at x (n_x,).

    value, u : curve at the stated values and its standard uncertainty, linear.
    mc_low, mc_high : ends of the probabilistically symmetric 68 % interval by Monte Carlo; the band
        that is drawn.
    published : parameters that were not measured here, at their published values.
    fitted : the others, at their fitted values.
    budget : share of each input along the curve.  Beyond 97 % of the way to the turning point of
        the stated values the linear law has no meaning (the speed ends with a vertical slope) and
        u, mc_* are nan.
    ratio : posterior half-width / Monte-Carlo half-width; nan where the lower end of either band is
        at rest: from there on a band narrows only because it cannot reach below zero.
    linear_off : (n_x,) |linear half-width / Monte-Carlo half-width - 1|.
    inside : probability -> share of x at which the posterior band of that probability lies within
        the propagated one.
    """

    run: str
    x: FloatArray
    value: FloatArray
    u: FloatArray
    mc_low: FloatArray
    mc_high: FloatArray
    published: Mapping[str, float]
    fitted: tuple[str, ...]
    budget: BudgetAlong
    ratio: FloatArray
    linear_off: FloatArray
    inside: Mapping[float, float]


def propagated_bands(
    analysis: Analysis, *, rng: np.random.Generator, published: Sequence[PublishedNumber] = ()
) -> tuple[PropagatedBand, ...]:
    """A PropagatedBand for each run of an analysis that has one, on the grid of its posterior band.

    rng : of the draws of the stated inputs.
    published : numbers of the paper whose band it is.
    A run has none where no input was measured, or where at the stated values the body hardly moves.

    >>> import numpy as np
    >>> from estim import Target, analyse, load_campaign, propagated_bands
    >>> campaign = load_campaign("data/replica/campaign.toml", only="heavy-04")
    >>> analysis = analyse(campaign, ["heavy-04"], seed=1, target=Target(ess=400.0))
    >>> (band,) = propagated_bands(analysis, rng=np.random.default_rng(1))
    >>> band.run
    'heavy-04'
    """
    bands = (_band(analysis, i, band, rng, published) for i, band in enumerate(analysis.bands))
    return tuple(band for band in bands if band is not None)


def _band(
    analysis: Analysis,
    i: int,
    bands: Bands,
    rng: np.random.Generator,
    published: Sequence[PublishedNumber],
) -> PropagatedBand | None:
    problem, run = analysis.problem, analysis.problem.runs[i]
    of_curve = [p for p in problem.parameters if p.name in run.curve_parameters]
    measured = {p.name: (p.prior.centre, p.prior.sd) for p in of_curve if p.prior.measured}
    of_paper = {
        p.name: number
        for p in of_curve
        if p.name not in measured and (number := _number_of(p, published)) is not None
    }
    stated = measured | {name: (number.value, number.u or 0.0) for name, number in of_paper.items()}
    inputs = [Input(name, value, u) for name, (value, u) in stated.items() if u > 0.0]
    centre = problem.named(analysis.fit.values) | {
        name: np.asarray(value) for name, (value, _) in stated.items()
    }
    arguments = run.bind(centre)
    end = float(np.ravel(run.end(arguments))[0])
    used = (bands.x > 0.0) & (bands.x < 0.97 * end)
    x = bands.x[used]
    if not inputs or x.size < 5:
        return None

    def curve(values: Mapping[str, Any]) -> FloatArray:
        speeds = run.curve.value(x, run.bind(centre | dict(values)))
        return speeds if np.ndim(next(iter(values.values()))) else np.ravel(speeds)

    linear = propagate_linear(curve, inputs, probability=PROBABILITY)
    drawn = {
        quantity.name: quantity.value + quantity.u * rng.standard_normal((10_000, 1))
        for quantity in inputs
    }
    with np.errstate(all="ignore"):  # no band where some draws have no speed
        _, mc_bands = central_intervals(curve(drawn), tuple(bands.credible))
    low, high = bands.credible[PROBABILITY]
    half = 0.5 * (high - low)
    mc_half = 0.5 * np.subtract(*mc_bands[PROBABILITY][::-1])

    def on_grid(values: FloatArray) -> FloatArray:
        full = np.full(bands.x.size, np.nan)
        full[used] = values
        return full

    u = on_grid(linear.u)
    mc_low, mc_high = map(on_grid, mc_bands[PROBABILITY])
    moving = (low > 0.0) & (mc_low > 0.0)
    return PropagatedBand(
        run=run.name,
        x=bands.x,
        value=np.where(bands.x <= end, np.ravel(run.curve.value(bands.x, arguments)), 0.0),
        u=u,
        mc_low=mc_low,
        mc_high=mc_high,
        published={name: number.value for name, number in of_paper.items()},
        fitted=tuple(sorted(run.curve_parameters - set(stated))),
        budget=budget_along(linear, x),
        ratio=np.where(moving, half / on_grid(mc_half), np.nan),
        linear_off=on_grid(np.abs(linear.u / mc_half - 1.0)),
        inside={p: _inside(band[:, used], mc_bands[p]) for p, band in bands.credible.items()},
    )


def _number_of(
    parameter: Parameter, published: Sequence[PublishedNumber]
) -> PublishedNumber | None:
    """What was published of a parameter: of its body, else of all."""
    base, level = split_level(parameter.name)
    same = [
        number for number in published if number.parameter == base and number.unit == parameter.unit
    ]
    of_body = [number for number in same if number.body is not None and f"[{number.body}]" == level]
    return next(iter(of_body + [number for number in same if number.body is None]), None)


def _inside(band: FloatArray, outer: FloatArray) -> float:
    return float(np.mean((band[0] >= outer[0]) & (band[1] <= outer[1])))
