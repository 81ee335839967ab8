"""What follows a fitted curve: draws of its posterior, diagnosis, bands and a report, the same as for a campaign.

    fit = fit_curve(...)
    analysis = sample_curve(fit, seed=1)
    files = curve_report(fit, analysis, title="Cooling", kind="measured")     # relative path -> bytes
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from estim.campaign import Kind
from estim.common import KINDS, InputError
from estim.curve_fit import CurveFit
from estim.pipeline import Analysis
from estim.reading import Run
from estim.reports.analysis import analysis_report


@dataclass(frozen=True, eq=False)
class CurveSubject:
    """A fitted curve as what a report is about: arrays in place of files.

    tables : run -> its columns as a table.  truth : parameter -> its true value, of synthetic data where it is known.
    sha256 : digest of the formula and of what is fixed in it.
    """

    title: str
    kind: str
    formula: str
    path: str
    sha256: str
    tables: Mapping[str, Run]
    truth: Mapping[str, float] = field(default_factory=dict)


def curve_report(fit: CurveFit, analysis: Analysis, *, title: str, kind: Kind, figures: bool = True) -> dict[str, bytes]:
    """`report.md`, `result.json` and `figures/*.png` of an analysis of a fitted curve.

    kind : "measured", "synthetic" or "published": printed on the report.  figures : whether there are any.
    """
    if kind not in KINDS:
        raise InputError(f"must be one of {', '.join(KINDS)}", field="kind", value=kind)
    run = fit.problem.runs[0]
    columns = {"x": run.x, "y": run.y, "u_y": run.noise.reading_gain()}
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(column).tobytes() for column in columns.values())).hexdigest()
    table = Run(
        name=run.name, file="(arrays)", sha256=digest, columns=MappingProxyType(columns), lines=np.arange(1, run.n_obs + 1),
        facts=tuple(f"{name} is fixed at {value:.10g}" for name, value in fit.fixed.items()),
    )
    text = hashlib.sha256("; ".join([fit.text, *(f"{name} = {value!r}" for name, value in fit.fixed.items())]).encode()).hexdigest()
    subject = CurveSubject(title, kind, fit.text, "fit_curve", text, MappingProxyType({run.name: table}))
    return analysis_report(subject, analysis, figures=figures)
