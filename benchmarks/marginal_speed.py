"""Effective draws per second of a joint fit of N runs of one body, and whether the draws were
right; prints a Markdown table.

    OMP_NUM_THREADS=1 python benchmarks/marginal_speed.py [--runs 1 4 16 64] [--seconds 30] [--seed
    1]

Synthetic runs (video at 30 frames/s, sigma_x = 1 mm) of one body, gamma stated as 0.187(10), kappa
uniform in [0, 1], tilt and angle of release of every run stated to 0.4 and 1.5 degrees: 2 + 2 N
parameters.

Seconds are those of the processor.

- marginal: `sample_marginal`, 20,000 draws, with its check in all dimensions, start-up included;
  effective size of Kish.
- full sampler: `sample_posterior`, up to 16 runs, for at most the given seconds; stretch: emcee's
  default move, 4 walkers a parameter, for the same time, a third of it discarded.  Effective size:
  the smallest rank-normalised bulk ESS of gamma and kappa.

Right: the means of gamma and kappa against a reference that approximates nothing, exact importance
weights in all dimensions of 60,000 other draws (200,000 for a single run); the larger distance in
posterior standard deviations, and in Monte-Carlo errors (both sides) as z.  |z| < 3.5 counts as
right, if the Monte-Carlo error is below 0.2 standard deviations: else nothing can be said.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import emcee
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.campaign import load_campaign
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.model import Body
from estim.model.simulate import frame_times, simulate_positions
from estim.sampling.chain import Target, sample_posterior
from estim.sampling.diagnostics import mixing_of
from estim.sampling.marginal import sample_marginal

FloatArray = NDArray[np.float64]
HEAD = """title = "benchmark"
kind = "synthetic"
[shared]
g = 9.81
noise = {sigma_x_m = 0.001}
[bodies.b]
radius_m = 0.15
gamma = "0.187(10)"
kappa = {prior = "uniform", low = 0.0, high = 1.0}
"""


class Moments(NamedTuple):
    """Means, their Monte-Carlo errors and posterior sds of (gamma, kappa); effective size and
    seconds it took.
    """

    mean: FloatArray
    error: FloatArray
    sd: FloatArray
    ess: float
    seconds: float


def simulated_fit(n_run: int, rng: np.random.Generator, folder: Path) -> Fit:
    """The fit of `n_run` simulated runs."""
    body, text = Body(radius=0.15, gamma=0.187, kappa=0.45), HEAD
    for i in range(n_run):
        tilt, release = 2.0 + 4.0 * (i % 5) / 4.0, 55.0 + 5.0 * (i % 3)
        motion = {"phi": float(np.radians(tilt)), "theta0": float(np.radians(release)), "g": 9.81}
        t = frame_times(body, **motion, interval=1.0 / 30.0, x_end=0.877, rng=rng)
        x = simulate_positions(t, body, **motion, sigma_x=0.001, rng=rng)
        (folder / f"{i}.csv").write_text(
            "t_s,x_m\n" + "".join(f"{a:.5f},{b:.6f}\n" for a, b in zip(t - t[0], x, strict=True))
        )
        stated = (
            f'phi_deg = "{tilt + 0.4 * rng.standard_normal():.2f}(40)"\ntheta0_deg = '
            f'"{release + 1.5 * rng.standard_normal():.1f}(1.5)"'
        )
        text += f'[[runs]]\nname = "r{i}"\nbody = "b"\nfile = "{i}.csv"\n{stated}\n'
    (folder / "c.toml").write_text(text)
    campaign = load_campaign(folder / "c.toml")
    return fit_least_squares(campaign.problem(campaign.run_names))


def weighted(draws: FloatArray, log_weights: FloatArray, seconds: float) -> Moments:
    """Moments of weighted draws."""
    w = np.exp(log_weights - np.max(log_weights))
    w /= w.sum()
    mean = w @ draws
    return Moments(
        mean,
        np.sqrt(w**2 @ (draws - mean) ** 2),
        np.sqrt(w @ (draws - mean) ** 2),
        float(1.0 / np.sum(w**2)),
        seconds,
    )


def chained(draws: FloatArray, seconds: float) -> Moments:
    """Moments of chains (n_ensemble, n_step, n_walker, 2)."""
    size, flat = mixing_of(draws).ess_bulk, draws.reshape(-1, draws.shape[-1])
    return Moments(
        flat.mean(axis=0),
        flat.std(axis=0) / np.sqrt(size),
        flat.std(axis=0),
        float(np.min(size)),
        seconds,
    )


def by_marginal(fit: Fit, columns: list[int], rng: np.random.Generator) -> Moments:
    started = time.process_time()
    posterior = sample_marginal(fit, rng=rng, n_draw=20_000)
    return weighted(
        posterior.draws[:, columns], posterior.log_weights, time.process_time() - started
    )


def by_full_sampler(
    fit: Fit, columns: list[int], rng: np.random.Generator, seconds: float
) -> Moments:
    """`sample_posterior` as long as asked for, or a shorter chain where its steps are slow."""
    probe = time.process_time()
    n_walker = max(32, 4 * fit.problem.n_par)
    fit.posterior.log_density(np.repeat(fit.values[None, :], n_walker // 2, axis=0))
    a_step = 8.0 * (time.process_time() - probe)  # four ensembles of two halves
    steps = int(np.clip(seconds / a_step, 200, 20_000))
    started = time.process_time()
    chain = sample_posterior(
        fit.posterior, fit.values, fit.cov, target=Target(max_step=steps), rng=rng
    )
    return chained(chain.draws[..., columns], time.process_time() - started)


def by_stretch(fit: Fit, columns: list[int], rng: np.random.Generator, seconds: float) -> Moments:
    """emcee's default, started like the full sampler; as one ensemble, walkers as chains."""
    n_walker, n_par = max(32, 4 * fit.problem.n_par), fit.problem.n_par
    sampler = emcee.EnsembleSampler(n_walker, n_par, fit.posterior.log_density, vectorize=True)
    sampler.random_state = np.random.RandomState(rng.integers(2**32, dtype=np.uint32)).get_state()
    start: list[FloatArray] = []
    while len(start) < n_walker:
        point = fit.values + np.linalg.cholesky(fit.cov) @ rng.standard_normal(n_par)
        if np.isfinite(fit.posterior.log_density(point[None])[0]):
            start.append(point)
    state, started = np.array(start), time.process_time()
    while time.process_time() - started < seconds:
        state = sampler.run_mcmc(state, 50, skip_initial_state_check=True)
    took = time.process_time() - started
    chain = sampler.get_chain()
    return chained(chain[None, chain.shape[0] // 3 :, :, columns], took)


def reference(fit: Fit, columns: list[int], rng: np.random.Generator) -> Moments:
    n = 200_000 if len(fit.problem.runs) == 1 else 60_000
    posterior = sample_marginal(fit, rng=rng, n_draw=n, n_check=n)
    return weighted(posterior.draws[:, columns], posterior.check_log_weights, 0.0)


def cells(found: Moments, truth: Moments) -> str:
    """The cells of one method: speed, distance, z, verdict."""
    error = np.hypot(found.error, truth.error)
    worst = int(np.argmax(np.abs(found.mean - truth.mean) / error))
    distance = (found.mean - truth.mean)[worst] / truth.sd[worst]
    z = (found.mean - truth.mean)[worst] / error[worst]
    verdict = (
        "cannot tell"
        if np.max(found.error / truth.sd) > 0.2
        else "right"
        if abs(z) < 3.5
        else "WRONG"
    )
    return (
        f"{found.ess / found.seconds:,.0f} | {found.ess:,.0f} | {found.seconds:.1f} | "
        f"{distance:+.3f} | {z:+.1f} | {verdict}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, nargs="+", default=[1, 4, 16, 64])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(
        "| N | parameters | method | effective draws/s | effective draws | s | distance "
        "(sd) | z | |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for n_run in options.runs:
        rng = np.random.default_rng([options.seed, n_run])
        with tempfile.TemporaryDirectory() as folder:
            fit = simulated_fit(n_run, rng, Path(folder))
        columns = [fit.names.index("gamma[b]"), fit.names.index("kappa[b]")]
        truth = reference(fit, columns, rng)
        methods: dict[str, Callable[[], Moments]] = {
            "marginal": lambda f=fit, c=columns, r=rng: by_marginal(f, c, r)
        }
        if n_run <= 16:
            methods["full sampler"] = lambda f=fit, c=columns, r=rng: by_full_sampler(
                f, c, r, options.seconds
            )
        methods["stretch"] = lambda f=fit, c=columns, r=rng: by_stretch(f, c, r, options.seconds)
        for name, run in methods.items():
            print(f"| {n_run} | {fit.problem.n_par} | {name} | {cells(run(), truth)} |", flush=True)


if __name__ == "__main__":
    main()
