"""`--json`: what a command says, writes and finds, as one JSON object on standard output, for
programs.  Every command but `serve` has it, and writes the same files as without it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import click

from estim.common import Files, Json, as_json, json_of

_KEY = "estim.json"


@dataclass(frozen=True)
class Answer:
    """lines : what would have been said.  files : that were written.  results : file, or what a
    result without a file is -> its record in JSON.
    """

    lines: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    results: Files = field(default_factory=dict)

    def record(self, command: str, code: int) -> Json:
        """All of it; each value that has an uncertainty once more as one of `estimates`, whatever
        the result.
        """
        from estim.verification import estimates

        results = {name: json_of(data) for name, data in self.results.items()}
        return {
            "schema": "estim-command-1",
            "command": command,
            "exit_code": code,
            "lines": self.lines,
            "estimates": [
                {"result": name, "name": one.name, "unit": one.unit or None}
                | dict(zip(("value", "u"), one.value, strict=True))
                for name, found in results.items()
                for one in estimates(found)
            ],
            "files": self.files,
            "results": results,
        }


def answer() -> Answer | None:
    """The answer of the command under way; None without --json."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(_KEY)


def found(name: str, result: object) -> None:
    """Keeps a result that no file holds, for --json."""
    if (kept := answer()) is not None:
        kept.results[name] = as_json(result)


def written(folder: Path, files: Files) -> None:
    """Keeps what was written, for --json."""
    if (kept := answer()) is not None:
        paths = {(folder / name).as_posix(): data for name, data in files.items()}
        kept.files.extend(paths)
        kept.results.update({path: data for path, data in paths.items() if path.endswith(".json")})


def begun() -> Answer:
    """The answer of the command under way, which is empty."""
    click.get_current_context().meta[_KEY] = kept = Answer()
    return kept
