"""How things are shown to a reader: symbols of parameters, degrees in place of radians, the kind of data, a Markdown table."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

KINDS = {
    "synthetic": "**SYNTHETIC data**: made by a program, not measured.",
    "measured": "Measured data.",
    "published": "Data taken from a publication.",
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
    base, level = re.fullmatch(r"([^\[]*)(\[.*\])?", name).groups()  # type: ignore[union-attr]
    tail = level or ""
    symbol = _SYMBOLS.get(base, base)
    tex = re.sub(r"_(\w+)", r"$_{\\mathrm{\1}}$", symbol)
    if not with_level:
        tail = ""
    if base in _ANGLES and unit == "rad":
        return Label(symbol + tail, tex + tail, "°", 180.0 / math.pi)
    return Label(symbol + tail, tex + tail, unit, 1.0)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
