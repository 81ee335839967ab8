"""Campaign files: what is shared, what becomes a prior, which rows are fit, and every mistake with
its line.
"""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np
import pytest
from uncertainties import ufloat

from estim import InputError, load_campaign
from estim.campaign.campaign_file import RunTable
from estim.campaign.curve_keys import CurveRunTable
from estim.campaign.dialect_table import TRACK_KEYS
from estim.campaign.row_selection import Window, select
from estim.common import Kind
from estim.model import Body, trajectory, turning_point
from estim.problem.noise import Differentiated, Independent
from estim.problem.priors import HalfNormal, LogNormal, Normal, TruncatedNormal, Uniform
from estim.reading.toml import locate_keys
from estim.words import describe

DEGREE = math.pi / 180
PAPER = Body(radius=0.15, gamma=0.187, kappa=0.45)

BASE = """\
title = "two runs"
kind = "synthetic"

[shared]
g = 9.81
radius_m = "0.1500(5)"
rolling_resistance = {prior = "half-normal", scale = 0.005}
noise = {sigma_x_m = 0.001}

[bodies.heavy]
gamma = "0.187(10)"
kappa = {prior = "uniform", low = 0.0, high = 1.0}

[bodies.light]
gamma = "0.094(10)"
kappa = 0.45

[[runs]]
name = "h4"
body = "heavy"
file = "h4.csv"
phi_deg = "4.0(4)"
theta0_deg = "60.0(15)"

[[runs]]
name = "h6"
body = "heavy"
file = "h6.csv"
phi_deg = "6.0(4)"
theta0_deg = "60.0(15)"
"""


def motion_table(phi=4.0, theta0=60.0, *, frames=45, rate=30, columns="t_s,x_m"):
    """An exact run from just after the release until `frames` or the turn."""
    t = 0.02 + np.arange(frames) / rate
    x, v = (a[0] for a in trajectory(t, PAPER, phi=phi * DEGREE, theta0=theta0 * DEGREE, g=9.81))
    known = {
        "t_s": t,
        "x_m": x,
        "v_m_s": v,
        "theta_rad": x / 0.15,
        "omega_rad_s": v / 0.15,
        "sigma_v_m_s": np.full(frames, 0.02),
    }
    names = columns.split(",")
    rows = [
        ",".join(f"{known[name][i]:.6f}" for name in names)
        for i in range(frames)
        if np.isfinite(x[i])
    ]
    return "\n".join([columns, *rows, ""])


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "h4.csv").write_text(motion_table())
    (tmp_path / "h6.csv").write_text(motion_table(6.0))
    return tmp_path


@pytest.fixture
def load(folder):
    """Writes BASE with pairs of (old, new) replaced, each old found exactly once, and loads it."""

    def load(*edits, base=BASE):
        text = base
        for old, new in edits:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        (folder / "campaign.toml").write_text(text)
        return load_campaign(folder / "campaign.toml")

    return load


def parameters(campaign, *names):
    return {p.name: p for p in campaign.problem(names or campaign.run_names).parameters}


RUN_H4 = 'phi_deg = "4.0(4)"\ntheta0_deg = "60.0(15)"\n'


# levels


def test_what_is_declared_at_a_level_is_one_unknown_there(load):
    assert list(parameters(load())) == [
        "gamma[heavy]", "kappa[heavy]", "rolling_resistance", "radius", "theta0[h4]", "phi[h4]",
        "theta0[h6]", "phi[h6]",
    ]  # fmt: skip
    assert list(parameters(load(), "h6")) == [
        "gamma[heavy]",
        "kappa[heavy]",
        "theta0[h6]",
        "phi[h6]",
        "rolling_resistance",
        "radius",
    ]


def test_bodies_keep_their_own_unknowns(load):
    names = set(parameters(load(('name = "h6"\nbody = "heavy"', 'name = "h6"\nbody = "light"'))))
    assert {"gamma[heavy]", "gamma[light]", "kappa[heavy]"} <= names
    assert "kappa[light]" not in names  # a plain number is exact


def test_the_most_particular_level_wins(load):
    campaign = load(
        (RUN_H4, RUN_H4 + 'gamma = "0.20(1)"\nradius_m = 0.151\n'),
        ('kappa = {prior = "uniform", low = 0.0, high = 1.0}', "kappa = 0.4"),
    )
    found = parameters(campaign)
    assert {"gamma[h4]", "gamma[heavy]", "radius"} <= set(found)
    assert found["gamma[h4]"].prior.centre == 0.20
    first, second = campaign.problem(["h4", "h6"]).runs
    assert first.arguments["gamma"] == "gamma[h4]"
    assert second.arguments["gamma"] == "gamma[heavy]"
    assert (first.arguments["radius"], second.arguments["radius"]) == (0.151, "radius")
    assert first.arguments["kappa"] == second.arguments["kappa"] == 0.4


def test_a_slope_common_to_all_runs_is_one_unknown(load):
    campaign = load(
        ("g = 9.81", 'g = 9.81\nphi_deg = "5.0(4)"'),
        ('phi_deg = "4.0(4)"\n', ""),
        ('phi_deg = "6.0(4)"\n', ""),
    )
    assert [n for n in parameters(campaign) if n.startswith("phi")] == ["phi"]


def test_a_quantity_of_a_body_is_shared_by_its_runs_only(load):
    campaign = load(('gamma = "0.187(10)"', 'gamma = "0.187(10)"\ng = "9.81(1)"'))
    assert "g[heavy]" in parameters(campaign)


def test_defaults_are_exact(load):
    run = (
        load(
            ('rolling_resistance = {prior = "half-normal", scale = 0.005}\n', ""),
            ("g = 9.81\n", ""),
        )
        .problem(["h4"])
        .runs[0]
    )
    assert run.arguments["g"] == 9.80665
    assert run.arguments["rolling_resistance"] == 0.0
    assert (
        run.arguments["rho"],
        run.arguments["trailing_fraction"],
        run.arguments["particle_gyration"],
    ) == (1.0, 0.0, 0.0)


def test_degrees_become_radians_with_their_uncertainties(load):
    found = parameters(load())
    assert found["phi[h4]"].prior == Normal(4.0 * DEGREE, 0.4 * DEGREE)
    assert (found["phi[h4]"].unit, found["radius"].unit, found["gamma[heavy]"].unit) == (
        "rad",
        "m",
        "1",
    )
    in_radians = parameters(
        load(('phi_deg = "4.0(4)"', f'phi_rad = "{4 * DEGREE:.12f} +/- {0.4 * DEGREE:.12f}"'))
    )["phi[h4]"].prior
    assert in_radians.centre == pytest.approx(4.0 * DEGREE, rel=1e-9)
    assert in_radians.sd == pytest.approx(0.4 * DEGREE, rel=1e-9)


def test_bound_runs_carry_their_tables(load):
    campaign = load()
    assert (campaign.title, campaign.kind, campaign.run_names) == (
        "two runs",
        "synthetic",
        ("h4", "h6"),
    )
    assert [run.name for run in campaign.problem(["h6", "h4"]).runs] == ["h6", "h4"]
    with pytest.raises(
        InputError, match=r"campaign\.toml: 'run' must name one of the runs \(h4, h6\): h5"
    ):
        campaign.problem(["h5"])


# priors


@pytest.mark.parametrize(
    ("table", "prior"),
    [
        ('{prior = "normal", mean = 0.45, sd = 0.02}', Normal(0.45, 0.02)),
        ('{prior = "uniform", low = 0.3, high = 0.6}', Uniform(0.3, 0.6)),
        ('{prior = "half-normal", scale = 0.5}', HalfNormal(0.5)),
        ('{prior = "log-normal", median = 0.45, log_sd = 0.1}', LogNormal(0.45, 0.1)),
        (
            '{prior = "truncated-normal", mean = 0.45, sd = 0.1, low = 0.4}',
            TruncatedNormal(0.45, 0.1, 0.4, math.inf),
        ),
        (
            '{prior = "truncated-normal", mean = 0.45, sd = 0.1, low = 0.4, high = 0.5}',
            TruncatedNormal(0.45, 0.1, 0.4, 0.5),
        ),
        ('"0.45(2)"', Normal(0.45, 0.02)),
        ('"0.05(2)"', TruncatedNormal(0.05, 0.02, 0.0, math.inf)),  # zero is within reach
    ],
)
def test_each_way_to_say_what_is_known(load, table, prior):
    campaign = load(('kappa = {prior = "uniform", low = 0.0, high = 1.0}', f"kappa = {table}"))
    found = parameters(campaign)["kappa[heavy]"].prior
    assert type(found) is type(prior)
    value = np.linspace(0.01, 0.99, 9)
    assert found.log_density(value) == pytest.approx(prior.log_density(value), rel=1e-9)


def test_a_normal_prior_is_cut_at_the_physical_limit_like_the_measured_value_it_means(load):
    said = [
        parameters(load((KAPPA, f"kappa = {v}")))["kappa[heavy]"].prior
        for v in ('"0.10(8)"', '{prior = "normal", mean = 0.10, sd = 0.08}')
    ]
    assert [prior.low for prior in said] == [0.0, 0.0]


def test_a_prior_in_degrees_is_scaled_but_not_its_logarithmic_width(load):
    found = parameters(
        load(
            (
                'theta0_deg = "60.0(15)"\n\n',
                'theta0_deg = {prior = "log-normal", median = 60.0, log_sd = 0.1}\n\n',
            ),
            ('phi_deg = "4.0(4)"', 'phi_deg = {prior = "uniform", low = 3.0, high = 5.0}'),
        )
    )
    assert found["theta0[h4]"].prior == LogNormal(60.0 * DEGREE, 0.1)
    assert (found["phi[h4]"].prior.low, found["phi[h4]"].prior.high) == pytest.approx(
        (3 * DEGREE, 5 * DEGREE)
    )


def test_gamma_follows_from_the_masses_with_their_uncertainties(load):
    masses = (
        'mass_disk_kg = "0.303(1)"\nmass_particle_kg = "0.0697(46)"\nmass_trailing_kg = '
        '"0.050(2)"\nrho = "0.90(1)"'
    )
    found = parameters(load(('gamma = "0.187(10)"', masses)))
    disk, particle, trailing, rho = (
        ufloat(0.303, 0.001),
        ufloat(0.0697, 0.0046),
        ufloat(0.05, 0.002),
        ufloat(0.9, 0.01),
    )
    gamma, share = (
        particle * rho / (disk + particle + trailing),
        trailing / (disk + particle + trailing),
    )
    for name, expected in (("gamma[heavy]", gamma), ("trailing_fraction[heavy]", share)):
        assert found[name].prior.centre == pytest.approx(expected.nominal_value, rel=1e-12)
        assert found[name].prior.sd == pytest.approx(expected.std_dev, rel=1e-9)
    assert "rho[heavy]" in found


def test_exact_masses_make_an_exact_gamma(load):
    campaign = load(('gamma = "0.187(10)"', "mass_disk_kg = 0.303\nmass_particle_kg = 0.0697"))
    run = campaign.problem(["h4"]).runs[0]
    assert run.arguments["gamma"] == pytest.approx(0.0697 / 0.3727, rel=1e-14)
    assert run.motion.mass == pytest.approx(0.3727)
    assert run.arguments["trailing_fraction"] == 0.0


def test_a_stated_gamma_goes_before_the_masses(load):
    campaign = load(
        ('gamma = "0.187(10)"', 'gamma = "0.187(10)"\nmass_disk_kg = 0.3\nmass_particle_kg = 0.07')
    )
    assert parameters(campaign)["gamma[heavy]"].prior.centre == 0.187
    assert campaign.problem(["h4"]).runs[0].motion.mass == pytest.approx(0.37)


# noise


def test_positions_and_times_are_differentiated_by_the_midpoint_rule(load):
    noise = load().problem(["h4"]).runs[0].noise
    assert isinstance(noise, Differentiated)
    assert (noise.derivative.stencil.name, noise.sigma.value, noise.scatter.value) == (
        "central",
        0.001,
        0.0,
    )


def test_the_derivative_can_be_chosen(load):
    run = (
        load(("{sigma_x_m = 0.001}", '{sigma_x_m = 0.001, derivative = "spill2"}'))
        .problem(["h4"])
        .runs[0]
    )
    assert run.noise.derivative.stencil.name == "spill2"


def test_an_uncertain_sigma_is_inferred_and_named_after_its_level(load):
    for edits, name in (
        ((("sigma_x_m = 0.001", 'sigma_x_m = "0.0010(3)"'),), "sigma_x"),
        (
            (
                (
                    RUN_H4,
                    RUN_H4 + 'noise = {sigma_x_m = {prior = "log-normal", median = 0.001, log_sd = '
                    "0.5}}\n",
                ),
            ),
            "sigma_x[h4]",
        ),
        (
            (
                (
                    "sigma_x_m = 0.001",
                    'sigma_x_m = 0.001, scatter = {prior = "half-normal", scale = 0.01}',
                ),
            ),
            "scatter",
        ),
        (
            (('gamma = "0.187(10)"', 'gamma = "0.187(10)"\nnoise = {sigma_x_m = "0.001(1)"}'),),
            "sigma_x[heavy]",
        ),
    ):
        problem = load(*edits).problem(["h4"])
        assert problem.noise_names == {name}
        assert problem.parameters[-1].name == name
        assert problem.parameters[-1].prior.low == 0.0


def test_speeds_of_their_own_are_independent(load, folder):
    (folder / "h4.csv").write_text(motion_table(columns="x_m,v_m_s"))
    run = load((RUN_H4, RUN_H4 + "noise = {sigma_v_m_s = 0.02}\n")).problem(["h4"]).runs[0]
    assert isinstance(run.noise, Independent)
    assert run.t is None
    assert run.noise.sigma.value == 0.02
    (folder / "h4.csv").write_text(motion_table(columns="x_m,v_m_s,sigma_v_m_s"))
    run = load((RUN_H4, RUN_H4 + 'noise = {model = "independent"}\n')).problem(["h4"]).runs[0]
    assert run.noise.relative == pytest.approx(np.full(run.n_obs, 0.02))


def test_measured_angles_are_a_run_too(load, folder):
    (folder / "h4.csv").write_text(motion_table(columns="t_s,theta_rad"))
    run = load((RUN_H4, RUN_H4 + "noise = {encoder_step_rad = 0.0126}\n")).problem(["h4"]).runs[0]
    assert run.curve.angular
    assert (run.x_unit, run.y_unit) == ("rad", "rad/s")
    assert run.noise.size.quantisation_variance == pytest.approx(0.0126**2 / 12)


# which rows are fit


def test_frames_near_the_release_and_the_turn_are_left_out_and_counted(load):
    campaign = load()
    table, run = campaign.tables["h4"], campaign.problem(["h4"]).runs[0]
    end = float(turning_point(PAPER, phi=4 * DEGREE, theta0=60 * DEGREE))
    x = table.columns["x_m"]
    assert end - x.max() < 0.005
    inside = x[1:-1]  # where the midpoint rule exists
    kept = (inside >= 0.005) & (inside <= inside.max() - 0.005)
    assert run.x == pytest.approx(inside[kept])
    assert sorted(map(describe, run.excluded)) == sorted(
        [
            "2 at the ends or next to a missing frame, where the central derivative cannot "
            "be computed",
            f"{np.sum(inside < 0.005)} less than five standard deviations of a reading away "
            "from the release",
            f"{np.sum(inside > inside.max() - 0.005)} less than five standard deviations of "
            "a reading away from the turning point",
        ]
    )
    assert run.excluded_points.shape == (inside.size - run.n_obs, 2)
    assert sum(why.size for why in run.excluded) + run.n_obs == table.n_row


def test_the_guard_grows_with_the_error_of_a_position(load):
    fine, coarse = (
        load(("sigma_x_m = 0.001", f"sigma_x_m = {s}")).problem(["h4"]).runs[0]
        for s in (0.0002, 0.004)
    )
    assert fine.x.min() < 0.02 <= coarse.x.min()
    assert fine.n_obs > coarse.n_obs


@pytest.mark.parametrize(
    ("window", "gone"), [("{x_min_m = 0.0}", "release"), ("{x_max_m = 1.0}", "turning point")]
)
def test_a_window_that_names_an_end_keeps_its_frames(load, window, gone):
    plain = load().problem(["h4"]).runs[0]
    run = load((RUN_H4, RUN_H4 + f"window = {window}\n")).problem(["h4"]).runs[0]
    assert any(gone in describe(why) for why in plain.excluded)
    assert not any(gone in describe(why) for why in run.excluded)
    assert run.n_obs > plain.n_obs
    both = (
        load((RUN_H4, RUN_H4 + "window = {x_min_m = 0.0, x_max_m = 1.0}\n")).problem(["h4"]).runs[0]
    )
    assert tuple(map(describe, both.excluded)) == (
        "2 at the ends or next to a missing frame, where the central derivative cannot be computed",
    )


def test_a_window_cuts_position_and_time(load):
    run = (
        load((RUN_H4, RUN_H4 + "window = {x_min_m = 0.1, x_max_m = 0.3, t_min_s = 0.7}\n"))
        .problem(["h4"])
        .runs[0]
    )
    assert 0.1 <= run.x.min() < run.x.max() <= 0.3
    assert run.t.min() >= 0.7
    assert {Kind.OUTSIDE_POSITIONS, Kind.OUTSIDE_TIMES} <= {why.kind for why in run.excluded}


def test_the_most_particular_window_stands_alone(load):
    campaign = load(
        ("g = 9.81", "g = 9.81\nwindow = {x_min_m = 0.2, x_max_m = 0.3}"),
        (RUN_H4, RUN_H4 + "window = {x_min_m = 0.1}\n"),
    )
    first, second = campaign.problem(["h4", "h6"]).runs
    assert 0.1 <= first.x.min() < 0.2
    assert first.x.max() > 0.4
    assert 0.2 <= second.x.min() < second.x.max() <= 0.3


def test_a_run_that_ends_at_full_speed_has_no_turning_point_to_avoid(load, folder):
    (folder / "h4.csv").write_text(motion_table(frames=24))
    run = load().problem(["h4"]).runs[0]
    assert not any("turning point" in describe(why) for why in run.excluded)
    assert run.x.max() == pytest.approx(
        float((folder / "h4.csv").read_text().splitlines()[-2].split(",")[1])
    )


def test_the_way_back_is_another_motion():
    t = np.arange(40) * 0.1
    x = 0.3 * np.sin(0.8 * t)  # turns at t = 1.96
    open_window = Window(-math.inf, math.inf, -math.inf, math.inf)
    chosen = select(x, np.gradient(x, t), t, window=open_window, sigma_position=0.0)
    assert t[chosen.indices].max() == pytest.approx(2.0)
    assert tuple(map(describe, chosen.reasons)) == (
        "19 after the farthest point (the way back is another motion)",
    )


def test_measured_speeds_have_no_guard_zones(load, folder):
    (folder / "h4.csv").write_text(motion_table(columns="t_s,x_m,v_m_s"))
    run = (
        load((RUN_H4, RUN_H4 + 'noise = {model = "independent", sigma_v_m_s = 0.02}\n'))
        .problem(["h4"])
        .runs[0]
    )
    assert run.excluded == ()
    assert run.n_obs == 42


# mistakes

KAPPA = 'kappa = {prior = "uniform", low = 0.0, high = 1.0}'
NOISE = "noise = {sigma_x_m = 0.001}"
# what stands there -> what is written instead; the text that marks the line to be named; what is
# said
MISTAKES = {
    "typo in a key": ('gamma = "0.187(10)"', 'gama = "0.187(10)"', "gama", "'gama' is not a known "
        "key here (did you mean 'gamma'?)"),
    "typo in a run": ('phi_deg = "4.0(4)"', 'phi_degr = "4.0(4)"', "phi_degr",
    "'phi_degr' is not a "
        "known key here (did you mean 'phi_deg'?)"),
    "typo in noise": (NOISE, "noise = {sigma_xm = 0.001}", "noise", "'sigma_xm' is not a known "
        "key here (did you mean 'sigma_x_m'?)"),
    "unknown table": ("[bodies.light]", "[bodys.light]", "[bodys.light]", "'bodys' is not a known "
        "key here (did you mean 'bodies'?)"),
    "unknown kind": ('kind = "synthetic"', 'kind = "invented"', "kind", "'kind' must be one of "
        "synthetic, measured, published: invented"),
    "no title": ('title = "two runs"\n', "", None, "'title' is missing"),
    "no name": ('name = "h4"\n', "", "[[runs]]", "'name' is missing"),
    "number for a name": ('name = "h4"', "name = 4", "name = 4", "'name' must be text, not a "
        "whole number"),
    "list for a number": ('phi_deg = "4.0(4)"', "phi_deg = [4.0, 0.4]", "phi_deg",
    "'phi_deg' must be a "
        "number or text or a table, not a list"),
    "truth for a number": ("g = 9.81", "g = true", "g =", "'g' must be a number or text or a "
        "table, not true or false"),
    "unreadable quantity": (
        'phi_deg = "4.0(4)"', 'phi_deg = "about 4"', "phi_deg",
        "'phi_deg' must be a number as 4.0, or read like \"4.0 +/- 0.4\" or \"4.0(4)\", without "
        "a unit: about 4",
    ),
    "number that is none": ("g = 9.81", "g = nan", "g =", "'g' must be finite: nan"),
    "unknown body": (
        'name = "h6"\nbody = "heavy"', 'name = "h6"\nbody = "heavey"', 'body = "heavey"',
        "'body' must name one of the bodies (heavy, light): heavey",
    ),
    "same name twice": ('name = "h6"', 'name = "h4"', None, "'name' must be unique (the other "
        "stands on line 19): h4"),
    "name with a slash": ('name = "h6"', 'name = "../h6"', 'name = "../h6"', "'name' must be made "
        "of letters, digits and . _ + -"),
    "name of a file of the report": (
        'name = "h6"', 'name = "Report.md"', 'name = "Report.md"', "'name' must not be the name "
            "of a file of the report: Report.md",
    ),
    "name too long for a file": (
        'name = "h6"', f'name = "{"h" * 101}"', 'name = "hhh', "'name' must be short enough for "
            "the name of a file: at most 100 bytes: hhh",
    ),
    "no phi": ('phi_deg = "4.0(4)"\n', "", "[[runs]]", "'phi_deg' is missing for run 'h4': say it "
        "there, for its body or under [shared]"),
    "no gamma": (
        'gamma = "0.187(10)"\n', "", "[[runs]]",
        "'gamma' is missing for run 'h4': say it there, for its body or under [shared] (or "
            "give the masses)",
    ),
    "degrees beside radians": ('phi_deg = "4.0(4)"', 'phi_deg = "4.0(4)"\nphi_rad = 0.07',
    "phi_rad", "'phi_rad' must not "
        "stand beside 'phi_deg'"),
    "negative radius": ('radius_m = "0.1500(5)"', 'radius_m = "-0.1500(5)"', "radius_m",
    "'radius_m' must be "
        "> 0: -0.15"),
    "no radius at all": ('radius_m = "0.1500(5)"', "radius_m = 0.0", "radius_m",
    "'radius_m' must be > 0: 0.0"),
    "negative gamma": ('gamma = "0.187(10)"', "gamma = -0.1", "gamma = -0.1",
    "'gamma' must be >= 0: -0.1"),
    "unknown prior": (KAPPA, 'kappa = {prior = "flat", low = 0.0}', "kappa = {",
    "'prior' must be one "
        "of normal, uniform, "),
    "prior without a key": (KAPPA, 'kappa = {prior = "uniform", low = 0.0}', "kappa = {",
    "'kappa' needs "
        "'high' for a uniform prior"),
    "prior with a key too many": (
        KAPPA, 'kappa = {prior = "half-normal", scale = 1.0, low = 0.1}', "kappa = {",
        "'kappa' takes no 'low' with a half-normal prior",
    ),
    "prior upside down": (
        KAPPA, 'kappa = {prior = "uniform", low = 1.0, high = 0.0}', "kappa = {",
        "'kappa' has a prior whose 'low' must be below 'high': 1.0",
    ),
    "prior without width": (
        KAPPA, 'kappa = {prior = "normal", mean = 0.4, sd = 0.0}', "kappa = {",
        "'kappa' has a prior whose 'sd' must be > 0 and finite: 0.0",
    ),
    "infinite prior": (KAPPA, 'kappa = {prior = "uniform", low = 0.0, high = inf}', "kappa = {",
    "'kappa' needs a "
        "finite 'high': inf"),
    "one mass missing": ('gamma = "0.187(10)"', "mass_disk_kg = 0.3", "[bodies.heavy]",
    "'mass_particle_kg' "
        "is missing: the other masses are given"),
    "masses against gamma": (
        'gamma = "0.187(10)"', 'gamma = "0.187(10)"\nmass_disk_kg = "0.300(1)"\nmass_particle_kg '
            '= "0.130(1)"', "gamma = ",
        "'gamma' contradicts the stated masses, which give 0.3023 ± 0.0018: state only one "
            "of the two: 0.187",
    ),
    "masses against an exact gamma": (
        'gamma = "0.187(10)"', "gamma = 0.187\nmass_disk_kg = 0.3\nmass_particle_kg = 0.08",
        "gamma = ", "'gamma' contradicts "
            "the stated masses",
    ),
    "negative mass": (
        'gamma = "0.187(10)"', "mass_disk_kg = 0.3\nmass_particle_kg = -0.1", "mass_particle_kg",
        "'mass_particle_kg' must be >= 0: -0.1",
    ),
    "no noise": (NOISE + "\n", "", "[[runs]]", "'noise' is missing for run 'h4', for example "
        "noise = {sigma_x_m = 0.001}"),
    "no sigma of positions": (
        NOISE,
        'noise = {model = "positions", robust = "mixture"}',
        "noise",
        "for position noise",
    ),
    "no sigma": (NOISE, 'noise = {derivative = "central"}', "noise", "'noise' needs 'sigma_x_m' "
        "for differentiated noise"),
    "sigma of zero": (NOISE, "noise = {sigma_x_m = 0}", "noise", "'sigma_x_m' must be > 0: 0"),
    "sigma below zero": (NOISE, 'noise = {sigma_x_m = {prior = "uniform", low = -0.1, high = 0.1}}',
    "noise", "'sigma_x_m' is a "
        "standard deviation"),
    "sigma of the other coordinate": (
        NOISE, "noise = {sigma_theta_rad = 0.01}", "noise",
        "'sigma_theta_rad' does not go with differentiated noise of a run in m",
    ),
    "sigma of the speed": (
        NOISE, "noise = {sigma_x_m = 0.001, sigma_v_m_s = 0.1}", "noise",
        "'sigma_v_m_s' does not go with differentiated noise of a run in m",
    ),
    "unknown derivative": (NOISE, 'noise = {sigma_x_m = 0.001, derivative = "best"}', "noise",
    "'derivative' must be one of "),
    "independent without speeds": (
        NOISE, 'noise = {model = "independent"}', "noise",
        "'model' needs measured speeds: the run's file has no v_m_s column (or a "
            "'derivative' to compute them): independent",
    ),
    "window upside down": (
        RUN_H4, RUN_H4 + "window = {x_min_m = 0.3, x_max_m = 0.1}\n", "window",
        "'window' must have its lower limits below its upper ones",
    ),
    "window of the other coordinate": (
        RUN_H4, RUN_H4 + "window = {theta_max_rad = 9.0}\n", "window",
        "'theta_max_rad' does not fit a run whose positions are x_m",
    ),
    "window that leaves nothing": (
        RUN_H4, RUN_H4 + "window = {x_min_m = 7.0}\n", "window",
        "'window' must leave between 5 and 10000 of the 42 rows of ",
    ),
    "window with nan": (RUN_H4, RUN_H4 + "window = {x_min_m = nan}\n", "window",
    "'x_min_m' must be "
        "finite: nan"),
    "line with an unknown body": (
        "[[runs]]\nname = \"h4\"", '[line]\nfile = "l.csv"\nbody = "x"\n[[runs]]\nname = "h4"',
        'body = "x"',
        "'body' must name one of the bodies",
    ),
    "syntax error": ('phi_deg = "4.0(4)"', "phi_deg = 4.0(4)", "phi_deg",
    "'file' is not valid TOML, in which text and values with an uncertainty stand in quotes ("),
    "g in cm/s²": ("g = 9.81", "g = 981.0", "g = 981", "'g' is in m/s², and must be at most 500"),
    "key twice": ("g = 9.81", "g = 9.81\ng = 9.8", "g = 9.8\n", "'file' is not valid TOML ("),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_with_file_line_key_and_rule(load, folder, mistake):
    old, new, mark, told = MISTAKES[mistake]
    with pytest.raises(InputError) as caught:
        load((old, new))
    message = str(caught.value)
    assert told in message
    text = (folder / "campaign.toml").read_text()
    place = str(folder / "campaign.toml")
    line = "" if mark is None else text[: text.index(mark)].count("\n") + 1
    assert message.startswith(f"{place}:{line}: " if line else place)
    assert "\n" not in message


def test_the_second_run_of_a_name_is_the_one_blamed(load, folder):
    with pytest.raises(InputError) as caught:
        load(('name = "h6"', 'name = "h4"'))
    text = (folder / "campaign.toml").read_text()
    assert caught.value.line == text[: text.rindex('name = "h4"')].count("\n") + 1


def test_a_mistake_in_the_second_run_names_its_own_line(load, folder):
    with pytest.raises(InputError) as caught:
        load(('phi_deg = "6.0(4)"', 'phi_deg = "six"'))
    assert (folder / "campaign.toml").read_text().splitlines()[
        caught.value.line - 1
    ] == 'phi_deg = "six"'


def test_noise_in_a_table_of_its_own_is_found_there(load, folder):
    with pytest.raises(InputError) as caught:
        load((RUN_H4, RUN_H4 + "[runs.noise]\nsigma_x_m = -0.001\n"))
    assert (folder / "campaign.toml").read_text().splitlines()[
        caught.value.line - 1
    ] == "sigma_x_m = -0.001"


def test_sigma_stated_twice_is_refused(load, folder):
    (folder / "h4.csv").write_text(motion_table(columns="x_m,v_m_s,sigma_v_m_s"))
    with pytest.raises(
        InputError,
        match=r":\d+: 'sigma_v_m_s' is stated twice: here and in the sigma_v_m_s column of "
        r".*h4\.csv",
    ):
        load((RUN_H4, RUN_H4 + "noise = {sigma_v_m_s = 0.02}\n"))


def test_a_column_of_sigmas_is_used_or_refused_but_never_ignored(load, folder):
    table = motion_table().replace("t_s,x_m", "t_s,x_m,sigma_x_m").splitlines()
    (folder / "h4.csv").write_text(
        "\n".join([table[0], *(f"{row},0.005" for row in table[1:]), ""])
    )
    with pytest.raises(InputError, match="sigma_x_m"):
        load()


def test_sigmas_of_speeds_in_metres_are_refused_for_rates_in_radians(load, folder):
    (folder / "h4.csv").write_text(motion_table(columns="theta_rad,omega_rad_s,sigma_v_m_s"))
    with pytest.raises(InputError, match="sigma_v_m_s"):
        load((RUN_H4, RUN_H4 + 'noise = {model = "independent"}\n'))


@pytest.mark.parametrize("names", [(), ("h4", "h4")])
def test_a_problem_has_at_least_one_run_and_none_twice(load, names):
    campaign = load()
    with pytest.raises(InputError, match="'run"):
        campaign.problem(names)


def test_differentiated_without_times_is_refused(load, folder):
    (folder / "h4.csv").write_text(motion_table(columns="x_m,v_m_s"))
    with pytest.raises(
        InputError,
        match=r":\d+: 'model' needs times: the run's file has no t_s column: differentiated",
    ):
        load((RUN_H4, RUN_H4 + 'noise = {model = "differentiated", sigma_x_m = 0.001}\n'))


def test_the_table_of_a_run_is_checked_with_its_own_lines(load, folder):
    (folder / "h6.csv").write_text("t_s,x_m\n0,0\n0.1,x\n")
    with pytest.raises(
        InputError, match=rf"^{re.escape(str(folder / 'h6.csv'))}:3: 'x_m' must be a number: x$"
    ):
        load()
    (folder / "h6.csv").unlink()
    with pytest.raises(
        InputError,
        match=r"campaign\.toml:\d+: 'file' cannot be found \(no such file; names are relative to "
        r".*\): h6\.csv$",
    ):
        load()


def test_a_file_name_that_cannot_be_is_refused_in_words(load):
    with pytest.raises(InputError, match=r"'file' cannot be found .*h4.*\.csv"):
        load(('file = "h4.csv"', 'file = "h4\\u0000.csv"'))
    with pytest.raises(InputError, match=r"hhh.*: cannot be read \(file name too long\)"):
        load(('file = "h4.csv"', f'file = "{"h" * 300}.csv"'))


def test_a_campaign_needs_something_to_do(load):
    with pytest.raises(
        InputError,
        match=r"'campaign' must hold at least one \[\[runs\]\] table, a \[line\] or a \[trials\] "
        r"table",
    ):
        load(base='title = "a"\nkind = "measured"\n')


def test_a_missing_campaign_is_named(tmp_path):
    with pytest.raises(
        InputError, match=r"none\.toml: cannot be read \(no such file or directory\)$"
    ):
        load_campaign(tmp_path / "none.toml")


def test_deep_nesting_is_refused_in_words(tmp_path):
    (tmp_path / "c.toml").write_text("title = " + "[" * 100_000)
    with pytest.raises(InputError, match=r"c\.toml"):
        load_campaign(tmp_path / "c.toml")


@pytest.mark.parametrize(
    "edit",
    [
        pytest.param(('phi_deg = "4.0(4)"', 'phi_deg = "4.0(0)"'), id="zero uncertainty"),
        pytest.param(('phi_deg = "4.0(4)"', 'phi_deg = "4.0 +/- -0.4"'), id="negative uncertainty"),
        pytest.param(
            (KAPPA, 'kappa = {prior = "uniform", low = -0.5, high = 1.0}'),
            id="prior that reaches below the physical limit",
        ),
        pytest.param(
            ('radius_m = "0.1500(5)"', 'radius_m = {prior = "uniform", low = -0.1, high = 0.4}'),
            id="prior of a radius around 0",
        ),
        pytest.param(('gamma = "0.187(10)"', "gamma = 1.2"), id="centre of mass outside the disk"),
        pytest.param(
            ('gamma = "0.187(10)"', 'gamma = "0.187(10)"\ntrailing_fraction = 1.5'),
            id="more trailing mass than mass",
        ),
        pytest.param(
            ('gamma = "0.187(10)"', "mass_disk_kg = inf\nmass_particle_kg = 0.1"),
            id="infinite mass",
        ),
        pytest.param(("g = 9.81", "g = 1" + "0" * 400), id="number too long for a float"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(load, edit):
    with pytest.raises(InputError, match=r"campaign\.toml:\d+: '"):
        load(edit)


# lines of keys


def test_keys_are_located_by_their_path():
    text = 'a = 1\n[shared]\nb = 2\nnoise = {x = 1}\n\n[bodies."my disk"]\n# c = 0\n  c.d = 3\n'
    text += "[[runs]]\ne = 1\n[[runs]] # second\ne = 2\n[runs.noise]\nf = 3\n"
    lines = locate_keys(text)
    assert lines[("a",)] == 1
    assert lines[("shared", "b")] == 3
    assert lines[("bodies", "my disk", "c")] == lines[("bodies", "my disk", "c", "d")] == 8
    assert [lines[("runs", i, "e")] for i in (0, 1)] == [10, 12]
    assert lines[("runs", 1, "noise", "f")] == 14
    assert ("c",) not in lines


# the replica


def test_the_replica_loads_with_the_expected_unknowns(replica):
    campaign = load_campaign(replica / "campaign.toml")
    assert campaign.kind == "synthetic"
    problem = campaign.problem(campaign.run_names)
    shared = {
        "radius",
        "rolling_resistance",
        "gamma[heavy]",
        "gamma[light]",
        "kappa[heavy]",
        "kappa[light]",
    }
    assert set(problem.names) == shared | {
        f"{angle}[{run}]" for angle in ("phi", "theta0") for run in campaign.run_names
    }
    assert campaign.problem(["heavy-04"]).n_par == 6


# units


def scaled(text, *, t=1.0, x=1.0):
    """A table whose columns are multiplied."""
    head, *rows = text.split()
    return "\n".join(
        [
            head,
            *(f"{float(a) * t!r},{float(b) * x!r}" for a, b in (row.split(",") for row in rows)),
            "",
        ]
    )


WRONG_UNITS = {
    "positions in cm": (
        {"x": 100.0},
        "'x_m' reaches 44.",
        "is it in cm or mm, or the time not in s?",
    ),
    "positions in mm": (
        {"x": 1000.0},
        "'x_m' reaches 44",
        "is it in cm or mm, or the time not in s?",
    ),
    "times in ms": ({"t": 1000.0}, "'t_s' spans 1", "is it in ms?"),
}


@pytest.mark.parametrize("model", ["differentiated", "positions"])
@pytest.mark.parametrize("case", WRONG_UNITS)
def test_units_that_energy_forbids_are_asked_about(load, folder, case, model):
    factors, start, question = WRONG_UNITS[case]
    (folder / "h6.csv").write_text(scaled(motion_table(), **factors))
    with pytest.raises(InputError) as caught:
        load((NOISE, f'noise = {{sigma_x_m = 0.001, model = "{model}"}}'))
    assert str(caught.value).startswith(f"{folder / 'h6.csv'}: {start}")
    assert str(caught.value).endswith(question)


@pytest.mark.parametrize("radius", ["15.00(5)", "150.0(5)"])
@pytest.mark.parametrize("model", ["differentiated", "positions"])
def test_a_radius_in_cm_or_mm_is_asked_about(load, radius, model):
    with pytest.raises(InputError) as caught:
        load(
            ('radius_m = "0.1500(5)"', f'radius_m = "{radius}"'),
            (NOISE, f'noise = {{sigma_x_m = 0.001, model = "{model}"}}'),
        )
    told = str(caught.value)
    assert re.search(
        r"campaign\.toml:\d+: 'radius_m' must be in m: with this radius the body", told
    )
    assert told.endswith(f"(is it in cm or mm?): {radius}")


def test_a_large_wheel_that_turns_is_not_asked_about(load):
    load(('radius_m = "0.1500(5)"', 'radius_m = "1.500(5)"'))


def test_angles_in_degrees_and_speeds_in_cm_are_asked_about(load, folder):
    noise = (NOISE, "noise = {sigma_theta_rad = 0.01}")
    text = motion_table(columns="t_s,theta_rad")
    for name in ("h4.csv", "h6.csv"):
        (folder / name).write_text(text)
    load(noise)
    (folder / "h4.csv").write_text(scaled(text, x=180.0 / math.pi))
    with pytest.raises(
        InputError,
        match=r"h4\.csv: 'theta_rad' reaches .* is it in degrees, or the time not in s\?$",
    ):
        load(noise)


@pytest.mark.parametrize(
    ("radius", "phi"), [(0.01, -20.0), (0.15, -0.01), (0.01, -89.0), (1.0, -0.1)]
)
def test_a_wheel_that_rolls_down_is_never_asked_about(load, folder, radius, phi):
    """x = a t²/2 with a = g sin|phi|/(1 + kappa), for a point-like (kappa = 0) body: the fastest
    that can be, over hundreds of radii.
    """
    t = np.arange(40) / 30
    x = 0.5 * 9.81 * math.sin(-phi * DEGREE) * t**2
    text = "t_s,x_m\n" + "".join(
        f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), x.tolist(), strict=True)
    )
    for name in ("h4.csv", "h6.csv"):
        (folder / name).write_text(text)
    load(
        ('gamma = "0.187(10)"', "gamma = 0.0"),
        ('"0.1500(5)"', f"{radius}"),
        ('phi_deg = "4.0(4)"', f"phi_deg = {phi}"),
        ('phi_deg = "6.0(4)"', f"phi_deg = {phi}"),
        (NOISE, "noise = {sigma_x_m = 0.00001}"),
    )


# rows that are left


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda rows: rows * [1.0, -1.0],
            "'x_m' must increase as the body moves from its release: ",
        ),
        (
            lambda rows: rows * [1.0, 0.0] + 0.25,
            "'x_m' must increase as the body moves from its release: ",
        ),
        (lambda rows: rows[::8], "'rows to fit' must be at least 5 of the 6 in the file ("),
    ],
)
def test_rows_that_cannot_be_fit_are_told_without_a_window(load, folder, change, told):
    rows = np.array(
        [[float(cell) for cell in row.split(",")] for row in motion_table().split()[1:]]
    )
    (folder / "h4.csv").write_text(
        "t_s,x_m\n" + "".join(f"{t:.6f},{x:.6f}\n" for t, x in change(rows))
    )
    with pytest.raises(InputError) as caught:
        load()
    assert str(caught.value).startswith(f"{folder / 'h4.csv'}: {told}")
    assert "window" not in str(caught.value)
    with pytest.raises(
        InputError,
        match=r"campaign\.toml:\d+: 'window' must leave between 5 and 10000 of the \d+ rows of "
        r".*h4\.csv to fit: \d",
    ):
        load((RUN_H4, RUN_H4 + "window = {x_min_m = 0.0}\n"))


def test_the_keys_of_tracks_are_the_same_for_bodies_and_for_curves() -> None:
    """msgspec allows a record one base with fields, so that the keys stand in two."""
    of_runs, of_curves = (
        {one.name: (one.type, one.default) for one in msgspec.structs.fields(table)}
        for table in (RunTable, CurveRunTable)
    )
    assert set(TRACK_KEYS) == {"track", "along", "unit", "release", "frame_ms", "drop_duplicates"}
    assert {name: of_runs[name] for name in TRACK_KEYS} == {
        name: of_curves[name] for name in TRACK_KEYS
    }
