"""Opening an input file: what is no ordinary file is refused by every reader and never waited for;
size is bounded, whatever the file says of it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from estim import InputError, read_table
from estim.campaign import load_campaign
from estim.campaign.design import load_design
from estim.measurement_model import read_model
from estim.reading.input_file import line_after_comment, lines_of, read_bytes, read_text
from estim.reading.tracker.importing import Choices, import_track
from estim.studies.published import read_published

NO_FILES = [
    p
    for p in (
        "/proc/kmsg",
        "/proc/self/status",
        "/dev/zero",
        "/dev/null",
        "/dev/random",
        "/dev/tty",
    )
    if Path(p).exists()
]
LOAD = """
import sys
from estim.campaign import load_campaign
from estim.common import InputError
from estim.line import read_theta_min
for path in sys.argv[1:]:
    try:
        read_theta_min(load_campaign(path).source)
    except InputError as error:
        print(error)
"""
BODY = 'title = "x"\nkind = "measured"\n[bodies.b]\nradius_m = 0.15\ngamma = 0.2\nkappa = 0.5\n'
RUN = (
    BODY
    + '[[runs]]\nname = "a"\nbody = "b"\nfile = "/proc/kmsg"\nphi_deg = 4.0\ntheta0_deg = 60.0\n'
)
CURVE = (
    'title = "x"\nkind = "measured"\n[curve]\nexpression = "a*x"\nx = "x"\ny = '
    '"y"\nparameters = {a = 1.0}\n'
)
CAMPAIGNS = [
    RUN,
    RUN + 'along = "x"\n',
    CURVE + '[[runs]]\nname = "a"\nfile = "/proc/kmsg"\n',
    BODY + '[line]\nbody = "b"\nfile = "/proc/kmsg"\nu_phi_deg = 1.0\nu_theta_min_deg = 1.0\n',
]


@pytest.mark.skipif(not NO_FILES, reason="a system without such files")
@pytest.mark.parametrize("path", NO_FILES)
def test_what_only_looks_like_a_file_is_refused(path: str) -> None:
    with pytest.raises(
        InputError, match=r"must be a regular file|must not be empty|cannot be read"
    ):
        read_bytes(Path(path))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/kmsg").exists(), reason="no such file")
def test_no_campaign_waits_for_a_file_without_end(tmp_path: Path) -> None:
    """In a process of its own, which a reader that waits would hold until it is ended."""
    paths = [tmp_path / f"{i}.toml" for i in range(len(CAMPAIGNS))]
    for path, text in zip(paths, CAMPAIGNS, strict=True):
        path.write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", LOAD, *map(str, paths)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert done.stdout.count("/proc/kmsg") == done.stdout.count("\n") == len(CAMPAIGNS)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize(
    "read", [load_campaign, load_design, read_published, lambda path: import_track(path, Choices())]
)
@pytest.mark.parametrize("name", ["p.toml", "p.trk", "p.trz", "p.csv"])
def test_no_reader_waits_for_a_pipe(
    tmp_path: Path, read: Callable[[Path], object], name: str
) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=r"must be a regular file, not a pipe"):
        read(tmp_path / name)


@pytest.mark.parametrize("size", [0, 1, 1000, 1001, 3_000_000])
def test_size_is_bounded_by_what_is_read_not_by_what_the_file_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * size)
    status = list(os.stat(path))
    status[6] = 5  # what it says
    said = os.stat_result(status)
    monkeypatch.setattr(Path, "stat", lambda self: said)
    monkeypatch.setattr(os, "fstat", lambda handle: said)
    if size <= 1000:
        assert read_bytes(path, limit=1000) == b"x" * size
    else:
        with pytest.raises(InputError, match=r"'size' must be at most 0 KiB: more than 1000"):
            read_bytes(path, limit=1000)


def test_lines_end_where_editors_end_them() -> None:
    text = "a\nb\r\nc\rd\x0be\x0cf\x1cg\x1dh\x1ei\x85j\u2028k\u2029l\n"
    assert lines_of(text) == ["a", "b", "c", "d\x0be\x0cf\x1cg\x1dh\x1ei\x85j\u2028k\u2029l", ""]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("1\n# a\rb\n", 3),
        ("# a\rb\n", 2),
        ("1\r2\r # a\rb\n", 4),
        ("%a\rb\nc", 2),
        ("# a\rb\rc", None),
        ("# a\r\nb", None),
        ("# a\r\r\nb", None),
        ("a\rb\n", None),
    ],
)
def test_what_follows_a_comment_behind_a_carriage_return_alone_is_found(
    text: str, line: int | None
) -> None:
    assert line_after_comment(text) == line


@pytest.mark.parametrize(
    ("data", "what"),
    [
        ("é".encode("latin-1"), "may be Latin-1"),
        ("a".encode("utf-16"), "is UTF-16"),
        (b"a\r\nb\rc\n\xff", "may be Latin-1"),
    ],
)
def test_bytes_that_are_no_utf8_are_told_with_their_likely_kind(
    tmp_path: Path, data: bytes, what: str
) -> None:
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(
        InputError,
        match=rf"/a:[14]: 'byte' must be UTF-8 text \(this {what}.*: save it again as UTF-8\)",
    ):
        read_text(tmp_path / "a")


def test_outside_a_folder_that_was_named_nothing_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file there and one that is not give the same message; a link is followed first."""
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "private.csv").write_bytes(b"x,y\n1,2\n")
    (home / "own.csv").write_bytes(b"x,y\n1,2\n")
    (home / "link.csv").symlink_to(tmp_path / "private.csv")
    monkeypatch.setenv("ESTIM_INPUTS_WITHIN", str(home))
    assert read_bytes(home / "own.csv")
    for path in ("link.csv", "../private.csv", "../none.csv", "/etc/passwd", "../home-2/own.csv"):
        with pytest.raises(InputError, match=r"lies outside the folder"):
            read_bytes(home / path)
    monkeypatch.delenv("ESTIM_INPUTS_WITHIN")
    assert read_bytes(tmp_path / "private.csv")


def test_a_null_character_is_told_with_its_line_and_the_cure(tmp_path: Path) -> None:
    file = tmp_path / "nul.csv"
    file.write_bytes(b"t,y\n1,2\n2,\x003\n")
    with pytest.raises(InputError, match=r"nul\.csv:3: .*null character.*--encoding utf-16;"):
        read_table(file)


def test_a_file_of_another_kind_is_told_for_what_it_is(project: Path) -> None:
    data = project / "data"
    campaign, design = data / "replica" / "campaign.toml", data / "replica" / "design.toml"
    for read, file, told in (
        (load_design, campaign, "3: 'kind' is a key of a campaign; here a design"),
        (load_campaign, design, "'instruments' is a key of a design of a synthetic campaign"),
        (read_model, campaign, "'kind' is a key of a campaign; here a measurement model"),
        (load_campaign, data / "gum" / "s1-mass.toml", "'measurand' is a key of a measurement"),
    ):
        with pytest.raises(InputError, match=re.escape(told)):
            read(file)
