"""The prior of a deviation: how large, over which lengths, and how well the size of the noise is
known; a grid that is summed over.

    amplitude a                 0 with probability `spike`, else half-normal
    length l                    log-normal about a sixth of the track, by a factor of two
    scale s of the noise        log s Cauchy about 0, by a factor of 1.35; below 1 it counts as
                                evidence only (see `linearised`)

The numbers come from a study of coverage by simulation.  With them the 68 % intervals of slope,
gamma and theta0 of a wheel cover 62-83 % for smooth profiles from half to eight standard deviations
of a reading, for pushes and for correlated errors (91 % at most), and are 6-17 % wider where
nothing is missing.  A deviation that is switched on by a test is not calibrated: it comes too late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray

FORCE_SCALE = 0.02  # of the weight: scale of the half-normal prior of the amplitude of a force
START_SD = 0.02  # of the weight times the radius: prior sd of the energy at release
SPIKE = 0.5
SCALES = (0.1, 0.16, 0.25, 0.4, 0.5, 0.63, 0.8, 1.0, 1.25, 1.6, 2.0)
_N_AMPLITUDE, _N_LENGTH = 17, 6
_SCALE_SPREAD = 0.3  # half-width of log s
_LENGTH_SPREAD = 0.7  # sd of log l
_PART = 6.0  # the median length is the track divided by this
_LOWEST, _HIGHEST = 3e-3, 5.0  # amplitudes, in units of the scale of their prior
_SHORTEST, _LONGEST = 1.0 / 30.0, 0.6  # lengths, in units of the track


@dataclass(frozen=True, eq=False)
class Grid:
    """Values of amplitude and noise scale with their logarithmic prior probabilities, each
    normalised.

    amplitudes : (n_a,) unit of the deviation; the first is 0.
    scales : (n_s,) of the stated noise.
    """

    amplitudes: FloatArray
    log_amplitudes: FloatArray
    scales: FloatArray
    log_scales: FloatArray


def prior_grid(
    amplitude: float,
    *,
    spike: float = SPIKE,
    scales: tuple[float, ...] = SCALES,
    n_amplitude: int = _N_AMPLITUDE,
) -> Grid:
    """The grid for a half-normal prior of scale `amplitude` (unit of the deviation) beside a
    probability `spike` of none at all.

    n_amplitude : 96 of them move means by at most 0.001 and standard deviations by 0.3 %, those of
        a wheel whose force is far larger than its noise; 12 move means by up to 0.07.
    scales : factors of the stated noise, one of them 1; (1,) alone where its size is known, or
        inferred as a parameter.
    """
    sizes = amplitude * np.geomspace(_LOWEST, _HIGHEST, n_amplitude)
    # equal steps of log a: density times a
    slab = _normalised(np.log(sizes) - 0.5 * np.square(sizes / amplitude))
    factors, wide = _noise_scales(scales)
    return Grid(np.r_[0.0, sizes], np.r_[np.log(spike), np.log1p(-spike) + slab], factors, wide)


def noise_grid() -> Grid:
    """The grid of the size of the noise alone, as beside a deviation, and no deviation."""
    return Grid(np.zeros(1), np.zeros(1), *_noise_scales(SCALES))


def track_lengths(track: float) -> tuple[FloatArray, FloatArray]:
    """Lengths (n_length,) from a thirtieth to 0.6 of the track, in its unit, and their log prior
    probabilities: log-normal(track/6, 0.7).
    """
    lengths = track * np.geomspace(_SHORTEST, _LONGEST, _N_LENGTH)
    return lengths, _normalised(-0.5 * np.square(np.log(lengths * _PART / track) / _LENGTH_SPREAD))


def _noise_scales(scales: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    factors = np.array(scales, dtype=float)
    # Cauchy: an error stated far too large must show
    return factors, _normalised(-np.log1p(np.square(np.log(factors) / _SCALE_SPREAD)))


def _normalised(log_weight: FloatArray) -> FloatArray:
    return log_weight - np.logaddexp.reduce(log_weight)
