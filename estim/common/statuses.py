"""The statuses of a result, and the record of something wrong or worth knowing: the one place that
decides the first from the second.

A finding holds facts only; `estim.words` makes sentences of it, and nothing is read back out of
those.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from estim.common.finding_kinds import LEADS_TO, Kind, Status
from estim.common.labels import Label

PROBABILITIES = (0.68, 0.95)
QUANTILES = (0.025, 0.16, 0.5, 0.84, 0.975)  # the median, and the ends of their intervals


@dataclass(frozen=True)
class Amount:
    """A number that a finding gives of a parameter: `value` in the parameter's own unit, `whole`
    what it is a part of (nan: of nothing).

    label : how the parameter is shown, None where its bare name is.
    """

    name: str
    value: float = math.nan
    label: Label | None = None
    whole: float = math.nan


@dataclass(frozen=True)
class Finding:
    """Something wrong, worth knowing, or a reason for either, as facts.

    kind : what; it determines the status that follows, and what to do.
    run : the run that it is about, "" for all.
    test : name of the test or quantity that shows it, "" where the kind implies it.
    p : its probability, nan where there is none.
    size : how large or how many.
    numbers : name -> further number.  parameters : those it is about, with what it gives of them.
    names : of runs, arguments or sources that it is about.
    parts : findings that it is made of.
    """

    kind: Kind
    run: str = ""
    test: str = ""
    p: float = math.nan
    size: float = math.nan
    numbers: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    parameters: tuple[Amount, ...] = ()
    names: tuple[str, ...] = ()
    parts: tuple[Finding, ...] = ()

    @property
    def status(self) -> Status:
        """What a result is that has this finding and no graver one."""
        return LEADS_TO.get(self.kind, Status.OK)


def decide(findings: Iterable[Finding]) -> Status:
    """The status of a result: that of its gravest finding."""
    return gravest(finding.status for finding in findings)


def gravest(statuses: Iterable[Status]) -> Status:
    """The gravest of several statuses; ok where there is none."""
    return min(statuses, key=list(Status).index, default=Status.OK)


def wrong(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings with which a result is not ok, gravest first."""
    order = list(Status)
    return tuple(
        sorted(
            (f for f in findings if f.status is not Status.OK),
            key=lambda finding: order.index(finding.status),
        )
    )
