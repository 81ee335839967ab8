"""Computations in pieces go on where they were killed, with the same bytes: calibrations and comparisons of noise models."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from joint_runs import DECAY, problem_of
from troubles import Disk

from estim.cli.commands import cli
from estim.common.errors import InputError, Interrupted
from estim.common.jobs import spread
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.priors import Normal
from estim.sampling.chain import Target
from estim.sampling.checkpoint import Store
from estim.sampling.marginal_draws import marginal_chain
from estim.sampling.pieces import PieceStore

KEY = {"seed": {"": "1"}, "settings": {"what": "sbc"}}


def test_a_piece_comes_back_as_it_was_and_a_torn_one_not_at_all(tmp_path: Path) -> None:
    store = PieceStore(tmp_path / "c" / "p", resume=True, within=tmp_path)
    pieces = store.under(KEY)
    pieces.keep("000001", {"a": np.arange(3.0)})
    pieces.keep("000002", {"a": np.arange(4.0)})
    again = store.under(KEY)
    assert np.array_equal(again.kept("000001")["a"], np.arange(3.0))
    assert again.kept("000003") is None
    torn = next((tmp_path / "c" / "p").glob("000002-*"))
    torn.write_bytes(torn.read_bytes()[:-1])
    assert store.under(KEY).kept("000002") is None


def test_other_work_is_refused_with_what_differs_and_discarded_without_resume(tmp_path: Path) -> None:
    said: list[str] = []
    PieceStore(tmp_path / "p", resume=True).under(KEY).keep("1", {"a": np.ones(1)})
    with pytest.raises(InputError, match=r"another seed \(1, now 2\)"):
        PieceStore(tmp_path / "p", resume=True).under(KEY | {"seed": {"": "2"}})
    pieces = PieceStore(tmp_path / "p", say=said.append).under(KEY)
    assert "discarded" in said[0]
    assert pieces.kept("1") is None
    (tmp_path / "p" / "mine.txt").write_text("stays")
    PieceStore(tmp_path / "p").remove()
    assert [path.name for path in (tmp_path / "p").iterdir()] == ["mine.txt"]


def test_a_key_that_estim_has_not_written_is_refused(tmp_path: Path) -> None:
    PieceStore(tmp_path / "p", resume=True).under(KEY).keep("1", {"a": np.ones(1)})
    (tmp_path / "p" / "key.json").write_text("[]")
    with pytest.raises(InputError, match="is damaged, or estim has not written it"):
        PieceStore(tmp_path / "p", resume=True).under(KEY)


def test_what_is_known_is_not_done_again() -> None:
    done: dict[int, int] = {}
    asked: list[int] = []

    def square(n: int) -> int:
        asked.append(n)
        return n * n

    assert spread(square, range(4), jobs=1, known={1: 1, 3: 9}, keep=done.__setitem__) == [0, 1, 4, 9]
    assert asked == [0, 2]
    assert done == {0: 0, 2: 4}


def decays() -> Fit:
    rng, x = np.random.default_rng(2), np.linspace(0.0, 1.0, 9)
    ys = [size * np.exp(-1.3 * x) + 0.05 * rng.standard_normal(x.size) for size in (0.8, 1.0, 1.2, 1.1)]
    problem = problem_of(DECAY, {"rate": Normal(1.0, 0.5)}, {"size": Normal(1.0, 0.3)}, x, ys, 0.05)
    return fit_least_squares(problem, rng=np.random.default_rng(3), n_start=1)


@pytest.mark.parametrize("n_stage", [2, 5, 8])
def test_a_marginal_that_is_stopped_goes_on_with_the_same_draws(tmp_path: Path, n_stage: int) -> None:
    """While it adapts, while the runs are integrated, and while their own parameters are drawn."""
    fit, target = decays(), Target(ess=1000)
    whole, _ = marginal_chain(fit, target=target, rng=np.random.default_rng(7))
    left = iter([False] * (n_stage - 1))
    store = Store(tmp_path / "kept" / "c", resume=True)
    with pytest.raises(Interrupted):
        marginal_chain(fit, target=target, rng=np.random.default_rng(7), store=store, stop=lambda: next(left, True))
    said: list[str] = []
    resumed, _ = marginal_chain(fit, target=target, rng=np.random.default_rng(7), store=store, progress=lambda _, message: said.append(message))
    assert np.array_equal(resumed.draws, whole.draws)
    assert any("adapting" in message for message in said) == (n_stage == 2)
    assert "run 4 of 4" in said
    store.remove()
    assert not (tmp_path / "kept").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_calibration_that_is_killed_ends_with_the_same_bytes(tmp_path: Path, project: Path) -> None:
    choices = [str(Disk().write(tmp_path)), "--what", "coverage", "--simulations", "20", "--jobs", "1"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(project)}
    command = [sys.executable, "-m", "estim", "calibrate", *choices, "--out", str(tmp_path / "killed")]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    kept = tmp_path / "killed" / ".checkpoint" / "r-coverage"
    while len(list(kept.glob("0*.npz"))) < 3 and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    n_kept = len(list(kept.glob("0*.npz")))
    assert 3 <= n_kept < 20
    done = CliRunner().invoke(cli, ["calibrate", *choices, "--out", str(tmp_path / "killed"), "--resume"])
    assert f"continued, {n_kept} pieces were done" in done.output
    assert not kept.exists()
    CliRunner().invoke(cli, ["calibrate", *choices, "--out", str(tmp_path / "whole")])
    for name in ("report.md", "calibration.json"):
        if (tmp_path / "whole" / name).exists():
            assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert (tmp_path / "killed" / "report.md").exists()
