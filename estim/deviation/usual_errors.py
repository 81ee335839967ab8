"""Errors of clock and length scale that nobody stated and no residual shows, each with a small usual standard deviation, inside the covariance.

    C = stated covariance + sum_k h_k h_k^T,    h_k what one standard deviation of error k does to the points

The same, to first order, as an unknown with that normal prior, which is integrated out: it costs no sampled dimension and leaves the curve as it is.
What the data say of each afterwards (`read_off`), at the mode with residuals r, derivatives J and covariance S of the parameters:

    mean h^T C^-1 r,    variance 1 - h^T C^-1 h + g^T S g,    g = J^T C^-1 h        in units of its standard deviation
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from estim.arrays import FloatArray
from estim.common import later, phrase
from estim.deviation.noise import Stated
from estim.problem import (
    DENSE,
    CorrelatedErrors,
    Likelihood,
    Motion,
    Named,
    Noise,
    Points,
    Posterior,
    RootErrors,
    Scale,
    Size,
    Wording,
    covariance_of,
    with_columns,
)

USUAL = {"length": 3e-3, "clock": 5e-4}  # shares: a ruler in a picture, the time base of a camera


@dataclass(frozen=True, eq=False)
class WithUsualErrors(Stated):
    """Stated normal noise of known size, and small errors in common to all points beside it.

    motion : of the body.  sds : error in common -> its standard deviation (a share).
    """

    motion: Motion
    sds: Mapping[str, float]

    def likelihood(self, points: Points, named: Named) -> CorrelatedErrors | RootErrors:
        stated = self.base.likelihood(points, named)
        assert stated.normal is not None, "asked where a campaign is read"
        moved, root = self.columns(points, named), stated.normal.root(named)
        if points.x.size > DENSE:
            return RootErrors(points, Size(Scale(1.0)), with_columns(root, moved), points.y - stated.y)
        spectrum, basis = np.linalg.eigh(covariance_of(root) + moved @ moved.T)
        rounding = np.finfo(float).eps * spectrum.size * spectrum[-1]
        return CorrelatedErrors(points, Size(Scale(1.0), Scale(), 0.0), basis, np.maximum(spectrum, rounding), points.y - stated.y)

    def columns(self, points: Points, named: Named) -> FloatArray:
        """(n_obs, n_error) h_k in the order of `sds`, unit of y; 0 where the motion knows no such error."""
        arguments = points.bind(named)
        local = points.curve.local(points.x, arguments)
        curve = np.ravel(np.broadcast_to(local.value, (1, points.x.size)))  # in the place of the readings, whose noise would correlate with residuals
        known = self.motion.scale_errors(points.x, curve, local, arguments)
        columns = [known[name] * sd if name in known else np.zeros(points.x.size) for name, sd in self.sds.items()]
        return np.column_stack([np.nan_to_num(column) for column in columns])

    def for_search(self) -> WithUsualErrors:
        return self

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        stated = self.base.describe(x_unit=x_unit, y_unit=y_unit, words=words)
        sizes = phrase(" and ").join(phrase(_WORDS[name], size=100.0 * sd) for name, sd in self.sds.items())
        return phrase("{stated}; beside it {sizes} in common to all (the default where nothing is said)", stated=stated, sizes=sizes)


_WORDS = {"length": later("{size:.2g} % of the length scale"), "clock": later("{size:.2g} % of the clock")}


@dataclass(frozen=True)
class ReadOff:
    """What the data of a run say of an error: the sd it was given beforehand, mean and sd afterwards; shares."""

    run: str
    name: str
    prior_sd: float
    mean: float
    sd: float


def usual_errors_of(noise: Noise) -> WithUsualErrors | None:
    """The usual errors in a noise, under whatever else was put around it; None where it has none."""
    around: object = noise
    while isinstance(around, Stated) and not isinstance(around, WithUsualErrors):
        around = around.base
    return around if isinstance(around, WithUsualErrors) else None


def read_off(posterior: Posterior, values: FloatArray, cov: FloatArray) -> tuple[ReadOff, ...]:
    """What the data say of the usual errors of each run, to first order about the mode `values` (n_par,) with covariance `cov`."""
    problem, named, found = posterior.problem, posterior.problem.named(values), []
    for group, likelihood in zip(problem.groups, posterior.likelihoods, strict=True):
        run, *others = group.runs
        noise, points = usual_errors_of(run.noise), run.points
        if noise is None or others:  # runs that are fit together have no usual errors in their noise
            continue
        residuals = likelihood.y - np.ravel(np.broadcast_to(points.value(named), (1, run.n_obs)))
        gradient = points.gradient(named, problem.names)
        for (name, sd), column in zip(noise.sds.items(), noise.columns(points, named).T, strict=True):
            product = partial(_product, likelihood, named, column)
            g = np.array([product(gradient[:, i]) for i in range(problem.n_par)])
            variance = 1.0 - product(column) + float(g @ cov @ g)
            found.append(ReadOff(run.name, name, sd, sd * product(residuals), sd * float(np.sqrt(np.clip(variance, 0.0, 1.0)))))
    return tuple(found)


def _product(likelihood: Likelihood, named: Named, a: FloatArray, b: FloatArray) -> float:
    """a^T C^-1 b."""
    return 0.25 * (likelihood.squared_size(a + b, named) - likelihood.squared_size(a - b, named))
