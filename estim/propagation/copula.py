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
from estim.propagation.inputs import PSD_TOLERANCE, Input
from estim.propagation.scores import POSITIVE, SYMMETRIC, score
from estim.propagation.skewed import skewed_coefficient


def copula_matrix(inputs: Sequence[Input], correlation: FloatArray) -> FloatArray:
    """Correlation matrix of the normal variates whose transforms to the inputs' distributions have
    `correlation`, (n_in, n_in).

    With g = sum_k a_k h_k(z) the standardised quantile transform (h_k the orthonormal Hermite
    polynomials) the correlation of two inputs is sum_k a_k b_k rho^k; it is solved for rho pair by
    pair.  Two normal quantities: rho = r; two rectangular ones: rho = 2 sin(pi r/6).

    Raises InputError where the marginal distributions cannot have the correlation asked for, or not
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

    The normal variates are taken in the order of the names, so the order in which inputs are listed
    changes no draw.
    """
    order = sorted(range(len(inputs)), key=lambda i: inputs[i].name)
    normal = rng.standard_normal((len(inputs), n_draw))
    ordered = copula[np.ix_(order, order)]
    if np.count_nonzero(ordered) > len(inputs):
        variance, axes = np.linalg.eigh(ordered)
        normal = (axes * np.sqrt(np.maximum(variance, 0.0))) @ axes.T @ normal
    dof_of = {quantity.group: quantity.drawn_dof for quantity in inputs if quantity.group}
    wider = {
        name: np.sqrt(dof_of[name] / rng.chisquare(dof_of[name], n_draw)) for name in sorted(dof_of)
    }
    drawn = {
        inputs[i].name: inputs[i].value
        + inputs[i].drawn_scale
        * (z * wider[inputs[i].group] if inputs[i].group else standard_score(inputs[i], z))
        for i, z in zip(order, normal, strict=True)
    }
    return {quantity.name: drawn[quantity.name] for quantity in inputs}


def standard_score(one: Input, z: FloatArray) -> FloatArray:
    """(x - value)/scale at the normal quantile `z`, (n_draw,): the increasing map from N(0, 1) to
    the input's distribution.
    """
    relative = one.u / one.value if one.distribution in POSITIVE else 0.0
    return score(z, one.distribution, dof=one.drawn_dof, shape=one.shape, relative=relative)


def _copula_coefficient(first: Input, second: Input, target: float) -> float:
    from scipy.optimize import brentq

    for quantity in (first, second):
        if math.isinf(quantity.standard_deviation):
            rule = "cannot include a t distribution with dof <= 2 (it has no standard deviation)"
            raise InputError(rule, field="correlation", value=quantity.name)
    if not (first.distribution in SYMMETRIC and second.distribution in SYMMETRIC):
        return skewed_coefficient(
            lambda z: standard_score(first, z),
            lambda z: standard_score(second, z),
            target,
            (first.name, second.name),
        )
    z, weight = _half_line()
    scores = [
        standard_score(quantity, z) * quantity.drawn_scale / quantity.standard_deviation
        for quantity in (first, second)
    ]
    product = _hermite(scores[0]) * _hermite(scores[1])
    same = (first.distribution, first.drawn_dof, first.shape) == (
        second.distribution,
        second.drawn_dof,
        second.shape,
    )
    largest = 1.0 if same else float(2.0 * np.sum(weight * scores[0] * scores[1]))
    if abs(target) > largest:
        rule = (
            f"between '{first.name}' and '{second.name}' can be {largest:.4f} at most with "
            "these distributions"
        )
        raise InputError(rule, field="correlation", value=target)
    powers = 2 * np.arange(product.size) + 1
    # the terms left out, so that rho = 1 gives the largest correlation exactly
    product[-1] += largest - product.sum()
    magnitude = brentq(
        lambda rho: float(np.sum(product * rho**powers)) - abs(target), 0.0, 1.0, xtol=1e-14
    )
    return math.copysign(float(magnitude), target)


def _half_line() -> tuple[FloatArray, FloatArray]:
    step = 0.01
    z = -step * (np.arange(1200, dtype=np.float64) + 0.5)
    return z, np.asarray(step * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi), dtype=np.float64)


def _hermite(score: FloatArray, n_odd: int = 40) -> FloatArray:
    """Coefficients of an odd function on the orthonormal Hermite polynomials of degree 1, 3, 5,
    ...: (n_odd,).
    """
    z, weight = _half_line()
    coefficients = np.empty(n_odd)
    below, here = np.zeros_like(z), np.ones_like(z)
    for degree in range(2 * n_odd):
        if degree % 2 == 1:
            coefficients[degree // 2] = 2.0 * np.sum(weight * score * here)
        below, here = here, (z * here - math.sqrt(degree) * below) / math.sqrt(degree + 1)
    return coefficients
