"""Draws from a posterior by emcee.

Several independent ensembles of walkers start from the fit.  Sampling stops by itself when
rank-normalised R-hat between the ensembles, effective sample sizes in bulk and tails, and the
autocorrelation time all are good enough; a hard cap ends it otherwise, and the chain is
"not converged".

What is fixed about the diagnostics: walkers of one ensemble move by each other, so R-hat compares
ensembles, not walkers; effective sample sizes are those of all walkers as chains (emcee's own N/tau
flatters short chains).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.common import Finding, Kind, NumericalError, phrase
from estim.sampling.cholesky import lower_factor
from estim.sampling.diagnostics import Mixing, autocorrelation_time, mixing_of
from estim.sampling.importance import K_HAT_LIMIT, kish_ess, pareto_smoothed
from estim.sampling.independence_moves import STEPS_AHEAD, IndependenceMoves
from estim.sampling.log_density import Density, log_density_in_batches
from estim.sampling.proposal import Proposal
from estim.words import describe

_FIRST_CHECK = 60  # steps
# autocorrelation times: walkers that start from draws of the posterior have little to forget
_BURN, _BURN_BLIND = 5.0, 10.0
# of the moves: for a proposal whose weights are even, and for one that cannot be trusted
_PROPOSAL_SHARE, _LEAST_SHARE = 0.9, 0.1

Progress = Callable[[int, str], None]
"""Called with the share of the draws needed that there are, in per cent, and a few words on
what is being done or is still missing.
"""


@dataclass(frozen=True)
class Target:
    """When to stop.

    rhat : largest rank-normalised R-hat.
    ess : smallest bulk and tail effective sample size (4000 gives the ends of a 95 % interval to
        about 3 % of a standard deviation).  n_tau : length in autocorrelation times.
    max_step : hard cap on the steps of each ensemble.
    n_ensemble, n_walker : ensembles and walkers in each (0: two for each parameter, and as many as
        give `ess` in `n_tau`); an odd number gets one more.

    >>> from estim import Target, fit_curve, sample_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> analysis = sample_curve(fit, seed=1, target=Target(ess=400.0))  # quick and coarse
    >>> analysis.diagnosis.status
    'ok'
    """

    rhat: float = 1.01
    ess: float = 4000.0
    n_tau: float = 50.0
    max_step: int = 20_000
    n_ensemble: int = 4
    n_walker: int = 0


@dataclass(frozen=True, eq=False)
class Convergence:
    """The stopping criteria at one moment: worst values over the parameters.

    tau : longest autocorrelation time in steps.
    met : whether the draws are enough.
    findings : the criteria that are not met, or where the draws come from if not from a chain.
    """

    n_step: int
    rhat: float
    ess_bulk: float
    ess_tail: float
    tau: float
    met: bool
    findings: tuple[Finding, ...]

    @property
    def message(self) -> str:
        """The criteria that are not met, in words."""
        return "; ".join(map(describe, self.findings or (Finding(Kind.CRITERIA_MET),)))


@dataclass(frozen=True, eq=False)
class Chain:
    """Draws of a posterior.

    draws : (n_ensemble, n_step, n_walker, n_par) after burn-in.
    log_density : (n_ensemble, n_step, n_walker).
    n_burn : steps of warm-up, discarded.
    acceptance : (n_ensemble,) mean share of accepted moves; stuck : walkers that never moved.
    mixing : how well these draws mix, where that was computed already.
    """

    names: tuple[str, ...]
    draws: FloatArray
    log_density: FloatArray
    n_burn: int
    acceptance: FloatArray
    stuck: int
    convergence: Convergence
    mixing: Mixing | None = None

    @property
    def flat(self) -> FloatArray:
        """(n_draw, n_par) all draws."""
        return self.draws.reshape(-1, self.draws.shape[-1])

    def column(self, name: str) -> FloatArray:
        """(n_draw,) of one parameter."""
        return self.flat[:, self.names.index(name)]

    def thinned(self, n_draw: int) -> FloatArray:
        """(at most n_draw, n_par) draws, evenly spread over the chain."""
        rows = np.linspace(0, self.log_density.size - 1, n_draw).astype(np.int64)
        return self.flat[rows[np.diff(rows, prepend=-1) > 0]]


def sample_posterior(
    posterior: Density,
    start: FloatArray,
    cov: FloatArray,
    *,
    target: Target,
    rng: np.random.Generator,
    progress: Progress | None = None,
    proposal: Proposal | None = None,
) -> Chain:
    """Draws from `posterior`, which is about as high as the normal distribution of mean `start`
    (n_par,) and `cov`.

    Most moves propose from `proposal` (`estim.sampling.proposal`; a Student-t distribution of that
    mean and covariance if None), and walkers start from draws of it, weighted.  The others are
    differential evolution with its mode-jumping variant now and then, tested on known targets, so
    that a bad proposal costs time and not correctness; emcee's snooker move has a wrong acceptance
    factor (3.1.6) and is never used.

    target : when to stop (`estim.Target`).  rng : of every draw.  progress : called with the
        progress.

    Raises NumericalError where walkers find no place to start, or run away, so that there is no
    posterior.

    >>> import numpy as np
    >>> from estim import Target, fit_curve, sample_posterior
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> target, rng = Target(ess=400.0), np.random.default_rng(1)
    >>> start, cov = fit.fit.values, fit.fit.cov
    >>> chain = sample_posterior(fit.fit.posterior, start, cov, target=target, rng=rng)
    >>> chain.flat.shape[1]
    2
    """
    from estim.sampling.ensembles import EnsembleRun, sampler_of  # which imports emcee

    proposal = Proposal.single(start, cov) if proposal is None else proposal
    shape = (target.n_ensemble, _n_walker(len(posterior.names), target))
    starts, share = _first_points(posterior, start, cov, shape, rng, proposal)
    independence = IndependenceMoves(
        proposal, share, shape[0] * shape[1], int(rng.integers(2**63)), posterior
    )
    ensembles = EnsembleRun(
        sampler_of(posterior, shape, independence, seed=int(rng.integers(2**32))), starts
    )
    n_step, tau_before = min(_FIRST_CHECK, target.max_step), math.nan
    while True:
        ensembles.advance(n_step)
        draws = ensembles.draws
        tau = autocorrelation_time(draws)
        if math.isnan(tau_before):
            tau_before = autocorrelation_time(draws[:, : n_step // 2])
        long_enough = math.ceil(1.03 * target.n_tau * tau) if math.isfinite(tau) else 0
        if n_step < min(long_enough, 3 * _FIRST_CHECK, target.max_step):
            # too short whatever the other criteria are: continue at once to the required length
            next_step = long_enough
        else:
            n_burn = _warm_up_steps(n_step, tau, sure=share > _LEAST_SHARE)
            mixing = mixing_of(draws[:, n_burn:])
            convergence = _check_convergence(
                mixing, target, n_step=n_step, tau=tau, tau_before=tau_before
            )
            if progress is not None:
                message = (
                    phrase("sampling")
                    if convergence.met
                    else phrase("sampling: {message}", message=convergence.message)
                )
                progress(_percent(convergence, target), message)
            slow = _target_unreachable(mixing, target, posterior.names, n_step=n_step)
            if convergence.met or n_step >= target.max_step:
                break
            if slow:
                convergence = replace(convergence, findings=(*convergence.findings, *slow))
                break
            next_step = _next_check(convergence, target, n_burn, long_enough)
        # the moves of a block are evaluated together: it costs little to make all of them
        blocks = -(-next_step // STEPS_AHEAD)
        n_step, tau_before = min(target.max_step, blocks * STEPS_AHEAD), tau
    retained = draws[:, n_burn:]
    moved = np.any(retained[:, 1:] != retained[:, :-1], axis=(1, 3))
    acceptance = np.mean(ensembles.accepted, axis=1) / n_step
    return Chain(
        posterior.names,
        retained,
        ensembles.log_density[:, n_burn:],
        n_burn,
        acceptance,
        int(np.sum(~moved)),
        convergence,
        mixing,
    )


def _target_unreachable(
    mixing: Mixing, target: Target, names: Sequence[str], *, n_step: int
) -> list[Finding]:
    """That the cap will not be enough, with the parameters that keep it from being so: had their
    effective sizes grown with the length up to there, they would come to less than 0.7 of the
    target; or no walker has moved.
    """
    sizes = np.minimum(mixing.ess_bulk, mixing.ess_tail) * target.max_step / n_step
    still = np.isnan(mixing.rhat) & (target.n_ensemble > 1)
    wandering = np.flatnonzero(still | ~(sizes >= 0.7 * target.ess)).tolist()
    if n_step < 2000 or not wandering:
        return []
    slowest = tuple(names[i] for i in wandering)
    return [Finding(Kind.CHAIN_HOPELESS, names=slowest, numbers={"limit": target.max_step})]


def _n_walker(n_par: int, target: Target) -> int:
    """Walkers of an ensemble, an even number: as many as give enough draws in the length that is
    required anyway, half of which span all directions.
    """
    # effective draws that a walker gives in an autocorrelation time: tails are worth less than the
    # middle
    each = 0.65 * max(target.n_tau - _BURN, 1.0) * target.n_ensemble
    least = max(2 * n_par + 4, min(math.ceil(target.ess / each), 512))
    n_walker = target.n_walker or least
    return n_walker + n_walker % 2


def _warm_up_steps(n_step: int, tau: float, *, sure: bool) -> int:
    """Steps of warm-up (burn-in) to discard; fewer where the walkers started from draws of a
    proposal that can be trusted.
    """
    if not math.isfinite(tau):
        return n_step // 2
    needed = math.ceil(_BURN * tau) if sure else max(50, math.ceil(_BURN_BLIND * tau))
    return min(needed, n_step // 2)


def _next_check(convergence: Convergence, target: Target, n_burn: int, long_enough: int) -> int:
    """The length at which effective sizes that grow with it are large enough; a tenth more at
    least, half as much again at most.
    """
    n_step, least = convergence.n_step, min(convergence.ess_bulk, convergence.ess_tail)
    needed = n_burn + 1.05 * (n_step - n_burn) * target.ess / least if least > 0.0 else n_step
    return int(min(max(needed, long_enough, 1.1 * n_step), 1.5 * n_step))


def _first_points(
    posterior: Density,
    start: FloatArray,
    cov: FloatArray,
    shape: tuple[int, int],
    rng: np.random.Generator,
    proposal: Proposal,
) -> tuple[FloatArray, float]:
    """Starting points (n_ensemble, n_walker, n_par), and the share of moves that `proposal`
    deserves.

    shape : (n_ensemble, n_walker).  Points are weighted draws of the proposal, other ones for each
        ensemble, where its weights can be trusted, else scattered about the fit.  A proposal that
        is seldom accepted gets few of the moves.
    """
    n_ensemble, n_walker = shape
    n_draw = max(500, 20 * n_walker)
    draws = proposal.draw(rng, n_ensemble * n_draw)
    log_ratio = log_density_in_batches(posterior, draws) - proposal.log_density(draws)
    log_weights, k_hat, _ = pareto_smoothed(log_ratio)
    parts = np.split(np.exp(log_weights), n_ensemble)
    if k_hat <= K_HAT_LIMIT and min(np.count_nonzero(part) for part in parts) >= 2 * n_walker:
        # what lies beyond the support is drawn again
        efficiency = kish_ess(log_weights) / np.count_nonzero(np.isfinite(log_weights))
        chosen = [
            rng.choice(n_draw, n_walker, replace=False, p=part / np.sum(part)) for part in parts
        ]
        points = [
            part[which] for part, which in zip(np.split(draws, n_ensemble), chosen, strict=True)
        ]
        # effective share of its draws from which a proposal gets the full share of moves
        return np.array(points), _PROPOSAL_SHARE * min(1.0, efficiency / 0.4)
    return np.array(
        [_scatter(posterior, start, cov, n_walker, rng) for _ in range(n_ensemble)]
    ), _LEAST_SHARE


def _scatter(
    posterior: Density, start: FloatArray, cov: FloatArray, n_walker: int, rng: np.random.Generator
) -> FloatArray:
    """(n_walker, n_par) starting points, every one with a finite log density: a walker at -inf
    would never move.
    """
    factor = lower_factor(cov)
    points: list[FloatArray] = []
    shrink = 1.0
    for _ in range(200):
        proposal = start + shrink * rng.standard_normal((4 * n_walker, start.size)) @ factor.T
        points.extend(proposal[np.isfinite(posterior.log_density(proposal))])
        if len(points) >= n_walker:
            return np.array(points[:n_walker])
        shrink *= 0.9
    raise NumericalError(
        "sampling cannot start: the posterior density is zero or not finite everywhere "
        "around the fit"
    )


def _percent(convergence: Convergence, target: Target) -> int:
    """How much of the draws needed there is: by the criterion that is farthest from met, 100 where
    all are.
    """
    if convergence.met:
        return 100
    shares = (
        convergence.ess_bulk / target.ess,
        convergence.ess_tail / target.ess,
        convergence.n_step / (target.n_tau * convergence.tau),
    )
    least = min(shares) if all(map(math.isfinite, shares)) else 0.0
    return min(99, int(100.0 * least))


def _check_convergence(
    mixing: Mixing, target: Target, *, n_step: int, tau: float, tau_before: float
) -> Convergence:
    """The stopping criteria on draws that mix so."""
    rhat = float(np.max(mixing.rhat))
    bulk = float(np.min(mixing.ess_bulk))
    tail = float(np.min(mixing.ess_tail))
    criteria = (
        (rhat < target.rhat, Kind.RHAT_HIGH, rhat, {"limit": target.rhat}),
        (bulk >= target.ess, Kind.BULK_LOW, bulk, {"limit": target.ess}),
        (tail >= target.ess, Kind.TAIL_LOW, tail, {"limit": target.ess}),
        (
            n_step >= target.n_tau * tau,
            Kind.CHAIN_BRIEF,
            n_step,
            {"limit": target.n_tau, "tau": tau},
        ),
    )
    unmet = [
        Finding(kind, size=size, numbers=numbers)
        for met, kind, size, numbers in criteria
        if not met
    ]
    if not abs(tau - tau_before) < 0.1 * tau:
        unmet.append(Finding(Kind.TAU_UNSETTLED))
    return Convergence(n_step, rhat, bulk, tail, tau, not unmet, tuple(unmet))
