"""Hostile strings in every text field of a campaign, through every command: nothing raw comes out,
and no report changes its shape.
"""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import PIXEL
from hostile import MOVES, STRINGS, outline, raw, seen, shown
from matplotlib.figure import Figure
from matplotlib.text import Text
from tracker_files import point_mass, trk

from estim.cli.commands import main
from estim.common.labels import Notation
from estim.reports.comparison import folder_of
from estim.reports.rendering import render
from estim.sampling.summary import Summary

FORGED = "a\x1b[2J\u202e | *b* <i>c</i> `d` [x](y) $e$\n\n# Forged\n\r|---|"
FILE = "r\x1b[31m\u202e *b* <i> `d` | [x](y) $e$\n# Forged.csv"
pytestmark = pytest.mark.filterwarnings(
    "ignore:Glyph", "ignore:Matplotlib currently does not", "ignore:.*is deprecated"
)


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str

    @property
    def one_line(self) -> bool:
        return (
            self.out == ""
            and self.err.startswith("error: ")
            and self.err.count("\n") == 1
            and self.err[:-1].isprintable()
        )


@pytest.fixture
def estim(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    def run(*arguments: str | Path) -> Done:
        monkeypatch.setattr(sys, "argv", ["estim", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return Done(ended.value.code, *capsys.readouterr())

    return run


def toml(text: str) -> str:
    """A TOML string, every mark but plain letters as an escape; surrogates cannot stand in one."""
    return (
        '"'
        + "".join(
            mark if mark.isascii() and mark.isalnum() else f"\\U{ord(mark):08x}" for mark in text
        )
        + '"'
    )


@pytest.fixture
def plain(estim, monkeypatch: pytest.MonkeyPatch):
    """The command for a harmless twin, whose figures nobody looks at."""

    def run(*arguments: str | Path) -> Done:
        with monkeypatch.context() as patched:
            patched.setattr("estim.reports.pages.png", lambda *_: PIXEL)
            return estim(*arguments)

    return run


def curve_campaign(folder: Path, word: str, file: str) -> Path:
    """A formula of the user's own with `word` in every text that is free."""
    folder.mkdir(parents=True)
    unit = re.sub(
        r"[\s$|\\`]",
        "",
        " ".join(word.split()).translate(dict.fromkeys(range(32))).replace("\u202e", ""),
    )[:19]
    (folder / file).write_text(
        f"# made by estim import\n# {one(word)}\n# warning: "
        f"{one(word)}\nt,_{one(word).replace(',', '')},y\n"
        + "".join(f"{0.1 * n:.1f},0,{1 + 0.2 * n + 0.01 * (-1) ** n:.3f}\n" for n in range(12))
    )
    (folder / "c.toml").write_text(f"""title = {toml(word)}
kind = "measured"
[curve]
expression = "a_b_c_ + print*x"
x = {{column = "t", name = {toml(unit)}, unit = {toml(unit)}}}
y = {{column = "y", name = {toml(unit)}, unit = {toml(unit)}}}
u_y = 0.01
[curve.parameters]
a_b_c_ = {{start = 1.0, unit = {toml(unit)}, meaning = {toml(unit)}}}
print = {{start = 1.0}}
[[runs]]
name = "r"
file = {toml(file)}
""")
    return folder / "c.toml"


def one(word: str) -> str:
    """`word` on one line of a CSV file: what ends a line cannot stand in a comment."""
    return " ".join(word.split())


def body_campaign(
    folder: Path, replica: Path, word: str, file: str, shared: str = "", run: str = "heavy-04"
) -> Path:
    """A run of the replica and its line, with `word` in every text that is free."""
    folder.mkdir(parents=True)
    (folder / file).write_text(f"# {one(word)}\n" + (replica / "runs" / "heavy-04.csv").read_text())
    (folder / f"line {file}").write_text(
        f"# {one(word)}\n" + (replica / "theta_min.csv").read_text()
    )
    (folder / f"paper {file}").write_text(
        f'paper = {toml(word)}\n[[number]]\nname = {toml(word)}\nparameter = "gamma"\nvalue '
        f"= 0.2\nunit = {toml(word)}\nsection = {toml(word)}\n"
    )
    (folder / "c.toml").write_text(f"""title = {toml(word)}
kind = "synthetic"
published = {toml(f"paper {file}")}
[shared]
radius_m = "0.14929(50)"
{shared}
rolling_resistance = {{prior = "half-normal", scale = 0.005}}
noise = {{sigma_x_m = 0.001, derivative = "central"}}
[bodies."heavy disk"]
mass_disk_kg = "0.3022(10)"
mass_particle_kg = "0.0725(46)"
kappa = {{prior = "uniform", low = 0.0, high = 1.0}}
[[runs]]
name = "{run}"
body = "heavy disk"
file = {toml(file)}
phi_deg = "4.00(40)"
theta0_deg = "60.8(1.5)"
[line]
file = {toml(f"line {file}")}
body = "heavy disk"
u_theta_min_deg = 1.5
u_phi_deg = 0.4
""")
    text = (folder / f"line {file}").read_text().replace(",u_phi_deg,u_theta_min_deg", "")
    (folder / f"line {file}").write_text(re.sub(r"(?m)^([\d.]+,[\d.]+),.*$", r"\1", text))
    return folder / "c.toml"


def written(folder: Path) -> dict[str, str]:
    """Every text file of a report, by its name, after a look at all names."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    assert files
    for path in files:
        assert not raw(str(path.relative_to(folder)))
        assert re.fullmatch(r"[\w./ +-]+", str(path.relative_to(folder)))
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in files
        if path.suffix in (".md", ".json")
    }


def compare_with_harmless(hostile: Path, harmless: Path) -> dict[str, str]:
    """The reports of two campaigns that differ in their texts alone: the same structure, and
    nothing raw.
    """
    texts, others = written(hostile), written(harmless)
    assert texts.keys() == others.keys()
    for name, text in texts.items():
        assert not raw(text), name
        if name.endswith(".md"):
            assert outline(text) == outline(others[name]), name
        else:
            json.loads(text)
    return texts


@pytest.mark.slow
def test_a_formula_with_hostile_texts(estim, plain, tmp_path: Path) -> None:
    hostile = curve_campaign(tmp_path / FORGED.replace("/", ""), FORGED, FILE.replace("/", ""))
    harmless = curve_campaign(tmp_path / "harmless", "word", "r.csv")
    done = estim("fit", hostile, "--out", tmp_path / "a", "--max-steps", "60")
    twin = plain("fit", harmless, "--out", tmp_path / "b", "--max-steps", "60")
    assert done.code == twin.code == 3
    assert not raw(done.out + done.err)
    assert done.out.count("\n") == twin.out.count("\n")
    texts = compare_with_harmless(tmp_path / "a", tmp_path / "b")
    assert json.loads(texts["result.json"])["title"] == FORGED
    assert seen(texts["report.md"]).startswith(f"{shown(FORGED)}: r\n")
    assert shown(FILE.replace("/", "")) in seen(texts["report.md"])


@pytest.fixture
def texts_of_figures(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every text of every figure that is made from here on, none of which is turned into pixels."""
    texts: list[str] = []

    def read(figure: Figure) -> bytes:
        figure.draw_without_rendering()
        texts.extend(text.get_text() for text in figure.findobj(Text))
        return PIXEL

    monkeypatch.setattr("estim.drawing.as_png", read)
    return texts


@pytest.mark.slow
@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize(
    "command",
    [
        ("fit", "--max-steps", "60"),
        ("line",),
        ("energy", "--max-steps", "60"),
        ("reanalyse", "--max-steps", "60", "--jobs", "1"),
        ("calibrate", "--simulations", "20", "--what", "sbc", "--jobs", "1"),
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_a_rolling_body_with_hostile_texts(
    estim,
    plain,
    tmp_path: Path,
    replica: Path,
    command: tuple[str, ...],
    request: pytest.FixtureRequest,
) -> None:
    """The figure of the energy alone has a text of the campaign's: it is drawn, as those of a
    formula are above.

    One of the commands speaks of an unmodelled force.
    """
    in_figures = [] if command[0] == "energy" else request.getfixturevalue("texts_of_figures")
    shared = "" if command[0] == "fit" else "unmodelled_force = 0"
    hostile = body_campaign(
        tmp_path / FORGED.replace("/", ""), replica, FORGED, FILE.replace("/", ""), shared
    )
    harmless = body_campaign(tmp_path / "harmless", replica, "word", "r.csv", shared)
    done = estim(command[0], hostile, *command[1:], "--out", tmp_path / "a")
    twin = plain(command[0], harmless, *command[1:], "--out", tmp_path / "b")
    assert done.code == twin.code
    assert done.code in (0, 3), done.err
    assert not raw(done.out + done.err)
    assert done.out.count("\n") == twin.out.count("\n")
    texts = compare_with_harmless(tmp_path / "a", tmp_path / "b")
    assert shown(FORGED) in seen(texts["report.md"])
    assert bool(in_figures) == (command[0] != "energy")
    assert not any("Forged" in text or raw(text) for text in in_figures)


def test_a_comparison_of_models_with_hostile_texts() -> None:
    """Its templates alone: sampling every model twice would take minutes."""
    row = SimpleNamespace(
        name="positions, student-t",
        status="ok",
        data="positions",
        n_obs=3,
        elpd=1.0,
        se_elpd=None,
        behind=1.0,
        se_behind=0.1,
        log_evidence=None,
        u_log_evidence=None,
        influential={"r": [0.1]},
        words="word",
        reasons=["word"],
        posterior={"g": Summary("1", "", 0.1, 0.2, 0.1, -0.3, -0.1, 0.3, 0.5)},
    )
    values = {"kind": "measured", "rows": [row], "influential": 0.7, "behind": 4.0}
    values |= {"folder": folder_of, "several_data": True, "verdict": "differ (γ)"}

    def common(symbol: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(name="g", label=Notation(symbol).label("1"))]

    plain = render(
        "compare.md.j2", title="word", runs=["r"], common=common("γ"), data=["positions"], **values
    )
    for text in filter(shown, STRINGS):
        hostile = SimpleNamespace(
            **vars(row)
            | {"words": text, "reasons": [text], "data": text, "influential": {text: [0.1]}}
        )
        report = render(
            "compare.md.j2",
            title=text,
            runs=[text],
            common=common(text),
            data=[text],
            **values | {"rows": [hostile], "verdict": f"differ ({text})"},
        )
        assert outline(report) == outline(plain), text
        assert seen(report).startswith(f"{shown(text)}: noise models of {shown(text)}\n")
        assert not raw(report)


@pytest.mark.parametrize("name", [text for text in STRINGS if "\x00" not in text], ids=ascii)
def test_import_says_names_of_tracks_and_files_literally(estim, tmp_path: Path, name: str) -> None:
    """A name in XML, in the head of the CSV and on the terminal; the CSV holds as many rows as the
    track.
    """
    legal = "".join(mark for mark in name if mark in "\t\n\r" or mark >= " ").replace("\ufff9", "")
    text = (
        legal.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("\r", "&#13;")
    )
    points = {n: (100.0 + n * n, 200.0 - 0.1 * n) for n in range(8)}
    (tmp_path / "clip.trk").write_text(
        trk(
            point_mass(text, points),
            point_mass("second " + text, {1: (1.0, 2.0)}),
            extra="",
            unit="m",
        )
    )
    done = estim("import", tmp_path / "clip.trk", "--track", "second", "-o", tmp_path / "r.csv")
    assert done.one_line
    assert done.code == 2
    done = estim(
        "import", tmp_path / "clip.trk", "--track", legal.strip() or legal, "-o", tmp_path / "r.csv"
    )
    assert not raw(done.out + done.err)
    if done.code == 0:
        lines = (tmp_path / "r.csv").read_text().split("\n")
        # header, and what follows the last end of line
        assert sum(not line.startswith("#") for line in lines) == 8 + 1 + 1
        assert all(not raw(line) for line in lines)
    else:
        assert done.one_line, done.err


@pytest.mark.slow
@pytest.mark.parametrize("text", STRINGS, ids=ascii)
def test_errors_quote_hostile_text_on_one_line(
    estim, tmp_path: Path, replica: Path, text: str
) -> None:
    campaign = (replica / "campaign.toml").read_text()
    (tmp_path / "runs").symlink_to(replica / "runs")
    (tmp_path / "theta_min.csv").symlink_to(replica / "theta_min.csv")
    broken = {
        "kind": campaign.replace('kind = "synthetic"', f"kind = {toml(text)}"),
        "value": campaign.replace('phi_deg = "1.10(40)"', f"phi_deg = {toml(text)}"),
        "key": campaign.replace("[shared]", f"[shared]\n{toml(text)} = 1.0"),
        "file": campaign.replace('file = "runs/heavy-02.csv"', f"file = {toml(text)}"),
        "run": campaign.replace('name = "heavy-02"', f"name = {toml('-' + text)}"),
        "body": campaign.replace('body = "heavy"', f"body = {toml(text)}"),
        "bodies": campaign + f"\n[bodies.{toml('-' + text)}]\nkappa = 0.4\n",
        "formula": 'title = "x"\nkind = "measured"\n[curve]\n'
        f'expression = {toml("import " + text)}\nx = "t"\ny = "y"\n[[runs]]\nname = '
        '"r"\nfile = "r.csv"\n',
    }
    for name, content in broken.items():
        (tmp_path / "c.toml").write_text(content)
        done = estim("fit", tmp_path / "c.toml", "--out", tmp_path / "out")
        assert done.code == 2, (name, done)
        assert done.one_line, (name, done)
    assert not (tmp_path / "out").exists()
    for arguments in (
        ("fit", replica / "campaign.toml", "--run", text),
        ("fit", tmp_path / f"no{text}"),
        ("fit", replica / "campaign.toml", f"--no{text}"),
    ):
        if "\x00" not in text:  # which no shell can pass on
            done = estim(*arguments)
            assert (done.code, done.one_line) == (2, True), (arguments, done)


@pytest.mark.parametrize("text", [move for move in MOVES if move != "\n"], ids=ascii)
def test_errors_of_a_table_quote_its_cells_on_one_line(estim, tmp_path: Path, text: str) -> None:
    for header, cell in (("t,y", text), (f"t,y,{text}", "1.0")):
        path = curve_campaign(tmp_path / f"{len(list(tmp_path.iterdir()))}", "word", "r.csv")
        (path.parent / "r.csv").write_bytes(f"{header}\n0.0,{cell}\n".encode() + b"1.0,2.0\n" * 12)
        done = estim("fit", path, "--out", tmp_path / "out")
        assert (done.code, done.one_line) == (2, True), done


@pytest.mark.usefixtures("undrawn")
def test_a_path_that_is_not_utf8(estim, tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"x\xff")
    try:
        path = curve_campaign(folder, "word", "r.csv")
    except (OSError, UnicodeError):
        pytest.skip("this file system takes no such name")
    done = estim("fit", path, "--out", folder / "out", "--max-steps", "60")
    assert done.code == 3, done.err
    assert "x\\xff/out/report.md" in done.out
    result = json.loads((folder / "out" / "result.json").read_text())
    assert result["provenance"]["campaign"].endswith("x\\xff/c.toml")
    assert "x\\xff/c.toml" in seen((folder / "out" / "report.md").read_text())
    assert estim("fit", folder / "no.toml").one_line


def test_a_body_name_that_would_lead_out_of_the_report_is_refused(
    estim, tmp_path: Path, replica: Path
) -> None:
    text = (
        (replica / "campaign.toml")
        .read_text()
        .replace('"heavy"', '"../../heavy"')
        .replace("[bodies.heavy]", '[bodies."../../heavy"]')
    )
    (tmp_path / "c.toml").write_text(text)
    done = estim("reanalyse", tmp_path / "c.toml", "--out", tmp_path / "out")
    assert (done.code, done.one_line) == (2, True)
    assert re.search(r"c.toml:\d+: 'bodies' must be made of letters, digits, blanks", done.err)


def test_a_simulated_campaign_holds_what_its_design_says(
    estim, tmp_path: Path, replica: Path
) -> None:
    import tomllib

    design = (replica / "design.toml").read_text().replace("heavy", "heavy disk")
    design = re.sub(r"\[bodies\.(heavy disk)\]", r'[bodies."\1"]', design)
    design = re.sub(r'(?m)^name = "heavy disk', 'name = "heavy', design)
    design = re.sub(r"(?m)^title = .*$", lambda _: f"title = {toml(FORGED)}", design)
    (tmp_path / "d\n[x]\x1b.toml").write_text(design)
    done = estim("simulate", tmp_path / "d\n[x]\x1b.toml", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    text = (tmp_path / "out" / "campaign.toml").read_text()
    assert not raw(text)
    tree = tomllib.loads(text)
    assert tree["title"] == FORGED
    assert "heavy disk" in tree["bodies"]
    assert "gamma[heavy disk]" in tomllib.loads((tmp_path / "out" / "truth.toml").read_text())
