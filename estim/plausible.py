"""Numbers that break no rule but are surely a slip of the unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estim.levels import Levels, Path
from estim.noise import Scale

_SHARE = 0.1  # of the path


def check_reading_error(sigma: Scale, key: str, position: NDArray[np.float64], levels: Levels, path: Path) -> None:
    """The stated standard deviation of a position against the path (n_row,), both in the same unit.

    Raises InputError at its line where it is a tenth of the path or more: of such positions nothing can be learnt.
    """
    reach = float(np.ptp(position))
    if sigma.parameter is None and sigma.value >= _SHARE * reach > 0.0:
        unit = "m" if key == "sigma_x_m" else "rad"
        slip = "is it in mm?" if unit == "m" else "is it in degrees?"
        rule = f"must be well below the length of the run, {reach:.4g} {unit} ({slip} The key is in {unit})"
        raise levels.error(rule, (*path, key), value=sigma.value)
