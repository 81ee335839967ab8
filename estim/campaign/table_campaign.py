"""A campaign of one table, or of several that have one curve, made of what was stated on the
command line: its text is what a file would hold, and is read like one.

`estim fit data.csv --formula "a*exp(-x/tau)+c" --start tau=2` states so little that defaults fill
in the rest, each of which the text shows.  In place of a formula, `--rolling radius_m=0.15` and the
like state what is known of a disk that rolled.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from estim.campaign.campaign import Campaign
from estim.campaign.campaign_file import Kind, NoiseTable, WindowTable, campaign_file_of
from estim.campaign.curve_tables import of_several, variable_of
from estim.campaign.dialect_table import TRACK_KEYS
from estim.campaign.loading import bound
from estim.campaign.toml_text import toml_text
from estim.common import InputError, in_file, listed, read_number, read_quantity, same_unit, shorten
from estim.curves import Formula, Limits, called_by_name, linear_in, read_formula
from estim.reading import (
    COLUMNS,
    PLAIN,
    UNITS,
    Dialect,
    Layout,
    are_components,
    bare_name,
    dialect_of_options,
    first_and_second,
    is_called,
    is_track,
    is_tracker_file,
    name_and_unit,
    own_name,
    parse_toml,
    place_of,
    read_layout,
    read_release,
    uncertainty_of,
    value_columns,
    way_to,
)

_COMMAND_LINE = "command line"
_ABSCISSAS = ("x", "t", "time")
_WORD = re.compile(r"[^\s$|\\`][^$|\\`\n]{0,18}")
_BODY = "disk"
_SHARED = ("radius_m", "g", "rolling_resistance")
_OF_RUN = ("phi_deg", "phi_rad", "theta0_deg", "theta0_rad", "release_time_s", "offset_m")
_USUAL = {"kappa": "0:1", "rolling_resistance": '{prior = "half-normal", scale = 0.005}'}
_OF_ROLLING = ("rolling", "x", "y", "title", "kind", "track", "release", "dialect")


@dataclass(frozen=True, kw_only=True)
class TableChoices:
    """What is stated of a table and its curve; None and empty: a default.

    start : parameter -> "2.0" or "2.0 s".
    low, high : parameter -> limit.  value : parameter -> an exact or a measured value, "9.81(2)".
    u_x, u_y : a number, a number with its uncertainty, or a column.
    own : parameters of which each table has one of its own; the others are one for all.
    further_x : columns of further abscissas, beside `x`.
    window : lowest and highest x.
    noise, trials : what was counted, in place of u_y: "poisson", "binomial" (of `trials`, a number
        or a column), or "event-times", without y.
    rolling : in place of a formula and all that goes with it, key of a campaign -> value, of a disk
        that rolled: "0.150(1)", a range "0:1", a prior as TOML; x and y are t and x, or x and v.
    """

    formula: str
    rolling: Mapping[str, str] = field(default_factory=dict)
    start: Mapping[str, str] = field(default_factory=dict)
    low: Mapping[str, str] = field(default_factory=dict)
    high: Mapping[str, str] = field(default_factory=dict)
    value: Mapping[str, str] = field(default_factory=dict)
    own: Sequence[str] = ()
    x: str | None = None
    further_x: Sequence[str] = ()
    y: str | None = None
    u_x: str | None = None
    u_y: str | None = None
    window: Limits | None = None
    every: int | None = None
    deviation: float | None = None
    correlated: bool = False
    jitter: bool = False
    robust: str | None = None
    noise: str | None = None
    trials: str | None = None
    title: str | None = None
    kind: Kind = "measured"
    track: str | None = None
    release: str | None = None
    dialect: Dialect = PLAIN

    @property
    def named_columns(self) -> list[str]:
        """The columns that are named."""
        return [name for name in (self.x, *self.further_x, self.y) if name is not None]


@dataclass(frozen=True)
class Axis:
    """column : its name in the file, or before its unit.  name, unit : for figures, "" for none."""

    column: str
    name: str
    unit: str

    @property
    def table(self) -> dict[str, str]:
        """Its keys in a campaign."""
        words = {key: word for key, word in vars(self).items() if _WORD.fullmatch(word)}
        return {"column": self.column} | words


def choices_of_table(options: Mapping[str, Any]) -> TableChoices:
    """The table and its curve as the options of a command describe them (`--u-y` is u_y).  Options
    that are not given may be absent, None or empty; without a formula, that is empty.  Raises
    InputError naming the option.
    """
    read: dict[str, Any] = {
        "formula": options.get("formula") or "",
        "kind": options.get("kind") or "measured",
        "window": window_of(options.get("window")),
        "dialect": dialect_of_options(options),
    }
    title = options.get("title") or ""
    if len(title) > 1900:  # a line of TOML may have 2000
        raise InputError("must have at most 1900 characters", field="--title", value=len(title))
    read["x"], *read["further_x"] = options.get("x") or (None,)
    read |= {
        name: pairs(options.get(name, ()), f"--{name}")
        for name in ("rolling", "start", "low", "high", "value")
    }
    names = TableChoices.__dataclass_fields__.keys() & options.keys() - read.keys()
    return TableChoices(**{name: options[name] for name in names}, **read)


def campaign_of_table(file: Path, choices: TableChoices, *others: Path) -> Campaign:
    """The campaign that fits one curve to the table `file`, and to `others`.  Raises InputError
    where something is missing, with the option that states it.
    """
    text = text_of_table(file, choices, *others)
    return bound(campaign_file_of(text, file.parent / f"({_COMMAND_LINE})", shown=_COMMAND_LINE))


def text_of_table(
    file: Path, choices: TableChoices, *others: Path, within: Path | None = None
) -> str:
    """The TOML of that campaign, to be kept in the folder `within`, or beside `file`.

    others : tables with columns of the same names.
    """
    names, counted = run_names([file, *others]), _counted(choices)
    heads = [
        {"name": name, "file": way_to(table, within or file.parent)}
        for name, table in zip(names, (file, *others), strict=True)
    ]
    if choices.rolling:
        if others:
            raise InputError("goes with one table", field="--rolling", value=str(others[0]))
        return _text_of_rolling(file, choices, heads[0])
    stated = (*choices.start, *choices.low, *choices.high, *choices.value)
    variables = {*_ABSCISSAS}.intersection(choices.formula.replace("+", " ").split())
    model = called_by_name(choices.formula, stated, variables)
    formula = read_formula(choices.formula, field="--formula") if model is None else model.formula
    x, y, u_x, u_y = _axes(file, formula, choices, stated, named=model is not None)
    if several := len(x) > 1:
        formula, _ = of_several(formula, [(axis.column, axis.name) for axis in x], stated)
    elif (variable := variable_of(formula, x[0].column, x[0].name, stated)) not in (None, "x"):
        formula = formula.in_terms_of(variable)
    if not (model or several or formula.uses_x):
        _require_starts(formula, choices)
    _check_parameters(formula, choices)
    window = choices.window and dict(zip(("min", "max"), choices.window, strict=True))
    curve = {
        "expression": formula.text if model is None else None,
        "model": None if model is None else model.text,
        "x": tuple(axis.table for axis in x) if several else x[0].table,
        "y": y and y.table,
        "u_y": _error("u_y", u_y),
        "u_x": _error("u_x", u_x),
        "window": window,
        "every": choices.every,
        "deviation": choices.deviation,
        "correlated": choices.correlated or None,
        "jitter": choices.jitter or None,
        "robust": choices.robust,
        "noise": counted,
        **vars(choices.dialect),
    }
    parameters = {
        name: _parameter(name, choices)
        for name in formula.names
        if model is None or name in (*stated, *choices.own)
    }
    own = {name: parameters.pop(name) for name in dict.fromkeys(choices.own)}
    tables = [("[curve]", curve)] + ([("[curve.parameters]", parameters)] if parameters else [])
    release = None if choices.release is None else read_release(choices.release)
    read = {"track": choices.track, "release": release, "parameters": own or None}
    runs = (("[[runs]]", {**head, **read}) for head in heads)
    return toml_text({"title": choices.title or file.stem, "kind": choices.kind}, [*tables, *runs])


def _counted(choices: TableChoices) -> dict[str, object] | None:
    """The table of what was counted.  Raises InputError where the number of trials is missing, or
    goes with nothing.
    """
    if choices.trials is None:
        if choices.noise == "binomial":
            raise InputError("must say how many trials there were at each x", field="--trials")
        return {"model": choices.noise} if choices.noise else None
    if choices.noise != "binomial":
        raise InputError("goes with --noise binomial", field="--trials", value=choices.trials)
    try:
        trials: object = float(choices.trials)
    except ValueError:
        trials = choices.trials
    return {"model": choices.noise, "trials": trials}


def _text_of_rolling(file: Path, choices: TableChoices, named: Mapping[str, str]) -> str:
    """The TOML of a campaign of one run of a rolling disk: what was stated, each key where it
    belongs so that further runs can be added, and the default kappa and rolling resistance.
    """
    for key, value in vars(choices).items():
        if value and key not in _OF_ROLLING:
            option = f"--{key.replace('_', '-')}"
            raise InputError("cannot be combined with --rolling", field=option)
    stated = {key: _known(key, text) for key, text in {**_USUAL, **choices.rolling}.items()}
    noise, window, run, shared = (
        {key: stated.pop(key) for key in keys if key in stated}
        for keys in (
            NoiseTable.__struct_fields__,
            WindowTable.__struct_fields__,
            (*_OF_RUN, *TRACK_KEYS),
            _SHARED,
        )
    )
    track = {"track": choices.track, "release": choices.release and read_release(choices.release)}
    if is_track(file) or any(track.values()) or {*TRACK_KEYS} & {*run}:
        if choices.x or choices.y:
            rule = "goes with a table: of a track the way along its motion is taken"
            raise InputError(rule, field="--y" if choices.y else "--x")
        track["release"] = track["release"] or "first"
        columns = None
    else:
        columns = _columns_of_run(file, choices)
    read = track | vars(choices.dialect) | {"columns": columns}
    run_table = {**named, "body": _BODY, **read, **run, "window": window or None}
    tables = [
        ("[shared]", shared | {"noise": noise or None}),
        (f"[bodies.{_BODY}]", stated),
        ("[[runs]]", run_table),
    ]
    return toml_text({"title": choices.title or file.stem, "kind": choices.kind}, tables)


def _columns_of_run(file: Path, choices: TableChoices) -> tuple[str, ...] | None:
    """The columns from left to right by the names that those of a run have: x and y are t and x, or
    x and v where y is a speed.  Raises InputError where one has another unit.
    """
    if not choices.named_columns:
        return choices.dialect.columns
    layout = read_layout(file, choices.dialect)
    names, speed = layout.names, False
    if choices.y is not None:
        y = _axis(choices.y, layout)
        speed = (
            same_unit(y.unit, UNITS["v_m_s"]) is True if y.unit else bare_name(y.column)[0] in "vV"
        )
    called = {column: ours for column in names if (ours := own_name(column)) in COLUMNS}
    for option, stated_name, ours in (
        ("--x", choices.x, "x_m" if speed else "t_s"),
        ("--y", choices.y, "v_m_s" if speed else "x_m"),
    ):
        if stated_name is None:
            continue
        axis = _axis(stated_name, layout)
        column = next((c for c in names if axis.column in (c, bare_name(c))), None)
        if column is None:
            raise InputError("is no column", field=option, value=stated_name, quoted=listed(names))
        ours = called.setdefault(column, ours)
        if axis.unit and same_unit(axis.unit, UNITS[ours]) is False:
            rule = f"must be in {UNITS[ours]}: nothing is converted"
            raise InputError(rule, field=option, value=axis.unit, quoted=column)
    columns = tuple(called.get(column, "") for column in names)
    return choices.dialect.columns if columns == names else columns


def _known(key: str, text: str) -> object:
    """What is known of a quantity: a number, one with its uncertainty, a range in which it lies, a
    prior as TOML, or a word.
    """
    if text.startswith("{"):
        try:
            return parse_toml(f"value = {text}", key)[0]["value"]
        except InputError as error:
            raise InputError("is not valid TOML", field=key, value=text) from error
    if not re.match(r"[+-]?[.\d]", text):
        return text
    low, mark, high = text.partition(":")
    if not mark:
        return _stated(text, key)
    return {"prior": "uniform", "low": _number(low, key), "high": _number(high, key)}


def run_names(files: Sequence[Path]) -> list[str]:
    """The names of files as those of runs, each once."""
    names: list[str] = []
    for file in files:
        name = re.sub(r"[^\w.+-]+", "-", file.stem).lstrip("-.+")[:60] or "run"
        name += "-run" * (name.lower() in ("figures", "report", "result", "draws"))
        ends = ("", *(f"-{number}" for number in range(2, len(files) + 1)))
        used = [*map(str.lower, names)]
        names.append(next(name + end for end in ends if (name + end).lower() not in used))
    return names


def _axes(
    file: Path, formula: Formula, choices: TableChoices, stated: Sequence[str], *, named: bool
) -> tuple[list[Axis], Axis | None, str | None, str | None]:
    """x, or several of them, y, u_x and u_y: as stated; else the two columns that there are, or
    those that the formula names and the column y, or the only one left; their columns u_NAME.
    Events have no y.
    """
    if is_tracker_file(file):
        if choices.y is None:
            raise InputError(
                "must name a column of the track: x or y (its axes), or x_m (along the "
                "motion, from its first point)",
                field="--y",
            )
        units = {"t": "s", "t_s": "s", "frame": "1"}
        x, y = (
            Axis(column, "", units.get(column, "m")) for column in (choices.x or "t", choices.y)
        )
        return [x], y, choices.u_x, choices.u_y
    layout = read_layout(file, choices.dialect)
    values = value_columns(layout, (choices.u_x, choices.u_y, choices.trials))
    x_name, y_name, further = choices.x, choices.y, [*choices.further_x]
    called = [
        name
        for name in values
        if y_name not in (name, bare_name(name)) and _names(formula, name, stated)
    ]
    vector = are_components(values)
    if vector:
        called = [name for name in called if bare_name(name).lower() not in ("x", "y", "z")]
    # a parameter may be called like a column too
    called = [name for name in called if bare_name(name).lower() in _ABSCISSAS] or called
    if x_name is None and y_name is None and len(values) == 2:
        x_name, y_name = _of_two(values, called, formula, layout, named=named)
    if x_name is None and called:
        x_name, *further = called
    if choices.noise == "event-times" and y_name is None and (x_name or len(values) == 1):
        return [_axis(x_name or values[0], layout)], None, choices.u_x, choices.u_y
    used = {x_name, y_name, *further}
    others = [name for name in values if not {name, bare_name(name)} & used]
    if y_name is None:
        y_name = (
            "y"
            if "y" in map(bare_name, others) and not vector
            else others[-1]
            if len(others) == 1 and (further or len(values) == 2)
            else None
        )
    elif x_name is None and len(values) == 2 and others:
        x_name = others[0]
    if x_name is None or y_name is None:
        with in_file(file):  # a column that is not there is no reason to ask for the other
            for name in filter(None, (x_name, y_name)):
                place_of(_axis(name, layout).column, layout.names, layout.header_line)
        missing = " and ".join(
            option for option, name in (("--x", x_name), ("--y", y_name)) if name is None
        )
        usable = [name for name in layout.names if name and not name.startswith("_")]
        raise InputError(
            f"must be named by {missing}",
            field="column",
            quoted=f"there are {listed(usable)}",
            file=file,
        )
    if x_name == y_name:
        with in_file(file):  # two columns may be called alike
            place_of(x_name, layout.names, layout.header_line)
    every, y = [_axis(name, layout) for name in (x_name, *further)], _axis(y_name, layout)
    u_x, u_y = choices.u_x, choices.u_y
    if choices.noise is None:
        u_y = u_y or uncertainty_of(y.column, layout.names)
    exact = further or choices.deviation or choices.correlated
    if u_x is None and u_y is not None and not exact:
        u_x = uncertainty_of(every[0].column, layout.names)
    return every, y, u_x, u_y


def _of_two(
    values: Sequence[str], called: Sequence[str], formula: Formula, layout: Layout, *, named: bool
) -> tuple[str, str]:
    """x and y of the two columns of a table: the first is x, but where their names say x and y, or
    the formula names its variable.

    called : the columns that the formula names.
    named : whether the curve was given by its name, so that its x is not written.

    Raises InputError where the formula and the columns contradict each other.
    """
    # t next to T, a temperature
    called = [name for name in called if bare_name(name) in formula.names] or called
    if not formula.uses_x and len(called) == 1 and not is_called(called[0], "y"):
        return called[0], values[1 - values.index(called[0])]
    pair = first_and_second(values)
    if (
        pair is not None
        and formula.uses_x
        and (named or is_called(pair[0], "x") or not is_called(pair[1], "x"))
    ):
        return pair
    if pair is not None and not formula.uses_x and not called:
        return pair
    first, second = values
    rule = "may be either column, by the formula and the header: say which is x and which is y"
    alternatives = f'--x "{first}" --y "{second}", or --x "{second}" --y "{first}"'
    raise InputError(
        rule, field="x", quoted=alternatives, file=layout.file, line=layout.header_line
    )


def _names(formula: Formula, column: str, stated: Sequence[str]) -> bool:
    return (
        bare_name(column) == "x"
        if formula.uses_x
        else variable_of(formula, column, None, stated) is not None
    )


def _axis(name: str, layout: Layout) -> Axis:
    """The column called `name`, with its unit or without; a unit may also be stated here: "t_s
    [s]".
    """
    column, stated = name_and_unit(name)
    if name not in layout.names and stated and column in layout.names:
        return Axis(column, "", stated)
    called = [*layout.names, *map(bare_name, layout.names)]
    unit = layout.units[called.index(name) % len(layout.names)] if name in called else ""
    # a word of a name may stand for x in the formula
    return Axis(name, column if column != name or " " in column else "", stated or unit)


def _check_parameters(formula: Formula, choices: TableChoices) -> None:
    for option, names in (
        ("--start", choices.start),
        ("--low", choices.low),
        ("--high", choices.high),
        ("--value", choices.value),
        ("--own", choices.own),
    ):
        for name in names:
            if name not in formula.names:
                raise InputError(
                    "names no parameter of the formula",
                    field=option,
                    value=name,
                    quoted=", ".join(formula.names),
                )
    for name in choices.value:
        if name in (*choices.start, *choices.low, *choices.high):
            raise InputError(
                "gives a parameter its value: leave out --start, --low and --high of it",
                field="--value",
                value=name,
            )


def _require_starts(formula: Formula, choices: TableChoices) -> None:
    """Raises InputError where a formula without x has no start of a parameter in which it is not
    linear.
    """
    free = [
        name for name in formula.names if name not in choices.start and name not in choices.value
    ]
    if len(linear_in(formula, free)) < len(free):
        raise InputError(
            "holds neither x nor the name of its column, so that nothing shows where its "
            "parameters lie: write x, or give each a --start",
            field="--formula",
            value=formula.text,
        )


def _parameter(name: str, choices: TableChoices) -> object:
    if name in choices.value:
        return _stated(choices.value[name], f"--value {name}")
    number, _, unit = choices.start.get(name, "").strip().partition(" ")
    numbers = {"start": number, "low": choices.low.get(name), "high": choices.high.get(name)}
    return {key: _number(text, f"--{key} {name}") for key, text in numbers.items() if text} | (
        {"unit": unit.strip()} if unit.strip() else {}
    )


def _stated(written: str, option: str) -> float | str:
    """An exact number, or a number with its uncertainty as it is written."""
    quantity = read_quantity(written, field=option)
    return quantity.value if quantity.exact else written.strip()


def _number(text: str, option: str) -> float:
    try:
        value = read_number(text)
    except ValueError:
        hint = " with a decimal point" if "," in text else ""
        raise InputError(f"must be a number{hint}", field=option, value=text) from None
    if not np.isfinite(value):
        raise InputError("must be finite", field=option, value=text)
    return value


def _error(key: str, written: str | None) -> object:
    """The value of `u_x` or `u_y`: a number, a number with its uncertainty in quotes, a share (of
    y), or a column; None where nothing is stated.
    """
    if written is None:
        return None
    if not re.match(r"\s*[+-]?[.\d]", written):
        return {"column": written}
    if key == "u_y" and "%" in written:
        return written
    return _stated(written, f"--{key.replace('_', '-')}")


def pairs(texts: Sequence[str], option: str) -> dict[str, str]:
    """NAME=VALUE, several of them.  Raises InputError."""
    values: dict[str, str] = {}
    for text in texts:
        name, mark, value = (part.strip() for part in text.partition("="))
        if not (mark and name and value):
            raise InputError("must be written NAME=VALUE", field=option, value=shorten(text))
        if "=" in value and not value.startswith("{"):
            rule = "must be one NAME=VALUE: give several one by one"
            raise InputError(rule, field=option, value=shorten(text))
        if name in values:
            raise InputError("is given twice", field=option, value=name)
        values[name] = value
    return values


def window_of(written: str | None) -> Limits | None:
    """MIN:MAX, either end of which may be left out.  Raises InputError."""
    if written is None:
        return None
    low, mark, high = (part.strip() for part in written.partition(":"))
    try:
        if not mark:
            raise ValueError
        return (read_number(low) if low else None), (read_number(high) if high else None)
    except ValueError:
        raise InputError(
            "must be written MIN:MAX, as 0.5:3", field="--window", value=written
        ) from None
