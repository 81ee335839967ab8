"""The shape of the code, read from its imports: one direction, and one file for each
thing that is done in one place.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from dataclasses import fields
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from estim.common.statuses import Amount, Finding

PROJECT = Path(__file__).resolve().parents[1]
FILES = {
    ".".join(path.relative_to(PROJECT).with_suffix("").parts): path
    for path in sorted((PROJECT / "estim").rglob("*.py"))
}
MODEL = [m for m in FILES if m.startswith("estim.model.")]
HEAVY = {
    "emcee",
    "matplotlib",
    "arviz_stats",
    "corner",
    "jinja2",
    "tqdm",
    "scipy",
    "numpy",
    "uncertainties",
}


def imported(nodes):
    """Every module that the nodes of a tree import anywhere, as dotted names; from a import b gives
    a and a.b.
    """
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@cache
def trees():
    return {module: ast.parse(path.read_text()) for module, path in FILES.items()}


@cache
def nodes():
    return {module: tuple(ast.walk(tree)) for module, tree in trees().items()}


@cache
def imports():
    return {module: imported(found) for module, found in nodes().items()}


def packages(module):
    return {name.split(".")[0] for name in imports()[module]}


def importers(package):
    return {module for module in FILES if package in packages(module)}


@pytest.mark.slow
def test_the_code_is_found():
    assert {
        "estim.model.body",
        "estim.model.phase_curve",
        "estim.cli.commands",
        "estim.campaign.bodies",
        "estim.fitting.least_squares",
    } <= set(FILES)
    assert importers("numpy") > {"estim.model.phase_curve", "estim.problem.priors"}


def test_physics_needs_numpy_and_nothing_else():
    for module in (*MODEL, "estim.arrays"):
        others = {name for name in packages(module) if name != "estim"}
        assert others <= {"numpy", *sys.stdlib_module_names}, module


def test_the_command_line_alone_knows_click():
    assert all(module.startswith("estim.cli.") for module in importers("click"))


def test_inference_meets_physics_in_seven_files():
    found = {f"estim.campaign.{name}" for name in ("binding", "body_parts", "design", "quantities")}
    found |= {"estim.curves.regimes", "estim.curves.rolling", "estim.line.release_likelihood"}
    assert {m for m in FILES if "estim.model" in map(room, imports()[m])} - set(MODEL) == found


def test_one_file_knows_the_sampler():
    assert importers("emcee") == {"estim.sampling.ensembles"}


ARCHITECTURE = (PROJECT / "docs" / "architecture.md").read_text()
ORDER = [f"estim.{name}" for name in re.findall(r"^\| `(\w+)` \|", ARCHITECTURE, re.M)]
PAGES = [
    m.removesuffix(".__init__")
    for m in FILES
    if m.endswith(".__init__")
    and m.count(".") == 2
    and m.split(".")[1] not in ("model", "studies", "reports")
]
# they export and start; nothing imports them
FRONT = {"estim.__init__", "estim.__main__"}


def room(name):
    """The package of `estim` (or the file beside the packages) that a dotted name belongs to."""
    return ".".join(name.split(".")[:2])


def of_the_house(module):
    """The modules and pages of the project that a file imports from."""
    return {
        node.module
        for node in nodes()[module]
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "estim"
    }


def test_the_page_lists_every_package_in_order():
    assert len(ORDER) == len(set(ORDER))
    assert set(ORDER) == {room(m) for m in FILES} - FRONT


def test_every_import_goes_to_a_package_below():
    assert len(FILES) > 100
    for module in sorted(set(FILES) - FRONT):
        below = ORDER[: ORDER.index(room(module))]
        for name in of_the_house(module):
            assert room(name) == room(module) or room(name) in below, (
                f"{module} imports {name}, which is not below it"
            )
            # from another package through its page, so that the page says what others build on;
            # studies and reports have none: a command loads those files alone that it needs
            if room(name) in PAGES:
                assert room(name) in (name, room(module)), (
                    f"{module} imports {name}: import from {room(name)}"
                )


def test_the_check_of_the_order_sees_an_arrow_up():
    assert (
        ORDER.index("estim.checks")
        > ORDER.index("estim.problem")
        > ORDER.index("estim.common")
        > ORDER.index("estim.model")
        > ORDER.index("estim.arrays")
        == 0
    )


def test_no_circles_inside_a_package():
    graph = {
        m: {n for n in imports()[m] if n in FILES and room(n) == room(m)} - {m}
        for m in FILES
        if not m.endswith("__init__")
    }
    try:
        assert len(list(TopologicalSorter(graph).static_order())) >= len(graph)
    except CycleError as error:
        pytest.fail(f"circle: {' -> '.join(error.args[1])}")


def test_nobody_asks_which_kind_of_noise_it_is():
    kinds = {
        "Independent",
        "Differentiated",
        "Readings",
        "Correlated",
        "RobustErrors",
        "GaussianErrors",
        "LatentErrors",
        "Counts",
        "Events",
        "StudentT",
        "OutlierMixture",
    }
    for module in FILES:
        for node in nodes()[module]:
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in (
                "isinstance",
                "issubclass",
            ):
                assert not kinds & {
                    getattr(part, "id", getattr(part, "attr", ""))
                    for part in ast.walk(node.args[1])
                }, module


def test_a_page_offers_what_others_use():
    assert len(PAGES) > 10
    for page in PAGES:
        offered = {
            alias.name
            for node in nodes()[f"{page}.__init__"]
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        files = {m.rpartition(".")[2] for m in FILES if m.startswith(f"{page}.")}
        assert not offered & files, f"{page}: a name must not be that of a file"
        used = {
            name.rpartition(".")[2]
            for m in set(FILES) - FRONT
            if room(m) != page
            for name in imports()[m]
            if name.rpartition(".")[0] == page
        }
        assert offered == used, page


WRITING = {
    "print",
    "echo",
    "write_text",
    "write_bytes",
    "mkdir",
    "makedirs",
    "unlink",
    "rename",
    "touch",
    "rmdir",
    "mkstemp",
    "fdopen",
    "savetxt",
}
WRITING |= {"rmtree", "fsync"}


def outputs(nodes):
    """Lines on which the nodes of a tree print or write: calls by name, and `open` for anything but
    reading.
    """
    found = []
    for node in nodes:
        if not isinstance(node, ast.Call):
            if isinstance(node, ast.Attribute) and node.attr in ("stdout", "stderr"):
                found.append(node.lineno)
            continue
        method = isinstance(node.func, ast.Attribute)
        name = node.func.attr if method else getattr(node.func, "id", "")
        modes = [k.value for k in node.keywords if k.arg == "mode"] + (
            node.args[:1] if method else node.args[1:2]
        )
        opens = name == "open" and any(
            not isinstance(m, ast.Constant) or set(str(m.value)) & set("wax+") for m in modes
        )
        if name in WRITING or opens:
            found.append(node.lineno)
    return found


def test_the_check_for_output_sees_output():
    seen = (
        "print(1)\nopen('a', "
        "'w')\np.write_text('a')\nclick.echo('a')\nsys.stderr.write('a')\np.open(mode='wb')\n"
    )
    assert sorted(outputs(ast.walk(ast.parse(seen)))) == [1, 2, 3, 4, 5, 6]
    assert outputs(ast.walk(ast.parse("open('a')\np.read_text()\nopen('a', 'rb')\n"))) == []


def test_one_place_prints_and_one_file_writes():
    printing = {
        "estim.__main__",
        "estim.cli.output_streams",
        "estim.cli.terminal",
        "estim.common.storage",
    }
    assert {module for module, found in nodes().items() if outputs(found)} == printing
    # `terminal.say` escapes
    assert not any(
        getattr(node, "attr", "") == "echo" for module in FILES for node in nodes()[module]
    )
    storage = {
        f"estim.common.{node.name}"
        for node in trees()["estim.common.storage"].body
        if isinstance(node, ast.FunctionDef)
    }
    storage -= {"estim.common.note_input", "estim.common.inputs_read"}  # which keep no file
    keeping = {
        "estim.batch.rows",
        "estim.cli.origin_record",
        "estim.cli.terminal",
        "estim.cli.verifying",
        "estim.cli.batching",
    }
    # what was handed in to the page and what is shown of it; its lock
    keeping |= {"estim.web.preview", "estim.web.serving", "estim.web.store"}
    # a report asked for in Python has no command line to write it
    keeping |= {"estim.reports.curve"}
    assert {m for m in FILES if storage & imports()[m] and room(m) != "estim.common"} == keeping
    # between processes only, never from a file
    assert importers("pickle") | importers("shelve") <= {"estim.common.jobs"}
    assert importers("h5py") <= {"estim.reports.interop"}


RECORDS = {"Finding", "Amount"}


def free_texts(nodes):
    """Lines on which the nodes of a tree give a finding a sentence, or make one on the spot."""
    calls = [n for n in nodes if isinstance(n, ast.Call) and getattr(n.func, "id", "") in RECORDS]
    given = [
        (n.lineno, value) for n in calls for value in (*n.args, *(k.value for k in n.keywords))
    ]

    def text(node):
        return isinstance(node, ast.JoinedStr) or (
            isinstance(node, ast.Constant) and " " in str(node.value)
        )

    return sorted({line for line, value in given if any(map(text, ast.walk(value)))})


def test_a_finding_holds_facts_and_no_sentence():
    assert free_texts(
        ast.walk(
            ast.parse(
                "Finding(kind, test=f'p = {p}')\nAmount('a b')\nFinding(kind, test='chi2', "
                "size=1.0)"
            )
        )
    ) == [1, 2]
    assert [m for m, found in nodes().items() if free_texts(found)] == []
    texts = {
        field.name
        for record in (Finding, Amount)
        for field in fields(record)
        if "str" in str(field.type)
    }
    # names of runs, tests, arguments, parameters and numbers
    assert texts == {"run", "test", "names", "name", "numbers"}


PROSE = {
    "reason",
    "reasons",
    "advice",
    "note",
    "notes",
    "message",
    "sentence",
    "sentences",
    "warning",
    "warnings",
    "fact",
    "facts",
    "words",
}
SEARCHES = {
    "startswith",
    "endswith",
    "partition",
    "rpartition",
    "split",
    "removeprefix",
    "removesuffix",
    "find",
    "index",
    "replace",
    "count",
}
SEARCHES |= {"match", "search", "fullmatch", "findall", "sub"}
OF_OTHERS = {  # words that are not estim's, or that stand in a file
    "estim.campaign.campaign_file",  # messages of msgspec
    "estim.campaign.type_mismatch",
    "estim.reading.toml",  # messages of tomllib
    # the head of a CSV file that `estim import` made, of any version
    "estim.reading.tracker.importing",
    "estim.reading.tracker.plausibility",
}
# names of choices put into advice, and of fields of the page for those of options
FILLING = {"estim.words.sentences", "estim.web.labels"}


def is_prose(node):
    return getattr(node, "attr", getattr(node, "id", "")) in PROSE or (
        isinstance(node, ast.Call)
        and getattr(node.func, "id", "") == "str"
        and getattr(node.args[0], "id", "") == "error"
    )


def readings(nodes):
    """Lines on which the nodes of a tree look into a sentence: compare it, or search or cut it."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Compare):
            for op, a, b in zip(
                node.ops, (node.left, *node.comparators), node.comparators, strict=False
            ):
                if not isinstance(op, ast.Is | ast.IsNot) and (
                    is_prose(b) or (is_prose(a) and isinstance(op, ast.Eq | ast.NotEq))
                ):
                    found.append(node.lineno)
        elif (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in SEARCHES
        ):
            asked = node.args if getattr(node.func.value, "id", "") == "re" else [node.func.value]
            if any(is_prose(part) for part in asked):
                found.append(node.lineno)
    return found


def test_no_sentence_is_read_back():
    seen = (
        "'a' in run.reason\nfit.message == 'b'\nreason.startswith('c')\nre.match('d', "
        "fact)\nstr(error).partition(' at ')\n"
    )
    assert readings(ast.walk(ast.parse(seen))) == [1, 2, 3, 4, 5]
    assert (
        readings(
            ast.walk(
                ast.parse(
                    "'a' in names\nstatus == 'ok'\nname.partition('[')\nfinding.kind is "
                    "Kind.WAY_BACK\n"
                )
            )
        )
        == []
    )
    assert {m for m in FILES if readings(nodes()[m])} == OF_OTHERS | FILLING


def test_one_place_knows_to_which_status_a_finding_leads():
    assert {m for m in FILES if "estim.common.finding_kinds.LEADS_TO" in imports()[m]} == {
        "estim.common.statuses"
    }


def test_the_command_line_starts_without_the_heavy_packages():
    code = f"import sys, estim.cli.commands; print(*sorted({HEAVY!r} & set(sys.modules)))"
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT
    )
    assert ran.stdout.split() == []


SLOW = {
    "scipy.stats",
    "scipy.optimize",
    "matplotlib",
    "emcee",
    "arviz_stats",
    "pandas",
    "xarray",
    "corner",
    "jinja2",
    "h5py",
}
COMMAND = (
    "import sys; sys.argv = ['estim', *{words}]\nfrom estim.__main__ import main\ntry: "
    "main()\nexcept SystemExit as ended: print(ended.code)"
)
REFUSED = COMMAND.format(words=["fit", "data/replica/campaign.toml", "--run", "nope"])


@pytest.mark.parametrize(
    ("code", "said", "without"),
    [
        *((COMMAND.format(words=[word]), "0", HEAVY | SLOW) for word in ("--help", "--version")),
        (
            "import estim; print(estim.fit_line is estim.fit_curve, dir(estim) == estim.__all__)",
            "False True",
            SLOW,
        ),
        (REFUSED, "2", SLOW),
        (
            "import estim; print(estim.propagate_linear(lambda q: 2.0 * q['a'], "
            "[estim.Input('a', 1.0, 0.1, dof=5)]).value)",
            "2.0",
            SLOW,
        ),
        (
            "import estim; print(estim.fit_line([0.0, 1.0, 2.0], [1.0, 3.0, 5.0], u_y=0.1).dof)",
            "1",
            SLOW - {"scipy.optimize"},
        ),
    ],
)
def test_what_is_slow_to_import_waits_until_it_is_used(code, said, without):
    """In a process of its own: a refusal, a straight line or a budget must not wait for what fits
    and draws.
    """
    code += f"\nimport sys; print(*sorted({without!r} & set(sys.modules)), sep=',')"
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT
    )
    assert ran.stdout.splitlines()[-2:] == [said, ""]


def test_importing_the_package_loads_none_of_its_stages():
    code = "import sys, estim; print(*sorted(m for m in sys.modules if m.startswith('estim.')))"
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT
    )
    assert ran.stdout.split() == []


def test_physics_loads_nothing_of_inference():
    code = (
        "import sys, estim.model; print(*sorted(m for m in sys.modules if m.startswith('scipy') "
        "or m.startswith('estim.') and not m.startswith('estim.model')))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT
    )
    assert ran.stdout.split() == ["estim.arrays"]


NAMES = "import sys, estim.model\nfor name in sys.argv[1:]: __import__(name)\n"
NAMES += (
    "for package in (estim, estim.model):\n for name in package.__all__: print(package.__name__, "
    "name, type(getattr(package, name)).__name__)"
)


@pytest.mark.slow
def test_public_names_are_the_same_in_a_fresh_process_and_after_every_import():
    modules = [
        module.removesuffix(".__init__")
        for module in sorted(FILES)
        if not module.endswith("__main__")
    ]
    fresh, after = (
        subprocess.run(
            [sys.executable, "-c", NAMES, *first],
            capture_output=True,
            text=True,
            check=True,
            cwd=PROJECT,
        ).stdout
        for first in ([], modules)
    )
    assert after == fresh
    assert "module" not in fresh.split()
    assert {
        "estim budget function",
        "estim line_posterior function",
        "estim.model Body type",
    } <= set(fresh.splitlines())


@pytest.mark.parametrize("package", ["estim", "estim.model"])
def test_no_public_name_is_that_of_a_file_or_folder(package):
    inside = {
        module.removeprefix(f"{package}.").split(".")[0]
        for module in FILES
        if module.startswith(f"{package}.")
    }
    facade = import_module(package)
    assert not inside & set(facade.__all__)
    assert list(facade.__all__) == list(dict.fromkeys(facade.__all__))
    assert dir(facade) == sorted(facade.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = facade.nothing


def test_every_file_opens_by_saying_what_it_is_for():
    assert [module for module, tree in trees().items() if not ast.get_docstring(tree)] == []


def test_no_file_swallows_every_error():
    for module, found in nodes().items():
        bare = [
            node.lineno
            for node in found
            if isinstance(node, ast.ExceptHandler) and node.type is None
        ]
        assert not bare, module


@pytest.mark.parametrize("folder", ["benchmarks", "docs"])
def test_what_a_script_imports_of_the_project_is_there(folder: str) -> None:
    """A benchmark runs seldom: what it imports may have moved long before."""
    missing = []
    for path in sorted((Path(__file__).parents[1] / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or node.level:
                continue
            if (node.module or "").partition(".")[0] == "estim":
                home = import_module(str(node.module))
                for alias in node.names:
                    file = f"{node.module}.{alias.name}"
                    if not hasattr(home, alias.name) and find_spec(file) is None:
                        missing.append(f"{path.name}: {file}")
    assert not missing
