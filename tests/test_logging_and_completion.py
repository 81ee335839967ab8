"""What a program that uses estim sees of its work (`logging`), and what a shell does (Tab)."""

from __future__ import annotations

import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from estim import Target, fit_curve, sample_curve

X = np.linspace(0.0, 1.0, 12)
LINE = fit_curve("line", X, 2.0 * X + 0.1 * np.cos(40.0 * X), u_y=0.1)


def test_the_logger_tells_the_phases_of_an_analysis(caplog: pytest.LogCaptureFixture) -> None:
    told: list[tuple[int, str]] = []
    with caplog.at_level(logging.INFO, "estim"):
        sample_curve(
            LINE, seed=1, target=Target(ess=500), progress=lambda *phase: told.append(phase)
        )
    said = [record.getMessage() for record in caplog.records if record.name == "estim"]
    assert said == [f"{percent} %, {message}" for percent, message in told]
    assert said[-1] == "100 %, checks"
    assert any("sampling" in line for line in said)


def test_nothing_is_logged_unless_asked(
    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    sample_curve(LINE, seed=1, target=Target(ess=500))
    assert [record for record in caplog.records if record.name == "estim"] == []
    assert capfd.readouterr() == ("", "")


def shell(project: Path, **variables: str) -> str:
    """What `estim` says to a shell that asks it."""
    code = "import sys; sys.argv[0] = 'estim'; from estim.cli.commands import main; main()"
    environment = {**os.environ, "PYTHONPATH": str(project), **variables}
    words = [sys.executable, "-c", code]
    return subprocess.run(
        words, env=environment, capture_output=True, text=True, check=False
    ).stdout


@pytest.mark.slow
def test_tab_completes_commands_options_and_choices(project: Path) -> None:
    (line,) = re.findall(
        r"eval \"\$\((_ESTIM_COMPLETE)=(bash_source) estim\)\"",
        (project / "docs" / "interop.md").read_text(encoding="utf-8"),
    )
    for source in (line[1], "zsh_source", "fish_source"):
        assert "estim" in shell(project, **{line[0]: source})

    def completed(*words: str) -> list[str]:
        asked = {"COMP_WORDS": " ".join(("estim", *words)), "COMP_CWORD": str(len(words))}
        given = shell(project, _ESTIM_COMPLETE="bash_complete", **asked)
        return [entry.partition(",")[2] for entry in given.splitlines()]

    assert completed("pr") == ["propagate"]
    assert completed("mean", "--js") == ["--json"]
    assert completed("fit", "a.csv", "--robust", "m") == ["mixture"]
