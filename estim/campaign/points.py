"""From the table of a run to the points that are fit and their noise, as the campaign's noise and
window tables state.

Speeds at known positions (`independent`, `differentiated`), or positions at known times
(`positions`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.campaign.blur import relative_blur
from estim.campaign.campaign_file import NoiseTable
from estim.campaign.lookup_levels import Levels, StatedNoise, stated_noise
from estim.campaign.plausible import check_reading_error
from estim.campaign.prior_table import read_source
from estim.campaign.row_selection import MAX_OBS, Selection, Window, check_count, select
from estim.common import Finding, InputError, Kind, Notation, phrase
from estim.curves import MAX_DENSE
from estim.problem import (
    STENCILS,
    Derivative,
    Differentiated,
    Independent,
    Noise,
    Normal,
    Parameter,
    Rows,
    Scale,
    Uniform,
    differentiate,
    shape_of,
)
from estim.reading import Run

_SCALES = {  # key -> parameter and symbol
    "sigma_x_m": ("sigma_x", "σ_x"),
    "sigma_v_m_s": ("sigma_v", "σ_v"),
    "sigma_theta_rad": ("sigma_theta", "σ_θ"),
    "sigma_omega_rad_s": ("sigma_omega", "σ_ω"),
    "scatter": ("scatter", "scatter"),
}


@dataclass(frozen=True, eq=False)
class Observed:
    """The points that are fit: abscissa x, ordinate y and time, (n_obs,) each; what was left out;
    noise and its unknowns.

    rows : where the readings stand that they are or are made of.
    positions : whether the points are positions at known times.
    arguments : of the curve that are not physics (offset, and release_time of positions): a
        parameter's name or a fixed number.
    """

    x: FloatArray
    y: FloatArray
    t: FloatArray | None
    noise: Noise
    parameters: tuple[Parameter, ...]
    arguments: Mapping[str, str | float]
    excluded: tuple[Finding, ...]
    excluded_points: FloatArray
    rows: Rows
    positions: bool = False


@dataclass(frozen=True, eq=False)
class _Units:
    """Keys and units of a run in metres or in radians."""

    position_sigma: str
    speed_sigma: str
    position: str
    speed: str
    offset: str


_UNITS = {
    "x_m": _Units("sigma_x_m", "sigma_v_m_s", "m", "m/s", "offset_m"),
    "theta_rad": _Units("sigma_theta_rad", "sigma_omega_rad_s", "rad", "rad/s", "offset_rad"),
}


@dataclass(frozen=True, eq=False)
class _Size:
    """A standard deviation of a noise table, and its parameter where it is inferred."""

    scale: Scale
    parameter: Parameter | None = None

    @property
    def typical(self) -> float:
        """As stated, or where its prior has its centre."""
        return self.scale.value if self.parameter is None else self.parameter.prior.centre

    @property
    def stated(self) -> bool:
        return self.typical > 0.0

    @property
    def absent(self) -> bool:
        return self.parameter is None and self.scale.value == 0.0


def observe(run: Run, levels: Levels, *, noise: NoiseTable | None = None) -> Observed:
    """The points of `run` with the noise that the campaign states for it, or with `noise` in its
    place.  Raises InputError.
    """
    stated = stated_noise(levels)
    stated = replace(stated, table=noise or stated.table)
    model = stated.table.model or ("differentiated" if "t_s" in run.columns else "independent")
    _check_keys(run, stated, model)
    make = {
        "differentiated": _differentiated,
        "independent": _independent,
        "positions": _positions,
    }[model]
    observed = make(run, stated)
    if not run.left_out:
        return observed
    return replace(
        observed, excluded=(Finding(Kind.LEFT_OUT, size=run.left_out), *observed.excluded)
    )


def _check_keys(run: Run, noise: StatedNoise, model: str) -> None:
    units = _UNITS[run.coordinate]
    keys = {"model", "scatter", units.position_sigma}
    if model == "independent":
        keys |= {units.speed_sigma, "robust"} | (
            set() if run.rate in run.columns else {"derivative"}
        )
    else:
        keys |= {"exposure_s", "derivative" if model == "differentiated" else "robust"} | (
            {"encoder_step_rad"} if units.position == "rad" else set()
        )
    for key in noise.table.__struct_fields__:
        if key not in keys and getattr(noise.table, key) is not None:
            rule = (
                f"does not go with {model} noise of a run in {units.position} (known: "
                f"{', '.join(sorted(keys))})"
            )
            if key == "robust":
                rule = (
                    "requires model = 'positions' or 'independent': one bad frame affects "
                    "several differentiated speeds"
                )
            raise noise.error(rule, key)
    if model != "independent" and "t_s" not in run.columns:
        raise noise.error("needs times: the run's file has no t_s column", "model", value=model)


def _differentiated(run: Run, noise: StatedNoise) -> Observed:
    units, table = _UNITS[run.coordinate], noise.table
    sigma, step = _reading(run, noise)
    typical = math.hypot(sigma.typical, step / math.sqrt(12.0))
    if typical == 0.0:
        keys = f"'{units.position_sigma}'" + (
            " or 'encoder_step_rad'" if units.position == "rad" else ""
        )
        raise noise.error(f"needs {keys} for differentiated noise")
    scatter = _scatter_of_speeds(run, noise)
    check_reading_error(sigma.scale, run, noise)
    if "sigma_x_m" in run.columns:
        raise InputError(
            f"is not used: differentiated noise takes one '{units.position_sigma}' for all "
            "positions; start the column's name with _ to skip it",
            field="sigma_x_m",
            file=run.file,
        )
    t, position = run.columns["t_s"], run.position
    blur = relative_blur(run, noise, np.full(run.n_row, 0.0 if sigma.parameter else typical))
    derivative, blank = _speeds(run, table)
    rows = derivative.rows
    selection = select(
        position[rows],
        derivative.value,
        t[rows],
        window=_window(run, noise.levels),
        sigma_position=typical,
    )
    in_bands = scatter.parameter is None and (sigma.parameter is None or scatter.scale.value == 0.0)
    check_count(selection, run, noise.levels, blank, most=MAX_OBS if in_bands else MAX_DENSE)
    selected = rows[selection.indices]
    zero, zero_parameter = _stated_offset(noise.levels, units)
    return Observed(
        x=position[selected],
        y=derivative.value[selection.indices],
        t=t[selected],
        noise=Differentiated(
            sigma.scale,
            scatter.scale,
            step,
            derivative,
            selection.indices,
            blur,
            table.exposure_s or 0.0,
        ),
        parameters=_some(zero_parameter, sigma.parameter, scatter.parameter),
        arguments=zero,
        excluded=blank + selection.reasons,
        excluded_points=_others(position[rows], derivative.value, selection),
        rows=Rows(t, run.lines, selected, position),
    )


def _independent(run: Run, noise: StatedNoise) -> Observed:
    units, rate, table = _UNITS[run.coordinate], run.rate, noise.table
    t, position = run.columns.get("t_s"), run.position
    rows, blank, gain = np.arange(run.n_row), tuple[Finding, ...](), math.inf
    if rate in run.columns:
        speed = run.columns[rate]
    elif t is not None and table.derivative is not None:
        derivative, blank = _speeds(run, table)
        rows = derivative.rows
        speed = derivative.value
        gain = derivative.stencil.noise_gain / derivative.interval
    else:
        raise noise.error(
            f"needs measured speeds: the run's file has no {rate} column (or a 'derivative' to "
            "compute them)",
            "model",
            value="independent",
        )
    sigma = _size(noise, units.speed_sigma, units.speed, phrase("standard deviation of one speed"))
    scatter = _scatter_of_speeds(run, noise)
    sigma_x = _size(
        noise, units.position_sigma, units.position, phrase("standard deviation of one position")
    )
    tails, tail_parameters = shape_of(table.robust, noise.suffix)
    scale_x, relative_x = _by_row(run, "sigma_x_m", sigma_x, units.position_sigma, noise)
    if not sigma.stated and "sigma_v_m_s" not in run.columns and scatter.absent:
        raise noise.error(
            f"needs '{units.speed_sigma}', a sigma_v_m_s column or 'scatter' for independent noise"
        )
    scale, relative = _by_row(run, "sigma_v_m_s", sigma, units.speed_sigma, noise)
    guard = sigma_x.typical if relative_x is None else float(np.median(relative_x))
    # of speeds made by differences the error of a position follows from that of a speed: the same
    # guard zones as `differentiated`
    reading = guard or sigma.typical / gain
    where, when = position[rows], None if t is None else t[rows]
    selection = select(
        where, speed, when, window=_window(run, noise.levels), sigma_position=reading
    )
    check_count(selection, run, noise.levels, blank)
    selected = selection.indices
    t_selected = None if when is None else when[selected]
    zero, zero_parameter = _stated_offset(noise.levels, units)
    return Observed(
        x=where[selected],
        y=speed[selected],
        t=t_selected,
        noise=Independent(
            sigma=scale,
            scatter=scatter.scale,
            relative=np.ones(selected.size) if relative is None else relative[rows][selected],
            sigma_x=scale_x if guard > 0.0 else None,
            relative_x=None if relative_x is None else relative_x[rows][selected],
            tails=tails,
        ),
        parameters=_some(
            zero_parameter, sigma.parameter, scatter.parameter, sigma_x.parameter, *tail_parameters
        ),
        arguments=zero,
        excluded=blank + selection.reasons,
        excluded_points=_others(where, speed, selection),
        rows=Rows.of_points(selected.size, t_selected, run.lines[rows[selected]]),
    )


def _positions(run: Run, noise: StatedNoise) -> Observed:
    """Every frame inside the window, on both ways.

    Unless the campaign states otherwise the moment of release is unknown, and the zero of the
    positions as good as one reading.
    """
    units, levels, table = _UNITS[run.coordinate], noise.levels, noise.table
    sigma, step = _reading(run, noise)
    scatter = _size(
        noise, "scatter", units.position, phrase("additional independent error of each position")
    )
    tails, tail_parameters = shape_of(table.robust, noise.suffix)
    check_reading_error(sigma.scale, run, noise)
    if not sigma.stated and step == 0.0 and "sigma_x_m" not in run.columns and scatter.absent:
        raise noise.error(
            f"needs '{units.position_sigma}', a sigma_x_m column or 'scatter' for position noise"
        )
    scale, relative = _by_row(run, "sigma_x_m", sigma, units.position_sigma, noise)
    typical = math.hypot(sigma.typical, step / math.sqrt(12.0))
    rest = np.full(run.n_row, 0.0 if sigma.parameter else typical) if relative is None else relative
    blur = relative_blur(run, noise, rest)
    t, position = run.columns["t_s"], run.position
    selection = select(position, None, t, window=_window(run, levels), sigma_position=0.0)
    check_count(selection, run, levels)
    rows = selection.indices
    x, y = t[rows], position[rows]
    started = x[int(np.argmax(np.abs(y - y[0]) > 0.25 * np.ptp(y)))]
    zero = (typical if relative is None else float(np.median(relative))) or scatter.typical
    if blur is not None:
        relative = blur if relative is None else blur * relative
    early = float(x[0] - 0.5 * (x[-1] - x[0]))
    sources, unknowns = {}, []
    release = Parameter(
        "release_time",
        "s",
        Uniform(early, float(started)),
        phrase("time of release on the clock of the data"),
        Notation("t₀"),
    )
    for key, unknown in (("release_time_s", release), (units.offset, _offset(units, zero))):
        sources[unknown.name], of_level = _nuisance(levels, key, unknown)
        unknowns.append(of_level)
    return Observed(
        x=x,
        y=y,
        t=x,
        arguments=sources,
        noise=Independent(
            sigma=scale,
            scatter=scatter.scale,
            relative=np.ones(rows.size) if relative is None else relative[rows],
            encoder_step=step,
            tails=tails,
            exposure=table.exposure_s or 0.0,
        ),
        positions=True,
        parameters=_some(*unknowns, sigma.parameter, scatter.parameter, *tail_parameters),
        excluded=selection.reasons,
        excluded_points=_others(t, position, selection),
        rows=Rows.of_points(x.size, x, run.lines[rows]),
    )


def _some(*parameters: Parameter | None) -> tuple[Parameter, ...]:
    return tuple(p for p in parameters if p is not None)


def _reading(run: Run, noise: StatedNoise) -> tuple[_Size, float]:
    """The standard deviation of one position as it is read, and the step of an encoder, 0 where
    there is none.
    """
    units, meaning = _UNITS[run.coordinate], phrase("standard deviation of one position reading")
    size = _size(noise, units.position_sigma, units.position, meaning)
    return size, noise.table.encoder_step_rad or 0.0


def _scatter_of_speeds(run: Run, noise: StatedNoise) -> _Size:
    meaning = phrase("additional independent error of each speed")
    return _size(noise, "scatter", _UNITS[run.coordinate].speed, meaning)


def _speeds(run: Run, table: NoiseTable) -> tuple[Derivative, tuple[Finding, ...]]:
    """Speeds by differences, and how many frames have none."""
    stencil = STENCILS[table.derivative or "central"]
    derivative = differentiate(
        run.columns["t_s"], run.position, stencil, file=run.file, lines=run.lines
    )
    missing = run.n_row - derivative.rows.size
    return derivative, (
        Finding(Kind.NO_DERIVATIVE, test=stencil.name, size=missing),
    ) if missing else ()


def _by_row(
    run: Run, column: str, size: _Size, key: str, noise: StatedNoise
) -> tuple[Scale, FloatArray | None]:
    """A standard deviation that may stand in a column, row by row (n_row,), instead of the noise
    table.
    """
    if column not in run.columns:
        return size.scale, None
    if run.coordinate != "x_m":
        rule = "does not apply to a run in rad; start the column's name with _ to skip it"
        raise InputError(rule, field=column, file=run.file)
    if size.stated:
        raise noise.error(f"is stated twice: here and in the {column} column of {run.file}", key)
    return Scale(1.0), run.columns[column]


def _stated_offset(
    levels: Levels, units: _Units
) -> tuple[dict[str, str | float], Parameter | None]:
    """The zero of the positions for speeds: exact unless the campaign states it."""
    if levels.first(units.offset) is None:
        return {}, None
    source, parameter = _nuisance(levels, units.offset, _offset(units, 1.0))
    return {"offset": source}, parameter


def _offset(units: _Units, sd: float) -> Parameter:
    return Parameter(
        "offset",
        units.position,
        Normal(0.0, sd),
        phrase("reading of the position at release"),
        Notation("x₀"),
    )


def _nuisance(levels: Levels, key: str, unknown: Parameter) -> tuple[str | float, Parameter | None]:
    """An argument of x(t) as the campaign states it, or `unknown` as one of this run."""
    parameter = replace(unknown, name=f"{unknown.name}[{levels.run.name}]")
    level = levels.first(key)
    if level is not None:
        with levels.source.places.at((*level.path, key)):
            stated = read_source(getattr(level.table, key), field=key)
        if isinstance(stated, float):
            return stated, None
        parameter = replace(unknown, name=unknown.name + level.suffix, prior=stated)
    return parameter.name, parameter


def _size(noise: StatedNoise, key: str, unit: str, meaning: str) -> _Size:
    """A standard deviation of the noise table: fixed, or a parameter where it has an uncertainty or
    a prior.
    """
    written = getattr(noise.table, key)
    if written is None:
        return _Size(Scale())
    with noise.levels.source.places.at((*noise.path, key)):
        size = read_source(written, field=key, low=0.0)
    if isinstance(size, float):
        if size <= 0.0:
            raise noise.error("must be > 0", key, value=size)
        return _Size(Scale(size))
    if size.low < 0.0:
        raise noise.error("is a standard deviation: its prior must not reach below 0", key)
    name, symbol = _SCALES[key]
    name += noise.suffix
    return _Size(Scale(parameter=name), Parameter(name, unit, size, meaning, Notation(symbol)))


def _window(run: Run, levels: Levels) -> Window:
    """Limits of the most particular window table, in the run's own coordinate."""
    level = levels.first("window")
    if level is None or level.table.window is None:
        return Window(-math.inf, math.inf, -math.inf, math.inf)
    table, path = level.table.window, (*level.path, "window")
    own_keys, other_keys = (("x_min_m", "x_max_m"), ("theta_min_rad", "theta_max_rad"))[
        :: 1 if run.coordinate == "x_m" else -1
    ]
    for key in other_keys:
        if getattr(table, key) is not None:
            raise levels.error(
                f"does not fit a run whose positions are {run.coordinate}", (*path, key)
            )
    low, high = (getattr(table, key) for key in own_keys)
    if "t_s" not in run.columns and (table.t_min_s is not None or table.t_max_s is not None):
        raise levels.error("needs times: the run's file has no t_s column", path, field="window")
    window = Window(
        -math.inf if table.t_min_s is None else table.t_min_s,
        math.inf if table.t_max_s is None else table.t_max_s,
        -math.inf if low is None else low,
        math.inf if high is None else high,
    )
    if window.low >= window.high or window.t_min >= window.t_max:
        limits = (
            f"t {window.t_min:g} to {window.t_max:g}, {run.coordinate} {window.low:g} to "
            f"{window.high:g}"
        )
        raise levels.error(
            "must have its lower limits below its upper ones", path, field="window", value=limits
        )
    return window


def _others(position: FloatArray, speed: FloatArray, selection: Selection) -> FloatArray:
    others = np.setdiff1d(np.arange(position.size), selection.indices)
    return np.column_stack([position[others], speed[others]])
