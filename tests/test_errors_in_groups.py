"""Errors that a part of the points shares: of an instrument, a day, a batch."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from estim import Component, DataSet, InputError, Poisson, fit_curve, fit_curves
from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.fitting import fit_problem

RNG = np.random.default_rng(3)
X = RNG.permutation(np.linspace(0.0, 5.0, 20))
METER = np.repeat([1.0, 2.0], 10)
DAY = np.tile(["mo", "tu", "we", "th"], 5)
U = 0.1 + 0.02 * X
Y = 2.0 * np.exp(-X / 3.0) + 0.4 + np.where(METER == 1.0, 0.12, -0.2) + U * RNG.standard_normal(20)
CURVE = "a*exp(-x/tau) + c"
METERS = Component("zero_y", 0.15, "meters", METER)
DAYS = Component("zero_y", np.where(DAY == "we", 0.0, 0.05), "days", DAY)


def by_hand() -> np.ndarray:
    cov = np.diag(U**2)
    for i in range(20):
        for j in range(20):
            cov[i, j] += 0.15**2 * (METER[i] == METER[j])
            cov[i, j] += 0.05**2 * (DAY[i] == DAY[j] != "we")
    return cov


def test_errors_in_groups_are_the_covariance_matrix_written_by_hand() -> None:
    fit = fit_curve(CURVE, X, Y, u_y=U, errors=[METERS, DAYS])
    written = fit_curve(CURVE, X, Y, cov_y=by_hand())
    assert fit.values == pytest.approx(written.values, rel=1e-9)
    assert fit.cov == pytest.approx(written.cov, rel=1e-9)
    assert (fit.chi2, fit.dof) == (pytest.approx(written.chi2, rel=1e-9), 17)
    assert fit.p_value == pytest.approx(written.p_value, rel=1e-9)
    beside = fit_curve(CURVE, X, Y, cov_y=np.diag(U**2), errors=[DAYS, METERS])
    assert beside.cov == pytest.approx(written.cov, rel=1e-9)


def test_of_a_line_they_are_parameters_of_each_group_with_a_prior() -> None:
    """An independent zero for each meter, as one more parameter: the same line."""
    fit = fit_curve("a*x + b", X, Y, u_y=U, errors=[METERS])
    rows = np.column_stack([X, np.ones(20), METER == 1.0, METER == 2.0]) / U[:, None]
    inverse = np.linalg.inv(rows.T @ rows + np.diag([0.0, 0.0, 1.0, 1.0]) / 0.15**2)
    found = inverse @ rows.T @ (Y / U)
    assert [fit.values["a"], fit.values["b"]] == pytest.approx(found[:2], rel=1e-9)
    assert fit.cov == pytest.approx(inverse[:2, :2], rel=1e-9)
    alone = fit_curve("a*x + b", X, Y, u_y=U)
    assert fit.sds["b"] > 2.0 * alone.sds["b"]


def test_they_go_with_errors_of_x_and_with_a_zero_of_all() -> None:
    u_x = np.full(20, 0.05)
    both = fit_curve("a*x + b", X, Y, u_y=U, u_x=u_x, errors=[METERS])
    written = fit_curve(
        "a*x + b", X, Y, cov_y=np.diag(U**2) + 0.15**2 * (METER[:, None] == METER), u_x=u_x
    )
    assert both.values == pytest.approx(written.values, rel=1e-9)
    one = fit_curve("a*x + b", X, Y, u_y=U, errors=[METERS, Component("zero_y", 0.3)])
    assert "zero_y" in one.names
    sets = {"all": DataSet(X, Y, u_y=U)}
    assert fit_curves("a*x + b", sets, errors=[METERS]).values == pytest.approx(
        fit_curve("a*x + b", X, Y, u_y=U, errors=[METERS]).values, rel=1e-9
    )


@pytest.mark.parametrize(
    ("error", "beside", "said"),
    [
        ({"groups": METER[:9]}, {"u_y": U}, r"'errors\[zero_y\]' must have as many groups as .*20"),
        (
            {"groups": np.where(X > 4.0, np.nan, 1.0)},
            {"u_y": U},
            "the group of each point, not nan",
        ),
        ({"groups": ["a"] * 19 + [None]}, {"u_y": U}, "the group of each point, not nan"),
        ({"groups": ["a"] * 19 + [np.nan]}, {"u_y": U}, "the group of each point, not nan"),
        ({"u": -0.1}, {"u_y": U}, r"'errors\[zero_y\]' must be > 0: -0.1"),
        ({"u": [0.1, 0.2]}, {"u_y": U}, r"'errors\[zero_y\]' must be a number or have as many"),
        ({}, {}, r"'errors\[zero_y\]' with groups needs u_y \(in the unit of y\) or cov_y"),
        ({}, {"u_y": "5%"}, r"'errors\[zero_y\]' with groups needs u_y \(in the unit of y\)"),
        ({}, {"noise": Poisson()}, r"'errors\[zero_y\]' with groups needs u_y"),
        ({}, {"u_y": U, "jitter": True}, "'errors' cannot be combined with 'jitter' or 'robust'"),
        ({"kind": "scale_y"}, {"u_y": U}, "'kind' must be zero_y with groups: scale_y"),
    ],
)
def test_what_groups_do_not_go_with_is_refused(error: dict, beside: dict, said: str) -> None:
    y = np.rint(10.0 * Y) if "noise" in beside else np.abs(Y)

    def fitted() -> object:
        shared = Component(**{"kind": "zero_y", "u": 0.1, "groups": METER, **error})
        return fit_curve("a*x + b", X, y, errors=[shared], **beside)

    with pytest.raises(InputError, match=said):
        fitted()


CAMPAIGN = """title = "Two meters"
kind = "synthetic"
[curve]
expression = "a*exp(-x/tau) + c"
x = "x"
y = "y"
u_y = {column = "u_y"}
[curve.errors]
meters = {kind = "zero_y", u = 0.15, groups = "meter"}
[curve.parameters]
a = {}
tau = {}
c = {}
[[runs]]
name = "run"
file = "run.csv"
"""


def written(folder: Path, text: str) -> Path:
    rows = np.column_stack([X, Y, U, METER])
    np.savetxt(folder / "run.csv", rows, header="x,y,u_y,meter", delimiter=",", comments="")
    (folder / "c.toml").write_text(text, encoding="utf-8")
    return folder / "c.toml"


def test_a_campaign_names_the_column_of_the_groups(tmp_path: Path) -> None:
    problem = load_campaign(written(tmp_path, CAMPAIGN)).problem(["run"])
    fit = fit_problem(problem, rng=np.random.default_rng(1))
    one = fit_curve(CURVE, X, Y, u_y=U, errors=[METERS])
    named = dict(zip(fit.names, fit.values, strict=True))
    assert named == pytest.approx(one.values, rel=1e-5)
    assert fit.sds == pytest.approx([one.sds[name] for name in fit.names], rel=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('groups = "meter"', 'groups = "gauge"', r"'gauge' is missing"),
        ("u = 0.15", "u = -0.15", r"c.toml:9: .*must be > 0"),
        ("zero_y", "zero_x", r"c.toml:9: .*'kind' must be zero_y with groups"),
    ],
)
def test_bad_groups_of_a_campaign_are_refused(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert old in CAMPAIGN
    with pytest.raises(InputError) as refused:
        load_campaign(written(tmp_path, CAMPAIGN.replace(old, new)))
    assert re.search(said, str(refused.value)), str(refused.value)


@pytest.mark.slow
def test_a_plan_has_more_readings_but_no_smaller_errors_of_each(tmp_path: Path) -> None:
    run = CliRunner().invoke(
        cli, ["plan", str(written(tmp_path, CAMPAIGN)), "--out", str(tmp_path / "plan")]
    )
    report = (tmp_path / "plan" / "report.md").read_text(encoding="utf-8")
    assert "8 times as many readings" in run.output
    assert "told from the errors of its group: half the error of a reading" in report
