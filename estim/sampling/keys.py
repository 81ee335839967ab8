"""What a chain depends on, as named parts that can be compared later: data, model, priors, noise, parameters, settings, seed, versions.

A `Key` is part -> item -> text.  The text is short where it can be shown ("20000"), else a SHA-256 digest.  Two keys
are equal if the chains are; `differences` says in words what is not.
"""

from __future__ import annotations

import copyreg
import dataclasses
import functools
import hashlib
import json
import sys
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from estim.common import InputError, shorten
from estim.problem import Problem
from estim.versions import engine_versions

Key = Mapping[str, Mapping[str, str]]

_FOLLOWING = ("moves", "starting points", "density")  # they change with any other part: named only if nothing else differs
_SHORT, _LISTED, _PARTS = 40, 4, 12


def problem_key(problem: Problem) -> Key:
    """The parts that a problem decides, item by item: runs under data, model and noise, parameters under priors and parameters."""
    return {
        "data": {run.name: fingerprint((run.x, run.y, run.t)) for run in problem.runs},
        "model": {run.name: fingerprint((run.curve, run.arguments)) for run in problem.runs},
        "priors": {p.name: fingerprint(p.prior) for p in problem.parameters},
        "noise": {run.name: fingerprint(run.noise) for run in problem.runs}
        | {", ".join(shared.runs): fingerprint(shared) for shared in problem.shared},
        "parameters": {p.name: p.unit for p in problem.parameters},
    }


def sampling_key(density: object, *, settings: Mapping[str, object], moves: object, rng: np.random.Generator, starts: object) -> Key:
    """The key of a chain of `density`.

    density : a `Posterior` (its problem is taken apart) or any other density, which is one part as a whole.
    settings : what decides length and layout of the chain.  moves : of the sampler.
    starts : where it starts.
    """
    problem = getattr(density, "problem", None)
    seeds = getattr(rng.bit_generator, "seed_seq", None)
    return {
        **(problem_key(problem) if isinstance(problem, Problem) else {}),
        "settings": {name: str(value) for name, value in settings.items()},
        "seed": {"": str(getattr(seeds, "entropy", None)), "stream": str(getattr(seeds, "spawn_key", None))},
        "versions": engine_versions(),
        "moves": {"": fingerprint(moves)},
        "starting points": {"": fingerprint(starts)},
        "density": {"": fingerprint(density)},
    }


def digest_of(key: Key) -> str:
    """One SHA-256 digest for the whole key."""
    return hashlib.sha256(json.dumps({part: dict(items) for part, items in key.items()}, sort_keys=True).encode()).hexdigest()


def differences(old: Key, new: Key) -> list[str]:
    """What differs, in words: "other priors (gamma[heavy])", "another seed (1, now 2)"; empty if nothing does."""
    parts = list(dict.fromkeys((*new, *old)))
    changed = {part: _changed(old.get(part, {}), new.get(part, {})) for part in parts}
    # the noise of differentiated speeds contains times and frames: new data alone would show there too
    if "noise" in changed:
        changed["noise"] = [item for item in changed["noise"] if item not in changed.get("data", [])]
    leading = [part for part in parts if changed[part] and part not in _FOLLOWING]
    named = leading or [part for part in parts if changed[part]]
    said = [_phrase(part, changed[part], old.get(part, {}), new.get(part, {})) for part in named[:_PARTS]]
    return [*said, f"and {len(named) - _PARTS} more parts"] if len(named) > _PARTS else said


def _changed(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    return [item for item in dict.fromkeys((*new, *old)) if old.get(item) != new.get(item)]


def _phrase(part: str, items: list[str], old: Mapping[str, str], new: Mapping[str, str]) -> str:
    shown = [text for text in (_shown(item, old.get(item), new.get(item)) for item in items[:_LISTED]) if text]
    if len(items) > _LISTED:
        shown.append(f"and {len(items) - _LISTED} more")
    article = "another" if part in ("model", "seed", "density") else "other"
    return f"{article} {shorten(part)}" + (f" ({'; '.join(shown)})" if shown else "")


def _shown(item: str, old: str | None, new: str | None) -> str:
    if old is None or new is None:
        return f"{shorten(item)} {'was not there' if old is None else 'is not there any more'}".strip()
    if len(old) > _SHORT or len(new) > _SHORT:
        return shorten(item)
    return f"{shorten(item)} {old}, now {new}".strip()


def fingerprint(thing: object) -> str:
    """SHA-256 digest of the content of `thing`: the same in another process, different where any number in it is.

    Arrays count with type, shape and bytes; dataclasses with their fields (those with compare=False are left out: caches);
    functions with their code and what they enclose; other objects with what they would be pickled with.  Classes and
    functions count by their names without the module, so that they may move to another file.

    Raises InputError for an object that does not tell its content: two of them could not be told apart.
    """
    digest = hashlib.sha256()

    def add(kind: str, content: bytes) -> None:
        digest.update(f"{kind} {len(content)} ".encode())
        digest.update(content)

    _feed(add, thing, ())
    return digest.hexdigest()


def _feed(add: Callable[[str, bytes], None], thing: Any, above: tuple[int, ...]) -> None:
    """Hand `thing` to `add` in pieces, each with its kind and, by its length, its end; `above` holds what contains it."""
    kind = type(thing).__qualname__
    if thing is None or isinstance(thing, bool | int | float | complex | str | bytes):
        add(kind, repr(thing).encode())
    elif id(thing) in above:
        add("again", str(above.index(id(thing))).encode())
    elif (type(thing) is np.ndarray and thing.dtype != object) or isinstance(thing, np.generic):
        add(f"{thing.dtype.str} {thing.shape}", np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, type):
        add("name", thing.__qualname__.encode())
    else:
        pieces = _pieces(thing)
        add(kind, str(len(pieces)).encode())
        for piece in pieces:
            _feed(add, piece, (*above, id(thing)))


def _pieces(thing: Any) -> Sequence[Any]:
    """What a composite consists of, in an order that is the same in every process.  Raises InputError."""
    if type(thing) is np.ndarray:
        return [thing.shape, thing.tolist()]
    if dataclasses.is_dataclass(thing):
        return [(field.name, getattr(thing, field.name)) for field in dataclasses.fields(thing) if field.compare]
    if type(thing) in (dict, types.MappingProxyType):
        return sorted(thing.items(), key=lambda item: repr(item[0]))
    if type(thing) in (list, tuple):
        return list(thing)
    if type(thing) in (set, frozenset):
        return sorted(fingerprint(member) for member in thing)
    if isinstance(thing, functools.partial):
        return [thing.func, thing.args, thing.keywords]
    if isinstance(thing, types.MethodType):
        return [thing.__self__, thing.__func__]
    if isinstance(thing, types.CodeType):
        return [thing.co_code, thing.co_consts, thing.co_names]
    if isinstance(thing, types.FunctionType):
        closure = [cell.cell_contents for cell in thing.__closure__ or ()]
        return [thing.__qualname__, thing.__code__, thing.__defaults__, thing.__kwdefaults__, closure]
    if isinstance(thing, np.random.Generator):
        return [thing.bit_generator.state]
    if isinstance(thing, np.random.RandomState):
        return [thing.get_state(legacy=False)]
    if isinstance(thing, types.ModuleType):
        return [thing.__name__.rpartition(".")[2]]
    if isinstance(thing, types.BuiltinFunctionType):
        owner = thing.__self__
        return [thing.__qualname__, *([] if owner is None or isinstance(owner, types.ModuleType) else [owner])]
    if hasattr(thing, "__wrapped__"):
        return [thing.__wrapped__]
    return _pickled(thing)


def _pickled(thing: Any) -> Sequence[Any]:
    """What pickle would keep of an object: its state (attributes and slots), arguments and items; of what it finds by its name, the name."""
    try:
        reducer = copyreg.dispatch_table.get(type(thing))
        reduced = reducer(thing) if reducer else thing.__reduce_ex__(2)
    except Exception as error:  # whatever a class says that cannot be pickled
        raise _unknown(thing) from error
    if not isinstance(reduced, str):
        arguments, state, items, pairs = (*reduced[1:5], None, None, None)[:4]
        return [arguments, state, *(list(part) for part in (items, pairs) if part is not None)]
    places = (sys.modules.get(name) for name in (getattr(thing, "__module__", ""), "numpy", "scipy.special"))
    if not any(getattr(place, reduced, None) is thing for place in places):
        raise _unknown(thing)  # a ufunc made by hand, or a name that means something else
    return [reduced]


def _unknown(thing: Any) -> InputError:
    rule = "cannot be kept for a model that holds an object which does not tell its content (give its class a method __reduce__)"
    return InputError(rule, field="checkpoint", value=type(thing).__qualname__)
