"""The tutorials are run as they stand: every command, file and line of Python, beside what the page
says that they print.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from pages import blocks, difference, run_page

TUTORIALS = Path(__file__).resolve().parents[1] / "docs" / "tutorials"


@pytest.fixture
def beside_the_data(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with the data of the tutorials where the project has them."""
    shutil.copytree(project / "data" / "tutorial", tmp_path / "data" / "tutorial")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
@pytest.mark.parametrize("page", sorted(TUTORIALS.glob("*.md")), ids=lambda page: page.stem)
def test_a_tutorial_does_what_it_says(page: Path, beside_the_data: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(blocks(text, "sh")) >= 4
    assert len(blocks(text, "text")) >= 4
    run_page(page, beside_the_data)
    made = (
        beside_the_data
        / "out"
        / {"a-table-and-a-formula": "cup", "from-a-tracker-file-to-a-verdict": "verdict"}[page.stem]
    )
    assert json.loads((made / "result.json").read_text(encoding="utf-8"))["status"] == "ok"


def test_a_page_that_says_something_else_is_found_out() -> None:
    said = (
        "ball: ok\n  g = (9.88 ± 0.09) m/s²\n  vt = (8.40 ± 0.20) m/s\n  note: 1 of 8 "
        "starts\nreport: out\n"
    )
    assert difference(said, said) == ""
    assert difference("ball: ok\n...\nreport: out\n", said) == ""
    assert difference(said.replace("9.88 ± 0.09", "9.86 ± 0.08"), said) == ""
    slips = (
        ("9.88", "9.81"),
        ("0.09", "0.05"),
        ("m/s²", "m/s"),
        ("1 of 8", "2 of 8"),
        ("ok", "poor-fit"),
        ("report: out\n", ""),
        ("  vt", "  v"),
    )
    for wrong in slips:
        assert difference(said.replace(*wrong, 1), said) != "", wrong
    assert difference(said, said + "one more\n") != ""


def test_the_notebook_does_what_it_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its cells as plain Python, beside the outputs that are kept with it."""
    monkeypatch.chdir(TUTORIALS)
    notebook = json.loads((TUTORIALS / "fits-in-a-notebook.ipynb").read_text(encoding="utf-8"))
    names: dict[str, object] = {}
    kept = []
    for cell in (cell for cell in notebook["cells"] if cell["cell_type"] == "code"):
        exec(compile("".join(cell["source"]), "notebook", "exec"), names)
        printed = capsys.readouterr().out
        assert {output["output_type"] for output in cell["outputs"]} <= {"stream", "execute_result"}
        kept += [kind for output in cell["outputs"] for kind in output.get("data", {"stream": ""})]
        assert (
            difference(
                "".join(text for output in cell["outputs"] for text in output.get("text", [])),
                printed,
            )
            == ""
        )
    assert {"text/markdown", "image/png", "stream"} <= set(kept)


def test_the_data_of_the_tutorials_come_out_the_same(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(project / "docs" / "generate"))
    import tutorial_data

    for name, text in (("tea.csv", tutorial_data.tea()), ("fall.trk", tutorial_data.fall())):
        assert (project / "data" / "tutorial" / name).read_text(encoding="utf-8") == text
