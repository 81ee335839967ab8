"""Do the runs of a joint fit agree about what they share?

Pooling runs is only right if they do.  Around the joint mode every run is a quadratic in the shared
parameters s (its own ones are fitted for each s, with their priors), which is the same as a
measurement  t_r = G_r^T s + unit errors  of as many combinations of s as the run has information
about; stated values (priors) of shared parameters are one more such source.  With Q(F) the joint
least squares of all of them where the sources F have values of their own,

    Q() - Q(all)              chi^2, with as many degrees of freedom as unknowns are added
    D_r^2 = Q() - Q(r)        the same for one source, the squared Mahalanobis distance of run r
                              from all others together

Both are exact for a linear problem, and the first is then the joint minimum of chi^2 minus the sum
of the separate ones, with the priors counted once.  Values of their own are tested in those
directions of s that the runs together constrain; where only the stated values do (a tilt, masses),
they stay common, with the uncertainty that was stated.

A run with an unmodelled force enters with its information by itself
(`estim.checks.run_information`), the errors of the runs taken as independent: where a force
repeats, runs are closer to each other than that, and the test is cautious.  Which run disagrees:
the one whose D_r^2 is least probable, after Holm's correction for testing every source; if without
it the rest agrees, it is named.

Separate fits of other runs are not needed: alone, a run leaves directions to its priors and leans
on their edges, where a fit is no normal variable.  Directions in which a source has next to no
information are left out: there it is far from linear.

Sources: Rao, Linear Statistical Inference (1973) 4a.2 (tests of nested hypotheses) and 6e (scores);
Holm, Scand. J. Stat. 6 (1979) 65.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, IntArray, diagonal_scale, sds_of
from estim.checks.run_information import (
    PRIORS,
    LinearMeasurements,
    Quadratic,
    copies_of,
    copies_of_priors,
    measurements,
    total_of,
)
from estim.common import Amount, Finding, InputError, Kind, Label, NumericalError
from estim.fitting import ALONE, Fit, chi2_p
from estim.problem import Problem
from estim.words import describe

P_INCONSISTENT = 0.01  # after Holm's correction


@dataclass(frozen=True)
class Disagreement:
    """One source (a run, or the stated values) against all others.

    distance2 : D^2.  dof : its degrees of freedom; 0 where nothing can be compared (then p is 1).
    p_value : P(D^2 or more) for this source alone.  p_holm : corrected for the number of sources.
    """

    source: str
    distance2: float
    dof: int
    p_value: float
    p_holm: float


@dataclass(frozen=True, eq=False)
class SharedEstimate:
    """A shared parameter as some of the sources give it: mean and sd (n_shared,) each, in the order
    of `Consistency.shared`.

    sd is inf where these sources do not determine it.
    """

    mean: FloatArray
    sd: FloatArray


@dataclass(frozen=True, eq=False)
class Consistency:
    """Whether runs agree about the parameters they share.

    shared : names of the parameters of the curve that more than one run uses; labels : as they are
        shown.
    used : parameter -> the runs that use it.
    chi2, dof, p_value : Q.
    rows : one `Disagreement` a source, in the order of the runs, stated values last (if there are
        any).
    alone : run -> estimate from this run and the stated values; others : run -> from all but this
        run; joint : from all.
    largest_spread : the parameter about which the runs differ most, and by how much between them;
        None where no campaign lets it vary.
    suspects : sources without which the rest agrees, most suspicious first; more than one where the
        data cannot distinguish them.
    agree : whether nothing is wrong.
    """

    shared: tuple[str, ...]
    labels: tuple[Label, ...]
    used: Mapping[str, tuple[str, ...]]
    chi2: float
    dof: int
    p_value: float
    rows: tuple[Disagreement, ...]
    alone: Mapping[str, SharedEstimate]
    others: Mapping[str, SharedEstimate]
    joint: SharedEstimate
    largest_spread: Amount | None
    suspects: tuple[str, ...]
    agree: bool

    @property
    def finding(self) -> Finding:
        """The result as a finding."""
        kind = (
            Kind.RUNS_UNCOMPARED
            if self.dof == 0
            else Kind.RUNS_AGREE
            if self.agree
            else Kind.RUNS_DISAGREE
        )
        if self.dof and not self.agree and self.suspects:
            against_stated = self.suspects == (PRIORS,)
            kind = (
                Kind.RUNS_TIED
                if len(self.suspects) > 1
                else Kind.RUNS_AGAINST_STATED
                if against_stated
                else Kind.RUN_DISAGREES
            )
        run = self.suspects[0] if kind is Kind.RUN_DISAGREES else ""
        quantified = (
            kind in (Kind.RUNS_DISAGREE, Kind.RUN_DISAGREES, Kind.RUNS_TIED)
            and self.largest_spread is not None
        )
        largest_spread = (self.largest_spread,) if quantified and self.largest_spread else ()
        return Finding(
            kind,
            run=run,
            p=self.p_value,
            size=len(self.alone),
            names=self.suspects,
            parameters=largest_spread,
        )

    @property
    def verdict(self) -> str:
        """The same in one sentence."""
        return describe(self.finding)


def comparable(fit: Fit) -> bool:
    """Whether there is something to compare: several runs, a parameter of the curve in common, and
    a fit that determines all.
    """
    return len(fit.problem.runs) > 1 and _shared(fit.problem).size > 0 and not fit.singular


def _shared(problem: Problem) -> IntArray:
    """Indices of the parameters of the curve that more than one run uses."""
    users = Counter(name for run in problem.runs for name in run.parameters)
    return np.flatnonzero(
        [
            users[p.name] > 1 and p.name not in problem.noise_names and not p.between
            for p in problem.parameters
        ]
    )


def check_consistency(fit: Fit) -> Consistency:
    """Whether the runs of a joint fit agree about what they share.

    Noise parameters are held at the fit: where the size of the noise was inferred jointly,
    disagreement hides in it partly.

    Raises InputError where there is a single run or nothing is shared, NumericalError where the fit
    determines nothing.
    """
    problem = fit.problem
    shared = _shared(problem)
    if shared.size == 0:
        raise InputError(
            "must have a parameter of the curve in common to be compared",
            field="runs",
            value=", ".join(problem.run_names),
        )
    if fit.singular:
        raise NumericalError(
            "runs cannot be compared around a fit that leaves a combination of parameters "
            "undetermined"
        )
    names = problem.run_names
    copies = [
        *(copy for group in problem.groups for copy in copies_of(fit, group, shared)),
        copies_of_priors(fit, shared),
    ]
    rows = measurements(copies)
    tested = [name for name in (*names, PRIORS) if rows.moves[name].size]
    chi2, dof = rows.between((), tested)
    comparisons = _each_against_others(tested, rows)
    p_value = chi2_p(chi2, dof)
    agree = p_value >= P_INCONSISTENT and all(row.p_holm >= P_INCONSISTENT for row in comparisons)
    suspects = () if agree else _suspects(comparisons, rows)
    centre = fit.values[shared]
    prior = copies[-1].together
    copy_of = {name: copy for copy in copies for name in copy.sources}
    others = {
        copy: total_of([other.together for other in copies if other is not copy]) for copy in copies
    }
    alone = {
        name: _estimate(centre, total_of([copy_of[name].alone(name), prior])) for name in names
    }
    return Consistency(
        shared=tuple(problem.names[i] for i in shared),
        labels=tuple(problem.parameters[i].label for i in shared),
        used={
            problem.names[i]: tuple(
                run.name for run in problem.runs if problem.names[i] in run.parameters
            )
            for i in shared
        },
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        rows=comparisons,
        alone=alone,
        others={
            name: _estimate(centre, total_of([copy_of[name].without(name), others[copy_of[name]]]))
            for name in names
        },
        joint=SharedEstimate(centre, fit.scale[shared]),
        largest_spread=_largest_spread(fit, shared, list(alone.values())),
        suspects=suspects,
        agree=agree,
    )


def _largest_spread(fit: Fit, shared: IntArray, alone: Sequence[SharedEstimate]) -> Amount | None:
    """The shared parameter whose values by each run and what was stated differ most in their
    standard deviations, and their own deviation.
    """
    if any(run.motion is None for run in fit.problem.runs):
        return None
    means = np.array([estimate.mean for estimate in alone])
    weights = np.square([estimate.sd for estimate in alone]) ** -1.0  # 0: undetermined
    values = np.where(weights > 0.0, means, 0.0)
    total = np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    squares = weights * np.square(values - np.sum(weights * values, axis=0) / total)
    excess = np.sum(squares, axis=0) / np.maximum(np.sum(weights > 0.0, axis=0) - 1, 1)
    i = int(np.argmax(excess))
    parameter = fit.problem.parameters[shared[i]]
    spread = float(np.sqrt(np.sum(squares[:, i]) / total[i]))
    return Amount(parameter.name, spread, parameter.label) if spread > 0.0 else None


def _each_against_others(
    sources: Sequence[str], rows: LinearMeasurements
) -> tuple[Disagreement, ...]:
    """Each source against all others, with p values corrected for testing all of them."""
    distances = {source: rows.between((), (source,)) for source in sources}
    p_values = {source: chi2_p(*distance) for source, distance in distances.items()}
    compared = sorted(
        (source for source in sources if distances[source][1]), key=lambda source: p_values[source]
    )
    corrected, largest = dict.fromkeys(sources, 1.0), 0.0
    for n_left, source in zip(range(len(compared), 0, -1), compared, strict=True):
        corrected[source] = largest = max(largest, min(1.0, n_left * p_values[source]))
    return tuple(
        Disagreement(source, *distances[source], p_values[source], corrected[source])
        for source in sources
    )


def _suspects(comparisons: Sequence[Disagreement], rows: LinearMeasurements) -> tuple[str, ...]:
    """Sources without which the others agree, those least probable first; only those that explain
    it about as well as the best.
    """
    sources = tuple(row.source for row in comparisons)
    explaining = [
        row
        for row in sorted(comparisons, key=lambda row: row.p_value)
        if row.p_value < P_INCONSISTENT <= chi2_p(*rows.between((row.source,), sources))
    ]
    best = explaining[0].p_value if explaining else 0.0
    return tuple(row.source for row in explaining if row.p_value <= 100.0 * best)


def _estimate(centre: FloatArray, quadratic: Quadratic) -> SharedEstimate:
    """Where a quadratic has its minimum, and its standard deviations; inf where it has none."""
    information, score = quadratic
    scale = diagonal_scale(information)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    known = values > ALONE * max(float(values[-1]), 1.0)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    undetermined = np.sum(vectors[:, ~known] ** 2, axis=1) > 1e-6
    mean = centre + (inverse @ (score / scale)) / scale
    sd = sds_of(inverse) / scale
    return SharedEstimate(np.where(undetermined, np.nan, mean), np.where(undetermined, np.inf, sd))
