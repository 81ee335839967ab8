"""`estim propagate`: a measurement model by the GUM and by Monte Carlo."""

from __future__ import annotations

from pathlib import Path

from estim.cli.terminal import conclude, pieces, report_at, reserve_output, say, write_report
from estim.common import Stream, phrase, stream


def say_propagated(file: Path, folder: Path, *, seed: int, figures: bool) -> bool:
    """Writes the report of a measurement model and says its results; whether every output has
    one.
    """
    from estim.measurement import propagate, read_model
    from estim.reports import measurement_lines, measurement_report

    model = read_model(file)
    reserve_output(folder, "result.json")
    with pieces("Monte Carlo", phrase("draw")) as progress:
        propagation = propagate(model, rng=stream(seed, Stream.MEASUREMENT), progress=progress)
    write_report(folder, measurement_report(propagation, seed=seed, figures=figures))
    for output, status, line in zip(
        model.outputs, propagation.statuses, measurement_lines(propagation), strict=True
    ):
        if status.ok:
            say(line)
        else:
            conclude(output.name, status, propagation.notes)
    report_at(folder / "report.md", ())
    return all(status.ok for status in propagation.statuses)
