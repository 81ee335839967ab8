"""`estim line`: the theta_min series and the trials of release of a campaign, in one report."""

from __future__ import annotations

from pathlib import Path

from estim.cli.options import out_folder
from estim.cli.terminal import conclude, progress_bar, report_at, reserve_output, write_report
from estim.common import phrase


def fit_line_and_trials(campaign: Path, out: Path | None, *, seed: int, figures: bool) -> bool:
    """Writes the report and says the outcome; whether all of it is ok."""
    from estim.campaign import gamma_of_body, load_campaign, resistance_of_body
    from estim.line import analyse_line, analyse_trials, read_theta_min, read_trials
    from estim.reports import line_lines, line_report, trials_lines, trials_report
    from estim.sampling import Target
    from estim.words import Voice

    loaded = load_campaign(campaign)
    loaded.study.require_body()
    source, target = loaded.source, Target()
    trials = None if source.trials is None else read_trials(source)
    series = read_theta_min(source) if trials is None or source.line is not None else None
    folder = out or out_folder(campaign, "line")
    reserve_output(folder, "result.json", "trials.json")
    line = released = None
    if series is not None:
        with progress_bar(phrase("line")) as progress:
            line = analyse_line(
                series,
                gamma_masses=gamma_of_body(source, series.body),
                seed=seed,
                target=target,
                progress=progress,
            )
    if trials is not None:
        resistance = resistance_of_body(source, trials.body)
        gamma = gamma_of_body(source, trials.body)
        with progress_bar(phrase("trials")) as progress:
            released = analyse_trials(
                trials, resistance, gamma_masses=gamma, seed=seed, target=target, progress=progress
            )
    files = {}
    if line is not None:
        files = line_report(loaded, line, trials=released, voice=Voice.COMMANDS, figures=figures)
    elif released is not None:
        files = trials_report(loaded, released, voice=Voice.COMMANDS, figures=figures)
    write_report(folder, files)
    if line is not None:
        sentences = line_lines(loaded, line) if line.status.ok else line.reasons
        conclude(phrase("line"), line.status, [*sentences, *filter(None, (line.disagreement,))])
    if released is not None:
        trial_sentences = trials_lines(loaded, released) if released.status.ok else released.reasons
        conclude(phrase("trials"), released.status, [*trial_sentences, *released.disagreements])
    report_at(folder / "report.md", source.files_outside(runs=False, line=True))
    return all(analysis.status.ok for analysis in (line, released) if analysis is not None)
