"""The physical quantities of a campaign: how each is written, shown and limited.

`QUANTITIES` every run has; `EFFECTS` where the campaign states them.  Errors of length scale and
clock, which no residual shows, have a small uncertainty also where it states nothing: a ruler in a
picture is known to about 0.3 %, the time base of a camera to 0.05 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estim.common import Notation, later, phrase
from estim.model import STANDARD_GRAVITY

_DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True)
class QuantityKind:
    """A physical quantity of a campaign: how it is written, its keys with their factors to SI,
    unit, value where it is missing, meaning.
    """

    notation: Notation
    keys: Mapping[str, float]
    unit: str
    default: float | None
    english: str  # its meaning
    low: float = -np.inf
    zero: bool = True  # whether 0 is possible
    high: float = np.inf  # of the size
    too_large: str = ""  # the rule for what is beyond; "" for an angle
    default_u: float = 0.0  # standard uncertainty about 0 where nothing is stated of it

    @property
    def meaning(self) -> str:
        """What it is, in the language that is spoken."""
        return phrase(self.english)


def _angle(
    symbol: str, name: str, default: float | None, meaning: str, *, high: float
) -> QuantityKind:
    notation = Notation(symbol, "°", float(np.degrees(1.0)))
    keys = {f"{name}_deg": _DEGREE, f"{name}_rad": 1.0}
    return QuantityKind(notation, keys, "rad", default, meaning, high=high)


QUANTITIES: Mapping[str, QuantityKind] = {
    "gamma": QuantityKind(
        Notation("γ"),
        {"gamma": 1.0},
        "1",
        None,
        later("distance of the centre of mass from the axle / R"),
        0.0,
    ),
    "kappa": QuantityKind(
        Notation("κ"), {"kappa": 1.0}, "1", None, later("inertia of the disk / (M_D R²)"), 0.0
    ),
    "theta0": _angle(
        "θ₀", "theta0", None, later("angle of the particle at release"), high=2.0 * np.pi
    ),
    "phi": _angle("φ", "phi", None, later("tilt of the ramp"), high=0.5 * np.pi),
    "theta0_zero": _angle(
        "δθ₀",
        "theta0_zero",
        0.0,
        later("common zero error: added to the angle at release"),
        high=0.5 * np.pi,
    ),
    "phi_zero": _angle(
        "δφ", "phi_zero", 0.0, later("common zero error: added to the tilt"), high=0.5 * np.pi
    ),
    "rolling_resistance": QuantityKind(
        Notation("c_rr"),
        {"rolling_resistance": 1.0},
        "1",
        0.0,
        later("coefficient of rolling resistance"),
        0.0,
    ),
    "radius": QuantityKind(
        Notation("R"), {"radius_m": 1.0}, "m", None, later("radius of the disk"), 0.0, False
    ),
    "rho": QuantityKind(
        Notation("ρ"),
        {"rho": 1.0},
        "1",
        1.0,
        later("distance of the particle from the axle / R"),
        0.0,
        False,
    ),
    "trailing_fraction": QuantityKind(
        Notation("τ"),
        {"trailing_fraction": 1.0},
        "1",
        0.0,
        later("fraction of the mass that does not rotate"),
        0.0,
    ),
    "particle_gyration": QuantityKind(
        Notation("k_P"),
        {"particle_gyration": 1.0},
        "1",
        0.0,
        later("radius of gyration of the particle / R"),
        0.0,
    ),
    "g": QuantityKind(
        Notation("g"),
        {"g": 1.0},
        "m/s²",
        STANDARD_GRAVITY,
        later("acceleration of free fall"),
        0.0,
        False,
        500.0,
        "is in m/s², and must be at most 500 (is it in cm/s²?)",
    ),
}


def _effect(
    symbol: str,
    key: str,
    unit: str,
    meaning: str,
    *,
    low: float = -np.inf,
    high: float = np.inf,
    too_large: str = "",
) -> QuantityKind:
    return QuantityKind(
        Notation(symbol), {key: 1.0}, unit, 0.0, meaning, low, high=high, too_large=too_large
    )


def _of_turn(symbol: str, key: str, meaning: str) -> QuantityKind:
    return _effect(
        symbol,
        key,
        "1",
        meaning,
        high=1.0,
        too_large="is a share of the weight times R, and must be at most 1",
    )


def _scale(symbol: str, key: str, meaning: str, *, default_u: float) -> QuantityKind:
    too_large = "is a fraction of the reading (0.01 means 1 %) and must be at most 0.5"
    return QuantityKind(
        Notation(symbol),
        {key: 1.0},
        "1",
        0.0,
        meaning,
        high=0.5,
        too_large=too_large,
        default_u=default_u,
    )


GRIP = QuantityKind(
    Notation("μ"),
    {"friction": 1.0},
    "1",
    None,
    later("coefficient of static friction"),
    0.0,
    high=10.0,
    too_large="must be at most 10",
)

EFFECTS: Mapping[str, QuantityKind] = {
    "release_energy": _effect(
        "E₀",
        "release_energy",
        "1",
        later("kinetic energy at release / (M g R)"),
        high=100.0,
        too_large="is a share of the weight times R, and must be at most 100",
    ),
    "release_speed": _effect(
        "v₀", "release_speed_m_s", "m/s", later("speed of the axle at release")
    ),
    "scale_x": _scale(
        "δ_x",
        "scale_x",
        later("common relative error of the readings of the position"),
        default_u=3e-3,
    ),
    "scale_t": _scale(
        "δ_t", "scale_t", later("common relative error of the clock"), default_u=5e-4
    ),
    "moment": _effect(
        "Q",
        "resisting_moment_n_m",
        "N m",
        later("resisting moment, independent of the mass"),
        low=0.0,
    ),
    "load_resistance": _effect(
        "c_N", "load_resistance", "1", later("rolling resistance / load on the ramp"), low=0.0
    ),
    "viscous_drag": _effect(
        "k_v", "viscous_drag_per_s", "1/s", later("drag force / (M v)"), low=0.0
    ),
    "quadratic_drag": _effect(
        "k_q", "quadratic_drag_per_m", "1/m", later("drag force / (M v²)"), low=0.0
    ),
    "moment_once_cos": _of_turn(
        "a₁", "moment_once_cos", later("resisting moment as cos θ / (M g R)")
    ),
    "moment_once_sin": _of_turn(
        "b₁", "moment_once_sin", later("resisting moment as sin θ / (M g R)")
    ),
    "moment_twice_cos": _of_turn(
        "a₂", "moment_twice_cos", later("resisting moment as cos 2θ / (M g R)")
    ),
    "moment_twice_sin": _of_turn(
        "b₂", "moment_twice_sin", later("resisting moment as sin 2θ / (M g R)")
    ),
    "phi_slope": QuantityKind(
        Notation("φ′", "°/m", float(np.degrees(1.0))),
        {"phi_slope_deg_m": _DEGREE, "phi_slope_rad_m": 1.0},
        "rad/m",
        0.0,
        later("change of the tilt along the ramp"),
    ),
    "sag": _effect("sag", "sag_m", "m", later("sag of the ramp at its middle")),
    "distortion": _effect(
        "bow", "distortion_m", "m", later("displacement of the centre of the image")
    ),
}
