"""The curve of a run together with what it lacks: where the body was in truth, at draws of the
parameters, for bands.

    v^2 = f(x; p)^2 + 2 acceleration e(x)/D,    e(x) = E0 + int_0^x force dx'

Given a draw p and a component of the mixture, e at all places is normal: its mean follows the
residuals that p leaves, its spread is what the data leave open.  In v^2 this is exact also where
the body hardly moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.force import force_kernel, work_along
from estim.discrepancy.grid import START_SD
from estim.discrepancy.kernels import without_mean
from estim.discrepancy.mixture_likelihood import Mixture, inverse_times
from estim.discrepancy.residuals import Residuals
from estim.discrepancy.scale_mixture import Family
from estim.discrepancy.trajectory import TrackResponse
from estim.problem import Motion, Named, Points


@dataclass(frozen=True, eq=False)
class Completed:
    """What the curve of a run of speeds lacks, given the points.

    mixture, formed : of `MixtureErrors`.
    along : the track and the responses that the mixture was made with.
    """

    points: Points
    motion: Motion
    mixture: Mixture
    formed: Residuals
    along: TrackResponse

    def gained(
        self, x: FloatArray, named: Named, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """What start and force add to v^2 (n_draw, n_x) at places x, and the scale of the readings'
        noise (n_draw,), one of each for a draw.

        One error for all places of a draw, so that bands are smooth.
        """
        residuals = self.formed.at(self.points, named)
        mixture = self.mixture
        energy, scale = np.zeros((len(residuals), x.size)), np.ones(len(residuals))
        drawn = list(mixture.drawn(residuals, rng))
        errors = rng.standard_normal((len(residuals), 1))
        z = mixture.deviation.whiten(residuals)
        lengths = {family.length: family for family, *_ in drawn}
        units = {length: _Unit.of(self, family, x) for length, family in lengths.items()}
        for family, k, rows in drawn:
            mean, sd = units[family.length].posterior(mixture, family, k, z[rows])
            energy[rows], scale[rows] = mean + sd * errors[rows], family.scale[k]
        arguments = self.points.bind(named)
        metres = self.motion.metres(arguments)
        factor = (
            self.motion.gravity(arguments)
            * metres
            / self.motion.energies(x, np.ones(x.size), arguments)[0]
        )
        return energy * factor, scale


@dataclass(frozen=True, eq=False)
class _Unit:
    """Of the energy at places x: covariance (n_x, n_obs) with the whitened points and variance
    (n_x,), for a force of unit amplitude and a push.
    """

    force: FloatArray
    force_variance: FloatArray
    push: FloatArray
    push_variance: float

    @classmethod
    def of(cls, completed: Completed, family: Family, x: FloatArray) -> _Unit:
        along, whiten = completed.along, completed.mixture.deviation.whiten
        kernel = without_mean(
            force_kernel(along.track, family.length, radius=along.radian), along.track.weights
        )
        done = work_along(along.track, x)
        sd = START_SD * along.radian
        return cls(
            whiten(done @ kernel @ along.response.force.T),
            np.einsum("ij,jk,ik->i", done, kernel, done),
            sd * whiten(along.push),
            sd**2,
        )

    def posterior(
        self, mixture: Mixture, family: Family, k: int, z: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Mean (n_draw, n_x) and standard deviation (n_x,) of the energy for whitened residuals z
        (n_draw, n_obs), under component k.
        """
        strength = family.amplitude[k] ** 2
        along = strength * self.force + self.push
        answer = inverse_times(along, mixture.causes(family, k), float(family.scale[k] ** 2))
        variance = strength * self.force_variance + self.push_variance
        variance -= np.einsum("ij,ij->i", answer, along)
        return z @ answer.T, np.sqrt(np.maximum(variance, 0.0))
