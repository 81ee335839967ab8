"""A campaign as it might be measured next: with other data and, of rolling bodies, further runs,
smaller errors of readings, longer ways.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import msgspec

from estim.campaign.binding import KINDS_OF_QUANTITIES
from estim.campaign.bodies import RollingCampaign
from estim.campaign.campaign import Campaign
from estim.campaign.campaign_file import CampaignFile, LevelTable, NoiseTable, RunTable
from estim.campaign.curve_campaign import CurveCampaign
from estim.campaign.lookup_levels import read_at
from estim.campaign.plan_table import PlannedRunTable
from estim.campaign.prior_table import PriorTable, Value, times
from estim.common import Quantity, read_quantity
from estim.discrepancy import FORCE_SCALE
from estim.problem import Parameter, Prior, Problem, as_prior, shared_first
from estim.reading import Run

_SIZES = ("sigma_x_m", "sigma_theta_rad", "sigma_v_m_s", "sigma_omega_rad_s", "encoder_step_rad")
_FAR = ("x_max_m", "theta_max_rad")
_PLANNED = {"phi": "phi_deg", "theta0": "theta0_deg", "gamma": "gamma"}


@dataclass(frozen=True, eq=False)
class NewRun:
    """A run that might be measured: `name`, and all that the run `like` has except for these
    `quantities`, in SI units.

    A gamma of its own means the disk of that body with another particle: kappa and all else stay,
    and the force on its track is its own.
    """

    name: str
    like: str
    quantities: Mapping[str, Quantity]


def planned_quantities(
    source: CampaignFile, table: PlannedRunTable, index: int
) -> dict[str, Quantity]:
    """What a planned run states of itself, in SI units.  Raises InputError with its line."""
    quantities = {}
    for name, key in _PLANNED.items():
        written = getattr(table, key)
        if written is not None:
            path = ("plan", "runs", index, key)
            value = read_at(source, written, path, factor=KINDS_OF_QUANTITIES[name].keys[key])
            if not isinstance(value, Quantity):
                raise source.error('must be a number or "value +/- uncertainty"', path)
            kind = KINDS_OF_QUANTITIES[name]
            if not kind.low <= value.value <= kind.high:
                raise source.error("lies outside what is possible", path, value=written)
            quantities[name] = value
    return quantities


def quantity_of_key(key: str) -> tuple[str, float] | None:
    """The quantity that a key of a campaign states, and the factor of the key's unit to SI; None
    for a key of no quantity.
    """
    return next(
        ((name, kind.keys[key]) for name, kind in KINDS_OF_QUANTITIES.items() if key in kind.keys),
        None,
    )


def with_runs(campaign: Campaign, runs: Sequence[NewRun]) -> Campaign:
    """The campaign with further runs, whose tables are those of the runs that they are like."""
    source, tables = campaign.source, dict(campaign.tables)
    by_name = {run.name: run for run in source.runs}
    further = tuple(_further(by_name[run.like], run) for run in runs)
    files = {**source.files, **{run.name: source.files[run.like] for run in runs}}
    tables |= {run.name: replace(tables[run.like], name=run.name) for run in runs}
    return _of(
        replace(source, runs=(*source.runs, *further), files=MappingProxyType(files)), tables
    )


def otherwise(campaign: Campaign, *, reading_error: float = 1.0, reach: float = 1.0) -> Campaign:
    """The campaign with the errors of its readings, and the far ends of its windows, these factors
    as large.
    """
    changed = partial(_otherwise, error=reading_error, reach=reach)
    return _of(campaign.source.with_levels(changed), campaign.tables)


def with_tables(campaign: Campaign, tables: Mapping[str, Run]) -> Campaign:
    """The campaign with other data."""
    return replace(campaign, tables=MappingProxyType(dict(tables)))


def axis_columns(campaign: Campaign) -> tuple[str, str]:
    """The columns of x and y of a user's own curve.  Raises InputError where it has several x."""
    assert isinstance(campaign, CurveCampaign), "asked of a campaign with a formula"
    if campaign.abscissas:
        raise campaign.source.error(
            "must name a single column: estim plan does not handle several abscissas",
            ("curve", "x"),
        )
    return campaign.x_column, campaign.y_column


def group_columns(campaign: Campaign, run: str) -> tuple[str, ...]:
    """The columns of a run of a user's own curve that define which points share an error."""
    assert isinstance(campaign, CurveCampaign), "asked of a campaign with a formula"
    columns = campaign.runs[run].columns
    return tuple(column for key, column in columns.items() if key.startswith("errors["))


def with_own_gamma(problem: Problem, runs: Sequence[NewRun]) -> Problem:
    """The problem in which each of `runs` that states a gamma has it in place of its body's."""
    gammas = {run.name: run.quantities["gamma"] for run in runs if "gamma" in run.quantities}
    if not gammas:
        return problem
    kind, further, changed = KINDS_OF_QUANTITIES["gamma"], [], []
    for run in problem.runs:
        gamma = gammas.get(run.name)
        if gamma is None:
            changed.append(run)
            continue
        name = f"gamma[{run.name}]"
        changed.append(
            replace(
                run,
                arguments=MappingProxyType(
                    {**run.arguments, "gamma": gamma.value if gamma.exact else name}
                ),
            )
        )
        if not gamma.exact:
            prior: Prior = as_prior(gamma, low=kind.low)
            further.append(Parameter(name, kind.unit, prior, kind.meaning, kind.notation))
    of_noise = [p for p in problem.parameters if p.name in problem.noise_names]
    of_curve = [p for p in problem.parameters if p.name not in problem.noise_names]
    return replace(
        problem,
        parameters=(*shared_first([*of_curve, *further], changed), *of_noise),
        runs=tuple(changed),
    )


def _of(source: CampaignFile, tables: Mapping[str, Run]) -> Campaign:
    return RollingCampaign(source, MappingProxyType(dict(tables)))


def _further(like: RunTable, new: NewRun) -> RunTable:
    changes: dict[str, object] = {"name": new.name}
    for quantity in ("phi", "theta0"):
        if quantity in new.quantities:
            value = new.quantities[quantity]
            changes |= {f"{quantity}_deg": None, f"{quantity}_rad": _written(value)}
    if "gamma" in new.quantities:
        changes["unmodelled_force"] = (
            FORCE_SCALE if like.unmodelled_force is None else like.unmodelled_force
        )
    return msgspec.structs.replace(like, **changes)


def _written(quantity: Quantity) -> Value:
    return (
        quantity.value
        if quantity.exact
        else PriorTable(prior="normal", mean=quantity.value, sd=quantity.u)
    )


def _otherwise(table: LevelTable, error: float, reach: float) -> LevelTable:
    changed: dict[str, object] = {}
    if table.noise is not None and error != 1.0:
        changed["noise"] = _scaled(table.noise, error)
    if table.window is not None and reach != 1.0:
        ends = {key: end * reach for key in _FAR if (end := getattr(table.window, key)) is not None}
        changed["window"] = msgspec.structs.replace(table.window, t_max_s=None, **ends)
    return msgspec.structs.replace(table, **changed) if changed else table


def _scaled(noise: NoiseTable, factor: float) -> NoiseTable:
    sizes = {
        key: _times(written, factor)
        for key in _SIZES
        if (written := getattr(noise, key)) is not None
    }
    return msgspec.structs.replace(noise, **sizes)


def _times(written: Value, factor: float) -> Value:
    if isinstance(written, PriorTable):
        return times(written, factor)
    return _written(read_quantity(written, field="sigma").scaled(factor))
