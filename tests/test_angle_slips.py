"""An angle in radians under a key in degrees is named first, with the key to write; a campaign
without the slip hears nothing of it.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from posed import curve_problem

from estim.campaign import load_campaign
from estim.campaign.candidate_causes import unit_slips
from estim.explanation import Explanation, Suspects, explain
from estim.explanation.candidates import Cause
from estim.explanation.explaining import TIED
from estim.problem.posterior import Problem
from estim.problem.priors import Normal
from estim.reports.explanation import slip_words

REPLICA = Path(__file__).parents[1] / "data" / "replica"


def explained(folder: Path, run: str, **slips: str) -> Explanation:
    """What may be missing of a run of the replica, in which keys of that run say something else."""
    text = (REPLICA / "campaign.toml").read_text()
    head, of_run = text.split(f'name = "{run}"\n')
    for key, value in slips.items():
        of_run = re.sub(rf"{key} = .*", f"{key} = {value}", of_run, count=1)
    path = folder / "campaign.toml"
    path.write_text(
        f'{head}name = "{run}"\n{of_run}'.replace(
            'file = "runs', f'file = "{REPLICA}/runs'
        ).replace("published = ", "# ")
    )
    suspects = load_campaign(path, asked=[run]).suspects([run])
    near = tuple(
        cause
        for cause in suspects.causes
        if cause.slip or cause.name in ("angle_at_release", "tilt", "rolling_resistance")
    )
    return explain(replace(suspects, causes=near), rng=np.random.default_rng(1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slips", "symbols", "cure"),
    [
        ({"theta0_deg": '"1.321(26)"'}, "θ₀", "theta0_rad in place of theta0_deg"),
        ({"theta0_deg": "1.321"}, "θ₀", "theta0_rad in place of theta0_deg"),
        (
            {"theta0_deg": '"1.321(26)"', "phi_deg": '"0.1414(70)"'},
            "θ₀ and φ",
            "theta0_rad, phi_rad in place of theta0_deg, phi_deg",
        ),
    ],
)
def test_radians_under_degrees_are_named_first(
    tmp_path: Path, slips: dict[str, str], symbols: str, cure: str
) -> None:
    found = explained(tmp_path, "heavy-08", **slips)
    assert (
        slip_words(found)
        == f"a unit is probably wrong: {symbols} given in radians, not degrees (write {cure})"
    )
    assert not found.candidates[0].lines  # nothing is to be added


def test_degrees_hear_nothing_of_it(tmp_path: Path) -> None:
    """Of a tilt of 1.1, which might be radians as well."""
    (tried,) = (
        cause
        for cause in load_campaign(REPLICA / "campaign.toml", asked=["heavy-02"])
        .suspects(["heavy-02"])
        .causes
        if cause.slip
    )
    assert "φ" in tried.words
    found = explained(tmp_path, "heavy-02")
    assert slip_words(found) == ""
    assert not any(one.slip for one in found.candidates)


def test_angles_of_all_runs_and_of_a_body_are_read_in_radians_too() -> None:
    source = load_campaign(REPLICA / "campaign.toml").source
    bodies = {
        name: msgspec.structs.replace(table, theta0_deg="1.3")
        for name, table in source.bodies.items()
    }
    *_, both = unit_slips(
        replace(source, shared=msgspec.structs.replace(source.shared, phi_deg="0.1"), bodies=bodies)
    )
    assert (both.source.shared.phi_deg, both.source.shared.phi_rad) == (None, "0.1")
    assert {(body.theta0_deg, body.theta0_rad) for body in both.source.bodies.values()} == {
        (None, "1.3")
    }
    assert all(
        (run.phi_deg, run.phi_rad) == (None, old.phi_deg)
        for run, old in zip(both.source.runs, source.runs, strict=True)
    )


X = np.linspace(0.0, 3.0, 25)
SCATTER = 0.1 * np.random.default_rng(5).standard_normal(X.size)


def posed(formula: str, y: np.ndarray, priors: dict[str, Normal]) -> Problem:
    start = {name: prior.mean for name, prior in priors.items()}
    return curve_problem(formula, X, y, start=start, priors=priors, u_y=0.1).with_sigma(1.0)


def of_a_line(y: np.ndarray) -> Explanation:
    """What is said of a line whose offset is stated as 0.6: another was meant, 0, or something is
    added to it.
    """
    slope = Normal(1.0, 1.0)
    causes = (
        Cause(
            "slip",
            "slip",
            posed("a + b*x", y, {"a": Normal(0.0, 0.01), "b": slope}),
            (),
            (),
            slip=True,
        ),
        Cause(
            "more",
            "more",
            posed("a + b*x + c", y, {"a": Normal(0.6, 0.01), "b": slope, "c": Normal(0.0, 1.0)}),
            ("c",),
            (),
        ),
    )
    return explain(
        Suspects(posed("a + b*x", y, {"a": Normal(0.6, 0.01), "b": slope}), "", causes),
        rng=np.random.default_rng(1),
    )


def test_a_slip_comes_before_what_gains_as_much() -> None:
    found = of_a_line(0.07 + X + SCATTER)
    gains = {one.name: one.gain for one in found.found}
    assert 0.0 < gains["more"] - gains["slip"] < TIED
    assert found.candidates[0].name == "slip" == found.slip.name
    far = of_a_line(0.18 + X + SCATTER)  # found, and far behind
    assert far.candidates[0].name == "more"
    assert any(one.slip for one in far.found)
    assert far.slip is None


def test_a_slip_that_leaves_a_pattern_is_not_called_one() -> None:
    found = of_a_line(X - 0.12 * (X * (X - 3.0) + 0.7) + SCATTER)
    first = next(one for one in found.candidates if one.slip)
    assert first.found
    assert first is found.candidates[0]
    assert not first.random
    assert found.slip is None


def test_a_slip_is_searched_for_from_what_it_states() -> None:
    """A frequency of 6 where 1 was stated: from the fit with 1 no way leads there."""
    y = np.sin(6.05 * X) + SCATTER
    plain, meant = (posed("sin(w*x)", y, {"w": Normal(w, 0.5)}) for w in (1.0, 6.0))
    found = explain(
        Suspects(plain, "", (Cause("slip", "slip", meant, (), (), slip=True),)),
        rng=np.random.default_rng(1),
        values=np.array([1.0]),
    )
    assert found.slip is not None
    assert found.candidates[0].gain > 50.0
