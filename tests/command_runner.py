"""Commands in this process, with what they say on standard output and on standard error apart."""

from __future__ import annotations

import inspect

from click.testing import CliRunner


def runner() -> CliRunner:
    """click before 8.2 must be asked to keep the two apart; later versions always do."""
    apart = {"mix_stderr": False} if "mix_stderr" in inspect.signature(CliRunner).parameters else {}
    return CliRunner(**apart)
