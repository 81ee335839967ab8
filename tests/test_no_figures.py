"""Reports without figures: the same text and numbers, no link to what is not there, nothing that
draws loaded, no figure of an earlier report.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from replica_run import heavy_04
from troubles import Formula

from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.curve_fitting.single import fit_curve
from estim.line import analyse_line, read_theta_min
from estim.pipeline import analyse, sample_curve
from estim.reports.analysis import analysis_report
from estim.reports.curve import curve_report
from estim.reports.rendering import render
from estim.reports.theta_min_line import line_report
from estim.sampling import Target

IMAGE = re.compile(r"!\[[^\]]*\]\((\S+)\)\n(?:\n\*(?:[^*]|\*(?!\n\n))+\*\n)?")  # with its caption


def shown(files: dict[str, bytes]) -> set[str]:
    return set(IMAGE.findall(files["report.md"].decode()))


def drawn(files: dict[str, bytes]) -> set[str]:
    return {path for path in files if path.endswith(".png")}


def lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("runs", "some"),
    [
        (["heavy-04"], {"phase", "force", "directions"}),
        (["heavy-02", "heavy-04"], {"consistency", "residuals_together"}),
    ],
)
def test_without_figures_a_report_is_the_same_but_for_images_captions_and_words_about_them(
    runs: list[str], some: set[str]
) -> None:
    campaign, analysis = heavy_04()
    if len(runs) > 1:
        few = Target(ess=400)
        analysis = analyse(campaign, runs, seed=1, target=few, complete="two runs, which cost less")
    whole, main, bare = (
        analysis_report(campaign, analysis, figures=wanted) for wanted in ("all", "main", "none")
    )
    assert shown(whole) == drawn(whole) >= {f"figures/{name}.png" for name in some}
    assert shown(main) == drawn(main) == {"figures/phase.png"}
    assert main["figures/phase.png"] == whole["figures/phase.png"]
    assert "`--figures all`" in main["report.md"].decode()
    assert "`--figures all`" not in whole["report.md"].decode() + bare["report.md"].decode()
    assert bare == {"report.md": bare["report.md"], "result.json": whole["result.json"]}
    text = IMAGE.sub("", whole["report.md"].decode())
    text = re.sub(" and taken out of Figure [0-9]+", "", text)
    assert lines(bare["report.md"].decode()) == lines(text)
    assert " figure" not in text.lower()


@pytest.mark.usefixtures("undrawn")
def test_a_line_without_its_figure(replica: Path) -> None:
    campaign = load_campaign(replica / "campaign.toml")
    analysis = analyse_line(
        read_theta_min(campaign.source), gamma_masses=None, seed=1, target=Target(ess=400)
    )
    whole, bare = (line_report(campaign, analysis, figures=wanted) for wanted in ("main", "none"))
    assert shown(whole) == drawn(whole) == {"figures/line.png"}
    assert bare == {"report.md": bare["report.md"], "result.json": whole["result.json"]}
    assert lines(bare["report.md"].decode()) == lines(IMAGE.sub("", whole["report.md"].decode()))


@pytest.mark.usefixtures("undrawn")
def test_a_report_shows_no_figure_that_it_does_not_have() -> None:
    """Figures that only some fits have: one parameter, one run."""
    x = [0.1 * i for i in range(8)]
    fit = fit_curve("a*x", x, [2.0 * one for one in x], u_y=0.05, start={"a": 1.0})
    files = curve_report(
        fit,
        sample_curve(fit, seed=1, target=Target(ess=400)),
        title="one",
        kind="synthetic",
        figures="all",
    )
    assert shown(files) == drawn(files) > {"figures/phase.png", "figures/corner.png"}


def test_every_figure_of_every_template_is_asked_whether_it_is_there(project: Path) -> None:
    for template in (project / "estim" / "reports" / "templates").glob("*.j2"):
        assert "![" not in template.read_text(), template
    assert (
        render("consistency.md.j2", pictures=["figures/consistency.png"], **EMPTY).count("![") == 1
    )
    assert "![" not in render("consistency.md.j2", **EMPTY)


EMPTY = {
    "consistency": {"agree": True, "verdict": "", "dof": 0, "shared": []},
    "reject_below": 0.0,
    "limits_only": True,
}


@pytest.mark.slow
def test_nothing_that_draws_is_loaded_for_a_report_without_figures(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom estim.__main__ import main\ntry: main()\nexcept SystemExit: "
        "print(*sorted(sys.modules))"
    )
    decay = Formula("a*exp(-b*x)", "a = {start = 1.0}\nb = {start = 1.0}", lambda x: np.exp(-x))
    arguments = ["fit", decay.write(tmp_path), "--out", tmp_path / "out", "--figures", "none"]
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = set(done.stdout.splitlines()[-1].split())
    assert {"estim.reports.curve_figures", "jinja2", "scipy.optimize", "emcee"} <= loaded
    assert not {"matplotlib.figure", "matplotlib.pyplot", "corner"} & loaded
    assert not (tmp_path / "out" / "figures").exists()
    assert "![" not in (tmp_path / "out" / "report.md").read_text()


def test_every_command_that_draws_can_do_without(project: Path) -> None:
    having = {
        name
        for name, command in cli.commands.items()
        if any(one.name == "figures" for one in command.params)
    }
    assert having == set(cli.commands) - {
        "simulate",
        "import",
        "body",
        "new",
        "verify",
        "diff",
        "models",
        "serve",
    }
    passed = [
        (
            ast.unparse(call.func),
            {one.arg: ast.unparse(one.value) for one in call.keywords}.get("figures"),
        )
        for file in (
            "calibrating",
            "commands",
            "line",
            "mapping",
            "models",
            "planning",
            "propagating",
        )
        for call in ast.walk(ast.parse((project / "estim" / "cli" / f"{file}.py").read_text()))
        if isinstance(call, ast.Call)
        and ast.unparse(call.func).endswith(("_report", "compare_models"))
    ]
    asked = {"figures", "drawn"}
    assert {name for name, wanted in passed if wanted not in asked} == {
        "index_report",
        "write_report",
    }
    assert len(passed) > 12
