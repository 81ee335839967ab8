"""The command line: the only file that prints, and that decides what is written.  Heavy imports are
local to the commands.

Exit codes: 0 the result is ok; 2 the input is wrong (one line on stderr); 3 a result is not ok (the
report is written all the same); 74 what was done could not be printed on stdout (a full disk); 130
interrupted; 141 the reader of stdout ended before.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from estim.cli.averaging import mean
from estim.cli.batching import batch
from estim.cli.bodies import body
from estim.cli.calibrating import calibrate
from estim.cli.importing import import_file
from estim.cli.line import line
from estim.cli.mapping import map_motions
from estim.cli.models import compare_models, list_models
from estim.cli.new import new_campaign
from estim.cli.options import (
    CAMPAIGN,
    FOLDER,
    JOBS,
    JOINT,
    OUT,
    PATH,
    RESUME,
    RUNS,
    STEPS,
    out_folder,
    report_options,
)
from estim.cli.origin import SIMULATION
from estim.cli.planning import plan_next
from estim.cli.propagating import propagate
from estim.cli.serving import serve
from estim.cli.tables import curve_options, load_or_make
from estim.cli.terminal import (
    announced,
    checkpoint,
    conclude,
    counted_progress,
    exit_code,
    exit_unless,
    finish,
    groups_of,
    progress_bar,
    report_at,
    reserve_output,
    run_label,
    say,
    with_json,
    write_report,
)
from estim.cli.verifying import diff, verify
from estim.common import (
    FigureChoice,
    InputError,
    PieceStore,
    Stream,
    ended_by_signals,
    inputs_read,
    language,
    phrase,
    spoken,
    stream,
)

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.common import FigureChoice, PieceStore
    from estim.pipeline import Analysis
    from estim.studies.energy import Drift, EnergyRecord


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    invoke_without_command=True,
    commands=[
        batch,
        body,
        calibrate,
        compare_models,
        import_file,
        line,
        list_models,
        mean,
        map_motions,
        new_campaign,
        plan_next,
        propagate,
        serve,
        verify,
        diff,
    ],
)
@click.version_option(package_name="estim")
def cli() -> None:
    """Uncertainties and Bayesian parameter estimation for lab experiments.

    Start with a table, estim fit data.csv --formula "a*exp(-x/tau) + c", or with a campaign, one
    TOML file that says what was measured: estim new NAME --from data.csv, then estim fit NAME.toml
    (docs/README.md).
    """
    context = click.get_current_context()
    if context.invoked_subcommand is None:
        for line in context.get_help().splitlines():
            say(line)
    context.obj = context.with_resource(inputs_read())
    context.with_resource(spoken(language(), commands=True))


@cli.command()
@click.argument("paths", nargs=-1, required=True, metavar="CAMPAIGN|FILE...", type=PATH)
@RUNS
@JOINT
@STEPS
@OUT
@report_options
@curve_options
@click.option(
    "--marginal/--full",
    default=None,
    help="Sample a joint fit through the marginal over its runs, or all unknowns at once.  "
    "[default: the marginal for more than 14 unknowns, if the runs share no force]",
)
@click.option(
    "--compare",
    is_flag=True,
    help="Fit with every model of the noise that the data allow, and tabulate them.",
)
@click.option(
    "--explain",
    is_flag=True,
    help="Tabulate possible missing effects, each refitted.  [default: where one is missing]",
)
@click.option(
    "--section",
    "sections",
    multiple=True,
    metavar="NAME",
    help="Add to the report what an installed package writes (docs/extending.md).",
)
@RESUME
def fit(
    paths: tuple[Path, ...],
    runs: tuple[str, ...],
    joint: bool,
    max_steps: int,
    out: Path | None,
    seed: int,
    marginal: bool | None,
    compare: bool,
    explain: bool,
    sections: tuple[str, ...],
    resume: bool,
    figures: FigureChoice,
    options: Mapping[str, Any],
) -> None:
    """Fit runs of CAMPAIGN, or the points of tables FILE..., and write a report.

    A table needs no campaign: estim fit data.csv --formula "a*exp(-x/tau) + c" --start tau=2.  The
    report ends with the equivalent campaign file (docs/your-own-curve.md).  Several tables are
    runs: with --joint they share all parameters except those named by --own.

    Each run is fitted separately unless --joint is given.  Exit code 3 means that a result is not
    reliable; the report explains why.  With the extra `arviz` installed the draws are written too,
    as draws.nc (docs/interop.md).

    The draws of each run that is done are kept in OUT/.checkpoint until all reports are written.
    After Ctrl-C (exit code 130), a kill or a crash, the same command with --resume takes them from
    there and samples the others; a run that was under way begins anew, and so does one whose data,
    priors, noise, settings, seed or versions have changed (docs/long-runs.md).
    """
    loaded, folder = load_or_make(paths[0], options, out, runs, paths[1:])
    groups = groups_of(loaded, runs, joint=joint)
    if marginal and not joint:
        raise InputError("needs --joint: a single run has no shared parameters", field="--marginal")
    if options["own"] and not joint:
        rule = "needs --joint: by itself each table has its own values of all parameters"
        raise InputError(rule, field="--own", value=options["own"][0])
    if compare and (explain or sections or marginal is not None):
        raise InputError(
            "cannot be combined with --explain, --section, --marginal or --full", field="--compare"
        )
    if sections:  # before the fit, which takes longer
        from estim.reports.sections import sections_called

        sections_called(sections)
    reserve_output(folder, "comparison.json" if compare else "result.json", groups=groups)
    with checkpoint(folder, resume=resume) as store:
        if compare:
            all_ok = compare_models_of_noise(
                loaded, groups, folder, seed=seed, max_steps=max_steps, store=store, figures=figures
            )
        else:
            all_ok = _fit_groups(
                loaded,
                groups,
                folder,
                seed=seed,
                max_steps=max_steps,
                marginal=marginal,
                explain=explain,
                sections=sections,
                store=store,
                figures=figures,
                file=paths[0].name,
            )
    exit_unless(all_ok)


def _fit_groups(
    campaign: Campaign,
    groups: Sequence[tuple[str, ...]],
    folder: Path,
    *,
    seed: int,
    max_steps: int,
    marginal: bool | None,
    explain: bool,
    sections: Sequence[str],
    store: PieceStore,
    figures: FigureChoice,
    file: str,
) -> bool:
    """Fits each group of runs and writes its report; whether all are ok.  file : the name of the
    file that was named to be fit.
    """
    from estim.pipeline import analyse
    from estim.reports.analysis import index_report, report_and_result
    from estim.reports.explanation import slip_words
    from estim.reports.interop import HOW_TO_GET, can_write_netcdf, to_netcdf
    from estim.reports.pages import with_campaign
    from estim.reports.result import first_screen
    from estim.sampling import Target
    from estim.words import first_step

    results, explanations = {}, []
    for group in groups:
        with progress_bar(run_label(group)) as progress:
            analysis = analyse(
                campaign,
                group,
                seed=seed,
                target=Target(max_step=max_steps),
                progress=progress,
                store=store,
                marginal=marginal,
            )
        analysis = with_causes(campaign, analysis, group, requested=explain)
        place = folder if len(groups) == 1 else folder / group[0]
        command = "estim fit --joint" if len(group) > 1 else "estim fit"
        with progress_bar(run_label(group)) as progress:
            progress(100, phrase("report and figures"))
            files, results[group[0]] = report_and_result(
                campaign, analysis, figures=figures, sections=sections
            )
            draws = {"draws.nc": to_netcdf(analysis)} if can_write_netcdf() else {}
            write_report(
                place,
                with_campaign(files, campaign.source.written, file=file, command=command) | draws,
                within=folder,
            )
        lines = first_screen(results[group[0]]).lines
        if not analysis.diagnosis.ok:
            slip, step = slip_words(analysis.explanation), first_step(analysis.diagnosis.findings)
            lines = [*filter(None, [slip]), *analysis.diagnosis.reasons, *lines]
            lines += [] if slip else [phrase("first step: {words}", words=step)]
        if len(results) == 1 and (
            columns := campaign.columns([name for group in groups for name in group])
        ):
            say(columns)
            for fact in dict.fromkeys(chain.from_iterable(map(campaign.assumed, group))):
                say(fact)
        conclude(run_label(group), analysis.diagnosis.status, lines, analysis.diagnosis.notes)
        say_causes(analysis)
        explanations += [] if analysis.explanation is None else [analysis.explanation]
    if len(groups) > 1:
        write_report(folder, index_report(campaign, results, explanations))
    report_at(folder, campaign.source.files_outside())
    if not can_write_netcdf():
        say(
            phrase(
                "draws.nc (the draws, for ArviZ and xarray) was not written: {how}", how=HOW_TO_GET
            )
        )
    return all(result.status == "ok" for result in results.values())


@cli.command()
@CAMPAIGN
@RUNS
@JOINT
@STEPS
@OUT
@report_options
def energy(
    campaign: Path,
    runs: tuple[str, ...],
    joint: bool,
    max_steps: int,
    out: Path | None,
    seed: int,
    figures: FigureChoice,
) -> None:
    """Check the energy along the runs of CAMPAIGN: how much is lost, and is the loss steady?

    Exit code 3 is also returned if the data do not reduce the assumed uncertainty of the loss.
    """
    from estim.campaign import load_campaign
    from estim.pipeline import analyse
    from estim.reports.energy import energy_lines, energy_report
    from estim.sampling import Target
    from estim.studies.energy import drift_of, energy_along, energy_status

    loaded = load_campaign(campaign, asked=runs)
    loaded.require_body()
    analyses: list[Analysis] = []
    records: list[EnergyRecord] = []
    drifts: list[Drift] = []
    groups = groups_of(loaded, runs, joint=joint)
    names = [name for group in groups for name in group]
    loaded.require_speeds(names, "estim energy")
    loaded.require_complete(names, "estim energy")
    folder = out or out_folder(campaign, "energy")
    reserve_output(folder, "result.json")
    for group in groups:
        with progress_bar(run_label(group)) as progress:
            analyses.append(
                analyse(
                    loaded,
                    group,
                    seed=seed,
                    target=Target(max_step=max_steps),
                    progress=progress,
                    complete="estim energy",
                )
            )
        records.extend(energy_along(analyses[-1], rng=stream(seed, Stream.ENERGY)))
        drifts.append(drift_of(analyses[-1]))
        conclude(
            run_label(group),
            energy_status(analyses[-1], drifts[-1]),
            energy_lines(analyses[-1], drifts[-1]),
        )
    write_report(
        folder, energy_report(loaded, analyses, records, drifts, seed=seed, figures=figures)
    )
    ok = all(energy_status(*pair).ok for pair in zip(analyses, drifts, strict=True))
    finish(folder, ok, loaded.source.files_outside())


@cli.command()
@CAMPAIGN
@STEPS
@JOBS
@OUT
@report_options
@RESUME
def reanalyse(
    campaign: Path,
    max_steps: int,
    jobs: int,
    out: Path | None,
    seed: int,
    figures: FigureChoice,
    resume: bool,
) -> None:
    """Analyse everything in CAMPAIGN and write one report.

    It contains the theta_min line, each run separately, the joint fit of each body, energies, the
    propagated band and the posterior band, and published and reanalysed values.  The numbers are
    the same for any number of --jobs.
    """
    from estim.campaign import load_campaign
    from estim.reports.reanalysis import called, reanalysis_lines, reanalysis_report
    from estim.sampling import Target
    from estim.studies.reanalysis import reanalyse as run_reanalysis

    loaded = load_campaign(campaign)
    loaded.require_body()
    folder = out or out_folder(campaign, "reanalysis")
    loaded.require_speeds(loaded.run_names, "estim reanalyse")
    reserve_output(folder, "result.json")
    with checkpoint(folder, resume=resume) as store:
        result = run_reanalysis(
            loaded,
            seed=seed,
            target=Target(max_step=max_steps),
            progress_of=announced,
            jobs=jobs,
            store=store,
        )
        write_report(folder, reanalysis_report(result, figures=figures))
    sentences = reanalysis_lines(result)
    for what, status in result.statuses.items():
        conclude(called(what), status, sentences.get(what, ()))
    ok = all(status.ok for status in result.statuses.values())
    finish(folder, ok, loaded.source.files_outside(line=True, published=True))


@cli.command()
@click.argument("design", type=PATH)
@click.option("--out", required=True, type=FOLDER, help="Folder for the campaign.")
def simulate(design: Path, out: Path) -> None:
    """Make a SYNTHETIC campaign from DESIGN (a TOML file): runs, theta_min series, campaign.toml
    and the truth.
    """
    from estim.campaign import load_design, simulate_campaign

    files = simulate_campaign(load_design(design))
    contents = {name: text.encode() for name, text in files.items()}
    write_report(out, contents, manifest=SIMULATION)
    say(f"synthetic campaign: {out / 'campaign.toml'} ({len(files)} files)")


for _command in {*cli.commands.values()} - {serve}:  # which has no result
    with_json(_command)


def main() -> None:
    """Entry point: one line on stderr and an exit code in place of a traceback; no warnings of
    NumPy, about which a user can do nothing.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    os.environ["MPLBACKEND"] = "agg"  # figures are files, whatever a user's sessions draw on
    sys.exit(exit_code(_run))


def _run() -> object:
    with ended_by_signals():
        return cli.main(standalone_mode=False)


if __name__ == "__main__":
    main()


def with_causes(
    campaign: Campaign, analysis: Analysis, group: Sequence[str], *, requested: bool
) -> Analysis:
    """The analysis of the runs `group`, with candidates for what may be missing."""
    from estim.pipeline import asks_for_a_cause, explained

    if not (requested or asks_for_a_cause(analysis)):
        return analysis
    with counted_progress(
        phrase("{runs}: possible missing effects", runs=", ".join(group)), phrase("cause")
    ) as progress:
        result = explained(campaign, analysis, progress=progress)
    if result.explanation is None:
        say(
            phrase(
                "{runs}: possible missing effects cannot be tested, because the curve "
                "alone cannot be fitted",
                runs=", ".join(group),
            )
        )
    return result


def say_causes(analysis: Analysis) -> None:
    from estim.reports.explanation import explanation_lines

    for words in () if analysis.explanation is None else explanation_lines(analysis.explanation):
        say(f"  {words}")


def compare_models_of_noise(
    campaign: Campaign,
    groups: Sequence[tuple[str, ...]],
    folder: Path,
    *,
    seed: int,
    max_steps: int,
    store: PieceStore,
    figures: FigureChoice,
) -> bool:
    """A table of models for each group, each model's own report beside it; whether each group has a
    model that is ok.
    """
    from estim.reports.analysis import analysis_report
    from estim.reports.comparison import compare_report, folder_of
    from estim.sampling import Target
    from estim.studies.noise_comparison import compare_noise

    all_ok = True
    for group in groups:
        place = folder if len(groups) == 1 else folder / group[0]
        for candidate in campaign.noise_models(group[0]):
            reserve_output(place / folder_of(candidate.name), "result.json", within=folder)
        compared = compare_noise(
            campaign,
            group,
            seed=seed,
            target=Target(max_step=max_steps),
            progress_of=progress_bar,
            store=store,
        )
        for model in compared:
            report = analysis_report(campaign, model.analysis, figures=figures, profiles=False)
            write_report(place / folder_of(model.name), report, within=folder)
            conclude(f"{', '.join(group)}, {model.name}", model.analysis.diagnosis.status, ())
        write_report(
            place, compare_report(campaign, compared, seed=seed, figures=figures), within=folder
        )
        report_at(place, campaign.source.files_outside())
        all_ok = all_ok and any(model.analysis.diagnosis.ok for model in compared)
    return all_ok
