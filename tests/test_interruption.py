"""`estim fit` interrupted: exit code 130, one line, what is kept, who may go on with it, and the
same bytes in the end.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from troubles import Formula

from estim import pipeline
from estim.cli.commands import main
from estim.common.interruption import STOPPING
from estim.sampling.ensembles import sampler_of

PATIENCE = 300.0  # s, for what happens within a few unless it never does
ENDLESS = """
from functools import partial
import estim.sampling
from estim.cli.commands import main
from estim.sampling.ensembles import EnsembleRun
# that no chain reaches; its 20 000 steps take a quarter of an hour
estim.sampling.Target = partial(estim.sampling.Target, ess=1e12)
advance = EnsembleRun.advance
EnsembleRun.advance = lambda walk, n_step: (print("sampling", flush=True), advance(walk, n_step))
main()
"""
RunFit = Callable[..., tuple[int, str, str]]


@pytest.fixture
def words(tmp_path: Path) -> tuple[str, ...]:
    """`fit` of two runs of a straight line, into `out`."""
    path = Formula(
        "a + b*x", "a = {start = 1.0}\nb = {start = 1.0}", lambda x: 1.0 + 2.0 * x
    ).write(tmp_path)
    path.write_text(path.read_text() + '[[runs]]\nname = "s"\nfile = "r.csv"\n')
    return "fit", str(path), "--out", str(tmp_path / "out")


@pytest.fixture
def endless(words: tuple[str, ...]) -> Iterator[subprocess.Popen[str]]:
    """A process that samples a run for ever."""
    command = [sys.executable, "-c", ENDLESS, *words, "--run", "r"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[1],
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "sampling\n"
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def fit(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> RunFit:
    """The command in this process: exit code, what it says and what it complains of."""

    def run(
        *options: str, stopped_at: int = 0, number: int = signal.SIGTERM
    ) -> tuple[int, str, str]:
        """stopped_at : the analysis, counted from 1, at whose draws the process is asked to stop by
        the signal `number`.
        """
        drawn, asked = pipeline.certified_chain, []

        def certified_chain(*arguments: object, **choices: object) -> object:
            asked.append(arguments)
            if len(asked) == stopped_at:
                signal.raise_signal(number)
            return drawn(*arguments, **choices)

        with monkeypatch.context() as patched:
            patched.setattr(sys, "argv", ["estim", *words, *options])
            patched.setattr(pipeline, "certified_chain", certified_chain)
            with pytest.raises(SystemExit) as ended:
                main()
        return ended.value.code, *capsys.readouterr()

    return run


def written(folder: Path) -> dict[str, bytes]:
    """All files but draws.nc, into which older h5netcdf writes the time of day, and its digest in
    origin.json.
    """
    files = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".nc"
    }
    return {
        name: re.sub(rb'"draws.nc": "[0-9a-f]{64}"', b"", content)
        for name, content in files.items()
    }


# which ends a process at once where nobody handles it, and that no shell ignores
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM])
def test_signal_in_the_middle_of_a_chain_ends_with_130_and_one_line(
    endless: subprocess.Popen[str], tmp_path: Path, number: int
) -> None:
    endless.send_signal(number)
    _, err = endless.communicate(timeout=PATIENCE)
    assert (endless.returncode, err) == (130, "interrupted\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("number", STOPPING)
def test_every_signal_to_stop_ends_with_130(fit: RunFit, tmp_path: Path, number: int) -> None:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip("the tests were started with this signal ignored (nohup)")
    assert fit("--run", "r", stopped_at=1, number=number) == (130, "", "interrupted\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_several_runs_go_on_with_the_one_that_was_interrupted(fit: RunFit, tmp_path: Path) -> None:
    """The first of two is done when the signal comes; the end is that of a command that nobody
    interrupted, in every byte.
    """
    place = tmp_path / "out" / ".checkpoint"
    assert fit()[0] == 0
    reference = written(tmp_path / "out")
    assert {"report.md", "r/result.json", "s/result.json"} <= reference.keys()
    shutil.rmtree(tmp_path / "out")
    code, out, err = fit(stopped_at=2)
    assert (code, out.splitlines()[:2], err) == (
        130,
        ["columns: x = x, y = y", "r: ok"],
        "interrupted: continue with --resume\n",
    )
    assert len(list(place.iterdir())) == 1
    code, _, err = fit("--resume", stopped_at=2)  # it draws once, and is not stopped
    assert (code, err) == (
        0,
        f"{place}: finished pieces: 1; those made from the same inputs are used\n",
    )
    assert written(tmp_path / "out") == reference


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_what_was_made_with_another_seed_is_not_used(fit: RunFit, tmp_path: Path) -> None:
    place = tmp_path / "out" / ".checkpoint"
    assert fit(stopped_at=2)[0] == 130
    assert fit("--resume", "--seed", "2", stopped_at=1)[0] == 130  # asked for draws at once
    code, _, err = fit(stopped_at=1)
    said = (
        f"{place}: what an unfinished command left is discarded (--resume would continue "
        "it)\ninterrupted\n"
    )
    assert (code, err) == (130, said)
    code, _, err = fit("--resume", stopped_at=1)
    assert (code, err) == (130, f"{place}: nothing to resume, all is computed anew\ninterrupted\n")


def test_folder_that_cannot_be_written_is_known_before_sampling(
    fit: RunFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".checkpoint").write_text("in the way")
    monkeypatch.setattr(
        "estim.sampling.certified.sample_posterior", lambda *_, **__: pytest.fail("it was sampled")
    )
    code, _, err = fit("--run", "r")
    assert code == 2
    assert err.startswith(f"error: {tmp_path / 'out' / '.checkpoint'}")
    assert "cannot be written" in err
    assert err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_second_fit_into_the_same_folder_is_refused_while_the_first_lives(
    endless: subprocess.Popen[str], fit: RunFit, tmp_path: Path
) -> None:
    folder = tmp_path / "out" / ".checkpoint"
    for more in ((), ("--resume",)):
        words = "is in use by another process: wait for its end, or choose another place"
        assert fit("--run", "r", *more) == (2, "", f"error: {folder}: {words}\n")
    endless.kill()  # it takes its lock with it
    endless.wait()
    assert fit("--run", "r")[0] == 0
    assert not folder.exists()


def test_an_end_within_the_density_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    """emcee prints a traceback of whatever ends its density, a signal too."""

    class Ended:
        names = ("a",)

        def log_density(self, draws: np.ndarray) -> np.ndarray:
            raise KeyboardInterrupt

    ahead = SimpleNamespace(steps=lambda: iter(()), proposal=None, share=0.0)
    sampler = sampler_of(Ended(), (1, 8), ahead, seed=1)
    with pytest.raises(KeyboardInterrupt):
        sampler.compute_log_prob(np.zeros((8, 1)))
    assert capfd.readouterr() == ("", "")
