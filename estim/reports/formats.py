"""A report in other formats than Markdown, each made of the files of the report alone.  What makes
one is loaded when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from estim.common import language

Files = Mapping[str, bytes]


def with_formats(files: Files, formats: Iterable[str]) -> dict[str, bytes]:
    """`files` of a report (path -> bytes) and, in each of `formats` ("html", "pdf"), `report.html`
    or `report.pdf` of its `report.md`.
    """
    outputs = dict(files)
    for name in formats if "report.md" in files else ():
        outputs[f"report.{name}"] = _MAKERS[name](files)
    return outputs


def _html(files: Files) -> bytes:
    from estim.reports.html_page import html_page

    return html_page(files, lang=language())


def _pdf(files: Files) -> bytes:
    from estim.reports.html_page import pdf_page

    return pdf_page(files, lang=language())


_MAKERS: dict[str, Callable[[Files], bytes]] = {"html": _html, "pdf": _pdf}
