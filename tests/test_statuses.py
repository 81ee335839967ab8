"""Every status is produced from real trouble, through the command line, beside the same campaign
without it; and a bad one gives no number away.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.collections import PolyCollection
from report_words import first_screen, printed_words
from troubles import TROUBLES, Disk, Formula, Trouble, uniform

from estim.campaign import load_campaign
from estim.checks.diagnosis import sampling_findings
from estim.checks.modes import find_modes, optima
from estim.cli.commands import cli
from estim.common.statuses import Status
from estim.fitting.least_squares import Fit, at_mode
from estim.pipeline import Analysis, analyse
from estim.problem.posterior import Posterior
from estim.reports.curve_figures import phase_figure, phase_plane_figure
from estim.sampling import certified
from estim.sampling.certificate import Certificate
from estim.sampling.chain import Target
from estim.sampling.independent_check import second_opinion
from estim.sampling.proposal import Proposal
from estim.studies.paper_band import propagated_bands
from estim.words import describe

NAMED = ("mean", "sd", "median", "q025", "q16", "q84", "q975")


@dataclass(frozen=True)
class Written:
    """What `estim fit` left behind."""

    exit_code: int
    output: str
    report: str
    result: dict


def fit(campaign: Disk | Formula, folder: Path, *options: str) -> Written:
    done = CliRunner().invoke(
        cli, ["fit", str(campaign.write(folder)), "--out", str(folder / "out"), *options]
    )
    report = (folder / "out" / "report.md").read_text().replace("\u00a0", " ")
    return Written(
        done.exit_code,
        done.output,
        report,
        json.loads((folder / "out" / "result.json").read_text()),
    )


_NOT_OF_THE_RESULT = (
    "stated before (prior)",
    "fitted value if it is the only cause",
    "the campaign with it",
)


def tables(report: str) -> list[list[list[str]]]:
    """The cells of each table of a Markdown text, its head first."""
    blocks = re.findall(r"(?:^\|.*\n)+", report, re.MULTILINE)
    return [
        [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
        for block in blocks
    ]


def assert_no_headline(written: Written, status: str) -> None:
    """No mean, sd or value with an uncertainty anywhere, but in what was stated before; limits
    where the draws mean anything.
    """
    result, report = written.result, written.report
    assert "## No main result" in report
    assert "## Result" not in report
    for table in tables(report):
        for row in table[1:]:
            assert not any(
                "±" in cell
                for head, cell in zip(table[0], row, strict=True)
                if head not in _NOT_OF_THE_RESULT
            ), row
        assert not {"posterior", "posterior sd", "ratio", "all", "least squares (mode ± sd)"} & set(
            table[0]
        )
    assert "n/a" not in report
    assert set(result["fit"]["sds"].values()) == {None}
    derived = [d for run in result["runs"].values() for d in run["derived"].values()]
    for summary in [*result["parameters"].values(), *result["turning_point"].values(), *derived]:
        assert summary["mean"] is None
        assert summary["sd"] is None
        if not Status(status).draws_count:
            assert all(summary[name] is None for name in NAMED)
    assert all(
        (p["q025"] is None) == (not Status(status).draws_count)
        for p in result["parameters"].values()
    )
    assert ("not even a limit" in report) == (not Status(status).draws_count)
    assert ("95 % of the profile" in report) == Status(status).limits_count


@pytest.mark.slow
@pytest.mark.parametrize("name", TROUBLES)
def test_trouble_leads_to_its_status_and_to_no_headline_number(
    name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    request.getfixturevalue("few_draws")
    # what is hardest to draw is drawn
    request.getfixturevalue(
        "unrendered" if name in ("computed data", "flat direction") else "undrawn"
    )
    trouble: Trouble = TROUBLES[name]
    written = fit(trouble.campaign, tmp_path, *trouble.options)
    assert written.exit_code == 3
    assert written.result["status"] == trouble.status
    assert f"r: {trouble.status}" in written.output
    assert f"**Status: {trouble.status}**" in written.report
    assert any(re.search(trouble.reason, reason) for reason in written.result["reasons"]), (
        written.result["reasons"]
    )
    assert any(trouble.advice in advice for advice in written.result["advice"])
    for words in written.result["reasons"] + written.result["advice"]:
        assert f"- {words}\n" in written.report
        assert words in written.output or words in written.result["advice"]
    assert_no_headline(written, trouble.status)
    assert len(printed_words(first_screen(written.report).partition("![")[0])) <= 120
    assert "First step: " in first_screen(written.report)
    if name == "wrong tilt":
        assert_said_before_any_cost(written)


def assert_said_before_any_cost(written: Written) -> None:
    """A tilt ten times too large: said first, without a chain to its end or a second opinion."""
    first, second = written.output.splitlines()[:2]
    assert first == "r: contradiction"
    assert "φ[r] was stated as 40 °" in second
    assert written.result["sampling"]["n_step"] <= 60
    assert written.result["certificate"]["method"] is None


@pytest.mark.slow
@pytest.mark.parametrize("name", TROUBLES)
def test_without_the_trouble_the_status_is_ok(name: str, tmp_path: Path, healthy: Analysis) -> None:
    analysis = healthy
    if TROUBLES[name].healthy != Disk():
        analysis = analyse(
            load_campaign(TROUBLES[name].healthy.write(tmp_path)),
            ["r"],
            seed=1,
            target=Target(ess=1000.0),
        )
    assert analysis.diagnosis.status == "ok", analysis.diagnosis.reasons


@pytest.mark.parametrize(
    ("stuck", "words"), [(0, None), (1, "1 walker never moved"), (3, "3 walkers never moved")]
)
def test_walkers_that_never_moved_are_told(
    stuck: int, words: str | None, healthy: Analysis
) -> None:
    found = sampling_findings(replace(healthy.chain, stuck=stuck))
    assert [describe(finding) for finding in found] == ([] if words is None else [words])
    assert all(finding.status == "not-converged" for finding in found)


def test_all_statuses_are_produced_here() -> None:
    assert {trouble.status for trouble in TROUBLES.values()} | {
        "methods-disagree",
        "not-calibrated",
        "ok",
    } == set(Status)


@pytest.mark.slow
@pytest.mark.parametrize(("widened", "expected"), [(1.0, "ok"), (1.2, "methods-disagree")])
@pytest.mark.usefixtures("undrawn")
def test_certificate_of_another_density_disagrees(
    widened: float, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The two computations get densities that differ by a power: standard deviations 10 % apart."""

    @dataclass(frozen=True, eq=False)
    class Tempered:
        posterior: Posterior

        @property
        def names(self) -> tuple[str, ...]:
            return self.posterior.names

        def log_density(self, draws: np.ndarray) -> np.ndarray:
            return self.posterior.log_density(draws) / widened

    def certify_another(
        posterior: Posterior, *args: object, **choices: object
    ) -> tuple[Certificate, Proposal]:
        return second_opinion(Tempered(posterior), *args, **choices)

    monkeypatch.setattr(certified, "second_opinion", certify_another)
    written = fit(Disk(), tmp_path)
    assert written.result["status"] == expected
    assert written.exit_code == (0 if expected == "ok" else 3)
    if expected != "ok":
        again = (
            r"chain and importance sampling differ \(as they did before, with other random "
            r"numbers\)"
        )
        differ = re.compile(again + r" in .*the (median|[\d.]+ % quantile) of")
        assert any(differ.search(reason) for reason in written.result["reasons"])
        assert any(
            "one of two computations of the same quantity is wrong" in advice
            for advice in written.result["advice"]
        )
        assert_no_headline(written, expected)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    return analyse(
        load_campaign(Disk().write(tmp_path_factory.mktemp("ok"))),
        ["r"],
        seed=1,
        target=Target(ess=1000.0),
    )


@pytest.mark.parametrize("status", Status)
def test_only_an_ok_result_has_bands(status: Status, healthy: Analysis) -> None:
    figure = phase_figure(replace(healthy, diagnosis=replace(healthy.diagnosis, status=status)))
    ax, below = figure.axes
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    for panel in (ax, below):
        assert any(isinstance(part, PolyCollection) for part in panel.collections) == (
            status == "ok"
        )
    assert any("%" in text for text in texts) == (status == "ok")
    assert ax.get_title() == ("r" if status == "ok" else f"r — {status}")


@pytest.mark.parametrize("status", Status)
def test_runs_in_one_pair_of_axes_have_bands_of_the_fit_only_if_it_is_ok(
    status: Status, healthy: Analysis
) -> None:
    (stated,) = propagated_bands(healthy, rng=np.random.default_rng(1), published=())
    judged = replace(healthy, diagnosis=replace(healthy.diagnosis, status=status))
    figure = phase_plane_figure(judged, [stated], {"r": "r, φ = 4.0°"})
    (ax,) = figure.axes
    fills = [part for part in ax.collections if isinstance(part, PolyCollection)]
    assert len(fills) == (3 if status == "ok" else 1)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["r, φ = 4.0°"]


def test_draws_that_mean_nothing_come_before_any_other_status() -> None:
    """Else a result "at-bound" would quote limits from draws that cannot be trusted."""
    assert [status.draws_count for status in Status] == [False] * 3 + [True] * (len(Status) - 3)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_bad_runs_have_no_numbers_in_the_index(tmp_path: Path) -> None:
    """Not even of the run whose report quotes limits."""
    path = TROUBLES["gamma at its bound"].campaign.write(tmp_path)
    text = path.read_text()
    second = (
        text[text.index("[[runs]]") :]
        .replace('name = "r"', 'name = "eccentric"')
        .replace('body = "b"', 'body = "c"')
    )
    body = '[bodies.c]\nradius_m = 0.15\ngamma = "0.187(10)"\nkappa = "0.45(2)"\n'
    path.write_text(text.replace("[[runs]]", f"{body}[[runs]]") + second)
    done = CliRunner().invoke(cli, ["fit", str(path), "--out", str(tmp_path / "out")])
    assert done.exit_code == 3
    rows = {
        row[0]: row[1:]
        for row in tables((tmp_path / "out" / "report.md").read_text().replace("\u00a0", " "))[0]
    }
    assert rows["[r](r/report.md)"][0] == "at-bound"
    assert set(rows["[r](r/report.md)"][1:]) == {"—"}
    assert rows["[eccentric](eccentric/report.md)"][0] == "ok"
    assert any("±" in cell for cell in rows["[eccentric](eccentric/report.md)"])


@pytest.mark.slow
def test_two_modes_are_told_from_a_bent_ridge(tmp_path: Path) -> None:
    """The ridge of the flat direction is bent, so that straight lines between its ends leave it;
    the two angles of release are no ridge.
    """
    # with kappa known they are a trouble above
    two_angles = replace(TROUBLES["two angles of release"].campaign, kappa=uniform(0.3, 0.6))
    few = load_campaign(two_angles.write(tmp_path))
    assert len(analyse(few, ["r"], seed=1, target=Target(ess=1000.0)).modes.values) == 2
    path = TROUBLES["flat direction"].campaign.write(tmp_path)
    # they take the dips away
    path.write_text(
        path.read_text().replace(
            "unmodelled_force = 0\n", "unmodelled_force = 0\nscale_x = 0\nscale_t = 0\n"
        )
    )
    flat = load_campaign(path)
    found = analyse(flat, ["r"], seed=1, target=Target(ess=1000.0))
    draws = found.chain.thinned(2000)
    highest = draws[np.argsort(-found.fit.posterior.log_density(draws))]
    # where on the ridge a search ends differs from one processor to the next: a place beside which
    # others count
    for place in highest[::50]:
        fit = at_mode(found.fit.problem, place)
        ends = [draw for draw in highest[::4] if _dips(fit, draw) and _counts(fit, draw)][:3]
        if ends:
            break
    with_ends = replace(fit, others=tuple(ends))
    assert np.any(optima(with_ends).shares[1:] > 1e-3)  # else nobody looks at them
    assert len(find_modes(with_ends, draws).values) == len(found.modes.values) == 1


def _counts(fit: Fit, end: np.ndarray) -> bool:
    return bool(np.any(optima(replace(fit, others=(end,))).shares[1:] > 1e-3))


def _dips(fit: Fit, end: np.ndarray) -> bool:
    heights = fit.posterior.log_density(
        fit.values + np.linspace(0.0, 1.0, 65)[:, None] * (end - fit.values)
    )
    return bool(heights.min() < min(heights[0], heights[-1]) - 2.0)


def test_start_chooses_between_solutions_where_no_prior_does(tmp_path: Path) -> None:
    """a and -a give the same curve: a start says which is meant, a range that holds both does
    not.
    """
    for start in (1.0, -1.0):
        campaign = load_campaign(
            Formula("a**2*x", f"a = {{start = {start}}}", lambda x: 4.0 * x).write(tmp_path)
        )
        found = analyse(campaign, ["r"], seed=1, target=Target(ess=1000.0))
        assert found.diagnosis.status == "ok"
        assert found.fit.values[0] == pytest.approx(2.0 * start, rel=0.01)
