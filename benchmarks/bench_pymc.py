"""The posterior of `bench.py` written anew for PyMC and sampled by nutpie, which needs its
gradient.

    OMP_NUM_THREADS=1 python benchmarks/bench_pymc.py       # the two log densities at 50 points

v = sqrt(2 g R W/D) as in `model.phase`, in operations of PyTensor.  What the curve lacks is the
mixture with constant covariances of the fit,

    C_k = L (s_k^2 I + a_k^2 B diag(spectrum) B^T + H H^T) L^T,

diagonal in the eigenbasis B of each length, with the few columns H by Woodbury's formula; the
constants are computed here from these covariances.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

CHAINS, TUNE, DRAWS, SEED = 4, 600, 9000, 1
# the fastest of four that were tried: the ridge bends
WAY = {"low_rank_modified_mass_matrix": True, "target_accept": 0.95}


@dataclass(frozen=True)
class Constants:
    """Of the likelihood of residuals r: log sum_k exp(log_norm_k - (white_k |z|^2 + gain_k (basis^T
    z)^2)/2 + |pushed_k z|^2/2), z = whitener r.

    whitener : (n_obs, n_obs).
    basis : (n_obs, n_dir).  gain : (n_component, n_dir).  pushed : (n_component, n_column, n_obs).
    log_norm, white : (n_component,).
    """

    whitener: FloatArray
    basis: FloatArray
    gain: FloatArray
    pushed: FloatArray
    log_norm: FloatArray
    white: FloatArray


def constants_of(likelihood: Any) -> Constants:
    """The constants, from the covariances of the mixture that the fit was made with."""
    mixture = likelihood.mixture
    n_obs, families, columns = mixture.deviation.n_obs, mixture.deviation.families, mixture.columns
    stated = mixture.deviation.root.coloured(np.eye(n_obs)).T
    basis, start = np.hstack([family.basis for family in families]), 0
    gain, pushed, log_norm, white = [], [], [], []
    for family in families:
        here = slice(start, start + family.spectrum.size)
        start = here.stop
        for amplitude, scale, log_prior in zip(
            family.amplitude, family.scale, family.log_prior, strict=True
        ):
            without = (
                scale**2 * np.eye(n_obs)
                + amplitude**2 * (family.basis * family.spectrum) @ family.basis.T
            )
            solved = np.linalg.solve(without, columns)
            pushed.append(
                np.linalg.solve(
                    np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ solved), solved.T
                )
            )
            white.append(1.0 / scale**2)
            gain.append(np.zeros(basis.shape[1]))
            gain[-1][here] = 1.0 / (scale**2 + amplitude**2 * family.spectrum) - white[-1]
            volume = np.linalg.slogdet(
                2.0 * np.pi * stated @ (without + columns @ columns.T) @ stated.T
            )[1]
            log_norm.append(log_prior - 0.5 * volume)
    return Constants(
        np.linalg.inv(stated),
        basis,
        np.array(gain),
        np.array(pushed),
        np.array(log_norm),
        np.array(white),
    )


def variable(name: str, prior: Any) -> Any:
    """The prior as PyMC's, in units of its standard deviation; limits many of these away are left
    out.
    """
    import pymc as pm

    kind = type(prior).__name__
    if kind == "Normal":
        return pm.Deterministic(name, prior.mean + prior.sd * pm.Normal(f"{name} in sd"))
    if kind == "Uniform":
        return pm.Uniform(name, prior.low, prior.high)
    if kind == "HalfNormal":
        return pm.Deterministic(name, prior.scale * pm.HalfNormal(f"{name} in sd"))
    raise ValueError(f"no prior of PyMC is written for {kind}")


def model_of(fit: Any) -> Any:
    """The PyMC model of a fit of one run of speeds."""
    import pymc as pm
    import pytensor.tensor as pt

    run, likelihood = fit.problem.runs[0], fit.posterior.likelihoods[0]
    known, x, y = constants_of(likelihood), likelihood.points.x, likelihood.y
    with pm.Model() as model:
        named = {p.name: variable(p.name, p.prior) for p in fit.problem.parameters}
        own = {
            argument: named[source] if isinstance(source, str) else source
            for argument, source in run.arguments.items()
        }
        gamma, radius, phi, theta0 = own["gamma"], own["radius"], own["phi"], own["theta0"]
        inertia = own["kappa"] * (1.0 - gamma) + gamma  # a particle on the rim, nothing that trails
        angle = x / radius
        slope = pt.sin(phi) + own["rolling_resistance"] * pt.cos(phi)
        work = 2.0 * gamma * pt.sin(theta0 + 0.5 * angle) * pt.sin(0.5 * angle) - angle * slope
        ratio = work / (1.0 + inertia + 2.0 * gamma * pt.cos(theta0 + angle + phi))
        speed = pt.sqrt(pt.maximum(2.0 * own["g"] * radius * ratio, 1e-30))
        white = pt.dot(known.whitener, y - speed)
        seen = pt.dot(known.basis.T, white)
        explained = pt.dot(known.pushed.reshape(-1, x.size), white).reshape(known.pushed.shape[:2])
        misfit = (
            known.white * pt.sum(white**2)
            + pt.dot(known.gain, seen**2)
            - pt.sum(explained**2, axis=1)
        )
        pm.Potential("likelihood", pt.logsumexp(known.log_norm - 0.5 * misfit))
    return model


def free_values(fit: Any, point: FloatArray) -> dict[str, float]:
    """Name of a free variable of the model -> its value at a point (n_par,) of the fit."""
    found = {}
    for parameter, value in zip(fit.problem.parameters, point, strict=True):
        prior, kind = parameter.prior, type(parameter.prior).__name__
        if kind == "Uniform":
            found[parameter.name] = value
        else:
            found[f"{parameter.name} in sd"] = (
                (value - prior.mean) / prior.sd if kind == "Normal" else value / prior.scale
            )
    return found


def differences(fit: Any, n: int = 50, seed: int = 3) -> FloatArray:
    """(n,) log density of the PyMC model less that of estim, at draws about the fit; constant where
    they are the same posterior.
    """
    points = np.random.default_rng(seed).multivariate_normal(fit.values, 2.0 * fit.cov, size=40 * n)
    points = points[np.isfinite(fit.posterior.log_density(points))][:n]
    model = model_of(fit)
    density, found = model.compile_logp(jacobian=False), []
    for point in points:
        given = {}
        for name, value in free_values(fit, point).items():
            free = model[name]
            transform = model.rvs_to_transforms[free]
            inner = (
                value if transform is None else transform.forward(value, *free.owner.inputs).eval()
            )
            given[model.rvs_to_values[free].name] = np.asarray(inner)
        found.append(float(density(given)))
    return np.array(found) - fit.posterior.log_density(points)


def compiled(fit: Any) -> Any:
    """The model as nutpie runs it, started about the fit."""
    import nutpie

    return nutpie.compile_pymc_model(model_of(fit), initial_points=free_values(fit, fit.values))


def draws_of(ready: Any, names: tuple[str, ...]) -> FloatArray:
    """(n_chain, n_step, n_par), chain after chain on one core."""
    import nutpie

    trace = nutpie.sample(
        ready, draws=DRAWS, tune=TUNE, chains=CHAINS, cores=1, seed=SEED, progress_bar=False, **WAY
    )
    return np.stack([np.asarray(trace.posterior[name]) for name in names], axis=-1)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    from bench_samplers import posed

    off = differences(posed())
    print(
        f"log density of PyMC less estim's at {off.size} points: {off.mean():.3g}, constant "
        f"to {np.ptp(off):.2g}"
    )
    sys.exit(0 if np.ptp(off) < 1e-8 else 1)
