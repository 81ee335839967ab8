"""Whether the data show a force that the curve lacks, as findings."""

from __future__ import annotations

from collections.abc import Iterable

from estim.common import Finding, Kind
from estim.discrepancy import SCALES, FoundForce

FAR_LARGER = 2.5  # times the scale of its prior: an amplitude that one force in 80 exceeds
# probability of a force beyond which it counts as found; none of 300 simulated clean runs came so
# far
SURE = 0.95
LIKELY = 0.5  # probability from which something is there rather than not
# sd: a mode that a linear curve would have farther away shows that the response to the force is not
# linear
_LINEAR = 1.0


def force_finding(force: FoundForce) -> Finding:
    """Whether there is a force: its size, in percent of the weight, and the distance over which it
    changes (`names`: the unit of that).
    """
    probability = force.force.probability
    kind = (
        Kind.FORCE_FOUND
        if probability > SURE
        else Kind.FORCE_UNDECIDED
        if probability > LIKELY
        else Kind.FORCE_UNLIKELY
    )
    low, middle, high = force.force.length
    numbers = {
        "share": 100.0 * force.force.typical,
        "most": 100.0 * force.force.most,
        "length": middle,
        "short": low,
        "long": high,
        "runs": len(force.runs),
    }
    return Finding(kind, run=force.run, p=probability, numbers=numbers, names=(force.unit,))


def noise_finding(force: FoundForce) -> Finding | None:
    """Where the readings scatter plainly otherwise than stated: far less, more, or more than there
    is room for; else None.
    """
    run, runs, (low, middle, high) = force.run, {"runs": len(force.runs)}, force.noise
    if force.too_large > LIKELY:
        kind = Kind.NOISE_TOO_LARGE
        return Finding(kind, run=run, p=force.too_large, size=max(SCALES), numbers=runs)
    if force.larger > SURE:
        numbers = {"low": low, "high": high, **runs}
        return Finding(Kind.NOISE_LARGER, run=run, p=force.larger, size=middle, numbers=numbers)
    if force.conservative:
        return Finding(Kind.NOISE_CONSERVATIVE, run=run, size=middle, numbers=runs)
    return None


def force_remarks(force: FoundForce) -> tuple[Finding, ...]:
    """What is worth a note: a force that is surely there, and readings that scatter otherwise than
    stated.
    """
    finding, noise = force_finding(force), noise_finding(force)
    return ((finding,) if finding.kind is Kind.FORCE_FOUND else ()) + (
        (noise,) if noise is not None and noise.status.ok else ()
    )


def beyond_their_priors(forces: Iterable[FoundForce]) -> list[Finding]:
    """The runs whose force, or whose scatter of the readings, is more than there is room for, or
    beyond the range where the response to it is linear.
    """
    findings = []
    for force in forces:
        times, noise = force.force.amplitude[1] / force.scale, noise_finding(force)
        if times > FAR_LARGER:
            findings.append(
                Finding(
                    Kind.FORCE_TOO_LARGE,
                    run=force.run,
                    size=times,
                    numbers={"share": 100.0 * force.force.typical, "runs": len(force.runs)},
                )
            )
        if force.force.probability > LIKELY and force.moved > _LINEAR:
            findings.append(
                Finding(
                    Kind.FORCE_NOT_LINEAR if force.positions else Kind.SPEEDS_NOT_LINEAR,
                    run=force.run,
                    size=force.moved,
                    numbers={"runs": len(force.runs)},
                )
            )
        if noise is not None and not noise.status.ok:
            findings.append(noise)
    return findings
