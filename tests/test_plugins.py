"""What installed packages add: models by name, readers of files, laws of the errors and sections of
reports, and what is refused.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np
import pytest
from command_runner import runner
from scipy import stats
from scipy.optimize import curve_fit, minimize

from estim import (
    InputError,
    Target,
    analysis_report,
    fit_curve,
    load_campaign,
    read_table,
    sample_curve,
)
from estim.cli.commands import cli
from estim.common import inputs_read
from estim.fitting import fit_problem
from estim.plugins import plugins
from estim.reports.curve import _table_of as table_of
from estim.reports.result import CurveSubject
from estim.versions import engine_versions

EXAMPLE = Path(__file__).parents[1] / "docs" / "extending"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which pip installed the package of docs/extending."""
    if find_spec("hatchling") is None or find_spec("pip") is None:
        pytest.skip("pip and hatchling are not installed: they come with requirements.lock")
    out = tmp_path_factory.mktemp("installed")
    source = tmp_path_factory.mktemp("source") / "estim-resonance"
    copytree(EXAMPLE, source, ignore=ignore_patterns("__pycache__"))
    plain = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *plain, "--target", str(out), str(source)],
        check=True,
        capture_output=True,
    )
    return out


def estim(*arguments: str | Path, path: Path | None = None, cwd: Path | None = None):
    """A command, with the packages that are installed in `path`."""
    places = filter(None, [str(path or ""), os.environ.get("PYTHONPATH"), str(EXAMPLE.parents[1])])
    return subprocess.run(
        [sys.executable, "-m", "estim", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
    )


SWEPT = ("fit", "example.sweep", "--formula", "fano", "--kind", "synthetic", "--figures", "none")
SWEPT = (*SWEPT, "--section", "quality")


@pytest.fixture(scope="module")
def reported(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a sweep with its report in `out`, and what the command said."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "example.sweep").write_bytes((EXAMPLE / "example.sweep").read_bytes())
    done = estim(*SWEPT, "--out", "out", path=installed, cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder, done.stdout


# the example


def fano(x, height, center, width, q):
    e = (x - center) / (width / 2.0)
    return height * (q + e) ** 2 / (1.0 + e**2)


def test_the_page_shows_the_package_as_it_is() -> None:
    page = (EXAMPLE.parent / "extending.md").read_text(encoding="utf-8")
    for language, name in (("toml", "pyproject.toml"), ("python", "estim_resonance.py")):
        (shown,) = re.findall(rf"```{language}\n(.*?)```", page, flags=re.S)
        assert shown == (EXAMPLE / name).read_text(encoding="utf-8")


@pytest.mark.slow
def test_an_installed_model_and_reader_fit_as_scipy_does(reported: tuple[Path, str]) -> None:
    out, said = reported[0] / "out", reported[1]
    page = (EXAMPLE.parent / "extending.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"--kind synthetic\n(.*?)\.\.\.\n", page, flags=re.S)
    assert said.startswith(shown)
    rows = (EXAMPLE / "example.sweep").read_text().partition("[points]\n")[2].splitlines()
    x, y, u = np.array([[float(cell) for cell in row.split("|")[:3]] for row in rows]).T
    values, cov = curve_fit(fano, x, y, [2.0, 1000.0, 5.0, 1.0], u, absolute_sigma=True)
    record = json.loads((out / "result.json").read_text())
    names = ("height", "center", "width", "q")
    for name, value, sd in zip(names, values, np.sqrt(np.diag(cov)), strict=True):
        assert record["fit"]["values"][name] == pytest.approx(value, abs=1e-3 * sd)
        assert record["fit"]["sds"][name] == pytest.approx(sd, rel=1e-3)
    report = (out / "report.md").read_text(encoding="utf-8")
    quality = values[1] / values[2]
    (told, u) = re.findall(
        r"\n## quality\n\nWritten by the package estim-resonance 1\.0\.\n\n"
        r"The quality factor center/width is ([\d.]+)\s±\s([\d.]+)\.\n",
        report,
    )[0]
    assert float(told) == pytest.approx(quality, abs=0.1)
    assert float(u) == pytest.approx(quality * np.sqrt(cov[2, 2]) / values[2], abs=0.1)
    assert "read by the package estim-resonance 1.0" in report
    assert re.search(r"\| versions \| .*estim-resonance 1\.0", report)
    assert record["provenance"]["versions"]["estim-resonance"] == "1.0"
    origin = json.loads((out / "origin.json").read_text())
    assert origin["versions"]["estim-resonance"] == "1.0"


@pytest.mark.slow
def test_an_installed_law_of_the_errors_is_maximised_and_verified(
    installed: Path, tmp_path: Path
) -> None:
    (tmp_path / "example.sweep").write_bytes((EXAMPLE / "example.sweep").read_bytes())
    done = estim(*SWEPT, "--robust", "logistic", "--out", "o", path=installed, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    rows = (EXAMPLE / "example.sweep").read_text().partition("[points]\n")[2].splitlines()
    x, y, u = np.array([[float(cell) for cell in row.split("|")[:3]] for row in rows]).T

    def cost(values: np.ndarray) -> float:
        z = (y - fano(x, *values)) / u * np.pi / np.sqrt(3.0)
        return float(2.0 * np.sum(np.log(np.cosh(0.5 * z))))

    record = json.loads((tmp_path / "o" / "result.json").read_text())
    names = ("height", "center", "width", "q")
    found, sds = ([record["fit"][key][name] for name in names] for key in ("values", "sds"))
    scaled = minimize(lambda t: cost(found + t * np.array(sds)), np.full(4, 0.3), tol=1e-10)
    assert scaled.x == pytest.approx(np.zeros(4), abs=2e-3)
    report = (tmp_path / "o" / "report.md").read_text(encoding="utf-8")
    assert "errors distributed as 'logistic'" in report
    assert re.search(r"\| versions \| .*estim-resonance 1\.0", report)
    again = estim("verify", "o", path=installed, cwd=tmp_path)
    assert again.returncode == 0, again.stdout


@pytest.mark.slow
def test_models_are_listed_with_their_packages(installed: Path) -> None:
    alone, with_it = estim("models"), estim("models", path=installed)
    assert alone.returncode == with_it.returncode == 0
    assert "line: slope*x + intercept\n" in alone.stdout
    assert "fano" not in alone.stdout
    assert with_it.stdout.startswith(alone.stdout)
    model, reader, law, section = with_it.stdout.removeprefix(alone.stdout).splitlines()
    assert model.startswith("fano: height*(q + ")
    assert model.endswith("  (estim-resonance 1.0)")
    assert reader == "*.sweep  (estim-resonance 1.0)"
    assert law == "law of the errors logistic  (estim-resonance 1.0)"
    assert section == "section quality  (estim-resonance 1.0)"


@pytest.mark.slow
def test_without_the_package_the_name_and_the_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y\n" + "".join(f"{n},{n * n % 7}\n" for n in range(9)))
    named = estim("fit", tmp_path / "a.csv", "--formula", "fano", "--out", tmp_path / "out")
    assert named.returncode == 2
    assert "must name a model" in named.stderr
    read = estim("fit", EXAMPLE / "example.sweep", "--formula", "a*x", "--out", tmp_path / "out")
    assert read.returncode == 2
    assert "example.sweep:4: 'header' has no line of column names" in read.stderr


@pytest.mark.slow
def test_a_report_with_a_plugin_is_verified(installed: Path, reported: tuple[Path, str]) -> None:
    again = estim("verify", "out", path=installed, cwd=reported[0])
    assert (again.returncode, "note" in again.stdout) == (0, False), again.stdout
    (other,) = installed.glob("*.dist-info/METADATA")
    text = other.read_text()
    other.write_text(text.replace("Version: 1.0", "Version: 1.1"))
    try:
        later = estim("verify", "out", path=installed, cwd=reported[0])
    finally:
        other.write_text(text)
    assert "made with estim-resonance 1.0, recomputed with 1.1" in later.stdout


def test_help_and_import_look_at_no_package(installed: Path) -> None:
    code = """
import sys, estim
{}
print(*sorted({{"importlib.metadata", "estim_resonance", "estim.plugins"}} & set(sys.modules)))
"""
    asked = "from click.testing import CliRunner; from estim.cli.commands import cli"
    asked += "\nassert 'Usage' in CliRunner().invoke(cli, ['--help']).output"
    for more, loaded in (("", ""), (asked, ""), ("estim.fit_curve", "estim.plugins")):
        done = subprocess.run(
            [sys.executable, "-c", code.format(more)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": f"{EXAMPLE.parents[1]}{os.pathsep}{installed}"},
        )
        assert "estim_resonance" not in done.stdout
        assert done.stdout.split()[:1] in ([], [loaded], ["estim.plugins"])


# packages as they may be, each a module beside its metadata


Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Puts a package with one module and these entry points on the path."""
    made: list[str] = []
    site = tmp_path / "site"
    monkeypatch.syspath_prepend(str(site))

    def install(package: str, code: str, *, version: str = "0.3", to: Path = site, **points: str):
        module = package.replace("-", "_")
        made.append(module)
        folder = to / f"{module}-{version}.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n"
        )
        (folder / "entry_points.txt").write_text(
            "".join(
                f"[estim.{group}]\n" + "".join(f"{name} = {module}:IT\n" for name in names.split())
                for group, names in points.items()
            )
        )
        (to / f"{module}.py").write_text(code)
        plugins.cache_clear()
        return site

    with inputs_read():  # what is used here counts here alone
        yield install
    plugins.cache_clear()
    for module in made:
        sys.modules.pop(module, None)


def model(name: str, expression: str = "p*exp(-(x/tau)**beta)", limits: str = "{}") -> str:
    names = tuple(dict.fromkeys(re.findall(r"\b(?!exp|x\b)[a-z]+\b", expression)))
    return f"from estim import Model\nIT = Model({name!r}, {expression!r}, {names!r}, {limits})\n"


STRETCHED = model("stretched", limits='{"tau": (0, None), "beta": (0, None)}')


def test_a_model_stands_in_sums_with_prefixes(install: Install, rng: np.random.Generator) -> None:
    install("estim-glass", STRETCHED, models="stretched")
    x = np.linspace(0.1, 12.0, 120)
    truth = 5.0 * np.exp(-((x / 2.0) ** 0.7)) + 1.0
    y = truth + 0.01 * rng.standard_normal(x.size)
    with inputs_read():
        fit = fit_curve("slow_stretched + constant", x, y, u_y=0.01)
        assert fit.status == "ok"
        assert engine_versions()["estim-glass"] == "0.3"
    assert "estim-glass" not in engine_versions()  # the block is over
    expected = {"slow_p": 5.0, "slow_tau": 2.0, "slow_beta": 0.7, "c": 1.0}
    assert fit.values.keys() == expected.keys()
    for name, value in expected.items():
        assert abs(fit.values[name] - value) < 4.0 * fit.sds[name]
    wrong = fit_curve("exponential + constant", x, y, u_y=0.01)
    assert wrong.status == "poor-fit"


X = np.linspace(0.0, 5.0, 20)
BROKEN = {
    "import no_such_package": "ModuleNotFoundError: No module named 'no_such_package'",
    "raise SystemExit(3)": "SystemExit: 3",
    "1/0": "ZeroDivisionError: division by zero",
    "syntax error": "SyntaxError: ",
    "": "AttributeError: module 'estim_bad' has no attribute 'IT'",
    "IT = {}": "AttributeError: 'dict' object has no attribute 'expression'",
    model("other"): "ValueError: it must have this name, and the parameters of its formula",
    model("bad", "p*import(x)"): "'expression' ",
    model("bad", limits='{"sigma": (0, 1)}'): "ValueError: it must have this name, and the para",
    model("bad").replace(", 'beta'", ""): "ValueError: it must have this name, and the parameters",
}


@pytest.mark.slow
@pytest.mark.parametrize("code", BROKEN)
def test_a_broken_package_is_one_line_and_stops_nothing_else(
    install: Install, tmp_path: Path, code: str
) -> None:
    site = install("estim-bad", code, models="bad")
    install("estim-glass", STRETCHED, models="stretched")
    with pytest.raises(InputError) as caught:
        fit_curve("bad + line", X, X, u_y=0.1)
    said = str(caught.value)
    start = (
        "'bad' of the package estim-bad 0.3 (entry point estim.models: bad = estim_bad:IT) does "
        "not work ("
    )
    assert said.startswith(start)
    assert BROKEN[code] in said
    assert "\n" not in said
    assert fit_curve("line", X, 2.0 * X, u_y=0.1).status == "ok"
    with pytest.raises(InputError, match=r"there are constant, .*, bad, stretched, with a prefix"):
        fit_curve("nothing_of_the_kind", X, X)
    if code.startswith("import"):  # the same by commands
        listed = estim("models", path=site)
        assert listed.returncode == 0
        assert listed.stderr == f"warning: {start}{BROKEN[code]})\n"
        assert "stretched: p*exp(" in listed.stdout
        (tmp_path / "a.csv").write_text("x,y\n" + "".join(f"{n},{n * n % 7}\n" for n in range(9)))
        fit = estim("fit", tmp_path / "a.csv", "--formula", "bad", "--out", "o", path=site)
        assert (fit.returncode, fit.stderr) == (2, f"error: {start}{BROKEN[code]})\n")


CAMPAIGN = """title = "x"
kind = "synthetic"
[curve]
model = "bad"
x = "x"
y = "y"
[[runs]]
name = "r"
file = "r.csv"
"""


def test_a_campaign_names_the_line_of_a_model_that_does_not_work(
    install: Install, tmp_path: Path
) -> None:
    install("estim-bad", "raise OSError('no licence')", models="bad")
    (tmp_path / "c.toml").write_text(CAMPAIGN)
    (tmp_path / "r.csv").write_text("x,y\n1,2\n2,3\n3,5\n4,4\n5,7\n")
    with pytest.raises(
        InputError, match=r"c\.toml:4: 'model' of .* estim-bad 0\.3 \(.*: bad = .*no licence\)$"
    ):
        load_campaign(tmp_path / "c.toml")


@pytest.mark.parametrize("name", ["gaussian", "skew_gaussian"])
def test_a_name_of_estims_own_is_refused(install: Install, name: str) -> None:
    install("estim-mine", model(name), models=name)
    rule = rf"'{name}' of the package estim-mine 0\.3 \(.*\) is refused: 'gaussian' is a model"
    with pytest.raises(InputError, match=rule):
        fit_curve(f"{name} + line", X, X)
    y = 1.0 / ((X - 2.0) ** 2 + 1.0)
    assert fit_curve("left_lorentzian", X, y, u_y=0.01).status == "ok"


@pytest.mark.parametrize("name", ["x", "sin", "pi", "two-words"])
def test_a_name_that_no_formula_can_have_is_refused(install: Install, name: str) -> None:
    install("estim-mine", model(name), models=name)
    warned = runner().invoke(cli, ["models"])
    assert warned.exit_code == 0
    assert re.fullmatch(
        rf"warning: '{name}' of the package estim-mine 0\.3 .*'name' .*\n", warned.stderr
    )


def test_a_name_of_two_packages_is_refused(install: Install) -> None:
    install("estim-glass", STRETCHED, models="stretched")
    install("estim-other", STRETCHED, version="2", models="stretched")
    rule = r"'stretched' is offered by several .* \(estim-glass 0\.3, estim-other 2\)"
    with pytest.raises(InputError, match=rule):
        fit_curve("stretched", X, X)


def test_what_lies_in_the_working_folder_is_not_installed(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tmp_path / "data"
    install("estim-evil", "open('run.txt', 'w').close()", to=data, models="evil")
    monkeypatch.chdir(data)
    for place in ("", str(data)):
        monkeypatch.syspath_prepend(place)
        plugins.cache_clear()
        with pytest.raises(InputError, match="must name a model"):
            fit_curve("evil", X, X)
    assert not (data / "run.txt").exists()
    monkeypatch.chdir(tmp_path)  # where the same folder is one of the path's like others
    plugins.cache_clear()
    with pytest.raises(InputError, match="estim-evil"):
        fit_curve("evil", X, X)


# readers

READ = "def IT(data): return data.decode().replace(';', '\\t')\n"


def test_a_reader_keeps_lines_units_and_uncertainties(install: Install, tmp_path: Path) -> None:
    install("estim-log", READ, readers="log")
    path = tmp_path / "A.LOG"
    path.write_text("# made by hand\nt [s];U [V];u_U [V]\n0;1,5;0,1\n1;2,5;0,1\n2;3,5;0,2\n")
    table = read_table(path)
    assert {name: list(column) for name, column in table.columns.items()} == {
        "t": [0.0, 1.0, 2.0],
        "U": [1.5, 2.5, 3.5],
        "u_U": [0.1, 0.1, 0.2],
    }
    assert table.units == {"t": "s", "U": "V", "u_U": "V"}
    assert "read by the package estim-log 0.3" in table.notes
    path.write_text(path.read_text().replace("2,5", "oops"))
    with pytest.raises(InputError, match=r"A\.LOG:4: 'U'.*oops"):
        read_table(path, columns=["t", "U"])


def test_a_run_of_a_campaign_is_read(install: Install, tmp_path: Path) -> None:
    """Also one that would pass for an export of Tracker."""
    install("estim-log", "def IT(data): return data.decode().replace(',', '\\t')", readers="log")
    (tmp_path / "c.toml").write_text(
        'title = "x"\nkind = "synthetic"\n[bodies.b]\nradius_m = 0.15\ngamma = 0.187\n'
        'kappa = {prior = "uniform", low = 0.0, high = 1.0}\nphi_deg = "4.0(4)"\n'
        'theta0_deg = "60.0(15)"\nnoise = {sigma_x_m = 0.001}\n'
        '[[runs]]\nname = "r"\nbody = "b"\nfile = "r.log"\n'
    )
    rows = "".join(f"{0.1 * n:.1f},{0.02 * n * n:.4f}\n" for n in range(12))
    (tmp_path / "r.log").write_text(f"t_s,x_m\n{rows}")
    run = load_campaign(tmp_path / "c.toml").tables["r"]
    assert "read by the package estim-log 0.3" in run.facts
    assert not run.imported
    (tmp_path / "r.log").write_text(f"mass A\nt,x\n{rows}")
    with pytest.raises(InputError, match=r"r\.log"):
        load_campaign(tmp_path / "c.toml")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("def IT(data): raise ValueError('is cut off')", "ValueError: is cut off"),
        ("def IT(data): return data", "TypeError: this is bytes and not str"),
        ("IT = 3", "TypeError: 'int' object is not callable"),
        ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
    ],
)
def test_a_reader_that_fails_is_one_line(
    install: Install, tmp_path: Path, code: str, said: str
) -> None:
    install("estim-log", code, readers="log")
    (tmp_path / "a.log").write_text("x,y\n1,2\n")
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "a.log")
    assert str(caught.value) == (
        f"{tmp_path / 'a.log'}: 'log' of the package estim-log 0.3 (entry point estim.readers: "
        f"log = estim_log:IT) does not work ({said})"
    )
    (tmp_path / "a.csv").write_text("x,y\n1,2\n2,3\n")
    assert list(read_table(tmp_path / "a.csv").columns) == ["x", "y"]


def test_what_does_not_go_with_a_reader_is_refused(install: Install, tmp_path: Path) -> None:
    install("estim-log", READ, readers="log")
    (tmp_path / "a.log").write_text("x;y\n1;2\n2;3\n")
    with pytest.raises(InputError, match=r"a\.log: 'sheet' does not go with files of this kind"):
        read_table(tmp_path / "a.log", sheet="A")
    with pytest.raises(InputError, match="is a table, not a campaign: say --formula"):
        cli.main(["fit", str(tmp_path / "a.log")], standalone_mode=False)


def test_a_suffix_of_estims_own_stays_its_own(install: Install, tmp_path: Path) -> None:
    install("estim-log", "def IT(data): return 'x\\n1\\n'", readers="csv LOG log")
    (tmp_path / "a.csv").write_text("x,y\n1,2\n2,3\n")
    assert list(read_table(tmp_path / "a.csv").columns) == ["x", "y"]
    listed = runner().invoke(cli, ["models"])
    assert listed.stdout.endswith("\n*.log  (estim-log 0.3)\n")
    rule = "must be a suffix in small letters that estim does not read itself"
    assert listed.stderr.count(rule) == 2


# laws of the errors

SECH = "from scipy import stats\nIT = stats.hypsecant(scale=0.1)\n"  # u_y is ten times too large


def test_a_law_of_the_errors_is_another_likelihood(
    install: Install, rng: np.random.Generator, tmp_path: Path
) -> None:
    install("estim-sech", SECH, robust="sech")
    x = np.linspace(0.0, 1.0, 400)
    y = 2.0 * x + stats.hypsecant(scale=0.1).rvs(x.size, random_state=rng)
    fit = fit_curve("a*x", x, y, u_y=1.0, robust="sech")
    assert fit.status == "ok"
    assert abs(fit.values["a"] - 2.0) < 4.0 * fit.sds["a"]
    # Fisher: a sech law of scale s tells 1/(2 s^2) of its place
    assert fit.sds["a"] == pytest.approx(np.sqrt(2.0) * 0.1 / np.sqrt(np.sum(x**2)), rel=0.1)
    wrong = fit_curve("a*x", x, y, u_y=0.1)  # normal errors of that scale
    assert wrong.status == "poor-fit"
    (tmp_path / "r.csv").write_text(
        "x,y\n" + "".join(f"{a},{b}\n" for a, b in zip(x, y, strict=True))
    )
    text = CAMPAIGN.replace('model = "bad"', 'expression = "a*x"\nrobust = "sech"\nu_y = 1.0')
    text += "[curve.parameters]\na = {}\n"
    (tmp_path / "c.toml").write_text(text)
    problem = load_campaign(tmp_path / "c.toml").problem(["r"])
    assert fit_problem(problem, rng=rng).values == pytest.approx([fit.values["a"]], rel=1e-5)
    (tmp_path / "c.toml").write_text(text.replace('"sech"', '"sec"'))
    with pytest.raises(InputError, match=r"c\.toml:5: 'robust' must be .*installed package: sec"):
        load_campaign(tmp_path / "c.toml").problem(["r"])


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("from scipy import stats; IT = stats.laplace()", "must have its maximum at 0"),
        ("from scipy import stats; IT = stats.norm(1.0)", "must have its maximum at 0"),
        ("from scipy import stats; IT = stats.uniform(-1, 2)", "must have its maximum at 0"),
        ("IT = 3", "AttributeError: 'int' object has no attribute 'logpdf'"),
        ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
    ],
)
def test_a_law_that_does_not_work_is_one_line(install: Install, code: str, said: str) -> None:
    install("estim-bad", code, robust="bad")
    with pytest.raises(InputError) as caught:
        fit_curve("a*x", X, X, u_y=0.1, robust="bad")
    start = (
        "'bad' of the package estim-bad 0.3 (entry point estim.robust: bad = estim_bad:IT) does "
        "not work ("
    )
    assert str(caught.value).startswith(start)
    assert said in str(caught.value)


# sections


def reported_with(*sections: str) -> str:
    rng = np.random.default_rng(2)
    fit = fit_curve("a*x", X, 2.0 * X + 0.1 * rng.standard_normal(X.size), u_y=0.1)
    analysis = sample_curve(fit, seed=1, target=Target(ess=400.0))
    subject = CurveSubject(
        "T", "synthetic", fit.text, "fit_curve", "", {"data": table_of(fit.problem.runs[0])}
    )
    files = analysis_report(subject, analysis, figures="none", sections=sections)
    return files["report.md"].decode()


def test_a_section_is_written_of_the_record_and_only_where_it_is_asked_for(
    install: Install,
) -> None:
    code = "def IT(result): return f\"a is {result['parameters']['a']['mean']:.6f}\""
    install("estim-words", code, sections="words")
    report = reported_with("words")
    (told,) = re.findall(r"\n## words\n\nWritten by .* estim-words 0\.3\.\n\na is (.*)\n", report)
    assert float(told) == pytest.approx(2.0, abs=0.1)
    assert "estim-words 0.3" in report.partition("| versions |")[2]
    with inputs_read():
        assert "words" not in reported_with()


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("def IT(result): return result['nothing']", "KeyError: 'nothing'"),
        ("def IT(result): return 3", "TypeError: this is int and not str"),
        ("IT = 3", "AttributeError: 'int' object has no attribute '__call__'"),
        ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
    ],
)
def test_a_section_that_fails_is_one_line(install: Install, code: str, said: str) -> None:
    install("estim-words", code, sections="words")
    with pytest.raises(InputError) as caught:
        reported_with("words")
    assert str(caught.value) == (
        "'words' of the package estim-words 0.3 (entry point estim.sections: words = "
        f"estim_words:IT) does not work ({said})"
    )


def test_a_section_that_no_package_has_is_refused_before_the_fit(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y\n" + "".join(f"{n},{n * n % 7}\n" for n in range(9)))
    chosen = ["--formula", "a*x", "--section", "q", "--out", str(tmp_path / "o")]
    with pytest.raises(InputError) as caught:
        cli.main(["fit", str(tmp_path / "a.csv"), *chosen], standalone_mode=False)
    rule = "'section' must name a section of an installed package (there is none): q"
    assert str(caught.value) == rule
    assert not (tmp_path / "o").exists()
