"""`estim fit` interrupted: exit code 130, what is kept, who may go on with it, and the same bytes in the end.

Nothing waits for a clock: a chain without end, in a process of its own, is signalled once it has kept a step; a fit in this process signals
itself after a number of steps.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from test_checkpoint import wait_for
from troubles import Formula

from estim.cli.commands import main
from estim.common.errors import Interrupted
from estim.common.interruption import STOPPING, asked_to_stop
from estim.sampling.chain import Target
from estim.sampling.checkpoint import Record, read_checkpoint

ENDLESS = 1e12  # effective draws that no chain reaches; its 20 000 steps take a quarter of an hour
PATIENCE = 300.0  # s, for what happens within a few unless it never does
IN_A_PROCESS = f"""
import time
from functools import partial
import estim.sampling
from estim.cli.commands import main
from estim.sampling.checkpoint import Record
estim.sampling.Target = partial(estim.sampling.Target, ess={ENDLESS})
Record.due = lambda record: time.sleep(0.05) or True  # every step is kept
main()
"""
Fit = Callable[..., tuple[int, str, str]]


@pytest.fixture
def words(tmp_path: Path) -> tuple[str, ...]:
    """`fit` of two runs of a straight line, into `out`."""
    path = Formula("a + b*x", "a = {start = 1.0}\nb = {start = 1.0}", lambda x: 1.0 + 2.0 * x).write(tmp_path)
    path.write_text(path.read_text() + '[[runs]]\nname = "s"\nfile = "r.csv"\n')
    return "fit", str(path), "--out", str(tmp_path / "out")


@pytest.fixture
def endless(words: tuple[str, ...], tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that fits a run for ever, and has kept a step."""
    command = [sys.executable, "-c", IN_A_PROCESS, *words, "--run", "r"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    try:
        wait_for(lambda: process.poll() is not None or n_step(tmp_path, "r") > 0)
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def fit(words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Fit:
    """The command in this process: exit code, what it says and what it complains of."""

    def run(*options: str, until: tuple[str, int] | None = None, number: int = signal.SIGTERM) -> tuple[int, str, str]:
        """until : a run, and the number of its new steps after which the process is asked to stop, by the signal `number`."""
        due, asked = Record.due, []

        def ask(record: Record) -> bool:
            asked.append(record.folder.name)
            if until is not None and asked.count(until[0]) == until[1]:
                signal.raise_signal(number)
            return due(record)

        with monkeypatch.context() as patched:
            patched.setattr(sys, "argv", ["estim", *words, *options])
            patched.setattr(Record, "due", ask)
            with pytest.raises(SystemExit) as ended:
                main()
        return ended.value.code, *capsys.readouterr()

    return run


def n_step(folder: Path, run: str) -> int:
    """Steps that are kept of a run."""
    kept = read_checkpoint(folder / "out" / ".checkpoint" / run)
    return 0 if kept is None else kept.n_step


def written(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.suffix != ".nc"}


def test_signal_of_another_process_ends_with_130_and_a_checkpoint(endless: subprocess.Popen[str], tmp_path: Path) -> None:
    seen = n_step(tmp_path, "r")
    endless.send_signal(signal.SIGTERM)  # the one that ends a process at once where nobody handles it, and that no shell ignores
    out, err = endless.communicate(timeout=PATIENCE)  # how soon: test_signal_that_nobody_asks_about_ends_the_work_after_a_second
    assert (endless.returncode, out, err) == (130, "", "interrupted: continue with --resume\n")
    assert n_step(tmp_path, "r") >= seen > 0
    assert not (tmp_path / "out" / "report.md").exists()


@pytest.mark.parametrize("number", STOPPING)
def test_every_signal_to_stop_ends_with_130_and_a_checkpoint(fit: Fit, tmp_path: Path, number: int) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip("the tests were started with this signal ignored (nohup)")
    assert fit("--run", "r", until=("r", 7), number=number) == (130, "", "interrupted: continue with --resume\n")
    assert n_step(tmp_path, "r") == 8
    assert not (tmp_path / "out" / "report.md").exists()


@pytest.mark.usefixtures("undrawn")
def test_fit_interrupted_and_resumed_gives_the_same_bytes(fit: Fit, tmp_path: Path) -> None:
    place = tmp_path / "out" / ".checkpoint" / "r"
    assert fit("--run", "r")[0] == 0
    reference = written(tmp_path / "out")
    assert {"report.md", "result.json", "figures/corner.png"} <= reference.keys()
    shutil.rmtree(tmp_path / "out")
    assert fit("--run", "r", until=("r", 20)) == (130, "", "interrupted: continue with --resume\n")
    assert n_step(tmp_path, "r") == 21
    code, _, err = fit("--run", "r", "--resume")
    assert (code, err) == (0, f"{place}: continued after step 21\n")
    assert written(tmp_path / "out") == reference


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_several_runs_go_on_with_the_one_that_was_interrupted(fit: Fit, tmp_path: Path) -> None:
    """The first of two is done when the signal comes."""
    folder = tmp_path / "out" / ".checkpoint"
    code, out, _ = fit(until=("s", 20))
    assert (code, out.splitlines()[:2]) == (130, ["columns: x = x, y = y", "r: ok"])
    first = written(tmp_path / "out" / "r")
    code, _, err = fit("--resume")
    assert code == 0
    assert re.match(f"{folder / 'r'}: continued after step \\d+\n{folder / 's'}: continued after step 21\n", err)
    assert written(tmp_path / "out" / "r") == first
    assert (tmp_path / "out" / "report.md").exists()
    assert not folder.exists()


def test_command_refuses_another_seed_and_says_so_in_one_line(fit: Fit, tmp_path: Path) -> None:
    place = tmp_path / "out" / ".checkpoint" / "r"
    code, _, err = fit("--run", "r", "--resume", until=("r", 5))
    assert (code, err) == (130, f"{place}: nothing to resume, sampling starts anew\ninterrupted: continue with --resume\n")
    code, _, err = fit("--run", "r", "--resume", "--seed", "2")
    words = "'resume' cannot continue: the chain was made with another seed (1, now 2); undo that, or fit without --resume to start anew"
    assert (code, err) == (2, f"error: {place}: {words}\n")


def test_folder_that_cannot_be_written_is_known_before_sampling(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".checkpoint").write_text("in the way")
    monkeypatch.setattr("estim.sampling.certified.sample_posterior", lambda *_, **__: pytest.fail("it was sampled"))
    code, _, err = fit("--run", "r")
    assert code == 2
    assert err.startswith(f"error: {tmp_path / 'out' / '.checkpoint'}")
    assert "cannot be written" in err
    assert err.count("\n") == 1


def test_second_fit_into_the_same_folder_is_refused_while_the_first_lives(
    endless: subprocess.Popen[str], fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out" / ".checkpoint"
    for more in ((), ("--resume",)):
        words = "is in use by another process: wait for its end, or choose another place"
        assert fit("--run", "r", *more) == (2, "", f"error: {folder}: {words}\n")
    endless.kill()  # it takes its lock with it
    endless.wait()
    seen = n_step(tmp_path, "r")
    assert seen > 0
    monkeypatch.setattr("estim.sampling.Target", partial(Target, ess=ENDLESS))
    code, _, err = fit("--run", "r", "--resume", until=("r", 5))
    assert code == 130
    assert err.startswith(f"{folder / 'r'}: continued after step {seen}\n")
    assert n_step(tmp_path, "r") == seen + 6
    assert not (folder / ".lock").exists()


# how a signal is asked about


def test_signal_that_nobody_asks_about_ends_the_work_after_a_second() -> None:
    before = signal.getsignal(signal.SIGTERM)
    start = time.monotonic()
    with asked_to_stop():
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Interrupted):
            wait_for(lambda: False)
    assert 0.9 < time.monotonic() - start < 3.0
    assert signal.getsignal(signal.SIGTERM) is before


def test_signal_that_is_asked_about_is_only_an_answer() -> None:
    with asked_to_stop() as asked:
        assert not asked()
        signal.raise_signal(signal.SIGINT)
        assert asked()
        time.sleep(1.2)  # no second signal comes
        with pytest.raises(Interrupted):
            signal.raise_signal(signal.SIGINT)  # an impatient person


def test_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with asked_to_stop() as asked:
            signal.raise_signal(signal.SIGTERM)
            assert not asked()
    finally:
        signal.signal(signal.SIGTERM, before)
