"""Draws of a posterior in words: whether there are enough, and how a second computation compares
with them.
"""

from __future__ import annotations

import math

from estim.common import Finding, Kind, phrase
from estim.words.table import Table, filled, symbol, worded


def _differs(f: Finding) -> str:
    what = phrase(" and ").join(filled(WORDS, part) for part in f.parts)
    return worded(
        f,
        "chain and {test} differ (as they did before, with other random numbers) in {what}"
        if "before" in f.numbers
        else "chain and {test} differ in {what}",
        what=what,
    )


def _unreliable(f: Finding) -> str:
    k_hat = f"{f.size:.2f}" if math.isfinite(f.size) else phrase("infinite")
    return worded(
        f,
        "the importance weights are unreliable: k-hat is {shown}, above {limit}, after "
        "{draws:.0f} draws",
        shown=k_hat,
    )


def _agrees(f: Finding) -> str:
    words = worded(
        f,
        "means, standard deviations and ends of the 95 % intervals agree within "
        "Monte-Carlo errors; largest difference {size:.3f} posterior standard deviations",
    )
    if "before" not in f.numbers:
        return words
    return words + worded(
        f,
        "; both were computed twice, because the first pair differed by {before:.1f} "
        "Monte-Carlo errors, by chance",
    )


WORDS: Table = {
    Kind.CHAIN_SHORT: "sampling stopped after {n:.0f} steps although {parts}",
    Kind.WALKERS_STUCK: lambda f: worded(
        f, "{n:.0f} walkers never moved" if f.size > 1 else "{n:.0f} walker never moved"
    ),
    Kind.RHAT_HIGH: "R-hat {size:.3f} is not below {limit}",
    Kind.BULK_LOW: "bulk ESS {size:.0f} is below {limit:.0f}",
    Kind.TAIL_LOW: "tail ESS {size:.0f} is below {limit:.0f}",
    Kind.CHAIN_BRIEF: (
        "{size:.0f} steps are fewer than the required {limit:.0f} "
        "autocorrelation times of {tau:.1f} steps"
    ),
    Kind.CHAIN_HOPELESS: "at this pace {limit:.0f} steps would not be enough for {names}",
    Kind.TAU_UNSETTLED: "the autocorrelation time has not converged",
    Kind.CRITERIA_MET: "all convergence criteria are met",
    Kind.INDEPENDENT_DRAWS: "the draws are independent, from importance sampling",
    Kind.DRAWS_SHORT: "only {size:.0f} effective draws of {limit:.0f}",
    Kind.METHODS_DIFFER: "{parts}",
    Kind.CHAIN_DIFFERS: _differs,
    Kind.DIFFERENCE: (
        "the {test} of {name} by {size:+.3f} posterior standard deviations "
        "({errors:.1f} Monte-Carlo errors)"
    ),
    Kind.CHAIN_AGREES: _agrees,
    Kind.NOT_SAMPLED: ("draws would mean nothing, so sampling of the posterior was not completed"),
    Kind.TOO_MANY_PARAMETERS: (
        "importance sampling is not used for more than {limit:.0f} parameters "
        "(there are {size:.0f})"
    ),
    Kind.WEIGHTS_UNRELIABLE: _unreliable,
    Kind.ERRORS_TOO_LARGE: (
        "the Monte-Carlo errors are too large for a decision: differences of up "
        "to {size:.2f} posterior standard deviations would go unnoticed"
    ),
    Kind.MARGINAL_SAMPLED: (
        "the marginal of the shared parameters was sampled well (k-hat "
        "{k_hat:.2f}, {n:.0f} effective draws)"
    ),
    Kind.RUNS_COUNT_ALIKE: (
        "the readings of each of the {runs:.0f} runs are assumed to scatter "
        "around their true values; if instead the true values scatter around the "
        "stated ones (values that were set, not read), a shared parameter is "
        "biased by about {size:.2g} standard deviations"
    ),
    Kind.EFFECTS_FITTED: (
        "the values of {names}, which are stated as 0 within an uncertainty, are fitted here; "
        "integrated out, as in draws of the posterior, they leave another value of {name}"
    ),
    Kind.UNIFORM_PRIOR_MOVES: lambda f: worded(
        f,
        "limits on both sides state a uniform prior ({limited}); Jeffreys' prior within them would "
        "move {moved} by {size:+.1f} standard deviations: leave out a limit that nothing but "
        "caution asks for",
        limited=", ".join([*map(symbol, f.parameters[1:5]), *["…"] * (len(f.parameters) > 5)]),
        moved=symbol(f.parameters[0]),
    ),
    Kind.MARGINAL_MISSED: (
        "the proposal misses part of the marginal of the shared parameters: "
        "k-hat {size:.2f} is not below {limit}"
    ),
    Kind.MARGINAL_DRAWS_FEW: (
        "only {size:.0f} effective draws (at least {limit:.0f} are needed): raise n_draw"
    ),
    Kind.WEIGHTS_EXACT: (
        "every parameter was sampled and none was integrated out, so the weights are exact"
    ),
    Kind.WEIGHTS_UNEVEN: (
        "the exact weights in all dimensions are too uneven to validate the "
        "result (k-hat {size:.2f}, effective sample size {ess:.0f})"
    ),
    Kind.WEIGHTS_MOVE: lambda f: worded(
        f,
        "the exact weights shift a shared parameter by {size:.2f} standard deviations "
        "(Monte-Carlo error {u:.2f}): {cure}",
        cure=phrase("set n_node = 5" if f.numbers["nodes"] < 5 else "use the sampler"),
    ),
    Kind.WEIGHTS_AGREE: (
        "the exact weights in all dimensions confirm the result (k-hat "
        "{k_hat:.2f}): no shared parameter shifts by more than {size:.2f} "
        "standard deviations, with a Monte-Carlo error of {u:.2f}"
    ),
}
