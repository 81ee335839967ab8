"""Where keys of a TOML text stand: what strings and comments hold is no key, and hostile text takes
time in proportion to its length.
"""

from __future__ import annotations

import time
import tomllib

import pytest

from estim import InputError, load_campaign
from estim.campaign.design import load_design
from estim.reading.toml import locate_keys
from estim.studies.published import read_published

TRICKY = r'''# "quotes" and """ and [brackets]
title = "x = 1 # [[runs]]"   # b = 2
text = """
[shared]
a = 1 \
[[runs]] "" \""" "quotes" """"
list = [ # [x]
  "]", '[', { k = "}", l = [1] }, [2],
] # end
after = 1
["quoted \u00e9 key" . 'raw # = key' .bare]
  1.5 = "="
"a.b" = 3
[[runs]]
name = "a"
[runs.noise]
f = 3
[[runs.more]]
z = 1
[[runs.more]]
z = 2
[[runs]]
name = "b"
raw = """
[[runs]]
"""
[runs.noise]
f = 4
'''.replace("# end", "# end \u2028 [no.table] \x85 no = 1").replace(
    'raw = """\n[[runs]]\n"""', "raw = '''\n[[runs]]\n\\ '' \"\"\"''''"
)
KEYS = {  # path -> what its line begins with
    ("title",): "title",
    ("text",): "text",
    ("list",): "list",
    ("after",): "after",
    ("quoted é key", "raw # = key", "bare"): '["quoted',
    ("quoted é key", "raw # = key", "bare", "1"): "  1.5",
    ("quoted é key", "raw # = key", "bare", "1", "5"): "  1.5",
    ("quoted é key", "raw # = key", "bare", "a.b"): '"a.b"',
    ("runs", 0): "[[runs]]",
    ("runs", 0, "name"): 'name = "a"',
    ("runs", 0, "noise"): "[runs.noise]",
    ("runs", 0, "noise", "f"): "f = 3",
    ("runs", 0, "more", 0): "[[runs.more]]",
    ("runs", 0, "more", 0, "z"): "z = 1",
    ("runs", 0, "more", 1): "[[runs.more]]",
    ("runs", 0, "more", 1, "z"): "z = 2",
    ("runs", 1): "[[runs]]",
    ("runs", 1, "name"): 'name = "b"',
    ("runs", 1, "raw"): "raw",
    ("runs", 1, "noise"): "[runs.noise]",
    ("runs", 1, "noise", "f"): "f = 4",
}


def test_keys_are_where_they_stand_whatever_strings_and_comments_hold() -> None:
    lines, rows = locate_keys(TRICKY), TRICKY.split("\n")
    assert set(lines) == set(KEYS)
    for path, begin in KEYS.items():
        assert rows[lines[path] - 1].startswith(begin), path
        value = tomllib.loads(TRICKY)  # which has each of these paths
        for part in path:
            value = value[part]
    assert (
        lines["runs", 0]
        < lines["runs", 0, "more", 0]
        < lines["runs", 0, "more", 1]
        < lines["runs", 1]
    )


HOSTILE = {
    "header of blanks": lambda n: '"""\n[[' + " " * n + 'x\n"""',
    "table of blanks": lambda n: '"""\n[' + " " * n + 'x\n"""',
    "key of blanks": lambda n: '"""\n' + "a " * n + '\n"""',
    "bare blanks": lambda n: "[[" + " " * n + "x\n",
    "quotes": lambda n: '"' * n,
    "escaped quotes": lambda n: '"' + '\\"' * n,
    "strings that do not end": lambda n: '"""x\\' * n,
    "raw ones": lambda n: "'''" + "''x" * n,
    "brackets": lambda n: "[ " * n,
    "closing brackets": lambda n: "a = " + "] " * n + "\n",
    "dots": lambda n: "a." * n + "a = 1",
    "dots and blanks": lambda n: "a . " * n + "= 1",
    "comments": lambda n: "#" * n,
    "open strings": lambda n: ('"' + "\\" * 50 + "\n") * (n // 50),
    "lines": lambda n: "\n" * n,
    "tables": lambda n: "[[a]]\n" * n,
    "words": lambda n: "x" * n,
    "escapes": lambda n: "\\" * n,
}


@pytest.mark.parametrize("case", HOSTILE)
def test_finding_keys_takes_time_in_proportion_to_the_text(case: str) -> None:
    """Four times the text takes four times as long; 16 times where time grows as the square, 64 as
    the cube.
    """

    def seconds(n: int) -> float:
        text, times = HOSTILE[case](n), []
        for _ in range(3):
            start = time.process_time()
            locate_keys(text)
            times.append(time.process_time() - start)
        return min(times)

    n = 200
    while (short := seconds(n)) < 0.005 and n < 100_000:
        n *= 2
    assert seconds(4 * n) < 10.0 * max(short, 0.002)


@pytest.mark.parametrize("read", [load_campaign, load_design, read_published])
@pytest.mark.parametrize(
    "text",
    [
        'title = "' + "x" * 3000 + '"',
        "# " + "x\u2028" * 1500,
        '"\u2028' + '"' + ".a" * 1500 + " = 1",
    ],
    ids=["long", "marks", "dots"],
)
def test_lines_are_measured_before_keys_are_looked_for(tmp_path, monkeypatch, read, text) -> None:
    """As lines of the file: a mark that str.splitlines knows does not make two lines of one."""
    monkeypatch.setattr("estim.reading.toml.locate_keys", lambda text: pytest.fail("too early"))
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    with pytest.raises(
        InputError, match=r"c\.toml:1: 'line' must have at most 2000 characters: 30"
    ):
        read(tmp_path / "c.toml")


def test_a_syntax_error_is_told_with_its_line(tmp_path) -> None:
    """Marks that are no ends of lines do not count, and a key that speaks of a line is not taken
    for the place.
    """
    text = (
        'title = "a" # \u2028 \x85\n"k (at line 7, column 1)" = 1\n"k (at line 7, column 1)" = 2\n'
    )
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    told = r"c\.toml:3: 'file' is not valid TOML \(Cannot overwrite a value\): \"k \(at"
    with pytest.raises(InputError, match=told):
        load_campaign(tmp_path / "c.toml")
    (tmp_path / "c.toml").write_text('title = "a"\nradius_m = 0.15(1)\n')
    told = r"c\.toml:2: .* stand in quotes \(Expected newline or .*\): radius_m = 0\.15\(1\)$"
    with pytest.raises(InputError, match=told):
        load_campaign(tmp_path / "c.toml")


def test_mistakes_are_told_with_their_line_behind_strings_that_look_like_tables(tmp_path) -> None:
    text = 'title = """\n[[runs]]\nkind = 3\n"""\nkind = "measured" # \u2028 \u2028\nspeed = 1\n'
    (tmp_path / "c.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"c\.toml:6: 'speed' is not a known key here"):
        load_campaign(tmp_path / "c.toml")
