"""Sections that installed packages add to a report (the entry points `estim.sections`;
`docs/extending.md` explains them to their authors).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

from estim.common import InputError, as_json, phrase
from estim.plugins import Plugin, plugin_asked, told
from estim.reports.result import Result

GROUP = "estim.sections"


def sections_called(names: Sequence[str]) -> list[Plugin]:
    """The sections of these names, which can be loaded.  Raises InputError."""
    return [_called(name) for name in dict.fromkeys(names)]


def known_sections() -> Iterator[str | InputError]:
    """The sections that installed packages add, or what is wrong with one."""
    return told(GROUP, lambda plugin: f"section {_called(plugin.name).name}")


def written(plugin: Plugin, result: Result) -> str:
    """A section about `result` in Markdown, below its heading.  Raises InputError."""
    record = json.loads(as_json(result))
    text = plugin.make(lambda write: write(record), str)
    by = phrase("Written by the package {package}.", package=plugin.owner)
    return f"\n## {plugin.name}\n\n{by}\n\n{text.strip()}\n"


def _called(name: str) -> Plugin:
    plugin = plugin_asked(GROUP, name, field="section")
    plugin.make(lambda write: write.__call__, object)
    return plugin
