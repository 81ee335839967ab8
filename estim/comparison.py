"""The same runs with several models of their noise, side by side (`estim fit --compare`).

Estimates and widths can be compared across all models.  Predictive densities (leave-one-out) and evidences only between
models of the same data: speeds and positions are not the same data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import msgspec
import numpy as np

from estim.campaign import Campaign
from estim.campaign_file import NoiseTable
from estim.cross_validation import INFLUENTIAL, LeaveOneOut, difference, leave_one_out
from estim.levels import Levels, noise_level
from estim.pipeline import Analysis, analyse
from estim.sampling import Progress, Target

_LOO_DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model of the noise: what it is called, what it takes for granted, its table."""

    name: str
    words: str
    table: NoiseTable


@dataclass(frozen=True, eq=False)
class Compared:
    """A candidate with its analysis and its leave-one-out predictive density.

    data : "positions" or "speeds".  behind, behind_se : elpd below that of the best candidate of the same data, with its
    standard error; 0 for the best one.  The same data: the same points, so that speeds of other frames have a best of their own.
    influential : run -> abscissas of the frames with k-hat above 0.7.
    """

    candidate: Candidate
    analysis: Analysis
    loo: LeaveOneOut
    data: str
    behind: float
    behind_se: float
    influential: dict[str, list[float]]


def candidates(campaign: Campaign, run: str) -> tuple[Candidate, ...]:
    """The models of the noise that the data of `run` and its noise table allow.  Raises InputError where there is only one."""
    if campaign.curve is not None:
        raise campaign.source.places.error("is fit with the noise that its own tables state: no other model to compare", ("curve",))
    levels = Levels(campaign.source, campaign.run_names.index(run))
    table, path, _ = noise_level(levels)
    data = campaign.tables[run]
    position, speed = ("sigma_x_m", "sigma_v_m_s") if data.coordinate == "x_m" else ("sigma_theta_rad", "sigma_omega_rad_s")
    read = getattr(table, position) is not None or table.encoder_step_rad is not None
    # a scatter is of what the stated model fits: of positions, or of speeds
    of_positions, of_speeds = (table.scatter, None) if table.model == "positions" else (None, table.scatter)
    found = []
    if "t_s" in data.columns and (read or "sigma_x_m" in data.columns or of_positions is not None):
        plain = NoiseTable(
            model="positions", encoder_step_rad=table.encoder_step_rad, scatter=of_positions, **{position: getattr(table, position)}
        )
        found += _with_tails("positions", "positions as read, in time", plain)
    if "t_s" in data.columns and read:
        differentiated = NoiseTable(
            model="differentiated", derivative=table.derivative, encoder_step_rad=table.encoder_step_rad, scatter=of_speeds,
            **{position: getattr(table, position)},
        )
        found.append(Candidate("differentiated", "speeds by differences, with the covariance that follows", differentiated))
        size = _independent_size(campaign, run, differentiated)
        if size > 0.0 and data.rate not in data.columns:
            plain = NoiseTable(model="independent", derivative=table.derivative or "central", scatter=of_speeds)
            naive = msgspec.structs.replace(plain, **{speed: size})
            found.append(Candidate("independent", "the same speeds as if their errors were independent (they are not)", naive))
    if data.rate in data.columns and (getattr(table, speed) is not None or "sigma_v_m_s" in data.columns or of_speeds is not None):
        sigma_x = getattr(table, position) if table.model == "independent" else None
        plain = NoiseTable(model="independent", scatter=of_speeds, **{speed: getattr(table, speed), position: sigma_x})
        found += _with_tails("independent", "speeds as measured", plain)
    if len(found) < 2:
        rule = f"allows one model at most for run '{run}': nothing to compare (times and '{position}' would allow several)"
        raise levels.error(rule, path, field="noise")
    return tuple(found)


def _with_tails(name: str, words: str, plain: NoiseTable) -> list[Candidate]:
    shapes: dict[str, str] = {"student-t": "Student-t tails", "mixture": "some frames outliers"}
    robust = [Candidate(f"{name}, {shape}", f"{words}; {tails}", msgspec.structs.replace(plain, robust=shape)) for shape, tails in shapes.items()]
    return [Candidate(name, words, plain), *robust]


def _independent_size(campaign: Campaign, run: str, differentiated: NoiseTable) -> float:
    """Standard deviation of one differentiated speed, 0 where the size of the noise is inferred."""
    noise = campaign.problem([run], noise=differentiated).runs[0].noise
    if noise.sigma.parameter is not None:
        return 0.0
    return math.sqrt(noise.sigma.value**2 + noise.quantisation_variance) * float(noise.reading_gain()[0])


def compare_noise(
    campaign: Campaign, runs: Sequence[str], *, seed: int, target: Target | None = None,
    progress_of: Callable[[str], AbstractContextManager[Progress]] | None = None,
) -> tuple[Compared, ...]:
    """Every candidate's analysis of `runs` (jointly), in the order of `candidates`.

    Raises InputError where the runs cannot be fit jointly, or where the noise table of the first one allows nothing to compare.
    """
    campaign.problem(runs)
    done = []
    for candidate in candidates(campaign, runs[0]):
        if progress_of is None:
            analysis = analyse(campaign, runs, seed=seed, target=target, noise=candidate.table)
        else:
            with progress_of(candidate.name) as progress:
                analysis = analyse(campaign, runs, seed=seed, target=target, progress=progress, noise=candidate.table)
        done.append((candidate, analysis, leave_one_out(analysis.fit.posterior, analysis.chain.thinned(_LOO_DRAWS))))
    rows = []
    for candidate, analysis, loo in done:
        same = [other for _, a, other in done if _same_data(a, analysis)]
        best = max(same, key=lambda other: other.elpd)
        behind, se = difference(best, loo) if best is not loo else (0.0, 0.0)
        pairs = zip(analysis.problem.runs, loo.k_hat, strict=True)
        influential = {run.name: run.x[k > INFLUENTIAL].tolist() for run, k in pairs if np.any(k > INFLUENTIAL)}
        data = "positions" if analysis.problem.runs[0].noise.positions else "speeds"
        rows.append(Compared(candidate, analysis, loo, data, behind, se, influential))
    return tuple(rows)


def _same_data(a: Analysis, b: Analysis) -> bool:
    return all(p.n_obs == q.n_obs and np.array_equal(p.y, q.y) for p, q in zip(a.problem.runs, b.problem.runs, strict=True))
