"""What the data of a fit are silent about: parameters that no residual sees, and errors where the
curve passes through every point.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import max_abs, positive_or
from estim.fitting.gauss_newton import SILENT
from estim.fitting.least_squares import Fit
from estim.problem import Observations

PERFECT = 3e-14  # residuals below this share of y are rounding errors


def silent_parameters(fit: Fit) -> tuple[str, ...]:
    """The parameters of the curve that the residuals of data and priors do not see, alone or in
    some combination.

    From the singular values of the Jacobian with columns of unit length: the smallest, and those as
    small as it.
    """
    names = [name for name in fit.names if name not in fit.problem.noise_names]
    columns = fit.posterior.jacobian(fit.values)[:, [fit.names.index(name) for name in names]]
    # a parameter without a derivative is one that nothing is known of
    columns = np.where(np.all(np.isfinite(columns), axis=0), columns, 0.0)
    scale = positive_or(np.linalg.norm(columns, axis=0), 1.0)
    _, singular, right = np.linalg.svd(columns / scale, full_matrices=True)
    sizes = np.append(singular, np.zeros(len(names) - singular.size))
    share = np.sqrt(np.sum(right[sizes <= max(SILENT * sizes[0], 2.0 * sizes[-1])] ** 2, axis=0))
    return tuple(name for name, part in zip(names, share, strict=True) if part > 0.2)


def no_scatter(run: Observations, fit: Fit) -> bool:
    """Whether the curve passes through every point of `run` to rounding errors, though it has fewer
    parameters than the run points.
    """
    curve = run.drawn(fit.named)
    size = max(max_abs(run.y), max_abs(curve))
    return run.n_obs > len(run.curve_parameters) and bool(
        np.max(np.abs(run.y - curve)) <= PERFECT * size
    )
