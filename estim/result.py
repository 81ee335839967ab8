"""`result.json`: every number of an analysis in one checked record.  The report prints from it, so the two agree.

Schema "estim-result/1"; the JSON Schema stands in `docs/estim-result-1.schema.json`.  A number that does not exist
(the standard deviation at a bound, a p-value where the noise was inferred) is null.
"""

from __future__ import annotations

import math
import platform
from importlib.metadata import version

import msgspec
import numpy as np
from numpy.typing import NDArray

from estim.bands import PROBABILITIES
from estim.campaign import Campaign
from estim.pipeline import Analysis
from estim.problem import Observations

FloatArray = NDArray[np.float64]

SCHEMA = "estim-result/1"
_PACKAGES = ("estim", "numpy", "scipy", "lmfit", "emcee", "arviz-stats", "uncertainties")


class Summary(msgspec.Struct, frozen=True):
    """Posterior of one quantity, SI units and radians."""

    unit: str
    meaning: str
    mean: float | None
    sd: float | None
    median: float | None
    q025: float | None
    q16: float | None
    q84: float | None
    q975: float | None


class ParameterSummary(Summary, frozen=True):
    prior: str
    prior_mean: float | None
    prior_sd: float | None
    ess_bulk: float | None
    ess_tail: float | None
    rhat: float | None
    mcse: float | None


class FitSummary(msgspec.Struct, frozen=True):
    values: dict[str, float]
    sds: dict[str, float | None]
    chi2: float
    dof: int
    p_value: float | None
    message: str


class CheckSummary(msgspec.Struct, frozen=True):
    statistic: float
    p_value: float
    meaning: str


class RunSummary(msgspec.Struct, frozen=True):
    file: str
    x: str  # what is on the axes, with units
    y: str
    n_obs: int
    noise: str
    excluded: list[str]
    checks: dict[str, CheckSummary]
    scatter_ratio: float | None
    derived: dict[str, Summary]


class TurningPoint(Summary, frozen=True):
    never_stops: float  # share of the draws in which the body does not stop


class Sampling(msgspec.Struct, frozen=True):
    n_ensemble: int
    n_walker: int
    n_step: int
    n_burn: int
    autocorrelation_time: float | None
    acceptance: float
    message: str


class Correlation(msgspec.Struct, frozen=True):
    names: list[str]
    matrix: list[list[float]]


class Provenance(msgspec.Struct, frozen=True):
    campaign: str
    campaign_sha256: str
    data_sha256: dict[str, str]
    seed: int
    versions: dict[str, str]


class Result(msgspec.Struct, frozen=True, rename={"schema_": "schema"}):
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
    sampling: Sampling
    certificate: None
    turning_point: dict[str, TurningPoint]
    runs: dict[str, RunSummary]
    provenance: Provenance


def result_of(campaign: Campaign, analysis: Analysis) -> Result:
    """The record of an analysis."""
    problem, fit, chain, diagnosis = analysis.problem, analysis.fit, analysis.chain, analysis.diagnosis
    flat = chain.flat
    return Result(
        schema_=SCHEMA, title=campaign.title, kind=campaign.kind, formula=campaign.formula, status=diagnosis.status,
        reasons=list(diagnosis.reasons), advice=list(dict.fromkeys(finding.advice for finding in diagnosis.findings)), notes=list(diagnosis.notes),
        parameters={p.name: _parameter(analysis, i) for i, p in enumerate(problem.parameters)},
        correlation=Correlation(list(problem.names), np.atleast_2d(np.corrcoef(flat.T)).round(6).tolist()),
        fit=FitSummary(
            dict(zip(fit.names, fit.values.tolist(), strict=True)), {n: number(s) for n, s in zip(fit.names, fit.sds, strict=True)},
            fit.chi2, fit.dof, number(fit.p_value), fit.message,
        ),
        sampling=Sampling(
            chain.draws.shape[0], chain.draws.shape[2], chain.convergence.n_step, chain.n_burn, number(chain.convergence.tau),
            float(np.mean(chain.acceptance)), chain.convergence.message,
        ),
        certificate=None,
        turning_point={b.run: _turning_point(b.end, run) for b, run in zip(analysis.bands, problem.runs, strict=True) if run.origin is not None},
        runs={run.name: _run(campaign, analysis, i) for i, run in enumerate(problem.runs)},
        provenance=provenance(campaign, [run.name for run in problem.runs], analysis.seed),
    )


def provenance(campaign: Campaign, runs: list[str], seed: int) -> Provenance:
    """Where numbers came from: digests of the inputs, the seed, versions of what computed them."""
    digests = {campaign.tables[name].file: campaign.tables[name].sha256 for name in runs}
    return Provenance(str(campaign.source.path), campaign.source.sha256, digests, seed, software_versions())


def software_versions() -> dict[str, str]:
    """Versions of what computes the numbers."""
    return {"python": platform.python_version()} | {package: version(package) for package in _PACKAGES}


def number(value: float) -> float | None:
    """`value`, or None where JSON has no word for it."""
    return float(value) if math.isfinite(value) else None


def summarise(draws: FloatArray, *, unit: str, meaning: str) -> Summary:
    """Mean, sd and quantiles of draws (n_draw,)."""
    return Summary(unit, meaning, number(draws.mean()), number(draws.std(ddof=1)), *_quantiles(draws))


def _quantiles(draws: FloatArray) -> list[float | None]:
    tails = [0.5, *sorted(0.5 + sign * 0.5 * p for p in PROBABILITIES for sign in (-1, 1))]
    ordered = np.sort(draws)
    if np.all(np.isfinite(ordered)):
        return [number(q) for q in np.quantile(ordered, tails)]
    return [number(ordered[round(q * (ordered.size - 1))]) for q in tails]


def _parameter(analysis: Analysis, i: int) -> ParameterSummary:
    parameter, diagnosis = analysis.problem.parameters[i], analysis.diagnosis
    summary = summarise(analysis.chain.flat[:, i], unit=parameter.unit, meaning=parameter.meaning)
    return ParameterSummary(
        **msgspec.structs.asdict(summary), prior=parameter.prior.describe(),
        prior_mean=number(parameter.prior.centre) if math.isfinite(parameter.prior.sd) else None,
        prior_sd=number(parameter.prior.sd), ess_bulk=number(diagnosis.ess_bulk[i]), ess_tail=number(diagnosis.ess_tail[i]),
        rhat=number(diagnosis.rhat[i]), mcse=number(diagnosis.mcse[i]),
    )


def _turning_point(end: FloatArray, run: Observations) -> TurningPoint:
    with np.errstate(invalid="ignore"):
        summary = summarise(end, unit=run.x_unit, meaning="where the motion ends, from the release")
    return TurningPoint(**msgspec.structs.asdict(summary), never_stops=float(np.mean(~np.isfinite(end))))


def _run(campaign: Campaign, analysis: Analysis, i: int) -> RunSummary:
    run, goodness = analysis.problem.runs[i], analysis.goodness[i]
    draws = analysis.chain.thinned(20_000)
    derived = run.curve.derived(run.bind(analysis.problem.named(draws)))
    noise = run.noise.describe(position_unit=run.x_unit, speed_unit=run.y_unit)
    return RunSummary(
        file=campaign.tables[run.name].file, x=run.x_label, y=run.y_label, n_obs=run.n_obs, noise=noise, excluded=list(run.excluded),
        checks={name: CheckSummary(c.statistic, c.p_value, c.meaning) for name, c in goodness.checks.items()},
        scatter_ratio=number(goodness.scatter_ratio),
        derived={name: summarise(np.ravel(d.values), unit=d.unit, meaning=d.meaning) for name, d in derived.items() if np.size(d.values) > 1},
    )


def to_json(result: Result) -> bytes:
    """`result` as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n"


def json_schema() -> bytes:
    """The JSON Schema of `result.json`."""
    return msgspec.json.format(msgspec.json.encode(msgspec.json.schema(Result)), indent=1) + b"\n"
