"""What limits a result: how far an uncertainty would fall if something else were known exactly.

Gaussian approximation at the fit: fixing a group of parameters removes their rows and columns from
the information matrix.  The share that a group takes is 1 - (u with the group known)^2/u^2; shares
of groups that act through one degeneracy overlap and need not add up to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import Label
from estim.fitting import Fit, information
from estim.pipeline import Analysis


@dataclass(frozen=True)
class LimitingUncertainty:
    """If `group` were known exactly, u(parameter) would fall from `u` to `u_known`."""

    parameter: str
    group: str
    u: float
    u_known: float

    @property
    def share(self) -> float:
        return 1.0 - (self.u_known / self.u) ** 2


@dataclass(frozen=True, eq=False)
class Narrowing:
    """Standard uncertainties (least squares) of shared parameters from the first n runs of a joint
    problem together.

    names, labels : the parameters, and how they are shown.
    runs : run names in the order they are added.  u : (n_run, n_name).
    u_single : the same from each run alone.
    u_prior : (n_name,) what was stated before, nan for a uniform prior.
    """

    names: tuple[str, ...]
    labels: tuple[Label, ...]
    runs: tuple[str, ...]
    u: FloatArray
    u_single: FloatArray
    u_prior: FloatArray


def limits(fit: Fit, parameter: str) -> tuple[LimitingUncertainty, ...]:
    """What each group of other parameters (all tilts, all angles of release, ...) costs
    `parameter`, largest share first.

    Empty where the fit is singular: then nothing is limited by one thing alone.
    """
    if fit.singular:
        return ()
    names = fit.problem.names
    matrix = information(fit.posterior, fit.values)
    own = names.index(parameter)
    u = float(np.sqrt(np.linalg.inv(matrix)[own, own]))
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        if i != own:
            groups.setdefault(name.partition("[")[0], []).append(i)
    costs = []
    for group, members in groups.items():
        remaining = [i for i in range(len(names)) if i not in members]
        known = float(
            np.sqrt(
                np.linalg.inv(matrix[np.ix_(remaining, remaining)])[
                    remaining.index(own), remaining.index(own)
                ]
            )
        )
        costs.append(LimitingUncertainty(parameter, group, u, known))
    return tuple(sorted(costs, key=lambda limit: -limit.share))


def narrowing(
    joint: Fit, single_runs: Sequence[Analysis], names: Sequence[str], *, first_runs: Sequence[Fit]
) -> Narrowing:
    """How u of the shared parameters `names` falls as the runs of a joint fit are added one by one.

    first_runs : the fits of its first two, three, ... runs together, without that of all.
    """
    problem = joint.problem
    fits = [single_runs[0].fit, *first_runs, joint][-len(problem.runs) :]
    shared = {p.name: p for p in problem.parameters if p.name in names}
    priors = [shared[name].prior for name in names]
    return Narrowing(
        tuple(names),
        tuple(shared[name].label for name in names),
        problem.run_names,
        _sds(fits, names),
        _sds([single.fit for single in single_runs], names),
        np.array([prior.sd if prior.informative else np.nan for prior in priors]),
    )


def _sds(fits: Sequence[Fit], names: Sequence[str]) -> FloatArray:
    """(n_fit, n_name) standard uncertainties, near a bound of a prior too."""
    columns = [[fit.names.index(name) for name in names] for fit in fits]
    return np.sqrt([np.diag(fit.cov)[at] for fit, at in zip(fits, columns, strict=True)])
