"""Known physics that a campaign does not say, as candidates for what its curve lacks: priors as
wide as such a thing may be, and the lines to add.

The lines carry these priors, not what a fit found: an estimate in place of a prior would use the
data twice.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import msgspec

from estim.campaign.prior_table import Value, read_source
from estim.campaign.quantities import EFFECTS, QUANTITIES
from estim.common import format_rounded, phrase
from estim.curves import Place, Setting
from estim.problem import Prior, centre_of

_RESISTANCE = 0.01  # of the weight
_SAG, _BOW = 0.005, 0.03  # of the length
_RUN = "[[runs]]"


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is known of a run.  sources : quantity -> number or prior.  mass : kg.  reach : m or
    rad, how far it was seen.
    """

    sources: Mapping[str, float | Prior]
    mass: float | None
    reach: float
    angular: bool
    positions: bool

    def exact(self, name: str) -> float | None:
        """The value of a quantity that is exact, 0 where it is not said; None where it is
        unknown.
        """
        source = self.sources.get(name, 0.0)
        return source if isinstance(source, float) else None

    def centre(self, name: str) -> float:
        return centre_of(self.sources[name])


@dataclass(frozen=True, eq=False)
class Sketch:
    """One candidate: what it is called, and the lines of a campaign that say it, the first a table.

    of_run : whether it is one unknown for each run, not for all.
    ramp, picture : where it needs one.
    """

    name: str
    words: str
    lines: tuple[str, ...]
    of_run: bool = False
    ramp: Place | None = None
    picture: Place | None = None
    begin: float = 0.0

    @cached_property
    def priors(self) -> Mapping[str, Prior]:
        """Quantity -> the prior that the lines give it (SI units)."""
        stated, priors = tomllib.loads("\n".join(self.lines[1:])), dict[str, Prior]()
        for name, kind in {**QUANTITIES, **EFFECTS}.items():
            for key in kind.keys.keys() & stated.keys():
                written: Value = msgspec.convert(stated[key], Value)
                value = read_source(written, factor=kind.keys[key], field=key, low=kind.low)
                assert not isinstance(value, float), "no candidate is exact"
                priors[name] = value
        return priors

    def setting(self, stated: Setting) -> Setting:
        """What is exact of a run with the candidate, from what is stated of it."""
        return replace(
            stated, ramp=self.ramp or stated.ramp, picture=self.picture or stated.picture
        )


def sketches(runs: Sequence[Surroundings]) -> tuple[Sketch, ...]:
    """The candidates for runs fit together: those that none of them says and all of them may
    have.
    """

    def unsaid(names: Iterable[str]) -> bool:
        return all(run.exact(name) == 0.0 for run in runs for name in names)

    candidates = [*_start(runs), *_forces(runs), *_instruments(runs)]
    if unsaid(("sag", "phi_slope")):
        candidates += _ramp(runs)
    return tuple(sketch for sketch in candidates if unsaid(sketch.priors))


def _start(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
    if any(run.exact(name) != 0.0 for run in runs for name in ("release_energy", "release_speed")):
        return
    words = phrase("a start that is not from rest, or not at x = 0")
    if all(run.positions for run in runs):
        lines = (_RUN, 'release_speed_m_s = "0.00(10)"')
        # in m/s: positions hardly depend on a speed about 0
        yield Sketch("start", words, lines, of_run=True, begin=0.05)
    elif not any(run.positions for run in runs):
        yield Sketch("start", words, (_RUN, 'release_energy = "0.000(20)"'), of_run=True)


def _shared(name: str, words: str, *lines: str) -> Sketch:
    return Sketch(name, words, ("[shared]", *lines))


def _half_normal(key: str, scale: float) -> str:
    return f'{key} = {{prior = "half-normal", scale = {scale:g}}}'


def _forces(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
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


def _instruments(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
    yield _shared("clock", phrase("a wrong clock rate (scale_t)"), 'scale_t = "0.000(20)"')
    if not any(run.angular for run in runs):
        words = phrase("a wrong length scale (scale_x)")
        yield _shared("length_scale", words, 'scale_x = "0.000(20)"')
        length = _length(runs)
        picture = _shared(
            "distortion",
            phrase("a curved image (lens, camera not perpendicular to the ramp)"),
            f'distortion_m = "0 +/- {_rounded(_BOW * length, 0.1):g}"',
            f"picture_length_m = {length:g}",
            "picture_start_m = 0",
        )
        yield replace(picture, picture=Place(length, 0.0))
    words = phrase("an unstated error in the reading of θ₀")
    yield _shared("angle_at_release", words, 'theta0_zero_deg = "0.0(30)"')
    words = phrase("an unstated error in the reading of φ")
    yield _shared("tilt", words, 'phi_zero_deg = "0.0(10)"')


def _ramp(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
    length = _length(runs)
    words = phrase("a ramp whose tilt changes along its length")
    yield _shared("bend", words, 'phi_slope_deg_m = "0.0(20)"')
    sagging = _shared(
        "sag",
        phrase("a ramp that sags between its ends"),
        f'sag_m = "0 +/- {_rounded(_SAG * length, 0.1):g}"',
        f"ramp_length_m = {length:g}",
        "ramp_start_m = 0",
    )
    yield replace(sagging, ramp=Place(length, 0.0))


def _length(runs: Sequence[Surroundings]) -> float:
    """How far the runs were seen, m."""
    longest = max(run.reach * (run.centre("radius") if run.angular else 1.0) for run in runs)
    return _rounded(longest, 0.01)


def _rounded(value: float, share: float) -> float:
    """To a digit that is `share` of it."""
    return float(format_rounded(value, share * value))
