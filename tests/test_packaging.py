"""What is installed and what is handed on: the lock file, the wheel, the source archive."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

SYSTEMS = [
    {
        "python_version": python,
        "python_full_version": f"{python}.1",
        "sys_platform": system,
        "platform_python_implementation": "CPython",
    }
    for python in ("3.11", "3.12", "3.13")
    for system in ("linux", "darwin", "win32")
]


def versions(requirements: list[Requirement], system: dict[str, str]) -> dict[str, str]:
    """What one system gets: name -> version."""
    chosen = [r for r in requirements if r.marker is None or r.marker.evaluate(system)]
    assert len({canonicalize_name(r.name) for r in chosen}) == len(chosen)
    return {canonicalize_name(r.name): str(r.specifier).removeprefix("==") for r in chosen}


@pytest.fixture
def locked(project: Path) -> list[Requirement]:
    text = (project / "requirements.lock").read_text().replace("\\\n", "")
    return [Requirement(line.partition(" --hash=")[0].strip()) for line in text.splitlines()]


@pytest.fixture
def pinned(project: Path) -> list[Requirement]:
    return [
        Requirement(line)
        for line in (project / "constraints.txt").read_text().splitlines()
        if not line.startswith("#")
    ]


def test_the_lock_file_holds_names_versions_and_hashes_only(project: Path) -> None:
    n_hash = 0
    for line in (project / "requirements.lock").read_text().splitlines():
        is_hash = re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}( \\)?", line) is not None
        n_hash += is_hash
        assert is_hash or re.fullmatch(
            r"[a-z0-9-]+==[0-9a-z.]+( ; [a-z_]+ [<>=!]+ '[\w.]+')? \\", line
        ), line
    assert n_hash > 1000


@pytest.mark.parametrize(
    "system", SYSTEMS, ids=lambda s: f"{s['python_version']}-{s['sys_platform']}"
)
def test_the_lock_file_has_the_pinned_versions(
    locked: list[Requirement], pinned: list[Requirement], system: dict[str, str]
) -> None:
    assert versions(locked, system) == versions(pinned, system)


def test_the_lock_file_has_all_that_the_project_asks_for(
    project: Path, locked: list[Requirement]
) -> None:
    table = tomllib.loads((project / "pyproject.toml").read_text())
    extras = table["project"]["optional-dependencies"]
    # a cluster brings its own dask; WeasyPrint needs libraries of the system
    assert extras.keys() == {"arviz", "dask", "dev", "excel", "pdf", "test", "web"}
    asked = [
        *table["project"]["dependencies"],
        *(r for name, extra in extras.items() if name not in ("dask", "pdf") for r in extra),
    ]
    for system in SYSTEMS:
        found = versions(locked, system)
        for requirement in (
            Requirement(text) for text in [*asked, *table["build-system"]["requires"]]
        ):
            if requirement.name != "estim":
                assert requirement.specifier.contains(found[canonicalize_name(requirement.name)]), (
                    requirement
                )


def test_what_can_be_missing_is_installed_by_the_name_of_its_extra(project: Path) -> None:
    """A message that tells how names an extra that there is."""
    table = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {canonicalize_name(Requirement(r).name) for r in table["dependencies"]}
    sources = "".join(path.read_text() for path in (project / "estim").rglob("*.py"))
    told = re.findall(r"pip install (\"estim\[\w+\]\"|[\w-]+)", sources)
    extras = {f'"estim[{name}]"' for name in table["optional-dependencies"]}
    assert {'"estim[arviz]"', '"estim[dask]"', '"estim[pdf]"'} <= set(told) & extras
    assert set(told) - extras <= needed


def test_every_place_that_tells_the_version_tells_the_same(project: Path) -> None:
    package = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    said = {
        name: re.search(pattern, (project / name).read_text(encoding="utf-8"), flags=re.M)
        for name, pattern in {
            "CITATION.cff": r"^version: (\S+)$",
            "CHANGELOG.md": r"^## (\S+) \((?:\d{4}-\d\d-\d\d|not yet released)\)$",
            "release/recipe.yaml": r'^  version: "(\S+)"$',
        }.items()
    }
    assert {name: found and found[1] for name, found in said.items()} == dict.fromkeys(
        said, package["version"]
    )


def of_recipe(project: Path, part: str) -> dict[str, str]:
    """Name -> condition of a list in the recipe, by the names that pip knows."""
    recipe = (project / "release" / "recipe.yaml").read_text(encoding="utf-8")
    (listed,) = re.findall(rf"^  {part}:\n((?:    - .*\n)+)", recipe, flags=re.M)
    pairs = (line.removeprefix("    - ").partition(" ") for line in listed.splitlines())
    return {name.replace("matplotlib-base", "matplotlib"): what for name, _, what in pairs}


def test_the_recipe_asks_for_what_the_package_asks_for(project: Path) -> None:
    table = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    package, extras = table["project"], table["project"]["optional-dependencies"]

    def asked(texts: list[str]) -> dict[str, str]:
        return {r.name: str(r.specifier) for r in map(Requirement, texts)}

    oldest = '  python_min: "' + package["requires-python"].removeprefix(">=") + '"\n'
    assert oldest in (project / "release" / "recipe.yaml").read_text(encoding="utf-8")
    assert of_recipe(project, "run") == {"python": ">=${{ python_min }}"} | asked(
        package["dependencies"]
    )
    assert of_recipe(project, "host") == {"python": "${{ python_min }}.*", "pip": ""} | asked(
        table["build-system"]["requires"]
    )
    further = [r for name, extra in extras.items() if name not in ("test", "dev") for r in extra]
    assert of_recipe(project, "run_constraints") == asked(further)


def test_the_page_of_an_index_shows_what_the_readme_shows_and_links_to_no_file(
    project: Path,
) -> None:
    """An index has none of the project's files."""
    page = (project / "release" / "index-page.md").read_text(encoding="utf-8")
    readme = (project / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"\]\(|<img|src=|^\[", page, flags=re.M) == []
    first, code, printed = page.split("\n\n")[1], *re.findall(r"```\w+\n.*?\n```\n", page, re.S)
    assert all(part in readme for part in (first, code, printed))
    extras = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    named = re.findall(r"`(\w+)` (?:reads|speeds|hands|writes|spreads)|estim\[(\w+)\]", page)
    assert {one or other for one, other in named} == extras.keys() - {"test", "dev"}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the source archive."""
    if find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed: it comes with requirements.lock")
    out = tmp_path_factory.mktemp("dist")
    project = Path(__file__).parents[1]
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", str(out)],
        cwd=project,
        capture_output=True,
        check=True,
    )
    return out


def test_the_wheel_holds_the_package_with_its_types_and_nothing_else(
    built: Path, project: Path
) -> None:
    (wheel,) = built.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    sources = {
        path.relative_to(project).as_posix()
        for path in (project / "estim").rglob("*")
        if path.is_file()
    }
    assert {name for name in names if ".dist-info/" not in name} == {
        name for name in sources if "__pycache__" not in name
    }
    assert "estim/py.typed" in names
    (entry,) = (name for name in names if name.endswith("entry_points.txt"))
    assert "estim = estim.__main__:main" in zipfile.ZipFile(wheel).read(entry).decode()
    assert [name for name in names if name.endswith("licenses/LICENSE")]
    (head,) = (name for name in names if name.endswith(".dist-info/METADATA"))
    said = zipfile.ZipFile(wheel).read(head).decode()
    assert "\nLicense-Expression: MIT\n" in said
    assert said.endswith((project / "release" / "index-page.md").read_text(encoding="utf-8"))


def test_the_source_archive_holds_every_file_that_a_packager_needs_and_is_small(
    built: Path, project: Path
) -> None:
    """Not the committed reports, nor the outcomes of a study, which are half of the project."""
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        held = {name.partition("/")[2] for name in tar.getnames()}
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=project, capture_output=True, text=True, check=False
    )
    if listed.returncode != 0:
        pytest.skip("not a clone: nothing says which files belong to the project")
    files = set(filter(None, listed.stdout.split("\0")))
    left_out = {name for name in files - held if not name.startswith("reports/")}
    assert left_out == {"benchmarks/truth/outcomes.jsonl.gz"}
    assert not [name for name in held if name.startswith("reports")]
    assert archive.stat().st_size < 3e6
    assert not [
        name for name in held if name.startswith(("out/", ".venv")) or "__pycache__" in name
    ]
