"""The statuses of a result, gravest first, what each means in words, and a finding: the record of something wrong."""

from __future__ import annotations

from dataclasses import dataclass

STATUSES = ("not-converged", "methods-disagree", "multimodal", "not-identified", "poor-fit", "at-bound", "ok")  # gravest first

MEANINGLESS = ("not-converged", "methods-disagree")  # the draws themselves cannot be trusted: not even limits

STATUS_WORDS = {
    "ok": "the result can be used as it stands",
    "not-converged": "the computation did not finish: no number below is a result",
    "multimodal": "several separate solutions fit the data: no single number below is a result",
    "not-identified": "data and priors do not determine the parameters: no number below is a result",
    "methods-disagree": "two methods that should agree do not: no number below is a result",
    "at-bound": "the data push a parameter against the edge of its range, farther than chance would: no number below is a result",
    "poor-fit": "the curve does not explain the data: no number below is a result",
}

PROBABILITIES = (0.68, 0.95)


@dataclass(frozen=True)
class Finding:
    """Something wrong: the status it leads to, the reason in words, and what to do about it."""

    status: str
    reason: str
    advice: str
