"""The report of several noise models side by side: `report.md`, `comparison.json` and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from estim.campaign import Campaign
from estim.common import FigureChoice, Files, Json, PhraseTable, number, phrase, significant
from estim.problem import Parameter
from estim.reports.models import values_figure
from estim.reports.pages import page
from estim.reports.result import provenance
from estim.sampling import K_HAT_LIMIT
from estim.studies.noise_comparison import Refit, in_common

_DATA = PhraseTable({"positions": "positions", "speeds": "speeds"})


def compare_report(
    campaign: Campaign, compared: Sequence[Refit], *, seed: int, figures: FigureChoice
) -> Files:
    """The files of a comparison, next to which each model's own report may stand in a folder of its
    name.
    """
    common = in_common(compared)
    summaries = [_summary(c, common) for c in compared]
    runs = [run.name for run in compared[0].analysis.problem.runs]
    record = {
        "title": campaign.title,
        "kind": campaign.kind,
        "runs": runs,
        "models": summaries,
        "provenance": provenance(campaign, runs, seed),
    }
    return page(
        {"figures/comparison.png": partial(values_figure, summaries, common)},
        "compare.md.j2",
        {"comparison.json": record},
        figure_choice=figures,
        kind=campaign.kind,
        title=campaign.title,
        runs=runs,
        rows=summaries,
        verdict=_verdict(summaries, common),
        common=common,
        influential=K_HAT_LIMIT,
        behind=4.0,  # difference of elpd below which models predict alike, whatever its error
        folder=folder_of,
        several_data=len({c.data for c in compared}) > 1,
        data=[_DATA[c.data] for c in compared],
    )


def _verdict(rows: Sequence[Json], common: Sequence[Parameter]) -> str:
    """Whether it matters for the estimates which of the models with status ok is taken, in one
    sentence.
    """
    ok = [row for row in rows if row["status"] == "ok"]
    if len(ok) < 2:
        return phrase("{ok} of {n} models have status ok", ok=len(ok), n=len(rows))
    values = np.array(
        [[(s.mean, s.sd) for s in (row["posterior"][p.name] for p in common)] for row in ok], float
    )
    differences = np.ptp(values[..., 0], axis=0) / np.max(values[..., 1], axis=0)
    largest = int(np.argmax(differences))
    return phrase(
        "{ok} of {n} models have status ok, and their estimates differ by at most {apart} standard "
        "uncertainties ({symbol})",
        ok=len(ok),
        n=len(rows),
        apart=significant(float(differences[largest]), 2),
        symbol=common[largest].label.symbol,
    )


def folder_of(name: str) -> str:
    """The folder of a model's own report."""
    return name.replace(", ", "-").replace(" ", "-")


def _summary(c: Refit, common: Sequence[Parameter]) -> Json:
    analysis, certificate = c.analysis, c.analysis.certificate
    posterior = {p.name: analysis.summaries[analysis.problem.names.index(p.name)] for p in common}
    evidence = certificate if certificate is not None and certificate.reliable else None
    return {
        "name": c.name,
        "words": c.words,
        "data": c.data,
        "n_obs": analysis.problem.n_obs,
        "status": analysis.diagnosis.status,
        "reasons": analysis.diagnosis.reasons,
        "posterior": posterior,
        "elpd": number(c.loo.elpd),
        "se_elpd": number(c.loo.se),
        "p_loo": number(c.loo.p_loo),
        "behind": number(c.behind),
        "se_behind": number(c.behind_se),
        "log_evidence": None if evidence is None else number(evidence.log_evidence),
        "u_log_evidence": None if evidence is None else number(evidence.u_log_evidence),
        "influential": c.influential,
    }
