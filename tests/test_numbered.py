"""Figures and tables of reports have numbers, and sentences that name one use its number."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import PIXEL
from test_html_page import files_of, page_of, seen

from estim.common import spoken
from estim.reports.html_page import html_page
from estim.reports.pages import numbered, shortened, unbroken
from estim.reports.rendering import cited, markdown

PROJECT = Path(__file__).parents[1]
TEXT = f"""# T

{cited("figures/b c.png")} and {cited("later")} stand below.

![first \\* figure](figures/a.png)

![second](figures/b%20c.png)

*Its caption,
γ = 1.*

| x | y |
|---|---|
| 1 | 2 |

```text
| x | y |
|---|---|
```

![third](figures/d.png)

*{cited("later")} What it shows.*

| | y |
| --- | --- |
| 1 | 2 |

*As before*, in words.

| | |
|---|---|
| a list | of no columns |
"""


def test_figures_and_tables_are_counted_where_they_stand() -> None:
    text = numbered(TEXT)
    assert "\nFigure 2 and Table 2 stand below.\n" in text
    assert re.findall(r"^\*((?:Figure|Table) [^*]*(?:\\\*[^*]*)*)\*$", text, re.MULTILINE) == [
        "Figure 1. first \\* figure.",
        "Figure 2. Its caption,\nγ = 1.",
        "Table 1.",
        "Figure 3. third.",
        "Table 2. What it shows.",
    ]
    # nothing else changes
    captions = r"\*(?:Figure|Table) \d\.(?: first \\\* figure\.| third\.)?\*\n\n"
    plain = re.sub(r"(?<=\*)(Figure|Table) \d\. ", "", re.sub(captions, "", text))
    assert plain == re.sub(
        "\ue000.*?\ue000 ?",
        "",
        TEXT.replace(f"{cited('figures/b c.png')} and {cited('later')}", "Figure 2 and Table 2"),
    )


def test_numbers_are_said_in_the_language() -> None:
    with spoken("es"):
        text = numbered(TEXT)
    assert "Figura 2 and Tabla 2" in text
    assert "*Tabla 2. What it shows.*" in text


def test_code_that_shows_code_is_left_as_it_is() -> None:
    inner = "```\n| x | y |\n|---|---|\n```\n| 5 m | y |\n|---|---|\n"
    text = f"````markdown\n{inner}````\n\n| z |\n|---|\n| 5 m |\n"
    after = "\n\n*Table 1.*\n\n| z |\n|---|\n| 5\u00a0m |\n"
    assert numbered(unbroken(text)) == f"````markdown\n{inner}````{after}"
    rows = "| 1 |\n" * 200
    code = f"````\n```\n```\n| n |\n|---|\n{rows}````\n"
    assert shortened(code) == {"report.md": code.encode()}


def test_templates_name_only_figures_that_they_ask_for() -> None:
    named = re.compile(r'(?P<before>.{0,300})(?P<path>"figures/[^"]*") \| cited', re.DOTALL)
    found = [
        (path.name, figure["path"], f"{figure['path']} in pictures" in figure["before"])
        for path in (PROJECT / "estim" / "reports" / "templates").glob("*.j2")
        for figure in named.finditer(path.read_text(encoding="utf-8"))
    ]
    assert len(found) > 3
    assert [entry for entry in found if not entry[-1]] == []


def test_what_is_named_must_be_there() -> None:
    with pytest.raises(KeyError, match="figures/none"):
        numbered(cited("figures/none.png"))


def test_text_of_others_names_no_figure() -> None:
    mine = str(markdown("\ue000figures/a.png\ue000"))
    assert numbered(f"{mine}\n\n{TEXT}").startswith(mine)


def test_numbers_stay_where_a_long_table_is_shortened() -> None:
    rows = "".join(f"| {i} | 1 |\n" for i in range(200))
    files = shortened(numbered(f"# T\n\n| n | x |\n|---|---|\n{rows}\n| a |\n|---|\n| 1 |\n"))
    text = files["report.md"].decode()
    assert text.index("*Table 1.*") < text.index("All 200 rows") < text.index("*Table 2.*")


def test_a_page_has_captions() -> None:
    page = page_of(numbered(TEXT), **{f"figures/{a}.png": PIXEL for a in ("a", "b c", "d")})
    assert len(page.all("figcaption")) == len(page.all("figure")) == 3
    assert [table["aria-label"] for table in page.all("div")] == ["Table 1", "Table 2", "List 1"]
    assert len(page.all("caption")) == 2


@pytest.mark.slow
def test_every_report_has_its_numbers_in_order_and_the_same_on_paper(reports: Path) -> None:
    for path in sorted(reports.rglob("report.md")):
        files = files_of(path.parent)
        text = files["report.md"].decode()
        figure, table = ("Figura", "Tabla") if "/es/" in path.as_posix() else ("Figure", "Table")
        images = len(re.findall(r"^!\[", text, re.MULTILINE))
        heads = re.findall(r"^\|(?![ |]*\n)[^\n]*\n\|[-:| ]+$", text, re.MULTILINE)
        for kind, count in ((figure, images), (table, len(heads))):
            numbers = re.findall(rf"^\*{kind} (\d+)\.", text, re.MULTILINE)
            assert numbers == [str(n) for n in range(1, count + 1)], (path, kind)
        page = seen(html_page(files, paper=True))
        assert len(page.all("figcaption")) == images, path
        assert len(page.all("caption")) == len(heads), path
        for kind, count in ((figure, images), (table, len(heads))):
            printed = re.findall(rf"(?:^|\n){kind} (\d+)\.", "\n".join(page.texts))
            # what is folded follows in an appendix, under the numbers that it has everywhere
            assert sorted(map(int, printed)) == list(range(1, count + 1)), (path, kind)


def test_code_that_shows_code_begins_no_part_of_a_page() -> None:
    fold = "<details>\n<summary><b>T</b></summary>\n</details>\n"
    page = html_page({"report.md": f"# R\n\n````\n```\n```\n{fold}````\n".encode()}).decode()
    assert "<summary><b>T" not in page
    assert "&lt;summary&gt;" in page
    assert "part-1" not in page
