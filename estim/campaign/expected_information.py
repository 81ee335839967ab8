"""What runs would say that are measured as their tables have it: the information about every
parameter, with an unmodelled force of known size.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estim.arrays import FloatArray
from estim.campaign.forced import KEY, trajectory_of
from estim.campaign.levels import Levels
from estim.campaign.shared_force import sharing_runs
from estim.common import InputError
from estim.deviation import ForceSize, expected_root
from estim.fitting import information
from estim.problem import Problem
from estim.reading import Run


def expected_information_of(
    problem: Problem,
    tables: Mapping[str, Run],
    levels: Mapping[str, Levels],
    values: FloatArray,
    sizes: Mapping[str, ForceSize],
) -> FloatArray:
    """(n_par, n_par) information at `values` (n_par,), priors included; runs that share a force
    give theirs together.

    sizes : run -> how large its force is.  Raises InputError where a force cannot be linearised, or
        does not go with these runs.
    """
    for run in problem.runs:
        if run.name in sizes and not run.force:
            raise InputError(
                f"would take the curve of {run.name} as complete: "
                f"{'; '.join(run.complete.names) if run.complete else 'no force'}"
            )
    plain = tuple(run for run in problem.runs if run.name not in sizes)
    total = information(Problem(problem.parameters, plain).linearised(values), values)
    for runs in sharing_runs(
        [run for run in problem.runs if run.name in sizes], levels, KEY
    ).values():
        courses = {run.name: trajectory_of(run, tables[run.name]) for run in runs}
        size = next(
            (sizes[run.name] for run in runs if sizes[run.name].several), sizes[runs[0].name]
        )
        root = expected_root(runs, courses, problem, values, size)
        total = total + root.T @ root
    return np.asarray(total)
