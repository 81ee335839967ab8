"""What other packages load for features that no command uses, left until it is used: in the command line's own processes alone.

lmfit's front page loads matplotlib, pandas and dill, lmfit and emcee load scipy.stats, SciPy loads NumPy's tools for tests and for Fortran: most
of a second, for tools that no fit calls.  Nothing is taken away, everything is found when it is first used: the page of a package is run when
something of it is asked for (`_Page`), and a name that one of their files imports stands for the real one (`_Name`).  No other file sees a
stand-in.  In a user's Python, where estim is a guest, imports are as everywhere; so they are for what has been imported already.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.abc import Loader

_PAGES = frozenset({"lmfit", "numpy.f2py", "numpy.testing"})  # the last two: by `from numpy import *` in a file of SciPy
_LEFT = {  # file -> modules of which it imports names
    "emcee.moves.kde": frozenset({"scipy.stats"}),
    "lmfit.jsonutils": frozenset({"dill", "pandas"}),
    "lmfit.minimizer": frozenset({"pandas", "scipy.stats"}),
    "matplotlib.projections": frozenset({"mpl_toolkits.mplot3d"}),
    "scipy.optimize._remove_redundancy": frozenset({"scipy.linalg.interpolative"}),
    "scipy.optimize._shgo": frozenset({"scipy"}),  # `from scipy import spatial`
}


def import_lean() -> None:
    """From here on this process leaves what is not used; a second call does nothing."""
    if not is_lean():
        sys.meta_path.insert(0, _Finder)


def is_lean() -> bool:
    return _Finder in sys.meta_path


class _Finder:
    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name not in _PAGES and name not in _LEFT:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is None or spec.loader is None or (name in _PAGES and spec.submodule_search_locations is None):
            return spec
        spec.loader = _Lean(spec.loader)  # type: ignore[assignment]
        return spec


class _Lean:
    def __init__(self, real: Loader) -> None:
        self._real = real

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return _Page(spec.name) if spec.name in _PAGES else self._real.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        module.__loader__ = self._real
        if module.__spec__ is not None:
            module.__spec__.loader = self._real
        if not isinstance(module, _Page):
            module.__dict__["__builtins__"] = {**vars(builtins), "__import__": _importing(_LEFT[module.__name__])}  # of this file alone
            self._real.exec_module(module)


class _Page(ModuleType):
    """A package whose own file is run when something is asked for that only it has; its other files can be imported before."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        loader = None if self.__spec__ is None else self.__spec__.loader
        self.__class__ = ModuleType  # type: ignore[assignment]
        if loader is not None:
            loader.exec_module(self)
        return getattr(self, name)


def _importing(left: frozenset[str]) -> Callable[..., Any]:
    """The `__import__` of a file which leaves some modules, unless they are there already, or not installed."""

    def find(name: str, *rest: Any) -> Any:
        later = name in left and (name == "scipy" or name not in sys.modules) and find_spec(name.partition(".")[0]) is not None
        return _Module(name) if later else builtins.__import__(name, *rest)

    return find


class _Module:
    """Stands for a module in an `import` statement: every name of it is a `_Name`."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> _Name:
        return _Name(self._module, name)


class _Name:
    """Stands for a function, a class or a module that a module has; found there when it is used."""

    def __init__(self, module: str, name: str) -> None:
        self._place = module, name
        if name == "Axes3D":
            self.name = "3d"  # asked for where the kinds of axes are listed

    def _found(self) -> Any:
        module, name = self._place
        return getattr(import_module(module), name)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self._found()(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._found(), name)

    def __instancecheck__(self, thing: object) -> bool:
        return self._place[0] in sys.modules and isinstance(thing, self._found())
