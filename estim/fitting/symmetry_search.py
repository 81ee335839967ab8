"""The search for symmetries of a curve (`estim.problem.symmetry`), by the curve itself at random
parameters and between the points.

Maps are looked for in the arguments of the curve and hold for the parameters of all runs; priors
must agree with them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice, product

import numpy as np

from estim.arrays import FloatArray, finite_or
from estim.problem import TURNS, Flat, Problem, Symmetry, no_symmetry, own_values

# looked at; where a curve takes one set of parameters at a time
_MOST_MAPS, _MOST_CALLS = 4000, 300
# of the size of the curve: no difference, and what one parameter alone must change
_SAME, _MOVED = 1e-9, 1e-6


def find_symmetry(
    problem: Problem, values: FloatArray, bent: Sequence[int], rng: np.random.Generator
) -> Symmetry:
    """The symmetries of the curves of a problem around `values` (n_par,); `bent` are the parameters
    whose distance chooses a label.
    """
    n_par = values.size
    checker = _Found(problem)
    trials = [_trial(problem, values, rng) for _ in range(3)]
    # of a narrow peak far from 0 the others may show nothing, wherever it is moved
    trials.append((values, [run.x for run in problem.runs]))
    period = np.full(n_par, np.inf)
    sources = _free_arguments(problem)
    turned: list[Map] = [{a: ({a: 1.0}, turn)} for a in sources for turn in TURNS]
    for _, shift in checker.survivors(turned, trials):
        period = np.fmin(period, np.where(shift != 0.0, shift, np.inf))
    most = (
        _MOST_MAPS
        if all(getattr(run.curve, "broadcasts", True) for run in problem.runs)
        else _MOST_CALLS
    )
    maps = list(islice(_maps(list(sources), _turned(problem, sources, period)), most))
    same = (np.eye(n_par), np.zeros(n_par))
    matrices, shifts = zip(*_closed([same, *checker.survivors(maps, trials)], period), strict=True)
    symmetry = replace(
        no_symmetry(problem), matrix=np.array(matrices), shift=np.array(shifts), period=period
    )
    return symmetry.scaled(np.ones(n_par), bent)


# argument -> (arguments that its value is made of, with factors; shift)
Map = dict[str, tuple[dict[str, float], float]]
# the same of parameters: matrix (n_par, n_par), shift (n_par,)
Lifted = tuple[FloatArray, FloatArray]


def _free_arguments(problem: Problem) -> dict[str, None]:
    """Arguments of the curves that are parameters in every run that has them, each parameter being
    one argument only.
    """
    free = {a: None for run in problem.runs for a in run.arguments}
    arguments_of: dict[object, set[str]] = {}
    for run in problem.runs:
        for argument, source in run.arguments.items():
            if not isinstance(source, str):
                free.pop(argument, None)
            arguments_of.setdefault(source, set()).add(argument)
    known = [
        arguments_of[run.arguments[a]] for run in problem.runs for a in free if a in run.arguments
    ]
    return free if all(len(used) == 1 for used in known) else {}


def _trial(
    problem: Problem, values: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, list[FloatArray]]:
    """Random parameter values around `values`, and random places within the x of each run."""
    size = np.where(values != 0.0, values, rng.standard_normal(values.size))
    at = size * np.exp(0.2 * rng.standard_normal(values.size))
    return at, [rng.uniform(run.x.min(), run.x.max(), 16) for run in problem.runs]


def _turned(problem: Problem, sources: dict[str, None], period: FloatArray) -> dict[str, float]:
    """Arguments that are a phase, with their full turn."""
    index = {name: i for i, name in enumerate(problem.names)}
    called = {a: source for run in problem.runs for a, source in run.arguments.items()}
    turned = {a: float(period[index[str(called[a])]]) for a in sources}
    return {a: turn for a, turn in turned.items() if math.isfinite(turn)}


def _maps(arguments: Sequence[str], turned: dict[str, float]) -> Iterator[Map]:
    """One to three changes of sign, with phases turned by a half or not; exchanges of one to three
    pairs, with either sign.

    Last, changes of sign in which a further argument takes up once or twice one of those that
    change theirs.
    """
    flips: list[Map] = []
    for n in (1, 2, 3):
        for flipped in combinations(arguments, n):
            for halves in product((0.0, 0.5), repeat=len(turned)):
                map_: Map = {a: ({a: -1.0}, 0.0) for a in flipped}
                for half, (a, turn) in zip(halves, turned.items(), strict=True):
                    if half:
                        map_[a] = (map_.get(a, ({a: 1.0}, 0.0))[0], half * turn)
                flips.append(map_)
    yield from flips
    pairs = list(combinations(arguments, 2))
    for n in (1, 2, 3):
        for chosen in combinations(pairs, n):
            if len({a for pair in chosen for a in pair}) < 2 * n:
                continue
            for signs in product((1.0, -1.0), repeat=n):
                if n == 3 and signs.count(-1.0) > 1:
                    continue
                yield {
                    a: ({b: sign}, 0.0)
                    for (i, j), sign in zip(chosen, signs, strict=True)
                    for a, b in ((i, j), (j, i))
                }
    for map_ in flips:
        for a, (combined, shift) in map_.items():
            for b in arguments if combined[a] < 0.0 and shift == 0.0 else ():
                if b not in map_:
                    yield from ({**map_, b: ({b: 1.0, a: times}, 0.0)} for times in (1.0, 2.0))


@dataclass(frozen=True, eq=False)
class _Found:
    """Tests of maps on the curves of `problem`."""

    problem: Problem

    def survivors(
        self, maps: list[Map], trials: list[tuple[FloatArray, list[FloatArray]]]
    ) -> list[Lifted]:
        """Those maps that hold at all trials, as maps of parameters; the first trial looks at all
        of them in one call.
        """
        if not maps:
            return []
        first = self._agree(maps, trials[0])
        return [
            lifted
            for map_, same in zip(maps, first, strict=True)
            if same and self.holds(map_, trials) and (lifted := self.lifted(map_)) is not None
        ]

    def holds(self, map_: Map, trials: list[tuple[FloatArray, list[FloatArray]]]) -> bool:
        """Whether the curves are the same under a map, and not the same with one of the moved
        parameters moved part of the way.
        """
        if not all(self._agree([map_], trial)[0] for trial in trials):
            return False
        parts = [{a: moved} for a, moved in map_.items()]
        changed = [
            [not same for same in self._agree(parts, trial, share=0.37, limit=_MOVED)]
            for trial in trials
        ]
        return bool(np.all(np.any(changed, axis=0)))

    def _agree(
        self,
        maps: list[Map],
        trial: tuple[FloatArray, list[FloatArray]],
        *,
        share: float = 1.0,
        limit: float = _SAME,
    ) -> list[bool]:
        values, abscissas = trial
        named = dict(zip(self.problem.names, values.tolist(), strict=True))
        same = np.ones(len(maps), dtype=bool)
        for run, x in zip(self.problem.runs, abscissas, strict=True):
            arguments = {
                a: named[source] if isinstance(source, str) else float(source)
                for a, source in run.arguments.items()
            }
            rows = {a: np.full((len(maps) + 1, 1), value) for a, value in arguments.items()}
            for row, map_ in enumerate(maps, start=1):
                for a, (combined, shift) in _within(map_, arguments):
                    # nan: made of what another curve takes
                    image = sum(k * arguments.get(b, math.nan) for b, k in combined.items()) + shift
                    rows[a][row, 0] = (1.0 - share) * arguments[a] + share * image
            with np.errstate(all="ignore"):
                curves = np.broadcast_to(
                    run.curve.value(x, own_values(rows)), (len(maps) + 1, x.size)
                )
                size = np.max(np.abs(curves[0]))
                same &= (
                    np.max(np.abs(curves[1:] - curves[0]), axis=1) <= limit * size
                    if math.isfinite(size)
                    else False
                )
        return same.tolist()

    def lifted(self, map_: Map) -> Lifted | None:
        """A map of arguments as one of parameters; None where the runs or the priors do not allow
        it.
        """
        names = self.problem.names
        matrix, shift = np.eye(len(names)), np.zeros(len(names))
        set_to: dict[int, tuple[dict[int, float], float]] = {}
        for run in self.problem.runs:
            for a, (combined, c) in _within(map_, run.arguments):
                coefficients = {names.index(str(run.arguments[b])): k for b, k in combined.items()}
                if set_to.setdefault(names.index(str(run.arguments[a])), (coefficients, c)) != (
                    coefficients,
                    c,
                ):
                    return None
        for i, (coefficients, c) in set_to.items():
            matrix[i], shift[i] = 0.0, c
            for j, k in coefficients.items():
                matrix[i, j] = k
        if abs(abs(np.linalg.det(matrix)) - 1.0) > 1e-9:
            return None
        return (
            (matrix, shift)
            if all(self._same_prior(i, coefficients, c) for i, (coefficients, c) in set_to.items())
            else None
        )

    def _same_prior(self, i: int, coefficients: dict[int, float], shift: float) -> bool:
        """Whether the prior of parameter i is that of j under the map; ranges stated as a prior
        hold several solutions where signs change.
        """
        if len(coefficients) > 1:
            return isinstance(self.problem.parameters[i].prior, Flat)
        ((j, sign),) = coefficients.items()
        mine, other = self.problem.parameters[i].prior, self.problem.parameters[j].prior
        if not mine.informative and not other.informative:
            return (sign > 0.0 and shift == 0.0) or (
                isinstance(mine, Flat) and isinstance(other, Flat)
            )
        centre, sd = other.centre, other.sd
        at = centre + sd * np.array([-0.8, -0.1, 0.3, 1.2])
        a, b = mine.log_density(sign * at + shift), other.log_density(at)
        return bool(
            np.all(np.isfinite(a) == np.isfinite(b))
            and np.allclose(a[np.isfinite(a)], b[np.isfinite(b)], rtol=0.0, atol=1e-9)
        )


def _within(
    map_: Map, arguments: Collection[str]
) -> Iterator[tuple[str, tuple[dict[str, float], float]]]:
    """What a map does to the arguments of one curve."""
    return ((a, image) for a, image in map_.items() if a in arguments)


def _closed(elements: list[Lifted], period: FloatArray) -> list[Lifted]:
    """The maps with all their compositions, full turns taken off."""

    def reduced(element: Lifted) -> Lifted:
        matrix, shift = element
        turned, turn = np.isfinite(period), finite_or(period, 1.0)
        shift = np.where(turned, np.mod(shift, turn), shift)
        return matrix, np.where(turned & (np.abs(shift - turn) < 1e-9 * turn), 0.0, shift)

    def key(element: Lifted) -> tuple[object, ...]:
        return tuple(element[0].ravel().tolist()), tuple(np.round(element[1], 6).tolist())

    group: dict[tuple[object, ...], Lifted] = {}
    waiting = [reduced(element) for element in elements]
    while waiting and len(group) < 48:
        element = waiting.pop(0)
        if key(element) in group:
            continue
        group[key(element)] = element
        for other in list(group.values()):
            # first `element`, then `other`
            waiting.append(reduced((other[0] @ element[0], other[0] @ element[1] + other[1])))
    return list(group.values())
