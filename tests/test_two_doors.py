"""The two ways to fit a curve, `estim.fit_curve` and `estim fit TABLE --formula`: what one says of a table, the other says too."""

from __future__ import annotations

import numpy as np

from estim import fit_curve
from estim.fitting import profile_intervals

SINKING = "y0 - v*x + v*tau*(1 - exp(-x/tau))"


def slowing_ball() -> tuple[np.ndarray, np.ndarray]:
    """A ball that sinks ever slower, where the formula of one released from rest (`SINKING`) fits best at the edge tau = 0 of its range."""
    x = np.linspace(0.0, 1.6, 50)
    return x, 0.028 - 0.068 * x + 0.004 * x**2 + 1e-4 * np.random.default_rng(1).standard_normal(x.size)


def test_profiles_end_in_words_where_the_density_falls_off_a_cliff() -> None:
    # beyond tau = 0 the curve is exp(+x/|tau|) in size: differences of the density overflowed in the products that descents make of them
    found = fit_curve(SINKING, *slowing_ball())
    assert abs(found.values["tau"]) < 1e-10
    for interval in profile_intervals(found.fit):
        assert all(np.isfinite([*interval.low.values(), *interval.high.values()]))
