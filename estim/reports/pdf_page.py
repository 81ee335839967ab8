"""A report for printing and handing in: `report.pdf`, of the page of `html_page` by WeasyPrint, with its style for paper.

The standing part comes first, so that it can be handed in by itself; what is folded follows as an appendix.  The PDF is tagged for screen readers
(PDF/UA-1), with the figures' words, and has bookmarks.  The same files give the same bytes where the fonts are the same.
"""

from __future__ import annotations

from collections.abc import Mapping

from estim.reports.html_page import html_page


def pdf_page(files: Mapping[str, bytes], *, lang: str = "en") -> bytes:
    """`report.pdf` of the files of a report (path -> bytes).  lang : the language of the report (BCP 47).  ImportError without the extra `pdf`."""
    from weasyprint import HTML, URLFetcher

    page = html_page(files, lang=lang, paper=True).decode()
    nothing_from_elsewhere = URLFetcher(allowed_protocols={"data"})
    return bytes(HTML(string=page, url_fetcher=nothing_from_elsewhere).write_pdf(pdf_variant="pdf/ua-1"))
