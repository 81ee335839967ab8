"""Files beside the data that have the name of a module: never imported."""

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
