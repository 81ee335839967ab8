"""`--json`: what a command prints, writes and computes, as one JSON object on standard output, for
programs.  Every command but `serve` has it, and writes the same files as without it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import click

from estim.common import Files, Json, as_json, json_of

_KEY = "estim.json"


@dataclass(frozen=True)
class JsonAnswer:
    """lines : what would have been printed.  files : that were written.  results : file, or what a
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
                {"result": name, "name": estimate.name, "unit": estimate.unit or None}
                | dict(zip(("value", "u"), estimate.value, strict=True))
                for name, result in results.items()
                for estimate in estimates(result)
            ],
            "files": self.files,
            "results": results,
        }


def answer() -> JsonAnswer | None:
    """The answer of the command under way; None without --json."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(_KEY)


def keep_result(name: str, result: object) -> None:
    """Keeps a result that no file holds, for --json."""
    if (current := answer()) is not None:
        current.results[name] = as_json(result)


def keep_files(folder: Path, files: Files) -> None:
    """Keeps what was written, for --json."""
    if (current := answer()) is not None:
        paths = {(folder / name).as_posix(): data for name, data in files.items()}
        current.files.extend(paths)
        current.results.update(
            {path: data for path, data in paths.items() if path.endswith(".json")}
        )


def begin_answer() -> JsonAnswer:
    """The answer of the command under way, which is empty."""
    click.get_current_context().meta[_KEY] = current = JsonAnswer()
    return current
