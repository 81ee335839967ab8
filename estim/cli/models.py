"""`estim compare-models`: models of the body side by side, with the chain of each kept until the table is written."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from estim.cli.formats import FORMAT
from estim.cli.language import LANG
from estim.cli.options import JOINT, NO_FIGURES, RUNS, SEED, STEPS, out_folder
from estim.cli.terminal import NOT_OK, claim, conclude, groups_of, note, progress_bar, report_at, say, write_report
from estim.common import asked_to_stop, phrase

if TYPE_CHECKING:
    from estim.sampling import Progress, Store


@click.command("compare-models")
@click.argument("campaign", type=click.Path(path_type=Path))
@RUNS
@JOINT
@click.option("--model", "models", multiple=True, metavar="NAME", help="This model only; give two or more.  [default: all]")
@STEPS
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the report, made if it is not there.  [default: out/, the name of the campaign, models/]",
)
@SEED
@NO_FIGURES
@FORMAT
@LANG
@click.option("--resume", is_flag=True, help="Continue a comparison that was interrupted, from the draws kept in OUT/.checkpoint.")
def compare_models(
    campaign: Path, runs: tuple[str, ...], joint: bool, models: tuple[str, ...], max_steps: int, out: Path | None, seed: int, no_figures: bool,
    resume: bool,
) -> None:
    """Compare models of the body in CAMPAIGN: the paper's, with resistance, drag, a free start, an unmodelled force.

    All explain the same readings; evidences, leave-one-out predictions and data sets drawn from each say what the data favour, and one model is
    recommended (docs/models.md).  Exit code 3 means that no model is ok.
    """
    from estim.campaign import load_campaign
    from estim.reports import ground_words, models_report, price_words, verdicts
    from estim.sampling import Store, Target, only_writer
    from estim.studies import compare_models as compare

    loaded = load_campaign(campaign, asked=runs)
    folder = out or out_folder(campaign, "models")
    groups = groups_of(loaded, runs, joint=joint)
    claim(folder, "models.json", groups=groups)
    click.get_current_context().with_resource(only_writer(folder / ".checkpoint"))
    stop = click.get_current_context().with_resource(asked_to_stop())
    recommended, stores = True, []
    for group in groups:

        def store_of(name: str, group: tuple[str, ...] = group) -> Store:
            place = folder / ".checkpoint" / f"models-{'joint-' * joint}{group[0]}-{name}"
            stores.append(Store(place, resume=resume, say=note, within=folder))
            return stores[-1]

        def bar_of(name: str, what: str = ", ".join(group)) -> AbstractContextManager[Progress]:
            return progress_bar(f"{what}: {name}")

        what = ", ".join(group)
        comparison = compare(
            loaded, group, seed=seed, target=Target(max_step=max_steps), chosen=models, progress_of=bar_of, store_of=store_of,
            stop=stop,
        )
        place = folder if len(groups) == 1 else folder / group[0]
        write_report(place, models_report(loaded, comparison, seed=seed, figures=not no_figures), within=folder)
        for row in comparison.rows:
            conclude(f"{what}, {row.model.name}", row.analysis.diagnosis.status, ())
        say(phrase("{what}: recommended: {name}: {why}", what=what, name=comparison.recommended or phrase("none"), why=ground_words(comparison)))
        for name, why in verdicts(comparison):
            say(phrase("  not {name}: {why}", name=name, why=why))
        if price := price_words(comparison):
            say(f"  {price}")
        report_at(place / "report.md", loaded.source.outside())
        recommended = recommended and bool(comparison.recommended)
    for store in stores:
        store.remove()
    if not recommended:
        sys.exit(NOT_OK)
