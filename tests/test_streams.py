"""Standard output and standard error that are closed, full, without a reader, or cannot show Greek: an exit code and the report all the same."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from troubles import TROUBLES

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
COMMAND = f'"{sys.executable}" -m estim'


def shell(line: str, *, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """What a shell makes of `line`, in which $E is the command."""
    command = ["bash", "-c", line.replace("$E", COMMAND)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=os.environ | environment, check=False, errors="replace")


@pytest.fixture(scope="module")
def edge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose reasons hold Greek letters, with a report that is not ok."""
    return TROUBLES["gamma at its bound"].campaign.write(tmp_path_factory.mktemp("edge")).parent


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("$E --help >/dev/full", 74, "error: standard output: cannot be written (no space left on device)\n"),
        ("$E --version >/dev/full", 74, "error: standard output: cannot be written (no space left on device)\n"),
        ("$E fit nowhere.toml 2>/dev/full", 2, ""),
        ("$E fit nowhere.toml 2>&-", 2, ""),
        ("$E fit nowhere.toml 2>&- >&-", 2, ""),
        ("$E fit nowhere.toml >&-", 2, "error: nowhere.toml: cannot be read (no such file or directory)\n"),
        ("$E --help >&-", 0, ""),
        ("$E --help 0<&- >&- 2>&-", 0, ""),
        ("$E fit --help | true; exit ${PIPESTATUS[0]}", 141, ""),
        ("$E --sead 2>&1 >/dev/full", 2, ""),
    ],
)
def test_a_stream_that_cannot_be_written_costs_no_traceback(line: str, code: int, said: str, tmp_path: Path) -> None:
    done = shell(line, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (code, said), done


@pytest.mark.slow
@pytest.mark.parametrize(
    ("streams", "said"),
    [
        (">&- 2>&-", ""), (">/dev/full", "error: standard output: cannot be written (no space left on device)\n"), ("2>/dev/full", ""),
        ("| true; exit ${PIPESTATUS[0]}", ""),
    ],
)
def test_the_report_is_written_whoever_reads_what_is_said(streams: str, said: str, edge: Path, tmp_path: Path) -> None:
    done = shell(f'$E fit "{edge}/campaign.toml" --out out --max-steps 60 {streams}', cwd=tmp_path)
    assert (done.returncode, done.stderr) == (3, said), done  # the result is not ok, which outweighs a line that nobody reads
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"report.md", "result.json", "figures"}
    assert (tmp_path / "out" / "report.md").read_text().startswith("# ")
    assert not [path for path in tmp_path.iterdir() if path.name != "out"]


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_that_cannot_show_greek_gets_an_escape(encoding: str, edge: Path, tmp_path: Path) -> None:
    line = f'$E fit "{edge}/campaign.toml" --out out --max-steps 60'
    done = shell(line, cwd=tmp_path, PYTHONIOENCODING=encoding, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert "\\u03b3[b]" in done.stdout
    assert "γ[b]" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.slow
def test_a_users_matplotlib_settings_do_not_reach_the_figures(edge: Path, tmp_path: Path) -> None:
    for name, settings in (("plain", ""), ("own", "text.usetex: True\nfont.size: 30\nsavefig.bbox: tight\nbackend: nonsense\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "matplotlibrc").write_text(settings)
        done = shell(
            f'$E fit "{edge}/campaign.toml" --out {name}/out --max-steps 60', cwd=tmp_path, MATPLOTLIBRC=str(tmp_path / name), MPLBACKEND="nonsense"
        )
        assert done.returncode == 3, done.stderr
    for figure in sorted((tmp_path / "plain" / "out" / "figures").iterdir()):
        assert figure.read_bytes() == (tmp_path / "own" / "out" / "figures" / figure.name).read_bytes(), figure.name
