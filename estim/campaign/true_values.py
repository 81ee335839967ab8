"""The true values of a synthetic campaign: `truth.toml` beside its file, as `estim simulate` writes
it.  No fit reads them; reports show them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from estim.campaign.campaign_file import CampaignFile
from estim.reading import TOML_BYTES, parse_toml, read_text

_FILE = "truth.toml"


def read_truth(source: CampaignFile) -> Mapping[str, float]:
    """Parameter ("gamma[heavy]") -> its true value, SI units and radians; nothing where data are
    measured, or there is no such file.

    Raises InputError where the file does not hold one finite number for each name.
    """
    path = source.path.parent / _FILE
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
