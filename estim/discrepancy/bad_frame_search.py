"""Bad frames: which readings of a run are shifted, found by a scan beside the unmodelled force, and
held as further unknowns.

Patterns of the readings of a run, one for each frame k, their size unknown:

    "step"    every reading from frame k on is shifted (counts of an encoder lost or gained, a
              mark that was lost and found beside)
    "frame"   one reading is shifted (a slip of the hand, a wrong time stamp)
    "clock"   every time from frame k on is wrong, by a whole number of frames that were lost
              unnoticed or counted twice

With r, J and the components C_c of the force (`linearised`), w_c their probabilities, P_c the
precision left when the parameters are fit too:

    B_k = sum_c w_c (1 + S^2 q)^(-1/2) exp{g^2/[2 (q + S^-2)]},    q = h^T P_c h,    g = h^T P_c r

is the Bayes factor for a pattern h of size N(0, S^2); S is 10, 100 or 1000 standard deviations of a
reading, equally probable; for a known size (one, two or three frames lost, one counted twice) it is
exp(g s - q s^2/2).  A recording has a bad frame with probability 1/4 beforehand, shared evenly by
all patterns; the best pattern is taken where the odds are above 1, and the scan begins anew.  Where
nothing is wrong B_k is 1 on average, so the accused are at most a quarter (Markov's inequality);
measured: 1 of 150 clean recordings, 2 of 300 with other faults (ramp, correlated or uneven errors,
blur, jitter).

What was found stays in the posterior as one column of unknown size each: nothing is repaired, the
data determine how large it is.  Speeds by differences are evaluated where the readings were without
the shift (`moved`), since the curve bends too sharply near a turning point for a linear law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from estim.arrays import FloatArray, IntArray, root_mean_square, sds_of
from estim.discrepancy.linearised import Linearised, linearise_with_effects
from estim.discrepancy.mixture_likelihood import compact
from estim.discrepancy.scale_mixture import Deviation
from estim.problem import Points, Root, used_columns

PRIOR = 0.25  # probability that a recording has a bad frame
MOST = 6  # in one recording; beyond, it is not a matter of single frames
_SIZES = (10.0, 100.0, 1000.0)  # of a pattern, in sds of a reading
_LOST = (1.0, 2.0, 3.0, -1.0)  # frames, of a clock
_SHIFTED = ("step", "frame")  # kinds in which positions are wrong
_STILL = 2.5  # sds: a size below is none
_AT_ONCE = 2_000_000  # numbers of points and patterns
_WIDE = 30.0  # times what was found: sd of a size that is left to the data
_FEW_LOST = root_mean_square(_LOST)  # frames


@dataclass(frozen=True, eq=False)
class Pattern:
    """A bad frame that may be: row k of the readings, and its kind."""

    row: int
    kind: str
    # that sizes are counted in: what moves the readings by one standard deviation, or a frame
    unit: float
    in_frames: bool = False  # whether the size is a number of frames


@dataclass(frozen=True, eq=False)
class Shifts:
    """What a shift of a reading does to the points of a run.

    matrix : A (n_obs, n_row).
    velocity : (n_row,) of the fit, unit of a reading per s; zeros where time is not what was read.
    sd : of a typical reading.
    in_sequence : whether readings follow each other, so that a shift can stay.
    """

    matrix: csr_array
    velocity: FloatArray
    sd: float
    in_sequence: bool

    @property
    def interval(self) -> float:
        """s, between readings; nan where times are unknown."""
        return float("nan")

    def patterns(self) -> tuple[Pattern, ...]:
        """Those that do something to the points, each once: a step at the first or last frame is
        that frame alone.
        """
        used = used_columns(self.matrix)
        inside = used[2:-1] if self.in_sequence else used[:0]
        moving = np.flatnonzero(self.velocity)
        patterns = [Pattern(int(row), "frame", self.sd) for row in used]
        patterns += [Pattern(int(row), "step", self.sd) for row in inside]
        patterns += [
            Pattern(int(row), "clock", self.interval, in_frames=True)
            for row in inside
            if moving.size and row <= moving[-1]
        ]
        return tuple(patterns)

    def columns(self, patterns: Sequence[Pattern]) -> FloatArray:
        """(n_obs, n) what patterns of size 1 (m, rad or s) do to the points."""
        return self.matrix @ np.column_stack([self.shift(pattern) for pattern in patterns])

    def shift(self, pattern: Pattern | Jump) -> FloatArray:
        """(n_row,) what a pattern of size 1 does to the readings."""
        rows = np.arange(self.matrix.shape[1])
        shifted = rows == pattern.row if pattern.kind == "frame" else rows >= pattern.row
        return np.where(shifted, self.velocity if pattern.kind == "clock" else 1.0, 0.0)

    def projections(self, patterns: Sequence[Pattern], columns: FloatArray) -> FloatArray:
        """(n_pattern, n) h^T C for every pattern h of size 1 and the columns C (n_obs, n)."""
        each = self.matrix.T @ columns  # of a shift of one reading
        later, moved = (
            np.cumsum(rows[::-1], axis=0)[::-1] for rows in (each, self.velocity[:, None] * each)
        )
        kinds = {"frame": each, "step": later, "clock": moved}
        return np.array([kinds[pattern.kind][pattern.row] for pattern in patterns])

    def squares(self, root: Root, patterns: Sequence[Pattern]) -> FloatArray:
        """(n_pattern,) squares of the points of each pattern of size 1, whitened by `root`."""
        chunk = max(1, _AT_ONCE // root.n_obs)
        parts = []
        for start in range(0, len(patterns), chunk):
            whitened = root.whiten(self.columns(patterns[start : start + chunk]).T)
            parts.append(np.einsum("ki,ki->k", whitened, whitened))
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Frames(Shifts):
    """What was read of a run, row by row.

    t : (n_row,) s, nan where unknown.
    x : (n_row,) position or abscissa, for names.  lines : (n_row,) of the file, 0 where unknown.
    at : (n_obs,) row of the abscissa of each point, and slope (n_obs,) of the curve there; None
        where abscissas are not what is shifted.
    """

    t: FloatArray
    x: FloatArray
    lines: IntArray
    at: IntArray | None = None
    slope: FloatArray | None = None

    @property
    def interval(self) -> float:
        return float(np.median(np.diff(self.t)))


@dataclass(frozen=True, eq=False)
class Jump:
    """A bad frame that was found.

    kind : of `Pattern`.
    row : of the readings.  t, x, line : when, where, and on which line of the file; nan, 0 where
        unknown.
    size, sd : of the shift, unit of a reading, or s for "clock".
    before, after : t of the last point that no reading from it on moves, and of the first that none
        before it does.  interval : s, between readings.
    probability : that something is wrong there.
    share : how much of that belongs to this frame and kind.
    column : (n_obs,) what it does to the points at one standard deviation of its prior.
    """

    kind: str
    row: int
    t: float
    x: float
    line: int
    before: float
    after: float
    interval: float
    size: float
    sd: float
    probability: float
    share: float
    column: FloatArray


@dataclass(frozen=True, eq=False)
class BadFrames:
    """jumps : in the order of time.  crowd : whether there are more than `MOST`.

    shift_x, shift_y : (n_obs,) what they did to the points, as far as it is taken out before the
        curve is evaluated; None for nothing.
    """

    jumps: tuple[Jump, ...] = ()
    crowd: bool = False
    shift_x: FloatArray | None = None
    shift_y: FloatArray | None = None

    def moved(self, points: Points) -> Points:
        """The points without the shifts that were found; the columns give their
        uncertainty.
        """
        if self.shift_x is None or self.shift_y is None:
            return points
        return replace(points, x=points.x - self.shift_x, y=points.y - self.shift_y)

    def same(self, other: BadFrames) -> bool:
        """Whether they are the same frames."""
        return [(jump.kind, jump.row) for jump in self.jumps] == [
            (jump.kind, jump.row) for jump in other.jumps
        ]

    def columns(self, n_obs: int) -> FloatArray:
        """(n_obs, n_jump)."""
        return (
            np.column_stack([jump.column for jump in self.jumps])
            if self.jumps
            else np.zeros((n_obs, 0))
        )


NONE = BadFrames()


def find_bad_frames(
    deviation: Deviation,
    frames: Frames,
    residuals: FloatArray,
    jacobian: FloatArray,
    *,
    precision: FloatArray,
    pull: FloatArray,
    known: BadFrames = NONE,
) -> BadFrames:
    """The bad frames of a run, one after the other; the other arguments are those of `linearise`.

    known : found about another point of linearisation; those that now come out smaller than 2.5 of
        their sds are dropped.
    """
    patterns = frames.patterns()
    # 1 where the points are those without what was known
    known_removed = 0.0 if frames.at is None else 1.0
    before = {(jump.kind, jump.row): jump for jump in known.jumps}
    selected = [
        (pattern, _width(pattern, jump.size), jump.probability, jump.share)
        for pattern in patterns
        if (jump := before.get((pattern.kind, pattern.row))) is not None
    ]
    n_par = jacobian.shape[1]
    crowd, units = False, np.array([pattern.unit for pattern in patterns])
    square = frames.squares(deviation.root, patterns) * units**2
    while True:
        columns = (
            frames.columns([shape for shape, *_ in selected]) * [wide for _, wide, *_ in selected]
            if selected
            else np.zeros((residuals.size, 0))
        )
        linear = linearise_with_effects(
            deviation, residuals, jacobian, columns, precision=precision, pull=pull
        )
        logs, sizes = _scan(linear, frames, patterns, units, square)
        total = float(np.logaddexp.reduce(logs))
        if total <= 0.0:
            break
        if len(selected) >= MOST:
            crowd = True
            break
        best = int(np.argmax(logs))
        selected.append(
            (
                patterns[best],
                _width(patterns[best], float(sizes[best])),
                float(1.0 / (1.0 + np.exp(-min(total, 700.0)))),
                float(np.exp(logs[best] - total)),
            )
        )
    mean, sds = linear.mean[n_par:], sds_of(linear.covariance)[n_par:]
    jumps = []
    # readings on either side that a point is made of
    reach = int(np.max(np.diff(frames.matrix.indptr))) // 2
    for i, (pattern, wide, probability, share) in enumerate(selected):
        row, jump = pattern.row, before.get((pattern.kind, pattern.row))
        sd, size = float(sds[i]) * wide, float(mean[i]) * wide
        if jump is not None and jump.kind in _SHIFTED:
            size += known_removed * jump.size
        if abs(size) > _STILL * sd:
            jumps.append(
                Jump(
                    pattern.kind,
                    row,
                    float(frames.t[row]),
                    float(frames.x[row]),
                    int(frames.lines[row]),
                    float(frames.t[max(row - 1 - reach, 0)]),
                    float(frames.t[min(row + reach, frames.t.size - 1)]),
                    frames.interval,
                    size,
                    sd,
                    probability,
                    share,
                    frames.columns([pattern])[:, 0] * wide,
                )
            )
    jumps.sort(key=lambda jump: jump.row)
    return BadFrames(tuple(jumps), crowd, *_shifts(frames, jumps))


def _width(pattern: Pattern, size: float) -> float:
    """Standard deviation beforehand of the size of a pattern that was found to be about `size`.

    One that may have any size is left to the data.  A number of frames is not: the scan weighed a
    few of them, and with dozens beforehand a slip and the shift that makes up for it together bend
    the curve by what neither could at the size for which it was taken.
    """
    if pattern.in_frames:
        return max(abs(size), _FEW_LOST * pattern.unit)
    return _WIDE * max(abs(size), _SIZES[0] * pattern.unit)


def _shifts(frames: Frames, jumps: Sequence[Jump]) -> tuple[FloatArray | None, FloatArray | None]:
    """Of x and y of the points by the readings that are shifted."""
    if frames.at is None or frames.slope is None or not jumps:
        return None, None
    shift = np.zeros(frames.t.size)
    for jump in jumps:
        if jump.kind in _SHIFTED:
            shift += jump.size * frames.shift(jump)
    shift_x = shift[frames.at]
    return shift_x, frames.matrix @ shift + frames.slope * shift_x


def _scan(
    linear: Linearised,
    frames: Frames,
    patterns: Sequence[Pattern],
    units: FloatArray,
    square: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(n_pattern,) log of prior times Bayes factor of each pattern, and the size at which it is
    best under the most probable component.

    units : (n_pattern,) that sizes are counted in.
    square : (n_pattern,) of whitened patterns, in these.
    """
    deviation = linear.deviation
    r, j = deviation.whiten(linear.residuals), deviation.whiten(linear.jacobian.T).T
    families = [compact(family) for family in deviation.families]
    ends = np.cumsum([j.shape[1], 1, *(lean.spectrum.size for lean in families)])
    everything = np.column_stack([j, r, *(lean.basis for lean in families)])
    products = units[:, None] * frames.projections(patterns, deviation.turned_back(everything.T).T)
    with_j, with_r, *responses_by_family = np.split(products, ends[:-1], axis=1)
    with_r = with_r[:, 0]
    logs = np.full(len(patterns), -np.inf)
    sizes = np.zeros(len(patterns))
    most = np.full(len(patterns), -np.inf)
    in_frames = np.array([pattern.in_frames for pattern in patterns])
    components = deviation.each(np.arange(linear.weights.size))
    for lean, projection, (_, own) in zip(families, responses_by_family, components, strict=True):
        responses, turned, coordinates = projection.T, lean.basis.T @ j, lean.basis.T @ r
        white = 1.0 / np.square(lean.scale)
        for gain, flat, weight, step, cov in zip(
            1.0 / lean.variances() - white[:, None],
            white,
            linear.weights[own],
            linear.steps[own],
            linear.covariances[own],
            strict=True,
        ):
            if weight == 0.0:
                continue
            lever = flat * with_j + (responses.T * gain) @ turned
            score = flat * with_r + (responses.T * gain) @ coordinates - lever @ step
            size = (
                flat * square
                + gain @ np.square(responses)
                - np.einsum("ki,ij,kj->k", lever, cov, lever)
            )
            size = np.maximum(size, 1e-12 * flat * square + 1e-300)
            any_size = _mean(
                [-0.5 * np.log1p(s**2 * size) + 0.5 * score**2 / (size + s**-2.0) for s in _SIZES]
            )
            log_factor = np.log(weight) + np.where(
                in_frames, _mean([score * s - 0.5 * size * s**2 for s in _LOST]), any_size
            )
            better = log_factor > most
            sizes, most = np.where(better, score / size, sizes), np.where(better, log_factor, most)
            np.logaddexp(logs, log_factor, out=logs)
    return logs + np.log(PRIOR / len(patterns)), sizes * units


def _mean(logs: Sequence[FloatArray]) -> FloatArray:
    """Logarithm of the mean of what these are the logarithms of."""
    return np.logaddexp.reduce(np.array(logs), axis=0) - np.log(len(logs))
