"""What the README shows is run as it stands, and every link and every page that is named leads
somewhere.
"""

from __future__ import annotations

import ast
import builtins
import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from pages import blocks, run_page

import estim
from estim.cli.commands import cli


def test_six_lines_of_python_say_what_the_readme_says(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project)
    (example,) = blocks((project / "README.md").read_text(encoding="utf-8"), "python")
    assert len([line for line in example.splitlines() if line]) <= 6
    names = run_page(project / "README.md", tmp_path)
    assert names["tea"].status == "ok"
    assert (
        estim.fit_curve("line", names["minutes"], names["celsius"], u_y=0.3).status == "poor-fit"
    ), "the README says so of a straight line"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_commands_of_the_readme_run(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every `estim` command but the one whose report the gallery keeps (below)."""
    shutil.copytree(project / "data" / "tutorial", tmp_path / "data" / "tutorial")
    monkeypatch.chdir(tmp_path)
    commands = re.findall(
        r"^    estim (.*)$", (project / "README.md").read_text(encoding="utf-8"), flags=re.M
    )
    others = [command for command in commands if "data/gallery/" not in command]
    assert len(commands) == len(others) + 1 >= 2
    for command in others:
        done = CliRunner().invoke(cli, shlex.split(command))
        assert (done.exit_code, done.output.splitlines()[1]) == (0, "tea: ok"), done.output


def test_the_real_experiment_is_the_one_of_the_gallery(project: Path, reports: Path) -> None:
    text = (project / "README.md").read_text(encoding="utf-8")
    (shown,) = blocks(text, "toml")
    assert tomllib.loads(shown) == tomllib.loads(
        (project / "data" / "gallery" / "muon.toml").read_text(encoding="utf-8")
    )
    result = json.loads((reports / "gallery" / "muon" / "result.json").read_text(encoding="utf-8"))
    tau = result["parameters"]["tau"]
    assert f"says ({tau['mean']:.2f} ± {tau['sd']:.2f}) µs, status `{result['status']}`" in text


def test_the_gallery_has_as_many_experiments_as_the_readme_says_and_the_muon_its_published_lifetime(
    project: Path, reports: Path
) -> None:
    readme, gallery = (
        (place / "README.md").read_text(encoding="utf-8")
        for place in (project, reports / "gallery")
    )
    titles = re.findall(r"^\| \[(.*?)\]\(#", gallery, flags=re.MULTILINE)
    assert f"{['Thirteen', 'Fourteen', 'Fifteen'][len(titles) - 13]} real experiments" in readme
    value, high, low = re.search(
        r"^\| \[The lifetime of the muon\].* \| ([\d.]+) \(\+([\d.]+), −([\d.]+)\) µs",
        gallery,
        flags=re.MULTILINE,
    ).groups()
    assert f"{value} +{high} −{low} µs" in readme.replace("\xa0", " ")


@pytest.mark.slow
def test_python_of_the_campaign_page_runs(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(project)
    (example,) = blocks((project / "docs" / "campaign.md").read_text(encoding="utf-8"), "python")
    exec(compile(example, "campaign.md", "exec"), {})
    assert capsys.readouterr().out.startswith("ok\ngamma = 0.1")


def test_campaign_example_is_read(project: Path, replica: Path, tmp_path: Path) -> None:
    from estim.campaign import load_campaign

    example = blocks((project / "docs" / "campaign.md").read_text(encoding="utf-8"), "toml")[0]
    data = (replica / "runs" / "heavy-04.csv").read_text()
    file = Path(tomllib.loads(example)["runs"][0]["file"])
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(data)
    (tmp_path / "campaign.toml").write_text(example)
    assert load_campaign(tmp_path / "campaign.toml").problem(["heavy-04"]).n_obs > 20


def pages(project: Path) -> list[Path]:
    """Every page for readers that stands in the repository."""
    return [
        *project.glob("*.md"),
        *project.glob("docs/**/*.md"),
        *project.glob("data/**/README.md"),
        *project.glob("reports/gallery/README.md"),
    ]


def anchors(text: str) -> set[str]:
    """The anchors that a viewer makes of the headings of a page."""
    heads = [
        re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head)
        for head in re.findall(r"^#+ (.*)$", text, flags=re.M)
    ]
    return {
        "".join(c for c in head.lower().replace(" ", "-") if c.isalnum() or c in "-_")
        for head in heads
    }


def test_links_of_the_documents_lead_somewhere(project: Path) -> None:
    for document in pages(project):
        text = re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.S)
        targets = re.findall(r"\]\(([^)\s:]+)\)", text) + re.findall(r'src="([^":]+)"', text)
        for target in targets:
            name, _, anchor = target.partition("#")
            page = document.parent / name if name else document
            if "reports/" in name and not (project / "reports").is_dir():
                continue  # the source archive has none
            assert page.exists(), f"{document.name}: {target}"
            assert (
                not anchor
                or page.suffix != ".md"
                or anchor in anchors(page.read_text(encoding="utf-8"))
            ), f"{document.name}: {target}"


def test_pages_that_code_and_data_name_are_there(project: Path) -> None:
    code = [
        file
        for folder in ("estim", "tests", "benchmarks")
        for file in (project / folder).rglob("*.py")
    ]
    page = re.compile(r"(?<![\w/.])docs/[\w/-]+\.(?:md|json|ipynb)")
    named = {
        (name, file.name)
        for file in (*code, *pages(project))
        for name in page.findall(file.read_text(encoding="utf-8"))
    }
    assert len(named) > 30
    assert [pair for pair in sorted(named) if not (project / pair[0]).exists()] == []


def test_python_of_every_page_imports_what_there_is_and_defines_what_it_uses(project: Path) -> None:
    """Of a page that no other test runs; what is not estim's need not be installed."""
    for page in pages(project):
        text = page.read_text(encoding="utf-8")
        if page.parent.name == "reference":  # signatures
            continue
        nodes = list(ast.walk(ast.parse("\n".join(blocks(text, "python")))))
        defined = set(vars(builtins))
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("estim"):
                exec(ast.unparse(node), {})
            if isinstance(node, ast.Import | ast.ImportFrom):
                defined |= {name.asname or name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                defined.add(node.name)
            elif isinstance(node, ast.arg):
                defined.add(node.arg)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                defined.add(node.id)
        used = {node.id for node in nodes if isinstance(node, ast.Name)}
        assert used <= defined, f"{page.name}: {used - defined}"


def test_the_index_names_every_page(project: Path) -> None:
    index = project / "docs" / "README.md"
    linked = {
        (index.parent / name).resolve()
        for name in re.findall(r"\]\(([^)#:]+)", index.read_text(encoding="utf-8"))
    }
    written = {
        path
        for kind in ("md", "ipynb", "json")
        for path in (project / "docs").resolve().rglob(f"*.{kind}")
    }
    assert [path.name for path in sorted(written - linked - {index.resolve()})] == []


def test_citation_and_package_say_the_same(project: Path) -> None:
    package = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = dict(
        re.findall(
            r"^([a-z-]+): (.+)$", (project / "CITATION.cff").read_text(encoding="utf-8"), flags=re.M
        )
    )
    assert citation["license"] == package["license"]
    assert {"cff-version", "message", "title", "type"} <= citation.keys()


def test_published_numbers_name_their_section(project: Path) -> None:
    table = tomllib.loads((project / "data" / "paper" / "published.toml").read_text())
    for number in table["number"]:
        assert number["section"]
        assert isinstance(number["value"], float)
        assert number["unit"]
