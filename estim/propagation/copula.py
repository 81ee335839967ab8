"""Draws of correlated inputs of any distribution: the normal copula that has the stated
correlations, and the multivariate t of readings.

Cario and Nelson 1997, "Modeling and generating random vectors with arbitrary marginal distributions
and correlation matrix".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.distributions import normal_log_density
from estim.propagation.inputs import PSD_TOLERANCE, Input
from estim.propagation.scores import POSITIVE, score

# step and half width of the sums over a normal variate, as wide as moments of a t distribution
# need, and terms of a series
_STEP, _FAREST, _N_TERM = 0.005, 28.0, 80


def copula_matrix(inputs: Sequence[Input], correlation: FloatArray) -> FloatArray:
    """Correlation matrix of the normal variates whose transforms to the inputs' distributions have
    `correlation`, (n_in, n_in).

    With g = sum_k a_k h_k(z) the standardised quantile transform (h_k the orthonormal Hermite
    polynomials) the correlation of two inputs is sum_k a_k b_k rho^k; it is solved for rho pair by
    pair.  Two normal quantities: rho = r; two rectangular ones: rho = 2 sin(pi r/6).

    Raises InputError where the marginal distributions cannot have the requested correlation, or not
    all of them together.
    """
    matrix = np.array(correlation)
    for i, j in combinations(range(len(inputs)), 2):
        first, second = inputs[i], inputs[j]
        if (
            matrix[i, j] != 0.0
            and not (first.group and first.group == second.group)
            and not (first.distribution == second.distribution == "normal")
        ):
            matrix[i, j] = matrix[j, i] = _copula_coefficient(first, second, float(matrix[i, j]))
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -PSD_TOLERANCE:
        rule = "cannot be reached by a normal copula of these distributions (negative eigenvalue)"
        raise InputError(rule, field="correlation", value=smallest)
    return matrix


def draw_inputs(
    inputs: Sequence[Input], copula: FloatArray, *, rng: np.random.Generator, n_draw: int
) -> dict[str, FloatArray]:
    """Draws of each input, name -> (n_draw,), in the input's unit.

    Inputs of one group share the chi-square variate of their t distribution (JCGM 102, 5.3.2).
    The normal variates are taken in the order of the names, so the order in which inputs are listed
    changes no draw.
    """
    order = sorted(range(len(inputs)), key=lambda i: inputs[i].name)
    normal = rng.standard_normal((len(inputs), n_draw))
    ordered = copula[np.ix_(order, order)]
    if np.count_nonzero(ordered) > len(inputs):  # beside the diagonal
        variance, axes = np.linalg.eigh(ordered)
        normal = (axes * np.sqrt(np.maximum(variance, 0.0))) @ axes.T @ normal
    dof_of = {quantity.group: quantity.drawn_dof for quantity in inputs if quantity.group}
    t_factor = {
        name: np.sqrt(dof_of[name] / rng.chisquare(dof_of[name], n_draw)) for name in sorted(dof_of)
    }
    drawn = {
        inputs[i].name: inputs[i].value
        + inputs[i].drawn_scale
        * (z * t_factor[inputs[i].group] if inputs[i].group else standard_score(inputs[i], z))
        for i, z in zip(order, normal, strict=True)
    }
    return {quantity.name: drawn[quantity.name] for quantity in inputs}


def standard_score(quantity: Input, z: FloatArray) -> FloatArray:
    """(x - value)/scale at the normal quantile `z`, (n_draw,): the increasing map from N(0, 1) to
    the input's distribution.
    """
    relative = quantity.u / quantity.value if quantity.distribution in POSITIVE else 0.0
    return score(
        z, quantity.distribution, dof=quantity.drawn_dof, shape=quantity.shape, relative=relative
    )


def _copula_coefficient(first: Input, second: Input, target: float) -> float:
    """Correlation of two normal variates whose transforms to the distributions of two inputs have
    correlation `target`.

    sum_k a_k b_k rho^k over all degrees k of the orthonormal Hermite polynomials; the terms left
    out go to the last odd and even one, so that rho = -1 and 1 are exact.
    """
    from scipy.optimize import brentq

    z = _STEP * (np.arange(-_FAREST / _STEP, _FAREST / _STEP) + 0.5)
    weight = _STEP * np.exp(normal_log_density(z))
    scores, share = [], 1.0
    for quantity in (first, second):
        if math.isinf(quantity.standard_deviation):
            rule = "cannot include a t distribution with dof <= 2 (it has no standard deviation)"
            raise InputError(rule, field="correlation", value=quantity.name)
        drawn = z if quantity.group else standard_score(quantity, z)
        share *= _share_of_factor(quantity.drawn_dof) if quantity.group else 1.0
        centred = drawn - np.sum(weight * drawn)
        scores.append(centred / math.sqrt(np.sum(weight * centred**2)))
    product = np.empty(_N_TERM)  # of the coefficients a_k b_k
    previous, polynomial = np.zeros_like(z), np.ones_like(z)
    for degree in range(_N_TERM):
        product[degree] = np.prod([np.sum(weight * drawn * polynomial) for drawn in scores])
        previous, polynomial = (
            polynomial,
            (z * polynomial - math.sqrt(degree) * previous) / math.sqrt(degree + 1),
        )
    product *= share
    low, high = (  # at rho = -1 and 1
        share * float(np.sum(weight * scores[0] * other)) for other in (scores[1][::-1], scores[1])
    )
    product[-1] += 0.5 * (high - low) - product[1::2].sum()
    product[-2] += 0.5 * (high + low) - product[0::2].sum()
    if not low - PSD_TOLERANCE <= target <= high + PSD_TOLERANCE:
        symmetric = abs(low + high) < 1e-6
        raise InputError(
            f"between '{first.name}' and '{second.name}' can be "
            f"{f'{high:.4f} at most' if symmetric else f'{low:.4f} to {high:.4f}'} with these "
            "distributions",
            field="correlation",
            value=target,
        )
    powers = np.arange(_N_TERM)

    def excess(rho: float) -> float:
        return float(np.sum(product * rho**powers)) - target

    if excess(1.0) <= 0.0 or excess(-1.0) >= 0.0:  # at a limit but for rounding
        return math.copysign(1.0, target)
    return float(brentq(excess, -1.0, 1.0, xtol=1e-14))


def _share_of_factor(dof: float) -> float:
    """E[w]/sqrt(E[w^2]) of w = sqrt(dof/chi-square), dof > 2: what is left of a correlation with a
    variate that does not share it.
    """
    logarithm = math.lgamma(0.5 * (dof - 1.0)) - math.lgamma(0.5 * dof)
    return math.sqrt(0.5 * (dof - 2.0)) * math.exp(logarithm)
