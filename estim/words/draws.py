"""Draws of a posterior in words: whether there are enough, and what a second computation says of them."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table, filled


def _parts(f: Finding) -> str:
    return "; ".join(filled(WORDS, part) for part in f.parts)


def _stuck(f: Finding) -> str:
    return f"{f.size:.0f} walker{'s' if f.size > 1 else ''} never moved"


def _differs(f: Finding) -> str:
    again = " (and before, with other random numbers)" if "before" in f.numbers else ""
    return f"chain and {f.test} differ{again} in " + " and ".join(filled(WORDS, part) for part in f.parts)


def _difference(f: Finding) -> str:
    errors = f"{f.numbers['errors']:.1f} Monte-Carlo errors"
    return f"the {f.test} of {f.parameters[0].name} by {f.size:+.3f} posterior standard deviations ({errors})"


def _unreliable(f: Finding) -> str:
    shown = f"{f.size:.2f}" if math.isfinite(f.size) else "infinite"
    return f"the importance weights cannot be trusted: k-hat is {shown}, above {f.numbers['limit']}, after {f.numbers['draws']:.0f} draws"


def _agrees(f: Finding) -> str:
    words = "means, standard deviations and ends of the 95 % intervals agree within Monte-Carlo errors"
    chance = "; both were computed twice, since the first pair differed by {:.1f} Monte-Carlo errors, by chance"
    before = chance.format(f.numbers["before"]) if "before" in f.numbers else ""
    return f"{words}; largest difference {f.size:.3f} posterior standard deviations{before}"


def _move(f: Finding) -> str:
    cure = "take n_node = 5" if f.numbers["nodes"] < 5 else "use the sampler"
    return f"exact weights move a shared parameter by {f.size:.2f} standard deviations (Monte-Carlo error {f.numbers['u']:.2f}): {cure}"


def _uneven(f: Finding) -> str:
    found = f"k-hat {f.size:.2f}, {f.numbers['ess']:.0f} effective draws"
    return f"exact weights in all dimensions are too uneven to certify the result ({found})"


def _weights_agree(f: Finding) -> str:
    return (
        f"exact weights in all dimensions agree (k-hat {f.numbers['k_hat']:.2f}): no shared parameter moves by more than {f.size:.2f} standard"
        f" deviations, with a Monte-Carlo error of {f.numbers['u']:.2f}"
    )


def _missed(f: Finding) -> str:
    return f"the proposal misses part of the marginal of the shared parameters: k-hat {f.size:.2f} is not below {f.numbers['limit']}"


WORDS: Table = MappingProxyType(
    {
        Kind.CHAIN_SHORT: lambda f: f"sampling stopped after {f.size:.0f} steps although {_parts(f)}",
        Kind.WALKERS_STUCK: _stuck,
        Kind.RHAT_HIGH: lambda f: f"R-hat {f.size:.3f} is not below {f.numbers['limit']}",
        Kind.BULK_LOW: lambda f: f"bulk ESS {f.size:.0f} is below {f.numbers['limit']:.0f}",
        Kind.TAIL_LOW: lambda f: f"tail ESS {f.size:.0f} is below {f.numbers['limit']:.0f}",
        Kind.CHAIN_BRIEF: lambda f: f"{f.size:.0f} steps are fewer than {f.numbers['limit']:.0f} autocorrelation times of {f.numbers['tau']:.1f}",
        Kind.TAU_UNSETTLED: "the autocorrelation time has not settled",
        Kind.CRITERIA_MET: "all criteria are met",
        Kind.INDEPENDENT_DRAWS: "independent draws by importance sampling",
        Kind.DRAWS_SHORT: lambda f: f"only {f.size:.0f} effective draws of {f.numbers['limit']:.0f}",
        Kind.METHODS_DIFFER: _parts,
        Kind.CHAIN_DIFFERS: _differs,
        Kind.DIFFERENCE: _difference,
        Kind.CHAIN_AGREES: _agrees,
        Kind.NOT_SAMPLED: "data and stated values contradict each other, so the posterior was not sampled to the end",
        Kind.TOO_MANY_PARAMETERS: lambda f: (
            f"importance sampling is not used for more than {f.numbers['limit']:.0f} parameters (there are {f.size:.0f})"
        ),
        Kind.WEIGHTS_UNRELIABLE: _unreliable,
        Kind.ERRORS_TOO_LARGE: lambda f: (
            f"the Monte-Carlo errors are too large to tell: differences up to {f.size:.2f} posterior standard deviations would not show"
        ),
        Kind.MARGINAL_SAMPLED: lambda f: (
            f"the marginal of the shared parameters was sampled well (k-hat {f.numbers['k_hat']:.2f}, {f.size:.0f} effective draws)"
        ),
        Kind.RUNS_COUNT_ALIKE: lambda f: (
            f"each of the {f.numbers['runs']:.0f} runs counts by its best fit for given shared parameters; flat weights of all values of its own "
            f"would move a shared parameter by {f.size:.2g} standard deviations, the more the more runs there are"
        ),
        Kind.MARGINAL_MISSED: _missed,
        Kind.MARGINAL_DRAWS_FEW: lambda f: f"only {f.size:.0f} effective draws (at least {f.numbers['limit']:.0f} are needed): raise n_draw",
        Kind.WEIGHTS_EXACT: "every parameter was sampled: nothing is integrated out, the weights are exact",
        Kind.WEIGHTS_UNEVEN: _uneven,
        Kind.WEIGHTS_MOVE: _move,
        Kind.WEIGHTS_AGREE: _weights_agree,
    }
)
