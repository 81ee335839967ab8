"""Whether the body rolled: the friction that the fitted motion needs, its probability for a stated
one, and what the report says of it.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from estim import InputError, load_campaign
from estim.campaign.binding import grip_of
from estim.checks.rolling import Rolling, check_rolling, rolling_remarks, way_of
from estim.common import Kind
from estim.curves.rolling import RollingMotion, Setting
from estim.distributions import normal_tail
from estim.fitting import fit_problem
from estim.model import Body, trajectory
from estim.pipeline import analyse
from estim.problem.priors import Uniform
from estim.reports.analysis import analysis_report
from estim.reports.result import result_of
from estim.reports.rolling import rolling_figure
from estim.sampling import Target
from estim.words import describe

BODY = {
    "radius": 0.15,
    "gamma": 0.187,
    "kappa": 0.45,
    "rho": 1.0,
    "trailing_fraction": 0.0,
    "particle_gyration": 0.0,
    "phi": 0.07,
    "theta0": 1.05,
    "rolling_resistance": 0.0,
    "g": 9.81,
}
TEXT = """\
title = "one run"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
noise = {{sigma_x_m = 0.001{noise}}}
{shared}
[bodies.heavy]
gamma = "0.187(2)"
kappa = "0.450(5)"
[[runs]]
name = "a"
body = "heavy"
file = "a.csv"
phi_deg = "4.0(1)"
theta0_deg = "60.0(5)"
"""

COMPLETE = "unmodelled_force = 0"  # where no force is asked about


def campaign_of(tmp_path, shared="", noise=""):
    t = 0.02 + np.arange(40) / 30
    x = trajectory(
        t, Body(0.15, 0.187, 0.45), phi=math.radians(4), theta0=math.radians(60), g=9.81
    )[0][0]
    x = x + np.random.default_rng(3).normal(0.0, 0.001, t.size)
    (tmp_path / "a.csv").write_text(
        "t_s,x_m\n" + "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(t, x, strict=True))
    )
    (tmp_path / "campaign.toml").write_text(TEXT.format(shared=shared, noise=noise))
    return load_campaign(tmp_path / "campaign.toml")


def rolled(campaign, rng, n_draw=4000):
    """The check of the only run, on draws of the normal approximation."""
    problem = campaign.problem(["a"])
    fit = fit_problem(problem, rng=rng)
    draws = rng.multivariate_normal(fit.values, fit.cov, n_draw)
    return check_rolling(problem, draws, rng=rng)[0], problem.named(draws)


def needed_by_hand(draw):
    """Largest |F|/N from rest to the turn, for one draw: energy and Newton's law for the centre of
    mass by second differences in time.
    """
    gamma, phi, theta0 = draw["gamma[heavy]"], draw["phi[a]"], draw["theta0[a]"]
    body, h = Body(0.15, gamma, draw["kappa[heavy]"]), 1e-3
    t = np.linspace(0.005, 1.38, 400)

    def centre(at):
        x = trajectory(at, body, phi=phi, theta0=theta0, g=9.81)[0][0]
        across = theta0 + x / 0.15 + phi
        return np.array([x + gamma * 0.15 * np.sin(across), gamma * 0.15 * np.cos(across)])

    acceleration = (centre(t - h) - 2 * centre(t) + centre(t + h)) / h**2
    return np.max(
        np.abs(acceleration[0] + 9.81 * math.sin(phi)) / (acceleration[1] + 9.81 * math.cos(phi))
    )


def test_needed_friction_is_that_of_the_motion_draw_by_draw(tmp_path, rng):
    found, named = rolled(campaign_of(tmp_path), rng)
    for i in range(3):
        draw = {name: float(np.ravel(values)[i]) for name, values in named.items()}
        assert found.needed[i] == pytest.approx(needed_by_hand(draw), rel=2e-3)
    assert found.hops == 0.0
    assert 0.9 < np.median(found.least_normal) < 1.0
    assert found.enough == pytest.approx(np.quantile(found.needed, 0.95), rel=1e-3)
    assert 0.0 < found.where < 0.3


@pytest.mark.slow
def test_probability_is_that_of_two_normal_quantities(tmp_path, rng):
    """P(mu > needed) with mu normal and the need nearly so: Phi(distance / both uncertainties)."""
    campaign = campaign_of(tmp_path, 'friction = "0.150(10)"')
    found, _ = rolled(campaign, rng, 40_000)
    expected = float(
        normal_tail((np.mean(found.needed) - 0.15) / math.hypot(0.01, np.std(found.needed)))
    )
    assert 0.05 < expected < 0.95
    assert found.holds == pytest.approx(expected, abs=0.01)
    assert found.finding.kind is Kind.ROLLING_DOUBTFUL
    (remark,) = rolling_remarks([found])
    assert (remark.kind, remark.run, remark.p) == (Kind.ROLLING_DOUBTFUL, "a", found.holds)


TOLD = [
    ("0.5", Kind.ROLLING_SURE, 0),
    ("0.02", Kind.ROLLING_DOUBTFUL, 1),
    (None, Kind.FRICTION_NEEDED, 0),
]


@pytest.mark.parametrize(("friction", "kind", "remarks"), TOLD)
def test_what_is_told(tmp_path, rng, friction, kind, remarks):
    found, _ = rolled(
        campaign_of(tmp_path, "" if friction is None else f"friction = {friction}"), rng, 300
    )
    assert found.finding.kind is kind
    assert len(rolling_remarks([found])) == remarks
    assert found.holds == {"0.5": 1.0, "0.02": 0.0}.get(
        friction, pytest.approx(math.nan, nan_ok=True)
    )
    assert f"{found.typical:.2g}" in describe(found.finding)


def test_positions_speak_of_the_same_motion(tmp_path, rng):
    speeds, _ = rolled(campaign_of(tmp_path, shared=COMPLETE), rng)
    positions, _ = rolled(
        campaign_of(tmp_path, shared=COMPLETE, noise=', model = "positions"'), rng
    )
    assert np.median(positions.needed) == pytest.approx(np.median(speeds.needed), rel=0.02)
    assert positions.unit == "m"


def test_much_friction_is_told_though_none_is_stated():
    def of(needed):
        return Rolling("a", np.asarray(needed), 0.1, "m", np.ones(len(needed)), False, math.nan)

    assert rolling_remarks([of([0.4] * 20)]) == []
    assert [told.kind for told in rolling_remarks([of([0.6] * 20)])] == [Kind.FRICTION_NEEDED]
    hopping = of([0.2] * 10 + [np.inf] * 10)
    assert (hopping.hops, hopping.finding.kind) == (0.5, Kind.ROLLING_HOPS)
    assert "would leave the ramp with probability 0.50" in describe(hopping.finding)


def test_littlewoods_hoop_leaves_the_ramp():
    """A hoop without mass: N falls to 0 at 90 degrees (see tests/test_contact.py)."""
    hoop = BODY | {"gamma": 1.0, "kappa": 1.0, "phi": 0.0, "theta0": 0.01}
    footing = RollingMotion(False).footing(0.3, hoop)
    assert footing.normal[0, 0] == pytest.approx(1.0, abs=1e-3)
    at = footing.along[0] / 0.15 + 0.01
    assert footing.normal[0] == pytest.approx(np.cos(at), abs=1e-3)
    assert np.any(footing.normal < 0.0)


@pytest.mark.parametrize("angular", [False, True])
def test_a_disturbed_motion_presses_as_the_plain_one_where_nothing_disturbs(angular):
    farthest = 2.0 if angular else 0.3
    plain = RollingMotion(angular).footing(farthest, BODY | {"offset": 0.01})
    other = RollingMotion(angular, None, False, Setting(), 1.0).footing(
        farthest, BODY | {"offset": 0.01, "moment_once_cos": 0.0, "scale_x": 0.0}
    )
    assert other.normal == pytest.approx(plain.normal, rel=1e-12)
    assert other.needed == pytest.approx(plain.needed, rel=1e-12)
    assert other.along == pytest.approx(plain.along)
    pushed = RollingMotion(angular, None, False, Setting(), 1.0).footing(
        farthest, BODY | {"offset": 0.01, "release_energy": 0.1}
    )
    assert np.nanmax(np.abs(pushed.normal - plain.normal)) > 0.01


def test_what_comes_after_the_readings_that_are_fit_does_not_count(tmp_path, rng):
    """The body turns round at 0.45 m; near the release it needs most."""
    whole, _ = rolled(campaign_of(tmp_path, shared=COMPLETE), rng, 300)
    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text + "window = {x_max_m = 0.03}\n")
    start, _ = rolled(load_campaign(tmp_path / "campaign.toml"), rng, 300)
    assert start.where < 0.031 < whole.where
    in_time = (
        text.replace("sigma_x_m = 0.001", 'sigma_x_m = 0.001, model = "positions"')
        + "window = {t_max_s = 0.31}\n"
    )
    (tmp_path / "campaign.toml").write_text(in_time)
    campaign = load_campaign(tmp_path / "campaign.toml")
    assert way_of(campaign.problem(["a"]).runs[0]) < 0.04
    assert rolled(campaign, rng, 300)[0].where < 0.04


def test_nothing_is_said_of_what_lies_behind_a_turning_point():
    footing = RollingMotion(False).footing(2.0, BODY | {"phi": 0.001})
    there = np.isfinite(footing.normal[0])
    assert 0 < np.count_nonzero(there) < there.size
    assert not np.any(np.diff(there.astype(int)) > 0)


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered")
def test_the_report_says_it_and_the_result_is_not_moved(tmp_path):
    campaign = campaign_of(tmp_path, f'{COMPLETE}\nfriction = "0.14(2)"')
    analysis = analyse(campaign, ["a"], seed=1, target=Target(ess=1000.0))
    assert analysis.diagnosis.ok
    summary = result_of(campaign, analysis).rolling["a"]
    assert 0.05 < summary.probability < 0.95
    assert any(
        "the probability of rolling without slipping is" in note
        for note in analysis.diagnosis.notes
    )
    files = analysis_report(campaign, analysis, figures="all")
    assert "## Rolling without slipping" in files["report.md"].decode()
    assert "(figures/rolling.png)" in files["report.md"].decode()
    assert files["figures/rolling.png"].startswith(b"\x89PNG")
    (tmp_path / "campaign.toml").write_text(TEXT.format(shared=COMPLETE, noise=""))
    plain = load_campaign(tmp_path / "campaign.toml")
    without = analyse(plain, ["a"], seed=1, target=Target(ess=1000.0))
    assert np.array_equal(without.chain.flat, analysis.chain.flat)
    assert result_of(plain, without).rolling["a"].probability is None
    report = analysis_report(plain, without, figures="none")["report.md"].decode()
    assert "no friction stated" in report
    assert "rolling.png" not in report


@pytest.mark.slow
def test_the_figure_shows_both_forces_and_the_stated_friction(tmp_path, rng):
    campaign = campaign_of(tmp_path, 'friction = "0.14(2)"')
    found, _ = rolled(campaign, rng, 300)
    problem = campaign.problem(["a"])
    draws = np.repeat(fit_problem(problem, rng=rng).values[None, :], 50, axis=0)
    (ax,) = rolling_figure(problem, draws, [found]).axes
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in ax.lines}
    assert set(lines) == {"N/(M g)", "|F|/N", "stated friction"}
    assert np.max(lines["|F|/N"]) == pytest.approx(found.typical, rel=0.05)
    assert np.min(lines["N/(M g)"]) == pytest.approx(np.median(found.least_normal), rel=0.01)
    assert lines["stated friction"][0] == pytest.approx(0.14)


def test_a_curve_of_the_users_own_has_no_ramp(tmp_path):
    (tmp_path / "a.csv").write_text(
        "x,y\n" + "\n".join(f"{x},{2 * x + 0.1 * (-1) ** x}" for x in range(12))
    )
    text = (
        'title = "line"\nkind = "measured"\n[curve]\nexpression = "a*x"\nu_y = 0.1\nx = '
        '{column = "x"}\ny = {column = "y"}\n'
    )
    text += '[curve.parameters]\na = {start = 1.0}\n[[runs]]\nname = "r"\nfile = "a.csv"\n'
    (tmp_path / "campaign.toml").write_text(text)
    campaign = load_campaign(tmp_path / "campaign.toml")
    assert (
        check_rolling(campaign.problem(["r"]), np.full((5, 1), 2.0), rng=np.random.default_rng(0))
        == ()
    )


def test_friction_is_looked_up_as_other_quantities_are(tmp_path):
    campaign = campaign_of(tmp_path, 'friction = {prior = "uniform", low = 0.1, high = 0.3}')
    grip = campaign.problem(["a"]).runs[0].motion.grip
    assert (grip.low, grip.high, type(grip)) == (0.1, 0.3, Uniform)
    assert "friction" not in "".join(campaign.problem(["a"]).names)
    assert grip_of(campaign.levels("a")) is not None


@pytest.mark.parametrize(
    ("said", "rule"),
    [("-0.1", "must be >= 0"), ("12.0", "must be at most 10"), ('"some"', "or read like")],
)
def test_a_wrong_friction_is_refused(tmp_path, said, rule):
    with pytest.raises(InputError, match=rule) as told:
        campaign_of(tmp_path, f"friction = {said}")
    assert told.value.line == 7
