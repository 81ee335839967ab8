"""A chain on disk: resumed bit for bit, refused where anything else changed, and never harmed by a kill or by a reader."""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estim import versions
from estim.campaign import load_campaign
from estim.common.errors import EstimError, InputError, Interrupted
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.posterior import Posterior
from estim.problem.priors import Normal
from estim.sampling import ensembles, stepping
from estim.sampling import keys as fingerprints
from estim.sampling.chain import Chain, Target, sample_posterior
from estim.sampling.checkpoint import Store, read_checkpoint
from estim.sampling.chunk import Chunk

QUICK = Target(ess=1e9, max_step=240, n_ensemble=2, n_walker=14)


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Four independent normals; `shift` is hidden from the key, as an error in the code would be."""

    sds: np.ndarray
    shift: float = field(default=0.0, compare=False)
    names: tuple[str, ...] = ("a", "b", "c", "d")

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return np.asarray(self.shift - 0.5 * np.sum((draws / self.sds) ** 2, axis=1))


SDS = np.array([1.0, 2.0, 0.5, 1.0])


def until(n_step: int) -> Callable[[], bool]:
    """A stop that says yes after `n_step` steps."""
    left = iter([False] * (n_step - 1))
    return lambda: next(left, True)


def sampled(store: Store | None, stop: Callable[[], bool] | None = None, density: Gaussian | None = None, seed: int = 7) -> Chain:
    target = density or Gaussian(SDS)
    return sample_posterior(target, np.zeros(4), np.diag(SDS**2), target=QUICK, rng=np.random.default_rng(seed), store=store, stop=stop)


def interrupted(folder: Path, n_step: int, *, interval: float = 1e9) -> None:
    with pytest.raises(Interrupted):
        sampled(Store(folder, resume=True, interval=interval), until(n_step))


def same(a: Chain, b: Chain) -> bool:
    arrays = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("draws", "log_density", "acceptance"))
    return arrays and a.n_burn == b.n_burn and a.stuck == b.stuck and a.convergence.message == b.convergence.message


@pytest.fixture(scope="module")
def whole() -> Chain:
    return sampled(None)


def test_chain_with_a_store_is_the_chain_without_one(whole: Chain, tmp_path: Path) -> None:
    assert same(sampled(Store(tmp_path, interval=0.0)), whole)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert np.array_equal(kept.draws[:, whole.n_burn :], whole.draws)
    assert np.array_equal(kept.log_density[:, whole.n_burn :], whole.log_density)


@pytest.mark.parametrize("stops", [(1,), (57,), (200,), (203,), (240,), (10, 11, 100, 20)])
def test_split_chain_is_the_whole_one_in_every_bit(whole: Chain, tmp_path: Path, stops: tuple[int, ...]) -> None:
    for n_step in stops:
        interrupted(tmp_path, n_step, interval=0.01)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.n_step == sum(stops)
    assert same(sampled(Store(tmp_path, resume=True)), whole)


def test_completed_chain_is_read_and_not_sampled_again(whole: Chain, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What `fit --resume` relies on for the runs that were done before the interruption."""
    assert same(sampled(Store(tmp_path)), whole)
    asked: list[int] = []
    original = Gaussian.log_density
    monkeypatch.setattr(Gaussian, "log_density", lambda density, draws: asked.append(len(draws)) or original(density, draws))
    assert same(sampled(Store(tmp_path, resume=True)), whole)
    assert len(asked) == 3  # the starting points of two ensembles, and the guard


def _without(what: str) -> Callable[[Chunk], tuple[object, ...]]:
    """`Chunk.random_state` of a careless implementation."""

    def random_state(chunk: Chunk) -> tuple[object, ...]:
        if what == "the random state":
            return np.random.RandomState(1).get_state()
        return "MT19937", chunk.random_key, int(chunk.random_place[0]), 0, 0.0

    return random_state


@pytest.fixture
def one_left_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Normal numbers come in pairs, and a step takes an even number of them: one that is taken before leaves one over after every step."""
    original = ensembles.sampler_of

    def sampler_of(*args: Any, **settings: Any) -> Any:
        sampler = original(*args, **settings)
        sampler._random.randn()
        return sampler

    monkeypatch.setattr(ensembles, "sampler_of", sampler_of)


@pytest.mark.usefixtures("one_left_over")
@pytest.mark.parametrize("what", ["nothing", "the random state", "the normal number left over"])
def test_chain_resumed_without_its_random_state_would_differ(tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupted(tmp_path, 57)
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.random_place[1] == 1
    if what != "nothing":
        monkeypatch.setattr(Chunk, "random_state", _without(what))
    assert same(sampled(Store(tmp_path, resume=True)), sampled(None)) == (what == "nothing")


def test_chain_resumed_without_its_acceptance_counts_would_differ(whole: Chain, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = stepping.Walk._chunk
    monkeypatch.setattr(stepping.Walk, "_chunk", lambda walk, first: replace(original(walk, first), accepted=np.zeros((2, 14))))
    interrupted(tmp_path, 57)
    assert not same(sampled(Store(tmp_path, resume=True)), whole)


# what the key sees


@pytest.fixture(scope="module")
def fit() -> Fit:
    campaign = load_campaign(Path(__file__).parents[1] / "data" / "replica" / "campaign.toml")
    return fit_least_squares(campaign.problem(["heavy-04"]), rng=np.random.default_rng(1), n_start=1)


def _with_run(posterior: Posterior, **changes: object) -> Posterior:
    problem = posterior.problem
    return problem_of(posterior, runs=(replace(problem.runs[0], **changes),))


def problem_of(posterior: Posterior, **changes: object) -> Posterior:
    return replace(posterior, problem=replace(posterior.problem, **changes))


def _other_prior(posterior: Posterior) -> Posterior:
    first, *others = posterior.problem.parameters
    assert isinstance(first.prior, Normal)
    return problem_of(posterior, parameters=(replace(first, prior=replace(first.prior, sd=np.nextafter(first.prior.sd, 1.0))), *others))


def _other_data(posterior: Posterior) -> Posterior:
    y = posterior.problem.runs[0].y.copy()
    y[3] = np.nextafter(y[3], 9.0)
    return _with_run(posterior, y=y)


def _other_noise(posterior: Posterior) -> Posterior:
    noise = posterior.problem.runs[0].noise
    return _with_run(posterior, noise=replace(noise, sigma=replace(noise.sigma, value=0.0011)))


def _other_unit(posterior: Posterior) -> Posterior:
    first, *others = posterior.problem.parameters
    return problem_of(posterior, parameters=(replace(first, unit="%"), *others))


def _other_model(posterior: Posterior) -> Posterior:
    return _with_run(posterior, arguments={**posterior.problem.runs[0].arguments, "g": 9.80665})


CHANGES: dict[str, tuple[Callable[[Posterior], Posterior], str]] = {
    "data": (_other_data, "was made with other data (heavy-04);"),
    "model": (_other_model, "was made with another model (heavy-04);"),
    "prior": (_other_prior, "was made with other priors (gamma[heavy]);"),
    "noise": (_other_noise, "was made with other noise (heavy-04);"),
    "parameters": (_other_unit, "was made with other parameters (gamma[heavy] 1, now %);"),
}


def begin(fit: Fit, folder: Path, *, posterior: Posterior | None = None, seed: int = 7, target: Target = QUICK, shift: float = 0.0) -> None:
    store = Store(folder, resume=True)
    rng = np.random.default_rng(seed)
    with pytest.raises(Interrupted):
        sample_posterior(posterior or fit.posterior, fit.values + shift, fit.cov, target=target, rng=rng, store=store, stop=until(5))


@pytest.mark.parametrize("change", CHANGES)
def test_resume_is_refused_where_a_part_of_the_problem_differs(fit: Fit, tmp_path: Path, change: str) -> None:
    begin(fit, tmp_path)
    begin(fit, tmp_path)  # nothing changed: it goes on
    alter, words = CHANGES[change]
    with pytest.raises(InputError) as refusal:
        begin(fit, tmp_path, posterior=alter(fit.posterior))
    assert str(refusal.value).startswith(f"{tmp_path}: 'resume' cannot continue: the chain {words}")
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.n_step == 10  # a refusal touches nothing


def test_resume_is_refused_where_settings_seed_or_start_differ(fit: Fit, tmp_path: Path) -> None:
    begin(fit, tmp_path)
    with pytest.raises(InputError, match=r"made with other settings \(max_step 240, now 400\);"):
        begin(fit, tmp_path, target=replace(QUICK, max_step=400))
    with pytest.raises(InputError, match=r"made with other settings \(n_walker 14, now 16\);"):
        begin(fit, tmp_path, target=replace(QUICK, n_walker=16))
    with pytest.raises(InputError, match=r"made with another seed \(7, now 8\);"):
        begin(fit, tmp_path, seed=8)
    with pytest.raises(InputError, match="made with other starting points;"):
        begin(fit, tmp_path, shift=1e-9)


def test_resume_is_refused_by_another_version(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begin(fit, tmp_path)
    original = versions.version

    def begin_with(package: str, text: str | None) -> None:
        def found(name: str) -> str:
            if name == package and text is None:
                raise PackageNotFoundError
            return text if name == package and text else original(name)

        with monkeypatch.context() as patch:
            patch.setattr(versions, "version", found)
            begin(fit, tmp_path)

    with pytest.raises(InputError, match=rf"made with other versions \(emcee {original('emcee')}, now 9\.9\);"):
        begin_with("emcee", "9.9")
    other = None if "numba" in versions.engine_versions() else "0.1"  # machine code changes the last digits
    with pytest.raises(InputError, match=r"made with other versions \(numba "):
        begin_with("numba", other)


def test_resume_is_refused_for_a_density_that_the_key_cannot_see(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stored log densities that are too high freeze every walker: emcee never evaluates them again."""
    interrupted(tmp_path, 57)
    lower = Gaussian(SDS, shift=-1e4)
    with pytest.raises(InputError, match=r"log density of the stored walkers has changed.*\(largest change 1e\+04\)"):
        sampled(Store(tmp_path, resume=True), density=lower)
    with pytest.raises(InputError, match="log density of the stored walkers has changed"):
        sampled(Store(tmp_path, resume=True), density=Gaussian(SDS, shift=1e-4))
    monkeypatch.setattr(stepping, "_check_density", lambda *_: None)
    assert sampled(Store(tmp_path, resume=True), density=lower).stuck == 28  # what the guard is for


def test_fingerprint_sees_content_and_nothing_else() -> None:
    def scaled(factor: float) -> Callable[[float], float]:
        return lambda x: factor * x

    one = np.array([1.0, 2.0])
    different = [
        one, one[::-1], one.astype(np.float32), one.reshape(1, 2), np.nextafter(one, 2.0), [1.0, 2.0], (1.0, 2.0), [1, 2],
        {"a": 1.0}, {"b": 1.0}, ["a", 1.0], "ab", ["a", "b"], b"ab", None, {1, 2}, Normal(0.0, 1.0), Normal(0.0, 2.0), Gaussian(SDS),
        scaled(1.0), scaled(2.0), lambda x: 1.0 + x, np.sin, np.cos,
        np.random.RandomState(1), np.random.RandomState(2), np.random.default_rng(1), np.random.default_rng(2), [[1.0], [2.0]], [[1.0, 2.0]],
    ]
    assert len({fingerprints.fingerprint(thing) for thing in different}) == len(different)
    for a, b in [
        (one[::2], np.array([1.0])), ({"a": 1, "b": 2}, {"b": 2, "a": 1}), (scaled(2.0), scaled(2.0)),
        (Gaussian(SDS, 1.0), Gaussian(SDS.copy(), 2.0)), ({"x", "y", "z"}, {"z", "y", "x"}), (np.random.RandomState(3), np.random.RandomState(3)),
    ]:
        assert fingerprints.fingerprint(a) == fingerprints.fingerprint(b)


class Slotted:
    """No __dict__: its content stands in slots, of its own and of the class below."""

    __slots__ = ("gain",)

    def __init__(self, gain: float) -> None:
        self.gain = gain


class Further(Slotted):
    __slots__ = ("zero",)

    def __init__(self, gain: float, zero: float) -> None:
        super().__init__(gain)
        self.zero = zero


def test_fingerprint_sees_what_no_dict_holds() -> None:
    masked = [np.ma.array([1.0, 2.0], mask=mask) for mask in ([False, True], [True, False])]
    table = [type("Table", (dict,), {"unit": None})({"a": 1.0}) for _ in range(2)]
    table[1].unit = "m"
    different = [
        Slotted(1.0), Slotted(2.0), Further(1.0, 0.0), Further(1.0, 3.0), Further(2.0, 0.0), deque([1.0]), deque([2.0]), re.compile("a"),
        re.compile("b"), [1.0].index, [2.0].index, lru_cache(lambda x: x), lru_cache(lambda x: 2.0 * x), *masked, *table, Fraction(1, 2),
        np.sin, math.sin, np.polynomial.Polynomial([1.0]), np.polynomial.Polynomial([2.0]),
    ]
    assert len({fingerprints.fingerprint(thing) for thing in different}) == len(different)
    assert fingerprints.fingerprint([Further(1.0, 0.0)]) == fingerprints.fingerprint([Further(1.0, 0.0)])


UNKNOWN = [threading.Lock(), (x for x in "ab"), np.frompyfunc(abs, 1, 1), memoryview(b"a")]


@pytest.mark.parametrize("unknown", UNKNOWN, ids=[type(thing).__name__ for thing in UNKNOWN])
def test_what_does_not_tell_its_content_is_refused_in_one_sentence(unknown: object, tmp_path: Path) -> None:
    density = Gaussian(SDS, names=("a", "b", "c", unknown))  # somewhere inside
    with pytest.raises(InputError, match=r"^'checkpoint' cannot be kept for a model that holds an object which") as refusal:
        sampled(Store(tmp_path), density=density)
    assert "\n" not in str(refusal.value)
    assert type(unknown).__name__ in str(refusal.value)


def test_a_fingerprint_survives_a_move_to_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = """
    import functools
    from dataclasses import dataclass
    @dataclass(frozen=True)
    class Gain:
        value: float
    class Slotted:
        __slots__ = ("gain",)
        def __init__(self, gain): self.gain = gain
    class Plain:
        def __init__(self, gain): self.gain = gain
        def scaled(self, x): return self.gain * x
    def things(gain):
        return [Gain(gain), Slotted(gain), Plain(gain), Plain(gain).scaled, Plain, functools.partial(Plain.scaled, Plain(gain))]
    """
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "rooms").mkdir()
    for place in ("old_home_of_a_gain.py", "rooms/new_home_of_a_gain.py"):
        (tmp_path / place).write_text(textwrap.dedent(code))
    old, new = (importlib.import_module(name) for name in ("old_home_of_a_gain", "rooms.new_home_of_a_gain"))
    for a, b, other in zip(old.things(2.0), new.things(2.0), new.things(3.0), strict=True):
        assert fingerprints.fingerprint(a) == fingerprints.fingerprint(b)
        assert isinstance(a, type) or fingerprints.fingerprint(a) != fingerprints.fingerprint(other)


def test_key_is_the_same_in_another_process(fit: Fit, tmp_path: Path) -> None:
    """Nothing in it may depend on addresses or on the hash seed."""
    begin(fit, tmp_path)
    code = """
    import sys; from pathlib import Path; import numpy as np
    sys.path.insert(0, "tests"); import test_checkpoint as t
    from estim.campaign import load_campaign; from estim.fitting import fit_least_squares
    fit = fit_least_squares(load_campaign("data/replica/campaign.toml").problem(["heavy-04"]), rng=np.random.default_rng(1), n_start=1)
    t.begin(fit, Path(sys.argv[1]))
    """
    project = Path(__file__).parents[1]
    env = os.environ | {"PYTHONHASHSEED": "5"}
    words = [sys.executable, "-c", textwrap.dedent(code), str(tmp_path)]
    ran = subprocess.run(words, capture_output=True, text=True, cwd=project, env=env, check=False)
    assert ran.returncode == 0, ran.stderr
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.n_step == 10


# files that are not what they were


def _flipped(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "truncated": lambda data: data[:-1],
    "half": lambda data: data[: len(data) // 2],
    "zeros at the end": lambda data: data[:-512] + bytes(512),
    "longer": lambda data: data + b"\0",
    "one bit": _flipped,
    "garbage": lambda data: np.random.default_rng(1).bytes(len(data)),
}


@pytest.fixture(scope="module")
def four_chunks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("chunks")
    for _ in range(4):
        interrupted(folder, 40)
    assert len(list(folder.glob("*.npz"))) == 4
    return folder


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("number", [0, 2, 3])
def test_damaged_chunk_and_what_follows_is_never_read(four_chunks: Path, whole: Chain, tmp_path: Path, damage: str, number: int) -> None:
    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    (victim,) = folder.glob(f"{number:06d}-*.npz")
    victim.write_bytes(DAMAGE[damage](victim.read_bytes()))
    before, kept = read_checkpoint(four_chunks), read_checkpoint(folder)
    assert before is not None
    assert (0 if kept is None else kept.n_step) == 40 * number
    assert kept is None or np.array_equal(kept.draws, before.draws[:, : kept.n_step])
    said: list[str] = []
    chain = sampled(Store(folder, resume=True, say=said.append))
    assert same(chain, whole)
    assert f"{4 - number} of 4 chunks are damaged" in said[0]


def test_missing_chunk_ends_the_chain(four_chunks: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    next(folder.glob("000001-*")).unlink()
    kept = read_checkpoint(folder)
    assert kept is not None
    assert kept.n_step == 40


def _named(folder: Path, number: int, data: bytes) -> None:
    (folder / f"{number:06d}-{hashlib.sha256(data).hexdigest()}.npz").write_bytes(data)


def test_whole_chunk_of_another_chain_is_not_read(four_chunks: Path, tmp_path: Path) -> None:
    other, folder = tmp_path / "other", shutil.copytree(four_chunks, tmp_path / "chunks")
    for _ in range(2):
        with pytest.raises(Interrupted):
            sampled(Store(other, resume=True), until(40), seed=8)
    next(folder.glob("000001-*")).unlink()
    _named(folder, 1, next(other.glob("000001-*")).read_bytes())
    kept = read_checkpoint(folder)
    assert kept is not None
    assert kept.n_step == 40


def test_pickled_objects_are_never_loaded(four_chunks: Path, tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "exploded"),)

    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    last = next(folder.glob("000003-*"))
    with np.load(last) as arrays:
        contents = dict(arrays)
    stream = io.BytesIO()
    np.savez(stream, **{**contents, "accepted": np.array([Bomb()], dtype=object)})
    last.unlink()
    _named(folder, 3, stream.getvalue())
    kept = read_checkpoint(folder)
    assert kept is not None
    assert kept.n_step == 120
    assert not (tmp_path / "exploded").exists()


def test_chunks_without_their_key_are_refused(four_chunks: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    (folder / "key.json").unlink()
    assert read_checkpoint(folder) is None
    with pytest.raises(InputError, match=r"key\.json is missing; fit without --resume to start anew"):
        sampled(Store(folder, resume=True))
    for damage in (b"", b"{", b"[]", b'{"schema": "another"}'):
        (folder / "key.json").write_bytes(damage)
        assert read_checkpoint(folder) is None
        for resume in (True, False):
            with pytest.raises(InputError, match=r"key\.json: is damaged, or estim has not written it: move it away"):
                sampled(Store(folder, resume=resume))
            assert (folder / "key.json").read_bytes() == damage


def test_checkpoint_of_another_version_is_named_and_can_be_discarded(four_chunks: Path, whole: Chain, tmp_path: Path) -> None:
    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    (folder / "key.json").write_text('{"schema": "estim-checkpoint/9", "anything": [1, {}]}')
    assert read_checkpoint(folder) is None
    with pytest.raises(InputError, match=r"another version of estim \(estim-checkpoint/9\); fit without --resume to start anew"):
        sampled(Store(folder, resume=True))
    assert same(sampled(Store(folder)), whole)


def test_store_without_resume_discards_what_is_there_and_says_so(four_chunks: Path, whole: Chain, tmp_path: Path) -> None:
    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    (folder / f".000004-{'0' * 64}.npz.ab_c1234").write_bytes(b"left by a kill")
    said: list[str] = []
    store = Store(folder, say=said.append)
    assert same(sampled(store), whole)
    assert len(said) == 1
    assert "discarded" in said[0]
    kept = read_checkpoint(folder)
    assert kept is not None
    assert kept.n_step == 240
    assert not list(folder.glob(".*"))
    store.remove()
    assert not folder.exists()


def test_full_disk_is_one_line_and_what_was_kept_goes_on(whole: Chain, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original, left = os.fsync, iter(range(20))

    def fsync(handle: int) -> None:
        if next(left, None) is None:
            raise OSError(28, "No space left on device")
        original(handle)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", fsync)
        with pytest.raises(EstimError, match=r"cannot be written \(no space left on device\); 9 steps are kept: make room and continue"):
            sampled(Store(tmp_path, interval=0.0))
    kept = read_checkpoint(tmp_path)
    assert kept is not None
    assert kept.n_step == 9
    assert not list(tmp_path.glob(".*"))
    assert same(sampled(Store(tmp_path, resume=True)), whole)


def test_reader_in_a_loop_does_not_disturb_the_writer(whole: Chain, tmp_path: Path) -> None:
    seen: list[int] = []
    wrong: list[int] = []
    done = threading.Event()

    def read() -> None:
        while not done.wait(0.002):
            kept = read_checkpoint(tmp_path)
            n_step = 0 if kept is None else kept.n_step
            seen.append(n_step)
            if kept is not None and not np.array_equal(kept.draws[:, whole.n_burn :], whole.draws[:, : max(0, n_step - whole.n_burn)]):
                wrong.append(n_step)

    reader = threading.Thread(target=read)
    reader.start()
    try:
        chain = sampled(Store(tmp_path, interval=0.0))
    finally:
        done.set()
        reader.join()
    assert same(chain, whole)
    assert not wrong
    assert seen == sorted(seen)
    assert len(set(seen)) > 3


# kills


def wait_for(condition: Callable[[], bool], seconds: float = 300.0) -> None:
    limit = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.01)


KILLED = """
import os, sys; from pathlib import Path
sys.path.insert(0, "tests"); import test_checkpoint as t
for _ in sys.stdin:  # imported once, and a process for each chain
    child = os.fork()
    if child == 0:
        t.sampled(t.Store(Path(sys.argv[1]), resume=True, interval=0.0), lambda: t.time.sleep(0.005))
        os._exit(0)
    print(child, flush=True)
    print(os.waitpid(child, 0)[1], flush=True)
"""


def test_chain_killed_at_random_moments_is_the_whole_one(whole: Chain, tmp_path: Path, rng: np.random.Generator) -> None:
    """Three times SIGKILL; a step whose chunk was seen is never lost.  (benchmarks/kill_resume.py: a hundred.)"""
    launcher = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1]
    )
    seen = 0

    def n_chunk() -> int:  # to read them all over and over would cost more than to sample
        return len(list(tmp_path.glob("*.npz")))

    with launcher:
        for _ in range(3):
            print(file=launcher.stdin, flush=True)
            child = int(launcher.stdout.readline())
            before = n_chunk()
            wait_for(lambda: n_chunk() > before)  # noqa: B023
            time.sleep(float(rng.uniform(0.0, 0.2)))
            at_least = _n_step(tmp_path)
            os.kill(child, signal.SIGKILL)
            assert os.waitstatus_to_exitcode(int(launcher.stdout.readline())) == -signal.SIGKILL
            seen = _n_step(tmp_path)
            assert seen >= at_least
    assert 3 <= seen < 240
    assert same(sampled(Store(tmp_path, resume=True)), whole)


def _n_step(folder: Path) -> int:
    kept = read_checkpoint(folder)
    return 0 if kept is None else kept.n_step


def test_nothing_is_said_of_a_chain_that_cannot_be_opened(four_chunks: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(four_chunks, tmp_path / "chunks")
    (folder / f"000009-{'0' * 64}.npz").mkdir()
    said: list[str] = []
    with pytest.raises(EstimError, match="is a folder where estim keeps a file"):
        sampled(Store(folder, resume=True, say=said.append))
    with pytest.raises(EstimError, match="name too long"):
        sampled(Store(tmp_path / ("x" * 300), resume=True, say=said.append))
    assert said == []


def test_key_is_readable_by_a_person(tmp_path: Path, fit: Fit) -> None:
    begin(fit, tmp_path)
    parts = json.loads((tmp_path / "key.json").read_text())["parts"]
    assert list(parts) == ["data", "model", "priors", "noise", "parameters", "settings", "seed", "versions", "moves", "starting points", "density"]
    assert parts["settings"]["n_walker"] == "14"
    assert set(parts["priors"]) == set(fit.names)
