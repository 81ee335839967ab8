"""From what is true of a motion to what instruments read of it, and back.

    x_read = (1 + scale_x) x + 4 b [p (l - p) - p0 (l - p0)]/l^2,    p = start + x,  p0 = start
    t_read = (1 + scale_t) t,    v_read = v (dx_read/dx)/(1 + scale_t)

Both zeros are at the release.  `scale_x`: the length by which the picture was calibrated, or a
radius where angles are counted.  b, `bow`: how far a point in the middle of a picture of length l
is displaced whose two ends are calibrated (a lens, a camera that does not look square at the ramp):
a parabola.  An encoder has no bow.  None of it can be seen in residuals alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, positive_or
from estim.model.body import Quantity


@dataclass(frozen=True, eq=False)
class Readings:
    """Errors common to all readings of a run; zero does nothing.  Scalars or (n_draw, 1).

    scale_x, scale_t : relative, 0.01 is 1 % too much.
    bow : m (or rad, as x), positive towards larger x.
    length, start : in the unit of x, exact: of the calibrated picture, and from its lower-x end to
        the release.

    >>> from estim.model import Readings
    >>> stretched = Readings(scale_x=0.01)  # all lengths are read 1 % too long
    >>> stretched.scale_x, stretched.scale_t
    (0.01, 0.0)
    """

    scale_x: Quantity = 0.0
    scale_t: Quantity = 0.0
    bow: Quantity = 0.0
    length: Quantity = 1.0
    start: Quantity = 0.0

    def parabola(self) -> tuple[FloatArray, FloatArray]:
        """(a, k) of x_read = a x - k x^2."""
        k = 4.0 * self.bow / np.square(self.length)
        return 1.0 + self.scale_x + k * (self.length - 2.0 * self.start), k

    def position(self, x: ArrayLike) -> FloatArray:
        """What is read of the true positions x (m from release)."""
        a, k = self.parabola()
        x = np.asarray(x, dtype=float)
        return np.asarray(x * (a - k * x))

    def true_position(self, reading: ArrayLike) -> FloatArray:
        """The true position (m from release) of a reading; nan beyond the farthest that can be
        read.
        """
        a, k = self.parabola()
        reading = np.asarray(reading, dtype=float)
        slope = a + np.abs(a)
        if np.any(k):
            square = a * a - 4.0 * k * reading
            slope = a + np.sqrt(np.where(square >= 0.0, square, np.nan))
        # a scale of 0 or less reads nothing
        return np.asarray(2.0 * reading / positive_or(slope, np.nan))

    def stretch(self, x: ArrayLike) -> FloatArray:
        """dx_read/dx at true positions x (m), dimensionless."""
        a, k = self.parabola()
        return np.asarray(a - 2.0 * k * np.asarray(x, dtype=float))

    def time(self, t: ArrayLike) -> FloatArray:
        """What the clock shows at the true time t (s) since release."""
        return np.asarray((1.0 + self.scale_t) * np.asarray(t, dtype=float))

    def true_time(self, reading: ArrayLike) -> FloatArray:
        """The true time (s) since release that the clock shows as `reading`."""
        return np.asarray(np.asarray(reading, dtype=float) / (1.0 + self.scale_t))

    def speed(self, v: ArrayLike, x: ArrayLike) -> FloatArray:
        """The speed (m/s) that readings give for a true speed v at the true position x (m)."""
        return np.asarray(np.asarray(v, dtype=float) * self.stretch(x) / (1.0 + self.scale_t))


def blurred_sigma(
    sigma: ArrayLike, v: ArrayLike, *, exposure: ArrayLike, share: ArrayLike = 12.0**-0.5
) -> FloatArray:
    """Standard deviation (m) of a position read from a picture exposed for `exposure` (s):
    sqrt(sigma^2 + (share v exposure)^2).

    The body moves by v exposure while the shutter is open.  share : of that length, the standard
    deviation of the place that is marked; 1/sqrt(12) where any place within the smear is as likely,
    less for who marks its middle.

    sigma : m, of a position read from a sharp picture.  v : m/s.

    >>> from estim.model import blurred_sigma
    >>> round(float(blurred_sigma(0.001, 0.6, exposure=0.01)), 5)
    0.002
    """
    return np.hypot(
        np.asarray(sigma, dtype=float),
        np.asarray(share) * np.asarray(v, dtype=float) * np.asarray(exposure),
    )
