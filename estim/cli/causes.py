"""What may be missing, at the command line: refit with a progress bar where something is, or where
it was requested, and reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from estim.cli.terminal import counted_progress, say
from estim.common import phrase

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.pipeline import Analysis


def with_causes(
    campaign: Campaign, analysis: Analysis, group: Sequence[str], *, requested: bool
) -> Analysis:
    """The analysis of the runs `group`, with candidates for what may be missing."""
    from estim.pipeline import asks_for_a_cause, explained

    if not (requested or asks_for_a_cause(analysis)):
        return analysis
    with counted_progress(
        phrase("{runs}: possible missing effects", runs=", ".join(group)), phrase("cause")
    ) as progress:
        result = explained(campaign, analysis, progress=progress)
    if result.explanation is None:
        say(
            phrase(
                "{runs}: possible missing effects cannot be tested, because the curve "
                "alone cannot be fitted",
                runs=", ".join(group),
            )
        )
    return result


def say_causes(analysis: Analysis) -> None:
    from estim.reports.explanation import explanation_lines

    for line in () if analysis.explanation is None else explanation_lines(analysis.explanation):
        say(f"  {line}")
