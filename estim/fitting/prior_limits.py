"""Hard edges of priors: least squares around a fit that stay within them, and what to report of a
parameter that lies on one.

A posterior that is highest at an edge is a limit: [edge, limit] holds the true value with its
probability, as any interval does when truths come from the prior.  Only where the data press
*beyond* the edge is something wrong: then chi^2 would fall by more than chance allows if the
parameter could pass.  That fall is computed from the curvature at the fit (Rao's score statistic,
Linear Statistical Inference (1973) 6e.2), so nothing is evaluated beyond an edge, where the curve
may have no meaning:

    sqrt(fall)      standard normal, one-sided; Student's t with the noise inferred
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
import numpy as np

from estim.arrays import FloatArray, positive_or
from estim.common import Amount, Finding, Kind
from estim.distributions import normal_tail, student_tail
from estim.fitting.gauss_newton import step_between
from estim.fitting.least_squares import Fit
from estim.problem import Prior
from estim.words import one_sided

# probability of so much pressure by chance, below which edge and data contradict each other
PRESSED_BELOW = 0.01
ALONE = 1e-9  # relative: eigenvalues below count as zero


class Limit(msgspec.Struct, frozen=True):
    """What is known of a quantity whose most probable value is an edge: below (above) `limit_95`
    with 95 % probability, SI units and radians.
    """

    side: Literal["upper", "lower"]
    edge: float
    limit_68: float
    limit_95: float


@dataclass(frozen=True, eq=False)
class Quadratic:
    """chi^2 of the data around a fit, |rows . step - aim|^2 up to a constant, and how far a step
    may go to each side.

    rows : (n, n_curve).
    aim : (n,).  low, high : (n_curve,), in the parameters' units.  scale : (n_curve,) typical
        steps.
    """

    rows: FloatArray
    aim: FloatArray
    low: FloatArray
    high: FloatArray
    scale: FloatArray

    def least(self, pull_rows: FloatArray, residuals: FloatArray) -> tuple[FloatArray, float]:
        """The step (n_curve,) within the edges to the least sum of the data's chi^2 and |pull_rows
        . step + residuals|^2, and that sum.
        """
        rows, aim = np.vstack([self.rows, pull_rows]) * self.scale, np.append(self.aim, -residuals)
        step = step_between(rows, -aim, self.low / self.scale, self.high / self.scale, silent=ALONE)
        return step * self.scale, float(np.sum((rows @ step - aim) ** 2))


def around(fit: Fit) -> Quadratic:
    """The data's chi^2 in the parameters of the curve, the noise held at the fit.

    Where what the curve lacks is summed over, that of the linearised posterior as a whole: the
    curvature at the mode is that of the most probable sizes, and smaller ones than they allow for a
    good part of the probability.
    """
    problem, curve = fit.problem, fit.problem.of_curve
    scale = positive_or(fit.scale[curve], 1.0)
    marginal = fit.forces or fit.deviations
    if marginal:
        information_matrix, score = marginal[0].information
        slope = information_matrix[:, curve] @ (fit.values - marginal[0].about)[curve] - score
    else:
        information_matrix = fit.posterior.information(fit.values)
        jacobian, residuals = fit.posterior.scoring(fit.values)
        slope = jacobian.T @ residuals - problem.prior_gradient(fit.values)
    information = information_matrix[np.ix_(curve, curve)] * np.outer(scale, scale)
    gradient = slope[curve] * scale
    spectrum, basis = np.linalg.eigh(information)
    singular, right = np.sqrt(np.maximum(spectrum, 0.0)), basis.T
    informed = singular > math.sqrt(ALONE) * singular[-1]
    aim = -(right @ gradient)[informed] / singular[informed]
    edges = [(problem.parameters[i].prior, float(fit.values[i])) for i in curve]
    low = np.array([min(prior.low - value, 0.0) for prior, value in edges])
    high = np.array([max(prior.high - value, 0.0) for prior, value in edges])
    return Quadratic((singular[:, None] * right)[informed] / scale, aim, low, high, scale)


def edge_of(prior: Prior, value: float) -> float:
    """The edge of the prior that is closer to `value`; infinite where there is none."""
    return prior.low if value - prior.low <= prior.high - value else prior.high


def pressed(fit: Fit, *, estimated: bool = False) -> Mapping[str, float]:
    """Parameters of the curve on an edge -> probability that chance presses them against it as much
    as these data (and priors) do.

    estimated : whether the size of the noise, held here, was taken from the residuals.
    """
    problem, curve = fit.problem, fit.problem.of_curve
    on_edge = [k for k, i in enumerate(curve) if fit.names[i] in fit.limited]
    if not on_edge or fit.singular:
        return {}
    model = around(fit)
    pull_rows = fit.prior_jacobian[np.ix_(curve, curve)]
    residuals = fit.posterior.prior_residuals(fit.values)[curve]
    at_edge = model.least(pull_rows, residuals)[1]
    inferred = estimated or bool(problem.noise_names)
    dof = max(1, problem.n_obs - len(curve))
    squares = float(np.sum(fit.posterior.size_residuals(fit.values) ** 2))
    probabilities = {}
    for k in on_edge:
        parameter, value = problem.parameters[curve[k]], float(fit.values[curve[k]])
        passed = replace(model, low=model.low.copy(), high=model.high.copy())
        if edge_of(parameter.prior, value) == parameter.prior.low:
            passed.low[k] = -math.inf
        else:
            passed.high[k] = math.inf
        fall = max(0.0, at_edge - passed.least(pull_rows, residuals)[1])
        if inferred:  # the size of the noise was taken from residuals that the edge has made larger
            # no squares, nothing to fall
            fall *= dof / max(squares - fall, 1e-9 * squares) if fall > 0.0 else 0.0
            probabilities[parameter.name] = float(student_tail(math.sqrt(fall), dof))
        else:
            probabilities[parameter.name] = float(normal_tail(math.sqrt(fall)))
    return probabilities


def pressed_edges(fit: Fit, kind: Kind, *, estimated: bool = False) -> list[Finding]:
    """Edges that the data contradict, as findings of a `kind`.  A parameter that merely lies on one
    is a limit, which is a result.  estimated : as of `pressed`.
    """
    return [
        Finding(kind, p=p_value, parameters=(_edge_of_parameter(fit, name),))
        for name, p_value in pressed(fit, estimated=estimated).items()
        if p_value < PRESSED_BELOW
    ]


def limit_of(fit: Fit, name: str, draws: FloatArray) -> Limit | None:
    """One-sided limits of a parameter that lies on an edge, from its draws (n_draw,); None for one
    that does not.
    """
    if name not in fit.limited:
        return None
    i = fit.names.index(name)
    prior = fit.problem.parameters[i].prior
    edge = edge_of(prior, float(fit.values[i]))
    upper = edge == prior.low
    ends = np.quantile(draws, [0.68, 0.95] if upper else [0.32, 0.05])
    return Limit("upper" if upper else "lower", float(edge), float(ends[0]), float(ends[1]))


def limit_cell(limit: Limit, factor: float, unit: str = "1") -> str:
    """'< 0.31 (95 %)', in units of which one SI unit has `factor`."""
    return one_sided(
        limit.side,
        limit.limit_95,
        limit.edge,
        factor=factor,
        unit=unit if unit == "°" else "" if unit == "1" else f" {unit}",
    )


def limit_found(fit: Fit, name: str, draws: FloatArray) -> Finding:
    """The limit of a parameter at an edge (`fit.limited`) as a note: its most probable value is
    the edge.
    """
    limit = limit_of(fit, name, draws)
    assert limit is not None
    return Finding(
        Kind.LIMIT,
        test=limit.side,
        size=limit.limit_95,
        parameters=(_edge_of_parameter(fit, name),),
    )


def _edge_of_parameter(fit: Fit, name: str) -> Amount:
    """The edge of a parameter's range next to its value."""
    i = fit.names.index(name)
    parameter = fit.problem.parameters[i]
    return Amount(name, edge_of(parameter.prior, float(fit.values[i])), parameter.label)
