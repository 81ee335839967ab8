"""Recordings of a true motion as a laboratory would write them down: campaign.toml and a CSV of
times and positions for each run.

A `Disturbance` is one thing that the plain analysis does not know of: of the motion (`truth`), of
the camera, or of what is stated.  Everything else is as stated: 30 frames/s, readings with a normal
error of 1 mm, stated values that scatter about the true ones by their own uncertainties, anew in
each replica.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from truth.motion import Truth, solve

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

SIGMA, INTERVAL, LONGEST, PICTURE = 0.001, 1.0 / 30.0, 3.0, 0.6  # m, s, s, m
BASE = Truth(rolling_resistance=0.003)
FREE = ("gamma", "kappa", "theta0", "phi", "rolling_resistance")  # what is fit
OF_RUN = ("theta0", "phi")
# standard uncertainties of what is stated; None: uniform between 0 and 1
PRIORS: Mapping[str, Mapping[str, float | None]] = {
    "default": {
        "phi": math.radians(0.4),
        "theta0": math.radians(1.5),
        "gamma": 0.010,
        "kappa": None,
        "radius": 0.0005,
        "g": 0.0,
    },
    "sharp": {
        "phi": math.radians(0.02),
        "theta0": math.radians(0.2),
        "gamma": 0.001,
        "kappa": 0.005,
        "radius": 0.0001,
        "g": 0.0,
    },
}
NOISES = {
    "speeds": f'{{model = "differentiated", sigma_x_m = {SIGMA}, derivative = "central"}}',
    "positions": f'{{model = "positions", sigma_x_m = {SIGMA}}}',
}
JOINT = "speeds of 3 runs"  # in place of a noise: runs of one body at three tilts of one ramp
TILTS = (-math.radians(1.0), 0.0, math.radians(1.0))  # to what the tilt is otherwise


def _independent(rng: Rng, v: FloatArray) -> FloatArray:
    return SIGMA * rng.standard_normal(v.size)


def _unchanged(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:  # noqa: ARG001
    return t, x


@dataclass(frozen=True)
class Camera:
    """What happens between the motion and the table.  noise(rng, true speeds (n,)) -> errors (n,)
    m; after: of t, x once they are read.
    """

    interval: float = INTERVAL
    jitter: float = 0.0  # s, of the moments of the frames
    scale_t: float = 0.0
    scale_x: float = 0.0
    bow: float = 0.0  # m, in the middle of the picture
    noise: Callable[[Rng, FloatArray], FloatArray] = _independent
    after: Callable[[Rng, FloatArray, FloatArray], tuple[FloatArray, FloatArray]] = _unchanged


@dataclass(frozen=True)
class Disturbance:
    """words : for the table.  motion(rng, base) -> what is true.  stated : factor and shift in
    stated sds of what is stated.
    """

    words: str
    motion: Callable[[Rng, Truth], Truth] = lambda rng, base: base  # noqa: ARG005
    camera: Camera = field(default_factory=Camera)
    factors: Mapping[str, float] = field(default_factory=dict)
    shifts: Mapping[str, float] = field(default_factory=dict)
    n_frame: int = 0  # the first so many only; 0: all
    drawn: bool = False  # the truth is drawn from what is stated, which is that of `BASE`


def ar1(correlation: float) -> Callable[[Rng, FloatArray], FloatArray]:
    def noise(rng: Rng, v: FloatArray) -> FloatArray:
        errors = SIGMA * rng.standard_normal(v.size)
        for i in range(1, v.size):
            errors[i] = correlation * errors[i - 1] + math.sqrt(1.0 - correlation**2) * errors[i]
        return errors

    return noise


def uneven(rng: Rng, v: FloatArray) -> FloatArray:
    """Errors from 0.3 mm at rest to 3 mm at the largest speed."""
    return (0.0003 + 0.0027 * np.abs(v) / np.max(np.abs(v))) * rng.standard_normal(v.size)


def blurred(rng: Rng, v: FloatArray) -> FloatArray:
    """Any place within the smear of an exposure of a frame interval is marked."""
    return SIGMA * rng.standard_normal(v.size) + v * INTERVAL * rng.uniform(-0.5, 0.5, v.size)


def with_outliers(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    bad = rng.choice(x.size, max(2, round(0.05 * x.size)), replace=False)
    x[bad] += rng.choice([-1.0, 1.0], bad.size) * rng.uniform(20.0, 60.0, bad.size) * SIGMA
    return t, x


def dropped(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One frame is missing and nobody noticed: the times go on evenly."""
    place = int(rng.integers(x.size // 4, 3 * x.size // 4))
    return t[:-1], np.delete(x, place)


def jump(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A step of 5 mm that stays: the mark is lost and found beside."""
    place = int(rng.integers(x.size // 4, 3 * x.size // 4))
    return t, x + np.where(np.arange(x.size) >= place, 0.005, 0.0)


def drifting(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The camera turns slowly: 5 mm over the recording, either way."""
    return t, x + rng.choice([-0.005, 0.005]) * (t - t[0]) / (t[-1] - t[0])


def pixels(size: float) -> Callable[[Rng, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    return lambda rng, t, x: (t, size * np.round(x / size))  # noqa: ARG005


def smoothed(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:  # noqa: ARG001
    """A moving mean of five, as a video program makes it."""
    return t[2:-2], np.convolve(x, np.full(5, 0.2), mode="valid")


def curved(rng: Rng, base: Truth) -> Truth:
    """Hills and valleys of +-2 mm, 0.6 m from crest to crest."""
    k, phase = 2.0 * math.pi / 0.6, float(rng.uniform(0.0, 2.0 * math.pi))
    return replace(
        base,
        tilt=lambda x: 0.002 * k * math.cos(k * x + phase),
        bend=lambda x: -0.002 * k * k * math.sin(k * x + phase),
    )


def sagging(depth: float, length: float, start: float) -> Callable[[Rng, Truth], Truth]:
    """A parabola between supports; the tilt stated is that of the line through them."""
    share = 4.0 * depth / length**2
    tilt = lambda x: share * (2.0 * (x + start) - length)  # noqa: E731
    return lambda rng, base: replace(base, tilt=tilt, bend=lambda _x: 2.0 * share)  # noqa: ARG005


def changed(**values: object) -> Callable[[Rng, Truth], Truth]:
    return lambda rng, base: replace(base, **values)  # noqa: ARG005


@dataclass(frozen=True)
class Force:
    """A force (N) along the ramp at x (m).

    amplitude : of the weight, 0 for none.  length : of the track, which ends at `end` (m).
    """

    weight: float
    amplitude: float
    length: float
    end: float
    share: CubicSpline = field(compare=False)  # drawn again it is the same, and solved once

    def __call__(self, x: float) -> float:
        return self.weight * float(self.share(min(max(x, 0.0), self.end)))


def from_prior(rng: Rng, base: Truth) -> Truth:
    """Everything as the analysis assumes it, by the numbers in docs/statistics.md: a force with
    probability 1/2, half-normal of .02 of the weight, its length log-normal about a sixth of the
    track (.7, from a thirtieth to .6), Matern 3/2 and once and twice per turn, without its mean;
    an energy at release of .02 of the weight times the radius; c_rr half-normal of .005; the rest
    as `PRIORS["default"]` states.

    What never gets as far as it would without a force, or takes too long, is drawn again.
    """
    while True:
        values = {
            name: rng.uniform() if u is None else getattr(base, name) + u * rng.standard_normal()
            for name, u in PRIORS["default"].items()
        }
        values["rolling_resistance"] = 0.005 * abs(rng.standard_normal())
        true = replace(base, **values)
        start = 0.02 * true.radius * rng.standard_normal()
        spike, size = rng.uniform() < 0.5, 0.02 * abs(rng.standard_normal())
        length = math.exp(0.7 * rng.standard_normal()) / 6.0
        normal = rng.standard_normal(404)
        x = np.linspace(0.0, 1.0, 1001)
        turned, slope = (
            true.theta0 + x / true.radius,
            math.sin(true.phi) + true.rolling_resistance * math.cos(true.phi),
        )
        energy = start - slope * x
        energy += true.gamma * true.radius * (math.cos(true.theta0) - np.cos(turned))
        moving = energy > 0.0
        if not (1.0 / 30.0 <= length <= 0.6) or not moving.any() or moving[-1]:
            continue
        # energies of a flat ramp: where the body would turn is where it turns with a force, too
        first = int(np.argmax(moving))
        end = float(np.interp(0.0, *_falling(energy, x, first)))
        nodes = np.linspace(0.0, end, 400)
        apart = math.sqrt(3.0) * np.abs(nodes[:, None] - nodes) / (length * end)
        kernel = (1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(nodes.size)
        force = np.linalg.cholesky(kernel) @ normal[:400]
        for turns, (a, b) in ((1.0, normal[400:402]), (2.0, normal[402:])):
            angle = turns * nodes / true.radius
            force += a * np.cos(angle) + b * np.sin(angle)
        amplitude = 0.0 if spike else size
        force = CubicSpline(nodes, amplitude * force)
        force = CubicSpline(nodes, force(nodes) - force.integrate(0.0, end) / end)
        work = force.antiderivative()
        places = np.linspace(0.0, end, 2001)[:-1]
        energy = np.interp(places, x, energy) + work(places)
        moving = energy > 0.0
        begin = int(np.argmax(moving))
        if not moving.any() or not moving[begin:].all():
            continue
        place = 0.0 if begin == 0 else float(places[begin])
        twice = 2.0 + 2.0 * math.cos(true.theta0 + true.phi)
        inertia = (1.0 - true.gamma) * (1.0 + true.kappa) + true.gamma * twice
        speed = math.sqrt(2.0 * true.g * start / inertia) if start > 0.0 else 0.0
        gusts = Force(true.mass * true.g, amplitude, length, end, force)
        found = replace(true, gusts=gusts, release_place=place, release_speed=speed)
        if solve(found, LONGEST).first_rest < LONGEST:
            return found


def _falling(energy: FloatArray, x: FloatArray, first: int) -> tuple[FloatArray, FloatArray]:
    """Energies and places about the first place behind `first` where none is left, rising."""
    last = first + int(np.argmin(energy[first:] > 0.0))
    return energy[[last, last - 1]], x[[last, last - 1]]


def of_usual_scales(rng: Rng, t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Length scale and clock off by what an analysis takes for usual."""
    return (1.0 + 0.0005 * rng.standard_normal()) * t, (1.0 + 0.003 * rng.standard_normal()) * x


_WEIGHT = BASE.mass * BASE.g * BASE.radius  # N m
DISTURBANCES: dict[str, Disturbance] = {
    "none": Disturbance("nothing"),
    "ar1-5": Disturbance("AR(1) noise, .5", camera=Camera(noise=ar1(0.5))),
    "ar1-9": Disturbance("AR(1) noise, .9", camera=Camera(noise=ar1(0.9))),
    "jitter": Disturbance("frames off by 3 ms (sd)", camera=Camera(jitter=0.003)),
    "clock": Disturbance("clock 1 % fast", camera=Camera(scale_t=0.01)),
    "viscous": Disturbance("viscous drag .1/s", changed(viscous=0.1 * BASE.mass)),
    "quadratic": Disturbance("quadratic drag .2/m", changed(quadratic=0.2 * BASE.mass)),
    "load": Disturbance(
        "resistance .006 of the load felt", changed(load_resistance=0.006, rolling_resistance=0.0)
    ),
    "once": Disturbance(
        "moment once per turn, .005",
        lambda rng, base: replace(base, once=(0.005 * _WEIGHT, rng.uniform(0.0, 6.28))),
    ),
    "twice": Disturbance(
        "moment twice per turn, .005",
        lambda rng, base: replace(base, twice=(0.005 * _WEIGHT, rng.uniform(0.0, 6.28))),
    ),
    "push": Disturbance("released at .1 m/s", changed(release_speed=0.1)),
    "sag": Disturbance("ramp sags .5 mm on .5 m", sagging(0.0005, 0.5, 0.03)),
    "ramp": Disturbance("ramp +-2 mm", curved),
    "scale": Disturbance("length scale 1 % long", camera=Camera(scale_x=0.01)),
    "scale-2": Disturbance("length scale 2 % long", camera=Camera(scale_x=0.02)),
    "distortion": Disturbance("image bowed by 5 mm", camera=Camera(bow=0.005)),
    "radius": Disturbance("radius stated 5 % large", factors={"radius": 1.05}),
    "g": Disturbance("g stated 9.81, true 9.78", changed(g=9.78), factors={"g": 9.81 / 9.78}),
    "stated": Disturbance("gamma stated 5 sd high", shifts={"gamma": 5.0}),
    "sign": Disturbance("tilt stated with the wrong sign", factors={"phi": -1.0}),
    "dropped": Disturbance("one frame lost unnoticed", camera=Camera(after=dropped)),
    "jump": Disturbance("a step of 5 mm", camera=Camera(after=jump)),
    "drift": Disturbance("camera drifts by 5 mm", camera=Camera(after=drifting)),
    "pixels": Disturbance("pixels of 5 mm", camera=Camera(after=pixels(0.005))),
    "smoothing": Disturbance("moving mean of 5 frames", camera=Camera(after=smoothed)),
    "heteroscedastic": Disturbance("errors .3 to 3 mm, by speed", camera=Camera(noise=uneven)),
    "blur": Disturbance("motion blur of a frame", camera=Camera(noise=blurred)),
    "outliers": Disturbance("5 % outliers", camera=Camera(after=with_outliers)),
    "prior": Disturbance(
        "all drawn from the prior", from_prior, Camera(after=of_usual_scales), drawn=True
    ),
    "few": Disturbance("10 frames", camera=Camera(interval=0.12)),
}


def film(disturbance: Disturbance, truth: Truth, rng: Rng) -> tuple[FloatArray, FloatArray]:
    """Times (s) and positions (m) in the table, from a random moment in the first interval to the
    turning point.
    """
    camera = disturbance.camera
    motion = solve(truth, LONGEST)
    frames = np.arange(
        rng.uniform(0.0, camera.interval), min(motion.first_rest, LONGEST), camera.interval
    )
    moments = frames + camera.jitter * rng.standard_normal(frames.size)
    x, v = motion(np.maximum(moments, 0.0))
    p = (x + 0.05) / PICTURE
    x = (1.0 + camera.scale_x) * x + 4.0 * camera.bow * (
        p * (1.0 - p) - 0.05 / PICTURE * (1.0 - 0.05 / PICTURE)
    )
    return camera.after(rng, (1.0 + camera.scale_t) * frames, x + camera.noise(rng, v))


def stated(name: str, u: float | None, truth: Truth, disturbance: Disturbance, rng: Rng) -> str:
    """What is stated of one quantity with the uncertainty `u`, as TOML."""
    known = disturbance.drawn or (name == "g" and "g" not in disturbance.factors)
    value = getattr(BASE if known else truth, name)
    off = 0.0 if disturbance.drawn else rng.standard_normal()
    value = (
        value + (u or 0.0) * (off + disturbance.shifts.get(name, 0.0))
    ) * disturbance.factors.get(name, 1.0)
    return (
        '{prior = "uniform", low = 0.0, high = 1.0}'
        if u is None
        else f"{value!r}"
        if u == 0.0
        else f'"{value:.9f} +/- {u:.9f}"'
    )


def write_campaign(
    folder: Path, disturbance: Disturbance, *, priors: str, noise: str, rng: Rng
) -> dict[str, float]:
    """Write campaign.toml and a table of each run to `folder`; the true values of what is fit: of
    the body, then of each run, as `FREE` has them.

    That of the rolling resistance is its average over the (longest) track, with all that resists
    beside it: what a fit with an unmodelled force calls c_rr.
    noise : of `NOISES`, or `JOINT`.
    """
    truth = disturbance.motion(rng, BASE)
    runs = (
        {f"r{i + 1}": replace(truth, phi=truth.phi + tilt) for i, tilt in enumerate(TILTS)}
        if noise == JOINT
        else {"r": truth}
    )
    last: dict[str, tuple[float, float]] = {}
    for run, own in runs.items():
        t, x = film(disturbance, own, rng)
        table = "".join(f"{moment:.6f},{place:.6f}\n" for moment, place in zip(t, x, strict=True))
        (folder / f"{run}.csv").write_text("t_s,x_m\n" + table, encoding="utf-8")
        last[run] = float(x[-1]), float(t[-1])
    owners = {name: runs.values() if name in OF_RUN else [truth] for name in PRIORS[priors]}
    said = {
        name: [stated(name, u, own, disturbance, rng) for own in owners[name]]
        for name, u in PRIORS[priors].items()
    }
    tables = "".join(
        f"""[[runs]]
name = "{run}"
body = "b"
file = "{run}.csv"
phi_rad = {phi}
theta0_rad = {theta0}
noise = {NOISES["speeds" if noise == JOINT else noise]}
"""
        for run, phi, theta0 in zip(runs, said["phi"], said["theta0"], strict=True)
    )
    (folder / "campaign.toml").write_text(
        f"""# SYNTHETIC data, solved by SciPy: {disturbance.words}.
title = "{disturbance.words}"
kind = "synthetic"
[shared]
g = {said["g"][0]}
radius_m = {said["radius"][0]}
rolling_resistance = {{prior = "half-normal", scale = 0.005}}
[bodies.b]
gamma = {said["gamma"][0]}
kappa = {said["kappa"][0]}
{tables}""",
        encoding="utf-8",
    )
    if disturbance.drawn:
        return {
            **{
                f"{name}[{'b' if name not in OF_RUN else 'r'}]": getattr(truth, name)
                for name in FREE[:-1]
            },
            FREE[-1]: truth.rolling_resistance,
        }
    longest = max(last, key=last.__getitem__)
    found = {"gamma[b]": truth.gamma, "kappa[b]": truth.kappa}
    found |= {f"{name}[{run}]": getattr(own, name) for name in OF_RUN for run, own in runs.items()}
    return {
        **found,
        "rolling_resistance": solve(runs[longest], LONGEST).average_resistance(last[longest][1]),
    }
