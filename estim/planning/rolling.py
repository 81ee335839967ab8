"""Runs of rolling bodies as they would be measured: tables without errors, at the fit, and the
problem that they pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, finite_or
from estim.calibration import curve_at, follow, release_times
from estim.campaign import (
    Campaign,
    NewRun,
    as_complete,
    otherwise,
    with_own_gamma,
    with_runs,
    with_tables,
)
from estim.common import InputError, later, phrase, split_level
from estim.discrepancy import ForceSize, force_sizes
from estim.fitting import Fit, expected_information
from estim.planning.candidates import OTHERWISE, Change
from estim.problem import Observations, Problem
from estim.reading import Run

_LONGER = (1, 2, 4)  # times the duration of the run that it is like: how long a new run may take
_MOST = 3000  # frames


@dataclass(frozen=True, eq=False)
class Outlook:
    """Runs that would be measured: their problem, and where it is looked at.

    values : (n_par,).
    information : (n_par, n_par), priors included.  remarks : what is worth saying of the runs.
    """

    problem: Problem
    values: FloatArray
    information: FloatArray
    campaign: Campaign
    release: Mapping[str, float]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class RollingBasis:
    """A campaign of rolling bodies with the fit of some of its runs.

    release : run -> moment of release, of differentiated runs.
    sizes : run -> how large its force is.  ramp : the farthest place of any run.
    """

    campaign: Campaign
    names: tuple[str, ...]
    fit: Fit
    release: Mapping[str, float]
    sizes: Mapping[str, ForceSize]
    ramp: Mapping[str, float]

    def outlook(self, change: Change) -> Outlook:
        """The information of the runs with the change made, without its `u`.  Raises InputError
        where that cannot be measured.
        """
        changed = otherwise(self.campaign, reading_error=change.error, reach=change.reach)
        changed = with_runs(changed, change.runs)
        like = {name: name for name in self.names} | {run.name: run.like for run in change.runs}
        tables = dict(changed.tables)
        remarks = list[str]()
        for new in change.runs:
            run = self._followed[new.like].run
            run = replace(run, arguments=self._arguments(run, new))
            first = replace(self._followed[new.like], run=run, table=tables[new.name])
            tables[new.name], remark = first.first(self.ramp)
            remarks += [remark] if remark else []
        same = change.frames == change.error == change.reach == 1.0
        tables |= self._unchanged if same else self._measured(change)
        campaign = with_tables(changed, tables)
        problem = with_own_gamma(posed(campaign, tuple(like)), change.runs)
        values = self._values(problem, change.runs)
        sizes = {name: self.sizes[old] for name, old in like.items() if old in self.sizes}
        information = expected_information(problem, values, sizes)
        release = {name: self.release[old] for name, old in like.items() if old in self.release}
        distinct = tuple(dict.fromkeys(remarks))
        return Outlook(problem, values, information, campaign, release, distinct)

    @cached_property
    def _followed(self) -> Mapping[str, _Followed]:
        return {
            run.name: _Followed(
                run, self.campaign.tables[run.name], self.fit.named, self.release.get(run.name, 0.0)
            )
            for run in self.fit.problem.runs
        }

    @cached_property
    def _unchanged(self) -> Mapping[str, Run]:
        return self._measured(Change("", OTHERWISE))

    def _measured(self, change: Change) -> dict[str, Run]:
        """Run -> its table with the change made."""
        return {name: run.with_change(change) for name, run in self._followed.items()}

    def _arguments(self, like: Observations, new: NewRun) -> dict[str, str | float]:
        return {
            **like.arguments,
            **{name: quantity.value for name, quantity in new.quantities.items()},
        }

    def _values(self, problem: Problem, runs: Sequence[NewRun]) -> FloatArray:
        """(n_par,) the fitted values; of a new run its stated ones, else those of the run that it
        is like.
        """
        fitted, of_new_runs = dict(zip(self.fit.names, self.fit.values, strict=True)), {}
        for new in runs:
            like = next(run for run in self.fit.problem.runs if run.name == new.like)
            for p in problem.parameters:
                base, level = split_level(p.name)
                if level == f"[{new.name}]":
                    source = self._arguments(like, new).get(base, f"{base}[{new.like}]")
                    of_new_runs[p.name] = fitted[source] if isinstance(source, str) else source
        return np.array(
            [
                fitted[p.name] if p.name in fitted else of_new_runs[p.name]
                for p in problem.parameters
            ]
        )


def posed(campaign: Campaign, names: Sequence[str]) -> Problem:
    """The problem of the runs of a plan; the curve of positions is taken as complete."""
    problem = campaign.problem(names)
    return (
        as_complete(problem, "estim plan")
        if any(run.positions for run in problem.runs)
        else problem
    )


def rolling_basis(campaign: Campaign, names: Sequence[str], fit: Fit) -> RollingBasis:
    """What plans start from.  Raises InputError for noise that cannot be simulated."""
    ramp: dict[str, float] = {}
    for table in campaign.tables.values():
        # the farthest reading has an error: the ramp is taken to end 2 % beyond it
        ramp[table.coordinate] = max(
            ramp.get(table.coordinate, 0.0), 1.02 * float(np.max(table.position))
        )
    release = release_times(campaign, fit.problem, fit.values)
    return RollingBasis(
        campaign, tuple(names), fit, release, force_sizes(fit.posterior, fit.values), ramp
    )


@dataclass(frozen=True, eq=False)
class _Followed:
    """A run as it goes at the fit, without errors.

    table : whose rows it is like.  named : the fitted values.  release : moment of release (s), of
        differentiated runs.
    """

    run: Observations
    table: Run
    named: Mapping[str, FloatArray]
    release: float

    @property
    def where(self) -> str:
        """The column of what is chosen: times, or positions at which speeds are measured."""
        in_time = self.run.noise.made_of_positions or self.run.positions
        return "t_s" if in_time else self.table.coordinate

    def at(self, places: FloatArray) -> FloatArray:
        """Positions at times, or speeds at positions; nan where the body never comes."""
        if self.run.noise.made_of_positions:
            return follow(self.run, np.maximum(places - self.release, 0.0), self.named)
        end = float(np.squeeze(self.run.end(self.run.bind(self.named))))
        return np.where(places <= end, curve_at(self.run, places, self.named), np.nan)

    def with_change(self, change: Change) -> Run:
        """Its table with other frames, or followed farther."""
        places = _denser(self.table.columns[self.where], change.frames)
        if change.reach > 1.0:
            end = change.reach * float(np.max(self.table.position))
            places = self._farther(places, end)
        return self._measured(places, change.error)

    def first(self, ramp: Mapping[str, float]) -> tuple[Run, str]:
        """The table of a new run, and a remark on it.  Raises InputError where it cannot be
        measured.
        """
        end = ramp[self.table.coordinate]
        if self.where != "t_s":
            return self._speeds_first(end), ""
        by_differences = self.run.noise.made_of_positions
        t = self.table.columns["t_s"]
        dt = float(np.median(np.diff(t)))
        t = t[t >= self.release] if by_differences else t
        for longer in _LONGER if by_differences else _LONGER[:1]:
            n = min(longer * self.table.lines.size, _MOST)
            t = t[0] + dt * np.arange(n)
            x = self.at(t)
            if np.max(x) > end or np.argmax(x) < n - 1:
                break
        # of the ramp: how far a body must have gone to show in which direction
        moving = np.flatnonzero(np.abs(x) > 0.02 * end)
        if not moving.size or x[moving[0]] < 0.0:
            raise InputError(
                later("does not start: the body rolls back, or stays where it is released"),
                field="run",
            )
        out = np.flatnonzero(~(x <= end))  # a body that is gone has no place at all
        last = int(out[0]) if out.size else x.size
        if by_differences:
            last = min(last, int(np.argmax(x[:last])) + 3)
        followed = phrase(
            "followed to the end of the ramp, {end:.2g} {unit}",
            end=end,
            unit="m" if self.table.coordinate == "x_m" else "rad",
        )
        remark = followed if out.size and out[0] <= last else ""
        return self._measured(t[:last]), remark

    def _speeds_first(self, end: float) -> Run:
        x = self.table.columns[self.where]
        places = np.linspace(float(np.min(x)), end, x.size)
        v = self.at(places)
        if not np.isfinite(v[1]):
            raise InputError(
                later(
                    "does not start, or turns back before the first position where speeds are "
                    "measured"
                ),
                field="run",
            )
        turned = np.flatnonzero(~np.isfinite(v))
        if turned.size:
            places = np.linspace(places[0], places[turned[0] - 1], x.size)
        return self._measured(places)

    def _measured(self, places: FloatArray, error: float = 1.0) -> Run:
        """Its table at `places`, with errors so many times as large."""
        table, where, y = self.table, self.where, self.at(places)
        columns = {where: places}
        if where == "t_s":
            columns[table.coordinate] = y
        else:
            columns[table.rate] = finite_or(y, 0.0)  # at rest
        old = table.columns[where]
        if where != "t_s" and "t_s" in table.columns:
            columns["t_s"] = np.interp(places, old, table.columns["t_s"])
        for name in ("sigma_x_m", "sigma_v_m_s"):
            if name in table.columns:
                nearest = np.argmin(np.abs(places[:, None] - old), axis=1)
                columns[name] = error * table.columns[name][nearest]
        return table.with_columns(columns, lines=np.arange(places.size))

    def _farther(self, places: FloatArray, end: float) -> FloatArray:
        """The places, and as many further ones as bring the body to `end`, or to its turning
        point.
        """
        step = float(np.median(np.diff(places)))
        longer = np.append(
            places, places[-1] + step * np.arange(1, min(_LONGER[-1] * places.size, _MOST))
        )
        y = self.at(longer)
        if self.where == "t_s":
            x, moving = y, np.append(np.diff(y) > 0.0, False)
        else:
            x, moving = longer, np.isfinite(y)
        further = (np.arange(longer.size) < places.size) | (moving & (x <= end))
        stop = np.flatnonzero(~further)
        return longer[: int(stop[0])] if stop.size else longer


def _denser(places: FloatArray, frames: float) -> FloatArray:
    if frames == 1.0:
        return places.copy()
    n = places.size
    return np.interp(
        np.linspace(0.0, n - 1.0, max(round((n - 1) * frames) + 1, 2)), np.arange(n), places
    )
