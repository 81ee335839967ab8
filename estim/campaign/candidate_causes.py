"""What a campaign does not state, or may state wrongly, as candidates for what its curve lacks:
each is the campaign as it would read with a few other lines.

Lines carry priors as wide as such a thing may be, not what a fit found: an estimate in place of a
prior would use the data twice.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import msgspec

from estim.campaign.campaign_file import CampaignFile, LevelTable
from estim.campaign.quantities import EFFECTS, QUANTITIES
from estim.common import format_rounded, phrase
from estim.explanation import Estimated
from estim.problem import Prior, centre_of

_RESISTANCE = 0.01  # of the weight
_SAG, _BOW = 0.005, 0.03  # of the length
_RUN = "[[runs]]"
_BEGIN = 0.05  # m/s: positions hardly depend on a speed about 0


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is known of a run.  sources : quantity -> number or prior.  mass : kg.  reach : m or
    rad, how far it was recorded.
    """

    sources: Mapping[str, float | Prior]
    mass: float | None
    reach: float
    angular: bool
    positions: bool

    def exact(self, name: str) -> float | None:
        """The value of a quantity that is exact, 0 where it is not stated; None where it is
        unknown.
        """
        source = self.sources.get(name, 0.0)
        return source if isinstance(source, float) else None

    def centre(self, name: str) -> float:
        return centre_of(self.sources[name])


@dataclass(frozen=True, eq=False)
class Candidate:
    """words : what may be missing, or wrong.  source : the campaign with it.  of : the
    quantities (or parameters, without their level) that this candidate adds.  The other fields are
    as in `Cause`.
    """

    name: str
    words: str
    source: CampaignFile
    of: tuple[str, ...]
    lines: tuple[str, ...] = ()
    remark: str = ""
    scanned: Estimated | None = None
    begin: float = 0.0
    slip: bool = False


_Lines = tuple[str, str, tuple[str, ...]]  # name, words, and the lines, the first a table


def sketches(source: CampaignFile, runs: Sequence[Surroundings]) -> tuple[Candidate, ...]:
    """The candidates for runs fit together: those that none of them states and all of them may
    have.
    """

    def unstated(names: Iterable[str]) -> bool:
        return all(run.exact(name) == 0.0 for run in runs for name in names)

    every = [*_start(runs), *_forces(runs), *_instruments(runs)]
    if unstated(("sag", "phi_slope")):
        every += _ramp(runs)
    candidates = (with_lines(source, *entry) for entry in every)
    return tuple(candidate for candidate in candidates if unstated(candidate.of))


def with_lines(source: CampaignFile, name: str, words: str, lines: tuple[str, ...]) -> Candidate:
    """The campaign with `lines`, in place of whatever states the same at any level."""
    stated, kinds = tomllib.loads("\n".join(lines[1:])), {**QUANTITIES, **EFFECTS}
    of = tuple(q for q, kind in kinds.items() if kind.keys.keys() & stated.keys())
    table = msgspec.convert(stated, LevelTable)
    values = {key: getattr(table, key) for key in stated}
    source = without(source, of, *stated)
    if lines[0] == _RUN:
        source = replace(source, runs=tuple(_replaced(run, values) for run in source.runs))
    else:
        source = replace(source, shared=_replaced(source.shared, values))
    begin = _BEGIN if "release_speed" in of else 0.0
    return Candidate(name, words, source, of or (name,), lines, begin=begin)


def without(source: CampaignFile, quantities: Iterable[str], *further: str) -> CampaignFile:
    """The campaign as if some quantities were not stated, or under `further` keys."""
    kinds = {**QUANTITIES, **EFFECTS}
    keys = {*further, *(key for name in quantities for key in kinds[name].keys)}

    def change(level: LevelTable) -> LevelTable:
        spread = {key: sd for key, sd in (level.between_runs or {}).items() if key not in keys}
        return _replaced(level, {**dict.fromkeys(keys), "between_runs": spread or None})

    return source.with_levels(change)


def _replaced(table: Any, values: Mapping[str, Any]) -> Any:
    return msgspec.structs.replace(table, **values)


def _start(runs: Sequence[Surroundings]) -> Iterator[_Lines]:
    if any(run.exact(name) != 0.0 for run in runs for name in ("release_energy", "release_speed")):
        return
    words = phrase("a start that is not from rest, or not at x = 0")
    if all(run.positions for run in runs):
        yield "start", words, (_RUN, 'release_speed_m_s = "0.00(10)"')
    elif not any(run.positions for run in runs):
        yield "start", words, (_RUN, 'release_energy = "0.000(20)"')


def _shared(name: str, words: str, *lines: str) -> _Lines:
    return name, words, ("[shared]", *lines)


def _half_normal(key: str, scale: float) -> str:
    return f'{key} = {{prior = "half-normal", scale = {scale:g}}}'


def _forces(runs: Sequence[Surroundings]) -> Iterator[_Lines]:
    yield _shared(
        "rolling_resistance",
        phrase("rolling resistance"),
        _half_normal("rolling_resistance", _RESISTANCE),
    )
    yield _shared(
        "load_resistance",
        phrase("rolling resistance proportional to the load on the ramp"),
        _half_normal("load_resistance", _RESISTANCE),
    )
    if all(run.mass is not None for run in runs):
        weights = [(run.mass or 0.0) * run.centre("g") * run.centre("radius") for run in runs]
        yield _shared(
            "resisting_moment",
            phrase("a resisting moment (bearing, cord)"),
            _half_normal("resisting_moment_n_m", _rounded(_RESISTANCE * max(weights), 0.1)),
        )
    yield _shared(
        "viscous_drag",
        phrase("drag that increases with the speed"),
        _half_normal("viscous_drag_per_s", 0.2),
    )
    yield _shared(
        "quadratic_drag",
        phrase("drag that increases with the square of the speed (air)"),
        _half_normal("quadratic_drag_per_m", 0.2),
    )
    of_turns = {
        "once": phrase("a moment once per turn (out of round, a bent axle)"),
        "twice": phrase("a moment twice per turn (out of round, a bent axle)"),
    }
    for times, words in of_turns.items():
        lines = (f'moment_{times}_{part} = "0.000(10)"' for part in ("cos", "sin"))
        yield _shared(f"moment_{times}", words, *lines)


def _instruments(runs: Sequence[Surroundings]) -> Iterator[_Lines]:
    yield _shared("clock", phrase("a wrong clock rate (scale_t)"), 'scale_t = "0.000(20)"')
    if not any(run.angular for run in runs):
        words = phrase("a wrong length scale (scale_x)")
        yield _shared("length_scale", words, 'scale_x = "0.000(20)"')
        length = _length(runs)
        yield _shared(
            "distortion",
            phrase("a curved image (lens, camera not perpendicular to the ramp)"),
            f'distortion_m = "0 +/- {_rounded(_BOW * length, 0.1):g}"',
            f"picture_length_m = {length:g}",
            "picture_start_m = 0",
        )
    words = phrase("an unstated error in the reading of θ₀")
    yield _shared("angle_at_release", words, 'theta0_zero_deg = "0.0(30)"')
    words = phrase("an unstated error in the reading of φ")
    yield _shared("tilt", words, 'phi_zero_deg = "0.0(10)"')


def _ramp(runs: Sequence[Surroundings]) -> Iterator[_Lines]:
    length = _length(runs)
    words = phrase("a ramp whose tilt changes along its length")
    yield _shared("bend", words, 'phi_slope_deg_m = "0.0(20)"')
    yield _shared(
        "sag",
        phrase("a ramp that sags between its ends"),
        f'sag_m = "0 +/- {_rounded(_SAG * length, 0.1):g}"',
        f"ramp_length_m = {length:g}",
        "ramp_start_m = 0",
    )


def _length(runs: Sequence[Surroundings]) -> float:
    """How far the runs were recorded, m."""
    longest = max(run.reach * (run.centre("radius") if run.angular else 1.0) for run in runs)
    return _rounded(longest, 0.01)


def _rounded(value: float, share: float) -> float:
    """To a digit that is `share` of it."""
    return float(format_rounded(value, share * value))


_KEYS = {"θ₀": ("theta0_deg", "theta0_rad"), "φ": ("phi_deg", "phi_rad")}


def unit_slips(source: CampaignFile) -> Iterator[Candidate]:
    """θ₀, φ or both in radians, where they are stated in degrees."""
    for symbols in (("θ₀",), ("φ",), ("θ₀", "φ")):
        keys = dict(_KEYS[symbol] for symbol in symbols)
        quantities = tuple(key.removesuffix("_deg") for key in keys)
        changed = source.with_levels(partial(_with_keys, keys=keys))
        yield Candidate(
            "-".join(("radians", *quantities)),
            phrase(
                "{symbols} given in radians, not degrees", symbols=phrase(" and ").join(symbols)
            ),
            changed,
            quantities,
            remark=phrase(
                "write {right} in place of {wrong}",
                right=", ".join(keys.values()),
                wrong=", ".join(keys),
            ),
            slip=True,
        )


def _with_keys(table: LevelTable, keys: dict[str, str]) -> LevelTable:
    """A table with what it states under one key moved to another."""
    renamed = {wrong: right for wrong, right in keys.items() if getattr(table, wrong) is not None}
    values = {right: getattr(table, wrong) for wrong, right in renamed.items()}
    return msgspec.structs.replace(table, **dict.fromkeys(renamed), **values)
