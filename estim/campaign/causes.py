"""Known physics that a campaign does not say, as candidates for what its curve lacks: priors as
wide as such a thing may be, and the lines to add.

The lines carry these priors, not what a fit found: an estimate in place of a prior would use the
data twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.campaign.quantities import EFFECTS
from estim.common import format_rounded, phrase
from estim.curves import Place, Setting
from estim.problem import HalfNormal, Normal, Prior

_RESISTANCE = 0.01  # of the weight
_SAG, _BOW = 0.005, 0.03  # of the length
_PUSH = 0.05  # m/s: positions hardly depend on a speed about 0
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
        source = self.sources[name]
        return source if isinstance(source, float) else source.centre


@dataclass(frozen=True, eq=False)
class Sketch:
    """One candidate: what it is called, quantities with their priors (SI units), and lines of the
    campaign.

    of_run : whether it is one unknown for each run, not for all.
    ramp, picture : where it needs one.
    """

    name: str
    words: str
    priors: Mapping[str, Prior]
    lines: tuple[str, ...]
    of_run: bool = False
    ramp: Place | None = None
    picture: Place | None = None
    begin: float = 0.0

    @property
    def disturbs(self) -> bool:
        """Whether the plain motion does not know it."""
        return any(name in EFFECTS for name in self.priors)

    def setting(self, stated: Setting | None, mass: float | None) -> Setting:
        """What is exact of a run with the candidate, from what is stated of it."""
        setting = stated or Setting(mass)
        return replace(
            setting, ramp=self.ramp or setting.ramp, picture=self.picture or setting.picture
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
        yield Sketch(
            "start",
            words,
            {"release_speed": Normal(0.0, 0.1)},
            (_RUN, 'release_speed_m_s = "0.00(10)"'),
            of_run=True,
            begin=_PUSH,
        )
    elif not any(run.positions for run in runs):
        yield Sketch(
            "start",
            words,
            {"release_energy": Normal(0.0, 0.02)},
            (_RUN, 'release_energy = "0.000(20)"'),
            of_run=True,
        )


def _forces(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
    shared = "[shared]"
    yield Sketch(
        "rolling_resistance",
        phrase("rolling resistance"),
        {"rolling_resistance": HalfNormal(_RESISTANCE)},
        (shared, f'rolling_resistance = {{prior = "half-normal", scale = {_RESISTANCE:g}}}'),
    )
    yield Sketch(
        "load_resistance",
        phrase("rolling resistance proportional to the load on the ramp"),
        {"load_resistance": HalfNormal(_RESISTANCE)},
        (shared, f'load_resistance = {{prior = "half-normal", scale = {_RESISTANCE:g}}}'),
    )
    if all(run.mass is not None for run in runs):
        weights = [(run.mass or 0.0) * run.centre("g") * run.centre("radius") for run in runs]
        scale = float(format_rounded(_RESISTANCE * max(weights), 0.1 * _RESISTANCE * max(weights)))
        yield Sketch(
            "resisting_moment",
            phrase("a resisting moment (bearing, cord)"),
            {"moment": HalfNormal(scale)},
            (shared, f'resisting_moment_n_m = {{prior = "half-normal", scale = {scale:g}}}'),
        )
    yield Sketch(
        "viscous_drag",
        phrase("drag that increases with the speed"),
        {"viscous_drag": HalfNormal(0.2)},
        (shared, 'viscous_drag_per_s = {prior = "half-normal", scale = 0.2}'),
    )
    yield Sketch(
        "quadratic_drag",
        phrase("drag that increases with the square of the speed (air)"),
        {"quadratic_drag": HalfNormal(0.2)},
        (shared, 'quadratic_drag_per_m = {prior = "half-normal", scale = 0.2}'),
    )
    of_turns = {
        "once": phrase("a moment once per turn (out of round, a bent axle)"),
        "twice": phrase("a moment twice per turn (out of round, a bent axle)"),
    }
    for times, words in of_turns.items():
        names = (f"moment_{times}_cos", f"moment_{times}_sin")
        yield Sketch(
            f"moment_{times}",
            words,
            {name: Normal(0.0, 0.01) for name in names},
            (shared, *(f'{name} = "0.000(10)"' for name in names)),
        )


def _instruments(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
    shared, degree = "[shared]", float(np.radians(1.0))
    yield Sketch(
        "clock",
        phrase("a wrong clock rate (scale_t)"),
        {"scale_t": Normal(0.0, 0.02)},
        (shared, 'scale_t = "0.000(20)"'),
    )
    if not any(run.angular for run in runs):
        words = phrase("a wrong length scale (scale_x)")
        yield Sketch(
            "length_scale", words, {"scale_x": Normal(0.0, 0.02)}, (shared, 'scale_x = "0.000(20)"')
        )
        length = _length(runs)
        bow = float(format_rounded(_BOW * length, 0.1 * _BOW * length))
        yield Sketch(
            "distortion",
            phrase("a curved image (lens, camera not perpendicular to the ramp)"),
            {"distortion": Normal(0.0, bow)},
            (
                shared,
                f'distortion_m = "0 +/- {bow:g}"',
                f"picture_length_m = {length:g}",
                "picture_start_m = 0",
            ),
            picture=Place(length, 0.0),
        )
    yield Sketch(
        "angle_at_release",
        phrase("an unstated error in the reading of θ₀"),
        {"theta0_zero": Normal(0.0, 3.0 * degree)},
        (shared, 'theta0_zero_deg = "0.0(30)"'),
    )
    yield Sketch(
        "tilt",
        phrase("an unstated error in the reading of φ"),
        {"phi_zero": Normal(0.0, degree)},
        (shared, 'phi_zero_deg = "0.0(10)"'),
    )


def _ramp(runs: Sequence[Surroundings]) -> Iterator[Sketch]:
    degree, length = float(np.radians(1.0)), _length(runs)
    yield Sketch(
        "bend",
        phrase("a ramp whose tilt changes along its length"),
        {"phi_slope": Normal(0.0, 2.0 * degree)},
        ("[shared]", 'phi_slope_deg_m = "0.0(20)"'),
    )
    sag = float(format_rounded(_SAG * length, 0.1 * _SAG * length))
    yield Sketch(
        "sag",
        phrase("a ramp that sags between its ends"),
        {"sag": Normal(0.0, sag)},
        ("[shared]", f'sag_m = "0 +/- {sag:g}"', f"ramp_length_m = {length:g}", "ramp_start_m = 0"),
        ramp=Place(length, 0.0),
    )


def _length(runs: Sequence[Surroundings]) -> float:
    """How far the runs were seen, m."""
    longest = max(run.reach * (run.centre("radius") if run.angular else 1.0) for run in runs)
    return float(format_rounded(longest, 0.01 * longest))
