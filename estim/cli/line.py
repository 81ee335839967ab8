"""`estim line`: what sets a body climbing, or a line through any points."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from estim.cli.formats import FORMAT
from estim.cli.language import LANG
from estim.cli.options import NO_FIGURES, OUT, SEED
from estim.cli.release import fit_line_and_trials
from estim.cli.straight import SharedErrors, say_straight_line
from estim.cli.tables import dialect_of, dialect_options
from estim.cli.terminal import NOT_OK
from estim.common import InputError


@click.command()
@click.argument("campaign", metavar="CAMPAIGN|FILE.csv", type=click.Path(path_type=Path))
@click.option(
    "--x", "x", metavar="NAME", help="Column of FILE.csv.  [default: x, or the first of two]"
)
@click.option("--y", "y", metavar="NAME", help="[default: y, or the other of two]")
@click.option(
    "--ux",
    metavar="NAME|U",
    help="Standard uncertainties of x: a column, or a number.  [default: the column u_NAME, if "
    "there]",
)
@click.option("--uy", metavar="NAME|U", help="The same of y.")
@click.option(
    "--correlation",
    metavar="NAME|R",
    help="Correlation of the two errors of a point.  [default: the column r_xy, if there]",
)
@click.option(
    "--cov",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Covariance matrix of all x, then all y, in place of --ux and --uy.",
)
@click.option(
    "--cov-x", type=click.Path(path_type=Path), metavar="FILE", help="Covariance matrix of the x."
)
@click.option(
    "--cov-y", type=click.Path(path_type=Path), metavar="FILE", help="Covariance matrix of the y."
)
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
@SEED
@NO_FIGURES
@FORMAT
@LANG
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
    no_figures: bool,
    dialect: Mapping[str, Any],
) -> None:
    """Fit the theta_min line and the trials of release of CAMPAIGN's body, or a line through the
    points of FILE.csv.

    The theta_min line is sin(theta_min) against sin(phi), of slope 1/gamma.  A table may have
    errors in y, in both variables, correlated ones, or none (docs/straight-line.md).
    """
    names = (x, y, ux, uy, correlation)
    table = campaign.suffix.lower() != ".toml"
    errors = SharedErrors(cov, cov_x, cov_y, common_x, common_y)
    if not table and any((*names, *errors, *predict, *inverse, *dialect.values())):
        raise InputError(
            "must be a table of points where columns are named or values asked for",
            field="FILE.csv",
            value=str(campaign),
        )
    if table:
        folder, written = out or Path("out") / campaign.stem, dialect_of(dialect)
        ok = say_straight_line(
            campaign,
            names,
            folder,
            predict=predict,
            inverse=inverse,
            figures=not no_figures,
            dialect=written,
            errors=errors,
        )
    else:
        ok = fit_line_and_trials(campaign, out, seed=seed, figures=not no_figures)
    if not ok:
        sys.exit(NOT_OK)
