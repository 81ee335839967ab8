"""Files beside the data that have the name of a module: never imported, or named in one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from troubles import Formula

NAMES = (
    "model",
    "random",
    "numpy",
    "csv",
    "typing",
    "re",
    "click",
    "pickle",
    "json",
    "tempfile",
    "matplotlib",
    "scipy",
    "tqdm",
    "errors",
    "enum",
)
RUN = "open('imported', 'a').write(__name__ + ' ')\n"


def run(words: list[str], *path: Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path))}
    return subprocess.run(
        [sys.executable, *words],
        env=environment,
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


LINE = Formula("a + b*x", "a = {start = 1.0}\nb = {start = 1.0}", lambda x: 1.0 + 2.0 * x)


@pytest.mark.slow
def test_a_file_beside_the_data_is_not_imported(tmp_path: Path, project: Path) -> None:
    campaign = LINE.write(tmp_path)
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(RUN)
    (tmp_path / "emcee").mkdir()
    (tmp_path / "emcee" / "__init__.py").write_text(RUN)
    done = run(["-m", "estim", "fit", str(campaign), "--max-steps", "50"], project, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (3, "")
    assert "r: not-converged" in done.stdout
    assert not (tmp_path / "imported").exists()


@pytest.mark.slow
def test_the_folder_of_the_sources_is_kept(project: Path, replica: Path) -> None:
    done = run(["-m", "estim", "fit", str(replica / "campaign.toml"), "--run", "nope"], cwd=project)
    assert done.stderr.startswith(
        f"error: {replica / 'campaign.toml'}: '--run' must name one of the runs"
    )


@pytest.mark.slow
def test_a_model_that_the_path_insists_on_is_left_alone(
    tmp_path: Path, project: Path, replica: Path
) -> None:
    """estim has one name at top level: a file of any other name is the user's own."""
    (tmp_path / "model.py").write_text(RUN)
    words = ["-m", "estim", "line", str(replica / "campaign.toml"), "--figures", "none"]
    done = run(words, tmp_path, project, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "imported").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "text"),
    [
        pytest.param("random.py", "x = 1", marks=pytest.mark.statistics),
        pytest.param("numpy.py", "x = 1", marks=pytest.mark.statistics),
        ("numpy/__init__.py", "x = 1"),
        ("csv.py", "x = 1"),
        ("typing.py", "x = 1"),
        ("click.py", "print 'Python 2'"),
        ("emcee.py", "open('not there')"),
        ("types.py", "x = 1"),
    ],
)
def test_a_module_that_the_path_insists_on_is_named(
    tmp_path: Path, project: Path, file: str, text: str
) -> None:
    own = tmp_path / file
    own.parent.mkdir(exist_ok=True)
    own.write_text(text)
    start = (
        "import sys; sys.path[0] = sys.argv[1]; sys.argv[1:] = sys.argv[2:]; from "
        "estim.__main__ import main; main()"
    )
    words = ["-c", start, str(tmp_path), "fit", str(LINE.write(tmp_path)), "--max-steps", "50"]
    done = run(words, project, cwd=project)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {own}: is in the way: ")
    assert done.stderr.count("\n") == 1


def test_an_error_of_our_own_is_not_blamed_on_a_file(tmp_path: Path, project: Path) -> None:
    (tmp_path / "turtle.py").write_text("x = 1")  # there, but nobody imports it
    start = (
        "import estim.cli.commands as commands, estim.__main__\n\ndef broken(): raise "
        "ImportError('ours')\n\n"
    )
    start += "commands.main = broken\nestim.__main__.main()"
    done = run(["-c", start], project, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.endswith("ImportError: ours\n")


def test_a_script_beside_its_own_random_is_told(
    tmp_path: Path, project: Path, replica: Path
) -> None:
    (tmp_path / "random.py").write_text("def shake(): pass\n")
    (tmp_path / "script.py").write_text("import estim\nprint('line')\nestim.load_campaign\n")
    done = run(["script.py"], project, cwd=tmp_path)
    assert done.stdout == "line\n"
    assert done.stderr.splitlines()[-1].startswith(
        f"ImportError: {tmp_path / 'random.py'}: is in the way: "
    )


def test_a_script_uses_its_own_model_beside_estim(tmp_path: Path, project: Path) -> None:
    (tmp_path / "model.py").write_text("g = 9.81\n")
    (tmp_path / "script.py").write_text("import estim, model\nprint(estim.budget, model.g)\n")
    done = run(["script.py"], project, cwd=tmp_path)
    assert done.stderr == ""
    assert done.stdout.endswith(" 9.81\n")


@pytest.mark.parametrize(
    ("said", "threads"),
    [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3"), ({"OMP_NUM_THREADS": "2"}, None)],
)
def test_one_thread_of_linear_algebra_unless_said(
    monkeypatch: pytest.MonkeyPatch, said: dict[str, str], threads: str | None
) -> None:
    from estim.__main__ import main

    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "")  # restored afterwards
        monkeypatch.delenv(name)
    for name, value in said.items():
        monkeypatch.setenv(name, value)
    seen: list[str | None] = []
    monkeypatch.setattr(
        "estim.cli.commands.main", lambda: seen.append(os.environ.get("OPENBLAS_NUM_THREADS"))
    )
    main()
    assert seen == [threads]


def test_a_file_of_data_is_in_the_way_of_no_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from estim.shadowed_modules import namesake_behind

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("random.toml", f"{'a' * 300}.csv.toml", "csv"):
        assert namesake_behind(OSError(13, "Permission denied", name)) == ""
    assert namesake_behind(OSError(13, "Permission denied", "random.py")) == "random.py"
