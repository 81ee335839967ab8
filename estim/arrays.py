"""The types of arrays that annotations speak of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Named = Mapping[str, ArrayLike]
"""Parameter or argument -> its value, or a column (n_draw, 1) of draws."""
