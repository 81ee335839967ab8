"""One decider of poor fits: the same verdict whoever asks; uneven noise and errors shared at one x
are seen; wrong curves stay wrong.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from estim import DataSet, fit_curve, fit_curves, fit_line
from estim.checks import P_POOR_FIT, check_linear
from estim.cli.commands import cli
from estim.common import Finding, Kind
from estim.line import LineColumns, straight_line
from estim.line.findings import line_goodness, points_findings
from estim.words import advice_for, choices_for, first_step

X = np.arange(12.0)
TWO = np.column_stack([np.ones(12), X])


def points(chi2_p: float, seed: int = 2) -> np.ndarray:
    """y of 12 points with errors of 0.1 whose line has this p-value of chi2."""
    basis = np.linalg.qr(TWO)[0]
    errors = np.random.default_rng(seed).standard_normal(12)
    left = errors - basis @ (basis.T @ errors)
    return 1.0 + 2.0 * X + 0.1 * left * np.sqrt(stats.chi2.isf(chi2_p, 10) / (left @ left))


def verdicts(folder: Path, y: np.ndarray) -> dict[str, str]:
    """What ways to fit a line say of the points."""
    table = folder / "points.csv"
    table.write_text(
        "x,y,u_y\n" + "\n".join(f"{a:.12g},{b:.12g},0.1" for a, b in zip(X, y, strict=True))
    )
    joint = fit_curves("a + b*x", {"one": DataSet(X, y, u_y=0.1)}, shared=["a"])
    return {
        "line": str(straight_line(table, LineColumns()).status),
        "fit_curve": str(fit_curve("a + b*x", X, y, u_y=0.1).status),
        "fit_curves": str(joint.status),
    }


@pytest.mark.parametrize(
    ("chi2_p", "status"), [(0.005, "ok"), (0.0014, "ok"), (0.0007, "poor-fit")]
)
def test_the_same_points_have_one_verdict(tmp_path: Path, chi2_p: float, status: str) -> None:
    assert set(verdicts(tmp_path, points(chi2_p)).values()) == {status}


def test_a_pattern_is_no_line_for_any_of_them(tmp_path: Path) -> None:
    """A parabola within its errors' size: chi2 alone does not see it.  The commands say the
    same.
    """
    y = (
        1.0
        + 2.0 * X
        + np.random.default_rng(4).standard_normal(12) * 0.02
        + 0.15 * ((X - 5.5) ** 2 / 15.0 - 1.0)
    )
    assert fit_line(X, y, u_y=0.1).p_value > P_POOR_FIT
    assert set(verdicts(tmp_path, y).values()) == {"poor-fit"}
    table = str(tmp_path / "points.csv")
    for name, arguments in {
        "line": ["line", table],
        "fit": ["fit", table, "--formula", "a + b*x", "--kind", "synthetic"],
    }.items():
        done = CliRunner().invoke(
            cli, [*arguments, "--out", str(tmp_path / name), "--figures", "none"]
        )
        assert done.exit_code == 3
        assert "(test '" in (tmp_path / name / "report.md").read_text()


def test_runs_that_are_each_a_little_too_large_fail_together() -> None:
    rng = np.random.default_rng(9)
    x = np.linspace(0.0, 1.0, 30)
    data = {}
    for name in "abcdef":
        errors = rng.standard_normal(30)
        errors *= np.sqrt(45.0 / (errors @ errors))  # p about 0.03 of each
        data[name] = DataSet(x, 1.0 + 2.0 * x + 0.1 * errors, u_y=0.1)
    joint = fit_curves("a + b*x", data, shared=["a", "b"])
    assert all("chi2" not in one.failed for one in joint.goodness)
    assert joint.status == "poor-fit"
    assert "chi2" in joint.reasons[0]


# --- noise that grows, errors shared at one x
# ----------------------------------------------------------------------------------------------


def checked(y: np.ndarray, x: np.ndarray, u: float | None, rng: np.random.Generator):
    fit = fit_line(x, y) if u is None else fit_line(x, y, u_y=u)
    design = np.column_stack([np.ones(x.size), x])
    sd = u or np.sqrt(fit.chi2 / fit.dof)
    values = design @ [fit.intercept, fit.slope]
    return check_linear(
        (y - values) / sd,
        design / sd,
        x=x,
        y=y,
        f=values,
        sd=np.full(x.size, sd),
        stated=u is not None,
        rng=rng,
    )


def test_a_missing_damping_is_not_told_as_unequal_errors_alone() -> None:
    t = np.arange(0.0, 30.0, 0.7)
    noise = 0.2 * np.random.default_rng(5).standard_normal(t.size)
    y = 10.0 * np.exp(-t / 14.0) * np.cos(2.1 * t) + noise
    fit = fit_curve("a*cos(w*x + p)", t, y, start={"a": 9.0, "w": 2.1, "p": 0.0})
    assert fit.goodness[0].failed == ("uneven",)
    assert "the curve may lack something, a damping for instance" in str(fit)


def test_noise_that_grows_with_the_curve_is_seen() -> None:
    x = np.linspace(0.0, 3.0, 40)
    curve = 10.0 * np.exp(-x) + 0.5
    failed = []
    for seed in range(4):
        y = curve * (1.0 + 0.1 * np.random.default_rng(seed).standard_normal(40))
        fit = fit_curve("a*exp(-b*x) + c", x, y, start={"a": 8.0, "b": 1.0, "c": 0.0})
        failed.append("uneven" in fit.goodness[0].failed)
        right = fit_curve(
            "a*exp(-b*x) + c", x, y, start={"a": 8.0, "b": 1.0, "c": 0.0}, u_y=0.1 * curve
        )
        assert "uneven" not in right.goodness[0].failed
    assert sum(failed) >= 2
    assert "state the standard deviation of each reading" in str(
        fit_curve("a*exp(-b*x) + c", x, y, start={"a": 8.0, "b": 1.0, "c": 0.0}).advice
    )


def test_what_all_readings_of_one_x_share_is_lack_of_fit() -> None:
    """Errors of the day: the means scatter more about the line than readings of a day do about
    their mean.  The F test says the same.
    """
    rng = np.random.default_rng(6)
    x = np.repeat(np.arange(8.0), 4)
    y = 1.0 + 2.0 * x + np.repeat(rng.standard_normal(8), 4) + rng.standard_normal(32) * 0.7
    fit = fit_curve("a + b*x", x, y)
    assert "repeated" in fit.goodness[0].failed
    assert fit.status == "poor-fit"
    means = y.reshape(8, 4).mean(axis=1)
    inside = np.sum((y.reshape(8, 4) - means[:, None]) ** 2)
    off = 4.0 * np.sum((means - np.polyval(np.polyfit(x, y, 1), np.arange(8.0))) ** 2)
    share = fit.goodness[0].checks["repeated"].statistic
    assert share == pytest.approx(off / (off + inside), rel=1e-6)
    p = stats.f.sf((off / 6) / (inside / 24), 6, 24)
    assert fit.goodness[0].checks["repeated"].p_value == pytest.approx(
        p, abs=4.0 * np.sqrt(p / 20000) + 1e-4
    )
    assert "mean of the readings at each x" in " ".join(fit.advice)


def test_each_test_rejects_right_lines_at_its_level() -> None:
    """200 right lines with four readings at each x, errors stated or not: 5 % have p < 0.05, and p
    is uniform.
    """
    rng = np.random.default_rng(12)
    x = np.repeat(np.linspace(0.0, 1.0, 6), 4)
    found: dict[str, list[float]] = {}
    for k in range(100):
        good = checked(
            1.0 + 2.0 * x + 0.3 * rng.standard_normal(24), x, 0.3 if k % 2 else None, rng
        )
        for name in ("uneven", "repeated"):
            found.setdefault(name, []).append(good.checks[name].p_value)
    for p in found.values():
        assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert set(found) == {"uneven", "repeated"}


def test_errors_of_both_axes_and_covariances_are_whitened() -> None:
    """chi2 of the tests is S of the fit, whatever is uncertain; a wave over the line fails in
    each.
    """
    rng = np.random.default_rng(8)
    x = np.linspace(0.0, 10.0, 25)
    cov = np.diag(np.r_[np.full(25, 0.02**2), np.full(25, 0.1**2)])
    cov[25:, 25:] += 0.3**2
    for bent in (False, True):
        y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(25) + bent * 0.4 * np.sin(x)
        for known in ({}, {"u_y": 0.1}, {"u_x": 0.02, "u_y": 0.1}, {"cov": cov}):
            fit = fit_line(x, y, **known)
            good = line_goodness(fit)
            assert bool(points_findings(fit)) == bent
            if known:
                assert good.checks["chi2"].statistic == pytest.approx(fit.chi2, rel=1e-6)


# --- a deviation does not launder a wrong curve
# ---------------------------------------------------------------------------------------------

TEA = np.loadtxt("data/tutorial/tea.csv", delimiter=",", skiprows=2)
BALL = np.column_stack(
    [np.arange(25.0) / 30.0, 8.6**2 / 9.81 * np.log(np.cosh(9.81 * np.arange(25.0) / 30.0 / 8.6))]
)


@pytest.mark.parametrize(
    ("table", "curve", "u_y", "lacks", "said"),
    [
        (BALL, "x0 + v0*x + g*x**2/2", 0.002, {"deviation": 0.01}, "is a trend"),
        (BALL, "x0 + v0*x + g*x**2/2", 0.002, {"deviation": 0.001}, "times its stated"),
        (TEA, "warm + rate*x", None, {"deviation": 10.0}, "is a trend"),
        (TEA, "warm + rate*x", None, {"deviation": 1.0}, "times its stated"),
        (TEA, "warm + rate*x", None, {"correlated": True}, "is a trend"),
    ],
)
def test_a_wrong_curve_stays_wrong_beside_a_deviation(
    table: np.ndarray, curve: str, u_y: float | None, lacks: dict, said: str
) -> None:
    """A ball that the air slows as free fall, cooling tea as a straight line."""
    errors = 0.0 if u_y is None else u_y * np.random.default_rng(3).standard_normal(len(table))
    fit = fit_curve(curve, table[:, 0], table[:, 1] + errors, u_y=u_y, **lacks)
    assert fit.status == "poor-fit"
    assert said in str(fit.reasons)
    assert "try another curve" in " ".join(advice_for(fit.findings))


@pytest.mark.slow
def test_an_irregular_deviation_of_the_stated_size_is_kept() -> None:
    """Matern-3/2 over a tenth of the range beside the right line: most are ok, and hold what they
    say.
    """
    x = np.linspace(0.0, 1.0, 60)
    apart = np.sqrt(3.0) * np.abs(x[:, None] - x) / 0.1
    factor = np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(60))
    ok, held = 0, 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(60) + 0.2 * factor @ rng.standard_normal(60)
        fit = fit_curve("a + b*x", x, y, u_y=0.1, deviation=0.2)
        ok += fit.status == "ok"
        low, high = fit.intervals["b"][0.95]
        held += low < 2.0 < high
    assert ok >= 9
    assert held >= 9  # 11.4 expected, fewer with a probability of 0.002


def test_another_curve_is_advised_first_and_no_size_is_read_off_the_residuals() -> None:
    x = np.linspace(0.0, 1.0, 30)
    (words,) = fit_curve("a + b*x", x, x**2 + 0.01 * np.sin(40.0 * x), u_y=0.01).advice
    assert words.index("another curve") < words.index("deviation")
    assert "deviation =" not in words


def test_what_hardly_passes_is_told() -> None:
    """Between 0.001 and 0.01 there is a note, and the fit stays ok."""
    x = np.repeat(np.arange(8.0), 4)
    told = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        fit = fit_curve(
            "a + b*x",
            x,
            1.0 + 2.0 * x + np.repeat(rng.standard_normal(8), 4) + rng.standard_normal(32),
        )
        p = fit.goodness[0].checks["repeated"].p_value
        if fit.status == "ok":
            assert any("coverage of its intervals may be lower" in note for note in fit.notes) == (
                P_POOR_FIT <= p < 0.01
            )
            told.append(p < 0.01)
    assert any(told)


def test_a_blunder_of_one_run_leaves_the_advice_about_another() -> None:
    blunder = [
        Finding(Kind.CURVE_LACKS, run="A", test=test, p=1e-6, numbers={"least": 1e-4, "times": 5.0})
        for test in ("largest", "chi2")
    ]
    too_small = Finding(
        Kind.CHI2_TOO_LARGE, run="B", test="chi2", p=1e-6, numbers={"least": 1e-4, "times": 8.0}
    )
    alone = [choice.option for choice in choices_for(blunder)]
    both = [choice.option for choice in choices_for([*blunder, too_small])]
    assert "robust" in alone
    assert "jitter" not in alone
    assert {"robust", "jitter"} <= {*both}


def test_errors_that_are_stated_too_small_are_told_the_choice_that_allows_for_more() -> None:
    x = np.arange(20.0)
    y = 2.0 + 0.5 * x + 0.3 * np.random.default_rng(2).standard_normal(20)
    found = fit_curve("a + b*x", x, y, u_y=0.1)
    assert found.goodness[0].failed == ("chi2",)
    assert "allow for further errors of y (jitter)" in first_step(found.findings)
    assert fit_curve("a + b*x", x, y, u_y=0.1, jitter=True).status == "ok"
