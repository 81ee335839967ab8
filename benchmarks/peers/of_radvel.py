"""Examples of RadVel 1.6.7, its directory `example_planets` (MIT): radial velocities of stars."""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import HERE, Numbers, example

from estim import CurveFit, fit_curve

ERRORS, DAYS, SPEEDS = np.loadtxt(
    HERE / "data" / "epic203771098.csv", delimiter=",", skiprows=1, unpack=True
)
MIDDLE = 0.5 * (DAYS.min() + DAYS.max())


def radvel_two_planets() -> Numbers:
    import radvel

    known = radvel.Parameters(2, basis="per tc e w k")
    for number, period, transit in ((1, 20.885258, 2072.79438), (2, 42.363011, 2082.62516)):
        for name, value in (
            ("per", period),
            ("tc", transit),
            ("e", 0.01),
            ("w", np.pi / 2),
            ("k", 10.0),
        ):
            known[f"{name}{number}"] = radvel.Parameter(value=value)
    for name, value in (("dvdt", 0.0), ("curv", 0.0), ("gamma_j", 1.0), ("jit_j", 2.6)):
        known[name] = radvel.Parameter(value=value)
    params = known.basis.to_any_basis(known, "per tc secosw sesinw k")
    model = radvel.RVModel(params, time_base=MIDDLE)
    like = radvel.likelihood.RVLikelihood(model, DAYS, SPEEDS, ERRORS, suffix="_j")
    like.params["gamma_j"] = radvel.Parameter(value=1.0)
    like.params["jit_j"] = radvel.Parameter(value=2.6)
    for name in ("secosw", "sesinw", "tc", "per"):
        for number in (1, 2):
            like.params[f"{name}{number}"].vary = False
    post = radvel.posterior.Posterior(radvel.likelihood.CompositeLikelihood([like]))
    post = radvel.fitting.maxlike_fitting(post, verbose=False)
    best, step = np.array(post.get_vary_params()), np.array([1e-2, 1e-2, 1e-4, 1e-5, 1e-2, 1e-2])
    names = ["k1", "k2", "dvdt", "curv", "gamma", "jitter"]

    def minus(*moves: tuple[int, float]) -> float:
        values = best.copy()
        for k, by in moves:
            values[k] += by * step[k]
        return -float(post.logprob_array(values))

    def curvature(i: int, j: int) -> float:
        corners = [(a * b, minus((i, a), (j, b))) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
        return float(sum(sign * value for sign, value in corners) / (4.0 * step[i] * step[j]))

    hessian = np.array([[curvature(i, j) for j in range(6)] for i in range(6)])
    sds = np.sqrt(np.diag(np.linalg.inv(hessian)))
    return {n: (float(v), float(s)) for n, v, s in zip(names, best, sds, strict=True)}


def pull(x: Any, period: float, transit: float, e: float = 0.01) -> Any:
    """The speed of a star along the line of sight for a planet of unit pull whose periastron, at
    w = 90 degrees, is its transit: cos(f + w) = -sin(f), f from Kepler's equation.
    """
    mean = 2.0 * np.pi * (x - transit) / period
    eccentric = mean
    for _ in range(10):
        eccentric = mean + e * np.sin(eccentric)
    half = np.sqrt((1.0 + e) / (1.0 - e))
    return -np.sin(2.0 * np.arctan2(half * np.sin(0.5 * eccentric), np.cos(0.5 * eccentric)))


@example(
    "radvel",
    "epic203771098.py",
    "errors of unknown size beside stated ones (jitter)",
    run=radvel_two_planets,
    within=0.02,
    why="RadVel's search stops a hundredth of a standard deviation short: its log likelihood is -82.84152, at estim's values -82.84135.",
)
def two_planets() -> CurveFit:
    def velocity(x, k1=10.0, k2=10.0, gamma=1.0, dvdt=0.0, curv=0.0):  # type: ignore[no-untyped-def]
        planets = k1 * pull(x, 20.885258, 2072.79438) + k2 * pull(x, 42.363011, 2082.62516)
        return planets + gamma + dvdt * (x - MIDDLE) + curv * (x - MIDDLE) ** 2

    return fit_curve(velocity, DAYS, SPEEDS, u_y=ERRORS, jitter=True)
