"""Options in place of a campaign file: those that state how a table is written, and those that
define a curve (`estim fit data.csv --formula ...`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from estim.cli.options import Command, Real, Whole, out_folder
from estim.common import KINDS, InputError

if TYPE_CHECKING:
    from estim.campaign import Campaign


class _OrAName(click.Choice):  # type: ignore[type-arg]
    """Choices, or a name that an installed package knows."""

    def convert(self, value: Any, *_: object) -> str:
        return str(value)


_ENCODINGS = (
    "utf-8",
    "utf-16",
    "latin-1",
    "windows-1252",
    "windows-1250",
    "windows-1251",
    "iso-8859-15",
    "mac-roman",
    "cp437",
    "cp850",
)
_DIALECT = (
    click.option(
        "--columns",
        metavar="A,B,...",
        help="Names of all columns of FILE from left to right.  [default: its line of names]",
    ),
    click.option(
        "--delimiter",
        metavar="MARK",
        help="Separator of the cells: ; , | tab or blank.  [default: detected from the rows]",
    ),
    click.option(
        "--decimal",
        type=click.Choice(["point", "comma"]),
        help="Decimal mark.  [default: detected from the numbers]",
    ),
    click.option(
        "--skip-rows",
        type=Whole(0),
        metavar="N",
        help="Lines at the top of FILE that are not read.",
    ),
    click.option(
        "--encoding",
        type=click.Choice(_ENCODINGS),
        help="Encoding of FILE.  [default: UTF-8, or as marked by its first bytes]",
    ),
    click.option(
        "--sheet",
        metavar="NAME",
        help="Sheet of a workbook, or table in a zip archive.  [default: the first with a table]",
    ),
    click.option(
        "--range",
        metavar="A3:D40",
        help="Cells of FILE that are read, as in a spreadsheet; also A3:D, or lines 3:40.",
    ),
    click.option(
        "--dates",
        type=click.Choice(["dmy", "mdy"]),
        help="Order of day and month in 03/05/2024.  [default: where a day above 12 shows it]",
    ),
    click.option(
        "--since",
        metavar="DATE",
        help="Moment that is 0 in a column of dates or times.  [default: its first row]",
    ),
    click.option("--time-unit", metavar="UNIT", help="Unit of such a column.  [default: s]"),
)
_CURVE = (
    click.option(
        "--formula",
        metavar="TEXT",
        help='Fit this curve to the table FILE: "a*exp(-x/tau) + c", or a name: "gaussian + line".',
    ),
    click.option(
        "--rolling",
        multiple=True,
        metavar="KEY=VALUE",
        help="FILE is a run of an eccentric disk that rolls up an incline.  State what is known "
        'of it by the keys of a campaign: radius_m="0.150(1)"; kappa=0:1 is a range.',
    ),
    click.option(
        "--start",
        multiple=True,
        metavar="NAME=VALUE",
        help='Starting value of a parameter: tau="2 s".  [default: from the points]',
    ),
    click.option("--low", multiple=True, metavar="NAME=VALUE", help="Lower limit of a parameter."),
    click.option("--high", multiple=True, metavar="NAME=VALUE", help="Upper limit of a parameter."),
    click.option(
        "--value",
        multiple=True,
        metavar="NAME=VALUE",
        help='A parameter that is known: g=9.81 is exact, g="9.81(2)" was measured.',
    ),
    click.option(
        "--own",
        multiple=True,
        metavar="NAME",
        help="A parameter that has its own value in each table.  [default: one value for all]",
    ),
    click.option(
        "--x",
        multiple=True,
        metavar="COLUMN",
        help='Column of x: "time [s]"; several times, each abscissa of a formula that names them.  '
        "[default: the first of two, or those that the formula names]",
    ),
    click.option("--y", metavar="COLUMN", help="Column of y.  [default: the other of two]"),
    click.option(
        "--u-x",
        metavar="U|COLUMN",
        help="Standard uncertainty of x.  [default: the column u_NAME if there, else x is exact]",
    ),
    click.option(
        "--u-y",
        metavar="U|SHARE|COLUMN",
        help='Standard uncertainty of y; "2%" is a share of the curve, "2% of y" of each reading.  '
        "[default: the column u_NAME if there, else from the residuals]",
    ),
    click.option(
        "--window", metavar="MIN:MAX", help="Range of x that is fit; either end may be left out."
    ),
    click.option(
        "--every", type=Whole(1), metavar="N", help="Fit one of every N points, in order of x."
    ),
    click.option(
        "--deviation",
        type=Real(),
        metavar="D",
        help="Plausible size of a smooth deviation of y from the curve.",
    ),
    click.option(
        "--correlated", is_flag=True, help="Errors are correlated in the order of the rows."
    ),
    click.option(
        "--jitter", is_flag=True, help="y has further independent errors, beside those stated."
    ),
    click.option(
        "--robust",
        type=_OrAName(["student-t", "mixture"]),
        metavar="student-t|mixture|NAME",
        help="Allow for points that are far off: by heavy tails, by a share of outliers, or by a "
        "law of an installed package (docs/extending.md).",
    ),
    click.option(
        "--noise",
        type=click.Choice(["poisson", "binomial", "event-times"]),
        help="What was counted: y are numbers of events, or of successes in --trials; or x are "
        "times of single events, and there is no y.",
    ),
    click.option("--trials", metavar="N|COLUMN", help="Trials at each x, of --noise binomial."),
    click.option(
        "--title", metavar="TEXT", help="Title of the report.  [default: the name of FILE]"
    ),
    click.option(
        "--kind",
        type=click.Choice(list(KINDS)),
        help="What the numbers of FILE are.  [default: measured]",
    ),
    click.option(
        "--track",
        metavar="NAME",
        help="The track of a file of the program Tracker.  [default: the only one]",
    ),
    click.option(
        "--release",
        metavar="first|keep|T",
        help="Where x_m of a Tracker file is 0; points before time T (s) are left out.",
    ),
)


def dialect_options(command: Command) -> Command:
    """Adds the options of `_DIALECT`; the command takes their values as `dialect`, a mapping for
    `dialect_of_options`.
    """
    return _gathered(command, _DIALECT, "dialect")


def curve_options(command: Command) -> Command:
    """Adds all options that stand for a campaign; the command takes their values as `options`, a
    mapping for `load_or_make`.
    """
    return _gathered(command, (*_CURVE, *_DIALECT), "options")


def _gathered(command: Command, options: tuple[Command, ...], name: str) -> Command:
    @wraps(command)
    def gathering(**arguments: Any) -> Any:
        return command(
            **{key: value for key, value in arguments.items() if key not in names},
            **{name: {key: arguments[key] for key in names}},
        )

    decorated: Command = gathering
    for option in reversed(options):
        decorated = option(decorated)
    names = {parameter.name for parameter in decorated.__click_params__[-len(options) :]}  # type: ignore[attr-defined]
    return decorated


def load_or_make(
    file: Path,
    options: Mapping[str, Any],
    out: Path | None,
    runs: Sequence[str],
    others: Sequence[Path],
) -> tuple[Campaign, Path]:
    """The campaign in `file`, with the tables of `runs`, or the one that fits a formula to the
    table `file` and to `others`; and the folder of its report.
    """
    from estim.campaign import campaign_of_table, choices_of_table, load_campaign
    from estim.reading import is_table

    named = [
        f"--{name.replace('_', '-')}"
        for name, value in options.items()
        if value not in (None, (), False)
    ]
    if options["formula"] is None and not options["rolling"]:
        if others:
            rule = "goes with --formula and tables; runs of several campaigns: estim batch"
            raise InputError(rule, field="FILE...", value=str(others[0]))
        if named:
            campaign = file.suffix.lower() == ".toml"
            rule = (
                "needs --formula and a table; for a campaign it is stated in the file"
                if campaign
                else "needs --formula as well"
            )
            raise InputError(rule, field=named[0])
        if is_table(file):
            rule = (
                'is a table, not a campaign: say --formula "a*x + b", or write a campaign for '
                "it (estim new NAME --from FILE)"
            )
            raise InputError(rule, field="CAMPAIGN|FILE", value=str(file))
        return load_campaign(file, asked=runs), out or out_folder(file)
    tables = [file, *others]
    other = next((path for path in tables if path.suffix.lower() == ".toml"), None)
    if other is not None:
        raise InputError(
            "needs a table of points; the curve of a campaign is stated in its file",
            field="--formula" if options["formula"] else "--rolling",
            value=str(other),
        )
    places = [path.resolve() for path in tables]
    twice = next((path for i, path in enumerate(places) if path in places[:i]), None)
    if twice is not None:
        raise InputError("must name each table once", field="FILE...", value=str(twice))
    stem = "+".join(path.stem for path in tables)[:80]
    return campaign_of_table(file, choices_of_table(options), *others), out or Path("out") / stem
