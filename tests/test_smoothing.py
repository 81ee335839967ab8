"""Lines and histograms of figures, smoothed as SciPy smooths them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter

from estim.reports.smoothing import blurred, monotone


@pytest.mark.parametrize("n", [2, 3, 4, 17])
def test_a_line_through_points_is_that_of_scipy(rng: np.random.Generator, n: int) -> None:
    for _ in range(20):
        x = np.cumsum(rng.uniform(0.01, 1.0, n))
        y = rng.standard_normal(n)
        y[-1] = y[0] if n == 4 else y[-1]
        y[1] = y[0] if n == 17 else y[1]  # a flat piece
        places = np.concatenate([np.linspace(x[0], x[-1], 101), x])
        assert monotone(x, y, places) == pytest.approx(PchipInterpolator(x, y)(places), abs=1e-12)


def test_it_falls_nowhere_between_rising_points(rng: np.random.Generator) -> None:
    x, y = np.cumsum(rng.uniform(0.01, 1.0, 9)), np.cumsum(rng.uniform(0.0, 1.0, 9) ** 4)
    assert np.all(np.diff(monotone(x, y, np.linspace(x[0], x[-1], 500))) >= -1e-12)


@pytest.mark.parametrize(("n", "sd"), [(30, 1.2), (30, 4.0), (5, 1.2), (3, 2.0)])
def test_a_histogram_is_smoothed_as_by_scipy(rng: np.random.Generator, n: int, sd: float) -> None:
    counts = rng.poisson(3.0, (n, n)).astype(float)
    assert blurred(counts, sd) == pytest.approx(gaussian_filter(counts, sd), abs=1e-12)
    assert blurred(counts, sd).sum() == pytest.approx(counts.sum())
