"""A whole campaign reanalysed: the line, each run by itself, the runs of each body together,
energies, the paper's bands.

The page to read for `estim reanalyse`; every stage is one of `pipeline.py`'s or stands in the file
of its verb.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estim.campaign import Campaign, gamma_of_body, gamma_origin
from estim.common import PieceStore, Quantity, Status, Stream, phrase, run_parallel, stream
from estim.fitting import Fit, fit_problem
from estim.line import LineAnalysis, ThetaMinSeries, analyse_line, read_theta_min
from estim.pipeline import Analysis, analyse
from estim.sampling import Target
from estim.studies.energy import Drift, EnergyRecord, drift_of, energy_along
from estim.studies.limits import LimitingUncertainty, Narrowing, limits, narrowing
from estim.studies.noise_comparison import ProgressOf
from estim.studies.paper_band import PropagatedBand, propagated_bands
from estim.studies.published import (
    Paper,
    PublishedComparison,
    PublishedNumber,
    compare_published,
    read_published,
)


@dataclass(frozen=True, eq=False)
class _JointResult:
    """Of the runs of a body, what needs no other fit.

    joint : all of them together.
    energies, propagated : one for each run, with the joint posterior.
    drift : whether the data show a loss of energy.
    first_runs : the first two, three, ... of them, without all.
    """

    joint: Analysis
    energies: tuple[EnergyRecord, ...]
    drift: Drift
    propagated: tuple[PropagatedBand, ...]
    first_runs: tuple[Fit, ...]


@dataclass(frozen=True, eq=False)
class BodyAnalysis(_JointResult):
    """The runs of one body.

    gamma_masses : gamma as stated, None where it was not measured.
    narrowing, limits : what more runs bring, what limits.
    """

    body: str
    gamma_masses: Quantity | None
    narrowing: Narrowing
    limits: tuple[LimitingUncertainty, ...]


@dataclass(frozen=True, eq=False)
class Reanalysis:
    """All results of a campaign.  line is None where the campaign has no theta_min series."""

    campaign: Campaign
    line: LineAnalysis | None
    single_runs: Mapping[str, Analysis]
    bodies: tuple[BodyAnalysis, ...]
    paper: Paper
    published: tuple[PublishedComparison, ...]
    seed: int

    @property
    def statuses(self) -> dict[str, Status]:
        """What was analysed -> its status."""
        by_name = {
            f"run {name}": analysis.diagnosis.status for name, analysis in self.single_runs.items()
        }
        by_name |= {
            f"joint fit of {body.body}": body.joint.diagnosis.status for body in self.bodies
        }
        return by_name | ({} if self.line is None else {"line": self.line.status})


_TaskKey = tuple[str, str]
"""What is done by itself: ("line", ""), ("run", its name) or ("body", its name)."""


@dataclass(frozen=True, eq=False)
class _TaskRunner:
    """The result of a task; the same whichever process computes it."""

    campaign: Campaign
    series: ThetaMinSeries | None
    published: Sequence[PublishedNumber]
    seed: int
    target: Target
    store: PieceStore | None

    @property
    def tasks(self) -> tuple[_TaskKey, ...]:
        bodies = dict.fromkeys(run.body for run in self.campaign.source.runs)
        runs = tuple(("run", name) for name in self.campaign.run_names)
        return (
            *((("line", ""),) if self.series is not None else ()),
            *runs,
            *(("body", body) for body in bodies),
        )

    def runs_of(self, body: str) -> list[str]:
        return [run.name for run in self.campaign.source.runs if run.body == body]

    def __call__(self, task: _TaskKey) -> LineAnalysis | Analysis | _JointResult:
        kind, name = task
        if kind == "line":
            assert self.series is not None
            gamma = gamma_of_body(self.campaign.source, self.series.body)
            return analyse_line(self.series, gamma_masses=gamma, seed=self.seed, target=self.target)
        together = analyse(
            self.campaign,
            [name] if kind == "run" else self.runs_of(name),
            seed=self.seed,
            target=self.target,
            store=self.store,
        )
        if kind == "run":
            # kept with it: the report asks for them, one run after the other
            _ = together.bands
            return together
        return self._joint_result(together)

    def _joint_result(self, joint: Analysis) -> _JointResult:
        runs = joint.problem.run_names
        first_runs = (self._first(runs[:n], joint.fit) for n in range(2, len(runs)))
        return _JointResult(
            joint,
            energies=energy_along(joint, rng=stream(self.seed, Stream.ENERGY)),
            drift=drift_of(joint),
            propagated=propagated_bands(
                joint, rng=stream(self.seed, Stream.PROPAGATED_BANDS), published=self.published
            ),
            first_runs=tuple(first_runs),
        )

    def _first(self, runs: Sequence[str], together: Fit) -> Fit:
        """The fit of some runs, near that of more of them."""
        problem = self.campaign.problem(runs)
        known = dict(zip(together.names, together.values, strict=True))
        near = np.array(
            [
                known.get(name, value)
                for name, value in zip(problem.names, problem.start(), strict=True)
            ]
        )
        with self.campaign.placing(problem):
            return fit_problem(problem, rng=stream(self.seed, Stream.NARROWING), near=near)


def reanalyse(
    campaign: Campaign,
    *,
    seed: int,
    target: Target,
    progress_of: ProgressOf,
    jobs: int = 1,
    store: PieceStore | None = None,
) -> Reanalysis:
    """The reanalysis of a campaign by `jobs` processes; the same seed gives the same numbers,
    however many there are.

    store : keeps the draws of each run, and of each body's together (`analyse`).

    Raises InputError; NumericalError where processes are killed, twice.
    """
    campaign.require_speeds(campaign.run_names, "estim reanalyse")
    paper = _published(campaign)
    work = _TaskRunner(
        campaign,
        None if campaign.source.line is None else read_theta_min(campaign.source),
        paper.number,
        seed,
        target,
        store,
    )
    done = _done(work, progress_of, jobs)
    line = done.get(("line", ""))
    single_runs = {name: done["run", name] for kind, name in work.tasks if kind == "run"}
    bodies = [
        _body(campaign, name, done[kind, name], [single_runs[run] for run in work.runs_of(name)])
        for kind, name in work.tasks
        if kind == "body"
    ]
    return Reanalysis(
        campaign,
        line,
        single_runs,
        tuple(bodies),
        paper,
        compare_published(paper.number, _numbers_of(campaign, line, bodies)),
        seed,
    )


def _done(work: _TaskRunner, progress_of: ProgressOf, jobs: int) -> dict[_TaskKey, Any]:
    """Those that take longest first: the runs that are many together."""
    tasks = sorted(work.tasks, key=lambda task: -len(work.runs_of(task[1])))
    with progress_of(
        phrase("{n} fits, {jobs} at once", n=len(tasks), jobs=min(jobs, len(tasks)))
    ) as progress:
        n_done = 0

        def on_done(task: _TaskKey) -> None:
            nonlocal n_done
            n_done += 1
            progress(100 * n_done // len(tasks), phrase("{what}: done", what=_shown(task)))

        results = run_parallel(work, tasks, jobs=jobs, on_done=on_done, wait_on_error=False)
    return dict(zip(tasks, results, strict=True))


def _shown(task: _TaskKey) -> str:
    kind, name = task
    return {"line": phrase("line"), "run": name, "body": phrase("{name}, all runs", name=name)}[
        kind
    ]


def _published(campaign: Campaign) -> Paper:
    """The paper that the campaign names; an empty one where it names none."""
    if campaign.published is None:
        return Paper()
    with campaign.source.reading(campaign.published):
        return read_published(campaign.published)


def _body(
    campaign: Campaign, body: str, together: _JointResult, single_runs: Sequence[Analysis]
) -> BodyAnalysis:
    joint = together.joint
    # a quantity stated for each run has no common value to narrow
    shared = [
        n
        for n in joint.problem.names
        if n.partition("[")[0] in ("gamma", "kappa")
        and all(n in single.problem.names for single in single_runs)
    ]
    return BodyAnalysis(
        **vars(together),
        body=body,
        gamma_masses=gamma_of_body(campaign.source, body),
        narrowing=narrowing(joint.fit, single_runs, shared, first_runs=together.first_runs),
        limits=tuple(limit for name in shared for limit in limits(joint.fit, name)),
    )


def _numbers_of(
    campaign: Campaign, line: LineAnalysis | None, bodies: list[BodyAnalysis]
) -> list[tuple[str, str | None, Quantity, str]]:
    """The values to compare with published numbers: parameter, body, value, how it was obtained."""
    numbers: list[tuple[str, str | None, Quantity, str]] = []
    for b in bodies:
        if b.gamma_masses is not None:
            origin = gamma_origin(campaign.source, b.body)
            how = phrase("{origin} in this campaign", origin=origin)
            numbers.append(("gamma", b.body, b.gamma_masses, how))
        draws, n = b.joint.chain.flat, len(b.energies)
        for parameter, column, estimate in zip(
            b.joint.problem.parameters, draws.T, b.joint.estimates, strict=True
        ):
            base = parameter.name.partition("[")[0]
            determined = b.joint.diagnosis.ok and estimate.measured
            # a value that the data do not constrain is only the stated one again
            if base in ("gamma", "kappa", "radius") and determined:
                value = Quantity(float(column.mean()), float(column.std(ddof=1)))
                how = phrase(
                    "joint fit of {n} runs of {body}, stated value as prior"
                    if parameter.prior.informative
                    else "joint fit of {n} runs of {body}",
                    n=n,
                    body=b.body,
                )
                numbers.append((base, b.body, value, how))
    if line is not None and line.status == "ok":
        for reading, how in (("york", phrase("York line")), ("posterior", phrase("Bayesian line"))):
            numbers.append(("gamma_line", line.series.body, line.readings[reading].gamma, how))
    return numbers
