"""What names of runs and bodies may be made of: they become names of files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from estim.common import REPORT_FILES, folded
from estim.reading import Places

_MAX_NAME = 100  # bytes
_REPORT = (  # what stands in the folder where a run gets its own
    *REPORT_FILES,
    "result.json",
    "comparison.json",
    "models.json",
    "calibration.json",
    "origin.json",
    "figures",
    "tables",
)


def check_run_names(names: Sequence[str], places: Places) -> None:
    """Names of runs are unique and can be names of folders beside the files of a report.  Raises
    InputError.
    """
    for i, name in enumerate(names):
        for holds, rule in (
            (
                len(name.encode()) <= _MAX_NAME,
                f"must be short enough for the name of a file: at most {_MAX_NAME} bytes",
            ),
            (folded(name) not in _REPORT, "must not be the name of a file of the report"),
            (
                re.fullmatch(r"\w[\w.+-]*", name),
                "must be made of letters, digits and . _ + -, a letter or digit first",
            ),
        ):
            if not holds:
                raise places.error(rule, ("runs", i, "name"), value=name)
    indices: dict[str, int] = {}
    for later, name in enumerate(names):
        first = indices.setdefault(folded(name), later)
        if first == later:
            continue
        line = places.lines.get(("runs", first, "name"))
        rule = (
            "must be unique"
            if name == names[first]
            else "must differ from another name in more than case or Unicode form"
        )
        raise places.error(
            rule if line is None else f"{rule} (the other stands on line {line})",
            ("runs", later, "name"),
            value=name,
        )


def check_body_names(names: Iterable[str], places: Places) -> None:
    """Names of bodies can be part of the name of a figure's file.  Raises InputError."""
    for name in names:
        if not re.fullmatch(r"[^\W_][\w .+-]*", name) or len(name.encode()) > _MAX_NAME:
            rule = (
                "must be made of letters, digits, blanks and . _ + -, a letter or digit first, "
                f"at most {_MAX_NAME} bytes"
            )
            raise places.error(rule, ("bodies", name), field="bodies", value=name)
