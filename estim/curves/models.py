"""Curves that are known by name, and their sums: `"gaussian + line"`, `"left_gaussian +
right_gaussian"`.

A model is data: a formula and limits of its parameters.  Installed packages may add some.
`estim.curves.starting_values` finds starting values from points, as for any formula.  Names and
normalisations are those of lmfit where it has the model (an `amplitude` of a peak is its area).
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from estim.common import InputError
from estim.curves.formula import Formula, check_names, read_formula
from estim.plugins import Plugin, plugin_called, plugins, told

Limits = tuple[float | None, float | None]

GROUP = "estim.models"  # of entry points
MOST_TERMS = 8
_WORD = r"[^\W\d]\w*"
_SUM = re.compile(rf"\s*{_WORD}(\s*\+\s*{_WORD})*\s*")


@dataclass(frozen=True, eq=False)
class Model:
    """A curve that is known by name: one of estim's own, or of a package that has the entry point
    `NAME = "MODULE:MODEL"` in the group `estim.models`.

    name : as in `fit_curve("NAME + line", x, y)`, where "left_NAME" has a prefix.
    expression : formula in x, like "amplitude*exp(-x/decay)".  Derivatives and starting values of
        the parameters follow from it.
    parameters : all that the formula has, in the order of reports.
    limits : name -> lowest and highest value that makes sense, None for no limit.

    >>> from estim import Model
    >>> decay = Model("decay", "a*exp(-x/tau)", ("a", "tau"), {"tau": (0, None)})
    >>> decay.expression
    'a*exp(-x/tau)'
    """

    name: str
    expression: str
    parameters: tuple[str, ...]
    limits: Mapping[str, Limits] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Term:
    """A model in a sum, with what stands before the names of its parameters ("left_", or
    nothing).
    """

    model: Model
    prefix: str

    def renamed(self, values: Mapping[str, float]) -> dict[str, float]:
        return {self.prefix + name: value for name, value in values.items()}

    @property
    def expression(self) -> str:
        if not self.prefix:
            return self.model.expression
        names = "|".join(self.model.parameters)
        return re.sub(
            rf"\b({names})\b", lambda match: self.prefix + match[1], self.model.expression
        )


@dataclass(frozen=True, eq=False)
class ModelSum:
    """A sum of named curves, or a formula that has no terms.  text : as a person calls it, "" for a
    formula.
    """

    text: str
    formula: Formula
    terms: tuple[Term, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        return _parameters(self.terms) or self.formula.names

    @property
    def limits(self) -> dict[str, Limits]:
        return {
            term.prefix + name: limits
            for term in self.terms
            for name, limits in term.model.limits.items()
        }


def named_model(text: object) -> ModelSum | None:
    """The model or the sum of models that `text` names; None where a name in it is none of them, so
    that it may be a formula.
    """
    if not isinstance(text, str) or not names_only(text):
        return None
    matches = [_term(word.strip()) for word in text.split("+")]
    terms = tuple(term for term in matches if term is not None)
    if len(terms) < len(matches):
        return None
    called = " + ".join(text.replace("+", " ").split())
    _check_terms(called, terms)
    return ModelSum(called, read_formula(" + ".join(term.expression for term in terms)), terms)


def names_only(text: object) -> bool:
    """Whether `text` is a name, or several with + between them."""
    return isinstance(text, str) and _SUM.fullmatch(text) is not None


def read_model(text: object) -> ModelSum:
    """`named_model`, where the text can be nothing else.  Raises InputError with the names there
    are.
    """
    models = named_model(text)
    if models is not None:
        return models
    words = [word.strip() for word in str(text).split("+")]
    unknown = next((word for word in words if _term(word) is None), str(text))
    known = _names()
    close = difflib.get_close_matches(unknown.rpartition("_")[2], known, n=1, cutoff=0.76)
    hint = (
        f"did you mean '{close[0]}'?"
        if close
        else f"there are {', '.join(known)}, with a prefix like left_gaussian, and sums with +"
    )
    raise InputError(f"must name a model ({hint})", field="model", value=unknown)


def known_models() -> Iterator[str | InputError]:
    """Each model with its formula, or why one of an installed package cannot be used."""
    yield from (f"{name}: {model.expression}" for name, model in MODELS.items())
    yield from told(GROUP, lambda plugin: f"{plugin.name}: {_installed(plugin).expression}")


def _term(word: str) -> Term | None:
    name = _name_in(word, _names())
    if name is None:
        return None
    plugin = plugin_called(GROUP, name)
    model = MODELS[name] if plugin is None else _installed(plugin)
    return Term(model, word.removesuffix(name))


def _names() -> list[str]:
    return [*MODELS, *(plugin.name for plugin in plugins(GROUP))]


def _name_in(word: str, names: Iterable[str]) -> str | None:
    """The longest of the names that `word` is, or ends with behind a prefix."""
    matches = (name for name in names if word == name or word.endswith(f"_{name}"))
    return max(matches, key=len, default=None)


def _installed(plugin: Plugin) -> Model:
    """The model of an installed package.  Raises InputError where it is none, or its name is
    estim's.
    """
    clash = _name_in(plugin.name, MODELS)
    if clash is not None:
        raise plugin.error(f"is refused: '{clash}' is a model of estim's own")

    def checked(model: Model) -> Model:
        names = read_formula(model.expression).names
        check_names([plugin.name], field="name")
        if (
            model.name != plugin.name
            or {*model.limits} - {*names}
            or {*names} != {*model.parameters}
        ):
            raise ValueError("it must have this name, and the parameters of its formula")
        return model

    return plugin.make(checked, Model)


def _parameters(terms: Iterable[Term]) -> tuple[str, ...]:
    return tuple(term.prefix + name for term in terms for name in term.model.parameters)


def _check_terms(called: str, terms: tuple[Term, ...]) -> None:
    if len(terms) > MOST_TERMS:
        raise InputError(f"must have at most {MOST_TERMS} terms", field="model", value=len(terms))
    twice = [name for name, n in Counter(_parameters(terms)).items() if n > 1]
    if twice:
        numbered = " + ".join(f"{'abcdefgh'[i]}_{term.model.name}" for i, term in enumerate(terms))
        raise InputError(
            f"has several parameters '{twice[0]}': put something before the models to tell them "
            f'apart, like "{numbered}"',
            field="model",
            value=called,
        )


_POSITIVE: Limits = (0.0, None)
_PEAK = {"sigma": _POSITIVE}


def _polynomial(degree: int) -> Model:
    names = tuple(f"c{i}" for i in range(degree + 1))
    powers = ["c0", "c1*x", *(f"c{i}*x**{i}" for i in range(2, degree + 1))][: degree + 1]
    return Model(f"polynomial{degree}", " + ".join(powers), names)


MODELS: Mapping[str, Model] = {
    model.name: model
    for model in (
        Model("constant", "c", ("c",)),
        Model("line", "slope*x + intercept", ("slope", "intercept")),
        *(_polynomial(degree) for degree in range(2, 8)),
        Model("exponential", "amplitude*exp(-x/decay)", ("amplitude", "decay")),
        Model("power", "amplitude*x**exponent", ("amplitude", "exponent")),
        Model(
            "gaussian",
            "amplitude/(sigma*sqrt(2*pi))*exp(-(x - center)**2/(2*sigma**2))",
            ("amplitude", "center", "sigma"),
            _PEAK,
        ),
        Model(
            "lorentzian",
            "amplitude/pi*sigma/((x - center)**2 + sigma**2)",
            ("amplitude", "center", "sigma"),
            _PEAK,
        ),
        Model(
            "voigt",
            "amplitude*voigt(x - center, sigma, gamma)",
            ("amplitude", "center", "sigma", "gamma"),
            {"sigma": _POSITIVE, "gamma": _POSITIVE},
        ),
        Model(
            "oscillation",
            "amplitude*cos(2*pi*frequency*x + phase)",
            ("amplitude", "frequency", "phase"),
            {"frequency": _POSITIVE},
        ),
        Model(
            "damped_oscillation",
            "amplitude*exp(-damping*x)*cos(2*pi*frequency*x + phase)",
            ("amplitude", "frequency", "phase", "damping"),
            {"frequency": _POSITIVE},
        ),
        Model(
            "logistic",
            "amplitude/(1 + exp(-(x - center)/sigma))",
            ("amplitude", "center", "sigma"),
            {},
        ),
    )
}
