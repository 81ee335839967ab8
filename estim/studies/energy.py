"""The energy along a measured run: is it conserved, and if not, how fast is it lost?

The speeds are those of the fit, freed of the truncation of their stencil.  The parameters (gamma,
kappa, tilt, angle of release, rolling resistance) are drawn from the posterior of the phase-curve
fit, which has the same data.  So the energies show what that fit makes of the loss: if the data do
not narrow the rolling resistance, the loss is its prior over again, and if the fit holds it fixed,
the energies can only agree with that.  `Drift` shows which of these is the case, and tests for a
loss properly: how much better do the data fit when energy may be lost?

Errors of positions and speeds enter together: a position error moves the potential energy, and
through the stencil the kinetic energy of its neighbours.  First order, taken at the speeds of the
curve (at the noisy speeds, weights and errors would be correlated and the loss biased); the bias +D
var(v)/2 of the square of a noisy speed is removed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray, Named, all_finite
from estim.common import Quantity, Status
from estim.distributions import chi2_tail
from estim.fitting import Fit, fit_least_squares
from estim.pipeline import Analysis
from estim.problem import Observations, Problem, Uniform

LOSS = "rolling_resistance"  # the argument of a curve through which energy is lost
DETERMINED = 0.7  # of the prior sd: a posterior wider than this is mostly prior
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class EnergyRecord:
    """Energies of one run, J/kg (per unit mass), all arrays (n_obs,).

    x, v, u_v : position (m) and speed (m/s) of the axle, also for a run measured in radians.
    kinetic, potential, total : at the posterior mode of the parameters; u_total the standard
        uncertainty of the last.
    relative : (E - E0)/E0 as in the paper, E0 the energy `start` at release; it depends on where V
        is zero.
    mean_*, extreme_* : average over the run, and the value where it is largest in size; of
        *_to_kinetic, (E - E0)/(largest kinetic energy), which does not.
    loss : energy lost per metre, J/(kg m); loss_interval : of 95 %.
    loss_force : the same as a force in N, nan where the mass is unknown.
    """

    run: str
    t: FloatArray | None
    x: FloatArray
    v: FloatArray
    u_v: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    total: FloatArray
    u_total: FloatArray
    start: Quantity
    relative: FloatArray
    u_relative: FloatArray
    mean_relative: Quantity
    extreme_relative: Quantity
    mean_to_kinetic: Quantity
    extreme_to_kinetic: Quantity
    loss: Quantity
    loss_interval: tuple[float, float]
    loss_force: Quantity


@dataclass(frozen=True)
class Drift:
    """Whether a fit shows that energy is lost.

    free : whether the rolling resistance was a parameter at all.
    narrowing : its posterior sd / its prior sd; nan where it was not free.
    gain : fall of chi2 when a loss is allowed (flat prior, not negative) instead of none.
    p_value : probability of such a gain or more if no energy were lost: half a chi-square of one
        degree of freedom.
    limit : the rolling resistance is at most this with probability 95 % (of several the largest);
        nan where it was not free.
    """

    free: bool
    narrowing: float
    gain: float
    p_value: float
    limit: float

    @property
    def seen(self) -> bool:
        """Whether the data show that energy is lost, and how much."""
        return self.determined and self.p_value < 0.05

    @property
    def determined(self) -> bool:
        """Whether the data, and not the prior, determine how much energy is lost."""
        return self.free and self.narrowing < DETERMINED


def energy_status(analysis: Analysis, drift: Drift) -> Status:
    """The status of the results on the energy: that of the fit, and not ok where the prior
    determines how much is lost, not the data.
    """
    return (
        Status.NOT_IDENTIFIED
        if analysis.diagnosis.ok and not drift.determined
        else analysis.diagnosis.status
    )


def drift_of(analysis: Analysis) -> Drift:
    """The test for a loss of energy in all runs of an analysis together."""
    problem = analysis.problem
    losses = [i for i, p in enumerate(problem.parameters) if p.name.partition("[")[0] == LOSS]
    if not losses:
        return Drift(False, math.nan, math.nan, math.nan, math.nan)
    sds = analysis.chain.flat.std(axis=0)
    narrowing = float(np.mean([sds[i] / problem.parameters[i].prior.sd for i in losses]))
    names = {problem.parameters[i].name for i in losses}
    free = problem.with_priors(dict.fromkeys(names, Uniform(0.0, 1.0)))
    lossless_runs = tuple(
        replace(
            run,
            arguments={
                a: 0.0 if source in names else source for a, source in run.arguments.items()
            },
        )
        for run in problem.runs
    )
    lossless = Problem(
        tuple(p for p in problem.parameters if p.name not in names), lossless_runs, problem.shared
    )
    # the flat prior on [0, 1] has log density 0
    others = [i for i in range(problem.n_par) if i not in losses]
    with_loss = fit_least_squares(free, start=analysis.fit.values)
    without = fit_least_squares(lossless, start=analysis.fit.values[others])
    gain = 2.0 * (_best(with_loss) - _best(without))
    limit = float(np.max(np.quantile(analysis.chain.flat[:, losses], 0.95, axis=0)))
    return Drift(
        True, narrowing, gain, 0.5 * float(chi2_tail(gain, 1)) if gain > 0.0 else 1.0, limit
    )


def _best(fit: Fit) -> float:
    return fit.posterior.height(fit.values)


def energy_along(
    analysis: Analysis, *, rng: np.random.Generator, n_draw: int = 4000
) -> tuple[EnergyRecord, ...]:
    """One EnergyRecord for each run of a fit.

    analysis : of runs of a rolling body.  n_draw : draws of its posterior that are used.

    >>> import numpy as np
    >>> from estim import Target, analyse, energy_along, load_campaign
    >>> campaign = load_campaign("data/replica/campaign.toml", only="heavy-04")
    >>> analysis = analyse(campaign, ["heavy-04"], seed=1, target=Target(ess=400.0))
    >>> (energy,) = energy_along(analysis, rng=np.random.default_rng(1), n_draw=200)
    >>> energy.run
    'heavy-04'
    """
    draws, posterior = analysis.chain.thinned(n_draw), analysis.fit.posterior
    speeds = posterior.by_run(likelihood.y for likelihood in posterior.likelihoods)
    return tuple(
        _record(analysis, run, v, draws, rng)
        for run, v in zip(analysis.problem.runs, speeds, strict=True)
    )


def _record(
    analysis: Analysis,
    run: Observations,
    v: FloatArray,
    draws: FloatArray,
    rng: np.random.Generator,
) -> EnergyRecord:
    """v : (n_obs,) speeds, freed of the truncation of their stencil."""
    problem = analysis.problem
    # the mode, not the mean: on a bent ridge the mean of the draws need not fit the data
    centre = problem.named(analysis.fit.values)
    at_mode, at_draws = run.bind(centre), run.bind(problem.named(draws))
    noise, u_v, bias = _noise(run, run.drawn(centre), centre)

    def energies(arguments: Named) -> tuple[FloatArray, FloatArray]:
        kinetic, potential = run.body.energies(run.x, v, arguments)
        return np.atleast_2d(kinetic) - bias, np.atleast_2d(potential)

    kinetic, potential = (e[0] for e in energies(at_mode))
    drawn_kinetic, drawn_potential = energies(at_draws)
    errors = rng.multivariate_normal(np.zeros(run.n_obs), noise, size=draws.shape[0], method="eigh")
    measured = drawn_kinetic + drawn_potential + errors
    release = run.body.energies(np.zeros(1), np.zeros(1), at_draws)[1]
    start = np.ravel(np.broadcast_to(release, (draws.shape[0], 1)))
    largest = np.max(drawn_kinetic, axis=1)
    relative, to_kinetic = (
        (measured - start[:, None]) / scale[:, None] for scale in (start, largest)
    )
    metres = float(np.ravel(run.body.metres(at_mode))[0])
    to_line = _line_estimator(metres * run.x, noise)
    loss = -(measured @ to_line[1])
    low, high = np.quantile(loss, [0.025, 0.975]) if all_finite(loss) else (math.nan, math.nan)
    mass = math.nan if run.body.mass is None else run.body.mass
    return EnergyRecord(
        run=run.name,
        t=run.t,
        x=metres * run.x,
        v=metres * v,
        u_v=metres * u_v,
        kinetic=kinetic,
        potential=potential,
        total=kinetic + potential,
        u_total=measured.std(axis=0),
        start=Quantity.of(start),
        relative=relative.mean(axis=0),
        u_relative=relative.std(axis=0),
        mean_relative=Quantity.of(relative.mean(axis=1)),
        extreme_relative=_extreme(relative),
        mean_to_kinetic=Quantity.of(to_kinetic.mean(axis=1)),
        extreme_to_kinetic=_extreme(to_kinetic),
        loss=Quantity.of(loss),
        loss_interval=(float(low), float(high)),
        loss_force=Quantity.of(loss * mass),
    )


def _noise(
    run: Observations, v: FloatArray, values: Named
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """From reading errors: covariance (n_obs, n_obs) of the total energy; u of the speeds, and the
    bias of the kinetic energy (n_obs,) each.
    """
    arguments = run.bind(values)
    by_x = _difference(lambda h: _total(run, run.x + h, v, arguments))
    by_v = _difference(lambda h: _total(run, run.x, v + h, arguments))
    cov, var_speed = run.noise.carried(by_x, by_v, values)
    inertia = np.divide(by_v, v, out=np.zeros_like(v), where=v != 0.0)  # T = D v^2/2
    return cov, np.sqrt(var_speed), 0.5 * inertia * var_speed


def _total(run: Observations, x: FloatArray, v: FloatArray, arguments: Named) -> FloatArray:
    kinetic, potential = run.body.energies(x, v, arguments)
    return np.ravel(kinetic + potential)


def _difference(energy: Callable[[float], FloatArray]) -> FloatArray:
    return (energy(_STEP) - energy(-_STEP)) / (2.0 * _STEP)


def _line_estimator(x: FloatArray, cov: FloatArray) -> FloatArray:
    """(2, n_obs) that makes intercept and slope of the best straight line out of energies of
    covariance `cov`; nan where they hold none.
    """
    design = np.column_stack([np.ones_like(x), x])
    weighted = design.T @ np.linalg.pinv(cov, hermitian=True)
    normal = weighted @ design
    # the curve has come to rest before the second frame
    if np.linalg.matrix_rank(normal, hermitian=True) < 2:
        return np.full(weighted.shape, math.nan)
    return np.linalg.solve(normal, weighted)


def _extreme(values: FloatArray) -> Quantity:
    """The frame whose mean value (n_draw, n_obs) is largest in size; of all frames the largest is
    an outlier on purpose.
    """
    return Quantity.of(values[:, int(np.argmax(np.abs(values.mean(axis=0))))])
