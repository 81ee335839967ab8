"""The samplers that `bench.py` compares, each from the same fit to effective draws, in a process of
its own.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

CAMPAIGN, RUN = HERE.parent / "data" / "replica" / "campaign.toml", "light-01"
ESS, SEED = 4000.0, 1
MOST_SECONDS = 300.0  # of a processor, after which a method is given up
_LIVE, _WALK, _MOST_CALLS, _RESAMPLED = 800, 80, 1_000_000, 100  # of dynesty

Measured = dict[str, Any]


def posed() -> Any:
    """The fit of the run."""
    from estim import load_campaign
    from estim.common import Stream, stream
    from estim.fitting import fit_problem

    campaign = load_campaign(CAMPAIGN)
    return fit_problem(campaign.problem([RUN]), rng=stream(SEED, Stream.FIT))


def described(draws: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Effective draws of the worst parameter, means, sds and their errors; draws (n_chain, n_step,
    n_par).
    """
    from arviz_stats.base import array_stats

    chains = [draws[:, :, i] for i in range(draws.shape[2])]
    ess = min(float(array_stats.ess(c, chain_axis=0, draw_axis=1, method="bulk")) for c in chains)
    errors = [
        [float(array_stats.mcse(c, chain_axis=0, draw_axis=1, method=m)) for c in chains]
        for m in ("mean", "sd")
    ]
    flat = draws.reshape(-1, draws.shape[2])
    return ess, flat.mean(axis=0), flat.std(axis=0), np.array(errors[0]), np.array(errors[1])


def nested(
    results: Any, rng: np.random.Generator
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same of a nested run.  Errors from runs resampled by their live points: the weights alone
    do not know how the volume shrank.
    """
    from dynesty.utils import resample_run

    mean, sd = _moments(results)
    again = np.array([_moments(resample_run(results, rstate=rng)) for _ in range(_RESAMPLED)])
    u_mean, u_sd = again.std(axis=0, ddof=1)
    return float(np.min((sd / u_mean) ** 2)), mean, sd, u_mean, u_sd


def _moments(results: Any) -> tuple[np.ndarray, np.ndarray]:
    w = np.exp(results.logwt - np.max(results.logwt))
    w /= w.sum()
    mean = w @ results.samples
    return mean, np.sqrt(w @ (results.samples - mean) ** 2)


def by_estim(fit: Any, _: float) -> tuple[Any, ...]:
    from estim.pipeline import analyse_fit
    from estim.sampling import Target

    analysis = analyse_fit(fit, seed=SEED, target=Target(ess=ESS))
    chain = analysis.chain
    draws = np.moveaxis(chain.draws, 1, 2)
    return described(draws.reshape(-1, *draws.shape[2:]))


def by_emcee(
    fit: Any, most: float, *, wanted: float = ESS, seed: int = SEED, n: int = 64, moves: Any = None
) -> tuple[Any, ...]:
    import emcee

    rng = np.random.default_rng(seed)
    sampler = emcee.EnsembleSampler(
        n, len(fit.names), fit.posterior.log_density, vectorize=True, moves=moves
    )
    sampler.random_state = np.random.RandomState(seed).get_state()
    state, began, steps = scattered(fit, n, rng), time.process_time(), 1000
    while True:
        state = sampler.run_mcmc(state, steps)
        kept = sampler.get_chain()[sampler.iteration // 5 :]
        found = described(np.swapaxes(kept, 0, 1))
        if found[0] >= wanted or time.process_time() - began > most:
            return found
        steps = (
            int(min(4.0, 1.1 * wanted / max(found[0], 1.0)) * sampler.iteration)
            - sampler.iteration
            + 200
        )


def by_differences(fit: Any, most: float) -> tuple[Any, ...]:
    """emcee's moves by differential evolution, as its documentation mixes them."""
    from emcee.moves import DEMove, DESnookerMove

    return by_emcee(fit, most, n=128, moves=[(DEMove(), 0.8), (DESnookerMove(), 0.2)])


def by_lmfit(fit: Any, most: float) -> tuple[Any, ...]:
    import lmfit

    table = lmfit.Parameters()
    for i, parameter in enumerate(fit.problem.parameters):
        prior = parameter.prior
        value = min(max(float(fit.values[i]), prior.low + 1e-9), prior.high - 1e-9)
        table.add(f"p{i}", value=value, min=prior.low, max=prior.high)

    def density(parameters: Any) -> float:
        return float(
            fit.posterior.log_density(np.array([[p.value for p in parameters.values()]]))[0]
        )

    rng, n = np.random.default_rng(SEED), 64
    fitter = lmfit.Minimizer(density, table, nan_policy="omit")
    position, began, steps, done = scattered(fit, n, rng), time.process_time(), 400, 0
    while True:
        result = fitter.emcee(
            table,
            steps=steps,
            nwalkers=n,
            burn=0,
            pos=position if done == 0 else None,
            reuse_sampler=done > 0,
            float_behavior="posterior",
            progress=False,
            is_weighted=True,
            seed=SEED,
        )
        chain = result.chain
        done = chain.shape[0]
        found = described(np.swapaxes(chain[done // 5 :], 0, 1))
        used = time.process_time() - began
        if found[0] >= ESS or used > most:
            return found
        steps = max(
            200, int(min(2.0, 1.1 * ESS / max(found[0], 1.0) - 1.0, (most - used) / used) * done)
        )


def by_dynesty(fit: Any, _: float) -> tuple[Any, ...]:
    import dynesty

    rng = np.random.default_rng(SEED)
    grids = []
    for parameter in fit.problem.parameters:  # the quantiles of each prior, by a table
        draws = np.sort(parameter.prior.draw(np.random.default_rng(0), 1_000_001))
        grids.append(draws)
    at = np.linspace(0.0, 1.0, 1_000_001)

    def likelihood(values: np.ndarray) -> float:
        found = float(fit.posterior.log_likelihood(values[None, :])[0])
        return found if math.isfinite(found) else -1e300

    def of_cube(u: np.ndarray) -> np.ndarray:
        return np.array([np.interp(a, at, g) for a, g in zip(u, grids, strict=True)])

    # uniform proposals, its choice in six dimensions, accept one point in a hundred along the
    # ridge; its 26 steps of a walk are too few there
    sampler = dynesty.NestedSampler(
        likelihood, of_cube, len(grids), nlive=_LIVE, sample="rwalk", walks=_WALK, rstate=rng
    )
    sampler.run_nested(print_progress=False, dlogz=0.1, maxcall=_MOST_CALLS)
    return nested(sampler.results, rng)


def by_bumps(fit: Any, _: float) -> tuple[Any, ...]:
    from bumps.fitters import fit as run
    from bumps.names import FitProblem
    from bumps.pdfwrapper import VectorPDF

    def minus(p: np.ndarray) -> float:
        found = float(fit.posterior.log_density(np.asarray(p)[None, :])[0])
        return -found if math.isfinite(found) else 1e300

    scale = np.sqrt(np.diag(fit.cov))
    model = VectorPDF(
        lambda z: minus(fit.values + scale * z), p=np.zeros(len(scale)), dof=len(scale)
    )
    for parameter, prior, value, s in zip(
        model.parameters().values() if isinstance(model.parameters(), dict) else model.parameters(),
        [p.prior for p in fit.problem.parameters],
        fit.values,
        scale,
        strict=True,
    ):
        parameter.range(max((prior.low - value) / s, -12.0), min((prior.high - value) / s, 12.0))
    result = run(FitProblem(model), method="dream", samples=60_000, burn=300, pop=10, verbose=False)
    _, points, _ = result.state.chains()
    draws = np.swapaxes(np.asarray(points), 0, 1)
    return described(fit.values + scale * draws)


def by_pymc(ready: Any, _: float) -> tuple[Any, ...]:
    from bench_pymc import draws_of

    fit, compiled = ready
    return described(draws_of(compiled, fit.names))


def for_pymc(fit: Any) -> Any:
    from bench_pymc import compiled

    return fit, compiled(fit)


def scattered(fit: Any, n: int, rng: np.random.Generator) -> np.ndarray:
    """(n, n_par) walkers about the fit where the density is finite."""
    points = rng.multivariate_normal(fit.values, fit.cov, size=50 * n)
    return np.asarray(points[np.isfinite(fit.posterior.log_density(points))][:n])


METHODS: dict[str, Callable[[Any, float], tuple[Any, ...]]] = {
    "estim": by_estim,
    "emcee": by_emcee,
    "emcee-de": by_differences,
    "lmfit": by_lmfit,
    "dynesty": by_dynesty,
    "bumps": by_bumps,
    "pymc": by_pymc,
}
# what a method makes of the fit once, however many draws are wanted
PREPARED: dict[str, Callable[[Any], Any]] = {"pymc": for_pymc}


def one(name: str) -> Measured:
    """What a method finds, in this process."""
    fit = PREPARED.get(name, lambda same: same)(posed())
    began, cpu = time.perf_counter(), time.process_time()
    ess, mean, sd, u_mean, u_sd = METHODS[name](fit, MOST_SECONDS)
    sampling, cpu = time.perf_counter() - began, time.process_time() - cpu
    return {
        "ess": ess,
        "mean": list(mean),
        "sd": list(sd),
        "u_mean": list(u_mean),
        "u_sd": list(u_sd),
        "sampling": sampling,
        "sampling_cpu": cpu,
    }
