"""`estim fit --compare`: every model of the noise, with the chain of each kept until its table is written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estim.cli.terminal import claim, conclude, note, progress_bar, report_at, write_report

if TYPE_CHECKING:
    from estim.campaign import Campaign
    from estim.sampling import Stop


def compare(
    campaign: Campaign, groups: Sequence[tuple[str, ...]], folder: Path, *, seed: int, max_steps: int, resume: bool, stop: Stop, figures: bool
) -> bool:
    """A table of models for each group, each model's own report beside it; whether each group has a model that is ok."""
    from estim.reports import analysis_report, compare_report, folder_of
    from estim.sampling import Store, Target
    from estim.studies import compare_noise
    from estim.words import Voice

    all_ok, stores = True, []
    for group in groups:

        place = folder if len(groups) == 1 else folder / group[0]

        def store_of(name: str, group: tuple[str, ...] = group, place: Path = place) -> Store:
            claim(place / folder_of(name), "result.json", within=folder)
            stores.append(Store(folder / ".checkpoint" / f"compare-{group[0]}-{folder_of(name)}", resume=resume, say=note, within=folder))
            return stores[-1]

        compared = compare_noise(
            campaign, group, seed=seed, target=Target(max_step=max_steps), progress_of=progress_bar,
            store_of=store_of, stop=stop,
        )
        for model in compared:
            report = analysis_report(campaign, model.analysis, voice=Voice.COMMANDS, figures=figures, profiles=False)
            write_report(place / folder_of(model.candidate.name), report, within=folder)
            conclude(f"{', '.join(group)}, {model.candidate.name}", model.analysis.diagnosis.status, ())
        write_report(place, compare_report(campaign, compared, seed=seed, figures=figures), within=folder)
        report_at(place / "report.md", campaign.source.outside())
        all_ok = all_ok and any(model.analysis.diagnosis.ok for model in compared)
    for store in stores:
        store.remove()
    return all_ok
