"""Finished pieces are used again where nothing that decides them has changed, whole ones only; what
is not estim's stays as it is.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from command_runner import runner
from joint_runs import DECAY, problem_of
from numpy.typing import NDArray
from troubles import Disk, Formula

from estim.cli.commands import cli
from estim.common import EstimError, Finding, Kind, PieceStore
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.pipeline import analyse_fit
from estim.problem.priors import Normal
from estim.sampling import Target

QUICK = Target(ess=300.0)


@dataclass(frozen=True)
class Record:
    """Of every kind of thing that is kept."""

    size: float
    values: NDArray[np.float64]
    holds: NDArray[np.bool_]
    told: tuple[Finding, ...]
    ends: Mapping[float, NDArray[np.float64]]
    other: str | None = None


def record() -> Record:
    told = (Finding(Kind.RHAT_HIGH, size=1.02, numbers={"limit": 1.01}),)
    return Record(
        np.float64(2.5),
        np.arange(6.0).reshape(2, 3),
        np.array([True, False]),
        told,
        {0.025: np.array([np.nan, np.inf])},
    )


def kept(store: PieceStore, name: str = "a") -> Record | None:
    """The record that is kept, None where it would be computed."""

    class AskedError(Exception):
        pass

    def compute() -> Record:
        raise AskedError

    try:
        return store.piece(name, Record, compute)
    except AskedError:
        return None


def test_a_piece_comes_back_as_it_was(tmp_path: Path) -> None:
    store = PieceStore(tmp_path / "kept", (1, "seed"))
    assert kept(store) is None
    store.piece("a", Record, record)
    found, made = kept(store), record()
    assert found is not None
    np.testing.assert_array_equal(found.values, made.values)
    np.testing.assert_array_equal(found.holds, made.holds)
    np.testing.assert_array_equal(found.ends[0.025], made.ends[0.025])
    assert (found.size, repr(found.told), found.other) == (2.5, repr(made.told), None)
    assert kept(store, "b") is None


def test_whatever_decides_a_piece_decides_whether_it_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = PieceStore(tmp_path, (1, "seed")).with_inputs(QUICK)
    store.piece("a", Record, record)
    assert kept(PieceStore(tmp_path).with_inputs(1, "seed", Target(ess=300.0))) is not None
    for inputs in ((2, "seed", QUICK), (1, "seed", replace(QUICK, max_step=1)), (1, "seed"), ()):
        assert kept(PieceStore(tmp_path).with_inputs(*inputs)) is None
    monkeypatch.setattr("estim.versions.version", lambda package: f"next {package}")
    assert kept(store) is None


@pytest.mark.parametrize(
    "damage",
    ["shorter", "longer", "a bit", "empty", "of another", "pickled", "objects", "another record"],
)
def test_a_damaged_or_forged_piece_is_computed_again(tmp_path: Path, damage: str) -> None:
    store = PieceStore(tmp_path)
    store.piece("a", Record, record)
    (path,) = tmp_path.iterdir()
    data = path.read_bytes()
    store.piece("b", Record, record)
    (other,) = set(tmp_path.iterdir()) - {path}

    def signed(content: bytes) -> bytes:
        from estim.common.checkpoints import _digest

        return _digest(path.stem, content) + content

    path.write_bytes(
        {
            "shorter": data[:-1],
            "longer": data + b"\0",
            "a bit": data[:99] + bytes([data[99] ^ 1]) + data[100:],
            "empty": b"",
            "of another": other.read_bytes(),
            "pickled": signed(pickle.dumps(record())),
            "objects": signed(
                msgspec.msgpack.encode(
                    {
                        "size": 1.0,
                        "values": ["|O", [1], b"8"],
                        "holds": ["|b1", [0], b""],
                        "told": [],
                        "ends": {},
                    }
                )
            ),
            "another record": signed(msgspec.msgpack.encode({"size": "large"})),
        }[damage]
    )
    assert kept(store) is None
    store.piece("a", Record, record)
    assert kept(store) is not None


def test_files_of_others_stay_and_what_a_kill_left_goes(tmp_path: Path) -> None:
    store = PieceStore(tmp_path)
    store.piece("a", Record, record)
    mine = ["thesis.tex", f"{'0' * 63}.piece", f"{'0' * 64}.pieces", ".key.json.swp"]
    for name in (*mine, f".{'0' * 64}.piece.1a2b3c4d"):
        (tmp_path / name).write_text("years of work")
    (tmp_path / "photos").mkdir()
    store.clear()
    assert {path.name for path in tmp_path.iterdir()} == {*mine, "photos"}


def test_a_link_in_the_place_of_a_piece_is_not_followed(tmp_path: Path) -> None:
    store = PieceStore(tmp_path / "kept")
    store.piece("a", Record, record)
    (path,) = (tmp_path / "kept").iterdir()
    path.rename(tmp_path / "moved")
    path.symlink_to(tmp_path / "moved")
    with pytest.raises(EstimError, match="is a symbolic link"):
        store.piece("a", Record, record)


# analyses


def decays() -> Fit:
    rng, x = np.random.default_rng(2), np.linspace(0.0, 1.0, 9)
    ys = [
        size * np.exp(-1.3 * x) + 0.05 * rng.standard_normal(x.size)
        for size in (0.8, 1.0, 1.2, 1.1)
    ]
    problem = problem_of(DECAY, {"rate": Normal(1.0, 0.5)}, {"size": Normal(1.0, 0.3)}, x, ys, 0.05)
    return fit_least_squares(problem)


@pytest.mark.parametrize("marginal", [False, True])
def test_an_analysis_with_draws_that_were_kept_is_the_one_that_made_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, marginal: bool
) -> None:
    fit, store = decays(), PieceStore(tmp_path)
    first = analyse_fit(fit, seed=1, target=QUICK, store=store, marginal=marginal)
    monkeypatch.setattr("estim.pipeline._drawn", lambda *_, **__: pytest.fail("it was sampled"))
    again = analyse_fit(fit, seed=1, target=QUICK, store=store, marginal=marginal)
    assert np.array_equal(again.chain.draws, first.chain.draws)
    assert np.array_equal(again.chain.log_density, first.chain.log_density)
    assert again.chain.convergence.message == first.chain.convergence.message
    assert (again.diagnosis.reasons, again.diagnosis.notes) == (
        first.diagnosis.reasons,
        first.diagnosis.notes,
    )
    assert str(again) == str(first)
    assert (again.certificate is None) == marginal
    for other in ({"seed": 2}, {"seed": 1, "target": replace(QUICK, ess=301.0)}):
        with pytest.raises(pytest.fail.Exception):
            analyse_fit(fit, **{"target": QUICK, **other}, store=store, marginal=marginal)


# commands

LINE = Formula("a + b*x", "a = {start = 1.0}\nb = {start = 1.0}", lambda x: 1.0 + 2.0 * x)


def in_a_process(*words: str) -> list[str]:
    return [sys.executable, "-m", "estim", *words]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_calibration_that_is_killed_ends_with_the_same_bytes(
    tmp_path: Path, project: Path
) -> None:
    choices = [
        str(Disk().write(tmp_path)),
        "--what",
        "coverage",
        "--simulations",
        "20",
        "--jobs",
        "1",
    ]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(project)}
    command = in_a_process("calibrate", *choices, "--out", str(tmp_path / "killed"))
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    place = tmp_path / "killed" / ".checkpoint"
    while len(list(place.glob("*.piece"))) < 3 and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    n_kept = len(list(place.glob("*.piece")))
    assert 3 <= n_kept < 20
    done = CliRunner().invoke(
        cli, ["calibrate", *choices, "--out", str(tmp_path / "killed"), "--resume"]
    )
    assert f"finished pieces: {n_kept}; those made from the same inputs are used" in done.output
    assert not place.exists()
    CliRunner().invoke(cli, ["calibrate", *choices, "--out", str(tmp_path / "whole")])
    for name in ("report.md", "calibration.json"):
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def fit(folder: Path, *options: str) -> tuple[int, str, str]:
    if not (folder / "campaign.toml").exists():
        LINE.write(folder)
    done = runner().invoke(
        cli, ["fit", str(folder / "campaign.toml"), "--out", str(folder / "out"), *options]
    )
    return (
        done.exit_code,
        done.stdout,
        str(done.exception) if isinstance(done.exception, EstimError) else done.stderr,
    )


@pytest.mark.parametrize("link", [".checkpoint", ".checkpoint/.lock", "figures"])
def test_a_link_below_the_folder_of_the_report_is_refused_before_anything_is_sampled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, link: str
) -> None:
    monkeypatch.setattr("estim.pipeline.analyse", lambda *_, **__: pytest.fail("it was sampled"))
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.tex").write_text("mine")
    place = tmp_path / "out" / link
    place.parent.mkdir(parents=True)
    place.symlink_to(precious / "thesis.tex" if link.endswith(".lock") else precious)
    _, out, err = fit(tmp_path)
    assert (out, err) == (
        "",
        f"{place}: is a symbolic link, and estim follows none here: remove it, or choose "
        "another folder",
    )
    assert {path.name: path.read_text() for path in precious.iterdir()} == {"thesis.tex": "mine"}
    assert place.is_symlink()


@pytest.mark.usefixtures("few_draws", "undrawn")
def test_a_folder_that_a_person_names_may_be_a_link(tmp_path: Path) -> None:
    """OUT on another disk, or /tmp where that is a link."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    assert fit(tmp_path)[0] == 0
    assert (tmp_path / "disk" / "report.md").exists()
    assert not (tmp_path / "disk" / ".checkpoint").exists()


def test_a_link_in_the_place_of_a_file_is_neither_followed_nor_replaced(tmp_path: Path) -> None:
    from estim.cli.terminal import write_files

    (tmp_path / "thesis.md").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.md").symlink_to(tmp_path / "thesis.md")
    with pytest.raises(EstimError, match="is a symbolic link"):
        write_files(tmp_path / "out", {"report.md": b"report"})
    assert (tmp_path / "thesis.md").read_text() == "mine"
    assert (tmp_path / "out" / "report.md").is_symlink()
    (tmp_path / "out" / "figures").symlink_to(tmp_path)
    for name in ("figures/x.png", "../x.png", "figures/../../x.png"):
        with pytest.raises(EstimError, match=r"is a symbolic link|leaves its folder"):
            write_files(tmp_path / "out", {name: b"x"})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "thesis.md"]


@pytest.mark.usefixtures("few_draws", "undrawn")
@pytest.mark.parametrize("content", ["", "my lock"])
def test_a_lock_of_others_is_not_taken_for_our_own(tmp_path: Path, content: str) -> None:
    lock = tmp_path / "out" / ".checkpoint" / ".lock"
    lock.parent.mkdir(parents=True)
    lock.write_text(content)
    code, _, err = fit(tmp_path)
    if content:
        assert err.startswith(f"{lock}: is in the way")
        assert lock.read_text() == content
    else:  # left behind by a kill
        assert code == 0
        assert not lock.exists()


@pytest.mark.parametrize("there", [False, True])
def test_a_refused_fit_leaves_no_folder_that_it_made(tmp_path: Path, there: bool) -> None:
    table, out = tmp_path / "exact.csv", tmp_path / "reports" / "exact"
    table.write_text("x,y\n1,2\n2,4\n3,6\n4,8\n")
    if there:
        out.mkdir(parents=True)
    done = runner().invoke(cli, ["fit", str(table), "--formula", "a*x + b", "--out", str(out)])
    assert "the curve meets every point" in str(done.exception)
    assert out.exists() == out.parent.exists() == there
