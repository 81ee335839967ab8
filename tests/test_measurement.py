"""`estim propagate`: files of measurement models against the numbers that are printed for them, and
what is refused.

Printed values and where they stand:
- JCGM 100:2008 (GUM): H.1 (l 838 nm, u 32 nm, 16 degrees of freedom, U99 93 nm; with the next order
  34 nm), H.2 (tables H.3, H.4).
- JCGM 101:2008 (GUM Supplement 1): 9.2 (tables 2-4), 9.3 (table 6), 9.4 (tables 7, 8), 9.5 (table
  11).
- JCGM 102:2011 (GUM Supplement 2): 9.2 (9.2.2, 9.2.4), 9.3 (tables 6, 7), 9.4 (9.4.2.2, 9.4.2.5).
- NIST TN 1900: E3, E11, E13 (Monte Carlo).   NPL report DEM-ES-011: table 9.2.
S1 9.3 and 9.5, S2 and TN 1900 are quoted at second hand, inputs too: a digit that surprises should
be looked up in the document.  The intervals of 9.4 are those of exact distributions, computed here
without a draw.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from command_runner import runner
from report_words import first_screen, words
from scipy import integrate, optimize, special, stats

from estim.cli.commands import cli
from estim.cli.terminal import exit_code
from estim.common import format_rounded
from estim.common.errors import InputError
from estim.measurement_model.input_tables import InputTable
from estim.measurement_model.model_file import _OutputTable, _TopTable, model_of_formula, read_model
from estim.measurement_model.propagating import ellipse, propagate
from estim.propagation import propagate_linear, propagate_monte_carlo
from estim.propagation.scores import Distribution
from estim.reports.measurement import distribution_figure, measurement_report, statement

GUM = Path(__file__).resolve().parents[1] / "data" / "gum"
FILES = sorted(path.stem for path in GUM.glob("*.toml"))


@cache
def done(name, draws=120_000):
    return propagate(
        replace(read_model(GUM / f"{name}.toml"), draws=draws), rng=np.random.default_rng(101)
    )


def printed(value, digit, found, error=0.0):
    """Whether `found` is `value` as printed, `digit` being half a unit of its last digit, within
    four Monte-Carlo errors.
    """
    return abs(float(found) - value) <= digit * (1 + 1e-9) + 4.0 * float(error)


def model(tmp_path, text):
    path = tmp_path / "model.toml"
    path.write_text(text)
    return path


def test_the_end_gauge_of_gum_h1():
    found = done("gum-h1-end-gauge")
    linear, budget = found.linear, found.budgets[0]
    assert (round(linear.value[0]), round(linear.u[0]), math.floor(linear.dof[0])) == (
        50_000_838,
        32,
        16,
    )
    assert round(found.second_order[0]) == 34  # H.1.7
    # H.1.6 multiplies by u rounded to 32; without that it is 92
    assert round(round(stats.t.ppf(0.995, 16), 2) * round(linear.u[0])) == 93
    d = [row.contribution for row in budget.rows if row.input.name.startswith("d:")]
    assert math.hypot(*d) == pytest.approx(9.7, abs=0.05)
    dof = round(math.hypot(*d), 1) ** 4 / math.fsum(
        c**4 / n for c, n in zip(sorted(d), (5, 24, 8), strict=True)
    )
    assert dof == pytest.approx(25.6, abs=0.05)
    contributions = {row.input.name: row.contribution for row in budget.rows}
    assert contributions["d_theta"] == pytest.approx(16.6, abs=0.05)
    assert contributions["d_alpha"] == pytest.approx(2.9, abs=0.05)


def test_the_impedance_of_gum_h2_and_its_readings_taken_together():
    found = done("gum-h2-impedance")
    r = found.model.correlation
    for pair, value in ((("V", "I"), -0.36), (("V", "phi"), 0.86), (("I", "phi"), -0.65)):
        assert printed(value, 0.005, r[pair])
    assert all(map(printed, (127.732, 219.847, 254.260), [0.0005] * 3, found.linear.value))
    # u(X) is 0.29558: the GUM cut it
    assert all(map(printed, (0.071, 0.295, 0.236), (0.0005, 0.001, 0.0005), found.linear.u))
    assert all(
        map(
            printed,
            (-0.588, -0.485, 0.993),
            [0.0005] * 3,
            [region.correlation[0] for region in found.regions],
        )
    )
    assert found.gum_holds.all()
    # Each output is nearly linear in one multivariate t: a t of 4 degrees of freedom; independent
    # scales would give R a narrower one.
    t = stats.t(4, found.linear.value, found.linear.u)
    assert np.all(
        np.abs(t.ppf(0.975) - found.sampled.symmetric.high)
        < 4 * found.sampled.symmetric.high_error + 0.002 * found.linear.u
    )
    assert (
        stats.kstest(
            found.sampled.draws[:20_000, 0],
            stats.t(4, found.linear.value[0], found.linear.u[0]).cdf,
        ).pvalue
        > 1e-3
    )
    apart = [
        replace(quantity, parts=(replace(quantity.parts[0], group=""),))
        for quantity in found.model.quantities
    ]
    narrower = propagate(
        replace(found.model, quantities=tuple(apart)), rng=np.random.default_rng(1)
    )
    assert (
        narrower.sampled.symmetric.high[0]
        < t.ppf(0.975)[0] - 5 * narrower.sampled.symmetric.high_error[0]
    )


@pytest.mark.parametrize(
    ("name", "u", "gum", "drawn", "digit", "valid"),
    [
        ("normal", 2.0, 3.92, 3.92, 0.005, True),
        ("rectangular", 2.0, 3.92, 3.88, 0.005, True),
        ("wide", 10.1, 19.9, 17.0, 0.05, False),
    ],
)
def test_additive_models_of_gum_s1_92(name, u, gum, drawn, digit, valid):
    found = done(f"s1-additive-{name}")
    interval = found.sampled.symmetric
    assert printed(u, 0.05, found.linear.u[0])
    assert printed(gum, digit, found.linear.high[0])
    assert printed(drawn, digit, interval.high[0], interval.high_error[0])
    assert found.validation.passes[0] == valid


def test_mass_calibration_of_gum_s1_93():
    found = done("s1-mass", 200_000)
    drawn, interval = found.sampled, found.sampled.shortest
    assert (
        format_rounded(found.linear.value[0], 0.05, 3),
        format_rounded(found.linear.u[0], 0.05, 3),
    ) == ("1.2340", "0.0539")
    assert printed(1.1285, 0.0001, found.linear.low[0])  # from u rounded to 0.0539
    assert printed(1.3395, 0.0001, found.linear.high[0])
    assert printed(0.0750, 0.00005, found.second_order[0])
    assert printed(
        1.0870, 0.0001, found.linear.value[0] - found.linear.k[0] * found.second_order[0]
    )
    assert printed(
        1.3810, 0.0001, found.linear.value[0] + found.linear.k[0] * found.second_order[0]
    )
    assert printed(1.2341, 0.00005, drawn.mean[0], drawn.mean_error[0])
    assert printed(0.0754, 0.00005, drawn.u[0], drawn.u_error[0])
    # theirs are draws too
    assert printed(
        1.0834, 0.00005, interval.low[0], math.hypot(interval.low_error[0], interval.low_error[0])
    )
    assert printed(
        1.3825,
        0.00005,
        interval.high[0],
        math.hypot(interval.high_error[0], interval.high_error[0]),
    )
    assert found.validation.status == "invalid"


def sum_of_squares(x1, r):
    """Density of 1e6 (X1^2 + X2^2), X normal about (x1, 0) with u 0.005 and correlation r:
    eigenvalues, then an integral over an angle.
    """
    sd = 0.005 * np.sqrt([1.0 + r, 1.0 - r])
    mean = x1 / math.sqrt(2.0) * np.array([1.0, 1.0])

    def density(y):
        radius = 1e-3 * math.sqrt(max(y, 0.0))

        def along(angle):
            at = radius * np.array([math.cos(angle), math.sin(angle)])
            return float(np.prod(stats.norm.pdf(at, mean, sd)))

        return (
            0.5e-6
            * integrate.quad(
                along, 0.0, 2.0 * math.pi, limit=60, epsrel=1e-5, points=[0.25 * math.pi]
            )[0]
        )

    return density


@pytest.mark.parametrize(
    ("name", "x1", "r", "gum_u", "second", "mean", "u"),
    [
        ("0", 0.0, 0.0, 0, 50, 50, 50),
        ("10", 0.01, 0.0, 100, 112, 150, 112),
        ("50", 0.05, 0.0, 500, 502, 2550, 502),
        ("0r", 0.0, 0.9, 0, None, 50, 67),
        ("10r", 0.01, 0.9, 100, None, 150, 121),
        ("50r", 0.05, 0.9, 500, None, 2551, 505),
    ],
)
def test_comparison_loss_of_gum_s1_94(name, x1, r, gum_u, second, mean, u):
    found = done(f"s1-comparison-loss-{name}")
    drawn = found.sampled
    assert printed(gum_u, 0.5, found.linear.u[0])
    assert (
        found.second_order is None
        if second is None
        else printed(second, 0.5, found.second_order[0])
    )
    assert printed(mean, 1.0, drawn.mean[0], drawn.mean_error[0])
    assert printed(u, 1.0, drawn.u[0], drawn.u_error[0])
    assert not found.gum_holds[0]
    if name == "10r":
        density = sum_of_squares(x1, r)
        low, high = float(drawn.shortest.low[0]), float(drawn.shortest.high[0])
        inside = integrate.quad(density, low, high, limit=60, epsrel=1e-5)[0]
        # least length: a little less inside
        assert inside == pytest.approx(0.95, abs=4.0 * math.sqrt(0.95 * 0.05 / drawn.n_draw) + 5e-4)
        if low > 1.0:  # away from the edge at 0 the density is the same at both ends
            assert density(low) == pytest.approx(density(high), rel=0.15)


def test_gauge_block_of_gum_s1_95():
    found = done("s1-gauge-block")
    drawn, interval = found.sampled, found.sampled.shortest
    assert (
        round(found.linear.value[0]),
        round(found.linear.u[0]),
        round(found.second_order[0]),
    ) == (838, 32, 34)
    assert printed(838, 0.5, drawn.mean[0], drawn.mean_error[0])
    assert printed(36, 0.5, drawn.u[0], drawn.u_error[0])
    assert printed(745, 0.5, interval.low[0], interval.low_error[0])
    assert printed(932, 0.5, interval.high[0], interval.high_error[0])


@pytest.mark.parametrize(("name", "variance", "r"), [("1", 2.0, 0.5), ("3", 10.0, 0.9)])
def test_sums_with_a_common_term_of_gum_s2_92(name, variance, r):
    found = done(f"s2-additive-{name}")
    assert found.linear.u**2 == pytest.approx([variance, variance])
    assert found.regions[0].correlation[0] == pytest.approx(r)
    assert np.corrcoef(found.sampled.draws.T)[0, 1] == pytest.approx(
        r, abs=4.0 * (1.0 - r * r) / math.sqrt(len(found.sampled.draws))
    )
    assert np.all(np.abs(found.sampled.u - math.sqrt(variance)) < 4.0 * found.sampled.u_error)


def test_six_sets_of_readings_of_gum_s2_94():
    """S2 gives n sets of N readings a t of n - N = 3 degrees of freedom (5.3.2), estim by default
    one of n - 1 = 5: sds apart by sqrt(3).
    """
    found = done("s2-impedance")
    # R is 127.7307 from the readings
    assert all(
        map(printed, (127.732, 219.847, 254.260), (0.0015, 0.0005, 0.0005), found.linear.value)
    )
    assert all(map(printed, (0.058, 0.241, 0.193), [0.0005] * 3, found.linear.u))
    r = [region.correlation[0] for region in found.regions]
    assert all(map(printed, (-0.588, -0.485, 0.993), [0.0005] * 3, r))
    assert printed(0.00749, 0.000005, 1.0 - r[2])
    assert all(one.dof == 5.0 and one.drawn_dof == 3.0 for one in found.model.inputs)
    # the draws' own u settles slowly: no fourth moment
    wider = {one.standard_deviation / one.u for one in found.model.inputs}
    assert all(map(printed, (0.130, 0.540, 0.431), [0.0006] * 3, max(wider) * found.linear.u))
    assert max(wider) - min(wider) < 1e-12
    interval = found.sampled.symmetric
    at_975 = stats.t(3).ppf(0.975) * math.sqrt(5.0 / 3.0) * found.linear.u
    assert np.all(
        np.abs(interval.high - found.linear.value - at_975)
        < 5.0 * interval.high_error + 0.002 * found.linear.u
    )
    own = [
        replace(quantity, parts=(replace(quantity.parts[0], joint_dof=0.0),))
        for quantity in found.model.quantities
    ]
    default = propagate(
        replace(found.model, quantities=tuple(own)), rng=np.random.default_rng(1)
    ).sampled.symmetric
    assert np.all(default.high < interval.high - 20.0 * interval.high_error)
    narrow = stats.t(5).ppf(0.975) * found.linear.u
    assert np.all(
        np.abs(default.high - found.linear.value - narrow)
        < 5.0 * default.high_error + 0.002 * found.linear.u
    )


@pytest.mark.parametrize(
    ("name", "gum", "modulus", "phase"),
    [
        ("1", (0.001, 0.010, 10.0), (0.013, 0.007), (0.0, 1.744)),
        ("1r", (0.001, 0.010, 10.0), (0.012, 0.008), (-0.556, 1.599)),
        ("10r", (0.010, 0.010, 1.0), (0.015, 0.008), (-0.343, 0.903)),
    ],
)
def test_modulus_and_phase_of_gum_s2_93(name, gum, modulus, phase):
    found = done(f"s2-polar-{name}")
    drawn = found.sampled
    assert (found.linear.value[0], *found.linear.u) == pytest.approx(gum)
    for i, (mean, u) in enumerate((modulus, phase)):
        assert printed(mean, 0.001, drawn.mean[i], drawn.mean_error[i])
        assert printed(u, 0.001, drawn.u[i], drawn.u_error[i])
    assert found.regions[0].coverage < 0.97
    assert not found.gum_holds.any()


def test_examples_of_nist_tn_1900():
    e3, e11, e13 = (
        done(f"tn1900-{name}") for name in ("e3-viscometer", "e11-attenuator", "e13-expansion")
    )
    for found, mean, u, low, high, digit in (
        (e3, 5.82, 1.11, 4.05, 8.39, 0.01),
        (e11, 30.043, 0.0224, 30.006, 30.081, 0.0005),
    ):
        drawn = found.sampled
        assert printed(mean, digit, drawn.mean[0], drawn.mean_error[0])
        assert printed(u, 0.5 * digit if found is e3 else 0.00005, drawn.u[0], drawn.u_error[0])
        assert printed(low, digit, drawn.symmetric.low[0], drawn.symmetric.low_error[0])
        assert printed(high, digit, drawn.symmetric.high[0], drawn.symmetric.high_error[0])
    assert printed(1.7266e-5, 0.00005e-5, e13.linear.value[0])
    assert printed(1.76e-6, 0.005e-6, e13.linear.u[0])
    # a t of 3 degrees of freedom has no fourth moment
    assert printed(1.74e-6, 0.02e-6, e13.sampled.u[0], e13.sampled.u_error[0])


def test_logarithm_of_a_rectangular_quantity():
    found = done("npl-logarithm")
    assert (
        format_rounded(found.linear.value[0], 0.4, 3),
        format_rounded(found.linear.u[0], 0.4, 3),
    ) == ("−0.511", "0.481")
    assert printed(-0.665, 0.0005, found.sampled.mean[0], found.sampled.mean_error[0])
    assert printed(0.606, 0.0005, found.sampled.u[0], found.sampled.u_error[0])
    assert printed(
        0.095, 0.0005, found.sampled.shortest.high[0], found.sampled.shortest.high_error[0]
    )


def test_terms_of_the_next_order_are_those_of_a_polynomial(tmp_path):
    """y = a b + a^3 for normal a, b: the exact variance minus its terms of third order (15 u^6)."""
    text = (
        'title = "t"\n[measurand]\nformula = "a*b + a**3"\n[inputs]\na = {value = 0.5, u = '
        "0.1}\nb = {value = 2.0, u = 0.3}\n"
    )
    found = propagate(
        replace(read_model(model(tmp_path, text)), draws=20_000), rng=np.random.default_rng(1)
    )
    a, b, ua, ub = 0.5, 2.0, 0.1, 0.3
    first = (b + 3 * a**2) ** 2 * ua**2 + a**2 * ub**2
    second = (0.5 * (6 * a) ** 2 + (b + 3 * a**2) * 6.0) * ua**4 + ua**2 * ub**2
    assert found.second_order[0] ** 2 == pytest.approx(first + second, rel=1e-12)
    assert found.linear.u[0] ** 2 == pytest.approx(first, rel=1e-9)


def test_regions_of_a_normal_pair_are_those_of_the_bivariate_normal(tmp_path):
    text = (
        'title = "t"\n[measurand.p]\nformula = "a + c"\n[measurand.q]\nformula = "b + '
        'c"\n[inputs]\n'
    )
    text += "".join(f"{name} = {{value = 0, u = 1}}\n" for name in "abc")
    found = propagate(
        replace(read_model(model(tmp_path, text)), draws=400_000), rng=np.random.default_rng(2)
    )
    region = found.regions[0]
    assert region.correlation == pytest.approx((0.5, 0.5), abs=0.006)
    assert region.k_ellipse == pytest.approx(math.sqrt(-2.0 * math.log(0.05)))
    assert region.k_drawn == pytest.approx(region.k_ellipse, abs=0.02)
    assert region.coverage == pytest.approx(0.95, abs=4.0 * math.sqrt(0.95 * 0.05 / 4e5))

    def held(k):  # P(|p| < k, |q| < k) at r = 1/2, by an integral over p
        def inner(x):
            within = np.diff(special.ndtr((np.array([-k, k]) - 0.5 * x) / math.sqrt(0.75)))[0]
            return stats.norm.pdf(x) * within

        return integrate.quad(inner, -k, k)[0]

    assert region.k_rectangle_drawn == pytest.approx(
        optimize.brentq(lambda k: held(k) - 0.95, 1.5, 3.0), abs=0.015
    )
    assert held(region.k_rectangle) > 0.95
    ring = ellipse(region.value, region.covariance, region.k_ellipse) - region.value[:, None]
    np.testing.assert_allclose(
        np.sum(ring * np.linalg.solve(region.covariance, ring), axis=0), region.k_ellipse**2
    )


def test_without_a_number_of_draws_there_are_as_many_as_the_answer_takes(tmp_path):
    text = (
        'title = "t"\n[measurand]\nformula = "a + b"\n[inputs]\na = {value = 0, u = 1}\nb = '
        '{value = 0, u = 1, distribution = "rectangular"}\n'
    )
    found = propagate(read_model(model(tmp_path, text)), rng=np.random.default_rng(3))
    assert found.validation.decided.all()
    assert found.sampled.n_draw >= 100_000


def command(*arguments):
    return runner().invoke(cli, [str(one) for one in arguments])


def test_the_command_writes_report_figures_and_record(tmp_path):
    folder = tmp_path / "out"
    quick = (GUM / "s1-mass.toml").read_text().replace("draws = 1000000", "draws = 100000")
    result = command("propagate", model(tmp_path, quick), "--out", folder)
    assert result.exit_code == 0, result.output
    assert "dm = 1.234 mg with standard uncertainty u = 0.07" in result.output
    text = (folder / "report.md").read_text()
    assert "figures/distribution.png" in first_screen(text)
    assert len(words(first_screen(text))) < 120
    for cell in (
        "1.2340 | 0.0539",
        "[1.1285, 1.3395]",
        "0.0750",
        "GUM interval is not valid: use the Monte Carlo",
        "kg/m³",
    ):
        assert cell in text, cell
    assert {path.name for path in (folder / "figures").iterdir()} == {
        "distribution.png",
        "budget.png",
    }
    record = json.loads((folder / "result.json").read_text())
    assert (record["schema"], record["status"]) == ("estim-propagation/1", "ok")
    assert record["outputs"]["dm"]["quoted"] == "Monte Carlo"
    assert sum(row["share"] for row in record["outputs"]["dm"]["budget"]) == pytest.approx(100.0)


def test_a_budget_beside_a_larger_uncertainty_says_that_it_is_of_first_order(tmp_path):
    """At a maximum a sine has no slope: its share is 0 % of an uncertainty that it makes.  Draws of
    few readings scatter more than the GUM says of a straight model, too, and its budget is right.
    """
    told = (
        "This budget is of first order: with it u = 0.00100, with the terms of the next order 0.06"
    )
    readings = "[measurand]\nname = 'y'\nformula = '2*t'\n[inputs.t]\nreadings = [1, 1.1, 0.9, 1]\n"
    folder = tmp_path / "readings"
    result = command("propagate", model(tmp_path, readings), "--figures", "none", "--out", folder)
    assert result.exit_code == 0, result.output
    one = json.loads((folder / "result.json").read_text())["outputs"]["y"]
    assert one["monte_carlo"]["u"] > 1.5 * one["gum"]["u"]
    assert "of first order" not in (folder / "report.md").read_text()
    for value, expected in (("1.5707963(3000000)", True), ("0.300(1)", False)):
        folder = tmp_path / str(expected)
        result = command(
            "propagate",
            "y = sin(t) + g",
            f"t={value}",
            "g=1.000(1)",
            "--figures",
            "none",
            "--out",
            folder,
        )
        assert result.exit_code == 0, result.output
        assert (told in (folder / "report.md").read_text()) == expected


def test_the_example_of_the_docs_says_what_they_say(tmp_path, project):
    page = (project / "docs" / "propagation.md").read_text()
    toml, said = re.search(r"```toml\n(title.*?)```.*? says\n\n(.*?)\n\n", page, re.S).groups()
    result = command(
        "propagate", model(tmp_path, toml), "--out", tmp_path / "out", "--figures", "none"
    )
    assert " ".join(said.split()) == result.output.splitlines()[0]
    assert "| 47.2 | 2.01 | 0.00000546 |" in (tmp_path / "out" / "report.md").read_text()


def test_every_key_stands_in_the_docs(project):
    page = (project / "docs" / "propagation.md").read_text()
    tables = (_TopTable, _OutputTable, InputTable)
    keys = {key for table in tables for key in table.__struct_fields__}
    assert {key for key in keys if not re.search(rf"[`\[ ]{key}\b", page)} == set()
    assert {kind for kind in get_args(Distribution) if f"`{kind}`" not in page} == set()


@pytest.mark.parametrize("name", FILES)
def test_every_example_is_read_and_reported_without_figures(name):
    found = done(name, 20_000)
    text = (
        measurement_report(found, seed=1, figures="none")["report.md"]
        .decode()
        .replace("\u00a0", " ")
    )
    assert "figures/" not in text
    assert text.startswith("# ")


def test_draws_without_a_value_leave_nothing_to_quote(tmp_path):
    text = 'title = "t"\n[measurand]\nformula = "sqrt(a)"\n[inputs]\na = {value = 1.0, u = 0.5}\n'
    path = model(tmp_path, text.replace('title = "t"', 'title = "t"\ndraws = 20000'))
    result = command("propagate", path, "--out", tmp_path / "out", "--figures", "none")
    assert (
        exit_code(
            lambda: cli.main(
                ["propagate", str(path), "--out", str(tmp_path / "out"), "--figures", "none"],
                standalone_mode=False,
            )
        )
        == 3
    )
    assert "y: not-identified" in result.output
    assert "give no finite value" in result.output
    assert "an output has no valid interval" in (tmp_path / "out" / "report.md").read_text()


def test_an_input_is_stated_in_a_file_as_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "g.toml"
    path.write_text(
        '[measurand]\nname = "g"\nformula = "4*pi**2*L/T**2"\n[inputs]\nL = "0.85(1) m"\n'
        'T = "1.851 ± 0.003 s"\n'
    )
    given = {"L": "0.85(1) m", "T": "1.851(3) s"}
    stated, typed = read_model(path), model_of_formula("g = 4*pi**2*L/T**2", given)
    assert [*map(vars, stated.inputs)] == [*map(vars, typed.inputs)]
    assert stated.outputs[0].unit == typed.outputs[0].unit == "m/s²"
    path.write_text('[measurand]\nformula = "2*a + b"\n[inputs]\na = 1.5\nb = "2(1)"\n')
    assert [(part.value, part.u) for part in read_model(path).inputs] == [(1.5, 0.0), (2.0, 1.0)]


HEAD = 'title = "t"\n[measurand]\nformula = "a*b"\n[inputs]\nb = {value = 1, u = 0.1}\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "a = [1]\n", ":6: 'a' must be a value, as \"0.85(1) m\", or a table, as {value ="),
        (HEAD + "a = true\n", ":6: 'a' must be a value, as \"0.85(1) m\", or a table, as {value ="),
        (HEAD + 'a = "1.0(1) qm"\n', ":6: 'a' must have a known unit after its number, such as"),
        (
            'simultaneous = [["a", "b"]]\n'
            + HEAD.replace("{value = 1, u = 0.1}", "{readings = [1, 2, 3]}")
            + "a = {readings = [0.1, 0.1, 0.1], components = {r = {half_width = 0.05}}}\n",
            ":1: 'simultaneous' must name inputs whose readings scatter",
        ),
        (
            HEAD + "a = {readings = [1.1, 1.1, 1.1]}\n",
            ":6: 'readings' are all the same, so that their scatter tells no uncertainty",
        ),
        (
            HEAD + "a = {value = 0, u_percent = 5}\n",
            ":6: 'u_percent' is undefined if the value is 0: state u",
        ),
        (
            HEAD + "a = {value = 0, components = {p = {u_percent = 5}}}\n",
            ":6: 'u_percent' is undefined if the value is 0: state u",
        ),
        (
            HEAD + "a = {value = 1, u = -1}\n",
            ":6: 'u' must be > 0 (leave it out for an exact value): -1",
        ),
        (
            HEAD + "a = {value = 1, u = 0.1, half_width = 2}\n",
            ":6: 'half_width' does not go with 'u': state the uncertainty once",
        ),
        (HEAD + "a = {value = 1, U = 0.1}\n", ":6: 'k' requires 'U', an expanded uncertainty"),
        (
            HEAD + 'a = {value = 1, u = 0.1, distribution = "gauss"}\n',
            ":6: 'distribution' must be one of normal, rectangular",
        ),
        (
            HEAD + 'a = {value = 1, u = 0.1, distribution = "t"}\n',
            ":6: 'dof' must be finite for the t distribution",
        ),
        (
            HEAD + 'a = {value = "1.0(1)", u = 0.1}\n',
            ":6: 'u' does not go with 'value': an uncertainty stands in 'value' already",
        ),
        (HEAD + "a = {low = 2, high = 1}\n", ":6: 'low' requires 'high' and must be smaller"),
        (HEAD + "a = {readings = [1.0]}\n", ":6: 'readings' must be a list of at least two"),
        (HEAD + "a = {value = 1}\nc = {value = 1}\n", ":7: 'inputs.c' is in no formula"),
        (
            HEAD.replace("a*b", "a*bb") + "a = {value = 1}\n",
            ":3: 'formula' names no input and no measurand above it (did you mean 'b'?): bb",
        ),
        (
            HEAD.replace("a*b", "open(a)") + "a = {value = 1}\n",
            ":3: 'formula' calls 'open', which is not a known function",
        ),
        (
            HEAD + "a = {value = 1, uu = 1}\n",
            ":6: 'uu' is not a known key here (did you mean 'u'?)",
        ),
        (
            HEAD + 'a = {value = 1}\n[[correlations]]\nbetween = ["a", "b"]\nr = 0.5\n',
            ":8: 'between' must name inputs with an uncertainty",
        ),
        (
            HEAD + 'a = {value = 1, u = 1}\n[[correlations]]\nbetween = ["a", "b"]\nr = 1.5\n',
            ":9: 'r' must be >= -1 and <= 1: 1.5",
        ),
        (
            'simultaneous = [["a", "b"]]\n' + HEAD + "a = {readings = [1, 2]}\n",
            ":1: 'simultaneous' must name inputs that are given by readings: b",
        ),
        (
            'simultaneous_dof = "n - N"\n' + HEAD + "a = {readings = [1, 2]}\n",
            ":1: 'simultaneous_dof' needs 'simultaneous': n - N",
        ),
        (
            'simultaneous_dof = "n"\n' + HEAD + "a = {readings = [1, 2]}\n",
            ":1: 'simultaneous_dof' ",
        ),
        (
            'simultaneous = [["a", "b"]]\nsimultaneous_dof = "n - N"\n'
            + HEAD[: HEAD.index("b =")]
            + "a = {readings = [1, 2]}\nb = {readings = [1, 3]}\n",
            ":2: 'simultaneous_dof' needs more sets of readings than inputs, here 2 sets of 2",
        ),
        (
            HEAD.replace("formula", 'name = "pi"\nformula') + "a = {value = 1}\n",
            ":3: 'name' must be letters, digits and _",
        ),
        (
            "probability = 1.5\n" + HEAD + "a = {value = 1}\n",
            ":1: 'probability' must be >= 0.5 and <= 0.9999: 1.5",
        ),
        (HEAD + "a = {value = 1, components = {p = {u = -1}}}\n", ":6: 'u' must be > 0"),
    ],
)
def test_a_mistake_in_a_model_is_told_with_its_line(tmp_path, text, message):
    path = model(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_model(path)
    assert str(caught.value).startswith(f"{path}{message}"), str(caught.value)


def _of(tmp_path, value, formula):
    return model(
        tmp_path,
        f'title = "t"\n[inputs.a]\nvalue = "{value}"\n[measurand]\nname = "y"\nformula = '
        f'"{formula}"\n',
    )


@pytest.mark.parametrize("power", ["1", "1.5", "-1"])
@pytest.mark.parametrize("exponent", [-99, -60, 60, 99])
def test_very_large_and_very_small_quantities_have_the_uncertainties_of_plain_ones(
    tmp_path, power, exponent
):
    models = [read_model(_of(tmp_path, f"1.0(1)e{e}", f"a**({power})")) for e in (0, exponent)]
    plain, other = (
        propagate(replace(one, draws=20_000), rng=np.random.default_rng(1)) for one in models
    )
    scale = 10.0 ** (exponent * float(power))
    for found, expected in (
        (other.linear.u, plain.linear.u),
        (other.sampled.u, plain.sampled.u),
        (other.interval.low, plain.interval.low),
        (other.interval.high, plain.interval.high),
    ):
        assert found / scale == pytest.approx(expected, rel=1e-6)
    expected = plain.second_order if abs(exponent) < 75 else [math.nan]
    assert other.second_order / scale == pytest.approx(expected, rel=1e-6, nan_ok=True)


@pytest.mark.parametrize(
    ("value", "formula"),
    [
        ("1.0(1)e99", "a**2"),
        ("1.0(1)e-99", "a**2"),
        ("1.0(1)e-99", "a**3"),
        ("1.0(1)e99", "a*1e200"),
    ],
)
def test_a_result_whose_square_is_no_number_is_refused_in_one_line(
    tmp_path, value, formula, capsys
):
    path = _of(tmp_path, value, formula)
    arguments = ["propagate", str(path), "--out", str(tmp_path / "out"), "--figures", "none"]
    assert exit_code(lambda: cli.main(arguments, standalone_mode=False)) == 2
    said = capsys.readouterr().err.strip()
    assert (
        "'result' and its uncertainty must be 0 or between 1e-150 and 1e+150 in size: "
        "choose other units" in said
    )
    assert "\n" not in said
    read = read_model(path)
    for way in (
        propagate_linear,
        partial(propagate_monte_carlo, rng=np.random.default_rng(1), n_draw=10_000),
    ):
        with pytest.raises(InputError, match="choose other units"):
            way(read.values, read.inputs)


def test_draws_in_two_separate_groups_are_told(rng):
    """An angle at the cut of arctan2: 0.0 with u = 3.1 is a value that never occurs.  The square of
    a value about 0, and one with long tails, have one group.
    """
    for formula, inputs, groups in (
        ("y=arctan2(a,b)", {"a": "0.0(1)", "b": "-1.0(1)"}, True),
        ("y=a^2", {"a": "0.0(1)"}, False),
        ("y=exp(3*a)", {"a": "0.0(5)"}, False),
    ):
        few = replace(model_of_formula(formula, inputs), draws=10_000)
        said = statement(propagate(few, rng=rng), 0)
        assert said[:4] in ("", "y = ")  # a name without a meaning is not told twice
        assert ("in two separate groups, up to −" in said) == groups
        assert ("two separate groups" in said) == groups


def test_the_histogram_of_the_draws_goes_as_far_as_the_curve_and_the_frame(rng) -> None:
    model = replace(model_of_formula("y=a^2", {"a": "3.0(5)"}), draws=10_000)
    (ax,) = distribution_figure(propagate(model, rng=rng)).axes
    edges = ax.patches[0].get_data().edges
    curve = max(ax.lines, key=lambda line: len(line.get_xdata())).get_xdata()
    for ends in (edges, curve):
        assert (ends[0], ends[-1]) == pytest.approx(ax.get_xlim())
