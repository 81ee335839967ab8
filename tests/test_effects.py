"""Known physics beside weight and plain rolling resistance, each a key of a campaign.  The data are
solved by SciPy (`benchmarks/truth`).
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from estim.campaign import Campaign, load_campaign
from estim.cli.commands import cli
from estim.common.errors import InputError
from estim.common.escaping import as_json
from estim.curves.rolling import MotionCurve, PhaseCurve
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.pipeline import analyse
from estim.reports.result import result_of
from estim.sampling import Target

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.recordings import (
    BASE,
    DISTURBANCES,
    Camera,
    Disturbance,
    changed,
    sagging,
    write_campaign,
)

WEIGHT = BASE.mass * BASE.g * BASE.radius  # N m
MASSES = "mass_disk_kg = 0.3252\nmass_particle_kg = 0.0748"
V0 = 0.15  # m/s
FEW = Target(ess=1000.0)  # means to 3 % of a standard deviation
E0 = (
    V0**2
    * (
        1.0
        + BASE.kappa * (1.0 - BASE.gamma)
        + BASE.gamma
        + 2.0 * BASE.gamma * np.cos(BASE.theta0 + BASE.phi)
    )
    / (2.0 * BASE.g * BASE.radius)
)


@dataclass(frozen=True)
class Effect:
    """Something that is true of a recording, the lines that say it under [shared], and the value of
    its parameter; noises that it goes with.
    """

    disturbance: Disturbance
    lines: str
    parameter: str
    value: float
    noises: tuple[str, ...] = ("speeds", "positions")


HALF = '{prior = "half-normal", scale = '
EFFECTS = {
    "energy": Effect(
        Disturbance("push", changed(release_speed=V0)),
        'release_energy = "0.000(20)"',
        "release_energy",
        E0,
        ("speeds",),
    ),
    "speed": Effect(
        Disturbance("push", changed(release_speed=V0)),
        'release_speed_m_s = "0.18(6)"',
        "release_speed",
        V0,
    ),
    "scale": Effect(
        Disturbance("scale", camera=Camera(scale_x=0.05)), 'scale_x = "0.00(5)"', "scale_x", 0.05
    ),
    "clock": Effect(
        Disturbance("clock", camera=Camera(scale_t=0.03)), 'scale_t = "0.00(5)"', "scale_t", 0.03
    ),
    "moment": Effect(
        Disturbance("moment", changed(moment=0.012 * WEIGHT)),
        f"{MASSES}\nresisting_moment_n_m = {HALF}0.01}}",
        "moment",
        0.012 * WEIGHT,
    ),
    "load": Effect(
        Disturbance("load", changed(load_resistance=0.03)),
        f"load_resistance = {HALF}0.03}}",
        "load_resistance",
        0.03,
        ("speeds",),
    ),
    "viscous": Effect(
        Disturbance("drag", changed(viscous=0.15 * BASE.mass)),
        f"viscous_drag_per_s = {HALF}0.2}}",
        "viscous_drag",
        0.15,
    ),
    "quadratic": Effect(
        Disturbance("drag", changed(quadratic=0.3 * BASE.mass)),
        f"quadratic_drag_per_m = {HALF}0.5}}",
        "quadratic_drag",
        0.3,
    ),
    "once": Effect(
        Disturbance("once", changed(once=(0.02 * WEIGHT, 0.0))),
        'moment_once_cos = "0.00(2)"\nmoment_once_sin = "0.00(2)"',
        "moment_once_cos",
        0.02,
    ),
    "twice": Effect(
        Disturbance("twice", changed(twice=(0.015 * WEIGHT, 0.5 * np.pi))),
        'moment_twice_cos = "0.00(2)"\nmoment_twice_sin = "0.00(2)"',
        "moment_twice_sin",
        0.015,
    ),
    "slope": Effect(
        Disturbance("bent", sagging(0.0015, 0.5, 0.25)),
        'phi_slope_deg_m = "0(3)"',
        "phi_slope",
        0.048,
    ),
    "sag": Effect(
        Disturbance("sag", sagging(0.003, 0.5, 0.03)),
        'sag_m = "0.000(3)"\nramp_length_m = 0.5\nramp_start_m = 0.03',
        "sag",
        0.003,
    ),
    "bow": Effect(
        Disturbance("bow", camera=Camera(bow=0.04)),
        'distortion_m = "0.00(4)"\npicture_length_m = 0.6\npicture_start_m = 0.05',
        "distortion",
        0.04,
    ),
}
CASES = [(name, noise) for name, effect in EFFECTS.items() for noise in effect.noises]


def recorded(
    folder: Path,
    effect: Effect,
    noise: str,
    *,
    lines: str | None = None,
    priors: str = "sharp",
    seed: int = 3,
) -> Campaign:
    write_campaign(
        folder, effect.disturbance, priors=priors, noise=noise, rng=np.random.default_rng(seed)
    )
    path = folder / "campaign.toml"
    path.write_text(
        path.read_text().replace(
            "[shared]\n", f"[shared]\n{effect.lines if lines is None else lines}\n"
        )
    )
    return load_campaign(path)


def fitted(campaign: Campaign) -> Fit:
    return fit_least_squares(campaign.problem(["r"]))


def deviation(fit: Fit, but: str = "") -> float:
    """The largest deviation of a quantity (`but` one) from its true value without an effect, in
    standard deviations.
    """
    true = {
        name: getattr(BASE, name.partition("[")[0])
        for name in fit.names
        if "release" not in name and hasattr(BASE, name.partition("[")[0])
    }
    true.pop(but, None)
    sds = dict(zip(fit.names, fit.sds, strict=True))
    return max(
        abs(fit.values[fit.names.index(name)] - value) / sds[name] for name, value in true.items()
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "noise"), CASES)
def test_an_effect_is_recovered_and_without_its_key_the_fit_is_poor_or_off(
    tmp_path: Path, name: str, noise: str
) -> None:
    effect = EFFECTS[name]
    fit = fitted(recorded(tmp_path, effect, noise))
    i = fit.names.index(effect.parameter)
    assert abs(fit.values[i] - effect.value) < 3.0 * fit.sds[i]
    assert fit.sds[i] < 0.6 * effect.value
    assert fit.p_value > 0.01
    assert deviation(fit, effect.parameter) < 3.5
    without = fitted(recorded(tmp_path, effect, noise, lines=MASSES if name == "moment" else ""))
    assert effect.parameter not in without.names
    assert without.p_value < 1e-4 or deviation(without) > 3.5


def test_what_is_not_said_or_exactly_zero_is_the_plain_curve(tmp_path: Path) -> None:
    plain = Effect(Disturbance("nothing"), "", "", 0.0)
    zero = "scale_x = 0\nviscous_drag_per_s = 0.0\nsag_m = 0.0\nrelease_energy = 0"
    for noise, kind in (("speeds", PhaseCurve), ("positions", MotionCurve)):
        fits = [fitted(recorded(tmp_path, plain, noise, lines=lines)) for lines in ("", zero)]
        assert all(type(fit.problem.runs[0].curve) is kind for fit in fits)
        assert fits[0].problem.runs[0].arguments == fits[1].problem.runs[0].arguments
        assert np.array_equal(fits[0].values, fits[1].values)
        assert np.array_equal(fits[0].cov, fits[1].cov)


def test_an_effect_is_one_unknown_at_its_level_shown_by_its_symbol(tmp_path: Path) -> None:
    lines = 'scale_t = "0.000(1)"\nphi_slope_deg_m = "0.0(5)"'
    campaign = recorded(tmp_path, EFFECTS["slope"], "speeds", lines=lines)
    text = campaign.source.path.read_text().replace(
        "[bodies.b]\n", '[bodies.b]\nscale_t = "0.00(2)"\n'
    )
    campaign.source.path.write_text(
        text.replace('body = "b"\n', 'body = "b"\nscale_x = "0.001(2)"\n')
    )
    parameters = {p.name: p for p in load_campaign(campaign.source.path).problem(["r"]).parameters}
    assert parameters["scale_x[r]"].prior.centre == 0.001
    assert parameters["scale_t[b]"].prior.sd == 0.02
    assert parameters["phi_slope"].prior.sd == pytest.approx(np.radians(0.5))
    assert (parameters["phi_slope"].label.symbol, parameters["phi_slope"].label.unit) == (
        "φ′",
        "°/m",
    )
    assert parameters["scale_t[b]"].label.symbol == "δ_t[b]"


SAG, BOW = 'sag_m = "0.000(3)"\n', 'distortion_m = "0.000(3)"\n'
REFUSED = {  # -> (lines, noise, line of the file, message)
    "both starts": (
        'release_energy = "0.00(2)"\nrelease_speed_m_s = "0.2(1)"',
        "speeds",
        6,
        "'release_speed_m_s' must not stand beside 'release_energy'",
    ),
    "energy of positions": (
        'release_energy = "0.00(2)"',
        "positions",
        5,
        "'release_energy' cannot be combined with positions noise: use release_speed_m_s",
    ),
    "speed about 0": (
        'release_speed_m_s = "0.00(5)"',
        "speeds",
        5,
        'speeds hardly depend on it: say release_energy = "0 \\+/- 0.001"',
    ),
    "no masses": (
        'resisting_moment_n_m = "0.00(2)"',
        "speeds",
        5,
        "'resisting_moment_n_m' needs the masses",
    ),
    "negative drag": (
        'viscous_drag_per_s = "-0.1(1)"',
        "speeds",
        5,
        "'viscous_drag_per_s' must be >= 0",
    ),
    "sag and slope": (
        EFFECTS["sag"].lines + '\nphi_slope_deg_m = "0(1)"',
        "speeds",
        8,
        "'phi_slope_deg_m' must not stand beside 'sag_m'",
    ),
    "sag of what": (
        SAG + "ramp_length_m = 1",
        "speeds",
        5,
        "'sag_m' needs 'ramp_start_m' beside it, where on it the release is",
    ),
    "release off the ramp": (
        SAG + "ramp_length_m = 1\nramp_start_m = 3",
        "speeds",
        7,
        "'ramp_start_m' must lie between 0 and 'ramp_length_m'",
    ),
    "a deep sag": (
        'sag_m = "3(1)"\nramp_length_m = 1\nramp_start_m = 0',
        "speeds",
        5,
        "'sag_m' must be at most a tenth of 'ramp_length_m' = 1: 3",
    ),
    "no picture": (
        BOW,
        "speeds",
        5,
        "'distortion_m' needs 'picture_length_m' beside it, the whole length",
    ),
    "a length of nothing": (
        BOW + "picture_length_m = 0\npicture_start_m = 0",
        "speeds",
        6,
        "'picture_length_m' must be > 0: 0",
    ),
    "percent": (
        'scale_x = "1.0(5)"',
        "speeds",
        5,
        r"'scale_x' is a fraction of the reading \(0.01 means 1 %\) and must be at most 0.5: 1",
    ),
    "said in two units": (
        "phi_slope_deg_m = 1\nphi_slope_rad_m = 1",
        "speeds",
        6,
        "'phi_slope_rad_m' must not stand beside 'phi_slope_deg_m'",
    ),
    "a typing error": (
        'scale_y = "0.00(5)"',
        "speeds",
        5,
        r"'scale_y' is not a known key here \(did you mean 'scale_[xt]'\?\)",
    ),
}


@pytest.mark.parametrize(("lines", "noise", "line", "rule"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_go_together_is_one_error_at_its_line(
    tmp_path: Path, lines: str, noise: str, line: int, rule: str
) -> None:
    with pytest.raises(InputError, match=rf"campaign\.toml:{line}: .*{rule}"):
        recorded(tmp_path, EFFECTS["energy"], noise, lines=lines)


def test_angles_have_no_distorted_picture(tmp_path: Path, project: Path) -> None:
    text = (project / "data" / "wheel" / "campaign.toml").read_text()
    for file in (project / "data" / "wheel").glob("*.csv"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    said = EFFECTS["bow"].lines
    (tmp_path / "campaign.toml").write_text(text.replace("[shared]\n", f"[shared]\n{said}\n"))
    with pytest.raises(
        InputError, match="'distortion_m' does not apply to angles, which an image does not distort"
    ):
        load_campaign(tmp_path / "campaign.toml")


@pytest.mark.parametrize("name", ["energy", "clock", "quadratic"])
def test_speeds_taken_as_independent_know_the_same_keys(tmp_path: Path, name: str) -> None:
    effect = EFFECTS[name]
    recorded(tmp_path, effect, "speeds")
    text = (tmp_path / "campaign.toml").read_text()
    text = text.replace(
        '"differentiated", sigma_x_m = 0.001', '"independent", sigma_v_m_s = 0.0212'
    )
    (tmp_path / "campaign.toml").write_text(text)
    fit = fitted(load_campaign(tmp_path / "campaign.toml"))
    i = fit.names.index(effect.parameter)
    assert fit.problem.runs[0].noise.made_of_positions is False
    assert abs(fit.values[i] - effect.value) < 3.0 * fit.sds[i]
    assert fit.sds[i] < 0.6 * effect.value


def test_a_moment_in_newton_metres_is_one_unknown_of_bodies_of_different_mass(
    tmp_path: Path,
) -> None:
    """What rolls under a load and a bearing: coefficients told apart by a second body, whose share
    of the same moment is another.
    """
    moment, rolling, runs = 0.01 * WEIGHT, 0.01, []
    for name, mass in (("light", BASE.mass), ("heavy", 4.0 * BASE.mass)):
        (tmp_path / name).mkdir()
        true = changed(moment=moment, mass=mass, rolling_resistance=rolling)
        recorded(tmp_path / name, Effect(Disturbance("moment", true), "", "", 0.0), "speeds")
        _, _, bodies = (tmp_path / name / "campaign.toml").read_text().partition("[bodies.b]")
        masses = f"mass_disk_kg = {0.813 * mass}\nmass_particle_kg = {0.187 * mass}"
        for old, new in (("r.csv", f"{name}/r.csv"), ("r", name), ("b", name)):
            bodies = bodies.replace(f'"{old}"', f'"{new}"')
        runs.append(f"[bodies.{name}]\n{masses}{bodies}")
    shared, _, _ = (
        (tmp_path / "light" / "campaign.toml")
        .read_text()
        .replace("scale = 0.005", "scale = 0.02")
        .partition("[bodies.b]")
    )
    tables, rest = zip(*(part.split("[[runs]]") for part in runs), strict=True)
    joint = "".join(tables) + "".join(f"[[runs]]{run}" for run in rest)
    fits = []
    for line in (f"resisting_moment_n_m = {HALF}0.01}}\n", ""):
        (tmp_path / "campaign.toml").write_text(
            shared.replace("[shared]\n", "[shared]\n" + line) + joint
        )
        problem = load_campaign(tmp_path / "campaign.toml").problem(["light", "heavy"])
        fits.append(fit_least_squares(problem))
    fit, without = fits
    for name, true in (("moment", moment), ("rolling_resistance", rolling)):
        i = fit.names.index(name)
        assert abs(fit.values[i] - true) < 3.0 * fit.sds[i]
        assert fit.sds[i] < 0.25 * true
    assert fit.p_value > 0.01
    i = without.names.index("rolling_resistance")
    assert without.p_value < 1e-4 or abs(without.values[i] - rolling) > 4.0 * without.sds[i]


@pytest.mark.parametrize("noise", ["speeds", "positions"])
def test_motion_blur_makes_fast_readings_uncertain(tmp_path: Path, noise: str) -> None:
    """Pictures exposed from one to the next: with the key chi-squared is right, without it the
    noise is too small.
    """
    recorded(tmp_path, Effect(DISTURBANCES["blur"], "", "", 0.0), noise)
    text = (tmp_path / "campaign.toml").read_text()
    assert fitted(load_campaign(tmp_path / "campaign.toml")).p_value < 1e-6
    (tmp_path / "campaign.toml").write_text(
        text.replace("sigma_x_m = 0.001", "sigma_x_m = 0.001, exposure_s = 0.033333")
    )
    fit = fitted(load_campaign(tmp_path / "campaign.toml"))
    assert 0.01 < fit.p_value < 0.99
    assert deviation(fit) < 3.5
    noise_of_run = fit.problem.runs[0].noise
    assert np.ptp(noise_of_run.reading_gain()) > 3.0 * np.min(noise_of_run.reading_gain())
    assert "the motion blur of an exposure of 0.03333 s" in noise_of_run.describe(
        x_unit="m", y_unit="m", words=fit.problem.runs[0].words
    )


@pytest.mark.parametrize(
    ("said", "rule"),
    [
        (
            "sigma_x_m = 0.001, exposure_s = 33",
            "'exposure_s' must be > 0 and at most the time between two frames, 0.03333 s",
        ),
        (
            'sigma_x_m = "0.0010(5)", exposure_s = 0.03',
            "'exposure_s' also needs a fixed standard deviation of one reading",
        ),
    ],
)
def test_an_exposure_is_a_part_of_the_time_between_frames_beside_a_known_error(
    tmp_path: Path, said: str, rule: str
) -> None:
    for noise in ("speeds", "positions"):
        recorded(tmp_path, Effect(DISTURBANCES["blur"], "", "", 0.0), noise)
        text = (tmp_path / "campaign.toml").read_text()
        (tmp_path / "campaign.toml").write_text(text.replace("sigma_x_m = 0.001", said))
        with pytest.raises(InputError, match=rule):
            load_campaign(tmp_path / "campaign.toml")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_the_command_recovers_a_moment(tmp_path: Path) -> None:
    recorded(
        tmp_path,
        EFFECTS["moment"],
        "speeds",
        lines=EFFECTS["moment"].lines + "\nunmodelled_force = 0",
    )
    done = CliRunner().invoke(
        cli, ["fit", str(tmp_path / "campaign.toml"), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["status"] == "ok"
    assert_recovered(found["parameters"], EFFECTS["moment"])
    assert "speed_at_release" not in found["runs"]["r"]["derived"]


@pytest.mark.slow
def test_an_analysis_recovers_an_energy_and_without_it_needs_the_free_start(tmp_path: Path) -> None:
    """Not said, a push is within what every fit has room for; where the curve is said to be
    complete it is not trusted.
    """
    campaign = recorded(tmp_path, EFFECTS["energy"], "speeds")
    found = json.loads(as_json(result_of(campaign, analyse(campaign, ["r"], seed=1, target=FEW))))
    assert found["status"] == "ok"
    assert_recovered(found["parameters"], EFFECTS["energy"])
    assert "speed_at_release" in found["runs"]["r"]["derived"]
    without = analyse(
        recorded(tmp_path, EFFECTS["energy"], "speeds", lines=""), ["r"], seed=1, target=FEW
    )
    assert without.diagnosis.status == "ok"
    draws = dict(zip(without.problem.names, without.chain.flat.T, strict=True))
    assert (
        max(
            abs(x.mean() - getattr(BASE, name.partition("[")[0], 0.0)) / x.std()
            for name, x in draws.items()
        )
        < 3.5
    )
    complete = analyse(
        recorded(tmp_path, EFFECTS["energy"], "speeds", lines="unmodelled_force = 0"),
        ["r"],
        seed=1,
        target=FEW,
    )
    assert complete.diagnosis.status == "poor-fit"


def assert_recovered(parameters: dict[str, Any], effect: Effect) -> None:
    parameter = parameters[effect.parameter]
    assert abs(parameter["mean"] - effect.value) < 3.0 * parameter["sd"]
