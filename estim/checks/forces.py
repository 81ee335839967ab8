"""Whether the data show a force that the curve lacks, as findings."""

from __future__ import annotations

from estim.common import Finding, Kind
from estim.deviation import FoundForce

SURE = 0.95  # probability of a force beyond which it is said to be there; none of 300 simulated clean runs came so far
_UNLIKELY = 0.5
_LINEAR = 1.0  # sd: a mode that is farther from the linearised mean says that the answer to the force is not linear


def force_finding(found: FoundForce) -> Finding:
    """Whether there is a force: its size and the distance over which it changes (`names`: the unit of that)."""
    probability = found.force.probability
    kind = Kind.FORCE_FOUND if probability > SURE else Kind.FORCE_UNDECIDED if probability > _UNLIKELY else Kind.FORCE_UNLIKELY
    low, middle, high = found.force.length
    numbers = {"share": found.force.typical, "most": found.force.most, "length": middle, "short": low, "long": high}
    return Finding(kind, run=found.run, p=probability, numbers=numbers, names=(found.unit,))


def force_remarks(found: FoundForce) -> tuple[Finding, ...]:
    """What is worth a note: a force that is surely there, and readings that scatter far less than stated."""
    told = force_finding(found)
    conservative = (Finding(Kind.NOISE_CONSERVATIVE, run=found.run, size=found.noise[1]),) if found.conservative else ()
    return ((told,) if told.kind is Kind.FORCE_FOUND else ()) + conservative


def force_too_large(found: FoundForce) -> tuple[Finding, ...]:
    """That the answer to the force is not linear in it, which every interval takes for granted."""
    surely = found.force.probability > _UNLIKELY
    return (Finding(Kind.FORCE_TOO_LARGE, run=found.run, size=found.moved),) if surely and found.moved > _LINEAR else ()
