"""Runs of rolling bodies as they would be measured: tables without errors, at the fit, and the
problem that they pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from estim.arrays import FloatArray
from estim.calibration import follow, release_times
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
from estim.deviation import ForceSize, force_sizes
from estim.fitting import Fit, expected_information
from estim.planning.changes import Wish
from estim.problem import Observations, Problem
from estim.reading import Run

_BEYOND = 3  # frames behind the turning point
_LONGER = (1, 2, 4)  # times the duration of the run that it is like: how long a new run may take
_MOST = 3000  # frames
_ENDS = 1.02  # times the farthest reading, which has an error: where the ramp is taken to end
_BEGUN = 0.02  # of the ramp: how far a body must have gone to show in which direction


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

    def outlook(self, wish: Wish) -> Outlook:
        """What the runs would say if the wish came true, its `u` left aside.  Raises InputError
        where that cannot be measured.
        """
        changed = otherwise(self.campaign, reading_error=wish.error, reach=wish.reach)
        changed = with_runs(changed, wish.runs)
        like = {run.name: run.like for run in wish.runs}
        release = {
            name: self.release[old]
            for name in (*self.names, *like)
            if (old := like.get(name, name)) in self.release
        }
        tables = dict(changed.tables)
        remarks = list[str]()
        named = self.fit.problem.named(self.fit.values)
        for run in self.fit.problem.runs:
            tables[run.name] = _measured_again(
                run, tables[run.name], named, release.get(run.name, 0.0), wish
            )
        measured = {run.name: run for run in self.fit.problem.runs}
        for new in wish.runs:
            posed = replace(
                measured[new.like],
                arguments=MappingProxyType(self._arguments(measured[new.like], new)),
            )
            table, remark = _measured_first(
                posed, tables[new.name], named, release.get(new.name, 0.0), self.ramp
            )
            tables[new.name] = table
            remarks += [remark] if remark else []
        campaign = with_tables(changed, tables)
        problem = with_own_gamma(self._posed(campaign, (*self.names, *like)), wish.runs)
        values = self._values(problem, wish.runs)
        sizes = {
            name: self.sizes[old]
            for name in (*self.names, *like)
            if (old := like.get(name, name)) in self.sizes
        }
        information = expected_information(problem, values, sizes)
        return Outlook(
            problem,
            values,
            information,
            campaign,
            MappingProxyType(release),
            tuple(dict.fromkeys(remarks)),
        )

    def _posed(self, campaign: Campaign, names: Sequence[str]) -> Problem:
        problem = campaign.problem(names)
        return (
            as_complete(problem, "estim plan")
            if any(run.positions for run in problem.runs)
            else problem
        )

    def _arguments(self, like: Observations, new: NewRun) -> dict[str, str | float]:
        return {**like.arguments, **{name: quantity.value for name, quantity in new.said.items()}}

    def _values(self, problem: Problem, runs: Sequence[NewRun]) -> FloatArray:
        """(n_par,) the fitted values; of a new run what it says, else those of the run that it is
        like.
        """
        fitted, found = dict(zip(self.fit.names, self.fit.values, strict=True)), {}
        for new in runs:
            like = next(run for run in self.fit.problem.runs if run.name == new.like)
            for p in problem.parameters:
                base, level = split_level(p.name)
                if level == f"[{new.name}]":
                    source = self._arguments(like, new).get(base, f"{base}[{new.like}]")
                    found[p.name] = fitted[source] if isinstance(source, str) else source
        return np.array(
            [fitted[p.name] if p.name in fitted else found[p.name] for p in problem.parameters]
        )


def rolling_basis(campaign: Campaign, names: Sequence[str], fit: Fit) -> RollingBasis:
    """What plans start from.  Raises InputError for noise that cannot be simulated."""
    ramp: dict[str, float] = {}
    for table in campaign.tables.values():
        ramp[table.coordinate] = max(
            ramp.get(table.coordinate, 0.0), _ENDS * float(np.max(table.columns[table.coordinate]))
        )
    release = release_times(campaign, fit.problem, fit.values)
    return RollingBasis(
        campaign,
        tuple(names),
        fit,
        release,
        MappingProxyType(force_sizes(fit.posterior, fit.values)),
        MappingProxyType(ramp),
    )


def _measured_again(
    run: Observations, table: Run, named: Mapping[str, FloatArray], release: float, wish: Wish
) -> Run:
    """The table of a run without its errors, with other frames, or followed farther."""
    where = "t_s" if run.noise.made_of_positions or run.positions else table.coordinate
    places = _denser(table.columns[where], wish.frames)
    if wish.reach > 1.0:
        places = _farther(
            run,
            places,
            named,
            release,
            wish.reach * float(np.max(table.columns[table.coordinate])),
            where == "t_s",
        )
    return _table(run, table, places, where, named, release, wish.error)


def _measured_first(
    run: Observations,
    table: Run,
    named: Mapping[str, FloatArray],
    release: float,
    ramp: Mapping[str, float],
) -> tuple[Run, str]:
    """The table of a new run, and what is worth saying of it.  Raises InputError where it cannot be
    measured.
    """
    end = ramp[table.coordinate]
    if not (run.noise.made_of_positions or run.positions):
        return _speeds_first(run, table, named, end)
    t = table.columns["t_s"]
    dt = float(np.median(np.diff(t)))
    t = t[t >= release] if run.noise.made_of_positions else t
    for longer in _LONGER if run.noise.made_of_positions else _LONGER[:1]:
        n = min(longer * table.lines.size, _MOST)
        t = t[0] + dt * np.arange(n)
        x = (
            follow(run, t - release, named)
            if run.noise.made_of_positions
            else _curve(run, t, named)
        )
        if np.max(x) > end or np.argmax(x) < n - 1:
            break
    begun = np.flatnonzero(np.abs(x) > _BEGUN * end)
    if not begun.size or x[begun[0]] < 0.0:
        raise InputError(
            later("does not start: the body rolls back, or stays where it is released"), field="run"
        )
    out = np.flatnonzero(~(x <= end))  # a body that is gone has no place at all
    last = int(out[0]) if out.size else x.size
    if run.noise.made_of_positions:
        last = min(last, int(np.argmax(x[:last])) + _BEYOND)
    followed = phrase(
        "followed to the end of the ramp, {end:.2g} {unit}",
        end=end,
        unit="m" if table.coordinate == "x_m" else "rad",
    )
    remark = followed if out.size and out[0] <= last else ""
    return _table(run, table, t[:last], "t_s", named, release, 1.0), remark


def _speeds_first(
    run: Observations, table: Run, named: Mapping[str, FloatArray], end: float
) -> tuple[Run, str]:
    x = table.columns[table.coordinate]
    places = np.linspace(float(np.min(x)), end, x.size)
    v = _curve(run, places, named)
    if not np.isfinite(v[1]):
        raise InputError(
            later(
                "does not start, or turns back before the first position where speeds are measured"
            ),
            field="run",
        )
    turned = np.flatnonzero(~np.isfinite(v))
    if turned.size:
        places = np.linspace(places[0], places[turned[0] - 1], x.size)
    return _table(run, table, places, table.coordinate, named, 0.0, 1.0), ""


def _table(
    run: Observations,
    table: Run,
    places: FloatArray,
    where: str,
    named: Mapping[str, FloatArray],
    release: float,
    error: float,
) -> Run:
    columns = {where: places}
    if run.noise.made_of_positions:
        columns[table.coordinate] = follow(run, np.maximum(places - release, 0.0), named)
    elif run.positions:
        columns[table.coordinate] = _curve(run, places, named)
    else:
        columns[table.rate] = _at_rest(_curve(run, places, named))
    old = table.columns[where]
    if where != "t_s" and "t_s" in table.columns:
        columns["t_s"] = np.interp(places, old, table.columns["t_s"])
    for name in ("sigma_x_m", "sigma_v_m_s"):
        if name in table.columns:
            nearest = np.argmin(np.abs(places[:, None] - old), axis=1)
            columns[name] = error * table.columns[name][nearest]
    return table.with_columns(columns, lines=np.arange(places.size))


def _denser(places: FloatArray, frames: float) -> FloatArray:
    if frames == 1.0:
        return places.copy()
    n = places.size
    return np.interp(
        np.linspace(0.0, n - 1.0, max(round((n - 1) * frames) + 1, 2)), np.arange(n), places
    )


def _farther(
    run: Observations,
    places: FloatArray,
    named: Mapping[str, FloatArray],
    release: float,
    end: float,
    in_time: bool,
) -> FloatArray:
    """The places, and as many further ones as bring the body to `end`, or to its turning point."""
    step = float(np.median(np.diff(places)))
    longer = np.append(
        places, places[-1] + step * np.arange(1, min(_LONGER[-1] * places.size, _MOST))
    )
    if not in_time:
        x = longer
        moving = np.isfinite(_curve(run, longer, named))
    else:
        x = (
            follow(run, longer - release, named)
            if run.noise.made_of_positions
            else _curve(run, longer, named)
        )
        moving = np.append(np.diff(x) > 0.0, False)
    further = (np.arange(longer.size) < places.size) | (moving & (x <= end))
    stop = np.flatnonzero(~further)
    return longer[: int(stop[0])] if stop.size else longer


def _curve(run: Observations, x: FloatArray, named: Mapping[str, FloatArray]) -> FloatArray:
    with np.errstate(invalid="ignore"):
        return np.array(np.broadcast_to(run.curve.value(x, run.bind(named)), (1, x.size))[0])


def _at_rest(v: FloatArray) -> FloatArray:
    return np.where(np.isfinite(v), v, 0.0)
