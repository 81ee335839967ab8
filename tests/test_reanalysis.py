"""The reanalysis: its parts against brute force, and the committed report against a new one."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from replica_run import heavy_04
from report_words import first_screen, words
from test_noise import CAMPAIGN, POSITIONS, TIMES
from troubles import Disk

from estim.campaign import Campaign, gamma_of_body, load_campaign
from estim.checks import Estimate
from estim.common.errors import InputError
from estim.common.labels import Notation
from estim.common.quantity_text import Quantity, e_n
from estim.fitting.least_squares import fit_least_squares
from estim.line.analysis import analyse_line
from estim.line.theta_min_series import read_theta_min
from estim.problem.posterior import Problem
from estim.problem.priors import Normal
from estim.reports.reanalysis import _unmeasured, reanalysis_report
from estim.reports.result import Screen
from estim.reports.theta_min_line import line_result
from estim.sampling import Progress
from estim.sampling.chain import Target
from estim.sampling.summary import summarise
from estim.studies.limits import limits, narrowing
from estim.studies.paper_band import propagated_bands
from estim.studies.published import compare_published, read_published
from estim.studies.reanalysis import Reanalysis, reanalyse

QUICK = Target(ess=300, max_step=800)


@pytest.fixture
def campaign(replica: Path) -> Campaign:
    return load_campaign(replica / "campaign.toml")


def test_e_n_is_the_difference_at_twice_the_uncertainty() -> None:
    assert e_n(Quantity(1.0, 0.3), Quantity(0.0, 0.4)) == pytest.approx(1.0)
    assert e_n(Quantity(0.0, 0.4), Quantity(1.0, 0.3)) == pytest.approx(-1.0)
    assert math.isnan(e_n(Quantity(1.0), Quantity(0.0)))


def test_knowing_the_tilt_narrows_gamma_as_a_refit_with_a_sharp_tilt_does(
    campaign: Campaign, rng: np.random.Generator
) -> None:
    problem = campaign.problem(["heavy-04"])
    found = {limit.group: limit for limit in limits(fit_least_squares(problem), "gamma[heavy]")}

    def sharpen(problem: Problem, group: str) -> Problem:
        parameters = [
            replace(p, prior=Normal(p.prior.centre, 1e-4 * p.prior.sd))
            if p.name.startswith(group)
            else p
            for p in problem.parameters
        ]
        return Problem(tuple(parameters), problem.runs)

    for group in ("phi", "radius", "theta0"):
        fit = fit_least_squares(sharpen(problem, group))
        u = math.sqrt(fit.cov[fit.names.index("gamma[heavy]"), fit.names.index("gamma[heavy]")])
        # the mode moves a little when a prior is sharpened at its centre, and the curvature with it
        assert found[group].u_known == pytest.approx(u, rel=0.08), group
    assert max(found.values(), key=lambda limit: limit.share).group == "kappa"
    assert found["phi"].share > 10.0 * abs(found["radius"].share)


@pytest.mark.slow
def test_a_run_depends_on_every_parameter_of_its_noise(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Runs added one by one take the unknowns of their noise with them: an inferred error of x and
    a scatter of each run's own.
    """
    noise = (
        '{model = "independent", sigma_v_m_s = 0.02, sigma_x_m = "0.002(1)", scatter = {prior '
        '= "half-normal", scale = 0.01}}'
    )
    head, _, run = CAMPAIGN.replace("NOISE", noise).partition("[[runs]]")
    runs = [run.replace('"r"', f'"{name}"').replace("r.csv", f"{name}.csv") for name in "rs"]
    (tmp_path / "c.toml").write_text("[[runs]]".join([head, *runs]))
    for name in "rs":
        columns = (
            TIMES,
            POSITIONS + 0.002 * rng.standard_normal(TIMES.size),
            np.gradient(POSITIONS, TIMES) + 0.02 * rng.standard_normal(TIMES.size),
        )
        rows = "\n".join(f"{t},{x},{v}" for t, x, v in zip(*columns, strict=True))
        (tmp_path / f"{name}.csv").write_text("t_s,x_m,v_m_s\n" + rows + "\n")
    campaign = load_campaign(tmp_path / "c.toml")
    joint = campaign.problem(["r", "s"])
    first = SimpleNamespace(fit=fit_least_squares(campaign.problem(["r"])))
    assert joint.restricted(joint.runs[1:]).names == (
        "gamma[heavy]",
        "kappa[heavy]",
        "theta0[s]",
        "scatter[s]",
        "sigma_x[s]",
    )
    # of the second alone nothing is asked
    found = narrowing(
        fit_least_squares(joint), [first, first], ["gamma[heavy]", "kappa[heavy]"], first_runs=()
    )
    # the first of them is the first alone
    assert found.u[0] == pytest.approx(found.u_single[0], rel=1e-3)
    assert np.all(found.u[1] < found.u[0])


@pytest.mark.slow
def test_any_number_of_processes_gives_the_same_report(tmp_path: Path) -> None:
    """Every byte, so that nothing depends on who did what, or when: a run by itself, and all runs
    of its body.
    """
    campaign = load_campaign(
        Disk(more='rolling_resistance = {prior = "half-normal", scale = 0.005}').write(tmp_path)
    )
    told: list[tuple[int, str]] = []

    @contextmanager
    def listened(what: str) -> Iterator[Progress]:
        told.append((0, what))
        yield lambda percent, message: told.append((percent, message))

    few = Target(max_step=60, n_walker=24)
    alone = reanalyse(
        campaign,
        seed=1,
        target=few,
        progress_of=lambda _: nullcontext(lambda percent, message: None),
    )
    spread_out = reanalyse(campaign, seed=1, target=few, progress_of=listened, jobs=2)
    assert reanalysis_report(alone, figures="none") == reanalysis_report(spread_out, figures="none")
    assert told[0] == (0, "2 fits, 2 at once")
    assert [percent for percent, _ in told] == [0, 50, 100]


@pytest.mark.parametrize("of_paper", [False, True])
def test_propagated_band_is_that_of_brute_force(
    project: Path, rng: np.random.Generator, of_paper: bool
) -> None:
    """Draw the stated inputs, evaluate the curve, take quantiles: kappa and c_rr as published where
    that is known, else as fitted.
    """
    from estim.model import Body, speed

    analysis = heavy_04()[1]
    numbers = (
        read_published(project / "data" / "paper" / "published.toml").number if of_paper else ()
    )
    (band,) = propagated_bands(analysis, rng=rng, published=numbers)
    named = analysis.problem.named(analysis.fit.values)
    fitted = {name: float(named[name]) for name in ("kappa[heavy]", "rolling_resistance")}
    kappa, resistance = (0.45, 0.0) if of_paper else fitted.values()
    priors = {p.name: p.prior for p in analysis.problem.parameters}
    n = 40_000
    drawn = {
        key: priors[key].draw(rng, n)[:, None]
        for key in ("gamma[heavy]", "theta0[heavy-04]", "phi[heavy-04]", "radius")
    }
    at = np.searchsorted(band.x, [0.1, 0.2, 0.3])

    def speeds(kappa: float, resistance: float, values: dict[str, np.ndarray]) -> np.ndarray:
        body = Body(values["radius"], values["gamma[heavy]"], kappa)
        return speed(
            band.x[at],
            body,
            phi=values["phi[heavy-04]"],
            theta0=values["theta0[heavy-04]"],
            rolling_resistance=resistance,
            g=9.81,
        )

    v = speeds(kappa, resistance, drawn)
    low, high = np.quantile(v, [0.16, 0.84], axis=0)
    assert band.mc_low[at] == pytest.approx(low, rel=0.01)
    assert band.mc_high[at] == pytest.approx(high, rel=0.01)
    assert band.u[at] == pytest.approx(v.std(axis=0), rel=0.05)
    stated = {name: np.array([[priors[name].mean]]) for name in drawn}
    assert band.value[at] == pytest.approx(np.ravel(speeds(kappa, resistance, stated)), rel=1e-9)
    other = np.ravel(speeds(*(fitted.values() if of_paper else (0.45, 0.0)), stated))
    assert np.all(np.abs(band.value[at] - other) > 0.02 * other)  # the two are not the same band
    assert dict(band.published) == (
        {"kappa[heavy]": 0.45, "rolling_resistance": 0.0} if of_paper else {}
    )
    assert set(band.fitted) == (set() if of_paper else set(fitted))
    assert np.nanmedian(band.ratio) < 0.3
    known = np.isfinite(band.ratio)
    assert np.all(band.mc_low[known] > 0.0)  # a band that v = 0 cuts off has no width to compare
    assert np.any(band.mc_low[~known] == 0.0)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (
            ["kappa", "rolling_resistance"],
            "the paper's band, 68 %: stated inputs, κ = 0.45, c_rr = 0 as published",
        ),
        (["kappa"], "stated inputs, 68 %; κ = 0.45 as published; c_rr as fitted"),
        pytest.param([], "stated inputs, 68 %; κ, c_rr as fitted", marks=pytest.mark.statistics),
    ],
)
def test_a_report_says_whose_the_band_is(
    tmp_path: Path, project: Path, numbers: list[str], said: str
) -> None:
    head, *blocks = (project / "data" / "paper" / "published.toml").read_text().split("[[number]]")
    kept = [
        block
        for block in blocks
        if any(f'"{parameter}"' in block for parameter in ("radius", *numbers))
    ]
    (tmp_path / "published.toml").write_text("[[number]]".join([head, *kept]))
    path = Disk(more='rolling_resistance = {prior = "half-normal", scale = 0.005}').write(tmp_path)
    path.write_text('published = "published.toml"\n' + path.read_text())
    target = Target(max_step=60, n_walker=24)
    found = reanalyse(
        load_campaign(path),
        seed=1,
        target=target,
        progress_of=lambda _: nullcontext(lambda percent, message: None),
    )
    report = reanalysis_report(found, figures="all")["report.md"].decode().replace("\xa0", " ")
    assert f". Pale: {said}. Line: the most probable curve" in report


def test_line_of_the_replica_recovers_gamma(campaign: Campaign) -> None:
    series = read_theta_min(campaign.source)
    line = analyse_line(series, gamma_masses=gamma_of_body(campaign.source, "heavy"), seed=1)
    assert line.status == "ok"
    for reading in line.readings.values():
        assert abs(reading.gamma.value - 0.187) < 3.0 * reading.gamma.u
        assert abs(reading.resistance.value - 0.002) < 3.0 * reading.resistance.u
    # the Bayesian line (intercept prior of sd 0.1) and York's agree within a fraction of their
    # uncertainty
    york, posterior = line.readings["york"].gamma, line.readings["posterior"].gamma
    assert abs(york.value - posterior.value) < 0.3 * york.u


def test_gamma_from_the_line_keeps_the_correlation_of_slope_and_intercept(
    campaign: Campaign, rng: np.random.Generator
) -> None:
    line = analyse_line(read_theta_min(campaign.source), gamma_masses=None, seed=1, target=QUICK)
    error = line.york.standard_errors[line.york.recommended]
    cov = [[error.u_intercept**2, error.cov], [error.cov, error.u_slope**2]]
    a, b = rng.multivariate_normal([line.york.intercept, line.york.slope], cov, size=400_000).T
    assert line.readings["york"].resistance.u == pytest.approx(np.std(a / b), rel=0.05)
    # the same of gamma times intercept fails without the correlation once the intercept is not
    # small
    shifted = rng.multivariate_normal([1.0, line.york.slope], cov, size=400_000).T
    wrong = rng.multivariate_normal([1.0, line.york.slope], np.diag(np.diag(cov)), size=400_000).T
    assert abs(np.std(wrong[0] / wrong[1]) / np.std(shifted[0] / shifted[1]) - 1.0) > 0.10
    assert line.readings["york"].gamma.u == pytest.approx(np.std(1.0 / b), rel=0.05)
    assert math.isnan(line.readings["york"].e_n)


@pytest.mark.parametrize("raised", [0.0, 8.0])
def test_how_far_measured_angles_lie_above_the_theory(
    replica: Path, tmp_path: Path, rng: np.random.Generator, raised: float
) -> None:
    """Against draws of York's line and of the stated gamma; angles that are all 8 degrees too large
    are told from chance.
    """
    rows = np.genfromtxt(replica / "theta_min.csv", delimiter=",", names=True, skip_header=1)
    rows["theta_min_deg"] += raised
    (tmp_path / "runs").symlink_to(replica / "runs")
    (tmp_path / "campaign.toml").write_text((replica / "campaign.toml").read_text())
    np.savetxt(
        tmp_path / "theta_min.csv",
        rows,
        "%.9g",
        ",",
        header=",".join(rows.dtype.names),
        comments="",
    )
    campaign = load_campaign(tmp_path / "campaign.toml")
    stated = gamma_of_body(campaign.source, "heavy")
    line = analyse_line(read_theta_min(campaign.source), gamma_masses=stated, seed=1, target=QUICK)
    above = line_result(campaign, line)["above_theory"]
    assert above is not None
    assert stated is not None
    tilt = np.mean(np.sin(np.radians(rows["phi_deg"])))
    assert math.sin(above["tilt"]) == pytest.approx(tilt)
    theory = np.arcsin(np.sin(np.radians(rows["phi_deg"])) / stated.value)
    assert above["points"] == np.sum(np.radians(rows["theta_min_deg"]) > theory)
    error = line.york.standard_errors[line.york.recommended]
    cov = [[error.u_intercept**2, error.cov], [error.cov, error.u_slope**2]]
    a, b = rng.multivariate_normal([line.york.intercept, line.york.slope], cov, size=100_000).T
    gamma = rng.normal(stated.value, stated.u, a.size)
    drawn = np.arcsin(a + b * tilt) - np.arcsin(tilt / gamma)
    assert above["excess"].value == pytest.approx(drawn.mean(), abs=0.2 * drawn.std())
    assert above["excess"].u == pytest.approx(drawn.std(), rel=0.15)
    assert (above["excess"].value > 2.0 * above["excess"].u) == (raised > 0.0)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("phi_deg,theta_min_deg\n1,5\n2,10\n3,15\n", "'u_phi_deg' is missing"),
        (
            "phi_deg,theta_min_deg\n4.0,20\n4.0,21\n4.0,22\n",
            "theta_min.csv:2: 'phi_deg' must not be the same in every row",
        ),
        ("phi_deg,u_phi_deg,u_theta_min_deg\n1,1,1\n2,1,1\n3,1,1\n", "'theta_min_deg' is missing"),
        (
            "phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n1,5,0.4,1.5\n2,10,0,1.5\n3,15,0.4,1.5\n",
            "theta_min.csv:3: 'u_phi_deg' must be > 0: 0.0",
        ),
        (
            "phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n1,5,0.4,1.5\n2,9,0.4,1e-9\n3,15,0.4,1.5\n",
            ":3: 'u_theta_min_deg' must be at least 0",
        ),
        (
            "phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n1,5,0.4,1.5\n2,95,0.4,1.5\n3,15,0.4,1.5\n",
            "theta_min.csv:3: 'theta_min_deg' must lie",
        ),
        ("phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n1,5,0.4,1.5\n", "at least 3 rows"),
    ],
)
def test_a_wrong_series_is_refused_with_its_place(
    replica: Path, tmp_path: Path, rows: str, told: str
) -> None:
    (tmp_path / "runs").symlink_to(replica / "runs")
    (tmp_path / "campaign.toml").write_text((replica / "campaign.toml").read_text())
    (tmp_path / "theta_min.csv").write_text(rows)
    with pytest.raises(InputError) as caught:
        read_theta_min(load_campaign(tmp_path / "campaign.toml").source)
    assert told in str(caught.value)


@pytest.mark.parametrize("u", ["1e-9", "50.0"])
def test_an_uncertainty_of_all_angles_has_limits(replica: Path, tmp_path: Path, u: str) -> None:
    text = (replica / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text.replace("[line]\n", f"[line]\nu_phi_deg = {u}\n"))
    with pytest.raises(InputError) as caught:
        load_campaign(tmp_path / "campaign.toml")
    assert f"'u_phi_deg' must be >= 0.0001 and < 45: {float(u)}" in str(caught.value)


def test_published_numbers_meet_what_was_found(project: Path) -> None:
    paper = read_published(project / "data" / "paper" / "published.toml")
    assert "1403.7220" in paper.paper
    found = [
        ("gamma", "heavy", Quantity(0.197, 0.0), "exact"),
        ("gamma", "light", Quantity(0.094, 0.01), "x"),
        ("kappa", "light", Quantity(0.65, 0.1), "y"),
    ]
    rows = compare_published(paper.number, found)
    assert [(row.published.value, row.how) for row in rows] == [
        (0.45, "y"),
        (0.187, "exact"),
        (0.094, "x"),
    ]
    assert rows[0].e_n == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered")
def test_committed_report_is_what_the_code_finds(
    reports: Path, replica: Path, reanalysed: Reanalysis
) -> None:
    """A new reanalysis agrees with `reports/replica` within Monte-Carlo error, and recovers the
    truth.
    """
    import tomllib

    files, committed = reanalysis_report(reanalysed, figures="all"), reports / "replica"
    new, old = json.loads(files["result.json"]), json.loads((committed / "result.json").read_text())
    assert set(new["statuses"].values()) == {"ok"}
    assert new["statuses"] == old["statuses"]
    bare, shown = (
        reanalysis_report(reanalysed, figures="none"),
        re.findall(r"!\[[^\]]*\]\((\S+)\)", files["report.md"].decode()),
    )
    assert bare == {"report.md": bare["report.md"], "result.json": files["result.json"]}
    assert sorted(shown) == sorted(path for path in files if path.endswith(".png"))
    assert b"figures/" not in bare["report.md"]
    truth = tomllib.loads((replica / "truth.toml").read_text())
    for body in sorted(old["bodies"]):
        a, b = (result["bodies"][body]["joint"]["parameters"] for result in (new, old))
        for name in b:
            error = math.hypot(a[name]["mcse"], b[name]["mcse"])
            assert abs(a[name]["mean"] - b[name]["mean"]) < 5.0 * error, name
            # the error of a standard deviation is about mcse/sqrt(2), more for heavy tails
            assert abs(a[name]["sd"] - b[name]["sd"]) < 8.0 * error, name
            assert abs(a[name]["mean"] - truth.get(name, 0.0)) < 3.0 * a[name]["sd"], name
        # u falls as runs are added
        for us in old["bodies"][body]["u_with_runs"].values():
            assert all(np.diff(us) < 0.0)
    for method, row in old["line"]["methods"].items():
        if method != "posterior":
            assert new["line"]["methods"][method]["slope"] == pytest.approx(row["slope"], rel=1e-9)
    text = (committed / "report.md").read_text()
    shown = {line.split("](")[1].rstrip(")") for line in text.splitlines() if line.startswith("![")}
    assert shown == {name for name in files if name.startswith("figures/")}
    for figure in shown:
        assert (committed / figure).exists(), figure


FLAT = "phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n1,50,0.4,2\n2,45,0.4,2\n3,50,0.4,2\n"
FALLING = (
    "phi_deg,theta_min_deg,u_phi_deg,u_theta_min_deg\n"
    "1,60,0.2,1\n3,40,0.2,1\n5,25,0.2,1\n7,10,0.2,1\n"
)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [FLAT, FALLING])
def test_points_that_hold_no_rising_line_give_no_gamma(
    replica: Path, tmp_path: Path, rows: str
) -> None:
    (tmp_path / "runs").symlink_to(replica / "runs")
    (tmp_path / "campaign.toml").write_text((replica / "campaign.toml").read_text())
    (tmp_path / "theta_min.csv").write_text(rows)
    line = analyse_line(
        read_theta_min(load_campaign(tmp_path / "campaign.toml").source),
        gamma_masses=None,
        seed=1,
        target=Target(ess=300),
    )
    assert line.status == "not-identified"


def test_uncertainty_of_a_sine_holds_up_to_ninety_degrees(rng: np.random.Generator) -> None:
    from estim.line.theta_min_series import _sd_of_sine

    for degrees in (10.0, 60.0, 85.0, 90.0):
        angle, u = np.radians(degrees), np.radians(2.0)
        drawn = np.sin(angle + u * rng.standard_normal(400_000)).std()
        assert _sd_of_sine(np.array([angle]), np.array([u]))[0] == pytest.approx(drawn, rel=0.01)


SYMBOLS = {
    "gamma": "γ",
    "kappa": "κ",
    "theta0": "θ₀",
    "phi": "φ",
    "rolling_resistance": "c_rr",
    "radius": "R",
    "scale_x": "δ_x",
    "scale_t": "δ_t",
}


def says(cell: str, *values: float) -> bool:
    """Whether the numbers of a cell are `values`, rounded as they are written."""
    written = re.findall(r"-?\d+(?:\.\d+)?", cell.replace("−", "-"))
    return all(
        abs(float(a) - b) <= 0.5001 * 10.0 ** -len(a.partition(".")[2])
        for a, b in zip(written, values, strict=True)
    )


def test_tables_of_the_committed_report_say_what_its_results_hold(reports: Path) -> None:
    """Of both bodies: one that is not computed again is not written by hand either."""
    committed = reports / "replica"
    result, text = (
        json.loads((committed / "result.json").read_text()),
        (committed / "report.md").read_text().replace("\xa0", " "),
    )
    rows = [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in text.splitlines()
        if line.startswith("| ")
    ]
    tables = text.split("| parameter | stated before | posterior |")
    copied = {
        row["quantity"]: row
        for row in csv.DictReader(
            line
            for line in text.partition("```csv\n")[2].partition("```")[0].splitlines()
            if not line.startswith("#")
        )
    }
    assert list(result["bodies"]) == ["heavy", "light"]
    for (body, found), table in zip(result["bodies"].items(), tables[1:], strict=True):
        posterior = found["joint"]["parameters"]
        shown = [
            line.strip("|").split(" | ") for line in table.splitlines()[2 : 2 + len(posterior)]
        ]
        for (name, one), (label, _, mean_sd, interval, unit, _) in zip(
            posterior.items(), shown, strict=True
        ):
            factor = 180.0 / math.pi if unit == "°" else 1.0
            mean, sd, low, high = (factor * one[key] for key in ("mean", "sd", "q025", "q975"))
            symbol, _, place = name.partition("[")
            assert label.strip() == SYMBOLS[symbol] + (f"[{place}" if place else "")
            assert says(interval, low, high), name
            if "±" in mean_sd:
                assert says(mean_sd, mean, sd), name
            if place == f"{body}]":
                first = [row for row in rows if row[0] == f"{label.strip()}, 4 runs"]
                assert [says(row[1], mean, sd) for row in first] == [True], name
                numbers = [
                    float(copied[label.strip()][column])
                    for column in ("value", "u", "low_95", "high_95")
                ]
                assert numbers == pytest.approx([mean, sd, low, high], rel=1e-5)
    runs = {row[0]: row[1:6] for row in rows if row[0] in result["runs"] and len(row) == 6}
    assert runs.keys() == result["runs"].keys()
    for run, (status, *cells) in runs.items():
        assert status == result["runs"][run]["status"]
        alone = {
            name.partition("[")[0]: one for name, one in result["runs"][run]["parameters"].items()
        }
        for name, cell in zip(("gamma", "kappa", "theta0", "phi"), cells, strict=True):
            factor = 180.0 / math.pi if name in ("theta0", "phi") else 1.0
            if "±" in cell:
                assert says(cell, factor * alone[name]["mean"], factor * alone[name]["sd"]), (
                    run,
                    name,
                )
    compared = [
        row
        for row in rows
        if len(row) == 6 and row[0] in {one["name"] for one in result["published"]}
    ]
    for row, one in zip(compared, result["published"], strict=True):
        assert says(row[3], one["reanalysed"]["value"], one["reanalysed"]["u"]), row
        assert says(row[5], one["e_n"]), row


def test_story_of_the_committed_report_is_that_of_its_results(reports: Path) -> None:
    committed = reports / "replica"
    text = " ".join((committed / "report.md").read_text().replace("\xa0", " ").split())
    bodies = json.loads((committed / "result.json").read_text())["bodies"]
    shares = [b["median_ratio"] for body in bodies.values() for b in body["bands"].values()]
    assert f"{100.0 * min(shares):.1f}–{100.0 * max(shares):.1f} % as wide" in text
    for name, body in bodies.items():
        stated, true = body["gamma_masses"], body["joint"]["parameters"][f"gamma[{name}]"]["true"]
        assert f"{(stated['value'] - true) / stated['u']:+.1f} ({name})" in text
    assert "the paper computes 0.45 from the shape of the disk" in text
    assert len(words(first_screen((committed / "report.md").read_text()))) < 120
    assert text.count("E_n is") == 1  # explained once
    means = [e["mean_relative"] for body in bodies.values() for e in body["energies"].values()]
    least = min(means, key=lambda mean: mean["value"])
    said = text.partition("and only exceptionally reach 10%.”")[2]
    assert says(said.partition("between")[2].partition(")")[0], *(100.0 * least[k] for k in least))
    assert "because the data do not determine how much energy is lost" in said
    above = json.loads((committed / "result.json").read_text())["line"]["above_theory"]
    said = text.partition("always bigger than the theoretical one")[2]
    assert f"Here {above['points']} of 8 points lie above" in said
    degrees = [math.degrees(above["excess"][key]) for key in ("value", "u")]
    assert says(said.partition("fitted line is")[2].partition("°")[0], *degrees)
    assert "they agree" in said


@pytest.mark.slow
def test_story_without_truths_says_nothing_of_them(reanalysed: Reanalysis) -> None:
    told = reanalysis_report(reanalysed, figures="none")["report.md"].decode()
    measured = replace(reanalysed, campaign=replace(reanalysed.campaign, truth={}))
    untold = reanalysis_report(measured, figures="none")["report.md"].decode()
    assert ("true values are known" in told, "true values are known" in untold) == (True, False)
    assert "the paper computes 0.45" in untold
    test, recovery = "this is a test of that value", "generated with that value"
    assert (test in told, recovery in told) == (False, True)
    assert (test in untold, recovery in untold) == (True, False)
    bodies = {body.body: body for body in reanalysed.bodies}
    n = len(reanalysed.single_runs)
    assert f"**Status: ok ({n} runs, {len(bodies)} joint fit" in told
    assert told.count("% SYNTHETIC data") == 2
    assert "\n# SYNTHETIC data\nquantity,value" in told
    for name, body in bodies.items():
        names = body.joint.problem.names
        pair = body.joint.chain.flat[:, [names.index(f"{k}[{name}]") for k in ("gamma", "kappa")]]
        correlation = float(np.corrcoef(pair.T)[0, 1])
        assert f"The correlation of γ[{name}] and κ[{name}] is {correlation:+.2f};" in told


def test_what_no_body_measures_is_said_once_and_the_rest_after_the_names_of_its_bodies() -> None:
    draws = np.linspace(0.149, 0.151, 9)
    radius = Estimate(Notation("R").label("m"), summarise(draws, unit="m", meaning=""), "", False)
    resistance = [
        Estimate(Notation("c_rr").label("1"), radius.summary, "", False, upper=upper)
        for upper in (0.01, 0.02)
    ]
    screens = {
        name: Screen(name, "", estimates=(one, radius))
        for name, one in zip(("heavy", "light"), resistance, strict=True)
    }
    common, *own = _unmeasured(screens).split("; ")
    assert common.startswith("R = (0.15")
    assert own == ["heavy: c_rr < 0.0100 (95 %)", "light: c_rr < 0.0200 (95 %)"]
    other = replace(radius, summary=summarise(draws + 0.01, unit="m", meaning=""))
    screens["light"] = replace(screens["light"], estimates=(resistance[1], other))
    heavy, light = _unmeasured(screens).split("; ")
    assert heavy.startswith("heavy: c_rr < 0.0100 (95 %), R = (0.15")
    assert light.startswith("light: c_rr < 0.0200 (95 %), R = (0.16")
