"""`result.json`: every number of an analysis in one checked record.  The report prints from it, so the two agree.

Schema "estim-result/1"; the JSON Schema stands in `docs/estim-result-1.schema.json`.  A number that does not exist
(the standard deviation at a bound, a p-value where the noise was inferred, a mean where the status is not ok) is null.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from functools import cached_property
from inspect import cleandoc
from typing import Protocol

import msgspec
import numpy as np

from estim.arrays import FloatArray
from estim.checks import Check, Diagnosis, Goodness, borne_pattern, headline, print_lines, stated_values
from estim.common import Kind, as_json, one_line, phrase
from estim.fitting import ProfileInterval
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.reading import Run
from estim.reports.bad_frames import bad_frames
from estim.reports.budget import UncertaintyBudget, budget_of, budget_records
from estim.reports.correlations import correlation_of
from estim.reports.derived import derived_facts, derived_summaries
from estim.reports.deviation import ForceSummary, deviations
from estim.reports.explanation import ExplanationSummary, explanation_summary
from estim.reports.first_screen import first_screen
from estim.reports.labels import Labels, labels_of, names_as_labels
from estim.reports.lacks import DeviationSummary, curve_deviations
from estim.reports.origin import origin_facts, origin_warnings, speed_facts
from estim.reports.outliers import outliers
from estim.reports.parameters import ParameterSummary, parameter_summary
from estim.reports.records import (
    CertificateSummary,
    CheckSummary,
    Correlation,
    FitSummary,
    Profile,
    Provenance,
    RunSummary,
    Sampling,
    StatedValues,
    TurningPoint,
    WhatIf,
)
from estim.reports.rolling import RollingSummary, rolling_summaries
from estim.sampling import number, summarise, trusted
from estim.studies import Budget, Determination
from estim.versions import engine_versions, version
from estim.words import Voice, advice_for, common_error, tell

SCHEMA = "estim-result/1"


class Result(msgspec.Struct, frozen=True, dict=True, rename={"schema_": "schema"}):
    schema_: str
    title: str
    kind: str
    formula: str | None  # of a user's own curve
    status: str
    reasons: list[str]
    advice: list[str]
    notes: list[str]
    parameters: dict[str, ParameterSummary]
    correlation: Correlation
    fit: FitSummary
    stated_values: StatedValues
    what_if: list[WhatIf]
    budget: dict[str, UncertaintyBudget] | None  # of each parameter of the curve and of what was sought; null where the status is not ok
    sampling: Sampling
    certificate: CertificateSummary
    profile: dict[str, Profile] | None
    curve_deviation: dict[str, DeviationSummary] | None  # of each run of a user's own curve, where it was asked for
    deviation: dict[str, ForceSummary] | None  # of each run, or body of runs that share one, where there is an unmodelled force
    explanation: ExplanationSummary | None  # candidates for what the curve lacks, where that was asked
    rolling: dict[str, RollingSummary] | None  # of each run of a body: the friction that rolling without slipping takes
    turning_point: dict[str, TurningPoint]
    runs: dict[str, RunSummary]
    provenance: Provenance

    @cached_property
    def labels(self) -> Labels:
        """How the numbers are shown.  `result_of` puts it beside the fields, which JSON has; a record that was read back knows names alone."""
        derived = {name: {quantity: d.unit for quantity, d in run.derived.items()} for name, run in self.runs.items()}
        return names_as_labels({name: p.unit for name, p in self.parameters.items()}, derived)

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the values that the data give, beside what had been stated, or why there are none."""
        screen = first_screen(self)
        return headline(
            screen.title, kind=self.kind, status=self.status, reasons=self.reasons, advice=self.advice, head=screen.head, rows=screen.rows,
            tests=screen.tests, left=screen.left, minds=screen.minds,
        )

    def __str__(self) -> str:
        """What `print` shows: the same in plain lines."""
        screen = first_screen(self)
        return print_lines(screen.title, status=self.status, reasons=self.reasons, advice=self.advice, shown=screen.lines)


class Subject(Protocol):
    """What was analysed and where it came from; a campaign is one."""

    @property
    def title(self) -> str: ...

    @property
    def kind(self) -> str: ...

    @property
    def formula(self) -> str | None:
        """The user's own curve as written."""

    @property
    def path(self) -> str:
        """What provenance names as the source."""

    @property
    def sha256(self) -> str:
        """Digest of the source."""

    @property
    def tables(self) -> Mapping[str, Run]:
        """Run -> its table."""

    @property
    def truth(self) -> Mapping[str, float]:
        """Parameter -> true value of synthetic data, as far as it is known."""


def result_of(
    campaign: Subject, analysis: Analysis, determination: Determination | None = None, *, budget: Budget | None = None, voice: Voice = Voice.PYTHON
) -> Result:
    """The record of an analysis, with its profile intervals if they were determined.  budget : made here where it is None.

    voice : to whom advice is given.
    """
    problem, fit, chain, diagnosis, conflict = analysis.problem, analysis.fit, analysis.chain, analysis.diagnosis, analysis.conflict
    result = Result(
        schema_=SCHEMA, title=campaign.title, kind=campaign.kind, formula=campaign.formula, status=diagnosis.status,
        reasons=list(diagnosis.reasons), advice=advice_for(diagnosis.findings, voice), notes=list(diagnosis.notes),
        parameters={p.name: parameter_summary(campaign.truth, analysis, i) for i, p in enumerate(problem.parameters)},
        correlation=correlation_of(analysis),
        fit=FitSummary(
            dict(zip(fit.names, fit.values.tolist(), strict=True)),
            {n: number(s) if diagnosis.ok else None for n, s in zip(fit.names, fit.sds, strict=True)},
            fit.chi2, fit.dof, number(fit.p_value), fit.message,
        ),
        stated_values=StatedValues(conflict.chi2, conflict.dof, conflict.p_value, dict(conflict.pulls), tell(stated_values(fit, conflict))),
        what_if=[WhatIf(common_error(i.name, i.size, i.along), i.size, i.unit, list(i.runs), dict(i.shifts)) for i in analysis.influences],
        budget=budget_records(analysis, budget or budget_of(analysis)),
        sampling=Sampling(
            chain.draws.shape[0], chain.draws.shape[2], chain.convergence.n_step, chain.n_burn, number(chain.convergence.tau),
            float(np.mean(chain.acceptance)), chain.convergence.message,
        ),
        certificate=_certificate(analysis), profile=None if determination is None else {i.name: _profile(i) for i in determination.intervals},
        curve_deviation=curve_deviations(analysis), deviation=deviations(analysis), explanation=explanation_summary(analysis.explanation),
        rolling=rolling_summaries(analysis),
        turning_point={run.name: _turning_point(analysis.ends[run.name], run, diagnosis) for run in problem.runs if run.motion is not None},
        runs={run.name: _run(campaign, analysis, i) for i, run in enumerate(problem.runs)},
        provenance=provenance(campaign, [run.name for run in problem.runs], analysis.seed),
    )
    result.__dict__["labels"] = labels_of(problem, fit.values)
    return result


def provenance(campaign: Subject, runs: list[str], seed: int) -> Provenance:
    """Where numbers came from: digests of the inputs, the seed, versions of what computed them."""
    digests = {one_line(campaign.tables[name].file): campaign.tables[name].sha256 for name in runs}
    return Provenance(one_line(campaign.path), campaign.sha256, digests, seed, software_versions())


def software_versions() -> dict[str, str]:
    """Versions of what computes the numbers."""
    return {"python": platform.python_version()} | engine_versions() | {"uncertainties": version("uncertainties")}


def _profile(i: ProfileInterval) -> Profile:
    return Profile(i.low[0.68], i.high[0.68], i.low[0.95], i.high[0.95], i.open_low[0.95], i.open_high[0.95], i.sentence)


def _certificate(analysis: Analysis) -> CertificateSummary:
    certificate, comparison = analysis.certificate, analysis.comparison
    if certificate is None:
        return CertificateSummary(comparison.verdict, comparison.reason, None, None, None, None, None, None, None)
    complete = not (analysis.fit.forces or analysis.fit.deviations)
    evidence = certificate.reliable and complete and all(math.isfinite(p.prior.sd) for p in analysis.problem.parameters)
    return CertificateSummary(
        comparison.verdict, comparison.reason, certificate.method, number(certificate.k_hat), number(certificate.ess), certificate.n_draw,
        number(certificate.log_evidence) if evidence else None, number(certificate.u_log_evidence) if evidence else None,
        number(comparison.largest_difference) if comparison.verdict != "missing" else None,
    )


def _turning_point(end: FloatArray, run: Observations, diagnosis: Diagnosis) -> TurningPoint:
    with np.errstate(invalid="ignore"):
        meaning = phrase("where the motion ends, from the release, on the scale of the positions")
        summary = trusted(summarise(end, unit=run.x_unit, meaning=meaning), diagnosis.status)
    return TurningPoint(**msgspec.structs.asdict(summary), never_stops=float(np.mean(~np.isfinite(end))))


def _run(campaign: Subject, analysis: Analysis, i: int) -> RunSummary:
    run, goodness = analysis.problem.runs[i], analysis.goodness[i]
    unasked = [one for one in analysis.diagnosis.remarks if one.kind is Kind.DEVIATION_UNASKED and one.run in ("", run.name)]
    table, derived = campaign.tables[run.name], derived_summaries(analysis, run)
    noise = run.noise.describe(x_unit=run.x_unit, y_unit=run.y_unit, words=run.words)
    return RunSummary(
        file=one_line(table.file), x=run.x_label, y=run.y_label, n_obs=run.n_obs, noise=noise,
        complete=next(map(tell, [run.complete] if run.complete else unasked), None), excluded=[tell(why) for why in run.excluded],
        checks={name: CheckSummary(c.statistic, c.p_value, c.meaning) for name, c in {**goodness.checks, **_speed_check(goodness)}.items()},
        scatter_ratio=number(goodness.scatter_ratio), covered=next(map(tell, borne_pattern(goodness)), None),
        facts=[*origin_facts(table, run, analysis.problem), *speed_facts(run), *derived_facts(analysis, run)],
        warnings=list(origin_warnings(table, run, analysis.problem)), robust=run.noise.robust, outliers=outliers(analysis, run),
        bad_frames=bad_frames(analysis.fit.forces, run.name),
        what=phrase(run.words.what),
        derived=derived, sought=[one.name for one in run.sought if one.name in derived], blank=list(table.blank),
    )


def _speed_check(goodness: Goodness) -> dict[str, Check]:
    return {} if goodness.speed is None else {"speed": goodness.speed}


def to_json(result: Result) -> bytes:
    """`result` as indented JSON."""
    return as_json(result)


def json_schema() -> bytes:
    """The JSON Schema of `result.json`."""
    schema = msgspec.json.schema(Result)
    for record in schema["$defs"].values():
        if "description" in record:
            record["description"] = cleandoc(record["description"])  # Python 3.13 does so itself
    return as_json(schema)
