"""From the table of a run to the speeds that are fit and their noise, as the campaign's noise and window tables say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.campaign_file import NoiseTable, WindowTable
from estim.derivative import STENCILS, differentiate
from estim.errors import InputError
from estim.levels import Levels, Path, as_prior, noise_level, read_at
from estim.noise import Differentiated, Independent, Noise, Scale
from estim.priors import HalfNormal
from estim.problem import Parameter
from estim.quantity import Quantity
from estim.run import Run
from estim.selection import Selection, Window, select

FloatArray = NDArray[np.float64]

_MIN_OBS = 5
_MAX_OBS = 3000  # the covariance of the speeds is a dense matrix


@dataclass(frozen=True, eq=False)
class Speeds:
    """Position, speed and time of the rows that are fit, (n_obs,) each; what was left out; noise and its unknowns."""

    x: FloatArray
    y: FloatArray
    t: FloatArray | None
    noise: Noise
    parameters: tuple[Parameter, ...]
    excluded: tuple[str, ...]
    excluded_points: FloatArray


@dataclass(frozen=True, eq=False)
class _Units:
    """Keys and units of a run in metres or in radians."""

    position_sigma: str
    speed_sigma: str
    position: str
    speed: str


_UNITS = {
    "x_m": _Units("sigma_x_m", "sigma_v_m_s", "m", "m/s"),
    "theta_rad": _Units("sigma_theta_rad", "sigma_omega_rad_s", "rad", "rad/s"),
}


def observe(run: Run, levels: Levels) -> Speeds:
    """The speeds of `run` with the noise that the campaign states for it.  Raises InputError."""
    table, path, suffix = noise_level(levels)
    model = table.model or ("differentiated" if "t_s" in run.columns else "independent")
    _check_keys(table, model, _UNITS[run.coordinate], levels, path)
    make = _differentiated if model == "differentiated" else _independent
    return make(run, levels, table, path, suffix)


def _check_keys(table: NoiseTable, model: str, units: _Units, levels: Levels, path: Path) -> None:
    if model == "differentiated":
        keys = {"model", "scatter", "derivative", "encoder_step_rad" if units.position == "rad" else "", units.position_sigma}
    else:
        keys = {"model", "scatter", units.speed_sigma}
    for key in table.__struct_fields__:
        if key not in keys and getattr(table, key) is not None:
            known = ", ".join(sorted(keys - {""}))
            raise levels.error(f"does not go with {model} noise of a run in {units.position} (known: {known})", (*path, key))


def _differentiated(run: Run, levels: Levels, table: NoiseTable, path: Path, suffix: str) -> Speeds:
    units = _UNITS[run.coordinate]
    if "t_s" not in run.columns:
        raise levels.error("needs times: the run's file has no t_s column", (*path, "model"), value="differentiated")
    step = table.encoder_step_rad or 0.0
    if table.encoder_step_rad is not None and not (step > 0.0 and math.isfinite(step)):
        raise levels.error("must be > 0", (*path, "encoder_step_rad"), value=step)
    sigma, parameter = _scale(table, units.position_sigma, units.position, levels, path, suffix, "one position reading")
    typical = math.hypot(sigma.value if parameter is None else parameter.prior.centre, step / math.sqrt(12.0))
    if typical == 0.0:
        wanted = f"'{units.position_sigma}'" + (" or 'encoder_step_rad'" if units.position == "rad" else "")
        raise levels.error(f"needs {wanted} for differentiated noise", path, field="noise")
    scatter, scatter_parameter = _scale(table, "scatter", units.speed, levels, path, suffix, "further independent error of each speed")
    if "sigma_x_m" in run.columns:
        rule = f"is not used: differentiated noise takes one '{units.position_sigma}' for all positions; start the column's name with _ to skip it"
        raise InputError(rule, field="sigma_x_m", file=run.file)
    t, position = run.columns["t_s"], run.columns[run.coordinate]
    derivative = differentiate(t, position, STENCILS[table.derivative or "central"], file=run.file, lines=run.lines)
    rows = derivative.rows
    selection = select(position[rows], derivative.value, t[rows], window=_window(run, levels), sigma_position=typical)
    _check_count(selection, run, levels)
    missing = run.n_row - rows.size
    blank = (f"{missing} at the ends or beside a missing frame, where the {derivative.stencil.name} derivative does not exist",) if missing else ()
    kept = rows[selection.kept]
    return Speeds(
        x=position[kept], y=derivative.value[selection.kept], t=t[kept],
        noise=Differentiated(sigma, scatter, step, derivative, selection.kept),
        parameters=tuple(p for p in (parameter, scatter_parameter) if p is not None),
        excluded=blank + selection.reasons, excluded_points=_others(position[rows], derivative.value, selection),
    )


def _independent(run: Run, levels: Levels, table: NoiseTable, path: Path, suffix: str) -> Speeds:
    units, rate = _UNITS[run.coordinate], run.rate
    if rate not in run.columns:
        raise levels.error(f"needs measured speeds: the run's file has no {rate} column", (*path, "model"), value="independent")
    sigma, parameter = _scale(table, units.speed_sigma, units.speed, levels, path, suffix, "one speed")
    scatter, scatter_parameter = _scale(table, "scatter", units.speed, levels, path, suffix, "further independent error of each speed")
    position, speed = run.columns[run.coordinate], run.columns[rate]
    t = run.columns.get("t_s")
    selection = select(position, speed, t, window=_window(run, levels), sigma_position=0.0)
    _check_count(selection, run, levels)
    kept = selection.kept
    relative = np.ones(kept.size)
    stated = run.columns.get("sigma_v_m_s")
    for name in ("sigma_x_m",) if units.position == "m" else ("sigma_x_m", "sigma_v_m_s"):
        if name in run.columns:
            rule = f"does not go with independent noise of a run in {units.position}; start the column's name with _ to skip it"
            raise InputError(rule, field=name, file=run.file)
    said = sigma.parameter is not None or sigma.value > 0.0
    if stated is not None and said:
        raise levels.error(f"is stated twice: here and in the sigma_v_m_s column of {run.file}", (*path, units.speed_sigma))
    if stated is not None:
        sigma, relative = Scale(1.0), stated[kept]
    elif not said and scatter.parameter is None and scatter.value == 0.0:
        raise levels.error(f"needs '{units.speed_sigma}', a sigma_v_m_s column or 'scatter' for independent noise", path, field="noise")
    return Speeds(
        x=position[kept], y=speed[kept], t=None if t is None else t[kept], noise=Independent(sigma, scatter, relative),
        parameters=tuple(p for p in (parameter, scatter_parameter) if p is not None),
        excluded=selection.reasons, excluded_points=_others(position, speed, selection),
    )


def _scale(
    table: NoiseTable, key: str, unit: str, levels: Levels, path: Path, suffix: str, of_what: str
) -> tuple[Scale, Parameter | None]:
    """A standard deviation of the noise table: fixed, or a parameter where it has an uncertainty or a prior."""
    written = getattr(table, key)
    if written is None:
        return Scale(0.0), None
    value = read_at(levels.source, written, (*path, key))
    if isinstance(value, Quantity) and value.exact:
        if value.value <= 0.0:
            raise levels.error("must be > 0", (*path, key), value=value.value)
        return Scale(value.value), None
    prior = as_prior(value, low=0.0) if isinstance(value, Quantity) else value
    if prior.low < 0.0 and not isinstance(value, Quantity):
        raise levels.error("is a standard deviation: its prior must not reach below 0", (*path, key))
    if prior.low == 0.0 and key != "scatter" and isinstance(prior, HalfNormal) is False and prior.centre <= 0.0:
        raise levels.error("must be > 0", (*path, key), value=prior.centre)
    name = "_".join(part for part in key.split("_") if part in ("sigma", "x", "v", "theta", "omega", "scatter")) + suffix
    return Scale(parameter=name), Parameter(name, unit, prior, f"standard deviation of {of_what}" if key != "scatter" else of_what)


def _window(run: Run, levels: Levels) -> Window:
    """Limits of the most particular window table, in the run's own coordinate."""
    for level in levels:
        if level.table.window is not None:
            return _read_window(level.table.window, run, levels, (*level.path, "window"))
    return Window(-math.inf, math.inf, -math.inf, math.inf)


def _read_window(table: WindowTable, run: Run, levels: Levels, path: Path) -> Window:
    here, other = (("x_min_m", "x_max_m"), ("theta_min_rad", "theta_max_rad"))[:: 1 if run.coordinate == "x_m" else -1]
    for key in other:
        if getattr(table, key) is not None:
            raise levels.error(f"does not fit a run whose positions are {run.coordinate}", (*path, key))
    if "t_s" not in run.columns and (table.t_min_s is not None or table.t_max_s is not None):
        raise levels.error("needs times: the run's file has no t_s column", path, field="window")

    def limit(key: str, otherwise: float) -> float:
        number = getattr(table, key)
        if number is not None and not math.isfinite(number):
            raise levels.error("must be finite", (*path, key), value=number)
        return otherwise if number is None else float(number)

    window = Window(limit("t_min_s", -math.inf), limit("t_max_s", math.inf), limit(here[0], -math.inf), limit(here[1], math.inf))
    if window.low >= window.high or window.t_min >= window.t_max:
        raise levels.error("must have its lower limits below its upper ones", path, field="window")
    return window


def _check_count(selection: Selection, run: Run, levels: Levels) -> None:
    count = selection.kept.size
    if not _MIN_OBS <= count <= _MAX_OBS:
        rule = f"must leave between {_MIN_OBS} and {_MAX_OBS} of the {run.n_row} rows of {run.file} to fit"
        raise levels.error(rule, ("runs", levels.index, "window"), field="window", value=count)


def _others(position: FloatArray, speed: FloatArray, selection: Selection) -> FloatArray:
    others = np.setdiff1d(np.arange(position.size), selection.kept)
    return np.column_stack([position[others], speed[others]])
