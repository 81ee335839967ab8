"""Synthetic runs and campaigns: what a camera and a protractor would see, and the committed replica
from its design.
"""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest

from estim import InputError
from estim.campaign.design import load_design, mass_particle, simulate_campaign
from estim.model import Body, trajectory, turning_point
from estim.model.simulate import frame_times, simulate_positions, simulate_theta_min

PAPER = Body(radius=0.15, gamma=0.187, kappa=0.45)
RUN = {"phi": math.radians(4.0), "theta0": math.radians(60.0), "g": 9.81}


# one run


def test_frames_are_equally_spaced_and_begin_within_one_interval(rng):
    starts = []
    for _ in range(50):
        t = frame_times(PAPER, **RUN, interval=1 / 30, x_end=0.877, rng=rng)
        assert np.diff(t) == pytest.approx(np.full(t.size - 1, 1 / 30), rel=1e-9)
        starts.append(t[0] * 30)
    assert min(starts) >= 0.0
    assert max(starts) < 1.0
    # uniform on [0, 1): mean 0.5 with standard error 0.041
    assert np.mean(starts) == pytest.approx(0.5, abs=4 * 0.041)
    assert np.ptp(starts) > 0.8


def test_the_last_frame_comes_just_before_the_body_stops(rng):
    t = frame_times(PAPER, **RUN, interval=1 / 30, x_end=0.877, rng=rng)
    assert 1.406236634838 - 1 / 30 <= t[-1] < 1.406236634838


def test_a_short_ramp_ends_the_film(rng):
    t = frame_times(PAPER, **RUN, interval=1 / 240, x_end=0.3, rng=rng)
    x, _ = trajectory([t[-1], t[-1] + 1 / 240], PAPER, **RUN)
    assert x[0, 0] < 0.3 <= x[0, 1]


def test_positions_scatter_about_the_trajectory_with_the_stated_sigma(rng):
    t = np.linspace(0.1, 1.4, 40)
    truth = trajectory(t, PAPER, **RUN)[0][0]
    errors = (
        np.array(
            [
                simulate_positions(t, PAPER, **RUN, sigma_x=0.002, rng=rng) - truth
                for _ in range(200)
            ]
        )
        / 0.002
    )
    n = errors.size
    assert abs(errors.mean()) < 4 / math.sqrt(n)
    assert errors.std() == pytest.approx(1.0, abs=4 / math.sqrt(2 * n))
    # neighbouring frames are independent
    assert abs(np.mean(errors[:, 1:] * errors[:, :-1])) < 4 / math.sqrt(n)


def test_theta_min_readings_scatter_in_both_angles(rng):
    phi = np.radians(np.linspace(1, 8, 8))
    truth = np.arcsin((np.sin(phi) + 0.0028 * np.cos(phi)) / 0.187)
    draws = np.array(
        [
            simulate_theta_min(
                phi, 0.187, rolling_resistance=0.0028, u_phi=0.007, u_theta_min=0.026, rng=rng
            )
            for _ in range(500)
        ]
    )
    for read, true, u in ((draws[:, 0], phi, 0.007), (draws[:, 1], truth, 0.026)):
        pull = (read - true) / u
        assert abs(pull.mean()) < 4 / math.sqrt(pull.size)
        assert pull.std() == pytest.approx(1.0, abs=4 / math.sqrt(2 * pull.size))
    pulls = [(draws[:, 0] - phi) / 0.007, (draws[:, 1] - truth) / 0.026]
    assert abs(np.mean(pulls[0] * pulls[1])) < 4 / math.sqrt(pulls[0].size)


# the replica


@pytest.fixture
def files(replica):
    return simulate_campaign(load_design(replica / "design.toml"))


def test_the_replica_is_what_its_design_makes_byte_by_byte(replica, files):
    for name, text in files.items():
        assert (replica / name).read_bytes() == text.encode(), name
    committed = {p.relative_to(replica).as_posix() for p in replica.rglob("*") if p.is_file()}
    assert committed == {*files, "design.toml", "simulation.json"}


def test_every_file_of_the_replica_says_synthetic(replica):
    for path in replica.rglob("*"):
        if path.is_file() and path.name != "simulation.json":  # which says how the others were made
            assert "SYNTHETIC" in path.read_text().splitlines()[0], path


def test_the_truth_is_out_of_reach_of_a_fit(replica):
    campaign = (replica / "campaign.toml").read_text()
    assert "truth" not in campaign
    assert "design" not in campaign.split("\n", 1)[1]
    assert tomllib.loads(campaign)["kind"] == "synthetic"
    for table in tomllib.loads(campaign)["runs"]:
        assert (replica / table["file"]).is_file()


def test_measured_values_are_the_truth_within_their_uncertainties(replica):
    from uncertainties import ufloat_fromstr

    campaign, truth = (
        tomllib.loads((replica / name).read_text()) for name in ("campaign.toml", "truth.toml")
    )
    pulls = []
    for run in campaign["runs"]:
        for angle in ("phi", "theta0"):
            read = ufloat_fromstr(run[f"{angle}_deg"])
            pulls.append(
                (read.nominal_value - math.degrees(truth[f"{angle}[{run['name']}]"])) / read.std_dev
            )
    for name, body in campaign["bodies"].items():
        disk, particle = (
            ufloat_fromstr(body["mass_disk_kg"]),
            ufloat_fromstr(body["mass_particle_kg"]),
        )
        gamma = particle / (disk + particle)
        assert gamma.std_dev == pytest.approx(0.01, rel=0.1)  # the paper's u(gamma)
        pulls.append((gamma.nominal_value - truth[f"gamma[{name}]"]) / gamma.std_dev)
    # chi2 of 18 normal pulls: 18 +- 6
    assert sum(p**2 for p in pulls) == pytest.approx(18.0, abs=4 * 6)
    assert sum(p**2 for p in pulls) > 4.0  # not the truth itself


def test_run_files_scatter_about_the_true_motion(replica):
    truth = tomllib.loads((replica / "truth.toml").read_text())
    for name, body in (("heavy-04", "heavy"), ("light-02", "light")):
        t, x = np.loadtxt(
            replica / "runs" / f"{name}.csv", delimiter=",", comments=("#", "t_s"), unpack=True
        )
        disk = Body(truth["radius"], truth[f"gamma[{body}]"], truth[f"kappa[{body}]"])
        motion = {key: truth[f"{key}[{name}]"] for key in ("phi", "theta0")} | {
            "rolling_resistance": truth["rolling_resistance"],
            "g": truth["g"],
        }
        # the time of the first frame is unknown to the file; the best one leaves sigma_x
        delays = np.linspace(0.0, 1 / 30, 201)
        rms = [
            np.sqrt(np.nanmean((x - trajectory(t + d, disk, **motion)[0][0]) ** 2)) for d in delays
        ]
        assert min(rms) == pytest.approx(0.001, rel=4 / math.sqrt(2 * t.size))
        assert (
            0.0
            <= x.max()
            <= float(turning_point(disk, **{k: v for k, v in motion.items() if k != "g"})) + 0.004
        )


# the design


def _edited(replica, tmp_path, old, new):
    text = (replica / "design.toml").read_text()
    assert text.count(old) == 1, old
    path = tmp_path / "design.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_same_design_gives_the_same_files_and_another_seed_others(replica, tmp_path, files):
    assert simulate_campaign(load_design(replica / "design.toml")) == files
    other = simulate_campaign(
        load_design(_edited(replica, tmp_path, "seed = 14037220", "seed = 14037221"))
    )
    assert other.keys() == files.keys()
    for name in files:
        if name != "truth.toml":
            assert other[name].splitlines()[4:] != files[name].splitlines()[4:], name


def test_adding_a_run_leaves_the_others_as_they_are(replica, tmp_path, files):
    added = (
        '[[runs]]\nname = "light-05"\nbody = "light"\nphi_deg = 3.0\ntheta0_deg = 70.0\n\n[line]'
    )
    more = simulate_campaign(load_design(_edited(replica, tmp_path, "[line]", added)))
    assert set(more) - set(files) == {"runs/light-05.csv"}
    for name in files:
        if name.endswith(".csv"):
            assert more[name].splitlines()[1:] == files[name].splitlines()[1:], name


def test_particle_mass_gives_the_wanted_gamma():
    for gamma in (0.05, 0.187, 0.5):
        assert Body.from_masses(
            1.0, 0.303, mass_particle(gamma, 0.303), kappa=0.45
        ).gamma == pytest.approx(gamma, rel=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("kappa = 0.45", "kappa = -0.45", "'kappa' must be > 0 and <= 1: -0.45"),
        ("sigma_x_m = 0.001", "sigma_x_m = 0.0", "'sigma_x_m' must be > 0 and <= 1000: 0.0"),
        (
            "frames_per_second = 30",
            'frames_per_second = "30"',
            "'frames_per_second' must be a number, not text",
        ),
        (
            "ramp_length_m = 0.877",
            "ramp_lenght_m = 0.877",
            "'ramp_lenght_m' is not a known key here",
        ),
        ("g = 9.81", "", "'g' is missing"),
        (
            'name = "heavy-08"\nbody = "heavy"',
            'name = "heavy-08"\nbody = "heavier"',
            "'body' must name one of the bodies: heavier",
        ),
        (
            '[line]\nbody = "heavy"',
            '[line]\nbody = "heavier"',
            "'body' must name one of the bodies: heavier",
        ),
        ("seed = 14037220", "seed = ", "is not valid TOML"),
    ],
)
def test_a_wrong_design_is_refused_with_its_line(replica, tmp_path, old, new, told):
    path = _edited(replica, tmp_path, old, new)
    with pytest.raises(InputError) as caught:
        load_design(path)
    assert told in str(caught.value)
    number = next(
        i
        for i, line in enumerate(path.read_text().splitlines(), 1)
        if line.startswith((new or "[constants]").split("\n")[0])
    )
    assert str(caught.value).startswith(f"{path}:{number + new.count(chr(10))}: ")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param(
            "phi_deg = 8.0\ntheta0_deg = 75.0",
            "phi_deg = 8.0\ntheta0_deg = 10.0",
            id="a-run-that-does-not-start",
        ),
        pytest.param("gamma = 0.094", "gamma = 1.2", id="a-particle-of-negative-mass"),
        pytest.param("7.0, 8.0]", "7.0, 20.0]", id="a-tilt-without-smallest-angle"),
        pytest.param('name = "heavy-08"', 'name = "heavy-06"', id="two-runs-of-one-name"),
        pytest.param(
            'name = "heavy-08"', 'name = "../heavy-08"', id="a-name-that-leaves-the-folder"
        ),
        pytest.param("seed = 14037220", "seed = -1", id="negative-seed"),
        pytest.param(
            "frames_per_second = 30", "frames_per_second = inf", id="infinitely-many-frames"
        ),
        pytest.param(
            "frames_per_second = 30",
            "frames_per_second = 1e9",
            id="more-frames-a-second-than-a-camera",
        ),
        pytest.param(
            "frames_per_second = 30", "frames_per_second = 1e6", id="more-frames-than-fit-a-file"
        ),
        pytest.param("frames_per_second = 30", "frames_per_second = 1e-9", id="no-frame-at-all"),
        pytest.param("frames_per_second = 30", "frames_per_second = 3", id="too-few-frames"),
        pytest.param("ramp_length_m = 0.877", "ramp_length_m = 1e-9", id="no-ramp"),
        pytest.param("ramp_length_m = 0.877", "ramp_length_m = 0.001", id="a-ramp-of-two-frames"),
        pytest.param(
            "ramp_length_m = 0.877", "ramp_length_m = 5e3", id="a-ramp-of-thousands-of-radii"
        ),
        pytest.param("g = 9.81", "g = 1e300", id="heavy-world"),
        pytest.param("radius_m = 0.15", "radius_m = 1e-300", id="no-disk"),
        pytest.param("radius_m = 0.15", "radius_m = 1e300", id="a-disk-beyond-the-universe"),
        pytest.param("u_phi_deg = 0.4", "u_phi_deg = 1e300", id="no-protractor"),
        pytest.param(
            "rolling_resistance = 0.002 ", "rolling_resistance = -0.1 ", id="a-ramp-that-drives"
        ),
        pytest.param("kappa = 0.45", "kappa = 5", id="inertia-beyond-a-hoop"),
    ],
)
def test_a_design_that_cannot_be_simulated_is_refused_with_its_line(replica, tmp_path, old, new):
    path = _edited(replica, tmp_path, old, new)
    with pytest.raises(InputError, match=r"design\.toml:\d+: '"):
        simulate_campaign(load_design(path))


def test_a_title_with_quotes_still_makes_a_campaign_that_reads(replica, tmp_path):
    old = next(
        line
        for line in (replica / "design.toml").read_text().splitlines()
        if line.startswith("title")
    )
    path = _edited(replica, tmp_path, old, "title = 'the \"eccentric\" disk, C:\\lab'")
    campaign = simulate_campaign(load_design(path))["campaign.toml"]
    assert tomllib.loads(campaign)["title"] == 'the "eccentric" disk, C:\\lab'


def test_a_design_of_ones_own_names_no_published_numbers(replica, tmp_path, files):
    path = _edited(replica, tmp_path, 'published = "../paper/published.toml"', "#")
    campaign = simulate_campaign(load_design(path))["campaign.toml"]
    of_replica = tomllib.loads(files["campaign.toml"])
    del of_replica["published"]
    assert tomllib.loads(campaign) == of_replica
