"""A run of the replica analysed once for all tests of a process that ask for it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from estim.campaign import Campaign, load_campaign
from estim.pipeline import Analysis, analyse
from estim.sampling.chain import Target


@cache
def heavy_04() -> tuple[Campaign, Analysis]:
    """The campaign, and its run heavy-04 by the default but for fewer draws; nobody changes
    either.
    """
    replica = Path(__file__).resolve().parents[1] / "data" / "replica"
    campaign = load_campaign(replica / "campaign.toml")
    return campaign, analyse(campaign, ["heavy-04"], seed=1, target=Target(ess=1500.0))
