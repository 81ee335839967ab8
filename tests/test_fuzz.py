"""Whatever bytes a file holds, reading it gives a record or an `EstimError`, in bounded time
(`benchmarks/fuzz.py` runs more).
"""

from __future__ import annotations

import random
import tempfile
import time
from pathlib import Path

import pytest
from fuzzing import BASES, FILES, KINDS, TOKENS, read, sample
from hypothesis import given, settings
from hypothesis import strategies as st
from tracker_files import stored

_SECONDS = 10.0
# those have the reader of "csv" or "toml"
READERS = [kind for kind in KINDS if kind not in ("imported", "robust", "curve", "formula")]
WORDS = (*TOKENS, b"t", b"x", b"y", b" ", b"t_s,x_m\n", b"0.1", b"1")
QUICK, WHOLE = (
    settings(max_examples=n, deadline=None, derandomize=True, database=None) for n in (20, 60)
)


def attempt(kind: str, data: bytes, *, seconds: float = _SECONDS) -> bool:
    """Whether a record came back; fails where reading takes long or raises anything but an
    EstimError.
    """
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        refused = read(kind, data, Path(folder))
        assert time.process_time() - start < seconds
        assert "\n" not in str(refused)
    return refused is None


@pytest.mark.parametrize("kind", KINDS)
def test_the_sound_files_are_read(kind: str) -> None:
    assert all(attempt(kind, data) for data in BASES[kind])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@QUICK
@given(seed=st.integers(0, 2**32))
def test_damaged_files_give_a_record_or_one_line(kind: str, seed: int) -> None:
    attempt(kind, sample(kind, random.Random(seed)))


@pytest.mark.statistics
@pytest.mark.parametrize("kind", KINDS)
def test_many_damaged_files_give_a_record_or_one_line(kind: str) -> None:
    for seed in range(600):
        attempt(kind, sample(kind, random.Random(seed)))


BYTES, LISTS = (
    st.binary(max_size=300),
    st.lists(st.sampled_from(WORDS) | st.text(max_size=5).map(str.encode), max_size=60),
)


@pytest.mark.parametrize("kind", READERS)
@QUICK
@given(data=BYTES)
def test_any_bytes_give_a_record_or_one_line(kind: str, data: bytes) -> None:
    attempt(kind, data)


@pytest.mark.slow
@pytest.mark.parametrize("kind", READERS)
@QUICK
@given(words=LISTS)
def test_any_words_give_a_record_or_one_line(kind: str, words: list[bytes]) -> None:
    attempt(kind, b"".join(words))


@pytest.mark.statistics
@pytest.mark.parametrize("kind", READERS)
@WHOLE
@given(data=BYTES, words=LISTS)
def test_many_bytes_and_words_give_a_record_or_one_line(
    kind: str, data: bytes, words: list[bytes]
) -> None:
    attempt(kind, data)
    attempt(kind, b"".join(words))


LAUGHS = (
    "<!DOCTYPE o [<!ENTITY a0 'ha'>"
    + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 10))
    + "]><object>&a9;</object>"
)
LARGE = {
    "entities that expand to 2 GB": ("trk", lambda: LAUGHS.encode()),
    "the same in an archive": ("trz", lambda: stored(LAUGHS)),
    "zip bomb": ("trz", lambda: stored("<object>" + " " * 100_000_000)),
    "numbers as a bomb": ("trz", lambda: stored("<object>" + "<property/>" * 10_000_000)),
    "line of 100 MB": ("csv", lambda: b"t_s,x_m\n" + b"1" * 100_000_000),
    "export of 100 MB": ("export", lambda: b"t,x\n" + b"1" * 100_000_000),
    "campaign of 100 MB": ("toml", lambda: b"title = " + b"[" * 100_000_000),
    "campaign of a long dotted key": ("toml", lambda: b"a." * 100_000 + b"a = 1"),
    "campaign of many dotted keys": (
        "toml",
        lambda: b"".join(b"k%d" % n + b".a" * 900 + b" = 1\n" for n in range(60)),
    ),
    "campaign of many tables": ("toml", lambda: b"".join(b"[a%d]\n" % n for n in range(25_000))),
    "campaign of deep arrays": ("toml", lambda: b"a = " + b"[\n" * 100_000),
    "campaign of many keys": ("toml", lambda: b"".join(b"k%d = 1\n" % n for n in range(25_000))),
    "video of 100 MB": ("trk", lambda: b"<object>" + b"1" * 100_000_000),
    "a run of a million rows": (
        "csv",
        lambda: b"t_s,x_m\n" + b"".join(b"%d,1\n" % n for n in range(1_100_000)),
    ),
}
LONG = {  # below the limit of a file's size, so that reading has to end by itself
    "line": ("csv", lambda n: b"t_s,x_m\n" + b"1," * (n // 2)),
    "header": ("csv", lambda n: b"t_s," * (n // 4)),
    "export in one line": ("export", lambda n: b"t;x;" * (n // 4)),
    "attribute": ("trk", lambda n: b'<object class="' + b"1" * n + b'"/>'),
    "text": ("trk", lambda n: b"<object>" + b"1" * n + b"</object>"),
}


@pytest.mark.slow
@pytest.mark.parametrize("size", [15, pytest.param(60, marks=pytest.mark.statistics)])
@pytest.mark.parametrize("case", LONG)
def test_long_texts_are_refused_in_a_time_that_grows_with_their_length(
    case: str, size: int
) -> None:
    """`size` in MB; both lengths may take equally long for each."""
    kind, make = LONG[case]
    assert not attempt(kind, make(size * 10**6), seconds=_SECONDS * size / 60)


@pytest.mark.slow
@pytest.mark.parametrize("case", LARGE)
def test_bombs_are_refused_in_bounded_time(case: str) -> None:
    kind, make = LARGE[case]
    assert not attempt(kind, make())


def test_every_kind_of_file_has_a_base() -> None:
    assert set(KINDS) == set(BASES) == set(FILES)


FOUND = {
    "toml": [
        (b'mass_disk_kg = "0.3030(10)"', b"mass_disk_kg = 1e300"),
        (b'mass_particle_kg = "0.070(5)"', b'mass_particle_kg = "1e300(5)"'),
    ],
    "design": [
        (b"phi_deg = 4.0", b"phi_deg = inf"),
        (b"rolling_resistance = ", b"rolling_resistance = 1e308 #"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "change"), [(kind, change) for kind, changes in FOUND.items() for change in changes]
)
def test_what_damaged_files_once_broke_is_refused(kind: str, change: tuple[bytes, bytes]) -> None:
    data = BASES[kind][0]
    assert change[0] in data
    assert not attempt(kind, data.replace(*change, 1))
