"""Examples of bumps 1.0.5, its directory `doc/examples/curvefit` (public domain)."""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import Numbers, example
from scipy.integrate import odeint

from estim import fit_curve, ode


def of_bumps(curve: Any, **ranges: tuple[float, float]) -> Numbers:
    from bumps.fitters import fit
    from bumps.names import FitProblem

    for name, (low, high) in ranges.items():
        getattr(curve, name).range(low, high)
    problem = FitProblem(curve)
    result = fit(problem, method="amoeba", steps=3000, verbose=False)
    problem.setp(result.x)
    cov = np.atleast_2d(problem.cov(result.x))
    return {
        n: (float(v), float(s))
        for n, v, s in zip(problem.labels(), result.x, np.sqrt(np.diag(cov)), strict=True)
    }


LINE_X, LINE_Y = [1, 2, 3, 4, 5, 6], [2.1, 4.0, 6.3, 8.03, 9.6, 11.9]
LINE_U = [0.05, 0.05, 0.2, 0.05, 0.2, 0.2]


def bumps_line() -> Numbers:
    from bumps.names import Curve

    def line(x: Any, m: float, b: float = 0) -> Any:
        return m * x + b

    curve = Curve(line, np.array(LINE_X), LINE_Y, LINE_U, m=2, b=2)
    return of_bumps(curve, m=(0, 4), b=(-5, 5))


@example("bumps", "curvefit/curve.py", "a line, limits", run=bumps_line, within=0.02, spread=0.02)
def line() -> Any:
    return fit_curve("m*x + b", LINE_X, LINE_Y, u_y=LINE_U, bounds={"m": (0, 4), "b": (-5, 5)})


TIME = np.linspace(0, 10, 10)
LEVEL = odeint(lambda x, t: 2.0 - 0.5 * x, 10.0, TIME).flatten() + 0.2 * np.random.RandomState(
    1
).normal(size=10)


def bumps_equation() -> Numbers:
    from bumps.names import Curve

    def solution(t: Any, x0: float, a: float, b: float) -> Any:
        return odeint(lambda x, t: a - b * x, x0, t).flatten()

    curve = Curve(solution, TIME, LEVEL, np.full(10, 0.2), x0=9.0, a=1.5, b=0.4)
    return of_bumps(curve, x0=(0, 100), a=(0, 10), b=(0, 10))


@example(
    "bumps",
    "curvefit/ode.py",
    "a differential equation",
    run=bumps_equation,
    within=0.02,
    spread=0.02,
)
def equation() -> Any:
    def synthesis(t: Any, state: Any, a: float, b: float) -> Any:
        return [a - b * state[0]]

    return fit_curve(ode(synthesis, ["x0"]), TIME, LEVEL, u_y=0.2, start={"x0": 1, "a": 1, "b": 1})


PEAK_X = np.linspace(5, 20, 345)
PEAK_N = np.random.RandomState(1).poisson(3 * np.exp(-0.5 * (PEAK_X - 12) ** 2 / 1.5**2) + 1)


def bumps_poisson() -> Numbers:
    from bumps.names import PoissonCurve

    def peak(x: Any, scale: float, center: float, width: float, background: float) -> Any:
        return scale * np.exp(-0.5 * (x - center) ** 2 / width**2) + background

    curve = PoissonCurve(peak, PEAK_X, PEAK_N, scale=2, center=11, width=2, background=0.5)
    return of_bumps(curve, scale=(0, 15), center=(2, 23), width=(0.1, 10.5), background=(0, 10))


@example("bumps", "curvefit/poisson.py", "counts, few of them", run=bumps_poisson, within=0.02, spread=0.25,
         why="Second derivatives of the likelihood give 0.287 for the scale, the Fisher information and estim 0.286, bumps 0.239. "
    "The example draws its counts without a seed; here they have one.")  # fmt: skip
def poisson() -> Any:
    return fit_curve(
        "scale*exp(-(x - center)**2/width**2/2) + background", PEAK_X, PEAK_N, noise="poisson",
        start={"scale": 1, "center": 12, "width": 2, "background": 1},
        bounds={"scale": (0, 15), "center": (2, 23), "width": (0.1, 10.5), "background": (0, 10)},
    )  # fmt: skip
