"""Models of the noise side by side: which ones the data allow, and that the right one comes first
on data made for it.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_noise import CAMPAIGN, POSITIONS, SIGMA, TIMES

from estim.campaign import Campaign, load_campaign
from estim.checks.cross_validation import difference, leave_one_out
from estim.common.errors import InputError
from estim.fitting import fit_problem
from estim.fitting.least_squares import fit_least_squares
from estim.reports.comparison import _verdict
from estim.sampling.certificate import certify
from estim.sampling.chain import Target
from estim.sampling.proposal import adapt_proposal
from estim.studies.noise_comparison import compare_noise

QUICK = Target(ess=300.0, max_step=400)
RADIUS = 0.15


def campaign(
    folder: Path, noise: str, columns: dict[str, np.ndarray], *, text: str = CAMPAIGN
) -> Campaign:
    (folder / "c.toml").write_text(text.replace("NOISE", f"{{{noise}}}"))
    rows = "\n".join(
        ",".join(f"{v:.9f}" for v in row) for row in zip(*columns.values(), strict=True)
    )
    (folder / "r.csv").write_text(",".join(columns) + "\n" + rows + "\n")
    return load_campaign(folder / "c.toml")


def speeds() -> dict[str, np.ndarray]:
    return {
        "x_m": POSITIONS[1:-1],
        "v_m_s": (POSITIONS[2:] - POSITIONS[:-2]) / (TIMES[2:] - TIMES[:-2]),
    }


VIDEO = {"t_s": TIMES, "x_m": POSITIONS}
ENCODER = {"t_s": TIMES, "theta_rad": POSITIONS / RADIUS}
RATES = {
    "t_s": TIMES[1:-1],
    "theta_rad": POSITIONS[1:-1] / RADIUS,
    "omega_rad_s": speeds()["v_m_s"] / RADIUS,
}
OF_POSITIONS = ["positions", "positions, student-t", "positions, mixture"]
OF_SPEEDS = ["independent", "independent, student-t", "independent, mixture"]


@pytest.mark.parametrize(
    ("noise", "columns", "expected"),
    [
        ("sigma_x_m = 0.001", VIDEO, [*OF_POSITIONS, "differentiated", "independent"]),
        (
            'model = "positions", sigma_x_m = 0.001',
            VIDEO,
            [*OF_POSITIONS, "differentiated", "independent"],
        ),
        (
            'sigma_x_m = {prior = "half-normal", scale = 0.001}',
            VIDEO,
            [*OF_POSITIONS, "differentiated"],
        ),
        ('model = "positions", scatter = 0.001', VIDEO, OF_POSITIONS),
        ("encoder_step_rad = 0.0126", ENCODER, [*OF_POSITIONS, "differentiated", "independent"]),
        (
            'encoder_step_rad = 0.0126, derivative = "five-point"',
            ENCODER,
            [*OF_POSITIONS, "differentiated", "independent"],
        ),
        ('model = "independent", scatter = 0.1', RATES, OF_SPEEDS),
        (
            "encoder_step_rad = 0.0126, scatter = 0.1",
            RATES,
            [*OF_POSITIONS, "differentiated", *OF_SPEEDS],
        ),
        ("sigma_v_m_s = 0.02", speeds(), OF_SPEEDS),
    ],
)
def test_candidates_are_the_models_that_the_columns_and_the_noise_table_allow(
    tmp_path, noise, columns, expected
):
    pattern = campaign(tmp_path, noise, columns)
    found = pattern.noise_models("r")
    assert [c.name for c in found] == expected
    for candidate in found:
        pattern.problem(["r"], noise=candidate.table)  # every one of them can be posed


def test_a_stencil_that_is_said_is_used_by_all_that_differentiate(tmp_path):
    found = campaign(
        tmp_path, 'encoder_step_rad = 0.0126, derivative = "five-point"', ENCODER
    ).noise_models("r")
    assert {c.table.derivative for c in found} == {None, "five-point"}
    # root of the sum of squared weights 130/144, over one frame interval, of a step's
    # 0.0126/sqrt(12)
    assert found[-1].table.sigma_omega_rad_s == pytest.approx(
        0.0126 / np.sqrt(12.0) * np.sqrt(130.0) / 12.0 * 30.0, rel=1e-4
    )


def test_naive_independence_is_judged_on_the_very_frames_of_the_exact_covariance(tmp_path):
    pattern = campaign(tmp_path, "sigma_x_m = 0.001", VIDEO)
    exact, naive = (
        pattern.problem(["r"], noise=c.table).runs[0] for c in pattern.noise_models("r")[-2:]
    )
    np.testing.assert_array_equal(exact.y, naive.y)
    assert naive.noise.sigma.value == pytest.approx(SIGMA * 30.0 / np.sqrt(2.0), rel=1e-6)


def test_a_scatter_of_positions_is_not_taken_for_one_of_speeds(tmp_path):
    found = campaign(
        tmp_path, 'model = "positions", sigma_x_m = 0.001, scatter = 0.002', VIDEO
    ).noise_models("r")
    assert {c.name: c.table.scatter for c in found} == {
        **dict.fromkeys(OF_POSITIONS, 0.002),
        "differentiated": None,
        "independent": None,
    }


def test_one_model_is_nothing_to_compare(tmp_path):
    pattern = campaign(
        tmp_path, 'model = "independent", sigma_v_m_s = 0.02, derivative = "central"', VIDEO
    )
    with pytest.raises(InputError, match=r"c\.toml:\d+: 'noise' allows no other model for run 'r'"):
        pattern.noise_models("r")


def test_curves_of_a_user_and_unknown_runs_are_refused_in_a_line(tmp_path):
    with pytest.raises(InputError, match="must name one of the runs"):
        compare_noise(campaign(tmp_path, "sigma_x_m = 0.001", VIDEO), ["s"], seed=1)
    (tmp_path / "own.toml").write_text(
        'title = "a line"\nkind = "synthetic"\n[curve]\nexpression = "a + b*x"\nx = "x"\ny '
        '= "y"\nu_y = 0.1\n'
        '[curve.parameters]\na = {prior = "uniform", low = -9.0, high = 9.0}\nb = {prior = '
        '"uniform", low = -9.0, high = 9.0}\n'
        '[[runs]]\nname = "r"\nfile = "own.csv"\n'
    )
    (tmp_path / "own.csv").write_text("x,y\n" + "\n".join(f"{i},{i}" for i in range(6)))
    with pytest.raises(InputError, match="no other model to compare"):
        compare_noise(load_campaign(tmp_path / "own.toml"), ["r"], seed=1)


def compared_speeds(folder: Path, rng: np.random.Generator, bad: dict[int, float]):
    columns = speeds()
    columns["v_m_s"] = columns["v_m_s"] + 0.01 * rng.standard_normal(columns["x_m"].size)
    for i, off in bad.items():
        columns["v_m_s"][i] += off
    inside = slice(2, -3)  # where the speeds bend little between two frames
    pattern = campaign(
        folder, "sigma_v_m_s = 0.01", {name: column[inside] for name, column in columns.items()}
    )
    rows = compare_noise(pattern, ["r"], seed=3, target=QUICK)
    return {row.name: row for row in rows}


def test_a_comparison_says_whether_the_choice_matters() -> None:
    def row(status: str, *means: float) -> dict[str, object]:
        found = zip("ab", means, strict=True)
        posterior = {name: SimpleNamespace(mean=mean, sd=0.1) for name, mean in found}
        return {"status": status, "posterior": posterior}

    common = [SimpleNamespace(name=n, label=SimpleNamespace(symbol=n.upper())) for n in "ab"]
    rows = [row("ok", 1.0, 2.0), row("ok", 1.05, 2.03), row("poor-fit", 9.0, 9.0)]
    assert _verdict(rows, common) == (
        "2 of 3 models have status ok, and their estimates differ by at most 0.50 standard "
        "uncertainties (A)"
    )
    assert _verdict(rows[1:], common) == "1 of 2 models have status ok"


@pytest.mark.slow
def test_outliers_put_robust_noise_first(tmp_path, rng):
    spoiled = compared_speeds(tmp_path, rng, {9: 0.4, 21: -0.3})
    normal, t, mixture = (spoiled[name] for name in OF_SPEEDS)
    # two residuals of 30 and 40 sigma cost a normal law about (30^2 + 40^2)/2, less what the fit
    # bends
    for robust in (t, mixture):
        assert (
            robust.analysis.certificate.log_evidence - normal.analysis.certificate.log_evidence
            > 100.0
        )
        assert normal.loo.elpd < robust.loo.elpd - 100.0
    best = max((t, mixture), key=lambda row: row.loo.elpd)
    assert (best.behind, best.behind_se) == (0.0, 0.0)
    assert normal.behind == pytest.approx(best.loo.elpd - normal.loo.elpd)
    assert {row.data for row in spoiled.values()} == {"speeds"}
    # both bad frames decide much of the normal fit, and are said to
    x = normal.analysis.problem.runs[0].x
    assert {float(x[9 - 2]), float(x[21 - 2])} <= set(normal.influential["r"])


@pytest.mark.slow
def test_clean_data_give_robust_noise_no_credit(tmp_path, rng):
    clean = compared_speeds(tmp_path, rng, {})
    for robust in OF_SPEEDS[1:]:
        evidence = (
            clean[robust].analysis.certificate.log_evidence
            - clean["independent"].analysis.certificate.log_evidence
        )
        assert -12.0 < evidence < 0.0
    assert all(row.behind < 3.0 for row in clean.values())


def test_exact_covariance_predicts_frames_better_than_naive_independence(tmp_path, rng):
    """On the same speeds, which are differences of noisy positions; importance sampling in the
    place of chains, for speed.
    """
    pattern = campaign(
        tmp_path,
        "sigma_x_m = 0.001",
        {"t_s": TIMES, "x_m": POSITIONS + SIGMA * rng.standard_normal(TIMES.size)},
    )
    loo, evidence = [], []
    for candidate in pattern.noise_models("r")[-2:]:
        fit = fit_least_squares(pattern.problem(["r"], noise=candidate.table))
        certificate = certify(
            fit.posterior, adapt_proposal(fit.posterior, fit.values, fit.cov, rng=rng), rng=rng
        )
        loo.append(leave_one_out(fit.posterior, certificate.draws))
        evidence.append(certificate.log_evidence)
    better, se = difference(*loo)
    # neighbours tell the exact covariance much about a frame; a model of independent errors cannot
    # use that
    assert better > 2.0 * se > 0.0
    assert evidence[0] > evidence[1] + 3.0


@pytest.mark.slow
def test_robust_noise_has_optima_that_plain_noise_has_not(tmp_path):
    """Two frames of five a third too fast: the plain fit explains nothing, and has one optimum."""
    rng, columns = np.random.default_rng(1), speeds()
    n = columns["x_m"].size
    columns["v_m_s"] = columns["v_m_s"] + 0.01 * rng.standard_normal(n)
    columns["v_m_s"][rng.permutation(n)[: int(0.4 * n)]] *= 1.3
    pattern = campaign(tmp_path, "sigma_v_m_s = 0.01", columns)
    plain, *robust = (
        pattern.problem(["r"], noise=candidate.table) for candidate in pattern.noise_models("r")
    )
    assert len(fit_problem(plain, rng=rng).others) == 0
    assert len(fit_problem(robust[1], rng=np.random.default_rng(1)).others) > 0
