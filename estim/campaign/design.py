"""A synthetic campaign from a design: the mirror image of `campaign.py`, and the only other file
that imports `model`.

The true values go to `truth.toml`, which no fit reads.  The campaign holds what a laboratory would
have: measured values, each the truth plus a normal error of its stated uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from estim.campaign.campaign_file import checked
from estim.campaign.key_table import KeyTable
from estim.campaign.name_rules import check_body_names, check_run_names
from estim.campaign.toml_text import toml_key, toml_text
from estim.common import one_line
from estim.model import Body, ascends, theta_min
from estim.model.simulate import (
    film_time,
    frame_times,
    simulate_positions,
    simulate_theta_min,
    simulate_trials,
)
from estim.reading import TOML_BYTES, Places, parse_toml, read_text

_MOST_RADII = 1e4  # length of the ramp
_FRAMES = (6, 100_000)  # of a run
# an uncertainty, in the unit of its key; all limits are wider than any laboratory
Size = Annotated[float, Meta(gt=0.0, le=1e3)]
Angle = Annotated[float, Meta(ge=-360.0, le=360.0)]
Tilts = list[Annotated[float, Meta(ge=-90.0, le=90.0)]]
Scatter = Annotated[float, Meta(ge=0.0, le=45.0)]


class ConstantsTable(KeyTable, frozen=True):
    g: Annotated[float, Meta(ge=1e-3, le=1e3)]
    radius_m: Annotated[float, Meta(ge=1e-4, le=1e3)]
    mass_disk_kg: Annotated[float, Meta(ge=1e-6, le=1e6)]
    kappa: Annotated[float, Meta(gt=0.0, le=1.0)]
    ramp_length_m: Annotated[float, Meta(ge=1e-4, le=1e4)]
    rolling_resistance: Annotated[float, Meta(ge=0.0, le=1.0)]


class InstrumentsTable(KeyTable, frozen=True):
    frames_per_second: Annotated[float, Meta(ge=1e-3, le=1e6)]
    sigma_x_m: Size
    u_phi_deg: Size
    u_theta0_deg: Size
    u_theta_min_deg: Size
    u_radius_m: Size
    u_mass_disk_kg: Size
    u_gamma: Size


class BodyTable(KeyTable, frozen=True):
    gamma: Annotated[float, Meta(gt=0.0, lt=1.0)]


class RunDesign(KeyTable, frozen=True):
    name: str
    body: str
    phi_deg: Angle
    theta0_deg: Angle


class LineDesign(KeyTable, frozen=True):
    body: str
    phi_deg: Tilts


class TrialsDesign(KeyTable, frozen=True):
    """Trials of release at both ends, as `estim.model.simulate.simulate_trials` makes them."""

    body: str
    phi_deg: Tilts
    expected_gamma: Annotated[float, Meta(ge=0.001, le=1.0)]
    trials_each: Annotated[int, Meta(ge=1, le=1000)]
    step_deg: Annotated[float, Meta(ge=0.01, le=45.0)]
    scatter_deg: Scatter
    release_deg: Scatter


class Design(KeyTable, frozen=True):
    """A design as it stands in its TOML file; units are in the keys."""

    title: str
    seed: Annotated[int, Meta(ge=0)]
    constants: ConstantsTable
    instruments: InstrumentsTable
    bodies: dict[str, BodyTable]
    runs: list[RunDesign]
    line: LineDesign
    trials: TrialsDesign | None = None
    published: str | None = None


@dataclass(frozen=True, eq=False)
class LoadedDesign:
    """A design, the SHA-256 of its file, and the name to quote it by."""

    design: Design
    sha256: str
    name: str


def load_design(path: str | Path) -> LoadedDesign:
    """The design in the TOML file at `path`.  Raises InputError with file, line, key, rule and
    value.
    """
    text, digest = read_text(Path(path), limit=TOML_BYTES)
    tree, places = parse_toml(text, str(path))
    design = checked(tree, Design, places, ())
    if design.constants.ramp_length_m > _MOST_RADII * design.constants.radius_m:
        raise places.error(
            f"must be at most {_MOST_RADII:g} radii",
            ("constants", "ramp_length_m"),
            value=design.constants.ramp_length_m,
        )
    _check_runs(design, places)
    return LoadedDesign(design, digest, Path(path).name)


def _check_runs(design: Design, places: Places) -> None:
    """Every run starts and has a name of its own that is a file name; every tilt of the line has a
    smallest angle.
    """
    check_run_names([run.name for run in design.runs], places)
    check_body_names(design.bodies, places)
    resistance = design.constants.rolling_resistance
    for i, run in enumerate(design.runs):
        if run.body not in design.bodies:
            raise places.error("must name one of the bodies", ("runs", i, "body"), value=run.body)
        phi, theta0 = np.radians([run.phi_deg, run.theta0_deg])
        if not ascends(
            _body(design, run.body), phi=phi, theta0=theta0, rolling_resistance=resistance
        ):
            raise places.error(
                "must be an angle from which the body ascends",
                ("runs", i, "theta0_deg"),
                value=run.theta0_deg,
            )
        n_frame = design.instruments.frames_per_second * film_time(
            **_motion(design, run), x_end=design.constants.ramp_length_m
        )
        if not _FRAMES[0] <= n_frame <= _FRAMES[1]:
            raise places.error(
                f"must give run '{run.name}' between {_FRAMES[0]} and {_FRAMES[1]} frames "
                "before it stops or passes the ramp's end",
                ("instruments", "frames_per_second"),
                value=f"{n_frame:.4g} frames",
            )
    for key, series in (("line", design.line), ("trials", design.trials)):
        if series is not None:
            _check_series(design, key, series, places)


def _check_series(
    design: Design, key: str, series: LineDesign | TrialsDesign, places: Places
) -> None:
    """The body is there and can ascend at every tilt."""
    if series.body not in design.bodies:
        raise places.error("must name one of the bodies", (key, "body"), value=series.body)
    gamma, resistance = design.bodies[series.body].gamma, design.constants.rolling_resistance
    smallest = theta_min(gamma, np.radians(series.phi_deg), rolling_resistance=resistance)
    if np.any(np.isnan(smallest)):
        steep = series.phi_deg[int(np.argmax(np.isnan(smallest)))]
        raise places.error(
            "must hold tilts at which the body can ascend", (key, "phi_deg"), value=steep
        )


def _trials_csv(design: Design, trials: TrialsDesign, rng: np.random.Generator) -> str:
    """Both ends at each tilt, with one reading of it."""
    instruments = design.instruments
    phi = np.radians(trials.phi_deg)
    readings = np.radians(
        np.round(trials.phi_deg + instruments.u_phi_deg * rng.standard_normal(phi.size), 2)
    )
    rows = []
    for largest in (False, True):
        simulated = simulate_trials(
            phi,
            design.bodies[trials.body].gamma,
            rolling_resistance=design.constants.rolling_resistance,
            u_phi=0.0,
            scatter=float(np.radians(trials.scatter_deg)),
            release=float(np.radians(trials.release_deg)),
            expected=trials.expected_gamma,
            n_trial=trials.trials_each,
            step=float(np.radians(trials.step_deg)),
            largest=largest,
            readings=readings,
            rng=rng,
        )
        rows += [
            f"{np.degrees(p):.2f},{np.degrees(a):.4g},{c:d}"
            for p, a, c in zip(*simulated, strict=True)
        ]
    return "\n".join(["phi_deg,theta_deg,climbed", *rows, ""])


def simulate_campaign(loaded: LoadedDesign) -> dict[str, str]:
    """The files of the synthetic campaign: relative path -> text.  The same design gives the same
    bytes.

    Each run has its own random stream, so that adding one leaves the others as they are.
    """
    design = loaded.design
    streams = iter(
        np.random.default_rng(design.seed).spawn(len(design.bodies) + len(design.runs) + 3)
    )
    stamp = (
        f"# SYNTHETIC data: made by `estim simulate` from {one_line(loaded.name)} (SHA-256 "
        f"{loaded.sha256}), seed {design.seed}.\n"
    )
    shared_rng = next(streams)
    shared = _shared(design, shared_rng)
    mass_disk = _measured(
        design.constants.mass_disk_kg, design.instruments.u_mass_disk_kg, shared_rng
    )
    tables = [("[shared]", shared)]
    for name, body in design.bodies.items():
        tables.append(
            (f"[bodies.{toml_key(name)}]", _body_table(design, body, mass_disk, next(streams)))
        )
    files = {"theta_min.csv": stamp + _theta_min_csv(design, next(streams))}
    for run in design.runs:
        rng = next(streams)
        files[f"runs/{run.name}.csv"] = stamp + _run_csv(design, run, rng)
        tables.append(("[[runs]]", _run_table(design, run, rng)))
    tables.append(("[line]", {"file": "theta_min.csv", "body": design.line.body}))
    if design.trials is not None:
        files["trials.csv"] = stamp + _trials_csv(design, design.trials, next(streams))
        u_phi, u_theta = design.instruments.u_phi_deg, design.instruments.u_theta_min_deg
        named = {"file": "trials.csv", "body": design.trials.body}
        tables.append(("[trials]", {**named, "u_phi_deg": u_phi, "u_theta_deg": u_theta}))
    top = {"title": design.title, "kind": "synthetic", "published": design.published}
    files["campaign.toml"] = stamp + toml_text(top, tables)
    truth = "# The true values.  No fit reads this file; tests compare with it.\n\n"
    lines = (f"{toml_key(name)} = {value}\n" for name, value in _truth(design).items())
    files["truth.toml"] = stamp + truth + "".join(lines)
    return files


def mass_particle(gamma: float, mass_disk: float) -> float:
    """Mass (kg) of a particle on the rim that gives `gamma` = M_P/(M_D + M_P)."""
    return mass_disk * gamma / (1.0 - gamma)


def _body(design: Design, name: str) -> Body:
    constants = design.constants
    return Body(radius=constants.radius_m, gamma=design.bodies[name].gamma, kappa=constants.kappa)


def _motion(design: Design, run: RunDesign) -> dict[str, Any]:
    """The body and how it moves, as arguments of `estim.model.simulate`."""
    constants = design.constants
    return {
        "body": _body(design, run.body),
        "phi": float(np.radians(run.phi_deg)),
        "theta0": float(np.radians(run.theta0_deg)),
        "rolling_resistance": constants.rolling_resistance,
        "g": constants.g,
    }


def _measured(truth: float, u: float, rng: np.random.Generator) -> str:
    """A measured value, its uncertainty to two digits."""
    from uncertainties import ufloat

    return f"{ufloat(truth + u * float(rng.standard_normal()), u):.2uS}"


def _shared(design: Design, rng: np.random.Generator) -> dict[str, object]:
    constants, instruments = design.constants, design.instruments
    return {
        "g": constants.g,
        "radius_m": _measured(constants.radius_m, instruments.u_radius_m, rng),
        "rolling_resistance": {"prior": "half-normal", "scale": 0.005},
        "ramp_length_m": constants.ramp_length_m,
        "noise": {"sigma_x_m": instruments.sigma_x_m, "derivative": "central"},
    }


def _body_table(
    design: Design, body: BodyTable, mass_disk: str, rng: np.random.Generator
) -> dict[str, object]:
    # u(gamma) = (1 - gamma)^2 u(M_P)/M_D: the particle's mass carries the paper's u(gamma)
    mass = design.constants.mass_disk_kg
    u_particle = design.instruments.u_gamma * mass / (1.0 - body.gamma) ** 2
    return {
        "mass_disk_kg": mass_disk,
        "mass_particle_kg": _measured(mass_particle(body.gamma, mass), u_particle, rng),
        "kappa": {"prior": "uniform", "low": 0.0, "high": 1.0},
    }


def _run_table(design: Design, run: RunDesign, rng: np.random.Generator) -> dict[str, object]:
    return {
        "name": run.name,
        "body": run.body,
        "file": f"runs/{run.name}.csv",
        "phi_deg": _measured(run.phi_deg, design.instruments.u_phi_deg, rng),
        "theta0_deg": _measured(run.theta0_deg, design.instruments.u_theta0_deg, rng),
    }


def _run_csv(design: Design, run: RunDesign, rng: np.random.Generator) -> str:
    constants, instruments = design.constants, design.instruments
    motion = _motion(design, run)
    t = frame_times(
        **motion,
        interval=1.0 / instruments.frames_per_second,
        x_end=constants.ramp_length_m,
        rng=rng,
    )
    x = simulate_positions(t, **motion, sigma_x=instruments.sigma_x_m, rng=rng)
    rows = (f"{ti:.5f},{xi:.5f}" for ti, xi in zip(t - t[0], x, strict=True))
    return (
        "# t_s: time since the first frame after the release; x_m: distance along the ramp "
        "from the release\n" + "\n".join(["t_s,x_m", *rows, ""])
    )


def _theta_min_csv(design: Design, rng: np.random.Generator) -> str:
    constants, instruments, line = design.constants, design.instruments, design.line
    u_phi, u_theta = instruments.u_phi_deg, instruments.u_theta_min_deg
    phi, angle = simulate_theta_min(
        np.radians(line.phi_deg),
        design.bodies[line.body].gamma,
        rolling_resistance=constants.rolling_resistance,
        u_phi=float(np.radians(u_phi)),
        u_theta_min=float(np.radians(u_theta)),
        rng=rng,
    )
    rows = (
        f"{p:.2f},{a:.2f},{u_phi},{u_theta}"
        for p, a in zip(np.degrees(phi), np.degrees(angle), strict=True)
    )
    return "\n".join(["phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg", *rows, ""])


def _truth(design: Design) -> dict[str, object]:
    constants = design.constants
    values: dict[str, object] = {
        "radius": constants.radius_m,
        "rolling_resistance": constants.rolling_resistance,
        "g": constants.g,
    }
    for name, body in design.bodies.items():
        values |= {f"gamma[{name}]": body.gamma, f"kappa[{name}]": constants.kappa}
    for run in design.runs:
        for name, angle in (("theta0", run.theta0_deg), ("phi", run.phi_deg)):
            values[f"{name}[{run.name}]"] = f"{np.radians(angle):.12f}"
    return values
