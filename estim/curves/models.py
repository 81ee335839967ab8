"""Curves that are known by name, and their sums: `"gaussian + line"`, `"left_gaussian +
right_gaussian"`.

A model is data: a formula and limits of its parameters.  `estim.curves.guesses` finds starting
values from points, as for any formula.  Names and normalisations are those of
lmfit where it has the model (an `amplitude` of a peak is its area).
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from estim.common import InputError
from estim.curves.formula import Formula, read_formula

Limits = tuple[float | None, float | None]

MOST_TERMS = 8
_HIGHEST = 7  # degree of a polynomial
_WORD = r"[^\W\d]\w*"
_SUM = re.compile(rf"\s*{_WORD}(\s*\+\s*{_WORD})*\s*")


@dataclass(frozen=True, eq=False)
class Model:
    """A named curve.

    expression : formula in x.
    limits : name -> lowest and highest value that makes sense.
    """

    name: str
    expression: str
    parameters: tuple[str, ...]
    limits: Mapping[str, Limits]


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
    """A sum of named curves.  text : as a person calls it."""

    text: str
    terms: tuple[Term, ...]

    @property
    def called(self) -> str:
        return self.text

    @property
    def expression(self) -> str:
        return " + ".join(term.expression for term in self.terms)

    @cached_property
    def formula(self) -> Formula:
        return read_formula(self.expression)

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(term.prefix + name for term in self.terms for name in term.model.parameters)

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
    terms = [_term(word.strip()) for word in text.split("+")]
    known = tuple(term for term in terms if term is not None)
    return (
        _checked(ModelSum(" + ".join(text.replace("+", " ").split()), known))
        if len(known) == len(terms)
        else None
    )


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
    close = difflib.get_close_matches(unknown.rpartition("_")[2], MODELS, n=1)
    hint = (
        f"did you mean '{close[0]}'?"
        if close
        else f"there are {', '.join(MODELS)}, with a prefix like left_gaussian, and sums with +"
    )
    raise InputError(f"must name a model ({hint})", field="model", value=unknown)


def _term(word: str) -> Term | None:
    name = max(
        (name for name in MODELS if word == name or word.endswith(f"_{name}")),
        key=len,
        default=None,
    )
    return None if name is None else Term(MODELS[name], word.removesuffix(name))


def _checked(asked: ModelSum) -> ModelSum:
    if len(asked.terms) > MOST_TERMS:
        raise InputError(
            f"must have at most {MOST_TERMS} terms", field="model", value=len(asked.terms)
        )
    twice = [name for name, n in Counter(asked.parameters).items() if n > 1]
    if twice:
        numbered = " + ".join(
            f"{'abcdefgh'[i]}_{term.model.name}" for i, term in enumerate(asked.terms)
        )
        rule = (
            f"has several parameters '{twice[0]}': put something before the models to tell them "
            f'apart, like "{numbered}"'
        )
        raise InputError(rule, field="model", value=asked.text)
    return asked


_POSITIVE: Limits = (0.0, None)
_PEAK = {"sigma": _POSITIVE}


def _polynomial(degree: int) -> Model:
    names = tuple(f"c{i}" for i in range(degree + 1))
    powers = ["c0", "c1*x", *(f"c{i}*x**{i}" for i in range(2, degree + 1))][: degree + 1]
    return Model(f"polynomial{degree}", " + ".join(powers), names, {})


MODELS: Mapping[str, Model] = MappingProxyType(
    {
        model.name: model
        for model in (
            Model("constant", "c", ("c",), {}),
            Model("line", "slope*x + intercept", ("slope", "intercept"), {}),
            *(_polynomial(degree) for degree in range(2, _HIGHEST + 1)),
            Model("exponential", "amplitude*exp(-x/decay)", ("amplitude", "decay"), {}),
            Model("power", "amplitude*x**exponent", ("amplitude", "exponent"), {}),
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
                ("amplitude", "phase", "frequency"),
                {"frequency": _POSITIVE},
            ),
            Model(
                "damped_oscillation",
                "amplitude*exp(-damping*x)*cos(2*pi*frequency*x + phase)",
                ("amplitude", "phase", "frequency", "damping"),
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
)
