"""The posterior mode by least squares.  The only file that knows lmfit.

Priors enter as residuals, sigmas are absolute (`scale_covar=False`), the Jacobian is analytic, and
the search starts at one point.  The covariance of the noise depends weakly on the curve, so
the fit is repeated with it taken at the last result until nothing moves (iteratively reweighted
least squares); inferred noise parameters are updated in turn by maximising the same posterior.
More than 16 independent runs are fit run by run (`estim.fitting.arrowhead`), not by lmfit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress

import numpy as np

from estim.arrays import (
    FloatArray,
    all_finite,
    diagonal_scale,
    finite_or,
    inverse_of,
    max_abs,
    positive_or,
    sds_of,
)
from estim.common import Finding, InputError, NumericalError, phrase
from estim.discrepancy import FoundDeviation, FoundForce, NormalParts
from estim.distributions import chi2_tail
from estim.fitting.arrowhead import descend_by_runs, many
from estim.fitting.fisher_information import information, known_from_data
from estim.fitting.held_covariances import MAX_ROUNDS, SETTLED, Held, settle_by_runs
from estim.fitting.incidental_parameters import measure_of, spreads_and_effects
from estim.fitting.jeffreys import jeffreys_prior
from estim.fitting.noise_fit import fit_noise
from estim.fitting.profile_search import search_of
from estim.problem import Coordinates, JeffreysPrior, Measure, Posterior, Problem, Symmetry

_FEW_ROUNDS = 6
_LEAST_SHARE = 0.05  # of a step of rounds that swing
WITHIN_REACH = 12.0  # in minus log density: worse optima hold next to nothing of the posterior
# of -2 log density: chains of some seeds go beyond a rise of 27.5, none beyond 30.3; where that
# without a parameter is higher, its sign is known and it is sampled by size
NEVER_MET = 30.0
_ILL = 1e12  # condition of the information, columns of unit length


@dataclass(frozen=True, eq=False)
class Fit:
    """The posterior mode and the Gaussian approximation around it.

    names : (n_par,).
    values : (n_par,) the mode.
    cov : (n_par, n_par) inverse of the information (curvature) there, priors included.
    sds : (n_par,) square roots of its diagonal; nan for a parameter within one sd of a bound, where
        a symmetric standard deviation would be wrong.
    at_bound : names of parameters whose mode lies on a bound of their prior.
    posterior : the density with covariances at the mode.
    chi2 : whitened squares of the data (of normal scores, with errors of x) and of informative
        priors; of a log density -2 log L in place of the data's.
    dof : their number minus the fitted parameters of the curve that lie on no limit.
        p_value : P(chi2 or more); nan where the size of the noise was inferred or its tails are
            heavy (it proves nothing), or y was counted (simulations give it).
    others : (n_other, n_par) other optima not much worse than the best, far from it and from each
        other.
    symmetry : what else draws the same curves, None where it was not searched for.
    aliases : other curves through the same points.
    singular : whether some combination of parameters is not determined at all, not even by the
        priors.
    forces, deviations : what the curve of each run lacks, where that was inferred
        (`estim.discrepancy`).
    success, message : whether the search converged, in words.
    moved : standard deviations that its last round still moved a parameter.
    parts : of a joint fit with forces, the normal distributions that the linearised posterior is
        made of.
    mover : the parameter that a search which did not settle still moved most, where that is known.
    unheld : a parameter that the data hardly keep from infinity, where that was asked and there is
        one.
    held : of many runs, those whose covariance was not taken at the mode
        (`estim.fitting.held_covariances`).
    """

    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    sds: FloatArray
    at_bound: tuple[str, ...]
    posterior: Posterior
    chi2: float
    dof: int
    p_value: float
    others: FloatArray
    singular: bool
    success: bool
    moved: float
    message: str
    symmetry: Symmetry | None = None
    aliases: tuple[Finding, ...] = ()
    forces: tuple[FoundForce, ...] = ()
    deviations: tuple[FoundDeviation, ...] = ()
    parts: NormalParts | None = None
    held: tuple[Held, ...] = ()
    mover: str = ""
    unheld: Finding | None = None

    @property
    def problem(self) -> Problem:
        return self.posterior.problem

    @property
    def named(self) -> dict[str, FloatArray]:
        """Parameter -> its value at the mode."""
        return self.problem.named(self.values)

    @property
    def prior_jacobian(self) -> FloatArray:
        """(n_par, n_par) derivatives of the residuals of the priors at the mode."""
        return self.problem.prior_jacobian(self.values)

    @cached_property
    def sampled(self) -> Posterior:
        """`posterior` as it is sampled: in a joint fit with the measure of readings
        (`estim.fitting.incidental_parameters`), and with Jeffreys' prior of unstated parameters.
        Those of counts have flat ones, of the logarithm where they are known by their size.
        """
        if self.singular:
            return self.posterior
        jeffreys = jeffreys_prior(
            self.posterior, self.values, self.cov, coordinates=self.coordinates
        )
        flat = self.flat if jeffreys is None else None
        return replace(self.posterior, measure=self.measure, jeffreys=jeffreys, flat=flat)

    @cached_property
    def flat(self) -> Coordinates | None:
        """In which the prior of counts is flat: logarithms of unstated factors of the curve that
        are known by their size; None where there are none, and where runs have their own.
        """
        if self.measure is not None or not self.problem.counted:
            return None
        by_size = self.coordinates.by_size & self.problem.unstated
        by_size[by_size] = [self._is_factor(int(i)) for i in np.flatnonzero(by_size)]
        return Coordinates(self.values, by_size) if np.any(by_size) else None

    def _is_factor(self, i: int) -> bool:
        """Whether the curves are linear in parameter i."""
        points = np.tile(self.values, (3, 1))
        points[:, i] *= 0.0, 1.0, 2.0
        for run in self.problem.runs:
            with np.errstate(all="ignore"):
                none, once, twice = (run.drawn(self.problem.named(point)) for point in points)
            if not np.allclose(none + twice, 2.0 * once, rtol=1e-9, atol=1e-9 * max_abs(once)):
                return False
        return True

    @cached_property
    def coordinates(self) -> Coordinates:
        """In which the posterior is nearly normal."""
        level = math.inf if self.singular else NEVER_MET
        return search_of(self.posterior, self.values, self.cov, level).coordinates

    @cached_property
    def measure(self) -> Measure | None:
        """That of readings in a joint fit."""
        if self.singular:
            return None
        return measure_of(self.posterior, self.values, self.cov)

    @cached_property
    def measure_of_shared(self) -> Measure | None:
        """Both `measure` and `jeffreys`, to first order in what the runs share."""
        return measure_of(self.posterior, self.values, self.cov, jeffreys=self.jeffreys)

    @cached_property
    def jeffreys(self) -> JeffreysPrior | None:
        """That of unstated parameters, computed at every draw."""
        if self.singular:
            return None
        return jeffreys_prior(self.posterior, self.values, self.cov)

    @cached_property
    def spreads_and_effects(self) -> tuple[frozenset[str], frozenset[str]]:
        """Names of standard deviations between runs, and of the effects that they scale."""
        return spreads_and_effects(self.posterior, self.values)

    @cached_property
    def limited(self) -> tuple[str, ...]:
        """`at_bound` without spreads at their upper bound, where the mode lies whatever the data
        say: the larger a spread is, the less the effects cost that it scales.
        """
        low, high = self.problem.support()
        upper = high - self.values < self.values - low
        passed = self.spreads_and_effects[0] & set(compress(self.names, upper))
        return tuple(name for name in self.at_bound if name not in passed)

    @property
    def scale(self) -> FloatArray:
        """(n_par,) standard deviations by `cov`, of a parameter on an edge too."""
        return sds_of(self.cov)

    @property
    def lacking(self) -> tuple[FoundForce | FoundDeviation, ...]:
        """What was found that a curve lacks."""
        return *self.forces, *self.deviations


def fit_least_squares(problem: Problem, *, start: FloatArray | None = None) -> Fit:
    """The posterior mode of `problem` that a search from `start` (n_par,) leads to, by default from
    the centre of the priors.

    Raises InputError where the problem has no unknowns, NumericalError where the curve is not
    defined at the start, or has no finite derivatives where the search ends.

    >>> from estim import fit_least_squares, load_campaign
    >>> campaign = load_campaign("data/replica/campaign.toml", only="heavy-04")
    >>> problem = campaign.problem(["heavy-04"], usual=True)
    >>> fit = fit_least_squares(problem)
    >>> fit.values.shape == (len(problem.parameters),)
    True
    """
    if problem.n_par == 0:
        raise InputError(
            "contain no free parameter: every quantity is exact; give at least one an "
            "uncertainty or a prior",
            field="parameters",
        )
    start = problem.start() if start is None else start
    posterior = problem.linearised(start)
    if not all_finite(posterior.residuals(start)):
        raise NumericalError(
            "the fit cannot start: the curve is not defined at the starting values"
        )
    held: tuple[Held, ...] = ()
    if many(problem):
        values, posterior, moved, held = settle_by_runs(
            start, posterior, best=_best, spread=_curved
        )
    else:
        values, posterior, moved = _settle(start, posterior)
    if math.isnan(moved):
        raise _no_curvature(values, posterior)
    return replace(_describe(problem, posterior, values, moved), held=held)


def at_mode(problem: Problem, values: FloatArray) -> Fit:
    """The fit of a problem whose curve has its optimum at `values` (n_par,), with noise parameters
    fit to it.  Raises NumericalError where the curve has no finite derivatives there.
    """
    posterior = problem.linearised(values)
    if problem.noise_names:
        values = fit_noise(posterior, values)
        posterior = problem.linearised(values)
    return _describe(problem, posterior, values, 0.0)


def _no_curvature(values: FloatArray, posterior: Posterior) -> NumericalError:
    diagonal = np.diag(information(posterior, values))
    where = (
        " and ".join(
            name
            for name, entry in zip(posterior.problem.names, diagonal, strict=True)
            if not math.isfinite(entry)
        )
        or "its parameters"
    )
    return NumericalError(
        f"the fit ends where the curve has no finite derivatives in {where}: check "
        "units, stated values and limits"
    )


def _best(posterior: Posterior, values: FloatArray) -> FloatArray:
    """Values of the highest density from `values` (n_par,): of the curve, then of the noise; of
    many runs, a few steps towards it.
    """
    return fit_noise(posterior, _fit_curve(posterior, values))


def _curved(posterior: Posterior, values: FloatArray) -> FloatArray | None:
    """(n_par,) standard deviations at the values, inf for what the information does not determine;
    None where the curve has no finite derivatives.
    """
    matrix = information(posterior, values)
    if not all_finite(matrix):
        return None
    return positive_or(sds_of(inverse_of(matrix)), np.inf)


def _settle(values: FloatArray, posterior: Posterior) -> tuple[FloatArray, Posterior, float]:
    """Rounds of (curve; noise; covariance at the values) from a posterior linearised there until
    they settle: values, the posterior linearised there, and how far the last round moved, nan
    without curvature.

    Where a covariance that follows the curve sends the rounds to and fro, they go part of the way:
    to the same place.
    """
    moved, share, step = math.inf, 1.0, np.zeros_like(values)
    for n_round in range(MAX_ROUNDS):
        before, step_before, moved_before = values, step, moved
        step = _best(posterior, values) - before
        # half way, where there are no derivatives at the end: on a limit they may be missing
        for part in (share, 0.5 * share):
            values = before + part * step
            posterior = posterior.problem.linearised(values)
            scale = _curved(posterior, values)
            if scale is not None:
                break
        else:
            return values, posterior, math.nan
        moved = float(np.max(np.abs(step) / scale, initial=0.0))
        if (
            n_round >= _FEW_ROUNDS
            and moved > 0.5 * moved_before
            and (step / scale) @ (step_before / scale) < 0.0
        ):
            share *= 0.5
        # there, or beside a jump of the covariance: no place where it stays
        if moved < SETTLED or share < _LEAST_SHARE:
            break
    return values, posterior, moved


def _fit_curve(posterior: Posterior, values: FloatArray) -> FloatArray:
    """The parameters of the curve that minimise the squared residuals, noise parameters held."""
    problem = posterior.problem
    free = problem.of_curve
    if not free:
        return values
    if many(problem) or any(likelihood.creeps for likelihood in posterior.likelihoods):
        # of many runs, the next round takes them on, with a better covariance
        return descend_by_runs(posterior, values, free, most=5 if many(problem) else 200)
    from lmfit.minimizer import minimize
    from lmfit.parameter import Parameters

    table = Parameters()
    for i in free:
        prior = problem.parameters[i].prior
        table.add(
            f"p{i}",
            value=_inside(float(values[i]), prior.low, prior.high),
            min=prior.low,
            max=prior.high,
        )

    def filled(parameters: Parameters) -> FloatArray:
        full = values.copy()
        full[free] = [parameters[f"p{i}"].value for i in free]
        return full

    def residual(parameters: Parameters) -> FloatArray:
        return posterior.residuals(filled(parameters))

    def jacobian(parameters: Parameters) -> FloatArray:
        columns = posterior.jacobian(filled(parameters))[:, free]
        # a point beside the edge of where the curve is defined does not count in the step
        return finite_or(columns, 0.0)

    # lmfit inverts the Hessian too, singular where the data are silent; not used
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        result = minimize(
            residual,
            table,
            method="least_squares",
            scale_covar=False,
            calc_covar=False,
            jac=jacobian,
            x_scale="jac",
            # scipy steps back from where the curve is not defined
            ftol=1e-12,
            xtol=1e-12,
            gtol=1e-12,
            max_nfev=400,
            nan_policy="propagate",
        )
    return filled(result.params)


def _inside(value: float, low: float, high: float) -> float:
    """`value` moved strictly between the bounds: a search that starts on a bound may stay there."""
    span = high - low if math.isfinite(high - low) else max(abs(value), 1e-6)
    return min(max(value, low + 1e-6 * span), high - 1e-6 * span)


def converged_message(led: str) -> str:
    """The message of a fit that converged, with what led to it."""
    return phrase("converged; {led}", led=led)


def unconverged_message(sds: float) -> str:
    """The message of a fit whose last round still moved a parameter by some standard deviations."""
    return phrase(
        "did not converge: its last iteration still shifted a parameter by {sds:.2g} "
        "standard deviations",
        sds=sds,
    )


def distinct_from(values: FloatArray, ends: list[FloatArray], sds: FloatArray) -> FloatArray:
    """(n_other, n_par) those of `ends` that lie more than some standard deviations `sds` (n_par,)
    from `values` and from each other.
    """
    distinct, scale = [values], positive_or(sds, np.inf)
    for end in ends:
        if all(np.max(np.abs(end - other) / scale) > 3.0 for other in distinct):
            distinct.append(end)
    return np.array(distinct[1:]).reshape(-1, values.size)


def _describe(problem: Problem, posterior: Posterior, values: FloatArray, moved: float) -> Fit:
    """Raises NumericalError where the curve has no finite derivatives."""
    known = known_from_data(posterior, values)
    matrix = known.matrix + problem.prior_information(values)
    if not all_finite(matrix):
        raise _no_curvature(values, posterior)
    units = diagonal_scale(matrix)
    singular = bool(np.linalg.cond(matrix / np.outer(units, units)) > _ILL)
    cov = inverse_of(matrix)
    curvature = sds_of(cov)
    sds = np.full(problem.n_par, np.nan) if singular else curvature.copy()
    sds[problem.room(values) < curvature] = np.nan
    curve = problem.of_curve
    # what lies on a limit is held there, and so is the pull of its prior
    pulls = [i for i in curve if problem.parameters[i].prior.informative and not known.on_limit[i]]
    of_data = (
        -2.0 * posterior.log_likelihood(values[None, :])[0]
        if problem.own_density
        else np.sum(posterior.size_residuals(values) ** 2)
    )
    chi2 = float(of_data + np.sum(posterior.prior_residuals(values)[pulls] ** 2))
    dof = problem.n_obs + len(pulls) - int(np.sum(~known.on_limit[list(curve)]))
    unlike = problem.robust or problem.counted
    message = phrase("converged") if moved < SETTLED else unconverged_message(moved)
    if singular and moved < SETTLED:
        message = phrase(
            "converged, but some combination of the parameters is not determined, so there "
            "are no standard deviations"
        )
    return Fit(
        names=problem.names,
        values=values,
        cov=cov,
        sds=sds,
        at_bound=tuple(compress(problem.names, known.on_limit)),
        posterior=posterior,
        chi2=chi2,
        dof=dof,
        p_value=chi2_p(chi2, dof)
        if dof > 0 and all(run.stated for run in problem.runs) and not unlike
        else math.nan,
        others=np.zeros((0, values.size)),
        singular=singular,
        success=moved < SETTLED,
        moved=moved,
        message=message,
    )


def chi2_p(chi2: float, dof: int) -> float:
    """Probability of a value of chi^2 at least as large; 1 without degrees of freedom."""
    return float(chi2_tail(chi2, dof)) if dof > 0 else 1.0
