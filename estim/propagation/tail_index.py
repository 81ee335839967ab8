"""Whether a distribution has a standard deviation at all, by draws of it."""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray

_TAIL_SHARES, _LEAST_TAIL = (1e-3, 1e-4), 50  # of the draws, that a tail index is taken from
# tail index from which on none exists (1/2 and 1 in theory; a little less, for it is estimated)
NO_VARIANCE, NO_MEAN = 0.45, 0.9


def tail_index(draws: FloatArray) -> FloatArray:
    """() or (n_out,) Hill's index of the longer tail of draws (n_draw,) or (n_draw, n_out), lowered
    by twice its standard error.

    The mean of log(|y - median|/threshold) over the values beyond a threshold, for several
    thresholds; the largest counts.  Where there are too few draws or no spread it is 0.  Source:
    Hill, Ann. Statist. 3 (1975) 1163.
    """
    columns = draws.reshape(len(draws), -1).T
    return np.array([_hill(column[np.isfinite(column)]) for column in columns]).reshape(
        draws.shape[1:]
    )


def _hill(values: FloatArray) -> float:
    largest, ordered = 0.0, np.sort(values)
    for share in _TAIL_SHARES:
        n_tail = max(int(share * values.size), _LEAST_TAIL)
        if values.size < 20 * n_tail:
            continue
        median = 0.5 * (ordered[(values.size - 1) // 2] + ordered[values.size // 2])
        for tail in (ordered[-n_tail - 1 :] - median, (median - ordered[: n_tail + 1])[::-1]):
            if tail[0] > 0.0:
                largest = max(
                    largest,
                    float(np.mean(np.log(tail[1:] / tail[0]))) * (1.0 - 2.0 / math.sqrt(n_tail)),
                )
    return largest
