"""A campaign from its file, with the tables of its runs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from estim.campaign.binding import parts_fact
from estim.campaign.bodies import RollingCampaign
from estim.campaign.campaign import Campaign
from estim.campaign.campaign_file import CampaignFile, RunTable, read_campaign_file
from estim.campaign.curve_campaign import read_curve_campaign
from estim.campaign.derived import read_derived
from estim.campaign.dialect_table import choices_of, dialect_of
from estim.common import InputError, listed, phrase
from estim.reading import (
    COLUMNS,
    TOML_BYTES,
    Run,
    compare_intervals,
    is_timed_track,
    is_tracker_file,
    parse_toml,
    read_run,
    read_text,
)


def load_campaign(
    path: str | Path, *, only: str | None = None, asked: Collection[str] = ()
) -> Campaign:
    """The campaign in the TOML file at `path`, with the tables of its runs.

    only : the one run that is read, as if there were no other; None: all of them.
    asked : runs whose tables are needed, all of them where it is empty; a track is compared with
        the others of the campaign that can be read, and states which cannot.

    Raises InputError with file, line, field, rule and value for whatever breaks a rule; every run
    that is needed is posed as a problem once, so that a mistake in any of them shows at once.

    >>> from estim import load_campaign
    >>> load_campaign("data/replica/campaign.toml").run_names
    ('heavy-02', 'heavy-04', 'heavy-06', 'heavy-08', 'light-01', 'light-02', 'light-03', 'light-04')
    """
    source = read_campaign_file(Path(path))
    if only is not None:
        return bound(source, only=(only,))
    return bound(source, only=tuple(asked), compared=True) if asked else bound(source)


def bound(
    source: CampaignFile, *, only: Collection[str] | None = None, compared: bool = False
) -> Campaign:
    """The campaign of a file that was read, with the tables of its runs, or of the runs `only`,
    `compared` with the others.  Raises InputError.
    """
    only = source.names if only is None else only
    campaign: Campaign
    if source.curve is not None:
        campaign = read_curve_campaign(source, source.curve, only=only)
    else:
        campaign = rolling = RollingCampaign(source, _read_runs(source, only, compared))
        facts = {name: parts_fact(rolling.levels(name)) for name in rolling.tables}
        campaign = replace(
            rolling,
            tables={name: _with_fact(run, facts[name]) for name, run in rolling.tables.items()},
        )
    tables = {
        name: _with_fact(campaign.tables[name], source.out_of_folder(source.files[name]))
        for name in source.files
        if name in campaign.tables
    }
    campaign = replace(
        campaign,
        tables=MappingProxyType(tables),
        derived=read_derived(source.derived, source.places),
        truth=read_truth(source),
    )
    for name in campaign.run_names:
        campaign.check(name)
    if campaign.derived and campaign.run_names:
        campaign.problem(campaign.run_names)
    return campaign


def _read_runs(source: CampaignFile, only: Collection[str], compared: bool) -> Mapping[str, Run]:
    read = {
        run.name: _read(source, source.file_of(i), run)
        for i, run in enumerate(source.runs)
        if run.name in only
    }
    others, unread = dict[str, Run](), list[str]()
    if compared and any(is_timed_track(run) for run in read.values()):
        for i, run in enumerate(source.runs):
            try:
                others |= (
                    {} if run.name in read else {run.name: _read(source, source.file_of(i), run)}
                )
            except InputError:
                unread.append(run.name)
    runs = compare_intervals(
        {
            run.name: {**read, **others}[run.name]
            for run in source.runs
            if run.name in read or run.name in others
        }
    )
    fact = (
        phrase(
            "its frame rate was not compared with that of {runs}, because their files cannot be "
            "read",
            runs=listed(unread),
        )
        if unread
        else None
    )
    return {
        name: _with_fact(runs[name], fact if is_timed_track(runs[name]) else None) for name in read
    }


def _read(source: CampaignFile, path: Path, run: RunTable) -> Run:
    levels = (
        (("runs", source.runs.index(run)), run),
        (("bodies", run.body), source.bodies[run.body]),
        (("shared",), source.shared),
    )
    choices = choices_of(run)
    dialect = dialect_of(
        levels[:1] if is_tracker_file(path) or choices is not None else levels, source.places
    )
    with source.reading(path, COLUMNS):
        table = read_run(path, name=run.name, choices=choices, dialect=dialect)
    if not run.leave_out_s:
        return table
    with source.places.at(("runs", source.runs.index(run), "leave_out_s")):
        return table.without(run.leave_out_s)


def _with_fact(run: Run, fact: str | None) -> Run:
    """A run with one more fact, where there is one."""
    return run if fact is None else replace(run, facts=(*run.facts, fact))


_TRUTH = "truth.toml"


def read_truth(source: CampaignFile) -> Mapping[str, float]:
    """Parameter ("gamma[heavy]") -> its true value, SI units and radians; nothing where data are
    measured, or there is no such file.

    Raises InputError where the file does not hold one finite number for each name.
    """
    path = source.path.parent / _TRUTH
    if source.kind != "synthetic" or not path.is_file():
        return MappingProxyType({})
    with source.reading(path):
        text, _ = read_text(path, limit=TOML_BYTES)
        tree, places = parse_toml(text, str(path))
        for name, value in tree.items():
            if (
                isinstance(value, bool)
                or not isinstance(value, (int, float))
                or not math.isfinite(value)
            ):
                raise places.error(
                    "must be a finite number, the true value of a parameter", (name,), value=value
                )
    return MappingProxyType({name: float(value) for name, value in tree.items()})
