"""What may be missing, in words: the verdict on the candidates that were refit."""

from __future__ import annotations

from estim.common import Kind, phrase
from estim.words.table import Table, worded

WORDS: Table = {
    Kind.CAUSE_NAMED: (
        "the most likely missing effect is {name}: with it, no discrepancy remains to be "
        "explained (AIC falls by {size:.0f})"
    ),
    Kind.CAUSES_ALIKE: lambda f: worded(
        f,
        "these data cannot distinguish between: {names}. Each of these causes explains the "
        "remaining discrepancy; an independent measurement of one of them, or a different "
        "run (another tilt, another body, a longer path), would decide",
        names="; ".join(f.names),
    ),
    Kind.CAUSE_IN_PART: lambda f: worded(
        f,
        "{which} improves the fit most (AIC falls by {size:.0f}) but does not remove the "
        "lack of fit: at best it is part of the cause",
        which=phrase(" or ").join(f.names),
    ),
    Kind.CAUSE_UNKNOWN: (
        "none of the {tried:.0f} known causes explains any of the discrepancy "
        "between curve and data"
    ),
}
