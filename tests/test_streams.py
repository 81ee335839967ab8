"""Standard output and standard error that are closed, full, without a reader, or cannot show Greek:
an exit code and the report all the same.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from troubles import Formula, uniform

from estim.cli.commands import cli
from estim.cli.terminal import exit_code, say

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
COMMAND = f'"{sys.executable}" -m estim'
PATCHED = (
    "import estim.reports.pages as pages; pages.png = lambda *_: b''; from "
    "estim.cli.commands import main; main()"
)
WITHOUT_FIGURES = f'"{sys.executable}" -c "{PATCHED}"'


def shell(line: str, *, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """What a shell makes of `line`, in which $E is the command, and $F the command with empty
    figures.
    """
    command = ["bash", "-c", line.replace("$E", COMMAND).replace("$F", WITHOUT_FIGURES)]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=cwd,
        env=os.environ | environment,
        check=False,
        errors="replace",
    )


@pytest.fixture(scope="module")
def edge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose reasons hold a Greek letter, with a report that is not ok."""
    line = Formula(
        "γ*x + b", f"'γ' = {uniform(0.0, 1.98)}\nb = {{start = 1.0}}", lambda x: 1.0 + 2.0 * x
    )
    return line.write(tmp_path_factory.mktemp("edge")).parent


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        (
            "$E --help >/dev/full",
            74,
            "error: standard output: cannot be written (no space left on device)\n",
        ),
        (
            "$E --version >/dev/full",
            74,
            "error: standard output: cannot be written (no space left on device)\n",
        ),
        ("$E --sead 2>/dev/full", 2, ""),
        ("$E --sead 2>&-", 2, ""),
        ("$E --sead 2>&- >&-", 2, ""),
        (
            "$E fit nowhere.toml >&-",
            2,
            "error: nowhere.toml: cannot be read (no such file or directory)\n",
        ),
        ("$E --help >&-", 0, ""),
        ("$E --help 0<&- >&- 2>&-", 0, ""),
        ("$E fit --help | true; exit ${PIPESTATUS[0]}", 141, ""),
        ("$E --sead 2>&1 >/dev/full", 2, ""),
    ],
)
def test_a_stream_that_cannot_be_written_costs_no_traceback(
    line: str, code: int, said: str, tmp_path: Path
) -> None:
    done = shell(line, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (code, said), done


@pytest.mark.slow
@pytest.mark.parametrize(
    ("streams", "said"),
    [
        (">&- 2>&-", ""),
        (">/dev/full", "error: standard output: cannot be written (no space left on device)\n"),
    ],
)
def test_the_report_is_written_whoever_reads_what_is_said(
    streams: str, said: str, edge: Path, tmp_path: Path
) -> None:
    done = shell(
        f'$F fit "{edge}/campaign.toml" --out out --max-steps 60 --figures all {streams}',
        cwd=tmp_path,
    )
    # the result is not ok, which outweighs a line that nobody reads
    assert (done.returncode, done.stderr) == (3, said), done
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {
        "report.md",
        "result.json",
        "figures",
    }
    assert (tmp_path / "out" / "report.md").read_text().startswith("# ")
    assert not [path for path in tmp_path.iterdir() if path.name != "out"]


@pytest.mark.parametrize(
    ("streams", "code", "said"),
    [
        ("2>/dev/full", 0, ""),
        ("2>&-", 0, ""),
        ("| true; exit ${PIPESTATUS[0]}", 141, "warning: the acceleration"),
        ("2>/dev/full >/dev/full", 74, ""),
    ],
)
def test_a_command_that_tells_and_warns_writes_its_file_whoever_reads_it(
    streams: str, code: int, said: str, tmp_path: Path
) -> None:
    (tmp_path / "a.txt").write_text(
        "A\nt,x,y\n" + "".join(f"{0.1 * n:.1f},{0.1 * n * n:.3f},0.0\n" for n in range(9))
    )
    done = shell("$E import a.txt -o new/run.csv " + streams, cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (code, bool(said)), done
    assert done.stderr.startswith(said)
    assert (tmp_path / "new" / "run.csv").read_text().count("\n") > 9
    assert {path.name for path in tmp_path.rglob("*")} == {"a.txt", "new", "run.csv"}


@pytest.mark.parametrize(("full", "code"), [(True, 74), (False, 141)])
@pytest.mark.parametrize("found", [0, 3])
def test_what_a_command_found_outweighs_a_line_that_nobody_reads(
    full: bool, code: int, found: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with open("/dev/full" if full else writer, "w", encoding="utf-8") as stdout:
        monkeypatch.setattr(sys, "stdout", stdout)
        assert exit_code(lambda: say("one") or say("two") or found) == (found or code)
    if full:
        os.close(writer)


def test_a_stream_of_text_without_bytes_is_written_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """As that of a notebook."""
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    assert exit_code(lambda: say("γ")) == 0
    assert sys.stdout.getvalue() == "γ\n"


@pytest.mark.slow
def test_neither_a_terminal_without_greek_nor_a_users_matplotlib_reaches_the_report(
    edge: Path, tmp_path: Path
) -> None:
    """Greek is an escape on the terminal and itself in the report; the figures are those that the
    settings of nobody give.
    """
    (tmp_path / "matplotlibrc").write_text(
        "text.usetex: True\nfont.size: 30\nsavefig.bbox: tight\nbackend: nonsense\n"
    )
    own = {
        "MATPLOTLIBRC": str(tmp_path),
        "MPLBACKEND": "nonsense",
        "PYTHONIOENCODING": "ascii",
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
    }
    done = shell(
        f'$E fit "{edge}/campaign.toml" --out out --max-steps 60 --figures all',
        cwd=tmp_path,
        PYTHONCOERCECLOCALE="0",
        **own,
    )
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert "\\u03b3" in done.stdout
    assert "γ" in (tmp_path / "out" / "report.md").read_text()
    assert (
        CliRunner()
        .invoke(
            cli,
            [
                *("fit", f"{edge}/campaign.toml", "--out", str(tmp_path / "plain")),
                *("--max-steps", "60", "--figures", "all"),
            ],
        )
        .exit_code
        == 3
    )
    figures = sorted((tmp_path / "plain" / "figures").iterdir())
    assert len(figures) > 4
    for figure in figures:
        assert figure.read_bytes() == (tmp_path / "out" / "figures" / figure.name).read_bytes(), (
            figure.name
        )


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [("utf-8", "−3.0×10⁻⁷ µm²"), ("cp1252", "-3.0x10^-7 um^2"), ("ascii", "-3.0x10^-7 um^2")],
)
def test_marks_of_numbers_that_a_stream_lacks_are_those_of_a_keyboard(
    encoding: str, shown: str, tmp_path: Path
) -> None:
    done = shell(
        "$E diff '1.70(2)×10⁻⁵ µm²' '1.73(3)×10⁻⁵ µm²'", cwd=tmp_path, PYTHONIOENCODING=encoding
    )
    assert done.stdout.startswith(f"difference: {shown}, u = "), done
    assert "\\" not in done.stdout
