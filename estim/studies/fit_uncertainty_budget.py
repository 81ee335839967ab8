"""Where the uncertainty of a fit comes from: the part of each stated value, of each error in
common, of what the curve lacks, and of the readings.

To first order the mode moves with what it was made of by

    dp = S [ sum_i P_i dm_i + J^T C^-1 dy ],    S = (P + J^T C^-1 J)^-1

with P the information of the priors, J the derivatives of the curve, C the covariance of the
readings.  A stated value m_i with standard uncertainty u_i = P_i^(-1/2) moves a quantity q with
gradient g by (S g)_i / u_i; a part C_k of C = sum_k C_k contributes the variance

    g^T S J^T C^-1 C_k C^-1 J S g.

The squares add up to the variance g^T S g exactly.  This is the law of propagation (JCGM 100:2008,
5.1.2) for an estimate, and what Pinto et al., Eur. Phys. J. C 84 (2024) 593, call the decomposition
by shifts of the global observables: other than the customary difference of the squares of two fits,
one with a source held fixed, it is additive, and no part takes the credit of another.

The draws check it without any linearity: for a normal prior the posterior mean moves by dE[q]/dm_i
= Cov(q, p_i)/u_i^2, an identity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, all_finite
from estim.discrepancy import parts_of_errors
from estim.fitting import Fit, linear_derived
from estim.problem import DefaultError, Normal, Observations, Prior

READINGS, STATED, PRIOR, COMMON = "readings", "stated", "prior", "common"
# quantities of a kind: sources times quantities grow with the square of the number of runs
_MOST = 150


@dataclass(frozen=True, eq=False)
class BudgetSource:
    """name : of a parameter whose prior it is, or of a part of the errors of the readings.

    kind : "stated" (a measured value), "prior" (any other prior), "common" (an error in common that
        no residual shows), "curve" (what the curve lacks, and a start that is not exact),
        "readings".
    """

    name: str
    kind: str


@dataclass(frozen=True, eq=False)
class FitBudget:
    """sources : rows.  names : of quantities, parameters first, then what follows from them (with
    "[run]" where runs differ).

    contributions : (n_source, n_quantity) standard uncertainties, in the unit of the quantity;
        signed for a stated value (how far q moves if it was one standard uncertainty too low).
        drawn : the same from draws, nan where draws do not determine it.
    sds : (n_quantity,) of the linear approximation; root of the sum of squares.
    posterior : (n_quantity,) of the draws.
    """

    sources: tuple[BudgetSource, ...]
    names: tuple[str, ...]
    contributions: FloatArray
    drawn: FloatArray
    sds: FloatArray
    posterior: FloatArray

    @cached_property
    def shares(self) -> FloatArray:
        """(n_source, n_quantity) of the variance; columns add up to 1."""
        return np.square(self.contributions / self.sds)

    @cached_property
    def shares_drawn(self) -> FloatArray:
        """(n_source, n_quantity) of the variance of the draws; nan where it is undetermined."""
        return np.square(self.drawn / self.posterior)


def uncertainty_budget(fit: Fit, draws: FloatArray) -> FitBudget | None:
    """What the standard deviation of each parameter of the curve, and of what was sought from them,
    is made of; None without a covariance.

    draws : (n_draw, n_par) of the posterior.
    """
    problem, cov = fit.problem, fit.cov
    if fit.singular or not all_finite(cov) or np.any(np.diag(cov) <= 0.0):
        return None
    names, gradients, values = _quantities(fit, draws)
    along = cov @ gradients  # S g
    pulls = fit.prior_jacobian  # 1/u_i
    informative = np.flatnonzero(np.diag(pulls))
    stated = pulls[informative] @ along
    sds = np.sqrt(np.einsum("ij,ij->j", gradients, along))
    parts = parts_of_errors(fit.posterior, fit.values, along)
    rest = (
        np.square(sds)
        - np.sum(stated**2, axis=0)
        - sum((part**2 for part in parts.values()), np.zeros(sds.size))
    )
    priors = [
        BudgetSource(fit.names[i], _kind_of(problem.parameters[i].prior)) for i in informative
    ]
    further = [BudgetSource(name, "curve") for name in parts]
    is_normal = [isinstance(problem.parameters[i].prior, Normal) for i in informative]
    drawn = np.where(
        np.array(is_normal)[:, None], _drawn(pulls[informative], draws, values), np.nan
    )
    nothing = np.full(sds.size, np.nan)
    return FitBudget(
        sources=(*priors, *further, BudgetSource(READINGS, READINGS)),
        names=tuple(names),
        contributions=np.vstack([*stated, *parts.values(), np.sqrt(np.maximum(rest, 0.0))]),
        drawn=np.vstack([drawn, *(nothing for _ in parts), nothing]),
        sds=sds,
        posterior=values.std(axis=0, ddof=1),
    )


def _kind_of(prior: Prior) -> str:
    if isinstance(prior, DefaultError):
        return COMMON
    return STATED if isinstance(prior, Normal) else PRIOR


def _drawn(pulls: FloatArray, draws: FloatArray, values: FloatArray) -> FloatArray:
    """(n_prior, n_quantity) Cov(q, p)/u for a normal prior with standard deviation u.  pulls :
    (n_prior, n_par) 1/u.  draws : (n_draw, n_par).
    """
    deviations = draws - draws.mean(axis=0)
    return pulls @ (deviations.T @ (values - values.mean(axis=0))) / (len(draws) - 1)


def _quantities(fit: Fit, draws: FloatArray) -> tuple[list[str], FloatArray, FloatArray]:
    """The parameters of the curve, of many those that runs share first, and what was sought, once
    where it is the same for all runs: names, gradients (n_par, n_quantity), and values at the draws
    (n_draw, n_quantity).
    """
    problem = fit.problem
    noise, named = problem.noise_names, problem.named(draws)
    chosen = [i for i in problem.foremost(_MOST) if fit.names[i] not in noise]
    names = [fit.names[i] for i in chosen]
    gradients, values = [*np.eye(fit.values.size)[chosen]], [*draws[:, chosen].T]
    by_name: dict[str, list[tuple[Observations, FloatArray]]] = {}
    for run in problem.runs:
        requested = {derived.name for derived in run.sought}
        for derived in linear_derived(run, fit.names, fit.values, fit.cov) if requested else ():
            if (
                derived.name in requested
                and all_finite(derived.gradient)
                and np.any(derived.gradient)
            ):
                by_name.setdefault(derived.name, []).append((run, derived.gradient))
    for name, each in by_name.items():
        same = all(np.allclose(gradient, each[0][1], rtol=1e-6) for _, gradient in each)
        for run, gradient in each[: 1 if same else _MOST]:
            names.append(name if same else f"{name}[{run.name}]")
            gradients.append(gradient)
            values.append(np.ravel(run.derived(run.bind(named))[name].values))
    return names, np.column_stack(gradients), np.column_stack(values)
