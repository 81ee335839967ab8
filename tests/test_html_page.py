"""A report as one HTML file: it says what `report.md` says, needs nothing else, lets nothing in,
and `estim verify` knows it.
"""

from __future__ import annotations

import ast
import json
import re
import zlib
from base64 import b64decode
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from command_runner import runner
from conftest import PIXEL
from hostile import STRINGS

from estim.cli.commands import cli
from estim.common import InputError, markdown, spoken
from estim.reports.html_page import html_page
from estim.reports.pages import with_formats
from estim.reports.rendering import folded

PROJECT = Path(__file__).parents[1]
BROKEN = re.compile(r"(?:</details>|\.png\))\n[^\n]|[^\n]\n<details>")
VOID = {"meta", "img", "input", "br", "hr"}
REPORTS = (
    "replica",
    "gallery/filament",
    "gallery/wheel",
    "gallery/cavendish",
    "gallery/muon_binned",
)


@dataclass
class Page(HTMLParser):
    """What a browser sees, by the standard library: tags in order, texts, what is open at the
    end.
    """

    tags: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    stack: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.stack.pop() == tag, tag

    def handle_data(self, data: str) -> None:
        if "main" in self.stack:
            self.texts.append(data)

    @property
    def text(self) -> str:
        return "".join(self.texts)

    def all(self, *names: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.tags if tag in names]


def seen(page: bytes) -> Page:
    parsed = Page()
    parsed.feed(page.decode())
    parsed.close()
    assert parsed.stack == []
    return parsed


def files_of(place: Path) -> dict[str, bytes]:
    return {
        path.relative_to(place).as_posix(): path.read_bytes()
        for path in (place / "report.md", *sorted(place.glob("figures/*.png")))
    }


def page_of(text: str, **pictures: bytes) -> Page:
    return seen(with_formats({"report.md": text.encode(), **pictures}, ["html"])["report.html"])


@pytest.fixture(scope="module", params=REPORTS)
def report(request: pytest.FixtureRequest, reports: Path) -> tuple[dict[str, bytes], Page]:
    files = files_of(reports / request.param)
    return files, seen(with_formats(files, ["html"])["report.html"])


def test_every_number_of_the_report_is_in_the_page_in_its_order(
    report: tuple[dict[str, bytes], Page],
) -> None:
    files, page = report
    text = re.sub(r"!\[(?:[^\]\\]|\\.)*\]\([^)]*\)|\]\([^)]*\)", " ", files["report.md"].decode())
    numbers = re.findall(r"\d+(?:\.\d+)?", text)
    assert re.findall(r"\d+(?:\.\d+)?", page.text) == numbers
    assert len(numbers) > 10


def test_a_page_needs_nothing_from_elsewhere_and_runs_nothing(
    report: tuple[dict[str, bytes], Page],
) -> None:
    files, page = report
    shown = page.all("img")
    inside = [
        b64decode(str(image["src"]).removeprefix("data:image/png;base64,")) for image in shown
    ]
    wanted = re.findall(r"\]\((figures/\S+?\.png)\)", files["report.md"].decode())
    assert inside == [files[path] for path in wanted]
    assert all(image["alt"] for image in shown)
    assert not page.all("script", "link", "iframe", "object", "base", "form", "svg")
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    policy = next(
        str(meta["content"])
        for meta in page.all("meta")
        if meta.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy.startswith("default-src 'none'; ")
    css = (PROJECT / "estim" / "reports" / "templates" / "page.css").read_text()
    assert "url(" not in css
    assert "@import" not in css


def test_a_page_is_in_the_language_that_is_spoken() -> None:
    part = folded("b", "text", opened=False)
    with spoken("es"):
        page = with_formats({"report.md": f"# a\n\n{part}\n".encode()}, ["html"])[
            "report.html"
        ].decode()
    assert '<html lang="es">' in page
    for words in (
        "Contenido",
        "abrir todas las secciones, también para imprimir",
        "no se imprimen",
    ):
        assert words in page
    assert "Contents" not in page


def test_a_page_can_be_found_one_s_way_in(report: tuple[dict[str, bytes], Page]) -> None:
    files, page = report
    assert page.all("html") == [{"lang": "en"}]
    assert len(page.all("h1")) == 1
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    assert all(after <= before + 1 for before, after in pairwise(levels))
    places = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(places) == len(set(places))
    targets = [str(link["href"]) for link in page.all("a") if str(link["href"]).startswith("#")]
    assert {target[1:] for target in targets} <= set(places)
    assert len(page.all("details")) - bool(targets) == files["report.md"].count(b"<details>")
    assert len(targets) >= files["report.md"].count(b"<details>")
    assert len(page.all("div")) >= len(page.all("table"))


def test_html_ends_at_a_blank_line_in_every_report(reports: Path) -> None:
    """Else Markdown takes what follows a folded part for HTML (CommonMark 0.31, section 4.6)."""
    for text in (path.read_text(encoding="utf-8") for path in reports.rglob("report.md")):
        assert not BROKEN.search(text)


def test_folded_parts_figures_and_tables_are_made_of_markdown() -> None:
    text = (
        "# T\n\n## Standing\n\n![a *finding*](figures/a.png)\n\n*Its caption, γ = "
        f"1.*\n\n{folded('Inner', '## Inner', opened=False)}\n"
    )
    text += f"\n{folded('Other', '## Another' + chr(10) * 2 + '### Deeper', opened=False)}\n"
    text += (
        f"\n{folded('Third', '### First of all', opened=False)}\n\n| | b |\n|---|---|\n| "
        "[r](x/report.md) | 1.0 ± 0.1 |\n"
    )
    page = page_of(text, **{"figures/a.png": PIXEL})
    headings = [tag for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    # "Inner" once, as the title of its part
    assert headings == ["h1", "h2", "h2", "h2", "h3", "h4", "h2", "h3"]
    assert [tag for tag, _ in page.tags if tag.startswith("fig")] == ["figure", "figcaption"]
    assert page.all("img")[0]["alt"] == "a finding"
    assert [link["href"] for link in page.all("a")][-1] == "x/report.html"
    assert [cell.get("class") for cell in page.all("td")] == [None, None, "number"]


RAW = (
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "</details>",
    "</div></main>",
    "<details open>\n<summary>x</summary>",
    "a <b>c</b>",
    "<!-- x",
)


@pytest.mark.parametrize("raw", RAW)
def test_html_that_is_none_of_ours_is_shown_as_text(raw: str) -> None:
    page = page_of(f"# T\n\n{raw}\n\nend <i onclick=x>\n")
    assert {tag for tag, _ in page.tags} <= {
        "html",
        "head",
        "meta",
        "title",
        "style",
        "body",
        "main",
        "h1",
        "p",
    }
    assert raw.split()[-1] in page.text
    assert "<i onclick=x>" in page.text


def test_texts_of_others_are_shown_literally_in_titles_and_cells() -> None:
    for words in STRINGS:
        shown = markdown(words)
        if not shown:
            continue
        page = page_of(
            f"# {shown}\n\n{folded(words, 'body', opened=False)}\n\n| a |\n|---|\n| {shown} |\n"
        )
        assert [
            tag
            for tag, _ in page.tags
            if tag in ("script", "em", "strong", "a", "img", "code", "h3", "ul", "blockquote")
        ] == ["a"], words
        assert len(page.all("td")) == 1
        assert page.text.count("body") == 1


def run(*arguments: object):
    return runner().invoke(cli, [str(argument) for argument in arguments])


MODEL = """\
title = "A <sum>"
draws = 10000
[measurand]
formula = "a + b"
unit = "m"
[inputs]
a = {value = 1.0, u = 0.1}
b = {value = 2.0, u = 0.2}
"""


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)
    return tmp_path


@pytest.mark.usefixtures("undrawn")
def test_verify_remakes_the_page_and_finds_a_digit_changed_in_it(model: Path) -> None:
    done = run("propagate", "model.toml", "--out", "out", "--format", "html")
    assert done.exit_code == 0
    assert done.output.rstrip().endswith("report: out/report.html")
    origin = json.loads((model / "out" / "origin.json").read_text())
    assert origin["command"] == ["propagate", "model.toml", "--format", "html"]
    assert "report.html" in origin["outputs"]
    assert not BROKEN.search((model / "out" / "report.md").read_text())
    assert "<title>A &lt;sum&gt;" in (model / "out" / "report.html").read_text()
    assert run("verify", "out").exit_code == 0
    page = (model / "out" / "report.html").read_text()
    (model / "out" / "report.html").write_text(page.replace("3.00", "3.10", 1))
    done = run("verify", "out")
    assert done.exit_code == 3
    assert "report.html is not as it was written" in done.output
    assert re.search(r"report\.html, line \d+: .*3\.10.*recomputed.*3\.00", done.output)
    assert "base64" not in done.output


@pytest.mark.usefixtures("undrawn")
def test_a_page_of_the_report_before_does_not_stay(model: Path) -> None:
    assert run("propagate", "model.toml", "--out", "out", "--format", "html").exit_code == 0
    assert run("propagate", "model.toml", "--out", "out").exit_code == 0
    assert not (model / "out" / "report.html").exists()
    # it would pass for the page of the new report
    (model / "out" / "report.html").write_text("mine")
    assert "report.html: was not written by estim" in str(
        run("propagate", "model.toml", "--out", "out").exception
    )
    assert (model / "out" / "report.html").read_text() == "mine"


def test_what_is_missing_is_said_before_anything_is_computed(
    model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for trouble, said in (
        (ImportError, "'--format pdf' needs the package weasyprint: pip install "),
        (OSError, "needs libraries that weasyprint"),
    ):

        def missing(name: str, trouble: type[Exception] = trouble) -> None:
            raise trouble(name)

        monkeypatch.setattr("estim.cli.options.import_module", missing)
        done = run("propagate", "model.toml", "--out", "out", "--format", "pdf")
        assert isinstance(done.exception, InputError)
        assert said in str(done.exception)
        assert "or print report.html with a browser" in str(done.exception)
        assert not (model / "out").exists()


def test_on_paper_what_is_folded_follows_as_an_appendix(reports: Path) -> None:
    files = files_of(reports / "gallery" / "filament")
    folds = re.findall(rb"<summary><b>(.*?)</b></summary>", files["report.md"])
    page = seen(html_page(files, paper=True))
    assert not page.all("details", "nav", "input", "summary")
    standing, _, appendix = page.text.partition("Appendix: sections that are collapsed on the page")
    assert "from these data" in standing
    assert "recomputes this report" in standing
    assert all(title.decode() in appendix and title.decode() not in standing for title in folds)
    assert sorted(re.findall(r"\d+\.\d+", page.text)) == sorted(
        re.findall(r"\d+\.\d+", seen(html_page(files)).text)
    )


def test_the_pdf_has_the_pages_the_title_the_figures_words_and_is_made_again_alike(
    model: Path,
) -> None:
    try:
        import weasyprint  # noqa: F401
    except (ImportError, OSError):  # the package, or the libraries of the system that it loads
        pytest.skip("needs the extra pdf")
    assert run("propagate", "model.toml", "--out", "out", "--format", "pdf").exit_code == 0
    pdf = (model / "out" / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-1.")
    inside = b"".join(
        zlib.decompress(one)
        for one in re.findall(rb"/FlateDecode[^>]*>>\nstream\n(.*?)\nendstream", pdf, re.DOTALL)
    )
    assert b"/StructTreeRoot" in inside + pdf
    assert b"/Lang (en)" in inside + pdf
    assert b"pdfuaid" in inside + pdf
    done = run("verify", "out")
    assert done.exit_code == 0, done.output
    assert "drawn otherwise" not in done.output


def test_every_command_that_writes_a_report_has_formats() -> None:
    having = {
        name
        for name, command in cli.commands.items()
        if any(one.name == "formats" for one in command.params)
    }
    assert having == set(cli.commands) - {
        "simulate",
        "import",
        "new",
        "verify",
        "diff",
        "models",
        "serve",
    }
    writing = {
        path.stem
        for path in (PROJECT / "estim" / "cli").glob("*.py")
        if {"write_files", "replace_own"}
        & {
            ast.unparse(node.func)
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call)
        }
    }
    # what is no report, and `write_report`
    assert writing == {"importing", "new", "terminal"}
