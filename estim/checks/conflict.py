"""Do the data agree with what was stated about the parameters before?

Around the mode the data are a measurement of the parameters, and so are the stated values
(informative priors).  With the free parameters fitted, lambda the information of the data along the
eigenvectors e of the stated ones, in units of the priors', and z the distance of the mode from the
stated values in their standard uncertainties, the two differ by

    T = sum (e . z)^2 (1 + 1/lambda)          chi^2 with as many degrees of freedom as terms

which is chi^2 at the joint minimum minus that of the data alone: exact for a linear curve and
normal priors, when the true values come from the priors.  Directions in which the data have less
than 1 % of the information of the prior are left out: there is nothing to compare.

The pull of one stated value is its distance from the estimate by the data and all other stated
values, in standard deviations of that distance,

    z_i / sqrt(1 - u_i^2/s_i^2),      u_i the standard uncertainty after and s_i before,

whose square is chi^2 at the joint minimum minus that without the one stated value.  Values of a
joint prior are left out one by one too: the others keep their marginal distribution.

A free parameter that meets the hard edge of its range gives way no further, so what it would have
taken up stays in chi^2.  Therefore each of these minima is sought within the edges: a bounded
linear least-squares problem around the mode (`scipy.optimize.lsq_linear`).  Edges only ever take
away from the comparison, and the number of terms is counted with parameters that sit on an edge
held there, so the probability is right away from edges and errs on the side of agreement beside
them.

(A log-normal prior has its mode below its median, so there the residual that balances the data at
the joint mode is not z; both are used.)

Sources: Evans and Moshonov, Bayesian Anal. 1 (2006) 893 (prior-data conflict); Rao, Linear
Statistical Inference (1973) 4a.2; Eadie et al., Statistical Methods in Experimental Physics (1971)
10.8 (pulls, there called stretch functions).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.checks.goodness_of_fit import check_goodness
from estim.checks.run_information import LEAST_OF_MIXTURE, fitted
from estim.common import Amount, Finding, Kind, NumericalError, Stream, stream
from estim.fitting import ALONE, Fit, Quadratic, around, chi2_p, fit_least_squares
from estim.problem import Prior, Problem

P_CONFLICT = 0.01
P_FLAGRANT = 1e-6  # then there is nothing to sample
_LOOSER, _N_START = 100.0, 6
NOTE_BELOW = 0.05
# information of the data, in units of the prior's, below which there is nothing to compare
_LEAST = 0.01
_TOO_FAR = 20.0  # pulls that an expansion around the mode cannot give
_FAR = 2.0  # pulls worth naming, and how many of them at most
_NAMED = 3


@dataclass(frozen=True, eq=False)
class Conflict:
    """The data against the stated values.

    chi2, dof, p_value : T; dof 0 where the data constrain nothing that was stated (then p is 1).
    pulls : parameter -> pull of its stated value, positive where all else gives more, largest
        first;
        parameters that the data narrow by less than 0.5 % are left out.
    explained : whether the curve explains the data where nothing is stated; then what was stated is
        wrong, else the curve.
    """

    chi2: float
    dof: int
    p_value: float
    pulls: dict[str, float]
    explained: bool = True

    @property
    def flagrant(self) -> bool:
        """Whether what was stated is so far off that draws of the compromise would mean nothing."""
        return self.p_value < P_FLAGRANT

    @property
    def agree(self) -> bool:
        return self.p_value >= P_CONFLICT


def check_stated_values(fit: Fit) -> Conflict:
    """Whether the data of `fit` agree with the priors of its parameters.  Noise parameters are held
    at the fit.
    """
    problem = fit.problem
    curve = np.array(problem.of_curve, dtype=np.int64)
    pull_rows = fit.prior_jacobian[np.ix_(curve, curve)]
    slopes = np.diag(pull_rows)
    stated = np.flatnonzero(slopes != 0.0)
    if not stated.size:
        return Conflict(0.0, 0, 1.0, {})
    on_edge = np.array([fit.names[i] in fit.at_bound for i in curve])
    free = np.flatnonzero((slopes == 0.0) & ~on_edge)
    model = around(fit)
    data = model.rows.T @ model.rows
    known = fitted(data, np.zeros(curve.size), stated, free)[0]
    pull_rows = pull_rows[stated]
    per_pull = np.linalg.inv(pull_rows[:, stated])
    values, vectors = np.linalg.eigh(per_pull.T @ known @ per_pull)
    least = LEAST_OF_MIXTURE if fit.forces or fit.deviations else _LEAST
    compared = values > least
    # of each stated value given the others: itself where they are independent
    each = pull_rows[:, stated] / np.linalg.norm(pull_rows[:, stated], axis=0)
    informed = (
        1.0 - np.sum((each.T @ vectors) ** 2 / (1.0 + np.maximum(values, 0.0)), axis=1) > least
    )  # 1 - u^2/s^2
    pulled = [p.prior.pull(value) for p, value in zip(problem.parameters, fit.values, strict=True)]
    offset = problem.decorrelated(np.array(pulled))[curve[stated]]
    joint = model.least(pull_rows, offset)[1]
    uncompared = vectors[:, ~compared].T
    chi2 = max(0.0, joint - model.least(uncompared @ pull_rows, uncompared @ offset)[1])
    dof = int(np.sum(compared))
    pull_values = _pulls_at_once(model, pull_rows, offset, each)
    pulls = {}
    for k in np.flatnonzero(informed):
        if math.isnan(pull_values[k]):
            others = np.eye(stated.size) - np.outer(each[:, k], each[:, k])
            step, without = model.least(others @ pull_rows, others @ offset)
            pull_values[k] = math.copysign(
                math.sqrt(max(0.0, joint - without)),
                float(each[:, k] @ (pull_rows @ step + offset)),
            )
        pulls[fit.names[curve[stated[k]]]] = float(pull_values[k])
    p_value = chi2_p(chi2, dof)
    unstated = None if p_value >= P_CONFLICT else _explained(fit)
    # the mode is far from everything
    if unstated is not None and max(map(abs, pulls.values()), default=0.0) > _TOO_FAR:
        pulls = {
            fit.names[curve[k]]: _distance(problem, unstated, curve[k])
            for k in np.flatnonzero(slopes != 0.0)
        }
    ordered = dict(sorted(pulls.items(), key=lambda item: -abs(item[1])))
    return Conflict(chi2, dof, p_value, ordered, p_value >= P_CONFLICT or unstated is not None)


def _pulls_at_once(
    model: Quadratic, pull_rows: FloatArray, offset: FloatArray, each: FloatArray
) -> FloatArray:
    """(n_stated,) the pulls of all stated values from one solution; nan where leaving one out would
    lead beyond an edge.  each : (n_stated, n_stated) which combination of the rows is one of them.

    Without row k the least squares are e^2/(1 - h) lower, e its residual and h its leverage (Cook
    and Weisberg, Residuals (1982) 2.2).
    """
    rows, scaled = (
        np.vstack([model.rows, pull_rows]) * model.scale,
        each.T @ pull_rows * model.scale,
    )
    aim = np.concatenate([model.aim, -offset])
    try:
        np.linalg.cholesky(rows.T @ rows)
        solved = np.linalg.solve(rows.T @ rows, np.column_stack([rows.T @ aim, scaled.T]))
    except np.linalg.LinAlgError:
        return np.full(offset.size, np.nan)
    step, responses = solved[:, 0], solved[:, 1:]
    residual, room = scaled @ step + each.T @ offset, 1.0 - np.sum(scaled * responses.T, axis=1)
    room = np.where(room > ALONE, room, np.nan)
    # with all of them, and without each
    ends = np.column_stack([step, step[:, None] + responses * (residual / room)])
    low, high = (edge[:, None] / model.scale[:, None] for edge in (model.low, model.high))
    inside = np.all((ends >= low) & (ends <= high), axis=0)
    return np.where(inside[0] & inside[1:], residual / np.sqrt(room), np.nan)


def _distance(problem: Problem, unstated: Fit, i: int) -> float:
    """Of one stated value from the estimate by the data and all other stated values, in standard
    deviations of that distance.
    """
    stated = problem.parameters[i]
    prior = stated.prior
    try:
        loose = problem.with_priors({stated.name: _loosened(prior)})
        others = fit_least_squares(loose, start=unstated.values)
    except NumericalError:
        return 0.0
    return float(
        (others.values[i] - prior.centre) / math.hypot(prior.sd, math.sqrt(others.cov[i, i]))
    )


def _explained(fit: Fit) -> Fit | None:
    """A fit of the curve that explains the data of `fit` where what was stated is a hundred times
    less certain; None where there is none.

    The tests are those of any fit: whether its residuals look like the noise.
    """
    problem = fit.problem
    curve = [p for p in problem.parameters if p.name not in problem.noise_names]
    loose = problem.with_priors({p.name: _loosened(p.prior) for p in curve})
    rng = stream(0, Stream.FIT)
    drawn = _N_START if all(math.isfinite(p.prior.sd) for p in loose.parameters) else 0
    draws = [loose.prior_draw(rng) for _ in range(drawn)]
    return next(
        (
            candidate
            for start in (fit.values, problem.start(), *draws)
            if (candidate := _fits(loose, start)) is not None
        ),
        None,
    )


def _fits(problem: Problem, start: FloatArray) -> Fit | None:
    """The fit from `start` (n_par,) if it passes the tests of residuals."""
    try:
        fit = fit_least_squares(problem, start=start)
        return (
            None
            if any(run.failed for run in check_goodness(fit, rng=stream(0, Stream.GOODNESS)))
            else fit
        )
    except NumericalError:
        return None


def _loosened(prior: Prior) -> Prior:
    return prior.widened(_LOOSER) if prior.measured else prior


def stated_values(fit: Fit, conflict: Conflict) -> Finding:
    """Whether the data agree with what was stated before, and if not, which stated values are
    farthest off.
    """
    if not conflict.dof:
        return Finding(Kind.STATED_UNCOMPARED)
    if conflict.p_value >= NOTE_BELOW:
        return Finding(Kind.STATED_AGREE, p=conflict.p_value)
    parameters = {p.name: p for p in fit.problem.parameters}
    far = [
        name
        for name, pull in conflict.pulls.items()
        if abs(pull) > _FAR and parameters[name].prior.measured
    ][:_NAMED]
    stated = {
        name: Amount(name, parameters[name].prior.centre, parameters[name].label) for name in far
    }
    parts = [
        Finding(Kind.PULL, size=conflict.pulls[name], parameters=(amount,))
        for name, amount in stated.items()
    ]
    kind = (
        Kind.STATED_HARDLY
        if conflict.agree
        else Kind.STATED_DISAGREE
        if conflict.explained
        else Kind.STATED_AND_CURVE
    )
    return Finding(kind, p=conflict.p_value, parts=tuple(parts))
