"""`estim propagate`: a measurement model by the GUM and by Monte Carlo."""

from __future__ import annotations

import os
import re
from pathlib import Path

import click

from estim.cli.options import OUT, report_options
from estim.cli.terminal import conclude, counted_progress, finish, reserve_output, say, write_report
from estim.common import FigureChoice, InputError, Stream, phrase, stream

_FORMULA = re.compile(r"(?!.*\.toml$).*[=*+^(]", re.IGNORECASE)


@click.command()
@click.argument("file", metavar="FILE|FORMULA")
@click.argument("values", metavar="[NAME=VALUE]...", nargs=-1)
@OUT
@report_options
def propagate(
    file: str, values: tuple[str, ...], out: Path | None, seed: int, figures: FigureChoice
) -> None:
    """Uncertainty of a measurement model FILE, or of a FORMULA: the GUM and Monte Carlo side by
    side, with a budget (docs/propagation.md).

    A formula goes with the values of its inputs: estim propagate "g = 4*pi**2*L/T**2"
    L="0.85(1) m" T="1.851(3) s".
    """
    from estim.campaign import pairs
    from estim.measurement_model import model_of_formula, read_model
    from estim.measurement_model import propagate as propagate_model
    from estim.reports.measurement import measurement_report, statement

    inputs = pairs(values, "NAME")
    if not inputs and _FORMULA.match(file) and not os.path.exists(file):
        rule = 'is a formula: write the values of its inputs after it, as L="0.85(1) m"'
        raise InputError(rule, field="FILE|FORMULA", value=file)
    model = model_of_formula(file, inputs) if inputs else read_model(Path(file))
    folder = out or Path("out") / (model.outputs[0].name if inputs else Path(file).stem)
    reserve_output(folder, "result.json")
    with counted_progress("Monte Carlo", phrase("draw")) as progress:
        propagation = propagate_model(
            model, rng=stream(seed, Stream.MEASUREMENT), progress=progress
        )
    write_report(folder, measurement_report(propagation, seed=seed, figures=figures))
    for i, (output, status) in enumerate(zip(model.outputs, propagation.statuses, strict=True)):
        if status.ok:
            say(statement(propagation, i))
        else:
            conclude(output.name, status, propagation.notes)
    finish(folder, all(status.ok for status in propagation.statuses))
