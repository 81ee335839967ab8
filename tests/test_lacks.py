"""What a user's own curve lacks: the keys `deviation` and `correlated`, in a campaign and in
Python.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from estim import fit_curve
from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.common.errors import InputError
from estim.common.statuses import Status
from estim.discrepancy.curve_covariances import correlated_shapes, deviation_shapes, relative_grid
from estim.discrepancy.kernels import root, without_mean
from estim.discrepancy.linearised import linearise
from estim.discrepancy.residual_part import find_residual_part
from estim.discrepancy.scale_mixture import diagonalise
from estim.fitting import fit_problem
from estim.fitting.discrepancy_fit import fit_discrepancy
from estim.fitting.optimum import fit_optimum
from estim.pipeline import analyse, sample_curve
from estim.problem.observations import Discrepancy
from estim.problem.roots import root_of
from estim.reports.curve_figures import phase_figure
from estim.sampling import Target

LINE = """title = "a line with a wave"
kind = "synthetic"
[curve]
expression = "a + b*x"
x = {column = "t_s", name = "time t", unit = "s"}
y = {column = "s_m", name = "distance s", unit = "m"}
u_y = 0.01
[curve.parameters]
a = {start = 0.0, unit = "m", meaning = "place at the start"}
b = {start = 1.0, unit = "m/s", meaning = "speed"}
[[runs]]
name = "first"
file = "run.csv"
[[runs]]
name = "second"
file = "run.csv"
"""
X = np.linspace(0.0, 2.0, 40)
WAVE = 0.03 * np.sin(7.0 * X)


def data(seed: int = 3) -> np.ndarray:
    return 0.5 + 1.5 * X + WAVE + 0.01 * np.random.default_rng(seed).standard_normal(X.size)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = "\n".join(f"{t:.9f},{s:.9f},1.0,{2 * t + 1:.9f}" for t, s in zip(X, data(), strict=True))
    (tmp_path / "rows.csv").write_text(rows)
    return tmp_path


def asked(folder: Path, keys: str, text: str = LINE) -> Path:
    (folder / "campaign.toml").write_text(
        text.replace("[curve.parameters]", f"{keys}\n[curve.parameters]")
    )
    if (folder / "rows.csv").exists():  # columns that are not used begin with _
        head = ",".join(name if f'"{name}"' in keys else f"_{name}" for name in ("same", "clock"))
        (folder / "run.csv").write_text(f"t_s,s_m,{head}\n{(folder / 'rows.csv').read_text()}\n")
    return folder / "campaign.toml"


def found(folder: Path, keys: str, rng: np.random.Generator):
    campaign = load_campaign(asked(folder, keys))
    return fit_problem(campaign.problem(["first"]), rng=rng)


def test_a_wave_is_found_with_its_size_and_widens_what_it_can_be_mistaken_for(folder, rng):
    fit = found(folder, "deviation = 0.05", rng)
    (lack,) = fit.deviations
    assert lack.probability > 0.999
    assert lack.smooth is not None
    assert 0.01 < lack.smooth.amplitude[1] < 0.1
    assert lack.correlated is None
    # what shows of it is the wave without its straight line, to three sds of a smoothed reading
    design = np.vander(X, 2)
    rest = WAVE - design @ np.linalg.lstsq(design, WAVE, rcond=None)[0]
    np.testing.assert_allclose(lack.residual_part.mean, rest, atol=0.015)
    inside = (lack.residual_part.quantiles[0] < rest) & (rest < lack.residual_part.quantiles[4])
    assert np.mean(inside) > 0.8
    sds = np.sqrt(np.diag(lack.cov))
    white = 0.01 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[::-1]
    assert np.all(sds > 2.0 * white)
    np.testing.assert_allclose(list(lack.growth.values()), sds / white, rtol=1e-6)
    assert abs(lack.mean[1] - 1.5) < 3.0 * sds[1]


def test_correlated_errors_follow_the_rows_or_a_column(folder, rng):
    by_rows = found(folder, "correlated = true", rng).deviations[0]
    by_clock = found(folder, 'correlated = "clock"', rng).deviations[0]
    assert by_rows.lacks.along_unit == "readings"
    np.testing.assert_array_equal(by_rows.lacks.along, np.arange(40.0))
    assert by_rows.correlated is not None
    assert by_clock.correlated is not None
    # same steps, other unit
    np.testing.assert_allclose(
        by_clock.correlated.length, np.array(by_rows.correlated.length) * 4.0 / 39.0, rtol=1e-6
    )
    np.testing.assert_allclose(by_clock.cov, by_rows.cov, rtol=1e-6)


@pytest.mark.parametrize("keys", ["deviation = 0.0", "correlated = false"])
def test_what_is_not_asked_for_costs_nothing(folder, rng, keys):
    fit = found(folder, keys, rng)
    assert fit.deviations == ()
    assert fit.problem.runs[0].lacks is None


def test_a_run_has_the_last_word(folder):
    text = LINE.replace(
        'name = "second"\n', 'name = "second"\ndeviation = 0.0\ncorrelated = true\nevery = 2\n'
    )
    campaign = load_campaign(asked(folder, "deviation = 0.05", text))
    first, second = (campaign.problem([name]).runs[0] for name in campaign.run_names)
    assert first.lacks.deviation == 0.05
    assert first.lacks.along is None
    assert second.lacks.deviation == 0.0
    np.testing.assert_array_equal(second.lacks.along, np.arange(0.0, 40.0, 2.0))
    assert (first.n_obs, second.n_obs) == (40, 20)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("deviation = -0.1", "must be > 0"),
        ("deviation = nan", "must be > 0"),
        ('correlated = "same"', "all the same"),
        ('correlated = "none"', "none"),
        ("deviation = 0.1\nu_x = 0.01", "u_x"),
        ('deviation = 0.1\nrobust = "student-t"', "robust"),
        ("every = 0", r"must be >= 1 \(3: every third point\): 0"),
    ],
)
def test_what_does_not_go_together_is_refused_at_its_line(folder, keys, said):
    with pytest.raises(InputError, match=said) as caught:
        load_campaign(asked(folder, keys))
    assert caught.value.line is not None


def test_neither_an_uncertain_error_nor_a_joint_fit_nor_a_calibration_goes_with_a_deviation(folder):
    with pytest.raises(InputError, match="leave 'u_y' out"):
        load_campaign(
            asked(folder, "deviation = 0.1", LINE.replace("u_y = 0.01", 'u_y = "0.010(1)"'))
        )
    campaign = load_campaign(asked(folder, "deviation = 0.1"))
    with pytest.raises(InputError, match="fit the runs one by one"):
        campaign.problem(["first", "second"])
    done = CliRunner().invoke(
        cli,
        [
            "calibrate",
            str(folder / "campaign.toml"),
            "--run",
            "first",
            "--out",
            str(folder / "out"),
        ],
    )
    assert isinstance(done.exception, InputError)
    assert "takes the curve as complete" in str(done.exception)
    load_campaign(asked(folder, "correlated = true")).problem(["first", "second"])


def test_too_many_points_are_told_what_to_do(tmp_path):
    rows = "\n".join(f"{i},{i * 1.5}" for i in range(2100))
    (tmp_path / "run.csv").write_text(f"t_s,s_m\n{rows}\n")
    with pytest.raises(InputError, match="every = 3"):
        load_campaign(asked(tmp_path, "deviation = 0.1"))
    assert (
        load_campaign(asked(tmp_path, "deviation = 0.1\nevery = 3")).problem(["first"]).n_obs == 700
    )


def test_correlated_errors_of_a_joint_fit_widen_each_run(folder, rng):
    campaign = load_campaign(asked(folder, "correlated = true"))
    fit = fit_problem(campaign.problem(["first", "second"]), rng=rng)
    assert [one.run for one in fit.deviations] == ["first", "second"]
    single = fit_problem(campaign.problem(["first"]), rng=rng)
    assert np.all(np.diag(fit.cov) < np.diag(single.cov))


# --- in Python
# --------------------------------------------------------------------------------------------------


START = {"a": 0.0, "b": 1.0}


def test_a_stated_deviation_leads_from_a_poor_fit_to_a_number():
    poor = fit_curve("a + b*x", X, data(), start=START, u_y=0.01)
    assert poor.status == "poor-fit"
    (words,) = poor.advice
    # whose size is not to be read off the residuals
    assert words.index("another curve") < words.index("deviation")
    assert words in str(poor)
    fit = fit_curve("a + b*x", X, data(), start=START, u_y=0.01, deviation=0.05)
    assert fit.status == "ok"
    assert abs(fit.values["b"] - 1.5) < 2.5 * fit.sds["b"]
    assert fit.sds["b"] > 2.0 * poor.sds["b"]
    assert fit.intervals["b"][0.95][0] < 1.5 < fit.intervals["b"][0.95][1]
    assert fit.deviation is not None
    assert "a smooth deviation from the curve" in fit.notes[-1]


def test_an_outlier_is_no_smooth_deviation():
    y = 0.5 + 1.5 * X + 0.01 * np.random.default_rng(5).standard_normal(X.size)
    y[17] += 0.5
    assert fit_curve("a + b*x", X, y, start=START, u_y=0.01, deviation=0.05).status == "poor-fit"


@pytest.mark.slow
def test_units_do_not_matter():
    one = fit_curve("a + b*x", X, data(), start=START, deviation=0.05, correlated=True)
    other = fit_curve(
        "a + b*x",
        1000.0 * X,
        100.0 * data(),
        start={"a": 0.0, "b": 0.1},
        deviation=5.0,
        correlated=1000.0 * X,
    )
    assert other.values["b"] == pytest.approx(0.1 * one.values["b"], rel=1e-6)
    assert other.sds["b"] == pytest.approx(0.1 * one.sds["b"], rel=1e-6)
    assert other.sigma == pytest.approx(100.0 * one.sigma, rel=1e-6)


def test_where_nothing_is_missing_the_size_of_the_errors_is_that_of_the_residuals():
    y = 0.5 + 1.5 * X + 0.01 * np.random.default_rng(11).standard_normal(X.size)
    fit, plain = (fit_curve("a + b*x", X, y, start=START, deviation=scale) for scale in (0.01, 0.0))
    assert fit.sigma == pytest.approx(plain.sigma, rel=0.1)
    assert fit.sds["b"] < 2.5 * plain.sds["b"]
    assert "P(amplitude > 0)" in fit.notes[-1]


def test_the_size_of_the_independent_errors_is_not_called_that_of_the_residuals():
    fit = fit_curve("a + b*x", X, data(), start=START, deviation=0.05)
    assert fit.sigma < 0.7 * float(np.std(fit.residuals))
    assert f"sd of the independent part of the errors = {fit.sigma:.4g} (" in str(fit)
    assert "residual sd = " in str(fit_curve("a + b*x", X, data(), start=START))


def test_a_fit_beside_errors_of_unknown_size_can_be_sampled():
    """Its symmetry still had a dimension for the size of the errors: an error of NumPy."""
    y = 0.5 + 3.0 * np.exp(-X / 0.6) + 0.01 * np.random.default_rng(3).standard_normal(X.size)
    fit = fit_curve("a*exp(-x/t) + c", X, y, correlated=True)
    analysis = sample_curve(fit, seed=1, target=Target(ess=1000.0))
    assert analysis.diagnosis.status == "ok"
    for name in fit.names:
        assert abs(analysis.chain.column(name).mean() - fit.values[name]) < 0.3 * fit.sds[name]


@pytest.mark.parametrize("keys", ["deviation = 0.05", ""])
def test_the_legend_says_what_the_band_of_a_new_reading_leaves_out(folder, keys):
    draws = Target(ess=1000.0)
    analysis = analyse(load_campaign(asked(folder, keys)), ["first"], seed=1, target=draws)
    ok = replace(analysis, diagnosis=replace(analysis.diagnosis, status=Status.OK))
    (legend,) = phase_figure(ok).legends
    words = "a new distance s without the deviation, 95 %" if keys else "a new distance s, 95 %"
    assert words in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"deviation": -1.0}, "deviation"),
        ({"deviation": "much"}, "deviation"),
        ({"correlated": [1.0, 2.0]}, "40 times"),
        ({"correlated": np.zeros(40)}, "all the same"),
        ({"correlated": "t"}, "must be True"),
        ({"deviation": 1.0, "u_x": 0.1}, "u_x"),
    ],
)
def test_a_wrong_argument_is_named(choices, said):
    with pytest.raises(InputError, match=said):
        fit_curve("a + b*x", X, data(), start=START, u_y=0.01, **choices)


# --- the mathematics
# --------------------------------------------------------------------------------------------------


def test_a_constant_of_the_curve_takes_the_mean_of_a_deviation():
    """With a constant among the parameters the others are the same whether the mean of the
    deviation is taken out or not.
    """
    jacobian = np.vander(X, 3)
    errors = WAVE - jacobian @ np.linalg.lstsq(jacobian, WAVE, rcond=None)[0]
    plain = tuple(shape.times(0.1) for shape in deviation_shapes(X))
    without = tuple(
        replace(shape, factor=root(without_mean(shape.covariance, np.full(40, 1.0 / 40))))
        for shape in plain
    )
    found = [
        linearise(
            diagonalise(root_of(np.full(40, 1e-4)), shapes, relative_grid(stated=True)),
            errors,
            jacobian,
            precision=np.zeros((3, 3)),
        )
        for shapes in (plain, without)
    ]
    np.testing.assert_allclose(found[0].covariance[:2, :2], found[1].covariance[:2, :2], rtol=1e-6)
    np.testing.assert_allclose(found[0].mean[:2], found[1].mean[:2], rtol=1e-5)
    assert found[0].covariance[2, 2] > 1.1 * found[1].covariance[2, 2]


def test_what_shows_is_that_of_dense_matrices(folder):
    """One component alone: regression on a normal process by dense inverses, the parameters
    integrated out under flat priors.
    """
    run = load_campaign(asked(folder, "deviation = 0.05")).problem(["first"]).runs[0]
    run = replace(run, lacks=Discrepancy(0.05, None, "", True))
    (shape,) = [shape for shape in deviation_shapes(X) if 0.2 < shape.length < 0.25]
    grid = relative_grid(stated=True)
    single = replace(
        grid,
        amplitudes=np.array([0.8]),
        log_amplitudes=np.zeros(1),
        scales=np.ones(1),
        log_scales=np.zeros(1),
    )
    design, residuals = np.column_stack([np.ones(40), X]), run.y - 0.5 - 1.5 * X
    linear = linearise(
        diagonalise(
            root_of(np.full(40, 1e-4)), (replace(shape.times(0.05), log_prior=0.0),), single
        ),
        residuals,
        design,
        precision=np.zeros((2, 2)),
    )
    seen = find_residual_part(linear, run, (shape.times(0.05),))
    scaled = np.sqrt(3.0) * np.abs(X[:, None] - X) / shape.length
    kernel = 0.04**2 * (1.0 + scaled) * np.exp(-scaled)
    plain = np.linalg.inv(kernel + 1e-4 * np.eye(40))
    inverse = plain - plain @ design @ np.linalg.inv(design.T @ plain @ design) @ design.T @ plain
    rest = np.eye(40) - design @ np.linalg.inv(design.T @ design) @ design.T
    cov = rest @ (kernel - kernel @ inverse @ kernel) @ rest.T
    np.testing.assert_allclose(seen.mean, rest @ kernel @ inverse @ residuals, atol=1e-6)
    np.testing.assert_allclose(
        seen.quantiles[3] - seen.quantiles[2], 0.99446 * np.sqrt(np.diag(cov)), rtol=1e-3
    )


def test_an_unstated_size_is_found_whatever_it_is(rng):
    """The posterior of the size of white noise does not hang on where its grid begins."""
    y = X + 0.02 * rng.standard_normal(40)
    design = np.vander(X, 2)
    shapes = tuple(shape.times(0.05) for shape in correlated_shapes(np.arange(40.0)))
    rms = np.sqrt(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2) / 38)
    sizes = []
    for unit in (rms, 2.0 * rms):
        deviation = diagonalise(root_of(np.full(40, unit**2)), shapes, relative_grid(stated=False))
        linear = linearise(deviation, y, design, precision=np.zeros((2, 2)), stated=False)
        sizes.append((unit * linear.size("scale")[1], linear.covariance[0, 0]))
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=0.05)


def test_the_fit_is_the_mode_of_what_is_sampled(folder, rng):
    campaign = load_campaign(asked(folder, "deviation = 0.05"))
    problem = campaign.problem(["first"])
    fit = fit_discrepancy(fit_optimum(problem, rng=rng))
    near = fit.values + 1e-3 * np.sqrt(np.diag(fit.cov)) * rng.standard_normal((50, 2))
    assert np.all(
        fit.posterior.log_density(near) <= fit.posterior.log_density(fit.values[None])[0] + 1e-9
    )


@pytest.mark.statistics
@pytest.mark.parametrize(
    ("kind", "choices", "stated"),
    [("red", {"correlated": True}, False), ("smooth", {"deviation": 4.0}, True)],
)
def test_intervals_hold_what_they_say(kind, choices, stated):
    """A line, 40 points: AR(1) errors of .9, or a deviation of two standard deviations; without the
    keys, far too few.
    """
    rng, n_run = np.random.default_rng(17), 60
    apart = np.sqrt(3.0) * np.abs(X[:, None] - X) / 0.4
    smooth = np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(40))
    red = np.linalg.cholesky(0.9 ** np.abs(np.subtract.outer(np.arange(40.0), np.arange(40.0))))
    held = {(name, level): 0 for name in ("with", "without") for level in (0.68, 0.95)}
    for _ in range(n_run):
        errors = (
            red @ rng.standard_normal(40)
            if kind == "red"
            else 2.0 * smooth @ rng.standard_normal(40) + rng.standard_normal(40)
        )
        y = 3.0 * X + errors
        size = {"u_y": 1.0} if stated else {}
        for name, keys in (("with", choices), ("without", {})):
            fit = fit_curve("a + b*x", X, y, start=START, scan=False, **size, **keys)
            ends = fit.intervals["b"]
            for level, (low, high) in ends.items():
                held[name, level] += low < 3.0 < high
    assert abs(held["with", 0.68] / n_run - 0.68) < 3.0 * np.sqrt(0.68 * 0.32 / n_run) + 0.04
    assert held["with", 0.95] / n_run > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / n_run)
    assert held["without", 0.68] / n_run < 0.5


# --- a deviation that nobody asked for
# --------------------------------------------------------------------------------------------------


def by_brute_force(x: np.ndarray, y: np.ndarray, u: float) -> float:
    """P(a > 0 | data) of a line with flat priors, by dense matrices: each covariance is made, and
    its evidence is a determinant and a quadratic form.

    a half-normal with the scale of one error, the length log-normal about a sixth of the range
    (factor e^0.7, between 1/30 and 0.6 of it), the size of the noise as the module has it; by sums
    over grids that are finer than its own.
    """
    grid = relative_grid(stated=True)
    design, apart = (
        np.column_stack([np.ones_like(x), x]),
        np.sqrt(3.0) * np.abs(np.subtract.outer(x, x)),
    )
    lengths = np.ptp(x) * np.geomspace(1.0 / 30.0, 0.6, 25)
    of_length = np.exp(-0.5 * (np.log(6.0 * lengths / np.ptp(x)) / 0.7) ** 2)
    sizes = np.linspace(0.02, 3.5, 60)
    of_size = np.exp(-0.5 * sizes**2)

    def evidence(covariance: np.ndarray) -> float:
        inverse = np.linalg.inv(covariance)
        information = design.T @ inverse @ design
        left = y - design @ np.linalg.solve(information, design.T @ inverse @ y)
        return float(
            np.exp(
                -0.5
                * (
                    left @ inverse @ left
                    + np.linalg.slogdet(covariance)[1]
                    + np.linalg.slogdet(information)[1]
                )
            )
        )

    none = here = 0.0
    for scale, log_scale in zip(grid.scales, grid.log_scales, strict=True):
        if scale < 0.25:  # nothing of these residuals is so small
            continue
        white = (scale * u) ** 2 * np.eye(x.size)
        none += np.exp(log_scale) * evidence(white)
        for length, weight in zip(lengths, of_length / of_length.sum(), strict=True):
            kernel = u**2 * (1.0 + apart / length) * np.exp(-apart / length)
            some = np.array([evidence(white + size**2 * kernel) for size in sizes])
            here += np.exp(log_scale) * weight * float(np.sum(of_size / of_size.sum() * some))
    return here / (here + none)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "seed"), [(0.0, 1), (1.3, 2)])
def test_how_probable_an_unasked_deviation_is_comes_out_by_brute_force(
    size: float, seed: int
) -> None:
    x = np.linspace(0.0, 1.0, 24)
    y = (
        1.0
        + 2.0 * x
        + 0.1 * (np.random.default_rng(seed).standard_normal(24) + size * np.sin(14.0 * x))
    )
    fit = fit_curve("a + b*x", x, y, u_y=0.1)
    assert fit.status == "ok"
    (said,) = [note for note in fit.notes if "assumed to be complete" in note]
    found = float(re.findall(r"has probability ([0-9.]+)", said)[0])
    assert found == pytest.approx(by_brute_force(x, y, 0.1), abs=0.02)
    assert (found > 0.5) == (size > 0.0)


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_what_a_curve_taken_as_complete_may_lack_stands_first(tmp_path: Path) -> None:
    """In print(fit), once in the terminal, and on the first screen of the report; not with few
    points or where a deviation was asked for.
    """
    x = np.linspace(0.0, 1.0, 30)
    y = 1.0 + 2.0 * x + 0.1 * np.random.default_rng(3).standard_normal(30)
    words = "the intervals do not allow for a smooth deviation"
    assert str(fit_curve("a + b*x", x, y, u_y=0.1)).count(words) == 1
    assert words not in str(fit_curve("a + b*x", x[:15], y[:15], u_y=0.1))
    assert words not in str(fit_curve("a + b*x", x, y, u_y=0.1, deviation=0.1))
    table = tmp_path / "points.csv"
    table.write_text("x,y\n" + "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(x, y, strict=True)))
    done = CliRunner().invoke(
        cli,
        [
            "fit",
            str(table),
            "--formula",
            "a + b*x",
            "--u-y",
            "0.1",
            "--kind",
            "synthetic",
            "--out",
            str(tmp_path / "out"),
        ],
    )
    assert done.exit_code == 0, done.output
    assert done.output.count(words) == 1
    screen = (tmp_path / "out" / "report.md").read_text().split("<details>")[0]
    assert f"- Note: the curve is assumed to be complete: {words}" in screen
