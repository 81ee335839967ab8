"""How things are shown to a reader: symbols of parameters, degrees in place of radians, the kind of data, a Markdown table."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from estim.common.escaping import LETTERS, Markdown, markdown

KINDS = {
    "synthetic": Markdown("**SYNTHETIC data**: made by a program, not measured."),
    "measured": Markdown("Measured data."),
    "published": Markdown("Data taken from a publication."),
}
_SYMBOLS = {
    "gamma": "γ",
    "kappa": "κ",
    "theta0": "θ₀",
    "phi": "φ",
    "theta0_zero": "δθ₀",
    "phi_zero": "δφ",
    "rolling_resistance": "c_rr",
    "radius": "R",
    "rho": "ρ",
    "trailing_fraction": "τ",
    "particle_gyration": "k_P",
    "g": "g",
    "sigma_x": "σ_x",
    "sigma_theta": "σ_θ",
    "sigma_v": "σ_v",
    "sigma_omega": "σ_ω",
    "sigma_y": "σ_y",
    "scatter": "scatter",
    "inertia_ratio": "j",
    "slope": "s",
    "resisting_moment": "Q_rr",
    "turning_point": "x_t",
    "release_time": "t₀",
    "offset": "x₀",
    "outlier_fraction": "outlier fraction",
    "log_outlier_width": "ln outlier width",
}
_SUBSCRIPT = re.compile(rf"(?<=[^_])_((?:[{LETTERS}]+_)*[{LETTERS}]+)$")
_ANGLES = ("theta0", "phi", "theta0_zero", "phi_zero")


@dataclass(frozen=True)
class Label:
    """symbol : with its level in brackets, for text.  tex : the same for a figure.  unit : shown; factor : shown units per SI unit."""

    symbol: str
    tex: str
    unit: str
    factor: float

    @property
    def axis(self) -> str:
        return self.tex if self.unit == "1" else f"{self.tex} ({self.unit})"


def label(name: str, unit: str, *, with_level: bool = True) -> Label:
    """How the parameter `name` ("theta0[heavy-04]", unit "rad") is shown ("θ₀[heavy-04]", degrees)."""
    base, bracket, level = name.partition("[")
    tail = bracket + level if with_level else ""
    symbol = _SYMBOLS.get(base, base)
    tex = _SUBSCRIPT.sub(lambda found: "$_{\\mathrm{" + found[1].replace("_", r"\_") + "}}$", symbol)
    if base in _ANGLES and unit == "rad":
        return Label(symbol + tail, tex + tail, "°", 180.0 / math.pi)
    return Label(symbol + tail, tex + tail, unit, 1.0)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Markdown:
    """A Markdown table; cells that are not `Markdown` are shown literally."""
    lines = [head, [Markdown("---")] * len(head), *rows]
    return Markdown("\n".join(f"| {' | '.join(map(markdown, cells))} |" for cells in lines))
