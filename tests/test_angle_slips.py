"""An angle in radians under a key in degrees is named first, with the key to write; a campaign without the slip hears nothing of it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estim.campaign import load_campaign
from estim.explanation import Explanation, explain
from estim.reports.explanation import slip_words

REPLICA = Path(__file__).parents[1] / "data" / "replica"


def explained(folder: Path, run: str, **slips: str) -> Explanation:
    """What may be missing of a run of the replica, in which keys of that run say something else."""
    text = (REPLICA / "campaign.toml").read_text()
    head, of_run = text.split(f'name = "{run}"\n')
    for key, value in slips.items():
        of_run = re.sub(rf"{key} = .*", f"{key} = {value}", of_run, count=1)
    path = folder / "campaign.toml"
    path.write_text(f'{head}name = "{run}"\n{of_run}'.replace('file = "runs', f'file = "{REPLICA}/runs').replace("published = ", "# "))
    suspects = load_campaign(path, asked=[run]).suspects([run])
    near = tuple(cause for cause in suspects.causes if cause.slip or cause.name in ("angle_at_release", "tilt", "rolling_resistance"))
    return explain(replace(suspects, causes=near), rng=np.random.default_rng(1))


@pytest.mark.parametrize(
    ("slips", "symbols", "cure"),
    [
        ({"theta0_deg": '"1.321(26)"'}, "θ₀", "theta0_rad in place of theta0_deg"),
        ({"theta0_deg": "1.321"}, "θ₀", "theta0_rad in place of theta0_deg"),
        ({"theta0_deg": '"1.321(26)"', "phi_deg": '"0.1414(70)"'}, "θ₀ and φ", "theta0_rad, phi_rad in place of theta0_deg, phi_deg"),
    ],
)
def test_radians_under_degrees_are_named_first(tmp_path: Path, slips: dict[str, str], symbols: str, cure: str) -> None:
    found = explained(tmp_path, "heavy-08", **slips)
    assert slip_words(found) == f"this reads like a slip of the unit: {symbols} given in radians, not degrees (write {cure})"
    assert not found.candidates[0].lines  # nothing is to be added


def test_degrees_hear_nothing_of_it(tmp_path: Path) -> None:
    found = explained(tmp_path, "heavy-08")
    assert slip_words(found) == ""
    assert not any(one.slip for one in found.candidates)
