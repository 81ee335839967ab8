"""Curves that are known by name, and their sums: `"gaussian + line"`, `"left_gaussian +
right_gaussian"`.

A model is data: a formula, which parameters it is linear in, and where to look for the others.
`estim.curves.starts` finds its starting values from points.  Names and normalisations are those of
lmfit where it has the model (an `amplitude` of a peak is its area).
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError

Limits = tuple[float | None, float | None]
Grid = Callable[["Extent"], FloatArray]

MOST_TERMS = 8
_HIGHEST = 7  # degree of a polynomial
_WORD = r"[^\W\d]\w*"
_SUM = re.compile(rf"\s*{_WORD}(\s*\+\s*{_WORD})*\s*")


@dataclass(frozen=True)
class Extent:
    """Where points lie: low and high x, the smallest step between two that differ, and how many
    there are.
    """

    low: float
    high: float
    step: float
    n: int

    @property
    def length(self) -> float:
        return self.high - self.low

    @property
    def mean_step(self) -> float:
        return self.length / max(1, self.n - 1)


@dataclass(frozen=True, eq=False)
class Model:
    """A named curve.

    expression : formula in x.
    bent : parameters that the curve is not linear in, `grid` the values to try, (n, n_bent).
    units : sets of values of all other parameters; the curve is a combination of those at the sets.
        One parameter is 1 in each set, but for `phase`: an amplitude with two phases a quarter of a
        turn apart.
    limits : name -> lowest and highest value that makes sense.
    """

    name: str
    expression: str
    bent: tuple[str, ...]
    units: tuple[Mapping[str, float], ...]
    grid: Grid
    limits: Mapping[str, Limits]

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*(name for name in self.units[0]), *self.bent)


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


def _nothing(_extent: Extent) -> FloatArray:
    return np.zeros((1, 0))


def _scales(low: float, high: float, *, per_decade: int = 6) -> FloatArray:
    return np.geomspace(low, high, max(2, 1 + round(per_decade * np.log10(high / low))))


def _decays(extent: Extent) -> FloatArray:
    sizes = _scales(extent.step / 3.0, 30.0 * extent.length)
    return np.concatenate([sizes, -sizes])[:, None]


def _exponents(_extent: Extent) -> FloatArray:
    return np.linspace(-8.05, 8.03, 81)[:, None]  # no whole number, which x < 0 would bear


def _peaks(extent: Extent) -> FloatArray:
    """Centres and widths: for each width, centres that are closer than it is; wide ones beyond the
    ends too.
    """
    pairs = []
    for sigma in _scales(0.5 * extent.step, extent.length):
        beyond = min(sigma, 0.5 * extent.length)
        n = min(2000, 2 + int((extent.length + 2.0 * beyond) / (0.8 * sigma)))
        centres = np.linspace(extent.low - beyond, extent.high + beyond, n)
        pairs.append(np.column_stack([centres, np.full(n, sigma)]))
    return np.concatenate(pairs)


def _peaks_of_two_widths(extent: Extent) -> FloatArray:
    peaks = _peaks(extent)
    return np.concatenate(
        [
            np.column_stack([peaks[:, 0], f * peaks[:, 1], g * peaks[:, 1]])
            for f, g in ((1.0, 0.2), (0.6, 0.6), (0.2, 1.0))
        ]
    )


def _steps(extent: Extent) -> FloatArray:
    sizes = _scales(0.2 * extent.step, extent.length, per_decade=4)
    centres = np.linspace(extent.low - 0.2 * extent.length, extent.high + 0.2 * extent.length, 71)
    pairs = np.stack(np.meshgrid(centres, np.concatenate([sizes, -sizes]), indexing="ij"), axis=-1)
    return pairs.reshape(-1, 2)


def _frequencies(extent: Extent) -> FloatArray:
    """From a quarter of a turn along the data to half a turn from point to point."""
    highest = 0.5 / extent.mean_step
    return np.arange(0.25 / extent.length, 1.0001 * highest, 0.2 / extent.length)[:4000, None]


def _damped(extent: Extent) -> FloatArray:
    frequencies = _frequencies(extent)[:, 0]
    rates = np.array([0.0, 1.0, 4.0, 12.0]) / extent.length
    return np.stack(np.meshgrid(frequencies, rates, indexing="ij"), axis=-1).reshape(-1, 2)


def _alone(*names: str) -> tuple[Mapping[str, float], ...]:
    return tuple(
        MappingProxyType({name: float(name == chosen) for name in names}) for chosen in names
    )


_POSITIVE: Limits = (0.0, None)
_WAVE = (
    MappingProxyType({"amplitude": 1.0, "phase": 0.0}),
    MappingProxyType({"amplitude": 1.0, "phase": -0.5 * np.pi}),
)
_PEAK = {"sigma": _POSITIVE}


def _polynomial(degree: int) -> Model:
    names = [f"c{i}" for i in range(degree + 1)]
    powers = ["c0", "c1*x", *(f"c{i}*x**{i}" for i in range(2, degree + 1))][: degree + 1]
    return Model(f"polynomial{degree}", " + ".join(powers), (), _alone(*names), _nothing, {})


MODELS: Mapping[str, Model] = MappingProxyType(
    {
        model.name: model
        for model in (
            Model("constant", "c", (), _alone("c"), _nothing, {}),
            Model("line", "slope*x + intercept", (), _alone("slope", "intercept"), _nothing, {}),
            *(_polynomial(degree) for degree in range(2, _HIGHEST + 1)),
            Model(
                "exponential",
                "amplitude*exp(-x/decay)",
                ("decay",),
                _alone("amplitude"),
                _decays,
                {},
            ),
            Model(
                "power", "amplitude*x**exponent", ("exponent",), _alone("amplitude"), _exponents, {}
            ),
            Model(
                "gaussian",
                "amplitude/(sigma*sqrt(2*pi))*exp(-(x - center)**2/(2*sigma**2))",
                ("center", "sigma"),
                _alone("amplitude"),
                _peaks,
                _PEAK,
            ),
            Model(
                "lorentzian",
                "amplitude/pi*sigma/((x - center)**2 + sigma**2)",
                ("center", "sigma"),
                _alone("amplitude"),
                _peaks,
                _PEAK,
            ),
            Model(
                "voigt",
                "amplitude*voigt(x - center, sigma, gamma)",
                ("center", "sigma", "gamma"),
                _alone("amplitude"),
                _peaks_of_two_widths,
                {"sigma": _POSITIVE, "gamma": _POSITIVE},
            ),
            Model(
                "oscillation",
                "amplitude*cos(2*pi*frequency*x + phase)",
                ("frequency",),
                _WAVE,
                _frequencies,
                {"frequency": _POSITIVE},
            ),
            Model(
                "damped_oscillation",
                "amplitude*exp(-damping*x)*cos(2*pi*frequency*x + phase)",
                ("frequency", "damping"),
                _WAVE,
                _damped,
                {"frequency": _POSITIVE},
            ),
            Model(
                "logistic",
                "amplitude/(1 + exp(-(x - center)/sigma))",
                ("center", "sigma"),
                _alone("amplitude"),
                _steps,
                {},
            ),
        )
    }
)
