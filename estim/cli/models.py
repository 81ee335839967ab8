"""`estim models`: what curves are known by name; `estim compare-models`: models of the body side by
side.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from estim.cli.options import (
    CAMPAIGN,
    JOINT,
    OUT_MODELS,
    RESUME,
    RUNS,
    STEPS,
    out_folder,
    report_options,
)
from estim.cli.terminal import (
    checkpoint,
    conclude,
    exit_unless,
    groups_of,
    progress_bar,
    report_at,
    reserve_output,
    say,
    write_report,
)
from estim.common import FigureChoice, InputError, phrase

if TYPE_CHECKING:
    from estim.sampling import Progress


@click.command("models")
def list_models() -> None:
    """List the curves that are known by name, and what installed packages add to estim.

    These are models, whose formulas stand beside their names, readers of files, laws of the errors
    and sections of reports (docs/extending.md).
    """
    from estim.curves import known_models
    from estim.problem import known_laws
    from estim.reading import known_readers
    from estim.reports.sections import known_sections

    for line in (*known_models(), *known_readers(), *known_laws(), *known_sections()):
        trouble = isinstance(line, InputError)
        say(f"warning: {line}" if trouble else str(line), err=trouble)


@click.command("compare-models")
@CAMPAIGN
@RUNS
@JOINT
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="NAME",
    help="This model only; give two or more.  [default: all]",
)
@STEPS
@OUT_MODELS
@report_options
@RESUME
def compare_models(
    campaign: Path,
    runs: tuple[str, ...],
    joint: bool,
    models: tuple[str, ...],
    max_steps: int,
    out: Path | None,
    seed: int,
    figures: FigureChoice,
    resume: bool,
) -> None:
    """Compare models of the body in CAMPAIGN: the paper's, with resistance, drag, a free start, an
    unmodelled force.

    All describe the same readings; they are compared by evidence, leave-one-out prediction and
    posterior predictive checks, and one model is recommended (docs/models.md).  Exit code 3 means
    that no model is ok.
    """
    from estim.campaign import load_campaign
    from estim.reports.models import ground_words, models_report, price_words, verdicts
    from estim.sampling import Target
    from estim.studies.model_comparison import compare_models as compare

    loaded = load_campaign(campaign, asked=runs)
    folder = out or out_folder(campaign, "models")
    groups = groups_of(loaded, runs, joint=joint)
    reserve_output(folder, "models.json", groups=groups)
    recommended = True
    with checkpoint(folder, resume=resume) as store:
        for group in groups:
            what = ", ".join(group)

            def bar_of(name: str, what: str = what) -> AbstractContextManager[Progress]:
                return progress_bar(f"{what}: {name}")

            comparison = compare(
                loaded,
                group,
                seed=seed,
                target=Target(max_step=max_steps),
                chosen=models,
                progress_of=bar_of,
                store=store,
            )
            place = folder if len(groups) == 1 else folder / group[0]
            write_report(
                place, models_report(loaded, comparison, seed=seed, figures=figures), within=folder
            )
            for row in comparison.rows:
                conclude(f"{what}, {row.model.name}", row.analysis.diagnosis.status, ())
            name = comparison.recommended or phrase("none")
            say(
                phrase(
                    "{what}: recommended: {name}: {why}",
                    what=what,
                    name=name,
                    why=ground_words(comparison),
                )
            )
            for name, why in verdicts(comparison):
                say(phrase("  not {name}: {why}", name=name, why=why))
            if price := price_words(comparison):
                say(f"  {price}")
            report_at(place, loaded.source.files_outside())
            recommended = recommended and bool(comparison.recommended)
    exit_unless(recommended)
