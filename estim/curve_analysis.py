"""What follows a fitted curve: draws of its posterior, diagnosis, bands and a report, the same as for a campaign.

    fit = fit_curve(...)
    analysis = sample_curve(fit, seed=1)
    files = curve_report(fit, analysis, title="Cooling", kind="measured")     # relative path -> bytes
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import MappingProxyType

import numpy as np

from estim.campaign import Campaign
from estim.campaign_file import CampaignFile, Kind, LevelTable, RunTable
from estim.errors import InputError
from estim.labels import KINDS
from estim.own_curve import CurveFit
from estim.pipeline import Analysis, analyse_fit
from estim.report import analysis_report
from estim.run import Run
from estim.sampling import Progress, Target
from estim.toml_text import Places


def sample_curve(fit: CurveFit, *, seed: int, target: Target | None = None, progress: Progress | None = None) -> Analysis:
    """Draws of the posterior of a fitted curve, with diagnosis and bands; the same seed gives the same numbers.

    Without u_y the standard deviation of y is drawn too, so that its uncertainty is in every interval.

    Raises InputError where the fit leaves nothing to sample: parameters that the data do not determine, or no residuals.
    """
    if fit.status in ("not-identified", "not-converged"):
        raise InputError(f"cannot be sampled: {fit.reasons[0]}", field="fit", value=fit.status)
    if fit.sigma is not None and not fit.goodness:
        raise InputError("cannot be sampled: the curve passes through every point, so the size of the errors is unknown; give u_y", field="fit")
    return analyse_fit(fit.fit, seed=seed, target=target, progress=progress, tested=bool(fit.goodness))


def curve_report(fit: CurveFit, analysis: Analysis, *, title: str, kind: Kind) -> dict[str, bytes]:
    """`report.md`, `result.json` and `figures/*.png` of an analysis of a fitted curve.

    kind : "measured", "synthetic" or "published": printed on the report.
    """
    if kind not in KINDS:
        raise InputError(f"must be one of {', '.join(KINDS)}", field="kind", value=kind)
    run = fit.problem.runs[0]
    columns = {"x": run.x, "y": run.y, "u_y": run.noise.reading_gain()}
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(column).tobytes() for column in columns.values())).hexdigest()
    table = Run(name=run.name, file="(arrays)", sha256=digest, columns=MappingProxyType(columns), lines=np.arange(1, run.n_obs + 1))
    text = hashlib.sha256(fit.text.encode()).hexdigest()
    source = CampaignFile(
        path=Path("fit_curve"), sha256=text, places=Places("fit_curve", {}), title=title, kind=kind, published=None, shared=LevelTable(), bodies={},
        runs=(RunTable(name=run.name, body="", file="(arrays)"),), line=None,
        curve={"curve": {"expression": fit.text}, "runs": []},
    )
    return analysis_report(Campaign(source, MappingProxyType({run.name: table})), analysis)
