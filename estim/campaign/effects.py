"""What a campaign states in addition to weight and constant rolling resistance: what goes together,
and the exact numbers that go with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estim.campaign.lookup_levels import Levels
from estim.campaign.quantities import EFFECTS
from estim.common import InputError
from estim.curves import MotionCurve, PhaseCurve, Place, RollingMotion, Setting, energy_of_speed
from estim.problem import Observations, Prior, centre_of
from estim.reading import KeyPath

_EXCLUSIVE = (("release_energy", "release_speed"), ("sag", "phi_slope"))
_SDS = 2.0  # how far a speed at release is from 0 where v(x) is fit by it


def setting_of(
    levels: Levels,
    sources: Mapping[str, float | Prior],
    mass: float | None,
    *,
    positions: bool,
    angular: bool,
) -> Setting:
    """What is exact of a run, with effects among its quantities (`sources`, SI units) or not.

    positions : whether positions in time are fit.  Raises InputError where something does not go
        together or is missing.
    """
    effects = [name for name in EFFECTS if name in sources]
    for first, second in _EXCLUSIVE:
        if first in effects and second in effects:
            raise _error(
                levels,
                second,
                f"must not stand beside '{_path_of(levels, first)[-1]}', which says the same",
            )
    for name, forbidden, rule in (
        (
            "moment",
            mass is None,
            "needs the masses (mass_disk_kg, mass_particle_kg): it moves a heavy body less "
            "than a light one",
        ),
        ("distortion", angular, "does not apply to angles, which an image does not distort"),
        (
            "release_energy",
            positions,
            "cannot be combined with positions noise: use release_speed_m_s, in which "
            "positions are smooth at 0",
        ),
    ):
        if name in effects and forbidden:
            raise _error(levels, name, rule)
    if "release_speed" in effects and not positions:
        _check_speed(levels, sources)
    ramp = _length(levels, "sag", "ramp", sources)
    picture = _length(levels, "distortion", "picture", sources)
    return Setting(mass, ramp, picture)


def _check_speed(levels: Levels, sources: Mapping[str, float | Prior]) -> None:
    """Speeds depend on the square of the speed at release, with its sign: near 0 not at all, to
    first order.
    """
    speed = sources["release_speed"]
    if isinstance(speed, float):
        return
    largest = max(abs(speed.centre), speed.sd)
    if abs(speed.centre) < _SDS * speed.sd:
        centres = {name: centre_of(source) for name, source in sources.items()}
        energy = energy_of_speed(centres | {"release_speed": largest})
        rule = (
            f"must lie {_SDS:g} standard uncertainties or more from 0, where speeds hardly "
            f'depend on it: say release_energy = "0 +/- {energy:.1g}"'
        )
        raise _error(levels, "release_speed", rule, value=speed.describe())


def with_full_curves(
    runs: Sequence[Observations], ramps: Mapping[str, Place | None], centres: Mapping[str, float]
) -> list[Observations]:
    """Runs whose motion has the curve with every effect that may be stated in addition.

    ramps : run -> its ramp as stated.  Where nothing is stated, the ramp reaches as far as any of
        the runs was recorded.
    centres : unknown -> the centre of its prior.
    """
    reaches = [_reach(run, centres) for run in runs]
    low, high = min(reach[0] for reach in reaches), max(reach[1] for reach in reaches)
    completed = []
    for run in runs:
        motion, ramp = run.motion, ramps[run.name] or Place(high - low, -low)
        assert isinstance(motion, RollingMotion)
        setting = replace(motion.setting, ramp=ramp)
        full = (MotionCurve if run.positions else PhaseCurve)(motion.angular, setting)
        completed.append(replace(run, motion=replace(motion, full=full, ramp_length=ramp.length)))
    return completed


def _reach(run: Observations, centres: Mapping[str, float]) -> tuple[float, float]:
    """How far a run was recorded on either side of the release, m."""

    def centre(argument: str) -> float:
        source = run.arguments.get(argument, 0.0)
        return centres[source] if isinstance(source, str) else source

    unit = centre("radius") if isinstance(run.motion, RollingMotion) and run.motion.angular else 1.0
    since = unit * (run.position - centre("offset"))
    return min(float(np.min(since)), 0.0), max(float(np.max(since)), 0.0)


def stated_place(levels: Levels, of_what: str) -> Place | None:
    """The "ramp" or "picture" of a run as it is stated, from its lower end where nothing is stated
    of the start; None where it is not.  Raises InputError where it is impossible.
    """
    entries = {}
    for key in (f"{of_what}_length_m", f"{of_what}_start_m"):
        level = levels.first(key)
        entries[key] = (
            (0.0, ()) if level is None else (float(getattr(level.table, key)), (*level.path, key))
        )
    (length, path), (start, where) = entries.values()
    if not path:
        return None
    if not 0.0 <= start <= length:
        raise levels.error(
            f"must lie between 0 and '{of_what}_length_m' = {length:g}", where, value=start
        )
    return Place(length, start)


def _length(levels: Levels, name: str, of_what: str, sources: Mapping[str, float | Prior]) -> Place:
    """Where on a ramp or in a picture the release is, for the quantity `name`."""
    if name not in sources:
        return Place()
    for key, what in (
        (f"{of_what}_length_m", "the whole length"),
        (f"{of_what}_start_m", "where on it the release is"),
    ):
        if levels.first(key) is None:
            raise _error(levels, name, f"needs '{key}' beside it, {what}")
    place = stated_place(levels, of_what)
    assert place is not None
    length, centre = place.length, centre_of(sources[name])
    if abs(centre) > 0.1 * length:
        raise _error(
            levels,
            name,
            f"must be at most a tenth of '{of_what}_length_m' = {length:g}",
            value=centre,
        )
    return place


def _path_of(levels: Levels, name: str) -> KeyPath:
    """Where in the file an effect stands."""
    keys = EFFECTS[name].keys
    return next((*level.path, key) for level in levels for key in level.stated(keys))


def _error(levels: Levels, name: str, rule: str, *, value: object = None) -> InputError:
    return levels.error(rule, _path_of(levels, name), value=value)
