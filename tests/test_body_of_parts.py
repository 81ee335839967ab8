"""A campaign's bodies from their parts: values, budgets and correlations against sums written out
here, what a fit makes of them, and mistakes.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner

from estim import InputError, load_campaign
from estim.campaign.binding import gamma_of_body, gamma_origin, total_mass
from estim.campaign.campaign_file import read_campaign_file
from estim.campaign.lookup_levels import body_levels
from estim.cli.commands import cli
from estim.common import format_quantity
from estim.model import Body, trajectory
from estim.studies.bodies import weigh

DEVICE = Path(__file__).parents[1] / "data" / "device" / "bodies.toml"

TWO = """\
title = "two bodies on one disk"
kind = "measured"
[shared]
radius_m = 0.15
[parts.disk]
kind = "disk"
mass_kg = "0.300(6)"
[parts.screw]
kind = "point"
mass_kg = "0.030(1)"
distance_m = "0.140(2)"
[parts.weight]
kind = "bolt"
mass_kg = "0.040(2)"
distance_m = 0.14
diameter_m = "0.020(4)"
[bodies.light]
parts = ["disk", "screw"]
[bodies.heavy]
parts = ["disk", "screw", "weight"]
"""


def source_of(tmp_path, text):
    path = tmp_path / "bodies.toml"
    path.write_text(text)
    return read_campaign_file(path, measured=False)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """The bodies of TWO, weighed."""
    source = source_of(tmp_path_factory.mktemp("two"), TWO)
    return weigh(source, rng=np.random.default_rng(1))


def found(weighing):
    return {f"{out}[{body}]": i for i, (body, out) in enumerate(weighing.names)}


def drawn(rng, n=400_000):
    """gamma, kappa and j of both bodies of TWO, drawn without any of the project's code."""
    disk, screw, weight = (
        rng.normal(0.3, 0.006, n),
        rng.normal(0.03, 0.001, n),
        rng.normal(0.04, 0.002, n),
    )
    at, width = rng.normal(0.14, 0.002, n), rng.normal(0.02, 0.004, n)
    light, heavy = disk + screw, disk + screw + weight
    inertia = disk * 0.15**2 / 2 + screw * at**2
    return {
        "mass[light]": light, "gamma[light]": screw * at / light / 0.15,
        "inertia_ratio[light]": inertia / light / 0.15**2,
        "mass[heavy]": heavy, "gamma[heavy]": (screw * at + weight * 0.14) / heavy / 0.15,
        "inertia_ratio[heavy]": (inertia + weight * (0.14**2 + width**2 / 8)) / heavy / 0.15**2,
    }  # fmt: skip


def test_values_and_correlations_are_those_of_draws_made_by_hand(two, rng):
    draws, at = drawn(rng), found(two)
    names = list(draws)
    assert {name for name in at if not name.startswith(("kappa", "rho", "particle"))} == set(names)
    for name in names:
        assert two.linear.value[at[name]] == pytest.approx(draws[name].mean(), rel=1e-3)
        assert two.linear.u[at[name]] == pytest.approx(draws[name].std(), rel=0.01)
        assert two.sampled.u[at[name]] == pytest.approx(draws[name].std(), rel=0.01)
    index = [at[name] for name in names]
    expected = np.corrcoef([draws[name] for name in names])
    assert two.correlation[np.ix_(index, index)] == pytest.approx(expected, abs=0.01)
    assert expected[0, 3] > 0.9  # they share the disk
    assert abs(expected[1, 4]) > 0.5


def test_kappa_of_a_uniform_disk_is_half_exactly_and_one_number_for_both(two):
    for body in ("light", "heavy"):
        at = found(two)[f"kappa[{body}]"]
        assert two.linear.value[at] == pytest.approx(0.5, rel=1e-12)
        assert two.linear.u[at] == pytest.approx(0.0, abs=1e-9)


def test_budget_of_gamma_is_the_one_on_paper(two):
    """gamma = m r/((M_D + m) R): relative variances (M_D/M u(m)/m)^2, (u(M_D)/M)^2, (u(r)/r)^2."""
    parts = np.array([(0.3 / 0.33 * 0.001 / 0.03) ** 2, (0.006 / 0.33) ** 2, (0.002 / 0.14) ** 2])
    rows = two.budgets[found(two)["gamma[light]"]].rows
    shares = {row.input.name: row.share for row in rows}
    assert [
        shares[name] for name in ("screw.mass_kg", "disk.mass_kg", "screw.distance_m")
    ] == pytest.approx(100 * parts / parts.sum(), rel=1e-4)


def test_the_papers_device(rng):
    """What 0.45 takes: two CDs in all give 0.44 +- 0.01, four 0.40 +- 0.01; gamma and M_D are those
    of arXiv 1403.7220, section III and IV.
    """
    source = read_campaign_file(DEVICE, measured=False)
    weighing = weigh(source, rng=rng)
    at, linear = found(weighing), weighing.linear
    for name, value, u in (("gamma[light]", 0.094, 0.01), ("gamma[heavy]", 0.187, 0.01)):
        assert linear.value[at[name]] == pytest.approx(value, abs=1e-3)
        assert linear.u[at[name]] < u
    assert pytest.approx(0.303) == 2 * 0.131 + 2 * 0.0155 + 0.010
    assert abs(linear.value[at["kappa[light]"]] - 0.45) < 2.5 * linear.u[at["kappa[light]"]] < 0.02
    assert abs(linear.value[at["kappa[four CDs]"]] - 0.45) > 5 * linear.u[at["kappa[four CDs]"]]
    assert weighing.correlation[at["kappa[light]"], at["kappa[heavy]"]] == pytest.approx(1.0)
    assert weighing.budgets[at["kappa[light]"]].rows[0].input.name == "axle.mass_kg"
    # share of the mass near the axle
    middle = (0.5 * (1 + (0.0036 / 0.15) ** 2) - 0.45) / (
        0.5 - 0.5 * (0.06**2 + 0.0075**2) / 0.15**2
    )
    assert middle * 0.303 == pytest.approx(0.036, abs=0.001)


def test_a_disk_that_may_be_off_its_centre_is_still_the_disk(tmp_path, rng, two):
    """Its imbalance adds to that of the screw: u(gamma)^2 grows by (M_D u(centre)/(M R))^2."""
    text = TWO.replace('"0.300(6)"', '"0.300(6)"\ndistance_m = "0.0000(5)"')
    off = weigh(source_of(tmp_path, text), rng=rng)
    at = found(two)["gamma[light]"]
    assert off.linear.value == pytest.approx(two.linear.value, rel=1e-9)
    more = 0.3 * 0.0005 / 0.33 / 0.15
    assert off.linear.u[at] == pytest.approx(math.hypot(two.linear.u[at], more), rel=1e-6)


def test_what_is_not_linear_is_left_to_the_draws(tmp_path, rng):
    text = TWO.replace('distance_m = "0.140(2)"', 'distance_m = "0.010(8)"').replace(
        '"disk", "screw", "weight"', '"disk", "screw"'
    )
    weighing = weigh(source_of(tmp_path, text), rng=rng)
    assert weighing.linear_holds[found(weighing)["mass[light]"]]
    assert not weighing.linear_holds[found(weighing)["gamma[light]"]]


RUNS = """
[[runs]]
name = "one"
body = "{body}"
file = "one.csv"
phi_deg = "4.0(4)"
theta0_deg = "60.0(15)"
"""


def campaign_of(tmp_path, text, *bodies):
    t = 0.02 + np.arange(40) / 30
    x = trajectory(t, Body(0.15, 0.187, 0.45), phi=math.radians(4), theta0=math.radians(60))[0][0]
    for i, body in enumerate(bodies):
        (tmp_path / f"{i}.csv").write_text(
            "t_s,x_m\n" + "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(t, x, strict=True))
        )
        text += RUNS.format(body=body).replace('"one"', f'"run{i}"').replace("one.csv", f"{i}.csv")
    text = text.replace("[shared]\n", "[shared]\nnoise = {sigma_x_m = 0.001}\n", 1)
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return load_campaign(path)


def prior_of(name, priors):
    return next(prior for parameter, prior in priors.items() if parameter.startswith(f"{name}["))


UNEVEN = TWO.replace('kind = "disk"', 'kind = "disk"\nradius_m = "0.145(2)"', 1)


def test_a_fit_takes_them_as_stated_values_and_says_what_it_leaves_out(tmp_path, rng):
    campaign = campaign_of(tmp_path, UNEVEN, "heavy")
    weighing = weigh(campaign.source, rng=rng)
    at, problem = found(weighing), campaign.problem(["run0"])
    priors = {p.name: p.prior for p in problem.parameters}
    assert {"gamma[heavy]", "kappa[light+heavy]", "rho[heavy]"} <= set(priors)
    # j does not feel its error
    assert (
        problem.runs[0].arguments["particle_gyration"]
        == weighing.linear.value[at["particle_gyration[heavy]"]]
    )
    for name, output in {
        "gamma[heavy]": "gamma[heavy]",
        "kappa[light+heavy]": "kappa[heavy]",
        "rho[heavy]": "rho[heavy]",
    }.items():
        assert priors[name].mean == pytest.approx(weighing.linear.value[at[output]], rel=1e-12)
        assert priors[name].sd == pytest.approx(weighing.linear.u[at[output]], rel=1e-6)
    assert problem.runs[0].motion.mass == pytest.approx(0.37)
    assert len(campaign.tables["run0"].facts) == 1
    assert "correlation, r = " in campaign.tables["run0"].facts[0]
    gyration, u = problem.runs[0].arguments["particle_gyration"], 0.0
    body = Body(
        0.15,
        **{name: prior_of(name, priors).mean for name in ("gamma", "kappa", "rho")},
        particle_gyration=gyration,
    )
    for name in ("gamma", "kappa", "rho"):
        u = math.hypot(u, body.inertia_ratio_gradient()[name] * prior_of(name, priors).sd)
    assert (
        f"{format_quantity(body.inertia_ratio, u)} from these values taken as independent"
        in campaign.tables["run0"].facts[0]
    )


def test_a_radius_of_gyration_that_matters_is_an_unknown(tmp_path):
    text = TWO.replace('diameter_m = "0.020(4)"', 'diameter_m = "0.12(4)"')
    assert (
        "particle_gyration[heavy]" in campaign_of(tmp_path, text, "heavy").problem(["run0"]).names
    )


def test_it_says_so_where_independent_values_make_the_inertia_too_certain(tmp_path):
    """An error of the screw's distance moves gamma and rho alike, and j by the sum of what either
    does.
    """
    text = (
        TWO.replace('"0.140(2)"', '"0.140(7)"')
        .replace('"0.300(6)"', "0.3")
        .replace('"0.030(1)"', "0.03")
    )
    fact = campaign_of(tmp_path, text, "light").tables["run0"].facts[0]
    share, rho, u = 0.03 / 0.33, 0.14 / 0.15, 0.007 / 0.15
    inertia, apart = (
        0.5 * 0.3 / 0.33 + share * rho**2,
        math.hypot((rho - 0.5 / rho) * share * u, (share * 0.5 / rho + share * rho) * u),
    )
    assert apart < 0.9 * 2 * share * rho * u
    assert (
        f"j is {format_quantity(inertia, 2 * share * rho * u)} from the parts, "
        f"{format_quantity(inertia, apart)} from these values" in fact
    )
    assert "r = +1.00" in fact or "r = 1.00" in fact


def test_bodies_on_one_disk_have_one_kappa(tmp_path):
    names = campaign_of(tmp_path, UNEVEN, "light", "heavy").problem(["run0", "run1"]).names
    assert [name for name in names if name.startswith("kappa")] == ["kappa[light+heavy]"]
    assert {"gamma[light]", "gamma[heavy]"} <= set(names)


@pytest.mark.parametrize(
    "own", ['kappa = "0.45(1)"', 'radius_m = "0.150(1)"', 'parts = ["disk", "disk", "screw"]']
)
def test_bodies_on_disks_of_their_own_have_a_kappa_each(tmp_path, own):
    text = UNEVEN.replace(
        'parts = ["disk", "screw", "weight"]',
        own if own.startswith("parts") else f'parts = ["disk", "screw", "weight"]\n{own}',
    )
    names = campaign_of(tmp_path, text, "light", "heavy").problem(["run0", "run1"]).names
    assert sorted(name for name in names if name.startswith("kappa")) == [
        "kappa[heavy]",
        "kappa[light]",
    ]


def test_a_disk_off_its_centre_has_a_kappa_that_is_the_bodys_own(tmp_path):
    text = UNEVEN.replace('"0.300(6)"', '"0.300(6)"\ndistance_m = "0.000(1)"')
    names = campaign_of(tmp_path, text, "light", "heavy").problem(["run0", "run1"]).names
    assert sorted(name for name in names if name.startswith("kappa")) == [
        "kappa[heavy]",
        "kappa[light]",
    ]


def test_what_is_stated_beside_the_parts_counts(tmp_path):
    text = TWO.replace('parts = ["disk", "screw"]', 'parts = ["disk", "screw"]\ngamma = "0.094(1)"')
    source = source_of(tmp_path, text + RUNS.format(body="light"))
    levels = body_levels(source, "light")
    assert gamma_of_body(source, "light").value == 0.094
    assert (gamma_origin(source, "light"), gamma_origin(source, "heavy")) == (
        "as stated",
        "from the parts",
    )
    assert total_mass(levels) == pytest.approx(0.33)


BY_MASSES = (
    '[bodies.light]\nmass_disk_kg = "0.300(6)"\nmass_particle_kg = "0.030(1)"\nkappa = 0.5\n'
)


def test_disk_and_point_are_the_masses_said_by_keys(tmp_path):
    by_parts = source_of(tmp_path, TWO.replace('"0.140(2)"', "0.15"))
    by_masses = source_of(tmp_path, TWO[: TWO.index("[parts")] + BY_MASSES)
    one, other = gamma_of_body(by_parts, "light"), gamma_of_body(by_masses, "light")
    assert (one.value, one.u) == pytest.approx((other.value, other.u), rel=1e-6)


MISTAKES = {
    "a part that is not there": ('"disk", "screw"]', '"disk", "nut"]', "must name parts", 18),
    "no parts": ('parts = ["disk", "screw"]', "parts = []", "must list 1 to 100", 18),
    "a key missing": ('distance_m = "0.140(2)"\n', "", r"is missing \(kind = \"point\"\)", 8),
    "a key too many": ('distance_m = "0.140(2)"', 'distance_m = "0.140(2)"\nlength_m = 0.1',
    r"is not a known key here \(kind = \"point\"\)", 12),
    "no mass": ('"0.300(6)"', "0.0", "must be > 0", 7),
    "below zero": ('"0.140(2)"', "-0.14", "must be >= 0", 11),
    "millimetres": ('"0.140(2)"', "140.0", r"must be at most 10 times the radius of the body, "
        r"0\.15 m: is it in metres\?", 11),
    "a quantity that is none": ('"0.140(2)"', '"about 0.14"', "or read like", 11),
    "masses beside": ('parts = ["disk", "screw"]', 'parts = ["disk", "screw"]\nmass_disk_kg = 0.3',
    "must not stand "
        "beside 'parts'", 19),
    "no disk": ('parts = ["disk", "screw"]', 'parts = ["screw"]', "must leave a part for the disk",
    18),
    "particle of another body": ('parts = ["disk", "screw"]', 'parts = ["disk", '
        '"screw"]\nparticle = ["weight"]', "must name some of the parts", 19),
    "particle on the axle": ('"screw"]', '"hub"]\nparticle = ["hub"]\n[parts.hub]\nkind = '
        '"disk"\nmass_kg = 1', "make no body of", 18),
    "nothing turns": ('["disk", "screw"]', '["fork"]\n[parts.fork]\nkind = "trailing"\nmass_kg = 1',
    "must hold a part "
        "that rotates", 18),
    "wide hole": ('kind = "disk"', 'kind = "ring"\nradius_m = 0.1\ninner_radius_m = 0.2',
    "must be at most 'radius_m'", 8),
    "another kind": ('kind = "disk"', 'kind = "plate"', "must be one of", 6),
    "no radius": ("radius_m = 0.15\n", "", "is missing for the body of these parts", 0),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_with_its_line(tmp_path, rng, mistake):
    old, new, said, line = MISTAKES[mistake]
    assert old in TWO
    with pytest.raises(InputError, match=said) as told:
        weigh(source_of(tmp_path, TWO.replace(old, new, 1)), rng=rng)
    assert line in (0, told.value.line)


def test_the_command_writes_a_report(tmp_path):
    (tmp_path / "bodies.toml").write_text(TWO)
    done = runner().invoke(
        cli, ["body", str(tmp_path / "bodies.toml"), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("light: M = 0.330(6) kg, γ = 0.0848(32), κ = 0.5,")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["schema"] == "estim-body/1"
    assert sum(result["bodies"]["light"]["values"]["gamma"]["budget"].values()) == pytest.approx(
        100.0, abs=0.01
    )
    assert result["bodies"]["heavy"]["values"]["kappa"]["u"] < 1e-9
    report = (tmp_path / "out" / "report.md").read_text()
    assert "`screw.mass_kg`" in report
    assert "both agree" in report
    again = runner().invoke(
        cli, ["body", str(tmp_path / "bodies.toml"), "--out", str(tmp_path / "again")]
    )
    assert (tmp_path / "again" / "result.json").read_bytes() == (
        tmp_path / "out" / "result.json"
    ).read_bytes(), again.output


def test_a_file_without_parts_is_refused(project):
    done = runner().invoke(cli, ["body", str(project / "data" / "replica" / "campaign.toml")])
    assert isinstance(done.exception, InputError)
    assert "parts = " in str(done.exception)
