"""The parts of `result.json`, and how its numbers are shown; `estim.reports.result` puts them
together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import dataclass_transform

import msgspec
import numpy as np

from estim.arrays import FloatArray
from estim.checks import Check, bad_frames_found
from estim.common import Label, number, phrase, split_level
from estim.discrepancy import FoundForce
from estim.pipeline import Analysis
from estim.problem import Observations, Parameter, Problem
from estim.sampling import Summary
from estim.words import describe

DRAWS = 20_000  # of which quantiles and standard deviations are shown
LEAST_SHIFT = 0.05  # posterior standard deviations: a smaller shift is hidden by rounding
_MOST = 150  # parameters: the matrix grows with their square


@dataclass_transform(frozen_default=True)
class Record(msgspec.Struct, frozen=True):
    """A part of a file of results."""


class Report(Record, rename={"schema_": "schema"}):
    """All that a file of results says.  schema_ : name and version of its form."""

    schema_: str


class CertificateSummary(Record):
    """A second computation of the posterior, without a chain, and what comparing it with the chain
    says.
    """

    verdict: str
    reason: str
    method: str | None  # "importance sampling"
    k_hat: float | None
    ess: float | None
    n_draw: int | None
    log_evidence: float | None
    u_log_evidence: float | None
    largest_difference: float | None  # of medians and interval ends, in posterior sds


class Profile(Record):
    """Profile-posterior interval: how far a parameter can move with all others re-optimised; an
    open side has no limit.
    """

    low_68: float
    high_68: float
    low_95: float
    high_95: float
    open_low: bool  # at 95 %
    open_high: bool
    words: str


class FitSummary(Record):
    values: dict[str, float]
    sds: dict[str, float | None]
    chi2: float
    dof: int
    p_value: float | None
    message: str


class StatedValues(Record):
    """The data against what was stated of the parameters before."""

    chi2: float
    dof: int
    p_value: float
    pulls: dict[str, float]  # distance from the value by all other data, in standard deviations
    words: str


class WhatIf(Record):
    """What an error in common to all points, which no residual shows, would do."""

    error: str  # in words
    size: float  # in `unit`; "1": a share
    unit: str
    runs: list[str]
    shifts: dict[str, float]  # parameter -> by how many posterior standard deviations it moves


class Farthest(Record):
    """The point that lies farthest from the curve."""

    where: str  # "t = 3 s"
    sds: float  # its distance, in standard deviations of the data


class RunSummary(Record, omit_defaults=True):
    file: str
    x: str  # what is on the axes, with units
    y: str
    n_obs: int
    noise: str
    # why the curve is taken as complete, or how probable it is that one of the user's is not
    complete: str | None
    excluded: list[str]
    checks: dict[str, Check]
    scatter_ratio: float | None
    covered: str | None  # why tests that fail do not count; null where none fails, or they do
    # where an imported track comes from; what a fit of speeds takes as exact or leaves unused
    facts: list[str]
    warnings: list[str]  # what is suspicious about the file
    robust: bool
    outliers: list[Outlier]
    bad_frames: list[BadFrame]
    what: str  # what was fit: "speeds", "positions", ...
    derived: dict[str, Summary]
    sought: list[str]  # those of `derived` that were asked for
    # lines of rows without a value, which are left out; absent where there are none
    blank: list[int] = []
    # where the status is not ok
    farthest: Farthest | None = None


class TurningPoint(Summary, frozen=True, kw_only=True):
    never_stops: float  # share of the draws in which the body does not stop


class Sampling(Record):
    n_ensemble: int
    n_walker: int
    n_step: int
    n_burn: int
    autocorrelation_time: float | None
    acceptance: float
    message: str


class Correlation(Record):
    names: list[str]
    matrix: list[list[float]]


class Provenance(Record):
    campaign: str
    campaign_sha256: str
    data_sha256: dict[str, str]
    seed: int
    versions: dict[str, str]


@dataclass(frozen=True)
class Labels:
    """parameters : by name.  bare : the same without their levels, by name too.

    derived : run -> name of what follows from its parameters -> label.
    """

    parameters: Mapping[str, Label]
    bare: Mapping[str, Label]
    derived: Mapping[str, Mapping[str, Label]]

    def symbol(self, name: str) -> str:
        """Of a parameter ("θ₀[heavy-04]"), or of all that have `name` without their levels
        ("θ₀").
        """
        if name in self.parameters:
            return self.parameters[name].symbol
        return next(
            label.symbol for full, label in self.bare.items() if split_level(full)[0] == name
        )


def labels_of(problem: Problem, values: FloatArray) -> Labels:
    """The labels that parameters and derived quantities carry; values (n_par,)."""
    named = problem.named(values)
    return Labels(
        parameters={p.name: p.label for p in problem.parameters},
        bare={p.name: p.bare_label for p in problem.parameters},
        derived={
            run.name: {name: d.label for name, d in run.derived(run.bind(named)).items()}
            for run in problem.runs
        },
    )


class Outlier(Record):
    """A frame that is more likely an outlier than not."""

    row: int  # of the points that are fit, from 1
    x: float
    y: float
    probability: float


def outliers(analysis: Analysis, run: Observations) -> list[Outlier]:
    """Those of a run."""
    return [
        Outlier(int(i) + 1, float(run.x[i]), float(run.y[i]), float(group.probability[i]))
        for group in analysis.outliers
        if group.run == run.name
        for i in group.frames
    ]


class BadFrame(Record):
    """A frame whose reading is shifted, or from which on all are, found beside an unmodelled force;
    its shift is one more unknown of the fit.
    """

    kind: str  # "frame": this one reading; "step": all from it on; "clock": all times from it on
    t_s: float | None
    line: int | None  # of the file
    size: float  # of the shift
    sd: float
    unit: str
    probability: float  # that something is wrong there
    words: str


def bad_frames(forces: Sequence[FoundForce], run: str) -> list[BadFrame]:
    """Those of one run, in the order of time."""
    return [
        BadFrame(
            jump.kind,
            number(jump.t),
            jump.line or None,
            jump.size,
            jump.sd,
            "s" if jump.kind == "clock" else force.reading_unit,
            jump.probability,
            describe(words),
        )
        for force in forces
        if force.run == run
        for jump, words in zip(force.bad.jumps, bad_frames_found(force), strict=True)
    ]


class ParameterSummary(Summary, frozen=True, kw_only=True):
    prior: str
    prior_mean: float | None
    prior_sd: float | None
    ess_bulk: float | None
    ess_tail: float | None
    rhat: float | None
    mcse: float | None
    stated: str  # what the campaign states of it, in words and shown units; "" for nothing
    # whether the data constrain it: neither a limit nor known hardly better than before;
    # null where not ok
    measured: bool | None
    upper_95: float | None  # one-sided limit of what cannot be negative and may be zero
    true: float | None  # of synthetic data whose truth is known


def parameter_summary(truth: Mapping[str, float], analysis: Analysis, i: int) -> ParameterSummary:
    """Of the parameter at place i.  truth : name -> true value, where it is known."""
    parameter, diagnosis = analysis.problem.parameters[i], analysis.diagnosis
    estimate = analysis.estimates[i]
    return ParameterSummary(
        **msgspec.structs.asdict(estimate.summary),
        prior=_prior_words(analysis, parameter),
        prior_mean=number(parameter.prior.expectation),
        prior_sd=number(parameter.prior.sd),
        ess_bulk=number(diagnosis.ess_bulk[i]),
        ess_tail=number(diagnosis.ess_tail[i]),
        rhat=number(diagnosis.rhat[i]),
        mcse=number(diagnosis.mcse[i]),
        stated=estimate.stated,
        measured=estimate.measured if diagnosis.ok else None,
        upper_95=estimate.upper,
        true=truth.get(parameter.name),
    )


def _prior_words(analysis: Analysis, parameter: Parameter) -> str:
    """How the prior of a parameter is written that was sampled."""
    prior = parameter.prior
    fit, i = analysis.fit, analysis.problem.names.index(parameter.name)
    if not analysis.diagnosis.sampled:
        return prior.describe()
    if fit.jeffreys is not None and parameter.name in fit.jeffreys.names:
        kind = phrase("Jeffreys' prior")
    elif fit.sampled.flat is not None and fit.sampled.flat.by_size[i]:
        kind = phrase("a flat prior of its logarithm")
    else:
        return prior.describe()
    if math.isfinite(prior.low):
        return phrase("only > {low:.4g} ({kind})", low=prior.low, kind=kind)
    if math.isfinite(prior.high):
        return phrase("only < {high:.4g} ({kind})", high=prior.high, kind=kind)
    return phrase("nothing ({kind})", kind=kind)


def correlation_of(analysis: Analysis) -> Correlation:
    """Of at most `_MOST` parameters; shared ones have precedence, and the order is kept."""
    indices = analysis.problem.foremost(_MOST)
    matrix = np.atleast_2d(np.corrcoef(analysis.chain.flat[:, indices].T))
    return Correlation([analysis.problem.names[i] for i in indices], matrix.round(6).tolist())
