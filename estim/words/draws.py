"""Draws of a posterior in words: whether there are enough, and what a second computation says of
them.
"""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, later, phrase
from estim.words.table import Table, filled


def _parts(f: Finding) -> str:
    return "; ".join(filled(WORDS, part) for part in f.parts)


def _stuck(f: Finding) -> str:
    return (
        phrase("{n:.0f} walkers never moved", n=f.size)
        if f.size > 1
        else phrase("{n:.0f} walker never moved", n=f.size)
    )


def _differs(f: Finding) -> str:
    what = phrase(" and ").join(filled(WORDS, part) for part in f.parts)
    if "before" in f.numbers:
        return phrase(
            "chain and {test} differ (as they did before, with other random numbers) in {what}",
            test=phrase(f.test),
            what=what,
        )
    return phrase("chain and {test} differ in {what}", test=phrase(f.test), what=what)


def _difference(f: Finding) -> str:
    return phrase(
        "the {what} of {name} by {size:+.3f} posterior standard deviations ({errors:.1f} "
        "Monte-Carlo errors)",
        what=f.test,
        name=f.parameters[0].name,
        size=f.size,
        errors=f.numbers["errors"],
    )


def _unreliable(f: Finding) -> str:
    k_hat = f"{f.size:.2f}" if math.isfinite(f.size) else phrase("infinite")
    return phrase(
        "the importance weights are unreliable: k-hat is {shown}, above {limit}, after "
        "{draws:.0f} draws",
        shown=k_hat,
        limit=f.numbers["limit"],
        draws=f.numbers["draws"],
    )


def _agrees(f: Finding) -> str:
    words = phrase(
        "means, standard deviations and ends of the 95 % intervals agree within "
        "Monte-Carlo errors; "
        "largest difference {size:.3f} posterior standard deviations",
        size=f.size,
    )
    if "before" not in f.numbers:
        return words
    before = f.numbers["before"]
    return words + phrase(
        "; both were computed twice, because the first pair differed by {before:.1f} "
        "Monte-Carlo errors, by "
        "chance",
        before=before,
    )


def _move(f: Finding) -> str:
    cure = phrase("set n_node = 5") if f.numbers["nodes"] < 5 else phrase("use the sampler")
    return phrase(
        "the exact weights shift a shared parameter by {size:.2f} standard deviations "
        "(Monte-Carlo error {u:.2f}): {cure}",
        size=f.size,
        u=f.numbers["u"],
        cure=cure,
    )


def _uneven(f: Finding) -> str:
    return phrase(
        "the exact weights in all dimensions are too uneven to validate the result (k-hat "
        "{k_hat:.2f}, effective sample size {ess:.0f})",
        k_hat=f.size,
        ess=f.numbers["ess"],
    )


def _weights_agree(f: Finding) -> str:
    return phrase(
        "the exact weights in all dimensions confirm the result (k-hat {k_hat:.2f}): no "
        "shared parameter shifts by more than {size:.2f} "
        "standard deviations, with a Monte-Carlo error of {u:.2f}",
        k_hat=f.numbers["k_hat"],
        size=f.size,
        u=f.numbers["u"],
    )


def _missed(f: Finding) -> str:
    return phrase(
        "the proposal misses part of the marginal of the shared parameters: k-hat "
        "{size:.2f} is not below {limit}",
        size=f.size,
        limit=f.numbers["limit"],
    )


def _below(words: str, f: Finding) -> str:
    return phrase(words, size=f.size, limit=f.numbers["limit"])


def _brief(f: Finding) -> str:
    return phrase(
        "{size:.0f} steps are fewer than the required {limit:.0f} autocorrelation "
        "times of {tau:.1f} steps",
        size=f.size,
        limit=f.numbers["limit"],
        tau=f.numbers["tau"],
    )


WORDS: Table = MappingProxyType(
    {
        Kind.CHAIN_SHORT: lambda f: phrase(
            "sampling stopped after {n:.0f} steps although {reasons}", n=f.size, reasons=_parts(f)
        ),
        Kind.WALKERS_STUCK: _stuck,
        Kind.RHAT_HIGH: lambda f: _below(later("R-hat {size:.3f} is not below {limit}"), f),
        Kind.BULK_LOW: lambda f: _below(later("bulk ESS {size:.0f} is below {limit:.0f}"), f),
        Kind.TAIL_LOW: lambda f: _below(later("tail ESS {size:.0f} is below {limit:.0f}"), f),
        Kind.CHAIN_BRIEF: _brief,
        Kind.TAU_UNSETTLED: later("the autocorrelation time has not converged"),
        Kind.CRITERIA_MET: later("all convergence criteria are met"),
        Kind.INDEPENDENT_DRAWS: later("the draws are independent, from importance sampling"),
        Kind.DRAWS_SHORT: lambda f: _below(
            later("only {size:.0f} effective draws of {limit:.0f}"), f
        ),
        Kind.METHODS_DIFFER: _parts,
        Kind.CHAIN_DIFFERS: _differs,
        Kind.DIFFERENCE: _difference,
        Kind.CHAIN_AGREES: _agrees,
        Kind.NOT_SAMPLED: later(
            "the data contradict the stated values, so sampling of the posterior was not completed"
        ),
        Kind.TOO_MANY_PARAMETERS: lambda f: _below(
            later(
                "importance sampling is not used for more than {limit:.0f} parameters "
                "(there are {size:.0f})"
            ),
            f,
        ),
        Kind.WEIGHTS_UNRELIABLE: _unreliable,
        Kind.ERRORS_TOO_LARGE: lambda f: phrase(
            "the Monte-Carlo errors are too large for a decision: differences of up to "
            "{size:.2f} posterior standard deviations would "
            "go unnoticed",
            size=f.size,
        ),
        Kind.MARGINAL_SAMPLED: lambda f: phrase(
            "the marginal of the shared parameters was sampled well (k-hat {k_hat:.2f}, "
            "{n:.0f} effective draws)",
            k_hat=f.numbers["k_hat"],
            n=f.size,
        ),
        Kind.RUNS_COUNT_ALIKE: lambda f: phrase(
            "the readings of each of the {n:.0f} runs are assumed to scatter around their "
            "true values; if "
            "instead the true values scatter around the stated ones (values that were set, "
            "not read), a shared "
            "parameter is biased by about {size:.2g} standard deviations",
            n=f.numbers["runs"],
            size=f.size,
        ),
        Kind.MARGINAL_MISSED: _missed,
        Kind.MARGINAL_DRAWS_FEW: lambda f: _below(
            later(
                "only {size:.0f} effective draws (at least {limit:.0f} are needed): raise n_draw"
            ),
            f,
        ),
        Kind.WEIGHTS_EXACT: later(
            "every parameter was sampled and none was integrated out, so the weights are exact"
        ),
        Kind.WEIGHTS_UNEVEN: _uneven,
        Kind.WEIGHTS_MOVE: _move,
        Kind.WEIGHTS_AGREE: _weights_agree,
    }
)
