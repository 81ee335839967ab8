"""What follows a fitted curve: draws of its posterior, diagnosis, bands and a report, the same as
for a campaign.

    fit = fit_curve(...)
    analysis = write_curve_report(fit, "cooling", title="Cooling", kind="measured")

or, in two steps:

    analysis = sample_curve(fit, seed=1)
    files = curve_report(fit, analysis, title="Cooling", kind="measured")  # relative path -> bytes
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from estim.campaign import Kind
from estim.common import KINDS, FigureChoice, InputError, require_one_of, write_whole
from estim.curve_fitting import CurveFit
from estim.pipeline import Analysis, sample_curve
from estim.problem import Observations
from estim.reading import Run
from estim.reports.analysis import analysis_report
from estim.reports.result import CurveSubject
from estim.sampling import Target


def curve_report(
    fit: CurveFit, analysis: Analysis, *, title: str, kind: Kind, figures: FigureChoice = "main"
) -> dict[str, bytes]:
    """`report.md`, `result.json` and `figures/*.png` of an analysis of a fitted curve.

    fit, analysis : a curve and the draws of its posterior (`sample_curve`).  title : its heading.
    kind : "measured", "synthetic" or "published": printed on the report.
    figures : "main" (curve and data), "all" or "none".

    >>> from estim import Target, curve_report, fit_curve, sample_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> analysis = sample_curve(fit, seed=1, target=Target(ess=400.0))
    >>> files = curve_report(fit, analysis, title="A line", kind="synthetic", figures="none")
    >>> sorted(files)
    ['report.md', 'result.json']
    """
    _check(fit, kind)
    tables = {run.name: _table_of(run) for run in fit.problem.runs}
    text = hashlib.sha256(
        "; ".join(
            [fit.text, *(f"{name} = {value!r}" for name, value in fit.fixed.items())]
        ).encode()
    ).hexdigest()
    subject = CurveSubject(title, kind, fit.text, "fit_curve", text, tables)
    return analysis_report(subject, analysis, figures=figures)


def write_curve_report(
    fit: CurveFit,
    folder: str | Path,
    *,
    title: str,
    kind: Kind,
    seed: int = 1,
    target: Target | None = None,
    figures: FigureChoice = "main",
) -> Analysis:
    """Samples the posterior of a fitted curve, of one data set or of several, and writes its report
    into `folder`: `report.md`, `result.json`, `figures/`.

    fit : of `fit_curve` or `fit_curves`.  title : of the report.
    kind : "measured", "synthetic" or "published": printed on the report.
    figures : "main" (curve and data), "all" or "none".
    seed : the same one gives the same numbers.
    target : of the sampling (`estim.Target`).  Files of these names that are there are replaced,
        each whole.  Raises InputError.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from estim import fit_curve, write_curve_report
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> with TemporaryDirectory() as folder:
    ...     _ = write_curve_report(fit, folder, title="A line", kind="synthetic", figures="none")
    ...     print(sorted(path.name for path in Path(folder).iterdir()))
    ['report.md', 'result.json']
    """
    _check(fit, kind)
    analysis = sample_curve(fit, seed=seed, target=target)
    for name, data in curve_report(fit, analysis, title=title, kind=kind, figures=figures).items():
        write_whole(Path(folder) / name, data)
    return analysis


def _check(fit: CurveFit, kind: str) -> None:
    require_one_of(kind, KINDS, field="kind")
    if fit.problem.own_density:
        raise InputError(
            "needs readings about a curve, and a log density has none: use sample_curve alone",
            field="fit",
        )


def _table_of(run: Observations) -> Run:
    """The points of a data set as the table that a file would hold."""
    places = {f"x[{name}]": values for name, values in (run.places or {}).items()}
    columns = {"x": run.x, **places, "y": run.y, "u_y": run.noise.reading_gain()}
    digest = hashlib.sha256(
        b"".join(np.ascontiguousarray(column).tobytes() for column in columns.values())
    ).hexdigest()
    return Run(
        name=run.name,
        file="(arrays)",
        sha256=digest,
        columns=columns,
        lines=np.arange(1, run.n_obs + 1),
    )
