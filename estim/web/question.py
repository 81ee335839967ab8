"""A question as it is put on a page, and the arguments of the command that answers it.

What a person wrote is one argument together with its option (`--formula=...`), or stands behind
`--`: it can be no other option, and it is never the name of a file.  What is missing is named in a
sentence for the page (`InputError.rule`).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from estim.common import InputError, language, phrase

Fields = Mapping[str, str]
"""What was written in the fields of a page, by their names."""

_OF_DRAWS = " seed max-steps"
_ASKED = {  # of the kinds, the command and its options; those of a table beside them
    "formula": (
        "fit",
        "formula x y u-x u-y window robust noise kind title track figures" + _OF_DRAWS,
    ),
    "rolling": ("fit", "x y kind title track release figures" + _OF_DRAWS),
    "line": ("line", "x y u-x u-y"),
    "mean": ("mean", "y u-y group"),
}
_OF_TABLES = " sheet decimal columns skip-rows dates encoding"
_ROLLING = (  # keys of a campaign
    "radius_m phi_deg theta0_deg gamma mass_disk_kg mass_particle_kg kappa sigma_x_m sigma_v_m_s "
    "rolling_resistance g offset_m ramp_length_m x_max_m unmodelled_force unit"
)
_NEEDED = (
    ("radius_m",),
    ("phi_deg",),
    ("theta0_deg",),
    ("gamma", "mass_particle_kg"),
    ("sigma_x_m", "sigma_v_m_s"),
)
NAMED = "value start low high"
"""Fields with one NAME = VALUE a line."""
_OF_COLUMNS = "x y u-x u-y track sheet decimal columns skip-rows dates encoding"
_FLAGS = ("correlated", "jitter")
MODELS = {
    "line": "slope*x + intercept",
    "polynomial2": "c0 + c1*x + c2*x**2",
    "exponential": "amplitude*exp(-x/decay)",
    "exponential + constant": "amplitude*exp(-x/decay) + c",
    "power": "amplitude*x**exponent",
    "gaussian": "amplitude/(sigma*sqrt(2*pi))*exp(-(x - center)**2/(2*sigma**2))",
    "gaussian + line": "amplitude/(sigma*sqrt(2*pi))*exp(-(x - center)**2/(2*sigma**2))"
    " + slope*x + intercept",
    "lorentzian": "amplitude/pi*sigma/((x - center)**2 + sigma**2)",
    "oscillation": "amplitude*cos(2*pi*frequency*x + phase)",
    "damped_oscillation": "amplitude*exp(-damping*x)*cos(2*pi*frequency*x + phase)",
    "logistic": "amplitude/(1 + exp(-(x - center)/sigma))",
}
"""Models by name that a click writes out."""
_NAMES = {formula: name for name, formula in MODELS.items()}
_UNWRITTEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
# fields that are no options of their own
_FURTHER = {"formula": f"{NAMED} own", "rolling": _ROLLING}


def fields_of(form: Iterable[tuple[str, object]]) -> dict[str, str]:
    """What was filled in, without characters that cannot be typed; of several of one name, a line
    each.
    """
    fields: dict[str, str] = {}
    for name, value in form:
        text = _UNWRITTEN.sub("", value).strip() if isinstance(value, str) else ""
        if text:
            fields[name] = "\n".join(filter(None, (fields.get(name), text)))
    return fields


def arguments_of(fields: Fields, file: str, title: str, others: Iterable[str] = ()) -> list[str]:
    """Arguments of `estim` for a question, in the current language.

    file : the stored name of a table or campaign; "": a formula of named values.
    title : what a person calls it, the title of the report of a curve.
    others : stored names of tables that are fit together with it.

    Raises InputError where there is no question.
    """
    end = ["--format", "html", "--out", "report"]
    end += [] if language() == "en" else ["--lang", language()]
    if not file:
        values = lines_of(fields.get("values", ""))
        # without a value the formula would be the name of a file
        if not values or "formula" not in fields:
            raise InputError(phrase("Write a formula, and the value of each name in it."))
        return ["propagate", *end, "--", fields["formula"], *values]
    if file.endswith(".toml"):
        runs = [f"--run={run}" for run in fields.get("runs", "").splitlines()]
        joint = ["--joint"] if "joint" in fields else []
        draws = [f"--{name}={fields[name]}" for name in _OF_DRAWS.split() if name in fields]
        return ["fit", file, *runs, *joint, *draws, *end]
    kind = fields.get("asked", "formula")
    if kind not in _ASKED:
        raise InputError(phrase("Choose what you want to know."))
    command, options = _ASKED[kind]
    entries = dict(fields) | {"formula": formula_of(fields)}
    if kind == "formula" and "formula" not in fields:
        raise InputError(phrase("Write a formula, or choose a model."), field="--formula")
    if kind == "rolling":
        for keys in _NEEDED:
            if not entries.keys() & {*keys}:
                raise InputError(phrase("This value is needed."), field=keys[0])
        if "imported" in entries:  # of a track nothing is chosen
            entries = {key: text for key, text in entries.items() if key not in ("x", "y")}
    if command == "fit" and file.rpartition(".")[0] != title:
        entries = {"title": title} | entries
    words = [
        f"--{name}={entries[name]}" for name in (options + _OF_TABLES).split() if name in entries
    ]
    if kind == "formula":
        words += [
            f"--{name}={text}" for name in NAMED.split() for text in lines_of(entries.get(name, ""))
        ]
        words += [f"--{name}" for name in _FLAGS if name in entries]
    if kind == "rolling":
        words += [f"--rolling={key}={entries[key]}" for key in _ROLLING.split() if key in entries]
    if others:
        own = re.split(r"[\s,;]+", entries.get("own", ""))
        words += ["--joint", *(f"--own={name}" for name in own if name)]
    return [command, file, *others, *words, *end]


def options_of(fields: Fields) -> dict[str, Any]:
    """The options of `estim fit` for a table and its curve, of the fields of a question."""
    options: dict[str, Any] = {name.replace("-", "_"): text for name, text in fields.items()}
    options |= {name: lines_of(fields.get(name, "")) for name in NAMED.split()}
    options |= {name: name in fields for name in _FLAGS}
    rows = fields.get("skip-rows", "")
    return options | {
        "formula": formula_of(fields),
        "x": [fields["x"]] if "x" in fields else [],
        "skip_rows": int(rows) if rows.isdecimal() else None,
        "rolling": (),
        "own": (),
    }


def formula_of(fields: Fields) -> str:
    """The formula as the command takes it: of one that a click wrote, the name of the model, which
    knows limits of its parameters.
    """
    formula = fields.get("formula", "")
    return _NAMES.get(formula, formula)


def with_columns(fields: Fields, chosen: Fields) -> dict[str, str]:
    """A question about a curve, `fields`, of a file whose columns are `chosen`; a formula that
    names its x does so as before.
    """
    from estim.campaign import variable_of
    from estim.curves import read_formula

    names, formula = _OF_COLUMNS.split(), fields["formula"]
    question = {name: text for name, text in fields.items() if name not in names}
    question |= {name: chosen[name] for name in names if name in chosen}
    if fields.get("x") != question.get("x"):
        variable = variable_of(read_formula(formula), fields.get("x", ""), None, ())
        question["formula"] = re.sub(rf"(?<!\w){variable}(?!\w)", "x", formula)
    return question


def field_of(option: str, kind: str) -> str:
    """The field that an error is about, "" where the question has none for it."""
    name = option.removeprefix("--rolling ").removeprefix("--").partition(" ")[0]
    options = _ASKED[kind][1] if kind in _ASKED else ""
    shown = f"{options}{_OF_TABLES} {_FURTHER.get(kind, '')}".split()
    return name if name in shown else ""


def command_line(arguments: Iterable[str]) -> str:
    """What a person types for the same answer."""
    return shlex.join(["estim", *arguments])


def lines_of(text: str) -> list[str]:
    """One NAME=VALUE a line, without blanks about the mark; several may stand on a line, separated
    by a semicolon.
    """
    parts = [part.strip() for part in re.split(r"[\n;]", text)]
    return [re.sub(r"\s*=\s*", "=", part, count=1) for part in parts if part]
