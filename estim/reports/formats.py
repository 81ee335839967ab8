"""A report in other formats than Markdown, each made of the files of the report alone."""

from __future__ import annotations

from collections.abc import Iterable

from estim.common import Files


def with_formats(files: Files, formats: Iterable[str]) -> Files:
    """`files` of a report (path -> bytes) and, in each of `formats` ("html", "pdf"), `report.html`
    or `report.pdf` of its `report.md`.
    """
    outputs = dict(files)
    for name in formats if "report.md" in files else ():
        # what makes one is loaded when it is requested
        from estim.reports.html_page import html_page, pdf_page

        outputs[f"report.{name}"] = {"html": html_page, "pdf": pdf_page}[name](files)
    return outputs
