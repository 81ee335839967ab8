"""Do the runs of a joint fit agree about what they share?

Pooling runs is only right if they do.  Around the joint mode every run is a quadratic in the shared parameters s (its own ones
are fitted for each s, with their priors), which is the same as a measurement  t_r = G_r^T s + unit errors  of as many
combinations of s as the run says anything about; stated values (priors) of shared parameters are one more such source.  In the joint least
squares of all of them

    Q = sum |t - G^T s|^2 at its minimum                 chi^2 with  (rows - rank)  degrees of freedom

which is the joint minimum of chi^2 minus the sum of the separate ones, with the priors counted once, and for each source r

    D_r^2 = Q - Q without r                              chi^2 with  (rows of r - what only r determines)  degrees of freedom

which is the squared Mahalanobis distance of run r from all others together.  Both are exact for a linear problem.  Which run disagrees:
the one whose D_r^2 is least probable, after Holm's correction for asking every source; if without it the rest agrees, it is named.

Separate fits are not needed: alone, a run leaves directions to its priors and leans on their edges, where a fit is no normal variable.
Directions in which a source has less than 1 % of the information are left out: there it is all but silent, and far from linear.

Sources: Rao, Linear Statistical Inference (1973) 4a.2 (tests of nested hypotheses) and 6e (scores); Holm, Scand. J. Stat. 6 (1979) 65.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import Finding, InputError, Kind, Label, NumericalError
from estim.fitting import Fit, chi2_p
from estim.words import tell

P_INCONSISTENT = 0.01  # after Holm's correction
PRIORS = "stated values"
_LEAST_SHARE = 0.01
_ALONE = 1e-9  # relative: singular values below count as zero


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
    """A shared parameter as some of the sources give it: mean and sd (n_shared,) each, in the order of `Consistency.shared`.

    sd is inf where these sources do not determine it.
    """

    mean: FloatArray
    sd: FloatArray


@dataclass(frozen=True, eq=False)
class Consistency:
    """Whether runs agree about the parameters they share.

    shared : names of the parameters of the curve that more than one run uses; units, labels : theirs, the latter as they are shown.
    used : parameter -> the runs that use it.
    chi2, dof, p_value : Q.  rows : one `Disagreement` a source, in the order of the runs, stated values last (if there are any).
    alone : run -> estimate from this run and the stated values; others : run -> from all but this run; joint : from all.
    suspects : sources without which the rest agrees, most suspicious first; more than one where the data cannot tell them apart.
    agree : whether nothing is wrong.
    """

    shared: tuple[str, ...]
    units: tuple[str, ...]
    labels: tuple[Label, ...]
    used: Mapping[str, tuple[str, ...]]
    chi2: float
    dof: int
    p_value: float
    rows: tuple[Disagreement, ...]
    alone: Mapping[str, SharedEstimate]
    others: Mapping[str, SharedEstimate]
    joint: SharedEstimate
    suspects: tuple[str, ...]
    agree: bool

    @property
    def finding(self) -> Finding:
        """What to say of it."""
        kind = Kind.RUNS_UNCOMPARED if self.dof == 0 else Kind.RUNS_AGREE if self.agree else Kind.RUNS_DISAGREE
        if self.dof and not self.agree and self.suspects:
            against_stated = self.suspects == (PRIORS,)
            kind = Kind.RUNS_TIED if len(self.suspects) > 1 else Kind.RUNS_AGAINST_STATED if against_stated else Kind.RUN_DISAGREES
        run = self.suspects[0] if kind is Kind.RUN_DISAGREES else ""
        return Finding(kind, run=run, p=self.p_value, size=len(self.alone), names=self.suspects)

    @property
    def verdict(self) -> str:
        """The same in one sentence."""
        return tell(self.finding)


@dataclass(frozen=True, eq=False)
class _Source:
    """Measurements t (n_row,) = design (n_row, n_shared) . (s - fit) with unit errors; no rows where it is all but silent."""

    name: str
    design: FloatArray
    t: FloatArray


def comparable(fit: Fit) -> bool:
    """Whether there is something to compare: several runs, a parameter of the curve in common, and a fit that determines all."""
    users = [run.parameters for run in fit.problem.runs]
    shared = [name for name in fit.names if name not in fit.problem.noise_names and sum(name in used for used in users) > 1]
    return len(users) > 1 and bool(shared) and not fit.singular


def check_consistency(fit: Fit) -> Consistency:
    """Whether the runs of a joint fit agree about what they share.

    Noise parameters are held at the fit: where the size of the noise was inferred jointly, disagreement hides in it partly.

    Raises InputError where there is a single run or nothing is shared, NumericalError where the fit determines nothing.
    """
    problem = fit.problem
    noise = problem.noise_names
    users = [sum(name in run.parameters for run in problem.runs) for name in problem.names]
    shared = np.array([i for i, name in enumerate(problem.names) if users[i] > 1 and name not in noise], dtype=np.int64)
    if shared.size == 0:
        raise InputError("must have a parameter of the curve in common to be compared", field="runs", value=", ".join(r.name for r in problem.runs))
    if fit.singular:
        raise NumericalError("runs cannot be compared around a fit that leaves a combination of parameters undetermined")
    names = [run.name for run in problem.runs]
    full = [*_run_quadratics(fit, shared), _prior_quadratic(fit, shared)]
    sources = [_measurements(name, information, score, full) for name, (information, score) in zip([*names, PRIORS], full, strict=True)]
    judged = [source for source in sources if source.t.size]
    chi2, rank = _residual(judged)
    dof = sum(source.t.size for source in judged) - rank
    rows = _holm([_one_against_others(source, judged, chi2, rank) for source in judged])
    p_value = chi2_p(chi2, dof)
    suspects = _suspects(rows, judged) if min(p_value, *(row.p_holm for row in rows)) < P_INCONSISTENT else ()
    agree = p_value >= P_INCONSISTENT and all(row.p_holm >= P_INCONSISTENT for row in rows)
    centre = fit.values[shared]
    prior, total = full[-1], _sum(full)
    return Consistency(
        shared=tuple(problem.names[i] for i in shared), units=tuple(problem.parameters[i].unit for i in shared),
        labels=tuple(problem.parameters[i].label for i in shared),
        used={problem.names[i]: tuple(run.name for run in problem.runs if problem.names[i] in run.parameters) for i in shared},
        chi2=chi2, dof=dof, p_value=p_value,
        rows=rows, alone={name: _estimate(centre, _sum([one, prior])) for name, one in zip(names, full[:-1], strict=True)},
        others={name: _estimate(centre, (total[0] - one[0], total[1] - one[1])) for name, one in zip(names, full[:-1], strict=True)},
        joint=_estimate(centre, total), suspects=suspects, agree=agree,
    )


Quadratic = tuple[FloatArray, FloatArray]
"""Information (d, d) and score (d,) at the fit: minus log density = -score . u + u . information . u/2 with u = s - fit."""


def _run_quadratics(fit: Fit, shared: NDArray[np.int64]) -> list[Quadratic]:
    """Every run's quadratic in the shared parameters, its own parameters of the curve fitted with their priors."""
    problem, posterior = fit.problem, fit.posterior
    pulls, slopes = posterior.prior_residuals(fit.values), posterior.jacobian(fit.values)[problem.n_obs :]
    quadratics = []
    for run, (jacobian, residuals) in zip(problem.runs, posterior.scoring(fit.values), strict=True):
        used = run.parameters
        own = [i for i, name in enumerate(problem.names) if name in used and i not in shared and name not in problem.noise_names]
        rows, z = np.vstack([jacobian, slopes[own]]), np.append(residuals, pulls[own])
        data, mine = rows[:, shared], rows[:, own]
        if own:  # what is left orthogonal to the own parameters
            basis, singular, _ = np.linalg.svd(mine / _norms(mine), full_matrices=False)
            basis = basis[:, singular > _ALONE * singular[0]]
            data, z = data - basis @ (basis.T @ data), z - basis @ (basis.T @ z)
        quadratics.append((data.T @ data, -data.T @ z))
    return quadratics


def _norms(matrix: FloatArray) -> FloatArray:
    norms = np.sqrt(np.sum(matrix**2, axis=0))
    return np.where(norms > 0.0, norms, 1.0)


def _prior_quadratic(fit: Fit, shared: NDArray[np.int64]) -> Quadratic:
    """The priors of the shared parameters as residuals; a uniform one says nothing."""
    priors = [fit.problem.parameters[i].prior for i in shared]
    pull = np.array([prior.residual(float(v)) for prior, v in zip(priors, fit.values[shared], strict=True)])
    slope = np.array([prior.residual_slope(float(v)) for prior, v in zip(priors, fit.values[shared], strict=True)])
    return np.diag(slope**2), -pull * slope


def _sum(quadratics: Sequence[Quadratic]) -> Quadratic:
    return np.asarray(sum(q[0] for q in quadratics)), np.asarray(sum(q[1] for q in quadratics))


def _measurements(name: str, information: FloatArray, score: FloatArray, all_of_them: Sequence[Quadratic]) -> _Source:
    """A quadratic as measurements with unit errors, in coordinates where all sources together have unit information."""
    total = _sum(all_of_them)[0]
    scale = np.sqrt(np.diag(total))
    root = np.linalg.cholesky(total / np.outer(scale, scale) + _ALONE * np.eye(scale.size)) * scale[:, None]
    inner = np.linalg.solve(root, np.linalg.solve(root, information).T)
    shares, vectors = np.linalg.eigh(0.5 * (inner + inner.T))
    kept = shares > _LEAST_SHARE
    design = np.sqrt(shares[kept])[:, None] * vectors[:, kept].T
    return _Source(name, design, (vectors[:, kept].T @ np.linalg.solve(root, score)) / np.sqrt(shares[kept]))


def _residual(sources: Sequence[_Source]) -> tuple[float, int]:
    """Smallest sum of squares of all measurements together, and the rank of their design."""
    if not sources:
        return 0.0, 0
    design, t = np.vstack([s.design for s in sources]), np.concatenate([s.t for s in sources])
    basis, singular, _ = np.linalg.svd(design, full_matrices=False)
    basis = basis[:, singular > 1e-6]
    return float(np.sum((t - basis @ (basis.T @ t)) ** 2)), int(basis.shape[1])


def _one_against_others(source: _Source, judged: Sequence[_Source], chi2: float, rank: int) -> Disagreement:
    rest, rest_rank = _residual([other for other in judged if other is not source])
    dof = source.t.size - (rank - rest_rank)
    distance2 = max(chi2 - rest, 0.0) if dof else 0.0
    p_value = chi2_p(distance2, dof)
    return Disagreement(source.name, distance2, dof, p_value, p_value)


def _holm(rows: Sequence[Disagreement]) -> tuple[Disagreement, ...]:
    """The rows with p values corrected for asking all of them."""
    asked = [row for row in rows if row.dof > 0]
    order = sorted(range(len(rows)), key=lambda i: (rows[i].dof == 0, rows[i].p_value))
    corrected, largest = {}, 0.0
    for place, i in enumerate(order):
        if rows[i].dof > 0:
            largest = max(largest, min(1.0, (len(asked) - place) * rows[i].p_value))
        corrected[i] = largest if rows[i].dof > 0 else 1.0
    return tuple(Disagreement(r.source, r.distance2, r.dof, r.p_value, corrected[i]) for i, r in enumerate(rows))


def _suspects(rows: Sequence[Disagreement], judged: Sequence[_Source]) -> tuple[str, ...]:
    """Sources without which the others agree, those least probable first; only those that explain it about as well as the best."""
    healing = []
    for row in sorted(rows, key=lambda row: row.p_value):
        rest = [source for source in judged if source.name != row.source]
        chi2, rank = _residual(rest)
        if chi2_p(chi2, sum(source.t.size for source in rest) - rank) >= P_INCONSISTENT and row.p_value < P_INCONSISTENT:
            healing.append(row)
    best = healing[0].p_value if healing else 0.0
    return tuple(row.source for row in healing if row.p_value <= 100.0 * best)


def _estimate(centre: FloatArray, quadratic: Quadratic) -> SharedEstimate:
    """Where a quadratic has its minimum, and its standard deviations; inf where it has none."""
    information, score = quadratic
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    known = values > _ALONE * max(float(values[-1]), 1.0)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    undetermined = np.sum(vectors[:, ~known] ** 2, axis=1) > 1e-6
    mean = centre + (inverse @ (score / scale)) / scale
    sd = np.sqrt(np.diag(inverse)) / scale
    return SharedEstimate(np.where(undetermined, np.nan, mean), np.where(undetermined, np.inf, sd))
