"""Which other parameter values draw exactly the same curve: exchanged components, changed signs,
turned phases.

a*exp(-k*x) + b*exp(-q*x) is the same curve with (a, k) and (b, q) exchanged, A*sin(w*x + p) with -A
and p + pi.  Such values are one solution under several labels.  They are distinguished from an
alias (a frequency that agrees at the measured points only) by the curve itself, at random
parameters and at random x between the points.

Every map looked for is  image = matrix @ values + shift  with one or more pairs exchanged, or up to
three signs changed and phases turned by a half, and a further parameter that takes up the
difference: A*cos(x - p)**2 + c is the same curve with -A, p + pi/2 and c + A.  All determinants are
1 or -1, and what passes is closed under composition.  `Labelled` is the posterior folded onto one
of the labels, so that draws of it describe one solution; nothing of its integral is lost.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray
from estim.common import Amount, Finding, Kind
from estim.problem.posterior import Posterior, Problem
from estim.words import describe

TURNS = (0.5, 1.0, math.pi, 2.0 * math.pi, 180.0, 360.0)  # after which a phase may be the same
_PART = 1.0 / 16.0  # of a turn, within a standard deviation of the others
# places along the others' common direction, in standard deviations; trials of a turn
_APART, _N_APART, _N_TURN = 0.125, 64, 16


@dataclass(frozen=True, eq=False)
class Symmetry:
    """Maps under which curves and priors of a problem stay as they are, the identity first.

    matrix : (n_map, n_par, n_par).
    shift : (n_map, n_par).  period : (n_par,) one full turn, inf where there is none.
    low, high : (n_par,) limits of the parameters.
    weight : (n_par,) of squared distances that choose the label.
    repeat : (n_par,) step after which the curve is the same at the mode, where it depends on other
        parameters (t0 of sin(w*(x - t0))) and is far beyond what the data leave open; else inf.
    """

    matrix: FloatArray
    shift: FloatArray
    period: FloatArray
    low: FloatArray
    high: FloatArray
    weight: FloatArray
    repeat: FloatArray

    @property
    def trivial(self) -> bool:
        return self.shift.shape[0] == 1 and not np.any(
            np.isfinite(self.period) | np.isfinite(self.repeat)
        )

    @property
    def flips(self) -> BoolArray:
        """(n_par,) parameters whose sign a map changes."""
        return np.any(np.diagonal(self.matrix, axis1=1, axis2=2) < 0.0, axis=0)

    @property
    def unsigned(self) -> BoolArray:
        """(n_par,) parameters whose sign a map changes alone, as b of sqrt(1 + b**2*x)."""
        diagonal = np.diagonal(self.matrix, axis1=1, axis2=2)
        diagonals = diagonal[:, :, None] * np.eye(diagonal.shape[1])
        alone = np.all(self.matrix == diagonals, axis=(1, 2)) & ~np.any(self.shift, axis=1)
        alone &= np.count_nonzero(diagonal < 0.0, axis=1) == 1
        return np.any((diagonal < 0.0) & alone[:, None], axis=0)

    def images(self, draws: FloatArray, near: FloatArray) -> tuple[FloatArray, FloatArray]:
        """All images (n_map, n_draw, n_par) of draws (n_draw, n_par), turned as close to `near`
        (n_par,) as the limits allow, and how many full turns of each lie within the limits.
        """
        return self.turned(self.mapped(draws), near)

    def mapped(self, draws: FloatArray) -> FloatArray:
        """(n_map, n_draw, n_par) images of draws (n_draw, n_par), phases as they come."""
        return draws @ self.matrix.transpose(0, 2, 1) + self.shift[:, None, :]

    def turned(self, mapped: FloatArray, near: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Images (n_map, n_draw, n_par) with phases as close to `near` (..., n_par) as the limits
        allow.

        And how many full turns of each lie within the limits (n_map, n_draw): 0 where none does, 1
        where they are without limits.
        """
        images, number = mapped.copy(), np.ones(mapped.shape[:2])
        for i in np.flatnonzero(np.isfinite(self.period)):
            n_turn = np.round((near[..., i] - images[..., i]) / self.period[i])
            least = np.ceil((self.low[i] - images[..., i]) / self.period[i])
            most = np.floor((self.high[i] - images[..., i]) / self.period[i])
            images[..., i] += self.period[i] * np.clip(n_turn, least, np.maximum(most, least))
            if math.isfinite(self.high[i] - self.low[i]):
                number *= np.maximum(most - least + 1.0, 0.0)
        inside = np.all((images >= self.low) & (images <= self.high), axis=2)
        return images, np.where(inside, number, 0.0)

    def nearest(self, values: FloatArray, near: FloatArray) -> FloatArray:
        """The image of `values` (n_par,) within the limits that is closest to `near` (n_par,)."""
        inside = self.within(values, near)
        with np.errstate(over="ignore"):  # 1e200 away is far
            return min(
                inside,
                key=lambda image: float(np.sum(self.weight * (image - near) ** 2)),
                default=values,
            )

    def within(self, values: FloatArray, near: FloatArray) -> list[FloatArray]:
        """The images of `values` (n_par,) inside the limits; phases turned as close to `near`
        (n_par,) as they can be.
        """
        images, number = self.images(values[None, :], near)
        return [image for image, n in zip(images[:, 0], number[:, 0], strict=True) if n > 0.0]

    @property
    def order(self) -> IntArray:
        """(n_map, n_par) from which parameter each image takes its value: itself but where two are
        exchanged.
        """
        kept_in_place = np.diagonal(self.matrix, axis1=1, axis2=2) != 0.0
        return np.where(
            kept_in_place, np.arange(kept_in_place.shape[1]), np.argmax(np.abs(self.matrix), axis=2)
        )

    def widened(self, n: int) -> Symmetry:
        """The same with `n` further parameters at the end, which nothing moves."""
        if not n:
            return self
        n_map, n_par = self.shift.shape
        matrix = np.repeat(np.eye(n_par + n)[None, :, :], n_map, axis=0)
        matrix[:, :n_par, :n_par] = self.matrix
        endless = np.full(n, np.inf)
        return Symmetry(
            matrix,
            np.hstack([self.shift, np.zeros((n_map, n))]),
            np.append(self.period, endless),
            np.append(self.low, -endless),
            np.append(self.high, endless),
            np.append(self.weight, np.zeros(n)),
            np.append(self.repeat, endless),
        )

    def scaled(self, sds: FloatArray, bent: Sequence[int]) -> Symmetry:
        """Labels chosen by distances in units of `sds` (n_par,), those of exchanged parameters made
        equal.

        They count in the parameters `bent` and in those whose sign a map changes; a phase decides
        only where nothing else does.
        """
        square = np.square(sds)
        for _ in range(2):
            square = np.max(square[self.order], axis=0)
        counting = np.isin(np.arange(sds.size), bent) | self.flips
        weight = np.where(counting & (square > 0.0), 1.0 / np.maximum(square, 1e-300), 0.0)
        return replace(self, weight=np.where(np.isfinite(self.period), 1e-6 * weight, weight))


@dataclass(frozen=True, eq=False)
class _Phase:
    """Where a phase is best as the other parameters move it by so many of its turns that one turn
    about the mode would hold parts of a ridge only: that of A*cos(w*x + p) with all x far from 0.

    index : of the phase.
    weight : (n_par,) of the others in the distance along their common direction.
    along, best : (n,) distances, and the phase there beyond that at the mode.
    """

    index: int
    weight: FloatArray
    along: FloatArray
    best: FloatArray

    def at(self, moved: FloatArray) -> FloatArray:
        """(...,) for parameters (..., n_par) that are `moved` from the mode."""
        return np.interp(moved @ self.weight, self.along, self.best)


def _followed(
    posterior: Posterior, symmetry: Symmetry, mode: FloatArray, cov: FloatArray
) -> tuple[_Phase, ...]:
    """The phases without limits that the other parameters move by a part of a turn within a
    standard deviation.
    """
    phases = np.flatnonzero(np.isfinite(symmetry.period) & np.isinf(symmetry.high - symmetry.low))
    others = np.isinf(symmetry.period) & (np.diag(cov) > 0.0)
    unit = np.sqrt(np.diag(cov))[others]
    correlations = cov[np.ix_(others, others)] / np.outer(unit, unit)
    # (n_phase, n_other) how the best phases go with the others
    factors = (cov[np.ix_(phases, others)] / unit) @ np.linalg.pinv(correlations, hermitian=True)
    along = np.arange(-_N_APART, _N_APART + 1, dtype=np.float64) * _APART
    followed = []
    for k, i in enumerate(phases):
        spread = math.sqrt(max(0.0, float(factors[k] @ correlations @ factors[k])))
        if not spread > _PART * symmetry.period[i]:
            continue
        weight, step = np.zeros(mode.size), np.zeros(mode.size)
        weight[others] = factors[k] / unit / spread
        step[others] = correlations @ factors[k] * unit / spread
        step[phases] = factors @ (correlations @ factors[k]) / spread
        sides = [
            _path(posterior, symmetry, mode, sign * step, phases)[:, k] for sign in (-1.0, 1.0)
        ]
        best = np.concatenate([sides[0][:0:-1], sides[1]])
        followed.append(_Phase(int(i), weight, along, best))
    return tuple(followed)


def _path(
    posterior: Posterior, symmetry: Symmetry, mode: FloatArray, step: FloatArray, phases: IntArray
) -> FloatArray:
    """(1 + _N_APART, n_phase) the best phases beyond those at the mode, in places a part of `step`
    apart: of one turn about where those before it lead, by the density.
    """
    best = np.zeros((1 + _N_APART, phases.size))
    for k in range(1, _N_APART + 1):
        at = mode + k * _APART * step
        if k > 2:
            at[phases] = mode[phases] + 3.0 * (best[k - 1] - best[k - 2]) + best[k - 3]
        for i in np.tile(phases, min(2, phases.size)):  # each may turn the others
            turn = symmetry.period[i] * (np.arange(_N_TURN) / _N_TURN - 0.5)
            rows = np.tile(at, (_N_TURN, 1))
            rows[:, i] += turn
            with np.errstate(all="ignore"):
                heights = posterior.log_density(np.clip(rows, symmetry.low, symmetry.high))
            if np.all(np.isfinite(heights)):
                # the first harmonic of one turn has its top there
                wave = np.sum(heights * np.exp(-2j * np.pi * turn / symmetry.period[i]))
                at[i] -= symmetry.period[i] * float(np.angle(wave)) / (2.0 * math.pi)
        best[k] = at[phases] - mode[phases]
    return best


@dataclass(frozen=True, eq=False)
class Labelled:
    """A posterior folded onto the labels of its mode: the density of all labels together, where
    the centre is the closest one, and within a quarter of a step after which it repeats.

    mode : (n_par,) the centre of all parameters but phases that follow others.
    phases : these.
    """

    posterior: Posterior
    symmetry: Symmetry
    mode: FloatArray
    phases: tuple[_Phase, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return self.posterior.names

    def _centre(self, values: FloatArray) -> FloatArray:
        """(..., n_par) that belongs to values (..., n_par)."""
        centre = np.broadcast_to(self.mode, values.shape)
        if self.phases:
            centre, moved = centre.copy(), values - self.mode
            for phase in self.phases:
                centre[..., phase.index] += phase.at(moved)
        return centre

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log of the posterior density summed over all images; -inf where another image
        is closer to the centre.
        """
        log_p = np.array(self.posterior.log_density(draws))
        log_p[np.any(np.abs(draws - self.mode) > 0.25 * self.symmetry.repeat, axis=1)] = -np.inf
        inside = np.flatnonzero(np.isfinite(log_p))
        mapped = self.symmetry.mapped(draws[inside])
        centre = self._centre(mapped)
        images, number = self.symmetry.turned(mapped, centre)
        weight = self.symmetry.weight
        distances = np.where(number > 0.0, np.sum(weight * (images - centre) ** 2, axis=2), np.inf)
        # the first map is the identity; another turn of the same phases has hardly another distance
        phases = np.isfinite(self.symmetry.period)
        turned = np.abs(images[0] - draws[inside]) > 0.5 * self.symmetry.period
        nearest = distances[0] <= np.min(distances, axis=0) * (1.0 + 1e-9) + 1e-12
        log_p[inside] = np.where(
            nearest & ~np.any(turned[:, phases], axis=1),
            log_p[inside] + np.log(np.sum(number, axis=0)),
            -np.inf,
        )
        return log_p


def folded(
    posterior: Posterior, symmetry: Symmetry | None, mode: FloatArray, cov: FloatArray
) -> Posterior | Labelled:
    """What is to be sampled: the posterior itself, or folded where it has the same solution under
    several labels.  cov : (n_par, n_par) at the mode.
    """
    if symmetry is None or symmetry.trivial:
        return posterior
    return Labelled(posterior, symmetry, mode, _followed(posterior, symmetry, mode, cov))


def no_symmetry(problem: Problem) -> Symmetry:
    """Nothing but the identity."""
    n_par = problem.n_par
    return Symmetry(
        np.eye(n_par)[None, :, :],
        np.zeros((1, n_par)),
        np.full(n_par, np.inf),
        *problem.support(),
        np.ones(n_par),
        np.full(n_par, np.inf),
    )


def same_curves(
    symmetry: Symmetry, names: Sequence[str], values: FloatArray
) -> tuple[Finding, ...]:
    """What else, within the limits, draws the same curve as `values` (n_par,): exchanges first."""
    _, number = symmetry.images(values[None, :], values)
    exchanges: dict[tuple[str, ...], None] = {}
    changes: dict[tuple[Amount, ...], None] = {}
    for order, matrix, shift, n in zip(
        symmetry.order, symmetry.matrix, symmetry.shift, number[:, 0], strict=True
    ):
        if n == 0.0:
            continue
        pairs = [(i, int(j)) for i, j in enumerate(order) if i < j and order[j] == i]
        moved = [
            i
            for i in range(len(names))
            if order[i] == i and (shift[i] != 0.0 or np.any(matrix[i] != np.eye(len(names))[i]))
        ]
        if pairs and len(pairs) * 2 == np.sum(order != np.arange(order.size)) and not moved:
            exchanges.setdefault(tuple(names[k] for pair in pairs for k in pair))
        elif moved and not pairs:
            changes.setdefault(
                tuple(
                    Amount(_taking(names, matrix, i), float(shift[i]), whole=float(matrix[i, i]))
                    for i in moved
                )
            )
    findings = []
    if exchanges:
        findings.append(
            Finding(
                Kind.EXCHANGED,
                parts=tuple(Finding(Kind.EXCHANGE, names=pair) for pair in exchanges),
            )
        )
    turned = [
        (Amount(names[i], float(symmetry.period[i]), whole=1.0),)
        for i in np.flatnonzero(np.isfinite(symmetry.period)).tolist()
        if symmetry.period[i] <= symmetry.high[i] - symmetry.low[i] < math.inf
    ] + [
        (Amount(names[i], float(symmetry.repeat[i]), whole=1.0),)
        for i in np.flatnonzero(np.isfinite(symmetry.repeat)).tolist()
    ]
    images = [Finding(Kind.IMAGE, parameters=change) for change in (*_simplest(changes), *turned)]
    if images:
        findings.append(Finding(Kind.IMAGES, parts=tuple(images)))
    return tuple(findings)


def _taking(names: Sequence[str], matrix: FloatArray, i: int) -> str:
    """The name of parameter i, and of what it takes up: "c + A"."""
    others = [(names[j], float(matrix[i, j])) for j in np.flatnonzero(matrix[i]).tolist() if j != i]
    return names[i] + "".join(
        f" {'-' if k < 0.0 else '+'} {'' if abs(k) == 1.0 else f'{abs(k):g} '}{name}"
        for name, k in others
    )


def _simplest(changes: Iterable[tuple[Amount, ...]]) -> list[tuple[Amount, ...]]:
    """That of the fewest parameters, and of the shortest words."""
    return sorted(
        changes,
        key=lambda change: (len(change), len(describe(Finding(Kind.IMAGE, parameters=change)))),
    )[:1]
