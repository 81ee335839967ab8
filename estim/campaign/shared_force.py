"""Which runs of a joint fit share an unmodelled force: by the rule of levels, those of one body.

The profile belongs to a body and its ramp: one force for two bodies is much worse than one for
each, so a key under [shared] or at a body, or none at all, gives each body one force that its runs
share.  Where the key stands at a run the force is that run's alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from estim.campaign.levels import Levels
from estim.common import OF_BODY
from estim.problem import Observations

# of runs that share a force: the covariance of all of them is diagonalised some two dozen times
MOST_POINTS = 1500


def sharing_runs(
    runs: Sequence[Observations], levels: Mapping[str, Levels], key: str
) -> dict[str, tuple[Observations, ...]]:
    """Name of the run, or what runs that share a force have in common -> these runs; those without
    a force are left out.
    """
    by_name = {run.name: run for run in runs if run.force}
    groups = _groups(list(by_name), levels, key).values()
    return {
        names[0] if len(names) == 1 else f"{OF_BODY}{levels[names[0]].run.body}": tuple(
            by_name[name] for name in names
        )
        for names in groups
    }


def tied_points(sizes: Mapping[str, int], levels: Mapping[str, Levels], key: str) -> dict[str, int]:
    """Run -> number of points of all runs that would share a force with it, 0 where none would;
    sizes : run -> number of its points.
    """
    groups = _groups(list(sizes), levels, key).values()
    return {
        name: sum(sizes[other] for other in names) if len(names) > 1 else 0
        for names in groups
        for name in names
    }


def _groups(
    names: Sequence[str], levels: Mapping[str, Levels], key: str
) -> dict[tuple[str, str], list[str]]:
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        run = levels[name].run
        groups.setdefault(
            ("run", name) if getattr(run, key) is not None else ("body", run.body), []
        ).append(name)
    return groups
