"""What each status means."""

from __future__ import annotations

from estim.common import PhraseTable, Status

STATUS_WORDS = PhraseTable(
    {
        Status.CONTRADICTION: (
            "the data contradict the stated values: no number below is a valid result"
        ),
        Status.NOT_CONVERGED: (
            "the computation was not completed: no number below is a valid result"
        ),
        Status.METHODS_DISAGREE: (
            "two methods that should agree do not: no number below is a valid result"
        ),
        Status.MULTIMODAL: (
            "several separate solutions fit the data: no single number below is a valid result"
        ),
        Status.NOT_IDENTIFIED: (
            "data and priors do not determine the parameters: no number below is a valid result"
        ),
        Status.POOR_FIT: "the curve does not fit the data: no number below is a valid result",
        Status.AT_BOUND: (
            "the data push a parameter against the edge of its range by more than chance "
            "would explain: no number "
            "below is a valid result"
        ),
        Status.NOT_CALIBRATED: (
            "the intervals do not have their nominal coverage of simulated true values"
        ),
        Status.OK: "the result can be used as it stands",
    }
)


def status_words(status: str) -> str:
    """What a status means."""
    return STATUS_WORDS[Status(status)]
