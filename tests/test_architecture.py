"""The shape of the code, read from its imports: two packages, one direction, and one file for each thing that is done in one place."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
FILES = {
    f"{package}.{path.relative_to(PROJECT / package).with_suffix('').as_posix().replace('/', '.')}": path
    for package in ("model", "estim")
    for path in sorted((PROJECT / package).rglob("*.py"))
}
TREES = {module: ast.parse(path.read_text()) for module, path in FILES.items()}
MODEL = [m for m in FILES if m.startswith("model.")]
ESTIM = [m for m in FILES if m.startswith("estim.")]
HEAVY = {"lmfit", "emcee", "matplotlib", "arviz_stats", "corner", "jinja2", "tqdm", "scipy", "numpy", "uncertainties"}


def imported(tree):
    """Every module that a tree imports anywhere, as dotted names; from a import b gives a and a.b."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


IMPORTS = {module: imported(tree) for module, tree in TREES.items()}


def packages(module):
    return {name.split(".")[0] for name in IMPORTS[module]}


def importers(package):
    return {module for module in FILES if package in packages(module)}


def test_the_code_is_found():
    assert {"model.body", "model.phase", "model.motion", "estim.cli", "estim.campaign", "estim.fitting", "estim.sampling"} <= set(FILES)
    assert importers("numpy") > {"model.phase", "estim.priors"}


@pytest.mark.parametrize("module", MODEL)
def test_physics_needs_numpy_and_nothing_else(module):
    assert packages(module) <= {"model", "numpy", *sys.stdlib_module_names}


def test_the_command_line_alone_knows_click():
    assert importers("click") == {"estim.cli", "estim.terminal"}


def test_inference_meets_physics_in_three_files():
    assert {m for m in importers("model") if m in ESTIM} == {"estim.campaign", "estim.design", "estim.phase_curve"}


@pytest.mark.parametrize(("package", "module"), [("lmfit", "estim.fitting"), ("emcee", "estim.sampling")])
def test_one_file_knows_each_engine(package, module):
    assert importers(package) == {module}


@pytest.mark.parametrize("package", ["model", "estim"])
def test_modules_import_in_one_direction(package):
    facade = {f"{package}.__init__", f"{package}.__main__"}
    graph = {m: {n for n in IMPORTS[m] if n in FILES} - {m} for m in FILES if m.startswith(package) and m not in facade}
    try:
        order = list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"circle: {' -> '.join(error.args[1])}")
    assert len(order) >= len(graph)
    # a file imports modules, never the facade that imports everything
    for module in graph:
        assert package not in {name for name in IMPORTS[module] if not any(f.startswith(f"{name}.") and f in IMPORTS[module] for f in FILES)}, module


def test_nothing_builds_on_the_command_line():
    for module in ESTIM:
        if module not in ("estim.cli", "estim.__init__", "estim.__main__"):
            assert "estim.cli" not in IMPORTS[module], module


WRITING = {"print", "echo", "write_text", "write_bytes", "mkdir", "makedirs", "unlink", "rename", "touch", "rmdir", "mkstemp", "fdopen", "savetxt"}
WRITING |= {"rmtree", "fsync"}


def outputs(tree):
    """Lines on which a tree prints or writes: calls by name, and `open` for anything but reading."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            if isinstance(node, ast.Attribute) and node.attr in ("stdout", "stderr"):
                found.append(node.lineno)
            continue
        method = isinstance(node.func, ast.Attribute)
        name = node.func.attr if method else getattr(node.func, "id", "")
        modes = [k.value for k in node.keywords if k.arg == "mode"] + (node.args[:1] if method else node.args[1:2])
        opens = name == "open" and any(not isinstance(m, ast.Constant) or set(str(m.value)) & set("wax+") for m in modes)
        if name in WRITING or opens:
            found.append(node.lineno)
    return found


def test_the_check_for_output_sees_output():
    seen = "print(1)\nopen('a', 'w')\np.write_text('a')\nclick.echo('a')\nsys.stderr.write('a')\np.open(mode='wb')\n"
    assert sorted(outputs(ast.parse(seen))) == [1, 2, 3, 4, 5, 6]
    assert outputs(ast.parse("open('a')\np.read_text()\nopen('a', 'rb')\n")) == []


def test_only_the_command_line_prints_and_one_file_writes():
    assert {module for module, tree in TREES.items() if outputs(tree)} == {"estim.cli", "estim.terminal", "estim.storage"}
    assert {module for module in ESTIM if "estim.storage" in IMPORTS[module]} == {"estim.terminal", "estim.checkpoint"}
    assert importers("pickle") | importers("shelve") <= {"estim.jobs"}  # between processes only, never from a file
    assert importers("h5py") <= {"estim.interop"}  # a checkpoint that a reader holds open would stop its writer


def test_the_command_line_starts_without_the_heavy_packages():
    code = f"import sys, estim.cli; print(*sorted({HEAVY!r} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT)
    assert ran.stdout.split() == []


def test_importing_the_package_loads_none_of_its_stages():
    code = "import sys, estim; print(*sorted(m for m in sys.modules if m.startswith('estim.')))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT)
    assert ran.stdout.split() == []


def test_physics_works_where_inference_is_not_installed():
    code = "import sys; sys.modules['estim'] = None; import model; print(*sorted({'scipy', 'estim.errors', 'uncertainties'} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT)
    assert ran.stdout.split() == []


def test_every_exported_name_exists():
    import estim
    import model

    for package in (estim, model):
        assert sorted(package.__all__) == list(dict.fromkeys(sorted(package.__all__)))
        for name in package.__all__:
            assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = estim.nothing


@pytest.mark.parametrize("module", FILES)
def test_files_stay_short(module):
    assert len(FILES[module].read_text().splitlines()) < 350


@pytest.mark.parametrize("module", FILES)
def test_every_file_opens_by_saying_what_it_is_for(module):
    assert ast.get_docstring(TREES[module])


def test_no_file_swallows_every_error():
    for module, tree in TREES.items():
        bare = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) and node.type is None]
        assert not bare, module
