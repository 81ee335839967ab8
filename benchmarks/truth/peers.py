"""The same recordings as a user of lmfit would fit them: speeds by differences, each with its own
error, the stated values as further residuals.

The curve and the points are those of `estim`; what differs is what is made of the residuals.
Errors of speeds by central differences are sigma_x sqrt(2)/(t_{i+1} - t_{i-1}), taken as
independent, as is usual.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estim.campaign import as_complete, load_campaign
from truth.recordings import SIGMA

FloatArray = NDArray[np.float64]
CENTRAL = (0.68, 0.95)
LEAST_SQUARES = "lmfit, errors as stated"
SCALED = "lmfit"
PROFILES = "lmfit's conf_interval"
EMCEE = "lmfit's emcee"
_BURN, _STEPS, _WALKERS = 300, 1300, 50
Interval = tuple[float, float]


def intervals_of_lmfit(
    folder: Path, truth: Mapping[str, float], *, slow: bool, seed: int
) -> dict[str, list[tuple[Interval, Interval]] | None]:
    """Method -> central 68 and 95 % intervals of each quantity of `truth`; None where it gives
    none.  slow : profiles and emcee, too.
    """
    import lmfit

    problem = as_complete(load_campaign(folder / "campaign.toml").problem(["r"]), "lmfit")
    (run,) = problem.runs
    assert run.t is not None
    table = np.loadtxt(folder / "r.csv", delimiter=",", skiprows=1)
    place = np.searchsorted(table[:, 0], run.t)
    u = SIGMA * math.sqrt(2.0) / (table[place + 1, 0] - table[place - 1, 0])
    keys = {p.name: f"p{i}" for i, p in enumerate(problem.parameters)}
    start = lmfit.Parameters()
    for p in problem.parameters:
        start.add(
            keys[p.name],
            value=min(max(p.prior.centre, p.prior.low + 1e-3), p.prior.high - 1e-3),
            min=p.prior.low,
            max=p.prior.high,
        )

    def residuals(chosen: lmfit.Parameters) -> FloatArray:
        values = np.array([chosen[key].value for key in keys.values()])
        curve = np.ravel(run.points.value(problem.named(values)))
        stated = [
            p.prior.residual(float(v)) for p, v in zip(problem.parameters, values, strict=True)
        ]
        return np.concatenate([np.nan_to_num((run.y - curve) / u, nan=1e3), stated])

    found: dict[str, list[tuple[Interval, Interval]] | None] = {}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for method, scaled in ((SCALED, True), (LEAST_SQUARES, False)):
            minimizer = lmfit.Minimizer(residuals, start, scale_covar=scaled)
            result = minimizer.minimize(method="leastsq")
            of = [result.params[keys[name]] for name in truth]
            known = all(
                p.stderr is not None and math.isfinite(p.stderr) and p.stderr > 0.0 for p in of
            )
            found[method] = [_normal(p.value, p.stderr) for p in of] if known else None
        if slow:
            found[PROFILES] = _profiles(lmfit, minimizer, result, [keys[name] for name in truth])
            found[EMCEE] = _sampled(minimizer, result, [keys[name] for name in truth], seed=seed)
    return found


def _normal(value: float, sd: float) -> tuple[Interval, Interval]:
    return (value - 0.9945 * sd, value + 0.9945 * sd), (value - 1.96 * sd, value + 1.96 * sd)


def _profiles(lmfit, minimizer, result, keys: list[str]) -> list[tuple[Interval, Interval]] | None:
    try:
        table = lmfit.conf_interval(minimizer, result, p_names=keys, sigmas=CENTRAL)
    except Exception:
        return None
    # five rows: 95 % below, 68 % below, the best, 68 % above, 95 % above
    return [
        ((rows[1][1], rows[3][1]), (rows[0][1], rows[4][1]))
        for rows in (table[key] for key in keys)
    ]


def _sampled(minimizer, result, keys: list[str], *, seed: int) -> list[tuple[Interval, Interval]]:
    sampled = minimizer.emcee(
        params=result.params,
        nwalkers=_WALKERS,
        steps=_STEPS,
        burn=_BURN,
        is_weighted=True,
        seed=seed,
        progress=False,
        float_behavior="chi2",
    )
    found = []
    for key in keys:
        ends = [
            np.quantile(sampled.flatchain[key], [0.5 - 0.5 * p, 0.5 + 0.5 * p]) for p in CENTRAL
        ]
        found.append(tuple((float(low), float(high)) for low, high in ends))
    return found
