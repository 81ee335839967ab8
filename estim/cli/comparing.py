"""`estim fit --compare`: every model of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estim.cli.terminal import conclude, progress_bar, report_at, reserve_output, write_report

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.common import FigureChoice, PieceStore


def compare(
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
