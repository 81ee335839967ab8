"""The posterior mode of a problem, whatever its curves may lack: the stage between a problem and
its posterior.

A body's curve is searched from the centre of its priors, one of the user's own from afar
(`estim.fitting.optimum`); then comes what the curves may lack, if anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from estim.arrays import FloatArray, finite_or
from estim.common import InputError, Kind, NumericalError, at_commands
from estim.fitting.discrepancy_fit import fit_discrepancy
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.optimum import MAX_PARAMETERS, fit_optimum, is_resolved, scanned_fit
from estim.fitting.unconstrained import no_scatter, silent_parameters
from estim.fitting.unmodelled_force import fit_with_forces
from estim.problem import Observations, Posterior, Problem, Unstated

_FAR = 5.0  # times as far from the median as any other reading
_DRAWN = 64  # starts, where that at the centre of the priors leads nowhere


def fit_problem(
    problem: Problem, *, rng: np.random.Generator, near: FloatArray | None = None
) -> Fit:
    """The posterior mode of a problem of a campaign; near : (n_par,) the only place to look for it,
    where that is known.

    Raises InputError, with a parameter or the key of a campaign as its field, where the data
    determine none.
    """
    with blunder_named(problem):
        fit = (
            fit_white(problem, rng=rng) if near is None else fit_least_squares(problem, start=near)
        )
        if any(run.motion is None for run in problem.runs):
            _require_scatter(fit)
            _require_determined(fit)
    if any(run.lacks is not None for run in problem.runs):
        return fit_discrepancy(fit)
    if any(run.force for run in problem.runs):
        return fit_with_forces(fit, rng=rng, scanned=near is None)
    return fit


def fit_white(problem: Problem, *, rng: np.random.Generator) -> Fit:
    """The mode with the stated noise alone."""
    if any(run.motion is None for run in problem.runs):
        return fit_optimum(problem, rng=rng)
    try:
        fit = fit_least_squares(problem)
    except NumericalError:
        fit = fit_least_squares(problem, start=_drawn_start(problem, rng))
    # where the body does not move nothing is determined; what is an outlier depends on the fit; and
    # many parameters are not scanned
    if fit.singular or problem.robust or problem.n_par > MAX_PARAMETERS:
        with suppress(NumericalError):
            further = fit_least_squares(problem, start=_drawn_start(problem, rng, fit.posterior))
            fit = max(fit, further, key=lambda end: end.posterior.height(end.values))
    return scanned_fit(fit, rng=rng)


def _drawn_start(
    problem: Problem, rng: np.random.Generator, posterior: Posterior | None = None
) -> FloatArray:
    """(n_par,) the best of many draws of the priors: by `posterior`, or each by that linearised
    about it.
    """
    draws = np.array([problem.prior_draw(rng) for _ in range(_DRAWN)])
    heights = (
        np.array([problem.linearised(draw).height(draw) for draw in draws])
        if posterior is None
        else posterior.log_density(draws)
    )
    return np.asarray(draws[np.argmax(finite_or(heights, -math.inf))])


@contextmanager
def blunder_named(problem: Problem) -> Iterator[None]:
    """While a problem is fit: a reading far from all others, and abscissas far from 0, are named in
    the error that they may have caused.
    """
    try:
        yield
    except (InputError, NumericalError) as error:
        rule = error.rule + "".join(map(_far_off, problem.runs))
        rule += "" if "x - x0" in rule else "".join([*map(_far_from_zero, problem.runs)][:1])
        if rule == error.rule:
            raise
        if isinstance(error, NumericalError):
            raise NumericalError(rule, at=error.at) from None
        raise InputError(rule, field=error.field, value=error.value) from None


def _far_off(run: Observations) -> str:
    """What to do about the reading of a curve that lies far from all others; "" where none does, or
    the noise has room for it.
    """
    deviations = np.abs(run.y - np.median(run.y))
    i = int(np.argmax(deviations))
    if (
        run.motion
        or run.noise.robust
        or run.noise.counted
        or deviations[i] <= _FAR * np.sort(deviations)[-2:][0]
    ):
        return ""
    choice = "robust: mixture" if at_commands() else 'robust="mixture"'
    return (
        f"; {run.y[i]:.4g} at x = {run.x[i]:.4g} lies far from all other readings: if it may be a "
        f"blunder, correct it or allow for outliers ({choice})"
    )


def _far_from_zero(run: Observations) -> str:
    """What to do about x that hardly differ beside their size, as times since 1970; "" where they
    do.
    """
    low, high = float(np.min(run.x)), float(np.max(run.x))
    if run.motion or not 0.0 < high - low < 0.01 * min(abs(low), abs(high)):
        return ""
    return (
        f"; all x lie far from 0, at {low:.10g} to {high:.10g}: count them from one of them, as "
        f"x {'-' if low > 0.0 else '+'} {abs(low):.10g} in the formula"
    )


def _require_scatter(fit: Fit) -> None:
    """Raises InputError where nothing is stated of the size of the errors, and the residuals are
    zero.
    """
    for run in fit.problem.runs:
        if _unstated(run, fit.problem) and no_scatter(run, fit):
            raise InputError(
                f"must be stated: the curve meets every point of run '{run.name}', so "
                "nothing shows their errors (were the data computed?)",
                field="u_y",
            )


def _unstated(run: Observations, problem: Problem) -> bool:
    if run.lacks is not None:
        return not run.lacks.stated
    priors = {p.name: p.prior for p in problem.parameters}
    return any(isinstance(priors[name], Unstated) for name in run.noise.parameters)


def _require_determined(fit: Fit) -> None:
    """Raises InputError where neither the data nor a prior hold a parameter."""
    if fit.unheld is not None and fit.unheld.kind is Kind.STEPS_OPEN:
        raise InputError(
            "is known to several steps of "
            f"{fit.unheld.size:.4g} at best, after each of which the curve is the same: give it a "
            "start near the data, where its uncertainty is smallest",
            field=fit.unheld.parameters[0].name,
        )
    if fit.unheld is not None:
        raise InputError(
            "is hardly constrained by the data: far from here minus twice the log of "
            "the posterior density is only "
            f"{fit.unheld.size:.1f} above its minimum, which excludes no value however far; "
            "give it limits (low and high), or a prior, or leave out the term that the data do "
            "not show",
            field=fit.unheld.parameters[0].name,
        )
    flat = [p.name for p in fit.problem.parameters if not math.isfinite(p.prior.sd)]
    # not the standard deviations, which a parameter beside a limit does not have
    curvature = fit.scale
    determined = np.isfinite(curvature) & (curvature > 0.0) & (not fit.singular)
    unheld = [
        name
        for name, known in zip(fit.names, determined, strict=True)
        if name in flat and not known
    ]
    if not unheld:
        return
    if is_resolved(fit):
        raise InputError(
            "has terms that all but cancel at these x: rounding errors leave too few "
            "digits to draw from the posterior; "
            "write it in x - x0, with x0 in the middle of the data",
            field="expression",
        )
    silent = silent_parameters(fit)
    loose = [name for name in silent if name in flat]
    if silent and not loose:  # held by their limits, which is found of them by name
        return
    first, *others = loose or unheld
    start_stated = any(p.name in flat and p.prior.start_stated for p in fit.problem.parameters)
    far = "; if a start that was stated is far off, give another" if start_stated else ""
    if not others:
        raise InputError(
            f"is not determined by the data: give it limits (low and high), or a prior{far}",
            field=first,
        )
    together = " and ".join(f"'{other}'" for other in others)
    raise InputError(
        f"is not determined by the data, nor is {together}, only a combination of them: "
        f"give one a value, limits (low and high), or a prior{far}",
        field=first,
    )
