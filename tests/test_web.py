"""The page in the browser: the ways through it, over HTTP, and each line of its safety attacked."""

from __future__ import annotations

import ast
import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from urllib.parse import urlencode

import forked_workers
import numpy as np
import pytest
from command_runner import runner
from conftest import REAL
from markupsafe import escape
from tracker_files import point_mass, trk
from web_pages import Browser, entered, served, words
from workbooks import xlsx

from estim import drawing
from estim.campaign import choices_of_table
from estim.cli.commands import cli, fit
from estim.common import EstimError, InputError
from estim.curves.models import read_model
from estim.plugins import plugins
from estim.web import At
from estim.web.job_queue import Job, JobQueue
from estim.web.labels import LABELS, on_page
from estim.web.listening import listening
from estim.web.preview import _start, _table
from estim.web.question import MODELS, arguments_of, fields_of, options_of
from estim.web.store import MOST_BYTES, MOST_FILES, Store

LINE = b"t [s],U [V],u_U\n0,1.02,0.1\n1,2.95,0.1\n2,5.1,0.1\n3,6.97,0.1\n4,9.02,0.1\n"
SLOW = "a*exp(-x/tau) + c + d*x"


# of a process of the tests, several of which may share this file
@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("answers")


@pytest.fixture(scope="session")
def address(folder: Path) -> Iterator[str]:
    with served(folder) as address:
        yield address


@pytest.fixture
def browser(address: str) -> Browser:
    return entered(address)


@pytest.fixture
def real_workers() -> None:
    """Workers are processes of their own from the start and do all that they do for users."""


@pytest.fixture(autouse=True)
def workers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "real_workers" not in request.fixturenames and sys.platform != "win32":
        monkeypatch.setattr(Job, "_started", forked_workers.started)


# ---- the way through ----


def test_ends_of_a_column_that_differ_are_shown_as_different(browser: Browser) -> None:
    data = b"t,f\n" + b"".join(b"%d,10000000.%d\n" % (1_700_000_000 + i, i) for i in range(1, 9))
    form = words(browser.get(browser.hand_in({"counter.csv": data}).place).text)
    assert "1700000001 1700000008" in form
    assert "10000000.1 10000000.8" in form


@pytest.mark.slow
def test_from_a_file_to_a_report_and_the_command_that_repeats_it(
    browser: Browser, tmp_path: Path, real_workers: None
) -> None:
    asked = browser.hand_in({"Spring & load.csv": LINE})
    assert asked.status == 303
    question = browser.get(asked.place)
    assert "Spring &amp; load.csv" in question.text
    assert "t s 5 0 4" in words(question.text)
    picture = browser.get(f"{asked.place}/points-0-1.png")
    assert picture.body.startswith(b"\x89PNG")
    answer = browser.fill_in(asked.place, asked="line", x="t", y="U")
    page = browser.ended(answer.place)
    assert "line: ok" in page.text
    report = browser.get(f"{answer.place}/report/report.html")
    assert report.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
    assert "frame-ancestors 'none'" in report.headers["content-security-policy"]
    (picture,) = re.findall('<img src="([^"]*)"', page.text)
    assert browser.get(picture).body.startswith(b"\x89PNG")
    packed = zipfile.ZipFile(io.BytesIO(browser.get(f"{answer.place}/all.zip").body))
    packed.extractall(tmp_path)
    command = shlex.split((tmp_path / "command.txt").read_text().splitlines()[-1])
    assert unescape(page.text).count(shlex.join(command)) == 1
    before = {name: (tmp_path / name).read_bytes() for name in packed.namelist()}
    assert command[:2] == ["estim", "line"]
    # a report of another command is never overwritten, but the same command writes the same bytes
    subprocess.run(
        [sys.executable, "-m", *command],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    )
    after = {name: (tmp_path / name).read_bytes() for name in packed.namelist()}
    assert after == before


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        (
            "'--window' must be written MIN:MAX: 0-1",
            "“Range of x that is fit (window)” must be wri",
        ),
        ("command line: 'window' must leave", "“Range of x that is fit (window)” must leave"),
        ("'--rolling radius_m' must be > 0", "“Radius R (m)” must be > 0"),
        (
            "t.csv: has no scatter; give --uy",
            "t.csv: has no scatter; give “Uncertainty of y (u_y)”",
        ),
        ("one (--sheet NAME; sheet = ... in a campaign)", "one (“Sheet of a workbook” NAME)"),
        ('--decimal point (decimal = "point" in a campaign)', "“Decimal mark” point"),
        ("1 (--start a=1, or {start = 1.0} in a campaign)", "1 (“Starting values” a=1)"),
        ("by --release T (in a campaign: release)", "by “Release” T"),
        # what is no field of the page, and names of others that only look like it
        ("command line: 'gamma' is not determined", "'gamma' is not determined"),
        ("say --frame-ms or x--y", "say --frame-ms (at the command line) or x--y"),
        ("repeat with another seed (--seed), and", "repeat with another seed (“Seed of the random"),
        (
            "UTF-16 without its mark: --encoding utf-16; encoding = ... in a campaign)",
            "UTF-16 without its mark: “Encoding of the letters” utf-16)",
        ),
        ("'--start a' must be a number: b", "“Starting values” a must be a number: b"),
        ("Invalid value for '--uy' / '--u-y': 3", "Invalid value for “Uncertainty of y (u_y)”: 3"),
        ("'--u-y' (or --uy) must", "“Uncertainty of y (u_y)” must"),
        *(
            (words, words)  # what users wrote
            for words in (
                "formula 'a*x --g*b': unknown",
                "formula 'a*x --g': unknown",
                "'formula' is no formula: a*x --g*b",
                "file '--title.csv'",
                "--title.csv: no such file",
                "data from a class (2024 in a campaign): values",
                "data (in a campaign: of 2024): values",
            )
        ),
    ],
)
def test_a_message_of_the_command_line_names_the_fields_of_the_page(said: str, shown: str) -> None:
    assert on_page(said).startswith(shown)
    assert said != shown or on_page(said) == said


@pytest.mark.slow
def test_what_is_said_of_a_campaign_is_not_said_on_the_page() -> None:
    """Of every message of the package that says in brackets what a campaign has."""
    said = []
    for path in (Path(__file__).parents[1] / "estim").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            parts = node.values if isinstance(node, ast.JoinedStr) else [node]
            words = "".join(
                str(part.value) if isinstance(part, ast.Constant) else "5"
                for part in parts
                if isinstance(part, ast.Constant | ast.FormattedValue)
            )
            if re.search(r"\w.* in a campaign\)|\(in a campaign:", words) and "\n" not in words:
                said.append(words)
    assert len(said) > 12
    assert [words for words in said if "in a campaign" in on_page(words)] == []


def test_every_field_of_a_question_has_a_label() -> None:
    root = Path(__file__).parents[1] / "estim" / "web" / "templates"
    form = (root / "question.html.j2").read_text()
    used = re.findall(r'\b(?:text|lines|choice|column)\("([\w-]+)"|labels\.(\w+)', form)
    assert {one or other for one, other in used} == set(LABELS)


@pytest.mark.slow
def test_no_option_is_left_in_what_a_newcomer_meets(browser: Browser) -> None:
    """Errors of the import and of the question: said in the words of the page."""
    header = browser.hand_in({"bare.csv": LINE.partition(b"\n")[2]})
    shown = browser.get(header.place).text
    assert "“Names of the columns”" in shown
    named = browser.fill_in(header.place, asked="line", x="t", y="U", columns="t, U, u_U")
    assert "line: ok" in browser.ended(named.place).text
    asked = browser.hand_in({"line.csv": LINE})
    for fields in (
        {"formula": "a*b*x"},
        {"formula": "a*x + b", "window": "0-1"},
        {"formula": "a*x + b", "window": "0:1"},
        {"formula": "a*x + b", "value": "q = 1"},
        {"formula": "a*x +"},
        {"formula": "a*x + b", "u-y": "v"},
    ):
        answer = browser.fill_in(asked.place, asked="formula", x="t", y="U", **fields)
        refused = browser.ended(answer.place)
        assert refused.status == 303
        (message,) = re.findall('class="error"[^>]*>(.*?)<', browser.get(refused.place).text)
        assert not re.search("--[a-z]|campaign|command line|\\[curve", unescape(message)), message


@pytest.mark.slow
def test_what_is_not_reliable_says_so_and_has_its_report(browser: Browser) -> None:
    bent = "x,y\n" + "".join(f"{x},{x * x + 0.01 * (x % 3)}\n" for x in range(12))
    asked = browser.hand_in({"bent.csv": bent.encode()})
    answer = browser.fill_in(asked.place, asked="formula", formula="a*x + b", **{"u-y": "0.1"})
    page = browser.ended(answer.place)
    assert "Not reliable as it stands" in page.text
    assert browser.get(f"{answer.place}/report/report.md?download=1").status == 200


GALLERY = Path(__file__).parents[1] / "data" / "gallery"
BOILING = "1.8/(1/(T0 + 273.15) - 8.314462618/(1000*L)*log(pressure_inHg/29.9213)) - 459.67"
DRAG = "bias - D*(time_s/0.621)**{power}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "fields", "told", "choice", "further"),
    [
        (  # a blunder
            "forbes_1857.csv",
            {
                "formula": BOILING,
                "x": "pressure_inHg",
                "y": "boiling_F",
                "start": "L = 40\nT0 = 100",
            },
            "one point lies much farther from the curve than the others",
            "robust",
            {},
        ),
        (  # errors that were stated too small
            "table_30cm.csv",
            {"formula": "L", "x": "student", "y": "length_m", "u-y": "u_m"},
            "the points lie 8.7 times as far from the curve as their errors explain",
            "jitter",
            {},
        ),
        (  # determinations that follow each other are alike
            "michelson_1879.csv",
            {"formula": "c", "x": "determination", "y": "speed_Mm_s"},
            "neighbouring points lie off the curve by similar amounts",
            "correlated",
            {},
        ),
        (  # counts, of which those of the start are the less certain
            "muon.csv",
            {"formula": "A*exp(-t_us/tau) + B", "x": "t_us", "y": "N"},
            "the points scatter more about one part of the curve than about another",
            "u-y",
            {"u-y": "sN"},
        ),
        (  # the moment of release and the power of the time are told apart by neither
            "falling_phone.csv",
            {
                "formula": "bias - D*((time_s - t0)/0.621)**n",
                "x": "time_s",
                "y": "az_m_s2",
                "window": "0.019:0.618",
                "start": "n = 3\nt0 = 0",
                "low": "n = 0\nt0 = -0.5",
                "high": "n = 30\nt0 = 0.015",
            },
            "data and priors do not determine the parameters",
            "value",
            {"value": "t0 = 0.0000(25)"},
        ),
        (  # a wrong curve: the reader writes another
            "falling_phone.csv",
            {
                "formula": DRAG.format(power=2),
                "x": "time_s",
                "y": "az_m_s2",
                "window": "0.019:0.618",
            },
            "the points drift slowly from one side of the curve to the other",
            "formula",
            {"formula": DRAG.format(power="n"), "start": "n = 3", "low": "n = 0", "high": "n = 30"},
        ),
    ],
)
def test_what_is_advised_is_one_click_and_cures(
    browser: Browser,
    file: str,
    fields: dict[str, str],
    told: str,
    choice: str,
    further: dict[str, str],
) -> None:
    """Real data that are not ok as they were asked, and are with the one field that the page offers
    to change.
    """
    data = muon_counts() if file == "muon.csv" else (GALLERY / file).read_bytes()
    asked = browser.hand_in({file: data})
    first = browser.ended(browser.fill_in(asked.place, asked="formula", **fields).place)
    assert told in words(first.text)
    places = re.findall('class="button" href="(/files/[^"]*)#([^"]*)"', first.text)
    of_t0 = "t0+%3D+" if choice == "value" else ""
    place = next(unescape(at) for at, name in places if name == choice and at.endswith(of_t0))
    form = browser.get(place).text
    assert re.search(f'id="{choice}"', form)  # where the address leads
    filled = filled_in(form)
    kept = {name: text for name, text in filled.items() if name in fields and name != choice}
    assert kept == {
        name: re.sub("\nt0 = .*", "", text)  # what is known stands in the place of a start
        for name, text in fields.items()
        if name != choice
    }
    changed = {name for name in CURES if filled.get(name, "") != fields.get(name, "")}
    assert changed == {choice} & {*CURES}
    again = browser.fill_in(place.partition("?")[0], **filled | further)
    assert re.search('class="state ok"', browser.ended(again.place).text)
    assert "What you can try" not in browser.get(again.place).text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fields", "offered"),
    [
        ({}, ["formula", "correlated"]),  # first what is most likely
        ({"u-y": "5%"}, ["formula"]),
        ({"u-y": "1", "u-x": "0.1"}, ["formula"]),
        ({"u-y": "1", "robust": "student-t"}, ["formula"]),
        ({"u-y": "1", "jitter": "on"}, ["formula"]),
    ],
)
def test_no_cure_is_offered_that_the_question_would_refuse(
    browser: Browser, fields: dict[str, str], offered: list[str]
) -> None:
    rows = (f"{x},{100 + x**2 + x % 2}" for x in range(40))
    asked = browser.hand_in({"parabola.csv": "\n".join(["x,y", *rows]).encode()})
    said = {"asked": "formula", "formula": "a + b*x", "x": "x", "y": "y"} | fields
    answer = browser.ended(browser.fill_in(asked.place, **said).place)
    assert re.findall('class="button" href="/files/[^"]*#([^"]*)"', answer.text) == offered


@pytest.mark.slow
def test_where_no_causes_are_known_none_are_told_of(browser: Browser) -> None:
    rows = (f"{x},{300 + (x - 20) ** 2 // 5 + x % 2 * 3}" for x in range(40))
    asked = browser.hand_in({"counts.csv": "\n".join(["x,y", *rows]).encode()})
    said = {"asked": "formula", "formula": "a + b*x", "x": "x", "y": "y", "noise": "poisson"}
    place = browser.fill_in(asked.place, **said).place
    answer = words(browser.ended(place).text)
    assert "counts: poor-fit" in answer
    assert "causes" not in answer
    report = browser.get(f"{place}/report/report.html").text
    assert "Possible missing effects" not in words(report)


CURES = ("robust", "jitter", "correlated", "value")


def muon_counts() -> bytes:
    """The bins of the muon decays as a table of readings with their square roots."""
    low, high, n = np.loadtxt(
        GALLERY / "muon_binned.csv", delimiter=",", skiprows=1, unpack=True, comments="#"
    )
    rows = zip((low + high) / 2, n, np.sqrt(n), strict=True)
    return "\n".join(["t_us,N,sN", *(f"{x:.3f},{y:.0f},{u:.2f}" for x, y, u in rows)]).encode()


def filled_in(form: str) -> dict[str, str]:
    """The fields of a page of a question as a browser sends them."""
    found = re.findall('<input id="([^"]*)" name="[^"]*" value="([^"]*)"', form)
    found += re.findall('<textarea id="([^"]*)"[^>]*>([^<]*)<', form)
    for name, options in re.findall('<select id="([^"]*)".*?>(.*?)</select>', form, re.DOTALL):
        found += [(name, value) for value in re.findall('value="([^"]*)" selected', options)]
    for ticked in re.findall("<input[^>]* checked>", form):
        name = re.findall('name="([^"]*)"', ticked)[0]
        found.append((name, (re.findall('value="([^"]*)"', ticked) or ["on"])[0]))
    return {name: unescape(value) for name, value in found if value}


def test_a_refused_question_comes_back_with_its_fields_and_the_message_beside_one(
    browser: Browser,
) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    answer = browser.fill_in(
        asked.place, asked="formula", formula="a*q(x) +", value="a = 2", window="0:3"
    )
    page = browser.ended(answer.place)
    assert page.status == 303
    form = browser.get(page.place).text
    assert 'value="a*q(x) +"' in form
    assert ">a = 2</textarea>" in form
    assert 'value="0:3"' in form
    (message,) = re.findall(r'<span class="error" id="wrong-formula"[^>]*>(.*?)</span>', form)
    assert unescape(message).startswith("“Formula” is not a formula")
    nothing = browser.fill_in(asked.place, asked="formula")
    assert nothing.status == 422
    assert "Write a formula, or choose a model." in nothing.text


def test_a_model_is_chosen_without_javascript(browser: Browser) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    form = browser.get(asked.place).text
    assert 'aria-pressed="true"' not in form
    (formula,) = re.findall('name="model" value="([^"]*)"[^>]*>[^>]*> *gaussian . line<', form)
    said = urlencode({"asked": "formula", "value": "", "model": formula, "u-y": "0.2"})
    page = browser.get(f"{asked.place}?{said}")
    assert f'name="formula" value="{formula}"' in page.text
    assert re.findall('value="([^"]*)" aria-pressed="true"', page.text) == [formula]
    assert 'value="0.2"' in page.text
    answer = browser.fill_in(asked.place, asked="formula", formula=MODELS["line"], x="t", y="U")
    assert "--formula=line" in browser.get(answer.place).text


def test_the_formulas_that_a_click_writes_are_those_of_the_models() -> None:
    assert {name: read_model(name).formula.text for name in MODELS} == MODELS


def test_the_start_that_is_drawn_is_that_of_the_command() -> None:
    fields = {
        "formula": "a*exp(-x/tau)",
        "x": "t",
        "y": "U",
        "u-y": "0.1",
        "window": "0:3",
        "start": "tau = 2; a = 1",
        "low": "tau = 0",
        "correlated": "on",
        "columns": "t, U",
        "skip-rows": "2",
        "decimal": "comma",
        "encoding": "latin-1",
    }
    command = arguments_of(fields, "data.csv", "data")
    said = fit.make_context("fit", command[1:]).params
    assert choices_of_table(options_of(fields)) == choices_of_table(said)


@pytest.mark.slow
def test_the_start_of_a_curve_is_drawn_and_told(browser: Browser) -> None:
    """Of a curve that is linear the values are those of least squares; others are found."""
    asked = browser.hand_in({"line.csv": LINE})

    def shown(**fields: str) -> str:
        said = urlencode({"asked": "formula", "show": "start", "x": "t", "y": "U", **fields})
        return browser.get(f"{asked.place}?{said}").text

    form = shown(formula="a*t + b", value="b = 1", start="")
    (picture,) = re.findall(r'src="(/files/[^"]*/start-\d+\.png)"', form)
    assert browser.get(picture).body.startswith(b"\x89PNG")
    t, u = np.arange(5.0), np.array([1.02, 2.95, 5.1, 6.97, 9.02])
    assert f"a = {t @ (u - 1.0) / (t @ t):.4g}<" in form
    assert 'value="a*t + b"' in form
    form = shown(formula="a*exp(t/tau)", start="tau = 3\na = 2")
    assert "a = 2, tau = 3<" in form
    for fields, field in (({"formula": "a*("}, "formula"), ({"formula": "a*t", "low": "a"}, "low")):
        form = shown(**fields)
        assert f'id="wrong-{field}"' in form
        assert "/start-" not in form
    assert 'id="wrong-formula"' in shown()
    assert browser.get(f"{asked.place}/start-1.png").status == 404
    assert browser.get(f"{asked.place}/start-../x.png").status == 404


def test_a_start_that_takes_long_is_searched_for_once_and_says_what_to_do(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = browser.send("POST", "/examples/cooling").place
    assert "tau" in browser.get(asked).text
    begun: list[Job] = []
    submit = JobQueue.submit
    monkeypatch.setattr(
        JobQueue, "submit", lambda self, job, then: (begun.append(job), submit(self, job, then))[1]
    )
    monkeypatch.setattr("estim.web.pages._PATIENCE", 0.0)
    place = f"{asked}?{urlencode({'asked': 'formula', 'show': 'start', 'formula': SLOW})}"
    for _ in range(2):
        form = browser.get(place).text
        assert "Starting values are being searched for, which takes up to 60 s" in form
        assert 'http-equiv="refresh"' in form
    assert len(begun) == 1
    monkeypatch.setattr("estim.web.pages._PATIENCE", 60.0)
    assert "/start-" in browser.get(place).text
    assert len(begun) == 1
    monkeypatch.setattr("estim.web.pages._PREVIEW_SECONDS", 0)
    form = browser.get(place.replace("formula=", "formula=2*")).text
    assert "The search for starting values was ended after 0 s. State one or more" in form
    assert 'http-equiv="refresh"' not in form


def test_a_pdf_where_weasyprint_is_and_how_to_get_one_elsewhere(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    answer = browser.fill_in(asked.place, asked="line", x="t", y="U")
    browser.ended(answer.place)
    monkeypatch.setattr("estim.web.pages.find_spec", lambda name: None)
    page = browser.get(answer.place).text
    assert "report.pdf" not in page
    assert "estim[pdf]" in page
    monkeypatch.setattr("estim.web.pages.find_spec", lambda name: name)
    assert "/report.pdf" in browser.get(answer.place).text
    paper = browser.get(f"{answer.place}/report.pdf")
    try:
        import weasyprint  # noqa: F401
    except (ImportError, OSError):
        assert paper.status == 503
        assert "print the report." in paper.text
        return
    assert paper.body.startswith(b"%PDF")
    assert paper.headers["content-disposition"] == "attachment"


def test_a_mean_a_workbook_and_a_formula_of_values(browser: Browser) -> None:
    rows = [["day", "length [cm]"], *([i // 2, 10.0 + 0.1 * i] for i in range(6))]
    asked = browser.hand_in({"lengths.xlsx": xlsx({"Sheet": rows})})
    answer = browser.fill_in(asked.place, asked="mean", y="length")
    assert "mean: ok" in browser.ended(answer.place).text
    answer = browser.fill_in(
        "/propagate", formula="g = 4*pi**2*L/T**2", values="L = 0.85(1) m\nT=1.851(3) s"
    )
    assert "9.79" in browser.ended(answer.place).text


@pytest.mark.slow
def test_a_rolling_disk_is_asked_with_what_is_known_of_it(browser: Browser, replica: Path) -> None:
    data = (replica / "runs" / "heavy-04.csv").read_bytes()
    asked = browser.hand_in({"Heavy 4.csv": data})
    fields = {"asked": "rolling", "x": "t_s", "y": "x_m", "phi_deg": "3.69(40)", "radius_m": "x"}
    fields |= {"theta0_deg": "61.7(1.5)", "sigma_x_m": "0.001"}

    def beside(form: str, key: str) -> str:
        (message,) = re.findall(rf'<span class="error" id="wrong-{key}"[^>]*>(.*?)</span>', form)
        assert form.count('class="error"') == 1
        return unescape(message)

    reply = browser.fill_in(asked.place, **fields)
    assert reply.status == 422
    assert beside(reply.text, "gamma") == "This value is needed."
    fields["gamma"] = "0.193(10)"
    page = browser.ended(browser.fill_in(asked.place, **fields).place)
    assert "'radius_m' must be a number" in beside(browser.get(page.place).text, "radius_m")
    fields["radius_m"] = "-0.15"  # what only the campaign can see
    page = browser.ended(browser.fill_in(asked.place, **fields).place)
    form = browser.get(page.place).text
    assert "'radius_m'" in beside(form, "radius_m")
    assert 'value="3.69(40)"' in form
    fields["radius_m"] = "0.14929(50)"
    answer = browser.fill_in(asked.place, **fields)
    page = browser.ended(answer.place)
    assert "heavy-4: ok" in page.text
    report = browser.get(f"{answer.place}/report/report.html").text
    assert "Heavy 4" in report
    command = shlex.split(unescape(re.findall(r"<code>(estim .*?)</code>", page.text)[0]))
    assert command[:3] == ["estim", "fit", "heavy-4.csv"]
    assert "--rolling=gamma=0.193(10)" in command


def test_a_message_about_no_field_of_the_question_stands_above_it(browser: Browser) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    fields = {"asked": "formula", "formula": "gamma*t + b", "x": "t", "y": "U"}
    page = browser.ended(browser.fill_in(asked.place, **fields, value="gamma = x").place)
    assert 'id="wrong-value"' in browser.get(page.place).text
    # a parameter has the name of a field of another question
    page = browser.ended(
        browser.fill_in(asked.place, **fields, low="gamma = 9", high="gamma = 8").place
    )
    assert browser.get(page.place).text.count('class="error"') == 1


@pytest.mark.skipif(not REAL.is_dir(), reason="the real recordings are not here")
def test_a_real_export_of_tracker_as_a_rolling_disk(browser: Browser) -> None:
    data = (REAL / "rolling_ball" / "kulefullbane.txt").read_bytes()
    asked = browser.hand_in({"kulefullbane.txt": data})
    form = browser.get(asked.place).text
    assert 'name="imported"' in form
    assert 'name="release"' in form
    assert 'name="offset_m"' not in form
    fields = {"asked": "rolling", "imported": "1", "x": "t", "y": "x", "unit": "cm", "gamma": "0"}
    fields |= {"radius_m": "0.010(1)", "phi_deg": "-3(1)", "theta0_deg": "0", "kappa": "0.4"}
    page = browser.ended(browser.fill_in(asked.place, **fields, sigma_x_m="1").place)
    form = browser.get(page.place).text
    (message,) = re.findall(r'id="wrong-sigma_x_m"[^>]*>(.*?)</span>', form)
    assert "must be well below the length of the run" in unescape(message)


def test_the_columns_of_a_recording_of_tracker(browser: Browser) -> None:
    points = {i: (300.0 + 40.0 * i, 240.0) for i in range(8)}
    asked = browser.hand_in({"film.trk": trk(point_mass("ball", points)).encode()})
    form = browser.get(asked.place).text
    assert "x_m m 8" in words(form)
    assert "track &#39;ball&#39;" in form
    assert browser.get(f"{asked.place}/points-0-3.png").status == 200


def test_of_several_tracks_one_is_chosen_and_of_two_axes_the_livelier(browser: Browser) -> None:
    falls = {i: (300.0, 240.0 + 2.0 * i * i) for i in range(12)}
    other = {i: (300.0 + 40.0 * i, 240.0) for i in range(12)}
    data = trk(point_mass("ball", falls), point_mass("cart", other)).encode()
    asked = browser.hand_in({"film.trk": data})
    form = browser.get(asked.place).text
    assert "There are several tracks; this is ball." in form
    assert re.findall(r'<option value="(ball|cart)"', form) == ["ball", "cart"]
    assert '<option value="y" selected>' in form
    asked = browser.hand_in({"film.trk": trk(point_mass("ball", falls)).encode()})
    form = browser.get(asked.place).text
    assert 'name="track"' not in form
    assert re.findall('id="asked-([a-z]+)"', form) == ["formula", "rolling"]  # others read tables


def test_a_film_without_marked_points_is_sent_back_to_tracker(browser: Browser) -> None:
    points = {i: (300.0 + 40.0 * i, 240.0) for i in range(8)}
    for tracks in ((), (point_mass("ball", {0: (300.0, 240.0)}),)):
        asked = browser.hand_in({"film.trk": trk(*tracks).encode()})
        form = browser.get(asked.place).text
        assert "mark the positions of a point mass in more frames" in form
        assert ">Another file</a>" in form
        assert "<form" not in form
    data = trk(point_mass("ball", points)).encode()
    assert "<form" in browser.get(browser.hand_in({"film.trk": data}).place).text


def test_what_a_straight_line_and_the_model_line_are_each_for(browser: Browser) -> None:
    form = words(browser.get(browser.hand_in({"line.csv": LINE}).place).text)
    assert "choose a curve and the model line." in form


def test_a_column_of_one_value_is_not_asked_about(browser: Browser) -> None:
    data = b"date,t [s],U [V]\n" + b"".join(b"2026-03-04,%d,%d\n" % (i, 2 * i) for i in range(9))
    form = browser.get(browser.hand_in({"line.csv": data}).place).text
    assert re.findall('<option value="([^"]*)" selected', form)[:2] == ["t", "U"]


@pytest.mark.slow
def test_a_campaign_with_its_tables(browser: Browser, project: Path) -> None:
    home = project / "data" / "gallery"
    names = ("michelson_mean.toml", "michelson_1879.csv")
    text = (home / names[0]).read_text()
    assert names[1] in text
    asked = browser.hand_in({name: (home / name).read_bytes() for name in names})
    form = browser.get(asked.place).text
    runs = re.findall(r'name="runs" value="([^"]*)"', form)
    assert runs
    answer = browser.fill_in(asked.place, runs=runs[0])
    page = browser.ended(answer.place)
    assert page.status == 200, page.text
    assert f"estim fit campaign.toml --run={runs[0]}" in unescape(page.text)


def test_a_preview_that_fails_is_said_and_tried_no_further(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = b"t,U\n" + b"".join(
        b"%d,%d\n" % (i, 2 * i) for i in range(50_000)
    )  # longer than at once
    asked = browser.hand_in({"line.csv": long})
    monkeypatch.setattr("estim.web.pages._PREVIEW_SECONDS", 0)
    form = browser.get(asked.place).text
    assert "What is in the file cannot be shown" in form
    assert 'http-equiv="refresh"' not in form


def test_an_example_is_one_click(browser: Browser) -> None:
    asked = browser.send("POST", "/examples/cooling")
    form = browser.get(asked.place).text
    assert 'value="room + excess*exp(-t/tau)"' in form
    assert '<option value="synthetic" selected>' in form
    assert browser.send("POST", "/examples/..").status in (404, 405)
    assert browser.send("POST", "/examples/none").status == 404


def test_a_file_that_cannot_be_read_says_why_and_several_are_listed(browser: Browser) -> None:
    asked = browser.hand_in({"bad.csv": b"\x00\x01\x02"})
    form = browser.get(asked.place)
    assert form.status == 200
    assert "The file cannot be read as it is" in form.text
    asked = browser.hand_in({"Länge_1 αβ.csv": b"x,y\n1,2\n2,3.1,a draught\n3,4\n4,5.1\n"})
    assert "as it is: Länge_1 αβ.csv:3:" in words(browser.get(asked.place).text)
    browser.hand_in({"one.csv": LINE, "two.csv": LINE})
    page = browser.get("/").text
    assert ">one.csv<" in page
    assert ">two.csv<" in page
    assert browser.hand_in({"": b""}).status == 422
    refused = browser.hand_in({"run.exe": b"MZ"})
    assert refused.status == 422
    assert "run.exe is not one of" in refused.text


def test_the_page_speaks_spanish_where_the_browser_or_its_reader_asks(browser: Browser) -> None:
    spanish = {"Accept-Language": "es-AR,es;q=0.9,en;q=0.8"}
    page = browser.send("GET", "/", headers=spanish)
    assert '<html lang="es">' in page.text
    assert "Obtener" not in browser.get("/").text
    chosen = browser.send(
        "GET", "/language/es", headers={"Referer": f"http://{browser.address}/propagate"}
    )
    assert chosen.place == "/propagate"
    assert "Propagar incertidumbres" in browser.get("/propagate").text
    asked = browser.hand_in({"line.csv": LINE})
    answer = browser.fill_in(asked.place, asked="line")
    assert "--lang es" in browser.ended(answer.place).text
    report = browser.get(f"{answer.place}/report/report.html").text
    assert '<html lang="es">' in report
    elsewhere = {"Referer": "http://elsewhere.example//evil.example/"}
    assert browser.send("GET", "/language/en", headers=elsewhere).place == "/evil.example/"
    assert browser.get("/language/fr").status == 404


def test_the_first_page_is_small_and_asks_nothing_from_elsewhere(browser: Browser) -> None:
    page = browser.get("/")
    parts = re.findall(r'(?:src|href)="(/static/[^"]*)"', page.text)
    size = len(page.body) + sum(len(browser.get(part).body) for part in set(parts))
    assert len(set(parts)) == 3
    assert size < 50_000
    for place in ("/", "/propagate", *parts):
        assert not re.findall(r"(?<!xmlns=\")https?://", browser.get(place).text), place
    script = Path(__file__).parents[1] / "estim" / "web" / "static" / "estim.js"
    assert len(script.read_text().splitlines()) <= 150


# ---- several files, and a class ----


def decay(size: float, seed: int = 1, tau: float = 3.0) -> bytes:
    """A table of size*exp(-t/tau) with errors of 0.02."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 9.0, 25)
    u = size * np.exp(-t / tau) + 0.02 * rng.standard_normal(t.size)
    rows = "".join(f"{a:.3f},{b:.5f}\n" for a, b in zip(t, u, strict=True))
    return f"t [s],U [V]\n{rows}".encode()


DECAY = {"formula": "a*exp(-t/tau)", "x": "t", "y": "U", "u-y": "0.02"}


def repeated(browser: Browser, answer: str, folder: Path) -> None:
    """Repeats an answer by the command of its download, to the last byte but in draws.nc, into
    which older h5netcdf writes the time of day.
    """

    def files() -> dict[str, bytes]:
        """With no digest of draws.nc either."""
        return {
            name: re.sub(rb'"draws.nc": "[0-9a-f]{64}"', b"", (folder / name).read_bytes())
            for name in packed.namelist()
            if not name.endswith("draws.nc")
        }

    packed = zipfile.ZipFile(io.BytesIO(browser.get(f"{answer}/all.zip").body))
    packed.extractall(folder)
    before = files()
    command = shlex.split((folder / "command.txt").read_text().splitlines()[-1])
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    subprocess.run([sys.executable, "-m", *command], cwd=folder, check=True, env=environment)
    assert before == files()


@pytest.mark.slow
def test_several_files_are_one_joint_fit_that_a_command_repeats(
    browser: Browser, tmp_path: Path, real_workers: None
) -> None:
    asked = browser.hand_in({"Cup 1.csv": decay(2.0), "Cup 2.csv": decay(3.0, 2)})
    form = browser.get(asked.place)
    assert re.findall(r'name="files" value="([^"]*)" checked> ([^<]*)<', form.text) == [
        ("cup-1.csv", "Cup 1.csv"),
        ("cup-2.csv", "Cup 2.csv"),
    ]
    # which of the two is for whoever asks to say
    assert len(re.findall('name="how"[^>]* required>', form.text)) == 2
    unsaid = browser.fill_in(asked.place, **DECAY, files="cup-1.csv\ncup-2.csv")
    assert unsaid.status == 422
    assert "Choose: all files together, or each by itself." in unsaid.text
    picture = browser.get(f"{asked.place}/points-0-1.png").body
    alone = browser.get(f"{browser.hand_in({'Cup 1.csv': decay(2.0)}).place}/points-0-1.png").body
    assert picture.startswith(b"\x89PNG")
    assert picture != alone  # the points of both
    fields = DECAY | {"files": "cup-1.csv\ncup-2.csv", "how": "joint", "own": "a"}
    answer = browser.fill_in(asked.place, **fields)
    page = unescape(browser.ended(answer.place).text)
    assert "estim fit cup-1.csv cup-2.csv" in page
    assert "--joint --own=a" in page
    assert "cup-1, cup-2: ok" in page
    repeated(browser, answer.place, tmp_path)
    values = json.loads((tmp_path / "report" / "result.json").read_text())["parameters"]
    assert set(values) == {"a[cup-1]", "a[cup-2]", "tau"}
    for name, truth in {"a[cup-1]": 2.0, "a[cup-2]": 3.0, "tau": 3.0}.items():
        assert abs(values[name]["mean"] - truth) < 4.0 * values[name]["sd"], name
    # a parameter that is none comes back beside its field, one file is no joint fit
    again = browser.ended(browser.fill_in(asked.place, **fields | {"own": "b"}).place)
    form = browser.get(again.place).text
    assert 'id="wrong-own"' in form
    assert browser.fill_in(asked.place, **DECAY, how="joint").status == 422
    one = browser.fill_in(asked.place, **DECAY, files="cup-2.csv", how="joint")
    assert "--joint" not in browser.get(one.place).text


def test_files_that_are_there_are_put_together(browser: Browser) -> None:
    places = [browser.hand_in({"same.csv": decay(2.0, i)}).place for i in range(2)]
    ids = [place.rpartition("/")[2] for place in places]
    body = "&".join(f"ids={at}" for at in (*ids, ids[0], "nothing")).encode()
    kind = {"Content-Type": "application/x-www-form-urlencoded"}
    asked = browser.send("POST", "/together", body, kind)
    form = browser.get(asked.place).text
    assert "<h1>same.csv, same.csv</h1>" in form
    assert 'value="same-2.csv"' in form
    together = asked.place.rpartition("/")[2]
    for few in ((ids[0],), (together, ids[0]), ()):
        refused = browser.send(
            "POST", "/together", "&".join(f"ids={at}" for at in few).encode(), kind
        )
        assert refused.status == 422
        assert "Tick two files or more" in refused.text


@pytest.mark.slow
def test_each_file_by_itself_is_a_table_in_which_one_bad_file_spoils_nothing(
    browser: Browser, tmp_path: Path, real_workers: None
) -> None:
    bad = b"t [s],W [V]\n0,1\n1,2\n2,4\n"
    asked = browser.hand_in({"a.csv": decay(2.0), "b.csv": decay(2.0, 2), "bad.csv": bad})
    fields = DECAY | {"files": "a.csv\nb.csv\nbad.csv", "how": "each"}
    assert browser.fill_in(asked.place, **fields | {"formula": ""}).status == 422
    table = browser.fill_in(asked.place, **fields).place
    answers = re.findall(r'href="(/answers/[^"]*)"', browser.get(table).text)
    assert len(answers) == 3
    pages = [browser.ended(answer) for answer in answers]
    assert [page.status for page in pages] == [200] * 3
    page = browser.get(table)
    assert page.headers["refresh"] == "10"
    assert "refresh" not in browser.get(f"{table}?still=1").headers
    rows = [words(row).split() for row in re.findall(r"<tr>(.*?)</tr>", page.text, re.DOTALL)]
    assert rows[0] == ["file", "and", "status", "a", "(V)", "tau", "(s)"]
    assert [row[0] for row in rows[1:4]] == ["a.csv", "b.csv", "bad.csv"]
    assert rows[1][1:3] == ["ok", "Replace"]
    assert abs(float(rows[1][3]) - 2.0) < 4.0 * float(rows[1][5])
    assert rows[3][1:3] == ["not", "understood"]
    assert "the header has t [s], W [V]" in unescape(page.text)
    # the numbers are those of the command of each row, and of estim batch
    repeated(browser, answers[0], tmp_path)
    summary = browser.get(table.replace("table", "summary.csv")).text.splitlines()
    mean = json.loads((tmp_path / "report" / "result.json").read_text())["parameters"]["a"]["mean"]
    assert summary[0].startswith("campaign,run,status,why,a [V],a [V] sd")
    assert summary[1].startswith(f"a.csv,,ok,,{mean},")
    assert summary[3].startswith("bad.csv,,no result,")


@pytest.mark.slow
def test_a_class_hands_in_and_the_table_grows_and_names_what_stands_apart(browser: Browser) -> None:
    asked = browser.hand_in({"teacher.csv": decay(2.0)})
    answer = browser.fill_in(asked.place, **DECAY, asked="formula", title="Mine").place
    assert "or those of a class" in browser.ended(answer).text
    batch = browser.send("POST", f"{answer}/batch").place
    page = browser.get(batch).text
    assert "A file needs the columns t and U." in page
    assert f'href="{batch}"' in browser.get("/").text
    assert "No file has been handed in yet." in browser.get(f"{batch}/table").text
    places: dict[str, str] = {}

    def hand_in(who: str, data: bytes) -> None:
        student = Browser(browser.address, dict(browser.cookies))
        fields = {"batch": batch.rpartition("/")[2], "who": who}
        places[who] = student.hand_in({"data.csv": data}, fields=fields).place

    sizes = dict.fromkeys("ABC", 2.0) | {"<b>O'Neill</b>": 4.0, '=1+"x"': 2.0, "http://x": 2.0}
    threads = [
        threading.Thread(target=hand_in, args=[who, decay(size, seed)])
        for seed, (who, size) in enumerate(sizes.items())
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(places.values())) == len(sizes)
    for who, place in places.items():
        page = browser.ended(place).text
        assert f"<h1>{escape(who)}: data.csv</h1>" in page
        assert f'href="{batch}/table"' in page
        title = re.findall("<title>(.*?)</title>", browser.get(f"{place}/report/report.html").text)
        assert "Mine" not in title[0]
    table = browser.get(f"{batch}/table").text
    assert "<b>" not in table
    rows = re.findall(r'<tr><th scope="row"><a.*?</tr>', table, re.DOTALL)
    assert len(rows) == len(sizes)
    assert [words(row).split(":")[0].strip() for row in rows if "stands apart" in row] == [
        "&lt;b&gt;O&#39;Neill&lt;/b&gt;"
    ]
    summary = browser.get(f"{batch}/summary.csv").text
    assert '\n\'=1+""x' in summary.replace("\"'=", "'=")
    assert "\nhttp://x: data.csv," in summary
    assert len(summary.splitlines()) == len(sizes) + 1


def class_of(browser: Browser, title: str = "", **fields: str) -> str:
    """The place of a batch, begun as a teacher begins it."""
    asked = browser.hand_in({"teacher.csv": decay(2.0)})
    answer = browser.fill_in(asked.place, **DECAY | fields, asked="formula").place
    browser.ended(answer)
    return browser.fill_in(f"{answer}/batch", title=title).place


def rows_of(browser: Browser, batch: str) -> list[str]:
    """What each row of a table says, but for the last three."""
    rows = re.findall(
        r'<tr><th scope="row">.*?</tr>', browser.get(f"{batch}/table").text, re.DOTALL
    )
    return [unescape(words(row)).strip() for row in rows if "/answers/" in row]


@pytest.mark.slow
def test_a_row_is_replaced_and_the_table_says_so(browser: Browser) -> None:
    batch = class_of(browser)
    handed = {"batch": batch.rpartition("/")[2], "who": "Ana & Luis"}
    assert "choose Replace in its row" in browser.get(batch).text
    first = browser.hand_in({"wrong.csv": decay(9.0)}, fields=handed).place
    other = browser.hand_in({"wrong.csv": decay(2.0)}, fields=handed).place  # is another row
    browser.ended(first)
    at = first.rpartition("/")[2]
    assert f'href="{batch}?row={at}"' in browser.get(first).text
    assert f'href="{batch}?row={at}"' in browser.get(f"{batch}/table").text
    page = browser.get(f"{batch}?row={at}").text
    assert "takes the place of Ana &amp; Luis: wrong.csv in the table" in page
    assert f'name="row" value="{at}"' in page
    assert 'name="who" value="Ana &amp; Luis"' in page
    refused = browser.hand_in({"run.exe": b"MZ"}, fields=handed | {"row": at})
    assert f'name="row" value="{at}"' in refused.text
    second = browser.hand_in({"right.csv": decay(2.0)}, fields=handed | {"row": at}).place
    for answer in (other, second):
        browser.ended(answer)
    rows = rows_of(browser, batch)
    assert [row.partition(" ok")[0] for row in rows] == [
        "Ana & Luis: wrong.csv",
        "Ana & Luis: right.csv",
    ]
    assert "in place of Ana & Luis: wrong.csv" in rows[1]
    assert "in place of" not in rows[0]
    assert len(browser.get(f"{batch}/summary.csv").text.splitlines()) == 3
    # nothing is lost: the answer is there, and the table leads to it
    assert f'href="{first}"' in browser.get(f"{batch}/table").text
    assert f'href="{first}"' in browser.get("/").text
    assert browser.get(f"{first}/report/report.html").status == 200
    # twice, from a page that was open before: the newest stands there
    third = browser.hand_in({"newest.csv": decay(2.0)}, fields=handed | {"row": at}).place
    browser.ended(third)
    assert [row.partition(" ok")[0] for row in rows_of(browser, batch)] == [
        "Ana & Luis: wrong.csv",
        "Ana & Luis: newest.csv",
    ]
    # of another class nothing can be replaced
    another = class_of(browser)
    fields = handed | {"batch": another.rpartition("/")[2], "row": second.rpartition("/")[2]}
    browser.hand_in({"a.csv": decay(2.0)}, fields=fields)
    assert len(rows_of(browser, batch)) == 2
    assert "right.csv" not in browser.get(f"{another}/table").text


@pytest.mark.slow
def test_columns_of_other_names_are_chosen_and_become_the_row(browser: Browser) -> None:
    batch = class_of(browser, **{"u-y": "", "value": "tau = 3.00(5)"})
    fields = {"batch": batch.rpartition("/")[2], "who": "A"}
    data = decay(2.0, 3).replace(b"t [s],U [V]", b"no [1],time [s],voltage [V]")
    data = re.sub(rb"\n(?=\d)", b"\n7,", data)
    failed = browser.hand_in({"data.csv": data}, fields=fields).place
    page = unescape(browser.ended(failed).text)
    assert "'t' is missing (the header has no [1], time [s], voltage [V])" in page
    (link,) = re.findall('href="(/files/[^"]*row=[^"]*)"', page)
    assert f'href="{link}"' in browser.get(f"{batch}/table").text
    form = browser.get(link).text
    assert "The curve a*exp(-t/tau) is fitted to them" in form
    assert 'name="formula"' not in form
    assert re.findall('<option value="([^"]*)" selected', form) == ["time", "voltage"]
    place, _, row = link.partition("?row=")
    # what else is said does not count: the question is that of the class
    said = {"x": "time", "y": "voltage", "formula": "b*x", "value": "", "title": "mine"}
    chosen = browser.fill_in(place, row=row, **said).place
    command = shlex.split(unescape(re.findall("<code>(.*?)</code>", browser.ended(chosen).text)[0]))
    assert {"--formula=a*exp(-x/tau)", "--x=time", "--y=voltage", "--value=tau=3.00(5)"} <= {
        *command
    }
    assert "--title=A: data" in command
    (shown,) = rows_of(browser, batch)
    assert shown.startswith("A: data.csv ok in place of A: data.csv")
    # of another file the row is not replaced
    other = browser.hand_in({"line.csv": LINE}).place
    answer = browser.fill_in(other, row=chosen.rpartition("/")[2], asked="line").place
    browser.ended(answer)
    assert len(rows_of(browser, batch)) == 1
    assert "/batches/" not in browser.get(answer).text


@pytest.mark.slow
def test_a_class_has_a_title(browser: Browser) -> None:
    batch = class_of(browser, title="Cups of <b>7b</b>")
    shown = "Cups of &lt;b&gt;7b&lt;/b&gt;"
    for place in (batch, f"{batch}/table"):
        page = browser.get(place).text
        assert f"<h1>{shown}</h1>" in page
        assert "<code>a*exp(-t/tau)</code>" in page
    assert f'<a href="{batch}">{shown}</a>' in browser.get("/").text
    assert "<h1>a*exp(-t/tau)</h1>" in browser.get(class_of(browser)).text
    asked = browser.hand_in({"a.csv": decay(2.0), "b.csv": decay(2.0, 2)}).place
    said = {"files": "a.csv\nb.csv", "how": "each", "title": "Two cups"}
    table = browser.fill_in(asked, **DECAY, **said).place
    assert "<h1>Two cups</h1>" in browser.get(table).text


@pytest.mark.slow
def test_what_a_class_cannot_hand_in_is_said_where_it_was_handed_in(browser: Browser) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    answer = browser.fill_in(asked.place, asked="formula", formula="a*x + b", x="t", y="U").place
    browser.ended(answer)
    batch = browser.send("POST", f"{answer}/batch").place
    fields = {"batch": batch.rpartition("/")[2], "who": "A"}
    for files, said in (
        ({"c.toml": b""}, "A campaign already contains a question"),
        ({"run.exe": b"MZ"}, "run.exe is not one of"),
        ({"": b""}, "Choose a file first."),
    ):
        refused = browser.hand_in(files, fields=fields)
        assert refused.status == 422
        assert said in refused.text
        assert 'name="who"' in refused.text
    nobody = browser.hand_in({"a.csv": LINE}, fields={"batch": fields["batch"], "who": " "})
    assert (nobody.status, "Write your name" in nobody.text) == (422, True)
    assert browser.hand_in({"a.csv": LINE}, fields=fields | {"batch": "none"}).status == 404
    line = browser.fill_in(asked.place, asked="line").place
    browser.ended(line)
    assert browser.send("POST", f"{line}/batch").status == 404
    for place in ("/batches/none", "/batches/none/table", "/batches/none/summary.csv"):
        assert browser.get(place).status == 404


@pytest.mark.slow
def test_a_file_of_an_installed_reader_is_taken(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_workers: None
) -> None:
    assert browser.hand_in({"a.sweep": LINE}).status == 422
    info = tmp_path / "estim_sweeps-0.3.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: estim-sweeps\nVersion: 0.3\n")
    (info / "entry_points.txt").write_text("[estim.readers]\nsweep = estim_sweeps:read\n")
    code = "def read(data):\n    return data.decode().replace(',', chr(9))\n"
    (tmp_path / "estim_sweeps.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])
    monkeypatch.setenv("PYTHONPATH", path)  # of the workers
    plugins.cache_clear()
    try:
        assert ".sweep" in browser.get("/").text
        asked = browser.hand_in({"Run 1.sweep": LINE})
        assert "t s 5 0 4" in words(browser.get(asked.place).text)
        answer = browser.fill_in(asked.place, asked="formula", formula="a*x + b", x="t", y="U")
        page = browser.ended(answer.place).text
        assert "run-1: ok" in page
        assert "read by the package estim-sweeps 0.3" in page
    finally:
        plugins.cache_clear()


# ---- who may ask ----


def test_nobody_without_the_cookie_sees_anything(address: str, folder: Path) -> None:
    stranger = Browser(address)
    asked = entered(address).hand_in({"secret.csv": LINE})
    for path in (
        "/",
        "/?token=wrong",
        f"/?token={'x' * 5000}",
        asked.place,
        "/propagate",
        "/nothing",
    ):
        reply = stranger.get(path)
        assert reply.status == 401, path
        assert "secret" not in reply.text
        assert not stranger.cookies
    assert stranger.hand_in({"a.csv": LINE}).status == 401
    stranger.cookies[f"estim-{address.rpartition(':')[2]}"] = "guess"
    assert stranger.get("/").status == 401
    assert stranger.get("/static/estim.css").status == 200
    assert stranger.get("/static/../pages.py").status in (401, 404)


def test_the_cookie_is_for_this_page_alone(address: str) -> None:
    reply = Browser(address).get("/?token=a-token-of-the-tests")
    cookie = reply.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "a-token-of-the-tests" not in cookie
    assert reply.place == "/"


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:{port}",
        "127.0.0.1",
        "127.0.0.1:1",
        "",
        "localhost.evil:{port}",
    ],
)
def test_another_name_for_this_machine_is_refused(browser: Browser, host: str) -> None:
    """DNS rebinding: a foreign name that leads to 127.0.0.1."""
    port = browser.address.rpartition(":")[2]
    headers = {"Host": host.format(port=port), "Origin": f"http://{host.format(port=port)}"}
    assert browser.send("GET", "/", headers=headers).status in (400, 421)
    assert browser.send("POST", "/examples/cooling", headers=headers).status in (400, 421)


def test_the_names_of_this_machine_are_not_refused(browser: Browser) -> None:
    port = browser.address.rpartition(":")[2]
    assert browser.send("GET", "/", headers={"Host": f"localhost:{port}"}).status == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", None, "https://{address}", ""])
def test_what_another_page_sends_is_refused(browser: Browser, origin: str | None) -> None:
    sent = {"Origin": origin and origin.format(address=browser.address)}
    n = browser.get("/").text.count("<li>")
    for path in ("/examples/cooling", "/propagate", "/files"):
        assert browser.send("POST", path, headers=sent).status == 403
    assert browser.get("/").text.count("<li>") == n


def test_every_page_has_the_headers_that_forbid(browser: Browser) -> None:
    for path in ("/", "/propagate", "/nothing", "/static/estim.js"):
        headers = browser.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "same-origin"
        assert headers["cache-control"] == "no-store"
    assert browser.send("PUT", "/").status == 405
    for page in (Path(__file__).parents[1] / "estim" / "web" / "templates").iterdir():
        assert not re.findall(r"<script>|<style|\sstyle=|\son\w+=", page.read_text()), page


def test_others_need_the_passphrase(tmp_path: Path) -> None:
    with served(tmp_path, passphrase="three-word-phrase") as address:
        student = Browser(address)
        assert student.get("/").status == 401
        began = time.monotonic()
        assert student.fill_in("/enter", passphrase="three-word").status == 401
        assert time.monotonic() - began > 0.9
        assert student.get("/").status == 401
        assert student.fill_in("/enter", passphrase=" three-word-phrase ").status == 303
        assert student.get("/").status == 200


# ---- what may be sent ----

NAMES = [
    "../../up.csv",
    "/etc/passwd.csv",
    "..\\..\\up.csv",
    "C:\\up.csv",
    "<img src=x onerror=alert(1)>.csv",
    "a\"b'c.csv",
    "con.csv",
    "--out=elsewhere.csv",
    ".csv",
    "röntgen {x} {{ 7*7 }} %s.csv",
]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_shown_and_is_nothing_else(browser: Browser, folder: Path, name: str) -> None:
    before = set(folder.parent.iterdir())
    asked = browser.hand_in({name: LINE})
    form = browser.get(asked.place)
    assert form.status == 200
    assert "<img src=x" not in form.text
    assert "7*7" not in form.text or "{{ 7*7 }}" in unescape(form.text)
    if "<img" in name or "--out" in name:
        answer = browser.fill_in(asked.place, asked="formula", formula="a*x + b", x="t", y="U")
        page = browser.ended(answer.place)
        report = browser.get(f"{answer.place}/report/report.html").text
        assert "ok" in words(page.text)
        assert "<img src=x" not in page.text + report
        assert browser.get(f"{answer.place}/all.zip").status == 200
    stored = {path.name for path in (folder / asked.place[1:]).iterdir()}
    assert all(re.fullmatch(r"[a-z0-9-]+\.(csv|json|png)", each) for each in stored), stored
    assert set(folder.parent.iterdir()) == before


@pytest.mark.parametrize(
    "path",
    [
        "/files/../answers",
        "/files/..%2f..",
        "/answers/nothing",
        "/answers/%00",
        "/files/" + "0" * 20,
    ],
)
def test_an_address_opens_no_path(browser: Browser, path: str) -> None:
    assert browser.get(path).status == 404


def test_an_address_that_takes_forms_leads_to_the_first_page(browser: Browser) -> None:
    typed = browser.get("/files")
    assert typed.status == 405
    assert "begin at the first page" in typed.text


def test_a_report_gives_its_own_files_alone(browser: Browser) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    answer = browser.fill_in(asked.place, asked="line", x="t", y="U")
    browser.ended(answer.place)
    for path in (
        "../record.json",
        "..%2frecord.json",
        "%2e%2e/line.csv",
        "/etc/passwd",
        ".checkpoint/x",
        "",
    ):
        assert browser.get(f"{answer.place}/report/{path}").status == 404, path
    assert browser.get(f"{answer.place}/report/result.json").status == 200


def test_too_much_is_refused(browser: Browser) -> None:
    many = {f"{i}.csv": LINE for i in range(MOST_FILES + 1)}
    assert browser.hand_in(many).status == 400
    sent = {"Content-Length": str(MOST_BYTES * 2)}
    assert browser.send("POST", "/files", headers=sent).status == 413
    assert browser.send("POST", "/files", headers={"Content-Length": None}).status == 411
    asked = browser.hand_in({"line.csv": LINE})
    assert browser.fill_in(asked.place, asked="formula", formula="x" * 70_000).status == 413


@pytest.mark.slow
def test_a_campaign_reads_nothing_outside_its_folder(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "private.csv").write_bytes(LINE)
    campaign = """title = "t"
kind = "measured"
[curve]
expression = "a*x + b"
x = {{column = "t"}}
y = {{column = "U"}}
[curve.parameters]
a = {{start = 1.0}}
b = {{start = 1.0}}
[[runs]]
name = "one"
file = "{file}"
"""
    for file, reads in (
        (tmp_path / "private.csv", False),
        ("../../private.csv", False),
        ("mine.csv", True),
    ):
        asked = browser.hand_in({"c.toml": campaign.format(file=file).encode(), "mine.csv": LINE})
        form = browser.get(asked.place).text
        assert ("lies outside the folder" in form) is not reads, words(form)
        assert ("cannot be read" in form) is not reads
        page = browser.ended(browser.fill_in(asked.place).place)
        assert page.status == (200 if reads else 303)
        if not reads:
            assert "no such file" not in form
            assert "lies outside the folder" in unescape(browser.get(page.place).text)


@pytest.mark.parametrize("asked", ["formula", "rolling", "line", "mean"])
def test_no_field_becomes_an_option_or_a_file(asked: str) -> None:
    options = [option for parameter in fit.params for option in parameter.opts]
    fields = {option.lstrip("-"): f"--out=/x{option}" for option in options} | {"asked": asked}
    fields |= {"cov": "/etc/passwd", "runs": "--out=/x", "start": "--out=/x\n-o /y\n/etc/passwd"}
    keys = ("radius_m", "phi_deg", "theta0_deg", "gamma", "sigma_x_m")
    fields |= dict.fromkeys(keys, "--out=/x\n/y")
    told = arguments_of(fields, "points.csv", "--out=/x")
    end = ["--format", "html", "--out", "report"]
    assert told[1] == "points.csv"
    assert told[-4:] == end
    flags = {"--correlated", "--jitter"}
    assert all(re.match(r"--[a-z-]+=", word) or word in flags for word in told[2:-4])
    assert not [word for word in told[2:-4] if word.startswith(("--out", "--cov", "--run"))]
    told = arguments_of({"runs": "--out=/x\n/y"}, "c.toml", "c")
    assert told == ["fit", "c.toml", "--run=--out=/x", "--run=/y", *end]


def test_a_formula_of_values_is_never_a_file() -> None:
    told = arguments_of({"formula": "/etc/passwd", "values": "--out = 3\na=1; b =2"}, "", "")
    assert told[told.index("--") + 1 :] == ["/etc/passwd", "--out=3", "a=1", "b=2"]
    for fields in (
        {"formula": "/etc/passwd"},
        {"values": "a=1"},
        {"formula": "f", "values": " ; \n"},
    ):
        with pytest.raises(InputError):
            arguments_of(fields, "", "")


def test_fields_alike_are_lines_of_one() -> None:
    assert fields_of([("formula", " a*x "), ("runs", "a"), ("runs", "b"), ("x", " ")]) == {
        "formula": "a*x",
        "runs": "a\nb",
    }


# ---- work that takes long, and ends early ----


def test_an_answer_that_runs_says_how_far_it_is_and_can_be_cancelled(
    browser: Browser, real_workers: None
) -> None:
    asked = browser.send("POST", "/examples/cooling")
    answer = browser.fill_in(asked.place, asked="formula", formula=SLOW)
    page = browser.get(answer.place).text
    assert "<progress" in page
    assert '<noscript><meta http-equiv="refresh"' in page
    state = json.loads(browser.get(f"{answer.place}/state").body)
    assert set(state) == {"ended", "percent", "doing"}
    assert not state["ended"]
    assert browser.send("POST", f"{answer.place}/cancel").status == 303
    page = browser.get(answer.place)
    assert "Cancelled" in page.text
    assert browser.send("POST", f"{answer.place}/cancel").status == 303


def test_two_tabs_and_two_sessions_do_not_disturb_each_other(address: str) -> None:
    one, two = entered(address), entered(address)
    pages = [browser.hand_in({f"{i}.csv": LINE}).place for i, browser in enumerate((one, two, one))]
    kinds = ("line", "mean", "line")
    answers = [
        browser.fill_in(page, asked=kind, y="U").place
        for browser, page, kind in zip((one, two, one), pages, kinds, strict=True)
    ]
    assert len(set(answers)) == 3
    for browser, answer, i, kind in zip((one, two, one), answers, (0, 1, 2), kinds, strict=True):
        page = browser.ended(answer).text
        assert f"<h1>{i}.csv</h1>" in page
        assert f"{kind}: ok" in page


def children(of: int) -> list[int]:
    """Processes that one has started."""
    with subprocess.Popen(
        ["ps", "-o", "pid=", "--ppid", str(of)], stdout=subprocess.PIPE, text=True
    ) as listing:
        pids = [int(pid) for pid in listing.communicate()[0].split()]
    return [pid for pid in pids if pid != listing.pid]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="processes are counted by ps")
def test_a_killed_worker_harms_nobody(address: str, tmp_path: Path, real_workers: None) -> None:
    others, browser = {*children(os.getpid())}, entered(address)
    asked = browser.send("POST", "/examples/cooling")
    answer = browser.fill_in(asked.place, asked="formula", formula=SLOW)
    while not json.loads(browser.get(f"{answer.place}/state").body)["doing"]:
        time.sleep(0.05)
    end = time.monotonic() + 30
    while not (workers := {*children(os.getpid())} - others) and time.monotonic() < end:
        time.sleep(0.05)
    for worker in workers:
        os.kill(worker, signal.SIGKILL)
    page = browser.ended(answer.place).text
    assert "Stopped:" in page or "Failed" in page
    again = browser.hand_in({"line.csv": LINE})
    assert "line: ok" in browser.ended(browser.fill_in(again.place, asked="line").place).text


def test_a_worker_is_held_to_its_seconds(tmp_path: Path, project: Path, real_workers: None) -> None:
    data = project / "data" / "tutorial" / "tea.csv"
    (tmp_path / "tea.csv").write_bytes(data.read_bytes())
    job = Job(tmp_path, ["run", "fit", "tea.csv", f"--formula={SLOW}"], seconds=1)
    job.run()
    assert job.state == "stopped"


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory as Linux has them")
def test_a_worker_is_held_to_its_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_workers: None
) -> None:
    monkeypatch.setattr("estim.web.job_queue._BYTES", 100 * 1024**2)
    job = Job(tmp_path, ["run", "line", "none.csv"], seconds=60)
    job.run()
    assert job.code not in (0, 2)


def test_a_full_queue_takes_nothing_and_a_waiting_job_can_be_cancelled(
    tmp_path: Path, real_workers: None
) -> None:
    workers = JobQueue(1, 1)
    ended: list[str] = []
    first, second = (Job(tmp_path, ["run", "fit", "none.toml"], seconds=60) for _ in range(2))
    workers.submit(first, lambda: ended.append("first"))
    workers.submit(second, lambda: ended.append("second"))
    assert workers.is_full
    workers.cancel(second)
    assert ended == ["second"]
    assert second.state == "cancelled"
    workers.close()
    assert sorted(ended) == ["first", "second"]
    assert first.state in ("interrupted", "done")


def test_a_full_queue_is_a_sentence_on_the_page(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = browser.hand_in({"line.csv": LINE})
    monkeypatch.setattr(JobQueue, "is_full", True)
    reply = browser.fill_in(asked.place, asked="line")
    assert reply.status == 503
    assert "Too many questions wait" in reply.text


def test_fifty_uploads_at_once_are_all_answered(browser: Browser) -> None:
    places: list[str] = []

    def hand_in(i: int) -> None:
        places.append(
            Browser(browser.address, dict(browser.cookies)).hand_in({f"{i}.csv": LINE}).place
        )

    threads = [threading.Thread(target=hand_in, args=[i]) for i in range(50)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(places)) == 50


# ---- what stays ----


@pytest.mark.slow
def test_a_restart_finds_what_was_answered_and_shows_what_was_interrupted(
    tmp_path: Path, real_workers: None
) -> None:
    with served(tmp_path) as address:
        browser = entered(address)
        asked = browser.hand_in({"line.csv": LINE})
        done = browser.fill_in(asked.place, asked="line").place
        browser.ended(done)
        cut = browser.fill_in(asked.place, asked="formula", formula="a*t + b").place
    with served(tmp_path) as address:
        browser = entered(address)
        assert "line: ok" in browser.get(done).text
        assert browser.get(f"{done}/report/report.html").status == 200
        assert "Interrupted" in browser.get(cut).text
        assert browser.get(asked.place).status == 200


def test_a_damaged_record_loses_itself_alone(tmp_path: Path) -> None:
    store = Store(tmp_path)
    (kept,) = store.take_in({"line.csv": LINE})
    (damaged,) = store.take_in({"other.csv": LINE})
    (tmp_path / "files" / damaged.id / "record.json").write_bytes(b'{"id": ')
    (tmp_path / "files" / "somebody's own").mkdir()
    assert set(Store(tmp_path).uploads.records) == {kept.id}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_the_command_serves_until_it_is_stopped_and_its_workers_end_with_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "estim", "serve", "--no-browser", "--folder", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as server:
        assert server.stdout is not None
        url = server.stdout.readline().split()[1]
        address, token = re.fullmatch(r"http://(.*)/\?token=(.*)", url).groups()
        browser = Browser(address)
        assert browser.get(f"/?token={token}").status == 303
        other = subprocess.run(
            command, capture_output=True, text=True, env=environment, check=False
        )
        assert other.returncode == 2
        assert "is in use by another process" in other.stderr
        asked = browser.send("POST", "/examples/cooling")
        browser.fill_in(asked.place, asked="formula", formula=SLOW)
        end = time.monotonic() + 30
        while not (workers := children(server.pid)) and time.monotonic() < end:
            time.sleep(0.05)
        server.kill()
        server.wait()
    end = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < end:
        time.sleep(0.05)
    assert workers
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as server:
        assert server.stdout is not None
        assert server.stderr is not None
        server.stdout.readline()
        server.send_signal(signal.SIGINT)
        assert server.wait(20) == 0
        assert server.stderr.read() == ""


def test_the_folder_is_named_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """estim serve FOLDER is estim serve --folder FOLDER."""
    begun: list[At] = []
    monkeypatch.setattr("estim.web.serve", lambda at, *_, **__: begun.append(at))
    folder = str(tmp_path / "a")
    both = runner().invoke(cli, ["serve", folder, "--folder", folder])
    assert isinstance(both.exception, InputError)
    assert "'--folder' names the folder a second time" in str(both.exception)
    assert begun == []
    for said in ([folder], ["--folder", folder], []):
        assert runner().invoke(cli, ["serve", *said]).exit_code == 0
    assert [at.folder for at in begun] == [Path(folder), Path(folder), Path("estim-answers")]


def test_a_taken_port_is_one_line_and_the_usual_one_gives_way(tmp_path: Path) -> None:
    listener, address = listening(At("127.0.0.1", 0, tmp_path))
    port = int(address.rpartition(":")[2])
    with listener, pytest.raises(EstimError, match="'--port' cannot be listened on"):
        listening(At("127.0.0.1", port, tmp_path))
    others = [listening(At("127.0.0.1", None, tmp_path)) for _ in range(2)]
    assert len({address for _, address in others}) == 2
    for each, _ in others:
        each.close()


@pytest.mark.parametrize(
    ("host", "local"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False), ("lab", False)],
)
def test_other_machines_reach_all_but_a_loopback_address(host: str, local: bool) -> None:
    assert At(host, None, Path()).is_local is local


@pytest.mark.slow
def test_what_nobody_can_write_breaks_no_page(browser: Browser) -> None:
    asked = browser.hand_in({"a.csv": LINE})
    answer = browser.fill_in(asked.place, asked="formula", formula="a*x\x00 + b", x="t", y="U")
    assert "ok" in browser.ended(answer.place).text
    assert browser.get("/").status == 200
    for bad in ("asked=bogus", "asked=line&asked=mean", "show=start&asked=bogus"):
        assert browser.get(f"{asked.place}?{bad}").status == 200, bad
    twice = browser.hand_in({"a.csv": LINE, "folder/a.csv": LINE})
    assert twice.status == 422
    assert "Two files have the same name" in twice.text
    refused = browser.fill_in(asked.place, asked="bogus")
    assert refused.status == 422
    assert "Choose what you want to know." in refused.text


def test_two_columns_of_one_name_are_drawn_against_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.csv").write_text("T (s),T (K)\n1,300\n2,310\n3,321\n4,329\n")
    drawn = list[drawing.Figure]()
    monkeypatch.setattr(drawing, "png", lambda draw: drawn.append(draw()) or b"")
    _start(tmp_path / "a.csv", {"formula": "a + b*x", "x": "T (s)", "y": "T (K)"})
    _table(tmp_path / "a.csv", "0", "1")
    for figure in drawn:
        (ax,) = figure.axes
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("T (s)", "T (K)")
        assert ax.lines[0].get_xdata().tolist() == [1.0, 2.0, 3.0, 4.0]
        assert ax.lines[0].get_ydata().tolist() == [300.0, 310.0, 321.0, 329.0]
    assert len(drawn) == 2
