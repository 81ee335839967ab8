"""A user's own curve with further readings: tables without errors, at the fit, and the problem that
they pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from estim.arrays import FloatArray
from estim.calibration import curve_at
from estim.campaign import Campaign, axis_columns, group_columns, with_tables
from estim.common import InputError, later
from estim.fitting import Fit, expected_information
from estim.planning.candidates import Change
from estim.planning.rolling import Outlook, RollingBasis
from estim.problem import Problem, Scale


@dataclass(frozen=True, eq=False)
class CurveBasis:
    """A campaign of a user's own curve with the fit of some of its runs."""

    campaign: Campaign
    names: tuple[str, ...]
    fit: Fit

    def outlook(self, change: Change) -> Outlook:
        """The information of the readings with the change made, without its `u`.  Raises InputError
        where that cannot be measured.
        """
        x_column, y_column = axis_columns(self.campaign)
        named, tables = self.fit.named, dict(self.campaign.tables)
        for run in self.fit.problem.runs:
            table = tables[run.name]
            at = table.columns[x_column]
            new = [
                reading.x
                for reading in change.readings
                if reading.run == run.name
                for _ in range(reading.n)
            ]
            near = [int(np.argmin(np.abs(at - x))) for x in new]
            rows = np.append(_every_so_often(at, change.frames), near).astype(int)
            x = at[rows].copy()
            x[rows.size - len(new) :] = new
            columns = {name: column[rows].copy() for name, column in table.columns.items()}
            y, known = curve_at(run, x, named), rows.size - len(new)
            for place in x[known:][~np.isfinite(y[known:])]:
                raise InputError(later("the curve is not finite there"), field="x", value=place)
            # a row outside the window may lie where the curve is not finite: it is not used
            columns |= {x_column: x, y_column: np.where(np.isfinite(y), y, columns[y_column])}
            for name in group_columns(self.campaign, run.name):  # another day, or instrument
                columns[name][rows.size - len(new) :] = np.max(columns[name]) + 1.0
            order = np.argsort(x, kind="stable")
            arranged = {name: column[order] for name, column in columns.items()}
            tables[run.name] = table.with_columns(arranged, lines=np.arange(order.size))
        campaign = with_tables(self.campaign, tables)
        problem = campaign.problem(self.names)
        self._require_places(problem, change)
        problem, values = _errors_times(problem, self._values(problem), change.error)
        return Outlook(problem, values, expected_information(problem, values, {}), campaign, {})

    def _values(self, problem: Problem) -> FloatArray:
        fitted = dict(zip(self.fit.names, self.fit.values, strict=True))
        return np.array([fitted[name] for name in problem.names])

    def _require_places(self, problem: Problem, change: Change) -> None:
        for reading in change.readings:
            run = next(run for run in problem.runs if run.name == reading.run)
            if not np.any(run.x == reading.x):
                raise InputError(
                    later("lies outside the window, or between the selected points"),
                    field="x",
                    value=reading.x,
                )


Basis: TypeAlias = RollingBasis | CurveBasis
"""What plans start from: a campaign and its fit."""


def _every_so_often(x: FloatArray, times: float) -> FloatArray:
    """Rows, each repeated by the factor, spread evenly where that is no whole number."""
    return np.floor(np.arange(round(x.size * times)) / times).astype(int).clip(0, x.size - 1)


def _errors_times(
    problem: Problem, values: FloatArray, factor: float
) -> tuple[Problem, FloatArray]:
    """The problem, and the values, with errors of the readings `factor` times as large, whether
    stated or inferred.
    """
    if factor == 1.0:
        return problem, values
    runs, inferred = [], set[str]()
    for run in problem.runs:
        scale, noise = run.noise.size.sigma, run.noise
        smaller: Any = noise
        if not hasattr(noise, "sigma"):
            rule = later("what a reading has alone cannot be told from the errors of its group")
            raise InputError(rule, field="error")
        if noise.share:
            noise = replace(smaller, share=factor * noise.share)
        elif scale.parameter is None:
            noise = replace(smaller, sigma=Scale(factor * scale.value))
        else:
            inferred.add(scale.parameter)
        runs.append(replace(run, noise=noise))
    times = np.array([factor if name in inferred else 1.0 for name in problem.names])
    return replace(problem, runs=tuple(runs)), values * times
