"""A bent ridge made straight: u = x - shift min(((x_lead - centre)/scale)^2, 16), one parameter leading and the others following its square.

A narrow ridge that bends leaves the tails of any elliptic distribution; in u it has none to leave.  The map moves every parameter by a function of
the leading one, which stays, so volumes stay too: the density of a draw is that of its u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.sampling.factors import lower_factor

Flags = NDArray[np.bool_]

_MOST = 16.0  # square of the distance beyond which no bend is known
_FEW = 0.1  # mean square of a square's own part, 2 for a normal distribution: less is that of hardly more than two draws
_SURE = 3.0  # standard errors of a bend
_SLIGHT = 0.03  # squares of the shifts, in standard deviations given what comes before: less is not worth a bend


@dataclass(frozen=True, eq=False)
class Bend:
    """lead : the leading parameter.  centre, scale : of it.  shift : (n_par,) of the others at one scale from the centre, 0 for itself."""

    lead: int
    centre: float
    scale: float
    shift: FloatArray

    @property
    def moves(self) -> Flags:
        """(n_par,) which parameters are moved at all."""
        return np.asarray(self.shift != 0.0)

    def _way(self, points: FloatArray) -> FloatArray:
        return np.minimum(np.square((points[:, self.lead] - self.centre) / self.scale), _MOST)[:, None] * self.shift

    def straight(self, points: FloatArray) -> FloatArray:
        """(n, n_par) u of points x."""
        return points - self._way(points)

    def bent(self, points: FloatArray) -> FloatArray:
        """(n, n_par) x of points u."""
        return points + self._way(points)


def bend_of(draws: FloatArray, weights: FloatArray, movable: Flags) -> Bend | None:
    """The bend of weighted draws (n_draw, n_par) that explains most; None where none is worth it.

    weights : (n_draw,) sum 1.  movable : (n_par,) whether a parameter may follow, true where no limit is near.

    Each movable parameter's regression on the square is taken given all those before it, the ones that cannot follow included: a narrow ridge
    would be smeared by as much as its whole length is uncertain.
    """
    mean = weights @ draws
    deviation = draws - mean
    cov = (weights[:, None] * deviation).T @ deviation
    if not np.all(np.diag(cov) > 0.0):
        return None
    least = _SURE**2 * float(np.sum(weights**2)) / 2.0
    best, gain = None, _SLIGHT
    for lead in range(mean.size):
        fixed, free = (np.flatnonzero((movable == flag) & (np.arange(mean.size) != lead)) for flag in (False, True))
        order = np.concatenate([[lead], fixed, free])
        factor = lower_factor(cov[np.ix_(order, order)])
        z = np.linalg.solve(factor, deviation[:, order].T)
        square = np.minimum(z[0] ** 2, _MOST)
        square = square - weights @ square
        square = square - (weights @ (square * z[0])) * z[0]
        size = float(weights @ square**2)
        if not _FEW < size < np.inf:
            continue
        follows = (z * weights) @ square / size
        follows[: 1 + fixed.size] = 0.0
        follows[follows**2 < least] = 0.0
        if float(follows @ follows) > gain:
            shift = np.zeros(mean.size)
            shift[order] = factor @ follows
            best, gain = Bend(lead, float(mean[lead]), float(factor[0, 0]), shift), float(follows @ follows)
    return best
