"""Every hostile string is shown literally, wherever it stands: one escape for Markdown, one for the
terminal, one for figures, one for JSON.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from hostile import LOOKS_LIKE_MARKDOWN, MOVES, STRINGS, outline, raw, seen, shown
from matplotlib import rc_context
from matplotlib.figure import Figure

from estim.checks.quoted_results import headline, posterior_table
from estim.common.escaping import Markdown, as_json, code, destination, markdown, mathtext, one_line
from estim.common.labels import Notation, table
from estim.drawing import name_ticks, png
from estim.reports.rendering import cells

PLACES = {
    "paragraph": "{}",
    "words around": "before {} after, and (more).",
    "heading": "# {}",
    "heading with more": "## {}: x",
    "item": "- {}\n- {}\n",
    "inner item": "- x\n  - {}\n",
    "bold item": "- **{}** (x): y",
    "emphasis": "*{}.*",
    "after a paragraph": "x\n{}",
    "row": "| a | b |\n|---|---|\n| {} | x |\n",
    "head": "| {} | b |\n|---|---|\n| a | x |\n",
    "link": "[{}](x.md)",
    "image": "![Bands of {}](x.png)",
    "quotation": "> {}",
    "brackets": "x ({}; {})",
}


@pytest.mark.parametrize("place", PLACES)
def test_markdown_shows_hostile_text_literally_everywhere(place: str) -> None:
    """The structure stays that of a harmless word, and the reader sees the text."""
    around = PLACES[place]
    for text in STRINGS:
        if not shown(text) and place != "row":
            continue  # nothing but blanks: a paragraph of nothing is none
        written = around.replace("{}", markdown(text))
        assert outline(written) == outline(around.replace("{}", "word")), (text, written)
        wanted = seen(around.replace("{}", "word")).replace("word", shown(text))
        assert [line.strip() for line in seen(written).split("\n")] == [
            line.strip() for line in wanted.split("\n")
        ], (text, written)
        assert not raw(written), text


def test_the_test_sees_a_forgery() -> None:
    for text in ("*x*", "a\n\n# b", "<b>", "[x](y)", "a | b"):
        assert outline(f"| a |\n|---|\n| {text} |\n") != outline(
            "| a |\n|---|\n| word |\n"
        ) or seen(f"| a |\n|---|\n| {text} |\n").split("\n")[-1] != shown(text)
    assert raw("\x1b")
    assert raw("\u202e")


@pytest.mark.parametrize(
    "text",
    [
        "γ[heavy]",
        "θ₀[heavy-04]",
        "c_rr",
        "[0.181, 0.199]",
        "[−0.1, 2.0e-05]",
        "< 0.0107 (open below)",
        "p < 5e-5",
        "-0.5",
        "(r − 1)/2",
        "C#",
        "x_t",
        "+0.3",
    ],
)
def test_what_reports_are_made_of_stays_as_it_is(text: str) -> None:
    assert markdown(text) == text


def test_markdown_is_escaped_once() -> None:
    once = markdown("*a* | b")
    assert markdown(once) is once
    assert isinstance(once, Markdown)
    assert seen(table(("x",), [("*a* | b",), (Markdown("**c**"),)])).split("\n") == [
        "x",
        "*a* | b",
        "c",
    ]
    assert seen(f"| a | b |\n|---|---|\n| {cells(('a | b', '`c`'))} |").split("\n")[2:] == [
        "a | b",
        "`c`",
    ]


@pytest.mark.parametrize("around", ["Curve: {}.", "| a | b |\n|---|---|\n| {} | x |\n", "- x ({})"])
def test_code_is_a_code_span_or_literal_text(around: str) -> None:
    assert code("a*exp(-b*x) < 1") == "`a*exp(-b*x) < 1`"
    for text in filter(shown, STRINGS):
        written = around.replace("{}", code(text))
        assert outline(written) == outline(around.replace("{}", "word")), text
        assert shown(text) in seen(written), text
        assert not raw(written)


def test_destinations_hold_no_mark_that_ends_them() -> None:
    for text in STRINGS:
        assert destination(text).isascii()
        assert not set(destination(text)) & set(" ()<>[]|\\`*\n\r\t\x1b"), text
    assert destination("heavy-04/report.md") == "heavy-04/report.md"


def test_a_terminal_gets_one_visible_line() -> None:
    for text in STRINGS:
        assert one_line(text).isprintable()
    assert one_line("a\x1b[2J\u202e\nb\udcff") == "a\\x1b[2J\\u202e b\\xff"


def test_json_is_data_that_a_terminal_can_show() -> None:
    for text in STRINGS:
        written = as_json({text: [text, "γ"]}).decode()
        assert json.loads(written) == {text: [text, "γ"]}
        assert not raw(written), text
        assert "γ" in written


def test_notebooks_get_literal_text() -> None:
    values = posterior_table([("a", "*x*", "1", "2", "m | n")])
    for status in ("ok", "poor-fit"):
        for text in filter(shown, STRINGS):
            shape = outline(
                headline(
                    "word", kind="", status=status, reasons=["word"], advice=["word"], shown=values
                )
            )
            assert (
                outline(
                    headline(
                        text, kind="", status=status, reasons=[text], advice=[text], shown=values
                    )
                )
                == shape
            ), text


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph", "ignore:Matplotlib currently does not")
@pytest.mark.parametrize("text", LOOKS_LIKE_MARKDOWN + MOVES, ids=ascii)
def test_figures_show_hostile_text_literally(text: str) -> None:
    drawn = {}

    def draw(title: str = text) -> Figure:
        figure = Figure(figsize=(1, 1))
        ax = figure.subplots()
        ax.set(title=title, xlabel=f"{title} ({title})")
        ax.set_ylabel(Notation("k_on_1").label(title).axis)
        ax.plot([0, 1], label=f"run {title}")
        ax.legend()
        name_ticks(ax.xaxis, [0, 1], [title, "x"])
        drawn.update(
            title=ax.title,
            label=ax.yaxis.label,
            curve=ax.get_legend().get_texts()[0],
            tick=ax.xaxis.get_major_ticks()[0].label1,
        )
        return figure

    assert png(draw).startswith(b"\x89PNG")
    for name in ("title", "tick"):
        shown_text, is_mathematics = drawn[name]._preprocess_math(drawn[name].get_text())
        # our own way of writing a subscript
        assert not is_mathematics or text == "$_{\\mathrm{x}}$"
        if not is_mathematics:
            assert " ".join(shown_text.split()) == shown(text).strip() or "\\$" in text
    assert mathtext(text) in drawn["label"].get_text()
    assert drawn["curve"].get_text() == mathtext(f"run {text}")


def test_a_subfigure_and_a_note_are_written_literally_too() -> None:
    figure = Figure(figsize=(2, 2), layout="constrained")
    part = figure.subfigures(1, 2)[1]
    ax = part.subplots()
    note, above, beside = (
        ax.annotate("$x$", (0.5, 0.5)),
        part.suptitle("$x$"),
        figure.supylabel("$x$"),
    )
    part.legend(ax.plot([0, 1]), ["$x$"], loc="outside lower center")
    png(lambda: figure)
    assert [text.get_text() for text in (note, above, beside, part.legends[0].get_texts()[0])] == [
        "\\$x\\$"
    ] * 4


def test_ticks_with_names_go_through_the_one_place_that_writes_them_literally(
    project: Path,
) -> None:
    for path in (project / "estim" / "reports").glob("*.py"):
        for call in ast.walk(ast.parse(path.read_text())):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute):
                named = call.func.attr in ("set_xticklabels", "set_yticklabels", "set_ticklabels")
                assert not named, (path, call.lineno)
                assert call.func.attr not in ("set_xticks", "set_yticks") or len(call.args) == 1, (
                    path,
                    call.lineno,
                )


@pytest.mark.parametrize(
    ("name", "tex"),
    [
        ("c_rr", "c$_{\\mathrm{rr}}$"),
        ("a_b_c_", "a_b_c_"),
        ("k_on_1", "k$_{\\mathrm{on\\_1}}$"),
        ("a__b", "a__b"),
        ("x_", "x_"),
        ("T_größe", "T$_{\\mathrm{größe}}$"),
        ("a_𠀀", "a_𠀀"),
        ("frac", "frac"),
        ("θ₀", "θ₀"),
        ("σ_y", "σ$_{\\mathrm{y}}$"),
    ],
)
def test_names_of_parameters_become_subscripts_only_where_mathematics_can_show_them(
    name: str, tex: str
) -> None:
    shown = Notation(name).label("m", "[a_\nb]")
    assert (shown.symbol, shown.tex) == (f"{name}[a_\nb]", f"{tex}[a_\nb]")


def test_a_users_style_does_not_reach_the_figures() -> None:
    def draw() -> Figure:
        figure = Figure(figsize=(2, 2))
        figure.subplots().set(title="x", xlabel="k$_{\\mathrm{on}}$")
        return figure

    plain = png(draw)
    with rc_context(
        {
            "text.usetex": True,
            "font.size": 30.0,
            "axes.facecolor": "red",
            "lines.linewidth": 9.0,
            "savefig.bbox": "tight",
        }
    ):
        assert png(draw) == plain
    figure = Figure(figsize=(2, 2))
    with rc_context({"font.size": 30.0}):
        figure.subplots().set(title="x")
    assert png(lambda: figure) != plain  # drawn outside: the style has reached it


def test_mathtext_keeps_our_subscripts() -> None:
    assert mathtext("a$b$ sin θ$_{\\mathrm{min}}$ $") == "a\\$b\\$ sin θ$_{\\mathrm{min}}$ \\$"
