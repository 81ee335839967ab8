"""A report described for archives: `ro-crate-metadata.json` beside it, of what `origin.json` knows (RO-Crate 1.2, https://w3id.org/ro/crate/1.2).

The folder is the dataset; its files are parts with their size and digest; what made them is an action, with the command for a name, `estim` for an
instrument, and for objects the files that were read, which need not lie in the folder.  Data that a program made are called synthetic.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote, unquote

from estim.cli.origin_record import ORIGIN, Origin, inside
from estim.common import KINDS, LANGUAGES, as_json, json_of, kind_words, phrase, spoken, unescaped

CRATE = "ro-crate-metadata.json"
_SPECIFICATION = "https://w3id.org/ro/crate/1.2"
_TYPES = {
    ".md": "text/markdown", ".html": "text/html", ".pdf": "application/pdf", ".json": "application/json", ".png": "image/png",
    ".csv": "text/csv", ".txt": "text/plain", ".toml": "application/toml", ".trk": "application/xml",
}
_HOMES = {
    "python": "https://www.python.org", "numpy": "https://numpy.org", "scipy": "https://scipy.org", "lmfit": "https://lmfit.github.io/lmfit-py/",
    "emcee": "https://emcee.readthedocs.io",
}
_WORDS = {
    "report.md": "the report", "report.html": "the report as one page", "report.pdf": "the report for printing",
    "result.json": "every number of the report, in SI units and radians", ORIGIN: "how the report was made",
}
_LICENSE = {
    "@id": "#licence", "@type": "CreativeWork", "name": "no licence stated",
    "description": "Whoever measured the data says how this report and what it was made from may be used.",
}
_FIGURE = re.compile(r"!\[((?:[^\]\\]|\\.)*)\]\(([^)\s]+)\)")


def crate_of(files: Mapping[str, bytes], origin: Origin, *, day: str | None = None) -> bytes:
    """`ro-crate-metadata.json` of the `files` of a report (path -> bytes).

    day : of the report, as 2014-03-28.  [default: today, or what SOURCE_DATE_EPOCH says, so that a build can be repeated]
    """
    report = files.get("report.md", b"").decode()
    kind = _kind(report)
    shown = {unquote(path): unescaped(words) for words, path in _FIGURE.findall(report)}
    parts = [_part(path, files[path], shown.get(path, "")) for path in sorted(files)]
    parts.append({"@id": ORIGIN, "@type": "File", "name": ORIGIN, "description": _WORDS[ORIGIN], "encodingFormat": _TYPES[".json"]})
    read = [
        {
            "@id": f"#input-{i + 1}", "@type": "File", "name": PurePosixPath(path).name, "localPath": path, "encodingFormat": _type(path),
            "sha256": digest,
        }
        for i, (path, digest) in enumerate(origin.inputs.items())
    ]
    tools = [_tool(name, number) for name, number in origin.versions.items()]
    for tool in tools:
        if tool["name"] == "estim":
            tool["softwareRequirements"] = [{"@id": other["@id"]} for other in tools if other is not tool]
    root = {
        "@id": "./", "@type": "Dataset", "name": _title(report) or origin.line,
        "description": f"{kind} Report and figures, made by: {origin.line}".strip(), "datePublished": day or _today(),
        "license": {"@id": _LICENSE["@id"]}, "hasPart": _named(parts), "mentions": {"@id": "#made"},
    }
    if _synthetic(kind):
        root["keywords"] = "synthetic data"
    made = {
        "@id": "#made", "@type": "CreateAction", "name": origin.line, "instrument": {"@id": "#estim"}, "object": _named(read),
        "result": _named(parts),
    }
    head = {"@id": CRATE, "@type": "CreativeWork", "conformsTo": {"@id": _SPECIFICATION}, "about": {"@id": "./"}}
    return as_json({"@context": f"{_SPECIFICATION}/context", "@graph": [head, root, *parts, made, *tools, *read, _LICENSE]})


def crate_troubles(read: Callable[[str], bytes | None], origin: Origin) -> list[str]:
    """Where the description of a report is not that of the files beside it; empty where it is, or where there is none.

    read : gives the bytes of a file of the report, None where there is none.
    """
    data = read(CRATE)
    if data is None or CRATE not in origin.outputs:
        return []
    try:
        entities = {one["@id"]: one for one in json_of(data)["@graph"]}
        names = [unquote(part["@id"]) for part in entities["./"]["hasPart"]]
        day = str(entities["./"]["datePublished"])
    except (ValueError, KeyError, TypeError, AttributeError):
        names, day = [".."], ""
    if not all(map(inside, names)):
        return [f"{CRATE} does not describe a report"]
    beside = {name: read(name) or b"" for name in names if name != ORIGIN}
    if crate_of(beside, origin, day=day) != data:
        return [f"{CRATE} does not describe the files beside it"]
    return []


def _part(path: str, data: bytes, shown: str) -> dict[str, Any]:
    """shown : what a figure shows, in words."""
    name = PurePosixPath(path)
    words = shown or _WORDS.get(path, name.stem)
    return {
        "@id": quote(path, safe="/.-_+~", errors="surrogateescape"), "@type": "File", "name": name.name, "description": words,
        "encodingFormat": _type(path), "contentSize": str(len(data)), "sha256": sha256(data).hexdigest(),
    }


def _type(path: str) -> str:
    return _TYPES.get(PurePosixPath(path).suffix.lower(), "application/octet-stream")


def _tool(name: str, number: str) -> dict[str, Any]:
    home = {"url": _HOMES[name]} if name in _HOMES else {}
    return {"@id": f"#{name}", "@type": "SoftwareApplication", "name": name, "version": number, **home}


def _named(entities: list[dict[str, Any]]) -> list[dict[str, str]]:
    return [{"@id": one["@id"]} for one in entities]


def _title(report: str) -> str:
    """The title as it is read."""
    return unescaped(report.partition("\n")[0].removeprefix("# ")).replace("\u00a0", " ")


def _kind(report: str) -> str:
    """What the report says of the kind of its data, in its language, or ""."""
    said = next((words for words in _in_every_language(lambda: [kind_words(kind) for kind in KINDS]) if words in report), "")
    return (said or _synthetic(report)).replace("**", "")


def _synthetic(text: str) -> str:
    """What a text says of data made by a program, up to the end of its clause, or ""."""
    said = _in_every_language(lambda: [phrase("SYNTHETIC data")])
    found = (re.search(rf"(?i:{words[0]}){re.escape(words[1:])}[^.:*]*", text) for words in said)
    return next((f"{one[0]}." for one in found if one), "")


def _in_every_language(say: Callable[[], Iterable[str]]) -> list[str]:
    """What `say` says in each: a report has one, whoever reads it."""
    found: list[str] = []
    for name in LANGUAGES:
        with spoken(name):
            found += say()
    return found


def _today() -> str:
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    return now.date().isoformat()
