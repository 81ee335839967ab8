"""What intervals cover when x has errors: a line, an exponential, a power and a sine at u_x f'/u_y
= 0.3, 1 and 3; prints Markdown tables.

    python benchmarks/errors_in_x.py [--repeats 300] [--posterior 0] [--u-x 1] [--curves
    line,exponential,power,sine] [--seed 1]

All data are SYNTHETIC: true abscissas uniform over a range, errors of x of a stated share of that
range, errors of y so that the root mean square of u_x f' is the stated multiple of u_y; 8 and 40
points.  One shape parameter is watched (b, b, b, w).  Beside each other, on the same data:

- fit: `fit_curve`'s likelihood, value +- standard deviation (the search starts at the truth, so
  that only the likelihood is judged).
- posterior: central intervals of the draws of `sample_curve`, for as many repeats as `--posterior`
  says.
- ODR: scipy.odr with `sx`, `sy`, scaled by its residual variance (`sd_beta`) and not scaled
  (`cov_beta`).
- naive: N(y | f, u_y^2 + f'^2 u_x^2) with its log-determinant.

p < 0.05: share of the right models whose chi-square p-value is below 0.05.  300 repeats take about
10 minutes on one core.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from estim.curve_fitting.single import fit_curve
from estim.curves import DataSet, ParameterSettings, pose_points
from estim.fitting.fisher_information import information
from estim.fitting.least_squares import chi2_p
from estim.pipeline import sample_curve
from estim.problem.posterior import Problem
from estim.sampling.chain import Target

FloatArray = NDArray[np.float64]
# half widths of central intervals of a standard normal variable
NORMAL = {0.68: 0.9944579, 0.95: 1.959964}


@dataclass(frozen=True)
class Case:
    """A curve, its true parameters (the watched one is called `watched`), the range of x and u_x as
    a share of it.

    The share leaves every case with u_y small enough for a fit that is nearly linear: beyond, least
    squares of any kind miss their coverage.
    """

    formula: str
    truth: Mapping[str, float]
    watched: str
    low: float
    high: float
    share: float


CASES = {
    "line": Case("a + b*x", {"a": 1.0, "b": 2.0}, "b", 0.0, 1.0, 0.05),
    "exponential": Case("a*exp(b*x)", {"a": 1.0, "b": 1.5}, "b", 0.0, 1.0, 0.05),
    "power": Case("a*x**b + c", {"a": 2.0, "b": 1.7, "c": 0.5}, "b", 0.5, 2.0, 0.01),
    "sine": Case("A*sin(w*x)", {"A": 2.0, "w": 1.5}, "w", 0.0, 6.0, 0.01),
}
RATIOS = (0.3, 1.0, 3.0)
SIZES = (8, 40)


@dataclass(frozen=True, eq=False)
class Data:
    """Points (x, y), (n_obs,) each, and their standard uncertainties."""

    x: FloatArray
    y: FloatArray
    u_x: float
    u_y: float


def value_of(case: Case, x: FloatArray, parameters: FloatArray) -> FloatArray:
    """The curve by NumPy, without estim."""
    with np.errstate(all="ignore"):
        return eval(
            case.formula,
            {
                "exp": np.exp,
                "sin": np.sin,
                "x": x,
                **dict(zip(case.truth, parameters, strict=True)),
            },
        )


def slope_of(case: Case, x: FloatArray, parameters: FloatArray) -> FloatArray:
    h = 1e-5 * (case.high - case.low)
    return (value_of(case, x + h, parameters) - value_of(case, x - h, parameters)) / (2.0 * h)


def simulate(
    case: Case, *, n_obs: int, ratio: float, share: float, rng: np.random.Generator
) -> Data:
    """Points with u_x `share` of the range of x and u_x f'/u_y = `ratio` (root mean square)."""
    truth = np.array(list(case.truth.values()))
    u_x = share * (case.high - case.low)
    grid = np.linspace(case.low, case.high, 500)
    u_y = u_x * float(np.sqrt(np.mean(slope_of(case, grid, truth) ** 2))) / ratio
    true_x = rng.uniform(case.low, case.high, n_obs)
    return Data(
        true_x + u_x * rng.standard_normal(n_obs),
        value_of(case, true_x, truth) + u_y * rng.standard_normal(n_obs),
        u_x,
        u_y,
    )


def problem_of(case: Case, data: Data) -> Problem:
    """What `fit_curve` would fit, started at the truth."""
    points = DataSet(data.x, data.y, data.u_y, u_x=data.u_x, curve=case.formula)
    posed = pose_points(points, ParameterSettings(case.truth), ())
    return posed.with_sigma(1.0)


def marginal(case: Case, data: Data) -> tuple[float, float, float]:
    """Value and standard deviation of the watched parameter by estim, and the p-value of the fit:
    steps by the information from the truth.
    """
    problem = problem_of(case, data)
    values = problem.start()
    posterior = problem.linearised(values)
    height = float(np.sum(posterior.residuals(values) ** 2))
    for _ in range(40):
        jacobian, residual = posterior.scoring(values)
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        size = float(np.linalg.norm(jacobian @ step))
        while size > 1e-3:
            trial = float(np.sum(posterior.residuals(values + step) ** 2))
            if trial < height:
                values, height = values + step, trial
                break
            step, size = 0.5 * step, 0.5 * size
        if size <= 1e-3:
            break
    cov = np.linalg.pinv(information(posterior, values), hermitian=True)
    i = problem.names.index(case.watched)
    chi2 = float(np.sum(posterior.size_residuals(values) ** 2))
    return float(values[i]), float(np.sqrt(cov[i, i])), chi2_p(chi2, data.x.size - problem.n_par)


def by_odr(case: Case, data: Data) -> tuple[float, float, float]:
    """Value and standard deviations, scaled and not, by scipy.odr."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from scipy.odr import ODR, Model, RealData

        model = Model(lambda beta, x: value_of(case, x, beta))
        result = ODR(
            RealData(data.x, data.y, sx=data.u_x, sy=data.u_y),
            model,
            beta0=list(case.truth.values()),
        ).run()
    i = list(case.truth).index(case.watched)
    return float(result.beta[i]), float(result.sd_beta[i]), float(np.sqrt(result.cov_beta[i, i]))


def naive(case: Case, data: Data) -> tuple[float, float]:
    """Maximum of N(y | f, u_y^2 + f'^2 u_x^2) and the curvature there."""
    from scipy.optimize import minimize

    def minus(parameters: FloatArray) -> float:
        variance = data.u_y**2 + (data.u_x * slope_of(case, data.x, parameters)) ** 2
        with np.errstate(all="ignore"):
            total = 0.5 * float(
                np.sum(
                    (data.y - value_of(case, data.x, parameters)) ** 2 / variance + np.log(variance)
                )
            )
        return total if np.isfinite(total) else 1e300

    found = minimize(
        minus,
        np.array(list(case.truth.values())),
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 4000},
    ).x
    steps = 1e-4 * np.maximum(np.abs(found), 0.1)
    moves = np.diag(steps)
    hessian = np.array(
        [
            [
                (
                    minus(found + a + b)
                    - minus(found + a - b)
                    - minus(found - a + b)
                    + minus(found - a - b)
                )
                / 4.0
                for b in moves
            ]
            for a in moves
        ]
    ) / np.outer(steps, steps)
    i = list(case.truth).index(case.watched)
    variance = float(np.linalg.pinv(hessian)[i, i])
    return float(found[i]), float(np.sqrt(variance)) if variance > 0.0 else np.nan


def held(errors: FloatArray, sds: FloatArray) -> dict[float, float]:
    """Probability -> share of intervals that hold the truth."""
    return {p: float(np.mean(np.abs(errors) <= half * sds)) for p, half in NORMAL.items()}


def posterior_coverage(
    case: Case, *, n_obs: int, ratio: float, share: float, repeats: int, seed: int
) -> dict[float, float]:
    """The same for central intervals of draws; a repeat whose posterior cannot be sampled counts as
    a miss.
    """
    inside: dict[float, list[bool]] = {p: [] for p in NORMAL}
    for k in range(repeats):
        data = simulate(
            case,
            n_obs=n_obs,
            ratio=ratio,
            share=share,
            rng=np.random.default_rng([seed, n_obs, round(10 * ratio), k]),
        )
        fit = fit_curve(
            case.formula, data.x, data.y, start=case.truth, u_y=data.u_y, u_x=data.u_x, scan=False
        )
        draws = sample_curve(fit, seed=k, target=Target(ess=500)).chain.flat[
            :, list(case.truth).index(case.watched)
        ]
        for p in NORMAL:
            low, high = np.quantile(draws, [0.5 - 0.5 * p, 0.5 + 0.5 * p])
            inside[p].append(bool(low <= case.truth[case.watched] <= high))
    return {p: float(np.mean(hits)) for p, hits in inside.items()}


@dataclass(frozen=True, eq=False)
class Study:
    """Coverage of one cell: method -> probability -> share, and the p-values of the right model
    (n,).
    """

    coverage: Mapping[str, Mapping[float, float]]
    p_values: FloatArray
    bias: Mapping[str, float]


def study(case: Case, *, n_obs: int, ratio: float, share: float, repeats: int, seed: int) -> Study:
    """Coverage of the watched parameter by every method on the same `repeats` data sets; bias:
    median error over the median sd.
    """
    truth = case.truth[case.watched]
    rows = []
    for k in range(repeats):
        data = simulate(
            case,
            n_obs=n_obs,
            ratio=ratio,
            share=share,
            rng=np.random.default_rng([seed, n_obs, round(10 * ratio), k]),
        )
        rows.append((*marginal(case, data), *by_odr(case, data), *naive(case, data)))
    value, sd, p, odr, scaled, unscaled, wrong, of_wrong = np.array(rows).T
    pairs = {
        "fit": (value, sd),
        "ODR": (odr, unscaled),
        "ODR scaled": (odr, scaled),
        "naive": (wrong, of_wrong),
    }
    return Study(
        {name: held(v - truth, s) for name, (v, s) in pairs.items()},
        p,
        {name: float(np.median(v - truth) / np.nanmedian(s)) for name, (v, s) in pairs.items()},
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=300)
    parser.add_argument("--posterior", type=int, default=0)
    parser.add_argument(
        "--u-x",
        type=float,
        default=1.0,
        help="factor on the share of the range of x that u_x is in each case",
    )
    parser.add_argument("--curves", default=",".join(CASES))
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    error = np.sqrt(0.68 * 0.32 / args.repeats)
    print(
        f"{args.repeats} repeats a cell (one standard error of the 68 % columns: "
        f"{100 * error:.1f}), seed {args.seed}\n"
    )
    head = (
        "| curve | u_x / range | points | u_x f'/u_y | fit 68 / 95 | ODR | ODR scaled | naive "
        "| bias fit | bias naive | p < 0.05 |"
    )
    print(head + (" posterior |" if args.posterior else ""))
    print("|---|---|---|---|---|---|---|---|---|---|---|" + ("---|" if args.posterior else ""))
    for name in args.curves.split(","):
        share = args.u_x * CASES[name].share
        for n_obs in SIZES:
            for ratio in RATIOS:
                found = study(
                    CASES[name],
                    n_obs=n_obs,
                    ratio=ratio,
                    share=share,
                    repeats=args.repeats,
                    seed=args.seed,
                )
                cells = [
                    f"{100 * row[0.68]:.1f} / {100 * row[0.95]:.1f}"
                    for row in found.coverage.values()
                ]
                cells += [f"{found.bias[key]:+.2f}" for key in ("fit", "naive")] + [
                    f"{np.mean(found.p_values < 0.05):.3f}"
                ]
                if args.posterior:
                    drawn = posterior_coverage(
                        CASES[name],
                        n_obs=n_obs,
                        ratio=ratio,
                        share=share,
                        repeats=args.posterior,
                        seed=args.seed,
                    )
                    cells.append(f"{100 * drawn[0.68]:.1f} / {100 * drawn[0.95]:.1f}")
                print(
                    f"| {name} | {share:g} | {n_obs} | {ratio:g} | {' | '.join(cells)} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
