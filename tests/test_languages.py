"""Reports in another language: nothing that a reader sees stays English, and English stays what it
was.
"""

from __future__ import annotations

import ast
import itertools
import json
import re
import string
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from test_verify import MODEL, run

from estim.batch import Settings
from estim.campaign import load_campaign
from estim.common import LANGUAGES, InputError, key_of, phrase, phrases, spoken
from estim.curve_fitting.result import CurveFit
from estim.curve_fitting.single import fit_curve
from estim.pipeline import sample_curve
from estim.reports.curve import curve_report
from estim.reports.rendering import _environment, translated
from estim.sampling import Target

ROOT = Path(__file__).parent.parent
ESTIM = ROOT / "estim"
TEMPLATES = sorted((ESTIM / "reports" / "templates").glob("*.j2"))
PAGES = sorted((ESTIM / "web" / "templates").glob("*.j2"))  # say each sentence by `phrase`
CATALOGUE = ESTIM / "common" / "catalogue"
OTHERS = [name for name in LANGUAGES if name != "en"]
SPACES = re.compile(r"\s+")
TAG = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}", re.DOTALL)


def files_of(language: str) -> list[Path]:
    return sorted((CATALOGUE / language).glob("*.toml"))


def pairs(language: str) -> Iterator[tuple[str, str, str]]:
    """File, English, the other language."""
    for file in files_of(language):
        for english, words in tomllib.loads(file.read_text(encoding="utf-8")).items():
            yield file.name, SPACES.sub(" ", english).strip() if "\n" in english else english, words


TABLES = ("WORDS", "ADVICE")  # of the room of words; every text in them is a sentence


def sentences_at(node: ast.AST) -> list[ast.expr]:
    """What is a sentence because of where it stands: in `phrase`, `later` and `said`, in a
    `PhraseTable`, and in one of `TABLES`.
    """
    if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) in TABLES:
        return [
            entry
            for table in ast.walk(node)
            if isinstance(table, ast.Dict)
            for entry in table.values
            if not isinstance(entry, ast.Lambda)
        ]
    if not isinstance(node, ast.Call) or not node.args:
        return []
    if isinstance(node.args[0], ast.Dict) and ast.unparse(node.func) == "PhraseTable":
        return node.args[0].values
    place = {"phrase": 0, "later": 0, "worded": 1}.get(ast.unparse(node.func))
    return [] if place is None else node.args[place : place + 1]


@cache
def said_in_code() -> dict[str, str]:
    """English sentence -> where it is said or kept for later."""
    found: dict[str, str] = {}
    for path in sorted(ESTIM.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for sentence in sentences_at(node):
                where = f"{path.relative_to(ROOT)}:{sentence.lineno}"
                found |= dict.fromkeys(literals(sentence), where)
    return found


def literals(node: ast.expr) -> Iterator[str]:
    """The texts that an expression may be."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from (*literals(node.body), *literals(node.orelse))


def sentences(source: str) -> list[str]:
    """Those of a template that are translated."""
    found: list[str] = []

    def kept(words: str) -> str:
        found.append(words)
        return words

    translated(source, kept)
    return found


@cache
def said_in_templates() -> dict[str, str]:
    """Sentence of a template, or of a `phrase(...)` in a tag -> where it stands."""
    found: dict[str, str] = {}
    for path in [*TEMPLATES, *PAGES]:
        source = path.read_text(encoding="utf-8")
        if path in TEMPLATES:
            found |= dict.fromkeys(sentences(source), path.name)
        for quoted in re.findall(r"""phrase\(\s*("(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')""", source):
            found[ast.literal_eval(quoted)] = path.name
    return found


def said() -> dict[str, str]:
    return said_in_templates() | said_in_code()


def blanks(text: str) -> list[str]:
    """The places where values go: of a template its tags without blanks, else names with what they
    are formatted by.
    """
    if TAG.search(text):
        return sorted(SPACES.sub("", tag) for tag in TAG.findall(text))
    return sorted(
        f"{name}!{conversion}:{form}"
        for _, name, form, conversion in string.Formatter().parse(text)
        if name is not None
    )


def fits_format(text: str) -> bool:
    try:
        list(string.Formatter().parse(text))
    except ValueError:
        return False
    return True


@pytest.mark.slow
@pytest.mark.parametrize("language", OTHERS)
def test_every_sentence_of_a_catalogue_is_said_somewhere(language: str) -> None:
    known = said()
    unused = [f"{file}: {english}" for file, english, _ in pairs(language) if english not in known]
    assert not unused, "\n".join(unused)


@pytest.mark.parametrize("language", OTHERS)
def test_every_sentence_is_in_the_catalogue(language: str) -> None:
    known = {english for _, english, _ in pairs(language)}
    missing = [
        f"{where}: {english}"
        for english, where in said().items()
        if english not in known and has_words(english)
    ]
    assert not missing, f"{len(missing)} are missing:\n" + "\n".join(missing)


def has_words(english: str) -> bool:
    return bool(
        re.search(
            r"[^\W\d_]{2}",
            TAG.sub("", english) if TAG.search(english) else re.sub(r"\{[^{}]*\}", "", english),
        )
    )


@pytest.mark.parametrize("language", OTHERS)
def test_a_translation_keeps_what_is_put_into_the_sentence(language: str) -> None:
    for file, english, words in pairs(language):
        if TAG.search(english) or (fits_format(english) and fits_format(words)):
            assert set(blanks(english)) == set(blanks(words)), f"{file}: {english}"
        assert words.strip(), f"{file}: {english}"
        ends = [(text[:1].isspace(), text[-1:].isspace()) for text in (english, words)]
        assert ends[0] == ends[1], f"{file}: {english!r}"


@pytest.mark.parametrize("language", OTHERS)
def test_a_sentence_has_one_translation(language: str) -> None:
    found: dict[str, tuple[str, str]] = {}
    for file, english, words in pairs(language):
        other, before = found.setdefault(english, (file, words))
        assert before == words, f"{english!r} in {other} and {file}"


@pytest.mark.parametrize("language", OTHERS)
def test_every_template_can_be_compiled_in_the_language(language: str) -> None:
    with spoken(language):
        environment = _environment(language)
        for path in TEMPLATES:
            environment.get_template(path.name)


# ---- what is said without `phrase` ----

NEIGHBOURS = re.compile(r"[A-Za-z]{2,},? [A-Za-z]{2,}")
NOT_FOR_READERS = re.compile(
    r"^(phrase|later|InputError|NumericalError|EstimError|error|warn|compile|getLogger)$"
)
ALLOWED = {  # why a reader never sees a text, or sees it as it is -> such texts
    "a place in a figure": r"(outside )?(lower|upper) (left|right|center)|offset points|axes "
    r"fraction",
    "HTML, whose words are put in": r"<[^W].*",
    "a page's own rule of safety": r"default-src .*",
    "to be typed": r"pip install .*",
    "a name, the same in Spanish": r"Monte Carlo",
    "a key of result.json or of the statuses": r"posterior sd|joint fit of \{\}",
    "a key of a table in the program": r"(climbs|turns) (on|past|beyond)|recorded way|importance "
    r"sampling",
    "a cell of a table for programs": r"no result",
    "an attribute of draws.nc, for programs": r"not stated",
}


def unsaid(path: Path) -> Iterator[tuple[int, str]]:
    """Texts of two neighbouring English words that are not said by `phrase`: line, text."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    described = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    } | {
        id(second.value)  # a text under a name at the top describes it
        for first, second in itertools.pairwise(tree.body)
        if isinstance(first, ast.Assign | ast.AnnAssign) and isinstance(second, ast.Expr)
    }
    said = {id(sentence) for node in ast.walk(tree) for sentence in sentences_at(node)}
    yield from _unsaid(tree, described | said)


def _unsaid(node: ast.AST, described: set[int]) -> Iterator[tuple[int, str]]:
    if id(node) in described or isinstance(node, ast.Raise | ast.Assert):
        return
    if isinstance(node, ast.Call) and NOT_FOR_READERS.match(
        ast.unparse(node.func).rpartition(".")[2]
    ):
        if ast.unparse(node.func) in ("phrase", "later"):
            for child in (*node.args[1:], *node.keywords):
                yield from _unsaid(child, described)
        return
    text = None
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        text = node.value
    elif isinstance(node, ast.JoinedStr):
        text = "".join(
            part.value if isinstance(part, ast.Constant) else "{}" for part in node.values
        )
        for part in node.values:
            if isinstance(part, ast.FormattedValue):
                yield from _unsaid(part.value, described)
    if text is not None:
        if NEIGHBOURS.search(text):
            yield node.lineno, text
        return
    for child in ast.iter_child_nodes(node):
        yield from _unsaid(child, described)


@pytest.mark.parametrize("folder", ["words", "reports"])
def test_whatever_a_reader_sees_is_said_by_phrase(folder: str) -> None:
    allowed = re.compile("|".join(f"(?:{form})" for form in ALLOWED.values()), re.DOTALL)
    found = [
        (path, line, text)
        for path in sorted((ESTIM / folder).rglob("*.py"))
        for line, text in unsaid(path)
        if not allowed.fullmatch(text)
    ]
    assert not [f"{path.relative_to(ROOT)}:{line}: {text}" for path, line, text in found]


def test_a_sentence_that_is_not_said_by_phrase_is_found(tmp_path: Path) -> None:
    source = """return f"the {x} is not {'good for' if x else 1} here" """
    (tmp_path / "a.py").write_text(
        f'"A page of words."\ndef f(x):\n    "A verb of words."\n    {source}\n'
    )
    assert [text for _, text in unsaid(tmp_path / "a.py")] == ["good for", "the {} is not {} here"]


# ---- a made-up language: English in wide letters ----

WIDE = {ord(letter): ord(letter) - 0x21 + 0xFF01 for letter in string.ascii_letters}
KEPT = re.compile(r"\{[^{}]*\}|`[^`]*`|</?\w[^>]*>|https?:\S+|\[[^\]]*\]\(|\$[^$]*\$|!\[")
QUOTED = re.compile(
    r"""(?<=["'])[^"'{}]*[A-Za-z]{2}[^"'{}]*(?=["']\s+if\b)"""
    r"""|(?<=else ["'])[^"'{}]*[A-Za-z]{2}[^"'{}]*(?=["'])"""
)


class Wide(Mapping[str, str]):
    """A catalogue that has every sentence."""

    def __getitem__(self, english: str) -> str:
        tagged = (
            re.compile(rf"{TAG.pattern}|{KEPT.pattern}", re.DOTALL) if TAG.search(english) else KEPT
        )
        out, end = [], 0
        for found in tagged.finditer(english):
            out += [english[end : found.start()].translate(WIDE), self._tag(found[0])]
            end = found.end()
        return "".join([*out, english[end:].translate(WIDE)])

    def _tag(self, tag: str) -> str:
        return (
            QUOTED.sub(lambda found: found[0].translate(WIDE), tag)
            if tag.startswith(("{{", "{%"))
            else tag
        )

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phrases, "LANGUAGES", {**LANGUAGES, "xx": "wide"})
    monkeypatch.setattr(phrases, "catalogue", lambda language: Wide())


def test_a_language_that_is_not_there_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"'language' must be one of en, es: fr"), spoken("fr"):
        pass


def left_in_english(text: str) -> list[str]:
    """Words of three letters or more that are not in wide letters; code, names of files and
    addresses are left out.
    """
    text = re.sub(
        r"```.*?```|`[^`]*`|</?\w[^>]*>|\]\([^)]*\)|\$[^$]*\$", " ", text, flags=re.DOTALL
    )
    return sorted(set(re.findall(r"[A-Za-z]{3,}", text)) - NAMES)


NAMES = frozenset(  # shown as they are in every language
    {
        "Thing",
        "data",  # the title and the run, which the user names
        "chi",
        "runs",
        "autocorrelation",
        "trend",
        "largest",  # tests
        "poor",
        "fit",  # a status
        "deviation",  # an argument
        "estim",
        "python",
        "numpy",
        "scipy",
        "emcee",
        "arviz",
        "stats",
        "uncertainties",
    }
)


def fitted(bend: float = 0.0) -> CurveFit:
    """A line through points of a line, or of a parabola."""
    x = np.linspace(0.0, 5.0, 12)
    noise = np.random.default_rng(4).standard_normal(x.size)
    return fit_curve("a*x + b", x, 2.0 * x + bend * x**2 + 1.0 + 0.1 * noise, u_y=0.1)


def report_of(fit: CurveFit) -> dict[str, bytes]:
    sampled = sample_curve(fit, seed=1, target=Target(ess=400))
    return curve_report(fit, sampled, title="Thing", kind="measured", figures="none")


@pytest.mark.usefixtures("wide")
@pytest.mark.parametrize(("bend", "status"), [(0.0, "ok"), (1.0, "poor-fit")])
def test_nothing_of_a_report_stays_in_english(bend: float, status: str) -> None:
    with spoken("xx"):
        files = report_of(fitted(bend))
    report = files["report.md"].decode()
    assert f": {status}" in report
    assert left_in_english(report) == []


@pytest.mark.usefixtures("wide")
def test_what_stays_in_english_is_found() -> None:
    with spoken("xx"):
        said = phrase("the data agree with the values stated beforehand ({p})", p="p = 0.2 or so")
    assert left_in_english(said) == []
    assert left_in_english(f"{said}, and this") == ["and", "this"]


def test_english_is_the_same_whatever_was_spoken_before() -> None:
    fit = fitted()
    before = report_of(fit)
    for language in OTHERS:
        with spoken(language):
            other = report_of(fit)
        assert other["report.md"] != before["report.md"]
        assert shape_of(json.loads(other["result.json"])) == shape_of(
            json.loads(before["result.json"])
        )
    assert report_of(fit) == before


def shape_of(record: object) -> object:
    """Keys, statuses and numbers of a record; its other texts are left out."""
    if isinstance(record, dict):
        return {key: value if key == "status" else shape_of(value) for key, value in record.items()}
    if isinstance(record, list):
        return [shape_of(value) for value in record]
    return None if isinstance(record, str) else record


# ---- commands ----


def test_a_report_is_verified_in_its_own_language(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)
    for language in ("en", "es"):
        assert (
            run(
                "propagate",
                "model.toml",
                "--out",
                language,
                "--lang",
                language,
                "--figures",
                "none",
            ).exit_code
            == 0
        )
    english, spanish = (
        (tmp_path / language / "report.md").read_text() for language in ("en", "es")
    )
    assert english != spanish
    verified = run("verify", "es")
    assert (verified.exit_code, verified.stdout.splitlines()[-1][:9]) == (0, "verified:")
    (tmp_path / "es" / "report.md").write_text(spanish.replace("ncertidumbre", "ncertidumbr", 1))
    assert run("verify", "es").exit_code == 3


def test_a_batch_does_not_keep_results_of_another_language(replica: Path) -> None:
    campaign, keys = load_campaign(replica / "campaign.toml"), []
    for language in ("en", "es", "en"):
        with spoken(language):
            keys.append(key_of(campaign.digests(["light-01"]), Settings()))
    assert keys[0] == keys[2] != keys[1]
