"""Quantities are shown as whoever makes them says: a user's own by their names and units, the
rolling body's by its symbols, in degrees.
"""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from matplotlib.text import Text

from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.common.labels import Notation
from estim.curve_fitting.result import CurveFit
from estim.curve_fitting.single import fit_curve
from estim.pipeline import Analysis, sample_curve
from estim.problem.observations import Parameter
from estim.problem.priors import Normal
from estim.reports import pages
from estim.reports.analysis import index_report
from estim.reports.corner_figures import corner_figure, trace_figure
from estim.reports.curve import curve_report
from estim.reports.identifiability import direction_figure, profile_figure
from estim.reports.records import Labels, ParameterSummary
from estim.sampling.chain import Target
from estim.studies.determination import determine

# names that the rolling body has too
UNITS = {"slope": "m/s", "offset": "m", "phi": "rad", "g": "1", "kappa": "V", "theta0": "rad"}
TRUE = dict(zip(UNITS, (1.0, 0.5, 0.3, 2.0, -1.0, 0.2), strict=True))
CURVE = "slope*x + offset + phi*sin(x) + g*cos(x) + kappa*sin(2*x) + theta0*cos(2*x)"
X, U = np.linspace(0.0, 6.0, 40), 0.05
OF_THE_BODY = re.compile(r"[γκφθ°]|x₀|(?<![\w/'])s(?!\w)")  # not the second


def measured(rng: np.random.Generator) -> np.ndarray:
    parts = (X, np.ones_like(X), np.sin(X), np.cos(X), np.sin(2.0 * X), np.cos(2.0 * X))
    return sum(
        value * part for value, part in zip(TRUE.values(), parts, strict=True)
    ) + U * rng.standard_normal(X.size)


@pytest.fixture(scope="module")
def fit() -> CurveFit:
    return fit_curve(CURVE, X, measured(np.random.default_rng(4)), u_y=U, start=TRUE, units=UNITS)


@pytest.fixture(scope="module")
def analysis(fit: CurveFit) -> Analysis:
    return sample_curve(fit, seed=1, target=Target(ess=400))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "png", lambda *_: b"")


def axis_of(name: str) -> str:
    return name if UNITS[name] == "1" else f"{name} ({UNITS[name]})"


def texts_of(figure: Figure) -> list[str]:
    figure.draw_without_rendering()
    return [text.get_text() for text in figure.findobj(Text)]


def test_a_users_parameters_have_their_own_names_and_units_in_the_report(
    fit: CurveFit, analysis: Analysis, undrawn: None
) -> None:
    files = curve_report(fit, analysis, title="Names", kind="synthetic")
    report = files["report.md"].decode()
    assert OF_THE_BODY.findall(report) == []
    for name, unit in UNITS.items():
        assert re.search(
            rf"^\| {name} \| parameter of the curve \|.*\| {'' if unit == '1' else unit} \|$",
            report,
            re.M,
        ), name
    assert b"label" not in files["result.json"]


@pytest.mark.slow
def test_a_users_parameters_have_their_own_names_and_units_in_figures(analysis: Analysis) -> None:
    drawn = {
        "corner": corner_figure(analysis),
        "traces": trace_figure(analysis),
        "profiles": profile_figure(
            analysis.problem, determine(analysis).intervals, analysis.chain.thinned(500)
        ),
    }
    for name, figure in drawn.items():
        assert {axis_of(parameter) for parameter in UNITS} <= set(texts_of(figure)), name
    assert set(UNITS) <= set(texts_of(direction_figure(analysis.problem, analysis.identifiability)))


def test_a_users_parameters_have_their_own_names_and_units_in_a_printed_fit() -> None:
    """Stated values that the data contradict are named in a sentence."""
    y = measured(np.random.default_rng(4))
    priors = {"phi": "1.00(5)", "slope": "3.0(1)", "theta0": "2.0(1)"}
    fit = fit_curve(CURVE, X, y, u_y=U, start=TRUE, units=UNITS, priors=priors)
    for shown in (str(fit), fit._repr_markdown_()):
        assert OF_THE_BODY.findall(shown) == []
        for sentence in (
            "phi was stated as 1 rad, ",
            "slope was stated as 3 m/s, ",
            "theta0 was stated as 2 rad, ",
        ):
            assert sentence in shown


def test_an_exact_phi_of_a_user_is_no_angle_that_was_read() -> None:
    start = {name: value for name, value in TRUE.items() if name != "phi"}
    fit = fit_curve(
        CURVE,
        X,
        measured(np.random.default_rng(4)),
        u_y=U,
        start=start,
        fixed={"phi": TRUE["phi"]},
        units=UNITS,
    )
    diagnosis = sample_curve(fit, seed=1, target=Target(ess=200)).diagnosis
    assert not [note for note in diagnosis.notes if "exact" in note]


@pytest.mark.slow
def test_a_users_parameters_have_their_own_names_and_units_on_the_terminal(
    tmp_path: Path, undrawn: None
) -> None:
    """Two runs by themselves, with stated values that the data contradict; the noise, of unknown
    size, has its own symbol.
    """
    rng = np.random.default_rng(4)
    for run in ("one", "two"):
        np.savetxt(
            tmp_path / f"{run}.csv",
            np.column_stack([X, measured(rng)]),
            delimiter=",",
            header="x,y",
            comments="",
        )
    stated = {"phi": "1.00(5)", "offset": "2.0(1)"}
    said = {
        name: f'value = "{stated[name]}"' if name in stated else f"start = {TRUE[name]}"
        for name in UNITS
    }
    parameters = [f'{name} = {{{said[name]}, unit = "{unit}"}}' for name, unit in UNITS.items()]
    lines = [
        'title = "Names"',
        'kind = "synthetic"',
        "[curve]",
        f'expression = "{CURVE}"',
        'x = "x"',
        'y = "y"',
        "[curve.parameters]",
        *parameters,
    ]
    lines += [f'[[runs]]\nname = "{run}"\nfile = "{run}.csv"' for run in ("one", "two")]
    (tmp_path / "campaign.toml").write_text("\n".join(lines))
    out = tmp_path / "out"
    done = CliRunner().invoke(
        cli, ["fit", str(tmp_path / "campaign.toml"), "--out", str(out), "--max-steps", "1000"]
    )
    assert "phi was stated as 1 rad, " in done.output
    assert "offset was stated as 2 m, " in done.output
    assert OF_THE_BODY.findall(done.output) == []
    report, index = (out / "one" / "report.md").read_text(), (out / "report.md").read_text()
    assert OF_THE_BODY.findall(report + index) == []
    assert "| σ_y[one] |" in report
    heads = [axis_of(name) for name in UNITS]
    assert f"| {' | '.join(heads)} |" in index


def test_a_rolling_body_has_its_symbols_and_degrees(replica: Path) -> None:
    problem = load_campaign(replica / "campaign.toml").problem(["heavy-04", "heavy-06"])
    shown = {p.name: p.label for p in problem.parameters}
    wanted = {
        "gamma[heavy]": ("γ[heavy]", "1"),
        "kappa[heavy]": ("κ[heavy]", "1"),
        "theta0[heavy-04]": ("θ₀[heavy-04]", "°"),
        "phi[heavy-06]": ("φ[heavy-06]", "°"),
        "radius": ("R", "m"),
        "rolling_resistance": ("c_rr", "1"),
    }
    assert {name: (shown[name].symbol, shown[name].unit) for name in wanted} == wanted
    assert shown["theta0[heavy-04]"].factor == pytest.approx(180.0 / np.pi)
    assert shown["rolling_resistance"].tex == "c$_{\\mathrm{rr}}$"
    run = problem.runs[0]
    found = run.derived(run.bind(problem.named(problem.start())))
    assert {name: d.label.symbol for name, d in found.items()} | {"resisting_moment": "Q_rr"} == {
        "inertia_ratio": "j",
        "slope": "s",
        "resisting_moment": "Q_rr",
    }


def summary(unit: str, mean: float, *, measured: bool) -> ParameterSummary:
    return ParameterSummary(
        unit,
        "",
        mean,
        0.1,
        mean,
        mean - 0.2,
        mean - 0.1,
        mean + 0.1,
        mean + 0.2,
        prior="",
        prior_mean=None,
        prior_sd=None,
        ess_bulk=None,
        ess_tail=None,
        rhat=None,
        mcse=None,
        stated="",
        measured=measured,
        upper_95=None,
        true=None,
    )


def test_a_column_of_several_runs_holds_one_quantity() -> None:
    """A user's parameter may have the name of a standard deviation that another run infers."""
    parameters = (
        Parameter("sigma_y", "1", Normal(0.0, 1.0), ""),
        Parameter("sigma_y[b]", "V", Normal(0.0, 1.0), "", Notation("σ_y")),
    )
    results = {
        run: SimpleNamespace(
            status="ok",
            runs={},
            parameters={
                p.name: summary(p.unit, m, measured=p.name != "sigma_y" or run == "a")
                for p, m in found
            },
            labels=Labels(
                {p.name: p.label for p, _ in found}, {p.name: p.bare_label for p, _ in found}, {}
            ),
        )
        for run, found in {
            "a": [(parameters[0], 1.0)],
            "b": [(parameters[0], 2.0), (parameters[1], 3.0)],
        }.items()
    }
    text = (
        index_report(SimpleNamespace(title="Names", kind="synthetic"), results)["report.md"]
        .decode()
        .replace("\u00a0", " ")
    )
    assert "| run | status | sigma_y | σ_y (V) |" in text
    assert "| ok | 1.00 ± 0.10 |  |" in text
    assert "| ok | as stated | 3.00 ± 0.10 |" in text


def test_a_parameter_that_nobody_wrote_otherwise_is_shown_as_it_is() -> None:
    for name, unit in UNITS.items():
        shown = Parameter(f"{name}[run 1]", unit, Normal(0.0, 1.0), "").label
        assert (shown.symbol, shown.unit, shown.factor) == (f"{name}[run 1]", unit, 1.0)
