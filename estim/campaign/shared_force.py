"""Which runs of a joint fit share an unmodelled force: by the rule of levels, those of one body.

The profile belongs to a body and its ramp: one force for two bodies is much worse than one for each, so a key under [shared] or at a body gives
each body one force that its runs share.  Where the key stands at a run the force is that run's alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from estim.campaign.levels import Levels
from estim.problem import Observations

MOST_POINTS = 1500  # of runs that share a force: the covariance of all of them is diagonalised some two dozen times


def sharing_runs(runs: Sequence[Observations], levels: Mapping[str, Levels], key: str) -> dict[str, tuple[Observations, ...]]:
    """Name of the body, or of the run -> the runs that share an unmodelled force, those without one left out.

    Raises InputError at the key's line where so many points are tied together that their covariance takes too long.
    """
    groups: dict[str, list[Observations]] = {}
    for run in runs:
        if run.force:
            of_run = levels[run.name]
            groups.setdefault(run.name if getattr(of_run.run, key) is not None else f"body {of_run.run.body}", []).append(run)
    for together in groups.values():
        n_obs = sum(run.n_obs for run in together)
        if len(together) > 1 and n_obs > MOST_POINTS:
            of_run = levels[together[0].name]
            path = next((*level.path, key) for level in of_run if getattr(level.table, key) is not None)
            rule = f"ties {len(together)} runs with {n_obs} points together, more than {MOST_POINTS}: fit fewer runs, or say it at each run instead"
            raise of_run.error(f"{rule}, which gives each a force of its own", path)
    return {runs[0].name if len(runs) == 1 else label: tuple(runs) for label, runs in groups.items()}
