"""Whose the files are that stand where results go.

A folder of results holds a manifest (`origin.json` of a report, `row.json` of a run in a batch)
with the SHA-256 digest of each file that was written beside it.  A file that has its digest there
is estim's own and may be replaced or removed; any other is somebody's work and stays as it is.
While a report is being replaced its manifest names both digests of a file, the new one and the old
one: a crash leaves nothing that nobody owns.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path, PurePosixPath

from estim.common.errors import EstimError, InputError
from estim.common.storage import Files, names_in, read_file, remove_empty, remove_files, write_whole

REPORT_FILES = ("report.md", "report.html", "report.pdf", "draws.nc")
"""What would pass for a part of any report that is written beside it."""
FIGURES = (
    "abscissas",
    "budget",
    "chances",
    "comparison",
    "consistency",
    "corner",
    "counts",
    "coverage",
    "deviation",
    "directions",
    "distribution",
    "energy",
    "force",
    "line",
    "mean",
    "map",
    "narrowing",
    "overview",
    "phase",
    "places",
    "predictive",
    "profiles",
    "ranks",
    "ratios",
    "regions",
    "residuals",
    "residuals_together",
    "rolling",
    "traces",
    "trials",
    "values",
)
"""Names of all figures, without the subject that may follow after a hyphen."""

_FIGURE = re.compile(rf"({'|'.join(FIGURES)})(-.*)?\.png")
_OTHERS = "was not written by estim, or was changed since: move it away, or choose another folder"
_LARGEST = 2**30  # bytes; no file of a report is larger


def require_own(
    folder: Path,
    names: Iterable[str],
    digests: Mapping[str, str],
    *,
    within: Path,
    rule: str = _OTHERS,
) -> None:
    """Raises EstimError where one of `names` stands in `folder` and is not as estim wrote it.

    digests : of what estim wrote there, by its manifest.  rule : what the error says.
    """
    for name in names:
        data = read_file(folder / name, at_most=_LARGEST, within=within)
        if data is not None and sha256(data).hexdigest() not in digests.get(name, "").split():
            raise InputError(rule, file=folder / name)


def require_room(
    folder: Path, names: Iterable[str], digests: Mapping[str, str], *, within: Path
) -> None:
    """`require_own` before anything is computed: of `names`, of what every report has, and of each
    figure with the name of one of estim's.
    """
    figures = [
        f"figures/{name}"
        for name in names_in(folder / "figures", within=within)
        if _FIGURE.fullmatch(name)
    ]
    require_own(folder, (*REPORT_FILES, *names, *figures), digests, within=within)


def replace_own(
    folder: Path,
    files: Files,
    digests: Mapping[str, str],
    manifest: str,
    record: Callable[[Mapping[str, str]], bytes],
    *,
    within: Path,
) -> None:
    """Write `files` in place of what the manifest before had, of which nothing stays.

    digests : of what estim wrote there before.
    record : the bytes of the manifest for digests of all files.  Raises EstimError, with nothing
        changed, where one of them would replace what is not estim's.
    """
    hashes = {name: sha256(data).hexdigest() for name, data in sorted(files.items())}
    both = {
        name: " ".join(filter(None, (hashes.get(name), digests.get(name))))
        for name in sorted({*hashes, *digests})
    }
    require_own(folder, files, both, within=within)  # the same bytes take nothing from anybody
    write_whole(folder / manifest, record(both), within=within)
    for name, data in files.items():
        write_whole(folder / name, data, within=within)
    remove_own(
        folder,
        {name: digest for name, digest in digests.items() if name not in files},
        within=within,
    )
    write_whole(folder / manifest, record(hashes), within=within)


def remove_own(folder: Path, digests: Mapping[str, str], *, within: Path) -> None:
    """Remove the files that are as estim wrote them, and the folders below `folder` that this
    leaves empty.
    """
    for name in digests:
        with suppress(EstimError):  # what somebody put there stays
            require_own(folder, [name], digests, within=within)
            path = folder / name
            remove_files(path.parent, [path.name], within=within)
            if len(PurePosixPath(name).parts) > 1:
                remove_empty(path.parent, within=within)
