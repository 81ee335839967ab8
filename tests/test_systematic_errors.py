"""What an error in common to all points does to a result, against fits of data that have it, and
campaigns that state it.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import CubicSpline

from estim.campaign import load_campaign
from estim.checks import influences
from estim.checks.systematic_errors import large_influences
from estim.cli.commands import cli
from estim.curve_fitting.single import fit_curve
from estim.curves import Component, MotionCurve, PhaseCurve, Place, Poisson, RollingMotion, Setting
from estim.fitting import Fit, fit_least_squares, fit_problem
from estim.model import Body, speed
from estim.problem import Independent, Normal, Observations, Parameter, Problem, Scale
from estim.words import describe

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.motion import Truth, solve
from truth.recordings import BASE, sagging

TRUTH = {
    "gamma": 0.2,
    "kappa": 0.45,
    "theta0": 1.0,
    "phi": 0.07,
    "rolling_resistance": 0.0,
    "radius": 0.15,
    "g": 9.81,
}
EXACT = {"rho": 1.0, "trailing_fraction": 0.0, "particle_gyration": 0.0}
PRIORS = {"gamma": Normal(0.2, 0.01), "kappa": Normal(0.45, 0.1), "theta0": Normal(1.0, 0.03)}
X = np.linspace(0.03, 0.4, 40)
MOVES = ("clock", "length", "sag", "g")


def fitted(x: np.ndarray, v: np.ndarray, g: float = 9.81) -> Fit:
    parameters = tuple(Parameter(name, "1", prior, name) for name, prior in PRIORS.items())
    arguments = {
        name: name if name in PRIORS else value
        for name, value in {**TRUTH, **EXACT, "g": g}.items()
    }
    noise = Independent(Scale(0.01), Scale(), np.ones(x.size))
    motion = RollingMotion(
        False,
        full=PhaseCurve(False, Setting(ramp=Place(float(X[-1]), 0.0))),
        ramp_length=float(X[-1]),
    )
    run = Observations(
        "r",
        x,
        v,
        None,
        PhaseCurve(False),
        arguments,
        noise,
        "x",
        "m",
        "v",
        "m/s",
        (),
        np.zeros((0, 2)),
        motion,
    )
    return fit_least_squares(Problem(parameters, (run,)))


def body() -> Body:
    return Body(**{name: TRUTH[name] for name in ("radius", "gamma", "kappa")})


def true_speed(x: np.ndarray, g: float = 9.81) -> np.ndarray:
    return np.ravel(speed(x, body(), phi=TRUTH["phi"], theta0=TRUTH["theta0"], g=g))


def sagging_speed(depth: float) -> np.ndarray:
    """From Lagrange's equation on a bent ramp, solved by SciPy."""
    straight = Truth(
        **{name: TRUTH[name] for name in ("radius", "gamma", "kappa", "theta0", "phi", "g")}
    )
    motion = solve(sagging(depth, float(X[-1]), 0.0)(np.random.default_rng(1), straight), 3.0)
    x, v = motion(np.linspace(0.0, motion.first_rest, 20_001))
    return CubicSpline(x[:-1], v[:-1])(X)


@pytest.mark.parametrize("error", MOVES)
def test_an_error_has_moved_the_result_by_what_a_fit_without_it_says(error: str) -> None:
    """Data with the error, and the same without."""
    v = true_speed(X)
    clean, spoilt = (
        fitted(X, v),
        {
            "clock": lambda: fitted(X, v / 1.01),
            "length": lambda: fitted(X * 1.01, v * 1.01),
            "sag": lambda: fitted(X, sagging_speed(1e-3)),
            "g": lambda: fitted(X, v, g=9.81 / (1.0 - 1e-3)),
        }[error](),
    )
    told = next(one for one in influences(spoilt) if one.name == error)
    moved = (spoilt.values - clean.values) / spoilt.sds
    assert np.max(np.abs(moved)) > 0.01
    assert [told.shifts[name] for name in clean.names] == pytest.approx(moved, abs=0.01)


def test_sagging_speed_without_sag_is_the_phase_curve() -> None:
    assert sagging_speed(0.0) == pytest.approx(true_speed(X), rel=1e-7)


def test_the_strongest_comes_first_and_a_wrong_size_would_fail() -> None:
    found = influences(fitted(X, true_speed(X)))
    assert [one.largest for one in found] == sorted((one.largest for one in found), reverse=True)
    assert len({one.name for one in found}) == len(found) >= 5
    first = found[0]
    assert (
        first.largest == abs(first.shifts[first.strongest]) == max(map(abs, first.shifts.values()))
    )


def test_a_users_curve_has_scales() -> None:
    """y = a x: a per cent more of y is a per cent more of a, a per cent more of x a per cent
    less.
    """
    x = np.linspace(1.0, 5.0, 9)
    fit = fit_curve("a*x", x, 2.0 * x + 0.01 * np.cos(7.0 * x), u_y=0.05, start={"a": 1.0}).fit
    moved = {one.name: one.shifts["a"] * fit.sds[0] / fit.values[0] for one in influences(fit)}
    assert moved["scale_y"] == pytest.approx(0.01, rel=0.01)
    assert moved["scale_x"] == pytest.approx(-0.01, rel=0.01)


def test_errors_of_the_abscissas_and_angles_do_not_hinder(rng: np.random.Generator) -> None:
    x = np.linspace(1.0, 5.0, 9)
    fit = fit_curve(
        "a*x", x, 2.0 * x + 0.05 * rng.standard_normal(9), u_y=0.05, u_x=0.05, start={"a": 1.0}
    ).fit
    assert {
        one.name: round(one.shifts["a"] * fit.sds[0] / fit.values[0], 3) for one in influences(fit)
    } == {"scale_y": 0.01, "scale_x": -0.01}
    motion = RollingMotion(True, full=PhaseCurve(True))
    assert [
        e.name
        for e in motion.errors_in_common(
            PhaseCurve(True), {**TRUTH, **EXACT, "g": "g", "scale_t": "scale_t"}
        )
    ] == ["sag", "radius", "gamma", "kappa", "phi", "theta0"]


def test_scales_that_are_unknowns_are_no_errors() -> None:
    x = np.linspace(1.0, 5.0, 9)
    fit = fit_curve(
        "a*x", x, 2.0 * x, u_y=0.05, start={"a": 1.0}, errors=[Component("scale_y", 0.02)]
    ).fit
    assert [one.name for one in influences(fit)] == ["scale_x"]


@pytest.mark.slow
def test_longer_bins_hold_as_many_events() -> None:
    """Bins that are read 1 % too long: the same numbers in shorter bins are as many decays, of a
    shorter life.
    """
    edges = np.linspace(0.0, 8.0, 21)
    n = np.round(3000.0 * np.diff(-np.exp(-edges / 2.2)))

    def decays(edges: np.ndarray) -> Fit:
        return fit_curve(
            "N/tau*exp(-x/tau)",
            edges[:-1],
            n,
            noise=Poisson(edges),
            start={"N": 2000.0, "tau": 1.0},
        ).fit

    read, true = decays(edges), decays(edges / 1.01)
    (told,) = influences(read)  # no count has a scale of y
    moved = (read.values - true.values) / read.sds
    assert [told.shifts[name] for name in read.names] == pytest.approx(moved, abs=0.01)
    assert abs(moved[0]) < 0.01 < 0.3 < moved[1]


def test_where_no_fit_accounts_for_an_error_the_report_says_so() -> None:
    """A root that ends where the data begin: shorter abscissas lie outside it."""
    x = np.linspace(1.0, 5.0, 9)
    fit = fit_curve("a*sqrt(x - 1)", x, 2.0 * np.sqrt(x - 1.0), u_y=0.05, start={"a": 1.0}).fit
    found = influences(fit)
    assert (found[0].name, dict(found[0].shifts)) == ("scale_x", {})
    (finding,) = large_influences(fit, found)
    assert "1 % error in the scale of x: no fit that allows for it converges" in describe(finding)


def replica(folder: Path, text: str, runs: list[str]) -> Fit:
    data = Path(__file__).resolve().parents[1] / "data"
    path = folder / "campaign.toml"
    for before in ("runs/", "theta_min.csv", "../paper/"):
        text = text.replace(f'"{before}', f'"{data}/replica/{before}')
    path.write_text(text)
    campaign = load_campaign(path)
    return fit_problem(campaign.problem(runs), rng=np.random.default_rng(1))


REPLICA = (Path(__file__).resolve().parents[1] / "data" / "replica" / "campaign.toml").read_text()
STATED = {
    "clock": ("[shared]", "[shared]\nscale_t = 0.01"),
    "length": ("[shared]", "[shared]\nscale_x = 0.01"),
    "sag": ("[shared]", "[shared]\nsag_m = 0.001\nramp_start_m = 0.0"),
    "g": ("g = 9.81", "g = 9.80019"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("runs", "ramp"),
    [(["light-03"], 0.877), (["light-04"], 0.4), (["heavy-06", "heavy-08"], 0.877)],
)
def test_every_entry_is_what_a_fit_with_the_error_stated_says(
    tmp_path: Path, runs: list[str], ramp: float
) -> None:
    """The whole campaign is read and fit anew for each error, from afar, with another noise of the
    force.
    """
    text = REPLICA.replace("ramp_length_m = 0.877", f"ramp_length_m = {ramp}")
    fit = replica(tmp_path, text, runs)
    found = {one.name: one for one in influences(fit)}
    assert set(found) == set(STATED)
    assert found["sag"].along == ramp
    largest = {}
    for name, (before, after) in STATED.items():
        stated = replica(tmp_path, text.replace(before, after), runs)
        moved = dict(zip(fit.names, (fit.values - stated.values) / fit.sds, strict=True))
        told = found[name].shifts
        assert told == pytest.approx(
            {parameter: moved[parameter] for parameter in told}, abs=0.1
        ), name
        largest[name] = max(map(abs, told.values()))
    assert largest["sag"] > 0.2
    assert largest["clock"] > 0.15


@pytest.mark.slow
def test_a_sag_is_one_of_the_ramp_that_all_runs_lie_on(tmp_path: Path) -> None:
    """Where nothing is stated, from the release to the farthest position; a shorter one would bend
    it more.
    """
    runs = ["light-03", "light-04"]
    unsaid = REPLICA.replace("ramp_length_m = 0.877\n", "")
    fit = replica(tmp_path, unsaid, runs)
    told = next(one for one in influences(fit) if one.name == "sag")
    farthest = max(float(run.x.max()) for run in fit.problem.runs)
    assert told.along == pytest.approx(farthest)
    assert farthest == pytest.approx(0.362, abs=0.001)
    assert "1 mm of sag on a 0.362 m ramp: " in describe(large_influences(fit, [told])[0])
    short = next(
        one for one in influences(replica(tmp_path, unsaid, runs[1:])) if one.name == "sag"
    )
    assert short.along == pytest.approx(0.237, abs=0.001)
    assert short.largest > 2.0


@pytest.mark.parametrize(("moving", "pushed"), [("up and back", 0.0), ("pushed, with drag", 0.1)])
def test_a_sag_moves_positions_as_the_true_motion_says(moving: str, pushed: float) -> None:
    """Against Lagrange's equation on a bent ramp, solved by SciPy; a hump would be off by twice as
    much.
    """
    truth = replace(BASE, release_speed=pushed, viscous=0.2 * BASE.mass if pushed else 0.0)
    t = np.linspace(0.1, 1.9 if not pushed else 1.3, 30)
    straight, _ = solve(truth, 2.0)(t)
    way = float(np.max(np.abs(straight)))
    bent, _ = solve(sagging(1e-3, way, 0.0)(np.random.default_rng(1), truth), 2.0)(t)
    arguments = {
        name: getattr(BASE, name)
        for name in ("radius", "gamma", "kappa", "theta0", "phi", "rolling_resistance", "g")
    }
    arguments |= {**EXACT, "release_time": 0.0, "offset": 0.0}
    if pushed:
        arguments |= {"release_speed": pushed, "viscous_drag": 0.2}
    full = MotionCurve(False, Setting(ramp=Place(way, 0.0)))
    motion = RollingMotion(False, None, True, full=full)
    curve = MotionCurve(False)
    error = next(e for e in motion.errors_in_common(curve, arguments) if e.name == "sag")
    found = np.ravel(
        error.curve.value(t, {**arguments, **error.arguments}) - curve.value(t, arguments)
    )
    assert np.max(np.abs(found)) > 1e-3
    assert found == pytest.approx(bent - straight, abs=0.02 * np.max(np.abs(found)))


def test_shifts_are_in_the_standard_deviations_that_a_report_prints(tmp_path: Path) -> None:
    """Twelve readings whose errors are not stated: the posterior is wider than its curvature at
    the mode, by a third.
    """
    x = np.arange(0.0, 24.0, 2.0)
    y = 22.0 + 60.0 * np.exp(-x / 8.0) + 0.5 * np.random.default_rng(3).standard_normal(12)
    table = tmp_path / "cup.csv"
    table.write_text("t,temp\n" + "\n".join(f"{a:g},{b:.1f}" for a, b in zip(x, y, strict=True)))
    words = ["fit", str(table), "--formula", "room + A*exp(-t/tau)", "--out", str(tmp_path / "o")]
    assert CliRunner().invoke(cli, [*words, "--figures", "none"]).exit_code == 0
    result = json.loads((tmp_path / "o" / "result.json").read_text())
    told = next(one for one in result["what_if"] if one["error"].endswith("scale of y"))
    a = result["parameters"]["A"]
    assert told["shifts"]["A"] == pytest.approx(0.01 * a["median"] / a["sd"], rel=0.03)
