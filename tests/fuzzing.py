"""Damaged input files: sound ones of every kind, ways to damage them, and one call that reads
whatever came out.

The readers promise a record or an `EstimError` in bounded time, whatever the bytes.
`tests/test_fuzz.py` tries some hundred of each kind, `benchmarks/fuzz.py` as many as it is told.
"""

from __future__ import annotations

import io
import random
import re
import zipfile
from pathlib import Path

import numpy as np
from tracker_files import point_mass, stored, trk

from estim.campaign import Campaign, load_campaign
from estim.campaign.design import load_design
from estim.common.errors import EstimError
from estim.line.theta_min_series import read_theta_min
from estim.reading.run import read_run
from estim.reading.tracker.importing import Choices, import_track

KINDS = (
    "csv",
    "imported",
    "export",
    "toml",
    "robust",
    "curve",
    "formula",
    "design",
    "line",
    "trk",
    "trz",
)
FILES = {
    "csv": "a.csv",
    "imported": "i.csv",
    "export": "a.txt",
    "toml": "c.toml",
    "robust": "c.toml",
    "curve": "c.toml",
    "formula": "c.toml",
}
FILES |= {"design": "d.toml", "line": "theta_min.csv", "trk": "a.trk", "trz": "a.trz"}
_REPLICA = Path(__file__).resolve().parents[1] / "data" / "replica"

RUN = b"t_s,x_m,v_m_s\n# a run\n" + b"".join(
    f"{0.02 * n:.2f},{0.0001 * n * n:.6f},{0.01 * n:.4f}\n".encode() for n in range(20)
)
ANGLES = b"%Time (s)\tTheta (rad)\tOmega (rad/s)\n\t%2/27/2015\n"
ANGLES += b"".join(
    f"{0.1 * n:.1f}\t{0.01 * n * n:.4f}\t{0.2 * n:.3f}\n".encode() for n in range(12)
)
EXPORT = b"A\nt;x;y;v\n" + b"".join(
    f"{0.02 * n:.3E};{0.1 + 0.001 * n * n:.6E};{0.5:.6E};\n".replace(".", ",").encode()
    for n in range(12)
)
TWO = b",A,,B,\nt,x,y,x,y\n" + b"".join(
    f"{0.02 * n},{0.001 * n * n},{0.5},{0.002 * n * n},{0.6}\n".encode() for n in range(12)
)
LINE = b"phi_deg,theta_min_deg,u_phi_deg\n" + b"".join(
    f"{n}.5,{5 * n}.25,0.1\n".encode() for n in range(1, 8)
)
CAMPAIGN = b"""title = "x"
kind = "measured"
[shared]
g = 9.81
rolling_resistance = {prior = "half-normal", scale = 0.005}
noise = {sigma_x_m = "0.001(2)", derivative = "central", scatter = 0.01}
[bodies.b]
radius_m = "0.1500(5)"
mass_disk_kg = "0.3030(10)"
mass_particle_kg = "0.070(5)"
kappa = {prior = "uniform", low = 0.0, high = 1.0}
[[runs]]
name = "one"
body = "b"
file = "run.csv"
phi_deg = "4.0(4)"
theta0_deg = "60.0(15)"
window = {x_min_m = 0.0, x_max_m = 0.43}
[[runs]]
name = "two"
body = "b"
file = "two.txt"
track = "A"
along = "fit"
release = 0.1
phi_rad = "0.07 +/- 0.01"
theta0_deg = {prior = "truncated-normal", mean = 60.0, sd = 2.0, low = 0.0}
[line]
file = "theta_min.csv"
body = "b"
u_theta_min_deg = 1.5
"""
_NOISE = b'noise = {sigma_x_m = "0.001(2)", derivative = "central", scatter = 0.01}'
ROBUST = CAMPAIGN.replace(
    _NOISE, b'noise = {model = "positions", sigma_x_m = 0.00001, robust = "mixture"}'
)
ROBUST = ROBUST.replace(
    b"release = 0.1",
    b'release = "keep"\nunit = "cm"\ndrop_duplicates = true\nrelease_time_s = '
    b'"0.00(1)"\noffset_m = 0.0',
)
MODEL = CAMPAIGN.replace(b"run.csv", b"i.csv").replace(
    _NOISE,
    b'noise = {model = "independent", sigma_v_m_s = 0.01, derivative = "central", sigma_x_m '
    b'= 0.00001, robust = "student-t"}',
)
IMPORTED = (
    b"# made by estim import\n# track 'A' of a.trk\n# tilt of the fitted line 4.300 deg "
    b"against the x axis, positive uphill,"
)
IMPORTED += (
    b" standard uncertainty 0.020 deg from the scatter\n# warning: 2 of 30 frames are "
    b"missing\nt_s,x_m,_across_m,_frame\n"
)
IMPORTED += b"".join(f"{0.02 * n:.2f},{0.0001 * n * n:.6f},0.1,{n}\n".encode() for n in range(20))
CURVE = b"""title = "x"
kind = "measured"
[curve]
expression = "A*exp(-b*x)*cos(2*pi*x/T + p) + where(x > 1, c, 0) + max(d, sqrt(abs(x)))"
x = {column = "t_s", name = "time t", unit = "s"}
y = {column = "x_m", name = "position", unit = "m"}
u_y = "0.001(2)"
robust = "mixture"
window = {min = 0.0, max = 30.0}
errors = {scale_x = 0.001, zero = {kind = "zero_y", u = 0.1}}
[curve.parameters]
T = {start = 1.0, low = 0.1, high = 10.0, unit = "s", meaning = "period"}
b = {prior = "half-normal", scale = 1.0}
c = {value = "0.0(1)", unit = "m"}
d = 0.25
A = {start = 5.0, unit = "m"}
p = {prior = "uniform", low = -4.0, high = 4.0}
[[runs]]
name = "one"
file = "i.csv"
[[runs]]
name = "two"
file = "i.csv"
u_y = 0.001
u_x = 0.01
robust = "student-t"
[runs.parameters]
A = {start = 2.0}
"""
SHORT = (
    re.sub(rb'expression = ".*"', b'expression = "x + a"', CURVE.split(b"[curve.parameters]")[0])
    + b"[curve.parameters]\na = {start = 1.0}\n"
)
SHORT += b'[[runs]]\nname = "one"\nfile = "i.csv"\n'
PIECES = (
    "x",
    "a",
    "a",
    "1",
    "0",
    "-1",
    "2.5",
    "1e308",
    "1e-320",
    "1e999",
    "9" * 30,
    "9" * 400,
    "pi",
    "e",
    "+",
    "-",
    "*",
    "/",
    "**",
    "**",
    "//",
    "%",
    "@",
    "(",
    "(",
    ")",
    ")",
    ",",
    ".",
    "[",
    "]",
    "{",
    "}",
    ":",
    ":=",
    "=",
    "==",
    "<",
    ">",
    "!=",
    " ",
    " ",
    "\\n",
    "\\t",
    "\\\\",
    "#",
    "'",
    "_",
    "__class__",
    "sin(",
    "cos(",
    "exp(",
    "log(",
    "sqrt(",
    "abs(",
    "max(",
    "min(",
    "where(",
    "erf(",
    "hypot(",
    "arctan2(",
    "heaviside(",
    "lambda",
    "if",
    "else",
    "and",
    "not",
    "is",
    "None",
    "True",
    "x.real",
    "import",
    "__import__('os')",
    "open('a')",
    "eval(",
    "().__class__",
    "f'{x}'",
    "1j",
    "0x1F",
    "1_0",
    "x if x else a",
    "*a",
    "a=1",
    "\u03c0",
    "\u00b2",
    "\u0000"[:0],
    "yield",
    "await",
    "...",
    "**9**9**9",
    "sin(x)(a)",
    "((((((((",
    "-" * 50,
    "x*" * 30,
)


def _formula(source: random.Random) -> bytes:
    """A campaign whose formula is a string of pieces, or one nested far too deeply or grown far too
    long.
    """
    text = "".join(source.choice(PIECES) for _ in range(source.randrange(1, 12)))
    depth = source.choice((2, 50, 500))
    around = (text, text, text, f"a*x + {text}", f"exp({text})", f"x**a**{text}")
    around += ("(" * depth + text + ")" * depth, "sin(" * depth + "a*x" + ")" * depth)
    chosen = source.choice(around).replace('"', "'")[:1900]
    return SHORT.replace(b"x + a", chosen.encode())


VIDEO = trk(
    point_mass("A", {n: (100.0 + 5.0 * n, 200.0 - 2.0 * n) for n in range(12)}),
    point_mass("B", {3: (1.0, 2.0)}),
    axes={0: (100.0, 200.0, 4.0, 50.0, 50.0), 5: (110.0, 190.0, 0.0, 50.0, 50.0)},
    start=1,
    step=1,
    count=9,
    start_time=1.0,
    video='<property name="video" type="object"><object class="v"><property name="start_times" '
    'type="array"><property name="array" type="string">'
    "{0.0,40.0,80.0,120.0,160.0,200.0,240.0,281.0,320.0,360.0,400.0}</property></property></object></property>",
).encode()

BASES: dict[str, tuple[bytes, ...]] = {
    "csv": (RUN, ANGLES),
    "imported": (IMPORTED,),
    "export": (EXPORT, TWO),
    "toml": (CAMPAIGN,),
    "robust": (ROBUST, MODEL),
    "curve": (CURVE,),
    "formula": (SHORT,),
    "design": ((_REPLICA / "design.toml").read_bytes(),),
    "line": (LINE,),
    "trk": (VIDEO,),
    "trz": (stored(VIDEO.decode()), stored(VIDEO.decode(), how=zipfile.ZIP_STORED)),
}
TOKENS = (
    b"1e999",
    b"-1e308",
    b"1e-320",
    b"nan",
    b"inf",
    b"-",
    b"",
    b"0",
    b"-0.0",
    b"9" * 400,
    b"1_0",
    b"0x1F",
    b"1,5",
    b"1.5.5",
    b"\x00",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b'"',
    b"'",
    b'"""',
    b"\n",
    b"\r",
    b"\r\n",
    b"\t",
    b";",
    b",",
    b"|",
    b"#",
    b"%",
    b"# t,x\n",
    b"t,x\n",
    b"[[runs]]\n",
    b"[a.b.c]\n",
    b"a.b = 1\n",
    b"{",
    b"}",
    b"[",
    b"]",
    b"=",
    b"(",
    b")",
    b"+/-",
    b"\xc2\xb1",
    b"\xe2\x80\xa8",
    b"1979-05-27T07:32:00Z",
    b"true",
    b"<",
    b">",
    b"&",
    b"&lt;",
    b"&#0;",
    b"]]>",
    b"<!DOCTYPE a [<!ENTITY b 'c'>]>",
    b"<![CDATA[x]]>",
    b"<?x?>",
    b"<object>",
    b"</object>",
    b"<property>",
    b"[0]",
    b"12.mai",
    b"2019-02-17",
    b"60.0(15)",
    b"(5)",
    b"1.0(0)",
    b"1 +/- nan",
    b"..",
    b"/",
    b"\\",
    b"\\u0000",
    b"a.trz",
    b"c.toml",
    b".",
    b"-1",
    b"1e6",
    b"1e9",
    b"1e-9",
    b"0.0",
    b"2",
    b"360",
    b"1e5",
)


def damage(data: bytes, source: random.Random) -> bytes:
    """`data` with one to six changes: bytes, pieces and lines lost, doubled, swapped or replaced by
    what readers stumble over.
    """
    for _ in range(source.choice((1, 1, 1, 1, 2, 4))):
        data = _change(data, source)
    return data


def _change(data: bytes, source: random.Random) -> bytes:
    low, high = sorted(source.randrange(len(data) + 1) for _ in range(2))
    short = min(high, low + source.randrange(1, 12))
    token = source.choice(TOKENS)
    match source.randrange(16):
        case 0:
            return data[:low] + bytes([source.randrange(256)]) + data[low + 1 :]
        case 1:
            return data[:low] + data[short:]
        case 2:
            return data[:low] + data[low:short] * source.choice((2, 3, 50)) + data[short:]
        case 3:
            return data[:low] + token + data[low:]
        case 4:
            return data[:low] + token + data[short:]
        case 5:
            return data[:low]
        case 6:
            lines = data.split(b"\n")
            i, j = source.randrange(len(lines)), source.randrange(len(lines))
            lines[i], lines[j] = lines[j], lines[i]
            return b"\n".join(lines)
        case 7:
            lines = data.split(b"\n")
            del lines[source.randrange(len(lines))]
            return b"\n".join(lines)
        case _:  # most often: it leaves the form and changes the meaning
            return _another_word(data, token, source)


def _another_word(data: bytes, token: bytes, source: random.Random) -> bytes:
    """A whole number or word replaced, a number mostly by a number: the file stays in form."""
    words = list(re.finditer(rb"[\w.+-]+", data))
    if not words:
        return token
    word = source.choice(words)
    if re.fullmatch(rb"[+-]?\d*\.?\d+([eE][+-]?\d+)?", word[0]) and source.random() < 0.7:
        size = 10.0 ** source.choice((-300, -9, -3, -2, -1, 0, 0, 0, 1, 2, 3, 9, 300))
        token = format(
            source.uniform(-1.0, 3.0) * size,
            source.choice((".0f", ".2f", "r", ".3e")).replace("r", ""),
        ).encode()[:320]
    return data[: word.start()] + token + data[word.end() :]


def sample(kind: str, source: random.Random) -> bytes:
    """Bytes for a file of `kind`: mostly a damaged sound file, sometimes noise."""
    if source.random() < 0.05:
        return source.randbytes(source.randrange(300))
    if kind == "formula":
        return _formula(source)
    base = source.choice(BASES[kind])
    if kind == "trz" and source.random() < 0.6:
        inner = damage(VIDEO, source)
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(source.choice(("a.trk", "../a.trk", "b/a.TRK")), inner)
        return stream.getvalue()
    return damage(base, source)


def _evaluate(campaign: Campaign) -> None:
    """Value and slope of the curve at the start: what a formula computes, however odd, is an array
    of numbers.
    """
    problem = campaign.problem(campaign.run_names)
    run = problem.runs[0]
    with np.errstate(all="ignore"):
        arguments = run.bind(problem.named(problem.start()))
        local = run.curve.local(run.x, arguments)
        assert np.broadcast_shapes(
            np.shape(run.curve.value(run.x, arguments)), np.shape(local.slope), (1, run.n_obs)
        ) == (1, run.n_obs)


def read(kind: str, data: bytes, folder: Path) -> EstimError | None:
    """Read `data` as a file of `kind` in `folder`; the refusal, or None where a record came back.
    Anything else is raised.
    """
    campaigns = ("toml", "line", "robust", "curve", "formula")
    others = (
        ("run.csv", RUN),
        ("two.txt", TWO),
        ("i.csv", IMPORTED),
        ("theta_min.csv", LINE),
        ("c.toml", CAMPAIGN),
    )
    for name, content in (*others, (FILES[kind], data)):
        if name == FILES[kind] or kind in campaigns:
            (folder / name).write_bytes(content)
    path = folder / FILES[kind]
    try:
        if kind in ("csv", "imported"):
            read_run(path, name="a")
        elif kind == "design":
            load_design(path)
        elif kind in campaigns:
            campaign = load_campaign(folder / "c.toml")
            if kind == "formula":
                _evaluate(campaign)
            if campaign.source.line is not None:
                read_theta_min(campaign.source)
        else:
            import_track(path, Choices(track="A"))
    except EstimError as error:
        return error
    return None
