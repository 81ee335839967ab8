"""What would have been measured, had the readings been made again: data sets drawn from the
posterior of a run with what its curve lacks.

The same body, track and start: of each draw of the parameters comes a component of the mixture with
its probability, then what the curve lacks (force, start, shifts of bad frames; u below) from what
the residuals z leave possible, then new errors of the readings:

    z = B u + s e,    u ~ N(0, 1),    E(u | z) = B^T (B B^T + s^2)^-1 z

by an unconditional draw (u0, z0) moved by the estimate from z - z0 (Journel and Huijbregts, Mining
Geostatistics (1978) VII.A.1), all in units of the noise.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.likelihood import MixtureErrors
from estim.discrepancy.mixture_likelihood import inverse_times
from estim.problem import Named


def replicas(errors: MixtureErrors, named: Named, *, rng: np.random.Generator) -> FloatArray:
    """(n_draw, n_obs) ordinates measured again, one set for each draw in the columns of `named`."""
    mixture, residuals = errors.mixture, errors.raw(named)
    z, repeated = mixture.deviation.whiten(residuals), np.empty_like(residuals)
    for family, k, rows in mixture.drawn(residuals, rng):
        scale = float(family.scale[k])
        causes = mixture.causes(family, k)
        latent = rng.standard_normal((rows.size, causes.shape[1]))
        difference = (
            z[rows] - latent @ causes.T - scale * rng.standard_normal((rows.size, z.shape[1]))
        )
        latent += inverse_times(difference, causes, scale**2) @ causes
        repeated[rows] = latent @ causes.T + scale * rng.standard_normal((rows.size, z.shape[1]))
    return errors.formed.readings(errors.points, named, mixture.deviation.root.coloured(repeated))
