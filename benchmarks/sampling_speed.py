"""Effective draws per second of ways to compute one posterior; prints a Markdown table.

    OMP_NUM_THREADS=1 python benchmarks/sampling_speed.py [--seed 1] [--seconds 20]

The posterior: one run of a disk rolling up an incline, 4 unknowns (gamma, kappa, theta0, phi),
speeds by the central difference of positions with their exact covariance, exact radius; made here
with a fixed seed.  Effective draws are rank-normalised bulk sizes of the worst parameter
(arviz-stats) for every chain, those of the worst mean for importance sampling.  Times include
finding the proposal, burn-in and tests of convergence, not the least-squares fit and not imports.
Right: every mean and standard deviation within 4.5 Monte-Carlo standard errors of a reference of
500 000 weighted draws, from a proposal of its own; the largest deviation is shown in posterior sds.
Each chain of the plain samplers runs for about the given seconds.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.campaign import load_campaign
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.model import Body, trajectory
from estim.sampling.certificate import Certificate, certify
from estim.sampling.chain import Chain, Convergence, Target, sample_posterior
from estim.sampling.diagnostics import effective_size, mixing_of
from estim.sampling.proposal import adapt_proposal

FloatArray = NDArray[np.float64]

CAMPAIGN = """
title = "one run for timing"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
noise = {sigma_x_m = 0.001, derivative = "central"}
[bodies.heavy]
gamma = "0.187(10)"
kappa = {prior = "uniform", low = 0.0, high = 1.0}
[[runs]]
name = "one"
body = "heavy"
file = "one.csv"
phi_deg = "4.0(4)"
theta0_deg = "60.0(15)"
"""


class Row(NamedTuple):
    """One method: what it found and how long that took."""

    method: str
    seconds: float
    ess: float
    mean: FloatArray
    sd: FloatArray
    u_mean: FloatArray
    u_sd: FloatArray


def one_fit(rng: np.random.Generator) -> Fit:
    """The fit of the run."""
    t = np.linspace(0.0, 1.4, 46)
    x, _ = trajectory(
        t,
        Body(radius=0.15, gamma=0.187, kappa=0.45),
        phi=np.radians(4.0),
        theta0=np.radians(60.0),
        g=9.81,
    )
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            f"{a:.6f},{b:.6f}"
            for a, b in zip(t, np.ravel(x) + 0.001 * rng.standard_normal(t.size), strict=True)
        ]
        (Path(folder) / "one.csv").write_text("\n".join(["t_s,x_m", *rows]) + "\n")
        (Path(folder) / "campaign.toml").write_text(CAMPAIGN)
        return fit_least_squares(load_campaign(Path(folder) / "campaign.toml").problem(["one"]))


def from_certificate(method: str, seconds: float, found: Certificate) -> Row:
    ess = float(np.min((found.sd / found.mcse_mean) ** 2))
    return Row(method, seconds, ess, found.mean, found.sd, found.mcse_mean, found.mcse_sd)


def from_draws(method: str, seconds: float, names: tuple[str, ...], draws: FloatArray) -> Row:
    """draws : (n_ensemble, n_step, n_walker, n_par)."""
    convergence = Convergence(draws.shape[1], 1.0, 0.0, 0.0, 1.0, True, ())
    chain = Chain(
        names, draws, np.zeros(draws.shape[:-1]), 0, np.ones(draws.shape[0]), 0, convergence
    )
    deviation = draws - chain.flat.mean(axis=0)
    squares, spread = deviation**2, chain.flat.std(axis=0)
    of_squares = squares.std(axis=(0, 1, 2)) / np.sqrt(effective_size(squares))
    u_mean, u_sd = spread / np.sqrt(effective_size(draws)), of_squares / (2.0 * spread)
    return Row(
        method,
        seconds,
        float(np.min(mixing_of(draws).ess_bulk)),
        chain.flat.mean(axis=0),
        chain.flat.std(axis=0),
        u_mean,
        u_sd,
    )


def by_certificate(
    fit: Fit, rng: np.random.Generator, *, n_draw: int = 8000
) -> tuple[float, Certificate]:
    begin = time.perf_counter()
    found = certify(
        fit.posterior,
        adapt_proposal(fit.posterior, fit.values, fit.cov, rng=rng),
        rng=rng,
        n_draw=n_draw,
    )
    return time.perf_counter() - begin, found


def by_sampler(
    fit: Fit, rng: np.random.Generator, *, with_proposal: bool, ess: float
) -> tuple[float, Chain]:
    begin = time.perf_counter()
    proposal = (
        adapt_proposal(fit.posterior, fit.values, fit.cov, rng=rng) if with_proposal else None
    )
    chain = sample_posterior(
        fit.posterior, fit.values, fit.cov, target=Target(ess=ess), rng=rng, proposal=proposal
    )
    return time.perf_counter() - begin, chain


def by_stretch(
    fit: Fit, rng: np.random.Generator, *, vectorised: bool, seconds: float
) -> tuple[float, FloatArray]:
    """emcee as it comes: stretch moves, 32 walkers from the fit, the first fifth discarded."""
    import emcee

    density: Callable[[FloatArray], FloatArray] = fit.posterior.log_density
    function = density if vectorised else lambda values: float(density(values[None, :])[0])
    sampler = emcee.EnsembleSampler(32, len(fit.names), function, vectorize=vectorised)
    sampler.random_state = np.random.RandomState(rng.integers(2**32, dtype=np.uint32)).get_state()
    begin = time.perf_counter()
    state = rng.multivariate_normal(fit.values, fit.cov, 32)
    while time.perf_counter() - begin < seconds:
        state = sampler.run_mcmc(state, 100)
    elapsed = time.perf_counter() - begin
    return elapsed, sampler.get_chain(discard=sampler.iteration // 5)[None]


def by_lmfit(fit: Fit, *, n_step: int, seed: int) -> tuple[float, FloatArray]:
    """lmfit's emcee on the residuals of data and priors, 32 walkers, the first fifth discarded."""
    import lmfit

    table = lmfit.Parameters()
    for i, (value, parameter) in enumerate(zip(fit.values, fit.problem.parameters, strict=True)):
        table.add(f"p{i}", value=float(value), min=parameter.prior.low, max=parameter.prior.high)

    def residual(parameters: lmfit.Parameters) -> FloatArray:
        return fit.posterior.residuals(
            np.array([parameters[f"p{i}"].value for i in range(len(fit.names))])
        )

    start = np.random.default_rng(seed).multivariate_normal(fit.values, fit.cov, 32)
    fitter = lmfit.Minimizer(residual, table, nan_policy="omit")
    begin = time.perf_counter()
    fitter.emcee(
        nwalkers=32,
        steps=n_step,
        burn=0,
        pos=start,
        is_weighted=True,
        float_behavior="chi2",
        seed=seed,
        progress=False,
    )
    elapsed = time.perf_counter() - begin
    return elapsed, np.asarray(fitter.sampler.get_chain(discard=n_step // 5))[None]


def table(rows: list[Row], reference: Certificate) -> str:
    """The rows in Markdown, with the last one (lmfit's) as the unit of speed."""
    base = rows[-1].ess / rows[-1].seconds
    lines = [
        "| method | time (s) | effective draws | per second | ratio | right | largest "
        "deviation (sd) |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        shift, widening = row.mean - reference.mean, row.sd - reference.sd
        z = np.concatenate(
            [
                shift / np.hypot(row.u_mean, reference.mcse_mean),
                widening / np.hypot(row.u_sd, reference.mcse_sd),
            ]
        )
        right = "yes" if np.all(np.abs(z) < 4.5) else f"NO ({np.max(np.abs(z)):.1f} errors)"
        largest = float(
            np.max(np.abs(np.concatenate([shift, widening])) / np.tile(reference.sd, 2))
        )
        rate = row.ess / row.seconds
        lines.append(
            f"| {row.method} | {row.seconds:.3g} | {row.ess:.0f} | {rate:,.0f} | "
            f"{rate / base:,.0f} | {right} | {largest:.3f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="speed of samplers")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each plain sampler")
    chosen = parser.parse_args()
    fit = one_fit(np.random.default_rng(chosen.seed))
    rngs = [np.random.default_rng([chosen.seed, k]) for k in range(8)]
    _, reference = by_certificate(fit, rngs[0], n_draw=500_000)
    by_certificate(fit, rngs[1]), by_sampler(fit, rngs[1], with_proposal=True, ess=100.0)  # imports
    rows = [
        from_certificate("importance sampling, adapted proposal", *by_certificate(fit, rngs[2]))
    ]
    cases = [
        ("our sampler, adapted proposal", True, 4000.0),
        ("the same, 100 000 effective draws", True, 100_000.0),
    ]
    for method, with_proposal, ess in [
        *cases,
        ("our sampler, without the proposal", False, 4000.0),
    ]:
        seconds, chain = by_sampler(fit, rngs[3], with_proposal=with_proposal, ess=ess)
        rows.append(from_draws(method, seconds, fit.names, chain.draws))
    for method, vectorised in (
        ("emcee, stretch moves, vectorised", True),
        ("emcee, stretch moves, one point a call", False),
    ):
        elapsed, draws = by_stretch(fit, rngs[4], vectorised=vectorised, seconds=chosen.seconds)
        rows.append(from_draws(method, elapsed, fit.names, draws))
    trial, _ = by_lmfit(fit, n_step=20, seed=chosen.seed)
    elapsed, draws = by_lmfit(
        fit, n_step=max(200, int(20 * chosen.seconds / trial)), seed=chosen.seed
    )
    rows.append(from_draws("lmfit's Minimizer.emcee", elapsed, fit.names, draws))
    print(
        f"{len(fit.names)} parameters, {fit.problem.n_obs} speeds; k-hat of the reference "
        f"{reference.k_hat:.2f}\n"
    )
    print(table(rows, reference))


if __name__ == "__main__":
    main()
