"""Sizes of errors that are inferred from the residuals: the degrees of freedom that a standard
deviation has from them, and by how much the objective rises at the end of an interval.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, positive_or
from estim.fitting.least_squares import Fit


@dataclass(frozen=True, eq=False)
class ErrorSizes:
    """The sizes of the errors of a fit, one for each group of data sets that share theirs.

    dof : (n_group,) degrees of freedom of each size; infinite where it is stated.
    n_obs : (n_group,) readings where the size is one of the unknowns; infinite where it is held.
    parts : (n_group, n_par, n_par) C I C of each group's information I, with C the covariance of
        the parameters.  cov : C.  None where there is one group.
    """

    dof: FloatArray
    n_obs: FloatArray
    parts: FloatArray | None = None
    cov: FloatArray | None = None

    def shares(self, gradients: FloatArray) -> FloatArray:
        """(n, n_group) what each group contributes to the variance of quantities of gradients
        (n, n_par); what is missing to 1 comes from priors.
        """
        if self.parts is None or self.cov is None:
            return np.ones((len(gradients), 1))
        of_groups = np.einsum("ni,gij,nj->ng", gradients, self.parts, gradients)
        total = np.einsum("ni,ij,nj->n", gradients, self.cov, gradients)
        return of_groups / positive_or(total, 1.0)[:, None]

    def degrees_of_freedom(self, shares: FloatArray) -> FloatArray:
        """(n,) of standard deviations with these shares (n, n_group), by Welch and Satterthwaite
        (JCGM 100, G.4).
        """
        with np.errstate(divide="ignore"):
            return 1.0 / np.sum(np.square(shares) / self.dof, axis=1)

    def rises(self, t2: FloatArray, shares: FloatArray) -> FloatArray:
        """(n,) rise of -2 log density at t standard deviations from the mode: t^2 where sizes are
        held, n_obs ln(1 + t^2/dof) where one is among the unknowns, as it is for a line.

        The variance of what several groups contribute to is 1 + 4 sum w (1 - w)/dof times as large
        as it seems: a group whose residuals happen to be small counts too much.  Source: Meier,
        Biometrics 9 (1953) 59, for a weighted mean.
        """
        t2 = (t2 * (1.0 + 4.0 * np.sum(shares * (1.0 - shares) / self.dof, axis=1)))[:, None]
        free = np.isfinite(self.n_obs) & np.isfinite(self.dof)
        n_obs, dof = np.where(free, self.n_obs, 0.0), np.where(free, self.dof, 1.0)
        of_groups = np.where(free, n_obs * np.log1p(shares * t2 / dof), shares * t2)
        by_priors = np.maximum(1.0 - shares.sum(axis=1), 0.0)
        return of_groups.sum(axis=1) + by_priors * t2[:, 0]


def fixed_size(dof: float) -> ErrorSizes:
    """One size that is fixed, from `dof` degrees of freedom."""
    return ErrorSizes(np.array([dof]), np.array([np.inf]))


STATED = fixed_size(np.inf)


def error_sizes(fit: Fit) -> ErrorSizes:
    """Those of a fit, which infers some of them or none."""
    groups = fit.problem.groups
    inferred = np.array(
        [any(run.noise.size.parameters for run in group.runs) for group in groups], dtype=bool
    )
    if not np.any(inferred):
        return STATED
    n_obs = np.array([sum(run.n_obs for run in group.runs) for group in groups], dtype=float)
    if len(groups) == 1:
        return ErrorSizes(np.array([max(fit.dof, 1.0)]), n_obs)
    of_curve = fit.problem.of_curve
    cov = np.zeros_like(fit.cov)
    cov[np.ix_(of_curve, of_curve)] = fit.cov[np.ix_(of_curve, of_curve)]
    informations = np.stack(fit.posterior.informations(fit.values))
    n_par = np.einsum("ij,gji->g", cov, informations)
    dof = np.where(inferred, np.maximum(n_obs - n_par, 1.0), np.inf)
    parts = cov @ informations @ cov
    # what is unknown of the errors is determined by the groups that have it
    for i in set(range(len(fit.names))) - set(of_curve):
        name = fit.names[i]
        having = [any(name in run.noise.parameters for run in group.runs) for group in groups]
        cov[i, i] = 1.0
        parts[having, i, i] = 1.0 / max(sum(having), 1)
    return ErrorSizes(dof, np.where(inferred, n_obs, np.inf), parts, cov)
