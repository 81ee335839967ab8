"""The models of the noise between which the data of a run of a rolling body leave a choice."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from estim.campaign.campaign_file import NoiseTable
from estim.campaign.lookup_levels import Levels, stated_noise
from estim.common import phrase
from estim.problem import Noise
from estim.reading import Run


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """One model of the noise: what it is called, what it takes for granted, its table."""

    name: str
    words: str
    table: NoiseTable


def noise_candidates(
    levels: Levels, data: Run, posed: Callable[[NoiseTable], Noise]
) -> tuple[NoiseModel, ...]:
    """The models of the noise that the table `data` of a run and its noise table allow.  Raises
    InputError where there is nothing to choose between.

    posed : noise table -> the noise of the run with it.
    """
    noise = stated_noise(levels)
    table = noise.table
    position, speed = (
        ("sigma_x_m", "sigma_v_m_s")
        if data.coordinate == "x_m"
        else ("sigma_theta_rad", "sigma_omega_rad_s")
    )
    read = getattr(table, position) is not None or table.encoder_step_rad is not None
    # a scatter is of what the stated model fits: of positions, or of speeds
    of_positions, of_speeds = (
        (table.scatter, None) if table.model == "positions" else (None, table.scatter)
    )
    stated: dict[str, Any] = {position: getattr(table, position)}
    of_reading: dict[str, Any] = {
        "encoder_step_rad": table.encoder_step_rad,
        "exposure_s": table.exposure_s,
    }
    candidates = []
    if "t_s" in data.columns and (read or "sigma_x_m" in data.columns or of_positions is not None):
        normal = NoiseTable(model="positions", scatter=of_positions, **of_reading, **stated)
        candidates += _with_tails("positions", phrase("positions as read, in time"), normal)
    if "t_s" in data.columns and read:
        differentiated = NoiseTable(
            model="differentiated",
            derivative=table.derivative,
            scatter=of_speeds,
            **of_reading,
            **stated,
        )
        words = phrase("speeds from differences of positions, with the resulting covariance")
        candidates.append(NoiseModel("differentiated", words, differentiated))
        size = _independent_size(posed(differentiated))
        if size > 0.0 and data.rate not in data.columns:
            naive = NoiseTable(
                model="independent", derivative=table.derivative or "central", scatter=of_speeds
            )
            naive = msgspec.structs.replace(naive, **{speed: size})
            words = phrase("the same speeds as if their errors were independent (they are not)")
            candidates.append(NoiseModel("independent", words, naive))
    if data.rate in data.columns and (
        getattr(table, speed) is not None or "sigma_v_m_s" in data.columns or of_speeds is not None
    ):
        normal = NoiseTable(
            model="independent",
            scatter=of_speeds,
            **(stated if table.model == "independent" else {}),
        )
        normal = msgspec.structs.replace(normal, **{speed: getattr(table, speed)})
        candidates += _with_tails("independent", phrase("speeds as measured"), normal)
    if not candidates:
        raise noise.error(
            f"allows no other model for run '{levels.run.name}': nothing to compare (times "
            f"and '{position}' would allow several)"
        )
    return tuple(candidates)


def _with_tails(name: str, words: str, normal: NoiseTable) -> list[NoiseModel]:
    shapes: dict[str, str] = {
        "student-t": phrase("Student-t tails"),
        "mixture": phrase("a fraction of outlying frames"),
    }
    robust = [
        NoiseModel(
            f"{name}, {shape}", f"{words}; {tails}", msgspec.structs.replace(normal, robust=shape)
        )
        for shape, tails in shapes.items()
    ]
    return [NoiseModel(name, words, normal), *robust]


def _independent_size(noise: Noise) -> float:
    """Standard deviation of one differentiated speed, 0 where the size of the noise is inferred."""
    if noise.size.sigma.parameter is not None:
        return 0.0
    return math.sqrt(noise.size.sigma.value**2 + noise.size.quantisation_variance) * float(
        np.median(noise.reading_gain())
    )
