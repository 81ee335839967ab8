"""A campaign file to begin with: what a table shows, a first guess at a curve, and comments that
explain what else may stand there.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from estim.campaign.table_campaign import TableChoices, campaign_of_table, text_of_table
from estim.common import InputError, listed
from estim.reading import (
    Layout,
    bare_name,
    first_and_second,
    is_track,
    is_tracker_file,
    numeric_columns,
    read_layout,
    value_columns,
)

GUESS = "a + b*x"
_GUESS_OF_TRACK = "a + b*x + c*x**2"
_COMMENTS = {
    "kind": '"measured", "synthetic" or "published": printed on every report',
    "expression": "the curve: x and the parameters below",
    "every": "one of so many points, in order of x",
    "[curve.parameters]": "{}: found from the points; or start = 1.0; low, high: limits; or a "
    'value: g = 9.81 (exact), g = "9.81(2)" (measured)',
    "file": "beside this file, or a path from here",
}
_MORE = """# window = {min = 0.0, max = 10.0}    # in x
# errors = {zero_y = 0.01}            # of all points together: zero_x, zero_y, scale_x, scale_y
# deviation = 0.01                    # a smooth deviation of y from the curve that would not surprise you
# correlated = true                   # errors follow each other in the order of the rows"""


def drafted_campaign(
    file: Path, choices: TableChoices, *others: Path, within: Path
) -> tuple[str, str]:
    """The text of a campaign in the folder `within` that fits a curve to `file` and to `others`,
    and which columns are x and y; without a formula, a guess.

    Raises InputError where the table cannot be read as it would be.
    """
    if choices.rolling:
        columns = "" if is_track(file) else listed(columns_of(file, choices))
    elif is_tracker_file(file):
        choices = replace(
            choices,
            x=choices.x or "t_s",
            y=choices.y or "x_m",
            formula=choices.formula or _GUESS_OF_TRACK,
        )
        columns = (
            "t, x, y (s and m, in the calibrated axes), frame; t_s, x_m and across_m, along "
            "the motion, from the release"
        )
    else:
        columns = listed(columns_of(file, choices))
        if not choices.formula:
            choices = _guessed(file, choices)
    campaign = campaign_of_table(file, choices, *others)
    lines = (
        [f"# Columns of numbers in {file.name}: {columns}".replace("\n", " ")] if columns else []
    )
    written = text_of_table(file, choices, *others, within=within).splitlines()
    stated = any(line.startswith("u_y = ") for line in written)
    for line in written:
        key = line.partition(" =")[0]
        lines.append(f"{line}    # {_COMMENTS[key]}" if key in _COMMENTS else line)
        if key == "y":
            lines += (
                []
                if stated
                else [
                    "# u_y = 0.02    # standard uncertainty of one y; left out: found from "
                    "the residuals"
                ]
            )
            lines += _MORE.splitlines()
    return "\n".join(lines) + "\n", campaign.columns(campaign.run_names)


def _guessed(file: Path, choices: TableChoices) -> TableChoices:
    """A first guess at a curve; x and y as stated, else the first columns of values that are left.
    Raises InputError where too few are.
    """
    values = value_columns(_layout(file, choices), (choices.u_x, choices.u_y))
    rest = [name for name in values if not {name, bare_name(name)} & {choices.x, choices.y}]
    x, y = first_and_second(rest) or (*rest[:2], "", "")[:2]
    x, y = choices.x or x, choices.y or (y if choices.x is None else x)
    if not x or not y:
        raise InputError(
            "has fewer than two columns of numbers that are not uncertainties",
            field="columns",
            quoted=listed(values),
            file=file,
        )
    return replace(choices, x=x, y=y, formula=GUESS)


def columns_of(file: Path, choices: TableChoices) -> tuple[str, ...]:
    """Names of the columns of a table that hold numbers.  Raises InputError."""
    return numeric_columns(_layout(file, choices))


def _layout(file: Path, choices: TableChoices) -> Layout:
    return read_layout(file, choices.dialect)
