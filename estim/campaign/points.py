"""From the table of a run to the points that are fit and their noise, as the campaign's noise and
window tables say.

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
from estim.campaign.campaign_file import NoiseTable, WindowTable
from estim.campaign.levels import Levels, Path, noise_level, read_at
from estim.campaign.plausible import check_reading_error
from estim.campaign.robust import shape_of
from estim.campaign.selection import MAX_OBS, Selection, Window, check_count, select
from estim.common import Finding, InputError, Kind, Notation, Quantity, phrase
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
    as_prior,
    differentiate,
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


def observe(run: Run, levels: Levels, *, noise: NoiseTable | None = None) -> Observed:
    """The points of `run` with the noise that the campaign states for it, or with `noise` in its
    place.  Raises InputError.
    """
    table, path, suffix = noise_level(levels)
    table = noise or table
    model = table.model or ("differentiated" if "t_s" in run.columns else "independent")
    _check_keys(table, model, run, levels, path)
    make = {
        "differentiated": _differentiated,
        "independent": _independent,
        "positions": _positions,
    }[model]
    observed = make(run, levels, table, path, suffix)
    if not run.left_out:
        return observed
    return replace(
        observed, excluded=(Finding(Kind.LEFT_OUT, size=run.left_out), *observed.excluded)
    )


def _check_keys(table: NoiseTable, model: str, run: Run, levels: Levels, path: Path) -> None:
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
    for key in table.__struct_fields__:
        if key not in keys and getattr(table, key) is not None:
            rule = (
                f"does not go with {model} noise of a run in {units.position} (known: "
                f"{', '.join(sorted(keys))})"
            )
            if key == "robust":
                rule = (
                    "requires model = 'positions' or 'independent': one bad frame affects "
                    "several differentiated speeds"
                )
            raise levels.error(rule, (*path, key))


def _differentiated(
    run: Run, levels: Levels, table: NoiseTable, path: Path, suffix: str
) -> Observed:
    units = _UNITS[run.coordinate]
    _need_times(run, "differentiated", levels, path)
    step = _encoder_step(table, levels, path)
    sigma, parameter = _scale(
        table,
        units.position_sigma,
        units.position,
        levels,
        path,
        suffix,
        phrase("standard deviation of one position reading"),
    )
    typical = _typical(sigma, parameter, step)
    if typical == 0.0:
        wanted = f"'{units.position_sigma}'" + (
            " or 'encoder_step_rad'" if units.position == "rad" else ""
        )
        raise levels.error(f"needs {wanted} for differentiated noise", path, field="noise")
    scatter, scatter_parameter = _scale(
        table,
        "scatter",
        units.speed,
        levels,
        path,
        suffix,
        phrase("additional independent error of each speed"),
    )
    check_reading_error(sigma, units.position_sigma, run.columns[run.coordinate], levels, path)
    if "sigma_x_m" in run.columns:
        rule = (
            f"is not used: differentiated noise takes one '{units.position_sigma}' for all "
            "positions; start the column's name with _ to skip it"
        )
        raise InputError(rule, field="sigma_x_m", file=run.file)
    t, position = run.columns["t_s"], run.columns[run.coordinate]
    blur = relative_blur(
        table, run, np.full(run.n_row, 0.0 if parameter else typical), levels, path
    )
    derivative, blank = _speeds(run, table)
    rows = derivative.rows
    selection = select(
        position[rows],
        derivative.value,
        t[rows],
        window=_window(run, levels),
        sigma_position=typical,
    )
    in_bands = scatter_parameter is None and (parameter is None or scatter.value == 0.0)
    check_count(selection, run, levels, blank, most=MAX_OBS if in_bands else MAX_DENSE)
    selected = rows[selection.kept]
    zero, zero_parameter = _stated_offset(levels, units)
    return Observed(
        x=position[selected],
        y=derivative.value[selection.kept],
        t=t[selected],
        noise=Differentiated(
            sigma, scatter, step, derivative, selection.kept, blur, table.exposure_s or 0.0
        ),
        parameters=_some(zero_parameter, parameter, scatter_parameter),
        arguments=zero,
        excluded=blank + selection.reasons,
        excluded_points=_others(position[rows], derivative.value, selection),
        rows=Rows(t, run.lines, selected, position),
    )


def _independent(run: Run, levels: Levels, table: NoiseTable, path: Path, suffix: str) -> Observed:
    units, rate = _UNITS[run.coordinate], run.rate
    t, position = run.columns.get("t_s"), run.columns[run.coordinate]
    rows, blank, gain = np.arange(run.n_row), tuple[Finding, ...](), math.inf
    if rate in run.columns:
        speed = run.columns[rate]
    elif t is not None and table.derivative is not None:
        derivative, blank = _speeds(run, table)
        rows = derivative.rows
        speed = derivative.value
        gain = derivative.stencil.noise_gain / derivative.interval
    else:
        rule = (
            f"needs measured speeds: the run's file has no {rate} column (or a 'derivative' to "
            "compute them)"
        )
        raise levels.error(rule, (*path, "model"), value="independent")
    sigma, parameter = _scale(
        table,
        units.speed_sigma,
        units.speed,
        levels,
        path,
        suffix,
        phrase("standard deviation of one speed"),
    )
    scatter, scatter_parameter = _scale(
        table,
        "scatter",
        units.speed,
        levels,
        path,
        suffix,
        phrase("additional independent error of each speed"),
    )
    sigma_x, x_parameter = _scale(
        table,
        units.position_sigma,
        units.position,
        levels,
        path,
        suffix,
        phrase("standard deviation of one position"),
    )
    tails, tail_parameters = shape_of(table.robust, suffix)
    typical_x = _typical(sigma_x, x_parameter, 0.0)
    sigma_x, relative_x = _by_row(
        run,
        "sigma_x_m",
        sigma_x,
        typical_x > 0.0,
        units.position,
        levels,
        (*path, units.position_sigma),
    )
    stated = run.columns.get("sigma_v_m_s")
    known = _typical(sigma, parameter, 0.0) > 0.0
    if not known and stated is None and scatter.parameter is None and scatter.value == 0.0:
        raise levels.error(
            f"needs '{units.speed_sigma}', a sigma_v_m_s column or 'scatter' for independent noise",
            path,
            field="noise",
        )
    sigma, relative = _by_row(
        run, "sigma_v_m_s", sigma, known, units.position, levels, (*path, units.speed_sigma)
    )
    guard = typical_x if relative_x is None else float(np.median(relative_x))
    # of speeds made by differences the error of a position follows from that of a speed: the same
    # guard zones as `differentiated`
    reading = guard or _typical(sigma, parameter, 0.0) / gain
    where, when = position[rows], None if t is None else t[rows]
    selection = select(where, speed, when, window=_window(run, levels), sigma_position=reading)
    check_count(selection, run, levels, blank)
    selected = selection.kept
    t_selected = None if when is None else when[selected]
    zero, zero_parameter = _stated_offset(levels, units)
    noise = Independent(
        sigma=sigma,
        scatter=scatter,
        relative=np.ones(selected.size) if relative is None else relative[rows][selected],
        sigma_x=sigma_x if guard > 0.0 else None,
        relative_x=None if relative_x is None else relative_x[rows][selected],
        tails=tails,
    )
    return Observed(
        x=where[selected],
        y=speed[selected],
        t=t_selected,
        noise=noise,
        parameters=_some(
            zero_parameter, parameter, scatter_parameter, x_parameter, *tail_parameters
        ),
        arguments=zero,
        excluded=blank + selection.reasons,
        excluded_points=_others(where, speed, selection),
        rows=Rows.of_points(selected.size, t_selected, run.lines[rows[selected]]),
    )


def _positions(run: Run, levels: Levels, table: NoiseTable, path: Path, suffix: str) -> Observed:
    """Every frame inside the window, on both ways.

    Unless the campaign says otherwise the moment of release is unknown, and the zero of the
    positions as good as one reading.
    """
    units = _UNITS[run.coordinate]
    _need_times(run, "positions", levels, path)
    step = _encoder_step(table, levels, path)
    sigma, parameter = _scale(
        table,
        units.position_sigma,
        units.position,
        levels,
        path,
        suffix,
        phrase("standard deviation of one position reading"),
    )
    scatter, scatter_parameter = _scale(
        table,
        "scatter",
        units.position,
        levels,
        path,
        suffix,
        phrase("additional independent error of each position"),
    )
    tails, tail_parameters = shape_of(table.robust, suffix)
    check_reading_error(sigma, units.position_sigma, run.columns[run.coordinate], levels, path)
    known = _typical(sigma, parameter, 0.0) > 0.0
    if (
        not known
        and step == 0.0
        and "sigma_x_m" not in run.columns
        and scatter.parameter is None
        and scatter.value == 0.0
    ):
        raise levels.error(
            f"needs '{units.position_sigma}', a sigma_x_m column or 'scatter' for position noise",
            path,
            field="noise",
        )
    sigma, relative = _by_row(
        run, "sigma_x_m", sigma, known, units.position, levels, (*path, units.position_sigma)
    )
    rest = (
        np.full(run.n_row, 0.0 if parameter else _typical(sigma, parameter, step))
        if relative is None
        else relative
    )
    blur = relative_blur(table, run, rest, levels, path)
    t, position = run.columns["t_s"], run.columns[run.coordinate]
    selection = select(position, None, t, window=_window(run, levels), sigma_position=0.0)
    check_count(selection, run, levels)
    rows = selection.kept
    x, y = t[rows], position[rows]
    started = x[int(np.argmax(np.abs(y - y[0]) > 0.25 * np.ptp(y)))]
    zero = _typical(sigma, parameter, step) if relative is None else float(np.median(relative))
    zero = zero or scatter.value or (scatter_parameter.prior.centre if scatter_parameter else 0.0)
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
            sigma=sigma,
            scatter=scatter,
            relative=np.ones(rows.size) if relative is None else relative[rows],
            encoder_step=step,
            tails=tails,
            exposure=table.exposure_s or 0.0,
        ),
        positions=True,
        parameters=_some(*unknowns, parameter, scatter_parameter, *tail_parameters),
        excluded=selection.reasons,
        excluded_points=_others(t, position, selection),
        rows=Rows.of_points(x.size, x, run.lines[rows]),
    )


def _need_times(run: Run, model: str, levels: Levels, path: Path) -> None:
    if "t_s" not in run.columns:
        raise levels.error(
            "needs times: the run's file has no t_s column", (*path, "model"), value=model
        )


def _some(*parameters: Parameter | None) -> tuple[Parameter, ...]:
    return tuple(p for p in parameters if p is not None)


def _encoder_step(table: NoiseTable, levels: Levels, path: Path) -> float:
    step = table.encoder_step_rad
    if step is not None and not (step > 0.0 and math.isfinite(step)):
        raise levels.error("must be > 0", (*path, "encoder_step_rad"), value=step)
    return step or 0.0


def _typical(sigma: Scale, parameter: Parameter | None, step: float) -> float:
    """Standard deviation of a reading as stated, or where its prior has its centre."""
    return math.hypot(
        sigma.value if parameter is None else parameter.prior.centre, step / math.sqrt(12.0)
    )


def _speeds(run: Run, table: NoiseTable) -> tuple[Derivative, tuple[Finding, ...]]:
    """Speeds by differences, and how many frames have none."""
    stencil = STENCILS[table.derivative or "central"]
    derivative = differentiate(
        run.columns["t_s"], run.columns[run.coordinate], stencil, file=run.file, lines=run.lines
    )
    missing = run.n_row - derivative.rows.size
    return derivative, (
        Finding(Kind.NO_DERIVATIVE, test=stencil.name, size=missing),
    ) if missing else ()


def _by_row(
    run: Run, column: str, sigma: Scale, known: bool, unit: str, levels: Levels, path: Path
) -> tuple[Scale, FloatArray | None]:
    """A standard deviation that may stand in a column, row by row (n_row,), instead of the noise
    table.
    """
    if column not in run.columns:
        return sigma, None
    if unit != "m":
        rule = f"does not apply to a run in {unit}; start the column's name with _ to skip it"
        raise InputError(rule, field=column, file=run.file)
    if known:
        raise levels.error(f"is stated twice: here and in the {column} column of {run.file}", path)
    return Scale(1.0), run.columns[column]


def _stated_offset(
    levels: Levels, units: _Units
) -> tuple[dict[str, str | float], Parameter | None]:
    """The zero of the positions for speeds: exact unless the campaign states it."""
    if all(getattr(level.table, units.offset) is None for level in levels):
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
    for level in levels:
        written = getattr(level.table, key)
        if written is not None:
            value = read_at(levels.source, written, (*level.path, key))
            if isinstance(value, Quantity) and value.exact:
                return value.value, None
            stated = as_prior(value, low=-math.inf) if isinstance(value, Quantity) else value
            parameter = replace(unknown, name=unknown.name + level.suffix, prior=stated)
            break
    return parameter.name, parameter


def _scale(
    table: NoiseTable, key: str, unit: str, levels: Levels, path: Path, suffix: str, meaning: str
) -> tuple[Scale, Parameter | None]:
    """A standard deviation of the noise table: fixed, or a parameter where it has an uncertainty or
    a prior.
    """
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
        raise levels.error(
            "is a standard deviation: its prior must not reach below 0", (*path, key)
        )
    name, symbol = _SCALES[key]
    return Scale(parameter=name + suffix), Parameter(
        name + suffix, unit, prior, meaning, Notation(symbol)
    )


def _window(run: Run, levels: Levels) -> Window:
    """Limits of the most particular window table, in the run's own coordinate."""
    for level in levels:
        if level.table.window is not None:
            return _read_window(level.table.window, run, levels, (*level.path, "window"))
    return Window(-math.inf, math.inf, -math.inf, math.inf)


def _read_window(table: WindowTable, run: Run, levels: Levels, path: Path) -> Window:
    here, other = (("x_min_m", "x_max_m"), ("theta_min_rad", "theta_max_rad"))[
        :: 1 if run.coordinate == "x_m" else -1
    ]
    for key in other:
        if getattr(table, key) is not None:
            raise levels.error(
                f"does not fit a run whose positions are {run.coordinate}", (*path, key)
            )
    if "t_s" not in run.columns and (table.t_min_s is not None or table.t_max_s is not None):
        raise levels.error("needs times: the run's file has no t_s column", path, field="window")

    def limit(key: str, otherwise: float) -> float:
        number = getattr(table, key)
        if number is not None and not math.isfinite(number):
            raise levels.error("must be finite", (*path, key), value=number)
        return otherwise if number is None else float(number)

    window = Window(
        limit("t_min_s", -math.inf),
        limit("t_max_s", math.inf),
        limit(here[0], -math.inf),
        limit(here[1], math.inf),
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
    others = np.setdiff1d(np.arange(position.size), selection.kept)
    return np.column_stack([position[others], speed[others]])
