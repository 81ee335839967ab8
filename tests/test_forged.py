"""Checkpoints that estim has not written: each is one line and exit code 2, and nothing is sampled, read through a link or removed."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import forged_checkpoints as forged
import pytest
from test_checkpoint import interrupted, sampled

from estim import pipeline
from estim.cli import commands as cli
from estim.common.errors import EstimError
from estim.sampling import stepping
from estim.sampling.checkpoint import Store, read_checkpoint

CURVE = """title = "x"
kind = "measured"
[curve]
expression = "a*x"
x = {column = "x"}
y = {column = "y"}
u_y = 0.1
[curve.parameters]
a = {start = 1.0}
[[runs]]
name = "one"
file = "one.csv"
"""


class SamplingStartedError(Exception):
    """A chain that should have been refused has made a step, or would have."""


@contextlib.contextmanager
def commanded(*words: str) -> Iterator[tuple[io.StringIO, io.StringIO]]:
    """What `estim WORDS` prints, with the sampling of a known density for an analysis: what comes before a chain is resumed is real."""

    def analyse(*_: object, store: Store, **__: object) -> None:
        sampled(store)

    def advance(*_: object) -> None:
        raise SamplingStartedError

    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(pipeline, "analyse", analyse), mock.patch.object(stepping.Walk, "advance", advance),
        mock.patch.object(sys, "argv", ["estim", *words]), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        yield out, err


def refusal(folder: Path, *, resume: bool) -> str:
    """Exit code and outputs of `estim fit` for OUT/.checkpoint/one = `folder`."""
    campaign = folder.parents[2] / "c.toml"
    words = ("fit", str(campaign), "--out", str(folder.parents[1]), *(["--resume"] if resume else []))
    with commanded(*words) as (out, err), pytest.raises(SystemExit) as ended:
        cli.main()
    return f"{ended.value.code} {out.getvalue()!r} {err.getvalue()!r}"


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a campaign and OUT/.checkpoint/one, a chain of two chunks."""
    folder = tmp_path_factory.mktemp("sound")
    (folder / "c.toml").write_text(CURVE)
    (folder / "one.csv").write_text("x,y\n1,1\n2,2\n3,3\n4,4\n")
    for _ in range(2):
        interrupted(folder / "out" / ".checkpoint" / "one", 40)
    return folder


def copied(sound: Path, tmp_path: Path) -> Path:
    return shutil.copytree(sound, tmp_path / "work") / "out" / ".checkpoint" / "one"


def entries(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Kind, size and identity of all below `folder`, links not followed."""
    found = [Path(above) / name for above, folders, files in os.walk(folder) for name in (*folders, *files)]
    return {str(path): (path.lstat().st_mode, path.lstat().st_size, path.lstat().st_ino) for path in found if path.name != ".lock"}


def check(said: str, folder: Path) -> None:
    """`said` is exit code 2 and one line that names the place."""
    assert said.startswith("2 '' "), said
    line = said.removeprefix("2 '' ")[1:-1]
    assert line.startswith(f"error: {folder}"), said
    assert line.count("\\n") == 1, said
    assert line.endswith("\\n"), said
    assert len(line) < 600, said


def test_there_are_more_than_a_hundred_and_all_differ() -> None:
    assert len(forged.CASES) > 250
    assert sum(map(forged.dangerous, forged.CASES)) == len(forged.DANGEROUS)


def test_sound_chain_is_resumed(sound: Path, tmp_path: Path) -> None:
    """What the refusals below are to be seen beside."""
    folder = copied(sound, tmp_path)
    kept = read_checkpoint(folder)
    assert kept is not None
    assert kept.n_step == 80
    for resume in (True, False):
        with pytest.raises(SamplingStartedError):
            refusal(folder, resume=resume)


@pytest.mark.parametrize("case", [case for case in forged.CASES if not forged.dangerous(case)])
def test_forged_checkpoint_is_one_line_and_exit_code_2(sound: Path, tmp_path: Path, case: str) -> None:
    folder = copied(sound, tmp_path)
    forged.CASES[case](folder)
    before = entries(tmp_path)
    for resume in forged.resumes(case):
        check(refusal(folder, resume=resume), folder)
    assert entries(tmp_path) == before
    read_checkpoint(folder)


def test_checkpoint_that_could_hang_or_crash_is_one_line_and_exit_code_2(sound: Path, tmp_path: Path) -> None:
    shutil.copytree(sound, tmp_path / "sound")
    words = [sys.executable, str(Path(forged.__file__)), str(tmp_path)]
    ran = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    answers = [json.loads(line) for line in ran.stdout.splitlines()]
    assert [case for case, *_ in answers] == [case for case in forged.CASES if forged.dangerous(case)], ran.stderr
    assert ran.returncode == 0
    for case, folder, said, untouched in answers:
        assert untouched, case
        assert len(said) == len(forged.resumes(case))
        for line in said:
            check(line, Path(folder))


# what is not estim's stays


@pytest.mark.parametrize("resume", [True, False])
def test_files_of_others_stay_where_a_chain_is_kept(sound: Path, tmp_path: Path, resume: bool) -> None:
    folder = copied(sound, tmp_path)
    for name in ("thesis.tex", "000000.npz", f"000000-{'0' * 63}.npz", f"x000000-{'0' * 64}.npz", ".key.json.swp", "key.json~"):
        (folder / name).write_text("years of work")
    (folder / "photos").mkdir()
    before = set(os.listdir(folder))
    store = Store(folder, resume=resume)
    sampled(store)
    store.remove()
    assert {name for name in before if not name.endswith(".npz") or len(name) != 75} - {"key.json"} == set(os.listdir(folder))


@pytest.mark.parametrize("link", [".checkpoint", ".checkpoint/one", ".checkpoint/.lock", "figures", "one/figures", "two"])
def test_link_below_the_folder_of_the_report_is_refused_before_anything_is_sampled(sound: Path, tmp_path: Path, link: str) -> None:
    folder = shutil.copytree(sound, tmp_path / "work")
    shutil.rmtree(folder / "out")
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "key.json").write_text("mine")
    two = link in ("one/figures", "two")
    if two:
        (folder / "c.toml").write_text(CURVE + '[[runs]]\nname = "two"\nfile = "one.csv"\n')
    place = folder / "out" / link
    place.parent.mkdir(parents=True)
    place.symlink_to(precious / "key.json" if link.endswith(".lock") else precious)
    with commanded("fit", str(folder / "c.toml"), "--out", str(folder / "out")) as (out, err), pytest.raises(SystemExit) as ended:
        cli.main()
    assert (ended.value.code, out.getvalue()) == (2, "")
    assert err.getvalue() == f"error: {place}: is a symbolic link, and estim follows none here: remove it, or choose another folder\n"
    assert {path.name: path.read_text() for path in precious.iterdir()} == {"key.json": "mine"}
    assert place.is_symlink()


def test_folder_that_a_person_names_may_be_a_link(sound: Path, tmp_path: Path) -> None:
    """OUT on another disk, or /tmp where that is a link."""
    (tmp_path / "link").symlink_to(shutil.copytree(sound, tmp_path / "work") / "out")
    with commanded("fit", str(tmp_path / "work" / "c.toml"), "--out", str(tmp_path / "link"), "--resume"), pytest.raises(SamplingStartedError):
        cli.main()


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


@pytest.mark.parametrize("content", ["", "my lock"])
def test_lock_of_others_is_not_taken_for_our_own(sound: Path, tmp_path: Path, content: str) -> None:
    folder = copied(sound, tmp_path)
    lock = folder.parent / ".lock"
    lock.write_text(content)
    if content:
        check(refusal(folder, resume=True), lock)
        assert lock.read_text() == content
    else:  # left behind by a kill
        with pytest.raises(SamplingStartedError):
            refusal(folder, resume=True)
        assert not lock.exists()
