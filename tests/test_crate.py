"""`ro-crate-metadata.json` beside each report: what RO-Crate 1.2 requires, and that `estim verify` sees when it is not of the files beside it.

Requirements by the specification, https://w3id.org/ro/crate/1.2: "Root Data Entity" (descriptor, direct properties), "Data Entities" (files and their
identifiers), "Provenance" (software and action).
"""

from __future__ import annotations

import hashlib
import json
import re
from datetime import date
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from command_runner import runner
from test_html_page import MODEL

from estim.cli.commands import cli
from estim.cli.crate import crate_of, crate_troubles
from estim.cli.origin_record import Origin
from estim.common import kind_words, spoken

CRATE = "ro-crate-metadata.json"
PIECES = {
    "report.md": b"# A \\*star\\*, R&amp;D\n\n**SYNTHETIC data**: made by a program, not measured.\n\n![it *rises*](figures/a%20b.png)\n",
    "figures/a b.png": b"\x89PNG", "result.json": b"{}",
}
INPUTS = {"my data.toml": "ab" * 32, "../x.csv": "cd" * 32}
ORIGIN = Origin("estim-origin/1", ["fit", "my data.toml"], "", INPUTS, {}, {"python": "3", "estim": "0.1"})


def entities(data: bytes) -> dict[str, dict[str, Any]]:
    """Every entity by its identifier, which no other has (JSON-LD flattened)."""
    graph = json.loads(data)["@graph"]
    found = {one["@id"]: one for one in graph}
    assert len(found) == len(graph)
    return found


def references(value: object) -> list[str]:
    if isinstance(value, dict):
        return [value["@id"]] if value.keys() == {"@id"} else [name for one in value.values() for name in references(one)]
    return [name for one in value for name in references(one)] if isinstance(value, list) else []


def required(data: bytes) -> None:
    """What the specification demands of every crate in a folder."""
    assert json.loads(data)["@context"] == "https://w3id.org/ro/crate/1.2/context"
    found = entities(data)
    head = found[CRATE]
    assert head["@type"] == "CreativeWork"
    assert head["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.2"}
    root = found[head["about"]["@id"]]
    assert root["@id"] == "./"
    assert root["@type"] == "Dataset"
    assert all(isinstance(root[name], str) and root[name] for name in ("name", "description", "datePublished"))
    assert all(found[root["license"]["@id"]][name] for name in ("name", "description"))
    assert date.fromisoformat(root["datePublished"])
    files = {name for name, one in found.items() if one["@type"] == "File" and not name.startswith("#")}
    assert {part["@id"] for part in root["hasPart"]} == files
    assert all(re.fullmatch(r"(?!/)[\w./~+%-]+", name) and ".." not in name and "\\" not in name for name in files)
    assert set(references(json.loads(data)["@graph"])) <= found.keys() | {"https://w3id.org/ro/crate/1.2"}
    made = next(one for one in found.values() if one["@type"] == "CreateAction")
    assert found[made["instrument"]["@id"]]["@type"] == "SoftwareApplication"
    assert found[made["instrument"]["@id"]]["version"]
    assert root["mentions"] == {"@id": made["@id"]}


def test_a_crate_has_what_the_specification_requires_and_says_what_was_done() -> None:
    data = crate_of(PIECES, ORIGIN, day="2014-03-28")
    required(data)
    found = entities(data)
    root, made = found["./"], found["#made"]
    assert root["name"] == "A *star*, R&D"
    assert root["description"].startswith("SYNTHETIC data: made by a program")
    assert (root["keywords"], root["datePublished"]) == ("synthetic data", "2014-03-28")
    assert found["figures/a%20b.png"]["description"] == "it *rises*"
    assert made["name"] == "estim fit 'my data.toml'"
    assert [found[one["@id"]]["localPath"] for one in made["object"]] == ["my data.toml", "../x.csv"]
    assert found["#python"]["url"].startswith("https://")
    assert found["#input-1"]["encodingFormat"] == "application/toml"
    assert found["#input-2"]["sha256"] == "cd" * 32
    for path, content in PIECES.items():
        (part,) = (one for name, one in found.items() if unquote(name) == path)
        assert (part["contentSize"], part["sha256"]) == (str(len(content)), hashlib.sha256(content).hexdigest())


@pytest.mark.parametrize("lost", ["license", "datePublished", "hasPart", "name"])
def test_the_requirements_can_fail(lost: str) -> None:
    record = json.loads(crate_of(PIECES, ORIGIN))
    del record["@graph"][1][lost]
    with pytest.raises((AssertionError, KeyError)):
        required(json.dumps(record).encode())


def test_measured_data_are_not_called_synthetic_and_a_build_can_be_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    root = entities(crate_of({"report.md": b"# t\n\nMeasured data.\n"}, ORIGIN))["./"]
    assert "keywords" not in root
    assert root["description"].startswith("Measured data. ")
    assert root["datePublished"] == "1970-01-02"
    some = entities(crate_of({"report.md": b"# t\n\n**SYNTHETIC data in 1 of 2 runs.**\n"}, ORIGIN))["./"]
    assert some["description"].startswith("SYNTHETIC data in 1 of 2 runs. ")


def test_a_report_in_another_language_says_of_what_kind_its_data_are_too() -> None:
    with spoken("es"):
        synthetic, measured = kind_words("synthetic"), kind_words("measured")
    root = entities(crate_of({"report.md": f"# t\n\n{synthetic}\n".encode()}, ORIGIN))["./"]
    assert root["description"].startswith("Datos SINTÉTICOS: generados por un programa, no medidos. ")
    assert root["keywords"] == "synthetic data"
    assert "keywords" not in entities(crate_of({"report.md": f"# t\n\n{measured}\n".encode()}, ORIGIN))["./"]


def run(*arguments: object):
    return runner().invoke(cli, [str(argument) for argument in arguments])


@pytest.mark.usefixtures("undrawn")
def test_verify_sees_a_description_that_is_not_of_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)
    assert run("propagate", "model.toml", "--out", "out").exit_code == 0
    place = tmp_path / "out" / CRATE
    made = place.read_bytes()
    required(made)
    assert CRATE in json.loads((tmp_path / "out" / "origin.json").read_text())["outputs"]
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")  # another day
    done = run("verify", "out")
    assert done.exit_code == 0, done.output
    assert CRATE in done.output
    place.write_bytes(made.replace(b'"A <sum>"', b'"Another sum"'))
    origin = tmp_path / "out" / "origin.json"
    origin.write_text(origin.read_text().replace(hashlib.sha256(made).hexdigest(), hashlib.sha256(place.read_bytes()).hexdigest()))
    done = run("verify", "out")
    assert done.exit_code == 3
    assert f"{CRATE} does not describe the files beside it" in done.output


@pytest.mark.parametrize("broken", [b"", b"[]", b"{}", b'{"@graph": [{"@id": "./"}]}', b'{"@graph": [{"@id": "./", "hasPart": [1]}]}', b"[" * 9000])
def test_a_forged_description_is_told_not_followed(broken: bytes) -> None:
    told = Origin("estim-origin/1", [], "", {}, {CRATE: ""}, {})
    assert crate_troubles(lambda name: broken if name == CRATE else None, told) == [f"{CRATE} does not describe a report"]
