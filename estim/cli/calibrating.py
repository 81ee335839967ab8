"""`estim calibrate`: simulated campaigns, with the trials of each kept until its report is
written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from estim.cli.options import (
    CAMPAIGN,
    JOBS,
    JOINT,
    OUT,
    RESUME,
    RUNS,
    Whole,
    out_folder,
    report_options,
)
from estim.cli.terminal import (
    checkpoint,
    conclude,
    counted_progress,
    exit_unless,
    groups_of,
    report_at,
    reserve_output,
    write_report,
)
from estim.common import FigureChoice, Stream, decide, phrase, stream


@click.command()
@CAMPAIGN
@RUNS
@JOINT
@click.option(
    "--simulations",
    type=Whole(20),
    default=200,
    show_default=True,
    help="Simulated campaigns for each question.",
)
@click.option(
    "--what",
    type=click.Choice(["sbc", "coverage", "both"]),
    default="both",
    show_default=True,
    help="True values: priors, or the fit.",
)
@JOBS
@OUT
@report_options
@RESUME
def calibrate(
    campaign: Path,
    runs: tuple[str, ...],
    joint: bool,
    simulations: int,
    what: Literal["sbc", "coverage", "both"],
    jobs: int,
    out: Path | None,
    seed: int,
    resume: bool,
    figures: FigureChoice,
) -> None:
    """Check on simulated data whether the intervals for CAMPAIGN have their nominal coverage.

    The curve is assumed to be complete, without the unmodelled force and the default errors of
    clock and scale for which `estim fit` allows: its intervals are wider than those checked here,
    and the report says so.

    Exit code 3 means that they do not; the report says which one is too narrow, too wide or biased.
    It also means that processes were killed, twice (too little memory?): one line says so, and
    there is no report.
    """
    from estim.calibration import campaign_design, coverage_sentence, findings, run_trials
    from estim.campaign import as_complete, load_campaign
    from estim.fitting import fit_problem
    from estim.reports.calibration import calibration_report, unlike_fit
    from estim.words import describe

    loaded = load_campaign(campaign, asked=runs)
    folder = out or out_folder(campaign, "calibration")
    groups, trusted = groups_of(loaded, runs, joint=joint), True
    for group in groups:
        loaded.require_unknowns(loaded.problem(group))
        loaded.require_draws(loaded.problem(group), of_priors=what != "coverage")
    reserve_output(folder, "calibration.json", groups=groups)
    with checkpoint(folder, resume=resume) as store:
        for group in groups:
            posed = loaded.problem(group)
            complete = as_complete(posed, "estim calibrate")
            with loaded.placing(complete):
                fit = fit_problem(complete, rng=stream(seed, Stream.CALIBRATION_FIT))
            unlike = unlike_fit(posed, loaded.problem(group, usual=True))
            design = campaign_design(loaded, group, fitted=fit.values)
            calibrations = []
            for kind in ("sbc", "coverage") if what == "both" else (what,):
                with counted_progress(
                    f"{', '.join(group)}: {kind}", phrase("campaign"), resumable=True
                ) as progress:
                    progress(0, simulations)
                    calibrations.append(
                        run_trials(
                            design,
                            fit,
                            kind,
                            n_trial=simulations,
                            seed=seed,
                            jobs=jobs,
                            progress=lambda done: progress(done, simulations),
                            store=store.with_inputs(loaded.digests(group)),
                        )
                    )
            place = folder if len(groups) == 1 else folder / group[0]
            write_report(
                place,
                calibration_report(loaded, calibrations, unlike=unlike, figures=figures),
                within=folder,
            )
            for calibration in calibrations:
                verdicts = findings(calibration)
                trusted = trusted and decide(verdicts).ok
                sentences = (
                    []
                    if calibration.what == "sbc"
                    else [coverage_sentence(calibration, name) for name in calibration.reported]
                )
                conclude(
                    f"{', '.join(group)}, {calibration.what}",
                    decide(verdicts),
                    [*map(describe, verdicts), *sentences],
                    [unlike] if unlike else [],
                )
            report_at(place, loaded.source.files_outside())
    exit_unless(trusted)
