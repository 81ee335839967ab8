"""What the README shows is run as it stands."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.S)


def test_python_example_runs(project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(project)
    (example,) = blocks((project / "README.md").read_text(), "python")
    assert example.count("\n") <= 17
    exec(compile(example, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("ok\ngamma = 0.1")


@pytest.mark.parametrize("document", ["README.md", "docs/campaign.md"])
def test_campaign_example_is_read(project: Path, replica: Path, tmp_path: Path, document: str) -> None:
    from estim.campaign import load_campaign

    example = blocks((project / document).read_text(), "toml")[0]
    data = (replica / "runs" / "heavy-04.csv").read_text()
    file = Path(tomllib.loads(example)["runs"][0]["file"])
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(data)
    (tmp_path / "campaign.toml").write_text(example)
    assert load_campaign(tmp_path / "campaign.toml").problem(["heavy-04"]).n_obs > 20


def test_links_of_the_documents_lead_somewhere(project: Path) -> None:
    for document in [project / "README.md", *project.glob("docs/*.md"), project / "data" / "README.md"]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


def test_published_numbers_name_their_section(project: Path) -> None:
    table = tomllib.loads((project / "data" / "paper" / "published.toml").read_text())
    for number in table["number"]:
        assert number["section"]
        assert isinstance(number["value"], float)
        assert number["unit"]
