"""docs/reference is what the code says, and a campaign's schema tells a good file from a misspelt
one.
"""

from __future__ import annotations

import doctest
import inspect
import json
import re
import subprocess
import sys
import tomllib
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

import estim
from estim import model

jsonschema = pytest.importorskip("jsonschema")

# what an example needs beside estim
NEEDS = {
    "summary_frame": ("pandas",),
    "to_datatree": ("xarray",),
    "to_frame": ("pandas",),
    "to_netcdf": ("xarray", "h5netcdf"),
}


@pytest.fixture(scope="module")
def schema() -> Any:
    text = (
        Path(__file__).parents[1] / "docs" / "reference" / "estim-campaign-1.schema.json"
    ).read_text(encoding="utf-8")
    jsonschema.Draft7Validator.check_schema(json.loads(text))
    return jsonschema.Draft7Validator(json.loads(text))


def campaigns() -> list[Path]:
    """Every campaign of data/, told from other TOML files by what it must have."""
    files = sorted((Path(__file__).parents[1] / "data").rglob("*.toml"))
    trees = {file: tomllib.loads(file.read_text(encoding="utf-8")) for file in files}
    return [
        file
        for file, tree in trees.items()
        if {"title", "kind"} <= tree.keys() and {"runs", "trials"} & tree.keys()
    ]


@pytest.mark.slow
def test_the_reference_is_not_stale_and_explains_every_key(project: Path) -> None:
    """A failure here is mended by `make docs`, and by a line in docs/generate/key_words.toml for a
    new key.
    """
    done = subprocess.run(
        [sys.executable, str(project / "docs" / "generate"), "--check"],
        capture_output=True,
        text=True,
        check=False,
        cwd=project,
    )
    assert done.stderr == ""
    assert done.returncode == 0


@pytest.mark.parametrize("file", campaigns(), ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_campaigns_of_the_project_keep_to_the_schema(schema: Any, file: Path) -> None:
    errors = list(schema.iter_errors(tomllib.loads(file.read_text(encoding="utf-8"))))
    assert errors == []


def test_there_are_campaigns_of_every_kind() -> None:
    assert len(campaigns()) >= 12
    assert {"replica", "wheel", "gallery", "trials"} <= {file.parent.name for file in campaigns()}


ROLLING = """
title = "A"
kind = "measured"
[shared]
phi_deg = "4.0(4)"
kappa = {prior = "uniform", low = 0.0, high = 1.0}
noise = {sigma_x_m = 0.001}
[bodies.heavy]
gamma = 0.187
[[runs]]
name = "r"
body = "heavy"
file = "r.csv"
"""
OWN = """
title = "A"
kind = "measured"
[curve]
expression = "a*exp(-x/tau)"
x = {column = "t_s", unit = "s"}
y = "U"
u_y = 0.2
[curve.parameters]
a = {start = 1.0, low = 0.0}
tau = "2.0(1)"
[[runs]]
name = "r"
file = "r.csv"
"""


@pytest.mark.parametrize(
    ("text", "written", "instead"),
    [
        (ROLLING, "phi_deg", "phi_degree"), (ROLLING, "sigma_x_m", "sigma_x"),
        (ROLLING, 'prior = "uniform"', 'prior = "flat"'),
        (ROLLING, "gamma", "gama"), (ROLLING, 'kind = "measured"', 'kind = "real"'),
        (ROLLING, 'body = "heavy"\n', ""),
        (ROLLING, "[shared]", "[share]"), (ROLLING, "0.187", "true"),
        (OWN, "u_y", "sigma_y"), (OWN, "start", "begin"), (OWN, "unit", "units"),
        (OWN, "0.2", '["0.2"]'), (OWN, 'file = "r.csv"\n', ""),
        (OWN, "[curve.parameters]", "[curve.parameter]"),
    ],
)  # fmt: skip
def test_a_slip_does_not_pass_the_schema_nor_the_reader(
    schema: Any, tmp_path: Path, text: str, written: str, instead: str
) -> None:
    """The reader of campaigns is the judge: what it refuses by its form the schema refuses too."""
    from estim import InputError, load_campaign

    assert schema.is_valid(tomllib.loads(text))
    slipped = text.replace(written, instead, 1)
    assert not schema.is_valid(tomllib.loads(slipped))
    (tmp_path / "c.toml").write_text(slipped, encoding="utf-8")
    (tmp_path / "r.csv").write_text(
        "t_s,x_m,U\n" + "".join(f"{0.1 * n:.1f},{0.01 * n * n:.2f},{n}\n" for n in range(9)),
        encoding="utf-8",
    )
    with pytest.raises(InputError, match=r"c\.toml"):
        load_campaign(tmp_path / "c.toml")


def test_campaigns_that_the_guides_print_keep_to_the_schema(schema: Any, project: Path) -> None:
    """The whole campaigns that the guides print."""
    texts = [page.read_text(encoding="utf-8") for page in sorted(project.glob("docs/**/*.md"))]
    blocks = [
        block for text in texts for block in re.findall(r"```toml\n(.*?)```", text, flags=re.S)
    ]
    whole = [block for block in blocks if block.startswith("title") and "[[runs]]" in block]
    assert len(whole) >= 5
    for text in whole:
        assert [error.message for error in schema.iter_errors(tomllib.loads(text))] == [], text[:60]


def test_every_public_member_has_words(project: Path) -> None:
    page = (project / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.+?`) \| (.*) \|$", page, flags=re.M)
    assert len(rows) > 90
    assert [name for name, words in rows if not words.strip()] == []


def things() -> dict[str, Any]:
    """Everything public that can be called, by its name in `estim` or in `estim.model`."""
    named = {name: getattr(estim, name) for name in estim.__all__}
    named |= {f"model.{name}": getattr(model, name) for name in model.__all__}
    return {name: thing for name, thing in named.items() if callable(thing)}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "thing"), things().items(), ids=things())
def test_examples_of_docstrings_print_what_they_show(
    name: str, thing: Any, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in NEEDS.get(name, ()):
        pytest.importorskip(package)
    monkeypatch.chdir(project)
    (case,) = doctest.DocTestFinder(recurse=False).find(thing, name, globs={})
    assert case.examples != [], "the docstring has no example"
    said: list[str] = []
    doctest.DocTestRunner(verbose=False).run(case, out=said.append)
    assert "".join(said) == ""


@pytest.mark.parametrize(("name", "thing"), things().items(), ids=things())
def test_docstrings_speak_of_every_argument_and_field(name: str, thing: Any) -> None:
    """A record that no user makes has its fields in the table of the page."""
    words = inspect.getdoc(thing) or ""
    for other in re.findall(r"rguments as in `(\w+)`", words):
        words += inspect.getdoc(getattr(inspect.getmodule(thing), other)) or ""
    if isinstance(thing, type) and issubclass(thing, (Enum, Exception)):
        return
    asked = [key for key in inspect.signature(thing).parameters if not key.startswith("_")]
    assert [key for key in asked if not re.search(rf"(?<!\w){key}(?!\w)", words)] == []


def test_the_page_begins_with_what_most_people_call(project: Path) -> None:
    page = (project / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    assert re.findall(r"^##+ (.*)$", page, flags=re.M)[:2] == ["Curves", "fit_curve"]
