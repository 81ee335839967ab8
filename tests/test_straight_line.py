"""`estim line FILE.csv`: any points, against printed lines (headers of tests/reference/lines) and
brute force.

- ISO/TS 28037:2010, 6.3 (both examples, p. 13 and 15), 7.4 (p. 21), annex E (p. 58-59) and 11.1
  (inverse prediction), by way of GTC's manual.
- York et al. 2004 with Pearson's data.   Hogg, Bovy, Lang, arXiv 1008.4686: exercise 1, points 5 to
  20.
- GUM (JCGM 100:2008), H.3.4: prediction of a thermometer's correction at 30 °C.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner
from scipy import stats

from estim.campaign import TableChoices, campaign_of_table
from estim.cli.commands import cli
from estim.common.errors import InputError
from estim.common.quantity_text import Quantity
from estim.common.statuses import Status
from estim.line.table_line import LineColumns, straight_line
from estim.reports.straight_line import straight_line_figure

REFERENCE = Path(__file__).resolve().parent / "reference"
LINES = REFERENCE / "lines"


def told(tmp_path, *arguments):
    result = runner().invoke(
        cli, ["line", *map(str, arguments), "--out", str(tmp_path / "out"), "--figures", "none"]
    )
    return result, tmp_path / "out"


@pytest.mark.parametrize(
    ("name", "y0", "a", "b", "cov", "x0", "u_x0"),
    [
        (
            "equal",
            Quantity(10.5, 0.5),
            (1.866667, 0.4654747),
            (1.757143, 0.1195229),
            -0.050,
            4.913,
            0.322,
        ),
        (
            "unequal",
            Quantity(10.5, 1.0),
            (0.8852, 0.5297081),
            (2.0570, 0.1778920),
            -0.08227848,
            4.674,
            0.533,
        ),
    ],
)
def test_lines_and_inverse_predictions_of_iso_28037(name, y0, a, b, cov, x0, u_x0):
    line = straight_line(LINES / f"iso28037_sec6_{name}_weights.csv", LineColumns(), inverse=[y0])
    error = line.fit.standard_errors["propagated"]
    assert (line.fit.intercept, error.u_intercept) == pytest.approx(a, abs=5e-5)
    assert (line.fit.slope, error.u_slope) == pytest.approx(b, abs=5e-5)
    assert error.cov == pytest.approx(cov, rel=2e-5)
    assert (line.inverses[0].value, line.inverses[0].u) == pytest.approx((x0, u_x0), abs=0.0006)
    assert line.status is Status.OK


def test_errors_in_both_variables_of_iso_28037():
    """7.4 prints York's convention; the propagated uncertainties are those that GTC 2 (MSL) gives
    for the same points.
    """
    line = straight_line(LINES / "iso28037_sec7_errors_in_both.csv", LineColumns())
    york, whole = line.fit.standard_errors["york"], line.fit.standard_errors["propagated"]
    assert (line.fit.intercept, line.fit.slope, line.fit.chi2) == pytest.approx(
        (0.5788, 2.1597, 2.743), abs=5e-4
    )
    assert (york.u_intercept, york.u_slope, york.cov) == pytest.approx(
        (0.4764, 0.1355, -0.0577), abs=5e-5
    )
    assert (whole.u_intercept, whole.u_slope, whole.cov) == pytest.approx(
        (0.480359046511757, 0.136246483136605, -0.0586143419560877), rel=1e-8
    )
    assert line.fit.recommended == "propagated"


def test_unknown_uncertainties_of_y_of_iso_28037():
    """Annex E, before its factor sqrt((m - 2)/(m - 4)) = 1.41, which stands for degrees of freedom
    that estim states instead.
    """
    line = straight_line(LINES / "iso28037_annex_e.csv", LineColumns())
    error = line.fit.standard_errors["scaled"]
    assert (line.fit.intercept, error.u_intercept) == pytest.approx((1.172, 0.159), abs=5e-4)
    assert (line.fit.slope, error.u_slope) == pytest.approx((1.964, 0.041), abs=5e-4)
    assert error.cov == pytest.approx(-0.006, abs=5e-4)
    assert line.fit.dof == 4


def test_columns_by_name_give_yorks_line_and_other_columns_are_left_unread(tmp_path):
    table = np.genfromtxt(LINES / "pearson_york.csv", delimiter=",", skip_header=2)
    rows = [
        f"{x},point {i},{1 / math.sqrt(wx)},{y},{1 / math.sqrt(wy)}"
        for i, (x, y, wx, wy) in enumerate(table)
    ]
    path = tmp_path / "points.csv"
    path.write_text("t,label,sd t,s,sd s\n" + "\n".join(rows) + "\n")
    result, folder = told(
        tmp_path,
        path,
        "--x",
        "t",
        "--y",
        "s",
        "--ux",
        "sd t",
        "--uy",
        "sd s",
        "--predict",
        "5.0(1)",
    )
    assert result.exit_code == 0, result.output
    record = json.loads((folder / "result.json").read_text())
    assert (record["intercept"], record["slope"], record["chi2"]) == pytest.approx(
        (5.47991022403, -0.48053340745, 11.8663531941), rel=1e-9
    )
    assert record["standard_errors"]["york"][:2] == pytest.approx(
        [0.294970735, 0.0579850090], rel=1e-7
    )
    ua, ub, cov = record["standard_errors"]["propagated"]
    predicted = record["predictions"][0]
    assert predicted["value"] == pytest.approx(5.47991022403 - 5.0 * 0.48053340745)
    assert predicted["u"] ** 2 == pytest.approx(
        ua**2 + 25 * ub**2 + 10 * cov + (0.1 * 0.48053340745) ** 2
    )
    text = (folder / "report.md").read_text()
    assert "York: errors in both variables (u(x) from sd t, u(y) from sd s)" in text
    assert text.startswith("# s against t: a straight line")


def test_columns_of_uncertainties_are_found_before_their_unit_and_must_have_that_of_their_column(
    tmp_path,
):
    path = tmp_path / "points.csv"
    rows = "".join(
        f"{x},{y},0.1,0.2\n" for x, y in ((0, 1.0), (1, 2.1), (2, 2.9), (3, 4.1), (4, 5.0))
    )
    path.write_text("t [s],s [m],u_t [s],u_s [m]\n" + rows)
    line = straight_line(path, LineColumns("t", "s"))
    assert (line.columns.u_x, line.columns.u_y, line.fit.method) == ("u_t", "u_s", "york")
    path.write_text("t [s],s [m],u_t [s],u_s [mm]\n" + rows)
    with pytest.raises(InputError, match=r"points\.csv:1: 'u_s' must be in the unit of 's', m"):
        straight_line(path, LineColumns("t", "s"))
    with pytest.raises(InputError, match="must be in the unit"):
        straight_line(path, LineColumns("t", "s", u_y="u_s"))
    assert straight_line(path, LineColumns("t", "s", u_y="0.2")).fit.method == "york"


def test_hoggs_line_by_uncertainties_of_y(tmp_path):
    lines = (LINES / "hogg_bovy_lang_2010_table1.csv").read_text().splitlines()
    path = tmp_path / "hogg.csv"
    path.write_text("\n".join(lines[:2] + lines[6:]) + "\n")
    line = straight_line(path, LineColumns(u_y="sigma_y"))
    error = line.fit.standard_errors["propagated"]
    assert (line.fit.intercept, error.u_intercept, line.fit.slope, error.u_slope) == pytest.approx(
        (34.04773, 18.24617, 2.23992, 0.10778), abs=6e-6
    )
    both = straight_line(path, LineColumns(u_x="sigma_x", u_y="sigma_y", r_xy="rho_xy"))
    assert (both.fit.method, both.columns.r_xy) == ("york", "rho_xy")


def test_a_prediction_names_its_place_with_all_digits(tmp_path):
    path = tmp_path / "far.csv"
    path.write_text("x,y\n1000000001,1\n1000000002,2.1\n1000000003,2.9\n1000000006,5.9\n")
    arguments = ["--predict", "1000000005", "--figures", "none", "--out", str(tmp_path / "out")]
    result = runner().invoke(cli, ["line", str(path), *arguments])
    assert "x = 1000000005: y = 4.9" in result.output
    assert "| 1000000005 | 4.9" in (tmp_path / "out" / "report.md").read_text()


def test_prediction_of_gum_h3(tmp_path):
    rows = [
        line
        for line in (REFERENCE / "gum" / "gum_h3_table_h6.csv").read_text().splitlines()
        if not line.startswith("#")
    ]
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]])
    path = tmp_path / "thermometer.csv"
    path.write_text(
        "x,y\n"
        + "".join(
            f"{t - 20.0!r},{b!r}\n"
            for t, b in zip(table[:, -2].tolist(), table[:, -1].tolist(), strict=True)
        )
    )
    line = straight_line(path, LineColumns(), predict=[Quantity(10.0)])
    point = line.predictions[0]
    assert (round(point.value, 4), round(point.u, 4)) == (-0.1494, 0.0041)
    assert line.k == pytest.approx(stats.t.ppf(0.975, 9))


def test_fiellers_interval_is_the_set_of_lines_that_explain_the_reading(tmp_path, rng):
    """Of a slope known to 14 %: by brute force over abscissas; and it holds the truth where the
    linear one is lopsided.
    """
    x = np.array([1.0, 2.0, 3.0, 4.0])
    y = 0.5 + 0.8 * x + 0.25 * rng.standard_normal(4)
    path = tmp_path / "p.csv"
    path.write_text(
        "x,y,u_y\n"
        + "".join(f"{a!r},{b!r},0.25\n" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    )
    line = straight_line(path, LineColumns(), inverse=[Quantity(5.0, 0.3)])
    found, error = line.inverses[0], line.fit.standard_errors["propagated"]
    grid = np.linspace(-50.0, 50.0, 1_000_001)
    variance = 0.3**2 + error.u_intercept**2 + grid**2 * error.u_slope**2 + 2.0 * grid * error.cov
    inside = grid[(5.0 - line.fit.intercept - line.fit.slope * grid) ** 2 <= line.k**2 * variance]
    assert (found.low, found.high) == pytest.approx((inside.min(), inside.max()), abs=2e-4)
    assert found.high - found.value > 1.1 * (found.value - found.low)
    flat = tmp_path / "flat.csv"
    flat.write_text("x,y,u_y\n1,1.0,1\n2,1.1,1\n3,0.9,1\n4,1.2,1\n")
    assert math.isinf(
        straight_line(flat, LineColumns(), inverse=[Quantity(1.0, 0.1)]).inverses[0].high
    )


def test_a_line_that_does_not_fit_has_no_result_and_exit_code_3(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("x,y,u_y\n1,1,0.01\n2,3,0.01\n3,2,0.01\n4,5,0.01\n")
    result, folder = told(tmp_path, path, "--predict", 2)
    assert result.exit_code == 3
    assert "line: poor-fit" in result.output
    text = (folder / "report.md").read_text()
    assert "Best values, not a result: intercept" in text
    assert "Predictions" not in text


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        ("x,y\n1,1\n2,2\n3,4\n", ["--x", "t"], "p.csv:1: 't' is missing (the header has"),
        (
            "x,y\n1,1\n2,2\n3,4\n",
            ["--x", "y", "--y", "y"],
            "'--y' must name another column than --x: y",
        ),
        (
            "x,y\n1,1\n2,2\n3,3\n4,4\n",
            [],
            "p.csv: 'y' has no scatter about a line but rounding errors",
        ),
        (
            "x,y\n1,0.1\n2,0.2\n3,0.3\n4,0.4\n",
            [],
            "p.csv: 'y' has no scatter about a line but rounding errors",
        ),
        ("x,y\n1,0\n2,0\n3,0\n", [], "p.csv: 'y' has no scatter about a line but rounding errors"),
        ("x,y\n1,1\n2,2\n", [], "p.csv: 'rows' must hold at least 3 rows of numbers: 2"),
        ("x,y,u_y\n1,1,0\n2,2,1\n3,4,1\n", [], "p.csv:2: 'u_y' must be > 0: 0.0"),
        ("x,y\n1,1\n2,2\n3,4\n", ["--uy", "-1"], "'--uy' must be > 0: -1.0"),
        (
            "x,y,u_y\n1,1,1\n2,2,1\n3,4,1\n",
            ["--inverse", "2"],
            "'--inverse' must have an uncertainty",
        ),
        (
            "x,y\n1,1\n2,2\n3,4\n",
            ["--predict", "two"],
            "'--predict' must be a number as 4.0, or read like",
        ),
        (
            "x,y,u_y\n1,1,1\n2,2,1\n3,4,1\n",
            ["--correlation", "0.5"],
            "'--correlation' needs uncertainties of x and y",
        ),
    ],
)
def test_a_mistake_is_told(tmp_path, text, arguments, message):
    (tmp_path / "p.csv").write_text(text)
    result, _ = told(tmp_path, tmp_path / "p.csv", *arguments)
    assert isinstance(result.exception, InputError)
    assert message in str(result.exception)


def test_options_of_a_table_do_not_go_with_a_campaign(tmp_path, replica):
    result, _ = told(tmp_path, replica / "campaign.toml", "--predict", 2)
    assert "'FILE.csv' must be a table of points" in str(result.exception)


def test_the_example_of_the_docs_says_what_they_say(tmp_path, project):
    result, _ = told(tmp_path, LINES / "iso28037_sec6_unequal_weights.csv", "--inverse", "10.5(10)")
    said = (project / "docs" / "straight-line.md").read_text()
    for numbers in ("intercept 0.89 ± 0.53, slope 2.06 ± 0.18", "x = 4.67 ± 0.53"):
        assert numbers in result.output
        assert numbers in said


@pytest.mark.parametrize(
    ("header", "arguments", "first"),
    [
        ("t [s],s [m]", [], "columns: x = t (s), y = s (m)"),
        ("t [s],x [m]", [], "columns: x = t (s), y = x (m)"),
        ("t [s],x [m]", ["--y", "x"], "columns: x = t (s), y = x (m)"),
        ("t [s],x [m]", ["--x", "x"], "columns: x = x (m), y = t (s)"),
        ("y,x", [], "columns: x = x, y = y"),
    ],
)
def test_two_columns_need_no_names_and_the_first_line_says_which_is_which(
    tmp_path, header, arguments, first
):
    (tmp_path / "p.csv").write_text(header + "\n1,1\n2,2.1\n3,2.9\n4,4.2\n")
    result, _ = told(tmp_path, tmp_path / "p.csv", *arguments)
    assert result.output.splitlines()[0] == first


@pytest.mark.parametrize(
    ("header", "options"), [("a,b,c", "--x and --y"), ("x,b,c", "--y"), ("y,t,c", "--x")]
)
def test_columns_that_nobody_names_are_asked_for(tmp_path, header, options):
    (tmp_path / "p.csv").write_text(header + "\n1,1,3\n2,2.1,4\n3,2.9,4\n4,4.2,1\n")
    result, _ = told(tmp_path, tmp_path / "p.csv")
    assert f"p.csv:1: 'column' must be named by {options} (there are" in str(result.exception)


UNITS = """t (s),Voltage [V]
0,0.21
1,2.05
2,3.82
3,5.71
4,7.49
5,9.36
"""


def test_units_of_the_columns_stand_behind_every_number_as_in_a_fit_of_a_formula(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(UNITS)
    result, folder = told(tmp_path, path, "--predict", 3, "--inverse", 5)
    assert re.search(
        r"intercept \(0\.\d+ ± 0\.\d+\) V, slope \(1\.\d+ ± 0\.\d+\) V/s", result.output
    )
    assert re.search(
        r"t = 3 s: Voltage = \(5\.\d+ ± \S+\) V, 95 % interval \[.*\] V\n", result.output
    )
    assert re.search(r"Voltage = \(5\.0\d* ± \S+\) V: t = \(2\.\d+ ± \S+\) s, 95 %", result.output)
    report, record = (
        (folder / "report.md").read_text(),
        json.loads((folder / "result.json").read_bytes()),
    )
    assert re.search(
        r"\*\*Voltage = \(.*\) V \+ \(.*\) V/s · t\*\*, .* the slope \[.*\] V/s\.", report
    )
    for words in (
        "| t (s) | Voltage (V) of the line |",
        "| intercept (V) | slope (V/s) |",
        r"\volt\per\second",
    ):
        assert words in report
    assert record["units"] == {"x": "s", "y": "V", "intercept": "V", "slope": "V/s"}
    line = straight_line(path, LineColumns())
    upper, lower = straight_line_figure(line).axes
    assert (upper.get_ylabel(), lower.get_xlabel()) == ("Voltage (V)", "t (s)")
    assert lower.get_ylabel() == "residual (V)"
    fitted = analyse_table(path)
    assert fitted == {"b": line.units["slope"], "a": line.units["intercept"]}


def analyse_table(path):
    """Units of the parameters of the same line as `estim fit --formula` has them."""
    campaign = campaign_of_table(path, TableChoices(formula="a + b*x"))
    return {
        p.name: p.unit
        for p in campaign.problem(list(campaign.tables)).parameters
        if p.name in ("a", "b")
    }


def test_a_table_without_units_has_none(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(UNITS.replace("t (s),Voltage [V]", "x,y"))
    result, folder = told(tmp_path, path)
    assert re.search(r"intercept 0\.\d+ ± 0\.\d+, slope 1\.\d+ ± 0\.\d+ \(", result.output)
    assert set(json.loads((folder / "result.json").read_bytes())["units"].values()) == {"1"}
    assert straight_line_figure(straight_line(path, LineColumns())).axes[0].get_ylabel() == "y"


def test_a_scatter_that_sets_the_errors_is_no_test_of_the_line(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(UNITS)
    _, folder = told(tmp_path, path)
    text = (folder / "report.md").read_text()
    line = straight_line(path, LineColumns()).fit
    scatter = math.sqrt(line.chi2 / line.dof)
    assert f"scatter of the points about the line, {scatter:.2g} V with 4 degrees" in text
    assert "cannot test the line" in text
    assert "S = " not in text
    assert not any("S = " in words for words in str(line.shown().title).splitlines())
    _, folder = told(tmp_path, path, "--uy", 0.05)
    assert "S = " in (text := (folder / "report.md").read_text())
    assert "cannot test the line" not in text


def test_intervals_to_copy_are_students_where_the_scatter_sets_the_errors(tmp_path):
    table = tmp_path / "three.csv"
    table.write_text("x,y\n1,2.1\n2,3.9\n3,6.2\n")
    result, out = told(tmp_path, table)
    assert result.exit_code == 0, result.output
    (row,) = re.findall("^slope,(.*)$", (out / "report.md").read_text(), re.MULTILINE)
    value, u, *ends = map(float, row.split(",")[:6])
    for (low, high), probability in ((ends[:2], 0.68), (ends[2:], 0.95)):
        half = u * stats.t.ppf(0.5 + 0.5 * probability, 1)
        assert (low, high) == pytest.approx((value - half, value + half), rel=1e-4)


def test_a_line_that_does_not_fit_shows_its_best_values_without_uncertainties(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("t (s),s [m]\n" + "".join(f"{t},{t * t}\n" for t in range(8)))
    result, folder = told(tmp_path, path, "--uy", 0.5)
    first = (folder / "report.md").read_text().partition("<details>")[0]
    # of y = x^2 at 0..7 the line of least squares is 7 x - 7, farthest off by 7 at both ends
    best = "intercept = −7.00 m, slope = 7.00 m/s; points lie up to 14 standard deviations"
    for text in (result.output, first):
        text = text.replace("\N{NO-BREAK SPACE}", " ")
        assert best in text
        assert re.search(r"at t = [07] s", text)
        assert "look at the residuals" in text
    assert "±" not in first
    assert "recommended" not in (folder / "report.md").read_text()


def test_a_best_value_below_the_error_of_rounding_is_zero(tmp_path):
    path = tmp_path / "p.csv"
    x = [0.1 * i for i in range(-5, 6)]
    path.write_text("t (s),s [m]\n" + "".join(f"{t},{t * t}\n" for t in x))
    result, _ = told(tmp_path, path, "--uy", 0.01)
    assert re.search(r"intercept = 0\.100\d* m, slope = 0 m/s;", result.output), result.output


def test_a_line_that_may_be_vertical_has_no_numbers_to_copy_and_no_prediction(tmp_path):
    """Table and prediction had bounded intervals beside an unbounded slope, and the line was ok."""
    path = tmp_path / "a.csv"
    path.write_text("x,y,u_x\n1.0,0,0.1\n1.05,1,0.1\n0.95,2,0.1\n1.02,3,0.1\n")
    result, folder = told(tmp_path, path, "--predict", 1)
    assert result.exit_code == 3
    assert "not-identified" in result.output
    assert "The slope is unbounded: the points do not exclude a vertical line." in result.output
    assert "exchange x and y" in result.output
    assert "±" not in result.output
    report = (folder / "report.md").read_text()
    assert "To copy" not in report
    assert "## Predictions" not in report
