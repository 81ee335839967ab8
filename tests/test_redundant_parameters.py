"""Formulas with more parameters than the points tell apart: an early end, an honest status."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from estim import fit_curve
from estim.cli.commands import cli
from estim.common import Kind
from estim.sampling.chain import Target, _target_unreachable
from estim.sampling.diagnostics import Mixing


def fitted(tmp_path: Path, formula: str, *options: str) -> tuple[Result, Path]:
    """The fit of a fall through oil, whose speed changes little in the recording."""
    rng = np.random.default_rng(4)
    t = np.linspace(0.0, 1.6, 50)
    y = 0.267 * np.exp(t / 6.2) - 0.24 - 0.112 * t + 6e-5 * rng.standard_normal(t.size)
    table = tmp_path / "fall.csv"
    rows = [f"{a:.6f},{b:.8f}" for a, b in zip(t, y, strict=True)]
    table.write_text("\n".join(["t (s),y (m)", *rows]), encoding="utf-8")
    out = tmp_path / "out"
    arguments = ["fit", str(table), "--formula", formula, "--out", str(out), "--figures", "none"]
    return CliRunner().invoke(cli, [*arguments, *options], catch_exceptions=False), out


def assert_not_identified(done: Result, out: Path) -> None:
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert (done.exit_code, result["status"]) == (3, "not-identified"), done.output
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "n/a" not in report


@pytest.mark.slow
def test_a_parameter_for_which_others_make_up_is_not_sampled(tmp_path: Path) -> None:
    done, out = fitted(tmp_path, "y0 - v*t + b*exp(-t/tau)")
    assert "v is unbounded" in done.output
    assert_not_identified(done, out)
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["sampling"]["n_step"] <= 60
    assert all(p["q025"] is None for p in result["parameters"].values())
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "of the profile" in report
    assert "of the posterior | 95" not in report


@pytest.mark.slow
@pytest.mark.usefixtures("few_draws")
def test_factors_between_limits_are_named_together(tmp_path: Path) -> None:
    """However small the step of one is that makes up for the other; what has no limits but is
    determined is not blamed.  Between limits there is a posterior, which is sampled.
    """
    limits = ("--low", "a=0", "--high", "a=10", "--low", "b=-10", "--high", "b=10")
    done, out = fitted(tmp_path, "a*b*t + q*t**2 + c", *limits)
    (said,) = [line for line in done.output.splitlines() if "constrained neither" in line]
    assert "a up by" in said or "a down by" in said
    assert "b up by" in said or "b down by" in said
    assert "together" in said
    assert_not_identified(done, out)


@pytest.mark.parametrize(
    ("n_step", "ess", "still", "told"),
    [
        (2000, 200.0, False, 1),
        (2000, 300.0, False, 0),
        (1900, 10.0, False, 0),
        (2000, 4000.0, True, 1),
    ],
)
def test_a_chain_that_will_not_get_there_is_not_prolonged(
    n_step: int, ess: float, still: bool, told: int
) -> None:
    rhat = np.array([1.0, np.nan if still else 1.0])
    mixing = Mixing(rhat, np.array([4000.0, 4000.0]), np.array([4000.0, ess]))
    found = _target_unreachable(mixing, Target(), ("a", "b"), n_step=n_step)
    assert len(found) == told
    assert all(f.kind is Kind.CHAIN_HOPELESS and f.names == ("b",) for f in found)


@pytest.mark.parametrize("seed", range(4))
def test_factors_are_not_told_apart_by_rounding_errors_beside_errors_of_x(seed: int) -> None:
    """Half of such fits were `ok`, with a standard deviation of 400,000."""
    rng, x = np.random.default_rng(seed), np.linspace(0.0, 5.0, 12)
    read, y = x + 0.05 * rng.standard_normal(12), 2.0 * x + 1.0 + 0.05 * rng.standard_normal(12)
    assert fit_curve("a*b*x + c", read, y, u_x=0.05, u_y=0.05).status == "not-identified"
    assert fit_curve("a*x + c", read, y, u_x=0.05, u_y=0.05).status == "ok"
