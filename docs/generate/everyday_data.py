"""Makes the SYNTHETIC tables of docs/everyday.md, data/everyday/*.csv, each written the way that
some program or some person writes a table.

    python docs/generate/everyday_data.py
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parents[2] / "data" / "everyday"
HEAD = "# SYNTHETIC data: made by docs/generate/everyday_data.py"


def _rows(*columns: Iterable[object], mark: str = ",") -> list[str]:
    return [mark.join(str(cell) for cell in row) for row in zip(*columns, strict=True)]


def _told(values: np.ndarray, digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]


def spring(rng: np.random.Generator) -> list[str]:
    """A line: semicolons, decimal commas, units in a row of their own."""
    mass = np.arange(20.0, 201.0, 20.0)
    length = 12.4 + 0.0545 * mass + 0.08 * rng.standard_normal(mass.size)
    rows = _rows(_told(mass, 1), _told(length, 2), mark=";")
    return ["mass;length", "g;cm", *(row.replace(".", ",") for row in rows)]


def throw(rng: np.random.Generator) -> list[str]:
    """A parabola: tabs, a line of text above the names, a row without a height."""
    t = np.arange(16) / 30.0
    height = _told(1.12 + 2.35 * t - 4.905 * t**2 + 0.004 * rng.standard_normal(16), 3)
    height[9] = "-"
    return ["mass A, film 3", "t (s)\theight (m)", *_rows(_told(t, 3), height, mark="\t")]


def absorption(rng: np.random.Generator) -> list[str]:
    """An exponential: a column of uncertainties, numbers with an exponent."""
    depth = np.array([0, 2, 4, 6, 8, 10, 13, 16, 20, 25, 30])
    light = 0.412 * np.exp(-depth / 8.7)
    u = 0.003 + 0.01 * light
    read = [f"{v:.3E}" for v in light + u * rng.standard_normal(depth.size)]
    return ["depth [mm],light [V],u_light [V]", *_rows(depth, read, _told(u, 4))]


def spectrum(rng: np.random.Generator) -> list[str]:
    """A peak on a sloping background: blanks between the columns."""
    energy = np.arange(600.0, 730.0, 2.5)
    peak = 900.0 / (np.sqrt(2 * np.pi) * 9.5) * np.exp(-((energy - 661.7) ** 2) / (2 * 9.5**2))
    rate = 21.0 - 0.02 * energy + peak + 0.5 * rng.standard_normal(energy.size)
    return ["E/keV  rate/(1/s)", *_rows(_told(energy, 1), _told(rate, 2), mark="   ")]


def doublet(rng: np.random.Generator) -> list[str]:
    """Two peaks over a level: a third column that is not needed, a cell that says why it is
    empty.
    """
    place = np.linspace(588.0, 590.6, 66)
    light = sum(
        area / np.pi * 0.12 / ((place - center) ** 2 + 0.12**2)
        for area, center in ((40.0, 588.995), (20.0, 589.592))
    )
    light = _told(light + 3.0 + 0.8 * rng.standard_normal(66), 2)
    light[50] = "nan"
    return [
        "wavelength (nm),intensity (a.u.),note",
        *_rows(_told(place, 2), light, ["ok"] * 50 + ["spike"] + ["ok"] * 15),
    ]


def decays(rng: np.random.Generator) -> list[str]:
    """A histogram: the middle of each bin and how many fell into it."""
    middle = np.arange(0.25, 10.0, 0.5)
    return ["t_us,N", *_rows(_told(middle, 2), rng.poisson(260.0 * np.exp(-middle / 2.2) + 4.0))]


def swing(rng: np.random.Generator) -> list[str]:
    """A swing that dies out: the marks of a German program, a mean that is not 0."""
    t = np.arange(0.0, 12.0, 0.15)
    angle = 9.2 * np.exp(-0.06 * t) * np.cos(2 * np.pi * t / 1.53 + 2.4) + 0.4
    read = _told(angle + 0.2 * rng.standard_normal(t.size), 2)
    rows = _rows(_told(t, 2), read, mark=";")
    return ["t / s;phi / °", *(row.replace(".", ",") for row in rows)]


def resonance(rng: np.random.Generator) -> list[str]:
    """A resonance: one column is called f, so it is the variable of the formula."""
    f = np.concatenate([np.arange(0.2, 0.9, 0.1), np.arange(0.9, 1.3, 0.025), [1.4, 1.6, 2.0]])
    swing = 0.62 / np.sqrt((1 - (f / 1.083) ** 2) ** 2 + (f / 1.083 / 7.4) ** 2)
    return [
        "f (Hz),amplitude (cm)",
        *_rows(_told(f, 3), _told(swing + 0.05 * rng.standard_normal(f.size), 2)),
    ]


def capacitor(rng: np.random.Generator) -> list[str]:
    """A capacitor that is charged: an oscilloscope's quotation marks, more digits than it has."""
    t = np.arange(0.0, 25.0, 0.5)
    voltage = 4.96 * (1 - np.exp(-t / 4.7)) + 0.02 * rng.standard_normal(t.size)
    return ['"Time (ms)","Ch 1 (V)"', *_rows(_told(t, 6), _told(voltage, 6))]


def calibration(rng: np.random.Generator) -> list[str]:
    """Errors in both variables, each in its own column."""
    true = np.linspace(1.0, 9.0, 9)
    u_x, u_y = np.full(9, 0.08), 0.05 + 0.02 * true
    x = true + u_x * rng.standard_normal(9)
    y = 0.35 + 1.27 * true + u_y * rng.standard_normal(9)
    return ["I (A),u(I),U (V),u(U)", *_rows(_told(x, 2), _told(u_x, 2), _told(y, 2), _told(u_y, 2))]


def laboratories(rng: np.random.Generator) -> list[str]:
    """Values of one quantity with their uncertainties, and who found them."""
    u = np.array([0.05, 0.02, 0.08, 0.04, 0.03])
    value = 9.806 + u * rng.standard_normal(5)
    return ["group,g (m/s²),u_g (m/s²)", *_rows("ABCDE", _told(value, 3), _told(u, 3))]


def periods(rng: np.random.Generator) -> list[str]:
    """Readings of a stop watch: one column, one of them not taken."""
    readings = _told(1.851 + 0.03 * rng.standard_normal(12), 2)
    readings[7] = ""
    return ["number,T (s)", *_rows(range(1, 13), readings)]


TABLES: tuple[Callable[[np.random.Generator], list[str]], ...] = (
    spring,
    throw,
    absorption,
    spectrum,
    doublet,
    decays,
    swing,
    resonance,
    capacitor,
    calibration,
    laboratories,
    periods,
)


def tables() -> dict[str, str]:
    """The text of each file by its name."""
    return {
        f"{make.__name__}.csv": "\n".join([HEAD, *make(np.random.default_rng([9, i])), ""])
        for i, make in enumerate(TABLES)
    }


if __name__ == "__main__":
    DATA.mkdir(exist_ok=True)
    for name, text in tables().items():
        (DATA / name).write_text(text, encoding="utf-8")
