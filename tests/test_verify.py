"""`estim verify`: what was tampered with is found and named.  `estim diff`: what differs between
two analyses.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_runner import runner

from estim.cli.commands import cli
from estim.common import EstimError, InputError
from estim.verification import compare_results, differences

MODEL = """\
title = "A sum"
draws = 10000
[measurand]
formula = "a + b"
unit = "m"
[inputs]
a = {value = 1.0, u = 0.1}
b = {value = 2.0, u = 0.2}
"""


def run(*arguments: object):
    return runner().invoke(cli, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    (folder / "model.toml").write_text(MODEL)
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        assert run("propagate", "model.toml", "--out", "out", "--seed", "3").exit_code == 0
    return folder


@pytest.fixture
def model(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A report of the model in `model.toml`, in `out`; the working folder holds both."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def changed(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


def resealed(folder: Path, name: str) -> None:
    """The digest in origin.json forged as well."""
    origin = json.loads((folder / "origin.json").read_text())
    origin["outputs"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    (folder / "origin.json").write_text(json.dumps(origin))


def forged_report(folder: Path) -> None:
    changed(folder / "out" / "report.md", "3.00", "3.10")
    resealed(folder / "out", "report.md")


def other_figure(folder: Path) -> None:
    pictures = sorted((folder / "out" / "figures").glob("*.png"))
    data = pictures[0].read_bytes()
    pictures[0].write_bytes(data[:-20] + bytes([data[-20] ^ 1]) + data[-19:])


def other_layout(folder: Path) -> None:
    """The same result in other bytes."""
    file = folder / "out" / "result.json"
    file.write_text(json.dumps(json.loads(file.read_text())))


TAMPERINGS: dict[str, tuple[Callable[[Path], object], str]] = {
    "a digit of the report": (
        lambda f: changed(f / "out" / "report.md", "3.00", "3.10"),
        "report.md, line",
    ),
    "a digit of the report, its digest forged": (forged_report, "report.md, line"),
    "a digit of the result": (
        lambda f: changed(f / "out" / "result.json", '"value": 3.0', '"value": 3.1'),
        "value: '3.1', recomputed '3'",
    ),
    "a word of the result": (
        lambda f: changed(f / "out" / "result.json", '"A sum"', '"A Sum"'),
        "title: 'A Sum', recomputed 'A sum'",
    ),
    "the layout of the result": (other_layout, "result.json is not as it was written"),
    "a figure": (other_figure, ".png, all of it: differs from what is recomputed"),
    "a number of the result taken away": (
        lambda f: changed(f / "out" / "result.json", '"value": 3.0', '"value": null'),
        "value: 'null', recomputed '3'",
    ),
    "a word of the report": (
        lambda f: changed(f / "out" / "report.md", "\u00a0", " $\\tau "),
        r"$\tau",
    ),
    "a figure taken away": (
        lambda f: next((f / "out" / "figures").glob("*.png")).unlink(),
        ".png is missing",
    ),
    "an uncertainty stated": (
        lambda f: changed(f / "model.toml", "u = 0.2", "u = 0.3"),
        "the input model.toml is not the one",
    ),
    "the formula": (
        lambda f: changed(f / "model.toml", "a + b", "a - b"),
        "the input model.toml is not the one",
    ),
    "the seed": (lambda f: changed(f / "out" / "origin.json", '"3"', '"4"'), "Monte Carlo"),
}


def test_a_report_as_it_was_made_is_verified_from_anywhere(
    model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in (model, model / "out", Path("/")):
        monkeypatch.chdir(place)
        done = run("verify", model / "out")
        assert done.exit_code == 0, done.output
        assert "recomputing: estim propagate model.toml --seed 3" in done.output
    assert (
        "Made by `estim propagate model.toml --seed 3`" in (model / "out" / "report.md").read_text()
    )


def unnamed(folder: Path, **changes: object) -> None:
    """A forged report whose origin keeps silent about it, or points back at it."""
    changed(folder / "out" / "report.md", "3.00", "3.10")
    origin = json.loads((folder / "out" / "origin.json").read_text())
    (folder / "out" / "origin.json").write_text(json.dumps({**origin, **changes}))


def test_a_report_that_its_origin_does_not_name_is_not_verified(model: Path) -> None:
    unnamed(model, outputs={})
    done = run("verify", "out")
    assert done.exit_code == 3
    assert "report.md: is made now, and origin.json does not name it" in done.output


def test_figures_may_go_unnamed_and_that_is_said(model: Path) -> None:
    """As where they were made smaller for a repository (reports/gallery)."""
    origin = json.loads((model / "out" / "origin.json").read_text())
    kept = {name: digest for name, digest in origin["outputs"].items() if not name.endswith(".png")}
    (model / "out" / "origin.json").write_text(json.dumps({**origin, "outputs": kept}))
    done = run("verify", "out")
    assert done.exit_code == 0, done.output
    assert "not compared: figures/budget.png, figures/distribution.png" in done.output


def test_a_report_is_not_compared_with_itself(model: Path) -> None:
    for field, value in (
        ("part", str(model / "out")),
        ("part", "../out"),
        ("outputs", {str(model / "out" / "report.md"): ""}),
    ):
        unnamed(model, **{field: value})
        done = run("verify", "out")
        assert isinstance(done.exception, InputError)
        assert f"'{field}' must lie within what the command writes" in str(done.exception)
        shutil.rmtree(model / "out")
        assert (
            run(
                "propagate", "model.toml", "--out", "out", "--seed", "3", "--figures", "none"
            ).exit_code
            == 0
        )


@pytest.mark.parametrize("name", TAMPERINGS)
def test_what_was_tampered_with_is_found_and_named(name: str, model: Path) -> None:
    tamper, named = TAMPERINGS[name]
    tamper(model)
    done = run("verify", "out")
    assert done.exit_code == 3
    assert named in done.output, done.output
    assert "not verified" in done.output


LINE = """\
title = "A line"
kind = "synthetic"
[curve]
expression = "a + b*x"
x = "x"
y = "y"
u_y = 0.1
[curve.parameters]
a = {start = 0.0}
b = "2.0(2)"
[[runs]]
name = "r"
file = "r.csv"
"""


@pytest.mark.usefixtures("undrawn", "few_draws")
def test_a_datum_and_a_prior_are_found_and_what_they_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.toml").write_text(LINE)
    x = np.linspace(0.0, 3.0, 20)
    y = 1.0 + 2.0 * x + 0.1 * np.random.default_rng(2).standard_normal(x.size)
    (tmp_path / "r.csv").write_text(
        "x,y\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(x, y, strict=True))
    )
    assert run("fit", "campaign.toml", "--out", "first", "--figures", "none").exit_code == 0
    assert run("verify", "first").exit_code == 0
    text = (tmp_path / "r.csv").read_text().splitlines()
    at, value = text[12].split(",")
    (tmp_path / "r.csv").write_text(
        "\n".join([*text[:12], f"{at},{float(value) + 0.05:.6f}", *text[13:]]) + "\n"
    )
    found = run("verify", "first")
    assert found.exit_code == 3
    assert "the input r.csv is not the one" in found.output
    assert "campaign.toml is not the one" not in found.output
    changed(tmp_path / "campaign.toml", '"2.0(2)"', '"2.0(1)"')
    found = run("verify", "first")
    assert "the input campaign.toml is not the one" in found.output
    assert "prior_sd: '0.2', recomputed '0.1'" in found.output
    assert run("fit", "campaign.toml", "--out", "second", "--figures", "none").exit_code == 0
    apart = run("diff", "first", "second")
    assert apart.exit_code == 0
    for words in ("provenance.campaign_sha256 differs", "data_sha256.r.csv differs"):
        assert words in apart.output, apart.output
    assert re.search(r"\na: .* ± .* -> .* ± .*, moved by [+−]?0\.\d\d sd\n", apart.output)
    assert "same" not in apart.output
    assert run("diff", "first", "first/result.json").output == "the results are the same\n"


def test_what_only_an_earlier_report_has_goes_with_it_unless_somebody_changed_it(
    model: Path,
) -> None:
    out = model / "out"
    (out / "mine.txt").write_text("a note")
    origin = json.loads((out / "origin.json").read_text())
    for name, kept in (("old.csv", "old"), ("edited.csv", "other")):
        (out / name).write_text(kept)
        origin["outputs"][name] = hashlib.sha256(b"old").hexdigest()
    (out / "origin.json").write_text(json.dumps(origin))
    assert run("propagate", "model.toml", "--out", "out", "--figures", "none").exit_code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "edited.csv",
        "mine.txt",
        "origin.json",
        "report.md",
        "result.json",
    ]
    (model / "elsewhere.csv").write_text("old")
    made = (out / "origin.json").read_text()
    for name in ("../elsewhere.csv", str(model / "elsewhere.csv"), "", "a\0b"):
        (out / "origin.json").write_text(
            json.dumps({**json.loads(made), "outputs": {name: hashlib.sha256(b"old").hexdigest()}})
        )
        done = run("propagate", "model.toml", "--out", "out", "--figures", "none")
        assert isinstance(done.exception, InputError)
        assert "'outputs' must lie within what the command writes" in str(done.exception)
    assert (model / "elsewhere.csv").exists()
    (out / "origin.json").write_text("{")  # no origin of ours says what is ours
    assert "origin.json: is no origin of a report" in str(
        run("propagate", "model.toml", "--out", "out", "--figures", "none").exception
    )


def test_what_cannot_be_verified_is_one_line(model: Path) -> None:
    (model / "empty").mkdir()
    shutil.move(model / "model.toml", model / "moved.toml")
    for arguments, rule in (
        (("verify", "empty"), "holds no origin.json"),
        (("verify", "moved.toml"), "or a file beside its origin.json: moved.toml"),
        (("verify", "out"), "'input' cannot be found"),
        (("diff", "out", "empty"), "'result' cannot be found"),
        (("diff", "out", "moved.toml"), "must be a result.json of estim"),
    ):
        done = run(*arguments)
        assert isinstance(done.exception, InputError)
        assert rule in str(done.exception)


@pytest.mark.parametrize(
    "command",
    [
        ["import", "x.trk", "-o", "stolen.csv"],
        ["simulate", "d.toml"],
        ["propagate", "model.toml", "--out", "elsewhere"],
        [],
        ["rm"],
        ["-h"],
        ["batch", "model.toml", "--jobs", "10000"],
        ["batch", "model.toml", "--jobs=10000"],
        ["reanalyse", "model.toml", "--jobs", "10000"],
        ["batch", "model.toml", "--scheduler", "tcp://elsewhere:1"],
        ["fit", "model.toml", "--resume"],
        ["propagate", "--help"],
        ["propagate", "mod\0el.toml"],
        ["propagate", "x" * 5000],
        ["propagate", "mod\udcffel.toml"],
    ],
)
def test_a_forged_command_is_not_run(command: list[str], model: Path) -> None:
    origin = json.loads((model / "out" / "origin.json").read_text())
    (model / "out" / "origin.json").write_text(json.dumps({**origin, "command": command}))
    done = run("verify", "out")
    assert isinstance(done.exception, InputError)
    assert "must name a command that makes a report, and no place, processes or --resume" in str(
        done.exception
    )
    assert sorted(path.name for path in model.iterdir()) == ["model.toml", "out"]


def test_a_command_that_makes_no_report_verifies_none(model: Path) -> None:
    origin = json.loads((model / "out" / "origin.json").read_text())
    (model / "out" / "origin.json").write_text(json.dumps({**origin, "part": "elsewhere"}))
    done = run("verify", "out")
    assert done.exit_code == 3
    assert "cannot be recomputed: the command makes no such report" in done.output


def estimate(mean: float, sd: float, mcse: float = 0.01) -> dict[str, object]:
    return {
        "mean": mean,
        "sd": sd,
        "q025": mean - 2.0 * sd,
        "q975": mean + 2.0 * sd,
        "mcse": mcse,
        "rhat": 1.0 + 1e-4 * mean,
        "unit": "m",
    }


NOW: dict[str, Any] = {
    "status": "ok",
    "parameters": {name: estimate(1.1, 0.51) for name in "abc"},
    "share": 0.51,
    "words": "p = 0.31",
    "n_obs": 9,
    "certificate": {"verdict": "agree"},
}
REPORT = """\
**Status: ok**; p = 0.89.
gamma = 0.181 ± 0.013, R-hat 1.0012
<details>
which of two is named first
"""


def found(
    result: dict[str, Any], report: str = REPORT, *, same_versions: bool = True
) -> dict[str, bool]:
    """What differs from `NOW` and `REPORT`, and whether it is wrong."""
    files = {
        "result.json": (json.dumps(result).encode(), json.dumps(NOW).encode()),
        "report.md": (report.encode(), REPORT.encode()),
    }
    told = differences(files, same_versions=same_versions)
    return {one.where: one.wrong for entries in told.values() for one in entries}


def with_estimate(**changes: object) -> dict[str, Any]:
    return {**NOW, "parameters": {**NOW["parameters"], "a": {**estimate(1.1, 0.51), **changes}}}


def test_where_nearly_all_is_the_same_whatever_differs_is_wrong() -> None:
    assert found(NOW) == {}
    for name, value in (("share", 0.52), ("words", "p = 0.91"), ("certificate", {})):
        assert set(found({**NOW, name: value}).values()) == {True}
    assert found(with_estimate(mean=1.11)) == {"parameters.a.mean": True}
    for before, now in (("0.181", "0.182"), ("1.0012", "1.0013"), ("is named", "was named")):
        assert set(found(NOW, REPORT.replace(before, now)).values()) == {True}


def test_numbers_that_chance_moves_are_told_from_others() -> None:
    """5 Monte-Carlo errors of a difference, 5 sqrt(2) 0.01 = 0.07 for a mean."""
    others = {name: estimate(1.13, 0.52) for name in "bc"}

    def changed(mean: float = 1.13, mcse: float = 0.01, **changes: object) -> dict[str, bool]:
        a = estimate(mean, 0.52, mcse)
        return found({**NOW, "parameters": {"a": a, **others}, **changes})

    assert set(changed().values()) == {False}
    assert "parameters.a.rhat" in changed()
    assert "parameters.a.mean" not in changed()
    assert changed(share=0.6)["share"] is False
    for name, value in (("status", "poor-fit"), ("n_obs", 10)):
        assert changed(**{name: value})[name]
    assert changed(1.2)["parameters.a.mean"]
    assert changed(1.2, mcse=10.0)["parameters.a.mean"]  # an error that the report made up
    for a in ({**estimate(1.13, 0.52), "mean": None}, {"unit": "m"}):
        assert changed(parameters={"a": a, **others})["parameters.a.mean"]


def test_limits_are_estimates_too() -> None:
    """They are what is quoted of a quantity that lies on an edge: no mean, no sd."""
    now = {"mcse": 0.01, "q84": 3.0, "limit": {"side": "upper", "limit_95": 4.5}, "upper_95": None}
    for limit, wrong in ((4.6, False), (4.8, True)):
        before = {**now, "q84": 3.01, "limit": {**now["limit"], "limit_95": limit}}
        pair = (json.dumps(before).encode(), json.dumps(now).encode())
        told = differences({"result.json": pair}, same_versions=False)["result.json"]
        assert [one.where for one in told if one.wrong] == ["limit.limit_95"] * wrong


def test_lines_are_compared_by_their_words_and_by_what_is_estimated() -> None:
    """Where last digits of the results differ, and where other draws were made."""
    last_digits = json.loads(json.dumps(NOW), parse_float=lambda text: float(text) * (1 + 1e-12))
    other_draws = {**NOW, "parameters": {name: estimate(1.13, 0.52) for name in "abc"}}

    def line(result: dict[str, Any], before: str, now: str) -> list[bool]:
        assert before in REPORT
        told = found(result, REPORT.replace(before, now))
        return [wrong for where, wrong in told.items() if where.startswith("line")]

    for before, now, near, far in (
        ("0.181", "0.182", [], []),  # rounding
        ("0.181", "0.184", [True], [False]),
        ("0.181", "0.199", [True], [True]),
        ("1.0012", "1.0031", [False], [False]),
        ("0.89", "0.86", [False], [False]),
        ("Status: ok", "Status: poor", [True], [True]),
        ("R-hat", "other", [True], [False]),
        ("is named", "was named", [False], [False]),
    ):
        assert line(last_digits, before, now) == near, (before, now)
        assert line(other_draws, before, now) == far, (before, now)


def test_a_line_that_differs_is_named_by_its_number_in_the_report() -> None:
    before = b"# title\n\nfirst 1.0\nas it was\nthe end\nlast 7\n"
    now = before.replace(b"as it was", b"as it is now").replace(b"last 7", b"last 9")
    (told,) = differences({"report.md": (before, now)}, same_versions=True).values()
    assert [one.where for one in told] == ["line 4", "line 6"]


@pytest.mark.parametrize("text", ["# 1", "1 #", "1e999999 ± 1", "1" * 500 + " ± 2", "\x00"])
def test_a_line_of_anything_is_compared(text: str) -> None:
    files = {"report.md": (text.encode(), b"1 1 \xc2\xb1 3\n# #")}
    assert differences(files, same_versions=False)["report.md"]


@pytest.mark.parametrize(
    "text",
    [
        '{"a": 1, "a": 2}',
        '{"a": NaN}',
        "[" * 200 + "]" * 200,
        "[" * 99_999,
        '{"a": 1' + "0" * 5000 + "}",
        "\xff",
    ],
)
def test_a_result_that_two_programs_could_read_differently_is_not_verified(
    text: str, model: Path
) -> None:
    before = (model / "out" / "result.json").read_text()
    broken = (
        before.replace("{", '{"title": "Another",', 1) if text.startswith('{"a": 1, "a"') else text
    )
    (model / "out" / "result.json").write_bytes(
        broken.encode("latin-1", "replace") if text == "\xff" else broken.encode()
    )
    resealed(model / "out", "result.json")
    done = run("verify", "out")
    assert done.exit_code == 3
    assert re.search("result.json, all of it: .cannot be read", done.output)


@pytest.mark.slow
def test_what_was_not_compared_is_named_and_what_was_added_too(model: Path) -> None:
    (model / "out" / "draws.nc").write_bytes(b"forged")
    (model / "out" / "report.html").write_text("<p>All is well.")
    done = run("verify", "out")
    assert done.exit_code == 0
    compared, _, aside = done.output.partition("not compared: ")
    assert "draws.nc" not in compared
    assert aside == "draws.nc, report.html\n"
    origin = json.loads((model / "out" / "origin.json").read_text())
    for name in ("draws.nc", "report.html"):
        origin["outputs"][name] = hashlib.sha256((model / "out" / name).read_bytes()).hexdigest()
    (model / "out" / "origin.json").write_text(json.dumps(origin))
    done = run("verify", "out")
    assert done.exit_code == 3
    assert "report.html: is not made any more" in done.output
    shutil.rmtree(model / "out")
    assert run("propagate", "model.toml", "--out", "out", "--format", "html").exit_code == 0
    assert run("verify", "out").exit_code == 0
    changed(model / "out" / "report.html", "3.00", "3.10")
    resealed(model / "out", "report.html")
    done = run("verify", "out")
    assert done.exit_code == 3
    assert re.search(r"report.html, line \d+: .*3.10.*recomputed .*3.00", done.output)


def test_a_figure_of_something_else_is_found_where_everything_else_is_the_same(model: Path) -> None:
    drawn = sorted((model / "out" / "figures").glob("*.png"))
    shutil.copy(drawn[1], drawn[0])
    resealed(model / "out", f"figures/{drawn[0].name}")
    done = run("verify", "out")
    assert done.exit_code == 3
    assert f"figures/{drawn[0].name}, all of it" in done.output


@pytest.mark.slow
def test_inputs_are_those_that_are_read(model: Path) -> None:
    origin = json.loads((model / "out" / "origin.json").read_text())
    named = origin["inputs"]
    (model / "other.csv").write_text("x")
    for inputs, path in (
        ({}, "model.toml"),
        ({**named, "other.csv": "0" * 64}, "other.csv"),
        ({"model.toml": "0" * 64}, "model.toml"),
    ):
        (model / "out" / "origin.json").write_text(json.dumps({**origin, "inputs": inputs}))
        done = run("verify", "out")
        assert done.exit_code == 3
        assert f"the input {path} is not the one that the report was made from" in done.output


@pytest.mark.parametrize(
    "path",
    ["/proc/self/mem", "a\0b", "x" * 300, "/".join(["y" * 200] * 30), "\udcff", "pipe", "sparse"],
)
def test_hostile_inputs_are_one_line(path: str, model: Path) -> None:
    os.mkfifo(model / "pipe")
    with (model / "sparse").open("wb") as file:
        file.truncate(20 * 2**30)
    origin = json.loads((model / "out" / "origin.json").read_text())
    (model / "out" / "origin.json").write_text(json.dumps({**origin, "inputs": {path: "0" * 64}}))
    done = run("verify", "out")
    assert done.exit_code == 3 or isinstance(done.exception, InputError), done.exception
    for words in (["propagate", path], ["fit", path]):
        (model / "out" / "origin.json").write_text(
            json.dumps({**origin, "inputs": {}, "command": words})
        )
        done = run("verify", "out")
        assert done.exit_code == 3 or isinstance(done.exception, InputError), done.exception


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["link", "pipe", "sparse", "folder"])
@pytest.mark.parametrize("name", ["origin.json", "report.md", "result.json", "figures/budget.png"])
def test_a_hostile_file_of_the_report_is_one_line(name: str, kind: str, model: Path) -> None:
    place = model / "out" / name
    place.unlink()
    if kind == "link":
        place.symlink_to("/proc/self/mem")
    elif kind == "pipe":
        os.mkfifo(place)
    elif kind == "folder":
        place.mkdir()
    else:
        with place.open("wb") as file:
            file.truncate(20 * 2**30)
    done = run("verify", "out")
    assert isinstance(done.exception, EstimError), (done.output, done.exception)


@pytest.mark.parametrize("name", ["x" * 300, "y/" * 3000, b"\xff"])
def test_a_name_that_no_file_can_have_is_no_traceback(name: str | bytes, model: Path) -> None:
    for arguments in (("verify", os.fsdecode(name)), ("diff", os.fsdecode(name), "out")):
        assert isinstance(run(*arguments).exception, EstimError)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_reports_of_single_runs_are_verified_with_the_report_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.toml").write_text(LINE + '[[runs]]\nname = "s"\nfile = "r.csv"\n')
    (tmp_path / "r.csv").write_text(
        "x,y\n" + "".join(f"{x},{1 + 2 * x + 0.1 * (-1) ** x}\n" for x in range(20))
    )
    run("fit", "campaign.toml", "--out", "out", "--figures", "none")
    done = run("verify", "out")
    assert done.exit_code == 0, done.output
    assert "r/result.json" in done.output
    changed(tmp_path / "out" / "s" / "result.json", '"n_obs": 20', '"n_obs": 19')
    resealed(tmp_path / "out" / "s", "result.json")
    done = run("verify", "out")
    assert done.exit_code == 3
    assert "s/result.json, runs.s.n_obs" in done.output


def test_every_kind_of_result_is_compared(model: Path) -> None:
    assert run("diff", "out", "out").output == "the results are the same\n"
    changed(model / "model.toml", "value = 2.0", "value = 5.0")
    assert run("propagate", "model.toml", "--out", "other", "--figures", "none").exit_code == 0
    told = run("diff", "out", "other").output
    assert "inputs.b: 2.000 ± 0.200 -> 5.000 ± 0.200, moved by +15.00 sd\n" in told
    assert re.search(r"\ny: .* m, moved by \+13\.\d\d sd\n", told), told
    assert "the same" not in told


def test_estimates_in_other_units_are_not_taken_for_moved() -> None:
    def fitted(slope: float, unit: str) -> dict[str, Any]:
        return {"parameters": {"a": {"mean": slope, "sd": 0.1 * slope, "unit": unit}}}

    pair = compare_results(fitted(2.0, "m/s"), fitted(200.0, "cm/s"))
    assert (pair.estimates, pair.lost, pair.gained) == ((), ("a (m/s)",), ("a (cm/s)",))
    assert compare_results(fitted(2.0, "m/s"), fitted(2.2, "m/s")).estimates[0].shift == (
        pytest.approx(1.0)
    )


def test_what_a_report_quotes_is_compared(model: Path) -> None:
    """The square of a value that may be 0: its first derivative, and the GUM's uncertainty, are
    0.
    """
    assert run("propagate", "g = a**2", "a=0(1)", "--out", "square").exit_code == 0
    told = run("diff", "square", "2.5(1)").output
    assert re.match(r"difference: −1.5, u = 1.4,", told), told
    assert "agree" in told
    assert "do not agree" not in told


def test_inputs_and_statuses_are_compared_too() -> None:
    one = {
        "schema": "estim-x/1",
        "status": "ok",
        "parameters": {"a": {"mean": 1.0, "sd": 0.1, "unit": "m"}},
    }
    assert compare_results(one, dict(one)).inputs == ()
    bad = {**one, "status": "poor-fit", "parameters": {"a": {"mean": None, "unit": "m"}}}
    pair = compare_results(one, bad)
    assert (pair.inputs, pair.lost) == (("status: ok and poor-fit",), ("a (m)",))
    runs = [
        {**one, "provenance": {"data_sha256": {"a/run.csv": digest, "b/run.csv": "z"}, "seed": n}}
        for n, digest in enumerate("xy")
    ]
    assert compare_results(*runs).inputs == (
        "provenance.data_sha256.a/run.csv differs",
        "provenance.seed: 0 and 1",
    )


@pytest.mark.parametrize(
    "record",
    [
        '{"provenance": null}',
        '{"provenance": 3}',
        '{"provenance": {"data_sha256": [1]}}',
        '{"a": 1e999}',
    ],
)
def test_a_result_written_by_hand_is_no_traceback(record: str, model: Path) -> None:
    (model / "hand.json").write_text(record.replace("{", '{"schema": "estim-x", ', 1))
    assert run("diff", "hand.json", "out").exit_code == 0


def test_a_file_that_cannot_be_read_any_more_is_there_when_it_is_recomputed() -> None:
    damaged = {"result.json": (b'{"a": 1.0} {', b'{"a": 1.0}')}
    (one,) = differences(damaged, same_versions=True)["result.json"]
    assert (one.wrong, one.now) == (True, "a file that can be read")
