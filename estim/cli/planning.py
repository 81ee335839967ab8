"""`estim plan`: what to measure next."""

from __future__ import annotations

from pathlib import Path

import click

from estim.cli.options import CAMPAIGN, OUT_PLAN, RUNS, out_folder, report_options
from estim.cli.terminal import (
    conclude,
    counted_progress,
    finish,
    groups_of,
    reserve_output,
    write_report,
)
from estim.common import FigureChoice, phrase


@click.command("plan")
@CAMPAIGN
@RUNS
@click.option(
    "--for",
    "wanted",
    multiple=True,
    metavar="NAME",
    help="A quantity to know better; may be repeated.  [default: those that are unknown]",
)
@OUT_PLAN
@report_options
def plan_next(
    campaign: Path,
    runs: tuple[str, ...],
    wanted: tuple[str, ...],
    out: Path | None,
    seed: int,
    figures: FigureChoice,
) -> None:
    """Plan which further measurements would best reduce the uncertainties of CAMPAIGN.

    The report ranks possible additions and improvements by the uncertainty that would remain, and
    states what would be needed to halve it (docs/planning.md).  Exit code 3 means that linear
    theory, on which these numbers are based, is not valid here, or that the curve as stated does
    not fit the data.
    """
    from estim.campaign import load_campaign
    from estim.planning import plan
    from estim.reports.plan import plan_answers, plan_report, plan_status

    loaded = load_campaign(campaign)
    (names,) = groups_of(loaded, runs, joint=True)
    folder = out or out_folder(campaign, "plan")
    reserve_output(folder, "plan.json")
    with counted_progress(phrase("plan"), phrase("option")) as progress:
        result = plan(loaded, names, target_names=wanted, seed=seed, progress=progress)
    write_report(folder, plan_report(result, figures=figures))
    status, reasons = plan_status(result)
    conclude(phrase("plan"), status, [*plan_answers(result), *reasons])
    finish(folder, status.ok, loaded.source.files_outside())
