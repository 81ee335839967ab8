"""Data that an experiment could have given: for given parameter values, as the noise model says.

`CampaignDesign` simulates at the level of the runs' tables, so that derivative, selection and guard
zones are applied to the simulated rows as to the real ones.  `PointDesign` simulates at the points
of a problem: of a curve of one's own, whose readings are fit as they are, inside the window of the
real data.  What is kept of the real data is the design of the experiment: times, positions of
independent speeds, abscissas of one's own curve, standard deviations row by row, the moment of
release of differentiated runs.  Not simulated:

- independent errors of speeds that are computed from positions: refused, no such data exist.
- the scatter of differentiated speeds is added after differentiation and selection (selection looks
  at a speed only to tell whether the body turned).
- errors of x are normal whatever the tails of y are, and so is the distribution of the true
  abscissas about the readings.

Values for which a fitted row has no place on the curve (the body does not start, or turns before a
position at which its speed is fit) give no data: `None`.  The posterior density is zero for just
these values, so that discarding them is the same as a prior cut to where the data are possible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, Named, all_finite, finite_or
from estim.campaign import Campaign, NoiseTable
from estim.common import InputError
from estim.problem import Observations, Parameter, Problem
from estim.reading import Run


@dataclass(frozen=True, eq=False)
class PointDesign:
    """The points of a problem whose ordinates are readings themselves."""

    problem: Problem

    def __post_init__(self) -> None:
        if any(run.noise.made_of_positions for run in self.problem.runs):
            raise InputError(
                "needs the tables of the runs where speeds are differentiated", field="calibration"
            )

    def simulate(
        self, values: FloatArray, parameters: tuple[Parameter, ...], rng: np.random.Generator
    ) -> Problem | None:
        """The problem that simulated data pose, with `parameters` as its unknowns; None where
        `values` (n_par,) give no data.
        """
        named, runs = self.problem.named(values), []
        for run in self.problem.runs:
            where = run.noise.true_x(run.x, run.noise.x_gain(), named, rng)
            curve = curve_at(run, where, named)
            if not all_finite(curve):
                return None
            y = run.noise.read(curve, run.noise.reading_gain(), named, rng)
            runs.append(
                replace(run, x=run.noise.read_x(where, run.noise.x_gain(), named, rng), y=y)
            )
        return Problem(parameters, tuple(runs))


@dataclass(frozen=True, eq=False)
class CampaignDesign:
    """Runs of a campaign, fit together.

    problem : of the real data.
    release : run -> moment of release (s) on the clock of its data, for differentiated runs.
    analysed : noise table with which the simulated data are analysed, in place of the campaign's:
        to see a wrong one fail.
    """

    campaign: Campaign
    names: tuple[str, ...]
    problem: Problem
    release: Mapping[str, float]
    analysed: NoiseTable | None = None

    def simulate(
        self, values: FloatArray, parameters: tuple[Parameter, ...], rng: np.random.Generator
    ) -> Problem | None:
        named, tables = self.problem.named(values), {}
        for run in self.problem.runs:
            table = self._table(run, self.campaign.tables[run.name], named, rng)
            if table is None:
                return None
            tables[run.name] = table
        try:
            posed = replace(self.campaign, tables=MappingProxyType(tables)).problem(
                self.names, noise=self.analysed
            )
        # too few rows are left to fit: an experiment that would have been thrown away
        except InputError:
            return None
        # priors that were taken from the data (moment of release, zero of the positions) stay those
        # of the real data
        assert tuple(p.name for p in posed.parameters) == tuple(p.name for p in parameters)
        return Problem(
            parameters,
            tuple(
                _scattered(run, truth, named, rng)
                for run, truth in zip(posed.runs, self.problem.runs, strict=True)
            ),
        )

    def _table(
        self, run: Observations, table: Run, named: Named, rng: np.random.Generator
    ) -> Run | None:
        columns = _columns(run, table, named, self.release.get(run.name, 0.0), rng)
        return None if columns is None else table.with_columns({**table.columns, **columns})


Experiment: TypeAlias = PointDesign | CampaignDesign
"""An experiment that can be repeated."""


def campaign_design(
    campaign: Campaign,
    names: Sequence[str],
    *,
    fitted: FloatArray,
    analysed: NoiseTable | None = None,
) -> Experiment:
    """The design of runs of a campaign: their tables, or their points where the curve is the user's
    own.

    fitted : (n_par,) the fit of the real data, at which the moment of release of differentiated
        runs is taken.

    Raises InputError for noise that cannot be simulated.
    """
    problem = campaign.problem(names)
    if all(run.motion is None for run in problem.runs):
        return PointDesign(problem)
    return CampaignDesign(
        campaign, tuple(names), problem, release_times(campaign, problem, fitted), analysed
    )


def release_times(campaign: Campaign, problem: Problem, fitted: FloatArray) -> Mapping[str, float]:
    """Run -> moment of release (s) on the clock of its data at `fitted` (n_par,), for
    differentiated runs.

    Raises InputError for noise that cannot be simulated.
    """
    release = {}
    for run in problem.runs:
        table = campaign.tables[run.name]
        if run.noise.made_of_positions:
            release[run.name] = _release_time(run, problem.named(fitted))
        elif not run.positions and table.rate not in table.columns:
            raise InputError(
                "cannot be simulated: independent errors of speeds that are computed from "
                "positions (use model = 'differentiated')",
                field="model",
                value="independent",
                file=campaign.source.path,
            )
    return MappingProxyType(release)


def _columns(
    run: Observations, table: Run, named: Named, release: float, rng: np.random.Generator
) -> dict[str, FloatArray] | None:
    """The columns of a table that are measured anew; None where the values give no data."""
    noise = run.noise
    if noise.made_of_positions:
        x = follow(run, table.columns["t_s"] - release, named)
        if not all_finite(x):
            return None
        return {table.coordinate: noise.read(x, np.ones(x.size), named, rng)}
    where = table.columns["t_s" if run.positions else table.coordinate]
    same = np.ones(where.size)
    x_gain = same if run.positions else table.columns.get("sigma_x_m", same)
    true_x = noise.true_x(where, x_gain, named, rng)
    curve = curve_at(run, true_x, named)
    if not all_finite(curve[np.isin(where, run.x)]):
        return None
    # a row that was not fit may lie where the body never comes: there it is at rest, and selection
    # leaves it out again
    curve = finite_or(curve, 0.0)
    y = noise.read(
        curve, table.columns.get("sigma_x_m" if run.positions else "sigma_v_m_s", same), named, rng
    )
    return (
        {table.coordinate: y}
        if run.positions
        else {table.coordinate: noise.read_x(true_x, x_gain, named, rng), table.rate: y}
    )


def curve_at(run: Observations, x: FloatArray, named: Named) -> FloatArray:
    """(n_obs,) the curve at x (n_obs,) for one set of values."""
    with np.errstate(all="ignore"):
        return np.array(run.drawn(named, x))


def _scattered(
    run: Observations, truth: Observations, named: Named, rng: np.random.Generator
) -> Observations:
    """Differentiated speeds with their further scatter."""
    if not truth.noise.made_of_positions:
        return run
    return replace(
        run, y=run.y + truth.noise.size.scatter.at(named) * rng.standard_normal(run.n_obs)
    )


def follow(run: Observations, since: FloatArray, named: Named) -> FloatArray:
    """Positions at times since release, in their shape: (n_obs,) or (n, n_obs)."""
    position = getattr(run.curve, "position", None)
    if position is None:
        raise InputError(
            "cannot be simulated: its curve does not say where the body is in time",
            field="run",
            value=run.name,
        )
    return np.array(
        np.broadcast_to(position(since, run.bind(named)), np.atleast_2d(since).shape)
    ).reshape(since.shape)


def _release_time(run: Observations, named: Named) -> float:
    """The moment of release (s, clock of the data) at which the motion passes closest to the fitted
    positions.
    """
    from scipy.optimize import minimize_scalar

    assert run.t is not None
    t, x = run.t, run.x

    def misfit(moments: ArrayLike) -> FloatArray:
        return np.sum(np.square(follow(run, t - np.reshape(moments, (-1, 1)), named) - x), axis=1)

    span = float(t[-1] - t[0])
    # moments tried before the best is refined
    moments = np.linspace(t[0] - 2.0 * span, t[0], 400)
    best, step = moments[int(np.nanargmin(misfit(moments)))], moments[1] - moments[0]
    return float(
        minimize_scalar(
            lambda m: float(misfit(m)[0]),
            bounds=(best - step, best + step),
            method="bounded",
            options={"xatol": 1e-9},
        ).x
    )
