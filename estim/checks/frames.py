"""Bad frames of a run that were found beside an unmodelled force, as findings."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind
from estim.deviation import BadFrames, FoundForce, Jump

_KINDS = MappingProxyType({"frame": Kind.FRAME_OFF, "step": Kind.STEP_STAYS, "clock": Kind.FRAMES_LOST})


def bad_frame(run: str, unit: str, step: float, jump: Jump) -> Finding:
    """One bad frame.  unit : of readings.  step : of a digital reading, 0 where there is none."""
    counts = jump.size / step if step and jump.kind != "clock" else 0.0
    numbers = {
        "sd": jump.sd, "t": jump.t, "x": jump.x, "line": float(jump.line), "before": jump.before, "counts": counts,
        "frames": jump.size / jump.interval, "sd_frames": jump.sd / jump.interval,
    }
    return Finding(_KINDS[jump.kind], run=run, p=jump.probability, size=jump.size, numbers=numbers, names=(unit,))


def bad_frames_found(found: FoundForce) -> tuple[Finding, ...]:
    """One finding for each bad frame of a run."""
    return tuple(bad_frame(found.run, found.reading_unit, found.step, jump) for jump in found.bad.jumps)


def too_many_bad_frames(found: FoundForce) -> tuple[Finding, ...]:
    """That there are more bad frames than can be single ones."""
    bad: BadFrames = found.bad
    return (Finding(Kind.FRAMES_CROWD, run=found.run, size=len(bad.jumps)),) if bad.crowd else ()
