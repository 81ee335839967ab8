"""Intervals of a fitted curve's parameters that hold their level.

- Where the size of the errors was stated: value ± z s, with z of the normal distribution.
- Where it was estimated from the residuals: value ± t s with Student's t.  For one degree of
  freedom value ± s holds the true value in 50 % of all experiments, and ± 1.82 s in 68 %.  A prior
  shares the work with the data, so that s is known better than from them alone: the degrees of
  freedom are dof/share^2 where `share` of s^2 is proportional to the estimated variance
  (Welch-Satterthwaite, JCGM 100:2008, G.4.1).
- Where that size is one of the parameters (a jitter, `sigma_y` of robust errors): profiles, with
  Student's t too; for a line they are the same as those above.
- Where y was counted, or its errors are a share of the curve: profiles, with z of the normal
  distribution.  Few events or a large share make them lopsided, even for a line.
- Where the curve bends within the errors of a parameter: its profile, with the same quantiles.
  What value ± 1.96 s leaves out lies on one side: of right fits 89 to 93 % held the true constant
  of saturations with errors of 4 to 8 %, profiles 94 to 97 %.
- Where an edge (of bounds or of a prior) is within reach of any interval: profiles
  (`estim.fitting.profile`) with the same quantiles.  An interval then ends at the edge.  A side
  without an edge that nothing closes has no end, and the parameter no interval: a flat prior leaves
  the posterior improper (`estim.fitting.unbounded_sides`).  The quantile stays the two-sided one
  there, so that intervals have at least their stated coverage wherever the truth lies (a one-sided
  one beside edges only would cover less: Feldman and Cousins, Phys. Rev. D 57 (1998) 3873).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, positive_or, sds_of
from estim.common import (
    PROBABILITIES,
    Amount,
    Finding,
    Kind,
    format_quantity,
    format_rounded,
    phrase,
)
from estim.distributions import student_quantile, student_tail
from estim.fitting.degrees_of_freedom import ErrorSizes, fixed_size
from estim.fitting.derived import LOPSIDED
from estim.fitting.least_squares import Fit
from estim.fitting.optimum import Optimum
from estim.fitting.prior_limits import edge_of
from estim.fitting.profile import profile_intervals
from estim.fitting.unbounded_sides import bending, open_side_finding, vague
from estim.problem import Observations

Ends = Mapping[float, tuple[float, float]]

# standard deviations by which the curve bends within one: an end of its profile may then differ
# from value ± 1.96 s by a fifth of s
_CURVED = 0.1
_THERE = 1e-5  # of an interval: so near a limit a value is at it
_WIDEST = PROBABILITIES[-1]
FEW = 10  # degrees of freedom up to which value ± s is not shown: it would hold less than 66 %


@dataclass(frozen=True, eq=False)
class FitUncertainty:
    """How far the values of a fit may be off: covariance, standard deviations (n_par,), intervals,
    and why some are missing.

    open : the parameters that nothing holds on a side.
    """

    cov: FloatArray
    sds: FloatArray
    intervals: Mapping[str, Ends]
    notes: tuple[Finding, ...]
    open: tuple[Finding, ...]


def spread(fixed: Fit, best: Optimum, *, dof: float, scale: float, unknown: bool) -> FitUncertainty:
    """fixed : the fit with errors of a fixed size.  scale : of its covariance.  unknown : whether
    nothing determines that size.
    """
    cov, names, nothing = best.cov * scale**2, fixed.names, (math.nan, math.nan)
    missing = {name: dict.fromkeys(PROBABILITIES, nothing) for name in names}
    if best.singular:
        return FitUncertainty(cov, np.full(len(names), np.nan), missing, (), ())
    if unknown:
        return FitUncertainty(
            np.full_like(cov, np.nan),
            np.full(len(names), np.nan),
            missing,
            (Finding(Kind.NO_SCATTER),),
            (),
        )
    sds = np.where(best.at_bound, np.nan, sds_of(cov))
    informed = fixed.problem.prior_information(best.values)
    dofs = (
        _degrees_of_freedom(cov, informed, dof)
        if math.isfinite(dof)
        else np.full(len(names), np.inf)
    )
    ended = any(_at_end(run, fixed) for run in fixed.problem.runs)
    noises = [run.noise for run in fixed.problem.runs]
    skewed = fixed.problem.counted or any(
        noise.share or noise.sides is not None for noise in noises
    )
    # an edge lies inside their 95 % intervals
    half = _quantile(_WIDEST, dofs) * np.where(best.at_bound, fixed.scale, sds_of(cov))
    near_edge = fixed.problem.room(fixed.values) < half
    symmetric = _symmetric(names, best.values, sds, dofs)
    bent = vague(fixed, sds)
    curved = bent | (bending(fixed) >= _CURVED)
    if not (np.any(near_edge) or skewed or np.any(curved)):
        return FitUncertainty(cov, sds, symmetric, (), ())
    everything = skewed or bool(np.any(near_edge))
    selected = np.ones_like(curved) if everything or np.any(bent) else curved
    profiles, left_open = profiled(fixed, fixed_size(float(np.min(dofs))), np.flatnonzero(selected))
    intervals = {**symmetric, **profiles}
    notes: list[Finding] = []
    room = fixed.problem.room(best.values)
    unheld = {f.parameters[0].name for f in left_open if f.kind is not Kind.BETTER_ELSEWHERE}
    for i, (name, parameter) in enumerate(zip(names, fixed.problem.parameters, strict=True)):
        if name in unheld:
            sds[i] = np.nan
            continue
        edge = edge_of(parameter.prior, float(best.values[i]))
        if best.at_bound[i] or room[i] < sds[i]:
            # and not anywhere, hidden by another one on its limit
            on_limit = best.at_bound[i] and room[i] <= _THERE * np.ptp(intervals[name][_WIDEST])
            notes.append(
                Finding(
                    Kind.AT_LIMIT if on_limit else Kind.NEAR_LIMIT, parameters=(Amount(name, edge),)
                )
            )
            sds[i] = np.nan
        elif (
            np.any(near_edge)
            or ended
            or 0.0 in intervals[name][_WIDEST]
            or (bent[i] and _has_one_sign(intervals[name], symmetric[name]))
        ) and _lopsided(intervals[name], float(best.values[i]), float(sds[i]), float(dofs[i])):
            notes.append(
                Finding(
                    Kind.CUT_BY_LIMIT
                    if np.any(near_edge)
                    else Kind.CUT_BY_NONE
                    if ended
                    else Kind.LOPSIDED,
                    parameters=(Amount(name),),
                    names=tuple(np.array(names)[near_edge].tolist()),
                )
            )
            sds[i] = np.nan
        elif not (everything or curved[i]):
            intervals[name] = symmetric[name]
    return FitUncertainty(cov, sds, intervals, tuple(notes), tuple(left_open))


def _at_end(run: Observations, fit: Fit) -> bool:
    """Whether the curve lies where the likelihood of a count of 0 ends, or of no failure."""
    if (counted := run.noise.counted) is None:
        return False
    mean = run.drawn(fit.named)
    return bool(np.any((mean < 0.0) | (mean > counted.law.ceiling)))


def _degrees_of_freedom(cov: FloatArray, pulls: FloatArray, dof: float) -> FloatArray:
    """(n_par,) of the estimated standard deviations; cov and pulls (n_par, n_par), the information
    of the priors.
    """
    size = np.diag(cov)
    share = 1.0 - np.einsum("ij,jk,ik->i", cov, pulls, cov) / positive_or(size, 1.0)
    return dof / np.clip(share, 1e-3, 1.0) ** 2


def _symmetric(
    names: tuple[str, ...], values: FloatArray, sds: FloatArray, dofs: FloatArray
) -> dict[str, Ends]:
    """name -> probability -> value ± t s."""
    halves = {p: _quantile(p, dofs) * sds for p in PROBABILITIES}
    return {
        name: {
            p: (float(values[i] - half[i]), float(values[i] + half[i]))
            for p, half in halves.items()
        }
        for i, name in enumerate(names)
    }


def profiled(
    fit: Fit, sizes: ErrorSizes, which: IntArray | None = None
) -> tuple[dict[str, Ends], list[Finding]]:
    """Name -> probability -> profile interval, which ends at the edge on an open side, nan for a
    parameter that has a side without any end; and the findings of such sides, and of a better point
    that was met on the way.  An interval across 0 of a parameter that enters without its sign ends
    there: beyond, the same curves come again.

    sizes : of its errors.  which : indices of the parameters, all if None.
    """
    intervals: dict[str, Ends] = {}
    left_open: list[Finding] = []
    chosen = np.arange(len(fit.names)) if which is None else which
    even = unsigned(fit)
    profiles = profile_intervals(
        fit, names=[fit.names[i] for i in chosen], probabilities=PROBABILITIES, sizes=sizes
    )
    for i, interval in zip(chosen, profiles, strict=True):
        parameter = fit.problem.parameters[i]
        unheld = open_side_finding(interval, parameter)
        left_open += unheld
        ends = {
            p: (math.nan, math.nan) if unheld else (interval.low[p], interval.high[p])
            for p in PROBABILITIES
        }
        if even[i]:
            ends = {p: _of_one_sign(pair, fit.values[i]) for p, pair in ends.items()}
        intervals[parameter.name] = ends
    lowest = max(profiles, key=lambda interval: interval.found_better, default=None)
    # of outliers the highest density may be a narrow one, of a few readings that lie on a curve
    robust = fit.problem.robust
    if not (left_open or robust) and lowest is not None and lowest.found_better > 0.0:
        amounts = map(Amount, fit.names, lowest.lowest.tolist())
        left_open.append(
            Finding(Kind.BETTER_ELSEWHERE, size=lowest.found_better, parameters=tuple(amounts))
        )
    return intervals, left_open


def unsigned(fit: Fit) -> BoolArray:
    """(n_par,) parameters that enter the curves without their sign."""
    symmetry = fit.symmetry
    return np.zeros(len(fit.names), dtype=bool) if symmetry is None else symmetry.unsigned


def _of_one_sign(ends: tuple[float, float], value: float) -> tuple[float, float]:
    """The part of an interval with the sign of `value`."""
    return (max(ends[0], 0.0), ends[1]) if value >= 0.0 else (ends[0], min(ends[1], 0.0))


def _has_one_sign(ends: Ends, symmetric: Ends) -> bool:
    """Whether the 95 % interval has one sign where value ± sd has not."""
    return math.prod(ends[_WIDEST]) > 0.0 > math.prod(symmetric[_WIDEST])


def _lopsided(ends: Ends, value: float, sd: float, dof: float) -> bool:
    """Whether value ± sd would state something else than the 68 % interval does."""
    half = _quantile(PROBABILITIES[0], np.array([dof]))[0] * sd
    low, high = ends[PROBABILITIES[0]]
    return not max(abs(value - low - half), abs(high - value - half)) <= LOPSIDED * half


def shown_value(
    value: float,
    sd: float,
    ends: Ends,
    edges: tuple[float, float],
    *,
    unit: str,
    few: bool,
    ok: bool,
) -> tuple[str, str]:
    """What a reader sees behind a parameter's name: ("=", '2.03 ± 0.05 s, ...') or ("=", '2 (no
    uncertainty)'), a limit as ("", '< 0.3 (95 %)').

    few : whether sd has so few degrees of freedom that ± misleads.
    ok : whether the status allows a value with an uncertainty.
    """
    low, high = ends[_WIDEST]
    unit_text = f" {unit}" if unit else ""
    if math.isnan(low) or math.isnan(high):
        return "=", f"{format_quantity(value)}{unit_text} ({phrase('no uncertainty')})"
    # at 0 ends the interval of a parameter that enters without its sign
    closed = [low not in (edges[0], 0.0, -math.inf), high not in (edges[1], 0.0, math.inf)]
    if not any(closed):
        return "", phrase("anywhere in {range}", range=f"[{low:.6g}, {high:.6g}]{unit_text}")
    level = "95 %" if ok else phrase("95 %, if the curve and the errors were right")
    size = (
        sd
        if math.isfinite(sd)
        else 0.25 * (high - low)
        if all(closed)
        else 0.25 * abs((high if closed[1] else low) - value)
    )
    if not all(closed):
        return "", f"< {format_rounded(high, size)}{unit_text} ({level})" if closed[
            1
        ] else f"> {format_rounded(low, size)}{unit_text} ({level})"

    def end(end_value: float) -> str:
        # of an interval that may reach over decades, each end by its own size
        same_sign = low > 0.0 or high < 0.0
        own = min(size, 0.1 * abs(end_value)) if same_sign and not math.isfinite(sd) else size
        return format_rounded(end_value, own)

    spans = {p: f"[{end(a)}, {end(b)}]" for p, (a, b) in ends.items()}
    intervals = ", ".join(
        phrase("{p:.0f} % in {interval}", p=100.0 * p, interval=span) for p, span in spans.items()
    )
    if not ok:
        return "", phrase(
            "in {interval} ({level})",
            interval=f"[{format_rounded(low, size)}, {format_rounded(high, size)}]{unit_text}",
            level=level,
        )
    if not math.isfinite(sd):
        return "=", f"{end(value)}{unit_text}, {intervals}"
    if few:
        return (
            "=",
            f"{format_rounded(value, sd)}{unit_text} ({phrase('standard error')} "
            f"{format_rounded(sd, sd)}), {intervals}",
        )
    return "=", f"{format_quantity(value, sd)}{unit_text}, {intervals}"


def _quantile(probability: float, dofs: FloatArray) -> FloatArray:
    """(n_par,) half width of an interval in standard deviations."""
    return student_quantile(0.5 + 0.5 * probability, dofs)


def coverage_of_sd(dof: float) -> float:
    """Share of experiments in which value ± s holds the true value."""
    return 1.0 - 2.0 * float(student_tail(1.0, dof))
