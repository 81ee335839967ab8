"""What a batch consists of: the runs of campaigns, each with a place of its own for its result."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from estim.campaign import read_campaign_file
from estim.common import EstimError, InputError

_CAMPAIGN = "campaign.toml"
_SHARD = re.compile(r"([1-9]\d{0,5})/([1-9]\d{0,5})", re.ASCII)
_UNSAFE = re.compile(r"[^\w.+-]+", re.ASCII)


@dataclass(frozen=True)
class Unit:
    """One run.

    run : "" where the campaign cannot be read, or has no runs.
    place : where its result goes, below the folder of the batch.
    """

    campaign: Path
    run: str
    place: str

    @property
    def name(self) -> str:
        return f"{self.campaign}: {self.run}" if self.run else str(self.campaign)


def campaigns_in(paths: Iterable[Path]) -> list[Path]:
    """The campaign files meant by `paths`: files as they are, and every `campaign.toml` in a folder
    and below.  Raises InputError.
    """
    campaigns: dict[Path, None] = {}
    for path in paths:
        if path.is_dir():
            inside = _campaigns_below(path)
            if not inside:
                raise InputError(
                    f"holds no {_CAMPAIGN}, nor does a folder below; name the files",
                    field="folder",
                    value=str(path),
                )
            campaigns |= dict.fromkeys(inside)
        elif path.exists():
            campaigns[path] = None
        else:
            raise InputError(
                "cannot be found (no such file or folder)", field="campaign", value=str(path)
            )
    return list(campaigns)


def _campaigns_below(root: Path) -> list[Path]:
    """Every `campaign.toml`, of whatever kind it is, and what it would be in a folder that cannot
    be read: its reader reports what is wrong.
    """
    unreadable: list[Path] = []
    folders = os.walk(root, onerror=lambda error: unreadable.append(Path(error.filename)))
    campaigns = [Path(place) / _CAMPAIGN for place, _, files in folders if _CAMPAIGN in files]
    return sorted([*campaigns, *(place / _CAMPAIGN for place in unreadable)])


def units_of(paths: Iterable[Path]) -> tuple[Unit, ...]:
    """The runs of all campaigns meant by `paths`, in their order.  A campaign that cannot be read
    or has no runs is one unit, which will report that.

    Raises InputError where a path is no file or folder.
    """
    campaigns = campaigns_in(paths)
    names = _names(campaigns)
    units: list[Unit] = []
    for path in campaigns:
        try:
            runs = read_campaign_file(path).names or ("",)
        except EstimError:
            runs = ("",)
        units += [Unit(path, run, f"{names[path]}/{run}" if run else names[path]) for run in runs]
    return tuple(units)


def _names(campaigns: Sequence[Path]) -> dict[Path, str]:
    """A folder for each: its place below what all have in common, without what is the same in every
    name.
    """
    full = {path: path.resolve() for path in campaigns}
    try:
        root = Path(os.path.commonpath([path.parent for path in full.values()]))
    except ValueError:  # on several drives
        root = Path()
    names: dict[Path, str] = {}
    for path, resolved in full.items():
        parts = list(
            resolved.relative_to(root if root.name else resolved.anchor).with_suffix("").parts
        )
        if resolved.name == _CAMPAIGN:
            parts = parts[:-1] or [root.name]
        name = base = "/".join(_UNSAFE.sub("-", part) or "-" for part in parts)
        number = 2
        while name.casefold() in {other.casefold() for other in names.values()}:
            name, number = f"{base}-{number}", number + 1
        names[path] = name
    return names


def shard_of(units: Sequence[Unit], text: str | None) -> tuple[Unit, ...]:
    """Part I of N of the units, by `text` "I/N", every N-th of them; all of them for None.  Raises
    InputError.
    """
    if text is None:
        return tuple(units)
    match = _SHARD.fullmatch(text)
    if match is None or int(match[1]) > int(match[2]):
        raise InputError("must be I/N with 1 <= I <= N, as in 3/16", field="--shard", value=text)
    return tuple(units[int(match[1]) - 1 :: int(match[2])])
