"""How readings of single runs count in a joint fit: with the same room for every value of what the
runs share.

A tilt that was read as 6.4(4) deg, with a flat weight of all true tilts, is harmless in one run.
But data often fix an own parameter of a run in units of a shared one (a tilt only as a ratio to
gamma): the larger the shared one, the more room each own one has, and the density of what n runs
share is multiplied by that room n times.  It is pulled by sqrt(n) times what one run would do.
Readings therefore have the measure of Jeffreys, given what is shared: the density is divided by the
volume V of their distribution given the shared parameters s,

    m(s) = V(s_fit)/V(s)
    V^2 = product over runs of det (inverse of J^T J + priors)    rows and columns of the readings

the other parameters of the run integrated out.  The noise and spreads between runs are held: they
set the size of errors, and there it is flat weights that are right.  To first order log m is linear
about the fit; its curvature, some (u/reading)^2, does not grow with the number of runs.

Where the data of some runs are counts, the same holds for parameters of single runs that have no
stated prior (an amplitude of each run beside a common lifetime): their priors are flat.

One prior for all runs states how true values are distributed, and is integrated as it is.  Where
nothing is shared, m = 1.

Where what the runs share is sampled by itself, Jeffreys' prior of unstated parameters
(`estim.fitting.jeffreys`), which is a measure of the same parameters, is taken as linear too; the
weights of the draws make up for the difference.

Source: Neyman and Scott, Econometrica 16 (1948) 1 (many incidental parameters); Cox and Reid, J. R.
Stat. Soc. B 49 (1987) 1 and Berger, Liseo and Wolpert, Stat. Sci. 14 (1999) 1 (which of their
measures leaves the others alone).
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from estim.arrays import BoolArray, FloatArray, sds_of
from estim.common import split_level
from estim.fitting.fisher_information import information, on_limit
from estim.problem import JeffreysPrior, Measure, Posterior, uses_of

_INFLUENTIAL = 0.3  # standard deviations by which effects must move a spread to be reported


def measure_of(
    posterior: Posterior,
    values: FloatArray,
    cov: FloatArray,
    *,
    jeffreys: JeffreysPrior | None = None,
) -> Measure | None:
    """The measure about the fit `values` (n_par,) of covariance `cov`, together with `jeffreys`;
    None where there are neither incidental parameters nor that, or nothing is shared.
    """
    problem = posterior.problem
    uses, incidental = uses_of(problem.runs), problem.incidental
    shared = np.array(
        [i for i, p in enumerate(problem.parameters) if uses[p.name] > 1 and not p.between],
        dtype=np.int64,
    )
    if not (incidental or jeffreys) or not shared.size:
        return None
    low, high = problem.support()
    # what lies on a limit stays there
    still = on_limit(problem, values, information(posterior, values))
    still[shared] = False
    if still.any():
        cov = cov - cov[:, still] @ np.linalg.solve(cov[np.ix_(still, still)], cov[still])
    root = np.linalg.cholesky(cov[np.ix_(shared, shared)])
    of_noise = [
        i for i, p in enumerate(problem.parameters) if p.between or p.name in problem.noise_names
    ]
    # (n_par, n_shared): where all parameters follow one sd along each column of root
    along = np.linalg.solve(root, cov[shared]).T
    along[of_noise], along[still] = 0.0, 0.0
    steps = np.vstack([along.T, -along.T])
    # a step ends where it meets a limit; cut off in one parameter alone it would leave the ridge
    # along which the others follow
    limits = np.where(steps > 0.0, high, low)
    fractions = np.divide(limits - values, steps, out=np.ones_like(steps), where=steps != 0.0)
    tried = values + np.minimum(np.min(fractions, axis=1), 1.0)[:, None] * steps
    standardised = np.linalg.solve(root, (tried[:, shared] - values[shared]).T).T
    points = np.vstack([values, tried])
    rooms = np.zeros(len(points))
    if incidental:
        rooms += [_log_room(posterior, point, incidental) for point in points]
    if jeffreys is not None:
        rooms -= jeffreys.exact(problem.named(points))
    finite = np.isfinite(rooms[1:])
    slope = np.linalg.lstsq(standardised[finite], rooms[0] - rooms[1:][finite], rcond=None)[0]
    influence = np.max(np.abs(root @ slope) / np.linalg.norm(root, axis=1))
    return Measure(
        shared,
        values[shared],
        np.linalg.solve(root.T, slope),
        float(np.linalg.norm(slope)),
        float(influence),
    )


@np.errstate(all="ignore")  # at a limit a curve may have no slope: nothing is said of it
def spreads_and_effects(
    posterior: Posterior, values: FloatArray
) -> tuple[frozenset[str], frozenset[str]]:
    """Names of standard deviations between runs (or between groups of readings), and of the effects
    that these scale.

    In c + s z_r nothing depends on the spread s where all z_r are 0, and something does where one
    of them is not.  A coefficient that was measured, of one correction, is no spread.
    """
    problem = posterior.problem
    effect = np.array([name in problem.effects for name in problem.names])
    if not effect.any():
        return frozenset(), frozenset()

    def unseen_with(shifted: BoolArray) -> BoolArray:
        """(n_par,) what the data do not depend on, all effects being 0 but those `shifted`."""
        shifts = np.where(shifted, [p.prior.sd for p in problem.parameters], 0.0)
        shown = sum(posterior.informations(np.where(effect, shifts, values)))
        return np.diag(shown) == 0.0

    of_noise = [name in problem.noise_names for name in problem.names]
    spread = unseen_with(np.zeros_like(effect)) & ~effect & ~np.array(of_noise)
    if not spread.any():
        return frozenset(), frozenset()
    quantities = np.array([split_level(name)[0] for name in problem.names])
    scaled = np.zeros_like(effect)
    for quantity in dict.fromkeys(quantities[effect]):
        of_quantity = effect & (quantities == quantity)
        if not unseen_with(of_quantity)[spread].all():
            scaled |= of_quantity
    if np.count_nonzero(scaled) < 2 and all(
        p.prior.measured for p, found in zip(problem.parameters, spread, strict=True) if found
    ):
        return frozenset(), frozenset()
    spreads, effects = (
        frozenset(name for name, belongs in zip(problem.names, which, strict=True) if belongs)
        for which in (spread, scaled)
    )
    return spreads, effects


def moved_by_integration(
    posterior: Posterior, values: FloatArray, cov: FloatArray, spreads: Collection[str]
) -> dict[str, float]:
    """Spread -> by how many standard deviations it moves, to first order, where all other
    parameters are integrated out (Laplace's approximation) instead of being fitted too; those that
    hardly move left out.

    The density of a spread and of all its effects is highest where it is far too large, whatever
    the number of runs: the larger it is, the less the effects cost.
    """
    problem, sds = posterior.problem, sds_of(cov)
    low, high = problem.support()
    moves: dict[str, float] = {}
    for name in problem.names:
        if name not in spreads:
            continue
        i = problem.names.index(name)
        others = np.delete(np.arange(values.size), i)
        step = 0.1 * sds[i] * (np.arange(values.size) == i)
        ends = np.clip([values - step, values + step], low, high)
        with np.errstate(all="ignore"):  # nan at a limit where the curve has no slope
            below, above = (
                np.linalg.slogdet(
                    (sum(posterior.informations(end)) + problem.prior_information(end))[
                        np.ix_(others, others)
                    ]
                )[1]
                for end in ends
            )
            move = -0.5 * (above - below) * sds[i] / (ends[1, i] - ends[0, i])
        moves[name] = float(move)
    # nan of a spread at its limit, where nothing shows that it does not matter
    return {name: move for name, move in moves.items() if not abs(move) <= _INFLUENTIAL}


def _log_room(posterior: Posterior, values: FloatArray, incidental: frozenset[str]) -> float:
    """log V at `values` (n_par,)."""
    problem, named, room = posterior.problem, posterior.problem.named(values), 0.0
    uses, of_priors = uses_of(problem.runs), problem.prior_information(values)
    for likelihood, columns in zip(posterior.likelihoods, problem.columns, strict=True):
        indices = columns[[uses[problem.names[i]] == 1 for i in columns]]
        names = [problem.names[i] for i in indices]
        other = [name not in incidental for name in names]
        root = likelihood.whitened(named, names).root
        information = root.T @ root + of_priors[np.ix_(indices, indices)]
        room += 0.5 * float(
            np.linalg.slogdet(information[np.ix_(other, other)])[1]
            - np.linalg.slogdet(information)[1]
        )
    return room
