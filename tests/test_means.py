"""The mean of several values, against published analyses and code that shares nothing with it.

- Charged kaon mass: the six measurements of the Review of Particle Physics (PDG 2022).
- BCG trials: log relative risks and variances as printed in the documentation of the R package
  metafor (Colditz et al. 1994); DerSimonian-Laird tau^2 0.3088, mean -0.7141, u 0.1787; and
  Paule-Mandel tau^2 0.3181.  Computed there from the counts; here from the four printed digits.
- GUM H.5, table H.9: ten days of five readings; the readings are made with the printed means and
  standard deviations of the days.
"""

import json
import math

import numpy as np
import pytest
from command_runner import runner
from matplotlib.colors import to_hex
from scipy import integrate, stats
from scipy.signal import lfilter

import estim
from estim.cli.commands import cli
from estim.common import spoken
from estim.common.errors import InputError
from estim.common.quantity_text import Quantity, difference
from estim.drawing import PALE
from estim.means.dark_uncertainty import der_simonian_laird, hierarchical
from estim.means.table_mean import mean_of_table
from estim.reports.mean import mean_figure, mean_statement

KAON = [493.696, 493.636, 493.640, 493.670, 493.657, 493.691]
U_KAON = [0.007, 0.011, 0.054, 0.029, 0.020, 0.040]
BCG = [-0.8893, -1.5854, -1.3481, -1.4416, -0.2175, -0.7861, -1.6209]
BCG += [0.0120, -0.4694, -1.3713, -0.3394, 0.4459, -0.0173]
V_BCG = [0.3256, 0.1946, 0.4154, 0.0200, 0.0512, 0.0069, 0.2230]
V_BCG += [0.0040, 0.0564, 0.0730, 0.0124, 0.5325, 0.0714]
DAY_MEANS = [172, 116, 13, 144, 106, 31, 60, 125, 163, 41]  # 10 V + these in uV
DAY_SDS = [60, 77, 111, 101, 67, 93, 80, 73, 88, 86]  # uV


def zener():
    """Readings (50,) in V and their days."""
    pattern = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    pattern /= pattern.std(ddof=1)
    readings = 10.0 + 1e-6 * (np.array(DAY_MEANS)[:, None] + np.outer(DAY_SDS, pattern))
    return readings.ravel(), np.repeat(np.arange(10), 5)


def test_bcg_trials_of_metafor():
    found = estim.mean(BCG, np.sqrt(V_BCG))
    laird, paule = found.averages["DerSimonian-Laird"], found.averages["Mandel-Paule"]
    assert laird.tau**2 == pytest.approx(0.3088, abs=0.0006)  # 152.23 from counts, 151.81 here
    assert (laird.value, laird.u) == pytest.approx((-0.7141, 0.1787), abs=1e-4)
    assert paule.tau**2 == pytest.approx(0.3181, abs=1e-4)
    assert found.chi2 == pytest.approx(152.2330, abs=0.5)
    assert found.recommended == "hierarchical"
    assert not found.consistent


def test_weighted_mean_of_the_kaon_mass():
    found = estim.mean(KAON, U_KAON)
    w = 1.0 / np.array(U_KAON) ** 2
    value = np.average(KAON, weights=w)
    assert found.averages["weighted"].value == pytest.approx(value, abs=1e-10)
    assert round(found.averages["weighted"].value, 3) == 493.677  # as the PDG has it
    assert found.chi2 == pytest.approx(float(np.sum(w * (KAON - value) ** 2)), rel=1e-9)
    assert found.p_value == pytest.approx(stats.chi2.sf(found.chi2, 5), rel=1e-9)
    birge = found.averages["Birge"]
    assert birge.u == pytest.approx(found.birge * found.averages["weighted"].u)
    assert birge.k == pytest.approx(stats.t.ppf(0.975, 5))
    paule = found.averages["Mandel-Paule"]
    v = 1.0 / (np.array(U_KAON) ** 2 + paule.tau**2)
    assert np.sum(v * (np.array(KAON) - paule.value) ** 2) == pytest.approx(5.0, rel=1e-8)


@pytest.mark.parametrize(("x", "u"), [(KAON, U_KAON), (BCG[:4], np.sqrt(V_BCG[:4]))])
def test_hierarchical_mean_is_the_integral_of_the_posterior(x, u):
    """By quadrature in mu and tau, of the density as it is written down."""
    x, u = np.asarray(x), np.asarray(u)
    best = estim.mean(x, u).averages["hierarchical"]
    scale = float(np.ptp(x))

    def density(mu, tau):
        prior = tau * math.sqrt(np.sum(1.0 / (u**2 + tau**2) ** 2)) * scale
        return prior * float(np.prod(stats.norm.pdf(x, mu, np.hypot(u, tau)))) * scale ** len(x)

    grid_mu = x.mean() + scale * np.sinh(np.linspace(-5.0, 5.0, 1001)) / 5.0
    grid_tau = scale * np.geomspace(1e-4, 1e3, 801)
    var = u**2 + grid_tau[:, None] ** 2
    prior = grid_tau * np.sqrt(np.sum(1.0 / var**2, axis=1))
    ends = [
        prior * np.prod(stats.norm.pdf(x, mu, np.sqrt(var)), axis=1) * scale ** len(x)
        for mu in grid_mu
    ]
    assert ends[500][400] * scale == pytest.approx(density(grid_mu[500], grid_tau[400]), rel=1e-9)
    of_mu = integrate.trapezoid(np.array(ends), grid_tau, axis=1)
    below = integrate.cumulative_trapezoid(of_mu, grid_mu, initial=0.0)
    low, high = np.interp([0.025, 0.975], below / below[-1], grid_mu)
    assert (best.low, best.high) == pytest.approx((low, high), abs=2e-3 * scale)
    mean = integrate.trapezoid(grid_mu * of_mu, grid_mu) / below[-1]
    assert best.value == pytest.approx(mean, abs=1e-3 * scale)


def test_consistent_values_have_the_weighted_mean_and_text_is_read():
    found = estim.mean(["9.81(2)", "9.79(2)", "9.80(1)"])
    assert found.recommended == "weighted"
    assert found.best.value == pytest.approx(9.80)
    assert found.averages["Mandel-Paule"].tau == 0.0
    assert math.isnan(found.averages["hierarchical"].u)  # fewer than four values
    assert found.averages["hierarchical"].low < found.best.low
    assert "the values are consistent" in str(found)
    assert "| **weighted** |" in found._repr_markdown_()
    shifted = estim.mean([1e6 * v + 5.0 for v in (9.81, 9.79, 9.80)], [2e4, 2e4, 1e4])
    for name, average in found.averages.items():
        assert shifted.averages[name].low == pytest.approx(1e6 * average.low + 5.0, rel=1e-7)


def test_values_that_scatter_too_little_are_told():
    assert "scatter less" in estim.mean([1.0, 1.001, 0.999, 1.0, 1.0], 0.1).reason


def test_analysis_of_variance_of_gum_h5():
    readings, days = zener()
    found = estim.mean(readings, groups=days)
    groups = found.groups
    assert found.best.value == pytest.approx(10.000097, abs=5e-7)
    assert groups.s_within == pytest.approx(85e-6, abs=0.5e-6)  # s_b
    assert math.sqrt(5.0) * groups.means.std(ddof=1) == pytest.approx(128e-6, abs=0.5e-6)  # s_a
    assert pytest.approx(2.25, abs=0.02) == groups.F  # of the rounded numbers
    assert groups.s_between == pytest.approx(43e-6, abs=0.5e-6)
    assert (groups.dof_between, groups.dof_within) == (9, 40)
    assert found.best.u == pytest.approx(18e-6, abs=0.5e-6)
    assert found.averages["readings"].u == pytest.approx(13e-6, abs=0.5e-6)
    assert (found.best.dof, found.averages["readings"].dof) == (9, 49)
    one_way = stats.f_oneway(*readings.reshape(10, 5))
    assert (groups.F, groups.p_value) == pytest.approx((one_way.statistic, one_way.pvalue))


def test_readings_are_a_type_a_evaluation():
    readings = [5.007, 4.994, 5.005, 4.990, 4.999]  # GUM H.2, table H.2: V
    found = estim.mean(readings).best
    assert (found.value, found.u) == pytest.approx((4.9990, 0.0032), abs=5e-5)
    interval = stats.t.interval(0.95, 4, np.mean(readings), stats.sem(readings))
    assert (found.low, found.high) == pytest.approx(interval)


def test_readings_that_depend_on_the_one_before_have_no_mean_to_quote() -> None:
    """Intervals of such a mean held it in 29 of 100 sets (autoregressive errors, 0.9)."""
    rng = np.random.default_rng(4)
    errors = rng.standard_normal(160)
    walk = lfilter([math.sqrt(1.0 - 0.9**2)], [1.0, -0.9], errors)[-60:]
    found = estim.mean(10.0 + walk)
    assert found.status == "poor-fit"
    assert "each depends on the one before" in found.reason
    assert estim.mean(10.0 + errors[-60:]).status == "ok"
    # a list that somebody has sorted looks the same as a drift
    listed = estim.mean(np.sort(10.0 + errors[-60:]))
    assert listed.status == "ok"
    assert listed.reason.endswith("so that they were sorted, or drift")


def test_a_mistyped_reading_is_told_by_either_door(tmp_path):
    readings = np.round(np.random.default_rng(3).normal(1.42, 0.03, 12), 2)
    assert estim.mean(readings).status == "ok"
    for n in (4, 14, 100, 299, 900):  # a step from the others, whatever their number
        assert estim.mean([1.4] * n + [1.5]).status == "ok"
        assert n == 4 or estim.mean([1.4] * n + [2.3]).status == "poor-fit"
    readings[7] = 14.1
    found = estim.mean(readings)
    assert (found.status, found.reason[:20]) == ("poor-fit", "value number 8, 14.1")
    file = tmp_path / "times.csv"
    file.write_text("\n".join(["t [s]", *map(str, readings)]))
    out = str(tmp_path / "out")
    done = runner().invoke(cli, ["mean", str(file), "--out", out, "--figures", "none"])
    assert done.exit_code == 3
    bands = mean_figure(mean_of_table(file)).axes[0].patches
    assert [band.get_label() for band in bands] == ["readings, 95 %"]
    assert "mean: poor-fit\n  Quote none: value number 8, 14.1" in done.output
    assert "±" not in done.output


@pytest.mark.parametrize(
    ("values", "choices", "field"),
    [
        ([1.0], {"u": 0.1}, "values"),
        ([1.0, math.nan], {"u": 0.1}, "values"),
        ([1.0, 2.0], {"u": [0.1, 0.0]}, "u"),
        ([1.0, 2.0], {"u": [0.1, 0.1, 0.1]}, "u"),
        ([1.0, 1.0], {}, "values"),
        (["1.0(1)", "2"], {}, "u"),
        ([1.0, 2.0], {"u": 0.1, "groups": "ab"}, "groups"),
        ([1.0, 2.0, 3.0], {"groups": "ab"}, "groups"),
        ([1.0, 2.0, 3.0], {"groups": "abc"}, "groups"),
        ([1.0, 1.0, 3.0, 3.0], {"groups": "aabb"}, "groups"),
        ([1.0, 2.0, 3.0, 4.0], {"groups": ["a", None, "b", None]}, "groups"),
        ([1.0, 2.0, 3.0, 4.0], {"groups": ["a", "", "b", ""]}, "groups"),
        ([1.0, 2.0, 3.0, 4.0], {"groups": [1.0, math.nan, 2.0, math.nan]}, "groups"),
        ([1.0, 2.0], {"u": 0.1, "probability": 1.0}, "probability"),
    ],
)
def test_what_is_no_mean_is_refused(values, choices, field):
    with pytest.raises(InputError) as caught:
        estim.mean(values, **choices)
    assert caught.value.field == field


def test_the_command_writes_what_python_says(tmp_path):
    file = tmp_path / "kaon.csv"
    rows = [f"{x},{u}" for x, u in zip(KAON, U_KAON, strict=True)]
    file.write_text("\n".join(["m [MeV],u_m", *rows]))
    done = runner().invoke(cli, ["mean", str(file), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "493.667 MeV" in done.output
    record = json.loads((tmp_path / "out/result.json").read_text())
    assert record["averages"]["hierarchical"]["low"] == estim.mean(KAON, U_KAON).best.low
    assert not record["consistent"]
    assert (tmp_path / "out/figures/mean.png").read_bytes()[:4] == b"\x89PNG"
    told = runner().invoke(cli, ["diff", str(tmp_path / "out"), "493.677(13) MeV"])
    assert "E_n = −0.24: the two values agree" in told.output
    stated = runner().invoke(
        cli, ["mean", str(file), "--u-y", "0.1", "--out", str(tmp_path / "b"), "--figures", "none"]
    )
    assert "Quote weighted" in stated.output


def test_the_command_reads_groups_in_words(tmp_path):
    readings, days = zener()
    file = tmp_path / "zener.csv"
    lines = [f"day {d},{x!r}" for x, d in zip(readings.tolist(), days, strict=True)]
    file.write_text("\n".join(["day,U [V]", *lines]))
    choices = ["--group", "day", "--out", str(tmp_path / "out"), "--figures", "none"]
    done = runner().invoke(cli, ["mean", str(file), *choices])
    assert "(10.000097 ± 0.000041) V" in done.output
    assert "Analysis of variance" in (tmp_path / "out/report.md").read_text()


def test_a_column_of_groups_that_are_numbers_is_used(tmp_path):
    (tmp_path / "a.csv").write_text("U,n,day\n5.01,1,1\n5.03,2,1\n5.11,3,2\n5.12,4,2\n")
    found = mean_of_table(tmp_path / "a.csv", y="U", group="day")
    assert found.told == "columns: y = U, group = day; columns not used: n"


def test_groups_are_numbers_or_words():
    readings = [1.0, 2.0, 3.0, 5.0]
    found = estim.mean(readings, groups=[1, 1.0, np.float64(2), np.int64(2)])
    assert found.groups.names == ("1", "2")
    words = estim.mean(readings, groups=["a", "a", "b", "b"])
    assert words.best == found.best


@pytest.mark.parametrize("blank", ["", "-", "NaN"])
def test_every_reading_of_a_table_has_its_group(tmp_path, blank):
    rows = ["day;t", "Mo;1,1", f"{blank};1,2", "Tu;1,4", f"{blank};1,6", f"{blank};"]
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match=r"a\.csv:3: 'day' must say the group of every reading"):
        mean_of_table(tmp_path / "a.csv", y="t", group="day")


@pytest.mark.parametrize("head", ["period (s)", "period [s]", "period in s"])
def test_one_column_has_a_name_with_a_blank_before_its_unit(tmp_path, head):
    path = tmp_path / "a.csv"
    path.write_text(f"{head}\n2.01\n2.03\n1.99\n2.02\n")
    arguments = ["mean", str(path), "--out", str(tmp_path / "out"), "--figures", "none"]
    result = runner().invoke(cli, arguments)
    assert result.output.startswith("columns: y = period (s)\n")


def test_two_values_are_compared_with_their_correlation():
    a, b = Quantity(9.81, 0.02), Quantity(9.79, 0.02)
    assert difference(a, b).u == pytest.approx(0.02 * math.sqrt(2.0))
    assert difference(a, b, correlation=1.0).u == 0.0
    done = runner().invoke(cli, ["diff", "9.81(2) m/s²", "9.79(2) m/s²", "--r", "0.9"])
    assert "difference: 0.0200 m/s², u = 0.0089 m/s²" in done.output
    assert "E_n = 1.12: the two values do not agree" in done.output
    found = estim.compare_values("9.81(2) m/s²", "9.79(2) m/s²", r=0.9)
    assert done.output == f"{found}\n"
    assert found.e_n == pytest.approx(0.02 / (2.0 * math.sqrt(0.2) * 0.02))
    assert not found.agree
    for wrong, rule in (("9.79(2) m/s", "must be in m/s², as the first"), ("x", "second")):
        with pytest.raises(InputError, match=rule):
            estim.compare_values("9.81(2) m/s²", wrong)
    with pytest.raises(InputError, match="must be in m/s², as the first: no unit"):
        estim.compare_values("9.81(2) m/s²", "9.79(2)")
    with pytest.raises(InputError, match="must have no unit, as the first: m/s²"):
        estim.compare_values("9.81(2)", "9.79(2) m/s²")
    with pytest.raises(InputError, match="between -1 and 1"):
        estim.compare_values("9.81(2)", "9.79(2)", r=1.1)


def test_a_result_of_few_readings_is_compared_by_its_own_coverage_factor(tmp_path):
    (tmp_path / "g.csv").write_text("g\n9.70\n9.72\n9.74\n")
    choices = ["--out", str(tmp_path / "out"), "--figures", "none"]
    runner().invoke(cli, ["mean", str(tmp_path / "g.csv"), *choices])
    exact = runner().invoke(cli, ["diff", str(tmp_path / "out"), "9.76"]).output
    assert "U = k u = 0.050 with k = 4.30 for 2 degrees of freedom" in exact
    assert "E_n = −0.81: the two values agree" in exact  # -0.04/(4.303*0.02/sqrt(3))
    u, k = 0.02 / math.sqrt(3.0), stats.t.ppf(0.975, 2.0 * 4.0)  # dof = 2 (1 + 1)^2 for equal u
    two = estim.compare_values((Quantity(9.72, u), "1", 2.0), (Quantity(9.76, u), "1", math.inf))
    assert two.dof == pytest.approx(8.0)
    assert two.e_n == pytest.approx(-0.04 / (k * math.sqrt(2.0) * u))
    together = runner().invoke(cli, ["diff", str(tmp_path / "out"), "9.76(1)", "--r", "0.5"])
    assert "with k = 4.30 for 2 degrees" in together.output


def test_a_formula_at_the_command_line(tmp_path):
    words = ["propagate", "g = 4*pi**2*L/T**2", "L=0.85(1) m", "T=1.851(3) s"]
    done = runner().invoke(cli, [*words, "--out", str(tmp_path), "--figures", "none"])
    assert "g = (9.79 ± 0.23) m/s²" in done.output
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["title"] == "g = 4*pi**2*L/T**2"
    g = 4.0 * math.pi**2 * 0.85 / 1.851**2
    u = g * math.hypot(0.01 / 0.85, 2.0 * 0.003 / 1.851)
    assert (record["outputs"]["g"]["gum"]["value"], record["outputs"]["g"]["gum"]["u"]) == (
        pytest.approx((g, u), rel=1e-8)
    )


@pytest.mark.statistics
@pytest.mark.parametrize(("n", "tau"), [(2, 10.0), (4, 10.0), (8, 10.0), (8, 1.0)])
def test_hierarchical_interval_holds_whatever_the_dark_uncertainty(n, tau):
    """400 data sets; the weighted mean, which knows of no tau, must fail.  Without a tau, and with
    three times the stated uncertainty: tests/test_repeated_sampling.py.
    """
    rng = np.random.default_rng(int(100 * n + tau))
    holds = np.zeros(2)
    for _ in range(400):
        u = rng.uniform(0.5, 2.0, n)
        found = estim.mean(rng.normal(0.0, np.hypot(u, tau)), u).averages
        for i, name in enumerate(("hierarchical", "weighted")):
            holds[i] += found[name].low < 0.0 < found[name].high
    allowed = 4.0 * math.sqrt(0.05 * 0.95 / 400)  # standard errors
    assert holds[0] / 400 > 0.95 - allowed
    assert holds[1] / 400 < 0.95 - allowed
    if tau == 10.0 and n > 2:  # not by being endless
        assert holds[0] / 400 < 0.95 + allowed


@pytest.mark.statistics
def test_mean_of_groups_holds_and_that_of_all_readings_does_not():
    rng = np.random.default_rng(5)
    holds = np.zeros(2)
    days = np.repeat(np.arange(6), [3, 5, 2, 4, 6, 4])
    for _ in range(400):
        x = rng.normal(0.0, 1.0, days.size) + rng.normal(0.0, 1.0, 6)[days]
        found = estim.mean(x, groups=days).averages
        for i, name in enumerate(("groups", "readings")):
            holds[i] += found[name].low < 0.0 < found[name].high
    allowed = 4.0 * math.sqrt(0.05 * 0.95 / 400)
    assert abs(holds[0] / 400 - 0.95) < allowed
    assert holds[1] / 400 < 0.95 - allowed


def test_the_interval_of_the_dark_uncertainty_of_many_values_against_a_fine_grid(
    rng: np.random.Generator,
) -> None:
    x = rng.normal(0.0, 3.0, 300)
    posterior = hierarchical(x, np.ones(x.size))
    tau = np.linspace(1.5, 5.0, 100_001)
    # of equal u the mean is that of the values, whatever tau
    variance, squares = 1.0 + tau**2, float(np.sum((x - x.mean()) ** 2))
    log_p = np.log(tau) - 0.5 * (x.size + 1) * np.log(variance) - 0.5 * squares / variance
    below = np.cumsum(np.exp(log_p - log_p.max()))
    below, sd = below / below[-1], 3.0 / np.sqrt(2.0 * x.size)
    for p in (0.025, 0.16, 0.5, 0.84, 0.975):
        exact = np.interp(p, below, tau)
        assert posterior.tau_quantile(p) == pytest.approx(exact, abs=0.03 * sd)


def test_one_value_far_better_than_the_others_has_a_dark_uncertainty_by_moments() -> None:
    u = np.array([1e-9, 1.0, 1.0, 1.0])
    expected = np.sqrt((14.0 - 3.0) / (2.0 * 3.0))  # sum w - sum w^2/sum w is twice the others
    assert der_simonian_laird(np.arange(1.0, 5.0), u) == pytest.approx(expected, rel=1e-6)


def test_two_equal_values_are_no_sign_of_errors_that_are_too_large() -> None:
    assert "consistent" in estim.mean(["9.81(2)", "9.81(2)"]).reason
    assert "scatter less" in estim.mean(["9.81(2)"] * 12).reason


def test_a_column_of_values_with_their_uncertainties_has_its_name(tmp_path) -> None:
    table = tmp_path / "periods.csv"
    for cells in ("1.85(2)\n1.83(2)", "1.85 ± 0.02\n1.83 ± 0.02", "1,85(2)\n1,83(2)"):
        table.write_text(f"T (s)\n{cells}\n")
        assert mean_of_table(table).mean.best.value == pytest.approx(1.84)


def test_values_are_numbered_whole_in_the_figure(tmp_path) -> None:
    (tmp_path / "a.csv").write_text("g,u_g\n1,.1\n2,.1\n3,.1\n4,.1\n")
    figure = mean_figure(mean_of_table(tmp_path / "a.csv"))
    figure.draw_without_rendering()
    ticks = figure.axes[0].get_xticks()
    assert ticks.size > 2
    assert np.all(ticks % 1.0 == 0.0), ticks


@pytest.mark.parametrize(("last", "best"), [("4,.1", "hierarchical"), ("1.1,.1", "weighted")])
def test_the_recommended_mean_is_the_one_band_and_always_of_one_colour(
    tmp_path, last: str, best: str
) -> None:
    (tmp_path / "a.csv").write_text(f"g,u_g\n1,.1\n1.1,.1\n0.9,.1\n{last}\n")
    (ax,) = mean_figure(mean_of_table(tmp_path / "a.csv")).axes
    (band,) = ax.patches
    assert band.get_label() == f"{best}, 95 % (recommended)"
    assert to_hex(band.get_facecolor(), keep_alpha=True) == f"{PALE}ff".lower()


def test_a_mean_of_two_readings_has_one_degree_of_freedom(tmp_path) -> None:
    (tmp_path / "a.csv").write_text("g\n9.81\n9.79\n")
    told = mean_statement(mean_of_table(tmp_path / "a.csv"))
    assert told.startswith("mean: g = 9.80 ± 0.13, where"), told
    assert "with 1 effective degree of freedom for" in told


@pytest.mark.parametrize(
    ("first", "second", "told"),
    [
        ("9.81", "9.79", "0.02"),
        ("9.79 m/s²", "9.81 m/s²", "−0.02 m/s²"),
        ("1000000.1", "1", "999999.1"),
        ("1.73×10⁻⁵", "1.70×10⁻⁵", "3e-7"),
    ],
)
def test_exact_values_are_subtracted_to_the_decimals_given(first, second, told):
    with pytest.raises(InputError, match=f"has no uncertainty, .*: {told}$"):
        estim.compare_values(first, second)


def test_a_method_has_its_spanish_name(tmp_path):
    with spoken("es"):
        shown = estim.mean([1.0, 1.1, 1.2], 0.1).shown()
        line = estim.fit_line([1.0, 2.0, 3.0, 4.0], [1.0, 2.1, 2.9, 4.0], u_y=0.1).shown()
    assert shown.best == "ponderada"
    assert [row[0] for row in shown.rows][::4] == ["ponderada", "jerárquica"]
    assert shown.notes[0].startswith("Cite «ponderada»: ")
    assert [row[0] for row in line.rows] == ["propagados", "reescalados"]
