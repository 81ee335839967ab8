"""Parameters of a curve that follow from others: `tied={"right_sigma": "left_sigma", "b":
"2*a"}`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from estim.arrays import FloatArray, Named
from estim.common import InputError
from estim.curves.dual_numbers import Dual, plain
from estim.curves.formula import Formula, check_names, evaluate, numbers_of, read_formula
from estim.curves.several_abscissas import arguments_taken
from estim.problem import EXACT, Curve, LocalCurve


@dataclass(frozen=True, eq=False)
class TiedCurve:
    """A curve some of whose arguments follow from the others; its own arguments are these others.

    tied : argument of `curve` -> formula without x, each of the arguments or of those tied before
        it.
    """

    curve: Curve
    tied: Mapping[str, Formula]

    @property
    def precision(self) -> float:
        """Relative error of the derivatives."""
        return getattr(self.curve, "precision", EXACT)

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return self.curve.value(x, followed(self.tied, arguments))

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        """The chain rule, exact."""
        known: dict[str, Any] = {
            name: Dual(value, {name: 1.0})
            for name, value in numbers_of(arguments, arguments).items()
        }
        for name, formula in self.tied.items():
            known[name] = evaluate(formula.tree, known)
        inner = self.curve.local(x, {name: plain(value) for name, value in known.items()})
        gradient = {
            name: partial for name, partial in inner.gradient.items() if name not in self.tied
        }
        for name in self.tied:
            partials = known[name].partials if isinstance(known[name], Dual) else {}
            for source, rate in partials.items():
                gradient[source] = gradient.get(source, 0.0) + inner.gradient[name] * rate
        return LocalCurve(inner.value, inner.slope, gradient)


def followed(tied: Mapping[str, Formula], arguments: Named) -> dict[str, Any]:
    """`arguments` with the tied ones."""
    known = dict(arguments)
    for name, formula in tied.items():
        known[name] = evaluate(formula.tree, numbers_of(known, formula.names))
    return known


def read_tied(tied: Mapping[str, str], names: Collection[str]) -> dict[str, Formula]:
    """Name -> formula of the parameters `names` or of those before it.  Raises InputError naming
    `tied`.
    """
    check_names(tied, field="tied")
    read: dict[str, Formula] = {}
    for name, text in tied.items():
        if name in names:
            raise InputError(
                f"names '{name}', which has a starting or a fixed value too: give it one of them",
                field="tied",
            )
        formula = read_formula(text, field=f"tied[{name}]")
        if formula.uses_x:
            raise InputError(
                "must not hold x: it is one number, not a curve", field=f"tied[{name}]", value=text
            )
        for symbol in formula.names:
            if symbol not in names and symbol not in read:
                raise InputError(
                    f"names '{symbol}', which is neither a parameter nor tied before it "
                    f"({', '.join([*names, *read])})",
                    field=f"tied[{name}]",
                    value=text,
                )
        read[name] = formula
    return read


def only_for_ties(
    curve: str | Formula | Callable[..., Any], tied: Mapping[str, Formula]
) -> set[str]:
    """Names in the formulas of `tied` that the curve itself does not take.  Raises InputError where
    it does not take what is tied.
    """
    if callable(curve):
        takes = arguments_taken(curve)
        if not takes or any(parameter.kind is parameter.VAR_KEYWORD for parameter in takes):
            return set()
        own = [parameter.name for parameter in takes[1:]]
    else:
        own = [*read_formula(curve, field="curve").names]
    for name in tied:
        if name not in own:
            rule = f"names '{name}', which is not a parameter of the curve ({', '.join(own)})"
            raise InputError(rule, field="tied", value=tied[name].text)
    return {symbol for formula in tied.values() for symbol in formula.names}.difference(own)
