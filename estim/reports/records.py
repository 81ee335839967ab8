"""The parts of `result.json`; `estim.reports.result` puts them together."""

from __future__ import annotations

import msgspec

from estim.reports.bad_frames import BadFrame
from estim.reports.outliers import Outlier
from estim.sampling import Summary


class CertificateSummary(msgspec.Struct, frozen=True):
    """A second computation of the posterior, without a chain, and what comparing it with the chain says."""

    verdict: str
    reason: str
    method: str | None  # "quadrature" (n_draw: nodes; no k_hat, no ess) or "importance sampling"
    k_hat: float | None
    ess: float | None
    n_draw: int | None
    log_evidence: float | None
    u_log_evidence: float | None
    largest_difference: float | None  # of means, sds and ends of 95 % intervals, in posterior sds


class Profile(msgspec.Struct, frozen=True):
    """Profile-posterior interval: how far a parameter can move with all others re-optimised; an open side has no limit."""

    low_68: float
    high_68: float
    low_95: float
    high_95: float
    open_low: bool  # at 95 %
    open_high: bool
    words: str


class FitSummary(msgspec.Struct, frozen=True):
    values: dict[str, float]
    sds: dict[str, float | None]
    chi2: float
    dof: int
    p_value: float | None
    message: str


class StatedValues(msgspec.Struct, frozen=True):
    """The data against what was stated of the parameters before."""

    chi2: float
    dof: int
    p_value: float
    pulls: dict[str, float]  # distance from what all else says, in its standard deviations
    words: str


class WhatIf(msgspec.Struct, frozen=True):
    """What an error in common to all points, which no residual shows, would do."""

    error: str  # in words
    size: float  # in `unit`; "1": a share
    unit: str
    runs: list[str]
    shifts: dict[str, float]  # parameter -> by how many posterior standard deviations it moves


class CheckSummary(msgspec.Struct, frozen=True):
    statistic: float
    p_value: float
    meaning: str


class RunSummary(msgspec.Struct, frozen=True, omit_defaults=True):
    file: str
    x: str  # what is on the axes, with units
    y: str
    n_obs: int
    noise: str
    complete: str | None  # why the curve is taken as complete, or how probable it is that one of the user's is not
    excluded: list[str]
    checks: dict[str, CheckSummary]
    scatter_ratio: float | None
    covered: str | None  # why tests that fail do not count; null where none fails, or they do
    facts: list[str]  # where an imported track comes from; what a fit of speeds takes as exact or leaves unused
    warnings: list[str]  # what is suspicious about the file
    robust: bool
    outliers: list[Outlier]
    bad_frames: list[BadFrame]
    what: str  # what was fit: "speeds", "positions", ...
    derived: dict[str, Summary]
    sought: list[str]  # those of `derived` that were asked for
    blank: list[int] = []  # lines of rows without a value, which are left out; absent where there are none


class TurningPoint(Summary, frozen=True, kw_only=True):
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
