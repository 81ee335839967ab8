"""A whole campaign reanalysed: the line, each run by itself, the runs of each body together, energies, the paper's bands.

The page to read for `estim reanalyse`; every stage is one of `pipeline.py`'s or stands in the file of its verb.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from estim.campaign import Campaign, gamma_of_body, gamma_origin
from estim.common import Quantity, Status, Stream, stream
from estim.fitting import Fit
from estim.line import LineAnalysis, analyse_line, read_theta_min
from estim.pipeline import Analysis, analyse
from estim.problem import informative
from estim.sampling import Progress, Target
from estim.studies.energy import Drift, EnergyRecord, drift_of, energy_along
from estim.studies.limits import Limit, Narrowing, limits, narrowing
from estim.studies.paper_band import PropagatedBand, propagated_bands
from estim.studies.published import PublishedNumber, PublishedValue, compare_published, read_published

ProgressOf = Callable[[str], AbstractContextManager[Progress]]
"""Given what is being sampled, a context in which its progress is shown."""

_OF_BODY = ("gamma", "kappa")
_COMMAND = "estim reanalyse"


@dataclass(frozen=True, eq=False)
class BodyAnalysis:
    """The runs of one body.

    gamma_masses : gamma as stated, None where it was not measured.  joint : all its runs together.
    energies, propagated : one for each run, with the joint posterior.  drift : whether the data show a loss of energy.
    narrowing, limits : what more runs bring, what limits.
    """

    body: str
    gamma_masses: Quantity | None
    joint: Analysis
    energies: tuple[EnergyRecord, ...]
    drift: Drift
    propagated: tuple[PropagatedBand, ...]
    narrowing: Narrowing
    limits: tuple[Limit, ...]


@dataclass(frozen=True, eq=False)
class Reanalysis:
    """Everything that a campaign says.  line is None where the campaign has no theta_min series."""

    campaign: Campaign
    line: LineAnalysis | None
    singles: Mapping[str, Analysis]
    bodies: tuple[BodyAnalysis, ...]
    paper: str
    published: tuple[PublishedValue, ...]
    seed: int

    @property
    def statuses(self) -> dict[str, Status]:
        """What was analysed -> its status."""
        found = {f"run {name}": analysis.diagnosis.status for name, analysis in self.singles.items()}
        found |= {f"joint fit of {body.body}": body.joint.diagnosis.status for body in self.bodies}
        return found | ({} if self.line is None else {"line": self.line.status})


def reanalyse(campaign: Campaign, *, seed: int, target: Target, progress_of: ProgressOf) -> Reanalysis:
    """The reanalysis of a campaign; the same seed gives the same numbers.  Raises InputError."""
    campaign.study.require_speeds(campaign.run_names, _COMMAND)
    paper, numbers = _published(campaign)
    line = None
    if campaign.source.line is not None:
        series = read_theta_min(campaign.source)
        with progress_of("line") as progress:
            line = analyse_line(series, gamma_masses=gamma_of_body(campaign.source, series.body), seed=seed, target=target, progress=progress)
    singles = {}
    for name in campaign.run_names:
        with progress_of(name) as progress:
            singles[name] = analyse(campaign, [name], seed=seed, target=target, progress=progress)
    bodies = []
    for body in dict.fromkeys(run.body for run in campaign.source.runs):
        with progress_of(f"{body}, all runs") as progress:
            bodies.append(_analyse_body(campaign, body, singles, seed, target, progress))
    return Reanalysis(campaign, line, singles, tuple(bodies), paper, compare_published(numbers, _found(campaign, line, bodies)), seed)


def _published(campaign: Campaign) -> tuple[str, Sequence[PublishedNumber]]:
    """The paper that the campaign names and its numbers; "" and none where it names none."""
    if campaign.published is None:
        return "", ()
    with campaign.source.reading(campaign.published):
        return read_published(campaign.published)


def _analyse_body(
    campaign: Campaign, body: str, singles: Mapping[str, Analysis], seed: int, target: Target, progress: Progress
) -> BodyAnalysis:
    runs = [run.name for run in campaign.source.runs if run.body == body]
    joint = analyse(campaign, runs, seed=seed, target=target, progress=progress)

    def fit_first(n: int) -> Fit:
        return campaign.fit(campaign.problem(runs[:n]), rng=stream(seed, Stream.NARROWING))

    # a quantity stated for each run has no common value to narrow
    shared = [n for n in joint.problem.names if n.partition("[")[0] in _OF_BODY and all(n in singles[run].problem.names for run in runs)]
    return BodyAnalysis(
        body=body, gamma_masses=gamma_of_body(campaign.source, body), joint=joint, energies=energy_along(joint, rng=stream(seed, Stream.ENERGY)),
        drift=drift_of(joint, rng=stream(seed, Stream.DRIFT)),
        propagated=propagated_bands(joint, rng=stream(seed, Stream.PROPAGATED_BANDS)),
        narrowing=narrowing(joint.fit, [singles[name] for name in runs], shared, fit_first=fit_first),
        limits=tuple(limit for name in shared for limit in limits(joint.fit, name)),
    )


def _found(campaign: Campaign, line: LineAnalysis | None, bodies: list[BodyAnalysis]) -> list[tuple[str, str | None, Quantity, str]]:
    """What the reanalysis has to say on published numbers: parameter, body, value, how it was found."""
    found: list[tuple[str, str | None, Quantity, str]] = []
    for b in bodies:
        draws = b.joint.chain.flat
        if b.gamma_masses is not None:
            found.append(("gamma", b.body, b.gamma_masses, gamma_origin(campaign.source, b.body) + " in this campaign"))
        for i, (name, estimate) in enumerate(zip(b.joint.problem.names, b.joint.estimates, strict=False)):
            base = name.partition("[")[0]
            if base in ("gamma", "kappa", "radius") and estimate.measured:  # what the data leave as it was stated is no second opinion
                value = Quantity(float(draws[:, i].mean()), float(draws[:, i].std(ddof=1)))
                given = informative(b.joint.problem.parameters[i].prior)
                found.append((base, b.body, value, f"{len(b.energies)} runs of {b.body} together" + (", stated value as prior" if given else "")))
        if b.joint.diagnosis.ok and b.drift.determined:
            worst = max(b.energies, key=lambda e: abs(e.extreme_relative.value)).extreme_relative
            means = [e.mean_relative for e in b.energies]
            mean, u = float(np.mean([abs(m.value) for m in means])), float(np.mean([m.u for m in means]))
            found.append(("energy_change_mean", b.body, Quantity(mean, u), f"mean size over the runs of {b.body}"))
            found.append(("energy_change_extreme", b.body, Quantity(abs(worst.value), worst.u), f"largest over the runs of {b.body}"))
    if line is not None and line.status == "ok":
        found.append(("gamma_line", line.series.body, line.readings["york"].gamma, "York line"))
        found.append(("gamma_line", line.series.body, line.readings["posterior"].gamma, "Bayesian line"))
    return found
