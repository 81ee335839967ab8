"""`result.json`: every number of an analysis in one checked record.  The report prints from it, so
the two agree; and its first screen, which the terminal and `print` show at the end as well: what
the data determine, what they do not, and what to be careful about.

Schema "estim-result/1"; the JSON Schema stands in `docs/estim-result-1.schema.json`.  A number that
does not exist (the standard deviation at a bound, a p-value where the noise was inferred, a mean
where the status is not ok) is null.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from inspect import cleandoc
from itertools import islice
from pathlib import Path
from typing import TypeAlias

import msgspec
import numpy as np

from estim.arrays import all_finite
from estim.campaign import Campaign
from estim.checks import (
    SURE,
    Estimate,
    Goodness,
    best_words,
    headline,
    not_measured,
    p_sentence,
    print_lines,
    result_table,
    screen_lines,
    stated_values,
    tolerated_pattern,
)
from estim.common import (
    Kind,
    Label,
    Status,
    as_json,
    behind,
    bracketed,
    format_quantity,
    later,
    listed,
    number,
    one_line,
    phrase,
    signed,
    significant,
    split_level,
    with_unit,
)
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.reading import Run, line_numbers
from estim.reports.derived import (
    derived_facts,
    derived_summaries,
    once,
    origin_facts,
    origin_warnings,
    speed_facts,
)
from estim.reports.explanation import ExplanationSummary, explanation_summary
from estim.reports.model_discrepancy import (
    DeviationSummary,
    ForceSummary,
    deviation_summary,
    force_summary,
)
from estim.reports.records import (
    LEAST_SHIFT,
    CertificateSummary,
    Correlation,
    Farthest,
    FitSummary,
    Labels,
    ParameterSummary,
    Profile,
    Provenance,
    Report,
    RunSummary,
    Sampling,
    StatedValues,
    TurningPoint,
    WhatIf,
    bad_frames,
    correlation_of,
    labels_of,
    outliers,
    parameter_summary,
)
from estim.reports.rolling import RollingSummary, rolling_summaries
from estim.reports.uncertainty_budget import UncertaintyBudget, budget_of, budget_records
from estim.sampling import summarise, trusted
from estim.studies.determination import Determination
from estim.studies.fit_uncertainty_budget import PRIOR, READINGS, STATED, FitBudget
from estim.versions import engine_versions, version
from estim.words import Choice, advice_for, choices_for, common_error, describe

SCHEMA = "estim-result/1"
_WHERE = {
    "poor-fit": "curve",
    "contradiction": "values",
    "at-bound": "limits",
    "not-identified": "limits",
    "multimodal": "limits",
    "not-converged": "computing",
    "methods-disagree": "computing",
}
MOST_CAUTIONS, _MOST_ERRORS, _MOST_VALUES = 2, 3, 5


@dataclass(frozen=True)
class Screen:
    """What stands first; every entry but the title, `best` and the rows that were left out (in
    `cautions`) is empty where the status is not ok.

    best : of a curve that does not fit, its values without uncertainties, in words.

    estimates : of all parameters that are not a single run's among several, and what was sought.
    table : of those measured.
    left : the others in words.
    elsewhere : which are single runs'.  cautions : warnings, a sentence each.
    sensitivity : what errors would do that no residual shows.
    """

    title: str
    best: str = ""
    tests: str = ""
    estimates: tuple[Estimate, ...] = ()
    table: str = ""
    left: str = ""
    elsewhere: str = ""
    cautions: tuple[str, ...] = ()
    sensitivity: str = ""

    @property
    def lines(self) -> list[str]:
        """What a terminal shows."""
        lines = screen_lines(self.estimates, tests=self.tests, minds=self.cautions)
        return [self.best, *lines] if self.best else lines


class Result(Report, dict=True):
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
    # of each parameter of the curve and of what was sought; null where the status is not ok
    budget: dict[str, UncertaintyBudget] | None
    sampling: Sampling
    certificate: CertificateSummary
    profile: dict[str, Profile] | None
    # of each run of a user's own curve, where it was asked for
    curve_deviation: dict[str, DeviationSummary] | None
    # of each run, or body of runs that share one, where there is an unmodelled force
    deviation: dict[str, ForceSummary] | None
    # candidates for what the curve lacks, where they were looked for
    explanation: ExplanationSummary | None
    # of each run of a body: the friction that rolling without slipping takes
    rolling: dict[str, RollingSummary] | None
    turning_point: dict[str, TurningPoint]
    runs: dict[str, RunSummary]
    provenance: Provenance
    # what the advice would have chosen, each by itself; files of older versions have none
    choices: tuple[Choice, ...] = ()

    @cached_property
    def labels(self) -> Labels:
        """How the numbers are shown: `result_of` puts it beside the fields, which JSON has."""
        raise AttributeError("a record that was read back has names alone")

    @property
    def shown_labels(self) -> Mapping[str, Label]:
        """Of the parameters: of a single run without its name."""
        return self.labels.bare if len(self.runs) == 1 else self.labels.parameters

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the values that the data give, beside what had been stated, or why
        there are none.
        """
        screen = first_screen(self)
        return headline(
            screen.title,
            kind=self.kind,
            status=self.status,
            reasons=[*self.reasons, *filter(None, [screen.best])],
            advice=self.advice,
            shown=screen.table,
            tests=screen.tests,
            left=screen.left,
            minds=screen.cautions,
        )

    def __str__(self) -> str:
        """What `print` shows: the same in plain lines."""
        screen = first_screen(self)
        return print_lines(
            screen.title,
            status=self.status,
            reasons=[*self.reasons, *filter(None, [screen.best])],
            advice=self.advice,
            shown=screen.lines,
        )


@dataclass(frozen=True, eq=False)
class CurveSubject:
    """A fitted curve as what a report is about: arrays in place of files.

    tables : run -> its columns as a table.
    truth : parameter -> its true value, of synthetic data where it is known.
    sha256 : digest of the formula and of what is fixed in it.
    """

    title: str
    kind: str
    formula: str
    path: str
    sha256: str
    tables: Mapping[str, Run]
    truth: Mapping[str, float] = field(default_factory=dict)


Subject: TypeAlias = Campaign | CurveSubject
"""What was analysed and where it came from."""


def result_of(
    campaign: Subject,
    analysis: Analysis,
    determination: Determination | None = None,
    *,
    budget: FitBudget | None = None,
) -> Result:
    """The record of an analysis, with its profile intervals if they were determined.  budget : made
    here where it is None.

    campaign : what was analysed: a `Campaign`.
    determination : profile intervals and the like; None leaves them out.

    >>> from estim import Target, analyse, load_campaign, result_of
    >>> campaign = load_campaign("data/gallery/hubble.toml", only="with-intercept")
    >>> analysis = analyse(campaign, ["with-intercept"], seed=1, target=Target(ess=400.0))
    >>> result = result_of(campaign, analysis)
    >>> result.status, round(result.parameters["H"].mean / 10.0)
    ('ok', 45)
    """
    problem = analysis.problem
    fit = analysis.fit
    chain = analysis.chain
    diagnosis = analysis.diagnosis
    conflict = analysis.conflict
    result = Result(
        schema_=SCHEMA,
        title=campaign.title,
        kind=campaign.kind,
        formula=campaign.formula,
        status=diagnosis.status,
        reasons=list(diagnosis.reasons),
        advice=advice_for(diagnosis.findings),
        notes=list(diagnosis.notes),
        parameters={
            p.name: parameter_summary(campaign.truth, analysis, i)
            for i, p in enumerate(problem.parameters)
        },
        correlation=correlation_of(analysis),
        fit=FitSummary(
            dict(zip(fit.names, fit.values.tolist(), strict=True)),
            {
                n: number(s) if diagnosis.ok else None
                for n, s in zip(fit.names, fit.sds, strict=True)
            },
            fit.chi2,
            fit.dof,
            number(fit.p_value),
            fit.message,
        ),
        stated_values=StatedValues(
            conflict.chi2,
            conflict.dof,
            conflict.p_value,
            dict(conflict.pulls),
            describe(stated_values(fit, conflict)),
        ),
        what_if=[
            WhatIf(
                common_error(i.name, i.size, i.along), i.size, i.unit, list(i.runs), dict(i.shifts)
            )
            for i in analysis.influences
        ],
        budget=budget_records(analysis, budget or budget_of(analysis)),
        sampling=Sampling(
            chain.draws.shape[0],
            chain.draws.shape[2],
            chain.convergence.n_step,
            chain.n_burn,
            number(chain.convergence.tau),
            float(np.mean(chain.acceptance)),
            chain.convergence.message,
        ),
        certificate=_certificate(analysis),
        profile=None
        if determination is None
        else {
            i.name: Profile(
                i.low[0.68],
                i.high[0.68],
                i.low[0.95],
                i.high[0.95],
                i.open_low[0.95],
                i.open_high[0.95],
                i.sentence,
            )
            for i in determination.intervals
        },
        curve_deviation={
            deviation.run: deviation_summary(analysis, deviation) for deviation in fit.deviations
        }
        or None,
        deviation={force.run: force_summary(analysis, force) for force in fit.forces} or None,
        explanation=explanation_summary(analysis.explanation),
        rolling=rolling_summaries(analysis),
        turning_point={
            run.name: _turning_point(analysis, run)
            for run in problem.runs
            if run.motion is not None
        },
        runs={run.name: _run(campaign, analysis, i) for i, run in enumerate(problem.runs)},
        provenance=provenance(campaign, problem.run_names, analysis.seed),
        choices=choices_for(diagnosis.findings),
    )
    result.__dict__["labels"] = labels_of(problem, fit.values)
    return result


def provenance(campaign: Subject, runs: Iterable[str], seed: int) -> Provenance:
    """Where numbers came from: digests of the campaign and of the tables of `runs`, the seed,
    versions of what computed them.
    """
    tables = [campaign.tables[name] for name in runs]
    digests = {table.file: table.sha256 for table in tables}
    return provenance_of(campaign.path, campaign.sha256, digests, seed)


def provenance_of(
    source: str | Path, sha256: str, digests: Mapping[str, str], seed: int
) -> Provenance:
    """The same of any source, with the `digests` of its tables."""
    shown = {one_line(file): digest for file, digest in digests.items()}
    return Provenance(one_line(str(source)), sha256, shown, seed, software_versions())


def software_versions() -> dict[str, str]:
    """Versions of what computes the numbers."""
    return (
        {"python": platform.python_version()}
        | engine_versions()
        | {"uncertainties": version("uncertainties")}
    )


def _certificate(analysis: Analysis) -> CertificateSummary:
    certificate, comparison = analysis.certificate, analysis.comparison
    if certificate is None:
        return CertificateSummary(
            comparison.verdict, comparison.reason, None, None, None, None, None, None, None
        )
    complete = not (analysis.fit.forces or analysis.fit.deviations)
    evidence = (
        certificate.reliable
        and complete
        and all(math.isfinite(p.prior.sd) for p in analysis.problem.parameters)
    )
    return CertificateSummary(
        comparison.verdict,
        comparison.reason,
        "importance sampling",
        number(certificate.k_hat),
        number(certificate.ess),
        certificate.n_draw,
        number(certificate.log_evidence) if evidence else None,
        number(certificate.u_log_evidence) if evidence else None,
        number(comparison.largest_difference) if comparison.verdict != "missing" else None,
    )


def _turning_point(analysis: Analysis, run: Observations) -> TurningPoint:
    end, diagnosis = analysis.ends[run.name], analysis.diagnosis
    with np.errstate(invalid="ignore"):
        summary = summarise(
            end,
            unit=run.x_unit,
            meaning=phrase(
                "end of the motion, measured from the release, on the scale of the positions"
            ),
        )
        summary = trusted(summary, diagnosis.status, sampled=diagnosis.sampled)
    return TurningPoint(
        **msgspec.structs.asdict(summary), never_stops=float(np.mean(~np.isfinite(end)))
    )


def _run(campaign: Subject, analysis: Analysis, i: int) -> RunSummary:
    run, goodness = analysis.problem.runs[i], analysis.goodness[i]
    unasked = [
        entry
        for entry in analysis.diagnosis.remarks
        if entry.kind is Kind.DEVIATION_UNASKED and entry.run in ("", run.name)
    ]
    # then the best values mean nothing, since others are as good
    undetermined = (Kind.SINGULAR, Kind.DIRECTION_FLAT, Kind.UNDETERMINED)
    unknown = any(finding.kind in undetermined for finding in analysis.diagnosis.findings)
    table, derived = campaign.tables[run.name], derived_summaries(analysis, run)
    return RunSummary(
        file=one_line(table.file),
        x=", ".join(run.places) if run.places else run.x_label,
        y=run.y_label,
        n_obs=run.n_obs,
        noise=run.noise.describe(x_unit=run.x_unit, y_unit=run.y_unit, words=run.words),
        complete=next(map(describe, [run.complete] if run.complete else unasked), None),
        excluded=[describe(why) for why in run.excluded],
        checks={**goodness.checks, **({"speed": goodness.speed} if goodness.speed else {})},
        scatter_ratio=number(goodness.scatter_ratio),
        covered=next(map(describe, tolerated_pattern(goodness)), None),
        facts=[
            *origin_facts(table, run, analysis.problem),
            *speed_facts(run),
            *derived_facts(analysis, run),
        ],
        warnings=list(origin_warnings(table, run, analysis.problem)),
        robust=run.noise.robust,
        outliers=outliers(analysis, run),
        bad_frames=bad_frames(analysis.fit.forces, run.name),
        what=phrase(run.words.what),
        derived=derived,
        sought=[entry.name for entry in run.sought if entry.name in derived],
        blank=list(table.blank),
        farthest=None if analysis.diagnosis.ok or unknown else _farthest(run, goodness),
    )


def _farthest(run: Observations, goodness: Goodness) -> Farthest | None:
    """Of robust noise in normal scores, since no standard deviation measures its tails."""
    far = np.abs(goodness.whitened if run.noise.robust else goodness.raw / goodness.sd)
    if far.size != run.n_obs or not all_finite(far):
        return None
    i = int(np.argmax(far))
    place = with_unit(format_quantity(float(f"{run.x[i]:.4g}")), run.x_unit)
    return Farthest(f"{run.x_label.removesuffix(bracketed(run.x_unit))} = {place}", float(far[i]))


def json_schema() -> bytes:
    """The JSON Schema of `result.json`."""
    schema = msgspec.json.schema(Result)
    for record in schema["$defs"].values():
        if "description" in record:
            record["description"] = cleandoc(record["description"])  # Python 3.13 does so itself
    return as_json(schema)


def first_screen(result: Result) -> Screen:
    """The first screen of a result."""
    runs = ", ".join(result.runs)
    title = f"{result.title}: {runs}" if result.title not in ("", runs) else runs
    if result.status != "ok":
        return Screen(title, _best(result), cautions=tuple(filter(None, [_left_out(result)])))
    counted = [run.checks["chi2"].p_value for run in result.runs.values() if "chi2" in run.checks]
    p_curve = (
        result.fit.p_value
        if result.fit.p_value is not None
        else counted[0]
        if len(counted) == 1
        else None
    )
    tests = p_sentence(p_curve, result.stated_values.p_value if result.stated_values.dof else None)
    names = [name for name in result.parameters if not _of_one_run(name, result)]
    estimates = tuple([_estimate(name, result) for name in names] + _derived_quantities(result))
    elsewhere = list(
        dict.fromkeys(
            result.labels.symbol(split_level(name)[0])
            for name in result.parameters
            if name not in names
        )
    )
    noise = [force.noise_words for force in (result.deviation or {}).values() if force.noise_words]
    cautions = filter(None, (_warnings(result), _forces(result), _limits(names, result), *noise))
    missing = filter(None, (_left_out(result), _without_a_value(estimates)))
    return Screen(
        title,
        "",
        tests,
        estimates,
        result_table(estimates),
        not_measured(estimates),
        listed(elsewhere) if elsewhere else "",
        (*missing, *islice(cautions, MOST_CAUTIONS)),
        sensitivity_words([result]),
    )


def _best(result: Result) -> str:
    """The values of the curve that fits best, but not well, without those that were stated."""
    if result.status not in (Status.POOR_FIT, Status.AT_BOUND):
        return ""
    run, farthest = max(
        ((name, run.farthest) for name, run in result.runs.items() if run.farthest is not None),
        key=lambda of_run: of_run[1].sds,
        default=("", None),
    )
    if farthest is None:
        return ""
    labels = result.shown_labels
    values = [
        f"{labels[name].symbol} = "
        + with_unit(
            significant(
                (result.fit.values[name] if p.limit is None else p.limit.edge) * labels[name].factor
            ),
            labels[name].unit,
        )
        for name, p in result.parameters.items()
        if p.prior != "normal"
        and (p.stated or p.prior_sd is None)
        and not _of_one_run(name, result)
    ]
    return best_words(
        [*values[:_MOST_VALUES], *["…"] * (len(values) > _MOST_VALUES)],
        farthest.sds,
        farthest.where if len(result.runs) == 1 else f"{farthest.where} ({run})",
    )


def first_reasons(reasons: Sequence[str]) -> list[str]:
    """Those of `reasons`, gravest first, that the first screen has room for: one at least."""
    length = np.cumsum([len(words) for words in reasons])
    # of reasons why there is no result
    return list(reasons[: max(1, min(3, int(np.sum(length <= 240))))])


def opened_by(result: Result) -> frozenset[str]:
    """The parts of a report that stand open: the one that holds the reason where there is no
    result, and what is suspicious about the data.
    """
    doubtful = (
        {"data"}
        if any(run.warnings or run.bad_frames or run.outliers for run in result.runs.values())
        else set[str]()
    )
    if result.status == "ok":
        return frozenset(doubtful | ({"curve"} if result.explanation is not None else set()))
    return frozenset(doubtful | {_WHERE.get(result.status, "computing")})


def _of_one_run(name: str, result: Result) -> bool:
    return len(result.runs) > 1 and split_level(name)[1].strip("[]") in result.runs


def _estimate(name: str, result: Result) -> Estimate:
    p = result.parameters[name]
    label = result.shown_labels[name]
    # a prior with a width that nobody stated
    inferred = "" if p.stated or p.prior_sd is None else p.prior + behind(label.unit)
    return Estimate(label, p, p.stated, bool(p.measured), p.upper_95, p.true, inferred)


def _derived_quantities(result: Result) -> list[Estimate]:
    """What a user wanted computed: once where it is the same for all runs, else run by run."""
    entries = (
        (name, run, Estimate(result.labels.derived[run][name], entry.derived[name], "", True))
        for run, entry in result.runs.items()
        for name in entry.sought
    )
    return [
        replace(entry, label=replace(entry.label, symbol=entry.label.symbol + (run and f"[{run}]")))
        for _, run, entry in once(
            entries,
            len(result.runs),
            lambda a, b: (a.summary.mean, a.summary.sd) == (b.summary.mean, b.summary.sd),
        )
    ]


def _limits(shown: Sequence[str], result: Result) -> str:
    """What holds back the first quantity that the data measure: one thing that was stated, or the
    readings.
    """
    symbols = result.shown_labels
    for name in shown:
        budget = (result.budget or {}).get(name)
        if budget is None or not result.parameters[name].measured or not budget.sources:
            continue
        first, symbol = budget.sources[0], symbols[name].symbol
        # share of the variance from which one source is what limits
        if first.share < 0.5 or first.source == name:
            continue
        if first.kind == READINGS and result.stated_values.dof:
            return phrase(
                "the readings contribute {share:.0f} % of the variance of {symbol}: more "
                "readings, or "
                "better ones, reduce it",
                share=100.0 * first.share,
                symbol=symbol,
            )
        if first.kind in (STATED, PRIOR) and first.source in symbols:
            other = symbols[first.source].symbol
            names = result.correlation.names  # of hundreds of runs not all
            r = (
                result.correlation.matrix[names.index(name)][names.index(first.source)]
                if {name, first.source} <= set(names)
                else 0.0
            )
            return phrase(
                "{symbol} and {other} are strongly correlated ({r}): a better {other} helps, "
                "more readings do not"
                if abs(r) >= 0.6  # correlation that is worth its number
                else "{symbol} depends on the stated value of {other}: a better {other} helps, "
                "more readings do not",
                symbol=symbol,
                other=other,
                r=signed(f"{r:+.2f}"),
            )
    return ""


def _forces(result: Result) -> str:
    """Whether the curve lacks something for sure."""
    forces = [
        deviation for deviation in (result.deviation or {}).values() if deviation.probability > SURE
    ]
    if forces:
        return phrase(
            "there is an unmodelled force of about {size:.2g} % of the weight; the "
            "intervals allow for it",
            size=100.0 * max(deviation.typical for deviation in forces),
        )
    if any(deviation.probability > SURE for deviation in (result.curve_deviation or {}).values()):
        return phrase(
            "the curve and independent errors do not explain the data alone; the intervals "
            "allow for an irregular deviation, but not for a different curve"
        )
    complete = [run.complete for run in result.runs.values() if run.complete is not None]
    if complete and result.formula is None:
        return phrase(
            "the curve is assumed to be complete: no interval allows for an unmodelled effect"
        )
    return complete[0] if complete else ""


def _left_out(result: Result) -> str:
    """Which rows have no value, where there are some."""
    blank = {name: run.blank for name, run in result.runs.items() if run.blank}
    lines = [line for missing in blank.values() for line in missing]
    if not lines:
        return ""
    return phrase(
        "rows excluded because a value is missing: {n} ({runs})"
        if len(result.runs) > 1
        else "1 row was excluded because a value is missing (line {lines})"
        if len(lines) == 1
        else "{n} rows were excluded because a value is missing (lines {lines})",
        n=len(lines),
        runs=listed(list(blank)),
        lines=line_numbers(lines),
    )


def _without_a_value(estimates: Sequence[Estimate]) -> str:
    """The requested quantities that have no value at some of the draws."""
    # at an edge there is no mean, and every quantile
    symbols = [estimate.label.symbol for estimate in estimates if estimate.summary.median is None]
    if not symbols:
        return ""
    return phrase(
        "there is no value for some of the draws (a division by zero, a root or logarithm "
        "of a negative "
        "number): {symbols}",
        symbols=listed(symbols),
    )


def _warnings(result: Result) -> str:
    """What is suspicious about the data: one warning of a file in its words, else numbers, since
    the part with the details stands open.
    """
    runs = result.runs.values()
    n, bad, far = (
        sum(len(entries) for entries in all_runs)
        for all_runs in zip(*((r.warnings, r.bad_frames, r.outliers) for r in runs), strict=True)
    )
    if n == 1 and not bad and not far:
        return next(words for run in runs for words in run.warnings)
    counted = (
        (n, later("{n} warning about a file"), later("{n} warnings about files")),
        (bad, later("{n} bad frame"), later("{n} bad frames")),
        (far, later("{n} likely outlier"), later("{n} likely outliers")),
    )
    counts = [phrase(singular if k == 1 else plural, n=k) for k, singular, plural in counted if k]
    return (
        phrase("{counts}: see the section on data and noise", counts=", ".join(counts))
        if counts
        else ""
    )


def sensitivity_words(results: Sequence[Result]) -> str:
    """'1 mm of sag would shift θ₀ by +0.9 standard uncertainties': the parameter of `results` that
    each error moves most.
    """
    largest: dict[str, tuple[float, str]] = {}
    for result in results:
        symbols = result.shown_labels
        for effect in [effect for effect in result.what_if if effect.shifts][:_MOST_ERRORS]:
            name = max(effect.shifts, key=lambda parameter: abs(effect.shifts[parameter]))
            largest[effect.error] = max(
                largest.get(effect.error, (0.0, "")),
                (effect.shifts[name], symbols[name].symbol),
                key=lambda entry: abs(entry[0]),
            )
    noticeable = {error: entry for error, entry in largest.items() if abs(entry[0]) >= LEAST_SHIFT}
    return "; ".join(
        phrase(
            "{error} would shift {symbol} by {shift} standard uncertainties",
            error=error,
            symbol=symbol,
            shift=signed(f"{shift:+.1f}"),
        )
        for error, (shift, symbol) in noticeable.items()
    )
