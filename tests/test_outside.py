"""Files that a campaign names outside its folder: allowed, named and never quoted; names of runs
taken for the same; modes of written files.
"""

from __future__ import annotations

import io
import json
import os
import re
import tracemalloc
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner
from tracker_files import point_mass, trk

from estim import InputError, load_campaign
from estim.cli.commands import cli
from estim.common.errors import EstimError
from estim.common.lookalikes import folded
from estim.common.storage import read_file, write_whole
from estim.line.theta_min_series import read_theta_min
from estim.studies.reanalysis import _published

SECRET = "hunterpassword"
HEAD = 'title = "x"\nkind = "measured"\n'
BODY = (
    "[shared]\nnoise = {sigma_x_m = 0.001}\n[bodies.b]\nradius_m = 0.15\ngamma = 0.2\nkappa = 0.5\n"
)
RUN = (
    HEAD
    + BODY
    + '[[runs]]\nname = "a"\nbody = "b"\nfile = "FILE"\nphi_deg = 4.0\ntheta0_deg = 60.0\n'
)
CURVE = (
    HEAD + '[curve]\nexpression = "a*x"\nx = "t_s"\ny = "x_m"\nparameters = {a = {start = '
    '1.0}}\n[[runs]]\nname = "a"\nfile = "FILE"\n'
)
LINE = HEAD + BODY + '[line]\nbody = "b"\nfile = "FILE"\nu_phi_deg = 1.0\nu_theta_min_deg = 1.0\n'
PUBLISHED = LINE.replace('kind = "measured"', 'kind = "measured"\npublished = "FILE"').replace(
    'file = "FILE"', 'file = "line.csv"'
)
CAMPAIGNS = {
    "run": RUN,
    "track": RUN + 'along = "x"\nunit = "cm"\n',
    "named": RUN + 'track = "A"\n',
    "curve": CURVE,
    "line": LINE,
}
CAMPAIGNS |= {"published": PUBLISHED}


def archive(*names: str) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        for name in names:
            made.writestr(name, SECRET)
    return stream.getvalue()


ROWS = "".join(f"{0.1 * n:.1f},{0.01 * n * n:.3f}\n" for n in range(8))
LINES = {n: (100.0 + n, 100.0) for n in range(8)}
GOOD = trk(point_mass("A", LINES))
CONTENTS: dict[str, bytes] = {
    name: text.encode()
    for name, text in {
        "passwords": f"root:{SECRET}:0:0:root:/root:/bin/sh\n",
        "one word": SECRET,
        "header": f"t_s,{SECRET}\n{ROWS}",
        "cell": f"t_s,x_m\n0.0,{SECRET}\n",
        "angle": f"phi_deg,theta_min_deg\n1,{SECRET}\n",
        "quotes": f't_s,x_m\n"{SECRET}"x,1\n',
        "commented header": f"# t_s,{SECRET}\n",
        "doubled": f"t_s,x_m,{SECRET},{SECRET}\n{ROWS}",
        "tracks": f"{SECRET},B{SECRET}\nt,x,t,x\n",
        "track": f"{SECRET}\nt,x\n1,2\n",
        "rows of a track": f"{SECRET}\nt,x\n{ROWS.replace('0.2,', '0.1,')}",
        "unit": f"t,x ({SECRET[:5]})\n{ROWS}",
        "date": f"{SECRET[:6]}-2019;1\n",
        "table": f"[{SECRET}]\na = 1\n",
        "key": f"{SECRET} = 1\n",
        "key twice": f"paper = 1\n{SECRET} = 1\n{SECRET} = 2\n",
        "no toml": f"{SECRET}\n= 1\n",
        "kind of paper": f'paper = {{{SECRET} = "{SECRET}"}}\n',
        "names.trk": f"<{SECRET}/>",
        "class.trk": f'<object class="{SECRET}"/>',
        "encoding.trk": f'<?xml version="1.0" encoding="{SECRET}"?><object/>',
        "tracks.trk": trk(point_mass(SECRET, LINES), point_mass(f"B{SECRET}", LINES)),
        "same.trk": trk(point_mass("A", LINES), point_mass("A", LINES), point_mass(SECRET, LINES)),
        "few.trk": trk(point_mass(SECRET, {0: (1.0, 2.0)})),
        "at rest.trk": trk(point_mass(SECRET, dict.fromkeys(range(8), (1.0, 2.0)))),
        "unit.trk": GOOD.replace(">m<", f">{SECRET}<"),
        "point.trk": GOOD.replace('name="[3]"', f'name="{SECRET}"'),
        "number.trk": GOOD.replace(">101.0<", f">{SECRET}<"),
        "text.trk": SECRET,
        "no zip.trz": SECRET,
    }.items()
} | {
    "latin": f"t_s,x_m\n{SECRET}\xe9".encode("latin-1"),
    "several.trz": archive(f"{SECRET}.trk", "a.trk"),
    "other.trz": archive(f"{SECRET}.txt"),
    "damaged.trz": archive(f"{SECRET}.trk").replace(SECRET.encode(), SECRET[::-1].encode(), 1),
}


def read(path: Path) -> None:
    campaign = load_campaign(path)
    if campaign.source.line is not None:
        _published(campaign)
        read_theta_min(campaign.source)


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "campaign").mkdir()
    (tmp_path / "campaign" / "line.csv").write_text("phi_deg,theta_min_deg\n1,5\n2,10\n3,15\n")
    return tmp_path / "campaign"


def told(home: Path, kind: str, file: str) -> str:
    """What is said of a campaign of this kind that names `file`; "" where it is read."""
    (home / "c.toml").write_text(CAMPAIGNS[kind].replace("FILE", file))
    try:
        read(home / "c.toml")
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("case", CONTENTS)
def test_nothing_of_a_file_outside_the_folder_is_quoted(home: Path, case: str) -> None:
    """By path and by link, as every kind of file; inside the folder the same mistakes are told with
    what stands there.
    """
    name = f"f{Path(case).suffix or '.csv'}"
    (home.parent / name).write_bytes(CONTENTS[case])
    (home / f"in{name}").write_bytes(CONTENTS[case])
    (home / f"link{name}").symlink_to(home.parent / name)
    shown = []
    for kind in CAMPAIGNS:
        inside = told(home, kind, f"in{name}")
        for file in (f"../{name}", str(home.parent / name), f"link{name}"):
            said = told(home, kind, file)
            assert bool(said) == bool(inside)
            words = re.findall(r"\w{4,}", said.replace(str(home), ""))
            assert not any(
                word in SECRET or SECRET[:5] in word or SECRET[::-1] in word for word in words
            ), said
            assert (
                not said
                or "a file outside the campaign's folder is not quoted" in said
                or said.startswith(str(home / "c.toml"))
            ), said
        shown.append(inside)
    assert any(shown)


def test_the_oracle_sees_what_is_quoted_inside(home: Path) -> None:
    (home / "f.csv").write_bytes(CONTENTS["header"])
    assert SECRET in told(home, "run", "f.csv")


def test_the_place_and_the_rule_are_still_told(home: Path) -> None:
    (home.parent / "f.csv").write_text(f"t_s,x_m\n{ROWS}0.9,{SECRET}\n")
    said = (
        "../f.csv:10: 'x_m' must be a number (a file outside the campaign's folder is not quoted)"
    )
    assert told(home, "run", "../f.csv").endswith(said)
    assert told(home, "curve", "../f.csv").endswith(said)


def test_a_file_outside_the_folder_is_allowed_and_named(home: Path) -> None:
    (home.parent / "f.csv").write_text(f"t_s,x_m\n{ROWS}")
    (home / "link.csv").symlink_to("../f.csv")
    (home / "in.csv").write_text(f"t_s,x_m\n{ROWS}")
    (home / "sub").mkdir()
    said = {}
    for file in (
        "../f.csv",
        "link.csv",
        "in.csv",
        "sub/../in.csv",
        f"../{home.name}/in.csv",
        str(home / "in.csv"),
    ):
        assert told(home, "curve", file) == ""
        campaign = load_campaign(home / "c.toml")
        said[file] = campaign.tables["a"].facts
        assert campaign.source.files_outside() == said[file]
    assert said.pop("../f.csv") == ("../f.csv lies outside the folder of the campaign",)
    assert said.pop("link.csv") == (
        "link.csv lies outside the folder of the campaign: a link leads to ../f.csv",
    )
    assert set(said.values()) == {()}


def test_a_link_to_the_folder_is_the_folder(home: Path) -> None:
    (home / "in.csv").write_text(f"t_s,x_m\n{ROWS}")
    assert told(home, "curve", "in.csv") == ""
    (home.parent / "other").symlink_to(home)
    assert load_campaign(home.parent / "other" / "c.toml").source.files_outside() == ()


@pytest.mark.usefixtures("undrawn")
def test_terminal_and_report_say_that_a_file_lies_outside(home: Path) -> None:
    (home.parent / "f.csv").write_text(
        "t_s,x_m\n" + "".join(f"{n},{2 * n + (-1) ** n * 0.1:.2f}\n" for n in range(1, 9))
    )
    assert told(home, "curve", "../f.csv") == ""
    done = CliRunner().invoke(
        cli, ["fit", str(home / "c.toml"), "--out", str(home / "out"), "--max-steps", "50"]
    )
    sentence = "../f.csv lies outside the folder of the campaign"
    assert f"note: {sentence}\n" in done.stdout
    assert sentence in (home / "out" / "report.md").read_text()
    assert sentence in json.loads((home / "out" / "result.json").read_text())["runs"]["a"]["facts"]


# names of runs


ALIKE = [
    ("Run", "run"),
    ("a", "A"),
    ("straße", "STRASSE"),
    ("ﬁt", "fit"),
    ("\u03a91", "\u21261"),
    ("x.", "x"),
    ("K1", "\u212a1"),
    ("\uff52un", "run"),
    ("В", "в"),
]
APART = [
    ("a", "b"),
    ("run-1", "run-l"),
    ("п", "n"),
    ("в", "b"),
    ("н", "h"),
    ("α", "a"),
    ("ν", "v"),
    ("a.b", "ab"),
    ("a-1", "a_1"),
    ("0", "o"),
]
APART += [("µ", "u")]


@pytest.mark.parametrize(("one", "other"), ALIKE)
def test_names_that_are_taken_for_the_same_are_refused_with_both_places(
    home: Path, one: str, other: str
) -> None:
    (home / "in.csv").write_text(f"t_s,x_m\n{ROWS}")
    text = CURVE.replace("FILE", "in.csv").replace('name = "a"', f'name = "{one}"')
    (home / "c.toml").write_text(
        text
        + '[[runs]]\nname = "between"\nfile = "in.csv"\n'
        + f'[[runs]]\nname = "{other}"\nfile = "in.csv"\n'
    )
    rule = (
        r"c\.toml:15: 'name' must differ from another name in more than case or Unicode form "
        r"\(the other stands on line 9\): "
    )
    with pytest.raises(InputError, match=rule + re.escape(other)):
        load_campaign(home / "c.toml")


@pytest.mark.parametrize(("one", "other"), APART)
def test_names_that_can_be_told_apart_are_taken(one: str, other: str) -> None:
    assert folded(one) != folded(other)


def test_names_of_the_report_are_refused_in_any_form(home: Path) -> None:
    for name in ("Report.md", "ﬁgures", "FIGURES", "draws.nc."):
        (home / "c.toml").write_text(CURVE.replace('name = "a"', f'name = "{name}"'))
        with pytest.raises(InputError, match="must not be the name of a file of the report"):
            load_campaign(home / "c.toml")


# what is written


@pytest.mark.skipif(os.name != "posix", reason="a system without umask")
@pytest.mark.parametrize(
    ("umask", "mode"), [(0o022, 0o644), (0o002, 0o664), (0o027, 0o640), (0o077, 0o600)]
)
def test_what_is_written_has_the_mode_that_the_umask_leaves(
    tmp_path: Path, umask: int, mode: int
) -> None:
    before = os.umask(umask)
    try:
        for _ in range(2):  # also in place of an earlier file
            write_whole(tmp_path / "new" / "a.csv", b"1")
    finally:
        os.umask(before)
    assert (tmp_path / "new" / "a.csv").stat().st_mode & 0o777 == mode
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o777 & ~umask
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.csv"]


def test_a_limit_of_size_costs_no_memory(tmp_path: Path) -> None:
    """The longest chain that a command allows would be 49 GB: memory is taken for what is there."""
    write_whole(tmp_path / "a", b"12345")
    tracemalloc.start()
    try:
        assert read_file(tmp_path / "a", at_most=10**15) == b"12345"
        assert tracemalloc.get_traced_memory()[1] < 10**6
    finally:
        tracemalloc.stop()
    assert read_file(tmp_path / "a", at_most=5) == b"12345"
    with pytest.raises(
        EstimError, match=r"is larger than anything that estim writes there \(4 bytes\)"
    ):
        read_file(tmp_path / "a", at_most=4)
