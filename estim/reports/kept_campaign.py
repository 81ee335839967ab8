"""The campaign of a fit that was said on a command line, at the end of its report: whoever keeps it can go on from there."""

from __future__ import annotations

from collections.abc import Mapping

from estim.common import Markdown
from estim.reports.rendering import render


def with_campaign(files: Mapping[str, bytes], text: str, *, file: str) -> dict[str, bytes]:
    """The files of a report with the TOML `text` at its end, as they are where that is empty.

    text : no line of it begins with a grave accent, and all of it is printable.  file : name of the table.
    """
    if not text:
        return dict(files)
    section = render("kept_campaign.md.j2", text=Markdown(text.rstrip()), file=file)
    return {**files, "report.md": files["report.md"].rstrip() + b"\n\n" + section.encode()}
