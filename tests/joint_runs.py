"""Joint problems for tests: small curves whose posteriors are known in closed form, and simulated
campaigns of many runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estim.campaign import Campaign, load_campaign
from estim.model import Body
from estim.model.simulate import frame_times, simulate_positions
from estim.problem.curve import LocalCurve
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale
from estim.problem.observations import Observations, Parameter
from estim.problem.posterior import Problem
from estim.problem.priors import Normal, Prior


@dataclass(frozen=True, eq=False)
class Formula:
    """A curve given by its value and its derivatives in the arguments, each a function of (x,
    arguments).
    """

    f: Callable
    slopes: Mapping[str, Callable]

    def value(self, x: np.ndarray, arguments: Mapping) -> np.ndarray:
        return np.atleast_2d(self.f(x, arguments))

    def local(self, x: np.ndarray, arguments: Mapping) -> LocalCurve:
        value = self.value(x, arguments)
        return LocalCurve(
            value,
            np.zeros_like(value),
            {name: np.asarray(slope(x, arguments)) for name, slope in self.slopes.items()},
        )


def one(x: np.ndarray, a: Mapping) -> np.ndarray:
    return np.ones_like(x)


LINE = Formula(
    lambda x, a: a["slope"] * x + a["bend"] * x**2 + a["offset"],
    {"slope": lambda x, a: x, "bend": lambda x, a: x**2, "offset": one},
)
DECAY = Formula(
    lambda x, a: a["size"] * np.exp(-a["rate"] * x),
    {
        "size": lambda x, a: np.exp(-a["rate"] * x),
        "rate": lambda x, a: -x * a["size"] * np.exp(-a["rate"] * x),
    },
)
GROWTH = Formula(
    lambda x, a: a["rate"] * x + np.exp(a["log_size"]),
    {"rate": lambda x, a: x, "log_size": lambda x, a: np.exp(a["log_size"]) * one(x, a)},
)


def problem_of(
    curve: Formula,
    shared: Mapping[str, Prior],
    own: Mapping[str, Prior],
    x: np.ndarray,
    ys: Sequence[np.ndarray],
    sigma: float | Prior,
) -> Problem:
    """Runs of one curve: `shared` arguments are one parameter, `own` ones a parameter a run
    ("offset[0]"), noise independent.

    sigma : fixed, or the prior of each run's own standard deviation ("sigma[0]").
    """
    parameters = [Parameter(name, "1", prior, name) for name, prior in shared.items()]
    runs = []
    for i, y in enumerate(ys):
        parameters += [Parameter(f"{name}[{i}]", "1", prior, name) for name, prior in own.items()]
        scale = Scale(sigma) if isinstance(sigma, float) else Scale(parameter=f"sigma[{i}]")
        if not isinstance(sigma, float):
            parameters.append(Parameter(f"sigma[{i}]", "1", sigma, "sigma"))
        arguments = {name: name for name in shared} | {name: f"{name}[{i}]" for name in own}
        runs.append(
            Observations(
                name=f"r{i}",
                x=x,
                y=y,
                t=None,
                curve=curve,
                arguments=arguments,
                noise=Independent(scale, Scale(0.0), np.ones(x.size)),
                x_name="x",
                x_unit="1",
                y_name="y",
                y_unit="1",
                excluded=(),
                excluded_points=np.empty((0, 2)),
            )
        )
    return Problem(tuple(parameters), tuple(runs))


READ_AT = np.linspace(0.1, 1.0, 8)
SLOPES = Formula(  # only tilt / scale shows: the readings of the tilts say the scale
    lambda x, a: a["tilt"] / a["scale"] * x + a["offset"],
    {
        "tilt": lambda x, a: x / a["scale"],
        "scale": lambda x, a: -a["tilt"] / a["scale"] ** 2 * x,
        "offset": one,
    },
)
U_TILT, U_OFFSET, U_Y = 0.2, 0.1, 0.01


def readings(n: int, rng: np.random.Generator, *, wrong: int | None = None) -> Problem:
    """Runs of scale 1 whose tilts, 0.5 to 1.5, were read with an error of `U_TILT`; the tilt of run
    `wrong` was read 2 off.
    """
    tilts = rng.uniform(0.5, 1.5, n)
    ys = [tilt * READ_AT + U_Y * rng.standard_normal(READ_AT.size) for tilt in tilts]
    own = {"tilt": Normal(1.0, U_TILT), "offset": Normal(0.0, U_OFFSET)}
    problem = problem_of(SLOPES, {"scale": Normal(1.0, 0.5)}, own, READ_AT, ys, U_Y)
    read = {
        f"tilt[{i}]": tilt + U_TILT * rng.standard_normal() + (2.0 if i == wrong else 0.0)
        for i, tilt in enumerate(tilts)
    }
    parameters = (
        replace(p, prior=Normal(read[p.name], U_TILT)) if p.name in read else p
        for p in problem.parameters
    )
    return Problem(tuple(parameters), problem.runs)


def simulated_campaign(
    folder: Path,
    rng: np.random.Generator,
    *,
    gammas: Sequence[float],
    stated_gamma: str = "0.187(10)",
    kappa: str = '"0.45(3)"',
    offset_deg: float = 0.0,
    u_phi_deg: float = 0.4,
    shared: str = "",
) -> Campaign:
    """Runs of a body whose gamma is that of `gammas`, one a run, stated as one body; true kappa
    0.45.

    offset_deg : what the true tilt exceeds every reading by.  shared : further lines of [shared].
    """
    text = f"""title = "simulated"
kind = "synthetic"
[shared]
g = 9.81
noise = {{sigma_x_m = 0.001}}
{shared}
[bodies.b]
radius_m = 0.15
gamma = "{stated_gamma}"
kappa = {kappa}
"""
    for i, gamma in enumerate(gammas):
        tilt, release = 2.0 + 4.0 * (i % 5) / 4.0, 55.0 + 5.0 * (i % 3)
        body = Body(radius=0.15, gamma=gamma, kappa=0.45)
        motion = {"phi": float(np.radians(tilt)), "theta0": float(np.radians(release)), "g": 9.81}
        t = frame_times(body, **motion, interval=1.0 / 30.0, x_end=0.877, rng=rng)
        x = simulate_positions(t, body, **motion, sigma_x=0.001, rng=rng)
        (folder / f"{i}.csv").write_text(
            "t_s,x_m\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(t - t[0], x, strict=True))
        )
        phi, theta0 = (
            tilt - offset_deg + u_phi_deg * rng.standard_normal(),
            release + 1.5 * rng.standard_normal(),
        )
        text += (
            f'[[runs]]\nname = "r{i}"\nbody = "b"\nfile = "{i}.csv"\nphi_deg = "{phi:.4f} +/- '
            f'{u_phi_deg}"\ntheta0_deg = "{theta0:.3f} +/- 1.5"\n'
        )
    (folder / "c.toml").write_text(text)
    return load_campaign(folder / "c.toml")
