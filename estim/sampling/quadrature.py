"""A posterior of up to four parameters by adaptive quadrature: no draws, no proposal, no chain.

The integrals are nested.  Along the first parameter the ridge of the density is followed both ways from the mode, all others
re-optimised (`estim.sampling.ridge`), until the density and the volume around it (Laplace) have fallen by e^-16 or a limit is met; the steps
become panels with three Gauss-Legendre nodes each, halved where a five-point rule disagrees.  At every node the same is
done along the second parameter, and so on; along the last one the density itself is integrated.  Panels end exactly on the limits.
Laplace's approximation decides where nodes lie and nothing else.  Parameters that the density is least normal in come first, so
that what a curve is linear in is innermost, where it is normal.

Everything is computed twice, with coarser panels that lie elsewhere; the difference is the error that is stated.  Several
modes are taken with a smooth partition of unity, each its own part.  A mode that no start has met stays unknown here too.

Sources: Davis and Rabinowitz, Methods of Numerical Integration (1984), 5.6 (iterated rules), 6.2 (adaptive ones); Naylor and
Smith, Applied Statistics 31 (1982) 214 (quadrature in coordinates of the posterior).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.sampling.importance import log_sum_exp
from estim.sampling.protocol import Density, Support
from estim.sampling.ridge import Frame, climb, framed, separate_modes
from estim.sampling.ridge_paths import Rule, walk

IntArray = NDArray[np.int64]

MOST_DIMENSIONS = 4
MOST_NODES = 600_000  # of one rule
_MOST_HALVINGS = 9
_NEGLIGIBLE = 1e-7  # share of the whole that nodes without a future may have together
_N_CELL = 8  # of a panel, for quantiles
_NODES, _LENGTHS = (lambda rule: (0.5 * (rule[0] + 1.0), 0.5 * rule[1]))(np.polynomial.legendre.leggauss(3))  # on [0, 1]


FINE, COARSE = Rule(depth=15.0, fall=2.0, tolerance=2e-3), Rule(depth=12.0, fall=3.5, tolerance=2e-2)


@dataclass(frozen=True, eq=False)
class Nodes:
    """What a rule of quadrature gives.

    points : (n, n_par).  masses : (n,) their shares of the whole, sum 1.  log_evidence : log of the integral of the density.
    cells, cell_masses : for each parameter (n_cell, 2) lower ends and widths of intervals that its distribution is made of, and their shares.
    open : names of parameters along which the density did not fall before the walk ended.
    """

    points: FloatArray
    masses: FloatArray
    log_evidence: float
    cells: tuple[FloatArray, ...]
    cell_masses: tuple[FloatArray, ...]
    open: tuple[str, ...]

    @property
    def mean(self) -> FloatArray:
        return np.asarray(self.masses @ self.points)

    @property
    def sd(self) -> FloatArray:
        return np.sqrt(self.masses @ (self.points - self.mean) ** 2)

    def quantile(self, p: float) -> FloatArray:
        """(n_par,) of the distribution of each parameter."""
        return np.array([float(np.interp(p * below[-1], below, ends)) for ends, below in self._distributions])

    def below(self, at: FloatArray) -> FloatArray:
        """(n_par,) shares of the distribution of each parameter below at (n_par,)."""
        pairs = zip(at, self._distributions, strict=True)
        return np.array([float(np.interp(x, ends, below) / below[-1]) for x, (ends, below) in pairs])

    @cached_property
    def _distributions(self) -> list[tuple[FloatArray, FloatArray]]:
        return [_distribution(cells, masses) for cells, masses in zip(self.cells, self.cell_masses, strict=True)]


class TooManyNodesError(Exception):
    """The density is too wild for this way."""


def integrate(
    density: Density, start: FloatArray, cov: FloatArray, *, rule: Rule, starts: Sequence[FloatArray] = (), support: Support | None = None,
    most: int = MOST_NODES,
) -> Nodes:
    """Nodes of the quadrature of `density` around `start` (n_par,), a mode with covariance `cov`, and around further modes `starts`.

    support : (n_par,) lowest and highest values; infinite where left out.  most : nodes allowed.  Raises TooManyNodesError, NumericalError.
    """
    frame = framed(density, start, cov, support)
    modes = separate_modes(frame, starts)
    parts = [_integrated(_part(frame, modes, i), rule, most // len(modes)) for i in range(len(modes))]
    return parts[0] if len(parts) == 1 else _joined(parts)


@dataclass(frozen=True, eq=False)
class _Part:
    """A density times a share that is near 1 around one of several modes; the shares of all modes add up to 1 everywhere."""

    density: Density
    modes: FloatArray  # (n_mode, n_par), own order
    whitening: FloatArray  # (n_par, n_par)
    which: int

    @property
    def names(self) -> tuple[str, ...]:
        return self.density.names

    def log_density(self, draws: FloatArray) -> FloatArray:
        away = np.sum(((draws[:, None] - self.modes) @ self.whitening.T) ** 2, axis=2)
        return self.density.log_density(draws) - 0.5 * away[:, self.which] - log_sum_exp(-0.5 * away, axis=1)


def _part(frame: Frame, modes: FloatArray, which: int) -> Frame:
    if len(modes) == 1:
        return replace(frame, centre=modes[0])
    own, inverse = frame.original(modes), np.linalg.inv(frame.factor)
    whitening = np.empty_like(inverse)
    whitening[:, frame.order] = inverse
    apart = np.max(np.linalg.norm((own - own[which]) @ whitening.T, axis=1))
    # as gentle a change from one part to the next as keeps them apart: over half a standard deviation or more
    spread = min(np.linalg.norm((a - b) @ whitening.T) for i, a in enumerate(own) for b in own[:i])
    gentle = whitening * np.sqrt(min(1.0, 3.0 / max(apart, spread)))
    return replace(frame, density=_Part(frame.density, own, gentle, which), centre=modes[which])


def _joined(parts: Sequence[Nodes]) -> Nodes:
    evidence = np.array([part.log_evidence for part in parts])
    total = float(log_sum_exp(evidence))
    shares = np.exp(evidence - total)
    n_par = parts[0].points.shape[1]
    return Nodes(
        np.vstack([part.points for part in parts]), np.concatenate([s * part.masses for s, part in zip(shares, parts, strict=True)]), total,
        tuple(np.concatenate([part.cells[i] for part in parts]) for i in range(n_par)),
        tuple(np.concatenate([s * part.cell_masses[i] for s, part in zip(shares, parts, strict=True)]) for i in range(n_par)),
        tuple(dict.fromkeys(name for part in parts for name in part.open)),
    )


@dataclass(frozen=True, eq=False)
class _Level:
    """Nodes along one parameter, for every row of the level before.

    points : (n, n_par) conditional maxima at the nodes.  log_weights : (n,) product of the lengths so far.
    log_masses : (n,) log of the density along this parameter, the inner ones by Laplace's approximation.
    parent : (n,) row.  low, width : (n,) of the panel.  place : (n,) which of its three nodes.
    """

    points: FloatArray
    log_weights: FloatArray
    log_masses: FloatArray
    parent: IntArray
    low: FloatArray
    width: FloatArray
    place: IntArray

    def only(self, kept: NDArray[np.bool_]) -> _Level:
        return _Level(*(getattr(self, name)[kept] for name in self.__dataclass_fields__))


def _integrated(frame: Frame, rule: Rule, most: int) -> Nodes:
    top = climb(frame, frame.centre[None], 0, n_step=4)
    points, log_weights = top.points, np.zeros(1)
    levels: list[_Level] = []
    opened = []
    for axis in range(frame.n_par):
        level, is_open = _level(frame, axis, points, log_weights, rule)
        if not level.parent.size or not np.isfinite(log_sum_exp(level.log_weights + level.log_masses)):
            raise TooManyNodesError  # a density that is zero or no number on the way: nothing to put nodes on
        if is_open:
            opened.append(frame.density.names[frame.order[axis]])
        level = _pruned(level) if axis < frame.n_par - 1 else level
        if level.parent.size * (1 if axis == frame.n_par - 1 else 8) > most:
            raise TooManyNodesError
        levels.append(level)
        points, log_weights = level.points, level.log_weights
    log_masses = levels[-1].log_weights + levels[-1].log_masses
    log_evidence = float(log_sum_exp(log_masses))
    masses = np.exp(log_masses - log_evidence)
    cells: list[FloatArray] = [np.empty((0, 2))] * frame.n_par
    shares: list[FloatArray] = [np.empty(0)] * frame.n_par
    inner = masses
    for axis in reversed(range(frame.n_par)):
        own = int(frame.order[axis])
        cells[own], shares[own] = _cells(levels[axis], inner)
        if axis:
            inner = np.bincount(levels[axis].parent, weights=inner, minlength=levels[axis - 1].parent.size)
    return Nodes(frame.original(levels[-1].points), masses, log_evidence, tuple(cells), tuple(shares), tuple(opened))


def _pruned(level: _Level) -> _Level:
    """Without the nodes that hold next to nothing together."""
    shares = level.log_weights + level.log_masses
    shares = np.exp(shares - log_sum_exp(shares))
    order = np.argsort(shares)
    lost = np.zeros(shares.size, dtype=bool)
    lost[order] = np.cumsum(shares[order]) < _NEGLIGIBLE
    return level.only(~lost)


def _level(frame: Frame, axis: int, rows: FloatArray, log_weights: FloatArray, rule: Rule) -> tuple[_Level, bool]:
    """Nodes along parameter number `axis` for every row (n, n_par), and whether a walk along it found no end."""
    start = climb(frame, rows, axis + 1, n_step=0)
    top = float(np.max(start.log_masses))
    if not np.isfinite(top):
        raise TooManyNodesError
    whose, sense = np.tile(np.arange(len(rows)), 2), np.repeat([-1.0, 1.0], len(rows))  # both ways at once
    panels, is_open = walk(frame, axis, start.points[whose], start.log_masses[whose], top, sense, rule)
    if not panels:
        raise TooManyNodesError  # narrower than any step
    row = whose[np.concatenate([p[0] for p in panels])]
    ends = [np.concatenate([p[i] for p in panels]) for i in (1, 2)]  # points (n, n_par) at either end
    heights = [np.concatenate([p[i] for p in panels]) for i in (3, 4)]
    kept: list[_Level] = []
    totals, whole = np.zeros(0), 0.0
    for halving in range(_MOST_HALVINGS + 1):
        left, right = ends
        low, width = left[:, axis], right[:, axis] - left[:, axis]
        guess = left[:, None] + _NODES[None, :, None] * (right - left)[:, None]
        inner = climb(frame, guess.reshape(-1, frame.n_par), axis + 1)
        masses = inner.log_masses.reshape(-1, 3)
        values = np.exp(np.column_stack([heights[0], masses, heights[1]]) - top)
        three, five = width * (values[:, 1:4] @ _LENGTHS), width * (values @ _FIVE)
        if halving == 0:
            totals = np.asarray(np.bincount(row, weights=three, minlength=len(rows)), dtype=np.float64)
            whole = float(np.sum(totals * np.exp(log_weights)))
        error = np.abs(three - five)
        rough = (error > rule.tolerance * totals[row]) & (error * np.exp(log_weights[row]) > 0.01 * rule.tolerance * whole / len(rows))
        if halving == _MOST_HALVINGS:
            rough[:] = False
        final = np.repeat(~rough, 3)
        with np.errstate(divide="ignore"):
            lengths = np.log(np.outer(width, _LENGTHS))
        kept.append(
            _Level(
                inner.points, (log_weights[row][:, None] + lengths).ravel(), inner.log_masses, np.repeat(row, 3), np.repeat(low, 3),
                np.repeat(width, 3), np.tile(np.arange(3), row.size),
            ).only(final)
        )
        if not np.any(rough):
            break
        middle = inner.points.reshape(-1, 3, frame.n_par)[rough, 1]
        of_middle = masses[rough, 1]
        row = np.tile(row[rough], 2)
        ends = [np.vstack([left[rough], middle]), np.vstack([middle, right[rough]])]
        heights = [np.concatenate([heights[0][rough], of_middle]), np.concatenate([of_middle, heights[1][rough]])]
    level = _Level(*(np.concatenate([getattr(k, name) for k in kept]) for name in _Level.__dataclass_fields__))
    return level, is_open


def _cells(level: _Level, masses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower ends, widths and shares of `_N_CELL` intervals of every panel, from the masses (n,) at its nodes (parabola through the three)."""
    parts = (masses[:, None] * _PARTS[level.place]).ravel()
    low = level.low[:, None] + level.width[:, None] * np.arange(_N_CELL) / _N_CELL
    return np.column_stack([low.ravel(), np.repeat(level.width / _N_CELL, _N_CELL)]), parts


def _distribution(cells: FloatArray, masses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends of cells and the distribution function there, straight in between: a density that is flat in every cell."""
    ends = np.concatenate([cells[:, 0], cells[:, 0] + cells[:, 1]])
    slopes = np.concatenate([masses / cells[:, 1], -masses / cells[:, 1]])
    order = np.argsort(ends)
    ends, slope = ends[order], np.cumsum(slopes[order])
    below = np.concatenate([[0.0], np.cumsum(slope[:-1] * np.diff(ends))])
    return ends, np.maximum.accumulate(below)


def _interpolatory(nodes: FloatArray) -> FloatArray:
    """Weights on [0, 1] of the rule that is exact for polynomials through `nodes`."""
    powers = np.arange(nodes.size)
    return np.asarray(np.linalg.solve(nodes[None, :] ** powers[:, None], 1.0 / (powers + 1.0)))


def _shares_of_parts() -> FloatArray:
    """(3, _N_CELL) share of a node's mass in each part of its panel: integrals of Lagrange's polynomials over it."""
    edges = np.linspace(0.0, 1.0, _N_CELL + 1)
    shares = []
    for i in range(3):
        others = np.delete(_NODES, i)
        lagrange = np.polynomial.Polynomial.fromroots(others) / np.prod(_NODES[i] - others)
        shares.append(np.diff(lagrange.integ()(edges)) / _LENGTHS[i])
    return np.array(shares)


_FIVE = _interpolatory(np.concatenate([[0.0], _NODES, [1.0]]))
_PARTS = _shares_of_parts()
