"""The command line: outputs, exit codes and messages, as a user meets them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jsonschema
import pytest
from troubles import Disk

from estim.cli.commands import cli, main
from estim.common.errors import InputError

Command = Callable[..., subprocess.CompletedProcess[str]]


def process(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, without a terminal."""
    return subprocess.run(
        [sys.executable, "-m", "estim", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def estim(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """The command in this process: what it says, and its exit code."""

    def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "argv", ["estim", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return subprocess.CompletedProcess(sys.argv, ended.value.code, *capsys.readouterr())

    return run


CHOSEN = ("--seed", "1", "--figures", "all")
SCHEMA = "estim-result-1.schema.json"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of one run, and its report in `out`."""
    folder = tmp_path_factory.mktemp("fit")
    done = process("fit", Disk().write(folder), "--out", folder / "out", *CHOSEN)
    assert done.returncode == 0, done.stderr
    assert "r: ok" in done.stdout
    assert done.stderr == ""  # no progress bar where nobody watches
    return folder


@pytest.mark.slow
def test_fit_writes_report_json_and_figures(fitted: Path) -> None:
    report = (fitted / "out" / "report.md").read_text()
    assert "SYNTHETIC" in report.splitlines()[2]
    assert "**Status: ok**" in report
    for figure in ("phase", "residuals", "corner", "traces"):
        assert f"(figures/{figure}.png)" in report
        assert (fitted / "out" / "figures" / f"{figure}.png").read_bytes().startswith(b"\x89PNG")
    assert not list(fitted.rglob(".*"))  # no temporary file is left


def alternatives_sorted(schema: object) -> object:
    """A JSON Schema whose alternatives stand in one order: which comes first differs from version
    to version of msgspec, and means nothing.
    """
    if isinstance(schema, dict):
        inner = {key: alternatives_sorted(value) for key, value in schema.items()}
        return inner | {"anyOf": sorted(inner["anyOf"], key=repr)} if "anyOf" in inner else inner
    return [alternatives_sorted(item) for item in schema] if isinstance(schema, list) else schema


def test_the_published_schema_is_that_of_the_record(project: Path) -> None:
    from estim.reports.result import json_schema

    published = json.loads((project / "docs" / SCHEMA).read_bytes())
    assert alternatives_sorted(published) == alternatives_sorted(json.loads(json_schema()))


@pytest.mark.slow
def test_result_json_keeps_to_the_published_schema(fitted: Path, project: Path) -> None:
    result = json.loads((fitted / "out" / "result.json").read_text())
    jsonschema.validate(result, json.loads((project / "docs" / SCHEMA).read_bytes()))
    assert result["schema"] == "estim-result/1"
    parameters = {"gamma[b]", "kappa[b]", "theta0[r]", "phi[r]", "scale_x", "scale_t"}
    assert set(result["parameters"]) == parameters
    assert result["provenance"]["seed"] == 1


@pytest.mark.slow
def test_same_seed_gives_the_same_bytes(estim: Command, fitted: Path, tmp_path: Path) -> None:
    estim("fit", fitted / "campaign.toml", "--out", tmp_path, *CHOSEN)
    for file in ("result.json", "report.md", "figures/phase.png"):
        assert (tmp_path / file).read_bytes() == (fitted / "out" / file).read_bytes(), file


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fit", "nowhere.toml"), "nowhere.toml: cannot be read (no such file or directory)"),
        (("fit", "{campaign}", "--run", "heavy-05"), "'--run' must name one of the runs"),
        (("fit", "{campaign}", "--seed", "-1"), "'--seed'"),
        (("fit", "{campaign}", "--seed", "1" + 30 * "0"), "'--seed'"),
        (("fit", "{campaign}", "--sead", "1"), "--sead"),
        (("fit", "{campaign}", "--sead\r\x1b[2K", "1"), "--sead"),
        (
            ("fit", "{campaign}", "--resume", "--out", 300 * "x"),
            "cannot be read (file name too long)",
        ),
        (("fit", "{campaign}", "--resume", "--out", "/proc/x"), "cannot be written"),
        (("simulate", "{campaign}", "--out", "x"), "is a key of a campaign"),
        *(
            ((name, "{campaign}", "--out", ""), "'--out' must not be empty")
            for name in ("fit", "line", "batch", "plan", "simulate", "import")
        ),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    estim: Command,
    arguments: tuple[str, ...],
    message: str,
    replica: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = estim(*(a.replace("{campaign}", str(replica / "campaign.toml")) for a in arguments))
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert done.stderr.strip().isprintable()
    assert message in done.stderr
    assert done.stdout == ""


def test_a_formula_may_have_an_input_called_as_its_result_is_by_default(
    estim: Command, tmp_path: Path
) -> None:
    given = ("x*y", "x=2.0(1)", "y=3.0(2)", "--out", tmp_path / "out", "--figures", "none")
    done = estim("propagate", *given)
    assert done.returncode == 0
    assert "result = 6.00 with standard uncertainty u = 0.50" in done.stdout


def test_a_program_that_asks_is_told_of_progress_and_errors_in_lines_of_json(
    estim: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ESTIM_PROGRESS", "json")
    done = estim("propagate", "2*a", "a=1.0(1)", "--out", tmp_path / "out", "--figures", "none")
    assert done.returncode == 0
    told = [json.loads(line) for line in done.stderr.splitlines()]
    assert told
    assert [line["percent"] for line in told] == sorted(line["percent"] for line in told)
    assert {line["doing"] for line in told} == {"Monte Carlo"}
    done = estim("propagate", "2*a +", "a=1.0(1)", "--out", tmp_path / "out")
    (told,) = [json.loads(line) for line in done.stderr.splitlines()]
    assert done.returncode == 2
    assert set(told) == {"error", "field"}


def test_output_folder_that_cannot_be_made_is_one_line(
    estim: Command, tmp_path: Path, replica: Path
) -> None:
    (tmp_path / "file").write_text("in the way")
    done = estim("simulate", replica / "design.toml", "--out", tmp_path / "file" / "x")
    assert done.returncode == 2
    assert "cannot be read (not a directory)" in done.stderr


def test_help_loads_nothing_heavy() -> None:
    code = """
import atexit, sys
from estim.__main__ import main
atexit.register(lambda: print("loaded:", *sorted({"numpy", "scipy", "lmfit", "emcee",
    "matplotlib", "msgspec", "jinja2"} & set(sys.modules))))
sys.argv = ["estim", "--help"]
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Usage: estim" in done.stdout
    assert done.stdout.splitlines()[-1] == "loaded:"


def test_an_interrupt_while_modules_are_loaded_is_one_word() -> None:
    code = """
import sys
from estim.__main__ import main

class Impatient:
    def find_spec(self, name, path, target=None):
        if name == "estim.cli.commands":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Impatient())
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_capped_chains_of_several_runs_get_a_folder_each_and_an_index_and_exit_with_3(
    estim: Command, tmp_path: Path, replica: Path
) -> None:
    (tmp_path / "runs").symlink_to(replica / "runs")
    text = (replica / "campaign.toml").read_text()
    (tmp_path / "c.toml").write_text(
        text[: text.index("[line]")].replace("[shared]", "[shared]\nunmodelled_force = 0")
    )
    out = tmp_path / "out"
    done = estim(
        "fit",
        tmp_path / "c.toml",
        "--run",
        "heavy-04",
        "--run",
        "heavy-06",
        "--out",
        out,
        "--max-steps",
        "60",
    )
    assert done.returncode == 3
    assert "not-converged" in done.stdout
    index = (out / "report.md").read_text()
    for run in ("heavy-04", "heavy-06"):
        assert f"[{run}]({run}/report.md)" in index
        assert (out / run / "result.json").exists()
        report = (out / run / "report.md").read_text()
        assert "## No main result" in report
        assert "## Result" not in report
        assert "increase the number of steps (--max-steps)" in report


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_line_writes_its_report(estim: Command, tmp_path: Path, replica: Path) -> None:
    done = estim("line", replica / "campaign.toml", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    report = (tmp_path / "report.md").read_text()
    assert "SYNTHETIC" in report
    assert "**recommended**" in report
    assert "cannot distinguish between these causes" in report
    assert json.loads((tmp_path / "result.json").read_text())["schema"] == "estim-line/1"
    assert (tmp_path / "figures" / "line.png").exists()


def test_line_without_a_series_is_one_line(estim: Command, tmp_path: Path, replica: Path) -> None:
    text = (replica / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text[: text.index("[line]")])
    (tmp_path / "runs").symlink_to(replica / "runs")
    done = estim("line", tmp_path / "campaign.toml")
    assert done.returncode == 2
    assert "[line]" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_energy_writes_its_report(estim: Command, tmp_path: Path, replica: Path) -> None:
    """Of a run that does not say how much is lost, and with a prior so wide that it does."""
    asked = ("--run", "heavy-04", "--out", tmp_path / "out")
    done = estim("energy", replica / "campaign.toml", *asked)
    assert done.returncode == 3, done.stderr
    assert "heavy-04: not-identified\n  Allowing a loss improves" in done.stdout
    report, result = (
        (tmp_path / "out" / "report.md").read_text(),
        json.loads((tmp_path / "out" / "result.json").read_text()),
    )
    assert "**Status: not-identified**" in report
    assert "can be used as it stands" not in report
    assert "| heavy-04 |" not in report  # a loss that is the prior's over again
    assert (result["status"], result["energies"]) == ("not-identified", {})
    assert (tmp_path / "out" / "figures" / "energy.png").exists()
    text = (replica / "campaign.toml").read_text().replace("scale = 0.005", "scale = 0.05")
    for folder in ("runs/", "../paper/", "theta_min"):
        text = text.replace(f'"{folder}', f'"{replica}/{folder}')
    (tmp_path / "wide.toml").write_text(text)
    done = estim("energy", tmp_path / "wide.toml", *asked)
    assert done.returncode == 0, done.stderr
    assert re.search(
        r"heavy-04: ok\n  (no loss is detected, c_rr ≤ 0\.0\d+|a loss is measured) \(", done.stdout
    )
    assert "| heavy-04 |" in (tmp_path / "out" / "report.md").read_text()


def test_campaign_without_unknowns_or_runs_is_one_line(
    estim: Command, tmp_path: Path, replica: Path
) -> None:
    text = (replica / "campaign.toml").read_text()
    head, tail = text[: text.index("[[runs]]")], text[text.index("[line]") :]
    (tmp_path / "theta_min.csv").write_text((replica / "theta_min.csv").read_text())
    (tmp_path / "line.toml").write_text(head + tail)
    for command in ("fit", "energy"):
        done = estim(command, tmp_path / "line.toml")
        assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, "")
        assert "[[runs]]" in done.stderr
    (tmp_path / "r.csv").write_text((replica / "runs" / "heavy-04.csv").read_text())
    exact = (
        'title = "x"\nkind = "measured"\n[bodies.b]\nradius_m = 0.15\ngamma = 0.187\nkappa = '
        '0.45\n[[runs]]\nname = "r"\nbody = "b"\n'
    )
    (tmp_path / "exact.toml").write_text(
        exact + 'file = "r.csv"\nphi_deg = 4.0\ntheta0_deg = 60.0\nnoise = {sigma_x_m = 0.001}\n'
    )
    done = estim("fit", tmp_path / "exact.toml")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "nothing to fit" in done.stderr


def test_degrees_under_a_radian_key_are_refused(
    estim: Command, tmp_path: Path, replica: Path
) -> None:
    (tmp_path / "runs").symlink_to(replica / "runs")
    text = (replica / "campaign.toml").read_text()
    (tmp_path / "c.toml").write_text(text.replace("phi_deg =", "phi_rad ="))
    done = estim("fit", tmp_path / "c.toml")
    assert done.returncode == 2
    assert "phi_deg" in done.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered", "few_draws")
def test_reanalyse_survives_what_has_no_band_and_nothing_in_common(
    estim: Command, tmp_path: Path, replica: Path
) -> None:
    """kappa stated for each run, every input of the curve exact or uniform: no band, no narrowing,
    but a report.
    """
    (tmp_path / "r.csv").write_text((replica / "runs" / "heavy-04.csv").read_text())
    (tmp_path / "c.toml").write_text(
        'title = "x"\nkind = "synthetic"\n[bodies.b]\nradius_m = 0.15\ngamma = '
        '0.187\n[[runs]]\nname = "r"\nbody = "b"\nfile = "r.csv"\n'
        'phi_deg = 4.0\ntheta0_deg = {prior = "uniform", low = 50.0, high = 70.0}\nkappa = '
        '{prior = "uniform", low = 0.0, high = 1.0}\n'
        "noise = {sigma_x_m = 0.001}\n"
    )
    done = estim("reanalyse", tmp_path / "c.toml", "--jobs", "1", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    report = (tmp_path / "out" / "report.md").read_text()
    assert "held the rolling resistance fixed" in report
    assert "taken as exact" in report


@pytest.mark.parametrize(
    ("file", "folder"),
    [
        ("replica/campaign.toml", "out/replica/line"),
        ("gallery/muon.toml", "out/muon/line"),
        ("gallery/a.b.toml", "out/a.b/line"),
    ],
)
def test_two_campaigns_of_one_folder_have_folders_of_their_own(
    tmp_path: Path, file: str, folder: str
) -> None:
    from estim.cli.options import out_folder

    assert out_folder(tmp_path / file, "line") == Path(folder)


@pytest.mark.parametrize("command", ["verify", "new", "diff", "batch", "fit", "line"])
def test_a_name_that_is_too_long_for_a_file_is_one_line(
    estim: Command, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = estim(command, *["a" * 300] * (2 if command == "diff" else 1))
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert "aaa" in done.stderr
    assert "(file name too long)" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["serve", "--port", "abc"], "'--port' must be a whole number of at least 1 and at most"),
        (["serve", "--port", "65536"], "'--port' must be a whole number of at least 1 and at most"),
        (["line", "a.csv", "--seed", "-1"], "'--seed' must be a whole number of at least 0 and"),
        (["fit", "a.csv", "--every", "0"], "'--every' must be a whole number of at least 1: 0"),
        (["fit", "a.csv", "--deviation", "1,5"], "'--deviation' must be a number: 1,5"),
        (["diff", "1", "2", "--r", "2"], "'--r' must be a number between -1 and 1: 2"),
    ],
)
def test_a_number_of_an_option_is_refused_with_its_rule(arguments: list[str], told: str) -> None:
    with pytest.raises(InputError) as refused:
        cli.main(arguments, standalone_mode=False)
    assert str(refused.value).startswith(told)
