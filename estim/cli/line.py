"""`estim line`: what sets a body climbing, or a line through any points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from estim.cli.options import OUT, PATH, out_folder, report_options
from estim.cli.tables import dialect_options
from estim.cli.terminal import conclude, finish, progress_bar, reserve_output, say, write_report
from estim.common import FigureChoice, InputError, phrase, read_quantity


@click.command()
@click.argument("campaign", metavar="CAMPAIGN|FILE.csv", type=PATH)
@click.option(
    "--x", "x", metavar="NAME", help="Column of FILE.csv.  [default: x, or the first of two]"
)
@click.option("--y", "y", metavar="NAME", help="[default: y, or the other of two]")
@click.option(
    "--ux",
    "--u-x",
    "ux",
    metavar="NAME|U",
    help="Standard uncertainties of x: a column, or a number.  [default: the column u_NAME, if "
    "there]",
)
@click.option("--uy", "--u-y", "uy", metavar="NAME|U", help="The same of y.")
@click.option(
    "--correlation",
    metavar="NAME|R",
    help="Correlation of the two errors of a point.  [default: the column r_xy, if there]",
)
@click.option(
    "--cov",
    type=PATH,
    metavar="FILE",
    help="Covariance matrix of all x, then all y, in place of --ux and --uy.",
)
@click.option("--cov-x", type=PATH, metavar="FILE", help="Covariance matrix of the x.")
@click.option("--cov-y", type=PATH, metavar="FILE", help="Covariance matrix of the y.")
@click.option(
    "--common-x",
    multiple=True,
    metavar="U|U%",
    help="Error common to all x, besides their own: 0.1 of the zero, or 2% of the scale.",
)
@click.option("--common-y", multiple=True, metavar="U|U%", help="The same of y.")
@click.option(
    "--predict",
    multiple=True,
    metavar="X0",
    help='y of the line at X0, which may be uncertain: "5.0(1)"; may be given several times.',
)
@click.option(
    "--inverse",
    multiple=True,
    metavar="Y0",
    help='x at which the line reaches a reading Y0: "10.5(5)"; may be given several times.',
)
@dialect_options
@OUT
@report_options
def line(
    campaign: Path,
    x: str | None,
    y: str | None,
    ux: str | None,
    uy: str | None,
    correlation: str | None,
    cov: Path | None,
    cov_x: Path | None,
    cov_y: Path | None,
    common_x: tuple[str, ...],
    common_y: tuple[str, ...],
    predict: tuple[str, ...],
    inverse: tuple[str, ...],
    out: Path | None,
    seed: int,
    figures: FigureChoice,
    dialect: Mapping[str, Any],
) -> None:
    """Fit a straight line through the points of FILE.csv, or the theta_min line and the trials of
    release of CAMPAIGN's body.

    A table may have errors in y, in both variables, correlated ones, or none
    (docs/straight-line.md).  The theta_min line is sin(theta_min) against sin(phi), of slope
    1/gamma.
    """
    if campaign.suffix.lower() == ".toml":
        options = (x, y, ux, uy, correlation, cov, cov_x, cov_y, common_x, common_y)
        if any((*options, *predict, *inverse, *dialect.values())):
            raise InputError(
                "must be a table of points where columns are named or values asked for",
                field="FILE.csv",
                value=str(campaign),
            )
        _fit_line_and_trials(
            campaign, out or out_folder(campaign, "line"), seed=seed, figures=figures
        )
        return
    from estim.line import LineColumns, LineCovariances, commons, straight_line
    from estim.reading import dialect_of_options
    from estim.reports.straight_line import straight_line_lines, straight_line_report

    folder, table_dialect = out or Path("out") / campaign.stem, dialect_of_options(dialect)
    predict_at = [read_quantity(text, field="--predict") for text in predict]
    inverse_at = [read_quantity(text, field="--inverse") for text in inverse]
    shared = LineCovariances(cov, cov_x, cov_y, commons(common_x, common_y))
    reserve_output(folder, "result.json")
    fitted = straight_line(
        campaign,
        LineColumns(x or "", y or "", ux, uy, correlation),
        predict=predict_at,
        inverse=inverse_at,
        dialect=table_dialect,
        correlated=shared,
    )
    write_report(folder, straight_line_report(fitted, figures=figures))
    say(fitted.told)
    conclude(phrase("line"), fitted.status, straight_line_lines(fitted), fitted.facts)
    finish(folder, fitted.status.ok)


def _fit_line_and_trials(campaign: Path, folder: Path, *, seed: int, figures: FigureChoice) -> None:
    """The theta_min series and the trials of release of a campaign, in one report."""
    from estim.campaign import gamma_of_body, load_campaign, resistance_of_body
    from estim.line import analyse_line, analyse_trials, read_theta_min, read_trials
    from estim.reports.theta_min_line import line_lines, line_report
    from estim.reports.trials import trials_lines, trials_report
    from estim.sampling import Target

    loaded = load_campaign(campaign)
    loaded.require_body()
    source, target = loaded.source, Target()
    trials = None if source.trials is None else read_trials(source)
    series = read_theta_min(source) if trials is None or source.line is not None else None
    reserve_output(folder, "result.json", "trials.json")
    line = released = None
    if series is not None:
        with progress_bar(phrase("line")) as progress:
            line = analyse_line(
                series,
                gamma_masses=gamma_of_body(source, series.body),
                seed=seed,
                target=target,
                progress=progress,
            )
    if trials is not None:
        resistance = resistance_of_body(source, trials.body)
        gamma = gamma_of_body(source, trials.body)
        with progress_bar(phrase("trials")) as progress:
            released = analyse_trials(
                trials, resistance, gamma_masses=gamma, seed=seed, target=target, progress=progress
            )
    files = {}
    if line is not None:
        files = line_report(loaded, line, trials=released, figures=figures)
    elif released is not None:
        files = trials_report(loaded, released, figures=figures)
    write_report(folder, files)
    if line is not None:
        sentences = line_lines(loaded, line) if line.status.ok else line.reasons
        further = filter(None, (line.disagreement, line.assumption))
        conclude(phrase("line"), line.status, [*sentences, *further])
    if released is not None:
        trial_sentences = trials_lines(loaded, released) if released.status.ok else released.reasons
        conclude(phrase("trials"), released.status, [*trial_sentences, *released.disagreements])
    ok = all(analysis.status.ok for analysis in (line, released) if analysis is not None)
    finish(folder, ok, source.files_outside(runs=False, line=True))
